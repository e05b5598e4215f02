"""The learned planner's closed loop on an arm without a simulator, with policies that know the truth or fail."""

from itertools import cycle, islice

import numpy as np
import pytest
from eye_in_hand import CAMERA, REACHED, Ball, Hindered, PinholeArm, white

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arm import STOPS, Outcome
from gvp_lib.motion.primitives import turn
from gvp_lib.planning.learned import CnnPlanner, fused
from gvp_lib.planning.plan import Action, Tilt

pytestmark = pytest.mark.check

RADIUS, STEP = 0.5, np.radians(5)
CENTERING = np.radians(0.5)  # rad: 2 px at a focal length of some 600 px, on either side of the last step, and u with v
SIGMA = np.radians(2)


def over_ball(*shapes, tilt=0.3, azimuth=0.0):
    """A pinhole's arm at the radius of the closed loop; the normal is the base's z."""
    return PinholeArm(*shapes, radius=RADIUS, tilt=tilt, azimuth=azimuth)


def error_of(arm):
    """Angle between the reversed optical axis and the normal, rad."""
    x, y, z = -arm.camera_pose().rotation.as_matrix()[:, 2]
    return float(np.arctan2(np.hypot(x, y), z))


def true_tilt(arm, sigma=SIGMA):
    return Tilt.toward(arm.camera_pose().rotation.inv().apply([0.0, 0.0, 1.0]), sigma)


def run(arm, policy=None, **options):
    """The plan of a policy, or of one that always says this; by default it says the true tilt."""
    known = getattr(arm, "arm", arm)  # behind a hindered one
    said = policy if callable(policy) else (lambda rgb: true_tilt(known)) if policy is None else (lambda rgb: policy)
    return CnnPlanner(white, said, **options).plan(arm)


# --- the thesis's five actions ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("normals", "axes", "sigmas"),
    [([], [], []), ([[0, 0, 1]], [[0, 0, 1], [0, 0, 1]], [1]), ([[0, 0, 1]], [[0, 0, 1]], [np.inf]), (1, 2, 3)],
)
def test_looks_that_do_not_match_are_not_fused(normals, axes, sigmas):
    with pytest.raises(InvalidParameterError, match=r"of shape \(n, 3\) and standard deviations, positive"):
        fused(normals, axes, sigmas)


def test_lists_of_looks_are_fused_as_arrays_are():
    looks = [[0.0, 0.0, 1.0], [0.0, 0.01, 1.0]], [[0.0, 0.1, 1.0], [0.0, -0.1, 1.0]], [0.03, 0.02]
    np.testing.assert_array_equal(fused(*looks)[0], fused(*map(np.array, looks))[0])


def test_the_policy_is_shown_whole_centered_pictures_and_its_last_word_is_no_op_where_the_camera_stays():
    shown, said = [], iter([Action.UP, Action.LEFT, Action.NO_OP])
    arm = over_ball()
    arm.move_camera(turn([0.1, -0.1, 0.0]))  # off the center
    plan = run(arm, lambda rgb: shown.append(rgb) or next(said), keep_images=True)
    for rgb in shown:
        assert (rgb.shape, rgb.dtype) == ((480, 640, 3), np.uint8)
        np.testing.assert_allclose(np.argwhere(white(rgb)).mean(axis=0), [239.5, 319.5], atol=2)
    *moves, last = plan.steps
    assert [step.said for step in moves] == [Action.UP, Action.LEFT]
    assert all(step.motion and step.outcome is None for step in moves)
    assert (last.said, last.motion, last.outcome) == (Action.NO_OP, None, Outcome.ALIGNED)
    assert plan.views == tuple(step.view for step in plan.steps)
    assert plan.view is last.view
    np.testing.assert_array_equal(plan.joints, arm.joints)
    np.testing.assert_array_equal(last.view.rgb, arm.capture())
    assert run(arm, Action.NO_OP).view.rgb is None  # unless asked for


def test_a_policy_that_never_ends_is_out_of_steps():
    arm = over_ball(tilt=0.0)
    plan = run(arm, Action.UP, max_steps=4)
    assert (plan.outcome, len(plan.steps), plan.outcome.arrived) == (Outcome.OUT_OF_STEPS, 4, False)
    assert error_of(arm) == pytest.approx(4 * STEP, abs=CENTERING)
    np.testing.assert_array_equal(plan.view.joints, arm.joints)  # where the last action led


