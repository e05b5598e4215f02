"""Figures of a camera that steers by what it sees, and of its way over the virtual sphere: centering, depth from a
motion, the radius, arcs and their ends, viewpoints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from gvp_book.plots.drawing import DASH, FAINT, GRAY, RING, bare, colored, plate, styled
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.motion.arc import Arc
from gvp_lib.motion.arm import Outcome
from gvp_lib.views.figures import COLORS, BookFigure, panels


@styled
def convergence(runs: Mapping[str, ArrayLike]) -> BookFigure:
    """Plot how centering converges: on the left, the centroid's path through the image; on the right, its error.

    A run is its offsets from the principal point, shape (n, 2), px (``Adjustment.errors``). The error is the larger of
    the two coordinates, px, which Algorithm 1 compares with 2 px.
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
    """Plot the error of depth from motion by the length of the step, m: trials as dots, mean and spread as a bar.

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
    """Mark the silhouette's centroid (ring) and the projection of the object's center (cross) in each image.

    Both are pixels (u, v), shape (n, 2). Each image is cropped to ``half`` px on all sides of their midpoint.
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


_END_COLORS = {  # as the legend has them
    Outcome.JOINT_LIMIT: COLORS["orange"],
    Outcome.COLLISION: COLORS["vermilion"],
    Outcome.UNREACHABLE: COLORS["blue"],
    Outcome.CONTACT: COLORS["ink"],
    Outcome.STALLED: COLORS["ink"],
    Outcome.TARGET_LOST: COLORS["purple"],
    Outcome.NOT_CENTERED: COLORS["purple"],
    Outcome.MAX_ANGLE: FAINT,
    Outcome.ENOUGH: FAINT,
}


@styled
def range_history(ranges: Mapping[str, ArrayLike], radius: float, predicted: ArrayLike | None = None) -> BookFigure:
    """Plot the true distance to the object along a traversal, m, at the start and after each step.

    Beside it are the sphere's ``radius``, m, and the distance ``predicted`` for a camera that never corrects, m.
    """
    figure, (ax,) = plate(7.0, 2.9)
    ax.axhline(1000 * radius, color=FAINT, lw=1, ls=DASH, zorder=0)
    if predicted is not None:
        there = 1000 * np.asarray(predicted, float)
        ax.plot(there, color=RING, lw=6, label="predicted", solid_capstyle="round")
    for name, each, color in colored(ranges):
        ax.plot(1000 * np.asarray(each, float), "o-", ms=4, lw=1.2, color=color, label=name)
    ax.set(xlabel="step", ylabel="distance to the object [mm]")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.legend(loc="upper left")
    return figure


@styled
def measured_and_true_range(arcs: Mapping[str, Arc], centers: Mapping[str, ArrayLike]) -> BookFigure:
    """Plot the range measured along arcs (A.1) beside the true distance to the object's center, m.

    Base frame; one panel per object, by name.
    """
    figure, axes = plate(8.4, 2.8, len(arcs), sharey=True)
    for ax, (name, arc) in zip(axes, arcs.items(), strict=True):
        degrees = np.degrees(arc.angles)
        positions = np.array([view.base_from_camera.translation for view in arc.views])
        true = np.linalg.norm(positions - np.asarray(centers[name], float), axis=1)
        ax.plot(degrees, 1000 * true, color=FAINT, lw=4, label="true, to the center")
        ax.plot(degrees, 1000 * arc.ranges, "o-", ms=4, lw=1.2, color=COLORS["vermilion"], label="measured")
        ax.set(xlabel="angle along the arc [deg]", title=name)
    axes[0].set_ylabel("range [mm]")
    axes[0].legend()
    return figure


