"""Grippers and descents that several tests share: a hand without a simulator, one with faults, readings made up."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from eye_in_hand import PinholeArm
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.evaluation import baselines
from gvp_lib.motion.arm import EyeInHandArm, Gripper, Hand
from gvp_lib.planning.grasp import Grasp, GraspOutcome, Reading
from gvp_lib.simulation.sensors import EpisodeNoise, Noise
from gvp_lib.simulation.workcell import WorkCell

HAND = Hand(sensor=-0.042, tips=0.078)  # the Baxter's
SHUT, WIDE = 0.028, 0.072  # m
DOWN = Rotation.from_rotvec([np.pi, 0.0, 0.0])  # a camera that looks straight down
REACH = (0.04, 0.4)  # m, of the sensor


class PlainGripper:
    """The least that a grasp needs: a hand over a level surface, through the origin, of something 30 mm wide.

    Parameters
    ----------
    arm
        That carries it.
    thickness
        Of what the fingers meet where their tips are below the surface, m.
    """

    def __init__(self, arm: EyeInHandArm, thickness: float = 0.030) -> None:
        self.arm, self.thickness = arm, thickness
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


class FaultyGripper:
    """A gripper that hands everything on, but for what is given in its place, and counts how often it was told.

    Parameters
    ----------
    close, width, range
        In place of the gripper's own, each called with this gripper.
    """

    def __init__(
        self,
        gripper: Gripper,
        *,
        close: Callable[[FaultyGripper], None] | None = None,
        width: Callable[[FaultyGripper], float] | None = None,
        range: Callable[[FaultyGripper], float] | None = None,
    ) -> None:
        self.gripper, self._close, self._width, self._range = gripper, close, width, range
        self.closed = 0

    @property
    def width(self) -> float:
        return self.gripper.width if self._width is None else self._width(self)

    @property
    def stroke(self) -> tuple[float, float]:
        return self.gripper.stroke

    @property
    def hand(self) -> Hand:
        return self.gripper.hand

    def open(self) -> None:
        self.gripper.open()

    def close(self) -> None:
        self.closed += 1
        if self._close is None:
            self.gripper.close()
        else:
            self._close(self)

    def range(self) -> float:
        return self.gripper.range() if self._range is None else self._range(self)


class Never:
    """A rule that never says to close."""

    def remaining(self, readings: Sequence[Reading], hand: Hand) -> float:
        return np.inf


class Asked:
    """Hands everything on, and notes what was asked for."""

    def __init__(self, one: object, names: set[str]) -> None:
        self._one, self._names = one, names

    def __getattr__(self, name: str) -> object:
        self._names.add(name)
        return getattr(self._one, name)


def above(*shapes: object, height: float = 0.25, off: Sequence[float] = (0.0, 0.0), turn: float = 0.0) -> PinholeArm:
    """A pinhole's arm over the origin that looks straight down, y along the base's, but for a turn on the spot that
    shows the origin ``off`` px from the middle, and a roll."""
    arm = PinholeArm(*shapes)  # type: ignore[arg-type]
    look = RigidTransform.from_components([0.0, 0.0, height], DOWN * Rotation.from_rotvec([0.0, 0.0, turn]))
    away, _ = Rotation.align_vectors([0.0, 0.0, 1.0], arm.intrinsics.rays(arm.intrinsics.principal_point + off))
    arm.stand_at(look * RigidTransform.from_rotation(away))
    return arm


def descent(
    *distances: float, step: float = 0.005, facing: Rotation = DOWN, aside: float = 0.0, landed: bool = False
) -> list[Reading]:
    """What the sensor said at each increment of a descent along the lens that ends where the base's origin is.

    Parameters
    ----------
    aside
        By how much each increment also goes across the lens, m.
    landed
        Whether a finger touches something at the last one.
    """
    n = len(distances)
    readings = []
    for k, distance in enumerate(distances):
        back = k - (n - 1)
        place = facing.apply([back * aside, 0.0, back * step])
        pose = RigidTransform.from_components(place, facing)
        readings.append(Reading(pose, distance, landed and k == n - 1))
    return readings


def sensed(noise: Noise, seed: int, ahead: float, n: int = 30, step: float = 0.005) -> list[float]:
    """Readings of a noisy sensor on a descent of ``n`` increments to where the surface is ``ahead`` of the camera."""
    episode = EpisodeNoise(noise, 7, np.random.SeedSequence(seed))
    return [episode.read(ahead + (n - 1 - k) * step - HAND.sensor, REACH) for k in range(n)]


def aligned(cell: WorkCell, seed: int | None = None, *, dynamic: bool = True) -> WorkCell:
    """A cell whose camera stands where the truth would have it, from where a grasp begins."""
    cell.dynamic = False
    cell.reset(seed)
    assert baselines.oracle(cell).outcome.arrived
    cell.dynamic = dynamic
    return cell


def check_grasp(done: Grasp) -> None:
    """What holds of every grasp, however it ended."""
    assert isinstance(done.outcome, GraspOutcome)
    assert (done.closed_at is None) is bool(np.isnan(done.width))
    assert done.landed is any(reading.landed for reading in done.readings)
    if done.closed_at is not None:
        # It closes where the rule said so.
        np.testing.assert_array_equal(done.closed_at.as_matrix(), done.readings[-1].base_from_camera.as_matrix())
