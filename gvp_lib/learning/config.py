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

from gvp_lib.errors import InvalidParameterError, UnknownNameError
from gvp_lib.learning.resnet import NETWORKS
from gvp_lib.planning.plan import Action

__all__ = ["OBJECTIVES", "ActionObjective", "Objective", "TiltObjective", "TrainConfig"]


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
    ignorance = math.log(len(Action))  # all alike

    def loss(self, outputs: Tensor, targets: Tensor) -> Tensor:
        """Mean loss of a batch, a scalar; outputs (n, :attr:`outputs`), targets int64 (n,)."""
        return functional.cross_entropy(outputs, targets)

    cost = loss
    """Mean by which to rank networks on samples they have not learned from, a scalar."""

    def total_score(self, outputs: Tensor, targets: Tensor) -> Tensor:
        """Sum of the scores of a batch, a scalar: the number of correct answers (Eq. A.4)."""
        return (outputs.argmax(dim=1) == targets).sum()


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
    _LEAST, _MOST = np.log(np.radians([0.02, 60]) / SCALE)  # of the logarithm; beyond that no picture tells
    outputs, score = 3, "error_deg"
    ignorance = float(2 * _MOST * np.exp(2 * BETA * _MOST))  # at the largest: errors add less than a tenth to it

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


@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """How a network is trained. The defaults are the thesis's, except that its first weights are ImageNet's.

    What the thesis leaves open is ours: stochastic gradient descent with momentum 0.9 and no weight decay, pictures
    normalized by ImageNet's mean and standard deviation, samples shuffled at each epoch, the last batch as it comes.

    Attributes
    ----------
    network
        ``"resnet50"``, ``"resnet18"`` or ``"resnet18_half"``.
    weights
        Initial weights: None for random ones; ``"imagenet"``, downloaded from their publisher; a file; or the name of a
        network that comes with the library.
    target
        ``"action"``, the best of the five actions; or ``"tilt"``, the way to the normal and how certain that is.
    size
        Side of the pictures shown, px.
    crop
        Side of the middle square taken of each stored picture, px; None for all of it.
    shift
        Largest random shift of a picture, px. For these three see :class:`gvp_lib.ViewpointDataset`.
    turns
        Whether to rotate pictures by quarter turns and mirror them at random, and their targets with them.
    colors
        Whether to mix the channels of each picture at random, so that no color is learned.
    step
        Step of the actions, rad, where it differs from the one the set was labeled for.
    share
        Share of the samples to train on.
    epochs
        Passes over the samples.
    batch
        Samples per step.
    optimizer
        ``"sgd"``, with ``momentum``, or ``"adamw"``.
    learning_rate, momentum, weight_decay
        Parameters of the optimizer.
    schedule
        ``"steps"``: multiply the rate by ``gamma`` every ``decay_every`` epochs; ``"one cycle"``: warm up over the
        first fifth of the training, then anneal to zero along a cosine.
    gamma, decay_every
        Parameters of ``"steps"``.
    patience
        Epochs without a lower validation loss after which to stop and keep the best weights; None for neither.
    seed
        Seed of the initial weights, the split, the order and the shifts.
    """

    network: str = "resnet50"
    weights: str | None = None
    target: Literal["action", "tilt"] = "action"
    size: int = 64
    crop: int | None = None
    shift: int = 8
    turns: bool = False
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
            if getattr(self, name) not in known:
                raise UnknownNameError(name, getattr(self, name), known)
        for name, (low, high, unit) in _RANGES.items():
            value = getattr(self, name)
            if value is None and name in _OPTIONAL:
                continue
            number, kind = ("whole number", int) if isinstance(low, int) else ("number", int | float)
            if isinstance(value, bool) or not isinstance(value, kind) or not low <= value <= high:
                raise InvalidParameterError(f"{name} is a {number} from {low:g} to {high:g}{unit}; got {value!r}")
        if self.shift >= self.size:
            raise InvalidParameterError(f"shift is less than size, {self.size} px; got {self.shift}")

    def rate(self, epoch: int, done: float) -> float:
        """Learning rate at a fractional epoch: ``epoch``, from 0, plus the share of it that is ``done``, in [0, 1)."""
        if self.schedule == "steps":
            return self.learning_rate * self.gamma ** (epoch // self.decay_every)
        progress, rise = (epoch + done) / self.epochs, 0.2
        if progress < rise:
            return self.learning_rate * (progress / rise * 0.98 + 0.02)
        return self.learning_rate * (1 + math.cos(math.pi * (progress - rise) / (1 - rise))) / 2

    def to_dict(self) -> dict[str, Any]:
        """JSON data, with the name alone of a file of weights."""
        return asdict(self) | {"weights": None if self.weights is None else Path(self.weights).name}


_KNOWN: Mapping[str, Collection[str]] = {
    "network": NETWORKS,
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
