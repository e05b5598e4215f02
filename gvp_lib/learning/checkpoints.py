"""Networks as files: trained ones, in safetensors, and the initial weights of a training. Thesis 2.4.1.

Safetensors hold numbers and no code. Initial weights may also be what ``torch.save(network.state_dict(), file)`` wrote:
a pickle, which can hold code, but torch reads the tensors in it and refuses everything else. Which of the two a file is
stands in its first bytes, whatever it is called.
"""

from __future__ import annotations

import hashlib
import json
import re
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from http.client import HTTPException
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from gvp_lib.checks import checked
from gvp_lib.errors import CheckpointError, DownloadError, InvalidParameterError, UnknownNameError
from gvp_lib.jobs import disk_errors, write_file
from gvp_lib.learning.config import OBJECTIVES, score_text
from gvp_lib.learning.resnet import ARCHITECTURES, ResNet
from gvp_lib.learning.shards import as_path

__all__ = [
    "PUBLISHED",
    "SHIPPED",
    "TrainedNetwork",
    "check_export",
    "load_trained",
    "load_weights",
    "save_trained",
    "weights_file",
]

SHIPPED = Path(__file__).parent / "weights"
"""Folder of the networks that come with the library."""

PUBLISHED: Mapping[str, str] = {"resnet50": "resnet50-0676ba61.pth", "resnet18": "resnet18-f37072fd.pth"}
"""Files of ImageNet weights; the digits begin the file's SHA-256.

They are torchvision's first, ``IMAGENET1K_V1``: a thesis of 2020 had no others. The newer ones of ResNet-50,
``resnet50-11ad3fa6.pth``, load by their path.
"""

PRECISIONS = ("float32", "float16", "int8")
_BASE_URL = "https://download.pytorch.org/models/"
_TIMEOUT = 30.0  # s without an answer
_METADATA, _SCALE = "gvp_lib", "|scale"  # key of a file's metadata; end of the names of scales
_REQUIRED = ("network", "target", "size", "crop", "outputs")
_RENAMED = {"dihedral": "turns"}  # fields of TrainConfig that files call as version 0.1 did
_HEAD = ("fc.weight", "fc.bias")
_IN_EVERY_NETWORK = "layer4.0.conv1.weight"
_COUNTER = "num_batches_tracked"  # of batch normalization; files from before 2018 lack it, and nothing here needs it


@dataclass(frozen=True, eq=False)
class TrainedNetwork:
    """Trained network with the metadata needed to use it.

    Attributes
    ----------
    network
        Network, in evaluation mode.
    metadata
        JSON data. How to use the network: ``network``, its name in ``ARCHITECTURES``; ``outputs``, their number;
        ``target``, ``"action"`` or ``"tilt"``; ``crop``, side of the central square cut from an image, px; ``size``,
        side to which that is resized, px. How it was made: ``config``, ``data``, ``epoch``, ``scores``, ``versions``,
        ``command``.

    Examples
    --------
    >>> load_trained("tilt-1x2")
    TrainedNetwork(resnet18_half, tilt, 128 px, epoch 20, validation error 0.639 deg)
    """

    network: ResNet
    metadata: Mapping[str, Any]

    def __repr__(self) -> str:
        metadata, target = self.metadata, self.metadata["target"]
        parts = [metadata["network"], target, f"{metadata['size']} px"]
        if "epoch" in metadata:
            parts.append(f"epoch {metadata['epoch']}")
        score = metadata.get("scores", {}).get(f"validation_{OBJECTIVES[target].score}")
        if score is not None:
            parts.append(f"validation {score_text(target, score)}")
        return f"TrainedNetwork({', '.join(parts)})"


# --- trained networks -----------------------------------------------------------------------------------------------


