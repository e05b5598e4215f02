"""What is an image and what is a mask; center crops, resized."""

from collections.abc import Callable
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from PIL import Image

from gvp_lib.errors import InvalidImageError, InvalidParameterError
from gvp_lib.perception.images import center_crop, check_mask, check_rgb, crop_and_resize

pytestmark = pytest.mark.check

RGB = np.random.default_rng(0).integers(0, 256, (480, 640, 3), np.uint8)


# What users hand over in place of an RGB image or a mask, and the right one

SMALL = RGB[:48, :64]
TILES = np.kron(np.random.default_rng(1).integers(0, 256, (6, 8, 3), np.uint8), np.ones((8, 8, 1), np.uint8))
SMALL_GRAY = np.stack([SMALL[..., 1]] * 3, axis=-1)
MASK = np.zeros((480, 640), bool)
MASK[200:260, 300:380] = True  # 4800 px
WHITE = 255 * MASK.astype(np.uint8)
SOFT = cv2.GaussianBlur(MASK.astype(np.float32), (0, 0), 1.0)
JPEG = cv2.imencode(".jpg", WHITE, [cv2.IMWRITE_JPEG_QUALITY, 60])[1]
CLUTTER = np.zeros((480, 640), np.int32)  # labels, of which 2 and 3 are the object's
CLUTTER[20:200, 30:200], CLUTTER[MASK], CLUTTER[200:220, 300:380] = 1, 2, 3


def test_pillows_pictures_tensors_and_lists_are_taken_for_the_arrays_that_they_are() -> None:
    for mode in ("P", "RGB", "RGBA", "CMYK", "YCbCr"):
        picture = Image.fromarray(TILES).convert(mode, palette=Image.Palette.ADAPTIVE)
        np.testing.assert_allclose(check_rgb(picture).astype(int), TILES, atol=3, err_msg=mode)
    np.testing.assert_array_equal(check_rgb(Image.fromarray(SMALL[..., 1])), SMALL_GRAY)
    np.testing.assert_array_equal(check_rgb(torch.tensor(SMALL)), SMALL)
    for mask in (MASK.tolist(), torch.tensor(MASK), Image.fromarray(MASK)):
        np.testing.assert_array_equal(check_mask(mask, MASK.shape), MASK)
    assert check_rgb(SMALL) is SMALL
    assert check_mask(MASK) is MASK


def followed(check: Callable[[Any], Any], name: str, given: Any, **names: Any) -> Any:
    """What ``check`` takes after the advice that ends its refusal was followed; at most twice."""
    for _ in range(2):
        with pytest.raises(InvalidImageError) as refusal:
            check(given)
        given = eval(str(refusal.value).rpartition(": ")[2], {"numpy": np, "cv2": cv2, name: given, **names})
        with suppress(InvalidImageError):
            return check(given)
    return check(given)


