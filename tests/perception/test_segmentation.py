import colorsys
import re

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from gvp_lib.errors import InvalidImageError, InvalidParameterError
from gvp_lib.perception.blobs import Blob, Tracker
from gvp_lib.perception.hsv import rgb_to_hsv
from gvp_lib.perception.segmentation import BoxSegmenter, HsvThreshold, Saliency, Segmenter
from gvp_lib.simulation.workcell import WorkCell

pytestmark = pytest.mark.check

RED, BLUE, WHITE, WOOD = (190, 30, 30), (30, 60, 170), (240, 240, 240), (150, 120, 90)
COLORS = np.random.default_rng(0).integers(0, 256, (300, 300, 3), dtype=np.uint8)
COLORS[:60] = np.random.default_rng(1).integers(120, 140, (60, 300, 3))  # grayish
COLORS[60:80] = np.random.default_rng(2).integers(0, 256, (20, 300, 1))  # gray
HSV = rgb_to_hsv(COLORS)
BOX, LOOSE, INSIDE = (120, 80, 200, 140), (105, 70, 215, 150), (140, 95, 180, 125)  # of LOOSE, half is table


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


@given(st.tuples(*[st.integers(0, 255)] * 3))
def test_hsv_turns_back_into_the_rgb_it_came_from(rgb: tuple[int, int, int]) -> None:
    hue, saturation, value = rgb_to_hsv(rgb)
    k = (np.array((5, 3, 1)) + hue / 60) % 6
    back = value - value * saturation * np.clip(np.minimum(k, 4 - k), 0, 1)
    np.testing.assert_allclose(255 * back, rgb, atol=1e-9)
    assert 0 <= hue < 360


@given(
    st.tuples(st.floats(0, 360), st.floats(0, 360)).filter(lambda hue: max(hue) > 1 or hue[0] == hue[1]),
    st.tuples(st.floats(0, 1), st.floats(0, 1)).map(sorted),
    st.tuples(st.floats(0, 1), st.floats(0, 1)).map(sorted),
)
def test_thresholds_agree_with_the_equations_within_their_quantization(hue, saturation, value) -> None:
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


def test_the_default_takes_every_color_and_lists_are_as_good_as_pairs() -> None:
    assert HsvThreshold().raw(COLORS).all()
    assert len({HsvThreshold(), HsvThreshold([0, 360])}) == 1  # type: ignore[arg-type]


@pytest.mark.parametrize(("kernel", "speck"), [(1, 16), (5, 0)])
def test_a_kernel_of_one_leaves_the_mask_as_it_is_and_a_larger_one_removes_larger_specks(kernel, speck) -> None:
    image = scene(((100, 100, 160, 140), RED), ((20, 20, 24, 24), RED), noise=0)
    assert HsvThreshold((345, 15), (0.6, 1), kernel_size=kernel)(image).sum() == 60 * 40 + speck


@pytest.mark.parametrize(
    ("color", "regions"),
    [(color, (INSIDE,)) for color in (BLUE, WHITE, (25, 25, 25))]
    + [(RED, (INSIDE, LOOSE, filled(BOX)))]
    # of the table's hue: told from it by saturation or value
    + [(c, (BOX, LOOSE, INSIDE)) for c in ((230, 130, 30), (110, 60, 15), (220, 200, 30), (75, 60, 45))],
)
def test_thresholds_learned_from_a_region_find_the_object(color: tuple[int, int, int], regions: tuple) -> None:
    image = scene((BOX, color))
    for region in regions:
        assert overlap(HsvThreshold.from_region(image, region)(image), filled(BOX)) > 0.95


