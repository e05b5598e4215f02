"""Objects: the thesis's seven, your own, and the normals from which they may be grasped."""

import dataclasses

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError, ModelError
from gvp_lib.evaluation.episodes import begin, draw_start
from gvp_lib.geometry.sphere import VirtualSphere, look_at
from gvp_lib.learning.collect import Collector
from gvp_lib.learning.recipe import CollectionRecipe
from gvp_lib.perception.segmentation import HsvThreshold
from gvp_lib.simulation.objects import OBJECTS, ObjectSpec, box_normals
from gvp_lib.simulation.truth import AcceptedNormal, CanonicalNormal
from gvp_lib.simulation.workcell import WorkCell

BRICK, CAN, CARTON = (0.005, 0.05), (0.1, 0.3), (0.3, 0.5)  # kg: bounds on the weight
PUBLISHED = {f"cuboid_1x{n}": ((31.8 * n, 31.8, 23.7), BRICK) for n in (1, 2, 3, 4)} | {
    "cylinder": ((60, 60, 150), CAN),
    "alligator": ((120, 45, 35), BRICK),
    "tomato_soup_box": ((67, 67, 100), CARTON),
}
"""Sizes, mm, and weights."""
BOX = '<geom type="box" size=".02 .03 .01"/>'
TETRAHEDRON = 0.02 * np.array([[1, 1, 1], [-1, -1, 1], [-1, 1, -1], [1, -1, -1]])  # m


def mine(inside=f"<body>{BOX}</body>", segmenter=lambda rgb: rgb[..., 0] > 0, beside="", **more) -> ObjectSpec:
    return ObjectSpec("mine", f"<mujoco>{beside}<worldbody>{inside}</worldbody></mujoco>", segmenter, **more)


def box(attributes):
    return f'<geom type="box" size=".02 .03 .01" {attributes}/>'


def of_mesh(vertices):
    text = " ".join(f"{x:.9g}" for x in np.ravel(vertices))
    return mine('<body><geom type="mesh" mesh="m"/></body>', beside=f'<asset><mesh name="m" vertex="{text}"/></asset>')


def turned(axis: str, degrees: float) -> RigidTransform:
    return RigidTransform.from_rotation(Rotation.from_euler(axis, degrees, degrees=True))


def test_the_seven_objects_have_their_published_sizes_and_weights_and_are_centered():
    assert set(OBJECTS) == set(PUBLISHED)
    for name, (size, (low, high)) in PUBLISHED.items():
        spec = OBJECTS[name]
        box = spec.bounding_box()
        np.testing.assert_allclose(2e3 * box.half_extents, size, atol=0.05, err_msg=name)
        np.testing.assert_allclose(1e3 * box.center, 0, atol=0.05, err_msg=name)
        assert spec.name == name
        assert spec.centered() is spec
        assert low < spec.load().compile().body_mass.sum() < high


def test_objects_of_one_color_are_told_apart_by_it():
    models = {name: spec.load().compile() for name, spec in OBJECTS.items() if name != "tomato_soup_box"}
    for name, model in models.items():
        patch = np.full((20, 20, 3), np.round(255 * 0.8 * model.mat_rgba[0, :3]), np.uint8)
        assert [other for other in models if OBJECTS[other].segmenter(patch).any()] == [name]


@pytest.mark.parametrize(
    ("spec", "text"),
    [
        (mine(f'<body name="a">{BOX}</body><body name="b">{BOX}</body>'), "exactly one body.* it has 'a', 'b'"),
        (mine(f"<body>{BOX}<body><joint/>{BOX}</body></body>"), "no joint but a free one.* it has an unnamed one"),
        (mine('<body><geom type="box" size="-1 1 1"/></body>'), "'mine' does not compile"),
        (mine("<body>"), "'mine' cannot be read"),
        (dataclasses.replace(mine(), mjcf="no/such/file.xml"), "'mine' cannot be read"),
        (mine(textures={"label": np.zeros((6, 1, 3), np.uint8)}), "declares no texture 'label'; it has none"),
        (mine('<body><geom type="box" size="30 20 20"/></body>'), "'mine' measures 60 x 40 x 40 m.*0.001 if they are"),
        (of_mesh(TETRAHEDRON / 0.0254), r"'mine' measures 1\.575 x 1\.575 x 1\.575 m.*0\.0254 if in inches"),
        (mine(f'<body>{BOX}<geom size="9" contype="0" conaffinity="0"/></body>'), "18 x 18 x 18 m.*only drawn"),
        (of_mesh(TETRAHEDRON * 0.001), "'mine' measures 4e-05 x 4e-05 x 4e-05 m.*scaled twice"),
        (mine(beside='<compiler settotalmass="0.5"/>'), r"sets settotalmass=0\.5.*a density"),
        (of_mesh(TETRAHEDRON * (1, 1, 0)), "'mine' does not compile.*coplanar.*thin box"),
    ],
)
def test_a_bad_mjcf_is_refused_with_its_reason(spec, text):
    with pytest.raises(ModelError, match=f"(?s){text}"):
        WorkCell("floating", spec)


