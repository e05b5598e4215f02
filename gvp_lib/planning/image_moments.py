"""The image-moment viewpoint planner: two arcs over the object, and the view that they point to. Thesis 2.3,
Algorithm 3; errata 12 to 15."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arc import Arc, ArcEnd, Axis, approach, traverse_arc
from gvp_lib.motion.arm import EyeInHandArm, Motion
from gvp_lib.motion.centering import align_with_major_axis, center_on_object
from gvp_lib.motion.sighting import Eye, View
from gvp_lib.perception.segmentation import Segmenter
from gvp_lib.planning.plan import Finding, Optimum, Plan, PlanOutcome, ViewpointEstimator, estimated
from gvp_lib.planning.quartic import QuarticFit

__all__ = ["ImageMomentPlanner"]

_CHECK_EVERY = 4  # views, between two looks at the estimator's uncertainty
_FIRST_LEG = np.radians(20)  # rad
_OUT_OF_REACH = (PlanOutcome.UNREACHABLE, PlanOutcome.JOINT_LIMIT, PlanOutcome.COLLISION)


@dataclass(frozen=True)
class ImageMomentPlanner:
    """Planner of the canonical view of an object with one RGB camera, and nothing calibrated but the lens.

    It centers the object, comes to the radius, turns the camera's y axis along the object's major axis, traverses an
    arc, goes where the estimator says, and does the same along the other axis. At the end x lies on the minor axis and
    y on the major one. It sees the arm only as an :class:`EyeInHandArm`.

    Attributes
    ----------
    segmenter
        RGB uint8 (H, W, 3) to mask bool (H, W).
    estimator
        Finder of the best viewpoint in the arcs; the thesis's by default.
    radius
        Radius of the virtual sphere, m.
    step
        Step of the traversal, m. Smaller is better and slower (3.1.6).
    max_angle
        Largest angle of an arc on each side, rad, where nothing else ends it.
    order
        Which arc first: ``"minor first"`` moves along the major axis and so turns about the minor one (errata 12).
    threshold
        Largest offset after a centering, px.
    until
        Standard deviation of the direction of view, rad, at which the traversal may stop; None sweeps both arcs. It
        needs an estimator that tells its uncertainty. The first arc then is a short one, and only where even the
        second leaves more doubt is the first traversed again, in full.
    keep_images
        Whether the trace keeps the pictures (0.9 MB each).
    turns
        Turns of the wrist about the lens, rad, with which to begin again, one after the other, where the arm met its
        limits before it had traversed anything. The thesis's planner gives up instead, which is the default.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> cell = WorkCell(arm="floating", target="cuboid_1x4", seed=1)
    >>> plan = ImageMomentPlanner(cell.segmenter).plan(cell.arm)
    >>> plan.outcome.value, len(plan.arcs)
    ('aligned', 2)
    """

    segmenter: Segmenter
    estimator: ViewpointEstimator = field(default_factory=QuarticFit)
    radius: float = 0.25
    step: float = 0.020
    max_angle: float = np.radians(60)
    order: Literal["minor first", "major first"] = "minor first"
    threshold: float = 2.0
    until: float | None = None
    keep_images: bool = False
    turns: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.estimator, ViewpointEstimator) or isinstance(self.estimator, type):
            raise InvalidParameterError(
                "an estimator has a method estimate(arcs, intrinsics), as QuarticFit() and SilhouetteFit() have; "
                f"got {self.estimator!r}"
            )
        if self.order not in ("minor first", "major first"):
            raise InvalidParameterError(f'order is "minor first" or "major first"; got {self.order!r}')
        for name in ("radius", "step", "max_angle", "threshold") + (() if self.until is None else ("until",)):
            value = getattr(self, name)
            if not 0 < value < np.inf:
                raise InvalidParameterError(f"ImageMomentPlanner.{name} is positive and finite; got {value}")
        if self.max_angle > np.pi:
            raise InvalidParameterError(
                f"max_angle is in radians, at most pi; got {self.max_angle}. For degrees: np.radians(...)"
            )

    def plan(self, arm: EyeInHandArm) -> Plan:
        """Move the arm to the best view of what it looks at, and tell how that went."""
        eye, start = Eye(arm, self.segmenter, keep_images=self.keep_images), arm.joints
        run = _Run(self, eye)
        outcome = run.go()
        for turn in self.turns:
            if run.arcs or outcome not in _OUT_OF_REACH:
                break
            arm.move_joints(start)
            eye.expect(None)
            if arm.move_camera(RigidTransform.from_rotation(Rotation.from_rotvec([0.0, 0.0, turn]))):
                run = _Run(self, eye)
                outcome = run.go()
        return run.finished(outcome)

    def conclude(self, arm: EyeInHandArm, arcs: Sequence[Arc]) -> Plan:
        """Move the arm to the best view by arcs that it has traversed already: another estimator on the same views."""
        if not arcs or not all(arc.views for arc in arcs):
            raise InvalidParameterError("give the arcs of a plan, at least one, and each with views")
        run = _Run(self, Eye(arm, self.segmenter, keep_images=self.keep_images))
        run.arcs = list(arcs)
        run.optima = [estimated(self.estimator, run.arcs, arm.intrinsics)]
        return run.finished(run.take_up(run.optima[-1]) or run.align() or run.verdict())

    def _legs(self) -> list[tuple[Axis, float]]:
        """The arcs to traverse: axis, and how far on each side at most."""
        first, second = self.axes
        if self.until is None:
            return [(first, self.max_angle), (second, self.max_angle)]
        # A short first arc, since what is still uncertain after it is mostly what only the second tells.
        return [(first, min(_FIRST_LEG, self.max_angle)), (second, self.max_angle), (first, self.max_angle)]

    @property
    def axes(self) -> tuple[Axis, Axis]:
        """The camera's axes along which the arcs go, in order."""
        return ("y", "x") if self.order == "minor first" else ("x", "y")


