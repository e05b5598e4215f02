"""Networks as files: the trained ones, in safetensors, and weights to begin a training with. Thesis 2.4.1.

Safetensors hold numbers and no code. Weights to begin with may also be what ``torch.save(network.state_dict(), file)``
wrote: a pickle, which can hold code, but torch reads the tensors in it and refuses everything else.
"""

from __future__ import annotations

import hashlib
import json
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from http.client import HTTPException
from pathlib import Path
from typing import Any, Literal

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from gvp_lib.errors import CheckpointError, DownloadError, UnknownNameError
from gvp_lib.jobs import disk_errors, write_file
from gvp_lib.learning.config import OBJECTIVES
from gvp_lib.learning.resnet import NETWORKS, ResNet

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
_PUBLISHER = "https://download.pytorch.org/models/"
_PATIENCE = 30.0  # s without an answer
_FORMATS = (".safetensors", ".pth", ".pt")
_ABOUT, _SCALE = "gvp_lib", "|scale"
_NEEDED = ("network", "target", "size", "crop", "outputs")
_HEAD = ("fc.weight", "fc.bias")
_COUNTER = "num_batches_tracked"  # of batch normalization; files from before 2018 lack it, and nothing here needs it


@dataclass(frozen=True, eq=False)
class TrainedNetwork:
    """A network, and what one must know to use it.

    Attributes
    ----------
    network
        The network, in evaluation mode.
    about
        JSON data: ``network``, its name in ``NETWORKS``; ``outputs``; ``target``, ``"action"`` or ``"tilt"``; ``crop``
        and ``size``, px, of the square taken from a picture and of the picture it is resized to; and its history:
        ``config``, ``data``, ``epoch``, ``scores``, ``versions``, ``command``.
    """

    network: ResNet
    about: Mapping[str, Any]


# --- trained networks -----------------------------------------------------------------------------------------------


def save_trained(
    path: Path | str, trained: TrainedNetwork, precision: Literal["float32", "float16", "int8"] = "float32"
) -> None:
    """Write a trained network to a file, whole or not at all; the same network gives the same bytes anywhere.

    Parameters
    ----------
    path
        File that ends in ``.safetensors``.
    trained
        The network to write.
    precision
        ``"float16"`` halves the file. ``"int8"`` quarters it: each output channel of a layer has its own scale, and its
        weights are whole numbers from -127 to 127. Batch normalization and the final layer's offsets stay as they are:
        they are small, and a variance may exceed what 16 bits hold.

    Raises
    ------
    CheckpointError
        The path ends otherwise or cannot be written.
    """
    check_export(path, precision)
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
    about = json.dumps({**trained.about, "precision": precision}, sort_keys=True)
    with disk_errors(path, CheckpointError):
        write_file(path, save(tensors, {_ABOUT: about}))


def check_export(path: Path | str, precision: str) -> None:
    """Check before a long training that :func:`save_trained` will accept a path and a precision after it."""
    if precision not in PRECISIONS:
        raise UnknownNameError("precision", precision, PRECISIONS)
    if Path(path).suffix != ".safetensors":
        raise CheckpointError(f"weights go into a file that ends in .safetensors; got {str(path)!r}")


def load_trained(path: Path | str) -> TrainedNetwork:
    """Read a trained network, by the path of its file or the name of one that comes with the library.

    Raises
    ------
    CheckpointError
        There is none, or the file is damaged, of something else, or of another architecture than it says.
    """
    file = weights_file(path)
    tensors, about = _read(file)
    if missing := [field for field in _NEEDED if field not in about]:
        raise CheckpointError(
            f"{file} does not say what its tensors are of: it lacks {', '.join(missing)}, which `gvp train` writes "
            "beside them. Weights in torchvision's format begin a training: TrainConfig(weights=...)"
        )
    for field, known in (("network", NETWORKS), ("target", OBJECTIVES)):
        if about[field] not in known:
            raise CheckpointError(
                f"the {field} of {file} is {about[field]!r}; this version of the library knows {', '.join(known)}"
            )
    outputs, head = OBJECTIVES[about["target"]].outputs, tensors.get("fc.bias")
    if about["outputs"] != outputs or (head is not None and head.shape != (outputs,)):
        raise CheckpointError(f"{file} is damaged: a network whose target is {about['target']!r} has {outputs} outputs")
    for field in ("size", "crop"):
        if type(about[field]) is not int or about[field] < 1:
            raise CheckpointError(f"{file} is damaged: {field} is a whole number from 1; got {about[field]!r}")
    network = ResNet(about["network"], outputs)
    _put(network, tensors, file)
    return TrainedNetwork(network.eval(), about)


def weights_file(weights: Path | str) -> Path:
    """File of weights, by its path or the name of a network that comes with the library.

    Raises
    ------
    CheckpointError
        There is none.
    """
    path = Path(weights) if Path(weights).suffix else SHIPPED / f"{weights}.safetensors"
    if not path.is_file() or path.suffix not in _FORMATS:
        shipped = ", ".join(repr(file.stem) for file in sorted(SHIPPED.glob("*.safetensors")))
        raise CheckpointError(
            f"there are no weights at {str(weights)!r}; give a file that ends in {', '.join(_FORMATS)}, such as one "
            f"that `gvp train` wrote, or one of those that come with the library: {shipped}. A training begins with "
            "'imagenet' or None, too"
        )
    return path


# --- weights to begin with ------------------------------------------------------------------------------------------