@pytest.mark.parametrize(
    ("pixels", "text"),
    [
        (np.ones((6, 6, 3)), r"\(H, W, 3\); got .*float64"),
        (np.zeros((6, 6, 1), np.uint8), r"\(H, W, 3\); got .*\(6, 6, 1\)"),
        (np.zeros((3, 6, 6), np.uint8), "channels first"),
        (np.zeros((0, 6, 3), np.uint8), "empty"),
    ],
)
def test_a_texture_is_an_rgb_image_and_other_pixels_are_refused_by_its_name(pixels, text):
    beside = '<asset><texture name="t" type="2d" builtin="flat" width="1" height="1"/></asset>'
    mine(beside=beside, textures={"t": np.zeros((6, 6, 3), np.uint8)}).load()
    with pytest.raises(InvalidParameterError, match=f"texture 't' of object 'mine': .*{text}"):
        mine(beside=beside, textures={"t": pixels}).load()


@pytest.mark.parametrize(
    ("inside", "beside", "text"),
    [
        (box('mass="0"'), "", "mass and inertia.*weighs 0 kg"),
        (box('density="0"'), "", "mass and inertia.*weighs 0 kg"),
        (box('mass="1e-16"'), "", "mass and inertia.*weighs 0 kg"),
        (BOX, '<compiler inertiafromgeom="false"/>', "mass and inertia.*weighs 0 kg"),
        (box('mass="inf"'), "", "not finite, in its body_inertia.*body_mass"),
        (box('pos="0 inf 0"'), "", "not finite, in its .*geom_pos"),
        (BOX, '<equality><weld name="w" body1="b"/></equality>', "no equality; it has 'w'.*nothing holds it"),
        (BOX, '<sensor><framepos objtype="body" objname="b"/></sensor>', "names the body itself"),
        (f'{BOX}<camera mode="targetbody" target="world"/>', "", "target body in camera.*or the world"),
        (f'{BOX}<geom type="plane" size="1 1 1"/>', "", "plane only allowed.*None of them may be a plane"),
    ],
)
def test_what_passes_alone_but_not_in_a_cell_is_refused_with_the_objects_name_and_the_cause(inside, beside, text):
    spec = mine(f'<body name="b">{inside}</body>', beside=beside)
    mujoco.MjSpec.from_string(spec.mjcf).compile()
    with pytest.raises(ModelError, match=f"(?s)object 'mine'.*{text}"):
        WorkCell("floating", spec)


FIELD = '<asset><hfield name="h" nrow="2" ncol="2" size=".1 .1 .1 .1" elevation="0 1 0 1"/></asset>'


@pytest.mark.parametrize(
    "geom",
    [
        box('contype="2" conaffinity="2"'),
        box('contype="0" conaffinity="4"'),
        box('contype="0" conaffinity="0"'),
        '<geom type="hfield" hfield="h"/>',
    ],
)
def test_an_object_that_would_fall_through_the_table_is_refused_as_such(geom):
    with pytest.raises(ModelError, match=r"no geom that can touch the table.*bit 1 in\s+contype or conaffinity"):
        WorkCell("floating", mine(f"<body>{geom}</body>", beside=FIELD))


def test_a_geom_that_cannot_touch_the_table_neither_lifts_the_object_nor_counts_in_its_box():
    odd, below = box('contype="3" conaffinity="2"'), '<geom size=".005" pos="0 0 -.02" contype="2" conaffinity="2"/>'
    with WorkCell("floating", mine(f"<body>{odd}{below}</body>")) as cell:
        np.testing.assert_allclose(cell.target_spec.bounding_box().half_extents, (0.02, 0.03, 0.01))
        assert cell.truth.world_from_object.translation[2] == pytest.approx(0.01)
        assert cell.data.contact.dist.min() > -1e-3  # in the cell, too, only the box touches


