"""A 3D scene as a web page, and as the output of a notebook cell.

A page holds the scene and its recording as JSON, our player, and the script of the installed ``meshcat``, which is most
of its size: pages that stay together, such as a book's, share one that lies beside them. Nothing is fetched from a
network, so a page works from ``file://``.

In a notebook a view leaves three things: HTML for a running Jupyter (an ``<iframe>`` on the live server), the
scene itself under :data:`SCENE_MIME`, from which the book makes its page, and a still picture for every other
reader. The book's script drops the first before a notebook is stored, since a server's address means nothing later.
"""

from __future__ import annotations

import base64
import gzip
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib import resources
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gvp_lib.errors import InvalidParameterError, MissingExtraError

__all__ = ["LAB_MIME", "SCENE_MIME", "SceneView", "animation", "meshcat_script", "png", "to_text", "write_page"]

SCENE_MIME, LAB_MIME = "application/vnd.gvp.scene+json", "application/vnd.gvp.lab+json"
_STEP = 1e-4  # in which a recording counts positions and quaternions: 0.1 mm, and 0.01 deg


def meshcat_script() -> Path:
    """Path of the viewer's script in the installed meshcat."""
    found = find_spec("meshcat")  # finds without importing: its package brings a second server's machinery
    if found is None or not found.submodule_search_locations:
        raise MissingExtraError("a 3D view", "meshcat", "notebooks")
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


@dataclass(frozen=True)
class SceneView:
    """View of a scene that shows itself in a notebook: a snapshot, a recording, or a live one.

    Attributes
    ----------
    payload
        What the page's player reads: commands, camera, animation.
    still
        RGB picture of the same view, shape (height, width, 3).
    title
        Caption, which also describes the view to readers who cannot see it.
    height
        Height in a page, CSS pixels.
    live_path, port
        Address at which this process serves the view while it runs.
    """

    payload: dict[str, Any]
    still: NDArray[np.uint8]
    title: str
    height: int
    live_path: str
    port: int

    def __repr__(self) -> str:
        return f"SceneView({self.title!r}, {self.height} px high)"

    def save(self, path: str | Path) -> Path:
        """Write a page that holds all it needs, or the still picture.

        Parameters
        ----------
        path
            File to write: ``.html``, or ``.png``.
        """
        path = Path(path)
        if path.suffix.lower() not in (".html", ".png"):
            raise InvalidParameterError(
                "a view is saved as .html, a page to turn and play, or as .png, its still picture; a recording also "
                f"as .mp4 or .gif; got {str(path)!r}"
            )
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(self.page().encode() if path.suffix.lower() == ".html" else base64.b64decode(png(self.still)))
        return path

    def page(self) -> str:
        """HTML of the page."""
        return write_page(self.payload, self.title)

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, Any]:
        scene = gzip.compress(to_text(self.payload).encode(), 9, mtime=0)
        live = {"HEIGHT": str(self.height), "TITLE": escape(self.title)}
        return {
            "text/plain": f"<3D view: {self.title}>",
            "image/png": png(self.still),
            "text/html": filled("live.html", PATH=json.dumps(self.live_path), PORT=str(self.port), **live),
            SCENE_MIME: {"title": self.title, "height": self.height, "scene": base64.b64encode(scene).decode()},
        }


def write_page(payload: dict[str, Any], title: str, script: str | None = None) -> str:
    """HTML of a scene's page; ``script`` is where meshcat's script lies, relative to it, if not in the page itself."""
    if script is None:
        meshcat = f"<script>\n{meshcat_script().read_text(encoding='utf-8')}\n</script>"
    else:
        meshcat = f'<script src="{escape(script)}"></script>'
    parts = {
        "TITLE": escape(title),
        "STYLE": page_asset("scene.css"),
        "MESHCAT": meshcat,
        "PLAYER": page_asset("scene.js"),
    }
    # "</" would end the element that holds the JSON.
    return filled("scene.html", **parts, PAYLOAD=to_text(payload).replace("</", "<\\/"))


def page_asset(name: str) -> str:
    """Text of a file of the pages'."""
    return (resources.files("gvp_lib.views") / "page" / name).read_text(encoding="utf-8")


def filled(template: str, **values: str) -> str:
    """A template, with values in the places of their names."""
    return re.sub("@([A-Z]+)@", lambda name: values[name[1]], page_asset(template))


def animation(times: Sequence[float], poses: Mapping[str, NDArray[np.float64]]) -> dict[str, Any]:
    """Frames as the page's player reads them: integers, each the difference from the previous frame.

    ``poses`` has the positions, m, and quaternions of each object by its path, shape (frames, 7); ``times`` are in s.
    Objects that stood still are left out.
    """
    tracks = []
    for path, each in poses.items():
        positions, quaternions = each[:, :3], each[:, 3:]
        # q and -q are one rotation; choose the signs so that neighbors interpolate the short way.
        flips = np.cumprod(np.where((quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0, -1, 1))
        quaternions[1:] *= flips[:, None]
        track: dict[str, Any] = {"path": path}
        for name, values in (("p", positions), ("q", quaternions)):
            counts = np.rint(values / _STEP).astype(int)
            if np.any(counts != counts[0]):
                track[name] = np.diff(counts, axis=0, prepend=0).ravel().tolist()
        if len(track) > 1:
            tracks.append(track)
    milliseconds = [round(1000 * (time - times[0])) for time in times]
    return {"times": milliseconds, "steps": [_STEP, _STEP], "tracks": tracks}
