"""What decides a network's weights: the thesis's defaults, the rate of each step, and what is refused."""

import json
import math

import numpy as np
import pytest

from gvp_lib import TrainConfig
from gvp_lib.errors import InvalidParameterError, UnknownNameError

pytestmark = pytest.mark.check


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
