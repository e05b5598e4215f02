"""Where along the traversed arcs is the best viewpoint? What an estimator is, and the thesis's. Thesis 2.3, Viewpoint
Optimizer, Algorithm 3; errata 13 to 15."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from numbers import Integral
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arc import Arc

__all__ = ["Finding", "Optimum", "Quartic", "QuarticFit", "ViewpointEstimator", "estimated"]

MIN_VIEWS = 5
"""A quartic has five coefficients, so fewer views determine none."""


class Finding(Enum):
    """What an estimator found."""

    OPTIMUM = "optimum"
    NO_STATIONARY_POINT = "no stationary point"  # the best viewpoint may lie beyond the arc
    FEATURELESS = "featureless"  # the views look alike: any angle along the arc is right
    TOO_FEW_VIEWS = "too few views"


@dataclass(frozen=True, eq=False)
class Optimum:
    """Where an estimator would have the camera go: joint angles, or poses, of which the first that can be reached.

    Attributes
    ----------
    finding
        What was found.
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
        The estimator's own findings, for a figure.
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
    """Finds the best viewpoint in what was seen. Ten lines are enough for one of your own."""

    def estimate(self, arcs: Sequence[Arc], intrinsics: CameraIntrinsics) -> Optimum:
        """Where to go.

        Parameters
        ----------
        arcs
            The arcs traversed so far in this plan, none of them empty. The last one is what the arm stands in.
        intrinsics
            The lens as the arm states it.
        """
        ...


def estimated(estimator: ViewpointEstimator, arcs: Sequence[Arc], intrinsics: CameraIntrinsics) -> Optimum:
    """What an estimator says, checked.

    Raises
    ------
    InvalidParameterError
        It is no :class:`Optimum`, or one without joints and poses.
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


@dataclass(frozen=True, eq=False)
class Quartic:
    """The polynomial fitted to the ratios of one arc.

    Attributes
    ----------
    x
        Where the samples lie on the polynomial's axis, shape (n,): their numbers, or angles in rad.
    polynomial
        R(x).
    stationary
        Its real stationary points within the samples, ascending, shape (0 … 3,), in units of x.
    chosen
        The one chosen, in units of x; the center's where there is none.
    index
        The same as a fractional index into the arc's views.
    """

    x: NDArray[np.float64]
    polynomial: Polynomial
    stationary: NDArray[np.float64]
    chosen: float
    index: float


@dataclass(frozen=True)
class QuarticFit:
    """The thesis's estimator: a fourth-order polynomial through the ratios of the last arc, and its stationary point.

    The thesis's "inflection point" is a stationary point, of which a quartic has one or three (errata 14). The middle
    one counts, even where an outer one lies beyond the samples; where it does so itself, the one within the samples
    that is nearest the center; with none, the camera stays at the center and says so.

    Attributes
    ----------
    x
        ``"sample"``: the number of the view, as in the thesis; ``"angle"``: the angle swept, which is right for unequal
        steps too (errata 15).
    interpolate
        Go between the views, rather than to the one nearest the optimum as in the thesis.
    order
        Of the polynomial.
    least_range
        Where all ratios lie within this of each other, the arc is featureless.
    """

    x: Literal["sample", "angle"] = "sample"
    interpolate: bool = False
    order: int = 4
    least_range: float = 0.012

    def __post_init__(self) -> None:
        if self.x not in ("sample", "angle"):
            raise InvalidParameterError(f'the x axis is "sample", the thesis\'s, or "angle"; got {self.x!r}')
        if self.order < 2 or self.order != int(self.order) or not self.least_range >= 0:
            raise InvalidParameterError(
                f"order is 2 or more, the thesis's is 4, and least_range not negative; got {self.order}, "
                f"{self.least_range}"
            )

    def estimate(self, arcs: Sequence[Arc], intrinsics: CameraIntrinsics) -> Optimum:
        """The stationary point of the last arc's ratios. See :class:`ViewpointEstimator`."""
        arc = arcs[-1]
        if len(arc) < max(MIN_VIEWS, self.order + 1):
            return Optimum.at(arc, arc.center, Finding.TOO_FEW_VIEWS)
        quartic = self.fit(arc)
        if np.ptp(arc.ratios) < self.least_range:
            return Optimum.at(arc, arc.center, Finding.FEATURELESS, quartic)
        finding = Finding.OPTIMUM if len(quartic.stationary) else Finding.NO_STATIONARY_POINT
        place = quartic.index if self.interpolate else round(quartic.index)
        return Optimum.between(arc, place, finding, quartic)

    def fit(self, arc: Arc) -> Quartic:
        """Fit the polynomial to an arc of at least ``order + 1`` views, and find its stationary points."""
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
