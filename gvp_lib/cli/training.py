"""``gvp train``."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

__all__ = ["OPTIONS", "add_train"]

# Each field of TrainConfig: type, what stands for a value, help. The defaults stand in the help alone, for to read them
# would load torch; a test compares.
OPTIONS = {
    "network": (str, "NAME", "resnet50, resnet18 or resnet18_half (default: resnet50)"),
    "weights": (
        str,
        "W",
        "to begin with: imagenet, a file, or a network that comes with the library (default: random)",
    ),
    "target": (str, "NAME", "what is learned: action or tilt (default: action)"),
    "size": (int, "PX", "side of the pictures shown (default: 64)"),
    "crop": (int, "PX", "side of the middle that is taken of the stored ones (default: all)"),
    "shift": (int, "PX", "most that a picture is shifted by to each side (default: 8)"),
    "turns": (bool, None, "turn and mirror the pictures at random, and their targets with them"),
    "colors": (bool, None, "mix the channels of each picture at random, so that no color is learned"),
    "step": (float, "DEG", "of the actions (default: what the set was labeled for)"),
    "share": (float, "SHARE", "of the samples that are for training (default: 0.7)"),
    "epochs": (int, "N", "times that every sample is seen (default: 20)"),
    "batch": (int, "N", "samples per step (default: 32)"),
    "optimizer": (str, "NAME", "sgd or adamw (default: sgd)"),
    "learning_rate": (float, "X", "at the beginning, or at its peak (default: 0.001)"),
    "momentum": (float, "X", "of sgd (default: 0.9)"),
    "weight_decay": (float, "X", "(default: 0.0)"),
    "schedule": (str, "NAME", "steps or 'one cycle' (default: steps)"),
    "gamma": (float, "X", "what a step multiplies the rate by (default: 0.1)"),
    "decay_every": (int, "N", "epochs from step to step (default: 5)"),
    "patience": (int, "N", "epochs without a better validation loss before it stops and keeps the best (default: all)"),
    "seed": (int, "N", "of everything random (default: 0)"),
}


def add_train(commands: Any) -> None:
    """Declare the command."""
    train = commands.add_parser(
        "train",
        help="train a network on sets of viewpoints",
        description="Train a network on one set of viewpoints or several. The defaults are the thesis's, but its first "
        "weights are ImageNet's: --weights imagenet. A training that was interrupted goes on where it was.",
    )
    train.add_argument("data", nargs="+", help="folders that `gvp collect` filled")
    train.add_argument("--out", required=True, metavar="FOLDER", help="where the weights go; made if need be")
    for name, (kind, metavar, what) in OPTIONS.items():
        option = f"--{name.replace('_', '-')}"
        if kind is bool:
            train.add_argument(option, action="store_true", default=None, help=what)
        else:
            train.add_argument(option, type=kind, metavar=metavar, help=what)
    train.add_argument("--device", default="auto", help="cpu, cuda, ... (default: auto, a GPU where there is one)")
    train.add_argument("--threads", type=int, metavar="N", help="processors to compute on (default: all)")
    train.add_argument("--export", metavar="FILE", help="a .safetensors file that the finished weights go to as well")
    train.add_argument("--precision", metavar="NAME", help="of --export: float32, float16 or int8 (default: float32)")
    train.add_argument("--quiet", action="store_true", help="no progress bar")
    train.set_defaults(run=_train)


def _train(arguments: argparse.Namespace) -> int:
    import time

    import numpy as np

    from gvp_lib.errors import InvalidParameterError
    from gvp_lib.learning.checkpoints import TrainedNetwork, check_export, save_trained
    from gvp_lib.learning.config import TrainConfig
    from gvp_lib.learning.training import WEIGHTS, train

    given = {name: value for name in OPTIONS if (value := getattr(arguments, name)) is not None}
    command = _command_of_training(arguments.data, given)
    if "step" in given:
        given["step"] = float(np.radians(given["step"]))
    if arguments.threads is not None and arguments.threads < 1:
        raise InvalidParameterError(f"--threads is 1 or more; got {arguments.threads}")
    if arguments.precision is not None and arguments.export is None:
        raise InvalidParameterError("--precision is of the file that --export names; give both or neither")
    precision: Any = arguments.precision or "float32"
    if arguments.export is not None:
        check_export(arguments.export, precision)  # rather now than when the training is done
    config, began = TrainConfig(**given), time.perf_counter()
    done = train(
        arguments.data,
        arguments.out,
        config,
        device=arguments.device,
        threads=arguments.threads,
        progress=not arguments.quiet,
        about={"command": command},
    )
    where = str(done.folder / WEIGHTS)
    if arguments.export is not None:
        exported = {**done.trained.about, "command": f"{command} --export NAME --precision {precision}"}
        save_trained(arguments.export, TrainedNetwork(done.trained.network, exported), precision)
        where += f" and {arguments.export}"
    about = done.trained.about
    scores = ", ".join(f"{name.replace('_', ' ')} {value:.4g}" for name, value in about["scores"].items())
    print(
        f"{done.epochs} of {len(done.history)} epochs run now; after epoch {about['epoch']}, {scores}; "
        f"weights in {where}; {time.perf_counter() - began:.0f} s"
    )
    return 0


def _command_of_training(data: Sequence[str], given: dict[str, Any]) -> str:
    """What was asked for, as it stands in the file of weights: folders and files by their names alone."""
    from pathlib import Path
    from shlex import join

    words = ["gvp", "train", *(Path(folder).resolve().name for folder in data)]
    for name, value in given.items():
        words.append(f"--{name.replace('_', '-')}")
        if value is not True:
            words.append(Path(value).name if name == "weights" else str(value))
    return join(words)
