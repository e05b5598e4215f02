"""The four motions of which every other is made: a planar step, yaw, pitch and roll. Thesis 2.2; errata 6 and 7.

All are given in the camera's own optical frame: x right, y down, z forward.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arm import EyeInHandArm, Motion, StopReason

__all__ = ["advance", "pitch", "planar_step", "planar_vector", "roll", "toward_pixel", "turn", "yaw"]


def planar_vector(distance: float, direction: float) -> NDArray[np.float64]:
    """The displacement of a planar step in the camera's frame, shape (3,), m (2.2, Planar Motions; errata 6).

    Parameters
    ----------
    distance
        m.
    direction
        rad, as the thesis counts it: 0 right, pi/2 up, pi left, 3 pi/2 down in the image. Up is -y, hence the
        sign that the printed form lacks.
    """
    return distance * np.array([np.cos(direction), -np.sin(direction), 0.0])


def planar_step(arm: EyeInHandArm, distance: float, direction: float) -> Motion:
    """Move the camera by ``distance`` m within its image plane, its orientation unchanged. See :func:`planar_vector`.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> arm = WorkCell(arm="floating").arm
    >>> before = arm.camera_pose()
    >>> planar_step(arm, 0.02, np.pi / 2).reached  # up in the image
    True
    >>> (before.inv() * arm.camera_pose()).translation.round(3).tolist()
    [0.0, -0.02, 0.0]
    """
    return arm.move_camera(RigidTransform.from_translation(planar_vector(distance, direction)))


def advance(arm: EyeInHandArm, distance: float) -> Motion:
    """Move the camera by ``distance`` m along its optical axis, toward what it sees where positive."""
    return arm.move_camera(RigidTransform.from_translation([0.0, 0.0, distance]))


def yaw(arm: EyeInHandArm, angle: float) -> Motion:
    """Turn the camera on the spot about its y axis, rad; positive looks further right (errata 7)."""
    return arm.move_camera(turn([0.0, angle, 0.0]))


def pitch(arm: EyeInHandArm, angle: float) -> Motion:
    """Turn the camera on the spot about its x axis, rad; positive looks further up (errata 7)."""
    return arm.move_camera(turn([angle, 0.0, 0.0]))


def roll(arm: EyeInHandArm, angle: float) -> Motion:
    """Turn the camera about its optical axis, rad; positive is clockwise as seen from behind the camera, so that the
    picture turns the other way.

    By the wrist's joint alone where the camera looks along it. Where that joint's limit is in the way, or the camera
    looks elsewhere, the whole arm turns the camera.
    """
    motion = arm.rotate_wrist(angle)
    return arm.move_camera(turn([0.0, 0.0, angle])) if motion.reason is StopReason.JOINT_LIMIT else motion


def turn(rotation_vector: ArrayLike) -> RigidTransform:
    """A turn on the spot by a rotation vector, shape (3,), rad, in the camera's frame."""
    return RigidTransform.from_rotation(Rotation.from_rotvec(np.asarray(rotation_vector, float)))


def toward_pixel(intrinsics: CameraIntrinsics, pixel: ArrayLike) -> Rotation:
    """The yaw, then pitch, after which the optical axis passes where ``pixel`` (u, v) is now.

    Exact at any distance: a turn on the spot needs the angle of a ray, not the object's depth (errata 8). For small
    errors ``e = center - pixel`` it is the thesis's proportional law, yaw = -e_u / f and pitch = +e_v / f (errata 7).
    """
    pixel = np.asarray(pixel, float)
    if pixel.shape != (2,) or not np.isfinite(pixel).all():
        raise InvalidParameterError(f"a pixel is a finite (u, v), shape (2,); got {pixel.tolist()}")
    x, y, z = intrinsics.rays(pixel)
    return Rotation.from_euler("YX", [np.arctan2(x, z), -np.arctan2(y, np.hypot(x, z))])
