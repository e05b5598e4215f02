"""The bodies of a compiled MuJoCo model as objects of a 3D page.

Bodies welded together become one object, so that a page holds as many objects as the scene has parts that move.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from gvp_lib.views.textures import cube_box, data_url, flat_uv, material_texture, texture_pixels
from gvp_lib.views.threejs import Group, axis_from_y, compose, hex_color, number_list

__all__ = ["anchored_geoms", "bounds", "draw_geoms"]

_GEOM = mujoco.mjtGeom
_UNSET_RGBA = np.array([0.5, 0.5, 0.5, 1.0], np.float32)  # MuJoCo's default, which a material replaces
_HORIZON = 12.0  # m; half the side of the square drawn for an infinite plane
_SMOOTH = {"widthSegments": 28, "heightSegments": 18}


def anchored_geoms(model: mujoco.MjModel, groups: Iterable[int] = (0, 1, 2)) -> dict[int, list[int]]:
    """Visible geoms by the body that they move with. Body 0 carries all that never moves."""
    groups = set(groups)
    anchored: dict[int, list[int]] = {}
    for geom in range(model.ngeom):
        if int(model.geom_group[geom]) in groups and _rgba(model, geom)[3] > 0:
            anchored.setdefault(int(model.body_weldid[model.geom_bodyid[geom]]), []).append(geom)
    return anchored


def draw_geoms(model: mujoco.MjModel, data: mujoco.MjData, anchor: int, geoms: Iterable[int]) -> Group:
    """One three.js group, in the frame of body ``anchor``, of geoms that move with it."""
    group = Group()
    world_from_anchor = compose(data.xpos[anchor], data.xmat[anchor])
    for geom in geoms:
        world_from_geom = compose(data.geom_xpos[geom], data.geom_xmat[geom])
        anchor_from_geom: NDArray[np.float64] = np.linalg.solve(world_from_anchor, world_from_geom).astype(float)
        _draw(model, geom, anchor_from_geom, group)
    return group


def bounds(model: mujoco.MjModel, data: mujoco.MjData, geoms: Iterable[int]) -> NDArray[np.float64]:
    """Lowest and highest corner, shape (2, 3), meters, of geoms other than planes and floors."""
    boxes = []
    for geom in geoms:
        if _GEOM(int(model.geom_type[geom])) in (_GEOM.mjGEOM_PLANE, _GEOM.mjGEOM_HFIELD):
            continue
        local, rotation = model.geom_aabb[geom], data.geom_xmat[geom].reshape(3, 3)
        center, extent = data.geom_xpos[geom] + rotation @ local[:3], np.abs(rotation) @ local[3:]
        boxes.append((center - extent, center + extent))
    if not boxes:
        return np.array([[-0.5, -0.5, 0.0], [0.5, 0.5, 0.5]])
    low, high = np.array(boxes).transpose(1, 0, 2)
    return np.array([low.min(axis=0), high.max(axis=0)])


def _rgba(model: mujoco.MjModel, geom: int) -> NDArray[np.float32]:
    own, material = model.geom_rgba[geom], model.geom_matid[geom]
    return model.mat_rgba[material] if material >= 0 and np.array_equal(own, _UNSET_RGBA) else own


def _finish(model: mujoco.MjModel, geom: int) -> dict[str, Any]:
    """How a geom's surface takes light, from its material; MuJoCo marks what is not set by -1."""
    material = int(model.geom_matid[geom])
    if material < 0:
        return {}
    roughness, metalness = float(model.mat_roughness[material]), float(model.mat_metallic[material])
    if roughness < 0:
        roughness = 0.75 - 0.45 * float(model.mat_shininess[material]) * float(model.mat_specular[material])
    finish: dict[str, Any] = {"roughness": round(roughness, 3)}
    if metalness > 0:
        finish["metalness"] = round(metalness, 3)
    if emission := float(model.mat_emission[material]):
        finish |= {"emissive": hex_color(_rgba(model, geom)), "emissiveIntensity": round(emission, 3)}
    return finish


