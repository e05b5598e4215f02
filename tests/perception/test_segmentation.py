import colorsys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gvp_lib.errors import InvalidImageError, InvalidParameterError
from gvp_lib.perception.moments import Blob
from gvp_lib.perception.segmentation import BoxSegmenter, HsvThreshold, Saliency, Segmenter, rgb_to_hsv
from gvp_lib.perception.tracking import Tracker
from gvp_lib.simulation.objects import ObjectSpec
from gvp_lib.simulation.workcell import WorkCell

pytestmark = pytest.mark.check

RED, BLUE, WOOD = (190, 30, 30), (30, 60, 170), (150, 120, 90)
COLORS = np.random.default_rng(0).integers(0, 256, (300, 300, 3), dtype=np.uint8)
COLORS[:60] = np.random.default_rng(1).integers(120, 140, (60, 300, 3))  # grayish
COLORS[60:80] = np.random.default_rng(2).integers(0, 256, (20, 300, 1))  # gray
HSV = rgb_to_hsv(COLORS)


def scene(*boxes: tuple[tuple[int, int, int, int], tuple[int, int, int]], noise: float = 3.0) -> np.ndarray:
    """Boxes (u0, v0, u1, v1) of one color each on a wooden table with noise; uint8 (240, 320, 3)."""
    image = np.empty((240, 320, 3))
    image[:] = WOOD
    image *= np.linspace(0.85, 1.1, 320)[:, None]
    for (u0, v0, u1, v1), color in boxes:
        image[v0:v1, u0:u1] = color
    image += np.random.default_rng(3).normal(0, noise, image.shape)
    return image.clip(0, 255).astype(np.uint8)


def filled(*boxes: tuple[int, int, int, int]) -> np.ndarray:
    mask = np.zeros((240, 320), bool)
    for u0, v0, u1, v1 in boxes:
        mask[v0:v1, u0:u1] = True
    return mask


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    """Intersection over union."""
    return float((a & b).sum() / (a | b).sum())


# rgb_to_hsv


@given(st.tuples(*[st.integers(0, 255)] * 3))
def test_hsv_turns_back_into_the_rgb_it_came_from(rgb: tuple[int, int, int]) -> None:
    hue, saturation, value = rgb_to_hsv(rgb)
    k = (np.array((5, 3, 1)) + hue / 60) % 6
    back = value - value * saturation * np.clip(np.minimum(k, 4 - k), 0, 1)
    np.testing.assert_allclose(255 * back, rgb, atol=1e-9)
    assert 0 <= hue < 360


def test_hsv_has_the_precision_asked_for() -> None:
    assert rgb_to_hsv(COLORS, np.float32).dtype == np.float32
    np.testing.assert_allclose(rgb_to_hsv(COLORS, np.float32), HSV, atol=1e-4)


def test_floats_and_other_ranges_are_refused_because_their_unit_is_a_guess() -> None:
    with pytest.raises(InvalidImageError, match=r"integers 0…255 .* got float64 of shape \(3,\)\. For floats in 0…1"):
        rgb_to_hsv([0.5, 0.2, 0.1])
    with pytest.raises(InvalidImageError, match="got 0…300"):
        rgb_to_hsv([0, 300, 10])


# HsvThreshold


@given(
    st.tuples(st.floats(0, 360), st.floats(0, 360)),
    st.tuples(st.floats(0, 1), st.floats(0, 1)).map(sorted),
    st.tuples(st.floats(0, 1), st.floats(0, 1)).map(sorted),
)
def test_thresholds_agree_with_the_equations_within_their_quantization(
    hue: tuple[float, float], saturation: list[float], value: list[float]
) -> None:
    mask = HsvThreshold(hue, tuple(saturation), tuple(value)).raw(COLORS)
    h, s, v = np.moveaxis(HSV, -1, 0)
    start, end = hue
    span = end - start if end >= start else end - start + 360

    def within(degrees: float, share: float) -> np.ndarray:
        near = ((h - start + degrees) % 360 <= span + 2 * degrees) | (span + 2 * degrees >= 360)
        low, high = saturation
        return near & (s >= low - share) & (s <= high + share) & (v >= value[0] - 1e-9) & (v <= value[1] + 1e-9)

    assert not (within(-1e-9, -1e-9) & ~mask).any(), "a pixel in range is missing"
    assert not (mask & ~within(1.82, 0.005)).any(), "a pixel out of range is there"


@pytest.mark.parametrize("low", [0.0, 0.3])  # with grays and without
@pytest.mark.parametrize("hue", [(345, 15), (200, 100), (250, 230)])
def test_a_range_that_wraps_holds_the_same_as_its_two_parts(hue: tuple[float, float], low: float) -> None:
    start, end = hue
    whole = HsvThreshold(hue, (low, 1)).raw(COLORS)
    parts = HsvThreshold((start, 360), (low, 1)).raw(COLORS) | HsvThreshold((0, end), (low, 1)).raw(COLORS)
    assert whole.any()
    assert (whole ^ parts).mean() < 0.01  # the quantization differs


