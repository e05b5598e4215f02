"""What came of photographs: the scene in 3D, the solid drawn over each of them, the numbers; and a page of it all."""

from __future__ import annotations

import json
from html import escape
from pathlib import Path
from typing import Any

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from scipy.spatial.transform import RigidTransform, Slerp

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.sighting import View
from gvp_lib.photographs.desk import Photographs
from gvp_lib.photographs.sheet import Sheet
from gvp_lib.picture import count
from gvp_lib.planning.plan import Optimum
from gvp_lib.planning.solids import FittedSolid
from gvp_lib.views import drawing
from gvp_lib.views.pictures import BookFigure, panels
from gvp_lib.views.scene3d import Recording, Scene3D

__all__ = ["desk_scene", "desk_tour", "plot_photographs", "write_desk"]

_SOLID, _SEEN = (0, 114, 178), (230, 159, 0)  # RGB, of what was fitted and of what was seen
_THUMBNAIL = 160  # px
_FRAMES = 12  # a second, of a tour
_STYLE = """
:root { color-scheme: light dark; font: 16px/1.5 system-ui, sans-serif; }
body { max-width: 62rem; margin: 0 auto; padding: 1rem; }
h1 { font-size: 1.5rem; }
iframe { width: 100%; height: 30rem; border: 0; border-radius: .5rem; }
table { border-collapse: collapse; }
td { padding: .2rem 1rem .2rem 0; vertical-align: top; }
.grid { display: grid; grid-template-columns: repeat(auto-fill, minmax(17rem, 1fr)); gap: 1rem; }
figure { margin: 0; }
img { width: 100%; border-radius: .3rem; }
figcaption { font-size: .85rem; }
"""


@checked
def plot_photographs(photographs: Photographs, *, solid: FittedSolid | None = None, most: int = 4) -> BookFigure:
    """Draw photographs with the object's outline in orange and, where given, a solid's silhouette in blue.

    Parameters
    ----------
    photographs
        Photographs.
    solid
        Solid fitted to their views.
    most
        Number of photographs at most, evenly from all.

    Examples
    --------
    >>> plot_photographs(views_from_photographs("desk"))  # doctest: +SKIP
    """
    if most < 1:
        raise InvalidParameterError(f"most is a number of photographs, 1 or more; got {most}")
    n = len(photographs.views)
    chosen = np.linspace(0, n - 1, min(most, n)).round().astype(int)
    figure, axes, _ = panels(len(chosen), 3.3, 2.6)
    for k, ax in zip(chosen, axes, strict=True):
        ax.imshow(_drawn(photographs.views[k], photographs.intrinsics, solid))
        ax.set(xticks=[], yticks=[], title=photographs.files[k])
        ax.spines[:].set_visible(False)
    return figure


