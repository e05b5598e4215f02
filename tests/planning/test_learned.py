"""The learned planner's closed loop on an arm without a simulator, with policies that know the truth or fail."""

from itertools import cycle, islice

import numpy as np
import pytest
from eye_in_hand import CAMERA, Ball, Hindered, PinholeArm, white
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.motion.arm import StopReason
from gvp_lib.planning.learned import Action, CnnPlanner, Tilt, axes_after, fused
from gvp_lib.planning.plan import PlanOutcome

pytestmark = pytest.mark.check

RADIUS, STEP = 0.5, np.radians(5)
CENTERING = np.radians(0.5)  # rad: 2 px at a focal length of some 600 px, on either side of the last step, and u with v
SIGMA = np.radians(2)


def error_of(arm: PinholeArm) -> float:
    """Angle between the reversed optical axis and the base's z, which is the normal of what a pinhole arm draws."""
    x, y, z = -arm.camera_pose().rotation.as_matrix()[:, 2]
    return float(np.arctan2(np.hypot(x, y), z))


def true_tilt(arm: PinholeArm, sigma: float = SIGMA) -> Tilt:
    return Tilt.toward(arm.camera_pose().rotation.inv().apply([0.0, 0.0, 1.0]), sigma)


# --- the thesis's five actions ------------------------------------------------------------------------------


def test_the_policy_is_shown_the_whole_picture_with_the_object_in_the_middle():
    shown = []

    def policy(rgb):
        shown.append(rgb)
        return Action.NO_OP if len(shown) == 3 else Action.LEFT

    arm = PinholeArm(Ball(), radius=RADIUS, tilt=0.3)
    arm.move_camera(RigidTransform.from_rotation(Rotation.from_rotvec([0.1, -0.1, 0.0])))  # off the center
    CnnPlanner(white, policy).plan(arm)
    for rgb in shown:
        assert (rgb.shape, rgb.dtype) == ((480, 640, 3), np.uint8)
        np.testing.assert_allclose(np.argwhere(white(rgb)).mean(axis=0), [239.5, 319.5], atol=2)


def test_a_policy_that_never_ends_is_out_of_steps():
    arm = PinholeArm(radius=RADIUS)
    plan = CnnPlanner(white, lambda rgb: Action.UP, max_steps=4).plan(arm)
    assert (plan.outcome, len(plan.steps)) == (PlanOutcome.OUT_OF_STEPS, 4)
    assert not plan.outcome.arrived
    assert error_of(arm) == pytest.approx(4 * STEP, abs=CENTERING)
    np.testing.assert_array_equal(plan.view.joints, arm.joints)  # where the last action led


def test_a_swinging_policy_is_out_of_steps_unless_a_reversal_ends_it():
    for stop, outcome, steps in ((False, PlanOutcome.OUT_OF_STEPS, 10), (True, PlanOutcome.ALIGNED, 2)):
        swing = cycle([Action.UP, Action.DOWN])
        planner = CnnPlanner(white, lambda rgb, swing=swing: next(swing), max_steps=10, stop_at_reversal=stop)
        plan = planner.plan(PinholeArm(radius=RADIUS))
        assert (plan.outcome, len(plan.steps)) == (outcome, steps)
    assert plan.steps[-1].said is Action.DOWN  # said, and not done
    assert plan.steps[-1].motion is None


def test_a_turn_aside_and_the_same_action_again_are_no_reversal():
    said = iter([Action.UP, Action.UP, Action.LEFT, Action.DOWN, Action.NO_OP])
    plan = CnnPlanner(white, lambda rgb: next(said), stop_at_reversal=True).plan(PinholeArm(radius=RADIUS))
    assert len(plan.steps) == 5


# --- tilts --------------------------------------------------------------------------------------------------


