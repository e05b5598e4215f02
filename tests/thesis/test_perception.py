"""What thesis 2.1 says, sentence by sentence, and what the errata change in it."""

import numpy as np
import pytest

from gvp_lib.perception.blobs import Blob
from gvp_lib.perception.hsv import rgb_to_hsv
from gvp_lib.perception.segmentation import HsvThreshold, Saliency

pytestmark = pytest.mark.check

RED = (200, 20, 30)
ANY_RED = HsvThreshold(hue=(345, 15), saturation=(0.4, 1), value=(0.2, 1))


def picture(*rows: str) -> np.ndarray:
    """Red where there is a #, gray elsewhere."""
    image = np.full((len(rows), len(rows[0]), 3), 128, np.uint8)
    image[np.array([[c == "#" for c in row] for row in rows])] = RED
    return image


def text(mask: np.ndarray) -> list[str]:
    return ["".join(".#"[int(pixel)] for pixel in row) for row in mask]


def rectangle(length: float, width: float, angle: float, scale: float = 1.0) -> Blob:
    v, u = (x - 250.2 for x in np.mgrid[:500, :500])
    along, across = u * np.cos(angle) + v * np.sin(angle), v * np.cos(angle) - u * np.sin(angle)
    return Blob.from_mask((abs(along) <= scale * length / 2) & (abs(across) <= scale * width / 2))


# 2.1.1


@pytest.mark.parametrize(
    ("rgb", "hue", "saturation", "value"),
    [
        ((50, 200, 100), 140, 0.75, 0.78431),  # value: the largest of the three; saturation: relative to value
        ((0, 0, 0), 0, 0, 0),  # and zero for black
        ((77, 77, 77), 0, 0, 0.30196),  # hue: zero for a gray
        ((200, 50, 100), 340, 0.75, 0.78431),  # and never negative
    ],
)
def test_eqs_2_1_to_2_3_give_hue_saturation_and_value(rgb, hue: float, saturation: float, value: float) -> None:
    np.testing.assert_allclose(rgb_to_hsv(rgb), (hue, saturation, value), atol=1e-4)


@pytest.mark.parametrize(("rgb", "printed"), [((50, 200, 100), 85), ((200, 50, 100), -20)])
def test_eq_2_3_as_printed_gives_another_hue(rgb: tuple[int, int, int], printed: float) -> None:
    # Erratum 1. With R, G and B in 0 to 1 where V stands in no fraction.
    r, g, b = (x / 255 for x in rgb)
    low, high = min(r, g, b), max(r, g, b)
    as_printed = 60 * (g - b) / (high - low) if high == r else 120 + 60 * (b - r) / high - 255 * low
    assert as_printed == pytest.approx(printed)


def test_erosion_and_dilation_remove_a_speck_and_dilation_and_erosion_fill_a_hole() -> None:
    image = picture(
        "...........#",
        "............",
        "..#######...",
        "..#######...",
        "..#######...",
        "..###.###...",
        "..#######...",
        "..#######...",
        "..#######...",
        "............",
        "...#........",
    )
    assert text(ANY_RED(image)) == 2 * ["............"] + 7 * ["..#######..."] + 2 * ["............"]


# 2.1.2


def test_eq_2_7_an_upright_rectangle_stands_upright() -> None:
    # Erratum 4: the arc tangent of the ratio as printed says 0.
    blob = rectangle(20, 60, 0)
    assert 0.5 * np.arctan(2 * blob.mu11 / (blob.mu20 - blob.mu02)) == 0
    assert blob.orientation == np.pi / 2


def test_eqs_2_8_and_2_9_give_full_axes_1_155_times_the_sides() -> None:
    mask = np.zeros((100, 100), bool)
    mask[40:60, 20:80] = True
    blob = Blob.from_mask(mask)
    axes = blob.axis_major_length, blob.axis_minor_length, blob.ratio
    np.testing.assert_allclose(axes, (69.27, 23.07, 0.333), atol=0.005)
    # Erratum 5: as printed, without the square.
    total, root = blob.mu20 + blob.mu02, np.sqrt(4 * blob.mu11**2 + (blob.mu20 - blob.mu02))
    np.testing.assert_allclose(np.sqrt([8 * (total + root), 8 * (total - root)]), (52.88, 50.35), atol=0.01)


def test_a_turn_turns_the_orientation_a_scale_scales_the_axes_and_neither_changes_the_ratio() -> None:
    for angle in np.radians((-80, -45, 5, 30, 89)):
        for scale in (0.5, 1.0, 1.7):
            blob = rectangle(128, 64, angle, scale)
            assert blob.orientation == pytest.approx(angle, abs=0.01)
            assert blob.axis_major_length == pytest.approx(scale * 128 * 2 / np.sqrt(3), rel=0.01)
            assert blob.ratio == pytest.approx(0.5, abs=0.01)


# 2.1: what may take the place of thresholds


@pytest.mark.parametrize("color", [(190, 30, 30), (30, 60, 170), (30, 150, 60), (230, 120, 20), (240, 240, 240)])
def test_saliency_allows_objects_of_any_color(color: tuple[int, int, int]) -> None:
    image = np.full((240, 320, 3), (150, 120, 90), float)
    image *= np.linspace(0.85, 1.1, 320)[:, None]  # a table in uneven light
    image[80:140, 100:220] = color
    noisy = image + np.random.default_rng(3).normal(0, 3, image.shape)
    blob = Blob.from_mask(Saliency()(noisy.clip(0, 255).astype(np.uint8)))
    np.testing.assert_allclose(blob.centroid, (159.5, 109.5), atol=0.5)
    assert blob.area == pytest.approx(120 * 60, rel=0.05)
    assert blob.ratio == pytest.approx(0.5, abs=0.02)
