"""What stands on a sheet: whatever differs from the plane that all photographs show the same.

A point of the paper, or of the table about it, looks alike from everywhere: its print, and the shadow that an object
casts on it, stay where they are. A point of an object that stands on it falls on another spot of the plane in each
picture. So the plane is put together from all pictures, and each is compared with it. On the sheet the print is known
besides: what looks neither like ink nor like paper is no sample of it, and what the object hides from all pictures is
known, too. No color is told, and the object may have any.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.perception.blobs import blobs_from_mask
from gvp_lib.perception.whole import disk
from gvp_lib.photographs.sheet import Sheet, printed

Picture = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Array = NDArray[np.float32]

_CELL, _COARSE = 0.0005, 0.002  # m of the sheet, and of the table about it, to a cell
_AROUND = 1.0  # of the sheet's size, how far the table is looked at on either side
_SMOOTH = 0.8  # px, of what is compared, because no pose is exact
_ROUNDS = 2
_VOTERS = 16  # pictures of which the plane is put together
_WHITE, _BLACK = 0.85, 0.15  # share of paper from which, and up to which, a cell is one or the other
_LIGHTNESS = 0.8  # weight of lightness against color
_PALE = 22.0  # chroma of paper and of ink, at most
_PAPER, _INK = 28.0, 36.0  # least lightness of paper, and most of ink; weighted, as all below
_WINDOW, _SHARE = 0.006, 0.15  # m; share of such a window that ink and paper each have, to be compared
_CONTRAST = 0.8  # lightness of ink against that of the paper beside it, at most
_USUAL = 72.0, 16.0  # lightness of paper and of ink where every picture shows the object
_ONWARD = 5.0  # cells, about as far as it is carried on where no picture shows it
_ALIKE = 9.0  # distance up to which two samples are of one color
_DIFFERS = 15.0  # distance from the plane beyond which a pixel is the object's
_SHIFTED = 0.5  # share of what lightness changes within a pixel, by which it may be off where a pose is
_WINDOWS = 2.0  # small squares, in which the print is looked for
_VARIED, _NOISE = 4.0, 0.8  # standard deviation of lightness of a print that can be, and of any picture
_ALIKE_ENOUGH = 0.65  # correlation of what is seen with the print, below which it is not that
_BAND, _CLEARLY = 1.2, 25.0  # small squares about an edge; distance across it that tells where it is
_TOLD, _MEDIAN = 0.1, 5  # share of what is told beside a pixel; px that smooth an edge
_SEEN = 2  # samples of a spot, without the object, that tell what it looks like
_GROWN = 5  # px, about what was found before, from which no sample of the plane is taken
_BESIDE = 0.2  # share of the largest region from which another is told, too
_SMALL = 0.02  # share of the picture's shorter side, below which a thing is none


def silhouettes(
    pictures: Sequence[Picture], cameras: Sequence[RigidTransform], lens: CameraIntrinsics, sheet: Sheet
) -> list[Mask]:
    """Mask of what stands on the sheet, in each picture, bool (H, W).

    Parameters
    ----------
    pictures
        Pictures without distortion, uint8 (H, W, 3).
    cameras
        ``sheet_from_camera`` of each.
    lens
        Pinhole that took them.
    sheet
        Sheet as it was printed.
    """
    labs = [_lab(picture) for picture in pictures]
    across, down = ((1 + 2 * _AROUND) * side for side in sheet.size)
    around = _Plane(labs, cameras, lens, (across, down), _COARSE)
    off = around.exposures()
    labs = [lab - each for lab, each in zip(labs, off, strict=True)]
    around.samples -= off[:, None, None]
    paper = _Plane(labs, cameras, lens, sheet.size, _CELL, printed(sheet, _CELL))
    squares = [paper.scale(k) * sheet.fine / _CELL for k in range(len(labs))]
    found: list[Mask] = []
    for _ in range(_ROUNDS):
        without = [(~_grown(mask)).astype(np.float32) for mask in found]
        around.put_together(without)
        paper.put_together(without)
        found = [_found(lab, *_expected(paper, around, k, lab), squares[k]) for k, lab in enumerate(labs)]
    return [
        _regions(_sharpened(mask, lab, *_expected(paper, around, k, lab), squares[k]))
        for k, (mask, lab) in enumerate(zip(found, labs, strict=True))
    ]


def _lab(picture: Picture) -> Array:
    """Lab, of which lightness weighs less: light changes that, and not the color."""
    lab: Array = np.asarray(cv2.cvtColor(picture.astype(np.float32) / 255, cv2.COLOR_RGB2LAB), np.float32)
    lab[..., 0] *= _LIGHTNESS
    return np.asarray(cv2.GaussianBlur(lab, (0, 0), _SMOOTH), np.float32)


class _Plane:
    """A rectangle of the sheet's plane about its middle, in cells, row by row from the upper left."""

    def __init__(
        self,
        labs: Sequence[Array],
        cameras: Sequence[RigidTransform],
        lens: CameraIntrinsics,
        size: tuple[float, float],  # m
        cell: float,  # m
        printed: NDArray[np.float64] | None = None,  # how white each cell is, (h, w), where that is known
    ) -> None:
        step = np.array([[cell, 0, 0.5 * (cell - size[0])], [0, -cell, 0.5 * (size[1] - cell)], [0, 0, 1.0]])
        self.shape = (round(size[1] / cell), round(size[0] / cell)) if printed is None else printed.shape
        self.pixel_from_cell = [lens.matrix @ camera.inv().as_matrix()[:3][:, [0, 1, 3]] @ step for camera in cameras]
        self.samples = np.stack([self._seen_in(lab, k) for k, lab in enumerate(labs)])  # (n, h, w, 3)
        whole = np.ones(labs[0].shape[:2], np.float32)
        self.shown = np.stack([self._seen_in(whole, k) > 0.99 for k in range(len(labs))])  # (n, h, w)
        self.colors = np.zeros((*self.shape, 3), np.float32)
        self.known = np.zeros(self.shape, bool)
        self.white = self.black = np.zeros(self.shape, bool)
        if printed is not None:
            self.white, self.black = printed > _WHITE, printed < _BLACK
            light, pale = self.samples[..., 0], np.hypot(self.samples[..., 1], self.samples[..., 2]) < _PALE
            self.shown &= pale & np.stack([self._legible(each, cell) for each in light])

    def _legible(self, light: Array, cell: float) -> Mask:
        """Where the print is seen: ink darker than the paper beside it, lit or not; alone, each as light as such."""
        side = round(_WINDOW / cell) | 1
        paper, ink = (
            cv2.boxFilter(np.stack([np.where(cells, light, 0), cells], axis=-1).astype(np.float32), -1, (side, side))
            for cells in (self.white, self.black)
        )
        both = (paper[..., 1] > _SHARE) & (ink[..., 1] > _SHARE)
        bright, dark = (each[..., 0] / np.maximum(each[..., 1], 1e-6) for each in (paper, ink))
        half = 0.5 * (bright + dark)
        told = (dark < _CONTRAST * bright) & ~(self.white & (light < half)) & ~(self.black & (light > half))
        plain = ~(self.white & (light < _PAPER)) & ~(self.black & (light > _INK))
        return np.where(both, told, plain)

    def _seen_in(self, picture: Array, k: int) -> Array:
        """What picture number k shows of each cell."""
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        return np.asarray(cv2.warpPerspective(picture, self.pixel_from_cell[k], self.shape[::-1], flags=flags))

    def exposures(self) -> Array:
        """By how much each picture's colors are off from the others', Lab, (n, 3)."""
        often = self.shown.sum(axis=0) > 0.5 * len(self.shown)
        samples, shown = self.samples[:, often], self.shown[:, often]
        middle = np.nanmedian(np.where(shown[..., None], samples, np.nan), axis=0)
        off = [
            np.median((each - middle)[here], axis=0) if here.any() else np.zeros(3)
            for each, here in zip(samples, shown, strict=True)
        ]
        return np.array(off, np.float32)

    def put_together(self, without: Sequence[Array]) -> None:
        """The color that most pictures show of a cell, but for what was found to be the object's."""
        usable = self.shown
        if without:
            usable = self.shown & [self._seen_in(each, k) > 0.99 for k, each in enumerate(without)]
        chosen = np.linspace(0, len(usable) - 1, min(_VOTERS, len(usable))).round().astype(int)
        samples, usable = self.samples[chosen], usable[chosen]
        most = np.zeros(self.shape, int)
        for sample, here in zip(samples, usable, strict=True):
            alike = usable & (_distance(samples, sample) < _ALIKE)
            votes = here * alike.sum(axis=0)
            if (more := votes > most).any():
                total = np.einsum("nk,nkc->kc", alike[:, more], samples[:, more])
                self.colors[more] = total / votes[more][:, None]
                most[more] = votes[more]
        self.known = most >= min(_SEEN, len(usable))
        for cells, light in zip((self.white, self.black), _USUAL, strict=True):
            # Of ink or paper that no picture shows, what is known of it nearest to there: a shadow goes on.
            weights = cv2.GaussianBlur((cells & self.known).astype(np.float32), (0, 0), _ONWARD)[..., None]
            nearest = cv2.GaussianBlur(self.colors * (cells & self.known)[..., None], (0, 0), _ONWARD)
            guess = np.where(weights > 1e-5, nearest / np.maximum(weights, 1e-5), np.array((light, 0, 0), np.float32))
            self.colors = np.where((cells & ~self.known)[..., None], guess, self.colors)
            self.known |= cells

    def scale(self, k: int) -> float:
        """Width of the middle cell in picture number k, px."""
        rows, columns = self.shape
        ends = np.array([[columns / 2, columns / 2 + 1], [rows / 2, rows / 2], [1, 1]])
        pixels = self.pixel_from_cell[k] @ ends
        return float(np.linalg.norm(np.diff(pixels[:2] / pixels[2], axis=1)))

    def expected(self, k: int, lab: Array) -> tuple[Array, Mask]:
        """What picture number k would show without the object, Lab (H, W, 3), and where that is known, (H, W)."""
        size = lab.shape[1::-1]
        colors = cv2.warpPerspective(self.colors, self.pixel_from_cell[k], size, flags=cv2.INTER_LINEAR)
        known = cv2.warpPerspective(self.known.astype(np.float32), self.pixel_from_cell[k], size)
        return np.asarray(colors, np.float32), known > 0.99


