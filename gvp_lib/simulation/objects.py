"""Objects to grasp: how to describe your own, and the thesis's seven (3.1, 3.2).

Your own object is an :class:`ObjectSpec`; the work cell takes it wherever it takes a name. The seven are examples:
bricks from a loop, two objects from MJCF files, and a carton with a printed label.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from textwrap import shorten
from typing import Any
from xml.sax.saxutils import quoteattr

import cv2
import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidImageError, InvalidParameterError, ModelError, UnknownNameError
from gvp_lib.perception.images import check_rgb
from gvp_lib.perception.segmentation import HsvThreshold, Segmenter
from gvp_lib.picture import Pictured
from gvp_lib.simulation.mjcf import absolute_meshes, read_model, resolved
from gvp_lib.simulation.truth import AcceptedNormal, CanonicalNormal, unit_vector

__all__ = [
    "BLUE",
    "CONTACT",
    "CONTACT_BIT",
    "OBJECTS",
    "BoundingBox",
    "ObjectSpec",
    "adopt_settings",
    "box_normals",
    "brick_mjcf",
    "object_spec",
]

CONTACT = {
    "condim": 4,
    "friction": (0.8, 0.002, 0.0001),
    "solref": (0.005, 1.0),
    "solimp": (0.95, 0.99, 0.001, 0.5, 2.0),
}
"""Attributes of an ``MjsGeom``: contact settings under which light objects neither creep nor sink."""

CONTACT_BIT = 1
"""Bit of a geom's ``contype`` and ``conaffinity``, MuJoCo's default, by which tables, blocks and fingers touch objects.
"""

_UP = np.array([0.0, 0.0, 1.0])


@checked
@dataclass(frozen=True, eq=False)
class BoundingBox:
    """Tightest box around an object's collision geoms, along the object's axes.

    Attributes
    ----------
    center
        Center, shape (3,), m, object frame.
    half_extents
        Half the lengths along x, y and z, shape (3,), m.

    Examples
    --------
    >>> from gvp_lib import OBJECTS
    >>> OBJECTS["cylinder"].bounding_box()
    BoundingBox(60.0 x 60.0 x 150.0 mm, center at (0.0, 0.0, 0.0) mm)
    """

    center: NDArray[np.float64]
    half_extents: NDArray[np.float64]

    def __repr__(self) -> str:
        sides = " x ".join(f"{side:.1f}" for side in 2e3 * self.half_extents)
        center = ", ".join(f"{x:.1f}" for x in np.round(1e3 * self.center, 1) + 0.0)
        return f"BoundingBox({sides} mm, center at ({center}) mm)"


@checked
@dataclass(frozen=True, eq=False)
class ObjectSpec(Pictured):
    """Object to grasp: one of the thesis's, or your own.

    A relative path, of its model or in it, starts from the folder that was the current one when the spec was made.

    Parameters
    ----------
    name
        Name in error messages and results.
    mjcf
        MJCF model, as text or as a file, of exactly one top-level body, rigid and free: the cell adds the free joint,
        or puts its own in the place of the body's. Lengths in meters, +z up when the object stands ``flat``. By
        convention the body's origin is the center of its bounding box, at which experiments and data collection look;
        see :meth:`centered`.
    segmenter
        Segmenter that finds the object in an RGB image, tuned as an operator would have.
    normals
        Canonical normals, object frame; by default +z, at any roll.
    round_axis
        Axis of revolution, shape (3,), object frame, or None. Every direction perpendicular to it is canonical, too.
    title
        Caption.
    textures
        Pixels, uint8 (height, width, 3), by the names of textures that the MJCF declares: images from code instead of
        files. A cube texture is six squares, one above the other: +x, -x, +y, -y, +z, -z.

    Examples
    --------
    >>> xml = '<mujoco><worldbody><body><geom type="box" size=".02 .03 .01"/></body></worldbody></mujoco>'
    >>> soap = ObjectSpec("soap", xml, segmenter=lambda rgb: rgb[..., 0] > 128, title="bar of soap")
    >>> soap
    ObjectSpec(soap: bar of soap, 1 normal)
    >>> soap.bounding_box()
    BoundingBox(40.0 x 60.0 x 20.0 mm, center at (0.0, 0.0, 0.0) mm)
    """

    _figure = "plot_object"

    name: str
    mjcf: str | Path
    segmenter: Segmenter
    normals: tuple[CanonicalNormal, ...] = (CanonicalNormal((0, 0, 1)),)  # type: ignore[arg-type]
    round_axis: ArrayLike | None = None
    title: str = ""
    textures: Mapping[str, NDArray[np.uint8]] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "mjcf", resolved(self.mjcf, f"object {self.name!r}"))
        single = isinstance(self.normals, CanonicalNormal)
        object.__setattr__(self, "normals", (self.normals,) if single else tuple(self.normals))
        if not self.normals or not all(isinstance(normal, CanonicalNormal) for normal in self.normals):
            raise InvalidParameterError(
                f"object {self.name!r}: normals are CanonicalNormal(direction), such as CanonicalNormal((0, 0, 1)), "
                f"one or more; got {self.normals!r}"
            )
        if not callable(self.segmenter) or isinstance(self.segmenter, type):
            raise InvalidParameterError(
                f"object {self.name!r}: a segmenter is called with an RGB image and returns a mask, such as "
                f"HsvThreshold(hue=(200, 240)) or Saliency(); got {self.segmenter!r}"
            )
        if self.round_axis is not None:
            unit_vector(self.round_axis, f"object {self.name!r}: a round axis")

    def __repr__(self) -> str:
        title = shorten(f"{self.name}: {self.title}" if self.title else self.name, 120)
        count = len(self.normals)
        return f"ObjectSpec({title}, {count} normal{'s' * (count > 1)}{', round' * (self.round_axis is not None)})"

    @classmethod
    def from_file(
        cls, path: str | os.PathLike[str], segmenter: Segmenter, *, rgb: ArrayLike, scale: float = 1.0
    ) -> ObjectSpec:
        """Object of a mesh or an MJCF file as it comes: painted one color, its origin moved to the middle of its box.

        The faces of that box are its canonical normals, which only a judge reads. Where a model has geoms that are only
        drawn, these are what is seen of it. A mesh has the density of something hollow, 300 kg/m^3, and collides as its
        convex hull; an MJCF keeps its masses and contact settings.

        Parameters
        ----------
        path
            Mesh (OBJ, STL, MSH), or MJCF as in :class:`ObjectSpec`; its name, without the ending, is the object's.
        segmenter
            Segmenter that finds the color.
        rgb
            Color, shape (3,), in [0, 1].
        scale
            Unit of a mesh's lengths, m: 0.001 for a mesh in millimeters. An MJCF says itself.

        Raises
        ------
        ModelError
            MuJoCo cannot read the file, or what is in it is no object; see :meth:`load` and :meth:`bounding_box`.

        Examples
        --------
        >>> from importlib.resources import files
        >>> path = files("gvp_lib") / "simulation" / "models" / "alligator.xml"
        >>> ObjectSpec.from_file(path, HsvThreshold(hue=(345, 15)), rgb=(0.8, 0.1, 0.1))
        ObjectSpec(alligator: alligator.xml, 6 normals)
        """
        file, color = Path(path).expanduser().resolve(), np.asarray(rgb, float)
        if color.shape != (3,) or not ((color >= 0) & (color <= 1)).all():
            raise InvalidParameterError(f"rgb is a color, three numbers in [0, 1]; got {rgb!r}")
        if not 0 < scale < np.inf:
            raise InvalidParameterError(f"scale is the length of a mesh's unit in m, 0.001 for mm; got {scale!r}")
        is_model = file.suffix.lower() in (".xml", ".mjcf", ".urdf")
        raw = cls(file.stem, file if is_model else mesh_mjcf(file, scale), segmenter, title=file.name)
        box, model = raw.bounding_box(), raw.load()
        drawn = [not (geom.contype | geom.conaffinity) & CONTACT_BIT for geom in model.geoms]
        for geom, seen in zip(model.geoms, drawn, strict=True):
            geom.material, geom.rgba = "", (*color, float(seen or not any(drawn)))
        for part in (*model.materials, *model.textures):
            model.delete(part)
        absolute_meshes(model)
        centered = mujoco.MjSpec()
        centered.worldbody.add_body().add_frame(pos=-box.center).attach_body(model.worldbody.first_body(), "own/", "")
        centered.compile()
        x, y, z = (2 * box.half_extents).tolist()
        return replace(raw, mjcf=centered.to_xml(), normals=box_normals((x, y, z)))

    def load(self) -> mujoco.MjSpec:
        """Build a new ``MjSpec`` of the object alone, without a joint, and check it.

        Keyframes and contact excludes are removed: a rigid object has no use for them.

        Raises
        ------
        ModelError
            The MJCF does not parse or compile, has an equality or a joint other than its body's free one, lacks a
            texture, or has not exactly one top-level body.
        InvalidParameterError
            A texture's pixels are no RGB image.
        """
        spec = read_model(self.mjcf, f"object {self.name!r}")
        top = [body for body in spec.bodies if body.parent == spec.worldbody]
        if len(top) != 1:
            raise ModelError(
                f"the MJCF of object {self.name!r} must have exactly one body in its worldbody; it has {_names(top)}. "
                "Put the parts of one object into one body"
            )
        if spec.compiler.settotalmass > 0:
            raise ModelError(
                f"the MJCF of object {self.name!r} sets settotalmass={spec.compiler.settotalmass:g}, which MuJoCo does "
                "not carry into a work cell; give the geoms a density (kg/m^3) or a mass (kg)"
            )
        spec.compiler.alignfree = False  # it would turn the axes that the normals are given in
        free = [joint for joint in top[0].joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
        for part in (*spec.keys, *spec.excludes, *free):
            spec.delete(part)
        spec.nkey = 0  # or else empty ones come in their place
        for kind, parts in (("joint but a free one of its body", spec.joints), ("equality", spec.equalities)):
            if parts:
                raise ModelError(
                    f"the MJCF of object {self.name!r} must have no {kind}; it has {_names(parts)}. "
                    "Remove it: in the work cell an object is one rigid piece, and nothing holds it"
                )
        for name, pixels in self.textures.items():
            texture = spec.texture(name)
            if texture is None:
                raise ModelError(
                    f"the MJCF of object {self.name!r} declares no texture {name!r}; it has {_names(spec.textures)}"
                )
            try:
                image = check_rgb(pixels)
            except InvalidImageError as error:
                raise InvalidParameterError(f"texture {name!r} of object {self.name!r}: {error}") from error
            texture.builtin = mujoco.mjtBuiltin.mjBUILTIN_NONE
            texture.height, texture.width, texture.nchannel = image.shape
            texture.data = np.ascontiguousarray(image).tobytes()
        try:
            spec.compile()
        except (ValueError, mujoco.FatalError) as error:
            raise ModelError(f"the MJCF of object {self.name!r} does not compile: {error}") from error
        return spec

    def attach_to(self, scene: mujoco.MjSpec, name: str) -> mujoco.MjsBody:
        """Attach the object to a scene, as a body on a free joint.

        Parameters
        ----------
        scene
            Scene to change.
        name
            Name of the body and of its joint. The names of everything in it get the prefix ``name/``.
        """
        child = self.load()
        adopt_settings(child, scene)
        source = child.worldbody.first_body()
        source.pos, source.quat = (0, 0, 0), (1, 0, 0, 0)
        body = scene.worldbody.add_frame().attach_body(source, f"{name}/", "")
        body.name = name
        body.add_freejoint(name=name)
        geoms = body.find_all(mujoco.mjtObj.mjOBJ_GEOM)
        meshes = [geom for geom in geoms if geom.type == mujoco.mjtGeom.mjGEOM_MESH]
        if any((geom.contype | geom.conaffinity) & CONTACT_BIT for geom in meshes):
            # On the one contact that a mesh otherwise has with a block, it would rock without end.
            scene.option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_MULTICCD)
        return body

    def accepted_normal(self, world_from_object: RigidTransform) -> AcceptedNormal:
        """Canonical normal nearest the vertical for the object as placed, in the world frame.

        The first of ``normals`` if several are equally near. For a direction perpendicular to the round axis, that axis
        is the major axis, and the symmetry is 180 deg.

        Parameters
        ----------
        world_from_object
            Pose of the object.

        Examples
        --------
        >>> OBJECTS["cuboid_1x2"].accepted_normal(RigidTransform.identity())
        AcceptedNormal((0, 0, 1), major axis (1, 0, 0), symmetry 180 deg)
        """
        rotation = world_from_object.rotation.as_matrix()  # Rotation.apply refuses read-only arrays
        candidates = []
        for n in self.normals:
            major = None if n.major_axis is None else rotation @ n.major_axis
            candidates.append(AcceptedNormal(rotation @ n.direction, major, n.symmetry))
        if self.round_axis is not None:
            axis = rotation @ unit_vector(self.round_axis, "a round axis")
            # For a standing can the circle is level and its "nearest member" arbitrary; it is never chosen then.
            up = _UP - axis[2] * axis
            if np.linalg.norm(up) > 1e-9:
                candidates.append(AcceptedNormal(up, axis, np.pi, circle_axis=axis))
        # Rounded, so that a pose's last bits do not decide between a brick's two level faces.
        return min(candidates, key=lambda n: round(n.angle(_UP), 9))

    def bounding_box(self) -> BoundingBox:
        """Tightest box around the object's collision geoms; exact for primitives and meshes.

        Raises
        ------
        ModelError
            The object cannot be in a work cell: it does not compile as a body that moves freely (it has no mass, or is
            tied to the world), has no geom that can touch the table, or its longest side is not between 1 mm and 1 m.
        """
        return BoundingBox(self._box.center.copy(), self._box.half_extents.copy())

    def centered(self) -> ObjectSpec:
        """Check that the origin is the center of the bounding box, and return the object itself.

        Raises
        ------
        ModelError
            They are apart by more than 5 % of the longest side, or 1 mm if that is more.
        """
        box = self.bounding_box()
        if np.linalg.norm(box.center) > max(0.05 * 2 * box.half_extents.max(), 0.001):
            center, shift = (" ".join(f"{x:.6g}" for x in sign * box.center + 0.0) for sign in (1, -1))
            raise ModelError(
                f"the origin of object {self.name!r} must be the center of its bounding box, which is at {center} (m, "
                f"body frame). Move every geom of the body, and the bodies in it, by {shift}: add it to their pos"
            )
        return self

    @cached_property
    def _box(self) -> BoundingBox:  # once: it takes a compilation, and every episode asks
        scene = mujoco.MjSpec()
        self.attach_to(scene, "object")
        try:
            model = scene.compile()
        except (ValueError, mujoco.FatalError) as error:
            alone = self.load().compile()
            self._measured(alone)  # the size may be to blame
            raise ModelError(
                f"object {self.name!r} compiles alone, but not as a body that moves freely in a work cell: {error}. It "
                f"weighs {alone.body_subtreemass[1]:.3g} kg, by the density (kg/m^3) or the mass (kg) of its geoms. "
                "None of them may be a plane, and what names the body itself, or the world, has to name a site or a "
                "geom of the body instead"
            ) from error
        fields = [name for name in dir(model) if name.startswith(("body_", "geom_"))]
        if wrong := [name for name in fields if not np.isfinite(getattr(model, name)).all()]:
            raise ModelError(f"object {self.name!r} has numbers that are not finite, in its {', '.join(wrong)}")
        return self._measured(model)

    def _measured(self, model: mujoco.MjModel) -> BoundingBox:
        """Bounding box of the first body after the world and of the bodies in it."""
        data, body = mujoco.MjData(model), 1
        mujoco.mj_kinematics(model, data)
        object_from_world = data.xmat[body].reshape(3, 3).T
        low, high = np.full((2, 3), np.inf), np.full((2, 3), -np.inf)  # of what can touch the table, and of everything
        collides = ((model.geom_contype | model.geom_conaffinity) & CONTACT_BIT) != 0
        endless = np.isin(model.geom_type, (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD))
        for i in np.flatnonzero(~endless & (model.geom_bodyid > 0)):
            center = object_from_world @ (data.geom_xpos[i] - data.xpos[body])
            rotation = object_from_world @ data.geom_xmat[i].reshape(3, 3)
            geom_low, geom_high = _geom_bounds(model, int(i), rotation)
            which = slice(0 if collides[i] else 1, 2)
            low[which] = np.minimum(low[which], center + geom_low)
            high[which] = np.maximum(high[which], center + geom_high)
        if not np.isfinite(low[0]).all():
            raise ModelError(
                f"object {self.name!r} has no geom that can touch the table: a box, a mesh or the like, with bit 1 in "
                "contype or conaffinity, as by default. It would fall through the table; leave both attributes out, or "
                'write contype="1" conaffinity="1"'
            )
        sides = high - low
        if sides[0].max() < 0.001 or sides[1].max() > 1.0:
            large = sides[1].max() > 1.0
            measured = " x ".join(f"{side:.4g}" for side in sides[int(large)])
            mend = (
                "Multiply each size, pos and fromto by 0.001 if they are in millimeters, by 0.0254 if in inches, and "
                'scale a mesh likewise, also one that is only drawn: <mesh scale="0.001 0.001 0.001" .../>'
                if large
                else 'Perhaps it is scaled twice: a file in meters needs no <mesh scale="0.001 0.001 0.001" .../>'
            )
            raise ModelError(
                f"object {self.name!r} measures {measured} m; MuJoCo takes lengths in meters, and an object's longest "
                f"side is between 1 mm and 1 m. {mend}"
            )
        return BoundingBox(0.5 * (low[0] + high[0]), 0.5 * sides[0])


def adopt_settings(child: mujoco.MjSpec, scene: mujoco.MjSpec) -> None:
    """Give a model the settings of the scene it is about to be attached to.

    A model brings its own time step, gravity, solver, picture settings and memory; MuJoCo would warn of each that
    differs. How its angles, inertias and file names are read (its ``compiler``) stays its own.
    """
    child.option, child.visual, child.stat = scene.option, scene.visual, scene.stat
    for name in ("memory", "njmax", "nconmax", "nstack"):
        setattr(child, name, getattr(scene, name))
    for kind in ("data", "_body", "_jnt", "_geom", "_site", "_cam", "_tendon", "_actuator", "_sensor"):
        most = max(getattr(child, f"nuser{kind}"), getattr(scene, f"nuser{kind}"))  # room for what either has
        setattr(child, f"nuser{kind}", most)
        setattr(scene, f"nuser{kind}", most)


def _names(parts: Iterable[Any]) -> str:
    names = ", ".join(repr(part.name) if part.name else "an unnamed one" for part in parts)
    return shorten(names, 200, placeholder=" ...") or "none"


def _geom_bounds(
    model: mujoco.MjModel, geom: int, rotation: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest coordinates of a geom rotated by ``rotation``, relative to its center, each (3,), m."""
    size, middle = model.geom_size[geom], np.zeros(3)
    match mujoco.mjtGeom(model.geom_type[geom]):
        case mujoco.mjtGeom.mjGEOM_MESH:
            mesh = model.mesh(model.geom_dataid[geom])
            vertices = model.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]] @ rotation.T  # (n, 3)
            return vertices.min(0), vertices.max(0)
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            extent = np.full(3, size[0])
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            extent = size[0] + size[1] * np.abs(rotation[:, 2])
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            extent = size[0] * np.hypot(rotation[:, 0], rotation[:, 1]) + size[1] * np.abs(rotation[:, 2])
        case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            extent = np.linalg.norm(rotation * size, axis=1)
        case _:  # a box; for rarer kinds, the box that MuJoCo keeps about them
            middle, extent = rotation @ model.geom_aabb[geom, :3], np.abs(rotation) @ model.geom_aabb[geom, 3:]
    return middle - extent, middle + extent


