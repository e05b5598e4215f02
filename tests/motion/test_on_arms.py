"""Sighting, motions, centering, depth and arcs on the simulated arms, with noise and without."""

from itertools import product

import numpy as np
import pytest
from arc_checks import check_never_leaps, check_order
from eye_in_hand import CAMERA
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.motion.arc import ArcEnd, approach, traverse_arc
from gvp_lib.motion.arm import StopReason
from gvp_lib.motion.centering import align_with_major_axis, center_on_object
from gvp_lib.motion.primitives import (
    advance,
    estimate_depth,
    pitch,
    planar_step,
    planar_vector,
    roll,
    toward_pixel,
    turn,
    yaw,
)
from gvp_lib.motion.sighting import Eye
from gvp_lib.perception.moments import Blob
from gvp_lib.perception.segmentation import HsvThreshold
from gvp_lib.simulation.objects import ObjectSpec
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.workcell import WorkCell

ARMS = ["floating", "ur5e", "baxter"]
TARGETS = ["cuboid_1x2", "cylinder", "alligator", "tomato_soup_box"]
CLEAN, NOISY = Noise.none(), Noise.thesis()
CORNERS = [
    ("floating", "cuboid_1x2", CLEAN),
    ("floating", "cylinder", NOISY),
    ("ur5e", "cuboid_1x2", CLEAN),
    ("baxter", "cuboid_1x2", NOISY),
]  # of centering, the others being for the slowest tier
BALL = ObjectSpec(
    "ball",
    '<mujoco><worldbody><body><geom type="sphere" size="0.006" rgba="0.8 0.05 0.05 1"/></body></worldbody></mujoco>',
    HsvThreshold(hue=(345, 15), saturation=(0.45, 1), value=(0.08, 1)),
)


def full(*values):
    return pytest.param(*values, marks=pytest.mark.full)


@pytest.fixture(scope="module")
def cells():
    made = {}
    yield made
    for cell in made.values():
        cell.close()


@pytest.fixture
def cell_of(cells):
    """A cell by its arm, object and noise, built once, at the beginning of the episode of a seed."""

    def get(arm, target="cuboid_1x2", noise=CLEAN, seed=3, **options):
        key = arm, getattr(target, "name", target), noise, *options
        if key not in cells:
            cells[key] = WorkCell(arm, target, noise=noise, **options)
        cells[key].reset(seed)
        return cells[key]

    return get


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


# A look, and the four motions


def test_the_joints_of_a_view_are_its_own_and_read_only(cell_of):
    cell = cell_of("ur5e")
    view = Eye(cell.arm, cell.segmenter).look()
    before = view.joints.copy()
    cell.arm.rotate_wrist(0.1)
    np.testing.assert_array_equal(view.joints, before)
    with pytest.raises(ValueError, match="read-only"):
        view.joints[0] = 0


@pytest.mark.parametrize("arm", ARMS)
def test_the_arms_believe_that_they_moved_as_told(arm, cell_of):
    cell = cell_of(arm)
    for motion, expected in (
        (lambda a: planar_step(a, 0.02, 0.5), RigidTransform.from_translation(planar_vector(0.02, 0.5))),
        (lambda a: advance(a, 0.02), RigidTransform.from_translation([0, 0, 0.02])),
        (lambda a: yaw(a, 0.1), turn([0, 0.1, 0])),
        (lambda a: pitch(a, 0.1), turn([0.1, 0, 0])),
        (lambda a: roll(a, 0.1), turn([0, 0, 0.1])),
    ):
        before = cell.arm.camera_pose()
        assert motion(cell.arm).reason is StopReason.REACHED
        difference = expected.inv() * before.inv() * cell.arm.camera_pose()
        assert np.linalg.norm(difference.translation) < 1e-4
        assert difference.rotation.magnitude() < 1e-3


def test_a_roll_is_the_wrist_joints_alone(cell_of):
    arm = cell_of("baxter").arm
    before = arm.joints
    assert roll(arm, 0.4)
    change = np.abs(arm.joints - before)
    assert change[:-1].max() < 1e-12
    assert change[-1] == pytest.approx(0.4)


