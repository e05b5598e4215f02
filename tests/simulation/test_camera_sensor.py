"""Where a point is said to appear is where it is rendered: half-pixels, principal points, focal lengths, distortion."""

import cv2
import mujoco
import numpy as np
import pytest

from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.simulation.arms import ARMS
from gvp_lib.simulation.camera import CameraSensor, camera_pose
from gvp_lib.simulation.floating import FloatingCamera
from gvp_lib.simulation.sensors import EpisodeNoise, Noise

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
