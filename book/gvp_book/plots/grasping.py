"""Grasps to look at: an episode replayed from its seed, readings of a descent, success rates and causes of failure; and
tables of the stored experiments (thesis Table 3.2, and things that nobody designed a planner for)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike, NDArray

from gvp_book.claims.claim import Measured
from gvp_book.experiments.grasping import Cause, grasp_cell, grasp_once
from gvp_book.plots.drawing import DASH, FAINT, GRAY, RING, colored, plate, styled
from gvp_book.plots.tables import Content, Table, with_interval
from gvp_lib.simulation.workcell import WorkCell
from gvp_lib.views.figures import COLORS, BookFigure
from gvp_lib.views.scene3d import Scene3D

_CAUSE_COLORS = dict(
    zip(Cause, ("#8d8579", "#c9c1b4", COLORS["vermilion"], COLORS["orange"], COLORS["blue"], COLORS["sky"],
                 COLORS["green"], COLORS["purple"]), strict=True)
)  # fmt: skip
_READINGS: Mapping[str, tuple[str, dict[str, Any]]] = {
    "true": ("true", {"color": RING, "lw": 5, "zorder": 1}),
    "estimates": ("our estimate", {"color": COLORS["blue"], "lw": 1.6, "zorder": 3}),
    "readings": ("reading", {"color": COLORS["vermilion"], "ls": "", "marker": "o", "ms": 4, "zorder": 2}),
}
_THRESHOLD, _STEP = 0.10, 0.005  # m: below which the thesis closes, and of a descent
_MOVED = 0.002  # m, by which fingers have begun to close
_NEAR, _LOW = 0.50, np.radians(9)  # m and rad, of the eye of a close-up


@dataclass(frozen=True, eq=False)
class Replay:
    """Replayed episode: its row's entries for the method's grasp, and close-ups, RGB."""

    told: dict[str, Any]
    closing: NDArray[np.uint8]  # as the fingers began to close; where they never did, the ending
    ending: NDArray[np.uint8] | None  # after hold and shake, or where the hand stopped; None unless asked for


def replay(
    job: Mapping[str, Any], method: str = "thesis", *, width: int = 480, height: int = 480, ending: bool = False
) -> Replay:
    """Replay one of :func:`~gvp_book.experiments.grasping.grasping_jobs` from its seed, with one of the methods.

    Takes a picture at the moment of closing and, with ``ending``, another at the end. These are taken from outside and
    change nothing, so the episode runs exactly as before.
    """
    cell = grasp_cell(job)
    placed: list[NDArray[np.float64]] = []
    closing: list[NDArray[np.uint8]] = []

    def look() -> None:
        if cell.dynamic and not placed:  # the grasp has only begun
            placed.append(cell.truth.world_from_object.translation)
        if placed and not closing and cell.gripper.width < cell.gripper.stroke[1] - _MOVED:
            closing.append(_close_up(cell, placed[0], width, height))

    cell.dynamic = False  # an episode that broke off may have left it on
    with cell.watch(look):
        grasp = grasp_once({**job, "methods": [method]})[method]
    end = None
    if ending or not closing:
        at = placed[0] if placed else cell.truth.world_from_object.translation  # it may have ended before time passed
        end = _close_up(cell, at, width, height)
        closing = closing or [end]
    return Replay(grasp, closing[0], end)


def _close_up(cell: WorkCell, center: NDArray[np.float64], width: int, height: int) -> NDArray[np.uint8]:
    """From the side on which the robot is not, at right angles to the way the fingers move."""
    along = cell.truth.world_from_camera.rotation.as_matrix()[:2, 1]
    along = along if along[0] > 0 else -along
    scene = Scene3D(cell)
    scene.look_from(float(np.arctan2(along[1], along[0])), _LOW, _NEAR, center + [0.0, 0.0, 0.07])
    return scene.still(width, height)


@styled
def readings_on_the_way_down(descents: Mapping[str, Mapping[str, Any]]) -> BookFigure:
    """Plot the range sensor's readings during descents against the distance traveled, one panel per descent.

    A descent has ``readings`` and, optionally, ``true`` distances and ``estimates`` of them, shape (n,) each, m; and
    ``closes``, by the name of a rule, the number of the increment at which it closed, or None.
    """
    rules = list(dict.fromkeys(name for descent in descents.values() for name in descent.get("closes", {})))
    readings = [np.asarray(descent["readings"], float) for descent in descents.values()]
    top = 1100 * max(float(np.max(each[np.isfinite(each)], initial=_THRESHOLD)) for each in readings)
    figure, axes = plate(4.3 * len(descents), 3.1, len(descents), sharey=True)
    for ax, (title, descent) in zip(axes, descents.items(), strict=True):
        ax.axhline(1000 * _THRESHOLD, color=FAINT, lw=1, ls=DASH, zorder=0)
        for name, (label, look) in _READINGS.items():
            if name in descent:
                values = 1000 * np.asarray(descent[name], float)
                ax.plot(1000 * _STEP * np.arange(len(values)), values, label=label, **look)
        for name, k in descent.get("closes", {}).items():
            if k is None:
                continue
            color = COLORS[("vermilion", "blue", "green")[rules.index(name) % 3]]
            at = 0.99 - 0.09 * rules.index(name)
            ax.axvline(1000 * _STEP * k, color=color, lw=1, ls=(0, (1, 2)))
            ax.text(1000 * _STEP * k, at, f" {name} closes ", color=color, fontsize=8.5,
                    transform=ax.get_xaxis_transform(), va="top",
                    ha="right" if 2 * k > len(np.asarray(descent["readings"])) else "left")  # fmt: skip
        ax.set(title=title, xlabel="way down [mm]", ylim=(0, top))
    axes[0].set_ylabel("distance to the surface [mm]")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


@styled
def rates(cases: Mapping[str, Mapping[str, tuple[int, int]]]) -> BookFigure:
    """Plot success rates with their Wilson intervals, one row per case: successes and trials, by name."""
    names = dict.fromkeys(name for case in cases.values() for name in case)
    figure, (ax,) = plate(7.6, 0.9 + 0.12 * len(cases) * (len(names) + 1))
    colors = [(name, color) for name, _, color in colored(names, "ink orange blue green purple sky")]
    for row, case in enumerate(cases.values()):
        if row % 2:
            ax.axhspan(row - 0.5, row + 0.5, color="#f6f3ee", lw=0, zorder=0)
        for k, (name, color) in enumerate(colors):
            if name in case:
                successes, n = case[name]
                y = row + 0.75 * ((k + 0.5) / len(names) - 0.5)
                ax.plot(Measured.counted(successes, n).ends, [y, y], color=color, lw=2, alpha=0.5)
                ax.plot(100 * successes / max(n, 1), y, "o", ms=5, color=color)
    for name, color in colors:
        ax.plot([], [], "o-", ms=5, color=color, label=name)
    ax.set(xlabel="grasps that succeed [%]", xlim=(0, 101))
    _rows(ax, list(cases))
    figure.legend(loc="outside upper center", ncols=len(names))
    return figure


def _rows(ax: Axes, labels: list[str]) -> None:
    """A row for each label, the first on top."""
    ax.set(yticks=range(len(labels)), yticklabels=labels)
    ax.set_ylim(len(labels) - 0.5, -0.5)
    ax.grid(axis="x")
    ax.set_axisbelow(True)


@styled
def cause_bars(tallies: Mapping[str, Mapping[str, Any]]) -> BookFigure:
    """Plot the share of grasps that failed, by cause, one bar per :func:`~gvp_book.experiments.grasping.tally`.

    Causes are stacked in the order in which they occur.
    """
    figure, (ax,) = plate(7.6, 1.1 + 0.25 * len(tallies))
    left = np.zeros(len(tallies))
    for cause, color in _CAUSE_COLORS.items():
        if any(cause in tally["causes"] for tally in tallies.values()):
            share = np.array([100 * tally["causes"].get(cause, 0) / tally["n"] for tally in tallies.values()])
            ax.barh(range(len(tallies)), share, 0.72, left=left, color=color, label=cause)
            left += share
    ax.set(xlabel="grasps that fail [%]", xlim=(0, max(1.0, 1.04 * left.max())))
    _rows(ax, list(tallies))
    figure.legend(loc="outside upper center", ncols=4)
    return figure


@styled
def success_by_error(errors: Mapping[str, tuple[ArrayLike, ArrayLike]]) -> BookFigure:
    """Plot the success rate by the viewpoint error before the descent, in bins with Wilson intervals and their n.

    By name: errors, deg, and whether each grasp succeeded, shape (n,) each. Bins with fewer than five are left out.
    """
    bins = np.array([0, 2, 5, 10, 15, 20, 25, 30, 35, 40, 75])  # deg
    figure, (ax,) = plate(7.2, 3.0)
    for k, (name, (error, success), color) in enumerate(colored(errors, "orange blue green purple sky")):
        which = np.digitize(np.asarray(error, float), bins) - 1
        points = []
        for i in range(len(bins) - 1):
            held = np.asarray(success, bool)[which == i]
            if (n := len(held)) < 5:
                continue
            center = 0.5 * (bins[i] + bins[i + 1])
            x = center + 0.7 * k
            ax.plot([x, x], Measured.counted(int(held.sum()), n).ends, color=color, lw=2, alpha=0.5)
            row = (0, -26 - 9 * k)  # points below the axis, where intervals cannot cover it
            ax.annotate(str(n), (center, 0), row, color=color, fontsize=7.5, ha="center", va="center",
                        xycoords=("data", "axes fraction"), textcoords="offset points")  # fmt: skip
            points.append((x, 100 * held.sum() / n))
        if points:
            ax.plot(*np.transpose(points), "o-", ms=5, lw=1, color=color, label=name)
    ax.annotate("n", (0, 0), (-14, -26), xycoords="axes fraction", textcoords="offset points", ha="center",
                va="center", fontsize=7.5, color=GRAY)  # fmt: skip
    ax.set(ylabel="grasps that succeed [%]", ylim=(-3, 103))
    ax.set_xlabel("error of the viewpoint [deg]", labelpad=8 + 9 * len(errors))
    ax.grid(axis="y")
    ax.legend()
    return figure


def grasping_table(content: Content, group: str = "thesis") -> Table:
    """Table 3.2 beside ours, case by case: the rate in percent with its Wilson interval, and n.

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
            n = ", ".join(dict.fromkeys(str(each["n"]) for each in ours if each))
            rows.append([target, placement, *(_rate(each) for each in (printed, *ours)), n])
    return Table(["object", "placement", "thesis, n = 10", "reproduced", "our planner", "n"], rows)


