"""What a thing of any shape may at most fill: the visual hull of its silhouettes.

Where no box and no can explains the views, they still say that the object is nowhere else: a point that lies outside
one silhouette is no part of it. What is left of space is the visual hull. The object is within, so that fingers that
pass the hull pass the object, too.

Two things spoil a hull as it comes. The arm's errors, which differ from view to view, make the silhouettes disagree, so
that too little is left; so the views are first shifted until the hull's own silhouettes stand where those seen do. And
no camera looks from below, so that the hull goes on where the object ends; so it is cut off by a plane, the one that
takes most away of what no silhouette needs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.sighting import View, meeting_point
from gvp_lib.picture import count
from gvp_lib.planning.grips import Cells, Grip
from gvp_lib.planning.room import BREADTH, Room
from gvp_lib.planning.solids import FittedSolid

__all__ = ["VisualHull"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_CELLS, _FEW, _ROUNDS = 30, 20, 3  # to either side of the middle; by which views are shifted, and how often they are
_SLACK, _SHIFTING, _AGREEING = 0.0015, 0.004, 0.006  # m, by which a point may lie outside of a silhouette, at each step
_PAD = 24  # px, about a silhouette, within which it is known how far outside of it a pixel lies
_INSET, _RAYS = 3.0, 40  # px inside of an outline where the rays of a view go that must meet the object; how many
_BEHIND = np.cos(np.radians(60))  # how far a cut may slant from across the mean direction of view
_NEED = 0.01  # share of the rays that a cut may leave without a part of the hull
_AGREED, _FEWEST = 0.95, 3  # share of the rays that a hull of views that agree covers; so many views are kept
_UP: Array = np.array([0.0, 0.0, 1.0])
_LEVEL = np.cos(np.radians(20))  # a cut that is so near to level tells of no slope
_ALMOST = 0.05  # relative volume by which a box is larger that is e times less likely to be the object's
_LEAST = 50  # cells, which are something


@checked
@dataclass(frozen=True, eq=False)
class VisualHull:
    """Points that lie inside all silhouettes, and the smallest box about them.

    It serves where nothing hides the object, or hides it from a few views, which are left out: see ``covered``.

    Attributes
    ----------
    points
        Centers of the cells that are left, shape (n, 3), m, base frame.
    cell
        Side of a cell, m.
    base_from_box
        Pose of the smallest box about them.
    lengths
        Lengths of its sides, shape (3,), m.
    uncertainties
        Standard deviation of the direction of each of its axes, shape (3,), rad: how far those of boxes that are about
        as small are off.
    covered
        Share of what is just inside of the outlines that the hull covers: 1 where all silhouettes are of one thing.
    slack
        How far the points may lie outside of the object on account of the views alone, m.
    room
        What the views show to be empty about it, by which grips keep clear of other things; None: unknown.
    above
        Normal of what it stands on, as far as the views tell, shape (3,): that of the plane by which the hull was cut
        off below, or straight up where that is nearly so.
    corrections
        Shift of each view's camera against what the arm believes, in its own frame, shape (n, 3), m.

    Examples
    --------
    >>> from gvp_lib import SpreadViews, WorkCell
    >>> cell = WorkCell(arm="floating", target="alligator", seed=2)
    >>> VisualHull.of(SpreadViews(cell.segmenter).plan(cell.arm).views, cell.arm.intrinsics)
    VisualHull(... cells in a box of ... mm)
    """

    points: Array
    cell: float
    base_from_box: RigidTransform
    lengths: Array
    uncertainties: Array
    covered: float
    corrections: Array
    slack: float = _SLACK
    room: Room | None = None
    above: Array = field(default_factory=_UP.copy)

    def __repr__(self) -> str:
        sides = " x ".join(f"{1000 * length:.0f}" for length in self.lengths)
        return f"VisualHull({count(len(self.points), 'cell')} in a box of {sides} mm)"

    @classmethod
    def of(
        cls,
        views: Sequence[View],
        intrinsics: CameraIntrinsics,
        guess: FittedSolid | None = None,
    ) -> Self | None:
        """Carve the hull of some views; None where they leave nothing, or no more than a flat thing.

        Parameters
        ----------
        views
            Views, three or more, of blobs with their pixels; the border of the image may cut them.
        intrinsics
            Camera's lens.
        guess
            Solid fitted to the same views, though it does not explain them: a box along one of its axes is taken where
            it is hardly larger than the smallest.

        Raises
        ------
        InvalidParameterError
            There are fewer views, or one of moments alone.
        """
        if len(views) < _FEWEST or any(view.blob.pixels is None for view in views):
            raise InvalidParameterError(
                f"a visual hull needs {_FEWEST} views or more, of blobs with their pixels; got {list(views)!r}"
            )
        every = [_Sight.of(view, intrinsics) for view in views]
        middle = meeting_point(views, intrinsics)
        if not all(sight.base_from_camera.inv().apply(middle)[2] > 0 for sight in every):
            return None  # their lines of sight are one, or meet behind a camera
        reach = max(sight.reach(middle) for sight in every)
        kept = _agreeing(every, middle, reach)
        sights = [every[k] for k in kept]
        for _ in range(_ROUNDS):
            sights = _shifted(sights, _carved(sights, middle, reach, _FEW, _SHIFTING), reach / _FEW)
        points, cell = _carved(sights, middle, reach, _CELLS, _SLACK), reach / _CELLS
        if len(points) < _LEAST:
            return None
        points, covered, above = _cut(points, sights, cell)
        try:
            box, lengths, spread = _smallest_box(points, cell, guess)
        except QhullError:
            return None
        corrections = np.zeros((len(views), 3))
        for k, sight in zip(kept, sights, strict=True):
            believed = views[k].base_from_camera
            corrections[k] = (believed.inv() * sight.base_from_camera).translation
        spread = spread * (len(views) / len(kept))  # of views that disagree it is not known which are right
        room = Room.of(views, intrinsics)
        return cls(points, cell, box, lengths, spread, covered, corrections, room=room, above=above)

    @classmethod
    def filling(cls, solid: FittedSolid, room: Room | None = None) -> Self:
        """The inside of a solid that explains its views, as a hull that a hand can grip.

        Parameters
        ----------
        solid
            Solid, of which every axis is as uncertain as its normal.
        room
            What the views show to be empty about it.
        """
        corners, axes = solid.corners, solid.base_from_solid.rotation.as_matrix()
        local = corners @ axes
        low, lengths = local.min(axis=0), np.ptp(local, axis=0)
        cell = float(lengths.max()) / (2 * _CELLS)
        steps = [
            np.arange(start + 0.5 * cell, start + length, cell) for start, length in zip(low, lengths, strict=True)
        ]
        points = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3) @ axes.T
        faces = ConvexHull(corners).equations
        points = points[(points @ faces[:, :3].T + faces[:, 3] <= 1e-9).all(axis=1)]
        box = RigidTransform.from_components(axes @ (low + 0.5 * lengths), solid.base_from_solid.rotation)
        sd = np.full(3, solid.uncertainty)
        return cls(points, cell, box, lengths, sd, 1.0, solid.corrections[:, 3:], 0.0, room)

    def solid(self, first: View, residual: float) -> FittedSolid:
        """The smallest box as a solid whose face to look at is the one nearest to a view.

        Parameters
        ----------
        first
            View near whose direction the face lies.
        residual
            What the fit of a solid left unexplained, px.
        """
        axes, center = self.base_from_box.rotation.as_matrix(), self.base_from_box.translation
        toward = axes.T @ (first.base_from_camera.translation - center)
        facing = int(np.argmax(np.abs(toward)))
        return FittedSolid(
            kind="box",
            base_from_solid=self.base_from_box,
            sizes=self.lengths,
            top=(0.0, 0.0),
            normal=axes[:, facing] * np.sign(toward[facing]),
            uncertainty=float(self.uncertainties[facing]),
            residual=residual,
            corrections=np.column_stack([np.zeros_like(self.corrections), self.corrections]),
        )

    def grips(
        self,
        look: ArrayLike,
        opening: tuple[float, float] = (0.031, 0.066),
        *,
        pad: tuple[float, float] = (BREADTH, 0.042),
        fingers: float = 0.075,
    ) -> tuple[Grip, ...]:
        """The best places for two fingers that come from one direction, best first; none where they find no hold.

        There both pads would touch much of the hull at the same heights, about as deep as a hand goes for a box, not
        far from the hull's middle, and nothing is seen to stand where a finger comes down.

        Parameters
        ----------
        look
            Vector from the object to the hand, shape (3,).
        opening
            Least and largest width of the hull between the fingers, m: a little within what they can span.
        pad
            Breadth of a finger's pad, and its length from the fingertip upward, m.
        fingers
            Free length of the fingers, m: nothing below the hand may be higher above their tips.
        """
        given = np.asarray(look, float)
        if given.shape != (3,) or not 0 < np.linalg.norm(given) < np.inf:
            raise InvalidParameterError(f"look is a vector from the object to the hand, shape (3,); got {look!r}")
        sides = np.asarray([*pad, fingers], float)
        if not (sides.shape == (3,) and (sides > 0).all() and (sides < np.inf).all()):
            raise InvalidParameterError(
                "a pad's breadth and length and the fingers' free length are positive and finite, m; got "
                f"pad={pad}, fingers={fingers}"
            )
        if not 0 <= opening[0] < opening[1] < np.inf:
            raise InvalidParameterError(
                f"an opening goes from the least to the largest width between the fingers, m; got {opening}"
            )
        toward: Array = given / np.linalg.norm(given)
        # The box's longest side, as it is seen from there, tells one direction along which the fingers may well close.
        seen = self.base_from_box.rotation.as_matrix() * self.lengths
        seen = seen - toward[:, None] * (toward @ seen)
        x: Array = seen[:, np.argmax(np.linalg.norm(seen, axis=0))]
        x = x / np.linalg.norm(x)
        cells = Cells(self.points, self.cell, self.slack, self.room)
        return cells.grips(toward, x, opening, pad, fingers)


@dataclass(frozen=True, eq=False)
class _Sight:
    """Silhouette of one view, and where the camera stood."""

    depth: NDArray[np.float32]  # how far inside of it a pixel about it lies, px; negative outside, inf where unknown
    origin: tuple[int, int]  # of that part of the image, px
    mask: Flags  # the silhouette in it
    beyond: float  # the same of pixels that are not about it
    base_from_camera: RigidTransform
    intrinsics: CameraIntrinsics

    @classmethod
    def of(cls, view: View, intrinsics: CameraIntrinsics) -> _Sight:
        """The silhouette of a view."""
        left, top = view.blob.bbox[0] - _PAD, view.blob.bbox[1] - _PAD
        mask = np.pad(np.asarray(view.blob.pixels), _PAD)
        outside = (~mask).astype(np.uint8)
        inward, outward = (cv2.distanceTransform(each, cv2.DIST_L2, 5) for each in (1 - outside, outside))
        depth = np.where(mask, inward - 0.5, 0.5 - outward)
        height, width = mask.shape
        v, u = np.ogrid[top : top + height, left : left + width]
        out = (u < 0) | (v < 0) | (u >= intrinsics.width) | (v >= intrinsics.height)
        depth[out] = np.inf if view.clipped else depth[out]
        beyond = np.inf if view.clipped else -np.inf
        return cls(depth, (left, top), mask, beyond, view.base_from_camera, intrinsics)

    def seen_at(self, points: Array) -> tuple[NDArray[np.int64], NDArray[np.int64], Array, Flags]:
        """Column and row in that part of the image at which points appear, their depths, and whether they do."""
        x, y, z = ((points - self.base_from_camera.translation) @ self.base_from_camera.rotation.as_matrix()).T
        lens = self.intrinsics
        z = np.where(z > 1e-3, z, np.nan)
        u = np.nan_to_num(lens.fx * x / z + lens.cx - self.origin[0], nan=-1.0).round().astype(int)
        v = np.nan_to_num(lens.fy * y / z + lens.cy - self.origin[1], nan=-1.0).round().astype(int)
        height, width = self.mask.shape
        return u, v, z, (u >= 0) & (v >= 0) & (u < width) & (v < height)

    def inside(self, points: Array) -> Array:
        """How far inside of the silhouette points lie, m."""
        u, v, z, shown = self.seen_at(points)
        found = np.full(len(points), self.beyond)
        found[shown] = self.depth[v[shown], u[shown]] * z[shown] / self.intrinsics.fx
        return found

    def reach(self, middle: Array) -> float:
        """How far from the middle the silhouette goes at the middle's depth, m."""
        v, u = np.nonzero(self.mask)
        at = self.base_from_camera.inv().apply(middle)
        lens = self.intrinsics
        spread = np.hypot(
            u + self.origin[0] - lens.cx - lens.fx * at[0] / at[2],
            v + self.origin[1] - lens.cy - lens.fy * at[1] / at[2],
        )
        return float(spread.max() * at[2] / lens.fx)

    def rays(self) -> tuple[Array, Array]:
        """Origin, and directions of some rays just inside of the outline, (n, 3)."""
        inset = min(_INSET, float(self.depth[self.mask].max()))
        v, u = np.nonzero((np.abs(self.depth - inset) < 1) & self.mask)
        some = np.linspace(0, len(u) - 1, min(_RAYS, len(u))).astype(int)
        at = np.column_stack([u[some], v[some]]) + self.origin
        return self.base_from_camera.translation, self.base_from_camera.rotation.apply(self.intrinsics.rays(at))


