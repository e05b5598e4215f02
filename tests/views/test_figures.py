"""Figures are returned, never shown, and leave matplotlib's settings alone."""

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

from gvp_lib.errors import InvalidParameterError
from gvp_lib.perception.blobs import Blob
from gvp_lib.perception.segmentation import HsvThreshold
from gvp_lib.views import figures
from gvp_lib.views.figures import ThresholdSliders

RGB = np.full((60, 80, 3), 180, np.uint8)
RGB[20:30, 30:60] = 200, 30, 30
MASK = RGB[..., 1] < 100
BLOB = Blob.from_mask(MASK)


def test_every_figure_shows_itself_always_with_the_same_bytes_and_settings_stay() -> None:
    before = dict(mpl.rcParams)
    made = [
        figures.show_images([RGB], ["image"]),
        figures.show_images([RGB], ["image"]),
        figures.draw_blob(RGB, None),
        figures.pipeline(RGB, MASK, BLOB),
        figures.gallery([RGB, RGB], [MASK, MASK], [BLOB, None], ["a", "b"]),
        figures.hsv_histograms(RGB, hue=(345, 15), value=(0.2, 1)),
    ]
    pngs = [figure._repr_png_() for figure in made]
    assert all(png.startswith(b"\x89PNG") for png in pngs)
    assert pngs[0] == pngs[1] != pngs[2]
    assert dict(mpl.rcParams) == before


def test_a_blob_is_drawn_along_its_axes() -> None:
    (ax,) = figures.draw_blob(RGB, BLOB).axes
    (major,) = [line for line in ax.lines if line.get_label() == "major"]
    np.testing.assert_allclose(np.ptp(major.get_xydata(), axis=0), (BLOB.axis_major_length, 0), atol=1e-9)


def test_a_hue_range_that_wraps_through_red_is_shaded_on_both_sides() -> None:
    ax = figures.hsv_histograms(RGB, hue=(345, 15)).axes[0]
    assert sorted(p.get_x() for p in ax.patches if p.get_alpha()) == [0, 345]


def test_a_ratio_curve_shows_every_view_and_marks_the_chosen_one() -> None:
    tilts, ratios = np.arange(-3, 4), np.linspace(0.5, 0.8, 7)
    (ax,) = figures.ratio_curve(tilts, ratios, chosen=2).axes
    *_, curve, mark = ax.lines
    np.testing.assert_array_equal(curve.get_xydata(), np.column_stack([tilts, ratios]))
    np.testing.assert_array_equal(mark.get_xydata(), [[tilts[2], ratios[2]]])


@pytest.mark.parametrize(
    ("misuse", "said"),
    [
        (lambda: figures.show_images([RGB], ["a", "b"]), "1 images, 2 titles"),
        (lambda: figures.pipeline(RGB, MASK[:3], None), "differ in size"),
        (lambda: figures.gallery([RGB], [MASK], []), "1 images, 1 masks, 0 blobs, 0 titles"),
        (lambda: figures.ratio_curve([0, 1, 2], [0.5, 0.6]), r"one ratio for each tilt.*\(3,\) and \(2,\)"),
        (lambda: ThresholdSliders(RGB).set(brightness=(0, 1)), "hue, saturation, value and kernel_size; got bright"),
    ],
)
def test_misuse_is_answered_with_what_would_work(misuse, said) -> None:
    with pytest.raises(InvalidParameterError, match=said):
        misuse()


def test_a_cell_shows_sliders_and_an_ordinary_picture_that_each_move_replaces(monkeypatch) -> None:
    displayed: list = []

    class Handle:
        update = displayed.append

    monkeypatch.setattr("IPython.display.display", lambda what, **_: (displayed.append(what), Handle())[1])
    sliders = ThresholdSliders(RGB, HsvThreshold(hue=(342, 18)))
    sliders._ipython_display_()
    box, picture = displayed
    assert len(box.children) == 5
    assert isinstance(picture, Figure), "no widget, so that a stored notebook keeps it"
    assert sliders.threshold(RGB).all(), "a gray has hue 0, so the hue alone lets it in"
    box.children[2].value = (0.4, 1.0)
    assert sliders.threshold == HsvThreshold(hue=(342, 18), saturation=(0.4, 1))
    assert sliders.threshold(RGB).sum() == MASK.sum()
    assert len(displayed) == 3, "sliders, picture, and the picture once more"
