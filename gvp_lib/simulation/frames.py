"""The wall between MuJoCo's conventions and ours.

MuJoCo's camera looks along -z with y up; ours is the optical frame, x right, y down, z forward. MuJoCo's
quaternions are (w, x, y, z). Neither leaves `simulation`.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics

__all__ = [
    "camera_intrinsics",
    "camera_pose",
    "checked_pose",
    "from_mujoco_camera",
    "optical_pose",
    "pose",
    "to_mujoco_camera",
]

_MUJOCO_FROM_OPTICAL = np.diag([1.0, -1.0, -1.0])  # half a turn about x; its own inverse


def checked_pose(given: RigidTransform, name: str) -> RigidTransform:
    """A pose that a caller gave, or the error that says what a pose is."""
    what = f"a {type(given).__name__}"
    if isinstance(given, RigidTransform):
        what = "one that is not finite" if given.single else f"{len(given)} of them"
        if given.single and np.isfinite(given.as_matrix()).all():
            return given
    raise InvalidParameterError(
        f"{name} is one scipy.spatial.transform.RigidTransform, in m; got {what}. RigidTransform.from_matrix makes one "
        "of a 4 x 4 matrix, RigidTransform.from_translation one of a shift"
    )


def pose(position: NDArray[np.float64], matrix: NDArray[np.float64]) -> RigidTransform:
    """A pose from MuJoCo's ``xpos`` (3,) and ``xmat`` (9,)."""
    return RigidTransform.from_components(position, Rotation.from_matrix(matrix.reshape(3, 3)))


def optical_pose(position: NDArray[np.float64], matrix: NDArray[np.float64]) -> RigidTransform:
    """The optical frame's pose, from ``cam_xpos`` (3,) and ``cam_xmat`` (9,)."""
    return pose(position, matrix.reshape(3, 3) @ _MUJOCO_FROM_OPTICAL)


def camera_pose(data: mujoco.MjData, camera: int) -> RigidTransform:
    """``world_from_camera`` of a camera in the model, optical frame."""
    return optical_pose(data.cam_xpos[camera], data.cam_xmat[camera])


def camera_intrinsics(model: mujoco.MjModel, camera: int, width: int, height: int) -> CameraIntrinsics:
    """The lens of a camera in the model, for a picture of this size in pixels.

    A camera has a field of view, or a sensor with a focal length and a principal point in meters, which MuJoCo
    spreads over whatever picture it draws. It counts the principal point from the center, left and up.
    """
    if not model.cam_sensorsize[camera].all():
        return CameraIntrinsics.from_fov(float(np.radians(model.cam_fovy[camera])), width, height)
    density = np.array([width, height]) / model.cam_sensorsize[camera]  # pixels per meter
    fx, fy = (model.cam_intrinsic[camera, :2] * density).tolist()
    left, up = (model.cam_intrinsic[camera, 2:] * density).tolist()
    return CameraIntrinsics(width, height, fx, fy, 0.5 * (width - 1) - left, 0.5 * (height - 1) - up)


def from_mujoco_camera(body_from_camera: RigidTransform) -> RigidTransform:
    """A camera's pose as MuJoCo states it, turned into the optical frame's."""
    return body_from_camera * RigidTransform.from_rotation(Rotation.from_matrix(_MUJOCO_FROM_OPTICAL))


def to_mujoco_camera(body_from_camera: RigidTransform) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Position (3,) and wxyz quaternion (4,) of a MuJoCo camera whose optical frame stands at a pose."""
    turned = from_mujoco_camera(body_from_camera)
    return turned.translation, turned.rotation.as_quat(scalar_first=True)
