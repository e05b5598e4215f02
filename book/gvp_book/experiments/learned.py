"""The learned planner's episodes: where it ends, on objects it knows and on others, and whether it keeps up with one
that moves. Thesis 2.4, 2.4.5, 3.2.2, 3.2.3, Tables 3.3 and 3.4.

Each episode draws one start on the virtual sphere, from which each method runs in turn.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from gvp_book.results import Row
from gvp_lib.errors import GvpError
from gvp_lib.evaluation import baselines
from gvp_lib.evaluation.episodes import Start, begin_again, draw_start, run_episode
from gvp_lib.learning.checkpoints import weights_file
from gvp_lib.learning.labels import label_view
from gvp_lib.learning.policy import NetworkPolicy, on_threads
from gvp_lib.learning.recipe import Painter, Variation
from gvp_lib.perception.segmentation import Saliency
from gvp_lib.planning.learned import CnnPlanner
from gvp_lib.planning.plan import Action, Plan
from gvp_lib.simulation.moving import Path, Rocking, Sliding, Turning, moving_target
from gvp_lib.simulation.objects import BLUE, OBJECTS, ObjectSpec, brick_mjcf
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.workcell import CellCache, WorkCell

__all__ = ["PATHS", "RADIUS", "VariedCell", "begin", "cell_of", "follow_once", "policy_of", "spec_of",
           "step_over_once"]  # fmt: skip

RADIUS = 0.5  # m, of the virtual sphere: one scale for all objects
CAP = (0.0, 30.0)  # deg, of the starts, as of the data sets


# --- where they begin -------------------------------------------------------------------------------------------------


class VariedCell:
    """A work cell, and how its look varies: drawn anew for each start."""

    def __init__(self, cell: WorkCell, variation: Variation) -> None:
        self.cell, self.variation = cell, variation
        self._painter, self._painted = Painter(cell, variation), cell.model

    def paint(self, rng: np.random.Generator) -> None:
        """Another look, until the next; none where nothing is varied."""
        if self._painted is not self.cell.model:  # a scene that was compiled anew looks as at first
            self._painter, self._painted = Painter(self.cell, self.variation), self.cell.model
        self._painter.paint(rng)

    def close(self) -> None:
        """Free the cell's graphics contexts."""
        self.cell.close()


def cell_of(job: Mapping[str, Any]) -> VariedCell:
    """The work cell of a job. The last one is kept, since jobs of one case follow each other."""
    target, noise, variation = job["target"], Noise(**job["noise"]), Variation(**job["variation"])
    key = target, tuple(sorted(job["noise"].items())), tuple(sorted(job["variation"].items()))
    return _kept.get(key, lambda: VariedCell(WorkCell("ur5e", spec_of(target), noise=noise), variation))


_kept: CellCache[VariedCell] = CellCache()


def spec_of(target: str) -> ObjectSpec:
    """An object by name, or a brick painted like the 1x2: ``"cuboid_1x1 in blue"``.

    Whether the thesis's bricks had one color in its simulator is not known; to a network that is all the difference.
    """
    name, _, paint = target.partition(" in ")
    if not paint:
        return OBJECTS[name]
    mjcf = brick_mjcf(int(name.removeprefix("cuboid_1x")), BLUE)
    return replace(OBJECTS[name], mjcf=mjcf, segmenter=OBJECTS["cuboid_1x2"].segmenter)


def begin(varied: VariedCell, job: Mapping[str, Any]) -> Start:
    """Set an episode up; the same places for every noise and method."""
    case = zlib.crc32(job["target"].encode())
    for attempt in range(20):
        places, draws, look = np.random.SeedSequence([job["seed"], case, job["k"], attempt]).spawn(3)
        varied.cell.reset(places)
        varied.paint(np.random.default_rng(look))
        try:
            rng = np.random.default_rng(draws)
            return draw_start(varied.cell, rng, CAP, distances=(RADIUS, RADIUS), radius=RADIUS, by_area=True)
        except GvpError:
            continue
    raise GvpError(f"no place within reach for {job['target']!r}, start {job['k']}")


# --- where they end ---------------------------------------------------------------------------------------------------


