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
from gvp_lib.errors import InvalidParameterError
from gvp_lib.planning.plan import Action
from gvp_lib.views.figures import COLORS, BookFigure, style

__all__ = ["answers", "attention", "confusion", "history", "learning_rates", "mistakes", "preprocessing", "trainings"]

_FAINT = "#b9b0a2"
_RING = "#d9d2c6"
_ORDER = ("blue", "orange", "green", "vermilion", "purple", "sky")
_BLUES = mpl.colors.LinearSegmentedColormap.from_list("page to blue", ["#ffffff", COLORS["sky"], COLORS["blue"]])
_HEAT = mpl.colors.LinearSegmentedColormap.from_list("clear to red", [(0.84, 0.37, 0, 0.0), (0.84, 0.37, 0, 0.85)])


def preprocessing(rgb: NDArray[np.uint8], crop: int, steps: Mapping[str, NDArray[np.uint8]]) -> BookFigure:
    """A whole picture with the square that is cropped, and what becomes of that square (thesis 2.4.3).

    Parameters
    ----------
    rgb
        uint8 (H, W, 3).
    crop
        Side of the square in its middle, px.
    steps
        By title: square pictures, drawn equally large, pixel by pixel.
    """
    if not steps or not 1 <= crop <= min(rgb.shape[:2]):
        raise InvalidParameterError(
            f"give at least one step, and a crop within the picture, which is {rgb.shape[1]} x {rgb.shape[0]} px; got "
            f"{len(steps)} and {crop}"
        )
    height, width = rgb.shape[:2]
    with style():
        figure = BookFigure(figsize=(1.75 * (width / height + len(steps)), 2.15), layout="constrained")
        first, *rest = figure.subplots(1, 1 + len(steps), width_ratios=[width / height, *len(steps) * [1]])
        first.imshow(rgb)
        corner = ((width - crop) / 2 - 0.5, (height - crop) / 2 - 0.5)
        first.add_patch(Rectangle(corner, crop, crop, fill=False, ec=COLORS["vermilion"], lw=1.8))
        first.set_title(f"{width} x {height} px")
        for ax, (title, picture) in zip(rest, steps.items(), strict=True):
            ax.imshow(picture, interpolation="nearest")
            ax.set_title(title)
        for ax in (first, *rest):
            ax.set(xticks=[], yticks=[])
            ax.spines[:].set_visible(False)
    return figure


def learning_rates(rates: Mapping[str, ArrayLike]) -> BookFigure:
    """Learning rates, epoch by epoch, counted from 1, on a logarithmic scale."""
    if not rates:
        raise InvalidParameterError("give the rates of at least one schedule")
    with style():
        figure = BookFigure(figsize=(5.4, 2.4), layout="constrained")
        ax = figure.subplots()
        for (name, each), color in zip(rates.items(), _ORDER * len(rates), strict=False):
            values = np.asarray(each, float)
            ax.step(np.arange(1, len(values) + 1), values, "o-", where="mid", ms=3.5, color=COLORS[color], label=name)
        ax.set(xlabel="epoch", ylabel="learning rate", yscale="log")
        ax.xaxis.set_major_locator(mpl.ticker.MaxNLocator(integer=True))
        if len(rates) > 1:
            ax.legend()
    return figure


def history(lines: Sequence[Mapping[str, float]], levels: Mapping[str, float] | None = None) -> BookFigure:
    """One training: loss and accuracy over the training set, as the weights changed, and after it on the validation
    set.

    Parameters
    ----------
    lines
        One for each epoch, as in ``Training.history``.
    levels
        By name: accuracies to compare with, in [0, 1], as dashed lines.
    """
    if not lines:
        raise InvalidParameterError("give the history of at least one epoch")
    epochs = [line["epoch"] for line in lines]
    with style():
        figure = BookFigure(figsize=(8.2, 2.9), layout="constrained")
        left, right = figure.subplots(1, 2)
        for ax, key, scale in ((left, "loss", 1.0), (right, "accuracy", 100.0)):
            for name, prefix, color in (("training", "", "orange"), ("validation", "validation_", "blue")):
                ax.plot(epochs, [scale * line[prefix + key] for line in lines], "o-", ms=4, color=COLORS[color],
                        label=name)  # fmt: skip
            ax.set(xlabel="epoch", xticks=epochs)
        for name, level in (levels or {}).items():
            right.axhline(100 * level, color=_FAINT, lw=1, ls=(0, (4, 3)), zorder=0)
            right.annotate(name, (1, 100 * level), (0, 3), ("axes fraction", "data"), textcoords="offset points",
                           ha="right", fontsize=8.5, color="#6f675b")  # fmt: skip
        left.set(ylabel="cross-entropy", ylim=(0, None))
        right.set(ylabel="accuracy [%]", ylim=(0, 100))
        left.legend(loc="lower left")
    return figure