@checked(own=("path", "trained"))
def save_trained(
    path: Path | str, trained: TrainedNetwork, precision: Literal["float32", "float16", "int8"] = "float32"
) -> None:
    """Write a trained network to a file, atomically; the same network gives the same bytes on any machine.

    Parameters
    ----------
    path
        Path of the file, which ends in ``.safetensors``.
    trained
        Network to write, with its metadata.
    precision
        Precision of the weights. ``"float16"`` halves the file. ``"int8"`` quarters it: each output channel of a layer
        has its own scale, and its weights are whole numbers from -127 to 127. Batch normalization and the final layer's
        biases stay float32: they are small, and a variance may exceed what 16 bits hold.

    Raises
    ------
    CheckpointError
        The path has another suffix or cannot be written.
    InvalidParameterError
        What is to be written is no trained network, or its metadata lacks what :func:`load_trained` needs.
    UnknownNameError
        There is no such precision.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_trained(f"{folder}/mine.safetensors", load_trained("tilt-1x2"), "float16")
    ...     load_trained(f"{folder}/mine.safetensors")
    TrainedNetwork(resnet18_half, tilt, 128 px, epoch 20, validation error 0.639 deg)
    """
    path = check_export(path, precision)
    if not isinstance(trained, TrainedNetwork) or (missing := _missing(trained.metadata)):
        what = f"metadata without {', '.join(missing)}" if isinstance(trained, TrainedNetwork) else repr(trained)
        raise InvalidParameterError(
            f"save_trained writes TrainedNetwork(network, metadata), whose metadata has {', '.join(_REQUIRED)}; got "
            f"{what}"
        )
    tensors: dict[str, Tensor] = {}
    for name, tensor in trained.network.state_dict().items():
        if precision == "float16" and tensor.dim() > 1:
            tensor = tensor.half()
        elif precision == "int8" and tensor.dim() > 1:
            rows = tensor.flatten(1)  # one of each output channel
            scale = rows.abs().amax(dim=1).clamp(min=1e-12) / 127
            tensor = (rows / scale[:, None]).round().to(torch.int8).view(tensor.shape)
            tensors[name + _SCALE] = scale.cpu()
        tensors[name] = tensor.cpu().contiguous()
    text = metadata_text(_with_renamed_fields({**trained.metadata, "precision": precision}, _RENAMED))
    with disk_errors(path, CheckpointError):
        write_file(path, save(tensors, {_METADATA: text}))


def _missing(metadata: Mapping[str, Any]) -> list[str]:
    return [field for field in _REQUIRED if field not in metadata]


def metadata_text(metadata: Mapping[str, Any]) -> str:
    """Metadata as JSON, NumPy's numbers and arrays among it; or an error, before a long training."""

    def plain(value: object) -> Any:
        if isinstance(value, np.generic | np.ndarray):
            return value.tolist()
        raise InvalidParameterError(f"metadata is JSON data: numbers, texts, lists and dicts; got {value!r}")

    return json.dumps(metadata, sort_keys=True, default=plain)


def check_export(path: Path | str, precision: str) -> Path:
    """Path of the file, checked before a long training: whether :func:`save_trained` will accept it after it."""
    if precision not in PRECISIONS:
        raise UnknownNameError("precision", precision, PRECISIONS)
    file = as_path(path, "weights go into", "a file, given by its path")
    if file.suffix != ".safetensors":
        raise CheckpointError(f"weights go into a file that ends in .safetensors; got {str(path)!r}")
    return file


