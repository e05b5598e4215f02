import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skimage.measure import regionprops

from gvp_lib.errors import InvalidImageError, InvalidParameterError
from gvp_lib.perception.moments import Blob

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
    blob = Blob.from_mask(
        draw(
            ".....",
            ".###.",
            ".....",
        )
    )
    assert (blob.area, blob.centroid.tolist(), blob.bbox) == (3, [2, 1], (1, 1, 4, 2))
    assert (blob.mu20, blob.mu11, blob.mu02) == (pytest.approx(2 / 3), 0, 0)
    assert blob.axis_major_length == pytest.approx(4 * np.sqrt(2 / 3))
    assert (blob.axis_minor_length, blob.orientation) == (0, 0)


def test_the_area_counts_pixels_connected_or_not_and_not_what_a_contour_encloses() -> None:
    assert Blob.from_mask(draw("####", "#..#", "####")).area == 10
    assert Blob.from_mask(draw("#...#")).centroid.tolist() == [2, 0]


@pytest.mark.parametrize(
    ("rows", "angle"),
    [
        (("#...", ".#..", "..#.", "...#"), np.pi / 4),
        (("...#", "..#.", ".#..", "#..."), -np.pi / 4),
        (("#", "#", "#"), np.pi / 2),
    ],
    ids=["falling", "rising", "upright"],
)
def test_the_orientation_is_counted_from_u_towards_v(rows: tuple[str, ...], angle: float) -> None:
    assert Blob.from_mask(draw(*rows)).orientation == pytest.approx(angle)


def test_an_upright_blob_lies_at_plus_and_never_at_minus_a_right_angle() -> None:
    assert Blob(3, np.zeros(2), 0.0, -0.0, 2 / 3, (0, 0, 1, 3)).orientation == np.pi / 2


@pytest.mark.parametrize("shape", [(480, 640), (0, 640)])
def test_an_empty_mask_is_no_blob(shape: tuple[int, int]) -> None:
    assert Blob.from_mask(np.zeros(shape, bool)) is None


def test_a_single_pixel_is_a_blob_without_axes() -> None:
    blob = Blob.from_mask(draw("..", ".#"))
    assert (blob.area, blob.axis_major_length, blob.ratio, blob.orientation_defined) == (1, 0, 1, False)


def test_moments_agree_with_scikit_image_on_500_random_masks() -> None:
    rng = np.random.default_rng(20)
    oriented = 0
    for k in range(500):
        shape = height, width = rng.integers(5, 200, 2)
        if k % 2:  # an ellipse, part of which may be outside
            place = rng.uniform(0, np.pi), rng.uniform(0, width), rng.uniform(0, height)
            mask = ellipse(*rng.uniform(6, 200, 2), *place, shape)
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


@given(st.integers(0, 2**32 - 1), st.integers(-20, 20), st.integers(-20, 20))
def test_moving_the_pixels_moves_the_centroid_and_the_box_and_nothing_else(seed: int, du: int, dv: int) -> None:
    mask = np.zeros((80, 80), bool)
    mask[30:50, 30:50] = np.random.default_rng(seed).random((20, 20)) < 0.3
    blob, moved = Blob.from_mask(mask), Blob.from_mask(np.roll(mask, (dv, du), (0, 1)))
    np.testing.assert_allclose(moved.centroid - blob.centroid, (du, dv), atol=1e-9)
    assert np.subtract(moved.bbox, blob.bbox).tolist() == [du, dv, du, dv]
    assert (moved.area, moved.mu20, moved.mu11, moved.mu02) == (blob.area, blob.mu20, blob.mu11, blob.mu02)


@given(st.integers(0, 2**32 - 1))
def test_a_quarter_turn_of_the_image_turns_the_orientation_by_a_right_angle(seed: int) -> None:
    mask = np.random.default_rng(seed).random((20, 60)) < 0.5
    blob, turned = Blob.from_mask(mask), Blob.from_mask(np.rot90(mask))
    assert (turned.mu20, turned.mu02, turned.mu11) == pytest.approx((blob.mu02, blob.mu20, -blob.mu11))
    assert np.sin(turned.orientation - blob.orientation) ** 2 == pytest.approx(1)


