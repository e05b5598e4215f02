"""The arc: what it sees, what ends it, what it does not mistake; and the approach to its radius."""

import numpy as np
import pytest
from arc_checks import check_never_leaps, check_order
from eye_in_hand import CAMERA, Ball, Hindered, PinholeArm, Plate, white
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arc import ArcEnd, approach, traverse_arc
from gvp_lib.motion.arm import StopReason
from gvp_lib.motion.primitives import toward_pixel
from gvp_lib.motion.sighting import Eye

pytestmark = pytest.mark.check

AXES = ["y", "x"]


def pinhole(*shapes, **where):
    return Eye(PinholeArm(*shapes, **where), white)


def distances(arc):
    """From the origin, where a pinhole's object is, to the camera of each view."""
    return np.array([np.linalg.norm(view.base_from_camera.translation) for view in arc.views])


# What an arc is


@pytest.mark.parametrize("axis", AXES)
def test_the_views_are_in_the_order_of_the_arc_and_their_angles_rise(axis):
    eye = pinhole(tilt=0.2)
    start = eye.arm.joints
    arc = traverse_arc(eye, axis)
    check_order(arc)
    assert (arc.axis, arc.ends) == (axis, (ArcEnd.ANGLE, ArcEnd.ANGLE))
    np.testing.assert_array_equal(arc.views[arc.center].joints, start)
    assert 0 < arc.center < len(arc) - 1
    np.testing.assert_allclose(np.degrees(arc.angles[[0, -1]]), [-62, 62], atol=3)
    # It goes from the negative side of its axis to the positive, as the camera stood in the middle.
    places = [(arc.views[arc.center].base_from_camera.inv() * v.base_from_camera).translation for v in arc.views]
    along = np.array(places)[:, AXES[::-1].index(axis)]
    assert (np.diff(along) > 0).all()


def test_both_sides_of_a_symmetric_object_look_alike():
    arc = traverse_arc(pinhole(Plate(sides=(0.06, 0.03)), radius=0.3), radius=0.3)
    assert arc.center == len(arc) - 1 - arc.center
    np.testing.assert_allclose(arc.angles, -arc.angles[::-1], atol=0.02)
    np.testing.assert_allclose(arc.ratios, arc.ratios[::-1], atol=0.03)


def test_the_ratio_of_a_plate_falls_as_the_cosine_of_the_angle():
    arc = traverse_arc(pinhole(Plate(sides=(0.04, 0.02), yaw=0.0), radius=0.4), "x", radius=0.4)
    # Its width is seen foreshortened where the camera turns about its length.
    falls = min(arc.ratios[[0, -1]]) < 0.4
    np.testing.assert_allclose(
        arc.ratios, 0.5 * (np.cos(arc.angles) if falls else 1 / np.cos(arc.angles)), rtol=0.08, atol=0.02
    )


def test_max_angle_is_kept_within_a_step_on_each_side():
    for limit in np.radians([10, 30, 90]):
        arc = traverse_arc(pinhole(), max_angle=limit)
        assert (limit <= np.abs(arc.angles[[0, -1]])).all()
        assert (np.abs(arc.angles[[1, -2]]) < limit).all()


def test_a_smaller_step_sees_more():
    counts = [len(traverse_arc(pinhole(), step=step)) for step in (0.04, 0.02, 0.01)]
    np.testing.assert_allclose(np.array(counts[1:]) / counts[:-1], 2, rtol=0.15)


# The radius


@settings(max_examples=10)
@given(st.floats(0.2, 0.45), st.floats(0, 1.0), st.sampled_from(AXES))
def test_the_radius_is_held_along_the_arc(radius, tilt, axis):
    arc = traverse_arc(pinhole(radius=radius, tilt=tilt), axis, radius=radius)
    np.testing.assert_allclose(distances(arc), radius, rtol=0.02)
    np.testing.assert_allclose(np.delete(arc.ranges, arc.center), radius, rtol=0.03)


def test_a_wrong_radius_is_made_good_along_the_way():
    # No more than a step at once.
    arc = traverse_arc(pinhole(radius=0.30), radius=0.25)
    far = distances(arc)
    assert far[arc.center] == pytest.approx(0.30)
    assert np.abs(np.diff(far)).max() < 0.021
    np.testing.assert_allclose(far[[0, -1]], 0.25, rtol=0.02)


def test_what_a_long_step_adds_to_the_range_is_made_good_at_once():
    # Erratum 10: by the depth along the axis, as printed, it would stay at hypot(0.25, 0.06) = 0.257 m.
    np.testing.assert_allclose(distances(traverse_arc(pinhole(), step=0.06)), 0.25, rtol=0.01)


