"""Weights to begin a training with: those from ImageNet, as in the thesis, or a file's. Thesis 2.4.1.

A file is safetensors, which hold numbers only, or what ``torch.save(network.state_dict(), file)`` wrote. The latter is
a pickle, which can hold code; torch reads the tensors in it and refuses everything else, so no code runs.
"""

from __future__ import annotations

import hashlib
import io
import urllib.request
import uuid
from collections.abc import Mapping
from contextlib import suppress
from http.client import HTTPException
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor
from tqdm import tqdm

from gvp_lib.errors import CheckpointError, DownloadError
from gvp_lib.learning.checkpoints import dequantized, shipped_names, weights_file
from gvp_lib.learning.resnet import NETWORKS, ResNet

__all__ = ["PUBLISHED", "digest_of", "load_weights"]

PUBLISHED: Mapping[str, str] = {"resnet50": "resnet50-0676ba61.pth", "resnet18": "resnet18-f37072fd.pth"}
"""Files of weights from ImageNet; the digits begin the file's SHA-256.

They are torchvision's first, ``IMAGENET1K_V1``: a thesis of 2020 had no others. The newer ones of ResNet-50,
``resnet50-11ad3fa6.pth``, load by their path.
"""

_PUBLISHER = "https://download.pytorch.org/models/"
_PATIENCE = 30  # s without an answer
_CHUNK = 1 << 20  # bytes
_FORMATS = (".safetensors", ".pth", ".pt")
_HEAD = ("fc.weight", "fc.bias")
_COUNTER = "num_batches_tracked"  # of batch normalization; files from before 2018 lack it, and nothing here needs it


