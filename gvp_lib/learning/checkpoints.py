"""Networks as files: the trained ones, in safetensors, and weights to begin a training with. Thesis 2.4.1.

Safetensors hold numbers and no code. Weights to begin with may also be what ``torch.save(network.state_dict(), file)``
wrote: a pickle, which can hold code, but torch reads the tensors in it and refuses everything else.
"""

from __future__ import annotations

import hashlib
import json
import socket
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from http.client import HTTPException
from pathlib import Path
from typing import Any, Literal

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from gvp_lib.errors import CheckpointError, DownloadError, UnknownNameError
from gvp_lib.jobs import write_file
from gvp_lib.learning.config import OBJECTIVES
from gvp_lib.learning.resnet import NETWORKS, ResNet

__all__ = [
    "PUBLISHED",
    "SHIPPED",
    "TrainedNetwork",
    "check_export",
    "digest_of",
    "load_trained",
    "load_weights",
    "read_tensors",
    "save_trained",
    "weights_file",
    "write_tensors",
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
    """Write a trained network to a file, whole or not at all.

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
            tensors[name] = tensor.half()
        elif precision == "int8" and tensor.dim() > 1:
            scale = tensor.flatten(1).abs().amax(dim=1).clamp(min=1e-12) / 127
            tensors[name] = (tensor / _per_channel(scale, tensor)).round().to(torch.int8)
            tensors[name + _SCALE] = scale
        else:
            tensors[name] = tensor
    write_tensors(path, tensors, {**trained.about, "precision": precision})


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
    if not file.is_file():
        raise CheckpointError(
            f"there are no weights at {str(path)!r}; give a .safetensors file that `gvp train` wrote, or one of those "
            f"that come with the library: {_shipped_names()}"
        )
    tensors, about = read_tensors(file)
    if about is None:
        raise CheckpointError(
            f"{file} holds tensors but not what they are of; `gvp train` writes that beside them. Weights in "
            "torchvision's format begin a training: TrainConfig(weights=...)"
        )
    _check_about(file, about)
    network = ResNet(about["network"], about["outputs"])
    if not _put(network, _dequantized(tensors, file), file):
        raise CheckpointError(f"{file} is damaged: its final layer lacks the {about['outputs']} outputs it says")
    return TrainedNetwork(network.eval(), about)


def weights_file(path: Path | str) -> Path:
    """File of weights: the path itself, or that of a name that comes with the library."""
    return Path(path) if Path(path).suffix else SHIPPED / f"{path}.safetensors"


def _shipped_names() -> str:
    return ", ".join(repr(file.stem) for file in sorted(SHIPPED.glob("*.safetensors"))) or "none"


def _check_about(file: Path, about: Mapping[str, Any]) -> None:
    if missing := [field for field in _NEEDED if field not in about]:
        raise CheckpointError(f"{file} does not say what it is of: it lacks {', '.join(missing)}")
    for field, known in (("network", NETWORKS), ("target", OBJECTIVES)):
        if not isinstance(about[field], str) or about[field] not in known:
            raise CheckpointError(
                f"the {field} of {file} is {about[field]!r}; this version of the library knows {', '.join(known)}"
            )
    for field in ("size", "crop"):
        if type(about[field]) is not int or about[field] < 1:  # True is an int, too
            raise CheckpointError(f"{file} is damaged: {field} is a whole number from 1; got {about[field]!r}")
    if about["outputs"] != (wanted := OBJECTIVES[about["target"]].outputs):
        raise CheckpointError(f"{file} has {about['outputs']} outputs; of target {about['target']!r} it has {wanted}")


def _dequantized(tensors: Mapping[str, Tensor], file: Path) -> dict[str, Tensor]:
    """Tensors of a file of any precision, whole numbers multiplied by their scales."""
    found = {name: tensor for name, tensor in tensors.items() if not name.endswith(_SCALE)}
    scales = {name.removesuffix(_SCALE): tensor for name, tensor in tensors.items() if name.endswith(_SCALE)}
    for name in {*scales, *(name for name, tensor in found.items() if tensor.dtype == torch.int8)}:
        tensor, scale = found.get(name), scales.get(name)
        if tensor is None or tensor.dtype != torch.int8 or scale is None or scale.shape != tensor.shape[:1]:
            raise CheckpointError(f"{file} is damaged: {name!r} is not int8 with a scale for each output channel")
        found[name] = tensor * _per_channel(scale, tensor)
    return found


def _per_channel(scale: Tensor, tensor: Tensor) -> Tensor:
    """Scales (n,) in a shape that multiplies a tensor (n, ...)."""
    return scale.view(-1, *[1] * (tensor.dim() - 1))


# --- weights to begin with ------------------------------------------------------------------------------------------


def load_weights(network: ResNet, weights: str | Path | None) -> bool:
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

    Returns
    -------
    bool
        Whether the final layer was loaded too.

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
    False
    >>> bool((network.conv1.weight == trained.conv1.weight).all())
    True
    """
    if weights is None:
        return False
    path = _published(network) if weights == "imagenet" else _existing(weights)
    if path.suffix == ".safetensors":
        return _put(network, _dequantized(read_tensors(path)[0], path), path)
    return _put(network, _unpickled(path), path)


def digest_of(weights: str | Path | None) -> str | None:
    """SHA-256 of a file that :func:`load_weights` would read; None for None and ``"imagenet"``, which say it all.

    Raises
    ------
    CheckpointError
        There is no such file, or it cannot be read.
    """
    if weights is None or weights == "imagenet":
        return None
    path = _existing(weights)
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise CheckpointError(f"{path} cannot be read ({error.strerror})") from error


def _existing(weights: str | Path) -> Path:
    path = weights_file(weights)
    if not path.is_file() or path.suffix not in _FORMATS:
        raise CheckpointError(
            f"there are no weights at {str(weights)!r}; give 'imagenet', None for random ones, a file that ends in "
            f"{', '.join(_FORMATS)}, or the name of a network that comes with the library: {_shipped_names()}"
        )
    return path


def _published(network: ResNet) -> Path:
    """File of a network's ImageNet weights, downloaded where it is not there or not whole."""
    name = _architecture_of(network.state_dict())
    if name is None or name not in PUBLISHED:
        raise CheckpointError(
            f"there are no published weights from ImageNet for {repr(name) if name else 'this architecture'}; "
            f"there are for {' and '.join(map(repr, PUBLISHED))}, and weights=None begins with random ones"
        )
    url, path = _PUBLISHER + PUBLISHED[name], Path(torch.hub.get_dir()) / "checkpoints" / PUBLISHED[name]
    digits = path.stem.rpartition("-")[2]
    try:
        if not (path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest().startswith(digits)):
            path.parent.mkdir(parents=True, exist_ok=True)
            with _patience():
                torch.hub.download_url_to_file(url, str(path), digits)
    except (OSError, HTTPException, RuntimeError) as error:  # the last: of another checksum
        raise DownloadError(
            f"{url} cannot be downloaded to {path} ({error}). Put the file there by hand, name another folder for "
            "downloads by TORCH_HOME, or begin with random weights: weights=None"
        ) from error
    return path


@contextmanager
def _patience() -> Iterator[None]:
    """Count a server as gone that says nothing for :data:`_PATIENCE`: torch would wait forever."""
    usual = socket.getdefaulttimeout()
    socket.setdefaulttimeout(_PATIENCE)
    try:
        yield
    finally:
        socket.setdefaulttimeout(usual)


def _unpickled(path: Path) -> dict[str, Tensor]:
    """Tensors by name in a file that :func:`torch.save` wrote."""
    try:
        found = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # a damaged pickle can raise any
        raise CheckpointError(
            f"{path} is damaged, or holds other objects than tensors; those can run code, so they were not loaded. "
            "Save what torch.save(network.state_dict(), file) saves"
        ) from error
    if not isinstance(found, dict) or not all(isinstance(tensor, Tensor) for tensor in found.values()):
        names = ", ".join(map(repr, list(found)[:5])) if isinstance(found, dict) else type(found).__name__
        raise CheckpointError(
            f"{path} holds no tensors by name, but {names}; save what torch.save(network.state_dict(), file) saves"
        )
    return found


# --- tensors into a network -----------------------------------------------------------------------------------------


def _put(network: ResNet, found: Mapping[str, Tensor], source: Path) -> bool:
    """Copy tensors into a network if they are all that it has and no others; whether the final layer was among them."""
    own = network.state_dict()
    head = {name: own[name] for name in _HEAD}
    outputs = found["fc.bias"].shape if "fc.bias" in found else own["fc.bias"].shape
    kept = outputs != own["fc.bias"].shape
    if kept:  # by this many outputs the file's final layer must be a whole one all the same
        own.update({name: tensor.new_empty((*outputs, *tensor.shape[1:])) for name, tensor in head.items()})
    if wrong := _differences(own, found):
        name = _architecture_of(found)
        more = f"; and {len(wrong) - 3} differences more" if len(wrong) > 3 else ""
        fits = f"it would fit {name!r}" if name else f"it fits none of {', '.join(NETWORKS)} either"
        raise CheckpointError(f"{source} is not of this network: {'; '.join(wrong[:3])}{more}. As a whole {fits}")
    for name, tensor in found.items():
        if not tensor.isfinite().all():
            raise CheckpointError(f"{source} is damaged: {name!r} holds numbers that are not finite; train it anew")
    network.load_state_dict({**own, **found, **(head if kept else {})})
    return not kept


def _differences(own: Mapping[str, Tensor], found: Mapping[str, Tensor]) -> list[str]:
    """What keeps tensors from being a network's, in words."""
    wrong = [f"it lacks {name}" for name in own if name not in found and not name.endswith(_COUNTER)]
    for name, tensor in found.items():
        if name not in own:
            wrong.append(f"it has {name}, which the network lacks")
        elif tensor.shape != own[name].shape:
            wrong.append(f"its {name} is {tuple(tensor.shape)}, where the network's is {tuple(own[name].shape)}")
        elif tensor.is_floating_point() != own[name].is_floating_point():
            wrong.append(f"its {name} is of {tensor.dtype}, where the network's is of {own[name].dtype}")
    return wrong


def _architecture_of(tensors: Mapping[str, Tensor]) -> str | None:
    """The name in ``NETWORKS`` of the network that has tensors of these shapes, whatever its number of outputs."""

    def body(tensors: Mapping[str, Tensor]) -> dict[str, torch.Size]:
        return {name: t.shape for name, t in tensors.items() if name not in _HEAD and not name.endswith(_COUNTER)}

    for name in NETWORKS:
        with torch.device("meta"):  # shapes without numbers
            candidate = ResNet(name)
        if body(candidate.state_dict()) == body(tensors):
            return name
    return None


# --- files ----------------------------------------------------------------------------------------------------------


def write_tensors(path: Path | str, tensors: Mapping[str, Tensor], about: Mapping[str, Any]) -> None:
    """Write tensors and JSON data about them, whole or not at all; the same input gives the same bytes anywhere."""
    kept = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    try:
        write_file(path, save(kept, {_ABOUT: json.dumps(about, sort_keys=True)}))
    except OSError as error:
        raise CheckpointError(f"{path} cannot be written ({error.strerror}); what was there is still there") from error


def read_tensors(path: Path | str) -> tuple[dict[str, Tensor], dict[str, Any] | None]:
    """Tensors of a safetensors file, and what :func:`write_tensors` wrote about them; None where another wrote it."""
    try:
        with safe_open(path, framework="pt") as file:
            about = json.loads((file.metadata() or {}).get(_ABOUT, "null"))
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, ValueError) as error:
        raise CheckpointError(f"{path} cannot be read as safetensors ({error}); is it whole?") from error
    return tensors, about if isinstance(about, dict) else None
