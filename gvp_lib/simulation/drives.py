"""Drives that move a simulated arm's joints: kinematically, from waypoint to waypoint, or by servos under physics.

Both know true joint angles only, and keep the same clock of simulated seconds, ``data.time``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import hypot

import mujoco
import numpy as np
from numpy.typing import NDArray

from gvp_lib.errors import ModelError
from gvp_lib.motion.arm import Outcome
from gvp_lib.picture import count
from gvp_lib.simulation.arms import ArmSpec
from gvp_lib.simulation.scene import ARM_PREFIX

__all__ = ["PACE", "DynamicDrive", "KinematicDrive"]

PACE = 0.25
"""Fraction of the joints' speed limits at which an arm works beside people: its hand then moves at some 0.25 m/s."""

_STOP_FORCE = 15.0  # N, of a contact on the arm, at which it stops to protect itself
_SETTLE_TIMEOUT = 1.0  # s, for the servos
_SETTLED = np.radians(0.02)  # rad, and rad per 10 ms
_ARRIVED = np.radians(1.0)  # rad: a load may hold the servos off by as much, and they have still arrived
_WATCH_EVERY = 0.033  # s
_MAX_TRAVEL = 0.0005  # m, of a free body in a step, the skin of a pad: beyond it, the step is redone in substeps
_SUBSTEPS = 8
_PHYSICS = mujoco.mjtState.mjSTATE_INTEGRATION


