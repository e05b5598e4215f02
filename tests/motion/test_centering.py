"""Centering by turning and by shifting, and the alignment of the wrist."""

import numpy as np
import pytest
from eye_in_hand import CAMERA, Ball, Hindered, PinholeArm, Plate, white
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arm import Motion, Outcome
from gvp_lib.motion.primitives import toward_pixel, yaw
from gvp_lib.motion.sighting import Eye, align_with_major_axis, center_on_object

pytestmark = pytest.mark.check


def off_center(offset, *shapes, hindrance=None, **where):
    """A pinhole arm whose object shows ``offset`` px from the middle, and an eye that looks through it."""
    arm = PinholeArm(*shapes, **where)
    away = toward_pixel(CAMERA, CAMERA.principal_point - offset)
    arm.move_camera(RigidTransform.from_rotation(away))
    return arm, Eye(Hindered(arm, **(hindrance or {})), white)


@given(st.floats(-270, 270), st.floats(-190, 190), st.sampled_from([0.12, 0.25, 0.5]))
def test_wherever_a_ball_is_in_the_image_and_at_any_distance_one_turn_on_the_spot_is_enough(du, dv, radius):
    # Erratum 8: error >= thresh, as printed, is never true of a negative error; and no closer object asks for more of a
    # turn than atan(e / f).
    arm, eye = off_center((du, dv), radius=radius)
    before = arm.camera_pose()
    centered = center_on_object(eye, threshold=0.5)
    assert centered
    assert len(centered.errors) <= 2
    moved = before.inv() * arm.camera_pose()
    np.testing.assert_allclose(moved.translation, 0, atol=1e-9)
    x, y, z = moved.rotation.apply([0, 0, 1])
    assert np.hypot(x, y) / z == pytest.approx(np.hypot(du, dv) / CAMERA.fx, abs=2e-3)


def test_an_object_in_the_middle_is_left_there():
    _, eye = off_center((0, 0))
    assert center_on_object(eye).outcome == "reached"
    assert (eye.looks, eye.arm.motions) == (1, 0)


@pytest.mark.parametrize(("depth", "looks"), [(0.3, {2}), (0.2, {3, 4, 5})])
def test_shifting_keeps_the_direction_of_view_and_by_a_wrong_depth_only_takes_longer(depth, looks):
    arm, eye = off_center((0, 0), radius=0.3)
    arm.move_camera(RigidTransform.from_translation([0.05, -0.03, 0]))
    before = arm.camera_pose()
    centered = center_on_object(eye, depth=depth)
    assert centered
    assert len(centered.errors) in looks
    moved = before.inv() * arm.camera_pose()
    assert moved.rotation.magnitude() == pytest.approx(0, abs=1e-9)
    np.testing.assert_allclose(moved.translation, [-0.05, 0.03, 0], atol=1.2e-3)


@pytest.mark.parametrize("seen", [0, 1])
def test_an_object_out_of_sight_is_no_error_and_leaves_the_offsets_so_far(seen):
    _, eye = off_center((100, 0), hindrance={"blind": lambda arm: arm.frames > seen})
    centered = center_on_object(eye)
    assert (bool(centered), centered.view, centered.outcome) == (False, None, "target lost")
    np.testing.assert_allclose(centered.errors, np.tile((100.0, 0.0), (seen, 1)), atol=0.5)
    assert centered.motion


