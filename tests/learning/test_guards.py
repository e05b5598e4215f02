"""What a training refuses: losses that grow, and sets that cannot teach."""

import math

import numpy as np
import pytest

from gvp_lib.errors import DatasetError, TrainingDivergedError
from gvp_lib.learning.guards import check_loss, check_sets
from gvp_lib.learning.objectives import OBJECTIVES

pytestmark = pytest.mark.check


def check(target, **line):
    check_loss({"epoch": 3, **line}, OBJECTIVES[target], 0.1, "the weights of epoch 2 are kept")


@pytest.mark.parametrize("target", OBJECTIVES)
def test_a_loss_passes_up_to_six_times_that_of_knowing_nothing(target):
    bound = 6 * OBJECTIVES[target].ignorance
    check(target, loss=0.99 * bound, validation_loss=1e6)  # which a training may pass through and recover from
    with pytest.raises(TrainingDivergedError, match=r"in epoch 3 the training loss grew .*epoch 2 are kept.*say 0\.01"):
        check(target, loss=1.01 * bound)


@pytest.mark.parametrize("worth", [math.nan, math.inf])
def test_a_loss_that_is_no_finite_number_is_named(worth):
    with pytest.raises(TrainingDivergedError, match=f"the training loss is {worth}"):
        check("action", loss=worth)
    with pytest.raises(TrainingDivergedError, match=f"the validation loss is {worth}"):
        check("action", loss=1.0, validation_loss=worth)


class Samples:
    def __init__(self, *actions, target="action"):
        self.actions, self.target = np.array(actions), target

    def __len__(self):
        return len(self.actions)


def test_sets_teach_if_each_action_occurs_among_those_for_training():
    check_sets(Samples(0, 1, 2, 3, 4), Samples(0))
    check_sets(Samples(0, 1, target="tilt"), Samples(0))  # of a tilt there are no classes
    with pytest.raises(DatasetError, match="4 samples for training lack NO_OP"):
        check_sets(Samples(0, 1, 2, 3), Samples(4))


@pytest.mark.parametrize(("train", "validation"), [((0,), (0,)), ((0, 1, 2, 3, 4), ())])
def test_sets_that_are_too_few_are_refused(train, validation):
    with pytest.raises(DatasetError, match=f"{len(train)} samples to train and {len(validation)} to validate"):
        check_sets(Samples(*train), Samples(*validation))
