"""The four motions that make up every other (planar step, yaw, pitch, roll), and depth from a known motion. Thesis 2.2,
A.1; errata 6, 7, 9 and 10.

All are given in the camera's own optical frame: x right, y down, z forward.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.checks import checked, finite
from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arm import EyeInHandArm, Motion, Outcome

__all__ = [
    "advance",
    "estimate_depth",
    "pitch",
    "planar_step",
    "planar_vector",
    "range_to",
    "roll",
    "toward_pixel",
    "turn",
    "yaw",
]


@checked
def planar_vector(distance: float, direction: float) -> NDArray[np.float64]:
    """Displacement of a planar step in the camera's frame, shape (3,), m (2.2, Planar Motions; errata 6).

    Up is -y, hence the sign that the printed form lacks.

    Parameters
    ----------
    distance
        Length of the step, m.
    direction
        Angle in the image, rad: 0 right, pi/2 up, pi left, 3 pi/2 down.

    Examples
    --------
    >>> planar_vector(0.02, np.pi / 2).round(3).tolist()
    [0.0, -0.02, 0.0]
    """
    finite(distance=distance, direction=direction)
    return distance * np.array([np.cos(direction), -np.sin(direction), 0.0])


@checked
def planar_step(arm: EyeInHandArm, distance: float, direction: float) -> Motion:
    """Move the camera within its image plane, its orientation unchanged.

    Parameters
    ----------
    arm
        Arm to move.
    distance, direction
        As in :func:`planar_vector`.

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


@checked
def advance(arm: EyeInHandArm, distance: float) -> Motion:
    """Move the camera along its optical axis.

    Parameters
    ----------
    arm
        Arm to move.
    distance
        Length of the motion, m; positive toward what the camera sees.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> advance(WorkCell(arm="floating").arm, 0.05).reached
    True
    """
    finite(distance=distance)
    return arm.move_camera(RigidTransform.from_translation([0.0, 0.0, distance]))


@checked
def yaw(arm: EyeInHandArm, angle: float) -> Motion:
    """Turn the camera on the spot about its y axis (errata 7).

    Parameters
    ----------
    arm
        Arm to move.
    angle
        Angle, rad; positive looks further right.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> yaw(WorkCell(arm="floating").arm, np.radians(10)).reached
    True
    """
    return arm.move_camera(turn([0.0, angle, 0.0]))


@checked
def pitch(arm: EyeInHandArm, angle: float) -> Motion:
    """Turn the camera on the spot about its x axis (errata 7).

    Parameters
    ----------
    arm
        Arm to move.
    angle
        Angle, rad; positive looks further up.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> pitch(WorkCell(arm="floating").arm, np.radians(10)).reached
    True
    """
    return arm.move_camera(turn([angle, 0.0, 0.0]))


@checked
def roll(arm: EyeInHandArm, angle: float) -> Motion:
    """Turn the camera about its optical axis.

    The wrist's joint does it alone where the camera looks along it. Where that joint's limit is in the way, or the
    camera looks elsewhere, the whole arm turns the camera.

    Parameters
    ----------
    arm
        Arm to move.
    angle
        Angle, rad; positive is clockwise seen from behind the camera, so that the picture turns the other way.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> roll(WorkCell(arm="floating").arm, np.radians(10)).reached
    True
    """
    finite(angle=angle)
    motion = arm.rotate_wrist(angle)
    return arm.move_camera(turn([0.0, 0.0, angle])) if motion.reason is Outcome.JOINT_LIMIT else motion


@checked
def turn(rotation_vector: ArrayLike) -> RigidTransform:
    """Turn on the spot, as ``camera_from_target``.

    Parameters
    ----------
    rotation_vector
        Rotation vector in the camera's frame, shape (3,), rad.

    Examples
    --------
    >>> turn([0, 0, np.pi / 2]).apply([1, 0, 0]).round(3).tolist()
    [0.0, 1.0, 0.0]
    """
    finite((3,), rotation_vector=rotation_vector)
    return RigidTransform.from_rotation(Rotation.from_rotvec(np.asarray(rotation_vector, float)))