def _carved(sights: Sequence[_Sight], middle: Array, reach: float, cells: int, slack: float) -> Array:
    """Centers of the cells about the middle that lie inside all silhouettes, or at most ``slack`` outside, (n, 3)."""
    steps = np.arange(-cells, cells + 1) * (reach / cells)
    points = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3) + middle
    for sight in sights:
        points = points[sight.inside(points) > -slack]
    return points


def _agreeing(sights: Sequence[_Sight], middle: Array, reach: float) -> list[int]:
    """Numbers of the sights without those that something hides from, so that the others' hull covers what they see."""
    kept = list(range(len(sights)))
    covered = _covered(sights, middle, reach)
    while covered < _AGREED and len(kept) > _FEWEST:
        without = [_covered([sights[k] for k in kept if k != other], middle, reach) for other in kept]
        covered = max(without)
        del kept[int(np.argmax(without))]
    return kept


def _covered(sights: Sequence[_Sight], middle: Array, reach: float) -> float:
    """Share of the rays just inside of the outlines that meet the hull."""
    points = _carved(sights, middle, reach, _FEW, _AGREEING)
    return float(_rays_through(points, sights, reach / _FEW)[1].any(axis=1).mean()) if len(points) else 0.0


def _shifted(sights: Sequence[_Sight], points: Array, cell: float) -> list[_Sight]:
    """Sights whose cameras stand so that the hull's silhouettes have the centroids of those seen, the mean of all
    cameras unchanged.
    """
    shifts = np.zeros((len(sights), 3))
    for sight, shift in zip(sights, shifts, strict=True):
        u, v, z, shown = sight.seen_at(points)
        drawn: NDArray[np.uint8] = np.zeros(sight.mask.shape, np.uint8)
        drawn[v[shown], u[shown]] = 1
        drawn &= np.isfinite(sight.depth).astype(np.uint8)
        if drawn.any():
            scale = float(np.mean(z[shown])) / sight.intrinsics.fx  # m per px
            apart = int(np.ceil(cell / scale)) + 2
            closed = np.asarray(cv2.morphologyEx(drawn, cv2.MORPH_CLOSE, np.ones((apart, apart), np.uint8)))
            off = _centroid((closed > 0) & np.isfinite(sight.depth)) - _centroid(sight.mask)
            shift[:] = sight.base_from_camera.rotation.as_matrix()[:, :2] @ off * scale
    shifts -= shifts.mean(axis=0)
    return [
        replace(sight, base_from_camera=RigidTransform.from_translation(shift) * sight.base_from_camera)
        for sight, shift in zip(sights, shifts, strict=True)
    ]


