"""Tables of the stored experiment on grasping, as the chapters show them (thesis Table 3.2)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gvp_book.plots.tables import Content, Table, with_interval

__all__ = ["differences_table", "grasping_table", "in_hand_table", "methods_table"]


def grasping_table(content: Content, group: str = "thesis") -> Table:
    """Table 3.2 beside ours, case by case: the rate in per cent with its Wilson interval, and n.

    ``content`` is of :func:`gvp_book.experiments.grasping.grasping_report`; the group ``"thesis"`` has the thesis's
    noise, ``"none"`` a perfect arm.
    """
    rows = []
    trials = {target: iter(printed) for target, printed in content["thesis"].items()}
    for case, methods in content["summary"].items():
        own, target, placement = case.split("/")
        if own == group:
            # The thesis leaned nothing.
            printed = next(trials.get(target, iter(())), None) if placement != "tilted" else None
            ours = [methods.get(name) for name in ("thesis", "ours")]
            n = next((each["n"] for each in ours if each), 0)
            rows.append([target, placement, *(_rate(each) for each in (printed, *ours)), n])
    return Table(["object", "placement", "thesis, n = 10", "its planner, here", "our planner", "n"], rows)


def methods_table(content: Content, group: str = "thesis") -> Table:
    """Every method over all cases: success, success after a shake, the viewpoint's error, pictures on the way down."""
    rows = [
        [name, each["n"], _rate(each), _rate(each["shaken"]), f"{each['error']['median']:.1f}", round(each["frames"])]
        for name, each in content["pooled"].get(group, {}).items()
        if "successes" in each  # the others are paired differences
    ]
    columns = ["method", "n", "success [%]", "and after a shake [%]", "median error [deg]", "pictures"]
    return Table(columns, rows)


def differences_table(content: Content, group: str = "thesis") -> Table:
    """What one method has over another on the same starts, percentage points with a bootstrap interval."""
    rows = [
        [name, each["n"], with_interval(100 * each["mean"], *_ends(each), sign="+")]
        for name, each in content["pooled"].get(group, {}).items()
        if "successes" not in each and each["n"]
    ]
    return Table(["difference", "starts", "success [points]"], rows)


def in_hand_table(content: Content, group: str = "thesis") -> Table:
    """How an object that was lifted sits in the hand: median, and 95th percentile."""
    rows = []
    for name in ("thesis", "ours"):
        method = content["pooled"].get(group, {}).get(name, {})
        if "tilt_in_hand" in method:
            cells = [method[column] for column in ("tilt_in_hand", "turn_in_hand", "shift_in_hand")]
            rows.append([name, cells[0]["n"], *(f"{each['median']:.1f}, {each['p95']:.1f}" for each in cells)])
    return Table(["method", "lifted", "tilt [deg]", "turn [deg]", "off the middle [mm]"], rows)


def _rate(tally: Mapping[str, Any] | None) -> str:
    if not tally:
        return ""
    digits = 0 if tally["n"] < 100 else 1  # of ten trials a tenth of a per cent says nothing
    return with_interval(100 * tally["rate"], *_ends(tally), digits)


def _ends(summary: Mapping[str, Any]) -> tuple[float, float]:
    return 100 * summary["interval"]["low"], 100 * summary["interval"]["high"]
