"""Many jobs, on one core, on all of them or on a cluster, which may be stopped at any time and taken up again.

A job is a picklable argument under a name; its result is JSON data. Each result is on disk, in a journal, as soon as it
is known, so that whatever ends a run (Ctrl-C, a power cut, a full memory) costs at most the jobs in flight.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import pickle
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from tqdm import tqdm

from gvp_lib.errors import InvalidParameterError, WorkerDiedError
from gvp_lib.journal import Journal

__all__ = ["JobResult", "run_jobs"]

_CHUNK_TIME = 0.2  # s: so long a worker works between two answers, or on one job if that takes longer
_LARGEST_CHUNK = 256

_Chunk = list[tuple[str, Any]]  # keys and arguments
_Answer = tuple[str, str, str]  # key, JSON text of the value or "", traceback or ""


@dataclass(frozen=True, slots=True)
class JobResult:
    """What became of one job.

    Attributes
    ----------
    value
        What the function returned, as JSON brings it back: tuples are lists, keys are strings, floats are exact.
        None for a job that failed.
    error
        The traceback of a job that failed; empty otherwise.
    """

    value: Any
    error: str = ""

    @property
    def failed(self) -> bool:
        """Whether the function raised, or returned what is no JSON."""
        return bool(self.error)


def run_jobs(
    function: Callable[[Any], Any],
    jobs: Mapping[str, Any],
    *,
    executor: Executor | None = None,
    workers: int = 1,
    journal: Path | None = None,
    recipe: Any = None,
    recheck: bool = False,
    on_result: Callable[[str, JobResult], str | None] | None = None,
    keep: bool = True,
    progress: bool = True,
    title: str = "",
) -> dict[str, JobResult]:
    """Call ``function`` with every job's argument; the results in the order of ``jobs``.

    A job must depend on its argument alone (give it its own seed). Then the results are the same whatever the
    executor, however often the run was stopped.

    Parameters
    ----------
    function
        Returns JSON data. Unless it runs in this process, a function that can be imported.
    jobs
        Arguments, each under a key that names it in the journal.
    executor
        Where to run: a pool, or a cluster (:func:`gvp_lib.cluster.dask_cluster`). It stays open. None: in this
        process, or with ``workers > 1`` on a pool of as many, which are spawned (a fork would share the parent's
        graphics context).
    workers
        Processes. With an executor, how many jobs it can work on at once, if more than 16.
    journal
        File of what is finished; a run that finds it goes on from there. None: nothing is kept.
    recipe
        JSON data that says what the results depend on besides the keys, such as the settings that all jobs share: a
        journal of another recipe is refused. Required with a journal.
    recheck
        Whether the first job of a journal is run again, to see that the code still computes the same, to the bit.
    on_result
        Called here with each new key and result, as it comes. A text that it returns is shown beside the bar.
    keep
        Whether the values are returned. Large ones are better only handed to ``on_result``, and forgotten.
    progress, title
        Whether to show a bar, and what stands before it.

    Returns
    -------
    A result for each key. A job that failed is one of them; it is not in the journal, so that another run tries it
    again.

    Raises
    ------
    JournalError
        The journal is of another recipe, in use by another run, or no journal; or its first job, run again, has
        another result.
    WorkerDiedError
        A process of the pool died, or a cluster is gone. What was finished is in the journal.

    Examples
    --------
    >>> results = run_jobs(abs, {"a": -1, "b": "x"}, progress=False)
    >>> results["a"].value, results["b"].failed
    (1, True)
    """
    _check(function, jobs, executor, workers, journal, recipe)
    book = Journal(journal, recipe) if journal is not None else None
    with book or nullcontext():
        results = {key: JobResult(value) for key, value in (book.read() if book else {}).items() if key in jobs}
        checked = next((key for key in results if recheck), None)
        todo = ((key, argument) for key, argument in jobs.items() if key not in results or key == checked)
        failures = 0
        with (
            tqdm(total=len(jobs), initial=len(results), desc=title, unit="job", disable=not progress) as bar,
            _answers(function, todo, executor, workers) as answers,
        ):
            try:
                for answer in answers:
                    if book and (again := [each for each in answer if each[0] == checked]):
                        book.compare_value(*again[0], results[again[0][0]].value)
                        answer.remove(again[0])
                    if book:
                        book.append((key, text) for key, text, error in answer if not error)
                    for key, text, error in answer:
                        results[key] = result = JobResult(None if error else json.loads(text), error)
                        failures += result.failed
                        said = on_result(key, result) if on_result else None
                        if not keep:
                            results[key] = JobResult(None, error)
                        bar.set_postfix_str(", ".join(filter(None, [said, f"{failures} failed" * bool(failures)])))
                        bar.update()
            except (BrokenExecutor, CancelledError) as death:
                raise WorkerDiedError(_obituary(len(results) - failures, len(jobs), journal, death)) from death
    return {key: results[key] for key in jobs}


def _check(
    function: Callable[[Any], Any],
    jobs: Mapping[str, Any],
    executor: Executor | None,
    workers: int,
    journal: Path | None,
    recipe: Any,
) -> None:
    if workers < 1:
        raise InvalidParameterError(
            f"workers is 1 or more; got {workers}. os.cpu_count() says how many cores there are"
        )
    if odd := [key for key in jobs if not isinstance(key, str)]:
        raise InvalidParameterError(f"a job's key is a string, which names it in the journal; got {odd[0]!r}")
    if journal is not None and recipe is None:
        raise InvalidParameterError(
            "a journal needs a recipe: JSON data that says what its results depend on, such as the settings that all "
            "jobs share, so that results of other settings are never mixed in"
        )
    if executor is None and workers > 1:
        try:
            pickle.dumps(function)
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise InvalidParameterError(
                f"several workers need a function at the top level of a module; got {function!r}. Move it there, or "
                "take workers=1"
            ) from error


def _obituary(done: int, total: int, journal: Path | None, death: BaseException) -> str:
    kept = (
        f"They are in {journal}: run the same again and it goes on from there"
        if journal is not None
        else "They are lost; with journal=Path(...) another run goes on from there"
    )
    if isinstance(death, CancelledError):
        return f"the executor gave up its jobs with {done} of {total} done: its cluster ended or is cut off. {kept}"
    return (
        f"a worker process died with {done} of {total} jobs done. {kept}. Common causes: memory ran out (take fewer "
        "workers), or the script that started the run does so outside `if __name__ == '__main__':`"
    )


# --- running ------------------------------------------------------------------------------------------------


def _call(function: Callable[[Any], Any], chunk: _Chunk) -> tuple[list[_Answer], float]:
    """Do a chunk's jobs, in whatever process; their answers and how long they took, s."""
    start = time.perf_counter()
    answers = []
    for key, argument in chunk:
        try:
            answers.append((key, json.dumps(function(argument)), ""))
        except Exception:
            answers.append((key, "", traceback.format_exc()))
    return answers, time.perf_counter() - start


