"""What the episodes of Table 3.1 add up to: statistics for each case, pooled, and for what was varied. Thesis 3.1.6."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from gvp_book.experiments import alignment
from gvp_lib.evaluation.metrics import face_corners, homography_floor
from gvp_lib.evaluation.statistics import paired_difference, summarize
from gvp_lib.planning.plan import PlanOutcome
from gvp_lib.simulation.workcell import WorkCell

__all__ = ["THESIS", "describe", "report"]

Row = dict[str, Any]

THESIS: Mapping[str, tuple[float, float]] = {
    "cuboid_1x1": (15.4, 4.6),
    "cuboid_1x2": (12.4, 4.2),
    "cuboid_1x4": (10.5, 6.3),
    "cylinder": (8.2, 2.1),
}
"""Table 3.1 as printed: mean and standard deviation of the angle error, deg."""

_KEPT = {"quartic": ("first_arc", "homography"), "silhouette": ("homography", "size_error_mm", "uncertainty")}
_MAIN = ("thesis", "none")


def report(rows: Mapping[str, Row]) -> Row:
    """The content of the stored result.

    Parameters
    ----------
    rows
        Of :func:`gvp_book.experiments.alignment.align_once`, under keys ``group/target/placement/k``, in order of k.

    Returns
    -------
    dict
        ``thesis``: the printed table. ``summary``: by group and case, statistics of each method, over all episodes
        (``error``) and over those whose plan arrived (``arrived``). ``pooled``: by group, over all cases but the
        alligator. ``sweeps``: the same planner with one thing varied, beside the unchanged one on the same starts.
        ``floors``: what the thesis's metric says of a camera without error. ``rows``: every episode's error. Angles in
        deg.
    """
    grouped: dict[str, list[Row]] = {}
    for key, row in rows.items():
        grouped.setdefault(key.rpartition("/")[0], []).append(row)
    main = {case: group for case, group in grouped.items() if case.partition("/")[0] in _MAIN}
    return {
        "thesis": {name: {"mean": mean, "sd": sd} for name, (mean, sd) in THESIS.items()},
        "summary": {case: _summary(group) for case, group in main.items()},
        "pooled": {name: _pooled(main, name) for name in _MAIN},
        "sweeps": {case: _sweep(case, grouped) for case in grouped if case not in main},
        "floors": _floors(),
        "rows": {case: _columns(group) for case, group in main.items()},
    }


def _summary(group: Sequence[Row]) -> Row:
    methods = [name for name in alignment.METHODS if any(name in row for row in group)]
    told: Row = {method: describe([row[method] for row in group if method in row]) for method in methods}
    for a, b in (("quartic", "silhouette"), ("early", "silhouette"), ("silhouette", "oracle")):
        both = [(row[a]["total"], row[b]["total"]) for row in group if a in row and b in row]
        if both:
            told[f"{a} - {b}"] = paired_difference(*np.transpose(both))
    return told


def _pooled(main: Mapping[str, Sequence[Row]], group: str) -> Row:
    return _summary([
        row
        for case, rows in main.items()
        if case.startswith(f"{group}/") and case.split("/")[1] in alignment.SIZES
        for row in rows
    ])  # fmt: skip


def _sweep(case: str, grouped: Mapping[str, Sequence[Row]]) -> Row:
    group, place = grouped[case], case.partition("/")[2].replace("walled", "flat")
    unchanged = grouped.get(f"thesis/{place}", [])[: len(group)]
    names = ("quartic", "silhouette", "full")
    told: Row = {name: describe([row[name] for row in group if name in row]) for name in names}
    told["unchanged"] = {name: describe([row[name] for row in unchanged if name in row]) for name in names[:2]}
    return {name: value for name, value in told.items() if value}


def describe(judged: Sequence[Row]) -> Row:
    """Statistics of one method on one case; angles in deg."""
    if not judged:
        return {}
    outcomes: dict[str, int] = {}
    for row in judged:
        outcomes[row["outcome"]] = outcomes.get(row["outcome"], 0) + 1
    told: Row = {"error": summarize([row["total"] for row in judged]), "outcomes": outcomes}
    told["arrived"] = summarize([row["total"] for row in judged if PlanOutcome(row["outcome"]).arrived])
    for field in ("about_x", "about_y", "roll"):
        told[field] = float(np.nanmean(np.abs([row[field] for row in judged])))
    for field in ("views", "frames", "seconds"):
        told[field] = float(np.mean([row[field] for row in judged]))
    for field in ("homography", "size_error_mm", "uncertainty"):
        # A corner behind the camera has no pixel, and the metric no value.
        values = [row[field] for row in judged if row.get(field) is not None and np.isfinite(row[field])]
        if values:
            told[field] = summarize(values)
    return told


def _columns(group: Sequence[Row]) -> Row:
    """Every episode of a case, column by column and to a hundredth, so that thousands stay a small file."""
    table: Row = {"tilt": [round(row["start"]["tilt"], 2) for row in group]}
    for method in alignment.METHODS:
        rows = [row.get(method) for row in group]
        if not any(rows):
            continue
        columns: Row = {}
        for field in ("total", *_KEPT.get(method, ())):
            values = [None if row is None or row.get(field) is None else round(row[field], 2) for row in rows]
            if any(value is not None for value in values):
                columns[field] = values
        # Of the outcomes only the others than the usual, by the number of the start.
        columns["outcomes"] = {
            str(k): row["outcome"] for k, row in enumerate(rows) if row and row["outcome"] != "aligned"
        }
        table[method] = columns
    return table


@cache  # of no episode
def _floors() -> Row:
    """What the thesis's metric says of a camera without any error, at 0.25 m from the corners, deg."""
    table: Row = {}
    for target, placement in alignment.CASES:
        if target in alignment.SIZES and placement in ("flat", "side"):
            cell = WorkCell("floating", target, placement)
            corners = face_corners(cell.target_spec, cell.truth.world_from_object, cell.truth.normal.direction)
            floor = homography_floor(corners, 0.25, cell.arm.intrinsics)
            table[f"{target}/{placement}"] = float(np.degrees(floor.mean))
            cell.close()
    return table
