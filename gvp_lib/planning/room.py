"""The room that is left about an object for a hand: what some view shows to be empty, down to the table.

Where a picture shows the table, nothing stands between; what no view shows through may be taken by something else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.sighting import THUMBNAIL, View

__all__ = ["Room", "is_foreign"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_COLOR = np.array([1.0, 1.5, 1.5])  # CIELAB: lightness says less, for it changes with the light
_ALIKE, _FOREIGN = 15.0, 25.0  # between colors that are one, and between that of the table and another
BREADTH, _THICKNESS, _LENGTH = 0.016, 0.011, 0.060  # m, of a finger, across, outward, and upward from its tip


def _usual(colors: Array) -> Array | None:
    """The most frequent of colors (..., 3), CIELAB by weight; None without any."""
    known = colors[np.isfinite(colors).all(-1)]
    if not len(known):
        return None
    sample = known[:: max(1, len(known) // 150)]
    near = np.linalg.norm(sample[:, None] - sample, axis=-1) < _ALIKE
    return np.asarray(np.median(sample[near[near.sum(1).argmax()]], axis=0))


def is_foreign(colors: Array) -> Flags:
    """Where a color is not about the most frequent one of all views, which is the table's; colors (n, m, 3), CIELAB."""
    colors = colors * _COLOR
    table = _usual(colors)
    if table is None:
        return np.zeros(colors.shape[:-1], bool)
    return np.asarray(np.linalg.norm(colors - table, axis=-1) > _FOREIGN)  # what is not known is not foreign


@dataclass(frozen=True, eq=False)
class Room:
    """What views show to be empty."""

    shows_through: Flags  # which pixels of a thumbnail show what the object stands on, or the table, (n, h, w)
    base_from_camera: Sequence[RigidTransform]
    intrinsics: CameraIntrinsics

    @classmethod
    def of(cls, views: Sequence[View], intrinsics: CameraIntrinsics) -> Self | None:
        """Of views with their thumbnails; None of others."""
        seen = [view for view in views if view.thumbnail is not None]
        colors = [view.outline.colors for view in seen if view.outline is not None]
        if not colors:
            return None
        rgb = np.array([view.thumbnail for view in seen], np.float32) / 255
        lab = _COLOR * np.array([cv2.cvtColor(each, cv2.COLOR_RGB2LAB) for each in rgb])
        # What the object stands on, and the table, which are two where it stands on a block.
        empty = [_usual(_COLOR * np.array(colors)), _usual(lab)]
        apart = [np.linalg.norm(lab - color, axis=-1) for color in empty if color is not None]
        return cls(np.min(apart, axis=0) < _FOREIGN, [view.base_from_camera for view in seen], intrinsics)

    def taken(self, points: Array) -> Flags:
        """Which points, (n, 3), m, base frame, no view that has them in its picture shows to be empty."""
        empty, shown_at_all = np.zeros((2, len(points)), bool)
        lens, (height, width) = self.intrinsics, self.shows_through.shape[1:]
        for through, pose in zip(self.shows_through, self.base_from_camera, strict=True):
            x, y, z = ((points - pose.translation) @ pose.rotation.as_matrix()).T
            ahead = np.where(z > 1e-3, z, np.nan)
            u, v = (
                np.nan_to_num(each / THUMBNAIL, nan=-1.0).astype(int)
                for each in (lens.fx * x / ahead + lens.cx, lens.fy * y / ahead + lens.cy)
            )
            shown = (u >= 0) & (v >= 0) & (u < width) & (v < height)
            empty[shown] |= through[v[shown], u[shown]]
            shown_at_all |= shown
        return shown_at_all & ~empty

    def crowding(self, tips: Array, axes: Array, opening: float) -> Array:
        """Share of an open finger's place that may be taken, of the worse of two fingers, 0 to 1, shape (n,).

        Parameters: middles between the fingertips, (n, 3), m, base frame; the directions in which the fingers close,
        that across, and that from which they come, as columns; and the width between them, m.
        """
        out = 0.5 * opening + np.linspace(0.1, 0.9, 3) * _THICKNESS
        across, up = np.linspace(-0.4, 0.4, 3) * BREADTH, np.linspace(0.0, 1.0, 6) * _LENGTH
        place = np.stack(np.meshgrid(out, across, up, indexing="ij"), axis=-1).reshape(-1, 3)
        sides = np.stack([place, place * (-1, 1, 1)])  # (2, m, 3)
        points = tips[:, None, None] + sides @ axes.T
        taken = self.taken(points.reshape(-1, 3)).reshape(len(tips), 2, -1)
        return np.asarray(taken.mean(axis=-1).max(axis=-1))
