"""Depth from a known motion, and the range to an object. Thesis A.1; errata 9 and 10."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics

__all__ = ["estimate_depth", "range_to"]


def estimate_depth(intrinsics: CameraIntrinsics, translation: ArrayLike, before: ArrayLike, after: ArrayLike) -> float:
    """Depth of a tracked point from a motion of the camera without turning, Eq. A.1: ``J_t v / Z = (du, dv)``.

    Parameters
    ----------
    intrinsics
        Of the lens.
    translation
        How the camera moved, shape (3,) or (n, 3), m, in its own frame: v of the equation over a unit of time.
    before, after
        The point's pixel before and after, shape (2,) or (n, 2), px. Several pairs are several measurements of one
        and the same depth, each counted from where its motion ends.

    Returns
    -------
    float
        Z along the optical axis, m, *after* the motion, by least squares in 1/Z. With the pixel before the motion in
        J_t this is exact for a motion of any length, not only for a small one. ``inf`` where the point did not move,
        or moved the wrong way: then it is farther than the motion can tell.

    Raises
    ------
    InvalidParameterError
        The camera did not move, or straight toward the point, so that no depth would show. Or the shapes do not
        match, or a number is not finite.

    Notes
    -----
    What is tracked here is the centroid of a silhouette, which is not the image of the object's center: for an object
    of some depth the estimate is that of its visible outline. Errata 9: the printed u-bar and v-bar are pixel
    coordinates from the principal point, not distances traveled.

    Examples
    --------
    >>> camera = CameraIntrinsics(640, 480, 530, 530, 319.5, 239.5)
    >>> round(estimate_depth(camera, [0.02, 0, 0], [319.5, 239.5], [319.5 - 42.4, 239.5]), 4)
    0.25
    """
    v, start, end = (np.atleast_2d(np.asarray(a, float)) for a in (translation, before, after))
    if v.shape[1:] != (3,) or start.shape != (len(v), 2) or end.shape != start.shape:
        raise InvalidParameterError(
            "give a translation of shape (3,) and a pixel (u, v) before and after it, or n of each; "
            f"got shapes {np.shape(translation)}, {np.shape(before)}, {np.shape(after)}"
        )
    if not all(np.isfinite(a).all() for a in (v, start, end)):
        raise InvalidParameterError(
            "the motion and the pixels before and after it are finite numbers; "
            f"got {v.tolist()} m, {start.tolist()} and {end.tolist()} px"
        )
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


def range_to(intrinsics: CameraIntrinsics, depth: float, pixel: ArrayLike) -> float:
    """Distance from the lens to a point at ``depth`` m along the optical axis that shows at ``pixel``, m.

    After a step tangential to the sphere the depth is what it was and the range is not: Z sqrt(1 + (v/f)^2) in one
    axis (errata 10).
    """
    return float(depth / intrinsics.rays(pixel)[2])