def _drawn(view: View, lens: CameraIntrinsics, solid: FittedSolid | None) -> NDArray[np.uint8]:
    """A view's picture with both outlines."""
    assert view.rgb is not None
    assert view.outline is not None
    picture = view.rgb.copy()
    lines = [(view.outline.points, _SEEN)]
    if solid is not None:
        pixels = lens.project(view.base_from_camera.inv().apply(solid.corners))
        if np.isfinite(pixels).all():
            lines.append((pixels[ConvexHull(pixels).vertices], _SOLID))
    for points, color in lines:
        fine = (16 * points).round().astype(np.int32)  # sixteenths of a pixel
        cv2.polylines(picture, [fine], True, color, max(1, lens.width // 400), cv2.LINE_AA, shift=4)
    return picture


@checked
def desk_tour(photographs: Photographs, optimum: Optimum, sheet: Sheet, *, seconds: float = 1.0) -> Recording:
    """Record how a telephone goes from photograph to photograph and, in the end, to the view to take.

    Parameters
    ----------
    photographs, optimum, sheet
        As in :func:`desk_scene`.
    seconds
        Time between two photographs, s.

    Examples
    --------
    >>> desk_tour(photographs, optimum, Sheet("a4"))  # doctest: +SKIP
    """
    if not 0 < seconds < np.inf:
        raise InvalidParameterError(f"the time between two photographs is positive and finite, s; got {seconds}")
    poses = RigidTransform.concatenate([*(view.base_from_camera for view in photographs.views), *optimum.poses[:1]])
    times = seconds * np.arange(len(poses))
    turns = Slerp(times, poses.rotation) if len(poses) > 1 else None
    scene = desk_scene(photographs, optimum, sheet)
    model, data = scene.model, scene.data
    hand = model.body("telephone").mocapid[0]

    def hold(at: float) -> None:
        x, y, z, w = (poses.rotation[0] if turns is None else turns(at)).as_quat()
        data.mocap_pos[hand] = [np.interp(at, times, poses.translation[:, k]) for k in range(3)]
        data.mocap_quat[hand] = w, x, y, z
        mujoco.mj_forward(model, data)

    hold(0.0)
    with scene.record(fps=_FRAMES) as recording:
        for at in np.arange(0.0, times[-1] + 0.5 / _FRAMES, 1 / _FRAMES):
            hold(min(float(at), float(times[-1])))
            scene.capture_frame(float(at))
    return recording


@checked
def desk_scene(photographs: Photographs, optimum: Optimum, sheet: Sheet) -> Scene3D:
    """Build the scene of photographs in 3D: the sheet, the solid, each picture at its camera, and the view to take.

    A telephone stands at the first of them.

    Parameters
    ----------
    photographs
        Photographs.
    optimum
        What an estimator made of ``photographs.arc``.
    sheet
        Sheet that they show.

    Examples
    --------
    >>> desk_scene(photographs, optimum, Sheet("a4")).show()  # doctest: +SKIP
    """
    width, height = sheet.size
    assets = {"sheet.png": bytes(cv2.imencode(".png", sheet.image(100))[1].tobytes())}
    mesh = body = ""
    if optimum.solid is not None:
        points = " ".join(f"{x:.6f}" for x in optimum.solid.corners.ravel())
        mesh = f'<mesh name="solid" vertex="{points}"/>'
        body = '<geom type="mesh" mesh="solid" rgba="0.1 0.42 0.68 1"/>'
    x, y, z = photographs.views[0].base_from_camera.translation
    qx, qy, qz, qw = photographs.views[0].base_from_camera.rotation.as_quat()
    telephone = (
        f'<body name="telephone" mocap="true" pos="{x} {y} {z}" quat="{qw} {qx} {qy} {qz}">'
        '<geom type="box" size="0.036 0.074 0.004" pos="0.02 0.05 -0.005" rgba="0.15 0.16 0.18 1"/>'
        '<geom type="cylinder" size="0.006 0.002" rgba="0.9 0.6 0 1"/></body>'
    )
    model = mujoco.MjModel.from_xml_string(
        f"""
        <mujoco>
          <asset>
            <texture name="sheet" type="2d" file="sheet.png"/> <material name="sheet" texture="sheet"/> {mesh}
          </asset>
          <worldbody>
            <light pos="0.3 -0.3 1.5" dir="-0.2 0.2 -1"/>
            <geom type="plane" size="0.3 0.3 0.1" pos="0 0 -0.001" rgba="0.85 0.82 0.78 1"/>
            <geom type="box" size="{width / 2} {height / 2} 0.0003" material="sheet"/> {body} {telephone}
          </worldbody>
        </mujoco>""",
        assets,
    )
    scene = Scene3D(model, title=f"The object as {count(len(photographs.views), 'photograph')} show it")
    scale = _THUMBNAIL / photographs.intrinsics.width
    for name, view in zip(photographs.files, photographs.views, strict=True):
        assert view.rgb is not None
        small = np.asarray(cv2.resize(view.rgb, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
        scene.add_frustum(name, view.base_from_camera, photographs.intrinsics, depth=0.05, image=small)
    if optimum.poses:
        scene.add_frustum("the view to take", optimum.poses[0], photographs.intrinsics, depth=0.09, color=drawing.GREEN)
    return scene.look_from(np.radians(-50), np.radians(28), 0.85, (0, 0, 0.14))


@checked
def write_desk(folder: str | Path, photographs: Photographs, optimum: Optimum, sheet: Sheet) -> Path:
    """Write a page with scene, pictures and numbers, ``index.html``, and the numbers as ``desk.json``.

    Parameters
    ----------
    folder
        Folder to write to; created if missing.
    photographs, optimum, sheet
        As in :func:`desk_scene`.

    Examples
    --------
    >>> write_desk("desk", photographs, optimum, Sheet("a4"))  # doctest: +SKIP
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidParameterError(f"{folder} is no folder to write to: {error.strerror}") from error
    told = _numbers(photographs, optimum)
    figures = []
    for k, (name, view) in enumerate(zip(photographs.files, photographs.views, strict=True)):
        file = f"{k:02d}.jpg"
        drawn = cv2.cvtColor(_drawn(view, photographs.intrinsics, optimum.solid), cv2.COLOR_RGB2BGR)
        (folder / file).write_bytes(cv2.imencode(".jpg", drawn, [cv2.IMWRITE_JPEG_QUALITY, 88])[1].tobytes())
        caption, alt = escape(name), escape(f"{name} with the outline found and the solid's silhouette")
        picture = f'<img src="{file}" alt="{alt}" loading="lazy">'
        figures.append(f"<figure>{picture}<figcaption>{caption}</figcaption></figure>")
    desk_tour(photographs, optimum, sheet).view.save(folder / "scene.html")
    (folder / "desk.json").write_text(json.dumps(told, indent=1) + "\n", "utf-8")
    rows = "".join(f"<tr><td>{escape(key)}</td><td>{escape(value)}</td></tr>" for key, value in in_words(told).items())
    skipped = "".join(f"<li>{escape(name)} {escape(why)}</li>" for name, why in photographs.skipped.items())
    skipped = f"<h2>Not used</h2><ul>{skipped}</ul>" if skipped else ""
    page = folder / "index.html"
    page.write_text(
        '<!doctype html><html lang="en"><meta charset="utf-8"><title>An object on a sheet</title>'
        f'<meta name="viewport" content="width=device-width"><style>{_STYLE}</style><h1>An object on a sheet</h1>'
        f'<iframe src="scene.html" title="The scene in 3D"></iframe><table>{rows}</table>'
        "<p>Orange: the outline that was found. Blue: what the fitted solid would show.</p>"
        f'<div class="grid">{"".join(figures)}</div>{skipped}</html>\n',
        "utf-8",
    )
    return page


def _numbers(photographs: Photographs, optimum: Optimum) -> dict[str, Any]:
    """What came of it, in plain numbers; lengths in m, poses as matrices."""
    lens, solid = photographs.lens, optimum.solid
    return {
        "outcome": str(optimum.outcome.value),
        "solid": solid
        and {
            "kind": solid.kind,
            "lengths": solid.lengths.tolist(),
            "sheet_from_solid": solid.base_from_solid.as_matrix().tolist(),
            "normal": solid.normal.tolist(),
            "normal_sd_deg": float(np.degrees(solid.uncertainty)),
            "residual_px": solid.residual,
            "explains": solid.explains,
        },
        "sheet_from_camera_to_take": [pose.as_matrix().tolist() for pose in optimum.poses[:1]],
        "lens": {
            "matrix": lens.intrinsics.matrix.tolist(),
            "distortion": lens.distortion.tolist(),
            "rms_px": lens.rms_px,
        },
        "views": {
            name: view.base_from_camera.as_matrix().tolist()
            for name, view in zip(photographs.files, photographs.views, strict=True)
        },
        "skipped": dict(photographs.skipped),
    }


def in_words(told: dict[str, Any]) -> dict[str, str]:
    """The numbers in a few lines."""
    words = {"photographs": f"{len(told['views'])} used, {len(told['skipped'])} not"}
    if (solid := told["solid"]) is not None:
        sides = " x ".join(f"{1000 * length:.1f}" for length in solid["lengths"])
        what = solid["kind"] if solid["explains"] else "no box and no cylinder; within a box"
        words |= {"object": f"{what}, {sides} mm"}
        words |= {"face to look at": f"within {solid['normal_sd_deg']:.2g} deg (1 sd)"}
    return words | {"outcome": told["outcome"], "sheet": f"off by {told['lens']['rms_px']:.2f} px (rms)"}