def test_the_trace_tells_what_was_left_and_how_uncertain_that_was():
    arm = PinholeArm(Ball(), radius=RADIUS, tilt=0.5)
    plan = CnnPlanner(white, lambda rgb: true_tilt(arm), survey=0, max_move=np.radians(15)).plan(arm)
    assert plan.outcome is PlanOutcome.ALIGNED
    left = [step.left.angle for step in plan.steps]
    sigmas = [step.left.sigma for step in plan.steps]
    np.testing.assert_allclose(left, [0.5, 0.5 - np.radians(15), 0], atol=CENTERING)
    assert sigmas[0] == pytest.approx(np.hypot(SIGMA, 0.3 * 0.5), rel=0.02)  # what 0.5 rad may be short of
    assert sigmas[0] > sigmas[1] > sigmas[2] > SIGMA / np.sqrt(3)
    assert error_of(arm) < CENTERING


def test_without_a_survey_a_plan_ends_at_the_first_step_that_has_less_left_than_its_sigma():
    for tilt, sigma, looks in ((0.1, 0.2, 1), (0.1, 0.05, 2), (0.001, 0.05, 1)):
        arm = PinholeArm(radius=RADIUS, tilt=tilt)
        plan = CnnPlanner(white, lambda rgb, arm=arm, sigma=sigma: true_tilt(arm, sigma), survey=0).plan(arm)
        assert (plan.outcome, len(plan.steps)) == (PlanOutcome.ALIGNED, looks)


def test_a_policy_without_an_idea_moves_nothing_and_makes_nothing_forgotten():
    arm = PinholeArm(radius=RADIUS)
    said = iter([Tilt(0.2, 0.1, np.inf), Tilt(0.1, 0.0, 0.01), Tilt(0.0, 0.5, np.inf), Tilt(0.0, 0.2, 0.1)])
    first, second, third, fourth = islice(CnnPlanner(white, lambda rgb: next(said)).steps(arm), 4)
    assert (first.motion, first.left, first.outcome) == (None, None, None)
    assert second.left.angle == pytest.approx(0.1)
    assert third.left.angle < CENTERING  # as the second look had it
    assert fourth.left.angle == pytest.approx(0.2)  # an object that may move: the last look alone


def spread(n: int, tilt: float) -> np.ndarray:
    """Axes of n viewpoints about the base's z, shape (n, 3)."""
    azimuths = 2 * np.pi * np.arange(n) / n
    across = np.sin(tilt) * np.column_stack([np.cos(azimuths), np.sin(azimuths)])
    return np.column_stack([across, np.full(n, np.cos(tilt))])


def test_looks_of_one_axis_count_by_their_precision():
    z, other = np.array([0.0, 0.0, 1.0]), np.array([0.1, 0.0, 1.0])
    normal, sigma = fused(np.array([z, other]), np.array([z, z]), np.array([0.01, 0.1]))
    np.testing.assert_allclose(normal, [0.1 / 101, 0, 1])
    assert sigma == pytest.approx(0.1 / np.sqrt(101), rel=1e-3)


@pytest.mark.parametrize("pull", [-0.3, 0.0, 0.05, 0.6, 0.85])
def test_a_pull_toward_the_policys_own_axis_is_found_and_taken_off(pull):
    truth, axes = np.array([0.15, -0.05, 0.987]), spread(6, 0.25)
    normal, sigma = fused(truth + pull * (axes - truth), axes, np.full(6, 0.001))
    np.testing.assert_allclose(normal, truth, atol=0.003)
    assert sigma >= 0.001 / np.sqrt(6) / (1 - pull)


def test_a_policy_that_sees_no_tilt_anywhere_has_a_large_sigma():
    axes = spread(6, 0.25)
    assert fused(axes, axes, np.full(6, 0.02))[1] == pytest.approx(10 * 0.02 / np.sqrt(6), rel=0.1)


