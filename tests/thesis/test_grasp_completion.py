"""What thesis 2.3, Grasp Completion, says, sentence by sentence."""

import inspect

import numpy as np
import pytest
from eye_in_hand import CAMERA, Plate, white
from hands import HAND, SHUT, PlainGripper, above

from gvp_lib.motion.arm import Outcome
from gvp_lib.perception.blobs import Blob
from gvp_lib.planning.closing import RangeThreshold
from gvp_lib.planning.grasp import GraspExecutor
from gvp_lib.planning.image_moments import ImageMomentPlanner

BRICK = Plate(sides=(0.020, 0.032))  # m
OFF = (40, 30)  # px, from the middle of the first picture


def default(name, of=GraspExecutor):
    return inspect.signature(of).parameters[name].default


@pytest.fixture(scope="module")
def completed():
    """A grasp with everything as in the thesis: arm, gripper, grasp, and where the object showed, px off the middle."""
    arm = above(BRICK, off=OFF)
    gripper, shown = PlainGripper(arm), []

    def segmenter(rgb):
        mask = white(rgb)
        shown.append(Blob.from_mask(mask).centroid - CAMERA.principal_point)
        return mask

    return arm, gripper, GraspExecutor.thesis(segmenter).grasp(arm, gripper), np.abs(shown).max(axis=1)


def test_after_the_gripper_is_in_its_pose_the_arm_moves_incrementally_in_the_direction_of_the_lens(completed):
    _, _, done, _ = completed
    assert default("distance") == default("radius", ImageMomentPlanner) == 0.25  # where a plan ends
    poses = [reading.base_from_camera for reading in done.readings]
    steps = [poses[k].rotation.inv().apply(poses[k + 1].translation - poses[k].translation) for k in range(1, 30)]
    np.testing.assert_allclose(steps, np.tile([0, 0, default("step")], (29, 1)), atol=1e-4)
    assert len(poses) > 30


def test_at_each_increment_the_camera_is_recentered_on_the_centroid_by_turning_as_in_algorithm_1(completed):
    _, _, done, off = completed
    assert GraspExecutor.thesis(white).recenter == "turning"
    assert len(off) == done.frames == len(done.readings)  # a picture at each
    assert off[0] > 25
    assert off[1:].max() <= default("threshold") + 1
    turned = (done.readings[0].base_from_camera.rotation.inv() * done.closed_at.rotation).magnitude()
    assert turned == pytest.approx(np.arctan(np.hypot(*OFF) / CAMERA.fx), abs=0.01)


def test_it_remains_centered_between_the_grippers(completed):
    _, _, done, _ = completed
    assert abs(done.closed_at.inv().apply([0.0, 0.0, 0.0])[0]) < 0.001


def test_alignment_with_the_major_axis_can_be_performed_and_is_not():
    assert default("realign") is False
    for realign, left in ((True, 0.0), (False, 15.0)):
        arm = above(BRICK, turn=np.radians(15))
        done = GraspExecutor.thesis(white, realign=realign).grasp(arm, PlainGripper(arm))
        _, y, _ = done.closed_at.rotation.as_matrix().T
        assert np.degrees(np.arccos(min(1.0, abs(y[1])))) == pytest.approx(left, abs=1.0)


def test_the_descent_is_complete_when_the_sensor_detects_an_object_within_10_cm(completed):
    _, _, done, _ = completed
    assert GraspExecutor.thesis(white).closing == RangeThreshold(0.10)
    assert done.readings[-1].distance < 0.10
    assert all(reading.distance >= 0.10 for reading in done.readings[:-1])
    # It sees from behind the lens, so that 10 cm is 20 mm of fingertip, and at most a step more.
    assert 0.020 <= HAND.tips - done.closed_at.translation[2] < 0.020 + default("step")


def test_at_which_point_the_grippers_are_closed_and_the_object_is_lifted_up_from_the_surface(completed):
    arm, gripper, done, _ = completed
    assert gripper.told == ["open", "close"]
    assert done.width > SHUT
    assert done.outcome is Outcome.HELD
    np.testing.assert_allclose(arm.camera_pose().translation, done.closed_at.translation + (0, 0, 0.10), atol=1e-9)