def _centroid(mask: Flags) -> Array:
    """Mean column and row."""
    return np.array([at.mean() for at in np.nonzero(mask)[::-1]])


def _rays_through(points: Array, sights: Sequence[_Sight], cell: float) -> tuple[Array, Flags]:
    """Samples along rays just inside of all outlines, (r, s, 3), and whether they lie in one of the cells."""
    lowest, middle = points.min(axis=0) - cell, points.mean(axis=0)
    grid = np.zeros(np.rint(np.ptp(points, axis=0) / cell).astype(int) + 3, bool)
    grid[tuple(np.rint((points - lowest) / cell).astype(int).T)] = True
    radius = np.linalg.norm(points - middle, axis=1).max()
    along = np.arange(-radius, radius, cell)
    samples = []
    for sight in sights:
        origin, rays = sight.rays()
        at = ((middle - origin) @ rays.T)[:, None] + along
        samples.append(origin + at[..., None] * rays[:, None])
    rays = np.concatenate(samples)
    number = np.rint((rays - lowest) / cell).astype(int)
    known = ((number >= 0) & (number < grid.shape)).all(axis=-1)
    return rays, known & grid[tuple(np.moveaxis(np.where(known[..., None], number, 0), -1, 0))]


def _cut(points: Array, sights: Sequence[_Sight], cell: float) -> tuple[Array, float, Array]:
    """The points above the plane, facing the cameras more or less, that cuts most off and yet leaves some of the hull
    on each ray that meets it; the share of the rays that do; and the plane's normal, or straight up where that is near.
    """
    rays, within = _rays_through(points, sights, cell)
    ray = np.nonzero(within)[0]
    if not len(ray):
        return points, 0.0, _UP
    first = np.flatnonzero(np.diff(ray, prepend=-1))
    toward = np.mean([-sight.base_from_camera.rotation.as_matrix()[:, 2] for sight in sights], axis=0)
    normals = _cap(toward)
    highest = np.maximum.reduceat(rays[within] @ normals.T, first, axis=0)  # of each ray along each normal
    offset = np.quantile(highest, _NEED, axis=0) - 0.5 * cell
    heights = points @ normals.T
    best = int((heights < offset).sum(axis=0).argmax())
    above = normals[best] if normals[best, 2] < _LEVEL else _UP
    return points[heights[:, best] >= offset[best]], float(within.any(axis=1).mean()), above


