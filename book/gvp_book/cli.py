"""The reproduction's commands: ``gvp reproduce`` and ``gvp claims``."""

from __future__ import annotations

import argparse
from typing import Any

from gvp_lib.cli import add_where


def add_reproduce(commands: Any) -> None:
    """Declare ``gvp reproduce``."""
    again = commands.add_parser(
        "reproduce",
        help="run an experiment of the thesis in full and store its result",
        description="Run an experiment of the thesis in full and store its result for the book. A run that was "
        "interrupted goes on where it was.",
    )
    again.add_argument("table", help="what to reproduce, such as table-3.2; a name that is none lists them all")
    again.add_argument("--starts", type=int, metavar="N", help="episodes per case (default: as in the stored result)")
    add_where(again, "run the episodes")
    again.add_argument("--seed", type=int, help="of all starts (default: as in the stored result)")
    again.add_argument(
        "--resnet50", action="store_true", help="of the learned planner: the thesis's ResNet-50 too, on a GPU"
    )
    again.add_argument(
        "--object", action="append", default=[], metavar="FILE",
        help="of the experiment objects: a mesh or an MJCF of your own instead of ours; may be repeated. The result is "
        "one of its own, objects-FILE.json",
    )  # fmt: skip
    again.add_argument("--scale", type=float, default=1.0, metavar="M", help="of such a mesh's unit, m (default: 1)")
    again.add_argument(
        "--out",
        metavar="FOLDER",
        help="where NAME.json goes (default: book/results; with --object, here)",
    )
    again.add_argument("--quiet", action="store_true", help="no progress bar")
    again.set_defaults(run=_reproduce)


def _reproduce(arguments: argparse.Namespace) -> int:
    from pathlib import Path

    from gvp_book.results import Settings
    from gvp_book.tables import SEEDS, reproduce
    from gvp_lib.errors import InvalidParameterError

    for name in ("starts", "workers"):
        value = getattr(arguments, name)
        if value is not None and value < 1:
            raise InvalidParameterError(f"--{name} is 1 or more; got {value}")
    if not 0 < arguments.scale < float("inf"):
        raise InvalidParameterError(f"--scale is the length of a mesh's unit in m, 0.001 for mm; got {arguments.scale}")
    settings = Settings(
        starts=arguments.starts,
        workers=arguments.workers or 1,
        seed=SEEDS.get(arguments.table, 0) if arguments.seed is None else arguments.seed,
        folder=Path(arguments.out or ("." if arguments.object else "book/results")),
        progress=not arguments.quiet,
        dask=arguments.dask,
        resnet50=arguments.resnet50,
        objects=tuple(arguments.object),
        scale=arguments.scale,
    )
    print(reproduce(arguments.table, settings))
    return 0


def add_claims(commands: Any) -> None:
    """Declare ``gvp claims``."""
    claims = commands.add_parser(
        "claims",
        help="hold each claim of the thesis against the stored results",
        description="Print a table, in Markdown: what the thesis claims, what was measured, and what the claim's rule "
        "makes of it. The book's page of claims says why, too.",
    )
    claims.add_argument("--summary", action="store_true", help="the README's few alone")
    claims.add_argument("--results", default="book/results", metavar="FOLDER", help="of results (default: the book's)")
    claims.set_defaults(run=_claims)


def _claims(arguments: argparse.Namespace) -> int:
    from gvp_book.claims.headlines import headlines_table
    from gvp_book.claims.listing import Results, claims_table, judge_all

    results = Results(arguments.results)
    print(headlines_table(results) if arguments.summary else claims_table(judge_all(results)))
    return 0