def test_a_range_that_is_quite_another_is_not_believed():
    arc = traverse_arc(pinhole(radius=0.6), radius=0.25, max_angle=0.3)
    assert (distances(arc) >= 0.6 - 1e-9).all()


def test_uncorrected_the_range_grows_with_every_tangent_step():
    arc = traverse_arc(pinhole(), radius=None)
    steps = np.abs(np.arange(len(arc)) - arc.center)
    np.testing.assert_allclose(distances(arc), np.hypot(0.25, 0.02 * np.sqrt(steps)), rtol=0.003)
    np.testing.assert_allclose(np.delete(arc.ranges, arc.center), np.delete(distances(arc), arc.center), rtol=0.02)


# What ends it


STOPS = [r for r in StopReason if r is not StopReason.REACHED]


@pytest.mark.parametrize("reason", STOPS)
@pytest.mark.parametrize("motion", [6, 7], ids=["in the step", "in the turn"])
def test_a_motion_that_fails_half_way_ends_its_side_and_keeps_what_was_seen(reason, motion):
    # Two motions to a view: the step, and the turn with the correction.
    eye = Eye(Hindered(PinholeArm(tilt=0.2), stops={motion: reason}), white)
    start = eye.arm.joints
    arc = traverse_arc(eye)
    assert arc.ends == (ArcEnd.ANGLE, ArcEnd(reason.value))
    assert len(arc) - 1 - arc.center == 3
    check_order(arc)
    np.testing.assert_allclose(eye.arm.joints, start, atol=1e-9)
    free = traverse_arc(pinhole(tilt=0.2))
    np.testing.assert_allclose(arc.angles, free.angles[: len(arc)], atol=0.01)


def test_every_reason_to_stop_has_its_end():
    assert {r.value for r in STOPS} <= {e.value for e in ArcEnd}


def test_an_arm_stopped_at_once_on_both_sides_has_one_view():
    eye = Eye(Hindered(PinholeArm(), stops={0: StopReason.COLLISION, 1: StopReason.JOINT_LIMIT}), white)
    arc = traverse_arc(eye)
    assert (len(arc), arc.center) == (1, 0)
    assert arc.ends == (ArcEnd.JOINT_LIMIT, ArcEnd.COLLISION)
    check_order(arc)


def test_an_arm_that_cannot_go_straight_back_goes_back_from_view_to_view():
    arm = Hindered(PinholeArm(), frozen=lambda arm: arm.returns == 1)
    start = arm.joints
    eye = Eye(arm, white)
    arc = traverse_arc(eye)
    assert arc.ends == (ArcEnd.ANGLE, ArcEnd.ANGLE)
    assert arm.returns == 1 + (len(arc) - 1 - arc.center) + 1 + 1  # in vain; by every view to the start; again
    np.testing.assert_allclose(arm.joints, start, atol=1e-12)


def test_an_arm_that_cannot_go_back_at_all_ends_the_other_side_too():
    arc = traverse_arc(Eye(Hindered(PinholeArm(), frozen=lambda arm: True), white))
    assert arc.ends == (ArcEnd.COLLISION, ArcEnd.ANGLE)
    assert arc.center == 0
    assert len(arc) > 5


def test_the_caller_may_have_seen_enough_and_the_arm_stays_where_it_stands():
    for n in (3, 20):
        eye = pinhole()
        given_views = []

        def enough(views, n=n, given_views=given_views):
            given_views.append(list(views))
            return len(views) == n

        arc = traverse_arc(eye, enough=enough)
        assert len(arc) == n
        assert list(arc.views) == given_views[-1]
        assert [len(views) for views in given_views] == list(range(2, n + 1))
        check_order(arc)
        last = arc.views[-1 if n == 3 else 0]
        np.testing.assert_array_equal(eye.arm.joints, last.joints)
        assert arc.ends == ((ArcEnd.ENOUGH, ArcEnd.ENOUGH) if n == 3 else (ArcEnd.ENOUGH, ArcEnd.ANGLE))


def test_an_arm_that_moves_without_bringing_the_object_to_the_middle_is_not_centered():
    class Lame(PinholeArm):
        def move_camera(self, camera_from_target):
            turnless = RigidTransform.from_translation(camera_from_target.translation)
            return super().move_camera(turnless)

    arc = traverse_arc(Eye(Lame(), white))
    assert arc.ends == (ArcEnd.NOT_CENTERED, ArcEnd.NOT_CENTERED)
    assert len(arc) == 1


# An object that is lost


def test_nothing_in_view_is_an_arc_of_no_views():
    arc = traverse_arc(pinhole(Ball((5.0, 0, 0))))
    assert (len(arc), arc.center) == (0, -1)
    assert arc.ends == (ArcEnd.TARGET_LOST, ArcEnd.TARGET_LOST)
    assert arc.angles.shape == arc.ratios.shape == arc.ranges.shape == (0,)


