"""Where jobs run that one machine is too small for: a Dask cluster, by the address of its scheduler.

An episode draws with an OpenGL context, which belongs to one thread, and keeps its scenes in caches that no lock
guards. So every worker runs one job at a time, in one thread; a machine of n cores gets n workers::

    dask scheduler
    dask worker --nthreads 1 --nworkers 8 tcp://scheduler:8786
"""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

from gvp_lib.errors import ClusterError, MissingExtraError

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["Place", "dask_cluster", "source_commit"]

_PACKAGES = ("gvp_lib", "numpy", "scipy", "opencv-python-headless", "mujoco", "mink")
"""A result depends on their versions."""
_SOURCE = Path(__file__).resolve().parent


@dataclass(frozen=True, slots=True)
class Place:
    """Where :func:`gvp_lib.jobs.run_jobs` is to run: the arguments of the same names.

    Attributes
    ----------
    executor
        None: in this process, or on a pool of ``workers`` processes.
    workers
        How many jobs it works on at once.
    """

    executor: Executor | None = None
    workers: int = 1


@contextmanager
def dask_cluster(address: str, *, timeout: float = 5.0) -> Iterator[Place]:
    """A context in which a Dask cluster is open to jobs; the cluster itself goes on.

    A job whose worker died is given to another one; when four in turn have died of it, it has failed (Dask's
    ``allowed-failures``). While there is no worker left, a run waits for a new one. A worker that dies within a moment
    of its start is not always started again by Dask: a job that ends its process at once may cost four for good.
    Workers that join later are welcome; they are not examined. The others must have this process's versions of the
    library and of what it computes with, and the same commit of its source.

    Parameters
    ----------
    address
        Of the scheduler, as it prints it: ``"tcp://host:8786"``.
    timeout
        How long the scheduler has to answer, and a first worker to be there, s.

    Raises
    ------
    MissingExtraError
        Dask is not installed.
    ClusterError
        Nobody answers at the address, it has no workers, or workers of several threads or of other versions.
    """
    client = _connect(address, timeout)
    try:
        workers = _threads(client, address, timeout)
        _compare(client)
        # Dask takes a call that it has seen before for done, unless told that it is not pure.
        yield Place(client.get_executor(pure=False), sum(workers.values()))
    finally:
        client.close()


def _connect(address: str, timeout: float) -> Client:
    try:
        from distributed import Client
    except ImportError as error:
        raise MissingExtraError("a Dask cluster", error.name or "distributed", "cluster") from error
    if not address:  # Dask would start a cluster of its own
        raise ClusterError("a Dask scheduler's address is like tcp://host:8786; got an empty one")
    try:
        return Client(address, timeout=timeout, set_as_default=False)
    except (OSError, ValueError, OverflowError, ImportError) as error:
        raise ClusterError(
            f"no Dask scheduler answers at {address!r} ({error}). Expected is the address that one prints, like "
            "tcp://host:8786; `dask scheduler` starts one, and a firewall between may need a port opened"
        ) from error


def _threads(client: Client, address: str, timeout: float) -> dict[str, int]:
    """Threads of each worker, by its address; all of them 1."""
    mend = f"Start them by `dask worker --nthreads 1 --nworkers N {address}`, with N the machine's cores"
    try:
        client.wait_for_workers(1, timeout)
    except TimeoutError as error:
        raise ClusterError(f"the Dask cluster at {address} has no workers. {mend}") from error
    threads: dict[str, int] = client.nthreads()
    if odd := {worker: n for worker, n in threads.items() if n != 1}:
        worker, n = next(iter(odd.items()))
        raise ClusterError(
            f"{len(odd)} of {len(threads)} workers of the Dask cluster at {address} have not one thread, the first of "
            f"them {worker} with {n}; an episode draws in one thread, and two would share its scenes. {mend}"
        )
    return threads


def _identity() -> dict[str, str | None]:
    """What this process and every worker must agree on, by name."""
    found: dict[str, str | None] = {"commit": source_commit()}
    for package in _PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = None
    return found


def source_commit() -> str | None:
    """The commit of the source tree, with a "+" where its code differs from it; None outside a checkout of ours."""

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(_SOURCE.parent), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout.strip()

    try:
        if Path(git("rev-parse", "--show-toplevel")).resolve() != _SOURCE.parent:
            return None  # installed somewhere inside another project
        # The packages alone: results that are about to be committed do not count.
        changed = git("status", "--porcelain", "--", "gvp_lib", "book/gvp_book")
        return git("rev-parse", "HEAD") + ("+" if changed else "")
    except (OSError, subprocess.SubprocessError):
        return None


def _compare(client: Client) -> None:
    here = _identity()
    for worker, there in client.run(_identity, on_error="return").items():
        mend = "Install the same version of gvp_lib there, from the same lock, and start the worker anew"
        if isinstance(there, BaseException):
            raise ClusterError(f"the Dask worker {worker} cannot use gvp_lib: {there!r}. {mend}") from there
        if wrong := [f"{name} {there[name]}, here {here[name]}" for name in here if there.get(name) != here[name]]:
            raise ClusterError(f"the Dask worker {worker} would compute with other code: {'; '.join(wrong)}. {mend}")
