import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.motion.arm import StopReason
from gvp_lib.simulation.arms import ARMS
from gvp_lib.simulation.scene import Support, move_support
from gvp_lib.simulation.workcell import WorkCell


@pytest.mark.parametrize("arm", ARMS)
def test_a_kinematic_arm_never_stands_in_a_colliding_configuration(arm):
    cell, reasons = WorkCell(arm=arm, target="tomato_soup_box", placement="raised", seed=3), []
    rng = np.random.default_rng(0)
    low, high = cell._holder.kinematics.limits
    entered = []
    with cell.watch(lambda: entered.append(len(cell._holder.drive.contacts()))):
        for _ in range(25):
            cell.reset()
            spread = np.clip(np.array(cell.arm_spec.home) + rng.uniform(-1.5, 1.5, len(low)), low, high)
            reasons.append(cell.arm.move_joints(spread).reason)
            assert not len(cell._holder.drive.contacts())
            np.testing.assert_allclose(cell.arm.joints, cell._holder.drive.joints(), atol=1e-12)
    assert entered
    assert not any(entered)
    assert {StopReason.REACHED, StopReason.COLLISION} <= set(reasons)  # or the test would say nothing
    cell.close()


def test_an_arm_meets_a_block_where_it_now_is():
    cell = WorkCell(arm="baxter", target="cuboid_1x1", placement="raised", seed=3)
    table, lowest = cell.stage.table_height, []
    here = cell.truth.world_from_object.translation * [1, 1, 0] + [0.0, 0.15, table]
    for shift in (0.0, 0.4):
        middle = here + [0.0, shift, 0.05]
        move_support(cell.model, cell.data, 0, Support(np.full(3, 0.05), RigidTransform.from_translation(middle)))
        cell.place_camera(VirtualSphere(here, 0.35).viewpoint(0.0, np.pi / 2))
        motion = cell.arm.move_camera(RigidTransform.from_translation([0, 0, 0.35]))
        assert motion.reason is StopReason.COLLISION
        lowest.append(cell.truth.world_from_camera.translation[2] - table)
    assert lowest[0] - lowest[1] == pytest.approx(0.10, abs=0.011)  # the block's height, to a waypoint
    cell.close()


@pytest.mark.parametrize("arm", ARMS)
def test_servos_settle_within_two_hundredths_of_a_degree(arm):
    cell = WorkCell(arm=arm, target="cuboid_1x2", seed=3, dynamic=True)
    rng = np.random.default_rng(1)
    for _ in range(4):
        goal = np.array(cell.arm_spec.home) + rng.uniform(-0.12, 0.12, len(cell.arm_spec.home))
        assert cell.arm.move_joints(goal)
        true = cell._holder.drive.joints()
        assert np.degrees(np.abs(true - goal)).max() < 0.02
        np.testing.assert_allclose(cell.arm.joints, true, atol=1e-12)
        assert np.degrees(np.abs(cell.data.qvel[cell._holder.drive._dofs])).max() < 2.0
    cell.close()
