"""Jobs: the same results wherever they run, whatever stopped them; and what is refused."""

import json
import math
import os
import pickle
import re
import subprocess
import sys
import threading
import time
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from pathlib import Path

import job_functions
import pytest
from job_functions import JOBS, as_text
from other_runs import held_by_another_run

from gvp_lib.errors import (
    InvalidParameterError,
    JournalError,
    MissingExtraError,
    RenderingError,
    UnknownNameError,
    WorkerDiedError,
)
from gvp_lib.jobs import JobResult, finished_jobs, run_jobs, write_file

HERE = Path(__file__).parent
RECIPE = {"planner": "thesis", "noise": 0.1}


@pytest.fixture
def journal(tmp_path):
    """A journal that does not exist yet."""
    return tmp_path / "new" / "journal"


def run(function, jobs=JOBS, **options):
    return run_jobs(function, jobs, progress=False, **{"recipe": RECIPE, **options})


def test_results_come_in_the_order_of_the_jobs_as_json_has_them():
    results = run(lambda n: (n, {n: 0.1}), {"b": 2, "a": 1})
    assert list(results) == ["b", "a"]
    assert results["b"] == JobResult([2, {"2": 0.1}])


def test_the_results_do_not_depend_on_where_they_were_computed(journal):
    here = as_text(run(job_functions.draw))
    assert as_text(run(job_functions.draw, workers=2)) == here
    with ThreadPoolExecutor(3) as executor:
        assert as_text(run(job_functions.draw, executor=executor, workers=3)) == here
        assert executor.submit(int, "1").result() == 1  # still open
    half = {key: JOBS[key] for key in list(JOBS)[::2]}
    run(job_functions.draw, half, journal=journal)
    assert as_text(run(job_functions.draw, journal=journal)) == here


@pytest.mark.parametrize("workers", [1, 2])
def test_a_job_that_fails_stops_no_other_and_is_tried_again(workers, journal):
    results = run(job_functions.fail_on_three, workers=workers, journal=journal)
    assert [key for key, result in results.items() if result.failed] == ["job 3"]
    assert results["job 3"].value is None
    assert "ValueError: three is too many" in results["job 3"].error
    assert "fail_on_three" in results["job 3"].error
    assert len(journal.read_text().splitlines()) == len(JOBS)  # a header, and all but one
    again = run(job_functions.draw, journal=journal)
    assert again["job 3"].value["third"] == 1.0
    assert again["job 4"].value == 4


def test_what_cannot_be_brought_back_or_sent_fails_alone():
    result = run(lambda n: {n}, {"a": 1})["a"]
    assert result.failed
    assert "set is not JSON serializable" in result.error
    results = run(job_functions.draw, {**JOBS, "bad": threading.Lock(), "good": 1}, workers=2)
    assert [key for key, result in results.items() if result.failed] == ["bad"]
    assert "pickle" in results["bad"].error


@pytest.mark.parametrize(
    "error",
    [
        UnknownNameError("arm", "ur6", ["ur5e"]),
        MissingExtraError("train", "torch", "learning"),
        RenderingError("it would draw in a window, but there is no screen", "import gvp_lib first"),
    ],
)
def test_an_error_that_makes_its_own_words_crosses_to_another_process(error):
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


def test_whoever_asks_hears_of_each_new_result(journal):
    heard = []
    for jobs in ({"a": -1}, {"a": -1, "b": -2}):
        run(abs, jobs, journal=journal, on_result=lambda key, result: heard.append((key, result.value)))
    assert heard == [("a", 1), ("b", 2)]


class Dying(Executor):
    """A pool that dies of job 5, or refuses it, and never answers job 6."""

    def __init__(self, refuses):
        self.refuses = refuses

    def submit(self, call, function, argument):
        future = Future()
        if argument == 5 and self.refuses:
            raise BrokenExecutor("no more")
        if argument == 5:
            future.set_exception(BrokenExecutor("it died"))
        elif argument != 6:
            future.set_result(call(function, argument))
        return future


@pytest.mark.parametrize(("refuses", "back"), [(False, 10), (True, 5)])
def test_what_did_come_back_from_a_pool_that_died_is_kept(refuses, back, journal):
    with Dying(refuses) as pool, pytest.raises(WorkerDiedError, match=r"They are lost; with journal=Path"):
        run(abs, executor=pool)
    with Dying(refuses) as pool, pytest.raises(WorkerDiedError, match=rf"died\..* {back} of 12 jobs are done"):
        run(abs, executor=pool, journal=journal)
    assert len(journal.read_text().splitlines()) == 1 + back


@pytest.mark.parametrize("workers", [1, 2])
def test_values_that_are_no_json_come_as_they_are_and_one_by_one(workers):
    finished = finished_jobs(job_functions.as_bytes, JOBS, workers=workers)
    first = next(finished)
    assert dict([first, *finished]) == {key: JobResult(bytes([n, 255])) for key, n in JOBS.items()}


def test_jobs_that_have_not_begun_are_cancelled_where_nobody_wants_them_any_more():
    ran = []
    with ThreadPoolExecutor(1) as executor:
        finished = finished_jobs(lambda n: (time.sleep(0.01), ran.append(n)), JOBS, executor=executor)
        next(finished)
        finished.close()
    assert len(ran) < len(JOBS)


