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
from dataclasses import dataclass, field, replace
from typing import Literal

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.checks import check_fields, checked
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arm import Outcome
from gvp_lib.motion.sighting import View
from gvp_lib.picture import brief
from gvp_lib.planning.approach import Fingers, Rank, poses_about, poses_along, upright
from gvp_lib.planning.grips import Grip
from gvp_lib.planning.hull import VisualHull
from gvp_lib.planning.plan import MIN_VIEWS, Optimum
from gvp_lib.planning.room import Room
from gvp_lib.planning.seen import Array, Flags, Observations, Outlines
from gvp_lib.planning.silhouette import (
    Model,
    SilhouetteFit,
    Solids,
    Solution,
    Stack,
    chain,
    descend,
    first_guesses,
    guesses_with_top,
)
from gvp_lib.planning.solids import BOX, CYLINDER, FittedSolid, outline_of

__all__ = ["ContourFit"]

_FEW = 8  # views, in which all starts are tried
_KEPT = 2  # of the starts of a model
_RULED_OUT = 3.0  # so many times as bad as the best, a model is not tried further
_AT_ONCE = 1.3  # times the sd that views would leave which err independently: an arm errs alike at poses that are near
_ONE_OF, _LEAST = 1.7, 0.05  # points that count for one; the least share of `point_sd` squared that they scatter by
_DOUBTFUL = 0.7  # px left: above, other starts are tried
_TURNS = np.radians([45.0, 90.0, 135.0])
_ROUNDS = 10  # of the estimate of the poses' scatter
_BELIEVED = 2.0  # times as far off as was told, up to which an arm's poses are believed to err each by itself
_PATIENCE = 1e-4  # of the cost: a step that gains less is the last

Loss = tuple[float, Literal["cauchy", "geman-mcclure"]]
"""A scale, in standard deviations, and which robust loss."""

_LOSSES: tuple[Loss, ...] = ((20.0, "cauchy"), (6.0, "cauchy"), (3.0, "geman-mcclure"))
"""From one that far starts can follow to one to which what is hidden hardly matters."""


