"""A compiled scene, and everything that holds on to it: arm, camera, gripper, kinematics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from gvp_lib.simulation.arm import SimulatedArm
from gvp_lib.simulation.arms import ArmSpec
from gvp_lib.simulation.drive import ArmBodies, Drive, DynamicDrive, KinematicDrive
from gvp_lib.simulation.floating import FloatingCamera
from gvp_lib.simulation.gripper import SimulatedGripper
from gvp_lib.simulation.inverse_kinematics import InverseKinematics
from gvp_lib.simulation.scene import ARM_PREFIX, FLOATING
from gvp_lib.simulation.sensors import CameraSensor, EpisodeNoise, Noise, RangeSensor

__all__ = ["Assembly", "JointedArm", "Watchers", "assemble"]


class Watchers:
    """Callbacks for each waypoint of each motion. On its own, so that what calls it need not know the cell."""

    def __init__(self) -> None:
        self.callbacks: list[Callable[[], None]] = []
        self.of_steps: list[Callable[[], None]] = []  # of the dynamic mode, a thousand in a second

    def __call__(self) -> None:
        """Call them all."""
        for callback in list(self.callbacks):
            callback()


@dataclass
class JointedArm:
    """What an arm has and a floating camera has not.

    Attributes
    ----------
    arm, kinematics, bodies
        The arm and its parts.
    drive
        What moves it at present.
    drives
        Makes the two ways of moving it: kinematic and dynamic.
    gripper
        None where the hand holds none.
    """

    arm: SimulatedArm
    kinematics: InverseKinematics
    bodies: ArmBodies
    drive: Drive
    drives: Callable[[bool], Drive]
    gripper: SimulatedGripper | None

    def use_dynamics(self, dynamic: bool) -> None:
        """From here on servos push the joints through time, or they are where they are told to be."""
        self.drive = self.drives(dynamic)
        self.arm.move_by(self.drive)
        if self.gripper is not None:
            self.gripper.move_by(self.drive)
        self.drive.put(self.drive.joints())


@dataclass(frozen=True)
class Assembly:
    """One compiled scene and what stands on it.

    Attributes
    ----------
    model, data
        The scene.
    camera
        The hand camera's id in it.
    close_camera
        Frees the hand camera's graphics context; the next picture makes a new one.
    holder
        What carries the camera: an arm, or nothing but air.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    camera: int
    close_camera: Callable[[], None]
    holder: JointedArm | FloatingCamera


def assemble(
    model: mujoco.MjModel, spec: ArmSpec | None, watchers: Watchers, *, dynamic: bool, shadows: bool
) -> Assembly:
    """Put the arm of ``spec``, or a floating camera, on a compiled scene that holds it."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    if spec is None:
        camera = FloatingCamera(model, data, shadows=shadows, on_waypoint=watchers)
        return Assembly(model, data, model.camera(FLOATING).id, camera.close, camera)
    camera_id = model.camera(ARM_PREFIX + spec.camera).id
    sensor = CameraSensor(model, data, camera_id, *spec.image_size, shadows=shadows)
    kinematics = InverseKinematics(spec.kinematic_model(), spec.camera, spec.joints, spec.joint_costs)
    bodies = ArmBodies(model, ARM_PREFIX, spec.joints, _speeds(spec.joint_speed, len(spec.joints)))

    def drives(dynamic: bool) -> Drive:
        if dynamic:
            return DynamicDrive(model, data, bodies, watchers, watchers.of_steps)
        return KinematicDrive(model, data, bodies, watchers)

    drive = drives(dynamic)
    calm = EpisodeNoise(Noise.none(), len(spec.joints), np.random.SeedSequence(0))
    arm = SimulatedArm(kinematics, drive, sensor, calm)
    gripper = None
    if spec.gripper is not None:
        beam = RangeSensor(model, data, model.site(ARM_PREFIX + spec.gripper.range_site).id)
        gripper = SimulatedGripper(model, data, spec.gripper, ARM_PREFIX, spec.camera, drive, beam)
    return Assembly(model, data, camera_id, sensor.close, JointedArm(arm, kinematics, bodies, drive, drives, gripper))


def _speeds(limits: Sequence[float] | float, joints: int) -> np.ndarray:
    return np.broadcast_to(np.asarray(limits, float), joints)
