"""Recordings of a scene in motion."""

from __future__ import annotations

import itertools
import weakref
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gvp_lib.errors import InvalidParameterError
from gvp_lib.views.page import SceneView, Track, pack_animation, write_page
from gvp_lib.views.server import Channel, LiveServer

if TYPE_CHECKING:
    from gvp_lib.views.scene3d import Scene3D

__all__ = ["Recording"]

_numbers = itertools.count(1)


class Recording:
    """Frames of a scene in motion, made by :meth:`Scene3D.record`. Shows itself in a notebook.

    Attributes
    ----------
    times
        Simulated seconds of each frame.
    """

    def __init__(self, scene: Scene3D, source: Any, fps: float, height: int) -> None:
        if not fps > 0:
            raise InvalidParameterError(f"fps is positive, frames per simulated second; got {fps}")
        self._scene, self._source, self._fps, self._height = scene, source, fps, height
        self.times: list[float] = []
        self._bodies = [body for body in scene._bodies() if body != 0]
        self._tracks = [Track(f"/bodies/{body}") for body in self._bodies]
        self._view: SceneView | None = None

    def __len__(self) -> int:
        return len(self.times)

    def capture(self, time: float | None = None, force: bool = False) -> None:
        """Take a frame, unless the last one is nearer than 1 / fps."""
        now = float(getattr(self._source, "time", self._scene.data.time) if time is None else time)
        if self.times and now - self.times[-1] < (1e-3 if force else 1 / self._fps - 1e-6):
            return
        if self._scene._sync():
            raise InvalidParameterError("the scene was rebuilt while it was recorded; reset before scene.record()")
        self.times.append(now)
        data = self._scene.data
        for body, track in zip(self._bodies, self._tracks, strict=True):
            track.positions.append(data.xpos[body].copy())
            track.quaternions.append(data.xquat[body][[1, 2, 3, 0]])

    def finish(self) -> None:
        """Close the recording; the still shows its last frame. Where no time passed, it is a plain scene.

        Its overlays are those that the scene has now, so that what a motion finds can be drawn into its recording. It
        is served for as long as the view exists.
        """
        payload: dict[str, Any] = {"commands": self._scene._commands()}
        if len(self.times) > 1:
            payload["animation"] = pack_animation(self.times, self._tracks)
        # Of the payload and not of the view, which could otherwise never go.
        page = partial(write_page, payload, self._scene.title, "meshcat.min.js")
        server, name = LiveServer.shared(), f"{self._scene._name}-{next(_numbers)}"
        path = server.add(name, Channel(page, list))
        self._view = self._scene._finished(payload, self._height, path)
        weakref.finalize(self._view, server.remove, name)

    @property
    def view(self) -> SceneView:
        """The finished recording."""
        if self._view is None:
            raise InvalidParameterError("the recording is not finished; leave the `with` block first")
        return self._view

    def page(self) -> str:
        """The HTML of its page."""
        return self.view.page()

    def save(self, path: str | Path) -> Path:
        """Write its page, and meshcat's script beside it; see :meth:`SceneView.save`."""
        return self.view.save(path)

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, Any]:
        return self.view._repr_mimebundle_()
