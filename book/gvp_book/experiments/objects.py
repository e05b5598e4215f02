"""The experiment on things that nobody designed a planner for: from a start, by a planner, to a thing in the hand.

Episodes are those of Table 3.2, on the things of :mod:`gvp_book.experiments.things`, alone and among three neighbors of
other colors, under the thesis's noise; but a hand that holds nothing may try once more. Your own thing joins by the
path of its mesh or of its MJCF.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from gvp_book.experiments.grasping import by_method, columns, grasp_in, placeable, tally, trials
from gvp_book.experiments.things import NOT_CONVEX, PLACED, THINGS, encounters
from gvp_book.results import Experiment, Row, noise_fields
from gvp_lib.errors import InvalidParameterError
from gvp_lib.evaluation.statistics import paired_difference
from gvp_lib.simulation.objects import ObjectSpec
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.workcell import CellCache, WorkCell

METHODS = ("thesis", "moments", "ours", "look_down", "oracle")
"""The thesis's planner and grasp; version 0.1's on the same views; ours; straight down, closing as ours; who knows."""

ATTEMPTS = 2
"""How often ours, straight down, and who knows may try: a hand feels that it holds nothing, and looks anew."""

ON_ARCS, FEW = ("thesis", "moments"), 4
"""Those that take the thesis's arcs, a hundred pictures each, and how many starts of each case they have: one a
placement."""

SEED = 2627
"""Of all starts, as they were chosen."""


# --- the episodes -----------------------------------------------------------------------------------------------------


def object_jobs(seed: int, starts: int) -> dict[str, Row]:
    """Every episode under keys ``surroundings/thing/k``, the starts outermost: a short run has some of every kind."""
    return _episodes(encounters(seed, starts))


def _episodes(met: Mapping[str, Row]) -> dict[str, Row]:
    more = {"noise": noise_fields(Noise.thesis()), "attempts": ATTEMPTS}
    methods = [[name for name in METHODS if few or name not in ON_ARCS] for few in (False, True)]
    ordered = sorted(met.items(), key=lambda item: item[1]["k"])
    return {key: job | more | {"methods": methods[job["k"] < FEW]} for key, job in ordered}


def object_once(job: Mapping[str, Any]) -> Row:
    """One episode, of :func:`object_jobs`: what :func:`~gvp_book.experiments.grasping.grasp_once` tells."""
    return grasp_in(_cell, job)


def _cell(job: Mapping[str, Any]) -> WorkCell:
    target, placement, others = job["target"], job["placement"], job["others"]

    def make() -> WorkCell:
        spec = own_thing(**job["own"]) if "own" in job else THINGS[target]
        beside = [THINGS[other] for other in others]
        noise = Noise(**job["noise"])
        return WorkCell("baxter", spec, placement, noise=noise, others=beside, touching=True)

    return _kept.get((target, placement, *others, str(job.get("own"))), make)


_kept: CellCache[WorkCell] = CellCache()


# --- what they add up to ----------------------------------------------------------------------------------------------


def object_report(rows: Mapping[str, Row], *, not_convex: Collection[str] = NOT_CONVEX) -> Row:
    """The content of the stored result, of rows of :func:`object_once`; angles in deg, lengths in mm.

    ``things``: what each is. ``summary``: by surroundings and thing, for each method a
    :func:`~gvp_book.experiments.grasping.tally`, how the grasps ended, how many were held, through the shake too, at
    the ``first`` attempt, and ``where the oracle holds``; and the difference between ours and straight down.
    ``placements`` and ``pooled``: the same by surroundings and placement, and by surroundings over all things, and over
    those that are not convex. ``not begun``: encounters in which nothing could be tried, and why. ``rows``: every
    episode.
    """
    cases: dict[str, list[Row]] = {}
    placements: dict[str, list[Row]] = {}
    pooled: dict[str, list[Row]] = {}
    for key, row in sorted(rows.items(), key=lambda item: int(item[0].rpartition("/")[2])):
        surroundings, name, k = key.split("/")
        placement = PLACED[int(k) % len(PLACED)]
        cases.setdefault(f"{surroundings}/{name}", []).append(row)
        placements.setdefault(f"{surroundings}/{placement}", []).append(row)
        pooled.setdefault(surroundings, []).append(row)
        if name in not_convex:
            pooled.setdefault(f"{surroundings}, not convex", []).append(row)
    names = dict.fromkeys(case.partition("/")[2] for case in cases)
    return {
        "things": {name: THINGS[name].title for name in names if name in THINGS},
        "summary": {case: summary(group) for case, group in cases.items()},
        "placements": {case: summary(group) for case, group in placements.items()},
        "pooled": {case: summary(group) for case, group in pooled.items()},
        "not begun": {key: row["not begun"] for key, row in rows.items() if "not begun" in row},
        "rows": {case: columns(group) for case, group in cases.items()},
    }


def summary(group: Sequence[Row]) -> Row:
    """What came of each method in some episodes, and of ours against straight down."""
    found: Row = {"starts": len(group), "begun": sum("not begun" not in row for row in group)}
    for method, grasps in by_method(group).items():
        with_oracle = [row[method] for row in group if method in row and _held(row.get("oracle", {}))]
        found[method] = tally(grasps) | {"outcomes": dict(Counter(grasp["outcome"] for grasp in grasps))}
        found[method]["first"] = trials(
            sum(_held(grasp) and grasp.get("attempts", 1) == 1 for grasp in grasps), len(grasps)
        )
        if with_oracle:
            found[method]["where the oracle holds"] = trials(sum(map(_held, with_oracle)), len(with_oracle))
    for name, is_so in (("held", _held), ("placeable", placeable)):
        both = [(is_so(row["ours"]), is_so(row["look_down"])) for row in group if {"ours", "look_down"} <= row.keys()]
        if both:
            ours, down = zip(*both, strict=True)
            found[f"ours - look_down, {name}"] = paired_difference([float(x) for x in ours], [float(x) for x in down])
    return found


def _held(grasp: Mapping[str, Any]) -> bool:
    return bool(grasp.get("shaken", False))


def _status(rows: Sequence[Row]) -> str:
    held = {name: [_held(row[name]) for row in rows if name in row] for name in ("ours", "look_down", "oracle")}
    return ", ".join(f"{name} {sum(each) / len(each):.0%}" for name, each in held.items() if each)


EXPERIMENT = Experiment(object_once, object_jobs, object_report, starts=12, status=_status)
"""Two dozen things, alone and among others."""


# --- your own thing ---------------------------------------------------------------------------------------------------

_PAINT, _LIKE = (0.86, 0.12, 0.50), THINGS["soap"].segmenter
"""What things of your own are painted, so that a threshold finds them among others: the pink of our soap."""


def with_own(paths: Sequence[str | Path], scale: float = 1.0) -> tuple[str, Experiment]:
    """The same experiment on things of your own, and the name of its result.

    Parameters
    ----------
    paths
        Meshes (OBJ, STL) and MJCF files, each of one thing.
    scale
        Length of a mesh's unit, m.

    Raises
    ------
    ModelError
        A file is none that MuJoCo reads, or the thing is not of a size and a mass that an object can have.
    InvalidParameterError
        Two of the things have the same name.
    """
    own: dict[str, Row] = {}
    for path in map(Path, paths):
        name = path.stem
        if name in own:
            raise InvalidParameterError(f"each thing has the name of its file, and {name!r} is taken: rename {path}")
        own[name] = {"path": str(path), "scale": scale}
        own_thing(**own[name]).bounding_box()
        own[name]["sha256"] = hashlib.sha256(path.read_bytes()).hexdigest()  # of this file alone
    experiment = replace(EXPERIMENT, jobs=partial(_own_jobs, own), report=partial(_own_report, own))
    return f"objects-{'-'.join(own)}", experiment


def _own_jobs(own: Mapping[str, Row], seed: int, starts: int) -> dict[str, Row]:
    """As for ours: in all placements in turn, alone and among three of another color."""
    strangers = [name for name, spec in THINGS.items() if spec.segmenter != _LIKE]
    met: dict[str, Row] = {}
    for number, name in enumerate(own, start=len(THINGS)):
        for k in range(starts):
            beside = np.random.default_rng([seed, number, k]).choice(strangers, 3, replace=False).tolist()
            job = {"target": name, "own": own[name], "placement": PLACED[k % len(PLACED)], "seed": seed, "k": k}
            met |= {f"alone/{name}/{k}": {**job, "others": []}, f"among/{name}/{k}": {**job, "others": beside}}
    return _episodes(met)


def _own_report(own: Mapping[str, Row], rows: Mapping[str, Row]) -> Row:
    things = {name: {"scale": it["scale"], "sha256": it["sha256"]} for name, it in own.items()}
    return object_report(rows, not_convex=()) | {"things": things}


@cache
def own_thing(path: str, scale: float = 1.0, sha256: str = "") -> ObjectSpec:
    """A thing of your own, as a job has it; of another content of its file, it is another."""
    return ObjectSpec.from_file(path, _LIKE, rgb=_PAINT, scale=scale)