def test_a_roll_that_the_wrist_cannot_make_is_the_whole_arms_or_says_that_it_failed(cell_of):
    baxter = cell_of("baxter")
    limit = baxter.model.joint("arm/right_w2").range[1]
    at_limit = np.append(baxter.arm.joints[:-1], limit - 0.02)
    assert baxter.arm.move_joints(at_limit)
    before, sense = baxter.arm.camera_pose(), wrist_sense(baxter.arm)
    assert baxter.arm.rotate_wrist(sense * 0.1).reason is StopReason.JOINT_LIMIT
    np.testing.assert_array_equal(baxter.arm.joints, at_limit)
    motion = roll(baxter.arm, sense * 0.1)
    turned = (before.inv() * baxter.arm.camera_pose()).rotation.as_rotvec()
    if motion:
        np.testing.assert_allclose(turned, [0, 0, sense * 0.1], atol=1e-3)
    else:
        assert motion.reason is StopReason.JOINT_LIMIT


def wrist_sense(arm):
    """+1 where a positive roll raises the last joint's angle."""
    before = arm.joints[-1]
    assert arm.rotate_wrist(-0.01) or arm.rotate_wrist(0.01)
    rose = arm.joints[-1] - before
    sense = -1 if rose > 0 else 1
    arm.move_joints(np.append(arm.joints[:-1], before))
    return sense


def test_a_distance_that_is_no_number_is_refused(cell_of):
    with pytest.raises(InvalidParameterError, match="not finite"):
        planar_step(cell_of("floating").arm, np.nan, 0.0)


# Centering


@pytest.mark.parametrize(
    ("arm", "target", "noise"),
    [each if each in CORNERS else full(*each) for each in product(ARMS, TARGETS, (CLEAN, NOISY))],
    ids=lambda value: {CLEAN: "clean", NOISY: "noisy"}.get(value, value),
)
def test_from_100_px_off_the_object_is_within_2_px_in_at_most_4_frames(arm, target, noise, cell_of):
    for seed in range(4):
        cell = cell_of(arm, target, noise, seed)
        angle = 2 * np.pi * seed / 4 + 0.3
        eye = stand(cell, tilt_deg=12, roll_deg=10 * seed, offset=100 * np.array([np.cos(angle), np.sin(angle)]))
        centering = center_on_object(eye)
        assert centering
        assert 80 < np.linalg.norm(centering.offsets[0]) < 125
        assert np.abs(centering.offsets[-1]).max() < 2
        assert len(centering.offsets) == eye.looks <= 4


def test_shifting_works_on_an_arm(cell_of):
    baxter = cell_of("baxter")
    eye = stand(baxter, offset=(60, -40))
    before = baxter.arm.camera_pose().rotation
    assert center_on_object(eye, by="shifting", depth=0.3)
    assert (before.inv() * baxter.arm.camera_pose().rotation).magnitude() < 1e-3


@pytest.mark.parametrize("roll_deg", [-70, 40])
def test_the_wrist_joint_alone_aligns_on_the_baxter(roll_deg, cell_of):
    baxter = cell_of("baxter")
    eye = stand(baxter, roll_deg=roll_deg)
    before = baxter.arm.joints
    aligned = align_with_major_axis(eye)
    assert aligned
    assert abs(np.degrees(baxter.truth.roll_error())) < 1.5
    assert np.abs(baxter.arm.joints - before)[:-1].max() < 1e-12
    assert len(aligned.angles) <= 2


def test_alignment_on_a_noisy_baxter_ends_within_its_tolerance(cell_of):
    for seed in range(4):
        cell = cell_of("baxter", noise=NOISY, seed=seed)
        aligned = align_with_major_axis(stand(cell, roll_deg=25 * seed - 40))
        assert aligned
        assert abs(aligned.angles[-1]) < np.radians(1)


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
            turned = baxter.arm.joints - before
            assert np.abs(turned[:-1]).max() < 1e-12
            # Away from the limit, by the smaller roll or, where that one leads beyond it, by its supplement.
            assert np.sign(turned[-1]) == -np.sign(limit)
            smaller = abs(aligned.angles[0])
            assert min(abs(abs(turned[-1]) - smaller), abs(abs(turned[-1]) - (np.pi - smaller))) < np.radians(1.5)
            turns.append(abs(turned[-1]))
    assert min(turns) < np.pi / 2 < max(turns)  # both cases occur


