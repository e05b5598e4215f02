import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skimage.measure import regionprops

from gvp_lib.errors import InvalidParameterError
from gvp_lib.perception.blobs import Blob

pytestmark = pytest.mark.check


def draw(*rows: str) -> np.ndarray:
    return np.array([[c == "#" for c in row] for row in rows])


def ellipse(length: float, width: float, angle: float, u: float, v: float, shape=(200, 200), power=2) -> np.ndarray:
    """Mask of an ellipse with these axes, or of a rectangle where the power is infinite."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    along = (columns - u) * np.cos(angle) + (rows - v) * np.sin(angle)
    across = (rows - v) * np.cos(angle) - (columns - u) * np.sin(angle)
    x, y = np.abs(2 * along / length), np.abs(2 * across / width)
    return np.maximum(x, y) <= 1 if np.isinf(power) else x**power + y**power <= 1


def test_a_small_mask_worked_by_hand() -> None:
    mask = draw(
        ".....",
        ".###.",
        ".....",
    )
    blob = Blob.from_mask(mask)
    assert (blob.area, blob.centroid.tolist(), blob.bbox) == (3, [2, 1], (1, 1, 4, 2))
    assert (blob.mu20, blob.mu11, blob.mu02) == (pytest.approx(2 / 3), 0, 0)
    assert blob.axis_major_length == pytest.approx(4 * np.sqrt(2 / 3))
    assert (blob.axis_minor_length, blob.orientation) == (0, 0)
    assert not blob.centroid.flags.writeable


def test_an_upright_blob_lies_at_plus_and_never_at_minus_a_right_angle() -> None:
    assert Blob(3, np.zeros(2), 0.0, -0.0, 2 / 3, (0, 0, 1, 3)).orientation == np.pi / 2


def test_a_single_pixel_is_a_blob_without_axes_and_no_pixel_is_none() -> None:
    assert Blob.from_mask(draw("..", "..")) is Blob.from_mask(np.zeros((0, 640), bool)) is None
    blob = Blob.from_mask(draw("..", ".#"))
    assert (blob.area, blob.axis_major_length, blob.ratio, blob.orientation_defined) == (1, 0, 1, False)
    assert "orientation undefined" in repr(blob)


@pytest.mark.parametrize("changes", [{"area": 0}, {"centroid": np.zeros(3)}, {"mu20": -1.0}, {"mu02": -0.1}])
def test_a_blob_that_no_mask_has_is_refused(changes) -> None:
    possible = {"area": 4, "centroid": np.zeros(2), "mu20": 1.0, "mu11": 0.0, "mu02": 1.0, "bbox": (0, 0, 2, 2)}
    with pytest.raises(InvalidParameterError, match=r"a positive area, a centroid \(u, v\) and mu20, mu02"):
        Blob(**{**possible, **changes})


def test_moments_agree_with_scikit_image_on_500_random_masks() -> None:
    rng = np.random.default_rng(20)
    oriented = 0
    for k in range(500):
        shape = height, width = rng.integers(5, 200, 2)
        if k % 2:  # an ellipse, part of which may be outside, in an array that is a view of another
            place = rng.uniform(0, np.pi), rng.uniform(0, width), rng.uniform(0, height)
            mask = ellipse(*rng.uniform(6, 200, 2), *place, shape).T[::-1]
        else:
            mask = rng.random(shape) < rng.uniform(0.001, 0.999)
        blob = Blob.from_mask(mask)
        if blob is None:
            assert not mask.any()
            continue
        theirs = regionprops(mask.astype(np.uint8))[0]
        v0, u0, v1, u1 = theirs.bbox
        assert (blob.area, blob.bbox) == (theirs.area, (u0, v0, u1, v1))
        np.testing.assert_allclose(blob.centroid[::-1], theirs.centroid, rtol=1e-6)
        # scikit-image takes a pixel for a point too: no 1/12 on either side.
        np.testing.assert_allclose(blob.axis_major_length, theirs.axis_major_length, rtol=1e-6)
        np.testing.assert_allclose(blob.axis_minor_length, theirs.axis_minor_length, rtol=1e-6, atol=1e-6)
        if blob.orientation_defined:
            oriented += 1
            # Theirs is measured from the rows' axis, modulo pi.
            assert abs(np.sin(blob.orientation - (np.pi / 2 - theirs.orientation))) < 1e-6
    assert oriented > 300


@settings(max_examples=50)
@given(st.floats(10, 80), st.floats(0, np.pi), st.floats(99, 101), st.floats(99, 101), st.sampled_from([2, np.inf]))
def test_a_disc_and_a_square_have_no_orientation_wherever_they_lie_on_the_grid(side, angle, u, v, power) -> None:
    blob = Blob.from_mask(ellipse(side, side, angle, u, v, power=power))
    assert not blob.orientation_defined
    assert np.isnan(blob.orientation)
    assert blob.ratio > 0.8


@pytest.mark.parametrize(
    ("box", "touches", "fills"),
    [
        ((1, 1, 8, 9), False, False),  # 56 of 120 pixels
        ((1, 1, 9, 9), False, True),  # 64
        ((0, 4, 2, 6), True, False),
        ((4, 0, 6, 2), True, False),
        ((10, 4, 12, 6), True, False),
        ((0, 5, 6, 10), True, False),  # two neighboring edges
        ((4, 0, 6, 10), True, True),  # from edge to edge
        ((0, 4, 12, 6), True, True),
    ],
)
def test_a_blob_knows_whether_it_touches_the_border_of_the_image_and_whether_it_fills_it(box, touches, fills) -> None:
    mask = np.zeros((10, 12), bool)
    mask[box[1] : box[3], box[0] : box[2]] = True
    blob = Blob.from_mask(mask)
    assert (blob.touches_border(mask.shape), blob.fills((10, 12, 3))) == (touches, fills)


def test_moments_stay_exact_in_the_corner_of_a_large_picture() -> None:
    mask = np.zeros((4000, 6000), bool)
    mask[3990:3993, 5900:5960] = True
    blob = Blob.from_mask(mask)
    assert blob.axis_major_length == pytest.approx(4 * np.sqrt((60**2 - 1) / 12), rel=1e-12)
    assert blob.axis_minor_length == pytest.approx(4 * np.sqrt((3**2 - 1) / 12), rel=1e-12)
