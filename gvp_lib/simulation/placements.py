"""How an object stands when an episode begins: flat, raised, on its side, tilted against a block, or behind one.

Thesis 3.1.3 to 3.1.5 and Fig. 3.1, whose words differ (errata 23); ``tilted`` is ours, the case in which looking
straight down is wrong, and ``walled`` follows 3.1.7, where one side of a cuboid could not be seen. Each pose is
computed, then settled in a small scene without the robot, so that nothing moves when an episode begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import GvpError, InvalidParameterError, ModelError, UnknownNameError
from gvp_lib.simulation.objects import CONTACT, BoundingBox, ObjectSpec, object_spec
from gvp_lib.simulation.scene import Stage, Support, move_free, set_physics

__all__ = ["PLACEMENTS", "Layout", "Placed", "place"]

PLACEMENTS = ("flat", "raised", "side", "tilted", "walled")

TILT_RANGE = np.radians((15.0, 30.0))  # of the accepted normal from the vertical, once settled
BLOCK_HEIGHT = 0.040  # m, of the block under a raised object
BLOCK_MARGIN = 0.006  # m, by which a block stands out from under its object
WALL_THICKNESS, WALL_GAP = 0.020, 0.006  # m, of the block beside a walled object, and of the air between them

_RING, _GAP = 0.13, 0.02  # m: minimum distance of others from the target, and clearance between any two
_TRIES = 12
_REST = 5e-4  # m/s and rad/s: slower than this is at rest
_REST_TIME, _TIMEOUT = 0.1, 3.0  # s: how long it must be at rest, and how long we wait for that
_DRIFT = 1e-4  # m, and halves of a radian: an object that moves less in a second stays where it is
_LEVEL, _SIDE_TILT = np.radians(1.0), np.radians(15.0)
_Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Placed:
    """Object at rest.

    Attributes
    ----------
    world_from_object
        Pose of the object.
    supports
        Blocks under or beside it.
    """

    world_from_object: RigidTransform
    supports: tuple[Support, ...] = ()

    def __repr__(self) -> str:
        (x, y, z), blocks = self.world_from_object.translation, len(self.supports)
        return f"Placed(at ({x:.3f}, {y:.3f}, {z:.3f}) m, {blocks} block{'s' * (blocks != 1)})"


class Layout:
    """Where the target, and the ``others`` flat beside it, stand on a stage in an episode, by its seed alone."""

    def __init__(self, target: ObjectSpec, placement: str, others: Sequence[str | ObjectSpec], stage: Stage) -> None:
        if isinstance(others, str | ObjectSpec):
            raise InvalidParameterError(f"others is a list of objects; for one, write others=[{others!r}]")
        self.target, self.placement, self.stage = target, placement, stage
        self.others = [object_spec(other) for other in others]
        self._last: tuple[object, Placed, list[Placed]] | None = None

    def __repr__(self) -> str:
        return f"Layout({self.target.name} {self.placement}, others: {len(self.others)})"

    def at_rest(self, seed: np.random.SeedSequence) -> tuple[Placed, list[Placed]]:
        """The target and the others at rest; remembered, for a simulation settles them and episodes repeat."""
        key = repr(seed.entropy), seed.spawn_key
        if self._last is None or self._last[0] != key:
            rng = np.random.default_rng(seed)
            where = [rng.uniform(*limits) for limits in self.stage.workspace]
            placed = place(self.target, self.placement, rng, where, self.stage.table_height)
            self._last = key, placed, self._beside(placed, rng)
        return self._last[1:]

    def _beside(self, placed: Placed, rng: np.random.Generator) -> list[Placed]:
        """Place the others flat on a ring around the target, at even angles, clear of it and of each other."""
        start, middle, count = rng.uniform(0, 2 * np.pi), placed.world_from_object.translation[:2], len(self.others)
        angles = start + np.arange(count) * (2 * np.pi / max(1, count))
        # How far the target and its blocks reach from the target's origin. The yaws of the others are not drawn yet, so
        # they count as the circles about their bounding boxes.
        box, corners = self.target.bounding_box(), np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3), axis=-1).reshape(8, 3)
        points = [placed.world_from_object.apply(box.center + corners * box.half_extents)]
        points += [block.world_from_support.apply(corners * block.half_extents) for block in placed.supports]
        reach = float(np.linalg.norm(np.vstack(points)[:, :2] - middle, axis=1).max())
        sizes = [float(np.linalg.norm(spec.bounding_box().half_extents[:2])) for spec in self.others]
        ring = max([_RING, *(reach + size + _GAP for size in sizes)])
        if count > 1:
            ring = max(ring, (max(sizes) + 0.5 * _GAP) / np.sin(np.pi / count))
        spots = [middle + ring * np.array([np.cos(a), np.sin(a)]) for a in angles]
        pairs = zip(self.others, spots, strict=True)
        return [place(spec, "flat", rng, spot, self.stage.table_height) for spec, spot in pairs]


def place(
    spec: ObjectSpec,
    placement: str,
    rng: np.random.Generator | int,
    position_xy: ArrayLike = (0.0, 0.0),
    table_height: float = 0.0,
) -> Placed:
    """Put an object on the table, at a random yaw, at rest.

    Parameters
    ----------
    spec
        Object; any :class:`ObjectSpec`. Its bounding box says where its faces are.
    placement
        ``"flat"``: on the table, +z up. ``"raised"``: the same, level on a block. ``"side"``: lying on the
        side face beneath its longer horizontal axis, either of the two. ``"tilted"``: one edge on the table,
        the other on a block, its accepted normal 15 to 30 deg from the vertical; an object too slender for
        that leans lying. ``"walled"``: flat, with a block of its own height along one of its long sides, which
        the block hides.
    rng
        Generator, or a seed. The same seed gives the same pose, bit for bit, on one machine.
    position_xy
        Resting place of the center of its bounding box, shape (2,), meters, world frame.
    table_height
        Height of the table's top, meters, world frame.

    Raises
    ------
    UnknownNameError
        There is no such placement.
    ModelError
        The object cannot be in a scene (see :meth:`ObjectSpec.bounding_box`), or its simulation diverges.
    GvpError
        The object does not come to rest that way, whatever was tried.
    """
    if placement not in PLACEMENTS:
        raise UnknownNameError("placement", placement, PLACEMENTS)
    position = np.asarray(position_xy, float)
    if position.shape != (2,) or not np.isfinite((*position, table_height)).all():
        raise InvalidParameterError(
            f"position_xy is a finite vector of shape (2,) and table_height finite, in meters; "
            f"got {position_xy!r} and {table_height!r}"
        )
    rng = np.random.default_rng(rng)
    box = spec.bounding_box()
    yaw = Rotation.from_rotvec(rng.uniform(0, 2 * np.pi) * _Z)
    for _ in range(_TRIES):
        start = _start(box, placement, rng)
        rest = _rest(spec, placement, start)
        if isinstance(rest, str):
            continue
        x, y, _ = rest.apply(box.center)
        world_from_table = RigidTransform.from_components((*position, table_height), yaw)
        world_from_start = world_from_table * RigidTransform.from_translation((-x, -y, 0.0))
        supports = (Support(s.half_extents, world_from_start * s.world_from_support) for s in start.supports)
        return Placed(world_from_start * rest, tuple(supports))
    raise GvpError(f"object {spec.name!r} does not come to rest {placement!r} after {_TRIES} tries: {rest}")


def _start(box: BoundingBox, placement: str, rng: np.random.Generator) -> Placed:
    """Initial pose for the settling, in a frame whose z = 0 is the table top."""
    if placement == "tilted":
        return _leaning(box, rng)
    if placement == "walled":
        return _beside_wall(box, rng)
    base = _onto_side(box, rng) if placement == "side" else Rotation.identity()
    half = np.abs(base.as_matrix()) @ box.half_extents
    if placement != "raised":
        return Placed(_centered(base, box, half * _Z))
    size = np.array([half[0] + BLOCK_MARGIN, half[1] + BLOCK_MARGIN, BLOCK_HEIGHT / 2])
    return _with_block(_centered(base, box, (BLOCK_HEIGHT + half[2]) * _Z), size, np.zeros(3))


def _leaning(box: BoundingBox, rng: np.random.Generator) -> Placed:
    """One bottom edge on the table, the bottom face on the upper edge of a block."""
    low, high = TILT_RANGE + np.radians((1.0, -2.0))  # the settling moves it a little
    for base in (Rotation.identity(), _onto_side(box, rng)):
        half = np.abs(base.as_matrix()) @ box.half_extents
        # Beyond atan(length / height) the center of mass would leave the low edge and the object topple.
        topple = np.arctan2(half[:2], half[2]) - np.radians(4.0)
        axes = np.flatnonzero(topple > low)
        if len(axes):  # at the latest lying, on the narrowest of its sides
            break
    k = int(rng.choice(axes))
    along = rng.choice((-1.0, 1.0)) * np.eye(3)[k]  # horizontal, from the low edge to the block
    tilt = rng.uniform(low, max(low, min(high, topple[k])))
    length, height = 2 * half[k], 2 * half[2]
    edge = rng.uniform(0.7, 0.9) * length  # how far up the bottom face the block's edge touches
    slope, normal = np.cos(tilt) * along + np.sin(tilt) * _Z, np.cos(tilt) * _Z - np.sin(tilt) * along
    rotation = Rotation.from_rotvec(tilt * np.cross(along, _Z)) * base
    pose = _centered(rotation, box, 0.5 * length * slope + (0.5 * height + 1e-4) * normal)
    size = np.abs(along) * 0.020 + np.array([0.0, 0.0, 0.5 * edge * np.sin(tilt)])
    size[1 - k] = half[1 - k] + BLOCK_MARGIN
    return _with_block(pose, size, (edge * np.cos(tilt) + 0.020) * along)


def _beside_wall(box: BoundingBox, rng: np.random.Generator) -> Placed:
    """Flat, with a block along one of the longest sides, of which a square has four."""
    half = box.half_extents
    across = int(rng.choice(np.flatnonzero(half[:2] < half[:2].min() + 1e-6)))
    outward = rng.choice((-1.0, 1.0)) * np.eye(3)[across]
    size = np.array([half[0] + BLOCK_MARGIN, half[1] + BLOCK_MARGIN, half[2]])
    size[across] = WALL_THICKNESS / 2
    pose = _centered(Rotation.identity(), box, half * _Z)
    return _with_block(pose, size, (half[across] + WALL_GAP + size[across]) * outward)


def _with_block(pose: RigidTransform, size: NDArray[np.float64], foot: NDArray[np.float64]) -> Placed:
    """An object, and a block of half extents ``size`` that stands on the table at ``foot``."""
    return Placed(pose, (Support(size, RigidTransform.from_translation(foot + size[2] * _Z)),))


def _onto_side(box: BoundingBox, rng: np.random.Generator) -> Rotation:
    """A quarter turn about the longer horizontal axis, to either side."""
    axis = np.eye(3)[0 if box.half_extents[0] >= box.half_extents[1] - 1e-6 else 1]
    return Rotation.from_rotvec(rng.choice((-1.0, 1.0)) * np.pi / 2 * axis)


def _centered(rotation: Rotation, box: BoundingBox, center: NDArray[np.float64]) -> RigidTransform:
    """Pose of the object that brings its box's center to ``center``."""
    return RigidTransform.from_components(center - rotation.apply(box.center), rotation)


