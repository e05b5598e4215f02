"""When to close the fingers: the thesis's threshold on the range sensor, or a depth chosen for the object's size.

Thesis 2.3, Grasp Completion. A rule sees every reading of the descent and says how far the hand has yet to go.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arm import Hand
from gvp_lib.planning.plan import Plan
from gvp_lib.planning.silhouette import FittedSolid

__all__ = ["ClosingRule", "RangeThreshold", "Reading", "SizedDepth"]

_ENOUGH = 8  # readings
_UNSEEN = np.inf  # m to go, for a rule that cannot tell


@dataclass(frozen=True, eq=False)
class Reading:
    """One reading of the range sensor on the way down.

    Attributes
    ----------
    base_from_camera
        The camera's pose as the arm believes it.
    distance
        What the sensor said, m; ``inf`` where it saw nothing.
    landed
        Whether a finger touches something, so that the hand goes no further.
    """

    base_from_camera: RigidTransform
    distance: float
    landed: bool = False


@runtime_checkable
class ClosingRule(Protocol):
    """Decides where the fingers close."""

    def remaining(self, readings: Sequence[Reading], hand: Hand) -> float:
        """How far the hand has yet to go along the lens, m: 0 or less to close now, ``inf`` where only a later reading
        will tell.

        Parameters
        ----------
        readings
            All readings of this descent, the last one taken where the hand is now.
        hand
            Where the sensor and the fingertips are.
        """
        ...


@dataclass(frozen=True)
class RangeThreshold:
    """Closes at the first reading below a threshold (thesis 2.3: 10 cm). One false reading suffices to close too early.

    Attributes
    ----------
    distance
        Below which to close, m.
    """

    distance: float = 0.10

    def __post_init__(self) -> None:
        if not 0 < self.distance < np.inf:
            raise InvalidParameterError(f"a range threshold is positive; got {self.distance}")

    def remaining(self, readings: Sequence[Reading], hand: Hand) -> float:
        """See :class:`ClosingRule`."""
        return 0.0 if readings[-1].distance < self.distance else _UNSEEN


@dataclass(frozen=True)
class SizedDepth:
    """Closes where the fingertips are two thirds down the object's height, or at their reach.

    How far the surface is, two witnesses tell: the solid that was fitted on the way, and the range sensor. Its readings
    are all carried along to where the hand is now, and their median is taken, so that dropouts, spikes and scatter
    hardly count; what all readings share, such as a bias, is left, and the witnesses are weighted accordingly. A sensor
    that sees more than ``gate`` past the solid's surface looks past the object, and is not heard.

    Attributes
    ----------
    solid
        What :class:`SilhouetteFit` made of the object; None leaves the sensor alone, and ``unknown_depth``.
    reach
        Deepest that the fingertips go below the surface, m.
    share
        Of the object's height that the fingertips go down: deep enough to hold where the surface is less near than
        thought, and off what the object stands on where it is nearer.
    unknown_depth
        Where there is no solid to tell the height, m: as deep as the thesis's 10 cm would have the fingertips.
    solid_sd, sensor_sd
        Standard deviations of the solid's surface and of what the sensor's readings share, m.
    gate
        How far beyond the solid's surface the sensor may see, m.
    """

    solid: FittedSolid | None = None
    reach: float = 0.040
    share: float = 0.65
    unknown_depth: float = 0.020
    solid_sd: float = 0.006
    sensor_sd: float = 0.003
    gate: float = 0.025

    def __post_init__(self) -> None:
        for name in ("reach", "share", "unknown_depth", "solid_sd", "sensor_sd", "gate"):
            if not 0 < getattr(self, name) < np.inf:
                raise InvalidParameterError(f"SizedDepth.{name} is positive; got {getattr(self, name)}")

    @classmethod
    def of(cls, plan: Plan) -> SizedDepth:
        """For the last solid that a plan's estimator found; without one that explains what was seen, for an object of
        unknown height."""
        solids = [optimum.detail for optimum in plan.optima if isinstance(optimum.detail, FittedSolid)]
        return cls(solids[-1] if solids and solids[-1].explains else None)

    @property
    def depth(self) -> float:
        """Of the fingertips below the surface, m."""
        return self.unknown_depth if self.solid is None else min(self.reach, self.share * self.solid.height)

    def remaining(self, readings: Sequence[Reading], hand: Hand) -> float:
        """See :class:`ClosingRule`."""
        if readings[-1].landed:
            return 0.0
        depth = min(self.depth, hand.tips - hand.palm - 0.002)
        return self.surface(readings, hand) + depth - hand.tips

    def surface(self, readings: Sequence[Reading], hand: Hand) -> float:
        """How far ahead of the camera the object's surface is, m; ``inf`` before there is enough to tell."""
        here = readings[-1].base_from_camera
        axis = here.rotation.as_matrix()[:, 2]
        seen = np.array([
            hand.sensor + reading.distance - axis @ (here.translation - reading.base_from_camera.translation)
            for reading in readings
            if np.isfinite(reading.distance)
        ])  # fmt: skip
        told = np.inf if self.solid is None else self.solid.surface_from(here)
        if len(seen) < _ENOUGH:  # the median of a few may be a spike
            return told
        if self.solid is None:
            return float(np.median(seen))
        scatter = 1.25 * 1.48 * float(np.median(np.abs(seen - np.median(seen)))) / np.sqrt(len(seen))
        sensed = float(np.median(seen))
        if sensed - told > self.gate:
            return told
        weight = self.solid_sd**2 / (self.solid_sd**2 + self.sensor_sd**2 + scatter**2)
        return told + weight * (sensed - told)
