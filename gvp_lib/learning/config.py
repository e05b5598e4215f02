"""What a network is trained for, and how: objectives, and every choice that decides the weights.

Thesis 2.4.1, 2.4.3, 2.4.4, A.4, A.5; errata 20.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError, UnknownNameError
from gvp_lib.learning.resnet import ARCHITECTURES
from gvp_lib.learning.shards import as_path
from gvp_lib.picture import count
from gvp_lib.planning.plan import Action

__all__ = ["OBJECTIVES", "ActionObjective", "Objective", "TiltObjective", "TrainConfig"]


@dataclass(frozen=True)
class ActionObjective:
    """Loss to minimize and score to read, for the five actions: cross-entropy, softmax included (A.2), and accuracy.

    Attributes
    ----------
    outputs
        Number of outputs per picture.
    score
        Name of the score in a training's history.
    ignorance
        Loss of a network that knows nothing about any picture and says so, positive.
    """

    outputs, score = len(Action), "accuracy"
    ignorance = math.log(len(Action))

    def loss(self, outputs: Tensor, targets: Tensor) -> Tensor:
        """Mean loss of a batch, a scalar; outputs (n, :attr:`outputs`), targets int64 (n,)."""
        return functional.cross_entropy(outputs, targets)

    cost = loss

    def total_score(self, outputs: Tensor, targets: Tensor) -> Tensor:
        """Sum of the scores of a batch, a scalar: the number of correct answers (Eq. A.4)."""
        return (outputs.argmax(dim=1) == targets).sum()


@dataclass(frozen=True)
class TiltObjective:
    """Negative log-likelihood of a Gaussian over the tilt along u and v, with one standard deviation for both.

    The three outputs are the tilt along u and v over :data:`SCALE`, and the logarithm of their standard deviation over
    it. In the loss each sample is weighted by its predicted standard deviation, held constant, to the power of 2 beta:
    without the weights, samples that are hard at first are soon called uncertain and never learned (Seitzer et al.,
    2022). Such a loss does not rank networks, since it also rises where errors and their standard deviations shrink
    together below 3 deg. The cost does: it is the likelihood itself. The score is the angle between prediction and
    truth, deg.
    """

    SCALE = 0.25  # rad
    BETA = 0.5
    _LEAST, _MOST = np.log(np.radians([0.02, 60]) / SCALE)  # bounds of the logarithm, beyond what an image can tell
    outputs, score = 3, "error_deg"
    ignorance = float(2 * _MOST * np.exp(2 * BETA * _MOST))  # errors add less than a tenth to it

    def loss(self, outputs: Tensor, targets: Tensor) -> Tensor:
        """Mean weighted loss; targets float32 (n, 2), rad."""
        weights = torch.exp(2 * self.BETA * self._log_sigma(outputs).detach())
        return (self._surprisal(outputs, targets) * weights).mean()

    def cost(self, outputs: Tensor, targets: Tensor) -> Tensor:
        """Mean negative log-likelihood without weights, up to a constant."""
        return self._surprisal(outputs, targets).mean()

    def total_score(self, outputs: Tensor, targets: Tensor) -> Tensor:
        """Sum of the angles, deg."""
        return torch.rad2deg((outputs[:, :2] * self.SCALE - targets).norm(dim=1)).sum()

    def total_surprise(self, outputs: Tensor, targets: Tensor) -> Tensor:
        """Sum of squared errors over predicted variances; 1 per sample, on average, where those are right."""
        tilt = self.tilt(outputs)
        return ((tilt[:, :2] - targets).square().sum(dim=1) / (2 * tilt[:, 2].square())).sum()

    def tilt(self, outputs: Tensor) -> Tensor:
        """Tilt along u and v and its standard deviation, shape (n, 3), rad."""
        return torch.cat([outputs[:, :2], torch.exp(self._log_sigma(outputs))[:, None]], dim=1) * self.SCALE

    def _surprisal(self, outputs: Tensor, targets: Tensor) -> Tensor:
        """Negative log-likelihood of each sample, shape (n,)."""
        square = (outputs[:, :2] - targets / self.SCALE).square().sum(dim=1)
        log_sigma = self._log_sigma(outputs)
        return square / 2 * torch.exp(-2 * log_sigma) + 2 * log_sigma  # two components, one standard deviation

    def _log_sigma(self, outputs: Tensor) -> Tensor:
        return outputs[:, 2].clamp(self._LEAST, self._MOST)


Objective: TypeAlias = ActionObjective | TiltObjective
OBJECTIVES: Mapping[str, Objective] = {"action": ActionObjective(), "tilt": TiltObjective()}
"""Objectives by the target of :class:`gvp_lib.ViewpointDataset`."""


def score_text(target: str, score: float) -> str:
    """A score with its name and unit."""
    return f"accuracy {score:.3g}" if target == "action" else f"error {score:.3g} deg"


@checked
@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """Configuration of a training; by default the thesis's, but from random weights instead of ImageNet's.

    What the thesis leaves open is ours: stochastic gradient descent with momentum 0.9 and no weight decay, images
    normalized by ImageNet's mean and standard deviation, samples shuffled at each epoch, the last batch kept.

    Parameters
    ----------
    network
        Architecture: ``"resnet50"``, ``"resnet18"`` or ``"resnet18_half"``.
    weights
        Initial weights: None for random ones; ``"imagenet"``, downloaded from their publisher; a file; or the name of a
        network that comes with the library.
    target
        What is learned: ``"action"``, the best of the five actions; ``"tilt"``, the direction and angle to the normal,
        with their uncertainty.
    size
        Side of the network's input images, px.
    crop
        Side of the central square cut from each stored image, px; None for the whole image.
    shift
        Largest random shift of an image, px of ``size``. For these three see :class:`gvp_lib.ViewpointDataset`.
    dihedral
        Whether to augment by the square's eight symmetries: random quarter turns and mirror images, with their targets.
    colors
        Whether to augment by mixing the color channels of each image at random, so that no color is learned.
    step
        Angle of an action, rad; None for the one that the set was labeled for.
    share
        Share of the samples to train on; the others validate.
    epochs
        Number of epochs.
    batch
        Batch size.
    optimizer
        ``"sgd"``, with ``momentum``, or ``"adamw"``.
    learning_rate, momentum, weight_decay
        Parameters of the optimizer.
    schedule
        Schedule of the learning rate. ``"steps"``: multiply it by ``gamma`` every ``decay_every`` epochs.
        ``"one cycle"``: warm up over the first fifth of the training, then anneal to zero along a cosine.
    gamma, decay_every
        Parameters of ``"steps"``.
    patience
        Epochs without a lower validation loss after which to stop early, keeping the best weights; None to run every
        epoch and keep the last.
    seed
        Seed of the initial weights, the split, the order and the augmentation.

    Examples
    --------
    >>> TrainConfig(network="resnet18", target="tilt", dihedral=True, epochs=5)
    TrainConfig(resnet18, tilt, 64 px, 5 epochs, batch 32, sgd, lr 0.001 (steps), shift 8 px, dihedral, seed 0)
    """

    network: str = "resnet50"
    weights: str | Path | None = None
    target: Literal["action", "tilt"] = "action"
    size: int = 64
    crop: int | None = None
    shift: int = 8
    dihedral: bool = False
    colors: bool = False
    step: float | None = None
    share: float = 0.7
    epochs: int = 20
    batch: int = 32
    optimizer: Literal["sgd", "adamw"] = "sgd"
    learning_rate: float = 1e-3
    momentum: float = 0.9
    weight_decay: float = 0.0
    schedule: Literal["steps", "one cycle"] = "steps"
    gamma: float = 0.1
    decay_every: int = 5
    patience: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        for name, known in _KNOWN.items():
            if getattr(self, name) not in tuple(known):
                raise UnknownNameError(name, getattr(self, name), known)
        for name, (low, high, unit) in _RANGES.items():
            value = getattr(self, name)
            if isinstance(value, np.generic):  # JSON knows none of NumPy's
                value = value.item()
                object.__setattr__(self, name, value)
            if value is None and name in _OPTIONAL:
                continue
            number, kind = ("whole number", int) if isinstance(low, int) else ("number", int | float)
            if isinstance(value, bool) or not isinstance(value, kind) or not low <= value <= high:
                raise InvalidParameterError(f"{name} is a {number} from {low:g} to {high:g}{unit}; got {value!r}")
        if self.weights is not None:
            path = as_path(self.weights, "weights are", "None, 'imagenet', the path of a file, or a network's name")
            name = str(self.weights)
            is_path = path.suffix or path.name != name  # else it is a name; a path is of today's folder
            object.__setattr__(self, "weights", str(path) if is_path else name)
        if self.shift >= self.size:
            raise InvalidParameterError(f"shift is less than size, {self.size} px; got {self.shift}")

    def __repr__(self) -> str:
        start = () if self.weights is None else (f"from {Path(self.weights).name}",)
        augmentation = [name for name in ("dihedral", "colors") if getattr(self, name)]
        parts = (
            self.network, *start, self.target, f"{self.size} px", count(self.epochs, "epoch"), f"batch {self.batch}",
            self.optimizer, f"lr {self.learning_rate:g} ({self.schedule})", f"shift {self.shift} px", *augmentation,
            f"seed {self.seed}",
        )  # fmt: skip
        return f"TrainConfig({', '.join(parts)})"

    def rate(self, epoch: int, done: float) -> float:
        """Learning rate at a fractional epoch.

        Parameters
        ----------
        epoch
            Number of the epoch, from 0.
        done
            Share of the epoch that is done, in [0, 1).
        """
        if self.schedule == "steps":
            return self.learning_rate * self.gamma ** (epoch // self.decay_every)
        progress, rise = (epoch + done) / self.epochs, 0.2
        if progress < rise:
            return self.learning_rate * (progress / rise * 0.98 + 0.02)
        return self.learning_rate * (1 + math.cos(math.pi * (progress - rise) / (1 - rise))) / 2

    def to_dict(self) -> dict[str, Any]:
        """JSON data of all fields; of a file of weights only the name."""
        return asdict(self) | {"weights": None if self.weights is None else Path(self.weights).name}


_KNOWN: Mapping[str, Collection[str]] = {
    "network": ARCHITECTURES,
    "target": OBJECTIVES,
    "optimizer": ("sgd", "adamw"),
    "schedule": ("steps", "one cycle"),
}
_RANGES: Mapping[str, tuple[float, float, str]] = {  # whole numbers where the least is one
    "size": (32, 1024, " px"),
    "crop": (1, 100_000, " px"),
    "shift": (0, 1023, " px"),
    "step": (1e-6, math.pi / 2, " rad, np.radians(...) of degrees"),
    "share": (0.001, 0.999, ", the part that is for training, as the thesis's 0.7"),
    "epochs": (1, 100_000, ""),
    "batch": (2, 100_000, ""),
    "learning_rate": (1e-9, 100.0, ""),
    "momentum": (0.0, 0.999, ""),
    "weight_decay": (0.0, 10.0, ""),
    "gamma": (1e-6, 1.0, ""),
    "decay_every": (1, 100_000, ""),
    "patience": (1, 100_000, ""),
    "seed": (0, 2**63 - 1, ""),
}
_OPTIONAL = ("crop", "step", "patience")
