"""The simulated arm as a planner sees it, on one of two drives: joints that are simply there, or servos through time.

The encoders' readings and the true joint angles differ by the episode's noise. The planner gets the readings, the
drive the true angles; only :class:`~gvp_lib.simulation.truth.Truth` compares them. Both drives keep the same clock of
simulated seconds, ``data.time``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from itertools import pairwise
from math import hypot

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation, Slerp

from gvp_lib.errors import InvalidParameterError, ModelError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arm import Motion, StopReason
from gvp_lib.simulation.camera import CameraSensor, checked_pose
from gvp_lib.simulation.kinematics import ArmBodies, InverseKinematics
from gvp_lib.simulation.sensors import EpisodeNoise

__all__ = ["Drive", "DynamicDrive", "KinematicDrive", "SimulatedArm"]

_LINE_STEP = 0.01  # m, between the waypoints of a straight line
_TURN_STEP = np.radians(2.0)  # rad, turn of the camera between the same
_JOINT_STEP = 0.03  # rad, between the waypoints of a motion in joint space
_JOINT_LEAP = 0.5  # rad, per waypoint of a straight line: past this the solution has changed its branch
_ALIGNED = np.radians(0.5)  # rad, within which the last joint's axis counts as the camera's
_AT_LIMIT = np.radians(0.5)  # rad, within which of its limit a joint counts as stopped by it
_PHYSICS = mujoco.mjtState.mjSTATE_INTEGRATION


class KinematicDrive:
    """Joints that are simply where they should be, checked for collision at every waypoint: for speed.

    Objects stay where they are. The clock advances by the time that the slowest joint needs.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, arm: ArmBodies, on_waypoint: Callable[[], None]
    ) -> None:
        self._model, self._data, self._arm, self._on_waypoint = model, data, arm, on_waypoint

    def put(self, q: NDArray[np.float64]) -> None:
        """Set the joints at once, outside of time, as when an episode is set up."""
        self._arm.put(self._model, self._data, q)

    def follow(self, path: Sequence[NDArray[np.float64]]) -> StopReason:
        """Step from waypoint to waypoint; a colliding one is not entered. REACHED, or why it stopped."""
        for q in path:
            before = self._data.qpos[self._arm.qpos].copy()
            self.put(q)
            if self._arm.touching(self._data):
                self.put(before)
                return StopReason.COLLISION
            self._data.time += self._arm.seconds(before, q)
            self._on_waypoint()
        return StopReason.REACHED

    def joints(self) -> NDArray[np.float64]:
        """True joint angles, shape (n,), rad; a copy."""
        return self._data.qpos[self._arm.qpos]

    def idle(self, seconds: float) -> None:
        """Let time pass: nothing moves."""
        self._data.time += seconds
        self._on_waypoint()


