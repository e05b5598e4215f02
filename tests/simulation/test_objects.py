import dataclasses
import os

os.environ.setdefault("MUJOCO_GL", "egl")

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError, ModelError, UnknownNameError
from gvp_lib.evaluation.episodes import begin, draw_start
from gvp_lib.geometry.sphere import VirtualSphere, look_at
from gvp_lib.learning.collect import Collector
from gvp_lib.learning.recipe import CollectionRecipe
from gvp_lib.perception.segmentation import HsvThreshold
from gvp_lib.simulation.objects import OBJECTS, ObjectSpec, object_spec
from gvp_lib.simulation.scene import add_object
from gvp_lib.simulation.truth import AcceptedNormal, CanonicalNormal
from gvp_lib.simulation.workcell import WorkCell

SIZES_MM = {
    "cuboid_1x1": (31.8, 31.8, 23.7),
    "cuboid_1x2": (63.6, 31.8, 23.7),
    "cuboid_1x3": (95.4, 31.8, 23.7),
    "cuboid_1x4": (127.2, 31.8, 23.7),
    "cylinder": (60, 60, 150),
    "alligator": (120, 45, 35),
    "tomato_soup_box": (67, 67, 100),
}
TABLE = """
<mujoco>
  <visual>
    <headlight ambient=".4 .4 .4" diffuse=".2 .2 .2" specular="0 0 0"/>
    <global offwidth="640" offheight="480"/>
    <quality offsamples="0"/>
  </visual>
  <worldbody>
    <light type="directional" dir="0.2 0.1 -1" diffuse=".5 .5 .5" specular="0 0 0" castshadow="false"/>
    <geom name="table" type="plane" size="1 1 .1" rgba=".72 .70 .66 1"/>
    <camera name="camera" fovy="48.8"/>
  </worldbody>
</mujoco>"""
BOX = '<geom type="box" size=".02 .03 .01"/>'


def document(inside: str) -> str:
    return f"<mujoco><worldbody>{inside}</worldbody></mujoco>"


def anything(rgb):
    return np.ones(rgb.shape[:2], bool)


def turned(axis: str, degrees: float) -> RigidTransform:
    return RigidTransform.from_rotation(Rotation.from_euler(axis, degrees, degrees=True))


def test_the_thesis_has_seven_objects():
    assert set(OBJECTS) == set(SIZES_MM)
    assert all(spec.name == name and spec.title for name, spec in OBJECTS.items())


@pytest.mark.parametrize("name", SIZES_MM)
def test_every_object_has_its_published_size_and_is_centered(name):
    box = OBJECTS[name].bounding_box()
    np.testing.assert_allclose(2e3 * box.half_extents, SIZES_MM[name], atol=0.05)
    np.testing.assert_allclose(1e3 * box.center, 0, atol=0.05)


@pytest.mark.parametrize("name", SIZES_MM)
def test_every_object_weighs_what_a_hand_would_expect(name):
    low, high = {"cylinder": (0.1, 0.3), "tomato_soup_box": (0.3, 0.5)}.get(name, (0.005, 0.05))
    assert low < OBJECTS[name].load().compile().body_mass.sum() < high


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_a_brick_has_two_studs_per_pitch_and_row(n):
    model = OBJECTS[f"cuboid_1x{n}"].load().compile()
    studs = [i for i in range(model.ngeom) if model.geom(i).name.startswith("stud")]
    assert len(studs) == 4 * n
    assert np.ptp(model.geom_pos[studs, 0]) == pytest.approx((2 * n - 1) * 0.0159)


def test_the_known_objects_are_listed_for_an_unknown_name():
    with pytest.raises(UnknownNameError, match=r"no object named 'cilinder'.*Did you mean 'cylinder'.*cuboid_1x4"):
        object_spec("cilinder")


