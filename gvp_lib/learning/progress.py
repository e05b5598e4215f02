"""The state of a training between two epochs, as tensors in a file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import torch
from torch import Tensor

from gvp_lib.errors import CheckpointError
from gvp_lib.jobs import open_locked
from gvp_lib.learning.checkpoints import read_tensors
from gvp_lib.learning.config import TrainConfig
from gvp_lib.learning.resnet import ResNet

__all__ = ["damaged", "lock_folder", "put_network", "put_optimizer", "read_state", "state_tensors"]

LOCK = ".lock"  # a file in the folder of a training
_NETWORK, _OPTIMIZER = "network.", "optimizer."
_FIRST = "weights_sha256"  # of a file that the training began with


def lock_folder(folder: Path) -> BinaryIO:
    """Make a folder that only this process trains in, until what comes back is closed.

    Raises
    ------
    CheckpointError
        Another process trains there, or the folder cannot be written.
    """
    try:
        return open_locked(folder / LOCK)
    except BlockingIOError as error:
        raise CheckpointError(
            f"{folder} is in use by another training; wait for it, or choose another folder"
        ) from error
    except OSError as error:
        raise CheckpointError(f"{folder} cannot be written ({error.strerror}); choose another") from error


def state_tensors(network: ResNet, optimizer: torch.optim.Optimizer) -> dict[str, Tensor]:
    """All numbers of a network and its optimizer, by name."""
    tensors = {_NETWORK + name: tensor for name, tensor in network.state_dict().items()}
    for index, state in optimizer.state_dict()["state"].items():
        for name, value in state.items():
            if value is not None:
                tensors[f"{_OPTIMIZER}{index}.{name}"] = torch.as_tensor(value)
    return tensors


def read_state(path: Path, recipe: Mapping[str, Any]) -> tuple[dict[str, Tensor], list[dict[str, float]]]:
    """The tensors and the history of a training's file, if it is of this recipe.

    Raises
    ------
    CheckpointError
        It is of another, no training's, or damaged.
    """
    tensors, about = read_tensors(path)
    if not {"recipe", "history"} <= about.keys() or not about["history"]:
        raise CheckpointError(f"{path} is no training's state; choose another folder, or remove it")
    was, history = about["recipe"], about["history"]
    if not (isinstance(was, dict) and isinstance(was.get("config"), dict) and _is_history(history)):
        raise CheckpointError(
            f"{path} is damaged: its recipe or its history is not what a training writes; remove its folder to begin "
            "anew"
        )
    # What an older version did not know, it did as by default.
    was = {**was, "config": {**TrainConfig().to_dict(), **was["config"]}}
    if was != recipe:
        there, here = ({**each["config"], _FIRST: each.get(_FIRST)} for each in (was, recipe))
        told = [f"{name} {there.get(name)!r} there, {value!r} here" for name, value in here.items()
                if there.get(name) != value]  # fmt: skip
        raise CheckpointError(
            f"{path.parent} holds another training ({', '.join(told) or 'of other data'}); choose another folder, or "
            "remove it"
        )
    return tensors, history


def _is_history(lines: object) -> bool:
    """Whether it is one line an epoch, each of numbers by name."""
    return isinstance(lines, list) and all(
        isinstance(line, dict)
        and {"rate", "loss", "validation_loss"} <= line.keys()
        and line.get("epoch") == epoch
        and all(isinstance(value, int | float) for value in line.values())
        for epoch, line in enumerate(lines, start=1)
    )


@contextmanager
def damaged(path: Path) -> Iterator[None]:
    """What does not fit is a damaged file's."""
    try:
        yield
    except (RuntimeError, ValueError, LookupError) as error:
        raise CheckpointError(
            f"{path} is damaged: its tensors are not those of this training ({str(error).splitlines()[-1].strip()}); "
            "remove its folder to begin anew"
        ) from error


def put_network(tensors: Mapping[str, Tensor], network: ResNet) -> None:
    """Copy a state's tensors into a network."""
    own = {name.removeprefix(_NETWORK): tensor for name, tensor in tensors.items() if name.startswith(_NETWORK)}
    network.load_state_dict(own)


def put_optimizer(tensors: Mapping[str, Tensor], optimizer: torch.optim.Optimizer) -> None:
    """Copy a state's tensors into an optimizer."""
    parameters = [parameter for group in optimizer.param_groups for parameter in group["params"]]
    state: dict[int, dict[str, Tensor]] = {}
    for key, value in tensors.items():
        if key.startswith(_OPTIMIZER):
            _, index, name = key.split(".")
            parameter = parameters[int(index)]
            if value.dim() and value.shape != parameter.shape:
                raise ValueError(f"{key} is {tuple(value.shape)}, its parameter {tuple(parameter.shape)}")
            state.setdefault(int(index), {})[name] = value
    # Without momentum an optimizer remembers nothing.
    if state and len(state) != len(parameters):
        raise ValueError(f"the optimizer's part is of {len(state)} parameters; there are {len(parameters)}")
    optimizer.load_state_dict(optimizer.state_dict() | {"state": state})
