"""Figures of a network in training, of what it gets wrong, and of what it looks at."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import matplotlib.colors
import matplotlib.ticker
import numpy as np
from matplotlib.patches import Circle, Rectangle
from numpy.typing import ArrayLike, NDArray

from gvp_book.plots.datasets import ACTION_COLORS
from gvp_book.plots.drawing import DASH, FAINT, GRAY, RING, bare, colored, plate, styled
from gvp_lib.planning.plan import Action
from gvp_lib.views.figures import COLORS, BookFigure

_ORDER = "blue orange green vermilion purple sky"
_BLUES = mpl.colors.LinearSegmentedColormap.from_list("page to blue", ["#ffffff", COLORS["sky"], COLORS["blue"]])
_HEAT = mpl.colors.LinearSegmentedColormap.from_list("clear to red", [(0.84, 0.37, 0, 0.0), (0.84, 0.37, 0, 0.85)])


@styled
def preprocessing(rgb: NDArray[np.uint8], crop: int, steps: Mapping[str, NDArray[np.uint8]]) -> BookFigure:
    """Draw the preprocessing of an image, step by step (thesis 2.4.3).

    First comes the whole image, with the square of ``crop`` px that is cropped from its middle; then ``steps``, square
    images by title, all drawn equally large, without interpolation.
    """
    height, width = rgb.shape[:2]
    ratios = [width / height, *len(steps) * [1]]
    figure, (first, *rest) = plate(1.75 * (width / height + len(steps)), 2.15, 1 + len(steps), width_ratios=ratios)
    first.imshow(rgb)
    corner = ((width - crop) / 2 - 0.5, (height - crop) / 2 - 0.5)
    first.add_patch(Rectangle(corner, crop, crop, fill=False, ec=COLORS["vermilion"], lw=1.8))
    first.set_title(f"{width} x {height} px")
    for ax, (title, picture) in zip(rest, steps.items(), strict=True):
        ax.imshow(picture, interpolation="nearest")
        ax.set_title(title)
    for ax in (first, *rest):
        bare(ax)
    return figure


@styled
def learning_rates(rates: Mapping[str, ArrayLike]) -> BookFigure:
    """Plot learning rates by epoch, counted from 1, on a logarithmic scale."""
    figure, (ax,) = plate(5.4, 2.4)
    for name, each, color in colored(rates, _ORDER):
        values = np.asarray(each, float)
        ax.step(np.arange(1, len(values) + 1), values, "o-", where="mid", ms=3.5, color=color, label=name)
    ax.set(xlabel="epoch", ylabel="learning rate", yscale="log")
    ax.xaxis.set_major_locator(mpl.ticker.MaxNLocator(integer=True))
    if len(rates) > 1:
        ax.legend()
    return figure


@styled
def trainings(panels: Mapping[str, Mapping[str, Any]]) -> BookFigure:
    """Plot accuracy by epoch, mean and spread of several trainings, one panel per data set (thesis Figs. 3.3, 3.4).

    A panel has, by the trainings' name, what the stored results have: ``n``, and the ``mean``, the ``sd``, and ``all``
    values of the ``accuracy`` in [0, 1], epoch by epoch.
    """
    names = dict.fromkeys(name for curves in panels.values() for name in curves)
    colors = {name: color for name, _, color in colored(names, _ORDER)}
    figure, axes = plate(4.1 * len(panels), 3.1, len(panels), sharey=True)
    for ax, (title, curves) in zip(axes, panels.items(), strict=True):
        for name, curve in curves.items():
            mean, sd = (100 * np.asarray(curve["accuracy"][key], float) for key in ("mean", "sd"))
            epochs, color = np.arange(1, len(mean) + 1), colors[name]
            for one in curve["accuracy"].get("all", ()):
                ax.plot(epochs, 100 * np.asarray(one, float), color=color, lw=0.5, alpha=0.3, zorder=1)
            ax.fill_between(epochs, mean - sd, mean + sd, color=color, alpha=0.2, lw=0)
            ax.plot(epochs, mean, color=color, label=f"{name}, n = {curve['n']}")
        ax.set(title=title, xlabel="epoch", ylim=(40, 100), xticks=[1, 5, 10, 15, 20], xlim=(1, len(mean)))
        ax.grid(axis="y")
        ax.legend(loc="lower right")
    axes[0].set_ylabel("accuracy [%]")
    return figure


@styled
def confusion(counts: ArrayLike) -> BookFigure:
    """Draw a confusion matrix: labels as rows, answers as columns, counts shaded by their share of the row."""
    table = np.asarray(counts)
    n = len(Action)
    share = table / np.maximum(table.sum(axis=1, keepdims=True), 1)
    names = [action.name.replace("_", " ") for action in Action]
    figure, (ax,) = plate(4.2, 3.6)
    ax.imshow(share, cmap=_BLUES, vmin=0, vmax=1)
    for (row, column), count in np.ndenumerate(table):
        if count:
            color = "white" if share[row, column] > 0.6 else COLORS["ink"]
            weight = "bold" if row == column else "normal"
            ax.text(column, row, str(count), ha="center", va="center", color=color, weight=weight)
    ax.set_xticks(range(n), names, fontsize=8.5)
    ax.set_yticks(range(n), names, fontsize=8.5)
    ax.set(xlabel="the network says", ylabel="label")
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)
    return figure


@styled
def answers(tilts_deg: ArrayLike, said: ArrayLike, right: ArrayLike) -> BookFigure:
    """Plot a network's answers over the cap as the camera sees it, and mark the wrong ones.

    ``tilts_deg`` is where the normal lies in the image, along u and v, shape (n, 2), deg; ``said``, the number of the
    action that the network chose; and ``right``, whether that was the label, shape (n,) each.
    """
    tilts, chosen, good = np.asarray(tilts_deg, float), np.asarray(said, int), np.asarray(right, bool)
    half, edge = 2.5, 30 / np.sqrt(2)  # deg: half a step, within which the label is NO_OP; the corner of the cap
    figure, (ax,) = plate(5.6, 4.7)
    for ring in (10, 20, 30):
        ax.add_patch(Circle((0, 0), ring, fill=False, ec=RING, lw=0.9, zorder=0))
        ax.text(0, ring, f"{ring}°", ha="center", va="center", fontsize=8, color=GRAY, zorder=6,
                bbox={"fc": "white", "ec": "none", "pad": 0.6})  # fmt: skip
    for u, v in itertools.product((1, -1), repeat=2):
        ax.plot([u * half, u * edge], [v * half, v * edge], color=FAINT, lw=1, ls=DASH, zorder=1)
    ax.add_patch(Rectangle((-half, -half), 2 * half, 2 * half, fill=False, ec=FAINT, lw=1, ls=DASH))
    for action, color in ACTION_COLORS.items():
        which = chosen == action
        name = action.name.replace("_", " ")
        ax.plot(*tilts[which & good].T, "o", ms=3, color=color, alpha=0.6, mew=0, zorder=2, label=name)
        ax.plot(*tilts[which & ~good].T, "o", ms=6.5, color=color, mec=COLORS["ink"], mew=1.3, zorder=4)
    ax.plot([], [], "o", ms=6.5, color="white", mec=COLORS["ink"], mew=1.3, label="ringed: wrong")
    ax.set(aspect="equal", xlim=(-31, 31), ylim=(31, -31))
    bare(ax)
    ax.set(xlabel="the normal lies this far along u", ylabel="... and along v (down)")
    figure.legend(loc="outside right upper")
    return figure


@styled
def mistakes(margins_deg: ArrayLike, costs_deg: ArrayLike, edges_deg: Sequence[float]) -> BookFigure:
    """Plot how often a network is wrong by the margin of the label, and what its wrong answers cost.

    The margin is how much worse the second-best action is than the best, and the cost how much worse the answer is (0
    if it is the label), deg, shape (n,) each. ``edges_deg`` are the edges between the bins of the margin, ascending.
    """
    margins, costs, edges = (np.asarray(each, float) for each in (margins_deg, costs_deg, edges_deg))
    bins = np.digitize(margins, edges) - 1
    groups = [costs[bins == k] for k in range(len(edges) - 1)]
    rates = [100 * np.mean(group > 0) if len(group) else 0.0 for group in groups]
    wrong = np.sort(costs[costs > 0])
    figure, (left, right) = plate(8.2, 2.9, 2)
    at = np.arange(len(rates))
    left.bar(at, rates, width=0.8, color=COLORS["vermilion"])
    left.set_xticks(at, [f"{low:g}-{high:g}" for low, high in itertools.pairwise(edges)])
    left.set(xlabel="margin of the label [deg]", ylabel="answers that are wrong [%]")
    for k, (rate, group) in enumerate(zip(rates, groups, strict=True)):
        left.annotate(f"of {len(group)}", (k, rate), (0, 3), textcoords="offset points", ha="center", fontsize=8,
                      color=GRAY)  # fmt: skip
    right.step([0, *wrong], np.arange(len(wrong) + 1), where="post", color=COLORS["vermilion"])
    right.set(xlabel="costs at most [deg]", ylabel="wrong answers", xlim=(0, None), ylim=(0, None))
    return figure


@styled
def attention(
    pictures: Sequence[NDArray[np.uint8]], maps: Sequence[NDArray[np.float64]], titles: Sequence[str] = ()
) -> BookFigure:
    """Draw square RGB images and, below each, the same image under a map of what the network attends to.

    Maps are square and not negative; the largest value of each is drawn in full color.
    """
    n = len(pictures)
    figure, axes = plate(1.5 * n, 3.3, n, 2)
    for upper, lower, picture, each, title in zip(axes[:n], axes[n:], pictures, maps, titles or [""] * n, strict=True):
        for ax in (upper, lower):
            ax.imshow(picture, extent=(0, 1, 1, 0), interpolation="nearest")
            bare(ax)
        top = max(float(np.max(each)), 1e-9)
        lower.imshow(each, cmap=_HEAT, vmin=0, vmax=top, extent=(0, 1, 1, 0), interpolation="bilinear")
        upper.set_title(title, fontsize=9)
    return figure
