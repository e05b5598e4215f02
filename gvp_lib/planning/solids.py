"""The silhouette of a simple solid, in moments: what a camera at a pose would see of a box or a can, and how that
changes as the solid moves and grows.

The front faces of a convex solid tile its silhouette, so that its outline is made of the edges between a face that is
seen and one that is not. Moments are integrals over the region, and so sums over the outline (Green's theorem); their
derivatives are integrals along the outline of how fast it moves outward (Reynolds' transport theorem). Which edges
make the outline may change as the solid turns: that an edge joins or leaves it with no area in between, so nothing
jumps. Nothing is rendered, and a hundred silhouettes with their derivatives take a millisecond or two.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gvp_lib.geometry.camera import CameraIntrinsics

__all__ = ["BOX", "CYLINDER", "Shape", "silhouette_derivatives", "silhouette_moments"]

Array = NDArray[np.float64]

_GAUSS = 0.5 / np.sqrt(3)  # of an edge, to each side of its middle: there two points integrate cubics exactly


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
        The base of unit size, counterclockwise seen from above, shape (n, 2); n is a multiple of four.
    round
        Whether x and y share one size.
    """

    name: str
    ring: Array
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
    def faces(self) -> NDArray[np.int64]:
        """Four vertex numbers of each face, counterclockwise seen from outside, shape (f, 4): bottom, top, then the
        sides of the two stories."""
        n = len(self.ring)
        i, j = np.arange(n), (np.arange(n) + 1) % n
        quarters = np.arange(4) * (n // 4)
        sides = [np.stack([k * n + i, k * n + j, (k + 1) * n + j, (k + 1) * n + i], axis=1) for k in range(2)]
        return np.concatenate([quarters[None, ::-1], 2 * n + quarters[None], *sides])

    @cached_property
    def sides(self) -> NDArray[np.int64]:
        """Numbers of the faces to the left and to the right of each edge, seen from outside, shape (e, 2)."""
        n = len(self.ring)
        bottom, top = np.zeros(n, int), np.ones(n, int)
        lower, upper = 2 + np.arange(n), 2 + n + np.arange(n)
        left = [lower, upper, top, np.roll(lower, 1), np.roll(upper, 1)]
        right = [bottom, lower, upper, lower, upper]
        return np.stack([np.concatenate(left), np.concatenate(right)], axis=1)

    @cached_property
    def growth(self) -> Array:
        """How far each corner lies along x, y and z per unit of a, b, h, then per unit of inset, inset, top: (6, 3 n)."""
        body, top = np.zeros((3, 3, len(self.ring))), np.zeros((3, 3, len(self.ring)))  # (axis, ring, corner)
        body[:2], body[2] = self.ring.T[:, None], np.array([[-0.5], [0.5], [0.5]])
        top[:2, 2], top[2, 2] = -2 * self.ring.T, 1.0
        return np.concatenate([body, top]).reshape(6, -1)

    def vertices(self, sizes: Array) -> Array:
        """Corners in the solid's frame, shape (..., 3 n, 3), m, for sizes (..., 5); z = 0 is half way up the body."""
        body, top = self.growth[:3].T, self.growth[3:].T
        return body * sizes[..., None, :3] + top * sizes[..., None, [3, 3, 4]]

    @cached_property
    def coarse(self) -> Shape:
        """The same with half the corners where it is round: quicker, for a first search."""
        return Shape(self.name, _circle(len(self.ring) // 2), True) if self.round else self


def _circle(n: int) -> Array:
    """A polygon with the area of a circle of diameter 1."""
    angle = np.arange(n) * (2 * np.pi / n)
    radius = 0.5 * np.sqrt(2 * np.pi / (n * np.sin(2 * np.pi / n)))
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


BOX = Shape("box", 0.5 * np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]), round=False)
CYLINDER = Shape("cylinder", _circle(24), round=True)


def silhouette_moments(
    shape: Shape, rotation: Array, translation: Array, sizes: Array, intrinsics: CameraIntrinsics
) -> Array:
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
    return silhouette_derivatives(shape, rotation, translation, sizes, intrinsics)[0]


def silhouette_derivatives(
    shape: Shape, rotation: Array, translation: Array, sizes: Array, intrinsics: CameraIntrinsics
) -> tuple[Array, Array]:
    """The same moments, and how they change as the solid moves and grows.

    Parameters
    ----------
    shape, rotation, translation, sizes, intrinsics
        As of :func:`silhouette_moments`.

    Returns
    -------
    moments
        Shape (..., 6).
    derivatives
        Shape (..., 6, 11): to a turn of the solid about the lens (3, per rad) and a shift (3, per m), both in the
        camera's axes, and to the five sizes (per m). NaN where the moments are.
    """
    corners = shape.vertices(sizes)  # (..., 3 n, 3)
    points = rotation @ np.swapaxes(corners, -1, -2) + translation[..., None]  # (..., 3, 3 n)
    lens = -np.swapaxes(rotation, -1, -2) @ translation[..., None]  # in the solid's frame, (..., 3, 1)
    vertex, sign = _outline(shape, corners, lens)  # (..., 2, k), (..., k)
    even = _ends(shape, points, vertex)
    # The plane of edge and lens: how much area a motion of the edge sweeps, in the camera's axes and in the solid's.
    (x0, x1), (y0, y1) = np.moveaxis(even[:2], -2, 1)
    plane = 0.5 * sign[..., None, :] * np.stack([y1 - y0, x0 - x1, x1 * y0 - x0 * y1], axis=-2)  # (..., 3, k)
    local = np.moveaxis(np.swapaxes(rotation, -1, -2) @ plane, -2, 0)[..., None, :]  # (3, ..., 1, k)
    plane = np.moveaxis(plane, -2, 0)[..., None, :]
    # Two points of integration on each edge.
    middle, half = 0.5 * even.sum(-2), _GAUSS * (even[..., 1, :] - even[..., 0, :])
    x, y, near, *grown = np.stack([middle - half, middle + half], axis=-2)  # (..., 2, k) each
    (px, py, pz), (lx, ly, lz) = plane, local
    powers = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-3)  # (..., 6, 2, k)
    a, b, h, inset_x, inset_y, top = grown
    swept = np.stack(
        [
            np.broadcast_to(-pz, x.shape),
            *(y * pz - py, px - x * pz, x * py - y * px),
            *(px * near, py * near, pz * near),
            *(lx * a, ly * b, lz * h, lx * inset_x + ly * inset_y, lz * top),
        ],
        axis=-3,
    )
    lead = x.shape[:-2]
    sums = powers.reshape(*lead, 6, -1) @ np.swapaxes(swept.reshape(*lead, 12, -1), -1, -2)  # (..., 6, 12)
    return _central(sums[..., 0] / (2, 3, 3, 4, 4, 4), sums[..., 1:], intrinsics)


