"""The simulated camera: where it renders things, what it leaves undrawn, and how its lens bends lines."""

from contextlib import closing, contextmanager
from dataclasses import replace

import cv2
import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.geometry.sphere import VirtualSphere, look_at
from gvp_lib.simulation.camera import (
    CameraSensor,
    camera_pose,
    distorted,
    out_of_view,
    renderer,
    to_mujoco_camera,
    unseen,
)
from gvp_lib.simulation.sensors import EpisodeNoise, Noise

PERFECT = EpisodeNoise(Noise.none(), 0, np.random.SeedSequence(0))
PLACES = [(0, 0, 0.4), (0.08, 0.05, 0.4), (-0.1, 0.06, 0.45), (0.07, -0.08, 0.35), (-0.09, -0.05, 0.5)]  # m, optical
RADIUS = 0.012  # m
SHIFTED = CameraIntrinsics(width=640, height=480, fx=500, fy=520, cx=210.0, cy=300.0)
LENSES = {
    "field of view": 'fovy="48.8"',
    "shifted": 'resolution="640 480" sensorsize="0.0064 0.0048" focalpixel="500 520" principalpixel="90 -60"',
    "other picture": 'resolution="320 320" sensorsize="0.004 0.004" focal="0.003 0.0035" principal="-0.0002 0.0001"',
}


def sensing(model, data, camera=0, size=(640, 480), **settings):
    return closing(CameraSensor(model, data, camera, *size, **settings))


@contextmanager
def rivals(model, data, camera=0, **settings):
    """A camera's sensor, and a function that draws the same with everything in the scene."""

    def draw(*, sky=True):
        everything.scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = sky
        everything.update_scene(data, camera)
        return everything.render()

    with (
        sensing(model, data, camera, (160, 120), **settings) as sensor,
        renderer(model, 160, 120, **settings) as everything,
    ):
        yield sensor, draw


def aim(model, data, world_from_camera):
    model.cam_pos[0], model.cam_quat[0] = to_mujoco_camera(world_from_camera)
    mujoco.mj_forward(model, data)


@pytest.mark.parametrize("camera", ["fixed", "hand_camera"])
@pytest.mark.parametrize("lens", LENSES.values(), ids=list(LENSES))
def test_a_ball_is_rendered_where_the_true_lens_projects_it(lens, camera):
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><visual><headlight ambient="1 1 1" diffuse="0 0 0"/>
        <map znear=".005" zfar="10"/></visual><statistic extent="1"/><worldbody>
        <body name="ball" mocap="true"><geom size="{RADIUS}" rgba="1 0 1 1"/></body>
        <camera name="fixed" pos="0 0 .5" {lens}/>
        <body pos=".1 .2 .6" euler="20 10 30"><joint/><geom size=".001" mass="1" rgba="0 0 0 0"/>
        <camera name="hand_camera" {lens}/></body></worldbody></mujoco>""")
    data, camera = mujoco.MjData(model), model.camera(camera).id
    with sensing(model, data, camera) as sensor:
        stated = sensor.intrinsics
        for scale in (1, 1.05, 0.97):
            sensor.focus(scale)
            assert sensor.intrinsics == stated
            true = CameraIntrinsics(640, 480, scale * stated.fx, scale * stated.fy, stated.cx, stated.cy)
            off = []  # of the ball's silhouette from where its center is said to be, px
            for place in np.array(PLACES):
                mujoco.mj_forward(model, data)
                data.mocap_pos[0] = camera_pose(data, camera).apply(place)
                mujoco.mj_forward(model, data)
                r, g, b = np.moveaxis(sensor.capture(PERFECT).astype(int), -1, 0)
                v, u = np.nonzero(np.minimum(r, b) > g + 20)
                assert len(u) > 300
                # A ball's silhouette is an ellipse about a point a little further out than its center.
                outward = place[:2] * (1 + RADIUS**2 / (place[2] ** 2 - RADIUS**2))
                off.append([u.mean(), v.mean()] - true.project([*outward, place[2]]))
            assert np.abs(off).max() < 0.2
            assert np.abs(np.mean(off, axis=0)).max() < 0.1, "half a pixel would show here"


def ramp(lens):
    """A picture whose red tells u and whose green v, in steps of four pixels."""
    v, u = np.indices((lens.height, lens.width))
    return np.stack([u // 4, v // 4, np.zeros_like(u)], axis=-1).astype(np.uint8)


@pytest.mark.parametrize("k1", [0.5, -0.1])
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
    assert distorted(picture, SHIFTED, 0.0) is picture


def test_the_strongest_barrel_repeats_its_last_rays_where_it_would_fold():
    wide = CameraIntrinsics.from_fov(np.radians(100), 320, 240)
    picture = distorted(ramp(wide), wide, -0.5)[120, :, 0].astype(int)  # red, along the middle row
    assert (np.diff(picture) >= 0).all()
    assert picture[0] == picture[100] > 0
    assert picture[-1] == picture[-101] < 79


@pytest.mark.parametrize("arm", ["floating", "ur5e"])
def test_an_episodes_distortion_bends_the_true_lenss_picture_before_it_is_exposed(arm, cell_of):
    straight = cell_of(arm, noise=Noise(focal_length=0.2), seed=5)
    bent = cell_of(arm, noise=Noise(focal_length=0.2, distortion=0.3, exposure=0.3), seed=5)
    drawn, pinhole, stated = bent._noise, straight.arm.capture(), straight.arm.intrinsics
    assert abs(drawn.distortion) > 0.05
    assert abs(drawn.focal_scale - 1) > 0.02
    assert bent.arm.intrinsics == stated
    lens = replace(stated, fx=drawn.focal_scale * stated.fx, fy=drawn.focal_scale * stated.fy)
    np.testing.assert_array_equal(bent.arm.capture(), drawn.expose(distorted(pinhole, lens, drawn.distortion)))


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


@pytest.mark.parametrize("arm", ["floating", "ur5e", "baxter"])
def test_pictures_of_a_cell_are_the_same_without_what_cannot_show(arm, cell_of):
    rng, skies = np.random.default_rng(2), []
    cell = cell_of(arm, "alligator", "walled", others=["tomato_soup_box", "cylinder"])
    groups, camera = cell.model.geom_group.copy(), cell._camera
    sphere = VirtualSphere(cell.truth.world_from_object.translation, 0.3)
    with rivals(cell.model, cell.data, camera) as (sensor, draw):
        for view in sphere.random(16, rng, max_tilt=np.radians(25)):
            cell.place_camera(view)
            sensor.focus(rng.uniform(0.8, 1.4))
            np.testing.assert_array_equal(sensor.capture(PERFECT), draw())
            np.testing.assert_array_equal(cell.model.geom_group, groups)
            skies.append(unseen(cell.model, cell.data, camera, sensor.pinhole).sky)
        sensor.focus(1.0)
    assert any(skies), "it would be of no use"


def test_a_shadow_falls_into_the_picture_from_what_is_out_of_view():
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
        <light pos="0 0 1" dir="0 0 -1" castshadow="true" type="spot" cutoff="80"/><geom type="plane" size="2 2 .1"/>
        <geom type="box" size=".05 .05 .01" pos=".1 0 .5"/><camera pos=".25 0 .4" fovy="40"/></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with rivals(model, data, shadows=True) as (sensor, draw):
        assert unseen(model, data, 0, sensor.pinhole).geoms[1]
        picture = sensor.capture(PERFECT)
        np.testing.assert_array_equal(picture, draw())
    with sensing(model, data, 0, (160, 120)) as sensor:
        assert (sensor.capture(PERFECT) != picture).mean() > 0.02


def room(table=".6 .5 .4 1", group=0):
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
    <statistic extent="1"/><visual><map znear="0.005" zfar="10"/></visual>
    <asset><texture type="skybox" builtin="gradient" rgb1=".9 .5 .1" rgb2=".1 .2 .9" width="32" height="32"/></asset>
    <worldbody><light pos="0 0 2"/>
    <geom name="floor" type="plane" size="2 2 .1" pos="0 0 -.7" rgba=".2 .5 .2 1"/>
    <geom name="table" type="box" size=".3 .2 .02" pos="0 0 -.02" rgba="{table}" group="{group}"/>
    <geom name="leg" type="cylinder" size=".02 .3" pos=".2 .1 -.35"/>
    <geom name="pin" type="capsule" size=".01 .04" pos=".05 0 0" rgba=".9 .1 .1 1"/>
    <geom name="crumb" size=".01" pos="-.05 0 .01"/>
    <camera name="camera" fovy="45"/></worldbody></mujoco>""")
    return model, mujoco.MjData(model)


