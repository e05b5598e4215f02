"""Figures of a set of labeled viewpoints: what it holds, where each label wins, how sure a label is, what is off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import matplotlib.colors
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyArrowPatch, Rectangle
from matplotlib.patheffects import Normal, withStroke
from numpy.typing import ArrayLike, NDArray

from gvp_book.plots.drawing import DASH, FAINT, GRAY, RING, bare, colored, plate, styled
from gvp_lib.planning.plan import Action
from gvp_lib.views.figures import COLORS, BookFigure

ACTION_COLORS: Mapping[Action, str] = {
    Action.UP: COLORS["blue"],
    Action.LEFT: COLORS["orange"],
    Action.DOWN: COLORS["sky"],
    Action.RIGHT: COLORS["vermilion"],
    Action.NO_OP: COLORS["green"],
}
"""One for each action, the same in every figure."""

_ORDER = "orange blue green vermilion purple sky"


@styled
def labeled_view(rgb: NDArray[np.uint8], errors: ArrayLike) -> BookFigure:
    """Draw a square RGB image with the five actions and the viewpoint error that each leads to.

    Errors have shape (5,), deg. The smallest is drawn in full color.
    """
    angles = np.asarray(errors, float)
    best = Action(int(np.argmin(angles)))
    figure, (ax,) = plate(3.7, 3.5)
    ax.imshow(rgb, extent=(-0.5, 0.5, 0.5, -0.5), interpolation="nearest" if len(rgb) < 100 else "antialiased")
    ax.set(xlim=(-0.95, 0.95), ylim=(0.85, -0.85))
    bare(ax)
    for action, angle in zip(Action, angles, strict=True):
        _arrow(ax, 0.0, 0.0, 0.4, action, faint=action is not best)
        u, v = action.direction
        text = f"{action.name.replace('_', ' ')}\n{angle:.2f}°"
        where = (0.72 * u, 0.66 * v) if (u or v) else (0.72, 0.66)
        weight = "bold" if action is best else "normal"
        ax.text(*where, text, ha="center", va="center", weight=weight, color=ACTION_COLORS[action], fontsize=9.5)
    return figure


@styled
def mosaic(
    pictures: Sequence[NDArray[np.uint8]], actions: Sequence[int] = (), *, columns: int = 12, size: float = 0.68
) -> BookFigure:
    """Draw images of a data set side by side, ``size`` inches each.

    With ``actions``, each image shows its own as an arrow, or NO_OP as a ring.
    """
    named = [Action(int(action)) for action in actions]  # by position: a table's column has an index of its own
    columns = min(columns, len(pictures))
    rows = -(-len(pictures) // columns)
    gap = 0.05
    figure = BookFigure(figsize=(size * columns, size * rows))
    ax = figure.add_axes((0, 0, 1, 1))
    ax.set_aspect("equal")
    ax.set_axis_off()
    for k, rgb in enumerate(pictures):
        x, y = k % columns, k // columns
        ax.imshow(rgb, extent=(x, x + 1 - gap, y + 1 - gap, y), interpolation="antialiased")
        if named:
            middle = 0.5 * (1 - gap)
            _arrow(ax, x + middle, y + middle, 0.36, named[k])
    ax.set(xlim=(-gap, columns), ylim=(rows, -gap))
    return figure


def _arrow(ax: Axes, x: float, y: float, length: float, action: Action, *, faint: bool = False) -> None:
    """An action, from a point onward, in an image's axes; what is faint is a dash without a head."""
    color = ACTION_COLORS[action]
    u, v = action.direction
    start, end = (x + 0.34 * length * u, y + 0.34 * length * v), (x + length * u, y + length * v)
    if action is Action.NO_OP:
        for edge, width in (("white", 3.6), (color, 1.8)):
            ring = Circle((x, y), 0.3 * length, fill=False, ec=edge, lw=width, alpha=0.55 if faint else 1, zorder=4)
            ax.add_patch(ring)
    elif faint:
        ax.plot(*zip(start, end, strict=True), color=color, lw=1.6, alpha=0.75, solid_capstyle="round", zorder=4)
    else:
        arrow = FancyArrowPatch(
            start, end, arrowstyle="-|>,head_length=0.5,head_width=0.28", mutation_scale=8, shrinkA=0, shrinkB=0,
            lw=1.9, color=color, joinstyle="miter", zorder=5,
            path_effects=[withStroke(linewidth=4.4, foreground="white"), Normal()],
        )  # fmt: skip
        ax.add_patch(arrow)


@styled
def label_maps(maps: Mapping[str, NDArray[np.int64]]) -> BookFigure:
    """Map the best action over the cap, seen from above its pole, one panel per map.

    The tilt is the distance from the middle. A map, by its title, is a square grid of action numbers, -1 for none, over
    -30 to +30 deg in both directions; the first row is at the smallest y, the first column at the smallest x.
    """
    shades = mpl.colors.ListedColormap([*ACTION_COLORS.values()])
    edge = 30  # deg
    figure, axes = plate(2.9 * len(maps), 3.3, len(maps))
    for ax, (title, each) in zip(axes, maps.items(), strict=True):
        grid = np.asarray(each, int)
        look: dict[str, Any] = {"origin": "lower", "extent": (-edge, edge, -edge, edge), "interpolation": "nearest"}
        shown = np.ma.masked_less(grid, 0)
        image = ax.imshow(shown, cmap=shades, vmin=-0.5, vmax=len(Action) - 0.5, alpha=0.85, **look)
        image.set_clip_path(Circle((0, 0), edge, transform=ax.transData))
        at = np.linspace(-edge, edge, len(grid))
        for action in Action:
            rows, columns = np.nonzero(grid == action)
            if action is Action.NO_OP or not len(rows):
                continue
            where = (at[columns].mean(), at[rows].mean())
            if np.hypot(*where) < 0.3 * edge:  # it wins all around
                where = (0.0, 0.55 * edge)
            ax.text(*where, action.name, ha="center", va="center", color="white", weight="bold", fontsize=10)
        ax.plot(0, 0, ".", ms=3, color="white")
        for ring in (10, 20):
            ax.add_patch(Circle((0, 0), ring, fill=False, ec="white", lw=0.7, alpha=0.7))
            if ax is axes[0]:
                ax.text(0, -ring, f"{ring}°", color="white", fontsize=8, ha="center", va="bottom")
        ax.set(title=title, xlim=(-1.02 * edge, 1.02 * edge), ylim=(-1.02 * edge, 1.02 * edge))
        bare(ax)
    return figure


