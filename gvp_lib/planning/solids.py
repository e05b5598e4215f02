"""The silhouette of a simple solid, in moments: what a camera at a pose would see of a box or a can, and how that
changes as the solid moves and grows.

The outline of a convex solid is made of the edges between a face that is seen and one that is not. Moments are
integrals over the region, and so sums over the outline (Green's theorem); their derivatives are integrals along the
outline of the speed at which it moves outward (Reynolds' transport theorem). As the solid turns, edges join the outline
and leave it with no area in between, so that the moments do not jump. A hundred silhouettes with all derivatives take
about a millisecond.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.spatial.transform import RigidTransform

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.picture import Pictured, count

__all__ = ["BOX", "CYLINDER", "FittedSolid", "Shape", "silhouette_moments"]

Array = NDArray[np.float64]

EXPLAINED = 0.25
"""Residual up to which a solid counts as explaining the views, px, unless its fit says otherwise."""
_GAUSS = 0.5 / np.sqrt(3)  # of an edge, to each side of its middle: there two points integrate cubics exactly


@checked
@dataclass(frozen=True, eq=False)
class Shape:
    """Prism with an optional smaller top, as three rings of vertices, one above the other along +z.

    Its sizes are the lengths of its base along x and y, its height, and for the top an inset from the sides and a
    height: (a, b, h, inset, top), m. The solid is the convex hull of the three rings: a box whose top narrows like a
    mansard roof, which stands for a brick's studs, or a can with its shoulder.

    Attributes
    ----------
    name
        ``"box"`` or ``"cylinder"``.
    ring
        Base of unit size, counterclockwise seen from above, shape (n, 2); n is a multiple of four.
    round
        Whether x and y share one size.
    stories
        Number of stories: 2, or 1 without a top.

    Examples
    --------
    >>> from gvp_lib.planning import BOX
    >>> BOX, BOX.plain
    (Shape(box, 12 corners), Shape(box, 8 corners))
    >>> np.ptp(BOX.vertices(np.array([0.064, 0.032, 0.019, 0.004, 0.005])), axis=0).round(3).tolist()
    [0.064, 0.032, 0.024]
    """

    name: str
    ring: Array
    round: bool
    stories: int = 2

    def __repr__(self) -> str:
        return f"Shape({self.name}, {count(self._numbers.size, 'corner')})"

    @cached_property
    def edges(self) -> NDArray[np.int64]:
        """Vertex numbers of each edge, shape (e, 2): the rings, then the verticals between them."""
        ring = self._numbers
        around = np.stack([ring, np.roll(ring, -1, axis=1)], axis=-1)
        upward = np.stack([ring[:-1], ring[1:]], axis=-1)
        return np.concatenate([around, upward]).reshape(-1, 2)

    @cached_property
    def faces(self) -> NDArray[np.int64]:
        """Four vertex numbers of each face, counterclockwise seen from outside, shape (f, 4).

        Bottom and top come first, then the sides, story by story.
        """
        ring = self._numbers
        next_ = np.roll(ring, -1, axis=1)
        sides = np.stack([ring[:-1], next_[:-1], next_[1:], ring[1:]], axis=-1).reshape(-1, 4)
        quarters = ring[:, :: len(self.ring) // 4]
        return np.concatenate([quarters[:1, ::-1], quarters[-1:], sides])

    @cached_property
    def neighbors(self) -> NDArray[np.int64]:
        """Numbers of the faces to the left and to the right of each edge, seen from outside, shape (e, 2)."""
        sides = 2 + self._numbers[:-1]
        bottom, top = np.zeros_like(sides[:1]), np.ones_like(sides[:1])
        left = np.concatenate([sides, top, np.roll(sides, 1, axis=1)])
        right = np.concatenate([bottom, sides, sides])
        return np.stack([left, right], axis=-1).reshape(-1, 2)

    @cached_property
    def growth(self) -> Array:
        """Position of each corner along x, y, z per unit of a, b, h, then of inset, inset, top, shape (6, v).

        The corners are linear in the sizes.
        """
        found = np.zeros((6, *self._numbers.shape))
        found[:2] = self.ring.T[:, None]
        found[2, 0], found[2, 1:] = -0.5, 0.5
        found[3:5, 2:], found[5, 2:] = -2 * self.ring.T[:, None], 1.0
        return found.reshape(6, -1)

    def vertices(self, sizes: Array) -> Array:
        """Corners in the solid's frame, shape (..., v, 3), m; z = 0 is halfway up the body.

        Parameters
        ----------
        sizes
            Sizes, shape (..., 5), m.
        """
        if np.shape(sizes)[-1:] != (5,):
            raise InvalidParameterError(f"a shape has five sizes, (..., 5), m; got the shape {np.shape(sizes)}")
        body, top = self.growth[:3].T, self.growth[3:].T
        return body * sizes[..., None, :3] + top * sizes[..., None, [3, 3, 4]]

    @cached_property
    def plain(self) -> Shape:
        """The same without a top, and so with fewer vertices: its last two sizes are of no effect."""
        return replace(self, stories=1)

    @cached_property
    def coarse(self) -> Shape:
        """The same with half the corners where it is round: quicker, for a first search."""
        return replace(self, ring=_circle(len(self.ring) // 2)) if self.round else self

    @property
    def _numbers(self) -> NDArray[np.int64]:
        """Numbers of the vertices, shape (rings, n)."""
        return np.arange((self.stories + 1) * len(self.ring)).reshape(self.stories + 1, -1)


def _circle(n: int) -> Array:
    """A polygon with the area of a circle of diameter 1."""
    angle = np.arange(n) * (2 * np.pi / n)
    radius = 0.5 * np.sqrt(2 * np.pi / (n * np.sin(2 * np.pi / n)))
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


BOX = Shape("box", 0.5 * np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]), round=False)
CYLINDER = Shape("cylinder", _circle(24), round=True)


@dataclass(frozen=True, eq=False)
class FittedSolid(Pictured):
    """Box or can fitted to the views of an object.

    Attributes
    ----------
    kind
        ``"box"`` or ``"cylinder"``.
    base_from_solid
        Pose of its center; z is the side on which the top is, or a can's axis.
    sizes
        Lengths along its axes without the top, shape (3,), m; for a can, the diameter twice, then the length.
    top
        Inset from the sides and height of the top, m; (0, 0) without one.
    normal
        Outward unit vector of the face to look at, shape (3,), base frame.
    uncertainty
        Standard deviation of the normal's direction, rad, if the object is such a solid.
    residual
        What the solid leaves of the views after their corrections, px: of :class:`SilhouetteFit` the root mean square
        of their six features, of :class:`ContourFit` the third quartile of their points' distances.
    corrections
        Correction of each view's pose against what the arm believes, in its own camera frame: rotation vector (rad) and
        translation (m), shape (n, 6).
    explained
        Residual up to which it counts as explaining the views, px, by the fit that found it.
    """

    _figure = "plot_solid"

    kind: str
    base_from_solid: RigidTransform
    sizes: NDArray[np.float64]
    top: tuple[float, float]
    normal: NDArray[np.float64]
    uncertainty: float
    residual: float
    corrections: NDArray[np.float64]
    explained: float = EXPLAINED

    def __repr__(self) -> str:
        known = f", normal within {np.degrees(self.uncertainty):.2g} deg" if self.explains else ""
        return f"FittedSolid({self}{known})"

    def __str__(self) -> str:
        sizes = " x ".join(f"{1000 * length:.0f}" for length in self.lengths)
        doubt = "" if self.explains else f", unexplained: {self.residual:.2g} px left"
        return f"{self.kind} {sizes} mm{doubt}"

    @property
    def explains(self) -> bool:
        """Whether it explains the views."""
        return self.residual <= self.explained

    @property
    def lengths(self) -> NDArray[np.float64]:
        """Lengths along its axes, top included, shape (3,), m."""
        return self.sizes + (0.0, 0.0, self.top[1])

    @property
    def height(self) -> float:
        """Extent along the normal, top included, m."""
        along = np.abs(self.base_from_solid.rotation.as_matrix().T @ self.normal)
        return float(self.lengths[2 if along[2] > 0.5 else int(np.argmax(along))])

    @checked
    def within(self, share: float = 0.9) -> float:
        """Angle about the normal within which its true direction lies with a probability, rad.

        Parameters
        ----------
        share
            Probability, below 1.
        """
        if not 0 <= share < 1:
            raise InvalidParameterError(f"a probability is from 0 to below 1, 0.9 for nine times in ten; got {share}")
        return float(self.uncertainty * np.sqrt(-np.log1p(-share)))  # of errors alike in all directions

    @checked
    def surface_from(self, base_from_camera: RigidTransform) -> float:
        """Distance along a camera's optical axis to the face or side that the normal stands on, m.

        Parameters
        ----------
        base_from_camera
            Pose of the camera.
        """
        axis = base_from_camera.rotation.as_matrix()[:, 2]
        nearest = self.base_from_solid.translation + 0.5 * self.height * self.normal
        return float(axis @ (nearest - base_from_camera.translation))

    @property
    def corners(self) -> Array:
        """Corners, of which it is the convex hull, base frame, shape (v, 3), m."""
        shape = BOX if self.kind == "box" else CYLINDER
        local = shape.vertices(np.array([*self.sizes, *self.top])) - (0.0, 0.0, 0.5 * self.top[1])
        return np.asarray(self.base_from_solid.apply(local))

    @checked
    def span(self, base_from_camera: RigidTransform, depth: float, breadth: float = 0.0) -> float:
        """Width that fingers must span which close along a camera's x axis, m.

        It is that of all they pass on their way: of the part less than ``depth`` ahead of the camera.

        Parameters
        ----------
        base_from_camera
            Pose of the camera.
        depth
            Distance ahead of the camera to which the fingertips go, m.
        breadth
            Breadth of a finger along the camera's y axis, m. The fingers are level with the solid's center.
        """
        x, y, z = base_from_camera.inv().apply(self.corners).T
        y = y - base_from_camera.inv().apply(self.base_from_solid.translation)[1]
        # Every point of it is a mixture of its corners: which ones lie farthest to the right and to the left?
        region = {"A_ub": [z, y, -y], "b_ub": [depth, 0.5 * breadth, 0.5 * breadth], "A_eq": [np.ones_like(x)]}
        ends = [linprog(side * x, b_eq=[1.0], **region) for side in (1, -1)]
        return -float(sum(end.fun for end in ends)) if all(end.success for end in ends) else 0.0


def silhouette_moments(
    shape: Shape, rotation: Array, translation: Array, sizes: Array, intrinsics: CameraIntrinsics
) -> tuple[Array, Array]:
    """Area, centroid and second central moments of silhouettes, each as a filled region of the image, and how they
    change as the solid moves and grows.

    Parameters
    ----------
    shape
        Kind of solid.
    rotation, translation
        ``camera_from_solid``, shapes (..., 3, 3) and (..., 3), m.
    sizes
        Shape (..., 5), m; broadcasts against the poses.
    intrinsics
        Lens of the camera.

    Returns
    -------
    moments
        Shape (..., 6): area (px^2), u, v (px), mu20, mu11, mu02 (px^2). NaN where the solid is not in front of the
        camera.
    derivatives
        Shape (..., 6, 11): to a turn of the solid about the lens (3, per rad) and a shift (3, per m), both in the
        camera's axes, and to the five sizes (per m). NaN where the moments are.
    """
    points = rotation @ np.swapaxes(shape.vertices(sizes), -1, -2) + translation[..., None]  # (..., 3, v)
    lead = points.shape[:-2]
    rotations = np.broadcast_to(rotation, (*lead, 3, 3)).reshape(-1, 3, 3)
    sums = _integrals(shape, rotations, points.reshape(-1, *points.shape[-2:]))
    moments, added = _central(sums[..., 0] / (2, 3, 3, 4, 4, 4), intrinsics)
    return moments.reshape(*lead, 6), (added @ sums[..., 1:]).reshape(*lead, 6, 11)


def _integrals(shape: Shape, rotation: Array, points: Array) -> Array:
    """Integrals along the outlines of solids with corners ``points`` (s, 3, v), camera frame, at unit focal length:
    shape (s, 6, 12).

    The integrands are 1, x, y, x^2, x y and y^2, times the speed outward: where the silhouette swells about the
    principal point, which gives the moments of a region but for a factor, and where the solid moves or grows.
    """
    z = points[:, 2]
    near = 1 / np.where((z > 1e-3).all(-1, keepdims=True), z, np.nan)
    image = points.swapaxes(0, 1) * near  # (3, s, v)
    image[2] = near
    vertex, sign = outline_of(shape, image)  # (s, 2, k), (s, k)
    # What runs evenly along an edge in the image, at its ends: x, y, the inverse depth, and growth over the depth.
    ends = np.empty((9, *vertex.shape))
    of_each = z.shape[1] * np.arange(len(z))[:, None, None]
    ends[:3] = image.reshape(3, -1).take(of_each + vertex, axis=1)
    np.multiply(shape.growth.take(vertex, axis=1), ends[2], out=ends[3:])
    # The plane of edge and lens, as long as what area its motion sweeps: in the camera's axes, and in the solid's.
    (x0, x1), (y0, y1) = ends[:2].swapaxes(1, 2)
    plane = np.stack([y1 - y0, x0 - x1, x1 * y0 - x0 * y1]) * (0.5 * sign)  # (3, s, k)
    local = (rotation.swapaxes(1, 2) @ plane.swapaxes(0, 1)).swapaxes(0, 1)
    # Two points on each edge, by which to integrate.
    middle, half = 0.5 * (ends[:, :, 0] + ends[:, :, 1]), _GAUSS * (ends[:, :, 1] - ends[:, :, 0])
    at = np.concatenate([middle - half, middle + half], axis=-1)  # (9, s, 2 k)
    plane, local = np.concatenate([plane, plane], axis=-1), np.concatenate([local, local], axis=-1)
    (x, y, near), (px, py, pz) = at[:3], plane
    speed = np.empty((12, *x.shape))
    speed[0] = -pz
    speed[1:4] = y * pz - py, px - x * pz, x * py - y * px
    np.multiply(plane, near, out=speed[4:7])
    np.multiply(local, at[3:6], out=speed[7:10])
    speed[10] = local[0] * at[6] + local[1] * at[7]
    speed[11] = local[2] * at[8]
    powers = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)  # (s, 6, 2 k)
    return np.asarray(powers @ speed.transpose(1, 2, 0))


def outline_of(shape: Shape, image: Array) -> tuple[NDArray[np.int64], NDArray[np.int8]]:
    """Vertices at the ends of the edges of outlines, (s, 2, k), and whether these run clockwise, 1, or not, -1.

    All outlines have as many edges as any of them needs; those in excess have the sign 0.
    """
    a, b, c, d = image[:2].take(shape.faces.T, axis=-1).transpose(2, 0, 1, 3)  # (2, s, f) each
    (x0, y0), (x1, y1) = c - a, d - b
    # With v down, the corners of a face that is seen from outside turn clockwise.
    seen = (x0 * y1 < x1 * y0).view(np.int8)  # (s, f)
    left, right = shape.neighbors.T
    sign = seen.take(right, -1) - seen.take(left, -1)  # (s, e)
    most = int(np.count_nonzero(sign, axis=-1).max(initial=0))
    edge = np.argsort(sign == 0, axis=-1, kind="stable")[:, :most]
    return shape.edges.T.take(edge, axis=1).swapaxes(0, 1), np.take_along_axis(sign, edge, -1)


def _central(sums: Array, intrinsics: CameraIntrinsics) -> tuple[Array, Array]:
    """Area, centroid and central moments in pixels, and their derivatives to the sums at unit focal length, (s, 6)."""
    area = np.where(sums[:, 0] > 0, sums[:, 0], np.nan)
    u, v, xx, xy, yy = sums.T[1:] / area
    mu20, mu11, mu02 = xx - u * u, xy - u * v, yy - v * v
    # What a patch of area at (x, y) adds: x - u to the centroid, (x - u)^2 - mu20 to mu20, and so on, over the area.
    added = np.zeros((*sums.shape, 6))
    added[:, range(6), range(6)] = 1.0
    added[:, 1:, 0] = np.stack([-u, -v, u * u - mu20, u * v - mu11, v * v - mu02], axis=1)
    added[:, 3, 1], added[:, 4, 1], added[:, 4, 2], added[:, 5, 2] = -2 * u, -v, -u, -2 * v
    added[:, 1:] /= area[:, None, None]
    fx, fy = intrinsics.fx, intrinsics.fy
    scale = np.array([fx * fy, fx, fy, fx * fx, fx * fy, fy * fy])
    moments = np.stack([area, u, v, mu20, mu11, mu02], axis=-1) * scale + (0, intrinsics.cx, intrinsics.cy, 0, 0, 0)
    return moments, scale[:, None] * added
