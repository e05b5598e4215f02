"""Domain randomization: what may differ from picture to picture, so that a network learns to look past it.

The thesis has none; its conclusion asks for augmentation. It is the compiled scene that is repainted, never a picture.
"""

from __future__ import annotations

import colorsys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvp_lib.errors import InvalidParameterError
from gvp_lib.simulation.objects import ObjectSpec
from gvp_lib.simulation.workcell import WorkCell

__all__ = ["Painter", "Variation", "resized"]

_DIM = 0.25  # share of the light's color that may differ between the channels, of its strength's range
_NO_COLOR = np.array([0.5, 0.5, 0.5, 1.0], np.float32)


@dataclass(frozen=True, slots=True, kw_only=True)
class Variation:
    """How much of what is varied; nothing unless set. Camera noise is the recipe's ``noise``.

    Attributes
    ----------
    light
        Relative strength of every light, uniform within +-; the lamp moves by up to as many meters to each side.
    color
        Relative brightness of the object's colors, uniform within +-, and of each channel a quarter of that.
    table
        Saturation of the table's color, up to; its hue is any and its brightness 0.35 to 0.95.
    size
        Relative size of the object, uniform within +-, for each scene.
    """

    light: float = 0.0
    color: float = 0.0
    table: float = 0.0
    size: float = 0.0

    def __post_init__(self) -> None:
        for name, most in (("light", 0.9), ("color", 0.9), ("table", 1.0), ("size", 0.5)):
            if not 0 <= getattr(self, name) <= most:
                raise InvalidParameterError(
                    f"Variation.{name} is a share, from 0 (none) to {most}; got {getattr(self, name)}"
                )


class Painter:
    """Varies the look of one cell's scene, always from what it was like at first."""

    def __init__(self, cell: WorkCell, variation: Variation) -> None:
        self._model, self._variation = cell.model, variation
        model = cell.model
        of_target = model.body_rootid[model.geom_bodyid] == cell.target_body
        geoms = np.flatnonzero(of_target)
        worn = model.geom_matid[geoms]
        self._materials = np.unique(worn[worn >= 0])
        # A geom's own color hides its material's, unless it is the one that MuJoCo takes for none.
        self._geoms = geoms[(worn < 0) | (model.geom_rgba[geoms] != _NO_COLOR).any(axis=1)]
        self._table = int(model.geom_matid[model.geom("table").id])
        head = model.vis.headlight
        self._at_first = [
            (array, array.copy())
            for array in (
                model.geom_rgba, model.mat_rgba, model.light_pos, model.light_diffuse, head.ambient, head.diffuse
            )
        ]  # fmt: skip

    def paint(self, rng: np.random.Generator) -> None:
        """Another look. Draws as often whatever is varied, so that one kind of variation leaves the others alone."""
        model, variation = self._model, self._variation
        for array, at_first in self._at_first:
            array[...] = at_first
        light, tint = rng.uniform(-1, 1), rng.uniform(-1, 1, 3)
        shift, bright, channels = rng.uniform(-1, 1, 2), rng.uniform(-1, 1), rng.uniform(-1, 1, 3)
        hue, saturation, value = rng.uniform(0, 1, 3)
        if variation.light:
            strength = 1 + variation.light * (light + _DIM * tint)
            head = model.vis.headlight
            for array in (head.ambient, head.diffuse):
                array[:] = np.clip(array * strength, 0, 1)
            model.light_diffuse[:] = np.clip(model.light_diffuse * strength, 0, 1)
            model.light_pos[:, :2] += variation.light * shift
        if variation.color:
            gain = 1 + variation.color * (bright + _DIM * channels)
            for array, which in ((model.geom_rgba, self._geoms), (model.mat_rgba, self._materials)):
                array[which, :3] = np.clip(array[which, :3] * gain, 0, 1)
        if variation.table:
            model.mat_rgba[self._table, :3] = colorsys.hsv_to_rgb(hue, variation.table * saturation, 0.35 + 0.6 * value)


def resized(spec: ObjectSpec, factor: float) -> ObjectSpec:
    """The same object, larger or smaller, of the same density.

    Raises
    ------
    ModelError
        Its MJCF cannot be read.
    """
    if factor == 1:
        return spec
    model: Any = replace(spec, textures={}).load()  # pictures drawn by code cannot be written as XML, nor need they be
    for geom in model.geoms:
        _scale(geom, "size", factor)
        _scale(geom, "fromto", factor)
        _scale(geom, "pos", factor)
        if geom.mass and np.isfinite(geom.mass):
            geom.mass *= factor**3
    for body in model.bodies[1:]:
        _scale(body, "pos", factor)
    folder = Path(model.modelfiledir or ".") / (model.meshdir or "")
    for mesh in model.meshes:
        _scale(mesh, "scale", factor)
        if mesh.file:  # which the text to be written could no longer find
            mesh.file = str((folder / mesh.file).resolve())
    return replace(spec, mjcf=model.to_xml())


def _scale(part: Any, name: str, factor: float) -> None:
    value: NDArray[np.float64] = getattr(part, name)
    setattr(part, name, np.where(np.isfinite(value), factor * np.asarray(value), value))
