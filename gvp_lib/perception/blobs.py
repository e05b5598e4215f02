"""Blobs of a mask, described by their image moments, and tracking one of them from picture to picture. Thesis 2.1;
errata 3 to 5."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError
from gvp_lib.perception.images import check_mask, check_rgb
from gvp_lib.perception.segmentation import Segmenter
from gvp_lib.picture import Pictured

__all__ = ["Blob", "Tracker", "blobs_from_mask"]

# A rectangle one row of pixels longer has a major axis 4 / sqrt(12) px longer. Drawn on a pixel grid, the sides of
# a true square come out up to one row apart, so below one and a half rows nothing tells the axes from each other.
_AXES_DIFFER = 1.5 * 4 / math.sqrt(12)  # px


@checked
@dataclass(frozen=True, eq=False)
class Blob(Pictured):
    """Set pixels of a mask, described by their moments of order 0 to 2.

    Attributes
    ----------
    area
        Number of set pixels: M00 of Eq. 2.4.
    centroid
        ``(u, v)``, shape (2,), px, read-only; Eq. 2.5.
    mu20, mu11, mu02
        Second central moments divided by the area, px^2; Eq. 2.6. The first index counts u, the second v (errata 3).
    bbox
        Bounding box ``(u0, v0, u1, v1)``, px, u1 and v1 exclusive: ``mask[v0:v1, u0:u1]`` holds every set pixel.
    pixels
        The blob's own pixels within ``bbox``, bool, read-only; None where only its moments are known.

    Notes
    -----
    Every set pixel counts, connected or not, as a point mass at its center: the area is the number of pixels and not
    the area inside a contour, and a pixel's own inertia, 1/12, is not added. So a single row of pixels has no width,
    and n pixels in a row have the major axis ``4 sqrt((n^2 - 1) / 12)``.

    Up to pixelation, translating the object in the image changes the centroid alone; rotating it, the orientation;
    scaling it, the axes. Under a tilt of the camera everything changes. The centroid of a silhouette is not the
    projection of the object's center.

    Examples
    --------
    >>> from gvp_lib import Blob
    >>> mask = np.zeros((480, 640), bool)
    >>> mask[200:220, 300:360] = True
    >>> blob = Blob.from_mask(mask)
    >>> blob
    Blob(area 1200 px, centroid (329.5, 209.5), axes 69.3 x 23.1 px, orientation 0.0 deg, bbox (300, 200, 360, 220))
    >>> round(blob.ratio, 3)
    0.333
    """

    _figure = "plot_blob"

    area: int
    centroid: NDArray[np.float64]
    mu20: float
    mu11: float
    mu02: float
    bbox: tuple[int, int, int, int]
    pixels: NDArray[np.bool_] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        centroid = np.array(self.centroid, float)
        if not self.area > 0 or centroid.shape != (2,) or self.mu20 < 0 or self.mu02 < 0:
            raise InvalidParameterError(
                "a blob has a positive area, a centroid (u, v) and mu20, mu02 >= 0; "
                f"got area={self.area}, centroid={self.centroid}, mu20={self.mu20}, mu02={self.mu02}"
            )
        centroid.flags.writeable = False
        object.__setattr__(self, "centroid", centroid)
        if self.pixels is not None:
            object.__setattr__(self, "pixels", check_mask(self.pixels))

    @classmethod
    def from_mask(cls, mask: NDArray[np.bool_]) -> Blob | None:
        """Blob of all set pixels of a mask; None if there are none.

        Parameters
        ----------
        mask
            Mask, bool (H, W).
        """
        mask = check_mask(mask)
        u0, v0, width, height = cv2.boundingRect(mask.view(np.uint8)) if mask.size else (0, 0, 0, 0)
        return cls._of(mask[v0 : v0 + height, u0 : u0 + width].copy(), u0, v0) if width else None

    @classmethod
    def _of(cls, pixels: NDArray[np.bool_], u0: int, v0: int) -> Blob:
        """Blob whose pixels, no row or column of which is empty at the border, begin at ``(u0, v0)``."""
        pixels.flags.writeable = False
        # With coordinates from the box's corner, which are small, every sum below is exact in doubles.
        m = cv2.moments(pixels.view(np.uint8), True)
        area, m10, m01 = m["m00"], m["m10"], m["m01"]
        square, (height, width) = area * area, pixels.shape
        return cls(
            area=int(area),
            centroid=np.array((u0 + m10 / area, v0 + m01 / area)),
            mu20=(m["m20"] * area - m10 * m10) / square,
            mu11=(m["m11"] * area - m10 * m01) / square,
            mu02=(m["m02"] * area - m01 * m01) / square,
            bbox=(u0, v0, u0 + width, v0 + height),
            pixels=pixels,
        )

    def __repr__(self) -> str:
        u, v = self.centroid
        angle = f"{math.degrees(self.orientation):.1f} deg" if self.orientation_defined else "undefined"
        return (
            f"Blob(area {self.area} px, centroid ({u:.1f}, {v:.1f}), axes {self.axis_major_length:.1f} x "
            f"{self.axis_minor_length:.1f} px, orientation {angle}, bbox {self.bbox})"
        )

    @property
    def orientation(self) -> float:
        """Angle of the major axis, rad, from +u towards +v (clockwise on screen), in (-pi/2, pi/2]; NaN if undefined.

        Eq. 2.7 with atan2, without which the angle may be that of the minor axis (errata 4).
        """
        if not self.orientation_defined:
            return math.nan
        angle = 0.5 * math.atan2(2 * self.mu11, self.mu20 - self.mu02)
        return angle if angle > -0.5 * math.pi else 0.5 * math.pi  # atan2(-0.0, -1) is -pi

    @property
    def orientation_defined(self) -> bool:
        """Whether the mask has a major axis: false for a disc, a square or what pixels cannot tell from one.

        The axes must differ by more than one and a half rows of pixels make. This does not guarantee the accuracy of
        the object's orientation.
        """
        return self.axis_major_length - self.axis_minor_length > _AXES_DIFFER

    @property
    def axis_major_length(self) -> float:
        """Full major axis of the ellipse with the same second moments, px; Eq. 2.8 (corrected; errata 5).

        ``4 sqrt(eigenvalue)``: the diameter of an ellipse, but 1.155 times the side of a rectangle.
        """
        return 4 * math.sqrt(self._major_eigenvalue)

    @property
    def axis_minor_length(self) -> float:
        """Full minor axis of the same ellipse, px; Eq. 2.9 (corrected; errata 5)."""
        major = self._major_eigenvalue
        if not major:
            return 0.0
        # The smaller eigenvalue as determinant / larger: their difference from the trace would cancel in thin blobs.
        return 4 * math.sqrt(max(0.0, self.mu20 * self.mu02 - self.mu11 * self.mu11) / major)

    @property
    def ratio(self) -> float:
        """Ratio of the minor to the major axis, R in thesis 2.3, in [0, 1]; 1 for a single pixel."""
        major = self.axis_major_length
        return self.axis_minor_length / major if major else 1.0

    def touches_border(self, shape: Sequence[int]) -> bool:
        """Whether the blob reaches the image's border, beyond which it may continue.

        Parameters
        ----------
        shape
            Shape of the image, (H, W) or (H, W, 3).
        """
        (height, width), (u0, v0, u1, v1) = image_size(shape), self.bbox
        return u0 <= 0 or v0 <= 0 or u1 >= width or v1 >= height

    def fills(self, shape: Sequence[int]) -> bool:
        """Whether the blob covers more than half of the image, or reaches from edge to edge.

        Its moments are then those of the image rather than of an object.

        Parameters
        ----------
        shape
            Shape of the image, (H, W) or (H, W, 3).
        """
        (height, width), (u0, v0, u1, v1) = image_size(shape), self.bbox
        across = (u0 <= 0 and u1 >= width) or (v0 <= 0 and v1 >= height)
        return across or self.area > 0.5 * height * width

    def mask(self, shape: Sequence[int]) -> NDArray[np.bool_]:
        """Mask of the blob alone, bool (H, W).

        Parameters
        ----------
        shape
            Shape of the image, (H, W) or (H, W, 3).

        Raises
        ------
        InvalidParameterError
            Only the blob's moments are known, or it lies outside of such an image.
        """
        mask, (u0, v0, u1, v1) = np.zeros(image_size(shape), np.bool_), self.bbox
        if self.pixels is None or mask[v0:v1, u0:u1].shape != self.pixels.shape:
            raise InvalidParameterError(
                f"the mask of a blob needs its pixels, within the image; got {self!r} and an image of shape {shape}"
            )
        mask[v0:v1, u0:u1] = self.pixels
        return mask

    @property
    def _major_eigenvalue(self) -> float:
        """Larger eigenvalue of [[mu20, mu11], [mu11, mu02]], px^2."""
        return 0.5 * (self.mu20 + self.mu02 + math.hypot(2 * self.mu11, self.mu20 - self.mu02))


def image_size(shape: Sequence[int]) -> tuple[int, int]:
    if len(shape) not in (2, 3) or min(shape) < 1:
        raise InvalidParameterError(f"an image's shape is (H, W) or (H, W, 3); got {tuple(shape)}")
    return shape[0], shape[1]


@checked
def blobs_from_mask(mask: NDArray[np.bool_], min_area: int = 1) -> list[Blob]:
    """Blobs of the connected regions of a mask, largest first; pixels that touch at a side or a corner are connected.

    Parameters
    ----------
    mask
        Mask, bool (H, W).
    min_area
        Minimum area of a blob, px; smaller ones are left out.

    Examples
    --------
    >>> [blob.area for blob in blobs_from_mask(np.array([[True, True, False, True]]))]
    [2, 1]
    """
    pixels = check_mask(mask).view(np.uint8)
    u0, v0, width, height = cv2.boundingRect(pixels) if pixels.size else (0, 0, 0, 0)
    if not width:
        return []
    # Only the part of the image where anything is set: labelling all of it costs more than segmenting it.
    _, labels, stats, _ = cv2.connectedComponentsWithStats(pixels[v0 : v0 + height, u0 : u0 + width], connectivity=8)
    blobs = []
    for label in 1 + np.argsort(-stats[1:, cv2.CC_STAT_AREA], kind="stable"):
        u, v, w, h, area = (int(x) for x in stats[label])
        if area < min_area:
            break
        blobs.append(Blob._of(np.equal(labels[v : v + h, u : u + w], label), u0 + u, v0 + v))
    return blobs


@checked
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
        self._seen: Blob | None = None
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
        self._last = self._seen = None

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
        self._seen = self._target(blobs_from_mask(mask, self.min_area), expected)
        if self._seen is not None:
            self._last = self._seen
        return self._seen

    def __call__(self, rgb: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Mask of the target alone in the next frame, bool (H, W): a tracker is itself a segmenter, with memory."""
        self.observe(rgb)
        return self.mask

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Mask of the target alone in the last frame, bool (H, W); empty if it was lost."""
        return np.zeros(self._shape, np.bool_) if self._seen is None else self._seen.mask(self._shape)

    def _target(self, blobs: list[Blob], expected: ArrayLike | None) -> Blob | None:
        """Blob to follow: the chosen one, or the most likely match of the last. Blobs come largest first."""
        last = self._last
        if last is None:
            if isinstance(self.choose, str) and self.choose == "largest":
                return blobs[0] if blobs else None
            middle = 0.5 * (np.array(self._shape[::-1]) - 1)
            goal = middle if isinstance(self.choose, str) else np.asarray(self.choose, float)
            return min(blobs, key=lambda blob: math.dist(blob.centroid, goal), default=None)
        goal = last.centroid if expected is None else np.asarray(expected, float)
        reach, growth = self.max_shift * self._shape[1], math.log(self.max_growth)
        best, best_cost = None, math.inf
        for blob in blobs:
            shift = math.dist(blob.centroid, goal) / reach
            grown = abs(math.log(blob.area / last.area)) / growth
            if shift <= 1 and grown <= 1 and shift + grown < best_cost:
                best, best_cost = blob, shift + grown
        return best
