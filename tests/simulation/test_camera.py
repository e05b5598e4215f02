"""The simulated camera: where it renders things, what it leaves undrawn, and how its lens bends lines."""

from contextlib import contextmanager

import cv2
import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.geometry.sphere import VirtualSphere, look_at
from gvp_lib.simulation.arms import ARMS
from gvp_lib.simulation.camera import (
    CameraSensor,
    Unseen,
    Visibility,
    camera_pose,
    distorted,
    out_of_view,
    renderer,
    to_mujoco_camera,
)
from gvp_lib.simulation.robot import FloatingCamera
from gvp_lib.simulation.sensors import EpisodeNoise, Noise
from gvp_lib.simulation.workcell import WorkCell

PERFECT = EpisodeNoise(Noise.none(), 0, np.random.SeedSequence(0))
PLACES = [
    (0, 0, 0.4),
    (0.08, 0.05, 0.4),
    (-0.1, 0.06, 0.45),
    (0.07, -0.08, 0.35),
    (-0.09, -0.05, 0.5),
]  # m, optical frame
CORNERS = [(0.14, 0.1, 0.4), (-0.14, 0.1, 0.4), (0.14, -0.1, 0.4)]
RADIUS = 0.012  # m
LENSES = {
    "field of view": 'fovy="48.8"',
    "shifted": 'resolution="640 480" sensorsize="0.0064 0.0048" focalpixel="500 520" principalpixel="20 -10"',
    "other picture": 'resolution="320 320" sensorsize="0.004 0.004" focal="0.003 0.0035" principal="-0.0002 0.0001"',
}


def scene(lens):
    return mujoco.MjSpec.from_string(f"""<mujoco><worldbody><camera name="floating" pos="0 0 .5" {lens}/>
        <body name="hand" pos=".1 .2 .6" euler="20 10 30"><joint/><geom size=".001" mass="1" rgba="0 0 0 0"/>
        <camera name="hand_camera" {lens}/></body></worldbody></mujoco>""")


def add_ball(spec):
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [1.0] * 3, [0.0] * 3
    spec.visual.headlight.specular = [0.0] * 3
    spec.visual.map.znear, spec.visual.map.zfar, spec.stat.extent = 0.005, 10.0, 1.0
    ball = spec.worldbody.add_body(name="ball", mocap=True)
    ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[RADIUS, 0, 0], rgba=[1, 0, 1, 1], contype=0, conaffinity=0)


def offsets(model, data, camera, capture, project, places=PLACES):
    """Where the ball's silhouette is minus where its center is said to be, shape (n, 2), pixels."""
    found = []
    for place in np.array(places):
        mujoco.mj_forward(model, data)
        data.mocap_pos[model.body("ball").mocapid[0]] = camera_pose(data, camera).apply(place)
        mujoco.mj_forward(model, data)
        r, g, b = np.moveaxis(capture().astype(int), -1, 0)
        v, u = np.nonzero(np.minimum(r, b) > g + 20)
        assert len(u) > 300
        share = (np.minimum(r, b) - g)[v, u]  # of a pixel that is the ball's, where a lens has blurred its edge
        # A ball's silhouette is an ellipse about a point a little further out than its center.
        outward = place[:2] * (1 + RADIUS**2 / (place[2] ** 2 - RADIUS**2))
        found.append(np.average([u, v], axis=1, weights=share) - project([*outward, place[2]]))
    return np.array(found)


