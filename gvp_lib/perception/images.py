"""Checks of images and masks, once, where they enter the library; and the crops that networks see."""

from __future__ import annotations

from numbers import Integral
from os import PathLike
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidImageError, InvalidParameterError

__all__ = ["check_mask", "check_rgb", "center_crop", "crop_and_resize"]


_NO_MASK_YET = ". An image is no mask yet: a segmenter such as HsvThreshold makes one of it"


def check_rgb(rgb: object) -> NDArray[np.uint8]:
    """``rgb`` where it is an RGB image, uint8 (H, W, 3) and not empty, or as such an array; else InvalidImageError."""
    image, code = as_array(rgb, "image", mode="RGB")
    if image.dtype == np.uint8 and image.ndim == 3 and image.shape[2] == 3 and image.size:
        return image
    if rgb is None:
        hint = ". cv2.imread returns None where there is no file, or none that it can read"
    elif isinstance(rgb, (str, bytes, PathLike)):
        hint = ", perhaps a path. Read it first: cv2.cvtColor(cv2.imread(path), cv2.COLOR_BGR2RGB)"
    else:
        hint = _toward_rgb(image, code)
    raise InvalidImageError(f"an RGB image is a uint8 array of shape (H, W, 3); got {_described(rgb, image)}{hint}")


def check_mask(mask: object, shape: tuple[int, ...] | None = None) -> NDArray[np.bool_]:
    """``mask`` where it is a mask, bool (H, W), or as such an array, and has the picture's ``shape``.

    Else InvalidImageError.
    """
    array, code = as_array(mask, "mask")
    if array.dtype != np.bool_ or array.ndim != 2:
        hint = ". Does the segmenter return what it computed?" if mask is None else _toward_mask(array, code)
        raise InvalidImageError(f"a mask is a bool array of shape (H, W); got {_described(mask, array)}{hint}")
    if shape is not None and array.shape != shape:
        (h, w), (height, width) = array.shape, shape
        if (w, h) == shape:
            hint = f"Rows come first: {code}.T"
        elif array.size and abs(h * width - w * height) <= max(height, width):  # alike, within a pixel
            size = f"({width}, {height}), interpolation=cv2.INTER_NEAREST_EXACT"
            hint = f"To resize it: cv2.resize({code}.astype(numpy.uint8), {size}) > 0"
        else:
            hint = "Their sides are of different ratios: undo what cropped or padded the picture for your network"
        raise InvalidImageError(f"a picture of shape {shape} has a mask of that shape; got {array.shape}. {hint}")
    return array


def as_array(given: Any, code: str, mode: str | None = None) -> tuple[NDArray[Any], str]:
    """Array of what can be one (nested lists, a tensor, Pillow's picture), else one of None; and Python that makes it.

    ``mode`` is Pillow's, to which to convert a picture of 8 bits: the array of a palette's picture has no colors.
    """
    if isinstance(given, np.ndarray):
        return np.asarray(given), code  # itself, but for a matrix and its like
    try:
        if mode and hasattr(given, "getbands") and given.mode[0] not in "IF":
            return np.asarray(given.convert(mode)), code
        if not hasattr(given, "detach"):
            return np.asarray(given), f"numpy.asarray({code})"
        if str(given.dtype) == "torch.bfloat16":  # which NumPy does not know
            given, code = given.float(), f"{code}.float()"
        return given.numpy(force=True), f"{code}.numpy(force=True)"  # from a GPU, and without its gradient
    except Exception:  # whatever a stranger's class may raise
        return np.array(None), code


def _described(given: object, array: NDArray[Any]) -> str:
    """What was given, for a message; ``array`` is what it makes."""
    text = f"{array.dtype} array of shape {array.shape}"
    if isinstance(given, np.ndarray):
        return f"a {text}"
    return f"a {type(given).__name__}" + (f" that makes a {text}" if array.ndim else "")


# The advice is the Python that makes a right array of the one given, as far as its shape, type and values tell, and
# ends the message, behind ": ". Where they don't, there is none: a wrong picture is worse than an error.


def _toward_rgb(image: NDArray[Any], code: str) -> str:
    """Advice for an array that is no RGB image yet."""
    if not image.size:
        return ": an empty image"
    looks = ""
    if image.ndim == 4:
        if len(image) > 1:
            return ", which looks like a batch. Pass its images one by one"
        image, code, looks = image[0], f"{code}[0]", ", which looks like a batch of one"
    if image.ndim == 3 and image.shape[0] in (1, 3, 4) and image.shape[2] > 4:
        image, code = np.moveaxis(image, 0, -1), f"numpy.moveaxis({code}, 0, -1)"
        looks = ", which has its channels first"
    if image.ndim == 3 and image.shape[2] in (1, 2):  # of two, the other is alpha
        image, code = image[..., 0], f"{code}[..., 0]"
    if image.ndim == 2:
        looks = ", which looks gray (for a palette's indices, pass Pillow's picture itself)"
        image, code = np.stack([image] * 3, axis=-1), f"numpy.stack([{code}] * 3, axis=-1)"
    if image.ndim == 3 and image.shape[2] == 4:
        looks = ", which looks RGBA (cv2.imread gives BGRA, for which it would be [..., 2::-1])"
        image, code = image[..., :3], f"{code}[..., :3]"
    return looks + (toward_bytes(image, code) if image.ndim == 3 and image.shape[2] == 3 else "")


