"""Photographs of a desk, rendered: packaging of several colors on a printed sheet, as a telephone would take them.

The lens bends, the light is uneven and differs from picture to picture, a shadow lies on the sheet, and hands are not
still. Unlike a telephone's, these pictures come with the truth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import UnknownNameError
from gvp_lib.geometry import CameraIntrinsics, look_at
from gvp_lib.photographs import Sheet
from gvp_lib.simulation.camera import renderer, to_mujoco_camera

__all__ = ["PACKAGES", "Desk", "photographed"]

Color = tuple[int, int, int]


@dataclass(frozen=True)
class Package:
    """A box or a can with a print on it: half sizes, m (of a can radius and half height), and colors, ground first."""

    kind: str
    size: tuple[float, ...]
    colors: Sequence[Color]

    @property
    def lengths(self) -> NDArray[np.float64]:
        """Lengths of its sides, along its own axes, m."""
        return 2 * np.array(self.size if self.kind == "box" else (self.size[0], *self.size))


PACKAGES: Mapping[str, Package] = {
    "carton": Package("box", (0.034, 0.023, 0.035), [(235, 235, 225), (200, 30, 40), (30, 60, 160), (20, 20, 20)]),
    "tea": Package("box", (0.030, 0.040, 0.022), [(20, 70, 40), (220, 190, 60), (230, 230, 220), (160, 30, 30)]),
    "stone": Package("box", (0.040, 0.020, 0.015), [(128, 128, 128), (120, 120, 122), (110, 112, 112)]),
    "can": Package("cylinder", (0.030, 0.045), [(180, 30, 30), (240, 240, 235), (30, 30, 30), (230, 200, 60)]),
    "matches": Package("box", (0.055, 0.030, 0.010), [(240, 210, 60), (30, 80, 170), (200, 40, 40), (250, 250, 245)]),
    "perfume": Package("box", (0.025, 0.025, 0.050), [(25, 25, 28), (200, 200, 205), (60, 60, 65), (240, 120, 20)]),
}
"""White on white paper, gray in its own gray shadow, black, and in between; one round."""

_WOODS: Sequence[Color] = [(150, 110, 70), (120, 90, 70), (190, 160, 120), (90, 90, 95)]
_FOCAL, _BENT = 0.86, (-0.04, 0.02)  # of the picture's width; k1, k2
_MARGIN = 1.18  # by which the renderer sees more than the lens, which bends
_TILTS, _DISTANCES = np.radians((18.0, 60.0)), (0.38, 0.50)  # of the line of sight from the vertical; m


@dataclass(frozen=True, eq=False)
class Desk:
    """Photographs of a package on a sheet, and the truth.

    Attributes
    ----------
    pictures
        As the telephone took them, uint8 (H, W, 3).
    sheet
        Sheet that lies on the desk.
    lens, distortion
        Lens that took them: pinhole, and OpenCV's coefficients.
    cameras
        ``sheet_from_camera`` of each.
    masks
        Where each shows the package, bool (H, W), bent like the pictures.
    package
        What stands on the sheet.
    sheet_from_package
        Pose of its middle.
    """

    pictures: list[NDArray[np.uint8]]
    sheet: Sheet
    lens: CameraIntrinsics
    distortion: NDArray[np.float64]
    cameras: list[RigidTransform]
    masks: list[NDArray[np.bool_]]
    package: Package
    sheet_from_package: RigidTransform


def photographed(
    name: str,
    seed: int,
    count: int = 10,
    size: tuple[int, int] = (1600, 1200),
    sheet: Sheet | None = None,
    moved: int | None = None,
    bare: bool = False,
) -> Desk:
    """Take photographs of one of :data:`PACKAGES` from all around, of a size in px; None: an A4 sheet.

    On a bare desk there is no sheet. From photograph number ``moved`` on, the package stands 4 cm aside of where the
    truth has it.
    """
    if name not in PACKAGES:
        raise UnknownNameError("package", name, PACKAGES)
    package, sheet = PACKAGES[name], Sheet() if sheet is None else sheet
    rng = np.random.default_rng([seed, list(PACKAGES).index(name)])
    (width, height), focal = size, _FOCAL * size[0]
    middle = 0.5 * (np.array(size) - 1) + rng.uniform(-8e-3, 8e-3, 2) * width
    lens = CameraIntrinsics(width, height, focal, focal, *map(float, middle))
    distortion = np.array([*_BENT, 0.0, 0.0, 0.0])
    pose = RigidTransform.from_components(
        [*rng.uniform(-0.02, 0.02, 2), 0.5 * package.lengths[2]],
        Rotation.from_rotvec([0, 0, rng.uniform(-np.pi, np.pi)]),
    )
    model = _model(package, pose, None if bare else sheet, rng, size)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    seen = np.stack([u, v], axis=-1).reshape(-1, 1, 2).astype(float)
    rays = cv2.undistortPoints(seen, lens.matrix, distortion).reshape(height, width, 2)
    wide = 0.5 * height / np.tan(0.5 * np.radians(model.cam_fovy[0]))
    maps = [(rays[..., k] * wide + 0.5 * (size[k] - 1)).astype(np.float32) for k in (0, 1)]
    desk = Desk([], sheet, lens, distortion, [], [], package, pose)
    artist, around = renderer(model, width, height, shadows=True, samples=4), rng.uniform(0, 2 * np.pi)
    try:
        for k in range(count):
            if k == moved:
                model.geom("package").pos += (0.04, 0.0, 0.0)
            camera = _somewhere(around + 2 * np.pi * k / count, rng)
            model.cam_pos[0], model.cam_quat[0] = to_mujoco_camera(camera)
            mujoco.mj_forward(model, data)
            artist.update_scene(data, camera=0)
            rgb = artist.render()
            artist.enable_segmentation_rendering()
            artist.update_scene(data, camera=0)
            is_it = (artist.render()[..., 0] == model.geom("package").id).astype(np.uint8)
            artist.disable_segmentation_rendering()
            desk.cameras.append(camera)
            desk.masks.append(cv2.remap(is_it, maps[0], maps[1], cv2.INTER_NEAREST).view(np.bool_))
            desk.pictures.append(_as_taken(cv2.remap(rgb, maps[0], maps[1], cv2.INTER_LINEAR), rng))
    finally:
        artist.close()
    return desk


def _somewhere(azimuth: float, rng: np.random.Generator) -> RigidTransform:
    """A telephone held about there, upright or on its side, never quite level."""
    tilt, distance = rng.uniform(*_TILTS), rng.uniform(*_DISTANCES)
    azimuth += rng.uniform(-0.2, 0.2)
    level = np.sin(tilt)
    at = distance * np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.cos(tilt)])
    roll = rng.uniform(-0.3, 0.3) + (0.5 * np.pi if rng.random() < 0.3 else 0.0)
    target = [*rng.uniform(-0.02, 0.02, 2), 0.02]
    return look_at(at, target) * RigidTransform.from_rotation(Rotation.from_rotvec([0, 0, roll]))


def _as_taken(rgb: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Uneven light, exposure, white balance, blur and noise."""
    height, width = rgb.shape[:2]
    y, x = np.mgrid[-0.5 : 0.5 : height * 1j, -0.5 : 0.5 : width * 1j]
    slope = rng.uniform(-0.15, 0.15, 2)
    light = (1 + slope[0] * x + slope[1] * y) * (1 - 0.5 * (x * x + y * y)) * rng.uniform(0.85, 1.15)
    picture = rgb * light[..., None] * rng.uniform(0.97, 1.03, 3)
    picture = cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.5, 1.3) * width / 1600)
    return np.clip(picture + rng.normal(0, 2.5, rgb.shape), 0, 255).astype(np.uint8)