@pytest.mark.parametrize(
    ("arm", "target", "placement", "seed"),
    [
        ("floating", "cuboid_1x4", "flat", 2),
        ("baxter", "cuboid_1x4", "flat", 2),  # in the Baxter's first picture are its dark fingers
        # aslant, in a quarter to half of its box
        ("floating", "cuboid_1x4", "side", 1),
        ("floating", "cylinder", "side", 1),
        ("floating", "alligator", "side", 1),
        ("baxter", "cuboid_1x2", "side", 1),
        ("baxter", "alligator", "flat", 1),
    ],
)
def test_an_object_of_any_color_on_the_cells_beige_table_is_learned_from_a_box_about_it(
    arm: str, target: str, placement: str, seed: int
) -> None:
    with WorkCell(arm, target, placement=placement, seed=seed) as cell:
        ours = cell.model.body_rootid[cell.model.geom_bodyid] == cell.target_body

        def painted(hue: float, saturation: float, value: float) -> np.ndarray:
            cell.model.geom_rgba[ours, :3] = colorsys.hsv_to_rgb(hue / 360, saturation, value)
            return cell.arm.capture()

        mask = np.abs(painted(0, 1, 1).astype(int) - painted(240, 1, 1)).max(axis=-1) > 25
        blob = Blob.from_mask(mask)
        u0, v0, u1, v1 = blob.bbox
        colors = [(hue, 0.8, 0.8) for hue in (0, 30, 60, 120, 210, 300)]
        for color in [*colors, (0, 0, 0.5), (0, 0, 0.07), (0, 0, 0.95), (215, 0.25, 0.8)]:
            rgb = painted(*color)
            for margin in (0, 10):
                box = (u0 - margin, v0 - margin, u1 + margin, v1 + margin)
                # The floor is gray and the fingers are black, too: a tracker knows which one is the object.
                found = Tracker(HsvThreshold.from_region(rgb, box), blob.centroid)(rgb)
                assert overlap(found, mask) > 0.95, f"HSV {color}, margin {margin}"


def test_a_box_on_nothing_is_refused_though_the_table_has_a_grain_of_another_color() -> None:
    image = scene(((120, 80, 150, 110), BLUE))
    image[::12] = image[1::12] = image[2::12] = (90, 60, 40)
    with pytest.raises(InvalidParameterError, match="tells no object"):
        HsvThreshold.from_region(image, (200, 100, 260, 160))
    striped = HsvThreshold.from_region(image, (100, 60, 170, 130))  # the box is a quarter grain, a sixth object
    assert overlap(striped(image), (image[..., 2] > image[..., 0] + 60)) > 0.9


def test_margins_widen_the_ranges_a_grays_hues_are_free_and_a_whole_picture_has_nothing_around_it() -> None:
    assert HsvThreshold.from_region(scene((BOX, (60, 60, 60))), BOX).hue == (0, 360)
    assert HsvThreshold.from_region(scene(), (0, 0, 320, 240))(scene()).mean() > 0.9
    image = scene((BOX, BLUE))
    narrow = HsvThreshold.from_region(image, BOX, margins=(0, 0, 0))
    wide = HsvThreshold.from_region(image, BOX, margins=(20, 0.1, 0.1))
    assert wide.hue[1] - wide.hue[0] == pytest.approx(narrow.hue[1] - narrow.hue[0] + 40)
    assert wide.value[1] == pytest.approx(narrow.value[1] + 0.1)
    assert HsvThreshold.from_region(image, BOX, margins=(180, 0, 0)).hue == (0, 360)
    pure = np.where(filled(BOX)[..., None], np.arange(320, dtype=np.uint8)[:, None] % 3 + (250, 0, 0), 0)
    pure[..., 2] = 0
    assert HsvThreshold.from_region(pure.astype(np.uint8), BOX, margins=(0, 0, 0)).hue == (0, 360 / 256)


# Saliency

FINGERS, LABEL, OTHER = ((0, 0, 20, 60), (40, 40, 40)), ((150, 100, 170, 120), WOOD), ((20, 190, 50, 215), BLUE)


@pytest.mark.parametrize(
    ("segmenter", "boxes", "found"),
    [
        (Saliency(), [], []),
        (Saliency(), [(BOX, RED), FINGERS], [BOX]),
        (Saliency(), [(BOX, RED), LABEL], [BOX]),
        (Saliency(), [(BOX, RED), OTHER], [BOX]),
        (Saliency(single=False), [(BOX, RED), OTHER], [BOX, OTHER[0]]),
    ],
    ids=["a bare table", "one at the border", "what it encloses", "one beside it", "all, where asked to"],
)
def test_saliency_keeps_the_large_and_central_object_and_what_it_encloses(segmenter, boxes, found) -> None:
    mask = segmenter(scene(*boxes))
    assert not mask.any() if not found else overlap(mask, filled(*found)) > 0.93


def test_saliency_is_not_taken_in_by_a_soft_shadow() -> None:
    image = scene((BOX, RED)).astype(float)
    image[130:160, 140:220] *= np.where(filled(BOX)[130:160, 140:220], 1, 0.75)[..., None]
    assert overlap(Saliency()(image.astype(np.uint8)), filled(BOX)) > 0.93


# BoxSegmenter

SMALL, LARGE = (10, 10, 20, 20), (100, 100, 200, 150)