@settings(max_examples=50)
@given(st.floats(10, 80), st.floats(0, np.pi), st.floats(99, 101), st.floats(99, 101), st.sampled_from([2, np.inf]))
def test_a_disc_and_a_square_have_no_orientation_wherever_they_lie_on_the_grid(
    side: float, angle: float, u: float, v: float, power: float
) -> None:
    blob = Blob.from_mask(ellipse(side, side, angle, u, v, power=power))
    assert not blob.orientation_defined
    assert np.isnan(blob.orientation)
    assert blob.ratio > 0.8


@given(st.floats(40, 120), st.floats(0.2, 0.9), st.floats(-np.pi / 2, np.pi / 2))
def test_a_rectangle_has_the_orientation_it_was_drawn_with(length: float, ratio: float, angle: float) -> None:
    blob = Blob.from_mask(ellipse(length, ratio * length, angle, 100, 100, power=np.inf))
    # A grid moves each edge by a fraction of a pixel: that turns a long blob less, and a nearly square one more.
    assert abs(np.sin(blob.orientation - angle)) < 2 / (length * (1 - ratio**2))


@pytest.mark.parametrize(
    ("box", "touches", "fills"),
    [
        ((1, 1, 8, 9), False, False),  # 56 of 120 pixels
        ((1, 1, 9, 9), False, True),  # 64
        ((0, 4, 2, 6), True, False),
        ((4, 0, 6, 2), True, False),
        ((10, 4, 12, 6), True, False),
        ((4, 8, 6, 10), True, False),
        ((0, 0, 6, 5), True, False),  # two neighboring edges
        ((4, 0, 6, 10), True, True),  # from edge to edge
        ((0, 4, 12, 6), True, True),
    ],
)
def test_a_blob_knows_whether_it_touches_the_border_of_the_image_and_whether_it_fills_it(box, touches, fills) -> None:
    mask = np.zeros((10, 12), bool)
    mask[box[1] : box[3], box[0] : box[2]] = True
    blob = Blob.from_mask(mask)
    assert (blob.touches_border(mask.shape), blob.fills((10, 12, 3))) == (touches, fills)


def test_a_blob_cannot_be_changed() -> None:
    blob = Blob.from_mask(draw("##"))
    with pytest.raises(ValueError, match="read-only"):
        blob.centroid[0] = 3
    with pytest.raises(AttributeError):
        blob.area = 3  # type: ignore[misc]


def test_a_view_of_a_mask_is_described_as_its_copy_would_be() -> None:
    mask = np.random.default_rng(0).random((40, 60)) < 0.2
    for view in (mask[::2, ::3], mask[:, ::-1], mask.T, mask[5:, 7:]):
        blob, copied = Blob.from_mask(view), Blob.from_mask(view.copy())
        assert (blob.area, blob.bbox, blob.mu11) == (copied.area, copied.bbox, copied.mu11)


def test_moments_stay_exact_in_the_corner_of_a_large_picture() -> None:
    mask = np.zeros((4000, 6000), bool)
    mask[3990:3993, 5900:5960] = True
    blob = Blob.from_mask(mask)
    assert blob.axis_major_length == pytest.approx(4 * np.sqrt((60**2 - 1) / 12), rel=1e-12)
    assert blob.axis_minor_length == pytest.approx(4 * np.sqrt((3**2 - 1) / 12), rel=1e-12)


def test_what_is_no_mask_and_moments_that_no_pixels_have_are_refused() -> None:
    with pytest.raises(InvalidImageError, match="mask > 0"):
        Blob.from_mask(np.zeros((4, 4)))
    with pytest.raises(InvalidParameterError, match="positive area"):
        Blob(0, np.zeros(2), 1.0, 0.0, 1.0, (0, 0, 1, 1))
