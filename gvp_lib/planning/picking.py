"""From a first look to an object in the hand: a planner with fallbacks, and one call that plans and grasps."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.checks import A_SEGMENTER, check_fields, check_part, checked, lacking
from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arc import approach
from gvp_lib.motion.arm import EyeInHandArm, Gripper, Hand, Outcome
from gvp_lib.motion.sighting import Eye, align_with_major_axis, center_on_object
from gvp_lib.perception.segmentation import Segmenter
from gvp_lib.picture import Pictured, brief, count
from gvp_lib.planning.contours import ContourFit
from gvp_lib.planning.grasp import Grasp, GraspExecutor, once_free
from gvp_lib.planning.grips import Grip
from gvp_lib.planning.plan import Plan, ViewpointPlanner
from gvp_lib.planning.spread import SpreadViews

__all__ = ["Executor", "LookDown", "PickUp", "RobustPlanner", "pick_up"]

_AIR = 0.008  # m, between the palm and what the fingers grip
_UP = 0.10  # m, which a hand goes from what it failed to hold


@checked(own=True)
@dataclass(frozen=True)
class LookDown:
    """Planner of the usual top-down grasp: straight down, along the major axis of what is seen from there.

    Parameters
    ----------
    segmenter
        RGB uint8 (H, W, 3) to mask bool (H, W).
    radius
        Distance from which to look, m.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> cell = WorkCell(arm="floating", target="cuboid_1x4", seed=1)
    >>> LookDown(cell.segmenter).plan(cell.arm).outcome.value
    'aligned'
    """

    segmenter: Segmenter
    radius: float = 0.25

    __repr__ = brief

    def __post_init__(self) -> None:
        check_fields(self, {"radius": "in m"}, segmenter=A_SEGMENTER)

    def plan(self, arm: EyeInHandArm) -> Plan:
        """Look down on the object that the camera sees.

        Parameters
        ----------
        arm
            Arm with its camera on the object; down is its base's -z.
        """
        check_part("an arm", arm, EyeInHandArm, "cell.arm")
        eye = Eye(arm, self.segmenter)
        came = approach(eye, self.radius)
        if came.view is None or not came.motion:
            return Plan.standing(eye, came.motion.reason)
        if came.view.blob.fills((eye.intrinsics.height, eye.intrinsics.width)):
            return Plan(Outcome.TOO_LARGE, view=came.view, frames=eye.looks)
        here, down = arm.camera_pose(), np.array([0.0, 0.0, -1.0])
        turn, _ = Rotation.align_vectors([down], [here.rotation.as_matrix()[:, 2]])
        above = here.apply([0.0, 0.0, self.radius]) - self.radius * down
        goal = RigidTransform.from_components(above, turn * here.rotation)
        eye.expect(None)
        motion = arm.move_camera(here.inv() * goal)
        if not motion:
            return Plan.standing(eye, motion.reason)
        align_with_major_axis(eye)
        return Plan.standing(eye, center_on_object(eye, depth=self.radius).outcome)


@checked(own=True)
@dataclass(frozen=True)
class RobustPlanner:
    """Planner of Table 3.2's "ours": the first of several planners that arrives, each from where the arm began.

    By default :class:`SpreadViews`, by a :class:`ContourFit` for a grasp: it goes for a face, or a place, that fingers
    can span, and leans where the normal is out of reach. Where that does not arrive, :class:`LookDown`, which
    is better than wherever the arm happened to stop. An object that is not in view to begin with ends the plan at once.

    Parameters
    ----------
    segmenter
        RGB uint8 (H, W, 3) to mask bool (H, W).
    planners
        Planners to try, in order; None: the two above.
    opening
        Least and largest width between the fingers, m, as a gripper's stroke, for a view that they can grasp from; None
        where there is no telling. Of the default planners alone.
    fingers, failed
        Free length of the fingers, m, and grips that held nothing, as :class:`ContourFit` takes them. Of the default
        planners alone.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> cell = WorkCell(arm="floating", target="cuboid_1x2", seed=1)
    >>> plan = RobustPlanner(cell.segmenter).plan(cell.arm)
    >>> plan.outcome.value, bool(np.degrees(cell.truth.viewpoint_error()) < 1)
    ('aligned', True)
    """

    segmenter: Segmenter
    planners: tuple[ViewpointPlanner, ...] | None = None
    opening: tuple[float, float] | None = None
    fingers: float = 0.07
    failed: tuple[Grip, ...] = ()

    __repr__ = brief

    def __post_init__(self) -> None:
        check_fields(self, {}, segmenter=A_SEGMENTER)
        if self.planners is None:
            for_a_grasp = ContourFit(
                lean=np.radians(40), opening=self.opening, fingers=self.fingers, failed=self.failed
            )
            planners = SpreadViews(self.segmenter, for_a_grasp), LookDown(self.segmenter)
            object.__setattr__(self, "planners", planners)
        check_fields(
            self,
            {},
            planners=(
                lambda planners: len(planners) and not any(lacking(each, ViewpointPlanner) for each in planners),
                "a tuple of planners, each with a method plan(arm), as SpreadViews(segmenter) has, or None",
            ),
        )

    def plan(self, arm: EyeInHandArm) -> Plan:
        """Move the arm to the best view of what it looks at, by the first way that arrives; else as the last ended.

        Parameters
        ----------
        arm
            Arm with its camera on the object.
        """
        check_part("an arm", arm, EyeInHandArm, "cell.arm")
        assert self.planners is not None
        start, plan = arm.joints, _returned(self.planners[0].plan(arm), self.planners[0])
        for planner in self.planners[1:]:
            if plan.outcome.arrived or plan.outcome is Outcome.TARGET_NOT_FOUND:
                break
            arm.move_joints(start)
            before, plan = plan, _returned(planner.plan(arm), planner)
            plan = replace(plan, frames=before.frames + plan.frames, attempts=(*before.attempts, before.outcome))
        return plan


@runtime_checkable
class Executor(Protocol):
    """Whatever completes a grasp from where a plan has left the camera, as :class:`GraspExecutor` does."""

    def grasp(self, arm: EyeInHandArm, gripper: Gripper, plan: Plan | None = None) -> Grasp:
        """See :meth:`GraspExecutor.grasp`."""
        ...


@dataclass(frozen=True, eq=False)
class PickUp(Pictured):
    """Result of :func:`pick_up`, true where the hand holds something.

    Attributes
    ----------
    plan
        Plan of the viewpoint.
    grasp
        Grasp from there.
    seconds
        Time it took by this computer's clock, s, earlier attempts and all.
    attempts
        How earlier attempts ended.
    """

    _figure = "plot_pick_up"

    plan: Plan
    grasp: Grasp
    seconds: float
    attempts: tuple[Outcome, ...] = ()

    def __bool__(self) -> bool:
        return self.grasp.held

    @property
    def outcome(self) -> Outcome:
        """How the grasp ended."""
        return self.grasp.outcome

    def __str__(self) -> str:
        sd = self.plan.uncertainty
        view = f"within {np.degrees(sd):.2g} deg (1 sd)" if np.isfinite(sd) else self.plan.outcome
        if self.plan.outcome is Outcome.UNEXPLAINED and np.isfinite(sd):
            view = f"{self.plan.outcome}, {view}"
        ended = "picked up" if self else f"not picked up ({self.outcome})"
        ended += f" at attempt {len(self.attempts) + 1}" if self.attempts else ""
        pictures = count(self.plan.frames + self.grasp.frames, "picture")
        return f"{ended}: view {view}, {pictures}, {self.seconds:.1f} s"

    def __repr__(self) -> str:
        return f"PickUp({self})"


@checked(own=("arm", "gripper", "segmenter", "planner", "executor"))
def pick_up(
    arm: EyeInHandArm,
    gripper: Gripper,
    segmenter: Segmenter,
    *,
    planner: ViewpointPlanner | None = None,
    executor: Executor | None = None,
    attempts: int = 1,
) -> PickUp:
    """Pick up the object that the camera sees: plan a viewpoint, take it up, and grasp from there.

    ``gvp reproduce table-3.2`` runs this as "ours", and ``gvp reproduce objects`` with two attempts.

    Parameters
    ----------
    arm
        Arm with a camera in its hand, the object in sight; of several, the one nearest the middle of the image counts.
    gripper
        Gripper at that camera.
    segmenter
        RGB uint8 (H, W, 3) to mask bool (H, W).
    planner
        Planner of the viewpoint; None: :class:`RobustPlanner`, with the gripper's stroke and the length of its fingers.
    executor
        Whatever completes the grasp; None: ``GraspExecutor(segmenter)``. It tries even where the plan did not arrive.
    attempts
        How often to try. After a grasp that holds nothing the hand opens, goes up and back to where it began, looks
        anew at the object, wherever that lies by now, and plans anew; the default planner for another grip.

    Returns
    -------
    PickUp
        Plan and grasp of the last attempt; true where the hand holds something.

    Raises
    ------
    InvalidParameterError
        An argument lacks the methods that it needs, or there is to be no attempt.

    Examples
    --------
    >>> from gvp_lib import Noise, WorkCell
    >>> cell = WorkCell(arm="baxter", target="cuboid_1x2", noise=Noise.thesis(), seed=7, dynamic=True)
    >>> result = pick_up(cell.arm, cell.gripper, cell.segmenter)
    >>> bool(result), result.plan.outcome.value, result.grasp.outcome.value
    (True, 'aligned', 'held')
    """
    check_part("an arm", arm, EyeInHandArm, "cell.arm")
    check_part("a gripper", gripper, Gripper, "cell.gripper")
    own = None
    if planner is None:
        fingers = max(_AIR, round(gripper.hand.tips - gripper.hand.palm - _AIR, 3))
        planner = own = RobustPlanner(segmenter, opening=gripper.stroke, fingers=fingers)
    executor = GraspExecutor(segmenter) if executor is None else executor
    check_part("a planner", planner, ViewpointPlanner, "RobustPlanner(cell.segmenter)")
    check_part("an executor", executor, Executor, "GraspExecutor(cell.segmenter)")
    if attempts < 1:
        raise InvalidParameterError(f"attempts says how often to try, 1 or more; got {attempts}")
    began, start = time.monotonic(), arm.joints
    failed: tuple[Outcome, ...] = ()
    while True:
        plan = _returned(planner.plan(arm), planner)
        grasp = executor.grasp(arm, gripper, plan)
        if not isinstance(grasp, Grasp):
            raise InvalidParameterError(f"{type(executor).__name__}.grasp returned {grasp!r}, where a Grasp is meant")
        if grasp.held or len(failed) + 1 == attempts or not _withdrawn(arm, gripper, start):
            return PickUp(plan, grasp, time.monotonic() - began, failed)
        failed = (*failed, grasp.outcome)
        if own is not None and (grip := _closed_by(plan, grasp, gripper.hand)) is not None:
            planner = own = replace(own, planners=None, failed=(*own.failed, grip))


def _closed_by(plan: Plan, grasp: Grasp, hand: Hand) -> Grip | None:
    """How the fingers closed, or else were to close; None where nobody knows."""
    if grasp.closed_at is None:
        return plan.grips[0] if plan.grips else None
    closing, _, ahead = grasp.closed_at.rotation.as_matrix().T
    center = grasp.closed_at.apply([0.0, 0.0, hand.tips])
    return Grip(center, -ahead, closing, width=float(grasp.width), depth=0.0, hold=0.0)


def _withdrawn(arm: EyeInHandArm, gripper: Gripper, start: NDArray[np.float64]) -> bool:
    """Whether an empty hand is back where it began, by way of straight up as far as that goes."""
    gripper.open()
    here = arm.camera_pose()
    above = RigidTransform.from_translation([0.0, 0.0, _UP]) * here
    once_free(lambda: arm.move_camera(arm.camera_pose().inv() * above))
    return bool(once_free(lambda: arm.move_joints(start)))


def _returned(plan: object, by: object) -> Plan:
    """What somebody's own planner returned, if it is a plan."""
    if not isinstance(plan, Plan):
        raise InvalidParameterError(f"{type(by).__name__}.plan returned {plan!r}, where a Plan is meant")
    return plan
