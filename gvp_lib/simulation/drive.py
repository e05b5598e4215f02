"""How joints follow a path: at once and exactly, or pushed by servos through time.

Both drives know only *true* joint angles; what the encoders make of them is the arm's business
(:mod:`gvp_lib.simulation.arm`). Both keep the same clock of simulated seconds, ``data.time``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import hypot
from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from gvp_lib.errors import ModelError
from gvp_lib.motion.arm import StopReason

__all__ = ["PACE", "ArmBodies", "Drive", "DynamicDrive", "KinematicDrive"]


PACE = 0.25
"""Of the joints' speed limits, at which an arm beside people works: its hand then moves some 0.25 m/s."""


class Drive(Protocol):
    """Puts the joints through a list of true configurations."""

    def follow(self, path: Sequence[NDArray[np.float64]]) -> StopReason:
        """Follow the path; REACHED, or why it stopped. The joints stay where they stopped."""
        ...

    def put(self, q: NDArray[np.float64]) -> None:
        """Set the joints at once, outside of time, as when an episode is set up."""
        ...

    def joints(self) -> NDArray[np.float64]:
        """The true joint angles, shape (n,), rad; a copy."""
        ...

    def idle(self, seconds: float) -> None:
        """Let time pass."""
        ...


class ArmBodies:
    """Which joints of a scene are the arm's, and which geoms they move."""

    def __init__(self, model: mujoco.MjModel, prefix: str, joints: Sequence[str], speeds: NDArray[np.float64]) -> None:
        ids = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, prefix + name) for name in joints]
        self.joints = np.array(ids)
        self.qpos = model.jnt_qposadr[self.joints]
        self.dofs = model.jnt_dofadr[self.joints]
        self.speeds = speeds  # rad/s
        # What the joints carry. The rest of a model, a pedestal or a puck on a slide, stands where it stands
        # whatever the arm does: that it touches something is no collision of the arm.
        carried = np.zeros(model.nbody, bool)
        carried[model.jnt_bodyid[self.joints]] = True
        for body in range(1, model.nbody):  # parents come before their children
            carried[body] |= carried[model.body_parentid[body]]
        self.geoms = carried[model.geom_bodyid]  # (ngeom,) bool

    def touching(self, data: mujoco.MjData) -> bool:
        """Whether anything that the joints move is in contact, with the arm itself or with anything else."""
        contact = data.contact
        return bool(data.ncon and (self.geoms[contact.geom].any(axis=1) & (contact.dist < 0)).any())

    def seconds(self, a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
        """Time from one configuration to another at the arm's working pace, s."""
        return float(np.max(np.abs(b - a) / (PACE * self.speeds)))


class KinematicDrive:
    """Joints that are simply there, checked for collision at every waypoint: for speed.

    Objects stay where they are. The clock advances by the time that the slowest joint needs.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, arm: ArmBodies, on_waypoint: Callable[[], None]
    ) -> None:
        self._model, self._data, self._arm, self._on_waypoint = model, data, arm, on_waypoint

    def put(self, q: NDArray[np.float64]) -> None:
        """Set the joints and bring everything that follows from them up to date."""
        self._data.qpos[self._arm.qpos] = q
        self._data.qvel[:] = 0
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        mujoco.mj_collision(self._model, self._data)

    def follow(self, path: Sequence[NDArray[np.float64]]) -> StopReason:
        """Step from waypoint to waypoint; a colliding one is not entered."""
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
        """The true joint angles, shape (n,), rad; a copy."""
        return self._data.qpos[self._arm.qpos]

    def idle(self, seconds: float) -> None:
        """Let time pass: nothing moves."""
        self._data.time += seconds
        self._on_waypoint()


_PHYSICS = mujoco.mjtState.mjSTATE_INTEGRATION


class DynamicDrive:
    """Position servos and ``mj_step``: for truth. Objects can be pushed, tipped and carried.

    Parameters
    ----------
    on_step
        Called after every step of physics.
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
        """Lead the servos along the path at a smooth pace, then let them settle."""
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
        """Where on the path the joints are at times of shape (m,), shape (m, n), rad."""
        k = np.clip(np.searchsorted(arrival, along) - 1, 0, len(arrival) - 2)
        span = arrival[k + 1] - arrival[k]
        share = np.minimum(1.0, np.divide(along - arrival[k], span, out=np.ones_like(along), where=span > 0))
        return np.asarray(knots[k] + share[:, None] * (knots[k + 1] - knots[k]))

    def joints(self) -> NDArray[np.float64]:
        """The true joint angles, shape (n,), rad; a copy."""
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
        """Of all that is free to move, the speed of its farthest point, m/s, or a little more."""
        moving = zip(self._reach, self._data.qvel[self._free].tolist(), strict=True)
        return max((hypot(x, y, z) + reach * hypot(a, b, c) for reach, (x, y, z, a, b, c) in moving), default=0.0)

    def _step_again(self) -> None:
        """The last step in smaller ones: what snaps flat in the hand, or rattles in it, is millimeters into a finger
        after a whole one."""
        mujoco.mj_setState(self._model, self._data, self._before, _PHYSICS)
        step = self._model.opt.timestep
        try:
            self._model.opt.timestep = step / self._PARTS
            for _ in range(self._PARTS):
                mujoco.mj_step(self._model, self._data)
        finally:
            self._model.opt.timestep = step

    def _pressed(self) -> bool:
        """Whether something that the arm does not hold presses on it harder than it should."""
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


def _servo_of(model: mujoco.MjModel, joint: int) -> int:
    """The position servo that drives a joint."""
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
