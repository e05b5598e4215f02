"""What is an image and what is a mask; center crops, resized."""

import cv2
import numpy as np
import pytest

from gvp_lib.errors import InvalidImageError, InvalidParameterError
from gvp_lib.perception.images import center_crop, check_mask, check_rgb, crop_and_resize

pytestmark = pytest.mark.check

RGB = np.random.default_rng(0).integers(0, 256, (480, 640, 3), np.uint8)


@pytest.mark.parametrize(
    ("image", "text"),
    [
        (RGB / 255, r"uint8 array of shape \(H, W, 3\); got a float64 .*\(255 \* image\)\.round\(\)"),
        (RGB[..., 0], "looks gray.*stack"),
        (RGB[..., [0, 1, 2, 0]], r"looks RGBA\. image\[\.\.\., :3\]"),
        (RGB.transpose(2, 0, 1), "channels first.*moveaxis"),
        (RGB[None], "batch"),
        (RGB.astype(np.int64), r"For values in 0…255: image\.astype"),
        (RGB[:0], "empty image"),
        (RGB[0, 0], r"of shape \(3,\)$"),
        ([[1, 2, 3]], "got a list.*asarray"),
        (None, "got a NoneType.*no file"),
        ("brick.png", "got a str, perhaps a path"),
    ],
)
def test_what_is_no_rgb_image_is_refused_with_a_hint(image, text):
    with pytest.raises(InvalidImageError, match=text):
        check_rgb(image)


@pytest.mark.parametrize(
    ("mask", "text"),
    [
        (RGB[..., 0], r"bool array of shape \(H, W\); got a uint8 array .* mask > 0 converts a 0/1 or 0/255"),
        (RGB, "An image is no mask yet: a segmenter"),
        (np.zeros(4, bool), r"of shape \(4,\)$"),
        (np.zeros((240, 320), bool), r"picture of shape \(480, 640\) .*; got \(240, 320\)\. cv2\.resize"),
        ([[True]], "got a list.*asarray"),
        (None, "got a NoneType. Does the segmenter return what it computed"),
    ],
)
def test_what_is_no_mask_of_the_picture_is_refused_with_a_hint(mask, text):
    with pytest.raises(InvalidImageError, match=text):
        check_mask(mask, RGB.shape[:2])


def test_a_picture_is_cropped_to_its_middle_first_and_then_resized_by_area():
    middle, corner = center_crop(RGB, 128)
    assert corner == (256, 176)
    np.testing.assert_array_equal(middle, RGB[176:304, 256:384])
    np.testing.assert_array_equal(crop_and_resize(RGB, 128, None), middle)
    np.testing.assert_array_equal(
        crop_and_resize(RGB, 128, 64), cv2.resize(middle, (64, 64), interpolation=cv2.INTER_AREA)
    )
    assert crop_and_resize(RGB, None, None) is RGB


@pytest.mark.parametrize(("side", "said"), [(481, "larger than the picture, which is 640 x 480"), (0, "1 px or more")])
def test_a_crop_that_is_none_is_refused(side, said):
    with pytest.raises(InvalidParameterError, match=said):
        center_crop(RGB, side)
