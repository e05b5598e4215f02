"""What a planner may know and do: the protocols of an arm with a camera in its hand, and of its gripper.

Whoever writes these members for a real robot can run every planner of this library on it. There is no way
through them to the pose of the object, because a real robot has none.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics

__all__ = ["EyeInHandArm", "Gripper", "Hand", "Motion", "StopReason"]


class StopReason(Enum):
    """Why a motion ended."""

    REACHED = "reached"
    JOINT_LIMIT = "joint limit"
    COLLISION = "collision"
    UNREACHABLE = "unreachable"  # no joint angles put the camera on the next part of the path
    CONTACT = "contact"  # dynamic mode: the arm felt something and stopped to protect itself
    STALLED = "stalled"  # dynamic mode: the servos did not get there in time


@dataclass(frozen=True, slots=True)
class Motion:
    """Outcome of one motion: whether the arm reached its goal, and why it stopped.

    A motion that stops early leaves the arm where it stopped.
    """

    reached: bool
    reason: StopReason

    def __post_init__(self) -> None:
        if self.reached != (self.reason is StopReason.REACHED):
            raise InvalidParameterError(
                f"a motion has reached its goal or has another reason to end; reached is {self.reached} and the reason "
                f"{self.reason.value!r}"
            )

    def __bool__(self) -> bool:
        return self.reached


@dataclass(frozen=True, slots=True)
class Hand:
    """Places of a hand's parts along the camera's optical axis, m from its optical center; behind it is negative.

    Attributes
    ----------
    sensor
        Range sensor: a surface that it sees at distance d lies ``sensor + d`` ahead of the camera.
    tips
        Fingertips.
    palm
        Part of the hand that stands furthest forward between the fingers; nothing can come nearer than that.
    """

    sensor: float
    tips: float
    palm: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite([self.sensor, self.tips, self.palm]).all() and self.tips > max(self.sensor, self.palm)):
            raise InvalidParameterError(
                "a hand's fingertips stand ahead of its sensor and its palm, in m along the optical axis; got sensor "
                f"{self.sensor}, tips {self.tips}, palm {self.palm}"
            )


@runtime_checkable
class EyeInHandArm(Protocol):
    """An arm with one RGB camera in its hand. Frames: ``base`` is the arm's own; meters and radians."""

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """The lens as the factory or a calibration describes it; the true one may differ a little."""

    @property
    def joints(self) -> NDArray[np.float64]:
        """Joint angles as the encoders read them, shape (n,), rad; a copy."""

    def capture(self) -> NDArray[np.uint8]:
        """One RGB image, shape (height, width, 3), from where the arm stands."""

    def camera_pose(self) -> RigidTransform:
        """``base_from_camera`` as the arm believes it, from its encoders and its own kinematics."""

    def move_camera(self, camera_from_target: RigidTransform) -> Motion:
        """Move the camera to a pose given in its present frame, along a straight line, checked on the way."""

    def move_joints(self, q: ArrayLike) -> Motion:
        """Move to joint angles ``q``, shape (n,), rad, straight in joint space, checked on the way."""

    def rotate_wrist(self, angle: float) -> Motion:
        """Turn the last joint so that the camera turns by ``angle`` rad about its optical axis, from its x towards its
        y axis. Where the camera looks along that joint's axis, only it moves: little to solve, little to collide."""


@runtime_checkable
class Gripper(Protocol):
    """A parallel gripper with a range sensor in its palm. Its fingers close along the camera's x axis."""

    @property
    def width(self) -> float:
        """Distance between the finger pads, m."""

    @property
    def stroke(self) -> tuple[float, float]:
        """That distance when shut and when fully open, m."""

    @property
    def hand(self) -> Hand:
        """Where sensor, fingertips and palm are, against the camera."""

    def open(self) -> None:
        """Open fully."""

    def close(self) -> None:
        """Close until the fingers meet each other or an object."""

    def range(self) -> float:
        """Distance to what the sensor sees along the hand's axis, m; ``inf`` where it sees nothing."""
