"""Compare our UR5e and Baxter with an independent description of the same robots: robosuite's.

Without that description there is nothing to compare with, and the script only says how to get it: fetch and unpack it
(no need to install it), then run::

    pip download robosuite --no-deps -d downloads
    unzip -q downloads/robosuite-*.whl -d downloads
    python tests/benchmarks/compare_kinematics.py downloads/robosuite/models/assets/robots

Expected: Baxter, torso to right_hand, below 0.1 mm and 0.01 deg. UR5e, base to flange: up to 2.7 mm, because that
model rounds its lengths to the millimeter (163, 425, 392, 134, 100 and 98 mm for 162.5, 425, 392.2, 133.3, 99.7 and
99.6); against Universal Robots' own table ours is exact (see ``tests/simulation/test_arms.py``).
"""

from __future__ import annotations

import sys
from pathlib import Path

import mujoco
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.simulation.arms import ARMS

N, SEED = 1000, 0  # random configurations
_UR5E = ["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint"]
# robosuite's names of the joints, and its base. Its UR5e follows the ROS convention, whose base is turned by half a
# turn about z from Universal Robots' own, and whose hand's frame is turned about the flange's axis.
THEIRS = {
    "ur5e": (_UR5E, Rotation.from_euler("z", np.pi)),
    "baxter": (ARMS["baxter"].joints, Rotation.identity()),
}


def hand_pose(model: mujoco.MjModel, joints: list[str], q: np.ndarray, base: str, hand: str) -> RigidTransform:
    """The hand's pose in the arm's base, at joint angles q."""
    data = mujoco.MjData(model)
    for name, angle in zip(joints, q, strict=True):
        data.joint(name).qpos = angle
    mujoco.mj_kinematics(model, data)
    frames = data.body(base), data.site(hand) if hand == "flange" else data.body(hand)
    world_from_base, world_from_hand = (
        RigidTransform.from_components(frame.xpos, Rotation.from_matrix(frame.xmat.reshape(3, 3))) for frame in frames
    )
    return world_from_base.inv() * world_from_hand


def compare(name: str, theirs_xml: Path) -> None:
    """Print the largest difference between the two models of one robot."""
    spec, (joints, ours_from_theirs) = ARMS[name], THEIRS[name]
    ours, theirs = spec.load().compile(), mujoco.MjModel.from_xml_path(str(theirs_xml))
    # Ours has the torso, or the base, at the world's origin; theirs lifts the torso.
    base = "torso" if name == "baxter" else "base"
    low, high = np.array([ours.joint(joint).range for joint in spec.joints]).T
    shifts, differences = [], []
    for q in np.random.default_rng(SEED).uniform(low, high, (N, len(joints))):
        hand = hand_pose(ours, spec.joints, q, base, "flange")
        their_hand = RigidTransform.from_rotation(ours_from_theirs) * hand_pose(theirs, joints, q, base, "right_hand")
        shifts.append(1e3 * np.linalg.norm(hand.translation - their_hand.translation))
        differences.append(their_hand.rotation.inv() * hand.rotation)
    # Where the two describe the hand with different axes, the difference is one constant rotation.
    angles = [np.degrees((differences[0].inv() * difference).magnitude()) for difference in differences]
    print(
        f"{name}: {N} configurations; position at most {max(shifts):.4f} mm (mean {np.mean(shifts):.4f}), "
        f"orientation at most {max(angles):.5f} deg; the hands' axes differ by a constant "
        f"{np.degrees(differences[0].magnitude()):.4f} deg"
    )


if __name__ == "__main__":
    if len(sys.argv) == 1:  # as `make bench` calls it, on a machine that need not have it
        print("Kinematics against an independent model: left out, since no folder was given.\n")
        print("\n\n".join(__doc__.split("\n\n")[1:3]))
    for robot in THEIRS if len(sys.argv) > 1 else ():
        compare(robot, Path(sys.argv[1]) / robot / "robot.xml")
