"""Figures of what many episodes give: data sets, trainings, comparisons of planners."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.ticker import MaxNLocator

from gvp_lib.checks import checked
from gvp_lib.picture import count
from gvp_lib.planning.plan import Action
from gvp_lib.views.pictures import (
    COLORS,
    RING,
    SERIES,
    WIDTH,
    BookFigure,
    arrow,
    headline,
    legend,
    panels,
    say,
    style,
)

if TYPE_CHECKING:
    from gvp_lib.evaluation.comparison import Comparison
    from gvp_lib.learning.dataset import ViewpointDataset
    from gvp_lib.learning.training import Training

__all__ = ["plot_comparison", "plot_dataset", "plot_training"]


@checked
@style()
def plot_dataset(data: ViewpointDataset, *, n: int = 12) -> BookFigure:
    """Draw a data set's first pictures with their labels; arrows show which way the camera has to move, and how far.

    Parameters
    ----------
    data
        Data set to draw.
    n
        Number of pictures at most.
    """
    shown = min(n, len(data))
    columns = min(4, max(shown, 1))
    rows = max(1, -(-shown // columns))
    width, height = round(1.08 * data.size), round(1.25 * data.size)  # px, of a picture with its label
    canvas = np.full((rows * height, columns * width, 3), 255, np.uint8)
    figure = BookFigure(figsize=(max(1.55 * columns, 3.1), 1.55 * rows * height / width + 0.3), layout="constrained")
    ax = figure.subplots()
    for k in range(shown):
        u, v = width * (k % columns), height * (k // columns) + height - data.size
        canvas[v : v + data.size, u : u + data.size] = data.images[k]
        tilt, middle = data.tilts[k].astype(float), np.array([u, v]) + 0.5 * (data.size - 1)
        tip = middle + 0.9 * data.size * tilt  # a picture's border at some 30 deg
        arrow(ax, middle, tip)
        name = Action(int(data.actions[k])).name.replace("_", " ")
        ax.text(middle[0], v - 0.04 * data.size, f"{name}, {np.degrees(np.hypot(*tilt)):.0f} deg", ha="center", size=8)
    ax.imshow(canvas)
    ax.set_axis_off()
    if not shown:
        say(ax, "empty")
    headline(figure, f"ViewpointDataset: {count(len(data), 'picture')} of {data.size} px, {data.split}", not shown)
    return figure


@checked
@style()
def plot_training(training: Training) -> BookFigure:
    """Draw a training's loss and score by epoch.

    Parameters
    ----------
    training
        The training.
    """
    history = training.history
    score, unit = ("error_deg", "error [deg]") if history and "error_deg" in history[0] else ("accuracy", "accuracy")
    figure, axes, _ = panels(2, 3.3, 2.7)
    epochs = np.arange(1, len(history) + 1)
    for ax, name, label in zip(axes, ("loss", score), ("loss", unit), strict=True):
        for key, text, color in (
            (name, "training", COLORS["orange"]),
            (f"validation_{name}", "validation", COLORS["blue"]),
        ):
            ax.plot(epochs, [line.get(key, np.nan) for line in history], "o-", ms=3.5, color=color, label=text)
        ax.set(xlabel="epoch", ylabel=label)
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
        if history:
            legend(ax, 2)
        else:
            say(ax, "no epoch")
    scores = [line[f"validation_{score}"] for line in history]
    if scores:
        best = int(np.argmax(scores) if score == "accuracy" else np.argmin(scores))
        axes[1].plot(epochs[best], scores[best], "o", **RING)
        known = f", best validation {unit} {scores[best]:.3g} in epoch {epochs[best]}"
    headline(figure, f"Training: {count(len(history), 'epoch')}{known if scores else ''}", bad=not history)
    return figure


@checked
@style()
def plot_comparison(comparison: Comparison) -> BookFigure:
    """Draw the viewpoint errors of planners on the same starts, their means and 95 % intervals.

    Parameters
    ----------
    comparison
        The comparison.
    """
    errors = comparison.errors_deg
    figure = BookFigure(figsize=(WIDTH, 1.4 + 0.55 * len(errors)), layout="constrained")
    ax, names = figure.subplots(), []
    for row, (name, values) in enumerate(errors.items()):
        color, aside = SERIES[row % len(SERIES)], 0.18 * np.sin(2.4 * np.arange(len(values)))
        ax.plot(values, row + aside, "o", ms=4, alpha=0.45, mew=0, color=color)
        summary = comparison.summaries[name]
        ax.plot([summary.interval.low, summary.interval.high], [row, row], color=COLORS["ink"], lw=3)
        ax.plot(summary.mean, row, "D", ms=7, mfc="white", mec=COLORS["ink"], mew=1.5)
        names.append(f"{name}\n{summary.mean:.1f} deg")
    ax.set(xlabel="viewpoint error [deg]", yticks=range(len(errors)), yticklabels=names, xlim=(0, None))
    ax.set_ylim(len(errors) - 0.5, -0.5)
    starts = count(len(next(iter(errors.values()))), "start")
    headline(figure, f"{count(len(errors), 'planner')}, the same {starts}: means, 95 % intervals")
    return figure
