"""Sighting, motions, centering, depth and arcs on the simulated arms, with noise and without."""

from itertools import product

import numpy as np
import pytest
from arc_checks import check_order
from cells import Cells
from eye_in_hand import CAMERA
from scipy.spatial.transform import RigidTransform

from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.motion.arc import approach, traverse_arc
from gvp_lib.motion.arm import Outcome
from gvp_lib.motion.centering import align_with_major_axis, center_on_object
from gvp_lib.motion.primitives import estimate_depth, planar_step, roll, toward_pixel
from gvp_lib.motion.sighting import Eye
from gvp_lib.perception.segmentation import HsvThreshold
from gvp_lib.simulation.objects import ObjectSpec
from gvp_lib.simulation.sensors import Noise

ARMS = ["floating", "ur5e", "baxter"]
TARGETS = ["cuboid_1x2", "cylinder", "alligator", "tomato_soup_box"]
NOISES = {"clean": Noise.none(), "noisy": Noise.thesis()}
BALL = ObjectSpec(
    "ball",
    '<mujoco><worldbody><body><geom type="sphere" size="0.006" rgba="0.8 0.05 0.05 1"/></body></worldbody></mujoco>',
    HsvThreshold(hue=(345, 15), saturation=(0.45, 1), value=(0.08, 1)),
)


def full_but(often, *sides):
    """All combinations; those that are not tested often are for the slowest tier."""
    return [each if each in often else pytest.param(*each, marks=pytest.mark.full) for each in product(*sides)]


@pytest.fixture(scope="module")
def cell_of():
    """A cell at the beginning of the episode of a seed, by its arm, object and noise."""
    cells = Cells()
    yield lambda arm, target="cuboid_1x2", noise="clean", **more: cells(arm, target, noise=NOISES[noise], **more)
    cells.close()


def stand(cell, tilt_deg=0.0, azimuth_deg=180.0, roll_deg=0.0, radius=0.3, offset=(0.0, 0.0)):
    """The cell's camera near its object, which shows ``offset`` px from the middle; an eye that looks through it."""
    sphere = VirtualSphere(cell.truth.world_from_object.translation, radius)
    aimed = sphere.viewpoint(*np.radians([tilt_deg, azimuth_deg, roll_deg]))
    away = toward_pixel(CAMERA, CAMERA.principal_point - offset)
    cell.place_camera(aimed * RigidTransform.from_rotation(away))
    return Eye(cell.arm, cell.segmenter)


def centered(cell, tilt_deg=0.0, radius=0.25):
    """An eye from where an arc begins."""
    eye = stand(cell, tilt_deg, azimuth_deg=0.0, radius=radius)
    assert center_on_object(eye)
    return eye


def test_a_roll_that_the_wrist_cannot_make_is_the_whole_arms(cell_of):
    baxter = cell_of("baxter")
    arm, (_, limit) = baxter.arm, baxter.model.joint("arm/right_w2").range
    start = np.append(arm.joints[:-1], limit - 0.02)
    assert arm.move_joints(start)
    beyond = -0.1 if arm.rotate_wrist(0.01) and arm.joints[-1] < start[-1] else 0.1  # rad
    assert arm.move_joints(start)
    before = arm.camera_pose()
    assert arm.rotate_wrist(beyond).reason is Outcome.JOINT_LIMIT
    np.testing.assert_array_equal(arm.joints, start)
    assert roll(arm, beyond)
    np.testing.assert_allclose((before.inv() * arm.camera_pose()).rotation.as_rotvec(), [0, 0, beyond], atol=1e-3)


# Centering


CORNERS = [
    ("floating", "cuboid_1x2", "clean"), ("floating", "cylinder", "noisy"),
    ("ur5e", "cuboid_1x2", "clean"), ("baxter", "cuboid_1x2", "noisy"),
]  # fmt: skip