ASLANT = '<geom type="box" size=".01 .02 .03" euler="0 0 30"/>'
STIFF = '<default><joint armature="3" damping="5" frictionloss="2"/></default>'


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("joint", "beside"),
    [
        ("<freejoint/>", ""),
        ('<freejoint align="true"/>', '<size nkey="2"/><keyframe><key qpos="0 0 9 1 0 0 0"/></keyframe>'),
        ('<joint name="f" type="free"/>', STIFF),
        ("", f'<compiler alignfree="true"/>{STIFF}'),
        ("", '<contact><exclude body1="b" body2="world"/></contact>'),
    ],
)
def test_an_object_with_a_free_joint_of_its_own_is_the_same_as_without(joint, beside):
    own, plain = mine(f'<body name="b">{joint}{ASLANT}</body>', beside=beside), mine(f"<body>{ASLANT}</body>")
    with WorkCell("floating", own, seed=3) as cell, WorkCell("floating", plain, seed=3) as expected:
        for name in ("jnt_type", "dof_damping", "dof_armature", "dof_frictionloss", "geom_quat", "geom_pos", "nkey"):
            np.testing.assert_array_equal(getattr(cell.model, name), getattr(expected.model, name), err_msg=name)
        np.testing.assert_array_equal(cell.data.qpos, expected.data.qpos)
        mujoco.mj_step(cell.model, cell.data, 500)
        assert cell.truth.world_from_object.translation[2] == pytest.approx(0.03, abs=1e-4)  # it moves, and stands


def test_an_object_whose_origin_is_at_its_base_is_refused_by_those_who_look_at_its_origin():
    low, high = (mine(f'<body><geom type="box" size=".02 .02 .04" pos="0 0 {z}"/></body>') for z in (0.0039, 0.04))
    assert low.centered() is low  # off by less than 5 % of 8 cm
    with WorkCell("floating", high, seed=1) as cell:  # which stands, and may be planned for
        for refuse in (
            high.centered,
            lambda: draw_start(cell, np.random.default_rng(0)),
            lambda: begin(cell, 0, seed=0),
            lambda: Collector(CollectionRecipe(arm="floating", target=high, n=8, rolls=4)),
        ):
            with pytest.raises(ModelError, match=r"'mine' must be the center .* is at 0 0 0\.04 .*by 0 0 -0\.04"):
                refuse()


@pytest.mark.parametrize(
    ("geom", "half_extents"),
    [
        ('type="sphere" size=".02"', (0.02, 0.02, 0.02)),
        ('type="box" size=".03 .02 .01" euler="0 0 90"', (0.02, 0.03, 0.01)),
        ('type="cylinder" size=".01 .05" euler="0 90 0"', (0.05, 0.01, 0.01)),
        ('type="capsule" size=".01 .05" euler="90 0 0"', (0.01, 0.06, 0.01)),
        ('type="ellipsoid" size=".03 .02 .01" euler="0 90 0"', (0.01, 0.02, 0.03)),
        ('type="mesh" mesh="tetrahedron"', (0.02, 0.02, 0.02)),
    ],
)
def test_the_bounding_box_is_exact_for_every_kind_of_geom(geom, half_extents):
    spec = of_mesh(TETRAHEDRON) if "mesh" in geom else mine(f"<body><geom {geom}/></body>")
    np.testing.assert_allclose(spec.bounding_box().half_extents, half_extents, atol=1e-7)


def test_the_bounding_box_follows_nested_bodies_and_leaves_out_what_is_only_drawn():
    box = mine("""<body pos="1 2 3" euler="0 0 90">
      <geom type="cylinder" size=".01 .05" euler="0 90 0"/>
      <body pos="0 0 .1"><geom type="sphere" size=".02"/></body>
      <geom type="box" size=".4 .4 .4" contype="0" conaffinity="0" mass="0"/></body>""").bounding_box()
    np.testing.assert_allclose(box.half_extents, (0.05, 0.02, 0.065), atol=1e-9)
    np.testing.assert_allclose(box.center, (0, 0, 0.055), atol=1e-9)


@pytest.mark.parametrize(
    ("name", "pose", "tilt_deg", "symmetry", "major"),
    [
        ("cuboid_1x2", turned("z", 0), 0, np.pi, (1, 0, 0)),
        ("cuboid_1x2", turned("x", 90), 0, np.pi, (1, 0, 0)),
        ("cuboid_1x2", turned("y", 90), 0, np.pi, (0, 1, 0)),
        ("cuboid_1x2", turned("x", 160), 20, np.pi, (1, 0, 0)),
        ("cuboid_1x1", turned("z", 5), 0, np.pi / 2, None),
        ("cylinder", turned("y", 16), 16, 0, None),  # standing: its axis, at any roll
        ("cylinder", turned("y", 90), 0, np.pi, (0, 0, 1)),  # lying: any direction across its axis
    ],
)
def test_the_face_that_is_up_is_accepted_with_its_longer_side_and_its_symmetry(name, pose, tilt_deg, symmetry, major):
    normal = OBJECTS[name].accepted_normal(pose)
    assert np.degrees(normal.angle((0, 0, 1))) == pytest.approx(tilt_deg, abs=1e-6)
    assert normal.symmetry == symmetry
    if major is not None:
        assert abs(normal.major_axis @ pose.rotation.apply(np.array(major, float))) == pytest.approx(1)
    assert (normal.circle_axis is not None) == (name == "cylinder" and symmetry > 0)


