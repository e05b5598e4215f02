"""Centering by turning and by shifting, and the alignment of the wrist, on every arm and on none."""

import numpy as np
import pytest
from eye_in_hand import CAMERA, Ball, Hindered, PinholeArm, Plate, white
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.motion.arm import StopReason
from gvp_lib.motion.centering import align_with_major_axis, center_on_object
from gvp_lib.motion.primitives import toward_pixel, yaw
from gvp_lib.motion.sighting import Eye
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.workcell import WorkCell

OBJECTS = ["cuboid_1x2", "cylinder", "alligator", "tomato_soup_box"]


@pytest.fixture(scope="module")
def baxter():
    made = WorkCell(arm="baxter", target="cuboid_1x2", seed=3)
    yield made
    made.close()


@pytest.fixture(scope="module")
def floating():
    made = WorkCell(arm="floating", target="cuboid_1x2", seed=3)
    yield made
    made.close()


def stand(cell, *, tilt_deg=0.0, roll_deg=0.0, offset=(0.0, 0.0), radius=0.3, azimuth_deg=180.0):
    """The cell's camera near its object, which shows ``offset`` px from the middle; an eye that looks through it."""
    sphere = VirtualSphere(cell.truth.world_from_object.translation, radius)
    aimed = sphere.viewpoint(*np.radians([tilt_deg, azimuth_deg, roll_deg]))
    away = toward_pixel(CAMERA, CAMERA.principal_point - offset)
    cell.place_camera(aimed * RigidTransform.from_rotation(away))
    return Eye(cell.arm, cell.segmenter)


def off_center(offset, *shapes, **where):
    """A pinhole arm whose object shows ``offset`` px from the middle, and an eye that looks through it."""
    arm = PinholeArm(*shapes, **where)
    away = toward_pixel(CAMERA, CAMERA.principal_point - offset)
    arm.move_camera(RigidTransform.from_rotation(away))
    return arm, Eye(arm, white)


# Centering


@pytest.mark.parametrize("noise", [Noise.none(), Noise.thesis()], ids=["clean", "noisy"])
@pytest.mark.parametrize("target", OBJECTS)
@pytest.mark.parametrize("arm", ["floating", "ur5e", "baxter"])
def test_from_100_px_off_the_object_is_within_2_px_in_at_most_4_frames(arm, target, noise):
    with WorkCell(arm=arm, target=target, noise=noise) as cell:
        for seed in range(4):
            cell.reset(seed)
            angle = 2 * np.pi * seed / 4 + 0.3
            eye = stand(cell, tilt_deg=12, roll_deg=10 * seed, offset=100 * np.array([np.cos(angle), np.sin(angle)]))
            centered = center_on_object(eye)
            assert centered
            assert 80 < np.linalg.norm(centered.offsets[0]) < 125
            assert np.abs(centered.offsets[-1]).max() < 2
            assert len(centered.offsets) == eye.looks <= 4


@given(st.floats(-270, 270), st.floats(-190, 190))
def test_wherever_a_ball_is_in_the_image_one_turn_is_enough(du, dv):
    arm, eye = off_center((du, dv))
    before = arm.camera_pose().translation
    centered = center_on_object(eye, threshold=0.5)
    assert centered
    assert len(centered.offsets) <= 2
    np.testing.assert_allclose(arm.camera_pose().translation, before, atol=1e-9)  # a turn on the spot


@pytest.mark.parametrize("radius", [0.12, 0.25, 0.5])
def test_one_turn_is_enough_at_any_distance(radius):
    _, eye = off_center((-120, 80), radius=radius)
    assert len(center_on_object(eye).offsets) == 2


def test_an_object_in_the_middle_is_left_there():
    arm, eye = off_center((0, 0))
    before = arm.joints
    centered = center_on_object(eye)
    assert centered
    assert len(centered.offsets) == eye.looks == 1
    np.testing.assert_array_equal(arm.joints, before)


def test_a_gain_below_one_approaches_step_by_step_as_the_thesis_does():
    _, eye = off_center((100, -60))
    distances = np.linalg.norm(center_on_object(eye, gain=0.5).offsets, axis=1)
    assert len(distances) >= 6
    np.testing.assert_allclose(distances[1:4] / distances[:3], 0.5, atol=0.03)


def test_an_offset_of_either_sign_is_corrected():
    # Erratum 8: the printed test is signed, so that an error of -100 px would pass.
    for offset in ((100, 0), (-100, 0), (0, 100), (0, -100)):
        _, eye = off_center(offset)
        assert len(center_on_object(eye).offsets) == 2


def test_shifting_keeps_the_direction_of_view():
    arm, eye = off_center((0, 0), radius=0.3)
    arm.move_camera(RigidTransform.from_translation([0.05, -0.03, 0]))
    before = arm.camera_pose()
    centered = center_on_object(eye, by="shifting", depth=0.3)
    assert centered
    assert len(centered.offsets) == 2
    moved = before.inv() * arm.camera_pose()
    assert moved.rotation.magnitude() == pytest.approx(0, abs=1e-9)
    np.testing.assert_allclose(moved.translation, [-0.05, 0.03, 0], atol=5e-4)


