"""Results of planning: where an estimator would have the camera go, and a finished plan with all that it saw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from numbers import Integral
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arc import Arc
from gvp_lib.motion.sighting import View
from gvp_lib.planning.solids import FittedSolid

if TYPE_CHECKING:
    from gvp_lib.planning.learned import Step

__all__ = ["Finding", "Optimum", "Plan", "PlanOutcome", "ViewpointEstimator", "estimated"]

MIN_VIEWS = 5
"""A quartic has five coefficients, so fewer views determine none."""


class Finding(Enum):
    """Kind of result of an estimator."""

    OPTIMUM = "optimum"
    NO_STATIONARY_POINT = "no stationary point"  # the best viewpoint may lie beyond the arc
    FEATURELESS = "featureless"  # the views look alike: any angle along the arc is right
    TOO_FEW_VIEWS = "too few views"


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
        Standard deviation of the direction of view, rad; NaN where the estimator does not tell.
    distance
        Distance of the poses from the object's center, m; NaN, where the estimator does not tell, for the planner's
        radius.
    detail
        Findings of the estimator itself, such as a :class:`FittedSolid`.
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
        last = len(arc.views) - 1
        if not 0 <= place <= last:
            numbers = (
                "that has no views"
                if last < 0
                else (f"whose views have the numbers 0 to {last}; to stay where it began: Optimum.at(arc, arc.center)")
            )
            raise InvalidParameterError(f"there is no place {place} on an arc {numbers}")
        low = int(place)
        share = float(place - low)
        joints = (1 - share) * arc.views[low].joints + share * arc.views[min(low + 1, last)].joints
        return cls(finding, joints=joints, detail=detail)


@runtime_checkable
class ViewpointEstimator(Protocol):
    """Finder of the best viewpoint in what was seen. Ten lines are enough for one of your own."""

    def estimate(self, arcs: Sequence[Arc], intrinsics: CameraIntrinsics) -> Optimum:
        """Best viewpoint.

        Parameters
        ----------
        arcs
            Arcs traversed so far in this plan, none of them empty; the arm stands in the last one.
        intrinsics
            Lens, as the arm states it.
        """
        ...


def estimated(estimator: ViewpointEstimator, arcs: Sequence[Arc], intrinsics: CameraIntrinsics) -> Optimum:
    """Result of an estimator, checked.

    Raises
    ------
    InvalidParameterError
        The result is no :class:`Optimum`, or one without joints and poses.
    """
    optimum = estimator.estimate(arcs, intrinsics)
    name = f"{type(estimator).__name__}.estimate"
    if not isinstance(optimum, Optimum):
        raise InvalidParameterError(
            f"{name} returned {optimum!r}; an estimator returns an Optimum, and Optimum.at(arcs[-1], index) makes one "
            "of the number of a view"
        )
    if optimum.joints is None and not optimum.poses:
        raise InvalidParameterError(
            f"{name} returned an Optimum with neither joints nor poses, so there is nowhere to go; where nothing was "
            "found, say so and stay at the arc's center: Optimum.at(arcs[-1], arcs[-1].center, "
            "Finding.NO_STATIONARY_POINT)"
        )
    return optimum


class PlanOutcome(Enum):
    """How a plan ended. In the first three the camera stands where the estimator would have it."""

    ALIGNED = "aligned"
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
        """Whether the camera stands at a viewpoint that the estimator chose, on both arcs, or that the policy kept."""
        return self in (PlanOutcome.ALIGNED, PlanOutcome.ANY_ANGLE)


@dataclass(frozen=True, eq=False)
class Plan:
    """Finished plan.

    Attributes
    ----------
    outcome
        How it ended.
    arcs
        Arcs traversed, in order; what there is of them where the plan ended early.
    optima
        Result of the estimator after each.
    view
        Last view, from where the camera now stands; None where the object was not in sight.
    frames
        Pictures taken.
    steps
        Steps of the learned planner, in order; it has no arcs.
    """

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
