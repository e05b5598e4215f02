"""The four motions, as a camera without a simulator makes them."""

import numpy as np
import pytest
from eye_in_hand import CAMERA, Ball, PinholeArm, Plate, white
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arm import EyeInHandArm, Motion, StopReason
from gvp_lib.motion.primitives import (
    advance,
    estimate_depth,
    pitch,
    planar_step,
    planar_vector,
    range_to,
    roll,
    toward_pixel,
    turn,
    yaw,
)
from gvp_lib.perception.moments import Blob

pytestmark = pytest.mark.check

U = st.floats(0, CAMERA.width - 1)
V = st.floats(0, CAMERA.height - 1)


def offset(arm):
    """From the principal point to the centroid, px."""
    return seen(arm).centroid - CAMERA.principal_point


def seen(arm):
    blob = Blob.from_mask(white(arm.capture()))
    assert blob is not None
    return blob


def test_the_pinhole_of_these_tests_is_an_eye_in_hand_arm():
    assert isinstance(PinholeArm(), EyeInHandArm)


# A planar step


@pytest.mark.parametrize(
    ("direction", "displacement"),
    [(0, (1, 0, 0)), (np.pi / 2, (0, -1, 0)), (np.pi, (-1, 0, 0)), (3 * np.pi / 2, (0, 1, 0))],
    ids=["right", "up", "left", "down"],
)
def test_a_planar_step_goes_right_up_left_or_down_in_the_image(direction, displacement):
    np.testing.assert_allclose(planar_vector(0.02, direction), 0.02 * np.array(displacement), atol=1e-12)
    arm = PinholeArm()
    assert planar_step(arm, 0.02, direction)
    # What the camera sees goes the other way: 530 px * 20 mm / 250 mm.
    np.testing.assert_allclose(offset(arm), -42.4 * np.array(displacement[:2]), atol=0.3)


@given(st.floats(-0.1, 0.1), st.floats(-10, 10))
def test_a_planar_step_has_its_length_and_no_depth(distance, direction):
    vector = planar_vector(distance, direction)
    assert np.linalg.norm(vector) == pytest.approx(abs(distance), abs=1e-12)
    assert vector[2] == 0


def test_a_planar_step_is_given_in_the_cameras_frame_and_does_not_turn_it():
    arm = PinholeArm(tilt=0.4, azimuth=1.0)
    before = arm.camera_pose()
    planar_step(arm, 0.02, 0.7)
    after = arm.camera_pose()
    np.testing.assert_allclose((before.inv() * after).translation, planar_vector(0.02, 0.7), atol=1e-12)
    assert (before.rotation.inv() * after.rotation).magnitude() == pytest.approx(0, abs=1e-9)


# Turns on the spot


def test_a_positive_yaw_looks_further_right_and_a_positive_pitch_further_up():
    arm = PinholeArm()
    yaw(arm, 0.1)
    np.testing.assert_allclose(offset(arm), [-530 * np.tan(0.1), 0], atol=0.3)
    arm = PinholeArm()
    pitch(arm, 0.1)
    np.testing.assert_allclose(offset(arm), [0, 530 * np.tan(0.1)], atol=0.3)


def test_a_positive_roll_turns_the_picture_the_other_way():
    arm = PinholeArm(Plate())
    before = seen(arm).orientation
    roll(arm, 0.2)
    assert seen(arm).orientation == pytest.approx((before - 0.2 + np.pi / 2) % np.pi - np.pi / 2, abs=0.01)


@pytest.mark.parametrize("motion", [yaw, pitch, roll])
def test_a_turn_leaves_the_camera_where_it_is(motion):
    arm = PinholeArm(tilt=0.3)
    before = arm.camera_pose()
    assert motion(arm, 0.3)
    np.testing.assert_allclose(arm.camera_pose().translation, before.translation, atol=1e-12)
    assert (before.inv() * arm.camera_pose()).rotation.magnitude() == pytest.approx(0.3)


def test_an_advance_goes_toward_what_is_seen_and_enlarges_it():
    arm = PinholeArm(Ball(radius=0.02), tilt=0.3)
    before = seen(arm).area
    assert advance(arm, 0.05)
    assert np.linalg.norm(arm.camera_pose().translation) == pytest.approx(0.20)
    assert seen(arm).area / before == pytest.approx((0.25 / 0.20) ** 2, rel=0.01)
    np.testing.assert_allclose(offset(arm), 0, atol=0.3)


# Toward a pixel


@given(U, V)
def test_the_optical_axis_comes_to_pass_through_the_pixel_exactly(u, v):
    axis = toward_pixel(CAMERA, (u, v)).apply([0, 0, 1])
    np.testing.assert_allclose(axis, CAMERA.rays((u, v)), atol=1e-12)


@given(U, V)
def test_turning_toward_a_pixel_does_not_lean_the_horizon(u, v):
    assert toward_pixel(CAMERA, (u, v)).apply([1, 0, 0])[1] == pytest.approx(0, abs=1e-12)


@given(st.floats(-5, 5), st.floats(-5, 5))
def test_near_the_middle_the_turn_is_the_proportional_law(e_u, e_v):
    # Erratum 7: yaw = -e_u / f about y, pitch = +e_v / f about x, with e = center - pixel.
    turned = toward_pixel(CAMERA, CAMERA.principal_point - (e_u, e_v)).as_rotvec()
    np.testing.assert_allclose(turned, [e_v / 530, -e_u / 530, 0], atol=1e-4)


@pytest.mark.parametrize("pixel", [(np.nan, 1.0), (1.0, np.inf), (1.0, 2.0, 3.0), 5.0])
def test_what_is_no_pixel_is_refused(pixel):
    with pytest.raises(InvalidParameterError, match=r"a pixel is a finite \(u, v\), shape \(2,\); got"):
        toward_pixel(CAMERA, pixel)


def test_where_the_wrists_limit_is_in_the_way_the_whole_arm_rolls():
    class Limited(PinholeArm):
        def rotate_wrist(self, angle):
            return Motion(False, StopReason.JOINT_LIMIT)

    arm = Limited()
    before = arm.camera_pose()
    assert roll(arm, 0.1)
    np.testing.assert_allclose((before.inv() * arm.camera_pose()).rotation.as_rotvec(), [0, 0, 0.1], atol=1e-9)


# What a motion reports


def test_a_motion_is_true_where_it_reached_its_goal():
    assert Motion(True, StopReason.REACHED)
    assert not Motion(False, StopReason.COLLISION)


@pytest.mark.parametrize(("reached", "reason"), [(True, StopReason.COLLISION), (False, StopReason.REACHED)])
def test_a_motion_that_contradicts_itself_is_refused(reached, reason):
    with pytest.raises(InvalidParameterError, match=rf"reached is {reached} and the reason {reason.value!r}"):
        Motion(reached, reason)


def test_a_turn_is_a_rotation_vector():
    assert turn([0, 0, 0.3]).rotation.approx_equal(Rotation.from_euler("z", 0.3))


# Depth from a known motion


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
