"""Robust least squares of a solid against the silhouettes of many views, from many starts at once.

What is unknown of each view's pose is not estimated along with the solid but integrated out: it adds to the covariance
of that view's six features, which is exact as long as the corrections are small. Fifty views with six unknowns each so
cost no more than none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.sighting import View
from gvp_lib.perception.moments import Blob
from gvp_lib.planning.solids import Shape, silhouette_derivatives

__all__ = ["Model", "Observations", "Solids", "Solution", "feature_derivatives", "features", "refine"]

Array = NDArray[np.float64]

_SIDE = np.sqrt(12)  # a rectangle's side over its standard deviation
_PIXEL = 1 / 12  # px^2: a pixel's own inertia, which a blob of point masses lacks and a filled region has
_TAIL = 2.0  # standard deviations beyond which a view counts less and less
_TOP_PRIOR = np.log(0.005), 1.0  # m and relative: about what height and inset a top may have, loosely
_MOST_INSET = 0.45  # of the shorter side


def features(moments: Array) -> Array:
    """Six numbers per silhouette, all in pixels and of about the same accuracy, from moments: both (..., 6).

    They are the centroid, the side of a square as large as a twelfth of the area, and the roots of the second moments.
    """
    area, u, v, mu20, mu11, mu02 = np.moveaxis(moments, -1, 0)
    return np.stack([u, v, np.sqrt(area) / _SIDE, np.sqrt(mu20), mu11 / np.sqrt(mu20 + mu02), np.sqrt(mu02)], axis=-1)


def feature_derivatives(moments: Array) -> Array:
    """Derivatives of the features to the moments, shape (..., 6, 6)."""
    area, _, _, mu20, mu11, mu02 = np.moveaxis(moments, -1, 0)
    both = mu20 + mu02
    found = np.zeros((*moments.shape, 6))
    found[..., 0, 1] = found[..., 1, 2] = 1.0
    found[..., 2, 0] = 0.5 / (_SIDE * np.sqrt(area))
    found[..., 3, 3] = 0.5 / np.sqrt(mu20)
    found[..., 4, 4] = 1 / np.sqrt(both)
    found[..., 4, 3] = found[..., 4, 5] = -0.5 * mu11 / both**1.5
    found[..., 5, 5] = 0.5 / np.sqrt(mu02)
    return found


@dataclass(frozen=True, eq=False)
class Observations:
    """Views as arrays: six features of each silhouette, and where the camera stood.

    Attributes
    ----------
    features
        Shape (n, 6), px; see :func:`features`.
    rotation, position
        ``base_from_camera``, shapes (n, 3, 3) and (n, 3), m.
    intrinsics
        Lens of the camera.
    feature_sd
        Standard deviation of each feature, px.
    pose_sd
        Standard deviations of a view's pose, shape (6,): rotation (rad) and translation (m) in the camera's axes.
    """

    features: Array
    rotation: Array
    position: Array
    intrinsics: CameraIntrinsics
    feature_sd: float
    pose_sd: Array

    @classmethod
    def of(cls, views: Sequence[View], intrinsics: CameraIntrinsics, feature_sd: float, pose_sd: Array) -> Observations:
        """Observations of the views."""
        blobs: list[Blob] = [view.blob for view in views]
        moments = [(b.area, *b.centroid, b.mu20 + _PIXEL, b.mu11, b.mu02 + _PIXEL) for b in blobs]
        rotation = np.array([view.base_from_camera.rotation.as_matrix() for view in views])
        position = np.array([view.base_from_camera.translation for view in views])
        return cls(features(np.array(moments, float)), rotation, position, intrinsics, feature_sd, pose_sd)

    def some(self, count: int) -> Observations:
        """At most so many views, evenly taken."""
        n = len(self.features)
        chosen = np.unique(np.linspace(0, n - 1, min(n, count)).round().astype(int))
        return replace(
            self, features=self.features[chosen], rotation=self.rotation[chosen], position=self.position[chosen]
        )


@dataclass(frozen=True, eq=False)
class Solids:
    """Solids of one kind, s of them at once.

    Attributes
    ----------
    rotation, center
        ``base_from_solid``, shapes (s, 3, 3) and (s, 3), m.
    log_sizes
        Logarithms of the model's free sizes, shape (s, k), of m.
    """

    rotation: Array
    center: Array
    log_sizes: Array

    def __len__(self) -> int:
        return len(self.center)

    def __getitem__(self, which: NDArray[Any] | list[int] | slice) -> Solids:
        return Solids(self.rotation[which], self.center[which], self.log_sizes[which])

    def moved(self, step: Array) -> Solids:
        """By steps (s, 6 + k): a turn and a shift in the solid's own frame, and growth."""
        rotation = self.rotation @ Rotation.from_rotvec(step[:, :3]).as_matrix()
        center = self.center + (self.rotation @ step[:, 3:6, None])[..., 0]
        return Solids(rotation, center, self.log_sizes + step[:, 6:])


