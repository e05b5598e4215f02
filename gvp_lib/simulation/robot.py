"""What a planner sees of a cell: an arm with a camera in its hand and a gripper, or a camera without an arm.

Encoder readings differ from true joint angles by the episode's noise. The planner gets the readings, the drive the true
angles; only :class:`~gvp_lib.simulation.truth.Truth` compares them. Thesis 1.2 (Fig. 1.2), 2.3.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation, Slerp

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError, ModelError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arm import Hand, Motion, Outcome
from gvp_lib.picture import count
from gvp_lib.simulation.arms import GripperSpec
from gvp_lib.simulation.camera import CameraSensor, camera_pose, to_mujoco_camera
from gvp_lib.simulation.drives import DynamicDrive, KinematicDrive
from gvp_lib.simulation.kinematics import InverseKinematics
from gvp_lib.simulation.scene import ARM_PREFIX, FLOATING
from gvp_lib.simulation.sensors import EpisodeNoise, Noise, RangeSensor

__all__ = ["FloatingCamera", "SimulatedArm", "SimulatedGripper"]

_LINE_STEP = 0.01  # m, between the waypoints of a straight line
_TURN_STEP = np.radians(2.0)  # rad, turn of the camera between the same
_JOINT_STEP = 0.03  # rad, between the waypoints of a motion in joint space
_MAX_JOINT_JUMP = 0.5  # rad, per waypoint of a straight line: beyond it the solution has changed its branch
_ALIGNED = np.radians(0.5)  # rad, within which the last joint's axis counts as the camera's
_AT_LIMIT = np.radians(0.5)  # rad, within which of its limit a joint counts as stopped by it
_FLOATING_SPEED, _FLOATING_TURN_RATE = 0.25, 1.0  # m/s, rad/s: those of a brisk hand, for the clock
_FINGER_STEP = 0.0005  # m of opening, between the checks of a kinematic finger
_FINGER_SECONDS = 1.0  # s, that opening or closing takes
_FINGER_TRAVEL, _FINGER_COMMANDS = 0.7, 70  # s, of that time, in which the commanded width ramps, and in how many steps


@checked
class _NoisyCamera:
    """Camera with an episode's noise: what an arm and a floating camera have in common."""

    def __init__(self, sensor: CameraSensor) -> None:
        self._sensor = sensor

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """Nominal intrinsics; under ``Noise.focal_length`` and ``distortion`` the true lens differs a little."""
        return self._sensor.intrinsics

    def capture(self) -> NDArray[np.uint8]:
        """Take an RGB image, shape (height, width, 3)."""
        return self._sensor.capture(self._noise)

    def close(self) -> None:
        """Free the graphics context; the next picture makes a new one."""
        self._sensor.close()

    def begin_episode(self, noise: EpisodeNoise) -> None:
        """Adopt an episode's noise; called by the cell's ``reset``.

        Parameters
        ----------
        noise
            Draw of the noise.
        """
        self._noise = noise
        self._sensor.focus(noise.focal_scale, noise.distortion)


