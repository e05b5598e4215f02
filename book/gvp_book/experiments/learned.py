"""The experiments behind Tables 3.3 and 3.4: where the learned planner ends, on objects it knows and on others.
Thesis 2.4.5, 3.2.2, 3.2.3.

Each episode draws one start on the virtual sphere, from which each method runs in turn.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvp_lib.errors import GvpError
from gvp_lib.evaluation import baselines
from gvp_lib.evaluation.episodes import Start, begin_again, draw_start, run_episode
from gvp_lib.learning.checkpoints import weights_file
from gvp_lib.learning.labels import label_view
from gvp_lib.learning.policy import NetworkPolicy, on_threads
from gvp_lib.learning.recipe import Painter, Variation
from gvp_lib.perception.segmentation import Saliency, Segmenter
from gvp_lib.planning.learned import CnnPlanner
from gvp_lib.planning.plan import Action, Plan
from gvp_lib.simulation.objects import BLUE, OBJECTS, ObjectSpec, brick_mjcf
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.workcell import CellCache, WorkCell

__all__ = ["BASELINES", "RADIUS", "VariedCell", "begin", "cell_of", "policy_of", "spec_of", "step_over_once"]

RADIUS = 0.5  # m, of the virtual sphere: one scale for all objects
CAP = (0.0, 30.0)  # deg, of the starts, as of the data sets

BASELINES = ("stay", "chance", "oracle")
"""Center and stay; actions at random until NO_OP; the best action each time, which is what labels are made of."""


class VariedCell:
    """A cell, and who changes its look.

    Parameters
    ----------
    cell
        The work cell.
    variation
        Of its look, drawn anew for each start.
    """

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


def step_over_once(job: Mapping[str, Any]) -> dict[str, Any]:
    """One episode: a start, and where each method ends.

    Parameters
    ----------
    job
        JSON data: ``target``, as :func:`spec_of` knows it; ``noise`` (fields of :class:`Noise`); ``variation`` (fields
        of :class:`Variation`); ``seed``; ``k``, the number of the start; and ``methods``, by name: one of
        :data:`BASELINES`, or ``weights`` (the path of a file, or of several, of which start k takes number k modulo
        their number), ``turns``, ``salient`` (whether the object is found by what stands out from the border of the
        picture, rather than by its color) and ``planner`` (fields of :class:`CnnPlanner`).

    Returns
    -------
    dict
        ``start`` and, for each method, a judgement (angles in deg) with the ``steps`` that it took.
    """
    varied = cell_of(job)
    cell = varied.cell
    start = begin(varied, job)
    row: dict[str, Any] = {"start": {"tilt": float(np.degrees(start.tilt)), "tries": start.tries}}
    for name, method in job["methods"].items():
        begin_again(cell, start)
        with on_threads(1):
            plan, judged = run_episode(cell, _method(name, method, cell, job))
        row[name] = judged.to_dict() | {"steps": len(plan.steps)}
    return row


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
    blue = OBJECTS["cuboid_1x2"]
    mjcf = brick_mjcf(int(name.removeprefix("cuboid_1x")), BLUE)
    return replace(OBJECTS[name], mjcf=mjcf, segmenter=blue.segmenter)


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


def policy_of(weights: str, turns: int) -> NetworkPolicy:
    """A network as a policy; kept, since episodes of one network follow each other, until its file is another."""
    file = weights_file(weights)
    told = file.stat() if file.is_file() else None
    return _policy_of(weights, turns, told and (told.st_mtime_ns, told.st_size))


@lru_cache(maxsize=32)
def _policy_of(weights: str, turns: int, version: tuple[int, int] | None) -> NetworkPolicy:
    return NetworkPolicy(weights, turns=turns)


def _method(name: str, method: Mapping[str, Any], cell: WorkCell, job: Mapping[str, Any]) -> Callable[[WorkCell], Plan]:
    if name == "stay":
        return baselines.stay
    options = method.get("planner", {})
    if name == "chance":
        rng = np.random.default_rng([job["seed"], zlib.crc32(job["target"].encode()), job["k"]])
        return _planned(lambda rgb: Action(int(rng.integers(len(Action)))), options)
    if name.startswith("oracle"):
        step = options.get("step", np.radians(5))
        return _planned(lambda rgb: label_view(cell.truth.world_from_camera, cell.truth.normal, step).action, options)
    files = [method["weights"]] if isinstance(method["weights"], str) else method["weights"]
    segmenter = Saliency() if method.get("salient") else None
    return _planned(policy_of(files[job["k"] % len(files)], method.get("turns", 1)), options, segmenter)


def _planned(
    policy: Callable[[NDArray[np.uint8]], Any], options: Mapping[str, Any], segmenter: Segmenter | None = None
) -> Callable[[WorkCell], Plan]:
    return lambda cell: CnnPlanner(segmenter or cell.segmenter, policy, radius=RADIUS, **options).plan(cell.arm)
