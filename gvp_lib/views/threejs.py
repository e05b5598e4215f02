"""Objects of a 3D page, in the JSON form that three.js reads (its "Object/Scene format 4").

meshcat draws with three.js, and hands an object in this form straight to it. Spelling shapes by their parameters
rather than as triangles keeps a page small: a brick with eight studs is a kilobyte.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Group", "axis_from_y", "compose", "hex_color", "number_list"]

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
