"""What thesis 2.2, 2.3 (Arc Traversal) and A.1 say, sentence by sentence, and what errata 6 to 12 change in it."""

import inspect

import numpy as np
import pytest
from eye_in_hand import CAMERA, Ball, Hindered, PinholeArm, Plate, white
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.motion.arc import ArcEnd, traverse_arc
from gvp_lib.motion.arm import EyeInHandArm, StopReason
from gvp_lib.motion.centering import align_with_major_axis, center_on_object
from gvp_lib.motion.primitives import advance, estimate_depth, planar_step, range_to, roll, toward_pixel
from gvp_lib.motion.sighting import Eye
from gvp_lib.perception.moments import Blob
from gvp_lib.planning.image_moments import ImageMomentPlanner

pytestmark = pytest.mark.check

F = CAMERA.fx
CENTER = CAMERA.principal_point


def move(arm, *translation):
    """A straight motion of the camera, m, in its own frame."""
    arm.move_camera(RigidTransform.from_translation(translation))


def places(arc):
    """Where the camera was at each view of an arc, shape (n, 3), m."""
    return np.array([view.base_from_camera.translation for view in arc.views])


def ranges(arc):
    """True distances from a pinhole's object."""
    return np.linalg.norm(places(arc), axis=1)


def offset(arm: PinholeArm) -> np.ndarray:
    """From the middle of the image to the ball, px, by geometry."""
    return CAMERA.project(arm.camera_pose().inv().apply([0.0, 0.0, 0.0])) - CENTER


def showing_at(u: float, v: float, *shapes: Ball | Plate, radius: float = 0.25) -> PinholeArm:
    """A camera turned on the spot so that the origin shows (u, v) px from the middle."""
    arm = PinholeArm(*shapes, radius=radius)
    away, _ = Rotation.align_vectors([0.0, 0.0, 1.0], CAMERA.rays(CENTER + (u, v)))
    arm.move_camera(RigidTransform.from_rotation(away))
    np.testing.assert_allclose(offset(arm), (u, v), atol=1e-6)
    return arm


# 2.2, Planar Motions


@pytest.mark.parametrize(
    ("direction", "image"), [(0, (1, 0)), (np.pi / 2, (0, -1)), (np.pi, (-1, 0)), (1.5 * np.pi, (0, 1))]
)
def test_0_radians_corresponds_to_right_half_pi_up_pi_left_and_3_half_pi_down(direction, image):
    # Erratum 6: with +y for up, as printed, the camera would go down, whose image is v up.
    arm = PinholeArm()
    planar_step(arm, 0.02, direction)
    np.testing.assert_allclose(offset(arm), -0.02 * F / 0.25 * np.array(image), atol=1e-9)
    printed = PinholeArm()
    move(printed, 0.02 * np.cos(direction), 0.02 * np.sin(direction), 0)
    assert np.allclose(offset(printed), offset(arm)) is (image[1] == 0)


def test_only_the_translation_changes_while_rotation_remains_constant():
    # Erratum 6: what is printed as the position at t + 1 is a displacement, to be added.
    arm = PinholeArm(tilt=0.3, azimuth=0.8)
    before = arm.camera_pose()
    planar_step(arm, 0.02, 1.0)
    after = arm.camera_pose()
    assert (before.rotation.inv() * after.rotation).magnitude() < 1e-9
    displacement = before.rotation.apply([0.02 * np.cos(1.0), -0.02 * np.sin(1.0), 0])
    np.testing.assert_allclose(after.translation, before.translation + displacement, atol=1e-12)


# 2.2, Rotational Motions, and Centering


def test_yaw_is_about_y_and_pitch_about_x_and_both_leave_less_than_a_tenth_of_a_pixel():
    # Erratum 7: as printed yaw is about x, and takes a target at (-42.4, -21.2) to (-42.4, +21.2).
    e_u, e_v = 42.4, 21.2  # center - pixel
    printed = showing_at(-e_u, -e_v)
    printed.move_camera(RigidTransform.from_rotation(Rotation.from_rotvec([e_u / F, 0, 0])))
    np.testing.assert_allclose(offset(printed), [-42.4, 21.2], atol=0.2)
    proportional, exact = showing_at(-e_u, -e_v), showing_at(-e_u, -e_v)
    proportional.move_camera(RigidTransform.from_rotation(Rotation.from_euler("YX", [-e_u / F, e_v / F])))
    exact.move_camera(RigidTransform.from_rotation(toward_pixel(CAMERA, CENTER + offset(exact))))
    assert np.abs(offset(proportional)).max() < 0.1
    assert np.abs(offset(exact)).max() < 1e-9