def test_the_fused_sigma_is_what_the_fused_normal_scatters_by():
    rng, truth, axes, sigmas = np.random.default_rng(5), np.array([0.05, 0.0, 1.0]), spread(6, 0.25), np.full(6, 0.02)
    found = []
    for _ in range(500):
        pull = rng.normal(0, 0.3)
        said = truth + pull * (axes - truth) + np.append(rng.normal(0, 0.02, (6, 2)), np.zeros((6, 1)), axis=1)
        found.append(fused(said, axes, sigmas))
    z = [(normal[:2] - truth[:2]) / sigma for normal, sigma in found]
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1, abs=0.15)


# --- the survey ---------------------------------------------------------------------------------------------


def spoken(arm: PinholeArm, bias: float = 0.0, pull: float = 0.0, noise: float = 0.0, seed: int = 0):
    """Says the truth, but for so many rad, and such a part of it, that it says too little; and for noise."""
    rng = np.random.default_rng(seed)

    def policy(rgb):
        tilt = true_tilt(arm)
        kept = max(0.0, 1 - bias / max(tilt.angle, 1e-9))
        u, v = kept * (1 - pull) * np.array([tilt.u, tilt.v]) + noise * rng.normal(size=2)
        return Tilt(u, v, SIGMA)

    return policy


def test_a_survey_cancels_what_a_policy_errs_by_toward_or_away_from_the_normal():
    bias = np.radians(2)
    for survey, low, high in ((0, 0.5 * bias, 1.1 * bias), (4, 0, 0.15 * bias), (6, 0, 0.15 * bias)):
        for tilt in (0.1, 0.5):
            arm = PinholeArm(radius=RADIUS, tilt=tilt)
            plan = CnnPlanner(white, spoken(arm, bias), survey=survey).plan(arm)
            assert plan.outcome is PlanOutcome.ALIGNED
            assert low <= error_of(arm) <= high


@pytest.mark.parametrize("pull", [0.3, 0.7])
def test_a_survey_takes_off_what_a_timid_policy_leaves_out(pull):
    arm = PinholeArm(radius=RADIUS, tilt=0.4)
    CnnPlanner(white, spoken(arm, pull=pull, noise=0.005)).plan(arm)
    assert error_of(arm) < np.radians(1)


def test_a_survey_averages_noise():
    errors = []
    for seed in range(30):
        arm = PinholeArm(radius=RADIUS, tilt=0.3)
        plan = CnnPlanner(white, spoken(arm, noise=SIGMA, seed=seed)).plan(arm)
        errors.append(error_of(arm))
    one_look = SIGMA * np.sqrt(np.pi / 2)
    assert np.mean(errors) == pytest.approx(one_look / np.sqrt(7), rel=0.2)
    assert plan.steps[-1].left.sigma == pytest.approx(SIGMA / np.sqrt(7), rel=0.2)


@pytest.mark.parametrize(("survey", "tilt", "start"), [(3, 0.2, 0.4), (6, 0.25, 0.1), (8, 0.1, 0.0)])
def test_a_survey_goes_once_round_the_normal_from_the_side_where_the_camera_is(survey, tilt, start):
    arm = PinholeArm(radius=RADIUS, tilt=start, azimuth=0.7)
    plan = CnnPlanner(white, lambda rgb: true_tilt(arm), survey=survey, survey_tilt=tilt).plan(arm)
    assert (plan.outcome, len(plan.steps)) == (PlanOutcome.ALIGNED, 1 + survey)
    assert plan.frames == 2 + survey  # the last one is from the normal, for the record
    axes = np.array([-view.base_from_camera.rotation.as_matrix()[:, 2] for view in plan.views[1:]])
    np.testing.assert_allclose(axes[:, 2], np.cos(tilt), atol=1e-6)
    azimuths = np.unwrap(np.arctan2(axes[:, 1], axes[:, 0]))
    np.testing.assert_allclose(np.diff(azimuths), 2 * np.pi / survey, atol=1e-6)
    if start:
        assert azimuths[0] == pytest.approx(0.7, abs=1e-6)
    assert error_of(arm) < 1e-6