@checked(own=True)
def load_trained(path: Path | str) -> TrainedNetwork:
    """Load a trained network.

    Parameters
    ----------
    path
        Path of its file, or the name of a network that comes with the library.

    Raises
    ------
    CheckpointError
        There is no such file; it is damaged, or holds something else or another architecture than its metadata states.

    Examples
    --------
    >>> load_trained("actions-1x2").network
    ResNet(resnet18_half, 5 outputs, 2,800,165 parameters)
    """
    file = weights_file(path)
    tensors, metadata = _read(file)
    if missing := _missing(metadata):
        raise CheckpointError(
            f"{file} is no trained network: its metadata lacks {', '.join(missing)}, which `gvp train` writes. Weights "
            "in torchvision's format can initialize a training: TrainConfig(weights=...)"
        )
    for field, known in (("network", ARCHITECTURES), ("target", OBJECTIVES)):
        if metadata[field] not in known:
            raise CheckpointError(
                f"the {field} of {file} is {metadata[field]!r}; this version of the library knows {', '.join(known)}"
            )
    outputs, head = OBJECTIVES[metadata["target"]].outputs, tensors.get("fc.bias")
    if metadata["outputs"] != outputs or (head is not None and head.shape != (outputs,)):
        raise CheckpointError(
            f"{file} is damaged: a network whose target is {metadata['target']!r} has {outputs} outputs"
        )
    for field in ("size", "crop"):
        if type(metadata[field]) is not int or metadata[field] < 1:
            raise CheckpointError(f"{file} is damaged: {field} is a whole number from 1; got {metadata[field]!r}")
    network = ResNet(metadata["network"], outputs)
    _load_state(network, tensors, file, head=True)
    return TrainedNetwork(network.eval(), metadata)


def weights_file(weights: Path | str) -> Path:
    """File of weights, by its path or the name of a network that comes with the library.

    Raises
    ------
    CheckpointError
        There is none.
    """
    shipped = sorted(file.stem for file in SHIPPED.glob("*.safetensors"))
    if str(weights) in shipped:
        return SHIPPED / f"{weights}.safetensors"
    path = as_path(weights, "weights are", "the path of a file, or the name of a network that comes with the library")
    if not path.is_file():
        what = f"{str(weights)!r} is a folder" if path.is_dir() else f"there are no weights at {str(weights)!r}"
        raise CheckpointError(
            f"{what}; give a file of safetensors, such as one that `gvp train` wrote, or one that torch.save wrote, or "
            f"one of those that come with the library: {', '.join(map(repr, shipped))}. A training can also start from "
            "'imagenet' or None"
        )
    return path


# --- initial weights ------------------------------------------------------------------------------------------------


@checked(own=("network", "weights"))
def load_weights(network: ResNet, weights: str | Path | None) -> None:
    """Load weights into a network, all or none of them.

    Parameters
    ----------
    network
        Network to load them into. It keeps its own final layer where the file's has another number of outputs, or the
        file has none.
    weights
        Weights to load. None leaves the network as it is. ``"imagenet"`` loads what PyTorch publishes for the network's
        architecture (see :data:`PUBLISHED`), downloaded once and cached where torchvision caches it: in the folder
        ``checkpoints`` of ``torch.hub.get_dir()``. Such weights expect
        :func:`~gvp_lib.learning.resnet.normalized` images. Anything else is the path of a file with torchvision's
        names, of safetensors or from ``torch.save``, in any precision; or the name of a network that comes with the
        library. A prefix that all names of the network have (``module.``, ``_orig_mod.``) is dropped, and in a
        checkpoint of a training the one entry that is a network is found.

    Raises
    ------
    CheckpointError
        There is no such file; it is damaged, holds objects that could run code, several networks, or another
        architecture; or none are published for this architecture.
    DownloadError
        The published file cannot be downloaded or stored, or its checksum is wrong.

    Examples
    --------
    >>> import tempfile
    >>> trained, network = ResNet("resnet18_half", outputs=5), ResNet("resnet18_half", outputs=2)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     torch.save(trained.state_dict(), f"{folder}/trained.pth")
    ...     load_weights(network, f"{folder}/trained.pth")
    >>> bool((network.conv1.weight == trained.conv1.weight).all())
    True
    """
    if not isinstance(network, ResNet):
        raise InvalidParameterError(
            f"weights are loaded into a gvp_lib.learning.ResNet; got a {type(network).__name__}. Of one that is "
            "wrapped, give what is inside: network.module, or of torch.compile network._orig_mod"
        )
    if weights is not None:
        path = _published(network) if isinstance(weights, str) and weights == "imagenet" else weights_file(weights)
        _load_state(network, _read(path)[0], path)


