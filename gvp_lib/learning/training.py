"""Training a network on a set of viewpoints; one that was killed goes on to the same weights. Thesis 2.4.4, 3.2."""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

from gvp_lib.errors import CheckpointError, InvalidParameterError
from gvp_lib.jobs import write_file
from gvp_lib.learning.checkpoints import TrainedNetwork, load_trained, save_trained, write_tensors
from gvp_lib.learning.config import TrainConfig
from gvp_lib.learning.dataset import ViewpointDataset
from gvp_lib.learning.devices import device_named, name_of
from gvp_lib.learning.guards import check_loss, check_sets
from gvp_lib.learning.objectives import OBJECTIVES
from gvp_lib.learning.passes import evaluate, optimizer_of, pass_over
from gvp_lib.learning.pretrained import digest_of, load_weights
from gvp_lib.learning.progress import damaged, lock_folder, put_network, put_optimizer, read_state, state_tensors
from gvp_lib.learning.resnet import ResNet
from gvp_lib.learning.shards import read_card
from gvp_lib.learning.threads import check_threads, on_threads

__all__ = ["Training", "evaluate", "pass_over", "train"]

WEIGHTS, HISTORY, STATE = "weights.safetensors", "history.json", "training.safetensors"
_ORDER = 8  # a stream of random numbers; `dataset` has others of the same seed


@dataclass(frozen=True, eq=False)
class Training:
    """A training that is finished.

    Attributes
    ----------
    folder
        Holds ``weights.safetensors``, for :class:`gvp_lib.NetworkPolicy` and :func:`load_trained`, and
        ``history.json``.
    trained
        The network and what it is of.
    history
        For each epoch: ``rate``; ``loss`` and the score (``accuracy`` in [0, 1], or ``error_deg``) over the training,
        as the weights changed; ``validation_loss`` and the ``validation_`` score after it, and for tilts
        ``validation_calibration``; ``seconds``.
    epochs
        How many of them were run now, rather than taken up from before.
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

    After each epoch the state goes to ``folder``. The same call goes on where a training was killed, and on one kind
    of processor with as many threads it ends at the same weights, to the bit; on a GPU, whose kernels may add in
    another order each time, but for the last bits. Each epoch's order and shifts depend on the seed and its number
    alone.

    Parameters
    ----------
    data
        Folders of sets that :func:`gvp_lib.collect_dataset` collected.
    folder
        Where the weights go; made if need be.
    config
        How; by default as in the thesis, on random weights.
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
        written; or the weights to begin with are not there, or of another network.
    DownloadError
        The weights from ImageNet cannot be fetched.
    InvalidParameterError
        There is no such device here; ``threads`` is less than 1; sets have pictures of several sizes and no ``crop``
        says what to take of them.
    TrainingDivergedError
        The training loss grew beyond what knowing nothing costs, six times over, or a loss is no finite number. The
        weights of the last good epoch, or with ``patience`` of the best, are kept.
    """
    check_threads(threads)
    with ExitStack() as held:
        run = _Run(data, Path(folder), config or TrainConfig(), device_named(device), about or {}, held)
        first = run.epoch
        held.enter_context(on_threads(threads))
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
        return Training(run.folder, run.kept(), run.history, run.epoch - first)