@pytest.mark.parametrize("reason", [Outcome.JOINT_LIMIT, Outcome.CONTACT])
def test_a_motion_that_stops_half_way_is_reported_with_one_more_look(reason):
    _, eye = off_center((100, 0), hindrance={"stops": {0: reason}})
    centered = center_on_object(eye)
    assert not centered
    assert (centered.motion.reason, centered.outcome) == (reason, reason)
    np.testing.assert_allclose(centered.errors, [[100, 0], [50, 0]], atol=1)
    assert centered.view is not None


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"depth": -0.3}, r"positive and finite, in m, or None to center by turning; got -0\.3"),
        ({"depth": np.inf}, "got inf"),
        ({"threshold": 0}, "threshold > 0 px"),
        ({"max_attempts": -1}, "max_attempts >= 0"),
        ({"gain": 2.0}, r"gain between 0 and 2, which 1 suits; got 2\.0, 8, 2\.0"),
    ],
)
def test_settings_of_a_centering_that_make_no_sense_are_refused_before_anything_moves(arguments, text):
    _, eye = off_center((100, 0))
    with pytest.raises(InvalidParameterError, match=text):
        center_on_object(eye, **arguments)
    assert eye.looks == eye.arm.motions == 0


class Barred(PinholeArm):
    """Its wrist makes no turn of less than ``least`` rad."""

    def __init__(self, shape, reason, least=np.inf):
        super().__init__(shape)
        self.reason, self.least = reason, least

    def rotate_wrist(self, angle):
        return Motion(False, self.reason) if abs(angle) < self.least else super().rotate_wrist(angle)


@pytest.mark.parametrize("yaw_of_plate", [0.1, 2.3])
def test_an_object_far_off_the_middle_is_not_lost_by_the_longer_roll(yaw_of_plate):
    # The other roll, near half a turn, throws a blob to the other side of the image.
    arm = Barred(Plate(yaw=yaw_of_plate), Outcome.JOINT_LIMIT, np.pi / 2)
    yaw(arm, np.arctan(140 / 530))
    aligned = align_with_major_axis(Eye(arm, white))
    assert aligned.view is not None
    assert abs(aligned.errors[-1]) < np.radians(5)
    assert len(aligned.errors) > 1


@pytest.mark.parametrize("reason", [Outcome.COLLISION, Outcome.JOINT_LIMIT])
def test_a_wrist_that_is_stopped_is_reported_with_what_is_missing(reason):
    aligned = align_with_major_axis(Eye(Barred(Plate(yaw=1.0), reason), white))
    assert aligned.outcome is aligned.motion.reason is reason
    assert len(aligned.errors) == 2
    assert aligned.errors[0] == aligned.errors[1] != 0


@given(st.floats(-1.5, 1.5))
def test_whatever_the_roll_one_turn_of_the_wrist_alone_aligns_and_it_is_the_smaller_of_the_two(yaw_of_plate):
    arm, eye = off_center((0, 0), Plate(yaw=yaw_of_plate))
    before = arm.camera_pose().rotation
    aligned = align_with_major_axis(eye)
    assert aligned
    assert len(aligned.errors) == eye.looks <= 2
    assert align_with_major_axis(eye, view=aligned.view)
    assert eye.looks <= 2  # a view that was just taken saves a look
    y = arm.camera_pose().rotation.apply([0, 1, 0])
    assert abs(y @ [np.cos(yaw_of_plate), np.sin(yaw_of_plate), 0]) > np.cos(np.radians(1))
    assert eye.arm.motions == 0
    assert (before.inv() * arm.camera_pose().rotation).magnitude() <= np.pi / 2 + 1e-6


def test_an_object_without_a_major_axis_leaves_the_wrist_where_it_is():
    arm, eye = off_center((0, 0), Ball())
    before = arm.joints
    aligned = align_with_major_axis(eye)
    assert (bool(aligned), aligned.outcome, np.isnan(aligned.errors).tolist()) == (False, "any angle", [True])
    np.testing.assert_array_equal(arm.joints, before)


@pytest.mark.parametrize("seen", [0, 1])
def test_an_object_out_of_sight_is_not_aligned_with(seen):
    _, eye = off_center((0, 0), Plate(yaw=1.0), hindrance={"blind": lambda arm: arm.frames > seen})
    aligned = align_with_major_axis(eye)
    assert (bool(aligned), aligned.outcome, aligned.view, len(aligned.errors)) == (False, "target lost", None, seen)