@pytest.mark.parametrize(
    ("image", "right", "text"),
    [
        (SMALL / 255, SMALL, r"uint8 array of shape \(H, W, 3\); got a float64 .*floats in 0…1"),
        ((SMALL / 255).astype(np.float16) * 1.0001 - 1e-4, SMALL, "floats in 0…1"),
        (SMALL.astype(np.float32), SMALL, "floats in 0…255"),
        (
            SMALL.astype(np.uint16) * 256 + 80,
            SMALL,
            r"up to 65360\. For one of 16 bits, in RGB \(cv2.imread gives BGR\)",
        ),
        (SMALL.astype(np.uint16) * 16 + 15, SMALL, "up to 4095. For one of 12 bits"),
        (SMALL.astype(np.float32) * 257, SMALL, "16 bits"),
        (SMALL.astype(np.int64), SMALL, "For values in 0…255"),
        (SMALL.tolist(), SMALL, "got a list that makes an? int64 array"),
        (SMALL > 127, 255 * (SMALL > 127).astype(np.uint8), "got a bool array"),
        (SMALL[None], SMALL, "batch of one"),
        (SMALL.transpose(2, 0, 1), SMALL, "channels first"),
        (
            torch.tensor(SMALL / 255, requires_grad=True).permute(2, 0, 1)[None],
            SMALL,
            "got a Tensor that makes a float64",
        ),
        (torch.tensor(SMALL / 255, dtype=torch.bfloat16), SMALL, "Tensor that makes a float32"),
        (SMALL[..., [0, 1, 2, 0]], SMALL, r"looks RGBA \(cv2\.imread gives BGRA"),
        (SMALL[..., [0, 1, 2, 0]] / 255, SMALL, "looks RGBA"),
        (SMALL[..., 1], SMALL_GRAY, r"looks gray \(for a palette's indices, pass Pillow's picture"),
        (SMALL[..., 1:2] / 255, SMALL_GRAY, "looks gray"),
        (SMALL[None, ..., 1], SMALL_GRAY, "looks gray"),
        (SMALL[..., [1, 0]], SMALL_GRAY, "looks gray"),
        (Image.fromarray(SMALL[..., 1].astype(np.uint16) * 257), SMALL_GRAY, "looks gray.*16 bits"),
    ],
)
def test_the_advice_for_what_is_no_rgb_image_makes_the_right_one(image, right, text) -> None:
    made = followed(check_rgb, "image", image)
    np.testing.assert_allclose(made.astype(int), right, atol=1)
    with pytest.raises(InvalidImageError, match=text):
        check_rgb(image)


def test_the_advice_for_what_imread_gives_with_an_alpha_makes_the_right_image() -> None:
    image = cv2.imdecode(cv2.imencode(".png", cv2.cvtColor(SMALL, cv2.COLOR_RGB2BGRA))[1], cv2.IMREAD_UNCHANGED)
    with pytest.raises(InvalidImageError, match=r"BGRA, for which it would be \[\.\.\., 2::-1\]\): image"):
        check_rgb(image)
    np.testing.assert_array_equal(image[..., 2::-1], SMALL)


@pytest.mark.parametrize(
    ("image", "text"),
    [
        (SMALL / 64 - 2, r"Its values of -2…1\.984 are in none of the usual ranges; undo what normalized them$"),
        (SMALL / 64, r"Its values of 0…3\.984 are in none"),
        (SMALL / np.nan, r"Its values of nan…nan"),
        (SMALL.astype(np.int16) - 1, r"Its values of -1…254"),
        (np.stack([SMALL] * 2), r"batch\. Pass its images one by one$"),
        (SMALL.astype(object), r"object array of shape \(48, 64, 3\)$"),
        (SMALL[:0], "an empty image$"),
        (SMALL[0, 0], r"of shape \(3,\)$"),
        ([[1], [2, 3]], "got a list$"),
        (None, "got a NoneType.*no file"),
        ("brick.png", "got a str, perhaps a path"),
        (Path("brick.png"), "Path, perhaps a path"),
    ],
)
def test_what_may_mean_anything_is_refused_without_a_guess(image, text) -> None:
    with pytest.raises(InvalidImageError, match=text):
        check_rgb(image)


