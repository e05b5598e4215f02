"""Where two fingers that come from one direction can close about a thing of any shape, given as cells of space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.checks import checked
from gvp_lib.planning.room import Room

__all__ = ["Grip"]

Array = NDArray[np.float64]

TO_SPARE = 0.006  # m, by which fingers open wider than the widest thing they are to span
REACH, SHARE = 0.040, 0.65  # m and of a thing's height: how deep the fingertips go at most
_TURNS = 12  # of the closing direction, in half a turn
_LIKELY, _CROWDED = 12, 3.0  # grips of a closing direction whose room is looked at; weight of what is taken of it
_OTHER = np.cos(np.radians(35))  # between closing directions, where one is another way to grip
_TOUCH, _ENOUGH, _HOLDS = 0.004, 0.020, 0.15  # m that a pad gives; height of contact, m, that holds well; share of it
_HAND = 0.030  # m: half the breadth of a hand, above the fingers
_ALIKE, _NEAR = np.cos(np.radians(25)), 0.03  # of directions; m, of centers
_OFF_MIDDLE = 0.08  # m off the middle that weighs as much as half of the hold


@dataclass(frozen=True, eq=False)
class Grip:
    """Where two fingers close about a visual hull.

    Attributes
    ----------
    center
        Middle between the fingertips, shape (3,), m, base frame.
    look
        Unit vector from the object to the hand, shape (3,).
    closing
        Unit vector along which the fingers close, across ``look``, shape (3,).
    width
        Width of the hull between the fingers, m; the object's is at most that.
    depth
        How far the fingertips reach below the hull's surface, m; the center lies half as deep.
    hold
        From 0 to 1: how much of the hull both pads would touch at the same heights.
    room
        From 0 to 1: how much of the open fingers' place is seen to be empty.

    Examples
    --------
    >>> from gvp_lib import SpreadViews, WorkCell
    >>> from gvp_lib.planning import VisualHull
    >>> cell = WorkCell(arm="floating", target="alligator", seed=2)
    >>> hull = VisualHull.of(SpreadViews(cell.segmenter).plan(cell.arm).views, cell.arm.intrinsics)
    >>> hull.grips(look=(0, 0, 1))[0]
    Grip(... mm wide at (...) m)
    """

    center: Array
    look: Array
    closing: Array
    width: float
    depth: float
    hold: float
    room: float = 1.0

    def __repr__(self) -> str:
        x, y, z = self.center
        return f"Grip({1000 * self.width:.0f} mm wide at ({x:.3f}, {y:.3f}, {z:.3f}) m)"

    @checked
    def view(self, radius: float) -> RigidTransform:
        """Pose of a camera that looks on the grip: x along the closing axis, as a hand's camera has it.

        Parameters
        ----------
        radius
            Distance from the grip's center, m.
        """
        z = -self.look
        axes = np.column_stack([self.closing, np.cross(z, self.closing), z])
        return RigidTransform.from_components(self.center + radius * self.look, Rotation.from_matrix(axes))


def resemble(one: Grip, other: Grip) -> bool:
    """Whether fingers close about alike by two grips, and about in the same place."""
    alike = min(one.look @ other.look, abs(one.closing @ other.closing)) > _ALIKE
    return bool(alike and np.linalg.norm(one.center - other.center) < _NEAR)


@dataclass(frozen=True, eq=False)
class Cells:
    """What fingers close about."""

    points: Array  # centers of the cells, (n, 3), m, base frame
    side: float  # of a cell, m
    slack: float  # how far the points may lie outside of the thing, m
    room: Room | None  # what is seen to be empty about it; None: unknown

    def grips(
        self, look: Array, beside: Array, opening: tuple[float, float], pad: tuple[float, float], fingers: float
    ) -> tuple[Grip, ...]:
        """The best places for fingers that come along ``look`` and close along ``beside``, across it, or turned about
        it; best first. See :meth:`VisualHull.grips`.
        """
        middle = self.points.mean(axis=0)
        found: list[tuple[float, Grip]] = []
        for angle in np.arange(_TURNS) * (np.pi / _TURNS):
            closing = np.cos(angle) * beside + np.sin(angle) * np.cross(look, beside)
            axes = np.column_stack([closing, np.cross(look, closing), look])
            costs, places = self._holds((self.points - middle) @ axes, opening, pad, fingers)
            likely = np.argsort(costs)[:_LIKELY]
            costs, places = costs[likely], places[likely]
            centers = middle + places[:, :3] @ axes.T
            room = np.ones(len(costs))
            if self.room is not None and len(costs):
                tips = centers - 0.5 * places[:, [4]] * look
                room -= self.room.crowding(tips, axes, opening[1] + TO_SPARE)
                costs = costs + _CROWDED * (1 - room)
            if len(costs):
                k = int(np.argmin(costs))
                width, depth, hold = map(float, places[k, 3:])
                found.append((float(costs[k]), Grip(centers[k], look, closing, width, depth, hold, float(room[k]))))
        kept: list[Grip] = []
        for _, grip in sorted(found, key=lambda each: each[0]):
            if all(abs(grip.closing @ other.closing) < _OTHER for other in kept):
                kept.append(grip)
        return tuple(kept)

    def _holds(
        self, points: Array, opening: tuple[float, float], pad: tuple[float, float], fingers: float
    ) -> tuple[Array, Array]:
        """Costs of grips by fingers that close along the first axis and come along the last, (k,), and what they are,
        (k, 6): centers, widths, depths and holds; of points (n, 3) about their middle.
        """
        across, along, height = points.T
        # In strips of half a pad's breadth, of which fingers close on three at once, and in layers from the top.
        strip, layer = np.rint(2 * along / pad[0]).astype(int), np.rint((height.max() - height) / self.side).astype(int)
        strip += 1 - (lowest := int(strip.min()))  # an empty one at either end
        low, high = np.full((2, strip.max() + 2, layer.max() + 1), [[[np.inf]], [[-np.inf]]])
        np.minimum.at(low, (strip, layer), across)
        np.maximum.at(high, (strip, layer), across)
        windows = np.stack([low[:-2], low[1:-1], low[2:]]), np.stack([high[:-2], high[1:-1], high[2:]])
        least, most = windows[0].min(axis=0), windows[1].max(axis=0)  # (strips, layers)
        filled = np.isfinite(least)
        top = filled.argmax(axis=1)
        hand = round(2 * _HAND / pad[0])
        highest = np.array([top[max(0, k - hand) : k + hand + 1].min() for k in range(len(top))])
        deepest = top + np.minimum(fingers, SHARE * (filled.sum(axis=1) * self.side)) / self.side
        usual = np.minimum(REACH, SHARE * filled.sum(axis=1) * self.side)
        tall, aside = max(1, round(pad[1] / self.side)), 0.5 * pad[0] * (np.arange(len(top)) + lowest)
        outer = self.side - 2 * self.slack  # between the outer faces of cells, less what they may lie outside
        costs, places = [np.empty(0)], [np.empty((0, 6))]
        for tips in range(1, layer.max() + 2):
            pads = slice(max(0, tips - tall), tips)
            one, other = least[:, pads].min(axis=1), most[:, pads].max(axis=1)
            one, other = np.where(one > other, np.nan, (one, other))
            middle, width = 0.5 * (one + other), other - one + outer
            passed = np.maximum(most[:, :tips].max(axis=1) - middle, middle - least[:, :tips].min(axis=1))
            touched = (windows[0][..., pads] <= one[:, None] + _TOUCH) & (
                windows[1][..., pads] >= other[:, None] - _TOUCH
            )
            hold = np.minimum(touched.sum(axis=(0, 2)) * self.side / (3 * _ENOUGH), 1.0)
            depth = (tips - top) * self.side
            cost = 2 * (1 - hold) + (middle**2 + aside**2) / _OFF_MIDDLE**2
            cost = cost + 0.4 * (width / opening[1]) ** 2 + 0.25 * ((depth - usual) / REACH) ** 2
            fits = (
                (width >= opening[0])
                & (2 * passed + outer <= opening[1])
                & (tips <= deepest)
                & ((tips - highest) * self.side <= fingers)
                & (touched.any(axis=2).sum(axis=0) >= 2)
                & (hold >= _HOLDS)
            )
            ahead = height.max() + self.side * (0.5 - 0.5 * (tips + top))
            costs.append(cost[fits])
            places.append(np.column_stack([middle, aside, ahead, width, depth, hold])[fits])
        return np.concatenate(costs), np.concatenate(places)
