"""What estimators and policies answer, and the finished plan with all that it saw."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, IntEnum
from numbers import Integral
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arc import Arc
from gvp_lib.motion.arm import Motion
from gvp_lib.motion.sighting import View
from gvp_lib.picture import Pictured
from gvp_lib.planning.solids import FittedSolid

__all__ = [
    "Action",
    "Finding",
    "Optimum",
    "Plan",
    "PlanOutcome",
    "Policy",
    "Step",
    "Tilt",
    "ViewpointEstimator",
    "axes_after",
]

MIN_VIEWS = 5
"""A quartic has five coefficients, so fewer views determine none."""


def check_fields(owner: object, positive: Mapping[str, str], **others: tuple[bool, str]) -> None:
    """Refuse the first field that isn't right: positive, in its unit, or (whether it is right, what it should be)."""
    units = {name: (0 < getattr(owner, name) < np.inf, f"positive and finite, {u}") for name, u in positive.items()}
    for name, (right, expected) in {**units, **others}.items():
        if not right:
            raise InvalidParameterError(f"{type(owner).__name__}.{name} is {expected}; got {getattr(owner, name)!r}")


# --- what an estimator answers --------------------------------------------------------------------------------------


class Finding(Enum):
    """Kind of result of an estimator."""

    OPTIMUM = "optimum"
    NO_STATIONARY_POINT = "no stationary point"  # the best viewpoint may lie beyond the arc
    FEATURELESS = "featureless"  # the views look alike: any angle along the arc is right
    TOO_FEW_VIEWS = "too few views"
    UNEXPLAINED = "unexplained"  # the best that can be said, by a solid that does not explain the views


@dataclass(frozen=True, eq=False)
class Optimum:
    """Place where an estimator would have the camera go: joint angles, or the first reachable of several poses.

    Attributes
    ----------
    finding
        Kind of result.
    joints
        Joint angles of a place on an arc, shape (n,), rad; or None.
    poses
        ``base_from_camera`` of viewpoints that are equally good, best first; or none.
    uncertainty
        Standard deviation of the direction of view, rad; NaN where unknown.
    detail
        Findings of the estimator itself, such as a :class:`FittedSolid`.
    distance
        Distance of the poses from the object's center, m; NaN for the planner's radius.
    """

    finding: Finding
    joints: NDArray[np.float64] | None = None
    poses: tuple[RigidTransform, ...] = ()
    uncertainty: float = float("nan")
    detail: Any = None
    distance: float = float("nan")

    @classmethod
    def at(cls, arc: Arc, index: int, finding: Finding = Finding.OPTIMUM, detail: Any = None) -> Optimum:
        """The place of an arc's view, by its number from 0."""
        if not isinstance(index, Integral):
            raise InvalidParameterError(
                f"Optimum.at takes the number of a view, a whole number; got {index}. Of an angle in rad the nearest "
                "view is int(np.abs(arc.angles - angle).argmin()); Optimum.between(arc, 2.5) lies between two views"
            )
        return cls.between(arc, index, finding, detail)

    @classmethod
    def between(cls, arc: Arc, place: float, finding: Finding = Finding.OPTIMUM, detail: Any = None) -> Optimum:
        """A place between two views of an arc, by interpolated joint angles: 2.5 is half way from view 2 to view 3."""
        last = len(arc) - 1
        if not 0 <= place <= last:
            known = f", numbered 0 to {last}; to stay where it began: Optimum.at(arc, arc.center)" if last >= 0 else ""
            raise InvalidParameterError(f"there is no place {place} on an arc of {len(arc)} views{known}")
        low = int(place)
        share = float(place - low)
        joints = (1 - share) * arc.views[low].joints + share * arc.views[min(low + 1, last)].joints
        return cls(finding, joints=joints, detail=detail)


@runtime_checkable
class ViewpointEstimator(Protocol):
    """Finder of the best viewpoint in what was seen. Ten lines are enough for one of your own."""

    def estimate(self, arcs: Sequence[Arc], intrinsics: CameraIntrinsics) -> Optimum:
        """Best viewpoint by the arcs traversed so far, none of them empty, and the lens as the arm states it. The arm
        stands in the last arc."""
        ...


# --- what a policy answers ------------------------------------------------------------------------------------------


