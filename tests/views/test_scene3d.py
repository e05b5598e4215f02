"""3D views: pages that are light and ask no network, a server on the loopback only, stills."""

import asyncio
import gc
import gzip
import json
import re
import sys
from contextlib import contextmanager
from dataclasses import replace
from urllib.request import urlopen

import cv2
import mujoco
import numpy as np
import psutil
import pytest
from PIL import Image
from scipy.spatial.transform import RigidTransform
from tornado.websocket import websocket_connect

from gvp_lib.errors import GvpError, InvalidParameterError, UnknownNameError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.simulation.camera import renderer
from gvp_lib.views.page import SCENE_MIME, SceneView, meshcat_script, to_text, write_page
from gvp_lib.views.scene3d import Scene3D
from gvp_lib.views.server import LiveServer

# Not a model of ours: a mesh, every primitive, something invisible and something for collisions only.
FOREIGN = """
<mujoco>
  <asset>
    <mesh name="wedge" vertex="0 0 0  .1 0 0  0 .1 0  0 0 .1"/>
  </asset>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="2 2 .1"/>
    <geom type="box" size=".1 .1 .1" pos=".4 0 .1" rgba=".8 .2 .1 1"/>
    <geom type="mesh" mesh="wedge" pos="0 .4 .05" rgba="0 .6 .3 .5"/>
    <geom type="ellipsoid" size=".1 .05 .05" pos="-.4 0 .1"/>
    <geom type="box" size="1 1 1" group="3"/>
    <geom type="sphere" size="1" rgba="1 1 1 0"/>
    <body name="upper" pos="0 0 .1">
      <joint axis="0 0 1"/>
      <geom type="cylinder" size=".05 .1"/>
      <body name="lower" pos="0 0 .1">
        <joint axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0  .3 0 0" size=".03"/>
        <body pos=".3 0 0">
          <geom type="sphere" size=".04"/>
          <camera name="eye" resolution="640 480" sensorsize=".0064 .0048"
            focalpixel="500 520" principalpixel="20 -10"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def robot() -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(FOREIGN)
    return model, mujoco.MjData(model)


@pytest.fixture
def scene(robot) -> Scene3D:
    return Scene3D(*robot, title="an arm")


def objects(view: SceneView) -> dict[str, dict]:
    return {c["path"]: c["object"] for c in view.payload["commands"] if c["type"] == "set_object"}


def served(view: SceneView) -> str:
    return urlopen(f"http://127.0.0.1:{view.port}/{view.live_path}").read().decode()


def move_to(scene: Scene3D, *joints: float) -> None:
    scene.data.qpos[:] = joints
    mujoco.mj_kinematics(scene.model, scene.data)


def test_every_shape_of_a_foreign_model_is_drawn_once_and_welded_bodies_move_as_one(robot, scene):
    drawn = objects(scene.show())
    lower = robot[0].body("lower").id
    assert sorted(drawn) == ["/bodies/0", f"/bodies/{lower - 1}", f"/bodies/{lower}"]
    assert len(drawn["/bodies/0"]["object"]["children"]) == 4, "collision shapes and invisible ones stay out"
    kinds = [g["type"] for g in drawn[f"/bodies/{lower}"]["geometries"]]
    assert sorted(kinds) == ["LatheGeometry", "SphereGeometry"]
    mesh = [g for g in drawn["/bodies/0"]["geometries"] if g["type"] == "BufferGeometry"]
    assert any(len(g["data"]["attributes"]["position"]["array"]) == 4 * 9 for g in mesh), "a wedge is four triangles"
    collision = objects(Scene3D(*robot, groups=(3,)).show())
    assert [len(o["object"]["children"]) for o in collision.values()] == [1], "a group that is asked for is drawn"


TEXTURED = """
<mujoco>
  <asset>
    <texture name="floor" type="2d" builtin="checker" rgb1="0 0 0" rgb2="1 1 1" width="600" height="600"/>
    <texture name="six" type="cube" builtin="gradient" rgb1="1 0 0" rgb2="0 0 1" width="16" height="96"/>
    <texture name="one" type="cube" builtin="flat" width="16" height="16"/>
    <material name="floor" texture="floor" texrepeat="4 3"/>
    <material name="six" texture="six" metallic=".4"/>
    <material name="one" texture="one" emission=".3"/>
    <mesh name="wedge" vertex="0 0 0 .1 0 0 0 .1 0 0 0 .1" texcoord="0 0 1 0 0 1 1 1" face="0 2 1 0 1 3 0 3 2 1 2 3"/>
  </asset>
  <worldbody>
    <geom type="plane" size="1 2 .1" material="floor"/>
    <geom type="plane" size="0 0 .1" material="floor"/>
    <geom type="box" size=".1 .2 .3" material="floor"/>
    <geom type="box" size=".1 .2 .3" material="six"/>
    <geom type="box" size=".1 .1 .1" material="one"/>
    <geom type="mesh" mesh="wedge" material="floor"/>
    <geom size=".1" material="floor"/>
  </worldbody>