@styled
def arc_extents(arcs: Mapping[str, Sequence[Arc]]) -> BookFigure:
    """Plot how far arcs reached on either side of their start, and what ended them: a bar per arc, a panel per name.

    A side that could not take a single step has its mark at zero. Gray marks reached the requested angle.
    """
    most = max(len(each) for each in arcs.values())
    figure, axes, free = panels(len(arcs), 2.9, 0.9 + 0.19 * most, sharey=True, sharex=True)
    for ax, (name, each) in zip(axes, arcs.items(), strict=True):
        ax.axvline(0, color=FAINT, lw=1, ls=DASH, zorder=0)
        for row, arc in enumerate(each):
            angles = np.degrees(arc.angles) if len(arc) else np.zeros(1)
            ax.plot(angles[[0, -1]], [row, row], color=RING, lw=5, solid_capstyle="butt", zorder=1)
            for angle, end in zip(angles[[0, -1]], arc.ends, strict=True):
                ax.plot(angle, row, "o", ms=6, color=_END_COLORS[end], zorder=2)
        ax.set(xlabel="angle swept [deg]", title=name)
    for ax in axes[::2]:
        ax.set_ylabel("trial")
    axes[0].set(yticks=range(most), yticklabels=range(1, most + 1))
    axes[0].invert_yaxis()
    seen = {end for each in arcs.values() for arc in each for end in arc.ends}
    handles = [Line2D([], [], marker="o", ls="", ms=6, color=_END_COLORS[end], label=end.value)
               for end in _END_COLORS if end in seen]  # fmt: skip
    if free is None:
        figure.legend(handles=handles, loc="outside lower center", ncols=2)
    else:
        free.legend(handles=handles, loc="center", title="ended by")
    return figure


@styled
def viewpoint_map(sphere: VirtualSphere, viewpoints: Mapping[str, RigidTransform]) -> BookFigure:
    """Plot sets of viewpoints from above the sphere's pole, one panel per set, with tilt as distance from the middle.

    Tilts are in degrees. The short line at each point is the camera's x axis, laid flat: its roll.
    """
    # At the pole the camera's axes are the pole's own y and x, and it looks along -z.
    world_from_pole = sphere.viewpoint(0.0, 0.0).rotation.as_matrix()[:, [1, 0, 2]] * (1, 1, -1)
    around = np.linspace(0, 2 * np.pi, 97)
    figure, axes, free = panels(len(viewpoints), 2.9, 3.1, sharex=True, sharey=True)
    for ax, (name, poses) in zip(axes, viewpoints.items(), strict=True):
        outward = (np.reshape(poses.translation, (-1, 3)) - sphere.center) @ world_from_pole
        tilt = np.degrees(np.arctan2(np.hypot(outward[:, 0], outward[:, 1]), outward[:, 2]))
        azimuth = np.arctan2(outward[:, 1], outward[:, 0])
        x, y = tilt * np.cos(azimuth), tilt * np.sin(azimuth)
        roll = (np.reshape(poses.rotation.as_matrix(), (-1, 3, 3))[:, :, 0] @ world_from_pole)[:, :2].T
        for ring in (10, 20, 30):
            ax.plot(ring * np.cos(around), ring * np.sin(around), color=RING, lw=0.9, zorder=0)
            ax.text(0, ring, f"{ring}°", ha="center", va="center", fontsize=9, color=GRAY,
                    bbox={"fc": "white", "ec": "none", "pad": 0.6}, zorder=3)  # fmt: skip
        ends = np.array([[x, y], [x + 1.6 * roll[0], y + 1.6 * roll[1]]]).transpose(2, 0, 1)  # (n, 2, 2)
        # As one artist: hundreds of them would take most of the figure's time.
        ax.add_collection(LineCollection(list(ends), colors=COLORS["vermilion"], linewidths=0.9))
        ax.plot(x, y, "o", ms=2.6, color=COLORS["blue"])
        ax.set(title=name, aspect="equal")
        ax.set_axis_off()
    if free is not None:
        marks = [Line2D([], [], marker="o", ls="", ms=4, color=COLORS["blue"], label="a viewpoint"),
                 Line2D([], [], color=COLORS["vermilion"], lw=1.4, label="its camera's x axis")]  # fmt: skip
        free.legend(handles=marks, loc="center")
    return figure
