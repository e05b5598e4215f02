"""Tables of the stored experiment on alignment, as the chapters show them (thesis Table 3.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gvp_book.plots.tables import Table
from gvp_lib.evaluation.statistics import summarize
from gvp_lib.planning.plan import PlanOutcome

__all__ = ["alignment_table", "first_arc_effect", "pooled_table", "sweep_table"]

Content = Mapping[str, Any]

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
    """Table 3.1 beside ours, case by case: mean with its interval and median in degrees, plans that failed, n.

    Parameters
    ----------
    content
        Of the stored result; see :func:`gvp_book.experiments.alignment.report`.
    group
        ``"thesis"`` for the thesis's noise, ``"none"`` for a perfect arm.
    """
    rows = []
    for case, methods in content["summary"].items():
        own, target, placement = case.split("/")
        if own != group:
            continue
        printed = content["thesis"].get(target, {}).get("mean", "") if placement != "tilted" else ""
        quartic, fit = methods["quartic"], methods["silhouette"]
        name = f"{target}, {placement}"
        rows.append([name, printed, _told(quartic), _failed(quartic), _told(fit), _failed(fit), fit["error"]["n"]])
    columns = ["case", "thesis", "its planner, here", "failed", "silhouette fit", "failed", "n"]
    return Table(columns, rows)


def pooled_table(content: Content, group: str = "thesis") -> Table:
    """Every method over all cases of bricks and can, in degrees."""
    rows = [
        [
            name,
            told["error"]["n"],
            f"{told['error']['mean']:.2f}",
            f"{told['arrived']['mean']:.2f}",
            f"{told['error']['median']:.2f}",
            told["error"]["p95"],
            round(told["views"]),
        ]
        for name, told in content["pooled"][group].items()
        if "error" in told  # the others are paired differences
    ]
    columns = ["bricks and can", "n", "mean [deg]", "where it arrived", "median", "95th percentile", "views"]
    return Table(columns, rows)


def sweep_table(content: Content) -> Table:
    """What was varied, against the same starts unchanged: means over the objects tried, with intervals, in degrees."""
    varied: dict[str, list[Content]] = {}
    for case, found in content["sweeps"].items():
        varied.setdefault(case.split("/")[0], []).append(found)
    rows = []
    for name, entries in varied.items():
        unchanged = [entry["unchanged"] for entry in entries]
        ours = "full" if "full" in entries[0] else "silhouette"
        means = [(unchanged, "quartic"), (entries, "quartic"), (unchanged, "silhouette"), (entries, ours)]
        n = sum(entry[ours]["error"]["n"] for entry in entries)
        views = round(float(np.mean([entry[ours]["views"] for entry in entries])))
        told = _VARIED.get(name, name.replace("+-", "±").replace("%", " %"))
        rows.append([told, n, *(_mean_over(among, method) for among, method in means), views])
    columns = ["what was varied", "n", "quartic, before", "quartic, varied", "fit, before", "fit, varied", "views"]
    return Table(columns, rows)


def first_arc_effect(content: Content, group: str = "none", limit: float = 5.0) -> Table:
    """Where the thesis's planner ends on bricks, by whether the choice of its first arc was off by ``limit`` deg."""
    pairs: list[tuple[float | None, float]] = []
    for case, row in content["rows"].items():
        if case.startswith(f"{group}/cuboid") and "first_arc" in row["quartic"]:
            pairs += zip(row["quartic"]["first_arc"], row["quartic"]["total"], strict=True)
    first, last = np.array([(abs(a), b) for a, b in pairs if a is not None]).T
    good = first < limit
    sides = ((f"within {limit:g} deg", good), (f"off by {limit:g} deg or more", ~good))
    rows = []
    for name, side in sides:
        told = summarize(last[side])
        interval = f"[{told.interval.low:.1f}, {told.interval.high:.1f}]"
        rows.append([name, told.n, f"{told.mean:.1f} {interval}"])
    return Table(["first arc", "plans", "mean error at the end [deg]"], rows)


def _told(entry: Content) -> str:
    error, interval = entry["error"], entry["error"]["interval"]
    return f"{error['mean']:.1f} [{interval['low']:.1f}, {interval['high']:.1f}], {error['median']:.1f}"


def _failed(entry: Content) -> int:
    return sum(n for outcome, n in entry["outcomes"].items() if not PlanOutcome(outcome).arrived)


def _mean_over(entries: Sequence[Content], method: str) -> str:
    """The mean of the entries' means. Its interval is as if they were independent: their half-widths add in square."""
    errors = [entry[method]["error"] for entry in entries if method in entry]
    if not errors:
        return ""
    means, low, high = np.array([(e["mean"], e["interval"]["low"], e["interval"]["high"]) for e in errors]).T
    mean = means.mean()
    below, above = (np.linalg.norm(means - end) / len(means) for end in (low, high))
    return f"{mean:.1f} [{mean - below:.1f}, {mean + above:.1f}]"
