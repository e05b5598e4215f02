"""The MuJoCo scene: a room, a table, an arm, objects and their supports, lights, and one set of physics.

The world frame is the arm's base frame: ``world_from_x`` and ``base_from_x`` are the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.geometry.sphere import look_at
from gvp_lib.simulation.arms import ArmSpec
from gvp_lib.simulation.camera import to_mujoco_camera
from gvp_lib.simulation.objects import CONTACT, CONTACT_BIT, ObjectSpec, adopt_settings

__all__ = [
    "ARM_PREFIX",
    "FLOATING",
    "OVERVIEW",
    "TARGET",
    "Stage",
    "Support",
    "aim_overview",
    "build_scene",
    "move_free",
    "move_support",
    "set_physics",
]

ARM_PREFIX = "arm/"
TARGET = "target"
OVERVIEW = "overview"
FLOATING = "floating"

_ROOM = Path(__file__).parent / "models" / "room.xml"
_STEEL = (0.35, 0.36, 0.38, 1.0)
_TABLE_THICKNESS = 0.04  # m
_BLOCK_MASS, _BLOCK_INERTIA = 0.5, 4e-4  # kg and kg m^2, of a block of wood
_RUBBER = 1.5  # friction
_BLOCK_RGBA = (0.30, 0.30, 0.31, 1.0)  # gray: no hue threshold takes it for an object
_MEMORY = 1 << 26  # bytes for contacts: those of round walls of many boxes that touch each other outgrow the default
_OBJECT_ONLY = 1 << 30  # contact bit that no model uses: the endless plane under the table top touches objects alone


@dataclass(frozen=True, eq=False)
class Support:
    """Block that an object stands on, leans against, hides behind, or lies on aslant.

    Attributes
    ----------
    half_extents
        Shape (3,), meters.
    world_from_support
        Pose of its center.
    fixed
        Whether it is screwed down and covered with rubber, as a ramp is; otherwise it is loose and smooth.
    """

    half_extents: NDArray[np.float64]
    world_from_support: RigidTransform
    fixed: bool = False

    def __repr__(self) -> str:
        (a, b, c), (x, y, z) = 2000 * self.half_extents, self.world_from_support.translation
        return f"Support({a:.0f} x {b:.0f} x {c:.0f} mm, at ({x:.3f}, {y:.3f}, {z:.3f}) m)"

    def add_to(self, scene: mujoco.MjSpec, name: str) -> mujoco.MjsGeom:
        """Fix the block to a scene's world, as the geom ``name``."""
        pose = self.world_from_support
        return scene.worldbody.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=self.half_extents,
            pos=pose.translation,
            quat=pose.rotation.as_quat(scalar_first=True),
            **self.contact,
        )

    @property
    def contact(self) -> dict[str, Any]:
        """Attributes of its ``MjsGeom``: of two surfaces that touch, the rougher one decides."""
        return CONTACT | ({"friction": (_RUBBER, 0.002, 0.0001)} if self.fixed else {})


@dataclass(frozen=True, slots=True)
class Stage:
    """Table, floor and workspace of a scene.

    Parameters
    ----------
    table_height, floor_height
        Heights of the table top and of the floor, world frame, m.
    workspace
        Region where objects are placed: ``((x_min, x_max), (y_min, y_max))``, world frame, m.
    """

    table_height: float = 0.0
    floor_height: float = -0.75
    workspace: tuple[tuple[float, float], tuple[float, float]] = ((-0.05, 0.05), (-0.05, 0.05))


def build_scene(
    arm: ArmSpec | None,
    objects: Sequence[tuple[str, ObjectSpec]],
    supports: Sequence[Support],
    stage: Stage,
    *,
    highlights: bool = False,
) -> mujoco.MjSpec:
    """Assemble a scene; compile it with ``.compile()``.

    Parameters
    ----------
    arm
        Arm, attached at the world's origin with the prefix ``arm/``; None for a bare camera named ``floating``.
    objects
        Name and spec of each object; the first is the one to grasp.
    supports
        Blocks under the objects, which become bodies ``support_0`` and so on, loose on the table but for the
        fixed ones.
    stage
        Table, floor and workspace.
    highlights
        Whether surfaces shine. Otherwise light is diffuse and a color keeps its saturation.
    """
    scene = mujoco.MjSpec.from_file(str(_ROOM))
    scene.memory = _MEMORY
    _furnish(scene, stage, on_table=arm is not None and arm.base is None and abs(stage.table_height) < 0.02)
    if not highlights:
        scene.delete(scene.light("bulb"))
    if arm is not None:
        child = arm.load()
        adopt_settings(child, scene)
        scene.attach(child, prefix=ARM_PREFIX, frame=scene.worldbody.add_frame())
    else:
        scene.worldbody.add_camera(name=FLOATING, fovy=48.8, pos=[0, 0, stage.table_height + 0.5])
    for i, support in enumerate(supports):
        where = support.world_from_support
        quaternion = where.rotation.as_quat(scalar_first=True)
        block = scene.worldbody.add_body(name=f"support_{i}", pos=where.translation, quat=quaternion)
        # Loose, as on a real table: fingers that close on block and brick lift both, where a fixed one would hold them
        # down. Its weight is the same at any size, so that an episode does not depend on the ones before it.
        if support.fixed:
            block.mocap = True  # it stays where it is put
        else:
            block.add_freejoint(name=f"support_{i}")
        block.explicitinertial, block.mass, block.inertia = True, _BLOCK_MASS, np.full(3, _BLOCK_INERTIA)
        block.ipos, block.iquat = (0, 0, 0), (1, 0, 0, 0)
        box = mujoco.mjtGeom.mjGEOM_BOX
        geom = block.add_geom(type=box, size=support.half_extents, rgba=_BLOCK_RGBA, **support.contact)
        geom.conaffinity |= _OBJECT_ONLY
        scene.add_exclude(bodyname1="table", bodyname2=block.name)
    for name, spec in objects:
        for geom in spec.attach_to(scene, name).find_all(mujoco.mjtObj.mjOBJ_GEOM):
            if (geom.contype | geom.conaffinity) & CONTACT_BIT:
                geom.conaffinity |= _OBJECT_ONLY
        scene.add_exclude(bodyname1="table", bodyname2=name)  # the plane carries it
    return scene