def step_over_once(job: Mapping[str, Any]) -> Row:
    """One episode: a start, and where each method ends: a judgement each (angles in deg), with the ``steps`` that it
    took.

    A job has ``target``, as :func:`spec_of` knows it; ``noise`` (fields of :class:`Noise`); ``variation`` (fields of
    :class:`Variation`); ``seed``; ``k``, the number of the start; and ``methods``, by name: ``stay`` (center and stay),
    ``chance`` (actions at random until NO_OP), ``oracle`` (the best action each time, which is what labels are made
    of), or ``weights`` (the path of a file, or of several, of which start k takes number k modulo their number),
    ``turns``, ``salient`` (whether the object is found by what stands out from the border of the picture, rather than
    by its color) and ``planner`` (fields of :class:`CnnPlanner`).
    """
    varied = cell_of(job)
    cell = varied.cell
    start = begin(varied, job)
    row: Row = {"start": {"tilt": float(np.degrees(start.tilt)), "tries": start.tries}}
    for name, method in job["methods"].items():
        begin_again(cell, start)
        with on_threads(1):
            plan, judged = run_episode(cell, _method(name, method, cell, job))
        row[name] = judged.to_dict() | {"steps": len(plan.steps)}
    return row


def _method(name: str, method: Mapping[str, Any], cell: WorkCell, job: Mapping[str, Any]) -> Callable[[WorkCell], Plan]:
    if name == "stay":
        return baselines.stay
    options = method.get("planner", {})
    rng = np.random.default_rng([job["seed"], zlib.crc32(job["target"].encode()), job["k"]])

    def chance(rgb: Any) -> Action:
        return Action(int(rng.integers(len(Action))))

    def oracle(rgb: Any) -> Action:
        step = options.get("step", np.radians(5))
        return label_view(cell.truth.world_from_camera, cell.truth.normal, step).action

    policy: Callable[[Any], Any]
    if name == "chance" or name.startswith("oracle"):
        policy = chance if name == "chance" else oracle
    else:
        files = [method["weights"]] if isinstance(method["weights"], str) else method["weights"]
        policy = policy_of(files[job["k"] % len(files)], method.get("turns", 1))
    segmenter = Saliency() if method.get("salient") else cell.segmenter
    return lambda cell: CnnPlanner(segmenter, policy, radius=RADIUS, **options).plan(cell.arm)


def policy_of(weights: str, turns: int) -> NetworkPolicy:
    """A network as a policy; kept, since episodes of one network follow each other, until its file is another."""
    file = weights_file(weights)
    found = file.stat() if file.is_file() else None
    return _policy_of(weights, turns, found and (found.st_mtime_ns, found.st_size))


@lru_cache(maxsize=32)
def _policy_of(weights: str, turns: int, version: tuple[int, int] | None) -> NetworkPolicy:
    return NetworkPolicy(weights, turns=turns)


# --- an object that moves ---------------------------------------------------------------------------------------------

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


def follow_once(job: Mapping[str, Any]) -> Row:
    """One start, from which each method follows the object, for :data:`SETTLED` looks and the seconds after them.

    A job is as for :func:`step_over_once`, with a ``path`` in :data:`PATHS`. For each method: ``error``, the mean over
    the looks after the first :data:`SETTLED`, deg; ``lost``, whether the object was out of sight at any of these;
    ``seconds`` for each look.
    """
    varied, path = cell_of(job), PATHS[job["path"]]
    cell = varied.cell
    watched = path.period if isinstance(path, Rocking) else WATCHED
    row: Row = {}
    for name, method in job["methods"].items():
        begin(varied, job)
        policy = policy_of(method["weights"], method.get("turns", 1))
        planner = CnnPlanner(cell.segmenter, policy, radius=RADIUS, **method.get("planner", {}))
        began, until = cell.time, np.inf
        errors: list[float] = []
        lost: list[bool] = []
        with on_threads(1), moving_target(cell, path):
            for step in planner.steps(cell.arm):
                cell.wait(PAUSE)
                errors.append(float(np.degrees(cell.truth.viewpoint_error())))
                lost.append(step.view is None)
                if len(errors) == SETTLED:
                    until = cell.time + watched
                if cell.time >= until:
                    break
        row[name] = {
            "error": float(np.mean(errors[SETTLED:])),
            "lost": any(lost[SETTLED:]),
            "seconds": (cell.time - began) / len(errors),
        }
    return row
