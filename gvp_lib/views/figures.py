"""Figures of everything in the library that can be seen: ``plan.plot()`` calls :func:`plot_plan`, and so on.

Every function returns a matplotlib ``Figure``; none shows one or changes global settings. What an object did not keep,
such as pictures, its figure does without. Here are curves, maps and wireframes of a planner's work; the rest, and the
style of them all, comes from the modules beside this one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull
from scipy.spatial.transform import RigidTransform

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.calibration import Calibration
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.motion.arc import Arc
from gvp_lib.motion.arm import Outcome
from gvp_lib.motion.sighting import View
from gvp_lib.picture import count
from gvp_lib.planning.grasp import Grasp
from gvp_lib.planning.picking import PickUp
from gvp_lib.planning.plan import Action, Optimum, Plan, Quartic, sd_text
from gvp_lib.planning.solids import BOX, CYLINDER, FittedSolid
from gvp_lib.views.desk import plot_photographs
from gvp_lib.views.experiments import plot_comparison, plot_dataset, plot_training
from gvp_lib.views.pictures import (
    BAD,
    COLORS,
    DARK,
    FAINT,
    RING,
    SERIES,
    STYLE,
    WIDTH,
    BookFigure,
    arrow,
    draw_blob,
    draw_on_picture,
    gallery,
    headline,
    hsv_histograms,
    legend,
    panels,
    pipeline,
    plot_arm,
    plot_blob,
    plot_object,
    plot_view,
    plot_work_cell,
    say,
    show_images,
    style,
)
from gvp_lib.views.sliders import ThresholdSliders

__all__ = [
    "COLORS",
    "STYLE",
    "BookFigure",
    "ThresholdSliders",
    "draw_blob",
    "gallery",
    "hsv_histograms",
    "panels",
    "pipeline",
    "plot_arc",
    "plot_arm",
    "plot_blob",
    "plot_calibration",
    "plot_comparison",
    "plot_dataset",
    "plot_grasp",
    "plot_object",
    "plot_optimum",
    "plot_photographs",
    "plot_pick_up",
    "plot_plan",
    "plot_quartic",
    "plot_solid",
    "plot_sphere",
    "plot_training",
    "plot_view",
    "plot_work_cell",
    "ratio_curve",
    "show_images",
    "style",
]

_EYE = np.radians(-50.0), np.radians(24.0)  # azimuth and elevation from which a wireframe is seen


# --- arcs and what is fitted to them ----------------------------------------------------------------------------------


@checked
@style()
def ratio_curve(tilts_deg: ArrayLike, ratios: ArrayLike, chosen: int | None = None) -> BookFigure:
    """Draw the ratio of a blob's axes along an arc over the object (thesis Figs. 2.3, 2.4).

    Parameters
    ----------
    tilts_deg
        Tilts of the camera from the object's normal, shape (n,), degrees.
    ratios
        Minor axis over major axis in each view, shape (n,).
    chosen
        Index of the view to mark.

    Examples
    --------
    >>> len(ratio_curve([-20, 0, 20], [0.6, 0.5, 0.6], chosen=1).axes)
    1
    """
    x, y = np.asarray(tilts_deg, float), np.asarray(ratios, float)
    if x.ndim != 1 or x.shape != y.shape:
        raise InvalidParameterError(f"give one ratio for each tilt, both of shape (n,); got {x.shape} and {y.shape}")
    figure = BookFigure(figsize=(WIDTH, 2.8), layout="constrained")
    ax = figure.subplots()
    _zero_line(ax)
    ax.plot(x, y, "o-", ms=4)
    if chosen is not None:
        if not 0 <= chosen < len(x):
            raise InvalidParameterError(f"chosen is the number of one of {len(x)} tilts, from 0; got {chosen}")
        ax.plot(x[chosen], y[chosen], "o", **RING)
    ax.set(xlabel="tilt from the object's normal [deg]", ylabel="minor axis / major axis")
    return figure


@checked
@style()
def plot_arc(arc: Arc) -> BookFigure:
    """Draw the ratio of the blob's axes over the angle along an arc, and why it ended on either side.

    Parameters
    ----------
    arc
        The arc.
    """
    figure = BookFigure(figsize=(WIDTH, 2.9), layout="constrained")
    ax = figure.subplots()
    _draw_ratios(ax, [arc])
    span = f" over {np.degrees(np.ptp(arc.angles)):.0f} deg" if arc.views else ""
    what = "Views from all over the sphere" if arc.axis is None else f"Arc along the camera's {arc.axis}"
    headline(figure, f"{what}: {count(len(arc), 'view')}{span}", bad=not arc.views)
    low, high = ax.get_ylim()
    ax.set_ylim(low - 0.12 * (high - low), high)  # room for words
    for x, align, end in zip((0.01, 0.99), ("left", "right"), arc.ends, strict=True):
        ax.text(x, 0.02, f"end: {end.value}", transform=ax.transAxes, ha=align, color=DARK, fontsize=8.5)
    return figure


@checked
@style()
def plot_quartic(quartic: Quartic, *, ratios: ArrayLike | None = None) -> BookFigure:
    """Draw a quartic, its stationary points and the one chosen.

    Parameters
    ----------
    quartic
        The fit of an arc's ratios.
    ratios
        The ratios that it was fitted to, shape (n,), such as ``arc.ratios``; by default only where they were taken.
    """
    figure = BookFigure(figsize=(WIDTH, 2.9), layout="constrained")
    where = _draw_quartic(figure.subplots(), quartic, ratios)
    found = count(len(quartic.stationary), "stationary point")
    headline(figure, f"Quartic: {found}; {where}", not len(quartic.stationary))
    return figure


def _draw_quartic(ax: Axes, quartic: Quartic, ratios: ArrayLike | None = None) -> str:
    """Draw a quartic, and say where its chosen point is."""
    at = quartic.x
    numbered = np.array_equal(at, np.arange(len(at)))
    scale, unit = (1.0, "number of the view") if numbered else (np.degrees(1.0), "angle from the center [deg]")
    if ratios is None:
        ax.plot(scale * at, np.zeros(len(at)), "|", color=DARK, ms=9, transform=ax.get_xaxis_transform(), clip_on=False)
    else:
        if np.shape(ratios) != at.shape:
            raise InvalidParameterError(f"give one ratio for each view, shape {at.shape}; got {np.shape(ratios)}")
        ax.plot(scale * at, np.asarray(ratios, float), "o", ms=4, color=COLORS["blue"], label="views")
    x = np.linspace(at[0], at[-1], 200)
    ax.plot(scale * x, quartic.polynomial(x), color=COLORS["blue"], label="quartic")
    stationary = quartic.stationary
    ax.plot(scale * stationary, quartic.polynomial(stationary), "D", color=COLORS["orange"], label="stationary point")
    ax.plot(scale * quartic.chosen, quartic.polynomial(quartic.chosen), "o", **RING, label="chosen")
    ax.set(xlabel=unit, ylabel="minor axis / major axis")
    ax.margins(y=0.15)
    legend(ax, 4)
    place = f"view {quartic.chosen:.1f}" if numbered else f"{np.degrees(quartic.chosen):.1f} deg"
    return f"{'chosen' if len(stationary) else 'stays at'} {place}"


@checked
@style()
def plot_solid(solid: FittedSolid) -> BookFigure:
    """Draw a fitted solid as a wireframe with its sizes and its normal, the base's z upward.

    Parameters
    ----------
    solid
        The solid.
    """
    figure = BookFigure(figsize=(4.6, 3.6), layout="constrained")
    ax = figure.subplots()
    _draw_solid(ax, solid)
    sizes = " x ".join(f"{1000 * length:.0f}" for length in solid.lengths[1 if solid.kind == "cylinder" else 0 :])
    tilt = np.degrees(np.arccos(np.clip(solid.normal[2], -1, 1)))
    sd = f" (sd {np.degrees(solid.uncertainty):.1f})" if np.isfinite(solid.uncertainty) and solid.explains else ""
    title = f"{solid.kind.capitalize()}, {sizes} mm, normal {tilt:.0f} deg off the vertical{sd}"
    if not solid.explains:
        title += f"\ndoes not explain the views: residual {solid.residual:.2f} px, at most {solid.explained:.2f}"
    headline(figure, title, bad=not solid.explains)
    return figure


def _draw_solid(ax: Axes, solid: FittedSolid) -> None:
    shape = BOX if solid.kind == "box" else CYLINDER
    shape = shape if solid.top[1] > 0 else shape.plain
    own = 1000 * shape.vertices(np.array([*solid.sizes, *solid.top]))  # (v, 3), mm
    rotation = solid.base_from_solid.rotation.as_matrix()
    points = _seen(own @ rotation.T)  # (v, 2)
    a, b, c, d = points[shape.faces.T]
    across, along = c - a, d - b
    facing = across[:, 0] * along[:, 1] > across[:, 1] * along[:, 0]  # counterclockwise as seen
    left, right = facing[shape.neighbors].T  # (e,) each
    outline = left != right
    # On a round side only the outline shows of the edges that run upward.
    upward = np.abs(np.diff(own[shape.edges], axis=1)[:, 0, 2]) > 1e-9
    drawn = outline | ~(upward & shape.round)
    for chosen, line in ((drawn & (left | right), "-"), (drawn & ~(left | right), ":")):
        ax.add_collection(LineCollection(list(points[shape.edges[chosen]]), colors=COLORS["blue"], ls=line, lw=1.6))
    hull = ConvexHull(points).vertices
    ax.fill(*points[hull].T, color=COLORS["sky"], alpha=0.25, lw=0)
    foot = _seen(500 * solid.height * solid.normal)
    tip = _seen(500 * solid.height * solid.normal + 0.7 * np.ptp(own, axis=0).max() * solid.normal)
    ax.update_datalim([tip])
    arrow(ax, foot, tip)
    ax.annotate("normal", (tip[0], tip[1]), (6, 0), textcoords="offset points", color=BAD, va="center")
    # Each length along an edge of the outline that runs its way: the lowest, or for the height the rightmost, unless
    # another word stands there.
    room = np.ptp(np.vstack([points, tip]), axis=0).max() * np.array([0.4 if shape.round else 0.24, 0.14])  # of a word
    aside = np.array([0.5 * room[0], 0.0])
    taken = [tip + aside]
    run = np.abs(np.diff(own[shape.edges], axis=1)[:, 0])  # (e, 3)
    way = np.where((run > 1e-9).all(axis=1), -1, np.argmax(run, axis=1))  # (e,); slanted ones, below a top, run none
    for axis, length in enumerate(1000 * solid.lengths):
        ends = points[shape.edges[outline & (way == axis)]]
        if not len(ends) or (shape.round and axis == 0):
            continue
        middles = ends.mean(axis=1)
        middles = middles[np.argsort(middles[:, 1] - (middles[:, 0] if axis == 2 else 0))]
        words = middles + np.where(middles[:, :1] > 0, aside, -aside)
        free = [n for n, word in enumerate(words) if (np.abs(word - taken) > room).any(axis=1).all()] or [0]
        at = middles[free[0]]
        taken.append(words[free[0]])
        name = f"{length:.0f} mm across" if shape.round and axis == 1 else f"{length:.0f} mm"
        out = 9 * at / np.linalg.norm(at)  # points; the solid's center is the origin
        sides: dict[str, Any] = {"ha": "left" if out[0] > 0 else "right", "va": "top" if out[1] < -3 else "center"}
        ax.annotate(name, (at[0], at[1]), (out[0], out[1]), textcoords="offset points", **sides)
    ax.set(aspect="equal")
    ax.margins(0.22)
    ax.set_axis_off()


@checked
@style()
def plot_optimum(optimum: Optimum) -> BookFigure:
    """Draw what an estimator found: its solid or its quartic; without either, say what it gave.

    Parameters
    ----------
    optimum
        The estimator's answer.
    """
    figure = BookFigure(figsize=(4.6, 3.6), layout="constrained")
    ax = figure.subplots()
    where = "joint angles" if optimum.joints is not None else count(len(optimum.poses), "pose")
    if optimum.solid is not None:
        _draw_solid(ax, optimum.solid)
    elif optimum.quartic is not None:
        _draw_quartic(ax, optimum.quartic)
    else:
        say(ax, where)
    certain = optimum.outcome in (Outcome.ALIGNED, Outcome.ANY_ANGLE)
    headline(figure, f"Optimum: {optimum.outcome}, {where}{sd_text(optimum.uncertainty)}", bad=not certain)
    return figure


# --- plans and grasps -------------------------------------------------------------------------------------------------


@checked
@style()
def plot_plan(plan: Plan) -> BookFigure:
    """Draw a plan: where the camera looked from and where it ended; and the arcs' ratios, or the closed loop's steps.

    Parameters
    ----------
    plan
        The plan.
    """
    figure = BookFigure(figsize=(7.2, 3.6), layout="constrained")
    _draw_plan(figure, plan)
    return figure


def _draw_plan(host: Figure | SubFigure, plan: Plan) -> None:
    seen, sd = ((plan.arcs, "arc"), (plan.steps, "step"), (plan.views, "view")), plan.uncertainty
    parts = [*(count(len(each), name) for each, name in seen if each), count(plan.frames, "picture")]
    if np.isfinite(sd):
        parts.append(f"sd {np.degrees(sd):.1f} deg")
    outcome = " after ".join([plan.outcome, *plan.attempts[::-1]])
    unexplained = plan.outcome is Outcome.UNEXPLAINED
    warning = "\nno solid explains the views: the viewpoint may be far off" if unexplained else ""
    headline(host, f"Plan: {', '.join([outcome, *parts])}{warning}", bad=plan.outcome is not Outcome.ALIGNED)
    if not plan.views:
        ax = host.subplots()
        if plan.view is None:
            say(ax, "nothing in view")
        else:
            draw_on_picture(ax, plan.view.blob, plan.view.rgb)
        return
    where, how = host.subplots(1, 2, width_ratios=(1, 1.1))
    _draw_directions(where, plan, sd)
    if plan.arcs:
        _draw_ratios(how, plan.arcs, [optimum.quartic for optimum in plan.optima])
    else:
        _draw_steps(how, plan)


def _draw_directions(ax: Axes, plan: Plan, sd: float) -> None:
    """Where the camera was over the object, as angles from where it began, in the axes of its first picture."""
    trails = [arc.views for arc in plan.arcs] or [tuple(step.view for step in plan.steps if step.view is not None)]
    trails = [trail for trail in trails if trail]
    start = next((arc.views[arc.center] for arc in plan.arcs if arc.views), trails[0][0]).base_from_camera
    for trail, color in zip(trails, SERIES * len(trails), strict=False):
        ax.plot(*_directions(start, trail).T, "-" if plan.arcs else "o-", ms=3.5, lw=2.2, color=color)
    ax.plot(0, 0, "o", ms=7, mfc="white", mec=COLORS["ink"], label="start")
    if plan.view is not None:
        (end,) = _directions(start, [plan.view])
        ax.plot(*end, "*", ms=13, color=BAD, mec="white", mew=0.8, label="end")
        if np.isfinite(sd):
            angle = np.linspace(0, 2 * np.pi, 73)
            circle = end + np.degrees(sd) * np.column_stack([np.cos(angle), np.sin(angle)])
            ax.plot(*circle.T, color=BAD, lw=1, label="1 sd")
    (low, high) = ax.dataLim.get_points()
    middle, reach = 0.5 * (low + high), max(8.0, 0.58 * float((high - low).max()))
    above = _tangent(start.rotation.inv().apply([0.0, 0.0, 1.0]))
    if np.abs(above - middle).max() < reach:
        ax.plot(*above, "+", ms=9, mew=1.6, color=DARK, label="above")
    ax.axhline(0, color=FAINT, lw=0.8, zorder=0)
    ax.axvline(0, color=FAINT, lw=0.8, zorder=0)
    (u0, v0), (u1, v1) = middle - reach, middle + reach
    ax.set(xlim=(u0, u1), ylim=(v0, v1), aspect="equal", xlabel="camera to the right [deg]", ylabel="camera up [deg]")
    legend(ax, 4)


def _directions(start: RigidTransform, views: Sequence[View]) -> NDArray[np.float64]:
    """Angles to the right and up, deg, by which each view's camera stands over the object from the start's, (n, 2)."""
    turned = [(start.rotation.inv() * view.base_from_camera.rotation).as_matrix()[:, 2] for view in views]
    return _tangent(-np.array(turned))


def _tangent(outward: NDArray[np.float64]) -> NDArray[np.float64]:
    """Directions from the object, in a camera's frame, (..., 3), as angles right and up from it, deg, (..., 2)."""
    x, y, z = np.moveaxis(outward, -1, 0)
    angle, across = np.degrees(np.arctan2(np.hypot(x, y), -z)), np.maximum(np.hypot(x, y), 1e-12)
    return np.stack([angle * x / across, -angle * y / across], axis=-1)