def test_a_survey_is_about_the_normal_as_known_by_then():
    """The first look errs; the true ones after it bring the ring to the true normal."""
    arm = PinholeArm(radius=RADIUS, tilt=0.3)
    first = [Tilt(0.1, 0.3, 0.04)]
    plan = CnnPlanner(white, lambda rgb: first.pop() if first else true_tilt(arm, 0.002), survey_tilt=0.2).plan(arm)
    tilts = [np.arccos(-view.base_from_camera.rotation.as_matrix()[2, 2]) for view in plan.views[1:]]
    assert abs(tilts[0] - 0.2) > 0.01
    np.testing.assert_allclose(tilts[3:], 0.2, atol=0.005)


def test_the_direction_of_view_stays_as_it_is_at_the_normal_while_the_object_is_centered():
    arm = PinholeArm(Ball((0.0, 0.0, 0.03)), radius=RADIUS, tilt=0.4)  # not where the camera believes it
    plan = CnnPlanner(white, lambda rgb: true_tilt(arm)).plan(arm)
    assert error_of(arm) < 1e-6
    np.testing.assert_allclose(plan.view.blob.centroid, CAMERA.principal_point, atol=2)


def test_a_viewpoint_that_is_barred_is_passed_over_and_the_trace_tells():
    pinhole = PinholeArm(radius=RADIUS, tilt=0.3)
    arm = Hindered(pinhole, stops={1: StopReason.JOINT_LIMIT, 2: StopReason.COLLISION})
    plan = CnnPlanner(white, lambda rgb: true_tilt(pinhole)).plan(arm)
    assert (plan.outcome, len(plan.steps)) == (PlanOutcome.ALIGNED, 1 + 6 - 2)
    reasons = [[motion.reason for motion in step.barred] for step in plan.steps]
    assert reasons == [[], [StopReason.JOINT_LIMIT, StopReason.COLLISION], [], [], []]
    assert error_of(pinhole) < CENTERING


def test_where_no_viewpoint_can_be_had_the_plan_goes_to_the_normal_all_the_same():
    for last, outcome in ((6, PlanOutcome.ALIGNED), (7, PlanOutcome.UNREACHABLE)):
        pinhole = PinholeArm(radius=RADIUS, tilt=0.3)
        arm = Hindered(pinhole, stops=dict.fromkeys(range(last), StopReason.UNREACHABLE))
        plan = CnnPlanner(white, lambda rgb, pinhole=pinhole: true_tilt(pinhole)).plan(arm)
        assert plan.outcome is outcome
        assert len(plan.steps[0].barred) == 6
    assert len(plan.steps) == 1


def test_a_viewpoint_without_the_object_in_sight_is_passed_over():
    pinhole = PinholeArm(radius=RADIUS, tilt=0.3)
    for blind in ({3}, {3, 7}):
        pinhole.stand_at(VirtualSphere(np.zeros(3), RADIUS).viewpoint(0.3, 0.0))
        arm = Hindered(pinhole, blind=lambda arm, blind=blind: arm.frames in blind)
        plan = CnnPlanner(white, lambda rgb: true_tilt(pinhole)).plan(arm)
        assert (plan.outcome, len(plan.steps)) == (PlanOutcome.ALIGNED, 7)
        assert sum(step.view is None for step in plan.steps) == len(blind)
        assert error_of(pinhole) < CENTERING


def test_an_object_lost_for_good_in_a_survey_is_a_lost_target():
    pinhole = PinholeArm(radius=RADIUS, tilt=0.3)
    arm = Hindered(pinhole, blind=lambda arm: arm.frames > 3)
    plan = CnnPlanner(white, lambda rgb: true_tilt(pinhole)).plan(arm)
    assert (plan.outcome, plan.view) == (PlanOutcome.TARGET_LOST, None)


