"""The arc: what it sees, what ends it, what it does not mistake; and the approach to its radius."""

import numpy as np
import pytest
from arc_checks import check_never_leaps, check_order
from eye_in_hand import CAMERA, Ball, Hindered, PinholeArm, white
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arc import approach, traverse_arc
from gvp_lib.motion.arm import STOPS, Outcome
from gvp_lib.motion.primitives import toward_pixel
from gvp_lib.motion.sighting import Eye

pytestmark = pytest.mark.check

AXES = ["y", "x"]
ANGLE, LOST = Outcome.MAX_ANGLE, Outcome.TARGET_LOST


def pinhole(*shapes, **where):
    return Eye(PinholeArm(*shapes, **where), white)


def hindered(*, radius=0.25, **hindrance):
    return Eye(Hindered(PinholeArm(radius=radius), **hindrance), white)


def distances(arc):
    """From the origin, where a pinhole's object is, to the camera of each view."""
    return np.array([np.linalg.norm(view.base_from_camera.translation) for view in arc.views])


def sides(arc):
    """Numbers of views on the negative and on the positive side."""
    return arc.center, len(arc) - 1 - arc.center


@pytest.mark.parametrize(("axis", "limit"), [("y", np.radians(60)), ("x", np.radians(60)), ("y", np.radians(10))])
def test_the_views_are_in_the_order_of_the_arc_and_their_angles_rise_to_the_limit(axis, limit):
    eye = pinhole(tilt=0.2)
    start = eye.arm.joints
    arc = traverse_arc(eye, axis, max_angle=limit)
    check_order(arc)
    assert (arc.axis, arc.ends) == (axis, (ANGLE, ANGLE))
    np.testing.assert_array_equal(arc.views[arc.center].joints, start)
    assert np.abs(arc.angles[[1, -2]]).max() < limit <= np.abs(arc.angles[[0, -1]]).min()
    # Erratum 11: a complete arc from the negative side to the positive, its center once.
    places = [(arc.views[arc.center].base_from_camera.inv() * v.base_from_camera).translation for v in arc.views]
    assert (np.diff(np.array(places)[:, AXES[::-1].index(axis)]) > 0).all()
    np.testing.assert_allclose(np.linalg.norm(np.diff(places, axis=0), axis=1), 0.02, rtol=0.1)


@settings(max_examples=10)
@given(st.floats(0.2, 0.45), st.floats(0, 1.0), st.sampled_from(AXES), st.sampled_from([0.02, 0.06]))
@example(0.25, 0.0, "y", 0.06)  # Erratum 10: by the depth along the axis, as printed, it would stay at 0.257 m.
def test_the_radius_is_held_along_the_arc(radius, tilt, axis, step):
    arc = traverse_arc(pinhole(radius=radius, tilt=tilt), axis, radius=radius, step=step)
    np.testing.assert_allclose(distances(arc), radius, rtol=0.02)
    np.testing.assert_allclose(np.delete(arc.ranges, arc.center), radius, rtol=0.03)


def test_a_wrong_radius_is_made_good_along_the_way_by_no_more_than_a_step_at_once():
    far = distances(traverse_arc(pinhole(radius=0.30), radius=0.25))
    assert far.max() == pytest.approx(0.30)
    assert np.abs(np.diff(far)).max() < 0.021
    np.testing.assert_allclose(far[[0, -1]], 0.25, rtol=0.02)


def test_a_range_that_is_quite_another_is_not_believed():
    arc = traverse_arc(pinhole(radius=0.6), radius=0.25, max_angle=0.3)
    assert (distances(arc) >= 0.6 - 1e-9).all()


FREE = 14  # views on a side that nothing ends but its angle
# Of an arm's motions, its pictures and its joints: what goes wrong, how the two sides end, and what each has seen. Two
# motions and two pictures go to a view: the step, and the turn with the correction.
HINDRANCES = [
    *(({"stops": {k: reason}}, (ANGLE, reason), (FREE, 3)) for reason in STOPS for k in (6, 7)),
    ({"stops": {0: Outcome.COLLISION, 1: Outcome.JOINT_LIMIT}}, (Outcome.JOINT_LIMIT, Outcome.COLLISION), (0, 0)),
    # It cannot go straight back, and goes back from view to view; or not at all.
    ({"frozen": lambda arm: arm.returns == 1}, (ANGLE, ANGLE), (FREE, FREE)),
    ({"frozen": lambda arm: True}, (Outcome.COLLISION, ANGLE), (0, FREE)),
    # The object is gone for good, for one picture after the step or the turn, or from one side.
    ({"blind": lambda arm: arm.frames > 8}, (LOST, LOST), (0, 3)),
    *(({"blind": lambda arm, k=k: arm.frames == k}, (ANGLE, LOST), (FREE, 2)) for k in (6, 7)),
    ({"blind": lambda arm: across(arm) > 0.09}, (ANGLE, LOST), (FREE, 4)),
    ({"blind": lambda arm: across(arm) < -0.09}, (LOST, ANGLE), (4, FREE)),
]


