"""Tables of the stored experiments on the learned planner, as the chapters show them (thesis Tables 3.3 and 3.4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gvp_book.plots.tables import Table
from gvp_lib.errors import UnknownNameError
from gvp_lib.planning.plan import PlanOutcome

__all__ = ["ends_table", "following_table", "means_over_objects", "methods_table"]

Content = Mapping[str, Any]


def ends_table(content: Content, methods: Sequence[str], group: str = "clean") -> Table:
    """Where each method ends, object by object: mean and standard deviation, and the mean's interval, in degrees.

    Parameters
    ----------
    content
        Of the stored result; see :func:`gvp_book.experiments.learned_tables.episodes_report`.
    methods
        Their columns, in order; a method that an object was not tried with leaves its cell empty.
    group
        ``"clean"`` or ``"rough"``.
    """
    rows = []
    for case, told in _cases(content, group).items():
        thesis = content["thesis"].get(case)
        printed = [f"{thesis['mean']:g}{_PLUS_MINUS}{thesis['sd']:g}" if thesis else ""] if content["thesis"] else []
        n = max(told[method]["error"]["n"] for method in methods if method in told)
        rows.append([case, *printed, *(_spread(told.get(method)) for method in methods), n])
    columns = ["object", *(["thesis, n = 50"] if content["thesis"] else []), *methods, "n"]
    return Table(columns, rows)


def methods_table(content: Content, target: str, group: str = "clean", methods: Sequence[str] = ()) -> Table:
    """Every method on one object, or those named: the final error, its change from the start, how the plans ended."""
    told = _cases(content, group)
    if target not in told:
        raise UnknownNameError("object", target, told)
    rows = []
    for name, each in told[target].items():
        if "outcomes" not in each or (methods and name not in methods):
            continue  # the others are the start, and paired differences
        n = each["error"]["n"]
        ends = {PlanOutcome(outcome): count for outcome, count in each["outcomes"].items()}
        stopped = sum(count for outcome, count in ends.items() if outcome.arrived)
        on_and_on = ends.get(PlanOutcome.OUT_OF_STEPS, 0)
        shares = [f"{100 * count / n:.0f}" for count in (stopped, on_and_on, n - stopped - on_and_on)]
        change = f"{each['change']['mean']:+.1f}"
        rows.append([name, _spread(each), each["error"]["p95"], change, each["steps"]["mean"], *shares, n])
    numbers = ["final error [deg]", "95th percentile", "change", "steps"]
    return Table(["method", *numbers, "stopped [%]", "out of steps", "failed", "n"], rows)


def means_over_objects(content: Content, methods: Sequence[str], groups: Sequence[str] = ("clean", "rough")) -> Table:
    """The mean final error over all objects alike, in degrees, method by method and group by group."""
    rows = []
    for method in methods:
        cells: list[Any] = []
        for group in groups:
            errors = [told[method]["error"] for told in _cases(content, group).values() if method in told]
            cells.append(f"{np.mean([error['mean'] for error in errors]):.2f}" if errors else "")
        rows.append([method, *cells])
    return Table(["mean over the objects [deg]", *groups], rows)


def following_table(content: Content) -> Table:
    """By path and method: the mean error while following, in degrees, with its interval; and how often it was lost.

    ``content`` as of :func:`gvp_book.experiments.learned_tables.following_report`.
    """
    rows: list[list[Any]] = []
    methods = list(next(iter(content["summary"].values())))
    for path, told in content["summary"].items():
        each = [told[method] for method in methods]
        lost = ", ".join(str(entry["lost"]) for entry in each)
        rows.append([path, *(_with_interval(entry["error"], 1) for entry in each), lost, each[0]["error"]["n"]])
    return Table(["the object", *(f"{method} [deg]" for method in methods), "lost", "n"], rows)


def _cases(content: Content, group: str) -> dict[str, Content]:
    """Of one group, by object."""
    split = {case: case.partition("/")[::2] for case in content["summary"]}
    found = {target: content["summary"][case] for case, (own, target) in split.items() if own == group}
    if not found:
        raise UnknownNameError("group", group, dict.fromkeys(own for own, _ in split.values()))
    return found


_SPACE = "\N{NO-BREAK SPACE}"  # so that a narrow column breaks between a number and its interval, and nowhere else
_PLUS_MINUS = f"{_SPACE}±{_SPACE}"


def _spread(told: Content | None) -> str:
    if told is None:
        return ""
    error = told["error"]
    low, high = (error["interval"][end] for end in ("low", "high"))
    interval = "" if low is None else f" [{low:.1f},{_SPACE}{high:.1f}]"
    sd = "" if error["sd"] is None else f"{_PLUS_MINUS}{error['sd']:.1f}"
    return f"{error['mean']:.1f}{sd}{interval}"


def _with_interval(told: Content, digits: int) -> str:
    low, high = (told["interval"][end] for end in ("low", "high"))
    interval = "" if low is None else f" [{low:.{digits}f},{_SPACE}{high:.{digits}f}]"
    return f"{told['mean']:.{digits}f}{interval}"
