"""MuJoCo's textures as pictures for a 3D page, and where on a shape each point of a picture lies.

MuJoCo projects a 2d texture along the shape's z axis, and a cube texture from the shape's center. Both are
reproduced here on triangles, so that a label sits in the page where the hand camera sees it.
"""

from __future__ import annotations

import base64

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

__all__ = ["cube_box", "data_url", "flat_uv", "material_texture", "texture_pixels"]

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
