"""A holonomic base: a cart under the arm that drives in any direction and turns on the spot. Proposed in thesis 4."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError, ModelError

__all__ = ["BASE_JOINTS", "HolonomicBase"]

BASE_JOINTS = ("base_x", "base_y", "base_yaw")
"""Joints of a base: two slides, m, along the axes of the frame where it started, and a turn about the vertical, rad."""

_KINDS = (mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE)
_MASS = 60.0  # kg: batteries and motors
_STIFFNESS = (2e5, 2e5, 4e4)  # N/m and N m/rad, of the servos
_DAMPING = (1.2e4, 1.2e4, 2e3)  # N s/m and N m s/rad: they do not swing under an arm of 120 kg
_RADIUS, _HEIGHT, _CLEARANCE = 0.26, 0.10, 0.03  # m, of the platform, and of the floor below it
_COLUMN = 0.08  # m, radius of the column under an arm that has no pedestal of its own
_PAINT, _TIRE = (0.16, 0.30, 0.42, 1.0), (0.08, 0.08, 0.09, 1.0)


@checked
@dataclass(frozen=True)
class HolonomicBase:
    """Holonomic mobile base, to carry an arm by :meth:`gvp_lib.simulation.arms.ArmSpec.on_base`.

    Its three joints precede the arm's: to a planner, the two are one arm with three more joints. Poses are in the frame
    where the base started, as odometry reports them. ``Noise`` treats all joints alike: an offset of 0.25 deg is 4.4 mm
    on a slide.

    Parameters
    ----------
    reach
        Limit of travel along x and along y, to either side of the start, m.
    turn
        Limit of rotation to either side, rad.
    speed, turn_speed
        Speed limits, m/s and rad/s.
    cost
        Cost of moving by 1 m or 1 rad in the inverse kinematics, where 1 rad of an arm's joint costs 1; the solver
        minimizes the sum of squares. At the default, the arm moves as far as it can and the base makes up the rest.

    Examples
    --------
    >>> from gvp_lib import ARMS
    >>> ARMS["baxter"].on_base(HolonomicBase(reach=0.5))
    ArmSpec(baxter on a base, 10 joints, 640 x 480 camera, 72 mm gripper)
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

    def put_under(self, model: mujoco.MjSpec, compiled: mujoco.MjModel, floor_height: float) -> None:
        """Put the base under an arm's model, in place: add joints, servos, and a platform on the floor.

        Parameters
        ----------
        model
            Model to change.
        compiled
            The same model compiled, from which the poses of its bodies are read.
        floor_height
            Height of the floor, base frame, m.

        Raises
        ------
        ModelError
            The worldbody does not hold exactly one body, so that some part would stay behind; that body has a joint of
            its own; or a joint already has one of the names in ``BASE_JOINTS``.
        """
        tops = model.worldbody.bodies
        if len(tops) != 1 or len(model.worldbody.geoms):
            names = ", ".join(body.name for body in tops) or "none"
            raise ModelError(
                "a base carries a model whose parts all hang on one body at the top of its worldbody. This one has "
                f"the bodies {names} there, and {len(model.worldbody.geoms)} loose geoms; put them into one body, or "
                "name in leave_out those that are not the arm"
            )
        if taken := [name for name in BASE_JOINTS if model.joint(name) is not None]:
            raise ModelError(f"the model has a joint {taken[0]!r} of its own; rename it, for the base has one")
        top = tops[0]
        if top.joints:
            raise ModelError(
                f"the body at the top of the model, {top.name!r}, has a joint of its own, which would come before the "
                "base's; put that body into one that stands still"
            )
        turn = Rotation.from_quat(compiled.body_quat[1], scalar_first=True)
        top_from_world = RigidTransform.from_components(compiled.body_pos[1], turn).inv()
        quaternion = top_from_world.rotation.as_quat(scalar_first=True)
        world = top.add_frame(pos=top_from_world.translation, quat=quaternion)
        limits = self.reach, self.reach, self.turn
        for name, kind, axis, limit, kp, kv in zip(
            BASE_JOINTS, _KINDS, np.eye(3), limits, _STIFFNESS, _DAMPING, strict=True
        ):
            if kind == mujoco.mjtJoint.mjJNT_HINGE and model.compiler.degree:
                limit = np.degrees(limit)
            joint = top.add_joint(name=name, type=kind, axis=axis, limited=True, range=(-limit, limit))
            joint.set_frame(world)
            model.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT).set_to_position(kp=kp, kv=kv)

        def add(start: ArrayLike, end: ArrayLike, radius: float, color: tuple[float, ...], **options: Any) -> None:
            ends, kind = np.concatenate([start, end]), mujoco.mjtGeom.mjGEOM_CYLINDER
            top.add_geom(type=kind, fromto=ends, size=[radius, 0, 0], rgba=color, **options).set_frame(world)

        # A disc on wheels, and a column up to the arm's base plane; a pedestal, if any, hides the column.
        low, high = floor_height + _CLEARANCE, floor_height + _CLEARANCE + _HEIGHT
        unseen = {"group": 3, "mass": _MASS / 2, "contype": 1, "conaffinity": 1}
        seen = {"group": 2, "mass": 0, "contype": 0, "conaffinity": 0}
        for start, end, radius in ((low, high, _RADIUS), (high, max(high, -0.005) + 1e-3, _COLUMN)):
            for options in (seen, unseen):
                add((0, 0, start), (0, 0, end), radius, _PAINT, **options)
        for angle in np.arange(4) * np.pi / 2 + np.pi / 4:
            out = np.array([np.cos(angle), np.sin(angle), 0.0])
            middle = 0.8 * _RADIUS * out + (0, 0, floor_height + 0.05)
            add(middle - 0.02 * out, middle + 0.02 * out, 0.05, _TIRE, **seen)
