"""Figures of a camera that steers by what it sees: centering on the object, and depth from a motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvp_lib.errors import InvalidParameterError
from gvp_lib.views.figures import COLORS, BookFigure, style

__all__ = ["centroid_and_center", "convergence", "depth_errors"]

_FAINT = "#b9b0a2"
_ORDER = ("blue", "vermilion", "green", "orange", "purple", "sky")


def convergence(runs: Mapping[str, ArrayLike], threshold: float = 2.0) -> BookFigure:
    """How centering goes: on the left the centroid's way through the image, on the right its error at each look.

    Parameters
    ----------
    runs
        By name, the offsets from the principal point at each look, each of shape (n, 2), px (``Centering.offsets``).
    threshold
        px. The error is the larger of the two coordinates', as Algorithm 1 tests it.
    """
    ways = {name: np.asarray(offsets, float) for name, offsets in runs.items()}
    if not ways or any(way.ndim != 2 or way.shape[1] != 2 or not len(way) for way in ways.values()):
        raise InvalidParameterError(
            "give at least one run, each of at least one offset (du, dv), shape (n, 2); "
            f"got { ({name: way.shape for name, way in ways.items()}) }"
        )
    with style():
        figure = BookFigure(figsize=(8.2, 3.0), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1, 1.5))
        for axis in ("h", "v"):
            getattr(left, f"ax{axis}line")(0, color=_FAINT, lw=1, zorder=0)
        right.axhspan(1e-2, threshold, color=COLORS["green"], alpha=0.13, lw=0)
        right.text(0.99, threshold * 0.9, "done", color=COLORS["green"], ha="right", va="top",
                   transform=right.get_yaxis_transform())  # fmt: skip
        for (name, way), color, size in zip(
            ways.items(), _ORDER * len(ways), (6.0, 5.0, 4.0) * len(ways), strict=False
        ):
            mark: dict[str, Any] = {"marker": "o", "ms": size, "lw": 1.4, "color": COLORS[color], "label": name}
            left.plot(*way.T, **mark)
            right.plot(np.arange(1, len(way) + 1), np.maximum(np.abs(way).max(axis=1), 0.05), **mark)
        left.set(xlabel="right of the middle [px]", ylabel="below the middle [px]", aspect="equal")
        left.margins(0.12)
        left.invert_yaxis()
        most = max(len(way) for way in ways.values())
        right.set(xlabel="look", ylabel="error [px]", yscale="log", ylim=(0.04, None), xticks=range(1, most + 1))
        right.legend()
    return figure


def depth_errors(steps: ArrayLike, errors: Mapping[str, Sequence[ArrayLike]]) -> BookFigure:
    """Errors of depth from motion against the length of the step: each trial a dot, mean and spread a bar.

    Parameters
    ----------
    steps
        Lengths of the step, m, shape (n,).
    errors
        By condition, for each step the relative errors of its trials.
    """
    lengths = np.asarray(steps, float)
    if not errors or lengths.ndim != 1 or any(len(each) != len(lengths) for each in errors.values()):
        raise InvalidParameterError(
            f"give for each condition one list of errors per step; got {len(lengths)} steps and "
            f"{ ({name: len(each) for name, each in errors.items()}) } lists"
        )
    rng = np.random.default_rng(0)  # of the jitter alone
    with style():
        figure = BookFigure(figsize=(8.0, 2.9), layout="constrained")
        ax = figure.subplots()
        ax.axhline(0, color=_FAINT, lw=1, zorder=0)
        width = 0.8 / len(errors)
        for k, (name, each) in enumerate(errors.items()):
            color = COLORS[_ORDER[k % len(_ORDER)]]
            for i, trials in enumerate(each):
                percent = 100 * np.asarray(trials, float)
                x = i + (k - 0.5 * (len(errors) - 1)) * width
                ax.plot(x + rng.uniform(-0.3, 0.3, len(percent)) * width, percent, "o", ms=2.6, alpha=0.45,
                        color=color, mew=0)  # fmt: skip
                ax.errorbar(x, percent.mean(), percent.std(), color=COLORS["ink"], fmt="_", ms=9, capsize=4, lw=1.3)
            ax.plot([], [], "o", color=color, label=name)
        ax.set(xlabel="step [mm]", ylabel="error of the depth [%]")
        ax.set_xticks(range(len(lengths)), [f"{1000 * length:.0f}" for length in lengths])
        ax.legend(loc="upper right")
    return figure


def centroid_and_center(
    images: Sequence[NDArray[np.uint8]],
    centroids: ArrayLike,
    centers: ArrayLike,
    titles: Sequence[str],
    *,
    half: float = 110,
) -> BookFigure:
    """The silhouette's centroid (ring) beside the image of the object's center (cross), each in a cropped picture.

    Parameters
    ----------
    centroids, centers
        Pixels (u, v), each of shape (n, 2).
    half
        Half the side of what is shown, px, about the midpoint of the two.
    """
    found, true = np.asarray(centroids, float), np.asarray(centers, float)
    if not len(images) or found.shape != (len(images), 2) or true.shape != found.shape or len(titles) != len(images):
        raise InvalidParameterError(
            "give one centroid, one center and one title for each image; "
            f"got {len(images)} images, shapes {found.shape} and {true.shape}, {len(titles)} titles"
        )
    with style():
        figure = BookFigure(figsize=(2.5 * len(images), 2.8), layout="constrained")
        for ax, image, ring, cross, title in zip(
            figure.subplots(1, len(images), squeeze=False)[0], images, found, true, titles, strict=True
        ):
            ax.imshow(image)
            u, v = 0.5 * (ring + cross)
            halo: dict[str, Any] = {"mec": "white", "mew": 4.5, "zorder": 3}
            ink: dict[str, Any] = {"mec": COLORS["ink"], "mew": 2.0, "zorder": 4}
            for mark in (halo, ink):
                ax.plot(*cross, "x", ms=12, **mark)
                ax.plot(*ring, "o", ms=11, mfc="none", **mark)
            ax.set(xlim=(u - half, u + half), ylim=(v + half, v - half), xticks=[], yticks=[], title=title)
            ax.spines[:].set_visible(False)
    return figure
