from functools import cache

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import GvpError, InvalidParameterError, UnknownNameError
from gvp_lib.simulation.objects import CONTACT, OBJECTS, ObjectSpec
from gvp_lib.simulation.placements import BLOCK_HEIGHT, BLOCK_MARGIN, PLACEMENTS, WALL_GAP, WALL_THICKNESS, place
from gvp_lib.simulation.scene import Stage, add_object, build_scene, set_physics
from gvp_lib.simulation.truth import CanonicalNormal

SPOT, TABLE = (0.6, -0.25), -0.2
EVERY_CASE = [(name, placement) for name in OBJECTS for placement in PLACEMENTS]
UP = np.array([0.0, 0.0, 1.0])
WEDGE = """
<mujoco>
  <worldbody>
    <body>
      <geom type="box" size=".03 .02 .01" pos="0 0 .01"/>
      <geom type="box" size=".01 .02 .01" pos="-.02 0 .03"/>
    </body>
  </worldbody>
</mujoco>"""


def anything(rgb):
    return np.ones(rgb.shape[:2], bool)


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
    add_object(scene, spec, "target")
    model = scene.compile()
    data = mujoco.MjData(model)
    pose = result.world_from_object
    data.qpos[:3], data.qpos[3:] = pose.translation, pose.rotation.as_quat(scalar_first=True)
    mujoco.mj_step(model, data, 2000)
    settled = RigidTransform.from_components(data.qpos[:3], Rotation.from_quat(data.qpos[3:], scalar_first=True))
    return pose.inv() * settled


@pytest.mark.parametrize(("name", "placement"), EVERY_CASE)
def test_every_object_stays_where_it_is_placed(name, placement):
    moved = after_two_seconds(OBJECTS[name], placed(name, placement))
    assert np.linalg.norm(moved.translation) < 0.2e-3
    assert moved.rotation.magnitude() < np.radians(0.1)


@pytest.mark.parametrize(("name", "placement"), EVERY_CASE)
def test_every_object_comes_to_lie_on_its_spot(name, placement):
    np.testing.assert_allclose(placed(name, placement).world_from_object.translation[:2], SPOT, atol=1e-6)


@pytest.mark.parametrize(("name", "placement"), EVERY_CASE)
def test_the_accepted_normal_is_the_one_meant(name, placement):
    spec, pose = OBJECTS[name], placed(name, placement).world_from_object
    normal = spec.accepted_normal(pose)
    tilt = np.degrees(normal.angle(UP))
    along_z = abs(pose.rotation.as_matrix()[:, 2] @ normal.direction)
    if placement == "tilted":
        assert 15 <= tilt <= 30
        assert along_z == pytest.approx(1)
    else:
        assert tilt == pytest.approx(0, abs=1e-6)
        assert along_z == pytest.approx(0 if placement == "side" else 1, abs=1e-9)
    assert (normal.circle_axis is not None) == (name == "cylinder" and placement == "side")


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("name", OBJECTS)
def test_a_tilt_is_between_15_and_30_degrees_whatever_the_seed(name, seed):
    result = place(OBJECTS[name], "tilted", seed)
    tilt = OBJECTS[name].accepted_normal(result.world_from_object).angle(UP)
    assert np.radians(15) <= tilt <= np.radians(30)
    assert len(result.supports) == 1


@pytest.mark.parametrize("name", OBJECTS)
def test_heights_are_those_of_the_table_the_block_and_the_side(name):
    x, y, z = OBJECTS[name].bounding_box().half_extents
    heights = {"flat": z, "raised": z + BLOCK_HEIGHT, "side": min(x, y), "walled": z}
    for placement, height in heights.items():
        assert placed(name, placement).world_from_object.translation[2] == pytest.approx(TABLE + height, abs=1e-9)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", OBJECTS)
def test_a_wall_is_as_high_as_its_object_and_runs_along_a_long_side(name, seed):
    result, half = place(OBJECTS[name], "walled", seed, SPOT, TABLE), OBJECTS[name].bounding_box().half_extents
    (wall,) = result.supports
    object_from_wall = result.world_from_object.inv() * wall.world_from_support
    x, y, z = np.abs(object_from_wall.translation)
    assert z == pytest.approx(0, abs=1e-9)
    assert wall.half_extents[2] == pytest.approx(half[2])
    assert min(x, y) == pytest.approx(0, abs=1e-9)
    across = int(y > x)
    assert half[across] == pytest.approx(half[:2].min())
    assert max(x, y) - half[across] - wall.half_extents[across] == pytest.approx(WALL_GAP)
    assert 2 * wall.half_extents[across] == pytest.approx(WALL_THICKNESS)
    assert wall.half_extents[1 - across] == pytest.approx(half[1 - across] + BLOCK_MARGIN)


