"""What the chapters' figures share: their style, colors and panels."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import cycle
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes

from gvp_lib.views.figures import COLORS, STYLE, BookFigure

FAINT, RING, GRAY = "#b9b0a2", "#d9d2c6", "#6f675b"  # lines to compare with; rings and bars behind; small text
DASH = (0, (4, 3))

styled = mpl.rc_context(STYLE)  # type: ignore[arg-type]
"""Decorator of a function that draws in the book's style."""


def plate(
    width: float, height: float, columns: int = 1, rows: int = 1, **options: Any
) -> tuple[BookFigure, list[Axes]]:
    """New figure, its size in inches, and its axes row by row; options as for ``Figure.subplots``."""
    figure = BookFigure(figsize=(width, height), layout="constrained")
    return figure, list(figure.subplots(rows, columns, squeeze=False, **options).flat)


def bare(ax: Axes) -> None:
    """Remove ticks and frame, for an image."""
    ax.set(xticks=[], yticks=[])
    ax.spines[:].set_visible(False)


def colored(
    items: Mapping[str, Any], order: str = "blue vermilion green orange purple sky"
) -> Iterator[tuple[str, Any, str]]:
    """Name, value, and color of each item, cycling through colors in the order given."""
    for (name, value), color in zip(items.items(), cycle(order.split()), strict=False):
        yield name, value, COLORS[color]