def set_physics(scene: mujoco.MjSpec) -> None:
    """Solver settings under which a thousand grasps neither slip, sink nor explode: those of ``models/room.xml``.

    Placements settle under the same ones, so that an object rests in an episode where it came to rest before it.
    """
    scene.option = mujoco.MjSpec.from_file(str(_ROOM)).option


def _furnish(scene: mujoco.MjSpec, stage: Stage, *, on_table: bool) -> None:
    """Put the room's lights and floor where the stage is, and a table there, large enough for an arm ``on_table``."""
    (x0, x1), (y0, y1) = stage.workspace
    center = np.array([(x0 + x1) / 2, (y0 + y1) / 2, stage.table_height])
    scene.light("lamp").pos = center + (-0.35, 0.30, 2.0)
    scene.light("bulb").pos = center + (0.04, -0.05, 0.7)
    scene.geom("floor").pos = [0, 0, stage.floor_height]

    x0, x1, y0, y1 = x0 - 0.22, x1 + 0.30, y0 - 0.35, y1 + 0.35
    if on_table:
        x0, y0, y1 = min(x0, -0.25), min(y0, -0.45), max(y1, 0.45)
    half, top = np.array([x1 - x0, y1 - y0, _TABLE_THICKNESS]) / 2, stage.table_height
    middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2, top - half[2]])
    box, plane = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_PLANE
    table = scene.worldbody.add_body(name="table")
    table.add_geom(name="table", type=box, size=half, pos=middle, material="wood", **CONTACT)
    leg = (top - _TABLE_THICKNESS - stage.floor_height) / 2
    for sx, sy in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        at = middle[:2] + (sx * (half[0] - 0.05), sy * (half[1] - 0.05))
        table.add_geom(type=box, size=[0.025, 0.025, leg], pos=[*at, stage.floor_height + leg], rgba=_STEEL)
    # A plane is the steadiest thing MuJoCo can rest an object on; the box is what the arm can hit.
    scene.worldbody.add_geom(
        name="table_plane", type=plane, size=[half[0], half[1], 0.1], pos=[middle[0], middle[1], top],
        group=4, contype=_OBJECT_ONLY, conaffinity=0, **CONTACT,
    )  # fmt: skip


def aim_overview(model: mujoco.MjModel, data: mujoco.MjData, stage: Stage) -> None:
    """Point the overview camera from the front right, as close as still shows the whole arm and the workspace."""
    of_arm = [model.body(b).name.startswith(ARM_PREFIX) for b in model.geom_bodyid]
    seen = np.flatnonzero(of_arm & (data.geom_xpos[:, 2] > stage.table_height - 0.1))
    (x0, x1), (y0, y1) = stage.workspace
    corners = [(x, y, stage.table_height + z) for x in (x0, x1) for y in (y0, y1) for z in (0.0, 0.15)]
    points = np.vstack([data.geom_xpos[seen], corners])
    margin = np.concatenate([model.geom_rbound[seen], np.full(len(corners), 0.05)])
    low, high = (points - margin[:, None]).min(0), (points + margin[:, None]).max(0)
    middle, camera = (low + high) / 2, model.camera(OVERVIEW).id
    distance = 0.5 * np.linalg.norm(high - low) / np.sin(np.radians(model.cam_fovy[camera]) / 2)
    direction = np.array([0.78, -0.48, 0.40])
    eye = middle + 0.92 * distance * direction / np.linalg.norm(direction)
    model.cam_pos[camera], model.cam_quat[camera] = to_mujoco_camera(look_at(eye, middle))


def move_free(model: mujoco.MjModel, data: mujoco.MjData, name: str, world_from_body: RigidTransform) -> None:
    """Put a free body, an object or a block, elsewhere; its joint has its name."""
    at = model.joint(name).qposadr[0]
    data.qpos[at : at + 3] = world_from_body.translation
    data.qpos[at + 3 : at + 7] = world_from_body.rotation.as_quat(scalar_first=True)


def move_support(model: mujoco.MjModel, data: mujoco.MjData, index: int, support: Support) -> None:
    """Move and resize a block of a compiled scene without compiling it again."""
    body = model.body(f"support_{index}")
    geom = int(body.geomadr[0])
    if support.fixed:
        where, slot = support.world_from_support, model.body_mocapid[body.id]
        data.mocap_pos[slot] = where.translation
        data.mocap_quat[slot] = where.rotation.as_quat(scalar_first=True)
    else:
        move_free(model, data, f"support_{index}", support.world_from_support)
    model.geom_size[geom] = support.half_extents
    # Used by MuJoCo's broad phase and rays; the compiler would have derived them.
    model.geom_rbound[geom] = np.linalg.norm(support.half_extents)
    model.geom_aabb[geom, 3:] = support.half_extents
    model.bvh_aabb[model.body_bvhadr[body.id], 3:] = support.half_extents
