"""A look through the camera: what it finds, what it remembers, what it reports."""

import numpy as np
import pytest
from eye_in_hand import Ball, Hindered, PinholeArm, white
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.primitives import planar_step, yaw
from gvp_lib.motion.sighting import Eye
from gvp_lib.perception.blobs import Tracker

pytestmark = pytest.mark.check


def test_a_view_holds_the_blob_the_joints_and_the_pose_of_its_moment():
    arm = PinholeArm(tilt=0.2)
    view = Eye(arm, white).look()
    joints, pose = arm.joints, arm.camera_pose()
    planar_step(arm, 0.02, 0.0)
    np.testing.assert_array_equal(view.joints, joints)
    with pytest.raises(ValueError, match="read-only"):
        view.joints[0] = 0
    np.testing.assert_array_equal(view.base_from_camera.as_matrix(), pose.as_matrix())
    np.testing.assert_allclose(view.line_of_sight, pose.rotation.apply([0.0, 0.0, 1.0]), atol=1e-12)
    np.testing.assert_allclose(view.blob.centroid, arm.intrinsics.principal_point, atol=0.3)
    assert not view.clipped
    assert view.rgb is None


def test_a_blob_at_the_border_is_clipped_and_the_picture_is_kept_where_asked_for():
    arm = PinholeArm(Ball(radius=0.02))
    yaw(arm, np.arctan(310 / 530))
    view = Eye(arm, white, keep_images=True).look()
    assert view.clipped
    np.testing.assert_array_equal(view.rgb, arm.capture())


def test_whoever_watches_gets_every_look_and_the_misses_too():
    seen = []
    arm = Hindered(PinholeArm(), blind=lambda arm: arm.frames == 2)
    eye = Eye(arm, white, on_look=lambda rgb, blob: seen.append((rgb.shape, blob)))
    first, none, last = (eye.look() for _ in range(3))
    assert none is None
    assert seen == [((480, 640, 3), first.blob), ((480, 640, 3), None), ((480, 640, 3), last.blob)]
    assert eye.looks == 3


def test_the_object_nearest_the_middle_is_ours_or_the_one_that_a_tracker_of_your_own_chooses():
    arm, tracker = PinholeArm(Ball(), Ball((0.06, 0, 0), radius=0.02)), Tracker(white, "largest")
    assert Eye(arm, tracker).tracker is tracker
    for segmenter, in_the_middle in ((white, True), (tracker, False)):
        off = np.linalg.norm(Eye(arm, segmenter).look().blob.centroid - arm.intrinsics.principal_point)
        assert off < 1 if in_the_middle else off > 100


@pytest.mark.parametrize("told", [False, True])
def test_expecting_a_view_looks_in_the_middle_and_not_where_the_object_was_last(told):
    arm = PinholeArm(Ball(), Ball((-0.06, 0, 0)))
    eye = Eye(arm, white)
    start = eye.look()
    to_the_right = arm.camera_pose().rotation.inv().apply([0.02, 0, 0])  # along the base's x
    for _ in range(3):
        arm.move_camera(RigidTransform.from_translation(to_the_right))
        assert eye.look() is not None
    arm.move_joints(start.joints)  # now the other is where ours was last
    if told:
        eye.expect(start)
    assert bool(np.linalg.norm(eye.look().blob.centroid - start.blob.centroid) < 1) is told


def test_who_expects_nothing_takes_what_is_in_the_middle_whatever_its_size():
    arm = PinholeArm()
    eye = Eye(arm, white)
    eye.look()
    arm.shapes = (Ball(radius=0.03),)
    assert eye.look() is None
    eye.expect(None)
    assert eye.look() is not None


@pytest.mark.parametrize(
    ("arm", "segmenter", "text"),
    [
        (PinholeArm(), None, "from an RGB image.* to the mask .*; got a NoneType"),
        (PinholeArm(), Tracker, "from an RGB image.* to the mask .*; got a type, <class"),
        (object(), white, r"an EyeInHandArm \(an object with capture\(\), .*; got an object"),
    ],
)
def test_what_no_eye_is_made_of_is_refused_with_what_one_is(arm, segmenter, text):
    with pytest.raises(InvalidParameterError, match=text):
        Eye(arm, segmenter)