def _draw_ratios(ax: Axes, arcs: Sequence[Arc], quartics: Sequence[Quartic | None] = ()) -> None:
    """Ratios over the angle; the quartics are those of the last arcs, as many as there are."""
    if not any(arc.views for arc in arcs):
        say(ax, "no view")
        return
    _zero_line(ax)
    padded = [*[None] * (len(arcs) - len(quartics)), *quartics]
    for number, (arc, quartic) in enumerate(zip(arcs, padded, strict=False)):
        angles, color = np.degrees(arc.angles), SERIES[number % len(SERIES)]
        name = f"arc {number + 1}, along {arc.axis}" if len(arcs) > 1 else "view"
        ax.plot(angles, arc.ratios, "o", ms=3.5, color=color, label=name)
        if arc.axis is None:
            continue
        if quartic is None or len(quartic.x) != len(arc):
            ax.plot(angles, arc.ratios, color=color, lw=1.2)
        else:
            x = np.linspace(quartic.x[0], quartic.x[-1], 200)
            ax.plot(np.interp(x, quartic.x, angles), quartic.polynomial(x), color=color)
            at = np.interp(quartic.chosen, quartic.x, angles), quartic.polynomial(quartic.chosen)
            ax.plot(*at, "o", **RING)
    ax.set(xlabel="angle from the center [deg]", ylabel="minor axis / major axis")
    if len(arcs) > 1:
        legend(ax, 2)


