"""What of a scene a picture cannot show. Without a GPU every pixel that is filled costs time, even one that something
nearer then covers; so what cannot show is not drawn."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.simulation.lens import corner_rays, out_of_view

__all__ = ["Unseen", "Visibility"]

_MARGIN = 1e-3  # m: the card rounds to single precision
_SKY = 0.5  # of the far plane's distance: MuJoCo's sky, a cylinder, hides all beyond 0.7 or little less
_PLANE, _BOX = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_BOX)
_DRAWN_GROUPS = 3  # a renderer draws groups 0 to 2


@dataclass(frozen=True, slots=True)
class Unseen:
    """What one picture cannot show.

    Attributes
    ----------
    geoms
        Geoms that are out of view, or wholly behind a surface that fills the picture; bool (ngeom,).
    sky
        Whether such a surface hides the sky.
    """

    geoms: NDArray[np.bool_]
    sky: bool


class Visibility:
    """Tells what a camera cannot show where it stands; nothing that shows is ever taken for hidden.

    The surfaces that may fill a picture are the upper sides of the opaque boxes and finite planes that are fixed in the
    world, such as a table's top and the floor. One of them fills it where the rays through the picture's four corners
    meet it, for what the picture cuts out of its plane is convex, as the surface is.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, camera: int) -> None:
        self._model, self._data, self._camera = model, data, camera
        fixed = model.body_weldid[model.geom_bodyid] == 0
        finite_plane = (model.geom_type == _PLANE) & (model.geom_size[:, :2] > 0).all(axis=1)
        self._surfaces = np.flatnonzero(fixed & (finite_plane | (model.geom_type == _BOX)))  # (k,)
        self._planes = np.flatnonzero(model.geom_type[self._surfaces] == _PLANE)

    def unseen(self, lens: CameraIntrinsics) -> Unseen:
        """What a picture through this lens cannot show, as the scene stands."""
        data = self._data
        world_from_optical = data.cam_xmat[self._camera].reshape(3, 3) * (1.0, -1.0, -1.0)
        geoms = self._out_of_view(lens, world_from_optical)
        filling = self._filling(lens, world_from_optical)
        for surface in filling:
            geoms |= self._below(surface)
        return Unseen(geoms, sky=bool(len(filling)))

    def _out_of_view(self, lens: CameraIntrinsics, world_from_optical: NDArray[np.float64]) -> NDArray[np.bool_]:
        centers = (self._data.geom_xpos - self._data.cam_xpos[self._camera]) @ world_from_optical
        bounded = self._model.geom_rbound > 0  # a plane is not
        return bounded & out_of_view(lens, centers, self._model.geom_rbound)

    def _filling(self, lens: CameraIntrinsics, world_from_optical: NDArray[np.float64]) -> NDArray[np.int64]:
        """Which of the surfaces fill the picture, as indices into them."""
        model, data, half = self._model, self._data, self._half_extents()
        optical_rays = corner_rays(lens)  # (4, 3)
        # In each surface's own frame, whose z is its normal:
        axes = data.geom_xmat[self._surfaces].reshape(-1, 3, 3)  # (k, 3, 3)
        eye = ((data.cam_xpos[self._camera] - data.geom_xpos[self._surfaces])[:, None] @ axes)[:, 0]  # (k, 3)
        rays = (optical_rays @ world_from_optical.T) @ axes  # (k, 4, 3)
        height = eye[:, 2] - half[:, 2]  # (k,), m, of the camera over the surface
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = height[:, None] / -rays[:, :, 2]  # (k, 4), m
            meets = eye[:, None, :2] + distance[:, :, None] * rays[:, :, :2]  # (k, 4, 2)
        near, far = model.stat.extent * model.vis.map.znear, model.stat.extent * model.vis.map.zfar
        met = (
            (distance * optical_rays[:, 2] > near + _MARGIN)
            & (distance < _SKY * far - _MARGIN)
            & (np.abs(meets) < half[:, None, :2] - _MARGIN).all(axis=2)
        )
        return np.flatnonzero((height > 0) & met.all(axis=1) & self._opaque())

    def _half_extents(self) -> NDArray[np.float64]:
        """Of the surfaces' boxes and planes along their own axes, shape (k, 3), m."""
        half = self._model.geom_size[self._surfaces]
        half[self._planes, 2] = 0.0  # there it is the spacing of a grid
        return np.asarray(half)

    def _opaque(self) -> NDArray[np.bool_]:
        """Which of the surfaces are drawn, and hide what is behind them; bool (k,)."""
        model, surfaces = self._model, self._surfaces
        material = model.geom_matid[surfaces]
        solid = model.geom_rgba[surfaces, 3] == 1
        if model.nmat:
            solid &= (material < 0) | (model.mat_rgba[material, 3] == 1)
        return solid & (model.geom_group[surfaces] < _DRAWN_GROUPS)

    def _below(self, surface: int) -> NDArray[np.bool_]:
        """Which geoms lie wholly below a surface; bool (ngeom,)."""
        model, data, half = self._model, self._data, self._half_extents()
        axes = data.geom_xmat[self._surfaces].reshape(-1, 3, 3)
        normal = axes[surface, :, 2]
        reach = np.where(model.geom_rbound > 0, model.geom_rbound, np.inf)
        # A sphere around a floor or a table's leg would reach far above it.
        reach[self._surfaces] = (np.abs(normal @ axes) * half).sum(axis=1)
        height = (data.geom_xpos - data.geom_xpos[self._surfaces[surface]]) @ normal - half[surface, 2]
        return np.asarray(height + reach < -_MARGIN)