def test_a_spec_stands_for_itself():
    spec = ObjectSpec("mine", document(f"<body>{BOX}</body>"), anything)
    assert object_spec(spec) is spec
    assert object_spec("alligator") is OBJECTS["alligator"]


@pytest.mark.parametrize(
    ("mjcf", "text"),
    [
        (document(f'<body name="a">{BOX}</body><body name="b">{BOX}</body>'), "'a', 'b'"),
        (document(""), "exactly one body.* it has none"),
        (document(f'<body><freejoint name="float"/>{BOX}</body>'), "no joint; it has 'float'.*adds the free joint"),
        (document(f'<body>{BOX}<body><joint name="lid"/>{BOX}</body></body>'), "no joint; it has 'lid'"),
        (document('<body><geom type="box" size="-1 1 1"/></body>'), "'mine' does not compile"),
        ("<mujoco><worldbody>", "'mine' cannot be read"),
        ("no/such/file.xml", "'mine' cannot be read"),
    ],
)
def test_a_bad_mjcf_is_refused_with_its_reason(mjcf, text):
    with pytest.raises(ModelError, match=text):
        ObjectSpec("mine", mjcf, anything).load()


def test_a_picture_for_a_texture_that_is_not_declared_is_refused():
    pixels = np.zeros((6, 1, 3), np.uint8)
    spec = ObjectSpec("mine", document(f"<body>{BOX}</body>"), anything, textures={"label": pixels})
    with pytest.raises(ModelError, match="declares no texture 'label'; it has none"):
        spec.load()


def test_an_object_that_touches_nothing_has_no_bounding_box():
    ghost = document('<body><geom type="box" size="1 1 1" contype="0" conaffinity="0" mass="1"/></body>')
    with pytest.raises(ModelError, match="no geom that can touch"):
        ObjectSpec("ghost", ghost, anything).bounding_box()


@pytest.mark.parametrize(("size", "told"), [("30 20 20", "60 x 40 x 40 m"), (".0003 .0002 .0002", "0.0006 x 0.0004")])
def test_an_object_that_is_not_in_meters_is_refused_with_the_size_found(size, told):
    box = ObjectSpec("mine", document(f'<body><geom type="box" size="{size}"/></body>'), anything)
    with pytest.raises(ModelError, match=rf"'mine' measures {told}.*meters.*divide each size"):
        WorkCell("floating", box)


def test_an_object_whose_origin_is_at_its_base_is_refused_by_those_who_look_at_its_origin():
    def standing(z):
        return ObjectSpec(
            "mine", document(f'<body><geom type="box" size=".02 .02 .04" pos="0 0 {z}"/></body>'), anything
        )

    assert standing(0.0039).centered().name == "mine"  # 5 % of 8 cm
    text = r"'mine' must be the middle of its bounding box, which is at 0 0 0\.04 .*by 0 0 -0\.04"
    with pytest.raises(ModelError, match=text):
        standing(0.04).centered()
    with WorkCell("floating", standing(0.04), seed=1) as cell:  # which stands, and may be planned for
        with pytest.raises(ModelError, match=text):
            draw_start(cell, np.random.default_rng(0))
        with pytest.raises(ModelError, match=text):
            begin(cell, {"target": "mine", "placement": "flat", "seed": 0, "k": 0})
    recipe = {"arm": "floating", "target": standing(0.04)}
    with pytest.raises(ModelError, match=text):
        Collector(CollectionRecipe(**recipe, n=8, rolls=4))


@pytest.mark.parametrize("name", OBJECTS)
def test_every_object_of_ours_is_centered(name):
    assert OBJECTS[name].centered() is OBJECTS[name]


def test_the_bounding_box_follows_turned_parts_nested_bodies_and_an_offset_body():
    xml = """
    <body pos="1 2 3" euler="0 0 90">
      <geom type="cylinder" size=".01 .05" euler="0 90 0"/>
      <body pos="0 0 .1"><geom type="sphere" size=".02"/></body>
      <geom type="box" size="9 9 9" contype="0" conaffinity="0" mass="0"/>
    </body>"""
    box = ObjectSpec("mine", document(xml), anything).bounding_box()
    np.testing.assert_allclose(box.half_extents, (0.05, 0.02, 0.065), atol=1e-9)
    np.testing.assert_allclose(box.center, (0, 0, 0.055), atol=1e-9)