def _settle(spec: ObjectSpec, start: Placed) -> tuple[RigidTransform, bool]:
    """Pose in which the object comes to rest under gravity, or is at the end, and whether it rests there."""
    scene = mujoco.MjSpec()
    set_physics(scene)
    scene.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(1, 1, 0.1), **CONTACT)
    for i, support in enumerate(start.supports):
        support.add_to(scene, f"support_{i}")
    spec.attach_to(scene, "object")
    model = scene.compile()
    data, timestep = mujoco.MjData(model), model.opt.timestep
    move_free(model, data, "object", start.world_from_object)
    still, needed, second, before = 0, round(_REST_TIME / timestep), round(1 / timestep), data.qpos.copy()
    for step in range(1, round(_TIMEOUT / timestep) + 1):
        mujoco.mj_step(model, data)
        if data.time < (step - 0.5) * timestep:  # MuJoCo begins anew where numbers get out of hand
            raise ModelError(
                f"the simulation of object {spec.name!r} diverges. Of its mass and its geoms' margin, gap, friction, "
                "solref and solimp, or its gravcomp, one is out of all proportion; the defaults would work"
            )
        still = still + 1 if np.abs(data.qvel).max() < _REST else 0
        # A cylinder trembles on a box, where it finds but one contact, without ever going anywhere.
        trembles = step % second == 0 and np.abs(data.qpos - before).max() < _DRIFT
        if rests := still == needed or trembles:
            break
        if step % second == 0:
            before = data.qpos.copy()
    rotation = Rotation.from_quat(data.qpos[3:], scalar_first=True)
    return RigidTransform.from_components(data.qpos[:3], rotation), rests