def trainings(panels: Mapping[str, Mapping[str, Any]], *, low: float = 40.0) -> BookFigure:
    """Accuracy over the epochs, mean and spread of several trainings (thesis Figs. 3.3, 3.4): a panel for each set.

    Parameters
    ----------
    panels
        By title, then by the name of the trainings: ``n``, and of their ``accuracy`` in [0, 1] the ``mean``, the
        ``sd`` and ``all`` of them, epoch by epoch; as in the stored results.
    low
        Where the scale of the accuracy begins, per cent.
    """
    if not panels or any(not curves for curves in panels.values()):
        raise InvalidParameterError("give at least one panel with one curve")
    names = [name for curves in panels.values() for name in curves]
    colors = dict(zip(dict.fromkeys(names), _ORDER * len(names), strict=False))
    with style():
        figure = BookFigure(figsize=(4.1 * len(panels), 3.1), layout="constrained")
        axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
        for ax, (title, curves) in zip(axes, panels.items(), strict=True):
            for name, curve in curves.items():
                mean, sd = (100 * np.asarray(curve["accuracy"][key], float) for key in ("mean", "sd"))
                epochs, color = np.arange(1, len(mean) + 1), COLORS[colors[name]]
                for one in curve["accuracy"].get("all", ()):
                    ax.plot(epochs, 100 * np.asarray(one, float), color=color, lw=0.5, alpha=0.3, zorder=1)
                ax.fill_between(epochs, mean - sd, mean + sd, color=color, alpha=0.2, lw=0)
                ax.plot(epochs, mean, color=color, label=f"{name}, n = {curve['n']}")
            ax.set(title=title, xlabel="epoch", ylim=(low, 100), xticks=[1, 5, 10, 15, 20], xlim=(1, len(mean)))
            ax.grid(axis="y")
            ax.legend(loc="lower right")
        axes[0].set_ylabel("accuracy [%]")
    return figure


def confusion(counts: ArrayLike) -> BookFigure:
    """How often each label (rows) was answered with each action (columns): counts, shaded by their share of the row."""
    table = np.asarray(counts)
    n = len(Action)
    if table.shape != (n, n) or not np.issubdtype(table.dtype, np.integer):
        raise InvalidParameterError(f"give whole numbers of shape ({n}, {n}); got {table.dtype} {table.shape}")
    share = table / np.maximum(table.sum(axis=1, keepdims=True), 1)
    names = [action.name.replace("_", " ") for action in Action]
    with style():
        figure = BookFigure(figsize=(4.2, 3.6), layout="constrained")
        ax = figure.subplots()
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


def answers(tilts_deg: ArrayLike, said: ArrayLike, right: ArrayLike, *, step_deg: float = 5.0) -> BookFigure:
    """Where the normal lay in the picture, and what the network said to it; wrong answers stand out.

    Parameters
    ----------
    tilts_deg
        How far the normal lies along u and v, deg, shape (n, 2): the cap as the camera sees it.
    said
        Numbers of actions, shape (n,).
    right
        Whether each is the label, shape (n,).
    step_deg
        Of an action: the side of the square in which the label is NO_OP.
    """
    tilts, chosen, good = np.asarray(tilts_deg, float), np.asarray(said, int), np.asarray(right, bool)
    if tilts.ndim != 2 or tilts.shape != (len(chosen), 2) or good.shape != chosen.shape:
        raise InvalidParameterError(
            f"give tilts of shape (n, 2), n answers and n flags; got {tilts.shape}, {chosen.shape} and {good.shape}"
        )
    half, edge = step_deg / 2, 30 / np.sqrt(2)
    with style():
        figure = BookFigure(figsize=(5.6, 4.7), layout="constrained")
        ax = figure.subplots()
        for ring in (10, 20, 30):
            ax.add_patch(Circle((0, 0), ring, fill=False, ec=_RING, lw=0.9, zorder=0))
            ax.text(0, ring, f"{ring}°", ha="center", va="center", fontsize=8, color="#6f675b", zorder=6,
                    bbox={"fc": "white", "ec": "none", "pad": 0.6})  # fmt: skip
        for u, v in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            ax.plot([u * half, u * edge], [v * half, v * edge], color=_FAINT, lw=1, ls=(0, (4, 3)), zorder=1)
        ax.add_patch(Rectangle((-half, -half), 2 * half, 2 * half, fill=False, ec=_FAINT, lw=1, ls=(0, (4, 3))))
        for action in Action:
            which, color = chosen == action, ACTION_COLORS[action]
            ax.plot(*tilts[which & good].T, "o", ms=3, color=color, alpha=0.6, mew=0, zorder=2,
                    label=action.name.replace("_", " "))  # fmt: skip
            ax.plot(*tilts[which & ~good].T, "o", ms=6.5, color=color, mec=COLORS["ink"], mew=1.3, zorder=4)
        ax.plot([], [], "o", ms=6.5, color="white", mec=COLORS["ink"], mew=1.3, label="ringed: wrong")
        ax.set(aspect="equal", xlim=(-31, 31), ylim=(31, -31), xticks=[], yticks=[])
        ax.set(xlabel="the normal lies this far along u", ylabel="... and along v (down)")
        ax.spines[:].set_visible(False)
        figure.legend(loc="outside right upper")
    return figure


