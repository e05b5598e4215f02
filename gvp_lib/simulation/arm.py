"""The simulated arm as a planner sees it: an `EyeInHandArm` on one of the two drives.

What the encoders read and where the joints truly are differ by the episode's noise; the planner gets the
first, the drive the second, and only :class:`~gvp_lib.simulation.truth.Truth` compares them.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation, Slerp

from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arm import Motion, StopReason
from gvp_lib.simulation.drive import Drive
from gvp_lib.simulation.frames import checked_pose
from gvp_lib.simulation.inverse_kinematics import InverseKinematics
from gvp_lib.simulation.sensors import CameraSensor, EpisodeNoise

__all__ = ["SimulatedArm"]

_LINE_STEP = 0.01  # m, between the waypoints of a straight line
_TURN_STEP = np.radians(2.0)  # rad, of the camera, between the same
_JOINT_STEP = 0.03  # rad, between the waypoints of a motion in joint space
_JOINT_LEAP = 0.5  # rad, per waypoint of a straight line: past this the solution has changed its branch
_ALIGNED = np.radians(0.5)  # rad, within which the last joint's axis counts as the camera's
_AT_LIMIT = np.radians(0.5)  # rad, how near a joint is to its limit when the limit is what stopped it


class SimulatedArm:
    """An arm in a work cell. Implements :class:`gvp_lib.motion.arm.EyeInHandArm`."""

    def __init__(self, kinematics: InverseKinematics, drive: Drive, sensor: CameraSensor, noise: EpisodeNoise) -> None:
        self._kinematics, self._sensor = kinematics, sensor
        self.move_by(drive)
        self._landing_error = np.zeros(len(kinematics.limits[0]))  # rad, of the motion that goes on or was the last
        self.begin_episode(noise)

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """The lens as stated; under ``Noise.focal_length`` and ``distortion`` the true one differs a little."""
        return self._sensor.intrinsics

    @property
    def joints(self) -> NDArray[np.float64]:
        """Joint angles as the encoders read them, shape (n,), rad; a copy."""
        return self._drive.joints() - self._noise.joint_offset - self._landing_error

    def capture(self) -> NDArray[np.uint8]:
        """One RGB image, shape (height, width, 3)."""
        return self._sensor.capture(self._noise)

    def camera_pose(self) -> RigidTransform:
        """``base_from_camera`` as the arm believes it."""
        return self._kinematics.forward(self.joints)

    def move_camera(self, camera_from_target: RigidTransform) -> Motion:
        """Move the camera along a straight line to a pose given in its present frame.

        The line is solved waypoint by waypoint, each from the one before. Where a waypoint has no solution
        the arm stops at the last that had one.
        """
        checked_pose(camera_from_target, "camera_from_target")
        q = self.joints
        start = self._kinematics.forward(q)
        n = _waypoints(camera_from_target)
        along = np.linspace(0, 1, n + 1)[1:]
        ends = np.stack([start.as_matrix(), (start * camera_from_target).as_matrix()])
        turn = Slerp([0, 1], Rotation.from_matrix(ends[:, :3, :3]))
        positions = start.apply(along[:, None] * camera_from_target.translation)
        # All at once: one by one, SciPy's checks would take as long as the solver.
        line = RigidTransform.from_components(positions, turn(along))
        path: list[NDArray[np.float64]] = []
        blocked: StopReason | None = None
        for base_from_camera in line:
            solved = self._kinematics.solve(base_from_camera, q)
            if solved is None or np.abs(solved - q).max() > _JOINT_LEAP:
                blocked = self._why_unsolved(q)
                break
            path.append(solved)
            q = solved
        reason = self._follow(path)
        if reason is StopReason.REACHED and blocked is not None:
            reason = blocked
        return Motion(reason is StopReason.REACHED, reason)

    def move_joints(self, q: ArrayLike) -> Motion:
        """Move straight in joint space to ``q``, shape (n,), rad. Beyond a joint limit nothing moves."""
        goal, start = np.array(q, float), self.joints
        if goal.shape != start.shape or not np.isfinite(goal).all():
            raise InvalidParameterError(
                f"this arm has {len(start)} joints: q is {len(start)} finite angles in rad; got {q!r}"
            )
        low, high = self._kinematics.limits
        if (goal < low).any() or (goal > high).any():
            return Motion(False, StopReason.JOINT_LIMIT)
        n = max(1, int(np.ceil(np.abs(goal - start).max() / _JOINT_STEP)))
        reason = self._follow([start + (goal - start) * (k / n) for k in range(1, n)] + [goal])
        return Motion(reason is StopReason.REACHED, reason)

    def rotate_wrist(self, angle: float) -> Motion:
        """Turn the camera by ``angle`` rad about its optical axis with the last joint alone.

        Where the camera does not look along that joint's axis, as on somebody's arm it may not, the whole arm
        takes part and the camera turns on the spot.
        """
        if not abs(angle) <= 4 * np.pi:
            raise InvalidParameterError(
                f"the wrist turns by a finite angle, in rad, of two turns at most; got {angle}. "
                "If degrees were meant: np.radians(angle)"
            )
        if self._wrist_sense == 0:
            return self.move_camera(RigidTransform.from_rotation(Rotation.from_rotvec([0.0, 0.0, angle])))
        goal = self.joints
        goal[-1] += angle * self._wrist_sense
        return self.move_joints(goal)

    @cached_property
    def _wrist_sense(self) -> float:
        """+1 where the last joint turns with the camera's roll, -1 where it turns against it, 0 where neither."""
        q = self.joints
        nudged = q + np.eye(len(q))[-1] * 1e-3
        turn = (self._kinematics.forward(q).inv() * self._kinematics.forward(nudged)).rotation.as_rotvec()
        aligned = abs(turn[2]) > np.cos(_ALIGNED) * 1e-3
        return float(np.sign(turn[2])) if aligned else 0.0

    def begin_episode(self, noise: EpisodeNoise) -> None:
        """Take an episode's noise; for the cell, when it sets one up."""
        self._noise = noise
        self._sensor.focus(noise.focal_scale, noise.distortion)

    def move_by(self, drive: Drive) -> None:
        """Let this drive move the joints from now on; for the cell."""
        self._drive = drive

    def stand_at(self, q: NDArray[np.float64]) -> None:
        """Stand at once where the joints *truly* are at ``q``; for the cell, when it sets up an episode."""
        self._landing_error[:] = 0
        self._drive.put(q)

    def _follow(self, path: list[NDArray[np.float64]]) -> StopReason:
        """Follow a path of encoder readings."""
        if not path:
            return StopReason.REACHED
        self._landing_error = self._noise.landing_error(len(self._landing_error))
        return self._drive.follow([q + self._noise.joint_offset + self._landing_error for q in path])

    def _why_unsolved(self, q: NDArray[np.float64]) -> StopReason:
        low, high = self._kinematics.limits
        near = np.minimum(q - low, high - q).min() < _AT_LIMIT
        return StopReason.JOINT_LIMIT if near else StopReason.UNREACHABLE


def _waypoints(camera_from_target: RigidTransform) -> int:
    line = np.linalg.norm(camera_from_target.translation) / _LINE_STEP
    turn = camera_from_target.rotation.magnitude() / _TURN_STEP
    return max(1, int(np.ceil(max(line, turn))))