@checked
def toward_pixel(intrinsics: CameraIntrinsics, pixel: ArrayLike) -> Rotation:
    """Yaw, then pitch, after which the optical axis points where a pixel is now.

    It is exact at any distance: a turn on the spot needs the angle of a ray, not the object's depth (errata 8). For
    small errors ``e = center - pixel`` it is the thesis's proportional law, yaw = -e_u / f and pitch = +e_v / f
    (errata 7).

    Parameters
    ----------
    intrinsics
        Camera's lens.
    pixel
        Pixel (u, v), shape (2,).

    Examples
    --------
    >>> camera = CameraIntrinsics(640, 480, 530, 530, 319.5, 239.5)
    >>> np.degrees(toward_pixel(camera, [319.5 + 530, 239.5]).as_rotvec()).round(3).tolist()
    [0.0, 45.0, 0.0]
    """
    finite((2,), pixel=pixel)
    x, y, z = intrinsics.rays(pixel)
    return Rotation.from_euler("YX", [np.arctan2(x, z), -np.arctan2(y, np.hypot(x, z))])


@checked
def estimate_depth(intrinsics: CameraIntrinsics, translation: ArrayLike, before: ArrayLike, after: ArrayLike) -> float:
    """Depth of a tracked point from a translation of the camera, Eq. A.1: ``J_t v / Z = (du, dv)``.

    Parameters
    ----------
    intrinsics
        Camera's lens.
    translation
        Translation of the camera in its own frame, shape (3,) or (n, 3), m: the equation's v over a unit of time.
    before, after
        Pixel of the point before and after, shape (2,) or (n, 2), px. Several pairs are several measurements of the
        same depth, each counted from where its motion ends.

    Returns
    -------
    float
        Z along the optical axis *after* the motion, m, by least squares in 1/Z. With the pixel before the motion in
        J_t this is exact for a motion of any length. ``inf`` where the point did not move, or moved the wrong way:
        it is farther away than the motion can tell.

    Raises
    ------
    InvalidParameterError
        The motion shows no depth, because the camera did not move, or moved straight toward the point; or the shapes
        do not match, or a number is not finite.

    Notes
    -----
    What the library tracks is the centroid of a silhouette, which is not the image of the object's center: for an
    object of some depth the estimate is the depth of its visible outline. Errata 9: the printed u-bar and v-bar are
    pixel coordinates from the principal point, not distances traveled.

    Examples
    --------
    >>> camera = CameraIntrinsics(640, 480, 530, 530, 319.5, 239.5)
    >>> round(estimate_depth(camera, [0.02, 0, 0], [319.5, 239.5], [319.5 - 42.4, 239.5]), 4)
    0.25
    """
    v, start, end = (np.atleast_2d(np.asarray(a, float)) for a in (translation, before, after))
    if not (v.shape[1:] == (3,) and start.shape == end.shape == (len(v), 2)):
        shapes = ", ".join(str(np.shape(a)) for a in (translation, before, after))
        raise InvalidParameterError(
            "give a translation of shape (3,), m, and a pixel (u, v) before and after it, or n of each; got shapes "
            f"{shapes}"
        )
    if not all(np.isfinite(a).all() for a in (v, start, end)):
        raise InvalidParameterError("the motion, m, and the pixels before and after it are finite numbers")
    focal = np.array([intrinsics.fx, intrinsics.fy])
    centered = start - intrinsics.principal_point  # u-bar, v-bar
    jv = (-focal * v[:, :2] + centered * v[:, 2:]).ravel()  # J_t v, px m
    power = float(jv @ jv)
    if power < (1e-6 * focal.mean()) ** 2:  # a micrometer sideways
        raise InvalidParameterError(
            f"a motion of {np.round(v, 6).tolist()} m does not shift the point in the image, so it tells no depth; "
            "move the camera sideways, by a centimeter or more"
        )
    inverse = float(jv @ (end - start).ravel()) / power
    return 1 / inverse if inverse > 0 else float("inf")


@checked
def range_to(intrinsics: CameraIntrinsics, depth: float, pixel: ArrayLike) -> float:
    """Distance from the lens to a point, m, by its depth and pixel.

    After a step tangential to the sphere the depth is what it was, but the range is not: it is Z sqrt(1 + (v/f)^2) in
    one axis (errata 10).

    Parameters
    ----------
    intrinsics
        Camera's lens.
    depth
        Depth along the optical axis, m.
    pixel
        Pixel (u, v), shape (2,).

    Examples
    --------
    >>> camera = CameraIntrinsics(640, 480, 530, 530, 319.5, 239.5)
    >>> round(range_to(camera, 1.0, [319.5 + 530, 239.5]), 4)
    1.4142
    """
    finite((2,), pixel=pixel)
    return float(depth / intrinsics.rays(pixel)[2])
