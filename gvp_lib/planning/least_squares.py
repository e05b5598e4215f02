"""Robust least squares of a solid against the silhouettes of many views, from many starts at once.

What is unknown of each view's pose is not estimated along with the solid but integrated out: it adds to the covariance
of that view's six features, which is exact as long as the corrections are small. Fifty views with six unknowns each so
cost no more than none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gvp_lib.planning.observations import Observations, features
from gvp_lib.planning.solids import Shape, silhouette_moments

__all__ = ["Model", "Solution", "Solids", "refine"]

Array = NDArray[np.float64]

_TURN, _SHIFT, _GROW = 1e-4, 1e-5, 1e-3  # rad, m, relative: steps of the numeric derivatives
_TAIL = 2.0  # standard deviations beyond which a view counts less and less
_TOP_PRIOR = np.log(0.005), 1.0  # m and relative: about what height and inset a top may have, loosely


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
        center = self.center + np.einsum("sij,sj->si", self.rotation, step[:, 3:6])
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

    @property
    def free(self) -> int:
        """Number of free sizes."""
        return (2 if self.shape.round else 3) + (2 if self.top else 0)

    def sizes(self, log_sizes: Array) -> Array:
        """(a, b, h, inset, top), shape (..., 5), m, of the logarithms of the free ones (..., k)."""
        free = np.exp(log_sizes)
        base = 2 if self.shape.round else 3
        a, b, h = free[..., 0], free[..., base - 2], free[..., base - 1]
        if not self.top:
            return np.stack([a, b, h, np.zeros_like(a), np.zeros_like(a)], axis=-1)
        inset = np.minimum(free[..., base], 0.45 * np.minimum(a, b))
        return np.stack([a, b, h, inset, free[..., base + 1]], axis=-1)


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
        Of the 6 + k parameters, as in :meth:`Solids.moved`.
    residual
        Of the features after the corrections, root mean square, px.
    corrections
        Of the views' poses, shape (n, 6), rad and m.
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


def refine(model: Model, starts: Solids, seen: Observations, coarse: int = 14, keep: int = 4) -> list[Solution]:
    """Solids that explain what was seen, by Levenberg and Marquardt's method from all starts at once.

    All starts are tried on ``coarse`` of the views, with a can of few corners, and the best ``keep`` then on all.
    """
    solids, cost = _descend(replace(model, shape=model.shape.coarse), starts, seen.some(coarse), iterations=14)
    solids, cost = _descend(model, solids[np.argsort(cost, kind="stable")[:keep]], seen, iterations=12)
    return [_judged(model, solids[[k]], seen) for k in range(len(solids)) if np.isfinite(cost[k])]


def _descend(model: Model, solids: Solids, seen: Observations, iterations: int) -> tuple[Solids, Array]:
    damping = np.full(len(solids), 1e-2)
    cost = np.full(len(solids), np.inf)
    for _ in range(iterations):
        about = _expand(model, solids, seen)
        cost = _cost(about.residual, about.weight) + _prior(model, solids)[0]
        tried = solids.moved(_step(model, solids, about, damping))
        new = _cost(seen.features - _predict(model, tried, seen), about.weight) + _prior(model, tried)[0]
        better = new < cost
        solids = Solids(
            np.where(better[:, None, None], tried.rotation, solids.rotation),
            np.where(better[:, None], tried.center, solids.center),
            np.where(better[:, None], tried.log_sizes, solids.log_sizes),
        )
        gained = np.where(better, cost - new, 0.0)
        cost = np.where(better, new, cost)
        if (gained <= 1e-4 * cost).all() and damping.max() < 1e3:
            break
        damping = np.clip(np.where(better, 0.1 * damping, 10 * damping), 1e-8, 1e4)
    return solids, cost


def _predict(model: Model, solids: Solids, seen: Observations) -> Array:
    """Features of the solids in all views, shape (s, n, 6)."""
    rotation, translation = _in_cameras(solids, seen)
    return _features_of(model, rotation, translation, solids.log_sizes[:, None], seen)


def _in_cameras(solids: Solids, seen: Observations) -> tuple[Array, Array]:
    """``camera_from_solid`` for each solid and view: (s, n, 3, 3) and (s, n, 3)."""
    rotation = np.einsum("nji,sjk->snik", seen.rotation, solids.rotation)
    translation = np.einsum("nji,snj->sni", seen.rotation, solids.center[:, None] - seen.position)
    return rotation, translation


def _features_of(model: Model, rotation: Array, translation: Array, log_sizes: Array, seen: Observations) -> Array:
    sizes = model.sizes(log_sizes)
    moments = silhouette_moments(model.shape, rotation, translation, sizes, seen.intrinsics)
    with np.errstate(invalid="ignore"):
        return features(*np.moveaxis(moments, -1, 0))


def _expand(model: Model, solids: Solids, seen: Observations) -> _Expansion:
    rotation, translation = _in_cameras(solids, seen)
    turns = Rotation.from_rotvec(_TURN * np.eye(3)).as_matrix()  # (3, 3, 3)
    # One stack of nudged solids, (s, 1 + 6 + k, n, ...): as they are, turned, shifted, grown.
    rotations = np.concatenate([rotation[:, None], rotation[:, None] @ turns[:, None]], axis=1)
    rotations = np.concatenate([rotations, np.repeat(rotation[:, None], 3 + model.free, axis=1)], axis=1)
    shifts = _SHIFT * np.moveaxis(rotation, -1, 1)  # (s, 3, n, 3): the solid's axes in the camera
    same = translation[:, None]
    translations = np.concatenate(
        [np.repeat(same, 4, axis=1), same + shifts, np.repeat(same, model.free, axis=1)], axis=1
    )
    grown = solids.log_sizes[:, None] + np.concatenate([np.zeros((7, model.free)), _GROW * np.eye(model.free)])
    found = _features_of(model, rotations, translations, grown[:, :, None], seen)
    steps = np.repeat([_TURN, _SHIFT, _GROW], [3, 3, model.free])
    to_solid = np.moveaxis((found[:, 1:] - found[:, :1]) / steps[:, None, None], 1, -1)  # (s, n, 6, p)
    # A camera that turns and shifts sees the solid turn and shift the other way.
    back = np.swapaxes(rotation, -1, -2)
    by_turn, by_shift = to_solid[..., :3], to_solid[..., 3:6]
    to_view = np.concatenate([by_shift @ back @ _cross(translation) - by_turn @ back, -by_shift @ back], axis=-1)
    covariance = (to_view * seen.pose_sd**2) @ np.swapaxes(to_view, -1, -2) + seen.feature_sd**2 * np.eye(6)
    usable = np.isfinite(covariance).all(axis=(-1, -2), keepdims=True)
    weight = np.linalg.inv(np.where(usable, covariance, np.eye(6)))
    return _Expansion(seen.features - found[:, 0], to_solid, to_view, weight)


def _cross(v: Array) -> Array:
    """The matrix of ``v x``, shape (..., 3, 3)."""
    x, y, z = np.moveaxis(v, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*v.shape[:-1], 3, 3)


def _squared(residual: Array, weight: Array) -> Array:
    """Squared distance of each view, in standard deviations, shape (s, n); infinite where nothing is predicted."""
    squared = np.einsum("sni,snij,snj->sn", residual, weight, residual)
    return np.where(np.isfinite(squared), squared, np.inf)


def _cost(residual: Array, weight: Array) -> Array:
    """Cauchy's robust sum over the views, shape (s,)."""
    tail = 6 * _TAIL**2
    return (tail * np.log1p(_squared(residual, weight) / tail)).sum(-1)


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
    jacobian = np.nan_to_num(about.to_solid)
    pulled = np.swapaxes(jacobian, -1, -2) @ (trust[..., None, None] * about.weight)  # (s, n, p, 6)
    curvature = (pulled @ jacobian).sum(1)
    descent = np.einsum("snpi,sni->sp", pulled, np.nan_to_num(about.residual))
    if model.top:
        curvature[:, [-2, -1], [-2, -1]] += 1 / _TOP_PRIOR[1] ** 2
    descent[:, 6:] += _prior(model, solids)[1]
    return curvature, descent


