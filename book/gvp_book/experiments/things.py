"""Two dozen things that nobody designed a planner for: household objects made by code, one color each.

They were chosen, with the seeds and the starts of their experiment, before the planner that is measured on them was
begun, and stay as they are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from gvp_lib.perception.segmentation import HsvThreshold
from gvp_lib.simulation.objects import ObjectSpec, box_normals
from gvp_lib.simulation.truth import CanonicalNormal

__all__ = ["NOT_CONVEX", "PLACED", "THINGS", "UNEQUAL", "encounters"]

Geom = str
_COLOR: dict[str, str] = {}  # of each thing
Point = Sequence[float]

_COLORS = {  # rgb, and the hues by which to find it, deg
    "red": ((0.78, 0.06, 0.06), (342, 18)),
    "orange": ((0.93, 0.40, 0.04), (14, 34)),
    "yellow": ((0.92, 0.70, 0.05), (36, 62)),
    "green": ((0.05, 0.52, 0.22), (125, 165)),
    "cyan": ((0.03, 0.55, 0.62), (170, 200)),
    "blue": ((0.05, 0.24, 0.76), (205, 240)),
    "purple": ((0.46, 0.12, 0.66), (265, 300)),
    "pink": ((0.86, 0.12, 0.50), (312, 340)),
}


def _numbers(values: Sequence[float] | np.ndarray, scale: float = 1e-3) -> str:
    return " ".join(f"{scale * value:.6g}" for value in np.ravel(values))


# Geoms; all lengths in mm, angles in deg.


def _box(x: float, y: float, z: float, at: Point, euler: Point = (0, 0, 0)) -> Geom:
    """A box of full sides x, y, z."""
    half = _numbers([x / 2, y / 2, z / 2])
    return f'<geom type="box" size="{half}" pos="{_numbers(at)}" euler="{_numbers(euler, 1)}"/>'


def _cylinder(radius: float, start: Point, end: Point) -> Geom:
    return f'<geom type="cylinder" size="{_numbers([radius])}" fromto="{_numbers([*start, *end])}"/>'


def _capsule(radius: float, start: Point, end: Point) -> Geom:
    return f'<geom type="capsule" size="{_numbers([radius])}" fromto="{_numbers([*start, *end])}"/>'


def _ellipsoid(x: float, y: float, z: float, at: Point) -> Geom:
    """An ellipsoid of full axes x, y, z."""
    return f'<geom type="ellipsoid" size="{_numbers([x / 2, y / 2, z / 2])}" pos="{_numbers(at)}"/>'


def _tube(points: Sequence[Point], radius: float) -> Iterator[Geom]:
    """Capsules from point to point."""
    for start, end in pairwise(points):
        yield _capsule(radius, start, end)


def _ring(radius: float, wall: float, low: float, high: float, count: int = 24, flare: float = 0.0) -> Iterator[Geom]:
    """A round wall of boxes; its top leans out by ``flare`` deg."""
    side = 2 * radius * np.tan(np.pi / count) * 1.02
    for angle in 360 / count * np.arange(count):
        c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        yield _box(wall, side, high - low, (radius * c, radius * s, (low + high) / 2), (0, flare, angle))


def _hull(points: Sequence[Point] | np.ndarray) -> Geom:
    """The convex hull of points; :func:`_thing` makes it a mesh."""
    return f'<hull vertex="{_numbers(np.asarray(points, float))}"/>'


def _prism(outline: Sequence[Point] | np.ndarray, low: float, high: float, shrink: float = 1.0) -> Geom:
    """The hull of an outline (x, y) at z = low and, shrunk, at z = high."""
    xy = np.asarray(outline, float)
    ends = ((xy, low), (shrink * xy, high))
    return _hull(np.vstack([np.column_stack([around, np.full(len(around), z)]) for around, z in ends]))


def _circle(radius: float, count: int = 24) -> np.ndarray:
    angle = 2 * np.pi / count * np.arange(count)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def _rectangle(x: float, y: float) -> np.ndarray:
    return np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * (x / 2, y / 2)


def _foot(radius: float) -> Geom:
    """A round base with corners, for MuJoCo finds a cylinder but one contact with a slanted box."""
    return _prism(_circle(radius), 0, 2)


def _thing(
    name: str, color: str, title: str, *geoms: Geom | Iterator[Geom], mass: float, round_: bool = False
) -> ObjectSpec:
    """An object of geoms, its mass in g spread evenly, its origin in the middle of its box; ``round_`` about z."""
    (r, g, b), hue = _COLORS[color]
    _COLOR[name] = color
    flat: list[Geom] = []
    for part in geoms:
        flat += [part] if isinstance(part, str) else part
    meshes = ""
    for i, part in enumerate(flat):
        if part.startswith("<hull"):
            meshes += part.replace("<hull", f'<mesh name="hull_{i}" inertia="convex"')
            flat[i] = f'<geom type="mesh" mesh="hull_{i}"/>'

    def mjcf(shift: np.ndarray) -> str:
        return f"""
