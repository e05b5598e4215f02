"""Whole silhouettes of things of many colors: what any segmenter leaves, made whole; GrabCut; and colors learned from
a few marked pictures, for the next.

A print cuts holes and notches into what one hue finds, and half a silhouette is worse than none: a fit believes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError
from gvp_lib.perception.blobs import blobs_from_mask
from gvp_lib.perception.images import as_array, check_mask, check_rgb
from gvp_lib.perception.segmentation import Segmenter, region_mask
from gvp_lib.picture import count

__all__ = ["GrabCut", "LearnedSegmenter", "Whole"]

Picture = NDArray[np.uint8]
Mask = NDArray[np.bool_]

_AROUND = 0.5  # of a silhouette's size, how much of the picture about it tells the background's colors
_FEWEST = 8  # pixels of the object's inside, below which a cut has nothing to go by
_SMALL = 320  # px of the longer side of a picture whose pixels are compared with those learned
_SAMPLES = 2400  # pixels of the object, and as many of what is about it, of each marked picture
_GAINS = (0.8, 1.0, 1.25)  # light that a marked picture might have been taken in
_LIGHTNESS, _NEAR, _WIDE, _BLURRED = 0.6, 0.7, 3.0, 0.8  # weight against color; px; px, and that color's weight
_SMOOTH = 1.0  # px, of the votes
_SURELY = 0.35  # share of votes below which a pixel is not the object's
_LOOSE = 0.5  # relative, by which a neighbor may be farther than the nearest: twice as quick


@checked
@dataclass(frozen=True)
class Whole:
    """What another segmenter finds, made whole.

    Parameters
    ----------
    segmenter
        RGB uint8 (H, W, 3) to mask bool (H, W): one of ours, or your own.
    largest
        Whether to keep the largest region alone.
    fill
        Whether to fill what a region encloses.
    hull
        Whether to take the convex hull of what is left, which fills notches, too: right for a box or a can, and wrong
        for a mug with a handle.

    Examples
    --------
    >>> from gvp_lib import HsvThreshold
    >>> red = HsvThreshold(hue=(345, 15), saturation=(0.4, 1), value=(0.2, 1))
    >>> image = np.full((480, 640, 3), 128, np.uint8)
    >>> image[200:220, 300:360] = 200, 20, 30
    >>> image[205:215, 310:330] = 255  # a white label
    >>> int(red(image).sum()), int(Whole(red)(image).sum())
    (1000, 1200)
    """

    segmenter: Segmenter
    largest: bool = True
    fill: bool = True
    hull: bool = False

    def __repr__(self) -> str:
        return f"Whole({_named(self.segmenter)}, largest={self.largest}, fill={self.fill}, hull={self.hull})"

    def __call__(self, rgb: Picture) -> Mask:
        """Mask, bool (H, W); empty where the segmenter's is."""
        rgb = check_rgb(rgb)
        return self.of(check_mask(self.segmenter(rgb), rgb.shape[:2]))

    def of(self, mask: Mask) -> Mask:
        """A mask made whole, bool (H, W).

        Parameters
        ----------
        mask
            Mask, bool (H, W).
        """
        return _whole(check_mask(mask), self.largest, self.fill, self.hull)