@pytest.mark.parametrize(
    ("made", "eye", "target", "names", "sky"),
    [
        pytest.param({}, (0, 0, 0.2), (0, 0, 0), {"floor", "leg"}, True, id="the table fills the picture"),
        pytest.param({}, (0.5, 0, 0.5), (0.1, 0, 0), set(), True, id="the floor fills it around the table"),
        pytest.param({"table": ".6 .5 .4 .5"}, (0, 0, 0.2), (0, 0, 0), set(), True, id="a transparent table"),
        pytest.param({"group": 4}, (0, 0, 0.2), (0, 0, 0), set(), True, id="a table that is not drawn"),
        pytest.param({}, (0, 0, -0.3), (0.01, 0, 0), set(), False, id="a table seen from below"),
        pytest.param({}, (0.02, 0, 0.0055), (0.02, 0, 0), {"crumb"}, True, id="nearer than the near plane"),
    ],
)
def test_what_a_surface_that_fills_the_picture_hides_is_not_drawn(made, eye, target, names, sky):
    model, data = room(**made)
    with rivals(model, data) as (sensor, draw):
        aim(model, data, look_at(eye, target))
        found = unseen(model, data, 0, sensor.intrinsics)
        assert ({model.geom(i).name for i in np.flatnonzero(found.geoms)}, found.sky) == (names, sky)
        np.testing.assert_array_equal(sensor.capture(PERFECT), draw())


def test_the_sky_is_drawn_as_soon_as_one_pixel_of_it_shows():
    """The camera rises from the floor to the horizon: what shows the sky always has it, and no later than it must."""
    (model, data), shown, drawn = room(), [], []
    with rivals(model, data) as (sensor, draw):
        for height in np.linspace(-0.7, 0.6, 60):
            aim(model, data, look_at((-0.6, 0.0, 0.4), (0.2, 0.0, height)))
            np.testing.assert_array_equal(sensor.capture(PERFECT), picture := draw())
            shown.append((picture != draw(sky=False)).any())
            drawn.append(not unseen(model, data, 0, sensor.intrinsics).sky)
    assert 10 < sum(shown) < 50
    assert all(np.array(drawn) >= np.array(shown))
    assert sum(drawn) - sum(shown) <= 1
