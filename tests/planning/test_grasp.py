"""Completing a grasp, without a simulator: what it does on the way down, and every way in which it can end."""

import numpy as np
import pytest
from eye_in_hand import CAMERA, Ball, Hindered, PinholeArm, Plate, white
from hands import HAND, SHUT, WIDE, Asked, FaultyGripper, Never, PlainGripper, above, check_grasp

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arm import EyeInHandArm, Gripper, StopReason
from gvp_lib.motion.sighting import Eye
from gvp_lib.perception.moments import Blob
from gvp_lib.perception.tracking import Tracker
from gvp_lib.planning.closing import RangeThreshold, SizedDepth
from gvp_lib.planning.grasp import GraspExecutor, GraspOutcome
from gvp_lib.simulation.objects import OBJECTS

pytestmark = pytest.mark.check

SMALL = Plate(sides=(0.020, 0.032))  # m; in full view until the fingers close
STOPPED = [StopReason.JOINT_LIMIT, StopReason.COLLISION, StopReason.UNREACHABLE, StopReason.STALLED]
CENTER = CAMERA.principal_point


class After:
    """A rule that says to close after so many increments."""

    def __init__(self, increments):
        self.increments = increments

    def remaining(self, readings, hand):
        return 0.0 if len(readings) > self.increments else np.inf


def grasp(arm, gripper=None, segmenter=white, closing=None, **options):
    gripper = PlainGripper(arm) if gripper is None else gripper
    return GraspExecutor(segmenter, closing or RangeThreshold(), **options).grasp(arm, gripper)


def offsets(arm, gripper=None, **options):
    """From the middle to the object in each picture, px; and the grasp."""
    found = []

    def watching(rgb):
        mask = white(rgb)
        blob = Blob.from_mask(mask)
        found.append(blob.centroid - CENTER)
        return mask

    done = grasp(arm, gripper, watching, **options)
    return np.abs(found).max(axis=1), done


# On the way down


def test_the_hand_goes_down_along_the_lens_in_increments_and_reads_at_each():
    for step in (0.005, 0.010):
        done = grasp(above(SMALL), step=step)
        heights = [reading.base_from_camera.translation[2] for reading in done.readings]
        np.testing.assert_allclose(np.diff(heights), -step, atol=1e-9)
        distances = [reading.distance for reading in done.readings]
        np.testing.assert_allclose(distances, np.array(heights) - HAND.sensor, atol=1e-9)
        assert distances[-1] < 0.10 <= distances[-2]
        check_grasp(done)


def test_then_it_closes_and_lifts_by_ten_centimeters():
    arm = above(SMALL)
    gripper = PlainGripper(arm)
    done = grasp(arm, gripper)
    assert done.outcome is GraspOutcome.HELD
    assert gripper.told == ["open", "close"]
    assert done.width == gripper.thickness
    np.testing.assert_allclose(arm.camera_pose().translation, done.closed_at.translation + (0, 0, 0.10), atol=1e-9)


def test_a_lift_is_straight_up_however_the_hand_leans():
    arm = PinholeArm(Ball(), tilt=0.4, azimuth=2.0)
    done = grasp(arm)
    assert done.outcome is GraspOutcome.HELD
    np.testing.assert_allclose(arm.camera_pose().translation - done.closed_at.translation, (0, 0, 0.10), atol=1e-6)
    assert (arm.camera_pose().rotation.inv() * done.closed_at.rotation).magnitude() < 1e-6


def test_where_there_is_less_to_go_than_an_increment_the_hand_goes_that_far():
    done = grasp(above(SMALL), closing=SizedDepth(), step=0.007)
    gone = -np.diff([reading.base_from_camera.translation[2] for reading in done.readings])
    assert gone.max() == pytest.approx(0.007)
    assert 0 < gone[-1] < 0.006
    assert done.closed_at.translation[2] == pytest.approx(HAND.tips - 0.020, abs=0.0005)  # 20 mm below the surface


@pytest.mark.parametrize("step", [0.002, 0.010])
def test_an_increment_of_any_length_allowed_does_not_lose_sight_of_the_object(step):
    assert grasp(above(SMALL), step=step).outcome is GraspOutcome.HELD


