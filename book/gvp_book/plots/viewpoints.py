"""Figures of the image-moment planner: ratios and the polynomials through them, errors, and what was fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike, NDArray

from gvp_book.plots.drawing import DASH, FAINT, bare, colored, plate, styled
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arc import Arc
from gvp_lib.motion.sighting import View
from gvp_lib.planning.plan import Quartic
from gvp_lib.planning.room import is_foreign
from gvp_lib.planning.solids import BOX, CYLINDER, FittedSolid
from gvp_lib.views.figures import COLORS, BookFigure, panels

_ORDER = "orange blue green vermilion purple sky"


@styled
def ratio_fits(
    arcs: Sequence[Arc], quartics: Sequence[Quartic | None], titles: Sequence[str] = (), *, best: Sequence[float] = ()
) -> BookFigure:
    """Plot the ratio of the axes along arcs, its polynomial, and the stationary points (thesis Figs. 2.3, 2.4).

    Each arc has a panel. ``best``, if given, is the fractional number of the sample at which each arc was closest to
    the object's normal.
    """
    n = len(arcs)
    figure, axes, free = panels(n, 4.2 if n == 1 else 2.8, 2.4)
    for k, (ax, arc, quartic) in enumerate(zip(axes, arcs, quartics, strict=True)):
        x = np.arange(len(arc)) if quartic is None else quartic.x
        if best:
            at = np.interp(best[k], np.arange(len(x)), x)
            ax.axvline(at, color=FAINT, lw=1.2, ls=DASH, zorder=0, label="nearest to aligned")
        ax.plot(x, arc.ratios, "o", ms=4, color=COLORS["blue"], label="what was seen")
        if quartic is not None:
            fine = np.linspace(quartic.x[0], quartic.x[-1], 200)
            ax.plot(fine, quartic.polynomial(fine), color=COLORS["orange"], zorder=1, label="the polynomial")
            ring: dict[str, Any] = {"mfc": "white", "mec": COLORS["orange"], "mew": 1.6, "label": "its level spots"}
            ax.plot(quartic.stationary, quartic.polynomial(quartic.stationary), "o", ms=8, **ring)
            chosen = quartic.polynomial(quartic.chosen)
            ax.plot(quartic.chosen, chosen, "o", ms=8, color=COLORS["vermilion"], label="the one it chooses")
        ax.set(title=titles[k] if titles else "", xlabel="sample", ylabel="" if k % 2 else "minor / major")
    if free is not None:
        drawn = {label: line for ax in axes for line, label in zip(*ax.get_legend_handles_labels(), strict=True)}
        free.legend(drawn.values(), drawn.keys(), loc="center")
    return figure


@styled
def outlines(
    rgbs: Sequence[NDArray[np.uint8]],
    views: Sequence[View],
    solid: FittedSolid,
    intrinsics: CameraIntrinsics,
    titles: Sequence[str] = (),
    *,
    crop: int = 300,
) -> BookFigure:
    """Draw the edges of a fitted solid over images, projected from where the arm believes the camera was.

    Each image is cropped to a square of ``crop`` px around its middle.
    """
    edges = _edges(solid)
    half = crop // 2
    cu, cv = (round(c) for c in intrinsics.principal_point)
    figure, axes = plate(2.3 * len(rgbs), 2.6, len(rgbs))
    for ax, rgb, view, title in zip(axes, rgbs, views, titles or [""] * len(rgbs), strict=True):
        ax.imshow(rgb)
        _draw(ax, edges, view, intrinsics)
        ax.set(xlim=(cu - half, cu + half), ylim=(cv + half, cv - half), title=title)
        bare(ax)
    return figure


@styled
def hidden(
    rgbs: Sequence[NDArray[np.uint8]],
    views: Sequence[View],
    solids: Mapping[str, FittedSolid],
    intrinsics: CameraIntrinsics,
    *,
    crop: int = 260,
) -> BookFigure:
    """Draw the edges of several solids fitted to the same views over images of them, a row each, and in all what the
    outlines say: points that are the object's own, blue, and those at which something else cuts it off, white.
    """
    foreign = is_foreign(np.array([view.outline.colors for view in views if view.outline is not None]))
    figure, axes = plate(2.3 * len(rgbs), 2.5 * len(solids), len(rgbs), len(solids))
    for row, (name, solid) in enumerate(solids.items()):
        for column, (rgb, view) in enumerate(zip(rgbs, views, strict=True)):
            ax, edges = axes[row * len(rgbs) + column], _edges(solid)
            ax.imshow(rgb)
            _draw(ax, edges, view, intrinsics)
            assert view.outline is not None
            for which, face in ((~foreign[column], COLORS["sky"]), (foreign[column], "white")):
                ax.plot(*view.outline.points[which].T, "o", ms=3.2, mfc=face, mec=COLORS["ink"], mew=0.6, ls="")
            (u, v), half = view.blob.centroid, crop / 2
            ax.set(xlim=(u - half, u + half), ylim=(v + half, v - half), title=name if column == 0 else "")
            bare(ax)
    return figure


def _draw(ax: Axes, edges: NDArray[np.float64], view: View, intrinsics: CameraIntrinsics) -> None:
    """Edges (e, 2, 3), m, base frame, as a view has them."""
    pixels = intrinsics.project(view.base_from_camera.inv().apply(edges.reshape(-1, 3))).reshape(-1, 2, 2)
    for edge in pixels:
        ax.plot(*edge.T, color="white", lw=2.6, alpha=0.7, solid_capstyle="round")
        ax.plot(*edge.T, color=COLORS["vermilion"], lw=1.2, solid_capstyle="round")


def _edges(solid: FittedSolid) -> NDArray[np.float64]:
    """Edges of the solid in the base frame, shape (e, 2, 3), m; every fourth of those along a can."""
    shape = BOX if solid.kind == "box" else CYLINDER
    corners = shape.vertices(np.array([*solid.sizes, *solid.top])) - (0.0, 0.0, 0.5 * solid.top[1])
    edges, n = shape.edges, len(shape.ring)
    if shape.round:
        along = np.arange(3 * n, 5 * n)
        edges = np.concatenate([edges[: 3 * n], edges[along[along % 6 == 0]]])
    segments: NDArray[np.float64] = solid.base_from_solid.apply(corners)[edges]
    long_enough = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1) > 1e-4
    return segments[long_enough]


@styled
def error_strips(
    groups: Mapping[str, Mapping[str, ArrayLike]], *, reference: Mapping[str, float] | None = None, label: str = ""
) -> BookFigure:
    """Plot all errors by case and method, deg, as dots on a logarithmic scale, with their mean as a bar.

    ``reference``, by case, is a value to mark, such as the thesis's mean; ``label`` is its name.
    """
    methods = dict.fromkeys(name for group in groups.values() for name in group)
    rng = np.random.default_rng(0)  # for the dots' spread across the row, which means nothing
    figure, (ax,) = plate(7.6, 0.5 + 0.26 * len(groups) * len(methods) + 0.5)
    for row, (case, group) in enumerate(groups.items()):
        for k, (name, _, color) in enumerate(colored(methods, _ORDER)):
            if name not in group:
                continue
            errors = np.maximum(np.asarray(group[name], float), 0.01)
            y = row + 0.72 * ((k + 0.5) / len(methods) - 0.5)
            ax.plot(errors, y + rng.uniform(-0.08, 0.08, len(errors)), ".", ms=3.5, alpha=0.45, color=color)
            ax.plot(errors.mean(), y, "|", ms=15, mew=2.6, color=color, label=name if row == 0 else None)
        if reference and case in reference:
            text = label if row == 0 else None
            ax.plot(reference[case], row, "D", ms=6, mfc="white", mec=COLORS["ink"], label=text, zorder=5)
    ax.set(xscale="log", xlabel="final error [deg]", yticks=range(len(groups)), yticklabels=list(groups))
    ax.set_xticks([0.1, 1, 10], ["0.1", "1", "10"])
    ax.invert_yaxis()
    ax.grid(axis="x")
    ax.set_axisbelow(True)
    figure.legend(loc="outside upper center", ncols=len(methods) + 1)
    return figure


@styled
def grouped_bars(
    labels: Sequence[str], series: Mapping[str, Sequence[float]], ylabel: str = "mean error [deg]"
) -> BookFigure:
    """Plot grouped bars, one per series at each label, with their values written on them; NaN leaves a bar out."""
    width = 0.84 / len(series)
    figure, (ax,) = plate(8.2, 2.9)
    for k, (name, values, color) in enumerate(colored(series, _ORDER)):
        x = np.arange(len(labels)) + (k - (len(series) - 1) / 2) * width
        bars = ax.bar(x, values, 0.92 * width, color=color, label=name)
        ax.bar_label(bars, [f"{v:.1f}" if np.isfinite(v) else "" for v in values], fontsize=7.5, padding=1)
    ax.set(xticks=range(len(labels)), xticklabels=list(labels), ylabel=ylabel)
    figure.legend(ncols=len(series), loc="outside upper center")
    ax.margins(y=0.1)
    return figure


@styled
def certainty(counts: ArrayLike, errors: ArrayLike, deviations: ArrayLike) -> BookFigure:
    """Plot how the true error and the estimator's standard deviation, shape (n,) each, deg, fall as views come in."""
    figure, (ax,) = plate(6.4, 2.8)
    ax.fill_between(counts, 0, np.asarray(deviations, float), color=COLORS["sky"], alpha=0.35, lw=0)
    ax.plot(counts, deviations, color=COLORS["blue"], lw=1.2, label="stated standard deviation")
    ax.plot(counts, errors, "o-", ms=4, color=COLORS["vermilion"], label="true error")
    ax.set(xlabel="views so far", ylabel="deg", ylim=(0, None))
    ax.legend()
    return figure
