"""What planners that go by an estimator have in common: they ask it, go where it says, and say how that ended."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation, Slerp

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arc import Arc
from gvp_lib.motion.arm import Motion, Outcome
from gvp_lib.motion.primitives import turn
from gvp_lib.motion.sighting import Eye, View, align_with_major_axis, center_on_object
from gvp_lib.planning.plan import Optimum, Plan, ViewpointEstimator

_WORST_FIRST = (Outcome.TOO_FEW_VIEWS, Outcome.NO_STATIONARY_POINT, Outcome.ANY_ANGLE)
_ON_THE_WAY = (0.8, 0.6, 0.4, 0.2)  # to a pose that cannot be reached
OUT_OF_REACH = (Outcome.UNREACHABLE, Outcome.JOINT_LIMIT, Outcome.COLLISION)


class Attempt(ABC):
    """One plan in the making: what there is of it when it ends early."""

    def __init__(self, eye: Eye, estimator: ViewpointEstimator, radius: float, threshold: float) -> None:
        self.eye, self.estimator, self.radius, self.threshold = eye, estimator, radius, threshold
        self.arcs: list[Arc] = []
        self.optima: list[Optimum] = []
        self.view: View | None = None
        self.aligned = False  # whether the pose that was taken up has the right roll by itself

    def finished(self, outcome: Outcome) -> Plan:
        """Plan of all that was seen and found."""
        return Plan(outcome, tuple(self.arcs), tuple(self.optima), self.view, self.eye.looks)

    @abstractmethod
    def go(self) -> Outcome:
        """Look around, and go to the best view."""

    def align(self) -> Outcome | None:
        """Turn the wrist along the major axis where there is one; the last optimum may have done so."""
        if self.aligned:
            return None
        aligned = align_with_major_axis(self.eye, view=self.view)
        return self.after(aligned.view, aligned.motion)

    def estimate(self, arcs: Sequence[Arc]) -> Optimum:
        """Answer of the estimator, checked."""
        optimum = self.estimator.estimate(arcs, self.eye.intrinsics)
        name = f"{type(self.estimator).__name__}.estimate"
        if not isinstance(optimum, Optimum):
            raise InvalidParameterError(
                f"{name} returned {optimum!r}; an estimator returns an Optimum, and Optimum.at(arcs[-1], index) makes "
                "one of the number of a view"
            )
        if optimum.joints is None and not optimum.poses:
            raise InvalidParameterError(
                f"{name} returned an Optimum with neither joints nor poses, so there is nowhere to go; where nothing "
                "was found, say so and stay at the arc's center: Optimum.at(arcs[-1], arcs[-1].center, "
                "Outcome.NO_STATIONARY_POINT)"
            )
        if optimum.joints is not None and len(optimum.joints) != (n := len(arcs[-1].views[-1].joints)):
            raise InvalidParameterError(f"{name} returned {len(optimum.joints)} joint angles; this arm has {n}")
        return optimum

    def take_up(self, optimum: Optimum) -> Outcome | None:
        """Go where the optimum is, and center."""
        depth = None
        if optimum.poses:
            motion = self._to_first_reachable(optimum.poses)
            self.aligned = bool(motion)
            depth = optimum.distance if np.isfinite(optimum.distance) else self.radius
        else:
            assert optimum.joints is not None
            motion = self._to_joints(optimum.joints)
        if not motion:
            self.view = self.eye.look()
            return motion.reason
        if optimum.grips:  # which need not be in the object's middle
            return self.after(self.eye.look(), motion)
        centered = center_on_object(self.eye, depth=depth, threshold=self.threshold)
        trouble = self.after(centered.view, centered.motion)
        return Outcome.NOT_CENTERED if trouble is None and not centered else trouble

    def _to_joints(self, joints: NDArray[np.float64]) -> Motion:
        """Straight to a place on the last arc; where something is in the way, along the arc."""
        arc = self.arcs[-1]
        nearest = int(np.argmin([np.abs(view.joints - joints).max() for view in arc.views]))
        motion = self.eye.arm.move_joints(joints)
        if not motion:
            towards = range(arc.center, nearest, 1 if nearest >= arc.center else -1)
            for q in [*(arc.views[k].joints for k in towards), joints]:
                motion = self.eye.arm.move_joints(q)
        self.eye.expect(arc.views[nearest])
        return motion

    def _to_first_reachable(self, poses: Sequence[RigidTransform]) -> Motion:
        """To the first pose that can be reached: from here, or from the view nearest to it that was visited.

        Where none can, the camera ends as near as it comes on the way to the first from the visited view whose
        direction is nearest.
        """
        arm = self.eye.arm
        views = [view for arc in self.arcs for view in arc.views]

        motion = arm.move_camera(arm.camera_pose().inv() * poses[0])
        for pose in poses:
            for view in self.near(pose, views):
                if not motion and self.back_to(view):
                    motion = arm.move_camera(arm.camera_pose().inv() * pose)
        self.eye.expect(None)  # from the best viewpoint it may look like in no view so far
        if not motion:
            looked = poses[0].rotation.as_matrix()[:, 2]
            best = max(views, key=lambda view: float(view.line_of_sight @ looked))
            self.back_to(best)
            self.eye.expect(best)
            for between in _between(best.base_from_camera, poses[0], self.radius):
                if arm.move_camera(arm.camera_pose().inv() * between):
                    self.eye.expect(None)
                    break
        return motion

    def back_to(self, view: View) -> Motion:
        """Go back to a view."""
        return self.eye.arm.move_joints(view.joints)

    def near(self, pose: RigidTransform, views: Sequence[View], count: int = 1) -> list[View]:
        """Nearest views to a pose, from which to try it where it cannot be reached from here."""

        def apart(view: View) -> float:  # a radian counts as the radius
            between = view.base_from_camera.inv() * pose
            return float(np.linalg.norm(between.translation) + self.radius * between.rotation.magnitude())

        return sorted(views, key=apart)[:count]

    def after(self, view: View | None, motion: Motion) -> Outcome | None:
        """Remember the view; the trouble that there was, if any."""
        self.view = view
        if not motion:
            return motion.reason
        return Outcome.TARGET_LOST if view is None else None

    def verdict(self) -> Outcome:
        """What the estimator's findings make of a plan that met no obstacle."""
        last = self.optima[-1].solid
        if all(view.clipped for arc in self.arcs for view in arc.views) and not (last is not None and last.explains):
            return Outcome.TOO_LARGE
        found = [optimum.outcome for optimum in self.optima]
        # What the first arc leaves unexplained the second may explain; but each arc must have its own stationary point.
        return next((outcome for outcome in _WORST_FIRST if outcome in found), found[-1])


