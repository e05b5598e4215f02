"""Trained networks and half-finished trainings as files: safetensors, which hold numbers and no code."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from gvp_lib.errors import CheckpointError, UnknownNameError
from gvp_lib.jobs import write_file
from gvp_lib.learning.objectives import OBJECTIVES
from gvp_lib.learning.resnet import NETWORKS, ResNet

__all__ = ["SHIPPED", "TrainedNetwork", "dequantized", "load_trained", "read_tensors", "save_trained", "shipped_names",
           "weights_file", "write_tensors"]  # fmt: skip

SHIPPED = Path(__file__).parent / "weights"
PRECISIONS = ("float32", "float16", "int8")
_ABOUT, _SCALE = "gvp_lib", "|scale"
_NEEDED = ("network", "target", "size", "crop", "outputs")


@dataclass(frozen=True, eq=False)
class TrainedNetwork:
    """A network and what one must know to use it.

    Attributes
    ----------
    network
        In evaluation mode.
    about
        JSON data: ``network``, its name in ``NETWORKS``; ``outputs``; ``target``, ``"action"`` or ``"tilt"``; ``crop``
        and ``size``, px, of the square that is taken of a picture and of what that is shrunk to; and how it came about:
        ``config``, ``data``, ``epoch``, ``scores``, ``versions``, ``command``.
    """

    network: ResNet
    about: Mapping[str, Any]


def save_trained(
    path: Path | str, trained: TrainedNetwork, precision: Literal["float32", "float16", "int8"] = "float32"
) -> None:
    """Write a trained network to a file, whole or not at all.

    Parameters
    ----------
    path
        Ends in ``.safetensors``.
    trained
        What is written.
    precision
        ``"float16"`` halves the file. ``"int8"`` quarters it: each output channel of a layer has a scale of its own,
        and its weights are whole numbers from -127 to 127. What is not a weight (of batch normalization, and the final
        layer's offsets) stays as it is, for it is small, and a variance may be beyond what 16 bits hold.

    Raises
    ------
    CheckpointError
        The path ends otherwise or cannot be written.
    """
    check_export(path, precision)
    tensors: dict[str, Tensor] = {}
    for name, tensor in trained.network.state_dict().items():
        if precision == "float16" and tensor.dim() > 1:
            tensors[name] = tensor.half()
        elif precision == "int8" and tensor.dim() > 1:
            scale = tensor.flatten(1).abs().amax(dim=1).clamp(min=1e-12) / 127
            tensors[name] = (tensor / scale.view(-1, *[1] * (tensor.dim() - 1))).round().to(torch.int8)
            tensors[name + _SCALE] = scale
        else:
            tensors[name] = tensor
    write_tensors(path, tensors, {**trained.about, "precision": precision})


def check_export(path: Path | str, precision: str) -> None:
    """Whether :func:`save_trained` could write such a file, before a long training rather than after it."""
    if precision not in PRECISIONS:
        raise UnknownNameError("precision", precision, PRECISIONS)
    if Path(path).suffix != ".safetensors":
        raise CheckpointError(f"weights go into a file that ends in .safetensors; got {str(path)!r}")


def load_trained(path: Path | str) -> TrainedNetwork:
    """Read a trained network, by the path of its file or the name of one that comes with the library.

    Raises
    ------
    CheckpointError
        There is none, or it is damaged, of something else, or of another architecture than it says.
    """
    file = weights_file(path)
    if not file.is_file():
        raise CheckpointError(
            f"there are no weights at {str(path)!r}; give a .safetensors file that `gvp train` wrote, or one of those "
            f"that come with the library: {shipped_names()}"
        )
    tensors, about = read_tensors(file)
    _check_about(file, about)
    network = ResNet(about["network"], about["outputs"])
    wanted = {name: tensor.shape for name, tensor in network.state_dict().items()}
    found = dequantized(tensors, file)
    wrong = [name for name, shape in wanted.items() if name not in found or found[name].shape != shape]
    wrong += [name for name in found if name not in wanted]
    if wrong:
        raise CheckpointError(
            f"{file} is not of {about['network']!r} with {about['outputs']} outputs: {len(wrong)} of its tensors are "
            f"missing, not of it or of another shape, the first of them {wrong[0]!r}"
        )
    _check_numbers(file, found, network.state_dict())
    network.load_state_dict(found)
    return TrainedNetwork(network.eval(), about)


def weights_file(path: Path | str) -> Path:
    """Where weights are: a file's own path, or that of the file of a name that comes with the library."""
    return Path(path) if Path(path).suffix else SHIPPED / f"{path}.safetensors"


def shipped_names() -> str:
    """Of the networks that come with the library, for texts."""
    return ", ".join(repr(weights.stem) for weights in sorted(SHIPPED.glob("*.safetensors"))) or "none"


def dequantized(tensors: Mapping[str, Tensor], file: Path) -> dict[str, Tensor]:
    """The tensors of a file of any precision, those of whole numbers times their scales.

    Raises
    ------
    CheckpointError
        Whole numbers lack their scales, or scales their whole numbers.
    """
    found = {name: tensor for name, tensor in tensors.items() if not name.endswith(_SCALE)}
    scales = {name.removesuffix(_SCALE): tensor for name, tensor in tensors.items() if name.endswith(_SCALE)}
    for name in {*scales, *(name for name, tensor in found.items() if tensor.dtype == torch.int8)}:
        tensor, scale = found.get(name), scales.get(name)
        if tensor is None or tensor.dtype != torch.int8 or scale is None or scale.shape != tensor.shape[:1]:
            raise CheckpointError(f"{file} is damaged: {name!r} is not int8 with a scale for each output channel")
        found[name] = tensor * scale.view(-1, *[1] * (tensor.dim() - 1))
    return found


def _check_about(file: Path, about: Mapping[str, Any]) -> None:
    missing = [field for field in _NEEDED if field not in about]
    if missing:
        raise CheckpointError(f"{file} does not say what it is of: it lacks {', '.join(missing)}")
    for field, known in (("network", NETWORKS), ("target", OBJECTIVES)):
        if not isinstance(about[field], str) or about[field] not in known:
            raise CheckpointError(
                f"the {field} of {file} is {about[field]!r}; this version of the library knows {', '.join(known)}"
            )
    for field in ("size", "crop", "outputs"):
        if type(about[field]) is not int or about[field] < 1:  # True is an int, too
            raise CheckpointError(f"{file} is damaged: {field} is a whole number from 1; got {about[field]!r}")
    if about["outputs"] != (wanted := OBJECTIVES[about["target"]].outputs):
        raise CheckpointError(f"{file} has {about['outputs']} outputs; of target {about['target']!r} it has {wanted}")


def _check_numbers(file: Path, found: Mapping[str, Tensor], own: Mapping[str, Tensor]) -> None:
    """Whether tensors are of real numbers where a network's own are, and finite."""
    for name, tensor in found.items():
        if tensor.is_floating_point() != own[name].is_floating_point():
            raise CheckpointError(f"{file} is damaged: {name!r} is of {tensor.dtype}; expected {own[name].dtype}")
        if not tensor.isfinite().all():
            raise CheckpointError(f"{file} is damaged: {name!r} holds numbers that are not finite; train it anew")


def write_tensors(path: Path | str, tensors: Mapping[str, Tensor], about: Mapping[str, Any]) -> None:
    """Write tensors and JSON data about them, whole or not at all; the same ones give the same bytes, anywhere."""
    path = Path(path)
    kept = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    try:
        write_file(path, save(kept, {_ABOUT: json.dumps(about, sort_keys=True)}))
    except OSError as error:
        raise CheckpointError(f"{path} cannot be written ({error.strerror}); what was there is still there") from error


def read_tensors(path: Path | str) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """What :func:`write_tensors` wrote."""
    try:
        with safe_open(path, framework="pt") as file:
            about = (file.metadata() or {}).get(_ABOUT)
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise CheckpointError(f"{path} cannot be read as safetensors ({error}); is it whole?") from error
    try:
        about = None if about is None else json.loads(about)
    except ValueError as error:
        raise CheckpointError(f"{path} is damaged: what it says of its tensors is no JSON ({error})") from error
    if not isinstance(about, dict):
        raise CheckpointError(
            f"{path} holds tensors but not what they are of; `gvp train` writes that beside them. Weights in "
            "torchvision's format begin a training: TrainConfig(weights=...)"
        )
    return tensors, about