def test_every_hue_is_the_default() -> None:
    assert HsvThreshold().raw(COLORS).all()
    assert HsvThreshold(hue=(0, 360)).raw(COLORS).all()


def test_a_kernel_of_one_leaves_the_mask_as_it_is_and_a_larger_one_removes_larger_specks() -> None:
    image = scene(((100, 100, 160, 140), RED), ((20, 20, 24, 24), RED), noise=0)
    red = {"hue": (345, 15), "saturation": (0.6, 1)}
    assert HsvThreshold(**red, kernel_size=1)(image).sum() == 60 * 40 + 16
    assert HsvThreshold(**red, kernel_size=3)(image).sum() == 60 * 40 + 16
    assert HsvThreshold(**red, kernel_size=5)(image).sum() == 60 * 40


def test_masks_are_bool_with_proper_values() -> None:
    for segment in (HsvThreshold(), HsvThreshold(kernel_size=1), HsvThreshold().raw):
        mask = segment(COLORS)
        assert mask.dtype == bool
        assert mask.view(np.uint8).max() == 1


def test_a_picture_that_is_a_view_is_segmented_as_its_copy() -> None:
    red = HsvThreshold((345, 15), (0.4, 1))
    np.testing.assert_array_equal(red(COLORS[::2, ::-1]), red(COLORS[::2, ::-1].copy()))


def test_equal_thresholds_are_equal_and_hash_alike() -> None:
    assert HsvThreshold((345, 15)) == HsvThreshold([345.0, 15.0])  # type: ignore[arg-type]
    assert len({HsvThreshold((345, 15)), HsvThreshold((345, 15))}) == 1


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"hue": (0, 400)}, r"hue in degrees 0…360; got \(0, 400\)"),
        ({"hue": (-15, 15)}, r"starts above its end: hue=\(345, 15\)"),
        ({"saturation": (100, 255)}, r"saturation in 0…1; got \(100, 255\).*OpenCV's 0…255: saturation=\(0\.392, 1\)"),
        ({"value": (50, 255)}, "OpenCV's hue of 0…179 counts steps of 2 degrees"),
        ({"saturation": (0.9, 0.2)}, r"the low end first: \(0\.2, 0\.9\)"),
        ({"value": (0.1, np.nan)}, r"value in 0…1; got \(0\.1, nan\)"),
        ({"hue": 30}, r"as a pair \(low, high\); got 30"),
        ({"hue": (10, 20, 30)}, "as a pair"),
        ({"kernel_size": 4}, "odd number of pixels.*got 4"),
        ({"kernel_size": 0}, "1 for no opening and closing"),
    ],
)
def test_a_threshold_out_of_range_is_refused_with_one_that_would_work(arguments: dict, text: str) -> None:
    with pytest.raises(InvalidParameterError, match=text):
        HsvThreshold(**arguments)


# HsvThreshold.from_region

BOX = (120, 80, 200, 140)


@pytest.mark.parametrize("color", [RED, BLUE, (30, 150, 60), (240, 240, 240), (25, 25, 25)])
def test_thresholds_learned_from_a_box_inside_the_object_find_the_object(color: tuple[int, int, int]) -> None:
    image = scene((BOX, color))
    mask = HsvThreshold.from_region(image, (140, 95, 180, 125))(image)
    assert overlap(mask, filled(BOX)) > 0.97


def test_thresholds_are_learned_from_a_mask_as_from_a_box() -> None:
    image = scene((BOX, RED))
    assert HsvThreshold.from_region(image, filled(BOX)) == HsvThreshold.from_region(image, BOX)


def test_a_red_object_gets_a_hue_range_that_wraps() -> None:
    start, end = HsvThreshold.from_region(scene((BOX, RED)), BOX).hue
    assert start > 330
    assert end < 30


def test_a_gray_object_leaves_the_hue_free() -> None:
    assert HsvThreshold.from_region(scene((BOX, (60, 60, 60))), BOX).hue == (0, 360)


def test_a_loosely_drawn_box_still_finds_the_object() -> None:
    image = scene((BOX, RED))
    loose = HsvThreshold.from_region(image, (105, 70, 215, 150))  # half of it is table
    assert overlap(loose(image), filled(BOX)) > 0.97


CAR = """
<mujoco><worldbody><body>
  <geom type="box" size=".045 .02 .011" pos="0 0 -.009" density="400" rgba="1 0 0 1"/>
  <geom type="box" size=".02 .017 .009" pos="-.005 0 .011" density="400" rgba="1 0 0 1"/>
</body></worldbody></mujoco>"""


