"""The simulated gripper: two coupled fingers and a range sensor. Thesis 1.2 (Fig. 1.2), 2.3 Grasp Completion."""

from __future__ import annotations

import mujoco
import numpy as np

from gvp_lib.simulation.arms import GripperSpec
from gvp_lib.simulation.drive import Drive, DynamicDrive
from gvp_lib.simulation.sensors import EpisodeNoise, RangeSensor

__all__ = ["SimulatedGripper"]

_STEP = 0.0005  # m of opening, between the checks of a kinematic finger
_SECONDS = 1.0  # s, that opening or closing takes


class SimulatedGripper:
    """A parallel gripper in a work cell. Implements :class:`gvp_lib.motion.arm.Gripper`."""

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        spec: GripperSpec,
        prefix: str,
        drive: Drive,
        sensor: RangeSensor,
    ) -> None:
        self._model, self._data, self._drive, self._sensor = model, data, drive, sensor
        joints = [model.joint(prefix + name) for name in spec.finger_joints]
        self._qpos = np.array([joint.qposadr[0] for joint in joints])
        self._wide = sum(float(joint.range[1]) for joint in joints)
        self._actuator = model.actuator(prefix + spec.actuator).id
        # Asked for less than the fingers can reach, the actuator squeezes with all its force.
        self._shut = float(model.actuator_ctrlrange[self._actuator, 0])
        self._narrow = sum(float(joint.range[0]) for joint in joints)
        fingers = [joint.bodyid[0] for joint in joints]
        self._finger_geoms = [np.flatnonzero(model.geom_bodyid == finger) for finger in fingers]

    def begin_episode(self, noise: EpisodeNoise) -> None:
        """Take an episode's noise and stand open; for the cell, when it sets one up."""
        self._noise = noise
        self._put(self._wide)
        mujoco.mj_forward(self._model, self._data)

    @property
    def width(self) -> float:
        """Distance between the finger pads, m."""
        return float(self._data.qpos[self._qpos].sum())

    def open(self) -> None:
        """Open fully."""
        self._go(self._wide)

    def close(self) -> None:
        """Close until the fingers meet each other or an object."""
        self._go(self._shut if isinstance(self._drive, DynamicDrive) else self._narrow)

    def range(self) -> float:
        """Distance to what the sensor sees along the hand's axis, m; ``inf`` where it sees nothing."""
        return self._sensor.read(self._noise)

    def _go(self, width: float) -> None:
        if isinstance(self._drive, DynamicDrive):
            self._data.ctrl[self._actuator] = width
            self._drive.idle(_SECONDS)
            self._drive.held = self._between_fingers()
            return
        # Without dynamics nothing is held: the fingers stop where they first touch something.
        steps = max(1, int(np.ceil(abs(width - self.width) / _STEP)))
        for opening in np.linspace(self.width, width, steps + 1)[1:]:
            before = self.width
            self._put(float(opening))
            mujoco.mj_forward(self._model, self._data)
            if any(self._touched_by(k) for k in range(len(self._finger_geoms))):
                self._put(before)
                mujoco.mj_forward(self._model, self._data)
                break
        self._drive.idle(_SECONDS)

    def _put(self, width: float) -> None:
        self._data.qpos[self._qpos] = width / len(self._qpos)
        self._data.ctrl[self._actuator] = width

    def _touched_by(self, finger: int) -> frozenset[int]:
        """Geoms, of no finger, that a finger touches."""
        ours = np.isin(self._data.contact.geom, self._finger_geoms[finger])  # (ncon, 2)
        touching = self._data.contact.geom[ours.any(axis=1) & (self._data.contact.dist < 0)]
        return frozenset(touching.ravel().tolist()).difference(*(g.tolist() for g in self._finger_geoms))

    def _between_fingers(self) -> frozenset[int]:
        """Geoms of the bodies that every finger touches."""
        bodies = [
            {int(self._model.geom_bodyid[geom]) for geom in self._touched_by(k)} for k in range(len(self._finger_geoms))
        ]
        held = list(set.intersection(*bodies))
        return frozenset(np.flatnonzero(np.isin(self._model.geom_bodyid, held)).tolist())
