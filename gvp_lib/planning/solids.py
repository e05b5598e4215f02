"""The silhouette of a simple solid, in moments: what a camera at a pose would see of a box or a can.

The front faces of a convex solid tile its silhouette, so its moments are those of the projected faces, added up.
Nothing is rendered, and a few hundred silhouettes take a millisecond.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gvp_lib.geometry.camera import CameraIntrinsics

__all__ = ["BOX", "CYLINDER", "Shape", "silhouette_moments"]


@dataclass(frozen=True, eq=False)
class Shape:
    """A prism with an optional smaller top, as three rings of vertices, one above the other along +z.

    Its sizes are the lengths of its base along x and y, its height, and for the top an inset from the sides and a
    height: (a, b, h, inset, top), m. The convex hull of the three rings is the solid: a box whose top narrows like a
    mansard roof, which stands for a brick's studs, or a can with its shoulder.

    Attributes
    ----------
    name
        As in results.
    ring
        The base of unit size, counterclockwise seen from above, shape (n, 2).
    round
        Whether x and y share one size.
    """

    name: str
    ring: NDArray[np.float64]
    round: bool

    @cached_property
    def edges(self) -> NDArray[np.int64]:
        """Vertex numbers of each edge, shape (e, 2): three rings, then the verticals between them."""
        n = len(self.ring)
        i, j = np.arange(n), (np.arange(n) + 1) % n
        rings = [np.stack([k * n + i, k * n + j], axis=1) for k in range(3)]
        verticals = [np.stack([k * n + i, (k + 1) * n + i], axis=1) for k in range(2)]
        return np.concatenate([*rings, *verticals])

    @cached_property
    def faces(self) -> NDArray[np.float64]:
        """Which edges bound each face, shape (f, e): +1 along the edge, -1 against it, seen from outside as a
        counterclockwise turn; bottom, top, then the sides of the two stories."""
        n = len(self.ring)
        table = np.zeros((2 + 2 * n, 5 * n))
        table[0, :n], table[1, 2 * n : 3 * n] = -1, 1
        for story in range(2):
            for i in range(n):
                row = table[2 + story * n + i]
                row[story * n + i], row[(story + 1) * n + i] = 1, -1
                row[(3 + story) * n + (i + 1) % n], row[(3 + story) * n + i] = 1, -1
        return table

    def vertices(self, sizes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Corners in the solid's frame, shape (..., 3 n, 3), m, for sizes (..., 5); z = 0 is half way up the body."""
        a, b, h, inset, top = (sizes[..., k, None] for k in range(5))
        x, y = self.ring.T
        shape = np.broadcast_shapes((*sizes.shape[:-1], len(x)), a.shape)
        rings = [
            (a * x, b * y, np.broadcast_to(-0.5 * h, shape)),
            (a * x, b * y, np.broadcast_to(0.5 * h, shape)),
            ((a - 2 * inset) * x, (b - 2 * inset) * y, np.broadcast_to(0.5 * h + top, shape)),
        ]
        return np.concatenate([np.stack(ring, axis=-1) for ring in rings], axis=-2)

    @cached_property
    def coarse(self) -> Shape:
        """The same with half the corners where it is round: quicker, for a first search."""
        return Shape(self.name, _circle(len(self.ring) // 2), True) if self.round else self


def _circle(n: int) -> NDArray[np.float64]:
    """A polygon with the area of a circle of diameter 1."""
    angle = np.arange(n) * (2 * np.pi / n)
    radius = 0.5 * np.sqrt(2 * np.pi / (n * np.sin(2 * np.pi / n)))
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


BOX = Shape("box", 0.5 * np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]), round=False)
CYLINDER = Shape("cylinder", _circle(24), round=True)


def silhouette_moments(
    shape: Shape,
    rotation: NDArray[np.float64],
    translation: NDArray[np.float64],
    sizes: NDArray[np.float64],
    intrinsics: CameraIntrinsics,
) -> NDArray[np.float64]:
    """Area, centroid and second central moments of silhouettes, each as a filled region of the image.

    Parameters
    ----------
    shape
        The kind of solid.
    rotation, translation
        ``camera_from_solid``, shapes (..., 3, 3) and (..., 3), m.
    sizes
        Shape (..., 5), m; broadcasts against the poses.
    intrinsics
        Of the lens.

    Returns
    -------
    ndarray
        Shape (..., 6): area (px^2), u, v (px), mu20, mu11, mu02 (px^2). NaN where the solid is not in front of the
        camera.
    """
    points = shape.vertices(sizes) @ np.swapaxes(rotation, -1, -2) + translation[..., None, :]  # (..., 3 n, 3)
    z = points[..., 2]
    ahead = np.asarray((z > 1e-3).all(axis=-1))
    depth = np.where(ahead[..., None], z, 1.0)
    # From the principal point, so that the sums below do not cancel.
    x, y = intrinsics.fx * points[..., 0] / depth, intrinsics.fy * points[..., 1] / depth
    start, end = shape.edges.T
    x0, y0, x1, y1 = x[..., start], y[..., start], x[..., end], y[..., end]
    cross = x0 * y1 - x1 * y0  # (..., e)
    # A face is seen from outside where its corners turn the way they turn on the solid: with v down, clockwise.
    seen = (cross @ shape.faces.T < 0).astype(float)  # (..., f)
    weight = -(seen @ shape.faces) * cross  # of each edge; those between two seen faces cancel
    area = 0.5 * weight.sum(-1)
    sx, sy = x0 + x1, y0 + y1
    with np.errstate(divide="ignore", invalid="ignore"):
        u = _sum(weight, sx) / (6 * area)
        v = _sum(weight, sy) / (6 * area)
        xx = _sum(weight, sx * sx - x0 * x1) / (12 * area)
        yy = _sum(weight, sy * sy - y0 * y1) / (12 * area)
        xy = _sum(weight, sx * sy + x0 * y0 + x1 * y1) / (24 * area)
    found = np.stack([area, u + intrinsics.cx, v + intrinsics.cy, xx - u * u, xy - u * v, yy - v * v], axis=-1)
    return np.where((ahead & (area > 0))[..., None], found, np.nan)


def _sum(weight: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weighted sums over the edges, shape (...)."""
    return (weight[..., None, :] @ values[..., None])[..., 0, 0]
