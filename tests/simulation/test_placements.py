"""How objects stand when an episode begins: at rest, on their spot, and the face up that is meant."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import GvpError, InvalidParameterError, ModelError, UnknownNameError
from gvp_lib.simulation.objects import CONTACT, OBJECTS, ObjectSpec
from gvp_lib.simulation.placements import BLOCK_HEIGHT, BLOCK_MARGIN, PLACEMENTS, WALL_GAP, WALL_THICKNESS, place
from gvp_lib.simulation.scene import Stage, Support, build_scene, move_support, set_physics
from gvp_lib.simulation.truth import CanonicalNormal

SPOT, TABLE = (0.6, -0.25), -0.2
UP = np.array([0.0, 0.0, 1.0])
each_placement = pytest.mark.parametrize("placement", PLACEMENTS)


def own(name, geoms, *normals, **more):
    xml = f"<mujoco><worldbody><body>{geoms}</body></worldbody></mujoco>"
    return ObjectSpec(name, xml, lambda rgb: np.ones(rgb.shape[:2], bool), normals or (CanonicalNormal(UP),), **more)


@cache
def placed(name, placement, seed=0):
    return place(OBJECTS[name], placement, seed, SPOT, TABLE)


def after_two_seconds(spec, result):
    """The object's motion in its own frame, in a scene with the table at its own height."""
    scene = mujoco.MjSpec()
    set_physics(scene)
    plane = mujoco.mjtGeom.mjGEOM_PLANE
    scene.worldbody.add_geom(type=plane, size=(1, 1, 0.1), pos=(0, 0, TABLE), **CONTACT)
    for i, support in enumerate(result.supports):
        support.add_to(scene, f"support_{i}")
    spec.attach_to(scene, "target")
    model = scene.compile()
    data = mujoco.MjData(model)
    pose = result.world_from_object
    data.qpos[:3], data.qpos[3:] = pose.translation, pose.rotation.as_quat(scalar_first=True)
    mujoco.mj_step(model, data, 2000)
    settled = RigidTransform.from_components(data.qpos[:3], Rotation.from_quat(data.qpos[3:], scalar_first=True))
    return pose.inv() * settled


@each_placement
@pytest.mark.parametrize("name", OBJECTS)
def test_every_object_rests_on_its_spot_as_high_as_meant_with_the_normal_that_is_meant_up(name, placement):
    spec, result = OBJECTS[name], placed(name, placement)
    moved, pose = after_two_seconds(spec, result), result.world_from_object
    assert np.linalg.norm(moved.translation) < 0.2e-3
    assert moved.rotation.magnitude() < np.radians(0.1)
    np.testing.assert_allclose(pose.translation[:2], SPOT, atol=1e-6)
    normal, (x, y, z) = spec.accepted_normal(pose), spec.bounding_box().half_extents
    along_z = abs(pose.rotation.as_matrix()[:, 2] @ normal.direction)
    assert along_z == pytest.approx(0 if placement == "side" else 1, abs=1e-9)
    if placement == "tilted":
        assert 15 <= np.degrees(normal.angle(UP)) <= 30
    else:
        assert normal.angle(UP) == pytest.approx(0, abs=1e-7)
        height = {"raised": z + BLOCK_HEIGHT, "side": min(x, y)}.get(placement, z)
        assert pose.translation[2] == pytest.approx(TABLE + height, abs=1e-9)


@pytest.mark.parametrize(("name", "sides"), [("cuboid_1x3", 2), ("cuboid_1x1", 4), ("alligator", 2)])
def test_a_wall_as_high_as_its_object_runs_along_either_long_side_and_any_of_a_square(name, sides):
    half, found = OBJECTS[name].bounding_box().half_extents, set()
    for seed in range(16):
        result = placed(name, "walled", seed)
        (wall,) = result.supports
        offset = (result.world_from_object.inv() * wall.world_from_support).translation.round(9)
        found.add(tuple(np.sign(offset)))
        across = int(np.argmax(np.abs(offset)))
        assert half[across] == half[:2].min()
        expected = half + (BLOCK_MARGIN, BLOCK_MARGIN, 0)
        expected[across] = WALL_THICKNESS / 2
        np.testing.assert_allclose(wall.half_extents, expected)
        assert np.abs(offset).sum() == pytest.approx(half[across] + WALL_GAP + WALL_THICKNESS / 2)
    assert len(found) == sides


