"""Bodies of a MuJoCo model and overlays as objects of a 3D page, in the JSON form that three.js reads.

meshcat draws with three.js, and hands an object in this form ("Object/Scene format 4") straight to it. Spelling shapes
by their parameters rather than as triangles keeps a page small: a brick with eight studs is a kilobyte. Bodies welded
together become one object, so that a page holds as many objects as the scene has parts that move.

MuJoCo projects a 2d texture along the shape's z axis, and a cube texture from the shape's center. Both are reproduced
on triangles, so that a label sits in the page where the hand camera sees it.

Every overlay has two forms: an object for the page, and rods for the still picture that MuJoCo renders.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import cv2
import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.checks import finite
from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.perception.images import check_rgb
from gvp_lib.views.page import png

# --- three.js ---------------------------------------------------------------------------------------------------------

Json = dict[str, Any]
Array = NDArray[np.float64]

_DOUBLE_SIDE, _REPEAT, _CLAMP_TO_EDGE = 2, 1000, 1001  # three.js' constants
_AXIS_FROM_Y = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # its cylinders stand along y
_MAX_SIDE = 512  # px, of a texture; more would weigh on the page and not be seen


def compose(position: ArrayLike, rotation: ArrayLike) -> Array:
    """A homogeneous matrix (4, 4) from a position (3,) and a rotation matrix (3, 3) or (9,)."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.reshape(rotation, (3, 3))
    matrix[:3, 3] = position
    return matrix


def number_list(values: ArrayLike, digits: int = 5) -> list[float]:
    """Numbers flattened and rounded for JSON; a whole number loses its ``.0``."""
    rounded = np.round(np.asarray(values, float).ravel(), digits) + 0.0  # + 0.0 turns -0.0 into 0.0
    return [int(v) if v == int(v) else v for v in rounded.tolist()]


class Group:
    """A three.js ``Group`` under construction. Its meshes share geometries and materials that are equal."""

    def __init__(self) -> None:
        self._shared: dict[str, list[Json]] = {"geometries": [], "materials": [], "textures": [], "images": []}
        self._children: list[Json] = []

    def mesh(self, geometry: Json, material: str, pose: ArrayLike | None = None, shadow: bool = True) -> None:
        """Add a mesh: ``geometry`` as three.js JSON, a ``material`` from :meth:`material`, a pose (4, 4)."""
        self._add("Mesh", geometry, material, castShadow=shadow, receiveShadow=shadow)
        if pose is not None:
            self._children[-1]["matrix"] = number_list(np.transpose(pose), 6)  # three.js is column-major

    def lines(self, segments: ArrayLike, material: str) -> None:
        """Add hairlines between pairs of points, shape (n, 2, 3), meters."""
        self._add("LineSegments", self.buffer_geometry(np.reshape(segments, (-1, 3))), material)

    def instances(self, geometry: Json, material: str, poses: Array) -> None:
        """Add one geometry at many poses, shape (n, 4, 4), drawn in one call."""
        buffer = {"type": "Float32Array", "itemSize": 16, "array": number_list(poses.transpose(0, 2, 1))}
        self._add("InstancedMesh", geometry, material, count=len(poses), instanceMatrix=buffer)

    @staticmethod
    def buffer_geometry(positions: ArrayLike, normals: ArrayLike | None = None, uv: ArrayLike | None = None) -> Json:
        """Plain vertices, (n, 3) each and (n, 2) for ``uv``; three in a row are a triangle."""
        given = {"position": (positions, 3), "normal": (normals, 3), "uv": (uv, 2)}
        attributes = {
            name: {"itemSize": size, "type": "Float32Array", "array": number_list(values)}
            for name, (values, size) in given.items()
            if values is not None
        }
        return {"type": "BufferGeometry", "data": {"attributes": attributes}}

    def material(
        self,
        rgba: ArrayLike,
        kind: str = "MeshStandardMaterial",
        image: NDArray[np.uint8] | None = None,
        repeat: bool = False,
        **more: Any,
    ) -> str:
        """A material's id: color and opacity (4,), optionally a picture, and three.js' other properties."""
        *rgb, alpha = (float(c) for c in np.asarray(rgba, float))
        data: Json = {"type": kind, "color": _hex_color(rgb), **more}
        if kind == "MeshStandardMaterial":
            data = {"roughness": 0.62, "metalness": 0.0} | data
        if alpha < 1:
            data |= {"transparent": True, "opacity": round(alpha, 3), "depthWrite": False}
        if image is not None:
            shrink = min(1.0, _MAX_SIDE / max(image.shape[:2]))
            if shrink < 1:
                image = np.asarray(cv2.resize(image, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA))
            picture = self._share("images", {"url": f"data:image/png;base64,{png(image)}"})
            wrap = [_REPEAT if repeat else _CLAMP_TO_EDGE] * 2
            data["map"] = self._share("textures", {"image": picture, "wrap": wrap, "anisotropy": 4})
        return self._share("materials", data)

    def to_json(self) -> Json:
        """The whole as one object that meshcat's ``set_object`` takes."""
        shared = {
            kind: [{"uuid": f"{kind[0]}{number}"} | data for number, data in enumerate(items)]
            for kind, items in self._shared.items()
            if items
        }
        root = {"uuid": "root", "type": "Group", "children": self._children}
        return {"metadata": {"version": 4.5, "type": "Object"}, **shared, "object": root}

    def _add(self, kind: str, geometry: Json, material: str, **more: Any) -> None:
        shape = self._share("geometries", geometry)
        child = {"uuid": f"o{len(self._children)}", "type": kind, "geometry": shape, "material": material}
        self._children.append(child | more)

    def _share(self, kind: str, data: Json) -> str:
        items = self._shared[kind]
        if data not in items:
            items.append(data)
        return f"{kind[0]}{items.index(data)}"


