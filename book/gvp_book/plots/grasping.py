"""Grasps to look at: an episode replayed from its seed, readings of a descent, success rates and causes of failure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvp_book.experiments.grasp_judgement import CAUSES
from gvp_book.experiments.grasping import grasp_cell, grasp_once
from gvp_lib.errors import InvalidParameterError
from gvp_lib.evaluation.statistics import wilson_interval
from gvp_lib.simulation.workcell import WorkCell
from gvp_lib.views.figures import COLORS, BookFigure, style
from gvp_lib.views.scene3d import Scene3D

__all__ = [
    "Replay",
    "cause_bars",
    "rates",
    "readings_on_the_way_down",
    "replay",
    "success_by_error",
]

Content = Mapping[str, Any]

_FAINT = "#b9b0a2"
_ORDER = ("ink", "orange", "blue", "green", "purple", "sky")
_CAUSE_COLORS = dict(
    zip(CAUSES, ("#8d8579", "#c9c1b4", COLORS["vermilion"], COLORS["orange"], COLORS["blue"], COLORS["sky"],
                 COLORS["green"], COLORS["purple"]), strict=True)
)  # fmt: skip
_MOVED = 0.002  # m, by which fingers have begun to close
_NEAR, _LOW = 0.50, np.radians(9)  # m and rad, of the eye of a close-up


@dataclass(frozen=True, eq=False)
class Replay:
    """An episode that was run again.

    Attributes
    ----------
    told
        What :func:`gvp_book.experiments.grasping.grasp_once` tells of the method's grasp.
    closing
        A close-up, RGB, as the fingers began to close; where they never did, the ending.
    ending
        One of the end: after the hold and the shake, or where the hand stopped. None where it was not asked for.
    """

    told: dict[str, Any]
    closing: NDArray[np.uint8]
    ending: NDArray[np.uint8] | None


def replay(
    job: Mapping[str, Any], method: str = "thesis", *, width: int = 480, height: int = 480, ending: bool = False
) -> Replay:
    """Run one episode of the experiment behind Table 3.2 again from its seed, and look at the moment of closing.

    Nothing is asked of the episode while it runs but a picture from outside, so that it goes as it went before.

    Parameters
    ----------
    job
        Of :func:`gvp_book.experiments.grasping.grasping_jobs`.
    method
        Of :data:`gvp_book.experiments.grasping.METHODS`.
    ending
        Whether to look at the end as well.
    """
    cell = grasp_cell(job)
    placed: list[NDArray[np.float64]] = []
    closing: list[NDArray[np.uint8]] = []

    def look() -> None:
        if not cell.dynamic:
            return
        if not placed:  # the grasp has only begun
            placed.append(cell.truth.world_from_object.translation)
        if not closing and cell.gripper.width < cell.gripper.stroke[1] - _MOVED:
            closing.append(_close_up(cell, placed[0], width, height))

    cell.dynamic = False  # an episode that broke off may have left it on
    with cell.watch(look):
        told = grasp_once({**job, "methods": [method]})[method]
    end = None
    if ending or not closing:
        at = placed[0] if placed else cell.truth.world_from_object.translation  # it may have ended before time passed
        end = _close_up(cell, at, width, height)
        closing = closing or [end]
    return Replay(told, closing[0], end)


def _close_up(cell: WorkCell, center: NDArray[np.float64], width: int, height: int) -> NDArray[np.uint8]:
    """From the side on which the robot is not, at right angles to the way the fingers move."""
    along = cell.truth.world_from_camera.rotation.as_matrix()[:2, 1]
    along = along if along[0] > 0 else -along
    scene = Scene3D(cell)
    scene.look_from(float(np.arctan2(along[1], along[0])), _LOW, _NEAR, center + [0.0, 0.0, 0.07])
    return scene.still(width, height)


def readings_on_the_way_down(
    descents: Mapping[str, Mapping[str, Any]], threshold: float = 0.10, step: float = 0.005
) -> BookFigure:
    """What the range sensor said at each increment of a descent, a panel each, against how far the hand had come.

    Parameters
    ----------
    descents
        By title: ``readings``; optionally ``true`` distances and ``estimates`` of them, each of shape (n,), m; and
        ``closes``, by name of a rule the number of the increment at which it closed, or None.
    threshold
        Below which the thesis closes, m.
    step
        Of the descent, m.
    """
    if not descents or any("readings" not in descent for descent in descents.values()):
        raise InvalidParameterError("give at least one descent, each with its readings")
    rules = list(dict.fromkeys(name for descent in descents.values() for name in descent.get("closes", {})))
    top = 1100 * max(
        float(np.max(values[np.isfinite(values)], initial=threshold))
        for values in (np.asarray(descent["readings"], float) for descent in descents.values())
    )
    with style():
        figure = BookFigure(figsize=(4.3 * len(descents), 3.1), layout="constrained")
        axes = figure.subplots(1, len(descents), squeeze=False, sharey=True)[0]
        for ax, (title, descent) in zip(axes, descents.items(), strict=True):
            ax.axhline(1000 * threshold, color=_FAINT, lw=1, ls=(0, (4, 3)), zorder=0)
            for name, label, look in (
                ("true", "true", {"color": "#d9d2c6", "lw": 5, "zorder": 1}),
                ("estimates", "our estimate", {"color": COLORS["blue"], "lw": 1.6, "zorder": 3}),
                ("readings", "reading", {"color": COLORS["vermilion"], "ls": "", "marker": "o", "ms": 4, "zorder": 2}),
            ):
                if name in descent:
                    values = 1000 * np.asarray(descent[name], float)
                    ax.plot(1000 * step * np.arange(len(values)), values, label=label, **look)
            for name, k in descent.get("closes", {}).items():
                if k is None:
                    continue
                color = ("vermilion", "blue", "green")[rules.index(name) % 3]
                at = 0.99 - 0.09 * rules.index(name)
                ax.axvline(1000 * step * k, color=COLORS[color], lw=1, ls=(0, (1, 2)))
                ax.text(1000 * step * k, at, f" {name} closes ", color=COLORS[color], fontsize=8.5,
                        transform=ax.get_xaxis_transform(), va="top",
                        ha="right" if 2 * k > len(np.asarray(descent["readings"])) else "left")  # fmt: skip
            ax.set(title=title, xlabel="way down [mm]", ylim=(0, top))
        axes[0].set_ylabel("distance to the surface [mm]")
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


def rates(
    cases: Mapping[str, Mapping[str, tuple[int, int]]], xlabel: str = "grasps that succeed [%]", *, low: float = 0
) -> BookFigure:
    """Success rates as dots with their Wilson intervals, a row for each case.

    Parameters
    ----------
    cases
        By case, then by name: successes and trials.
    low
        Where the scale begins, per cent.
    """
    names = list(dict.fromkeys(name for case in cases.values() for name in case))
    if not names:
        raise InvalidParameterError("give at least one case with one rate, (successes, trials)")
    with style():
        figure = BookFigure(figsize=(7.6, 0.9 + 0.12 * len(cases) * (len(names) + 1)), layout="constrained")
        ax = figure.subplots()
        for row, case in enumerate(cases.values()):
            if row % 2:
                ax.axhspan(row - 0.5, row + 0.5, color="#f6f3ee", lw=0, zorder=0)
            for k, name in enumerate(names):
                if name not in case:
                    continue
                successes, n = case[name]
                interval = wilson_interval(successes, n)
                y = row + 0.75 * ((k + 0.5) / len(names) - 0.5)
                color = COLORS[_ORDER[k % len(_ORDER)]]
                ax.plot([100 * interval.low, 100 * interval.high], [y, y], color=color, lw=2, alpha=0.5)
                ax.plot(100 * successes / max(n, 1), y, "o", ms=5, color=color)
        for k, name in enumerate(names):
            ax.plot([], [], "o-", ms=5, color=COLORS[_ORDER[k % len(_ORDER)]], label=name)
        ax.set(xlabel=xlabel, xlim=(low, 101), yticks=range(len(cases)), yticklabels=list(cases))
        ax.set_ylim(len(cases) - 0.5, -0.5)
        ax.grid(axis="x")
        ax.set_axisbelow(True)
        figure.legend(loc="outside upper center", ncols=len(names))
    return figure


def cause_bars(tallies: Mapping[str, Content]) -> BookFigure:
    """What share of grasps failed, and why: a bar for each name, stacked by cause in the order in which they act.

    Parameters
    ----------
    tallies
        By label, of :func:`gvp_book.experiments.grasping.tally`.
    """
    if not tallies:
        raise InvalidParameterError("give at least one tally")
    there = [cause for cause in CAUSES if any(cause in each["causes"] for each in tallies.values())]
    with style():
        figure = BookFigure(figsize=(7.6, 1.1 + 0.25 * len(tallies)), layout="constrained")
        ax = figure.subplots()
        left = np.zeros(len(tallies))
        for cause in there:
            share = np.array([100 * each["causes"].get(cause, 0) / each["n"] for each in tallies.values()])
            ax.barh(range(len(tallies)), share, 0.72, left=left, color=_CAUSE_COLORS[cause], label=cause)
            left += share
        ax.set(
            xlabel="grasps that fail [%]",
            xlim=(0, max(1.0, 1.04 * left.max())),
            yticks=range(len(tallies)),
            yticklabels=list(tallies),
        )
        ax.set_ylim(len(tallies) - 0.5, -0.5)
        ax.grid(axis="x")
        ax.set_axisbelow(True)
        figure.legend(loc="outside upper center", ncols=4)
    return figure


def success_by_error(
    errors: Mapping[str, tuple[ArrayLike, ArrayLike]], edges: ArrayLike = (0, 2, 5, 10, 15, 20, 25, 30, 35, 40, 75)
) -> BookFigure:
    """Success against the error of the viewpoint before the descent, in bins with Wilson intervals, and each bin's n.

    Parameters
    ----------
    errors
        By name: errors, deg, and whether each grasp succeeded, each of shape (n,).
    edges
        Of the bins, deg; a bin of fewer than five grasps is left out.
    """
    bins = np.asarray(edges, float)
    with style():
        figure = BookFigure(figsize=(7.2, 3.0), layout="constrained")
        ax = figure.subplots()
        for k, (name, (error, success)) in enumerate(errors.items()):
            error, success = np.asarray(error, float), np.asarray(success, bool)
            which = np.digitize(error, bins) - 1
            color = COLORS[_ORDER[1 + k % 5]]
            points = []
            for i in range(len(bins) - 1):
                n, held = int((which == i).sum()), int(success[which == i].sum())
                if n < 5:
                    continue
                interval = wilson_interval(held, n)
                center = 0.5 * (bins[i] + bins[i + 1])
                x = center + 0.7 * k
                ax.plot([x, x], [100 * interval.low, 100 * interval.high], color=color, lw=2, alpha=0.5)
                row = (0, -26 - 9 * k)  # points below the axis, where intervals cannot cover it
                ax.annotate(str(n), (center, 0), row, color=color, fontsize=7.5, ha="center", va="center",
                            xycoords=("data", "axes fraction"), textcoords="offset points")  # fmt: skip
                points.append((x, 100 * held / n))
            if points:
                ax.plot(*np.transpose(points), "o-", ms=5, lw=1, color=color, label=name)
        ax.annotate("n", (0, 0), (-14, -26), xycoords="axes fraction", textcoords="offset points", ha="center",
                    va="center", fontsize=7.5, color="#6f675b")  # fmt: skip
        ax.set(ylabel="grasps that succeed [%]", ylim=(-3, 103))
        ax.set_xlabel("error of the viewpoint [deg]", labelpad=8 + 9 * len(errors))
        ax.grid(axis="y")
        ax.legend()
    return figure
