"""Hue, saturation and value: of a picture, and the ranges of them that hold the color of a thing in it. Thesis 2.1;
errata 1."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidImageError
from gvp_lib.perception.images import as_array, toward_bytes

__all__ = ["rgb_to_hsv"]

Range = tuple[float, float]
Ranges = list[Range]  # of hue, saturation and value

# Below this chroma (S times V) the noise of an ordinary camera, sd 2 of 255, turns the hue by 7 degrees and more.
_COLORED = 0.08
_PERCENTILES = 50 * (1 - 0.98), 50 * (1 + 0.98)  # of a color's pixels, within which lies its range
_HUE_BIN = 4  # deg
_ONE_COLOR = 7  # bins to either side of the most common hue; beyond them lies another color
_STEPS = 100  # bins of saturation or value, when separating an object from a background of its hue
BACKGROUND = 1 / 3  # a color of more than this share of what lies around an object is the background's
_FOREIGN = 3  # weight of the background's share within the ranges, against 1 for the patch's
_DISTINCT = 0.1  # minimum of the weighted difference of these shares


@checked(own=True)
def rgb_to_hsv(rgb: ArrayLike) -> NDArray[np.float64]:
    """Convert RGB to HSV without quantization. Thesis Eqs. 2.1 to 2.3, the last corrected (errata 1).

    Gives hue in deg, in [0, 360), 0 for a gray, and saturation and value in [0, 1], shape (..., 3).

    Parameters
    ----------
    rgb
        Integers in 0…255, shape (..., 3).

    Examples
    --------
    >>> rgb_to_hsv([50, 200, 100]).round(2).tolist()
    [140.0, 0.75, 0.78]
    """
    rgb, code = as_array(rgb, "rgb", mode="RGB")
    colors = rgb.ndim > 0 and rgb.shape[-1] == 3
    if not colors or not np.issubdtype(rgb.dtype, np.integer):
        hint = toward_bytes(rgb, code) if colors and rgb.size else ""
        raise InvalidImageError(
            f"RGB values are integers 0…255 of shape (..., 3); got {rgb.dtype} of shape {rgb.shape}{hint}"
        )
    if rgb.dtype != np.uint8 and rgb.size and (rgb.min() < 0 or rgb.max() > 255):
        raise InvalidImageError(f"RGB values are integers 0…255; got {rgb.min()}…{rgb.max()}{toward_bytes(rgb, code)}")
    r, g, b = np.moveaxis(rgb.astype(float), -1, 0)
    high = np.maximum(np.maximum(r, g), b)
    chroma = high - np.minimum(np.minimum(r, g), b)
    # A gray has chroma 0; dividing by 1 instead leaves its hue and saturation 0.
    step = 60 / np.where(chroma == 0, 1, chroma)
    hue = np.where(high == r, step * (g - b), np.where(high == g, 120 + step * (b - r), 240 + step * (r - g)))
    hue = np.where(chroma == 0, 0, np.where(hue < 0, hue + 360, hue))
    return np.stack([hue, chroma / np.where(high == 0, 1, high), high / 255], axis=-1)


def color_ranges(pixels: NDArray[np.uint8], around: NDArray[np.uint8], margins: tuple[float, float, float]) -> Ranges:
    """Ranges that hold the main color of a patch's pixels, RGB (n, 3), n > 0.

    If they would include much of the surroundings, RGB (m, 3), as for an orange object on a beige table (beige is a
    pale orange), the saturation or value that best separates the two cuts off the patch's pixels on the background's
    side, and the ranges are learned again from the rest.
    """
    hsv, other = rgb_to_hsv(pixels), rgb_to_hsv(around)
    ranges, main = _main_color(hsv, margins)
    if _share(other, ranges) <= BACKGROUND:
        return ranges
    ours, alike = hsv[main], other[_within(other, [ranges[0], (0.0, 1.0), (0.0, 1.0)])]
    best, chosen = _DISTINCT, ranges
    for channel in (1, 2):
        cut, above = _best_cut(ours[:, channel], alike[:, channel])
        kept = ours[(ours[:, channel] > cut) == above]
        if not len(kept):
            continue
        found, _ = _main_color(kept, margins)
        if _share(other, found) > BACKGROUND:  # what is widened reaches the background again
            low, high = found[channel]
            found[channel] = (max(low, cut), high) if above else (low, min(high, cut))
        apart = _share(hsv, found) - _FOREIGN * _share(other, found)
        if apart > best:
            best, chosen = apart, found
    return chosen


def _main_color(hsv: NDArray[np.float64], margins: tuple[float, float, float]) -> tuple[Ranges, NDArray[np.bool_]]:
    """The widened ranges of the main color of pixels (n, 3), and which pixels are of that color.

    Pixels far from the most common hue, weighted by chroma, are left out. Where most pixels are nearly gray, hue means
    nothing and is left free.
    """
    hue, saturation, value = hsv.T
    chroma = saturation * value

    def widened(x: NDArray[np.float64], margin: float) -> Range:
        low, high = (float(p) for p in np.percentile(x, _PERCENTILES))
        return max(low - margin, 0.5 * low), min(high + margin, 1.0)

    colored = chroma >= _COLORED
    if colored.mean() < 0.5:
        gray = ~colored
        most = widened(saturation[gray], margins[1])[1]
        return [(0.0, 360.0), (0.0, most), widened(value[gray], margins[2])], gray
    bins = 360 // _HUE_BIN
    histogram = np.bincount((hue[colored] / _HUE_BIN).astype(int) % bins, chroma[colored], minlength=bins)
    smooth = np.roll(histogram, -1) + 2 * histogram + np.roll(histogram, 1)
    peak = int(np.argmax(smooth))
    main = (peak + 0.5) * _HUE_BIN
    # From the peak to either side as far as the color goes: to where it thins out, or another one rises.
    left, right = _reach(np.roll(smooth, -peak - 1)[::-1]), _reach(np.roll(smooth, -peak))
    offset = (hue - main + 180) % 360 - 180  # degrees from the main hue, in [-180, 180)
    ours = colored & (offset >= -(left + 0.5) * _HUE_BIN) & (offset <= (right + 0.5) * _HUE_BIN)
    low, high = np.percentile(offset[ours], _PERCENTILES)
    hues = 0.0, 360.0
    if high - low + 2 * margins[0] < 360:
        hues = float(main + low - margins[0]) % 360, float(main + high + margins[0]) % 360
        if max(hues) <= 1:  # without a margin; or it would be taken for one in 0…1
            hues = 0.0, 360 / 256
    return [hues, widened(saturation[ours], margins[1]), widened(value[ours], margins[2])], ours


def _reach(heights: NDArray[np.float64]) -> int:
    """How many bins a peak reaches to one side; ``heights`` lead away from it."""
    peak, here, beyond = heights[0], heights[1:_ONE_COLOR], heights[2 : _ONE_COLOR + 1]
    ends = (here < 0.05 * peak) | ((beyond > here) & (here < 0.3 * peak))
    return 1 + int(np.argmax([*ends, True]))


def _best_cut(ours: NDArray[np.float64], other: NDArray[np.float64]) -> tuple[float, bool]:
    """Cut that separates two samples of values in [0, 1] best, and whether ours lie above it.

    Some of ours may be background, so the best side holds many of ours and hardly any others. Between samples that do
    not overlap, the cut is the middle of the gap.
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
    inside: NDArray[np.bool_] = (hsv[:, 0] - start) % 360 <= ((end - start) % 360 or 360.0)
    for channel, (low, high) in enumerate(others, start=1):
        inside &= (hsv[:, channel] >= low) & (hsv[:, channel] <= high)
    return inside


def _share(hsv: NDArray[np.float64], ranges: Ranges) -> float:
    """Share of pixels (n, 3) in all three ranges; 0 of none."""
    return float(_within(hsv, ranges).mean()) if len(hsv) else 0.0
