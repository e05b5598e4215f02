"""When the fingers close: by the thesis's threshold, or at a depth that suits the object's size."""

from dataclasses import replace

import numpy as np
import pytest
from eye_in_hand import CAMERA
from hands import DOWN, HAND, descent, sensed
from scipy.spatial.transform import RigidTransform, Rotation
from synthetic import arcs_of_solid, cross_of_viewpoints

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arm import Hand
from gvp_lib.planning.closing import ClosingRule, RangeThreshold, Reading, SizedDepth
from gvp_lib.planning.optimum import Finding, Optimum
from gvp_lib.planning.plan import Plan, PlanOutcome
from gvp_lib.planning.silhouette import FittedSolid, SilhouetteFit
from gvp_lib.planning.solids import BOX
from gvp_lib.simulation.sensors import Noise

pytestmark = pytest.mark.check

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
