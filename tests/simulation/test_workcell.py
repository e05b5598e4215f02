"""The work cell: what its arm does, what its sensors see, what its truth says."""

import gc
import os
import subprocess
import sys
import weakref
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import GvpError, InvalidParameterError, ModelError, UnknownNameError, UnreachableError
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.motion.arm import EyeInHandArm, Gripper, StopReason
from gvp_lib.perception.moments import Blob
from gvp_lib.simulation.arms import ARMS
from gvp_lib.simulation.drives import PACE
from gvp_lib.simulation.objects import OBJECTS
from gvp_lib.simulation.placements import PLACEMENTS
from gvp_lib.simulation.robot import FloatingCamera
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.workcell import WorkCell

ALL_ARMS = [*ARMS, "floating"]


@pytest.fixture(scope="module", params=ALL_ARMS)
def cell(request):
    made = WorkCell(arm=request.param, target="cuboid_1x2", seed=3)
    yield made
    made.close()


@pytest.fixture(scope="module")
def ur5e():
    made = WorkCell(arm="ur5e", target="cuboid_1x2", seed=3)
    yield made
    made.close()


def above(cell, tilt_deg=0.0, azimuth_deg=0.0, roll_deg=0.0, radius=0.3):
    """A viewpoint on the sphere about the cell's object."""
    sphere = VirtualSphere(cell.truth.world_from_object.translation, radius)
    return sphere.viewpoint(*np.radians([tilt_deg, azimuth_deg, roll_deg]))


def turn(angle):
    """A roll by ``angle`` rad about the optical axis."""
    return RigidTransform.from_rotation(Rotation.from_rotvec([0, 0, angle]))


def apart(a, b):
    """Distance (m) and angle (rad) between two poses."""
    difference = a.inv() * b
    return np.linalg.norm(difference.translation), difference.rotation.magnitude()


def test_a_cells_arm_is_an_eye_in_hand_arm_and_nothing_more(cell):
    assert isinstance(cell.arm, EyeInHandArm)
    public = {name for name in dir(cell.arm) if not name.startswith("_")}
    protocol = {"intrinsics", "joints", "capture", "camera_pose", "move_camera", "move_joints", "rotate_wrist"}
    assert public - protocol <= {
        "begin_episode",
        "stand_at",
        "go_to",
        "move_by",
        "close",
    }  # how the cell sets an episode up


@pytest.mark.check
def test_the_home_view_holds_the_whole_object(cell):
    cell.reset()
    rgb = cell.arm.capture()
    assert rgb.shape == (480, 640, 3)
    assert rgb.dtype == np.uint8
    if cell.arm_spec is not None:
        blob = Blob.from_mask(cell.segmenter(rgb))
        assert blob is not None
        assert blob.area > 500