def test_a_swinging_policy_is_out_of_steps_unless_a_reversal_ends_it():
    for stop, outcome, steps in ((False, Outcome.OUT_OF_STEPS, 10), (True, Outcome.ALIGNED, 2)):
        swing = cycle([Action.UP, Action.DOWN])
        plan = run(over_ball(), lambda rgb, swing=swing: next(swing), max_steps=10, stop_at_reversal=stop)
        assert (plan.outcome, len(plan.steps)) == (outcome, steps)
    assert (plan.steps[-1].said, plan.steps[-1].motion) == (Action.DOWN, None)  # said, and not done
    said = iter([Action.UP, Action.UP, Action.LEFT, Action.DOWN, Action.NO_OP])  # the same again and aside are none
    assert len(run(over_ball(), lambda rgb: next(said), stop_at_reversal=True).steps) == 5


# --- tilts --------------------------------------------------------------------------------------------------


def test_the_trace_tells_what_was_left_and_how_uncertain_that_was_in_motions_no_longer_than_they_may_be():
    arm = over_ball(tilt=0.5)
    plan = run(arm, survey=0, max_move=np.radians(15))
    assert plan.outcome is Outcome.ALIGNED
    left = [step.left.angle for step in plan.steps]
    sigmas = [step.left.sigma for step in plan.steps]
    np.testing.assert_allclose(left, [0.5, 0.5 - np.radians(15), 0], atol=CENTERING)
    assert sigmas[0] == pytest.approx(np.hypot(SIGMA, 0.3 * 0.5), rel=0.02)  # what 0.5 rad may be short of
    assert sigmas[0] > sigmas[1] > sigmas[2] > SIGMA / np.sqrt(3)
    assert error_of(arm) < CENTERING


@pytest.mark.parametrize(("sigma", "looks"), [(0.2, 1), (0.05, 2)])
def test_without_a_survey_a_plan_ends_at_the_first_step_that_has_less_left_than_its_sigma(sigma, looks):
    arm = over_ball(tilt=0.1)
    plan = run(arm, lambda rgb: true_tilt(arm, sigma), survey=0)
    assert (plan.outcome, len(plan.steps)) == (Outcome.ALIGNED, looks)


def test_a_policy_without_an_idea_moves_nothing_and_makes_nothing_forgotten():
    said = iter([Tilt(0.2, 0.1, np.inf), Tilt(0.1, 0.0, 0.01), Tilt(0.0, 0.5, np.inf), Tilt(0.0, 0.2, 0.1)])
    first, second, third, fourth = islice(CnnPlanner(white, lambda rgb: next(said)).steps(over_ball()), 4)
    assert (first.motion, first.left, first.outcome) == (None, None, None)
    assert second.left.angle == pytest.approx(0.1)
    assert third.left.angle < CENTERING  # as the second look had it
    assert fourth.left.angle == pytest.approx(0.2)  # an object that may move: the last look alone


def test_looks_of_one_axis_count_by_their_precision():
    z, other = np.array([0.0, 0.0, 1.0]), np.array([0.1, 0.0, 1.0])
    normal, sigma = fused(np.array([z, other]), np.array([z, z]), np.array([0.01, 0.1]))
    np.testing.assert_allclose(normal, [0.1 / 101, 0, 1])
    assert sigma == pytest.approx(0.1 / np.sqrt(101), rel=1e-3)


def test_the_fused_sigma_is_what_the_fused_normal_scatters_by_and_large_where_no_tilt_is_seen_anywhere():
    rng, truth, sigmas = np.random.default_rng(5), np.array([0.05, 0.0, 1.0]), np.full(6, 0.02)
    azimuths = np.pi / 3 * np.arange(6)
    axes = np.column_stack([0.247 * np.cos(azimuths), 0.247 * np.sin(azimuths), np.full(6, 0.969)])
    found = []
    for _ in range(500):
        pull = rng.normal(0, 0.3)
        said = truth + pull * (axes - truth) + np.append(rng.normal(0, 0.02, (6, 2)), np.zeros((6, 1)), axis=1)
        found.append(fused(said, axes, sigmas))
    z = [(normal[:2] - truth[:2]) / sigma for normal, sigma in found]
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1, abs=0.15)
    assert fused(axes, axes, sigmas)[1] == pytest.approx(10 * 0.02 / np.sqrt(6), rel=0.1)


