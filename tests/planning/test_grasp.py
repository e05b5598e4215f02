"""Completing a grasp, without a simulator: what it does on the way down, and every way in which it can end.

What the thesis itself says of it stands in ``tests/thesis/test_grasp_completion.py``.
"""

from dataclasses import replace

import numpy as np
import pytest
from eye_in_hand import CAMERA, Ball, Hindered, PinholeArm, Plate, white
from hands import DOWN, HAND, REACH, SHUT, WIDE, After, PlainGripper, above, check_grasp, descent, fitted
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arm import STOPS, Hand, Outcome
from gvp_lib.motion.sighting import Eye
from gvp_lib.perception.blobs import Blob, Tracker
from gvp_lib.planning.closing import RangeThreshold, SizedDepth
from gvp_lib.planning.grasp import GraspExecutor
from gvp_lib.planning.grips import Grip
from gvp_lib.planning.plan import Optimum, Plan
from gvp_lib.simulation.sensors import EpisodeNoise, Noise

pytestmark = pytest.mark.check

SMALL = Plate(sides=(0.020, 0.032))  # m; in full view until the fingers close
CENTER = CAMERA.principal_point
INF = float("inf")


def grasp(arm, gripper=None, segmenter=white, **options):
    done = GraspExecutor.thesis(segmenter, **options).grasp(arm, gripper or PlainGripper(arm))
    check_grasp(done)
    return done


def offsets(arm, **options):
    """From the middle to the object in each picture, px; and the grasp."""
    found = []

    def watching(rgb):
        mask = white(rgb)
        found.append(Blob.from_mask(mask).centroid - CENTER)
        return mask

    done = grasp(arm, segmenter=watching, **options)
    return np.abs(found).max(axis=1), done


# On the way down


def test_a_lift_is_straight_up_however_the_hand_leans():
    arm = PinholeArm(Ball(), tilt=0.4, azimuth=2.0)
    done = grasp(arm)
    assert done.outcome is Outcome.HELD
    np.testing.assert_allclose(arm.camera_pose().translation - done.closed_at.translation, (0, 0, 0.10), atol=1e-6)
    assert (arm.camera_pose().rotation.inv() * done.closed_at.rotation).magnitude() < 1e-6


def test_the_last_increment_is_cut_short_where_there_is_less_to_go():
    done = grasp(above(SMALL), closing=SizedDepth(), step=0.007)
    assert done.outcome is Outcome.HELD
    heights = np.array([reading.base_from_camera.translation[2] for reading in done.readings])
    np.testing.assert_allclose([reading.distance for reading in done.readings], heights - HAND.sensor, atol=1e-9)
    assert -np.diff(heights).min() == pytest.approx(0.007)
    assert 0 < -np.diff(heights)[-1] <= 0.007
    assert heights[-1] == pytest.approx(HAND.tips - 0.020, abs=0.0005)  # 20 mm below the surface


def test_a_shift_brings_the_object_to_the_middle_and_keeps_the_direction_of_view():
    arm = above(SMALL, off=(50, -40))
    before = arm.camera_pose().rotation
    found, done = offsets(arm, recenter="shifting")
    assert done.outcome is Outcome.HELD
    assert len(found) > 20
    assert found[0] > 45
    assert found[1] < 6  # the distance is known only roughly
    assert found[4:].max() < 4
    assert (before.inv() * arm.camera_pose().rotation).magnitude() < 1e-8


@pytest.mark.parametrize(
    ("options", "left"), [({"threshold": 20.0}, False), ({"threshold": 40.0}, True), ({"recenter": None}, True)]
)
def test_an_offset_within_the_threshold_is_left_alone_and_without_recentering_any(options, left):
    found, _ = offsets(above(SMALL, height=0.2, off=(25, 0)), **options)
    assert bool(found[1] > 20) is left


