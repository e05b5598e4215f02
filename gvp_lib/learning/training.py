"""Training a network on a set of viewpoints; one that was killed goes on to the same weights. Thesis 2.4.4, 2.4.5, 3.2.

After each epoch the folder holds the weights, the history and the state to go on from, each written whole or not at
all. The state is the network and its optimizer as tensors, beside the recipe and the history as JSON.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from tqdm import tqdm

from gvp_lib.errors import CheckpointError, DatasetError, InvalidParameterError, TrainingDivergedError
from gvp_lib.jobs import open_locked, write_file
from gvp_lib.learning.checkpoints import (
    TrainedNetwork,
    digest_of,
    load_trained,
    load_weights,
    read_tensors,
    save_trained,
    write_tensors,
)
from gvp_lib.learning.config import OBJECTIVES, Objective, TrainConfig
from gvp_lib.learning.dataset import ViewpointDataset
from gvp_lib.learning.policy import device_name, find_device, on_threads
from gvp_lib.learning.resnet import ResNet, normalized
from gvp_lib.learning.shards import read_card
from gvp_lib.planning.plan import Action

__all__ = ["WEIGHTS", "Training", "evaluate", "make_optimizer", "train", "train_epoch"]

WEIGHTS, HISTORY, STATE, LOCK = "weights.safetensors", "history.json", "training.safetensors", ".lock"
_ORDER = 8  # a stream of random numbers; `dataset` has others of the same seed
_AT_ONCE = 256  # pictures in one pass where nothing is learned

# A first epoch from random weights costs up to twice as much as knowing nothing, and so may a rate that is high and
# yet learns. The bound is on the loss over the training alone: in evaluation mode such a training may pass through
# thousands before the running means of its normalizations have settled, and recover.
_HOPELESS = 6.0


@dataclass(frozen=True, eq=False)
class Training:
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
        The folder holds another training, or one that is damaged; another process trains there now; it cannot be
        written; or the initial weights are not there, or of another network.
    DownloadError
        The weights from ImageNet cannot be downloaded.
    InvalidParameterError
        There is no such device here; ``threads`` is less than 1; sets have pictures of several sizes and no ``crop``
        says what to take of them.
    TrainingDivergedError
        The training loss exceeded six times that of a network that knows nothing, or a loss is no finite number. The
        weights of the last good epoch, or with ``patience`` of the best, are kept.
    """
    with ExitStack() as held:
        held.enter_context(on_threads(threads))
        folders = [Path(data)] if isinstance(data, Path | str) else [Path(each) for each in data]
        run = _Run(folders, Path(folder), config or TrainConfig(), find_device(device), about or {})
        if not (run.resume() and run.finished and (run.folder / WEIGHTS).is_file()):
            held.enter_context(_locked(run.folder))
            run.begin()
        first = len(run.history)
        bar = held.enter_context(tqdm(total=run.config.epochs, initial=first, disable=not progress, unit="epoch"))
        while not run.finished:
            line = run.next_epoch()
            bar.update()
            score = run.objective.score
            bar.set_postfix_str(
                f"loss {line['loss']:.3f}, {line['validation_loss']:.3f} on the validation set; "
                f"{score} {line[score]:.3f}, {line['validation_' + score]:.3f}"
            )
            if on_epoch is not None:
                on_epoch(line)
        return Training(run.folder, load_trained(run.folder / WEIGHTS), run.history, len(run.history) - first)


