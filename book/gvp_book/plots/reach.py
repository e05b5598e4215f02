"""How much of the sphere an arm reaches, from the stored experiment: a table with intervals, and maps of the cap."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.patches import Circle

from gvp_book.plots.tables import Table
from gvp_lib.errors import UnknownNameError
from gvp_lib.views.figures import COLORS, BookFigure, style

__all__ = ["reach_map", "reach_table"]

Content = Mapping[str, Any]
_STANDS = {"fixed": "bolted down", "base": "on a base"}
_RING = "#b9b0a2"


def reach_table(content: Content, cap: int = 60) -> Table:
    """The share of a cap that each arm reaches, in percent with 95 % intervals, bolted down and on a base.

    Parameters
    ----------
    content
        Of :func:`gvp_book.experiments.reach.reach_report`.
    cap
        Half angle, deg: 30 or 60.
    """
    rows = []
    for case, told in _of_cap(content["summary"], cap).items():
        arm, stand, place, _ = case.split("/")
        if stand == "fixed":
            on_base = content["summary"][f"{arm}/base/{place}/{cap}"]
            shares = [_percent(each[name]) for name in ("stands", "comes") for each in (told, on_base)]
            rows.append([arm, place, *shares, told["n"]])
    heads = [f"{verb}, {stand} [%]" for verb in ("stands", "comes") for stand in _STANDS.values()]
    return Table(["arm", "object", *heads, "n"], rows)


def reach_map(content: Content, arm: str) -> BookFigure:
    """Every viewpoint that was tried, seen from above, by whether the arm comes there; a column for each place."""
    cases = {case: rows for case, rows in content["rows"].items() if case.startswith(f"{arm}/")}
    if not cases:
        raise UnknownNameError("arm", arm, {case.split("/")[0] for case in content["rows"]})
    places = list(dict.fromkeys(case.split("/")[2] for case in cases))
    with style():
        figure = BookFigure(figsize=(2.2 * len(places), 4.7), layout="constrained")
        axes = figure.subplots(2, len(places), squeeze=False)
        for line, (stand, name) in zip(axes, _STANDS.items(), strict=True):
            for ax, place in zip(line, places, strict=True):
                for case in (c for c in cases if c.startswith(f"{arm}/{stand}/{place}/")):
                    tilt, azimuth = (np.array(cases[case][angle], float) for angle in ("tilt", "azimuth"))
                    x, y = tilt * np.cos(np.radians(azimuth)), tilt * np.sin(np.radians(azimuth))
                    comes = np.array([flag == "1" for flag in cases[case]["comes"]])
                    ax.scatter(x[comes], y[comes], s=12, color=COLORS["blue"], lw=0)
                    ax.scatter(x[~comes], y[~comes], s=16, color=COLORS["vermilion"], marker="x", lw=1.2)
                for radius in (30, 60):
                    ax.add_patch(Circle((0, 0), radius, fill=False, ec=_RING, lw=1, zorder=0))
                ax.set(aspect="equal", xlim=(-64, 64), ylim=(-64, 64), xticks=[], yticks=[])
                ax.spines[:].set_visible(False)
                ax.set_title(f"{place},\n{name}", fontsize=8.5)
    return figure


def _of_cap(summary: Content, cap: int) -> Content:
    found = {case: told for case, told in summary.items() if case.endswith(f"/{cap}")}
    if not found:
        raise UnknownNameError("cap", cap, {case.rpartition("/")[2] for case in summary})
    return found


def _percent(told: Content) -> str:
    low, high = (100 * told["interval"][end] for end in ("low", "high"))
    return f"{100 * told['share']:.0f} [{low:.0f},\N{NO-BREAK SPACE}{high:.0f}]"
