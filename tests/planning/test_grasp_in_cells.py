"""Completing a grasp in the simulated cell, with contacts."""

import numpy as np
import pytest
from cells import Cells
from hands import After, aligned, check_grasp
from scipy.spatial.transform import RigidTransform

from gvp_lib.planning.grasp import GraspExecutor, GraspOutcome, RangeThreshold, SizedDepth


@pytest.fixture(scope="module")
def cell_with():
    """A Baxter's cell at the beginning of a grasp."""
    cells = Cells()

    def make(target="cuboid_1x2", placement="flat", seed=3, *, dynamic=True):
        return aligned(cells("baxter", target, placement, seed=seed), seed, dynamic=dynamic)

    yield make
    cells.close()


def height(cell):
    return cell.truth.world_from_object.translation[2]


def grasp(cell, **options):
    """The grasp, and by how much the object rose, m."""
    before = height(cell)
    done = GraspExecutor(cell.segmenter, **options).grasp(cell.arm, cell.gripper)
    check_grasp(done)
    return done, height(cell) - before


@pytest.mark.parametrize(
    ("target", "placement", "options"),
    [
        ("cuboid_1x2", "flat", {"closing": SizedDepth(), "recenter": "shifting"}),
        ("cylinder", "side", {"closing": SizedDepth(), "recenter": "shifting"}),
        ("alligator", "raised", {"closing": SizedDepth(), "recenter": "shifting"}),
        ("cuboid_1x2", "raised", {}),  # the thesis's rule
    ],
)
@pytest.mark.parametrize("seed", [3, pytest.param(5, marks=pytest.mark.full)])
def test_from_an_aligned_view_the_object_is_lifted_and_held_for_2_s(target, placement, options, seed, cell_with):
    cell = cell_with(target, placement, seed)
    done, risen = grasp(cell, **options)
    assert done.outcome is GraspOutcome.HELD
    assert risen >= 0.05
    held_at = height(cell)
    cell.wait(2.0)
    assert held_at - height(cell) <= risen - 0.05
    assert cell.gripper.width == pytest.approx(done.width, abs=0.002)


def test_fingers_that_close_beside_the_object_find_nothing(cell_with):
    cell = cell_with(dynamic=False)
    assert cell.arm.move_camera(RigidTransform.from_translation([0.0, 0.08, 0.0]))  # over its end and beyond
    cell.dynamic = True
    # The thesis's 10 cm would have the tips 20 mm below the table.
    done, risen = grasp(cell, closing=RangeThreshold(0.13), recenter=None)
    assert done.outcome is GraspOutcome.EMPTY
    assert done.width == pytest.approx(cell.gripper.stroke[0], abs=0.001)
    assert risen == pytest.approx(0, abs=0.001)


def test_what_is_as_smooth_as_ice_slips(cell_with, monkeypatch):
    cell = cell_with("cylinder", "side")
    touching = np.isin(np.arange(cell.model.ngeom), list(cell.finger_geoms)) | (
        cell.model.geom_bodyid == cell.target_body
    )
    friction, close = cell.model.geom_friction.copy(), cell.gripper.close

    def close_and_grease():
        close()
        cell.model.geom_friction[touching] = 1e-5

    monkeypatch.setattr(cell.gripper, "close", close_and_grease)
    done, risen = grasp(cell, closing=SizedDepth())
    cell.model.geom_friction[:] = friction  # for whoever has this cell next
    assert done.outcome is GraspOutcome.SLIPPED
    assert risen < 0.05


def test_a_finger_that_lands_on_the_table_ends_the_descent_and_closes_where_the_rule_lets_it(cell_with):
    cell = cell_with()
    done, _ = grasp(cell, closing=After(np.inf))
    assert (done.outcome, done.landed) == (GraspOutcome.NEVER_CLOSED, True)
    tip = cell.truth.world_from_camera.apply([0.0, 0.0, cell.gripper.hand.tips])[2]
    assert tip == pytest.approx(cell.stage.table_height, abs=0.003)
    done, _ = grasp(cell_with(), closing=SizedDepth(unknown_depth=0.039))
    assert (done.outcome, done.landed) == (GraspOutcome.HELD, True)
