"""An arm on a holonomic base is an ordinary arm, whose base moves where the arm cannot."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from gvp_lib import ARMS, ArmSpec
from gvp_lib.errors import InvalidParameterError, ModelError
from gvp_lib.motion import Outcome
from gvp_lib.simulation.base import HolonomicBase


def bodies(text):
    """Arm whose model is no more than these bodies."""
    mjcf = f"<mujoco><default><geom size='.1'/></default><worldbody>{text}</worldbody></mujoco>"
    return ArmSpec("bodies", mjcf, "eye", ("j",), (0.0,))


TURNED = bodies("""
  <body pos="0.3 -0.2 0.1" euler="40 -70 110">
    <geom/> <body pos="0.2 0 0.3"><joint name="j"/><geom/><camera name="eye"/></body>
  </body>""")
LOOSE = bodies("<geom/><body name='a'><joint name='j'/><geom/></body>")
JOINTED = bodies("<body name='a'><joint name='j'/><geom/></body>")
FUSED = bodies("<body name='a'><geom/><body><joint name='j'/><geom/><camera name='eye'/></body></body>")
FUSED = replace(FUSED, mjcf=FUSED.mjcf.replace("<default>", "<compiler fusestatic='true'/><default>"))
TAKEN = bodies("<body name='a'><joint name='base_x'/><geom/></body>")


@pytest.mark.parametrize("arm", [ARMS["ur5e"], TURNED], ids=["ur5e", "turned"])
def test_the_base_drives_along_the_world_and_turns_the_arm_about_the_vertical(arm, kinematics_of):
    mobile = kinematics_of(arm.on_base())
    x, y, z = kinematics_of(arm).forward(arm.home).translation
    for base, place in (
        ((0, 0, 0), (x, y, z)), ((0.2, 0.1, 0), (x + 0.2, y + 0.1, z)), ((0, 0, np.pi / 2), (-y, x, z)),
    ):  # fmt: skip
        np.testing.assert_allclose(mobile.forward([*base, *arm.home]).translation, place, atol=1e-9)


def test_the_arm_does_what_it_can_and_the_base_the_rest(kinematics_of):
    spec = ARMS["baxter"].on_base()
    kinematics = kinematics_of(spec)
    near, far = (RigidTransform.from_translation([x, 0, 0]) * kinematics.forward(spec.home) for x in (0.03, 0.9))
    close_by, far_off = kinematics.solve(near, spec.home), kinematics.solve_any(far, spec.home)
    assert np.abs(close_by[:2]).max() < 0.005 < 0.1 < np.abs(far_off[:2]).max()
    np.testing.assert_allclose(kinematics.forward(far_off).translation, far.translation, atol=2e-4)


def test_the_base_stops_at_the_table_and_servos_drive_it_too(cell_of):
    cell = cell_of(ARMS["ur5e"].on_base(), seed=1)
    q = cell.arm.joints
    assert cell.arm.move_joints([0.6, *q[1:]]).reason is Outcome.COLLISION
    cell = cell_of(ARMS["ur5e"].on_base(), seed=1, dynamic=True)
    q[:3] += (-0.05, 0.05, 0.05)
    assert cell.arm.move_joints(q)
    np.testing.assert_allclose(cell.arm.joints, q, atol=2e-3)


def test_a_base_goes_under_any_models_settings():
    plain = bodies("<body name='a'><geom/><body><joint name='j'/><geom/><camera name='eye'/></body></body>")
    unseen = plain.mjcf.replace("<geom size", "<geom contype='0' conaffinity='0' size")
    for arm in (plain, FUSED, replace(plain, mjcf=unseen)):
        model = arm.on_base().load().compile()
        assert model.joint("base_yaw").range == pytest.approx([-np.pi, np.pi])  # these models are in degrees
        platform = model.geom_type == mujoco.mjtGeom.mjGEOM_CYLINDER
        assert model.geom_contype[platform].max() == model.geom_conaffinity[platform].max() == 1


@pytest.mark.parametrize(
    ("make", "error", "text"),
    [
        (lambda: HolonomicBase(reach=0), InvalidParameterError, "positive and finite; got reach=0"),
        (lambda: ARMS["ur5e"].on_base().on_base(), InvalidParameterError, "already stands on a base"),
        (lambda: replace(ARMS["ur5e"], base=HolonomicBase()), InvalidParameterError, "take its on_base"),
        (lambda: LOOSE.on_base().load(), ModelError, "the bodies a there, and 1 loose geoms"),
        (lambda: JOINTED.on_base().load(), ModelError, "'a', has a joint of its own.*one that stands still"),
        (lambda: TAKEN.on_base().load(), ModelError, "a joint 'base_x' of its own; rename it"),
    ],
)
def test_what_is_no_base_is_refused(make, error, text):
    with pytest.raises(error, match=text):
        make()
