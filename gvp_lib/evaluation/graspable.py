"""From where a two-finger hand would hold an object: the judge's canonical view for any shape. Thesis 2.3.

A hand that descends along its camera's optical axis and closes along the camera's x is followed by rays, through the
geoms of the object and of what stands around it: how far down the fingers get, what lies between the pads there, and
whether the two of them hold it. It knows the truth; a planner that uses it is a defect.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import minimum_filter
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.checks import checked, finite
from gvp_lib.errors import InvalidParameterError
from gvp_lib.evaluation.episodes import RADIUS, canonical_views
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.motion.arm import Outcome
from gvp_lib.planning.closing import SizedDepth
from gvp_lib.simulation.rays import RayScene
from gvp_lib.simulation.workcell import WorkCell

__all__ = ["GraspableView", "JudgedGrip", "GripJudge"]

Array = NDArray[np.float64]

_PITCH = 0.001  # m, between the rays that scan what the pads close on
_COARSE = 0.004  # m, between those that look for a place to grasp
_BLOCKS: dict[Literal["target", "around"], Outcome] = {"target": Outcome.TOO_WIDE, "around": Outcome.COLLISION}
_FAR = 1.0  # m: nothing of an object lies farther from a camera that looks at it
_AIR = 0.001  # m, left between the hand and whatever is in its way
_LEAST = 0.004  # m, of the object that the pads reach at the least
_SKIN = 0.0008  # m: what comes so near to where a pad touches first is touched, too, as skin and object give
_SLIP, _SLIPS = 0.004, 20  # m, by which fingers may slip off a slant until they hold, and steps of a ray's pitch
_TURNS = np.radians(np.arange(5, 50, 5))  # of an object between the pads, step by step
_ASIDE = 0.010  # m, of an object from the middle between the pads: beyond, one pushes it away before both hold it
_SHUT = 0.001  # m, by which fingers with something between them stand wider than shut
_STUCK = 0.004  # m: fingers that have moved less, their skins included, a GraspExecutor takes for jammed
_DEPTHS = 0.004  # m, between depths that are tried
_SURE = 3  # depths in a row that hold, of one that nobody asked for
_POINTS = 60  # of a pad's contact, that stand for all
_RULE = SizedDepth()  # how deep a hand closes whose depth nobody tells

_TILTS, _APART = np.radians((0, 15, 30, 45)), np.radians(30)  # from the wanted direction, in rings; along each
_ROLLS = np.radians(np.arange(0, 180, 15))  # half a turn of the hand changes nothing
_FLUSH = np.radians((0, -3, 3, -6, 6))  # turns, of which the one in which it is narrowest lies flush with the pads
_KEPT = 3  # places of a direction that are looked at closely
_ROBUST = 0.6  # margin of a view that nothing more is asked of
_NUDGES = (0.004, np.radians(4.0))  # m and rad, to either side: what an arm's error may be


@dataclass(frozen=True)
class JudgedGrip:
    """What becomes of a hand that descends along its optical axis and closes; true where it holds the object.

    Attributes
    ----------
    outcome
        ``HELD``, or why not: ``TOO_WIDE`` or ``COLLISION``, a finger would land on the object or on what is around it;
        ``EMPTY``, there is nothing between the pads, or less than shut fingers leave; ``SLIPPED``, it would slip out.
    travel
        Way of the hand along its optical axis before it closes, m.
    width
        Distance between the pads when they have closed, m; NaN where they meet nothing.
    turn
        Angle by which the object turns about the hand's axis until it lies flush with the pads, rad; 0 where they hold
        it as they meet it.

    Examples
    --------
    >>> from gvp_lib.evaluation import JudgedGrip
    >>> JudgedGrip("held", travel=0.18, width=0.032)
    JudgedGrip(held after 180 mm, pads 32 mm apart)
    """

    outcome: Outcome
    travel: float
    width: float = np.nan
    turn: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "outcome", Outcome(self.outcome))

    def __bool__(self) -> bool:
        return self.outcome is Outcome.HELD

    def __repr__(self) -> str:
        apart = f", pads {1000 * self.width:.0f} mm apart" if np.isfinite(self.width) else ""
        turned = f", turned by {np.degrees(self.turn):.0f} deg" if self.turn else ""
        return f"JudgedGrip({self.outcome} after {1000 * self.travel:.0f} mm{apart}{turned})"


@dataclass(frozen=True, eq=False)
class GraspableView:
    """View from which a two-finger hand holds an object.

    Attributes
    ----------
    world_from_camera
        Pose of the camera: the hand descends along z and closes along x.
    grip
        JudgedGrip from there.
    margin
        Share of slightly displaced views that hold it, too; see :meth:`GripJudge.margin`.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> from gvp_lib.evaluation import GripJudge
    >>> next(GripJudge(WorkCell(target="alligator", seed=1)).views())
    GraspableView(0 deg off the vertical, margin 1.00, JudgedGrip(held after 175 mm, pads 33 mm apart))
    """

    world_from_camera: RigidTransform
    grip: JudgedGrip
    margin: float

    def __repr__(self) -> str:
        tilt = np.degrees(np.arccos(np.clip(-self.world_from_camera.rotation.as_matrix()[2, 2], -1, 1)))
        return f"GraspableView({tilt:.0f} deg off the vertical, margin {self.margin:.2f}, {self.grip})"


@checked
class GripJudge:
    """Judge of what the two fingers of a cell's hand would hold, for the objects as they stand now.

    The open hand descends until the fingers are two thirds down the object, or less where something is in their way;
    where they would not hold it there, other depths are tried. As they close, each pad touches whatever comes first. It
    is held where a line between two points of contact lies in the friction cones of both: about a pad's normal where
    something meets the pad's face, about the object's where a pad's border meets a slant. Fingers that would slip off
    a slant do so, until they hold.

    Rays meet a mesh itself, where MuJoCo's contacts take its convex hull; an object that is not convex has to be a
    union of convex geoms for both to agree.

    Parameters
    ----------
    cell
        Work cell with a gripper; of the dynamics, nothing changes.

    Raises
    ------
    ModelError
        The arm has no gripper.

    Notes
    -----
    ``python tests/benchmarks/grips.py`` holds it against grasps under physics.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> from gvp_lib.evaluation import GripJudge, canonical_views
    >>> cell = WorkCell(target="cuboid_1x4", seed=1)
    >>> judge, (view, _) = GripJudge(cell), canonical_views(cell)
    >>> judge.grip(view)
    JudgedGrip(held after 176 mm, pads 32 mm apart)
    >>> judge.grip(view * RigidTransform.from_rotation(Rotation.from_rotvec([0, 0, np.pi / 2])))
    JudgedGrip(too wide after ... mm)
    """

    def __init__(self, cell: WorkCell) -> None:
        self._cell, self._hand, (self._shut, self._wide) = cell, cell.gripper.hand, cell.gripper.stroke
        self._scene = scene = RayScene(cell)
        self._thickness, self._breadth, half_length = scene.halves[scene.pad].tolist()
        self._length = 2 * half_length
        self._radius = float(np.linalg.norm(cell.target_spec.bounding_box().half_extents))

    def __repr__(self) -> str:
        return f"GripJudge({self._cell.target_spec.name}, pads up to {1000 * self._wide:.0f} mm apart)"

    def grip(self, world_from_camera: RigidTransform | None = None) -> JudgedGrip:
        """Judge a hand that descends from a view.

        Parameters
        ----------
        world_from_camera
            View; None for that of the cell's camera as the judge was made.
        """
        view = self._scene.world_from_camera if world_from_camera is None else world_from_camera
        near, far = self._extent(view)
        if not np.isfinite(near):
            return JudgedGrip(Outcome.EMPTY, 0.0)
        clear, end = self._way(view)
        deepest = min(clear, near - _AIR - self._hand.palm) + self._hand.tips
        if deepest < near + _LEAST:
            return JudgedGrip(end, deepest - self._hand.tips)
        wanted = min(near + min(_RULE.reach, _RULE.share * (far - near)), deepest)
        steps = np.arange(np.ceil((near + _LEAST - wanted) / _DEPTHS), np.floor((deepest - wanted) / _DEPTHS) + 1)
        depths = [wanted, *(wanted + _DEPTHS * steps[steps != 0][::-1])]
        # Rows and columns of the scan, so that the border of the pads is among them at each depth.
        rows = wanted + _PITCH * np.arange(np.floor((near - wanted) / _PITCH), (deepest + _SLIP - wanted) // _PITCH + 1)
        columns = _ticks(self._breadth + _SLIP, _PITCH)
        sides = [self._scan(view, sign, columns, rows) for sign in (1, -1)]
        grips: list[JudgedGrip] = []
        for depth in depths:
            outcome, width = self._close(sides, columns, rows, depth)
            grips.append(JudgedGrip(outcome, float(depth - self._hand.tips), width))
            if all(grips) or (len(grips) > _SURE and all(grips[-_SURE:])):
                return grips[0] if grips[0] else grips[-_SURE]
        return self._turned(view, columns, rows, grips[0]) if grips[0].outcome is Outcome.SLIPPED else grips[0]

    def _turned(self, view: RigidTransform, columns: Array, rows: Array, grip: JudgedGrip) -> JudgedGrip:
        """What becomes of a grip in which the object turns about the hand's axis, until it lies flush or slips out."""
        for sense in (1, -1):
            width = grip.width
            for angle in sense * _TURNS:
                turned = view * _roll(angle)
                sides = [self._scan(turned, sign, columns, rows) for sign in (1, -1)]
                outcome, narrower = self._close(sides, columns, rows, grip.travel + self._hand.tips)
                if not narrower < width:
                    break
                if outcome is not Outcome.SLIPPED:
                    return JudgedGrip(outcome, grip.travel, narrower, float(abs(angle)))
                width = narrower
        return grip

    def margin(self, world_from_camera: RigidTransform | None = None) -> float:
        """Share of views 4 mm to either side and 4 deg to either side, about each axis, that hold the object, too.

        Parameters
        ----------
        world_from_camera
            As in :meth:`grip`.
        """
        view = self._scene.world_from_camera if world_from_camera is None else world_from_camera
        x, y, z = np.eye(3)
        shift, angle = _NUDGES
        ahead = RigidTransform.from_translation([0, 0, view.inv().apply(self._scene.center)[2]])
        nudges = [RigidTransform.from_translation(sign * shift * axis) for axis in (x, y) for sign in (1, -1)]
        for axis in (x, y, z):  # about the object, which stays in the middle
            for sign in (1, -1):
                turn = RigidTransform.from_rotation(Rotation.from_rotvec(sign * angle * axis))
                nudges.append(ahead * turn * ahead.inv())
        return float(np.mean([bool(self.grip(view * nudge)) for nudge in nudges]))

    def views(self, radius: float = RADIUS, toward: ArrayLike | None = None) -> Iterator[GraspableView]:
        """Views from which the hand holds the object, best first.

        Those by the object's canonical normal come first (:func:`canonical_views`), where they hold with some margin.
        Then others are searched for in rings about a wanted direction, up to 45 deg from it, the hand's axis near the
        object's center of mass; a ring's surest come first, those with too little margin last of all. The search runs
        as views are asked for.

        Parameters
        ----------
        radius
            Distance between the camera and the object's center along the optical axis, m.
        toward
            Wanted direction from the object to the camera, shape (3,), world frame; None for the accepted normal.
        """
        if not 0 < radius < _FAR:
            raise InvalidParameterError(f"a view's radius is positive and below {_FAR:g} m; got {radius}")
        if toward is None:
            for view in canonical_views(self._cell, radius):
                if (grip := self.grip(view)) and (margin := self.margin(view)) >= _ROBUST:
                    yield GraspableView(view, grip, margin)
            toward = self._cell.truth.normal.direction
        finite((3,), toward=toward)
        sphere, poor = VirtualSphere(self._scene.center, radius, np.asarray(toward, float)), []
        for tilt in _TILTS:
            count = max(1, round(2 * np.pi * np.sin(tilt) / _APART))
            found = []
            for azimuth in 2 * np.pi / count * np.arange(count):
                view = sphere.viewpoint(tilt, azimuth)
                if view.rotation.as_matrix()[2, 2] < 0:  # from below, the hand would come through the table
                    found += self._search(view)
            found.sort(key=lambda each: -each.margin)
            yield from (each for each in found if each.margin >= _ROBUST)
            poor += [each for each in found if each.margin < _ROBUST]
        yield from sorted(poor, key=lambda each: -each.margin)

    def _search(self, view: RigidTransform) -> list[GraspableView]:
        """Graspable views in the direction of a view, the hand anywhere over the object and at any roll."""
        m = int(np.ceil((self._wide / 2 + 2 * self._thickness) / _COARSE))
        n = int(np.ceil(self._radius / _COARSE)) + m
        ticks = _COARSE * np.arange(-n, n + 1)
        x, y = np.meshgrid(ticks, ticks)
        target, around = (self._scene.depths(view, x, y, what) for what in _BLOCKS)
        center = view.inv().apply(self._scene.mass_center)
        off = np.hypot(x - center[0], y - center[1])
        places: list[tuple[float, RigidTransform]] = []
        for roll in _ROLLS:
            a, b = x[n - m : n + m + 1, n - m : n + m + 1], y[n - m : n + m + 1, n - m : n + m + 1]
            u, v = np.cos(roll) * a + np.sin(roll) * b, np.cos(roll) * b - np.sin(roll) * a  # in the turned hand
            beside = np.abs(v) < self._breadth + _COARSE / 2
            fingers = beside & (np.abs(np.abs(u) - self._wide / 2 - self._thickness) < self._thickness + _COARSE / 2)
            between = beside & (np.abs(u) < self._wide / 2)
            lowest = minimum_filter(np.minimum(target, around), footprint=fingers, mode="nearest")
            near = minimum_filter(target, footprint=between, mode="nearest")
            deep = np.subtract(lowest, near, out=np.full_like(near, -np.inf), where=np.isfinite(near))
            worth = np.where(deep > 2 * _LEAST, np.minimum(deep, _RULE.reach) - off, -np.inf)
            k = int(np.argmax(worth))
            place = view * RigidTransform.from_translation([x.flat[k], y.flat[k], 0.0]) * _roll(roll)
            places.append((float(worth.flat[k]), place))
        found = []
        for _, place in sorted(places, key=lambda place: -place[0])[:_KEPT]:
            turned = [place * _roll(angle) for angle in _FLUSH]
            grips = [(grip.width, i, grip) for i, grip in enumerate(map(self.grip, turned)) if grip and not grip.turn]
            if grips:
                _, i, grip = min(grips)
                margin = self.margin(turned[i])
                found += [GraspableView(each, grip, margin) for each in (turned[i], turned[i] * _roll(np.pi))]
        return found

    # --- what rays tell -----------------------------------------------------------------------------------------------

    def _extent(self, view: RigidTransform) -> tuple[float, float]:
        """Nearest and farthest point of the object between the open fingers, along the optical axis, m."""
        x, y = np.meshgrid(_ticks(self._wide / 2 - _PITCH, _COARSE), _ticks(self._breadth, _COARSE))
        below = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, _FAR)])
        back, _ = self._scene.hits(view, below, (0, 0, -1))
        return float(self._scene.depths(view, x, y, "target").min()), float(_FAR - back.min())

    def _way(self, view: RigidTransform) -> tuple[float, Outcome]:
        """Way that the open fingers can go along the optical axis, m, and what it means that it ends there."""
        way, end = np.inf, Outcome.COLLISION
        for (x, y, z), (a, b, c) in zip(self._scene.middles, self._scene.halves, strict=True):
            u, v = np.meshgrid(x + _ticks(a + _AIR, 2 * _PITCH), y + _ticks(b + _AIR, 2 * _PITCH))
            for what, meant in _BLOCKS.items():
                ahead = float(self._scene.depths(view, u, v, what).min()) - (z + c) - _AIR
                if ahead < way:
                    way, end = ahead, meant
        return way, end

    def _scan(self, view: RigidTransform, sign: int, columns: Array, rows: Array) -> tuple[Array, Array]:
        """What the pad on one side sees of the object: heights toward it, over the middle between the pads, (rows,
        columns), -inf where it sees nothing, and slopes by which heights grow along y and z, (rows, columns, 2)."""
        y, z = np.meshgrid(columns, rows)
        points = np.column_stack([np.full(y.size, sign * self._wide / 2), y.ravel(), z.ravel()])
        distances, normals = self._scene.hits(view, points, (-sign, 0, 0))
        distances[distances > self._wide] = np.inf
        slopes = -normals[:, 1:] / np.maximum(sign * normals[:, :1], _SKIN)
        return self._wide / 2 - distances.reshape(y.shape), slopes.reshape(*y.shape, 2)

    def _close(
        self, sides: Sequence[tuple[Array, Array]], columns: Array, rows: Array, depth: float
    ) -> tuple[Outcome, float]:
        """How fingers close whose tips are at a depth ahead of the camera, and the width between the pads then."""
        slipped, aside, width = np.zeros(2), None, np.nan
        for _ in range(_SLIPS):  # for it may slip to and fro
            if np.abs(slipped).max() > _SLIP + _PITCH / 2:
                break
            across = np.flatnonzero(np.abs(columns - slipped[0]) < self._breadth + _PITCH / 10)
            down = depth + slipped[1] - rows
            window = np.ix_(np.flatnonzero((down > -_PITCH / 10) & (down < self._length + _PITCH / 10)), across)
            heights = [height[window] for height, _ in sides]
            if not all(np.isfinite(height).any() for height in heights):
                return Outcome.EMPTY, np.nan
            tops = [float(height.max()) for height in heights]
            width, aside = tops[0] + tops[1], abs(tops[0] - tops[1]) / 2 if aside is None else aside
            if width < self._shut + _SHUT:
                return Outcome.EMPTY, width
            if width > self._wide - _STUCK:
                return Outcome.TOO_WIDE, width
            if aside > _ASIDE:
                return Outcome.SLIPPED, width
            y, z = np.meshgrid(columns[window[1].ravel()], rows[window[0].ravel()])
            contacts, push = [], np.zeros(2)
            for sign, height, top, (_, slopes) in zip((1, -1), heights, tops, sides, strict=True):
                touched = height > top - _SKIN
                slants = _past_border(slopes[window])[touched]
                contacts.append((np.column_stack([sign * height[touched], y[touched], z[touched]]), slants, sign))
                least = slants[np.argmin(np.hypot(*slants.T))]
                push += least if np.hypot(*least) > self._scene.friction else 0.0
            if _antipodal(*contacts) >= np.cos(np.arctan(self._scene.friction)):
                return Outcome.HELD, width
            # It is pushed out past the border where it slants, so that the fingers slip the other way.
            if np.abs(push).max() < _SKIN:
                break
            slipped = slipped - _PITCH * push / np.abs(push).max()
        return Outcome.SLIPPED, width


