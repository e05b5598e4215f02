"""Compare our UR5e and Baxter with an independent description of the same robots: robosuite's.

Without that description there is nothing to compare with, and the script only says how to get it: fetch and unpack it
(no need to install it), then run::

    pip download robosuite --no-deps -d downloads
    unzip -q downloads/robosuite-*.whl -d downloads
    python tests/benchmarks/compare_kinematics.py downloads/robosuite/models/assets/robots

Expected: Baxter, torso to right_hand, below 0.1 mm and 0.01 deg. UR5e, base to flange: up to 2.7 mm, because that
model rounds its lengths to the millimeter (163, 425, 392, 134, 100 and 98 mm for 162.5, 425, 392.2, 133.3, 99.7 and
99.6); against Universal Robots' own table ours is exact (see ``tests/simulation/test_kinematics.py``).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from gvp_lib.simulation.arms import ARMS

# robosuite's names of the joints and the hand. Its UR5e follows the ROS convention, whose base is turned by half a
# turn about z from Universal Robots' own, and whose hand's frame is turned about the flange's axis.
THEIRS = {
    "ur5e": (
        (
            "shoulder_pan_joint",
            "shoulder_lift_joint",
            "elbow_joint",
            "wrist_1_joint",
            "wrist_2_joint",
            "wrist_3_joint",
        ),
        Rotation.from_euler("z", np.pi),
    ),
    "baxter": (ARMS["baxter"].joints, Rotation.identity()),
}


def hand_pose(
    model: mujoco.MjModel, data: mujoco.MjData, joints: tuple[str, ...], q: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Position (3,) and rotation matrix (3, 3) of the hand, from the arm's base, at joint angles q."""
    for name, angle in zip(joints, q, strict=True):
        data.joint(name).qpos = angle
    mujoco.mj_kinematics(model, data)
    ours = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, "flange") >= 0
    frame = data.site("flange") if ours else data.body("right_hand")
    # Ours has the torso, or the base, at the world's origin; theirs lifts the torso.
    base = data.body("torso" if "right_s0" in joints else "base")
    turn = base.xmat.reshape(3, 3).T
    return turn @ (frame.xpos - base.xpos), turn @ frame.xmat.reshape(3, 3)


def compare(name: str, theirs_xml: Path, n: int, seed: int) -> None:
    """Print the largest difference between the two models of one robot."""
    spec = ARMS[name]
    ours, theirs = spec.load().compile(), mujoco.MjModel.from_xml_path(str(theirs_xml))
    data_ours, data_theirs = mujoco.MjData(ours), mujoco.MjData(theirs)
    names, ours_from_theirs = THEIRS[name]
    low, high = np.array([ours.joint(joint).range for joint in spec.joints]).T
    shifts, differences = [], []
    for q in np.random.default_rng(seed).uniform(low, high, (n, len(names))):
        p, r = hand_pose(ours, data_ours, spec.joints, q)
        p_theirs, r_theirs = hand_pose(theirs, data_theirs, names, q)
        shifts.append(np.linalg.norm(p - ours_from_theirs.apply(p_theirs)))
        differences.append((ours_from_theirs * Rotation.from_matrix(r_theirs)).inv() * Rotation.from_matrix(r))
    # Where the two describe the hand with different axes, the difference is one constant rotation.
    constant = differences[0]
    angles = [np.degrees((constant.inv() * difference).magnitude()) for difference in differences]
    print(
        f"{name}: {n} configurations; position at most {1e3 * max(shifts):.4f} mm (mean {1e3 * np.mean(shifts):.4f}), "
        f"orientation at most {max(angles):.5f} deg; the hands' axes differ by a constant "
        f"{np.degrees(constant.magnitude()):.4f} deg"
    )


def main() -> None:
    """Read the command line and compare both robots."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robots", type=Path, nargs="?", help="robosuite's folder models/assets/robots")
    parser.add_argument("-n", type=int, default=1000, help="number of random configurations")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    if arguments.robots is None:  # as `make bench` calls it, on a machine that need not have it
        print("Kinematics against an independent model: left out, since no folder was given.\n")
        print("\n\n".join(__doc__.split("\n\n")[1:3]))
        return
    for name in THEIRS:
        compare(name, arguments.robots / name / "robot.xml", arguments.n, arguments.seed)


if __name__ == "__main__":
    main()