def servos_of(model: mujoco.MjModel, joints: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Which actuators are position servos of which joints, by their ids: shape (n, nu)."""
    is_servo = model.actuator_biastype == mujoco.mjtBias.mjBIAS_AFFINE
    is_servo &= model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    return np.asarray(is_servo & (model.actuator_trnid[:, 0] == joints[:, None]))


class KinematicDrive:
    """Joints that are simply where they should be, checked for collision at every waypoint: for speed.

    Objects stay where they are. The clock advances by the time that the slowest joint needs; ``on_waypoint`` is called
    after every waypoint.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        arm: ArmSpec,
        on_waypoint: Callable[[], None] = lambda: None,
    ) -> None:
        self._model, self._data, self._on_waypoint = model, data, on_waypoint
        self._ids = np.array([model.joint(ARM_PREFIX + name).id for name in arm.joints])
        self._qpos, self._dofs = model.jnt_qposadr[self._ids], model.jnt_dofadr[self._ids]
        self._speeds = np.asarray(arm.joint_speed)  # rad/s, of each joint, or one for all
        # Only what the joints carry: the rest of a model, a pedestal or a puck on a slide, stands where it stands
        # whatever the arm does, and what it touches is no collision of the arm.
        carried = np.zeros(model.nbody, bool)
        carried[model.jnt_bodyid[self._ids]] = True
        for body in range(1, model.nbody):  # parents come before their children
            carried[body] |= carried[model.body_parentid[body]]
        self.geoms = carried[model.geom_bodyid]  # (ngeom,)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({count(len(self._ids), 'joint')}, {self._data.time:.2f} s on the clock)"

    def joints(self) -> NDArray[np.float64]:
        """Read the true joint angles, shape (n,), rad; a copy."""
        return self._data.qpos[self._qpos]

    def put(self, q: NDArray[np.float64]) -> None:
        """Set the joints at once, at rest and outside of time, as when an episode is set up."""
        self._data.qpos[self._qpos] = q
        self._data.qvel[:] = 0
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        mujoco.mj_collision(self._model, self._data)

    def contacts(self) -> NDArray[np.int32]:
        """Pairs of overlapping geoms of which the joints move at least one, shape (k, 2)."""
        contact = self._data.contact
        return contact.geom[self.geoms[contact.geom].any(axis=1) & (contact.dist < 0)]

    def seconds(self, a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
        """Time between two configurations at the arm's working pace, s."""
        return float(np.max(np.abs(b - a) / (PACE * self._speeds)))

    def follow(self, path: Sequence[NDArray[np.float64]]) -> Outcome:
        """Step from waypoint to waypoint; a colliding one is not entered. REACHED, or why it stopped."""
        for q in path:
            before = self.joints()
            self.put(q)
            if len(self.contacts()):
                self.put(before)
                return Outcome.COLLISION
            self._data.time += self.seconds(before, q)
            self._on_waypoint()
        return Outcome.REACHED

    def idle(self, seconds: float) -> None:
        """Let time pass: nothing moves."""
        self._data.time += seconds
        self._on_waypoint()


class DynamicDrive(KinematicDrive):
    """Position servos and ``mj_step``: for realism. Objects can be pushed, tipped and carried.

    ``on_step`` is called after every step of physics, ``on_waypoint`` every 33 ms.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        arm: ArmSpec,
        on_waypoint: Callable[[], None] = lambda: None,
        on_step: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__(model, data, arm, on_waypoint)
        self._on_step = on_step
        self._actuators = self._servos(arm)
        # How far behind its target, in seconds of motion, a servo's damping holds its joint: leading by as much, the
        # joints are on the path rather than after it, and little is left to settle.
        damping = model.dof_damping[self._dofs] - model.actuator_biasprm[self._actuators, 2]
        self._lag = damping / model.actuator_gainprm[self._actuators, 0]  # s
        self._last_watch = -np.inf
        self._before = np.empty(mujoco.mj_stateSize(model, _PHYSICS))
        free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        self._free = model.jnt_dofadr[free][:, None] + np.arange(6)  # (k, 6)
        reach = np.linalg.norm(model.geom_pos, axis=1) + model.geom_rbound
        self._reach = [reach[model.geom_bodyid == body].max(initial=0.0) for body in model.jnt_bodyid[free]]  # m
        self.held: frozenset[int] = frozenset()

    def _servos(self, arm: ArmSpec) -> NDArray[np.intp]:
        """Ids of the position servos that drive the joints, shape (n,)."""
        drives = servos_of(self._model, self._ids)
        if (missing := ~drives.any(axis=1)).any():
            raise ModelError(
                f"joint {arm.joints[missing.argmax()]!r} has no position servo, which the dynamic mode needs; give the "
                "MJCF an <actuator><position joint=.../></actuator>, or use the kinematic mode (dynamic=False)"
            )
        return drives.argmax(axis=1)

    def put(self, q: NDArray[np.float64]) -> None:
        """Set the joints and their servos, at rest, with nothing in the fingers."""
        self.held = frozenset()
        super().put(q)
        self._data.ctrl[self._actuators] = q
        mujoco.mj_forward(self._model, self._data)

    def follow(self, path: Sequence[NDArray[np.float64]]) -> Outcome:
        """Lead the servos along a path, never empty, at a smooth pace; let them settle. REACHED, or why it stopped."""
        knots = np.vstack([self._data.ctrl[self._actuators], *path])  # (k, n)
        arrival = np.cumsum([0.0, *(self.seconds(a, b) for a, b in pairwise(knots))])  # s
        # Ease in and out, so that no servo is asked for a jump of speed; 1.5 is the easing's top speed.
        duration, step = 1.5 * arrival[-1], self._model.opt.timestep
        s = np.minimum(1.0, np.arange(np.ceil(duration / step)) * step / duration)  # (m,)
        along = arrival[-1] * s * s * (3 - 2 * s)
        speed = arrival[-1] * 6 * s * (1 - s) / duration
        here, ahead = (_on_path(a, arrival, knots) for a in (along, along + 1e-3))
        for q in here + (speed[:, None] * 1e3) * self._lag * (ahead - here):
            self._data.ctrl[self._actuators] = q
            self._step()
            if self._pressed():
                return self._protect()
        self._data.ctrl[self._actuators] = knots[-1]
        self._step()
        return self._settle(knots[-1])

    def idle(self, seconds: float) -> None:
        """Let time pass with the servos holding."""
        for _ in range(int(np.ceil(seconds / self._model.opt.timestep))):
            self._step()
        mujoco.mj_forward(self._model, self._data)

    def _settle(self, q: NDArray[np.float64]) -> Outcome:
        end = self._data.time + _SETTLE_TIMEOUT
        while self._data.time < end:
            self.idle(0.01)
            if self._pressed():
                return self._protect()
            still = np.abs(self._data.qvel[self._dofs]).max() * 0.01 < _SETTLED
            if still and np.abs(self.joints() - q).max() < _SETTLED:
                break
        return Outcome.REACHED if np.abs(self.joints() - q).max() < _ARRIVED else Outcome.STALLED

    def _protect(self) -> Outcome:
        """Stop pushing and hold the arm where it is."""
        self._data.ctrl[self._actuators] = self.joints()
        self.idle(0.1)
        return Outcome.CONTACT

    def _step(self) -> None:
        model, data = self._model, self._data
        mujoco.mj_getState(model, data, self._before, _PHYSICS)
        mujoco.mj_step(model, data)
        # Upper bound on the speed of any point of a free body, m/s.
        moving = zip(self._reach, data.qvel[self._free].tolist(), strict=True)
        fastest = max((hypot(x, y, z) + reach * hypot(a, b, c) for reach, (x, y, z, a, b, c) in moving), default=0.0)
        step = model.opt.timestep
        if fastest * step > _MAX_TRAVEL:
            # After a whole step, what snaps flat in the hand, or rattles in it, would be millimeters inside a finger.
            mujoco.mj_setState(model, data, self._before, _PHYSICS)
            try:
                model.opt.timestep = step / _SUBSTEPS
                mujoco.mj_step(model, data, _SUBSTEPS)
            finally:
                model.opt.timestep = step
        self._on_step()
        if data.time - self._last_watch >= _WATCH_EVERY or data.time < self._last_watch:
            self._last_watch = data.time
            self._on_waypoint()

    def _pressed(self) -> bool:
        """Whether something that the arm does not hold presses on it harder than ``_STOP_FORCE``."""
        contact, force = self._data.contact, np.zeros(6)
        of_arm = self.geoms[contact.geom].any(axis=1)  # (ncon,)
        bodies = self._model.geom_bodyid[contact.geom]  # (ncon, 2)
        for i in np.flatnonzero(of_arm & (contact.dist < contact.includemargin)):
            if self.held.isdisjoint(bodies[i].tolist()):
                mujoco.mj_contactForce(self._model, self._data, i, force)
                if force[0] > _STOP_FORCE:
                    return True
        return False


def _on_path(
    along: NDArray[np.float64], arrival: NDArray[np.float64], knots: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Joint angles (m, n), rad, at times ``along`` (m,) on a path that is at ``knots`` (k, n) at ``arrival`` (k,)."""
    k = np.clip(np.searchsorted(arrival, along) - 1, 0, len(arrival) - 2)
    span = arrival[k + 1] - arrival[k]
    share = np.minimum(1.0, np.divide(along - arrival[k], span, out=np.ones_like(along), where=span > 0))
    return np.asarray(knots[k] + share[:, None] * (knots[k + 1] - knots[k]))
