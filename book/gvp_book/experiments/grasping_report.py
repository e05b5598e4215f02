"""What the episodes of Table 3.2 add up to: success with its interval, causes of failure, differences. Thesis 3.1.7."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gvp_book.experiments import grasping
from gvp_book.experiments.grasp_judgement import CAUSES
from gvp_lib.evaluation.statistics import paired_difference, summarize, wilson_interval
from gvp_lib.planning.plan import PlanOutcome

__all__ = ["THESIS", "THESIS_TRIALS", "grasping_report", "tally"]

Row = dict[str, Any]

THESIS_TRIALS = 10
THESIS: Mapping[str, tuple[int, int]] = {
    "cuboid_1x1": (8, 8),
    "cuboid_1x2": (10, 9),
    "cuboid_1x4": (9, 9),
    "cylinder": (9, 10),
    "alligator": (9, 8),
}
"""Table 3.2 as printed: successes in ten trials, in each of two placements."""

_COMPARED = (("thesis", "ours"), ("thesis", "fit, threshold"), ("thesis", "quartic, sized"), ("ours", "oracle"),
             ("ours", "look_down"))  # fmt: skip
_PER_EPISODE = {"error": 1, "roll": 1, "depth": 1, "aside": 1}  # decimals


def grasping_report(rows: Mapping[str, Row]) -> Row:
    """The content of the stored result.

    Parameters
    ----------
    rows
        Of :func:`gvp_book.experiments.grasping.grasp_once`, under keys ``group/target/placement/k``.

    Returns
    -------
    dict
        ``thesis``: the printed table, with Wilson intervals. ``summary``: by group and case, for each method a
        :func:`tally`, and paired differences of success. ``pooled``: by group, over all cases, and over those that the
        thesis has. ``contacts``: extremes over all episodes. ``rows``: every episode. Angles in deg, lengths in mm.
    """
    grouped: dict[str, dict[int, Row]] = {}
    for key, row in rows.items():
        group, target, placement, k = key.split("/")
        group = group if group == "none" else "thesis"  # what was compared ran from the same starts, under its noise
        grouped.setdefault(f"{group}/{target}/{placement}", {}).setdefault(int(k), {}).update(row)
    cases = {case: [group[k] for k in sorted(group)] for case, group in grouped.items()}
    groups = list(dict.fromkeys(case.partition("/")[0] for case in cases))
    return {
        "thesis": {name: [_trials(n, THESIS_TRIALS) for n in counts] for name, counts in THESIS.items()},
        "thesis_pooled": _trials(sum(map(sum, THESIS.values())), 2 * THESIS_TRIALS * len(THESIS)),
        "summary": {case: _summary(group) for case, group in cases.items()},
        "pooled": {group: _summary(_of(cases, group)) for group in groups},
        "pooled_thesis_placements": {group: _summary(_of(cases, group, tilted=False)) for group in groups},
        "contacts": {group: _contacts(_of(cases, group)) for group in groups},
        "rows": {case: _columns(group) for case, group in cases.items()},
    }


def _of(cases: Mapping[str, Sequence[Row]], group: str, tilted: bool = True) -> list[Row]:
    """All episodes of a group, one case after the other."""
    return [
        row
        for case, rows in cases.items()
        if case.startswith(f"{group}/") and (tilted or not case.endswith("/tilted"))
        for row in rows
    ]


def _trials(successes: int, n: int) -> Row:
    return {"n": n, "successes": successes, "rate": successes / n, "interval": wilson_interval(successes, n)}


def _summary(group: Sequence[Row]) -> Row:
    told: Row = {
        method: tally([row[method] for row in group if method in row])
        for method in grasping.METHODS
        if any(method in row for row in group)
    }
    for a, b in _COMPARED:
        both = [(row[a]["success"], row[b]["success"]) for row in group if a in row and b in row]
        if both:
            told[f"{b} - {a}"] = paired_difference(*np.transpose(np.array(both, float))[::-1])
    return told


def tally(grasps: Sequence[Row]) -> Row:
    """Statistics of one method: success with a Wilson interval, under the shake too; causes; pose in the hand."""
    told = _trials(sum(grasp["success"] for grasp in grasps), len(grasps))
    told["shaken"] = _trials(sum(grasp.get("shaken", False) for grasp in grasps), len(grasps))
    causes = Counter(grasp["cause"] for grasp in grasps if not grasp["success"])
    told["causes"] = {cause: causes[cause] for cause in CAUSES if causes[cause]}
    told["arrived"] = sum(PlanOutcome(grasp["plan"]).arrived for grasp in grasps)
    told["error"] = summarize([grasp["error"] for grasp in grasps])
    for field in ("tilt_in_hand", "turn_in_hand", "shift_in_hand"):
        values = [abs(grasp[field]) for grasp in grasps if field in grasp]
        if values:
            told[field] = summarize(values)
    for field in ("seconds", "frames"):
        told[field] = float(np.mean([grasp[field] for grasp in grasps]))
    return told


def _contacts(group: Sequence[Row]) -> Row:
    """The extremes of all episodes, and of those of the thesis's planner and ours apart."""
    told: Row = {}
    for name in grasping.METHODS:
        grasps = [row[name] for row in group if name in row]
        if grasps:
            deepest = np.array([grasp["deepest"] for grasp in grasps])
            told[name] = {
                "deepest": float(deepest.max()),
                "deepest_p99": float(np.percentile(deepest, 99)),
                "beyond_1.5mm": int((deepest > 1.5).sum()),
                "fastest": float(max(grasp["fastest"] for grasp in grasps)),
                "n": len(grasps),
            }
    return told


def _columns(group: Sequence[Row]) -> Row:
    """Every episode of a case, column by column, so that thousands stay a small file: successes as a text of 0 and 1,
    causes by the number of the start."""
    table: Row = {"tilt": [round(row["tilt"], 1) for row in group]}
    for method in grasping.METHODS:
        grasps = [row[method] for row in group if method in row]
        if not grasps:
            continue
        columns: Row = {"success": "".join(str(int(grasp["success"])) for grasp in grasps)}
        columns["causes"] = {str(k): grasp["cause"] for k, grasp in enumerate(grasps) if not grasp["success"]}
        if method in ("thesis", "ours"):
            for field, decimals in _PER_EPISODE.items():
                columns[field] = [None if field not in grasp else round(grasp[field], decimals) for grasp in grasps]
        table[method] = columns
    return table