@styled
def agreement(
    degrees: ArrayLike, same: Mapping[str, ArrayLike], cost: Mapping[str, ArrayLike], *, low: float = 70
) -> BookFigure:
    """Plot how often an imprecise judge agrees with the label, and what its other answers cost, by the judge's error.

    Errors are in deg, shape (n,). By data set: the share of samples with the ``same`` label, and the mean ``cost`` in
    reward, deg, shape (n,) each. The axis of the shares begins at ``low`` percent.
    """
    figure, (left, right) = plate(8.2, 2.9, 2)
    for name, share, color in colored(same, _ORDER):
        left.plot(degrees, 100 * np.asarray(share, float), "o-", ms=4, color=color, label=name)
        right.plot(degrees, np.asarray(cost[name], float), "o-", ms=4, color=color)
    left.axhline(100, color=FAINT, lw=1, ls=DASH, zorder=0)
    left.set(ylabel="same label [%]", ylim=(low, 101.5), xlabel="the judge's error [deg]")
    right.set(ylabel="reward lost, on average [deg]", ylim=(0, None), xlabel="the judge's error [deg]")
    left.legend(loc="lower left")
    return figure


@styled
def off_center(
    panels: Mapping[str, Mapping[str, ArrayLike]], *, shift: float | None = None, extent: float = 24.0
) -> BookFigure:
    """Plot how far silhouettes' centroids and objects' centers are from the middle of the image, one panel per case.

    A panel has, by name, offsets (u, v) from the middle, shape (n, 2), px. ``extent`` is half its side, px, and
    ``shift`` half the side of a square to mark, px: the range of the random shifts.
    """
    figure, axes = plate(2.75 * len(panels), 3.5, len(panels), sharey=True)
    for ax, (title, each) in zip(axes, panels.items(), strict=True):
        ax.axhline(0, color=RING, lw=0.8, zorder=0)
        ax.axvline(0, color=RING, lw=0.8, zorder=0)
        if shift is not None:
            ax.add_patch(Rectangle((-shift, -shift), 2 * shift, 2 * shift, fill=False, ec=FAINT, lw=1.2, ls=DASH))
        for name, offsets, color in colored(each, _ORDER):
            ax.plot(*np.reshape(offsets, (-1, 2)).T, "o", ms=3.2, alpha=0.7, color=color, label=name)
        ax.set(title=title, xlabel="u [px]", xlim=(-extent, extent), ylim=(extent, -extent), aspect="equal")
    axes[0].set_ylabel("v [px]")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


@styled
def replacements(asked: ArrayLike, taken: ArrayLike, replaced: ArrayLike) -> BookFigure:
    """Plot which viewpoints of the cap were used as requested, and which were replaced.

    ``asked`` and ``taken`` begin with the tilt and azimuth of each viewpoint, shape (n, 2 or more), rad; ``replaced``,
    shape (n,), says whether it is another.
    """
    other = np.asarray(replaced, bool)
    a, b = (
        np.degrees(tilt) * np.stack([np.cos(azimuth), np.sin(azimuth)])  # seen from above, deg
        for tilt, azimuth in (np.asarray(each, float).T[:2] for each in (asked, taken))
    )
    around = np.linspace(0, 2 * np.pi, 121)
    figure, (ax,) = plate(5.4, 4.2)
    for ring in (10, 20, 30):
        ax.plot(ring * np.cos(around), ring * np.sin(around), color=RING, lw=0.9, zorder=0)
        ax.text(0, -ring, f"{ring}°", ha="center", va="center", fontsize=8, color=GRAY, zorder=3,
                bbox={"fc": "white", "ec": "none", "pad": 0.6})  # fmt: skip
    ax.plot(*b[:, ~other], "o", ms=2.8, color=COLORS["sky"], label="taken up as asked")
    ax.plot(*np.stack([a[:, other], b[:, other]]).transpose(1, 0, 2), color=FAINT, lw=0.7, zorder=1)
    ax.plot(*a[:, other], "x", ms=6, mew=1.7, color=COLORS["vermilion"], label="out of reach")
    ax.plot(*b[:, other], "o", ms=4.5, color=COLORS["blue"], label="taken up instead")
    ax.annotate("away from\nthe robot", (36, 0), (42, 0), va="center", fontsize=8.5, color=GRAY,
                arrowprops={"arrowstyle": "<-", "color": GRAY})  # fmt: skip
    ax.set(aspect="equal", xlim=(-33, 58))
    ax.set_axis_off()
    figure.legend(loc="outside lower center", ncols=3)
    return figure
