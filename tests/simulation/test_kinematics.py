"""Joint angles and poses: our models against published tables, written out here independently of the MJCF; the solver;
and a home that is solved for."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError, UnreachableError
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.simulation.arms import ARMS, ArmSpec
from gvp_lib.simulation.kinematics import InverseKinematics, looking_down
from gvp_lib.simulation.workcell import WorkCell

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


@pytest.fixture(scope="module", params=["ur5e", "baxter"])
def arm(request):
    spec = ARMS[request.param]
    return spec, InverseKinematics(spec)


def apart(a: RigidTransform, b: RigidTransform) -> tuple[float, float]:
    """Distance, m, and angle, rad, between two poses."""
    return np.linalg.norm(a.translation - b.translation), (a.rotation.inv() * b.rotation).magnitude()


def assert_solves(ik, q, pose):
    low, high = ik.limits
    assert ((q >= low) & (q <= high)).all()
    shift, angle = apart(ik.forward(q), pose)
    assert shift < 1.01e-4
    assert angle < np.radians(0.0505)


@pytest.mark.parametrize("n", [200, pytest.param(1000, marks=pytest.mark.full)])
def test_reachable_poses_are_solved_within_limits_and_tolerance(arm, n):
    spec, ik = arm
    low, high = ik.limits
    solved = 0
    for seed, reachable in enumerate(np.random.default_rng(0).uniform(low, high, (n, low.size))):
        pose = ik.forward(reachable)
        q = ik.solve_any(pose, spec.home, rng=seed)
        if q is not None:
            assert_solves(ik, q, pose)
            solved += 1
    assert solved >= 0.995 * n


def test_every_viewpoint_of_the_30_degree_cap_is_solved_for_the_ur5e():
    spec = ARMS["ur5e"]
    ik = InverseKinematics(spec)
    rng = np.random.default_rng(1)
    for radius in (0.3, 0.4):
        poses = VirtualSphere([0.5, 0.0, 0.05], radius).random(100, rng, sigma=None)
        for i in range(100):
            q = ik.solve_any(poses[i], spec.home, rng=i)
            assert q is not None
            assert_solves(ik, q, poses[i])


def test_a_pose_20_mm_away_is_solved_from_home_without_restarts_by_small_joint_moves(arm):
    spec, ik = arm
    rng = np.random.default_rng(2)
    home = ik.forward(spec.home)
    for _ in range(100):
        step = RigidTransform.from_components(
            rng.uniform(-0.012, 0.012, 3), Rotation.from_rotvec(rng.normal(0, 0.03, 3))
        )
        q = ik.solve(home * step, spec.home)
        assert_solves(ik, q, home * step)
        assert np.abs(q - spec.home).max() < 0.4


@pytest.mark.parametrize("position", [(3.0, 0.0, 0.3), (0.5, 0.0, -2.0)])
def test_an_unreachable_pose_gives_none(arm, position):
    spec, ik = arm
    pose = RigidTransform.from_components(position, ik.forward(spec.home).rotation)
    assert ik.solve(pose, spec.home) is None
    assert ik.solve_any(pose, spec.home, restarts=3) is None


def test_the_same_seed_gives_the_same_solution(arm):
    spec, ik = arm
    low, high = ik.limits
    pose = ik.forward(np.random.default_rng(12).uniform(low, high))
    first, again = (ik.solve_any(pose, spec.home, rng=5) for _ in range(2))
    assert np.array_equal(first, again)


def test_no_joint_is_wound_up_by_whole_turns():
    spec = ARMS["ur5e"]
    ik = InverseKinematics(spec)
    wound = np.array(spec.home) + 2 * np.pi * np.array([1, 0, 0, 1, -1, -1])
    q = ik.solve_any(ik.forward(wound), spec.home)
    assert q == pytest.approx(spec.home, abs=1e-3)


def test_accept_decides_among_solutions():
    spec = ARMS["ur5e"]
    ik = InverseKinematics(spec)
    pose = ik.forward(spec.home)
    assert np.sin(spec.home[4]) > 0
    flipped = ik.solve_any(pose, spec.home, accept=lambda q: np.sin(q[4]) < 0)
    assert np.sin(flipped[4]) < 0
    assert_solves(ik, flipped, pose)
    assert ik.solve_any(pose, spec.home, restarts=2, accept=lambda q: False) is None


def test_misuse_is_explained(arm):
    spec, ik = arm
    with pytest.raises(InvalidParameterError, match=f"{len(spec.joints)} finite numbers"):
        ik.forward([0.0, 1.0])


def test_a_pose_that_is_asked_for_again_is_the_one_at_those_joints(arm):
    spec, ik = arm
    q = np.array(spec.home)
    home = ik.forward(q).as_matrix()
    assert ik.solve(ik.forward(q) * RigidTransform.from_translation([0.0, 0.0, 0.02]), q) is not None
    np.testing.assert_array_equal(ik.forward(q).as_matrix(), home)
    q[-1] += 0.1  # the array of before, with other angles in it
    assert np.abs(ik.forward(q).as_matrix() - home).max() > 0.05
    np.testing.assert_array_equal(ik.forward(spec.home).as_matrix(), home)


def test_a_joint_that_is_not_named_stays_where_it_is():
    spec = ARMS["baxter"]
    ik = InverseKinematics(replace(spec, joints=spec.joints[1:], home=spec.home[1:], joint_speed=1.0))
    home = ik.forward(spec.home[1:])
    target = home * RigidTransform.from_translation([0.01, -0.02, 0.015])
    q = ik.solve(target, spec.home[1:])
    whole = InverseKinematics(spec)
    shift, _ = apart(whole.forward([0.0, *q]), target)
    assert shift < 1.01e-4


def test_from_there_the_camera_looks_down_on_the_middle_of_the_workspace_and_nothing_touches():
    arm = looking_down(replace(ARMS["ur5e"], home=(0.0,) * 6), height=0.4)
    cell = WorkCell(arm, "cuboid_1x1", seed=1)
    pose = cell.truth.world_from_camera
    np.testing.assert_allclose(pose.translation, [0.5, 0.0, 0.4], atol=1e-3)
    np.testing.assert_allclose(pose.rotation.as_matrix(), [[0, -1, 0], [-1, 0, 0], [0, 0, -1]], atol=2e-3)
    assert not len(cell._holder.drive.contacts())
    cell.close()


def test_a_workspace_out_of_reach_is_refused_with_what_would_work():
    with pytest.raises(UnreachableError, match=r"no joint angles within its limits put it there.*nearer to the base"):
        looking_down(replace(ARMS["ur5e"], workspace=((2.0, 2.1), (-0.1, 0.1))))


OVERLAPPING = """
<mujoco><compiler angle="degree" autolimits="true"/>
  <default><joint axis="0 1 0" range="-170 170"/><geom type="capsule" size="0.03"/></default>
  <worldbody>
    <geom name="base" type="cylinder" size="0.08 0.04" pos="0 0 0.04"/>
    <body name="turret" pos="0 0 0.10"><joint name="j1" axis="0 0 1"/><geom fromto="0 0 0 0 0 0.02"/>
    <body name="upper" pos="0 0 0.1"><joint name="j2"/><geom fromto="0 0 0.06 0 0 0.34"/>
    <body name="fore" pos="0 0 0.4"><joint name="j3"/><geom fromto="0 0 0.06 0 0 0.2"/>
    <body name="roll" pos="0 0 0.26"><joint name="j4" axis="0 0 1"/><geom fromto="0 0 0 0 0 0.08"/>
    <body name="bend" pos="0 0 0.14"><joint name="j5"/><geom type="sphere"/>
    <body name="flange" pos="0 0 0.08"><joint name="j6" axis="0 0 1"/><geom type="sphere" size="0.02"/>
    </body></body></body></body></body></body>
  </worldbody>
</mujoco>"""


def test_links_that_overlap_wherever_the_arm_stands_are_named():
    joints = ("j1", "j2", "j3", "j4", "j5", "j6")
    mount = ("flange", RigidTransform.identity())
    arm = ArmSpec("six", OVERLAPPING, camera="eye", camera_mount=mount, joints=joints, home=(0.0,) * 6)
    with pytest.raises(UnreachableError, match=r"'turret' touches 'world'.*<exclude"):
        looking_down(arm)
