"""What a lens does not see need not be drawn, to the last bit of a picture; and what it bends, it bends as OpenCV's."""

from contextlib import contextmanager

import cv2
import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.simulation.camera import CameraSensor, camera_pose, distorted, out_of_view, renderer, to_mujoco_camera
from gvp_lib.simulation.sensors import EpisodeNoise, Noise
from gvp_lib.simulation.workcell import WorkCell

PERFECT = EpisodeNoise(Noise.none(), 0, np.random.SeedSequence(0))
SHIFTED = CameraIntrinsics(width=640, height=480, fx=500, fy=520, cx=210.0, cy=300.0)
LENSES = {
    "field of view": 'fovy="48.8"',
    "shifted": 'resolution="640 480" sensorsize="0.0064 0.0048" focalpixel="500 520" principalpixel="90 -60"',
}


@contextmanager
def rivals(model, data, camera, **settings):
    """A camera's sensor, and a function that draws the same with everything in the scene."""
    sensor, everything = CameraSensor(model, data, camera, 160, 120, **settings), renderer(model, 160, 120, **settings)

    def draw():
        everything.update_scene(data, camera)
        return everything.render()

    try:
        yield sensor, draw
    finally:
        sensor.close()
        everything.close()


def ball_room(lens, count=60):
    """A camera among balls: some are behind it, and some about its very eye."""
    rng = np.random.default_rng(0)
    numbers = np.c_[rng.uniform(0.01, 0.1, count), rng.uniform(-0.6, 0.6, (count, 3)), rng.uniform(0, 1, (count, 3))]
    balls = "".join(f'<geom size="{r}" pos="{x} {y} {z}" rgba="{red} {green} {blue} 1"/>'
                    for r, x, y, z, red, green, blue in numbers)  # fmt: skip
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><light pos="0 0 2"/>{balls}<camera name="camera" {lens}/></worldbody></mujoco>'
    )


@given(st.integers(0, 2**32), st.floats(0.005, 0.3))
def test_a_sphere_said_to_be_out_of_view_has_no_point_in_the_picture(seed, size):
    rng = np.random.default_rng(seed)
    centers, radii = rng.uniform(-1, 1, (200, 3)), rng.uniform(0, size, 200)
    hidden = out_of_view(SHIFTED, centers, radii)
    directions = rng.standard_normal((200, 100, 3))
    points = centers[:, None] + radii[:, None, None] * directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    u, v = np.moveaxis(SHIFTED.project(points), -1, 0)  # NaN behind the camera
    seen = (u > -0.5) & (u < SHIFTED.width - 0.5) & (v > -0.5) & (v < SHIFTED.height - 0.5)
    assert not seen[hidden].any()
    assert hidden.mean() > 0.3, "it would be of no use"


def test_a_sphere_is_out_of_view_until_it_comes_within_a_millimeter_of_the_picture():
    top_left, bottom_right = SHIFTED.rays([[-0.5, -0.5], [639.5, 479.5]])
    for corner, along in ((top_left, 0), (top_left, 1), (bottom_right, 0), (bottom_right, 1)):
        side = np.cross(np.eye(3)[along], corner)  # across the edge that runs along u or v
        side *= -np.sign(side[2]) / np.linalg.norm(side)  # outward, for the view is ahead
        centers, radii = (0.5 * corner + 0.1 * side)[None], np.array([0.097, 0.0995])
        assert [out_of_view(SHIFTED, centers, radii[i : i + 1])[0] for i in range(2)] == [True, False]


@pytest.mark.parametrize("lens", LENSES.values(), ids=list(LENSES))
def test_pictures_from_anywhere_among_balls_are_the_same_without_those_out_of_view(lens):
    model, rng = ball_room(lens), np.random.default_rng(1)
    data, hidden = mujoco.MjData(model), []
    with rivals(model, data, 0) as (sensor, draw):
        for _ in range(60):
            pose = RigidTransform.from_components(rng.uniform(-0.3, 0.3, 3), Rotation.random(rng=rng))
            model.cam_pos[0], model.cam_quat[0] = to_mujoco_camera(pose)
            sensor.focus(rng.uniform(0.5, 1.5))
            mujoco.mj_forward(model, data)
            np.testing.assert_array_equal(sensor.capture(PERFECT), draw())
            hidden.append(sensor._visibility.unseen(sensor._true_pinhole()).geoms.mean())
    assert np.mean(hidden) > 0.5


