import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gvp_lib import CameraIntrinsics
from gvp_lib.errors import InvalidParameterError

pytestmark = pytest.mark.check

CAMERA = CameraIntrinsics(640, 480, 530.0, 525.0, 322.5, 238.0)


@given(st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.floats(0.01, 10)))
def test_a_point_lies_on_the_ray_through_its_pixel_which_the_calibration_matrix_gives_too(point) -> None:
    pixel = CAMERA.project(point)
    np.testing.assert_allclose(CAMERA.rays(pixel) * np.linalg.norm(point), point, atol=1e-9)
    np.testing.assert_allclose(CAMERA.matrix @ point / point[2], (*pixel, 1), atol=1e-9)


def test_x_is_right_and_y_is_down_from_the_principal_point_and_behind_the_camera_nothing_is_seen() -> None:
    seen = CAMERA.project([(0, 0, 0.3), (0.1, 0.2, 1.0), (0, 0, -1), (0.1, 0, 0)])
    np.testing.assert_allclose(seen - CAMERA.principal_point, [(0, 0), (53, 105), 2 * [np.nan], 2 * [np.nan]])


@given(st.floats(0.01, 3.1), st.integers(1, 4000), st.integers(1, 4000))
def test_the_field_of_view_reaches_from_the_upper_to_the_lower_edge_and_comes_back(fovy, width, height) -> None:
    camera = CameraIntrinsics.from_fov(fovy, width, height)
    assert camera.fovy == pytest.approx(fovy, rel=1e-9)
    top, bottom = camera.rays([(camera.cx, -0.5), (camera.cx, height - 0.5)])
    assert np.arctan2(np.linalg.norm(np.cross(top, bottom)), top @ bottom) == pytest.approx(fovy)


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: CameraIntrinsics.from_fov(48.8, 640, 480), r"radians, between 0 and pi; got 48\.8 .*0\.8517 rad"),
        (lambda: CameraIntrinsics(640, 480, 0.0, 530.0, 319.5, 239.5), "positive, in pixels, .*fx=0.0"),
        (lambda: CameraIntrinsics(640, 480, 530.0, np.nan, 319.5, 239.5), "fy=nan"),
        (lambda: CameraIntrinsics(640, 480, 530.0, 530.0, np.inf, 239.5), "cx=inf"),
        (lambda: CameraIntrinsics(0, 480, 530.0, 530.0, 319.5, 239.5), "got 0 x 480 pixels"),
        (lambda: CAMERA.project((1, 2)), r"shape \(\.\.\., 3\); got \(2,\)"),
        (lambda: CAMERA.rays(np.zeros((4, 3))), r"shape \(\.\.\., 2\); got \(4, 3\)"),
    ],
)
def test_what_is_no_camera_point_or_pixel_is_refused(call, text: str) -> None:
    with pytest.raises(InvalidParameterError, match=text):
        call()
