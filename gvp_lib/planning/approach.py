"""From where a hand takes hold of an object: along the normal of a face that its fingers span, so that they close on
the shorter side and clear of what stands beside it; or where they find a hold on the visual hull.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.motion.sighting import View
from gvp_lib.planning.grips import REACH, SHARE, TO_SPARE, Grip, resemble
from gvp_lib.planning.hull import VisualHull
from gvp_lib.planning.room import Room
from gvp_lib.planning.solids import FittedSolid

__all__ = ["Fingers", "poses_about", "poses_along"]

Array = NDArray[np.float64]
Rank = Callable[[Rotation], float]
"""How good a camera's rotation is: the lowest the best, infinite for one that does not do."""

_LEAN = np.radians(10)  # at most, between the leans that are tried
_SQUARE = 0.06  # relative difference of two sides below which neither is the longer
_SEEN = np.cos(np.radians(75))  # of a face, from where the first view was taken
_TO_SPARE = 0.003  # m, of the least width between the fingers
_FROM_ABOVE = 0.5  # of the way to a hull, upward: lower a hand meets what the object stands on
_RANKS, _CROWDED, _MORE = 5, 2, 0.2  # of the room for fingers; share of it that makes up for closing on a longer side
_AMPLE = 0.016  # m, that fingers have to spare about a slender thing
_CORE = 0.85  # of the middle third of a box along each of its axes, which a slender thing fills
_LONGER = 0.1  # by which one of two sides is the longer
_SAME = np.cos(np.radians(1))
_HOLDS = 0.6  # of a grip's best hold, which is good enough not to look from elsewhere


@dataclass(frozen=True)
class Fingers:
    """Two fingers, and how they come to an object."""

    opening: tuple[float, float]  # least and largest width between them, m
    length: float  # m, how deep they can reach about a hull
    failed: tuple[Grip, ...] = ()  # grips that held nothing, before

    @property
    def fit(self) -> tuple[float, float]:
        """Least and largest width of what they are to close about, m."""
        return self.opening[0] + _TO_SPARE, self.opening[1] - TO_SPARE

    # --- to a solid that explains the views ---

    def facing(self, solid: FittedSolid, first: View) -> FittedSolid:
        """A box with the normal of its nearest face that the fingers can span."""
        if solid.kind != "box":
            return solid
        axes, lengths = solid.base_from_solid.rotation.as_matrix(), solid.lengths
        toward = axes.T @ (first.base_from_camera.translation - solid.base_from_solid.translation)
        for k in np.argsort(-np.abs(toward)):
            normal = axes[:, k] * np.sign(toward[k])
            nearest = normal @ solid.normal > _SAME
            if (nearest or normal[2] > _FROM_ABOVE) and np.delete(lengths, k).min() <= self.fit[1]:
                return replace(solid, normal=normal)
        return solid

    def rank(self, solid: FittedSolid, room: Room | None) -> Rank:
        """Rank of a camera's roll by how much of the fingers' place may be taken; infinite for one by which they close
        on the longer side, unless they have much more room there.
        """
        corners = solid.corners

        def taken(axes: Array) -> float:
            if room is None:
                return 0.0
            height = corners @ axes[:, 2]
            tips = height.max() - min(REACH, SHARE * float(np.ptp(height)))
            center = solid.base_from_solid.translation
            places = (center + (tips - center @ axes[:, 2]) * axes[:, 2])[None]
            return float(room.crowding(places, axes, self.opening[1])[0])

        def rank(rotation: Rotation) -> float:
            axes = rotation.as_matrix() * (1, -1, -1)
            width, length = np.ptp(corners @ axes[:, :2], axis=0)
            here = taken(axes)
            if width > length * (1 + _LONGER):
                otherwise = taken(np.column_stack([axes[:, 1], -axes[:, 0], axes[:, 2]]))
                return float(_RANKS * here) if width <= self.fit[1] and here + _MORE < otherwise else np.inf
            return float(np.floor(_RANKS * here))

        return rank

    def clear_of_others(self, solid: FittedSolid, room: Room | None, rank: Rank, first: View) -> tuple[Grip, ...]:
        """Grips along a solid's normal that are clear of what stands beside it, where its middle is not, best first."""
        along = poses_along(solid, first, 1.0, 0.0, rank)
        if room is None or rank(along[0].rotation) < _CROWDED or self.fit[0] >= self.fit[1]:
            return ()
        grips = VisualHull.filling(solid, room).grips(solid.normal, self.fit, fingers=self.length)
        return tuple(grip for grip in grips if _RANKS * (1 - grip.room) < _CROWDED - 1)

    # --- to the visual hull of what no solid explains ---

    def pass_middle(self, hull: VisualHull) -> bool:
        """Whether they can close about its middle whichever side it shows, and something is there."""
        if np.sort(hull.lengths)[1] > self.opening[1] - _AMPLE:
            return False
        axes, center = hull.base_from_box.rotation.as_matrix(), hull.base_from_box.translation
        core = (np.abs((hull.points - center) @ axes) < hull.lengths / 6).all(axis=1).sum()
        return bool(core * hull.cell**3 > _CORE * (hull.lengths / 3).prod())

    def grips(self, hull: VisualHull, solid: FittedSolid, first: View) -> tuple[Grip, ...]:
        """How to grip a hull, best first: along the normal of the nearest face of its box that gives a hold, or from
        above, and then otherwise.
        """
        axes = solid.base_from_solid.rotation.as_matrix().T
        faces = sorted([*axes, *-axes], key=lambda face: float(face @ first.line_of_sight))
        seen = [face for face in faces if face @ first.line_of_sight < -_SEEN and face[2] > _FROM_ABOVE]
        found: list[tuple[Grip, ...]] = []
        for look in (*seen, hull.above) if self.fit[0] < self.fit[1] else ():
            if grips := hull.grips(look, self.fit, fingers=self.length):
                found.append(grips)
                if self._worth(grips[0]) >= _HOLDS:
                    break
        return tuple(sorted((grip for grips in found for grip in grips), key=self._worth, reverse=True))

    def _worth(self, grip: Grip) -> float:
        return grip.hold - 2 * (1 - grip.room) - 2 * any(resemble(grip, other) for other in self.failed)


