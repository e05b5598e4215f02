"""How much of the virtual sphere an arm reaches, and how much more on a holonomic base. Thesis 4.

Each episode draws a place for the object and one viewpoint over it, uniform in area over a cap, with any roll. It asks
two questions: can the arm put its camera there at all, and can it get there the way planners move, over the sphere from
straight above?
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from gvp_book.results import Experiment, Row, by_case
from gvp_lib.errors import UnreachableError
from gvp_lib.evaluation.statistics import wilson_interval
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.motion.arm import Outcome
from gvp_lib.simulation.arms import ARMS
from gvp_lib.simulation.workcell import CellCache, WorkCell

RADIUS = 0.25  # m, of the sphere on which the image-moment planner moves
STEP = float(np.radians(5))  # rad, of the way over the sphere
CAPS = (30, 60)
"""Half angles of the caps, deg: where the learned planner starts, and more than any planner here asks for."""

NO_START = "cannot stand above"
"""Why an arm does not come to a viewpoint: with that roll it cannot stand where the way begins."""

PLACES: Mapping[str, tuple[float, float]] = {
    "in the workspace": (0.0, 0.0),
    "0.15 m farther": (0.15, 0.0),
    "0.3 m farther": (0.3, 0.0),
    "0.3 m to the left": (0.0, 0.3),
}
"""By how much the arm's workspace, and the table with it, is shifted along x and y, m."""


def reach_jobs(seed: int, starts: int) -> dict[str, Row]:
    """Jobs of all episodes, with keys ``arm/fixed or base/place/cap/k``.

    Each cap has its own viewpoints; they are the same for both arms, every place, and with or without a base.
    """
    return {
        f"{arm}/{stand}/{place}/{cap}/{k}": {
            "arm": arm, "base": stand == "base", "place": place, "cap": cap, "seed": seed, "k": k,
        }
        for arm in ("ur5e", "baxter")
        for stand in ("fixed", "base")
        for place in PLACES
        for cap in CAPS
        for k in range(starts)
    }  # fmt: skip


def reach_once(job: Mapping[str, Any]) -> Row:
    """Test one viewpoint at one place, a job of :func:`reach_jobs`.

    ``tilt``, ``azimuth``, deg. ``stands``: some joint angles within the limits and free of collision put the camera
    there. ``comes``: the arm also got there over the sphere, in straight lines from straight above. ``why``: what ended
    the way, a value of :class:`~gvp_lib.motion.arm.Outcome`, or :data:`NO_START`; ``""`` where it came.
    """
    cell = _cell_of(job)
    where, draws = np.random.SeedSequence([job["seed"], job["cap"], job["k"]]).spawn(2)
    cell.reset(where)
    rng = np.random.default_rng(draws)
    tilt = float(np.arccos(rng.uniform(np.cos(np.radians(job["cap"])), 1)))
    azimuth, roll = (float(angle) for angle in rng.uniform(0, 2 * np.pi, 2))
    sphere = VirtualSphere(cell.truth.world_from_object.translation, RADIUS)
    way = sphere.viewpoint(np.linspace(0, tilt, 1 + int(np.ceil(tilt / STEP))), azimuth, roll)
    stands = _stands(cell, way[-1])
    why = _stopped_by(cell, way) if stands else Outcome.UNREACHABLE.value
    angles = {"tilt": float(np.degrees(tilt)), "azimuth": float(np.degrees(azimuth))}
    return {**angles, "stands": stands, "comes": not why, "why": why}


def _stands(cell: WorkCell, view: RigidTransform) -> bool:
    try:
        cell.place_camera(view)
    except UnreachableError:
        return False
    return True


def _stopped_by(cell: WorkCell, way: RigidTransform) -> str:
    """What keeps the arm from going this way to its end; nothing, where it comes there."""
    if not _stands(cell, way[0]):
        return NO_START
    for view in way[1:]:
        motion = cell.arm.move_camera(cell.arm.camera_pose().inv() * view)
        if not motion:
            return motion.reason.value
    return ""


def _cell_of(job: Mapping[str, Any]) -> WorkCell:
    """The last one is kept, since jobs of one case follow each other."""

    def make() -> WorkCell:
        spec, (dx, dy) = ARMS[job["arm"]], PLACES[job["place"]]
        (x0, x1), (y0, y1) = spec.workspace
        spec = replace(spec, workspace=((x0 + dx, x1 + dx), (y0 + dy, y1 + dy)))
        return WorkCell(spec.on_base() if job["base"] else spec, "cuboid_1x2")

    return _kept.get((job["arm"], job["base"], job["place"]), make)


_kept: CellCache[WorkCell] = CellCache()


def reach_report(rows: Mapping[str, Row]) -> Row:
    """Content of the stored result, from rows of :func:`reach_once` with the keys of :func:`reach_jobs`.

    By case ``arm/stand/place/cap``. ``summary``: n, and for ``stands`` and ``comes`` the share of the cap with its
    Wilson interval; ``why``, how often each reason kept the arm from coming where it can stand. ``rows``: every
    viewpoint, column by column, with 1 for yes.
    """
    summary: Row = {}
    columns: Row = {}
    for case, group in by_case(rows).items():
        summary[case] = {"n": len(group)}
        columns[case] = {angle: [round(row[angle], 1) for row in group] for angle in ("tilt", "azimuth")}
        for name in ("stands", "comes"):
            reached = sum(row[name] for row in group)
            interval = wilson_interval(reached, len(group))
            summary[case][name] = {"share": reached / len(group), "interval": interval}
            columns[case][name] = "".join(str(int(row[name])) for row in group)
        summary[case]["why"] = dict(Counter(row["why"] for row in group if row["stands"] and not row["comes"]))
    return {"summary": summary, "rows": columns}


EXPERIMENT = Experiment(reach_once, reach_jobs, reach_report, starts=40)
"""Reach."""
