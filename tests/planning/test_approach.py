"""From where a hand takes hold: which face its fingers span, and how they close about a visual hull."""

import numpy as np
import pytest
from hands import fitted
from scipy.spatial.transform import Rotation
from synthetic import arc_of_ratios

from gvp_lib.planning import VisualHull
from gvp_lib.planning.approach import Fingers, poses_along, upright


@pytest.mark.parametrize(
    ("sizes", "widest", "pass_"), [((0.12, 0.042, 0.042), 0.06, True), ((0.12, 0.042, 0.054), 0.06, False)]
)
def test_fingers_close_about_the_middle_of_a_slender_thing_whichever_side_it_shows(sizes, widest, pass_):
    hull = VisualHull.filling(fitted(sizes))
    assert Fingers((0.01, widest), 0.07).pass_middle(hull) is pass_


def test_what_is_hollow_in_the_middle_is_not_slender():
    hull = VisualHull.filling(fitted((0.12, 0.042, 0.042)))
    middle = np.abs(hull.points - hull.base_from_box.translation).max(axis=1) < 0.01
    hollow = VisualHull(**{**vars(hull), "points": hull.points[~middle]})
    assert not Fingers((0.01, 0.07), 0.07).pass_middle(hollow)


@pytest.mark.parametrize(("lean", "expected"), [(0.4, 0.4), (np.pi / 2, None)])
def test_a_slender_box_leans_no_more_than_its_longest_axis_and_one_on_end_stays_as_it_is(lean, expected):
    roll = Rotation.from_rotvec([0.0, -lean, 0.0]) * Rotation.from_rotvec([0.3, 0.0, 0.0])
    solid = fitted((0.12, 0.042, 0.042), turn=roll)
    normal = upright(solid, np.eye(3)[2]).normal
    if expected is None:
        np.testing.assert_array_equal(normal, solid.normal)
    else:
        assert np.arccos(normal[2]) == pytest.approx(expected)


def test_on_a_slope_a_slender_box_is_taken_from_off_the_slope():
    slope = Rotation.from_rotvec([0.7, 0.0, 0.0])
    solid, above = fitted((0.12, 0.042, 0.042), turn=slope), slope.apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(upright(solid, above).normal, above, atol=1e-9)


@pytest.mark.parametrize("length", [0.02, 0.03, 0.05, 0.12])
@pytest.mark.parametrize("ranked", [True, False])
def test_a_can_on_its_side_is_gripped_across_its_shorter_side_be_it_a_tin_or_a_disk_on_its_edge(length, ranked):
    on_edge = Rotation.from_rotvec([np.pi / 2, 0.0, 0.0])
    solid = fitted((0.05, 0.05, length), turn=on_edge, normal=(0, 1, 0), kind="cylinder")
    rank = Fingers((0.01, 0.07), 0.07).rank(solid, None) if ranked else None
    poses = poses_along(solid, arc_of_ratios([1.0]).views[0], 0.25, np.radians(20), rank)
    across = on_edge.apply([0.0, 0.0, 1.0]) @ poses[0].rotation.as_matrix()  # the can's axis in the camera
    assert abs(across[2]) < 1e-9
    assert abs(across[1 if length >= 0.05 else 0]) == pytest.approx(1.0)
