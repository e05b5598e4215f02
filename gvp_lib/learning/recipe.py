"""Recipe of a set of labeled viewpoints: all that decides its images and labels. Thesis 2.4.2, 3.2, A.3, Figs. 2.5 and
2.6; errata 21."""

from __future__ import annotations

import colorsys
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from inspect import isbuiltin, isfunction
from textwrap import shorten
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError, UnknownNameError
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.picture import count
from gvp_lib.simulation.arms import ArmSpec, arm_spec
from gvp_lib.simulation.mjcf import absolute_meshes, resolved, text_of
from gvp_lib.simulation.objects import ObjectSpec, object_spec
from gvp_lib.simulation.placements import PLACEMENTS
from gvp_lib.simulation.scene import FLOATING
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.workcell import WorkCell

__all__ = ["CollectionRecipe", "Painter", "Variation", "redrawn", "scaled_object", "tour", "viewpoints"]


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class Variation:
    """Domain randomization: how far looks vary from picture to picture, for a network to learn to ignore.

    By default nothing varies, as in the thesis, whose conclusion asks for augmentation. Randomization repaints the
    compiled scene, never a picture. Camera noise is the recipe's ``noise``.

    Parameters
    ----------
    light
        Largest relative change of the strength of all lights, uniform within +-, and a quarter as much per channel;
        also the largest shift of the lamp in x and in y, m.
    color
        Largest relative change of the brightness of the object's colors, uniform within +-, and a quarter as much per
        channel.
    table
        Highest saturation of the table's color, of any hue and a value of 0.35 to 0.95; 0 leaves the table as it is.
    size
        Largest relative change of the object's size, uniform within +-, drawn once per scene.

    Examples
    --------
    >>> Variation(light=0.3, table=0.5)
    Variation(light=0.3, color=0.0, table=0.5, size=0.0)
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


@checked
@dataclass(frozen=True, kw_only=True)
class CollectionRecipe:
    """Settings that decide every image and label of a data set of viewpoints.

    The same recipe gives the same data set, to the last byte.

    Parameters
    ----------
    target, placement
        Object, by name or as an :class:`ObjectSpec`, and how it stands; see :class:`gvp_lib.WorkCell`.
    arm
        Arm that holds the camera: a name, an :class:`ArmSpec`, or ``"floating"`` for a camera without an arm.
    sampling
        ``"uniform"``: points evenly spaced over the cap, each at several rolls (Fig. 2.5); ``"random"``: points denser
        near the normal, each at one random roll (Fig. 2.6; errata 21).
    n
        Number of samples, 4096 in the thesis; a multiple of ``rolls * scenes`` where sampling is uniform.
    rolls
        Number of evenly spaced rolls at each point of a uniform set.
    roll_offset
        First of these rolls, from a level camera, as a fraction of their spacing. At 0, some rolls can bring the normal
        onto a diagonal of the picture, where two actions tie exactly: with 16 rolls, in a quarter of the samples. At
        1/3 none does, whatever the number of rolls.
    sigma
        Standard deviation of each component of a random set's tilt, rad; None: uniform in area over the cap.
    max_tilt
        Half angle of the cap about the object's normal, rad; 30 deg in the thesis.
    radius
        Radius of the virtual sphere, m; at the default, a 1x3 brick fits into the crop (errata 19).
    step
        Angle that a labeled action moves over the sphere, rad.
    sort
        Whether to visit the viewpoints in the order of :func:`tour` (3.2), not in the order in which they are drawn.
    crop
        Side of the square kept from the middle of each picture, px (2.4.3).
    threshold
        Largest offset of a centered object from the middle of the picture, in u and in v, px.
    scenes
        Number of poses of the object, among which the samples are divided evenly; one in the thesis.
    noise
        Imperfections of arm and camera; none by default.
    variation
        Domain randomization; none by default.
    seed
        Seed of everything random.
    shard
        Number of samples per file: the most that a killed run loses for each worker.

    Examples
    --------
    >>> CollectionRecipe(target="cuboid_1x3", sampling="random", n=512)
    CollectionRecipe(cuboid_1x3 flat, ur5e, 512 random views up to 30 deg, radius 0.5 m, crop 128 px, seed 0)
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

    def __repr__(self) -> str:
        target, arm = (spec if isinstance(spec, str) else spec.name for spec in (self.target, self.arm))
        views = f"{count(self.n, f'{self.sampling} view')} up to {np.degrees(self.max_tilt):.3g} deg"
        scenes = f" in {count(self.scenes, 'scene')}" if self.scenes > 1 else ""
        noisy = ", noisy" if self.noise != Noise() else ""
        varied = ", varied" if self.variation != Variation() else ""
        text = (
            f"{target} {self.placement}, {arm}, {views}{scenes}, radius {self.radius:.3g} m, "
            f"crop {self.crop} px, seed {self.seed}{noisy}{varied}"
        )
        return f"CollectionRecipe({shorten(text, 140, placeholder=' ...')})"

    @property
    def per_scene(self) -> list[int]:
        """Number of samples of each scene."""
        return [self.n // self.scenes + (scene < self.n % self.scenes) for scene in range(self.scenes)]

    def to_dict(self) -> dict[str, Any]:
        """JSON data, equal for recipes that give the same data set; a custom object or arm is a name and a hash."""
        data: dict[str, Any] = {item.name: getattr(self, item.name) for item in fields(self)}
        for name in ("target", "arm"):
            data[name] = data[name] if isinstance(data[name], str) else _name_and_hash(data[name])
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


def _name_and_hash(spec: ObjectSpec | ArmSpec) -> str:
    """Name, and a hash of the model and of how it is seen, grasped and moved.

    A segmenter that is a function counts by its name alone, and files that a model includes do not count.
    """
    data = {item.name: getattr(spec, item.name) for item in fields(spec) if item.name not in ("name", "title")}
    data["mjcf"] = text_of(spec.mjcf, repr(spec.name))
    text = json.dumps(data, sort_keys=True, default=_to_json)
    return f"{spec.name} ({hashlib.sha256(text.encode()).hexdigest()[:12]})"


def _to_json(value: Any) -> Any:
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


def check_scene(recipe: CollectionRecipe, scene: int) -> None:
    """Refuse the number of a scene that a recipe does not have."""
    if scene not in range(recipe.scenes):
        raise InvalidParameterError(f"this recipe has scenes from 0 to {recipe.scenes - 1}; got {scene!r}")


@checked
def viewpoints(recipe: CollectionRecipe, scene: int = 0) -> NDArray[np.float64]:
    """Viewpoints of a scene in the order of visits: tilt from the normal, azimuth and roll, shape (n, 3), rad.

    Parameters
    ----------
    recipe
        Recipe of the data set.
    scene
        Number of the scene, from 0.

    Examples
    --------
    >>> tilts = viewpoints(CollectionRecipe(n=64))[:, 0]
    >>> tilts.shape, bool(tilts.max() < np.radians(30))
    ((64,), True)
    """
    check_scene(recipe, scene)
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


@checked
def tour(coordinates: NDArray[np.float64]) -> NDArray[np.int64]:
    """Order that goes from each viewpoint to the nearest one not yet visited: indices, shape (n,).

    Near means a small rotation of the camera. The thesis suggests sorting by the two angles of the point; this includes
    the roll, which takes an arm longest.

    Parameters
    ----------
    coordinates
        Tilt, azimuth and roll, shape (n, 3), rad. The tour begins at the one nearest to zero.

    Examples
    --------
    >>> tour(np.array([[0.3, 0.0, 0.0], [0.1, 0.0, 0.0], [0.2, 0.0, 0.0]])).tolist()
    [1, 2, 0]
    """
    coordinates = np.asarray(coordinates, float)
    if coordinates.ndim != 2 or coordinates.shape[1:] != (3,) or not np.isfinite(coordinates).all():
        raise InvalidParameterError(
            f"a tour is over tilts, azimuths and rolls, finite, shape (n, 3), rad; got the shape {coordinates.shape}"
        )
    quaternions = _LEVEL.viewpoint(*coordinates.T).rotation.as_quat()  # (n, 4)
    # The larger the scalar product of two unit quaternions, in magnitude, the smaller the rotation between them.
    remaining, order = quaternions.copy(), np.empty(len(coordinates), np.int64)  # visited ones are set to zero
    current = _LEVEL.viewpoint(0.0, 0.0).rotation.as_quat()
    for k in range(len(order)):
        order[k] = nearest = np.argmax(np.abs(remaining @ current))
        current = quaternions[nearest]
        remaining[nearest] = 0.0
    return order


def _coordinates(poses: RigidTransform) -> NDArray[np.float64]:
    """Tilt, azimuth and roll of viewpoints about +z, shape (n, 3), rad."""
    outward = -poses.rotation.as_matrix()[:, :, 2]
    tilt = np.arctan2(np.hypot(outward[:, 0], outward[:, 1]), outward[:, 2])
    azimuth = np.arctan2(outward[:, 1], outward[:, 0])
    roll = (_LEVEL.viewpoint(tilt, azimuth).rotation.inv() * poses.rotation).as_rotvec()[:, 2]
    return np.stack([tilt, azimuth, roll], axis=1)


# --- variation --------------------------------------------------------------------------------------------------------

_TINT = 0.25  # change of a single channel, relative to the change of the brightness
_NO_COLOR = np.array([0.5, 0.5, 0.5, 1.0], np.float32)


@checked
class Painter:
    """Painter of random looks for a work cell's scene, each starting from the original look.

    Parameters
    ----------
    cell
        Work cell whose compiled model is repainted.
    variation
        Ranges of the random looks; ``size`` does not matter here.

    Examples
    --------
    >>> cell = WorkCell("floating")
    >>> painter, before = Painter(cell, Variation(light=0.3, table=0.5)), cell.arm.capture()
    >>> painter.paint(np.random.default_rng(1))
    >>> bool((cell.arm.capture() == before).all())
    False
    >>> cell.close()
    """

    def __init__(self, cell: WorkCell, variation: Variation) -> None:
        self._model, self._variation, self._target = cell.model, variation, cell.target_spec.name
        model = cell.model
        geoms = np.flatnonzero(model.body_rootid[model.geom_bodyid] == cell.target_body)
        materials = model.geom_matid[geoms]
        self._materials = np.unique(materials[materials >= 0])
        # A geom's own color hides its material's, unless it is the one that MuJoCo takes for none.
        self._geoms = geoms[(materials < 0) | (model.geom_rgba[geoms] != _NO_COLOR).any(axis=1)]
        self._table = int(model.geom_matid[model.geom("table").id])
        self._lights = (model.light_diffuse, model.vis.headlight.ambient, model.vis.headlight.diffuse)
        varied = (model.geom_rgba, model.mat_rgba, model.light_pos, *self._lights)
        self._originals = [(array, array.copy()) for array in varied]

    def __repr__(self) -> str:
        return f"Painter({self._target}, {self._variation})"

    def paint(self, rng: np.random.Generator) -> None:
        """Paint another look.

        Parameters
        ----------
        rng
            Source of the look. The number of draws is always the same, so that one variation leaves the others alone.
        """
        model, variation = self._model, self._variation
        for array, original in self._originals:
            array[...] = original
        light, tint = rng.uniform(-1, 1), rng.uniform(-1, 1, 3)
        shift, bright, channels = rng.uniform(-1, 1, 2), rng.uniform(-1, 1), rng.uniform(-1, 1, 3)
        hue, saturation, value = rng.uniform(0, 1, 3)
        if variation.light:
            strength = 1 + variation.light * (light + _TINT * tint)
            for array in self._lights:
                array[:] = np.clip(array * strength, 0, 1)
            model.light_pos[:, :2] += variation.light * shift
        if variation.color:
            gain = 1 + variation.color * (bright + _TINT * channels)
            for array, which in ((model.geom_rgba, self._geoms), (model.mat_rgba, self._materials)):
                array[which, :3] = np.clip(array[which, :3] * gain, 0, 1)
        if variation.table:
            model.mat_rgba[self._table, :3] = colorsys.hsv_to_rgb(hue, variation.table * saturation, 0.35 + 0.6 * value)


@checked
def scaled_object(spec: ObjectSpec, factor: float) -> ObjectSpec:
    """Object of another size and the same density.

    Parameters
    ----------
    spec
        Object to scale; a factor of 1 returns it as it is.
    factor
        Ratio of new to old lengths.

    Raises
    ------
    InvalidParameterError
        The factor is not positive and finite.
    ModelError
        The object's MJCF cannot be read.

    Examples
    --------
    >>> brick = object_spec("cuboid_1x2")
    >>> before, after = (spec.bounding_box().half_extents for spec in (brick, scaled_object(brick, 1.5)))
    >>> (after / before).round(3).tolist()
    [1.5, 1.5, 1.5]
    """
    if not 0 < factor < np.inf:
        raise InvalidParameterError(f"a factor of lengths is positive and finite; got {factor!r}")
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
    absolute_meshes(model)  # as the hashes of recipes have them
    return replace(spec, mjcf=resolved(model.to_xml(), repr(spec.name), model.modelfiledir))
