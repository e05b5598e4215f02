"""The eight turns of a square picture against pixels that are marked and cameras that are really turned."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.learning.labels import label_view
from gvp_lib.learning.turns import TURNED_ACTIONS, TURNS, turned
from gvp_lib.planning.learned import Action
from gvp_lib.simulation.normals import AcceptedNormal
from gvp_lib.simulation.workcell import WorkCell

UP = AcceptedNormal((0, 0, 1))
CAMERAS = [VirtualSphere((0, 0, 0), 0.5).viewpoint(*at) for at in np.random.default_rng(0).uniform(0.02, 1.2, (40, 3))]


def test_all_eight_are_distinct_and_undone_by_their_transpose():
    picture = np.arange(75, dtype=np.uint8).reshape(5, 5, 3)
    assert len({turned(picture, turn).tobytes() for turn in TURNS}) == 8
    assert len({actions.tobytes() for actions in TURNED_ACTIONS}) == 8
    for turn in TURNS:
        np.testing.assert_array_equal(turned(turned(picture, turn), turn.T), picture)


@pytest.mark.parametrize("number", range(8))
def test_a_marked_pixel_goes_where_the_matrix_says(number):
    for u, v in np.ndindex(6, 6):
        picture = np.zeros((6, 6, 3), np.uint8)
        picture[v, u] = 255
        to_u, to_v = (TURNS[number] @ (np.array([u, v]) - 2.5) + 2.5).astype(int)
        (row,), (column,) = np.nonzero(turned(picture, TURNS[number])[..., 0])
        assert (column, row) == (to_u, to_v)


@pytest.mark.parametrize("number", range(8))
def test_actions_move_as_the_matrix_says_and_no_operation_stays(number):
    for action, became in zip(Action, TURNED_ACTIONS[number], strict=True):
        assert Action(int(became)).direction == tuple(TURNS[number] @ action.direction)


@pytest.mark.parametrize("number", range(8))
def test_labels_turn_with_cameras_that_are_really_rolled_or_mirrored(number):
    """A picture's turn by T is a camera whose axes are turned by T; a mirrored camera sees a mirrored world."""
    turn = TURNS[number]
    mirror = np.diag([1.0, np.linalg.det(turn), 1.0])  # of the world, a plane through the normal
    axes = np.eye(3)
    axes[:2, :2] = turn.T
    for camera in CAMERAS:
        label = label_view(camera, UP)
        seen = RigidTransform.from_components(
            mirror @ camera.translation, Rotation.from_matrix(mirror @ camera.rotation.as_matrix() @ axes)
        )
        other = label_view(seen, UP)
        if label.margin > 1e-6:
            assert other.action == TURNED_ACTIONS[number][label.action]
        tilts = [x.angle * np.array([np.cos(x.direction), np.sin(x.direction)]) for x in (label, other)]
        np.testing.assert_allclose(tilts[1], turn @ tilts[0], atol=1e-9)


def test_a_floating_camera_that_is_rolled_sees_the_turned_picture_and_its_turned_label():
    cell = WorkCell("floating", seed=1)
    center = cell.truth.world_from_object.translation
    cell.place_camera(VirtualSphere(center, 0.5).viewpoint(0.3, 1.0))
    straight, label = cell.arm.capture()[176:304, 256:384].astype(int), label_view(cell.arm.camera_pose(), UP)
    for number in (1, 2, 3):
        cell.arm.rotate_wrist(-np.pi / 2)  # the other way than the picture
        picture = cell.arm.capture()[176:304, 256:384].astype(int)
        errors = [np.abs(turned(straight, turn) - picture).mean() for turn in TURNS]
        assert int(np.argmin(errors)) == number
        assert label_view(cell.arm.camera_pose(), UP).action == TURNED_ACTIONS[number][label.action]
