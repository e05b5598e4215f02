"""How an experiment's episodes are run and its result stored, whichever experiment it is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gvp_book.results import rounded, write_result
from gvp_lib.errors import GvpError, InvalidParameterError
from gvp_lib.jobs import JobResult, dask_cluster, run_jobs

__all__ = ["EPISODES", "Settings", "cluster", "run_episodes", "store"]

Row = dict[str, Any]

EPISODES = "its first episodes"
"""What is run again of a result, to see whether it still holds."""


@dataclass(frozen=True)
class Settings:
    """How to run an experiment.

    Attributes
    ----------
    starts
        Episodes per case; None for the number that the stored result has.
    workers
        Processes.
    seed
        Of all starts.
    folder
        Where the result goes, as ``NAME.json``, with the journal of a run beside it until it is complete.
    progress
        Whether to show a bar.
    dask
        Address of a Dask scheduler whose workers run the episodes, in place of processes here.
    resnet50
        Whether the thesis's ResNet-50 is among the networks of its tables and figures; it is trained on a GPU.
    """

    starts: int | None = None
    workers: int = 1
    seed: int = 2020
    folder: Path = Path("book/results")
    progress: bool = True
    dask: str | None = None
    resnet50: bool = False

    def __post_init__(self) -> None:
        if self.dask is not None and self.workers > 1:
            raise InvalidParameterError(
                f"episodes run on processes here or on a Dask cluster; got both, workers={self.workers} and "
                f"dask={self.dask!r}. A cluster says itself how many workers it has"
            )

    @property
    def work(self) -> Path:
        """Where data sets and networks are kept, so that another experiment finds them."""
        return self.folder / ".work"


def run_episodes(
    name: str,
    function: Callable[[Mapping[str, Any]], Row],
    jobs: Mapping[str, Row],
    settings: Settings,
    *,
    recipe: Row,
    tell: Callable[[Row], str | None] | None = None,
) -> dict[str, Row]:
    """Run an experiment's episodes; refuse to go on with some that failed.

    Parameters
    ----------
    name
        Of the experiment, and so of the journal, from which an interrupted run goes on.
    function
        One episode: JSON data in, JSON data out.
    jobs
        Episodes by name.
    settings
        Where and how.
    recipe
        JSON data on which all episodes depend; a journal of another one is refused. So is one whose first episode, run
        again, is another: the code has changed.
    tell
        Says from each new episode how it goes, beside the bar.
    """
    settings.folder.mkdir(parents=True, exist_ok=True)
    journal = settings.folder / f".{name}.journal"

    def on_result(key: str, result: JobResult) -> str | None:
        return None if result.failed or tell is None else tell(result.value)

    with cluster(settings) as executor:
        results = run_jobs(
            function, jobs, executor=executor, workers=settings.workers, journal=journal, recipe=recipe,
            recheck=settings.dask is None, on_result=on_result, progress=settings.progress, title=name,
        )  # fmt: skip
    failed = [(key, result.error) for key, result in results.items() if result.failed]
    if failed:
        key, error = failed[0]
        raise GvpError(
            f"{len(failed)} of {len(results)} episodes failed, the first of them {key}:\n{error}\n"
            "The others are kept; the same command tries these again"
        )
    return {key: result.value for key, result in results.items()}


def cluster(settings: Settings) -> AbstractContextManager[Executor | None]:
    """The Dask cluster on which episodes run, whose workers have the same commit of this library; None for here."""
    return nullcontext() if settings.dask is None else dask_cluster(settings.dask)


def store(name: str, settings: Settings, starts: int, content: Row, replayed: str = EPISODES) -> Path:
    """Write a finished experiment's result, for which its journal is no longer needed."""
    path = settings.folder / f"{name}.json"
    command = f"gvp reproduce {name} --starts {starts} --seed {settings.seed}{' --resnet50' * settings.resnet50}"
    write_result(path, name=name, command=command, seeds=settings.seed, replayed=replayed, content=rounded(content, 4))
    (settings.folder / f".{name}.journal").unlink(missing_ok=True)
    return path
