"""The arm on its two drives: collisions on the way, servos that keep to a path, switching between the two, and time."""

import numpy as np
import pytest
from hands import aligned
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arm import Outcome
from gvp_lib.simulation.arms import ARMS

each_arm = pytest.mark.parametrize("arm", ARMS)


@pytest.fixture
def cell(cell_of):
    return cell_of("baxter", placement="tilted")


def moved(a, b):
    """Distance between two poses, m, and angle, rad."""
    difference = a.inv() * b
    return np.linalg.norm(difference.translation), difference.rotation.magnitude()


@each_arm
def test_a_kinematic_arm_never_stands_in_a_colliding_configuration(arm, cell_of):
    cell = cell_of(arm, "tomato_soup_box", "raised")
    drive, reasons, entered = cell._drive, set(), []
    rng, home = np.random.default_rng(0), np.array(cell.arm_spec.home)
    with cell.watch(lambda: entered.append(len(drive.contacts()))):
        for _ in range(25):
            cell.reset()
            goal = np.clip(home + rng.uniform(-1.5, 1.5, len(home)), *cell._kinematics.limits)
            reasons.add(cell.arm.move_joints(goal).reason)
            assert not len(drive.contacts())
    assert entered
    assert not any(entered)
    assert {Outcome.REACHED, Outcome.COLLISION} <= reasons  # or the test would say nothing


@each_arm
def test_servos_are_where_the_path_is_by_then_and_settle_within_two_hundredths_of_a_degree(arm, cell_of):
    cell = cell_of(arm, dynamic=True)
    drive, start, times, seen = cell._drive, cell.arm.joints, [cell.time], []
    goal = start + np.random.default_rng(1).uniform(-0.12, 0.12, start.size)
    with cell.watch(lambda: (times.append(cell.time), seen.append(drive.joints())), every_step=True):
        assert cell.arm.move_joints(goal)
    s = np.minimum(1.0, np.diff(times).cumsum() / (1.5 * drive.seconds(start, goal)))  # the easing's pace
    on_path = start + (s * s * (3 - 2 * s))[:, None] * (goal - start)
    forward = cell._kinematics.forward
    off = [moved(forward(q), forward(at))[0] for q, at in zip(seen[::5], on_path[::5], strict=True)]
    assert max(off) < 0.004  # m; servos that are not led are 15 to 30 mm behind
    assert np.degrees(np.abs(drive.joints() - goal)).max() < 0.02
    velocities = [cell.data.joint(f"arm/{name}").qvel[0] for name in cell.arm_spec.joints]
    assert np.degrees(np.abs(velocities)).max() < 2.0


@pytest.mark.parametrize("way", [(0, 0, 0.10), (0, -0.10, 0)])  # down the lens, as a grasp goes, and across it
def test_servos_keep_to_a_straight_line_and_to_its_end(way, cell):
    aligned(cell, 5)
    start, places = cell.truth.world_from_camera, []
    with cell.watch(lambda: places.append(cell.truth.world_from_camera.translation), every_step=True):
        assert cell.arm.move_camera(RigidTransform.from_translation(way))
    gone = start.inv().apply(places)
    assert np.linalg.norm(np.cross(gone, way), axis=1).max() / 0.10 < 0.0005
    assert np.linalg.norm(gone[-1] - way) < 0.0005


def test_dynamics_are_switched_on_and_off_and_arm_and_object_stay_where_they_were(cell):
    aligned(cell, dynamic=False)
    for on in (True, False, True):
        before, joints, time = (cell.truth.world_from_camera, cell.truth.world_from_object), cell.arm.joints, cell.time
        cell.dynamic = on
        assert cell.dynamic is on
        np.testing.assert_array_equal(cell.arm.joints, joints)
        assert cell.time == time
        cell.wait(0.5)
        for pose, now in zip(before, (cell.truth.world_from_camera, cell.truth.world_from_object), strict=True):
            np.testing.assert_array_less(moved(pose, now), (1e-4, 1e-3))


def test_what_is_set_in_an_episode_lasts_to_the_next_for_the_arm_and_the_gripper(cell):
    for on in (True, False):
        cell.dynamic = on
        cell.reset(4)
        assert cell.dynamic is on
        assert cell.arm.move_camera(RigidTransform.from_translation([0.0, 0.0, 0.01]))
        cell.gripper.close()
        assert bool(np.abs(cell.data.qvel).max() > 0) is on


def test_a_floating_camera_has_no_dynamics_to_switch(cell_of):
    cell = cell_of("floating")
    with pytest.raises(InvalidParameterError, match="a floating camera has no dynamics; choose an arm"):
        cell.dynamic = True
    assert not cell.dynamic


@pytest.mark.parametrize("dynamic", [True, False])
def test_a_cell_that_waits_lets_as_much_time_pass(dynamic, cell_of):
    cell = cell_of(dynamic=dynamic)
    for seconds in (0.0, 0.25, 1.0):
        before = cell.time
        cell.wait(seconds)
        assert cell.time - before == pytest.approx(seconds, abs=0.0011)
    for seconds in (-0.1, np.inf, np.nan):
        with pytest.raises(InvalidParameterError, match=f"a cell waits for a finite time, in s; got {seconds}"):
            cell.wait(seconds)


def test_every_millisecond_of_the_dynamic_mode_may_be_watched(cell_of):
    cell, steps, waypoints = cell_of(dynamic=True), [], []
    with cell.watch(lambda: steps.append(cell.time), every_step=True), cell.watch(lambda: waypoints.append(cell.time)):
        cell.wait(0.2)
    np.testing.assert_allclose(np.diff(steps), 0.001, atol=1e-9)
    assert 4 <= len(waypoints) <= 7
    cell.wait(0.01)
    assert len(steps) == 200
