"""Completing a grasp in the simulated cell, with contacts."""

import numpy as np
import pytest
from eye_in_hand import CAMERA
from hands import FaultyGripper, Never, aligned, check_grasp
from scipy.spatial.transform import RigidTransform

from gvp_lib.motion.primitives import toward_pixel, turn
from gvp_lib.perception.moments import Blob
from gvp_lib.planning.grasp import GraspExecutor, GraspOutcome, RangeThreshold, SizedDepth
from gvp_lib.simulation.objects import ObjectSpec
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.workcell import WorkCell

CENTER = CAMERA.principal_point


@pytest.fixture(scope="module")
def cell_with():
    """A Baxter's cell by its object, placement and noise, built once, at the beginning of a grasp."""
    cells = {}

    def make(target="cuboid_1x2", placement="flat", seed=3, *, dynamic=True, noise=None):
        key = getattr(target, "name", target), placement, noise
        if key not in cells:
            cells[key] = WorkCell("baxter", target, placement, noise=noise, seed=seed)
        return aligned(cells[key], seed, dynamic=dynamic)

    yield make
    for cell in cells.values():
        cell.close()


def height(cell):
    return cell.truth.world_from_object.translation[2]


def grasp(cell, closing=None, segmenter=None, gripper=None, **options):
    """The grasp, and by how much the object rose, m."""
    before = height(cell)
    executor = GraspExecutor(segmenter or cell.segmenter, closing or RangeThreshold(), **options)
    done = executor.grasp(cell.arm, gripper or cell.gripper)
    check_grasp(done)
    return done, height(cell) - before


@pytest.mark.parametrize(
    ("target", "placement"), [("cuboid_1x2", "flat"), ("cylinder", "side"), ("alligator", "raised")]
)
@pytest.mark.parametrize("seed", [3, pytest.param(5, marks=pytest.mark.full)])
def test_from_an_aligned_view_the_object_is_lifted_and_held_for_two_seconds(target, placement, seed, cell_with):
    cell = cell_with(target, placement, seed)
    done, risen = grasp(cell, SizedDepth(), recenter="shifting")
    assert done.outcome is GraspOutcome.HELD
    assert risen >= 0.05
    held_at = height(cell)
    cell.wait(2.0)
    assert held_at - height(cell) <= risen - 0.05
    assert cell.gripper.width == pytest.approx(done.width, abs=0.002)


def test_the_default_executor_holds_a_raised_brick(cell_with):
    done, risen = grasp(cell_with(placement="raised"))
    assert done.outcome is GraspOutcome.HELD
    assert risen >= 0.05
    assert done.readings[-1].distance < 0.10 <= done.readings[-2].distance


def test_the_same_grasp_twice_is_the_same_to_the_bit(cell_with):
    grasps = []
    for _ in range(2):
        cell = cell_with(noise=Noise.thesis())
        done, risen = grasp(cell, SizedDepth())
        grasps.append((done.outcome, done.width, [reading.distance for reading in done.readings], risen))
    assert grasps[0] == grasps[1]


@pytest.mark.parametrize("recenter", ["turning", "shifting"])
def test_the_object_comes_to_the_middle_and_stays_there_in_the_cell_too(recenter, cell_with):
    cell = cell_with("cuboid_1x1", "raised", dynamic=False)
    away = toward_pixel(cell.arm.intrinsics, CENTER + (45, 40)).inv()
    assert cell.arm.move_camera(RigidTransform.from_rotation(away))
    cell.dynamic = True
    found = []

    def watching(rgb):
        mask = cell.segmenter(rgb)
        blob = Blob.from_mask(mask)
        if blob is not None and not blob.touches_border(rgb.shape):
            found.append(np.abs(blob.centroid - cell.arm.intrinsics.principal_point).max())
        return mask

    grasp(cell, segmenter=watching, recenter=recenter)
    assert found[0] > 35
    assert max(found[3:]) < 6
    assert len(found) > 15


BIG_BOX = ObjectSpec(
    "big box",
    '<mujoco><worldbody><body><geom type="box" size=".055 .055 .02" rgba="0 0.7 0 1"/></body></worldbody></mujoco>',
    segmenter=lambda rgb: (rgb[..., 1] > 60) & (rgb[..., 0] < 50) & (rgb[..., 2] < 50),
)


def test_a_box_of_eleven_centimeters_is_too_wide_and_is_not_touched(cell_with):
    cell = cell_with(BIG_BOX)
    joints, object_ = cell.arm.joints, cell.truth.world_from_object.as_matrix()
    assert grasp(cell)[0].outcome is GraspOutcome.TOO_WIDE
    np.testing.assert_allclose(cell.arm.joints, joints, atol=1e-4)
    np.testing.assert_allclose(cell.truth.world_from_object.as_matrix(), object_, atol=1e-4)


def test_fingers_that_close_beside_the_object_find_nothing(cell_with):
    cell = cell_with(dynamic=False)
    assert cell.arm.move_camera(RigidTransform.from_translation([0.0, 0.08, 0.0]))  # over its end and beyond
    cell.dynamic = True
    # The thesis's 10 cm would have the tips 20 mm below the table.
    done, risen = grasp(cell, RangeThreshold(0.13), recenter=None)
    assert done.outcome is GraspOutcome.EMPTY
    assert done.width == pytest.approx(cell.gripper.stroke[0], abs=0.001)
    assert risen == pytest.approx(0, abs=0.001)


def test_what_is_as_smooth_as_ice_slips(cell_with):
    cell = cell_with("cylinder", "side")
    of_target = cell.model.geom_bodyid == cell.target_body
    of_finger = np.isin(np.arange(cell.model.ngeom), list(cell.finger_geoms))
    friction = cell.model.geom_friction.copy()

    def close_and_grease():
        cell.gripper.close()
        cell.model.geom_friction[of_target | of_finger] = 1e-5

    done, risen = grasp(cell, SizedDepth(), gripper=FaultyGripper(cell.gripper, close=close_and_grease))
    cell.model.geom_friction[:] = friction  # for whoever has this cell next
    assert done.outcome is GraspOutcome.SLIPPED
    assert risen < 0.05


def test_a_finger_that_lands_on_the_table_ends_the_descent_and_closes_where_the_rule_lets_it(cell_with):
    cell = cell_with()
    done, _ = grasp(cell, Never())
    assert (done.outcome, done.landed) == (GraspOutcome.NEVER_CLOSED, True)
    tip = cell.truth.world_from_camera.apply([0.0, 0.0, cell.gripper.hand.tips])[2]
    assert tip == pytest.approx(cell.stage.table_height, abs=0.003)
    done, _ = grasp(cell_with(), SizedDepth(unknown_depth=0.039))
    assert (done.outcome, done.landed) == (GraspOutcome.HELD, True)


def test_out_of_the_arms_reach_the_descent_says_so(cell_with):
    def middle(rgb):  # to which the middle of the picture is the object, whatever is there
        mask = np.zeros(rgb.shape[:2], bool)
        mask[230:250, 310:330] = True
        return mask

    cell = cell_with(dynamic=False)
    assert cell.arm.move_camera(turn([0.0, -np.pi / 2, 0.0]))
    done, _ = grasp(cell, Never(), middle, limit=1.5)
    assert done.outcome in (GraspOutcome.UNREACHABLE, GraspOutcome.JOINT_LIMIT)
    assert len(done.readings) > 3