def _draw(model: mujoco.MjModel, geom: int, pose: NDArray[np.float64], group: Group) -> None:
    kind, size, rgba = _GEOM(int(model.geom_type[geom])), np.asarray(model.geom_size[geom], float), _rgba(model, geom)
    texture = material_texture(model, int(model.geom_matid[geom]))
    if kind == _GEOM.mjGEOM_MESH:
        _draw_mesh(model, geom, pose, group)
        return
    if texture >= 0 and kind in (_GEOM.mjGEOM_BOX, _GEOM.mjGEOM_PLANE) and _draw_textured(model, geom, pose, group):
        return
    finish = _finish(model, geom)
    if kind == _GEOM.mjGEOM_PLANE:
        half = np.where(size[:2] > 0, size[:2], _HORIZON)
        shape = {"type": "PlaneGeometry", "width": 2 * half[0], "height": 2 * half[1]}
    elif kind == _GEOM.mjGEOM_BOX:
        w, h, d = number_list(2 * size)
        shape = {"type": "BoxGeometry", "width": w, "height": h, "depth": d}
    elif kind == _GEOM.mjGEOM_SPHERE:
        shape = {"type": "SphereGeometry", "radius": round(size[0], 5), **_SMOOTH}
    elif kind == _GEOM.mjGEOM_ELLIPSOID:
        shape = {"type": "SphereGeometry", "radius": 1, **_SMOOTH}
        pose = pose @ np.diag([*size, 1.0]) @ axis_from_y
    elif kind == _GEOM.mjGEOM_CYLINDER:
        radius = round(size[0], 5)
        shape = {"type": "CylinderGeometry", "radiusTop": radius, "radiusBottom": radius}
        shape |= {"height": round(2 * size[1], 5), "radialSegments": 36}
        pose = pose @ axis_from_y
    elif kind == _GEOM.mjGEOM_CAPSULE:
        shape, pose = _capsule(size[0], size[1]), pose @ axis_from_y
    else:
        return  # height fields, signed distance fields: not among what a work cell is made of
    shadow = kind != _GEOM.mjGEOM_PLANE or rgba[3] == 1
    # A page has one image of the color; a texture on a round shape is drawn as its mean color.
    if texture >= 0:
        rgba = np.append(rgba[:3] * texture_pixels(model, texture)[..., :3].mean(axis=(0, 1)) / 255, rgba[3])
    group.mesh(shape, group.material(rgba, **finish), pose, shadow=bool(shadow))


def _capsule(radius: float, half_length: float) -> dict[str, object]:
    """A capsule along y: its outline, turned round."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 18)
    outline = np.column_stack([np.cos(angle), np.sin(angle)]) * radius
    outline[:, 1] += np.repeat((-half_length, half_length), 9)
    points = [{"x": x, "y": y} for x, y in np.round(np.abs(outline) * np.where(outline < 0, -1, 1), 5).tolist()]
    points[0]["x"] = points[-1]["x"] = 0
    return {"type": "LatheGeometry", "points": points, "segments": 28}


def _draw_textured(model: mujoco.MjModel, geom: int, pose: NDArray[np.float64], group: Group) -> bool:
    """A box or plane with its texture; False where the two do not go together."""
    material = int(model.geom_matid[geom])
    texture = material_texture(model, material)
    pixels, plane = texture_pixels(model, texture), _GEOM(int(model.geom_type[geom])) == _GEOM.mjGEOM_PLANE
    size = np.asarray(model.geom_size[geom], float)
    repeat, uniform = np.asarray(model.mat_texrepeat[material], float), bool(model.mat_texuniform[material])
    cube = mujoco.mjtTexture(int(model.tex_type[texture])) == mujoco.mjtTexture.mjTEXTURE_CUBE
    if plane and cube:
        return False
    if cube:
        positions, normals, uv = cube_box(size, 6 if pixels.shape[0] == 6 * pixels.shape[1] else 1)
    else:
        if plane:
            # An infinite plane repeats its texture over each meter, a finite one over its size.
            uniform = uniform or not size[0] > 0
            half = np.append(np.where(size[:2] > 0, size[:2], _HORIZON), 0.0)
        else:
            half = size
        positions, normals, _ = cube_box(half)
        if plane:
            positions, normals = positions[24:30], normals[24:30]
        uv = flat_uv(positions, normals, half, repeat, uniform)
    paint = group.material(_rgba(model, geom), image=data_url(pixels), repeat=not cube, **_finish(model, geom))
    group.mesh(group.buffer_geometry(positions, normals, uv), paint, pose)
    return True


def _draw_mesh(model: mujoco.MjModel, geom: int, pose: NDArray[np.float64], group: Group) -> None:
    mesh, material = int(model.geom_dataid[geom]), int(model.geom_matid[geom])
    faces = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
    corner = model.mesh_vertadr[mesh] + model.mesh_face[faces].ravel()
    normal = model.mesh_normaladr[mesh] + model.mesh_facenormal[faces].ravel()
    uv, image = None, None
    texture = material_texture(model, material)
    if texture >= 0 and model.mesh_texcoordadr[mesh] >= 0:
        uv = model.mesh_texcoord[model.mesh_texcoordadr[mesh] + model.mesh_facetexcoord[faces].ravel()]
        uv = np.column_stack([uv[:, 0], 1 - uv[:, 1]])
        image = data_url(texture_pixels(model, texture))
    shape = group.buffer_geometry(model.mesh_vert[corner], model.mesh_normal[normal], uv)
    paint = group.material(_rgba(model, geom), image=image, repeat=True, **_finish(model, geom))
    group.mesh(shape, paint, pose)
