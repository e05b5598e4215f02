"""``Scene3D``: any compiled MuJoCo scene in meshcat. Live, recorded, and as a still picture."""

from __future__ import annotations

import copy
import itertools
import time
import weakref
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import Any

# First: where MuJoCo does not load, its own error does not say what is missing.
from gvp_lib.simulation.camera import camera_intrinsics, camera_pose, renderer

# isort: split
import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.checks import checked, finite
from gvp_lib.errors import InvalidParameterError, UnknownNameError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.picture import count
from gvp_lib.views import drawing
from gvp_lib.views.drawing import Overlay, anchored_geoms, bounds, compose, draw_geoms, number_list
from gvp_lib.views.film import FILMS, write_film
from gvp_lib.views.page import SceneView, animation, write_page
from gvp_lib.views.server import SCRIPT, Channel, LiveServer

__all__ = ["Recording", "Scene3D"]

Command = dict[str, Any]
_LIVE_RATE = 40.0  # updates per second sent to a browser at most
_STATE = mujoco.mjtState.mjSTATE_QPOS | mujoco.mjtState.mjSTATE_MOCAP_POS | mujoco.mjtState.mjSTATE_MOCAP_QUAT
_TOP, _BOTTOM = np.array([251, 249, 245.0]), np.array([230, 223, 211.0])  # behind a still, as in the page's light theme
_numbers = itertools.count(1)


