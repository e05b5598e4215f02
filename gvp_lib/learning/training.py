"""Training a network on a set of viewpoints; one that was killed resumes to the same weights. Thesis 2.4.4, 2.4.5, 3.2.

After each epoch the folder holds the weights, the history and the state to resume from, each written atomically.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from tqdm import tqdm

from gvp_lib.checks import checked
from gvp_lib.errors import CheckpointError, DatasetError, InvalidParameterError, TrainingDivergedError
from gvp_lib.jobs import disk_errors, open_locked, write_file
from gvp_lib.learning.checkpoints import (
    TrainedNetwork,
    load_trained,
    load_weights,
    metadata_text,
    save_trained,
    weights_file,
)
from gvp_lib.learning.config import OBJECTIVES, Objective, TiltObjective, TrainConfig, score_text
from gvp_lib.learning.dataset import ViewpointDataset
from gvp_lib.learning.policy import device_name, find_device, on_threads
from gvp_lib.learning.resnet import ResNet, normalized
from gvp_lib.learning.shards import as_folders, as_path, read_card
from gvp_lib.picture import Pictured
from gvp_lib.planning.plan import Action

__all__ = ["WEIGHTS", "Training", "evaluate", "make_optimizer", "train", "train_epoch"]

WEIGHTS, HISTORY, STATE, LOCK = "weights.safetensors", "history.json", "state.pt", ".lock"
_ORDER = 8  # a stream of random numbers; `dataset` has others of the same seed
_EVALUATION_BATCH = 256

# A first epoch from random weights costs up to twice what an uninformed network does, and so may a rate that is high
# and yet learns. The bound is on the training loss alone: in evaluation mode such a training may pass through
# thousands before the running means of its normalizations have settled, and recover.
_DIVERGED = 6.0


@dataclass(frozen=True, eq=False)
class Training(Pictured):
    """Result of a training.

    Attributes
    ----------
    folder
        Folder with ``weights.safetensors``, for :class:`gvp_lib.NetworkPolicy` and :func:`load_trained`, and
        ``history.json``.
    trained
        Trained network and its metadata.
    history
        One entry per epoch: ``epoch``, from 1; learning ``rate``; ``loss`` and score (``accuracy`` in [0, 1], or
        ``error_deg``) on the training set, while the weights changed; ``validation_loss`` and ``validation_`` score
        after the epoch, and for tilts ``validation_calibration``; ``seconds``.
    epochs
        Number of epochs that this call ran, as opposed to those it resumed from.
    """

    _figure = "plot_training"

    folder: Path
    trained: TrainedNetwork
    history: list[dict[str, float]]
    epochs: int

    def __repr__(self) -> str:
        network, target, n = self.trained.metadata["network"], self.trained.metadata["target"], len(self.history)
        name = f"validation_{OBJECTIVES[target].score}"
        best = (max if target == "action" else min)(self.history, key=lambda entry: entry[name])
        return (
            f"Training({network}, {target}, {n} epoch{'s' * (n != 1)} ({self.epochs} now), "
            f"best validation {score_text(target, best[name])} in epoch {best['epoch']}, in {self.folder.name!r})"
        )


@checked(own=("data", "folder", "device"))
def train(
    data: Path | str | Sequence[Path | str],
    folder: Path | str,
    config: TrainConfig | None = None,
    *,
    device: str | torch.device = "auto",
    threads: int | None = None,
    progress: bool = True,
    on_epoch: Callable[[dict[str, float]], None] | None = None,
    metadata: Mapping[str, Any] | None = None,
) -> Training:
    """Train a network on one set of viewpoints or several, or resume a training that was interrupted.

    Parameters
    ----------
    data
        Folder of a set that :func:`gvp_lib.collect_dataset` collected, or several folders to concatenate.
    folder
        Folder for the weights and the state after each epoch; created if missing.
    config
        Configuration; by default the thesis's, from random weights.
    device
        Device to train on: ``"cpu"``, ``"cuda"``, ..., or a ``torch.device``; ``"auto"`` for a GPU where there is one.
    threads
        Number of threads to compute on; None for as many as torch is set to.
    progress
        Whether to show a progress bar.
    on_epoch
        Callback, called with each epoch's entry of the history.
    metadata
        JSON data to add to the metadata of the weights, such as the ``command`` that asked for them.

    Raises
    ------
    DatasetError
        A set is unfinished or damaged, or one of the five actions is best for none of the training samples.
    CheckpointError
        The folder holds another training, or one without a state to resume from; another process trains there; it
        cannot be written; or the initial weights are missing, or of another architecture.
    DownloadError
        ImageNet's weights cannot be downloaded.
    InvalidParameterError
        There is no such device here; ``threads`` is less than 1; or the sets have images of several sizes and no
        ``crop`` is given.
    TrainingDivergedError
        The training loss exceeded six times that of an uninformed network, or a loss is not finite. The weights of the
        last good epoch, or with ``patience`` of the best, are kept.

    Notes
    -----
    Each epoch's order and augmentation depend on the seed and its number alone. So the same call resumes a training
    that was killed, and ends at the same weights to the bit, on one kind of processor and with the same number of
    threads. On a GPU, whose kernels may sum in another order each time, the last bits differ.

    Examples
    --------
    >>> import tempfile
    >>> from gvp_lib import collect_dataset
    >>> from gvp_lib.learning import CollectionRecipe
    >>> work = Path(tempfile.mkdtemp())
    >>> recipe = CollectionRecipe(arm="floating", n=16, sampling="random")
    >>> _ = collect_dataset(work / "set", recipe, progress=False)
    >>> config = TrainConfig(network="resnet18_half", target="tilt", size=32, epochs=1)
    >>> train(work / "set", work / "run", config, progress=False)
    Training(resnet18_half, tilt, 1 epoch (1 now), best validation error ... deg in epoch 1, in 'run')
    """
    config, out = config or TrainConfig(), as_path(folder, "a training goes into", "a folder, given by its path")
    folders = as_folders(data)
    if not folders:
        raise InvalidParameterError("a training needs one set of viewpoints or more; got none")
    with ExitStack() as stack:
        stack.enter_context(on_threads(threads))
        device, objective = find_device(device), OBJECTIVES[config.target]
        recipe, crop = _recipe(folders, config)
        metadata = {
            **recipe,
            "network": config.network,
            "outputs": objective.outputs,
            "target": config.target,
            "crop": crop,
            "size": config.size,
            "versions": {"torch": torch.__version__},
            "device": device_name(device),
            **(metadata or {}),
        }
        metadata_text(metadata)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed)
            network = ResNet(config.network, objective.outputs)
        network.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        optimizer = make_optimizer(network, config)
        history = _history(out, recipe)
        if not _is_finished(history, config):  # what is finished is only read, perhaps where nothing may be written
            with disk_errors(out, CheckpointError):
                stack.enter_context(open_locked(out / LOCK))
            history = _resume(out, recipe, config, network, optimizer)
        first = len(history)
        if not _is_finished(history, config):  # what is finished needs no pictures, and of many sets they take minutes
            names = ("share", "seed", "target", "size", "crop", "step")
            options: dict[str, Any] = {name: getattr(config, name) for name in names}
            train_set = ViewpointDataset(
                folders, "train", shift=config.shift, dihedral=config.dihedral, colors=config.colors, **options
            )
            validation_set = ViewpointDataset(folders, "validation", verify=False, **options)
            check_sets(train_set, validation_set)
            if not history:
                load_weights(network, config.weights)
        bar = stack.enter_context(tqdm(total=config.epochs, initial=first, disable=not progress, unit="epoch"))
        while not _is_finished(history, config):
            epoch, began, score = len(history), time.perf_counter(), objective.score
            train_set.epoch = epoch
            order = np.random.default_rng([config.seed, _ORDER, epoch]).permutation(len(train_set))
            entry = {"epoch": epoch + 1, "rate": config.rate(epoch, 0.0)}
            entry["loss"], entry[score] = train_epoch(network, optimizer, train_set, order, config, epoch, device)
            scores = {f"validation_{name}": value for name, value in evaluate(network, validation_set, device).items()}
            entry |= scores
            best = _best_epoch(history, config)
            kept = f"the weights of epoch {best} are kept in {out}" if best else "nothing is kept"
            check_loss(entry, objective, config.learning_rate, kept)
            entry["seconds"] = round(time.perf_counter() - began, 3)
            history.append(entry)
            # First the weights, then the state: a run that is killed in between repeats the epoch.
            if _best_epoch(history, config) == epoch + 1:
                trained = TrainedNetwork(network, {**metadata, "epoch": epoch + 1, "scores": scores})
                save_trained(out / WEIGHTS, trained)
            _save_state(out, history, network, optimizer)
            bar.update()
            bar.set_postfix_str(
                f"loss {entry['loss']:.3f}, {entry['validation_loss']:.3f} on the validation set; "
                f"{score} {entry[score]:.3f}, {entry['validation_' + score]:.3f}"
            )
            if on_epoch is not None:
                on_epoch(entry)
        return Training(out, load_trained(out / WEIGHTS), history, len(history) - first)


def _best_epoch(history: Sequence[Mapping[str, float]], config: TrainConfig) -> int:
    """Epoch, from 1, whose weights are kept: the last, or with patience the best; 0 before the first."""
    losses = [entry["validation_loss"] for entry in history]
    return len(losses) if config.patience is None or not losses else 1 + int(np.argmin(losses))


def _is_finished(history: Sequence[Mapping[str, float]], config: TrainConfig) -> bool:
    """Whether every epoch was run, or patience has run out."""
    epochs, patience = len(history), config.patience
    return epochs >= config.epochs or (patience is not None and epochs - _best_epoch(history, config) >= patience)


# --- the training on disk -------------------------------------------------------------------------------------------


def _recipe(data: Sequence[Path], config: TrainConfig) -> tuple[dict[str, Any], int]:
    """Everything that decides the weights, as JSON data; and the side of the crop of each image, px."""
    cards = [read_card(each) for each in data]
    crops = [config.crop or card["recipe"]["crop"] for card in cards]
    if len(set(crops)) > 1:
        raise InvalidParameterError(
            f"sets to train on together need images of one size; these have {crops} px. Give the central square to "
            f"use of all of them: crop={min(crops)}"
        )
    data_sets = [
        {"recipe": card["recipe"], "shards": _digest(json.dumps(card["shards"], sort_keys=True).encode())}
        for card in cards  # sets of one recipe differ by their shards
    ]
    recipe: dict[str, Any] = {"config": config.to_dict(), "data": data_sets}
    if config.weights not in (None, "imagenet"):  # a file: every training's has the same name
        file = weights_file(config.weights)
        try:
            recipe["weights_sha256"] = _digest(file.read_bytes())
        except OSError as error:
            raise CheckpointError(f"{file} cannot be read ({error.strerror})") from error
    return recipe, crops[0]


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _save_state(
    folder: Path, history: list[dict[str, float]], network: ResNet, optimizer: torch.optim.Optimizer
) -> None:
    """Write the history, and the state that :func:`_resume` reads."""
    state = io.BytesIO()
    torch.save({"history": history, "network": network.state_dict(), "optimizer": optimizer.state_dict()}, state)
    with disk_errors(folder, CheckpointError):
        write_file(folder / HISTORY, (json.dumps(history, indent=1) + "\n").encode())
        write_file(folder / STATE, state.getvalue())


def _history(folder: Path, recipe: Mapping[str, Any]) -> list[dict[str, float]]:
    """History of the training in a folder, which must have this recipe; empty where it is missing or damaged."""
    if not (folder / WEIGHTS).is_file():
        return []
    stored, wanted = load_trained(folder / WEIGHTS).metadata, json.loads(json.dumps(recipe))
    # Options that an older version did not have were as by default.
    old = {**TrainConfig().to_dict(), **stored.get("config", {}), "weights_sha256": stored.get("weights_sha256")}
    new = {**wanted["config"], "weights_sha256": wanted.get("weights_sha256")}
    differing = [f"{name} {old[name]!r} there, {new[name]!r} here" for name in new if old[name] != new[name]]
    if differing or stored.get("data") != wanted["data"]:
        raise CheckpointError(
            f"{folder} holds another training ({', '.join(differing) or 'of other data'}); choose another folder, or "
            "remove it"
        )
    with suppress(OSError, ValueError):
        return list(json.loads((folder / HISTORY).read_bytes()))
    return []


def _resume(
    folder: Path, recipe: Mapping[str, Any], config: TrainConfig, network: ResNet, optimizer: torch.optim.Optimizer
) -> list[dict[str, float]]:
    """Load the state of the training in a folder into network and optimizer; its history, empty where there is none."""
    history, state_file = _history(folder, recipe), folder / STATE
    if _is_finished(history, config) or not (folder / WEIGHTS).is_file():  # another run may have finished it by now
        return history
    if not state_file.is_file() and len(history) <= 1 and load_trained(folder / WEIGHTS).metadata["epoch"] == 1:
        return []  # killed before its first epoch was all on disk
    try:
        state = torch.load(state_file, map_location="cpu", weights_only=True)
        network.load_state_dict(state["network"])
        optimizer.load_state_dict(state["optimizer"])
    except Exception as error:  # a damaged pickle can raise any
        raise CheckpointError(
            f"this training cannot resume from {state_file} ({error!r}); it is damaged, or of another version of the "
            "library. Choose another folder, or remove this one to begin anew"
        ) from error
    return list(state["history"])


# --- checks ---------------------------------------------------------------------------------------------------------


def check_sets(train_set: ViewpointDataset, validation_set: ViewpointDataset) -> None:
    """Check that the sets suffice to train and to validate."""
    if len(train_set) < 2 or not len(validation_set):
        raise DatasetError(
            f"{len(train_set)} samples to train and {len(validation_set)} to validate are too few; collect more"
        )
    missing = [action.name for action in Action if action not in train_set.actions]
    if train_set.target == "action" and missing:
        raise DatasetError(
            f"of the five actions the {len(train_set)} samples for training lack {', '.join(missing)}, which a network "
            "thus cannot learn to choose; collect more samples, over the whole cap. NO_OP is best only within 0.71 "
            "steps of the normal, so a larger step has more of it"
        )


def check_loss(entry: Mapping[str, float], objective: Objective, rate: float, kept: str) -> None:
    """Check by an epoch's entry of the history that the training has not diverged."""
    loss, bound = entry["loss"], _DIVERGED * objective.ignorance
    if loss <= bound and math.isfinite(entry["validation_loss"]):
        return
    raise TrainingDivergedError(
        f"in epoch {entry['epoch']:g} the training loss is {loss:.3g} and the validation loss "
        f"{entry['validation_loss']:.3g}; the first must not exceed {bound:.3g}, {_DIVERGED:g} times that of an "
        f"uninformed network, and the second must be finite; {kept}. A smaller learning rate than {rate:g} may do, "
        f"say {rate / 10:g}, in another folder"
    )