def test_an_object_gone_for_good_ends_both_sides():
    arm = Hindered(PinholeArm(), blind=lambda arm: arm.frames > 8)
    start = arm.joints
    arc = traverse_arc(Eye(arm, white))
    assert arc.ends == (ArcEnd.TARGET_LOST, ArcEnd.TARGET_LOST)
    assert arc.center == 0
    assert len(arc) == 4
    assert arm.motions == 8  # one step more and its turn, and none on the other side
    check_order(arc)
    np.testing.assert_allclose(arm.joints, start, atol=1e-12)


@pytest.mark.parametrize("lost_side", [-1, 1])
def test_an_object_out_of_sight_on_one_side_is_still_looked_at_from_the_other(lost_side):
    start = PinholeArm().camera_pose()

    def hidden(arm):
        return lost_side * (start.inv() * arm.camera_pose()).translation[1] > 0.09

    arc = traverse_arc(Eye(Hindered(PinholeArm(), blind=hidden), white))
    expected = {-1: (ArcEnd.TARGET_LOST, ArcEnd.ANGLE), 1: (ArcEnd.ANGLE, ArcEnd.TARGET_LOST)}
    assert arc.ends == expected[lost_side]
    sides = {-1: arc.center, 1: len(arc) - 1 - arc.center}
    assert sides[lost_side] == 4
    assert sides[-lost_side] > 10
    check_order(arc)


@pytest.mark.parametrize("hidden_frame", [6, 7], ids=["after the step", "after the turn"])
def test_a_single_blind_frame_ends_the_side_and_not_the_arc(hidden_frame):
    arm = Hindered(PinholeArm(), blind=lambda arm: arm.frames == hidden_frame)
    arc = traverse_arc(Eye(arm, white))
    assert arc.ends == (ArcEnd.ANGLE, ArcEnd.TARGET_LOST)
    assert len(arc) - 1 - arc.center == 2


# A second object of the same color


@settings(max_examples=20)
@given(st.floats(0.016, 0.08), st.floats(0, 2 * np.pi), st.sampled_from(AXES), st.sampled_from([0.01, 0.02, 0.04]))
def test_a_neighbor_of_the_same_kind_is_never_taken_for_the_object(apart, bearing, axis, step):
    neighbor = (apart * np.cos(bearing), apart * np.sin(bearing), 0.0)
    arc = traverse_arc(pinhole(Ball(), Ball(neighbor)), axis, step=step)
    check_never_leaps(arc, (0, 0, 0), within=4)
    assert set(arc.ends) <= {ArcEnd.ANGLE, ArcEnd.TARGET_LOST}
    assert len(arc) > 2


def test_an_object_that_merges_with_a_neighbor_ends_that_side():
    # From low down, along the line of the two, one hides the other and they show as one.
    eye = pinhole(Ball(radius=0.01), Ball((0.03, 0, 0), radius=0.01))
    start = eye.arm.camera_pose().rotation.as_matrix()
    axis = AXES[::-1][int(np.argmax(np.abs(start[0, :2])))]
    arc = traverse_arc(eye, axis, max_angle=np.radians(85))
    assert arc.ends == (ArcEnd.TARGET_LOST, ArcEnd.TARGET_LOST)
    assert np.abs(arc.angles).max() > np.radians(30)
    areas = np.array([view.blob.area for view in arc.views])
    assert areas.max() / areas.min() < 1.5


# The approach to the radius


@pytest.mark.parametrize("distance", [0.18, 0.25, 0.35, 0.5])
def test_the_approach_comes_to_the_radius_by_depth_from_motion_alone(distance):
    eye = pinhole(radius=distance, tilt=0.3)
    came = approach(eye, 0.25)
    assert came.motion
    assert came.distance == pytest.approx(0.25, rel=0.05)
    assert np.linalg.norm(eye.arm.camera_pose().translation) == pytest.approx(0.25, rel=0.05)
    np.testing.assert_allclose(came.view.blob.centroid, CAMERA.principal_point, atol=2)


def test_an_approach_ends_when_a_measurement_finds_nothing_left_to_do():
    for radius, motions in ((0.25, 2), (0.4, 4)):  # a step and an advance, once or twice
        arm = Hindered(PinholeArm(radius=radius))
        approach(Eye(arm, white), 0.25)
        assert arm.motions == motions


def test_an_approach_steps_to_and_fro_and_does_not_wander_off():
    eye = pinhole(radius=0.4)
    before = eye.arm.camera_pose().translation / 0.4
    after = approach(eye, 0.25).view.base_from_camera.translation
    assert np.degrees(np.arccos(before @ after / np.linalg.norm(after))) < 3  # to and to would be 7


