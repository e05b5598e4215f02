"""The thesis's seven objects (3.1, 3.2), and how to add one.

Your own object is an :class:`ObjectSpec`; the work cell takes it wherever it takes a name. The seven here are
examples of one: bricks from a loop, two toys from MJCF files, and a carton whose label is drawn by code.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gvp_lib.errors import UnknownNameError
from gvp_lib.perception.segmentation import HsvThreshold
from gvp_lib.simulation.normals import AcceptedNormal, CanonicalNormal
from gvp_lib.simulation.object_model import CONTACT, BoundingBox, ObjectSpec, add_object
from gvp_lib.simulation.soup_label import soup_label

__all__ = [
    "AcceptedNormal",
    "BoundingBox",
    "CONTACT",
    "CanonicalNormal",
    "BLUE",
    "OBJECTS",
    "ObjectSpec",
    "add_object",
    "object_spec",
]

PITCH = 0.0318  # m, a Duplo brick's
BODY_HEIGHT = 0.0192  # m, without studs
STUD_HEIGHT = 0.0045  # m
STUD_RADIUS = 0.0047  # m
BRICK_DENSITY = 300.0  # kg/m^3: a hollow brick of plastic, modeled as a solid of the same mass
CARTON = (0.067, 0.067, 0.100)  # m

_MODELS = Path(__file__).parent / "models"
_CONTACT_XML = 'condim="4" friction="0.8 0.002 0.0001" solref="0.005 1" solimp="0.95 0.99 0.001"'
_SIDE_FACES = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))


def box_normals(extents: tuple[float, float, float]) -> tuple[CanonicalNormal, ...]:
    """The six normals of a box, +z first; each major axis is the longer side of its face.

    Parameters
    ----------
    extents
        Lengths along x, y and z, meters. A face whose sides agree within 2 % counts as square.
    """
    normals = []
    axes = np.eye(3)
    for direction in ((0, 0, 1), *_SIDE_FACES, (0, 0, -1)):
        k = int(np.argmax(np.abs(direction)))
        i, j = (axis for axis in range(3) if axis != k)
        major = axes[i] if extents[i] >= extents[j] else axes[j]
        square = abs(extents[i] - extents[j]) < 0.02 * max(extents[i], extents[j])
        normals.append(CanonicalNormal(np.array(direction, float), major, np.pi / 2 if square else np.pi))
    return tuple(normals)


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


def _can() -> ObjectSpec:
    return ObjectSpec(
        name="cylinder",
        mjcf=_MODELS / "aerosol_can.xml",
        segmenter=HsvThreshold(hue=(135, 170), saturation=(0.45, 1.0), value=(0.08, 1.0)),
        normals=(CanonicalNormal(np.array([0.0, 0, 1])), CanonicalNormal(np.array([0.0, 0, -1]))),
        round_axis=np.array([0.0, 0, 1]),
        title="green aerosol can, 60 x 150 mm",
    )


def _alligator() -> ObjectSpec:
    # Back, and the two sides on which it can lie; nobody grasps it by the snout.
    directions = ((0, 0, 1), (0, 1, 0), (0, -1, 0))
    return ObjectSpec(
        name="alligator",
        mjcf=_MODELS / "alligator.xml",
        segmenter=HsvThreshold(hue=(75, 112), saturation=(0.45, 1.0), value=(0.08, 1.0)),
        normals=tuple(CanonicalNormal(np.array(d, float), np.array([1.0, 0, 0]), np.pi) for d in directions),
        title="toy alligator, 120 x 45 x 35 mm",
    )


def _soup() -> ObjectSpec:
    x, y, z = (length / 2 for length in CARTON)
    return ObjectSpec(
        name="tomato_soup_box",
        mjcf=f"""
<mujoco model="tomato_soup_box">
  <asset>
    <texture name="label" type="cube" builtin="flat" width="8" height="48"/>
    <material name="carton" texture="label" specular="0.4" shininess="0.4"/>
  </asset>
  <worldbody>
    <body name="carton">
      <geom name="box" type="box" size="{x} {y} {z}" mass="0.4" material="carton" {_CONTACT_XML}/>
    </body>
  </worldbody>
</mujoco>""",
        # From red through orange to cream, of which the last is pale. It takes in the red and the yellow brick.
        segmenter=HsvThreshold(hue=(345, 60), saturation=(0.25, 1.0), value=(0.08, 1.0)),
        normals=box_normals(CARTON),
        title="carton of tomato soup, 67 x 67 x 100 mm",
        textures={"label": soup_label()},
    )


BLUE = (0.05, 0.24, 0.76)

OBJECTS: dict[str, ObjectSpec] = {
    spec.name: spec
    for spec in (
        _brick(1, "red", (0.78, 0.06, 0.06), (342, 18)),
        _brick(2, "blue", BLUE, (205, 240)),
        _brick(3, "yellow", (0.92, 0.70, 0.05), (36, 62)),
        _brick(4, "purple", (0.46, 0.12, 0.66), (265, 300)),
        _can(),
        _alligator(),
        _soup(),
    )
}
"""The thesis's objects, by name."""


def object_spec(target: str | ObjectSpec) -> ObjectSpec:
    """The object of that name, or the spec itself.

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
