"""What may stand for an argument of another type, and what may not. Ten thousand of them: tests/test_fuzz.py."""

from __future__ import annotations

from decimal import Decimal
from typing import Any

import numpy as np
import pytest
import torch
from eye_in_hand import CAMERA, white
from scipy.spatial.transform import RigidTransform
from synthetic import over_block

from gvp_lib import CameraIntrinsics, Eye, VirtualSphere
from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError
from gvp_lib.evaluation import summarize, wilson_interval
from gvp_lib.motion import estimate_depth, toward_pixel, traverse_arc

pytestmark = pytest.mark.check

POSES = VirtualSphere((0, 0, 0), 0.5).random(3, 1)
MATRICES = POSES.as_matrix()


@checked
def one(pose: RigidTransform) -> np.ndarray:
    return pose.as_matrix()


@checked(poses=True)
def several(poses: RigidTransform) -> np.ndarray:
    return poses.as_matrix()


@pytest.mark.parametrize(
    "given", [(np.float16(0.75), 640.0, np.array(480)), (Decimal("0.75"), torch.tensor(640), np.int16(480))]
)
def test_a_number_in_another_form_is_that_number(given):
    found, plain = CameraIntrinsics.from_fov(*given), CameraIntrinsics.from_fov(0.75, 640, 480)
    assert (found, repr(found)) == (plain, repr(plain))


@pytest.mark.parametrize("form", [list, torch.tensor, np.asfortranarray, lambda a: a.astype(">f8")])
def test_an_array_in_another_form_is_that_array(form):
    pixels = np.array([[10.0, 20.0], [600.0, 400.0]])
    np.testing.assert_array_equal(CAMERA.rays(form(pixels)), CAMERA.rays(pixels))


def test_a_matrix_is_a_pose_and_a_list_of_either_is_several():
    for form in (MATRICES[0], MATRICES[0].tolist(), MATRICES[0].astype(np.float32)):
        np.testing.assert_allclose(one(form), MATRICES[0], atol=1e-6)
    for form in (MATRICES, [*MATRICES], [*POSES], tuple(POSES)):
        np.testing.assert_allclose(several(form), MATRICES, atol=1e-12)


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: one(POSES), r"one: pose is one finite pose \(a RigidTransform, in m, or a matrix of shape \(4, 4\)\)"),
        (lambda: one(2 * MATRICES[0]), "pose is one finite pose"),
        (lambda: one(np.full((4, 4), np.nan)), "pose is one finite pose"),
        (lambda: CameraIntrinsics(640.5, 480, 530, 530, 319.5, 239.5), "width is a whole number; got a float, 640.5"),
        (lambda: CameraIntrinsics("640", 480, 530, 530, 319.5, 239.5), "width is a whole number; got a str, '640'"),
        (lambda: CameraIntrinsics(640, 480, None, 530, 319.5, 239.5), "fx is a number.*; got a NoneType, None"),
        (lambda: toward_pixel(CAMERA.matrix, (1, 2)), "intrinsics is a CameraIntrinsics; got a ndarray"),
        (lambda: toward_pixel(CAMERA, [[1], [2, 3]]), "pixel is numbers, in an array or in lists; got a list"),
        (lambda: Eye(over_block(), over_block()), "segmenter is a Segmenter .Callable from an RGB image.*PinholeArm"),
        (lambda: traverse_arc(over_block()), "traverse_arc: eye is an Eye; got a PinholeArm"),
        (lambda: estimate_depth(CAMERA, "abc", (1, 2), (3, 4)), "translation is numbers.*'abc'"),
        (lambda: summarize([1.0, 10**400]), "values is numbers"),
        (lambda: summarize([1.0, 2.0], seed=-1), "seed is a whole number, 0 or more; got an int, -1"),
        (lambda: wilson_interval(True, 5), "successes is a whole number; got a bool, True"),
        (lambda: VirtualSphere((0, 0, 0), np.array([0.5, 0.5])), "radius is a number.*; got a ndarray"),
    ],
)
def test_what_can_be_no_such_argument_is_refused_by_its_name(call: Any, text: str) -> None:
    with pytest.raises(InvalidParameterError, match=text):
        call()


def test_an_arm_that_lacks_a_method_is_told_all_that_it_needs():
    class Half:
        intrinsics = CAMERA

        def capture(self):
            return over_block().capture()

    with pytest.raises(
        InvalidParameterError, match=r"with capture\(\), .*move_joints\(\), rotate_wrist\(\)\); got a Half"
    ):
        Eye(Half(), white)


def test_a_call_that_changes_something_is_not_made_with_an_argument_that_is_refused():
    made = []

    @checked(own=("way",))
    def move(way: float, slowly: bool) -> None:
        if not isinstance(way, float):
            raise InvalidParameterError("which way?")
        made.append(way)

    with pytest.raises(InvalidParameterError, match="move: slowly is True or False"):
        move(1.0, "yes")
    with pytest.raises(InvalidParameterError, match="which way"):
        move("up", True)
    assert not made
    move(1.0, True)
    assert made == [1.0]