def _outline(shape: Shape, corners: Array, lens: Array) -> tuple[NDArray[np.int64], NDArray[np.int8]]:
    """Vertices at the ends of the edges of outlines, (..., 2, k), and whether these run clockwise, 1, or not, -1.

    All outlines have as many edges as any of them needs; those in excess have the sign 0.
    """
    a, b, c, d = np.moveaxis(corners[..., shape.faces, :], -2, 0)  # (..., f, 3) each
    normal = _cross(c - a, d - b)
    seen = ((normal @ lens)[..., 0] > (normal * a).sum(-1)).view(np.int8)  # (..., f)
    left, right = shape.sides.T
    sign = seen.take(right, -1) - seen.take(left, -1)  # (..., e)
    most = int(np.count_nonzero(sign, axis=-1).max(initial=0))
    edge = np.argsort(sign == 0, axis=-1, kind="stable")[..., :most]
    vertex = np.stack([shape.edges[:, 0].take(edge), shape.edges[:, 1].take(edge)], axis=-2)
    return vertex, np.take_along_axis(sign, edge, -1)


def _ends(shape: Shape, points: Array, vertex: NDArray[np.int64]) -> Array:
    """What runs evenly along an edge in the image, at its ends, shape (9, ..., 2, k).

    x and y at unit focal length, the inverse depth, and what growth does, over the depth.
    """
    count = points.shape[-1]
    near = 1 / np.where(points[..., 2, :] > 1e-3, points[..., 2, :], np.nan)
    image = points * near[..., None, :]
    image[..., 2, :] = near
    first = 3 * count * np.arange(near.size // count).reshape(*near.shape[:-1], 1, 1)
    even = np.empty((9, *vertex.shape))
    for k in range(3):
        image.reshape(-1).take(vertex + (first + k * count), out=even[k])
    np.multiply(shape.growth.take(vertex, axis=1), even[2], out=even[3:])
    return even


def _cross(a: Array, b: Array) -> Array:
    """Cross product along the last axis; for few vectors quicker than NumPy's."""
    return a[..., [1, 2, 0]] * b[..., [2, 0, 1]] - a[..., [2, 0, 1]] * b[..., [1, 2, 0]]


def _central(sums: Array, slopes: Array, intrinsics: CameraIntrinsics) -> tuple[Array, Array]:
    """Area, centroid and central moments in pixels from the sums at unit focal length, (..., 6), and their slopes."""
    area = np.where(sums[..., 0] > 0, sums[..., 0], np.nan)
    u, v, xx, xy, yy = np.moveaxis(sums, -1, 0)[1:] / area
    mu20, mu11, mu02 = xx - u * u, xy - u * v, yy - v * v
    # What a patch of area at (x, y) adds: x - u to the centroid, (x - u)^2 - mu20 to mu20, and so on, over the area.
    added = np.zeros((*sums.shape, 6))
    added[..., range(6), range(6)] = 1.0
    added[..., 1:, 0] = np.stack([-u, -v, u * u - mu20, u * v - mu11, v * v - mu02], axis=-1)
    added[..., 3, 1], added[..., 4, 1], added[..., 4, 2], added[..., 5, 2] = -2 * u, -v, -u, -2 * v
    added[..., 1:, :] /= area[..., None, None]
    fx, fy = intrinsics.fx, intrinsics.fy
    scale = np.array([fx * fy, fx, fy, fx * fx, fx * fy, fy * fy])
    moments = np.stack([area, u, v, mu20, mu11, mu02], axis=-1) * scale + (0, intrinsics.cx, intrinsics.cy, 0, 0, 0)
    return moments, (scale[:, None] * added) @ slopes