@pytest.mark.parametrize("arm", ["floating", "ur5e", "baxter"])
def test_pictures_of_a_cell_are_the_same_without_what_is_out_of_view(arm):
    rng = np.random.default_rng(2)
    with WorkCell(arm, "alligator", "tilted", others=["tomato_soup_box", "cylinder"], seed=3) as cell:
        groups, camera = cell.model.geom_group.copy(), cell._camera
        sphere = VirtualSphere(cell.truth.world_from_object.translation, 0.3)
        with rivals(cell.model, cell.data, camera) as (sensor, draw):
            for view in sphere.random(12, rng, max_tilt=np.radians(30)):
                cell.place_camera(view)
                sensor.focus(rng.uniform(0.7, 1.4))
                np.testing.assert_array_equal(sensor.capture(PERFECT), draw())
                np.testing.assert_array_equal(cell.model.geom_group, groups)
                assert (camera_pose(cell.data, camera).inv() * view).rotation.magnitude() < 1e-2


def test_a_shadow_falls_into_the_picture_from_what_is_out_of_view():
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
        <light pos="0 0 1" dir="0 0 -1" castshadow="true" type="spot" cutoff="80"/><geom type="plane" size="2 2 .1"/>
        <geom type="box" size=".05 .05 .01" pos=".1 0 .5"/><camera pos=".25 0 .4" fovy="40"/></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with rivals(model, data, 0, shadows=True) as (sensor, draw):
        assert sensor._visibility.unseen(sensor._true_pinhole()).geoms[1]
        picture = sensor.capture(PERFECT)
        np.testing.assert_array_equal(picture, draw())
    with rivals(model, data, 0) as (sensor, _):
        assert (sensor.capture(PERFECT) != picture).mean() > 0.02


def test_what_was_not_drawn_is_as_before_even_where_drawing_fails(monkeypatch):
    model = ball_room(LENSES["field of view"])
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    groups = model.geom_group.copy()

    def fails(*_):
        assert (model.geom_group != groups).any()
        raise RuntimeError("out of memory")

    with rivals(model, data, 0) as (sensor, _):
        sensor.capture(PERFECT)
        np.testing.assert_array_equal(model.geom_group, groups)
        monkeypatch.setattr(mujoco.Renderer, "update_scene", fails)
        with pytest.raises(RuntimeError, match="out of memory"):
            sensor.capture(PERFECT)
        np.testing.assert_array_equal(model.geom_group, groups)


def ramp(lens):
    """A picture whose red tells u and whose green v, in steps of four pixels."""
    v, u = np.indices((lens.height, lens.width))
    return np.stack([u // 4, v // 4, np.zeros_like(u)], axis=-1).astype(np.uint8)


@pytest.mark.parametrize("k1", [0.5, 0.1, -0.02, -0.1])
def test_a_distorted_pixel_shows_the_ray_that_opencv_undistorts_it_to(k1):
    picture = distorted(ramp(SHIFTED), SHIFTED, k1).astype(float)
    pixels = np.stack(np.meshgrid(np.arange(0, 640, 7), np.arange(0, 480, 7)), axis=-1).reshape(-1, 2)
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-9)
    straight = cv2.undistortPoints(
        pixels[:, None].astype(float), SHIFTED.matrix, np.r_[k1, 0, 0, 0], R=None, P=SHIFTED.matrix, criteria=criteria
    )[:, 0]
    # Beyond the pinhole's picture its border is repeated.
    expected = np.clip(straight, 0, (639, 479)) / 4 - 0.375  # the middle of a step of four
    shown = picture[pixels[:, 1], pixels[:, 0], :2]
    assert np.abs(shown - expected).max() < 0.9
    assert np.abs((shown - expected).mean(0)).max() < 0.02


def test_a_lens_without_distortion_leaves_the_picture_itself():
    picture = ramp(SHIFTED)
    assert distorted(picture, SHIFTED, 0.0) is picture


def test_the_strongest_barrel_repeats_its_last_rays_where_it_would_fold():
    wide = CameraIntrinsics.from_fov(np.radians(100), 320, 240)
    picture = distorted(ramp(wide), wide, -0.5)[120, :, 0].astype(int)  # red, along the middle row
    assert (np.diff(picture) >= 0).all()
    assert picture[0] == picture[100] > 0
    assert picture[-1] == picture[-101] < 79


@pytest.mark.parametrize("arm", ["floating", "ur5e"])
def test_an_episodes_distortion_bends_the_picture_before_it_is_exposed(arm):
    with WorkCell(arm, noise=Noise(distortion=0.3, exposure=0.3), seed=5) as bent, WorkCell(arm, seed=5) as straight:
        drawn = bent._noise
        assert abs(drawn.distortion) > 0.05
        assert bent.arm.intrinsics == straight.arm.intrinsics
        pinhole = straight.arm.capture()
        expected = drawn.expose(distorted(pinhole, straight.arm.intrinsics, drawn.distortion))
        np.testing.assert_array_equal(bent.arm.capture(), expected)
        assert (expected != drawn.expose(pinhole)).any()
