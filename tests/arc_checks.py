"""What holds of arcs, whichever arm traversed them."""

from __future__ import annotations

import numpy as np
import pytest
from eye_in_hand import CAMERA
from numpy.typing import ArrayLike

from gvp_lib.motion.arc import Arc


def check_order(arc: Arc) -> None:
    """What holds of every arc that saw anything."""
    assert (np.diff(arc.angles) > 0).all()
    assert arc.angles[arc.center] == pytest.approx(0, abs=1e-9)
    assert np.isnan(arc.ranges).tolist() == [k == arc.center for k in range(len(arc))]
    assert len(arc) == len(arc.views) == len(arc.ratios) == len(arc.angles)


def check_never_leaps(arc: Arc, goal: ArrayLike, within: float, growth: float = 1.5) -> None:
    """The views show the object that stands at ``goal``, ``within`` so many pixels, and its area never leaps."""
    areas = np.array([view.blob.area for view in arc.views])
    assert (np.abs(np.log(areas[1:] / areas[:-1])) < np.log(growth)).all()
    for view in arc.views:
        shown = CAMERA.project(view.base_from_camera.inv().apply(goal))
        np.testing.assert_allclose(view.blob.centroid, shown, atol=within)