@pytest.mark.parametrize(("arm", "target", "noise"), full_but(CORNERS, ARMS, TARGETS, NOISES))
def test_from_100_px_off_the_object_is_within_2_px_in_at_most_4_frames(arm, target, noise, cell_of):
    for seed in range(4):
        angle = 2 * np.pi * seed / 4 + 0.3
        offset = 100 * np.array([np.cos(angle), np.sin(angle)])
        eye = stand(cell_of(arm, target, noise, seed=seed), tilt_deg=12, roll_deg=10 * seed, offset=offset)
        centering = center_on_object(eye)
        assert centering
        assert 80 < np.linalg.norm(centering.offsets[0]) < 125
        assert np.abs(centering.offsets[-1]).max() < 2
        assert len(centering.offsets) == eye.looks <= 4


@pytest.mark.parametrize(("noise", "within_deg"), [("clean", 1.5), ("noisy", 3)])
def test_the_wrist_joint_alone_aligns_on_the_baxter(noise, within_deg, cell_of):
    for seed, roll_deg in enumerate((-70, -15, 10, 40)):
        baxter = cell_of("baxter", noise=noise, seed=seed)
        eye = stand(baxter, roll_deg=roll_deg)
        before = baxter.arm.joints
        aligned = align_with_major_axis(eye)
        assert aligned
        assert len(aligned.angles) <= 2
        assert abs(aligned.angles[-1]) < np.radians(1)
        assert abs(np.degrees(baxter.truth.roll_error())) < within_deg
        assert np.abs(baxter.arm.joints - before)[:-1].max() < 1e-12


def test_where_the_wrists_limit_forbids_the_smaller_roll_it_takes_the_other(cell_of):
    turns = []
    for seed in range(3):
        baxter = cell_of("baxter", seed=seed)
        low, high = baxter.model.joint("arm/right_w2").range
        for limit in (low + 0.02, high - 0.02):
            eye = stand(baxter)
            assert baxter.arm.move_joints(np.append(baxter.arm.joints[:-1], limit))
            before = baxter.arm.joints
            aligned = align_with_major_axis(eye, view=eye.look())
            assert aligned
            *others, turned = baxter.arm.joints - before
            assert np.abs(others).max() < 1e-12
            # Away from the limit, by the smaller roll or, where that one leads beyond it, by its supplement.
            assert np.sign(turned) == -np.sign(limit)
            smaller = abs(aligned.angles[0])
            assert min(abs(abs(turned) - smaller), abs(abs(turned) - (np.pi - smaller))) < np.radians(1.5)
            turns.append(abs(turned))
    assert min(turns) < np.pi / 2 < max(turns)  # both cases occur


@pytest.mark.parametrize("target", ["cuboid_1x1", "cylinder"])
def test_a_square_or_a_disc_seen_straight_on_keeps_the_roll(target, cell_of):
    cell = cell_of("floating", target, seed=1)
    eye = stand(cell, roll_deg=20)
    before = cell.arm.joints
    aligned = align_with_major_axis(eye)
    np.testing.assert_array_equal(cell.arm.joints, before)
    assert not aligned.defined


# Depth


@pytest.mark.parametrize(
    ("arm", "noise"), full_but([("floating", "clean"), ("floating", "noisy")], ["floating", "baxter"], NOISES)
)
def test_the_median_depth_of_a_ball_is_right_within_2_percent_and_5_under_the_thesiss_noise(arm, noise, cell_of):
    trials, tolerance = (12, 0.02) if noise == "clean" else (30, 0.05)
    errors = []
    for seed in range(trials):
        cell, rng = cell_of(arm, BALL, noise, seed=seed), np.random.default_rng(seed)
        ball = cell.truth.world_from_object.translation
        places = rng.uniform(0, 0.3), rng.uniform(1.5, 4.5), rng.uniform(-0.5, 0.5)
        cell.place_camera(VirtualSphere(ball, 0.25).viewpoint(*places))
        eye, direction = Eye(cell.arm, cell.segmenter), rng.uniform(0, 2 * np.pi)
        first, motion, second = eye.look(), planar_step(cell.arm, 0.02, direction), eye.look()
        assert motion
        shift = 0.02 * np.array([np.cos(direction), -np.sin(direction), 0])
        estimate = estimate_depth(cell.arm.intrinsics, shift, first.blob.centroid, second.blob.centroid)
        errors.append(estimate / cell.truth.world_from_camera.inv().apply(ball)[2] - 1)
    assert abs(np.median(errors)) < tolerance
    assert np.median(np.abs(errors)) < tolerance
    assert np.abs(errors).max() < 3 * tolerance


