"""The thesis's claims beside what was measured, as tables for a terminal, the README and the book's first page."""

from __future__ import annotations

from collections.abc import Iterable

from gvp_book.claims.claim import Measured
from gvp_book.claims.listing import Judged
from gvp_book.plots.tables import Table

__all__ = ["claims_table", "measured_text", "summary_table"]

_SPACE = "\N{NO-BREAK SPACE}"  # so that a narrow column breaks before an interval, and nowhere else


def measured_text(measured: Measured | None) -> str:
    """A number with its interval; empty for none."""
    if measured is None:
        return ""
    text = str(measured).replace("-", "\N{MINUS SIGN}").replace(", ", f",{_SPACE}").replace(" ± ", f"{_SPACE}±{_SPACE}")
    return text.replace("] ", f"]{_SPACE}")


def claims_table(judged: Iterable[Judged]) -> Table:
    """Every claim in a line: where, what, the thesis's value, its planner in our cell, our planner, n, the verdict."""
    rows = []
    for each in judged:
        claim, found = each.claim, each.found
        place = claim.section if claim.place == "text" else claim.place
        verdict = each.verdict.value if found else f"{each.verdict.value} {claim.chapter[:2]}"
        numbers = [measured_text(found.ours), measured_text(found.better), found.ours.n or ""] if found else [""] * 3
        rows.append([place, claim.says, claim.printed, *numbers, verdict])
    return Table(["where", "the thesis says", "printed", "its planner, here", "our planner", "n", "verdict"], rows)


def summary_table(judged: Iterable[Judged]) -> Table:
    """The same of a few claims, for a first page; what :func:`gvp_book.claims.listing.summary` chooses."""
    rows = []
    for each in judged:
        if each.found is not None:
            place = each.claim.section if each.claim.place == "text" else each.claim.place
            ours, better = (measured_text(number) for number in (each.found.ours, each.found.better))
            rows.append([each.claim.says, place, each.claim.printed, ours, better, each.found.ours.n])
    return Table(["what", "where", "thesis", "its planner, here", "ours", "n"], rows)