def _whole(mask: Mask, largest: bool = True, fill: bool = True, hull: bool = False) -> Mask:
    blobs = blobs_from_mask(mask)
    if not blobs:
        return mask
    kept = (blobs[0].mask(mask.shape) if largest else mask).astype(np.uint8)
    if fill or hull:
        outlines, _ = cv2.findContours(kept, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        if hull:
            outlines = (cv2.convexHull(np.concatenate(outlines)),)
        kept = np.asarray(cv2.drawContours(kept, outlines, -1, 1, cv2.FILLED), np.uint8)
    return kept.view(np.bool_)


@checked
@dataclass(frozen=True)
class GrabCut:
    """Segmenter of a thing of many colors by OpenCV's GrabCut, begun from a box, a mark, or another segmenter.

    Object and background each get a mixture of colors, learned where it is sure what is which; the cut between them
    goes where the picture has edges. (Rother, Kolmogorov and Blake, SIGGRAPH 2004.)

    Parameters
    ----------
    start
        Box ``(u0, v0, u1, v1)``, px, that holds the object; or a mark, bool (H, W), of some pixels that are the
        object's; or a segmenter, whose rough silhouette is right but for its edge. None: for :meth:`refined`, or from
        what differs from the sheet in :func:`gvp_lib.photographs.views_from_photographs`.
    rounds
        How often colors are learned and the cut is made.
    band
        Width of the band about a rough silhouette's edge in which the cut may go, as a share of its size (the root of
        its area), to either side.
    longest
        Longer side, px, to which a picture is reduced: a cut takes time.

    Notes
    -----
    A shadow beside an object as dark goes with it, and so does what has the object's colors. A
    :class:`LearnedSegmenter` learns from a marked picture what is shadow.

    Examples
    --------
    >>> image = np.full((240, 320, 3), 128, np.uint8)
    >>> image[100:140, 150:180], image[100:140, 180:210] = (200, 20, 30), (20, 30, 200)
    >>> mask = GrabCut((140, 90, 220, 150))(image)
    >>> bool(mask[120, 160] and mask[120, 200]), bool(mask[95, 145])
    (True, False)
    """

    start: Segmenter | ArrayLike | None = None
    rounds: int = 3
    band: float = 0.08
    longest: int = 800

    def __post_init__(self) -> None:
        if not (self.rounds >= 1 and 0 < self.band <= 1 and self.longest >= 32):
            raise InvalidParameterError(
                "rounds are 1 or more, band is a share in (0, 1] and longest 32 px or more; "
                f"got {self.rounds}, {self.band} and {self.longest}"
            )

    def __repr__(self) -> str:
        start: Any = self.start
        if callable(start):
            start = _named(start)
        elif start is not None:
            array, _ = as_array(start, "start")
            start = f"a mark {array.shape}" if array.size > 4 else tuple(array.ravel().tolist())
        return f"GrabCut({start}, rounds={self.rounds}, band={self.band:g}, longest={self.longest})"

    def __call__(self, rgb: Picture) -> Mask:
        """Mask, bool (H, W); empty where a segmenter to start from finds nothing."""
        rgb = check_rgb(rgb)
        if self.start is None:
            raise InvalidParameterError(
                "GrabCut begins from a box (u0, v0, u1, v1), a mark, bool (H, W), or another segmenter: "
                "GrabCut(Saliency()); without one it refines a mask: GrabCut().refined(rgb, mask)"
            )
        if callable(self.start):
            return self.refined(rgb, check_mask(self.start(rgb), rgb.shape[:2]))
        small = _reduced(rgb, self.longest)
        here = _resized(region_mask(rgb, self.start), small.shape)
        if as_array(self.start, "start")[0].size > 4:  # a mark, and no box
            seeds = np.where(here, cv2.GC_FGD, cv2.GC_PR_BGD).astype(np.uint8)
            for side in (seeds[0], seeds[-1], seeds[:, 0], seeds[:, -1]):
                side[side != cv2.GC_FGD] = cv2.GC_BGD
        else:
            seeds = np.where(here, cv2.GC_PR_FGD, cv2.GC_BGD).astype(np.uint8)
        return _enlarged(self._cut(small, seeds), rgb.shape)

    def refined(self, rgb: Picture, rough: Mask, background: Mask | None = None) -> Mask:
        """A rough silhouette whose edge goes where the picture's does, bool (H, W).

        Parameters
        ----------
        rgb
            Image, uint8 (H, W, 3).
        rough
            Silhouette that is right but for its edge, bool (H, W).
        background
            Pixels that are surely not the object's, bool (H, W).
        """
        rgb = check_rgb(rgb)
        rough = check_mask(rough, rgb.shape[:2])
        small = _reduced(rgb, self.longest)
        mask = _resized(rough, small.shape)
        v, u = np.nonzero(mask)
        if not v.size:
            return rough
        size = np.sqrt(v.size)
        round_ = disk(max(2, round(self.band * size)))
        around = max(2 * len(round_), round(_AROUND * size))
        part = slice(max(0, v.min() - around), v.max() + around + 1), slice(max(0, u.min() - around), u.max() + around)
        inner, outer = cv2.erode(mask.view(np.uint8), round_), cv2.dilate(mask.view(np.uint8), round_)
        seeds = np.where(mask, cv2.GC_PR_FGD, np.where(outer, cv2.GC_PR_BGD, cv2.GC_BGD)).astype(np.uint8)
        seeds[inner > 0] = cv2.GC_FGD
        if background is not None:
            seeds[_resized(check_mask(background, rgb.shape[:2]), small.shape)] = cv2.GC_BGD
        cut = np.zeros_like(mask)
        cut[part] = self._cut(np.ascontiguousarray(small[part]), seeds[part].copy())
        return _enlarged(cut, rgb.shape)

    def _cut(self, rgb: Picture, seeds: NDArray[np.uint8]) -> Mask:
        """The cut between what surely is the object and what surely is not; the object's seeds where it cannot be."""
        ours = (seeds == cv2.GC_FGD) | (seeds == cv2.GC_PR_FGD)
        if min(np.count_nonzero(ours), np.count_nonzero(~ours)) < _FEWEST:
            return ours
        around, object_ = np.zeros((1, 65)), np.zeros((1, 65))  # a mixture of colors each
        cv2.setRNGSeed(0)  # they begin by k-means
        cv2.grabCut(rgb, seeds, (0, 0, 1, 1), around, object_, self.rounds, cv2.GC_INIT_WITH_MASK)
        return np.asarray((seeds == cv2.GC_FGD) | (seeds == cv2.GC_PR_FGD), np.bool_)


@checked
class LearnedSegmenter:
    """Segmenter that learns a thing's colors, and those about it, from a few pictures in which it is marked.

    A pixel is the object's where most of the marked pixels that look like it are: by color, by the color about it, and
    by how much that varies. The marked pictures count in darker and in brighter light, too. The region that the votes
    are surest of, of those within the picture, is then refined by :class:`GrabCut`. Two to four pictures from different
    sides do; what none of them shows, such as another floor in the background, may be taken for either.

    Parameters
    ----------
    pictures
        Pictures, uint8 (H, W, 3).
    masks
        Mask of the object in each, bool (H, W), with object and background.
    refine
        How the edge is found in the end; None: as the votes have it.
    neighbors
        Number of marked pixels that vote.

    Examples
    --------
    >>> image = np.full((240, 320, 3), 128, np.uint8)
    >>> image[100:140, 150:180], image[100:140, 180:210] = (200, 20, 30), (20, 30, 200)
    >>> mask = np.zeros((240, 320), bool)
    >>> mask[100:140, 150:210] = True
    >>> learned = LearnedSegmenter([image], [mask])
    >>> bool((learned(np.roll(image, 40, axis=1)) ^ np.roll(mask, 40, axis=1)).sum() < 100)
    True
    """

    def __init__(
        self,
        pictures: Sequence[Picture],
        masks: Sequence[Mask],
        *,
        refine: GrabCut | None = GrabCut(),
        neighbors: int = 9,
    ) -> None:
        if not 1 <= len(pictures) == len(masks) or neighbors < 1:
            raise InvalidParameterError(
                "it learns from a picture or more, each with its mask, and 1 or more neighbors vote; got "
                f"{count(len(pictures), 'picture')}, {count(len(masks), 'mask')} and neighbors={neighbors}"
            )
        rng = np.random.default_rng(0)
        found: list[NDArray[np.float32]] = []
        ours: list[Mask] = []
        for k, (picture, given) in enumerate(zip(pictures, masks, strict=True)):
            rgb = check_rgb(picture)
            small = _reduced(rgb, _SMALL)
            mask = _resized(check_mask(given, rgb.shape[:2]), small.shape)
            if mask.all() or not mask.any():
                raise InvalidParameterError(
                    f"a mask to learn from marks the object and leaves the background; that of number {k} marks "
                    f"{'all' if mask.all() else 'nothing'}"
                )
            for gain in _GAINS:
                looks = _looks(np.clip(gain * small, 0, 255).astype(np.uint8))[0]
                for which in (mask, ~mask):
                    at = np.flatnonzero(which)
                    at = rng.choice(at, min(_SAMPLES // len(_GAINS), len(at)), replace=False)
                    found.append(looks[at])
                    ours.append(mask.ravel()[at])
        self._tree, self._ours = cKDTree(np.concatenate(found)), np.concatenate(ours)
        self.refine, self.neighbors = refine, min(neighbors, len(self._ours))

    def __repr__(self) -> str:
        return f"LearnedSegmenter({count(len(self._ours), 'pixel')}, refine={self.refine})"

    def __call__(self, rgb: Picture) -> Mask:
        """Mask of the region that the votes are surest of, holes filled, bool (H, W); empty where there is none."""
        rgb = check_rgb(rgb)
        votes = self.votes(rgb)
        mask = votes > 0.5
        regions = blobs_from_mask(mask)
        if not regions:
            return mask
        # What goes on beyond the picture's border is rather a background that no marked picture showed.
        regions = [each for each in regions if not each.touches_border(mask.shape)] or regions
        sure = np.where(mask, 2 * votes - 1, 0)
        best = max(regions, key=lambda each: float(sure[each.mask(mask.shape)].sum()))
        rough = _whole(best.mask(mask.shape))
        return rough if self.refine is None else _whole(self.refine.refined(rgb, rough, votes < _SURELY))

    def votes(self, rgb: Picture) -> NDArray[np.float32]:
        """Share of the marked pixels like each one that are the object's, float32 (H, W).

        Parameters
        ----------
        rgb
            Image, uint8 (H, W, 3).
        """
        rgb = check_rgb(rgb)
        looks, shape = _looks(_reduced(rgb, _SMALL))
        _, nearest = self._tree.query(looks, k=self.neighbors, eps=_LOOSE)
        share = self._ours[nearest].reshape(len(looks), -1).mean(axis=1).astype(np.float32).reshape(shape)
        smooth = cv2.GaussianBlur(share, (0, 0), _SMOOTH)
        return np.asarray(cv2.resize(smooth, rgb.shape[1::-1], interpolation=cv2.INTER_LINEAR), np.float32)


def _named(segmenter: Any) -> str:
    return str(getattr(segmenter, "__name__", type(segmenter).__name__))


def _looks(rgb: Picture) -> tuple[NDArray[np.float32], tuple[int, int]]:
    """What pixels look like, (n, 7): color, the color about them, and how much lightness varies there."""
    lab = np.asarray(cv2.cvtColor(rgb.astype(np.float32) / 255, cv2.COLOR_RGB2LAB), np.float32)
    lab[..., 0] *= _LIGHTNESS
    near, wide = cv2.GaussianBlur(lab, (0, 0), _NEAR), cv2.GaussianBlur(lab, (0, 0), _WIDE)
    squared = cv2.GaussianBlur(lab[..., :1] ** 2, (0, 0), _WIDE)
    varies = np.sqrt(np.maximum(squared - wide[..., 0] ** 2, 0))[..., None]
    looks = np.concatenate([near, _BLURRED * wide, varies], axis=-1)
    return looks.reshape(-1, looks.shape[-1]), (rgb.shape[0], rgb.shape[1])


def _reduced(rgb: Picture, longest: int) -> Picture:
    scale = min(1.0, longest / max(rgb.shape[:2]))
    to = max(1, round(scale * rgb.shape[1])), max(1, round(scale * rgb.shape[0]))
    return rgb if scale == 1 else np.asarray(cv2.resize(rgb, to, interpolation=cv2.INTER_AREA), np.uint8)


def _resized(mask: Mask, shape: tuple[int, ...]) -> Mask:
    if mask.shape == shape[:2]:
        return mask
    return np.asarray(cv2.resize(mask.astype(np.float32), shape[1::-1], interpolation=cv2.INTER_AREA) > 0.5)


def _enlarged(mask: Mask, shape: tuple[int, ...]) -> Mask:
    if mask.shape == shape[:2]:
        return mask
    return np.asarray(cv2.resize(mask.astype(np.float32), shape[1::-1], interpolation=cv2.INTER_LINEAR) > 0.5)


def disk(radius: int) -> NDArray[np.uint8]:
    """A round structuring element, (2 r + 1, 2 r + 1)."""
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1)), np.uint8)
