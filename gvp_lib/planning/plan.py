"""What a planner hands back: how it ended, and everything it saw on the way."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from gvp_lib.motion.arc import Arc
from gvp_lib.motion.sighting import View
from gvp_lib.planning.optimum import Optimum

__all__ = ["Plan", "PlanOutcome"]


class PlanOutcome(Enum):
    """How a plan ended. In the first three the camera stands where the estimator would have it."""

    ALIGNED = "aligned"
    ANY_ANGLE = "any angle"  # and about one axis any angle is as good: along that arc all views looked alike
    NO_STATIONARY_POINT = "no stationary point"  # along an arc; there the camera stayed at the arc's center
    TOO_FEW_VIEWS = "too few views"  # likewise
    TARGET_NOT_FOUND = "target not found"  # nothing in view to begin with
    TARGET_LOST = "target lost"
    NOT_CENTERED = "not centered"  # the arm moves, and the object does not come to the middle of the image
    JOINT_LIMIT = "joint limit"
    COLLISION = "collision"
    UNREACHABLE = "unreachable"
    CONTACT = "contact"
    STALLED = "stalled"

    @property
    def arrived(self) -> bool:
        """Whether the camera stands at a viewpoint that the estimator chose, on both arcs."""
        return self in (PlanOutcome.ALIGNED, PlanOutcome.ANY_ANGLE)


@dataclass(frozen=True, eq=False)
class Plan:
    """A finished plan.

    Attributes
    ----------
    outcome
        How it ended.
    arcs
        The arcs traversed, in order; what there is of them where the plan ended early.
    optima
        What the estimator said after each.
    view
        The last view, from where the camera now stands; None where the object was not in sight.
    frames
        Pictures taken.
    """

    outcome: PlanOutcome
    arcs: tuple[Arc, ...]
    optima: tuple[Optimum, ...]
    view: View | None
    frames: int

    @property
    def views(self) -> tuple[View, ...]:
        """Every view of every arc: the trace."""
        return tuple(view for arc in self.arcs for view in arc.views)

    @property
    def joints(self) -> NDArray[np.float64] | None:
        """Joint angles at the last view, shape (n,), rad; None where there is no view."""
        return None if self.view is None else self.view.joints
