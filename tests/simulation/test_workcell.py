"""The work cell: what its arm does, what its sensors see, what its truth says."""

import gc
import re
import subprocess
import sys
import weakref
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
import pytest
from hands import aligned
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import GvpError, InvalidParameterError, ModelError, UnknownNameError, UnreachableError
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.motion.arm import EyeInHandArm, Gripper, Outcome
from gvp_lib.perception.blobs import Blob
from gvp_lib.simulation.arms import ARMS
from gvp_lib.simulation.objects import OBJECTS
from gvp_lib.simulation.placements import PLACEMENTS
from gvp_lib.simulation.robot import FloatingCamera
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.workcell import WorkCell

ALL_ARMS = [*ARMS, "floating"]
each_arm = pytest.mark.parametrize("arm", ARMS)
shift = RigidTransform.from_translation


@pytest.fixture(params=ALL_ARMS)
def cell(cell_of, request):
    return cell_of(request.param)


@pytest.fixture
def ur5e(cell_of):
    return cell_of("ur5e")


def above(cell, tilt_deg=0.0, azimuth_deg=0.0, radius=0.3):
    """A viewpoint on the sphere about the cell's object."""
    sphere = VirtualSphere(cell.truth.world_from_object.translation, radius)
    return sphere.viewpoint(*np.radians([tilt_deg, azimuth_deg]))


def roll(angle):
    return RigidTransform.from_rotation(Rotation.from_rotvec([0, 0, angle]))


def apart(a, b):
    """Distance (m) and angle (rad) between two poses."""
    difference = a.inv() * b
    return np.linalg.norm(difference.translation), difference.rotation.magnitude()


def error_of_belief(cell):
    return apart(cell.arm.camera_pose(), cell.truth.world_from_camera)


def test_a_cells_arm_is_an_eye_in_hand_arm_and_nothing_more(cell):
    assert isinstance(cell.arm, EyeInHandArm)
    protocol = {"intrinsics", "joints", "capture", "camera_pose", "move_camera", "move_joints", "rotate_wrist"}
    set_up = {"begin_episode", "stand_at", "go_to", "move_by", "close"}  # how the cell sets an episode up
    assert {name for name in dir(cell.arm) if not name.startswith("_")} <= protocol | set_up
    assert cell.arm_spec is None or cell.arm_spec.gripper is None or isinstance(cell.gripper, Gripper)


