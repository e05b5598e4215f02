"""An experiment: its episodes, how they are run, and the result that is stored of them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gvp_book.results import rounded, write_result
from gvp_lib.errors import GvpError, InvalidParameterError
from gvp_lib.jobs import JobResult, dask_cluster, run_jobs
from gvp_lib.simulation.sensors import Noise

__all__ = ["EPISODES", "Experiment", "Row", "Settings", "by_case", "cluster", "noise_fields", "run_episodes", "store"]

Row = dict[str, Any]

EPISODES = "its first episodes"
"""What is run again of a result, to see whether it still holds."""

_ALL_KINDS = 100  # starts, among which are jobs of every kind


@dataclass(frozen=True)
class Settings:
    """How to run an experiment."""

    starts: int | None = None  # episodes per case; None for the number that the stored result has
    workers: int = 1  # processes
    seed: int = 2020  # of all starts
    folder: Path = Path("book/results")  # for NAME.json, with the journal of a run beside it until it is complete
    progress: bool = True  # whether to show a bar
    dask: str | None = None  # address of a scheduler whose workers run the episodes, in place of processes here
    resnet50: bool = False  # whether the thesis's ResNet-50 is trained too, on a GPU, for its tables and figures

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


@dataclass(frozen=True)
class Experiment:
    """Episodes from random starts, and what is stored of them."""

    once: Callable[[Mapping[str, Any]], Row]  # one episode: JSON data in, JSON data out
    jobs: Callable[[int, int], dict[str, Row]]  # all episodes by key, for a seed and a number of starts per case
    report: Callable[[Mapping[str, Row]], Row]  # content of the stored result, from the rows under their keys
    starts: int  # per case, unless Settings say otherwise
    status: Callable[[Sequence[Row]], str] | None = None  # a few words beside the bar, from the new rows so far

    def __call__(self, name: str, settings: Settings) -> Path:
        """Run the experiment and store its result; a run that was interrupted goes on."""
        starts = settings.starts or self.starts
        jobs = self.jobs(settings.seed, starts)
        # The recipe does not depend on how many episodes there are, so that a run may go on with more of them.
        every_kind = json.dumps(self.jobs(settings.seed, _ALL_KINDS)).encode()
        recipe = {"seed": settings.seed, "jobs": hashlib.sha256(every_kind).hexdigest()}
        rows = run_episodes(name, self.once, jobs, settings, recipe=recipe, status=self.status)
        return store(name, settings, starts, self.report(rows))


def run_episodes(
    name: str,
    once: Callable[[Mapping[str, Any]], Row],
    jobs: Mapping[str, Row],
    settings: Settings,
    *,
    recipe: Row,
    status: Callable[[Sequence[Row]], str] | None = None,
) -> dict[str, Row]:
    """Run an experiment's episodes; refuse to go on with some that failed.

    Parameters
    ----------
    name
        Name of the experiment, and so of the journal from which an interrupted run goes on.
    once, status
        As in :class:`Experiment`.
    jobs
        Episodes by key.
    settings
        Where and how.
    recipe
        JSON data on which all episodes depend; a journal of another one is refused. So is one whose first episode, run
        again, is another: the code has changed.
    """
    settings.folder.mkdir(parents=True, exist_ok=True)
    new: list[Row] = []

    def on_result(key: str, result: JobResult) -> str | None:
        if result.failed or status is None:
            return None
        new.append(result.value)
        return status(new)

    with cluster(settings) as executor:
        results = run_jobs(
            once, jobs, executor=executor, workers=settings.workers, journal=_journal(name, settings), recipe=recipe,
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
    _journal(name, settings).unlink(missing_ok=True)
    return path


def _journal(name: str, settings: Settings) -> Path:
    return settings.folder / f".{name}.journal"


def by_case(rows: Mapping[str, Row]) -> dict[str, list[Row]]:
    """Rows under keys ``case/k``, case by case, in their order."""
    cases: dict[str, list[Row]] = {}
    for key, row in rows.items():
        cases.setdefault(key.rpartition("/")[0], []).append(row)
    return cases


def noise_fields(noise: Noise, **changed: float) -> dict[str, float]:
    """A noise as JSON data, with some fields changed."""
    fields = {name: float(getattr(noise, name)) for name in Noise.__dataclass_fields__}
    return {name: value for name, value in {**fields, **changed}.items() if value}
