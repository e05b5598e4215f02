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


def blob_of(mask: np.ndarray) -> Blob:
    blob = Blob.from_mask(mask)
    assert blob is not None
    return blob


def disc(radius: float, u: float = 60.0, v: float = 60.0, size: int = 120) -> np.ndarray:
    rows, columns = np.mgrid[:size, :size]
    return (columns - u) ** 2 + (rows - v) ** 2 <= radius**2


def rectangle(length: float, width: float, angle: float, u: float = 100.0, v: float = 100.0) -> np.ndarray:
    rows, columns = np.mgrid[:200, :200]
    along = (columns - u) * np.cos(angle) + (rows - v) * np.sin(angle)
    across = -(columns - u) * np.sin(angle) + (rows - v) * np.cos(angle)
    return (abs(along) <= length / 2) & (abs(across) <= width / 2)


def test_a_small_mask_worked_by_hand() -> None:
    blob = blob_of(
        draw(
            ".....",
            ".###.",
            ".....",
        )
    )
    assert blob.area == 3
    assert blob.centroid.tolist() == [2, 1]
    assert (blob.mu20, blob.mu11, blob.mu02) == (pytest.approx(2 / 3), 0, 0)
    assert blob.bbox == (1, 1, 4, 2)
    assert blob.axis_major_length == pytest.approx(4 * np.sqrt(2 / 3))
    assert blob.axis_minor_length == 0
    assert blob.orientation == 0


def test_the_area_counts_pixels_and_not_what_a_contour_encloses() -> None:
    ring = draw(
        "####",
        "#..#",
        "####",
    )
    assert blob_of(ring).area == 10


def test_unconnected_pixels_all_count() -> None:
    assert blob_of(draw("#...#")).centroid.tolist() == [2, 0]


def test_a_diagonal_leans_from_u_towards_v() -> None:
    falling = blob_of(draw("#...", ".#..", "..#.", "...#"))
    rising = blob_of(draw("...#", "..#.", ".#..", "#..."))
    assert falling.orientation == pytest.approx(np.pi / 4)
    assert rising.orientation == pytest.approx(-np.pi / 4)


def test_an_upright_blob_lies_at_plus_and_never_at_minus_a_right_angle() -> None:
    upright = blob_of(draw("#", "#", "#"))
    assert upright.orientation == np.pi / 2
    assert Blob(3, np.zeros(2), 0.0, -0.0, 2 / 3, (0, 0, 1, 3)).orientation == np.pi / 2


def test_an_empty_mask_is_no_blob() -> None:
    assert Blob.from_mask(np.zeros((480, 640), bool)) is None
    assert Blob.from_mask(np.zeros((0, 640), bool)) is None


def test_a_single_pixel_is_a_blob_without_axes() -> None:
    blob = blob_of(draw("..", ".#"))
    assert (blob.area, blob.axis_major_length, blob.ratio) == (1, 0, 1)
    assert not blob.orientation_defined


def test_moments_agree_with_scikit_image_on_500_random_masks() -> None:
    rng = np.random.default_rng(20)
    oriented = 0
    for k in range(500):
        height, width = rng.integers(5, 200, 2)
        if k % 2:  # an ellipse, part of which may be outside
            v, u = np.mgrid[:height, :width]
            turn = rng.uniform(0, np.pi)
            du, dv = u - rng.uniform(0, width), v - rng.uniform(0, height)
            along, across = du * np.cos(turn) + dv * np.sin(turn), dv * np.cos(turn) - du * np.sin(turn)
            mask = (along / rng.uniform(3, 100)) ** 2 + (across / rng.uniform(3, 100)) ** 2 <= 1
        else:
            mask = rng.random((height, width)) < rng.uniform(0.001, 0.999)
        blob = Blob.from_mask(mask)
        if blob is None:
            assert not mask.any()
            continue
        theirs = regionprops(mask.astype(np.uint8))[0]
        assert blob.area == theirs.area
        v0, u0, v1, u1 = theirs.bbox
        assert blob.bbox == (u0, v0, u1, v1)
        np.testing.assert_allclose(blob.centroid[::-1], theirs.centroid, rtol=1e-6)
        # scikit-image takes a pixel for a point too: no 1/12 on either side.
        np.testing.assert_allclose(blob.axis_major_length, theirs.axis_major_length, rtol=1e-6)
        np.testing.assert_allclose(blob.axis_minor_length, theirs.axis_minor_length, rtol=1e-6, atol=1e-6)
        if blob.orientation_defined:
            oriented += 1
            # Theirs is measured from the rows' axis, modulo pi.
            difference = blob.orientation - (np.pi / 2 - theirs.orientation)
            assert abs((difference + np.pi / 2) % np.pi - np.pi / 2) < 1e-6
    assert oriented > 300


@given(st.integers(0, 2**32 - 1), st.integers(-20, 20), st.integers(-20, 20))
def test_moving_the_pixels_moves_the_centroid_and_the_box_and_nothing_else(seed: int, du: int, dv: int) -> None:
    mask = np.zeros((80, 80), bool)
    mask[30:50, 30:50] = np.random.default_rng(seed).random((20, 20)) < 0.3
    blob, moved = blob_of(mask), blob_of(np.roll(mask, (dv, du), (0, 1)))
    np.testing.assert_allclose(moved.centroid - blob.centroid, (du, dv), atol=1e-9)
    assert np.subtract(moved.bbox, blob.bbox).tolist() == [du, dv, du, dv]
    assert (moved.area, moved.mu20, moved.mu11, moved.mu02) == (blob.area, blob.mu20, blob.mu11, blob.mu02)


