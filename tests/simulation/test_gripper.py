"""The simulated gripper and its trials: lengths, fingers, what they hold, and a shake."""

from dataclasses import replace

import numpy as np
import pytest
from hands import aligned
from scipy.spatial.transform import RigidTransform

from gvp_lib.motion.arm import Gripper
from gvp_lib.planning.grasp import GraspExecutor, GraspOutcome, SizedDepth
from gvp_lib.simulation.arms import ARMS
from gvp_lib.simulation.moving import record_contacts, shake
from gvp_lib.simulation.workcell import WorkCell

LIFTED = 0.05  # m


@pytest.fixture(scope="module")
def cell():
    with WorkCell("baxter", "cuboid_1x2", seed=3) as made:
        yield made


def with_a_brick_in_its_hand(cell):
    """The cell, the brick's height before, and what the contacts were."""
    aligned(cell)
    before = cell.truth.world_from_object.translation[2]
    with record_contacts(cell) as record:
        done = GraspExecutor(cell.segmenter, SizedDepth(), recenter="shifting").grasp(cell.arm, cell.gripper)
    assert done.outcome is GraspOutcome.HELD
    return cell, before, record


@pytest.fixture
def grasped(cell):
    """A grasp of one's own, for who lets go of it."""
    return with_a_brick_in_its_hand(cell)


@pytest.fixture(scope="module")
def held():
    """A grasp for all who leave the brick in the hand."""
    with WorkCell("baxter", "cuboid_1x2", seed=3) as made:
        yield with_a_brick_in_its_hand(made)


def lifted(cell, before):
    return cell.truth.world_from_object.translation[2] - before >= LIFTED


# The hand's lengths


def test_the_tips_are_78_mm_ahead_of_the_camera_and_the_sensor_42_behind_it(cell):
    hand = cell.gripper.hand
    assert hand.tips == pytest.approx(0.078, abs=0.001)
    assert hand.sensor == pytest.approx(-0.042, abs=0.001)
    assert hand.palm == 0


def test_a_hands_lengths_are_the_same_wherever_the_arm_stands(cell):
    cell.reset(5)
    again = WorkCell("baxter", "cuboid_1x2", seed=5)
    again.place_camera(again.truth.world_from_camera * RigidTransform.from_translation([0.02, 0.0, 0.05]))
    assert again.gripper.hand == cell.gripper.hand
    again.close()


def test_what_the_sensor_sees_lies_ahead_of_the_camera_by_its_place_and_its_reading(cell):
    aligned(cell, 3, dynamic=False)
    surface = cell.gripper.hand.sensor + cell.gripper.range()
    top = cell.truth.world_from_object.apply([0.0, 0.0, cell.target_spec.bounding_box().half_extents[2]])
    assert surface == pytest.approx(cell.truth.world_from_camera.inv().apply(top)[2], abs=0.005)  # studs or between


@pytest.mark.parametrize("opening", [0.056, 0.072, 0.090])
def test_the_stroke_follows_how_wide_the_fingers_are_mounted(opening):
    arm = ARMS["baxter"]
    fitted = replace(arm, gripper=replace(arm.gripper, max_width=opening))
    with WorkCell(fitted, "cuboid_1x2", dynamic=True) as made:
        shut, wide = made.gripper.stroke
        assert wide == pytest.approx(opening)
        assert wide - shut == pytest.approx(0.044, abs=1e-6)  # of the motor, however they are mounted
        assert isinstance(made.gripper, Gripper)
        assert made.gripper.width == pytest.approx(wide)
        made.gripper.close()
        assert made.gripper.width == pytest.approx(shut, abs=0.001)
        made.gripper.open()
        assert made.gripper.width == pytest.approx(wide, abs=0.001)


# What fingers do


def test_closing_fingers_do_not_sink_into_a_brick(held):
    cell, _, record = held
    assert record.touches > 0
    assert record.deepest < 0.0015
    width = 2 * cell.target_spec.bounding_box().half_extents[1]
    assert cell.gripper.width == pytest.approx(width, abs=0.0012)  # a skin of half a millimeter on each pad


def test_what_is_between_the_fingers_is_no_contact_that_stops_the_arm_until_they_open(grasped):
    cell, _, _ = grasped
    drive = cell._holder.drive
    assert drive.held == set(np.flatnonzero(cell.model.geom_bodyid == cell.target_body).tolist())
    cell.gripper.open()
    assert drive.held == frozenset()


def test_nothing_is_thrown(held):
    _, _, record = held
    assert 0.05 < record.fastest < 0.6  # m/s; the hand lifts it with a quarter


def test_contacts_are_recorded_only_while_asked_for(held):
    cell, _, record = held
    before = replace(record)
    cell.wait(0.1)
    assert record == before
    with record_contacts(cell) as another:
        cell.wait(0.1)
    assert another.touches > 0


def test_a_falling_brick_is_no_contact_that_threw_it(grasped):
    cell, _, _ = grasped
    with record_contacts(cell) as record:
        cell.gripper.open()
        cell.wait(0.1)
    assert record.fastest < 0.6


# A shake


def test_a_held_brick_survives_a_shake_and_gravity_is_what_it_was(held):
    cell, before, _ = held
    gravity = cell.model.opt.gravity.copy()
    shake(cell)
    np.testing.assert_array_equal(cell.model.opt.gravity, gravity)
    np.testing.assert_array_equal(gravity, [0, 0, -9.81])
    assert lifted(cell, before)


def test_no_brick_survives_it_in_a_hand_that_opens(grasped):
    cell, before, _ = grasped
    cell.gripper.open()
    shake(cell)
    assert not lifted(cell, before)


def moves_in_the_hand(cell, acceleration):
    """By how much a shake moves the brick in the hand, m."""

    def in_hand():
        return cell.truth.world_from_camera.inv().apply(cell.truth.world_from_object.translation)

    before = in_hand()
    shake(cell, acceleration)
    return np.linalg.norm(in_hand() - before)


@pytest.mark.parametrize("acceleration", [5.0, 50.0])
def test_a_shake_within_what_friction_holds_leaves_the_brick_where_it_was(acceleration, held):
    assert moves_in_the_hand(held[0], acceleration) < 0.005


def test_a_shake_beyond_what_friction_holds_tears_the_brick_out(grasped):
    assert moves_in_the_hand(grasped[0], 5000.0) >= 0.005


def test_gravity_is_restored_where_a_shake_is_interrupted(held):
    cell, _, _ = held
    gravity = cell.model.opt.gravity.copy()

    def interrupt():
        raise KeyboardInterrupt

    with cell.watch(interrupt, every_step=True), pytest.raises(KeyboardInterrupt):
        shake(cell)
    np.testing.assert_array_equal(cell.model.opt.gravity, gravity)


def test_the_shake_moves_the_arm_by_less_than_a_millimeter(held):
    cell, _, _ = held
    at_rest, moved = cell.truth.world_from_camera.translation, []
    with cell.watch(lambda: moved.append(cell.truth.world_from_camera.translation)):
        shake(cell)
    assert 0 < np.linalg.norm(moved - at_rest, axis=1).max() < 0.001


def test_a_shake_takes_six_fifths_of_a_second(held):
    cell, _, _ = held
    began = cell.time
    shake(cell)
    assert cell.time - began == pytest.approx(1.2, abs=0.01)