@pytest.mark.parametrize("target", ["cuboid_1x1", "cylinder"])
def test_a_square_or_a_disc_seen_straight_on_keeps_the_roll(target, cell_of):
    cell = cell_of("floating", target, seed=1)
    eye = stand(cell, roll_deg=20)
    before = cell.arm.joints
    aligned = align_with_major_axis(eye)
    np.testing.assert_array_equal(cell.arm.joints, before)
    assert not aligned.defined
    assert not aligned.aligned
    assert aligned.view is not None
    assert np.isnan(aligned.angles).all()
    assert len(aligned.angles) == 1


# Depth


def errors_over_trials(cell, trials, radius=0.25):
    """Relative error of the depth of a ball at random viewpoints, shape (trials,)."""
    errors = []
    for seed in range(trials):
        cell.reset(seed)
        rng = np.random.default_rng(seed)
        ball = cell.truth.world_from_object.translation
        cell.place_camera(
            VirtualSphere(ball, radius).viewpoint(rng.uniform(0, 0.3), rng.uniform(1.5, 4.5), rng.uniform(-0.5, 0.5))
        )
        eye, direction = Eye(cell.arm, cell.segmenter), rng.uniform(0, 2 * np.pi)
        first, motion, second = eye.look(), planar_step(cell.arm, 0.02, direction), eye.look()
        assert first is not None
        assert motion
        assert second is not None
        shift = 0.02 * np.array([np.cos(direction), -np.sin(direction), 0])
        estimate = estimate_depth(cell.arm.intrinsics, shift, first.blob.centroid, second.blob.centroid)
        errors.append(estimate / cell.truth.world_from_camera.inv().apply(ball)[2] - 1)
    return np.array(errors)


@pytest.mark.parametrize(
    ("arm", "noise", "trials", "tolerance"),
    [
        ("floating", CLEAN, 12, 0.02),
        ("floating", NOISY, 30, 0.05),
        full("baxter", CLEAN, 12, 0.02),
        full("baxter", NOISY, 24, 0.05),
    ],
    ids=["floating, clean", "floating, noisy", "baxter, clean", "baxter, noisy"],
)
def test_the_median_depth_of_a_ball_is_right_within_2_percent_and_5_under_the_thesiss_noise(
    arm, noise, trials, tolerance, cell_of
):
    errors = errors_over_trials(cell_of(arm, BALL, noise), trials)
    assert abs(np.median(errors)) < tolerance
    assert np.median(np.abs(errors)) < tolerance
    assert np.abs(errors).max() < 3 * tolerance


# Arcs


def test_every_view_of_an_arc_is_centered(cell_of):
    floating = cell_of("floating", seed=0)
    for view in traverse_arc(centered(floating, tilt_deg=20)).views:
        assert np.abs(view.blob.centroid - floating.arm.intrinsics.principal_point).max() < 2


@pytest.mark.parametrize(
    ("arm", "noise"),
    [
        ("floating", CLEAN),
        ("baxter", NOISY),
        full("ur5e", CLEAN),
        full("baxter", CLEAN),
        full("floating", NOISY),
        full("ur5e", NOISY),
    ],
    ids=lambda value: {CLEAN: "clean", NOISY: "noisy"}.get(value, value),
)
def test_the_true_radius_is_held_on_every_arm(arm, noise, cell_of):
    cell, places = cell_of(arm, noise=noise, seed=0), []
    arc = traverse_arc(
        centered(cell), enough=lambda views: bool(places.append(cell.truth.world_from_camera.translation))
    )
    radii = [np.linalg.norm(place - cell.truth.world_from_object.translation) for place in places]
    assert len(arc) > 10
    np.testing.assert_allclose(radii, 0.25, rtol=0.04 if noise == CLEAN else 0.08)