def _cap(middle: Array, number: int = 200) -> Array:
    """Unit vectors about a direction, evenly, (n, 3)."""
    share = (np.arange(number) + 0.5) / number
    z, angle = 1 - (1 - _BEHIND) * share, np.pi * (1 + np.sqrt(5)) * np.arange(number)
    around = np.column_stack([np.sqrt(1 - z**2) * np.cos(angle), np.sqrt(1 - z**2) * np.sin(angle), z])
    return Rotation.align_vectors([middle], [[0.0, 0.0, 1.0]])[0].apply(around)


def _smallest_box(points: Array, cell: float, guess: FittedSolid | None) -> tuple[RigidTransform, Array, Array]:
    """The box of least volume about cells one of whose sides lies on their convex hull: its pose, its lengths, and how
    far the axes of those that are about as small are off its own, rad.
    """
    hull = ConvexHull(points)
    corners, normals = points[hull.vertices], hull.equations[:, :3]
    normals = np.unique(np.round(normals * np.where(normals[:, 2:] < 0, -1, 1), 2), axis=0)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    guessed = np.empty((0, 3)) if guess is None else guess.base_from_solid.rotation.as_matrix().T
    axes, sides, centers = [], [], []
    for z in np.concatenate([normals, guessed]):
        x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
        x /= np.linalg.norm(x)
        y = np.cross(z, x)
        middle, size, degrees = cv2.minAreaRect(np.column_stack([corners @ x, corners @ y]).astype(np.float32))
        height, turn = corners @ z, np.radians(degrees)
        side = np.cos(turn) * x + np.sin(turn) * y
        axes.append(np.column_stack([side, np.cross(z, side), z]))
        sides.append([*size, np.ptp(height)])
        centers.append(middle[0] * x + middle[1] * y + 0.5 * (height.min() + height.max()) * z)
    lengths = np.array(sides) + cell
    volume = lengths.prod(axis=1)
    volume[len(normals) :] /= 1 + _ALMOST
    k = int(volume.argmin())
    likely = np.exp(-(volume / volume[k] - 1) / _ALMOST)
    nearest = np.abs(axes[k].T @ np.array(axes)).max(axis=-1)  # of each of its axes, (boxes, 3)
    spread = np.sqrt(likely @ np.arccos(np.clip(nearest, -1, 1)) ** 2 / likely.sum())
    return RigidTransform.from_components(centers[k], Rotation.from_matrix(axes[k])), lengths[k], spread