def test_an_object_at_the_border_is_followed_no_further_and_no_longer_looked_at():
    found, done = offsets(above(Plate(sides=(0.020, 0.090))))  # out of the picture from 0.1 m on
    assert done.outcome is Outcome.HELD
    assert done.view.clipped
    assert done.frames == len(found) < len(done.readings)
    assert done.view.base_from_camera.translation[2] == pytest.approx(0.09 * CAMERA.fy / CAMERA.height, abs=0.006)
    # One that is there to begin with is not followed at all.
    arm = above(SMALL, height=0.14, off=(290, 0))
    before = arm.camera_pose()
    done = grasp(arm)
    assert (done.view.clipped, done.frames) == (True, 1)
    np.testing.assert_allclose((before.inv() * done.closed_at).as_matrix()[:, :2], np.eye(4)[:, :2], atol=1e-9)


@pytest.mark.parametrize("of_the_plan", [True, False])
def test_of_two_objects_of_one_color_the_plans_is_the_target_and_without_a_plan_the_one_nearest_the_middle(of_the_plan):
    arm = above(Plate((0.04, 0.0, 0.0), SMALL.sides), Plate((-0.03, 0.0, 0.0), SMALL.sides))
    plan = Plan(Outcome.ALIGNED, view=Eye(arm, Tracker(white, CENTER + (85, 0))).look())
    done = GraspExecutor(white).grasp(arm, PlainGripper(arm), plan if of_the_plan else None)
    assert done.outcome is Outcome.HELD
    assert done.closed_at.translation[0] == pytest.approx(0.04 if of_the_plan else -0.03, abs=0.002)


# Every way to end


BARRED = {39: Outcome.UNREACHABLE}  # the lift


def over(sides=SMALL.sides, height=0.25, off=(0.0, 0.0), **hindrance):
    return lambda: Hindered(above(Plate(sides=sides), height=height, off=off), **hindrance)


@pytest.mark.parametrize(
    ("make", "faults", "options", "outcome", "readings"),
    [
        # Nothing moves without an object, or for one that the open fingers cannot span.
        (over(off=(0, 3000)), {}, {}, "target not found", 0),
        (over((0.080, 0.115)), {}, {}, "too wide", 0),
        (over((0.065, 0.115)), {}, {}, "held", 40),
        # A sensor that sees nothing does not make the object too wide.
        (over((0.06, 0.08)), {"range": lambda: INF}, {"closing": After(40)}, "held", 41),
        (over(blind=lambda arm: arm.frames > 5), {}, {}, "target lost", 5),
        *((over(stops={3: reason}), {}, {}, reason, 4) for reason in STOPS if reason is not Outcome.CONTACT),
        (over(height=0.4), {}, {"closing": After(INF), "limit": 0.10}, "never closed", 21),
        # After a touch the hand stays. The rule may still close; a sensor that never agrees is asked twenty times.
        (over(stops={45: Outcome.CONTACT}), {}, {"closing": SizedDepth(), "step": 0.004}, "held", 47),
        (over(stops={5: Outcome.CONTACT}), {}, {}, "never closed", 6 + 20),
        (over(), {"close": lambda: None}, {}, "jammed", 40),
        (over(), {"thickness": WIDE - 0.002}, {}, "held", 40),  # all but as wide as the open fingers
        (over(), {}, {"closing": RangeThreshold(0.25)}, "closed on nothing", 10),  # far above the object
        # Where the arm cannot go straight up it goes back the way it came, or says why not.
        (over(stops=BARRED), {}, {}, "held", 40),
        (over(stops=BARRED, frozen=lambda arm: arm.returns > 2), {}, {}, "collision", 40),
        (over(height=0.05, stops={0: Outcome.UNREACHABLE}), {}, {"closing": After(0)}, "unreachable", 1),
    ],
)
def test_a_grasp_ends_with_its_outcome_and_the_readings_so_far(make, faults, options, outcome, readings):
    arm = make()
    gripper = PlainGripper(arm)
    vars(gripper).update(faults)
    done = grasp(arm, gripper, **options)
    assert (done.outcome, len(done.readings)) == (outcome, readings)
    assert (done.view is None) is (outcome == "target not found")
    if readings == 0:
        assert arm.motions == 0
    elif done.closed_at is None:
        assert gripper.told == ["open"]
    elif outcome == "jammed":
        assert done.width == WIDE
    elif outcome == "closed on nothing":
        assert done.width == SHUT
        np.testing.assert_array_equal(arm.camera_pose().as_matrix(), done.closed_at.as_matrix())  # nothing is lifted
    elif outcome == "held" and arm.returns:
        assert arm.returns == readings - 1
        np.testing.assert_allclose(arm.camera_pose().translation, (0, 0, 0.25), atol=1e-6)