# --- the seven objects ------------------------------------------------------------------------------------------

PITCH = 0.0318  # m, a Duplo brick's
BODY_HEIGHT = 0.0192  # m, without studs
STUD_HEIGHT = 0.0045  # m
STUD_RADIUS = 0.0047  # m
BRICK_DENSITY = 300.0  # kg/m^3: a hollow brick of plastic, modeled as a solid of the same mass

_MODELS = Path(__file__).parent / "models"
_LABEL = np.asarray(cv2.imread(str(_MODELS / "tomato_soup_label.png")), np.uint8)[..., ::-1]  # OpenCV reads BGR
_LABEL.flags.writeable = False
_CONTACT_XML = 'condim="4" friction="0.8 0.002 0.0001" solref="0.005 1" solimp="0.95 0.99 0.001"'


@checked
def box_normals(extents: tuple[float, float, float]) -> tuple[CanonicalNormal, ...]:
    """Six normals of a box, +z first; each major axis is the longer side of its face.

    Parameters
    ----------
    extents
        Lengths along x, y and z, m. A face whose sides agree within 2 % counts as square.

    Examples
    --------
    >>> box_normals((0.03, 0.06, 0.03))[0]
    CanonicalNormal((0, 0, 1), major axis (0, 1, 0), symmetry 180 deg)
    """
    if np.shape(extents) != (3,) or not all(0 < extent < np.inf for extent in extents):
        raise InvalidParameterError(f"a box has three extents, positive and finite, in m; got {extents!r}")
    normals = []
    for direction in ((0, 0, 1), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, -1)):
        longer, shorter = sorted(np.flatnonzero(np.array(direction) == 0), key=lambda axis: -extents[axis])
        square = extents[longer] - extents[shorter] < 0.02 * extents[longer]
        normals.append(CanonicalNormal(np.array(direction), np.eye(3)[longer], np.pi / 2 if square else np.pi))
    return tuple(normals)