@pytest.mark.parametrize("arm", ["floating", "baxter"])  # in the Baxter's first picture are its dark fingers
def test_a_toy_of_any_hue_on_the_cells_beige_table_is_learned_from_a_box_about_it(arm: str) -> None:
    with WorkCell(arm, ObjectSpec("car", CAR, Saliency()), seed=2) as cell:
        ours = cell.model.body_rootid[cell.model.geom_bodyid] == cell.target_body

        def painted(hue: float, saturation: float = 0.8, value: float = 0.8) -> np.ndarray:
            cell.model.geom_rgba[ours, :3] = colorsys.hsv_to_rgb(hue / 360, saturation, value)
            return cell.arm.capture()

        mask = np.abs(painted(0, 1, 1).astype(int) - painted(240, 1, 1)).max(axis=-1) > 25
        u0, v0, u1, v1 = Blob.from_mask(mask).bbox
        for hue in range(0, 360, 30):
            rgb = painted(hue)
            for margin in (0, 20):
                box = (u0 - margin, v0 - margin, u1 + margin, v1 + margin)
                assert overlap(HsvThreshold.from_region(rgb, box)(rgb), mask) > 0.95, f"hue {hue}, margin {margin}"


@pytest.mark.parametrize("color", [(230, 130, 30), (110, 60, 15), (220, 200, 30), (75, 60, 45)])
def test_an_object_of_the_tables_hue_is_told_from_it_by_saturation_or_value(color: tuple[int, int, int]) -> None:
    image = scene((BOX, color))
    for box in (BOX, (105, 70, 215, 150), (140, 95, 180, 125)):
        assert overlap(HsvThreshold.from_region(image, box)(image), filled(BOX)) > 0.95


@pytest.mark.parametrize("box", [(60, 10, 100, 50), (200, 100, 260, 160)])
def test_a_region_of_the_backgrounds_color_is_refused_with_what_would_work(box: tuple[int, int, int, int]) -> None:
    text = r"also that of [4-9]\d% of the picture outside it.*hue=\(.*Mark the whole object.*such as Saliency\(\)"
    with pytest.raises(InvalidParameterError, match=text):
        HsvThreshold.from_region(scene(((120, 80, 150, 110), BLUE)), box)


def test_a_region_that_is_the_whole_picture_has_nothing_around_it() -> None:
    assert HsvThreshold.from_region(scene(), (0, 0, 320, 240))(scene()).mean() > 0.9


def test_margins_widen_the_ranges() -> None:
    image = scene((BOX, BLUE))
    narrow = HsvThreshold.from_region(image, BOX, margins=(0, 0, 0))
    wide = HsvThreshold.from_region(image, BOX, margins=(20, 0.1, 0.1))
    assert wide.hue[1] - wide.hue[0] == pytest.approx(narrow.hue[1] - narrow.hue[0] + 40)
    assert wide.value[1] == pytest.approx(narrow.value[1] + 0.1)
    assert HsvThreshold.from_region(image, BOX, margins=(180, 0, 0)).hue == (0, 360)


@pytest.mark.parametrize(
    ("region", "text"),
    [
        ((0, 0, 400, 100), r"0 <= u0 < u1 <= 320 and 0 <= v0 < v1 <= 240; got \(0, 0, 400, 100\)"),
        ((50, 50, 50, 60), "lies in the image"),
        ((1, 2, 3), "a region is a box"),
        (filled(), "empty mask"),
        (np.ones((10, 10), bool), r"shape \(10, 10\), the image \(240, 320\)"),
        (np.ones((240, 320)), "mask > 0"),
    ],
)
def test_a_region_that_marks_nothing_is_refused(region: object, text: str) -> None:
    with pytest.raises((InvalidParameterError, InvalidImageError), match=text):
        HsvThreshold.from_region(scene(), region)  # type: ignore[arg-type]


def test_a_coverage_in_percent_is_refused() -> None:
    with pytest.raises(InvalidParameterError, match=r"coverage lies in \(0, 1\]"):
        HsvThreshold.from_region(scene(), BOX, coverage=98)


# Saliency


@pytest.mark.parametrize("color", [RED, BLUE, (30, 150, 60), (230, 120, 20), (240, 240, 240)])
def test_saliency_finds_an_object_on_a_noisy_table(color: tuple[int, int, int]) -> None:
    assert overlap(Saliency()(scene((BOX, color))), filled(BOX)) > 0.95


def test_saliency_finds_nothing_on_a_bare_table() -> None:
    assert not Saliency()(scene()).any()
    assert not Saliency()(np.full((240, 320, 3), 90, np.uint8)).any()