# --- training and evaluation ----------------------------------------------------------------------------------------


def train_epoch(
    network: ResNet,
    optimizer: torch.optim.Optimizer,
    data: ViewpointDataset,
    order: NDArray[np.int64],
    config: TrainConfig,
    epoch: int,
    device: str = "cpu",
) -> tuple[float, float]:
    """Take a step for each batch of an order; mean loss and mean score, as the weights changed.

    A last batch of one sample goes with the batch before it: batch normalization has no statistics of one.
    """
    objective = OBJECTIVES[data.target]
    network.train()
    loss_sum = torch.zeros((), device=device)
    score_sum = torch.zeros((), device=device)
    for number, indices in enumerate(np.split(order, range(config.batch, len(order) - 1, config.batch))):
        for group in optimizer.param_groups:
            group["lr"] = config.rate(epoch, number * config.batch / len(order))
        images, targets = (part.to(device, non_blocking=True) for part in data.batch(indices))
        outputs = network(normalized(images).contiguous(memory_format=torch.channels_last))
        loss = objective.loss(outputs, targets)
        network.zero_grad(set_to_none=True)
        loss.backward()
        optimizer.step()
        with torch.no_grad():  # summed on the device: reading them would stall a GPU
            loss_sum += loss * len(indices)
            score_sum += objective.total_score(outputs, targets)
    return float(loss_sum) / len(order), float(score_sum) / len(order)


