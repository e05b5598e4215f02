"""``Lab``: a work cell in a page that moves by itself, without kernel, server or network.

In the page MuJoCo moves the arm (:mod:`gvp_lib.views.wasm`), three.js draws what the camera in its hand sees, and
scripts named after the library's rooms find the object in it, sweep its arcs, plan and grasp. What they compute is what
the library computes; nobody there sees the truth, either, but the reader who asks for it.
"""

from __future__ import annotations

import base64
import gzip
import itertools
from collections.abc import Mapping
from dataclasses import asdict
from html import escape
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError
from gvp_lib.perception.segmentation import HsvThreshold
from gvp_lib.simulation.drives import servos_of
from gvp_lib.simulation.scene import ARM_PREFIX, TARGET
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.workcell import WorkCell
from gvp_lib.views.page import LAB_MIME, filled, meshcat_script, page_asset, png, to_text
from gvp_lib.views.scene3d import Scene3D
from gvp_lib.views.server import Channel, LiveServer
from gvp_lib.views.wasm import mujoco_script

__all__ = ["Lab"]

SCRIPTS = "geometry", "perception", "simulation", "motion", "planning", "grasp", "pictures", "lab"
"""Of the page, each of which uses those before it."""

_numbers = itertools.count(1)
_SMALL = 1e-15  # relative: what text and compiler make of a number that they mean to keep
_BOUNDS, _LOOSE = ("bvh_aabb",), 1e-5  # which only say where contacts are looked for; m, that they may be off


@checked
class Lab:
    """Laboratory in a page: one work cell, or several to choose from.

    A reader flies the camera over its sphere, sees mask, ellipse and ratio change, sweeps arcs, follows the thesis's
    planner step by step, and closes the fingers. It shows itself in a notebook and in the book, and as a file of its
    own it can be mailed.

    Parameters
    ----------
    cells
        Work cell, or several by their names. Each has an arm, and its object is found by an
        :class:`~gvp_lib.perception.HsvThreshold`. The arm begins where it stands now.
    title
        Caption, which also describes the laboratory to readers who cannot see it.
    height
        Height in a page, CSS pixels.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> Lab(WorkCell("baxter", "cuboid_1x2", seed=7))
    Lab('A laboratory', baxter, cuboid_1x2 flat)
    """

    def __init__(
        self, cells: WorkCell | Mapping[str, WorkCell], *, title: str = "A laboratory", height: int = 900
    ) -> None:
        named = {_name(cells): cells} if isinstance(cells, WorkCell) else dict(cells)
        if not named:
            raise InvalidParameterError("a laboratory has one work cell or more; got none")
        self.title, self.height = title, height
        self._scenes = {name: _scene(cell) for name, cell in named.items()}
        self.still = _overview(next(iter(named.values()))).still(840, 420)
        """Picture of the first cell, for who cannot or will not start it, RGB uint8 (H, W, 3)."""
        self._name = f"lab{next(_numbers)}"

    def __repr__(self) -> str:
        names = list(self._scenes)
        more = f" and {len(names) - 1} more" if len(names) > 1 else ""
        return f"Lab({self.title!r}, {names[0]}{more})"

    @property
    def payload(self) -> dict[str, Any]:
        """What the page's scripts read."""
        noises = {"none": asdict(Noise.none()), "thesis": asdict(Noise.thesis())}
        return {"title": self.title, "noises": noises, "scenes": self._scenes}

    def page(self) -> str:
        """HTML of a page that holds all it needs."""
        return write_lab(self.payload)

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, Any]:
        server = LiveServer.shared()
        path = server.add(self._name, Channel(self.page, list))
        packed = base64.b64encode(gzip.compress(to_text(self.payload).encode(), 9, mtime=0)).decode()
        live = {"PATH": to_text(path), "PORT": str(server.port), "HEIGHT": str(self.height)}
        return {
            "text/plain": f"<Laboratory: {self.title}>",
            "image/png": png(self.still),
            "text/html": filled("live.html", **live, TITLE=escape(self.title)),
            LAB_MIME: {"title": self.title, "height": self.height, "scene": packed},
        }

    def save(self, path: str | Path) -> Path:
        """Write the page as one file, some 3 MB, that opens anywhere.

        Parameters
        ----------
        path
            File to write, ``.html``.

        Raises
        ------
        DownloadError
            MuJoCo for the page is not in the cache, and can't be had.
        """
        path = Path(path)
        if path.suffix.lower() != ".html":
            raise InvalidParameterError(f"a laboratory is saved as .html; got {str(path)!r}")
        text = self.page()
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return path


def write_lab(payload: Mapping[str, Any], beside: str | None = None) -> str:
    """HTML of a laboratory; ``beside`` is the folder, relative to the page, where its scripts lie if not in it."""
    if beside is None:
        texts = (text.replace("</script", "<\\/script") for text in lab_scripts().values())
        scripts = "\n".join(f"<script>\n{text}\n</script>" for text in texts)
    else:
        scripts = "\n".join(
            f'<script src="{beside}/{name}.js"></script>' for name in ("meshcat.min", "mujoco", *SCRIPTS)
        )
    packed = base64.b64encode(gzip.compress(to_text(payload).encode(), 9, mtime=0)).decode()
    title = escape(str(payload["title"]))
    parts = {"TITLE": title, "STYLE": page_asset("lab/lab.css"), "PAYLOAD": packed, "SCRIPTS": scripts}
    return filled("lab/lab.html", **parts)