class _Run:
    """One plan in the making: what there is of it when it ends early."""

    def __init__(self, planner: ImageMomentPlanner, eye: Eye) -> None:
        self.planner, self.eye = planner, eye
        self.arcs: list[Arc] = []
        self.optima: list[Optimum] = []
        self.view: View | None = None
        self.aligned = False  # whether the pose that was taken up has the right roll by itself

    def finished(self, outcome: PlanOutcome) -> Plan:
        """The plan as it stands."""
        return Plan(outcome, tuple(self.arcs), tuple(self.optima), self.view, self.eye.looks)

    def go(self) -> PlanOutcome:
        """Algorithm 3."""
        planner, eye = self.planner, self.eye
        first = self.view = eye.look()
        if first is None:
            return PlanOutcome.TARGET_NOT_FOUND
        came = approach(eye, planner.radius, step=planner.step)
        trouble = self._after(came.view, came.motion)
        if came.motion and (came.view or first).blob.fills((eye.intrinsics.height, eye.intrinsics.width)):
            return PlanOutcome.TOO_LARGE
        if trouble is not None:
            return trouble
        legs = planner._legs()
        for number, (axis, max_angle) in enumerate(legs):
            trouble = self.align() or self._sweep(axis, max_angle) or self.take_up(self.optima[-1])
            certain = number > 0 and planner.until is not None and self.optima[-1].uncertainty < planner.until
            last = number == len(legs) - 1 or certain
            # A pose out of reach halfway ends nothing: the camera is back at a view, and may know better after it.
            poses = self.optima[-1].poses if self.optima else ()
            if trouble is not None and (last or trouble not in _OUT_OF_REACH or not poses):
                return trouble
            if last:
                break
        trouble = self.align()
        return self.verdict() if trouble is None else trouble

    def align(self) -> PlanOutcome | None:
        """Turn the wrist along the major axis where there is one; the last optimum may have done so."""
        if self.aligned:
            return None
        aligned = align_with_major_axis(self.eye, view=self.view)
        return self._after(aligned.view, aligned.motion)

    def _sweep(self, axis: Axis, max_angle: float) -> PlanOutcome | None:
        planner, watch = self.planner, None
        if planner.until is not None and self.arcs:
            watch = self._enough_along(axis, planner.until)
        arc = traverse_arc(
            self.eye,
            axis,
            radius=planner.radius,
            step=planner.step,
            max_angle=max_angle,
            threshold=planner.threshold,
            enough=watch,
        )
        if not arc.views:
            self.view = None
            return PlanOutcome.TARGET_LOST
        self.arcs.append(arc)
        self.optima.append(estimated(planner.estimator, self.arcs, self.eye.intrinsics))
        return None

    def _enough_along(self, axis: Axis, until: float) -> Callable[[Sequence[View]], bool]:
        def enough(views: Sequence[View]) -> bool:
            if len(views) % _CHECK_EVERY:
                return False
            here = Arc(axis, tuple(views), 0, (ArcEnd.ENOUGH, ArcEnd.ENOUGH), np.full(len(views), np.nan))
            return estimated(self.planner.estimator, [*self.arcs, here], self.eye.intrinsics).uncertainty < until

        return enough

    def take_up(self, optimum: Optimum) -> PlanOutcome | None:
        """Go where the optimum is, and center."""
        if optimum.poses:
            motion = self._to_first_reachable(optimum.poses)
            self.aligned = bool(motion)
        else:
            assert optimum.joints is not None
            motion = self._to_joints(optimum.joints)
        if not motion:
            self.view = self.eye.look()
            return PlanOutcome(motion.reason.value)
        if optimum.poses:
            depth = optimum.distance if np.isfinite(optimum.distance) else self.planner.radius
            centered = center_on_object(self.eye, by="shifting", depth=depth, threshold=self.planner.threshold)
        else:
            centered = center_on_object(self.eye, threshold=self.planner.threshold)
        trouble = self._after(centered.view, centered.motion)
        if trouble is None and not centered:
            return PlanOutcome.NOT_CENTERED
        return trouble

    def _to_joints(self, joints: np.ndarray) -> Motion:
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

        Where none can, the camera ends at the visited view whose direction of view is nearest to the wanted one.
        """
        arm = self.eye.arm
        views = [view for arc in self.arcs for view in arc.views]
        motion = arm.move_camera(arm.camera_pose().inv() * poses[0])
        for pose in poses:
            self.eye.expect(None)  # from the best viewpoint it may look like in no view so far
            if motion:
                return motion
            near = min(views, key=lambda view: _apart(view.base_from_camera, pose, self.planner.radius))
            if arm.move_joints(near.joints):
                motion = arm.move_camera(arm.camera_pose().inv() * pose)
                if motion:
                    return motion
        looked = poses[0].rotation.as_matrix()[:, 2]
        best = max(views, key=lambda view: float(view.base_from_camera.rotation.as_matrix()[:, 2] @ looked))
        arm.move_joints(best.joints)
        self.eye.expect(best)
        return motion

    def _after(self, view: View | None, motion: Motion) -> PlanOutcome | None:
        """Remember the view; the trouble that there was, if any."""
        self.view = view
        if not motion:
            return PlanOutcome(motion.reason.value)
        return PlanOutcome.TARGET_LOST if view is None else None

    def verdict(self) -> PlanOutcome:
        """What the estimator's findings make of a plan that met no obstacle."""
        if all(view.clipped for arc in self.arcs for view in arc.views):
            return PlanOutcome.TOO_LARGE
        findings = [optimum.finding for optimum in self.optima]
        for finding, outcome in (
            (Finding.TOO_FEW_VIEWS, PlanOutcome.TOO_FEW_VIEWS),
            (Finding.NO_STATIONARY_POINT, PlanOutcome.NO_STATIONARY_POINT),
            (Finding.FEATURELESS, PlanOutcome.ANY_ANGLE),
        ):
            if finding in findings:
                return outcome
        return PlanOutcome.ALIGNED


def _apart(a: RigidTransform, b: RigidTransform, radius: float) -> float:
    """Rough distance between two poses of a camera, m; a radian counts as the radius."""
    between = a.inv() * b
    return float(np.linalg.norm(between.translation) + radius * between.rotation.magnitude())