def mesh_mjcf(file: Path, scale: float) -> str:
    """A mesh file as an object, of a unit of ``scale`` m; as heavy as a brick of its hull's size."""
    return f"""
<mujoco>
  <asset><mesh name="mesh" file={quoteattr(str(file))} scale="{scale} {scale} {scale}"/></asset>
  <worldbody><body><geom type="mesh" mesh="mesh" density="{BRICK_DENSITY}" {_CONTACT_XML}/></body></worldbody>
</mujoco>"""


def brick_mjcf(pitches: int, rgb: tuple[float, float, float]) -> str:
    """A studded brick, one pitch wide (y) and ``pitches`` long (x); its origin is its box's center, studs included."""
    z_body, z_stud = -STUD_HEIGHT / 2, BODY_HEIGHT / 2
    xs = (np.arange(2 * pitches) - (2 * pitches - 1) / 2) * PITCH / 2
    studs = "\n".join(
        f'<geom name="stud_{i}_{j}" class="stud" pos="{x:.6g} {y:.6g} {z_stud:.6g}"/>'
        for i, x in enumerate(xs)
        for j, y in enumerate((-PITCH / 4, PITCH / 4))
    )
    return f"""
<mujoco model="brick_1x{pitches}">
  <default>
    <geom {_CONTACT_XML} density="{BRICK_DENSITY}" material="plastic"/>
    <default class="stud"><geom type="cylinder" size="{STUD_RADIUS} {STUD_HEIGHT / 2}"/></default>
  </default>
  <asset>
    <material name="plastic" rgba="{rgb[0]} {rgb[1]} {rgb[2]} 1" specular="0.9" shininess="0.7"/>
  </asset>
  <worldbody>
    <body name="brick">
      <geom name="body" type="box" size="{pitches * PITCH / 2:.6g} {PITCH / 2} {BODY_HEIGHT / 2}"
            pos="0 0 {z_body:.6g}"/>
      {studs}
    </body>
  </worldbody>
</mujoco>"""


