"""What a view draws beside the scene itself: a camera's frustum, the virtual sphere, paths, frames, points.

Every overlay has two forms: an object for a 3D page, and rods for the still picture that MuJoCo renders.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.views.textures import data_url
from gvp_lib.views.threejs import Group, axis_from_y, compose

__all__ = ["Overlay", "frame", "frustum", "path", "points", "sphere"]

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
