"""Completing a grasp, without a simulator: what it does on the way down, and every way in which it can end."""

from dataclasses import replace

import numpy as np
import pytest
from eye_in_hand import CAMERA, Ball, Hindered, PinholeArm, Plate, white
from hands import DOWN, HAND, SHUT, WIDE, Asked, FaultyGripper, Never, PlainGripper, above, check_grasp, descent, sensed
from scipy.spatial.transform import RigidTransform, Rotation
from synthetic import arcs_of_solid, cross_of_viewpoints

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arm import EyeInHandArm, Gripper, Hand, StopReason
from gvp_lib.motion.sighting import Eye
from gvp_lib.perception.moments import Blob
from gvp_lib.perception.tracking import Tracker
from gvp_lib.planning.grasp import ClosingRule, GraspExecutor, GraspOutcome, RangeThreshold, Reading, SizedDepth
from gvp_lib.planning.plan import Finding, Optimum, Plan, PlanOutcome
from gvp_lib.planning.silhouette import SilhouetteFit
from gvp_lib.planning.solids import BOX, FittedSolid
from gvp_lib.simulation.objects import OBJECTS
from gvp_lib.simulation.sensors import Noise

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


# When the fingers close


AHEAD = 0.100  # m, from the camera to the surface, where a descent has come to
INF = float("inf")
BRICK = (0.064, 0.032, 0.019)
SCATTERED = Noise(range_sd=0.005, range_dropout=0.05, range_spike=0.02)  # the thesis's, but for the bias


def solid(sizes=BRICK, top=(0.0, 0.0), normal=(0, 0, 1), center=(0, 0, 0), turn=None, kind="box", residual=0.05):
    """A solid whose normal is given in its own frame."""
    pose = RigidTransform.from_components(center, turn or Rotation.identity())
    outward = pose.rotation.apply(np.array(normal, float))
    return FittedSolid(kind, pose, np.array(sizes), top, outward, 0.01, residual, np.zeros((0, 6)))


def below(surface, height=0.019):
    """A level solid under a camera at the origin that looks down: its surface ``surface`` m ahead."""
    return solid((0.064, 0.032, height), center=(0, 0, -surface - height / 2))


def seen(n, ahead=AHEAD, step=0.005):
    """What a perfect sensor says on a descent of ``n`` increments."""
    return [ahead + (n - 1 - k) * step - HAND.sensor for k in range(n)]


# The thesis's threshold


def test_the_threshold_closes_at_the_first_reading_below_ten_centimeters_and_cannot_tell_before():
    rule, readings = RangeThreshold(), descent(INF, 0.15, 0.11, 0.1001, 0.0999, 0.11)
    told = [rule.remaining(readings[: k + 1], HAND) for k in range(len(readings))]
    assert told == [INF, INF, INF, INF, 0.0, INF]


def test_the_threshold_is_the_distance_itself_and_is_an_option():
    assert RangeThreshold().remaining(descent(0.10), HAND) == INF
    assert RangeThreshold(0.12).remaining(descent(0.11), HAND) == 0


def test_one_false_reading_makes_the_threshold_close():
    # 25 cm from the surface, of which the sensor says 4 once: what 3.1.7 blames for grasps that failed.
    readings = descent(0.30, 0.295, 0.04)
    assert RangeThreshold().remaining(readings, HAND) == 0
    assert SizedDepth().remaining(readings, HAND) == INF


def test_a_dropout_below_the_threshold_puts_it_off():
    assert RangeThreshold().remaining(descent(0.11, INF), HAND) == INF


# How far the surface is


def test_without_a_solid_there_is_no_decision_before_eight_readings():
    for n in range(1, 12):
        told = SizedDepth().remaining(descent(*seen(n)), HAND)
        assert np.isfinite(told) is np.bool_(n >= 8)


def test_readings_that_saw_nothing_are_none_of_the_eight():
    readings = seen(11)
    readings[2] = readings[5] = readings[8] = INF
    assert SizedDepth().surface(descent(*readings[:10]), HAND) == INF
    assert SizedDepth().surface(descent(*readings), HAND) == pytest.approx(AHEAD)


def test_before_eight_readings_the_solid_alone_tells():
    readings = descent(*seen(7, ahead=AHEAD + 0.01))
    assert SizedDepth(below(AHEAD)).surface(readings, HAND) == pytest.approx(AHEAD)


def test_dropouts_spikes_and_scatter_hardly_count():
    # The mean of the readings that are finite, or the last of them, is off by several times as much.
    off = {"median": [], "mean": [], "last": []}
    for seed in range(200):
        distances = sensed(SCATTERED, seed, AHEAD)
        off["median"].append(SizedDepth().surface(descent(*distances), HAND) - AHEAD)
        carried = np.array(distances) - np.array(seen(30))
        carried = carried[np.isfinite(carried)]
        off["mean"].append(carried.mean())
        off["last"].append(carried[-1])
    rms = {name: 1000 * float(np.sqrt(np.mean(np.square(values)))) for name, values in off.items()}
    assert rms["median"] < 1.5
    assert np.percentile(np.abs(off["median"]), 95) < 0.003
    assert abs(np.mean(off["median"])) < 0.0005
    assert rms["mean"] > 2 * rms["median"]
    assert rms["last"] > 4 * rms["median"]