@pytest.mark.parametrize(
    ("detected", "options", "kept"),
    [
        ([(*SMALL, 0.9), (*LARGE, 0.5)], {}, [SMALL]),  # the highest score
        ([SMALL, LARGE], {}, [LARGE]),  # without scores the largest
        ([SMALL, LARGE], {"every": True}, [SMALL, LARGE]),
        ([(*SMALL, 0.3)], {"min_score": 0.5}, []),
        ([(-10.0, -5.0, 20.4, 400.0)], {}, [(0, 0, 20, 240)]),  # out of the image
        ([], {}, []),
    ],
)
def test_of_the_boxes_that_any_method_outputs_the_best_is_filled_or_every_one(detected, options, kept):
    np.testing.assert_array_equal(BoxSegmenter(lambda _: detected, **options)(scene()), filled(*kept))


@pytest.mark.parametrize("segmenter", [HsvThreshold(), Saliency(), BoxSegmenter(lambda _: []), Tracker(HsvThreshold())])
def test_every_segmenter_takes_an_rgb_image_or_a_view_of_one_and_gives_a_mask(segmenter: Segmenter) -> None:
    assert isinstance(segmenter, Segmenter)
    view = scene((BOX, RED))[::2, ::-1]
    mask = segmenter(view)
    assert (mask.dtype, mask.shape, int(mask.view(np.uint8).max()) <= 1) == (bool, (120, 320), True)
    np.testing.assert_array_equal(segmenter(view.copy()), mask)
    np.testing.assert_array_equal(segmenter(Image.fromarray(view)), mask)
    with pytest.raises(InvalidImageError, match="looks gray"):
        segmenter(view[..., 0])


def marked(region: object, **options: object) -> HsvThreshold:
    return HsvThreshold.from_region(scene(((120, 80, 150, 110), BLUE)), region, **options)  # type: ignore[arg-type]


