"""A MuJoCo scene and what is drawn over it, as commands to meshcat's page."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError, UnknownNameError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.simulation import camera as frames
from gvp_lib.views import overlays
from gvp_lib.views.bodies import anchored_geoms, draw_geoms
from gvp_lib.views.overlays import Overlay
from gvp_lib.views.threejs import Group, number_list

__all__ = ["SceneGraph"]

Command = dict[str, Any]


class SceneGraph:
    """The bodies of a model, by how they move, and the overlays attached to them. See ``Scene3D``."""

    def __init__(self, source: Any, data: mujoco.MjData | None, groups: Iterable[int]) -> None:
        if isinstance(source, mujoco.MjModel):
            self.model, self.data = source, mujoco.MjData(source) if data is None else data
        elif isinstance(getattr(source, "model", None), mujoco.MjModel) and data is None:
            self.model, self.data = source.model, source.data
        else:
            raise InvalidParameterError(
                f"Scene3D shows a mujoco.MjModel with its MjData, or one object with .model and .data; got {source!r}"
            )
        _ensure_forward(self.model, self.data)
        self._source = source
        self._groups = tuple(groups)
        self._geoms = anchored_geoms(self.model, self._groups)
        self._overlays: dict[str, tuple[int, NDArray[np.float64], Overlay]] = {}

    def add_frustum(
        self,
        name: str,
        world_from_camera: RigidTransform | None = None,
        intrinsics: CameraIntrinsics | None = None,
        *,
        camera: str | None = None,
        depth: float = 0.15,
        image: NDArray[np.uint8] | None = None,
        color: tuple[float, float, float] = overlays.ORANGE,
    ) -> None:
        """Draw what a camera sees, ``depth`` m deep, with an RGB ``image`` on its far side if one is given.

        Give a pose and ``intrinsics``, or name one of the model's cameras, whose frustum then moves with it.
        """
        if camera is not None:
            body, pose, intrinsics = self._model_camera(camera, intrinsics)
        elif world_from_camera is not None and intrinsics is not None:
            body, pose = 0, world_from_camera.as_matrix()
        else:
            raise InvalidParameterError("a frustum needs world_from_camera and intrinsics, or camera='a name'")
        self._add(name, overlays.frustum(intrinsics, depth, (*color, 1.0), image), body, pose)

    def add_sphere(
        self,
        name: str,
        sphere: VirtualSphere,
        max_tilt: float = np.radians(30),
        color: tuple[float, float, float] = overlays.SKY,
    ) -> None:
        """Draw the cap of a virtual sphere within ``max_tilt`` rad of its pole."""
        self._add(name, overlays.sphere(sphere, max_tilt, (*color, 1.0)))

    def add_path(
        self,
        name: str,
        path: RigidTransform | ArrayLike,
        *,
        radius: float = 0.002,
        arrows: int = 24,
        color: tuple[float, float, float] = overlays.VERMILION,
    ) -> None:
        """Draw a path through world points (n, 3), or through poses; at most ``arrows`` poses show their +z."""
        self._add(name, overlays.path(path, (*color, 1.0), radius, arrows))

    def add_frame(self, name: str, world_from_frame: RigidTransform, size: float = 0.1) -> None:
        """Draw a frame's axes, ``size`` m long: x red, y green, z blue."""
        self._add(name, overlays.frame(size), 0, world_from_frame.as_matrix())

    def add_points(
        self,
        name: str,
        points: ArrayLike,
        *,
        radius: float = 0.004,
        color: tuple[float, float, float] = overlays.GREEN,
    ) -> None:
        """Draw world points (n, 3), meters, as small balls."""
        self._add(name, overlays.points(points, (*color, 1.0), radius))

    def remove(self, name: str) -> None:
        """Take an overlay away again."""
        if name not in self._overlays:
            raise UnknownNameError("overlay", name, self._overlays)
        body, _, _ = self._overlays.pop(name)
        self._send([{"type": "delete", "path": f"/bodies/{body}/{name}"}])

    def _add(self, name: str, overlay: Overlay, body: int = 0, pose: ArrayLike | None = None) -> None:
        if not name or "/" in name:
            raise InvalidParameterError(f"an overlay's name is not empty and holds no '/'; got {name!r}")
        if name in self._overlays:
            self.remove(name)
        matrix = np.eye(4) if pose is None else np.asarray(pose, float)
        self._overlays[name] = (body, matrix, overlay)
        self._send(self._overlay_commands(name))

    def _model_camera(
        self, name: str, intrinsics: CameraIntrinsics | None
    ) -> tuple[int, NDArray[np.float64], CameraIntrinsics]:
        camera = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_CAMERA, name)
        if camera < 0:
            raise UnknownNameError("camera", name, (self.model.camera(i).name for i in range(self.model.ncam)))
        if intrinsics is None:
            width, height = (int(n) for n in self.model.cam_resolution[camera])
            width, height = (640, 480) if width <= 1 else (width, height)  # MuJoCo's default is 1 x 1
            intrinsics = frames.camera_intrinsics(self.model, camera, width, height)
        body = int(self.model.body_weldid[self.model.cam_bodyid[camera]])
        world_from_body = frames.pose(self.data.xpos[body], self.data.xmat[body])
        body_from_camera = world_from_body.inv() * frames.camera_pose(self.data, camera)
        return body, body_from_camera.as_matrix(), intrinsics

    # --- the scene as commands -----------------------------------------------------------------------------------

    def _send(self, commands: list[Command]) -> None:
        """Pass commands on to whoever looks on; a plain graph has no such."""

    def _sync(self) -> bool:
        """Take over the source's model where it was compiled anew (a work cell that was reset); True if it was."""
        model = getattr(self._source, "model", self.model)
        if model is self.model:
            self.data = getattr(self._source, "data", self.data)
            return False
        self.model, self.data = model, self._source.data
        _ensure_forward(self.model, self.data)
        self._geoms = anchored_geoms(self.model, self._groups)
        self._send([{"type": "delete", "path": "/bodies"}, *self._commands()])
        return True

    def _commands(self) -> list[Command]:
        commands = []
        for body, geoms in self._geoms.items():
            group = draw_geoms(self.model, self.data, body, geoms)
            commands.append(_set_object(f"/bodies/{body}", group))
        for name in self._overlays:
            commands += self._overlay_commands(name)
        return commands + self._pose_commands()

    def _overlay_commands(self, name: str) -> list[Command]:
        body, pose, overlay = self._overlays[name]
        path = f"/bodies/{body}/{name}"
        matrix = {"type": "set_transform", "path": path, "matrix": number_list(pose.T, 6)}
        return [_set_object(path, overlay.group), matrix]

    def _bodies(self) -> list[int]:
        return sorted(set(self._geoms) | {body for body, _, _ in self._overlays.values()})

    def _pose_commands(self) -> list[Command]:
        commands = []
        for body in self._bodies():
            if body == 0:
                continue
            position, (w, x, y, z) = self.data.xpos[body], self.data.xquat[body]
            pose = number_list([*position, x, y, z, w])
            commands.append({"type": "pose", "path": f"/bodies/{body}", "pose": pose})
        return commands

    def _body_matrix(self, body: int) -> NDArray[np.float64]:
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.data.xmat[body].reshape(3, 3), self.data.xpos[body]
        return matrix


def _ensure_forward(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Compute where the bodies are, in data that was only just made."""
    if not data.xmat[0].any():
        mujoco.mj_forward(model, data)


def _set_object(path: str, group: Group) -> dict[str, Any]:
    return {"type": "set_object", "path": path, "object": group.to_json()}
