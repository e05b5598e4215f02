"""The arm on its two drives: collisions on the way, servos that keep to a path, switching between the two, and time."""

from itertools import pairwise

import numpy as np
import pytest
from hands import aligned
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arm import StopReason
from gvp_lib.simulation.arms import ARMS
from gvp_lib.simulation.workcell import WorkCell


@pytest.fixture
def cell(cell_of):
    return cell_of("baxter", placement="tilted")


def moved(a, b):
    """Distance between two poses, m, and angle, rad."""
    difference = a.inv() * b
    return np.linalg.norm(difference.translation), difference.rotation.magnitude()


# On the way


@pytest.mark.parametrize("arm", ARMS)
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
            np.testing.assert_allclose(cell.arm.joints, drive.joints(), atol=1e-12)
    assert entered
    assert not any(entered)
    assert {StopReason.REACHED, StopReason.COLLISION} <= reasons  # or the test would say nothing


# Servos


@pytest.mark.parametrize("arm", ARMS)
def test_servos_settle_within_two_hundredths_of_a_degree(arm, cell_of):
    cell = cell_of(arm, dynamic=True)
    drive, rng = cell._drive, np.random.default_rng(1)
    for _ in range(4):
        goal = cell.arm_spec.home + rng.uniform(-0.12, 0.12, len(cell.arm_spec.home))
        assert cell.arm.move_joints(goal)
        assert np.degrees(np.abs(drive.joints() - goal)).max() < 0.02
        np.testing.assert_allclose(cell.arm.joints, drive.joints(), atol=1e-12)
        velocities = [cell.data.joint(f"arm/{name}").qvel[0] for name in cell.arm_spec.joints]
        assert np.degrees(np.abs(velocities)).max() < 2.0


def deviations(cell, direction):
    """Way of the hand from where the path has it at that time, by the drive's own path and pace, shape (n, 3), m: along
    the line and twice across it."""
    drive, kinematics, paths, times, joints = cell._drive, cell._kinematics, [], [], []

    def remember(path):
        paths.append(np.vstack([drive.joints(), *path]))
        return type(drive).follow(drive, path)

    drive.follow, began = remember, cell.time
    with cell.watch(lambda: (times.append(cell.time - began), joints.append(drive.joints())), every_step=True):
        assert cell.arm.move_camera(RigidTransform.from_translation(direction))
    del drive.follow
    (knots,) = paths
    arrival = np.cumsum([0.0, *(drive.seconds(a, b) for a, b in pairwise(knots))])
    s = np.minimum(1.0, np.array(times) / (1.5 * arrival[-1]))  # the easing's pace
    on_path = np.array([np.interp(arrival[-1] * s * s * (3 - 2 * s), arrival, q) for q in knots.T]).T
    off = [
        kinematics.forward(q).translation - kinematics.forward(at).translation
        for q, at in zip(joints[::5], on_path[::5], strict=True)
    ]
    along = kinematics.forward(knots[0]).rotation.apply(direction)
    return Rotation.align_vectors([[1.0, 0.0, 0.0]], [along])[0].apply(off)


# Servos that are not led are 10 mm behind. Down the lens, as a grasp goes; then across it, where a fast joint
# goes past its end for a moment.
@pytest.mark.parametrize(
    ("direction", "most"), [((0, 0, 0.10), 0.0005), ((0.10, 0, 0), 0.0020), ((0, -0.10, 0), 0.0020)]
)
def test_servos_follow_a_straight_line_without_lag(direction, most, cell):
    off = deviations(aligned(cell, 5), direction)
    assert np.linalg.norm(off, axis=1).max() < most
    assert np.abs(off[:, 1:]).max() < 0.0005  # across the line
    assert np.linalg.norm(off[-1]) < 0.0005


# Switching


def test_dynamics_are_switched_on_and_off_and_arm_and_object_stay_where_they_were(cell):
    aligned(cell, dynamic=False)
    for on in (True, False, True, False):
        before, joints, time = (cell.truth.world_from_camera, cell.truth.world_from_object), cell.arm.joints, cell.time
        cell.dynamic = on
        assert cell.dynamic is on
        np.testing.assert_array_equal(cell.arm.joints, joints)
        assert cell.time == time
        for pose, now in zip(before, (cell.truth.world_from_camera, cell.truth.world_from_object), strict=True):
            np.testing.assert_array_less(moved(pose, now), (1e-4, 1e-3))


def test_the_arm_and_the_object_stay_there_as_time_goes_on(cell):
    aligned(cell)
    camera, object_, joints = cell.truth.world_from_camera, cell.truth.world_from_object, cell.arm.joints
    cell.wait(1.0)
    assert moved(camera, cell.truth.world_from_camera)[0] < 1e-4
    assert moved(object_, cell.truth.world_from_object)[0] < 1e-4
    np.testing.assert_allclose(cell.arm.joints, joints, atol=np.radians(0.02))


def test_what_is_set_in_an_episode_lasts_to_the_next_for_the_arm_and_the_gripper(cell):
    for on in (True, False):
        cell.dynamic = on
        cell.reset(4)
        assert cell.dynamic is on
        assert cell.arm.move_camera(RigidTransform.from_translation([0.0, 0.0, 0.01]))
        cell.gripper.close()
        assert bool(np.abs(cell.data.qvel).max() > 0) is on


def test_a_floating_camera_has_no_dynamics_to_switch():
    with WorkCell("floating", "cuboid_1x2") as cell:
        with pytest.raises(InvalidParameterError, match="a floating camera has no dynamics; choose an arm"):
            cell.dynamic = True
        assert not cell.dynamic


# Time


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
