"""From an image to a mask: thresholds in HSV, and whatever else tells the object's pixels. Thesis 2.1.1; errata 1, 2.

A segmenter is any callable from an RGB image to a mask, so another method takes its place without a base class.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvp_lib.errors import InvalidImageError, InvalidParameterError
from gvp_lib.perception.boxes import BoxSegmenter
from gvp_lib.perception.color import BACKGROUND, Range, color_ranges, rgb_to_hsv
from gvp_lib.perception.images import check_mask, check_rgb
from gvp_lib.perception.saliency import Saliency

__all__ = ["BoxSegmenter", "HsvThreshold", "Saliency", "Segmenter", "rgb_to_hsv"]

# How far OpenCV's 8-bit hue and saturation lie from the exact ones, over all 2^24 colors, in steps: 0.640 and 0.522.
_HUE_SLACK, _SATURATION_SLACK = 0.65, 0.53


@runtime_checkable
class Segmenter(Protocol):
    """Tells the object's pixels from all others: RGB uint8 (H, W, 3) in, mask bool (H, W) out."""

    def __call__(self, rgb: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """The object's pixels."""
        ...


@dataclass(frozen=True)
class HsvThreshold:
    """The thesis's segmenter: pixels whose hue, saturation and value each lie in a range, then opened and closed.

    Opening (erosion, dilation) removes specks smaller than the kernel; closing (dilation, erosion) fills holes and
    cracks smaller than it (thesis 2.1.1; errata 2).

    Attributes
    ----------
    hue
        ``(start, end)``, degrees in 0…360, ends included. A start above its end wraps through red: (345, 15).
        A gray has hue 0, so a range of reds wants a saturation above 0.
    saturation, value
        ``(low, high)`` in 0…1, ends included.
    kernel_size
        Side of the square kernel of opening and closing, px, odd; 1 leaves the mask as it is.

    Notes
    -----
    Speed comes from OpenCV's 8-bit HSV. Its hue has 256 steps of 1.41 degrees and its saturation 255, and they are not
    always the nearest. A pixel that :func:`rgb_to_hsv` finds in range is always in the mask; one that is out by up
    to 1.82 degrees of hue or 0.005 of saturation may be in it too. Value is exact.

    Examples
    --------
    >>> red = HsvThreshold(hue=(345, 15), saturation=(0.4, 1), value=(0.2, 1))
    >>> image = np.full((480, 640, 3), 128, np.uint8)
    >>> image[200:220, 300:360] = 200, 20, 30
    >>> int(red(image).sum())
    1200
    """

    hue: Range = (0.0, 360.0)
    saturation: Range = (0.0, 1.0)
    value: Range = (0.0, 1.0)
    kernel_size: int = 3

    def __post_init__(self) -> None:
        object.__setattr__(self, "hue", _checked_range("hue", self.hue, 360))
        object.__setattr__(self, "saturation", _checked_range("saturation", self.saturation, 1))
        object.__setattr__(self, "value", _checked_range("value", self.value, 1))
        if self.kernel_size != int(self.kernel_size) or self.kernel_size < 1 or self.kernel_size % 2 == 0:
            raise InvalidParameterError(
                f"kernel_size is an odd number of pixels: 3, 5, …, or 1 for no opening and closing; "
                f"got {self.kernel_size}"
            )

    @classmethod
    def from_region(
        cls,
        rgb: NDArray[np.uint8],
        region: ArrayLike,
        coverage: float = 0.98,
        margins: tuple[float, float, float] = (8.0, 0.25, 0.25),
        kernel_size: int = 3,
    ) -> HsvThreshold:
        """Thresholds learned from a region that the user marks on the object.

        The main color in the region counts: some background in it does no harm, nor does a highlight. For a gray,
        black or white object the hue is left free and the saturation kept low. A background of the object's hue, such
        as a beige table under an orange, is told apart by saturation or value.

        Parameters
        ----------
        rgb
            uint8 (H, W, 3).
        region
            A box ``(u0, v0, u1, v1)``, px, u1 and v1 exclusive, or a mask, bool (H, W).
        coverage
            Share of that color's pixels which each range is to hold, in (0, 1], before it is widened.
        margins
            By how much hue (degrees), saturation and value are then widened at either end, because from another
            viewpoint the light falls differently.
        kernel_size
            As for the class.

        Raises
        ------
        InvalidParameterError
            The color learned is also that of more than a third of the picture outside the region.
        """
        rgb = check_rgb(rgb)
        if not (0 < coverage <= 1 and len(margins) == 3 and min(margins) >= 0):
            raise InvalidParameterError(
                f"coverage lies in (0, 1] and three margins are not negative; got {coverage} and {margins}"
            )
        marked = _marked(rgb, region)
        learned = cls(*color_ranges(rgb[marked], coverage, margins, rgb[~marked]), kernel_size)
        outside = learned.raw(rgb)[~marked]
        if outside.size and outside.mean() > BACKGROUND:
            raise InvalidParameterError(
                f"the color of the marked region is also that of {outside.mean():.0%} of the picture outside it, so it "
                f"tells no object: {learned}. Mark the whole object, with little else; where it has the background's "
                "color, take a segmenter that goes by something else, such as Saliency() or a BoxSegmenter"
            )
        return learned

    def __call__(self, rgb: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """The mask, opened and closed; bool (H, W)."""
        mask = self._in_range(check_rgb(rgb))
        if self.kernel_size > 1:
            mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, self._kernel)
            mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, self._kernel)
        return mask.astype(np.bool_)

    def raw(self, rgb: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """The mask before opening and closing; bool (H, W)."""
        return self._in_range(check_rgb(rgb)).astype(np.bool_)

    def _in_range(self, rgb: NDArray[np.uint8]) -> NDArray[Any]:
        """255 in range, 0 elsewhere; uint8 (H, W)."""
        conversion, ranges = self._plan
        hsv = cv2.cvtColor(rgb, conversion)
        mask = cv2.inRange(hsv, *ranges[0])
        for low, high in ranges[1:]:
            cv2.bitwise_or(mask, cv2.inRange(hsv, low, high), dst=mask)
        return mask

    @cached_property
    def _kernel(self) -> NDArray[np.uint8]:
        return np.ones((self.kernel_size, self.kernel_size), np.uint8)

    @cached_property
    def _plan(self) -> tuple[int, list[tuple[Sequence[int], Sequence[int]]]]:
        """The color conversion, and the box or two boxes of 8-bit HSV that a pixel may lie in."""
        s = _steps(*self.saturation, 255, _SATURATION_SLACK)
        v = _steps(*self.value, 255, 0.0)
        start, end = self.hue
        if (end - start) % 360 == 0 and end != start:
            return cv2.COLOR_RGB2HSV_FULL, [((0, s[0], v[0]), (255, s[1], v[1]))]
        first, last = _steps(start, end if end >= start else end + 360, 256 / 360, _HUE_SLACK)
        conversion = cv2.COLOR_RGB2HSV_FULL
        if last > 255 and s[0] > 0:
            # A second inRange would cost as much as the first. Exchanging red and blue mirrors the hue about green,
            # h -> 240 - h, which takes red from the end of the scale to its middle. Not for grays, whose hue stays 0.
            mirrored = _steps((240 - end) % 360, (240 - end) % 360 + (end - start) % 360, 256 / 360, _HUE_SLACK)
            if mirrored[1] <= 255:
                conversion, (first, last) = cv2.COLOR_BGR2HSV_FULL, mirrored
        hues = [(first, min(last, 255))] + ([(0, last - 256)] if last > 255 else [])
        return conversion, [((h0, s[0], v[0]), (h1, s[1], v[1])) for h0, h1 in hues]


def _marked(rgb: NDArray[np.uint8], region: ArrayLike) -> NDArray[np.bool_]:
    """The marked region as a mask, bool (H, W)."""
    region = np.asarray(region)
    height, width = rgb.shape[:2]
    if region.ndim == 2:
        if check_mask(region).shape != (height, width):
            raise InvalidImageError(f"the mask has shape {region.shape}, the image {(height, width)}; they must agree")
        if not region.any():
            raise InvalidParameterError("the marked region is an empty mask; mark some of the object's pixels")
        return region
    if region.shape != (4,) or region.dtype.kind not in "iuf":
        raise InvalidParameterError(f"a region is a box (u0, v0, u1, v1) or a mask, bool (H, W); got {region!r}")
    u0, v0, u1, v1 = (round(float(x)) for x in region)
    if not (0 <= u0 < u1 <= width and 0 <= v0 < v1 <= height):
        raise InvalidParameterError(
            f"a box (u0, v0, u1, v1) lies in the image, 0 <= u0 < u1 <= {width} and 0 <= v0 < v1 <= {height}; "
            f"got ({u0}, {v0}, {u1}, {v1})"
        )
    mask = np.zeros((height, width), bool)
    mask[v0:v1, u0:u1] = True
    return mask


def _steps(low: float, high: float, scale: float, slack: float) -> tuple[int, int]:
    """The first and the last 8-bit step that a value in ``low`` to ``high`` may have become."""
    slack += 1e-9  # 0.2 * 255 is not quite 51
    return math.ceil(low * scale - slack), math.floor(high * scale + slack)


def _checked_range(name: str, given: object, top: float) -> Range:
    """``given`` as two floats; or an error that says what would work."""
    unit = "hue in degrees 0…360" if name == "hue" else f"{name} in 0…1"
    try:
        low, high = (float(x) for x in given)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise InvalidParameterError(f"{unit}, as a pair (low, high); got {given!r}") from None
    if not (0 <= low <= top and 0 <= high <= top):
        hint = ""
        if name == "hue" and -360 <= min(low, high) < 0 and max(low, high) <= 360:
            hint = f". A range through red starts above its end: hue=({low % 360:g}, {high % 360:g})"
        elif name != "hue" and 0 <= low <= high and 1 < high <= 255:
            hint = (
                f". If those are OpenCV's 0…255: {name}=({low / 255:.3g}, {high / 255:.3g}), "
                "and OpenCV's hue of 0…179 counts steps of 2 degrees"
            )
        raise InvalidParameterError(f"{unit}; got ({low:g}, {high:g}){hint}")
    if low > high and name != "hue":
        raise InvalidParameterError(f"{unit}, the low end first: ({high:g}, {low:g}); got ({low:g}, {high:g})")
    return low, high
