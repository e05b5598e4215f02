"""The simulated gripper and its trials: lengths, fingers, what they hold, and a shake."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hands import aligned

from gvp_lib.motion.arm import Gripper, Outcome
from gvp_lib.planning.closing import SizedDepth
from gvp_lib.planning.grasp import GraspExecutor
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
        assert done.outcome is Outcome.HELD
        state = np.empty(mujoco.mj_stateSize(cell.model, STATE))
        mujoco.mj_getState(cell.model, cell.data, state, STATE)
        yield cell, record, state, cell._drive.held


@pytest.fixture
def held(grasp):
    """The cell with the brick just lifted, whatever the test before did to it."""
    cell, _, state, bodies = grasp
    cell.dynamic = True
    mujoco.mj_setState(cell.model, cell.data, state, STATE)
    mujoco.mj_forward(cell.model, cell.data)
    cell._drive.held = bodies
    return cell


def in_hand(cell):
    """Where the brick is in the hand, camera frame, m."""
    return cell.truth.world_from_camera.inv().apply(cell.truth.world_from_object.translation)


def test_the_tips_are_78_mm_ahead_of_the_camera_and_the_sensor_42_behind_it_looks_ahead(cell_of):
    cell = aligned(cell_of(), 3, dynamic=False)
    hand = cell.gripper.hand
    assert (hand.tips, hand.sensor, hand.palm) == pytest.approx((0.078, -0.042, 0.0), abs=0.001)
    assert (hand.thickness, hand.breadth) == pytest.approx((0.011, 0.016), abs=0.001)  # its pad's
    surface = hand.sensor + cell.gripper.range()
    top = cell.truth.world_from_object.apply([0.0, 0.0, cell.target_spec.bounding_box().half_extents[2]])
    assert surface == pytest.approx(cell.truth.world_from_camera.inv().apply(top)[2], abs=0.005)  # studs or between


@pytest.mark.parametrize("dynamic", [False, True])
@pytest.mark.parametrize("opening", [0.044, 0.090])
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


def test_closing_fingers_neither_sink_into_a_brick_nor_throw_it(grasp, held):
    _, record, *_ = grasp
    assert record.touches > 0
    assert record.deepest < 0.0015
    assert 0.05 < record.fastest < 0.6  # m/s; the hand lifts it with a quarter
    width = 2 * held.target_spec.bounding_box().half_extents[1]
    assert held.gripper.width == pytest.approx(width, abs=0.0012)  # a skin of half a millimeter on each pad


def test_kinematic_fingers_stop_where_they_first_touch_a_brick_which_stays_where_it_was(held):
    held.dynamic = False
    brick, width = held.truth.world_from_object, 2 * held.target_spec.bounding_box().half_extents[1]
    held.gripper.open()
    held.gripper.close()
    assert held.gripper.width == pytest.approx(width, abs=0.0015)
    np.testing.assert_array_equal(held.truth.world_from_object.as_matrix(), brick.as_matrix())


def test_opened_fingers_hold_nothing_and_a_falling_brick_is_not_one_that_was_thrown(grasp, held):
    _, record, *_ = grasp
    before, drive = replace(record), held._drive
    assert drive.held == {held.target_body}
    with record_contacts(held) as falling:
        held.gripper.open()
        held.wait(0.1)
    assert drive.held == frozenset()
    assert falling.fastest < 0.6
    assert record == before  # recorded only while asked for


@pytest.mark.parametrize(("acceleration", "stays", "hand_moves"), [(5.0, True, 0.001), (5000.0, False, np.inf)])
def test_a_shake_beyond_what_friction_holds_moves_the_brick_in_the_hand(acceleration, stays, hand_moves, held):
    before, at_rest, began, moved = in_hand(held), held.truth.world_from_camera.translation, held.time, []
    with held.watch(lambda: moved.append(held.truth.world_from_camera.translation)):
        shake(held, acceleration)
    assert (np.linalg.norm(in_hand(held) - before) < 0.005) is np.bool_(stays)
    assert 0 < np.linalg.norm(moved - at_rest, axis=1).max() < hand_moves
    assert held.time - began == pytest.approx(1.2, abs=0.01)


def test_gravity_is_restored_where_a_shake_is_interrupted(held):
    def interrupt():
        raise KeyboardInterrupt

    with held.watch(interrupt, every_step=True), pytest.raises(KeyboardInterrupt):
        shake(held)
    np.testing.assert_array_equal(held.model.opt.gravity, [0, 0, -9.81])
