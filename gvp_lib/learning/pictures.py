"""What is shown of a picture: its middle, scaled down. Thesis 2.4.3; errata 19.

Data sets and the environment share this, so that a network sees in both what it was trained on.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from gvp_lib.errors import InvalidParameterError

__all__ = ["cropped", "shrunk"]


def cropped(rgb: NDArray[np.uint8], side: int) -> tuple[NDArray[np.uint8], tuple[int, int]]:
    """The middle of a picture (thesis 2.4.3), and the pixel (u, v) of its top left corner.

    Raises
    ------
    InvalidParameterError
        The picture is smaller than that.
    """
    height, width = rgb.shape[:2]
    if side < 1:
        raise InvalidParameterError(f"a crop is of 1 px or more; got {side}")
    if side > min(height, width):
        raise InvalidParameterError(f"a crop of {side} px is larger than the picture, which is {width} x {height}")
    u, v = (width - side) // 2, (height - side) // 2
    return np.ascontiguousarray(rgb[v : v + side, u : u + side]), (u, v)


def shrunk(rgb: NDArray[np.uint8], crop: int | None, size: int | None) -> NDArray[np.uint8]:
    """The middle of a picture, scaled by area.

    Parameters
    ----------
    rgb
        uint8 (H, W, 3).
    crop
        Side of the square that is taken, px; None: the whole picture.
    size
        Of what comes out, px; of a whole picture that is not square, the shorter side, so that its proportions stay.
        None: as it is.

    Examples
    --------
    >>> picture = np.zeros((480, 640, 3), np.uint8)
    >>> shrunk(picture, 128, 64).shape, shrunk(picture, None, 60).shape
    ((64, 64, 3), (60, 80, 3))
    """
    if crop is not None:
        rgb, _ = cropped(rgb, crop)
    if size is None:
        return rgb
    height, width = rgb.shape[:2]
    short = min(height, width)
    to = (round(width * size / short), round(height * size / short))
    return np.asarray(cv2.resize(rgb, to, interpolation=cv2.INTER_AREA), np.uint8)