def _step(model: Model, solids: Solids, about: _Expansion, damping: Array) -> Array:
    curvature, descent = _normal_equations(model, solids, about)
    diagonal = np.einsum("sii->si", curvature)
    ridge = damping[:, None] * diagonal + 1e-9 * diagonal.max(axis=1, keepdims=True) + 1e-12
    step = np.linalg.solve(curvature + ridge[:, None] * np.eye(ridge.shape[1]), descent[..., None])[..., 0]
    return np.clip(step, -0.5, 0.5)


def _judged(model: Model, solid: Solids, seen: Observations) -> Solution:
    about = _expand(model, solid, seen)
    curvature, _ = _normal_equations(model, solid, about)
    unknowns = curvature.shape[-1]
    squared = _squared(about.residual, about.weight)[0]
    spread = max(1.0, float(np.median(squared)) / 5.35)  # the median of chi squared with six degrees of freedom
    covariance = spread * np.linalg.pinv(curvature[0], rcond=1e-12, hermitian=True)
    gain = seen.pose_sd[:, None] ** 2 * np.swapaxes(about.to_view[0], -1, -2) @ about.weight[0]  # (n, 6, 6)
    corrections = (gain @ about.residual[0, :, :, None])[..., 0]
    left = about.residual[0] - (about.to_view[0] @ corrections[..., None])[..., 0]
    price = unknowns * np.log(left.size)
    criterion = float(_cost(about.residual, about.weight)[0] + _prior(model, solid)[0][0] + price)
    return Solution(model, solid, criterion, covariance, float(np.sqrt((left**2).mean())), corrections)
