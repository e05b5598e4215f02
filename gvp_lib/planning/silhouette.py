"""``SilhouetteFit``: a simple solid that explains the silhouettes of all views at once, and the arm's own error.

The thesis reads one number per view, the ratio of the blob's axes, and looks where a polynomial through it is level.
The same blobs say more: six moments each, from a camera that knows roughly where it stood. Here a box or a can is
fitted to all of them by robust least squares, each view being allowed to have stood a little elsewhere than the arm
believes.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arc import Arc
from gvp_lib.motion.sighting import View
from gvp_lib.planning.least_squares import Model, Observations, Solids, Solution, refine
from gvp_lib.planning.plan import MIN_VIEWS, Finding, Optimum
from gvp_lib.planning.solids import BOX, CYLINDER, EXPLAINED, FittedSolid

__all__ = ["SilhouetteFit"]

_ALIKE = 4.0  # views whose errors are alike
_RULED_OUT = 3.0  # so many times as bad as another shape's, a solid isn't tried with a top: none ended best above 1.8
_SQUARE = 0.06  # relative difference of two sides below which neither is the longer
_TILT = np.radians(35.0)
_TURNS = np.arange(8) * (np.pi / 4)  # of the axis about which to tilt
_HEIGHTS = (0.6, 1.5)  # of a box, over its shorter side as seen
_TOP = 0.004, 0.004  # m: inset and height of a top
_TOP_SCALES = (1.0, 5.0, 10.0)  # of a can's, which may be its shoulder or half of a tapered thing


@dataclass(frozen=True)
class SilhouetteFit:
    """Fit of a box or a can, each with or without a narrower top, to the moments of all views of all arcs.

    Of the four solids the one counts whose residual is lowest, with a price on each further size (the Bayesian
    information criterion). The view to take is that of the face, or the round side, nearest to where the first arc
    began. Where other solids explain the views nearly as well, their disagreement is part of the uncertainty.

    Attributes
    ----------
    radius
        Distance from which to look, m from the object's center.
    moment_sd
        Standard deviation of a blob's axis lengths and centroid, px.
    rotation_sd, translation_sd
        Standard deviation of the arm's pose of a view, in each axis; rad and m. Enough for an arm that is off by
        millimeters; what all views share of it does no harm.
    shapes
        Solids to try.
    explained
        Residual up to which a solid explains the views, px; bricks and cans leave 0.03 to 0.14, a toy animal 0.3 to
        0.8.
    upright
        What to make of a normal of which no solid that explains the views tells: False takes the fitted one all the
        same; True goes half way from it to the one that is nearest to straight up. About its longest axis, which is
        well seen, such an object can look alike from all sides; the fit's normal and the expectation that things lean
        little are then each off by some 15 deg, and their middle by less. For a grasp, which forgives 20 deg and not
        30. The base's z axis must point up.
    lean
        Where no view along the normal can be reached, the farthest that one may lean from it toward the major axis,
        rad: the fingers of a gripper, which close along the minor axis, then still close squarely.
    """

    radius: float = 0.25
    moment_sd: float = 0.25
    rotation_sd: float = np.radians(0.25)
    translation_sd: float = 0.002
    shapes: tuple[Literal["box", "cylinder"], ...] = ("box", "cylinder")
    explained: float = EXPLAINED
    upright: bool = False
    lean: float = 0.0

    def __post_init__(self) -> None:
        for name in ("radius", "moment_sd", "rotation_sd", "translation_sd", "explained"):
            if not 0 < getattr(self, name) < np.inf:
                raise InvalidParameterError(f"SilhouetteFit.{name} is positive; got {getattr(self, name)}")
        if not 0 <= self.lean <= np.pi / 4:
            raise InvalidParameterError(
                f"lean is in radians, at most pi/4; got {self.lean}. For degrees: np.radians(...)"
            )
        if not self.shapes or set(self.shapes) - {"box", "cylinder"}:
            raise InvalidParameterError(f'shapes are of "box" and "cylinder", at least one; got {self.shapes}')

    def estimate(self, arcs: Sequence[Arc], intrinsics: CameraIntrinsics) -> Optimum:
        """The view of the fitted solid's face. See :class:`gvp_lib.planning.plan.ViewpointEstimator`."""
        views = [view for arc in arcs for view in arc.views if not view.clipped]
        arc = arcs[-1]
        if len(views) < MIN_VIEWS:
            return Optimum.at(arc, arc.center, Finding.TOO_FEW_VIEWS)
        first = arcs[0].views[arcs[0].center]
        solid = self.fit(views, intrinsics, first)
        if self.upright and not solid.explains:
            solid = replace(solid, normal=_toward_upright(solid))
        poses = _poses(solid, first, self.radius, self.lean)
        return Optimum(Finding.OPTIMUM, None, poses, solid.uncertainty, solid, self.radius)

    def fit(self, views: Sequence[View], intrinsics: CameraIntrinsics, first: View | None = None) -> FittedSolid:
        """The solid that explains the views.

        Parameters
        ----------
        views
            At least five, none clipped by the border of the image.
        intrinsics
            Lens of the camera.
        first
            View whose nearest face is the one to look at; by default the first of ``views``.
        """
        seen = Observations.of(views, intrinsics, self.moment_sd, np.repeat([self.rotation_sd, self.translation_sd], 3))
        found = self._solutions(seen)
        first = views[0] if first is None else first
        criteria = np.array([solution.criterion for solution in found])
        best = int(np.argmin(criteria))
        doubt = _disagreement(np.array([_normal(solution, first) for solution in found]), criteria, best)
        solid = _described(found[best], first)
        uncertainty = float(np.hypot(solid.uncertainty, doubt))
        return replace(solid, uncertainty=uncertainty, explained=self.explained)

    def _solutions(self, seen: Observations) -> list[Solution]:
        """Solids of all shapes, and with a top of those that may yet be the best."""
        models = [Model({"box": BOX, "cylinder": CYLINDER}[name], top=False) for name in self.shapes]
        found = [refine(model, first_guesses(model, seen), seen) for model in models]
        plain = [min(solutions, key=_criterion) for solutions in found if solutions]
        lowest = min(map(_criterion, plain))
        for solution in plain:
            if solution.criterion < _RULED_OUT * lowest:
                topped = replace(solution.model, top=True)
                found.append(refine(topped, guesses_with_top(solution, topped), seen))
        return [solution for solutions in found for solution in solutions]


