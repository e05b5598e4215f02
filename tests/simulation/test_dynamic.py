"""The dynamic mode of a cell: switched on and off, waiting, and servos that keep to a path."""

from itertools import pairwise

import numpy as np
import pytest
from hands import aligned
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError
from gvp_lib.simulation.workcell import WorkCell


@pytest.fixture(scope="module")
def cell():
    with WorkCell("baxter", "cuboid_1x2", "tilted", seed=3) as made:
        yield made


def apart(a, b):
    """Between two poses, m, and rad."""
    difference = a.inv() * b
    return np.linalg.norm(difference.translation), difference.rotation.magnitude()


# Switching


def test_dynamics_may_be_switched_on_and_off_and_arm_and_object_stay_where_they_were(cell):
    aligned(cell, dynamic=False)
    for on in (True, False, True, False):
        camera, object_ = cell.truth.world_from_camera, cell.truth.world_from_object
        joints, time = cell.arm.joints, cell.time
        cell.dynamic = on
        assert cell.dynamic is on
        np.testing.assert_array_equal(cell.arm.joints, joints)
        assert cell.time == time
        for before, now in ((camera, cell.truth.world_from_camera), (object_, cell.truth.world_from_object)):
            moved, turned = apart(before, now)
            assert moved < 1e-4
            assert turned < 1e-3


def test_the_arm_and_the_object_stay_there_as_time_goes_on(cell):
    aligned(cell, dynamic=True)
    camera, object_, joints = cell.truth.world_from_camera, cell.truth.world_from_object, cell.arm.joints
    cell.wait(1.0)
    assert apart(camera, cell.truth.world_from_camera)[0] < 1e-4
    assert apart(object_, cell.truth.world_from_object)[0] < 1e-4
    np.testing.assert_allclose(cell.arm.joints, joints, atol=np.radians(0.02))


def test_what_is_set_in_an_episode_lasts_to_the_next_and_new_scenes_have_it_too(cell):
    cell.dynamic = True
    cell.reset(4)
    assert cell.dynamic
    before = cell.time
    assert cell.arm.move_camera(RigidTransform.from_translation([0.0, 0.0, 0.01]))
    assert cell.time > before
    cell.dynamic = False


def test_the_gripper_is_switched_with_the_arm(cell):
    for on in (True, False):
        aligned(cell, dynamic=on)
        cell.gripper.close()
        qvel = np.abs(cell.data.qvel).max()
        assert bool(qvel > 0) is on
        cell.gripper.open()


def test_a_floating_camera_has_no_dynamics_to_switch():
    with WorkCell("floating", "cuboid_1x2") as cell:
        assert not cell.dynamic
        with pytest.raises(InvalidParameterError, match="a floating camera has no dynamics; choose an arm"):
            cell.dynamic = True
        assert not cell.dynamic


# Waiting


@pytest.mark.parametrize("dynamic", [True, False])
def test_a_cell_that_waits_lets_as_much_time_pass(dynamic, cell):
    aligned(cell, dynamic=dynamic)
    for seconds in (0.0, 0.25, 1.0):
        before = cell.time
        cell.wait(seconds)
        assert cell.time - before == pytest.approx(seconds, abs=0.0011)


@pytest.mark.parametrize("seconds", [-0.1, np.inf, np.nan])
def test_no_cell_waits_for_less_than_nothing_or_for_ever(seconds, cell):
    with pytest.raises(InvalidParameterError, match=f"a cell waits for a finite time, in s; got {seconds}"):
        cell.wait(seconds)


def test_every_millisecond_of_the_dynamic_mode_may_be_watched(cell):
    aligned(cell, dynamic=True)
    steps, waypoints = [], []
    with cell.watch(lambda: steps.append(cell.time), every_step=True), cell.watch(lambda: waypoints.append(cell.time)):
        cell.wait(0.2)
    np.testing.assert_allclose(np.diff(steps), 0.001, atol=1e-9)
    assert len(steps) == 200
    assert 4 <= len(waypoints) <= 7
    cell.wait(0.01)
    assert len(steps) == 200


# Along a path


def deviations(cell, direction):
    """Of the hand, from where the path has it at that time, m, shape (n, 3), along the line and twice across it; the
    drive's own path and pace."""
    holder = cell._holder
    drive, paths, times, joints = holder.drive, [], [], []

    def remember(path):
        paths.append(np.vstack([drive.joints(), *path]))
        return type(drive).follow(drive, path)

    drive.follow = remember
    began = cell.time
    try:
        with cell.watch(lambda: (times.append(cell.time - began), joints.append(drive.joints())), every_step=True):
            assert cell.arm.move_camera(RigidTransform.from_translation(direction))
    finally:
        del drive.follow
    (knots,) = paths
    arrival = np.cumsum([0.0, *(drive.seconds(a, b) for a, b in pairwise(knots))])
    s = np.minimum(1.0, np.array(times) / (1.5 * arrival[-1]))  # the easing's pace
    on_path = np.array([np.interp(arrival[-1] * s * s * (3 - 2 * s), arrival, q) for q in knots.T]).T
    forward, start = holder.kinematics.forward, holder.kinematics.forward(knots[0])
    line = Rotation.align_vectors([[1.0, 0.0, 0.0]], [start.rotation.apply(direction)])[0]
    every = slice(None, None, 5)
    return np.array([
        line.apply(forward(q).translation - forward(at).translation)
        for q, at in zip(joints[every], on_path[every], strict=True)
    ])  # fmt: skip


# Servos that are not led are 10 mm behind. Down the lens, as a grasp goes; then across it, where a fast joint
# goes past its end for a moment.
@pytest.mark.parametrize(
    ("direction", "most"), [((0, 0, 0.10), 0.0005), ((0.10, 0, 0), 0.0020), ((0, -0.10, 0), 0.0020)]
)
def test_servos_follow_a_straight_line_without_lag(direction, most, cell):
    aligned(cell, 5, dynamic=True)
    off = deviations(cell, direction)
    assert np.linalg.norm(off, axis=1).max() < most
    assert np.abs(off[:, 1:]).max() < 0.0005  # across the line
    assert np.linalg.norm(off[-1]) < 0.0005