@checked(own=True)
def evaluate(
    network: ResNet | TrainedNetwork, data: ViewpointDataset, device: str | torch.device = "cpu"
) -> dict[str, float]:
    """Evaluate a network on a data set, in evaluation mode.

    Parameters
    ----------
    network
        Network, on ``device``, whose outputs are for the set's target; or a trained one.
    data
        Data set to evaluate on.
    device
        Device of the network.

    Returns
    -------
    dict
        Mean ``loss``, which is the objective's ``cost``, and mean score, ``accuracy`` or ``error_deg``. For tilts also
        ``calibration``: the factor that makes the predicted standard deviations those of the errors on this set.

    Raises
    ------
    DatasetError
        The set is empty.
    InvalidParameterError
        The network's outputs are for another target.

    Examples
    --------
    >>> import tempfile
    >>> from gvp_lib import collect_dataset
    >>> from gvp_lib.learning import CollectionRecipe
    >>> folder, recipe = tempfile.mkdtemp(), CollectionRecipe(arm="floating", n=16, sampling="random")
    >>> _ = collect_dataset(folder, recipe, progress=False)
    >>> evaluate(load_trained("actions-1x2").network, ViewpointDataset(folder, "all"))["accuracy"] > 0.5
    True
    """
    if not len(data):
        raise DatasetError(
            f"there is nothing to evaluate: the split {data.split!r} of the set is empty; collect more, or choose "
            "another share"
        )
    objective = OBJECTIVES[data.target]
    network = network.network if isinstance(network, TrainedNetwork) else network
    network.eval()
    loss = score = surprise = 0.0
    with torch.inference_mode():
        for indices in np.split(np.arange(len(data)), range(_EVALUATION_BATCH, len(data), _EVALUATION_BATCH)):
            images, targets = (part.to(device) for part in data.batch(indices))
            outputs = network(normalized(images))
            if outputs.shape[1] != objective.outputs:
                raise InvalidParameterError(
                    f"for the set's target, {data.target!r}, a network has {objective.outputs} outputs; this one has "
                    f"{outputs.shape[1]}. ViewpointDataset(target=...) chooses it"
                )
            loss += float(objective.cost(outputs, targets)) * len(indices)
            score += float(objective.total_score(outputs, targets))
            if isinstance(objective, TiltObjective):
                surprise += float(objective.total_surprise(outputs, targets))
    found = {"loss": loss / len(data), objective.score: score / len(data)}
    return found if data.target == "action" else found | {"calibration": math.sqrt(surprise / len(data))}


