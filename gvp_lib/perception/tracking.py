"""Which of n blobs is ours, frame after frame, so that a second object in view breaks nothing. Thesis 2.1."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvp_lib.errors import InvalidParameterError
from gvp_lib.perception.images import check_mask
from gvp_lib.perception.moments import Blob
from gvp_lib.perception.segmentation import Segmenter

__all__ = ["Region", "Tracker", "blobs_from_mask", "regions_from_mask"]


@dataclass(frozen=True, eq=False)
class Region:
    """One connected region of a mask.

    Attributes
    ----------
    blob, pixels
        Its moments, in the whole image's pixels; and its pixels within ``blob.bbox``, bool, read-only.
    """

    blob: Blob
    pixels: NDArray[np.bool_]

    def mask(self, shape: Sequence[int]) -> NDArray[np.bool_]:
        """The region alone in an image of ``shape`` (H, W, ...); bool (H, W)."""
        mask = np.zeros(tuple(shape[:2]), np.bool_)
        u0, v0, u1, v1 = self.blob.bbox
        mask[v0:v1, u0:u1] = self.pixels
        return mask


def regions_from_mask(mask: NDArray[np.bool_], min_area: int = 1) -> list[Region]:
    """The connected regions of a mask, bool (H, W), of at least ``min_area`` pixels, largest first.

    Pixels that touch at a side or a corner are connected.
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
    """The blobs of :func:`regions_from_mask`."""
    return [region.blob for region in regions_from_mask(mask, min_area)]


@dataclass(eq=False)
class Tracker:
    """Follows one object through successive frames, among others that the segmenter cannot tell from it.

    The first frame decides which one: by ``choose``. From then on it is the region nearest to where the last one
    was, unless all are too far or of too different a size: then the target is lost, :meth:`observe` gives None, and
    the same target is looked for again in the next frame.

    Attributes
    ----------
    segmenter
        RGB to mask.
    choose
        ``"largest"``, ``"center"`` (nearest to the image's center), or a pixel ``(u, v)`` to be nearest to.
    min_area
        Smaller regions, in pixels, are noise.
    max_shift, max_growth
        Farthest that the centroid may move between two frames, as a share of the image's width; and most that the area
        may grow or shrink, as a factor.

    Notes
    -----
    A region that two touching objects share is one region, and its blob is neither's.
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

    def reset(self) -> None:
        """Forget the target; the next frame chooses one."""
        self._last = self._region = None

    def expect(self, blob: Blob) -> None:
        """Look for ``blob`` in the next frame, for a caller who has moved the camera far since the last one."""
        self._last = blob

    def observe(self, rgb: NDArray[np.uint8], expected: ArrayLike | None = None) -> Blob | None:
        """The target's blob in the next frame, uint8 (H, W, 3); None where it is lost or nothing is in view.

        ``expected`` is the pixel ``(u, v)`` where the target should now be, for a caller who knows how the camera
        moved; by default where it was last seen.
        """
        mask = check_mask(self.segmenter(rgb), rgb.shape[:2])
        self._shape = mask.shape
        self._region = self._target(regions_from_mask(mask, self.min_area), expected)
        if self._region is None:
            return None
        self._last = self._region.blob
        return self._last

    def __call__(self, rgb: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """The target's pixels alone in the next frame: a tracker is a segmenter too, one that remembers."""
        self.observe(rgb)
        return self.mask

    @property
    def mask(self) -> NDArray[np.bool_]:
        """The target's pixels alone in the last frame, bool (H, W); empty where it was lost."""
        return np.zeros(self._shape, np.bool_) if self._region is None else self._region.mask(self._shape)

    def _target(self, regions: list[Region], expected: ArrayLike | None) -> Region | None:
        """The region to follow, or that is most likely the last one again. Regions come largest first."""
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
