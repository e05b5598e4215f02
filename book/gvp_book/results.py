"""Experiments and their stored results: how episodes are run, and how their numbers are stored.

A result is a JSON file with its command, its seeds, software versions, the commit, the hardware, and what a test runs
again to check that it still holds. It has no date, host, or path: the same run on the same machine writes the same
bytes.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import os
import platform
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import gvp_lib
from gvp_lib.errors import GvpError, InvalidParameterError, ResultError
from gvp_lib.jobs import JobResult, dask_cluster, run_jobs, source_commit, write_file
from gvp_lib.simulation.sensors import Noise

Row = dict[str, Any]

EPISODES = "its first episodes"
"""What is run again of a result, to see whether it still holds."""

OWN = "nothing of it by itself; its command computes it again from the same files"
"""The same of a result on objects of one's own."""

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
    objects: tuple[str, ...] = ()  # files of one's own objects, which the experiment "objects" then is about
    scale: float = 1.0  # m, of a unit of their meshes

    def __post_init__(self) -> None:
        if self.dask is not None and self.workers > 1:
            raise InvalidParameterError(
                f"episodes run on processes here or on a Dask cluster; got both, workers={self.workers} and "
                f"dask={self.dask!r}. A cluster says itself how many workers it has"
            )


@dataclass(frozen=True)
class Experiment:
    """Episodes from random starts, and what a stored result keeps of them."""

    once: Callable[[Mapping[str, Any]], Row]  # one episode: JSON data in, JSON data out
    jobs: Callable[[int, int], dict[str, Row]]  # all episodes by key, for a seed and a number of starts per case
    report: Callable[[Mapping[str, Row]], Row]  # content of the stored result, from the rows under their keys
    starts: int  # per case, unless Settings say otherwise
    status: Callable[[Sequence[Row]], str] | None = None  # a few words beside the bar, from the new rows so far

    def __call__(self, name: str, settings: Settings) -> Path:
        """Run the experiment and store its result; an interrupted run resumes."""
        starts = settings.starts or self.starts
        jobs = self.jobs(settings.seed, starts)
        # The recipe does not depend on how many episodes there are, so that a run may go on with more of them.
        every_kind = json.dumps(self.jobs(settings.seed, _ALL_KINDS)).encode()
        recipe = {"seed": settings.seed, "jobs": hashlib.sha256(every_kind).hexdigest()}
        rows = run_episodes(name, self.once, jobs, settings, recipe=recipe, status=self.status)
        return store(name, settings, starts, self.report(rows), OWN if settings.objects else EPISODES)


def run_episodes(
    name: str,
    once: Callable[[Mapping[str, Any]], Row],
    jobs: Mapping[str, Row],
    settings: Settings,
    *,
    recipe: Row,
    status: Callable[[Sequence[Row]], str] | None = None,
) -> dict[str, Row]:
    """Run an experiment's episodes, by key, and raise if any failed.

    ``once`` and ``status`` are as in :class:`Experiment`; ``name`` is also that of the journal from which an
    interrupted run resumes. ``recipe`` is JSON data on which all episodes depend; a journal with another one is
    refused. So is one whose first episode gives another result when run again, because the code has changed.
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
    """Dask cluster that runs the episodes, with this commit of the library on its workers; None to run them here."""
    return nullcontext() if settings.dask is None else dask_cluster(settings.dask)


def store(name: str, settings: Settings, starts: int, content: Row, replayed: str = EPISODES) -> Path:
    """Write a finished experiment's result and delete its journal."""
    path = settings.folder / f"{name}.json"
    own = "".join(f" --object {Path(each).name}" for each in settings.objects)
    own += f" --scale {settings.scale:g}" * (settings.scale != 1.0)
    command = f"gvp reproduce {'objects' if own else name}{own} --starts {starts} --seed {settings.seed}"
    command += " --resnet50" * settings.resnet50
    write_result(path, name=name, command=command, seeds=settings.seed, replayed=replayed, content=rounded(content, 4))
    _journal(name, settings).unlink(missing_ok=True)
    return path


def _journal(name: str, settings: Settings) -> Path:
    return settings.folder / f".{name}.journal"