@pytest.mark.parametrize(
    ("arm", "axis", "ends"),
    [
        ("ur5e", "y", (ArcEnd.COLLISION, ArcEnd.UNREACHABLE)),
        full("ur5e", "x", (ArcEnd.COLLISION, ArcEnd.COLLISION)),
        ("baxter", "y", (ArcEnd.COLLISION, ArcEnd.JOINT_LIMIT)),
        full("baxter", "x", (ArcEnd.UNREACHABLE, ArcEnd.JOINT_LIMIT)),
    ],
)
def test_a_real_arm_ends_at_its_limits_and_at_the_table_and_returns(arm, axis, ends, cell_of):
    cell = cell_of(arm, "cuboid_1x4", seed=0)
    eye = centered(cell)
    before = cell.arm.joints
    arc = traverse_arc(eye, axis, max_angle=np.radians(120))
    assert arc.ends == ends
    check_order(arc)
    np.testing.assert_allclose(cell.arm.joints, before, atol=1e-12)
    # What it says was really in the way: from the last view of each side the next step fails for the same reason.
    for sign, end, side in ((-1, ends[0], arc.views[arc.center :: -1]), (1, ends[1], arc.views[arc.center :])):
        cell.arm.move_joints(before)
        assert all(cell.arm.move_joints(view.joints) for view in side)
        step = np.roll([0.0, sign * 0.02, 0.0], 0 if axis == "y" else -1)
        motion = cell.arm.move_camera(RigidTransform.from_translation(step))
        if motion:  # then it was the turn back toward the object
            pixel = eye.look().blob.centroid
            motion = cell.arm.move_camera(RigidTransform.from_rotation(toward_pixel(CAMERA, pixel)))
        assert motion.reason.value == end.value
        for view in side[::-1]:
            cell.arm.move_joints(view.joints)


def test_a_second_brick_beside_the_object_is_never_taken_for_it():
    with WorkCell(arm="floating", target="cuboid_1x1", others=["cuboid_1x1"]) as cell:
        for seed in range(2):
            cell.reset(seed)
            arc = traverse_arc(centered(cell))
            assert len(arc) > 10
            # A silhouette's centroid is not the image of the center; the other brick is 270 px away.
            check_never_leaps(arc, cell.truth.world_from_object.translation, within=10)


def test_a_patch_that_slides_over_the_object_loses_it_rather_than_moving_the_arm(cell_of):
    floating = cell_of("floating", seed=0)
    eye = centered(floating)
    tuned, looks = floating.segmenter, [0]

    def with_a_patch(rgb):
        looks[0] += 1
        mask = tuned(rgb).copy()
        blob = Blob.from_mask(mask)
        if looks[0] > 9 and blob is not None:
            u, v = blob.centroid.astype(int)
            mask[v - 40 : v + 40, u : u + 220] = True
        return mask

    arc = traverse_arc(Eye(eye.arm, with_a_patch))
    assert arc.ends == (ArcEnd.TARGET_LOST, ArcEnd.TARGET_LOST)
    check_never_leaps(arc, floating.truth.world_from_object.translation, within=10)


@pytest.mark.parametrize("arm", ARMS)
def test_the_approach_works_on_every_arm_under_the_thesiss_noise(arm, cell_of):
    for seed in range(2):
        cell = cell_of(arm, noise=NOISY, seed=seed)
        assert approach(centered(cell, radius=0.32), 0.25).motion
        away = cell.truth.world_from_camera.translation - cell.truth.world_from_object.translation
        assert np.linalg.norm(away) == pytest.approx(0.25, rel=0.1)


# Determinism


@pytest.mark.parametrize("arm", ["floating", "baxter", full("ur5e")])
def test_the_same_seed_gives_the_same_centering_and_the_same_arc_to_the_bit(arm, cell_of):
    runs = []
    for _ in range(2):
        cell = cell_of(arm, "alligator", NOISY, seed=4, placement="tilted")
        eye = stand(cell, tilt_deg=12, azimuth_deg=0.0, radius=0.25, offset=(80, -60))
        centering = center_on_object(eye)
        arc = traverse_arc(eye, max_angle=0.4)
        runs.append(
            [centering.offsets, arc.ranges]
            + [
                np.concatenate([v.joints, v.base_from_camera.as_matrix().ravel(), v.blob.centroid, [v.blob.area]])
                for v in arc.views
            ]
        )
    assert len(runs[0]) > 5
    for a, b in zip(*runs, strict=True):
        np.testing.assert_array_equal(a, b)
