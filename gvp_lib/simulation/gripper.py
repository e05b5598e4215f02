"""The simulated gripper: two coupled fingers and a range sensor. Thesis 1.2 (Fig. 1.2), 2.3 Grasp Completion."""

from __future__ import annotations

import mujoco
import numpy as np

from gvp_lib.motion.arm import Hand
from gvp_lib.simulation.arms import GripperSpec
from gvp_lib.simulation.robot import Drive, DynamicDrive
from gvp_lib.simulation.scene import ARM_PREFIX
from gvp_lib.simulation.sensors import EpisodeNoise, RangeSensor

__all__ = ["SimulatedGripper"]

_STEP = 0.0005  # m of opening, between the checks of a kinematic finger
_SECONDS = 1.0  # s, that opening or closing takes
_TRAVEL, _LEADS = 0.7, 70  # s, of that time, in which the fingers are led there, and the number of commands


class SimulatedGripper:
    """Parallel gripper in a work cell. Implements :class:`gvp_lib.motion.arm.Gripper`."""

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, spec: GripperSpec, camera: str, drive: Drive
    ) -> None:
        self._model, self._data = model, data
        self.move_by(drive)
        sensor = model.site(ARM_PREFIX + spec.range_site).id
        self._sensor = RangeSensor(model, data, sensor)
        joints = [model.joint(ARM_PREFIX + name) for name in spec.finger_joints]
        self._qpos = np.array([joint.qposadr[0] for joint in joints])
        self._wide = sum(float(joint.range[1]) for joint in joints)
        self._actuator = model.actuator(ARM_PREFIX + spec.actuator).id
        # Asked for less than the fingers can reach, the actuator squeezes with all its force.
        self._shut = float(model.actuator_ctrlrange[self._actuator, 0])
        self._narrow = sum(float(joint.range[0]) for joint in joints)
        fingers = [joint.bodyid[0] for joint in joints]
        self._finger_geoms = [np.flatnonzero(model.geom_bodyid == finger) for finger in fingers]
        self._hand = self._measure(model.camera(ARM_PREFIX + camera).id, sensor)

    def begin_episode(self, noise: EpisodeNoise) -> None:
        """Adopt an episode's noise and stand open; called by the cell's ``reset``."""
        self._noise = noise
        self._put(self._wide)

    def move_by(self, drive: Drive) -> None:
        """Let this drive keep the clock from now on; called by the cell."""
        self._drive = drive

    @property
    def width(self) -> float:
        """Distance between the finger pads, m."""
        return float(self._data.qpos[self._qpos].sum())

    @property
    def stroke(self) -> tuple[float, float]:
        """Distance between the pads when shut and when fully open, m."""
        return self._narrow, self._wide

    @property
    def hand(self) -> Hand:
        """Lengths of the hand along the optical axis, from the camera."""
        return self._hand

    @property
    def finger_geoms(self) -> frozenset[int]:
        """Ids of the fingers' geoms, for whoever judges their contacts."""
        return frozenset(np.concatenate(self._finger_geoms).tolist())

    def open(self) -> None:
        """Open fully."""
        self._go(self._wide)

    def close(self) -> None:
        """Close until the fingers meet each other or an object."""
        self._go(self._shut if isinstance(self._drive, DynamicDrive) else self._narrow)

    def range(self) -> float:
        """Reading of the range sensor along the hand's axis, m; ``inf`` where it sees nothing."""
        return self._sensor.read(self._noise)

    def _go(self, width: float) -> None:
        if isinstance(self._drive, DynamicDrive):
            # At an even pace: told at once, the fingers would strike what they should squeeze.
            start = float(self._data.ctrl[self._actuator])
            for share in np.linspace(0.0, 1.0, _LEADS + 1)[1:]:
                self._data.ctrl[self._actuator] = start + share * (width - start)
                self._drive.idle(_TRAVEL / _LEADS)
            self._drive.idle(_SECONDS - _TRAVEL)
            self._drive.held = self._between_fingers()
            return
        # Without dynamics nothing is held: the fingers stop where they first touch something.
        steps = max(1, int(np.ceil(abs(width - self.width) / _STEP)))
        for opening in np.linspace(self.width, width, steps + 1)[1:]:
            before = self.width
            self._put(float(opening))
            if any(self._touched_by(k) for k in range(len(self._finger_geoms))):
                self._put(before)
                break
        self._drive.idle(_SECONDS)

    def _measure(self, camera: int, sensor: int) -> Hand:
        """Measure the hand along the optical axis; the kinematics of any pose will do."""
        data, model = self._data, self._model
        ahead = -data.cam_xmat[camera].reshape(3, 3)[:, 2]  # MuJoCo's cameras look along -z
        fingers = np.concatenate(self._finger_geoms)
        fingers = fingers[(model.geom_contype[fingers] | model.geom_conaffinity[fingers]) != 0]
        axes = data.geom_xmat[fingers].reshape(-1, 3, 3)
        boxes = model.geom_aabb[fingers]  # center and half extents, in the geom's frame
        centers = data.geom_xpos[fingers] + np.einsum("nij,nj->ni", axes, boxes[:, :3])
        reach = (np.abs(ahead @ axes) * boxes[:, 3:]).sum(axis=1)
        tips = float(((centers - data.cam_xpos[camera]) @ ahead + reach).max())
        return Hand(sensor=float((data.site_xpos[sensor] - data.cam_xpos[camera]) @ ahead), tips=tips)

    def _put(self, width: float) -> None:
        self._data.qpos[self._qpos] = width / len(self._qpos)
        self._data.ctrl[self._actuator] = width
        mujoco.mj_forward(self._model, self._data)

    def _touched_by(self, finger: int) -> frozenset[int]:
        """Ids of the geoms, other than the fingers', that a finger touches."""
        contact = self._data.contact
        ours = np.isin(contact.geom, self._finger_geoms[finger])  # (ncon, 2)
        # A pad's skin presses before its shape is reached: within the margin, and not only at an overlap.
        touching = contact.geom[ours.any(axis=1) & (contact.dist < contact.includemargin)]
        return frozenset(touching.ravel().tolist()).difference(*(g.tolist() for g in self._finger_geoms))

    def _between_fingers(self) -> frozenset[int]:
        """Ids of the geoms of the bodies that every finger touches."""
        bodies = [
            {int(self._model.geom_bodyid[geom]) for geom in self._touched_by(k)} for k in range(len(self._finger_geoms))
        ]
        held = list(set.intersection(*bodies))
        return frozenset(np.flatnonzero(np.isin(self._model.geom_bodyid, held)).tolist())
