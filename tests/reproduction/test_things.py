"""The things on which planners are measured that were not made for them."""

import hashlib
import json

import numpy as np
import pytest

from gvp_book.experiments.things import NOT_CONVEX, THINGS, UNEQUAL, encounters
from gvp_lib import Noise, WorkCell
from gvp_lib.perception import blobs_from_mask
from gvp_lib.simulation.placements import place


def test_there_are_enough_of_each_kind():
    assert len(THINGS) >= 20
    assert len(NOT_CONVEX) >= 8
    assert len(UNEQUAL) >= 4
    for name in UNEQUAL:
        assert np.diff(np.sort(THINGS[name].bounding_box().half_extents)).min() > 0.001, name


def test_the_starts_are_those_that_were_chosen():
    listed = encounters()
    assert len(listed) == 2 * 25 * len(THINGS)
    assert {len(job["others"]) for key, job in listed.items() if key.startswith("among/")} == {3}
    digest = hashlib.sha256(json.dumps(listed, sort_keys=True).encode()).hexdigest()
    assert digest[:16] == "6ebc5b75811b7992"  # before there was a planner to measure on them


@pytest.mark.parametrize("name", THINGS)
def test_each_thing_is_centered_and_stands_leans_and_lies_on_a_ramp(name):
    spec = THINGS[name].centered()
    for placement in ("flat", "tilted", "steep", "ramp"):
        place(spec, placement, 0)


@pytest.mark.parametrize("name", THINGS)
def test_a_thing_is_found_by_its_segmenter_and_no_ramp_is(name):
    with WorkCell("floating", THINGS[name], "ramp", noise=Noise.thesis(), seed=1) as cell:
        mask = cell.segmenter(cell.arm.capture())
        center = (cell.truth.world_from_camera.inv() * cell.truth.world_from_object).translation
    found = blobs_from_mask(mask)
    assert found[0].area > 0.99 * mask.sum()
    assert np.linalg.norm(found[0].centroid - cell.arm.intrinsics.project(center)) < 60  # its box's middle may be empty
