"""What thesis 2.2, 2.3 (Arc Traversal) and A.1 say, sentence by sentence, and what errata 6 to 12 change in it."""

import numpy as np
import pytest
from eye_in_hand import CAMERA, Ball, PinholeArm, Plate, white
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.motion.arc import traverse_arc
from gvp_lib.motion.arm import EyeInHandArm
from gvp_lib.motion.primitives import advance, estimate_depth, planar_step, range_to, roll, toward_pixel
from gvp_lib.motion.sighting import Eye, align_with_major_axis, center_on_object
from gvp_lib.perception.blobs import Blob
from gvp_lib.planning.image_moments import ImageMomentPlanner

pytestmark = pytest.mark.check

F = CAMERA.fx
CENTER = CAMERA.principal_point


def move(arm, *translation):
    """A straight motion of the camera, m, in its own frame."""
    arm.move_camera(RigidTransform.from_translation(translation))


def ranges(arc):
    """True distances from a pinhole's object."""
    return np.linalg.norm([view.base_from_camera.translation for view in arc.views], axis=1)


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
def test_0_radians_is_right_half_pi_up_pi_left_3_half_pi_down_and_only_the_translation_changes(direction, image):
    # Erratum 6: with +y for up, as printed, the camera would go down, whose image is v up; and what is printed as the
    # position at t + 1 is a displacement, to be added.
    arm, printed = PinholeArm(tilt=0.3, azimuth=0.8), PinholeArm(tilt=0.3, azimuth=0.8)
    before = arm.camera_pose()
    planar_step(arm, 0.02, direction)
    moved = before.inv() * arm.camera_pose()
    assert moved.rotation.magnitude() < 1e-9
    np.testing.assert_allclose(moved.translation, 0.02 * np.array([*image, 0]), atol=1e-9)
    np.testing.assert_allclose(offset(arm), -0.02 * F / 0.25 * np.array(image), atol=1e-9)
    move(printed, 0.02 * np.cos(direction), 0.02 * np.sin(direction), 0)
    assert np.allclose(offset(printed), offset(arm)) is (image[1] == 0)


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


def test_algorithm_1_reads_the_centroid_in_its_loop_and_counts_its_attempts():
    # Erratum 8: as printed it reads once and never counts.
    eye = Eye(showing_at(100, 50), white)
    offsets = center_on_object(eye, gain=0.5, max_attempts=3).errors
    assert eye.looks == 4
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), 111.8 * 0.5 ** np.arange(4), rtol=0.05)


# A.1, Depth Estimation


def test_eq_a_1_u_bar_and_v_bar_are_pixel_coordinates_and_not_distances_traveled():
    # Erratum 9: they matter as soon as the motion has a part along z.
    point, moved = np.array([0.06, -0.04, 0.30]), np.array([0.0, 0.02, 0.03])
    before, after = CAMERA.project([point, point - moved])
    assert estimate_depth(CAMERA, moved, before, after) == pytest.approx(0.27)
    traveled = after - before
    jv = -F * moved[:2] + traveled * moved[2]
    assert abs(jv @ jv / (jv @ traveled) - 0.27) > 0.01


# 2.2, Distance Adjustment


def test_after_a_few_translations_the_camera_moves_off_from_the_radius_unless_that_is_adjusted():
    # Erratum 10: uncorrected, 20 steps of 20 mm take the range from 0.250 to 0.266 m.
    arc = traverse_arc(Eye(PinholeArm(), white), radius=None, max_angle=np.radians(100))
    steps = np.abs(np.arange(len(arc)) - arc.center)
    np.testing.assert_allclose(ranges(arc), np.hypot(0.25, 0.02 * np.sqrt(steps)), rtol=0.003)
    assert ranges(arc)[steps == 20] == pytest.approx(0.266, abs=0.0007)
    np.testing.assert_allclose(np.delete(arc.ranges, arc.center), np.delete(ranges(arc), arc.center), rtol=0.02)
    adjusted = traverse_arc(Eye(PinholeArm(), white), max_angle=np.radians(100))
    assert np.abs(ranges(adjusted) - 0.25).max() < 0.003


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


def test_it_saves_the_joint_angles_associated_with_each_viewpoint():
    arm = PinholeArm(tilt=0.2)
    for view in traverse_arc(Eye(arm, white), max_angle=0.4).views:
        assert arm.move_joints(view.joints)
        np.testing.assert_allclose(arm.camera_pose().as_matrix(), view.base_from_camera.as_matrix(), atol=1e-9)
        np.testing.assert_allclose(Blob.from_mask(white(arm.capture())).centroid, view.blob.centroid, atol=0.1)


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
    assert ImageMomentPlanner(white).order == "minor first"


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