def lab_scripts() -> dict[str, str]:
    """Every script of a laboratory by its file's name, in the order in which they are read.

    Raises
    ------
    DownloadError
        MuJoCo for the page is not in the cache, and can't be had.
    """
    others = {"meshcat.min.js": meshcat_script().read_text("utf-8"), "mujoco.js": mujoco_script().read_text("utf-8")}
    return others | {f"{name}.js": page_asset(f"lab/{name}.js") for name in SCRIPTS}


# --- a cell as the page reads it --------------------------------------------------------------------------------------


def _name(cell: WorkCell) -> str:
    arm = cell.arm_spec.name if cell.arm_spec else "floating"
    return f"{arm}, {cell.target_spec.name} {cell.placement}"


def _overview(cell: WorkCell) -> Scene3D:
    """From near, where hand and object are."""
    middle = [*np.mean(cell.stage.workspace, axis=1), cell.stage.table_height + 0.15]
    return Scene3D(cell).look_from(np.radians(-40), np.radians(18), 1.5, middle)


def _scene(cell: WorkCell) -> dict[str, Any]:
    spec, segmenter, model, data = cell.arm_spec, cell.segmenter, cell.model, cell.data
    if spec is None:
        raise InvalidParameterError("a laboratory has an arm to move, and a floating camera is none; take another arm=")
    if not isinstance(segmenter, HsvThreshold):
        raise InvalidParameterError(
            f"in a laboratory an object is found by an HsvThreshold; {cell.target_spec.name!r} has {segmenter!r}"
        )
    xml = cell.as_text()
    joints = [model.joint(ARM_PREFIX + name) for name in spec.joints]
    drives, ctrl = servos_of(model, np.array([joint.id for joint in joints])), data.ctrl.copy()
    for joint, servo in np.argwhere(drives):  # which hold the arm where it stands
        ctrl[servo] = data.qpos[joints[joint].qposadr[0]]
    view = _overview(cell)
    placed = cell.truth.world_from_object
    normal = cell.target_spec.accepted_normal(placed)
    inward = placed.rotation.inv().as_matrix()  # Rotation.apply refuses read-only arrays
    lens = cell.arm.intrinsics
    return {
        "xml": xml.replace(' input="pos"', ""),  # which MuJoCo 4 writes and 3.14 does not know
        "arrays": inexact(model, xml),
        "joints": [joint.name for joint in joints],
        "servos": [model.actuator(int(each.argmax())).name if each.any() else None for each in drives],
        "limits": [joint.range.tolist() if model.jnt_limited[joint.id] else None for joint in joints],
        "speeds": np.broadcast_to(spec.joint_speed, len(spec.joints)).tolist(),
        "camera": ARM_PREFIX + spec.camera,
        "target": TARGET,
        "home": cell.arm.joints.tolist(),
        "qpos": data.qpos.tolist(),
        "ctrl": ctrl.tolist(),
        "mocap": {"pos": data.mocap_pos.ravel().tolist(), "quat": data.mocap_quat.ravel().tolist()},
        "lens": {name: getattr(lens, name) for name in ("width", "height", "fx", "fy", "cx", "cy")},
        "ranges": {
            "hue": list(segmenter.hue),
            "saturation": list(segmenter.saturation),
            "value": list(segmenter.value),
            "kernelSize": segmenter.kernel_size,
        },
        "normal": (inward @ normal.direction).tolist(),
        "circle": None if normal.circle_axis is None else (inward @ normal.circle_axis).tolist(),
        "gripper": _gripper(cell),
        "objects": [command for command in view._commands() if command["type"] == "set_object"],
        "view": view._view(),
        "lights": _lights(model, data),
    }


def _gripper(cell: WorkCell) -> dict[str, Any] | None:
    spec = cell.arm_spec
    if spec is None or spec.gripper is None:
        return None
    gripper = cell.gripper
    return {
        "joints": [ARM_PREFIX + name for name in spec.gripper.finger_joints],
        "actuator": ARM_PREFIX + spec.gripper.actuator,
        "site": ARM_PREFIX + spec.gripper.range_site,
        "stroke": list(gripper.stroke),
        "hand": asdict(gripper.hand),
    }


def _lights(model: mujoco.MjModel, data: mujoco.MjData) -> dict[str, Any]:
    """As MuJoCo has them, for the hand's picture."""
    lamps = [
        {"pos": data.light_xpos[k].tolist(), "diffuse": model.light_diffuse[k].astype(float).tolist()}
        for k in range(model.nlight)
    ]
    head = model.vis.headlight
    return {"ambient": head.ambient.astype(float).tolist(), "head": head.diffuse.astype(float).tolist(), "lamps": lamps}


def inexact(model: mujoco.MjModel, xml: str) -> dict[str, dict[str, list[float]]]:
    """What a model's text does not tell to the last digit: by array, where it is off, and what stands there."""
    told, found = mujoco.MjModel.from_xml_string(xml), {}
    for name in (name for name in dir(told) if not name.startswith("_")):
        ours, theirs = getattr(model, name), getattr(told, name)
        if not isinstance(ours, np.ndarray) or ours.shape != theirs.shape or ours.dtype.kind != "f":
            continue
        off = np.flatnonzero(~np.isclose(ours, theirs, rtol=_SMALL, atol=_LOOSE if name in _BOUNDS else 0))
        if len(off):
            found[name] = {"at": off.tolist(), "of": ours.ravel()[off].astype(float).tolist()}
    return found
