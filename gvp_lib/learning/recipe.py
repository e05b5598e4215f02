"""Recipe of a set of labeled viewpoints: all that decides its images and labels. Thesis 2.4.2, 3.2, A.3, Figs. 2.5 and
2.6; errata 21."""

from __future__ import annotations

import colorsys
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from inspect import isbuiltin, isfunction
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError, UnknownNameError
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.simulation.arms import ArmSpec, arm_spec
from gvp_lib.simulation.objects import ObjectSpec, object_spec
from gvp_lib.simulation.placements import PLACEMENTS
from gvp_lib.simulation.scene import FLOATING
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.workcell import WorkCell

__all__ = ["CollectionRecipe", "Painter", "Variation", "redrawn", "scaled_object", "tour", "viewpoints"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Variation:
    """Domain randomization: ranges within which looks vary from picture to picture, for a network to ignore.

    By default nothing varies, as in the thesis, whose conclusion asks for augmentation. The compiled scene is
    repainted, never a picture. Camera noise is the recipe's ``noise``.

    Attributes
    ----------
    light
        Relative change of all lights' strength, uniform within +-; the lamp moves by up to as many meters to each side.
    color
        Relative change of the brightness of the object's colors, uniform within +-; a quarter as much for each channel.
    table
        Highest saturation of the table's color; any hue, and a brightness of 0.35 to 0.95.
    size
        Relative change of the object's size, uniform within +-, for each scene.
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


@dataclass(frozen=True, kw_only=True)
class CollectionRecipe:
    """Settings of a set of viewpoints. The same recipe gives the same set, to the last byte.

    Attributes
    ----------
    target, placement
        Object, by name or as an :class:`ObjectSpec`, and how it stands; see :class:`gvp_lib.WorkCell`.
    arm
        Arm that holds the camera: a name, an :class:`ArmSpec`, or ``"floating"`` for a bare camera.
    sampling
        ``"uniform"``: evenly spaced over the cap, each point at several rolls (Fig. 2.5); ``"random"``: denser near
        the normal, each at its own roll (Fig. 2.6; errata 21).
    n
        Number of samples; the thesis's sets have 4096.
    rolls
        Number of evenly spaced rolls at each point of a uniform set.
    roll_offset
        First of these rolls, from a level camera, as a share of their spacing. At 0 some can bring the normal onto a
        diagonal of the picture, where two actions tie exactly: with 16 rolls a quarter of the set. At 1/3 none does,
        whatever their number.
    sigma
        Standard deviation of each component of a random set's tilt, rad; None: uniform in area over the cap.
    max_tilt
        Half angle of the cap about the object's normal, rad; the thesis's is 30 deg.
    radius
        Radius of the virtual sphere, m; the default fits a 1x3 brick into the crop (errata 19).
    step
        Angle of the labeled action over the sphere, rad.
    sort
        Whether each viewpoint follows a near one (3.2), instead of the order in which they are drawn.
    crop
        Side of the square kept from the middle of each picture, px (2.4.3).
    threshold
        Largest offset of a centered object, px in u and in v.
    scenes
        Number of placings of the object, among which the samples are divided evenly; the thesis has one.
    noise
        Imperfections of arm and camera.
    variation
        Randomization of looks and sizes; none by default.
    seed
        Seed of everything random.
    shard
        Samples per file: what a killed run loses at most for each worker.
    """

    target: str | ObjectSpec = "cuboid_1x2"
    placement: str = "flat"
    arm: str | ArmSpec = "ur5e"
    sampling: Literal["uniform", "random"] = "uniform"
    n: int = 4096
    rolls: int = 16
    roll_offset: float = 1 / 3
    sigma: float | None = np.radians(15)
    max_tilt: float = np.radians(30)
    radius: float = 0.5
    step: float = np.radians(5)
    sort: bool = True
    crop: int = 128
    threshold: float = 2.0
    scenes: int = 1
    noise: Noise = field(default_factory=Noise)
    variation: Variation = field(default_factory=Variation)
    seed: int = 0
    shard: int = 64

    def __post_init__(self) -> None:
        object_spec(self.target)
        if self.arm != FLOATING:
            arm_spec(self.arm)
        for name, known in (("placement", PLACEMENTS), ("sampling", ("uniform", "random"))):
            if getattr(self, name) not in known:
                raise UnknownNameError(name, getattr(self, name), known)
        for name, kind, low, high in _RANGES:
            value = getattr(self, name)
            if name == "sigma" and value is None:
                continue
            number = int | np.integer if kind == "is a whole number" else int | float | np.number
            if isinstance(value, bool) or not isinstance(value, number) or not low <= value <= high:
                hint = ". For degrees: np.radians(...)" if "radians" in kind else ""
                raise InvalidParameterError(f"{name} {kind} from {low} to {round(high, 3)}; got {value!r}{hint}")
        if self.scenes > self.n:
            raise InvalidParameterError(f"{self.n} samples are too few for {self.scenes} scenes; one each is the least")
        if self.sampling == "uniform" and any(count % self.rolls for count in self.per_scene):
            least = self.rolls * self.scenes
            below = self.n - self.n % least
            raise InvalidParameterError(
                f"a uniform set has {self.rolls} rolls at each point, so n is a multiple of rolls x scenes = {least}; "
                f"got n={self.n}, and {below} or {below + least} would do"
            )
        if not isinstance(self.noise, Noise) or not isinstance(self.variation, Variation):
            raise InvalidParameterError(
                f"noise is a Noise and variation a Variation; got {self.noise!r} and {self.variation!r}"
            )

    @property
    def per_scene(self) -> list[int]:
        """Number of samples of each scene."""
        return [self.n // self.scenes + (scene < self.n % self.scenes) for scene in range(self.scenes)]

    def to_dict(self) -> dict[str, Any]:
        """JSON data, equal for recipes that give the same set; your own object or arm is a name and a hash."""
        data: dict[str, Any] = {item.name: getattr(self, item.name) for item in fields(self)}
        for name in ("target", "arm"):
            data[name] = data[name] if isinstance(data[name], str) else _named(data[name])
        for name in ("noise", "variation"):
            data[name] = {item.name: float(getattr(data[name], item.name)) for item in fields(data[name])}
        return {name: value.item() if isinstance(value, np.generic) else value for name, value in data.items()}


_RANGES: tuple[tuple[str, str, float, float], ...] = (
    ("n", "is a whole number", 1, 10_000_000),
    ("rolls", "is a whole number", 1, 10_000),
    ("crop", "is a whole number", 16, 4096),
    ("scenes", "is a whole number", 1, 1_000_000),
    ("seed", "is a whole number", 0, 2**63 - 1),
    ("shard", "is a whole number", 1, 100_000),
    ("max_tilt", "is in radians,", 1e-6, np.pi / 2),
    ("step", "is in radians,", 1e-6, np.pi / 2),
    ("sigma", "is in radians,", 1e-6, np.pi),
    ("radius", "is", 0.05, 2.0),
    ("threshold", "is", 0.1, 100.0),
    ("roll_offset", "is", 0.0, 1.0),
)


def _named(spec: ObjectSpec | ArmSpec) -> str:
    """Name, and a hash of its model and of how it is seen, grasped and moved.

    Only the name of a segmenter's function counts, and the files that a model includes do not.
    """
    data = {item.name: getattr(spec, item.name) for item in fields(spec) if item.name not in ("name", "title")}
    if not (isinstance(spec.mjcf, str) and spec.mjcf.lstrip().startswith("<")):
        data["mjcf"] = Path(str(spec.mjcf)).read_text()
    text = json.dumps(data, sort_keys=True, default=_as_data)
    return f"{spec.name} ({hashlib.sha256(text.encode()).hexdigest()[:12]})"


def _as_data(value: Any) -> Any:
    """JSON data, the same in every process, for an object that JSON does not know."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, RigidTransform):
        return value.as_matrix().tolist()
    if isfunction(value) or isbuiltin(value):
        return f"{value.__module__}.{value.__qualname__}"
    kind = type(value)
    inside = [item.name for item in fields(value)] if is_dataclass(value) else getattr(value, "__dict__", {})
    return [f"{kind.__module__}.{kind.__qualname__}", {name: getattr(value, name) for name in inside}]


# --- viewpoints -------------------------------------------------------------------------------------------------------

_SCENE, _REDRAW = 1, 2  # streams of random numbers
_LEVEL = VirtualSphere(np.zeros(3), 1.0)


def viewpoints(recipe: CollectionRecipe, scene: int = 0) -> NDArray[np.float64]:
    """Viewpoints of a scene as they are visited: tilt from the normal, azimuth about it and roll, shape (n, 3), rad."""
    n = recipe.per_scene[scene]
    if recipe.sampling == "uniform":
        drawn = _coordinates(_LEVEL.uniform(n, recipe.max_tilt, recipe.rolls))
        drawn[:, 2] += recipe.roll_offset * 2 * np.pi / recipe.rolls
    else:
        rng = np.random.default_rng([recipe.seed, _SCENE, scene])
        drawn = _coordinates(_LEVEL.random(n, rng, recipe.max_tilt, recipe.sigma))
    return drawn[tour(drawn)] if recipe.sort else drawn


def redrawn(recipe: CollectionRecipe, first: int, attempt: int, viewpoints: NDArray[np.float64]) -> NDArray[np.float64]:
    """Replacements for viewpoints that the arm cannot reach: tilt, azimuth and roll, shape (n, 3), rad.

    The tilt is drawn anew from the same distribution, and depends on the number of the first sample alone, not on the
    worker. Azimuth and roll are kept: what an arm cannot reach lies mostly on one side, and with fewer views from there
    a set would have fewer labels that lead back.
    """
    rng = np.random.default_rng([recipe.seed, _REDRAW, first, attempt])
    sigma = recipe.sigma if recipe.sampling == "random" else None
    tilt = _coordinates(_LEVEL.random(len(viewpoints), rng, recipe.max_tilt, sigma))[:, 0]
    return np.column_stack([tilt, viewpoints[:, 1:]])


def tour(coordinates: NDArray[np.float64]) -> NDArray[np.int64]:
    """Order in which each viewpoint is followed by the nearest of those that are left, shape (n,).

    The thesis suggests sorting by the two angles of the point; this includes the roll, which takes an arm longest.

    Parameters
    ----------
    coordinates
        Tilt, azimuth and roll, shape (n, 3), rad. The tour begins at the one nearest to zero.
    """
    quaternions = _LEVEL.viewpoint(*coordinates.T).rotation.as_quat()  # (n, 4)
    # The larger the scalar product of two unit quaternions, in magnitude, the smaller the turn. The visited are zeroed.
    left, order = quaternions.copy(), np.empty(len(coordinates), np.int64)
    here = _LEVEL.viewpoint(0.0, 0.0).rotation.as_quat()
    for k in range(len(order)):
        order[k] = nearest = np.argmax(np.abs(left @ here))
        here = quaternions[nearest]
        left[nearest] = 0.0
    return order


def _coordinates(poses: RigidTransform) -> NDArray[np.float64]:
    """Tilt, azimuth and roll of viewpoints about +z, shape (n, 3), rad."""
    outward = -poses.rotation.as_matrix()[:, :, 2]
    tilt = np.arctan2(np.hypot(outward[:, 0], outward[:, 1]), outward[:, 2])
    azimuth = np.arctan2(outward[:, 1], outward[:, 0])
    roll = (_LEVEL.viewpoint(tilt, azimuth).rotation.inv() * poses.rotation).as_rotvec()[:, 2]
    return np.stack([tilt, azimuth, roll], axis=1)


# --- variation --------------------------------------------------------------------------------------------------------

_DIM = 0.25  # share of the light's color that may differ between the channels, of its strength's range
_NO_COLOR = np.array([0.5, 0.5, 0.5, 1.0], np.float32)


class Painter:
    """Painter of random looks for a cell's scene, each starting from the original one."""

    def __init__(self, cell: WorkCell, variation: Variation) -> None:
        self._model, self._variation = cell.model, variation
        model = cell.model
        geoms = np.flatnonzero(model.body_rootid[model.geom_bodyid] == cell.target_body)
        worn = model.geom_matid[geoms]
        self._materials = np.unique(worn[worn >= 0])
        # A geom's own color hides its material's, unless it is the one that MuJoCo takes for none.
        self._geoms = geoms[(worn < 0) | (model.geom_rgba[geoms] != _NO_COLOR).any(axis=1)]
        self._table = int(model.geom_matid[model.geom("table").id])
        self._lights = (model.light_diffuse, model.vis.headlight.ambient, model.vis.headlight.diffuse)
        varied = (model.geom_rgba, model.mat_rgba, model.light_pos, *self._lights)
        self._at_first = [(array, array.copy()) for array in varied]

    def paint(self, rng: np.random.Generator) -> None:
        """Paint another look. The number of draws is always the same, so that one variation leaves the others alone."""
        model, variation = self._model, self._variation
        for array, at_first in self._at_first:
            array[...] = at_first
        light, tint = rng.uniform(-1, 1), rng.uniform(-1, 1, 3)
        shift, bright, channels = rng.uniform(-1, 1, 2), rng.uniform(-1, 1), rng.uniform(-1, 1, 3)
        hue, saturation, value = rng.uniform(0, 1, 3)
        if variation.light:
            strength = 1 + variation.light * (light + _DIM * tint)
            for array in self._lights:
                array[:] = np.clip(array * strength, 0, 1)
            model.light_pos[:, :2] += variation.light * shift
        if variation.color:
            gain = 1 + variation.color * (bright + _DIM * channels)
            for array, which in ((model.geom_rgba, self._geoms), (model.mat_rgba, self._materials)):
                array[which, :3] = np.clip(array[which, :3] * gain, 0, 1)
        if variation.table:
            model.mat_rgba[self._table, :3] = colorsys.hsv_to_rgb(hue, variation.table * saturation, 0.35 + 0.6 * value)


def scaled_object(spec: ObjectSpec, factor: float) -> ObjectSpec:
    """An object scaled by a factor, at the same density.

    Raises
    ------
    ModelError
        Its MJCF cannot be read.
    """
    if factor == 1:
        return spec
    model: Any = replace(spec, textures={}).load()  # pictures drawn by code cannot be written as XML, nor need they be
    lengths = [(geom, name) for geom in model.geoms for name in ("size", "fromto", "pos")]
    lengths += [(body, "pos") for body in model.bodies[1:]]
    lengths += [(mesh, "scale") for mesh in model.meshes]
    for part, name in lengths:
        value: NDArray[np.float64] = getattr(part, name)
        setattr(part, name, np.where(np.isfinite(value), factor * np.asarray(value), value))
    for geom in model.geoms:
        if geom.mass and np.isfinite(geom.mass):
            geom.mass *= factor**3
    folder = Path(model.modelfiledir or ".") / (model.meshdir or "")
    for mesh in model.meshes:
        if mesh.file:  # which the text to be written could no longer find
            mesh.file = str((folder / mesh.file).resolve())
    return replace(spec, mjcf=model.to_xml())