def test_a_bias_that_all_readings_share_is_left_without_a_solid():
    distances = np.array(seen(20)) + 0.004
    assert SizedDepth().surface(descent(*distances), HAND) == pytest.approx(AHEAD + 0.004)


@pytest.mark.parametrize("facing", [DOWN, DOWN * Rotation.from_rotvec([0.5, 0.2, 1.0])], ids=["down", "oblique"])
@pytest.mark.parametrize("step", [0.002, 0.005, 0.020])
@pytest.mark.parametrize("aside", [0.0, 0.003])
def test_readings_are_carried_along_with_the_hand(facing, step, aside):
    # Steps across the lens, as of a hand that keeps the object in the middle, leave a surface across it where it is.
    readings = descent(*seen(9, step=step), step=step, facing=facing, aside=aside)
    assert SizedDepth().surface(readings, HAND) == pytest.approx(AHEAD, abs=1e-9)


def test_a_hand_that_stays_is_told_the_same_of_all_its_readings():
    pose = RigidTransform.from_rotation(DOWN)
    readings = [Reading(pose, AHEAD - HAND.sensor)] * 9
    assert SizedDepth().surface(readings, HAND) == pytest.approx(AHEAD)


def test_the_solid_is_seen_from_where_the_hand_is():
    brick = below(0.15)
    start = descent(INF, INF, step=0.03)
    assert SizedDepth(brick).surface(start[:1], HAND) == pytest.approx(0.18)
    assert SizedDepth(brick).surface(start, HAND) == pytest.approx(0.15)


# Two witnesses


def test_solid_and_sensor_are_weighted_by_their_variances():
    readings = descent(*seen(20, ahead=AHEAD + 0.010))  # without scatter
    for solid_sd, sensor_sd, weight in ((0.006, 0.003, 0.8), (0.003, 0.003, 0.5), (0.003, 0.006, 0.2)):
        rule = SizedDepth(below(AHEAD), solid_sd=solid_sd, sensor_sd=sensor_sd)
        assert rule.surface(readings, HAND) - AHEAD == pytest.approx(0.010 * weight)


def test_readings_that_scatter_are_trusted_less_the_fewer_they_are():
    told = []
    for n in (8, 32):
        distances = np.array(seen(n, ahead=AHEAD + 0.010)) + 0.020 * (-1.0) ** np.arange(n)
        told.append(SizedDepth(below(AHEAD)).surface(descent(*distances), HAND) - AHEAD)
    assert 0 < told[0] < told[1] < 0.008


def test_a_sensor_that_looks_past_the_object_is_not_heard():
    rule = SizedDepth(below(AHEAD))
    for past, heard in ((0.024, True), (0.026, False), (0.10, False)):
        told = rule.surface(descent(*seen(12, ahead=AHEAD + past)), HAND)
        assert told == pytest.approx(AHEAD + (0.8 * past if heard else 0.0))


def test_a_sensor_that_sees_something_nearer_is_heard_however_near():
    rule = SizedDepth(below(AHEAD + 0.04))
    assert rule.surface(descent(*seen(12, ahead=AHEAD)), HAND) == pytest.approx(AHEAD + 0.2 * 0.04)


# How deep


@pytest.mark.parametrize(("height", "depth"), [(0.020, 0.013), (0.0615, 0.039975), (0.062, 0.040), (0.150, 0.040)])
def test_the_tips_go_down_two_thirds_of_the_height_and_at_most_their_reach(height, depth):
    rule = SizedDepth(below(AHEAD, height))
    assert rule.depth == pytest.approx(depth)
    assert rule.remaining(descent(INF), HAND) == pytest.approx(AHEAD + depth - HAND.tips)


def test_of_an_unknown_object_the_tips_go_as_deep_as_the_thesiss_ten_centimeters_take_them():
    # Where the sensor says 0.10 m, the surface is 0.058 m ahead of the camera and the tips are 20 mm below it.
    assert SizedDepth().remaining(descent(*seen(9, ahead=0.10 + HAND.sensor)), HAND) == pytest.approx(0, abs=1e-9)


def test_the_palm_never_comes_nearer_than_two_millimeters():
    tall = below(AHEAD, 0.15)
    for palm in (0.0, 0.036, 0.050):
        hand = Hand(HAND.sensor, HAND.tips, palm)
        left = AHEAD - SizedDepth(tall).remaining(descent(INF), hand)  # between camera and surface, at the end
        assert left == pytest.approx(max(0.038, palm + 0.002))


def test_where_a_finger_has_landed_the_fingers_close_at_once():
    for rule in (SizedDepth(), SizedDepth(below(AHEAD))):
        assert rule.remaining(descent(INF, landed=True), HAND) == 0
    assert RangeThreshold().remaining(descent(INF, landed=True), HAND) == INF  # the thesis's knows nothing of it


def test_past_the_depth_there_is_less_than_nothing_to_go():
    assert SizedDepth().remaining(descent(*seen(9, ahead=0.05)), HAND) < 0


