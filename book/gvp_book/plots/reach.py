"""How much of the sphere an arm reaches, from the stored experiment: a table with intervals, and maps of the cap."""

from __future__ import annotations

from functools import partial

import numpy as np
from matplotlib.patches import Circle

from gvp_book.plots.drawing import FAINT, bare, plate, styled
from gvp_book.plots.tables import Content, Table, with_interval
from gvp_lib.errors import UnknownNameError
from gvp_lib.views.figures import COLORS, BookFigure

_STANDS = {"fixed": "bolted down", "base": "on a base"}


def reach_table(content: Content, cap: int = 60) -> Table:
    """Table of the share of a cap that each arm reaches, percent with 95 % intervals, bolted down and on a base.

    ``content`` is of :func:`gvp_book.experiments.reach.reach_report`; ``cap`` is a half angle, deg, 30 or 60.
    """
    summary = content["summary"]
    cases = [case.split("/") for case in summary]
    if str(cap) not in (own for *_, own in cases):
        raise UnknownNameError("cap", cap, {own for *_, own in cases})
    percent = partial(with_interval, name="share", digits=0, scale=100, space="\N{NO-BREAK SPACE}")
    rows = []
    for arm, stand, place, own in cases:
        if (stand, own) == ("fixed", str(cap)):
            both = [summary[f"{arm}/{each}/{place}/{cap}"] for each in _STANDS]
            shares = [percent(each[verb]) for verb in ("stands", "comes") for each in both]
            rows.append([arm, place, *shares, both[0]["n"]])
    heads = [f"{verb}, {stand} [%]" for verb in ("stands", "comes") for stand in _STANDS.values()]
    return Table(["arm", "object", *heads, "n"], rows)


@styled
def reach_map(content: Content, arm: str) -> BookFigure:
    """Map of all viewpoints tried, seen from above, by whether the arm gets there, one column per place."""
    cases = {tuple(case.split("/")): rows for case, rows in content["rows"].items()}
    arms = {own for own, *_ in cases}
    if arm not in arms:
        raise UnknownNameError("arm", arm, arms)
    places = list(dict.fromkeys(place for own, _, place, _ in cases if own == arm))
    figure, axes = plate(2.2 * len(places), 4.7, len(places), 2)
    panels = [(stand, place) for stand in _STANDS for place in places]
    for ax, panel in zip(axes, panels, strict=True):
        for rows in (rows for (own, *at, _), rows in cases.items() if (own, *at) == (arm, *panel)):
            tilt, azimuth = (np.array(rows[angle], float) for angle in ("tilt", "azimuth"))
            x, y = tilt * np.cos(np.radians(azimuth)), tilt * np.sin(np.radians(azimuth))
            comes = np.array([flag == "1" for flag in rows["comes"]])
            ax.scatter(x[comes], y[comes], s=12, color=COLORS["blue"], lw=0)
            ax.scatter(x[~comes], y[~comes], s=16, color=COLORS["vermilion"], marker="x", lw=1.2)
        for radius in (30, 60):
            ax.add_patch(Circle((0, 0), radius, fill=False, ec=FAINT, lw=1, zorder=0))
        ax.set(aspect="equal", xlim=(-64, 64), ylim=(-64, 64))
        bare(ax)
        ax.set_title(f"{panel[1]},\n{_STANDS[panel[0]]}", fontsize=8.5)
    return figure
