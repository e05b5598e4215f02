"""What a training refuses: sets that cannot teach, and losses that grow without bound. Thesis 2.4.4."""

from __future__ import annotations

import math

from gvp_lib.errors import DatasetError, TrainingDivergedError
from gvp_lib.learning.dataset import ViewpointDataset
from gvp_lib.learning.objectives import Objective
from gvp_lib.planning.learned import Action

__all__ = ["check_loss", "check_sets"]

# A first epoch from random weights costs up to twice as much as knowing nothing, and so may a rate that is high and
# yet learns. The bound is on the loss over the training alone: in evaluation mode such a training may pass through
# thousands before the running means of its normalizations have settled, and recover.
_HOPELESS = 6.0


def check_loss(line: dict[str, float], objective: Objective, rate: float, kept: str) -> None:
    """Whether an epoch's losses are those of a training that may yet learn.

    Parameters
    ----------
    line
        Of the history: ``epoch``, ``loss``, and ``validation_loss`` once it is known.
    objective
        What the losses are of.
    rate
        The learning rate that was asked for.
    kept
        What is left of the training, for the text.

    Raises
    ------
    TrainingDivergedError
        The training loss is over the bound, or one of the two is no finite number.
    """
    loss, bound = line["loss"], _HOPELESS * objective.ignorance
    grew = ""
    if not math.isfinite(loss):
        grew = f"training loss is {loss}"
    elif loss > bound:
        grew = (
            f"training loss grew to {loss:.3g}, over {_HOPELESS:g} times the {objective.ignorance:.3g} of a network "
            "that knows nothing"
        )
    elif not math.isfinite(line.get("validation_loss", 0.0)):
        grew = f"validation loss is {line['validation_loss']}"
    if grew:
        raise TrainingDivergedError(
            f"in epoch {line['epoch']:g} the {grew}; {kept}. A smaller learning rate than {rate:g} may do, say "
            f"{rate / 10:g}, in another folder"
        )


def check_sets(train_set: ViewpointDataset, validation_set: ViewpointDataset) -> None:
    """Whether there is something to learn, and to judge that by."""
    if len(train_set) < 2 or not len(validation_set):
        raise DatasetError(
            f"{len(train_set)} samples to train and {len(validation_set)} to validate are too few; collect more"
        )
    missing = [action.name for action in Action if action not in train_set.actions]
    if train_set.target == "action" and missing:
        near = "; NO_OP is best within 0.71 steps of the normal only, so a larger step has more of it"
        raise DatasetError(
            f"of the five actions the {len(train_set)} samples for training lack {', '.join(missing)}, so that "
            "a network cannot learn when to choose it; collect more samples, or over the whole cap"
            f"{near * (Action.NO_OP.name in missing)}"
        )
