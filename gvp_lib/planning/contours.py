"""A simple solid whose outline is the one seen, in all views at once, though something hides a part of it.

Where :class:`gvp_lib.planning.SilhouetteFit` compares six moments a view, all of which a missing piece spoils, here
each point of each outline is held against the outline of the solid. The losses are robust, so that points which no
solid explains come to count for little. And where the picture just outside a point has another color than the table,
something may stand in front: there a solid may reach beyond the point at no cost. Views that the image's border cuts
serve, too.

The search begins at the solids that the moments of a few views suggest. Where each view stood against what the arm
believes is estimated along with the solid, and eliminated from its equations (a Schur complement).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.checks import check_fields, checked
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arm import Outcome
from gvp_lib.motion.sighting import View
from gvp_lib.picture import brief
from gvp_lib.planning.approach import Fingers, Rank, poses_about, poses_along, upright
from gvp_lib.planning.comparison import (
    LOSSES,
    POINT_SD,
    About,
    Loss,
    as_scattered,
    by_view,
    compared,
    known,
    normal_equations,
    seen_as,
    shared,
    widened,
)
from gvp_lib.planning.grips import Grip
from gvp_lib.planning.hull import VisualHull
from gvp_lib.planning.plan import MIN_VIEWS, Optimum
from gvp_lib.planning.room import Room
from gvp_lib.planning.seen import Array, Observations, Outlines
from gvp_lib.planning.silhouette import descend
from gvp_lib.planning.solid_fit import Model, SolidFit, Solids, Solution, as_solids, first_guesses, guesses_with_top
from gvp_lib.planning.solids import FittedSolid

__all__ = ["ContourFit"]

_FEW = 8  # views, in which all starts are tried
_KEPT = 2  # of the starts of a model
_RULED_OUT = 3.0  # so many times as bad as the best, a model is not tried further
_DOUBTFUL = 0.7  # px left: above, other starts are tried
_TURNS = np.radians([45.0, 90.0, 135.0])
_PATIENCE = 1e-4  # of the cost: a step that gains less is the last


@checked
@dataclass(frozen=True)
class ContourFit(SolidFit):
    """Estimator that fits a box or a can, each with or without a narrower top, to the outlines of all views.

    From a handful of views nearly as exact as :class:`SilhouetteFit` from dozens, and it forgives what hides a part of
    the object or cuts it off the picture. Where no solid explains the outlines, the optimum is ``UNEXPLAINED``, and the
    smallest box about the object's :class:`VisualHull` takes the solid's place.

    Parameters
    ----------
    radius, moment_sd
        As of :class:`SilhouetteFit`.
    rotation_sd, translation_sd
        About how far the arm's pose of a view is off, per axis, rad and m: the search begins with them. In the end both
        are scaled to how far the views themselves are off, so that an exact arm's word counts for more. The claimed
        uncertainty takes in that the arm will be off as much where it looks along the normal; and from twice of what is
        given here, that its own frame is bent.
    shapes
        As of :class:`SilhouetteFit`.
    explained
        Third quartile of the points' distances from the solid's outline up to which it explains the views, px. Bricks
        and cans leave 0.2 to 1, behind a wall, too; a mug, a toy animal, or two bricks in one mask, 5 and more.
    lean
        As of :class:`SilhouetteFit`.
    point_sd
        Standard deviation of a point across the outline, px.
    opening
        Least and largest width between a hand's fingers, m, for a view to grasp from: along the normal of the nearest
        face that they can span; or, where no solid explains the views, on a place where they can close about the visual
        hull, along the normal of a face of its box if there is one. None: along the nearest face.
    fingers
        Free length of that hand's fingers, m: how deep they can reach about a hull.
    failed
        Grips by which that hand has held nothing: others come first, found on the visual hull, whether or not a solid
        explains the views.

    Examples
    --------
    >>> from gvp_lib import ContourFit, ImageMomentPlanner, WorkCell
    >>> cell = WorkCell(arm="floating", target="cuboid_1x2", placement="walled", seed=1)
    >>> plan = ImageMomentPlanner(cell.segmenter, ContourFit()).plan(cell.arm)
    >>> print(plan.outcome, bool(cell.truth.viewpoint_error() < np.radians(1)))
    aligned True
    """

    explained: float = 1.5
    point_sd: float = POINT_SD
    opening: tuple[float, float] | None = None
    fingers: float = 0.07
    failed: tuple[Grip, ...] = ()

    __repr__ = brief
    _unusable = "without an outline of the object's own"

    def __post_init__(self) -> None:
        super().__post_init__()
        check_fields(
            self,
            {"point_sd": "in px", "fingers": "in m"},
            opening=(
                lambda ends: ends is None or (len(ends) == 2 and 0 <= ends[0] < ends[1] < np.inf),
                "the least and the largest width between the fingers, m, as a gripper's stroke, or None",
            ),
        )

    def usable(self, views: Sequence[View]) -> list[View]:
        """Views whose outline is at least in part the object's own.

        Parameters
        ----------
        views
            Views of the object, clipped by the image's border or not.
        """
        return [view for view in views if view.outline is not None and view.outline.inside.any()]

    def fit(
        self,
        views: Sequence[View],
        intrinsics: CameraIntrinsics,
        first: View | None = None,
        *,
        start: FittedSolid | None = None,
    ) -> FittedSolid | None:
        """Fit the solid that explains the views best; None where they leave its normal anywhere within sight.

        Parameters
        ----------
        views
            At least five views, clipped by the border of the image or not.
        intrinsics
            Camera's lens.
        first
            View nearest to whose direction the face to look at lies; by default the first of ``views``.
        start
            Solid that explained all but the last few views: the search begins there, and is several times as quick.
            Where it does not explain these, it begins anew.

        Raises
        ------
        InvalidParameterError
            There are fewer views, or some without an outline of the object's own.
        """
        self._check(views)
        first = views[0] if first is None else first
        solid = self._fitted(views, intrinsics, first, start)
        if solid is not None and solid.explains:
            return solid
        hull = _hull(views, intrinsics, solid)
        return solid if hull is None else self._box_of(hull, first, solid)

    def _answer(self, views: Sequence[View], intrinsics: CameraIntrinsics, first: View) -> Optimum | None:
        solid = self._fitted(views, intrinsics, first)
        explained = solid is not None and solid.explains
        hull = None if explained and not self.failed else _hull(views, intrinsics, solid)
        if hull is not None and not explained:
            solid = self._box_of(hull, first, solid)
        if solid is None:
            return None
        grips: tuple[Grip, ...] = ()
        rank: Rank | None = None
        if self.opening is not None:
            hand = Fingers(self.opening, self.fingers, self.failed)
            passes = hull is not None and hand.pass_middle(hull)
            if hull is not None and (self.failed or not passes):
                grips = hand.grips(hull, solid, first)
            if explained and not grips:
                solid, room = hand.facing(solid, first), Room.of(views, intrinsics)
                rank = hand.rank(solid, room)
                grips = hand.clear_of_others(solid, room, rank, first)
            elif passes and not grips:
                assert hull is not None
                solid = upright(solid, hull.above)
        if grips:
            along = grips[0].view(self.radius).rotation
            rolls = [along, along * Rotation.from_rotvec([0.0, 0.0, np.pi])]
            poses = poses_about(grips[0].center, rolls, first, self.radius, self.lean)
        else:
            poses = poses_along(solid, first, self.radius, self.lean, rank)
        # How far off the face of a solid is that is not the object, and no hull's box, nobody knows.
        sd = solid.uncertainty if explained or hull is not None else float("nan")
        return Optimum(
            Outcome.ALIGNED if explained else Outcome.UNEXPLAINED,
            poses=poses,
            uncertainty=sd,
            solid=solid,
            distance=self.radius,
            grips=grips,
        )

    def _box_of(self, hull: VisualHull, first: View, solid: FittedSolid | None) -> FittedSolid:
        left = np.inf if solid is None else solid.residual
        return replace(hull.solid(first, left), explained=self.explained)

    def _fitted(
        self, views: Sequence[View], intrinsics: CameraIntrinsics, first: View, start: FittedSolid | None = None
    ) -> FittedSolid | None:
        """The box or can that fits the outlines best, whether or not it explains them."""
        seen = Outlines.of(views, intrinsics, self.point_sd, self.pose_sd)
        if start is not None and start.explains:
            solid = self._best(self._ended([_Found(*as_solids(start), np.zeros(1))], seen), first)
            if solid is not None and solid.explains:
                return solid
        whole = [view for view in views if not view.clipped]
        moments = Observations.of(whole or views, intrinsics, self.moment_sd, self.pose_sd).some(_FEW)
        few = seen.some(_FEW).thinned()
        found = self._searched(moments, few)
        solid = self._best(self._ended(found, seen), first)
        if found and (solid is None or solid.residual > _DOUBTFUL):
            # What hides a side may lead the moments to a box whose sides are right and stand in each other's place.
            found += [each for model in self.models if not model.shape.round for each in _turned(model, found, few)]
            solid = self._best(self._ended(found, seen), first)
        return solid

    def foreseen(
        self, solid: FittedSolid, views: Sequence[View], intrinsics: CameraIntrinsics, poses: Sequence[RigidTransform]
    ) -> Array:
        """Standard deviation of a solid's normal after one more view from each of some poses, shape (n,), rad.

        Parameters
        ----------
        solid
            Solid that explains the views so far.
        views
            Those views.
        intrinsics
            Camera's lens.
        poses
            Poses ``base_from_camera`` from which to look next, n of them.
        """
        self._check(views)
        model, here = as_solids(solid)
        seen = as_scattered(model, here, Outlines.of(views, intrinsics, self.point_sd, self.pose_sd))
        about, then = seen_as(model, here, seen), _predicted(model, here, seen, poses)
        count = shared(about, seen)
        now, _ = normal_equations(model, here, replace(about, weight=about.weight / count), seen)
        more, _ = by_view(replace(ahead := seen_as(model, here, then), weight=ahead.weight / count), then)
        return model.sd(known(now + more[0], seen), here.rotation[0].T @ solid.normal)

    def _searched(self, moments: Observations, few: Outlines) -> list[_Found]:
        """Solids of all models to which the moments and then the outlines lead."""
        found: list[_Found] = []
        for model in self.models:
            coarse = replace(model, shape=model.shape.coarse)
            starts, _, cost = descend(coarse, first_guesses(model, moments), moments, iterations=8)
            found.append(_settled(model, starts[np.argsort(cost, kind="stable")[:4]], few, LOSSES[:1]))
        found = [_settled(each.model, each.solids, few, LOSSES[1:]) for each in _promising(found)]
        for each in _promising(found):
            topped = replace(each.model, top=True)
            starts = guesses_with_top(each.model, each.solids[[0]], topped)
            found.append(_settled(topped, starts, few, LOSSES[1:]))
        return [each for each in found if len(each.solids)]

    def _ended(self, found: Sequence[_Found], seen: Outlines) -> list[Solution]:
        """The best of the solids, as all views have them."""
        if not found:
            return []
        best = min(found, key=lambda each: float(each.cost[0]))
        # A solid that is not the object's has the poses scatter more.
        seen = min(
            (as_scattered(each.model, each.solids[[0]], seen) for each in _promising(found)),
            key=lambda scattered: float(scattered.pose_sd[0]),
        )
        solutions = []
        for each in found:
            kept = each.solids[each.cost < 1.5 * best.cost[0] + 20]
            if len(kept):
                ended, about = _descend(each.model, kept, seen, LOSSES[-1], iterations=8)
                fine = np.flatnonzero(about.usable).tolist()
                solutions += [_judged(each.model, ended[[k]], about[[k]], seen) for k in fine]
        return solutions


def _hull(views: Sequence[View], intrinsics: CameraIntrinsics, guess: FittedSolid | None) -> VisualHull | None:
    """Visual hull of what no solid explains; None of views of moments alone, or that leave nothing."""
    whole = [view for view in views if view.blob.pixels is not None]
    return VisualHull.of(whole, intrinsics, guess) if len(whole) >= MIN_VIEWS else None


def _turned(model: Model, found: Sequence[_Found], few: Outlines) -> list[_Found]:
    """Boxes, without and with a top, to which the best solid so far leads when it is turned about each of its axes."""
    best = min((each for each in found if len(each.solids)), key=lambda each: float(each.cost[0]), default=None)
    if best is None:
        return []
    lengths = np.exp(best.solids.log_sizes[0, : 2 if best.model.shape.round else 3])
    sizes = np.array([lengths[0], lengths[0], lengths[1]]) if best.model.shape.round else lengths
    turns = Rotation.from_matrix(best.solids.rotation[0]) * Rotation.from_rotvec(
        [angle * axis for axis in np.eye(3) for angle in _TURNS]
    )
    n = len(turns)
    starts = Solids(turns.as_matrix(), np.tile(best.solids.center[0], (n, 1)), np.tile(np.log(sizes), (n, 1)))
    plain = _settled(model, starts, few, LOSSES)
    if not len(plain.solids):
        return []
    topped = replace(model, top=True)
    return [plain, _settled(topped, guesses_with_top(model, plain.solids[[0]], topped), few, LOSSES[1:])]


@dataclass(frozen=True, eq=False)
class _Found:
    """Solids of one model, and their costs, lowest first."""

    model: Model
    solids: Solids
    cost: Array


# --- the search -----------------------------------------------------------------------------------------------------


def _promising(found: Sequence[_Found]) -> list[_Found]:
    """Models whose best solid is not far worse than that of the best one."""
    found = [each for each in found if len(each.solids)]
    lowest = min((each.cost[0] for each in found), default=np.inf)
    return [each for each in found if each.cost[0] <= _RULED_OUT * lowest]


def _settled(model: Model, solids: Solids, seen: Outlines, losses: Sequence[Loss]) -> _Found:
    """The best of the solids to which some starts lead, with few corners."""
    coarse = replace(model, shape=model.shape.coarse)
    for loss in losses:
        solids, about = _descend(coarse, solids, seen, loss, iterations=6)
    order = np.argsort(about.cost, kind="stable")[:_KEPT]
    order = order[np.isfinite(about.cost[order])]
    return _Found(model, solids[order], about.cost[order])


def _descend(model: Model, solids: Solids, seen: Outlines, loss: Loss, iterations: int) -> tuple[Solids, About]:
    """Solids of lower cost, by Levenberg and Marquardt's method from all at once."""
    damping = np.full(len(solids), 1e-3)
    about = compared(model, solids, seen, loss, np.zeros((len(solids), len(seen.points), 6)))
    for _ in range(iterations):
        curvature, descent = normal_equations(model, solids, about, seen)
        diagonal = np.diagonal(curvature, axis1=1, axis2=2)
        ridge = damping[:, None] * diagonal + 1e-9 * diagonal.max(axis=1, keepdims=True) + 1e-12
        step = np.linalg.solve(curvature + ridge[:, None] * np.eye(ridge.shape[1]), descent[..., None])[..., 0]
        tried = solids.moved(np.clip(step, -0.3, 0.3))
        there = compared(model, tried, seen, loss, about.corrections)
        better = there.cost < about.cost
        gained = np.subtract(about.cost, there.cost, out=np.zeros_like(about.cost), where=better)
        solids, about = tried.where(better, solids), there.where(better, about)
        if (gained <= _PATIENCE * about.cost).all() and damping.max() < 1e2:
            break
        damping = np.clip(np.where(better, 0.1 * damping, 10 * damping), 1e-8, 1e5)
    return solids, about


