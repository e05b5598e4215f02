"""Training a network on a set of viewpoints; one that was killed goes on to the same weights. Thesis 2.4.4, 2.4.5, 3.2.

After each epoch the folder holds the weights, the history and the state to go on from, each written whole or not at
all.
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

from gvp_lib.errors import CheckpointError, DatasetError, InvalidParameterError, TrainingDivergedError
from gvp_lib.jobs import disk_errors, open_locked, write_file
from gvp_lib.learning.checkpoints import TrainedNetwork, load_trained, load_weights, save_trained, weights_file
from gvp_lib.learning.config import OBJECTIVES, Objective, TiltObjective, TrainConfig
from gvp_lib.learning.dataset import ViewpointDataset
from gvp_lib.learning.policy import device_name, find_device, on_threads
from gvp_lib.learning.resnet import ResNet, normalized
from gvp_lib.learning.shards import read_card
from gvp_lib.picture import Pictured
from gvp_lib.planning.plan import Action

__all__ = ["WEIGHTS", "Training", "evaluate", "make_optimizer", "train", "train_epoch"]

WEIGHTS, HISTORY, STATE, LOCK = "weights.safetensors", "history.json", "state.pt", ".lock"
_ORDER = 8  # a stream of random numbers; `dataset` has others of the same seed
_AT_ONCE = 256  # pictures in one pass where nothing is learned

# A first epoch from random weights costs up to twice as much as knowing nothing, and so may a rate that is high and
# yet learns. The bound is on the loss over the training alone: in evaluation mode such a training may pass through
# thousands before the running means of its normalizations have settled, and recover.
_HOPELESS = 6.0


@dataclass(frozen=True, eq=False)
class Training(Pictured):
    """A finished training.

    Attributes
    ----------
    folder
        Folder with ``weights.safetensors``, for :class:`gvp_lib.NetworkPolicy` and :func:`load_trained`, and
        ``history.json``.
    trained
        The network and what it is of.
    history
        For each epoch: ``rate``; ``loss`` and the score (``accuracy`` in [0, 1], or ``error_deg``) over the training,
        as the weights changed; ``validation_loss`` and the ``validation_`` score after it, and for tilts
        ``validation_calibration``; ``seconds``.
    epochs
        Number of epochs run now, rather than resumed from before.
    """

    _figure = "plot_training"

    folder: Path
    trained: TrainedNetwork
    history: list[dict[str, float]]
    epochs: int


def train(
    data: Path | str | Sequence[Path | str],
    folder: Path | str,
    config: TrainConfig | None = None,
    *,
    device: str = "auto",
    threads: int | None = None,
    progress: bool = True,
    on_epoch: Callable[[dict[str, float]], None] | None = None,
    about: Mapping[str, Any] | None = None,
) -> Training:
    """Train a network on a set of viewpoints, or on several put together.

    After each epoch the state goes to ``folder``. The same call resumes a training that was killed, and on one kind of
    processor with as many threads it ends at the same weights, to the bit; on a GPU, whose kernels may add in another
    order each time, but for the last bits. Each epoch's order and shifts depend on the seed and its number alone.

    Parameters
    ----------
    data
        Folders of sets that :func:`gvp_lib.collect_dataset` collected.
    folder
        Where the weights go; made if need be.
    config
        How to train; by default as in the thesis, from random weights.
    device
        ``"cpu"``, ``"cuda"``, ... ; ``"auto"``: a GPU where there is one.
    threads
        Processors to compute on; by default as many as torch is set to.
    progress
        Whether to show a bar.
    on_epoch
        Called with each epoch's line of the history.
    about
        JSON data to go with the weights into their file, such as the ``command`` that asked for them.

    Raises
    ------
    DatasetError
        A set is unfinished or damaged, or one of the five actions is the best of none of the samples for training.
    CheckpointError
        The folder holds another training, or one without a state to go on from; another process trains there now; it
        cannot be written; or the initial weights are not there, or of another network.
    DownloadError
        The weights from ImageNet cannot be downloaded.
    InvalidParameterError
        There is no such device here; ``threads`` is less than 1; sets have pictures of several sizes and no ``crop``
        says what to take of them.
    TrainingDivergedError
        The training loss exceeded six times that of a network that knows nothing, or a loss is no finite number. The
        weights of the last good epoch, or with ``patience`` of the best, are kept.
    """
    config, out = config or TrainConfig(), Path(folder)
    folders = [Path(data)] if isinstance(data, Path | str) else [Path(each) for each in data]
    if not folders:
        raise InvalidParameterError("a training needs one set of viewpoints or more; got none")
    with ExitStack() as held:
        held.enter_context(on_threads(threads))
        device, objective = find_device(device), OBJECTIVES[config.target]
        recipe, crop = _recipe(folders, config)
        made_of = {
            **recipe,
            "network": config.network,
            "outputs": objective.outputs,
            "target": config.target,
            "crop": crop,
            "size": config.size,
            "versions": {"torch": torch.__version__},
            "device": device_name(device),
            **(about or {}),
        }
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed)
            network = ResNet(config.network, objective.outputs)
        network.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        optimizer = make_optimizer(network, config)
        history = _history(out, recipe)
        if not _is_finished(history, config):  # what is finished is only read, perhaps where nothing may be written
            with disk_errors(out, CheckpointError):
                held.enter_context(open_locked(out / LOCK))
            history = _resume(out, recipe, config, network, optimizer)
        first = len(history)
        if not _is_finished(history, config):  # what is finished needs no pictures, and of many sets they take minutes
            names = ("share", "seed", "target", "size", "crop", "step")
            options: dict[str, Any] = {name: getattr(config, name) for name in names}
            train_set = ViewpointDataset(
                folders, "train", shift=config.shift, turns=config.turns, colors=config.colors, **options
            )
            validation_set = ViewpointDataset(folders, "validation", verify=False, **options)
            check_sets(train_set, validation_set)
            if not history:
                load_weights(network, config.weights)
        bar = held.enter_context(tqdm(total=config.epochs, initial=first, disable=not progress, unit="epoch"))
        while not _is_finished(history, config):
            epoch, began, score = len(history), time.perf_counter(), objective.score
            train_set.epoch = epoch
            order = np.random.default_rng([config.seed, _ORDER, epoch]).permutation(len(train_set))
            line = {"epoch": epoch + 1, "rate": config.rate(epoch, 0.0)}
            line["loss"], line[score] = train_epoch(network, optimizer, train_set, order, config, epoch, device)
            scores = {f"validation_{name}": value for name, value in evaluate(network, validation_set, device).items()}
            line |= scores
            best = _best_epoch(history, config)
            kept = f"the weights of epoch {best} are kept in {out}" if best else "nothing is kept"
            check_loss(line, objective, config.learning_rate, kept)
            line["seconds"] = round(time.perf_counter() - began, 3)
            history.append(line)
            # First what is for others, then the state: a run that is killed in between repeats the epoch.
            if _best_epoch(history, config) == epoch + 1:
                trained = TrainedNetwork(network, {**made_of, "epoch": epoch + 1, "scores": scores})
                save_trained(out / WEIGHTS, trained)
            _keep(out, history, network, optimizer)
            bar.update()
            bar.set_postfix_str(
                f"loss {line['loss']:.3f}, {line['validation_loss']:.3f} on the validation set; "
                f"{score} {line[score]:.3f}, {line['validation_' + score]:.3f}"
            )
            if on_epoch is not None:
                on_epoch(line)
        return Training(out, load_trained(out / WEIGHTS), history, len(history) - first)


def _best_epoch(history: Sequence[Mapping[str, float]], config: TrainConfig) -> int:
    """Epoch, from 1, whose weights are kept: the last, or with patience the best; 0 before the first."""
    losses = [line["validation_loss"] for line in history]
    return len(losses) if config.patience is None or not losses else 1 + int(np.argmin(losses))


def _is_finished(history: Sequence[Mapping[str, float]], config: TrainConfig) -> bool:
    """Whether every epoch was run, or patience is at its end."""
    epochs, patience = len(history), config.patience
    return epochs >= config.epochs or (patience is not None and epochs - _best_epoch(history, config) >= patience)


# --- the training on disk -------------------------------------------------------------------------------------------


def _recipe(data: Sequence[Path], config: TrainConfig) -> tuple[dict[str, Any], int]:
    """Everything that decides the weights, as JSON data; and the side of the middle taken of each picture, px."""
    cards = [read_card(each) for each in data]
    crops = [config.crop or card["recipe"]["crop"] for card in cards]
    if len(set(crops)) > 1:
        raise InvalidParameterError(
            f"sets that are put together have pictures of one size; these have {crops} px. Say which middle to take "
            f"of all of them: crop={min(crops)}"
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


def _keep(folder: Path, history: list[dict[str, float]], network: ResNet, optimizer: torch.optim.Optimizer) -> None:
    """Write the history, and the state from which :func:`_resume` goes on."""
    state = io.BytesIO()
    torch.save({"history": history, "network": network.state_dict(), "optimizer": optimizer.state_dict()}, state)
    with disk_errors(folder, CheckpointError):
        write_file(folder / HISTORY, (json.dumps(history, indent=1) + "\n").encode())
        write_file(folder / STATE, state.getvalue())


def _history(folder: Path, recipe: Mapping[str, Any]) -> list[dict[str, float]]:
    """History of a folder's training, which must be of this recipe; empty where there is none, or it is damaged."""
    if not (folder / WEIGHTS).is_file():
        return []
    was, now = load_trained(folder / WEIGHTS).about, json.loads(json.dumps(recipe))
    # What an older version did not know, it did as by default.
    there = {**TrainConfig().to_dict(), **was.get("config", {}), "weights_sha256": was.get("weights_sha256")}
    here = {**now["config"], "weights_sha256": now.get("weights_sha256")}
    differing = [f"{name} {there[name]!r} there, {here[name]!r} here" for name in here if there[name] != here[name]]
    if differing or was.get("data") != now["data"]:
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
    """Put the state of a folder's training into network and optimizer; its history, empty where there is none."""
    history, state_file = _history(folder, recipe), folder / STATE
    if _is_finished(history, config) or not (folder / WEIGHTS).is_file():  # by now another run may have gone on
        return history
    if not state_file.is_file() and len(history) <= 1 and load_trained(folder / WEIGHTS).about["epoch"] == 1:
        return []  # killed before its first epoch was all on disk
    try:
        state = torch.load(state_file, map_location="cpu", weights_only=True)
        network.load_state_dict(state["network"])
        optimizer.load_state_dict(state["optimizer"])
    except Exception as error:  # a damaged pickle can raise any
        raise CheckpointError(
            f"{state_file} is no state from which this training can go on ({error!r}); another version of the library "
            "wrote another. Choose another folder, or remove this one to begin anew"
        ) from error
    return list(state["history"])