def _draw_steps(ax: Axes, plan: Plan) -> None:
    """Angle yet to go at each step: to where the plan ended, and by what the policy's answers said together."""
    numbers = np.arange(1, len(plan.steps) + 1)
    last = plan.view or next((step.view for step in reversed(plan.steps) if step.view is not None), None)
    if last is not None:
        seen = [(n, step) for n, step in zip(numbers, plan.steps, strict=True) if step.view is not None]
        views = [step.view for _, step in seen if step.view is not None]
        to_go = np.linalg.norm(_directions(last.base_from_camera, views), axis=1)
        ax.plot([n for n, _ in seen], to_go, "o-", ms=4, color=COLORS["blue"], label="to the end")
        for (n, step), angle in zip(seen, to_go, strict=True):
            if isinstance(step.said, Action):
                ax.annotate("↑←↓→•"[step.said], (n, angle), (3, 3), textcoords="offset points", size=11)
    known = [(n, step.left) for n, step in zip(numbers, plan.steps, strict=True) if step.left is not None]
    if known:
        angles, sigmas = np.degrees([(left.angle, left.sigma) for _, left in known]).T
        options: dict[str, Any] = {"fmt": "s", "ms": 4, "lw": 1.2, "capsize": 2, "color": COLORS["orange"]}
        ax.errorbar([n for n, _ in known], angles, sigmas, **options, label="left, by all looks")
    ax.set(xlabel="step", ylabel="angle [deg]", xlim=(0.5, len(numbers) + 0.5))
    ax.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=8))
    ax.set_ylim(bottom=min(0.0, ax.get_ylim()[0]))
    ax.margins(y=0.15)
    legend(ax, 2)


