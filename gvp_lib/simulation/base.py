"""A holonomic base: a cart under the arm that drives in any direction and turns on the spot. Asked for in thesis 4."""

from __future__ import annotations

from dataclasses import dataclass, fields

import mujoco
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError, ModelError

__all__ = ["BASE_JOINTS", "HolonomicBase"]

BASE_JOINTS = ("base_x", "base_y", "base_yaw")
"""The base's joints: two slides, m, along the axes of the frame in which it started, and a turn about the vertical."""

_MASS = 60.0  # kg: batteries and motors
_STIFFNESS = (2e5, 2e5, 4e4)  # N/m and N m/rad, of the servos
_DAMPING = (1.2e4, 1.2e4, 2e3)  # N s/m and N m s/rad: they do not swing under an arm of 120 kg
_RADIUS, _HEIGHT, _CLEARANCE = 0.26, 0.10, 0.03  # m, of the platform, and of the floor below it
_COLUMN = 0.08  # m, radius of the column under an arm that has no pedestal of its own
_PAINT, _TIRE = (0.16, 0.30, 0.42, 1.0), (0.08, 0.08, 0.09, 1.0)


@dataclass(frozen=True)
class HolonomicBase:
    """Mobile base for :meth:`gvp_lib.simulation.arms.ArmSpec.on_base`.

    Its three joints come before the arm's, which is then an ordinary arm with three more. Poses are in the frame in
    which the base first stood, as odometry gives them. ``Noise`` treats all joints alike: an offset of 0.25 deg is
    4.4 mm of a slide.

    Attributes
    ----------
    reach
        Longest drive from the start along x and along y, m.
    turn
        Largest turn to either side, rad.
    speed, turn_speed
        Speed limits, m/s and rad/s.
    cost
        Cost of moving by a meter or a radian, where a joint of the arm costs 1 per radian; squares add up. The arm
        does what it can, the base the rest.
    """

    reach: float = 1.0
    turn: float = float(np.pi)
    speed: float = 1.0
    turn_speed: float = 1.0
    cost: float = 10.0

    def __post_init__(self) -> None:
        wrong = [f"{f.name}={getattr(self, f.name)}" for f in fields(self) if not 0 < getattr(self, f.name) < np.inf]
        if wrong:
            raise InvalidParameterError(
                f"a base's reach, turn, speed, turn_speed and cost are positive and finite; got {', '.join(wrong)}"
            )

    @property
    def speeds(self) -> tuple[float, float, float]:
        """Speed limits of :data:`BASE_JOINTS`."""
        return self.speed, self.speed, self.turn_speed

    def put_under(self, model: mujoco.MjSpec, floor_height: float) -> None:
        """Make a model of an arm mobile, in place: add joints, servos, and a platform on the floor.

        Raises
        ------
        ModelError
            The model has not exactly one body at its top, so that what stands beside it would stay behind; or a joint
            of its own has the name of one of the base's.
        """
        tops = model.worldbody.bodies
        if len(tops) != 1 or len(model.worldbody.geoms):
            names = ", ".join(body.name for body in tops) or "none"
            raise ModelError(
                "a base carries a model whose parts all hang on one body at the top of its worldbody. This one has "
                f"the bodies {names} there, and {len(model.worldbody.geoms)} loose geoms; put them into one body, or "
                "name in leave_out those that are not the arm"
            )
        top = tops[0]
        if taken := [name for name in BASE_JOINTS if model.joint(name) is not None]:
            raise ModelError(f"the model has a joint {taken[0]!r} of its own; rename it, for the base has one")
        world_from_top = RigidTransform.from_components(top.pos, Rotation.from_quat(top.quat, scalar_first=True))
        self._add_joints(model, top, world_from_top.inv())
        self._add_platform(top, world_from_top.inv(), floor_height)

    def _add_joints(self, model: mujoco.MjSpec, top: mujoco.MjsBody, top_from_world: RigidTransform) -> None:
        slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
        kinds, limits = (slide, slide, hinge), (self.reach, self.reach, self.turn)
        axes = top_from_world.rotation.apply([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
        for k, name in enumerate(BASE_JOINTS):
            joint = top.add_joint(name=name, type=kinds[k], axis=axes[k], pos=top_from_world.translation)
            joint.limited, joint.range = mujoco.mjtLimited.mjLIMITED_TRUE, (-limits[k], limits[k])
            servo = model.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
            servo.set_to_position(kp=_STIFFNESS[k], kv=_DAMPING[k])

    @staticmethod
    def _add_platform(top: mujoco.MjsBody, top_from_world: RigidTransform, floor_height: float) -> None:
        """Add a disc on wheels, and a column up to the arm's base plane; a pedestal, if any, hides the column."""
        low, high = floor_height + _CLEARANCE, floor_height + _CLEARANCE + _HEIGHT
        cylinder = mujoco.mjtGeom.mjGEOM_CYLINDER

        def add(start: tuple[float, ...], end: tuple[float, ...], radius: float, color: tuple[float, ...]) -> None:
            ends = np.concatenate([top_from_world.apply(start), top_from_world.apply(end)])
            for group, touches in ((2, 0), (3, 1)):  # a visible geom, and one for collisions
                geom = top.add_geom(type=cylinder, fromto=ends, size=[radius, 0, 0], rgba=color, group=group)
                geom.contype = geom.conaffinity = touches
                geom.mass = touches * _MASS / 2

        add((0, 0, low), (0, 0, high), _RADIUS, _PAINT)
        add((0, 0, high), (0, 0, max(high, -0.005) + 1e-3), _COLUMN, _PAINT)
        for angle in np.arange(4) * np.pi / 2 + np.pi / 4:
            out = np.array([np.cos(angle), np.sin(angle), 0.0])
            middle = 0.8 * _RADIUS * out + (0, 0, floor_height + 0.05)
            start, end = top_from_world.apply(middle - 0.02 * out), top_from_world.apply(middle + 0.02 * out)
            ends = np.concatenate([start, end])
            wheel = top.add_geom(type=cylinder, fromto=ends, size=[0.05, 0, 0], rgba=_TIRE, group=2, mass=0)
            wheel.contype = wheel.conaffinity = 0
