import json
import math
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from other_runs import held_by_another_run

from gvp_lib.errors import InvalidParameterError, JournalError, WorkerDiedError
from gvp_lib.jobs import JobResult, finished_jobs, run_jobs, write_file

HERE = Path(__file__).parent
RECIPE = {"planner": "thesis", "noise": 0.1}
JOBS = {f"job {n}": n for n in range(12)}


@pytest.fixture(autouse=True)
def job_functions(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The functions, importable here and in spawned workers alike."""
    monkeypatch.syspath_prepend(str(HERE))  # spawned workers are given sys.path
    import job_functions

    return job_functions


def run(function: Callable[[Any], Any], jobs: Mapping[str, Any] = JOBS, **options: Any) -> dict[str, JobResult]:
    return run_jobs(function, jobs, progress=False, **options)


def lines_of(journal: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in journal.read_text().splitlines()]


def as_text(results: dict[str, JobResult]) -> str:
    """With every digit, and equal where both are NaN."""
    return json.dumps({key: result.value for key, result in results.items()})


# running


def test_results_come_in_the_order_of_the_jobs_as_json_has_them() -> None:
    results = run(lambda n: (n, {n: 0.1}), {"b": 2, "a": 1})
    assert list(results) == ["b", "a"]
    assert results["b"] == JobResult([2, {"2": 0.1}])


def test_the_results_do_not_depend_on_where_they_were_computed(job_functions: Any, tmp_path: Path) -> None:
    here = as_text(run(job_functions.draw))
    assert as_text(run(job_functions.draw, workers=2)) == here
    with ThreadPoolExecutor(3) as executor:
        assert as_text(run(job_functions.draw, executor=executor, workers=3)) == here
        assert executor.submit(int, "1").result() == 1  # still open
    half = {key: JOBS[key] for key in list(JOBS)[::2]}
    run(job_functions.draw, half, journal=tmp_path / "j", recipe=RECIPE)
    assert as_text(run(job_functions.draw, journal=tmp_path / "j", recipe=RECIPE)) == here


@pytest.mark.parametrize("workers", [1, 2])
def test_a_job_that_fails_stops_no_other_and_is_tried_again(job_functions: Any, workers: int, tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    results = run(job_functions.fail_on_three, workers=workers, journal=journal, recipe=RECIPE)
    assert [key for key, result in results.items() if result.failed] == ["job 3"]
    assert results["job 3"].value is None
    assert "ValueError: three is too many" in results["job 3"].error
    assert "fail_on_three" in results["job 3"].error
    assert len(lines_of(journal)) == len(JOBS)  # a header, and all but one
    again = run(job_functions.draw, journal=journal, recipe=RECIPE)
    assert again["job 3"].value["third"] == 1.0
    assert again["job 4"].value == 4


def test_what_json_cannot_hold_is_a_failure() -> None:
    result = run(lambda n: {n}, {"a": 1})["a"]
    assert result.failed
    assert "set is not JSON serializable" in result.error


def test_an_argument_that_cannot_be_sent_fails_alone(job_functions: Any) -> None:
    jobs: dict[str, Any] = {**JOBS, "bad": threading.Lock(), "good": 1}
    results = run(job_functions.draw, jobs, workers=2)
    assert [key for key, result in results.items() if result.failed] == ["bad"]
    assert "pickle" in results["bad"].error


def test_whoever_asks_hears_of_each_new_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    heard: list[str] = []

    def hear(key: str, result: JobResult) -> str:
        heard.append(key)
        return f"at {result.value}"

    run(abs, {"a": -1}, journal=tmp_path / "j", recipe=RECIPE, on_result=hear)
    run_jobs(abs, {"a": -1, "b": -2}, journal=tmp_path / "j", recipe=RECIPE, on_result=hear, title="measuring")
    assert heard == ["a", "b"]
    bar = capsys.readouterr().err
    assert "measuring: 100%" in bar
    assert "at 2" in bar


@pytest.mark.full
def test_a_dead_worker_is_an_error_that_says_how_to_go_on(job_functions: Any, tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    jobs = {**JOBS, **{f"more {n}": n + 100 for n in range(100)}}
    with pytest.raises(WorkerDiedError, match=r"died\..* of 112 jobs are done\. They are in .*: run the same again"):
        run(job_functions.die_on_three, jobs, workers=2, journal=journal, recipe=RECIPE)
    results = run(job_functions.fail_on_three, jobs, workers=2, journal=journal, recipe=RECIPE)
    assert sum(result.failed for result in results.values()) == 1
    with pytest.raises(WorkerDiedError, match=r"They are lost; with journal=Path"):
        run(job_functions.die_on_three, jobs, workers=2)


@pytest.mark.parametrize("workers", [1, 2])
def test_values_that_are_no_json_come_as_they_are_and_one_by_one(job_functions: Any, workers: int) -> None:
    finished = finished_jobs(job_functions.as_bytes, JOBS, workers=workers)
    first = next(finished)
    found = dict([first, *finished])
    assert found == {key: JobResult(bytes([n, 255])) for key, n in JOBS.items()}


def test_an_executor_has_all_jobs_done_and_not_all_in_its_hands_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gvp_lib.jobs._MOST_IN_FLIGHT", 3)
    done, most = 0, 0

    class Counting(ThreadPoolExecutor):
        submitted = 0

        def submit(self, *args: Any, **kwargs: Any) -> Any:
            nonlocal most
            self.submitted += 1
            most = max(most, self.submitted - done)
            return super().submit(*args, **kwargs)

    with Counting(2) as executor:
        for key, result in finished_jobs(abs, JOBS, executor=executor):
            assert result.value == JOBS[key]
            done += 1
    assert (done, executor.submitted) == (len(JOBS), len(JOBS))
    assert most <= 3 + 2  # those that came back together are handed on one by one


def test_jobs_that_have_not_begun_are_cancelled_where_nobody_wants_them_any_more() -> None:
    ran: list[int] = []
    with ThreadPoolExecutor(1) as executor:
        finished = finished_jobs(lambda n: (time.sleep(0.01), ran.append(n)), JOBS, executor=executor)
        next(finished)
        finished.close()
    assert len(ran) < len(JOBS)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"workers": 0}, "workers is 1 or more; got 0"),
        ({"workers": 2}, "several workers need a function at the top level of a module"),
        ({"journal": Path("j")}, "a journal needs a recipe"),
    ],
)
def test_misuse_is_refused(options: dict[str, Any], said: str) -> None:
    with pytest.raises(InvalidParameterError, match=said):
        run(lambda n: n, **options)


def test_a_key_is_a_string() -> None:
    with pytest.raises(InvalidParameterError, match=r"a job's key is a string.*got 3"):
        run(abs, {3: 3})  # type: ignore[dict-item]


# the journal


def test_finished_jobs_are_not_done_again(tmp_path: Path) -> None:
    journal = tmp_path / "new" / "journal"
    run(abs, JOBS, journal=journal, recipe=RECIPE)
    before = journal.read_bytes()
    results = run(lambda n: 1 / 0, journal=journal, recipe=RECIPE)
    assert [result.value for result in results.values()] == list(JOBS.values())
    assert journal.read_bytes() == before


def test_numbers_come_back_to_the_last_bit(tmp_path: Path) -> None:
    numbers = [0.1 + 0.2, 1e-320, -0.0, math.pi, float("inf"), 2**70]
    for _ in range(2):
        value = run(lambda _: numbers, {"a": 0}, journal=tmp_path / "j", recipe=RECIPE)["a"].value
        assert repr(value) == repr(numbers)


@pytest.mark.parametrize("cut", [1, 2, 20, 39])
def test_a_torn_end_is_dropped_and_that_job_runs_again(job_functions: Any, cut: int, tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    expected = as_text(run(job_functions.draw, journal=journal, recipe=RECIPE))
    whole = journal.read_bytes()
    journal.write_bytes(whole[:-cut])
    assert as_text(run(job_functions.draw, journal=journal, recipe=RECIPE)) == expected
    assert journal.read_bytes() == whole


def test_a_torn_header_is_begun_anew(tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    run(abs, journal=journal, recipe=RECIPE)
    whole = journal.read_bytes()
    journal.write_bytes(whole[:9])
    run(abs, journal=journal, recipe=RECIPE)
    assert journal.read_bytes() == whole


def test_a_journal_of_another_recipe_is_refused_and_left_alone(tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    run(abs, journal=journal, recipe=RECIPE)
    before = journal.read_bytes()
    with pytest.raises(JournalError, match="another recipe") as caught:
        run(abs, journal=journal, recipe={**RECIPE, "noise": 0.2})
    assert '"noise": 0.1' in str(caught.value)
    assert '"noise": 0.2' in str(caught.value)
    assert "Take another path, or delete the file" in str(caught.value)
    assert journal.read_bytes() == before
    run(abs, journal=journal, recipe={"noise": 0.1, "planner": "thesis"})  # the order of names does not matter


@pytest.mark.parametrize("text", ["my notes", "my notes\n", "[1]\n"])
def test_a_file_that_is_no_journal_is_refused_and_left_alone(text: str, tmp_path: Path) -> None:
    (tmp_path / "notes").write_text(text)
    with pytest.raises(JournalError, match="not a journal of jobs"):
        run(abs, journal=tmp_path / "notes", recipe=RECIPE)
    assert (tmp_path / "notes").read_text() == text


def test_damage_within_is_named_by_its_line(tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    run(abs, journal=journal, recipe=RECIPE)
    lines = journal.read_bytes().split(b"\n")
    lines[2] = b"\0\0\0"
    journal.write_bytes(b"\n".join(lines))
    with pytest.raises(JournalError, match=r"line 3 of .* is damaged.*Remove that line"):
        run(abs, journal=journal, recipe=RECIPE)


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
    jobs = {f"job {n}": n for n in range(int(sys.argv[4]))}
    run_jobs(slow_draw, jobs, workers=int(sys.argv[3]), journal=Path(sys.argv[2]), recipe=1, progress=False)
"""


def start(tmp_path: Path, workers: int, jobs: int = 60) -> tuple[subprocess.Popen[bytes], Path]:
    program, journal = tmp_path / "program.py", tmp_path / "journal"
    program.write_text(PROGRAM)
    paths = os.pathsep.join([str(HERE.parent), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, str(program), str(HERE), str(journal), str(workers), str(jobs)]
    return subprocess.Popen(command, env={**os.environ, "PYTHONPATH": paths}, stderr=subprocess.PIPE), journal


def wait_for_lines(journal: Path, n: int, process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + 60
    while not (journal.exists() and journal.read_bytes().count(b"\n") > n):
        assert process.poll() is None, process.stderr.read().decode() if process.stderr else ""
        assert time.monotonic() < deadline
        time.sleep(0.005)


@pytest.mark.full
@pytest.mark.parametrize("workers", [1, 2])
def test_a_run_killed_at_random_moments_loses_and_doubles_nothing(
    job_functions: Any, workers: int, tmp_path: Path
) -> None:
    moments = random.Random(workers)
    known: list[dict[str, Any]] = []
    jobs = {f"job {n}": n for n in range(150)}
    for _ in range(5):
        process, journal = start(tmp_path, workers, len(jobs))
        wait_for_lines(journal, max(1, len(known)), process)  # it has gone on from where it was
        time.sleep(moments.uniform(0, 0.1))
        process.send_signal(signal.SIGKILL)
        process.wait()
        seen = [json.loads(line) for line in journal.read_bytes().split(b"\n")[:-1]]
        assert json.dumps(seen[: len(known)]) == json.dumps(known)  # what was known still is
        known = seen
    assert 5 < len(known) <= len(jobs), "it ended before it was killed"
    results = run(job_functions.slow_draw, jobs, journal=journal, recipe=1)
    assert as_text(results) == as_text(run(job_functions.draw, jobs))
    assert sorted(line["key"] for line in lines_of(journal)[1:]) == sorted(jobs)


@pytest.mark.full
def test_the_workers_of_a_killed_run_end_too(tmp_path: Path) -> None:
    process, journal = start(tmp_path, 2)
    wait_for_lines(journal, 3, process)
    process.kill()
    # They hold the other end of this pipe for as long as they live.
    assert process.stderr is not None
    closed = threading.Thread(target=process.stderr.read, daemon=True)
    closed.start()
    closed.join(20)
    assert not closed.is_alive()


@pytest.mark.full
def test_an_interrupt_leaves_a_journal_to_go_on_from(tmp_path: Path) -> None:
    process, journal = start(tmp_path, 1)
    wait_for_lines(journal, 5, process)
    process.send_signal(signal.SIGINT)
    assert b"KeyboardInterrupt" in process.communicate()[1]
    n = len(lines_of(journal))
    assert 6 <= n < 61
    again, _ = start(tmp_path, 1)
    assert again.wait(60) == 0
    assert len(lines_of(journal)) == 61


def test_two_runs_do_not_write_one_journal(tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    with held_by_another_run(journal), pytest.raises(JournalError, match="in use by another run"):
        run(abs, journal=journal, recipe=1)


def test_a_file_that_cannot_be_replaced_is_still_there_and_no_draft_is_left(tmp_path: Path) -> None:
    (tmp_path / "data").write_text("a file, where a folder would have to be")
    with pytest.raises(OSError, match=r"exists|directory"):
        write_file(tmp_path / "data" / "new", b"new")
    (tmp_path / "folder").mkdir()
    with pytest.raises(OSError, match="directory"):
        write_file(tmp_path / "folder", b"new")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data", "folder"]