@checked
class SimulatedArm(_NoisyCamera):
    """Arm in a work cell. Implements :class:`gvp_lib.motion.arm.EyeInHandArm`.

    Parameters
    ----------
    kinematics
        Kinematics by which the arm plans its motions and computes the pose of its camera.
    drive
        Drive that moves the joints.
    sensor
        Camera in the hand.
    """

    def __init__(self, kinematics: InverseKinematics, drive: KinematicDrive, sensor: CameraSensor) -> None:
        super().__init__(sensor)
        self._kinematics = kinematics
        self.move_by(drive)
        self._landing_error = np.zeros(len(kinematics.limits[0]))  # rad, of the motion under way or the last one

    def __repr__(self) -> str:
        lens, arm = self.intrinsics, self._kinematics
        return (
            f"SimulatedArm({arm.name}, {count(len(self._landing_error), 'joint')}, {lens.width} x {lens.height} camera)"
        )

    @property
    def joints(self) -> NDArray[np.float64]:
        """Joint angles as the encoders read them, shape (n,), rad; a copy."""
        return self._drive.joints() - self._noise.joint_offset - self._landing_error

    def camera_pose(self) -> RigidTransform:
        """``base_from_camera`` according to the encoders."""
        return self._kinematics.forward(self.joints)

    def move_camera(self, camera_from_target: RigidTransform) -> Motion:
        """Move the camera along a straight line to a pose given in its present frame.

        The inverse kinematics are solved waypoint by waypoint, each from the one before. Where a waypoint has no
        solution, the arm stops at the last that had one.

        Parameters
        ----------
        camera_from_target
            Target pose in the present camera frame, m.
        """
        q = self.joints
        start = self._kinematics.forward(q)
        length, angle = np.linalg.norm(camera_from_target.translation), camera_from_target.rotation.magnitude()
        n = max(1, int(np.ceil(max(length / _LINE_STEP, angle / _TURN_STEP))))
        along = np.linspace(0, 1, n + 1)[1:]
        turn = Slerp([0, 1], Rotation.concatenate([start.rotation, (start * camera_from_target).rotation]))
        positions = start.apply(along[:, None] * camera_from_target.translation)
        path: list[NDArray[np.float64]] = []
        blocked = Outcome.REACHED
        # Constructed all at once: one by one, SciPy's checks would take as long as the solver.
        for base_from_camera in RigidTransform.from_components(positions, turn(along)):
            solved = self._kinematics.solve(base_from_camera, q)
            if solved is None or np.abs(solved - q).max() > _MAX_JOINT_JUMP:
                low, high = self._kinematics.limits
                at_limit = np.minimum(q - low, high - q).min() < _AT_LIMIT
                blocked = Outcome.JOINT_LIMIT if at_limit else Outcome.UNREACHABLE
                break
            path.append(solved)
            q = solved
        motion = self._follow(path)
        return Motion(blocked is Outcome.REACHED, blocked) if motion else motion

    def move_joints(self, q: ArrayLike) -> Motion:
        """Move along a straight line in joint space; nothing moves if the goal violates a joint limit.

        Parameters
        ----------
        q
            Goal in encoder readings, shape (n,), rad.
        """
        goal, start = self._kinematics.checked(q), self.joints
        low, high = self._kinematics.limits
        if (goal < low).any() or (goal > high).any():
            return Motion(False, Outcome.JOINT_LIMIT)
        n = max(1, int(np.ceil(np.abs(goal - start).max() / _JOINT_STEP)))
        return self._follow([start + (goal - start) * (k / n) for k in range(1, n)] + [goal])

    def rotate_wrist(self, angle: float) -> Motion:
        """Rotate the camera about its optical axis with the last joint alone.

        Where the camera does not look along that joint's axis, the whole arm moves so that the camera rotates in place.

        Parameters
        ----------
        angle
            Rotation from the camera's x towards its y axis, rad, at most two turns either way.
        """
        if not abs(angle) <= 4 * np.pi:
            raise InvalidParameterError(
                f"the wrist turns by a finite angle, in rad, of two turns at most; got {angle}. "
                "If degrees were meant: np.radians(angle)"
            )
        if self._wrist_sense == 0:
            return self.move_camera(_roll(angle))
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

    def move_by(self, drive: KinematicDrive) -> None:
        """Switch to another drive; called by the cell.

        Parameters
        ----------
        drive
            Drive that moves the joints from now on.
        """
        self._drive = drive

    def stand_at(self, q: NDArray[np.float64]) -> None:
        """Place the arm at once, without advancing the clock; called by the cell as it sets up an episode.

        Parameters
        ----------
        q
            *True* joint angles, shape (n,), rad.
        """
        self._landing_error[:] = 0
        self._drive.put(self._kinematics.checked(q))

    def _follow(self, path: list[NDArray[np.float64]]) -> Motion:
        """Follow a path of encoder readings."""
        reason = Outcome.REACHED
        if path:
            self._landing_error = self._noise.landing_error(len(self._landing_error))
            reason = self._drive.follow([q + self._noise.joint_offset + self._landing_error for q in path])
        return Motion(reason is Outcome.REACHED, reason)