def load_weights(network: ResNet, weights: str | Path | None) -> bool:
    """Load weights into a network, all or none of them.

    Parameters
    ----------
    network
        Where the file's final layer has another number of outputs, the network keeps its own.
    weights
        None leaves the network as it is. ``"imagenet"`` loads what PyTorch publishes for the network's architecture
        (see :data:`PUBLISHED`); it is downloaded once, checked before it is opened, and kept in the ``checkpoints`` of
        ``torch.hub.get_dir()``, where torchvision keeps it too. Such weights expect pictures that are
        :func:`~gvp_lib.learning.resnet.normalized`. Anything else is the path of a file, ``.safetensors``, ``.pth`` or
        ``.pt``, with torchvision's names, as `gvp train` writes them too, in any precision; or the name of a network
        that comes with the library.

    Returns
    -------
    bool
        Whether the final layer was loaded too.

    Raises
    ------
    CheckpointError
        There is no such file; it is damaged, holds more than tensors, or is of another architecture; or none
        are published for this one.
    DownloadError
        The published file cannot be fetched or kept, or is not the one that it should be.

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
    if weights == "imagenet":
        name = _architecture_of(network.state_dict())
        if name is None or name not in PUBLISHED:
            raise CheckpointError(
                f"there are no published weights from ImageNet for {repr(name) if name else 'this architecture'}; "
                f"there are for {' and '.join(map(repr, PUBLISHED))}, and weights=None begins with random ones"
            )
        return _put(network, *_published(PUBLISHED[name]))
    path = _file_of(weights)
    return _put(network, _read(path), path)


def digest_of(weights: str | Path | None) -> str | None:
    """SHA-256 of a file that :func:`load_weights` would read; None for None and ``"imagenet"``, which say it all.

    Raises
    ------
    CheckpointError
        There is no such file, or it cannot be read.
    """
    if weights is None or weights == "imagenet":
        return None
    path = _file_of(weights)
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise CheckpointError(f"{path} cannot be read ({error.strerror})") from error


def _file_of(weights: str | Path) -> Path:
    """The file of weights by their path or their name, if there is one."""
    path = weights_file(weights)
    if not path.is_file() or path.suffix not in _FORMATS:
        raise CheckpointError(
            f"there are no weights at {str(weights)!r}; give 'imagenet', None for random ones, a file that ends in "
            f"{', '.join(_FORMATS)}, or the name of a network that comes with the library: {shipped_names()}"
        )
    return path


def _put(network: ResNet, found: Mapping[str, Tensor], source: Path) -> bool:
    """Copy tensors into a network if they are all that it has and no others; whether the final layer was among them."""
    own = network.state_dict()
    head = {name: own[name] for name in _HEAD}
    outputs = found["fc.bias"].shape if "fc.bias" in found else own["fc.bias"].shape
    kept = outputs != own["fc.bias"].shape
    if kept:  # by this many outputs the file's final layer must be a whole one all the same
        own.update({name: tensor.new_empty((*outputs, *tensor.shape[1:])) for name, tensor in head.items()})
    wrong = _differences(own, found)
    if wrong:
        name = _architecture_of(found)
        more = f"; and {len(wrong) - 3} differences more" if len(wrong) > 3 else ""
        fits = f"it would fit {name!r}" if name else f"it fits none of {', '.join(NETWORKS)} either"
        raise CheckpointError(f"{source} is not of this network: {'; '.join(wrong[:3])}{more}. As a whole {fits}")
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


def _read(path: Path) -> dict[str, Tensor]:
    """The tensors in a file, by name."""
    if path.suffix == ".safetensors":
        try:
            return dequantized(load_file(path), path)
        except (SafetensorError, OSError) as error:
            raise CheckpointError(f"{path} cannot be read as safetensors ({error}); is it whole?") from error
    return _tensors(path, path)


def _tensors(file: Path | io.BytesIO, source: Path) -> dict[str, Tensor]:
    """What :func:`torch.save` wrote, if it is tensors by name."""
    try:
        found = torch.load(file, map_location="cpu", weights_only=True)
    except Exception as error:  # a damaged pickle can raise any
        raise CheckpointError(
            f"{source} is damaged, or holds other objects than tensors; those can run code, so they were not loaded. "
            "Save what torch.save(network.state_dict(), file) saves"
        ) from error
    if not isinstance(found, dict) or not all(isinstance(tensor, Tensor) for tensor in found.values()):
        names = ", ".join(map(repr, list(found)[:5])) if isinstance(found, dict) else type(found).__name__
        raise CheckpointError(
            f"{source} holds no tensors by name, but {names}; save what torch.save(network.state_dict(), file) saves"
        )
    return found


def _published(name: str) -> tuple[dict[str, Tensor], Path]:
    """The tensors of a published file, and where it is kept."""
    path = Path(torch.hub.get_dir()) / "checkpoints" / name
    data = b""
    with suppress(OSError):
        data = path.read_bytes()
    if not _is_whole(data, name):  # the name says what it must hold; a damaged one is replaced
        data = _fetched(name, path)
        _keep(path, data)
    return _tensors(io.BytesIO(data), path), path  # the bytes that were checked, whatever has become of the file


def _is_whole(data: bytes, name: str) -> bool:
    return hashlib.sha256(data).hexdigest().startswith(Path(name).stem.rpartition("-")[2])


def _fetched(name: str, path: Path) -> bytes:
    """Download a published file, and compare it with its checksum."""
    data, by_hand = bytearray(), f"put the file at {path} by hand, or begin with random weights: weights=None"
    try:
        with (
            urllib.request.urlopen(_PUBLISHER + name, timeout=_PATIENCE) as answer,
            tqdm(total=answer.length, unit="B", unit_scale=True, desc=name) as bar,
        ):
            while chunk := answer.read(_CHUNK):
                data += chunk
                bar.update(len(chunk))
    except (OSError, HTTPException) as error:
        reason = getattr(error, "reason", None) or error
        raise DownloadError(f"{_PUBLISHER}{name} cannot be fetched ({reason}); {by_hand}") from error
    if not _is_whole(bytes(data), name):
        raise DownloadError(
            f"what came from {_PUBLISHER}{name}, {len(data)} bytes, is not the published file: its SHA-256 does not "
            f"begin with the digits in its name. Nothing was kept. Try again, {by_hand}"
        )
    return bytes(data)


def _keep(path: Path, data: bytes) -> None:
    """Write a file whole or not at all, whoever else writes it at the same time."""
    draft = path.with_name(f".{path.name}.{uuid.uuid4().hex}")  # beside it, so that the renaming is atomic
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        draft.write_bytes(data)
        draft.replace(path)
    except OSError as error:
        raise DownloadError(
            f"{path} cannot be written ({error.strerror}); TORCH_HOME names another folder for what is downloaded"
        ) from error
    finally:
        with suppress(OSError):
            draft.unlink()
