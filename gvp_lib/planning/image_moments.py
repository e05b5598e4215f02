"""The image-moment viewpoint planner: two arcs over the object, and the view that they point to. Thesis 2.3,
Algorithm 3; errata 12 to 15."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arc import Arc, Axis, approach, traverse_arc
from gvp_lib.motion.arm import EyeInHandArm, Motion, Outcome
from gvp_lib.motion.primitives import turn
from gvp_lib.motion.sighting import Eye, View, align_with_major_axis, center_on_object
from gvp_lib.perception.segmentation import Segmenter
from gvp_lib.planning.plan import (
    A_SEGMENTER,
    MIN_VIEWS,
    Optimum,
    Plan,
    Quartic,
    ViewpointEstimator,
    brief,
    check_fields,
    check_part,
    given_arcs,
    lacking,
    takes_a_picture,
)

__all__ = ["ImageMomentPlanner", "QuarticFit"]

_CHECK_EVERY = 4  # views, between two looks at the estimator's uncertainty
_FIRST_LEG = np.radians(20)  # rad
_WORST_FIRST = (Outcome.TOO_FEW_VIEWS, Outcome.NO_STATIONARY_POINT, Outcome.ANY_ANGLE)
_OUT_OF_REACH = (Outcome.UNREACHABLE, Outcome.JOINT_LIMIT, Outcome.COLLISION)


# --- Viewpoint Optimizer --------------------------------------------------------------------------------------------


@checked
@dataclass(frozen=True)
class QuarticFit:
    """Thesis's estimator: the stationary point of a quartic through the ratios of the last arc.

    The thesis's "inflection point" is a stationary point, of which a quartic has one or three (errata 14). The middle
    one counts, even where an outer one lies beyond the samples. Where the middle one does, the stationary point within
    the samples that is nearest the center counts; with none, the camera stays at the center, and the outcome says so.

    Parameters
    ----------
    x
        Axis of the polynomial: ``"sample"``, the number of the view, as in the thesis; or ``"angle"``, the angle swept,
        which is right for unequal steps too (errata 15).
    interpolate
        Whether to go between the views, rather than to the one nearest the optimum as in the thesis.
    order
        Order of the polynomial.
    least_range
        Least difference between the ratios of an arc; below it any angle is as good.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> cell = WorkCell(arm="floating", target="cuboid_1x4", seed=1)
    >>> plan = ImageMomentPlanner(cell.segmenter, QuarticFit(x="angle", interpolate=True)).plan(cell.arm)
    >>> plan.optima[-1].quartic is not None
    True
    """

    x: Literal["sample", "angle"] = "sample"
    interpolate: bool = False
    order: int = 4
    least_range: float = 0.012

    def __post_init__(self) -> None:
        check_fields(
            self,
            {},
            x=(lambda x: x in ("sample", "angle"), '"sample", the thesis\'s, or "angle"'),
            order=(lambda n: n >= 2 and n == int(n), "a whole number, 2 or more; the thesis's is 4"),
            least_range=(lambda x: x >= 0, "0 or more"),
        )
        object.__setattr__(self, "order", int(self.order))  # 4.0 is one, too

    def estimate(self, arcs: Sequence[Arc], intrinsics: CameraIntrinsics) -> Optimum:
        """See :class:`ViewpointEstimator`."""
        arc = given_arcs(arcs)[-1]
        if len(arc) < max(MIN_VIEWS, self.order + 1):
            return Optimum.at(arc, arc.center, Outcome.TOO_FEW_VIEWS)
        quartic = self.fit(arc)
        if np.ptp(arc.ratios) < self.least_range:
            return Optimum.at(arc, arc.center, Outcome.ANY_ANGLE, quartic=quartic)
        outcome = Outcome.ALIGNED if len(quartic.stationary) else Outcome.NO_STATIONARY_POINT
        place = quartic.index if self.interpolate else round(quartic.index)
        return Optimum.between(arc, place, outcome, quartic=quartic)

    def fit(self, arc: Arc) -> Quartic:
        """Fit the polynomial to an arc and find its stationary points.

        Parameters
        ----------
        arc
            Arc of at least ``order + 1`` views.
        """
        if len(arc) <= self.order:
            raise InvalidParameterError(f"order {self.order} takes {self.order + 1} views or more; got {arc!r}")
        x = np.arange(len(arc), dtype=float) if self.x == "sample" else arc.angles
        polynomial = Polynomial.fit(x, arc.ratios, self.order)
        roots = polynomial.deriv().roots()
        real = np.sort(roots.real[np.abs(roots.imag) < 1e-9 * max(1.0, float(np.ptp(x)))])
        inside = real[(real >= x[0]) & (real <= x[-1])]
        center, middle = float(x[arc.center]), real[len(real) // 2] if len(real) % 2 else np.nan
        if x[0] <= middle <= x[-1]:
            chosen = float(middle)
        elif len(inside):
            chosen = float(inside[np.argmin(np.abs(inside - center))])
        else:
            chosen = center
        index = float(np.interp(chosen, x, np.arange(len(x))))
        return Quartic(x, polynomial, inside, chosen, index)


# --- Algorithm 3 ----------------------------------------------------------------------------------------------------


@checked(own=True)
@dataclass(frozen=True)
class ImageMomentPlanner:
    """Planner of an object's canonical view, with one RGB camera of which only the lens is calibrated.

    It centers the object, comes to the radius, turns the camera's y axis along the object's major axis, traverses an
    arc, goes where the estimator says, and does the same along the other axis. At the end x lies on the minor axis and
    y on the major one.

    Parameters
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
        Order of the arcs: ``"minor first"`` moves along the major axis first and so turns about the minor one
        (errata 12); ``"major first"`` does the other way around.
    threshold
        Largest offset after a centering, px.
    until
        Standard deviation of the direction of view at which the traversal may stop, rad, for an estimator that states
        its uncertainty; None traverses both arcs in full. The first arc then is a short one, traversed again, in full,
        only where the second leaves more doubt than that.
    keep_images
        Whether the trace keeps the pictures (0.9 MB each).
    wrist_retries
        Turns of the wrist with which to begin again, rad, one after the other, where the arm meets its limits before it
        has traversed anything. The thesis's planner gives up instead.

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
    wrist_retries: tuple[float, ...] = ()

    __repr__ = brief

    def __post_init__(self) -> None:
        check_fields(
            self,
            {"radius": "in m", "step": "in m", "threshold": "in px"},
            segmenter=(takes_a_picture, A_SEGMENTER),
            estimator=(
                lambda part: not lacking(part, ViewpointEstimator),
                "an object with a method estimate(arcs, intrinsics), as QuarticFit() and SilhouetteFit() have",
            ),
            max_angle=(lambda x: 0 < x <= np.pi, "in radians, positive and at most pi (for degrees: np.radians)"),
            order=(lambda order: order in ("minor first", "major first"), '"minor first" or "major first"'),
            until=(lambda x: x is None or 0 < x < np.inf, "positive and finite, in rad, or None"),
            wrist_retries=(lambda angles: np.isfinite(angles).all(), "turns of the wrist, in rad"),
        )

    def plan(self, arm: EyeInHandArm) -> Plan:
        """Move the arm to the best view of what it looks at.

        Parameters
        ----------
        arm
            Arm with its camera on the object.
        """
        return self._plan(arm, self.order)

    def _plan(self, arm: EyeInHandArm, order: Literal["minor first", "major first"]) -> Plan:
        check_part("an arm", arm, EyeInHandArm, "cell.arm")
        eye, start = Eye(arm, self.segmenter, keep_images=self.keep_images), arm.joints
        run = _Run(self, eye)
        outcome = run.go(order)
        for angle in self.wrist_retries:
            if run.arcs or outcome not in _OUT_OF_REACH:
                break
            arm.move_joints(start)
            eye.expect(None)
            if arm.move_camera(turn([0.0, 0.0, angle])):
                run = _Run(self, eye)
                outcome = run.go(order)
        return run.finished(outcome)

    def conclude(self, arm: EyeInHandArm, arcs: Sequence[Arc]) -> Plan:
        """Move the arm to the best view by arcs that it has traversed already: another estimator on the same views.

        Parameters
        ----------
        arm
            Arm that traversed the arcs.
        arcs
            Arcs of another plan, at least one, each with views.
        """
        arcs = given_arcs(arcs)
        check_part("an arm", arm, EyeInHandArm, "cell.arm")
        run = _Run(self, Eye(arm, self.segmenter, keep_images=self.keep_images))
        run.arcs = arcs
        run.optima = [run.estimate(arcs)]
        return run.finished(run.take_up(run.optima[-1]) or run.align() or run.verdict())