# --- what is refused ------------------------------------------------------------------------------------------------


def check_sets(train_set: ViewpointDataset, validation_set: ViewpointDataset) -> None:
    """Check that there is something to learn, and to judge that by."""
    if len(train_set) < 2 or not len(validation_set):
        raise DatasetError(
            f"{len(train_set)} samples to train and {len(validation_set)} to validate are too few; collect more"
        )
    missing = [action.name for action in Action if action not in train_set.actions]
    if train_set.target == "action" and missing:
        raise DatasetError(
            f"of the five actions the {len(train_set)} samples for training lack {', '.join(missing)}, so that "
            "a network cannot learn when to choose it; collect more samples, over the whole cap. NO_OP is best within "
            "0.71 steps of the normal only, so a larger step has more of it"
        )


def check_loss(line: Mapping[str, float], objective: Objective, rate: float, kept: str) -> None:
    """Check that the losses of an epoch, a line of the history, are those of a training that may yet learn."""
    loss, bound = line["loss"], _HOPELESS * objective.ignorance
    if loss <= bound and math.isfinite(line["validation_loss"]):
        return
    raise TrainingDivergedError(
        f"in epoch {line['epoch']:g} the training loss is {loss:.3g} and the validation loss "
        f"{line['validation_loss']:.3g}; the first may be up to {bound:.3g}, {_HOPELESS:g} times that of a network "
        f"that knows nothing, and the second is finite where all is well; {kept}. A smaller learning rate than "
        f"{rate:g} may do, say {rate / 10:g}, in another folder"
    )


