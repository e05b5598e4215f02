"""The simulated camera: its pose and lens in MuJoCo's conventions and ours, what it cannot see, and its images.

MuJoCo's camera looks along -z with y up; ours is the optical frame, x right, y down, z forward. MuJoCo's quaternions
are (w, x, y, z). Neither leaves `simulation`.
"""

from __future__ import annotations

import importlib
import os
import sys
import threading
from contextlib import suppress
from functools import cache, lru_cache
from typing import Any, NamedTuple

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.checks import checked, finite
from gvp_lib.errors import GvpError, InvalidImageError, InvalidParameterError, RenderingError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.picture import count
from gvp_lib.simulation.sensors import EpisodeNoise

__all__ = [
    "CameraSensor",
    "Unseen",
    "camera_intrinsics",
    "camera_pose",
    "distorted",
    "optical_pose",
    "out_of_view",
    "renderer",
    "to_mujoco_camera",
    "unseen",
]

_MUJOCO_FROM_OPTICAL = np.diag([1.0, -1.0, -1.0])  # half a turn about x; its own inverse
_MARGIN = 1e-3  # m: the card rounds to single precision
_SKY = 0.5  # of the far plane's distance: MuJoCo's sky, a cylinder, hides all beyond 0.7 or little less
_UNDRAWN = 3  # the first group of geoms that a renderer does not draw by default
_MAX_PIXELS = 4096


def optical_pose(position: NDArray[np.float64], matrix: NDArray[np.float64]) -> RigidTransform:
    """Pose of the optical frame, from ``cam_xpos`` (3,) and ``cam_xmat`` (9,)."""
    rotation = Rotation.from_matrix(matrix.reshape(3, 3) @ _MUJOCO_FROM_OPTICAL)
    return RigidTransform.from_components(position, rotation)


def camera_pose(data: mujoco.MjData, camera: int) -> RigidTransform:
    """``world_from_camera`` of a camera in the model, optical frame."""
    return optical_pose(data.cam_xpos[camera], data.cam_xmat[camera])


def camera_intrinsics(model: mujoco.MjModel, camera: int, width: int, height: int) -> CameraIntrinsics:
    """Intrinsics of a camera in the model, for a picture of this size in pixels.

    A camera has a field of view, or a sensor with a focal length and a principal point in meters, which MuJoCo
    spreads over whatever picture it draws. It counts the principal point from the center, left and up.
    """
    if not model.cam_sensorsize[camera].all():
        return CameraIntrinsics.from_fov(float(np.radians(model.cam_fovy[camera])), width, height)
    density = np.array([width, height]) / model.cam_sensorsize[camera]  # pixels per meter
    fx, fy, left, up = (model.cam_intrinsic[camera] * np.tile(density, 2)).tolist()
    return CameraIntrinsics(width, height, fx, fy, 0.5 * (width - 1) - left, 0.5 * (height - 1) - up)


def to_mujoco_camera(body_from_camera: RigidTransform) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Position (3,) and wxyz quaternion (4,) of the MuJoCo camera whose optical frame has this pose."""
    turned = body_from_camera * RigidTransform.from_rotation(Rotation.from_matrix(_MUJOCO_FROM_OPTICAL))
    return turned.translation, turned.rotation.as_quat(scalar_first=True)


# --- the lens ---------------------------------------------------------------------------------------------------------


def out_of_view(lens: CameraIntrinsics, centers: NDArray[np.float64], radii: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mask (n,) of the spheres that lie wholly outside what a lens shows; a few may be missed, none in view is taken.

    Spheres are given by ``centers`` (n, 3), optical frame, and ``radii`` (n,), m.
    """
    _, inward = _pyramid(lens)
    inside = centers @ inward.T  # (n, 5), m
    return np.asarray((inside < -(radii[:, None] + _MARGIN)).any(axis=1))