class _Run:
    """A training between two epochs, in memory and on disk."""

    def __init__(
        self, data: list[Path], folder: Path, config: TrainConfig, device: str, about: Mapping[str, Any]
    ) -> None:
        self.folder, self.config, self.device, self.objective = folder, config, device, OBJECTIVES[config.target]
        self.history: list[dict[str, float]] = []
        self._data, self._asked = data, dict(about)
        cards = [read_card(each) for each in data]
        self._recipe: dict[str, Any] = {"config": config.to_dict(), "data": [_fingerprint(card) for card in cards]}
        if (digest := digest_of(config.weights)) is not None:  # every training's file has the same name
            self._recipe["weights_sha256"] = digest
        self._crops = [config.crop or card["recipe"]["crop"] for card in cards]
        if len(set(self._crops)) > 1:
            raise InvalidParameterError(
                f"sets that are put together have pictures of one size; these have {self._crops} px. Say which middle "
                f"to take of all of them: crop={min(self._crops)}"
            )
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed)
            self.network = ResNet(config.network, self.objective.outputs)
        self.network.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.optimizer = make_optimizer(self.network, config)

    @property
    def kept_epoch(self) -> int:
        """Epoch, from 1, whose weights are kept: the last, or with patience the best; 0 before the first."""
        losses = [line["validation_loss"] for line in self.history]
        return len(losses) if self.config.patience is None or not losses else 1 + int(np.argmin(losses))

    @property
    def finished(self) -> bool:
        """Whether every epoch was run, or patience is at its end."""
        epochs, patience = len(self.history), self.config.patience
        return epochs >= self.config.epochs or (patience is not None and epochs - self.kept_epoch >= patience)

    def begin(self) -> None:
        """Make all ready for the next epoch. The folder is locked, and what is there by now counts."""
        resumed = self.resume()
        if resumed and not (self.folder / WEIGHTS).is_file():
            self._restore()
        if not self.finished:  # what is finished needs no pictures, and of many sets they take minutes
            config = self.config
            names = ("share", "seed", "target", "size", "crop", "step")
            options: dict[str, Any] = {name: getattr(config, name) for name in names}
            self._train_set = ViewpointDataset(
                self._data, "train", shift=config.shift, turns=config.turns, colors=config.colors, **options
            )
            self._validation_set = ViewpointDataset(self._data, "validation", verify=False, **options)
            check_sets(self._train_set, self._validation_set)
        if not resumed:
            load_weights(self.network, self.config.weights)

    def resume(self) -> bool:
        """Go on from the state on disk; False where there is none."""
        path = self.folder / STATE
        if not path.is_file():
            return False
        tensors, about = read_tensors(path)
        if about is None or not about.keys() >= {"recipe", "history"}:
            raise CheckpointError(f"{path} is no training's state; choose another folder, or remove it")
        try:
            _check_same(about["recipe"], json.loads(json.dumps(self._recipe)), self.folder)
            self.network.load_state_dict(_below("network.", tensors))
            _put_optimizer(self.optimizer, _below("optimizer.", tensors))
            self.history = about["history"]
            if not self.kept_epoch:
                raise ValueError("its history is empty")
        except CheckpointError:
            raise
        except (RuntimeError, ValueError, LookupError, TypeError, AttributeError) as error:
            raise CheckpointError(
                f"{path} is damaged: it is no state of this training ({str(error).splitlines()[-1].strip()}); remove "
                "its folder to begin anew"
            ) from error
        return True

    def next_epoch(self) -> dict[str, float]:
        """Run one, and keep what came of it."""
        config, epoch, score = self.config, len(self.history), self.objective.score
        began = time.perf_counter()
        self._train_set.epoch = epoch
        order = np.random.default_rng([config.seed, _ORDER, epoch]).permutation(len(self._train_set))
        line = {"epoch": epoch + 1, "rate": config.rate(epoch, 0.0)}
        line["loss"], line[score] = train_epoch(
            self.network, self.optimizer, self._train_set, order, config, epoch, self.device
        )
        found = evaluate(self.network, self._validation_set, self.device)
        line |= {f"validation_{name}": value for name, value in found.items()}
        kept = f"the weights of epoch {self.kept_epoch} are kept in {self.folder}" if epoch else "nothing is kept"
        check_loss(line, self.objective, config.learning_rate, kept)
        line["seconds"] = round(time.perf_counter() - began, 3)
        self.history.append(line)
        self._keep()
        return line

    def _keep(self) -> None:
        """Write first what is for others, then the state: a run that is killed in between repeats the epoch."""
        if self.kept_epoch == len(self.history):
            self._save()
        try:
            write_file(self.folder / HISTORY, (json.dumps(self.history, indent=1) + "\n").encode())
        except OSError as error:
            raise CheckpointError(f"{self.folder / HISTORY} cannot be written ({error.strerror})") from error
        tensors = {f"network.{name}": tensor for name, tensor in self.network.state_dict().items()}
        for index, state in self.optimizer.state_dict()["state"].items():
            for name, value in state.items():
                if value is not None:
                    tensors[f"optimizer.{index}.{name}"] = torch.as_tensor(value)
        write_tensors(self.folder / STATE, tensors, {"recipe": self._recipe, "history": self.history})

    def _restore(self) -> None:
        """Write weights that are gone again: the state has those of the last epoch."""
        if self.kept_epoch != len(self.history):
            raise CheckpointError(
                f"{self.folder / WEIGHTS} is gone, and with it the weights of epoch {self.kept_epoch}, the best; "
                f"remove {self.folder} to train anew"
            )
        self._save()

    def _save(self) -> None:
        """Write the weights as they are now, of the last epoch."""
        config, line = self.config, self.history[-1]
        about = {
            "network": config.network,
            "outputs": self.objective.outputs,
            "target": config.target,
            "crop": self._crops[0],
            "size": config.size,
            **self._recipe,
            "epoch": len(self.history),
            "scores": {name: value for name, value in line.items() if name.startswith("validation")},
            "versions": {"torch": torch.__version__},
            "device": device_name(self.device),
            **self._asked,
        }
        save_trained(self.folder / WEIGHTS, TrainedNetwork(self.network, about))


