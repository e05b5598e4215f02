"""Jobs: the same results wherever they run, whatever stopped them; and what is refused."""

import json
import math
import os
import random
import re
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from pathlib import Path

import job_functions
import pytest
from other_runs import held_by_another_run

from gvp_lib.errors import InvalidParameterError, JournalError, WorkerDiedError
from gvp_lib.jobs import JobResult, finished_jobs, run_jobs, write_file

HERE = Path(__file__).parent
RECIPE = {"planner": "thesis", "noise": 0.1}
JOBS = {f"job {n}": n for n in range(12)}


@pytest.fixture
def journal(tmp_path):
    """A journal that does not exist yet."""
    return tmp_path / "new" / "journal"


def run(function, jobs=JOBS, **options):
    return run_jobs(function, jobs, progress=False, **{"recipe": RECIPE, **options})


def as_text(results):
    """With every digit, and equal where both are NaN."""
    return json.dumps({key: result.value for key, result in results.items()})


# running


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


def test_whoever_asks_hears_of_each_new_result(journal, capsys):
    heard = []

    def hear(key, result):
        heard.append(key)
        return f"at {result.value}"

    run(abs, {"a": -1}, journal=journal, on_result=hear)
    run_jobs(abs, {"a": -1, "b": -2}, journal=journal, recipe=RECIPE, on_result=hear, title="measuring")
    assert heard == ["a", "b"]
    bar = capsys.readouterr().err
    assert "measuring: 100%" in bar
    assert "at 2" in bar


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


@pytest.mark.full
def test_a_dead_worker_is_an_error_that_says_how_to_go_on(journal):
    with pytest.raises(WorkerDiedError, match=r"died\..* of 12 jobs are done\. They are in .*: run the same again"):
        run(job_functions.die_on_three, workers=2, journal=journal)
    results = run(job_functions.fail_on_three, workers=2, journal=journal)
    assert [key for key, result in results.items() if result.failed] == ["job 3"]


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


# the journal


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


def test_a_journal_that_cannot_be_written_is_refused(tmp_path):
    with pytest.raises(JournalError, match=r"cannot write .*directory\. What .* give a path that may be written"):
        run(abs, journal=tmp_path)


def test_two_runs_do_not_write_one_journal(journal):
    with held_by_another_run(journal), pytest.raises(JournalError, match="in use by another run"):
        run(abs, journal=journal)


# runs that are stopped

PROGRAM = """
import signal
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from gvp_lib.jobs import run_jobs
from job_functions import slow_draw
if __name__ == "__main__":
    # A test run in the background of a shell passes on that interrupts are ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    jobs = {f"job {n}": n for n in range(150)}
    run_jobs(slow_draw, jobs, workers=int(sys.argv[3]), journal=Path(sys.argv[2]), recipe=1, progress=False)
"""


def noted(journal):
    """Whole lines of a journal below its header."""
    return journal.read_text().split("\n")[1:-1] if journal.exists() else []


def start(journal, workers):
    """Run `PROGRAM` until it has added to the journal."""
    program, before = journal.parent.parent / "program.py", len(noted(journal))
    program.write_text(PROGRAM)
    paths = os.pathsep.join([str(HERE.parent), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, str(program), str(HERE), str(journal), str(workers)]
    process = subprocess.Popen(command, env={**os.environ, "PYTHONPATH": paths}, stderr=subprocess.PIPE)
    deadline = time.monotonic() + 60
    while len(noted(journal)) <= before:
        assert process.poll() is None, process.communicate()[1].decode()
        assert time.monotonic() < deadline
        time.sleep(0.005)
    return process


@pytest.mark.full
def test_a_run_killed_at_random_moments_loses_and_doubles_nothing_and_its_workers_end_too(journal):
    moments, known, jobs = random.Random(2), list[str](), {f"job {n}": n for n in range(150)}
    for _ in range(3):
        process = start(journal, 2)
        time.sleep(moments.uniform(0, 0.1))
        process.kill()
        process.communicate(timeout=20)  # the workers hold the other end of its pipe for as long as they live
        seen = noted(journal)
        assert seen[: len(known)] == known  # what was known still is
        known = seen
    assert 3 <= len(known) < len(jobs), "it ended before it was killed"
    results = run(job_functions.slow_draw, jobs, journal=journal, recipe=1)
    assert as_text(results) == as_text(run(job_functions.draw, jobs))
    assert sorted(json.loads(line)["key"] for line in noted(journal)) == sorted(jobs)


@pytest.mark.full
def test_an_interrupt_leaves_a_journal_to_go_on_from(journal):
    process = start(journal, 1)
    process.send_signal(signal.SIGINT)
    assert b"KeyboardInterrupt" in process.communicate()[1]
    assert 0 < len(noted(journal)) < 150
    assert start(journal, 1).wait(60) == 0
    assert len(noted(journal)) == 150


# files


def test_a_file_that_cannot_be_replaced_is_still_there_and_no_draft_is_left(tmp_path, monkeypatch):
    def full(_):
        raise OSError("No space left on device")

    write_file(tmp_path / "data", b"old")
    with pytest.raises(OSError, match=r"exists|directory"):
        write_file(tmp_path / "data" / "new", b"new")
    (tmp_path / "folder").mkdir()
    with pytest.raises(OSError, match="directory"):
        write_file(tmp_path / "folder", b"new")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        write_file(tmp_path / "data", b"new")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data", "folder"]
    assert (tmp_path / "data").read_bytes() == b"old"
