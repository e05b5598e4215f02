"""From an image to a mask: HSV thresholds, saliency, and a detector's boxes. Thesis 2.1, 2.1.1; errata 1 and 2.

A segmenter is any callable from an RGB image to a mask, so your own method needs no base class.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from numbers import Real
from typing import Any, Protocol, runtime_checkable

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvp_lib.checks import checked, is_right
from gvp_lib.errors import InvalidParameterError
from gvp_lib.perception.hsv import BACKGROUND, Range, color_ranges
from gvp_lib.perception.images import as_array, check_mask, check_rgb

__all__ = ["BoxSegmenter", "HsvThreshold", "Saliency", "Segmenter"]

_OBJECT = 0.05  # minimum share of an object in the region that marks it

_UNITS = {"hue": "hue in degrees 0…360", "saturation": "saturation in 0…1", "value": "value in 0…1"}

# How far OpenCV's 8-bit hue and saturation lie from the exact ones, over all 2^24 colors, in steps: 0.640 and 0.522.
_HUE_SLACK, _SATURATION_SLACK = 0.65, 0.53

# What a surface of one color may vary by, besides what its border shows, in Lab units: much in lightness, for a
# shadow darkens without coloring, and little in a and b.
_SPREAD = np.array((10.0, 4.0, 4.0))


@runtime_checkable
class Segmenter(Protocol):
    """Callable from an RGB image, uint8 (H, W, 3), to the mask of the object's pixels, bool (H, W)."""

    def __call__(self, rgb: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Mask of the object's pixels."""


@checked
@dataclass(frozen=True)
class HsvThreshold:
    """The thesis's segmenter: ranges of hue, saturation and value, then morphological opening and closing.

    Opening (erosion, dilation) removes specks smaller than the kernel; closing (dilation, erosion) fills holes and
    cracks smaller than it (thesis 2.1.1; errata 2).

    Parameters
    ----------
    hue
        Range ``(start, end)``, deg, in 0…360, ends included. A start above the end wraps through red: (345, 15). Grays
        have hue 0, so a range of reds needs a saturation above 0. A range within 0…1 is refused: it is meant in turns.
    saturation, value
        Ranges ``(low, high)`` in 0…1, ends included.
    kernel_size
        Side of the square kernel of opening and closing, px, odd, below 1000; 1 leaves the mask as it is.

    Notes
    -----
    For speed this uses OpenCV's 8-bit HSV, whose hue has 256 steps of 1.41 deg and whose saturation has 255, not always
    rounded to the nearest. A pixel in range by :func:`rgb_to_hsv` is always in the mask; one that is out of range by up
    to 1.82 deg of hue or 0.005 of saturation may be in it too. Value is exact.

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
        for name in ("hue", "saturation", "value"):
            object.__setattr__(self, name, _pair(name, getattr(self, name)))
        _check_ranges(hue=self.hue, saturation=self.saturation, value=self.value)
        size = self.kernel_size
        if not is_right(lambda size: 1 <= size < 1000 and size % 2 == 1, size):
            raise InvalidParameterError(
                f"kernel_size is an odd number of px: 3, 5, … 999, or 1 for no opening and closing; got {size!r}"
            )

    @classmethod
    def from_region(
        cls, rgb: NDArray[np.uint8], region: ArrayLike, margins: tuple[float, float, float] = (8.0, 0.25, 0.25)
    ) -> HsvThreshold:
        """Learn thresholds from a region that the user marks on the object.

        Parameters
        ----------
        rgb
            Image, uint8 (H, W, 3).
        region
            Box ``(u0, v0, u1, v1)``, px, u1 and v1 exclusive, or mask, bool (H, W).
        margins
            Widening of hue (deg), saturation and value at either end of the range that holds 98 % of the color's
            pixels, because light falls differently from another viewpoint. A low end is at most halved.

        Raises
        ------
        InvalidParameterError
            The region shows no object: more than a third of the image outside it has its color, or more than half the
            share that has it inside.

        Notes
        -----
        Only the main color in the region counts, so that a highlight in it does no harm. Where the main color is that
        of the surroundings, as in a box around a gray object that lies aslant, it is the main color of what else there
        is. For a gray, black or white object the hue is left free and the saturation kept low. Saturation or value
        separates a background of the object's hue, such as a beige table under an orange.

        Examples
        --------
        >>> image = np.full((480, 640, 3), 128, np.uint8)
        >>> image[200:220, 300:360] = 200, 20, 30
        >>> HsvThreshold.from_region(image, (300, 200, 360, 220))
        HsvThreshold(hue=(348.6667, 4.6667), saturation=(0.65, 1.0), value=(0.5343, 1.0), kernel_size=3)
        """
        rgb = check_rgb(rgb)
        widths = _floats(margins)
        if len(widths) != 3 or not all(width >= 0 for width in widths):
            raise InvalidParameterError(f"three margins, of hue, saturation and value, are not negative; got {margins}")
        marked = region_mask(rgb, region)
        part, least = marked, _OBJECT * np.count_nonzero(marked)
        refusal = ""
        for _ in range(3):  # two backgrounds, such as a table and the cloth on it, and the object
            hue, saturation, value = color_ranges(rgb[part], rgb[~marked], widths)
            learned = cls(hue, saturation, value)
            found = learned.raw(rgb)
            outside = found[~marked].mean() if not marked.all() else 0.0
            if outside <= min(BACKGROUND, 0.5 * found[marked].mean()):
                return learned
            refusal = refusal or (
                f"the color of the marked region is also that of {outside:.0%} of the picture outside it, so it "
                f"tells no object: {learned}. Mark the whole object, with little else; where it has the background's "
                "color, take a segmenter that goes by something else, such as Saliency() or a BoxSegmenter"
            )
            part = _opened(part & ~found, 3)
            if np.count_nonzero(part) < least:
                break
        raise InvalidParameterError(refusal)

    def __repr__(self) -> str:
        ranges = ((name, *getattr(self, name)) for name in ("hue", "saturation", "value"))
        text = ", ".join(f"{name}=({round(low, 4)}, {round(high, 4)})" for name, low, high in ranges)
        return f"HsvThreshold({text}, kernel_size={self.kernel_size})"

    def __call__(self, rgb: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Mask after opening and closing, bool (H, W)."""
        return _opened_and_closed(self.raw(rgb), self.kernel_size)

    def raw(self, rgb: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Mask before opening and closing, bool (H, W).

        Parameters
        ----------
        rgb
            Image, uint8 (H, W, 3).
        """
        conversion, ranges = self._plan
        hsv = cv2.cvtColor(check_rgb(rgb), conversion)
        mask = cv2.inRange(hsv, *ranges[0])
        for low, high in ranges[1:]:
            cv2.bitwise_or(mask, cv2.inRange(hsv, low, high), dst=mask)
        return mask.astype(np.bool_)

    @cached_property
    def _plan(self) -> tuple[int, list[tuple[Sequence[int], Sequence[int]]]]:
        """Color conversion, and the one or two boxes of 8-bit HSV that a pixel may lie in."""
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


def _opened_and_closed(mask: NDArray[np.bool_], kernel_size: int) -> NDArray[np.bool_]:
    if kernel_size == 1:
        return mask
    kernel = np.ones((kernel_size, kernel_size), np.uint8)
    return cv2.morphologyEx(_opened(mask, kernel_size).view(np.uint8), cv2.MORPH_CLOSE, kernel).view(np.bool_)


def _opened(mask: NDArray[np.bool_], kernel_size: int) -> NDArray[np.bool_]:
    """Without what is smaller than the kernel."""
    kernel = np.ones((kernel_size, kernel_size), np.uint8)
    return cv2.morphologyEx(mask.view(np.uint8), cv2.MORPH_OPEN, kernel).view(np.bool_)


def _steps(low: float, high: float, scale: float, slack: float) -> tuple[int, int]:
    """The first and the last 8-bit step that a value in ``low`` to ``high`` may have become."""
    slack += 1e-9  # 0.2 * 255 is not quite 51
    return math.ceil(low * scale - slack), math.floor(high * scale + slack)


def _floats(given: object) -> tuple[float, ...]:
    """Numbers of a sequence; none of what is no such sequence."""
    array, _ = as_array(given, "")
    return tuple(array.astype(float).tolist()) if array.ndim == 1 and array.dtype.kind in "biuf" else ()


def _pair(name: str, given: object) -> Range:
    """``given`` as two floats."""
    pair = _floats(given)
    if len(pair) != 2:
        raise InvalidParameterError(f"{_UNITS[name]}, as a pair (low, high); got {given!r}")
    return pair[0], pair[1]


def _check_ranges(**ranges: Range) -> None:
    """Refuse ranges that are none, with what would work."""
    for name, (low, high) in ranges.items():
        top = 360 if name == "hue" else 1
        backward = 0 <= high < low <= top
        hint = ""
        if name == "hue" and low != high and 0 <= min(low, high) <= max(low, high) <= 1:
            hint = f". If those are scikit-image's 0…1: hue=({360 * low:g}, {360 * high:g})"
        elif 0 <= low <= high <= top or (backward and name == "hue"):
            continue
        elif backward:
            hint = f". The low end comes first: {name}=({high:g}, {low:g})"
        elif name == "hue" and abs(high - low) < 360:
            hint = f". A range through red starts above its end: hue=({low % 360:g}, {high % 360:g})"
        elif name != "hue" and 0 <= low <= high:
            hint = _in_other_units(ranges)
        raise InvalidParameterError(f"{_UNITS[name]}; got ({low:g}, {high:g}){hint}")


def _in_other_units(ranges: dict[str, Range]) -> str:
    """What the ranges would be, all three, if their saturation and value were in percent, or OpenCV's."""
    hue = ranges["hue"]
    above = {name: pair for name, pair in ranges.items() if name != "hue" and max(pair) > 1}
    most = max(high for _, high in above.values())

    def divided(by: int) -> str:
        return ", ".join(f"{name}=({low:g} / {by}, {high:g} / {by})" for name, (low, high) in above.items())

    hints = f". If in percent: {divided(100)}" if most <= 100 else ""
    if hue == (0, 360):
        hints += f". If OpenCV's 0…255: {divided(255)}" * (most <= 255)
    elif most <= 255 and max(hue) <= 180:
        hints += f". If OpenCV's 0…255, with its hue of 0…179: hue=(2 * {hue[0]:g}, 2 * {hue[1]:g}), {divided(255)}"
    elif 100 < most <= 255:
        hints = f". If OpenCV's 0…255, though with a hue in degrees: {divided(255)}"
    return hints


def region_mask(rgb: NDArray[np.uint8], region: ArrayLike) -> NDArray[np.bool_]:
    """The marked region as a mask, bool (H, W)."""
    given, _ = as_array(region, "region")
    height, width = rgb.shape[:2]
    is_box = given.size == 4 and given.dtype.kind in "iuf"  # also two corners, or a detector's array of one
    if given.ndim >= 2 and not is_box:
        mask = check_mask(region, (height, width))
        if not mask.any():
            raise InvalidParameterError("the marked region is an empty mask; mark some of the object's pixels")
        return mask
    u0, v0, u1, v1 = np.rint(given.ravel()) if is_box else np.zeros(4)
    if not (0 <= u0 < u1 <= width and 0 <= v0 < v1 <= height):
        raise InvalidParameterError(
            f"a region is a mask, bool (H, W), or a box (u0, v0, u1, v1) in the image, 0 <= u0 < u1 <= {width} and "
            f"0 <= v0 < v1 <= {height}; got {region!r}. From (u, v, width, height), as of cv2.selectROI: "
            "(u, v, u + width, v + height)"
        )
    return _filled((height, width), [given.ravel()])


def _filled(shape: tuple[int, ...], boxes: Iterable[Any]) -> NDArray[np.bool_]:
    """A mask of boxes (u0, v0, u1, v1, ...), which may reach out of the image."""
    mask = np.zeros(shape, np.bool_)
    for box in boxes:
        u0, v0, u1, v1 = (max(0, round(float(x))) for x in box[:4])
        mask[v0:v1, u0:u1] = True
    return mask


@checked
@dataclass(frozen=True)
class Saliency:
    """Segmenter of an object of any color, as long as the border of the image shows the background.

    Parameters
    ----------
    threshold
        Minimum distance of the object's pixels from the background, in standard deviations: a bare table gives an empty
        mask.
    single
        Whether to keep only the region that is most salient, large and central. False keeps all, for a tracker to
        choose from.
    border
        Width of the border that counts as background, as a share of the image's shorter side.
    min_area
        Minimum area of a region, px; smaller ones are noise.
    scale
        Factor by which the image is first reduced, which smooths noise and texture.

    Notes
    -----
    Each side of the image gives a normal distribution of background colors in CIE Lab. The saliency of a pixel is its
    Mahalanobis distance to the nearest of the four; Otsu's method separates object and background; what the object
    encloses, such as a pale spot on a label, belongs to it.

    The distance in Lab of a smoothed image is the frequency-tuned saliency of Achanta et al. (CVPR 2009); the border as
    background is the prior of Wei et al., "Geodesic saliency using background priors" (ECCV 2012).

    It fails where the object touches most of a border or has the table's color, and it fills the hole of a ring.

    Examples
    --------
    >>> image = np.full((240, 320, 3), 128, np.uint8)
    >>> image[100:140, 150:210] = 200, 20, 30
    >>> Saliency()(image)[[120, 20], [180, 20]].tolist()
    [True, False]
    """

    threshold: float = 4.0
    single: bool = True
    border: float = 0.06
    min_area: int = 100
    scale: int = 2

    def __post_init__(self) -> None:
        def sound(_: object) -> bool:
            sizes = self.threshold > 0 and 0 < self.border < 0.5 and self.min_area >= 0
            return sizes and 1 <= self.scale == int(self.scale) and self.single in (True, False)

        if not is_right(sound, self):
            raise InvalidParameterError(
                "threshold is positive, border in (0, 0.5), min_area not negative, scale a whole number from 1 and "
                f"single True or False; got threshold={self.threshold}, border={self.border}, "
                f"min_area={self.min_area}, scale={self.scale}, single={self.single}"
            )

    def __call__(self, rgb: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Mask, bool (H, W); empty if nothing stands out."""
        distance = self.map(rgb)
        # Otsu sees distances in 256 steps, of which the last holds everything farther than any threshold can lie.
        steps = cv2.convertScaleAbs(distance, alpha=255 / max(float(distance.max()), 1e-6))
        step, _ = cv2.threshold(steps, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
        cut = max(float(self.threshold), float(distance.max()) * step / 255)
        mask: NDArray[Any] = _opened_and_closed(distance > cut, 3).view(np.uint8)
        outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        mask = cv2.drawContours(mask, outlines, -1, 1, cv2.FILLED)  # no holes
        n, labels, stats, centroids = cv2.connectedComponentsWithStats(mask, connectivity=8)
        large = stats[:, cv2.CC_STAT_AREA] >= max(self.min_area, 1)
        large[0] = False  # the background
        if not (self.single and large.any()):
            return large[labels]
        # The best region: its summed saliency, weighted by how central it is.
        center = 0.5 * (np.array(mask.shape[::-1]) - 1)
        offset = np.linalg.norm((centroids - center) / center.clip(1), axis=1)  # 1 at the middle of a side
        weight = np.bincount(labels.ravel(), distance.ravel(), minlength=n) * np.exp(-(offset**2))
        return np.equal(labels, np.argmax(np.where(large, weight, 0)))

    def map(self, rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Saliency: distance of each pixel's color from the background's, in standard deviations, float32 (H, W).

        Parameters
        ----------
        rgb
            Image, uint8 (H, W, 3).
        """
        rgb = check_rgb(rgb)
        height, width = rgb.shape[:2]
        size = max(1, width // self.scale), max(1, height // self.scale)
        small = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
        lab: NDArray[Any] = cv2.cvtColor(small.astype(np.float32) / 255, cv2.COLOR_RGB2Lab)
        lab = cv2.GaussianBlur(lab, (0, 0), 1.0)
        ring = max(1, round(self.border * min(lab.shape[:2])))
        squares = []
        for side in (lab[:ring], lab[-ring:], lab[:, :ring], lab[:, -ring:]):
            mean, whiten = _background(side.reshape(-1, 3).astype(float))
            white = cv2.transform(lab, np.column_stack([whiten, -whiten @ mean]))
            squares.append(cv2.transform(cv2.multiply(white, white), np.ones((1, 3))))
        nearest = np.sqrt(np.minimum.reduce(squares))
        distance: NDArray[Any] = cv2.resize(nearest, (width, height), interpolation=cv2.INTER_LINEAR)
        return distance


def _background(colors: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean (3,) of Lab colors (n, 3), and the matrix (3, 3) that turns a difference from it into deviations.

    An object that reaches into the border is left out: colors far from the median do not count.
    """
    off = (((colors - np.median(colors, axis=0)) / _SPREAD) ** 2).sum(axis=1)
    inliers = colors[off <= np.percentile(off, 75)]
    mean = inliers.mean(axis=0)
    centered = inliers - mean
    # Leaving out the outer quarter shrinks the spread of a normal distribution; the factor 2 makes up for it.
    covariance = 2 * centered.T @ centered / len(inliers) + np.diag(_SPREAD**2)
    return mean, np.linalg.inv(np.linalg.cholesky(covariance))


@checked
@dataclass(frozen=True)
class BoxSegmenter:
    """Segmenter from a detector of bounding boxes: the mask is the filled box (thesis 2.1).

    Parameters
    ----------
    detect
        Detector, from RGB image, uint8 (H, W, 3), to boxes ``(u0, v0, u1, v1)`` or ``(u0, v0, u1, v1, score)``, px, u1
        and v1 exclusive.
    min_score
        Minimum score of a box; a box without a score is kept.
    every
        Whether to fill every box, for a tracker to choose from. False fills only the box with the highest score or,
        without scores, the largest.

    Notes
    -----
    A filled box is enough to center the camera and for the learned planner, but not for the image-moment planner: an
    upright box has the orientation of the image rather than of the object, and its ratio is not the object's.

    Examples
    --------
    >>> segmenter = BoxSegmenter(lambda rgb: [(10, 10, 30, 20, 0.9), (40, 40, 45, 45, 0.2)])
    >>> int(segmenter(np.zeros((240, 320, 3), np.uint8)).sum())
    200
    """

    detect: Callable[[NDArray[np.uint8]], Sequence[Sequence[float]]]
    min_score: float = 0.0
    every: bool = False

    def __post_init__(self) -> None:
        numbers = isinstance(self.min_score, Real) and isinstance(self.every, (bool, np.bool_))
        if not callable(self.detect) or not numbers:
            raise InvalidParameterError(
                "detect is called with an RGB image and returns boxes, min_score is a number and every True or False; "
                f"got {self.detect!r}, {self.min_score!r} and {self.every!r}"
            )

    def __repr__(self) -> str:
        detect = getattr(self.detect, "__name__", type(self.detect).__name__)
        return f"BoxSegmenter({detect}, min_score={self.min_score:g}, every={self.every})"

    def __call__(self, rgb: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Mask, bool (H, W); empty if nothing is detected."""
        rgb = check_rgb(rgb)
        height, width = rgb.shape[:2]
        detected, boxes = self.detect(rgb), []
        try:
            rows = list(detected)
        except TypeError:
            raise InvalidParameterError(
                f"a detector gives boxes, an empty list where it sees none; got {detected!r}"
            ) from None
        for given in rows:
            box = _floats(given)
            if len(box) not in (4, 5) or not np.isfinite(box).all() or box[2] < box[0] or box[3] < box[1]:
                hint = "From (u, v, width, height): (u, v, u + width, v + height)"
                if len(box) > 5:
                    hint = "Of more columns, such as a class, pass the first five: box[:5]"
                elif not box:
                    hint = "A single box is a list of one: [box]"
                raise InvalidParameterError(
                    "a detector gives boxes (u0, v0, u1, v1) or (u0, v0, u1, v1, score) with u0 <= u1 and v0 <= v1; "
                    f"got {box or given!r}. {hint}"
                )
            if max(box[:4]) <= 1 and not all(x.is_integer() for x in box[:4]):
                raise InvalidParameterError(
                    f"a box is in px; got {box}. From shares of the picture: (u0 * {width}, v0 * {height}, "
                    f"u1 * {width}, v1 * {height})"
                )
            if len(box) == 4 or box[4] >= self.min_score:
                boxes.append(box)
        if boxes and not self.every:
            boxes = [max(boxes, key=lambda b: b[4] if len(b) == 5 else (b[2] - b[0]) * (b[3] - b[1]))]
        return _filled(rgb.shape[:2], boxes)
