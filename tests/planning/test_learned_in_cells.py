"""The learned planner's closed loop in simulated cells, with policies that know the truth, or err by a known amount."""

from itertools import islice

import mujoco
import numpy as np
import pytest
from eye_in_hand import Hindered
from scipy.spatial.transform import Rotation

from gvp_lib import VirtualSphere, WorkCell
from gvp_lib.evaluation.episodes import run_episode
from gvp_lib.learning.labels import label_view
from gvp_lib.motion.arm import EyeInHandArm
from gvp_lib.planning.learned import CnnPlanner
from gvp_lib.planning.plan import Action, PlanOutcome, Tilt
from gvp_lib.simulation.sensors import Noise

RADIUS, STEP = 0.5, np.radians(5)
CENTERING = np.radians(0.5)  # rad: 2 px at a focal length of some 600 px, on either side of the last step, and u with v
SIGMA = np.radians(2)
FLOOR = 0.707 * STEP + CENTERING  # that four directions leave at most


def best_action(cell):
    return lambda rgb: label_view(cell.truth.world_from_camera, cell.truth.normal, STEP).action


def noisy_tilt(cell, rng, sigma=SIGMA):
    def policy(rgb):
        label = label_view(cell.truth.world_from_camera, cell.truth.normal, STEP)
        u, v = label.angle * np.array([np.cos(label.direction), np.sin(label.direction)])
        return Tilt(u + rng.normal(0, sigma), v + rng.normal(0, sigma), sigma)

    return policy


def tip(cell, angle):
    """Turn the target about the world's x, where it stands."""
    quaternion = cell.data.joint("target").qpos[3:]  # wxyz, a view
    turned = Rotation.from_rotvec([angle, 0, 0]) * Rotation.from_quat(quaternion, scalar_first=True)
    quaternion[:] = turned.as_quat(scalar_first=True)
    mujoco.mj_kinematics(cell.model, cell.data)
    mujoco.mj_camlight(cell.model, cell.data)


def start(cell, seed, tilt=None):
    """Stand the camera uniformly in the 30 deg cap about the accepted normal, at any roll."""
    rng = np.random.default_rng(seed)  # a generator stays what it is
    tilt = np.arccos(rng.uniform(np.cos(np.radians(30)), 1)) if tilt is None else tilt
    azimuth, roll = rng.uniform(0, 2 * np.pi, 2)
    sphere = VirtualSphere(cell.truth.world_from_object.translation, RADIUS, cell.truth.normal.direction)
    cell.place_camera(sphere.viewpoint(tilt, azimuth, roll))


@pytest.fixture(scope="module")
def cells():
    of = {"target": "cuboid_1x2", "seed": 3}
    with WorkCell(arm="floating", **of) as floating, WorkCell(arm="ur5e", **of) as ur5e:
        yield {"floating": floating, "ur5e": ur5e}


@pytest.fixture
def floating(cells):
    cells["floating"].reset(3)
    return cells["floating"]


@pytest.fixture
def ur5e(cells):
    cells["ur5e"].reset(3)
    return cells["ur5e"]


def sixteen_errors(cell, rng, policy):
    """Of plans from starts all over the cap, rad."""
    errors = []
    for _ in range(16):
        start(cell, rng)
        assert CnnPlanner(cell.segmenter, policy).plan(cell.arm).outcome is PlanOutcome.ALIGNED
        errors.append(cell.truth.viewpoint_error())
    return errors


def test_five_true_actions_end_as_near_to_the_normal_as_four_directions_allow(floating):
    errors = sixteen_errors(floating, np.random.default_rng(0), best_action(floating))
    assert max(errors) < FLOOR
    assert np.mean(errors) == pytest.approx(0.383 * STEP, abs=0.08 * STEP)  # n = 16; sd 0.14 steps


def test_a_noisy_tilt_ends_nearer_than_one_look_would(floating):
    rng = np.random.default_rng(4)
    errors = sixteen_errors(floating, rng, noisy_tilt(floating, rng))
    one_look = SIGMA * np.sqrt(np.pi / 2)  # the mean length of a Gaussian error in u and v
    assert np.mean(errors) < 0.5 * one_look  # seven looks: 0.38


def test_an_arm_with_the_thesiss_noise_ends_as_near_but_for_its_own_errors():
    with WorkCell(arm="ur5e", target="cuboid_1x2", noise=Noise.thesis(), seed=3) as cell:
        start(cell, 1, np.radians(22))
        assert CnnPlanner(cell.segmenter, best_action(cell)).plan(cell.arm).outcome is PlanOutcome.ALIGNED
        assert cell.truth.viewpoint_error() < 0.707 * STEP + np.radians(1)


