"""What a set of labeled viewpoints is made of: everything that decides its images and labels. Thesis 2.4.2, 3.2."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from inspect import isbuiltin, isfunction
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError, UnknownNameError
from gvp_lib.learning.variation import Variation
from gvp_lib.simulation.arms import ArmSpec, arm_spec
from gvp_lib.simulation.objects import ObjectSpec, object_spec
from gvp_lib.simulation.placements import PLACEMENTS
from gvp_lib.simulation.scene import FLOATING
from gvp_lib.simulation.sensors import Noise

__all__ = ["CollectionRecipe"]


@dataclass(frozen=True, kw_only=True)
class CollectionRecipe:
    """How a set of viewpoints is collected. The same recipe gives the same set, to the last byte.

    Attributes
    ----------
    target, placement
        The object, by name or an :class:`ObjectSpec`, and how it stands; see :class:`gvp_lib.WorkCell`.
    arm
        Who holds the camera: a name, an :class:`ArmSpec`, or ``"floating"`` for a bare camera.
    sampling
        ``"uniform"``: evenly spaced over the cap, each point at several rolls (Fig. 2.5); ``"random"``: closer
        together near the normal, each at a roll of its own (Fig. 2.6; errata 21).
    n
        Number of samples; the thesis's sets have 4096.
    rolls
        Of a uniform set, at each point, evenly spaced.
    roll_offset
        Where they begin, from a level camera, as a share of their spacing. At 0 some of them can bring the normal onto
        a diagonal of the picture, where two actions tie exactly: with 16 rolls a quarter of the set. At 1/3 none does,
        however many they are.
    sigma
        Of a random set, standard deviation of each component of the tilt, rad; None: uniform in area over the cap.
    max_tilt
        Half angle of the cap about the object's normal, rad; the thesis's is 30 deg.
    radius
        Of the virtual sphere, m: far enough that a 1x3 brick fits the crop (errata 19).
    step
        Of the action that is labeled, rad.
    sort
        Whether each viewpoint follows a near one (3.2); else they come in the order in which they are drawn.
    crop
        Side of the square that is kept of each picture, px (2.4.3).
    threshold
        Of the centering, px.
    scenes
        How many times the object is placed anew, the samples shared evenly among them. The thesis has one.
    noise
        How imperfect arm and camera are.
    variation
        What is varied from picture to picture; nothing is by default.
    seed
        Of everything random.
    shard
        Samples per file, and so the most that a killed run loses for each worker.
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
        if self.placement not in PLACEMENTS:
            raise UnknownNameError("placement", self.placement, PLACEMENTS)
        if self.sampling not in ("uniform", "random"):
            raise UnknownNameError("sampling", self.sampling, ("uniform", "random"))
        for name, low, high in _WHOLE:
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | np.integer) or not low <= value <= high:
                raise InvalidParameterError(f"{name} is a whole number from {low} to {high}; got {value!r}")
        for name, top in (("max_tilt", np.pi / 2), ("step", np.pi / 2), ("sigma", np.pi)):
            value = getattr(self, name)
            if value is not None and not 0 < value <= top:
                raise InvalidParameterError(
                    f"{name} is in radians, in (0, {top:.3f}]; got {value}. For degrees: np.radians(...)"
                )
        for name, least, most in (("radius", 0.05, 2.0), ("threshold", 0.1, 100.0), ("roll_offset", 0.0, 1.0)):
            if not least <= getattr(self, name) <= most:
                raise InvalidParameterError(f"{name} is from {least} to {most}; got {getattr(self, name)}")
        if self.scenes > self.n:
            raise InvalidParameterError(f"{self.n} samples are too few for {self.scenes} scenes; one each is the least")
        if self.sampling == "uniform" and any(count % self.rolls for count in self.per_scene):
            raise InvalidParameterError(
                f"a uniform set has {self.rolls} rolls at each point, so n is a multiple of rolls x scenes = "
                f"{self.rolls * self.scenes}; got n={self.n}, and {self.n - self.n % (self.rolls * self.scenes)} or "
                f"{self.n + -self.n % (self.rolls * self.scenes)} would do"
            )
        if not isinstance(self.noise, Noise) or not isinstance(self.variation, Variation):
            raise InvalidParameterError(
                f"noise is a Noise and variation a Variation; got {self.noise!r} and {self.variation!r}"
            )

    @property
    def per_scene(self) -> list[int]:
        """How many samples each scene has."""
        return [self.n // self.scenes + (scene < self.n % self.scenes) for scene in range(self.scenes)]

    def to_dict(self) -> dict[str, Any]:
        """As JSON data, to which two recipes are the same where they give the same set.

        An object or an arm of your own is named, with a hash of what it is.
        """
        told: dict[str, Any] = {item.name: getattr(self, item.name) for item in fields(self)}
        told["target"] = _named(object_spec(self.target)) if isinstance(self.target, ObjectSpec) else self.target
        told["arm"] = _named(self.arm) if isinstance(self.arm, ArmSpec) else self.arm
        for name in ("noise", "variation"):
            part = told[name]
            told[name] = {item.name: float(getattr(part, item.name)) for item in fields(part)}
        return {name: value.item() if isinstance(value, np.generic) else value for name, value in told.items()}


_WHOLE = (
    ("n", 1, 10_000_000),
    ("rolls", 1, 10_000),
    ("crop", 16, 4096),
    ("scenes", 1, 1_000_000),
    ("seed", 0, 2**63 - 1),
    ("shard", 1, 100_000),
)


_ASIDE = ("name", "title", "mjcf")


def _named(spec: ObjectSpec | ArmSpec) -> str:
    """Name and a hash of all that the set depends on: the model, and how it is seen, grasped and moved.

    What it cannot see into is the code of a segmenter, of which the name counts, and the files that a model includes.
    """
    told = {item.name: _told(getattr(spec, item.name)) for item in fields(spec) if item.name not in _ASIDE}
    source = spec.mjcf
    is_text = isinstance(source, str) and source.lstrip().startswith("<")
    told["mjcf"] = source if is_text else Path(str(source)).read_text()
    return f"{spec.name} ({hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:12]})"


def _told(value: Any) -> Any:
    """As JSON data that is the same in every process."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _told(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_told(part) for part in value]
    if isinstance(value, RigidTransform):
        return value.as_matrix().tolist()
    if isfunction(value) or isbuiltin(value):
        return f"{value.__module__}.{value.__qualname__}"
    kind = type(value)
    inside = [item.name for item in fields(value)] if is_dataclass(value) else getattr(value, "__dict__", {})
    return [f"{kind.__module__}.{kind.__qualname__}", {name: _told(getattr(value, name)) for name in inside}]
