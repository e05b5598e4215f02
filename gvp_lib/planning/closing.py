"""Where the fingers close on their way down: at a threshold on the range sensor, at a depth chosen for the object's
size, or as deep as a grip says. Thesis 2.3, Grasp Completion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.checks import check_fields, checked
from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arm import Hand
from gvp_lib.picture import brief
from gvp_lib.planning.grips import REACH, SHARE, Grip
from gvp_lib.planning.plan import Plan
from gvp_lib.planning.solids import FittedSolid

__all__ = ["ClosingRule", "RangeThreshold", "Reading", "SizedDepth"]

ENOUGH = 8  # readings, of which the median is trusted: that of a few may be a spike
CLEARANCE = 0.002  # m, between the palm and the surface, and between the fingertips and what they may not touch
_LOWER = 0.025  # m, by which what the sensor sees may lie below the hull and yet belong to the object
_DEEPEST = 0.6  # of a grip's depth, which goes down two thirds of the hull: by how much more a hand may go


@dataclass(frozen=True, eq=False)
class Reading:
    """One reading of the range sensor on the way down.

    Parameters
    ----------
    base_from_camera
        Camera's pose, as the arm believes.
    distance
        Sensor's reading, m; ``inf`` where it saw nothing.
    landed
        Whether a finger touches something, so that the hand goes no further.
    """

    base_from_camera: RigidTransform
    distance: float
    landed: bool = False

    def __repr__(self) -> str:
        return f"Reading({self.distance:.3f} m{', landed' if self.landed else ''})"


@runtime_checkable
class ClosingRule(Protocol):
    """Rule that decides where the fingers close."""

    def remaining(self, readings: Sequence[Reading], hand: Hand) -> float:
        """Distance that the hand has yet to go along the lens, m.

        0 or less closes the fingers; ``inf`` means that only a later reading will tell.

        Parameters
        ----------
        readings
            All readings of this descent, the last one from where the hand is now.
        hand
            Places of the hand's parts.
        """
        ...


def _last(readings: Sequence[Reading]) -> Reading:
    if not readings:
        raise InvalidParameterError("a closing rule is given one reading or more, the last from where the hand is")
    return readings[-1]


@checked
@dataclass(frozen=True)
class RangeThreshold:
    """Closing rule of the thesis: close at the first reading below a distance (2.3: 10 cm).

    One false reading is enough to close too early.

    Parameters
    ----------
    distance
        Distance by the sensor, m.

    Examples
    --------
    >>> from gvp_lib import GraspExecutor, HsvThreshold
    >>> from gvp_lib.planning import RangeThreshold
    >>> GraspExecutor(HsvThreshold(), closing=RangeThreshold(0.08))
    GraspExecutor(segmenter=HsvThreshold, closing=RangeThreshold)
    """

    distance: float = 0.10

    def __post_init__(self) -> None:
        check_fields(self, {"distance": "in m"})

    def remaining(self, readings: Sequence[Reading], hand: Hand) -> float:
        """See :class:`ClosingRule`."""
        return 0.0 if _last(readings).distance < self.distance else np.inf


@checked
@dataclass(frozen=True)
class SizedDepth:
    """Closing rule of ours: close with the fingertips two thirds down the object's height, or at their reach.

    Two sources tell how far the surface is, weighted by their variances: the solid fitted on the way, and the median of
    the range sensor's readings, all carried along to where the hand is now, so that dropouts, spikes, and scatter
    hardly count. A sensor that sees more than ``gate`` past the solid's surface looks past the object and is ignored.

    Parameters
    ----------
    solid
        Solid fitted to the object; None leaves only the sensor, and ``unknown_depth``.
    reach
        Largest depth of the fingertips below the surface, m.
    share
        Fraction of the object's height that the fingertips go down: enough to hold, and to stay off what it stands on,
        where the surface is somewhat farther or nearer than estimated.
    unknown_depth
        Depth where no solid tells the height, m: that of the fingertips at the thesis's 10 cm.
    solid_sd, sensor_sd
        Standard deviations of the solid's surface, and of the error that the sensor's readings share, m.
    gate
        Largest distance that the sensor may see beyond the solid's surface, m.

    Examples
    --------
    >>> SizedDepth().depth, SizedDepth().solid
    (0.02, None)
    """

    solid: FittedSolid | None = None
    reach: float = REACH
    share: float = SHARE
    unknown_depth: float = 0.020
    solid_sd: float = 0.006
    sensor_sd: float = 0.003
    gate: float = 0.025

    __repr__ = brief

    def __post_init__(self) -> None:
        lengths = ("reach", "unknown_depth", "solid_sd", "sensor_sd", "gate")
        check_fields(self, {"share": "of the height", **dict.fromkeys(lengths, "in m")})

    @classmethod
    def of(cls, plan: Plan) -> SizedDepth:
        """Rule for the last solid of a plan, if it explains what was seen; else for an object of unknown height.

        Parameters
        ----------
        plan
            Finished plan, with or without a solid.
        """
        return cls(plan.solid if plan.solid is not None and plan.solid.explains else None)

    @property
    def depth(self) -> float:
        """Depth of the fingertips below the surface, m."""
        return self.unknown_depth if self.solid is None else min(self.reach, self.share * self.solid.height)

    def remaining(self, readings: Sequence[Reading], hand: Hand) -> float:
        """See :class:`ClosingRule`."""
        if _last(readings).landed:
            return 0.0
        depth = min(self.depth, hand.tips - hand.palm - CLEARANCE)
        return self.surface(readings, hand) + depth - hand.tips

    def surface(self, readings: Sequence[Reading], hand: Hand) -> float:
        """Distance to the object's surface ahead of the camera, m; ``inf`` before there is enough to tell.

        Parameters
        ----------
        readings, hand
            As in :meth:`ClosingRule.remaining`.
        """
        here, seen = _last(readings).base_from_camera, _seen(readings, hand)
        fitted = np.inf if self.solid is None else self.solid.surface_from(here)
        if len(seen) < ENOUGH:
            return fitted
        sensed = float(np.median(seen))
        if self.solid is None:
            return sensed
        if sensed - fitted > self.gate:
            return fitted
        scatter = 1.25 * 1.48 * float(np.median(np.abs(seen - sensed))) / np.sqrt(len(seen))
        weight = self.solid_sd**2 / (self.solid_sd**2 + self.sensor_sd**2 + scatter**2)
        return fitted + weight * (sensed - fitted)


@dataclass(frozen=True)
class AtGrip:
    """Closing rule of a grip: the fingertips as deep as it says below the hull, or below what the sensor sees there, if
    that lies a little deeper: no silhouette tells how far down a hollow or a ridge between two edges is.
    """

    grip: Grip

    def remaining(self, readings: Sequence[Reading], hand: Hand) -> float:
        """See :class:`ClosingRule`."""
        here = _last(readings)
        if here.landed:
            return 0.0
        surface = _ahead(here, self.grip.center + 0.5 * self.grip.depth * self.grip.look)
        seen = _seen(readings, hand)
        lower = float(np.median(seen)) - surface if len(seen) >= ENOUGH else 0.0
        lower = min(lower, _DEEPEST * self.grip.depth) if 0 < lower < _LOWER else 0.0
        return surface + self.grip.depth + lower - hand.tips


def _ahead(reading: Reading, point: NDArray[np.float64]) -> float:
    """How far ahead of the camera a point lies, along its optical axis, m."""
    pose = reading.base_from_camera
    return float(pose.rotation.as_matrix()[:, 2] @ (point - pose.translation))


def _seen(readings: Sequence[Reading], hand: Hand) -> NDArray[np.float64]:
    """Distances to what the sensor saw, along the optical axis of the last reading and from there, m."""
    here = _last(readings).base_from_camera
    axis = here.rotation.as_matrix()[:, 2]
    return np.array([
        hand.sensor + reading.distance - axis @ (here.translation - reading.base_from_camera.translation)
        for reading in readings
        if np.isfinite(reading.distance)
    ])  # fmt: skip
