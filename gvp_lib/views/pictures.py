"""Figures made of pictures: what a camera sees or MuJoCo renders; and the style of them all.

Every function returns a matplotlib ``Figure``; none shows one or changes global settings.

Colors are Okabe and Ito's, which people with any color vision tell apart. Figures stand on white in a light and in
a dark page alike: the book's style sheet gives them a card.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import matplotlib.colors
import matplotlib.rcsetup
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Ellipse, FancyArrowPatch
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidImageError, InvalidParameterError
from gvp_lib.motion.sighting import View
from gvp_lib.perception.blobs import Blob
from gvp_lib.perception.hsv import rgb_to_hsv
from gvp_lib.perception.images import check_rgb
from gvp_lib.picture import count

if TYPE_CHECKING:
    from gvp_lib.simulation.arms import ArmSpec
    from gvp_lib.simulation.objects import ObjectSpec
    from gvp_lib.simulation.workcell import WorkCell

__all__ = [
    "COLORS",
    "STYLE",
    "BookFigure",
    "draw_blob",
    "gallery",
    "hsv_histograms",
    "panels",
    "pipeline",
    "plot_arm",
    "plot_blob",
    "plot_object",
    "plot_view",
    "plot_work_cell",
    "show_images",
    "style",
]

COLORS = {
    "orange": "#e69f00",
    "sky": "#56b4e9",
    "green": "#009e73",
    "yellow": "#f0e442",
    "blue": "#0072b2",
    "vermilion": "#d55e00",
    "purple": "#cc79a7",
    "ink": "#35302a",
}
SERIES = COLORS["blue"], COLORS["orange"], COLORS["green"]
FAINT, DARK, BAD = "#b9b0a2", "#6f675b", COLORS["vermilion"]

WIDTH = 6.4  # inches, of a figure: more would leave its text too small on a phone
RING: dict[str, Any] = {"ms": 12, "mfc": "none", "mec": BAD, "mew": 2}  # about what was chosen

STYLE: dict[str, Any] = {
    "axes.edgecolor": "#8d8579",
    "axes.grid": False,
    "axes.labelcolor": COLORS["ink"],
    "axes.linewidth": 0.8,
    "axes.prop_cycle": mpl.rcsetup.cycler(
        color=[COLORS[c] for c in ("blue", "orange", "green", "vermilion", "purple", "sky")]
    ),
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlecolor": COLORS["ink"],
    "axes.titlesize": 10.5,
    "figure.dpi": 110,
    "figure.facecolor": "white",
    "font.size": 9.5,
    "grid.color": "#e4ded4",
    "legend.frameon": False,
    "lines.linewidth": 1.8,
    "savefig.facecolor": "white",
    "text.color": COLORS["ink"],
    "xtick.color": "#6f675b",
    "ytick.color": "#6f675b",
}


@checked
@contextmanager
def style() -> Iterator[None]:
    """Apply the book's style to figures of your own.

    Examples
    --------
    >>> with style():
    ...     axes = BookFigure(figsize=(4, 3)).subplots(1, 2)
    """
    with mpl.rc_context(STYLE):  # type: ignore[arg-type]
        yield


class BookFigure(Figure):
    """Figure that shows itself in a notebook without pyplot, which need not be loaded."""

    @style()
    def _repr_png_(self) -> bytes:
        png = io.BytesIO()
        # Without matplotlib's own mark the same figure makes the same bytes.
        self.savefig(png, format="png", dpi=130, metadata={"Software": None})
        return png.getvalue()


@checked
def panels(count: int, width: float, height: float, **shared: Any) -> tuple[BookFigure, list[Axes], Axes | None]:
    """Make a figure of panels, two in a row: more would leave the text too small for a phone.

    Parameters
    ----------
    count
        Number of panels.
    width, height
        Size of one panel, inches.
    **shared
        Options of ``Figure.subplots``, such as ``sharey=True``.

    Returns
    -------
    figure
        The figure.
    axes
        Its panels.
    free
        Place that an odd number of panels leaves free, for a legend; None if there is none.

    Examples
    --------
    >>> figure, axes, free = panels(3, 3.0, 2.0, sharey=True)
    >>> len(axes), free is None
    (3, False)
    """
    if count < 1 or not (0 < width < 100 and 0 < height < 100):
        raise InvalidParameterError(
            f"panels are one or more, of a width and height in inches, below 100; got {count}, {width} x {height}"
        )
    columns, rows = min(count, 2), -(-count // 2)
    figure = BookFigure(figsize=(width * columns, height * rows), layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False, **shared).flat)
    for ax in axes:
        ax.tick_params(labelbottom=True)  # each can be read alone, also where they share the x axis
    if len(axes) == count:
        return figure, axes, None
    axes[-1].set_axis_off()
    return figure, axes[:-1], axes[-1]


@checked
def show_images(images: Sequence[NDArray[Any]], titles: Sequence[str] = (), *, height: float = 2.4) -> BookFigure:
    """Show images side by side.

    Parameters
    ----------
    images
        RGB, uint8 (H, W, 3), or masks and other planes, (H, W), which are drawn in gray.
    titles
        One per image, or none.
    height
        Height of each image, inches.

    Examples
    --------
    >>> len(show_images([np.zeros((48, 64, 3), np.uint8), np.ones((48, 64), bool)], ["image", "mask"]).axes)
    2
    """
    if not len(images) or len(titles) not in (0, len(images)):
        raise InvalidParameterError(
            f"give at least one image, and one title each or none; got {len(images)} images, {len(titles)} titles"
        )
    return _picture_grid([images], titles, height, margins=(0.12 * (len(images) - 1), 0.3))


@checked
def draw_blob(rgb: NDArray[np.uint8], blob: Blob | None, title: str = "", *, height: float = 3.2) -> BookFigure:
    """Draw a blob over its image: centroid, major and minor axis, bounding rectangle (thesis Fig. 2.1, right).

    Parameters
    ----------
    rgb
        Image, uint8 (H, W, 3).
    blob
        Blob to draw; None says that there is none.
    title
        Title of the image.
    height
        Height of the image, inches.

    Examples
    --------
    >>> mask = np.zeros((48, 64), bool)
    >>> mask[20:30, 10:50] = True
    >>> len(draw_blob(np.zeros((48, 64, 3), np.uint8), Blob.from_mask(mask), "a bar").axes)
    1
    """
    figure = show_images([check_rgb(rgb)], [title], height=height)
    _mark_blob(figure.axes[0], blob)
    return figure


@checked
def pipeline(rgb: NDArray[np.uint8], mask: NDArray[np.bool_], blob: Blob | None) -> BookFigure:
    """Show the way from an image to a blob in three panels, as in thesis Fig. 2.1.

    Parameters
    ----------
    rgb
        Image, uint8 (H, W, 3).
    mask
        Its mask, bool (H, W).
    blob
        Blob of the mask, or None.

    Examples
    --------
    >>> mask = np.zeros((48, 64), bool)
    >>> len(pipeline(np.zeros((48, 64, 3), np.uint8), mask, Blob.from_mask(mask)).axes)
    3
    """
    if np.shape(rgb)[:2] != np.shape(mask)[:2]:
        raise InvalidParameterError(f"image and mask differ in size: {np.shape(rgb)} and {np.shape(mask)}")
    figure = show_images([rgb, mask, rgb], ["what the camera sees", "mask", "centroid and axes"])
    _mark_blob(figure.axes[2], blob)
    return figure


@checked
def gallery(
    rgbs: Sequence[NDArray[np.uint8]],
    masks: Sequence[NDArray[np.bool_]],
    blobs: Sequence[Blob | None],
    titles: Sequence[str] = (),
    *,
    height: float = 1.35,
    masks_shown: bool = True,
) -> BookFigure:
    """Show several images, a column each: the blob over the image, and the mask below it.

    Parameters
    ----------
    rgbs
        Images, uint8 (H, W, 3).
    masks
        Mask of each image, bool (H, W).
    blobs
        Blob of each mask, or None.
    titles
        One per column, or none.
    height
        Height of each image, inches.
    masks_shown
        Whether to show the masks.

    Examples
    --------
    >>> image, mask = np.zeros((48, 64, 3), np.uint8), np.ones((48, 64), bool)
    >>> len(gallery([image] * 3, [mask] * 3, [Blob.from_mask(mask)] * 3).axes)
    6
    """
    if not len(rgbs) or len({len(rgbs), len(masks), len(blobs), len(titles) or len(rgbs)}) > 1:
        raise InvalidParameterError(
            "give one mask and one blob for each image, and one title each or none; "
            f"got {len(rgbs)} images, {len(masks)} masks, {len(blobs)} blobs, {len(titles)} titles"
        )
    rows: list[Sequence[NDArray[Any]]] = [rgbs, masks] if masks_shown else [rgbs]
    figure = _picture_grid(rows, titles, height, margins=(0.1 * len(rgbs), 0.4))
    for ax, blob in zip(figure.axes, blobs, strict=False):  # the first row
        _mark_blob(ax, blob, weight=0.65)
    return figure


@checked
@style()
def hsv_histograms(
    rgb: NDArray[np.uint8],
    hue: tuple[float, float] | None = None,
    saturation: tuple[float, float] | None = None,
    value: tuple[float, float] | None = None,
) -> BookFigure:
    """Draw histograms of an image's hue, saturation and value, with the given ranges shaded.

    Counts are relative to the fullest bin, on a square-root scale, so that a small object shows beside a large
    background. Hues are weighted by saturation, since the hue of a gray means nothing.

    Parameters
    ----------
    rgb
        Image, uint8 (H, W, 3).
    hue
        Range to shade, deg; it wraps through 0 if its start is above its end.
    saturation, value
        Ranges to shade, in [0, 1].

    Examples
    --------
    >>> len(hsv_histograms(np.zeros((48, 64, 3), np.uint8), hue=(345, 15)).axes)
    3
    """
    hues, saturations, values = rgb_to_hsv(rgb).reshape(-1, 3).T
    x = np.linspace(0, 1, 73)
    middle = 0.5 * (x[1:] + x[:-1])
    planes: list[tuple[str, float, Any, Any, tuple[float, float] | None, list[Any]]] = [
        ("hue [deg]", 360, hues, saturations, hue, [(x, 0.75, 0.85) for x in middle]),
        ("saturation", 1, saturations, None, saturation, [(0.07, x, 0.8) for x in middle]),
        ("value", 1, values, None, value, [(0, 0, 0.88 * x + 0.04) for x in middle]),
    ]
    figure = BookFigure(figsize=(8.6, 2.2), layout="constrained")
    for ax, (name, top, plane, weights, chosen, colors) in zip(figure.subplots(1, 3), planes, strict=True):
        edges = top * x
        counts, _ = np.histogram(plane, edges, weights=weights)
        heights = np.sqrt(counts / max(counts.max(), 1))
        ax.bar(edges[:-1], heights, np.diff(edges), align="edge", color=mpl.colors.hsv_to_rgb(colors))
        if chosen is not None:
            low, high = chosen
            for span in [chosen] if low <= high else [(low, top), (0.0, high)]:
                ax.axvspan(*span, color=COLORS["ink"], alpha=0.12, lw=0)
        ax.set(xlabel=name, xlim=(0, top), ylim=(0, 1.05), yticks=[])
        ax.spines["left"].set_visible(False)
    figure.axes[0].set_xticks([0, 60, 120, 180, 240, 300, 360])
    return figure


# --- objects that are, or have, a picture ---------------------------------------------------------------------------


@checked
@style()
def plot_blob(blob: Blob, *, image: NDArray[np.uint8] | None = None) -> BookFigure:
    """Draw a blob's centroid, axes and rectangle over its picture, or alone.

    Parameters
    ----------
    blob
        Blob to draw.
    image
        Its picture, RGB uint8 (H, W, 3); by default an empty one of 640 x 480 px, or larger where the blob is.
    """
    return _blob_figure(blob, image, f"Blob: {_in_words(blob)}")


@checked
@style()
def plot_view(view: View) -> BookFigure:
    """Draw a view's blob, over the picture where the view kept it.

    Parameters
    ----------
    view
        View to draw.
    """
    clipped = ", clipped" if view.clipped else ""
    return _blob_figure(view.blob, view.rgb, f"View{clipped}: {_in_words(view.blob)}", bad=view.clipped)


def _in_words(blob: Blob) -> str:
    lengths = f"axes {blob.axis_major_length:.0f} x {blob.axis_minor_length:.0f} px"
    turned = f"at {np.degrees(blob.orientation):.0f} deg" if blob.orientation_defined else "no orientation"
    return f"{blob.area} px, {lengths} {turned}, ratio {blob.ratio:.2f}"


def _blob_figure(blob: Blob, image: NDArray[np.uint8] | None, title: str, bad: bool = False) -> BookFigure:
    figure = BookFigure(figsize=(4.6, 3.7), layout="constrained")
    draw_on_picture(figure.subplots(), blob, image)
    headline(figure, title, bad)
    return figure


def draw_on_picture(ax: Axes, blob: Blob, image: NDArray[np.uint8] | None) -> None:
    """Draw a blob over its picture, or an empty one of 640 x 480 px or more."""
    if image is None:
        width, height = (max(least, end) for least, end in zip((640, 480), blob.bbox[2:], strict=True))
        ax.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal", facecolor="#f4f1ec")
    else:
        ax.imshow(check_rgb(image))
    _mark_blob(ax, blob, ellipse=image is None)
    ax.set(xlabel="u [px]", ylabel="v [px]")


@checked
def plot_work_cell(cell: WorkCell) -> BookFigure:
    """Draw a cell's overview beside what its camera sees.

    Parameters
    ----------
    cell
        Cell to draw. Its camera's picture here is without noise, so that a look draws no random numbers.
    """
    from gvp_lib.simulation.camera import renderer
    from gvp_lib.simulation.scene import ARM_PREFIX, FLOATING, OVERVIEW

    spec, lens, pictures = cell.arm_spec, cell.arm.intrinsics, []
    with renderer(cell.model, lens.width, lens.height) as made:  # without shadows, which take a second
        for camera in (OVERVIEW, FLOATING if spec is None else ARM_PREFIX + spec.camera):
            made.update_scene(cell.data, camera)
            pictures.append(made.render())
    arm = FLOATING if spec is None else spec.name
    figure = show_images(pictures, ["overview", "what the camera sees"], height=2.5)
    return _titled(figure, f"WorkCell: {arm}, {cell.target_spec.name} {cell.placement}")


@checked
def plot_object(spec: ObjectSpec) -> BookFigure:
    """Draw an object by itself, with its canonical normals as pins.

    Parameters
    ----------
    spec
        Object to draw.
    """
    from gvp_lib.views.scene3d import Scene3D

    model, box = spec.load().compile(), spec.bounding_box()
    _light(model)
    longest = float(box.half_extents.max())
    scene = Scene3D(model)
    for number, normal in enumerate(spec.normals):
        surface = float(np.abs(normal.direction) @ box.half_extents)
        pin = np.outer([surface, surface + 0.8 * longest], normal.direction)
        scene.add_path(f"normal {number}", box.center + pin, radius=0.04 * longest)
    scene.look_from(distance=5.5 * longest, target=box.center)
    sizes = " x ".join(f"{2000 * half:.0f}" for half in box.half_extents)
    normals = count(len(spec.normals), "normal") + (" and a circle of them" if spec.round_axis is not None else "")
    figure = show_images([scene.still(560, 480)], height=3.2)
    return _titled(figure, f"{spec.name}: {sizes} mm, {normals}")


@checked
def plot_arm(spec: ArmSpec) -> BookFigure:
    """Draw an arm in its home.

    Parameters
    ----------
    spec
        Arm to draw.
    """
    import mujoco

    from gvp_lib.views.scene3d import Scene3D

    model = spec.load().compile()
    _light(model)
    data = mujoco.MjData(model)
    for name, angle in zip(spec.joints, spec.home, strict=True):
        data.qpos[model.joint(name).qposadr[0]] = angle
    mujoco.mj_forward(model, data)
    hand = "with" if spec.gripper is not None else "without"
    figure = show_images([Scene3D(model, data).still(480, 480)], height=3.4)
    return _titled(figure, f"{spec.name}: {count(len(spec.joints), 'joint')}, {hand} a gripper, in its home")


def _titled(figure: BookFigure, title: str) -> BookFigure:
    """A grid of pictures under a headline, which shrinks to fit a long name."""
    figure.set_figheight(figure.get_figheight() + 0.15)
    headline(figure, title)
    return figure


def _light(model: Any) -> None:
    """Light a model that stands alone, without the lamps of a cell."""
    model.vis.headlight.ambient[:], model.vis.headlight.diffuse[:] = 0.45, 0.6


# --- shared -----------------------------------------------------------------------------------------------------------


def headline(host: Figure | SubFigure, title: str, bad: bool = False) -> None:
    """Title a figure in one line, or one with a warning below it; in bold red where something went wrong."""
    longest = max(map(len, title.splitlines())) * (0.62 if bad else 0.54)  # of the font's size
    size = min(10.0, 72 * host.bbox.width / host.dpi / longest)
    color, weight = (BAD, "bold") if bad else (COLORS["ink"], "normal")
    host.suptitle(title, fontsize=size, color=color, weight=weight)


def arrow(ax: Axes, start: NDArray[np.float64], end: NDArray[np.float64]) -> None:
    """Draw an arrow between two points of a panel, shape (2,), which shows on any ground."""
    options: dict[str, Any] = {"arrowstyle": "-|>", "mutation_scale": 9, "color": BAD, "lw": 1.8}
    halo = [withStroke(linewidth=4, foreground="white")]
    ends = (start[0], start[1]), (end[0], end[1])
    ax.add_artist(FancyArrowPatch(*ends, shrinkA=0, shrinkB=0, path_effects=halo, **options))


def legend(ax: Axes, columns: int) -> None:
    """Put a legend above a panel, where it hides nothing."""
    options: dict[str, Any] = {"fontsize": 8, "handlelength": 1.2, "columnspacing": 0.9, "handletextpad": 0.4}
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=columns, borderaxespad=0.2, **options)


def say(ax: Axes, text: str) -> None:
    """Put words in place of what a panel cannot show."""
    ax.set_axis_off()
    ax.text(0.5, 0.5, text, transform=ax.transAxes, ha="center", va="center", color=BAD)


@style()
def _picture_grid(
    rows: Sequence[Sequence[NDArray[Any]]], titles: Sequence[str], height: float, margins: tuple[float, float]
) -> BookFigure:
    """Pictures in rows, each ``height`` inches high, under one row of titles; ``margins``: width and height, inches."""
    for image in (np.asarray(image) for row in rows for image in row):
        if (
            image.dtype.kind not in "buif"
            or image.ndim < 2
            or image.shape[2:] not in ((), (3,), (4,))
            or not image.size
        ):
            raise InvalidImageError(f"a picture has shape (H, W) or (H, W, 3); got {image.dtype} {image.shape}")
    if not 0 < height < 100:
        raise InvalidParameterError(f"height is in inches, positive and below 100; got {height}")
    ratios = [np.shape(image)[1] / np.shape(image)[0] for image in rows[0]]
    size = height * sum(ratios) + margins[0], len(rows) * height + margins[1]
    figure = BookFigure(figsize=size, layout="constrained")
    grid = figure.subplots(len(rows), len(ratios), width_ratios=ratios, squeeze=False)
    for ax, image in zip(grid.flat, (np.asarray(image) for row in rows for image in row), strict=True):
        if image.ndim == 2:
            brightest = 1 if image.dtype == bool else None
            ax.imshow(image, cmap="gray", vmin=0, vmax=brightest, interpolation="nearest")
        else:
            ax.imshow(image)
        ax.set(xticks=[], yticks=[])
        ax.spines[:].set_visible(False)
    for ax, title in zip(grid[0], titles, strict=False):
        ax.set_title(title)
    return figure


@style()
def _mark_blob(ax: Axes, blob: Blob | None, weight: float = 1.0, ellipse: bool = False) -> None:
    """Draw a blob's axes and rectangle, and its ellipse on request; ``weight`` scales every line."""
    if blob is None:
        card = {"fc": "white", "ec": "none", "alpha": 0.8}
        ax.text(0.5, 0.12, "no blob", transform=ax.transAxes, ha="center", color=COLORS["vermilion"], bbox=card)
        return
    ax.autoscale(False)  # axes longer than the image do not shrink it
    # Without an orientation any axes are as good; the image's own say that none was found.
    angle = blob.orientation if blob.orientation_defined else 0.0
    major = 0.5 * blob.axis_major_length * np.array([np.cos(angle), np.sin(angle)])
    minor = 0.5 * blob.axis_minor_length * np.array([-np.sin(angle), np.cos(angle)])
    # A rectangle with these second moments has sides of sqrt(12) standard deviations, the ellipse axes of 4.
    side = np.sqrt(12) / 4
    around = side * np.array([major + minor, major - minor, -major - minor, -major + minor, major + minor])
    if ellipse:
        lengths = blob.axis_major_length, blob.axis_minor_length
        ax.add_patch(Ellipse(tuple(blob.centroid), *lengths, angle=float(np.degrees(angle)), color=FAINT))
    halo: dict[str, Any] = {"color": "white", "alpha": 0.75, "solid_capstyle": "round"}
    dash = "-" if blob.orientation_defined else (0, (3, 2))
    for line, color, label, width, edge, cap in (
        ([-major, major], "vermilion", "major", 2, 3.8, "round"),
        ([-minor, minor], "blue", "minor", 2, 3.8, "round"),
        (around, "orange", "rectangle", 1.6, 3.2, "projecting"),
    ):
        points = (blob.centroid + line).T
        ax.plot(*points, lw=edge * weight, **halo)
        ax.plot(*points, color=COLORS[color], lw=width * weight, ls=dash, label=label, solid_capstyle=cap)
    ax.plot(*blob.centroid, "o", ms=6 * weight, mfc="white", mec=COLORS["ink"], mew=1.5 * weight)