# --- the state on disk ----------------------------------------------------------------------------------------------


def _locked(folder: Path) -> BinaryIO:
    """Make a folder that only this process trains in, until what comes back is closed."""
    try:
        return open_locked(folder / LOCK)
    except BlockingIOError as error:
        raise CheckpointError(
            f"{folder} is in use by another training; wait for it, or choose another folder"
        ) from error
    except OSError as error:
        raise CheckpointError(f"{folder} cannot be written ({error.strerror}); choose another") from error


def _fingerprint(card: Mapping[str, Any]) -> dict[str, Any]:
    """What a set is, to record what a network was trained on; sets of one recipe are told apart by their shards."""
    shards = hashlib.sha256(json.dumps(card["shards"], sort_keys=True).encode()).hexdigest()
    return {"recipe": card["recipe"], "shards": shards}


def _check_same(was: Mapping[str, Any], recipe: Mapping[str, Any], folder: Path) -> None:
    """Check that a folder's training is of the same recipe as the one asked for."""
    # What an older version did not know, it did as by default.
    was = {**was, "config": {**TrainConfig().to_dict(), **was["config"]}}
    if was != recipe:
        first = "weights_sha256"
        there, here = ({**each["config"], first: each.get(first)} for each in (was, recipe))
        differing = [
            f"{name} {there.get(name)!r} there, {value!r} here"
            for name, value in here.items()
            if there.get(name) != value
        ]
        raise CheckpointError(
            f"{folder} holds another training ({', '.join(differing) or 'of other data'}); choose another folder, or "
            "remove it"
        )


