"""Degrees passed for radians, and other slips of a first hour, are answered with what would work."""

import re

import pytest

from gvp_lib import CanonicalNormal, HsvThreshold, Noise, ObjectSpec, VirtualSphere, WorkCell
from gvp_lib.errors import GvpError

pytestmark = pytest.mark.check

SOAP = '<mujoco><worldbody><body><geom type="box" size=".02 .03 .01"/></body></worldbody></mujoco>'
MUG = (
    '<mujoco><worldbody><body><geom type="cylinder" size=".035 .04"/>'
    '<geom type="box" size=".008 .006 .02" pos=".05 0 0"/></body></worldbody></mujoco>'
)


def lying_mug() -> WorkCell:
    """A mug without a normal that is up on its side."""
    upright = ObjectSpec("mug", MUG, HsvThreshold(), normals=[CanonicalNormal((0, 0, 1))])
    return WorkCell(arm="floating", target=upright, placement="side")


@pytest.mark.parametrize(
    ("slip", "said"),
    [
        (lambda: VirtualSphere((0, 0, 0), 0.3).viewpoint(30, 90), r"got 30\.0.*np\.radians"),
        (lambda: Noise(joint_offset_sd=5), r"joint_offset_sd is in radians.*np\.radians"),
        (lambda: WorkCell(arm="ur5e").arm.rotate_wrist(90), r"got 90.*np\.radians"),
        (lambda: HsvThreshold()(None), "imread returns None"),
        (lambda: HsvThreshold()("brick.png"), "a path"),
        (lambda: ObjectSpec("soap", SOAP, None), "called with an RGB image"),
        (lambda: ObjectSpec("soap", SOAP, "orange"), "called with an RGB image"),
        (lambda: ObjectSpec("soap", SOAP, HsvThreshold(), normals=[[0, 0, 1]]), r"CanonicalNormal\(\(0, 0, 1\)\)"),
        (lying_mug, r"90 deg from the vertical.*round_axis"),
    ],
)
def test_a_slip_is_noticed_and_traced_to_its_cause(slip, said) -> None:
    with pytest.raises(GvpError) as raised:
        slip()
    assert re.search(said, str(raised.value))