# --- the survey ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("survey", "low", "high"), [(0, 0.5, 1.1), (6, 0, 0.15)])
def test_a_survey_cancels_what_a_policy_errs_by_toward_or_away_from_the_normal(survey, low, high):
    arm, bias = over_ball(tilt=0.5), np.radians(2)

    def says_too_little(rgb):
        tilt = true_tilt(arm)
        kept = max(0.0, 1 - bias / max(tilt.angle, 1e-9))
        return Tilt(kept * tilt.u, kept * tilt.v, SIGMA)

    assert run(arm, says_too_little, survey=survey).outcome is Outcome.ALIGNED
    assert low * bias <= error_of(arm) <= high * bias


@pytest.mark.parametrize(("survey", "tilt", "start"), [(3, 0.2, 0.4), (8, 0.1, 0.0)])
def test_a_survey_goes_once_round_the_normal_from_the_side_where_the_camera_is(survey, tilt, start):
    arm = over_ball(tilt=start, azimuth=0.7)
    plan = run(arm, survey=survey, survey_tilt=tilt)
    assert (plan.outcome, len(plan.steps)) == (Outcome.ALIGNED, 1 + survey)
    assert plan.frames == 2 + survey  # the last one is from the normal, for the record
    axes = np.array([-view.line_of_sight for view in plan.views[1:]])
    np.testing.assert_allclose(axes[:, 2], np.cos(tilt), atol=1e-6)
    azimuths = np.unwrap(np.arctan2(axes[:, 1], axes[:, 0]))
    np.testing.assert_allclose(np.diff(azimuths), 2 * np.pi / survey, atol=1e-6)
    if start:
        assert azimuths[0] == pytest.approx(0.7, abs=1e-6)
    assert error_of(arm) < 1e-6


def test_the_direction_of_view_stays_as_it_is_at_the_normal_while_the_object_is_centered():
    arm = over_ball(Ball((0.0, 0.0, 0.03)), tilt=0.4)  # not where the camera believes it
    plan = run(arm)
    assert error_of(arm) < 1e-6
    np.testing.assert_allclose(plan.view.blob.centroid, CAMERA.principal_point, atol=2)


def stops(numbers, reason=Outcome.UNREACHABLE):
    return {"stops": dict.fromkeys(numbers, reason)}


def unseen(*frames):
    return {"blind": lambda arm: arm.frames in frames}


@pytest.mark.parametrize(
    ("hindrance", "outcome", "steps", "barred", "lost"),
    [
        (stops([1, 2], Outcome.JOINT_LIMIT), Outcome.ALIGNED, 1 + 6 - 2, [0, 2, 0, 0, 0], 0),
        # Where no viewpoint can be had the plan goes to the normal all the same.
        (stops(range(6)), Outcome.ALIGNED, 2, [6, 0], 0),
        (stops(range(7)), Outcome.UNREACHABLE, 1, [6], 0),
        (unseen(3, 7), Outcome.ALIGNED, 7, [0] * 7, 2),
        (unseen(*range(4, 99)), Outcome.TARGET_LOST, 7, [0] * 7, 4),
    ],
)
def test_a_viewpoint_that_is_barred_or_without_the_object_is_skipped_and_the_trace_tells(
    hindrance, outcome, steps, barred, lost
):
    arm = Hindered(over_ball(), **hindrance)
    plan = run(arm)
    assert (plan.outcome, len(plan.steps)) == (outcome, steps)
    assert [len(step.barred) for step in plan.steps] == barred
    assert {motion.reason for step in plan.steps for motion in step.barred} <= set(hindrance.get("stops", {}).values())
    assert sum(step.view is None for step in plan.steps) == lost
    assert outcome is not Outcome.ALIGNED or error_of(arm) < CENTERING


@pytest.mark.parametrize("looks", [1, 4])
def test_a_survey_ends_once_the_fused_sigma_is_good_enough(looks):
    arm, whole = over_ball(), run(over_ball())
    plan = run(arm, until=1.01 * whole.steps[looks - 1].left.sigma)
    assert (plan.outcome, len(plan.steps), len(whole.steps)) == (Outcome.ALIGNED, looks, 7)
    assert error_of(arm) < CENTERING


