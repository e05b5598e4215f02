"""Still pictures of a view, rendered by MuJoCo: what a reader sees where no script runs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvp_lib.errors import InvalidParameterError
from gvp_lib.simulation.camera import renderer

__all__ = ["View", "render_still"]

Rods = tuple[NDArray[np.float64], NDArray[np.float64], float]
_TOP, _BOTTOM = np.array([251, 249, 245.0]), np.array([230, 223, 211.0])  # as in the page's light theme


@dataclass(frozen=True)
class View:
    """Where the eye of a view is.

    Attributes
    ----------
    target
        World point looked at, meters.
    azimuth, elevation
        Direction from the target to the eye, rad.
    distance
        From the target to the eye, meters.
    fovy
        Vertical field of view, rad.
    extent
        Size of the scene, meters.
    """

    target: tuple[float, float, float]
    azimuth: float
    elevation: float
    distance: float
    fovy: float
    extent: float

    @classmethod
    def of(cls, corners: NDArray[np.float64], model: mujoco.MjModel) -> View:
        """A view from the front left, somewhat above, that takes in the box between two corners (2, 3)."""
        fovy = float(np.radians(model.vis.global_.fovy))
        radius = 0.5 * float(np.linalg.norm(corners[1] - corners[0]))
        distance = 0.95 * radius / np.sin(0.5 * fovy)
        target = tuple(float(c) for c in corners.mean(axis=0))
        return cls(target, float(np.radians(-35)), float(np.radians(22)), distance, fovy, radius)  # type: ignore[arg-type]

    def moved(
        self, azimuth: float | None, elevation: float | None, distance: float | None, target: ArrayLike | None
    ) -> View:
        """The same view with what is given changed."""
        given: dict[str, Any] = {"azimuth": azimuth, "elevation": elevation, "distance": distance}
        if target is not None:
            point = np.asarray(target, float)
            if point.shape != (3,):
                raise InvalidParameterError(f"the target is a world point of shape (3,), meters; got {target!r}")
            given["target"] = tuple(float(c) for c in point)
        if distance is not None and not distance > 0:
            raise InvalidParameterError(f"the distance to the target is positive, meters; got {distance}")
        return replace(self, **{name: value for name, value in given.items() if value is not None})

    @property
    def eye(self) -> NDArray[np.float64]:
        """World position of the eye, shape (3,), meters."""
        c = np.cos(self.elevation)
        outward = np.array([c * np.cos(self.azimuth), c * np.sin(self.azimuth), np.sin(self.elevation)])
        return np.asarray(self.target) + self.distance * outward

    def to_json(self) -> dict[str, Any]:
        """As the page's player reads it."""
        return {
            "lookat": np.round(self.target, 4).tolist(),
            "eye": np.round(self.eye, 4).tolist(),
            "fovy": round(float(np.degrees(self.fovy)), 3),
            "extent": round(self.extent, 4),
        }


def render_still(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    view: View,
    groups: Iterable[int],
    rods: Sequence[Rods],
    width: int,
    height: int,
) -> NDArray[np.uint8]:
    """Render a view with overlays given as rods: segments (n, 2, 3), colors (n, 4), radius."""
    camera = mujoco.MjvCamera()
    camera.lookat[:] = view.target
    camera.distance = view.distance
    # MuJoCo counts from the direction of sight, this view from the eye's.
    camera.azimuth, camera.elevation = np.degrees(view.azimuth) + 180, -np.degrees(view.elevation)
    option = mujoco.MjvOption()
    option.geomgroup[:] = 0
    option.geomgroup[list(groups)] = 1
    with renderer(model, width, height, shadows=True, samples=4) as made:
        made.update_scene(data, camera, option)
        for segments, colors, radius in rods:
            _draw_rods(made.scene, segments, colors, radius)
        picture = made.render()
        made.enable_segmentation_rendering()
        nothing = made.render()[..., 0] < 0
    gradient = _TOP + (_BOTTOM - _TOP) * np.linspace(0, 1, height)[:, None, None]
    return np.where(nothing[..., None], np.broadcast_to(gradient, picture.shape), picture).round().astype(np.uint8)


def _draw_rods(
    scene: mujoco.MjvScene, segments: NDArray[np.float64], colors: NDArray[np.float64], radius: float
) -> None:
    for (start, end), color in zip(segments, colors, strict=True):
        if scene.ngeom >= scene.maxgeom:
            return
        geom = scene.geoms[scene.ngeom]
        capsule = mujoco.mjtGeom.mjGEOM_CAPSULE
        mujoco.mjv_initGeom(geom, capsule, np.zeros(3), np.zeros(3), np.zeros(9), color.astype(np.float32))
        mujoco.mjv_connector(geom, capsule, radius, start, end)
        geom.emission = 0.6
        geom.segid = scene.ngeom  # or the second pass, which finds the background, reads past its table
        geom.objid, geom.objtype = 0, int(mujoco.mjtObj.mjOBJ_UNKNOWN)
        geom.category = mujoco.mjtCatBit.mjCAT_DECOR
        scene.ngeom += 1
