"""Outlines held against the outline of a solid, each view's own error eliminated: what either fit asks of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from gvp_lib.planning.seen import Array, Flags, Outlines
from gvp_lib.planning.solid_fit import Model, Solids, Stack, chain
from gvp_lib.planning.solids import outline_of

_AT_ONCE = 1.3  # times the sd that views would leave which err independently: an arm errs alike at poses that are near
_ONE_OF, _LEAST = 1.7, 0.05  # points that count for one; the least share of `point_sd` squared that they scatter by
POINT_SD = 0.5  # px, across an outline
_ROUNDS = 10  # of the estimate of the poses' scatter
BELIEVED = 2.0  # times as far off as was told, up to which an arm's poses are believed to err each by itself

Loss = tuple[float, Literal["cauchy", "geman-mcclure"]]
"""A scale, in standard deviations, and which robust loss."""

LOSSES: tuple[Loss, ...] = ((20.0, "cauchy"), (6.0, "cauchy"), (3.0, "geman-mcclure"))
"""From one that far starts can follow to one to which what is hidden hardly matters."""


@dataclass(frozen=True, eq=False)
class About(Stack):
    """What is seen against what a solid predicts."""

    residual: Array  # how far outside of the predicted outline each point lies, (s, n, m), px
    to_solid: Array  # its derivatives to the solid's parameters, (s, n, m, p)
    to_view: Array  # and to a turn and shift of the camera in its own frame, (s, n, m, 6)
    corrections: Array  # of the views' poses, (s, n, 6), rad and m
    left: Array  # of the residual, once they are applied, (s, n, m), px
    weight: Array  # of each point, (s, n, m), 1/px^2
    cost: Array  # (s,)
    usable: Flags  # whether the solid is in front of every camera, (s,)


def compared(model: Model, solids: Solids, seen: Outlines, loss: Loss, corrections: Array) -> About:
    """Compare what is seen with what solids predict, near where the views' corrections are already about known."""
    residual, to_solid, to_view = expand(model, solids, seen)
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
    return About(residual, to_solid, to_view, corrections, left, weight, np.where(usable, total, np.inf), usable)


def seen_as(model: Model, solid: Solids, seen: Outlines) -> About:
    """Compare what is seen with one solid."""
    return compared(model, solid, seen, LOSSES[-1], np.zeros((1, len(seen.points), 6)))


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


def normal_equations(model: Model, solids: Solids, about: About, seen: Outlines) -> tuple[Array, Array]:
    """Curvature (s, p, p) and descent (s, p) of half the cost, the views' corrections eliminated."""
    curvature, descent = (each.sum(1) for each in by_view(about, seen))
    prior_curvature, pull = model.prior(solids)[1:]
    curvature[:, range(6, curvature.shape[1]), range(6, curvature.shape[1])] += prior_curvature
    descent[:, 6:] += pull
    return curvature, descent


def by_view(about: About, seen: Outlines) -> tuple[Array, Array]:
    """What each view says of a solid: its share of the curvature, (s, n, p, p), and of the descent, (s, n, p)."""
    pull_view = np.swapaxes(about.to_view, -1, -2) * about.weight[..., None, :]
    pull_solid = np.swapaxes(about.to_solid, -1, -2) * about.weight[..., None, :]
    mixed, residual = pull_view @ about.to_solid, about.residual[..., None]  # (s, n, 6, p)
    views = pull_view @ about.to_view + np.diag(seen.pose_sd**-2)
    solved = np.linalg.solve(views, np.concatenate([mixed, pull_view @ residual], axis=-1))
    through = np.swapaxes(mixed, -1, -2) @ solved
    return pull_solid @ about.to_solid - through[..., :-1], (through[..., -1:] - pull_solid @ residual)[..., 0]


def as_scattered(model: Model, solid: Solids, seen: Outlines) -> Outlines:
    """The views with their poses' standard deviations scaled to how these scatter about one solid.

    The most likely scale, by expectation and maximization: a view's correction is known only so well itself.
    """
    about, scale = seen_as(model, solid, seen), 1.0
    pull_view = np.swapaxes(about.to_view, -1, -2) * about.weight[..., None, :]
    for _ in range(_ROUNDS):
        sd = scale * seen.pose_sd
        now = replace(seen, pose_sd=sd)
        curvature, descent = normal_equations(model, solid, about, now)
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


def widened(covariance: Array, about: About, seen: Outlines) -> Array:
    """Covariance of one solid's parameters, with what poses add that scatter beyond belief.

    Such an arm errs in ways that no independent scatter describes, and its own frame is bent: what is known of the
    solid in that frame comes nearer to what the poses tell at their word.
    """
    if seen.scatter <= BELIEVED:
        return covariance
    return covariance + (1 - (BELIEVED / seen.scatter) ** 2) * _at_their_word(about, seen)


def _at_their_word(about: About, seen: Outlines) -> Array:
    """Covariance of one solid's parameters by the poses' scatter, (p, p), were none of the poses corrected."""
    pull = np.swapaxes(about.to_solid[0], -1, -2) * about.weight[0][:, None, :]  # (n, p, m)
    curvature = (pull @ about.to_solid[0]).sum(0)
    moved = np.linalg.pinv(curvature, rcond=1e-12, hermitian=True) @ (pull @ about.to_view[0])  # (n, p, 6)
    return np.asarray(np.einsum("npi,i,nqi->pq", moved, seen.pose_sd**2, moved), float)


def known(curvature: Array, seen: Outlines) -> Array:
    """Covariance of a solid's parameters, with what the arm's errors have in common."""
    covariance = _AT_ONCE**2 * np.asarray(np.linalg.pinv(curvature, rcond=1e-12, hermitian=True), float)
    covariance[..., :3, :3] += seen.pose_sd[0] ** 2 * np.eye(3)  # the arm is as far off where it will look from at last
    return covariance


def shared(about: About, seen: Outlines) -> float:
    """How many points count for one, since neighbors err alike, where they scatter by what is left of them."""
    left = np.abs(about.left[0])
    counted = left[seen.counts(about.left[0])]
    scatter = float(np.median(counted)) / 0.6745 if counted.size else seen.point_sd
    return max(_ONE_OF * (scatter / seen.point_sd) ** 2, _LEAST)


def expand(model: Model, solids: Solids, seen: Outlines) -> tuple[Array, Array, Array]:
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