def _criterion(solution: Solution) -> float:
    return solution.criterion


def _disagreement(normals: NDArray[np.float64], criteria: NDArray[np.float64], best: int) -> float:
    """Root mean square angle between the best solid's normal and the others', rad, by how likely each of them is."""
    # Neighboring views err alike, so that they count for less than as many independent ones would.
    weights = np.exp(-0.5 * (criteria - criteria[best]) / _ALIKE)
    angles = np.arccos(np.clip(normals @ normals[best], -1.0, 1.0))
    return float(np.sqrt(weights @ angles**2 / weights.sum()))


def _center(found: Solution) -> NDArray[np.float64]:
    """The middle of body and top together, shape (3,), m."""
    top = found.model.sizes(found.solid.log_sizes)[0, 4]
    middle: NDArray[np.float64] = found.solid.center[0] + 0.5 * top * found.solid.rotation[0, :, 2]
    return middle


def _normal(found: Solution, first: View) -> NDArray[np.float64]:
    """The outward normal nearest to a view, base frame, shape (3,)."""
    rotation = found.solid.rotation[0]
    toward = rotation.T @ (first.base_from_camera.translation - _center(found))
    normal: NDArray[np.float64] = rotation @ _nearest_normal(found.model.shape.round, toward)
    return normal


def _described(found: Solution, first: View) -> FittedSolid:
    rotation, normal = found.solid.rotation[0], _normal(found, first)
    a, b, h, inset, top = found.model.sizes(found.solid.log_sizes)[0]
    # A turn about each of the solid's axes turns the normal so; but one about a can's own axis is no error.
    spread = np.cross(np.diag([1.0, 1.0, 0.0 if found.model.shape.round else 1.0]), rotation.T @ normal)
    covariance = spread.T @ found.covariance[:3, :3] @ spread
    return FittedSolid(
        kind=found.model.shape.name,
        base_from_solid=RigidTransform.from_components(_center(found), Rotation.from_matrix(rotation)),
        sizes=np.array([a, b, h]),
        top=(float(inset), float(top)),
        normal=normal,
        uncertainty=float(np.sqrt(max(0.0, np.trace(covariance)))),
        residual=found.residual,
        corrections=found.corrections,
    )


