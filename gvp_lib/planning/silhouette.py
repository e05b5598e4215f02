"""A simple solid that explains the silhouettes of all views at once, and the arm's own error.

The thesis reads one number per view, the ratio of the blob's axes. The same blobs say more: six moments each, from a
camera that knows roughly where it stood. Here a box or a can is fitted to all of them by robust least squares, from
many starts at once. Where each view stood against what the arm believes is not estimated along with the solid but
integrated out: it adds to the covariance of that view's six features, which is exact for small corrections.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.checks import check_fields, checked
from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arc import Arc
from gvp_lib.motion.arm import Outcome
from gvp_lib.motion.sighting import View
from gvp_lib.picture import brief
from gvp_lib.planning.approach import poses_along
from gvp_lib.planning.plan import MIN_VIEWS, Optimum, given_arcs
from gvp_lib.planning.seen import Array, Observations, features
from gvp_lib.planning.solids import BOX, CYLINDER, EXPLAINED, FittedSolid, Shape, silhouette_moments

__all__ = ["SilhouetteFit"]

_ALIKE = 4.0  # views whose errors are alike
_RULED_OUT = 3.0  # so many times as bad as another shape's, a solid isn't tried with a top: none ended best above 1.8
_ANYWHERE = np.sqrt(np.pi - 2)  # rad: standard deviation of a direction of which one knows that it faces the camera
_TILT = np.radians(35.0)
_TURNS = np.arange(8) * (np.pi / 4)  # of the axis about which to tilt
_HEIGHTS = (0.6, 1.5)  # of a box, over its shorter side as seen
_TOP = 0.004, 0.004  # m: inset and height of a top
_TOP_SCALES = (1.0, 5.0, 10.0)  # of a can's, which may be its shoulder or half of a tapered thing
_TAIL = 6 * 2.0**2  # squared distance of a view's six features beyond which it counts less and less: at 2 sd each
_TOP_PRIOR = np.log(0.005), 1.0  # m and relative: about what height and inset a top may have, loosely
_MOST_INSET = 0.45  # of the shorter side


@checked
@dataclass(frozen=True)
class SilhouetteFit:
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
        millimeters; an error that all views share does no harm.
    shapes
        Solids to try.
    explained
        Residual up to which a solid explains the views, px; bricks and cans leave 0.03 to 0.14, a toy animal 0.3 to
        0.8.
    upright
        Whether to go halfway from the normal of a solid that does not explain the views to the one nearest to straight
        up (the base's z axis). About its longest axis such an object can look alike from all sides; the fit's normal
        and the expectation that things lean little are then each off by some 15 deg, and their middle by less. For a
        grasp, which forgives 20 deg and not 30.
    lean
        Largest lean toward the major axis where no view along the normal can be reached, rad: a gripper's fingers then
        still close squarely along the minor axis.

    Examples
    --------
    >>> from gvp_lib import ImageMomentPlanner, WorkCell
    >>> cell = WorkCell(arm="floating", target="cuboid_1x2", seed=1)
    >>> print(ImageMomentPlanner(cell.segmenter, SilhouetteFit()).plan(cell.arm).solid)
    box 64 x 32 x 22 mm
    """

    radius: float = 0.25
    moment_sd: float = 0.25
    rotation_sd: float = np.radians(0.25)
    translation_sd: float = 0.002
    shapes: tuple[Literal["box", "cylinder"], ...] = ("box", "cylinder")
    explained: float = EXPLAINED
    upright: bool = False
    lean: float = 0.0

    __repr__ = brief
    _unusable = "clipped by the border of the image"

    def __post_init__(self) -> None:
        check_fields(
            self,
            {"radius": "in m", "rotation_sd": "in rad", "translation_sd": "in m"}
            | {"moment_sd": "in px", "explained": "in px"},
            lean=(lambda x: 0 <= x <= np.pi / 4, "in radians, at most pi/4 (for degrees: np.radians)"),
            shapes=(lambda names: {"box", "cylinder"} >= set(names) > set(), 'of "box" and "cylinder", at least one'),
        )

    def estimate(self, arcs: Sequence[Arc], intrinsics: CameraIntrinsics) -> Optimum:
        """See :class:`gvp_lib.planning.ViewpointEstimator`."""
        arcs = given_arcs(arcs)
        views = self.usable([view for arc in arcs for view in arc.views])
        arc = arcs[-1]
        if len(views) < MIN_VIEWS:
            return Optimum.at(arc, arc.center, Outcome.TOO_FEW_VIEWS)
        first = arcs[0].views[arcs[0].center]
        return self._answer(views, intrinsics, first) or Optimum.at(arc, arc.center, Outcome.NO_STATIONARY_POINT)

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
        return self._best(self._solutions(views, intrinsics), views[0] if first is None else first)

    def _check(self, views: Sequence[View]) -> None:
        unusable = len(views) - len(self.usable(views))
        if len(views) < MIN_VIEWS or unusable:
            name = type(self).__name__
            raise InvalidParameterError(
                f"{name}.fit needs {MIN_VIEWS} views or more, none of them {self._unusable}; got {len(views)}, "
                f"of which {unusable} are. Those of an arc that will do: {name}().usable(arc.views)"
            )

    def _best(self, found: Sequence[Solution], first: View) -> FittedSolid | None:
        """The likeliest solution; None where there is none, or they point anywhere."""
        if not found:
            return None
        criteria = np.array([solution.criterion for solution in found])
        best = int(np.argmin(criteria))
        normals = np.array([solution.normal(first) for solution in found])
        # Neighboring views err alike, so that they count for less than as many independent ones would.
        likely = np.exp(-0.5 * (criteria - criteria[best]) / _ALIKE)
        angles = np.arccos(np.clip(normals @ normals[best], -1.0, 1.0))
        doubt = float(np.sqrt(likely @ angles**2 / likely.sum()))
        solid = self._described(found[best], normals[best], doubt)
        return solid if solid.uncertainty < _ANYWHERE else None

    @property
    def pose_sd(self) -> Array:
        """Standard deviations of a view's rotation, rad, and translation, m, in the camera's axes, shape (6,)."""
        return np.repeat([self.rotation_sd, self.translation_sd], 3)

    @property
    def models(self) -> list[Model]:
        """The shapes to try, without a top."""
        return [Model({"box": BOX, "cylinder": CYLINDER}[name], top=False) for name in self.shapes]

    def _solutions(self, views: Sequence[View], intrinsics: CameraIntrinsics) -> list[Solution]:
        """Solids of all shapes, and with a top of those that may yet be the best."""
        seen = Observations.of(views, intrinsics, self.moment_sd, self.pose_sd)
        found = [refine(model, first_guesses(model, seen), seen) for model in self.models]
        plain = [min(solutions, key=lambda solution: solution.criterion) for solutions in found if solutions]
        lowest = min((solution.criterion for solution in plain), default=np.inf)
        for solution in plain:
            if solution.criterion < _RULED_OUT * lowest:
                topped = replace(solution.model, top=True)
                found.append(refine(topped, guesses_with_top(solution.model, solution.solid, topped), seen))
        return [solution for solutions in found for solution in solutions]

    def _described(self, found: Solution, normal: Array, doubt: float) -> FittedSolid:
        rotation = found.solid.rotation[0]
        return FittedSolid(
            kind=found.model.shape.name,
            base_from_solid=RigidTransform.from_components(found.center, Rotation.from_matrix(rotation)),
            sizes=found.sizes[:3],
            top=(float(found.sizes[3]), float(found.sizes[4])),
            normal=normal,
            uncertainty=float(np.hypot(found.model.sd(found.covariance, rotation.T @ normal), doubt)),
            residual=found.residual,
            corrections=found.corrections,
            explained=self.explained,
        )