def test_a_closer_object_requires_no_less_rotation_to_center_on():
    # Erratum 8: the "motion scalar" is said to fall with the radius; a pure rotation needs atan(e / f) at any distance.
    turns = []
    for radius in (0.15, 0.25, 0.5):
        arm = showing_at(100, 0, radius=radius)
        before = arm.camera_pose().rotation
        center_on_object(Eye(arm, white), threshold=0.5)
        turns.append((before.inv() * arm.camera_pose().rotation).magnitude())
    np.testing.assert_allclose(turns, np.arctan(100 / F), atol=1e-3)


def test_algorithm_1_reads_the_centroid_in_its_loop_and_counts_its_attempts():
    # Erratum 8: as printed it reads once and never counts.
    eye = Eye(showing_at(100, 50), white)
    offsets = center_on_object(eye, gain=0.5, max_attempts=3).offsets
    assert eye.looks == 4
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), 111.8 * 0.5 ** np.arange(4), rtol=0.05)


@pytest.mark.parametrize("place", [(-100, 0), (0, -100), (-100, -100), (100, 100)])
def test_algorithm_1_corrects_errors_of_either_sign_while_maintaining_the_same_3d_position(place):
    # Erratum 8: error >= thresh is never true of a negative error.
    arm = showing_at(*place)
    before = arm.camera_pose().translation
    assert center_on_object(Eye(arm, white))
    np.testing.assert_allclose(arm.camera_pose().translation, before, atol=1e-12)


# A.1, Depth Estimation


@pytest.mark.parametrize(
    ("shift", "moved"), [((-42.4, 0), [0.02, 0, 0]), ((0, -42.4), [0, 0.02, 0]), ((0, 42.4), [0, -0.02, 0])]
)
def test_eq_a_1_a_shift_of_42_4_px_by_20_mm_at_f_530_is_a_quarter_of_a_meter(shift, moved):
    assert estimate_depth(CAMERA, moved, CENTER, CENTER + shift) == pytest.approx(0.25)


def test_eq_a_1_u_bar_and_v_bar_are_pixel_coordinates_and_not_distances_traveled():
    # Erratum 9: they matter as soon as the motion has a part along z.
    point, moved = np.array([0.06, -0.04, 0.30]), np.array([0.0, 0.02, 0.03])
    before, after = CAMERA.project([point, point - moved])
    assert estimate_depth(CAMERA, moved, before, after) == pytest.approx(0.27)
    traveled = after - before
    jv = -F * moved[:2] + traveled * moved[2]
    assert abs(jv @ jv / (jv @ traveled) - 0.27) > 0.01


def test_the_estimated_depth_after_a_traversal_along_the_cameras_y_axis_is_the_depth():
    arm = PinholeArm(radius=0.3, tilt=0.4)
    eye = Eye(arm, white)
    before = eye.look().blob.centroid
    move(arm, 0, 0.02, 0)
    assert estimate_depth(CAMERA, [0, 0.02, 0], before, eye.look().blob.centroid) == pytest.approx(0.3, rel=0.01)


# 2.2, Distance Adjustment


def test_after_a_few_translations_the_camera_ends_up_moving_off_from_the_radius():
    # Erratum 10: uncorrected, 20 steps of 20 mm take the range from 0.250 to 0.266 m.
    arc = traverse_arc(Eye(PinholeArm(), white), radius=None, max_angle=np.radians(100))
    steps = np.abs(np.arange(len(arc)) - arc.center)
    np.testing.assert_allclose(ranges(arc), np.hypot(0.25, 0.02 * np.sqrt(steps)), rtol=0.003)
    assert ranges(arc)[steps == 20] == pytest.approx(0.266, abs=0.0007)
    np.testing.assert_allclose(np.delete(arc.ranges, arc.center), np.delete(ranges(arc), arc.center), rtol=0.02)


def test_adjusting_the_radius_based_on_the_estimate_enables_a_more_accurate_traversal():
    arcs = (traverse_arc(Eye(PinholeArm(), white), radius=radius, max_angle=np.radians(80)) for radius in (0.25, None))
    adjusted, drifting = (np.abs(ranges(arc) - 0.25).max() for arc in arcs)
    assert adjusted < 0.003
    assert drifting > 4 * adjusted


def test_a_tangent_step_leaves_the_depth_along_the_old_axis_unchanged():
    # Erratum 10: so to move by Z - radius before recentering, as printed, corrects nothing.
    def depth(arm):
        return arm.camera_pose().inv().apply([0.0, 0.0, 0.0])[2]

    arm, printed = PinholeArm(), PinholeArm()
    move(arm, 0, 0.02, 0)
    assert depth(arm) == pytest.approx(0.25)
    assert range_to(CAMERA, depth(arm), CENTER + offset(arm)) == pytest.approx(np.hypot(0.25, 0.02))
    for _ in range(20):
        move(printed, 0, 0.02, 0)
        advance(printed, depth(printed) - 0.25)
        printed.move_camera(RigidTransform.from_rotation(toward_pixel(CAMERA, CENTER + offset(printed))))
    # What each step adds, the next one takes away: the range stays one step's gain too long.
    assert np.linalg.norm(printed.camera_pose().translation) == pytest.approx(np.hypot(0.25, 0.02), abs=1e-4)