def upright(solid: FittedSolid, above: Array) -> FittedSolid:
    """A slender box, which looks much alike from all about its longest axis, with a normal as near as that axis allows
    to the normal of what it stands on; as it is, where it stands on end.
    """
    along = solid.base_from_solid.rotation.as_matrix()[:, np.argmax(solid.lengths)]
    up = above - (along @ above) * along
    return solid if np.linalg.norm(up) < _FROM_ABOVE else replace(solid, normal=up / np.linalg.norm(up))


def poses_along(
    solid: FittedSolid,
    first: View,
    radius: float,
    lean: float,
    rank: Rank | None = None,
) -> tuple[RigidTransform, ...]:
    """``base_from_camera`` along the normal: x on the minor axis, y on the major one, nearest roll first; or by a rank,
    and then turned by a quarter as well.
    """
    axes, center = solid.base_from_solid.rotation.as_matrix(), solid.base_from_solid.translation
    lengths = solid.lengths
    # The solid's axes across the normal; one that was not believed stands on no axis of the solid.
    facing, about = int(np.argmax(np.abs(axes.T @ solid.normal))), "x"
    if solid.kind == "cylinder":
        lying = abs(axes[:, 2] @ solid.normal) < 0.5
        y = axes[:, 2] if lying else first.base_from_camera.rotation.as_matrix()[:, 1]
        if lying:
            about = "yx"
        if lying and lengths[2] < lengths[0]:
            y, about = np.cross(solid.normal, y), "xy"  # a disk on its edge is longer across its axis
        count = 2 if lying else 8
    else:
        i, j = np.delete(np.arange(3), facing)
        y = axes[:, i] if lengths[i] >= lengths[j] else axes[:, j]
        count = 4 if abs(lengths[i] - lengths[j]) < _SQUARE * max(lengths[i], lengths[j]) or rank else 2
    z = -solid.normal
    x = np.cross(y, z)
    x /= np.linalg.norm(x)
    aligned = Rotation.from_matrix(np.column_stack([x, np.cross(z, x), z]))
    turned = [aligned * Rotation.from_rotvec([0.0, 0.0, k * (2 * np.pi / count)]) for k in range(count)]
    return poses_about(center, turned, first, radius, lean, rank, about)


def poses_about(
    center: Array,
    looking: Sequence[Rotation],
    first: View,
    radius: float,
    lean: float = 0.0,
    rank: Rank | None = None,
    about: str = "x",
) -> tuple[RigidTransform, ...]:
    """``base_from_camera`` about a center for cameras of these rotations, the one nearest to a view's first."""
    here = first.base_from_camera.rotation
    ranked = [(0.0 if rank is None else rank(each), float((here.inv() * each).magnitude()), each) for each in looking]
    turned = [each for order, _, each in sorted(ranked, key=lambda each: each[:2]) if np.isfinite(order)]
    # Where no roll can be reached at the radius, a little further away or nearer one may be; or, at the radius, one
    # that leans: a lying can, about its own axis, from which it looks the same.
    count = int(np.ceil(lean / _LEAN))
    leans = [(axis, sign * lean * k / count) for axis in about for k in range(1, count + 1) for sign in (1, -1)]
    ways = [(share, Rotation.identity()) for share in (1.0, 1.2, 0.85)]
    ways += [(1.0, Rotation.from_euler(axis, angle)) for axis, angle in leans]
    leaning = Rotation.concatenate([rotation * way for _, way in ways for rotation in turned])
    distances = radius * np.repeat([share for share, _ in ways], len(turned))
    return tuple(RigidTransform.from_components(center - distances[:, None] * leaning.as_matrix()[:, :, 2], leaning))
