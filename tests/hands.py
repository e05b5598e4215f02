"""Grippers and descents that several tests share: a hand without a simulator, a rule, readings made up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from eye_in_hand import PinholeArm
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.evaluation.baselines import Oracle
from gvp_lib.motion.arm import EyeInHandArm, Hand, Outcome
from gvp_lib.motion.primitives import toward_pixel
from gvp_lib.planning.closing import Reading
from gvp_lib.planning.grasp import Grasp
from gvp_lib.planning.solids import FittedSolid
from gvp_lib.simulation.workcell import WorkCell

HAND = Hand(sensor=-0.042, tips=0.078)  # the Baxter's
SHUT, WIDE = 0.028, 0.072  # m
DOWN = Rotation.from_rotvec([np.pi, 0.0, 0.0])  # a camera that looks straight down
REACH = (0.04, 0.4)  # m, of the sensor


class PlainGripper:
    """The least that a grasp needs: a hand over a level surface, through the origin, of something 30 mm wide."""

    def __init__(self, arm: EyeInHandArm) -> None:
        self.arm, self.thickness = arm, 0.030
        self.width, self.stroke, self.hand = SHUT, (SHUT, WIDE), HAND
        self.told: list[str] = []

    def ahead(self) -> float:
        """From the camera to the surface along the optical axis, m."""
        pose = self.arm.camera_pose()
        return float(pose.translation[2] / -pose.rotation.as_matrix()[2, 2])

    def open(self) -> None:
        self.told.append("open")
        self.width = WIDE

    def close(self) -> None:
        self.told.append("close")
        self.width = self.thickness if self.hand.tips > self.ahead() else SHUT

    def range(self) -> float:
        distance = self.ahead() - self.hand.sensor
        return max(REACH[0], distance) if distance < REACH[1] else np.inf


class After:
    """A rule that says to close after so many increments: after infinitely many, never."""

    def __init__(self, increments: float) -> None:
        self.increments = increments

    def remaining(self, readings: Sequence[Reading], hand: Hand) -> float:
        return 0.0 if len(readings) > self.increments else np.inf


def above(*shapes: object, height: float = 0.25, off: Sequence[float] = (0.0, 0.0), turn: float = 0.0) -> PinholeArm:
    """A pinhole's arm over the origin that looks straight down, y along the base's, but for a turn on the spot that
    shows the origin ``off`` px from the middle, and a roll."""
    arm = PinholeArm(*shapes)  # type: ignore[arg-type]
    look = RigidTransform.from_components([0.0, 0.0, height], DOWN * Rotation.from_rotvec([0.0, 0.0, turn]))
    away = toward_pixel(arm.intrinsics, arm.intrinsics.principal_point + off).inv()
    arm.stand_at(look * RigidTransform.from_rotation(away))
    return arm


def descent(*distances: float, step: float = 0.005, facing: Rotation = DOWN, aside: float = 0.0) -> list[Reading]:
    """Readings at each increment, which may also go ``aside`` m across the lens, of a descent to the base's origin."""
    steps = np.arange(1 - len(distances), 1)
    poses = RigidTransform.from_components(facing.apply(steps[:, None] * [aside, 0.0, step]), facing)
    return [Reading(pose, distance) for pose, distance in zip(poses, distances, strict=True)]


def fitted(
    sizes: ArrayLike,
    top: tuple[float, float] = (0.0, 0.0),
    normal: ArrayLike = (0, 0, 1),
    center: ArrayLike = (0, 0, 0),
    turn: Rotation | None = None,
    kind: str = "box",
    residual: float = 0.05,
) -> FittedSolid:
    """A solid as if it had been fitted; its normal is given in its own frame."""
    pose = RigidTransform.from_components(center, turn or Rotation.identity())
    outward = pose.rotation.apply(np.asarray(normal, float))
    return FittedSolid(kind, pose, np.asarray(sizes, float), top, outward, 0.01, residual, np.zeros((0, 6)))


def aligned(cell: WorkCell, seed: int | None = None, *, dynamic: bool = True) -> WorkCell:
    """A cell whose camera stands where the truth would have it, from where a grasp begins."""
    cell.dynamic = False
    cell.reset(seed)
    assert Oracle(cell).plan(cell.arm).outcome.arrived
    cell.dynamic = dynamic
    return cell


def check_grasp(done: Grasp) -> None:
    """What holds of every grasp, however it ended."""
    assert isinstance(done.outcome, Outcome)
    assert (done.closed_at is None) is bool(np.isnan(done.width))
    assert done.landed is any(reading.landed for reading in done.readings)
    if done.closed_at is not None:
        # It closes where the rule said so.
        np.testing.assert_array_equal(done.closed_at.as_matrix(), done.readings[-1].base_from_camera.as_matrix())