def _model(
    package: Package, pose: RigidTransform, sheet: Sheet | None, rng: np.random.Generator, size: tuple[int, int]
) -> mujoco.MjModel:
    """A desk with the sheet on it, if there is one, the package on that, and a camera."""
    sides = ("right", "left", "up", "down", "front", "back")
    assets, printed, paper = {"wood.png": _wood(rng)}, "", ""
    if sheet is not None:
        assets["sheet.png"] = sheet.image(300)
        width, height = sheet.size
        printed = (
            '<texture name="sheet" type="2d" file="sheet.png"/> <material name="sheet" texture="sheet" specular="0.1"/>'
        )
        paper = f'<geom type="plane" size="{width / 2} {height / 2} 0.1" material="sheet"/>'
    assets |= {f"{side}.png": _print(package.colors, rng) for side in sides}
    lx, ly = rng.uniform(-0.6, 0.6, 2)
    x, y, z, w = pose.rotation.as_quat()
    files = " ".join(f'file{side}="{side}.png"' for side in sides)
    xml = f"""
    <mujoco>
      <visual>
        <global offwidth="{size[0]}" offheight="{size[1]}"/> <quality shadowsize="4096" offsamples="4"/>
        <headlight ambient="0.25 0.25 0.25" diffuse="0.1 0.1 0.1" specular="0 0 0"/>
        <map znear="0.01" zfar="20" shadowclip="0.6"/>
      </visual>
      <asset>
        {printed}
        <texture name="wood" type="2d" file="wood.png"/>
        <material name="wood" texture="wood" specular="0.1" texrepeat="10 10"/>
        <texture name="print" type="cube" {files}/>
        <material name="print" texture="print" specular="0.3" shininess="0.4"/>
      </asset>
      <worldbody>
        <light pos="{lx} {ly} 1" dir="{-lx} {-ly} -1" cutoff="70" diffuse="0.6 0.58 0.52"/>
        <light pos="{-ly} {lx} 0.8" dir="{ly} {-lx} -0.8" castshadow="false" diffuse="0.2 0.2 0.24"/>
        <geom type="plane" size="4 4 0.1" pos="0 0 -0.0005" material="wood"/>
        {paper}
        <geom name="package" type="{package.kind}" size="{" ".join(map(str, package.size))}" material="print"
          pos="{" ".join(map(str, pose.translation))}" quat="{w} {x} {y} {z}"/>
        <camera name="telephone" fovy="{np.degrees(2 * np.arctan(_MARGIN * 0.5 * size[1] / (_FOCAL * size[0])))}"/>
      </worldbody>
    </mujoco>"""
    return mujoco.MjModel.from_xml_string(xml, {name: _png(picture) for name, picture in assets.items()})