def toward_bytes(image: NDArray[Any], code: str) -> str:
    """Advice for an array, not empty, of values that shall be uint8 in 0…255."""
    if image.dtype == np.uint8:
        return f": {code}"
    if image.dtype == np.bool_:
        return f": 255 * {code}.astype(numpy.uint8)"
    if image.dtype.kind not in "iuf":
        return ""
    low, high, floats = float(image.min()), float(image.max()), image.dtype.kind == "f"  # NaN fails every test below
    if floats and low >= -0.1 and high <= 1.1:  # a little over, as a cubic interpolation makes it
        return f". For floats in 0…1: (255 * {code}).round().clip(0, 255).astype(numpy.uint8)"
    if floats and low >= -25 and 16 <= high <= 280:
        return f". For floats in 0…255: {code}.round().clip(0, 255).astype(numpy.uint8)"
    if not floats and low >= 0 and high <= 255:
        return f". For values in 0…255: {code}.astype(numpy.uint8)"
    if low >= 0 and 256 <= high < 2**16:
        bits = next(bits for bits in (10, 12, 14, 16) if high < 2**bits)
        return (
            f", with values up to {high:.0f}. For one of {bits} bits, in RGB (cv2.imread gives BGR): "
            f"({code} / {2 ** (bits - 8)}).astype(numpy.uint8)"
        )
    return f". Its values of {low:.4g}…{high:.4g} are in none of the usual ranges; undo what normalized them"


def _toward_mask(mask: NDArray[Any], code: str) -> str:
    """Advice for an array that is no mask yet."""
    while mask.ndim > 2 and 1 in (len(mask), mask.shape[-1]):
        mask, code = (mask[0], f"{code}[0]") if len(mask) == 1 else (mask[..., 0], f"{code}[..., 0]")
    if mask.ndim == 3 and mask.shape[2] in (3, 4) and mask.size:
        if (mask[..., 3:] != mask[:1, :1, 3:]).any():
            mask, code = mask[..., 3], f"{code}[..., 3]"  # the alpha of what was cut out
        elif (mask[..., :3] == mask[..., :1]).all():
            mask, code = mask[..., 0], f"{code}[..., 0]"  # a gray picture, read in color
        else:
            return _NO_MASK_YET
    if mask.ndim > 2 and len(mask) > 1:
        return f", which looks like a stack of {len(mask)}. Pass that of the object"
    if mask.ndim != 2 or not mask.size or mask.dtype.kind not in "biuf":
        return ""
    if mask.dtype == np.bool_:
        return f": {code}"
    values, counts = np.unique(mask[np.isfinite(mask)], return_counts=True)
    if not values.size:
        return ", without a finite value"
    low, high, floats = float(values[0]), float(values[-1]), mask.dtype.kind == "f"
    if floats and low >= -0.2 and high <= 1.2:
        return f", whose values of {low:.2g}…{high:.2g} look like probabilities: {code} > 0.5"
    if floats and low < 0:
        return f", whose values of {low:.3g}…{high:.3g} look like logits: {code} > 0"
    if len(values) == 1 or (len(values) == 2 and (low == 0 or low < 0 < high)):
        return f", whose values are {' and '.join(f'{value:g}' for value in values)}: {code} > 0"
    # White on black, but blurred at its edges by JPEG or a resize. (Of labels, 255 is often that of borders.)
    black, white = counts[values < 32].sum(), counts[values > 223].sum()
    if low >= 0 and 223 < high < 281 and counts.sum() - black - white < min(black, white) and values[-2] > 31:
        return f", whose values are mostly near 0 and 255: {code} > 127"
    if not floats and (mask[:, 1:] == mask[:, :-1]).mean() > 0.9:
        ours = "the object's, for cv2.grabCut (1, 3)" if (low, high) == (0, 3) else "the object's"
        return f", whose values of {low:g}…{high:g} look like labels. With {ours}: numpy.isin({code}, labels)"
    return _NO_MASK_YET


@checked(own=True)
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
    if not isinstance(side, Integral) or side < 1:
        raise InvalidParameterError(f"a crop is of 1 px or more, as a whole number; got {side!r}")
    if side > min(height, width):
        raise InvalidParameterError(f"a crop of {side} px is larger than the picture, which is {width} x {height}")
    u, v = (width - side) // 2, (height - side) // 2
    return np.ascontiguousarray(rgb[v : v + side, u : u + side]), (u, v)


@checked(own=True)
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
    if crop is not None:
        rgb, _ = center_crop(rgb, crop)
    if size is None:
        return rgb
    if not isinstance(size, Integral) or not 1 <= size < 2**15:  # OpenCV's limit
        raise InvalidParameterError(f"an image is resized to 1 px or more, below 2^15, as a whole number; got {size!r}")
    height, width = rgb.shape[:2]
    short = min(height, width)
    to = (round(width * size / short), round(height * size / short))
    return np.asarray(cv2.resize(rgb, to, interpolation=cv2.INTER_AREA), np.uint8)