@checked
@style()
def plot_grasp(grasp: Grasp) -> BookFigure:
    """Draw what the range sensor read on the way down, and where the fingers closed.

    Parameters
    ----------
    grasp
        The grasp.
    """
    figure = BookFigure(figsize=(WIDTH, 2.9), layout="constrained")
    _draw_grasp(figure, grasp)
    return figure


def _draw_grasp(host: Figure | SubFigure, grasp: Grasp) -> None:
    ax = host.subplots()
    width = [f"{1000 * grasp.width:.0f} mm between the pads"] if np.isfinite(grasp.width) else []
    landed = ["touched down"] if grasp.landed else []
    leaned = [f"leaned back {np.degrees(grasp.lean):.0f} deg"] if grasp.lean else []
    parts = [grasp.outcome, *width, *landed, *leaned, count(grasp.frames, "picture")]
    headline(host, f"Grasp: {', '.join(parts)}", bad=not grasp.held)
    if not grasp.readings:
        say(ax, "no reading: the hand did not descend")
        return
    start = grasp.readings[0].base_from_camera

    def descent(pose: RigidTransform) -> float:
        """How far the hand has come along the lens's first axis, mm."""
        return float(1000 * (start.inv() * pose).translation[2])

    x = np.array([descent(reading.base_from_camera) for reading in grasp.readings])
    y = 1000 * np.array([reading.distance for reading in grasp.readings])
    landed_at = np.array([reading.landed for reading in grasp.readings])
    blind = ~np.isfinite(y)
    ax.plot(x[~blind & ~landed_at], y[~blind & ~landed_at], "o", ms=4, color=COLORS["blue"], label="reading")
    if blind.any():
        options: dict[str, Any] = {"transform": ax.get_xaxis_transform(), "clip_on": False}
        ax.plot(x[blind], np.full(blind.sum(), 0.97), "v", ms=5, color=DARK, label="saw nothing", **options)
    if (landed_at & ~blind).any():
        ax.plot(x[landed_at & ~blind], y[landed_at & ~blind], "x", ms=7, mew=2, color=BAD, label="touched down")
    if grasp.closed_at is not None:
        ax.axvline(descent(grasp.closed_at), color=COLORS["green"], lw=2, label="fingers close")
    ax.set(xlabel="descent [mm]", ylabel="range [mm]")
    ax.set_ylim(bottom=0)
    legend(ax, 4)


