import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gvp_lib import CameraIntrinsics
from gvp_lib.errors import InvalidParameterError

pytestmark = pytest.mark.check

CAMERA = CameraIntrinsics(640, 480, 530.0, 525.0, 322.5, 238.0)

pixels = st.tuples(st.floats(-2000, 2000), st.floats(-2000, 2000))
depths = st.floats(0.01, 10)


@given(pixels, depths)
def test_a_ray_followed_to_any_depth_projects_to_its_pixel(pixel: tuple[float, float], depth: float) -> None:
    np.testing.assert_allclose(CAMERA.project(depth * CAMERA.rays(pixel)), pixel, atol=1e-8)


@given(st.tuples(st.floats(-2, 2), st.floats(-2, 2), depths))
def test_a_point_lies_on_the_ray_through_its_pixel(point: tuple[float, float, float]) -> None:
    ray = CAMERA.rays(CAMERA.project(point))
    np.testing.assert_allclose(ray * np.linalg.norm(point), point, atol=1e-9)


def test_rays_have_unit_length_whatever_their_shape() -> None:
    rays = CAMERA.rays(np.random.default_rng(0).uniform(0, 480, (3, 4, 2)))
    assert rays.shape == (3, 4, 3)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1)


def test_the_optical_axis_meets_the_principal_point() -> None:
    np.testing.assert_array_equal(CAMERA.project((0, 0, 0.3)), CAMERA.principal_point)


def test_x_is_right_and_y_is_down_in_the_image() -> None:
    u, v = CAMERA.project((0.1, 0.2, 1.0)) - CAMERA.principal_point
    assert (u, v) == pytest.approx((53.0, 105.0))


def test_what_is_not_in_front_of_the_camera_has_no_pixel() -> None:
    seen = CAMERA.project([(0, 0, -1), (0.1, 0, 0), (0, 0, 1)])
    assert np.isnan(seen).all(axis=1).tolist() == [True, True, False]


def test_the_calibration_matrix_projects_alike() -> None:
    point = np.array((0.1, -0.2, 0.7))
    homogeneous = CAMERA.matrix @ point
    np.testing.assert_allclose(homogeneous[:2] / homogeneous[2], CAMERA.project(point))


@given(st.floats(0.01, 3.1), st.integers(1, 4000), st.integers(1, 4000))
def test_the_field_of_view_comes_back(fovy: float, width: int, height: int) -> None:
    assert CameraIntrinsics.from_fov(fovy, width, height).fovy == pytest.approx(fovy, rel=1e-9)


def test_the_field_of_view_reaches_from_the_upper_to_the_lower_edge_of_the_image() -> None:
    camera = CameraIntrinsics.from_fov(1.0, 640, 480)
    top, bottom = camera.rays([(camera.cx, -0.5), (camera.cx, 479.5)])
    assert np.arccos(top @ bottom) == pytest.approx(1.0)


def test_a_field_of_view_in_degrees_is_refused_with_its_value_in_radians() -> None:
    with pytest.raises(InvalidParameterError, match=r"radians, between 0 and pi; got 48\.8 .*0\.8517 rad"):
        CameraIntrinsics.from_fov(48.8, 640, 480)


@pytest.mark.parametrize("focal", [0.0, -1.0, np.nan, np.inf])
def test_a_focal_length_that_is_none_is_refused(focal: float) -> None:
    with pytest.raises(InvalidParameterError, match="finite and positive, in pixels; got fx="):
        CameraIntrinsics(640, 480, focal, 530.0, 319.5, 239.5)


def test_an_image_without_area_is_refused() -> None:
    with pytest.raises(InvalidParameterError, match="0 x 480 pixels has no area"):
        CameraIntrinsics(0, 480, 530.0, 530.0, 319.5, 239.5)


def test_wrong_shapes_are_named() -> None:
    with pytest.raises(InvalidParameterError, match=r"shape \(\.\.\., 3\); got \(2,\)"):
        CAMERA.project((1, 2))
    with pytest.raises(InvalidParameterError, match=r"shape \(\.\.\., 2\); got \(4, 3\)"):
        CAMERA.rays(np.zeros((4, 3)))