@settings(max_examples=20)
@given(st.floats(0.2, 0.36), st.floats(0.034, 0.08), st.floats(0, 2 * np.pi))
def test_an_approach_never_takes_a_neighbor_for_the_object(distance, apart, bearing):
    neighbor = (apart * np.cos(bearing), apart * np.sin(bearing), 0.0)
    eye = pinhole(Ball(), Ball(neighbor), radius=distance)
    came = approach(eye, 0.25)
    assert came.distance == pytest.approx(0.25, rel=0.05)
    assert np.linalg.norm(came.view.base_from_camera.translation) == pytest.approx(0.25, rel=0.05)
    shown = CAMERA.project(came.view.base_from_camera.inv().apply([0.0, 0.0, 0.0]))
    np.testing.assert_allclose(came.view.blob.centroid, shown, atol=2)


def test_an_approach_begins_from_off_the_middle():
    eye = pinhole(radius=0.35)
    eye.arm.move_camera(RigidTransform.from_rotation(toward_pixel(CAMERA, CAMERA.principal_point + (90, -60))))
    assert approach(eye, 0.25).distance == pytest.approx(0.25, rel=0.05)


def test_a_range_that_could_not_be_measured_is_no_arrival():
    class Mirage(PinholeArm):
        """What it sees keeps its place in the image."""

        def capture(self):
            return PinholeArm().capture()

    came = approach(Eye(Mirage(radius=0.4), white), 0.25, attempts=3)
    assert np.isnan(came.distance)
    assert came.view is not None


def test_one_vain_measurement_is_made_again():
    class Late(PinholeArm):
        """Its first step sideways shows nothing."""

        frames = 0

        def capture(self):
            self.frames += 1
            return PinholeArm(radius=0.4).capture() if self.frames == 2 else super().capture()

    eye = Eye(Late(radius=0.4), white)
    assert approach(eye, 0.25).distance == pytest.approx(0.25, rel=0.05)
    assert np.linalg.norm(eye.arm.camera_pose().translation) == pytest.approx(0.25, rel=0.05)


@pytest.mark.parametrize("motions", [(0, 1, 2, 3), (1,)], ids=["in every step", "in the advance"])
def test_an_approach_that_is_stopped_says_why_and_keeps_its_last_view(motions):
    stops = dict.fromkeys(motions, StopReason.COLLISION)
    eye = Eye(Hindered(PinholeArm(radius=0.4), stops=stops), white)
    came = approach(eye, 0.25)
    assert came.motion.reason is StopReason.COLLISION
    assert came.view is not None
    assert np.isnan(came.distance)


@pytest.mark.parametrize("barred", [1, 2, 3])
def test_an_approach_that_cannot_step_one_way_steps_another(barred):
    stops = dict.fromkeys(range(barred), StopReason.COLLISION)
    came = approach(Eye(Hindered(PinholeArm(radius=0.4), stops=stops), white), 0.25)
    assert came.motion
    assert came.distance == pytest.approx(0.25, rel=0.05)


@pytest.mark.parametrize("seen", [0, 1, 2])
def test_an_approach_to_an_object_that_is_lost_has_no_view(seen):
    eye = Eye(Hindered(PinholeArm(radius=0.4), blind=lambda arm: arm.frames > seen), white)
    came = approach(eye, 0.25)
    assert came.view is None
    assert np.isnan(came.distance)
    assert came.motion


# Misuse


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"axis": "z"}, 'camera\'s axis "x" or "y"; got \'z\''),
        ({"radius": 0.0}, "radius is positive and finite, in m, px or rad; got 0.0"),
        ({"radius": -0.25}, r"radius is positive.*got -0\.25"),
        ({"step": 0}, "step is positive.*got 0"),
        ({"step": np.nan}, "step is positive.*got nan"),
        ({"max_angle": 60}, r"max_angle is in radians, at most pi; got 60\. For degrees: np\.radians"),
        ({"max_angle": -1}, "max_angle is positive"),
        ({"threshold": np.inf}, "threshold is positive and finite"),
    ],
)
def test_settings_of_an_arc_that_make_no_sense_are_refused_before_anything_moves(arguments, text):
    eye = pinhole()
    before = eye.arm.joints
    with pytest.raises(InvalidParameterError, match=text):
        traverse_arc(eye, **arguments)
    np.testing.assert_array_equal(eye.arm.joints, before)
    assert eye.looks == 0


@pytest.mark.parametrize("name", ["radius", "step", "tolerance"])
def test_settings_of_an_approach_that_make_no_sense_are_refused(name):
    with pytest.raises(InvalidParameterError, match=f"{name} is positive and finite"):
        approach(pinhole(), **{"radius": 0.25, name: -1.0})
