"""What a picture cannot show is not drawn, and no pixel of it changes: below a table that fills it, and the sky."""

from contextlib import contextmanager

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.geometry.sphere import VirtualSphere, look_at
from gvp_lib.simulation.camera import CameraSensor, Unseen, Visibility, renderer, to_mujoco_camera
from gvp_lib.simulation.sensors import EpisodeNoise, Noise
from gvp_lib.simulation.workcell import WorkCell

PERFECT = EpisodeNoise(Noise.none(), 0, np.random.SeedSequence(0))
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