@pytest.mark.parametrize("recenter", ["turning", "shifting"])
def test_the_object_stays_in_the_middle_from_wherever_it_was(recenter):
    found, done = offsets(above(SMALL, off=(50, -40)), recenter=recenter)
    assert done.outcome is GraspOutcome.HELD
    assert found[0] > 45
    # One increment brings it to the middle; a shift knows the distance only roughly.
    assert found[1] < (3 if recenter == "turning" else 6)
    assert found[4:].max() < 4
    assert len(found) > 20


def test_without_recentering_it_drifts_out_of_the_middle():
    found, _ = offsets(above(SMALL, off=(25, -20)), recenter=None)
    assert (np.diff(found) > 0).all()
    assert found[-1] > 1.5 * found[0]


def test_an_offset_within_the_threshold_is_left_alone():
    for threshold, left in ((20.0, False), (40.0, True)):
        found, _ = offsets(above(SMALL, height=0.2, off=(25, 0)), threshold=threshold)
        assert bool(found[1] > 20) is left


def test_shifting_keeps_the_direction_of_view_and_turning_gives_it_up():
    turned = {}
    for recenter in ("turning", "shifting"):
        arm = above(SMALL, off=(50, -40))
        before = arm.camera_pose().rotation
        grasp(arm, recenter=recenter)
        turned[recenter] = np.degrees((before.inv() * arm.camera_pose().rotation).magnitude())
    assert turned["shifting"] < 1e-6
    assert turned["turning"] == pytest.approx(np.degrees(np.arctan(np.hypot(50, 40) / CAMERA.fx)), abs=0.6)


def test_the_wrist_turns_along_the_major_axis_where_it_is_asked_to():
    for realign, roll in ((True, 0.0), (False, 20.0)):
        done = grasp(above(SMALL, turn=np.radians(20)), realign=realign)
        _, y, _ = done.closed_at.rotation.as_matrix().T
        assert np.degrees(np.arctan2(abs(y[0]), abs(y[1]))) == pytest.approx(roll, abs=1.0)


def test_an_object_at_the_border_is_followed_no_further_and_no_longer_looked_at():
    long = Plate(sides=(0.020, 0.090))  # out of the picture from 0.1 m on
    found, done = offsets(above(long))
    assert done.outcome is GraspOutcome.HELD
    assert done.view.clipped
    assert done.frames == len(found) < len(done.readings)
    assert done.view.base_from_camera.translation[2] == pytest.approx(0.09 * CAMERA.fy / CAMERA.height, abs=0.006)


def test_what_is_at_the_border_to_begin_with_is_not_followed_at_all():
    arm = above(SMALL, height=0.14, off=(290, 0))
    before = arm.camera_pose()
    done = grasp(arm)
    assert done.view.clipped
    assert done.frames == 1
    down = before.inv() * done.closed_at
    np.testing.assert_allclose(down.translation[:2], 0, atol=1e-9)
    assert down.rotation.magnitude() < 1e-9


@pytest.mark.parametrize("of_the_plan", [True, False])
def test_of_two_objects_of_one_color_the_plans_is_the_target_and_without_a_plan_the_one_nearest_the_middle(of_the_plan):
    arm = above(Plate((0.04, 0.0, 0.0), SMALL.sides), Plate((-0.03, 0.0, 0.0), SMALL.sides))
    plan_view = Eye(arm, Tracker(white, CENTER + (85, 0))).look()
    executor = GraspExecutor(white, recenter="shifting")
    done = executor.grasp(arm, PlainGripper(arm), plan_view if of_the_plan else None)
    assert done.outcome is GraspOutcome.HELD
    assert done.closed_at.translation[0] == pytest.approx(0.04 if of_the_plan else -0.03, abs=0.002)


def test_of_a_single_object_the_plans_view_changes_nothing():
    readings = []
    for told in (True, False):
        arm = above(SMALL, off=(50, -40))
        view = Eye(arm, white).look() if told else None
        readings.append(GraspExecutor(white).grasp(arm, PlainGripper(arm), view).readings)
    poses = [[reading.base_from_camera.as_matrix() for reading in some] for some in readings]
    np.testing.assert_array_equal(*poses)


# Every way to end


