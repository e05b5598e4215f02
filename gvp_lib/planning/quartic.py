"""The thesis's estimator: a stationary point of the ratios along an arc. Thesis 2.3, Viewpoint Optimizer, Algorithm 3;
errata 13 to 15."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arc import Arc
from gvp_lib.planning.plan import MIN_VIEWS, Finding, Optimum

__all__ = ["Quartic", "QuarticFit"]


@dataclass(frozen=True, eq=False)
class Quartic:
    """Polynomial fitted to the ratios of one arc.

    Attributes
    ----------
    x
        Places of the samples on the polynomial's axis, shape (n,): their numbers, or angles in rad.
    polynomial
        The polynomial, R(x).
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
        Order of the polynomial.
    least_range
        Least difference between the ratios of an arc; below it the arc is featureless.
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