# 2.3, Arc Traversal


def test_it_begins_by_aligning_the_cameras_y_axis_with_the_major_axis_by_the_wrist_alone():
    moved = []

    class Watched(PinholeArm):
        def rotate_wrist(self, angle):
            moved.append(angle)
            return super().rotate_wrist(angle)

    arm = Watched(Plate(sides=(0.06, 0.03), yaw=0.7))
    before = arm.camera_pose()
    assert align_with_major_axis(Eye(arm, white))
    turned = (before.inv() * arm.camera_pose()).rotation.as_rotvec()
    np.testing.assert_allclose(turned, [0, 0, sum(moved)], atol=1e-9)
    y = arm.camera_pose().rotation.apply([0, 1, 0])
    assert abs(y @ [np.cos(0.7), np.sin(0.7), 0]) > np.cos(np.radians(1))


@pytest.mark.parametrize("reason", [StopReason.JOINT_LIMIT, StopReason.COLLISION])
def test_it_moves_both_directions_until_a_joint_limit_is_reached_or_a_collision_occurs(reason):
    arc = traverse_arc(Eye(Hindered(PinholeArm(), stops={8: reason, 15: reason}), white))
    assert (len(arc), arc.center, arc.ends) == (8, 3, (ArcEnd(reason.value), ArcEnd(reason.value)))


def test_it_saves_the_joint_angles_associated_with_each_viewpoint():
    arm = PinholeArm(tilt=0.2)
    for view in traverse_arc(Eye(arm, white), max_angle=0.4).views:
        assert arm.move_joints(view.joints)
        np.testing.assert_allclose(arm.camera_pose().as_matrix(), view.base_from_camera.as_matrix(), atol=1e-9)
        np.testing.assert_allclose(Blob.from_mask(white(arm.capture())).centroid, view.blob.centroid, atol=0.1)


def test_algorithm_2_returns_to_q_0_before_going_the_other_way():
    # Erratum 11: as printed it goes on from the far end, and overwrites q[0].
    arm = Hindered(PinholeArm())
    start, returned = arm.joints, []
    back = arm.move_joints
    arm.move_joints = lambda q: (returned.append(np.array(q)), back(q))[1]
    traverse_arc(Eye(arm, white))
    np.testing.assert_array_equal(returned, [start, start])


def test_if_the_arm_were_to_follow_the_samples_it_would_traverse_a_complete_arc():
    # Erratum 11: the first list reversed, the two joined, the center sample once.
    arc = traverse_arc(Eye(PinholeArm(), white))
    at = places(arc)
    np.testing.assert_allclose(np.linalg.norm(np.diff(at, axis=0), axis=1), 0.02, rtol=0.1)
    assert len({tuple(place) for place in at}) == len(arc)
    chord = np.linalg.norm(at[-1] - at[0])
    assert chord == pytest.approx(2 * 0.25 * np.sin((arc.angles[-1] - arc.angles[0]) / 2), rel=0.02)


def test_with_y_along_the_major_axis_y_turns_about_the_minor_axis_and_x_about_the_major():
    # Erratum 12: "minor-axis traversal" is about the minor axis, and foreshortens the major one.
    plate = Plate(sides=(0.06, 0.03), yaw=0.3)
    shorter = np.cos(np.radians(47))
    for axis, major, minor in (("y", shorter, 1), ("x", 1, shorter)):
        eye = Eye(PinholeArm(plate), white)
        assert align_with_major_axis(eye)
        arc = traverse_arc(eye, axis, max_angle=np.radians(45))
        middle, end = arc.views[arc.center].blob, arc.views[0].blob
        assert end.axis_major_length / middle.axis_major_length == pytest.approx(major, abs=0.06)
        assert end.axis_minor_length / middle.axis_minor_length == pytest.approx(minor, abs=0.06)


def test_the_first_traversal_is_about_the_minor_axis_and_the_order_is_an_option():
    # Erratum 12.
    assert inspect.signature(ImageMomentPlanner).parameters["order"].default == "minor first"


def test_an_uncalibrated_arm_with_only_an_rgb_camera_is_enough():
    # 2.3: no depth, no 3D model, no pose of the object; what motion asks of an arm is in the protocol and nowhere else.
    asked = set()

    class Asked(PinholeArm):
        def __getattribute__(self, name):
            if not name.startswith("_"):
                asked.add(name)
            return super().__getattribute__(name)

    arm = Asked(Plate(yaw=0.4))
    roll(arm, 0.1)
    eye = Eye(arm, white)
    asked.clear()
    center_on_object(eye)
    align_with_major_axis(eye)
    traverse_arc(eye)
    protocol = {name for name in vars(EyeInHandArm) if not name.startswith("_")}
    assert asked - {"shapes", "stand_at"} == protocol  # those two are inside a pinhole
