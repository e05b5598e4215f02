"""A block that is moved in a compiled scene is where it now is, for rays, for objects and for the arm."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.simulation.objects import OBJECTS
from gvp_lib.simulation.scene import Stage, Support, build_scene, move_free, move_support

SMALL = Support(np.array([0.02, 0.02, 0.02]), RigidTransform.from_translation([0.1, 0.0, 0.02]))
TURNED = RigidTransform.from_components([-0.1, 0.2, 0.05], Rotation.from_euler("z", 30, degrees=True))
LARGE = Support(np.array([0.09, 0.03, 0.05]), TURNED)
HALF = OBJECTS["cuboid_1x2"].bounding_box().half_extents[2]


@pytest.fixture
def scene():
    model = build_scene(None, [("target", OBJECTS["cuboid_1x2"])], [SMALL], Stage()).compile()
    data = mujoco.MjData(model)
    put_target(model, data, (0.5, 0.5, 0.3))
    return model, data


def put_target(model, data, position):
    move_free(model, data, "target", RigidTransform.from_translation(position))


def surface(model, data, x, y):
    """Height of what a ray straight down meets, and the name of its body, by each of MuJoCo's two ways."""
    mujoco.mj_forward(model, data)
    start, down = np.array([x, y, 1.0]), np.array([0.0, 0.0, -1.0])
    visible = np.array([1, 1, 1, 1, 0, 0], np.uint8)
    geom, geoms, distances = np.zeros(1, np.int32), np.zeros(1, np.int32), np.zeros(1)
    one = mujoco.mj_ray(model, data, start, down, visible, True, -1, geom)
    mujoco.mj_multiRay(model, data, start, down, visible, True, -1, geoms, distances, None, 1, 10.0)
    assert distances[0] == pytest.approx(one)
    assert geoms[0] == geom[0]
    return 1.0 - one, model.body(model.geom_bodyid[geom[0]]).name


def touch(model, data):
    """Whether the target touches the block."""
    mujoco.mj_forward(model, data)
    pairs = model.geom_bodyid[data.contact.geom]
    return {"support_0", "target"} in [{model.body(body).name for body in pair} for pair in pairs]


def test_rays_meet_a_moved_block_where_it_is_and_not_where_it_was(scene):
    assert surface(*scene, 0.1, 0.0) == (pytest.approx(0.04), "support_0")
    move_support(*scene, 0, LARGE)
    assert surface(*scene, 0.1, 0.0) == (pytest.approx(0.0), "table")
    inside, outside = (pytest.approx(0.10), "support_0"), (pytest.approx(0.0), "table")
    for x, y, found in (
        (0, 0, inside), (0.085, 0.025, inside), (-0.085, -0.025, inside),
        (0.095, 0, outside), (0, 0.035, outside), (0.085, -0.035, outside),
    ):  # fmt: skip
        assert surface(*scene, *TURNED.apply([x, y, 0.0])[:2]) == found


def test_an_object_touches_a_moved_block_where_it_is_and_not_where_it_was(scene):
    put_target(*scene, (0.1, 0.0, 0.04 + HALF - 1e-3))
    assert touch(*scene)
    move_support(*scene, 0, LARGE)
    assert not touch(*scene)
    for x in (0.0, 0.085):  # in the middle, and near the end of its new length
        put_target(*scene, TURNED.apply([x, 0, 0.05 + HALF - 1e-3]))
        assert touch(*scene)


def test_an_object_comes_to_rest_on_a_moved_block(scene):
    _, data = scene
    move_support(*scene, 0, LARGE)
    put_target(*scene, TURNED.apply([0, 0, 0.05 + HALF + 0.002]))
    mujoco.mj_step(*scene, 500)
    assert data.joint("target").qpos[2] == pytest.approx(0.10 + HALF, abs=2e-4)
    assert np.abs(data.qvel).max() < 1e-3


def test_a_block_moved_back_is_the_block_as_compiled(scene):
    model, _ = scene
    names = ("geom_size", "geom_rbound", "geom_aabb", "bvh_aabb")
    before = {name: getattr(model, name).copy() for name in names}
    move_support(*scene, 0, LARGE)
    assert all((getattr(model, name) != before[name]).any() for name in names)
    move_support(*scene, 0, SMALL)
    for name in names:
        np.testing.assert_allclose(getattr(model, name), before[name], atol=1e-9, err_msg=name)