def test_where_nothing_is_in_sight_nothing_moves():
    arm = Hindered(above(SMALL, off=(0, 3000)))
    done = grasp(arm, PlainGripper(arm))
    assert done.outcome is GraspOutcome.TARGET_NOT_FOUND
    assert (done.frames, done.readings, done.view, arm.motions) == (1, (), None, 0)
    check_grasp(done)


@pytest.mark.parametrize(("width", "outcome"), [(0.065, "held"), (0.080, "too wide"), (0.110, "too wide")])
def test_what_the_open_fingers_cannot_span_is_not_touched(width, outcome):
    arm = Hindered(above(Plate(sides=(width, 0.115))))
    gripper = PlainGripper(arm)
    done = grasp(arm, gripper)
    assert done.outcome.value == outcome
    if outcome == "too wide":
        assert (arm.motions, gripper.told, done.readings) == (0, ["open"], ())
    check_grasp(done)


def test_a_sensor_that_sees_nothing_does_not_make_the_object_too_wide():
    arm = above(Plate(sides=(0.06, 0.08)))
    deaf = FaultyGripper(PlainGripper(arm), range=lambda gripper: np.inf)
    assert grasp(arm, deaf, closing=After(40)).outcome is GraspOutcome.HELD


@pytest.mark.parametrize("pictures", [1, 5])
def test_an_object_that_is_lost_on_the_way_ends_the_grasp_where_it_was_lost(pictures):
    arm = Hindered(above(SMALL), blind=lambda arm: arm.frames > pictures)
    gripper = PlainGripper(arm)
    done = grasp(arm, gripper)
    assert done.outcome is GraspOutcome.TARGET_LOST
    assert done.frames == pictures + 1
    assert arm.motions == len(done.readings) == pictures
    assert gripper.told == ["open"]
    assert done.view is not None  # the last there was
    check_grasp(done)


@pytest.mark.parametrize("reason", STOPPED, ids=lambda reason: reason.value)
def test_an_arm_that_stops_on_the_way_down_ends_the_grasp_and_says_why(reason):
    arm = Hindered(above(SMALL), stops={3: reason})
    gripper = PlainGripper(arm)
    done = grasp(arm, gripper)
    assert done.outcome is GraspOutcome(reason.value)
    assert len(done.readings) == 4
    assert gripper.told == ["open"]
    check_grasp(done)


def test_a_rule_that_never_says_to_close_ends_at_the_limit():
    arm = above(SMALL, height=0.4)
    done = grasp(arm, closing=Never(), limit=0.10)
    assert done.outcome is GraspOutcome.NEVER_CLOSED
    assert len(done.readings) == 21  # the last of them at the limit
    assert arm.camera_pose().translation[2] == pytest.approx(0.30)
    check_grasp(done)


def test_fingers_that_do_not_move_are_jammed():
    arm = above(SMALL)
    jammed = FaultyGripper(PlainGripper(arm), close=lambda gripper: None)
    done = grasp(arm, jammed)
    assert done.outcome is GraspOutcome.JAMMED
    assert jammed.closed == 1
    assert done.width == WIDE
    np.testing.assert_array_equal(arm.camera_pose().as_matrix(), done.closed_at.as_matrix())  # nothing is lifted
    check_grasp(done)


def test_fingers_that_meet_each_other_have_closed_on_nothing():
    arm = above(SMALL)
    done = grasp(arm, closing=RangeThreshold(0.25))  # far above the object
    assert done.outcome is GraspOutcome.EMPTY
    assert done.width == SHUT
    np.testing.assert_array_equal(arm.camera_pose().as_matrix(), done.closed_at.as_matrix())
    check_grasp(done)


def test_what_is_gone_from_the_fingers_after_the_lift_has_slipped():
    arm = above(SMALL)
    plain = PlainGripper(arm)
    drops = FaultyGripper(plain, width=lambda gripper: SHUT if plain.ahead() > 0.12 else plain.width)
    done = grasp(arm, drops)
    assert done.outcome is GraspOutcome.SLIPPED
    assert done.width == plain.thickness
    check_grasp(done)


def lifts_not(reason=StopReason.UNREACHABLE, **options):
    """An arm that goes down and not straight up, and its grasp."""
    arm = above(SMALL)
    descents = len(grasp(arm).readings) - 1
    arm = Hindered(above(SMALL), stops={descents: reason}, **options)
    return arm, grasp(arm, PlainGripper(arm))