@pytest.mark.parametrize("arm", ALL_ARMS)
def test_the_same_seed_gives_the_same_frames_and_truth_to_the_bit(arm):
    def run():
        cell = WorkCell(arm=arm, target="cuboid_1x4", placement="tilted", noise=Noise.thesis(), seed=11)
        cell.place_camera(above(cell, 10, 40))
        cell.arm.move_camera(RigidTransform.from_translation([0.01, 0.0, 0.0]))
        frames = [cell.arm.capture() for _ in range(2)]
        poses = [cell.truth.world_from_object.as_matrix(), cell.truth.world_from_camera.as_matrix()]
        cell.close()
        return frames, poses

    (frames_a, poses_a), (frames_b, poses_b) = run(), run()
    for a, b in zip(frames_a + poses_a, frames_b + poses_b, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("arm", ALL_ARMS)
def test_reset_begins_the_same_episode_as_a_new_cell(arm):
    reused = WorkCell(arm=arm, noise=Noise.thesis(), seed=1)
    reused.arm.capture()
    reused.place_camera(above(reused, 10, 40))
    reused.arm.rotate_wrist(0.3)
    reused.reset(seed=2)
    fresh = WorkCell(arm=arm, noise=Noise.thesis(), seed=2)
    np.testing.assert_array_equal(reused.arm.capture(), fresh.arm.capture())
    np.testing.assert_array_equal(reused.arm.joints, fresh.arm.joints)
    assert reused.time == fresh.time == 0
    reused.close()
    fresh.close()


def test_reset_takes_another_noise_and_leaves_the_object_where_it_was():
    cell = WorkCell(arm="ur5e", noise=Noise.thesis(), seed=1)
    place, readings = cell.truth.world_from_object.as_matrix(), []
    for noise_seed in (None, np.random.SeedSequence(1), np.random.SeedSequence(2), np.random.SeedSequence(1)):
        cell.reset(noise_seed=noise_seed)
        np.testing.assert_array_equal(cell.truth.world_from_object.as_matrix(), place)
        readings.append(cell.truth.world_from_camera.translation)
    np.testing.assert_array_equal(readings[1], readings[3])
    assert len({tuple(reading) for reading in readings}) == 3
    cell.close()


def test_a_kept_truth_judges_the_present_episode():
    cell = WorkCell(arm="floating", target="cuboid_1x2", placement="side", seed=0)
    truth = cell.truth
    for seed in range(4):
        cell.reset(seed)
        cell.place_camera(above(cell))
        assert np.degrees(truth.viewpoint_error()) < 1
    cell.close()


def test_a_seed_sequence_is_a_seed_and_repeats_itself():
    child = np.random.SeedSequence(5).spawn(2)[1]
    a, b = (WorkCell(arm="floating", seed=child) for _ in range(2))
    np.testing.assert_array_equal(a.truth.world_from_object.as_matrix(), b.truth.world_from_object.as_matrix())
    b.reset()
    np.testing.assert_array_equal(a.truth.world_from_object.as_matrix(), b.truth.world_from_object.as_matrix())


def test_a_cell_is_freed_when_nobody_holds_it():
    gc.collect()
    gc.disable()
    try:
        with WorkCell(arm="baxter", seed=1) as cell:
            cell.arm.capture()
        gone = weakref.ref(cell)
        del cell
        assert gone() is None
    finally:
        gc.enable()


def test_a_picture_from_another_thread_is_refused_with_the_reason(ur5e):
    ur5e.arm.capture()
    with ThreadPoolExecutor(1) as pool, pytest.raises(GvpError, match="one WorkCell per thread"):
        pool.submit(ur5e.arm.capture).result()


def test_another_seed_puts_the_object_elsewhere(ur5e):
    ur5e.reset(3)
    a = ur5e.truth.world_from_object
    ur5e.reset(4)
    assert apart(a, ur5e.truth.world_from_object)[0] > 1e-3


@pytest.mark.check
@pytest.mark.parametrize("tilt_deg", [0.0, 25.0])
def test_the_viewpoint_error_is_the_tilt_from_the_normal(cell, tilt_deg):
    cell.reset(3)
    cell.place_camera(above(cell, tilt_deg, 160))
    assert np.degrees(cell.truth.viewpoint_error()) == pytest.approx(tilt_deg, abs=0.06)


def test_the_roll_error_is_measured_from_the_major_axis_modulo_its_symmetry(ur5e):
    ur5e.reset(3)
    major = np.array(ur5e.truth.normal.major_axis)  # a copy: SciPy cannot turn read-only vectors
    for turn_deg in (0, 30, 180, 210):
        y = Rotation.from_rotvec([0, 0, np.radians(turn_deg)]).apply(major)
        x = np.cross(y, [0, 0, -1.0])
        rotation = Rotation.from_matrix(np.column_stack([x, y, [0, 0, -1.0]]))
        position = ur5e.truth.world_from_object.translation + (0, 0, 0.3)
        ur5e.place_camera(RigidTransform.from_components(position, rotation))
        assert abs(np.degrees(ur5e.truth.roll_error())) == pytest.approx(turn_deg % 180, abs=0.06)


@pytest.mark.check
def test_a_placed_camera_sees_the_object_in_the_middle(cell):
    cell.reset(3)
    cell.place_camera(above(cell, 15, 80))
    blob = Blob.from_mask(cell.segmenter(cell.arm.capture()))
    # The silhouette's centroid is not the projection of the center, but it is near.
    assert np.linalg.norm(blob.centroid - cell.arm.intrinsics.principal_point) < 12


@pytest.mark.check
def test_move_camera_goes_straight_to_a_pose_in_the_cameras_own_frame(cell):
    cell.reset(3)
    cell.place_camera(above(cell, 5, 90))
    start, step = cell.arm.camera_pose(), np.array([0.03, -0.02, 0.04])
    seen = []
    with cell.watch(lambda: seen.append(cell.truth.world_from_camera.translation)):
        motion = cell.arm.move_camera(RigidTransform.from_translation(step))
    assert motion
    assert motion.reason is StopReason.REACHED
    distance, angle = apart(start * RigidTransform.from_translation(step), cell.truth.world_from_camera)
    assert distance < 2e-4
    assert angle < np.radians(0.1)
    direction = start.rotation.apply(step / np.linalg.norm(step))
    off_line = [np.linalg.norm(np.cross(p - start.translation, direction)) for p in seen]
    assert max(off_line) < 1e-3


@pytest.mark.parametrize("arm", ARMS)
def test_a_motion_smaller_than_the_tolerance_is_still_made(arm):
    with WorkCell(arm=arm, seed=3) as cell:
        cell.place_camera(above(cell, 5, 90))
        for small in (RigidTransform.from_translation([5e-5, 0, 0]), turn(np.radians(0.01))):
            before = cell.truth.world_from_camera
            assert cell.arm.move_camera(small)
            distance, angle = apart(before * small, cell.truth.world_from_camera)
            assert distance < 5e-6
            assert angle < 5e-6


@pytest.mark.parametrize("dynamic", [False, True])
def test_the_arm_knows_where_it_is_while_it_moves(dynamic):
    with WorkCell(arm="ur5e", seed=3, dynamic=dynamic) as cell:
        gaps = []
        with cell.watch(lambda: gaps.append(apart(cell.arm.camera_pose(), cell.truth.world_from_camera)[0])):
            cell.arm.move_camera(RigidTransform.from_translation([0.05, 0, 0]))
        assert len(gaps) > 3
        assert max(gaps) < (1e-6 if not dynamic else 2e-3)  # one step of the physics may lie between the two


@pytest.mark.check
def test_rotate_wrist_rolls_the_camera_about_its_own_axis_with_one_joint(cell):
    cell.reset(3)
    cell.place_camera(above(cell, 5, 90))
    before, joints, angle = cell.arm.camera_pose(), cell.arm.joints, np.radians(20)
    assert cell.arm.rotate_wrist(angle)
    rolled = before * RigidTransform.from_rotation(Rotation.from_rotvec([0, 0, angle]))
    distance, error = apart(rolled, cell.arm.camera_pose())
    assert distance < 1e-6
    assert error < 1e-6
    if cell.arm_spec is not None:
        np.testing.assert_array_equal(cell.arm.joints[:-1], joints[:-1])


@pytest.mark.parametrize("arm", ARMS)
def test_an_arm_sent_into_the_table_stops_before_it_and_says_why(arm):
    cell = WorkCell(arm=arm, seed=3)
    cell.place_camera(above(cell, 0, 90))
    motion = cell.arm.move_camera(RigidTransform.from_translation([0, 0, 0.5]))
    assert not motion
    assert motion.reason is StopReason.COLLISION
    assert cell.arm.camera_pose().translation[2] > cell.stage.table_height
    assert apart(cell.arm.camera_pose(), cell.truth.world_from_camera)[0] < 1e-6
    cell.close()


@pytest.mark.parametrize("arm", ARMS)
def test_an_arm_sent_beyond_its_reach_stops_on_the_way_and_says_why(arm):
    cell = WorkCell(arm=arm, seed=3)
    start = cell.arm.camera_pose()
    motion = cell.arm.move_camera(start.inv() * RigidTransform.from_translation([1.5, 0, 0]) * start)
    assert motion.reason in (StopReason.UNREACHABLE, StopReason.JOINT_LIMIT)
    assert 0.02 < apart(start, cell.arm.camera_pose())[0] < 1.5
    cell.close()


def test_joints_beyond_their_limits_are_refused_before_anything_moves(ur5e):
    ur5e.reset(3)
    q = ur5e.arm.joints
    motion = ur5e.arm.move_joints(q + 50.0)
    assert motion.reason is StopReason.JOINT_LIMIT
    np.testing.assert_array_equal(ur5e.arm.joints, q)


def test_joints_come_as_copies(ur5e):
    ur5e.reset(3)
    ur5e.arm.joints[:] = 99
    assert not (ur5e.arm.joints == 99).any()


def test_the_clock_runs_at_the_arms_working_pace(ur5e):
    ur5e.reset(3)
    q = ur5e.arm.joints
    q[-1] += 0.5
    ur5e.arm.move_joints(q)
    assert ur5e.time == pytest.approx(0.5 / (PACE * np.broadcast_to(ur5e.arm_spec.joint_speed, 6)[-1]), rel=1e-6)


@pytest.mark.parametrize("arm", ARMS)
def test_the_thesiss_noise_puts_the_hand_millimeters_from_where_it_believes(arm):
    cell, distances, angles = WorkCell(arm=arm, noise=Noise.thesis()), [], []
    for seed in range(20):
        cell.reset(seed)
        distance, angle = apart(cell.arm.camera_pose(), cell.truth.world_from_camera)
        distances.append(distance)
        angles.append(angle)
    assert 0.002 < np.mean(distances) < 0.010
    assert np.radians(0.3) < np.mean(angles) < np.radians(1.2)
    cell.close()


@pytest.mark.check
def test_without_noise_the_arm_believes_the_truth(cell):
    cell.reset(3)
    distance, angle = apart(cell.arm.camera_pose(), cell.truth.world_from_camera)
    assert distance < 1e-9
    assert angle < 1e-7


def test_a_placed_camera_stands_truly_there_whatever_the_encoders_read():
    cell = WorkCell(arm="baxter", noise=Noise.thesis(), seed=3)
    goal = above(cell, 10, 60)
    cell.place_camera(goal)
    assert apart(goal, cell.truth.world_from_camera)[0] < 1e-5
    with pytest.raises(UnreachableError):
        cell.place_camera(RigidTransform.from_translation([3.0, 0, 0]))
    assert apart(goal, cell.truth.world_from_camera)[0] < 1e-5
    assert apart(goal, cell.arm.camera_pose())[0] > 1e-3
    cell.close()


def test_a_focal_length_that_differs_scales_the_image_and_not_the_stated_intrinsics():
    cell = WorkCell(arm="floating", noise=Noise(focal_length=0.05), seed=5)
    perfect = WorkCell(arm="floating", seed=5)
    areas = []
    for each in (cell, perfect):
        each.place_camera(above(each, radius=0.3))
        areas.append(Blob.from_mask(each.segmenter(each.arm.capture())).area)
    assert cell.arm.intrinsics == perfect.arm.intrinsics
    assert 0.002 < abs(np.sqrt(areas[0] / areas[1]) - 1) < 0.051
    cell.close()
    perfect.close()


def test_pixel_noise_has_the_spread_it_states():
    noisy = WorkCell(arm="floating", noise=Noise(pixel_sd=3.0), seed=5)
    frames = np.stack([noisy.arm.capture() for _ in range(12)]).astype(float)
    calm = (frames.mean(0) > 30) & (frames.mean(0) < 225)
    assert frames.std(0, ddof=1)[calm].mean() == pytest.approx(3.0, rel=0.1)
    noisy.close()


def test_a_servo_driven_arm_arrives_where_the_kinematic_one_does(ur5e):
    ur5e.reset(3)
    dynamic = WorkCell(arm="ur5e", target="cuboid_1x2", seed=3, dynamic=True)
    step = RigidTransform.from_translation([0.05, 0.0, 0.0])
    for each in (ur5e, dynamic):
        assert each.arm.move_camera(step)
    distance, angle = apart(ur5e.truth.world_from_camera, dynamic.truth.world_from_camera)
    assert distance < 1e-3
    assert angle < np.radians(0.2)
    assert dynamic.time > 0.1
    dynamic.close()


@pytest.mark.parametrize("arm", ARMS)
def test_a_servo_driven_arm_that_meets_the_table_stops_to_protect_itself(arm):
    cell = WorkCell(arm=arm, seed=3, dynamic=True)
    # Beside the object, so that it meets the table and not the brick.
    cell.place_camera(RigidTransform.from_translation([0.0, 0.12, 0.0]) * above(cell, 0, 90))
    motion = cell.arm.move_camera(RigidTransform.from_translation([0, 0, 0.45]))
    assert motion.reason is StopReason.CONTACT
    assert np.isfinite(cell.data.qpos).all()
    cell.close()


def test_objects_rest_where_they_were_placed_while_dynamic_time_passes():
    cell = WorkCell(arm="baxter", placement="tilted", seed=6, dynamic=True)
    before = cell.truth.world_from_object
    cell._holder.drive.idle(1.0)
    assert apart(before, cell.truth.world_from_object)[0] < 2e-3
    cell.close()


def test_the_grippers_range_sensor_measures_the_distance_below_it():
    cell = WorkCell(arm="baxter", target="cuboid_1x4", seed=3)
    assert isinstance(cell.gripper, Gripper)
    cell.place_camera(above(cell, 0, 90, radius=0.25))
    near = cell.gripper.range()
    cell.arm.move_camera(RigidTransform.from_translation([0, 0, 0.05]))
    assert near - cell.gripper.range() == pytest.approx(0.05, abs=1e-3)
    cell.close()


def test_the_range_sensor_fails_as_often_as_its_noise_says():
    cell = WorkCell(arm="baxter", target="cuboid_1x4", noise=Noise(range_dropout=0.2, range_sd=0.002), seed=3)
    cell.place_camera(above(cell, 0, 90, radius=0.25))
    readings = np.array([cell.gripper.range() for _ in range(2000)])
    assert np.mean(np.isinf(readings)) == pytest.approx(0.2, abs=0.04)
    assert readings[np.isfinite(readings)].std() == pytest.approx(0.002, rel=0.1)
    cell.close()


@pytest.mark.parametrize("dynamic", [False, True])
def test_the_gripper_opens_and_closes(dynamic):
    cell = WorkCell(arm="baxter", seed=3, dynamic=dynamic)
    cell.gripper.open()
    wide = cell.gripper.width
    cell.gripper.close()
    narrow = cell.gripper.width
    assert wide - narrow == pytest.approx(0.044, abs=0.003)  # the Baxter gripper's stroke
    cell.close()


def test_what_the_fingers_held_is_forgotten_with_the_episode():
    with WorkCell(arm="baxter", target="cuboid_1x2", seed=7, dynamic=True) as cell:
        normal = cell.truth.normal
        z, y = -np.array(normal.direction), np.array(normal.major_axis)
        rotation = Rotation.from_matrix(np.column_stack([np.cross(y, z), y, z]))
        center = cell.truth.world_from_object.translation
        cell.place_camera(RigidTransform.from_components(center - 0.08 * z, rotation))
        cell.gripper.close()
        assert cell._holder.drive.held
        cell.reset()
        assert not cell._holder.drive.held


def test_servos_that_cannot_get_there_are_not_said_to_have_arrived():
    with WorkCell(arm="ur5e", seed=3, dynamic=True) as cell:
        cell.model.actuator_forcerange[:] = [-0.1, 0.1]
        cell.model.actuator_forcelimited[:] = 1
        motion = cell.arm.move_camera(RigidTransform.from_translation([0.15, 0, 0]))
        assert motion.reason is StopReason.STALLED
        assert not motion


def test_an_arm_without_a_gripper_says_so(ur5e):
    with pytest.raises(ModelError, match=r"no gripper.*baxter"):
        _ = ur5e.gripper


@pytest.mark.parametrize("target", OBJECTS)
def test_the_tuned_segmenter_finds_what_the_renderer_knows_to_be_the_object(target):
    cell, overlaps = WorkCell(arm="floating", target=target, seed=4), []
    renderer = mujoco.Renderer(cell.model, 480, 640)
    renderer.enable_segmentation_rendering()
    body = cell.model.body("target").id
    for tilt_deg, azimuth_deg in ((0, 0), (20, 50), (40, 170), (30, 290)):
        cell.place_camera(above(cell, tilt_deg, azimuth_deg, radius=0.4))
        renderer.update_scene(cell.data, "floating")
        geoms = renderer.render()[..., 0]
        truth = (geoms >= 0) & (cell.model.geom_bodyid[geoms] == body)
        mask = cell.segmenter(cell.arm.capture())
        overlaps.append((mask & truth).sum() / (mask | truth).sum())
    renderer.close()
    cell.close()
    assert min(overlaps) > 0.95


def test_a_second_object_stands_beside_the_first_and_in_view():
    cell = WorkCell(arm="ur5e", target="cuboid_1x2", others=["cuboid_1x1"], seed=2)
    cell.place_camera(above(cell, 0, 90, radius=0.45))
    other = Blob.from_mask(OBJECTS["cuboid_1x1"].segmenter(cell.arm.capture()))
    assert other is not None
    assert other.area > 300
    cell.close()


@pytest.mark.parametrize("placement", PLACEMENTS)
@pytest.mark.parametrize(
    ("target", "others"),
    [
        pytest.param("cuboid_1x4", ["cuboid_1x4"], marks=pytest.mark.full),
        pytest.param("cylinder", ["cuboid_1x4", "cylinder", "cuboid_1x4"], marks=pytest.mark.full),
        ("cuboid_1x2", ["cuboid_1x4", "alligator", "tomato_soup_box", "cuboid_1x4", "cuboid_1x1"]),
    ],
)
def test_objects_do_not_stand_in_each_other_nor_in_a_block(target, placement, others):
    cell = WorkCell(arm="floating", target=target, placement=placement, others=others)
    for seed in range(6):
        cell.reset(seed)
        names = [
            [cell.model.body(cell.model.geom_bodyid[geom]).name for geom in pair] for pair in cell.data.contact.geom
        ]
        # Each stands on the plane, the target on its blocks; nothing else touches.
        close = [p for p in names if "world" not in p and not ("target" in p and "support" in "".join(p))]
        assert not close, seed
        assert cell.data.contact.dist.min() > -0.0005


@pytest.mark.parametrize("arm", ["floating", "baxter"])
def test_a_wall_hides_the_side_behind_it_and_no_other_whatever_the_episode(arm):
    cell = WorkCell(arm=arm, target="cuboid_1x3", placement="walled")
    model, half, geom = cell.model, OBJECTS["cuboid_1x3"].bounding_box().half_extents, np.zeros(1, np.int32)
    for seed in range(4):
        cell.reset(seed)
        assert cell.model is model  # no new scene for another wall
        wall = cell.data.body("support_0").xpos - cell.data.body("target").xpos
        hidden = cell.truth.world_from_object.rotation.inv().apply(wall / np.linalg.norm(wall)).round(6)
        for normal in np.vstack([np.eye(3), -np.eye(3)])[[0, 1, 3, 4]]:
            low_on_the_side = normal * half - [0, 0, 0.5 * half[2]]
            eye = low_on_the_side + 0.3 * (np.sin(np.radians(40)) * normal + np.cos(np.radians(40)) * np.eye(3)[2])
            start, end = cell.truth.world_from_object.apply([eye, low_on_the_side])
            mujoco.mj_ray(model, cell.data, start, end - start, np.array([1, 1, 1, 0, 0, 0], np.uint8), True, -1, geom)
            seen = model.body(model.geom_bodyid[geom[0]]).name
            assert seen == ("support_0" if normal @ hidden > 0.99 else "target")
    cell.close()


def test_shadows_and_highlights_change_the_picture():
    plain, lit = (WorkCell(arm="floating", seed=1, shadows=s, highlights=s) for s in (False, True))
    pose = above(plain, 20, 30)
    for each in (plain, lit):
        each.place_camera(pose)
    assert np.abs(plain.arm.capture().astype(int) - lit.arm.capture()).max() > 20
    plain.close()
    lit.close()


def test_the_overview_shows_the_cell(cell):
    picture = cell.overview(320, 240)
    assert picture.shape == (240, 320, 3)
    assert picture.std() > 10


# --- misuse -------------------------------------------------------------------------------------------------


def test_unknown_names_are_answered_with_the_known_ones():
    with pytest.raises(UnknownNameError, match=r"no arm named 'bakster'. Did you mean 'baxter'.*ur5e"):
        WorkCell(arm="bakster")
    with pytest.raises(UnknownNameError, match=r"no object named 'cube'.*cuboid_1x1"):
        WorkCell(target="cube")
    with pytest.raises(UnknownNameError, match=r"no placement named 'upside'.*raised.*tilted"):
        WorkCell(placement="upside")


def test_an_unreachable_pose_is_named_with_what_would_work(ur5e):
    ur5e.reset(3)
    before = ur5e.arm.joints
    with pytest.raises(UnreachableError, match=r"\[2\.0, 0\.0, 0\.5\].*nearer to the workspace"):
        ur5e.place_camera(RigidTransform.from_translation([2.0, 0.0, 0.5]))
    np.testing.assert_array_equal(ur5e.arm.joints, before)


def test_mujoco_imported_first_on_a_machine_without_a_screen_is_explained_and_not_a_crash():
    program = "import mujoco; from gvp_lib import WorkCell; WorkCell(arm='floating').arm.capture()"
    hidden = ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY")
    environment = {name: value for name, value in os.environ.items() if name not in hidden}
    ran = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True)
    if sys.platform == "linux":
        assert "Import gvp_lib.simulation first" in ran.stderr
    else:
        assert ran.returncode == 0


