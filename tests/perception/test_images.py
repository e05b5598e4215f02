"""The middle of a picture, scaled down."""

import cv2
import numpy as np
import pytest

from gvp_lib.errors import InvalidParameterError
from gvp_lib.perception.images import cropped, shrunk

pytestmark = pytest.mark.check

RGB = np.random.default_rng(0).integers(0, 256, (480, 640, 3), np.uint8)


def test_a_crop_is_the_middle_and_says_where_it_begins():
    picture, corner = cropped(RGB, 128)
    assert corner == (256, 176)
    np.testing.assert_array_equal(picture, RGB[176:304, 256:384])


def test_a_picture_is_cropped_first_and_then_shrunk_by_area():
    expected = cv2.resize(RGB[176:304, 256:384], (64, 64), interpolation=cv2.INTER_AREA)
    np.testing.assert_array_equal(shrunk(RGB, 128, 64), expected)
    np.testing.assert_array_equal(shrunk(RGB, 128, None), RGB[176:304, 256:384])


def test_a_whole_picture_keeps_its_proportions():
    assert shrunk(RGB, None, 48).shape == (48, 64, 3)
    assert shrunk(RGB, None, None) is RGB


@pytest.mark.parametrize(("side", "said"), [(481, "larger than the picture, which is 640 x 480"), (0, "1 px or more")])
def test_a_crop_that_is_none_is_refused(side, said):
    with pytest.raises(InvalidParameterError, match=said):
        cropped(RGB, side)