<mujoco model="{name}">
  <compiler eulerseq="XYZ" inertiafromgeom="true"/>
  <default>
    <geom condim="4" friction="0.8 0.002 0.0001" solref="0.005 1" solimp="0.95 0.99 0.001" density="500"
          material="paint"/>
  </default>
  <asset>
    <material name="paint" rgba="{r} {g} {b} 1" specular="0.6" shininess="0.6"/>
    {meshes}
  </asset>
  <worldbody>
    <body name="{name}"><frame pos="{_numbers(shift, 1)}">
      {"".join(flat)}
    </frame></body>
  </worldbody>
</mujoco>"""

    raw = ObjectSpec(name, mjcf(np.zeros(3)), HsvThreshold(hue, (0.45, 1.0), (0.08, 1.0)), title=title)
    model = raw.load().compile()
    box = raw.bounding_box()
    text, sides = mjcf(-box.center), " x ".join(f"{2e3 * half:.0f}" for half in box.half_extents)
    density = 500 * 1e-3 * mass / model.body_mass[1]  # of overlapping geoms the common part counts twice: no harm
    text = text.replace('density="500"', f'density="{density:.4g}"')
    ends = tuple(CanonicalNormal(np.array([0, 0, z])) for z in (1, -1))
    x, y, z = 2 * box.half_extents
    return replace(
        raw,
        mjcf=text,
        title=f"{title}, {sides} mm",
        normals=ends if round_ else box_normals((x, y, z)),
        round_axis=(0, 0, 1) if round_ else None,
    )


def _things() -> Iterator[ObjectSpec]:
    # --- convex ---
    yield _thing(
        "spray_can", "red", "spray can",
        _prism(_circle(27), 0, 135), _prism(_circle(27), 135, 150, 0.55),
        _cylinder(14, (0, 0, 150), (0, 0, 170)), mass=180, round_=True,
    )  # fmt: skip
    yield _thing(
        "wedge", "orange", "doorstop",
        _hull([(x, y, z) for y in (-22.5, 22.5) for x, z in ((-55, 0), (55, 0), (55, 48), (40, 48), (-55, 6))]),
        mass=120,
    )  # fmt: skip
    yield _thing(
        "soap", "pink", "bar of soap",
        _hull([
            (a * np.cos(t), b * np.sin(t), z) for a, b, z in ((40, 22, 0), (47, 29, 10), (47, 29, 26), (38, 20, 36))
            for t in np.linspace(0, 2 * np.pi, 24, endpoint=False)
        ]),
        mass=110,
    )  # fmt: skip
    yield _thing("nut", "cyan", "hexagon nut without its hole", _prism(_circle(30, 6), 0, 40), mass=150)
    yield _thing("cup", "yellow", "tumbler upside down", _prism(_circle(33), 0, 85, 0.72), mass=90, round_=True)
    yield _thing(
        "nougat", "purple", "three-cornered bar",
        _hull([(x, y, z) for x in (-80, 80) for y, z in ((-24, 0), (24, 0), (0, 42))]), mass=150,
    )  # fmt: skip
    yield _thing("tin", "blue", "tin of fish", _foot(33), _cylinder(33, (0, 0, 1), (0, 0, 40)), mass=160, round_=True)
    yield _thing(
        "rubber", "green", "slanted rubber",
        _hull([(x + slant, y, z) for z, slant in ((0, -8), (30, 8)) for x in (-34, 34) for y in (-18, 18)]), mass=70,
    )  # fmt: skip
    yield _thing(
        "butter_dish", "orange", "butter dish",
        _prism(_rectangle(120, 64), 0, 8), _hull([
            *((x, y, 8) for x in (-52, 52) for y in (-28, 28)), *((x, y, 46) for x in (-42, 42) for y in (-19, 19)),
        ]),
        mass=180,
    )  # fmt: skip
    yield _thing(
        "pebble", "red", "flat stone",
        _hull(_pebble()), mass=140,
    )  # fmt: skip
    # --- not convex ---
    yield _thing(
        "mug", "blue", "mug with a handle",
        _foot(34), _cylinder(34, (0, 0, 1), (0, 0, 5)), _ring(33.5, 5, 3, 84),
        _tube([(33, 0, 68), (55, 0, 66), (60, 0, 42), (55, 0, 20), (33, 0, 18)], 5), mass=200,
    )  # fmt: skip
    yield _thing(
        "bottle", "green", "bottle",
        _prism(_circle(30), 0, 105), _prism(_circle(30), 105, 135, 0.45),
        _cylinder(13, (0, 0, 135), (0, 0, 175)), mass=220, round_=True,
    )  # fmt: skip
    yield _thing(
        "bowl", "yellow", "small bowl",
        _foot(22), _cylinder(22, (0, 0, 1), (0, 0, 6)), _ring(27, 5, 4, 46, flare=13), mass=120, round_=True,
    )  # fmt: skip
    yield _thing("banana", "yellow", "banana", _tube(_arc(95, -58, 58, 9), 18), mass=140)
    yield _thing(
        "dispenser", "pink", "soap dispenser",
        _box(62, 42, 90, (0, 0, 45)), _cylinder(10, (0, 0, 90), (0, 0, 114)), _box(58, 20, 14, (22, 0, 119)), mass=200,
    )  # fmt: skip
    yield _thing(
        "hammer", "red", "hammer",
        _box(150, 30, 30, (0, 0, 17)), _cylinder(17, (70, -34, 17), (70, 34, 17)),
        _box(34, 96, 34, (78, 0, 17)), mass=300,
    )  # fmt: skip
    yield _thing(
        "toy_car", "cyan", "toy car",
        _box(118, 50, 20, (0, 0, 20)), _hull([
            *((x, y, 30) for x in (-42, 34) for y in (-22, 22)), *((x, y, 50) for x in (-34, 14) for y in (-18, 18)),
        ]),
        *(_cylinder(12, (x, -28, 12), (x, 28, 12)) for x in (-36, 36)), mass=130,
    )  # fmt: skip
    yield _thing(
        "shoe", "purple", "child's shoe",
        _prism([(-66, -20), (-66, 20), (0, 18), (40, 25), (70, 12), (70, -12), (40, -22), (0, -18)], 0, 12),
        _hull([
            *((x, y, 12) for x in (-64, 0) for y in (-19, 18)), *((x, y, 58) for x in (-62, -22) for y in (-16, 15)),
        ]),
        _hull([
            *((x, y, 12) for x in (-5, 55) for y in (-17, 19)), (66, 8, 14), (66, -8, 14), (52, 12, 30), (52, -11, 30),
            (-5, 14, 38), (-5, -13, 38),
        ]),
        mass=150,
    )  # fmt: skip
    yield _thing(
        "drill", "orange", "cordless drill lying",
        _cylinder(23, (-50, 60, 23), (45, 60, 23)), _cylinder(14, (45, 60, 23), (90, 60, 23)),
        _box(36, 90, 34, (-25, 10, 23), (0, 0, 12)), _box(66, 30, 46, (-14, -38, 23)), mass=420,
    )  # fmt: skip
    yield _thing(
        "gamepad", "purple", "game controller",
        _box(96, 46, 32, (0, 12, 17)), _capsule(18, (-48, 8, 18), (-54, -28, 18)),
        _capsule(18, (48, 8, 18), (54, -28, 18)), mass=200,
    )  # fmt: skip
    yield _thing(
        "dumbbell", "green", "dumbbell",
        _prism(_circle(32, 6), 0, 30), _cylinder(17, (0, 0, 30), (0, 0, 100)),
        _prism(_circle(32, 6), 100, 130), mass=350, round_=True,
    )  # fmt: skip
    yield _thing(
        "tee", "blue", "pipe fitting",
        _cylinder(18, (-60, 0, 18), (60, 0, 18)), _cylinder(18, (0, 0, 18), (0, 60, 18)),
        *(_box(12, 30, 4, (x, 0, 2)) for x in (-50, 50)), _box(30, 12, 4, (0, 50, 2)), mass=170,
    )  # fmt: skip
    yield _thing(
        "bracket", "cyan", "angle bracket",
        _box(90, 40, 30, (0, 0, 15)), _box(30, 40, 74, (-30, 0, 37)), mass=210,
    )  # fmt: skip
    yield _thing(
        "watering_can", "pink", "toy watering can",
        _prism(_circle(30), 0, 70, 0.9), _capsule(8, (20, 0, 20), (74, 0, 72)), _prism(_circle(14), 66, 76),
        _tube([(-26, 0, 62), (-54, 0, 60), (-56, 0, 30), (-28, 0, 14)], 6), mass=180,
    )  # fmt: skip


def _arc(radius: float, low: float, high: float, count: int) -> list[tuple[float, float, float]]:
    angles = np.radians(np.linspace(low, high, count))
    return [(radius * np.sin(t), radius * np.cos(t), 18.0) for t in angles]


def _pebble() -> np.ndarray:
    """A stone with a flat underside, no two of whose axes are alike."""
    points = np.random.default_rng(24).normal(size=(60, 3))
    points *= (50, 29, 22) / np.linalg.norm(points, axis=1, keepdims=True)
    return np.vstack([points.clip((-100, -100, -12), 100), np.column_stack([_circle(1) * (30, 17), np.full(24, -12)])])


THINGS: dict[str, ObjectSpec] = {spec.name: spec for spec in _things()}
"""The things by name, in the order of the table."""

NOT_CONVEX = frozenset(list(THINGS)[10:])
"""Those of which a box, a can or any other convex solid is not the shape."""

UNEQUAL = frozenset({"wedge", "soap", "rubber", "butter_dish", "pebble", "toy_car", "shoe", "bracket", "hammer"})
"""Those with no two axes alike: all three sides of their box differ."""

PLACED = ("flat", "tilted", "steep", "ramp")
"""Placements, which take turns."""


def encounters(seed: int = 2627, starts: int = 25) -> dict[str, dict[str, Any]]:
    """Every start of the experiment, under keys ``surroundings/thing/k``.

    A thing is met ``starts`` times alone and as often among three others, of other colors than its own, that touch it
    or what it stands on; the placements take turns.
    """
    found = {}
    for number, name in enumerate(THINGS):
        strangers = [other for other in THINGS if _COLOR[other] != _COLOR[name]]
        for k in range(starts):
            rng = np.random.default_rng([seed, number, k])
            beside = [str(other) for other in rng.choice(strangers, 3, replace=False)]
            for surroundings, others in (("alone", []), ("among", beside)):
                job = {"target": name, "placement": PLACED[k % len(PLACED)], "others": others, "seed": seed, "k": k}
                found[f"{surroundings}/{name}/{k}"] = job
    return found