def _toward_upright(solid: FittedSolid) -> Array:
    """Half way from the fitted normal to straight up, as far as the longest axis leaves it: a unit vector."""
    longest = solid.base_from_solid.rotation.as_matrix()[:, np.argmax(solid.lengths)]
    up, normal = (v - (v @ longest) * longest for v in (np.array([0.0, 0.0, 1.0]), solid.normal))
    if min(np.linalg.norm(up), np.linalg.norm(normal)) < 0.1:
        return solid.normal  # it stands on end, or is seen end on
    middle = up / np.linalg.norm(up) + normal / np.linalg.norm(normal)
    return middle / np.linalg.norm(middle)


# --- what may explain the views -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Stack:
    """Things of one kind, s of them at once: every field is an array of s rows."""

    def __getitem__(self, rows: NDArray[Any] | list[int]) -> Self:
        return type(self)(*(getattr(self, field.name)[rows] for field in fields(self)))

    def where(self, chosen: NDArray[np.bool_], other: Self) -> Self:
        """These where ``chosen``, shape (s,), is true, and else the other's."""
        both = [(getattr(self, field.name), getattr(other, field.name)) for field in fields(self)]
        return type(self)(*(np.where(chosen.reshape(-1, *[1] * (x.ndim - 1)), x, y) for x, y in both))


