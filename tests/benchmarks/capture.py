"""The work cell's speed: pictures against a bare renderer of the same scene, inverse kinematics, motions, resets.

Run as ``python tests/benchmarks/capture.py``. Aim: a picture without noise at 0.8 of the bare rate or more. With
``--against CHECKOUT`` it times the library of another checkout, such as an older version, beside this one's.
"""

from __future__ import annotations

import gvp_lib.simulation  # noqa: F401 - before mujoco, which then chooses how it draws

# isort: split
import itertools
import platform
from collections.abc import Callable
from functools import partial

import mujoco
import numpy as np
from harness import command, interleave
from scipy.spatial.transform import RigidTransform

from gvp_lib import Noise, VirtualSphere, WorkCell

AIM = 0.8  # of the bare renderer's rate
SEED = 3


class Bare:
    """MuJoCo's own renderer on a cell's scene, with the flags that the cell sets and nothing else."""

    def __init__(self, cell: WorkCell) -> None:
        assert cell.model.vis.quality.offsamples == 0  # as the cell's camera has left it
        self.cell, self.camera = cell, "arm/hand_camera"
        self.renderer = mujoco.Renderer(cell.model, 480, 640)
        self.renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
        self.renderer.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False

    def __call__(self) -> np.ndarray:
        self.renderer.update_scene(self.cell.data, self.camera)
        return self.renderer.render()


def look_down(cell: WorkCell) -> None:
    """Stand 0.3 m above the object, a little askew: no sky is in view, nor anything but the table and what is on it."""
    sphere = VirtualSphere(cell.truth.world_from_object.translation, 0.3)
    cell.place_camera(sphere.viewpoint(np.radians(10), np.radians(160)))


def pictures() -> None:
    """The Baxter's hand camera, from 0.3 m above the object."""
    cells = {
        "capture(), no noise": WorkCell("baxter", "cuboid_1x2", seed=SEED),
        "capture(), thesis's noise": WorkCell("baxter", "cuboid_1x2", noise=Noise.thesis(), seed=SEED),
    }
    for cell in cells.values():
        look_down(cell)
        cell.arm.capture()
    bare = Bare(cells["capture(), no noise"])
    np.testing.assert_array_equal(bare(), cells["capture(), no noise"].arm.capture())
    print(f"One picture of the full Baxter cell, 640 x 480 (aim: {AIM} of the bare rate)")
    results = interleave({"bare mujoco.Renderer": bare, **{name: cell.arm.capture for name, cell in cells.items()}})
    for name in cells:
        rate = 1 / results[name].ratio
        print(f"{name}: {rate:.2f} of the bare rate{'' if rate >= AIM else f', below the aim of {AIM}'}")
    print()
    bare.renderer.close()
    for cell in cells.values():
        cell.close()


def kinematics(name: str) -> None:
    """Joint angles for poses about the home view."""
    cell = WorkCell(name, "cuboid_1x2", seed=SEED)
    solver, home = cell._kinematics, np.array(cell.arm_spec.home)
    sphere = VirtualSphere(cell.truth.world_from_object.translation, 0.3)
    rng = np.random.default_rng(SEED)
    start = cell.arm.camera_pose()
    near = itertools.cycle([start * RigidTransform.from_translation(rng.uniform(-0.02, 0.02, 3)) for _ in range(50)])
    far = itertools.cycle(list(sphere.random(50, rng, max_tilt=np.radians(30))))
    print(f"Inverse kinematics, {name}")
    interleave(
        {
            "forward": lambda: solver.forward(home),
            "solve, 20 mm away": lambda: solver.solve(next(near), home),
            "solve_any, tilts to 30 deg": lambda: solver.solve_any(next(far), home),
        },
        calls=20,
    )
    print()


def motions(name: str) -> None:
    """What an episode is made of."""
    cell = WorkCell(name, "cuboid_1x2", seed=SEED)
    back_and_forth = itertools.cycle([RigidTransform.from_translation([x, 0.0, 0.0]) for x in (0.02, -0.02)])
    seeds = itertools.count()
    print(f"Motions and resets, {name}")
    interleave(
        {
            "capture()": cell.arm.capture,
            "move_camera, 20 mm": lambda: cell.arm.move_camera(next(back_and_forth)),
            "rotate_wrist(0)": lambda: cell.arm.rotate_wrist(0.0),
            "reset(), flat": lambda: cell.reset(next(seeds)),
        },
        rounds=8,
    )
    print()
    cell.close()


def repeated(function: Callable[[], object], times: int = 20) -> Callable[[], None]:
    """A function called several times, where one call is too short to time."""

    def run() -> None:
        for _ in range(times):
            function()

    return run


def captures(arm: str, noise: Noise) -> Callable[[], None]:
    """Twenty pictures of an arm's full cell."""
    cell = WorkCell(arm, "cuboid_1x2", noise=noise, seed=SEED)
    look_down(cell)
    return repeated(cell.arm.capture)


def steps(arm: str) -> Callable[[], None]:
    """Twenty steps of 20 mm, to and fro."""
    cell = WorkCell(arm, "cuboid_1x2", seed=SEED)
    look_down(cell)
    to_and_fro = itertools.cycle([RigidTransform.from_translation([x, 0.0, 0.0]) for x in (0.02, -0.02)])
    return repeated(lambda: cell.arm.move_camera(next(to_and_fro)))


CASES = {
    f"{what}, {arm}": partial(make, arm, *settings)
    for arm in ("baxter", "ur5e")
    for what, make, *settings in (
        ("20 pictures", captures, Noise.none()),
        ("20 pictures, thesis's noise", captures, Noise.thesis()),
        ("20 steps of 20 mm", steps),
    )
}


def main() -> None:
    """Print the tables."""
    print(f"MuJoCo {mujoco.__version__}, Python {platform.python_version()}, {platform.machine()}\n")
    pictures()
    for name in ("baxter", "ur5e"):
        kinematics(name)
        motions(name)


if __name__ == "__main__":
    command(main, CASES)