def test_the_last_word_is_no_op_and_the_camera_stays(floating):
    start(floating, 2, np.radians(17))
    plan = CnnPlanner(floating.segmenter, best_action(floating), keep_images=True).plan(floating.arm)
    *moves, last = plan.steps
    assert all(step.said is not Action.NO_OP and step.motion and step.outcome is None for step in moves)
    assert (last.said, last.motion, last.outcome) == (Action.NO_OP, None, PlanOutcome.ALIGNED)
    assert plan.views == tuple(step.view for step in plan.steps)
    assert plan.view is last.view
    np.testing.assert_array_equal(plan.joints, floating.arm.joints)
    np.testing.assert_array_equal(last.view.rgb, floating.arm.capture())
    unasked = CnnPlanner(floating.segmenter, lambda rgb: Action.NO_OP).plan(floating.arm)
    assert [view.rgb for view in unasked.views] == [None]


@pytest.mark.parametrize("seed", range(3))
def test_moving_by_a_labels_tilt_is_to_look_along_the_normal(floating, seed):
    start(floating, seed)
    label = label_view(floating.truth.world_from_camera, floating.truth.normal)
    tilt = Tilt(label.angle * np.cos(label.direction), label.angle * np.sin(label.direction), SIGMA)
    assert (tilt.angle, tilt.direction) == pytest.approx((label.angle, label.direction))
    floating.arm.move_camera(tilt.step(RADIUS))
    assert floating.truth.viewpoint_error() < 1e-6


def test_a_real_arm_surveys(ur5e):
    start(ur5e, 0, 0.4)
    plan = CnnPlanner(ur5e.segmenter, noisy_tilt(ur5e, np.random.default_rng(0), 1e-6)).plan(ur5e.arm)
    assert (plan.outcome, len(plan.steps)) == (PlanOutcome.ALIGNED, 7)
    assert ur5e.truth.viewpoint_error() < np.radians(0.05)


def test_a_real_arm_ends_where_its_reach_does(ur5e):
    start(ur5e, 0, 0.1)
    plan = CnnPlanner(ur5e.segmenter, lambda rgb: Action.UP).plan(ur5e.arm)
    assert plan.outcome in (PlanOutcome.UNREACHABLE, PlanOutcome.JOINT_LIMIT, PlanOutcome.COLLISION)
    assert not plan.steps[-1].motion


def test_steps_go_on_after_no_op_and_take_up_an_object_that_tips(floating):
    start(floating, 0, 0.0)
    steps = CnnPlanner(floating.segmenter, best_action(floating)).steps(floating.arm)
    assert [step.said for step in islice(steps, 3)] == [Action.NO_OP] * 3
    tip(floating, np.radians(20))
    assert floating.truth.viewpoint_error() == pytest.approx(np.radians(20), abs=CENTERING)
    assert next(steps).said is not Action.NO_OP
    assert any(step.outcome is PlanOutcome.ALIGNED for step in islice(steps, 10))
    assert floating.truth.viewpoint_error() < FLOOR


def test_a_follower_of_tilts_keeps_up_with_an_object_that_tips(floating):
    after = []
    start(floating, 0, 0.0)
    steps = CnnPlanner(floating.segmenter, noisy_tilt(floating, np.random.default_rng(0), 1e-6)).steps(floating.arm)
    for _ in range(8):
        tip(floating, np.radians(3))
        next(steps)
        after.append(floating.truth.viewpoint_error())
    assert np.mean(after) < np.radians(0.5)


def test_the_planner_needs_no_more_than_the_arms_protocol_and_the_experiments_runner_takes_it_as_any_other(floating):
    # `Hindered` has the protocol's members and nothing else, so there is no way from it to a cell's truth.
    start(floating, 6, 0.2)
    arm = Hindered(floating.arm)
    assert isinstance(arm, EyeInHandArm)
    plan, judged = run_episode(floating, lambda cell: CnnPlanner(cell.segmenter, best_action(cell)).plan(arm))
    assert (judged.outcome, judged.views, judged.frames) == ("aligned", len(plan.steps), arm.frames)
    assert judged.total == pytest.approx(np.degrees(floating.truth.viewpoint_error()))
    assert judged.seconds > 0