@pytest.mark.parametrize(
    ("pose", "text"),
    [
        (np.eye(4), r"got a ndarray\. RigidTransform\.from_matrix"),
        (None, "got a NoneType"),
        (RigidTransform.identity(3), "got 3 of them"),
        (RigidTransform.from_translation([np.nan, 0, 0]), "not finite"),
    ],
)
def test_what_is_no_pose_is_refused_with_what_makes_one(cell, pose, text):
    with pytest.raises(InvalidParameterError, match="camera_from_target.*" + text):
        cell.arm.move_camera(pose)
    with pytest.raises(InvalidParameterError, match="world_from_camera.*" + text):
        cell.place_camera(pose)


def test_an_angle_a_seed_and_a_picture_that_cannot_be_are_refused(cell):
    with pytest.raises(InvalidParameterError, match=r"finite angle, in rad.*got nan"):
        cell.arm.rotate_wrist(float("nan"))
    for seed in (-1, 1.5, "7"):
        with pytest.raises(InvalidParameterError, match="a seed is a whole number, 0 or more"):
            cell.reset(seed)
    for size in ((0, 10), (5000, 100)):
        with pytest.raises(InvalidParameterError, match="at most 4096 x 4096 pixels"):
            cell.overview(*size)


def test_a_floating_camera_is_one_that_the_scene_has_and_that_no_body_carries(ur5e):
    with pytest.raises(ModelError, match=r"no camera named 'eye'; it has .*overview"):
        FloatingCamera(ur5e.model, ur5e.data, "eye")
    with pytest.raises(ModelError, match=r"'arm/hand_camera' hangs on a body"):
        FloatingCamera(ur5e.model, ur5e.data, "arm/hand_camera")


def test_a_noise_that_is_none_and_a_lone_other_are_explained():
    with pytest.raises(InvalidParameterError, match=r"Noise\.thesis\(\), or None; got 'thesis'"):
        WorkCell(noise="thesis")
    with pytest.raises(InvalidParameterError, match=r"write others=\['cylinder'\]"):
        WorkCell(others="cylinder")


def test_joints_of_the_wrong_number_are_refused(cell):
    with pytest.raises(InvalidParameterError, match=r"6 finite|joints"):
        cell.arm.move_joints([0.0, 1.0])


def test_noise_is_checked_when_it_is_made():
    with pytest.raises(InvalidParameterError, match=r"pixel_sd.*not negative"):
        Noise(pixel_sd=-1)
    with pytest.raises(InvalidParameterError, match=r"relative.*0\.1 for ten"):
        Noise(exposure=10)
    with pytest.raises(InvalidParameterError, match="probabilities"):
        Noise(range_dropout=0.8, range_spike=0.4)
