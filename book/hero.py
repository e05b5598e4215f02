"""Draw the picture on the first page and in the README: ``python book/hero.py``."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gvp_lib import Blob, VirtualSphere, WorkCell
from gvp_lib.views import figures
from gvp_lib.views.scene3d import Scene3D

TILTS = np.radians([-30, -15, 0, 15, 30])
HEIGHT = 760


def main() -> None:
    """Baxter halfway along an arc over a brick, and what its camera sees along the way."""
    import cv2

    cell = WorkCell(arm="baxter", target="cuboid_1x2", seed=12)
    truth = cell.truth
    sphere = VirtualSphere(truth.world_from_object.translation, 0.28, truth.normal.direction)
    views = sphere.viewpoint(np.abs(TILTS), np.where(TILTS < 0, np.pi / 2, -np.pi / 2), np.where(TILTS < 0, np.pi, 0))
    seen = []
    for k in (0, 2, 4):
        cell.place_camera(views[k])
        rgb = cell.arm.capture()
        seen.append(picture(rgb, Blob.from_mask(cell.segmenter(rgb)))[240:720, 320:960])
    cell.place_camera(views[3])
    scene = Scene3D(cell)
    scene.add_sphere("sphere", sphere, max_tilt=np.radians(38))
    arc = np.linspace(-np.radians(36), np.radians(36), 60)
    poses = sphere.viewpoint(np.abs(arc), np.where(arc < 0, np.pi / 2, -np.pi / 2))
    scene.add_path("arc", poses.translation, radius=0.004)
    scene.add_frustum("view", camera="arm/hand_camera", depth=0.18)
    scene.look_from(np.radians(-33), np.radians(11), 2.0, sphere.center + [-0.22, 0.12, 0.3])
    wide = cv2.resize(scene.still(2 * 1120, 2 * HEIGHT), (1120, HEIGHT), interpolation=cv2.INTER_AREA)
    column = np.vstack([cv2.resize(image, (337, 253), interpolation=cv2.INTER_AREA) for image in seen])
    column = cv2.resize(column, (337, HEIGHT), interpolation=cv2.INTER_AREA)
    gap = np.full((HEIGHT, 6, 3), 255, np.uint8)
    hero = np.hstack([wide, gap, column])
    path = Path(__file__).parent / "_static" / "hero.webp"
    cv2.imwrite(str(path), hero[..., ::-1], [cv2.IMWRITE_WEBP_QUALITY, 90])
    cell.close()


def picture(rgb: NDArray[np.uint8], blob: Blob | None) -> NDArray[np.uint8]:
    """A blob over its image, without title and margins."""
    import matplotlib.image

    figure = figures.draw_blob(rgb, blob)
    (axes,) = figure.axes
    figure.set_layout_engine("none")
    figure.set_size_inches(6.4, 4.8)
    axes.set_position((0, 0, 1, 1))
    stream = io.BytesIO()
    figure.savefig(stream, dpi=200, format="png")
    stream.seek(0)
    return np.rint(255 * matplotlib.image.imread(stream)[..., :3]).astype(np.uint8)


if __name__ == "__main__":
    main()
