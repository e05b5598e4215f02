"""A block that is moved in a compiled scene is where it now is, for rays, for objects and for the arm."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.simulation.objects import OBJECTS
from gvp_lib.simulation.scene import Stage, Support, build_scene, move_support

SMALL = Support(np.array([0.02, 0.02, 0.02]), RigidTransform.from_translation([0.1, 0.0, 0.02]))
TURNED = RigidTransform.from_components([-0.1, 0.2, 0.05], Rotation.from_euler("z", 30, degrees=True))
LARGE = Support(np.array([0.09, 0.03, 0.05]), TURNED)
BRICK_HALF_HEIGHT = OBJECTS["cuboid_1x2"].bounding_box().half_extents[2]


@pytest.fixture
def scene():
    model = build_scene(None, [("target", OBJECTS["cuboid_1x2"])], [SMALL], Stage()).compile()
    data = mujoco.MjData(model)
    put_target(data, (0.5, 0.5, 0.3))
    return model, data


def put_target(data, position):
    data.joint("target").qpos[:] = (*position, 1, 0, 0, 0)


def surface(model, data, x, y):
    """Height of what a ray straight down meets, and the name of its body, by each of MuJoCo's two ways."""
    mujoco.mj_forward(model, data)
    start, down = np.array([x, y, 1.0]), np.array([0.0, 0.0, -1.0])
    visible = np.array([1, 1, 1, 1, 0, 0], np.uint8)
    geom = np.zeros(1, np.int32)
    one = mujoco.mj_ray(model, data, start, down, visible, True, -1, geom)
    geoms, distances = np.zeros(1, np.int32), np.zeros(1)
    mujoco.mj_multiRay(model, data, start, down, visible, True, -1, geoms, distances, None, 1, 10.0)
    assert distances[0] == pytest.approx(one)
    assert geoms[0] == geom[0]
    return 1.0 - one, model.body(model.geom_bodyid[geom[0]]).name


def touching(model, data):
    mujoco.mj_forward(model, data)
    return {
        tuple(sorted(model.body(model.geom_bodyid[geom]).name for geom in contact.geom)) for contact in data.contact
    }


def test_rays_meet_a_moved_block_where_it_is_and_not_where_it_was(scene):
    model, data = scene
    assert surface(model, data, 0.1, 0.0) == (pytest.approx(0.04), "support_0")
    move_support(model, data, 0, LARGE)
    assert surface(model, data, 0.1, 0.0) == (pytest.approx(0.0), "table")
    for local in ((0, 0), (0.085, 0.025), (-0.085, -0.025)):
        x, y, _ = TURNED.apply([*local, 0.0])
        assert surface(model, data, x, y) == (pytest.approx(0.10), "support_0")
    for local in ((0.095, 0), (0, 0.035), (0.085, -0.035)):
        x, y, _ = TURNED.apply([*local, 0.0])
        assert surface(model, data, x, y) == (pytest.approx(0.0), "table")


def test_an_object_touches_a_moved_block_where_it_is_and_not_where_it_was(scene):
    model, data = scene
    pair = ("support_0", "target")
    on_small, on_large = (0.1, 0.0, 0.04 + BRICK_HALF_HEIGHT - 1e-3), (0, 0, 0.05 + BRICK_HALF_HEIGHT - 1e-3)
    put_target(data, on_small)
    assert pair in touching(model, data)
    move_support(model, data, 0, LARGE)
    assert pair not in touching(model, data)
    put_target(data, TURNED.apply(on_large))
    assert pair in touching(model, data)
    put_target(data, TURNED.apply([0.085, 0, on_large[2]]))  # near the end of its new length
    assert pair in touching(model, data)


def test_an_object_comes_to_rest_on_a_moved_block(scene):
    model, data = scene
    move_support(model, data, 0, LARGE)
    put_target(data, TURNED.apply([0, 0, 0.05 + BRICK_HALF_HEIGHT + 0.002]))
    mujoco.mj_step(model, data, 500)
    assert data.joint("target").qpos[2] == pytest.approx(0.10 + BRICK_HALF_HEIGHT, abs=2e-4)
    assert np.abs(data.qvel).max() < 1e-3


def test_a_block_moved_back_is_the_block_as_compiled(scene):
    model, data = scene
    names = ("geom_size", "geom_rbound", "geom_aabb", "bvh_aabb")
    before = {name: getattr(model, name).copy() for name in names}
    move_support(model, data, 0, LARGE)
    assert all((getattr(model, name) != before[name]).any() for name in names)
    move_support(model, data, 0, SMALL)
    for name in names:
        np.testing.assert_allclose(getattr(model, name), before[name], atol=1e-9, err_msg=name)