@dataclass(frozen=True, eq=False)
class Model:
    """Which sizes of a shape are free.

    Attributes
    ----------
    shape
        Box or cylinder.
    top
        Whether it has a narrower top.
    """

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

    @cached_property
    def _free(self) -> Array:
        """Which of the five sizes each free one is, shape (5, k)."""
        each = np.eye(5)
        body = [each[0] + each[1], each[2]] if self.shape.round else list(each[:3])
        return np.stack(body + list(each[3:]) if self.top else body, axis=1)


@dataclass(frozen=True, eq=False)
class Solution:
    """The best solid of one model.

    Attributes
    ----------
    model, solid
        The model and the one solid.
    criterion
        Robust squared error plus the price of the parameters (Bayesian information criterion): lower is better.
    covariance
        Covariance of the 6 + k parameters, as in :meth:`Solids.moved`.
    residual
        Root mean square of the features after the corrections, px.
    corrections
        Corrections of the views' poses, shape (n, 6), rad and m.
    """

    model: Model
    solid: Solids
    criterion: float
    covariance: Array
    residual: float
    corrections: Array


@dataclass(frozen=True, eq=False)
class _Expansion:
    """What was seen less what is predicted, and how the prediction changes.

    Attributes
    ----------
    residual
        Shape (s, n, 6), px.
    to_solid
        Derivatives of the prediction to the solid's parameters, shape (s, n, 6, p).
    to_view
        To a turn and shift of the camera in its own frame, shape (s, n, 6, 6).
    weight
        Inverse covariance of each residual, the view's pose integrated out, shape (s, n, 6, 6).
    """

    residual: Array
    to_solid: Array
    to_view: Array
    weight: Array

    def __getitem__(self, which: list[int]) -> _Expansion:
        return _Expansion(self.residual[which], self.to_solid[which], self.to_view[which], self.weight[which])


_Stack = TypeVar("_Stack", Solids, _Expansion)


def refine(model: Model, starts: Solids, seen: Observations, coarse: int = 8, keep: int = 3) -> list[Solution]:
    """Solids that explain what was seen, by Levenberg and Marquardt's method from all starts at once.

    All starts are tried on ``coarse`` of the views, with a can of few corners, and the best ``keep`` then on all.
    """
    few = replace(model, shape=model.shape.coarse)
    rough, _, cost = _descend(few, starts, seen.some(coarse), iterations=14)
    best = rough[np.argsort(cost, kind="stable")[:keep]]
    solids, about, cost = _descend(model, best, seen, iterations=12)
    return [_judged(model, solids[[k]], about[[k]], seen) for k in range(len(solids)) if np.isfinite(cost[k])]


def _descend(model: Model, solids: Solids, seen: Observations, iterations: int) -> tuple[Solids, _Expansion, Array]:
    """Solids of lower cost, what is predicted of them, and their costs (s,)."""
    damping = np.full(len(solids), 1e-2)
    about = _expand(model, solids, seen)
    for _ in range(iterations):
        cost = _cost(model, solids, about)
        tried = solids.moved(_step(model, solids, about, damping))
        there = _expand(model, tried, seen)
        # By the same weights as before: were they those of the new place, a step might pay that only blurs the views.
        new = _cost(model, tried, replace(there, weight=about.weight))
        better = new < cost
        solids, about = _chosen(better, tried, solids), _chosen(better, there, about)
        gained = np.where(better, cost - new, 0.0)
        if (gained <= 1e-4 * cost).all() and damping.max() < 1e3:
            break
        damping = np.clip(np.where(better, 0.1 * damping, 10 * damping), 1e-8, 1e4)
    return solids, about, _cost(model, solids, about)


def _chosen(which: NDArray[np.bool_], a: _Stack, b: _Stack) -> _Stack:
    """Of two stacks of s things each, those of ``a`` where ``which``, shape (s,), is true, and else those of ``b``."""
    of_both = ((getattr(a, field.name), getattr(b, field.name)) for field in fields(a))
    return type(a)(*(np.where(which.reshape(-1, *[1] * (x.ndim - 1)), x, y) for x, y in of_both))