@pytest.mark.parametrize(
    ("sides", "width", "residual", "outcome"),
    [
        (SMALL.sides, 0.080, 0.05, "too wide"),  # hidden, cut off, or wider below
        ((0.080, 0.115), 0.040, 0.05, "held"),  # something of its color beside it
        ((0.080, 0.115), 0.040, 9.0, "too wide"),
        (SMALL.sides, 0.080, 9.0, "held"),
    ],
)
def test_too_wide_is_told_by_the_solid_where_one_explains_what_was_seen_and_else_by_the_blob(
    sides, width, residual, outcome
):
    arm = Hindered(above(Plate(sides=sides)))
    solid = fitted((width, 0.115, 0.030), center=(0, 0, -0.015), residual=residual)
    plan = Plan(Outcome.ALIGNED, optima=(Optimum(Outcome.ALIGNED, solid=solid),))
    done = GraspExecutor(white).grasp(arm, PlainGripper(arm), plan)
    check_grasp(done)
    assert done.outcome == outcome
    assert (arm.motions == 0) is (outcome == "too wide")


# What the object stands on


@pytest.mark.parametrize("support", ["a table", (0.0, 0.1), [[0, 0, 0], [0, 0, -1]], np.nan, [[0, 0, 0]]])
def test_a_support_that_is_no_plane_is_refused(support):
    with pytest.raises(InvalidParameterError, match=r"support is a height in the arm's base frame, m, or a point and"):
        GraspExecutor(white, support=support)


def test_a_plane_may_be_an_array_and_is_told():
    executor = GraspExecutor(white, support=np.array([(0.5, 0.0, 0.1), (0.0, 0.0, 1.0)]))
    assert executor == GraspExecutor(white, support=[[0.5, 0, 0.1], [0, 0, 1]])
    assert repr(executor) == "GraspExecutor(segmenter=white, support=((0.5, 0, 0.1), (0, 0, 1)))"


@pytest.mark.parametrize(
    ("support", "tips"),
    [
        (None, -0.013),  # two thirds of its height
        (-0.009, -0.007),  # 2 mm above the plane
        ([(0.3, 0.2, -0.009), (0, 0, 2)], -0.007),
        ([(0, 0, -0.040), (0.5, 0, 1)], -0.013),
    ],
)
def test_fingers_do_not_cross_a_plane_that_the_user_knows(support, tips):
    arm = above(SMALL)
    plan = Plan(Outcome.ALIGNED, optima=(Optimum(Outcome.ALIGNED, solid=below(0.0, height=0.020)),))
    done = GraspExecutor(white, support=support).grasp(arm, PlainGripper(arm), plan)
    assert (done.outcome, done.landed, done.lean) == (Outcome.HELD, False, 0.0)
    assert done.closed_at.translation[2] - HAND.tips == pytest.approx(tips, abs=0.001)


def leaning(stops, frozen=lambda arm: False, beneath=0.0):
    """A grasp 35 deg off the vertical, the fingers across the slope, of a brick that leans as much; and its turn."""
    facing = DOWN * Rotation.from_rotvec([0.0, np.radians(35), 0.0])
    arm = PinholeArm(SMALL)
    arm.stand_at(RigidTransform.from_components(facing.apply([0.0, 0.0, -0.25]), facing))
    center = facing.apply([0.0, 0.0, 0.010]) - (0.0, 0.0, beneath)  # its surface is at the origin
    solid = fitted((0.032, 0.064, 0.020), center=center, turn=facing, normal=(0, 0, -1))
    plan = Plan(Outcome.ALIGNED, optima=(Optimum(Outcome.ALIGNED, solid=solid),))
    done = GraspExecutor(white).grasp(Hindered(arm, stops=stops, frozen=frozen), PlainGripper(arm), plan)
    check_grasp(done)
    return done, facing