def _past_border(slopes: Array) -> Array:
    """Of slopes (rows, columns, 2), what grows out past a pad's border: elsewhere the pad's flat face touches."""
    past = np.zeros_like(slopes)
    for axis, k in ((1, 0), (0, 1)):
        for end, sign in ((-1, 1), (0, -1)):
            border = (slice(None),) * axis + (end,)
            past[border][..., k] = sign * np.maximum(sign * slopes[border][..., k], 0.0)
    return past


def _antipodal(one: tuple[Array, Array, int], other: tuple[Array, Array, int]) -> float:
    """Cosine of the larger angle between the line through two points of contact and the normals there, for the best
    two; each side has its points (n, 3), their slants (n, 2), and its sign."""
    points, normals = [], []
    for at, slants, sign in (one, other):
        every = -(-len(at) // _POINTS)
        normal = np.column_stack([np.full(len(at), float(sign)), -slants])[::every]
        points.append(at[::every])
        normals.append(normal / np.linalg.norm(normal, axis=1, keepdims=True))
    lines = points[0][:, None] - points[1]  # (a, b, 3)
    lines /= np.linalg.norm(lines, axis=-1, keepdims=True)
    cosines = np.minimum((lines * normals[0][:, None]).sum(-1), -(lines * normals[1]).sum(-1))
    return float(cosines.max())


def _roll(angle: float) -> RigidTransform:
    return RigidTransform.from_rotation(Rotation.from_rotvec([0.0, 0.0, angle]))


def _ticks(half: float, pitch: float) -> Array:
    """Even steps of at most a pitch, from -half to half."""
    steps = int(np.ceil(2 * half / pitch - 1e-9))
    return np.linspace(-half, half, max(steps, 1) + 1)
