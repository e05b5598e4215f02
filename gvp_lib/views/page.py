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
import html
import json
from dataclasses import dataclass, field
from importlib import resources
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["SCENE_MIME", "SceneView", "Track", "meshcat_script", "pack_animation", "write_page"]

SCENE_MIME = "application/vnd.gvp.scene+json"
_POSITION, _QUATERNION = 1e-4, 1e-4
"""Steps in which a recording counts: 0.1 mm, and 0.01 deg."""


def meshcat_script() -> Path:
    """meshcat's viewer script in the installed package."""
    found = find_spec("meshcat")  # finds without importing: its package brings a second server's machinery
    if found is None or not found.submodule_search_locations:
        raise ImportError("3D views need meshcat; install the extra: pip install 'gvp_lib[notebooks]'")
    return Path(found.submodule_search_locations[0]) / "viewer" / "dist" / "main.min.js"


def _asset(name: str) -> str:
    return (resources.files("gvp_lib.views") / "page" / name).read_text(encoding="utf-8")


@dataclass
class Track:
    """The recorded poses of one body: world positions (n, 3), m, and quaternions x, y, z, w (n, 4)."""

    path: str
    positions: list[NDArray[np.float64]] = field(default_factory=list)
    quaternions: list[NDArray[np.float64]] = field(default_factory=list)

    def pack(self) -> dict[str, Any] | None:
        """Whole numbers, each as the difference from the frame before; None for a body that stood still."""
        positions, quaternions = np.array(self.positions), np.array(self.quaternions)
        # q and -q are one rotation; choose the signs so that neighbors interpolate the short way.
        flips = np.cumprod(np.where((quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0, -1, 1))
        quaternions[1:] *= flips[:, None]
        packed: dict[str, Any] = {"path": self.path}
        for name, values, step in (("p", positions, _POSITION), ("q", quaternions, _QUATERNION)):
            counts = np.rint(values / step).astype(int)
            if np.any(counts != counts[0]):
                packed[name] = np.diff(counts, axis=0, prepend=0).ravel().tolist()
        return packed if len(packed) > 1 else None


def pack_animation(times: list[float], tracks: list[Track]) -> dict[str, Any]:
    """A recording as the page's player reads it; ``times`` in s, rising."""
    packed = [track.pack() for track in tracks]
    return {
        "times": [round(1000 * (time - times[0])) for time in times],  # ms
        "steps": [_POSITION, _QUATERNION],
        "tracks": [track for track in packed if track is not None],
    }


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
        Says what is to be seen, for readers who cannot see it.
    height
        Of the view in a page, CSS pixels.
    live_path, port
        Where the running process serves it, for a Jupyter that is open now.
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
        scene = gzip.compress(json.dumps(self.payload, separators=(",", ":")).encode(), 9, mtime=0)
        return {
            "text/plain": f"<3D view: {self.title}>",
            "image/png": base64.b64encode(_png(self.still)).decode(),
            "text/html": self._live_html(),
            SCENE_MIME: {"title": self.title, "height": self.height, "scene": base64.b64encode(scene).decode()},
        }

    def _live_html(self) -> str:
        """An iframe on the live server, however this notebook's browser reaches it."""
        replace = {"PATH": json.dumps(self.live_path), "PORT": str(self.port)}
        replace |= {"HEIGHT": str(self.height), "TITLE": html.escape(self.title, quote=True)}
        text = _asset("live.html")
        for name, value in replace.items():
            text = text.replace(f"@{name}@", value)
        return text


def write_page(payload: dict[str, Any], title: str, script: str) -> str:
    """The HTML of a scene's page.

    Parameters
    ----------
    payload
        As in :class:`SceneView`.
    title
        Of the page.
    script
        Address of meshcat's script, relative to the page.
    """
    # "</" would end the element that holds the JSON.
    data = json.dumps(payload, separators=(",", ":")).replace("</", "<\\/")
    parts = {"TITLE": html.escape(title), "STYLE": _asset("scene.css"), "SCRIPT": html.escape(script, quote=True)}
    text = _asset("scene.html")
    for name, value in (parts | {"PLAYER": _asset("scene.js"), "PAYLOAD": data}).items():
        text = text.replace(f"@{name}@", value)
    return text


def _png(rgb: NDArray[np.uint8]) -> bytes:
    _, png = cv2.imencode(".png", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return png.tobytes()
