"""The simulated gripper and its trials: lengths, fingers, what they hold, and a shake."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hands import aligned

from gvp_lib.motion.arm import Gripper
from gvp_lib.planning.grasp import GraspExecutor, GraspOutcome, SizedDepth
from gvp_lib.simulation.arms import ARMS
from gvp_lib.simulation.moving import record_contacts, shake
from gvp_lib.simulation.workcell import WorkCell

STATE = mujoco.mjtState.mjSTATE_INTEGRATION


@pytest.fixture(scope="module")
def grasp():
    """A cell with a brick in its hand, the record of the contacts, and how to have it all back."""
    with WorkCell("baxter", "cuboid_1x2", seed=3) as cell:
        aligned(cell)
        with record_contacts(cell) as record:
            done = GraspExecutor(cell.segmenter, SizedDepth(), recenter="shifting").grasp(cell.arm, cell.gripper)
        assert done.outcome is GraspOutcome.HELD
        state = np.empty(mujoco.mj_stateSize(cell.model, STATE))
        mujoco.mj_getState(cell.model, cell.data, state, STATE)
        yield cell, record, state, cell._drive.held


@pytest.fixture
def held(grasp):
    """The cell with the brick just lifted, whatever the test before did to it."""
    cell, _, state, geoms = grasp
    cell.dynamic = True
    mujoco.mj_setState(cell.model, cell.data, state, STATE)
    mujoco.mj_forward(cell.model, cell.data)
    cell._drive.held = geoms
    return cell


def in_hand(cell):
    """Where the brick is in the hand, camera frame, m."""
    return cell.truth.world_from_camera.inv().apply(cell.truth.world_from_object.translation)


# The hand's lengths


def test_the_tips_are_78_mm_ahead_of_the_camera_and_the_sensor_42_behind_it_wherever_the_arm_stands(cell_of):
    for seed in (3, 5):
        hand = cell_of(seed=seed).gripper.hand
        assert hand.tips == pytest.approx(0.078, abs=0.001)
        assert hand.sensor == pytest.approx(-0.042, abs=0.001)
        assert hand.palm == 0


def test_what_the_sensor_sees_lies_ahead_of_the_camera_by_its_place_and_its_reading(cell_of):
    cell = aligned(cell_of(), 3, dynamic=False)
    surface = cell.gripper.hand.sensor + cell.gripper.range()
    top = cell.truth.world_from_object.apply([0.0, 0.0, cell.target_spec.bounding_box().half_extents[2]])
    assert surface == pytest.approx(cell.truth.world_from_camera.inv().apply(top)[2], abs=0.005)  # studs or between


@pytest.mark.parametrize("dynamic", [False, True])
@pytest.mark.parametrize("opening", [0.044, 0.056, 0.072, 0.090])
def test_the_stroke_follows_how_wide_the_fingers_are_mounted(opening, dynamic):
    arm = ARMS["baxter"]
    fitted = replace(arm, gripper=replace(arm.gripper, max_width=opening))
    with WorkCell(fitted, "cuboid_1x2", dynamic=dynamic) as made:
        gripper = made.gripper
        assert isinstance(gripper, Gripper)
        assert gripper.stroke == pytest.approx((opening - 0.044, opening), abs=1e-6)  # the motor's 44 mm, everywhere
        assert gripper.width == pytest.approx(opening)
        for move, width in ((gripper.close, opening - 0.044), (gripper.open, opening)):
            move()
            assert gripper.width == pytest.approx(width, abs=0.001)
            first, second = made.data.joint("arm/finger_a").qpos, made.data.joint("arm/finger_b").qpos
            assert first == pytest.approx(second, abs=1e-4)


# What fingers do


def test_closing_fingers_neither_sink_into_a_brick_nor_throw_it(grasp, held):
    _, record, *_ = grasp
    assert record.touches > 0
    assert record.deepest < 0.0015
    assert 0.05 < record.fastest < 0.6  # m/s; the hand lifts it with a quarter
    width = 2 * held.target_spec.bounding_box().half_extents[1]
    assert held.gripper.width == pytest.approx(width, abs=0.0012)  # a skin of half a millimeter on each pad


def test_what_is_between_the_fingers_is_no_contact_that_stops_the_arm_until_they_open(held):
    drive = held._drive
    assert drive.held == set(np.flatnonzero(held.model.geom_bodyid == held.target_body).tolist())
    held.gripper.open()
    assert drive.held == frozenset()


def test_kinematic_fingers_stop_where_they_first_touch_a_brick_which_stays_where_it_was(held):
    held.dynamic = False
    brick, width = held.truth.world_from_object, 2 * held.target_spec.bounding_box().half_extents[1]
    held.gripper.open()
    held.gripper.close()
    assert held.gripper.width == pytest.approx(width, abs=0.0015)
    np.testing.assert_array_equal(held.truth.world_from_object.as_matrix(), brick.as_matrix())


def test_contacts_are_recorded_only_while_asked_for_and_a_falling_brick_is_none_that_threw_it(grasp, held):
    _, record, *_ = grasp
    before = replace(record)
    held.wait(0.1)
    assert record == before
    with record_contacts(held) as another:
        held.wait(0.1)
    assert another.touches > 0
    with record_contacts(held) as falling:
        held.gripper.open()
        held.wait(0.1)
    assert falling.fastest < 0.6


# A shake


@pytest.mark.parametrize("opened", [False, True])
def test_a_brick_survives_a_shake_in_a_hand_that_holds_it_and_in_no_other(opened, held):
    top = held.truth.world_from_object.translation[2]
    if opened:
        held.gripper.open()
    gravity, began = held.model.opt.gravity.copy(), held.time
    at_rest, moved = held.truth.world_from_camera.translation, []
    with held.watch(lambda: moved.append(held.truth.world_from_camera.translation)):
        shake(held)
    assert (held.truth.world_from_object.translation[2] > top - 0.005) is not opened
    assert held.time - began == pytest.approx(1.2, abs=0.01)
    assert 0 < np.linalg.norm(moved - at_rest, axis=1).max() < 0.001
    np.testing.assert_array_equal(held.model.opt.gravity, gravity)
    np.testing.assert_array_equal(gravity, [0, 0, -9.81])


@pytest.mark.parametrize(("acceleration", "stays"), [(5.0, True), (50.0, True), (5000.0, False)])
def test_a_shake_beyond_what_friction_holds_moves_the_brick_in_the_hand(acceleration, stays, held):
    before = in_hand(held)
    shake(held, acceleration)
    assert (np.linalg.norm(in_hand(held) - before) < 0.005) is np.bool_(stays)


def test_gravity_is_restored_where_a_shake_is_interrupted(held):
    def interrupt():
        raise KeyboardInterrupt

    with held.watch(interrupt, every_step=True), pytest.raises(KeyboardInterrupt):
        shake(held)
    np.testing.assert_array_equal(held.model.opt.gravity, [0, 0, -9.81])