@checked
@style()
def plot_pick_up(result: PickUp) -> BookFigure:
    """Draw a pick-up: its plan, and below it its grasp.

    Parameters
    ----------
    result
        Result of :func:`gvp_lib.pick_up`: plan, grasp and duration, s.
    """
    figure = BookFigure(figsize=(7.2, 6.8), layout="constrained")
    headline(figure, f"PickUp: {result.outcome}, {result.seconds:.0f} s", bad=not result)
    parts: Any = figure.subfigures(2, 1, height_ratios=(1.25, 1))
    above, below = parts
    _draw_plan(above, result.plan)
    _draw_grasp(below, result.grasp)
    return figure


# --- geometry ---------------------------------------------------------------------------------------------------------


@checked
@style()
def plot_calibration(calibration: Calibration) -> BookFigure:
    """Draw how far a lens moves each pixel: from where a pinhole would see it to where it appears.

    Parameters
    ----------
    calibration
        The calibration.
    """
    lens = calibration.intrinsics
    u, v = np.meshgrid(np.linspace(0, lens.width - 1, 13), np.linspace(0, lens.height - 1, 10))
    pixels = np.stack([u, v], axis=-1)
    moved = pixels - calibration.undistort_pixels(pixels)
    most = float(np.linalg.norm(moved, axis=-1).max())
    figure = BookFigure(figsize=(4.8, 3.9), layout="constrained")
    ax = figure.subplots()
    stretch = 0.08 * lens.width / max(most, 0.1)
    options: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1 / stretch, "width": 0.005}
    ax.quiver(*(pixels - stretch * moved).reshape(-1, 2).T, *moved.reshape(-1, 2).T, color=COLORS["blue"], **options)
    ax.plot(*lens.principal_point, "+", ms=12, mew=2, color=BAD)
    ax.text(1.06 * lens.cx, lens.cy, "principal point", color=BAD, va="center")
    ax.set(xlim=(-0.5, lens.width - 0.5), ylim=(lens.height - 0.5, -0.5), aspect="equal")
    ax.set(xlabel="u [px]", ylabel=f"v [px]; arrows up to {most:.1f} px")
    focal, sd = (lens.fx + lens.fy) / 2, calibration.focal_deviation.max()
    known = f"focal length {focal:.1f} px (sd {sd:.1f}), rms {calibration.rms_px:.2f} px"
    headline(figure, f"Calibration: {known}, {count(len(calibration.used), 'picture')}")
    return figure


