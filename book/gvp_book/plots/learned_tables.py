"""Tables of the stored experiments on the learned planner, as the chapters show them (thesis Tables 3.3 and 3.4)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gvp_book.plots.tables import Content, Table, with_interval
from gvp_lib.errors import UnknownNameError
from gvp_lib.planning.plan import PlanOutcome

__all__ = ["ends_table", "following_table", "means_over_objects", "methods_table"]

_SPACE = "\N{NO-BREAK SPACE}"  # so that a narrow column breaks between a number and its interval, and nowhere else
_PLUS_MINUS = f"{_SPACE}±{_SPACE}"


def ends_table(content: Content, methods: Sequence[str], group: str = "clean") -> Table:
    """Where each method ends, object by object: mean and standard deviation, and the mean's interval, in degrees.

    ``content`` is of :func:`gvp_book.experiments.learned_tables.episodes_report`, its group ``"clean"`` or ``"rough"``.
    Methods are columns; one that an object was not tried with leaves its cell empty.
    """
    rows = []
    for target, found in _cases(content, group).items():
        thesis = content["thesis"].get(target)
        printed = [f"{thesis['mean']:g}{_PLUS_MINUS}{thesis['sd']:g}" if thesis else ""] if content["thesis"] else []
        n = max(found[method]["error"]["n"] for method in methods if method in found)
        cells = [_spread(found[method]["error"]) if method in found else "" for method in methods]
        rows.append([target, *printed, *cells, n])
    return Table(["object", *(["thesis, n = 50"] if content["thesis"] else []), *methods, "n"], rows)


def methods_table(content: Content, target: str, group: str = "clean") -> Table:
    """Every method on one object: the final error, its change from the start, how the plans ended."""
    found = _cases(content, group)
    if target not in found:
        raise UnknownNameError("object", target, found)
    rows = []
    for name, method in found[target].items():
        if "outcomes" not in method:
            continue  # the others are the start, and paired differences
        error = method["error"]
        ends = {PlanOutcome(outcome): count for outcome, count in method["outcomes"].items()}
        stopped = sum(count for outcome, count in ends.items() if outcome.arrived)
        on_and_on = ends.get(PlanOutcome.OUT_OF_STEPS, 0)
        counts = stopped, on_and_on, error["n"] - stopped - on_and_on
        shares = [f"{100 * count / error['n']:.0f}" for count in counts]
        change = f"{method['change']['mean']:+.1f}"
        rows.append([name, _spread(error), error["p95"], change, method["steps"]["mean"], *shares, error["n"]])
    numbers = ["final error [deg]", "95th percentile", "change", "steps"]
    return Table(["method", *numbers, "stopped [%]", "out of steps", "failed", "n"], rows)


def means_over_objects(content: Content, methods: Sequence[str]) -> Table:
    """The mean final error over all objects alike, in degrees, method by method and group by group."""

    def mean(method: str, group: str) -> str:
        means = [found[method]["error"]["mean"] for found in _cases(content, group).values() if method in found]
        return f"{np.mean(means):.2f}" if means else ""

    groups = dict.fromkeys(case.partition("/")[0] for case in content["summary"])
    rows = [[method, *(mean(method, group) for group in groups)] for method in methods]
    return Table(["mean over the objects [deg]", *groups], rows)


def following_table(content: Content) -> Table:
    """By path and method: the mean error while following, in degrees, with its interval; and how often it was lost.

    ``content`` as of :func:`gvp_book.experiments.learned_tables.following_report`.
    """
    rows = []
    methods = list(next(iter(content["summary"].values())))
    for path, found in content["summary"].items():
        errors = [found[method]["error"] for method in methods]
        lost = ", ".join(str(found[method]["lost"]) for method in methods)
        rows.append([path, *(_spread({**error, "sd": None}) for error in errors), lost, errors[0]["n"]])
    return Table(["the object", *(f"{method} [deg]" for method in methods), "lost", "n"], rows)


def _cases(content: Content, group: str) -> dict[str, Content]:
    """Cases of one group, by object."""
    split = {case: case.partition("/")[::2] for case in content["summary"]}
    found = {target: content["summary"][case] for case, (own, target) in split.items() if own == group}
    if not found:
        raise UnknownNameError("group", group, dict.fromkeys(own for own, _ in split.values()))
    return found


def _spread(error: Content) -> str:
    """Mean, standard deviation if there is one, and the mean's interval."""
    mean, *interval = with_interval(
        error["mean"], error["interval"]["low"], error["interval"]["high"], space=_SPACE
    ).partition(" ")
    return mean + ("" if error["sd"] is None else f"{_PLUS_MINUS}{error['sd']:.1f}") + "".join(interval)
