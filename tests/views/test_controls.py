"""Sliders that leave a picture behind."""

import numpy as np
import pytest
from IPython.core.formatters import DisplayFormatter
from IPython.core.interactiveshell import InteractiveShell

from gvp_lib.errors import InvalidParameterError
from gvp_lib.perception.segmentation import HsvThreshold
from gvp_lib.views.controls import ThresholdSliders


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
