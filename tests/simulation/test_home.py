"""An arm of which nobody has told the home."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import UnreachableError
from gvp_lib.simulation.arms import ARMS, ArmSpec
from gvp_lib.simulation.kinematics import looking_down
from gvp_lib.simulation.workcell import WorkCell


def test_from_there_the_camera_looks_down_on_the_middle_of_the_workspace_and_nothing_touches():
    arm = looking_down(replace(ARMS["ur5e"], home=(0.0,) * 6), height=0.4)
    cell = WorkCell(arm, "cuboid_1x1", seed=1)
    pose = cell.truth.world_from_camera
    np.testing.assert_allclose(pose.translation, [0.5, 0.0, 0.4], atol=1e-3)
    np.testing.assert_allclose(pose.rotation.as_matrix(), [[0, -1, 0], [-1, 0, 0], [0, 0, -1]], atol=2e-3)
    assert not cell._holder.bodies.touching(cell.data)
    cell.close()


def test_a_workspace_out_of_reach_is_refused_with_what_would_work():
    with pytest.raises(UnreachableError, match=r"within its limits put the camera.*nearer to the base"):
        looking_down(replace(ARMS["ur5e"], workspace=((2.0, 2.1), (-0.1, 0.1))))


OVERLAPPING = """
<mujoco><compiler angle="degree" autolimits="true"/>
  <default><joint axis="0 1 0" range="-170 170"/><geom type="capsule" size="0.03"/></default>
  <worldbody>
    <geom name="base" type="cylinder" size="0.08 0.04" pos="0 0 0.04"/>
    <body name="turret" pos="0 0 0.10"><joint name="j1" axis="0 0 1"/><geom fromto="0 0 0 0 0 0.02"/>
    <body name="upper" pos="0 0 0.1"><joint name="j2"/><geom fromto="0 0 0.06 0 0 0.34"/>
    <body name="fore" pos="0 0 0.4"><joint name="j3"/><geom fromto="0 0 0.06 0 0 0.2"/>
    <body name="roll" pos="0 0 0.26"><joint name="j4" axis="0 0 1"/><geom fromto="0 0 0 0 0 0.08"/>
    <body name="bend" pos="0 0 0.14"><joint name="j5"/><geom type="sphere"/>
    <body name="flange" pos="0 0 0.08"><joint name="j6" axis="0 0 1"/><geom type="sphere" size="0.02"/>
    </body></body></body></body></body></body>
  </worldbody>
</mujoco>"""


def test_links_that_overlap_wherever_the_arm_stands_are_named():
    joints = ("j1", "j2", "j3", "j4", "j5", "j6")
    mount = ("flange", RigidTransform.identity())
    arm = ArmSpec("six", OVERLAPPING, camera="eye", camera_mount=mount, joints=joints, home=(0.0,) * 6)
    with pytest.raises(UnreachableError, match=r"'turret' touches 'world'.*<exclude"):
        looking_down(arm)
