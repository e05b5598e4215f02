"""Figures are returned, never shown, and leave matplotlib's settings alone."""

import subprocess
import sys

import matplotlib as mpl
import numpy as np
import pytest
from IPython.core.formatters import DisplayFormatter
from IPython.core.interactiveshell import InteractiveShell
from matplotlib.figure import Figure

from gvp_lib.errors import InvalidParameterError
from gvp_lib.perception.moments import Blob
from gvp_lib.perception.segmentation import HsvThreshold
from gvp_lib.views import figures
from gvp_lib.views.figures import ThresholdSliders


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


def test_a_ratio_curve_shows_every_view_and_marks_the_chosen_one():
    tilts, ratios = np.arange(-3, 4), np.linspace(0.5, 0.8, 7)
    (ax,) = figures.ratio_curve(tilts, ratios, chosen=2).axes
    *_, curve, mark = ax.lines
    np.testing.assert_array_equal(curve.get_xydata(), np.column_stack([tilts, ratios]))
    np.testing.assert_array_equal(mark.get_xydata(), [[tilts[2], ratios[2]]])


def test_a_ratio_for_each_tilt_is_asked_for():
    with pytest.raises(InvalidParameterError, match=r"one ratio for each tilt.*\(3,\) and \(2,\)"):
        figures.ratio_curve([0, 1, 2], [0.5, 0.6])


# sliders that leave a picture behind


@pytest.fixture
def image() -> np.ndarray:
    rgb = np.full((48, 64, 3), 190, np.uint8)
    rgb[20:30, 20:50] = 200, 20, 30
    return rgb


def shown(sliders: ThresholdSliders, monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """What a notebook's cell would display."""
    displayed: list[object] = []

    class Handle:
        def update(self, what: object) -> None:
            displayed.append(what)

    def display(what: object, display_id: bool = False) -> Handle | None:
        displayed.append(what)
        return Handle() if display_id else None

    monkeypatch.setattr("IPython.display.display", display)
    sliders._ipython_display_()
    return displayed


def test_a_cell_shows_the_sliders_and_an_ordinary_picture_apart(
    image: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    box, figure = shown(ThresholdSliders(image), monkeypatch)
    assert len(box.children) == 5  # type: ignore[attr-defined]
    InteractiveShell.instance()
    data, _ = DisplayFormatter().format(figure)
    assert data["image/png"]
    assert not any("widget" in mime for mime in data)


def test_moving_a_slider_changes_the_threshold_and_replaces_the_picture(
    image: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    sliders = ThresholdSliders(image, HsvThreshold(hue=(342, 18)))
    displayed = shown(sliders, monkeypatch)
    assert sliders.threshold(image).all(), "a gray has hue 0, so the hue alone lets it in"
    displayed[0].children[2].value = (0.4, 1.0)  # type: ignore[attr-defined]
    assert sliders.threshold == HsvThreshold(hue=(342, 18), saturation=(0.4, 1))
    assert sliders.threshold(image).sum() == 300
    assert len(displayed) == 3, "sliders, picture, and the picture once more"


def test_a_range_that_is_none_of_a_thresholds_is_named(image: np.ndarray) -> None:
    with pytest.raises(InvalidParameterError, match="hue, saturation, value and kernel_size; got brightness"):
        ThresholdSliders(image).set(brightness=(0, 1))