@pytest.mark.parametrize(
    ("mask", "text"),
    [
        (MASK.astype(np.uint8), "values are 0 and 1: mask > 0"),
        (WHITE, "values are 0 and 255: mask > 0"),
        (WHITE.tolist(), "got a list that .*: numpy.asarray"),
        (np.where(MASK, 1, -1), "values are -1 and 1"),
        (MASK.astype(np.float32), "probabilities: mask > 0.5"),
        (0.01 + 0.98 * SOFT, "probabilities"),
        (cv2.resize(cv2.resize(SOFT, (320, 240)), (640, 480), interpolation=cv2.INTER_CUBIC), "probabilities"),
        (torch.tensor(SOFT)[None], "got a Tensor that makes a float32 array of shape \\(1, 480, 640\\)"),
        (torch.tensor(24 * SOFT - 12, dtype=torch.bfloat16)[None, None], "logits"),
        (255 * SOFT, "mostly near 0 and 255"),
        (cv2.imdecode(JPEG, cv2.IMREAD_GRAYSCALE), "mostly near 0 and 255"),
        (cv2.imdecode(JPEG, cv2.IMREAD_COLOR), "mostly near 0 and 255"),
        (Image.open(BytesIO(JPEG.tobytes())), "got a JpegImageFile that .* mostly near 0 and 255"),
        (np.dstack([RGB, WHITE]), "mostly|values are 0 and 255"),
        (MASK[None], r"shape \(1, 480, 640\): mask\[0\]"),
        (MASK[..., None], r": mask\[\.\.\., 0\]"),
        (MASK[None, ..., None].astype(float), "probabilities"),
        (CLUTTER, r"0…3 look like labels\. With the object's, for cv2\.grabCut \(1, 3\)"),
        (np.where(CLUTTER == 0, 255, CLUTTER).astype(np.uint8), "1…255 look like labels. With the object's:"),
        (MASK[::2, ::2], r"got \(240, 320\)\. To resize it: cv2\.resize"),
        (MASK.T, r"got \(640, 480\)\. Rows come first"),
    ],
)
def test_the_advice_for_what_is_no_mask_of_the_picture_makes_the_right_one(mask, text) -> None:
    def check(given: object) -> np.ndarray:
        return check_mask(given, MASK.shape)

    made = followed(check, "mask", mask, labels=(2, 3))
    assert (made ^ MASK).sum() <= 8, f"{made.sum()} px of {MASK.sum()}"
    with pytest.raises(InvalidImageError, match=text):
        check(mask)


@pytest.mark.parametrize(
    ("mask", "text"),
    [
        (RGB, "An image is no mask yet: a segmenter"),
        (RGB[..., 0], "An image is no mask yet: a segmenter"),
        (RGB[..., 0] / 2.0, "An image is no mask yet: a segmenter"),
        (np.stack([MASK] * 3), "looks like a stack of 3. Pass that of the object$"),
        (MASK / np.nan, "without a finite value$"),
        (MASK.astype(object), r"object array of shape \(480, 640\)$"),
        (np.zeros(4, bool), r"of shape \(4,\)$"),
        (np.zeros((384, 640), bool), r"picture of shape \(480, 640\) .*; got \(384, 640\)\. .*different ratios"),
        ([[True], [True, False]], "got a list$"),
        (None, "got a NoneType. Does the segmenter return what it computed"),
    ],
)
def test_what_may_be_any_mask_is_refused_without_a_guess(mask, text) -> None:
    with pytest.raises(InvalidImageError, match=text):
        check_mask(mask, MASK.shape)


def test_a_picture_is_cropped_to_its_middle_first_and_then_resized_by_area():
    middle, corner = center_crop(RGB, 128)
    assert corner == (256, 176)
    np.testing.assert_array_equal(middle, RGB[176:304, 256:384])
    np.testing.assert_array_equal(crop_and_resize(RGB, 128, None), middle)
    np.testing.assert_array_equal(
        crop_and_resize(RGB, 128, 64), cv2.resize(middle, (64, 64), interpolation=cv2.INTER_AREA)
    )
    assert crop_and_resize(RGB, None, None) is RGB


@pytest.mark.parametrize(
    ("crop", "size", "said"),
    [
        (481, None, "larger than the picture, which is 640 x 480"),
        *((side, None, "a crop is of 1 px or more") for side in (0, 12.5, "12", np.nan)),
        *((None, side, "resized to 1 px or more") for side in (0, -1, 12.5, "12", 10**9)),
    ],
)
def test_a_crop_or_size_that_is_none_is_refused(crop, size, said):
    with pytest.raises(InvalidParameterError, match=said):
        crop_and_resize(RGB, crop, size)