def make_optimizer(network: ResNet, config: TrainConfig) -> torch.optim.Optimizer:
    """Optimizer of a configuration for a network, on its device; fused, which steps in one pass over the memory.

    It does not hold the parameters but views that share their memory, with axes in the order in which that lies: a
    fused step would first copy a gradient that is channels last, which takes longer than the step.
    """
    own = list(network.parameters())
    views = [torch.nn.Parameter(_in_memory_order(parameter.detach())) for parameter in own]
    options: dict[str, Any] = {"lr": config.learning_rate, "weight_decay": config.weight_decay, "fused": True}
    if config.optimizer == "sgd":
        options["momentum"] = config.momentum
    optimizer = {"sgd": torch.optim.SGD, "adamw": torch.optim.AdamW}[config.optimizer](views, **options)

    def share_gradients(*_: Any) -> None:
        for view, parameter in zip(views, own, strict=True):
            view.grad = None if parameter.grad is None else _in_memory_order(parameter.grad)

    optimizer.register_step_pre_hook(share_gradients)
    optimizer.register_step_post_hook(lambda *_: optimizer.zero_grad(set_to_none=True))  # the gradients are not its own
    return optimizer


def _in_memory_order(tensor: Tensor) -> Tensor:
    """View of a channels-last tensor with its axes in the order of its memory; any other tensor itself."""
    return tensor.permute(0, 2, 3, 1) if tensor.dim() == 4 and not tensor.is_contiguous() else tensor
