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
        """Blob of all set pixels of a mask; None if there are none.

        Parameters
        ----------
        mask
            Mask, bool (H, W).
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
        u0, v0, u1, v1 = self.bbox
        return u0 <= 0 or v0 <= 0 or u1 >= shape[1] or v1 >= shape[0]

    def fills(self, shape: Sequence[int]) -> bool:
        """Whether the blob covers more than half of the image, or reaches from edge to edge.

        Its moments are then those of the image rather than of an object.

        Parameters
        ----------
        shape
            Shape of the image, (H, W) or (H, W, 3).
        """
        (height, width), (u0, v0, u1, v1) = shape[:2], self.bbox
        across = (u0 <= 0 and u1 >= width) or (v0 <= 0 and v1 >= height)
        return across or self.area > 0.5 * height * width

    @property
    def _major_eigenvalue(self) -> float:
        """Larger eigenvalue of [[mu20, mu11], [mu11, mu02]], px^2."""
        return 0.5 * (self.mu20 + self.mu02 + math.hypot(2 * self.mu11, self.mu20 - self.mu02))
