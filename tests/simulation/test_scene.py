"""A block that is moved in a compiled scene is the block that would have been compiled there."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.simulation.objects import OBJECTS
from gvp_lib.simulation.scene import Stage, Support, build_scene, move_free, move_support

BRICK = OBJECTS["cuboid_1x2"]
SMALL = Support(np.array([0.02, 0.02, 0.02]), RigidTransform.from_translation([0.1, 0.0, 0.02]))
TURNED = RigidTransform.from_components([-0.1, 0.2, 0.05], Rotation.from_euler("z", 30, degrees=True))
LARGE = Support(np.array([0.09, 0.03, 0.05]), TURNED)


def compiled(support):
    model = build_scene(None, [("target", BRICK)], [support], Stage()).compile()
    return model, mujoco.MjData(model)


def shapes(model):
    """All that contacts and rays go by."""
    return {name: getattr(model, name) for name in dir(model) if name.startswith(("geom_", "bvh_"))}


def test_a_moved_block_has_the_shape_that_the_compiler_would_have_given_it():
    (moved, data), (expected, there) = compiled(SMALL), compiled(LARGE)
    different = [name for name, shape in shapes(moved).items() if np.any(shape != getattr(expected, name))]
    assert {"geom_size", "geom_rbound", "geom_aabb", "bvh_aabb"} <= set(different)
    move_support(moved, data, 0, LARGE)
    for name, shape in shapes(expected).items():
        np.testing.assert_allclose(getattr(moved, name), shape, atol=1e-9, err_msg=name)
    np.testing.assert_allclose(data.joint("support_0").qpos, there.joint("support_0").qpos, atol=1e-9)


def test_an_object_comes_to_rest_on_a_moved_block_and_where_it_was_is_nothing():
    model, data = compiled(SMALL)
    move_support(model, data, 0, LARGE)
    half = BRICK.bounding_box().half_extents[2]
    for place, rests_at in ((TURNED.apply([0.08, 0, 0.05]), 0.10), ([0.1, 0.0, 0.0], 0.0)):
        above = RigidTransform.from_translation([*place[:2], rests_at + half + 0.002])
        move_free(model, data, "target", above)
        mujoco.mj_step(model, data, 500)
        assert data.joint("target").qpos[2] == pytest.approx(rests_at + half, abs=2e-4)
        assert np.abs(data.qvel).max() < 1e-3