def across(arm):
    """How far the camera has moved along the arc's axis, m."""
    return (PinholeArm().camera_pose().inv() * arm.camera_pose()).translation[1]


@pytest.mark.parametrize(("hindrance", "ends", "seen"), HINDRANCES)
def test_a_hindrance_ends_its_side_keeps_what_was_seen_and_lets_the_other_side_be_seen(hindrance, ends, seen):
    # Erratum 11: as printed Algorithm 2 goes the other way from the far end, and overwrites q[0].
    eye = hindered(**hindrance)
    start = eye.arm.joints
    arc = traverse_arc(eye)
    assert (arc.ends, sides(arc)) == (ends, seen)
    check_order(arc)
    free = traverse_arc(pinhole()).angles
    np.testing.assert_allclose(arc.angles, free[FREE - seen[0] :][: len(arc)], atol=0.01)
    if ends[0] is not Outcome.COLLISION:
        np.testing.assert_allclose(eye.arm.joints, start, atol=1e-9)
    if ends == (LOST, LOST):  # gone for good, it is not looked for on the other side
        assert eye.arm.motions == 8


@pytest.mark.parametrize(("n", "other", "stands_at"), [(3, Outcome.ENOUGH, -1), (20, ANGLE, 0)])
def test_the_caller_may_have_seen_enough_and_the_arm_stays_where_it_stands(n, other, stands_at):
    eye, given_views = pinhole(), []

    def enough(views):
        given_views.append(list(views))
        return len(views) == n

    arc = traverse_arc(eye, enough=enough)
    assert list(arc.views) == given_views[-1]
    assert [len(views) for views in given_views] == list(range(2, n + 1))
    check_order(arc)
    np.testing.assert_array_equal(eye.arm.joints, arc.views[stands_at].joints)
    assert arc.ends == (Outcome.ENOUGH, other)


def test_an_arm_that_moves_without_bringing_the_object_to_the_middle_is_not_centered():
    class Lame(PinholeArm):
        def move_camera(self, camera_from_target):
            return super().move_camera(RigidTransform.from_translation(camera_from_target.translation))

    arc = traverse_arc(Eye(Lame(), white))
    assert (len(arc), arc.ends) == (1, (Outcome.NOT_CENTERED, Outcome.NOT_CENTERED))


def test_nothing_in_view_is_an_arc_of_no_views():
    arc = traverse_arc(pinhole(Ball((5.0, 0, 0))))
    assert (len(arc), arc.center, arc.ends) == (0, -1, (LOST, LOST))
    assert arc.angles.shape == arc.ratios.shape == arc.ranges.shape == (0,)


@settings(max_examples=20)
@given(st.floats(0.016, 0.08), st.floats(0, 2 * np.pi), st.sampled_from(AXES), st.sampled_from([0.01, 0.02, 0.04]))
def test_a_neighbor_of_the_same_kind_is_never_taken_for_the_object(apart, bearing, axis, step):
    neighbor = (apart * np.cos(bearing), apart * np.sin(bearing), 0.0)
    arc = traverse_arc(pinhole(Ball(), Ball(neighbor)), axis, step=step)
    check_never_leaps(arc, (0, 0, 0), within=4)
    assert set(arc.ends) <= {ANGLE, LOST}
    assert len(arc) > 2


def test_an_object_that_merges_with_a_neighbor_ends_that_side():
    # From low down, along the line of the two, one hides the other and they show as one.
    eye = pinhole(Ball(radius=0.01), Ball((0.03, 0, 0), radius=0.01))
    arc = traverse_arc(eye, "y", max_angle=np.radians(85))
    assert arc.ends == (LOST, LOST)
    assert np.abs(arc.angles).max() > np.radians(30)
    areas = np.array([view.blob.area for view in arc.views])
    assert areas.max() / areas.min() < 1.5


def check_arrival(eye):
    came = approach(eye, 0.25)
    assert came
    assert abs(came.errors[-1]) < 0.05 * 0.25
    assert np.linalg.norm(eye.arm.camera_pose().translation) == pytest.approx(0.25, rel=0.05)
    shown = CAMERA.project(came.view.base_from_camera.inv().apply([0.0, 0.0, 0.0]))
    np.testing.assert_allclose(came.view.blob.centroid, shown, atol=2)
    np.testing.assert_allclose(came.view.blob.centroid, CAMERA.principal_point, atol=2)


