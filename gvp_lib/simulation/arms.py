"""Arms for the work cell: the UR5e, the Baxter's right arm, and any other that has an MJCF model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError, ModelError, UnknownNameError
from gvp_lib.picture import Pictured, count
from gvp_lib.simulation.base import BASE_JOINTS, HolonomicBase
from gvp_lib.simulation.camera import to_mujoco_camera
from gvp_lib.simulation.mjcf import read_model, resolved

__all__ = ["ARMS", "ArmSpec", "GripperSpec", "arm_spec"]

_LENS = ("sensor_size", "focal_length", "focal_pixel", "principal_length", "principal_pixel")
_FOVY = float(np.radians(48.8))  # rad; Raspberry Pi camera module v2, the thesis's camera


@checked
@dataclass(frozen=True)
class GripperSpec:
    """Parallel gripper, described by the names of its parts in the arm's MJCF.

    The position of each finger joint is the distance of its pad from the middle, m; their sum is the opening between
    the pads, which the actuator commands.

    Parameters
    ----------
    actuator
        Actuator that opens and closes the fingers.
    finger_joints
        Slide joints of the fingers.
    range_site
        Site of the range sensor, whose beam is the site's +z axis.
    grasp_site
        Site between the fingertips.
    max_width
        Opening between the pads when fully open, m. A value other than the model's shifts the fingers' range, as if
        they were bolted on further apart or closer together; the length of the stroke stays the same.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from gvp_lib import ARMS
    >>> baxter = ARMS["baxter"]
    >>> replace(baxter, name="wide", gripper=replace(baxter.gripper, max_width=0.1))
    ArmSpec(wide, 7 joints, 640 x 480 camera, 100 mm gripper)
    """

    actuator: str
    finger_joints: tuple[str, ...]
    range_site: str
    grasp_site: str
    max_width: float

    def __post_init__(self) -> None:
        if not self.max_width > 0:
            raise InvalidParameterError(f"a gripper's max_width is positive, in meters; got {self.max_width}")
        if not self.finger_joints:
            raise InvalidParameterError("a gripper's finger_joints is empty; name its sliding joints")


@checked
@dataclass(frozen=True)
class ArmSpec(Pictured):
    """Arm with a camera in its hand: an MJCF model, and what the work cell must know about it.

    The model's world frame is the arm's base frame, z up. A model needs no more than joints and a camera, or a place to
    mount one, so most public models of arms will do.

    Parameters
    ----------
    name
        Name in messages and titles.
    mjcf
        Model, MJCF or URDF: the path of a file, or the XML itself. A relative path, of it or in it, starts from the
        folder that was the current one when the spec was made.
    camera
        Name of the camera in the hand.
    joints
        Names of the moving joints, base to wrist. The last one turns the hand about its own axis. What the model
        leaves without a name is ``unnamed_joint_0``, ``unnamed_body_1`` and so on, by its number in MuJoCo.
    home
        Home configuration, one angle per joint, rad, with the camera looking straight down at the middle of the
        workspace. :func:`gvp_lib.simulation.kinematics.looking_down` solves for one.
    table_height, floor_height
        Heights of the table top and of the floor, base frame, m.
    workspace
        Region where objects are placed: ((x_min, x_max), (y_min, y_max)), base frame, m.
    image_size
        Width and height of the camera's image, pixels.
    gripper
        Gripper; None for a hand without one.
    joint_speed
        Speed limit of each joint, or one for all, rad/s; sets how long motions take on the cell's clock.
    camera_mount
        Mount for a camera that the model lacks: the name of a body or a site, and ``body_from_camera``. A camera named
        ``camera`` is added there. The pose is that of the optical frame: z forward, y down.
    fovy
        Vertical field of view of the camera, rad. None keeps the model's, or takes the thesis's 48.8 deg for a camera
        added by ``camera_mount``.
    leave_out
        Names of bodies to remove from the model because they are not the arm: a puck, a goal, another table.
    base
        Mobile base that carries the arm, whose joints are then the first of ``joints``; :meth:`on_base` sets both.

    Examples
    --------
    >>> from dataclasses import replace
    >>> mine = replace(ARMS["ur5e"], name="mine", image_size=(320, 240), fovy=np.radians(60))
    >>> mine
    ArmSpec(mine, 6 joints, 320 x 240 camera, no gripper)
    """

    _figure = "plot_arm"

    name: str
    mjcf: str | Path
    camera: str
    joints: tuple[str, ...]
    home: tuple[float, ...]
    table_height: float = 0.0
    floor_height: float = -0.75
    workspace: tuple[tuple[float, float], tuple[float, float]] = ((0.45, 0.55), (-0.1, 0.1))
    image_size: tuple[int, int] = (640, 480)
    gripper: GripperSpec | None = None
    joint_speed: tuple[float, ...] | float = 1.0
    camera_mount: tuple[str, RigidTransform] | None = None
    fovy: float | None = None
    leave_out: tuple[str, ...] = ()
    base: HolonomicBase | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "mjcf", resolved(self.mjcf, f"arm {self.name!r}"))
        n, speeds = len(self.joints), np.size(self.joint_speed)
        on_base = self.joints[: len(BASE_JOINTS)] == BASE_JOINTS
        problems = {
            "joints is empty; name the joints that move, base to wrist": n == 0,
            f"home has {len(self.home)} angles for {n} joints": len(self.home) != n,
            f"home is finite, in rad; got {self.home}": not np.isfinite(self.home).all(),
            f"camera names one, of the model or to be; got {self.camera!r}": not self.camera,
            f"joint_speed has {speeds} values for {n} joints": speeds not in (1, n),
            f"joint_speed is positive, in rad/s; got {self.joint_speed}": not np.all(np.asarray(self.joint_speed) > 0),
            f"fovy is between 0 and pi rad; got {self.fovy}": self.fovy is not None and not 0 < self.fovy < np.pi,
            f"the joints of an arm on a base begin with {', '.join(BASE_JOINTS)}; make the spec without a base, and "
            "take its on_base()": self.base is not None and not on_base,
        }
        for message, present in problems.items():
            if present:
                raise InvalidParameterError(f"arm {self.name!r}: {message}")

    def __repr__(self) -> str:
        width, height = self.image_size
        gripper = f"{1000 * self.gripper.max_width:.0f} mm gripper" if self.gripper else "no gripper"
        return f"ArmSpec({self.name}, {count(len(self.joints), 'joint')}, {width} x {height} camera, {gripper})"

    def on_base(self, base: HolonomicBase | None = None) -> ArmSpec:
        """Mount the arm on a mobile base, whose three joints precede its own.

        Parameters
        ----------
        base
            Base; None for the default :class:`gvp_lib.simulation.base.HolonomicBase`.

        Raises
        ------
        InvalidParameterError
            The arm is on a base already.

        Examples
        --------
        >>> from gvp_lib import ARMS
        >>> ARMS["ur5e"].on_base().joints[:4]
        ('base_x', 'base_y', 'base_yaw', 'shoulder_pan')
        """
        if self.base is not None:
            raise InvalidParameterError(f"arm {self.name!r} already stands on a base")
        base = base or HolonomicBase()
        speeds = np.broadcast_to(self.joint_speed, len(self.joints)).tolist()
        return replace(
            self,
            name=f"{self.name} on a base",
            joints=(*BASE_JOINTS, *self.joints),
            home=(0.0, 0.0, 0.0, *self.home),
            joint_speed=(base.speed, base.speed, base.turn_speed, *speeds),
            base=base,
        )

    def load(self) -> mujoco.MjSpec:
        """Load the model as an ``MjSpec``, checked, with camera, gripper and base set, ready to be attached to a scene.

        Keyframes, lights and floor planes are removed: they belong to the scene that the model came from.

        Raises
        ------
        ModelError
            The model cannot be read or compiled, or lacks a camera, joint, actuator, site or body that this
            spec names; the message lists those it has. Or ``home`` is outside a joint's range.
        """
        model, (low, high) = self._loaded()
        for name, angle, least, most in zip(self.joints, self.home, low, high, strict=True):
            if not least - 1e-6 <= angle <= most + 1e-6:
                raise ModelError(
                    f"arm {self.name!r}: home puts joint {name!r} at {angle:.4f}, outside its range "
                    f"{least:.4f} to {most:.4f}; gvp_lib.simulation.looking_down finds a home from any"
                )
        return model

    def clipped(self) -> ArmSpec:
        """The same arm, with each angle of its home moved into the range of its joint.

        Raises
        ------
        ModelError
            As from :meth:`load`.

        Examples
        --------
        >>> from dataclasses import replace
        >>> from gvp_lib import ARMS
        >>> replace(ARMS["baxter"], home=(-1.0,) * 7).clipped().home
        (-1.0, -1.0, -1.0, -0.05, -1.0, -1.0, -1.0)
        """
        _, limits = self._loaded()
        return replace(self, home=tuple(np.clip(self.home, *limits).tolist()))

    def _loaded(self) -> tuple[mujoco.MjSpec, NDArray[np.float64]]:
        """Load the model, but for its home; and the lower and upper limits of the joints, (2, n), rad, or infinite."""
        model = read_model(self.mjcf, f"arm {self.name!r}")
        # MJCF requires no names, but what has none could be named neither in a spec nor in an error, and to the scene
        # what is called "arm/..." is the arm. The numbers are MuJoCo's ids, in the order of the file.
        for kind in ("body", "joint", "site", "camera", "actuator"):
            for number, part in enumerate(_parts(model, kind)):
                part.name = part.name or f"unnamed_{kind}_{number}"
        planes = [geom for geom in model.worldbody.geoms if geom.type == mujoco.mjtGeom.mjGEOM_PLANE]
        for stray in (*model.keys, *model.worldbody.lights, *planes):
            model.delete(stray)
        model.nkey = 0  # or else as many empty ones come in their place
        for name in self.leave_out:
            model.delete(self._find(model, name, "body"))
        compiled = self._compile(model)
        if self.base is not None:
            self.base.put_under(model, compiled, self.floor_height)
            compiled = self._compile(model)
        limits = self._limits(model, compiled)
        self._set_camera(model, compiled)
        if self.gripper is not None:
            self._set_gripper(model, self.gripper)
        return model, limits

    def _compile(self, model: mujoco.MjSpec) -> mujoco.MjModel:
        try:
            return model.compile()
        except (ValueError, mujoco.FatalError) as error:
            raise ModelError(f"arm {self.name!r}: the model does not compile: {error}") from error

    def _limits(self, model: mujoco.MjSpec, compiled: mujoco.MjModel) -> NDArray[np.float64]:
        ranges = []
        for name in self.joints:
            self._find(model, name, "joint")
            joint = compiled.joint(name)
            if joint.qpos0.size != 1:
                raise ModelError(f"arm {self.name!r}: joint {name!r} neither turns nor slides about one axis")
            ranges.append(joint.range if joint.limited[0] else (-np.inf, np.inf))
        return np.array(ranges).T

    def _set_camera(self, model: mujoco.MjSpec, compiled: mujoco.MjModel) -> None:
        if self.camera_mount is None:
            camera = self._find(model, self.camera, "camera")
            if self.fovy is not None:
                camera.fovy = np.degrees(self.fovy)
                for name in _LENS:  # it would overrule the field of view
                    setattr(camera, name, (0.0, 0.0))
            return
        if model.camera(self.camera) is not None:
            raise ModelError(
                f"arm {self.name!r}: the model already has a camera {self.camera!r}; drop camera_mount to use it, "
                "or give the new camera another name"
            )
        name, body_from_camera = self.camera_mount
        body = self._find(model, name, "body", "site")
        if isinstance(body, mujoco.MjsSite):
            site, body = compiled.site(name), body.parent
            turn = Rotation.from_quat(site.quat, scalar_first=True)
            body_from_camera = RigidTransform.from_components(site.pos, turn) * body_from_camera
        position, quaternion = to_mujoco_camera(body_from_camera)
        fovy = np.degrees(_FOVY if self.fovy is None else self.fovy)
        body.add_camera(name=self.camera, pos=position, quat=quaternion, fovy=fovy)

    def _set_gripper(self, model: mujoco.MjSpec, gripper: GripperSpec) -> None:
        for site in (gripper.range_site, gripper.grasp_site):
            self._find(model, site, "site")
        actuator = self._find(model, gripper.actuator, "actuator")
        for name in gripper.finger_joints:
            joint = self._find(model, name, "joint")
            high = gripper.max_width / len(gripper.finger_joints)
            if abs(joint.range[1] - high) > 1e-9:
                joint.range = joint.range + (high - joint.range[1])
                actuator.ctrlrange = (actuator.ctrlrange[0], gripper.max_width)

    def _find(self, model: mujoco.MjSpec, name: str, *kinds: str) -> Any:
        """Part of one of these kinds by its name; a ModelError lists those there are."""
        known = []
        for kind in kinds:
            if (found := getattr(model, kind)(name)) is not None:
                return found
            known += [part.name for part in _parts(model, kind)]
        raise ModelError(
            f"arm {self.name!r}: the model has no {' or '.join(kinds)} {name!r}. "
            f"It has: {', '.join(sorted(known)) or 'none'}{'; camera_mount can add one' if 'camera' in kinds else ''}"
        )


def _parts(model: mujoco.MjSpec, kind: str) -> list[Any]:
    return list(getattr(model, "bodies" if kind == "body" else f"{kind}s"))


_MODELS = Path(__file__).parent / "models"

# At home the camera looks straight down at the middle of the workspace from 0.35 m above the table: far from the robot
# is up in the image, and right is right. The elbow is up; every joint has a fifth of its range or more to either side.
ARMS: dict[str, ArmSpec] = {
    "ur5e": ArmSpec(
        name="ur5e",
        mjcf=_MODELS / "ur5e.xml",
        camera="hand_camera",
        joints=("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"),
        home=(0.2699, -1.5829, -1.8374, -1.2922, 1.5708, 0.2699),
        joint_speed=3.1416,
    ),
    "baxter": ArmSpec(
        name="baxter",
        mjcf=_MODELS / "baxter.xml",
        camera="hand_camera",
        joints=("right_s0", "right_s1", "right_e0", "right_e1", "right_w0", "right_w1", "right_w2"),
        home=(0.0739, -0.9087, 1.0153, 1.8746, -0.6728, 0.9940, 0.6025),
        table_height=-0.20,
        floor_height=-0.93,
        workspace=((0.55, 0.65), (-0.4, -0.1)),
        gripper=GripperSpec(
            actuator="gripper",
            finger_joints=("finger_a", "finger_b"),
            range_site="ir_sensor",
            grasp_site="grasp",
            max_width=0.072,
        ),
        joint_speed=(2.0, 2.0, 2.0, 2.0, 4.0, 4.0, 4.0),
    ),
}


def arm_spec(arm: str | ArmSpec) -> ArmSpec:
    """The known arm of that name, or the spec itself; an UnknownNameError lists the names there are."""
    if isinstance(arm, ArmSpec):
        return arm
    if arm not in ARMS:
        raise UnknownNameError("arm", arm, ARMS)
    return ARMS[arm]