def mistakes(margins_deg: ArrayLike, costs_deg: ArrayLike, edges_deg: Sequence[float]) -> BookFigure:
    """How often the network errs, by the margin of the label; and what its wrong answers cost.

    Parameters
    ----------
    margins_deg
        By how much the second best action is worse than the best, shape (n,), deg.
    costs_deg
        By how much the answer is worse than the best, shape (n,), deg: 0 where it is the label.
    edges_deg
        Between the bins of the margin, ascending.
    """
    margins, costs, edges = (np.asarray(each, float) for each in (margins_deg, costs_deg, edges_deg))
    if margins.shape != costs.shape or margins.ndim != 1 or len(edges) < 2 or (np.diff(edges) <= 0).any():
        raise InvalidParameterError(
            f"give one margin and one cost for each answer, and two ascending edges or more; got {margins.shape}, "
            f"{costs.shape} and {edges.tolist()}"
        )
    bins = np.digitize(margins, edges) - 1
    rates = [100 * np.mean(costs[bins == k] > 0) if (bins == k).any() else 0.0 for k in range(len(edges) - 1)]
    wrong = np.sort(costs[costs > 0])
    with style():
        figure = BookFigure(figsize=(8.2, 2.9), layout="constrained")
        left, right = figure.subplots(1, 2)
        at = np.arange(len(rates))
        left.bar(at, rates, width=0.8, color=COLORS["vermilion"])
        left.set_xticks(at, [f"{low:g}-{high:g}" for low, high in itertools.pairwise(edges)])
        left.set(xlabel="margin of the label [deg]", ylabel="answers that are wrong [%]")
        for k, rate in zip(at, rates, strict=True):
            left.annotate(f"of {np.sum(bins == k)}", (k, rate), (0, 3), textcoords="offset points", ha="center",
                          fontsize=8, color="#6f675b")  # fmt: skip
        right.step([0, *wrong], np.arange(len(wrong) + 1), where="post", color=COLORS["vermilion"])
        right.set(xlabel="costs at most [deg]", ylabel="wrong answers", xlim=(0, None), ylim=(0, None))
    return figure


def attention(
    pictures: Sequence[NDArray[np.uint8]], maps: Sequence[NDArray[np.float64]], titles: Sequence[str] = ()
) -> BookFigure:
    """Pictures, and under each the same with a map of what counts in it, the largest value in full color.

    Parameters
    ----------
    pictures
        uint8 (n, n, 3).
    maps
        One for each, of any square shape, not negative.
    titles
        One for each, or none.
    """
    if not len(pictures) or len(maps) != len(pictures) or len(titles) not in (0, len(pictures)):
        raise InvalidParameterError(
            f"give at least one picture, one map each and one title each or none; got {len(pictures)}, {len(maps)}, "
            f"{len(titles)}"
        )
    with style():
        figure = BookFigure(figsize=(1.5 * len(pictures), 3.3), layout="constrained")
        axes = figure.subplots(2, len(pictures), squeeze=False)
        for column, (picture, each) in enumerate(zip(pictures, maps, strict=True)):
            for ax in axes[:, column]:
                ax.imshow(picture, extent=(0, 1, 1, 0), interpolation="nearest")
                ax.set(xticks=[], yticks=[])
                ax.spines[:].set_visible(False)
            top = max(float(np.max(each)), 1e-9)
            axes[1, column].imshow(each, cmap=_HEAT, vmin=0, vmax=top, extent=(0, 1, 1, 0), interpolation="bilinear")
            if titles:
                axes[0, column].set_title(titles[column], fontsize=9)
    return figure
