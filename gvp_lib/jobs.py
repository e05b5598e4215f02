"""Run many jobs on one core, all cores or a cluster; a run may be stopped at any time and resumed.

A job is a named, picklable argument; its result is JSON data. Each result is written to a journal on disk as soon as it
is known, so whatever ends a run (Ctrl-C, a power cut, full memory) costs at most the jobs under way.
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
from reprlib import repr as brief
from textwrap import shorten
from typing import TYPE_CHECKING, Any, BinaryIO

from tqdm import tqdm

from gvp_lib.checks import checked
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
    """Result of one job.

    Attributes
    ----------
    value
        Return value of the function; None for a failed job. :func:`run_jobs` passes it through JSON: tuples become
        lists and keys strings, while floats stay exact.
    error
        Traceback of a failed job; empty otherwise.
    """

    value: Any
    error: str = ""

    def __repr__(self) -> str:
        text = f"failed: {self.error.strip().splitlines()[-1]}" if self.failed else brief(self.value)
        return f"JobResult({shorten(text, 140, placeholder=' ...')})"

    @property
    def failed(self) -> bool:
        """Whether the function raised an error, or its value could not be sent back."""
        return bool(self.error)


@checked
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
    """Call a function once for each job.

    A job must depend on its argument alone (give it its own seed). Then the results depend neither on the executor nor
    on how often the run was stopped.

    Parameters
    ----------
    function
        Function of a job's argument that returns JSON data. It must be importable, unless it runs in this process.
    jobs
        Arguments by key; the key names the job in the journal.
    executor
        Pool or cluster (:func:`dask_cluster`) to run on; it stays open. None: this process, or with ``workers > 1`` a
        pool of that many spawned processes (a fork would share the parent's graphics context).
    workers
        Number of processes on this machine; ignored with an executor.
    journal
        File of finished jobs, from which a later run resumes. None: nothing is stored.
    recipe
        JSON data on which the results depend besides the keys, such as settings that all jobs share: a journal of
        another recipe is refused. Required with a journal.
    recheck
        Whether to run the journal's first job again, and to refuse to resume if its result differs in a single bit.
    on_result
        Function called in this process with each new key and result. Text that it returns is shown beside the progress
        bar.
    progress
        Whether to show a progress bar.
    title
        Text before the bar.

    Returns
    -------
    dict[str, JobResult]
        Results by key, in the order of ``jobs``. Failed jobs are included, but not stored in the journal: a later run
        retries them.

    Raises
    ------
    InvalidParameterError
        A key is not a string, ``workers`` is below 1, a journal has no recipe, or a pool cannot import the function.
    JournalError
        The journal is of another recipe, in use by another run, damaged, not a journal, or cannot be written; or its
        first job, run again, has another result.
    WorkerDiedError
        A process of the pool died, or the cluster is gone. Finished jobs are in the journal.

    Examples
    --------
    >>> run_jobs(abs, {"a": -1, "b": "x"}, progress=False)
    {'a': JobResult(1), 'b': JobResult(failed: TypeError: bad operand type for abs(): 'str')}
    """
    if odd := [key for key in jobs if not isinstance(key, str)]:
        raise InvalidParameterError(f"a job's key is a string, which names it in the journal; got {odd[0]!r}")
    if journal is not None and recipe is None:
        raise InvalidParameterError(
            "a journal needs a recipe: JSON data that says what its results depend on, such as the settings that all "
            "jobs share, so that results of other settings are never mixed in"
        )
    _check_workers(workers)
    with nullcontext() if journal is None else closing(_Journal(journal, recipe)) as log:
        results = {key: JobResult(value) for key, value in (log.finished if log else {}).items() if key in jobs}
        checked = list(results)[: int(recheck)]  # submitted first; with several workers others may come before it
        todo = {key: jobs[key] for key in [*checked, *jobs] if key not in results or key in checked}
        failures = 0
        with (
            tqdm(total=len(jobs), initial=len(results), desc=title, unit="job", disable=not progress) as bar,
            closing(finished_jobs(partial(_as_json, function), todo, executor=executor, workers=workers)) as finished,
        ):
            try:
                for key, sent in finished:
                    result = sent if sent.failed else JobResult(json.loads(sent.value))
                    if log and key in checked:
                        log.compare(key, result)
                        continue
                    if log and not result.failed:
                        log.append(key, sent.value)
                    results[key] = result
                    failures += result.failed
                    message = on_result(key, result) if on_result else None
                    bar.set_postfix_str(", ".join(filter(None, [message, f"{failures} failed" * bool(failures)])))
                    bar.update()
            except WorkerDiedError as death:
                hint = "They are lost; with journal=Path(...) another run would resume from there"
                if journal is not None:
                    hint = f"They are in {journal}: run the same again, and it resumes from there"
                done = len(results) - failures
                raise WorkerDiedError(f"{death}. {done} of {len(jobs)} jobs are done. {hint}") from death
    return {key: results[key] for key in jobs}


@checked
def finished_jobs(
    function: Callable[[Any], Any], jobs: Mapping[str, Any], *, executor: Executor | None = None, workers: int = 1
) -> Generator[tuple[str, JobResult], None, None]:
    """Call a function once for each job, and yield each result as soon as it is there.

    Nothing is stored. Closing the iterator cancels the jobs that have not started.

    Parameters
    ----------
    function
        Function of a job's argument. Its value may be anything that can be pickled, such as bytes.
    jobs, executor, workers
        As in :func:`run_jobs`.

    Yields
    ------
    tuple[str, JobResult]
        Key and result of a job, in the order in which jobs finish.

    Raises
    ------
    InvalidParameterError
        ``workers`` is below 1, or a pool cannot import the function.
    WorkerDiedError
        A process of the pool died, or the cluster is gone; raised after the results that did come back.

    Examples
    --------
    >>> list(finished_jobs(abs, {"a": -1}))
    [('a', JobResult(1))]
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
    pool = executor or ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _initialize_worker)
    futures: dict[Future[JobResult], str] = {}
    death: Exception | None = None
    try:
        try:
            for key, argument in jobs.items():
                futures[pool.submit(_call, function, argument)] = key
            for future in as_completed(list(futures)):
                yield futures.pop(future), _result(future)
        except (BrokenExecutor, CancelledError) as error:
            death = error
        for future in [each for each in futures if each.done()]:  # of the others some may never come
            with suppress(BrokenExecutor, CancelledError):
                yield futures.pop(future), _result(future)
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