def _hex_color(rgb: ArrayLike) -> int:
    finite(color=rgb)
    r, g, b = (int(c) for c in np.rint(np.clip(np.asarray(rgb, float)[:3], 0, 1) * 255))
    return (r << 16) | (g << 8) | b


# --- bodies -----------------------------------------------------------------------------------------------------------

_GEOM = mujoco.mjtGeom
_UNSET_RGBA = np.array([0.5, 0.5, 0.5, 1.0], np.float32)  # MuJoCo's default, which a material replaces
_HORIZON = 12.0  # m; half the side of the square drawn for an infinite plane
_SMOOTH = {"widthSegments": 28, "heightSegments": 18}


def anchored_geoms(model: mujoco.MjModel, groups: Sequence[int]) -> dict[int, list[int]]:
    """Visible geoms by the body that they move with. Body 0 carries all that never moves."""
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
        _draw(model, geom, np.asarray(np.linalg.solve(world_from_anchor, world_from_geom), float), group)
    return group


def bounds(model: mujoco.MjModel, data: mujoco.MjData, geoms: Iterable[int]) -> Array:
    """Lowest and highest corner, shape (2, 3), meters, of geoms other than planes and floors."""
    low, high = [], []
    for geom in geoms:
        if _GEOM(int(model.geom_type[geom])) not in (_GEOM.mjGEOM_PLANE, _GEOM.mjGEOM_HFIELD):
            local, rotation = model.geom_aabb[geom], data.geom_xmat[geom].reshape(3, 3)
            center, extent = data.geom_xpos[geom] + rotation @ local[:3], np.abs(rotation) @ local[3:]
            low.append(center - extent)
            high.append(center + extent)
    return np.array([np.min(low, axis=0), np.max(high, axis=0)] if low else [(-0.5, -0.5, 0.0), (0.5, 0.5, 0.5)])


def _rgba(model: mujoco.MjModel, geom: int) -> NDArray[np.float32]:
    own, material = model.geom_rgba[geom], model.geom_matid[geom]
    return model.mat_rgba[material] if material >= 0 and np.array_equal(own, _UNSET_RGBA) else own


