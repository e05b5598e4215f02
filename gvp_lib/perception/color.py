"""Color: hue, saturation and value, and the ranges that a patch of one color covers. Thesis 2.1.1; errata 1."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from gvp_lib.errors import InvalidImageError

__all__ = ["color_ranges", "rgb_to_hsv"]

Range = tuple[float, float]

# Below this chroma (S times V) the noise of an ordinary camera, sd 2 of 255, turns the hue by 7 degrees and more.
_COLORED = 0.08
_HUE_BIN = 4  # deg
_ONE_COLOR = 7  # bins to either side of the commonest hue; beyond them lies another color


def rgb_to_hsv(rgb: ArrayLike, dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """Hue, saturation and value, unquantized. Thesis Eqs. 2.1 to 2.3, the last corrected (errata 1).

    Parameters
    ----------
    rgb
        Integers 0 to 255, shape (..., 3).
    dtype
        Of the result, float32 or float64.

    Returns
    -------
    Shape (..., 3): hue in degrees [0, 360), 0 for a gray; saturation and value in [0, 1].

    Examples
    --------
    >>> rgb_to_hsv([50, 200, 100])[0], rgb_to_hsv([200, 50, 100])[0]
    (np.float64(140.0), np.float64(340.0))
    """
    rgb = np.asarray(rgb)
    if rgb.ndim == 0 or rgb.shape[-1] != 3 or not np.issubdtype(rgb.dtype, np.integer):
        raise InvalidImageError(
            f"RGB values are integers 0…255 of shape (..., 3); got {rgb.dtype} of shape {rgb.shape}"
            + (". For floats in 0…1: (255 * rgb).round().astype(numpy.uint8)" if rgb.dtype.kind == "f" else "")
        )
    if rgb.dtype != np.uint8 and rgb.size and (rgb.min() < 0 or rgb.max() > 255):
        raise InvalidImageError(f"RGB values are integers 0…255; got {rgb.min()}…{rgb.max()}")
    r, g, b = np.moveaxis(rgb.astype(dtype), -1, 0)
    high = np.maximum(np.maximum(r, g), b)
    chroma = high - np.minimum(np.minimum(r, g), b)
    # A gray has chroma 0; dividing by 1 instead leaves its hue and saturation 0.
    step = 60 / np.where(chroma == 0, 1, chroma)
    hue = np.where(high == r, step * (g - b), np.where(high == g, 120 + step * (b - r), 240 + step * (r - g)))
    hue = np.where(chroma == 0, 0, np.where(hue < 0, hue + 360, hue))
    return np.stack([hue, chroma / np.where(high == 0, 1, high), high / 255], axis=-1).astype(dtype)


def color_ranges(pixels: NDArray[np.uint8], coverage: float, margins: tuple[float, float, float]) -> tuple[Range, ...]:
    """Ranges of hue (degrees, start above end where they wrap), saturation and value that hold a patch's main color.

    The commonest hue is found first, weighted by chroma, and pixels far from it are left out, so that a little of
    the background does no harm. Where most pixels are nearly gray, hue means nothing and is left free.

    Parameters
    ----------
    pixels
        RGB, uint8 (n, 3), n > 0.
    coverage
        The share of the color's pixels that each range holds before it is widened.
    margins
        By how much hue (degrees), saturation and value are widened at either end. A low end is at most halved.
    """
    hue, saturation, value = np.moveaxis(rgb_to_hsv(pixels), -1, 0)
    chroma = saturation * value
    share = 50 * (1 - coverage), 50 * (1 + coverage)  # percentiles

    def widened(x: NDArray[np.float64], margin: float) -> Range:
        low, high = (float(p) for p in np.percentile(x, share))
        return max(low - margin, 0.5 * low), min(high + margin, 1.0)

    colored = chroma >= _COLORED
    if colored.mean() < 0.5:
        gray = ~colored
        return (0.0, 360.0), (0.0, widened(saturation[gray], margins[1])[1]), widened(value[gray], margins[2])
    bins = 360 // _HUE_BIN
    histogram = np.bincount((hue[colored] / _HUE_BIN).astype(int) % bins, chroma[colored], minlength=bins)
    smooth = np.roll(histogram, -1) + 2 * histogram + np.roll(histogram, 1)
    peak = int(np.argmax(smooth))
    main = (peak + 0.5) * _HUE_BIN
    # From the peak to either side as far as the color goes: to where it thins out, or another one rises.
    left, right = _reach(np.roll(smooth, -peak - 1)[::-1]), _reach(np.roll(smooth, -peak))
    offset = (hue - main + 180) % 360 - 180  # degrees from the main hue, in [-180, 180)
    ours = colored & (offset >= -(left + 0.5) * _HUE_BIN) & (offset <= (right + 0.5) * _HUE_BIN)
    low, high = np.percentile(offset[ours], share)
    if high - low + 2 * margins[0] >= 360:
        return (0.0, 360.0), widened(saturation[ours], margins[1]), widened(value[ours], margins[2])
    hues = float(main + low - margins[0]) % 360, float(main + high + margins[0]) % 360
    return hues, widened(saturation[ours], margins[1]), widened(value[ours], margins[2])


def _reach(heights: NDArray[np.float64]) -> int:
    """How many bins a peak reaches to one side; ``heights`` lead away from it."""
    for k in range(1, _ONE_COLOR):
        if heights[k] < 0.05 * heights[0] or heights[k + 1] > heights[k] < 0.3 * heights[0]:
            return k
    return _ONE_COLOR
