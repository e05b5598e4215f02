"""The four motions, as a camera without a simulator makes them."""

import numpy as np
import pytest
from eye_in_hand import CAMERA, Ball, PinholeArm, Plate, white
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arm import EyeInHandArm, Motion, StopReason
from gvp_lib.motion.primitives import advance, pitch, planar_step, planar_vector, roll, toward_pixel, turn, yaw
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