@dataclass(frozen=True, eq=False)
class Solids(Stack):
    """Solids of one kind, s of them at once."""

    rotation: Array  # of base_from_solid, (s, 3, 3)
    center: Array  # (s, 3), m
    log_sizes: Array  # logarithms of the model's free sizes, (s, k), of m

    def __len__(self) -> int:
        return len(self.center)

    def moved(self, step: Array) -> Solids:
        """By steps (s, 6 + k): a turn and a shift in the solid's own frame, and growth."""
        rotation = self.rotation @ Rotation.from_rotvec(step[:, :3]).as_matrix()
        center = self.center + (self.rotation @ step[:, 3:6, None])[..., 0]
        return Solids(rotation, center, self.log_sizes + step[:, 6:])


@dataclass(frozen=True, eq=False)
class Model:
    """Which sizes of a shape are free; ``top`` is whether it has a narrower top."""

    shape: Shape
    top: bool

    def sizes(self, log_sizes: Array) -> Array:
        """(a, b, h, inset, top), shape (..., 5), m, of the logarithms of the free ones (..., k)."""
        sizes = np.exp(log_sizes) @ self._free.T
        sizes[..., 3] = np.minimum(sizes[..., 3], _MOST_INSET * sizes[..., :2].min(-1))
        return sizes

    def growth(self, log_sizes: Array) -> Array:
        """Derivatives of the sizes to those logarithms, shape (..., 5, k)."""
        growth = self._free * np.exp(log_sizes)[..., None, :]
        sizes = growth.sum(-1)
        shorter = np.where(sizes[..., :1] <= sizes[..., 1:2], growth[..., 0, :], growth[..., 1, :])
        widest = sizes[..., 3] > _MOST_INSET * sizes[..., :2].min(-1)
        growth[..., 3, :] = np.where(widest[..., None], _MOST_INSET * shorter, growth[..., 3, :])
        return growth

    def sd(self, covariance: Array, normal: Array) -> Array:
        """Standard deviation of a normal in the solid's frame, rad, from covariances (..., 6 + k, 6 + k) as of
        `Solids.moved`."""
        # A turn about each of the solid's axes turns the normal so; but one about a can's own axis is no error.
        spread = np.cross(np.diag([1.0, 1.0, 0.0 if self.shape.round else 1.0]), normal)
        turned = spread.T @ covariance[..., :3, :3] @ spread
        return np.sqrt(np.trace(turned, axis1=-2, axis2=-1).clip(0.0))

    @cached_property
    def _free(self) -> Array:
        """Which of the five sizes each free one is, shape (5, k)."""
        each = np.eye(5)
        body = [each[0] + each[1], each[2]] if self.shape.round else list(each[:3])
        return np.stack(body + list(each[3:]) if self.top else body, axis=1)

    def prior(self, solids: Solids) -> tuple[Array, Array, Array]:
        """The top's share of the cost, shape (s,), and its curvature, (k,), and pull, (s, k), of the sizes."""
        curvature, pull = np.zeros(solids.log_sizes.shape[1]), np.zeros_like(solids.log_sizes)
        if self.top:
            curvature[-2:] = 1 / _TOP_PRIOR[1] ** 2
            pull[:, -2:] = (_TOP_PRIOR[0] - solids.log_sizes[:, -2:]) / _TOP_PRIOR[1] ** 2
        return (pull**2).sum(-1) * _TOP_PRIOR[1] ** 2, curvature, pull


@dataclass(frozen=True, eq=False)
class Solution:
    """The best solid of one model."""

    model: Model
    solid: Solids  # one
    criterion: float  # robust squared error plus the price of the parameters (Bayes): lower is better
    covariance: Array  # of the 6 + k parameters, as in `Solids.moved`
    residual: float  # root mean square of the features after the corrections, px
    corrections: Array  # of the views' poses, (n, 6), rad and m

    @property
    def sizes(self) -> Array:
        """(a, b, h, inset, top), shape (5,), m."""
        return np.asarray(self.model.sizes(self.solid.log_sizes)[0])

    @property
    def center(self) -> Array:
        """The middle of body and top together, shape (3,), m."""
        return np.asarray(self.solid.center[0] + 0.5 * self.sizes[4] * self.solid.rotation[0, :, 2])

    def normal(self, first: View) -> Array:
        """The outward normal nearest to a view, base frame, shape (3,): a face's; a can's end's, or one across its
        axis."""
        rotation = self.solid.rotation[0]
        toward = rotation.T @ (first.base_from_camera.translation - self.center)
        if self.model.shape.round and np.hypot(toward[0], toward[1]) > abs(toward[2]):
            local = np.array([toward[0], toward[1], 0.0]) / np.hypot(toward[0], toward[1])
        else:
            k = 2 if self.model.shape.round else int(np.argmax(np.abs(toward)))
            local = np.sign(toward[k]) * np.eye(3)[k]
        return np.asarray(rotation @ local)