class Action(IntEnum):
    """Step of the learned planner over the virtual sphere in a direction of the image, or none: UP moves the camera
    along its own -y, however it is rolled.

    Examples
    --------
    >>> Action.DOWN.direction
    (0, 1)
    >>> Action(4).name
    'NO_OP'
    """

    UP = 0
    LEFT = 1
    DOWN = 2
    RIGHT = 3
    NO_OP = 4

    @property
    def direction(self) -> tuple[int, int]:
        """Where the camera moves in the image, (u, v): one of -1, 0, 1 each."""
        return ((0, -1), (-1, 0), (0, 1), (1, 0), (0, 0))[self]

    def step(self, angle: float, radius: float) -> RigidTransform:
        """The motion over a sphere of ``radius`` m, by an ``angle`` (rad) seen from its center, which stays where it is
        in the picture: ``camera_from_target``, as :meth:`EyeInHandArm.move_camera` takes it."""
        return _over_sphere(self.direction, angle, radius)


def axes_after(angle: float) -> NDArray[np.float64]:
    """The optical axis after each action by an angle, rad, in the camera's present frame, shape (5, 3)."""
    moves = np.array([action.direction for action in Action], float)
    still = 1.0 - np.abs(moves).sum(axis=1)
    return np.column_stack([-np.sin(angle) * moves, np.cos(angle) * (1 - still) + still])


@dataclass(frozen=True, slots=True)
class Tilt:
    """Output of a regression policy: how far, and which way, the camera has yet to move over the sphere.

    The camera moves by the angle ``hypot(u, v)`` in the image's direction ``atan2(v, u)``, as ``Label.angle`` and
    ``Label.direction`` count them (:mod:`gvp_lib.learning.labels`); then it looks along the object's normal.

    Attributes
    ----------
    u, v
        The angle's parts along the image's u and v, rad.
    sigma
        Standard deviation of each part, rad, positive; ``inf`` where the policy has no idea.

    Examples
    --------
    >>> tilt = Tilt(0.0, np.radians(20), sigma=np.radians(2))
    >>> round(float(np.degrees(tilt.angle)), 6)
    20.0
    >>> np.allclose(tilt.step(0.5, most=np.radians(5)).as_matrix(), Action.DOWN.step(np.radians(5), 0.5).as_matrix())
    True
    """

    u: float
    v: float
    sigma: float

    def __post_init__(self) -> None:
        for name in ("u", "v", "sigma"):  # as a network gives them they may be scalars of any library
            object.__setattr__(self, name, float(getattr(self, name)))
        # The parts of an angle of pi may come to the last bits more than pi.
        if not (np.hypot(self.u, self.v) <= np.pi * (1 + 1e-12) and self.sigma > 0):
            raise InvalidParameterError(
                "a tilt is two parts of an angle in rad, at most pi together, and their standard deviation in rad, "
                f"positive, or inf where nothing is known; got u={self.u}, v={self.v}, sigma={self.sigma}"
            )

    @classmethod
    def toward(cls, normal: ArrayLike, sigma: float) -> Tilt:
        """The tilt after which the camera looks along ``-normal``: a vector in its present frame, shape (3,)."""
        x, y, z = np.asarray(normal, float)
        angle, direction = np.arctan2(np.hypot(x, y), -z), np.arctan2(y, x)
        return cls(float(angle * np.cos(direction)), float(angle * np.sin(direction)), sigma)

    @property
    def angle(self) -> float:
        """How far to move, rad, in [0, pi]."""
        return min(float(np.hypot(self.u, self.v)), np.pi)

    @property
    def direction(self) -> float:
        """Which way in the image, rad, from +u toward +v in (-pi, pi]."""
        return float(np.arctan2(self.v, self.u))

    @property
    def normal(self) -> NDArray[np.float64]:
        """The object's normal by this tilt: a unit vector in the camera's present frame, shape (3,)."""
        across = np.sin(self.angle)
        return np.array([across * np.cos(self.direction), across * np.sin(self.direction), -np.cos(self.angle)])

    def step(self, radius: float, most: float = np.pi) -> RigidTransform:
        """The motion over a sphere of ``radius`` m, by ``most`` rad at most, as :meth:`Action.step`."""
        return _over_sphere((np.cos(self.direction), np.sin(self.direction)), min(self.angle, most), radius)