def test_saliency_keeps_the_large_and_central_object_or_all() -> None:
    other = (20, 190, 50, 215)
    image = scene((BOX, RED), (other, BLUE))
    assert overlap(Saliency()(image), filled(BOX)) > 0.95
    assert overlap(Saliency(single=False)(image), filled(BOX, other)) > 0.93


def test_saliency_bears_an_object_that_reaches_into_the_border() -> None:
    fingers = ((0, 0, 20, 60), (40, 40, 40))
    assert overlap(Saliency()(scene((BOX, RED), fingers)), filled(BOX)) > 0.95


def test_saliency_is_not_taken_in_by_a_soft_shadow() -> None:
    image = scene((BOX, RED)).astype(float)
    image[130:160, 140:220] *= np.where(filled(BOX)[130:160, 140:220], 1, 0.75)[..., None]
    assert overlap(Saliency()(image.astype(np.uint8)), filled(BOX)) > 0.93


def test_what_a_salient_object_encloses_belongs_to_it() -> None:
    label = (150, 100, 170, 120)
    assert overlap(Saliency()(scene((BOX, RED), (label, WOOD))), filled(BOX)) > 0.95


def test_the_map_is_small_on_the_table_and_large_on_the_object() -> None:
    distance = Saliency().map(scene((BOX, RED)))
    assert distance.shape == (240, 320)
    assert distance[:60].max() < 2 < 6 < distance[90:130, 130:190].min()


@pytest.mark.parametrize("arguments", [{"threshold": 0}, {"border": 0.6}, {"scale": 0}, {"min_area": -1}])
def test_settings_of_saliency_out_of_range_are_refused(arguments: dict) -> None:
    with pytest.raises(InvalidParameterError, match=next(iter(arguments))):
        Saliency(**arguments)


# BoxSegmenter


def test_of_several_boxes_the_highest_score_counts_or_without_scores_the_largest() -> None:
    small, large = (10, 10, 20, 20), (100, 100, 200, 150)
    image = scene()
    np.testing.assert_array_equal(BoxSegmenter(lambda _: [(*small, 0.9), (*large, 0.5)])(image), filled(small))
    np.testing.assert_array_equal(BoxSegmenter(lambda _: [small, large])(image), filled(large))
    np.testing.assert_array_equal(BoxSegmenter(lambda _: [small, large], every=True)(image), filled(small, large))


def test_boxes_that_score_too_little_are_dropped() -> None:
    assert not BoxSegmenter(lambda _: [(10, 10, 20, 20, 0.3)], min_score=0.5)(scene()).any()


def test_a_box_may_reach_out_of_the_image() -> None:
    np.testing.assert_array_equal(
        BoxSegmenter(lambda _: [(-10.0, -5.0, 20.4, 400.0)])(scene()), filled((0, 0, 20, 240))
    )


def test_nothing_detected_is_an_empty_mask() -> None:
    assert not BoxSegmenter(lambda _: [])(scene()).any()


def test_a_box_of_another_form_is_refused() -> None:
    with pytest.raises(InvalidParameterError, match=r"From \(u, v, width, height\)"):
        BoxSegmenter(lambda _: [(100, 100, 40, 30)])(scene())


# All of them

SEGMENTERS = [HsvThreshold(), Saliency(), BoxSegmenter(lambda _: []), Tracker(HsvThreshold())]


@pytest.mark.parametrize("segmenter", SEGMENTERS)
def test_every_segmenter_is_a_segmenter(segmenter: Segmenter) -> None:
    assert isinstance(segmenter, Segmenter)
    mask = segmenter(scene((BOX, RED)))
    assert (mask.dtype, mask.shape) == (bool, (240, 320))


@pytest.mark.parametrize("segmenter", SEGMENTERS)
@pytest.mark.parametrize(
    ("image", "text"),
    [
        (np.zeros((4, 4, 3)), r"uint8 array of shape \(H, W, 3\); got a float64 .*\(255 \* image\)\.round\(\)"),
        (np.zeros((4, 4), np.uint8), "looks gray.*stack"),
        (np.zeros((4, 4, 4), np.uint8), r"looks RGBA\. image\[\.\.\., :3\]"),
        (np.zeros((3, 4, 4), np.uint8), "channels first.*moveaxis"),
        (np.zeros((2, 4, 4, 3), np.uint8), "batch"),
        (np.zeros((4, 4, 3), np.int64), r"For values in 0…255: image\.astype"),
        (np.zeros((0, 4, 3), np.uint8), "empty image"),
        ([[1, 2, 3]], "got a list.*asarray"),
    ],
)
def test_what_is_no_rgb_image_is_refused_with_the_mend(segmenter: Segmenter, image: object, text: str) -> None:
    with pytest.raises(InvalidImageError, match=text):
        segmenter(image)  # type: ignore[arg-type]
