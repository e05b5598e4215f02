"""What the hand senses: an RGB camera and an infrared range sensor, with the faults of a cheap arm.

Thesis 1.2 (the hardware), 3.1.7 (what its noise did).
"""

from __future__ import annotations

import os
import sys
import threading
from dataclasses import dataclass

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from gvp_lib.errors import GvpError, InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.simulation.frames import camera_intrinsics
from gvp_lib.simulation.lens import distorted
from gvp_lib.simulation.visibility import Visibility

__all__ = ["CameraSensor", "EpisodeNoise", "Noise", "RangeSensor", "renderer"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """How imperfect the cell is. Everything is off unless set.

    Attributes
    ----------
    joint_offset_sd
        Encoder offset, drawn per joint and episode; rad.
    repeatability_sd
        How far from its target a joint ends, drawn per joint and move, unseen by the encoder; rad.
    pixel_sd
        Independent noise of every channel of every pixel; of 255.
    exposure
        Relative gain of the image, uniform within +-, per episode.
    focal_length
        Relative error of the true focal length against the stated one, uniform within +-, per episode.
    range_bias
        Offset of the range sensor, uniform within +-, per episode; m.
    range_sd
        Noise of each reading; m.
    range_dropout, range_spike
        Probability that a reading sees nothing, or is any number within the sensor's range.
    distortion
        First radial coefficient k1, as OpenCV defines it, of the true lens, where the stated one is a pinhole;
        uniform within +-, per episode, at most 0.5. What a barrel (k1 < 0) would see beyond the pinhole's
        picture is that picture's border, repeated.
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
            if not (np.isfinite(value) and value >= 0):
                raise InvalidParameterError(f"Noise.{name} is a magnitude: finite and not negative; got {value}")
        for name in ("joint_offset_sd", "repeatability_sd"):
            if getattr(self, name) > 0.5:
                raise InvalidParameterError(
                    f"Noise.{name} is in radians, and no arm is off by so much; got {getattr(self, name)}. "
                    "If degrees were meant: np.radians(...)"
                )
        for name in ("exposure", "focal_length"):
            if getattr(self, name) >= 1:
                raise InvalidParameterError(
                    f"Noise.{name} is relative, 0.1 for ten per cent, and below 1; got {getattr(self, name)}"
                )
        if self.distortion > 0.5:
            raise InvalidParameterError(
                "Noise.distortion is k1 of a lens, at focal length 1: 0.05 is a cheap one's and 0.5 the most; "
                f"got {self.distortion}"
            )
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
    """One episode's draw from a :class:`Noise`, and the streams of what is drawn at every move and reading.

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
        # From a stream of its own, so that it neither changes what an episode drew before there was such a thing
        # nor depends on the number of joints.
        self.distortion = noise.distortion * episode.spawn(1)[0].uniform(-1, 1)
        self._tiles: tuple[NDArray[np.uint8], NDArray[np.uint8]] | None = None

    def landing_error(self, joints: int) -> NDArray[np.float64]:
        """How far from its target each joint ends this time, shape (joints,), rad."""
        return self.noise.repeatability_sd * self._moves.standard_normal(joints)

    def expose(self, rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Exposure and pixel noise put on a rendered image."""
        if self.gain == 1 and self.noise.pixel_sd == 0:
            return rgb
        if self.noise.pixel_sd == 0:
            return np.asarray(cv2.convertScaleAbs(rgb, alpha=self.gain), np.uint8)
        height, width, channels = rgb.shape
        brighter, darker = self._pixel_noise(height, width, channels)
        exposed = rgb if self.gain == 1 else cv2.convertScaleAbs(rgb, alpha=self.gain)
        noisy = cv2.add(exposed, brighter)
        return np.asarray(cv2.subtract(noisy, darker, dst=noisy), np.uint8)

    def _pixel_noise(self, height: int, width: int, channels: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """What this frame's noise adds to each value and what it takes away, shape (height, width, channels): one of
        the two is 0. Apart, because adding numbers with a sign to a picture takes OpenCV five times as long."""
        if self._tiles is None or self._tiles[0].shape[1] != width + 64:
            # A normal number per pixel and frame would cost more than the rendering. A window at a random
            # place of one larger field differs from frame to frame all the same.
            field = np.rint(self._pixels.normal(0.0, self.noise.pixel_sd, (height + 64, width + 64, channels)))
            self._tiles = (field.clip(0, 255).astype(np.uint8), (-field).clip(0, 255).astype(np.uint8))
        v, u = self._pixels.integers(0, 65, 2)
        brighter, darker = (tile[v : v + height, u : u + width] for tile in self._tiles)
        return brighter, darker

    def read(self, distance: float, reach: tuple[float, float]) -> float:
        """A range reading, m, of a true distance; ``inf`` beyond the sensor's reach."""
        lottery, error, place = self._range.uniform(), self._range.standard_normal(), self._range.uniform(*reach)
        if lottery < self.noise.range_dropout:
            return float("inf")
        if lottery < self.noise.range_dropout + self.noise.range_spike:
            return float(place)
        reading = distance + self.range_bias + self.noise.range_sd * error
        return float(max(reach[0], reading)) if reading <= reach[1] else float("inf")


_MOST_PIXELS = 4096
_UNDRAWN = 5  # a group of geoms that no renderer draws unless it is told to


def renderer(
    model: mujoco.MjModel, width: int, height: int, *, shadows: bool = False, samples: int = 0
) -> mujoco.Renderer:
    """A renderer of one scene. Shadows cost six times the frame without a GPU, and multisampling more.

    Raises
    ------
    InvalidParameterError
        The size is not one that a graphics card can draw.
    GvpError
        MuJoCo was imported before this library and means to draw in a window, and there is no screen.
    """
    backend = sys.modules[mujoco.Renderer.__module__].gl_context.GLContext.__module__
    screen = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    if sys.platform == "linux" and "glfw" in backend and not screen:  # it would abort the whole process
        raise GvpError(
            "MuJoCo was imported before gvp_lib.simulation, chose to draw in a window, and there is no screen. "
            "Import gvp_lib.simulation first, or set MUJOCO_GL=egl before Python starts"
        )
    if not (0 < width <= _MOST_PIXELS and 0 < height <= _MOST_PIXELS):
        raise InvalidParameterError(
            f"a picture has at most {_MOST_PIXELS} x {_MOST_PIXELS} pixels, and at least one; got {width} x {height}"
        )
    # No larger than the picture: every frame clears the whole buffer.
    model.vis.global_.offwidth, model.vis.global_.offheight = width, height
    model.vis.quality.offsamples = samples
    size_of_shadows = model.vis.quality.shadowsize
    model.vis.quality.shadowsize = size_of_shadows if shadows else 0  # no map for what is not drawn
    try:
        made = mujoco.Renderer(model, height, width)
    finally:
        model.vis.quality.shadowsize = size_of_shadows
    made.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadows
    made.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
    return made


class CameraSensor:
    """One camera of a scene, as the hand's RGB camera."""

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, camera: int, width: int, height: int, *, shadows: bool = False
    ) -> None:
        self._model, self._data, self._camera = model, data, camera
        # Of the two, MuJoCo goes by the second where the model gives the camera a sensor's size.
        self._fovy = float(np.radians(model.cam_fovy[camera]))
        self._focal_lengths = model.cam_intrinsic[camera, :2].copy()
        self._visibility = Visibility(model, data, camera)
        self._shadows, self._distortion = shadows, 0.0
        self._renderer: mujoco.Renderer | None = None
        self.intrinsics = camera_intrinsics(model, camera, width, height)

    def focus(self, scale: float, distortion: float = 0.0) -> None:
        """Give the lens a true focal length ``scale`` times the stated one, and a radial distortion k1."""
        self._distortion = distortion
        self._model.cam_fovy[self._camera] = np.degrees(2 * np.arctan(np.tan(self._fovy / 2) / scale))
        self._model.cam_intrinsic[self._camera, :2] = scale * self._focal_lengths

    def capture(self, noise: EpisodeNoise) -> NDArray[np.uint8]:
        """An RGB image, shape (height, width, 3), of the scene as it stands."""
        if self._renderer is None:
            self._renderer = renderer(self._model, self.intrinsics.width, self.intrinsics.height, shadows=self._shadows)
            self._thread = threading.get_ident()
        if threading.get_ident() != self._thread:
            raise GvpError(
                "this camera took its first picture in another thread, to which its graphics context belongs. "
                "Make one WorkCell per thread, or close() this one there first"
            )
        self._show(self._renderer)
        return noise.expose(distorted(self._renderer.render(), self._true_pinhole(), self._distortion))

    def _show(self, renderer: mujoco.Renderer) -> None:
        """Hand the scene over without what the picture cannot show: most of an arm, and often floor and sky."""
        unseen = self._visibility.unseen(self._true_pinhole())
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = not unseen.sky
        groups = self._model.geom_group.copy()
        try:
            if not self._shadows:  # what casts one into the picture may itself be hidden
                self._model.geom_group[unseen.geoms] = _UNDRAWN
            renderer.update_scene(self._data, self._camera)
        finally:
            self._model.geom_group[:] = groups

    def _true_pinhole(self) -> CameraIntrinsics:
        """The lens that draws, before it bends anything."""
        return camera_intrinsics(self._model, self._camera, self.intrinsics.width, self.intrinsics.height)

    def close(self) -> None:
        """Free the graphics context; the next capture makes a new one."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


class RangeSensor:
    """An infrared range sensor: the nearest surface within a narrow cone about a site's +z.

    Parameters
    ----------
    site
        The site's id.
    half_angle
        Of the cone, rad.
    reach
        Shortest and longest distance it reports, m; the Baxter's sees from 0.04 to 0.4 m.
    """

    _VISIBLE = np.array([1, 1, 1, 0, 0, 0], np.uint8)  # group 3 holds collision geometry, which no light sees

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        site: int,
        half_angle: float = np.radians(1.5),
        reach: tuple[float, float] = (0.04, 0.4),
    ) -> None:
        self._model, self._data, self._site, self.reach = model, data, site, reach
        around = np.arange(6) * (np.pi / 3)
        rim = np.sin(half_angle) * np.stack([np.cos(around), np.sin(around)])  # (2, 6)
        self._rays = np.vstack([np.c_[rim.T, np.full(6, np.cos(half_angle))], [0.0, 0.0, 1.0]])  # (7, 3)

    def true_distance(self) -> float:
        """Distance to the nearest surface in the cone, m; ``inf`` where there is none."""
        data, n = self._data, len(self._rays)
        rays = self._rays @ data.site_xmat[self._site].reshape(3, 3).T
        geoms, distances = np.full(n, -1, np.int32), np.full(n, -1.0)
        own_body = int(self._model.site_bodyid[self._site])
        mujoco.mj_multiRay(
            self._model, data, data.site_xpos[self._site], rays.ravel(), self._VISIBLE, True, own_body, geoms,
            distances, None, n, 10.0,
        )  # fmt: skip
        return float(distances[geoms >= 0].min(initial=np.inf))

    def read(self, noise: EpisodeNoise) -> float:
        """One reading, m; ``inf`` where the sensor sees nothing."""
        return noise.read(self.true_distance(), self.reach)
