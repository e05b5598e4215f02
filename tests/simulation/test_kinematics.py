"""Forward kinematics of our models against published tables, written out here independently of the MJCF."""

import mujoco
import numpy as np
import pytest

from gvp_lib.simulation.arms import ARMS, ArmSpec

# Universal Robots, "DH parameters for calculations of kinematics and dynamics", UR5e: (a, d, alpha), standard DH.
UR5E = [
    (0.0, 0.1625, np.pi / 2),
    (-0.425, 0.0, 0.0),
    (-0.3922, 0.0, 0.0),
    (0.0, 0.1333, np.pi / 2),
    (0.0, 0.0997, -np.pi / 2),
    (0.0, 0.0996, 0.0),
]

# R. L. Williams II, "Baxter humanoid robot kinematics", 2017: lengths of the seven-joint arm, in its zero posture
# straight ahead; (a, d, alpha, offset of the angle), standard DH. The last d runs to the hand's frame (0.11355 m
# beyond the wrist) instead of to the paper's gripper.
BAXTER = [
    (0.069, 0.27035, -np.pi / 2, 0.0),
    (0.0, 0.0, np.pi / 2, np.pi / 2),
    (0.069, 0.36435, -np.pi / 2, 0.0),
    (0.0, 0.0, np.pi / 2, 0.0),
    (0.010, 0.37429, -np.pi / 2, 0.0),
    (0.0, 0.0, np.pi / 2, 0.0),
    (0.0, 0.229525, 0.0, 0.0),
]
# Rethink Robotics, baxter_description: torso to the axis of right_s0.
TORSO_FROM_SHOULDER = (0.064027, -0.259027, 0.129626, -np.pi / 4)  # x, y, z, yaw


def dh(theta, a, d, alpha):
    c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]])


def ur5e_flange(q, table=UR5E):
    pose = np.eye(4)
    for angle, (a, d, alpha) in zip(q, table, strict=True):
        pose = pose @ dh(angle, a, d, alpha)
    return pose


def baxter_hand(q):
    x, y, z, yaw = TORSO_FROM_SHOULDER
    pose = dh(yaw, 0.0, z, 0.0)
    pose[:2, 3] = x, y
    for angle, (a, d, alpha, offset) in zip(q, BAXTER, strict=True):
        pose = pose @ dh(angle + offset, a, d, alpha)
    return pose


def errors(spec: ArmSpec, table, site: str, n: int = 1000):
    """The largest position error, m, and angle, rad, over random configurations within the limits."""
    model = spec.load().compile()
    data = mujoco.MjData(model)
    joints = [model.joint(name) for name in spec.joints]
    low, high = np.array([joint.range for joint in joints]).T
    rng = np.random.default_rng(0)
    shifts, angles = [], []
    for q in rng.uniform(low, high, (n, len(joints))):
        for joint, angle in zip(joints, q, strict=True):
            data.qpos[joint.qposadr] = angle
        mujoco.mj_kinematics(model, data)
        expected = table(q)
        shifts.append(np.linalg.norm(data.site(site).xpos - expected[:3, 3]))
        difference = data.site(site).xmat.reshape(3, 3).T @ expected[:3, :3]
        # For small angles the antisymmetric part is exact where arccos of the trace is not.
        skew = difference - difference.T
        angles.append(np.arcsin(min(1.0, np.linalg.norm(skew) / np.sqrt(8))) + np.pi * (np.trace(difference) < 1))
    return max(shifts), max(angles)


def test_ur5e_agrees_with_the_published_dh_table():
    shift, angle = errors(ARMS["ur5e"], ur5e_flange, "flange")
    assert shift < 1e-5
    assert angle < np.radians(0.001)


def test_baxter_agrees_with_williams_dh_parameters():
    shift, angle = errors(ARMS["baxter"], baxter_hand, "flange")
    assert shift < 1e-4
    assert angle < np.radians(0.01)


def test_an_upper_arm_longer_by_a_fifth_of_a_millimeter_is_noticed():
    longer = [*UR5E[:1], (-0.4252, 0.0, 0.0), *UR5E[2:]]
    shift, _ = errors(ARMS["ur5e"], lambda q: ur5e_flange(q, longer), "flange", n=20)
    assert shift == pytest.approx(2e-4, rel=1e-3)


@pytest.mark.parametrize("name", ["ur5e", "baxter"])
def test_the_camera_sits_on_the_hands_axis_and_looks_along_it(name):
    model = ARMS[name].load().compile()
    data = mujoco.MjData(model)
    data.qpos[: model.nq] = np.random.default_rng(3).uniform(-1, 1, model.nq) + model.qpos0
    mujoco.mj_forward(model, data)
    hand, camera = data.site("flange"), data.camera("hand_camera")
    axis = hand.xmat.reshape(3, 3)[:, 2]
    offset = camera.xpos - hand.xpos
    assert np.linalg.norm(np.cross(axis, offset)) < 1e-9
    assert offset @ axis > 0
    assert -camera.xmat.reshape(3, 3)[:, 2] == pytest.approx(axis, abs=1e-9)