@pytest.mark.parametrize("looks", [1, 2, 4, 7])
def test_a_survey_ends_once_the_fused_sigma_is_good_enough(looks):
    arm = PinholeArm(radius=RADIUS, tilt=0.3)
    whole = CnnPlanner(white, lambda rgb: true_tilt(arm)).plan(arm)
    assert len(whole.steps) == 7
    arm.stand_at(VirtualSphere(np.zeros(3), RADIUS).viewpoint(0.3, 0.0))
    until = 1.01 * whole.steps[looks - 1].left.sigma
    plan = CnnPlanner(white, lambda rgb: true_tilt(arm), until=until).plan(arm)
    assert (plan.outcome, len(plan.steps)) == (PlanOutcome.ALIGNED, looks)
    assert error_of(arm) < CENTERING


def test_a_motion_that_is_cut_short_goes_on_with_the_next_step():
    arm = PinholeArm(radius=RADIUS, tilt=0.5)
    plan = CnnPlanner(white, lambda rgb: true_tilt(arm), max_move=np.radians(6)).plan(arm)
    assert plan.outcome is PlanOutcome.ALIGNED
    assert len(plan.steps) > 7
    assert error_of(arm) < CENTERING


@pytest.mark.parametrize("given", [(np.nan, 0, 1), (0, np.inf, 1), (3, 3, 1), (0, 0, 0), (0, 0, -1), (0, 0, np.nan)])
def test_an_impossible_tilt_is_refused(given):
    with pytest.raises(InvalidParameterError, match=r"in rad, at most pi together.*got u="):
        Tilt(*given)


def test_a_tilt_of_half_a_turn_is_one_in_every_direction():
    directions = np.linspace(-3, 3, 601)
    tilts = [Tilt(np.pi * np.cos(direction), np.pi * np.sin(direction), SIGMA) for direction in directions]
    assert max(np.hypot(tilt.u, tilt.v) for tilt in tilts) > np.pi  # by rounding
    assert max(tilt.angle for tilt in tilts) == np.pi
    assert all(tilt.step(RADIUS).rotation.magnitude() == pytest.approx(np.pi) for tilt in tilts)
    with pytest.raises(InvalidParameterError, match="at most pi together"):
        Tilt(np.pi + 1e-6, 0, SIGMA)


def test_a_tilt_goes_no_farther_than_it_may():
    tilt = Tilt(0.3, -0.4, SIGMA)
    for most, angle in ((np.pi, 0.5), (0.1, 0.1)):
        assert tilt.step(RADIUS, most).rotation.magnitude() == pytest.approx(angle)
    again = Tilt.toward(tilt.normal, SIGMA)
    assert (again.u, again.v) == pytest.approx((0.3, -0.4))


# --- what goes wrong ----------------------------------------------------------------------------------------


def test_nothing_in_view_is_no_target_found():
    arm = Hindered(PinholeArm(radius=RADIUS), blind=lambda arm: True)
    plan = CnnPlanner(white, lambda rgb: Action.UP).plan(arm)
    assert (plan.outcome, plan.view, plan.views, plan.frames) == (PlanOutcome.TARGET_NOT_FOUND, None, (), 1)


def test_an_object_that_leaves_the_view_in_the_middle_is_a_lost_target():
    arm = Hindered(PinholeArm(radius=RADIUS), blind=lambda arm: arm.motions >= 3)
    plan = CnnPlanner(white, lambda rgb: Action.UP).plan(arm)
    assert (plan.outcome, plan.view) == (PlanOutcome.TARGET_LOST, None)
    assert [step.said for step in plan.steps] == [Action.UP] * 3 + [None]
    assert len(plan.views) == 3


def test_an_object_lost_by_the_last_action_is_a_lost_target_too():
    arm = Hindered(PinholeArm(radius=RADIUS), blind=lambda arm: arm.motions >= 3)
    plan = CnnPlanner(white, lambda rgb: Action.UP, max_steps=3).plan(arm)
    assert (plan.outcome, plan.view, len(plan.steps)) == (PlanOutcome.TARGET_LOST, None, 3)


