"""Many jobs on one core, all cores or a cluster, which may be stopped at any time and resumed.

A job is a named, picklable argument; its result is JSON data. Each result goes to a journal on disk as soon as it is
known, so whatever ends a run (Ctrl-C, a power cut, full memory) costs at most the jobs in flight.
"""

from __future__ import annotations

import fcntl
import json
import multiprocessing
import os
import pickle
import subprocess
import threading
import traceback
from collections.abc import Callable, Generator, Iterator, Mapping
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor, as_completed
from contextlib import closing, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from tqdm import tqdm

from gvp_lib.errors import ClusterError, InvalidParameterError, JournalError, MissingExtraError, WorkerDiedError

if TYPE_CHECKING:
    from distributed import Client

__all__ = [
    "JobResult",
    "dask_cluster",
    "disk_errors",
    "finished_jobs",
    "open_locked",
    "run_jobs",
    "source_commit",
    "write_file",
]


@dataclass(frozen=True, slots=True)
class JobResult:
    """Outcome of one job.

    Attributes
    ----------
    value
        What the function returned; None for a job that failed. From :func:`run_jobs` as JSON brings it back: tuples
        are lists, keys are strings, floats are exact.
    error
        Traceback of a job that failed; empty otherwise.
    """

    value: Any
    error: str = ""

    @property
    def failed(self) -> bool:
        """Whether the function raised, or its value could not be brought back."""
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
    progress: bool = True,
    title: str = "",
) -> dict[str, JobResult]:
    """Call ``function`` with every job's argument.

    A job must depend on its argument alone (give it its own seed). Then the results do not depend on the executor, nor
    on how often the run was stopped.

    Parameters
    ----------
    function
        Returns JSON data. It must be importable, unless it runs in this process.
    jobs
        Arguments by the keys that name them in the journal.
    executor
        Pool or cluster (:func:`dask_cluster`) to run on; it stays open. None: this process, or with ``workers > 1`` a
        pool of as many spawned processes (a fork would share the parent's graphics context).
    workers
        Processes on this machine; ignored with an executor.
    journal
        File of finished jobs, from which another run goes on. None: nothing is kept.
    recipe
        JSON data on which the results depend besides the keys, such as the settings that all jobs share: a journal of
        another recipe is refused. Required with a journal.
    recheck
        Whether to run the first job of a journal again, and to refuse to go on if its result differs in a single bit.
    on_result
        Called in this process with each new key and result. A text that it returns is shown beside the bar.
    progress, title
        Whether to show a bar, and the text before it.

    Returns
    -------
    dict
        A result for each key, in the order of ``jobs``. Failed jobs are included, but not kept in the journal, so that
        another run tries them again.

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
    if odd := [key for key in jobs if not isinstance(key, str)]:
        raise InvalidParameterError(f"a job's key is a string, which names it in the journal; got {odd[0]!r}")
    if journal is not None and recipe is None:
        raise InvalidParameterError(
            "a journal needs a recipe: JSON data that says what its results depend on, such as the settings that all "
            "jobs share, so that results of other settings are never mixed in"
        )
    _check_workers(workers)
    with nullcontext() if journal is None else closing(_Journal(journal, recipe)) as book:
        results = {key: JobResult(value) for key, value in (book.finished if book else {}).items() if key in jobs}
        checked = list(results)[: int(recheck)]  # asked for first; with several workers others may come before it
        todo = {key: jobs[key] for key in [*checked, *jobs] if key not in results or key in checked}
        failures = 0
        with (
            tqdm(total=len(jobs), initial=len(results), desc=title, unit="job", disable=not progress) as bar,
            closing(finished_jobs(partial(_as_json, function), todo, executor=executor, workers=workers)) as finished,
        ):
            try:
                for key, sent in finished:
                    result = sent if sent.failed else JobResult(json.loads(sent.value))
                    if book and key in checked:
                        book.compare(key, result)
                        continue
                    if book and not result.failed:
                        book.append(key, sent.value)
                    results[key] = result
                    failures += result.failed
                    message = on_result(key, result) if on_result else None
                    bar.set_postfix_str(", ".join(filter(None, [message, f"{failures} failed" * bool(failures)])))
                    bar.update()
            except WorkerDiedError as death:
                kept = "They are lost; with journal=Path(...) another run goes on from there"
                if journal is not None:
                    kept = f"They are in {journal}: run the same again and it goes on from there"
                done = len(results) - failures
                raise WorkerDiedError(f"{death}. {done} of {len(jobs)} jobs are done. {kept}") from death
    return {key: results[key] for key in jobs}


def finished_jobs(
    function: Callable[[Any], Any], jobs: Mapping[str, Any], *, executor: Executor | None = None, workers: int = 1
) -> Generator[tuple[str, JobResult], None, None]:
    """Call ``function`` with every job's argument; yield keys and results as they are finished.

    Values need not be JSON (bytes, for instance): they come back as pickle delivers them, and no journal keeps them.
    Closing the iterator cancels the jobs that have not begun. The parameters are those of :func:`run_jobs`.

    Raises
    ------
    WorkerDiedError
        A process of the pool died, or a cluster is gone; raised after the results that did come back.
    """
    _check_workers(workers)
    if executor is None and workers == 1:
        for key, argument in jobs.items():
            yield key, _call(function, argument)
        return
    if executor is None:
        try:
            pickle.dumps(function)
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise InvalidParameterError(
                f"several workers need a function at the top level of a module ({error}). Move it there, or take "
                "workers=1"
            ) from error
    pool = executor or ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _become_worker)
    futures: dict[Future[JobResult], str] = {}
    death: Exception | None = None
    try:
        try:
            for key, argument in jobs.items():
                futures[pool.submit(_call, function, argument)] = key
            for future in as_completed(list(futures)):
                yield futures.pop(future), _outcome(future)
        except (BrokenExecutor, CancelledError) as error:
            death = error
        for future in [each for each in futures if each.done()]:  # of the others some may never come
            with suppress(BrokenExecutor, CancelledError):
                yield futures.pop(future), _outcome(future)
    finally:
        for future in futures:
            future.cancel()
        if executor is None:
            pool.shutdown(cancel_futures=True)
    if isinstance(death, CancelledError):
        raise WorkerDiedError("the executor gave up its jobs: its cluster ended or is cut off") from death
    if death is not None:
        raise WorkerDiedError(
            "a worker process died. Common causes: memory ran out (take fewer workers), or the script that started the "
            "run does so outside `if __name__ == '__main__':`"
        ) from death


def _check_workers(workers: int) -> None:
    if workers < 1:
        raise InvalidParameterError(
            f"workers is 1 or more; got {workers}. os.cpu_count() says how many cores there are"
        )


def _outcome(future: Future[JobResult]) -> JobResult:
    """Result of a job that is done, unless its pool died."""
    failure = CancelledError() if future.cancelled() else future.exception()  # cancelled: not by us
    if isinstance(failure, BrokenExecutor | CancelledError):
        raise failure
    if failure is not None:  # its argument or its value could not be sent, or Dask gave it up
        return JobResult(None, "".join(traceback.format_exception(failure)))
    return future.result()


def _call(function: Callable[[Any], Any], argument: Any) -> JobResult:
    try:
        return JobResult(function(argument))
    except Exception:
        return JobResult(None, traceback.format_exc())


def _as_json(function: Callable[[Any], Any], argument: Any) -> str:
    return json.dumps(function(argument))


def _become_worker() -> None:
    """Let a process of the pool draw in one thread, leaving the other cores to the others, and end with its parent: if
    that is killed, it would otherwise wait for work forever."""
    os.environ.setdefault("LP_NUM_THREADS", "1")  # of software rendering
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


# --- on disk ----------------------------------------------------------------------------------------------------------


class _Journal:
    """Finished jobs in a locked file, one JSON line each, below one that names the recipe.

    Attributes
    ----------
    finished
        Values by key, as they stood in the file when it was opened.
    """

    def __init__(self, path: Path, recipe: Any) -> None:
        self._path = Path(path)
        self._header = json.dumps({"journal": 1, "recipe": recipe}, sort_keys=True).encode() + b"\n"
        with disk_errors(path, JournalError):
            self._file = open_locked(path)
        try:
            self.finished = self._read()
        except BaseException:
            self._file.close()
            raise

    def close(self) -> None:
        self._file.close()

    def append(self, key: str, text: str) -> None:
        """Add a finished job and the JSON text of its value; on disk when this returns."""
        self._write(f'{{"key": {json.dumps(key)}, "value": {text}}}\n'.encode())

    def compare(self, key: str, result: JobResult) -> None:
        """Refuse to go on where a job, run again, has another result than the file has."""
        was, now = json.dumps(self.finished[key]), json.dumps(result.value)
        if result.failed or now != was:
            raise JournalError(
                f"{self._path} was begun by other code: its job {key}, run again, "
                + (f"fails:\n{result.error}" if result.failed else f"has the result\n  {now}\nwhere it had\n  {was}")
                + "\nGo on with the code that began it, or delete the file to begin anew"
            )

    def _read(self) -> dict[str, Any]:
        """The finished values. A torn last line is removed from the file, and its job runs again."""
        self._file.seek(0)
        whole, newline, torn = self._file.read().rpartition(b"\n")
        if not newline and self._header.startswith(torn):  # new, or killed at its first write
            self._file.truncate(0)
            self._write(self._header)
            return {}
        header, *lines = whole.split(b"\n")
        if not header.startswith(b'{"journal": '):
            raise JournalError(f"{self._path} is not a journal of jobs, and is left as it is; take another path")
        if header + b"\n" != self._header:
            raise JournalError(
                f"{self._path} is the journal of another recipe: it begins with\n  {header.decode(errors='replace')}\n"
                f"and this run's with\n  {self._header.decode()}Take another path, or delete the file to begin anew"
            )
        values = {}
        for number, line in enumerate(lines, start=2):
            try:
                entry = json.loads(line)
                values[entry["key"]] = entry["value"]
            except (ValueError, TypeError, KeyError) as error:
                raise JournalError(
                    f"line {number} of {self._path} is damaged: {line[:60]!r}. Remove that line, and its job runs again"
                ) from error
        self._file.truncate(len(whole) + 1)
        return values

    def _write(self, data: bytes) -> None:
        with disk_errors(self._path, JournalError):
            self._file.write(data)
            self._file.flush()
            os.fsync(self._file.fileno())


@contextmanager
def disk_errors(path: Path | str, kind: type[Exception]) -> Iterator[None]:
    """Context in which an OSError of a file or folder is raised as an error of ours, with what would work."""
    try:
        yield
    except BlockingIOError as error:
        raise kind(f"{path} is in use by another run; wait for it, or give another path") from error
    except OSError as error:
        raise kind(
            f"cannot write {path}: {error.strerror or error}. What was there before is kept; make room, or give a path "
            "that may be written"
        ) from error


def write_file(path: Path | str, data: bytes) -> None:
    """Write a file whole or not at all: a reader never finds half of it. Its folder is created if missing.

    Only one process may write it at a time. A draft that a killed one left is overwritten by the next.

    Raises
    ------
    OSError
        It cannot be written; what was there before is still there.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.draft")  # beside it, so that the renaming is atomic
    try:
        with open(draft, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)
    except OSError:
        draft.unlink(missing_ok=True)
        raise