@pytest.mark.parametrize("arm", ALL_ARMS)
def test_a_reset_cell_and_a_new_one_of_the_same_seed_agree_to_the_bit(cell_of, arm):
    def episode(cell):
        assert cell.time == 0
        cell.place_camera(above(cell, 10, 40))
        cell.arm.move_camera(shift([0.01, 0.0, 0.0]))
        poses = [cell.truth.world_from_object.as_matrix(), cell.truth.world_from_camera.as_matrix()]
        return [cell.arm.joints, *poses, cell.time, cell.arm.capture()]

    reused = cell_of(arm, "cuboid_1x4", "tilted", noise=Noise.thesis(), seed=1)
    first = episode(reused)
    reused.reset(seed=11)
    with WorkCell(arm, "cuboid_1x4", "tilted", noise=Noise.thesis(), seed=11) as fresh:
        second = episode(fresh)
    for a, b in zip(episode(reused), second, strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(first[-1], second[-1])


def test_a_seed_sequence_is_a_seed_and_repeats_itself(cell_of):
    child = np.random.SeedSequence(5).spawn(2)[1]
    cell, places = cell_of("floating"), []
    for seed in (child, child, None, 5):
        cell.reset(seed)
        places.append(cell.truth.world_from_object.as_matrix().tobytes())
    assert places[0] == places[1] == places[2] != places[3]


def test_reset_takes_another_noise_and_leaves_the_object_where_it_was(cell_of):
    cell, cameras = cell_of("ur5e", noise=Noise.thesis(), seed=1), []
    place = cell.truth.world_from_object.as_matrix()
    for seed in (1, 2, 1):
        cell.reset(noise_seed=np.random.SeedSequence(seed))
        np.testing.assert_array_equal(cell.truth.world_from_object.as_matrix(), place)
        cameras.append(cell.truth.world_from_camera.translation.tolist())
    assert cameras[0] == cameras[2] != cameras[1]


def test_a_cell_says_in_a_line_what_it_is(cell_of):
    cell = cell_of("floating", "cuboid_1x4", "tilted", noise=Noise.thesis(), others=["cylinder"], seed=5)
    assert str(cell) == "WorkCell(floating, cuboid_1x4 tilted + 1 other, noise thesis, kinematic, seed 5)"
    cell.reset(np.random.SeedSequence(5))
    assert str(cell).endswith("kinematic)")


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


@pytest.mark.check
@pytest.mark.parametrize("tilt_deg", [0.0, 25.0])
def test_a_placed_camera_truly_stands_there_sees_the_object_in_the_middle_and_knows_it_without_noise(cell, tilt_deg):
    goal = above(cell, tilt_deg, 160)
    cell.place_camera(goal)
    assert apart(goal, cell.truth.world_from_camera)[0] < 1e-5
    assert np.degrees(cell.truth.viewpoint_error()) == pytest.approx(tilt_deg, abs=0.06)
    distance, angle = error_of_belief(cell)
    assert distance < 1e-9
    assert angle < 1e-7
    blob = Blob.from_mask(cell.segmenter(cell.arm.capture()))
    # The silhouette's centroid is not the projection of the center, but it is near.
    assert np.linalg.norm(blob.centroid - cell.arm.intrinsics.principal_point) < 12


def test_a_placed_camera_stands_truly_there_whatever_the_encoders_read(cell_of):
    cell = cell_of("baxter", noise=Noise.thesis())
    goal = above(cell, 10, 60)
    cell.place_camera(goal)
    with pytest.raises(UnreachableError, match=r"\[3\.0, 0\.0, 0\.5\].*nearer to the workspace"):
        cell.place_camera(shift([3.0, 0, 0.5]))
    assert apart(goal, cell.truth.world_from_camera)[0] < 1e-5
    assert apart(goal, cell.arm.camera_pose())[0] > 1e-3


@pytest.mark.parametrize("target", OBJECTS)
def test_the_tuned_segmenter_finds_what_the_renderer_knows_to_be_the_object(cell_of, target):
    cell, overlaps = cell_of("floating", target, seed=4), []
    with mujoco.Renderer(cell.model, 480, 640) as renderer:
        renderer.enable_segmentation_rendering()
        for tilt_deg, azimuth_deg, radius in ((0, 0, 0.4), (20, 50, 0.25), (40, 170, 0.5), (30, 290, 0.4)):
            cell.place_camera(above(cell, tilt_deg, azimuth_deg, radius))
            renderer.update_scene(cell.data, "floating")
            geoms = renderer.render()[..., 0]
            truth = (geoms >= 0) & (cell.model.geom_bodyid[geoms] == cell.target_body)
            mask = cell.segmenter(cell.arm.capture())
            overlaps.append((mask & truth).sum() / (mask | truth).sum())
    assert min(overlaps) > 0.95


@pytest.mark.check
def test_move_camera_goes_straight_to_a_pose_in_the_cameras_own_frame_and_knows_where_it_is(cell):
    cell.place_camera(above(cell, 5, 90))
    start, step, seen = cell.arm.camera_pose(), np.array([0.03, -0.02, 0.04]), []
    with cell.watch(lambda: seen.append((cell.truth.world_from_camera.translation, error_of_belief(cell)[0]))):
        motion = cell.arm.move_camera(shift(step))
    assert motion
    assert motion.reason is Outcome.REACHED
    np.testing.assert_array_less(apart(start * shift(step), cell.truth.world_from_camera), (2e-4, np.radians(0.1)))
    direction = start.rotation.apply(step / np.linalg.norm(step))
    places, gaps = zip(*seen, strict=True)
    assert np.linalg.norm(np.cross(places - start.translation, direction), axis=1).max() < 1e-3
    assert max(gaps) < 1e-6


@each_arm
def test_a_motion_smaller_than_the_tolerance_is_still_made(cell_of, arm):
    cell = cell_of(arm)
    cell.place_camera(above(cell, 5, 90))
    for small in (shift([5e-5, 0, 0]), roll(np.radians(0.01))):
        before = cell.truth.world_from_camera
        assert cell.arm.move_camera(small)
        assert max(apart(before * small, cell.truth.world_from_camera)) < 5e-6


@pytest.mark.check
def test_rotate_wrist_rolls_the_camera_about_its_own_axis_with_one_joint(cell):
    cell.place_camera(above(cell, 5, 90))
    before, joints, angle = cell.arm.camera_pose(), cell.arm.joints, np.radians(20)
    error = cell.truth.roll_error()
    assert cell.arm.rotate_wrist(angle)
    assert np.tan(error - angle - cell.truth.roll_error()) == pytest.approx(0, abs=1e-6)  # modulo half a turn
    assert max(apart(before * roll(angle), cell.arm.camera_pose())) < 1e-6
    if cell.arm_spec is not None:
        np.testing.assert_array_equal(cell.arm.joints[:-1], joints[:-1])


@each_arm
@pytest.mark.parametrize(
    ("way", "reasons"),
    [((0, 0, -0.5), {Outcome.COLLISION}), ((1.5, 0, 0), {Outcome.UNREACHABLE, Outcome.JOINT_LIMIT})],
)
def test_an_arm_sent_into_the_table_or_beyond_its_reach_stops_on_the_way_and_says_why(cell_of, arm, way, reasons):
    cell = cell_of(arm)
    cell.place_camera(above(cell, 0, 90))
    start = cell.arm.camera_pose()
    motion = cell.arm.move_camera(start.inv() * shift(way) * start)
    assert not motion
    assert motion.reason in reasons
    assert 0.02 < apart(start, cell.arm.camera_pose())[0] < np.linalg.norm(way)
    assert cell.arm.camera_pose().translation[2] > cell.stage.table_height
    assert error_of_belief(cell)[0] < 1e-6


def test_joints_come_as_copies_and_those_beyond_their_limits_are_refused_before_anything_moves(ur5e):
    q = ur5e.arm.joints
    assert ur5e.arm.move_joints(q + 50.0).reason is Outcome.JOINT_LIMIT
    np.testing.assert_array_equal(ur5e.arm.joints, q)
    q[:] = 99
    assert not (ur5e.arm.joints == 99).any()


@each_arm
def test_a_servo_driven_arm_that_meets_the_table_stops_to_protect_itself(cell_of, arm):
    cell = cell_of(arm, dynamic=True)
    cell.place_camera(shift([0.0, 0.12, 0.0]) * above(cell, 0, 90))  # beside the object: not the brick, but the table
    assert cell.arm.move_camera(shift([0, 0, 0.45])).reason is Outcome.CONTACT
    assert np.isfinite(cell.data.qpos).all()


def test_servos_that_cannot_get_there_are_not_said_to_have_arrived():
    with WorkCell(arm="ur5e", seed=3, dynamic=True) as cell:
        cell.model.actuator_forcerange[:] = [-0.1, 0.1]
        cell.model.actuator_forcelimited[:] = 1
        motion = cell.arm.move_camera(shift([0.15, 0, 0]))
        assert motion.reason is Outcome.STALLED
        assert not motion


def test_what_the_fingers_held_is_forgotten_with_the_episode(cell_of):
    cell = aligned(cell_of("baxter"), 7)
    cell.arm.move_camera(shift([0, 0, 0.17]))
    cell.gripper.close()
    assert cell._drive.held
    cell.reset()
    assert not cell._drive.held


@pytest.mark.parametrize("placement", PLACEMENTS)
@pytest.mark.parametrize(
    ("target", "others"),
    [
        pytest.param("cylinder", ["cuboid_1x4", "cylinder", "cuboid_1x4"], marks=pytest.mark.full),
        ("cuboid_1x2", ["cuboid_1x4", "alligator", "tomato_soup_box", "cuboid_1x4", "cuboid_1x1"]),
    ],
)
def test_objects_do_not_stand_in_each_other_nor_in_a_block_and_are_seen(cell_of, target, placement, others):
    cell = cell_of("floating", target, placement, others=others)
    for seed in range(6):
        cell.reset(seed)
        pairs = [{cell.model.body(body).name for body in cell.model.geom_bodyid[p]} for p in cell.data.contact.geom]
        # Each stands on the plane, the target on its blocks; nothing else touches.
        assert all("world" in pair or pair == {"target", "support_0"} for pair in pairs), seed
        assert cell.data.contact.dist.min() > -0.0005
    cell.place_camera(above(cell, radius=0.6))
    assert all(Blob.from_mask(OBJECTS[other].segmenter(cell.arm.capture())).area > 300 for other in others)


def test_the_overview_shows_the_cell_in_any_size(ur5e):
    for width in (320, 160):
        picture = ur5e.overview(width, 240)
        assert picture.shape == (240, width, 3)
        assert picture.std() > 10


@pytest.mark.parametrize(
    ("error", "options", "text"),
    [
        (UnknownNameError, {"arm": "bakster"}, r"no arm named 'bakster'. Did you mean 'baxter'.*ur5e"),
        (InvalidParameterError, {"noise": "thesis"}, r"Noise\.thesis\(\), or None; got 'thesis'"),
        (InvalidParameterError, {"others": "cylinder"}, r"write others=\['cylinder'\]"),
        (InvalidParameterError, {"arm": "floating", "dynamic": True}, "a floating camera has no dynamics"),
    ],
)
def test_a_cell_that_cannot_be_is_refused_with_what_would_work(error, options, text):
    with pytest.raises(error, match=text):
        WorkCell(**options)


@pytest.mark.parametrize("arm", ["ur5e", "floating"])
@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda cell: cell.arm.rotate_wrist(float("nan")), "finite angle, in rad.*got nan"),
        (lambda cell: cell.arm.move_joints([0.0, 1.0]), "joints.* 6 finite numbers"),
        (lambda cell: cell.arm.move_joints([np.nan] * 6), "joints.* 6 finite numbers"),
        (lambda cell: cell.reset(1.5), "seed is a whole number, 0 or more"),
        (lambda cell: cell.overview(5000, 100), "at most 4096 x 4096 pixels"),
        (lambda cell: cell.place_camera(None), "world_from_camera.*got a NoneType"),
        (
            lambda cell: cell.arm.move_camera(np.eye(3)),
            r"camera_from_target.*or a matrix of shape .4, 4..; got a ndarray",
        ),
        (lambda cell: cell.arm.move_camera(RigidTransform.identity(3)), "camera_from_target is one finite pose"),
        (lambda cell: cell.arm.move_camera(shift([np.nan, 0, 0])), "camera_from_target is one finite pose"),
    ],
)
def test_what_an_arm_or_a_cell_cannot_do_is_refused_with_what_it_can(cell_of, arm, call, text):
    with pytest.raises(InvalidParameterError, match=text):
        call(cell_of(arm))