BACKGROUND = r"also that of [4-9]\d% of the picture outside it.*hue=\(.*Mark the whole object.*such as Saliency\(\)"


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: rgb_to_hsv([0.5, 0.2, 0.1]), r"integers 0…255 .* float64 of shape \(3,\)\. For floats in 0…1"),
        (lambda: rgb_to_hsv([0, 300, 10]), "got 0…300"),
        (lambda: HsvThreshold(hue=(0, 400)), r"hue in degrees 0…360; got \(0, 400\)"),
        (lambda: HsvThreshold(saturation=(100, 300)), r"got \(100, 300\)$"),
        (lambda: HsvThreshold(value=(0.1, np.nan)), r"value in 0…1; got \(0\.1, nan\)$"),
        *(
            (lambda hue=hue: HsvThreshold(hue=hue), r"degrees 0…360, as a pair \(low, high\); got ")
            for hue in (30, "15", ("0", "9"), {345, 15}, (0, 1j), (0, 10**400), (1, 2, 3), None)
        ),
        *(
            (lambda size=size: HsvThreshold(kernel_size=size), "odd number of px: 3, 5, … 999, or 1 .*; got ")
            for size in (4, "3", 10**12 + 1, np.nan, None)
        ),
        (lambda: marked((0, 0, 400, 100)), r"0 <= u0 < u1 <= 320 and 0 <= v0 < v1 <= 240; got \(0, 0, 400"),
        (lambda: marked((200, 100, 60, 80)), r"cv2\.selectROI: \(u, v, u \+ width, v \+ height\)"),
        (lambda: marked([[1, 2], [3]]), r"or a box \(u0, v0, u1, v1\)"),
        (lambda: marked(np.zeros((240, 320, 3), bool)), r"array of shape \(240, 320, 3\): mask\[\.\.\., 0\]"),
        (lambda: marked((1, 2, 3)), r"or a box \(u0, v0, u1, v1\)"),
        (lambda: marked(filled()), "empty mask"),
        (lambda: marked(filled()[:10, :10]), r"shape \(240, 320\) has a mask of that shape; got \(10, 10\)"),
        (lambda: marked(np.ones((240, 320))), "mask > 0.5"),
        *(
            (lambda margins=margins: marked(BOX, margins=margins), "three margins.*got ")
            for margins in ((8, 0.1), 8, "abc", (8, np.nan, 0.25), (8, -1, 0.25))
        ),
        (lambda: marked((200, 100, 260, 160)), BACKGROUND),
        (lambda: Saliency(border=0.6), "border=0.6, min_area=100, scale=2"),
        *(
            (lambda given=given: Saliency(**given), "got threshold=")
            for given in ({"threshold": 0}, {"threshold": "4"}, {"border": None}, {"scale": 2.5}, {"single": "no"})
        ),
        (lambda: BoxSegmenter(3), "returns boxes, min_score is a number .*; got 3"),
        (lambda: BoxSegmenter(len, min_score=None), "min_score is a number .*; got .*None"),
        (lambda: BoxSegmenter(lambda _: None)(scene()), "an empty list where it sees none; got None"),
        (lambda: BoxSegmenter(lambda _: BOX)(scene()), r"got 120\. A single box is a list of one"),
        (lambda: BoxSegmenter(lambda _: ["abcd"])(scene()), "got 'abcd'"),
        (lambda: BoxSegmenter(lambda _: [(*BOX, 0.9, 0)])(scene()), r"pass the first five: box\[:5\]"),
        (lambda: BoxSegmenter(lambda _: [(100, 100, 40, 30)])(scene()), r"From \(u, v, width, height\)"),
        (lambda: BoxSegmenter(lambda _: [(0.2, 0.3, 0.5, 1)])(scene()), r"From shares .*: \(u0 \* 320, v0 \* 240"),
        (lambda: rgb_to_hsv([[1, 2, 3], [1]]), r"got object of shape \(\)$"),
    ],
)
def test_what_makes_no_sense_is_refused_with_what_would_work(call, text: str) -> None:
    with pytest.raises((InvalidParameterError, InvalidImageError), match=text):
        call()


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        ({"hue": (-15, 15)}, [{"hue": (345, 15)}]),
        ({"hue": (350, 370)}, [{"hue": (350, 10)}]),
        ({"saturation": (0.9, 0.2)}, [{"saturation": (0.2, 0.9)}]),
        # scikit-image's hue
        ({"hue": (0.55, 0.7)}, [{"hue": (198, 252)}]),
        ({"hue": (0.95, 0.05), "saturation": (0.4, 1)}, [{"hue": (342, 18), "saturation": (0.4, 1)}]),
        # degrees and percent
        (
            {"hue": (200, 260), "saturation": (40, 100), "value": (20, 100)},
            [{"hue": (200, 260), "saturation": (0.4, 1), "value": (0.2, 1)}],
        ),
        # OpenCV's: the hue is doubled once, though saturation and value are both wrong
        (
            {"hue": (10, 25), "saturation": (100, 255), "value": (51, 255)},
            [{"hue": (20, 50), "saturation": (100 / 255, 1), "value": (0.2, 1)}],
        ),
        ({"value": (51, 255)}, [{"value": (0.2, 1)}]),
        ({"hue": (200, 260), "value": (51, 255)}, [{"hue": (200, 260), "value": (0.2, 1)}]),
        # either
        (
            {"hue": (10, 25), "value": (51, 100)},
            [{"hue": (10, 25), "value": (0.51, 1)}, {"hue": (20, 50), "value": (0.2, 100 / 255)}],
        ),
    ],
)
def test_ranges_in_the_units_of_others_are_refused_with_what_they_are_in_ours(given: dict, meant: list[dict]) -> None:
    with pytest.raises(InvalidParameterError) as refusal:
        HsvThreshold(**given)
    advice = re.findall(r": ((?:\w+=\([^)]*\)(?:, )?)+)", str(refusal.value))
    assert [HsvThreshold(**(given | eval(f"dict({each})"))) for each in advice] == [HsvThreshold(**m) for m in meant]


def test_opencvs_ranges_in_our_units_find_the_same_pixels() -> None:
    ours = HsvThreshold(hue=(2 * 10, 2 * 25), saturation=(100 / 255, 1), value=(51 / 255, 1))
    theirs = cv2.inRange(cv2.cvtColor(COLORS, cv2.COLOR_RGB2HSV), (10, 100, 51), (25, 255, 255)) > 0
    assert overlap(ours.raw(COLORS), theirs) > 0.9


def test_a_box_is_a_box_as_two_corners_as_a_detectors_row_and_as_a_tensor() -> None:
    learned = marked((120, 80, 150, 110))
    for region in ([[120, 80], [150, 110]], np.array([[120.0, 80, 150, 110]]), torch.tensor([120, 80, 150, 110])):
        assert marked(region) == learned
    assert HsvThreshold(kernel_size=3.0) == HsvThreshold()  # type: ignore[arg-type]