def test_a_lying_can_accepts_the_whole_circle_across_its_axis():
    normal = OBJECTS["cylinder"].accepted_normal(turned("y", 90))
    np.testing.assert_allclose(normal.direction, (0, 0, 1), atol=1e-9)
    for angle in np.linspace(0, 2 * np.pi, 7):
        across = np.array([0, np.sin(angle), np.cos(angle)])
        assert normal.angle(across) == pytest.approx(0, abs=1e-9)
        assert normal.angle(across + [np.tan(0.2), 0, 0]) == pytest.approx(0.2)
    assert normal.angle((1, 0, 0)) == pytest.approx(np.pi / 2)


@pytest.mark.parametrize("symmetry", [np.pi / 2, np.pi, 2 * np.pi])
def test_rolling_by_the_roll_error_aligns_the_camera(symmetry):
    normal = AcceptedNormal((0, 0, 1), (1, 0, 0), symmetry)
    for roll in np.radians([-170, -80, 0, 35, 120]):
        camera = VirtualSphere(np.zeros(3), 0.3).viewpoint(0.3, 1.0, roll)
        error = normal.roll_error(camera)
        assert -symmetry / 2 < error <= symmetry / 2
        rolled = camera * RigidTransform.from_rotation(Rotation.from_rotvec([0, 0, error]))
        assert normal.roll_error(rolled) == pytest.approx(0, abs=1e-9)
        assert normal.view_angle(camera) == pytest.approx(0.3)
    assert np.isnan(normal.roll_error(look_at((1, 0, 0), (0, 0, 0))))  # along the major axis it is undefined
    assert AcceptedNormal((0, 0, 1)).roll_error(camera) == 0  # where any roll will do


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: CanonicalNormal((0, 0, 0)), "a normal's direction is a finite vector.*not zero"),
        (lambda: CanonicalNormal((0, 0, 1), (1, 0, 0), 0.0), "a major axis and a symmetry in"),
        (lambda: CanonicalNormal((0, 0, 1), None, np.pi), "or no major axis and symmetry 0"),
        (lambda: CanonicalNormal((0, 0, 1), (1, 0, 1), np.pi), r"are 45\.0 deg apart, not 90"),
        (lambda: CanonicalNormal([1e300] * 3), "a normal's direction is a finite vector"),
        (lambda: mine(round_axis=(0, 0, 0)), "'mine': a round axis is a finite vector"),
        (lambda: box_normals((0.1, np.nan, 0.1)), "three extents, positive and finite"),
        (lambda: mine(normals=()), "normals are CanonicalNormal.*one or more"),
        (lambda: mine(segmenter=HsvThreshold), "a segmenter is called with an RGB image"),
    ],
)
def test_an_inconsistent_normal_or_object_is_refused(make, text):
    with pytest.raises(InvalidParameterError, match=text):
        make()
    assert len(mine(normals=CanonicalNormal((0, 0, 1))).normals) == 1  # while one alone need not be wrapped


def test_an_object_of_a_file_looks_as_what_of_it_is_drawn_and_turns_about_its_middle(tmp_path):
    path = tmp_path / "stub.xml"
    path.write_text(
        '<mujoco><worldbody><body><geom type="cylinder" size=".02 .03" mass="0" contype="0" conaffinity="0"/>'
        '<geom name="hull" type="box" size=".02 .03 .04" pos=".1 0 0" density="200"/></body></worldbody></mujoco>'
    )
    spec = ObjectSpec.from_file(path, HsvThreshold(hue=(345, 15)), rgb=(1, 0, 0))
    assert repr(spec) == "ObjectSpec(stub: stub.xml, 6 normals)"
    assert 2 * spec.centered().bounding_box().half_extents == pytest.approx([0.04, 0.06, 0.08])
    model = spec.load().compile()
    assert model.geom_rgba.tolist() == [[1, 0, 0, 1], [1, 0, 0, 0]]
    assert model.body_subtreemass[1] == pytest.approx(0.04 * 0.06 * 0.08 * 200)


@pytest.mark.parametrize(("options", "text"), [
    ({"rgb": (255, 0, 0)}, r"three numbers in \[0, 1\]"),
    ({"rgb": (1, 0, 0), "scale": 0}, r"0\.001 for mm; got 0"),
    ({"rgb": (1, 0, 0)}, "there is no file|Error opening file"),
])  # fmt: skip
def test_what_is_no_object_s_file_or_color_is_refused(options, text, tmp_path):
    for name in ("none.xml", "none.obj"):
        with pytest.raises((InvalidParameterError, ModelError), match=text):
            ObjectSpec.from_file(tmp_path / name, HsvThreshold(hue=(345, 15)), **options)