def _between(start: RigidTransform, goal: RigidTransform, distance: float) -> list[RigidTransform]:
    """Poses on the way between two that look at the same point from about the same distance, the farthest first."""
    turns = Slerp([0.0, 1.0], Rotation.concatenate([start.rotation, goal.rotation]))(_ON_THE_WAY)
    centers = [pose.apply([0.0, 0.0, distance]) for pose in (start, goal)]
    return [
        RigidTransform.from_components(
            (1 - share) * centers[0] + share * centers[1] - turn.apply([0, 0, distance]), turn
        )
        for share, turn in zip(_ON_THE_WAY, turns, strict=True)
    ]


def with_wrist_turned(
    eye: Eye, angles: Sequence[float], begin: Callable[[], Attempt], stuck: Callable[[Attempt, Outcome], bool]
) -> Plan:
    """Plan of the first attempt that is not stuck where the arm began, the wrist turned in between.

    Without any, it is that of the last.
    """
    arm, start = eye.arm, eye.arm.joints
    run = begin()
    outcome = run.go()
    for angle in angles:
        if not stuck(run, outcome):
            break
        arm.move_joints(start)
        eye.expect(None)
        if arm.move_camera(turn([0.0, 0.0, angle])):
            run = begin()
            outcome = run.go()
    return run.finished(outcome)


def saw_nothing(run: Attempt, outcome: Outcome) -> bool:
    """Whether the arm met its limits before it had seen anything."""
    return not run.arcs and outcome in OUT_OF_REACH
