"""Sliders for a threshold, for a notebook that runs."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError
from gvp_lib.perception.blobs import Blob
from gvp_lib.perception.images import check_rgb
from gvp_lib.perception.segmentation import HsvThreshold
from gvp_lib.views.pictures import BookFigure, pipeline

__all__ = ["ThresholdSliders"]


@checked
class ThresholdSliders:
    """Sliders for an :class:`HsvThreshold`, above a picture of what it makes of an image.

    At the end of a notebook's cell it shows two outputs: the sliders, which need a running kernel, and the picture, an
    ordinary PNG that each move of a slider replaces. A stored notebook loses the sliders and keeps the picture.

    Parameters
    ----------
    rgb
        Image, uint8 (H, W, 3).
    start
        Threshold at which the sliders start; by default one that lets everything through.

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

    def __repr__(self) -> str:
        return f"ThresholdSliders({self.threshold})"

    @property
    def threshold(self) -> HsvThreshold:
        """Threshold as the sliders are set, ready to use as a segmenter."""
        return self._threshold

    def set(self, **given: Any) -> None:
        """Change some of the threshold's ranges, or its kernel, as the sliders do.

        Parameters
        ----------
        **given
            Fields of :class:`HsvThreshold`: hue, saturation, value, kernel_size.
        """
        unknown = given.keys() - {field.name for field in fields(HsvThreshold)}
        if unknown:
            raise InvalidParameterError(
                f"a threshold has hue, saturation, value and kernel_size; got {', '.join(sorted(unknown))}"
            )
        self._threshold = replace(self.threshold, **given)
        if self._picture is not None:
            self._picture.update(self._figure())

    def _figure(self) -> BookFigure:
        mask = self.threshold(self.rgb)
        return pipeline(self.rgb, mask, Blob.from_mask(mask))

    def _ipython_display_(self) -> None:
        from IPython.display import display

        display(self._box())
        self._picture = display(self._figure(), display_id=True)

    def _box(self) -> Any:
        """The sliders. Hue has two, since a range slider cannot wrap through red."""
        import ipywidgets as widgets

        now, shares, degrees = self.threshold, {"max": 1, "step": 0.01}, {"max": 360, "step": 1}
        sliders = [
            widgets.FloatSlider(now.hue[0], description="hue from", **degrees),
            widgets.FloatSlider(now.hue[1], description="hue to", **degrees),
            widgets.FloatRangeSlider(value=now.saturation, description="saturation", min=0, **shares),
            widgets.FloatRangeSlider(value=now.value, description="value", min=0, **shares),
            widgets.IntSlider(now.kernel_size, description="kernel [px]", min=1, max=15, step=2),
        ]

        def moved(_: Any) -> None:
            start, end, saturation, value, kernel = (slider.value for slider in sliders)
            self.set(hue=(start, end), saturation=saturation, value=value, kernel_size=kernel)

        for slider in sliders:
            slider.continuous_update, slider.layout.width = False, "460px"
            slider.observe(moved, names="value")
        return widgets.VBox(sliders)
