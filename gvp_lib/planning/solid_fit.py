"""What the fits of a solid have in common: boxes and cans, where their search begins, and which one is likeliest."""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.checks import check_fields, checked
from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arc import Arc
from gvp_lib.motion.arm import Outcome
from gvp_lib.motion.sighting import View
from gvp_lib.planning.plan import MIN_VIEWS, Optimum, given_arcs
from gvp_lib.planning.seen import Array, Observations
from gvp_lib.planning.solids import BOX, CYLINDER, FittedSolid, Shape

_ALIKE = 4.0  # views whose errors are alike
_ANYWHERE = np.sqrt(np.pi - 2)  # rad: standard deviation of a direction of which one knows that it faces the camera
_TILT = np.radians(35.0)
_TURNS = np.arange(8) * (np.pi / 4)  # of the axis about which to tilt
_HEIGHTS = (0.6, 1.5)  # of a box, over its shorter side as seen
_TOP = 0.004, 0.004  # m: inset and height of a top
_TOP_SCALES = (1.0, 5.0, 10.0)  # of a can's, which may be its shoulder or half of a tapered thing
_TOP_PRIOR = np.log(0.005), 1.0  # m and relative: about what height and inset a top may have, loosely
_MOST_INSET = 0.45  # of the shorter side


@checked
@dataclass(frozen=True)
class SolidFit(ABC):
    """What :class:`SilhouetteFit` and :class:`ContourFit` share; their docstrings tell the parameters."""

    radius: float = 0.25
    moment_sd: float = 0.25
    rotation_sd: float = np.radians(0.25)
    translation_sd: float = 0.002
    shapes: tuple[Literal["box", "cylinder"], ...] = ("box", "cylinder")
    explained: float = 1.0
    lean: float = 0.0

    _unusable: ClassVar[str]

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

    @abstractmethod
    def _answer(self, views: Sequence[View], intrinsics: CameraIntrinsics, first: View) -> Optimum | None:
        """Where to look from, by views enough; None where they do not tell."""

    @abstractmethod
    def usable(self, views: Sequence[View]) -> list[View]:
        """Views that the fit can use."""

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


# --- how a solid moves in a camera's eyes ---


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


def as_solids(solid: FittedSolid) -> tuple[Model, Solids]:
    """A fitted solid as the search knows it."""
    shape, top = BOX if solid.kind == BOX.name else CYLINDER, solid.top[1] > 0
    pose, sizes = solid.base_from_solid, [*solid.sizes[1 if shape.round else 0 :], *(solid.top if top else ())]
    body = pose.apply([0.0, 0.0, -0.5 * solid.top[1]])
    return Model(shape, top), Solids(pose.rotation.as_matrix()[None], body[None], np.log([sizes]))