@given(st.integers(0, 2**32 - 1))
def test_a_quarter_turn_of_the_image_turns_the_orientation_by_a_right_angle(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mask = rng.random((20, 60)) < 0.5
    blob, turned = blob_of(mask), blob_of(np.rot90(mask))
    assert (turned.mu20, turned.mu02) == pytest.approx((blob.mu02, blob.mu20))
    assert turned.mu11 == pytest.approx(-blob.mu11)
    assert np.sin(turned.orientation - blob.orientation) ** 2 == pytest.approx(1)


@settings(max_examples=30)
@given(st.floats(5, 50), st.floats(59, 61), st.floats(59, 61))
def test_a_disc_has_no_orientation_wherever_it_lies_on_the_grid(radius: float, u: float, v: float) -> None:
    blob = blob_of(disc(radius, u, v))
    assert not blob.orientation_defined
    assert np.isnan(blob.orientation)
    assert blob.ratio > 0.9


@settings(max_examples=50)
@given(st.floats(5, 80), st.floats(0, np.pi), st.floats(99, 101), st.floats(99, 101))
def test_a_square_has_no_orientation_however_it_is_turned(side: float, angle: float, u: float, v: float) -> None:
    assert not blob_of(rectangle(side, side, angle, u, v)).orientation_defined


@given(st.floats(40, 120), st.floats(0.2, 0.9), st.floats(-np.pi / 2, np.pi / 2))
def test_a_rectangle_has_the_orientation_it_was_drawn_with(length: float, ratio: float, angle: float) -> None:
    blob = blob_of(rectangle(length, ratio * length, angle))
    assert blob.orientation_defined
    # A grid moves each edge by a fraction of a pixel: that turns a long blob less, and a nearly square one more.
    assert abs(np.sin(blob.orientation - angle)) < 2 / (length * (1 - ratio**2))


def test_touching_the_border_is_told_for_each_side() -> None:
    mask = np.zeros((10, 12), bool)
    mask[4:6, 4:6] = True
    assert not blob_of(mask).touches_border(mask.shape)
    for row, column in ((0, 5), (9, 5), (5, 0), (5, 11)):
        touching = mask.copy()
        touching[row, column] = True
        assert blob_of(touching).touches_border((10, 12, 3))


def test_a_blob_fills_the_image_that_it_crosses_or_covers_by_half() -> None:
    mask = np.zeros((10, 12), bool)
    mask[1:-1, 1:8] = True  # 56 of 120 pixels
    assert not blob_of(mask).fills(mask.shape)
    mask[1:-1, 1:9] = True  # 64
    assert blob_of(mask).fills((10, 12, 3))
    for rows, columns in ((slice(None), slice(4, 6)), (slice(4, 6), slice(None))):
        band = np.zeros((10, 12), bool)
        band[rows, columns] = True
        assert blob_of(band).fills(band.shape)
    corner = np.zeros((10, 12), bool)
    corner[:5, :6] = True  # touches two neighboring edges
    assert not blob_of(corner).fills(corner.shape)


def test_a_blob_cannot_be_changed() -> None:
    blob = blob_of(draw("##"))
    with pytest.raises(ValueError, match="read-only"):
        blob.centroid[0] = 3
    with pytest.raises(AttributeError):
        blob.area = 3  # type: ignore[misc]


def test_a_view_of_a_mask_is_described_as_its_copy_would_be() -> None:
    mask = np.random.default_rng(0).random((40, 60)) < 0.2
    for view in (mask[::2, ::3], mask[:, ::-1], mask.T, mask[5:, 7:]):
        blob, copied = blob_of(view), blob_of(view.copy())
        assert (blob.area, blob.bbox, blob.mu11) == (copied.area, copied.bbox, copied.mu11)


def test_moments_stay_exact_in_the_corner_of_a_large_picture() -> None:
    mask = np.zeros((4000, 6000), bool)
    mask[3990:3993, 5900:5960] = True
    blob = blob_of(mask)
    assert blob.axis_major_length == pytest.approx(4 * np.sqrt((60**2 - 1) / 12), rel=1e-12)
    assert blob.axis_minor_length == pytest.approx(4 * np.sqrt((3**2 - 1) / 12), rel=1e-12)


@pytest.mark.parametrize(
    ("mask", "text"),
    [
        (np.zeros((4, 4)), r"bool array of shape \(H, W\); got a float64 array of shape \(4, 4\)\. mask > 0"),
        (np.full((4, 4), 255, np.uint8), "got a uint8 array .* mask > 0 converts a 0/1 or 0/255"),
        (np.zeros((4, 4, 3), np.uint8), "An image is no mask yet: a segmenter"),
        (np.zeros(4, bool), r"of shape \(4,\)"),
        ([[True]], "got a list.*asarray"),
        (None, "got a NoneType"),
    ],
)
def test_what_is_no_mask_is_refused_with_the_mend(mask: object, text: str) -> None:
    with pytest.raises(InvalidImageError, match=text):
        Blob.from_mask(mask)  # type: ignore[arg-type]


def test_moments_that_no_pixels_have_are_refused() -> None:
    with pytest.raises(InvalidParameterError, match="positive area"):
        Blob(0, np.zeros(2), 1.0, 0.0, 1.0, (0, 0, 1, 1))
