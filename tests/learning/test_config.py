"""What decides a network's weights: the thesis's defaults and losses, the rate of each step, and what is refused."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch

from gvp_lib import TrainConfig
from gvp_lib.errors import GvpError
from gvp_lib.learning.config import OBJECTIVES

pytestmark = pytest.mark.check

TILT = OBJECTIVES["tilt"]


def test_the_defaults_are_the_thesis_s():
    config = TrainConfig()
    thesis = {"network": "resnet50", "target": "action", "size": 64, "shift": 8, "share": 0.7, "epochs": 20}
    thesis |= {"batch": 32, "learning_rate": 1e-3, "gamma": 0.1, "decay_every": 5}
    assert {name: getattr(config, name) for name in thesis} == thesis


def test_the_rate_falls_to_a_tenth_every_five_epochs_or_rises_over_a_fifth_and_falls_to_nothing():
    rates = [TrainConfig().rate(epoch, done) for epoch in range(20) for done in (0.0, 0.9)]
    np.testing.assert_allclose(rates, np.repeat([1e-3, 1e-4, 1e-5, 1e-6], 10))
    cycle = TrainConfig(schedule="one cycle", epochs=10, learning_rate=1.0)
    rates = [cycle.rate(epoch, done) for epoch, done in ((0, 0), (1, 0), (2, 0), (6, 0), (9, 1))]
    np.testing.assert_allclose(rates, [0.02, 0.51, 1, 0.5, 0], atol=1e-12)


def test_it_goes_into_json_and_back_without_a_machine_s_paths():
    config = TrainConfig(weights="/home/me/first.pth", step=float(np.radians(5)))
    stored = json.loads(json.dumps(config.to_dict()))
    assert TrainConfig(**stored) == TrainConfig(weights=Path("first.pth"), step=config.step)


def test_numbers_of_numpy_are_numbers():
    config = TrainConfig(epochs=np.int64(3), step=np.float32(0.125), batch=np.uint8(8))
    assert config == TrainConfig(epochs=3, step=0.125, batch=8)
    assert json.dumps(config.to_dict()) == json.dumps(TrainConfig(epochs=3, step=0.125, batch=8).to_dict())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"network": "resnet51"}, r"no network named 'resnet51'\. Did you mean 'resnet50'"),
        ({"network": ["resnet50"]}, r"no network named \['resnet50'\]"),
        ({"weights": 7}, "weights are None, 'imagenet', the path of a file, or a network's name; got a int: 7"),
        ({"epochs": np.float64(2.5)}, "epochs is a whole number from 1 to 100000; got 2.5"),
        ({"epochs": 0}, "epochs is a whole number from 1 to 100000; got 0"),
        ({"batch": True}, "batch is a whole number from 2 to 100000; got True"),
        ({"shift": 64}, "shift is less than size, 64 px; got 64"),
        ({"learning_rate": math.nan}, "learning_rate is a number from 1e-09 to 100; got nan"),
        ({"share": 1.0}, "share is a number .* the part that is for training, as the thesis's 0.7; got 1.0"),
        ({"step": 5}, r"step is a number from 1e-06 to 1.5708 rad, np.radians\(...\) of degrees; got 5"),
    ],
)
def test_a_value_that_makes_no_sense_is_refused_with_those_that_do(options, message):
    with pytest.raises(GvpError, match=message):
        TrainConfig(**options)


def outputs_of(tilts, sigma):
    """What a network would put out to say these tilts, rad, with this standard deviation, rad."""
    log_sigma = torch.full((len(tilts), 1), math.log(sigma / TILT.SCALE))
    return torch.cat([torch.as_tensor(tilts, dtype=torch.float32) / TILT.SCALE, log_sigma], dim=1)


@pytest.mark.parametrize(("target", "outputs"), [("action", [0.0] * 5), ("tilt", [0.0, 0.0, 9.0])])
def test_a_network_that_knows_nothing_costs_what_its_objective_says(target, outputs):
    objective = OBJECTIVES[target]
    targets = torch.arange(5) if target == "action" else torch.full((5, 2), 0.3)
    found = float(objective.loss(torch.tensor([outputs] * 5), targets))
    assert found == pytest.approx(objective.ignorance, rel=0.1)


def test_the_error_of_a_tilt_is_the_angle_between_both():
    outputs = outputs_of([[0.13, 0.04], [0.03, 0.24]], 0.1)
    found = TILT.total_score(outputs, torch.tensor([[0.1, 0.0], [0.0, 0.2]]))
    assert float(found) == pytest.approx(2 * math.degrees(0.05), rel=1e-5)


def test_the_likelihood_is_best_at_the_true_standard_deviation_and_calibration_is_one_there():
    sigma, n = 0.05, 20_000
    rng = np.random.default_rng(0)
    truth = rng.uniform(-0.4, 0.4, (n, 2))
    targets = torch.tensor(truth + rng.normal(0, sigma, (n, 2)), dtype=torch.float32)
    named = sigma * np.array([0.5, 0.8, 0.9, 1.0, 1.1, 1.25, 2.0])
    costs = [float(TILT.cost(outputs_of(truth, s), targets)) for s in named]
    assert named[int(np.argmin(costs))] == sigma
    calibrations = [math.sqrt(float(TILT.total_surprise(outputs_of(truth, s), targets)) / n) for s in named]
    np.testing.assert_allclose(calibrations, sigma / named, rtol=0.02)


def test_the_cost_ranks_ever_better_networks_which_the_loss_does_not():
    noise = np.random.default_rng(0).normal(0, 1, (20_000, 2))
    sigmas = np.radians([8, 4, 2, 1, 0.5])
    costs, losses = (
        [float(of(outputs_of(noise * sigma, sigma), torch.zeros(20_000, 2))) for sigma in sigmas]
        for of in (TILT.cost, TILT.loss)
    )
    assert (np.diff(costs) < 0).all()
    assert not (np.diff(losses) < 0).all()


def test_the_loss_weighs_samples_by_a_standard_deviation_that_learns_nothing_from_it():
    outputs, target = outputs_of([[0.1, 0.0]], 0.1).requires_grad_(), torch.tensor([[0.0, 0.0]])
    slope = torch.autograd.grad(TILT.loss(outputs, target), outputs)[0]
    plain = torch.autograd.grad(TILT.cost(outputs, target), outputs)[0]
    torch.testing.assert_close(slope, plain * (0.1 / TILT.SCALE) ** (2 * TILT.BETA))


def test_no_output_makes_a_loss_infinite():
    wild = torch.tensor([[0.0, 0.0, 500.0], [0.0, 0.0, -500.0]])
    assert math.isfinite(float(TILT.loss(wild, torch.ones(2, 2))))
