"""Connected regions of a mask, and tracking one of them from frame to frame. Thesis 2.1."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvp_lib.errors import InvalidParameterError
from gvp_lib.perception.images import check_mask, check_rgb
from gvp_lib.perception.moments import Blob
from gvp_lib.perception.segmentation import Segmenter

__all__ = ["Region", "Tracker", "blobs_from_mask", "regions_from_mask"]


@dataclass(frozen=True, eq=False)
class Region:
    """One connected region of a mask.

    Attributes
    ----------
    blob
        Moments of the region, in pixels of the whole image.
    pixels
        Pixels of the region within ``blob.bbox``, bool, read-only.
    """

    blob: Blob
    pixels: NDArray[np.bool_]

    def __repr__(self) -> str:
        return f"Region({self.blob})"

    def mask(self, shape: Sequence[int]) -> NDArray[np.bool_]:
        """Mask of the region alone, bool (H, W).

        Parameters
        ----------
        shape
            Shape of the image, (H, W) or (H, W, 3).
        """
        mask = np.zeros(tuple(shape[:2]), np.bool_)
        u0, v0, u1, v1 = self.blob.bbox
        mask[v0:v1, u0:u1] = self.pixels
        return mask


def regions_from_mask(mask: NDArray[np.bool_], min_area: int = 1) -> list[Region]:
    """Connected regions of a mask, largest first; pixels that touch at a side or a corner are connected.

    Parameters
    ----------
    mask
        Mask, bool (H, W).
    min_area
        Minimum area of a region, px; smaller ones are left out.

    Examples
    --------
    >>> mask = np.array([[True, True, False, True]])
    >>> [region.blob.area for region in regions_from_mask(mask)]
    [2, 1]
    """
    pixels = check_mask(mask).view(np.uint8)
    u0, v0, width, height = cv2.boundingRect(pixels) if pixels.size else (0, 0, 0, 0)
    if not width:
        return []
    # Only the part of the image where anything is set: labelling all of it costs more than segmenting it.
    _, labels, stats, _ = cv2.connectedComponentsWithStats(pixels[v0 : v0 + height, u0 : u0 + width], connectivity=8)
    regions = []
    for label in 1 + np.argsort(-stats[1:, cv2.CC_STAT_AREA], kind="stable"):
        u, v, w, h, area = (int(x) for x in stats[label])
        if area < min_area:
            break
        own = np.equal(labels[v : v + h, u : u + w], label)
        own.flags.writeable = False
        blob = Blob.from_mask(own)
        assert blob is not None  # a label has pixels
        u, v = u0 + u, v0 + v
        regions.append(Region(replace(blob, centroid=blob.centroid + (u, v), bbox=(u, v, u + w, v + h)), own))
    return regions


def blobs_from_mask(mask: NDArray[np.bool_], min_area: int = 1) -> list[Blob]:
    """Blobs of the connected regions of a mask, largest first: those of :func:`regions_from_mask`.

    Parameters
    ----------
    mask
        Mask, bool (H, W).
    min_area
        Minimum area of a blob, px; smaller ones are left out.

    Examples
    --------
    >>> [blob.area for blob in blobs_from_mask(np.array([[True, True, False, True]]), min_area=2)]
    [2]
    """
    return [region.blob for region in regions_from_mask(mask, min_area)]


@dataclass(eq=False)
class Tracker:
    """Tracker of one object among others that the segmenter cannot tell from it.

    In the first frame ``choose`` selects the target. In each later frame the target is the region that fits its last
    position and area best. If none is near enough and of similar area, the target is lost: :meth:`observe` returns
    None, and looks for the same target again in the next frame.

    Parameters
    ----------
    segmenter
        Segmenter, from RGB image to mask.
    choose
        Target in the first frame: ``"largest"``, ``"center"`` (nearest to the image's center), or the region nearest to
        a pixel ``(u, v)``.
    min_area
        Minimum area of a region, px; smaller ones are noise.
    max_shift
        Maximum motion of the centroid between two frames, as a share of the image's width.
    max_growth
        Maximum factor by which the area may grow or shrink between two frames.

    Notes
    -----
    Two objects that touch are one region, and its blob is that of neither.

    Examples
    --------
    >>> image = np.zeros((240, 320, 3), np.uint8)
    >>> image[100:120, 100:140] = image[20:90, 200:300] = 255
    >>> tracker = Tracker(lambda rgb: rgb[..., 0] > 127, choose=(120, 110))
    >>> tracker.observe(image).area
    800
    >>> tracker.observe(np.roll(image, 30, axis=1)).centroid.tolist()
    [149.5, 109.5]
    >>> tracker
    Tracker(<lambda>, nearest to (120, 110), last seen at (149.5, 109.5))
    """

    segmenter: Segmenter
    choose: str | ArrayLike = "largest"
    min_area: int = 50
    max_shift: float = 0.3
    max_growth: float = 3.0

    def __post_init__(self) -> None:
        by_name = isinstance(self.choose, str)
        if self.choose not in ("largest", "center") if by_name else np.shape(self.choose) != (2,):
            raise InvalidParameterError(f'choose is "largest", "center" or a pixel (u, v); got {self.choose!r}')
        if not (self.max_shift > 0 and self.max_growth > 1 and self.min_area >= 1):
            raise InvalidParameterError(
                "max_shift is positive, max_growth above 1 and min_area at least 1; "
                f"got max_shift={self.max_shift}, max_growth={self.max_growth}, min_area={self.min_area}"
            )
        self._last: Blob | None = None
        self._region: Region | None = None
        self._shape: tuple[int, ...] = (0, 0)

    def __repr__(self) -> str:
        segmenter = getattr(self.segmenter, "__name__", type(self.segmenter).__name__)
        choose, last = self.choose, "no target yet"
        if not isinstance(choose, str):
            u, v = np.asarray(choose, float)
            choose = f"nearest to ({u:.4g}, {v:.4g})"
        if self._last is not None:
            u, v = self._last.centroid
            last = f"last seen at ({u:.1f}, {v:.1f})"
        return f"Tracker({segmenter}, {choose}, {last})"

    def reset(self) -> None:
        """Forget the target; the next frame selects a new one."""
        self._last = self._region = None

    def expect(self, blob: Blob) -> None:
        """Set the blob to look for in the next frame, after the camera has moved far since the last one.

        Parameters
        ----------
        blob
            Blob of the target, as the next frame should show it.
        """
        self._last = blob

    def observe(self, rgb: NDArray[np.uint8], expected: ArrayLike | None = None) -> Blob | None:
        """Find the target's blob in the next frame; None if it is lost or nothing is in view.

        Parameters
        ----------
        rgb
            Frame, uint8 (H, W, 3).
        expected
            Pixel ``(u, v)`` where the target should be, if the camera's motion is known; by default, where it was last
            seen.
        """
        rgb = check_rgb(rgb)
        mask = check_mask(self.segmenter(rgb), rgb.shape[:2])
        self._shape = mask.shape
        self._region = self._target(regions_from_mask(mask, self.min_area), expected)
        if self._region is None:
            return None
        self._last = self._region.blob
        return self._last

    def __call__(self, rgb: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Mask of the target alone in the next frame, bool (H, W): a tracker is itself a segmenter, with memory."""
        self.observe(rgb)
        return self.mask

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Mask of the target alone in the last frame, bool (H, W); empty if it was lost."""
        return np.zeros(self._shape, np.bool_) if self._region is None else self._region.mask(self._shape)

    def _target(self, regions: list[Region], expected: ArrayLike | None) -> Region | None:
        """Region to follow: the chosen one, or the most likely match of the last. Regions come largest first."""
        last = self._last
        if last is None:
            if isinstance(self.choose, str) and self.choose == "largest":
                return regions[0] if regions else None
            middle = 0.5 * (np.array(self._shape[::-1]) - 1)
            goal = middle if isinstance(self.choose, str) else np.asarray(self.choose, float)
            return min(regions, key=lambda region: math.dist(region.blob.centroid, goal), default=None)
        goal = last.centroid if expected is None else np.asarray(expected, float)
        reach, growth = self.max_shift * self._shape[1], math.log(self.max_growth)
        best, best_cost = None, math.inf
        for region in regions:
            shift = math.dist(region.blob.centroid, goal) / reach
            grown = abs(math.log(region.blob.area / last.area)) / growth
            if shift <= 1 and grown <= 1 and shift + grown < best_cost:
                best, best_cost = region, shift + grown
        return best
