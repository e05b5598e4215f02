"""Diagrams that explain perception: the hue circle, what a blob's axes mean, and what turning the camera does."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import matplotlib.colors
import numpy as np
from matplotlib.patches import Ellipse, Polygon
from numpy.typing import ArrayLike, NDArray

from gvp_book.plots.drawing import bare, plate, styled
from gvp_lib.perception.blobs import Blob
from gvp_lib.perception.hsv import rgb_to_hsv
from gvp_lib.views.figures import COLORS, BookFigure

_BINS = 120


@styled
def hue_circle(pixels: NDArray[np.uint8], hue: tuple[float, float] | None = None) -> BookFigure:
    """Draw a histogram of the hues of RGB ``pixels``, shape (..., 3), around the color circle.

    Hue 0 is on the right, and angles run counterclockwise. Each pixel is weighted by its saturation, since the hue of a
    gray means nothing. ``hue`` is a range to mark, degrees; a start above the end wraps through 0.
    """
    hsv = rgb_to_hsv(pixels).reshape(-1, 3)
    edges = np.linspace(0, 2 * np.pi, _BINS + 1)
    counts, _ = np.histogram(np.radians(hsv[:, 0]), edges, weights=hsv[:, 1])
    height = np.sqrt(counts / max(counts.max(), 1e-9))
    middles = 0.5 * (edges[1:] + edges[:-1])
    figure = BookFigure(figsize=(3.9, 3.9), layout="constrained")
    ax: Any = figure.add_subplot(projection="polar")
    wheel = [mpl.colors.hsv_to_rgb((x / (2 * np.pi), 0.75, 0.9)) for x in middles]
    ax.bar(middles, np.full(_BINS, 0.16), edges[1], bottom=1.12, color=wheel, lw=0)
    ax.bar(middles, 0.66 * height, edges[1], bottom=0.42, color=wheel, lw=0)
    if hue is not None:
        start, span = np.radians(hue[0]), np.radians((hue[1] - hue[0]) % 360 or 360)
        along = np.linspace(start, start + span, 60)
        ax.fill_between(along, 0.42, 1.3, color=COLORS["ink"], alpha=0.13, lw=0)
        ax.plot(along, np.full(60, 1.34), color=COLORS["ink"], lw=2)
        ax.text(0, 0, f"{hue[0]:.0f}° to {hue[1]:.0f}°", ha="center", va="center", fontsize=9.5)
    ax.set(ylim=(0, 1.36), yticks=[])
    ax.set_xticks(np.radians(np.arange(0, 360, 60)), [f"{x}°" for x in range(0, 360, 60)])
    ax.grid(visible=False)
    ax.spines["polar"].set_visible(False)
    return figure


@styled
def same_moments(masks: Sequence[NDArray[np.bool_]], titles: Sequence[str] = ()) -> BookFigure:
    """Draw the ellipse and the rectangle that have the same moments, up to the second, as each mask's blob.

    Any shape has both: moments see only mass, center, and spread. Where the axes are undefined, the ellipse is drawn as
    the circle it nearly is, without axes.
    """
    blobs = [blob for mask in masks if (blob := Blob.from_mask(mask)) is not None]
    ratios = [mask.shape[1] / mask.shape[0] for mask in masks]
    figure, axes = plate(2.3 * sum(ratios), 2.75, len(masks), width_ratios=ratios)
    for ax, mask, blob, title in zip(axes, masks, blobs, titles or [""] * len(masks), strict=True):
        ax.imshow(np.where(mask[..., None], (221, 214, 203), (255, 255, 255)).astype(np.uint8))
        ax.set_title(title)
        bare(ax)
        u, v = blob.centroid
        angle = blob.orientation if blob.orientation_defined else 0.0
        lengths = blob.axis_major_length, blob.axis_minor_length
        major = 0.5 * lengths[0] * np.array([np.cos(angle), np.sin(angle)])
        minor = 0.5 * lengths[1] * np.array([-np.sin(angle), np.cos(angle)])
        outline: dict[str, Any] = {"fill": False, "lw": 1.8}
        ax.add_patch(Ellipse((u, v), *lengths, angle=float(np.degrees(angle)), ec=COLORS["vermilion"], **outline))
        if blob.orientation_defined:
            side = np.sqrt(12) / 4  # a rectangle's side over the axis of the ellipse with its moments
            corners = side * np.array([major + minor, major - minor, -major - minor, -major + minor])
            ax.add_patch(Polygon(blob.centroid + corners, ec=COLORS["blue"], ls=(0, (4, 2)), **outline))
            for axis in (major, minor):
                ax.plot([u - axis[0], u + axis[0]], [v - axis[1], v + axis[1]], color=COLORS["vermilion"], lw=1.2)
        ax.plot(u, v, "o", ms=5, mfc="white", mec=COLORS["ink"], mew=1.4)
    return figure


@styled
def roll_response(roll: ArrayLike, blobs: Sequence[Blob]) -> BookFigure:
    """Plot what a roll of the camera changes: the blob's orientation follows it, the lengths of its axes stay the same.

    ``roll`` is the camera's roll at each blob, rad, rising or falling in steps below 90 degrees.
    """
    turned = np.degrees(np.asarray(roll, float))
    theta = np.degrees([blob.orientation for blob in blobs])
    figure, (left, right) = plate(8.0, 2.9, 2)
    expected = (theta[0] - (turned - turned[0]) + 90) % 180 - 90
    breaks = np.flatnonzero(np.abs(np.diff(expected)) > 90) + 1
    left.plot(np.insert(turned, breaks, np.nan), np.insert(expected, breaks, np.nan), color="#b9b2a6", lw=4)
    left.plot(turned, theta, "o", ms=4.5, color=COLORS["vermilion"])
    left.set(xlabel="wrist [deg]", ylabel="orientation [deg]", ylim=(-95, 95), yticks=[-90, -45, 0, 45, 90])
    for name, color in (("major", "vermilion"), ("minor", "blue")):
        lengths = [getattr(blob, f"axis_{name}_length") for blob in blobs]
        right.plot(turned, lengths, "o-", ms=4.5, lw=1, color=COLORS[color])
        right.annotate(f"{name} axis", (turned.min(), lengths[0] * 1.03 + 1), color=COLORS[color], va="bottom")
    right.set(xlabel="wrist [deg]", ylabel="length [px]")
    right.set_ylim(0, 1.3 * max(blob.axis_major_length for blob in blobs))
    return figure