class _Run:
    """A training between two epochs, in memory and on disk; the folder's lock goes to ``held``."""

    def __init__(
        self,
        data: Path | str | Sequence[Path | str],
        folder: Path,
        config: TrainConfig,
        device: str,
        about: Mapping[str, Any],
        held: ExitStack,
    ) -> None:
        self._told, self._held = dict(about), held
        self.folder, self.config, self.device, self.objective = folder, config, device, OBJECTIVES[config.target]
        folders = [Path(data)] if isinstance(data, Path | str) else [Path(each) for each in data]
        options: dict[str, Any] = {
            name: getattr(config, name) for name in ("share", "seed", "target", "size", "crop", "step")
        }
        self._recipe = {"config": config.to_dict(), "data": [_fingerprint(each) for each in folders]}
        if (digest := digest_of(config.weights)) is not None:  # every training's file has the same name
            self._recipe["weights_sha256"] = digest
        self._crops = [config.crop or read_card(each)["recipe"]["crop"] for each in folders]
        if len(set(self._crops)) > 1:
            raise InvalidParameterError(
                f"sets that are put together have pictures of one size; these have {self._crops} px. Say which middle "
                f"to take of all of them: crop={min(self._crops)}"
            )
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed)
            self.network = ResNet(config.network, self.objective.outputs)
        self.epoch, self._best = 0, math.inf
        self.history: list[dict[str, float]] = []
        new = not folder.is_dir()  # it is made only once nothing is wrong with the sets and the weights
        taken_up = self._take_up()
        if not new and not (self.finished and (folder / WEIGHTS).is_file()):
            taken_up = self._claim()
            self._restore()
        if not self.finished:  # what is finished needs no pictures, and of many sets they take minutes
            self.train_set = ViewpointDataset(
                folders, "train", shift=config.shift, turns=config.turns, colors=config.colors, **options
            )
            self.validation_set = ViewpointDataset(folders, "validation", verify=False, **options)
            check_sets(self.train_set, self.validation_set)
        if not taken_up:
            load_weights(self.network, config.weights)
            self._move()
            if new:
                self._claim()

    @property
    def finished(self) -> bool:
        """Whether every epoch was run, or patience is at its end."""
        losses = [line["validation_loss"] for line in self.history]
        patience = self.config.patience
        since_best = len(losses) - 1 - int(np.argmin(losses)) if losses else 0
        return self.epoch >= self.config.epochs or (patience is not None and since_best >= patience)

    def next_epoch(self) -> dict[str, float]:
        """Run one, and keep what came of it."""
        config, epoch, score = self.config, self.epoch, self.objective.score
        began = time.perf_counter()
        self.train_set.epoch = epoch
        order = np.random.default_rng([config.seed, _ORDER, epoch]).permutation(len(self.train_set))
        line = {"epoch": epoch + 1, "rate": config.rate(epoch, 0.0)}
        line["loss"], line[score] = pass_over(
            self.network, self._optimizer, self.train_set, order, config, epoch, self.device
        )
        check_loss(line, self.objective, config.learning_rate, self._left())
        found = evaluate(self.network, self.validation_set, self.device)
        line |= {f"validation_{name}": value for name, value in found.items()}
        check_loss(line, self.objective, config.learning_rate, self._left())
        line["seconds"] = round(time.perf_counter() - began, 3)
        self.epoch += 1
        self.history.append(line)
        self._keep(line)
        return line

    def kept(self) -> TrainedNetwork:
        """The weights that the training ends with."""
        return load_trained(self.folder / WEIGHTS)

    @property
    def _kept_epoch(self) -> int:
        """Of which epoch, from 1, the weights are kept; 0 where none are."""
        losses = [line["validation_loss"] for line in self.history]
        return self.epoch if self.config.patience is None or not losses else 1 + int(np.argmin(losses))

    def _left(self) -> str:
        """What is kept of the training so far, in words."""
        return f"the weights of epoch {self._kept_epoch} are kept in {self.folder}" if self.epoch else "nothing is kept"

    def _restore(self) -> None:
        """Write the weights again if they are gone: the state has those of the last epoch."""
        file = self.folder / WEIGHTS
        if not self.epoch or file.is_file():
            return
        if self._kept_epoch != self.epoch:
            raise CheckpointError(
                f"{file} is gone, and with it the weights of epoch {self._kept_epoch}, the best; remove {self.folder} "
                "to train anew"
            )
        save_trained(file, TrainedNetwork(self.network, self._about(self.history[-1])))

    def _keep(self, line: dict[str, float]) -> None:
        """First what is for others, then the state: a run that is killed in between repeats the epoch."""
        if line["validation_loss"] < self._best or self.config.patience is None:
            save_trained(self.folder / WEIGHTS, TrainedNetwork(self.network, self._about(line)))
        self._best = min(self._best, line["validation_loss"])
        try:
            write_file(self.folder / HISTORY, (json.dumps(self.history, indent=1) + "\n").encode())
        except OSError as error:
            raise CheckpointError(f"{self.folder / HISTORY} cannot be written ({error.strerror})") from error
        about = {"recipe": self._recipe, "history": self.history}
        write_tensors(self.folder / STATE, state_tensors(self.network, self._optimizer), about)

    def _claim(self) -> bool:
        """Lock the folder, and take up what is there by now; whether there is anything."""
        self._held.enter_context(lock_folder(self.folder))
        return self._take_up()

    def _take_up(self) -> bool:
        """Go on from the state on disk; whether there is one."""
        if not (self.folder / STATE).is_file():
            return False
        tensors, self.history = read_state(self.folder / STATE, json.loads(json.dumps(self._recipe)))
        self.epoch, self._best = len(self.history), min(line["validation_loss"] for line in self.history)
        self._move()
        with damaged(self.folder / STATE):
            put_network(tensors, self.network)
            put_optimizer(tensors, self._optimizer)
        return True

    def _move(self) -> None:
        """To the device, with an optimizer there."""
        self.network.to(self.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._optimizer = optimizer_of(self.network, self.config)

    def _about(self, line: dict[str, float]) -> dict[str, Any]:
        config = self.config
        return {
            "network": config.network,
            "outputs": self.objective.outputs,
            "target": config.target,
            "crop": self._crops[0],
            "size": config.size,
            **self._recipe,
            "epoch": self.epoch,
            "scores": {name: value for name, value in line.items() if name.startswith("validation")},
            "versions": {"torch": torch.__version__},
            "device": name_of(self.device),
            **self._told,
        }


def _fingerprint(folder: Path) -> dict[str, Any]:
    """What a set is, for whoever asks what a network was trained on; shared sets are told apart by their shards."""
    card = read_card(folder)
    shards = hashlib.sha256(json.dumps(card["shards"], sort_keys=True).encode()).hexdigest()
    return {"recipe": card["recipe"], "shards": shards}
