"""``Scene3D``: any compiled MuJoCo scene in meshcat. Live, recorded, and as a still picture."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvp_lib.errors import InvalidParameterError
from gvp_lib.views.bodies import bounds
from gvp_lib.views.page import SceneView, write_page
from gvp_lib.views.recording import Recording
from gvp_lib.views.scene_graph import SceneGraph
from gvp_lib.views.server import Channel, LiveServer
from gvp_lib.views.stills import View, render_still

__all__ = ["Recording", "Scene3D"]

_LIVE_RATE = 40.0  # updates per second sent to a browser at most
_names = itertools.count(1)


class Scene3D(SceneGraph):
    """A 3D view of a MuJoCo scene.

    Parameters
    ----------
    source
        A compiled ``mujoco.MjModel``, or any object with ``model`` and ``data``, such as a ``WorkCell``. Where it
        also has ``watch(callback)`` and ``time``, live views and recordings follow its motions by themselves.
    data
        The model's ``MjData``; only beside an ``MjModel``.
    groups
        The geom groups to draw. By MuJoCo's custom, 3 and above hold collision shapes.
    title
        What is to be seen: the caption for readers who cannot see it.
    """

    def __init__(
        self, source: Any, data: mujoco.MjData | None = None, *, groups: Iterable[int] = (0, 1, 2), title: str = ""
    ) -> None:
        super().__init__(source, data, groups)
        self.title = title or "3D view of the scene"
        self._view = View.of(bounds(self.model, self.data, itertools.chain(*self._geoms.values())), self.model)
        self._name = f"scene{next(_names)}"
        self._channel: Channel | None = None
        self._following: AbstractContextManager[Any] | None = None
        self._recording: Recording | None = None
        self._last_sent = 0.0

    # --- where to look from ------------------------------------------------------------------------------------

    def look_from(
        self,
        azimuth: float | None = None,
        elevation: float | None = None,
        distance: float | None = None,
        target: ArrayLike | None = None,
    ) -> Scene3D:
        """Place the eye; what is not given stays. Returns the scene, so that calls chain.

        Parameters
        ----------
        azimuth
            Direction from the target to the eye, rad; 0 is the world's +x, pi/2 its +y.
        elevation
            Of the eye above the horizon, rad.
        distance
            From the target, meters.
        target
            World point looked at, shape (3,), meters.
        """
        self._view = self._view.moved(azimuth, elevation, distance, target)
        return self

    # --- live ---------------------------------------------------------------------------------------------------

    def show(self, height: int = 420) -> SceneView:
        """The scene as it stands, for a notebook's cell; in a running notebook it goes on to follow the scene.

        A work cell's motions are followed by themselves; after anything else, call :meth:`update`.
        """
        self._sync()
        if self._channel is None:
            self._channel = Channel(self._live_page, self._commands)
        path = LiveServer.shared().add(self._name, self._channel)
        watch = getattr(self._source, "watch", None)
        if watch is not None and self._following is None:
            self._following = watch(self._follow)
            self._following.__enter__()
        return self._finished({"commands": self._commands()}, height, path)

    def update(self) -> None:
        """Send the bodies' present poses to the browsers that look at this scene."""
        self._last_sent = time.monotonic()
        if self._sync():
            return
        if self._channel is not None and self._channel.watched:
            self._channel.send(self._pose_commands())

    def close(self) -> None:
        """Stop serving the live view and following the work cell."""
        if self._following is not None:
            self._following.__exit__(None, None, None)
            self._following = None
        if self._channel is not None:
            LiveServer.shared().remove(self._name)
            self._channel = None

    def _live_page(self) -> str:
        payload = {"commands": [], "view": self._view.to_json(), "live": True}
        return write_page(payload, self.title, "meshcat.min.js")

    def _follow(self) -> None:
        # Only where somebody looks: a book that is being built does not wait for an audience.
        if self._channel is not None and self._channel.watched:
            pause = self._last_sent + 1 / _LIVE_RATE - time.monotonic()
            if pause > 0:
                time.sleep(pause)
            self.update()

    # --- recorded -----------------------------------------------------------------------------------------------

    @contextmanager
    def record(self, source: Any = None, fps: float = 30.0, height: int = 420) -> Iterator[Recording]:
        """Record what moves inside the ``with`` block; the result shows itself in a notebook.

        Overlays that are added inside the block are in the recording from its first frame on.

        Parameters
        ----------
        source
            An object with ``watch(callback)`` and ``time`` in simulated seconds; by default what this scene was
            made of. Without ``watch``, call :meth:`capture_frame` at each step.
        fps
            Frames per simulated second at most; more waypoints than that are thinned.
        height
            Of the view in a page, CSS pixels.
        """
        if self._recording is not None:
            raise InvalidParameterError("this scene is being recorded already; leave that `with` block first")
        self._sync()
        source = self._source if source is None else source
        watch: Callable[[Callable[[], None]], AbstractContextManager[Any]] | None = getattr(source, "watch", None)
        recording = Recording(self, source, fps, height)
        self._recording = recording
        try:
            recording.capture(force=True)
            if watch is None:
                yield recording
            else:
                with watch(recording.capture):
                    yield recording
            recording.capture(force=True)
        finally:
            self._recording = None
        recording.finish()

    def capture_frame(self, time: float | None = None) -> None:
        """Add the bodies' present poses to the recording, at ``time`` simulated seconds (default: the data's)."""
        if self._recording is None:
            raise InvalidParameterError("no recording runs; capture frames inside `with scene.record() as recording:`")
        self._recording.capture(time, force=time is not None)

    # --- still ----------------------------------------------------------------------------------------------------

    def still(self, width: int = 840, height: int = 420) -> NDArray[np.uint8]:
        """An RGB picture of the same view, rendered by MuJoCo, shape (height, width, 3)."""
        self._sync()
        rods = []
        for body, pose, overlay in self._overlays.values():
            world = self._body_matrix(body) @ pose
            rods.append((overlay.rods @ world[:3, :3].T + world[:3, 3], overlay.colors, overlay.radius))
        return render_still(self.model, self.data, self._view, self._groups, rods, width, height)

    def _send(self, commands: list[dict[str, Any]]) -> None:
        if self._channel is not None:
            self._channel.send(commands)

    def _finished(self, payload: dict[str, Any], height: int, path: str) -> SceneView:
        payload["view"] = self._view.to_json()
        return SceneView(payload, self.still(2 * height, height), self.title, height, path, LiveServer.shared().port)
