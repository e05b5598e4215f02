"""Slips of a first hour that only a whole cell can notice; the others are in the tests of their rooms."""

import pytest

from gvp_lib import HsvThreshold, ObjectSpec, WorkCell
from gvp_lib.errors import GvpError
from gvp_lib.simulation import CanonicalNormal

pytestmark = pytest.mark.check

MUG = (
    '<mujoco><worldbody><body><geom type="cylinder" size=".035 .04"/>'
    '<geom type="box" size=".008 .006 .02" pos=".05 0 0"/></body></worldbody></mujoco>'
)


def test_degrees_passed_for_radians_are_noticed() -> None:
    with pytest.raises(GvpError, match=r"got 90.*np\.radians"):
        WorkCell(arm="ur5e").arm.rotate_wrist(90)


def test_a_mug_without_a_normal_that_is_up_on_its_side_is_told_how_to_get_one() -> None:
    upright = ObjectSpec("mug", MUG, HsvThreshold(), normals=[CanonicalNormal((0, 0, 1))])
    with pytest.raises(GvpError, match=r"90 deg from the vertical.*round_axis"):
        WorkCell(arm="floating", target=upright, placement="side")
