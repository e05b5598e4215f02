"""A camera without an arm: the simplest `EyeInHandArm` there is, for tests and for fast data sets."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError, ModelError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arm import Motion, StopReason
from gvp_lib.simulation.camera import CameraSensor, camera_pose, checked_pose, to_mujoco_camera
from gvp_lib.simulation.scene import FLOATING
from gvp_lib.simulation.sensors import EpisodeNoise, Noise

__all__ = ["FloatingCamera"]

_SPEED, _TURN_RATE = 0.25, 1.0  # m/s, rad/s: those of a brisk hand, for the clock
_REACHED = Motion(True, StopReason.REACHED)


class FloatingCamera:
    """Free-flying camera, at once wherever it is sent. Implements :class:`gvp_lib.motion.arm.EyeInHandArm`.

    Its six "joints" are its position (m) and rotation vector (rad) in the world frame, which is its base frame, too.
    It has no limits and hits nothing; the clock advances as for a hand that moves at 0.25 m/s and 1 rad/s.

    Parameters
    ----------
    model, data
        Compiled MuJoCo scene. The camera must be fixed to the world.
    camera
        Name of the camera in it.
    image_size
        Width and height, pixels.
    noise
        Imperfections of the image; the rest of it does not apply, for there are no encoders.
    seed
        Seed of the noise.
    shadows
        Whether the lamp casts shadows.
    on_waypoint
        Callback after every motion.

    Raises
    ------
    ModelError
        The scene has no such camera, or it hangs on a body.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        camera: str = FLOATING,
        *,
        image_size: tuple[int, int] = (640, 480),
        noise: Noise | None = None,
        seed: int | np.random.SeedSequence = 0,
        shadows: bool = False,
        on_waypoint: Callable[[], None] = lambda: None,
    ) -> None:
        names = [model.camera(i).name for i in range(model.ncam)]
        if camera not in names:
            raise ModelError(f"the scene has no camera named {camera!r}; it has {', '.join(names) or 'none'}")
        self._id = names.index(camera)
        if model.cam_bodyid[self._id] != 0:
            raise ModelError(f"camera {camera!r} hangs on a body; a floating camera is a child of the worldbody")
        self._model, self._data, self._on_waypoint = model, data, on_waypoint
        self._sensor = CameraSensor(model, data, self._id, *image_size, shadows=shadows)
        mujoco.mj_forward(model, data)
        self._pose = self._home = camera_pose(data, self._id)
        seeds = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
        self.begin_episode(EpisodeNoise(noise or Noise.none(), 0, seeds))

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """Stated intrinsics; under ``Noise.focal_length`` and ``distortion`` the true lens differs a little."""
        return self._sensor.intrinsics

    @property
    def joints(self) -> NDArray[np.float64]:
        """Position (m) and rotation vector (rad), shape (6,); a copy."""
        pose = self.camera_pose()
        return np.concatenate([pose.translation, pose.rotation.as_rotvec()])

    def capture(self) -> NDArray[np.uint8]:
        """RGB image, shape (height, width, 3)."""
        return self._sensor.capture(self._noise)

    def camera_pose(self) -> RigidTransform:
        """``world_from_camera``."""
        return self._pose

    def move_camera(self, camera_from_target: RigidTransform) -> Motion:
        """Go to a pose given in the current camera frame."""
        return self.go_to(self._pose * checked_pose(camera_from_target, "camera_from_target"))

    def move_joints(self, q: ArrayLike) -> Motion:
        """Go to a position (m) and rotation vector (rad), shape (6,)."""
        goal = np.array(q, float)
        if goal.shape != (6,) or not np.isfinite(goal).all():
            raise InvalidParameterError(
                f"a floating camera's joints are 6 finite numbers, position (m) and rotation vector (rad); got {q!r}"
            )
        return self.go_to(RigidTransform.from_components(goal[:3], Rotation.from_rotvec(goal[3:])))

    def rotate_wrist(self, angle: float) -> Motion:
        """Roll by ``angle`` rad about the optical axis."""
        if not np.isfinite(angle):
            raise InvalidParameterError(f"the wrist turns by a finite angle, in rad; got {angle}")
        return self.move_camera(RigidTransform.from_rotation(Rotation.from_rotvec([0.0, 0.0, angle])))

    def close(self) -> None:
        """Free the graphics context; the next picture makes a new one."""
        self._sensor.close()

    def begin_episode(self, noise: EpisodeNoise) -> None:
        """Adopt an episode's noise and return to where the camera began; called by the cell's ``reset``."""
        self._noise = noise
        self._sensor.focus(noise.focal_scale, noise.distortion)
        self.stand_at(self._home)

    def stand_at(self, world_from_camera: RigidTransform) -> None:
        """Stand at a pose at once, outside of time; called by the cell as it sets up an episode."""
        self._model.cam_pos[self._id], self._model.cam_quat[self._id] = to_mujoco_camera(world_from_camera)
        mujoco.mj_camlight(self._model, self._data)
        self._pose = world_from_camera

    def go_to(self, world_from_camera: RigidTransform) -> Motion:
        """Go to a pose in the world frame."""
        step = self._pose.inv() * world_from_camera
        self._data.time += max(np.linalg.norm(step.translation) / _SPEED, step.rotation.magnitude() / _TURN_RATE)
        self.stand_at(world_from_camera)
        self._on_waypoint()
        return _REACHED
