"""A true lens: what it has in view, so that nothing else need be drawn, and how it bends straight lines."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from gvp_lib.geometry.camera import CameraIntrinsics

__all__ = ["corner_rays", "distorted", "out_of_view"]

_MARGIN = 1e-3  # m: the card rounds to single precision


def out_of_view(lens: CameraIntrinsics, centers: NDArray[np.float64], radii: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which spheres lie wholly outside the pyramid of a picture's edges; shape (n,).

    Parameters
    ----------
    lens
        The lens that draws the picture.
    centers, radii
        The spheres: shape (n, 3), in the optical frame, and (n,), meters. One that only a corner of the pyramid
        keeps out may be missed; none in view is ever taken for one outside.
    """
    inside = centers @ _inward(lens).T  # (n, 5): meters within each plane
    return np.asarray((inside < -(radii[:, None] + _MARGIN)).any(axis=1))


@lru_cache(maxsize=8)  # an episode has one lens
def _inward(lens: CameraIntrinsics) -> NDArray[np.float64]:
    """Inward normals of the pyramid's sides, and of the plane through its apex: spheres behind that may be missed
    else; unit vectors, shape (5, 3)."""
    left, top = lens.cx + 0.5, lens.cy + 0.5  # pixels, from the picture's edge to the principal point
    right, bottom = lens.width - left, lens.height - top
    normals = np.array(
        [
            [lens.fx, 0.0, left],
            [-lens.fx, 0.0, right],
            [0.0, lens.fy, top],
            [0.0, -lens.fy, bottom],
            [0.0, 0.0, 1.0],
        ]
    )
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))


@lru_cache(maxsize=8)
def corner_rays(lens: CameraIntrinsics) -> NDArray[np.float64]:
    """Unit rays through the outer corners of a picture's corner pixels, in turn, shape (4, 3), optical frame."""
    right, bottom = lens.width - 0.5, lens.height - 0.5
    rays = lens.rays([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])
    rays.flags.writeable = False
    return rays


def distorted(rgb: NDArray[np.uint8], lens: CameraIntrinsics, k1: float) -> NDArray[np.uint8]:
    """A pinhole's picture, shape (height, width, 3), as a lens with radial distortion takes it.

    Parameters
    ----------
    rgb
        The picture.
    lens
        The pinhole that took it; its principal point is the center of distortion.
    k1
        OpenCV's first radial coefficient: a ray that meets the image plane at a radius r (in focal lengths) from
        the principal point is seen at ``r * (1 + k1 * r**2)``. Negative for a barrel, positive for a pincushion.

    Returns
    -------
    The picture, interpolated linearly; ``rgb`` itself where ``k1`` is 0. Rays that lie beyond the pinhole's picture
    were never drawn, as near the border of a barrel's: there that picture's border is repeated outward. So is the
    last radius before the one at which a strong barrel would fold back on itself.
    """
    if k1 == 0:
        return rgb
    where, fraction = _maps(lens, k1)
    return np.asarray(cv2.remap(rgb, where, fraction, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.uint8)


@lru_cache(maxsize=8)  # an episode has one lens
def _maps(lens: CameraIntrinsics, k1: float) -> tuple[NDArray[np.int16], NDArray[np.uint16]]:
    """Where each pixel of the distorted picture lies in the pinhole's, in OpenCV's fixed-point form."""
    v, u = np.indices((lens.height, lens.width))
    x, y = (u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy
    seen = np.hypot(x, y)  # (height, width)
    # The distortion has no simple inverse, but a table has. Up to the fold, 1.5 times the radius is always enough.
    fold = 1 / np.sqrt(-3 * k1) if k1 < 0 else np.inf
    radius = np.linspace(0.0, min(1.5 * seen.max(), fold), 4096)
    straight = np.interp(seen, radius * (1 + k1 * radius**2), radius)
    scale = np.divide(straight, seen, out=np.ones_like(seen), where=seen > 0)
    u, v = scale * x * lens.fx + lens.cx, scale * y * lens.fy + lens.cy
    where, fraction = cv2.convertMaps(u.astype(np.float32), v.astype(np.float32), cv2.CV_16SC2)
    return np.asarray(where, np.int16), np.asarray(fraction, np.uint16)