def _png(picture: NDArray[np.uint8]) -> bytes:
    if picture.ndim == 3:
        picture = np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), np.uint8)
    return bytes(cv2.imencode(".png", picture)[1].tobytes())


def _wood(rng: np.random.Generator, side: int = 1024) -> NDArray[np.uint8]:
    y, x = np.mgrid[:side, :side] / side
    grain = np.zeros((side, side))
    for _ in range(5):
        bend = 0.02 * np.sin(2 * np.pi * x * rng.uniform(1, 4) + rng.uniform(0, 6))
        grain += rng.uniform(0.3, 1) * np.sin(2 * np.pi * (rng.uniform(3, 25) * (y + bend) + rng.uniform(0, 1)))
    grain = (grain - grain.min()) / np.ptp(grain) + 0.15 * rng.normal(size=grain.shape)
    return np.clip(rng.choice(_WOODS) * (0.75 + 0.4 * grain[..., None]), 0, 255).astype(np.uint8)


def _print(colors: Sequence[Color], rng: np.random.Generator, side: int = 256) -> NDArray[np.uint8]:
    """One side of a package: rectangles, disks, lines and a word."""
    picture = np.full((side, side, 3), colors[0], np.uint8)
    for _ in range(4):
        color: Any = [int(each) for each in colors[int(rng.integers(1, len(colors)))]]
        at, over = rng.integers(0, side, 2), rng.integers(side // 12, side // 2, 2)
        kind = rng.integers(3)
        if kind == 0:
            cv2.rectangle(picture, at.tolist(), (at + over).tolist(), color, cv2.FILLED)
        elif kind == 1:
            cv2.circle(picture, at.tolist(), int(over[0] // 2), color, cv2.FILLED)
        else:
            cv2.line(picture, at.tolist(), (at + over).tolist(), color, side // 20)
    last: Any = [int(each) for each in colors[-1]]
    cv2.putText(picture, "FRESH", (side // 10, int(rng.integers(60, 220))), cv2.FONT_HERSHEY_SIMPLEX, 1.6, last, 5)
    return picture
