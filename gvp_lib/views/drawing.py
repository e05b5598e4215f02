"""Bodies of a MuJoCo model and overlays as objects of a 3D page, in the JSON form that three.js reads.

meshcat draws with three.js, and hands an object in this form ("Object/Scene format 4") straight to it. Spelling shapes
by their parameters rather than as triangles keeps a page small: a brick with eight studs is a kilobyte. Bodies welded
together become one object, so that a page holds as many objects as the scene has parts that move.

MuJoCo projects a 2d texture along the shape's z axis, and a cube texture from the shape's center. Both are reproduced
on triangles, so that a label sits in the page where the hand camera sees it.

Every overlay has two forms: an object for the page, and rods for the still picture that MuJoCo renders.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import cv2
import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.geometry.sphere import VirtualSphere

__all__ = [
    "Group",
    "Overlay",
    "anchored_geoms",
    "bounds",
    "draw_geoms",
    "frame",
    "frustum",
    "number_list",
    "path",
    "points",
    "sphere",
]

# --- three.js ---------------------------------------------------------------------------------------------------------

Json = dict[str, Any]

# three.js' cylinders stand along y, MuJoCo's along z.
axis_from_y = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


def compose(position: ArrayLike, rotation: ArrayLike, scale: ArrayLike = 1.0) -> NDArray[np.float64]:
    """A homogeneous matrix (4, 4) from a position (3,), a rotation matrix (3, 3) or (9,), and a scale per axis."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.reshape(rotation, (3, 3)) * np.broadcast_to(np.asarray(scale, float), 3)
    matrix[:3, 3] = position
    return matrix


def hex_color(rgb: ArrayLike) -> int:
    """``0xRRGGBB`` from red, green and blue in [0, 1]; what lies outside is clipped."""
    r, g, b = (int(c) for c in np.rint(np.clip(np.asarray(rgb, float)[:3], 0, 1) * 255))
    return (r << 16) | (g << 8) | b


def number_list(values: ArrayLike, digits: int = 5) -> list[float]:
    """Numbers flattened and rounded for JSON; a whole number loses its ``.0``."""
    rounded = np.round(np.asarray(values, float).ravel(), digits) + 0.0  # + 0.0 turns -0.0 into 0.0
    return [int(v) if v == int(v) else v for v in rounded.tolist()]


class Group:
    """A three.js ``Group`` under construction. Its meshes share geometries and materials that are equal."""

    def __init__(self) -> None:
        self._shared: dict[str, dict[str, Json]] = {"geometries": {}, "materials": {}, "textures": {}, "images": {}}
        self._children: list[Json] = []

    def __len__(self) -> int:
        return len(self._children)

    def mesh(self, geometry: Json, material: str, matrix: ArrayLike | None = None, shadow: bool = True) -> None:
        """Add a mesh: ``geometry`` as three.js JSON, a ``material`` from :meth:`material`, a pose (4, 4)."""
        self._add("Mesh", geometry, material, matrix, castShadow=shadow, receiveShadow=shadow)

    def lines(self, segments: ArrayLike, material: str) -> None:
        """Add hairlines between pairs of points, shape (n, 2, 3), meters."""
        self._add("LineSegments", self.buffer_geometry(np.reshape(segments, (-1, 3))), material, None)

    def instances(self, geometry: Json, material: str, matrices: ArrayLike) -> None:
        """Add one geometry at many poses, shape (n, 4, 4), drawn in one call."""
        columns = np.asarray(matrices, float).transpose(0, 2, 1)  # three.js is column-major
        buffer = {"type": "Float32Array", "itemSize": 16, "array": number_list(columns)}
        self._add("InstancedMesh", geometry, material, None, count=len(columns), instanceMatrix=buffer)

    @staticmethod
    def buffer_geometry(positions: ArrayLike, normals: ArrayLike | None = None, uv: ArrayLike | None = None) -> Json:
        """Plain vertices, (n, 3) each and (n, 2) for ``uv``; three in a row are a triangle."""
        attributes = {"position": (positions, 3), "normal": (normals, 3), "uv": (uv, 2)}
        return {
            "type": "BufferGeometry",
            "data": {
                "attributes": {
                    name: {"itemSize": size, "type": "Float32Array", "array": number_list(values)}
                    for name, (values, size) in attributes.items()
                    if values is not None
                }
            },
        }

    def material(
        self, rgba: ArrayLike, kind: str = "MeshStandardMaterial", image: str | None = None, **more: Any
    ) -> str:
        """A material's id: color and opacity (4,), and optionally a picture given as a ``data:`` URL."""
        red, green, blue, alpha = (float(c) for c in np.asarray(rgba, float))
        repeat = more.pop("repeat", False)
        data: Json = {"type": kind, "color": hex_color((red, green, blue)), **more}
        if kind == "MeshStandardMaterial":
            data = {"roughness": 0.62, "metalness": 0.0} | data
        if alpha < 1:
            data |= {"transparent": True, "opacity": round(alpha, 3), "depthWrite": False}
        if image is not None:
            picture = self._share("images", {"url": image})
            wrap = 1000 if repeat else 1001  # three.js: RepeatWrapping, ClampToEdgeWrapping
            data["map"] = self._share("textures", {"image": picture, "wrap": [wrap, wrap], "anisotropy": 4})
        return self._share("materials", data)

    def to_json(self) -> Json:
        """The whole as one object that meshcat's ``set_object`` takes."""
        shared = {
            kind: [{"uuid": uuid} | data for uuid, data in items.items()]
            for kind, items in self._shared.items()
            if items
        }
        root = {"uuid": "root", "type": "Group", "children": self._children}
        return {"metadata": {"version": 4.5, "type": "Object"}, **shared, "object": root}

    def _add(self, kind: str, geometry: Json, material: str, matrix: ArrayLike | None, **more: Any) -> None:
        child: Json = {"uuid": f"o{len(self._children)}", "type": kind}
        child |= {"geometry": self._share("geometries", geometry), "material": material, **more}
        if matrix is not None:
            child["matrix"] = number_list(np.asarray(matrix, float).T, 6)
        self._children.append(child)

    def _share(self, kind: str, data: Json) -> str:
        items = self._shared[kind]
        for uuid, known in items.items():
            if known == data:
                return uuid
        uuid = f"{kind[0]}{len(items)}"
        items[uuid] = data
        return uuid


