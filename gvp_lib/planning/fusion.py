"""Several looks at an object that stands still, put together to one normal. Beyond the thesis."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["fused"]

_PULL_SD = 0.3  # of the pull before any look: 0.05 is usual, and 0.6 in light that a network has not learned from
_MOST_PULL = 0.9  # at 1 a policy says no tilt wherever it looks from, and nothing is to be had from it


def fused(
    normals: NDArray[np.float64], axes: NDArray[np.float64], sigmas: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """The normal by n looks together, shape (3,), not of unit length, and its standard deviation, rad.

    A look from ``axis`` says ``normal + pull * (axis - normal)``, with one pull for all: what was said is a line over
    the axes, fitted with weights ``1 / sigma**2`` and a prior for its slope, the pull.

    ``normals`` and the reversed optical ``axes`` are unit vectors, shape (n, 3); ``sigmas`` (n,), rad.
    """
    weights = (sigmas.min() / sigmas) ** 2
    variance = sigmas.min() ** 2 / weights.sum()  # of the weighted mean, rad^2
    weights /= weights.sum()
    said, axis = weights @ normals, weights @ axes
    spread = weights @ ((axes - axis) ** 2).sum(axis=1) + variance / _PULL_SD**2
    pull = min(weights @ ((axes - axis) * (normals - said)).sum(axis=1) / spread, _MOST_PULL)
    offset = (said - axis) / (1 - pull)
    variance *= 1 + offset @ offset / spread
    return axis + offset, float(np.sqrt(variance)) / (1 - pull)