def _brick(pitches: int, color: str, rgb: tuple[float, float, float], hue: tuple[float, float]) -> ObjectSpec:
    return ObjectSpec(
        name=f"cuboid_1x{pitches}",
        mjcf=brick_mjcf(pitches, rgb),
        segmenter=HsvThreshold(hue=hue, saturation=(0.45, 1.0), value=(0.08, 1.0)),
        normals=box_normals((pitches * PITCH, PITCH, BODY_HEIGHT + STUD_HEIGHT)),
        title=f"{color} Duplo brick, 2 x {2 * pitches} studs",
    )


BLUE = (0.05, 0.24, 0.76)

OBJECTS: dict[str, ObjectSpec] = {
    spec.name: spec
    for spec in (
        _brick(1, "red", (0.78, 0.06, 0.06), (342, 18)),
        _brick(2, "blue", BLUE, (205, 240)),
        _brick(3, "yellow", (0.92, 0.70, 0.05), (36, 62)),
        _brick(4, "purple", (0.46, 0.12, 0.66), (265, 300)),
        ObjectSpec(
            name="cylinder",
            mjcf=_MODELS / "aerosol_can.xml",
            segmenter=HsvThreshold(hue=(135, 170), saturation=(0.45, 1.0), value=(0.08, 1.0)),
            normals=(CanonicalNormal(_UP), CanonicalNormal(np.array([0, 0, -1]))),
            round_axis=_UP,
            title="green aerosol can, 60 x 150 mm",
        ),
        ObjectSpec(
            name="alligator",
            mjcf=_MODELS / "alligator.xml",
            segmenter=HsvThreshold(hue=(75, 112), saturation=(0.45, 1.0), value=(0.08, 1.0)),
            # Back, and the two sides on which it can lie; nobody grasps it by the snout.
            normals=tuple(CanonicalNormal(d, np.eye(3)[0], np.pi) for d in (_UP, np.eye(3)[1], np.array([0, -1, 0]))),
            title="toy alligator, 120 x 45 x 35 mm",
        ),
        ObjectSpec(
            name="tomato_soup_box",
            mjcf=_MODELS / "tomato_soup_box.xml",
            # From red through orange to cream, of which the last is pale. It takes in the red and the yellow brick.
            segmenter=HsvThreshold(hue=(345, 60), saturation=(0.25, 1.0), value=(0.08, 1.0)),
            normals=box_normals((0.067, 0.067, 0.100)),
            title="carton of tomato soup, 67 x 67 x 100 mm",
            textures={"label": _LABEL},
        ),
    )
}
"""The thesis's objects by name."""


def object_spec(target: str | ObjectSpec) -> ObjectSpec:
    """The known object of that name, or the spec itself.

    Raises
    ------
    UnknownNameError
        No object has that name; the text lists those there are.
    """
    if isinstance(target, ObjectSpec):
        return target
    if target not in OBJECTS:
        raise UnknownNameError("object", target, OBJECTS)
    return OBJECTS[target]
