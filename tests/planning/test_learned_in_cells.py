"""The learned planner's closed loop in simulated cells, with policies that know the truth."""

import numpy as np
import pytest

from gvp_lib import VirtualSphere, WorkCell
from gvp_lib.learning.labels import label_view
from gvp_lib.planning.learned import CnnPlanner
from gvp_lib.planning.plan import PlanOutcome, Tilt
from gvp_lib.simulation.sensors import Noise

STEP = np.radians(5)
FLOOR = 0.707 * STEP + np.radians(0.5)  # that four directions leave at most, and a centering to 2 px


def best_action(cell):
    return lambda rgb: label_view(cell.truth.world_from_camera, cell.truth.normal, STEP).action


def true_tilt(cell):
    def policy(rgb):
        return Tilt.toward(cell.truth.world_from_camera.rotation.inv().apply([*cell.truth.normal.direction]), 1e-6)

    return policy


def start(cell, rng, tilt=None):
    """Stand the camera uniformly in the 30 deg cap about the accepted normal, at any roll."""
    tilt = np.arccos(rng.uniform(np.cos(np.radians(30)), 1)) if tilt is None else tilt
    azimuth, roll = rng.uniform(0, 2 * np.pi, 2)
    sphere = VirtualSphere(cell.truth.world_from_object.translation, 0.5, cell.truth.normal.direction)
    cell.place_camera(sphere.viewpoint(tilt, azimuth, roll))


def test_five_true_actions_end_as_near_to_the_normal_as_four_directions_allow():
    rng, errors = np.random.default_rng(0), []
    with WorkCell(arm="floating", target="cuboid_1x2", seed=3) as cell:
        for _ in range(16):
            start(cell, rng)
            plan = CnnPlanner(cell.segmenter, best_action(cell)).plan(cell.arm)
            assert plan.outcome is PlanOutcome.ALIGNED
            errors.append(cell.truth.viewpoint_error())
    assert max(errors) < FLOOR
    assert np.mean(errors) == pytest.approx(0.383 * STEP, abs=0.08 * STEP)  # n = 16; sd 0.14 steps


@pytest.mark.parametrize("noise", [None, Noise.thesis()], ids=["without noise", "with the thesis's"])
def test_a_real_arm_ends_as_near_but_for_its_own_errors_and_surveys(noise):
    own = np.radians(0.05 if noise is None else 1)
    with WorkCell(arm="ur5e", target="cuboid_1x2", noise=noise, seed=3) as cell:
        for seed, tilt, policy, within in ((1, 0.38, best_action, FLOOR + own), (0, 0.4, true_tilt, own)):
            start(cell, np.random.default_rng(seed), tilt)
            plan = CnnPlanner(cell.segmenter, policy(cell)).plan(cell.arm)
            assert plan.outcome is PlanOutcome.ALIGNED
            assert cell.truth.viewpoint_error() < within
    assert len(plan.steps) == 7  # a look, and a survey of six