@lru_cache(maxsize=8)  # an episode has one lens
def _pyramid(lens: CameraIntrinsics) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit rays through an image's corners (4, 3), and inward unit normals of the viewing pyramid's sides and of the
    plane through its apex (5, 3); optical frame."""
    right, bottom = lens.width - 0.5, lens.height - 0.5
    corners = lens.rays([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])
    sides = np.cross(np.roll(corners, 1, axis=0), corners)
    sides /= np.linalg.norm(sides, axis=1, keepdims=True)
    return corners, np.vstack([sides, [0.0, 0.0, 1.0]])


@checked
def distorted(rgb: NDArray[np.uint8], lens: CameraIntrinsics, k1: float) -> NDArray[np.uint8]:
    """Add radial distortion to the image of a pinhole camera.

    Parameters
    ----------
    rgb
        Image, uint8 (height, width, 3); returned itself if ``k1`` is 0.
    lens
        Intrinsics of the pinhole camera; the principal point is the center of distortion.
    k1
        OpenCV's first radial coefficient: a ray that meets the image plane at a radius r (in focal lengths) from
        the principal point is seen at ``r * (1 + k1 * r**2)``. Negative for barrel, positive for pincushion distortion.

    Returns
    -------
    NDArray[np.uint8]
        Distorted image, interpolated linearly. Where barrel distortion shows what is outside the pinhole's image, that
        image's border is repeated outward; so is the last radius before strong barrel distortion would fold back.

    Examples
    --------
    >>> lens = CameraIntrinsics.from_fov(np.radians(45), 64, 48)
    >>> distorted(np.zeros((48, 64, 3), np.uint8), lens, k1=-0.1).shape
    (48, 64, 3)
    """
    finite(k1=k1)
    right = isinstance(rgb, np.ndarray) and rgb.ndim in (2, 3) and rgb.shape[:2] == (lens.height, lens.width)
    if (
        not right
        or rgb.dtype not in (np.uint8, np.uint16, np.float32, np.float64)
        or rgb.shape[2:] not in ((), (1,), (3,), (4,))
    ):
        raise InvalidImageError(
            f"a picture through the lens is an array of {lens.width} x {lens.height} pixels, of bytes or floats; got "
            f"a {type(rgb).__name__} of shape {np.shape(rgb)}"
        )
    if k1 == 0:
        return rgb
    where, fraction = _distortion_maps(lens, k1)
    return np.asarray(cv2.remap(rgb, where, fraction, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.uint8)


@lru_cache(maxsize=8)  # an episode has one lens
def _distortion_maps(lens: CameraIntrinsics, k1: float) -> tuple[NDArray[np.int16], NDArray[np.uint16]]:
    """Place in the pinhole's image of each pixel of the distorted one, in OpenCV's fixed-point form."""
    v, u = np.indices((lens.height, lens.width))
    x, y = (u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy
    seen = np.hypot(x, y)  # (height, width)
    # The distortion has no simple inverse, but a table has. Up to the fold, 1.5 times the radius is always enough.
    fold = 1 / np.sqrt(-3 * k1) if k1 < 0 else np.inf
    radius = np.linspace(0.0, min(1.5 * seen.max(), fold), 4096)
    straight = np.interp(seen, radius * (1 + k1 * radius**2), radius)
    scale = np.divide(straight, seen, out=np.ones_like(seen), where=seen > 0)
    u, v = scale * x * lens.fx + lens.cx, scale * y * lens.fy + lens.cy
    where, fraction = cv2.convertMaps(u.astype(np.float32), v.astype(np.float32), cv2.CV_16SC2)
    return np.asarray(where, np.int16), np.asarray(fraction, np.uint16)


# --- what an image cannot show ----------------------------------------------------------------------------------------


class Unseen(NamedTuple):
    """Geoms of a scene that a picture cannot show, bool (ngeom,), and whether what fills it hides the sky."""

    geoms: NDArray[np.bool_]
    sky: bool

    def __repr__(self) -> str:
        return f"Unseen({np.count_nonzero(self.geoms)} of {count(len(self.geoms), 'geom')}{', the sky' * self.sky})"


def unseen(model: mujoco.MjModel, data: mujoco.MjData, camera: int, lens: CameraIntrinsics) -> Unseen:
    """Find what a picture of the scene cannot show; nothing that shows is ever taken for hidden.

    Without a GPU every filled pixel costs time, even one that something nearer then covers, so what cannot show is not
    drawn: what is out of view, or wholly behind a surface that fills the picture. Such surfaces are the upper sides of
    the opaque boxes and finite planes that are fixed in the world, as a table's top and the floor. One fills the
    picture where the rays through its four corners meet it, for what the picture cuts out of its plane is convex, as
    the surface is.
    """
    kind, size, radius, eye = model.geom_type, model.geom_size, model.geom_rbound, data.cam_xpos[camera]
    world_from_optical = data.cam_xmat[camera].reshape(3, 3) * (1.0, -1.0, -1.0)
    bounded = radius > 0  # a plane is not
    hidden = bounded & out_of_view(lens, (data.geom_xpos - eye) @ world_from_optical, radius)

    plane = kind == int(mujoco.mjtGeom.mjGEOM_PLANE)
    flat = (kind == int(mujoco.mjtGeom.mjGEOM_BOX)) | (plane & (size[:, :2] > 0).all(axis=1))
    opaque = model.geom_rgba[:, 3] == 1
    if model.nmat:
        opaque &= (model.geom_matid < 0) | (model.mat_rgba[model.geom_matid, 3] == 1)
    fixed = model.body_weldid[model.geom_bodyid] == 0
    surfaces = np.flatnonzero(flat & opaque & fixed & (model.geom_group < _UNDRAWN))  # (k,)
    half = size[surfaces]
    half[plane[surfaces], 2] = 0.0  # there it is the spacing of a grid

    # In each surface's own frame, whose z is its normal:
    axes = data.geom_xmat[surfaces].reshape(-1, 3, 3)  # (k, 3, 3)
    start = ((eye - data.geom_xpos[surfaces])[:, None] @ axes)[:, 0]  # (k, 3)
    corners, _ = _pyramid(lens)
    rays = (corners @ world_from_optical.T) @ axes  # (k, 4, 3)
    height = start[:, 2] - half[:, 2]  # (k,), m, of the camera over the surface
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = height[:, None] / -rays[:, :, 2]  # (k, 4), m
        meets = start[:, None, :2] + distance[:, :, None] * rays[:, :, :2]  # (k, 4, 2)
    near, far = model.stat.extent * model.vis.map.znear, model.stat.extent * model.vis.map.zfar
    met = (
        (distance * corners[:, 2] > near + _MARGIN)
        & (distance < _SKY * far - _MARGIN)
        & (np.abs(meets) < half[:, None, :2] - _MARGIN).all(axis=2)
    )
    filling = np.flatnonzero((height > 0) & met.all(axis=1))
    for k in filling:
        normal = axes[k, :, 2]
        reach = np.where(bounded, radius, np.inf)
        reach[surfaces] = (np.abs(normal @ axes) * half).sum(axis=1)  # a sphere around a floor would reach far above it
        above = (data.geom_xpos - data.geom_xpos[surfaces[k]]) @ normal - half[k, 2] + reach  # m, the highest point
        hidden |= above < -_MARGIN
    return Unseen(hidden, sky=bool(len(filling)))


# --- images -----------------------------------------------------------------------------------------------------------


_artist: int | None = None  # the first process that drew, of this one and those it was forked from


class _Renderer(mujoco.Renderer):
    """Renderer that draws only where its graphics context is: in the process and thread that made it."""

    def __init__(self, model: mujoco.MjModel, height: int, width: int) -> None:
        super().__init__(model, height, width)
        self._thread = threading.get_ident()

    def render(self, *, out: NDArray[Any] | None = None) -> NDArray[Any]:
        _refuse_forks()
        if threading.get_ident() != self._thread:
            raise GvpError(
                "the first image was drawn in another thread, to which the graphics context belongs. "
                "Make one WorkCell per thread, or close() this one there first"
            )
        return super().render(out=out)


def _refuse_forks() -> None:
    """Refuse to draw in a process that was forked from one that had drawn: it would wait forever for the driver's
    threads, which a fork leaves behind."""
    if _artist not in (None, os.getpid()):
        raise GvpError(
            "this process was forked from one that had drawn, and no graphics driver survives a fork. Start it by "
            'spawn: AsyncVectorEnv(..., context="spawn"), DataLoader(..., multiprocessing_context="spawn"), '
            'multiprocessing.get_context("spawn")'
        )


def _note_artist() -> None:
    """Note, before a fork, whether this process has drawn by EGL without this library."""
    global _artist
    if getattr(sys.modules.get("mujoco.egl"), "EGL_DISPLAY", None) is not None:
        _artist = _artist or os.getpid()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_note_artist)


def renderer(
    model: mujoco.MjModel, width: int, height: int, *, shadows: bool = False, samples: int = 0
) -> mujoco.Renderer:
    """Renderer of one scene. Shadows cost six times the frame without a GPU, and multisampling more.

    Raises
    ------
    InvalidParameterError
        The size is not one that a graphics card can draw.
    RenderingError
        MuJoCo cannot draw on this machine.
    GvpError
        This process was forked from one that had drawn.
    """
    global _artist
    if not (0 < width <= _MAX_PIXELS and 0 < height <= _MAX_PIXELS):
        raise InvalidParameterError(
            f"an image has at most {_MAX_PIXELS} x {_MAX_PIXELS} pixels, and at least one; got {width} x {height}"
        )
    _refuse_forks()
    _refuse_what_cannot_draw()
    # No larger than the image: every frame clears the whole buffer.
    model.vis.global_.offwidth, model.vis.global_.offheight = width, height
    model.vis.quality.offsamples = samples
    _load_triton()
    shadow_size = model.vis.quality.shadowsize
    model.vis.quality.shadowsize = shadow_size if shadows else 0  # no map for what is not drawn
    _artist = os.getpid()
    try:
        result = _Renderer(model, height, width)
    except Exception as error:
        raise RenderingError.from_error(error) from error
    finally:
        model.vis.quality.shadowsize = shadow_size
    result.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadows
    result.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
    return result


def _refuse_what_cannot_draw() -> None:
    """Refuse where drawing is turned off, or would be in a window without a screen, which aborts the whole process."""
    context = getattr(sys.modules[mujoco.Renderer.__module__].gl_context, "GLContext", None)
    if context is None:
        raise RenderingError("drawing is turned off")
    screen = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    if sys.platform != "linux" or "glfw" not in context.__module__ or screen:
        return
    if os.environ.get("MUJOCO_GL") == "egl":  # which gvp_lib sets, but MuJoCo had been there before
        raise RenderingError(
            "MuJoCo was imported before gvp_lib and chose to draw in a window, but there is no screen",
            "import gvp_lib first, or set MUJOCO_GL=egl before Python starts",
        )
    raise RenderingError("it would draw in a window, but there is no screen")


@cache
def _load_triton() -> None:
    """Load triton, which comes with the CUDA builds of torch, before Mesa draws.

    Both bring an LLVM. If Mesa's is loaded first, triton (from 3.7) takes it for its own, and the process crashes at
    the first optimizer, far from here. The other way round, each keeps its own.
    """
    if sys.platform == "linux":
        with suppress(ImportError):
            importlib.import_module("triton")


class CameraSensor:
    """RGB camera in the hand: one camera of a scene."""

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, camera: int, width: int, height: int, *, shadows: bool = False
    ) -> None:
        self._model, self._data, self._camera = model, data, camera
        # MuJoCo uses the second if the model gives the camera a sensor size, else the first.
        self._fovy = float(np.radians(model.cam_fovy[camera]))
        self._focal_lengths = model.cam_intrinsic[camera, :2].copy()
        self._shadows, self._distortion = shadows, 0.0
        self._renderer: mujoco.Renderer | None = None
        self.intrinsics = camera_intrinsics(model, camera, width, height)

    def __repr__(self) -> str:
        lens = self.intrinsics
        return f"CameraSensor({lens.width} x {lens.height} px, focal length {lens.fx:.1f} px)"

    def focus(self, scale: float, distortion: float = 0.0) -> None:
        """Set the true focal length, ``scale`` times the stated one, and the radial distortion k1."""
        self._distortion = distortion
        self._model.cam_fovy[self._camera] = np.degrees(2 * np.arctan(np.tan(self._fovy / 2) / scale))
        self._model.cam_intrinsic[self._camera, :2] = scale * self._focal_lengths

    def capture(self, noise: EpisodeNoise) -> NDArray[np.uint8]:
        """RGB image of the scene as it stands, shape (height, width, 3)."""
        if self._renderer is None:
            self._renderer = renderer(self._model, self.intrinsics.width, self.intrinsics.height, shadows=self._shadows)
        model, pinhole = self._model, self.pinhole
        hidden = unseen(model, self._data, self._camera, pinhole)
        self._renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = not hidden.sky
        groups = model.geom_group.copy()
        try:
            if not self._shadows:  # what casts one into the image may itself be hidden
                model.geom_group[hidden.geoms] = _UNDRAWN
            self._renderer.update_scene(self._data, self._camera)
        finally:
            model.geom_group[:] = groups
        return noise.expose(distorted(self._renderer.render(), pinhole, self._distortion))

    @property
    def pinhole(self) -> CameraIntrinsics:
        """True intrinsics, before distortion."""
        return camera_intrinsics(self._model, self._camera, self.intrinsics.width, self.intrinsics.height)

    def close(self) -> None:
        """Free the graphics context; the next capture creates a new one."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
