"""What a true lens has in its view, so that nothing else need be drawn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gvp_lib.geometry.camera import CameraIntrinsics

__all__ = ["out_of_view"]

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
    left, top = lens.cx + 0.5, lens.cy + 0.5  # pixels, from the picture's edge to the principal point
    right, bottom = lens.width - left, lens.height - top
    # Inward normals of the pyramid's sides, and of the plane through its apex: spheres behind that may be missed else.
    normals = np.array(
        [
            [lens.fx, 0.0, left],
            [-lens.fx, 0.0, right],
            [0.0, lens.fy, top],
            [0.0, -lens.fy, bottom],
            [0.0, 0.0, 1.0],
        ]
    )
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    inside = centers @ normals.T  # (n, 5): meters within each plane
    return np.asarray((inside < -(radii[:, None] + _MARGIN)).any(axis=1))
