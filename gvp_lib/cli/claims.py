"""``gvp claims``."""

from __future__ import annotations

import argparse
from typing import Any

__all__ = ["add_claims"]


def add_claims(commands: Any) -> None:
    """Declare the command."""
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
    from gvp_lib.experiments.claims.listing import Results, judge_all, summary
    from gvp_lib.views.claims import claims_table, summary_table

    judged = judge_all(Results(arguments.results))
    print(summary_table(summary(judged)) if arguments.summary else claims_table(judged))
    return 0
