"""The command line: ``gvp <command>``, or ``python -m gvp_lib <command>``.

Each command is a function that takes the parsed arguments and returns the exit status. What it needs is imported inside
it, so that ``gvp --help`` answers at once. Another package adds commands by entry points of the group
``gvp.commands``, each a function that declares its command on the subparsers it is given.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import nullcontext
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from shlex import join
from typing import Any

from gvp_lib import __version__
from gvp_lib.errors import GvpError, InvalidParameterError

__all__ = ["add_where", "main"]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command of ``argv``, or of the process's own arguments; the exit status.

    It is 0 where all went well, 1 where something did not, and 2 for arguments that make no sense.
    """
    parser = argparse.ArgumentParser(prog="gvp", description="Grasp viewpoint planning: a book you can run.")
    parser.add_argument("--version", action="version", version=f"gvp_lib {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="command", required=True)
    _add_doctor(commands)
    _add_collect(commands)
    _add_train(commands)
    for command in sorted(entry_points(group="gvp.commands"), key=lambda point: point.name):
        try:
            command.load()(commands)
        except Exception as error:  # another package's, which may be broken in any way: the other commands work
            print(f"gvp: there is no {command.name!r}, since {command.value} is broken: {error!r}", file=sys.stderr)
    arguments = parser.parse_args(argv)
    try:
        return int(arguments.run(arguments) or 0)
    except GvpError as error:  # misuse: its text helps, a traceback would not
        print(f"gvp {arguments.command}: {error}", file=sys.stderr)
        return 2


_Options = Mapping[str, tuple[type, str | None, str]]  # by attribute: type, what stands for a value in the help, help


def _add_options(command: argparse.ArgumentParser, options: _Options) -> None:
    for name, (kind, metavar, text) in options.items():
        option = f"--{name.replace('_', '-')}"
        if kind is bool:
            command.add_argument(option, action="store_true", default=None, help=text)
        else:
            command.add_argument(option, type=kind, metavar=metavar, help=text)


def _given(arguments: argparse.Namespace, options: Iterable[str]) -> dict[str, Any]:
    return {name: value for name in options if (value := getattr(arguments, name)) is not None}


def add_where(command: argparse.ArgumentParser, do_it: str) -> None:
    """Declare where jobs run: on this machine's processes, or on a cluster."""
    where = command.add_mutually_exclusive_group()
    where.add_argument("--workers", type=int, metavar="N", help="processes here (default: 1)")
    where.add_argument("--dask", metavar="ADDRESS", help=f"address of a Dask scheduler, whose workers {do_it} instead")


# --- doctor -----------------------------------------------------------------------------------------------------------


def _add_doctor(commands: Any) -> None:
    doctor = commands.add_parser(
        "doctor",
        help="say what this machine has and lacks, and how to mend it",
        description="One line per need: [OK], [FAIL] with the mend, or [ -- ] for what is optional and absent. "
        "Exit status 1 if anything failed.",
    )
    doctor.add_argument("needs", nargs="*", metavar="need", help="look at these needs only (default: at all)")
    doctor.set_defaults(run=_doctor)


def _doctor(arguments: argparse.Namespace) -> int:
    from gvp_lib.doctor import examine

    return examine(arguments.needs)


# --- collect ----------------------------------------------------------------------------------------------------------


COLLECT_OPTIONS: _Options = {
    "target": (str, "NAME", "the object: a name, or yours as file.py:NAME (default: cuboid_1x2)"),
    "placement": (str, "NAME", "how it stands (default: flat)"),
    "arm": (str, "NAME", "who holds the camera: ur5e, baxter or floating (default: ur5e)"),
    "sampling": (str, "NAME", "uniform or random (default: uniform)"),
    "n": (int, "N", "samples (default: 4096)"),
    "rolls": (int, "N", "rolls at each point of a uniform set (default: 16)"),
    "crop": (int, "PX", "side of the square kept of each picture (default: 128)"),
    "scenes": (int, "N", "number of places of the object (default: 1)"),
    "shard": (int, "N", "samples per file (default: 64)"),
    "seed": (int, "N", "seed of everything random (default: 0)"),
    "radius": (float, "M", "radius of the sphere, m (default: 0.5)"),
    "max_tilt": (float, "DEG", "half angle of the cap, deg (default: 30)"),
    "step": (float, "DEG", "step of the labeled action, deg (default: 5)"),
}
VARY_OPTIONS: _Options = {
    "vary_light": (float, "SHARE", "relative strength of the lights, within +- (default: 0)"),
    "vary_color": (float, "SHARE", "relative brightness of the object, within +- (default: 0)"),
    "vary_table": (float, "SHARE", "saturation of the table's color, up to (default: 0)"),
    "vary_size": (float, "SHARE", "relative size of the object, within +-, for each scene (default: 0)"),
}


def _add_collect(commands: Any) -> None:
    collect = commands.add_parser(
        "collect",
        help="collect a set of labeled viewpoints",
        description="Collect labeled viewpoints of an object into a folder, as Parquet. A collection that was "
        "interrupted goes on; a set that is finished is checked, and what is damaged is collected again.",
    )
    collect.add_argument("folder", help="where the set goes; made if need be")
    _add_options(collect, COLLECT_OPTIONS)
    collect.add_argument("--unsorted", action="store_true", help="keep the order in which viewpoints are drawn")
    collect.add_argument(
        "--noise", choices=("none", "thesis"), default="none", help="noise of arm and camera (default: none)"
    )
    _add_options(collect, VARY_OPTIONS)
    add_where(collect, "collect")
    collect.add_argument("--quiet", action="store_true", help="no progress bar")
    collect.set_defaults(run=_collect)


def _own_object(target: str) -> Any:
    """What ``file.py:NAME`` names, imported so that other processes can import it too; any other text as it is.

    Raises
    ------
    InvalidParameterError
        There is no such file, nothing of that name in it, or what it names is no ObjectSpec.
    """
    from gvp_lib.simulation.objects import ObjectSpec

    place, separator, name = target.rpartition(":")
    if not separator or not place.endswith(".py"):
        return target
    file = Path(place).resolve()
    if not file.is_file():
        raise InvalidParameterError(f"--target file.py:NAME: there is no file {place}")
    sys.path.insert(0, str(file.parent))
    module = import_module(file.stem)
    if Path(module.__file__ or "").resolve() != file:
        raise InvalidParameterError(f"{place} has the name of another module, {module.__name__}; call it otherwise")
    objects = {key: value for key, value in vars(module).items() if isinstance(value, ObjectSpec)}
    if name not in objects:
        raise InvalidParameterError(f"{place} has no ObjectSpec named {name!r}; it has: {', '.join(objects) or 'none'}")
    return objects[name]


def _collect(arguments: argparse.Namespace) -> int:
    from gvp_lib.jobs import dask_cluster
    from gvp_lib.learning.collect import collect_dataset
    from gvp_lib.learning.recipe import CollectionRecipe, Variation
    from gvp_lib.simulation.sensors import Noise

    if arguments.workers is not None and arguments.workers < 1:
        raise InvalidParameterError(f"--workers is 1 or more; got {arguments.workers}")
    given = _given(arguments, COLLECT_OPTIONS)
    given |= {name: math.radians(given[name]) for name in ("max_tilt", "step") if name in given}
    given |= {"target": _own_object(given["target"])} if "target" in given else {}
    vary = _given(arguments, VARY_OPTIONS)
    recipe = CollectionRecipe(
        sort=not arguments.unsorted,
        noise=Noise.thesis() if arguments.noise == "thesis" else Noise.none(),
        variation=Variation(**{name.removeprefix("vary_"): share for name, share in vary.items()}),
        **given,
    )
    with nullcontext() if arguments.dask is None else dask_cluster(arguments.dask) as executor:
        done = collect_dataset(
            arguments.folder, recipe, workers=arguments.workers or 1, executor=executor, progress=not arguments.quiet
        )
    counts = done.card["counts"]
    for name in done.damaged:
        print(f"{name} was missing or damaged and is collected again")
    print(
        f"{done.folder}: {counts['samples']} viewpoints, {done.collected} of them collected now; "
        f"{counts['replaced']} replaced, {counts['frames']} frames, {counts['arm_seconds'] / 60:.1f} min of arm motion"
    )
    return 0


# --- train ------------------------------------------------------------------------------------------------------------


# The fields of TrainConfig. Their defaults stand in the help alone: to read them would load torch. A test compares.
TRAIN_OPTIONS: _Options = {
    "network": (str, "NAME", "resnet50, resnet18 or resnet18_half (default: resnet50)"),
    "weights": (str, "W", "initial weights: imagenet, a file, or a network of the library (default: random)"),
    "target": (str, "NAME", "what is learned: action or tilt (default: action)"),
    "size": (int, "PX", "side of the network's input images (default: 64)"),
    "crop": (int, "PX", "side of the central square cut from each image (default: all)"),
    "shift": (int, "PX", "largest random shift of an image (default: 8)"),
    "dihedral": (bool, None, "augment by random quarter turns and mirror images"),
    "colors": (bool, None, "augment by mixing color channels at random, so that no color is learned"),
    "step": (float, "DEG", "angle of an action (default: what the set was labeled for)"),
    "share": (float, "SHARE", "share of the samples to train on (default: 0.7)"),
    "epochs": (int, "N", "number of epochs (default: 20)"),
    "batch": (int, "N", "batch size (default: 32)"),
    "optimizer": (str, "NAME", "sgd or adamw (default: sgd)"),
    "learning_rate": (float, "X", "learning rate at the beginning, or at its peak (default: 0.001)"),
    "momentum": (float, "X", "momentum of sgd (default: 0.9)"),
    "weight_decay": (float, "X", "weight decay (default: 0.0)"),
    "schedule": (str, "NAME", "steps or 'one cycle' (default: steps)"),
    "gamma": (float, "X", "factor of the learning rate at each step (default: 0.1)"),
    "decay_every": (int, "N", "epochs from step to step (default: 5)"),
    "patience": (int, "N", "epochs without a lower validation loss before stopping, keeping the best (default: none)"),
    "seed": (int, "N", "seed of everything random (default: 0)"),
}


def _add_train(commands: Any) -> None:
    train = commands.add_parser(
        "train",
        help="train a network on sets of viewpoints",
        description="Train a network on one set of viewpoints or several. The defaults are the thesis's, but its first "
        "weights are ImageNet's: --weights imagenet. An interrupted training resumes.",
    )
    train.add_argument("data", nargs="+", help="folders that `gvp collect` filled")
    train.add_argument("--out", required=True, metavar="FOLDER", help="folder for the weights; created if missing")
    _add_options(train, TRAIN_OPTIONS)
    train.add_argument("--device", default="auto", help="cpu, cuda, ... (default: auto, a GPU where there is one)")
    train.add_argument("--threads", type=int, metavar="N", help="threads to compute on (default: all)")
    train.add_argument("--export", metavar="FILE", help="a second .safetensors file for the finished weights")
    train.add_argument("--precision", metavar="NAME", help="its precision: float32, float16 or int8 (default: float32)")
    train.add_argument("--quiet", action="store_true", help="no progress bar")
    train.set_defaults(run=_train)


def _train(arguments: argparse.Namespace) -> int:
    from gvp_lib.learning.checkpoints import TrainedNetwork, check_export, save_trained
    from gvp_lib.learning.config import TrainConfig
    from gvp_lib.learning.training import WEIGHTS, train

    given = _given(arguments, TRAIN_OPTIONS)
    command = _command_of_training(arguments.data, given)
    if "step" in given:
        given["step"] = math.radians(given["step"])
    if arguments.precision is not None and arguments.export is None:
        raise InvalidParameterError("--precision is of the file that --export names; give both or neither")
    precision: Any = arguments.precision or "float32"
    if arguments.export is not None:
        check_export(arguments.export, precision)  # before the training, not after it
    config, began = TrainConfig(**given), time.perf_counter()
    done = train(
        arguments.data,
        arguments.out,
        config,
        device=arguments.device,
        threads=arguments.threads,
        progress=not arguments.quiet,
        metadata={"command": command},
    )
    where = str(done.folder / WEIGHTS)
    if arguments.export is not None:
        exported = {**done.trained.metadata, "command": f"{command} --export NAME --precision {precision}"}
        save_trained(arguments.export, TrainedNetwork(done.trained.network, exported), precision)
        where += f" and {arguments.export}"
    metadata = done.trained.metadata
    scores = ", ".join(f"{name.replace('_', ' ')} {value:.4g}" for name, value in metadata["scores"].items())
    print(
        f"{done.epochs} of {len(done.history)} epochs run now; after epoch {metadata['epoch']}, {scores}; "
        f"weights in {where}; {time.perf_counter() - began:.0f} s"
    )
    return 0


def _command_of_training(data: Sequence[str], given: Mapping[str, Any]) -> str:
    """What was asked for, as it stands in the file of weights: folders and files by their names alone."""
    words = ["gvp", "train", *(Path(folder).resolve().name for folder in data)]
    for name, value in given.items():
        words.append(f"--{name.replace('_', '-')}")
        if value is not True:
            words.append(Path(value).name if name == "weights" else str(value))
    return join(words)
