"""Depth from a known motion: exact for points, near for a ball that a camera sees, and clear where it cannot be."""

import numpy as np
import pytest
from eye_in_hand import CAMERA
from hypothesis import assume, given
from hypothesis import strategies as st

from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.depth import estimate_depth, range_to

pytestmark = pytest.mark.check

OBLONG = CameraIntrinsics(640, 480, 530.0, 610.0, 300.0, 250.0)  # pixels that are not square
CENTER = CAMERA.principal_point
SIDEWAYS = st.floats(0.005, 0.1) | st.floats(-0.1, -0.005)
SMALL = st.floats(-0.1, 0.1)
POINTS = st.tuples(st.floats(-0.15, 0.15), st.floats(-0.15, 0.15), st.floats(0.2, 2.0))


# Exact for points


@given(POINTS, SIDEWAYS, SMALL, SMALL)
def test_the_depth_after_any_finite_motion_is_exact(point, dx, dy, dz):
    moved = np.array([dx, dy, dz])
    before, after = OBLONG.project([point, point - moved])
    jv = -moved[:2] * (OBLONG.fx, OBLONG.fy) + (before - OBLONG.principal_point) * dz
    assume(np.linalg.norm(jv) > 1)  # px m: the motion is not straight toward the point
    assert estimate_depth(OBLONG, moved, before, after) == pytest.approx(point[2] - dz, rel=1e-9)


@given(POINTS, st.lists(st.tuples(SIDEWAYS, SMALL), min_size=2, max_size=5))
def test_several_exact_pairs_give_the_one_depth(point, steps):
    moves = np.array([(*step, 0.0) for step in steps])
    before, after = np.tile(OBLONG.project(point), (len(moves), 1)), OBLONG.project(point - moves)
    assert estimate_depth(OBLONG, moves, before, after) == pytest.approx(point[2], rel=1e-9)


def test_several_pairs_are_solved_by_least_squares_in_the_inverse_depth():
    moves = np.array([(0.02, 0, 0), (0, 0.02, 0), (-0.03, 0.01, 0)])
    before = np.tile(CENTER, (3, 1))
    after = CAMERA.project(np.array([0, 0, 0.25]) - moves) + np.random.default_rng(0).normal(0, 1, (3, 2))
    jv = (-530 * moves[:, :2]).reshape(-1, 1)
    inverse = np.linalg.lstsq(jv, (after - before).ravel(), rcond=None)[0].item()
    assert estimate_depth(CAMERA, moves, before, after) == pytest.approx(1 / inverse)


def test_several_noisy_pairs_know_the_depth_better_than_one():
    rng = np.random.default_rng(1)
    moves = np.tile([(0.02, 0, 0), (-0.02, 0, 0), (0, 0.02, 0), (0, -0.02, 0)], (4, 1))
    before, errors = np.tile(CENTER, (16, 1)), {1: [], 16: []}
    for _ in range(200):
        after = CAMERA.project(np.array([0, 0, 0.25]) - moves) + rng.normal(0, 1, (16, 2))
        for n in errors:
            errors[n].append(abs(estimate_depth(CAMERA, moves[:n], before[:n], after[:n]) - 0.25))
    assert np.median(errors[16]) < np.median(errors[1]) / 3


def test_a_motion_across_the_shift_does_not_spoil_it():
    # J_t v along u alone; what the pixel does along v is noise, and is projected out.
    assert estimate_depth(CAMERA, [0.02, 0, 0], CENTER, CENTER + (-42.4, 7.0)) == pytest.approx(0.25)


# No depth


@pytest.mark.parametrize("after", [CENTER, CENTER + (10, 0)], ids=["unmoved", "the wrong way"])
def test_a_point_that_did_not_move_or_moved_the_wrong_way_is_infinitely_far(after):
    assert estimate_depth(CAMERA, [0.02, 0, 0], CENTER, after) == np.inf


@pytest.mark.parametrize("moved", [(0, 0, 0), (0, 0, 0.05), (5e-7, 0, 0)])
def test_a_motion_that_shifts_nothing_is_refused_with_what_would_work(moved):
    with pytest.raises(InvalidParameterError, match="move the camera sideways, by a centimeter or more"):
        estimate_depth(CAMERA, moved, CENTER, CENTER)


def test_a_motion_straight_toward_a_point_off_the_axis_tells_a_depth():
    point = np.array([0.05, 0.0, 0.4])
    before, after = CAMERA.project([point, point - (0, 0, 0.1)])
    assert estimate_depth(CAMERA, [0, 0, 0.1], before, after) == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("moved", "before", "after"),
    [
        ([0.02, 0], CENTER, CENTER),
        ([0.02, 0, 0], [1.0, 2.0, 3.0], CENTER),
        ([0.02, 0, 0], CENTER, [CENTER, CENTER]),
        ([[0.02, 0, 0]] * 2, CENTER, CENTER),
    ],
)
def test_shapes_that_do_not_match_are_refused_and_named(moved, before, after):
    with pytest.raises(InvalidParameterError, match=r"shape \(3,\) and a pixel \(u, v\).*or n of each; got shapes"):
        estimate_depth(CAMERA, moved, before, after)


@pytest.mark.parametrize("which", range(3))
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_refused(which, bad):
    numbers = [np.array([0.02, 0, 0]), CENTER.copy(), CENTER - (42.4, 0)]
    numbers[which][0] = bad
    with pytest.raises(InvalidParameterError, match="finite"):
        estimate_depth(CAMERA, *numbers)


# Range


@given(POINTS)
def test_the_range_is_the_distance_to_the_point(point):
    assert range_to(OBLONG, point[2], OBLONG.project(point)) == pytest.approx(np.linalg.norm(point))


def test_an_infinite_depth_is_an_infinite_range():
    assert range_to(CAMERA, np.inf, (100, 100)) == np.inf
