import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError, ModelError
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.simulation.arms import ARMS
from gvp_lib.simulation.kinematics import InverseKinematics


@pytest.fixture(scope="module", params=["ur5e", "baxter"])
def arm(request):
    spec = ARMS[request.param]
    return spec, InverseKinematics(spec.kinematic_model(), spec.camera, spec.joints)


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
    ik = InverseKinematics(spec.kinematic_model(), spec.camera, spec.joints)
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
    ik = InverseKinematics(spec.kinematic_model(), spec.camera, spec.joints)
    wound = np.array(spec.home) + 2 * np.pi * np.array([1, 0, 0, 1, -1, -1])
    q = ik.solve_any(ik.forward(wound), spec.home)
    assert q == pytest.approx(spec.home, abs=1e-3)


def test_accept_decides_among_solutions():
    spec = ARMS["ur5e"]
    ik = InverseKinematics(spec.kinematic_model(), spec.camera, spec.joints)
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
    with pytest.raises(ModelError, match=r"no camera 'eye'.*hand_camera"):
        InverseKinematics(spec.kinematic_model(), "eye", spec.joints)
    with pytest.raises(ModelError, match=rf"no joint 'knee'.*{spec.joints[0]}"):
        InverseKinematics(spec.kinematic_model(), spec.camera, ("knee",))


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
    ik = InverseKinematics(spec.kinematic_model(), spec.camera, spec.joints[1:])
    home = ik.forward(spec.home[1:])
    target = home * RigidTransform.from_translation([0.01, -0.02, 0.015])
    q = ik.solve(target, spec.home[1:])
    whole = InverseKinematics(spec.kinematic_model(), spec.camera, spec.joints)
    shift, _ = apart(whole.forward([0.0, *q]), target)
    assert shift < 1.01e-4