@pytest.mark.parametrize("reason", [reason for reason in StopReason if reason is not StopReason.REACHED])
@pytest.mark.parametrize("said", [Action.UP, Tilt(0.3, 0.0, 0.2)])
def test_a_motion_that_is_barred_gives_the_plan_its_reason(reason, said):
    arm = Hindered(PinholeArm(radius=RADIUS), stops={1: reason})
    plan = CnnPlanner(white, lambda rgb: said, survey=0).plan(arm)
    assert plan.outcome.value == reason.value
    assert len(plan.steps) == 2
    np.testing.assert_array_equal(plan.view.joints, arm.joints)  # where it stopped


def test_an_object_that_cannot_be_centered_ends_the_plan_before_the_policy_is_asked():
    class Stubborn(PinholeArm):
        def move_camera(self, camera_from_target):
            return super().move_camera(RigidTransform.identity())

    arm = Stubborn(Ball((0.05, 0.0, 0.0)), radius=RADIUS)
    plan = CnnPlanner(white, lambda rgb: pytest.fail("asked")).plan(arm)
    assert (plan.outcome, len(plan.steps)) == (PlanOutcome.NOT_CENTERED, 1)


class Stiff(PinholeArm):
    """An arm at the end of its reach: it moves over the sphere, and cannot turn where it stands."""

    def move_camera(self, camera_from_target):
        moves = np.any(camera_from_target.translation)
        return super().move_camera(camera_from_target if moves else RigidTransform.identity())


def test_an_object_that_cannot_quite_be_centered_is_looked_at_where_it_stands():
    arm = Stiff(Ball((0.0, 0.015, 0.0)), radius=RADIUS)
    step = next(CnnPlanner(white, lambda rgb: Tilt(0.2, 0.0, SIGMA)).steps(arm))
    aside = step.view.blob.centroid - arm.intrinsics.principal_point
    assert aside == pytest.approx([15.9, 0.0], abs=0.1)  # to the right, where a turn would have taken the axis
    assert step.left.angle == pytest.approx(0.2 - np.arctan(aside[0] / arm.intrinsics.fx), abs=1e-4)
    assert step.left.direction == pytest.approx(0, abs=1e-3)
    assert CnnPlanner(white, lambda rgb: Action.NO_OP).plan(arm).outcome is PlanOutcome.ALIGNED


def test_how_far_off_center_is_the_users_choice():
    arm = Stiff(Ball((0.015, 0.0, 0.0)), radius=RADIUS)
    plan = CnnPlanner(white, lambda rgb: pytest.fail("asked"), off_center=10).plan(arm)
    assert plan.outcome is PlanOutcome.NOT_CENTERED
    with pytest.raises(InvalidParameterError, match=r"off_center is at least the threshold, 2 px; got 1"):
        CnnPlanner(white, lambda rgb: Action.NO_OP, off_center=1)


# --- step by step, and after an object that moves -----------------------------------------------------------


def test_an_object_out_of_sight_for_a_while_is_taken_up_again():
    arm = Hindered(PinholeArm(radius=RADIUS), blind=lambda arm: 3 <= arm.frames <= 5)
    steps = CnnPlanner(white, lambda rgb: Action.UP).steps(arm)
    outcomes = [step.outcome for step in islice(steps, 7)]
    lost = [PlanOutcome.TARGET_LOST] * 3
    assert outcomes == [None, None, *lost, None, None]