def methods_table(content: Content, group: str = "thesis") -> Table:
    """Table of all methods over all cases: success, also after a shake, and such that the object can be placed (see
    :func:`~gvp_book.experiments.grasping.placeable`); viewpoint error; images during the descent.

    What version 0.1 stored does not tell what is placeable.
    """
    rows = [
        [name, each["n"], *(_rate(rate) for rate in (each, each["shaken"], each.get("placeable"))),
         f"{each['error']['median']:.1f}", round(each["frames"])]
        for name, each in content["pooled"].get(group, {}).items()
        if "successes" in each  # the others are paired differences
    ]  # fmt: skip
    columns = ["method", "n", "success [%]", "and after a shake [%]", "placeable [%]", "median error [deg]", "pictures"]
    return Table(columns, rows)


def placing_table(content: Content) -> Table:
    """Table of all methods on what leans or lies on a ramp, by placement: held, through the shake too, and placeable.

    ``content`` is of :func:`gvp_book.experiments.grasping.grasping_report`.
    """
    rows = [
        [placement, name, each["n"], _rate(each["shaken"]), _rate(each["placeable"])]
        for placement, methods in content.get("placing", {}).items()
        for name, each in methods.items()
        if "successes" in each
    ]
    return Table(["placement", "method", "n", "held [%]", "placeable [%]"], rows)


