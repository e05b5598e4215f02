"""What came of one grasp, and why, by the truth: lifted, held, shaken; the pose in the hand; the cause of a failure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from gvp_lib.motion.arm import Gripper, Hand
from gvp_lib.planning.grasp import Grasp, GraspExecutor, GraspOutcome
from gvp_lib.planning.plan import Plan
from gvp_lib.simulation.moving import record_contacts, shake
from gvp_lib.simulation.workcell import WorkCell

__all__ = ["CAUSES", "Cause", "judged_grasp"]

LIFTED, HELD_FOR, TO_FALL = 0.05, 2.0, 0.3  # m and s of a success; s in which what was shaken loose has fallen


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


def judged_grasp(cell: WorkCell, plan: Plan, executor: GraspExecutor) -> dict[str, Any]:
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
        grasp = executor.grasp(cell.arm, witness, plan.view)
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
            cell.wait(TO_FALL)
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