def _nearest_normal(is_round: bool, toward: NDArray[np.float64]) -> NDArray[np.float64]:
    """The outward normal nearest a direction, in the solid's frame: a face's; a can's end's, or one across its axis."""
    if is_round and np.hypot(toward[0], toward[1]) > abs(toward[2]):
        return np.array([toward[0], toward[1], 0.0]) / np.hypot(toward[0], toward[1])
    k = 2 if is_round else int(np.argmax(np.abs(toward)))
    return np.sign(toward[k]) * np.eye(3)[k]


def _toward_upright(solid: FittedSolid) -> NDArray[np.float64]:
    """Half way from the fitted normal to straight up, as far as the longest axis leaves it: a unit vector."""
    longest = solid.base_from_solid.rotation.as_matrix()[:, np.argmax(solid.lengths)]
    up, normal = (v - (v @ longest) * longest for v in (np.array([0.0, 0.0, 1.0]), solid.normal))
    if min(np.linalg.norm(up), np.linalg.norm(normal)) < 0.1:
        return solid.normal  # it stands on end, or is seen end on
    middle = up / np.linalg.norm(up) + normal / np.linalg.norm(normal)
    return middle / np.linalg.norm(middle)


def _poses(solid: FittedSolid, first: View, radius: float, lean: float) -> tuple[RigidTransform, ...]:
    """``base_from_camera`` along the normal: x on the minor axis, y on the major one, nearest roll first."""
    axes, center = solid.base_from_solid.rotation.as_matrix(), solid.base_from_solid.translation
    lengths = solid.lengths
    # The solid's axes across the normal; one that was not believed stands on no axis of the solid.
    facing = int(np.argmax(np.abs(axes.T @ solid.normal)))
    if solid.kind == "cylinder":
        lying = abs(axes[:, 2] @ solid.normal) < 0.5
        y = axes[:, 2] if lying else first.base_from_camera.rotation.as_matrix()[:, 1]
        rolls = np.arange(2) * np.pi if lying else np.arange(8) * (np.pi / 4)
    else:
        i, j = np.delete(np.arange(3), facing)
        y = axes[:, i] if lengths[i] >= lengths[j] else axes[:, j]
        square = abs(lengths[i] - lengths[j]) < _SQUARE * max(lengths[i], lengths[j])
        rolls = np.arange(4) * (np.pi / 2) if square else np.arange(2) * np.pi
    z = -solid.normal
    x = np.cross(y, z)
    x /= np.linalg.norm(x)
    aligned = Rotation.from_matrix(np.column_stack([x, np.cross(z, x), z]))
    turned = [aligned * Rotation.from_rotvec([0.0, 0.0, roll]) for roll in rolls]
    here = first.base_from_camera.rotation
    turned.sort(key=lambda rotation: (here.inv() * rotation).magnitude())
    # Where no roll can be reached at the radius, a little further away or nearer one may be; or, at the radius, one
    # that leans.
    leans = [sign * share * lean for share in (0.5, 1.0) for sign in (1, -1)] if lean else []
    ways = [(share, 0.0) for share in (1.0, 1.2, 0.85)] + [(1.0, angle) for angle in leans]
    looking = Rotation.concatenate([rotation * Rotation.from_rotvec([a, 0, 0]) for _, a in ways for rotation in turned])
    distances = radius * np.repeat([share for share, _ in ways], len(turned))
    return tuple(RigidTransform.from_components(center - distances[:, None] * looking.as_matrix()[:, :, 2], looking))