def objects_table(content: Content, part: str = "pooled") -> Table:
    """Table of all methods on things that nobody designed a planner for: held, through the shake too, in all, at the
    first attempt, and where the oracle holds; placeable; pictures and views of the last plan.

    ``content`` is of :func:`gvp_book.experiments.objects.object_report`; the parts are ``"pooled"``, ``"placements"``
    and, by thing, ``"summary"``.
    """
    rows = [
        [case, name, each["n"],
         *(_rate(each.get(rate)) for rate in ("shaken", "first", "where the oracle holds", "placeable")),
         f"{each['pictures']:.0f}", f"{each['views']:.1f}"]
        for case, methods in content[part].items()
        for name, each in methods.items()
        if isinstance(each, Mapping) and "successes" in each
    ]  # fmt: skip
    rates = ["held [%]", "at once [%]", "of what the oracle holds [%]", "placeable [%]"]
    return Table(["met", "method", "n", *rates, "pictures", "views"], rows)


def differences_table(content: Content, group: str = "thesis") -> Table:
    """Table of differences between methods on the same starts, percentage points with bootstrap intervals."""
    rows = [
        [name, each["n"], with_interval(each, scale=100, sign="+")]
        for name, each in content["pooled"].get(group, {}).items()
        if "successes" not in each and each["n"]
    ]
    return Table(["difference", "starts", "success [points]"], rows)


def in_hand_table(content: Content, group: str = "thesis") -> Table:
    """Table of the pose in the hand of lifted objects: median and 95th percentile."""
    rows = []
    for name in ("thesis", "moments", "ours"):
        method = content["pooled"].get(group, {}).get(name, {})
        if "tilt_in_hand" in method:
            cells = [method[column] for column in ("tilt_in_hand", "turn_in_hand", "shift_in_hand")]
            rows.append([name, cells[0]["n"], *(f"{each['median']:.1f}, {each['p95']:.1f}" for each in cells)])
    return Table(["method", "lifted", "tilt [deg]", "turn [deg]", "off the middle [mm]"], rows)


def objects_held(
    content: Content, met: str = "alone", methods: Sequence[str] = ("ours", "look_down", "oracle")
) -> BookFigure:
    """Plot how many grasps of each thing held, through the shake too, met ``"alone"`` or ``"among"`` others.

    ``content`` is of :func:`gvp_book.experiments.objects.object_report`.
    """
    return rates({
        thing: {name: (found[name]["shaken"]["successes"], found[name]["n"]) for name in methods if name in found}
        for case, found in content["summary"].items()
        for own, thing in [case.split("/")]
        if own == met
    })  # fmt: skip


def _rate(tally: Mapping[str, Any] | None) -> str:
    if not tally:
        return ""
    digits = 0 if tally["n"] < 100 else 1  # of ten trials a tenth of a per cent says nothing
    return with_interval(tally, "rate", digits, scale=100)