# --- from where the search begins -----------------------------------------------------------------------------------


def first_guesses(model: Model, seen: Observations) -> Solids:
    """Solids without a top, where the lines of sight meet, about as large as the middle view has it, tilted to all
    sides: by turns two that look alike from there, a low box and a high one, or a standing can and a lying one.

    From any one of them the search finds the best valley more often than not, so that of eight several do.
    """
    center = seen.meeting_point()
    middle = len(seen.features) // 2
    facing = seen.rotation[middle] @ np.diag([1.0, -1.0, -1.0])  # z toward the camera, x to the right
    distance = float(np.linalg.norm(center - seen.position[middle]))
    sides = np.sqrt(12) * distance / seen.intrinsics.fx * seen.features[middle, [3, 5]]  # along u and v, m
    if model.shape.round:
        lying = np.array([(1.0, 0, 0), (0, 0, 1.0), (0, -1.0, 0)]).T  # its axis along the image's v
        width = float(np.mean(sides))
        alike = [(np.eye(3), [width, 1.5 * width]), (lying, [sides[0], sides[1]])]
    else:
        alike = [(np.eye(3), [sides[0], sides[1], factor * min(sides)]) for factor in _HEIGHTS]
    tilts = _TILT * np.stack([np.cos(_TURNS), np.sin(_TURNS), np.zeros(len(_TURNS))], axis=1)
    tilted = facing @ Rotation.from_rotvec(tilts).as_matrix()
    axes, sizes = zip(*itertools.islice(itertools.cycle(alike), len(tilted)), strict=True)
    with np.errstate(divide="ignore"):  # lines of sight that all begin in one place meet there
        log_sizes = np.log(sizes)
    return Solids(tilted @ np.array(axes), np.repeat(center[None], len(tilted), axis=0), log_sizes)


def guesses_with_top(plain: Model, solid: Solids, model: Model) -> Solids:
    """A plain solid, with a top on each of its sides."""
    rotation, lengths = solid.rotation[0], plain.sizes(solid.log_sizes)[0, :3]
    ups = np.vstack([np.eye(3), -np.eye(3)]) if not model.shape.round else np.array([(0, 0, 1.0), (0, 0, -1.0)])
    rotations, sizes = [], []
    for up, scale in itertools.product(ups, _TOP_SCALES if model.shape.round else (1.0,)):
        k = int(np.argmax(np.abs(up)))
        # The axes in turn, so that the k-th becomes z: a proper rotation for either sign.
        order = [(k + 1) % 3, (k + 2) % 3, k]
        axes = rotation[:, order]
        rotations.append(axes @ np.diag([1.0, -1.0, -1.0]) if up[k] < 0 else axes)
        inset, top = np.multiply(_TOP, scale)
        body = lengths[order] - [0.0, 0.0, min(top, 0.4 * lengths[k])]
        sizes.append([*(body[[0, 2]] if model.shape.round else body), inset, top])
    return Solids(np.array(rotations), np.repeat(solid.center, len(rotations), axis=0), np.log(sizes))


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


def chain(model: Model, solids: Solids, rotation: Array, translation: Array) -> Array:
    """From a solid's own turn, shift and growth to a turn about the lens and a shift in the camera's axes, and to the
    five sizes, shape (s, n, 11, p): its turn is one about the lens, and a shift."""
    linked = np.zeros((*rotation.shape[:2], 11, 6 + solids.log_sizes.shape[1]))
    linked[..., :3, :3] = linked[..., 3:6, 3:6] = rotation
    linked[..., 3:6, :3] = _matrix_of_cross(translation) @ rotation
    linked[..., 6:, 6:] = model.growth(solids.log_sizes)[:, None]
    return linked


def _matrix_of_cross(vectors: Array) -> Array:
    """Matrices by which vectors (..., 3) are crossed with others, (..., 3, 3); ``np.cross`` takes ten times as long."""
    matrices = np.zeros((*vectors.shape, 3))
    x, y, z = np.moveaxis(vectors, -1, 0)
    matrices[..., 0, 1], matrices[..., 0, 2], matrices[..., 1, 2] = -z, y, -x
    matrices[..., 1, 0], matrices[..., 2, 0], matrices[..., 2, 1] = z, -y, x
    return matrices


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
