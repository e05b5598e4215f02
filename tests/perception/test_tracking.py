from dataclasses import replace

import numpy as np
import pytest

from gvp_lib.errors import InvalidImageError, InvalidParameterError
from gvp_lib.perception.blobs import Blob, Tracker, blobs_from_mask

pytestmark = pytest.mark.check


def frame(*boxes: tuple[int, int, int, int]) -> np.ndarray:
    """Boxes (u0, v0, u1, v1) in white on black, uint8 (240, 320, 3)."""
    image = np.zeros((240, 320, 3), np.uint8)
    for u0, v0, u1, v1 in boxes:
        image[v0:v1, u0:u1] = 255
    return image


def white(rgb: np.ndarray) -> np.ndarray:
    return rgb[..., 0] > 127


def box(u: float, v: float, width: int = 40, height: int = 20) -> tuple[int, int, int, int]:
    u0, v0 = round(u - width / 2), round(v - height / 2)
    return u0, v0, u0 + width, v0 + height


def place(blob: Blob) -> list[float]:
    return blob.centroid.tolist()


@pytest.mark.parametrize(
    ("mask", "min_area", "areas"),
    [
        (np.eye(2) > 0, 1, [2]),  # they touch at a corner
        (np.zeros((1, 5), bool), 1, []),
        (np.zeros((0, 5), bool), 1, []),
    ],
)
def test_touching_pixels_are_one_region_and_small_regions_are_left_out(mask, min_area: int, areas: list[int]) -> None:
    assert [blob.area for blob in blobs_from_mask(mask, min_area)] == areas


def test_blobs_come_largest_first_part_the_mask_and_each_is_that_of_its_own_mask() -> None:
    mask = np.random.default_rng(0).random((60, 80)) < 0.4
    blobs = blobs_from_mask(mask)
    np.testing.assert_array_equal(sum(blob.mask(mask.shape).astype(int) for blob in blobs), mask)
    assert len(blobs) > 9
    assert (np.diff([blob.area for blob in blobs]) <= 0).all()
    for blob in blobs:
        alone = Blob.from_mask(blob.mask(mask.shape))
        np.testing.assert_array_equal(blob.pixels, alone.pixels)
        np.testing.assert_allclose(blob.centroid, alone.centroid)
        assert (blob.area, blob.bbox, blob.mu11) == (alone.area, alone.bbox, alone.mu11)


def test_a_blob_of_moments_alone_or_beyond_the_image_has_no_mask() -> None:
    blob = Blob.from_mask(np.ones((4, 6), bool))
    for known, shape in ((replace(blob, pixels=None), (4, 6)), (blob, (3, 6))):
        with pytest.raises(InvalidParameterError, match=r"needs its pixels, within the image; got Blob\(.*of shape \("):
            known.mask(shape)


LARGE, CENTRAL, CORNER = box(60, 60, 80, 60), box(165, 125), box(290, 220, 30, 20)


@pytest.mark.parametrize(("choose", "wanted"), [("largest", LARGE), ("center", CENTRAL), ((300, 200), CORNER)])
def test_the_first_frame_that_shows_anything_chooses_the_target_whose_mask_is_the_target_alone(choose, wanted) -> None:
    tracker = Tracker(white, choose)
    assert tracker.observe(frame()) is None
    np.testing.assert_array_equal(tracker(frame(LARGE, CENTRAL, CORNER)), white(frame(wanted)))


def test_a_target_is_followed_past_a_larger_object_and_a_speck() -> None:
    tracker = Tracker(white, "center")
    for u in np.linspace(160, 40, 12):
        blob = tracker.observe(frame(box(u, 120), box(230, 60, 120, 80), box(160, 150, 3, 3)))
        assert blob.centroid[0] == pytest.approx(u, abs=1)
        assert blob.area == 800


def test_a_lost_target_is_none_and_the_others_are_not_taken_for_it() -> None:
    tracker = Tracker(white, (40, 40))
    tracker.observe(frame(box(40, 40), box(280, 200)))
    assert tracker.observe(frame(box(280, 200))) is None
    assert not tracker.mask.any()
    assert tracker.observe(frame()) is None
    assert place(tracker.observe(frame(box(50, 45), box(280, 200)))) == [49.5, 44.5]
    tracker.reset()
    assert place(tracker.observe(frame(box(280, 200)))) == [279.5, 199.5]


def test_an_object_of_quite_another_size_is_not_the_target() -> None:
    tracker = Tracker(white)
    tracker.observe(frame(box(160, 120)))
    assert tracker.observe(frame(box(160, 120, 160, 100))) is None
    assert tracker.observe(frame(box(160, 120, 60, 30))) is not None


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: Tracker(white, choose="biggest"), '"largest", "center" or a pixel'),
        (lambda: Tracker(white, choose=(1, 2, 3)), r"\(u, v\); got \(1, 2, 3\)"),
        (lambda: Tracker(white, max_growth=0.5), "max_growth above 1"),
        (lambda: Tracker(white, max_shift=0), "max_shift is positive"),
        (lambda: Tracker(lambda rgb: white(rgb[::2, ::2])).observe(frame()), r"mask of that shape; got \(120, 160\)"),
    ],
)
def test_what_makes_no_tracker_is_refused(call, text: str) -> None:
    with pytest.raises((InvalidParameterError, InvalidImageError), match=text):
        call()
