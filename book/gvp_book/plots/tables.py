"""Tables for a notebook, and those of the stored experiment on alignment (thesis Table 3.1)."""

from __future__ import annotations

import html
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from gvp_lib.errors import InvalidParameterError
from gvp_lib.evaluation.statistics import summarize
from gvp_lib.motion.arm import Outcome

Content = Mapping[str, Any]  # of a stored result, or a part of it

_INTERVAL = re.compile(r"\[[^\]]*\]")


class Table:
    """Table of text and numbers that displays itself in a notebook: as HTML in a browser, otherwise as Markdown.

    Every row has one cell per column. A float is shown with one decimal; to choose another format, pass text.

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
        head, *body = (f"| {' | '.join(line)} |" for line in (self.columns, *self.rows))
        # The rule between head and body is written without spaces, as editors do.
        return "\n".join([head, "|:--|" + "--:|" * (len(self.columns) - 1), *body])

    __repr__ = __str__  # an address in memory would make each run's notebook another

    _repr_markdown_ = __str__

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{html.escape(name)}</th>" for name in self.columns)
        body = "".join("<tr>" + "".join(f"<td>{_whole(cell)}</td>" for cell in row) + "</tr>" for row in self.rows)
        table = f'<table class="gvp-table"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'
        # A wide table scrolls by itself, not the page; and a keyboard can scroll it.
        return f'<div style="overflow-x: auto" tabindex="0">{table}</div>'


def _whole(cell: str) -> str:
    """A cell in HTML. An interval in brackets stays on one line."""
    return _INTERVAL.sub(lambda interval: interval[0].replace(" ", "&nbsp;"), html.escape(cell))


def with_interval(
    found: Content, name: str = "mean", digits: int = 1, *, scale: float = 1.0, sign: str = "", space: str = " "
) -> str:
    """Stored number as text, with its interval, if any, in brackets; ``space`` goes between the interval's ends."""
    form, low, high = f"{sign}.{digits}f", found["interval"]["low"], found["interval"]["high"]
    ends = "" if low is None else f" [{scale * low:{form}},{space}{scale * high:{form}}]"
    return f"{scale * found[name]:{form}}{ends}"


_VARIED = {
    "step=10mm": "step of 10 mm",
    "step=40mm": "step of 40 mm",
    "order=major first": "about the major axis first",
    "x=angle, interpolated": "over angles, between samples",
    "own traversal": "the fit leads the arm",
    "walled": "a wall beside it",
}
"""What the stored result calls a variation, in words."""


def alignment_table(content: Content, group: str = "thesis") -> Table:
    """Table 3.1 beside ours, case by case: mean with its interval and median, deg, failed plans, and n.

    ``content`` is of :func:`gvp_book.experiments.alignment.report`; the group ``"thesis"`` has the thesis's noise,
    ``"none"`` a perfect arm.
    """
    rows = []
    for case, methods in content["summary"].items():
        own, target, placement = case.split("/")
        if own == group:
            printed = content["thesis"].get(target, {}).get("mean", "") if placement != "tilted" else ""
            cells: list[object] = []
            for method in (methods["quartic"], methods["silhouette"], methods["ours"]):
                error, outcomes = method["error"], method["outcomes"]
                failed = sum(n for outcome, n in outcomes.items() if not Outcome(outcome).arrived)
                cells += [f"{with_interval(error)}, {error['median']:.1f}", failed]
            rows.append([f"{target}, {placement}", printed, *cells, methods["ours"]["error"]["n"]])
    columns = ["case", "thesis", "reproduced", "failed", "moments of its views", "failed", "ours", "failed", "n"]
    return Table(columns, rows)


def pooled_table(content: Content, group: str = "thesis") -> Table:
    """Table of all methods over all cases of bricks and can, deg."""
    rows = []
    for name, method in content["pooled"][group].items():
        if "error" in method:  # the others are paired differences
            error = method["error"]
            cells = [f"{value:.2f}" for value in (error["mean"], method["arrived"]["mean"], error["median"])]
            rows.append([name, error["n"], *cells, error["p95"], round(method["views"]), round(method["frames"])])
    columns = [
        "bricks and can",
        "n",
        "mean [deg]",
        "where it arrived",
        "median",
        "95th percentile",
        "views",
        "pictures",
    ]
    return Table(columns, rows)


