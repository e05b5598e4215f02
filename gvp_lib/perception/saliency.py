"""Segmentation without a color threshold: what differs from the border of the image. Suggested in thesis 2.1."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gvp_lib.errors import InvalidParameterError
from gvp_lib.perception.images import check_rgb

__all__ = ["Saliency"]

# What a surface of one color may vary by, besides what its border shows, in Lab units: much in lightness, for a
# shadow darkens without coloring, and little in a and b.
_SPREAD = np.array((10.0, 4.0, 4.0))


@dataclass(frozen=True)
class Saliency:
    """Segments an object of any color, given only that the border of the image shows the background.

    Each side of the image gives a normal distribution of background color in CIE Lab. A pixel is salient by its
    Mahalanobis distance to the nearest of the four; Otsu's method splits object from background; what the object
    encloses belongs to it, such as a pale spot on a label.

    Distance in Lab of a smoothed image is the frequency-tuned saliency of Achanta et al. (CVPR 2009); the border as
    background is the prior of Wei et al., "Geodesic saliency using background priors" (ECCV 2012).

    Attributes
    ----------
    threshold
        A pixel nearer than this to the background, in standard deviations, is never the object's. So a bare table
        gives an empty mask.
    single
        Keep only the one region that is most salient, large and central. Otherwise keep all, for a tracker to
        choose from.
    border
        Width of the border that counts as background, as a share of the image's shorter side.
    min_area
        Regions of fewer pixels are noise.
    scale
        The work is done on an image this many times smaller, which smooths noise and texture.

    Notes
    -----
    It fails where the object touches most of a border, or has the table's color; and it fills a ring.
    """

    threshold: float = 4.0
    single: bool = True
    border: float = 0.06
    min_area: int = 100
    scale: int = 2

    def __post_init__(self) -> None:
        if not (self.threshold > 0 and 0 < self.border < 0.5 and self.min_area >= 0 and self.scale >= 1):
            raise InvalidParameterError(
                "threshold is positive, border in (0, 0.5), min_area not negative and scale at least 1; "
                f"got threshold={self.threshold}, border={self.border}, min_area={self.min_area}, scale={self.scale}"
            )

    def __call__(self, rgb: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """The mask, bool (H, W); empty where nothing stands out."""
        distance = self.map(rgb)
        # Otsu sees distances in 256 steps, of which the last holds everything farther than any threshold can lie.
        steps = cv2.convertScaleAbs(distance, alpha=255 / max(float(distance.max()), 1e-6))
        step, _ = cv2.threshold(steps, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
        cut = max(self.threshold, float(distance.max()) * step / 255)
        mask: NDArray[Any] = (distance > cut).view(np.uint8)
        kernel = np.ones((3, 3), np.uint8)
        mask = cv2.morphologyEx(cv2.morphologyEx(mask, cv2.MORPH_OPEN, kernel), cv2.MORPH_CLOSE, kernel)
        return self._chosen(_without_holes(mask), distance)

    def map(self, rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Distance of each pixel's color from the background's, in standard deviations; float32 (H, W)."""
        rgb = check_rgb(rgb)
        height, width = rgb.shape[:2]
        small = cv2.resize(
            rgb, (max(1, width // self.scale), max(1, height // self.scale)), interpolation=cv2.INTER_AREA
        )
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

    def _chosen(self, mask: NDArray[Any], distance: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Regions large enough, or the one that is best: its summed saliency, weighted by how central it is."""
        n, labels, stats, centroids = cv2.connectedComponentsWithStats(mask, connectivity=8)
        if n == 1:
            return mask.astype(np.bool_)
        large = stats[:, cv2.CC_STAT_AREA] >= max(self.min_area, 1)
        large[0] = False  # the background
        if self.single and large.any():
            center = 0.5 * (np.array(mask.shape[::-1]) - 1)
            offset = np.linalg.norm((centroids - center) / center.clip(1), axis=1)  # 1 at the middle of a side
            weight = np.bincount(labels.ravel(), distance.ravel(), minlength=n) * np.exp(-(offset**2))
            best = int(np.argmax(np.where(large, weight, 0)))
            return np.equal(labels, best)
        return large[labels]


def _without_holes(mask: NDArray[Any]) -> NDArray[Any]:
    """The mask with each region's holes filled; uint8, as given."""
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return cv2.drawContours(mask, outlines, -1, 1, cv2.FILLED)


def _background(colors: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean (3,) of Lab colors (n, 3), and the matrix (3, 3) that turns a difference from it into deviations.

    An object that reaches into the border is left out: colors far from the median do not count.
    """
    off = np.abs(colors - np.median(colors, axis=0)) / _SPREAD
    kept = colors[(off**2).sum(axis=1) <= np.percentile((off**2).sum(axis=1), 75)]
    mean = kept.mean(axis=0)
    centered = kept - mean
    # Leaving out the outer quarter shrinks the spread of a normal distribution; the factor 2 makes up for it.
    covariance = 2 * centered.T @ centered / len(kept) + np.diag(_SPREAD**2)
    return mean, np.linalg.inv(np.linalg.cholesky(covariance))
