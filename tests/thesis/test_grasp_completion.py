"""What thesis 2.3, Grasp Completion, says, sentence by sentence."""

import inspect

import numpy as np
import pytest
from eye_in_hand import CAMERA, Plate, white
from hands import HAND, SHUT, PlainGripper, above, aligned

from gvp_lib.perception.moments import Blob
from gvp_lib.planning.grasp import GraspExecutor, GraspOutcome, RangeThreshold
from gvp_lib.planning.image_moments import ImageMomentPlanner
from gvp_lib.simulation.workcell import WorkCell

BRICK = Plate(sides=(0.020, 0.032))  # m


def completed(arm, segmenter=white, **options):
    return GraspExecutor(segmenter, **options).grasp(arm, PlainGripper(arm))


def default(name):
    return inspect.signature(GraspExecutor).parameters[name].default


def heights(done):
    return np.array([reading.base_from_camera.translation[2] for reading in done.readings])


def test_after_the_gripper_is_in_its_pose_the_arm_moves_in_the_direction_of_the_lens():
    arm = above(BRICK)
    before = arm.camera_pose()
    done = completed(arm)
    x, y, z = (before.inv() * done.closed_at).translation
    assert z > 0.15
    assert (x, y) == pytest.approx((0, 0), abs=0.001)


def test_it_begins_at_the_radius_at_which_a_plan_ends():
    assert default("distance") == inspect.signature(ImageMomentPlanner).parameters["radius"].default == 0.25


def test_it_moves_incrementally():
    done = completed(above(BRICK))
    np.testing.assert_allclose(np.diff(heights(done)), -default("step"), atol=1e-6)
    assert len(done.readings) > 30


def test_at_each_increment_the_camera_is_recentered_on_the_centroid():
    pictures = []

    def seen(rgb):
        mask = white(rgb)
        pictures.append(Blob.from_mask(mask).centroid - CAMERA.principal_point)
        return mask

    done = completed(above(BRICK, off=(40, 30)), seen)
    assert len(pictures) == done.frames == len(done.readings)  # a picture at each
    off = np.abs(pictures).max(axis=1)
    assert off[0] > 25
    assert off[1:].max() <= default("threshold") + 1


def test_recentering_is_by_turning_as_in_algorithm_1():
    assert default("recenter") == "turning"
    arm = above(BRICK, off=(40, 30))
    before = arm.camera_pose()
    done = completed(arm)
    turned = (before.rotation.inv() * done.closed_at.rotation).magnitude()
    assert turned == pytest.approx(np.arctan(50 / CAMERA.fx), abs=0.01)


def test_it_remains_centered_between_the_grippers():
    done = completed(above(BRICK, off=(40, 30)))
    across = done.closed_at.inv().apply([0.0, 0.0, 0.0])[0]
    assert abs(across) < 0.001


def test_alignment_with_the_major_axis_can_be_performed_and_is_not():
    assert default("realign") is False
    for realign, left in ((True, 0.0), (False, 15.0)):
        arm = above(BRICK, turn=np.radians(15))
        GraspExecutor(white, realign=realign).grasp(arm, PlainGripper(arm))
        _, y, _ = arm.camera_pose().rotation.as_matrix().T
        assert np.degrees(np.arccos(min(1.0, abs(y[1])))) == pytest.approx(left, abs=1.0)


def test_the_descent_is_complete_when_the_sensor_detects_an_object_within_10_cm():
    assert GraspExecutor(white).closing == RangeThreshold(0.10)
    done = completed(above(BRICK))
    assert done.readings[-1].distance < 0.10
    assert all(reading.distance >= 0.10 for reading in done.readings[:-1])


def test_the_sensor_sees_from_behind_the_lens_so_that_10_cm_is_20_mm_of_fingertip():
    done = completed(above(BRICK), step=0.001)
    assert HAND.tips - done.closed_at.translation[2] == pytest.approx(0.020, abs=0.001)


def test_at_which_point_the_grippers_are_closed_and_the_object_is_lifted_up_from_the_surface():
    arm = above(BRICK)
    gripper = PlainGripper(arm)
    done = GraspExecutor(white).grasp(arm, gripper)
    assert gripper.told == ["open", "close"]
    assert done.width > SHUT
    assert done.outcome is GraspOutcome.HELD
    assert arm.camera_pose().translation[2] - done.closed_at.translation[2] == pytest.approx(0.10)


def test_completing_the_grasp():
    with WorkCell("baxter", "cuboid_1x2", "raised", seed=3) as cell:
        aligned(cell)
        before = cell.truth.world_from_object.translation[2]
        assert GraspExecutor(cell.segmenter).grasp(cell.arm, cell.gripper).outcome is GraspOutcome.HELD
        assert cell.truth.world_from_object.translation[2] - before > 0.05
