"""A look through the camera: what it finds, what it remembers, what it reports."""

import numpy as np
import pytest
from eye_in_hand import Ball, Hindered, PinholeArm, white

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.primitives import advance, planar_step, yaw
from gvp_lib.motion.sighting import Eye
from gvp_lib.perception.tracking import Tracker

pytestmark = pytest.mark.check


def test_a_view_holds_the_blob_the_joints_and_the_pose_of_its_moment():
    arm = PinholeArm(tilt=0.2)
    eye = Eye(arm, white)
    view = eye.look()
    joints, pose = arm.joints, arm.camera_pose()
    planar_step(arm, 0.02, 0.0)
    np.testing.assert_array_equal(view.joints, joints)
    np.testing.assert_array_equal(view.base_from_camera.as_matrix(), pose.as_matrix())
    np.testing.assert_allclose(view.line_of_sight, pose.rotation.apply([0.0, 0.0, 1.0]), atol=1e-12)
    np.testing.assert_allclose(view.blob.centroid, arm.intrinsics.principal_point, atol=0.3)
    assert not view.clipped


def test_nothing_in_view_is_no_view():
    eye = Eye(PinholeArm(Ball((5.0, 0, 0))), white)
    assert eye.look() is None
    assert eye.looks == 1


def test_a_blob_at_the_border_is_clipped():
    arm = PinholeArm(Ball(radius=0.02))
    yaw(arm, np.arctan(310 / 530))
    assert Eye(arm, white).look().clipped


def test_pictures_are_kept_only_where_asked_for():
    arm = PinholeArm()
    assert Eye(arm, white).look().rgb is None
    kept = Eye(arm, white, keep_images=True).look().rgb
    np.testing.assert_array_equal(kept, arm.capture())


def test_whoever_watches_gets_every_look_and_the_misses_too():
    seen = []
    arm = Hindered(PinholeArm(), blind=lambda arm: arm.frames == 2)
    eye = Eye(arm, white, on_look=lambda rgb, blob: seen.append((rgb.shape, blob)))
    views = [eye.look() for _ in range(3)]
    assert [shape for shape, _ in seen] == [(480, 640, 3)] * 3
    assert [blob for _, blob in seen] == [views[0].blob, None, views[2].blob]
    assert eye.looks == 3


# Which of several


def test_the_object_nearest_the_middle_is_ours_and_not_the_largest():
    arm = PinholeArm(Ball(), Ball((0.06, 0, 0), radius=0.02))
    view = Eye(arm, white).look()
    np.testing.assert_allclose(view.blob.centroid, arm.intrinsics.principal_point, atol=0.3)


def test_the_object_is_kept_though_another_comes_to_the_middle():
    arm = PinholeArm(Ball(), Ball((0.0, 0.06, 0)))
    eye = Eye(arm, white)
    before = eye.look().blob.centroid
    for _ in range(6):
        # Toward the other one, wherever that is in the image.
        step = arm.camera_pose().rotation.inv().apply([0, 0.01, 0])
        planar_step(arm, 0.01, np.arctan2(-step[1], step[0]))
        view = eye.look()
        assert np.linalg.norm(view.blob.centroid - before) == pytest.approx(21.2, abs=0.5)
        before = view.blob.centroid
    assert np.linalg.norm(before - arm.intrinsics.principal_point) > 100


def test_a_caller_who_knows_how_the_camera_moved_says_where_to_look():
    arm = PinholeArm(Ball(), Ball((0.04, 0, 0)))
    for knows in (False, True):
        arm.move_joints(PinholeArm().joints)
        eye = Eye(arm, white)
        first = eye.look()
        step = arm.camera_pose().rotation.inv().apply([0.04, 0, 0])
        planar_step(arm, 0.04, np.arctan2(-step[1], step[0]))  # now the other is where ours was
        goal = first.blob.centroid - 530 * step[:2] / 0.25
        found = eye.look(goal if knows else None).blob.centroid
        assert bool(np.linalg.norm(found - goal) < 1) is knows


def test_an_object_that_merges_with_another_is_lost_rather_than_larger():
    arm = PinholeArm()
    eye = Eye(arm, white)
    assert eye.look() is not None
    arm.shapes = (Ball(), Ball((0.008, 0, 0)))
    assert eye.look() is None
    arm.shapes = (Ball(),)
    assert eye.look() is not None


def test_how_much_an_object_may_grow_is_an_option():
    for growth, found in ((1.5, False), (3.0, True)):
        arm = PinholeArm()
        eye = Eye(arm, white, max_growth=growth)
        eye.look()
        arm.shapes = (Ball(), Ball((0.008, 0, 0)))
        assert (eye.look() is not None) is found


# What to expect


def test_after_a_great_approach_the_object_is_known_again_by_the_size_it_should_have():
    for told in (False, True):
        arm = PinholeArm(radius=0.5)
        eye = Eye(arm, white)
        view = eye.look()
        advance(arm, 0.25)
        if told:
            eye.expect(view, growth=2.0)
        assert (eye.look() is not None) is told


def test_expecting_a_view_looks_in_the_middle_and_not_where_the_object_was_last():
    for told in (False, True):
        arm = PinholeArm(Ball(), Ball((-0.06, 0, 0)))
        eye = Eye(arm, white)
        start = eye.look()
        for _ in range(3):
            step = arm.camera_pose().rotation.inv().apply([0.02, 0, 0])
            planar_step(arm, 0.02, np.arctan2(-step[1], step[0]))
            assert eye.look() is not None
        arm.move_joints(start.joints)  # now the other is where ours was last
        if told:
            eye.expect(start)
        ours = np.linalg.norm(eye.look().blob.centroid - start.blob.centroid) < 1
        assert bool(ours) is told


def test_who_expects_nothing_takes_what_is_in_the_middle_whatever_its_size():
    arm = PinholeArm()
    eye = Eye(arm, white)
    eye.look()
    arm.shapes = (Ball(radius=0.03),)
    assert eye.look() is None
    eye.expect(None)
    assert eye.look() is not None


# What an eye is made of


def test_a_tracker_of_your_own_is_used_as_it_is():
    tracker = Tracker(white, "largest")
    arm = PinholeArm(Ball(), Ball((0.06, 0, 0), radius=0.02))
    eye = Eye(arm, tracker)
    assert eye.tracker is tracker
    assert np.linalg.norm(eye.look().blob.centroid - arm.intrinsics.principal_point) > 100


@pytest.mark.parametrize("segmenter", [None, "red", np.zeros((4, 4), bool)])
def test_what_is_no_segmenter_is_refused_with_what_is_one(segmenter):
    with pytest.raises(InvalidParameterError, match=r"returns a mask, such as HsvThreshold\(hue=\(345, 15\)\); got"):
        Eye(PinholeArm(), segmenter)


def test_a_growth_that_makes_no_sense_is_refused():
    with pytest.raises(InvalidParameterError, match="max_growth above 1"):
        Eye(PinholeArm(), white, max_growth=1.0)
