"""Figures are returned, never shown, and leave matplotlib's settings alone."""

import subprocess
import sys

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

from gvp_lib.errors import InvalidParameterError
from gvp_lib.perception.moments import Blob
from gvp_lib.views import figures


@pytest.fixture
def brick():
    rgb = np.full((60, 80, 3), 180, np.uint8)
    rgb[20:30, 30:60] = 200, 30, 30
    return rgb, rgb[..., 1] < 100


def test_every_figure_is_a_figure_and_settings_stay(brick):
    rgb, mask = brick
    blob = Blob.from_mask(mask)
    before = dict(mpl.rcParams)
    made = [
        figures.show_images([rgb, mask], ["image", "mask"]),
        figures.draw_blob(rgb, blob),
        figures.draw_blob(rgb, None),
        figures.pipeline(rgb, mask, blob),
        figures.hsv_histograms(rgb, hue=(345, 15), value=(0.2, 1)),
    ]
    assert all(isinstance(figure, Figure) for figure in made)
    assert dict(mpl.rcParams) == before


def test_a_blob_is_drawn_along_its_axes(brick):
    rgb, mask = brick
    (ax,) = figures.draw_blob(rgb, Blob.from_mask(mask)).axes
    (major,) = [line for line in ax.lines if line.get_label() == "major"]
    assert np.ptp(major.get_xdata()) == pytest.approx(Blob.from_mask(mask).axis_major_length)
    assert np.ptp(major.get_ydata()) == pytest.approx(0, abs=1e-9)


def test_a_hue_range_that_wraps_through_red_is_shaded_on_both_sides(brick):
    ax = figures.hsv_histograms(brick[0], hue=(345, 15)).axes[0]
    shaded = [p for p in ax.patches if p.get_alpha()]
    assert sorted(p.get_x() for p in shaded) == [0, 345]


def test_a_figure_shows_itself_in_a_notebook_without_pyplot_and_always_with_the_same_bytes(brick):
    png = figures.show_images([brick[0]])._repr_png_()
    assert png.startswith(b"\x89PNG")
    assert png == figures.show_images([brick[0]])._repr_png_()
    code = "import sys, gvp_lib.views.figures; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_images_and_titles_must_match(brick):
    with pytest.raises(InvalidParameterError, match="1 images, 2 titles"):
        figures.show_images([brick[0]], ["a", "b"])
    with pytest.raises(InvalidParameterError, match="differ in size"):
        figures.pipeline(brick[0], np.zeros((3, 3), bool), None)
