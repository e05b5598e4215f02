"""What the learned planner's episodes and trainings add up to. Thesis 3.2.1 to 3.2.3, Tables 3.3 and 3.4, Figs. 3.3 and
3.4."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gvp_lib.evaluation.statistics import paired_difference, summarize
from gvp_lib.planning.plan import PlanOutcome

__all__ = ["THESIS", "curves_report", "episodes_report", "following_report"]

Row = dict[str, Any]

THESIS: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "table-3.3": {"cuboid_1x2": (4.5, 2.7), "tomato_soup_box": (8.6, 4.8)},
    "table-3.4": {"cuboid_1x1": (4.3, 2.89), "cuboid_1x3": (6.8, 4.3), "cylinder": (61.5, 12.3)},
}
"""As printed: mean and standard deviation of the final error, deg, over 50 trials."""


def episodes_report(name: str, rows: Mapping[str, Row], networks: Mapping[str, Row]) -> Row:
    """The content of the stored result.

    Parameters
    ----------
    name
        Of the table.
    rows
        Of :func:`gvp_book.experiments.learned.step_over_once`, under keys ``group/target/k``, in order of k.
    networks
        Of :func:`gvp_book.experiments.preparation.prepared`.

    Returns
    -------
    dict
        ``thesis``: the printed table. ``networks``: what each is, with the hash of its weights. ``summary``: by group
        and target, for each method: the final ``error``; its ``change`` from the start, negative where it fell;
        ``steps`` until the plan ended; ``outcomes``; and of each method ``a`` but the first, ``b``, the
        paired difference ``a - b``. ``rows``: every episode. Angles in deg.
    """
    grouped: dict[str, list[Row]] = {}
    for key, row in rows.items():
        grouped.setdefault(key.rpartition("/")[0], []).append(row)
    return {
        "thesis": {target: {"mean": mean, "sd": sd} for target, (mean, sd) in THESIS.get(name, {}).items()},
        "networks": {network: _network(told) for network, told in networks.items()},
        "summary": {case: _summary(group) for case, group in grouped.items()},
        "rows": {case: _columns(group) for case, group in grouped.items()},
    }


def _summary(group: Sequence[Row]) -> Row:
    methods = [name for name in group[0] if name != "start"]
    told: Row = {"start": summarize([row["start"]["tilt"] for row in group])}
    for name in methods:
        judged = [row[name] for row in group]
        ends = [PlanOutcome(row["outcome"]) for row in judged]
        told[name] = {
            "error": summarize([row["total"] for row in judged]),
            "change": summarize([row[name]["total"] - row["start"]["tilt"] for row in group]),
            "steps": summarize([row["steps"] for row in judged]),
            "frames": float(np.mean([row["frames"] for row in judged])),
            "seconds": float(np.mean([row["seconds"] for row in judged])),
            "outcomes": {end.value: ends.count(end) for end in dict.fromkeys(ends)},
        }
    for name in methods[1:]:
        both = [(row[name]["total"], row[methods[0]]["total"]) for row in group]
        told[f"{name} - {methods[0]}"] = paired_difference(*np.transpose(both))
    return told


def _columns(group: Sequence[Row]) -> Row:
    """Every episode of a case, column by column and to a hundredth, so that thousands stay a small file."""
    table: Row = {"tilt": [round(row["start"]["tilt"], 2) for row in group]}
    for name in (name for name in group[0] if name != "start"):
        table[name] = {
            "error": [round(row[name]["total"], 2) for row in group],
            "steps": [row[name]["steps"] for row in group],
            "outcome": [row[name]["outcome"] for row in group],
        }
    return table


def _network(told: Row) -> Row:
    last = told["history"][-1]
    return {
        **told["about"],
        "sha256": told["sha256"],
        "epochs": len(told["history"]),
        **{name: last[name] for name in last if name.startswith("validation")},
        "minutes": sum(line["seconds"] for line in told["history"]) / 60,
    }


def following_report(rows: Mapping[str, Row]) -> Row:
    """By path and method: the mean error while following, deg, and in how many episodes the object was lost."""
    grouped: dict[str, list[Row]] = {}
    for key, row in rows.items():
        grouped.setdefault(key.rpartition("/")[0], []).append(row)
    return {
        "summary": {
            path: {
                method: {
                    "error": summarize([row[method]["error"] for row in group]),
                    "lost": sum(row[method]["lost"] for row in group),
                    "seconds": float(np.mean([row[method]["seconds"] for row in group])),
                }
                for method in group[0]
            }
            for path, group in grouped.items()
        }
    }


def curves_report(split: str, networks: Mapping[str, Row]) -> Row:
    """The curves of a figure: mean and spread over the trainings, epoch by epoch.

    Parameters
    ----------
    split
        ``""``, as the weights changed in training, or ``"validation_"``.
    networks
        Trainings, under keys ``curve/number``.
    """
    grouped: dict[str, list[list[Row]]] = {}
    about: Row = {}
    for key, told in networks.items():
        curve = key.rpartition("/")[0]
        grouped.setdefault(curve, []).append(told["history"])
        about[curve] = told["about"]
    curves: Row = {}
    for curve, histories in grouped.items():
        curves[curve] = {"n": len(histories)} | about[curve]
        curves[curve]["seconds_per_epoch"] = float(np.median([line["seconds"] for each in histories for line in each]))
        for name in ("accuracy", "loss"):
            values = np.array([[line[split + name] for line in history] for history in histories])  # (n, epochs)
            curves[curve][name] = {
                "mean": values.mean(axis=0),
                "sd": values.std(axis=0, ddof=1) if len(values) > 1 else np.zeros(values.shape[1]),
                "all": values,
            }
    return {"curves": curves}