def test_objects_attach_under_their_names_with_a_free_joint_or_without():
    scene = mujoco.MjSpec()
    add_object(scene, OBJECTS["tomato_soup_box"], "target")
    add_object(scene, OBJECTS["tomato_soup_box"], "distractor")
    add_object(scene, OBJECTS["cylinder"], "fixed", free=False)
    model = scene.compile()
    assert model.joint("target").type == model.joint("distractor").type == mujoco.mjtJoint.mjJNT_FREE
    assert model.njnt == 2
    assert model.geom("target/box").bodyid == model.body("target").id
    assert model.body("fixed").jntnum == 0


# The accepted normal


def test_a_brick_on_any_face_accepts_that_face():
    spec = OBJECTS["cuboid_1x2"]
    for pose, symmetry, major in (
        (turned("z", 0), np.pi, (1, 0, 0)),
        (turned("x", 90), np.pi, (1, 0, 0)),
        (turned("y", 90), np.pi, (0, 1, 0)),
        (turned("x", 160), np.pi, (1, 0, 0)),
    ):
        normal = spec.accepted_normal(pose)
        assert normal.symmetry == symmetry
        assert abs(normal.major_axis @ pose.rotation.apply(np.array(major, float))) == pytest.approx(1)
    assert normal.angle((0, 0, 1)) == pytest.approx(np.radians(20))


def test_the_top_of_a_1x1_is_square_and_its_sides_are_not():
    spec = OBJECTS["cuboid_1x1"]
    assert spec.accepted_normal(turned("z", 5)).symmetry == np.pi / 2
    assert spec.accepted_normal(turned("x", 90)).symmetry == np.pi


def test_a_standing_can_accepts_its_axis_at_any_roll():
    normal = OBJECTS["cylinder"].accepted_normal(turned("y", 16))
    assert normal.circle_axis is None
    assert normal.angle((0, 0, 1)) == pytest.approx(np.radians(16))
    assert normal.roll_error(look_at((0.1, 0, 1), (0, 0, 0))) == 0


def test_a_lying_can_accepts_the_whole_circle_across_its_axis():
    normal = OBJECTS["cylinder"].accepted_normal(turned("y", 90))
    for angle in np.linspace(0, 2 * np.pi, 7):
        across = np.array([0, np.sin(angle), np.cos(angle)])
        assert normal.angle(across) == pytest.approx(0, abs=1e-9)
        assert normal.angle(across + np.tan(0.2) * np.array([1, 0, 0])) == pytest.approx(0.2)
    assert normal.angle((1, 0, 0)) == pytest.approx(np.pi / 2)
    np.testing.assert_allclose(normal.direction, (0, 0, 1), atol=1e-9)


@pytest.mark.parametrize("roll", np.radians([-170, -80, -20, 0, 35, 89, 120]))
@pytest.mark.parametrize("symmetry", [np.pi / 2, np.pi, 2 * np.pi])
def test_rolling_by_the_roll_error_aligns_the_camera(roll, symmetry):
    normal = AcceptedNormal(np.array([0.0, 0, 1]), np.array([1.0, 0, 0]), symmetry)
    camera = VirtualSphere(np.zeros(3), 0.3).viewpoint(0.3, 1.0, roll)
    error = normal.roll_error(camera)
    assert -symmetry / 2 < error <= symmetry / 2
    rolled = camera * RigidTransform.from_rotation(Rotation.from_rotvec([0, 0, error]))
    assert normal.roll_error(rolled) == pytest.approx(0, abs=1e-9)
    assert normal.view_angle(camera) == pytest.approx(0.3)


