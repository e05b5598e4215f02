"""The solver behind a camera in a hand, and a home that is solved for."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import UnreachableError
from gvp_lib.simulation.arms import ARMS
from gvp_lib.simulation.kinematics import looking_down
from gvp_lib.simulation.workcell import WorkCell


@pytest.fixture(params=ARMS)
def arm(request, kinematics_of):
    """Home of an arm, and its kinematics."""
    spec = ARMS[request.param]
    return np.array(spec.home), kinematics_of(spec)


@pytest.fixture
def ur5e(kinematics_of):
    return np.array(ARMS["ur5e"].home), kinematics_of(ARMS["ur5e"])


def assert_solves(ik, q, pose):
    low, high = ik.limits
    assert ((q >= low) & (q <= high)).all()
    off = ik.forward(q).inv() * pose
    assert np.linalg.norm(off.translation) < 1.01e-4
    assert off.rotation.magnitude() < np.radians(0.0505)


@pytest.mark.parametrize("n", [200, pytest.param(1000, marks=pytest.mark.full)])
def test_reachable_poses_are_solved_within_limits_and_tolerance_and_others_are_not(arm, n):
    home, ik = arm
    solved = 0
    for seed, reachable in enumerate(np.random.default_rng(0).uniform(*ik.limits, (n, home.size))):
        pose = ik.forward(reachable)
        q = ik.solve_any(pose, home, rng=seed)
        if q is not None:
            assert_solves(ik, q, pose)
            solved += 1
    assert solved >= 0.995 * n
    assert ik.solve_any(RigidTransform.from_translation([3.0, 0.0, 0.3]), home, restarts=3) is None


def test_a_pose_20_mm_away_is_solved_from_home_without_restarts_by_small_joint_moves(arm):
    home, ik = arm
    rng = np.random.default_rng(2)
    for _ in range(100):
        turn = Rotation.from_rotvec(rng.normal(0, 0.03, 3))
        pose = ik.forward(home) * RigidTransform.from_components(rng.uniform(-0.012, 0.012, 3), turn)
        q = ik.solve(pose, home)
        assert_solves(ik, q, pose)
        assert np.abs(q - home).max() < 0.4


def test_no_joint_is_wound_up_by_whole_turns(ur5e):
    home, ik = ur5e
    wound = home + 2 * np.pi * np.array([1, 0, 0, 1, -1, -1])
    assert ik.solve_any(ik.forward(wound), home) == pytest.approx(home, abs=1e-3)


def test_accept_decides_among_solutions(ur5e):
    home, ik = ur5e
    pose = ik.forward(home)
    assert np.sin(home[4]) > 0
    flipped = ik.solve_any(pose, home, accept=lambda q: np.sin(q[4]) < 0)
    assert np.sin(flipped[4]) < 0
    assert_solves(ik, flipped, pose)


def test_a_pose_that_is_asked_for_again_is_the_one_at_those_joints(ur5e):
    home, ik = ur5e
    q = home.copy()
    pose = ik.forward(q).as_matrix()
    assert ik.solve(ik.forward(q) * RigidTransform.from_translation([0.0, 0.0, 0.02]), q) is not None
    np.testing.assert_array_equal(ik.forward(q).as_matrix(), pose)
    q[-1] += 0.1  # the array of before, with other angles in it
    assert np.abs(ik.forward(q).as_matrix() - pose).max() > 0.05


def test_a_joint_that_is_not_named_stays_where_it_is(kinematics_of):
    spec = ARMS["baxter"]
    ik = kinematics_of(replace(spec, joints=spec.joints[1:], home=spec.home[1:], joint_speed=1.0))
    target = ik.forward(spec.home[1:]) * RigidTransform.from_translation([0.01, -0.02, 0.015])
    assert_solves(kinematics_of(spec), np.array([0.0, *ik.solve(target, spec.home[1:])]), target)


STRAIGHT, BENT = (f'name="elbow" range="-3.1416 {most}"' for most in (3.1416, -0.2))  # rad


@pytest.mark.parametrize("elbow", [STRAIGHT, BENT], ids=["zero is in every range", "zero is outside the elbow's"])
def test_from_there_the_camera_looks_down_on_the_middle_of_the_workspace_and_nothing_touches(elbow):
    mjcf = ARMS["ur5e"].mjcf.read_text().replace(STRAIGHT, elbow)
    arm = looking_down(replace(ARMS["ur5e"], mjcf=mjcf, home=(0.0,) * 6), height=0.4)
    with WorkCell(arm, "cuboid_1x1", seed=1) as cell:
        pose = cell.truth.world_from_camera
        np.testing.assert_allclose(pose.translation, [0.5, 0.0, 0.4], atol=1e-3)
        np.testing.assert_allclose(pose.rotation.as_matrix(), [[0, -1, 0], [-1, 0, 0], [0, 0, -1]], atol=2e-3)
        assert not len(cell._drive.contacts())


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"workspace": ((2.0, 2.1), (-0.1, 0.1))}, "no joint angles within its limits.*nearer to the base"),
        ({"workspace": ((0.22, 0.3), (-0.1, 0.1)), "table_height": 0.17}, "'shoulder' touches 'table'.*<exclude"),
    ],
)
def test_where_there_is_no_home_the_error_says_what_is_in_the_way(changes, text):
    with pytest.raises(UnreachableError, match=text):
        looking_down(replace(ARMS["ur5e"], **changes))
