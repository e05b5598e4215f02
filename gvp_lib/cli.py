"""The command line: ``gvp <command>``, or ``python -m gvp_lib <command>``.

Each command is a function that takes the parsed arguments and returns the exit status. It imports what it needs itself,
so that ``gvp --help`` answers at once. Another package adds commands by entry points of the group ``gvp.commands``:
functions that are given the subparsers and add their command.
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
from gvp_lib.picture import count

__all__ = ["add_where", "main"]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command of ``argv``, or of the process's own arguments; the exit status.

    It is 0 where all went well, 1 where something did not, and 2 for arguments that make no sense.
    """
    parser = argparse.ArgumentParser(prog="gvp", description="Grasp viewpoint planning with one camera in the hand.")
    parser.add_argument("--version", action="version", version=f"gvp_lib {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="command", required=True)
    _add_doctor(commands)
    _add_collect(commands)
    _add_train(commands)
    _add_sheet(commands)
    _add_photos(commands)
    for command in sorted(entry_points(group="gvp.commands"), key=lambda point: point.name):
        try:
            command.load()(commands)
        except Exception as error:  # another package may be broken in any way; the other commands still work
            print(f"gvp: no command {command.name!r}: {command.value} cannot be loaded: {error!r}", file=sys.stderr)
    arguments = parser.parse_args(argv)
    try:
        return int(arguments.run(arguments) or 0)
    except GvpError as error:  # misuse: the message helps, a traceback would not
        print(f"gvp {arguments.command}: {error}", file=sys.stderr)
        return 2


_Options = Mapping[str, tuple[type, str | None, str]]  # type, metavar and help by attribute


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
    where.add_argument("--workers", type=int, metavar="N", help="worker processes on this machine (default: 1)")
    where.add_argument("--dask", metavar="ADDRESS", help=f"address of a Dask scheduler, whose workers {do_it} instead")


# --- doctor -----------------------------------------------------------------------------------------------------------


def _add_doctor(commands: Any) -> None:
    doctor = commands.add_parser(
        "doctor",
        help="check what this machine has and lacks, and say how to fix it",
        description="Print one line per check: [OK], [FAIL] with how to fix it, or [ -- ] for something optional that "
        "is absent. The exit status is 1 if a check failed.",
    )
    doctor.add_argument("checks", nargs="*", metavar="check", help="run these checks only (default: all)")
    doctor.set_defaults(run=_doctor)


def _doctor(arguments: argparse.Namespace) -> int:
    from gvp_lib.doctor import examine

    return examine(arguments.checks)


# --- collect ----------------------------------------------------------------------------------------------------------


COLLECT_OPTIONS: _Options = {
    "target": (str, "NAME", "object: a name, or your own as file.py:NAME (default: cuboid_1x2)"),
    "placement": (str, "NAME", "flat, raised, side, tilted, walled, steep or ramp (default: flat)"),
    "arm": (str, "NAME", "arm that holds the camera: ur5e, baxter or floating (default: ur5e)"),
    "sampling": (str, "NAME", "viewpoints: uniform over the cap, or random (default: uniform)"),
    "n": (int, "N", "number of samples (default: 4096)"),
    "rolls": (int, "N", "number of rolls at each point of a uniform set (default: 16)"),
    "crop": (int, "PX", "side of the square center crop of each picture, px (default: 128)"),
    "scenes": (int, "N", "number of random poses of the object (default: 1)"),
    "shard": (int, "N", "samples per file (default: 64)"),
    "seed": (int, "N", "random seed (default: 0)"),
    "radius": (float, "M", "radius of the virtual sphere, m (default: 0.5)"),
    "max_tilt": (float, "DEG", "half angle of the cap of viewpoints, deg (default: 30)"),
    "step": (float, "DEG", "angle of the labeled action, deg (default: 5)"),
}
VARY_OPTIONS: _Options = {
    "vary_light": (float, "FRACTION", "largest relative change of the lights' strength (default: 0)"),
    "vary_color": (float, "FRACTION", "largest relative change of the object's brightness (default: 0)"),
    "vary_table": (float, "FRACTION", "highest saturation of the table's color (default: 0)"),
    "vary_size": (float, "FRACTION", "largest relative change of the object's size, per scene (default: 0)"),
}


def _add_collect(commands: Any) -> None:
    collect = commands.add_parser(
        "collect",
        help="collect a data set of labeled viewpoints",
        description="Collect labeled viewpoints of an object into a folder of Parquet files. An interrupted collection "
        "is resumed; a finished data set is verified, and damaged files are collected again.",
    )
    collect.add_argument("folder", help="folder of the data set; created if missing")
    _add_options(collect, COLLECT_OPTIONS)
    collect.add_argument("--unsorted", action="store_true", help="visit viewpoints as drawn, not each after a near one")
    collect.add_argument(
        "--noise", choices=("none", "thesis"), default="none", help="noise of arm and camera (default: none)"
    )
    _add_options(collect, VARY_OPTIONS)
    add_where(collect, "collect")
    collect.add_argument("--quiet", action="store_true", help="show no progress bar")
    collect.set_defaults(run=_collect)


def _own_object(target: str) -> Any:
    """Import the object that ``file.py:NAME`` names, so that other processes can too; return other text as it is.

    Raises
    ------
    InvalidParameterError
        There is no such file, or no ObjectSpec of that name in it.
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
        raise InvalidParameterError(f"{place} has the name of another module, {module.__name__}; rename it")
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
        print(f"{name} was missing or damaged and was collected again")
    print(
        f"{done.folder}: {counts['samples']} viewpoints, {done.collected} of them collected now; "
        f"{counts['replaced']} replaced, {counts['frames']} frames, {counts['arm_seconds'] / 60:.1f} min of arm motion"
    )
    return 0


# --- train ------------------------------------------------------------------------------------------------------------


# The fields of TrainConfig. The help repeats their defaults, since reading them would load torch; a test compares them.
TRAIN_OPTIONS: _Options = {
    "network": (str, "NAME", "resnet50, resnet18 or resnet18_half (default: resnet50)"),
    "weights": (str, "W", "initial weights: imagenet, a file, or a network shipped with the library (default: random)"),
    "target": (str, "NAME", "output to learn: action or tilt (default: action)"),
    "size": (int, "PX", "side of the network's input, px (default: 64)"),
    "crop": (int, "PX", "side of the center crop of each picture, px (default: all)"),
    "shift": (int, "PX", "largest random shift of a picture (default: 8)"),
    "dihedral": (bool, None, "rotate by quarter turns and mirror pictures at random, and their targets with them"),
    "colors": (bool, None, "mix the channels of each picture at random, so that no color is learned"),
    "step": (float, "DEG", "angle of the actions, deg (default: as the data set was labeled)"),
    "share": (float, "FRACTION", "fraction of the samples to train on (default: 0.7)"),
    "epochs": (int, "N", "number of epochs (default: 20)"),
    "batch": (int, "N", "batch size (default: 32)"),
    "optimizer": (str, "NAME", "sgd or adamw (default: sgd)"),
    "learning_rate": (float, "X", "initial learning rate, or the peak of 'one cycle' (default: 0.001)"),
    "momentum": (float, "X", "momentum of sgd (default: 0.9)"),
    "weight_decay": (float, "X", "weight decay (default: 0.0)"),
    "schedule": (str, "NAME", "learning rate schedule: steps or 'one cycle' (default: steps)"),
    "gamma": (float, "X", "factor of the learning rate at each step (default: 0.1)"),
    "decay_every": (int, "N", "epochs between steps (default: 5)"),
    "patience": (int, "N", "stop after N epochs without a better validation loss, and keep the best (default: never)"),
    "seed": (int, "N", "random seed (default: 0)"),
}


def _add_train(commands: Any) -> None:
    train = commands.add_parser(
        "train",
        help="train a network on data sets of viewpoints",
        description="Train a network on one or more data sets of viewpoints. The defaults are the thesis's, except "
        "that it started from ImageNet's weights: --weights imagenet. An interrupted training is resumed.",
    )
    train.add_argument("data", nargs="+", help="data sets: folders written by `gvp collect`")
    train.add_argument("--out", required=True, metavar="FOLDER", help="folder of the weights; created if missing")
    _add_options(train, TRAIN_OPTIONS)
    train.add_argument("--device", default="auto", help="cpu, cuda, ... (default: auto, a GPU if there is one)")
    train.add_argument("--threads", type=int, metavar="N", help="number of CPU threads (default: as many as cores)")
    train.add_argument("--export", metavar="FILE", help="also write the trained weights to this .safetensors file")
    train.add_argument(
        "--precision", metavar="NAME", help="precision of that file: float32, float16 or int8 (default: float32)"
    )
    train.add_argument("--quiet", action="store_true", help="show no progress bar")
    train.set_defaults(run=_train)


def _train(arguments: argparse.Namespace) -> int:
    from gvp_lib.learning.checkpoints import TrainedNetwork, check_export, save_trained
    from gvp_lib.learning.config import TrainConfig
    from gvp_lib.learning.training import WEIGHTS, train

    given = _given(arguments, TRAIN_OPTIONS)
    command = _training_command(arguments.data, given)
    if "step" in given:
        given["step"] = math.radians(given["step"])
    if arguments.precision is not None and arguments.export is None:
        raise InvalidParameterError("--precision applies to the file that --export names; give both or neither")
    precision: Any = arguments.precision or "float32"
    if arguments.export is not None:
        check_export(arguments.export, precision)  # now rather than after the training
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


def _training_command(data: Sequence[str], given: Mapping[str, Any]) -> str:
    """Command line to store with the weights; folders and files appear by name, without their paths."""
    words = ["gvp", "train", *(Path(folder).resolve().name for folder in data)]
    for name, value in given.items():
        words.append(f"--{name.replace('_', '-')}")
        if value is not True:
            words.append(Path(value).name if name == "weights" else str(value))
    return join(words)


# --- photographs ------------------------------------------------------------------------------------------------------


def _add_sheet(commands: Any) -> None:
    sheet = commands.add_parser(
        "sheet",
        help="write the sheet of paper to print and lay an object on",
        description="Write the sheet as PDF and PNG, for A4 and letter paper. Print it at 100 %, and measure the bar.",
    )
    sheet.add_argument("folder", nargs="?", default=".", help="folder to write to; created if missing (default: here)")
    sheet.add_argument("--paper", choices=("a4", "letter"), help="write this one only")
    sheet.set_defaults(run=_sheet)


def _sheet(arguments: argparse.Namespace) -> int:
    from gvp_lib.photographs import Sheet

    folder = Path(arguments.folder)
    papers: list[Any] = [arguments.paper] if arguments.paper else ["a4", "letter"]
    for paper in papers:
        for kind in ("pdf", "png"):
            print(Sheet(paper).save(folder / f"sheet-{paper}.{kind}"))
    return 0


def _add_photos(commands: Any) -> None:
    photos = commands.add_parser(
        "photos",
        help="find the solid in photographs of an object on a sheet",
        description="Find where photographs of an object on a sheet (`gvp sheet`) were taken from, fit a solid to its "
        "outlines, and write a page with the scene in 3D, each photograph with the solid over it, and the numbers.",
    )
    photos.add_argument("folder", help="folder of the photographs")
    photos.add_argument(
        "--out", metavar="FOLDER", help="folder to write to (default: `desk` in that of the photographs)"
    )
    photos.add_argument("--paper", choices=("a4", "letter"), default="a4", help="paper of the sheet (default: a4)")
    photos.add_argument("--bar", type=float, metavar="MM", default=100.0, help="length of its bar, mm (default: 100)")
    photos.add_argument("--quiet", action="store_true", help="show no progress bar")
    photos.set_defaults(run=_photos)


def _photos(arguments: argparse.Namespace) -> int:
    from gvp_lib.photographs import Sheet, views_from_photographs
    from gvp_lib.planning import ContourFit
    from gvp_lib.views.desk import write_desk

    sheet = Sheet(arguments.paper, bar=arguments.bar / 1000)
    photographs = views_from_photographs(arguments.folder, sheet, progress=not arguments.quiet)
    for name, why in photographs.skipped.items():
        print(f"not used: {name} {why}")
    optimum = ContourFit().estimate([photographs.arc], photographs.intrinsics)
    print(f"{count(len(photographs.views), 'photograph')}: {optimum.solid}, {optimum}")
    print(write_desk(arguments.out or Path(arguments.folder) / "desk", photographs, optimum, sheet))
    return 0