TOUCH = {33: Outcome.CONTACT}  # the tips are 4.5 mm above the surface, but the lower one is 17 mm below it


def test_a_hand_that_lands_and_closes_on_nothing_leans_back_across_its_fingers_by_no_more_than_they_need():
    done, facing = leaning(TOUCH)
    assert (done.outcome, done.landed) == (Outcome.HELD, False)
    assert 15 < np.degrees(done.lean) < 25
    assert f"leaned back {np.degrees(done.lean):.0f} deg" in repr(done)
    turned = facing.inv() * done.closed_at.rotation
    np.testing.assert_allclose(turned.as_rotvec(), [0.0, -done.lean, 0.0], atol=1e-6)  # still square to the faces
    tips = done.closed_at.apply([[side * 0.5 * WIDE, 0.0, HAND.tips] for side in (-1, 1)])
    assert tips[:, 2].min() == pytest.approx(-0.0170 + 0.002, abs=0.0008)
    # No more degrees than half of the rule's depth takes.
    assert done.closed_at.rotation.as_matrix()[:, 2] @ tips.mean(axis=0) == pytest.approx(0.0065, abs=0.002)


@pytest.mark.parametrize(
    ("stops", "options", "outcome", "landed"),
    [
        ({34: Outcome.CONTACT}, {}, "held", True),  # deep enough to hold
        (TOUCH, {"beneath": 0.030}, "held", False),  # on something beside it, of which it is clear after a quarter turn
        (TOUCH | {34: Outcome.UNREACHABLE}, {"frozen": lambda arm: arm.returns > 34}, "collision", True),
        (TOUCH | {34: Outcome.UNREACHABLE}, {}, "held", False),  # it cannot lean, and nothing is in its way any more
        (TOUCH, {"frozen": lambda arm: arm.returns > 3}, "collision", True),  # it cannot go back
    ],
)
def test_a_hand_that_holds_already_or_has_touched_something_else_stays_as_it_is(stops, options, outcome, landed):
    done, _ = leaning(stops, **options)
    assert (done.outcome, done.landed, done.lean) == (outcome, landed, 0.0)


class Necked(PlainGripper):
    """A hand over a bottle: too narrow for its fingers down to 50 mm below the top, and then 60 mm wide."""

    def close(self):
        super().close()
        deep = self.hand.tips - self.ahead() > 0.050
        self.width = 0.060 if deep else SHUT


@pytest.mark.parametrize(
    ("palm", "limit", "outcome"),
    [(0.0, 0.30, "held"), (0.045, 0.30, "closed on nothing"), (0.0, 0.21, "closed on nothing")],
)
def test_a_hand_that_closes_on_nothing_and_touched_nothing_goes_deeper_as_far_as_palm_and_limit_let_it(
    palm, limit, outcome
):
    arm = above(SMALL)
    gripper = Necked(arm)
    gripper.hand = replace(HAND, palm=palm)
    done = GraspExecutor(white, limit=limit).grasp(arm, gripper)
    assert done.outcome == outcome
    assert gripper.told.count("close") == {"held": 4, "closed on nothing": 1 if palm else 2}[outcome]
    assert 0.25 - arm.camera_pose().translation[2] + 0.10 * (outcome == "held") <= limit
    check_grasp(done)
    # Somebody's own rule, and the thesis's, close once.
    gripper = Necked(arm := above(SMALL))
    assert grasp(arm, gripper).outcome is Outcome.EMPTY
    assert gripper.told.count("close") == 1


