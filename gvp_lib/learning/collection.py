"""Collect a set of labeled viewpoints: fast, resumable, the same whoever collects it. Thesis 2.4.2, 3.2.

The set is cut into shards, each a job of its own that depends on the recipe alone. A shard that comes back is written
whole, then noted with its checksum in a journal; so whatever ends a run costs at most the shards in the making.
"""

from __future__ import annotations

import base64
import json
import os
from collections import Counter
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

import gvp_lib
from gvp_lib.errors import DatasetError, WorkerDiedError
from gvp_lib.jobs import JobResult, run_jobs
from gvp_lib.journal import Journal
from gvp_lib.learning.collector import collect_shard
from gvp_lib.learning.recipe import CollectionRecipe
from gvp_lib.learning.sampling import viewpoints
from gvp_lib.learning.shards import CARD, COLUMNS, damage, read_card, shard_name, write_file, writing
from gvp_lib.planning.learned import Action

__all__ = ["Collection", "collect_dataset"]

_JOURNAL = ".collection.journal"
_PACKAGES = ("numpy", "scipy", "mujoco", "mink", "opencv-python-headless", "pyarrow")
_LICENSE = "cc0-1.0"


@dataclass(frozen=True)
class Collection:
    """What :func:`collect_dataset` did.

    Attributes
    ----------
    folder
        Of the set.
    card
        What stands in its ``card.json``.
    collected
        Samples collected in this run; the others were there already.
    damaged
        Names of shards that were there, but not as their checksums say, and were collected again.
    """

    folder: Path
    card: dict[str, Any]
    collected: int
    damaged: tuple[str, ...]


def collect_dataset(
    folder: Path | str,
    recipe: CollectionRecipe | None = None,
    *,
    workers: int = 1,
    executor: Executor | None = None,
    progress: bool = True,
) -> Collection:
    """Collect a set of viewpoints into a folder, or what of it is not there yet.

    The same recipe gives the same files, to the last byte, whatever the number of workers and however often it was
    interrupted, as long as the same versions collect it, and the same renderer draws: one graphics card's picture is
    not another's to the last bit.

    Parameters
    ----------
    folder
        Made if need be. A set that is finished is checked, and what is damaged is collected again.
    recipe
        What to collect; by default the thesis's "Uniform" set of 4096 (3.2).
    workers
        Processes on this machine; with an executor, how many jobs it works on at once.
    executor
        Where to run instead, as in :func:`gvp_lib.jobs.run_jobs`.
    progress
        Whether to show a bar, with pictures per second and the time that is left.

    Raises
    ------
    DatasetError
        The folder holds a set of another recipe or of other versions, or something else; it cannot be written; or the
        arm cannot take up enough viewpoints. Nothing that was collected is lost.
    JournalError
        Another run is collecting into it.

    Examples
    --------
    >>> import tempfile
    >>> recipe = CollectionRecipe(arm="floating", n=16, seed=1)
    >>> done = collect_dataset(tempfile.mkdtemp(), recipe, progress=False)
    >>> done.collected, len(done.card["shards"])
    (16, 1)
    """
    recipe = recipe or CollectionRecipe()
    folder = Path(folder)
    told = {"recipe": recipe.to_dict(), "versions": _versions()}
    jobs = dict(_jobs(recipe))
    _claim(folder, told)
    with ExitStack() as stack:
        with writing(folder / _JOURNAL):
            journal = stack.enter_context(Journal(folder / _JOURNAL, told))
            known = _known(folder, journal)
        damaged = damage(folder, {name: entry["sha256"] for name, entry in known.items()})
        finished = {name: entry for name, entry in known.items() if name not in damaged}
        todo = {name: job for name, job in jobs.items() if name not in finished}
        bar = tqdm(total=recipe.n, initial=_samples(finished), desc=folder.name, unit="image", disable=not progress)

        def keep(name: str, result: JobResult) -> None:
            if result.failed:
                return
            entry = {key: result.value[key] for key in ("sha256", "counts")}
            write_file(folder / name, base64.b64decode(result.value["parquet"]))
            with writing(folder / _JOURNAL):
                journal.append([(name, json.dumps(entry))])
            finished[name] = entry
            bar.update(entry["counts"]["samples"])

        with bar:
            try:
                results = run_jobs(
                    collect_shard, todo, executor=executor, workers=workers, on_result=keep, keep=False, progress=False
                )
            except WorkerDiedError as death:
                raise WorkerDiedError(_obituary(folder, _samples(finished), recipe.n)) from death
        _refuse_failures(results)
        card = {**_card(recipe, told), **_summary({name: finished[name] for name in jobs})}
        write_file(folder / "README.md", _readme(card).encode())
        write_file(folder / CARD, (json.dumps(card, indent=1) + "\n").encode())
        with writing(folder / _JOURNAL):
            (folder / _JOURNAL).unlink(missing_ok=True)
    return Collection(folder, card, sum(len(jobs[name]["viewpoints"]) for name in todo), tuple(damaged))


def _jobs(recipe: CollectionRecipe) -> Iterator[tuple[str, dict[str, Any]]]:
    """Each shard's file, and how it is made: no shard has samples of two scenes."""
    cuts = [range(0, n, recipe.shard) for n in recipe.per_scene]
    count, number, first = sum(map(len, cuts)), 0, 0
    for scene, starts in enumerate(cuts):
        asked = viewpoints(recipe, scene)
        for start in starts:
            part = asked[start : start + recipe.shard]
            job = {"recipe": recipe, "scene": scene, "first": first, "viewpoints": part}
            yield shard_name(number, count), job
            number, first = number + 1, first + len(part)


