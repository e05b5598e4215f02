import numpy as np
import pytest

from gvp_lib.errors import InvalidParameterError
from gvp_lib.views.curves import ratio_curve


def test_a_ratio_curve_shows_every_view_and_marks_the_chosen_one():
    tilts, ratios = np.arange(-3, 4), np.linspace(0.5, 0.8, 7)
    (ax,) = ratio_curve(tilts, ratios, chosen=2).axes
    *_, curve, mark = ax.lines
    np.testing.assert_array_equal(curve.get_xydata(), np.column_stack([tilts, ratios]))
    np.testing.assert_array_equal(mark.get_xydata(), [[tilts[2], ratios[2]]])


def test_a_ratio_for_each_tilt_is_asked_for():
    with pytest.raises(InvalidParameterError, match=r"one ratio for each tilt.*\(3,\) and \(2,\)"):
        ratio_curve([0, 1, 2], [0.5, 0.6])