# --- passes over a set ----------------------------------------------------------------------------------------------


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
        with torch.no_grad():  # summed where they are: to read them would make a GPU wait
            loss_sum += loss * len(indices)
            score_sum += objective.total_score(outputs, targets)
    return float(loss_sum) / len(order), float(score_sum) / len(order)


def evaluate(network: ResNet, data: ViewpointDataset, device: str = "cpu") -> dict[str, float]:
    """Judge a network by a set, in evaluation mode.

    Returns
    -------
    dict
        Mean ``loss``, which is the objective's ``cost``, and mean score (``accuracy`` or ``error_deg``). Of tilts also
        ``calibration``: the factor that makes the predicted standard deviations those of the errors here.

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
        for indices in np.split(np.arange(len(data)), range(_AT_ONCE, len(data), _AT_ONCE)):
            images, targets = (part.to(device) for part in data.batch(indices))
            outputs = network(normalized(images))
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
    views = [torch.nn.Parameter(_as_it_lies(parameter.detach())) for parameter in own]
    options: dict[str, Any] = {"lr": config.learning_rate, "weight_decay": config.weight_decay, "fused": True}
    if config.optimizer == "sgd":
        options["momentum"] = config.momentum
    optimizer = {"sgd": torch.optim.SGD, "adamw": torch.optim.AdamW}[config.optimizer](views, **options)

    def lend(*_: Any) -> None:
        for view, parameter in zip(views, own, strict=True):
            view.grad = None if parameter.grad is None else _as_it_lies(parameter.grad)

    optimizer.register_step_pre_hook(lend)
    optimizer.register_step_post_hook(lambda *_: optimizer.zero_grad(set_to_none=True))  # the gradients are not its own
    return optimizer


def _as_it_lies(tensor: Tensor) -> Tensor:
    """A view of a tensor whose axes are in the order of its memory, where it is channels last."""
    return tensor.permute(0, 2, 3, 1) if tensor.dim() == 4 and not tensor.is_contiguous() else tensor