# Arcs


@pytest.mark.parametrize(("arm", "noise"), full_but([("floating", "clean"), ("baxter", "noisy")], ARMS, NOISES))
def test_the_true_radius_is_held_and_every_view_centered_on_every_arm(arm, noise, cell_of):
    cell, places = cell_of(arm, noise=noise, seed=0), []
    eye = centered(cell, tilt_deg=20)
    arc = traverse_arc(eye, enough=lambda views: bool(places.append(cell.truth.world_from_camera.translation)))
    assert len(arc) > 10
    radii = np.linalg.norm(places - cell.truth.world_from_object.translation, axis=1)
    np.testing.assert_allclose(radii, 0.25, rtol=0.04 if noise == "clean" else 0.08)
    np.testing.assert_allclose([view.blob.centroid - CAMERA.principal_point for view in arc.views], 0, atol=2)


@pytest.mark.parametrize(
    ("arm", "axis", "ends"),
    [
        ("ur5e", "y", (Outcome.COLLISION, Outcome.UNREACHABLE)),
        ("baxter", "y", (Outcome.COLLISION, Outcome.JOINT_LIMIT)),
        pytest.param("ur5e", "x", (Outcome.COLLISION, Outcome.COLLISION), marks=pytest.mark.full),
        pytest.param("baxter", "x", (Outcome.UNREACHABLE, Outcome.JOINT_LIMIT), marks=pytest.mark.full),
    ],
)
def test_a_real_arm_ends_at_its_limits_and_at_the_table_and_returns(arm, axis, ends, cell_of):
    cell = cell_of(arm, "cuboid_1x4", seed=0)
    eye, move = centered(cell), cell.arm.move_joints
    before = cell.arm.joints
    arc = traverse_arc(eye, axis, max_angle=np.radians(120))
    assert arc.ends == ends
    check_order(arc)
    np.testing.assert_allclose(cell.arm.joints, before, atol=1e-12)
    # What it says was really in the way: from the last view of each side the next step fails for the same reason.
    for sign, end, side in ((-1, ends[0], arc.views[arc.center :: -1]), (1, ends[1], arc.views[arc.center :])):
        assert all(move(joints) for joints in (before, *(view.joints for view in side)))
        step = [0.0, sign * 0.02, 0.0] if axis == "y" else [sign * 0.02, 0.0, 0.0]
        motion = cell.arm.move_camera(RigidTransform.from_translation(step))
        if motion:  # then it was the turn back toward the object
            away = toward_pixel(CAMERA, eye.look().blob.centroid)
            motion = cell.arm.move_camera(RigidTransform.from_rotation(away))
        assert motion.reason is end
        for view in side[::-1]:
            move(view.joints)


@pytest.mark.parametrize("arm", ARMS)
def test_the_approach_works_on_every_arm_under_the_thesiss_noise(arm, cell_of):
    for seed in range(2):
        cell = cell_of(arm, noise="noisy", seed=seed)
        assert approach(centered(cell, radius=0.32), 0.25).motion
        away = cell.truth.world_from_camera.translation - cell.truth.world_from_object.translation
        assert np.linalg.norm(away) == pytest.approx(0.25, rel=0.1)
