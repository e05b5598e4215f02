"""Tables of the stored experiment on grasping, as the chapters show them (thesis Table 3.2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gvp_book.plots.tables import Table

__all__ = ["differences_table", "grasping_table", "in_hand_table", "methods_table"]

Content = Mapping[str, Any]


def grasping_table(content: Content, group: str = "thesis") -> Table:
    """Table 3.2 beside ours, case by case: the rate in per cent with its Wilson interval, and n.

    Parameters
    ----------
    content
        Of the stored result; see :func:`gvp_book.experiments.grasping.grasping_report`.
    group
        ``"thesis"`` for the thesis's noise, ``"none"`` for a perfect arm.
    """
    rows = []
    seen: dict[str, int] = {}
    for case, methods in content["summary"].items():
        own, target, placement = case.split("/")
        if own != group:
            continue
        printed = ""
        if placement != "tilted":  # the thesis leaned nothing
            trials = content["thesis"].get(target, [])
            number = seen[target] = seen.get(target, -1) + 1
            printed = _rate(trials[number]) if number < len(trials) else ""
        told = [methods.get(name) for name in ("thesis", "ours")]
        n = next((each["n"] for each in told if each), 0)
        rows.append([target, placement, printed, *(_rate(each) for each in told), n])
    return Table(["object", "placement", "thesis, n = 10", "its planner, here", "our planner", "n"], rows)


def methods_table(content: Content, group: str = "thesis") -> Table:
    """Every method over all cases: success, success after a shake, the viewpoint's error, pictures on the way down."""
    rows = [
        [name, told["n"], _rate(told), _rate(told["shaken"]), f"{told['error']['median']:.1f}", round(told["frames"])]
        for name, told in content["pooled"].get(group, {}).items()
        if "successes" in told  # the others are paired differences
    ]
    columns = ["method", "n", "success [%]", "and after a shake [%]", "median error [deg]", "pictures"]
    return Table(columns, rows)


def differences_table(content: Content, group: str = "thesis") -> Table:
    """What one method has over another on the same starts, percentage points with a bootstrap interval."""
    rows = []
    for name, told in content["pooled"].get(group, {}).items():
        if "successes" in told or not told["n"]:
            continue
        interval = told["interval"]
        ends = [100 * interval[end] for end in ("low", "high")]
        rows.append([name, told["n"], f"{100 * told['mean']:+.1f} [{ends[0]:+.1f}, {ends[1]:+.1f}]"])
    return Table(["difference", "starts", "success [points]"], rows)


def in_hand_table(content: Content, group: str = "thesis", methods: Sequence[str] = ("thesis", "ours")) -> Table:
    """How an object that was lifted sits in the hand: median, and 95th percentile."""
    rows = []
    for name in methods:
        told = content["pooled"].get(group, {}).get(name, {})
        if "tilt_in_hand" in told:
            cells = [told[field] for field in ("tilt_in_hand", "turn_in_hand", "shift_in_hand")]
            rows.append([name, cells[0]["n"], *(f"{each['median']:.1f}, {each['p95']:.1f}" for each in cells)])
    return Table(["method", "lifted", "tilt [deg]", "turn [deg]", "off the middle [mm]"], rows)


def _rate(told: Content | None) -> str:
    if not told:
        return ""
    interval = told["interval"]
    low, high = (interval["low"], interval["high"]) if isinstance(interval, Mapping) else (interval.low, interval.high)
    digits = 0 if told["n"] < 100 else 1  # of ten trials a tenth of a per cent says nothing
    return f"{100 * told['rate']:.{digits}f} [{100 * low:.{digits}f}, {100 * high:.{digits}f}]"
