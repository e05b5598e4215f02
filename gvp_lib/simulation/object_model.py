"""What an object is to the work cell: an MJCF body, a segmenter that finds it, its canonical normals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError, ModelError
from gvp_lib.simulation.attaching import adopt_settings
from gvp_lib.simulation.normals import AcceptedNormal, CanonicalNormal, accepted_normal

if TYPE_CHECKING:
    from gvp_lib.perception.segmentation import Segmenter

__all__ = ["CONTACT", "BoundingBox", "ObjectSpec", "add_object"]

CONTACT = {
    "condim": 4,
    "friction": (0.8, 0.002, 0.0001),
    "solref": (0.005, 1.0),
    "solimp": (0.95, 0.99, 0.001, 0.5, 2.0),
}
"""Contact settings with which light objects neither creep nor sink, as attributes of an ``MjsGeom``."""

_SIDES = 0.001, 1.0  # m: the longest side of an object lies between them, or its lengths are not in meters
_OFF_CENTER = 0.05, 0.001  # of the longest side, or m if that is more: as far as a bounding box may be off the origin


@dataclass(frozen=True, eq=False)
class BoundingBox:
    """The box, along an object's axes, that just holds what of it can touch other things.

    Attributes
    ----------
    center, half_extents
        Shape (3,), meters, object frame.
    """

    center: NDArray[np.float64]
    half_extents: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ObjectSpec:
    """An object for the table: the thesis's, or your own.

    Attributes
    ----------
    name
        The name in error texts and results.
    mjcf
        An MJCF document, its text or its file, with exactly one top-level body and no joint (the cell adds a
        free one). Lengths are in meters, +z is up when it stands ``flat``, and by convention the body's origin is the
        center of its bounding box: :func:`gvp_lib.simulation.placements.place` does not rely on that, but experiments
        and data collection, which look at the origin, do; see :meth:`centered`.
    segmenter
        Finds the object in an RGB image, as an operator would have tuned it.
    normals
        Canonical normals, object frame; +z at any roll unless you list others.
    round_axis
        Axis of revolution, shape (3,), object frame, or None. Every direction across it is canonical as well.
    title
        A line for captions.
    textures
        Pixels, uint8 (height, width, 3), for textures that the MJCF declares by these names: pictures drawn
        by code, without a file. A cube texture is six squares, one above the other: +x, -x, +y, -y, +z, -z.

    Examples
    --------
    >>> xml = '<mujoco><worldbody><body><geom type="box" size=".02 .03 .01"/></body></worldbody></mujoco>'
    >>> soap = ObjectSpec("soap", xml, segmenter=lambda rgb: rgb[..., 0] > 128)
    >>> soap.bounding_box().half_extents.tolist()
    [0.02, 0.03, 0.01]
    """

    name: str
    mjcf: str | Path
    segmenter: Segmenter
    normals: tuple[CanonicalNormal, ...] = (CanonicalNormal((0, 0, 1)),)  # type: ignore[arg-type]
    round_axis: ArrayLike | None = None
    title: str = ""
    textures: Mapping[str, NDArray[np.uint8]] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        alone = isinstance(self.normals, CanonicalNormal)
        object.__setattr__(self, "normals", (self.normals,) if alone else tuple(self.normals))
        if not self.normals:
            raise InvalidParameterError(f"object {self.name!r} needs a canonical normal; leave them out for +z")
        if not all(isinstance(normal, CanonicalNormal) for normal in self.normals):
            raise InvalidParameterError(
                f"object {self.name!r}: normals are CanonicalNormal(direction), such as CanonicalNormal((0, 0, 1)); "
                f"got {self.normals!r}"
            )
        if not callable(self.segmenter) or isinstance(self.segmenter, type):
            raise InvalidParameterError(
                f"object {self.name!r}: a segmenter is called with an RGB image and returns a mask, such as "
                f"HsvThreshold(hue=(200, 240)) or Saliency(); got {self.segmenter!r}"
            )

    def load(self) -> mujoco.MjSpec:
        """A fresh ``MjSpec`` of the object alone, checked.

        Raises
        ------
        ModelError
            The MJCF does not parse or compile, has not exactly one top-level body, or has a joint.
        """
        is_text = isinstance(self.mjcf, str) and self.mjcf.lstrip().startswith("<")
        try:
            spec = mujoco.MjSpec.from_string(self.mjcf) if is_text else mujoco.MjSpec.from_file(str(self.mjcf))
        except (ValueError, OSError) as error:
            raise ModelError(f"the MJCF of object {self.name!r} cannot be read: {error}") from error
        bodies = spec.worldbody.bodies
        top = [body for body in bodies if body.parent.name == "world"]
        if len(top) != 1:
            names = ", ".join(repr(body.name) for body in top) or "none"
            raise ModelError(
                f"the MJCF of object {self.name!r} must have exactly one body in its worldbody; it has {names}. "
                "Put the parts of one object into one body"
            )
        if spec.joints:
            names = ", ".join(repr(joint.name) if joint.name else "one without a name" for joint in spec.joints)
            raise ModelError(
                f"the MJCF of object {self.name!r} must have no joint; it has {names}. "
                "Remove it: the work cell adds the free joint"
            )
        for name, pixels in self.textures.items():
            self._paint(spec, name, pixels)
        try:
            spec.compile()
        except ValueError as error:
            raise ModelError(f"the MJCF of object {self.name!r} does not compile: {error}") from error
        return spec

    def accepted_normal(self, world_from_object: RigidTransform) -> AcceptedNormal:
        """The canonical normal nearest the vertical, for the object as placed."""
        return accepted_normal(self.normals, self.round_axis, world_from_object)

    def bounding_box(self) -> BoundingBox:
        """The box about the object's collision geoms, along its axes; exact for primitives and meshes.

        Raises
        ------
        ModelError
            There is none, or its longest side is not between 1 mm and 1 m, so that it hardly is in meters.
        """
        box = self._box  # computed once: it takes a compilation, and every episode asks
        return BoundingBox(box.center.copy(), box.half_extents.copy())

    def centered(self) -> ObjectSpec:
        """The object itself, whose origin is the middle of its bounding box: for those who look at its origin.

        Raises
        ------
        ModelError
            The middle is off the origin by more than 5 % of the longest side, or 1 mm if that is more.
        """
        box = self.bounding_box()
        if np.linalg.norm(box.center) > max(_OFF_CENTER[0] * 2 * box.half_extents.max(), _OFF_CENTER[1]):
            off, back = (" ".join(f"{x:.6g}" for x in sign * box.center + 0.0) for sign in (1, -1))
            raise ModelError(
                f"the origin of object {self.name!r} must be the middle of its bounding box, which is at {off} (m, in "
                f"the body's frame). Move every geom of the body, and the bodies in it, by {back}: add it to their pos"
            )
        return self

    @cached_property
    def _box(self) -> BoundingBox:
        spec = self.load()
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        body = spec.worldbody.first_body().id
        object_from_world = data.xmat[body].reshape(3, 3).T
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        ours = model.body_rootid[model.geom_bodyid] == body
        touches = (model.geom_contype | model.geom_conaffinity) != 0
        for i in np.flatnonzero(ours & touches):
            center = object_from_world @ (data.geom_xpos[i] - data.xpos[body])
            rotation = object_from_world @ data.geom_xmat[i].reshape(3, 3)
            geom_low, geom_high = _geom_bounds(model, int(i), rotation)
            low, high = np.minimum(low, center + geom_low), np.maximum(high, center + geom_high)
        if not np.isfinite(low).all():
            raise ModelError(f"object {self.name!r} has no geom that can touch anything (contype, conaffinity)")
        sides = high - low
        if not _SIDES[0] <= sides.max() <= _SIDES[1]:
            measured = " x ".join(f"{side:.4g}" for side in sides)
            raise ModelError(
                f"object {self.name!r} measures {measured} m; MuJoCo takes lengths in meters, and an object's longest "
                "side is between 1 mm and 1 m. From millimeters: divide each size, pos and fromto by 1000, and scale a "
                'mesh, <mesh scale="0.001 0.001 0.001" .../>'
            )
        return BoundingBox(0.5 * (low + high), 0.5 * sides)

    def _paint(self, spec: mujoco.MjSpec, name: str, pixels: NDArray[np.uint8]) -> None:
        texture = spec.texture(name)
        if texture is None:
            known = ", ".join(repr(t.name) for t in spec.textures) or "none"
            raise ModelError(f"the MJCF of object {self.name!r} declares no texture {name!r}; it has {known}")
        texture.builtin = mujoco.mjtBuiltin.mjBUILTIN_NONE
        texture.height, texture.width, texture.nchannel = pixels.shape
        texture.data = np.ascontiguousarray(pixels).tobytes()


def add_object(scene: mujoco.MjSpec, spec: ObjectSpec, name: str, free: bool = True) -> mujoco.MjsBody:
    """Attach an object to a scene as the body ``name``; everything in it is prefixed ``name/``.

    Parameters
    ----------
    scene
        The scene, changed in place.
    spec
        The object.
    name
        The body's name in the scene, and its free joint's.
    free
        Whether it has a free joint; without one it is fixed at the world's origin.
    """
    child = spec.load()
    adopt_settings(child, scene)
    source = child.worldbody.first_body()
    source.pos, source.quat = (0, 0, 0), (1, 0, 0, 0)
    body = scene.worldbody.add_frame().attach_body(source, f"{name}/", "")
    body.name = name
    if free:
        body.add_freejoint(name=name)
    if any(_is_collision_mesh(geom) for geom in body.find_all(mujoco.mjtObj.mjOBJ_GEOM)):
        # On the one contact that a mesh otherwise has with a block, it would rock without end.
        scene.option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_MULTICCD)
    return body


def _is_collision_mesh(geom: mujoco.MjsGeom) -> bool:
    return geom.type == mujoco.mjtGeom.mjGEOM_MESH and bool(geom.contype or geom.conaffinity)


def _geom_bounds(
    model: mujoco.MjModel, geom: int, rotation: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest coordinates of a geom about its center, along axes in which it is turned by ``rotation``."""
    kind, size = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        start = model.mesh_vertadr[mesh]
        vertices = model.mesh_vert[start : start + model.mesh_vertnum[mesh]] @ rotation.T  # (n, 3)
        return vertices.min(0), vertices.max(0)
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        reach = np.full(3, size[0])
    elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        reach = size[0] + size[1] * np.abs(rotation[:, 2])
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        reach = size[0] * np.hypot(rotation[:, 0], rotation[:, 1]) + size[1] * np.abs(rotation[:, 2])
    elif kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        reach = np.linalg.norm(rotation * size, axis=1)
    else:  # a box; for rarer kinds, the box that MuJoCo keeps about them
        center, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
        reach = np.abs(rotation) @ half
        return rotation @ center - reach, rotation @ center + reach
    return -reach, reach