def by_case(rows: Mapping[str, Row]) -> dict[str, list[Row]]:
    """Rows with keys ``case/k``, grouped by case, in order."""
    cases: dict[str, list[Row]] = {}
    for key, row in rows.items():
        cases.setdefault(key.rpartition("/")[0], []).append(row)
    return cases


def noise_fields(noise: Noise, **changed: float) -> dict[str, float]:
    """Noise as JSON data, with some fields changed."""
    return {name: float(value) for name, value in {**dataclasses.asdict(noise), **changed}.items() if value}


_FIELDS = ("name", "command", "seeds", "versions", "commit", "hardware", "replayed", "content")


def write_result(
    path: Path | str, *, name: str, command: str, seeds: int | Sequence[int], replayed: str, content: Any
) -> None:
    """Write a result atomically, making its folder if needed: a reader never finds half a file.

    A result has a ``name``, for the reader of the file; the ``command`` that computes it again; every seed that it
    depends on; and what is run again to check that it still holds. The content is JSON data, which may also contain
    dataclasses, arrays, and NumPy numbers. Numbers that are not finite become null, since JSON cannot express them. See
    :func:`rounded`.
    """
    result = {
        "name": name,
        "command": command,
        "seeds": [int(seed) for seed in np.atleast_1d(seeds)],
        "versions": {
            "python": platform.python_version(),
            "gvp_lib": gvp_lib.__version__,
            "opencv": cv2.__version__,  # installed under one of several names
            **{package: metadata.version(package) for package in ("numpy", "scipy", "mujoco", "mink")},
        },
        "commit": source_commit(),
        "hardware": {
            "system": platform.system(),
            "machine": platform.machine(),
            "cores": os.cpu_count(),
            "renderer": None,  # whatever drew the pictures: that the golden episodes know
        },
        "replayed": replayed,
        "content": _plain(content, "content"),
    }
    text = json.dumps(result, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    write_file(path, text.encode())


def read_result(path: Path | str) -> dict[str, Any]:
    """Read a stored result.

    It has ``name``, ``command``, ``seeds``, ``versions``, ``commit``, ``hardware``, ``replayed``, and ``content``.
    Raises ResultError if there is no such file, or it is not a result.
    """
    path = Path(path)
    try:
        result = json.loads(path.read_text("utf-8"))
    except OSError as error:
        there = ", ".join(sorted(file.name for file in path.parent.glob("*.json"))) or "none"
        raise ResultError(f"no result can be read at {path} ({error.strerror}); results beside it: {there}") from error
    except ValueError as error:
        raise ResultError(
            f"{path} is not JSON ({error}); write_result wrote another file, or compute it anew"
        ) from error
    missing = [field for field in _FIELDS if not isinstance(result, dict) or field not in result]
    if missing:
        raise ResultError(f"{path} is not a result of write_result: it has no {', '.join(missing)}")
    return result


def rounded(data: Any, digits: int) -> Any:
    """JSON data with every float rounded to that many significant digits, 1 or more.

    Accepts whatever :func:`write_result` accepts.

    Examples
    --------
    >>> rounded({"mean": 12.3456, "n": 1234567, "all": [0.00123456]}, 3)
    {'mean': 12.3, 'n': 1234567, 'all': [0.00123]}
    """
    return _plain(data, "data", digits)


def _plain(data: Any, place: str, digits: int | None = None) -> Any:
    """The same in dictionaries, lists, strings, numbers, booleans and None alone."""
    if dataclasses.is_dataclass(data) and not isinstance(data, type):
        data = {field.name: getattr(data, field.name) for field in dataclasses.fields(data)}
    if isinstance(data, np.ndarray | np.generic):
        data = data.tolist()
    if isinstance(data, Mapping):
        if odd := [key for key in data if not isinstance(key, str)]:
            raise InvalidParameterError(f"names in a result are strings; {place} has {odd[0]!r}. Write str(...)")
        return {key: _plain(value, f"{place}.{key}", digits) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_plain(value, f"{place}[{i}]", digits) for i, value in enumerate(data)]
    if isinstance(data, float):
        number = float(data) if digits is None else float(f"{data:.{digits}g}")
        return number if math.isfinite(number) else None
    if data is None or isinstance(data, str | bool | int):
        return data
    raise InvalidParameterError(
        f"a result holds dictionaries, lists, text, numbers, arrays and dataclasses; {place} is a {type(data).__name__}"
    )