def test_where_the_arm_cannot_go_straight_up_it_goes_back_the_way_it_came():
    arm, done = lifts_not()
    assert done.outcome is GraspOutcome.HELD
    assert arm.returns == len(done.readings) - 1
    np.testing.assert_allclose(arm.camera_pose().translation, (0, 0, 0.25), atol=1e-6)


def test_an_arm_that_cannot_go_back_either_says_why():
    _, done = lifts_not(frozen=lambda arm: arm.returns > 2)
    assert done.outcome is GraspOutcome.COLLISION
    check_grasp(done)


def test_a_grasp_that_could_not_be_lifted_at_all_is_not_held():
    # The rule says to close at once, so that there is no way back.
    arm = Hindered(above(SMALL, height=0.05), stops={0: StopReason.UNREACHABLE})
    assert grasp(arm, PlainGripper(arm), closing=After(0)).outcome is GraspOutcome.UNREACHABLE


def test_a_finger_that_touches_down_ends_the_descent_and_the_rule_may_still_close():
    arm = Hindered(above(SMALL), stops={45: StopReason.CONTACT})
    done = grasp(arm, PlainGripper(arm), closing=SizedDepth(), step=0.004)
    assert done.landed
    assert [reading.landed for reading in done.readings] == [False] * 46 + [True]
    assert done.outcome is GraspOutcome.HELD
    check_grasp(done)


def test_after_a_touch_a_sensor_that_never_agrees_is_asked_twenty_times():
    arm = Hindered(above(SMALL), stops={5: StopReason.CONTACT})
    done = grasp(arm)
    assert done.outcome is GraspOutcome.NEVER_CLOSED
    assert done.landed
    assert sum(reading.landed for reading in done.readings) == 20
    check_grasp(done)


def test_every_outcome_of_the_arm_has_its_name():
    for reason in StopReason:
        assert reason is StopReason.REACHED or GraspOutcome(reason.value)


# What it asks of arm and gripper


def test_an_arm_and_a_gripper_are_asked_for_what_their_protocols_have_and_for_nothing_else():
    arm_asked, gripper_asked = set(), set()
    plain = above(SMALL, off=(40, 0))
    arm, gripper = Asked(plain, arm_asked), Asked(PlainGripper(plain), gripper_asked)
    assert grasp(arm, gripper, closing=SizedDepth(), realign=True).outcome is GraspOutcome.HELD
    for asked, protocol in ((arm_asked, EyeInHandArm), (gripper_asked, Gripper)):
        assert asked <= {name for name in vars(protocol) if not name.startswith("_")}
    assert {"open", "close", "range", "width", "stroke", "hand"} == gripper_asked
    assert "rotate_wrist" not in arm_asked


def test_plain_hands_satisfy_the_protocols():
    arm = above(SMALL)
    assert isinstance(arm, EyeInHandArm)
    assert isinstance(PlainGripper(arm), Gripper)
    assert isinstance(FaultyGripper(PlainGripper(arm)), Gripper)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"closing": 0.10}, r"a closing rule has a method remaining\(readings, hand\), as RangeThreshold\(\) and"),
        ({"recenter": "sliding"}, r'recenter is "turning", "shifting" or None; got \'sliding\''),
        ({"step": 0.0}, r"a step of the descent is at most 0\.01 m; got 0\.0"),
        ({"step": 0.011}, r"a step of the descent is at most 0\.01 m; got 0\.011"),
        ({"step": np.nan}, r"a step of the descent is at most 0\.01 m; got nan"),
        ({"threshold": -1.0}, r"GraspExecutor\.threshold is positive; got -1\.0"),
        ({"distance": np.inf}, r"GraspExecutor\.distance is positive; got inf"),
        ({"limit": 0.0}, r"GraspExecutor\.limit is positive; got 0\.0"),
    ],
)
def test_a_bad_option_is_refused_and_the_error_says_what_would_do(options, text):
    with pytest.raises(InvalidParameterError, match=text):
        GraspExecutor(white, **options)


def test_a_segmenter_that_is_none_is_refused():
    arm = above(SMALL)
    with pytest.raises(InvalidParameterError, match="a segmenter is called with an RGB image"):
        GraspExecutor(OBJECTS).grasp(arm, PlainGripper(arm))
