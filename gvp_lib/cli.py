"""The command line: ``gvp <command>``, or ``python -m gvp_lib <command>``.

Each command is a function that takes the parsed arguments and returns the exit status. What it needs is
imported inside it, so that ``gvp --help`` answers at once.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from gvp_lib import __version__
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
    return parser


def _doctor(arguments: argparse.Namespace) -> int:
    from gvp_lib.doctor import examine

    return examine(arguments.needs)


if __name__ == "__main__":
    sys.exit(main())