@pytest.mark.parametrize(
    ("jobs", "options", "message"),
    [
        (JOBS, {"workers": 0}, "workers is 1 or more; got 0"),
        (JOBS, {"workers": 2}, "several workers need a function at the top level of a module .*lambda"),
        (JOBS, {"journal": Path("j"), "recipe": None}, "a journal needs a recipe"),
        ({3: 3}, {}, "a job's key is a string.*got 3"),
    ],
)
def test_misuse_is_refused(jobs, options, message):
    with pytest.raises(InvalidParameterError, match=message):
        run(lambda n: n, jobs, **options)


def test_a_journal_that_other_code_began_is_noticed_by_its_first_job(journal):
    run(abs, {"job 1": 1}, journal=journal)
    before = journal.read_bytes()
    with pytest.raises(JournalError, match=r"other code: its job job 1, run again, has the result\n  2\nwhere it"):
        run(lambda n: 2 * n, journal=journal, recheck=True)
    with pytest.raises(JournalError, match=r"(?s)job 1, run again, fails:\n.*ZeroDivisionError.*delete the file"):
        run(lambda n: 1 // 0, journal=journal, recheck=True)
    assert journal.read_bytes() == before
    assert as_text(run(abs, journal=journal, recheck=True)) == json.dumps(JOBS)


def test_finished_jobs_are_not_done_again_and_come_back_to_the_last_bit(journal):
    numbers = [0.1 + 0.2, 1e-320, -0.0, math.pi, float("inf"), 2**70]
    for function, recipe in ((lambda _: numbers, {"a": 1, "b": 2}), (lambda _: 1 / 0, {"b": 2, "a": 1})):
        assert repr(run(function, {"a": 0}, journal=journal, recipe=recipe)["a"].value) == repr(numbers)


@pytest.mark.parametrize("kept", [slice(-1), slice(-2), slice(-39), slice(9)])  # in the last lines; in the header
def test_a_torn_end_is_dropped_and_what_it_held_runs_again(kept, journal):
    expected = as_text(run(job_functions.draw, journal=journal))
    whole = journal.read_bytes()
    journal.write_bytes(whole[kept])
    assert as_text(run(job_functions.draw, journal=journal)) == expected
    assert journal.read_bytes() == whole


@pytest.mark.parametrize(
    ("was", "becomes", "message"),
    [
        (r"(?s).*", "my notes", "not a journal of jobs, and is left as it is"),
        (r"(?s).*", "[1]\n", "not a journal of jobs, and is left as it is"),
        (r"0\.1", "0.2", r'(?s)another recipe.*"noise": 0\.2.*"noise": 0\.1.*\nTake another path'),
        (r'.*"job 1".*', "\0\0\0", r"line 3 of .* is damaged.*Remove that line"),
    ],
)
def test_what_is_no_journal_of_these_jobs_is_refused_and_left_alone(was, becomes, message, journal):
    run(abs, journal=journal)
    text = re.sub(was, becomes, journal.read_text(), count=1)
    journal.write_text(text)
    with pytest.raises(JournalError, match=message):
        run(abs, journal=journal)
    assert journal.read_text() == text


def test_a_journal_that_cannot_be_written_or_that_another_run_writes_is_refused(tmp_path, journal):
    with pytest.raises(JournalError, match=r"cannot write .*directory\. What .* give a path that may be written"):
        run(abs, journal=tmp_path)
    with held_by_another_run(journal), pytest.raises(JournalError, match="in use by another run"):
        run(abs, journal=journal)


PROGRAM = """
import sys
from pathlib import Path
from gvp_lib.jobs import run_jobs
from job_functions import slow_draw
if __name__ == "__main__":
    jobs = {f"job {n}": n for n in range(150)}
    run_jobs(slow_draw, jobs, workers=2, journal=Path(sys.argv[1]), recipe=1, progress=False)
"""


def noted(journal):
    """Whole lines of a journal below its header."""
    return journal.read_text().split("\n")[1:-1] if journal.exists() else []


@pytest.mark.full
def test_a_run_that_is_killed_loses_and_doubles_nothing_and_its_workers_end_too(journal, tmp_path):
    (tmp_path / "program.py").write_text(PROGRAM)
    paths = os.pathsep.join([str(HERE), str(HERE.parent), os.environ.get("PYTHONPATH", "")])
    command, environment = [sys.executable, tmp_path / "program.py", journal], {**os.environ, "PYTHONPATH": paths}
    process, deadline = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE), time.monotonic() + 60
    while len(noted(journal)) < 3:
        assert process.poll() is None, process.communicate()[1].decode()
        assert time.monotonic() < deadline
        time.sleep(0.005)
    process.kill()
    process.communicate(timeout=20)  # the workers hold the other end of its pipe for as long as they live
    known, jobs = noted(journal), {f"job {n}": n for n in range(150)}
    assert len(known) < len(jobs), "it ended before it was killed"
    results = run(job_functions.draw, jobs, journal=journal, recipe=1)
    assert noted(journal)[: len(known)] == known
    assert as_text(results) == as_text(run(job_functions.draw, jobs))
    assert sorted(json.loads(line)["key"] for line in noted(journal)) == sorted(jobs)


def test_a_file_that_cannot_be_replaced_is_still_there_and_no_draft_is_left(tmp_path, monkeypatch):
    def full(_):
        raise OSError("No space left on device")

    write_file(tmp_path / "data", b"old")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        write_file(tmp_path / "data", b"new")
    assert [path.name for path in tmp_path.iterdir()] == ["data"]
    assert (tmp_path / "data").read_bytes() == b"old"
