"""Whole silhouettes of things of many colors: printed packages on a wooden desk, under an uneven light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from gvp_book.experiments import photographed
from gvp_lib import HsvThreshold
from gvp_lib.errors import InvalidImageError, InvalidParameterError
from gvp_lib.perception import GrabCut, LearnedSegmenter, Whole

PACKAGES = ("tea", "can", "matches")


@dataclass(frozen=True)
class Shelf:
    """Pictures of a package, and where it is in each."""

    pictures: list[Any]
    masks: list[Any]


@pytest.fixture(scope="module")
def shelves():
    desks = {name: photographed(name, seed=1, count=5, size=(800, 600), bare=True) for name in PACKAGES}
    return {name: Shelf(desk.pictures, desk.masks) for name, desk in desks.items()}


def iou(one, other):
    return (one & other).sum() / (one | other).sum()


def box_about(mask, pad=12):
    v, u = np.nonzero(mask)
    return u.min() - pad, v.min() - pad, u.max() + pad, v.max() + pad


def blank(masks):
    """A segmenter that gives a mask."""
    return lambda rgb: masks


def test_holes_are_filled_specks_left_out_and_notches_bridged():
    mask = np.zeros((100, 100), bool)
    mask[20:60, 20:60] = True
    mask[30:40, 30:40] = False  # a hole
    mask[20:30, 50:60] = False  # a notch at a corner
    mask[80:83, 80:83] = True  # a speck
    rgb = np.zeros((100, 100, 3), np.uint8)
    assert Whole(blank(mask))(rgb).sum() == 1600 - 100
    assert Whole(blank(mask), fill=False)(rgb).sum() == 1600 - 200
    assert Whole(blank(mask), largest=False)(rgb).sum() == 1600 - 100 + 9
    hull = Whole(blank(mask), hull=True)(rgb)
    assert 1600 - 60 < hull.sum() < 1600 - 30  # half of the corner
    assert not Whole(blank(mask & False))(rgb).any()


def test_a_hue_alone_is_half_a_package_and_wholeness_does_not_bring_all_of_it_back(shelves):
    found = []
    for shelf in shelves.values():
        hue = HsvThreshold.from_region(shelf.pictures[0], shelf.masks[0])
        rgb, mask = shelf.pictures[2], shelf.masks[2]
        found.append((iou(hue(rgb), mask), iou(Whole(hue)(rgb), mask)))
    plain, whole = np.mean(found, axis=0)
    assert plain < 0.9
    assert whole > plain


@pytest.mark.parametrize("name", PACKAGES)
def test_from_a_box_grab_cut_finds_most_of_a_package_and_from_a_rough_silhouette_its_edge(shelves, name):
    rgb, mask = shelves[name].pictures[2], shelves[name].masks[2]
    assert iou(Whole(GrabCut(box_about(mask)))(rgb), mask) > 0.85
    rough = np.roll(mask, (5, -4), axis=(0, 1))
    assert iou(GrabCut(blank(rough))(rgb), mask) > max(0.93, iou(rough, mask))


def test_a_mark_on_the_object_is_enough_where_colors_differ_much():
    rgb = np.full((240, 320, 3), (120, 140, 120), np.uint8)
    rgb[80:160, 100:220] = 200, 60, 40
    rgb[100:140, 120:200] = 220, 200, 60
    mark = np.zeros((240, 320), bool)
    mark[85:155, 110:115] = mark[110:130, 130:190] = True
    found = GrabCut(mark)(rgb)
    assert found[80:160, 100:220].mean() > 0.97
    assert found.sum() < 1.1 * 80 * 120


@pytest.mark.parametrize("name", PACKAGES)
def test_colors_learned_from_three_pictures_serve_for_the_others(shelves, name):
    pictures, masks = shelves[name].pictures, shelves[name].masks
    learned = LearnedSegmenter(pictures[:3], masks[:3])
    found = [iou(learned(rgb), mask) for rgb, mask in zip(pictures[3:], masks[3:], strict=True)]
    assert np.mean(found) > 0.95
    votes = learned.votes(pictures[3])
    assert votes.shape == masks[3].shape
    assert votes[masks[3]].mean() > 0.8 > 0.2 > votes[~masks[3]].mean()


def test_what_cannot_be_cut_or_learned_is_refused_in_words(shelves):
    rgb, mask = shelves["tea"].pictures[0], shelves["tea"].masks[0]
    with pytest.raises(InvalidParameterError, match=r"box .*, a mark, .* or another segmenter"):
        GrabCut()(rgb)
    with pytest.raises(InvalidParameterError, match="box"):
        GrabCut((10, 10, 5, 20))(rgb)
    with pytest.raises(InvalidImageError, match=r"shape"):
        GrabCut().refined(rgb, mask[:-1])
    with pytest.raises(InvalidParameterError, match=r"1 picture, 2 masks"):
        LearnedSegmenter([rgb], [mask, mask])
    with pytest.raises(InvalidParameterError, match="number 1 marks nothing"):
        LearnedSegmenter([rgb, rgb], [mask, mask & False])
    assert not GrabCut(blank(mask & False))(rgb).any()