@checked
@dataclass(frozen=True)
class ContourFit(SilhouetteFit):
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

    Examples
    --------
    >>> from gvp_lib import ContourFit, ImageMomentPlanner, WorkCell
    >>> cell = WorkCell(arm="floating", target="cuboid_1x2", placement="walled", seed=1)
    >>> plan = ImageMomentPlanner(cell.segmenter, ContourFit()).plan(cell.arm)
    >>> print(plan.outcome, bool(cell.truth.viewpoint_error() < np.radians(1)))
    aligned True
    """

    explained: float = 1.5
    upright: bool = field(default=False, init=False, repr=False)  # the box of a hull needs no help from the vertical
    point_sd: float = 0.5
    opening: tuple[float, float] | None = None
    fingers: float = 0.07

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
        grips: tuple[Grip, ...] = ()
        rank: Rank | None = None
        hand = None if self.opening is None else Fingers(self.opening, self.fingers)
        explained = solid is not None and solid.explains
        hull = None if explained else _hull(views, intrinsics, solid)
        if hull is not None:
            solid = self._box_of(hull, first, solid)
        if solid is None:
            return None
        if hand is not None and explained:
            solid, room = hand.facing(solid, first), Room.of(views, intrinsics)
            rank = hand.rank(solid, room)
            grips = hand.clear_of_others(solid, room, rank, first)
        elif hand is not None and hull is not None and hand.pass_middle(hull):
            solid = upright(solid)
        elif hand is not None and hull is not None:
            grips = hand.grips(hull, solid, first)
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
            solid = self._best(self._ended([_as_solids(start)], seen), first)
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
        found, seen = _as_solids(solid), Outlines.of(views, intrinsics, self.point_sd, self.pose_sd)
        model, here = found.model, found.solids
        seen = _as_scattered(model, here, seen)
        about, then = _seen_as(model, here, seen), _predicted(model, here, seen, poses)
        count = _shared(about, seen)
        now, _ = _normal_equations(model, here, replace(about, weight=about.weight / count), seen)
        more, _ = _by_view(replace(ahead := _seen_as(model, here, then), weight=ahead.weight / count), then)
        return model.sd(_covariance(now + more[0], seen), here.rotation[0].T @ solid.normal)

    def _searched(self, moments: Observations, few: Outlines) -> list[_Found]:
        """Solids of all models to which the moments and then the outlines lead."""
        found: list[_Found] = []
        for model in self.models:
            coarse = replace(model, shape=model.shape.coarse)
            starts, _, cost = descend(coarse, first_guesses(model, moments), moments, iterations=8)
            found.append(_settled(model, starts[np.argsort(cost, kind="stable")[:4]], few, _LOSSES[:1]))
        found = [_settled(each.model, each.solids, few, _LOSSES[1:]) for each in _promising(found)]
        for each in _promising(found):
            topped = replace(each.model, top=True)
            starts = guesses_with_top(each.model, each.solids[[0]], topped)
            found.append(_settled(topped, starts, few, _LOSSES[1:]))
        return [each for each in found if len(each.solids)]

    def _ended(self, found: Sequence[_Found], seen: Outlines) -> list[Solution]:
        """The best of the solids, as all views have them."""
        if not found:
            return []
        best = min(found, key=lambda each: float(each.cost[0]))
        # A solid that is not the object's has the poses scatter more.
        seen = min(
            (_as_scattered(each.model, each.solids[[0]], seen) for each in _promising(found)),
            key=lambda scattered: float(scattered.pose_sd[0]),
        )
        solutions = []
        for each in found:
            kept = each.solids[each.cost < 1.5 * best.cost[0] + 20]
            if len(kept):
                ended, about = _descend(each.model, kept, seen, _LOSSES[-1], iterations=8)
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
    plain = _settled(model, starts, few, _LOSSES)
    if not len(plain.solids):
        return []
    topped = replace(model, top=True)
    return [plain, _settled(topped, guesses_with_top(model, plain.solids[[0]], topped), few, _LOSSES[1:])]


@dataclass(frozen=True, eq=False)
class _Found:
    """Solids of one model, and their costs, lowest first."""

    model: Model
    solids: Solids
    cost: Array


# --- the search -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _About(Stack):
    """What is seen against what a solid predicts."""

    residual: Array  # how far outside of the predicted outline each point lies, (s, n, m), px
    to_solid: Array  # its derivatives to the solid's parameters, (s, n, m, p)
    to_view: Array  # and to a turn and shift of the camera in its own frame, (s, n, m, 6)
    corrections: Array  # of the views' poses, (s, n, 6), rad and m
    left: Array  # of the residual, once they are applied, (s, n, m), px
    weight: Array  # of each point, (s, n, m), 1/px^2
    cost: Array  # (s,)
    usable: Flags  # whether the solid is in front of every camera, (s,)


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


def _as_solids(solid: FittedSolid) -> _Found:
    """A fitted solid as the search knows it."""
    shape, top = BOX if solid.kind == BOX.name else CYLINDER, solid.top[1] > 0
    pose, sizes = solid.base_from_solid, [*solid.sizes[1 if shape.round else 0 :], *(solid.top if top else ())]
    body = pose.apply([0.0, 0.0, -0.5 * solid.top[1]])
    return _Found(Model(shape, top), Solids(pose.rotation.as_matrix()[None], body[None], np.log([sizes])), np.zeros(1))


def _descend(model: Model, solids: Solids, seen: Outlines, loss: Loss, iterations: int) -> tuple[Solids, _About]:
    """Solids of lower cost, by Levenberg and Marquardt's method from all at once."""
    damping = np.full(len(solids), 1e-3)
    about = _compared(model, solids, seen, loss, np.zeros((len(solids), len(seen.points), 6)))
    for _ in range(iterations):
        curvature, descent = _normal_equations(model, solids, about, seen)
        diagonal = np.diagonal(curvature, axis1=1, axis2=2)
        ridge = damping[:, None] * diagonal + 1e-9 * diagonal.max(axis=1, keepdims=True) + 1e-12
        step = np.linalg.solve(curvature + ridge[:, None] * np.eye(ridge.shape[1]), descent[..., None])[..., 0]
        tried = solids.moved(np.clip(step, -0.3, 0.3))
        there = _compared(model, tried, seen, loss, about.corrections)
        better = there.cost < about.cost
        gained = np.subtract(about.cost, there.cost, out=np.zeros_like(about.cost), where=better)
        solids, about = tried.where(better, solids), there.where(better, about)
        if (gained <= _PATIENCE * about.cost).all() and damping.max() < 1e2:
            break
        damping = np.clip(np.where(better, 0.1 * damping, 10 * damping), 1e-8, 1e5)
    return solids, about


