"""Color: hue, saturation and value, and the ranges that a patch of one color covers. Thesis 2.1.1; errata 1."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from gvp_lib.errors import InvalidImageError

__all__ = ["color_ranges", "rgb_to_hsv"]

Range = tuple[float, float]
Ranges = tuple[Range, Range, Range]

# Below this chroma (S times V) the noise of an ordinary camera, sd 2 of 255, turns the hue by 7 degrees and more.
_COLORED = 0.08
_HUE_BIN = 4  # deg
_ONE_COLOR = 7  # bins to either side of the commonest hue; beyond them lies another color
_STEPS = 100  # of saturation or value, in telling an object from a background of its hue
_FOREIGN = 3  # shares of the background that ranges take in count this much against shares of the patch
_DISTINCT = 0.1  # by how much these must outweigh those
BACKGROUND = 1 / 3
"""A color of more than this share of what lies around an object is the background's."""


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


def color_ranges(
    pixels: NDArray[np.uint8],
    coverage: float,
    margins: tuple[float, float, float],
    around: NDArray[np.uint8] | None = None,
) -> Ranges:
    """Ranges of hue (degrees, start above end where they wrap), saturation and value that hold a patch's main color.

    The commonest hue is found first, weighted by chroma, and pixels far from it are left out, so that a little of
    the background does no harm. Where most pixels are nearly gray, hue means nothing and is left free.

    Where these ranges would take in much of what lies around the patch, as with an orange object on a table of beige,
    which is a pale orange, the patch's pixels on the background's side of the saturation or value that parts the two
    best are left out, and what is kept is learned from again.

    Parameters
    ----------
    pixels
        RGB, uint8 (n, 3), n > 0.
    coverage
        The share of the color's pixels that each range holds before it is widened.
    margins
        By how much hue (degrees), saturation and value are widened at either end. A low end is at most halved.
    around
        RGB, uint8 (m, 3), of what lies around the patch; None or no pixels where nobody knows.
    """
    hsv = rgb_to_hsv(pixels)
    ranges, main = _learned(hsv, coverage, margins)
    other = rgb_to_hsv(pixels[:0] if around is None else around)
    if not _is_background(other, ranges):
        return ranges
    ours, alike = hsv[main], other[_within(other, (ranges[0], (0.0, 1.0), (0.0, 1.0)))]
    best, chosen = _DISTINCT, ranges
    for channel in (1, 2):
        cut, above = _best_cut(ours[:, channel], alike[:, channel])
        kept = ours[(ours[:, channel] > cut) == above]
        if not len(kept):
            continue
        found, _ = _learned(kept, coverage, margins)
        if _is_background(other, found):  # what is widened reaches the background again
            low, high = found[channel]
            ended = (max(low, cut), high) if above else (low, min(high, cut))
            found = (found[0], ended, found[2]) if channel == 1 else (*found[:2], ended)
        apart = float(_within(hsv, found).mean() - _FOREIGN * _within(other, found).mean())
        if apart > best:
            best, chosen = apart, found
    return chosen


def _is_background(around: NDArray[np.float64], ranges: Ranges) -> bool:
    """Whether the ranges hold too much of what lies around an object, hsv (m, 3)."""
    return len(around) > 0 and float(_within(around, ranges).mean()) > BACKGROUND


def _best_cut(ours: NDArray[np.float64], other: NDArray[np.float64]) -> tuple[float, bool]:
    """What parts two samples of values in [0, 1] best: where, and whether ours lie above.

    Some of ours are of the other kind, so that side is best which holds many of ours and hardly any others. Between
    kinds that do not meet, the cut is the middle of the gap.
    """
    edges = np.linspace(0, 1, _STEPS + 1)
    below, other_below = (np.cumsum(np.histogram(x, edges)[0]) / len(x) for x in (ours, other))
    sides = np.stack([below - _FOREIGN * other_below, (1 - below) - _FOREIGN * (1 - other_below)])
    side = int(np.argmax(sides.max(axis=1)))
    equal = np.flatnonzero(sides[side] > sides[side].max() - 0.01)
    return float(edges[equal[len(equal) // 2] + 1]), side == 1


def _within(hsv: NDArray[np.float64], ranges: Ranges) -> NDArray[np.bool_]:
    """Which pixels lie in all three ranges; hsv is (n, 3)."""
    (start, end), *others = ranges
    span = (end - start) % 360 or 360.0
    inside: NDArray[np.bool_] = (hsv[:, 0] - start) % 360 <= span
    for channel, (low, high) in enumerate(others, start=1):
        inside &= (hsv[:, channel] >= low) & (hsv[:, channel] <= high)
    return inside


def _learned(
    hsv: NDArray[np.float64], coverage: float, margins: tuple[float, float, float]
) -> tuple[Ranges, NDArray[np.bool_]]:
    """The widened ranges of the main color of pixels (n, 3), and which pixels are of that color."""
    hue, saturation, value = hsv.T
    chroma = saturation * value
    share = 50 * (1 - coverage), 50 * (1 + coverage)  # percentiles

    def widened(x: NDArray[np.float64], margin: float) -> Range:
        low, high = (float(p) for p in np.percentile(x, share))
        return max(low - margin, 0.5 * low), min(high + margin, 1.0)

    colored = chroma >= _COLORED
    if colored.mean() < 0.5:
        gray = ~colored
        most = widened(saturation[gray], margins[1])[1]
        return ((0.0, 360.0), (0.0, most), widened(value[gray], margins[2])), gray
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
        hues = 0.0, 360.0
    else:
        hues = float(main + low - margins[0]) % 360, float(main + high + margins[0]) % 360
    return (hues, widened(saturation[ours], margins[1]), widened(value[ours], margins[2])), ours


def _reach(heights: NDArray[np.float64]) -> int:
    """How many bins a peak reaches to one side; ``heights`` lead away from it."""
    for k in range(1, _ONE_COLOR):
        if heights[k] < 0.05 * heights[0] or heights[k + 1] > heights[k] < 0.3 * heights[0]:
            return k
    return _ONE_COLOR
