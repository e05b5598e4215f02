"""From a mask to a blob: centroid, orientation and axes from image moments. Thesis 2.1.2; errata 3 to 5."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from gvp_lib.errors import InvalidParameterError
from gvp_lib.perception.images import check_mask
from gvp_lib.picture import Pictured

__all__ = ["Blob"]

# A rectangle one row of pixels longer has a major axis 4 / sqrt(12) px longer. Drawn on a pixel grid, the sides of
# a true square come out up to one row apart, so below one and a half rows nothing tells the axes from each other.
_AXES_DIFFER = 1.5 * 4 / math.sqrt(12)  # px


@dataclass(frozen=True, eq=False)
class Blob(Pictured):
    """The set pixels of a mask, described by their moments of order 0 to 2.

    Every set pixel counts, connected or not, as a point mass at its center: an area is a number of pixels and not that
    inside a contour, and a pixel's own inertia, 1/12, is not added. So a single row of pixels has no width, and n
    pixels in a row have the major axis ``4 sqrt((n^2 - 1) / 12)``.

    Moving the object moves the centroid and nothing else; turning it in the image turns the orientation; scaling it
    scales the axes; each but for pixelation. The centroid of a silhouette is not the projection of the object's
    center, and none of this survives a tilt of the camera.

    Attributes
    ----------
    area
        Number of set pixels: M00 of Eq. 2.4.
    centroid
        ``(u, v)``, shape (2,), px, read-only; Eq. 2.5.
    mu20, mu11, mu02
        Second central moments divided by the area, px^2; Eq. 2.6. The first index counts u, the second v (errata 3).
    bbox
        ``(u0, v0, u1, v1)``, px, so that ``mask[v0:v1, u0:u1]`` holds every set pixel; u1 and v1 are exclusive.
    """

    _figure = "plot_blob"

    area: int
    centroid: NDArray[np.float64]
    mu20: float
    mu11: float
    mu02: float
    bbox: tuple[int, int, int, int]

    def __post_init__(self) -> None:
        centroid = np.array(self.centroid, float)
        if not self.area > 0 or centroid.shape != (2,) or self.mu20 < 0 or self.mu02 < 0:
            raise InvalidParameterError(
                "a blob has a positive area, a centroid (u, v) and mu20, mu02 >= 0; "
                f"got area={self.area}, centroid={self.centroid}, mu20={self.mu20}, mu02={self.mu02}"
            )
        centroid.flags.writeable = False
        object.__setattr__(self, "centroid", centroid)

    @classmethod
    def from_mask(cls, mask: NDArray[np.bool_]) -> Blob | None:
        """The blob of all pixels set in ``mask``, bool (H, W); None where there are none.

        Examples
        --------
        >>> mask = np.zeros((480, 640), bool)
        >>> mask[200:220, 300:360] = True
        >>> blob = Blob.from_mask(mask)
        >>> blob.area, blob.centroid.tolist(), round(blob.axis_major_length, 2), round(blob.axis_minor_length, 2)
        (1200, [329.5, 209.5], 69.27, 23.07)
        """
        pixels = check_mask(mask).view(np.uint8)
        u0, v0, width, height = cv2.boundingRect(pixels) if pixels.size else (0, 0, 0, 0)
        if not width:
            return None
        # Moments of the box alone: quicker, and with small coordinates every sum below is exact in doubles.
        m = cv2.moments(pixels[v0 : v0 + height, u0 : u0 + width], True)
        area, m10, m01 = m["m00"], m["m10"], m["m01"]
        square = area * area
        return cls(
            area=int(area),
            centroid=np.array((u0 + m10 / area, v0 + m01 / area)),
            mu20=(m["m20"] * area - m10 * m10) / square,
            mu11=(m["m11"] * area - m10 * m01) / square,
            mu02=(m["m02"] * area - m01 * m01) / square,
            bbox=(u0, v0, u0 + width, v0 + height),
        )

    @property
    def orientation(self) -> float:
        """Angle of the major axis, rad, from +u towards +v (clockwise on screen), in (-pi/2, pi/2].

        Eq. 2.7 with atan2, without which the angle may be the minor axis's (errata 4). NaN where it is undefined.
        """
        if not self.orientation_defined:
            return math.nan
        angle = 0.5 * math.atan2(2 * self.mu11, self.mu20 - self.mu02)
        return angle if angle > -0.5 * math.pi else 0.5 * math.pi  # atan2(-0.0, -1) is -pi

    @property
    def orientation_defined(self) -> bool:
        """Whether there is a major axis: false for a disc, a square or anything that pixels cannot tell from them.

        That is, where the axes differ by less than one and a half rows of pixels make. True says that the mask has a
        major axis, not that the object's is known to the last digit.
        """
        return self.axis_major_length - self.axis_minor_length > _AXES_DIFFER

    @property
    def axis_major_length(self) -> float:
        """Full major axis of the ellipse with the same second moments, px; Eq. 2.8 corrected (errata 5).

        It is ``4 sqrt(eigenvalue)``: the diameter of an ellipse, but 1.155 times the side of a rectangle.
        """
        return 4 * math.sqrt(self._major_eigenvalue)

    @property
    def axis_minor_length(self) -> float:
        """Full minor axis of that ellipse, px; Eq. 2.9 corrected (errata 5)."""
        major = self._major_eigenvalue
        if not major:
            return 0.0
        # The smaller eigenvalue as determinant / larger: their difference from the trace would cancel in thin blobs.
        return 4 * math.sqrt(max(0.0, self.mu20 * self.mu02 - self.mu11 * self.mu11) / major)

    @property
    def ratio(self) -> float:
        """Minor over major axis, R in thesis 2.3, in [0, 1]; 1 for a single pixel."""
        major = self.axis_major_length
        return self.axis_minor_length / major if major else 1.0

    def touches_border(self, shape: Sequence[int]) -> bool:
        """Whether the blob reaches the edge of an image of ``shape`` (H, W) or (H, W, 3), and so may continue."""
        u0, v0, u1, v1 = self.bbox
        return u0 <= 0 or v0 <= 0 or u1 >= shape[1] or v1 >= shape[0]

    def fills(self, shape: Sequence[int]) -> bool:
        """Whether the blob covers over half of an image of ``shape`` (H, W) or (H, W, 3), or reaches from edge to edge.

        Its moments then are the image's rather than an object's.
        """
        (height, width), (u0, v0, u1, v1) = shape[:2], self.bbox
        across = (u0 <= 0 and u1 >= width) or (v0 <= 0 and v1 >= height)
        return across or self.area > 0.5 * height * width

    @property
    def _major_eigenvalue(self) -> float:
        """The larger eigenvalue of [[mu20, mu11], [mu11, mu02]], px^2."""
        return 0.5 * (self.mu20 + self.mu02 + math.hypot(2 * self.mu11, self.mu20 - self.mu02))