def _expected(paper: _Plane, around: _Plane, k: int, lab: Array) -> tuple[Array, Mask, Mask]:
    """What picture number k would show without the object; where the sheet tells, and where only the table does."""
    on_paper, there = paper.expected(k, lab)
    beside, elsewhere = around.expected(k, lab)
    return np.where(there[..., None], on_paper, beside), there, elsewhere & ~there


def _distance(one: Array, other: Array) -> Array:
    off = one - other
    return np.asarray(np.sqrt(np.einsum("...c,...c", off, off)), np.float32)


def _found(lab: Array, expected: Array, on_paper: Mask, beside: Mask, square: float) -> Mask:
    """What differs in a picture from what it would show without the object, holes filled."""
    light = expected[..., 0]
    edge = cv2.dilate(light, np.ones((3, 3))) - cv2.erode(light, np.ones((3, 3)))
    differs = (on_paper | beside) & (_distance(lab, expected) > _DIFFERS + _SHIFTED * edge)
    differs |= on_paper & _illegible(lab[..., 0], light, round(_WINDOWS * square))
    mask = cv2.morphologyEx(differs.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3)))
    return _regions(cv2.morphologyEx(mask, cv2.MORPH_CLOSE, disk(round(1.5 * square))).view(np.bool_))


def _regions(mask: Mask) -> Mask:
    """The largest region and any that comes near it, holes filled; nothing where it is too small to be a thing."""
    blobs = blobs_from_mask(mask, min_area=int((_SMALL * min(mask.shape)) ** 2) + 1)
    filled = np.zeros(mask.shape, np.uint8)
    for blob in blobs:
        if blob.area >= _BESIDE * blobs[0].area:
            region = blob.mask(mask.shape).view(np.uint8)
            outlines, _ = cv2.findContours(region, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
            cv2.drawContours(filled, outlines, -1, 1, cv2.FILLED)
    return filled.view(np.bool_)


def _sharpened(mask: Mask, lab: Array, expected: Array, on_paper: Mask, beside: Mask, square: float) -> Mask:
    """Mask whose edge is where a picture is half way from the object's color, just inside, to what it would be."""
    band = round(_BAND * square)
    inner = cv2.erode(mask.view(np.uint8), disk(band)).astype(np.float32)
    about = (cv2.dilate(mask.view(np.uint8), disk(band)) > inner) & (on_paper | beside)
    weights = cv2.GaussianBlur(inner, (0, 0), band)
    total = cv2.GaussianBlur(lab * inner[..., None], (0, 0), band)
    inside = np.asarray(total / np.maximum(weights, 1e-4)[..., None], np.float32)
    told = about & (weights > 1e-3) & (_distance(inside, expected) > _CLEARLY)
    says = np.where(told, np.sign(_distance(lab, expected) - _distance(lab, inside)), 0).astype(np.float32)
    # Where the print has the object's color, the squares beside it tell.
    near = cv2.GaussianBlur(says, (0, 0), 0.5 * square)
    sharp = np.where(told, says > 0, np.where(about & (np.abs(near) > _TOLD), near > 0, mask))
    return cv2.medianBlur(sharp.astype(np.uint8), _MEDIAN).view(np.bool_)


def _illegible(seen: Array, expected: Array, side: int) -> Mask:
    """Where a print that has much contrast is not what is seen, however it is lit: by how the two correlate."""
    side |= 1
    mean, mean_seen = (cv2.boxFilter(each, -1, (side, side)) for each in (expected, seen))
    varies, seen_varies, together = (
        cv2.boxFilter(one * other, -1, (side, side)) - one_mean * other_mean
        for one, other, one_mean, other_mean in (
            (expected, expected, mean, mean), (seen, seen, mean_seen, mean_seen), (expected, seen, mean, mean_seen),
        )
    )  # fmt: skip
    return (varies > _VARIED**2) & (
        together < _ALIKE_ENOUGH * np.sqrt(varies.clip(0) * (seen_varies.clip(0) + _NOISE**2))
    )


def _grown(mask: Mask) -> Mask:
    return cv2.dilate(mask.view(np.uint8), disk(_GROWN)).view(np.bool_)
