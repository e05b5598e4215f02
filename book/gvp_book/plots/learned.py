"""The learned planner in closed loop, in figures: what it saw and said, which way it would go, how near it keeps; and
tables of the stored experiments (thesis Tables 3.3 and 3.4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.patches import Circle, Rectangle
from numpy.typing import ArrayLike, NDArray

from gvp_book.plots.datasets import ACTION_COLORS
from gvp_book.plots.drawing import DASH, FAINT, RING, bare, colored, plate, styled
from gvp_book.plots.tables import Content, Table, with_interval
from gvp_lib.errors import UnknownNameError
from gvp_lib.motion.arm import Outcome
from gvp_lib.planning.plan import Action
from gvp_lib.views.figures import COLORS, BookFigure


@styled
def strip(
    pictures: Sequence[NDArray[np.uint8]], said: Sequence[Action], above: Sequence[str] = (), below: Sequence[str] = ()
) -> BookFigure:
    """Draw the images of an episode in order, with the policy's answers as arrows and NO_OP as a ring.

    Each image may have a text above it and one below.
    """
    n = len(pictures)
    figure, axes = plate(min(1.25 * n, 9.0), 1.95 * min(1.0, 9.0 / (1.25 * n)) + 0.1, n)
    for k, (ax, picture, action) in enumerate(zip(axes, pictures, said, strict=True)):
        ax.imshow(picture, extent=(-0.5, 0.5, 0.5, -0.5), interpolation="antialiased")
        bare(ax)
        color, (u, v) = ACTION_COLORS[action], action.direction
        if action is Action.NO_OP:
            ax.add_patch(Circle((0, 0), 0.4, fill=False, ec=color, lw=2.4))
        else:
            arrow = {"arrowstyle": "-|>", "color": color, "lw": 2.4, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 13}
            ax.annotate("", (0.46 * u, 0.46 * v), (0.2 * u, 0.2 * v), arrowprops=arrow)
        if above:
            ax.set_title(above[k], fontsize=8.5)
        if below:
            ax.set_xlabel(below[k], fontsize=8.5, color=color)
    return figure


@styled
def floor(ends_deg: ArrayLike, step_deg: float, measured: Mapping[str, tuple[ArrayLike, ArrayLike]]) -> BookFigure:
    """Plot where the best possible policy stops, and the mean error that remains, by the size of a step.

    ``ends_deg`` is where the normal ends up in the image, along (u, v), shape (n, 2), deg, after steps of ``step_deg``.
    ``measured``, by name: step sizes and the mean final errors with them, deg.
    """
    ends = np.asarray(ends_deg, float)
    sizes = np.array([0.0, 1.15 * max([step_deg, *(np.max(steps) for steps, _ in measured.values())])])
    figure, (left, right) = plate(8.2, 3.2, 2, width_ratios=[1, 1.45])
    left.scatter(ends[:, 0], ends[:, 1], s=3, color=COLORS["blue"], lw=0)
    half = step_deg / 2
    left.add_patch(Rectangle((-half, -half), step_deg, step_deg, fill=False, ec=COLORS["ink"], lw=1.2))
    for radius, name in ((0.3826, "mean"), (np.sqrt(0.5), "worst")):
        left.add_patch(Circle((0, 0), radius * step_deg, fill=False, ec=COLORS["vermilion"], lw=1.2, ls=DASH))
        left.text(0, -radius * step_deg, f"{name} {radius * step_deg:.2f}°", ha="center", va="center", fontsize=8.5,
                  color=COLORS["vermilion"], bbox={"fc": "white", "ec": "none", "pad": 1})  # fmt: skip
    span = 0.85 * step_deg
    left.set(aspect="equal", xlim=(-span, span), ylim=(span, -span), xlabel="left over along u [deg]",
             ylabel="along v [deg]")  # fmt: skip
    right.plot(sizes, 0.3826 * sizes, color=FAINT, ls=DASH, lw=1.4, label="0.383 step, mean of the square")
    for name, (steps, errors) in measured.items():
        right.plot(steps, errors, "o-", ms=5, lw=1.2, label=name)
    right.set(xlabel="step [deg]", ylabel="mean final error [deg]", xlim=sizes, ylim=(0, None))
    figure.legend(*right.get_legend_handles_labels(), loc="outside upper right", ncols=3, fontsize=8.5)
    return figure


@styled
def fields(
    answers: Mapping[str, tuple[ArrayLike, Sequence[Action], ArrayLike]], paths: Mapping[str, Sequence[ArrayLike]]
) -> BookFigure:
    """Draw a policy as a vector field over a cap, seen from above, with the paths that it takes.

    ``answers``, by title: viewpoints, as tilts from the normal along (x, y), shape (n, 2), deg; the policy's answer at
    each; and the camera motion that it causes, shape (n, 2), deg. ``paths``, for some of the titles: viewpoints in
    order, shape (m, 2) each, deg.
    """
    figure, axes = plate(3.3 * len(answers), 3.5, len(answers))
    for ax, (title, (at, said, moves)) in zip(axes, answers.items(), strict=True):
        x, y = np.asarray(at, float).T
        u, v = np.asarray(moves, float).T
        colors = [ACTION_COLORS[action] for action in said]
        ax.quiver(x, y, u, v, color=colors, angles="xy", scale_units="xy", scale=1.15, width=0.007, headwidth=4)
        stays = [action is Action.NO_OP for action in said]
        ax.scatter(x[stays], y[stays], s=26, facecolors="none", edgecolors=ACTION_COLORS[Action.NO_OP], lw=1.6)
        ways = [np.asarray(path, float) for path in paths.get(title, ())]
        for way in ways:
            ax.plot(*way.T, color=COLORS["ink"], lw=1.6, alpha=0.75)
            ax.plot(*way[0], "o", color=COLORS["ink"], ms=5)
            ax.plot(*way[-1], "s", color=COLORS["purple"], mec=COLORS["ink"], ms=6)
        reach = max([33.0, *(1.08 * np.abs(way).max() for way in ways)])
        for radius in (radius for radius in range(10, 91, 10) if radius < reach):
            ring = {"ec": FAINT, "lw": 1.4} if radius == 30 else {"ec": RING, "lw": 0.8}
            ax.add_patch(Circle((0, 0), radius, fill=False, zorder=0, **ring))
        ax.plot(0, 0, "+", color=COLORS["ink"], ms=9, mew=1.2)
        ax.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xticks=[-30, 0, 30], yticks=[-30, 0, 30])
        ax.set_title(title)
        ax.spines[:].set_visible(False)
    return figure


@styled
def following(curves: Mapping[str, tuple[ArrayLike, ArrayLike]]) -> BookFigure:
    """Plot the true error, deg, over simulated time, s, of each method that follows a moving object."""
    figure, (ax,) = plate(7.4, 2.8)
    (first, still), *others = curves.items()
    ax.plot(*still, color=FAINT, label=first)
    for name, curve, color in colored(dict(others)):
        ax.plot(*curve, color=color, label=name)
    ax.set(xlabel="time [s]", ylabel="error [deg]", ylim=(0, None))
    figure.legend(*ax.get_legend_handles_labels(), loc="outside upper right", ncols=len(curves), fontsize=8.5)
    return figure


@styled
def said_and_true(looks: Mapping[str, Mapping[str, tuple[ArrayLike, ArrayLike, ArrayLike]]]) -> BookFigure:
    """Plot a network's predicted angle to the normal against the true one, one panel per title.

    By the network's name: true angles, predicted angles, and predicted standard deviations, shape (n,) each, deg.
    """
    figure, axes = plate(3.7 * len(looks), 3.2, len(looks))
    for ax, (title, networks) in zip(axes, looks.items(), strict=True):
        for name, (true, said, sigma), color in colored(networks):
            ax.errorbar(true, said, yerr=sigma, fmt="o", ms=3.5, lw=0.8, color=color, label=name)
        ends = ax.get_xlim()
        ax.plot(ends, ends, color=FAINT, ls=DASH, lw=1.2, zorder=0)
        ax.set(xlabel="true angle to the normal [deg]", ylabel="said [deg]", title=title, xlim=ends)
        ax.legend(loc="upper left", fontsize=8.5)
    return figure


_SPACE = "\N{NO-BREAK SPACE}"  # so that a narrow column breaks between a number and its interval, and nowhere else
_PLUS_MINUS = f"{_SPACE}±{_SPACE}"


def ends_table(content: Content, methods: Sequence[str], group: str = "clean") -> Table:
    """Table of final errors by object and method: mean and standard deviation, and the mean's interval, deg.

    ``content`` is of :func:`gvp_book.experiments.learned.episodes_report`, its group ``"clean"`` or ``"rough"``.
    Methods are columns; a cell is empty if its method was not run on the object.
    """
    rows = []
    for target, found in _cases(content, group).items():
        thesis = content["thesis"].get(target)
        printed = [f"{thesis['mean']:g}{_PLUS_MINUS}{thesis['sd']:g}" if thesis else ""] if content["thesis"] else []
        n = max(found[method]["error"]["n"] for method in methods if method in found)
        cells = [_spread(found[method]["error"]) if method in found else "" for method in methods]
        rows.append([target, *printed, *cells, n])
    return Table(["object", *(["thesis, n = 50"] if content["thesis"] else []), *methods, "n"], rows)


def methods_table(content: Content, target: str, group: str = "clean") -> Table:
    """Table of all methods on one object: the final error, its change from the start, and how the plans ended."""
    found = _cases(content, group)
    if target not in found:
        raise UnknownNameError("object", target, found)
    rows = []
    for name, method in found[target].items():
        if "outcomes" not in method:
            continue  # the others are the start, and paired differences
        error = method["error"]
        ends = {Outcome(outcome): count for outcome, count in method["outcomes"].items()}
        stopped = sum(count for outcome, count in ends.items() if outcome.arrived)
        on_and_on = ends.get(Outcome.OUT_OF_STEPS, 0)
        counts = stopped, on_and_on, error["n"] - stopped - on_and_on
        shares = [f"{100 * count / error['n']:.0f}" for count in counts]
        change = f"{method['change']['mean']:+.1f}"
        rows.append([name, _spread(error), error["p95"], change, method["steps"]["mean"], *shares, error["n"]])
    numbers = ["final error [deg]", "95th percentile", "change", "steps"]
    return Table(["method", *numbers, "stopped [%]", "out of steps", "failed", "n"], rows)


def means_over_objects(content: Content, methods: Sequence[str]) -> Table:
    """Table of the mean final error over all objects, equally weighted, deg, by method and group."""

    def mean(method: str, group: str) -> str:
        means = [found[method]["error"]["mean"] for found in _cases(content, group).values() if method in found]
        return f"{np.mean(means):.2f}" if means else ""

    groups = dict.fromkeys(case.partition("/")[0] for case in content["summary"])
    rows = [[method, *(mean(method, group) for group in groups)] for method in methods]
    return Table(["mean over the objects [deg]", *groups], rows)


def following_table(content: Content) -> Table:
    """Table by path and method: the mean error while following, deg, with its interval, and how often it was lost.

    ``content`` as of :func:`gvp_book.experiments.learned.following_report`.
    """
    rows = []
    methods = list(next(iter(content["summary"].values())))
    for path, found in content["summary"].items():
        errors = [found[method]["error"] for method in methods]
        lost = ", ".join(str(found[method]["lost"]) for method in methods)
        rows.append([path, *(_spread({**error, "sd": None}) for error in errors), lost, errors[0]["n"]])
    return Table(["the object", *(f"{method} [deg]" for method in methods), "lost", "n"], rows)


def _cases(content: Content, group: str) -> dict[str, Content]:
    """Cases of one group, by object."""
    split = {case: case.partition("/")[::2] for case in content["summary"]}
    found = {target: content["summary"][case] for case, (own, target) in split.items() if own == group}
    if not found:
        raise UnknownNameError("group", group, dict.fromkeys(own for own, _ in split.values()))
    return found


def _spread(error: Content) -> str:
    """Mean, standard deviation if there is one, and the mean's interval."""
    mean, *interval = with_interval(error, space=_SPACE).partition(" ")
    return mean + ("" if error["sd"] is None else f"{_PLUS_MINUS}{error['sd']:.1f}") + "".join(interval)
