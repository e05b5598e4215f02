"""What decides a network's weights: the thesis's defaults and losses, the rate of each step, and what is refused."""

import json
import math

import numpy as np
import pytest
import torch

from gvp_lib import TrainConfig
from gvp_lib.errors import InvalidParameterError, UnknownNameError
from gvp_lib.learning.config import OBJECTIVES, ActionObjective, TiltObjective

pytestmark = pytest.mark.check

ACTION, TILT = ActionObjective(), TiltObjective()


def test_the_defaults_are_the_thesis_s():
    config = TrainConfig()
    assert (config.network, config.target, config.size, config.shift, config.share) == (
        "resnet50",
        "action",
        64,
        8,
        0.7,
    )
    assert (config.epochs, config.batch, config.learning_rate, config.gamma, config.decay_every) == (
        20,
        32,
        1e-3,
        0.1,
        5,
    )


def test_the_rate_falls_to_a_tenth_every_five_epochs():
    rates = [TrainConfig().rate(epoch, done) for epoch in range(20) for done in (0.0, 0.9)]
    np.testing.assert_allclose(rates, np.repeat([1e-3, 1e-4, 1e-5, 1e-6], 10))


def test_one_cycle_rises_over_a_fifth_and_falls_to_nothing():
    config = TrainConfig(schedule="one cycle", epochs=10)
    rates = [config.rate(epoch, done) for epoch in range(10) for done in np.arange(0, 1, 0.1)]
    assert int(np.argmax(rates)) == 20
    assert rates[20] == pytest.approx(config.learning_rate)
    assert rates[0] < 0.03 * config.learning_rate
    assert rates[-1] < 0.001 * config.learning_rate
    assert (np.diff(rates[:21]) > 0).all()
    assert (np.diff(rates[20:]) < 0).all()


def test_it_goes_into_json_and_back_without_a_machine_s_paths():
    config = TrainConfig(weights="/home/me/first.pth", step=float(np.radians(5)))
    told = json.loads(json.dumps(config.to_dict()))
    assert TrainConfig(**told) == TrainConfig(weights="first.pth", step=config.step)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"network": "resnet51"}, r"no network named 'resnet51'\. Did you mean 'resnet50'"),
        ({"target": "roll"}, "no target named 'roll'. Known: action, tilt"),
        ({"optimizer": "adam"}, "Did you mean 'adamw'"),
        ({"schedule": "cosine"}, "Known: one cycle, steps"),
    ],
)
def test_an_unknown_name_is_refused_with_the_known_ones(options, said):
    with pytest.raises(UnknownNameError, match=said):
        TrainConfig(**options)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"epochs": 0}, "epochs is a whole number from 1 to 100000; got 0"),
        ({"epochs": 2.0}, "epochs is a whole number .* got 2.0"),
        ({"batch": 1}, "batch is a whole number from 2"),
        ({"size": 16}, "size is a whole number from 32 to 1024; got 16"),
        ({"crop": 0}, "crop is a whole number from 1"),
        ({"shift": 64}, "shift is less than size, 64 px; got 64"),
        ({"patience": 0}, "patience is a whole number from 1"),
        ({"seed": -1}, "seed is a whole number from 0"),
        ({"learning_rate": 0.0}, "learning_rate is a number from 1e-09 to 100; got 0.0"),
        ({"learning_rate": math.nan}, "learning_rate is a number .* got nan"),
        ({"learning_rate": "0.1"}, "learning_rate is a number .* got '0.1'"),
        ({"momentum": 1.0}, "momentum is a number from 0 to 0.999; got 1.0"),
        ({"gamma": 2}, "gamma is a number"),
        ({"share": 1.0}, r"share is the part that is for training, in \(0, 1\), as the thesis's 0.7; got 1.0"),
        ({"step": 5}, r"step is in radians, in \(0, pi/2\]; got 5. For degrees: np.radians"),
    ],
)
def test_a_value_that_makes_no_sense_is_refused_with_those_that_do(options, said):
    with pytest.raises(InvalidParameterError, match=said):
        TrainConfig(**options)


def outputs_of(tilts, sigma):
    """What a network would put out to say these tilts, rad, with this standard deviation, rad."""
    log_sigma = torch.full((len(tilts), 1), math.log(sigma / TILT.SCALE))
    return torch.cat([torch.as_tensor(tilts, dtype=torch.float32) / TILT.SCALE, log_sigma], dim=1)


def test_cross_entropy_is_a_2_by_hand_softmax_included():
    outputs = np.array([[2.0, 0.5, -1.0, 0.0, 0.3], [0.0, 0.0, 0.0, 0.0, 0.0]])
    targets = [1, 4]
    shares = np.exp(outputs) / np.exp(outputs).sum(axis=1, keepdims=True)
    expected = -np.mean([math.log(shares[k, target]) for k, target in enumerate(targets)])
    assert float(ACTION.loss(torch.tensor(outputs), torch.tensor(targets))) == pytest.approx(expected)
    assert float(ACTION.loss(torch.zeros(3, 5), torch.tensor([0, 1, 2]))) == pytest.approx(math.log(5))


def test_accuracy_counts_what_is_right_as_in_a_4():
    outputs = torch.eye(5)[[0, 1, 2, 3]]
    assert int(ACTION.total_score(outputs, torch.tensor([0, 1, 4, 3]))) == 3


def test_the_error_of_a_tilt_is_the_angle_between_both():
    targets = torch.tensor([[0.1, 0.0], [0.0, 0.2]])
    said = outputs_of(targets + torch.tensor([0.03, 0.04]), 0.1)
    assert float(TILT.total_score(said, targets)) == pytest.approx(2 * math.degrees(0.05), rel=1e-5)
    np.testing.assert_allclose(TILT.tilt(said)[:, 2], 0.1, rtol=1e-6)


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
    rng = np.random.default_rng(0)
    noise = rng.normal(0, 1, (20_000, 2))
    sigmas = np.radians([8, 4, 2, 1, 0.5])
    costs, losses = (
        [float(of(outputs_of(noise * sigma, sigma), torch.zeros(20_000, 2))) for sigma in sigmas]
        for of in (TILT.cost, TILT.loss)
    )
    assert (np.diff(costs) < 0).all()
    assert not (np.diff(losses) < 0).all()


def test_the_loss_weighs_samples_by_a_standard_deviation_that_learns_nothing_from_it():
    outputs = outputs_of([[0.1, 0.0]], 0.1).requires_grad_()
    target = torch.tensor([[0.0, 0.0]])
    slope = torch.autograd.grad(TILT.loss(outputs, target), outputs)[0]
    plain = torch.autograd.grad(TILT.cost(outputs, target), outputs)[0]
    torch.testing.assert_close(slope, plain * (0.1 / TILT.SCALE) ** (2 * TILT.BETA))


def test_no_output_makes_a_loss_infinite():
    wild = torch.tensor([[0.0, 0.0, 500.0], [0.0, 0.0, -500.0]])
    assert math.isfinite(float(TILT.loss(wild, torch.ones(2, 2))))
    assert {name: objective.outputs for name, objective in OBJECTIVES.items()} == {"action": 5, "tilt": 3}
