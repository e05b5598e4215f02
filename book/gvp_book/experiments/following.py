"""Whether the learned planner keeps up with an object that moves, as the thesis claims (2.4), and how fast a one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gvp_book.experiments.learned import RADIUS, begin, cell_of, policy_of
from gvp_lib.learning.policy import on_threads
from gvp_lib.planning.learned import CnnPlanner
from gvp_lib.simulation.moving import Path, Rocking, Sliding, Turning, moving_target
from gvp_lib.simulation.workcell import WorkCell

__all__ = ["PATHS", "follow_once"]

PAUSE = 0.1  # s, that a picture and a network's answer take
SETTLED = 15  # looks, after which a planner that starts anywhere on the cap has arrived
WATCHED = 5.0  # s, for which it is watched from then on; a rocking object for a whole period

PATHS: Mapping[str, Path] = {
    "still": Sliding((0.0, 0.0)),
    **{f"slides at {speed:g} mm/s": Sliding((0.0, speed / 1000)) for speed in (5, 10, 20)},
    **{f"turns at {rate:g} deg/s": Turning(np.radians(rate)) for rate in (5, 20)},
    **{f"rocks by 10 deg in {period:g} s": Rocking(np.radians(10), period) for period in (20, 10, 5, 2.5)},
}
"""How the object moves; a rocking one's normal swings by 10 deg to either side."""


def follow_once(job: Mapping[str, Any]) -> dict[str, Any]:
    """One start, from which each method follows the object, for :data:`SETTLED` looks and the seconds after them.

    Parameters
    ----------
    job
        As for :func:`gvp_book.experiments.learned.step_over_once`; also ``path``, in :data:`PATHS`.

    Returns
    -------
    dict
        For each method, ``error``, the mean over the looks after the first :data:`SETTLED`, deg; ``lost``, whether the
        object was out of sight at any of these; ``seconds`` for each look.
    """
    varied = cell_of(job)
    row = {}
    for name, method in job["methods"].items():
        begin(varied, job)
        planner = CnnPlanner(varied.cell.segmenter, policy_of(method["weights"], method.get("turns", 1)), radius=RADIUS,
                             **method.get("planner", {}))  # fmt: skip
        row[name] = _followed(varied.cell, planner, PATHS[job["path"]])
    return row


def _followed(cell: WorkCell, planner: CnnPlanner, path: Path) -> dict[str, Any]:
    watched = path.period if isinstance(path, Rocking) else WATCHED
    began, errors, lost = cell.time, [], []
    until = np.inf
    with on_threads(1), moving_target(cell, path):
        for step in planner.steps(cell.arm):
            cell.wait(PAUSE)
            errors.append(float(np.degrees(cell.truth.viewpoint_error())))
            lost.append(step.view is None)
            if len(errors) == SETTLED:
                until = cell.time + watched
            if cell.time >= until:
                break
    return {
        "error": float(np.mean(errors[SETTLED:])),
        "lost": any(lost[SETTLED:]),
        "seconds": (cell.time - began) / len(errors),
    }
