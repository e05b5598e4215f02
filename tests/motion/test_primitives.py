"""The four motions, as a camera without a simulator makes them, and the depth that a known motion shows."""

import numpy as np
import pytest
from eye_in_hand import CAMERA, PinholeArm
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arm import Hand, Motion, Outcome
from gvp_lib.motion.primitives import advance, estimate_depth, pitch, range_to, roll, toward_pixel, yaw

pytestmark = pytest.mark.check

CENTER = CAMERA.principal_point
U = st.floats(0, CAMERA.width - 1)
V = st.floats(0, CAMERA.height - 1)


@pytest.mark.parametrize("at_limit", [False, True], ids=["wrist free", "wrist at its limit"])
@pytest.mark.parametrize(("motion", "axis"), [(yaw, "y"), (pitch, "x"), (roll, "z")])
def test_a_turn_is_about_its_axis_and_leaves_the_camera_where_it_is(motion, axis, at_limit):
    arm = PinholeArm(tilt=0.3)
    if at_limit:
        arm.rotate_wrist = lambda angle: Motion(False, Outcome.JOINT_LIMIT)
    before = arm.camera_pose()
    assert motion(arm, 0.3)
    np.testing.assert_allclose(arm.camera_pose().translation, before.translation, atol=1e-12)
    assert (before.inv() * arm.camera_pose()).rotation.approx_equal(Rotation.from_euler(axis, 0.3))


def test_an_advance_goes_toward_what_is_seen():
    arm = PinholeArm(tilt=0.3)
    assert advance(arm, 0.05)
    np.testing.assert_allclose(arm.camera_pose().inv().apply([0, 0, 0]), [0, 0, 0.20], atol=1e-12)


@given(U, V)
def test_the_optical_axis_comes_to_pass_through_the_pixel_exactly_and_the_horizon_does_not_lean(u, v):
    turned = toward_pixel(CAMERA, (u, v))
    np.testing.assert_allclose(turned.apply([0, 0, 1]), CAMERA.rays((u, v)), atol=1e-12)
    assert turned.apply([1, 0, 0])[1] == pytest.approx(0, abs=1e-12)


OBLONG = CameraIntrinsics(640, 480, 530.0, 610.0, 300.0, 250.0)  # pixels that are not square
SIDEWAYS = st.floats(0.005, 0.1) | st.floats(-0.1, -0.005)
SMALL = st.floats(-0.1, 0.1)
POINTS = st.tuples(st.floats(-0.15, 0.15), st.floats(-0.15, 0.15), st.floats(0.2, 2.0))


@given(POINTS, SIDEWAYS, SMALL, SMALL)
def test_the_depth_after_any_finite_motion_is_exact_and_so_is_the_range(point, dx, dy, dz):
    moved = np.array([dx, dy, dz])
    before, after = OBLONG.project([point, point - moved])
    jv = -moved[:2] * (OBLONG.fx, OBLONG.fy) + (before - OBLONG.principal_point) * dz
    assume(np.linalg.norm(jv) > 1)  # px m: the motion is not straight toward the point
    depth = estimate_depth(OBLONG, moved, before, after)
    assert depth == pytest.approx(point[2] - dz, rel=1e-9)
    assert range_to(OBLONG, depth, after) == pytest.approx(np.linalg.norm(point - moved))


def test_several_pairs_are_solved_by_least_squares_in_the_inverse_depth():
    moves = np.array([(0.02, 0, 0), (0, 0.02, 0), (-0.03, 0.01, 0)])
    before = np.tile(CENTER, (3, 1))
    after = CAMERA.project(np.array([0, 0, 0.25]) - moves) + np.random.default_rng(0).normal(0, 1, (3, 2))
    jv = (-530 * moves[:, :2]).reshape(-1, 1)
    inverse = np.linalg.lstsq(jv, (after - before).ravel(), rcond=None)[0].item()
    assert estimate_depth(CAMERA, moves, before, after) == pytest.approx(1 / inverse)


@pytest.mark.parametrize(
    ("moved", "before", "after", "depth"),
    [
        # J_t v along u alone; what the pixel does along v is noise, and is projected out.
        ([0.02, 0, 0], CENTER, CENTER + (-42.4, 7.0), 0.25),
        # Straight ahead, toward a point off the axis.
        ([0, 0, 0.1], *CAMERA.project([(0.05, 0, 0.4), (0.05, 0, 0.3)]), 0.3),
        # It did not move, or the wrong way: infinitely far.
        ([0.02, 0, 0], CENTER, CENTER, np.inf),
        ([0.02, 0, 0], CENTER, CENTER + (10, 0), np.inf),
    ],
)
def test_the_depth_of_special_motions(moved, before, after, depth):
    assert estimate_depth(CAMERA, moved, before, after) == pytest.approx(depth)
    assert range_to(CAMERA, depth, CENTER) == pytest.approx(depth)


SHAPES = r"translation of shape \(3,\), m, and a pixel \(u, v\) before and after it, or n of each; got shapes \(.*\)$"
USELESS = "move the camera sideways, by a centimeter or more"


def depth(moved, before=CENTER, after=CENTER):
    return estimate_depth(CAMERA, moved, before, after)


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: depth([0, 0, 0.05]), USELESS),
        (lambda: depth([5e-7, 0, 0]), USELESS),
        (lambda: depth([0.02, 0]), SHAPES),
        (lambda: depth([0.02, 0, 0], before=[1.0, 2.0, 3.0]), SHAPES),
        (lambda: depth([[0.02, 0, 0]] * 2), SHAPES),
        (lambda: depth([0.02, 0, 0], after=CENTER * np.nan), "are finite numbers"),
        (lambda: toward_pixel(CAMERA, (1.0, np.inf)), r"pixel is finite, of shape \(2,\); got \(1.0, inf\)"),
        (lambda: toward_pixel(CAMERA, 5.0), r"shape \(2,\); got 5\.0"),
        (lambda: Motion(True, Outcome.COLLISION), "got reached=True and reason=<Outcome.COLLISION"),
        (lambda: Motion(False, "tired"), r"one of Outcome.JOINT_LIMIT, .*and reason='tired'"),
        (lambda: Motion(False, Outcome.REACHED), r"one of Outcome.JOINT_LIMIT, .*got reached=False"),
        (lambda: Hand(sensor=0.0, tips=0.1, breadth=-0.01), "thickness and breadth are in m.*got .*breadth -0.01"),
        (lambda: Hand(sensor=0.1, tips=0.05), "fingertips stand ahead of its sensor and its palm.*got sensor 0.1"),
    ],
)
def test_what_tells_no_depth_is_no_pixel_or_contradicts_itself_is_refused_with_what_would_work(call, text):
    with pytest.raises(InvalidParameterError, match=text):
        call()


@pytest.mark.parametrize("reason", ["reached", "joint limit", "collision", "contact"])
def test_an_arm_may_give_a_reason_as_text(reason):
    motion = Motion(reason == "reached", reason)
    assert motion.reason is Outcome(reason)
    assert repr(motion) == f"Motion({reason})"