@checked
class FloatingCamera(_NoisyCamera):
    """Free-flying camera that jumps wherever it is sent. Implements :class:`gvp_lib.motion.arm.EyeInHandArm`.

    Its six "joints" are its position (m) and rotation vector (rad) in the world frame, which is also its base frame.
    It has no limits and no collisions; the clock advances as for a hand that moves at 0.25 m/s and 1 rad/s.

    Parameters
    ----------
    model, data
        Compiled MuJoCo scene. The camera must be fixed to the world.
    camera
        Name of the camera in the scene, or its id where it has no name.
    image_size
        Width and height, pixels.
    shadows
        Whether the lamp casts shadows.
    noise, seed
        Imperfections of the camera, none by default, and the seed of their draws.
    on_waypoint
        Callback after every motion.

    Raises
    ------
    ModelError
        The scene has no such camera, or it is attached to a body.

    Examples
    --------
    >>> text = '<mujoco><worldbody><camera name="eye" pos="0 0 0.5"/><geom size="0.05"/></worldbody></mujoco>'
    >>> model = mujoco.MjModel.from_xml_string(text)
    >>> camera = FloatingCamera(model, mujoco.MjData(model), "eye")
    >>> camera.move_camera(RigidTransform.from_translation([0.0, 0.0, 0.1])).reached
    True
    >>> camera
    FloatingCamera(640 x 480, at (0.000, 0.000, 0.400) m)
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        camera: str | int = FLOATING,
        *,
        image_size: tuple[int, int] = (640, 480),
        shadows: bool = False,
        noise: Noise | None = None,
        seed: int = 0,
        on_waypoint: Callable[[], None] = lambda: None,
    ) -> None:
        names = [model.camera(i).name or i for i in range(model.ncam)]
        if camera not in names:
            there = ", ".join(map(str, names)) or "none"
            raise ModelError(f"the scene has no camera named {camera!r}; it has {there}")
        self._id = names.index(camera)
        if model.cam_bodyid[self._id] != 0:
            raise ModelError(f"camera {camera!r} hangs on a body; a floating camera is a child of the worldbody")
        super().__init__(CameraSensor(model, data, self._id, *image_size, shadows=shadows))
        self._model, self._data, self._on_waypoint = model, data, on_waypoint
        mujoco.mj_forward(model, data)
        self._home = camera_pose(data, self._id)
        self.begin_episode(EpisodeNoise(noise or Noise.none(), 0, np.random.SeedSequence(seed)))

    def __repr__(self) -> str:
        (x, y, z), lens = self._pose.translation, self.intrinsics
        return f"FloatingCamera({lens.width} x {lens.height}, at ({x:.3f}, {y:.3f}, {z:.3f}) m)"

    @property
    def joints(self) -> NDArray[np.float64]:
        """Position (m) and rotation vector (rad), shape (6,); a copy."""
        return np.concatenate([self._pose.translation, self._pose.rotation.as_rotvec()])

    def camera_pose(self) -> RigidTransform:
        """``world_from_camera``."""
        return self._pose

    def move_camera(self, camera_from_target: RigidTransform) -> Motion:
        """See :class:`gvp_lib.motion.arm.EyeInHandArm`."""
        return self.go_to(self._pose * camera_from_target)

    def move_joints(self, q: ArrayLike) -> Motion:
        """Jump to a pose given as six numbers.

        Parameters
        ----------
        q
            Position (m) and rotation vector (rad), world frame, shape (6,).
        """
        goal = np.array(q, float)
        if goal.shape != (6,) or not np.isfinite(goal).all():
            raise InvalidParameterError(
                f"a floating camera's joints are 6 finite numbers, position (m) and rotation vector (rad); got {q!r}"
            )
        return self.go_to(RigidTransform.from_components(goal[:3], Rotation.from_rotvec(goal[3:])))

    def rotate_wrist(self, angle: float) -> Motion:
        """See :class:`gvp_lib.motion.arm.EyeInHandArm`."""
        if not np.isfinite(angle):
            raise InvalidParameterError(f"the wrist turns by a finite angle, in rad; got {angle}")
        return self.move_camera(_roll(angle))

    def begin_episode(self, noise: EpisodeNoise) -> None:
        """Adopt an episode's noise and return to the initial pose; called by the cell's ``reset``.

        Parameters
        ----------
        noise
            Draw of the noise.
        """
        super().begin_episode(noise)
        self.stand_at(self._home)

    def stand_at(self, world_from_camera: RigidTransform) -> None:
        """Place the camera without advancing the clock; called by the cell as it sets up an episode.

        Parameters
        ----------
        world_from_camera
            Pose of the optical frame.
        """
        self._model.cam_pos[self._id], self._model.cam_quat[self._id] = to_mujoco_camera(world_from_camera)
        mujoco.mj_camlight(self._model, self._data)
        self._pose = world_from_camera

    def go_to(self, world_from_camera: RigidTransform) -> Motion:
        """Jump to a pose given in the world frame.

        Parameters
        ----------
        world_from_camera
            Pose of the optical frame.
        """
        step = self._pose.inv() * world_from_camera
        length, angle = np.linalg.norm(step.translation), step.rotation.magnitude()
        self._data.time += max(length / _FLOATING_SPEED, angle / _FLOATING_TURN_RATE)
        self.stand_at(world_from_camera)
        self._on_waypoint()
        return Motion(True, Outcome.REACHED)


@checked
class SimulatedGripper:
    """Parallel gripper of coupled fingers, with a range sensor. Implements :class:`gvp_lib.motion.arm.Gripper`.

    Parameters
    ----------
    model, data
        Compiled MuJoCo scene, with the arm attached.
    spec
        Gripper of that arm.
    camera
        Name of the camera in the hand, from which ``hand`` is measured.
    drive
        Drive that keeps the clock.

    Attributes
    ----------
    stroke
        Distance between the pads when shut and when fully open, m.
    hand
        Distances of the hand's parts from the camera along the optical axis.
    finger_geoms
        Ids of the fingers' geoms, for judging their contacts.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, spec: GripperSpec, camera: str, drive: KinematicDrive
    ) -> None:
        self._model, self._data = model, data
        self.move_by(drive)
        sensor = model.site(ARM_PREFIX + spec.range_site).id
        self._sensor = RangeSensor(model, data, sensor)
        joints = [model.joint(ARM_PREFIX + name) for name in spec.finger_joints]
        self._qpos = np.concatenate([joint.qposadr for joint in joints])
        self.stroke: tuple[float, float] = tuple(np.sum([joint.range for joint in joints], axis=0).tolist())
        self._actuator = model.actuator(ARM_PREFIX + spec.actuator).id
        self._fingers = [np.flatnonzero(model.geom_bodyid == joint.bodyid[0]) for joint in joints]
        self.finger_geoms = frozenset(np.concatenate(self._fingers).tolist())
        self.hand = self._measure(model.camera(ARM_PREFIX + camera).id, sensor)

    def __repr__(self) -> str:
        width, shut, wide = (1000 * x for x in (self.width, *self.stroke))  # mm
        return f"SimulatedGripper(width {width:.1f} mm, stroke {shut:.0f} to {wide:.0f} mm)"

    def begin_episode(self, noise: EpisodeNoise) -> None:
        """Adopt an episode's noise and open at once; called by the cell's ``reset``.

        Parameters
        ----------
        noise
            Draw of the noise.
        """
        self._noise = noise
        self._put(self.stroke[1])

    def move_by(self, drive: KinematicDrive) -> None:
        """Switch to another drive; called by the cell.

        Parameters
        ----------
        drive
            Drive that keeps the clock from now on.
        """
        self._drive = drive

    @property
    def width(self) -> float:
        """Distance between the finger pads, m."""
        return float(self._data.qpos[self._qpos].sum())

    def open(self) -> None:
        """Open fully."""
        self._go(self.stroke[1])

    def close(self) -> None:
        """Close until the fingers meet each other or an object."""
        # Asked for less than the fingers can reach, the actuator squeezes with all its force.
        shut = float(self._model.actuator_ctrlrange[self._actuator, 0])
        self._go(shut if isinstance(self._drive, DynamicDrive) else self.stroke[0])

    def range(self) -> float:
        """Read the range sensor along the hand's axis, m; ``inf`` where it sees nothing."""
        return self._sensor.read(self._noise)

    def _go(self, width: float) -> None:
        if isinstance(self._drive, DynamicDrive):
            # Ramped: commanded there at once, the fingers would strike what they should squeeze.
            start = float(self._data.ctrl[self._actuator])
            for share in np.linspace(0.0, 1.0, _FINGER_COMMANDS + 1)[1:]:
                self._data.ctrl[self._actuator] = start + share * (width - start)
                self._drive.idle(_FINGER_TRAVEL / _FINGER_COMMANDS)
            self._drive.idle(_FINGER_SECONDS - _FINGER_TRAVEL)
            body_of = self._model.geom_bodyid
            touched = (frozenset(body_of[list(geoms)].tolist()) for geoms in self._touched())
            self._drive.held = frozenset.intersection(*touched)
            return
        # Without dynamics nothing is held: the fingers stop where they first touch something.
        steps = max(1, int(np.ceil(abs(width - self.width) / _FINGER_STEP)))
        for opening in np.linspace(self.width, width, steps + 1)[1:]:
            before = self.width
            self._put(float(opening))
            if any(self._touched()):
                self._put(before)
                break
        self._drive.idle(_FINGER_SECONDS)

    def _measure(self, camera: int, sensor: int) -> Hand:
        """Measure the hand in the camera's axes; the kinematics of any pose will do."""
        data, model = self._data, self._model
        axes = (data.cam_xmat[camera].reshape(3, 3) * (1, -1, -1)).T  # MuJoCo's cameras look along -z, y up
        ahead = axes[2]
        fingers = np.concatenate(self._fingers)
        fingers = fingers[(model.geom_contype[fingers] | model.geom_conaffinity[fingers]) != 0]
        turns = data.geom_xmat[fingers].reshape(-1, 3, 3)
        boxes = model.geom_aabb[fingers]  # center and half extents, in the geom's frame
        centers = data.geom_xpos[fingers] + np.einsum("nij,nj->ni", turns, boxes[:, :3])
        halves = (np.abs(axes @ turns) * boxes[:, None, 3:]).sum(axis=2)  # (n, 3), in the camera's axes
        reach = (centers - data.cam_xpos[camera]) @ ahead + halves[:, 2]
        thickness, breadth = 2 * halves[np.argmax(reach), :2]
        sensed = float((data.site_xpos[sensor] - data.cam_xpos[camera]) @ ahead)
        return Hand(sensed, tips=float(reach.max()), thickness=float(thickness), breadth=float(breadth))

    def _put(self, width: float) -> None:
        self._data.qpos[self._qpos] = width / len(self._qpos)
        self._data.ctrl[self._actuator] = width
        mujoco.mj_forward(self._model, self._data)

    def _touched(self) -> list[set[int]]:
        """Ids of the geoms, other than the fingers', that each finger touches."""
        contact = self._data.contact
        # A pad's skin presses before its shape is reached: within the margin, and not only at an overlap.
        pairs = contact.geom[contact.dist < contact.includemargin]  # (k, 2)
        return [set(pairs[np.isin(pairs, finger).any(axis=1)].flat) - self.finger_geoms for finger in self._fingers]


def _roll(angle: float) -> RigidTransform:
    return RigidTransform.from_rotation(Rotation.from_rotvec([0.0, 0.0, angle]))
