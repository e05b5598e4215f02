"""The experiment behind Table 3.2: from a start, by a planner, to an object in the hand. Thesis 3.1.3 to 3.1.7.

Planning touches nothing, so it runs without dynamics; the grasp has them. Each episode draws one start. From it the
thesis's planner runs and its grasp; our estimator concludes from the same views, and our grasp; then, from the same
start again, what there is to compare with.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from gvp_lib.experiments import baselines
from gvp_lib.experiments.alignment import begin, begin_again
from gvp_lib.experiments.episodes import draw_start
from gvp_lib.motion.arm import Gripper, Hand
from gvp_lib.planning.closing import RangeThreshold, SizedDepth
from gvp_lib.planning.grasp import Grasp, GraspExecutor, GraspOutcome
from gvp_lib.planning.image_moments import ImageMomentPlanner
from gvp_lib.planning.optimum import MIN_VIEWS
from gvp_lib.planning.plan import Plan
from gvp_lib.planning.silhouette import FittedSolid, SilhouetteFit
from gvp_lib.simulation.arms import ARMS
from gvp_lib.simulation.monitor import record_contacts, shake
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.workcell import WorkCell

__all__ = ["CASES", "CAUSES", "METHODS", "OPENINGS", "Cause", "grasp_cell", "grasp_once"]

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

LIFTED, HELD_FOR = 0.05, 2.0  # m and s, of a success
_RANDOM_TILT = (0.0, 40.0)  # deg, of a random viewpoint


class Cause:
    """Why a grasp failed, by the truth, each as it stands in results."""

    TARGET_LOST = "target lost"
    UNREACHABLE = "unreachable"
    TOO_EARLY = "closed too early (IR)"
    NEVER_CLOSED = "never closed (IR)"
    MISALIGNED = "misaligned"
    PUSHED_AWAY = "pushed away"
    COLLISION = "collision"
    SLIPPED = "slipped"


CAUSES = tuple(value for name, value in vars(Cause).items() if name.isupper())


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
        For each method what :func:`_grasp` tells; angles in deg, lengths in mm.
    """
    cell, methods = grasp_cell(job), job["methods"]
    cell.dynamic = False  # an episode that broke off may have left it on
    start = begin(cell, job)
    thesis = ImageMomentPlanner(cell.segmenter)
    fit = ImageMomentPlanner(cell.segmenter, SilhouetteFit())
    needs_it = {"thesis", "ours", "fit, threshold", "quartic, sized"}.intersection(methods)
    first = thesis.plan(cell.arm) if needs_it else baselines.nothing(cell)
    row: dict[str, Any] = {"tilt": float(np.degrees(start.tilt))}

    def at_the_start() -> None:
        cell.dynamic = False
        begin_again(cell, start)

    def by_fit() -> Plan:
        concluded = fit.conclude(cell.arm, first.arcs) if len(first.views) >= MIN_VIEWS else fit.plan(cell.arm)
        if concluded.outcome.arrived:
            return concluded
        begin_again(cell, start)  # the arm met its limits: the arcs in the other order may not
        return replace(fit, order="major first").plan(cell.arm)

    def at_random() -> Plan:
        draw_start(cell, np.random.default_rng([job["seed"], job["k"]]), _RANDOM_TILT)
        return baselines.aligned_in_place(cell)

    def by_quartic() -> Plan:
        if first.joints is not None:
            cell.arm.move_joints(first.joints)
        return first

    # Who plans, and whether the fingers close by the solid's sizes and filtered readings.
    ways: dict[str, tuple[Callable[[], Plan], bool]] = {
        "thesis": (lambda: first, False),
        "fit, threshold": (by_fit, False),
        "quartic, sized": (by_quartic, True),
        "ours": (by_fit, True),
        "look_down": (lambda: baselines.look_down(cell), True),
        "stay": (lambda: baselines.aligned_in_place(cell), True),
        "random": (at_random, True),
        "oracle": (lambda: baselines.oracle(cell), True),
    }
    for method in (name for name in METHODS if name in methods):
        if method != "thesis":
            at_the_start()
        plan_by, sized = ways[method]
        plan = plan_by()
        closing = SizedDepth.of(plan) if sized else RangeThreshold()
        if method == "oracle":
            closing = SizedDepth(_true_solid(cell))
        executor = GraspExecutor(cell.segmenter, closing, recenter="shifting" if sized else "turning")
        row[method] = _grasp(cell, plan, executor)
    cell.dynamic = False
    return row


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
    return _cell(job["target"], job["placement"], tuple(sorted(job["noise"].items())))


@lru_cache(maxsize=1)
def _cell(target: str, placement: str, noise: tuple[Any, ...]) -> WorkCell:
    arm = ARMS["baxter"]
    assert arm.gripper is not None
    opening = OPENINGS.get((target, placement), arm.gripper.max_width)
    fitted = replace(arm, gripper=replace(arm.gripper, max_width=opening))
    return WorkCell(fitted, target, placement, noise=Noise(**dict(noise)))


@dataclass
class _Witness:
    """A gripper that hands everything on, and remembers the truth of the moment in which it was told to close."""

    cell: WorkCell
    gripper: Gripper
    camera: RigidTransform | None = None
    target: RigidTransform | None = None
    error: float = np.nan  # rad
    roll: float = np.nan  # rad

    @property
    def width(self) -> float:
        return self.gripper.width

    @property
    def stroke(self) -> tuple[float, float]:
        return self.gripper.stroke

    @property
    def hand(self) -> Hand:
        return self.gripper.hand

    def open(self) -> None:
        self.gripper.open()

    def range(self) -> float:
        return self.gripper.range()

    def close(self) -> None:
        truth = self.cell.truth
        self.camera, self.target = truth.world_from_camera, truth.world_from_object
        self.error, self.roll = truth.viewpoint_error(), truth.roll_error()
        self.gripper.close()


