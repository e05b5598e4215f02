"""Noise of a low-cost arm and its sensors, and the infrared range sensor in its palm.

Thesis 1.2 (the hardware), 3.1.7 (what its noise did).
"""

from __future__ import annotations

from dataclasses import dataclass
from textwrap import shorten

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError
from gvp_lib.perception.images import check_rgb

__all__ = ["EpisodeNoise", "Noise", "RangeSensor"]

_CONE = np.radians(1.5)
_VISIBLE = np.array([1, 1, 1, 0, 0, 0], np.uint8)  # group 3 holds collision geometry, which no light sees

_ANGLE = 0.5, "in radians, from 0 to 0.5 (for degrees: np.radians(...))"
_SHARE = np.nextafter(1.0, 0.0), "relative, 0.1 for ten percent, not negative and below 1"
_BOUNDS = {
    "joint_offset_sd": _ANGLE,
    "repeatability_sd": _ANGLE,
    "exposure": _SHARE,
    "focal_length": _SHARE,
    "distortion": (0.5, "the coefficient k1 of a lens, from 0 to 0.5; a cheap one has 0.05"),
}
"""Upper bounds, and what the quantity is."""


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """Imperfections of a work cell, all off by default.

    Parameters
    ----------
    joint_offset_sd
        Standard deviation of each encoder's offset, rad; drawn per joint and episode.
    repeatability_sd
        Standard deviation of each joint's landing error, rad; drawn per joint and move, unseen by the encoder.
    pixel_sd
        Standard deviation of the noise in each channel of each pixel, on the scale of 0 to 255.
    exposure
        Largest relative error of the image's gain; uniform within +-, per episode.
    focal_length
        Largest relative error of the true focal length against the stated one; uniform within +-, per episode.
    range_bias
        Largest bias of the range sensor, m; uniform within +-, per episode.
    range_sd
        Standard deviation of each range reading, m.
    range_dropout
        Probability that a reading sees nothing.
    range_spike
        Probability that a reading is any number within the sensor's range.
    distortion
        Largest radial coefficient k1 (OpenCV's) of the true lens, at most 0.5, where the stated one is a pinhole;
        uniform within +-, per episode. See :func:`gvp_lib.simulation.camera.distorted`.

    Examples
    --------
    >>> Noise.thesis()
    Noise.thesis()
    >>> Noise(joint_offset_sd=np.radians(0.25), pixel_sd=2.0)
    Noise(joint_offset_sd=0.25 deg, pixel_sd=2)
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
                "Noise.range_dropout and range_spike are probabilities of exclusive events, at most 1 in sum; "
                f"got {self.range_dropout} + {self.range_spike} > 1"
            )

    def __repr__(self) -> str:
        for preset in ("none", "thesis"):
            if self == getattr(Noise, preset)():
                return f"Noise.{preset}()"
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        text = ", ".join(f"{name}={_quantity(name, value)}" for name, value in values.items() if value)
        return f"Noise({shorten(text, 150, placeholder=' ...')})"

    @classmethod
    def none(cls) -> Noise:
        """Noise of a perfect cell."""
        return cls()

    @classmethod
    def thesis(cls) -> Noise:
        """Noise of a low-cost arm, about 5 mm and 0.7 deg at the hand; frozen before any experiment."""
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


def _quantity(name: str, value: float) -> str:
    if _BOUNDS.get(name) is _ANGLE:
        return f"{np.degrees(value):.3g} deg"
    return f"{value:.3g} m" if name in ("range_bias", "range_sd") else f"{value:.3g}"


@checked
class EpisodeNoise:
    """One episode's sample of a :class:`Noise`, and the random streams for its moves, images and readings.

    Each source of noise has its own stream, so that turning one on leaves the draws of the others unchanged.

    Parameters
    ----------
    noise
        Imperfections to sample from.
    joints
        Number of the arm's joints.
    seed
        Seed of everything random.

    Attributes
    ----------
    gain
        Factor of the image's brightness.
    focal_scale
        True focal length over the stated one.
    range_bias
        Bias of the range sensor, m.
    joint_offset
        Offsets of the encoders, shape (joints,), rad.
    distortion
        Radial coefficient k1 of the true lens.

    Examples
    --------
    >>> EpisodeNoise(Noise.none(), joints=7, seed=np.random.SeedSequence(0))
    EpisodeNoise(gain 1, focal length x 1, k1 0, range bias 0 mm, joint offsets up to 0 deg)
    """

    def __init__(self, noise: Noise, joints: int, seed: np.random.SeedSequence) -> None:
        self.noise, joints = noise, _checked_joints(joints)
        episode, self._moves, self._pixels, self._range = (np.random.default_rng(s) for s in seed.spawn(4))
        draw = episode.uniform(-1, 1, 3)
        self.gain = 1 + noise.exposure * draw[0]
        self.focal_scale = 1 + noise.focal_length * draw[1]
        self.range_bias = noise.range_bias * draw[2]
        self.joint_offset = noise.joint_offset_sd * episode.standard_normal(joints)
        # From a stream of its own, which does not depend on the number of joints.
        self.distortion = noise.distortion * episode.spawn(1)[0].uniform(-1, 1)
        self._tiles: tuple[NDArray[np.uint8], NDArray[np.uint8]] | None = None

    def __repr__(self) -> str:
        bias, offset = 1e3 * self.range_bias, np.degrees(np.abs(self.joint_offset).max(initial=0.0))
        return (
            f"EpisodeNoise(gain {self.gain:.3g}, focal length x {self.focal_scale:.4g}, "
            f"k1 {self.distortion + 0.0:.3g}, range bias {bias:.3g} mm, joint offsets up to {offset:.3g} deg)"
        )

    def landing_error(self, joints: int) -> NDArray[np.float64]:
        """Draw each joint's landing error of one move, shape (joints,), rad.

        Parameters
        ----------
        joints
            Number of joints.
        """
        return self.noise.repeatability_sd * self._moves.standard_normal(_checked_joints(joints))

    def expose(self, rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Apply this episode's exposure and new pixel noise to a rendered image.

        Parameters
        ----------
        rgb
            Image, uint8 (height, width, 3); returned itself if there is neither.
        """
        rgb = check_rgb(rgb)
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
        # Brightening and darkening apart: adding signed numbers to an image takes OpenCV five times as long.
        brighter, darker = (tile[v : v + height, u : u + width] for tile in self._tiles)
        noisy = cv2.add(exposed, brighter)
        return np.asarray(cv2.subtract(noisy, darker, dst=noisy), np.uint8)

    def read(self, distance: float, reach: tuple[float, float]) -> float:
        """Draw a range reading of a true distance, m; ``inf`` for a dropout or beyond the sensor's reach.

        Parameters
        ----------
        distance
            True distance, m.
        reach
            Shortest and longest distance that the sensor reports, m.
        """
        if not (distance >= 0 and 0 <= reach[0] < reach[1] < np.inf):
            raise InvalidParameterError(
                "a range sensor reads a distance, 0 or more, within a reach from its shortest to its longest, in m; "
                f"got {distance} and {reach}"
            )
        chance, error, spike = self._range.uniform(), self._range.standard_normal(), self._range.uniform(*reach)
        if chance < self.noise.range_dropout:
            return float("inf")
        if chance < self.noise.range_dropout + self.noise.range_spike:
            return float(spike)
        reading = distance + self.range_bias + self.noise.range_sd * error
        return float(max(reach[0], reading)) if reading <= reach[1] else float("inf")