def _published(network: ResNet) -> Path:
    """File of a network's ImageNet weights, downloaded where it is missing or damaged."""
    file = next((file for name, file in PUBLISHED.items() if ARCHITECTURES[name] == network.architecture), None)
    if file is None:
        raise CheckpointError(
            "there are no published weights from ImageNet for this architecture; there are for "
            f"{' and '.join(map(repr, PUBLISHED))}, and weights=None begins with random ones"
        )
    path = Path(torch.hub.get_dir()) / "checkpoints" / file
    digits, usual = path.stem.rpartition("-")[2], socket.getdefaulttimeout()
    socket.setdefaulttimeout(_TIMEOUT)  # else torch would wait forever for a silent server
    try:
        if not (path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest().startswith(digits)):
            path.parent.mkdir(parents=True, exist_ok=True)
            torch.hub.download_url_to_file(_BASE_URL + file, str(path), digits)
    except (OSError, HTTPException, RuntimeError) as error:  # the last: a wrong checksum
        raise DownloadError(
            f"{_BASE_URL}{file} cannot be downloaded to {path} ({error}). Put the file there by hand, name another "
            "folder for downloads by TORCH_HOME, or begin with random weights: weights=None"
        ) from error
    finally:
        socket.setdefaulttimeout(usual)
    return path


# --- tensors --------------------------------------------------------------------------------------------------------


