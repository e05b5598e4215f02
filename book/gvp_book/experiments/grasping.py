"""The experiment behind Table 3.2: from a start, by a planner, to an object in the hand. Thesis 3.1.3 to 3.1.7.

Planning touches nothing, so it runs without dynamics; the grasp has them. Each episode draws one start. From it the
thesis's planner runs and its grasp; our estimator concludes from the same views, and our grasp; then, from the same
start again, what there is to compare with.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from gvp_book.experiments.grasp_judgement import judged_grasp
from gvp_lib.evaluation import baselines
from gvp_lib.evaluation.episodes import begin, begin_again, draw_start
from gvp_lib.planning.grasp import GraspExecutor, RangeThreshold, SizedDepth
from gvp_lib.planning.image_moments import ImageMomentPlanner
from gvp_lib.planning.plan import MIN_VIEWS, Plan
from gvp_lib.planning.silhouette import SilhouetteFit
from gvp_lib.planning.solids import FittedSolid
from gvp_lib.simulation.arms import ARMS
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.workcell import CellCache, WorkCell

__all__ = ["CASES", "METHODS", "OPENINGS", "grasp_cell", "grasp_once"]

CASES: tuple[tuple[str, str], ...] = (
    *(("cuboid_1x1", placement) for placement in ("flat", "side", "tilted")),
    *(("cuboid_1x2", placement) for placement in ("flat", "raised", "tilted")),
    *(("cuboid_1x4", placement) for placement in ("flat", "raised", "tilted")),
    *(("cylinder", placement) for placement in ("flat", "side", "tilted")),
    *(("alligator", placement) for placement in ("flat", "raised", "tilted")),
)
"""Objects, in the thesis's two placements each as Fig. 3.1 shows them, and leaning on a block."""

OPENINGS: Mapping[tuple[str, str], float] = {("cuboid_1x1", "side"): 0.056}
"""How wide the fingers are mounted to open, m, where the slots that suit the others (72 mm, 28 when shut) do not: a 1x1
on its side is 19 mm wide, and the fingers would meet nothing."""

METHODS = ("thesis", "fit, threshold", "quartic, sized", "ours", "look_down", "stay", "random", "oracle")
"""The thesis's planner and its plain threshold; ours in one of the two, and in both; the baselines, closing as ours."""

_ON_ITS_VIEWS = {"thesis", "ours", "fit, threshold", "quartic, sized"}  # methods that conclude from the thesis's arcs
_RANDOM_TILT = (0.0, 40.0)  # deg, of a random viewpoint


def grasp_once(job: Mapping[str, Any]) -> dict[str, Any]:
    """One episode: a start, and what comes of each method's grasp.

    Parameters
    ----------
    job
        JSON data: ``target``, ``placement``, ``noise`` (fields of :class:`Noise`), ``seed``, ``k`` (the number of the
        start), ``methods``, of :data:`METHODS`.

    Returns
    -------
    dict
        For each method what :func:`judged_grasp` tells; angles in deg, lengths in mm.
    """
    cell, methods = grasp_cell(job), [name for name in METHODS if name in job["methods"]]
    cell.dynamic = False  # an episode that broke off may have left it on
    start = begin(cell, job)
    planning = _Planning(cell, job)
    row: dict[str, Any] = {"tilt": float(np.degrees(start.tilt))}
    for method in methods:
        if method in _ON_ITS_VIEWS:
            planning.look()  # the thesis's arcs, which others conclude from
        if method != "thesis":
            cell.dynamic = False
            begin_again(cell, start)
        plan_by, sized = planning.ways[method]
        plan = plan_by()
        closing = SizedDepth.of(plan) if sized else RangeThreshold()
        if method == "oracle":
            closing = SizedDepth(_true_solid(cell))
        executor = GraspExecutor(cell.segmenter, closing, recenter="shifting" if sized else "turning")
        row[method] = judged_grasp(cell, plan, executor)
    cell.dynamic = False
    return row


