"""Labels against a search that really moves a camera, and what turning camera or picture does to them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.learning.labels import TURNED_ACTIONS, TURNS, best_actions, label_view, label_views, turned
from gvp_lib.planning.plan import Action
from gvp_lib.simulation.truth import AcceptedNormal
from gvp_lib.simulation.workcell import WorkCell

STEP, RADIUS = np.radians(5), 0.5
UP = AcceptedNormal((0, 0, 1))
LYING = AcceptedNormal((0, 0, 1), (0, 1, 0), np.pi, circle_axis=(0, 1, 0))

normals = st.sampled_from([UP, LYING, AcceptedNormal((0.3, -0.2, 1)), AcceptedNormal((0, 0, -1))])
cameras = st.tuples(st.floats(0.02, 1.4), st.floats(-np.pi, np.pi), st.floats(-np.pi, np.pi)).map(
    lambda viewpoint: VirtualSphere((0.1, 0.2, 0.3), RADIUS).viewpoint(*viewpoint)
)


def moved(camera, direction, angle):
    """The camera, moved over the sphere by an angle in a direction of its image."""
    u, v = np.cos(direction), np.sin(direction)
    turn = Rotation.from_rotvec(angle * np.array([v, -u, 0.0]))
    center = np.array([0.0, 0.0, RADIUS])
    return camera * RigidTransform.from_components(center - turn.apply(center), turn)


@given(cameras, normals, st.floats(0.01, 0.5))
def test_errors_are_those_of_cameras_really_moved_and_direction_and_angle_lead_onto_the_normal(camera, normal, step):
    label = label_view(camera, normal, step)
    errors = [normal.view_angle(camera * action.step(step, RADIUS)) for action in Action]
    np.testing.assert_allclose(label.errors, errors, atol=1e-9)
    assert label.errors[label.action] <= label.errors.min() + 1e-12
    assert label.margin == pytest.approx(np.diff(np.sort(label.errors))[0], abs=1e-12)
    assert label.angle == pytest.approx(normal.view_angle(camera), abs=1e-9)
    assert normal.view_angle(moved(camera, label.direction, label.angle)) < 1e-6


@pytest.mark.parametrize(("roll", "inside", "outside"), [(0, 0.49, 0.51), (np.pi / 4, 0.70, 0.72)])
def test_no_operation_is_best_within_half_a_step_along_an_axis_and_0_707_between_two(roll, inside, outside):
    """At 45 deg a step gains only its share along the axis. rew_thresh has no say in it (errata 17)."""
    sphere = VirtualSphere(np.zeros(3), RADIUS)
    near, far = (label_view(sphere.viewpoint(share * STEP, 0.3, roll), UP, STEP) for share in (inside, outside))
    assert near.action is Action.NO_OP is not far.action
    assert (far.margin < 1e-9) == (roll > 0)  # there two are as good as each other (errata 18)


def test_above_a_lying_can_any_member_of_its_circle_will_do():
    """Going around the can changes nothing; going along it does."""
    sphere = VirtualSphere(np.zeros(3), RADIUS)
    assert {label_view(sphere.viewpoint(tilt, 0.0), LYING).action for tilt in (0.0, 0.2, -0.4)} == {Action.NO_OP}
    assert label_view(sphere.viewpoint(np.radians(20), np.pi / 2), LYING).action is Action.UP


def test_a_single_pose_and_the_direction_alone_of_a_normal_are_labeled_as_one_of_several():
    camera = VirtualSphere((0, 0, 0), RADIUS).viewpoint(0.3, 1.0)
    one, several = label_views(camera, (0, 0, 1), STEP), label_views(RigidTransform.concatenate([camera]), UP, STEP)
    np.testing.assert_array_equal(one.errors, several.errors)
    with pytest.raises(InvalidParameterError, match="direction"):
        label_views(camera, (0, 0, 0), STEP)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: best_actions([0.0], [0.1, 0.2]), r"same n viewpoints, shape \(n,\); got \(1,\) and \(2,\)"),
        (lambda: best_actions([0.0], [0.1], 5), "a step is in radians"),
        (lambda: turned(np.zeros((8, 6, 3), np.uint8), TURNS[1]), r"square pictures.*got the shape \(8, 6, 3\)"),
        (lambda: turned(np.zeros((8, 8, 3), np.uint8), 1), r"by one of TURNS, such as TURNS\[1\]; .* and 1"),
        (lambda: turned(np.zeros((8, 8, 3), np.uint8), np.ones((2, 2), int)), "by one of TURNS"),
    ],
)
def test_what_does_not_fit_is_refused(call, message):
    with pytest.raises(InvalidParameterError, match=message):
        call()


def test_lists_have_the_best_actions_of_arrays():
    assert best_actions([0, 0], [0.03, 0.07]).tolist() == best_actions(np.zeros(2), np.array([0.03, 0.07])).tolist()


@pytest.mark.parametrize("step", [0.0, 5.0, float("nan")])
def test_an_impossible_step_is_refused(step):
    with pytest.raises(InvalidParameterError, match=rf"in \(0, pi/2\]; got {step}.*np.radians"):
        label_view(RigidTransform.identity(), UP, step)


@pytest.mark.parametrize("step_deg", [2, 20])
def test_a_set_labeled_anew_for_another_step_has_the_labels_that_its_poses_would_get(step_deg):
    rng, step = np.random.default_rng(step_deg), np.radians(step_deg)
    poses = VirtualSphere((0.1, 0.2, 0.3), RADIUS).viewpoint(
        rng.uniform(0.001, 0.7, 2000), rng.uniform(-np.pi, np.pi, 2000), rng.uniform(-np.pi, np.pi, 2000)
    )
    labels = label_views(poses, AcceptedNormal((0.1, -0.1, 1)), step)
    np.testing.assert_array_equal(best_actions(labels.directions, labels.angles, step), labels.actions)
    assert set(labels.actions) == set(Action)


CAMERAS = [VirtualSphere((0, 0, 0), 0.5).viewpoint(*at) for at in np.random.default_rng(0).uniform(0.02, 1.2, (40, 3))]


@pytest.mark.parametrize(("turn", "actions"), [*zip(TURNS, TURNED_ACTIONS, strict=True)])
def test_a_marked_pixel_goes_where_the_matrix_says_and_actions_move_as_it_says(turn, actions):
    for u, v in np.ndindex(6, 6):
        picture = np.zeros((6, 6, 3), np.uint8)
        picture[v, u] = 255
        to_u, to_v = (turn @ (np.array([u, v]) - 2.5) + 2.5).astype(int)
        assert np.argwhere(turned(picture, turn)[..., 0]).tolist() == [[to_v, to_u]]
    for action, became in zip(Action, actions, strict=True):
        assert Action(int(became)).direction == tuple(turn @ action.direction)


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