@pytest.mark.parametrize("stops", [{30: Outcome.CONTACT}, {}])
def test_a_hand_that_landed_beside_its_grip_goes_to_the_next_one(stops):
    arm = above(SMALL)
    grips = [
        Grip(np.array([x, 0.0, -0.010]), np.eye(3)[2], np.array(closing), 0.030, 0.020, 1.0)
        for x, closing in ((0.005, (1.0, 0.0, 0.0)), (-0.005, (0.0, 1.0, 0.0)))
    ]
    plan = Plan(Outcome.UNEXPLAINED, optima=(Optimum(Outcome.UNEXPLAINED, solid=below(0.0), grips=tuple(grips)),))
    arm.move_camera(arm.camera_pose().inv() * grips[0].view(0.25))
    done = GraspExecutor(white).grasp(Hindered(arm, stops=stops), PlainGripper(arm), plan)
    assert done.outcome is Outcome.HELD
    middle = done.closed_at.apply([0.0, 0.0, HAND.tips])
    np.testing.assert_allclose(middle, (-0.005 if stops else 0.005, 0.0, -0.020), atol=0.001)
    assert np.abs(done.closed_at.rotation.as_matrix()[:, 0] @ grips[bool(stops)].closing) > 0.999


@pytest.mark.parametrize(
    ("above_it", "deeper"), [(0.0, 0.0), (0.008, 0.008), (0.018, 0.012), (0.030, 0.015), (-0.01, 0.0)]
)
def test_a_hull_that_ends_above_what_the_sensor_sees_has_the_hand_go_deeper(above_it, deeper):
    arm = above(SMALL)  # whose surface is level with the origin
    surface = np.array([0.0, 0.0, above_it])
    grip = Grip(surface - [0, 0, 0.010], np.eye(3)[2], np.eye(3)[0], 0.030, 0.020, 1.0)
    plan = Plan(Outcome.UNEXPLAINED, optima=(Optimum(Outcome.UNEXPLAINED, solid=below(0.0), grips=(grip,)),))
    arm.move_camera(arm.camera_pose().inv() * grip.view(0.25))
    done = GraspExecutor(white).grasp(arm, PlainGripper(arm), plan)
    tips = done.closed_at.apply([0.0, 0.0, HAND.tips])
    np.testing.assert_allclose(tips, surface - [0, 0, 0.020 + deeper], atol=0.0015)


# When the fingers close


AHEAD = 0.100  # m, from the camera to the surface, where a descent has come to
BRICK = (0.064, 0.032, 0.019)


def below(surface, height=0.019):
    """A level solid under a camera at the origin that looks down: its surface ``surface`` m ahead."""
    return fitted((0.064, 0.032, height), center=(0, 0, -surface - height / 2))


def seen(n, ahead=AHEAD, step=0.005):
    """What a perfect sensor says on a descent of ``n`` increments."""
    return [ahead + (n - 1 - k) * step - HAND.sensor for k in range(n)]


def surface(readings, **options):
    return SizedDepth(**options).surface(readings, HAND)


@pytest.mark.parametrize(
    ("distances", "remaining"),
    [
        ((INF, 0.1001), INF),
        ((0.0999, 0.10), INF),  # the last reading alone counts, and the threshold is the distance itself
        ((0.11, 0.0999), 0.0),
        ((0.30, 0.295, 0.04), 0.0),  # one false reading, 25 cm away: what 3.1.7 blames for grasps that failed
    ],
)
def test_the_threshold_closes_at_the_first_reading_below_it(distances, remaining):
    assert RangeThreshold().remaining(descent(*distances), HAND) == remaining


# How far the surface is


@pytest.mark.parametrize(("n", "alone", "fused"), [(7, INF, 0.100), (8, 0.110, 0.108)])
def test_before_eight_readings_that_saw_something_the_solid_alone_tells(n, alone, fused):
    readings = descent(INF, INF, *seen(n, ahead=AHEAD + 0.01))
    assert surface(readings) == pytest.approx(alone)
    assert surface(readings, solid=below(AHEAD)) == pytest.approx(fused)


