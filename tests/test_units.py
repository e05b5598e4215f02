"""Degrees passed for radians, and other slips of a first hour, are answered with what would work."""

import numpy as np
import pytest

from gvp_lib import CanonicalNormal, HsvThreshold, Noise, ObjectSpec, VirtualSphere, WorkCell
from gvp_lib.errors import GvpError, InvalidImageError, InvalidParameterError

pytestmark = pytest.mark.check

SOAP = '<mujoco><worldbody><body><geom type="box" size=".02 .03 .01"/></body></worldbody></mujoco>'


def test_a_tilt_in_degrees_is_noticed():
    with pytest.raises(InvalidParameterError, match=r"got 30\.0.*np\.radians"):
        VirtualSphere((0, 0, 0), 0.3).viewpoint(30, 90)


def test_noise_in_degrees_is_noticed():
    with pytest.raises(InvalidParameterError, match=r"joint_offset_sd is in radians.*np\.radians"):
        Noise(joint_offset_sd=5)


def test_a_wrist_turned_by_degrees_is_noticed():
    with WorkCell(arm="ur5e") as cell, pytest.raises(InvalidParameterError, match=r"got 90.*np\.radians"):
        cell.arm.rotate_wrist(90)


@pytest.mark.parametrize(("image", "hint"), [(None, "imread returns None"), ("brick.png", "a path")])
def test_what_is_no_image_is_traced_to_its_cause(image, hint):
    with pytest.raises(InvalidImageError, match=hint):
        HsvThreshold()(image)


def test_a_segmenter_is_something_that_can_be_called():
    for segmenter in (None, "orange"):
        with pytest.raises(InvalidParameterError, match="called with an RGB image"):
            ObjectSpec("soap", SOAP, segmenter)


def test_normals_are_canonical_normals():
    with pytest.raises(InvalidParameterError, match=r"CanonicalNormal\(\(0, 0, 1\)\)"):
        ObjectSpec("soap", SOAP, HsvThreshold(), normals=[[0, 0, 1]])


def test_an_object_without_a_normal_that_is_up_on_its_side_is_told_so():
    handle = '<geom type="box" size=".008 .006 .02" pos=".05 0 0"/>'
    mug = f'<mujoco><worldbody><body><geom type="cylinder" size=".035 .04"/>{handle}</body></worldbody></mujoco>'
    upright = ObjectSpec("mug", mug, HsvThreshold(), normals=[CanonicalNormal(np.array([0, 0, 1.0]))])
    with pytest.raises(GvpError, match=r"90 deg from the vertical.*round_axis"):
        WorkCell(arm="floating", target=upright, placement="side")
