"""The command line: ``gvp <command>``, or ``python -m gvp_lib <command>``.

Each command is a function that takes the parsed arguments and returns the exit status. What it needs is
imported inside it, so that ``gvp --help`` answers at once.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from gvp_lib import __version__
from gvp_lib.cli.claims import add_claims
from gvp_lib.cli.collecting import add_collect
from gvp_lib.cli.options import add_where
from gvp_lib.cli.training import add_train
from gvp_lib.errors import GvpError

__all__ = ["main"]


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Parameters
    ----------
    argv
        The arguments after the program's name; those of the process where not given.

    Returns
    -------
    int
        The exit status: 0 where all went well, 1 where something did not, 2 for arguments that make no sense.
    """
    arguments = _parser().parse_args(argv)
    try:
        status: int = arguments.run(arguments)
    except GvpError as error:  # misuse: its text helps, a traceback would not
        print(f"gvp {arguments.command}: {error}", file=sys.stderr)
        return 2
    return status


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="gvp", description="Grasp viewpoint planning: a book you can run.")
    parser.add_argument("--version", action="version", version=f"gvp_lib {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="command", required=True)

    doctor = commands.add_parser(
        "doctor",
        help="say what this machine has and lacks, and how to mend it",
        description="One line per need: [OK], [FAIL] with the mend, or [ -- ] for what is optional and absent. "
        "Exit status 1 if anything failed.",
    )
    doctor.add_argument("needs", nargs="*", metavar="need", help="look at these needs only (default: at all)")
    doctor.set_defaults(run=_doctor)

    again = commands.add_parser(
        "reproduce",
        help="run an experiment of the thesis in full and store its result",
        description="Run an experiment of the thesis in full and store its result for the book. A run that was "
        "interrupted goes on where it was.",
    )
    again.add_argument("table", help="what to reproduce, such as table-3.2; a name that is none lists them all")
    again.add_argument("--starts", type=int, metavar="N", help="episodes per case (default: as in the stored result)")
    add_where(again, "run the episodes")
    again.add_argument("--seed", type=int, default=2020, help="of all starts (default: 2020)")
    again.add_argument(
        "--resnet50", action="store_true", help="of the learned planner: the thesis's ResNet-50 too, on a GPU"
    )
    again.add_argument("--out", default="book/results", metavar="FOLDER", help="where NAME.json goes")
    again.add_argument("--quiet", action="store_true", help="no progress bar")
    again.set_defaults(run=_reproduce)

    add_claims(commands)
    add_collect(commands)
    add_train(commands)
    return parser


def _doctor(arguments: argparse.Namespace) -> int:
    from gvp_lib.doctor import examine

    return examine(arguments.needs)


def _reproduce(arguments: argparse.Namespace) -> int:
    from pathlib import Path

    from gvp_lib.errors import InvalidParameterError
    from gvp_lib.experiments.tables import Settings, reproduce

    for name in ("starts", "workers"):
        value = getattr(arguments, name)
        if value is not None and value < 1:
            raise InvalidParameterError(f"--{name} is 1 or more; got {value}")
    settings = Settings(
        starts=arguments.starts,
        workers=arguments.workers or 1,
        seed=arguments.seed,
        folder=Path(arguments.out),
        progress=not arguments.quiet,
        dask=arguments.dask,
        resnet50=arguments.resnet50,
    )
    print(reproduce(arguments.table, settings))
    return 0