def _compared(model: Model, solids: Solids, seen: Outlines, loss: Loss, corrections: Array) -> _About:
    """Compare what is seen with what solids predict, near where the views' corrections are already about known."""
    residual, to_solid, to_view = _expand(model, solids, seen)
    usable = np.asarray(np.isfinite(residual).all(axis=(1, 2)) & np.isfinite(to_solid).all(axis=(1, 2, 3)))
    residual, to_solid, to_view = (np.where(np.isfinite(each), each, 0.0) for each in (residual, to_solid, to_view))
    for _ in range(2):
        left = residual + (to_view @ corrections[..., None])[..., 0]
        weight = _weights(left, seen, loss)[0]
        pull = np.swapaxes(to_view, -1, -2) * weight[..., None, :]  # (s, n, 6, m)
        curvature = pull @ to_view + np.diag(seen.pose_sd**-2)
        corrections = np.asarray(-np.linalg.solve(curvature, pull @ residual[..., None])[..., 0], float)
    left = residual + (to_view @ corrections[..., None])[..., 0]
    weight, cost = _weights(left, seen, loss)
    total = cost.sum((1, 2)) + (corrections**2 / seen.pose_sd**2).sum((1, 2)) + model.prior(solids)[0]
    return _About(residual, to_solid, to_view, corrections, left, weight, np.where(usable, total, np.inf), usable)


def _seen_as(model: Model, solid: Solids, seen: Outlines) -> _About:
    """Compare what is seen with one solid."""
    return _compared(model, solid, seen, _LOSSES[-1], np.zeros((1, len(seen.points), 6)))


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


def _weights(left: Array, seen: Outlines, loss: Loss) -> tuple[Array, Array]:
    """Weight of each point, 1/px^2, and its part of the cost."""
    (scale, kind), squared = loss, (left / seen.point_sd) ** 2
    # What hides only takes away from a silhouette. A point outside of the outline has no such excuse.
    wide = np.where(left > 0, 9 * scale**2, scale**2)
    weight, cost = 1 / (1 + squared / wide), wide * np.log1p(squared / wide)
    if kind == "geman-mcclure":
        within = left <= 0
        cost = np.where(within, squared * weight, cost)
        weight = np.where(within, weight**2, weight)
    counts = seen.counts(left)
    return np.where(counts, weight / seen.point_sd**2, 0.0), np.where(counts, cost, 0.0)


def _normal_equations(model: Model, solids: Solids, about: _About, seen: Outlines) -> tuple[Array, Array]:
    """Curvature (s, p, p) and descent (s, p) of half the cost, the views' corrections eliminated."""
    curvature, descent = (each.sum(1) for each in _by_view(about, seen))
    prior_curvature, pull = model.prior(solids)[1:]
    curvature[:, range(6, curvature.shape[1]), range(6, curvature.shape[1])] += prior_curvature
    descent[:, 6:] += pull
    return curvature, descent


def _by_view(about: _About, seen: Outlines) -> tuple[Array, Array]:
    """What each view says of a solid: its share of the curvature, (s, n, p, p), and of the descent, (s, n, p)."""
    pull_view = np.swapaxes(about.to_view, -1, -2) * about.weight[..., None, :]
    pull_solid = np.swapaxes(about.to_solid, -1, -2) * about.weight[..., None, :]
    mixed, residual = pull_view @ about.to_solid, about.residual[..., None]  # (s, n, 6, p)
    views = pull_view @ about.to_view + np.diag(seen.pose_sd**-2)
    solved = np.linalg.solve(views, np.concatenate([mixed, pull_view @ residual], axis=-1))
    through = np.swapaxes(mixed, -1, -2) @ solved
    return pull_solid @ about.to_solid - through[..., :-1], (through[..., -1:] - pull_solid @ residual)[..., 0]