class _Planning:
    """Who plans in an episode, each from its start, and whether the fingers then close by the solid's sizes and
    filtered readings."""

    def __init__(self, cell: WorkCell, job: Mapping[str, Any]) -> None:
        self.cell, self.job = cell, job
        self.start = cell.arm.joints
        self.thesis = ImageMomentPlanner(cell.segmenter)
        estimator = SilhouetteFit(upright=True, lean=np.radians(20))
        self.fit = ImageMomentPlanner(cell.segmenter, estimator, turns=(np.pi / 2, -np.pi / 2))
        self.first: Plan | None = None
        self.ways: dict[str, tuple[Callable[[], Plan], bool]] = {
            "thesis": (self.look, False),
            "fit, threshold": (self.by_fit, False),
            "quartic, sized": (self.by_quartic, True),
            "ours": (self.by_fit, True),
            "look_down": (lambda: baselines.look_down(cell), True),
            "stay": (lambda: baselines.aligned_in_place(cell), True),
            "random": (self.at_random, True),
            "oracle": (lambda: baselines.oracle(cell), True),
        }

    def look(self) -> Plan:
        """The thesis's plan; made once."""
        if self.first is None:
            self.first = self.thesis.plan(self.cell.arm)
        return self.first

    def by_quartic(self) -> Plan:
        first = self.look()
        if first.joints is not None:
            self.cell.arm.move_joints(first.joints)
        return first

    def by_fit(self) -> Plan:
        """Ours. Where the arm meets its limits, with the wrist turned or the arcs in the other order it may not; and
        straight down is better than where it happened to stop."""
        arm, first = self.cell.arm, self.look()
        plan = self.fit.conclude(arm, first.arcs) if len(first.views) >= MIN_VIEWS else self.fit.plan(arm)
        if not plan.outcome.arrived:
            arm.move_joints(self.start)
            plan = replace(self.fit, order="major first").plan(arm)
        if not plan.outcome.arrived:
            arm.move_joints(self.start)
            plan = baselines.look_down(self.cell)
        return plan

    def at_random(self) -> Plan:
        draw_start(self.cell, np.random.default_rng([self.job["seed"], self.job["k"]]), _RANDOM_TILT)
        return baselines.aligned_in_place(self.cell)


def _true_solid(cell: WorkCell) -> FittedSolid:
    """The object's box where it truly is against the camera, for a planner that knows."""
    truth, box = cell.truth, cell.target_spec.bounding_box()
    base_from_object = cell.arm.camera_pose() * truth.world_from_camera.inv() * truth.world_from_object
    turn = base_from_object.rotation * truth.world_from_object.rotation.inv()
    facing = truth.normal.nearest(-truth.world_from_camera.rotation.as_matrix()[:, 2])
    return FittedSolid(
        kind="box",
        base_from_solid=base_from_object * RigidTransform.from_translation(box.center),
        sizes=2 * box.half_extents,
        top=(0.0, 0.0),
        normal=turn.as_matrix() @ facing,
        uncertainty=0.0,
        residual=0.0,
        corrections=np.zeros((0, 6)),
    )


def grasp_cell(job: Mapping[str, Any]) -> WorkCell:
    """The work cell of a job, the fingers mounted for its object. The last one is kept, since jobs of one case follow
    each other."""
    target, placement, noise = job["target"], job["placement"], job["noise"]

    def make() -> WorkCell:
        arm = ARMS["baxter"]
        assert arm.gripper is not None
        opening = OPENINGS.get((target, placement), arm.gripper.max_width)
        fitted = replace(arm, gripper=replace(arm.gripper, max_width=opening))
        return WorkCell(fitted, target, placement, noise=Noise(**noise))

    return _kept.get((target, placement, tuple(sorted(noise.items()))), make)


_kept: CellCache[WorkCell] = CellCache()
