"""A small table for a notebook: HTML where there is a browser, Markdown elsewhere."""

from __future__ import annotations

import html
import re
from collections.abc import Sequence

from gvp_lib.errors import InvalidParameterError

__all__ = ["Table"]


_INTERVAL = re.compile(r"\[[^\]]*\]")


class Table:
    """Rows of text and numbers that show themselves in a notebook.

    Parameters
    ----------
    columns
        Headings.
    rows
        One sequence per row, as many cells as columns. A float is shown with one decimal, unless it is text already.

    Examples
    --------
    >>> print(Table(["object", "error"], [["brick", 1.25]]))
    | object | error |
    |:--|--:|
    | brick | 1.2 |
    """

    def __init__(self, columns: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
        if any(len(row) != len(columns) for row in rows):
            raise InvalidParameterError(f"every row has {len(columns)} cells, one for each of {list(columns)}")
        self.columns = list(columns)
        self.rows = [[f"{cell:.1f}" if isinstance(cell, float) else str(cell) for cell in row] for row in rows]

    def __str__(self) -> str:
        align = [":--" if k == 0 else "--:" for k in range(len(self.columns))]
        lines = [self.columns, align, *self.rows]
        # The rule between head and body is written without spaces, as editors do.
        return "\n".join(
            ("|" + "|".join(line) + "|") if line is align else ("| " + " | ".join(line) + " |") for line in lines
        )

    __repr__ = __str__  # an address in memory would make each run's notebook another

    def _repr_markdown_(self) -> str:
        return str(self)

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{html.escape(name)}</th>" for name in self.columns)
        body = "".join("<tr>" + "".join(f"<td>{_whole(cell)}</td>" for cell in row) + "</tr>" for row in self.rows)
        table = f'<table class="gvp-table"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'
        # A wide table scrolls by itself, not the page; and a keyboard can scroll it.
        return f'<div style="overflow-x: auto" tabindex="0">{table}</div>'


def _whole(cell: str) -> str:
    """A cell in HTML. An interval in brackets stays on one line."""
    return _INTERVAL.sub(lambda interval: interval[0].replace(" ", "&nbsp;"), html.escape(cell))