def _rest(spec: ObjectSpec, placement: str, start: Placed) -> RigidTransform | str:
    """Pose in which the object rests as wanted, or else what is wrong with how it came to rest."""
    (settled, rests), computed = _settle(spec, start), start.world_from_object
    shift = "({:.1f}, {:.1f}, {:.1f}) mm".format(*1e3 * (settled.translation - computed.translation) + 0.0)
    if not rests:
        return (
            f"it still moved after {_TIMEOUT:g} s, {shift} from where it was put. A flat base below its center of mass "
            "would work, and among the geoms of the base a box, for a round one trembles on a block"
        )
    moved = computed.inv() * settled
    if placement != "tilted" and moved.rotation.magnitude() < _LEVEL and np.linalg.norm(moved.translation) < 1e-3:
        return computed  # the rest is the contacts' softness
    tilt = spec.accepted_normal(settled).angle(_Z)
    lean = float(np.arccos(np.clip(computed.rotation.apply(_Z) @ settled.rotation.apply(_Z), -1, 1)))
    text = f"it came to rest with its accepted normal {np.degrees(tilt):.0f} deg from the vertical"
    hint = ". List a normal that is up when it lies like that (normals=), or give round_axis="
    if placement == "tilted":
        good, hint = TILT_RANGE[0] <= tilt <= TILT_RANGE[1], f", not 15 to 30{hint}"
    elif placement == "side":
        good = tilt < _SIDE_TILT and lean < 2 * _SIDE_TILT
    elif lean < _LEVEL:
        good, text = False, f"it came to rest upright, but moved by {shift}"
        hint = (
            " from where its collision geoms would touch. They hover, sink or slide by their margin, gap, solref, "
            "solimp or friction, of which the defaults would work; a round base also sinks into a block, a box does not"
        )
    else:
        good = False
        hint = (
            " (of its normals=, the one nearest the vertical). A flat base of collision geoms, all equally low, and a "
            "center of mass above it would work"
        )
    return settled if good else text + hint
