"""Checks of images and masks, once, where they enter the library; and the crops that networks see."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidImageError, InvalidParameterError

__all__ = ["check_mask", "check_rgb", "center_crop", "crop_and_resize"]


def check_rgb(rgb: object) -> NDArray[np.uint8]:
    """``rgb`` itself where it is an RGB image, uint8 (H, W, 3) and not empty; else InvalidImageError."""
    shape: tuple[int, ...] = rgb.shape if isinstance(rgb, np.ndarray) else ()
    if isinstance(rgb, np.ndarray) and rgb.dtype == np.uint8 and len(shape) == 3 and shape[2] == 3 and rgb.size:
        return rgb
    kind = rgb.dtype.kind if isinstance(rgb, np.ndarray) else ""
    first, last = (shape[0], shape[2]) if len(shape) == 3 else (0, 0)
    hints = (
        (rgb is None, ". cv2.imread returns None where there is no file, or none that it can read"),
        (isinstance(rgb, str), ", perhaps a path. Read it first: cv2.cvtColor(cv2.imread(path), cv2.COLOR_BGR2RGB)"),
        (not kind, ". numpy.asarray(image) converts a picture of most libraries"),
        (0 in shape, ": an empty image"),
        (len(shape) == 2, ", which looks gray. numpy.stack([gray] * 3, axis=-1) makes it RGB, though without color"),
        (first == 3 != last, ", which has its channels first. numpy.moveaxis(image, 0, -1) puts them last"),
        (last == 4, ", which looks RGBA. image[..., :3] drops the alpha"),
        (len(shape) == 4, ", which looks like a batch. Pass its images one by one"),
        (last == 3 and kind == "f", ". For floats in 0…1: (255 * image).round().astype(numpy.uint8)"),
        (last == 3, ". For values in 0…255: image.astype(numpy.uint8)"),
    )
    raise InvalidImageError(f"an RGB image is a uint8 array of shape (H, W, 3); got {_described(rgb, hints)}")


def check_mask(mask: object, shape: tuple[int, ...] | None = None) -> NDArray[np.bool_]:
    """``mask`` itself where it is a mask, bool (H, W), and has the picture's ``shape``; else InvalidImageError."""
    ndim = mask.ndim if isinstance(mask, np.ndarray) else 0
    if not (isinstance(mask, np.ndarray) and mask.dtype == np.bool_ and ndim == 2):
        hints = (
            (mask is None, ". Does the segmenter return what it computed?"),
            (not isinstance(mask, np.ndarray), ". numpy.asarray(mask, bool) converts nested lists"),
            (ndim == 3, ". An image is no mask yet: a segmenter such as HsvThreshold makes one of it"),
            (ndim == 2, ". mask > 0 converts a 0/1 or 0/255 image"),
        )
        raise InvalidImageError(f"a mask is a bool array of shape (H, W); got {_described(mask, hints)}")
    if shape is not None and mask.shape != shape:
        raise InvalidImageError(
            f"a picture of shape {shape} has a mask of that shape; got {mask.shape}. "
            "cv2.resize(mask.astype(numpy.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0 enlarges it"
        )
    return mask


def _described(image: object, hints: Iterable[tuple[bool, str]]) -> str:
    """Description of ``image``, and the first hint that applies."""
    given = f"{image.dtype} array of shape {image.shape}" if isinstance(image, np.ndarray) else type(image).__name__
    return f"a {given}" + next((hint for applies, hint in hints if applies), "")


@checked
def center_crop(rgb: NDArray[np.uint8], side: int) -> tuple[NDArray[np.uint8], tuple[int, int]]:
    """Crop the central square of an image (thesis 2.4.3).

    Parameters
    ----------
    rgb
        Image, uint8 (H, W, 3).
    side
        Side of the square, px.

    Returns
    -------
    crop
        Central square, uint8 (side, side, 3).
    corner
        Pixel ``(u, v)`` of its top-left corner in the image.

    Raises
    ------
    InvalidParameterError
        The image is smaller than the square.

    Examples
    --------
    >>> crop, corner = center_crop(np.zeros((480, 640, 3), np.uint8), 128)
    >>> crop.shape, corner
    ((128, 128, 3), (256, 176))
    """
    rgb = check_rgb(rgb)
    height, width = rgb.shape[:2]
    if side < 1:
        raise InvalidParameterError(f"a crop is of 1 px or more; got {side}")
    if side > min(height, width):
        raise InvalidParameterError(f"a crop of {side} px is larger than the picture, which is {width} x {height}")
    u, v = (width - side) // 2, (height - side) // 2
    return np.ascontiguousarray(rgb[v : v + side, u : u + side]), (u, v)


@checked
def crop_and_resize(rgb: NDArray[np.uint8], crop: int | None, size: int | None) -> NDArray[np.uint8]:
    """Crop the center of an image and resize it by area: the input of a network (thesis 2.4.3; errata 19).

    Data sets, policies and the environment share this function, so that a network sees everywhere what it was trained
    on.

    Parameters
    ----------
    rgb
        Image, uint8 (H, W, 3).
    crop
        Side of the central square, px; None: the whole image.
    size
        Side of the result, px; for a whole image that is not square, its shorter side, and the aspect ratio stays.
        None: not resized.

    Examples
    --------
    >>> image = np.zeros((480, 640, 3), np.uint8)
    >>> crop_and_resize(image, 128, 64).shape, crop_and_resize(image, None, 60).shape
    ((64, 64, 3), (60, 80, 3))
    """
    rgb = check_rgb(rgb)
    if size is not None and size < 1:
        raise InvalidParameterError(f"a picture's size is 1 px or more; got {size}")
    if crop is not None:
        rgb, _ = center_crop(rgb, crop)
    if size is None:
        return rgb
    height, width = rgb.shape[:2]
    short = min(height, width)
    to = (round(width * size / short), round(height * size / short))
    return np.asarray(cv2.resize(rgb, to, interpolation=cv2.INTER_AREA), np.uint8)