def _read(path: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Tensors of a file by name, whole numbers multiplied by their scales; and its metadata, if it is one of ours."""
    try:
        with open(path, "rb") as file:
            begins = file.read(9)
    except OSError as error:
        raise CheckpointError(f"{path} cannot be read ({error.strerror})") from error
    # First of all the brace after a safetensors file's length, whose own bytes may be any.
    if begins[8:] != b"{":
        if begins[:2] == b"PK" or begins[:1] == b"\x80":  # an archive; a pickle, as before torch 1.6
            return _read_pickle(path), {}
        if path.suffix != ".safetensors":
            raise CheckpointError(
                f"{path} is damaged, or no file of weights: it begins neither as safetensors nor as what torch.save "
                f"writes, but with {begins!r}"
            )
    try:
        with safe_open(path, framework="pt") as file:
            metadata = json.loads((file.metadata() or {}).get(_METADATA, "{}"))
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        scales = {name.removesuffix(_SCALE): tensors.pop(name) for name in list(tensors) if name.endswith(_SCALE)}
        for name, scale in scales.items():
            whole = tensors[name]
            tensors[name] = (whole.flatten(1) * scale[:, None]).view(whole.shape)
    except (SafetensorError, OSError, ValueError, LookupError, RuntimeError) as error:
        raise CheckpointError(f"{path} cannot be read as safetensors ({error}); is it complete?") from error
    stored = {stored: name for name, stored in _RENAMED.items()}
    return tensors, _with_renamed_fields(metadata, stored) if isinstance(metadata, dict) else {}


def _with_renamed_fields(metadata: Mapping[str, Any], names: Mapping[str, str]) -> dict[str, Any]:
    """Metadata in which some fields of the configuration have other names."""
    config = metadata.get("config")
    if not isinstance(config, dict):
        return dict(metadata)
    return {**metadata, "config": {names.get(name, name): value for name, value in config.items()}}


def _read_pickle(path: Path) -> dict[str, Tensor]:
    """Tensors by name in a file that :func:`torch.save` wrote: all of it, or its one entry that is such."""
    try:
        found = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # a damaged pickle can raise any
        if other := re.search(r"GLOBAL (\S+)", str(error)):
            raise CheckpointError(
                f"{path} holds a pickled {other[1]}. Whatever is no tensor can run code, so it was not loaded. If you "
                "trust the file, save its weights alone: saved = torch.load(file, weights_only=False); then "
                "torch.save(saved.state_dict(), new) of a whole network, torch.save(saved['state_dict'], new) of a "
                "checkpoint"
            ) from error
        raise CheckpointError(f"{path} is damaged, or not what torch.save wrote ({_first_line(error)})") from error
    if _is_state(found):
        return dict(found)
    parts = {name: part for name, part in found.items() if _is_state(part)} if isinstance(found, Mapping) else {}
    if len(parts) == 1:
        return dict(*parts.values())
    entries = f"entries {', '.join(map(repr, parts or found))}" if isinstance(found, Mapping) else type(found).__name__
    raise CheckpointError(
        f"{path} holds {'several networks' if parts else 'no tensors by name'}: {entries}. Save what "
        "torch.save(network.state_dict(), file) saves"
    )


def _is_state(found: object) -> bool:
    """Whether something holds tensors by name, and nothing else."""
    return (
        isinstance(found, Mapping)
        and len(found) > 0
        and all(isinstance(name, str) and isinstance(tensor, Tensor) for name, tensor in found.items())
    )


def _first_line(error: Exception) -> str:
    return next(iter(str(error).splitlines()), type(error).__name__)


def _load_state(network: ResNet, found: Mapping[str, Tensor], source: Path, *, head: bool = False) -> None:
    """Copy tensors into a network that has just these, with a final layer of its size or, unless ``head``, without."""
    own, found = network.state_dict(), _without_prefix(found, source)
    unloaded = [name for name in own if name.endswith(_COUNTER) and name not in found]
    if not head and any(name not in found or found[name].shape != own[name].shape for name in _HEAD):
        unloaded += _HEAD
    tensors = {**found, **{name: own[name] for name in unloaded}}
    expected, actual = _shapes(own), _shapes(tensors)
    if wrong := [name for name in {**expected, **actual} if expected.get(name) != actual.get(name)]:
        if found and not own.keys() & found.keys():
            raise CheckpointError(
                f"{source} does not call its tensors as torchvision does: its first is {next(iter(found))!r}, "
                f"torchvision's is {next(iter(own))!r}"
            )
        first, fits = wrong[0], _architectures_of(found)
        raise CheckpointError(
            f"{source} has another architecture than the network: {len(wrong)} tensors differ, the first is {first}, "
            f"{actual.get(first, 'missing')} in the file and {expected.get(first, 'missing')} in the network. "
            f"It fits {' and '.join(fits) or 'none of ' + ', '.join(ARCHITECTURES)}"
        )
    if bad := [name for name, tensor in tensors.items() if not tensor.float().isfinite().all()]:
        raise CheckpointError(f"{source} is damaged: {bad[0]!r} holds numbers that are not finite; train it anew")
    network.load_state_dict(tensors)


def _without_prefix(found: Mapping[str, Tensor], source: Path) -> Mapping[str, Tensor]:
    """Tensors of a network by its own names, without what a wrapper (DataParallel, torch.compile) puts before them."""
    prefixes = [name.removesuffix(_IN_EVERY_NETWORK) for name in found if name.endswith(_IN_EVERY_NETWORK)]
    if len(prefixes) > 1:
        raise CheckpointError(
            f"{source} holds several networks, whose names begin with {' and '.join(map(repr, prefixes))}; save one of "
            "them alone"
        )
    prefix = "".join(prefixes)
    return {name.removeprefix(prefix): tensor for name, tensor in found.items() if name.startswith(prefix)}


def _shapes(tensors: Mapping[str, Tensor]) -> dict[str, str]:
    """Shapes as text, marked where the numbers are whole."""
    return {
        name: f"{'' if tensor.is_floating_point() else 'whole numbers '}{tuple(tensor.shape)}"
        for name, tensor in tensors.items()
    }


def _body(tensors: Mapping[str, Tensor]) -> dict[str, str]:
    """Shapes without those of counters and of the final layer."""
    return {
        name: shape for name, shape in _shapes(tensors).items() if name not in _HEAD and not name.endswith(_COUNTER)
    }


def _architectures_of(tensors: Mapping[str, Tensor]) -> list[str]:
    """Names of the architectures that have tensors of these shapes, whatever the number of outputs."""
    with torch.device("meta"):  # shapes without numbers
        return [name for name in ARCHITECTURES if _body(ResNet(name).state_dict()) == _body(tensors)]