def test_shifting_by_a_wrong_depth_only_takes_longer():
    for depth in (0.2, 0.4):
        arm, eye = off_center((0, 0), radius=0.3)
        arm.move_camera(RigidTransform.from_translation([0.05, -0.03, 0]))
        centered = center_on_object(eye, by="shifting", depth=depth)
        assert centered
        assert 2 < len(centered.offsets) < 6


def test_shifting_works_on_an_arm(baxter):
    baxter.reset(3)
    eye = stand(baxter, offset=(60, -40))
    before = baxter.arm.camera_pose().rotation
    assert center_on_object(eye, by="shifting", depth=0.3)
    assert (before.inv() * baxter.arm.camera_pose().rotation).magnitude() < 1e-3


def test_an_object_out_of_sight_is_no_error():
    _, eye = off_center((0, 0), Ball((5.0, 0, 0)))
    centered = center_on_object(eye)
    assert not centered
    assert centered.view is None
    assert centered.offsets.shape == (0, 2)


def test_an_object_lost_on_the_way_leaves_the_offsets_so_far():
    arm, _ = off_center((100, 0))
    eye = Eye(Hindered(arm, blind=lambda arm: arm.frames > 1), white)
    centered = center_on_object(eye)
    assert not centered
    assert centered.view is None
    np.testing.assert_allclose(centered.offsets, [[100, 0]], atol=0.5)
    assert centered.motion


@pytest.mark.parametrize("reason", [r for r in StopReason if r is not StopReason.REACHED])
def test_a_motion_that_stops_half_way_is_reported_with_one_more_look(reason):
    arm, _ = off_center((100, 0))
    centered = center_on_object(Eye(Hindered(arm, stops={0: reason}), white))
    assert not centered
    assert centered.motion.reason is reason
    np.testing.assert_allclose(centered.offsets, [[100, 0], [50, 0]], atol=1)
    assert centered.view is not None


def test_attempts_are_counted():
    # Erratum 8: as printed the count never changes.
    _, eye = off_center((100, 0))
    centered = center_on_object(eye, gain=0.1, max_attempts=3)
    assert not centered
    assert len(centered.offsets) == 4
    assert centered.motion.reason is StopReason.REACHED
    _, eye = off_center((100, 0))
    assert len(center_on_object(eye, max_attempts=0).offsets) == 1


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"by": "sliding"}, 'by="turning", or by="shifting" with the depth.*got by=\'sliding\''),
        ({"by": "shifting"}, "with the depth of the object in m.*depth=None"),
        ({"depth": 0.3}, "got by='turning', depth=0.3"),
        ({"by": "shifting", "depth": -0.3}, r"positive and finite, in m; got -0\.3"),
        ({"by": "shifting", "depth": np.inf}, "positive and finite, in m; got inf"),
        ({"threshold": 0}, "threshold > 0 px"),
        ({"max_attempts": -1}, "max_attempts >= 0"),
        ({"gain": 2.0}, r"gain between 0 and 2, which 1 suits; got 2\.0, 8, 2\.0"),
        ({"gain": 0.0}, "gain between 0 and 2"),
    ],
)
def test_settings_of_a_centering_that_make_no_sense_are_refused_before_anything_moves(arguments, text):
    arm, eye = off_center((100, 0))
    before = arm.joints
    with pytest.raises(InvalidParameterError, match=text):
        center_on_object(eye, **arguments)
    np.testing.assert_array_equal(arm.joints, before)
    assert eye.looks == 0


def test_the_same_seed_gives_the_same_centering_to_the_bit():
    traces = []
    for _ in range(2):
        with WorkCell(arm="baxter", target="alligator", noise=Noise.thesis(), seed=5) as cell:
            centered = center_on_object(stand(cell, tilt_deg=12, offset=(80, -60)))
            traces.append((centered.offsets, centered.view.joints))
    for a, b in zip(*traces, strict=True):
        np.testing.assert_array_equal(a, b)


# Alignment


def roll_left(eye):
    """How far the camera's y axis is from the object's major axis, rad in [0, pi/2]."""
    return abs(abs(eye.look().blob.orientation) - np.pi / 2)


@given(st.floats(-1.5, 1.5))
def test_whatever_the_roll_one_turn_aligns_and_it_is_the_smaller_of_the_two(yaw_of_plate):
    arm, eye = off_center((0, 0), Plate(yaw=yaw_of_plate))
    before = arm.camera_pose().rotation
    aligned = align_with_major_axis(eye)
    assert aligned
    assert aligned.defined
    assert roll_left(eye) < np.radians(1)
    assert len(aligned.angles) <= 2
    assert (before.inv() * arm.camera_pose().rotation).magnitude() <= np.pi / 2 + 1e-6


@pytest.mark.parametrize("roll_deg", [-70, -30, 40, 80])
def test_the_wrist_joint_alone_aligns_on_the_baxter(baxter, roll_deg):
    baxter.reset(3)
    eye = stand(baxter, roll_deg=roll_deg)
    before = baxter.arm.joints
    aligned = align_with_major_axis(eye)
    assert aligned
    assert abs(np.degrees(baxter.truth.roll_error())) < 1.5
    assert np.abs(baxter.arm.joints - before)[:-1].max() < 1e-12
    assert len(aligned.angles) <= 2


