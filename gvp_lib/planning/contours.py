"""A simple solid whose outline is the one seen, in all views at once, though something hides a part of it.

Where :class:`gvp_lib.planning.SilhouetteFit` compares six moments a view, all of which a missing piece spoils, here each
point of each outline is held against the outline of the solid. Points that no solid explains come to count for nothing,
since the losses are robust ones. And where the picture just outside a point has another color than the table, something
may stand in front: there a solid may reach beyond the point at no cost. Views that the image's border cuts serve, too.

The search begins at the solids that the moments of eight views suggest. Where each view stood against what the arm
believes is estimated along with the solid, and eliminated from its equations (a Schur complement).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.sighting import View
from gvp_lib.planning.silhouette import (
    Array,
    Model,
    Observations,
    SilhouetteFit,
    Solids,
    Solution,
    Stack,
    first_guesses,
    guesses_with_top,
    search,
)
from gvp_lib.planning.solids import FittedSolid, outline_edges

__all__ = ["ContourFit"]

_FEW = 8  # views, in which starts are tried
_FOREIGN = 25.0, 15.0  # CIELAB: from the table's color; and within which colors are one
_LIGHTNESS = 1 / 1.5  # how much less it says than hue and chroma, for it changes with the light
_QUARTILE = 0.455  # median of chi squared with one degree of freedom

Loss = tuple[float, Literal["cauchy", "geman-mcclure"]]
"""Scale in standard deviations, and which robust loss."""

_COARSE: tuple[Loss, ...] = ((20.0, "cauchy"), (6.0, "cauchy"), (3.0, "geman-mcclure"))