</mujoco>
"""


def test_a_texture_lies_on_a_shape_as_mujoco_puts_it_and_gives_a_round_one_its_mean_color():
    drawn = objects(Scene3D(mujoco.MjModel.from_xml_string(TEXTURED)).show())["/bodies/0"]
    *textured, ball = drawn["geometries"]
    uv = [np.reshape(shape["data"]["attributes"]["uv"]["array"], (-1, 2)) for shape in textured]
    # An infinite plane is drawn 24 m wide, and repeats its texture every 2 m.
    expected = [(4, 3), (12 * 4, 12 * 3), (4, 3), (1, 1), (1, 1), (1, 1)]
    np.testing.assert_allclose([np.ptp(each, axis=0) for each in uv], expected)
    assert len(drawn["textures"]) == len(drawn["images"]) == 3, "equal ones are shared"
    assert all(image["url"].startswith("data:image/png") for image in drawn["images"])
    assert (ball["type"], drawn["materials"][-1]["color"]) == ("SphereGeometry", 0x808080)


# --- pages ------------------------------------------------------------------------------------------------------------


def test_a_saved_page_holds_all_it_needs_and_a_title_cannot_become_markup(robot, tmp_path):
    page = Scene3D(*robot, title="</script><b>@PLAYER@").show().save(tmp_path / "scene.html")
    assert [*tmp_path.iterdir()] == [page]
    text = page.read_text()
    assert meshcat_script().read_text() in text
    own = text.replace(meshcat_script().read_text(), "")
    assert re.findall(r"""(?:src|href)="([^"]*)""", own) == ["data:,"]
    assert not re.search(r"https?://|url\(|@import|fetch\(", own)
    assert "<b>" not in own
    assert "&lt;b&gt;@PLAYER@</title>" in own
    book = write_page({}, "a book's", "../meshcat.min.js")
    assert len(book) < 20_000, "pages that stay together share one script"


def test_a_notebook_gets_a_live_frame_a_stored_scene_and_a_picture_the_same_each_time(robot, scene):
    bundle = scene.show()._repr_mimebundle_()
    assert set(bundle) == {"text/plain", "text/html", "image/png", SCENE_MIME}
    assert str(LiveServer.shared().port) in bundle["text/html"]
    assert "proxy/$" in bundle["text/html"]
    again = Scene3D(*robot, title="an arm").show()._repr_mimebundle_()
    assert bundle == again | {"text/html": bundle["text/html"]}


# --- recordings -------------------------------------------------------------------------------------------------------


def test_a_recording_is_light_gives_back_the_poses_and_has_what_was_drawn_meanwhile(scene, tmp_path):
    seen = []
    with scene.record() as recording:
        for k in range(1, 40):
            move_to(scene, 3 * np.sin(k / 5), np.cos(k / 7))
            scene.capture_frame(k / 30)
            seen.append(scene.data.body("lower").xquat.copy())
        scene.add_points("found", scene.data.body("lower").xpos[None])
    assert "/bodies/0/found" in objects(recording.view), "what a motion finds can be drawn into its recording"
    assert len(gzip.compress(recording.save(tmp_path / "scene.html").read_bytes())) < 500_000
    film = recording.view.payload["animation"]
    assert film["times"][:2] == [0, 33]
    (track,) = [t for t in film["tracks"] if t["path"].endswith(f"/{scene.model.body('lower').id}")]
    quaternions = np.cumsum(np.reshape(track["q"], (-1, 4)), axis=0) * film["steps"][1]
    for wxyz, q in zip(seen, quaternions[1:], strict=True):
        assert abs(abs(np.dot(np.roll(q, 1), wxyz)) - 1) < 1e-3
    assert "p" not in track, "a joint turns about its own origin"
    assert np.all((quaternions[1:] * quaternions[:-1]).sum(axis=1) > 0), "interpolation takes the short way"


def read_mp4(path) -> list[np.ndarray]:
    film = cv2.VideoCapture(str(path))
    assert film.get(cv2.CAP_PROP_FPS) == 10
    return [cv2.cvtColor(film.read()[1], cv2.COLOR_BGR2RGB) for _ in range(int(film.get(cv2.CAP_PROP_FRAME_COUNT)))]


def read_gif(path) -> list[np.ndarray]:
    film, pictures = Image.open(path), []
    for k in range(film.n_frames):
        film.seek(k)
        pictures += [np.asarray(film.convert("RGB"))] * round(film.info["duration"] / 100)
    return pictures


@pytest.mark.parametrize(("ending", "read"), [(".mp4", read_mp4), (".GIF", read_gif)])
def test_a_film_shows_each_frame_until_the_next_ones_time_as_the_page_does(scene, tmp_path, ending, read):
    stills = [scene.look_from(distance=1.2).still(240, 120)]
    with scene.record(fps=10, height=120) as recording:
        for time, turned in ((0.1, 1), (0.4, -1)):
            move_to(scene, turned, 0.5)
            scene.capture_frame(time)
            stills.append(scene.still(240, 120))
    scene.look_from(azimuth=2)
    scene.add_points("later", np.zeros((1, 3)), radius=1)
    pictures = read(recording.save(tmp_path / f"arm{ending}"))
    far = np.array([[np.abs(seen.astype(int) - still).mean() for still in stills] for seen in pictures])
    np.testing.assert_array_equal(far.argmin(axis=1), (0, 1, 1, 1, 2))
    assert far.min(axis=1).max() < 3 < np.abs(scene.still(240, 120).astype(int) - stills[0]).mean()


def test_a_recording_is_saved_as_what_its_ending_says_or_not_at_all(scene, tmp_path):
    with scene.record() as recording:
        move_to(scene, 1, 0)
        scene.capture_frame(1)
    for view in (recording, scene.show()):
        assert cv2.imread(str(view.save(tmp_path / "arm.png"))).shape == (420, 840, 3)
        for name in ("arm.avi", "arm"):
            with pytest.raises(InvalidParameterError, match=rf"\.html.*\.png.*\.mp4 or \.gif; got '.*{name}'"):
                view.save(tmp_path / "new" / name)
    assert [path.name for path in tmp_path.iterdir()] == ["arm.png"]


def test_a_source_that_can_be_watched_is_recorded_and_followed_by_itself(robot):
    class Cell:
        model, data = robot
        time, callback = 0.0, None

        @contextmanager
        def watch(self, callback):
            self.callback = callback
            yield
            self.callback = None

    cell = Cell()
    scene = Scene3D(cell)
    with scene.record(fps=10) as recording:
        for _ in range(100):
            cell.time += 0.02
            cell.callback()
    assert np.allclose(np.diff(recording.times), 0.1), "at the rate asked for"
    assert cell.callback is None
    scene.show()
    cell.callback()  # nobody looks, so that it does not wait
    scene.close()
    assert cell.callback is None


def test_a_scene_follows_a_source_that_compiles_its_model_anew_but_a_recording_cannot(robot):
    class Cell:
        model, data = robot

    scene = Scene3D(Cell)
    with scene.record():
        Cell.model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='.1'/></worldbody></mujoco>")
        Cell.data = mujoco.MjData(Cell.model)
        with pytest.raises(InvalidParameterError, match="rebuilt while it was recorded"):
            scene.capture_frame(1)
    assert list(objects(scene.show())) == ["/bodies/0"]


def test_a_recording_is_served_while_it_exists_and_one_in_which_nothing_moves_is_a_plain_scene(scene):
    with scene.record() as recording:
        pass
    view = recording.view
    del recording
    gc.collect()
    assert "animation" not in view.payload
    assert to_text(view.payload) in served(view)
    address = f"http://127.0.0.1:{view.port}/{view.live_path}"
    del view
    gc.collect()
    with pytest.raises(OSError, match="404"):
        urlopen(address)


# --- the live server --------------------------------------------------------------------------------------------------


def test_the_server_listens_on_the_loopback_only_prints_nothing_and_asks_for_its_token(scene, capfd):
    view = scene.show()
    assert '"live":true' in served(view)
    listening = {c.laddr for c in psutil.Process().net_connections("inet") if c.status == psutil.CONN_LISTEN}
    assert view.port in {address.port for address in listening}
    assert {address.ip for address in listening} == {"127.0.0.1"}
    with pytest.raises(OSError, match="404"):
        served(replace(view, live_path=view.live_path.replace(LiveServer.shared().token, "guess")))
    scene.close()
    with pytest.raises(OSError, match="404"):
        served(view)
    assert capfd.readouterr() == ("", "")


def test_a_browser_gets_the_scene_and_then_its_motion(scene):
    view = scene.show()

    async def look():
        socket = await websocket_connect(f"ws://127.0.0.1:{view.port}/{view.live_path}socket")
        whole = json.loads(await socket.read_message())
        while not scene._channel.listeners:
            await asyncio.sleep(0.01)
        move_to(scene, 1, 0)
        scene.update()
        return whole, json.loads(await asyncio.wait_for(socket.read_message(), 5))

    whole, update = asyncio.run(look())
    assert {"set_object", "pose"} == {c["type"] for c in whole}
    assert update[0]["pose"][3:] == pytest.approx([0, 0, np.sin(0.5), np.cos(0.5)], abs=1e-4)
    script = served(view).split('<script src="')[1].split('"')[0]
    assert len(urlopen(f"http://127.0.0.1:{view.port}/{view.live_path}{script}").read()) > 500_000


def test_where_no_socket_can_be_bound_the_server_says_so(monkeypatch):
    def refuse(*args, **kwargs):
        raise OSError(99, "Cannot assign requested address")

    monkeypatch.setattr("gvp_lib.views.server.netutil.bind_sockets", refuse)
    with pytest.raises(GvpError, match=r"Cannot assign requested address.*still\(\)"):
        LiveServer()


# --- stills -----------------------------------------------------------------------------------------------------------


def test_a_still_is_an_rgb_image_with_the_scene_and_its_overlays_whatever_was_rendered_before(robot, scene):
    still = scene.look_from(azimuth=-0.6, elevation=0.5).still(160, 120)
    assert (still.shape, still.dtype) == ((120, 160, 3), np.uint8)
    assert still.std() > 10
    with renderer(robot[0], 64, 48, samples=0) as hand:
        hand.update_scene(robot[1])
        hand.render()
    np.testing.assert_array_equal(scene.still(160, 120), still)
    scene.add_frame("frame", RigidTransform.from_translation([0, 0, 0.5]), size=0.4)
    assert np.any(scene.still(160, 120) != still)


def test_a_still_without_a_screen_is_refused_where_it_would_end_the_process(scene, monkeypatch):
    context = sys.modules[mujoco.Renderer.__module__].gl_context.GLContext
    monkeypatch.setattr(context, "__module__", "mujoco.glfw")
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(GvpError, match="MUJOCO_GL=egl"):
        scene.still(160, 120)


# --- overlays ---------------------------------------------------------------------------------------------------------


def test_overlays_draw_where_they_should(scene):
    sphere = VirtualSphere((0.4, 0, 0.1), 0.3, pole=(0, 1, 0))
    scene.add_sphere("cap", sphere, max_tilt=np.radians(20))
    _, _, cap = scene._overlays["cap"]
    outward = cap.rods[0][0].reshape(-1, 3) - sphere.center
    np.testing.assert_allclose(np.linalg.norm(outward, axis=1), sphere.radius)
    assert np.isclose((outward @ sphere.pole / sphere.radius).min(), np.cos(np.radians(20)))

    camera = CameraIntrinsics.from_fov(0.8, 64, 48)
    scene.add_frustum("seen", sphere.viewpoint(0.1, 0.2), camera, depth=0.2, image=np.zeros((48, 64, 3), np.uint8))
    _, pose, frustum = scene._overlays["seen"]
    corners = frustum.rods[0][0][:4, 1]
    np.testing.assert_allclose(corners[:, 2], 0.2)
    np.testing.assert_allclose(camera.project(corners)[[0, 2]], [(-0.5, -0.5), (63.5, 47.5)], atol=1e-9)
    np.testing.assert_allclose(pose, sphere.viewpoint(0.1, 0.2).as_matrix())

    scene.add_path("way", sphere.uniform(9))
    scene.add_path("line", np.eye(3))
    scene.add_points("line", np.eye(3))  # in place of the path
    scene.remove("way")
    assert {path for path in objects(scene.show()) if path.count("/") > 2} == {
        f"/bodies/0/{name}" for name in ("cap", "seen", "line")
    }


def test_a_named_camera_carries_its_frustum_along_shifted_as_its_lens_is(scene):
    scene.add_frustum("hand", camera="eye", depth=0.2)
    body, pose, frustum = scene._overlays["hand"]
    assert scene.model.body(body).name == "lower", "the body that moves, to which the camera's is welded"
    # MuJoCo's camera looks along -z of its body; the optical axis is column z.
    np.testing.assert_allclose(pose[:3, 2:], np.transpose([(0, 0, -1), (0.3, 0, 0)]), atol=1e-12)
    # The picture's left edge is 300 pixels from where the lens points, its right edge 340.
    corners = np.round(frustum.rods[0][0][:4, 1] / 0.2 * (500, 520, 1))
    np.testing.assert_array_equal([corners.min(axis=0), corners.max(axis=0)], [(-300, -250, 1), (340, 230, 1)])


@pytest.mark.parametrize(
    ("misuse", "error", "said"),
    [
        (lambda scene: scene.add_frustum("hand", camera="hand_camera"), UnknownNameError, "Known: eye"),
        (lambda scene: scene.add_frustum("hand"), InvalidParameterError, "camera='a name'"),
        (lambda scene: scene.add_points("a/b", np.eye(3)), InvalidParameterError, "holds no '/'; got 'a/b'"),
        (lambda scene: scene.remove("nothing"), UnknownNameError, "no overlay"),
        (lambda scene: scene.look_from(distance=0), InvalidParameterError, "positive, meters; got 0"),
        (
            lambda scene: scene.look_from(target=(1, 2)),
            InvalidParameterError,
            r"target is finite, of shape \(3,\); got \(1, 2\)",
        ),
        (lambda scene: scene.capture_frame(), InvalidParameterError, r"with scene\.record"),
        (lambda scene: scene.record(fps=0).__enter__(), InvalidParameterError, "fps is positive.*got 0"),
        (lambda scene: Scene3D("a scene"), InvalidParameterError, r"\.model and \.data"),
    ],
)
def test_misuse_is_told_what_would_work(scene, misuse, error, said):
    with pytest.raises(error, match=said):
        misuse(scene)


def test_a_recording_is_not_shown_before_it_is_finished_nor_begun_twice(scene):
    with scene.record() as recording:
        with pytest.raises(InvalidParameterError, match="leave the `with` block first"):
            _ = recording.view
        with pytest.raises(InvalidParameterError, match="recorded already"), scene.record():
            pass