def test_the_roll_is_undefined_when_looking_along_the_major_axis():
    normal = AcceptedNormal(np.array([0.0, 0, 1]), np.array([1.0, 0, 0]), np.pi)
    assert np.isnan(normal.roll_error(look_at((1, 0, 0), (0, 0, 0))))


@pytest.mark.parametrize(
    "arguments",
    [
        ((0, 0, 0),),
        ((0, 0, 1), (1, 0, 0), 0.0),
        ((0, 0, 1), None, np.pi),
        ((0, 0, 1), (1, 0, 1), np.pi),
    ],
)
def test_an_inconsistent_normal_is_refused(arguments):
    with pytest.raises(InvalidParameterError):
        CanonicalNormal(*arguments)


# The segmenters


@pytest.mark.parametrize("name", SIZES_MM)
def test_the_segmenter_finds_the_object_and_nothing_else(name):
    spec = OBJECTS[name]
    scene = mujoco.MjSpec.from_string(TABLE)
    add_object(scene, spec, "target")
    model = scene.compile()
    data = mujoco.MjData(model)
    data.qpos[2] = spec.bounding_box().half_extents[2]
    mujoco.mj_forward(model, data)
    ours = np.flatnonzero(model.geom_bodyid == model.body("target").id)
    rng = np.random.default_rng(5)
    with mujoco.Renderer(model, 480, 640) as renderer:
        for _ in range(4):
            sphere = VirtualSphere(data.body("target").xpos, rng.uniform(0.25, 0.5))
            camera = sphere.viewpoint(rng.uniform(0, np.pi / 4), *rng.uniform(0, 2 * np.pi, 2))
            data.cam_xpos[0] = camera.translation
            data.cam_xmat[0] = (camera.rotation * Rotation.from_euler("x", np.pi)).as_matrix().ravel()
            renderer.update_scene(data, "camera")
            mask = spec.segmenter(renderer.render())
            renderer.enable_segmentation_rendering()
            renderer.update_scene(data, "camera")
            truth = np.isin(renderer.render()[..., 0], ours)
            renderer.disable_segmentation_rendering()
            assert (mask & truth).sum() / (mask | truth).sum() > 0.95


def test_objects_of_one_color_are_told_apart_by_it():
    patches = {name: spec.load().compile() for name, spec in OBJECTS.items() if name != "tomato_soup_box"}
    for name, model in patches.items():
        rgb = np.round(255 * 0.8 * model.mat_rgba[0, :3]).astype(np.uint8)
        image = np.tile(rgb, (20, 20, 1))
        assert [other for other in patches if OBJECTS[other].segmenter(image).any()] == [name]


def test_a_bounding_box_is_computed_once_and_cannot_be_changed_by_who_asks(monkeypatch):
    spec = dataclasses.replace(OBJECTS["cuboid_1x2"])
    box = spec.bounding_box()
    monkeypatch.setattr(ObjectSpec, "load", lambda self: pytest.fail("compiled again"))
    before = box.half_extents.tolist()
    box.half_extents[0] = 1.0
    assert spec.bounding_box().half_extents.tolist() == before


def test_another_mjcf_has_another_bounding_box():
    spec = OBJECTS["cuboid_1x2"]
    spec.bounding_box()
    ball = '<mujoco><worldbody><body><geom size=".05"/></body></worldbody></mujoco>'
    assert dataclasses.replace(spec, mjcf=ball).bounding_box().half_extents.tolist() == [0.05] * 3


def test_one_normal_need_not_be_wrapped_and_a_class_is_no_segmenter():
    alone = ObjectSpec("alone", document(""), lambda rgb: rgb[..., 0] > 0, normals=CanonicalNormal((0, 0, 1)))
    assert len(alone.normals) == 1
    with pytest.raises(InvalidParameterError, match="a segmenter is called with an RGB image"):
        ObjectSpec("mine", document(""), HsvThreshold)