def _draw(model: mujoco.MjModel, geom: int, pose: Array, group: Group) -> None:
    kind, rgba = _GEOM(int(model.geom_type[geom])), _rgba(model, geom)
    image, cube = _texture(model, geom)
    if kind == _GEOM.mjGEOM_MESH:
        shape = _mesh(model, geom, textured=image is not None)
        image = image if "uv" in shape["data"]["attributes"] else None
    elif image is not None and (kind == _GEOM.mjGEOM_BOX or (kind == _GEOM.mjGEOM_PLANE and not cube)):
        shape = _wrapped(model, geom, faces=len(image) // image.shape[1] if cube else 0)
    else:
        plain = _plain(kind, np.asarray(model.geom_size[geom], float))
        if plain is None:
            return
        shape, pose = plain[0], pose @ plain[1]
        if image is not None:  # on a round shape, a texture's mean color
            rgba, image = np.append(rgba[:3] * image[..., :3].mean(axis=(0, 1)) / 255, rgba[3]), None
    shadow = kind != _GEOM.mjGEOM_PLANE or image is not None or rgba[3] == 1
    paint = group.material(rgba, image=image, repeat=not cube, **_finish(model, geom))
    group.mesh(shape, paint, pose, shadow=bool(shadow))


def _plain(kind: mujoco.mjtGeom, size: Array) -> tuple[Json, Array] | None:
    """A primitive by its parameters, and how it is turned and stretched. None for height and distance fields."""
    radius, height = round(size[0], 5), round(2 * size[1], 5)
    match kind:
        case _GEOM.mjGEOM_PLANE:
            width, depth = 2 * _visible_half(size)[:2]
            return {"type": "PlaneGeometry", "width": width, "height": depth}, np.eye(4)
        case _GEOM.mjGEOM_BOX:
            sides = zip(("width", "height", "depth"), number_list(2 * size), strict=True)
            return {"type": "BoxGeometry", **dict(sides)}, np.eye(4)
        case _GEOM.mjGEOM_SPHERE:
            return {"type": "SphereGeometry", "radius": radius, **_SMOOTH}, np.eye(4)
        case _GEOM.mjGEOM_ELLIPSOID:
            return {"type": "SphereGeometry", "radius": 1, **_SMOOTH}, np.diag([*size, 1.0]) @ _AXIS_FROM_Y
        case _GEOM.mjGEOM_CYLINDER:
            ends = {"radiusTop": radius, "radiusBottom": radius}
            return {"type": "CylinderGeometry", **ends, "height": height, "radialSegments": 36}, _AXIS_FROM_Y
        case _GEOM.mjGEOM_CAPSULE:  # its outline, turned round
            angle = np.linspace(-np.pi / 2, np.pi / 2, 18)
            x, y = size[0] * np.cos(angle), size[0] * np.sin(angle) + np.repeat((-size[1], size[1]), 9)
            points = [{"x": abs(x), "y": y} for x, y in np.round([x, y], 5).T.tolist()]
            points[0]["x"] = points[-1]["x"] = 0
            return {"type": "LatheGeometry", "points": points, "segments": 28}, _AXIS_FROM_Y
    return None


def _visible_half(size: Array) -> Array:
    """Half extents of a plane, shape (3,): those of its square where it is infinite."""
    return np.append(np.where(size[:2] > 0, size[:2], _HORIZON), 0.0)


def _mesh(model: mujoco.MjModel, geom: int, textured: bool) -> Json:
    mesh = int(model.geom_dataid[geom])
    faces = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
    corners = model.mesh_vert[model.mesh_vertadr[mesh] + model.mesh_face[faces].ravel()]
    normals = model.mesh_normal[model.mesh_normaladr[mesh] + model.mesh_facenormal[faces].ravel()]
    uv = None
    if textured and model.mesh_texcoordadr[mesh] >= 0:
        uv = model.mesh_texcoord[model.mesh_texcoordadr[mesh] + model.mesh_facetexcoord[faces].ravel()]
        uv = np.column_stack([uv[:, 0], 1 - uv[:, 1]])  # three.js counts rows from the bottom
    return Group.buffer_geometry(corners, normals, uv)


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
        finish |= {"emissive": _hex_color(_rgba(model, geom)), "emissiveIntensity": round(emission, 3)}
    return finish


# --- textures ---------------------------------------------------------------------------------------------------------

_FACES = np.array([
    [(1, 0, 0), (0, 0, -1), (0, -1, 0)],
    [(-1, 0, 0), (0, 0, 1), (0, -1, 0)],
    [(0, 1, 0), (1, 0, 0), (0, 0, 1)],
    [(0, -1, 0), (1, 0, 0), (0, 0, -1)],
    [(0, 0, 1), (1, 0, 0), (0, -1, 0)],
    [(0, 0, -1), (-1, 0, 0), (0, -1, 0)],
], float)  # fmt: skip
"""For each face of a cube map: the direction it faces, and the directions in which its columns and rows run."""
_UP = 4
_CORNERS = np.array([(-1, -1), (-1, 1), (1, 1), (-1, -1), (1, 1), (1, -1)], float)
"""Column and row, in [-1, 1], of the corners of a face's two triangles."""


def _texture(model: mujoco.MjModel, geom: int) -> tuple[NDArray[np.uint8] | None, bool]:
    """A geom's color texture, shape (h, w, channels), or None, and whether it is a cube map."""
    material, roles = model.geom_matid[geom], mujoco.mjtTextureRole
    for role in (roles.mjTEXROLE_RGB, roles.mjTEXROLE_RGBA) if material >= 0 else ():
        texture = model.mat_texid[material, int(role)]
        if texture >= 0:
            shape = model.tex_height[texture], model.tex_width[texture], model.tex_nchannel[texture]
            start = model.tex_adr[texture]
            pixels = model.tex_data[start : start + np.prod(shape)].reshape(shape)
            return pixels, bool(model.tex_type[texture] == mujoco.mjtTexture.mjTEXTURE_CUBE)
    return None, False


def _wrapped(model: mujoco.MjModel, geom: int, faces: int) -> Json:
    """The triangles of a box or plane that wears its texture as MuJoCo puts it on.

    A cube texture, of 1 or 6 ``faces``, is wrapped around a box. A 2d texture, of none, is projected on each pair of
    faces along their normal: it repeats ``texrepeat`` times over the face, or per meter where ``texuniform``.
    """
    material, size = int(model.geom_matid[geom]), np.asarray(model.geom_size[geom], float)
    plane = model.geom_type[geom] == _GEOM.mjGEOM_PLANE
    half = _visible_half(size) if plane else size
    normal, right, down = (axis[:, None] for axis in _FACES.transpose(1, 0, 2))  # (6, 1, 3)
    positions = (normal + _CORNERS[:, :1] * right + _CORNERS[:, 1:] * down) * half  # (6, 6, 3): faces, corners
    normals = np.broadcast_to(normal, positions.shape)
    if faces:
        picture = np.arange(6)[:, None] if faces == 6 else np.zeros((6, 1))
        column, row = 0.5 * (_CORNERS.T + 1)
        row = (row + picture) / faces
        uv = np.stack(np.broadcast_arrays(column, 1 - row), axis=-1)  # three.js counts rows from the bottom
    else:
        axes = np.repeat([(1, 2), (0, 2), (0, 1)], 2, axis=0)  # (6, 2): those of a face's columns and rows
        along = np.take_along_axis(positions, axes[:, None], axis=2)
        # An infinite plane repeats its texture over each meter, a finite one over its size.
        per_meter = model.mat_texuniform[material] or (plane and not size[0] > 0)
        scale = np.ones(2) if per_meter else 1 / np.maximum(half[axes], 1e-9)[:, None]
        uv = 0.5 * along * scale * np.asarray(model.mat_texrepeat[material], float) - 0.5
    drawn = slice(_UP, _UP + 1) if plane else slice(None)
    return Group.buffer_geometry(positions[drawn], normals[drawn], uv[drawn])


# --- overlays ---------------------------------------------------------------------------------------------------------

Color = tuple[float, float, float]
# Okabe and Ito's colors, which people with any color vision tell apart.
ORANGE, SKY, GREEN, VERMILION = (0.902, 0.624, 0.0), (0.337, 0.706, 0.914), (0.0, 0.62, 0.451), (0.835, 0.369, 0.0)


class Overlay(Group):
    """One overlay under construction, in the frame it is attached to: an object for the page, and rods for stills.

    Attributes
    ----------
    rods
        Segments drawn in stills, shape (n, 2, 3), m, with their RGBA and their radius, m.
    """

    def __init__(self) -> None:
        super().__init__()
        self.rods: list[tuple[Array, ArrayLike, float]] = []

    def cylinders(self, rods: Array, rgba: ArrayLike, radius: float, in_stills: float | None = None) -> None:
        """Add rods, shape (n, 2, 3); ``in_stills`` is their radius there, if it is another."""
        if not len(rods):
            return
        self.rods.append((rods, rgba, in_stills or radius))
        along = rods[:, 1] - rods[:, 0]
        length = np.linalg.norm(along, axis=1)
        y = along / np.maximum(length, 1e-12)[:, None]
        aside = np.where(np.abs(y[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
        x = np.cross(y, aside)
        x /= np.linalg.norm(x, axis=1, keepdims=True)
        poses = np.tile(np.eye(4), (len(rods), 1, 1))
        poses[:, :3] = np.stack([x, y * length[:, None], np.cross(x, y), rods.mean(axis=1)], axis=-1)
        ends = {"radiusTop": radius, "radiusBottom": radius}
        shape = {"type": "CylinderGeometry", **ends, "height": 1, "radialSegments": 8}
        self.instances(shape, self.material(rgba, "MeshBasicMaterial"), poses)

    def draw(self, scene: mujoco.MjvScene, world_from_overlay: Array) -> None:
        """Draw the rods into a scene that MuJoCo is about to render."""
        capsule = mujoco.mjtGeom.mjGEOM_CAPSULE
        for rods, rgba, radius in self.rods:
            ends = rods @ world_from_overlay[:3, :3].T + world_from_overlay[:3, 3]
            color = np.asarray(rgba, np.float32)
            for start, end in ends[: scene.maxgeom - scene.ngeom]:
                geom = scene.geoms[scene.ngeom]
                mujoco.mjv_initGeom(geom, capsule, np.zeros(3), np.zeros(3), np.zeros(9), color)
                mujoco.mjv_connector(geom, capsule, radius, start, end)
                geom.emission = 0.6
                geom.segid = scene.ngeom  # or a second pass, which finds the background, reads past its table
                geom.objid, geom.objtype = 0, int(mujoco.mjtObj.mjOBJ_UNKNOWN)
                geom.category = mujoco.mjtCatBit.mjCAT_DECOR
                scene.ngeom += 1

    def balls(self, positions: Array, rgba: ArrayLike, radius: float) -> None:
        """Add balls at points, shape (n, 3), to the page alone."""
        poses = np.tile(np.eye(4), (len(positions), 1, 1))
        poses[:, :3, 3] = positions
        shape = {"type": "SphereGeometry", "radius": radius, "widthSegments": 12, "heightSegments": 8}
        self.instances(shape, self.material(rgba, "MeshBasicMaterial"), poses)


def frustum(intrinsics: CameraIntrinsics, depth: float, color: Color, image: NDArray[np.uint8] | None) -> Overlay:
    """What a camera sees, in its optical frame, as a pyramid ``depth`` m deep; ``image`` is stretched on its base."""
    _check_lengths(depth=depth)
    image = None if image is None else check_rgb(image)
    w, h = intrinsics.width - 0.5, intrinsics.height - 0.5
    rays = intrinsics.rays([(-0.5, -0.5), (w, -0.5), (w, h), (-0.5, h)])
    corners = rays * (depth / rays[:, 2:])
    edges = [np.zeros((4, 3)), corners], [corners, np.roll(corners, -1, axis=0)]
    overlay = Overlay()
    overlay.cylinders(np.concatenate([np.stack(ends, axis=1) for ends in edges]), (*color, 1.0), 0.008 * depth)
    uv = np.array([(0, 1), (0, 0), (1, 0), (0, 1), (1, 0), (1, 1)], float)
    rgba = (*color, 0.12) if image is None else (1, 1, 1, 1)
    paint = overlay.material(rgba, "MeshBasicMaterial", image, side=_DOUBLE_SIDE)
    overlay.mesh(overlay.buffer_geometry(corners[[0, 3, 2, 0, 2, 1]], None, uv), paint, shadow=False)
    return overlay


def sphere(virtual: VirtualSphere, max_tilt: float, color: Color) -> Overlay:
    """The cap of the virtual sphere within ``max_tilt`` rad of its pole: a veil with meridians and parallels."""
    if not 0 < max_tilt <= np.pi:
        raise InvalidParameterError(f"max_tilt is in radians, in (0, pi]; got {max_tilt}")
    # At the pole, the camera's axes are the pole's own y and x, and it looks along -z.
    world_from_camera = virtual.viewpoint(0.0, 0.0).rotation.as_matrix()
    world_from_pole = compose(virtual.center, world_from_camera[:, [1, 0, 2]] * (1, 1, -1))
    overlay = Overlay()
    cap = {"type": "SphereGeometry", "radius": virtual.radius, "widthSegments": 48, "heightSegments": 16}
    cap |= {"thetaStart": 0, "thetaLength": round(float(max_tilt), 5)}
    veil = overlay.material((*color, 0.13), side=_DOUBLE_SIDE, roughness=0.9)
    overlay.mesh(cap, veil, world_from_pole @ _AXIS_FROM_Y, shadow=False)
    around, up = np.linspace(0, 2 * np.pi, 49), np.linspace(0, max_tilt, 13)
    tilts = np.linspace(0, max_tilt, max(2, round(max_tilt / np.radians(10)) + 1))[1:]
    meridians = [(up, azimuth) for azimuth in np.linspace(0, 2 * np.pi, 13)[:-1]]
    segments = []
    for tilt, azimuth in [*meridians, *((tilt, around) for tilt in tilts)]:
        out = np.sin(tilt)
        curve = np.stack(np.broadcast_arrays(out * np.cos(azimuth), out * np.sin(azimuth), np.cos(tilt)), axis=-1)
        segments.append(np.stack([curve[:-1], curve[1:]], axis=1))
    rods = np.concatenate(segments) * virtual.radius @ world_from_pole[:3, :3].T + virtual.center
    overlay.lines(rods, overlay.material((*color, 0.55), "LineBasicMaterial"))
    overlay.rods.append((rods, (*color, 0.6), 0.0012 * virtual.radius))
    return overlay


def path(along: RigidTransform | ArrayLike, color: Color, radius: float, arrows: int) -> Overlay:
    """A path through points (n, 3), or through poses, whose viewing directions (+z) show as short pins."""
    _check_lengths(radius=radius)
    pins = np.empty((0, 2, 3))
    if isinstance(along, RigidTransform):
        positions = np.reshape(along.translation, (-1, 3))
        looks = np.reshape(along.rotation.as_matrix(), (-1, 3, 3))[:, :, 2]
        chosen = np.unique(np.linspace(0, len(positions) - 1, min(arrows, len(positions))).round().astype(int))
        pins = np.stack([positions[chosen], positions[chosen] + 12 * radius * looks[chosen]], axis=1)
    else:
        positions = _positions(along)
    steps = np.stack([positions[:-1], positions[1:]], axis=1)
    steps = steps[np.linalg.norm(steps[:, 1] - steps[:, 0], axis=1) > 1e-9]
    overlay, rgba = Overlay(), (*color, 1.0)
    overlay.cylinders(steps, rgba, radius)
    overlay.balls(positions, rgba, (1.8 if len(pins) else 1.0) * radius)  # without pins: round joints
    overlay.cylinders(pins, rgba, 0.6 * radius, in_stills=radius)
    return overlay


def frame(size: float) -> Overlay:
    """The axes of a frame: x red, y green, z blue."""
    _check_lengths(size=size)
    overlay = Overlay()
    for axis, rgb in zip(size * np.eye(3), [(0.86, 0.24, 0.2), (0.2, 0.62, 0.29), (0.2, 0.4, 0.86)], strict=True):
        overlay.cylinders(np.array([[np.zeros(3), axis]]), (*rgb, 1.0), 0.03 * size)
    return overlay


def points(positions: ArrayLike, color: Color, radius: float) -> Overlay:
    """Small balls at points (n, 3), meters."""
    _check_lengths(radius=radius)
    positions, overlay = _positions(positions), Overlay()
    overlay.balls(positions, (*color, 1.0), radius)
    # In a still, a ball is a rod of no length.
    overlay.rods.append((np.stack([positions, positions + (0, 0, 1e-4)], axis=1), (*color, 1.0), radius))
    return overlay


def _positions(points: ArrayLike) -> NDArray[np.float64]:
    """Points as an array (n, 3), m."""
    positions = np.asarray(points, float)
    if positions.shape[-1:] != (3,) or not np.isfinite(positions).all():
        raise InvalidParameterError(f"points are finite, of shape (n, 3), m; got shape {positions.shape}")
    return positions.reshape(-1, 3)


def _check_lengths(**given: float) -> None:
    for name, value in given.items():
        if not 0 < value < np.inf:
            raise InvalidParameterError(f"{name} is positive and finite, in m; got {value}")
