"""What a planner may know and do: the protocols of an arm with a camera in its hand and of its gripper, and how a
motion, or whatever is made of motions, ends.

Whoever writes these members for a real robot can run every planner of this library on it. They lead nowhere near the
pose of the object, which a real robot does not know either.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError, UnknownNameError
from gvp_lib.geometry.camera import CameraIntrinsics

__all__ = ["EyeInHandArm", "Gripper", "Hand", "STOPS", "Motion", "Outcome"]


class Outcome(StrEnum):
    """How a motion, an arc, a plan, a grasp, or an episode ended: one vocabulary for all of them.

    Each member is also its text, so that ``outcome == "target lost"`` holds and results store it as it is.

    Examples
    --------
    >>> Outcome("joint limit") is Outcome.JOINT_LIMIT, Outcome.ALIGNED.arrived
    (True, True)
    >>> print(Outcome.TARGET_LOST)
    target lost
    """

    REACHED = "reached"  # a motion or a centering got where it was to go
    # A plan or an episode whose camera stands where the planner wants it.
    ALIGNED = "aligned"
    ANY_ANGLE = "any angle"  # all views along an arc look alike, so that any angle along it is as good
    UNEXPLAINED = "unexplained"  # no solid that the estimator knows explains the views: it may be far off
    # A plan whose views show no best viewpoint; the camera stands at the last arc's center.
    NO_STATIONARY_POINT = "no stationary point"  # it may lie beyond the arc
    TOO_FEW_VIEWS = "too few views"
    # A closed loop.
    OUT_OF_STEPS = "out of steps"  # the policy would go on
    UNDER_WAY = "under way"  # the episode goes on
    # An arc, on one side.
    MAX_ANGLE = "max angle"  # as far as was asked for
    ENOUGH = "enough"  # the caller had seen enough
    # The object.
    TARGET_NOT_FOUND = "target not found"  # nothing in view to begin with
    TARGET_LOST = "target lost"
    NOT_CENTERED = "not centered"  # the arm moves, and the object does not come to the middle of the image
    TOO_LARGE = "too large"  # the mask fills the image: it takes in the background, or the object does not fit
    # The arm.
    JOINT_LIMIT = "joint limit"
    COLLISION = "collision"
    UNREACHABLE = "unreachable"  # no joint angles put the camera on the next part of the path
    CONTACT = "contact"  # dynamic mode: the arm felt something and stopped to protect itself
    STALLED = "stalled"  # dynamic mode: the servos did not get there in time
    # A grasp, as far as the hand can tell.
    HELD = "held"  # lifted, with something between the fingers
    SLIPPED = "slipped"  # it was between the fingers, and is not after the lift
    EMPTY = "closed on nothing"
    JAMMED = "jammed"  # commanded to close, the fingers did not move
    TOO_WIDE = "too wide"  # for the open fingers; nothing was touched
    NEVER_CLOSED = "never closed"  # the closing rule did not say to

    @classmethod
    def _missing_(cls, value: object) -> Outcome:
        raise UnknownNameError("outcome", value, [member.value for member in cls])

    @property
    def arrived(self) -> bool:
        """Whether the camera stands where the planner wants it."""
        return self in (Outcome.ALIGNED, Outcome.ANY_ANGLE, Outcome.UNEXPLAINED)


STOPS = (Outcome.JOINT_LIMIT, Outcome.COLLISION, Outcome.UNREACHABLE, Outcome.CONTACT, Outcome.STALLED)
"""Why a motion may stop early."""


@checked
@dataclass(frozen=True, slots=True)
class Motion:
    """Result of one motion, true where the arm reached its goal.

    A motion that stops early leaves the arm where it stopped.

    Parameters
    ----------
    reached
        Whether the arm reached its goal.
    reason
        Why it stopped: ``REACHED``, or what was in the way.

    Examples
    --------
    >>> bool(Motion(False, Outcome.JOINT_LIMIT))
    False
    """

    reached: bool
    reason: Outcome

    def __post_init__(self) -> None:
        if self.reason not in ((Outcome.REACHED,) if self.reached else STOPS):
            stops = ", ".join(f"Outcome.{stop.name}" for stop in STOPS)
            raise InvalidParameterError(
                "a motion that reached its goal has the reason Outcome.REACHED, and one that did not has one of "
                f"{stops}; got reached={self.reached} and reason={self.reason!r}"
            )
        object.__setattr__(self, "reason", Outcome(self.reason))  # whoever writes an arm may give its text

    def __bool__(self) -> bool:
        return self.reached

    def __repr__(self) -> str:
        return f"Motion({self.reason})"


@checked
@dataclass(frozen=True, slots=True)
class Hand:
    """Places of a hand's parts along the camera's optical axis, m ahead of its optical center, and a fingertip's size.

    Parameters
    ----------
    sensor
        Range sensor, m, negative where it stands behind the camera: a surface that it sees at distance d lies
        ``sensor + d`` ahead of the camera.
    tips
        Fingertips, m.
    palm
        Foremost part of the hand between the fingers, m; no object can come nearer.
    thickness, breadth
        Thickness of a fingertip, from its pad outward along the camera's x axis, and its breadth along y, m: what room
        the fingers need beside the object. 0 where unknown.

    Examples
    --------
    >>> from gvp_lib.motion import Hand
    >>> Hand(sensor=-0.042, tips=0.078)
    Hand(sensor=-0.042, tips=0.078, palm=0.0, thickness=0.0, breadth=0.0)
    """

    sensor: float
    tips: float
    palm: float = 0.0
    thickness: float = 0.0
    breadth: float = 0.0

    def __post_init__(self) -> None:
        if not (0 <= self.thickness < np.inf and 0 <= self.breadth < np.inf):
            raise InvalidParameterError(
                "a fingertip's thickness and breadth are in m, and 0 where unknown; got thickness "
                f"{self.thickness}, breadth {self.breadth}"
            )
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
        """Move the camera along a straight line, checked on the way.

        Parameters
        ----------
        camera_from_target
            Goal pose in the camera's present frame.
        """

    def move_joints(self, q: ArrayLike) -> Motion:
        """Move straight in joint space, checked on the way.

        Parameters
        ----------
        q
            Goal joint angles, shape (n,), rad.
        """

    def rotate_wrist(self, angle: float) -> Motion:
        """Turn the last joint so that the camera turns about its optical axis.

        Where the camera looks along that joint's axis, no other joint moves: little to solve, little to collide.

        Parameters
        ----------
        angle
            Angle, rad, from the camera's x toward its y axis.
        """


@runtime_checkable
class Gripper(Protocol):
    """Parallel gripper with a range sensor in its palm, whose fingers close along the camera's x axis."""

    @property
    def width(self) -> float:
        """Distance between the finger pads, m."""

    @property
    def stroke(self) -> tuple[float, float]:
        """Distance between the pads when shut and when fully open, m."""

    @property
    def hand(self) -> Hand:
        """Places of sensor, fingertips, and palm relative to the camera."""

    def open(self) -> None:
        """Open fully."""

    def close(self) -> None:
        """Close until the fingers meet each other or an object."""

    def range(self) -> float:
        """Read the distance to what the sensor sees along the hand's axis, m; ``inf`` where it sees nothing."""
