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
FLOOR = 0.707 * STEP + CENTERING  # that four directions leave at most


def best_action(cell):
    return lambda rgb: label_view(cell.truth.world_from_camera, cell.truth.normal, STEP).action


def true_tilt(cell):
    def policy(rgb):
        label = label_view(cell.truth.world_from_camera, cell.truth.normal, STEP)
        u, v = label.angle * np.array([np.cos(label.direction), np.sin(label.direction)])
        return Tilt(u, v, 1e-6)

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
def made():
    with WorkCell(arm="floating", target="cuboid_1x2", seed=3) as cell:
        yield cell


@pytest.fixture
def floating(made):
    made.reset(3)
    return made


def test_five_true_actions_end_as_near_to_the_normal_as_four_directions_allow(floating):
    rng, errors = np.random.default_rng(0), []
    for _ in range(16):
        start(floating, rng)
        plan = CnnPlanner(floating.segmenter, best_action(floating)).plan(floating.arm)
        assert plan.outcome is PlanOutcome.ALIGNED
        errors.append(floating.truth.viewpoint_error())
    assert max(errors) < FLOOR
    assert np.mean(errors) == pytest.approx(0.383 * STEP, abs=0.08 * STEP)  # n = 16; sd 0.14 steps


@pytest.mark.parametrize("noise", [None, Noise.thesis()], ids=["without noise", "with the thesis's"])
def test_a_real_arm_ends_as_near_but_for_its_own_errors_and_surveys(noise):
    own = np.radians(0.05 if noise is None else 1)
    with WorkCell(arm="ur5e", target="cuboid_1x2", noise=noise, seed=3) as cell:
        start(cell, 1, np.radians(22))
        assert CnnPlanner(cell.segmenter, best_action(cell)).plan(cell.arm).outcome is PlanOutcome.ALIGNED
        assert cell.truth.viewpoint_error() < FLOOR + own
        start(cell, 0, 0.4)
        plan = CnnPlanner(cell.segmenter, true_tilt(cell)).plan(cell.arm)
        assert (plan.outcome, len(plan.steps)) == (PlanOutcome.ALIGNED, 7)
        assert cell.truth.viewpoint_error() < own


def test_steps_go_on_after_no_op_and_take_up_an_object_that_tips(floating):
    start(floating, 0, 0.0)
    steps = CnnPlanner(floating.segmenter, best_action(floating)).steps(floating.arm)
    assert [step.said for step in islice(steps, 3)] == [Action.NO_OP] * 3
    tip(floating, np.radians(20))
    assert floating.truth.viewpoint_error() == pytest.approx(np.radians(20), abs=CENTERING)
    assert next(steps).said is not Action.NO_OP
    assert any(step.outcome is PlanOutcome.ALIGNED for step in islice(steps, 10))
    assert floating.truth.viewpoint_error() < FLOOR


def test_the_planner_needs_no_more_than_the_arms_protocol_and_the_experiments_runner_takes_it_as_any_other(floating):
    # `Hindered` has the protocol's members and nothing else, so there is no way from it to a cell's truth.
    start(floating, 6, 0.2)
    arm = Hindered(floating.arm)
    assert isinstance(arm, EyeInHandArm)
    plan, judged = run_episode(floating, lambda cell: CnnPlanner(cell.segmenter, best_action(cell)).plan(arm))
    assert (judged.outcome, judged.views, judged.frames) == ("aligned", len(plan.steps), arm.frames)
    assert judged.total == pytest.approx(np.degrees(floating.truth.viewpoint_error()))
    assert judged.seconds > 0