# --- textures ---------------------------------------------------------------------------------------------------------

_MAX_SIDE = 512  # pixels; more would weigh on the page and not be seen


def material_texture(model: mujoco.MjModel, material: int) -> int:
    """The index of a material's color texture, or -1."""
    if material < 0:
        return -1
    roles = model.mat_texid[material]
    plain, with_alpha = (
        roles[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)],
        roles[int(mujoco.mjtTextureRole.mjTEXROLE_RGBA)],
    )
    return int(plain if plain >= 0 else with_alpha)


def texture_pixels(model: mujoco.MjModel, texture: int) -> NDArray[np.uint8]:
    """A texture's pixels, shape (height, width, channels)."""
    height, width = int(model.tex_height[texture]), int(model.tex_width[texture])
    channels, start = int(model.tex_nchannel[texture]), int(model.tex_adr[texture])
    return model.tex_data[start : start + height * width * channels].reshape(height, width, channels)


def data_url(pixels: NDArray[np.uint8]) -> str:
    """Pixels (height, width, 1, 3 or 4) as a PNG in a ``data:`` URL, shrunk where they are very large."""
    shrink = _MAX_SIDE / max(pixels.shape[:2])
    if shrink < 1:
        pixels = np.asarray(cv2.resize(pixels, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA), np.uint8)
    if pixels.ndim == 3 and pixels.shape[2] >= 3:
        code = cv2.COLOR_RGBA2BGRA if pixels.shape[2] == 4 else cv2.COLOR_RGB2BGR
        pixels = np.asarray(cv2.cvtColor(pixels, code), np.uint8)
    _, png = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return "data:image/png;base64," + base64.b64encode(png.tobytes()).decode()


# Of each face of a cube map: the direction it faces, and the directions in which its columns and rows run.
_FACES = {
    0: ((1, 0, 0), (0, 0, -1), (0, -1, 0)),
    1: ((-1, 0, 0), (0, 0, 1), (0, -1, 0)),
    2: ((0, 1, 0), (1, 0, 0), (0, 0, 1)),
    3: ((0, -1, 0), (1, 0, 0), (0, 0, -1)),
    4: ((0, 0, 1), (1, 0, 0), (0, -1, 0)),
    5: ((0, 0, -1), (-1, 0, 0), (0, -1, 0)),
}