class _Run:
    """One plan in the making: what there is of it when it ends early."""

    def __init__(self, planner: ImageMomentPlanner, eye: Eye) -> None:
        self.planner, self.eye = planner, eye
        self.arcs: list[Arc] = []
        self.optima: list[Optimum] = []
        self.view: View | None = None
        self.aligned = False  # whether the pose that was taken up has the right roll by itself

    def finished(self, outcome: Outcome) -> Plan:
        return Plan(outcome, tuple(self.arcs), tuple(self.optima), self.view, self.eye.looks)

    def go(self, order: Literal["minor first", "major first"]) -> Outcome:
        """Algorithm 3."""
        planner, eye = self.planner, self.eye
        first = self.view = eye.look()
        if first is None:
            return Outcome.TARGET_NOT_FOUND
        came = approach(eye, planner.radius, step=planner.step)
        trouble = self._after(came.view, came.motion)
        if came.motion and (came.view or first).blob.fills((eye.intrinsics.height, eye.intrinsics.width)):
            return Outcome.TOO_LARGE
        if trouble is not None:
            return trouble
        axes: tuple[Axis, Axis] = ("y", "x") if order == "minor first" else ("x", "y")
        legs = [(axis, planner.max_angle) for axis in axes]
        if planner.until is not None:
            # A short first arc, since what is still uncertain after it is mostly what only the second tells.
            legs = [(axes[0], min(_FIRST_LEG, planner.max_angle)), legs[1], legs[0]]
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
        return self.align() or self.verdict()

    def align(self) -> Outcome | None:
        """Turn the wrist along the major axis where there is one; the last optimum may have done so."""
        if self.aligned:
            return None
        aligned = align_with_major_axis(self.eye, view=self.view)
        return self._after(aligned.view, aligned.motion)

    def _sweep(self, axis: Axis, max_angle: float) -> Outcome | None:
        """Traverse an arc and estimate; the second and third arcs end once the estimator is certain."""
        planner = self.planner

        def enough(views: Sequence[View]) -> bool:
            if planner.until is None or not self.arcs or len(views) % _CHECK_EVERY:
                return False
            here = Arc(axis, tuple(views), 0, (Outcome.ENOUGH, Outcome.ENOUGH), np.full(len(views), np.nan))
            return self.estimate([*self.arcs, here]).uncertainty < planner.until

        arc = traverse_arc(
            self.eye,
            axis,
            radius=planner.radius,
            step=planner.step,
            max_angle=max_angle,
            threshold=planner.threshold,
            enough=enough,
        )
        if not arc.views:
            self.view = None
            return Outcome.TARGET_LOST
        self.arcs.append(arc)
        self.optima.append(self.estimate(self.arcs))
        return None

    def estimate(self, arcs: Sequence[Arc]) -> Optimum:
        """Answer of the estimator, checked."""
        optimum = self.planner.estimator.estimate(arcs, self.eye.intrinsics)
        name = f"{type(self.planner.estimator).__name__}.estimate"
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
            depth = optimum.distance if np.isfinite(optimum.distance) else self.planner.radius
        else:
            assert optimum.joints is not None
            motion = self._to_joints(optimum.joints)
        if not motion:
            self.view = self.eye.look()
            return motion.reason
        centered = center_on_object(self.eye, depth=depth, threshold=self.planner.threshold)
        trouble = self._after(centered.view, centered.motion)
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

        Where none can, the camera ends at the visited view whose direction of view is nearest to the wanted one.
        """
        arm = self.eye.arm
        views = [view for arc in self.arcs for view in arc.views]

        def nearest(pose: RigidTransform) -> View:  # a radian counts as the radius
            between = [view.base_from_camera.inv() * pose for view in views]
            apart = [np.linalg.norm(b.translation) + self.planner.radius * b.rotation.magnitude() for b in between]
            return views[int(np.argmin(apart))]

        motion = arm.move_camera(arm.camera_pose().inv() * poses[0])
        for pose in poses:
            if not motion and arm.move_joints(nearest(pose).joints):
                motion = arm.move_camera(arm.camera_pose().inv() * pose)
        self.eye.expect(None)  # from the best viewpoint it may look like in no view so far
        if not motion:
            looked = poses[0].rotation.as_matrix()[:, 2]
            best = max(views, key=lambda view: float(view.line_of_sight @ looked))
            arm.move_joints(best.joints)
            self.eye.expect(best)
        return motion

    def _after(self, view: View | None, motion: Motion) -> Outcome | None:
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