def _as_scattered(model: Model, solid: Solids, seen: Outlines) -> Outlines:
    """The views with their poses' standard deviations scaled to how these scatter about one solid.

    The most likely scale, by expectation and maximization: a view's correction is known only so well itself.
    """
    about, scale = _seen_as(model, solid, seen), 1.0
    pull_view = np.swapaxes(about.to_view, -1, -2) * about.weight[..., None, :]
    for _ in range(_ROUNDS):
        sd = scale * seen.pose_sd
        now = replace(seen, pose_sd=sd)
        curvature, descent = _normal_equations(model, solid, about, now)
        covariance = np.linalg.pinv(curvature[0], rcond=1e-12, hermitian=True)
        own = np.linalg.inv(pull_view[0] @ about.to_view[0] + np.diag(sd**-2))  # (n, 6, 6)
        mixed = pull_view[0] @ about.to_solid[0]
        through = own @ mixed
        step = covariance @ descent[0]
        corrections = -(own @ (pull_view[0] @ about.residual[0][..., None]))[..., 0] - through @ step
        spread = own + through @ covariance @ np.swapaxes(through, -1, -2)
        squared = (corrections**2 + np.diagonal(spread, axis1=1, axis2=2)) / seen.pose_sd**2
        scale = float(np.sqrt(squared.mean()))
    return replace(seen, pose_sd=scale * seen.pose_sd, scatter=scale * seen.scatter)


def _judged(model: Model, solid: Solids, about: _About, seen: Outlines) -> Solution:
    """One solid, how well it explains the views, and how well it is known."""
    left = np.abs(about.left[0])
    counted = left[seen.counts(about.left[0])]
    quartile = float(np.quantile(counted, 0.75)) if counted.size else np.inf
    price = about.to_solid.shape[-1] * np.log(seen.inside.sum())
    about = replace(about, weight=about.weight / _shared(about, seen))
    curvature, _ = _normal_equations(model, solid, about, seen)
    covariance = _covariance(curvature, seen)[0]
    if seen.scatter > _BELIEVED:
        # Such an arm errs in ways that no independent scatter describes, and its own frame is bent: what is known of
        # the solid in that frame comes nearer to what the poses tell at their word.
        covariance += (1 - (_BELIEVED / seen.scatter) ** 2) * _at_their_word(about, seen)
    return Solution(model, solid, float(about.cost[0] + price), covariance, quartile, about.corrections[0])


def _at_their_word(about: _About, seen: Outlines) -> Array:
    """Covariance of one solid's parameters by the poses' scatter, (p, p), were none of the poses corrected."""
    pull = np.swapaxes(about.to_solid[0], -1, -2) * about.weight[0][:, None, :]  # (n, p, m)
    curvature = (pull @ about.to_solid[0]).sum(0)
    moved = np.linalg.pinv(curvature, rcond=1e-12, hermitian=True) @ (pull @ about.to_view[0])  # (n, p, 6)
    return np.asarray(np.einsum("npi,i,nqi->pq", moved, seen.pose_sd**2, moved), float)


def _covariance(curvature: Array, seen: Outlines) -> Array:
    """Covariance of a solid's parameters, with what the arm's errors have in common."""
    covariance = _AT_ONCE**2 * np.asarray(np.linalg.pinv(curvature, rcond=1e-12, hermitian=True), float)
    covariance[..., :3, :3] += seen.pose_sd[0] ** 2 * np.eye(3)  # the arm is as far off where it will look from at last
    return covariance


def _shared(about: _About, seen: Outlines) -> float:
    """How many points count for one, since neighbors err alike, where they scatter by what is left of them."""
    left = np.abs(about.left[0])
    counted = left[seen.counts(about.left[0])]
    scatter = float(np.median(counted)) / 0.6745 if counted.size else seen.point_sd
    return max(_ONE_OF * (scatter / seen.point_sd) ** 2, _LEAST)