def test_dropouts_spikes_and_scatter_hardly_count():
    # The mean of the finite readings is off by over twice as much, and the last of them by over four times.
    noise = Noise(range_sd=0.005, range_dropout=0.05, range_spike=0.02)  # the thesis's, but for the bias
    episodes = [EpisodeNoise(noise, 7, np.random.SeedSequence(seed)) for seed in range(200)]
    off = [surface(descent(*(episode.read(each, REACH) for each in seen(30)))) - AHEAD for episode in episodes]
    assert np.sqrt(np.mean(np.square(off))) < 0.0015
    assert np.percentile(np.abs(off), 95) < 0.003
    assert abs(np.mean(off)) < 0.0005


def test_readings_and_solid_are_carried_along_with_the_hand():
    # Steps across the lens, as of a hand that keeps the object in the middle, leave a surface across it where it is.
    oblique = DOWN * Rotation.from_rotvec([0.5, 0.2, 1.0])
    readings = descent(*seen(9, step=0.02), step=0.02, facing=oblique, aside=0.003)
    assert surface(readings) == pytest.approx(AHEAD, abs=1e-9)
    start = descent(INF, INF, step=0.03)
    assert [surface(start[:n], solid=below(0.15)) for n in (1, 2)] == pytest.approx([0.18, 0.15])


@pytest.mark.parametrize(
    ("off", "options", "weight"),
    [
        (0.010, {"solid_sd": 0.006, "sensor_sd": 0.003}, 0.8),
        (0.010, {"solid_sd": 0.003, "sensor_sd": 0.006}, 0.2),
        (0.024, {}, 0.8),
        (0.026, {}, 0.0),  # a sensor that looks past the object is ignored
        (-0.04, {}, 0.8),  # and one that sees something nearer isn't, however near
    ],
)
def test_solid_and_sensor_are_weighted_by_their_variances_unless_the_sensor_looks_past_the_object(off, options, weight):
    readings = descent(*seen(20, ahead=AHEAD + off))  # without scatter
    assert surface(readings, solid=below(AHEAD), **options) - AHEAD == pytest.approx(weight * off)


def test_readings_that_scatter_are_trusted_less_the_fewer_they_are():
    told = []
    for n in (8, 32):
        distances = np.array(seen(n, ahead=AHEAD + 0.010)) + 0.020 * (-1.0) ** np.arange(n)
        told.append(surface(descent(*distances), solid=below(AHEAD)) - AHEAD)
    assert 0 < told[0] < told[1] < 0.008


# How deep


@pytest.mark.parametrize(
    ("height", "palm", "depth"),
    [(0.020, 0.0, 0.013), (0.0615, 0.0, 0.039975), (0.150, 0.0, 0.040), (0.150, 0.036, 0.040), (0.150, 0.050, 0.026)],
)
def test_the_tips_go_down_two_thirds_of_the_height_and_at_most_their_reach_and_the_palm_keeps_off(height, palm, depth):
    left = SizedDepth(below(AHEAD, height)).remaining(descent(INF), Hand(HAND.sensor, HAND.tips, palm))
    assert left == pytest.approx(AHEAD + depth - HAND.tips)


def test_of_an_unknown_object_the_tips_go_as_deep_as_the_thesiss_ten_centimeters_take_them():
    # Where the sensor says 0.10 m, the surface is 0.058 m ahead of the camera and the tips are 20 mm below it.
    assert SizedDepth().remaining(descent(*seen(9, ahead=0.10 + HAND.sensor)), HAND) == pytest.approx(0, abs=1e-9)


def test_a_plans_last_solid_is_taken_where_it_explains_what_was_seen_by_the_measure_of_its_own_fit():
    def of(*solids):
        optima = tuple(Optimum(Outcome.ALIGNED, solid=solid) for solid in solids)
        return SizedDepth.of(Plan(Outcome.ALIGNED, (), optima, None, 0))

    good, better, bad = (fitted(BRICK, residual=residual) for residual in (0.03, 0.14, 0.3))
    lenient, strict = replace(bad, explained=0.9), replace(better, explained=0.1)
    for solids, solid in (((good, better), better), ((bad, good), good), ((good, None), good), ((lenient,), lenient)):
        assert of(*solids).solid is solid
    for none in (of(), of(None), of(good, bad), of(strict)):
        assert none == SizedDepth()  # for an object of unknown height