def cube_box(
    half_sizes: NDArray[np.float64], faces: int = 6
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """A box's triangles as MuJoCo wraps a cube texture round it: positions, normals (36, 3) and uv (36, 2).

    Parameters
    ----------
    half_sizes
        Shape (3,), meters.
    faces
        Pictures stacked in the texture: 6, or 1 where all six sides show the same.
    """
    corners = np.array([(-1, -1), (-1, 1), (1, 1), (-1, -1), (1, 1), (1, -1)], float)  # column, row
    positions, normals, uv = [], [], []
    for index, (normal, right, down) in _FACES.items():
        points = np.array(normal) + corners[:, :1] * np.array(right) + corners[:, 1:] * np.array(down)
        positions.append(points * half_sizes)
        normals.append(np.tile(normal, (6, 1)))
        row = (0.5 * (corners[:, 1] + 1) + (index if faces == 6 else 0)) / faces
        uv.append(np.column_stack([0.5 * (corners[:, 0] + 1), 1 - row]))  # three.js counts rows from the bottom
    return np.concatenate(positions), np.concatenate(normals).astype(float), np.concatenate(uv)


def flat_uv(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    half_sizes: NDArray[np.float64],
    repeat: NDArray[np.float64],
    uniform: bool,
) -> NDArray[np.float64]:
    """Where a 2d texture puts points (n, 3) of a box or plane: on each pair of faces, projected along their normal.

    The picture repeats ``repeat`` times over the face, or per meter where ``uniform``.
    """
    facing = np.abs(normals).argmax(axis=1)
    axes = np.array([(1, 2), (0, 2), (0, 1)])[facing]  # of a face's columns and rows
    along = np.take_along_axis(points, axes, axis=1)
    half = half_sizes[axes]
    scale = np.ones(2) if uniform else 1 / np.maximum(half, 1e-9)
    return 0.5 * along * scale * repeat - 0.5


# --- bodies -----------------------------------------------------------------------------------------------------------

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


# --- overlays ---------------------------------------------------------------------------------------------------------

Color = tuple[float, float, float, float]
# Okabe and Ito's colors, which people with any color vision tell apart.
ORANGE, SKY, GREEN, VERMILION = (0.902, 0.624, 0.0), (0.337, 0.706, 0.914), (0.0, 0.62, 0.451), (0.835, 0.369, 0.0)


@dataclass(frozen=True)
class Overlay:
    """One overlay, in the frame it is attached to.

    Attributes
    ----------
    group
        Its object for the page.
    rods
        Segments drawn in stills, shape (n, 2, 3), meters.
    colors
        RGBA of each rod, shape (n, 4).
    radius
        Of the rods, meters.
    """

    group: Group
    rods: NDArray[np.float64]
    colors: NDArray[np.float64]
    radius: float


def _overlay(group: Group, rods: ArrayLike, color: ArrayLike, radius: float) -> Overlay:
    rods = np.reshape(rods, (-1, 2, 3)).astype(float)
    return Overlay(group, rods, np.broadcast_to(np.asarray(color, float), (len(rods), 4)).copy(), radius)


def _rod_matrices(rods: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses (n, 4, 4) that stretch a unit cylinder along y over each rod (n, 2, 3)."""
    along = rods[:, 1] - rods[:, 0]
    length = np.linalg.norm(along, axis=1)
    y = along / np.maximum(length, 1e-12)[:, None]
    aside = np.where(np.abs(y[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    x = np.cross(y, aside)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    matrices = np.tile(np.eye(4), (len(rods), 1, 1))
    matrices[:, :3, 0], matrices[:, :3, 1], matrices[:, :3, 2] = x, y * length[:, None], np.cross(x, y)
    matrices[:, :3, 3] = rods.mean(axis=1)
    return matrices


def _draw_rods(group: Group, rods: NDArray[np.float64], color: ArrayLike, radius: float) -> None:
    shape = {"type": "CylinderGeometry", "radiusTop": radius, "radiusBottom": radius, "height": 1, "radialSegments": 8}
    group.instances(shape, group.material(color, "MeshBasicMaterial"), _rod_matrices(rods))


def frustum(intrinsics: CameraIntrinsics, depth: float, color: Color, image: NDArray[np.uint8] | None) -> Overlay:
    """What a camera sees, in its optical frame, as a pyramid ``depth`` m deep; ``image`` is stretched on its base."""
    w, h = intrinsics.width - 0.5, intrinsics.height - 0.5
    rays = intrinsics.rays([(-0.5, -0.5), (w, -0.5), (w, h), (-0.5, h)])
    corners = rays * (depth / rays[:, 2:])
    rods = [(np.zeros(3), c) for c in corners] + [(corners[i], corners[(i + 1) % 4]) for i in range(4)]
    group, radius = Group(), 0.008 * depth
    _draw_rods(group, np.array(rods), color, radius)
    both_sides = 2  # three.js: DoubleSide
    quad = corners[[0, 3, 2, 0, 2, 1]]
    uv = np.array([(0, 1), (0, 0), (1, 0), (0, 1), (1, 0), (1, 1)], float)
    if image is None:
        paint = group.material((*color[:3], 0.12), "MeshBasicMaterial", side=both_sides)
    else:
        paint = group.material((1, 1, 1, 1), "MeshBasicMaterial", image=data_url(image), side=both_sides)
    group.mesh(group.buffer_geometry(quad, None, uv), paint, shadow=False)
    return _overlay(group, rods, color, radius)


def sphere(virtual: VirtualSphere, max_tilt: float, color: Color) -> Overlay:
    """The cap of the virtual sphere within ``max_tilt`` rad of its pole: a veil with meridians and parallels."""
    # At the pole, the camera's axes are the pole's own y and x, and it looks along -z.
    world_from_camera = virtual.viewpoint(0.0, 0.0).rotation.as_matrix()
    world_from_pole = compose(virtual.center, world_from_camera[:, [1, 0, 2]] * (1, 1, -1))
    group = Group()
    cap = {"type": "SphereGeometry", "radius": virtual.radius, "widthSegments": 48, "heightSegments": 16}
    cap |= {"thetaStart": 0, "thetaLength": round(float(max_tilt), 5)}
    veil = group.material((*color[:3], 0.13), side=2, roughness=0.9)
    group.mesh(cap, veil, world_from_pole @ axis_from_y, shadow=False)
    azimuths, fine = np.linspace(0, 2 * np.pi, 13)[:-1], np.linspace(0, 2 * np.pi, 49)
    tilts = np.linspace(0, max_tilt, max(2, round(max_tilt / np.radians(10)) + 1))
    meridian = np.linspace(0, max_tilt, 13)
    curves = [_on_sphere(meridian, np.full(13, a)) for a in azimuths]
    curves += [_on_sphere(np.full(49, t), fine) for t in tilts[1:]]
    segments = np.concatenate([np.stack([c[:-1], c[1:]], axis=1) for c in curves]) * virtual.radius
    segments = segments @ world_from_pole[:3, :3].T + virtual.center
    group.lines(segments, group.material((*color[:3], 0.55), "LineBasicMaterial"))
    return _overlay(group, segments, (*color[:3], 0.6), 0.0012 * virtual.radius)


def _on_sphere(tilt: NDArray[np.float64], azimuth: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)], axis=-1)


def path(along: RigidTransform | ArrayLike, color: Color, radius: float, arrows: int) -> Overlay:
    """A path through points (n, 3), or through poses, whose viewing directions (+z) show as short pins."""
    pins = np.empty((0, 2, 3))
    if isinstance(along, RigidTransform):
        positions = np.reshape(along.translation, (-1, 3))
        looks = np.reshape(along.rotation.as_matrix(), (-1, 3, 3))[:, :, 2]
        chosen = np.unique(np.linspace(0, len(positions) - 1, min(arrows, len(positions))).round().astype(int))
        pins = np.stack([positions[chosen], positions[chosen] + 12 * radius * looks[chosen]], axis=1)
    else:
        positions = np.reshape(np.asarray(along, float), (-1, 3))
    steps = np.stack([positions[:-1], positions[1:]], axis=1)
    steps = steps[np.linalg.norm(steps[:, 1] - steps[:, 0], axis=1) > 1e-9]
    group = Group()
    if len(steps):
        _draw_rods(group, steps, color, radius)
    _draw_balls(group, positions, color, (1.8 if len(pins) else 1.0) * radius)  # without pins: round joints
    if len(pins):
        _draw_rods(group, pins, color, 0.6 * radius)
    return _overlay(group, np.concatenate([steps, pins]), color, radius)


def frame(size: float) -> Overlay:
    """The axes of a frame: x red, y green, z blue."""
    colors = np.array([(0.86, 0.24, 0.2, 1), (0.2, 0.62, 0.29, 1), (0.2, 0.4, 0.86, 1)])
    rods = np.stack([np.zeros((3, 3)), size * np.eye(3)], axis=1)
    group = Group()
    for rod, color in zip(rods, colors, strict=True):
        _draw_rods(group, rod[None], color, 0.03 * size)
    return Overlay(group, rods, colors, 0.03 * size)


def points(positions: ArrayLike, color: Color, radius: float) -> Overlay:
    """Small balls at points (n, 3), meters."""
    positions = np.reshape(np.asarray(positions, float), (-1, 3))
    group = Group()
    _draw_balls(group, positions, color, radius)
    # In a still, a ball is a rod of no length.
    return _overlay(group, np.stack([positions, positions + (0, 0, 1e-4)], axis=1), color, radius)


def _draw_balls(group: Group, positions: NDArray[np.float64], color: ArrayLike, radius: float) -> None:
    matrices = np.tile(np.eye(4), (len(positions), 1, 1))
    matrices[:, :3, 3] = positions
    shape = {"type": "SphereGeometry", "radius": radius, "widthSegments": 12, "heightSegments": 8}
    group.instances(shape, group.material(color, "MeshBasicMaterial"), matrices)