@checked(poses=True)
@style()
def plot_sphere(
    sphere: VirtualSphere, *, viewpoints: RigidTransform | None = None, max_tilt: float = np.radians(30)
) -> BookFigure:
    """Draw a virtual sphere's cap, and viewpoints on it as pins that point where the cameras look.

    Parameters
    ----------
    sphere
        The sphere.
    viewpoints
        Poses ``world_from_camera`` to draw; by default 48 spread evenly over the cap.
    max_tilt
        Half the cap's angle, rad.
    """
    if not 0 < max_tilt <= np.pi:
        raise InvalidParameterError(f"max_tilt is in radians, in (0, pi]; got {max_tilt}")
    shown = sphere.uniform(48, max_tilt) if viewpoints is None else viewpoints
    figure = BookFigure(figsize=(4.6, 3.4), layout="constrained")
    ax = figure.subplots()
    around, up = np.linspace(0, 2 * np.pi, 73), np.linspace(0, max_tilt, 13)
    curves = [(np.full(73, tilt), around) for tilt in np.linspace(0, max_tilt, 4)[1:]]
    curves += [(up, np.full(13, azimuth)) for azimuth in np.linspace(0, 2 * np.pi, 13)[:-1]]
    for tilts, azimuths in curves:
        ax.plot(*_seen(sphere.viewpoint(tilts, azimuths).translation).T, color=COLORS["sky"], lw=1)
    eyes = np.reshape(shown.translation, (-1, 3))
    looks = np.reshape(shown.rotation.as_matrix(), (-1, 3, 3))[:, :, 2]
    pins = np.stack([_seen(eyes), _seen(eyes + 0.12 * sphere.radius * looks)], axis=1)
    ax.add_collection(LineCollection(list(pins), colors=COLORS["orange"], lw=1.4))
    ax.plot(*pins[:, 0].T, "o", ms=3.5, color=COLORS["blue"])
    axis = _seen(np.stack([sphere.center, sphere.center + 1.15 * sphere.radius * sphere.pole]))
    ax.plot(*axis.T, ls=(0, (4, 3)), lw=1, color=DARK)
    ax.plot(*axis[0], "o", ms=7, mfc="white", mec=COLORS["ink"])
    for at, name in zip(axis, ("center", "pole"), strict=True):
        ax.annotate(name, at, (8, 0), textcoords="offset points", va="center", color=DARK)
    ax.set(aspect="equal")
    ax.set_axis_off()
    where = ", ".join(f"{x:.2f}" for x in sphere.center)
    headline(figure, f"VirtualSphere: radius {sphere.radius:.3g} m about ({where}) m, {len(eyes)} viewpoints")
    return figure


# --- shared -----------------------------------------------------------------------------------------------------------


def _zero_line(ax: Axes) -> None:
    ax.axvline(0, color=FAINT, lw=1, ls=(0, (4, 3)), zorder=0)


def _seen(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (..., 3) as a far eye in front, to the left and above sees them: to the right and up, (..., 2)."""
    azimuth, elevation = _EYE
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    up = np.cos(elevation) * np.array([0.0, 0.0, 1.0]) - np.sin(elevation) * level
    return points @ np.stack([right, up], axis=1)