class RangeSensor:
    """Infrared range sensor: distance to the nearest surface within 1.5 deg of a site's +z.

    Parameters
    ----------
    model, data
        MuJoCo scene.
    site
        Id of the site where the sensor is.

    Attributes
    ----------
    reach
        Shortest and longest distance it reports, m; the Baxter's.
    """

    reach = 0.04, 0.4

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, site: int) -> None:
        if not 0 <= site < model.nsite:
            raise InvalidParameterError(f"the model has no site of id {site}; it has {model.nsite}, from 0")
        self._model, self._data, self._site = model, data, site
        around = np.arange(6) * (np.pi / 3)
        rim = np.sin(_CONE) * np.stack([np.cos(around), np.sin(around)])  # (2, 6)
        self._rays = np.vstack([np.c_[rim.T, np.full(6, np.cos(_CONE))], [0.0, 0.0, 1.0]])  # (7, 3)

    def __repr__(self) -> str:
        return f"RangeSensor({self.reach[0]:g} to {self.reach[1]:g} m)"

    def true_distance(self) -> float:
        """Distance to the nearest surface in the cone, m; ``inf`` if there is none."""
        data, n, own_body = self._data, len(self._rays), int(self._model.site_bodyid[self._site])
        rays = self._rays @ data.site_xmat[self._site].reshape(3, 3).T
        geoms, distances = np.full(n, -1, np.int32), np.full(n, -1.0)
        mujoco.mj_multiRay(
            self._model, data, data.site_xpos[self._site], rays.ravel(), _VISIBLE, True, own_body, geoms,
            distances, None, n, 10.0,
        )  # fmt: skip
        return float(distances[geoms >= 0].min(initial=np.inf))

    @checked
    def read(self, noise: EpisodeNoise) -> float:
        """Take one reading, m; ``inf`` if the sensor sees nothing.

        Parameters
        ----------
        noise
            Noise of the current episode.
        """
        return noise.read(self.true_distance(), self.reach)


def _checked_joints(joints: int) -> int:
    if not 0 <= joints <= 1000:
        raise InvalidParameterError(f"an arm has 0 to 1000 joints; got {joints}")
    return joints
