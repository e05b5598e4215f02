"""Figures of a camera that steers by what it sees: centering on the object, and depth from a motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvp_book.plots.drawing import FAINT, bare, colored, plate, styled
from gvp_lib.views.figures import COLORS, BookFigure

__all__ = ["centroid_and_center", "convergence", "depth_errors"]


@styled
def convergence(runs: Mapping[str, ArrayLike]) -> BookFigure:
    """How centering goes: on the left the centroid's way through the image, on the right its error at each look.

    A run is its offsets from the principal point, shape (n, 2), px (``Centering.offsets``). The error is the larger of
    the two coordinates', px, as Algorithm 1 tests it against 2 px.
    """
    ways = {name: np.asarray(offsets, float) for name, offsets in runs.items()}
    figure, (left, right) = plate(8.2, 3.0, 2, width_ratios=(1, 1.5))
    left.axhline(0, color=FAINT, lw=1, zorder=0)
    left.axvline(0, color=FAINT, lw=1, zorder=0)
    right.axhspan(1e-2, 2.0, color=COLORS["green"], alpha=0.13, lw=0)
    right.text(0.99, 1.8, "done", color=COLORS["green"], ha="right", va="top",
               transform=right.get_yaxis_transform())  # fmt: skip
    for (name, way, color), size in zip(colored(ways), cycle((6.0, 5.0, 4.0)), strict=False):
        mark: dict[str, Any] = {"marker": "o", "ms": size, "lw": 1.4, "color": color, "label": name}
        left.plot(*way.T, **mark)
        right.plot(np.arange(1, len(way) + 1), np.maximum(np.abs(way).max(axis=1), 0.05), **mark)
    left.set(xlabel="right of the middle [px]", ylabel="below the middle [px]", aspect="equal")
    left.margins(0.12)
    left.invert_yaxis()
    most = max(len(way) for way in ways.values())
    right.set(xlabel="look", ylabel="error [px]", yscale="log", ylim=(0.04, None), xticks=range(1, most + 1))
    right.legend()
    return figure


@styled
def depth_errors(steps: ArrayLike, errors: Mapping[str, Sequence[ArrayLike]]) -> BookFigure:
    """Errors of depth from motion against the length of the step, m: each trial a dot, mean and spread a bar.

    ``errors``, by condition: for each step the relative errors of its trials.
    """
    lengths = np.asarray(steps, float)
    rng = np.random.default_rng(0)  # of the jitter alone
    figure, (ax,) = plate(8.0, 2.9)
    ax.axhline(0, color=FAINT, lw=1, zorder=0)
    width = 0.8 / len(errors)
    for k, (name, each, color) in enumerate(colored(errors)):
        for i, trials in enumerate(each):
            percent = 100 * np.asarray(trials, float)
            x = i + (k - 0.5 * (len(errors) - 1)) * width
            jitter = rng.uniform(-0.3, 0.3, len(percent)) * width
            ax.plot(x + jitter, percent, "o", ms=2.6, alpha=0.45, color=color, mew=0)
            ax.errorbar(x, percent.mean(), percent.std(), color=COLORS["ink"], fmt="_", ms=9, capsize=4, lw=1.3)
        ax.plot([], [], "o", color=color, label=name)
    ax.set(xlabel="step [mm]", ylabel="error of the depth [%]")
    ax.set_xticks(range(len(lengths)), [f"{1000 * length:.0f}" for length in lengths])
    ax.legend(loc="upper right")
    return figure


@styled
def centroid_and_center(
    images: Sequence[NDArray[np.uint8]],
    centroids: ArrayLike,
    centers: ArrayLike,
    titles: Sequence[str],
    *,
    half: float = 110,
) -> BookFigure:
    """The silhouette's centroid (ring) beside the image of the object's center (cross), pixels (u, v), shape (n, 2)
    each: a picture each, cropped to ``half`` px to all sides of the midpoint of the two.
    """
    found, true = np.asarray(centroids, float), np.asarray(centers, float)
    figure, axes = plate(2.5 * len(images), 2.8, len(images))
    for ax, image, ring, cross, title in zip(axes, images, found, true, titles, strict=True):
        ax.imshow(image)
        u, v = 0.5 * (ring + cross)
        for look in ({"mec": "white", "mew": 4.5, "zorder": 3}, {"mec": COLORS["ink"], "mew": 2.0, "zorder": 4}):
            mark: dict[str, Any] = look
            ax.plot(*cross, "x", ms=12, **mark)
            ax.plot(*ring, "o", ms=11, mfc="none", **mark)
        ax.set(xlim=(u - half, u + half), ylim=(v + half, v - half), title=title)
        bare(ax)
    return figure