def open_locked(path: Path | str) -> BinaryIO:
    """Open a file to read and append, locked by this process until it is closed or the process ends.

    The file and its folder are created if missing.

    Raises
    ------
    BlockingIOError
        Another process has locked it.
    OSError
        It cannot be opened for writing.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    file = open(path, "a+b")  # noqa: SIM115 - the caller closes it
    try:
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:  # of several kinds, by the file system
        file.close()
        raise BlockingIOError(error.errno, error.strerror, str(path)) from error
    return file


# --- a cluster --------------------------------------------------------------------------------------------------------

_PACKAGES = ("gvp_lib", "numpy", "scipy", "opencv-python-headless", "mujoco", "mink")
"""A result depends on their versions."""
_SOURCE = Path(__file__).resolve().parent


@contextmanager
def dask_cluster(address: str, *, timeout: float = 5.0) -> Iterator[Executor]:
    """Context in which a Dask cluster is the executor; the cluster itself outlives it.

    An episode draws with an OpenGL context, which belongs to one thread, and caches its scenes without locks. So every
    worker runs one job at a time, in one thread; a machine of n cores gets n workers::

        dask scheduler
        dask worker --nthreads 1 --nworkers 8 tcp://scheduler:8786

    A job whose worker died goes to another; after four deaths in a row it has failed, and so may one that waited beside
    it each time (Dask's ``allowed-failures``): another run tries both again. With no worker left, a run waits for a new
    one. Workers must have this process's versions of the library and of what it computes with, and the same commit of
    its source; those that join later are not checked.

    Parameters
    ----------
    address
        Address that the scheduler prints, like ``"tcp://host:8786"``.
    timeout
        Time for the scheduler to answer and for a first worker to be there, s.

    Raises
    ------
    MissingExtraError
        Dask is not installed.
    ClusterError
        Nobody answers at the address, it has no workers, or workers of several threads or of other versions.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise MissingExtraError("a Dask cluster", error.name or "distributed", "cluster") from error
    if not address:  # Dask would start a cluster of its own
        raise ClusterError("a Dask scheduler's address is like tcp://host:8786; got an empty one")
    try:
        client = Client(address, timeout=timeout, set_as_default=False)
    except (OSError, ValueError, OverflowError, ImportError) as error:
        raise ClusterError(
            f"no Dask scheduler answers at {address!r} ({error}). Expected is the address that one prints, like "
            "tcp://host:8786; `dask scheduler` starts one, and a firewall between may need a port opened"
        ) from error
    with client:
        _check_cluster(client, address, timeout)
        # Dask takes a call that it has seen before for done, unless told that it is not pure.
        yield client.get_executor(pure=False)


def _check_cluster(client: Client, address: str, timeout: float) -> None:
    mend = f"Start them by `dask worker --nthreads 1 --nworkers N {address}`, with N the machine's cores"
    try:
        client.wait_for_workers(1, timeout)
    except TimeoutError as error:
        raise ClusterError(f"the Dask cluster at {address} has no workers. {mend}") from error
    threads: dict[str, int] = client.nthreads()
    if odd := [(worker, n) for worker, n in threads.items() if n != 1]:
        raise ClusterError(
            f"{len(odd)} of {len(threads)} workers of the Dask cluster at {address} have not one thread, the first of "
            f"them {odd[0][0]} with {odd[0][1]}; an episode draws in one thread, and two would share its scenes. {mend}"
        )
    here, mend = _identity(), "Install the same version of gvp_lib there, from the same lock, and start the worker anew"
    for worker, there in client.run(_identity, on_error="return").items():
        if isinstance(there, BaseException):
            raise ClusterError(f"the Dask worker {worker} cannot use gvp_lib: {there!r}. {mend}") from there
        if wrong := [f"{name} {there.get(name)}, here {own}" for name, own in here.items() if there.get(name) != own]:
            raise ClusterError(f"the Dask worker {worker} would compute with other code: {'; '.join(wrong)}. {mend}")


def _identity() -> dict[str, str | None]:
    """Commit and versions, on which this process and every worker must agree."""
    found = {"commit": source_commit()}
    for package in _PACKAGES:
        with suppress(metadata.PackageNotFoundError):  # the library itself, run from its source
            found[package] = metadata.version(package)
    return found


def source_commit() -> str | None:
    """The commit of the source tree, with a "+" where its code differs from it; None outside a checkout of ours."""

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(_SOURCE.parent), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout.strip()

    try:
        if Path(git("rev-parse", "--show-toplevel")).resolve() != _SOURCE.parent:
            return None  # installed somewhere inside another project
        # Code counts, the library's and that of a package in the book; results, pages and a reader's own files do not.
        changed = git("status", "--porcelain", "--", "gvp_lib", "book/*/*.py")
        return git("rev-parse", "HEAD") + ("+" if changed else "")
    except (OSError, subprocess.SubprocessError):
        return None