def _grasp(cell: WorkCell, plan: Plan, executor: GraspExecutor) -> dict[str, Any]:
    """Grasp, lift, hold and shake; what came of it, and why.

    ``error``, ``roll``: of the viewpoint, before the descent. ``success``: lifted by 5 cm and held for 2 s; ``shaken``:
    and after the shake. ``depth``: of the fingertips below the surface, as they closed; ``aside``: of the object from
    the middle, across the hand. ``tilt_in_hand``, ``turn_in_hand``, ``shift_in_hand``: between hand and object after
    the hold, against an aligned grasp through the object's center line.
    """
    truth, placed = cell.truth, cell.truth.world_from_object
    error, roll = np.degrees(truth.viewpoint_error()), np.degrees(truth.roll_error())
    began = cell.time
    cell.dynamic = True
    witness = _Witness(cell, cell.gripper)

    def lifted() -> bool:
        return bool(truth.world_from_object.translation[2] - placed.translation[2] >= LIFTED)

    with record_contacts(cell) as contacts:
        grasp = executor.grasp(cell.arm, witness)
        success = lifted()
        if success:
            cell.wait(HELD_FOR)
            success = lifted()
    told: dict[str, Any] = {
        "plan": plan.outcome.value,
        "error": float(error),
        "roll": float(roll),
        "outcome": grasp.outcome.value,
        "success": success,
        "frames": grasp.frames,
        "seconds": float(cell.time - began),
        **_at_closing(cell, witness),
    }
    if success:
        told |= _in_hand(cell)
        with record_contacts(cell) as shaken:
            shake(cell)
        told["shaken"] = lifted()
        contacts.deepest = max(contacts.deepest, shaken.deepest)
        contacts.fastest = max(contacts.fastest, shaken.fastest)
    else:
        told["cause"] = _cause(grasp, told, witness, placed)
    return told | {"deepest": 1000 * contacts.deepest, "fastest": contacts.fastest}


def _at_closing(cell: WorkCell, witness: _Witness) -> dict[str, float]:
    """Where the object was as the fingers closed, mm."""
    if witness.camera is None or witness.target is None:
        return {}
    normal = cell.truth.normal.nearest(-witness.camera.rotation.as_matrix()[:, 2])
    top = witness.target.translation + _half_extent(cell, witness.target, normal) * normal
    surface = witness.camera.inv().apply(top)[2]
    x, y, _ = witness.camera.inv().apply(witness.target.translation)
    return {
        "depth": 1000 * float(witness.hand.tips - surface),
        "aside": 1000 * float(x),
        "along": 1000 * float(y),
    }


def _half_extent(cell: WorkCell, world_from_object: RigidTransform, direction: np.ndarray) -> float:
    """Half of the object's extent along a direction that is one of its axes or across its round one, m."""
    local = np.abs(world_from_object.rotation.as_matrix().T @ direction)
    half = cell.target_spec.bounding_box().half_extents
    return float(np.linalg.norm(local * half))


def _in_hand(cell: WorkCell) -> dict[str, float]:
    """The object's pose in the hand that holds it; deg and mm."""
    truth = cell.truth
    x, _, _ = truth.world_from_camera.inv().apply(truth.world_from_object.translation)
    return {
        "tilt_in_hand": float(np.degrees(truth.viewpoint_error())),
        "turn_in_hand": float(np.degrees(abs(truth.roll_error()))),
        "shift_in_hand": 1000 * float(x),
    }


_BARELY, _TOO_TILTED, _TOO_TURNED = 5.0, 20.0, 20.0  # mm and deg, beyond which a grasp of these objects is chance
_TOO_FAR_ASIDE, _PUSHED, _TIPPED = 10.0, 10.0, 10.0  # mm, mm and deg


def _cause(grasp: Grasp, told: Mapping[str, Any], witness: _Witness, placed: RigidTransform) -> str:
    """The first of the causes that holds, in the order in which they act."""
    outcome = grasp.outcome
    if outcome in (GraspOutcome.TARGET_LOST, GraspOutcome.TARGET_NOT_FOUND, GraspOutcome.TOO_WIDE):
        return Cause.TARGET_LOST
    if (
        outcome in (GraspOutcome.UNREACHABLE, GraspOutcome.JOINT_LIMIT, GraspOutcome.STALLED)
        and grasp.closed_at is None
    ):
        return Cause.UNREACHABLE
    if told.get("depth", np.inf) < _BARELY and not grasp.landed:
        return Cause.TOO_EARLY
    tilted = max(told["error"], np.degrees(witness.error)) > _TOO_TILTED
    turned = abs(told["roll"]) > _TOO_TURNED or abs(np.degrees(witness.roll)) > _TOO_TURNED
    if tilted or turned or abs(told.get("aside", 0.0)) > _TOO_FAR_ASIDE:
        return Cause.MISALIGNED
    if outcome is GraspOutcome.NEVER_CLOSED:
        return Cause.NEVER_CLOSED
    if witness.target is not None:
        moved = placed.inv() * witness.target
        if 1000 * np.linalg.norm(moved.translation) > _PUSHED or np.degrees(moved.rotation.magnitude()) > _TIPPED:
            return Cause.PUSHED_AWAY
    if grasp.landed or outcome in (GraspOutcome.CONTACT, GraspOutcome.COLLISION):
        return Cause.COLLISION
    return Cause.SLIPPED
