"""A simple solid that explains the silhouettes of all views at once, and the arm's own error.

The thesis reads one number per view, the ratio of the blob's axes. The same blobs say more: six moments each, from a
camera that knows roughly where it stood. Here a box or a can is fitted to all of them by robust least squares, from
many starts at once. Where each view stood against what the arm believes is not estimated along with the solid but
integrated out: it adds to the covariance of that view's six features, which is exact for small corrections.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gvp_lib.checks import checked
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arm import Outcome
from gvp_lib.motion.sighting import View
from gvp_lib.picture import brief
from gvp_lib.planning.approach import poses_along
from gvp_lib.planning.comparison import BELIEVED, POINT_SD, as_scattered, seen_as, widened
from gvp_lib.planning.plan import MIN_VIEWS, Optimum
from gvp_lib.planning.seen import Array, Observations, Outlines, features
from gvp_lib.planning.solid_fit import (
    Model,
    SolidFit,
    Solids,
    Solution,
    Stack,
    as_solids,
    chain,
    first_guesses,
    guesses_with_top,
)
from gvp_lib.planning.solids import EXPLAINED, FittedSolid, silhouette_moments

__all__ = ["SilhouetteFit"]

_RULED_OUT = 3.0  # so many times as bad as another shape's, a solid isn't tried with a top: none ended best above 1.8
_TAIL = 6 * 2.0**2  # squared distance of a view's six features beyond which it counts less and less: at 2 sd each


@checked
@dataclass(frozen=True)
class SilhouetteFit(SolidFit):
    """Estimator that fits a box or a can, each with or without a narrower top, to the moments of all views of all arcs.

    The solid with the lowest residual wins, with a price on each further size (the Bayesian information criterion). The
    view to take is of the face, or the round side, nearest to where the first arc began. Where other solids explain the
    views nearly as well, their disagreement is part of the uncertainty. A solid that leaves more than ``explained``
    does not count as the object: the optimum is ``UNEXPLAINED``, with no uncertainty. Where the masks do not even tell
    a direction, as those of a segmenter that finds something else each time, it is ``NO_STATIONARY_POINT``, and the
    camera stays at the center of the arc.

    Parameters
    ----------
    radius
        Distance from which to look, m from the object's center.
    moment_sd
        Standard deviation of a blob's axis lengths and centroid, px.
    rotation_sd, translation_sd
        Standard deviations of the arm's pose of a view, per axis; rad and m. Enough for an arm that is off by
        millimeters; an error that all views share does no harm. Where the views' outlines tell that the poses are off
        more than twice as far, both are scaled to it, and the claimed uncertainty takes in that such an arm's frame is
        bent.
    shapes
        Solids to try.
    explained
        Residual up to which a solid explains the views, px; bricks and cans leave 0.03 to 0.14, a toy animal 0.3 to
        0.8.
    lean
        Largest lean toward the major axis where no view along the normal can be reached, rad: a gripper's fingers then
        still close squarely along the minor axis.
    upright
        Whether to go halfway from the normal of a solid that does not explain the views to the one nearest to straight
        up (the base's z axis). About its longest axis such an object can look alike from all sides; the fit's normal
        and the expectation that things lean little are then each off by some 15 deg, and their middle by less. For a
        grasp, which forgives 20 deg and not 30.

    Examples
    --------
    >>> from gvp_lib import ImageMomentPlanner, WorkCell
    >>> cell = WorkCell(arm="floating", target="cuboid_1x2", seed=1)
    >>> print(ImageMomentPlanner(cell.segmenter, SilhouetteFit()).plan(cell.arm).solid)
    box 64 x 32 x 22 mm
    """

    explained: float = EXPLAINED
    upright: bool = False

    __repr__ = brief
    _unusable = "clipped by the border of the image"

    def _answer(self, views: Sequence[View], intrinsics: CameraIntrinsics, first: View) -> Optimum | None:
        """Where to look from, by views enough; None where they do not tell."""
        solid = self.fit(views, intrinsics, first)
        if solid is None:
            return None
        if self.upright and not solid.explains:
            solid = replace(solid, normal=_toward_upright(solid))
        poses = poses_along(solid, first, self.radius, self.lean)
        # The fit's covariance holds for a solid that is the object; how far off another one's face is nobody knows.
        outcome, sd = (Outcome.ALIGNED, solid.uncertainty) if solid.explains else (Outcome.UNEXPLAINED, float("nan"))
        return Optimum(outcome, poses=poses, uncertainty=sd, solid=solid, distance=self.radius)

    def usable(self, views: Sequence[View]) -> list[View]:
        """Views that the border of the image does not clip.

        Parameters
        ----------
        views
            Views of the object.
        """
        return [view for view in views if not view.clipped]

    def fit(self, views: Sequence[View], intrinsics: CameraIntrinsics, first: View | None = None) -> FittedSolid | None:
        """Fit the solid that explains the views best; None where they leave its normal anywhere within sight.

        Parameters
        ----------
        views
            At least five views, none clipped by the border of the image.
        intrinsics
            Camera's lens.
        first
            View nearest to whose direction the face to look at lies; by default the first of ``views``.

        Raises
        ------
        InvalidParameterError
            There are fewer views, or clipped ones among them.
        """
        self._check(views)
        first = views[0] if first is None else first
        seen = Observations.of(views, intrinsics, self.moment_sd, self.pose_sd)
        solid = self._best(_solutions(self.models, seen), first)
        outlined = [view for view in views if view.outline is not None]
        if solid is None or not solid.explains or len(outlined) < MIN_VIEWS:
            return solid
        # Six moments a view hardly tell how far the poses are off. The outlines of the same views do.
        outlines = Outlines.of(outlined, intrinsics, POINT_SD, self.pose_sd)
        outlines = as_scattered(*as_solids(solid), outlines)
        if outlines.scatter <= BELIEVED:
            return solid
        found = _solutions(self.models, replace(seen, pose_sd=outlines.pose_sd))
        return self._best([_widened(each, outlines) for each in found], first)


def _widened(found: Solution, seen: Outlines) -> Solution:
    """A solution by poses that scatter beyond belief, and how little is then known of it."""
    return replace(found, covariance=widened(found.covariance, seen_as(found.model, found.solid, seen), seen))


def _toward_upright(solid: FittedSolid) -> Array:
    """Half way from the fitted normal to straight up, as far as the longest axis leaves it: a unit vector."""
    longest = solid.base_from_solid.rotation.as_matrix()[:, np.argmax(solid.lengths)]
    up, normal = (v - (v @ longest) * longest for v in (np.array([0.0, 0.0, 1.0]), solid.normal))
    if min(np.linalg.norm(up), np.linalg.norm(normal)) < 0.1:
        return solid.normal  # it stands on end, or is seen end on
    middle = up / np.linalg.norm(up) + normal / np.linalg.norm(normal)
    return middle / np.linalg.norm(middle)


# --- the search -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Expansion(Stack):
    """What was seen less what is predicted, and how the prediction changes."""

    residual: Array  # (s, n, 6), px
    to_solid: Array  # derivatives of the prediction to the solid's parameters, (s, n, 6, p)
    to_view: Array  # and to a turn and shift of the camera in its own frame, (s, n, 6, 6)
    weight: Array  # inverse covariance of each residual, the view's pose integrated out, (s, n, 6, 6)

    @property
    def squared(self) -> Array:
        """Squared distance of each view, in standard deviations, shape (s, n); infinite where nothing is predicted."""
        squared = ((self.weight @ self.residual[..., None])[..., 0] * self.residual).sum(-1)
        return np.where(np.isfinite(squared), squared, np.inf)


def _solutions(models: Sequence[Model], seen: Observations) -> list[Solution]:
    """Solids of all models, and with a top of those that may yet be the best."""
    found = [refine(model, first_guesses(model, seen), seen) for model in models]
    plain = [min(solutions, key=lambda solution: solution.criterion) for solutions in found if solutions]
    lowest = min((solution.criterion for solution in plain), default=np.inf)
    for solution in plain:
        if solution.criterion < _RULED_OUT * lowest:
            topped = replace(solution.model, top=True)
            found.append(refine(topped, guesses_with_top(solution.model, solution.solid, topped), seen))
    return [solution for solutions in found for solution in solutions]


def refine(model: Model, starts: Solids, seen: Observations) -> list[Solution]:
    """Solids that explain what was seen, by Levenberg and Marquardt's method from all starts at once.

    All starts are tried on eight of the views, with a can of few corners, and the best three then on all.
    """
    few = replace(model, shape=model.shape.coarse)
    rough, _, cost = descend(few, starts, seen.some(8), iterations=14)
    best = rough[np.argsort(cost, kind="stable")[:3]]
    solids, about, cost = descend(model, best, seen, iterations=12)
    return [_judged(model, solids[[k]], about[[k]], seen) for k in range(len(solids)) if np.isfinite(cost[k])]


def descend(model: Model, solids: Solids, seen: Observations, iterations: int) -> tuple[Solids, _Expansion, Array]:
    """Solids of lower cost, what is predicted of them, and their costs (s,)."""
    damping = np.full(len(solids), 1e-2)
    about = _expand(model, solids, seen)
    for _ in range(iterations):
        cost = _cost(model, solids, about)
        curvature, descent = _normal_equations(model, solids, about)
        diagonal = np.diagonal(curvature, axis1=1, axis2=2)
        ridge = damping[:, None] * diagonal + 1e-9 * diagonal.max(axis=1, keepdims=True) + 1e-12
        step = np.linalg.solve(curvature + ridge[:, None] * np.eye(ridge.shape[1]), descent[..., None])[..., 0]
        tried = solids.moved(np.clip(step, -0.5, 0.5))
        there = _expand(model, tried, seen)
        # By the same weights as before: were they those of the new place, a step might pay that only blurs the views.
        new = _cost(model, tried, replace(there, weight=about.weight))
        better = new < cost
        solids, about = tried.where(better, solids), there.where(better, about)
        gained = np.subtract(cost, new, out=np.zeros_like(cost), where=better)  # both may be infinite
        if (gained <= 1e-4 * cost).all() and damping.max() < 1e3:
            break
        damping = np.clip(np.where(better, 0.1 * damping, 10 * damping), 1e-8, 1e4)
    return solids, about, _cost(model, solids, about)


def _expand(model: Model, solids: Solids, seen: Observations) -> _Expansion:
    """What each solid predicts of each view, and how that changes."""
    back = np.swapaxes(seen.rotation, -1, -2)
    rotation = back @ solids.rotation[:, None]  # camera_from_solid, (s, n, 3, 3)
    translation = (back @ (solids.center[:, None] - seen.position)[..., None])[..., 0]
    sizes = model.sizes(solids.log_sizes)[:, None]
    shape = model.shape if model.top else model.shape.plain
    moments, slopes = silhouette_moments(shape, rotation, translation, sizes, seen.intrinsics)
    with np.errstate(divide="ignore", invalid="ignore"):  # of a silhouette without width
        predicted, to_moments = features(moments)
        slopes = to_moments @ slopes
    to_view = -slopes[..., :6]  # a camera that turns and shifts sees the solid turn and shift the other way
    covariance = (to_view * seen.pose_sd**2) @ np.swapaxes(to_view, -1, -2) + seen.feature_sd**2 * np.eye(6)
    usable = np.asarray(np.isfinite(covariance).all(axis=(-1, -2)))
    weight = np.linalg.inv(np.where(usable[..., None, None], covariance, np.eye(6)))
    residual = np.where(usable[..., None], seen.features - predicted, np.nan)
    return _Expansion(residual, slopes @ chain(model, solids, rotation, translation), to_view, weight)


def _cost(model: Model, solids: Solids, about: _Expansion) -> Array:
    """Cauchy's robust sum over the views, and what is expected of a top, shape (s,)."""
    return (_TAIL * np.log1p(about.squared / _TAIL)).sum(-1) + model.prior(solids)[0]


def _normal_equations(model: Model, solids: Solids, about: _Expansion) -> tuple[Array, Array]:
    """Curvature (s, p, p) and descent (s, p) of half the cost."""
    trust = 1 / (1 + about.squared / _TAIL)  # (s, n)
    usable = trust[..., None] > 0
    jacobian, residual = np.where(usable[..., None], about.to_solid, 0.0), np.where(usable, about.residual, 0.0)
    weighted = (trust[..., None, None] * about.weight) @ jacobian  # (s, n, 6, p)
    pulled = weighted.reshape(len(solids), -1, weighted.shape[-1]).swapaxes(1, 2)  # (s, p, 6 n)
    curvature = pulled @ jacobian.reshape(len(solids), -1, jacobian.shape[-1])
    descent = (pulled @ residual.reshape(len(solids), -1, 1))[..., 0]
    _, stiffness, pull = model.prior(solids)
    curvature[:, range(6, curvature.shape[1]), range(6, curvature.shape[1])] += stiffness
    descent[:, 6:] += pull
    return curvature, descent


def _judged(model: Model, solid: Solids, about: _Expansion, seen: Observations) -> Solution:
    """One solid, how well it explains the views, and how well it is known."""
    curvature, _ = _normal_equations(model, solid, about)
    residual, to_view, weight = about.residual[0], about.to_view[0], about.weight[0]
    spread = max(1.0, float(np.median(about.squared[0])) / 5.35)  # median of chi squared with six degrees
    covariance = spread * np.linalg.pinv(curvature[0], rcond=1e-12, hermitian=True)
    gain = seen.pose_sd[:, None] ** 2 * np.swapaxes(to_view, -1, -2) @ weight  # (n, 6, 6)
    corrections = (gain @ residual[..., None])[..., 0]
    left = residual - (to_view @ corrections[..., None])[..., 0]
    price = curvature.shape[-1] * np.log(left.size)
    criterion = float(_cost(model, solid, about)[0] + price)
    return Solution(model, solid, criterion, covariance, float(np.sqrt((left**2).mean())), corrections)