BARRED = Outcome.COLLISION


# A step and an advance go to an attempt; and a step that the arm cannot make, before it steps another way.
@pytest.mark.parametrize(
    ("distance", "stops", "motions"),
    [
        (0.18, {}, 4),
        (0.25, {}, 2),
        (0.4, {}, 4),
        (0.5, {}, 4),
        (0.4, {0: BARRED}, 4 + 1),
        (0.4, dict.fromkeys(range(3), BARRED), 4 + 3),
    ],
)
def test_the_approach_comes_to_the_radius_by_depth_from_motion_alone_and_ends_there(distance, stops, motions):
    eye = hindered(radius=distance, stops=stops)
    check_arrival(eye)
    assert eye.arm.motions == motions


def test_an_approach_steps_to_and_fro_and_does_not_wander_off():
    eye = pinhole(radius=0.4)
    before = eye.arm.camera_pose().translation / 0.4
    after = approach(eye, 0.25).view.base_from_camera.translation
    assert np.degrees(np.arccos(before @ after / np.linalg.norm(after))) < 3  # to and to would be 7


@settings(max_examples=20)
@given(st.floats(0.2, 0.36), st.floats(0.034, 0.08), st.floats(0, 2 * np.pi))
def test_an_approach_never_takes_a_neighbor_for_the_object(distance, apart, bearing):
    neighbor = (apart * np.cos(bearing), apart * np.sin(bearing), 0.0)
    check_arrival(pinhole(Ball(), Ball(neighbor), radius=distance))


def test_an_approach_begins_from_off_the_middle():
    eye = pinhole(radius=0.35)
    eye.arm.move_camera(RigidTransform.from_rotation(toward_pixel(CAMERA, CAMERA.principal_point + (90, -60))))
    check_arrival(eye)


class Mirage(PinholeArm):
    """What it sees keeps its place in the image in its pictures from the second on, up to the ``last`` one."""

    frames, last = 0, np.inf

    def capture(self):
        self.frames += 1
        return PinholeArm(radius=0.4).capture() if 2 <= self.frames <= self.last else super().capture()


def test_a_vain_measurement_is_made_again_and_without_any_there_is_no_distance():
    arm = Mirage(radius=0.4)
    came = approach(Eye(arm, white), 0.25, attempts=3)
    assert np.isnan(came.errors).tolist() == [True] * 3
    assert came.view is not None
    assert (came.outcome, bool(came.motion)) == ("out of steps", True)
    arm = Mirage(radius=0.4)
    arm.last = 2
    check_arrival(Eye(arm, white))


@pytest.mark.parametrize(
    ("hindrance", "sees", "reason"),
    [
        ({"stops": dict.fromkeys((0, 1, 2, 3), Outcome.COLLISION)}, True, Outcome.COLLISION),  # in every step
        ({"stops": {1: Outcome.COLLISION}}, True, Outcome.COLLISION),  # in the advance
        *(({"blind": lambda arm, n=n: arm.frames > n}, False, Outcome.REACHED) for n in (0, 1, 2)),
    ],
)
def test_an_approach_that_is_stopped_keeps_its_last_view_and_one_to_a_lost_object_has_none(hindrance, sees, reason):
    came = approach(hindered(radius=0.4, **hindrance), 0.25)
    assert ((came.view is not None), came.motion.reason) == (sees, reason)
    assert came.outcome is (reason if sees else Outcome.TARGET_LOST)


@pytest.mark.parametrize(
    ("call", "arguments", "text"),
    [
        (traverse_arc, {"axis": "z"}, 'camera\'s axis "x" or "y"; got \'z\''),
        (traverse_arc, {"radius": 0.0}, "radius is positive and finite, in m, px or rad; got 0.0"),
        (traverse_arc, {"step": np.nan}, "step is positive.*got nan"),
        (traverse_arc, {"max_angle": 60}, r"max_angle is in radians, at most pi; got 60\. For degrees: np\.radians"),
        (traverse_arc, {"threshold": np.inf}, "threshold is positive and finite"),
        (approach, {"radius": 0.25, "step": 0}, "step is positive and finite"),
        (approach, {"radius": 0.25, "tolerance": 0}, "tolerance is positive and finite"),
    ],
)
def test_settings_that_make_no_sense_are_refused_before_anything_moves(call, arguments, text):
    eye = pinhole()
    before = eye.arm.joints
    with pytest.raises(InvalidParameterError, match=text):
        call(eye, **arguments)
    np.testing.assert_array_equal(eye.arm.joints, before)
    assert eye.looks == 0