@pytest.mark.parametrize(("name", "sides"), [("cuboid_1x3", 2), ("cuboid_1x1", 4), ("cylinder", 4)])
def test_a_wall_stands_on_either_long_side_and_on_any_side_of_a_square(name, sides):
    walls = (place(OBJECTS[name], "walled", seed) for seed in range(24))
    offsets = [(w.world_from_object.inv() * w.supports[0].world_from_support).translation for w in walls]
    assert len({tuple(np.sign(np.round(offset[:2], 6))) for offset in offsets}) == sides


@pytest.mark.parametrize(("name", "placement"), [("cuboid_1x2", "flat"), ("cylinder", "tilted"), ("alligator", "side")])
def test_the_same_seed_gives_the_same_pose_bit_for_bit(name, placement):
    one, two = (place(OBJECTS[name], placement, np.random.default_rng(3), SPOT, TABLE) for _ in range(2))
    np.testing.assert_array_equal(one.world_from_object.as_matrix(), two.world_from_object.as_matrix())
    other = place(OBJECTS[name], placement, 4, SPOT, TABLE)
    assert not np.array_equal(one.world_from_object.as_matrix(), other.world_from_object.as_matrix())


def test_the_yaw_takes_every_quarter():
    yaws = [place(OBJECTS["cuboid_1x2"], "flat", s).world_from_object.rotation.as_euler("zyx")[0] for s in range(12)]
    assert {int(q) for q in np.floor(np.array(yaws) / (np.pi / 2))} == {-2, -1, 0, 1}


def test_an_unknown_placement_lists_the_known_ones():
    with pytest.raises(UnknownNameError, match=r"no placement named 'upright'.*flat, raised, side, tilted, walled"):
        place(OBJECTS["cylinder"], "upright", 0)


def test_a_spot_that_is_no_point_is_refused():
    with pytest.raises(InvalidParameterError, match=r"shape \(2,\)"):
        place(OBJECTS["cylinder"], "flat", 0, (0.1, 0.2, 0.3))


@pytest.mark.parametrize("placement", PLACEMENTS)
def test_your_own_object_off_its_center_is_placed_by_its_bounding_box(placement):
    normals = (CanonicalNormal((0, 0, 1), (1, 0, 0), np.pi), CanonicalNormal((0, 1, 0)), CanonicalNormal((0, -1, 0)))
    spec = ObjectSpec("wedge", WEDGE, anything, normals)
    result = place(spec, placement, 1, SPOT, TABLE)
    box = spec.bounding_box()
    np.testing.assert_allclose(result.world_from_object.apply(box.center)[:2], SPOT, atol=1e-6)
    assert np.linalg.norm(after_two_seconds(spec, result).translation) < 0.5e-3
    normal = spec.accepted_normal(result.world_from_object)
    assert np.degrees(normal.angle(UP)) < (30 if placement == "tilted" else 1e-6)
    assert (normal.symmetry == 0) == (placement == "side")


@pytest.mark.parametrize("placement", ["flat", "raised", "side", "walled"])
def test_a_plain_cylinder_of_yours_is_placed_although_it_trembles_on_a_block(placement):
    xml = '<mujoco><worldbody><body><geom type="cylinder" size=".03 .05"/></body></worldbody></mujoco>'
    spec = ObjectSpec("tin", xml, anything, round_axis=(0, 0, 1))
    pose = place(spec, placement, 0).world_from_object
    assert spec.accepted_normal(pose).angle(UP) == pytest.approx(0, abs=1e-6)


def test_an_object_that_cannot_stand_says_so():
    needle = (
        '<mujoco><worldbody><body><geom type="ellipsoid" size=".01 .01 .1" euler="0 10 0"/></body></worldbody></mujoco>'
    )
    with pytest.raises(GvpError, match=r"'needle' does not come to rest 'flat' after .* tries: .*flat base"):
        place(ObjectSpec("needle", needle, anything), "flat", 0)


def test_an_object_is_settled_under_the_very_physics_of_the_episode(monkeypatch):
    compiled = []
    compile_spec = mujoco.MjSpec.compile
    monkeypatch.setattr(mujoco.MjSpec, "compile", lambda spec: compiled.append(compile_spec(spec)) or compiled[-1])
    place(OBJECTS["cuboid_1x2"], "flat", 0)
    (tried,) = [model for model in compiled if model.ngeom > 1 and model.nq == 7]
    episode = compile_spec(build_scene(None, [("target", OBJECTS["cuboid_1x2"])], [], Stage()))
    for name in ("timestep", "integrator", "solver", "cone", "jacobian", "impratio", "noslip_iterations"):
        assert getattr(tried.opt, name) == getattr(episode.opt, name), name
    assert tried.opt.disableflags == episode.opt.disableflags