@pytest.mark.parametrize("back", [Ball((0.2, 0.1, 0.0)), Ball((0.01, 0.0, 0.0), radius=0.012)])
def test_an_object_that_comes_back_elsewhere_or_at_another_size_is_followed_again(back):
    def arm():
        pinhole = PinholeArm(radius=RADIUS)

        def blind(arm):
            if arm.frames == 3:
                pinhole.shapes = (back,)
            return 3 <= arm.frames <= 4

        return Hindered(pinhole, blind=blind)

    planner = CnnPlanner(white, lambda rgb: Action.NO_OP)
    followed = planner.follow(arm(), looks=6)
    expected = [PlanOutcome.ALIGNED] * 2 + [PlanOutcome.TARGET_LOST] * 2 + [PlanOutcome.ALIGNED] * 2
    assert [step.outcome for step in followed.steps] == expected
    assert [step.outcome for step in islice(planner.steps(arm()), 6)] == expected
    np.testing.assert_allclose(followed.view.blob.centroid, CAMERA.principal_point, atol=2)


def test_a_plan_for_an_object_that_stands_still_takes_up_no_other_in_its_place():
    pinhole = PinholeArm(radius=RADIUS, tilt=0.3)

    def swapped(arm):
        pinhole.shapes = (Ball(radius=0.05),) if arm.frames > 3 else (Ball(),)
        return arm.frames == 3

    plan = CnnPlanner(white, lambda rgb: true_tilt(pinhole)).plan(Hindered(pinhole, blind=swapped))
    assert plan.outcome is PlanOutcome.TARGET_LOST


def test_following_takes_as_many_looks_as_it_is_told():
    plan = CnnPlanner(white, lambda rgb: Action.NO_OP).follow(PinholeArm(radius=RADIUS), looks=6)
    assert (plan.outcome, len(plan.steps), plan.frames) == (PlanOutcome.ALIGNED, 6, 6)
    with pytest.raises(InvalidParameterError, match="looks is a whole number, at least 1; got 0"):
        CnnPlanner(white, lambda rgb: Action.NO_OP).follow(PinholeArm(radius=RADIUS), looks=0)


# --- misuse -------------------------------------------------------------------------------------------------


def test_a_policy_that_is_none_is_refused():
    with pytest.raises(InvalidParameterError, match=r"called with an RGB image and returns an Action or a Tilt.*'up'"):
        CnnPlanner(white, "up")


@pytest.mark.parametrize(
    ("said", "hint"),
    [
        (3, r"got 3, where Action\(3\)"),
        (np.int64(4), r"Action\(4\)"),
        (7, "got 7, where Action.NO_OP or"),
        (None, "got None, where Action.NO_OP or Tilt"),
    ],
)
def test_a_policy_that_says_anything_else_is_told_what_would_do(said, hint):
    with pytest.raises(InvalidParameterError, match=hint):
        CnnPlanner(white, lambda rgb: said).plan(PinholeArm(radius=RADIUS))


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"radius": 0.0}, "radius is positive and finite, in m; got 0.0"),
        ({"threshold": np.nan}, "threshold is positive and finite, in px"),
        ({"step": 5.0}, r"step is in radians, in \(0, pi/2\]; got 5.0. For degrees: np.radians"),
        ({"max_move": 15.0}, "max_move is in radians"),
        ({"max_steps": 0}, "max_steps is a whole number, at least 1; got 0"),
        ({"max_steps": 2.5}, "max_steps is a whole number"),
        ({"max_steps": True}, "max_steps is a whole number"),
        ({"survey": 2}, "survey, or 0 for none, is a whole number, at least 3; got 2"),
        ({"survey": -1}, "survey, or 0 for none, is a whole number"),
        ({"survey": 6.0}, "survey, or 0 for none, is a whole number"),
        ({"survey_tilt": 14.0}, r"survey_tilt is in radians, in \(0, pi/2\]; got 14.0"),
        ({"survey_tilt": 0.0}, "survey_tilt is in radians"),
        ({"until": 2.0}, r"until is a standard deviation in radians, 0 for never; got 2.0.*np.radians"),
        ({"until": -0.1}, "until is a standard deviation"),
    ],
)
def test_an_impossible_planner_is_refused(given, text):
    with pytest.raises(InvalidParameterError, match=text):
        CnnPlanner(white, lambda rgb: Action.NO_OP, **given)


# Actions and tilts


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