NAMELESS = mujoco.MjModel.from_xml_string(
    '<mujoco><worldbody><camera name="first"/><camera pos="0 0 .3"/></worldbody></mujoco>'
)


def test_a_camera_without_a_name_goes_by_its_id():
    camera = FloatingCamera(NAMELESS, mujoco.MjData(NAMELESS), 1)
    assert camera.camera_pose().translation.tolist() == [0, 0, 0.3]


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda cell: cell.gripper, r"no gripper.*baxter"),
        (lambda cell: FloatingCamera(cell.model, cell.data, "eye"), r"no camera named 'eye'; it has .*overview"),
        (lambda cell: FloatingCamera(NAMELESS, mujoco.MjData(NAMELESS), ""), r"no camera named ''; it has first, 1$"),
        (lambda cell: FloatingCamera(cell.model, cell.data, "arm/hand_camera"), r"'arm/hand_camera' hangs on a body"),
    ],
)
def test_what_a_scene_does_not_have_is_refused_with_what_there_is(ur5e, call, text):
    with pytest.raises(ModelError, match=text):
        call(ur5e)


@pytest.mark.parametrize("draw", [lambda cell: cell.arm.capture(), WorkCell.overview], ids=["capture", "overview"])
def test_a_picture_from_another_thread_is_refused_with_the_reason(draw, ur5e):
    draw(ur5e)
    with ThreadPoolExecutor(1) as pool, pytest.raises(GvpError, match="one WorkCell per thread"):
        pool.submit(draw, ur5e).result()


