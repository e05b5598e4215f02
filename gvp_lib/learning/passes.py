"""A network over all samples of a set, once: to learn from them, or to be judged by them. Thesis 2.4.4, 2.4.5."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from gvp_lib.errors import DatasetError
from gvp_lib.learning.config import TrainConfig
from gvp_lib.learning.dataset import ViewpointDataset
from gvp_lib.learning.objectives import OBJECTIVES, Objective
from gvp_lib.learning.resnet import ResNet, normalized

__all__ = ["evaluate", "optimizer_of", "pass_over"]

_AT_ONCE = 256  # pictures in one pass where nothing is learned


def evaluate(network: ResNet, data: ViewpointDataset, device: str = "cpu") -> dict[str, float]:
    """A network over a set, in evaluation mode.

    Returns
    -------
    dict
        Mean ``loss``, which is the objective's ``cost``, and mean score (``accuracy`` or ``error_deg``). Of tilts also
        ``calibration``: by what the standard deviations that the network names are to be multiplied to be those of its
        errors here.

    Raises
    ------
    DatasetError
        The set is empty.
    """
    if not len(data):
        raise DatasetError(
            f"of no samples there is no mean: the split {data.split!r} of the set is empty; collect more, or choose "
            "another share"
        )
    objective = OBJECTIVES[data.target]
    network.eval()
    loss = score = surprise = 0.0
    with torch.inference_mode():
        for _, indices in _batches(np.arange(len(data)), _AT_ONCE):
            images, targets = (part.to(device) for part in data.batch(indices))
            outputs = network(normalized(images))
            loss += float(objective.cost(outputs, targets)) * len(indices)
            score += float(objective.total_score(outputs, targets))
            expected = objective.total_surprise(outputs, targets)
            surprise += 0.0 if expected is None else float(expected)
    found = {"loss": loss / len(data), objective.score: score / len(data)}
    return found | ({"calibration": math.sqrt(surprise / len(data))} if data.target == "tilt" else {})


def optimizer_of(network: ResNet, config: TrainConfig) -> torch.optim.Optimizer:
    """A configuration's optimizer for a network, on its device; fused, which takes a step in one go over the memory.

    It holds no parameter itself but a view that shares its memory, with axes in the order in which that lies: of a
    gradient that is channels last a fused step would first make a copy, which takes longer than the step.
    """
    own = list(network.parameters())
    views = [torch.nn.Parameter(_as_it_lies(parameter.detach())) for parameter in own]
    common: dict[str, Any] = {"lr": config.learning_rate, "weight_decay": config.weight_decay, "fused": True}
    optimizer: torch.optim.Optimizer
    if config.optimizer == "sgd":
        optimizer = torch.optim.SGD(views, momentum=config.momentum, **common)
    else:
        optimizer = torch.optim.AdamW(views, **common)

    def lend(*_: Any) -> None:
        for view, parameter in zip(views, own, strict=True):
            view.grad = None if parameter.grad is None else _as_it_lies(parameter.grad)

    optimizer.register_step_pre_hook(lend)
    optimizer.register_step_post_hook(lambda *_: optimizer.zero_grad(set_to_none=True))  # the gradients are not its own
    return optimizer


def _as_it_lies(tensor: torch.Tensor) -> torch.Tensor:
    """A view of a tensor whose axes are in the order of its memory, where it is channels last."""
    return tensor.permute(0, 2, 3, 1) if tensor.dim() == 4 and not tensor.is_contiguous() else tensor


def pass_over(
    network: ResNet,
    optimizer: torch.optim.Optimizer,
    data: ViewpointDataset,
    order: NDArray[np.int64],
    config: TrainConfig,
    epoch: int,
    device: str = "cpu",
) -> tuple[float, float]:
    """One epoch: a step for each batch of an order. Mean loss and mean score, as the weights changed.

    A last batch of one sample goes with the batch before it: batch normalization has no statistics of one.
    """
    objective: Objective = OBJECTIVES[data.target]
    network.train()
    loss_sum = torch.zeros((), device=device)
    score_sum = torch.zeros((), device=device)
    for start, indices in _batches(order, config.batch, least=2):
        for group in optimizer.param_groups:
            group["lr"] = config.rate(epoch, start / len(order))
        images, targets = (part.to(device, non_blocking=True) for part in data.batch(indices))
        outputs = network(normalized(images).contiguous(memory_format=torch.channels_last))
        loss = objective.loss(outputs, targets)
        network.zero_grad(set_to_none=True)
        loss.backward()
        optimizer.step()
        with torch.no_grad():  # summed where they are: to read them would make a GPU wait
            loss_sum += loss * len(indices)
            score_sum += objective.total_score(outputs, targets)
    return float(loss_sum) / len(order), float(score_sum) / len(order)


def _batches(order: NDArray[np.int64], size: int, least: int = 1) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """Where each batch begins, and the batch; a last one of fewer than ``least`` goes with the one before."""
    start = 0
    while start < len(order):
        end = start + size
        end = len(order) if len(order) - end < least else end
        yield start, order[start:end]
        start = end
