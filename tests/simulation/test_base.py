"""An arm on a holonomic base is an ordinary arm, whose base moves where the arm cannot."""

from dataclasses import replace

import numpy as np
import pytest

from gvp_lib import ARMS, EyeInHandArm, ImageMomentPlanner, SilhouetteFit, VirtualSphere, WorkCell
from gvp_lib.errors import InvalidParameterError, ModelError, UnreachableError
from gvp_lib.simulation.base import BASE_JOINTS, HolonomicBase
from gvp_lib.simulation.kinematics import InverseKinematics

FAR = replace(ARMS["baxter"], workspace=((1.1, 1.1), (-0.25, -0.25)))


def start_over(cell, tilt_deg=20):
    sphere = VirtualSphere(cell.truth.world_from_object.translation, 0.29)
    cell.place_camera(sphere.viewpoint(np.radians(tilt_deg), np.pi + 0.5, 0.5))


@pytest.mark.parametrize("arm", ["ur5e", "baxter"])
def test_an_arm_on_a_base_has_three_joints_more_and_is_an_ordinary_arm(arm):
    spec = ARMS[arm].on_base()
    cell = WorkCell(spec, "cuboid_1x2", seed=1)
    assert spec.joints[:3] == BASE_JOINTS
    assert isinstance(cell.arm, EyeInHandArm)
    assert len(cell.arm.joints) == len(ARMS[arm].joints) + 3
    fixed = WorkCell(arm, "cuboid_1x2", seed=1)
    np.testing.assert_allclose(cell.arm.camera_pose().as_matrix(), fixed.arm.camera_pose().as_matrix(), atol=1e-9)


def test_the_base_drives_along_the_world_and_turns_the_arm_about_the_vertical():
    spec = ARMS["ur5e"].on_base()
    kinematics = InverseKinematics(spec)
    home = np.array(spec.home)
    at_home = kinematics.forward(home).translation
    moved = home + np.eye(len(home))[0] * 0.2 + np.eye(len(home))[1] * 0.1
    np.testing.assert_allclose(kinematics.forward(moved).translation - at_home, [0.2, 0.1, 0.0], atol=1e-9)
    turned = home.copy()
    turned[2] = np.pi / 2
    np.testing.assert_allclose(kinematics.forward(turned).translation, [-at_home[1], at_home[0], at_home[2]], atol=1e-9)


def test_the_arm_does_what_it_can_and_the_base_the_rest():
    spec = ARMS["baxter"].on_base()
    kinematics = InverseKinematics(spec)
    home = np.array(spec.home)
    here = kinematics.forward(home)
    near, far = here.as_matrix().copy(), here.as_matrix().copy()
    near[0, 3] += 0.03
    far[0, 3] += 0.9
    close_by = kinematics.solve(type(here).from_matrix(near), home)
    far_off = kinematics.solve_any(type(here).from_matrix(far), home)
    assert np.abs(close_by[:2]).max() < 0.005 < 0.1 < np.abs(far_off[:2]).max()
    np.testing.assert_allclose(kinematics.forward(far_off).translation, far[:3, 3], atol=2e-4)


def test_a_view_that_the_fixed_arm_cannot_reach_is_planned_from_a_base():
    fixed = WorkCell(FAR, "cuboid_1x4", seed=0)
    with pytest.raises(UnreachableError):
        start_over(fixed)
    cell = WorkCell(FAR.on_base(), "cuboid_1x4", seed=0)
    start_over(cell)
    plan = ImageMomentPlanner(cell.segmenter, SilhouetteFit()).plan(cell.arm)
    assert plan.outcome.arrived
    assert np.degrees(cell.truth.viewpoint_error()) < 1.5


def test_the_base_stops_at_the_table():
    cell = WorkCell(ARMS["ur5e"].on_base(), "cuboid_1x2", seed=0)
    q = cell.arm.joints
    q[0] = 0.6
    assert cell.arm.move_joints(q).reason.value == "collision"


def test_servos_drive_the_base_too():
    cell = WorkCell(ARMS["ur5e"].on_base(), "cuboid_1x2", seed=0, dynamic=True)
    q = cell.arm.joints
    q[:3] += (-0.05, 0.05, 0.05)
    assert cell.arm.move_joints(q)
    np.testing.assert_allclose(cell.arm.joints, q, atol=2e-3)


def test_what_is_no_base_is_refused():
    with pytest.raises(InvalidParameterError, match=r"positive and finite; got reach=0"):
        HolonomicBase(reach=0)
    with pytest.raises(InvalidParameterError, match="already stands on a base"):
        ARMS["ur5e"].on_base().on_base()
    with pytest.raises(InvalidParameterError, match="take its on_base"):
        replace(ARMS["ur5e"], base=HolonomicBase())
    loose = '<geom size=".1"/><body name="a"><joint name="j"/><geom size=".1"/></body>'
    loose = f"<mujoco><worldbody>{loose}</worldbody></mujoco>"
    spec = replace(ARMS["ur5e"], mjcf=loose, joints=("j",), home=(0.0,)).on_base()
    with pytest.raises(ModelError, match="the bodies a there, and 1 loose geoms"):
        spec.load()
