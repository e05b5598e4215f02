"""A target that moves by itself: truth and pictures follow the clock."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib import Blob, VirtualSphere
from gvp_lib.errors import InvalidParameterError
from gvp_lib.simulation.moving import Rocking, Sliding, Turning, moving_target

RADIUS = 0.5  # m


def stand_above(cell):
    cell.place_camera(VirtualSphere(cell.truth.world_from_object.translation, RADIUS).viewpoint(0.0, 0.0))
    return cell


@pytest.mark.parametrize("arm", ["floating", "ur5e"])
def test_truth_and_pictures_have_the_object_where_its_path_has_it_by_then(cell_of, arm):
    cell, velocity = stand_above(cell_of(arm)), np.array([0.03, -0.01, 0])
    start, shown = cell.truth.world_from_object.translation, []

    def look():
        shown.append(Blob.from_mask(cell.segmenter(cell.arm.capture())).centroid)

    look()
    with moving_target(cell, Sliding(tuple(velocity[:2]))):
        for seconds in (0.5, 1.5):
            cell.wait(seconds)
            look()
        cell.arm.move_camera(RigidTransform.from_rotation(Rotation.from_rotvec([0, 0, 0.2])))
        gone = cell.time
    cell.wait(1.0)  # out of the context it stays
    assert gone > 2.0
    np.testing.assert_allclose(cell.truth.world_from_object.translation - start, gone * velocity, atol=1e-9)
    shifts = np.linalg.norm(np.diff(shown, axis=0), axis=1)  # px
    expected = cell.arm.intrinsics.fx * np.linalg.norm(velocity) / (RADIUS - 0.01) * np.array([0.5, 1.5])
    np.testing.assert_allclose(shifts, expected, rtol=0.05, atol=0.5)


def test_a_turning_object_takes_its_axes_along_and_keeps_its_normal(cell_of):
    cell = stand_above(cell_of("floating"))
    before = cell.truth.normal
    with moving_target(cell, Turning(0.1)):
        cell.wait(5.0)
    turned = Rotation.from_rotvec([0, 0, 0.5]).apply(np.array(before.major_axis))
    np.testing.assert_allclose(cell.truth.normal.major_axis, turned, atol=1e-9)
    np.testing.assert_allclose(cell.truth.normal.direction, before.direction, atol=1e-9)


def test_a_rocking_object_tips_both_ways_and_does_not_sink_into_the_table(cell_of):
    cell, azimuth, tilts, lowest = cell_of("floating"), 1.0, [], []
    box, corners = cell.target_spec.bounding_box(), np.stack(np.meshgrid(*[(-1, 1)] * 3), axis=-1).reshape(8, 3)
    with moving_target(cell, Rocking(0.3, 8.0, azimuth)):
        for _ in range(4):
            cell.wait(2.0)
            tilts.append(cell.truth.normal.direction @ [-np.sin(azimuth), np.cos(azimuth), 0])  # across the axis
            lowest.append(cell.truth.world_from_object.apply(box.center + corners * box.half_extents)[:, 2].min())
    np.testing.assert_allclose(tilts, -np.sin([0.3, 0, -0.3, 0]), atol=1e-4)
    np.testing.assert_allclose(lowest, cell.stage.table_height, atol=5e-4)


def test_a_target_is_moved_neither_under_physics_nor_on_after_a_reset(cell_of):
    refused = pytest.raises(InvalidParameterError, match=r"kinematic mode only.*cell\.dynamic = False")
    with refused, moving_target(cell_of("ur5e", dynamic=True), Turning(0.1)):
        pass
    cell = cell_of("floating")
    with moving_target(cell, Turning(0.1)):
        cell.wait(1.0)
        cell.reset()
        with pytest.raises(InvalidParameterError, match="enter moving_target after reset"):
            cell.wait(0.5)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: Sliding((np.nan, 0.0)), r"velocity is \(x, y\) in m/s, finite; got \(nan, 0.0\)"),
        (lambda: Turning(np.inf), "rate is in rad/s, finite; got inf"),
        (lambda: Rocking(np.nan, 1.0), "in rad, s and rad, finite.*got nan"),
        (lambda: Rocking(0.1, 0.0), "the period is positive; got 0.1, 0.0"),
    ],
)
def test_an_impossible_path_is_refused(make, text):
    with pytest.raises(InvalidParameterError, match=text):
        make()