def load_weights(network: ResNet, weights: str | Path | None) -> None:
    """Load weights into a network, all or none of them.

    Parameters
    ----------
    network
        The network. Where the file's final layer has another number of outputs, it keeps its own.
    weights
        None leaves the network as it is. ``"imagenet"`` loads what PyTorch publishes for the network's architecture
        (see :data:`PUBLISHED`), downloaded once and kept where torchvision keeps it: in the ``checkpoints`` of
        ``torch.hub.get_dir()``. Such weights expect pictures that are :func:`~gvp_lib.learning.resnet.normalized`.
        Anything else is the path of a file with torchvision's names, ``.safetensors``, ``.pth`` or ``.pt``, in any
        precision; or the name of a network that comes with the library.

    Raises
    ------
    CheckpointError
        There is no such file; it is damaged, holds more than tensors, or is of another architecture; or none are
        published for this one.
    DownloadError
        The published file cannot be downloaded or kept, or is not the one it should be.

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
    if weights is not None:
        path = _published(network) if weights == "imagenet" else weights_file(weights)
        _put(network, _read(path)[0] if path.suffix == ".safetensors" else _unpickled(path), path)


def _published(network: ResNet) -> Path:
    """File of a network's ImageNet weights, downloaded where it is not there or not whole."""
    file = next((file for name, file in PUBLISHED.items() if NETWORKS[name] == network.architecture), None)
    if file is None:
        raise CheckpointError(
            "there are no published weights from ImageNet for this architecture; there are for "
            f"{' and '.join(map(repr, PUBLISHED))}, and weights=None begins with random ones"
        )
    path = Path(torch.hub.get_dir()) / "checkpoints" / file
    digits, usual = path.stem.rpartition("-")[2], socket.getdefaulttimeout()
    socket.setdefaulttimeout(_PATIENCE)  # else torch would wait forever for a server that says nothing
    try:
        if not (path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest().startswith(digits)):
            path.parent.mkdir(parents=True, exist_ok=True)
            torch.hub.download_url_to_file(_PUBLISHER + file, str(path), digits)
    except (OSError, HTTPException, RuntimeError) as error:  # the last: of another checksum
        raise DownloadError(
            f"{_PUBLISHER}{file} cannot be downloaded to {path} ({error}). Put the file there by hand, name another "
            "folder for downloads by TORCH_HOME, or begin with random weights: weights=None"
        ) from error
    finally:
        socket.setdefaulttimeout(usual)
    return path


# --- tensors --------------------------------------------------------------------------------------------------------


def _read(path: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Tensors of a safetensors file, whole numbers multiplied by their scales, and what is written about them."""
    try:
        with safe_open(path, framework="pt") as file:
            about = json.loads((file.metadata() or {}).get(_ABOUT, "{}"))
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        scales = {name.removesuffix(_SCALE): tensors.pop(name) for name in list(tensors) if name.endswith(_SCALE)}
        for name, scale in scales.items():
            whole = tensors[name]
            tensors[name] = (whole.flatten(1) * scale[:, None]).view(whole.shape)
    except (SafetensorError, OSError, ValueError, LookupError, RuntimeError) as error:
        raise CheckpointError(f"{path} cannot be read as safetensors ({error}); is it whole?") from error
    return tensors, about if isinstance(about, dict) else {}


def _unpickled(path: Path) -> dict[str, Tensor]:
    """Tensors by name in a file that :func:`torch.save` wrote."""
    try:
        found: dict[str, Tensor] = torch.load(path, map_location="cpu", weights_only=True)
        if not all(isinstance(tensor, Tensor) for tensor in found.values()):
            raise TypeError(f"of {', '.join(map(repr, found))} not all are tensors")
    except Exception as error:  # a damaged pickle can raise any
        raise CheckpointError(
            f"{path} is damaged, or holds other objects than tensors by name; those can run code, so they were not "
            "loaded. Save what torch.save(network.state_dict(), file) saves"
        ) from error
    return found


def _put(network: ResNet, found: Mapping[str, Tensor], source: Path) -> None:
    """Copy tensors into a network if they are all that it has and no others; another final layer is left out."""
    own = network.state_dict()
    kept = [name for name in own if name.endswith(_COUNTER) and name not in found]
    if "fc.bias" in found and found["fc.bias"].shape != own["fc.bias"].shape:
        kept += [name for name in _HEAD if name in found]
    tensors = {**found, **{name: own[name] for name in kept}}
    here, there = _forms(own), _forms(tensors)
    if wrong := [name for name in {**here, **there} if here.get(name) != there.get(name)]:
        first, fits = wrong[0], _architectures_of(found)
        raise CheckpointError(
            f"{source} is not of this network: {len(wrong)} tensors differ, the first of them {first}, "
            f"{there.get(first, 'missing')} there and {here.get(first, 'missing')} here. "
            f"It fits {' and '.join(fits) or 'none of ' + ', '.join(NETWORKS)}"
        )
    if bad := [name for name, tensor in tensors.items() if not tensor.isfinite().all()]:
        raise CheckpointError(f"{source} is damaged: {bad[0]!r} holds numbers that are not finite; train it anew")
    network.load_state_dict(tensors)


def _forms(tensors: Mapping[str, Tensor]) -> dict[str, str]:
    """Shapes in words, and whether numbers are whole where they should not be."""
    return {
        name: f"{'' if tensor.is_floating_point() else 'whole numbers '}{tuple(tensor.shape)}"
        for name, tensor in tensors.items()
    }


def _without_counters(forms: Mapping[str, str]) -> dict[str, str]:
    return {name: form for name, form in forms.items() if not name.endswith(_COUNTER)}


def _architectures_of(tensors: Mapping[str, Tensor]) -> list[str]:
    """Names of the networks that have tensors of these shapes, whatever their number of outputs."""
    with torch.device("meta"):  # shapes without numbers
        candidates = {name: _without_counters(_forms(ResNet(name).state_dict())) for name in NETWORKS}
    found = _without_counters(_forms(tensors))
    return [name for name, forms in candidates.items() if forms | {head: found.get(head) for head in _HEAD} == found]
