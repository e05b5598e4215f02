"""What a planner hands back: how it ended, and everything it saw on the way."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from gvp_lib.motion.arc import Arc
from gvp_lib.motion.arm import Motion
from gvp_lib.motion.sighting import View
from gvp_lib.planning.cnn import Action, Tilt
from gvp_lib.planning.optimum import Optimum

__all__ = ["Plan", "PlanOutcome", "Step"]


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
class Step:
    """One turn of the learned planner's closed loop: center, look, ask the policy, move.

    Attributes
    ----------
    view
        What the policy was shown, the object in the middle; None where the object was not in sight.
    said
        What the policy said; None where it was not asked, because the object could not be centered.
    motion
        The motion over the sphere that followed: to the next viewpoint of a survey, or to where the policy would be;
        None where the camera stayed.
    left
        With a policy that says tilts: what was left to the normal by all looks together, as seen from this view, and
        how uncertain that is (``left.sigma``, rad); None where nothing is known.
    outcome
        How a plan ends with this step; None where it goes on.
    barred
        Motions to viewpoints of a survey that were tried before ``motion`` and barred, for which they were passed over.
    """

    view: View | None
    said: Action | Tilt | None = None
    motion: Motion | None = None
    left: Tilt | None = None
    outcome: PlanOutcome | None = None
    barred: tuple[Motion, ...] = ()


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
    steps
        The learned planner's, in order; it has no arcs.
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
