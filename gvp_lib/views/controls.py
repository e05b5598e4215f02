"""Knobs for a running notebook. What they show is an ordinary picture, which stays where no kernel runs."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvp_lib.errors import InvalidParameterError
from gvp_lib.perception.images import check_rgb
from gvp_lib.perception.moments import Blob
from gvp_lib.perception.segmentation import HsvThreshold
from gvp_lib.views.figures import pipeline

__all__ = ["ThresholdSliders"]


class ThresholdSliders:
    """Sliders for an :class:`HsvThreshold`, above a picture of what it does to an image.

    As the last expression of a notebook's cell it shows two outputs: the sliders, which need a running kernel, and
    the picture, an ordinary PNG that each move of a slider replaces. So a stored notebook loses the sliders and
    keeps the picture.

    Parameters
    ----------
    rgb
        The image, uint8 (H, W, 3).
    start
        Where the sliders begin.

    Examples
    --------
    >>> sliders = ThresholdSliders(np.zeros((48, 64, 3), np.uint8), HsvThreshold(hue=(342, 18)))
    >>> sliders.set(value=(0.2, 0.9))
    >>> sliders.threshold
    HsvThreshold(hue=(342.0, 18.0), saturation=(0.0, 1.0), value=(0.2, 0.9), kernel_size=3)
    """

    def __init__(self, rgb: NDArray[np.uint8], start: HsvThreshold | None = None) -> None:
        self.rgb = check_rgb(rgb)
        self._threshold = start or HsvThreshold()
        self._picture: Any = None
        self._ranges: dict[str, Any] = {}

    @property
    def threshold(self) -> HsvThreshold:
        """The segmenter that the sliders now stand at, ready to use."""
        return self._threshold

    def set(self, **given: Any) -> None:
        """Change some of the threshold's ranges, or its kernel, as the sliders do."""
        unknown = set(given) - {"hue", "saturation", "value", "kernel_size"}
        if unknown:
            raise InvalidParameterError(
                f"a threshold has hue, saturation, value and kernel_size; got {', '.join(sorted(unknown))}"
            )
        now = self._threshold
        ranges = {"hue": now.hue, "saturation": now.saturation, "value": now.value, "kernel_size": now.kernel_size}
        self._threshold = HsvThreshold(**{**ranges, **given})
        if self._picture is not None:
            self._picture.update(self._figure())

    def _figure(self) -> Any:
        mask = self._threshold(self.rgb)
        return pipeline(self.rgb, mask, Blob.from_mask(mask))

    def _ipython_display_(self) -> None:
        from IPython.display import display

        display(self._box())
        self._picture = display(self._figure(), display_id=True)

    def _box(self) -> Any:
        """The sliders. Hue has two, since a range slider cannot wrap through red."""
        import ipywidgets as widgets

        now = self._threshold
        wide = {"continuous_update": False, "layout": widgets.Layout(width="460px")}
        start = widgets.FloatSlider(value=now.hue[0], min=0, max=360, step=1, description="hue from", **wide)
        end = widgets.FloatSlider(value=now.hue[1], min=0, max=360, step=1, description="hue to", **wide)
        saturation = widgets.FloatRangeSlider(
            value=now.saturation, min=0, max=1, step=0.01, description="saturation", **wide
        )
        value = widgets.FloatRangeSlider(value=now.value, min=0, max=1, step=0.01, description="value", **wide)
        kernel = widgets.IntSlider(value=now.kernel_size, min=1, max=15, step=2, description="kernel [px]", **wide)
        self._ranges = {"start": start, "end": end, "saturation": saturation, "value": value, "kernel": kernel}

        def moved(_: Any) -> None:
            ranges = {"saturation": saturation.value, "value": value.value, "kernel_size": kernel.value}
            self.set(hue=(start.value, end.value), **ranges)

        for slider in self._ranges.values():
            slider.observe(moved, names="value")
        return widgets.VBox(list(self._ranges.values()))