# Of a plan


def plan(*details):
    optima = tuple(Optimum(Finding.OPTIMUM, detail=detail) for detail in details)
    return Plan(PlanOutcome.ALIGNED, (), optima, None, 0)


def test_a_plans_last_solid_is_taken_where_it_explains_what_was_seen():
    good, better, bad = solid(residual=0.03), solid(residual=0.14), solid(residual=0.3)
    assert SizedDepth.of(plan(good, better)).solid is better
    assert SizedDepth.of(plan(good, bad)).solid is None
    assert SizedDepth.of(plan(bad, good)).solid is good
    assert SizedDepth.of(plan(good, None)).solid is good


@pytest.mark.parametrize(("limit", "residual", "heard"), [(0.1, 0.15, False), (0.25, 0.15, True), (0.9, 0.6, True)])
def test_whether_a_solid_explains_the_views_is_for_the_fit_that_found_it_to_say(limit, residual, heard):
    level = RigidTransform.identity()
    arcs = arcs_of_solid(BOX, level, (*BRICK, 0.0, 0.0), cross_of_viewpoints(np.zeros(3), tilt=0.3, n=5))
    found = SilhouetteFit(explained=limit).estimate(arcs, CAMERA).detail
    rough = replace(found, residual=residual)
    assert (SizedDepth.of(plan(rough)).solid is rough) is heard


def test_a_plan_without_a_solid_leaves_an_object_of_unknown_height():
    for given in (plan(), plan("a quartic's"), plan(None, None)):
        rule = SizedDepth.of(given)
        assert rule == SizedDepth()
        assert rule.depth == rule.unknown_depth == 0.020


# What is asked of a rule


def test_both_are_closing_rules_and_a_number_is_not():
    assert isinstance(RangeThreshold(), ClosingRule)
    assert isinstance(SizedDepth(), ClosingRule)
    assert not isinstance(0.10, ClosingRule)


@pytest.mark.parametrize("name", ["reach", "share", "unknown_depth", "solid_sd", "sensor_sd", "gate"])
@pytest.mark.parametrize("value", [0.0, -0.01, INF, float("nan")])
def test_a_length_that_is_none_is_refused_by_name(name, value):
    with pytest.raises(InvalidParameterError, match=rf"SizedDepth\.{name} is positive; got {value}"):
        SizedDepth(**{name: value})


@pytest.mark.parametrize("value", [0.0, -0.1, INF, float("nan")])
def test_a_threshold_that_is_none_is_refused(value):
    with pytest.raises(InvalidParameterError, match=f"a range threshold is positive; got {value}"):
        RangeThreshold(value)


# The solid's height and surface


@pytest.mark.parametrize(
    ("normal", "height"), [((0, 0, 1), 0.023), ((0, 0, -1), 0.023), ((1, 0, 0), 0.064), ((0, -1, 0), 0.032)]
)
@pytest.mark.parametrize("turn", [Rotation.identity(), Rotation.from_rotvec([0.4, -0.9, 0.3])], ids=["level", "turned"])
def test_a_boxs_height_is_that_of_the_face_looked_at_with_the_studs_where_they_stand_on_it(normal, height, turn):
    brick = solid(top=(0.004, 0.004), normal=normal, center=(0.3, -0.1, 0.2), turn=turn)
    assert brick.height == pytest.approx(height)
    face = brick.base_from_solid.apply(np.array(normal) * height / 2)
    over = RigidTransform.from_components(face, Rotation.align_vectors([-brick.normal], [[0.0, 0.0, 1.0]])[0])
    camera = over * RigidTransform.from_translation([0.0, 0.0, -0.25])
    assert brick.surface_from(camera) == pytest.approx(0.25)


def test_the_surface_is_measured_along_the_lens_and_a_step_across_it_changes_nothing():
    brick = below(0.25)
    here = RigidTransform.from_rotation(DOWN)
    assert brick.surface_from(here) == pytest.approx(0.25)
    assert brick.surface_from(here * RigidTransform.from_translation([0.05, -0.02, 0.0])) == pytest.approx(0.25)
    assert brick.surface_from(here * RigidTransform.from_translation([0.0, 0.0, 0.1])) == pytest.approx(0.15)


@pytest.mark.parametrize("around", np.radians([0, 30, 45, 100]))
def test_a_lying_cans_height_is_its_diameter_and_a_standing_ones_its_length(around):
    can = {"sizes": (0.060, 0.060, 0.140), "top": (0.008, 0.010), "kind": "cylinder"}
    standing = solid(**can, center=(0, 0, -0.25 - 0.075))
    lying = solid(**can, normal=(np.cos(around), np.sin(around), 0))
    assert standing.height == pytest.approx(0.150)
    assert standing.surface_from(RigidTransform.from_rotation(DOWN)) == pytest.approx(0.25)
    assert lying.height == pytest.approx(0.060)
    facing, _ = Rotation.align_vectors([-lying.normal], [[0.0, 0.0, 1.0]])
    camera = RigidTransform.from_components(0.28 * lying.normal, facing)
    assert lying.surface_from(camera) == pytest.approx(0.25)