class DynamicDrive:
    """Position servos and ``mj_step``: for realism. Objects can be pushed, tipped and carried.

    Parameters
    ----------
    on_step
        Callbacks after every step of physics.
    stop_force
        Contact force on the arm at which it stops to protect itself, N.
    """

    _SETTLED = np.radians(0.02)  # rad, and rad per 10 ms
    _THERE = np.radians(1.0)  # rad: a load may hold the servos off by as much, and they have still arrived
    _WATCH_EVERY = 0.033  # s
    _TRAVEL = 0.0005  # m, of a free body in a step, the skin of a pad: more, and the step is done again in parts
    _PARTS = 8

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        arm: ArmBodies,
        on_waypoint: Callable[[], None],
        on_step: Sequence[Callable[[], None]] = (),
        *,
        stop_force: float = 15.0,
    ) -> None:
        self._on_step = on_step
        self._model, self._data, self._arm, self._on_waypoint = model, data, arm, on_waypoint
        self._stop_force = stop_force
        self._actuators = np.array([_servo_of(model, joint) for joint in arm.joints])
        # How far behind its target, in seconds of motion, a servo's damping holds its joint: leading by as much, the
        # joints are on the path rather than after it, and little is left to settle.
        damping = model.dof_damping[arm.dofs] - model.actuator_biasprm[self._actuators, 2]
        self._lag = damping / model.actuator_gainprm[self._actuators, 0]  # s
        self._last_watch = -np.inf
        self._before = np.empty(mujoco.mj_stateSize(model, _PHYSICS))
        free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        self._free = model.jnt_dofadr[free][:, None] + np.arange(6)  # (k, 6)
        reach = np.linalg.norm(model.geom_pos, axis=1) + model.geom_rbound
        self._reach = [reach[model.geom_bodyid == body].max(initial=0.0) for body in model.jnt_bodyid[free]]  # m
        self.held: frozenset[int] = frozenset()  # geoms in the fingers; their contacts do not stop the arm

    def put(self, q: NDArray[np.float64]) -> None:
        """Set the joints and their servos, at rest, with nothing in the fingers."""
        self.held = frozenset()
        self._data.qpos[self._arm.qpos] = q
        self._data.qvel[:] = 0
        self._data.ctrl[self._actuators] = q
        mujoco.mj_forward(self._model, self._data)

    def follow(self, path: Sequence[NDArray[np.float64]]) -> StopReason:
        """Lead the servos along the path at a smooth pace, then let them settle. REACHED, or why it stopped."""
        if not len(path):
            return StopReason.REACHED
        knots = np.vstack([self._data.ctrl[self._actuators], *path])  # (k, n)
        steps = [self._arm.seconds(a, b) for a, b in pairwise(knots)]
        arrival = np.concatenate([[0.0], np.cumsum(steps)])  # s
        # Ease in and out, so that no servo is asked for a jump of speed; 1.5 is the easing's top speed.
        duration, step = 1.5 * arrival[-1], self._model.opt.timestep
        s = np.minimum(1.0, np.arange(int(np.ceil(duration / step))) * step / duration)  # (m,)
        along = arrival[-1] * s * s * (3 - 2 * s)
        speed = arrival[-1] * 6 * s * (1 - s) / duration
        here, ahead = (self._at(a, arrival, knots) for a in (along, along + 1e-3))
        for q in here + (speed[:, None] * 1e3) * self._lag * (ahead - here):
            self._lead(q)
            if self._pressed():
                return self._protect()
        self._lead(knots[-1])
        return self._settle(knots[-1])

    @staticmethod
    def _at(
        along: NDArray[np.float64], arrival: NDArray[np.float64], knots: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Joint angles on the path at times ``along``, shape (m,), s: shape (m, n), rad."""
        k = np.clip(np.searchsorted(arrival, along) - 1, 0, len(arrival) - 2)
        span = arrival[k + 1] - arrival[k]
        share = np.minimum(1.0, np.divide(along - arrival[k], span, out=np.ones_like(along), where=span > 0))
        return np.asarray(knots[k] + share[:, None] * (knots[k + 1] - knots[k]))

    def joints(self) -> NDArray[np.float64]:
        """True joint angles, shape (n,), rad; a copy."""
        return self._data.qpos[self._arm.qpos]

    def idle(self, seconds: float) -> None:
        """Let time pass with the servos holding."""
        for _ in range(int(np.ceil(seconds / self._model.opt.timestep))):
            self._step()
        mujoco.mj_forward(self._model, self._data)

    def _settle(self, q: NDArray[np.float64], limit: float = 1.0) -> StopReason:
        end = self._data.time + limit
        while self._data.time < end:
            self.idle(0.01)
            if self._pressed():
                return self._protect()
            still = np.abs(self._data.qvel[self._arm.dofs]).max() * 0.01 < self._SETTLED
            if still and np.abs(self.joints() - q).max() < self._SETTLED:
                break
        return StopReason.REACHED if np.abs(self.joints() - q).max() < self._THERE else StopReason.STALLED

    def _protect(self) -> StopReason:
        """Stop pushing: hold where the arm is."""
        self._data.ctrl[self._actuators] = self.joints()
        self.idle(0.1)
        return StopReason.CONTACT

    def _lead(self, q: Sequence[float] | NDArray[np.float64]) -> None:
        self._data.ctrl[self._actuators] = q
        self._step()

    def _step(self) -> None:
        mujoco.mj_getState(self._model, self._data, self._before, _PHYSICS)
        mujoco.mj_step(self._model, self._data)
        if self._fastest() * self._model.opt.timestep > self._TRAVEL:
            self._step_again()
        for callback in self._on_step:
            callback()
        if self._data.time - self._last_watch >= self._WATCH_EVERY or self._data.time < self._last_watch:
            self._last_watch = self._data.time
            self._on_waypoint()

    def _fastest(self) -> float:
        """Upper bound on the speed of any point of a free body, m/s."""
        moving = zip(self._reach, self._data.qvel[self._free].tolist(), strict=True)
        return max((hypot(x, y, z) + reach * hypot(a, b, c) for reach, (x, y, z, a, b, c) in moving), default=0.0)

    def _step_again(self) -> None:
        """Repeat the last step in smaller ones.

        After a whole one, what snaps flat in the hand, or rattles in it, would be millimeters inside a finger.
        """
        mujoco.mj_setState(self._model, self._data, self._before, _PHYSICS)
        step = self._model.opt.timestep
        try:
            self._model.opt.timestep = step / self._PARTS
            for _ in range(self._PARTS):
                mujoco.mj_step(self._model, self._data)
        finally:
            self._model.opt.timestep = step

    def _pressed(self) -> bool:
        """Whether something that the arm does not hold presses on it harder than ``stop_force``."""
        data = self._data
        if not data.ncon:
            return False
        of_arm = self._arm.geoms[data.contact.geom]  # (ncon, 2)
        force = np.zeros(6)
        for i in np.flatnonzero(of_arm.any(axis=1) & (data.contact.dist < data.contact.includemargin)):
            if self.held.intersection(data.contact.geom[i].tolist()):
                continue
            mujoco.mj_contactForce(self._model, data, i, force)
            if force[0] > self._stop_force:
                return True
        return False


Drive = KinematicDrive | DynamicDrive
"""What moves an arm's joints through a list of true configurations."""


class SimulatedArm:
    """Arm in a work cell. Implements :class:`gvp_lib.motion.arm.EyeInHandArm`."""

    def __init__(self, kinematics: InverseKinematics, drive: Drive, sensor: CameraSensor) -> None:
        self._kinematics, self._sensor = kinematics, sensor
        self.move_by(drive)
        self._landing_error = np.zeros(len(kinematics.limits[0]))  # rad, of the motion that goes on or was the last

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """Stated intrinsics; under ``Noise.focal_length`` and ``distortion`` the true lens differs a little."""
        return self._sensor.intrinsics

    @property
    def joints(self) -> NDArray[np.float64]:
        """Joint angles as the encoders read them, shape (n,), rad; a copy."""
        return self._drive.joints() - self._noise.joint_offset - self._landing_error

    def capture(self) -> NDArray[np.uint8]:
        """RGB image, shape (height, width, 3)."""
        return self._sensor.capture(self._noise)

    def camera_pose(self) -> RigidTransform:
        """``base_from_camera`` as the arm believes it."""
        return self._kinematics.forward(self.joints)

    def move_camera(self, camera_from_target: RigidTransform) -> Motion:
        """Move the camera along a straight line to a pose given in its present frame.

        The line is solved waypoint by waypoint, each from the one before. Where a waypoint has no solution, the arm
        stops at the last that had one.
        """
        checked_pose(camera_from_target, "camera_from_target")
        q = self.joints
        start = self._kinematics.forward(q)
        length, angle = np.linalg.norm(camera_from_target.translation), camera_from_target.rotation.magnitude()
        n = max(1, int(np.ceil(max(length / _LINE_STEP, angle / _TURN_STEP))))
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

        Where the camera does not look along that joint's axis, the whole arm takes part and the camera turns on the
        spot.
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
        """Sign of the camera's roll as the last joint turns: +1, -1, or 0 where their axes are not aligned."""
        q = self.joints
        nudged = q + np.eye(len(q))[-1] * 1e-3
        turn = (self._kinematics.forward(q).inv() * self._kinematics.forward(nudged)).rotation.as_rotvec()
        aligned = abs(turn[2]) > np.cos(_ALIGNED) * 1e-3
        return float(np.sign(turn[2])) if aligned else 0.0

    def begin_episode(self, noise: EpisodeNoise) -> None:
        """Adopt an episode's noise; called by the cell's ``reset``."""
        self._noise = noise
        self._sensor.focus(noise.focal_scale, noise.distortion)

    def move_by(self, drive: Drive) -> None:
        """Let this drive move the joints from now on; called by the cell."""
        self._drive = drive

    def stand_at(self, q: NDArray[np.float64]) -> None:
        """Stand at once where the joints *truly* are at ``q``; called by the cell as it sets up an episode."""
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


def _servo_of(model: mujoco.MjModel, joint: int) -> int:
    """Id of the position servo that drives a joint."""
    of_joint = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT) & (model.actuator_trnid[:, 0] == joint)
    is_servo = model.actuator_biastype == mujoco.mjtBias.mjBIAS_AFFINE
    found = np.flatnonzero(of_joint & is_servo)
    if not len(found):
        name = model.joint(joint).name.split("/", 1)[-1]  # as its own MJCF has it
        raise ModelError(
            f"joint {name!r} has no position servo, which the dynamic mode needs; give the MJCF an "
            "<actuator><position joint=.../></actuator>, or use the kinematic mode (dynamic=False)"
        )
    return int(found[0])
