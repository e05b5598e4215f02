"""How far a viewpoint is from the right one: the true error, and the thesis's, from a homography.

The thesis has no ground truth; it measures its error on the final image, by a homography between four corners of the
object and their pixels (3.1.2; its appendix A.2 is empty, errata 22). A simulator knows the error. Here are both, and
the error that the thesis's metric reports for a camera that has none: its floor.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.checks import checked, finite
from gvp_lib.errors import InvalidParameterError
from gvp_lib.evaluation.statistics import Summary, summarize
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.simulation.objects import ObjectSpec
from gvp_lib.simulation.truth import AcceptedNormal, Truth

__all__ = ["ViewpointError", "face_corners", "homography_error", "homography_floor", "viewpoint_error"]

_SQUARE = 0.02  # sides that agree within this share are a square's, as in `box_normals`
_SIGNS = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])  # top left, then clockwise in the image


@dataclass(frozen=True, slots=True)
class ViewpointError:
    """Rotation by which a camera is off from an aligned view, in its own optical frame; all rad.

    Attributes
    ----------
    total
        Angle between the reversed optical axis and the nearest accepted normal (Eq. 2.10; errata 16), in [0, pi].
    about_x, about_y
        Smallest rotation that brings one onto the other, as a rotation vector (about_x, about_y, 0): the thesis's
        pitch and yaw. Positive about x from y toward z: the lens dips; about y from z toward x: it turns right. They
        are not two successive turns and do not add up to the total; their hypotenuse is the total.
    roll
        Remaining roll about the optical axis, positive from x toward y, modulo the object's symmetry. 0 where any roll
        is right, NaN where the camera looks along the major axis.
    """

    total: float
    about_x: float
    about_y: float
    roll: float


@checked
def viewpoint_error(truth: Truth) -> ViewpointError:
    """True error of a cell's camera as it now stands: the judge's, not the planner's.

    Parameters
    ----------
    truth
        Truth of the cell, ``cell.truth``.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> error = viewpoint_error(WorkCell(arm="floating").truth)
    >>> bool(0 <= error.total <= np.pi)
    True
    """
    return _error(truth.normal, truth.world_from_camera)


@checked
def face_corners(spec: ObjectSpec, world_from_object: RigidTransform, direction: ArrayLike) -> NDArray[np.float64]:
    """Four corners of what is seen of an object along a normal (thesis 3.1.2; errata 22).

    A can has no corners: for it they are the rectangle of its silhouette, length by diameter, through its middle and
    across the normal; or, seen along its axis, the square about its top's circle. For all else they are the face of the
    bounding box that faces the normal, at that face's height: for a brick the plane of the studs' tops, as long and as
    wide as the body beneath.

    Parameters
    ----------
    spec
        Object. A can's round axis is one of the axes of its bounding box.
    world_from_object
        Pose of the object.
    direction
        Outward normal in the world frame, shape (3,): for a camera at hand,
        ``truth.normal.nearest(-world_from_camera.rotation.as_matrix()[:, 2])``, which for a lying can is the member
        of the circle nearest to the camera.

    Returns
    -------
    NDArray
        Points in the world frame, m, shape (4, 3): top left, top right, bottom right and bottom left in the image of an
        aligned camera, whose y axis lies along the longer side.

    Examples
    --------
    >>> from gvp_lib import OBJECTS
    >>> corners = face_corners(OBJECTS["cuboid_1x2"], RigidTransform.identity(), [0, 0, 1])
    >>> np.round(1000 * np.ptp(corners, axis=0)).tolist()  # mm
    [64.0, 32.0, 0.0]
    """
    finite((3,), direction=direction)
    outward = world_from_object.rotation.as_matrix().T @ np.asarray(direction, float)
    box, axes = spec.bounding_box(), np.eye(3)
    half, facing = box.half_extents, int(np.argmax(np.abs(outward)))
    if spec.round_axis is not None:
        along = int(np.argmax(np.abs(np.asarray(spec.round_axis, float))))
        radius = np.delete(half, along).max()
        if facing != along:
            # An aligned camera: y along the axis, z against the normal, so x = y cross z.
            across = np.cross(outward, axes[along])
            sides = np.array([radius * (across / np.linalg.norm(across)), half[along] * axes[along]])  # (2, 3)
            return world_from_object.apply(box.center + _SIGNS @ sides)
        half = np.where(np.arange(3) == along, half, radius)
    i, j = (axis for axis in range(3) if axis != facing)
    short, long = (i, j) if half[j] >= half[i] else (j, i)
    normal = np.sign(outward[facing]) * axes[facing]
    x = np.cross(axes[long], -normal)
    sides = np.array([half[short] * x, half[long] * axes[long]])  # (2, 3)
    return world_from_object.apply(box.center + half[facing] * normal + _SIGNS @ sides)


@checked
def homography_error(
    corners: ArrayLike,
    world_from_camera: RigidTransform,
    intrinsics: CameraIntrinsics,
    rng: np.random.Generator | int,
    pixel_sd: float = 1.0,
) -> ViewpointError:
    """Error that the thesis's metric reports for a camera (3.1.2; errata 22).

    The corners' true pixels, each with Gaussian noise, and the corners in their own plane determine a homography H.
    The columns of K^-1 H are, up to one scale, the first two columns of the rotation from the plane into the camera,
    and the translation; the nearest rotation is taken. This rests on a few pixels of perspective convergence, so that
    for small objects noise alone makes a large error: see :func:`homography_floor`. (OpenCV's other way,
    ``SOLVEPNP_IPPE``, rests on foreshortening instead, which is flat at alignment: there its floor is 11 to 13 deg for
    the bricks, and 8 for the can.)

    Parameters
    ----------
    corners
        Rectangle in the world frame, m, shape (4, 3), as :func:`face_corners` orders it.
    world_from_camera, intrinsics
        True pose and intrinsics of the camera.
    rng
        Generator of the noise, or a seed.
    pixel_sd
        Standard deviation of each coordinate of a corner, px.

    Returns
    -------
    ViewpointError
        Error against the rectangle's own normal; its roll is modulo half a turn, and a quarter for a square. All NaN
        where a corner is not in front of the camera or the four pixels lie on a line. A corner beyond the image's
        border counts as seen.

    Examples
    --------
    >>> corners = [[-0.016, 0.032, 0], [0.016, 0.032, 0], [0.016, -0.032, 0], [-0.016, -0.032, 0]]  # a 1x2 brick, m
    >>> lens = CameraIntrinsics(640, 480, 530, 530, 319.5, 239.5)
    >>> above = RigidTransform.from_components([0, 0, 0.25], Rotation.from_rotvec([np.pi, 0, 0]))
    >>> bool(homography_error(corners, above, lens, rng=0, pixel_sd=0).total < 1e-6)
    True
    """
    if not 0 <= pixel_sd < np.inf:
        raise InvalidParameterError(f"pixel_sd is a standard deviation in pixels, 0 or more; got {pixel_sd}")
    points, _, sides = _rectangle(corners)
    seen = intrinsics.project(world_from_camera.inv().apply(points))  # (4, 2)
    pixels = seen + np.random.default_rng(rng).normal(0, abs(pixel_sd), seen.shape)
    homography = cv2.findHomography(0.5 * _SIGNS * sides, pixels)[0] if np.isfinite(pixels).all() else None
    if homography is None:
        return ViewpointError(*[float("nan")] * 4)
    columns = np.linalg.inv(intrinsics.matrix) @ homography
    columns *= np.sign(columns[2, 2])  # the plane is in front of the camera
    columns /= 0.5 * (np.linalg.norm(columns[:, 0]) + np.linalg.norm(columns[:, 1]))
    _, y, z = _frame(columns[:, 0], columns[:, 1]).as_matrix().T  # the plane's axes in the camera's frame
    square = abs(sides[0] - sides[1]) < _SQUARE * sides.max()
    return _error(AcceptedNormal(-z, y, np.pi / 2 if square else np.pi), RigidTransform.identity())


@checked
def homography_floor(
    corners: ArrayLike,
    radius: float,
    intrinsics: CameraIntrinsics,
    rng: np.random.Generator | int = 0,
    pixel_sd: float = 1.0,
    draws: int = 1000,
) -> Summary:
    """Total error that :func:`homography_error` reports for a perfectly aligned camera, rad (errata 22).

    Parameters
    ----------
    corners
        Rectangle, as :func:`face_corners` gives it.
    radius
        Distance of the camera from the middle of the rectangle, m.
    intrinsics, rng, pixel_sd
        As in :func:`homography_error`.
    draws
        Number of noisy repetitions.

    Examples
    --------
    >>> corners = [[-0.016, 0.032, 0], [0.016, 0.032, 0], [0.016, -0.032, 0], [-0.016, -0.032, 0]]  # a 1x2 brick, m
    >>> lens = CameraIntrinsics(640, 480, 530, 530, 319.5, 239.5)
    >>> bool(np.degrees(homography_floor(corners, 0.25, lens, draws=50).mean) > 3)
    True
    """
    if not radius > 0 or draws < 1:
        raise InvalidParameterError(f"need radius > 0 m and draws >= 1; got radius={radius}, draws={draws}")
    rng = np.random.default_rng(rng)
    _, world_from_plane, _ = _rectangle(corners)
    aligned = world_from_plane * RigidTransform.from_translation([0, 0, -radius])
    return summarize([homography_error(corners, aligned, intrinsics, rng, pixel_sd).total for _ in range(draws)])


def _error(normal: AcceptedNormal, world_from_camera: RigidTransform) -> ViewpointError:
    camera_from_world = world_from_camera.rotation.as_matrix().T
    nx, ny, _ = camera_from_world @ normal.nearest(-camera_from_world[2])
    total, norm = normal.view_angle(world_from_camera), np.hypot(nx, ny)
    # (0, 0, -1) cross n. Seen from behind, every axis across is as short: x, then.
    x, y = (ny / norm, -nx / norm) if norm > 0 else (1.0, 0.0)
    return ViewpointError(total, float(total * x), float(total * y), normal.roll_error(world_from_camera))


def _rectangle(corners: ArrayLike) -> tuple[NDArray[np.float64], RigidTransform, NDArray[np.float64]]:
    """Points (4, 3) around a rectangle, an aligned camera's pose in its middle, and its sides along that x and y, m."""
    points = np.asarray(corners, float)
    if points.shape != (4, 3) or not np.isfinite(points).all():
        raise InvalidParameterError(f"corners are four finite points, shape (4, 3), m; got {points.tolist()}")
    x, y = points[1] - points[0], points[2] - points[1]
    sides = np.array([np.linalg.norm(x), np.linalg.norm(y)])
    open_by, skewed_by = np.abs(points[0] + points[2] - points[1] - points[3]).max(), np.abs(x @ y)
    if not sides.min() > 0 or skewed_by > 1e-6 * sides.max() ** 2 or open_by > 1e-6 * sides.max():
        raise InvalidParameterError(
            "corners go around a rectangle: top left, top right, bottom right, bottom left, as face_corners gives "
            f"them; got {points.tolist()}"
        )
    return points, RigidTransform.from_components(points.mean(0), _frame(x / sides[0], y / sides[1])), sides


def _frame(x: NDArray[np.float64], y: NDArray[np.float64]) -> Rotation:
    """The rotation nearest to these first two axes and their cross product."""
    return Rotation.from_matrix(np.column_stack([x, y, np.cross(x, y)]))
