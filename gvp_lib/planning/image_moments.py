"""The image-moment viewpoint planner: two arcs over the object, and the view that they point to. Thesis 2.3,
Algorithm 3; errata 12 to 15."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.polynomial import Polynomial

from gvp_lib.checks import A_SEGMENTER, check_fields, check_part, checked, lacking
from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arc import Arc, Axis, approach, traverse_arc
from gvp_lib.motion.arm import EyeInHandArm, Outcome
from gvp_lib.motion.sighting import Eye, View
from gvp_lib.perception.segmentation import Segmenter
from gvp_lib.picture import brief
from gvp_lib.planning.attempt import OUT_OF_REACH, Attempt, saw_nothing, with_wrist_turned
from gvp_lib.planning.plan import MIN_VIEWS, Optimum, Plan, Quartic, ViewpointEstimator, given_arcs

__all__ = ["ImageMomentPlanner", "QuarticFit"]

_CHECK_EVERY = 4  # views, between two looks at the estimator's uncertainty
_FIRST_LEG = np.radians(20)  # rad


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
        if arc.axis is None:
            raise InvalidParameterError(f"a quartic goes through the ratios along an arc; {arc!r} lie along none")
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
            segmenter=A_SEGMENTER,
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
        eye = Eye(arm, self.segmenter, keep_images=self.keep_images)
        return with_wrist_turned(eye, self.wrist_retries, lambda: _Run(self, eye, order), saw_nothing)

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
        run = _Run(self, Eye(arm, self.segmenter, keep_images=self.keep_images), self.order)
        run.arcs = arcs
        run.optima = [run.estimate(arcs)]
        return run.finished(run.take_up(run.optima[-1]) or run.align() or run.verdict())


class _Run(Attempt):
    """An attempt by arcs."""

    def __init__(self, planner: ImageMomentPlanner, eye: Eye, order: Literal["minor first", "major first"]) -> None:
        super().__init__(eye, planner.estimator, planner.radius, planner.threshold)
        self.planner, self.order = planner, order

    def go(self) -> Outcome:
        """Algorithm 3."""
        planner, eye = self.planner, self.eye
        first = self.view = eye.look()
        if first is None:
            return Outcome.TARGET_NOT_FOUND
        came = approach(eye, planner.radius, step=planner.step)
        trouble = self.after(came.view, came.motion)
        if came.motion and (came.view or first).blob.fills((eye.intrinsics.height, eye.intrinsics.width)):
            return Outcome.TOO_LARGE
        if trouble is not None:
            return trouble
        axes: tuple[Axis, Axis] = ("y", "x") if self.order == "minor first" else ("x", "y")
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
            if trouble is not None and (last or trouble not in OUT_OF_REACH or not poses):
                return trouble
            if last:
                break
        return self.align() or self.verdict()

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