def _become_worker() -> None:
    """In a process of the pool: draw in one thread, for several would be in the other workers' way; and end when the
    parent is killed, since by itself it would wait for more work forever."""
    os.environ.setdefault("LP_NUM_THREADS", "1")  # of software rendering
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _answers(
    function: Callable[[Any], Any], todo: Iterator[tuple[str, Any]], executor: Executor | None, workers: int
) -> Iterator[Iterator[list[_Answer]]]:
    """The answers of all jobs, a few at a time, as they come."""
    if executor is None and workers == 1:
        yield (_call(function, [job])[0] for job in todo)
        return
    pool = executor or ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _become_worker)
    in_flight: dict[Future[Any], _Chunk] = {}
    try:
        yield _stream(pool, function, todo, in_flight, 2 * workers if executor is None else max(2 * workers, 32))
    finally:
        for future in in_flight:
            future.cancel()
        if executor is None:
            pool.shutdown(cancel_futures=True)


def _stream(
    pool: Executor,
    function: Callable[[Any], Any],
    todo: Iterator[tuple[str, Any]],
    in_flight: dict[Future[Any], _Chunk],
    most: int,
) -> Iterator[list[_Answer]]:
    """Keep ``most`` chunks in flight; they grow until one takes :data:`_CHUNK_TIME`."""
    size = 1
    alone: _Chunk = []  # jobs of a chunk that could not be sent or brought back: which of them is to blame?
    # A cluster whose worker died blames every job that waited there. Each gets a last chance, with nothing beside it.
    blamed: _Chunk = []
    last_chance: set[str] = set()
    death: BaseException | None = None
    while death is None:
        while len(in_flight) < most and (chunk := [alone.pop()] if alone else list(islice(todo, size))):
            in_flight[pool.submit(_call, function, chunk)] = chunk
        if not in_flight and blamed:
            last_chance.add(blamed[-1][0])
            chunk = [blamed.pop()]
            in_flight[pool.submit(_call, function, chunk)] = chunk
        if not in_flight:
            return
        for future in wait(in_flight, return_when=FIRST_COMPLETED).done:
            chunk = in_flight.pop(future)
            error = CancelledError() if future.cancelled() else future.exception()  # cancelled: not by us
            if isinstance(error, BrokenExecutor | CancelledError):
                death = error  # after those that did come back
            elif error is None:
                answers, seconds = future.result()
                size = max(1, min(2 * size, int(_CHUNK_TIME * len(chunk) / max(seconds, 1e-9)), _LARGEST_CHUNK))
                yield answers
            elif len(chunk) > 1:
                alone += chunk
            elif chunk[0][0] not in last_chance:
                blamed += chunk
            else:
                yield [(chunk[0][0], "", "".join(traceback.format_exception(error)))]
    raise death