def _below(prefix: str, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Tensors whose names begin so, by the rest of their names."""
    return {name.removeprefix(prefix): tensor for name, tensor in tensors.items() if name.startswith(prefix)}


def _put_optimizer(optimizer: torch.optim.Optimizer, tensors: Mapping[str, Tensor]) -> None:
    """Copy what an optimizer remembers of each parameter into it, from tensors named ``<number>.<name>``."""
    parameters = optimizer.param_groups[0]["params"]
    state: dict[int, dict[str, Tensor]] = defaultdict(dict)
    for key, value in tensors.items():
        index, name = key.split(".")
        if value.dim() and value.shape != (expected := parameters[int(index)].shape):
            raise ValueError(f"optimizer.{key} is {tuple(value.shape)}, its parameter {tuple(expected)}")
        state[int(index)][name] = value
    if state and len(state) != len(parameters):  # without momentum an optimizer remembers nothing
        raise ValueError(f"the optimizer's part is of {len(state)} parameters; there are {len(parameters)}")
    optimizer.load_state_dict(optimizer.state_dict() | {"state": state})


# --- what is refused ------------------------------------------------------------------------------------------------


def check_sets(train_set: ViewpointDataset, validation_set: ViewpointDataset) -> None:
    """Check that there is something to learn, and to judge that by."""
    if len(train_set) < 2 or not len(validation_set):
        raise DatasetError(
            f"{len(train_set)} samples to train and {len(validation_set)} to validate are too few; collect more"
        )
    missing = [action.name for action in Action if action not in train_set.actions]
    if train_set.target == "action" and missing:
        near = "; NO_OP is best within 0.71 steps of the normal only, so a larger step has more of it"
        raise DatasetError(
            f"of the five actions the {len(train_set)} samples for training lack {', '.join(missing)}, so that "
            "a network cannot learn when to choose it; collect more samples, or over the whole cap"
            f"{near * (Action.NO_OP.name in missing)}"
        )


def check_loss(line: Mapping[str, float], objective: Objective, rate: float, kept: str) -> None:
    """Check that an epoch's losses are those of a training that may yet learn.

    Parameters
    ----------
    line
        Line of the history, with ``epoch``, ``loss`` and ``validation_loss``.
    objective
        Objective of the losses.
    rate
        The learning rate that was asked for.
    kept
        What is left of the training, for the text.

    Raises
    ------
    TrainingDivergedError
        The training loss exceeds the bound, or one of the two is no finite number.
    """
    loss, bound = line["loss"], _HOPELESS * objective.ignorance
    grew = ""
    if not math.isfinite(loss):
        grew = f"training loss is {loss}"
    elif loss > bound:
        grew = (
            f"training loss grew to {loss:.3g}, over {_HOPELESS:g} times the {objective.ignorance:.3g} of a network "
            "that knows nothing"
        )
    elif not math.isfinite(line["validation_loss"]):
        grew = f"validation loss is {line['validation_loss']}"
    if grew:
        raise TrainingDivergedError(
            f"in epoch {line['epoch']:g} the {grew}; {kept}. A smaller learning rate than {rate:g} may do, say "
            f"{rate / 10:g}, in another folder"
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
        for _, indices in _batches(np.arange(len(data)), _AT_ONCE):
            images, targets = (part.to(device) for part in data.batch(indices))
            outputs = network(normalized(images))
            loss += float(objective.cost(outputs, targets)) * len(indices)
            score += float(objective.total_score(outputs, targets))
            expected = objective.total_surprise(outputs, targets)
            surprise += 0.0 if expected is None else float(expected)
    found = {"loss": loss / len(data), objective.score: score / len(data)}
    return found | ({"calibration": math.sqrt(surprise / len(data))} if data.target == "tilt" else {})


def _batches(order: NDArray[np.int64], size: int, least: int = 1) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """Where each batch begins, and the batch; a last one of fewer than ``least`` goes with the one before."""
    start = 0
    while start < len(order):
        end = start + size
        end = len(order) if len(order) - end < least else end
        yield start, order[start:end]
        start = end


def make_optimizer(network: ResNet, config: TrainConfig) -> torch.optim.Optimizer:
    """Optimizer of a configuration for a network, on its device; fused, which steps in one pass over the memory.

    It does not hold the parameters but views that share their memory, with axes in the order in which that lies: a
    fused step would first copy a gradient that is channels last, which takes longer than the step.
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


def _as_it_lies(tensor: Tensor) -> Tensor:
    """A view of a tensor whose axes are in the order of its memory, where it is channels last."""
    return tensor.permute(0, 2, 3, 1) if tensor.dim() == 4 and not tensor.is_contiguous() else tensor
