"""Outlines to a fraction of a pixel, where the image's border cuts the object, and the colors beside them."""

import numpy as np
import pytest

from gvp_lib.errors import InvalidParameterError
from gvp_lib.perception import Blob, Outline

pytestmark = pytest.mark.check
SHAPE = (240, 320)


def disc(u: float, v: float, radius: float) -> np.ndarray:
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    return (columns - u) ** 2 + (rows - v) ** 2 < radius**2


def test_points_lie_on_the_edge_to_a_fraction_of_a_pixel_at_even_distances_clockwise() -> None:
    outline = Outline.of(Blob.from_mask(disc(150.3, 120.6, 50)), SHAPE, count=48)
    out = outline.points - (150.3, 120.6)
    assert outline.inside.all()
    assert np.hypot(*out.T).mean() == pytest.approx(50, abs=0.1)
    assert np.hypot(*out.T).std() < 0.2
    steps = np.hypot(*np.diff(outline.points, axis=0).T)
    assert np.ptp(steps) < 0.1 * steps.mean()
    assert (np.diff(np.unwrap(np.arctan2(out[:, 1], out[:, 0]))) > 0).all()


@pytest.mark.parametrize("center", [(5, 120), (315, 120), (150, 4), (150, 236)])
def test_where_the_border_cuts_the_object_its_outline_is_not_its_own(center) -> None:
    outline = Outline.of(Blob.from_mask(disc(*center, 40)), SHAPE, count=60)
    away = np.hypot(*(outline.points - center).T)
    assert 20 < outline.inside.sum() < 50
    np.testing.assert_allclose(away[outline.inside], 40, atol=1)
    assert (away[~outline.inside] < 39.5).mean() > 0.8


def test_colors_are_those_just_outside_and_unknown_beyond_the_picture() -> None:
    picture = np.full((*SHAPE, 3), 255, np.uint8)
    picture[:, 150:] = (255, 0, 0)
    mask = disc(150, 3, 40)
    picture[mask] = 0
    outline = Outline.of(Blob.from_mask(mask), picture)
    beyond = (outline.points[:, 1] < 0) & ~outline.inside
    assert np.isnan(outline.colors[beyond]).all()
    u = outline.points[:, 0]
    left, right = (outline.colors[outline.inside & side] for side in (u < 140, u > 160))
    np.testing.assert_allclose(left, np.tile([100, 0, 0], (len(left), 1)), atol=0.1)
    np.testing.assert_allclose(right, np.tile([53.2, 80.1, 67.2], (len(right), 1)), atol=0.2)
    assert np.isnan(Outline.of(Blob.from_mask(mask), SHAPE).colors).all()


def box(u0, v0, u1, v1):
    mask = np.zeros(SHAPE, bool)
    mask[v0:v1, u0:u1] = True
    return mask


@pytest.mark.parametrize("mask", [box(7, 5, 8, 6), box(20, 30, 21, 90), box(0, 0, 320, 240), box(0, 0, 1, 240)])
def test_a_blob_however_thin_or_large_has_an_outline(mask) -> None:
    outline = Outline.of(Blob.from_mask(mask), np.zeros((*SHAPE, 3), np.uint8))
    assert np.isfinite(outline.points).all()
    assert (outline.points.min(0) > np.argwhere(mask).min(0)[::-1] - 6).all()
    assert (outline.points.max(0) < np.argwhere(mask).max(0)[::-1] + 6).all()


def test_an_outline_needs_pixels_and_three_points() -> None:
    blob = Blob.from_mask(disc(150, 120, 30))
    with pytest.raises(InvalidParameterError, match=r"three points or more, .*; got Blob\(.*count=2"):
        Outline.of(blob, SHAPE, count=2)
