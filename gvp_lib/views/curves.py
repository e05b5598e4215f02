"""Curves: what is measured along an arc, over time, or against the truth."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gvp_lib.errors import InvalidParameterError
from gvp_lib.views.figures import COLORS, BookFigure, style

__all__ = ["ratio_curve"]

STRAIGHT_DOWN = "#b9b0a2"


def ratio_curve(tilts_deg: ArrayLike, ratios: ArrayLike, chosen: int | None = None) -> BookFigure:
    """The ratio of a blob's axes along an arc over the object (thesis Figs. 2.3, 2.4).

    Parameters
    ----------
    tilts_deg
        Where the camera stood, shape (n,), degrees from the object's normal.
    ratios
        Minor axis over major axis in each view, shape (n,).
    chosen
        Index of the view to mark.
    """
    x, y = np.asarray(tilts_deg, float), np.asarray(ratios, float)
    if x.ndim != 1 or x.shape != y.shape:
        raise InvalidParameterError(f"give one ratio for each tilt, both of shape (n,); got {x.shape} and {y.shape}")
    with style():
        figure = BookFigure(figsize=(6.4, 2.8), layout="constrained")
        ax = figure.subplots()
        ax.axvline(0, color=STRAIGHT_DOWN, lw=1, ls=(0, (4, 3)), zorder=0)
        ax.plot(x, y, "o-", ms=4)
        if chosen is not None:
            ax.plot(x[chosen], y[chosen], "o", ms=12, mfc="none", mec=COLORS["vermilion"], mew=2)
        ax.set(xlabel="tilt from the object's normal [deg]", ylabel="minor axis / major axis")
    return figure