def _result(future: Future[JobResult]) -> JobResult:
    """Result of a finished job; raises if its pool died."""
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


def _initialize_worker() -> None:
    """Make a process of the pool render in one thread, which leaves the other cores to the others, and exit with its
    parent: otherwise it would wait for work forever once that is killed."""
    os.environ.setdefault("LP_NUM_THREADS", "1")  # of software rendering
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


# --- on disk ----------------------------------------------------------------------------------------------------------


class _Journal:
    """Locked file of finished jobs: a line with the recipe, then one JSON line per job.

    Attributes
    ----------
    finished
        Values by key, as they were in the file when it was opened.
    """

    def __init__(self, path: Path, recipe: Any) -> None:
        self._path = Path(path)
        try:
            self._header = json.dumps({"journal": 1, "recipe": recipe}, sort_keys=True).encode() + b"\n"
        except (TypeError, ValueError) as error:
            raise InvalidParameterError(f"a journal's recipe is JSON data; got {brief(recipe)}: {error}") from error
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
        """Store a finished job and the JSON text of its value; it is on disk when this returns."""
        self._write(f'{{"key": {json.dumps(key)}, "value": {text}}}\n'.encode())

    def compare(self, key: str, result: JobResult) -> None:
        """Refuse to resume if a job, run again, has another result than in the file."""
        was, now = json.dumps(self.finished[key]), json.dumps(result.value)
        if result.failed or now != was:
            raise JournalError(
                f"{self._path} was written by other code: its job {key}, run again, "
                + (f"fails:\n{result.error}" if result.failed else f"has the result\n  {now}\nwhere it had\n  {was}")
                + "\nResume with the code that wrote it, or delete the file to start over"
            )

    def _read(self) -> dict[str, Any]:
        """Read the finished values. An incomplete last line is removed from the file, and its job runs again."""
        self._file.seek(0)
        whole, newline, incomplete = self._file.read().rpartition(b"\n")
        if not newline and self._header.startswith(incomplete):  # new, or killed at its first write
            self._file.truncate(0)
            self._write(self._header)
            return {}
        header, *lines = whole.split(b"\n")
        if not header.startswith(b'{"journal": '):
            raise JournalError(f"{self._path} is not a journal of jobs, and is left as it is; take another path")
        if header + b"\n" != self._header:
            raise JournalError(
                f"{self._path} is the journal of another recipe: it begins with\n  {header.decode(errors='replace')}\n"
                f"and this run's with\n  {self._header.decode()}Take another path, or delete the file to start over"
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
    """Context in which an OSError is raised as an error of this library that says what would work.

    Parameters
    ----------
    path
        File or folder that is written, for the message.
    kind
        Class of the error to raise.

    Examples
    --------
    >>> with disk_errors(".", JournalError):
    ...     open(".", "wb")
    Traceback (most recent call last):
        ...
    gvp_lib.errors.JournalError: cannot write .: Is a directory...
    """
    try:
        yield
    except BlockingIOError as error:
        raise kind(f"{path} is in use by another run; wait for it, or give another path") from error
    except OSError as error:
        raise kind(
            f"cannot write {path}: {error.strerror or error}. What was there before is kept; make room, or give a path "
            "that may be written"
        ) from error


@checked
def write_file(path: Path | str, data: bytes) -> None:
    """Write a file atomically: a reader never finds half of it.

    Only one process may write it at a time. A draft left by a killed process is overwritten by the next.

    Parameters
    ----------
    path
        File to write; its folder is created if missing.
    data
        Content of the file.

    Raises
    ------
    OSError
        The file cannot be written; its previous content is kept.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     write_file(f"{folder}/new/data", b"content")
    ...     Path(folder, "new", "data").read_bytes()
    b'content'
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
    """Open a file to read and append, and lock it until it is closed or the process ends.

    Parameters
    ----------
    path
        File to open; it and its folder are created if missing.

    Raises
    ------
    BlockingIOError
        Another process holds the lock.
    OSError
        The file cannot be opened for writing.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    file = open(path, "a+b")  # noqa: SIM115 - the caller closes it
    try:
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:  # which kind depends on the file system
        file.close()
        raise BlockingIOError(error.errno, error.strerror, str(path)) from error
    return file


# --- a cluster --------------------------------------------------------------------------------------------------------

_PACKAGES = ("gvp_lib", "numpy", "scipy", "opencv-python-headless", "mujoco", "mink")
"""Packages on whose versions a result depends."""
_SOURCE = Path(__file__).resolve().parent


@checked
@contextmanager
def dask_cluster(address: str, *, timeout: float = 5.0) -> Iterator[Executor]:
    """Context that provides a Dask cluster as an executor; the cluster stays open.

    Parameters
    ----------
    address
        Address that the scheduler prints, such as ``"tcp://host:8786"``.
    timeout
        Time to wait for the scheduler's answer and for a first worker, s.

    Yields
    ------
    Executor
        Executor for :func:`run_jobs`.

    Raises
    ------
    MissingExtraError
        Dask is not installed.
    ClusterError
        No scheduler answers at the address, or the cluster has no workers, or some with several threads or with other
        versions.

    Notes
    -----
    An episode renders with an OpenGL context, which belongs to one thread, and caches its scenes without locks. So
    every worker runs one job at a time, in one thread; a machine with n cores gets n workers::

        dask scheduler
        dask worker --nthreads 1 --nworkers 8 tcp://scheduler:8786

    and then, in Python::

        with dask_cluster("tcp://scheduler:8786") as executor:
            results = run_jobs(function, jobs, executor=executor)

    A job whose worker died is given to another. After four deaths in a row it counts as failed, and so may a job that
    waited beside it each time (Dask's ``allowed-failures``); a later run retries both. With no worker left, a run waits
    for a new one. Workers must have this process's versions of the library and of what it computes with, and the same
    commit of its source; those that join later are not checked.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise MissingExtraError("a Dask cluster", error.name or "distributed", "cluster") from error
    if not 0 < timeout <= 86400:
        raise InvalidParameterError(f"timeout is a time in s, positive and at most a day; got {timeout}")
    if not address:  # Dask would start a cluster of its own
        raise ClusterError("a Dask scheduler's address is like tcp://host:8786; got an empty one")
    try:
        client = Client(address, timeout=timeout, set_as_default=False)
    except (OSError, ValueError, OverflowError, ImportError) as error:
        raise ClusterError(
            f"no Dask scheduler answers at {address!r} ({error}). Give the address that the scheduler prints, like "
            "tcp://host:8786; `dask scheduler` starts one, and a firewall in between may need an open port"
        ) from error
    with client:
        _check_cluster(client, address, timeout)
        # By default (pure) Dask does not run a call again that it has seen before.
        yield client.get_executor(pure=False)


def _check_cluster(client: Client, address: str, timeout: float) -> None:
    fix = f"Start them by `dask worker --nthreads 1 --nworkers N {address}`, with N the machine's cores"
    try:
        client.wait_for_workers(1, timeout)
    except TimeoutError as error:
        raise ClusterError(f"the Dask cluster at {address} has no workers. {fix}") from error
    threads: dict[str, int] = client.nthreads()
    if odd := [(worker, n) for worker, n in threads.items() if n != 1]:
        raise ClusterError(
            f"{len(odd)} of {len(threads)} workers of the Dask cluster at {address} do not have one thread each, such "
            f"as {odd[0][0]} with {odd[0][1]}; an episode renders in one thread, and two would share its scenes. {fix}"
        )
    here, fix = _versions(), "Install the same version of gvp_lib there, from the same lock, and restart the worker"
    for worker, there in client.run(_versions, on_error="return").items():
        if isinstance(there, BaseException):
            raise ClusterError(f"the Dask worker {worker} cannot use gvp_lib: {there!r}. {fix}") from there
        if wrong := [f"{name} {there.get(name)}, here {own}" for name, own in here.items() if there.get(name) != own]:
            raise ClusterError(f"the Dask worker {worker} would compute with other code: {'; '.join(wrong)}. {fix}")


def _versions() -> dict[str, str | None]:
    """Commit and versions, on which this process and every worker must agree."""
    found = {"commit": source_commit()}
    for package in _PACKAGES:
        with suppress(metadata.PackageNotFoundError):  # the library itself, run from its source
            found[package] = metadata.version(package)
    return found


@checked
def source_commit() -> str | None:
    """Commit of the source tree, with "+" if the code differs from it; None outside a checkout of this project.

    Examples
    --------
    >>> commit = source_commit()
    >>> commit is None or len(commit.rstrip("+")) == 40
    True
    """

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