def _expand(model: Model, solids: Solids, seen: Outlines) -> tuple[Array, Array, Array]:
    """How far each point lies outside of the predicted outline, (s, n, m), px, and the derivatives to the solid's
    parameters, (s, n, m, p), and to a turn and shift of the camera in its own frame, (s, n, m, 6).

    Of a convex outline, that is the largest of the signed distances from the lines of its edges.
    """
    back, lens = np.swapaxes(seen.rotation, -1, -2), seen.intrinsics
    rotation = back @ solids.rotation[:, None]  # camera_from_solid, (s, n, 3, 3)
    translation = (back @ (solids.center[:, None] - seen.position)[..., None])[..., 0]
    sizes = model.sizes(solids.log_sizes)[:, None]
    shape = model.shape if model.top else model.shape.plain
    corners = rotation @ np.swapaxes(shape.vertices(sizes), -1, -2) + translation[..., None]
    (s, n), m = corners.shape[:2], seen.points.shape[1]
    corners = corners.reshape(s * n, 3, -1)
    depth = np.where((corners[:, 2:] > 1e-3).all(-1, keepdims=True), corners[:, 2:], np.nan)
    image = (corners / depth).swapaxes(0, 1)  # (3, s n, v)
    vertex, sign = outline_of(shape, image)  # (s n, 2, k), (s n, k)
    row = np.arange(s * n)[:, None]
    x, y = (focal * image[k][row[..., None], vertex] for k, focal in ((0, lens.fx), (1, lens.fy)))  # (s n, 2, k)
    # Outlines run clockwise on screen where the sign is 1, so that outside is to the left.
    along_x, along_y = (x[:, 1] - x[:, 0]) * sign, (y[:, 1] - y[:, 0]) * sign
    length = np.hypot(along_x, along_y)
    length = np.where(length > 1e-9, length, np.inf)
    normal_x, normal_y = along_y / length, -along_x / length
    offset = np.where(np.isfinite(length), normal_x * x[:, 0] + normal_y * y[:, 0], np.inf)
    points = np.broadcast_to(seen.points - lens.principal_point, (s, n, m, 2)).reshape(s * n, m, 2)
    u, v = points[..., 0], points[..., 1]
    distance = u[..., None] * normal_x[:, None] + v[..., None] * normal_y[:, None] - offset[:, None]
    edge = distance.argmax(-1)  # (s n, m)
    residual = np.take_along_axis(distance, edge[..., None], -1)[..., 0]
    # Where on the edge's line the point is nearest, from 0 at its one end to 1 at the other.
    (x0, x1), (y0, y1) = x.swapaxes(0, 1)[:, row, edge], y.swapaxes(0, 1)[:, row, edge]
    across = normal_x[row, edge], normal_y[row, edge]
    share = ((u - x0) * (x1 - x0) + (v - y0) * (y1 - y0)) / np.maximum((x1 - x0) ** 2 + (y1 - y0) ** 2, 1e-12)
    turn, slopes = rotation.reshape(s * n, 3, 3), np.zeros((s * n, m, 11))
    for end, weight in enumerate((1 - share, share)):
        number = vertex[:, end][row, edge]
        corner = corners.swapaxes(1, 2)[row, number]  # (s n, m, 3)
        gx, gy = (-weight * a * focal / corner[..., 2] for a, focal in zip(across, (lens.fx, lens.fy), strict=True))
        pull = np.stack([gx, gy, -(gx * corner[..., 0] + gy * corner[..., 1]) / corner[..., 2]], axis=-1)
        local, growth = pull @ turn, shape.growth[:, number]  # (s n, m, 3), (6, s n, m)
        (cx, cy, cz), (px, py, pz) = corner.transpose(2, 0, 1), pull.transpose(2, 0, 1)
        slopes[..., 0] += cy * pz - cz * py  # corner x pull; np.cross takes three times as long
        slopes[..., 1] += cz * px - cx * pz
        slopes[..., 2] += cx * py - cy * px
        slopes[..., 3:6] += pull
        slopes[..., 6:9] += local * np.moveaxis(growth[:3], 0, -1)
        slopes[..., 9] += local[..., 0] * growth[3] + local[..., 1] * growth[4]
        slopes[..., 10] += local[..., 2] * growth[5]
    slopes = slopes.reshape(s, n, m, 11)
    to_solid = slopes @ chain(model, solids, rotation, translation)
    return residual.reshape(s, n, m), to_solid, -slopes[..., :6]