def sweep_table(content: Content) -> Table:
    """Table of each variation against the same starts without it: means over objects, with intervals, deg."""
    varied: dict[str, list[Content]] = {}
    for case, found in content["sweeps"].items():
        varied.setdefault(case.split("/")[0], []).append(found)
    rows = []
    for name, entries in varied.items():
        unchanged = [entry["unchanged"] for entry in entries]
        fit = "full" if "full" in entries[0] else "silhouette"
        means = [(unchanged, "quartic"), (entries, "quartic"), (unchanged, "silhouette"), (entries, fit)]
        means += [(unchanged, "ours"), (entries, "ours")] if "ours" in entries[0] else []
        n = sum(entry[fit]["error"]["n"] for entry in entries)
        text = _VARIED.get(name, name.replace("+-", "±").replace("%", " %"))
        cells = [_mean_over(among, method) for among, method in means]
        rows.append([text, n, *cells, *[""] * (6 - len(cells))])
    columns = [
        "what was varied",
        "n",
        *(f"{m}, {when}" for m in ("quartic", "fit", "ours") for when in ("before", "varied")),
    ]
    return Table(columns, rows)


def _mean_over(entries: Sequence[Content], method: str) -> str:
    """The mean of the entries' means. Its interval is as if they were independent: their half-widths add in square."""
    errors = [entry[method]["error"] for entry in entries if method in entry]
    if not errors:
        return ""
    means, low, high = np.array([(e["mean"], e["interval"]["low"], e["interval"]["high"]) for e in errors]).T
    mean = means.mean()
    below, above = (np.linalg.norm(means - end) / len(means) for end in (low, high))
    return with_interval({"mean": mean, "interval": {"low": mean - below, "high": mean + above}})


def first_arc_effect(content: Content, group: str = "none") -> Table:
    """Table of where the thesis's planner ends on bricks, by whether its first arc's choice was off by 5 deg."""
    pairs: list[tuple[float | None, float]] = []
    for case, row in content["rows"].items():
        if case.startswith(f"{group}/cuboid") and "first_arc" in row["quartic"]:
            pairs += zip(row["quartic"]["first_arc"], row["quartic"]["total"], strict=True)
    first, last = np.array([(abs(a), b) for a, b in pairs if a is not None]).T
    rows = []
    for name, side in (("within 5 deg", first < 5), ("off by 5 deg or more", first >= 5)):
        summary = summarize(last[side])
        rows.append([name, summary.n, with_interval(asdict(summary))])
    return Table(["first arc", "plans", "mean error at the end [deg]"], rows)


def outlines_table(content: Content) -> Table:
    """Table of what spoils a silhouette: ours over all starts of a condition, deg, and how its plans ended."""
    rows = []
    for name, told in content["summary"].items():
        if "/" not in name:
            error, ended = told["error"], told["outcomes"]
            aligned, unexplained = (ended.get(outcome, 0) for outcome in ("aligned", "unexplained"))
            cells = [with_interval(error), f"{error['median']:.2f}", f"{error['p95']:.1f}"]
            rows.append([name, error["n"], *cells, aligned, unexplained, error["n"] - aligned - unexplained])
    columns = [
        "what is wrong",
        "n",
        "mean [deg]",
        "median",
        "95th percentile",
        "aligned",
        "unexplained",
        "other endings",
    ]
    return Table(columns, rows)


def packages_table(content: Content) -> Table:
    """Table of packages found in photographs of them on the sheet.

    ``content`` is of :func:`gvp_book.experiments.desk.desk_report`. Of the solids that explain the photographs: angle
    of the normal and largest error of a side, median and worst, and the share within the claimed 90 % region.
    """
    rows = []
    for name, found in content["sheet"].items():
        error, sizes = (found.get(each, {"median": np.nan, "worst": np.nan}) for each in ("error", "sizes"))
        rows.append([
            name, found["n"], f"{found['explains']:.0%}", f"{error['median']:.2f}, {error['worst']:.2f}",
            f"{sizes['median']:.1f}, {sizes['worst']:.1f}", f"{found.get('within', np.nan):.0%}",
            f"{found['iou']['median']:.3f}",
        ])  # fmt: skip
    columns = ["package", "n", "explained", "normal [deg]", "side [mm]", "within its 90 %", "median IoU"]
    return Table(columns, rows)


def segmenters_table(content: Content) -> Table:
    """Table of segmenters on packages on a bare desk: mean IoU by package, and over all.

    ``content`` is of :func:`gvp_book.experiments.desk.desk_report`.
    """
    packages = list(next(iter(content["bare"].values())))
    rows = []
    for name, found in content["bare"].items():
        each = [found[package]["mean"] for package in packages]
        rows.append([name, *(f"{iou:.2f}" for iou in (*each, np.mean(each)))])
    return Table(["segmenter", *packages, "all"], rows)