def first_guesses(model: Model, seen: Observations) -> Solids:
    """Solids without a top, where the lines of sight meet, about as large as the middle view has it, tilted to all
    sides.

    From any one of them the search finds the best valley more often than not, so that of eight several do.
    """
    center = _meeting_point(seen)
    middle = len(seen.features) // 2
    facing = seen.rotation[middle] @ np.diag([1.0, -1.0, -1.0])  # z toward the camera, x to the right
    distance = float(np.linalg.norm(center - seen.position[middle]))
    sides = np.sqrt(12) * distance / seen.intrinsics.fx * seen.features[middle, [3, 5]]  # along u and v, m
    tilts = _TILT * np.stack([np.cos(_TURNS), np.sin(_TURNS), np.zeros(len(_TURNS))], axis=1)
    tilted = facing @ Rotation.from_rotvec(tilts).as_matrix()
    by_turns = itertools.cycle(_candidates(model, sides))
    axes, sizes = zip(*itertools.islice(by_turns, len(tilted)), strict=True)
    return Solids(tilted @ np.array(axes), np.repeat(center[None], len(tilted), axis=0), np.log(sizes))


def guesses_with_top(plain: Solution, model: Model) -> Solids:
    """The plain solid, with a top on each of its sides."""
    rotation, center = plain.solid.rotation[0], plain.solid.center[0]
    lengths = plain.model.sizes(plain.solid.log_sizes)[0, :3]
    ups = np.vstack([np.eye(3), -np.eye(3)]) if not model.shape.round else np.array([(0, 0, 1.0), (0, 0, -1.0)])
    rotations, sizes = [], []
    for up, scale in itertools.product(ups, _TOP_SCALES if model.shape.round else (1.0,)):
        k = int(np.argmax(np.abs(up)))
        # The axes in turn, so that the k-th becomes z: a proper rotation for either sign.
        order = [(k + 1) % 3, (k + 2) % 3, k]
        axes = rotation[:, order]
        if up[k] < 0:
            axes = axes @ np.diag([1.0, -1.0, -1.0])
        inset, top = np.multiply(_TOP, scale)
        body = lengths[order] - [0.0, 0.0, min(top, 0.4 * lengths[k])]
        rotations.append(axes)
        base = body[[0, 2]] if model.shape.round else body
        sizes.append([*base, inset, top])
    return Solids(np.array(rotations), np.repeat(center[None], len(rotations), axis=0), np.log(sizes))


def _candidates(model: Model, sides: NDArray[np.float64]) -> list[tuple[NDArray[np.float64], list[float]]]:
    """Two solids that look about as large: how they stand in the frame that faces the camera, and their sizes."""
    if not model.shape.round:
        return [(np.eye(3), [sides[0], sides[1], factor * min(sides)]) for factor in _HEIGHTS]
    lying = np.array([(1.0, 0, 0), (0, 0, 1.0), (0, -1.0, 0)]).T  # its axis along the image's v
    width = float(np.mean(sides))
    return [(np.eye(3), [width, 1.5 * width]), (lying, [sides[0], sides[1]])]


def _meeting_point(seen: Observations) -> NDArray[np.float64]:
    """The point nearest to all lines of sight through the centroids, shape (3,), m."""
    rays = np.einsum("nij,nj->ni", seen.rotation, seen.intrinsics.rays(seen.features[:, :2]))
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]  # (n, 3, 3)
    return np.linalg.solve(across.sum(0), np.einsum("nij,nj->i", across, seen.position))