def _expand(model: Model, solids: Solids, seen: Observations) -> _Expansion:
    """What each solid predicts of each view, and how that changes."""
    back = np.swapaxes(seen.rotation, -1, -2)
    rotation = back @ solids.rotation[:, None]  # camera_from_solid, (s, n, 3, 3)
    translation = (back @ (solids.center[:, None] - seen.position)[..., None])[..., 0]
    sizes = model.sizes(solids.log_sizes)[:, None]
    shape = model.shape if model.top else model.shape.plain
    moments, slopes = silhouette_derivatives(shape, rotation, translation, sizes, seen.intrinsics)
    with np.errstate(divide="ignore", invalid="ignore"):  # of a silhouette without width
        predicted, slopes = features(moments), feature_derivatives(moments) @ slopes
    to_view = -slopes[..., :6]  # a camera that turns and shifts sees the solid turn and shift the other way
    # From the solid's own turn, shift and growth: its turn is one about the lens, and a shift.
    chain = np.zeros((*rotation.shape[:2], 11, 6 + solids.log_sizes.shape[1]))
    chain[..., :3, :3] = chain[..., 3:6, 3:6] = rotation
    chain[..., 3:6, :3] = _cross(translation) @ rotation
    chain[..., 6:, 6:] = model.growth(solids.log_sizes)[:, None]
    covariance = (to_view * seen.pose_sd**2) @ np.swapaxes(to_view, -1, -2) + seen.feature_sd**2 * np.eye(6)
    usable = np.asarray(np.isfinite(covariance).all(axis=(-1, -2)))
    weight = np.linalg.inv(np.where(usable[..., None, None], covariance, np.eye(6)))
    residual = np.where(usable[..., None], seen.features - predicted, np.nan)
    return _Expansion(residual, slopes @ chain, to_view, weight)


def _cross(v: Array) -> Array:
    """The matrix of ``v x``, shape (..., 3, 3)."""
    x, y, z = np.moveaxis(v, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*v.shape[:-1], 3, 3)


def _squared(residual: Array, weight: Array) -> Array:
    """Squared distance of each view, in standard deviations, shape (..., n); infinite where nothing is predicted."""
    squared = ((weight @ residual[..., None])[..., 0] * residual).sum(-1)
    return np.where(np.isfinite(squared), squared, np.inf)


def _cost(model: Model, solids: Solids, about: _Expansion) -> Array:
    """Cauchy's robust sum over the views, and what is expected of a top, shape (s,)."""
    tail = 6 * _TAIL**2
    return (tail * np.log1p(_squared(about.residual, about.weight) / tail)).sum(-1) + _prior(model, solids)[0]


def _prior(model: Model, solids: Solids) -> tuple[Array, Array]:
    """The top's share of the cost, shape (s,), and its pull on the sizes, shape (s, k)."""
    pull = np.zeros_like(solids.log_sizes)
    if model.top:
        pull[:, -2:] = (_TOP_PRIOR[0] - solids.log_sizes[:, -2:]) / _TOP_PRIOR[1] ** 2
    return (pull**2).sum(-1) * _TOP_PRIOR[1] ** 2, pull


def _normal_equations(model: Model, solids: Solids, about: _Expansion) -> tuple[Array, Array]:
    """Curvature (s, p, p) and descent (s, p) of half the cost."""
    tail = 6 * _TAIL**2
    trust = 1 / (1 + _squared(about.residual, about.weight) / tail)  # (s, n)
    usable = trust[..., None] > 0
    jacobian, residual = np.where(usable[..., None], about.to_solid, 0.0), np.where(usable, about.residual, 0.0)
    weighted = (trust[..., None, None] * about.weight) @ jacobian  # (s, n, 6, p)
    pulled = weighted.reshape(len(solids), -1, weighted.shape[-1]).swapaxes(1, 2)  # (s, p, 6 n)
    curvature = pulled @ jacobian.reshape(len(solids), -1, jacobian.shape[-1])
    descent = (pulled @ residual.reshape(len(solids), -1, 1))[..., 0]
    if model.top:
        curvature[:, [-2, -1], [-2, -1]] += 1 / _TOP_PRIOR[1] ** 2
    descent[:, 6:] += _prior(model, solids)[1]
    return curvature, descent


def _step(model: Model, solids: Solids, about: _Expansion, damping: Array) -> Array:
    curvature, descent = _normal_equations(model, solids, about)
    diagonal = np.diagonal(curvature, axis1=1, axis2=2)
    ridge = damping[:, None] * diagonal + 1e-9 * diagonal.max(axis=1, keepdims=True) + 1e-12
    step = np.linalg.solve(curvature + ridge[:, None] * np.eye(ridge.shape[1]), descent[..., None])[..., 0]
    return np.clip(step, -0.5, 0.5)


def _judged(model: Model, solid: Solids, about: _Expansion, seen: Observations) -> Solution:
    curvature, _ = _normal_equations(model, solid, about)
    residual, to_view, weight = about.residual[0], about.to_view[0], about.weight[0]
    spread = max(1.0, float(np.median(_squared(residual, weight))) / 5.35)  # median of chi squared with six degrees
    covariance = spread * np.linalg.pinv(curvature[0], rcond=1e-12, hermitian=True)
    gain = seen.pose_sd[:, None] ** 2 * np.swapaxes(to_view, -1, -2) @ weight  # (n, 6, 6)
    corrections = (gain @ residual[..., None])[..., 0]
    left = residual - (to_view @ corrections[..., None])[..., 0]
    price = curvature.shape[-1] * np.log(left.size)
    criterion = float(_cost(model, solid, about)[0] + price)
    return Solution(model, solid, criterion, covariance, float(np.sqrt((left**2).mean())), corrections)