@checked
class Scene3D:
    """3D view of a MuJoCo scene: live, recorded, or as a still picture.

    Parameters
    ----------
    source
        Compiled ``mujoco.MjModel``, or any object with ``model`` and ``data``, such as a ``WorkCell``. If it also has
        ``watch(callback)`` and ``time``, live views and recordings follow its motions by themselves.
    data
        The model's ``MjData``, if ``source`` is a model; by default a new one.
    groups
        Geom groups to draw. By MuJoCo's convention, 3 and above hold collision shapes.
    title
        Caption, which also describes the view to readers who cannot see it.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> scene = Scene3D(WorkCell("floating"), title="a brick")
    >>> scene.look_from(azimuth=0.5)
    Scene3D('a brick', 2 bodies, 0 overlays)
    >>> scene.still(320, 240).shape
    (240, 320, 3)
    """

    def __init__(
        self, source: Any, data: mujoco.MjData | None = None, *, groups: Iterable[int] = (0, 1, 2), title: str = ""
    ) -> None:
        self._source, self._groups = source, tuple(groups)
        if isinstance(source, mujoco.MjModel):
            self._take(source, mujoco.MjData(source) if data is None else data)
        elif isinstance(getattr(source, "model", None), mujoco.MjModel) and data is None:
            self._take(source.model, source.data)
        else:
            raise InvalidParameterError(
                f"Scene3D shows a mujoco.MjModel with its MjData, or one object with .model and .data; got {source!r}"
            )
        self._overlays: dict[str, tuple[int, NDArray[np.float64], Overlay]] = {}
        self.title = title or "3D view of the scene"
        self._name = f"scene{next(_numbers)}"
        self._channel: Channel | None = None
        self._following = ExitStack()
        self._recording: Recording | None = None
        self._last_sent = 0.0
        # From the front left and somewhat above, so far away that the whole is in view.
        corners = bounds(self.model, self.data, itertools.chain(*self._geoms.values()))
        self._extent = 0.5 * float(np.linalg.norm(corners[1] - corners[0]))  # m
        self._camera = mujoco.MjvCamera()
        half_angle = 0.5 * np.radians(self.model.vis.global_.fovy)
        self.look_from(np.radians(-35), np.radians(22), 0.95 * self._extent / np.sin(half_angle), corners.mean(axis=0))

    def __repr__(self) -> str:
        return f"Scene3D({self.title!r}, {count(len(self._geoms), 'body')}, {count(len(self._overlays), 'overlay')})"

    # --- where to look from ------------------------------------------------------------------------------------

    def look_from(
        self,
        azimuth: float | None = None,
        elevation: float | None = None,
        distance: float | None = None,
        target: ArrayLike | None = None,
    ) -> Scene3D:
        """Place the eye, and return the scene, so that calls chain. What is not given stays.

        Parameters
        ----------
        azimuth
            Direction from the target to the eye, rad; 0 is the world's +x, pi/2 its +y.
        elevation
            Angle of the eye above the horizon, rad.
        distance
            Distance from the target, m.
        target
            Point to look at, world frame, shape (3,), m.
        """
        finite(azimuth=azimuth or 0, elevation=elevation or 0)
        finite((3,), target=(0, 0, 0) if target is None else target)
        if distance is not None and not 0 < distance < np.inf:
            raise InvalidParameterError(f"the distance to the target is positive, meters; got {distance}")
        # MuJoCo counts from the direction of sight, these angles from the eye's.
        if azimuth is not None:
            self._camera.azimuth = np.degrees(azimuth) + 180
        if elevation is not None:
            self._camera.elevation = -np.degrees(elevation)
        if distance is not None:
            self._camera.distance = distance
        if target is not None:
            self._camera.lookat = np.asarray(target, float)
        return self

    def _view(self) -> dict[str, Any]:
        """Where the eye is, as the page's player reads it."""
        camera = self._camera
        azimuth, elevation = np.radians((camera.azimuth, camera.elevation))
        level = np.cos(elevation)
        sight = np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
        return {
            "lookat": np.round(camera.lookat, 4).tolist(),
            "eye": np.round(camera.lookat - camera.distance * sight, 4).tolist(),
            "fovy": round(float(self.model.vis.global_.fovy), 3),
            "extent": round(self._extent, 4),
        }

    # --- overlays --------------------------------------------------------------------------------------------------

    def add_frustum(
        self,
        name: str,
        world_from_camera: RigidTransform | None = None,
        intrinsics: CameraIntrinsics | None = None,
        *,
        camera: str | None = None,
        depth: float = 0.15,
        image: NDArray[np.uint8] | None = None,
        color: tuple[float, float, float] = drawing.ORANGE,
    ) -> None:
        """Draw what a camera sees, as a pyramid, by its pose and intrinsics or as one of the model's cameras.

        Parameters
        ----------
        name
            Name of the overlay; an overlay of this name is replaced.
        world_from_camera
            Pose of the camera, optical frame.
        intrinsics
            Lens of the camera; by default that of ``camera``.
        camera
            Name of a camera of the model, whose frustum moves with it.
        depth
            Height of the pyramid, m.
        image
            RGB picture to show on its base, uint8 (H, W, 3).
        color
            RGB, each in [0, 1].
        """
        body, body_from_camera, model = 0, world_from_camera, self.model
        if camera is not None:
            index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, camera)
            if index < 0:
                raise UnknownNameError("camera", camera, (model.camera(i).name for i in range(model.ncam)))
            if intrinsics is None:
                width, height = (int(n) for n in model.cam_resolution[index])
                width, height = (640, 480) if width <= 1 else (width, height)  # MuJoCo's default is 1 x 1
                intrinsics = camera_intrinsics(model, index, width, height)
            body = int(model.body_weldid[model.cam_bodyid[index]])
            body_from_world = RigidTransform.from_matrix(_world_from(self.data, body)).inv()
            body_from_camera = body_from_world * camera_pose(self.data, index)
        if body_from_camera is None or intrinsics is None:
            raise InvalidParameterError("a frustum needs world_from_camera and intrinsics, or camera='a name'")
        self._add(name, drawing.frustum(intrinsics, depth, color, image), body, body_from_camera.as_matrix())

    def add_sphere(
        self,
        name: str,
        sphere: VirtualSphere,
        max_tilt: float = np.radians(30),
        color: tuple[float, float, float] = drawing.SKY,
    ) -> None:
        """Draw the cap of a virtual sphere.

        Parameters
        ----------
        name
            Name of the overlay; an overlay of this name is replaced.
        sphere
            Sphere, world frame.
        max_tilt
            Half the cap's angle, rad.
        color
            RGB, each in [0, 1].
        """
        self._add(name, drawing.sphere(sphere, max_tilt, color))

    def add_path(
        self,
        name: str,
        path: RigidTransform | ArrayLike,
        *,
        radius: float = 0.002,
        arrows: int = 24,
        color: tuple[float, float, float] = drawing.VERMILION,
    ) -> None:
        """Draw a path through points or poses.

        Parameters
        ----------
        name
            Name of the overlay; an overlay of this name is replaced.
        path
            Points, shape (n, 3), m, or poses, world frame.
        radius
            Radius of the line, m.
        arrows
            Number of poses at most whose +z axis is drawn.
        color
            RGB, each in [0, 1].
        """
        self._add(name, drawing.path(path, color, radius, arrows))

    def add_frame(self, name: str, world_from_frame: RigidTransform, size: float = 0.1) -> None:
        """Draw a frame's axes: x red, y green, z blue.

        Parameters
        ----------
        name
            Name of the overlay; an overlay of this name is replaced.
        world_from_frame
            Pose of the frame.
        size
            Length of the axes, m.
        """
        self._add(name, drawing.frame(size), 0, world_from_frame.as_matrix())

    def add_points(
        self,
        name: str,
        points: ArrayLike,
        *,
        radius: float = 0.004,
        color: tuple[float, float, float] = drawing.GREEN,
    ) -> None:
        """Draw points as small balls.

        Parameters
        ----------
        name
            Name of the overlay; an overlay of this name is replaced.
        points
            Points, world frame, shape (n, 3), m.
        radius
            Radius of the balls, m.
        color
            RGB, each in [0, 1].
        """
        self._add(name, drawing.points(points, color, radius))

    def remove(self, name: str) -> None:
        """Remove an overlay.

        Parameters
        ----------
        name
            Name under which it was added.
        """
        if name not in self._overlays:
            raise UnknownNameError("overlay", name, self._overlays)
        body, _, _ = self._overlays.pop(name)
        self._send([{"type": "delete", "path": f"/bodies/{body}/{name}"}])

    def _add(self, name: str, overlay: Overlay, body: int = 0, pose: NDArray[np.float64] | None = None) -> None:
        if not name or "/" in name:
            raise InvalidParameterError(f"an overlay's name is not empty and holds no '/'; got {name!r}")
        if name in self._overlays:
            self.remove(name)
        self._overlays[name] = (body, np.eye(4) if pose is None else pose, overlay)
        self._send(self._overlay_commands(name))

    # --- live ---------------------------------------------------------------------------------------------------

    def show(self, height: int = 420) -> SceneView:
        """Show the scene in a notebook's cell; while the notebook runs, the view follows the scene.

        The view follows a work cell by itself; for any other source call :meth:`update` after each change.

        Parameters
        ----------
        height
            Height of the view in a page, CSS pixels.
        """
        self._sync()
        server = LiveServer.shared()
        if self._channel is None:
            self._channel = Channel(self._live_page, self._commands)
            if hasattr(self._source, "watch"):
                self._following.enter_context(self._source.watch(self._follow))
        path = server.add(self._name, self._channel)
        return self._finished({"commands": self._commands()}, height, path)

    def update(self) -> None:
        """Send the bodies' current poses to every browser that shows this scene."""
        self._last_sent = time.monotonic()
        if not self._sync() and self._channel is not None and self._channel.listeners:
            self._send(self._pose_commands())

    def close(self) -> None:
        """Stop serving the live view and following the work cell."""
        self._following.close()
        if self._channel is not None:
            LiveServer.shared().channels.pop(self._name, None)
            self._channel = None

    def _live_page(self) -> str:
        return write_page({"commands": [], "view": self._view(), "live": True}, self.title, SCRIPT)

    def _follow(self) -> None:
        # Only where somebody looks: a book that is being built does not wait for an audience.
        if self._channel is not None and self._channel.listeners:
            time.sleep(max(0.0, self._last_sent + 1 / _LIVE_RATE - time.monotonic()))
            self.update()

    # --- recorded -----------------------------------------------------------------------------------------------

    @contextmanager
    def record(self, fps: float = 30.0, height: int = 420) -> Iterator[Recording]:
        """Record what moves inside the ``with`` block; the recording shows itself in a notebook.

        A source with ``watch`` is recorded as it moves; for any other call :meth:`capture_frame` at each step. Overlays
        that are added inside the block appear from the first frame on, so that what a motion finds can be drawn into
        it. The still picture shows the last frame. If no time passed, the recording is a plain scene.

        Parameters
        ----------
        fps
            Frames per simulated second at most; waypoints in between are dropped.
        height
            Height of the view in a page, CSS pixels.
        """
        if self._recording is not None:
            raise InvalidParameterError("this scene is being recorded already; leave that `with` block first")
        self._sync()
        recording = self._recording = Recording(self, fps)
        try:
            recording.capture(force=True)
            with self._source.watch(recording.capture) if hasattr(self._source, "watch") else nullcontext():
                yield recording
            recording.capture(force=True)
        finally:
            self._recording = None
        payload: dict[str, Any] = {"commands": self._commands()}
        if len(recording) > 1:
            payload["animation"] = recording.animation()
        # Served as long as the view exists: the page is made of the payload, or the view could never go.
        server, name = LiveServer.shared(), f"recording{next(_numbers)}"
        path = server.add(name, Channel(partial(write_page, payload, self.title, SCRIPT), list))
        recording._finish(self._finished(payload, height, path))
        weakref.finalize(recording.view, server.channels.pop, name, None)

    def capture_frame(self, time: float | None = None) -> None:
        """Add the bodies' current poses to the recording.

        Parameters
        ----------
        time
            Simulated time of the frame, s; by default the source's. Frames closer than ``1 / fps`` are then dropped.
        """
        if self._recording is None:
            raise InvalidParameterError("no recording runs; capture frames inside `with scene.record() as recording:`")
        self._recording.capture(time, force=time is not None)

    # --- still ----------------------------------------------------------------------------------------------------

    def still(self, width: int = 840, height: int = 420) -> NDArray[np.uint8]:
        """Picture of the same view, rendered by MuJoCo, RGB uint8 (height, width, 3).

        Parameters
        ----------
        width, height
            Size of the picture, px.
        """
        self._sync()
        (picture,) = self._pictures([self.data], width, height)
        return picture

    def _pictures(self, states: Iterable[mujoco.MjData], width: int, height: int) -> Iterator[NDArray[np.uint8]]:
        option = mujoco.MjvOption()
        option.geomgroup[:] = 0
        option.geomgroup[list(self._groups)] = 1
        gradient = _TOP + (_BOTTOM - _TOP) * np.linspace(0, 1, height)[:, None, None]
        with renderer(self.model, width, height, shadows=True, samples=4) as made:
            for data in states:
                made.update_scene(data, self._camera, option)
                for body, pose, overlay in self._overlays.values():
                    overlay.draw(made.scene, _world_from(data, body) @ pose)
                picture = made.render()
                made.enable_segmentation_rendering()
                nothing = made.render()[..., :1] < 0
                made.disable_segmentation_rendering()
                yield np.where(nothing, gradient, picture).round().astype(np.uint8)

    # --- the scene as commands -----------------------------------------------------------------------------------

    def _take(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self.model, self.data = model, data
        if not data.xmat[0].any():  # only just made: nobody has computed yet where the bodies are
            mujoco.mj_forward(model, data)
        self._geoms = anchored_geoms(model, self._groups)

    def _sync(self) -> bool:
        """Take over the source's model where it was compiled anew (a work cell that was reset); True if it was."""
        if getattr(self._source, "model", self.model) is self.model:
            self.data = getattr(self._source, "data", self.data)
            return False
        self._take(self._source.model, self._source.data)
        self._send([{"type": "delete", "path": "/bodies"}, *self._commands()])
        return True

    def _send(self, commands: list[Command]) -> None:
        if self._channel is not None:
            self._channel.send(commands)

    def _finished(self, payload: dict[str, Any], height: int, path: str) -> SceneView:
        payload["view"] = self._view()
        return SceneView(payload, self.still(2 * height, height), self.title, height, path, LiveServer.shared().port)

    def _commands(self) -> list[Command]:
        commands: list[Command] = []
        for body, geoms in self._geoms.items():
            drawn = draw_geoms(self.model, self.data, body, geoms).to_json()
            commands.append({"type": "set_object", "path": f"/bodies/{body}", "object": drawn})
        for name in self._overlays:
            commands += self._overlay_commands(name)
        return commands + self._pose_commands()

    def _overlay_commands(self, name: str) -> list[Command]:
        body, pose, overlay = self._overlays[name]
        path = f"/bodies/{body}/{name}"
        return [
            {"type": "set_object", "path": path, "object": overlay.to_json()},
            {"type": "set_transform", "path": path, "matrix": number_list(pose.T, 6)},
        ]

    def _moving(self) -> list[int]:
        return sorted({*self._geoms, *(body for body, _, _ in self._overlays.values())} - {0})

    def _poses(self, bodies: list[int]) -> NDArray[np.float64]:
        """World positions, m, and quaternions x, y, z, w of bodies, shape (n, 7)."""
        return np.hstack([self.data.xpos[bodies], self.data.xquat[bodies][:, [1, 2, 3, 0]]])

    def _pose_commands(self) -> list[Command]:
        bodies = self._moving()
        poses = zip(bodies, self._poses(bodies), strict=True)
        return [{"type": "pose", "path": f"/bodies/{body}", "pose": number_list(pose)} for body, pose in poses]


@checked
class Recording:
    """Frames of a moving scene, made by :meth:`Scene3D.record`; shows itself in a notebook.

    Parameters
    ----------
    scene
        Scene to record.
    fps
        Frames per simulated second at most.

    Attributes
    ----------
    times
        Simulated time of each frame, s.
    """

    def __init__(self, scene: Scene3D, fps: float) -> None:
        if not fps > 0:
            raise InvalidParameterError(f"fps is positive, frames per simulated second; got {fps}")
        self._scene, self._fps, self._bodies = scene, fps, scene._moving()
        self.times: list[float] = []
        self._poses: list[NDArray[np.float64]] = []  # (bodies, 7) in each frame
        self._states: list[NDArray[np.float64]] = []  # MuJoCo's, of which a film is drawn
        self._view: SceneView | None = None

    def __len__(self) -> int:
        return len(self.times)

    def __repr__(self) -> str:
        seconds = self.times[-1] - self.times[0] if self.times else 0.0
        return f"Recording({count(len(self), 'frame')} over {seconds:.1f} s)"

    def capture(self, time: float | None = None, force: bool = False) -> None:
        """Take a frame, unless the last one is less than ``1 / fps`` old.

        Parameters
        ----------
        time
            Simulated time of the frame, s; by default the source's.
        force
            Whether to take the frame in any case, if any time passed.
        """
        now = float(getattr(self._scene._source, "time", self._scene.data.time) if time is None else time)
        finite(time=now)
        if self.times and now - self.times[-1] < (1e-3 if force else 1 / self._fps - 1e-6):
            return
        if self._scene._sync():
            raise InvalidParameterError("the scene was rebuilt while it was recorded; reset before scene.record()")
        self.times.append(now)
        self._poses.append(self._scene._poses(self._bodies))
        state = np.empty(mujoco.mj_stateSize(self._scene.model, _STATE))
        mujoco.mj_getState(self._scene.model, self._scene.data, state, _STATE)
        self._states.append(state)

    def animation(self) -> dict[str, Any]:
        """Frames as the page's player reads them: integers, each the difference from the previous frame.

        Bodies that stood still are left out.
        """
        poses = np.stack(self._poses, axis=1)  # (bodies, frames, 7)
        return animation(self.times, {f"/bodies/{body}": each for body, each in zip(self._bodies, poses, strict=True)})

    @property
    def view(self) -> SceneView:
        """View of the finished recording."""
        if self._view is None:
            raise InvalidParameterError("the recording is not finished; leave the `with` block first")
        return self._view

    def save(self, path: str | Path) -> Path:
        """Write the recording as a page or a film, by the path's ending.

        Parameters
        ----------
        path
            File to write: ``.html``, a page that holds all it needs; ``.mp4`` or ``.gif``, a film, seen from where the
            page begins; ``.png``, the still picture.

        Raises
        ------
        InvalidParameterError
            The path has another ending.
        """
        view, path = self.view, Path(path)
        if path.suffix.lower() not in FILMS:
            return view.save(path)
        write_film(path, self.times, self._fps, self._pictures)
        return path

    def _finish(self, view: SceneView) -> None:
        # The scene may yet be turned, drawn over or compiled anew; a film shows what the page does.
        self._view, self._scene = view, copy.copy(self._scene)
        self._scene._camera, self._scene._overlays = copy.copy(self._scene._camera), dict(self._scene._overlays)

    def _pictures(self, frames: Iterable[int]) -> Iterator[NDArray[np.uint8]]:
        """Pictures of frames, as large as the still."""
        height, width, _ = self.view.still.shape

        def states() -> Iterator[mujoco.MjData]:
            model, data = self._scene.model, mujoco.MjData(self._scene.model)
            for frame in frames:
                mujoco.mj_setState(model, data, self._states[frame], _STATE)
                mujoco.mj_fwdPosition(model, data)
                yield data

        return self._scene._pictures(states(), width, height)

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, Any]:
        return self.view._repr_mimebundle_()


def _world_from(data: mujoco.MjData, body: int) -> NDArray[np.float64]:
    return compose(data.xpos[body], data.xmat[body])
