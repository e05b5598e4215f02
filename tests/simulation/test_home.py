"""An arm of which nobody has told the home."""

from dataclasses import replace

import numpy as np
import pytest

from gvp_lib.errors import UnreachableError
from gvp_lib.simulation.arms import ARMS
from gvp_lib.simulation.home import looking_down
from gvp_lib.simulation.workcell import WorkCell


def test_from_there_the_camera_looks_down_on_the_middle_of_the_workspace_and_nothing_touches():
    arm = looking_down(replace(ARMS["ur5e"], home=(0.0,) * 6), height=0.4)
    cell = WorkCell(arm, "cuboid_1x1", seed=1)
    pose = cell.truth.world_from_camera
    np.testing.assert_allclose(pose.translation, [0.5, 0.0, 0.4], atol=1e-3)
    np.testing.assert_allclose(pose.rotation.as_matrix(), [[0, -1, 0], [-1, 0, 0], [0, 0, -1]], atol=2e-3)
    assert not cell._assembly.holder.bodies.touching(cell.data)
    cell.close()


def test_a_workspace_out_of_reach_is_refused_with_what_would_work():
    with pytest.raises(UnreachableError, match=r"within its limits put the camera.*nearer to the base"):
        looking_down(replace(ARMS["ur5e"], workspace=((2.0, 2.1), (-0.1, 0.1))))


def test_what_the_arm_touches_wherever_it_stands_is_named():
    with pytest.raises(UnreachableError, match=r"'\w+' touches '\w+'.*<exclude"):
        looking_down(ARMS["ur5e"], height=0.005)