def test_alignment_on_a_noisy_baxter_ends_within_its_tolerance():
    with WorkCell(arm="baxter", target="cuboid_1x4", noise=Noise.thesis()) as cell:
        for seed in range(4):
            cell.reset(seed)
            aligned = align_with_major_axis(stand(cell, roll_deg=25 * seed - 40))
            assert aligned
            assert abs(aligned.angles[-1]) < np.radians(1)


def test_where_the_wrists_limit_forbids_the_smaller_roll_it_takes_the_other(baxter):
    low, high = baxter.model.joint("arm/right_w2").range
    for limit in (low + 0.02, high - 0.02):
        for seed in range(3):
            baxter.reset(seed)
            eye = stand(baxter)
            assert baxter.arm.move_joints(np.append(baxter.arm.joints[:-1], limit))
            before = baxter.arm.joints
            view = eye.look()
            aligned = align_with_major_axis(eye, view=view)
            assert aligned
            turned = baxter.arm.joints - before
            assert np.abs(turned[:-1]).max() < 1e-12
            # Away from the limit, by the smaller roll or, where that one leads beyond it, by its supplement.
            assert np.sign(turned[-1]) == -np.sign(limit)
            smaller = abs(aligned.angles[0])
            assert min(abs(abs(turned[-1]) - smaller), abs(abs(turned[-1]) - (np.pi - smaller))) < np.radians(1.5)


def test_both_cases_of_a_limit_occur(baxter):
    turns = []
    for limit in baxter.model.joint("arm/right_w2").range * 0.99:
        for seed in range(3):
            baxter.reset(seed)
            eye = stand(baxter)
            baxter.arm.move_joints(np.append(baxter.arm.joints[:-1], limit))
            before = baxter.arm.joints[-1]
            align_with_major_axis(eye)
            turns.append(abs(baxter.arm.joints[-1] - before))
    assert min(turns) < np.pi / 2 < max(turns)


@pytest.mark.parametrize("target", ["cuboid_1x1", "cylinder"])
def test_a_square_or_a_disc_seen_straight_on_keeps_the_roll(target):
    with WorkCell(arm="floating", target=target, seed=1) as cell:
        eye = stand(cell, roll_deg=20)
        before = cell.arm.joints
        aligned = align_with_major_axis(eye)
        np.testing.assert_array_equal(cell.arm.joints, before)
    assert not aligned.defined
    assert not aligned.aligned
    assert aligned.view is not None
    assert np.isnan(aligned.angles).all()
    assert len(aligned.angles) == 1


def test_a_view_that_was_just_taken_saves_a_look():
    _, eye = off_center((0, 0), Plate(yaw=np.pi / 2))
    align_with_major_axis(eye, view=eye.look())
    looks = eye.looks
    aligned = align_with_major_axis(eye, view=eye.look())
    assert aligned
    assert eye.looks == looks + 1


@pytest.mark.parametrize("yaw_of_plate", [0.1, 0.8, 2.3])
def test_an_object_far_off_the_middle_is_not_lost_by_the_longer_roll(yaw_of_plate):
    # The other roll, near half a turn, throws a blob to the other side of the image.
    class OneWay(PinholeArm):
        def rotate_wrist(self, angle):
            if abs(angle) < np.pi / 2:
                return Hindered(self, stops={0: StopReason.JOINT_LIMIT}).move_camera(RigidTransform.identity())
            return super().rotate_wrist(angle)

    arm = OneWay(Plate(yaw=yaw_of_plate))
    yaw(arm, np.arctan(140 / 530))
    aligned = align_with_major_axis(Eye(arm, white))
    assert aligned.view is not None
    assert abs(aligned.angles[-1]) < np.radians(5)
    assert len(aligned.angles) > 1


def test_an_object_out_of_sight_is_not_aligned_with():
    arm, _ = off_center((0, 0), Plate(yaw=1.0))
    for blind, looks in ((lambda arm: True, 0), (lambda arm: arm.frames > 1, 1)):
        aligned = align_with_major_axis(Eye(Hindered(arm, blind=blind), white))
        assert not aligned
        assert not aligned.defined
        assert aligned.view is None
        assert len(aligned.angles) == looks


@pytest.mark.parametrize("reason", [StopReason.COLLISION, StopReason.JOINT_LIMIT])
def test_a_wrist_that_is_stopped_is_reported_with_what_is_missing(reason):
    class Stuck(PinholeArm):
        def rotate_wrist(self, angle):
            return Hindered(self, stops={0: reason}).move_camera(RigidTransform.identity())

    aligned = align_with_major_axis(Eye(Stuck(Plate(yaw=1.0)), white))
    assert not aligned
    assert aligned.defined
    assert aligned.motion.reason is reason
    assert len(aligned.angles) == 2
    assert aligned.angles[0] == aligned.angles[1] != 0