FORKS = """
import multiprocessing
import mujoco
from gvp_lib import GvpError, WorkCell

def in_a_fork(draw):
    def child():
        try: there.send(draw(cell).shape)
        except GvpError as error: there.send(str(error))

    here, there = multiprocessing.Pipe()
    process = multiprocessing.get_context("fork").Process(target=child)
    process.start()
    print(here.recv() if here.poll(20) else "waits forever")
    process.kill()

cell = WorkCell(arm="floating")
capture, overview = (lambda cell: cell.arm.capture()), (lambda cell: cell.overview(64, 48))
in_a_fork(capture)
others = mujoco.Renderer(cell.model, 48, 64)
in_a_fork(capture)
capture(cell), overview(cell)
for draw in (capture, overview, lambda _: capture(WorkCell(arm="floating"))):
    in_a_fork(draw)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="a fork is not the way of macOS")
def test_a_process_forked_from_one_that_has_drawn_refuses_to_draw_and_says_what_would_work():
    ran = subprocess.run([sys.executable, "-c", FORKS], capture_output=True, text=True, check=True)
    drawn, *refused = ran.stdout.splitlines()
    assert drawn == "(480, 640, 3)"
    assert len(refused) == 4
    assert all(re.match("this process was forked from one that had drawn.*context=.spawn", each) for each in refused)


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere MuJoCo draws without a screen")
@pytest.mark.parametrize(
    ("first", "backend", "said"),
    [
        ("from gvp_lib import Scene3D; ", None, "drew"),
        ("", "", "drew"),
        ("import mujoco; ", None, "MuJoCo was imported before gvp_lib .* To mend it: import gvp_lib first"),
        ("import mujoco; ", "glfw", r"\(MUJOCO_GL=glfw\): it would draw in a window, .* set MUJOCO_GL=egl"),
        ("", "glx", r"\(MUJOCO_GL=glx\): it would draw in a window, but there is no screen. .* set MUJOCO_GL=egl"),
        ("", "off", r"\(MUJOCO_GL=off\): drawing is turned off. To mend it: set MUJOCO_GL=egl"),
        ("", "egll", "invalid value for environment variable MUJOCO_GL: egll. To mend it: set MUJOCO_GL=egl"),
    ],
)
def test_without_a_screen_it_draws_by_egl_or_says_what_stands_in_the_way(first, backend, said, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL", "PYOPENGL_PLATFORM"):
        monkeypatch.delenv(name, raising=False)
    if backend is not None:
        monkeypatch.setenv("MUJOCO_GL", backend)
    program = f"{first}from gvp_lib import WorkCell; WorkCell(arm='floating').arm.capture(); print('drew')"
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert re.search(said, (ran.stderr + ran.stdout).splitlines()[-1])