@each_placement
def test_your_own_object_off_its_center_is_placed_by_its_bounding_box(placement):
    geoms = '<geom type="box" size=".03 .02 .01" pos="0 0 .01"/><geom type="box" size=".01 .02 .01" pos="-.02 0 .03"/>'
    sides = CanonicalNormal((0, 1, 0)), CanonicalNormal((0, -1, 0))
    spec = own("wedge", geoms, CanonicalNormal((0, 0, 1), (1, 0, 0), np.pi), *sides)
    result = place(spec, placement, 1, SPOT, TABLE)
    box = spec.bounding_box()
    np.testing.assert_allclose(result.world_from_object.apply(box.center)[:2], SPOT, atol=1e-6)
    assert np.linalg.norm(after_two_seconds(spec, result).translation) < 0.5e-3
    normal = spec.accepted_normal(result.world_from_object)
    assert np.degrees(normal.angle(UP)) < (30 if placement == "tilted" else 1e-6)
    assert (normal.symmetry == 0) == (placement == "side")


@pytest.mark.parametrize("placement", ["raised", "side"])
def test_a_plain_cylinder_of_yours_is_placed_although_it_trembles_on_a_block(placement):
    spec = own("tin", '<geom type="cylinder" size=".03 .05"/>', round_axis=(0, 0, 1))
    pose = place(spec, placement, 0).world_from_object
    assert spec.accepted_normal(pose).angle(UP) == pytest.approx(0, abs=1e-6)


NEEDLE = own("needle", '<geom type="ellipsoid" size=".01 .01 .1" euler="0 10 0"/>')
SIDEWAYS = own("sideways", '<geom type="box" size=".03 .02 .01"/>', CanonicalNormal((1, 0, 0)))
TOPPLING = own("toppling", '<geom type="box" size=".01 .01 .01"/><geom type="box" size=".05 .01 .01" pos=".06 0 .02"/>')
HEAVY = own("heavy", '<geom type="box" size=".04 .03 .003"/><geom type="box" size=".04 .01 .01" pos="0 0 .03"/>')
BRICK = OBJECTS["cuboid_1x2"]
HOVERING = own("hovering", '<geom type="box" size=".02 .02 .02" margin=".05" gap=".01"/>')
FLYING = own("flying", '<geom type="box" size=".02 .02 .02" margin="1e300"/>')
RISING = replace(BRICK, name="rising", mjcf=str(BRICK.mjcf).replace('name="brick"', 'gravcomp="1e300"'))


@pytest.mark.parametrize(
    ("error", "arguments", "text"),
    [
        (UnknownNameError, (BRICK, "upright", 0), r"named 'upright'.*flat, raised, side, tilted, walled"),
        (InvalidParameterError, (BRICK, "flat", 0, (0.1, 0.2, 0.3)), r"shape \(2,\)"),
        (GvpError, (NEEDLE, "flat", 0), r"'needle' does not come to rest 'flat' .* mm from where .*flat base"),
        (GvpError, (TOPPLING, "flat", 0), r"11 deg from the vertical .*A flat base of collision geoms"),
        (GvpError, (HOVERING, "flat", 0), r"upright, but moved by \(0\.0, 0\.0, \d\d\.\d\) mm.* hover.*margin, gap"),
        (ModelError, (FLYING, "flat", 0), "simulation of object 'flying' diverges.*its gravcomp"),
        (ModelError, (RISING, "flat", 0), "simulation of object 'rising' diverges"),
        (GvpError, (HEAVY, "side", 0), r"118 deg from the vertical\. List a normal that is up when it lies"),
        (GvpError, (SIDEWAYS, "tilted", 0), r"normal \d\d deg from the vertical, not 15 to 30\. List a normal that"),
    ],
)
def test_what_cannot_be_placed_is_refused_with_the_reason(error, arguments, text):
    with pytest.raises(error, match=text):
        place(*arguments)


def test_a_moved_block_has_the_shape_that_the_compiler_would_have_given_it():
    turned = RigidTransform.from_components([-0.1, 0.2, 0.05], Rotation.from_euler("z", 30, degrees=True))
    large = Support(np.array([0.09, 0.03, 0.05]), turned)
    small = Support(np.array([0.02, 0.02, 0.02]), RigidTransform.from_translation([0.1, 0.0, 0.02]))
    moved, expected = (build_scene(None, [("target", BRICK)], [block], Stage()).compile() for block in (small, large))
    data, there = mujoco.MjData(moved), mujoco.MjData(expected)
    move_support(moved, data, 0, large)
    shapes = {name for name in dir(moved) if name.startswith(("geom_", "bvh_"))}  # all that contacts and rays go by
    assert {"geom_size", "geom_rbound", "geom_aabb", "bvh_aabb"} <= shapes
    for name in shapes:
        np.testing.assert_allclose(getattr(moved, name), getattr(expected, name), atol=1e-9, err_msg=name)
    np.testing.assert_allclose(data.joint("support_0").qpos, there.joint("support_0").qpos, atol=1e-9)