def _claim(folder: Path, told: Mapping[str, Any]) -> None:
    """Refuse a folder that holds something else."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        there = {path.name for path in folder.iterdir()}
    except OSError as error:
        raise DatasetError(f"cannot use {folder} as a folder: {error.strerror or error}; give another") from error
    if not os.access(folder, os.W_OK):
        raise DatasetError(f"{folder} may not be written; give a folder that may")
    if CARD in there:
        _compare(read_card(folder), told, f"{folder} holds a set")
    elif _JOURNAL in there:
        with writing(folder / _JOURNAL):
            header = (folder / _JOURNAL).read_bytes().partition(b"\n")
        if header[1]:  # else it was killed while it wrote its first line
            theirs = None
            with suppress(ValueError, KeyError, TypeError):  # no journal: its own reader says so
                theirs = json.loads(header[0])["recipe"]
            if isinstance(theirs, Mapping) and told.keys() == theirs.keys():
                _compare(theirs, told, f"{folder} holds an unfinished set")
    elif there:
        raise DatasetError(
            f"{folder} is no set of viewpoints, and not empty: it holds {', '.join(sorted(there)[:3])}. Give another "
            "folder"
        )


def _compare(theirs: Mapping[str, Any], ours: Mapping[str, Any], what: str) -> None:
    for part, kind, advice in (
        ("recipe", "of another recipe", "Give another folder"),
        ("versions", "collected by other versions", "Install those, or give another folder"),
    ):
        if theirs[part] != ours[part]:
            raise DatasetError(f"{what} {kind}: {_difference(theirs[part], ours[part])}. {advice}, or delete this one")


def _difference(theirs: Mapping[str, Any], ours: Mapping[str, Any]) -> str:
    names = [name for name in {**theirs, **ours} if theirs.get(name) != ours.get(name)]
    return "; ".join(f"{name} is {theirs.get(name)} there and {ours.get(name)} here" for name in names)


def _known(folder: Path, journal: Journal) -> dict[str, Any]:
    """What is noted of shards: by the card of a finished set, and by the journal."""
    noted = journal.read()
    if not (folder / CARD).exists():
        return noted
    card = read_card(folder)
    shards = zip(card["shards"].items(), card["counts_of_shards"], strict=True)
    return {name: {"sha256": digest, "counts": counts} for (name, digest), counts in shards} | noted


def _samples(finished: Mapping[str, Any]) -> int:
    return sum(entry["counts"]["samples"] for entry in finished.values())


def _obituary(folder: Path, samples: int, n: int) -> str:
    return (
        f"a worker died, or its cluster is gone, with {samples} of {n} samples collected. They are kept in {folder}, "
        "and the same command goes on from there. Common causes: memory ran out (take fewer workers), or the script "
        "that started the run does so outside `if __name__ == '__main__':`"
    )


def _refuse_failures(results: Mapping[str, JobResult]) -> None:
    failed = [(name, result.error) for name, result in results.items() if result.failed]
    if failed:
        name, error = failed[0]
        raise DatasetError(
            f"{len(failed)} shards could not be collected, the first of them {name}:\n"
            f"{error.strip().splitlines()[-1]}\nThe others are kept. In full:\n{error}"
        )


def _versions() -> dict[str, str]:
    return {"gvp_lib": gvp_lib.__version__} | {name: metadata.version(name) for name in _PACKAGES}


def _card(recipe: CollectionRecipe, told: Mapping[str, Any]) -> dict[str, Any]:
    given = told["recipe"]
    return {
        "title": f"{recipe.n} labeled viewpoints of {given['target']} ({recipe.placement}), {recipe.sampling}",
        "what": "Pictures from a camera in a simulated arm's hand on a virtual sphere about an object, each labeled "
        "with the step over the sphere that brings the camera nearest to the object's normal.",
        "source": "gvp_lib, after Smith, Grasp Viewpoint Planning Methods for Low-cost Robotic Manipulators (2020), "
        "2.4.2",
        "license": _LICENSE,
        **told,
        "columns": dict(COLUMNS),
        "actions": [action.name for action in Action],
    }


def _summary(shards: Mapping[str, Any]) -> dict[str, Any]:
    counts = [entry["counts"] for entry in shards.values()]
    refused: Counter[str] = Counter()
    actions: Counter[str] = Counter()
    for entry in counts:
        refused.update(entry["refused"])
        actions.update({Action(int(name)).name: number for name, number in entry["actions"].items()})
    total = {name: sum(entry[name] for entry in counts) for name in ("samples", "frames", "overflow", "replaced")}
    return {
        "counts": {
            **total,
            "arm_seconds": float(np.round(sum(entry["arm_seconds"] for entry in counts), 3)),
            "refused": dict(sorted(refused.items())),
            "actions": {action.name: actions[action.name] for action in Action},
        },
        "shards": {name: entry["sha256"] for name, entry in shards.items()},
        "counts_of_shards": counts,
    }


def _readme(card: Mapping[str, Any]) -> str:
    """The front matter by which Hugging Face's `datasets` finds the shards, and a page for people."""
    columns = "\n".join(f"| `{name}` | {what} |" for name, what in card["columns"].items())
    return f"""---
license: {card["license"]}
configs:
- config_name: default
  data_files: data/*.parquet
---

# {card["title"]}

{card["what"]}

Source: {card["source"]}. The recipe, counts, versions and checksums are in `{CARD}`.

| column | what it is |
|---|---|
{columns}
"""
