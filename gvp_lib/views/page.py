"""A 3D scene as a web page, and as the output of a notebook cell.

A page is small: the scene and its recording as JSON, and our player. Beside it, once for all pages, lies meshcat's
script, copied from the installed ``meshcat``. Nothing is fetched from a network, so a page works from ``file://``.

In a notebook a view leaves three things: HTML for a running Jupyter (an ``<iframe>`` on the live server), the
scene itself under :data:`SCENE_MIME`, from which the book makes its page, and a still picture for every other
reader. The book's script drops the first before a notebook is stored, since a server's address means nothing later.
"""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from importlib import resources
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["SCENE_MIME", "SceneView", "meshcat_script", "pack_animation", "png", "to_text", "write_page"]

SCENE_MIME = "application/vnd.gvp.scene+json"
_STEPS = 1e-4, 1e-4
"""Steps in which a recording counts positions and quaternions: 0.1 mm, and 0.01 deg."""


def meshcat_script() -> Path:
    """meshcat's viewer script in the installed package."""
    found = find_spec("meshcat")  # finds without importing: its package brings a second server's machinery
    if found is None or not found.submodule_search_locations:
        raise ImportError("3D views need meshcat; install the extra: pip install 'gvp_lib[notebooks]'")
    return Path(found.submodule_search_locations[0]) / "viewer" / "dist" / "main.min.js"


def to_text(data: Any) -> str:
    """Compact JSON."""
    return json.dumps(data, separators=(",", ":"))


def png(pixels: NDArray[np.uint8]) -> str:
    """Gray, RGB or RGBA pixels, uint8, as a PNG in base 64."""
    if pixels.ndim == 3 and pixels.shape[2] >= 3:
        code = cv2.COLOR_RGBA2BGRA if pixels.shape[2] == 4 else cv2.COLOR_RGB2BGR
        pixels = np.asarray(cv2.cvtColor(pixels, code), np.uint8)
    _, encoded = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return base64.b64encode(encoded.tobytes()).decode()


def pack_animation(times: list[float], poses: Mapping[str, NDArray[np.float64]]) -> dict[str, Any]:
    """A recording as the page's player reads it: whole numbers, each as the difference from the frame before.

    Parameters
    ----------
    times
        Time of each of the n frames, s, rising.
    poses
        By the path of a body: world position, m, and quaternion x, y, z, w, shape (n, 7). A body that stood still is
        left out.
    """
    tracks = []
    for path, pose in poses.items():
        positions, quaternions = pose[:, :3], pose[:, 3:].copy()
        # q and -q are one rotation; choose the signs so that neighbors interpolate the short way.
        flips = np.cumprod(np.where((quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0, -1, 1))
        quaternions[1:] *= flips[:, None]
        track: dict[str, Any] = {"path": path}
        for name, values, step in zip("pq", (positions, quaternions), _STEPS, strict=True):
            counts = np.rint(values / step).astype(int)
            if np.any(counts != counts[0]):
                track[name] = np.diff(counts, axis=0, prepend=0).ravel().tolist()
        if len(track) > 1:
            tracks.append(track)
    milliseconds = [round(1000 * (time - times[0])) for time in times]
    return {"times": milliseconds, "steps": list(_STEPS), "tracks": tracks}


@dataclass(frozen=True)
class SceneView:
    """One view of a scene, ready to be shown: a snapshot, a recording, or a live one.

    The last expression of a notebook's cell shows itself; :meth:`save` writes a page of its own.

    Attributes
    ----------
    payload
        What the page's player reads: commands, camera, animation.
    still
        RGB picture of the same view, shape (height, width, 3).
    title
        What is to be seen, for readers who cannot see it.
    height
        Height of the view in a page, CSS pixels.
    live_path, port
        Address at which the running process serves it, for a Jupyter that is open now.
    """

    payload: dict[str, Any]
    still: NDArray[np.uint8]
    title: str
    height: int
    live_path: str
    port: int

    def save(self, path: str | Path) -> Path:
        """Write the page, and meshcat's script beside it as ``meshcat.min.js``; works from ``file://``."""
        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(self.page(), encoding="utf-8")
        script = path.parent / "meshcat.min.js"
        if not script.exists() or script.stat().st_size != meshcat_script().stat().st_size:
            script.write_bytes(meshcat_script().read_bytes())
        return path

    def page(self, script: str = "meshcat.min.js") -> str:
        """The page's HTML; ``script`` is where meshcat's script lies, relative to it."""
        return write_page(self.payload, self.title, script)

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, Any]:
        scene = gzip.compress(to_text(self.payload).encode(), 9, mtime=0)
        live = {"HEIGHT": str(self.height), "TITLE": escape(self.title)}
        return {
            "text/plain": f"<3D view: {self.title}>",
            "image/png": png(self.still),
            "text/html": _filled("live.html", PATH=json.dumps(self.live_path), PORT=str(self.port), **live),
            SCENE_MIME: {"title": self.title, "height": self.height, "scene": base64.b64encode(scene).decode()},
        }


def write_page(payload: dict[str, Any], title: str, script: str = "meshcat.min.js") -> str:
    """The HTML of a scene's page; ``payload`` as in :class:`SceneView`, ``script`` as in :meth:`SceneView.page`."""
    parts = {"TITLE": escape(title), "STYLE": _asset("scene.css"), "SCRIPT": escape(script)}
    # "</" would end the element that holds the JSON.
    return _filled("scene.html", **parts, PLAYER=_asset("scene.js"), PAYLOAD=to_text(payload).replace("</", "<\\/"))


def _asset(name: str) -> str:
    return (resources.files("gvp_lib.views") / "page" / name).read_text(encoding="utf-8")


def _filled(template: str, **values: str) -> str:
    text = _asset(template)
    for name, value in values.items():
        text = text.replace(f"@{name}@", value)
    return text
