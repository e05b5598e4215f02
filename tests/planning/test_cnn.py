"""The five actions: which way each moves the camera, and that none leaves the sphere."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.planning.cnn import Action, axes_after

pytestmark = pytest.mark.check

MOVES = [action for action in Action if action is not Action.NO_OP]
CENTER = np.array([0.5, -0.2, 0.1])

actions = st.sampled_from(list(Action))
moves = st.sampled_from(MOVES)
turns = st.floats(0, np.pi)
radii = st.floats(0.05, 2.0)
viewpoints = st.tuples(st.floats(0, 3), st.floats(-np.pi, np.pi), st.floats(-np.pi, np.pi))


def between(a, b):
    """Angle between two vectors, rad."""
    return np.arctan2(np.linalg.norm(np.cross(a, b)), np.dot(a, b))


def test_the_actions_are_numbered_as_in_the_thesis():
    assert {action.name: int(action) for action in Action} == {"UP": 0, "LEFT": 1, "DOWN": 2, "RIGHT": 3, "NO_OP": 4}


def test_directions_are_those_of_the_image_where_v_points_down():
    assert [action.direction for action in Action] == [(0, -1), (-1, 0), (0, 1), (1, 0), (0, 0)]


@pytest.mark.parametrize(
    ("action", "axis"), [("UP", (0, -1, 0)), ("DOWN", (0, 1, 0)), ("LEFT", (-1, 0, 0)), ("RIGHT", (1, 0, 0))]
)
def test_the_camera_sets_out_along_its_own_axis(action, axis):
    moved = Action[action].step(1e-6, 0.5).translation
    np.testing.assert_allclose(moved / np.linalg.norm(moved), axis, atol=1e-5)


@given(actions, turns, radii, viewpoints)
def test_a_step_stays_on_the_sphere_and_keeps_the_center_in_the_middle(action, angle, radius, viewpoint):
    before = VirtualSphere(CENTER, radius).viewpoint(*viewpoint)
    after = before * action.step(angle, radius)
    np.testing.assert_allclose(after.inv().apply(CENTER), [0, 0, radius], atol=1e-9)
    assert np.linalg.norm(after.translation - CENTER) == pytest.approx(radius)


@given(moves, turns, radii, viewpoints)
def test_a_step_is_of_the_angle_asked_for_seen_from_the_center(action, angle, radius, viewpoint):
    before = VirtualSphere(CENTER, radius).viewpoint(*viewpoint)
    after = before * action.step(angle, radius)
    assert between(before.translation - CENTER, after.translation - CENTER) == pytest.approx(angle, abs=1e-7)


@given(moves, turns, radii)
def test_opposite_steps_undo_each_other(action, angle, radius):
    opposite = Action((action + 2) % 4)
    both = action.step(angle, radius) * opposite.step(angle, radius)
    np.testing.assert_allclose(both.as_matrix(), np.eye(4), atol=1e-9)


@given(st.floats(0, 0.5), st.floats(0, 0.5), radii)
def test_two_steps_are_one_of_both_angles(a, b, radius):
    two = Action.LEFT.step(a, radius) * Action.LEFT.step(b, radius)
    np.testing.assert_allclose(two.as_matrix(), Action.LEFT.step(a + b, radius).as_matrix(), atol=1e-9)


@given(turns, radii)
def test_no_operation_moves_nothing(angle, radius):
    np.testing.assert_array_equal(Action.NO_OP.step(angle, radius).as_matrix(), np.eye(4))


@given(actions, st.floats(0, np.pi / 2), radii)
def test_the_axes_after_each_action_are_those_of_its_step(action, angle, radius):
    np.testing.assert_allclose(
        axes_after(angle)[action], action.step(angle, radius).rotation.apply([0, 0, 1]), atol=1e-12
    )


@given(moves, st.floats(0, np.pi / 2), radii)
def test_a_camera_rolled_by_a_quarter_takes_the_next_action_for_this_one(action, angle, radius):
    """Rolled from x toward y, the image turns the other way: what was UP is LEFT to it, and so on."""
    roll = Rotation.from_rotvec([0, 0, np.pi / 2])
    moved = roll.apply(Action((action + 1) % 4).step(angle, radius).translation)
    np.testing.assert_allclose(moved, action.step(angle, radius).translation, atol=1e-12)


@pytest.mark.parametrize(
    ("angle", "radius"), [(-0.1, 0.5), (5.0, 0.5), (float("nan"), 0.5), (0.1, 0.0), (0.1, -1.0), (0.1, float("nan"))]
)
def test_an_impossible_step_is_refused(angle, radius):
    with pytest.raises(InvalidParameterError, match=f"angle in rad, at most pi.*got {angle}, {radius}"):
        Action.UP.step(angle, radius)
