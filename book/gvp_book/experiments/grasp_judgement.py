"""What came of one grasp, and why, by the truth: lifted, held, shaken; the pose in the hand; the cause of a failure."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.spatial.transform import RigidTransform

from gvp_book.running import Row
from gvp_lib.motion.arm import Gripper, Hand
from gvp_lib.planning.grasp import Grasp, GraspExecutor, GraspOutcome
from gvp_lib.planning.plan import Plan
from gvp_lib.simulation.moving import record_contacts, shake
from gvp_lib.simulation.workcell import WorkCell

__all__ = ["CAUSES", "Cause", "judged_grasp"]

LIFTED, HELD_FOR, TO_FALL = 0.05, 2.0, 0.3  # m and s of a success; s in which what was shaken loose has fallen


class Cause(StrEnum):
    """Why a grasp failed, by the truth, each as it stands in results."""

    TARGET_LOST = "target lost"
    UNREACHABLE = "unreachable"
    TOO_EARLY = "closed too early (IR)"
    NEVER_CLOSED = "never closed (IR)"
    MISALIGNED = "misaligned"
    PUSHED_AWAY = "pushed away"
    COLLISION = "collision"
    SLIPPED = "slipped"


CAUSES = tuple(cause.value for cause in Cause)


@dataclass
class _Witness:
    """A gripper that hands everything on, and remembers the truth of the moment in which it had to close."""

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


def judged_grasp(cell: WorkCell, plan: Plan, executor: GraspExecutor) -> Row:
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
    row: Row = {
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
        x, _, _ = truth.world_from_camera.inv().apply(truth.world_from_object.translation)
        row["tilt_in_hand"] = float(np.degrees(truth.viewpoint_error()))
        row["turn_in_hand"] = float(np.degrees(abs(truth.roll_error())))
        row["shift_in_hand"] = 1000 * float(x)
        with record_contacts(cell) as shaken:
            shake(cell)
            cell.wait(TO_FALL)
        row["shaken"] = lifted()
        contacts.deepest = max(contacts.deepest, shaken.deepest)
        contacts.fastest = max(contacts.fastest, shaken.fastest)
    else:
        row["cause"] = _cause(grasp, row, witness, placed).value
    return row | {"deepest": 1000 * contacts.deepest, "fastest": contacts.fastest}


def _at_closing(cell: WorkCell, witness: _Witness) -> dict[str, float]:
    """Where the object was as the fingers closed, mm."""
    if witness.camera is None or witness.target is None:
        return {}
    normal = cell.truth.normal.nearest(-witness.camera.rotation.as_matrix()[:, 2])
    # Half of the object's extent along a direction that is one of its axes, or across its round one.
    local = np.abs(witness.target.rotation.as_matrix().T @ normal)
    half_extent = float(np.linalg.norm(local * cell.target_spec.bounding_box().half_extents))
    surface = witness.camera.inv().apply(witness.target.translation + half_extent * normal)[2]
    x, y, _ = witness.camera.inv().apply(witness.target.translation)
    return {
        "depth": 1000 * float(witness.hand.tips - surface),
        "aside": 1000 * float(x),
        "along": 1000 * float(y),
    }


_BARELY, _TOO_TILTED, _TOO_TURNED = 5.0, 20.0, 20.0  # mm and deg, beyond which a grasp of these objects is chance
_TOO_FAR_ASIDE, _PUSHED, _TIPPED = 10.0, 10.0, 10.0  # mm, mm and deg


_NOT_SEEN = (GraspOutcome.TARGET_LOST, GraspOutcome.TARGET_NOT_FOUND, GraspOutcome.TOO_WIDE)
_STOPPED = (GraspOutcome.UNREACHABLE, GraspOutcome.JOINT_LIMIT, GraspOutcome.STALLED)


def _cause(grasp: Grasp, row: Row, witness: _Witness, placed: RigidTransform) -> Cause:
    """The first of the causes that holds, in the order in which they act."""
    outcome = grasp.outcome
    if outcome in _NOT_SEEN:
        return Cause.TARGET_LOST
    if outcome in _STOPPED and grasp.closed_at is None:
        return Cause.UNREACHABLE
    if row.get("depth", np.inf) < _BARELY and not grasp.landed:
        return Cause.TOO_EARLY
    tilted = max(row["error"], np.degrees(witness.error)) > _TOO_TILTED
    turned = abs(row["roll"]) > _TOO_TURNED or abs(np.degrees(witness.roll)) > _TOO_TURNED
    if tilted or turned or abs(row.get("aside", 0.0)) > _TOO_FAR_ASIDE:
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
