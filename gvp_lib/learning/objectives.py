"""What a network is trained for: the best of five actions, or the way to the normal. Thesis 2.4.4, A.4, A.5."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Literal

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from gvp_lib.planning.learned import Action

__all__ = ["OBJECTIVES", "ActionObjective", "Objective", "TiltObjective"]


class Objective(ABC):
    """A loss, and a score that a reader understands.

    Attributes
    ----------
    outputs
        Numbers that the network puts out for each picture.
    score
        Name of the score in a training's history.
    ignorance
        Loss of a network that knows nothing of any picture, and how little it knows: positive.
    """

    outputs: int
    ignorance: float
    score: Literal["accuracy", "error_deg"]

    @abstractmethod
    def loss(self, outputs: Tensor, targets: Tensor) -> Tensor:
        """Mean loss of a batch, a scalar; outputs (n, :attr:`outputs`)."""

    def cost(self, outputs: Tensor, targets: Tensor) -> Tensor:
        """What tells which of two networks is the better one on samples not learned from: a mean, a scalar."""
        return self.loss(outputs, targets)

    @abstractmethod
    def total_score(self, outputs: Tensor, targets: Tensor) -> Tensor:
        """Sum of the scores of a batch, a scalar."""

    def total_surprise(self, outputs: Tensor, targets: Tensor) -> Tensor | None:
        """Sum of the squared errors, each over what the network expects of it; None for one that expects nothing."""
        return None


class ActionObjective(Objective):
    """Cross-entropy of the five actions, softmax included (A.2); scored by the share that is right (Eq. A.4)."""

    outputs, score = len(Action), "accuracy"
    ignorance = math.log(len(Action))  # all alike

    def loss(self, outputs: Tensor, targets: Tensor) -> Tensor:
        """Targets int64 (n,)."""
        return functional.cross_entropy(outputs, targets)

    def total_score(self, outputs: Tensor, targets: Tensor) -> Tensor:
        """How many are right."""
        return (outputs.argmax(dim=1) == targets).sum()


class TiltObjective(Objective):
    """Where the normal lies along u and v, and how sure that is: a Gaussian's negative log-likelihood.

    The three outputs are the tilt along u and v over :data:`SCALE` and the logarithm of their standard deviation over
    it. Each sample counts by the standard deviation that it was given, held constant, to the power of 2 beta: without
    that, what is hard at first is soon called uncertain and no longer learned (Seitzer et al., 2022). Such a loss does
    not rank networks: it also rises where errors and their standard deviations shrink together below 3 deg. The cost
    does, the likelihood itself. Scored by the angle between prediction and truth, deg.
    """

    outputs, score = 3, "error_deg"
    SCALE = 0.25  # rad
    BETA = 0.5
    _LEAST, _MOST = np.log(np.radians([0.02, 60]) / SCALE)  # of the logarithm; beyond that no picture tells
    ignorance = float(2 * _MOST * np.exp(2 * BETA * _MOST))  # the most: what errors add to that is less than a tenth

    def loss(self, outputs: Tensor, targets: Tensor) -> Tensor:
        """Targets float32 (n, 2), rad."""
        weights = torch.exp(2 * self.BETA * self._log_sigma(outputs).detach())
        return (self._surprisal(outputs, targets) * weights).mean()

    def cost(self, outputs: Tensor, targets: Tensor) -> Tensor:
        """Mean negative log-likelihood, every sample alike; less a constant."""
        return self._surprisal(outputs, targets).mean()

    def _surprisal(self, outputs: Tensor, targets: Tensor) -> Tensor:
        """Negative log-likelihood of each sample, shape (n,)."""
        square = (outputs[:, :2] - targets / self.SCALE).square().sum(dim=1)
        log_sigma = self._log_sigma(outputs)
        return square / 2 * torch.exp(-2 * log_sigma) + 2 * log_sigma  # two components, one standard deviation

    def total_score(self, outputs: Tensor, targets: Tensor) -> Tensor:
        """Sum of the angles, deg."""
        return torch.rad2deg((outputs[:, :2] * self.SCALE - targets).norm(dim=1)).sum()

    def total_surprise(self, outputs: Tensor, targets: Tensor) -> Tensor:
        """1 for each sample, on average, where the standard deviations are right."""
        tilt = self.tilt(outputs)
        return ((tilt[:, :2] - targets).square().sum(dim=1) / (2 * tilt[:, 2].square())).sum()

    def tilt(self, outputs: Tensor) -> Tensor:
        """Tilt along u and v and its standard deviation, shape (n, 3), rad."""
        return torch.cat([outputs[:, :2], torch.exp(self._log_sigma(outputs))[:, None]], dim=1) * self.SCALE

    def _log_sigma(self, outputs: Tensor) -> Tensor:
        return outputs[:, 2].clamp(self._LEAST, self._MOST)


OBJECTIVES: Mapping[str, Objective] = {"action": ActionObjective(), "tilt": TiltObjective()}
"""By the target of :class:`gvp_lib.learning.dataset.ViewpointDataset`."""