@pytest.mark.parametrize("camera", ["floating", "hand_camera"])
@pytest.mark.parametrize("lens", LENSES.values(), ids=list(LENSES))
def test_a_ball_is_rendered_where_the_stated_lens_projects_it(lens, camera):
    spec = scene(lens)
    add_ball(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    sensor = CameraSensor(model, data, model.camera(camera).id, 640, 480)
    off = offsets(model, data, model.camera(camera).id, lambda: sensor.capture(PERFECT), sensor.intrinsics.project)
    sensor.close()
    assert np.abs(off).max() < 0.2
    assert np.abs(off.mean(0)).max() < 0.1, "half a pixel would show here"


@pytest.mark.parametrize("lens", LENSES.values(), ids=list(LENSES))
def test_a_focal_length_that_is_not_the_stated_one_enlarges_the_picture_about_its_principal_point(lens):
    spec = scene(lens)
    add_ball(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    sensor = CameraSensor(model, data, 0, 640, 480)
    stated = sensor.intrinsics
    for scale in (1.05, 0.97):  # of the stated one, and not of the last
        sensor.focus(scale)

        def enlarged(point, scale=scale):
            return stated.principal_point + scale * (stated.project(point) - stated.principal_point)

        off = offsets(model, data, 0, lambda: sensor.capture(PERFECT), enlarged)
        assert np.abs(off).max() < 0.2
    sensor.close()


def projected(lens, k1):
    """A projection onto a lens with radial distortion, by OpenCV."""
    return lambda point: cv2.projectPoints(
        np.array([point]), np.zeros(3), np.zeros(3), lens.matrix, np.r_[k1, 0, 0, 0]
    )[0].ravel()


@pytest.mark.parametrize("k1", [0.3, 0.05, -0.05, -0.3])
@pytest.mark.parametrize("lens", LENSES.values(), ids=list(LENSES))
def test_a_ball_is_rendered_where_opencv_puts_it_through_a_distorting_lens(lens, k1):
    spec = scene(lens)
    add_ball(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    sensor = CameraSensor(model, data, 0, 640, 480)
    sensor.focus(0.95, k1)
    stated = sensor.intrinsics
    true = CameraIntrinsics(640, 480, 0.95 * stated.fx, 0.95 * stated.fy, stated.cx, stated.cy)
    off = offsets(model, data, 0, lambda: sensor.capture(PERFECT), projected(true, k1), [*PLACES, *CORNERS])
    assert np.abs(off).max() < 0.3
    sensor.focus(0.95)
    off = offsets(model, data, 0, lambda: sensor.capture(PERFECT), projected(true, k1), CORNERS)
    assert np.abs(off).max() > 20 * abs(k1), "without it the ball is elsewhere"
    sensor.close()


@pytest.mark.parametrize("name", list(ARMS))
def test_the_arms_own_cameras_render_a_ball_where_they_say(name):
    arm = ARMS[name]
    spec = arm.load()
    add_ball(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[[model.joint(joint).qposadr[0] for joint in arm.joints]] = arm.home
    camera = model.camera(arm.camera).id
    sensor = CameraSensor(model, data, camera, *arm.image_size)
    off = offsets(model, data, camera, lambda: sensor.capture(PERFECT), sensor.intrinsics.project)
    sensor.close()
    assert np.abs(off).max() < 0.2


def test_a_floating_camera_renders_a_ball_where_it_says():
    spec = scene(LENSES["field of view"])
    add_ball(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    camera = FloatingCamera(model, data)
    off = offsets(model, data, 0, camera.capture, camera.intrinsics.project)
    camera._sensor.close()
    assert np.abs(off).max() < 0.2


SHIFTED = CameraIntrinsics(width=640, height=480, fx=500, fy=520, cx=210.0, cy=300.0)
WIDE_AND_SHIFTED = {
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


@pytest.mark.parametrize("lens", WIDE_AND_SHIFTED.values(), ids=list(WIDE_AND_SHIFTED))
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
    model = ball_room(WIDE_AND_SHIFTED["field of view"])
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


ROOM = """<mujoco><statistic extent="1"/><visual><map znear="0.005" zfar="10"/></visual>
    <asset><texture type="skybox" builtin="gradient" rgb1=".9 .5 .1" rgb2=".1 .2 .9" width="32" height="32"/></asset>
    <worldbody><light pos="0 0 2"/>
    <geom name="floor" type="plane" size="2 2 .1" pos="0 0 -.7" rgba=".2 .5 .2 1"/>
    <geom name="table" type="box" size=".3 .2 .02" pos="0 0 -.02" rgba="{table}" group="{group}"/>
    <geom name="leg" type="cylinder" size=".02 .3" pos=".2 .1 -.35"/>
    <geom name="pin" type="capsule" size=".01 .04" pos=".05 0 0" rgba=".9 .1 .1 1"/>
    <geom name="crumb" size=".01" pos="-.05 0 .01"/>
    <camera name="camera" fovy="45"/></worldbody></mujoco>"""


@contextmanager
def room(*, shadows=False, table=".6 .5 .4 1", group=0):
    """A camera's sensor in a room, and functions that aim it and that draw the same with everything in the scene."""
    model = mujoco.MjModel.from_xml_string(ROOM.format(table=table, group=group))
    data = mujoco.MjData(model)
    sensor = CameraSensor(model, data, 0, 160, 120, shadows=shadows)
    everything = renderer(model, 160, 120, shadows=shadows)

    def aim(eye, target):
        model.cam_pos[0], model.cam_quat[0] = to_mujoco_camera(look_at(eye, target))
        mujoco.mj_forward(model, data)

    def draw(*, sky=True):
        everything.scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = sky
        everything.update_scene(data, 0)
        return everything.render()

    try:
        yield sensor, aim, draw
    finally:
        sensor.close()
        everything.close()


def unseen(sensor: CameraSensor) -> tuple[set[str], bool]:
    """Names of the geoms that the sensor's picture cannot show, and whether the sky is among what it cannot."""
    found: Unseen = sensor._visibility.unseen(sensor.intrinsics)
    return {sensor._model.geom(i).name for i in np.flatnonzero(found.geoms)}, found.sky


def test_where_the_table_fills_the_picture_nothing_below_it_is_drawn_nor_the_sky():
    with room() as (sensor, aim, draw):
        aim((0.0, 0.0, 0.2), (0.0, 0.0, 0.0))
        assert unseen(sensor) == ({"floor", "leg"}, True)
        np.testing.assert_array_equal(sensor.capture(PERFECT), draw())


def test_where_the_floor_fills_the_picture_around_the_table_only_the_sky_is_left_out():
    with room() as (sensor, aim, draw):
        aim((0.5, 0.0, 0.5), (0.1, 0.0, 0.0))
        assert unseen(sensor) == (set(), True)
        np.testing.assert_array_equal(sensor.capture(PERFECT), draw())


def test_the_sky_is_drawn_as_soon_as_one_pixel_of_it_shows():
    """The camera rises from the floor to the horizon: what shows the sky always has it, and no later than it must."""
    shown, drawn = [], []
    with room() as (sensor, aim, draw):
        for height in np.linspace(-0.7, 0.6, 60):
            aim((-0.6, 0.0, 0.4), (0.2, 0.0, height))
            np.testing.assert_array_equal(sensor.capture(PERFECT), picture := draw())
            shown.append((picture != draw(sky=False)).any())
            drawn.append(not unseen(sensor)[1])
    assert 10 < sum(shown) < 50
    assert all(np.array(drawn) >= np.array(shown))
    assert sum(drawn) - sum(shown) <= 1


@pytest.mark.parametrize("settings", [{"table": ".6 .5 .4 .5"}, {"group": 4}], ids=["transparent", "not drawn"])
def test_a_table_that_hides_nothing_leaves_all_to_be_drawn(settings):
    with room(**settings) as (sensor, aim, draw):
        aim((0.0, 0.0, 0.2), (0.0, 0.0, 0.0))
        assert unseen(sensor) == (set(), True)  # the floor still hides the sky
        np.testing.assert_array_equal(sensor.capture(PERFECT), draw())


def test_a_table_seen_from_below_hides_nothing():
    with room() as (sensor, aim, draw):
        aim((0.0, 0.0, -0.3), (0.01, 0.0, 0.0))
        hidden, sky = unseen(sensor)
        assert "pin" not in hidden
        assert not sky
        np.testing.assert_array_equal(sensor.capture(PERFECT), draw())


def test_a_table_nearer_than_the_near_plane_hides_nothing():
    with room() as (sensor, aim, draw):
        aim((0.02, 0.0, 0.0055), (0.02, 0.0, 0.0))
        hidden, sky = unseen(sensor)
        assert "leg" not in hidden or not sky
        np.testing.assert_array_equal(sensor.capture(PERFECT), draw())


def test_with_shadows_everything_is_drawn_but_the_sky():
    with room(shadows=True) as (sensor, aim, draw):
        aim((0.1, 0.0, 0.3), (0.0, 0.0, 0.0))
        np.testing.assert_array_equal(sensor.capture(PERFECT), draw())


def test_a_surface_said_to_fill_the_picture_is_met_by_every_ray():
    model = mujoco.MjModel.from_xml_string(ROOM.format(table="1 1 1 1", group=0))
    data, rng, filled = mujoco.MjData(model), np.random.default_rng(0), 0
    lens = CameraIntrinsics.from_fov(np.radians(45), 160, 120)
    visibility = Visibility(model, data, 0)
    v, u = np.indices((120, 160))
    for _ in range(600):
        eye, target = rng.uniform((-0.2, -0.2, 0.02), (0.2, 0.2, 0.3)), rng.uniform(-0.15, 0.15, 3) * (1, 1, 0)
        roll = RigidTransform.from_rotation(Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)))
        world_from_camera = look_at(eye, target) * roll
        model.cam_pos[0], model.cam_quat[0] = to_mujoco_camera(world_from_camera)
        mujoco.mj_forward(model, data)
        if not visibility.unseen(lens).geoms[model.geom("floor").id]:
            continue  # a plane is never out of view, so only the table hides it
        filled += 1
        rays = world_from_camera.rotation.apply(lens.rays(np.stack([u, v], -1).reshape(-1, 2)))
        hits = eye + rays * (-eye[2] / rays[:, 2])[:, None]
        assert (rays[:, 2] < 0).all()
        assert (np.abs(hits[:, :2]) < (0.3, 0.2)).all()
    assert 20 < filled < 580


@pytest.mark.parametrize("arm", ["floating", "ur5e", "baxter"])
def test_pictures_of_a_cell_are_the_same_without_what_the_table_hides(arm):
    rng, hidden = np.random.default_rng(4), []
    with WorkCell(arm, "cuboid_1x2", "walled", others=["cylinder"], seed=5) as cell:
        camera, everything = cell._camera, renderer(cell.model, 160, 120)
        sensor = CameraSensor(cell.model, cell.data, camera, 160, 120)
        sphere = VirtualSphere(cell.truth.world_from_object.translation, 0.3)
        for view in sphere.random(16, rng, max_tilt=np.radians(20)):
            cell.place_camera(view)
            everything.update_scene(cell.data, camera)
            np.testing.assert_array_equal(sensor.capture(PERFECT), everything.render())
            hidden.append("floor" in unseen(sensor)[0])
        sensor.close()
        everything.close()
    assert any(hidden), "it would be of no use"