def _over_sphere(direction: tuple[float, float], angle: float, radius: float) -> RigidTransform:
    """Motion by an angle about the point ``radius`` m ahead, toward a unit direction (u, v) of the image or (0, 0)."""
    if not (0 <= angle <= np.pi and 0 < radius < np.inf):
        raise InvalidParameterError(
            f"a step is an angle in rad, at most pi, on a sphere of positive radius in m; got {angle}, {radius}"
        )
    du, dv = direction
    rotation = Rotation.from_rotvec(angle * np.array([dv, -du, 0.0]))
    center = np.array([0.0, 0.0, radius])
    return RigidTransform.from_components(center - rotation.apply(center), rotation)


Policy = Callable[[NDArray[np.uint8]], Action | Tilt]
"""Says what to do about a picture, RGB uint8 (H, W, 3): the whole of it, to be cropped as the policy was trained."""


# --- the plan -------------------------------------------------------------------------------------------------------


class PlanOutcome(Enum):
    """How a plan ended. In the first four the camera stands where the estimator would have it."""

    ALIGNED = "aligned"
    UNEXPLAINED = "unexplained"  # but no solid that it knows explains the views: the viewpoint may be far off
    ANY_ANGLE = "any angle"  # and about one axis any angle is as good: along that arc all views looked alike
    NO_STATIONARY_POINT = "no stationary point"  # along an arc; there the camera stayed at the arc's center
    TOO_FEW_VIEWS = "too few views"  # likewise
    TARGET_NOT_FOUND = "target not found"  # nothing in view to begin with
    TARGET_LOST = "target lost"
    OUT_OF_STEPS = "out of steps"  # the learned planner's: the policy would have gone on
    TOO_LARGE = "too large"  # the mask fills the picture: it takes in the background, or the object does not fit
    NOT_CENTERED = "not centered"  # the arm moves, and the object does not come to the middle of the image
    JOINT_LIMIT = "joint limit"
    COLLISION = "collision"
    UNREACHABLE = "unreachable"
    CONTACT = "contact"
    STALLED = "stalled"

    @property
    def arrived(self) -> bool:
        """Whether the camera stands at a viewpoint that the estimator chose on both arcs, or that the policy kept."""
        return self in (PlanOutcome.ALIGNED, PlanOutcome.UNEXPLAINED, PlanOutcome.ANY_ANGLE)


@dataclass(frozen=True, eq=False)
class Step:
    """One turn of the learned planner's closed loop: center, look, ask the policy, move.

    Attributes
    ----------
    view
        View that the policy was shown, the object in the middle; None where the object was not in sight.
    said
        Answer of the policy; None where the object could not be centered.
    motion
        Motion over the sphere that followed; None where the camera stayed.
    left
        Tilt that is left to the normal by all looks together, as seen from this view, and its sigma; None where
        nothing is known.
    outcome
        How a plan ends with this step; None where it goes on.
    barred
        Motions to viewpoints of a survey that were tried first and barred.
    """

    view: View | None
    said: Action | Tilt | None = None
    motion: Motion | None = None
    left: Tilt | None = None
    outcome: PlanOutcome | None = None
    barred: tuple[Motion, ...] = ()


@dataclass(frozen=True, eq=False)
class Plan(Pictured):
    """Finished plan.

    Attributes
    ----------
    outcome
        How it ended.
    arcs
        Arcs traversed, in order.
    optima
        Result of the estimator after each.
    view
        View from where the camera now stands; None where the object was not in sight.
    frames
        Pictures taken.
    steps
        Steps of the learned planner, in order; it has no arcs.
    """

    _figure = "plot_plan"

    outcome: PlanOutcome
    arcs: tuple[Arc, ...]
    optima: tuple[Optimum, ...]
    view: View | None
    frames: int
    steps: tuple[Step, ...] = ()

    @property
    def views(self) -> tuple[View, ...]:
        """Every view of every arc, or of every step: the trace."""
        of_arcs = (view for arc in self.arcs for view in arc.views)
        return (*of_arcs, *(step.view for step in self.steps if step.view is not None))

    @property
    def joints(self) -> NDArray[np.float64] | None:
        """Joint angles at the last view, shape (n,), rad; None where there is no view."""
        return None if self.view is None else self.view.joints

    @property
    def solid(self) -> FittedSolid | None:
        """Last solid that an estimator fitted to the views; None without one."""
        solids = [optimum.detail for optimum in self.optima if isinstance(optimum.detail, FittedSolid)]
        return solids[-1] if solids else None
