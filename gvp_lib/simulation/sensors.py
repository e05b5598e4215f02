"""The faults of a cheap arm and its sensors, and the infrared range sensor in its palm.

Thesis 1.2 (the hardware), 3.1.7 (what its noise did).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from gvp_lib.errors import InvalidParameterError

__all__ = ["EpisodeNoise", "Noise", "RangeSensor"]

_CONE = np.radians(1.5)
_VISIBLE = np.array([1, 1, 1, 0, 0, 0], np.uint8)  # group 3 holds collision geometry, which no light sees

_ANGLE = 0.5, "in radians, from 0 to 0.5 (for degrees: np.radians(...))"
_SHARE = np.nextafter(1.0, 0.0), "relative, 0.1 for ten per cent, not negative and below 1"
_BOUNDS = {
    "joint_offset_sd": _ANGLE,
    "repeatability_sd": _ANGLE,
    "exposure": _SHARE,
    "focal_length": _SHARE,
    "distortion": (0.5, "k1 of a lens, at focal length 1: 0.05 is a cheap one's, 0.5 the most, and no less than 0"),
}
"""Largest values of those noises that have one, and what they are."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """Imperfections of a cell. Everything is off unless set.

    Attributes
    ----------
    joint_offset_sd
        Standard deviation of an encoder's offset, drawn per joint and episode, rad.
    repeatability_sd
        Standard deviation of a joint's landing error, drawn per joint and move, unseen by the encoder, rad.
    pixel_sd
        Standard deviation of the noise in each channel of each pixel, of 255.
    exposure
        Largest relative error of the image's gain, uniform within +-, per episode.
    focal_length
        Largest relative error of the true focal length against the stated one, uniform within +-, per episode.
    range_bias
        Largest offset of the range sensor, uniform within +-, per episode, m.
    range_sd
        Standard deviation of each range reading, m.
    range_dropout, range_spike
        Probability that a reading sees nothing, or is any number within the sensor's range.
    distortion
        Largest first radial coefficient k1 (OpenCV's) of the true lens, where the stated one is a pinhole; uniform
        within +-, per episode, at most 0.5. See :func:`gvp_lib.simulation.camera.distorted`.
    """

    joint_offset_sd: float = 0.0
    repeatability_sd: float = 0.0
    pixel_sd: float = 0.0
    exposure: float = 0.0
    focal_length: float = 0.0
    range_bias: float = 0.0
    range_sd: float = 0.0
    range_dropout: float = 0.0
    range_spike: float = 0.0
    distortion: float = 0.0

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            most, what = _BOUNDS.get(name, (np.finfo(float).max, "a magnitude: finite and not negative"))
            if not 0 <= value <= most:
                raise InvalidParameterError(f"Noise.{name} is {what}; got {value}")
        if self.range_dropout + self.range_spike > 1:
            raise InvalidParameterError(
                "Noise.range_dropout and range_spike are probabilities that exclude each other; "
                f"got {self.range_dropout} + {self.range_spike} > 1"
            )

    @classmethod
    def none(cls) -> Noise:
        """A perfect cell."""
        return cls()

    @classmethod
    def thesis(cls) -> Noise:
        """A low-cost arm, frozen before any experiment: at the hand, about 5 mm and 0.7 deg."""
        return cls(
            joint_offset_sd=np.radians(0.25),
            repeatability_sd=np.radians(0.02),
            pixel_sd=2.0,
            exposure=0.10,
            focal_length=0.01,
            range_bias=0.005,
            range_sd=0.005,
            range_dropout=0.05,
            range_spike=0.02,
        )


class EpisodeNoise:
    """One episode's draw from a :class:`Noise`, and the random streams for every move, picture and reading.

    Each source of noise has its own stream, so that setting one leaves the draws of the others alone.
    """

    def __init__(self, noise: Noise, joints: int, seed: np.random.SeedSequence) -> None:
        self.noise = noise
        episode, self._moves, self._pixels, self._range = (np.random.default_rng(s) for s in seed.spawn(4))
        draw = episode.uniform(-1, 1, 3)
        self.gain = 1 + noise.exposure * draw[0]
        self.focal_scale = 1 + noise.focal_length * draw[1]
        self.range_bias = noise.range_bias * draw[2]
        self.joint_offset = noise.joint_offset_sd * episode.standard_normal(joints)
        # From a stream of its own, which does not depend on the number of joints.
        self.distortion = noise.distortion * episode.spawn(1)[0].uniform(-1, 1)
        self._tiles: tuple[NDArray[np.uint8], NDArray[np.uint8]] | None = None

    def landing_error(self, joints: int) -> NDArray[np.float64]:
        """Offset from its target at which each joint ends this time, shape (joints,), rad."""
        return self.noise.repeatability_sd * self._moves.standard_normal(joints)

    def expose(self, rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Rendered image with this episode's exposure and pixel noise."""
        exposed = rgb if self.gain == 1 else np.asarray(cv2.convertScaleAbs(rgb, alpha=self.gain), np.uint8)
        if self.noise.pixel_sd == 0:
            return exposed
        height, width, channels = rgb.shape
        if self._tiles is None or self._tiles[0].shape != (height + 64, width + 64, channels):
            # A normal number per pixel and frame would cost more than the rendering. A window at a random
            # place of one larger field differs from frame to frame all the same.
            field = np.rint(self._pixels.normal(0.0, self.noise.pixel_sd, (height + 64, width + 64, channels)))
            self._tiles = (field.clip(0, 255).astype(np.uint8), (-field).clip(0, 255).astype(np.uint8))
        v, u = self._pixels.integers(0, 65, 2)
        # What brightens and what darkens apart: adding signed numbers to a picture takes OpenCV five times as long.
        brighter, darker = (tile[v : v + height, u : u + width] for tile in self._tiles)
        noisy = cv2.add(exposed, brighter)
        return np.asarray(cv2.subtract(noisy, darker, dst=noisy), np.uint8)

    def read(self, distance: float, reach: tuple[float, float]) -> float:
        """Range reading of a true distance, m; ``inf`` beyond the sensor's reach."""
        lottery, error, place = self._range.uniform(), self._range.standard_normal(), self._range.uniform(*reach)
        if lottery < self.noise.range_dropout:
            return float("inf")
        if lottery < self.noise.range_dropout + self.noise.range_spike:
            return float(place)
        reading = distance + self.range_bias + self.noise.range_sd * error
        return float(max(reach[0], reading)) if reading <= reach[1] else float("inf")


class RangeSensor:
    """Infrared range sensor: distance to the nearest surface within 1.5 deg of a site's +z."""

    reach = 0.04, 0.4
    """Shortest and longest distance it reports, m; the Baxter's."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, site: int) -> None:
        self._model, self._data, self._site = model, data, site
        around = np.arange(6) * (np.pi / 3)
        rim = np.sin(_CONE) * np.stack([np.cos(around), np.sin(around)])  # (2, 6)
        self._rays = np.vstack([np.c_[rim.T, np.full(6, np.cos(_CONE))], [0.0, 0.0, 1.0]])  # (7, 3)

    def true_distance(self) -> float:
        """Distance to the nearest surface in the cone, m; ``inf`` where there is none."""
        data, n, own_body = self._data, len(self._rays), int(self._model.site_bodyid[self._site])
        rays = self._rays @ data.site_xmat[self._site].reshape(3, 3).T
        geoms, distances = np.full(n, -1, np.int32), np.full(n, -1.0)
        mujoco.mj_multiRay(
            self._model, data, data.site_xpos[self._site], rays.ravel(), _VISIBLE, True, own_body, geoms,
            distances, None, n, 10.0,
        )  # fmt: skip
        return float(distances[geoms >= 0].min(initial=np.inf))

    def read(self, noise: EpisodeNoise) -> float:
        """One reading, m; ``inf`` where the sensor sees nothing."""
        return noise.read(self.true_distance(), self.reach)
