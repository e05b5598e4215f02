"""The work cell's speed: pictures against a bare renderer of the same scene.

Run as ``python tests/benchmarks/capture.py``. Aim: a picture without noise at 0.8 of the bare rate or more. With
``--against CHECKOUT`` it times the library of another checkout, such as an older version, beside this one's.
"""

from __future__ import annotations

import gvp_lib.simulation  # noqa: F401 - before mujoco, which then chooses how it draws

# isort: split
import itertools
from collections.abc import Callable
from functools import partial

import mujoco
import numpy as np
from harness import command, interleave, verdict
from scipy.spatial.transform import RigidTransform

from gvp_lib import Noise, VirtualSphere, WorkCell

RATE_AIM, SEED = 0.8, 3  # of the bare renderer's rate


def cell_of(arm: str, noise: Noise | None = None) -> WorkCell:
    """A cell whose camera stands 0.3 m above the object, a little askew: nothing but the table is in view."""
    cell = WorkCell(arm, "cuboid_1x2", noise=noise or Noise.none(), seed=SEED)
    sphere = VirtualSphere(cell.truth.world_from_object.translation, 0.3)
    cell.place_camera(sphere.viewpoint(np.radians(10), np.radians(160)))
    return cell


def twenty(arm: str, noise: Noise, moved: bool = False) -> Callable[[], None]:
    """Twenty pictures of an arm's full cell, or steps of 20 mm: one alone is too short to time."""
    cell = cell_of(arm, noise)
    moves = itertools.cycle([RigidTransform.from_translation([x, 0.0, 0.0]) for x in (0.02, -0.02)])

    def run() -> None:
        for _ in range(20):
            cell.arm.move_camera(next(moves)) if moved else cell.arm.capture()

    return run


CASES = {
    f"{what}, {arm}": partial(twenty, arm, *settings)
    for arm in ("baxter", "ur5e")
    for what, *settings in (
        ("20 pictures", Noise.none()),
        ("20 pictures, thesis's noise", Noise.thesis()),
        ("20 steps of 20 mm", Noise.none(), True),
    )
}


def main() -> None:
    """The Baxter's hand camera, from 0.3 m above the object, against MuJoCo's own renderer with the cell's flags."""
    cell, noisy = cell_of("baxter"), cell_of("baxter", Noise.thesis())
    cell.arm.capture()
    assert cell.model.vis.quality.offsamples == 0  # as the cell's camera has left it
    renderer = mujoco.Renderer(cell.model, 480, 640)
    for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
        renderer.scene.flags[flag] = False

    def bare() -> np.ndarray:
        renderer.update_scene(cell.data, "arm/hand_camera")
        return renderer.render()

    np.testing.assert_array_equal(bare(), cell.arm.capture())
    print("One picture of the full Baxter cell, 640 x 480")
    rivals = {"bare mujoco.Renderer": bare, "no noise": cell.arm.capture, "thesis's noise": noisy.arm.capture}
    results = interleave(rivals)
    for name in ("no noise", "thesis's noise"):
        verdict(f"capture(), {name}, of the bare rate", 1 / results[name].ratio, RATE_AIM, least=True)


if __name__ == "__main__":
    command(main, CASES)
