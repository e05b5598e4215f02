"""How a network is trained: every choice that decides its weights. Thesis 2.4.1, 2.4.3, 2.4.4; errata 20."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from gvp_lib.errors import InvalidParameterError, UnknownNameError
from gvp_lib.learning.objectives import OBJECTIVES
from gvp_lib.learning.resnet import NETWORKS

__all__ = ["TrainConfig"]


@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """How a network is trained. The defaults are the thesis's, but its first weights are ImageNet's.

    What the thesis leaves open is ours: stochastic gradient descent with momentum 0.9 and no weight decay, pictures
    normalized by ImageNet's mean and standard deviation, samples shuffled at each epoch, the last batch as it comes.

    Attributes
    ----------
    network
        ``"resnet50"``, ``"resnet18"`` or ``"resnet18_half"``.
    weights
        To begin with: None for random ones; ``"imagenet"``, which are fetched from their publisher; a file; or the name
        of a network that comes with the library.
    target
        ``"action"``: which of the five actions is best; ``"tilt"``: the way to the normal, and how sure that is.
    size, crop, shift
        Side of the pictures; of the middle that is taken of the stored ones, None for all of it; and the most that they
        are shifted by: px. See :class:`gvp_lib.ViewpointDataset`.
    turns
        Whether pictures are turned by quarters of a turn and mirrored at random, and their targets with them.
    colors
        Whether the channels of each picture are mixed at random, so that no color is learned.
    step
        Of the actions, rad, where another is wanted than the set was labeled for.
    share
        Of the samples that are for training.
    epochs, batch
        Times that every sample is seen, and samples per step.
    optimizer
        ``"sgd"``, with ``momentum``, or ``"adamw"``.
    learning_rate, momentum, weight_decay
        Of the optimizer.
    schedule
        ``"steps"``: the rate is multiplied by ``gamma`` every ``decay_every`` epochs; ``"one cycle"``: it rises from
        nothing over the first fifth of the training and falls to nothing along a cosine.
    gamma, decay_every
        Of ``"steps"``.
    patience
        Stop after so many epochs in which the validation loss did not fall, and keep the weights of the best; None for
        neither.
    seed
        Of the first weights, the split, the order and the shifts.
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
        for name, low, high in _WHOLE:
            value = getattr(self, name)
            if name in ("crop", "patience") and value is None:
                continue
            if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
                raise InvalidParameterError(f"{name} is a whole number from {low} to {high}; got {value!r}")
        for name, low_limit, high_limit in _REAL:
            if not (_is_real(value := getattr(self, name)) and low_limit <= value <= high_limit):
                raise InvalidParameterError(f"{name} is a number from {low_limit:g} to {high_limit:g}; got {value!r}")
        if not (_is_real(self.share) and 0 < self.share < 1):
            raise InvalidParameterError(
                f"share is the part that is for training, in (0, 1), as the thesis's 0.7; got {self.share!r}"
            )
        if self.step is not None and not (_is_real(self.step) and 0 < self.step <= math.pi / 2):
            raise InvalidParameterError(
                f"step is in radians, in (0, pi/2]; got {self.step!r}. For degrees: np.radians(...)"
            )
        if self.shift >= self.size:
            raise InvalidParameterError(f"shift is less than size, {self.size} px; got {self.shift}")

    def rate(self, epoch: int, done: float) -> float:
        """Learning rate in an epoch, counted from 0, of which a share is done, in [0, 1)."""
        if self.schedule == "steps":
            return self.learning_rate * self.gamma ** (epoch // self.decay_every)
        progress, rise = (epoch + done) / self.epochs, 0.2
        if progress < rise:
            return self.learning_rate * (progress / rise * 0.98 + 0.02)
        return self.learning_rate * (1 + math.cos(math.pi * (progress - rise) / (1 - rise))) / 2

    def to_dict(self) -> dict[str, Any]:
        """As JSON data."""
        return asdict(self) | {"weights": None if self.weights is None else Path(self.weights).name}


def _is_real(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


_KNOWN: dict[str, Collection[str]] = {
    "network": NETWORKS,
    "target": OBJECTIVES,
    "optimizer": ("sgd", "adamw"),
    "schedule": ("steps", "one cycle"),
}
_WHOLE = (
    ("size", 32, 1024),
    ("crop", 1, 100_000),
    ("shift", 0, 1023),
    ("epochs", 1, 100_000),
    ("batch", 2, 100_000),
    ("decay_every", 1, 100_000),
    ("patience", 1, 100_000),
    ("seed", 0, 2**63 - 1),
)
_REAL = (("learning_rate", 1e-9, 100.0), ("momentum", 0.0, 0.999), ("weight_decay", 0.0, 10.0), ("gamma", 1e-6, 1.0))