def _predicted(model: Model, solid: Solids, seen: Outlines, poses: Sequence[RigidTransform]) -> Outlines:
    """Outlines of a solid as a camera would see them from other poses."""
    corners = solid.center + model.shape.vertices(model.sizes(solid.log_sizes))[0] @ solid.rotation[0].T
    lens = seen.intrinsics
    points = []
    for pose in poses:
        polygon = cv2.convexHull(lens.project(pose.inv().apply(corners)).astype(np.float32))[:, 0]
        closed = np.vstack([polygon, polygon[:1]])
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
        at = np.linspace(0.0, along[-1], seen.points.shape[1], endpoint=False)
        points.append(np.column_stack([np.interp(at, along, closed[:, k]) for k in (0, 1)]))
    shown = np.array(points)
    inside = np.asarray(((shown > 0) & (shown < (lens.width - 1, lens.height - 1))).all(-1))
    return replace(
        seen,
        points=shown,
        inside=inside,
        foreign=np.zeros_like(inside),
        rotation=np.array([pose.rotation.as_matrix() for pose in poses]),
        position=np.array([pose.translation for pose in poses]),
    )


def _judged(model: Model, solid: Solids, about: About, seen: Outlines) -> Solution:
    """One solid, how well it explains the views, and how well it is known."""
    left = np.abs(about.left[0])
    counted = left[seen.counts(about.left[0])]
    quartile = float(np.quantile(counted, 0.75)) if counted.size else np.inf
    price = about.to_solid.shape[-1] * np.log(seen.inside.sum())
    about = replace(about, weight=about.weight / shared(about, seen))
    curvature, _ = normal_equations(model, solid, about, seen)
    covariance = widened(known(curvature, seen)[0], about, seen)
    return Solution(model, solid, float(about.cost[0] + price), covariance, quartile, about.corrections[0])