# --- what goes wrong ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("blind", "options", "outcome", "steps", "views"),
    [
        (lambda arm: True, {}, Outcome.TARGET_NOT_FOUND, 1, 0),
        (lambda arm: arm.motions >= 3, {}, Outcome.TARGET_LOST, 4, 3),
        (lambda arm: arm.motions >= 3, {"max_steps": 3}, Outcome.TARGET_LOST, 3, 3),
    ],
    ids=["nothing to begin with", "lost in the middle", "lost by the last action"],
)
def test_an_object_out_of_view_is_not_found_or_lost(blind, options, outcome, steps, views):
    plan = run(Hindered(over_ball(tilt=0.0), blind=blind), Action.UP, **options)
    assert (plan.outcome, plan.view, len(plan.steps), len(plan.views)) == (outcome, None, steps, views)
    assert [step.said for step in plan.steps] == [Action.UP] * views + [None] * (steps - views)


def test_another_object_in_the_place_of_a_lost_one_is_not_taken_up():
    def swapped(arm):
        arm.arm.shapes = (Ball(radius=0.05),) if arm.frames > 3 else (Ball(),)
        return arm.frames == 3

    plan = run(Hindered(over_ball(), blind=swapped))
    assert (plan.outcome, plan.view) == (Outcome.TARGET_LOST, None)


@pytest.mark.parametrize("reason", STOPS)
@pytest.mark.parametrize("said", [Action.UP, Tilt(0.3, 0.0, 0.2)])
def test_a_motion_that_is_barred_gives_the_plan_its_reason(reason, said):
    arm = Hindered(over_ball(tilt=0.0), stops={1: reason})
    plan = run(arm, said, survey=0)
    assert (plan.outcome, len(plan.steps)) == (reason, 2)
    np.testing.assert_array_equal(plan.view.joints, arm.joints)  # where it stopped


def stiff(*center):
    """An arm over a ball at the end of its reach: it moves over the sphere, and cannot turn where it stands."""
    arm = over_ball(Ball(center), tilt=0.0)
    arm.move_camera = lambda target: PinholeArm.move_camera(arm, target) if np.any(target.translation) else REACHED
    return arm


def test_an_object_that_cannot_be_centered_ends_the_plan_before_the_policy_is_asked_how_far_off_is_the_users_choice():
    for aside, options in ((0.05, {}), (0.015, {"off_center": 10})):
        plan = run(stiff(aside, 0.0, 0.0), lambda rgb: pytest.fail("asked"), **options)
        assert (plan.outcome, len(plan.steps)) == (Outcome.NOT_CENTERED, 1)


def test_an_object_that_cannot_quite_be_centered_is_looked_at_where_it_stands():
    arm = stiff(0.0, 0.015, 0.0)
    step = next(CnnPlanner(white, lambda rgb: Tilt(0.2, 0.0, SIGMA)).steps(arm))
    aside = step.view.blob.centroid - arm.intrinsics.principal_point
    assert aside == pytest.approx([15.9, 0.0], abs=0.1)  # to the right, where a turn would have taken the axis
    assert step.left.angle == pytest.approx(0.2 - np.arctan(aside[0] / arm.intrinsics.fx), abs=1e-4)
    assert step.left.direction == pytest.approx(0, abs=1e-3)


@pytest.mark.parametrize(
    ("said", "hint"), [(np.int64(4), r"Action\(4\)"), (7, "got 7, where Action.NO_OP or Tilt"), ("up", "got 'up'")]
)
def test_a_policy_that_says_anything_else_is_told_what_would_do(said, hint):
    with pytest.raises(InvalidParameterError, match=hint):
        run(over_ball(), said)


# --- step by step, and after an object that moves -----------------------------------------------------------


@pytest.mark.parametrize("back", [Ball((0.2, 0.1, 0.0)), Ball((0.01, 0.0, 0.0), radius=0.012)])
def test_an_object_that_comes_back_elsewhere_or_at_another_size_is_followed_again(back):
    def blind(arm):
        if arm.frames == 3:
            arm.arm.shapes = (back,)
        return 3 <= arm.frames <= 4

    arm = Hindered(over_ball(tilt=0.0), blind=blind)
    steps = list(islice(CnnPlanner(white, lambda rgb: Action.NO_OP).steps(arm), 6))
    seen = [Outcome.ALIGNED] * 2
    assert [step.outcome for step in steps] == [*seen, Outcome.TARGET_LOST, Outcome.TARGET_LOST, *seen]
    np.testing.assert_allclose(steps[-1].view.blob.centroid, CAMERA.principal_point, atol=2)
