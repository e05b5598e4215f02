"""The image-moment viewpoint planner: two arcs over the object, and the view that they point to. Thesis 2.3,
Algorithm 3; errata 12 to 15."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arc import Arc, ArcEnd, Axis, approach, traverse_arc
from gvp_lib.motion.arm import EyeInHandArm, Motion
from gvp_lib.motion.centering import align_with_major_axis, center_on_object
from gvp_lib.motion.sighting import Eye, View
from gvp_lib.perception.segmentation import Segmenter
from gvp_lib.planning.optimum import Finding, Optimum, QuarticFit, ViewpointEstimator
from gvp_lib.planning.plan import Plan, PlanOutcome

__all__ = ["ImageMomentPlanner", "Plan", "PlanOutcome"]

_CHECK_EVERY = 4  # views, between two looks at the estimator's uncertainty


@dataclass(frozen=True)
class ImageMomentPlanner:
    """Finds the canonical view of an object with one RGB camera, and nothing calibrated but the lens.

    It centers the object, comes to the radius, turns the camera's y axis along the object's major axis, traverses an
    arc, goes where the estimator says, and does the same along the other axis. At the end x lies on the minor axis and y
    on the major one. It sees the arm only as an :class:`EyeInHandArm`.

    Attributes
    ----------
    segmenter
        RGB uint8 (H, W, 3) to mask bool (H, W).
    estimator
        Finds the best viewpoint in the arcs; the thesis's by default.
    radius
        Of the virtual sphere, m.
    step
        Of the traversal, m. Smaller is better and slower (3.1.6).
    max_angle
        Of an arc on each side, rad, where nothing else ends it.
    order
        Which arc first: ``"minor first"`` moves along the major axis and so turns about the minor one (errata 12).
    threshold
        Of every centering, px.
    until
        Standard deviation of the direction of view, rad, at which the traversal may stop; None sweeps both arcs. It
        needs an estimator that tells its uncertainty.
    keep_images
        Whether the trace keeps the pictures (0.9 MB each).

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
    max_angle: float = np.radians(45)
    order: Literal["minor first", "major first"] = "minor first"
    threshold: float = 2.0
    until: float | None = None
    keep_images: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.estimator, ViewpointEstimator):
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
        eye = Eye(arm, self.segmenter, keep_images=self.keep_images)
        run = _Run(self, eye)
        outcome = run.go()
        return Plan(outcome, tuple(run.arcs), tuple(run.optima), run.view, eye.looks)


class _Run:
    """One plan in the making: what there is of it when it ends early."""

    def __init__(self, planner: ImageMomentPlanner, eye: Eye) -> None:
        self.planner, self.eye = planner, eye
        self.arcs: list[Arc] = []
        self.optima: list[Optimum] = []
        self.view: View | None = None

    def go(self) -> PlanOutcome:
        """Algorithm 3."""
        planner, eye = self.planner, self.eye
        self.view = eye.look()
        if self.view is None:
            return PlanOutcome.TARGET_NOT_FOUND
        came = approach(eye, planner.radius, step=planner.step)
        if (trouble := self._after(came.view, came.motion)) is not None:
            return trouble
        axes: tuple[Axis, Axis] = ("y", "x") if planner.order == "minor first" else ("x", "y")
        for axis in axes:
            trouble = self._align() or self._sweep(axis) or self._take_up(self.optima[-1])
            if trouble is not None:
                return trouble
            if ArcEnd.ENOUGH in self.arcs[-1].ends:
                break
        trouble = self._align()
        return self._verdict() if trouble is None else trouble

    def _align(self) -> PlanOutcome | None:
        """Turn the wrist along the major axis where there is one; the last optimum may have done so."""
        if self.optima and self.optima[-1].poses:
            return None
        aligned = align_with_major_axis(self.eye, view=self.view)
        return self._after(aligned.view, aligned.motion)

    def _sweep(self, axis: Axis) -> PlanOutcome | None:
        planner = self.planner
        arc = traverse_arc(
            self.eye, axis, radius=planner.radius, step=planner.step, max_angle=planner.max_angle,
            threshold=planner.threshold, enough=None if planner.until is None else self._enough_along(axis),
        )  # fmt: skip
        if not arc.views:
            self.view = None
            return PlanOutcome.TARGET_LOST
        self.arcs.append(arc)
        self.optima.append(planner.estimator.estimate(self.arcs, self.eye.intrinsics))
        return None

    def _enough_along(self, axis: Axis):  # type: ignore[no-untyped-def]
        def enough(views: Sequence[View]) -> bool:
            if len(views) < 2 * _CHECK_EVERY or len(views) % _CHECK_EVERY:
                return False
            here = Arc(axis, tuple(views), 0, (ArcEnd.ENOUGH, ArcEnd.ENOUGH), np.full(len(views), np.nan))
            found = self.planner.estimator.estimate([*self.arcs, here], self.eye.intrinsics)
            return bool(found.uncertainty < self.planner.until)

        return enough

    def _take_up(self, optimum: Optimum) -> PlanOutcome | None:
        """Go where the optimum is, and center."""
        if optimum.poses:
            motion = self._to_first_reachable(optimum.poses)
        else:
            assert optimum.joints is not None
            motion = self._to_joints(optimum.joints)
        if not motion:
            self.view = self.eye.look()
            return PlanOutcome(motion.reason.value)
        if optimum.poses:
            centered = center_on_object(
                self.eye, by="shifting", depth=self.planner.radius, threshold=self.planner.threshold
            )
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
            near = min(views, key=lambda view: _apart(view.base_from_camera, pose))
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

    def _verdict(self) -> PlanOutcome:
        findings = [optimum.finding for optimum in self.optima]
        for finding, outcome in (
            (Finding.TOO_FEW_VIEWS, PlanOutcome.TOO_FEW_VIEWS),
            (Finding.NO_STATIONARY_POINT, PlanOutcome.NO_STATIONARY_POINT),
            (Finding.FEATURELESS, PlanOutcome.ANY_ANGLE),
        ):
            if finding in findings:
                return outcome
        return PlanOutcome.ALIGNED


def _apart(a: RigidTransform, b: RigidTransform) -> float:
    """How far apart two poses of a camera are, roughly, m: a radian counts as the radius."""
    between = a.inv() * b
    return float(np.linalg.norm(between.translation) + 0.25 * between.rotation.magnitude())
