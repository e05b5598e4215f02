import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform

from gvp_lib import VirtualSphere, look_at
from gvp_lib.errors import InvalidParameterError

pytestmark = pytest.mark.check

Z = np.array((0.0, 0.0, 1.0))
CENTER = np.array((0.5, -0.2, 0.1))

coordinates = st.floats(-2, 2)
points = st.tuples(coordinates, coordinates, coordinates).map(np.array)
poles = points.filter(lambda p: np.linalg.norm(p) > 1e-3)
tilts, azimuths = st.floats(0, np.pi), st.floats(-np.pi, np.pi)


def axes(pose: RigidTransform) -> np.ndarray:
    """The camera's axes in the world, as columns; shape (..., 3, 3)."""
    return pose.rotation.as_matrix()


def tilts_of(poses: RigidTransform, sphere: VirtualSphere) -> np.ndarray:
    outward = (poses.translation - sphere.center) / sphere.radius
    return np.arctan2(np.linalg.norm(np.cross(outward, sphere.pole), axis=-1), outward @ sphere.pole)


# look_at


@given(points, points)
def test_a_camera_looks_at_its_target(eye: np.ndarray, target: np.ndarray) -> None:
    if np.linalg.norm(target - eye) < 1e-3:
        return
    pose = look_at(eye, target)
    seen = pose.inv().apply(target)
    np.testing.assert_allclose(seen, (0, 0, np.linalg.norm(target - eye)), atol=1e-9)
    np.testing.assert_allclose(pose.translation, eye)


def test_up_is_up_in_the_image_and_x_is_level() -> None:
    camera = axes(look_at((1, 0.3, 0.5), (0, 0, 0)))
    assert camera[2, 0] == pytest.approx(0)
    assert camera[2, 1] < 0


def test_straight_down_the_roll_is_chosen_and_stays_finite() -> None:
    camera = axes(look_at((0, 0, 1), (0, 0, 0)))
    np.testing.assert_allclose(camera[:, 2], -Z)
    assert np.linalg.det(camera) == pytest.approx(1)


def test_looking_at_oneself_is_refused() -> None:
    with pytest.raises(InvalidParameterError, match="same point"):
        look_at((1, 2, 3), (1, 2, 3))


# VirtualSphere.viewpoint


@given(poles, tilts, azimuths, azimuths)
def test_every_viewpoint_looks_at_the_center_from_the_radius(
    pole: np.ndarray, tilt: float, azimuth: float, roll: float
) -> None:
    pose = VirtualSphere(CENTER, 0.25, pole).viewpoint(tilt, azimuth, roll)
    np.testing.assert_allclose(pose.inv().apply(CENTER), (0, 0, 0.25), atol=1e-12)


@given(poles, tilts, azimuths)
def test_without_roll_x_is_perpendicular_to_the_pole_and_the_pole_points_up(
    pole: np.ndarray, tilt: float, azimuth: float
) -> None:
    sphere = VirtualSphere(CENTER, 0.25, pole)
    camera = axes(sphere.viewpoint(tilt, azimuth))
    assert camera[:, 0] @ sphere.pole == pytest.approx(0, abs=1e-12)
    assert camera[:, 1] @ sphere.pole <= 1e-12


@given(poles, tilts, azimuths)
def test_tilt_is_the_angle_between_the_reversed_optical_axis_and_the_pole(
    pole: np.ndarray, tilt: float, azimuth: float
) -> None:
    sphere = VirtualSphere(CENTER, 0.25, pole)
    assert tilts_of(sphere.viewpoint(tilt, azimuth), sphere) == pytest.approx(tilt, abs=1e-9)


def test_azimuth_zero_is_towards_x_for_the_upright_pole() -> None:
    pose = VirtualSphere((0, 0, 0), 2.0).viewpoint(np.pi / 2, 0)
    np.testing.assert_allclose(pose.translation, (2, 0, 0), atol=1e-12)


@given(st.floats(-np.pi, np.pi), st.floats(0.1, 1.0))
def test_a_roll_turns_the_image_and_nothing_else(roll: float, tilt: float) -> None:
    sphere = VirtualSphere(CENTER, 0.25)
    still, rolled = sphere.viewpoint(tilt, 0.7), sphere.viewpoint(tilt, 0.7, roll)
    turn = (still.inv() * rolled).rotation.as_rotvec()
    np.testing.assert_allclose(np.sin(turn), np.sin((0, 0, roll)), atol=1e-9)
    np.testing.assert_allclose(still.translation, rolled.translation)


def test_the_pole_is_the_end_of_every_meridian_without_a_jump() -> None:
    sphere = VirtualSphere(CENTER, 0.25)
    for azimuth in np.linspace(-3, 3, 7):
        at, near = sphere.viewpoint(0.0, azimuth), sphere.viewpoint(1e-9, azimuth)
        assert (at.inv() * near).rotation.magnitude() < 1e-8


@pytest.mark.parametrize("pole", [(0, 0, 1), (0, 0, -1), (1e-13, 0, 1), (1e-13, 0, -1), (1e-9, 1e-9, -1)])
def test_poles_at_and_near_the_vertical_give_proper_rotations(pole: tuple[float, ...]) -> None:
    sphere = VirtualSphere(CENTER, 0.25, np.array(pole))
    poses = sphere.viewpoint(np.linspace(0, 1, 5), np.linspace(0, 6, 5))
    np.testing.assert_allclose(np.linalg.det(axes(poses)), 1)
    np.testing.assert_allclose(tilts_of(poses, sphere), np.linspace(0, 1, 5), atol=1e-8)


def test_many_viewpoints_broadcast() -> None:
    poses = VirtualSphere(CENTER, 0.25).viewpoint([[0.1], [0.2]], [0.0, 1.0, 2.0])
    assert poses.shape == (2, 3)


# VirtualSphere.uniform


def test_uniform_viewpoints_cover_equal_areas_equally() -> None:
    sphere = VirtualSphere(CENTER, 0.25)
    n = 4000
    poses = sphere.uniform(n, max_tilt=np.radians(60))
    outward = (poses.translation - CENTER) / 0.25
    height = np.histogram(outward[:, 2], bins=10, range=(0.5, 1))[0]  # Archimedes: equal heights are equal areas
    sector = np.histogram(np.arctan2(outward[:, 1], outward[:, 0]), bins=8, range=(-np.pi, np.pi))[0]
    np.testing.assert_allclose(height, n / 10, atol=1)
    np.testing.assert_allclose(sector, n / 8, rtol=0.02)


def test_uniform_neighbors_are_nowhere_much_closer_than_the_area_allows() -> None:
    outward = VirtualSphere(np.zeros(3), 1.0).uniform(500).translation
    cosine = outward @ outward.T
    np.fill_diagonal(cosine, -1)
    nearest = np.arccos(cosine.max(axis=1))
    spacing = np.sqrt(2 * np.pi * (1 - np.cos(np.radians(30))) / 500)
    assert nearest.min() > 0.6 * spacing


def test_uniform_repeats_each_point_at_evenly_spaced_rolls() -> None:
    poses = VirtualSphere(CENTER, 0.25).uniform(12, rolls=4)
    first = poses[:4]
    np.testing.assert_allclose(np.ptp(first.translation, axis=0), 0, atol=1e-15)
    turns = (first[0].inv() * first[1:]).rotation.magnitude()
    np.testing.assert_allclose(turns, (np.pi / 2, np.pi, np.pi / 2))


def test_a_number_of_viewpoints_that_rolls_do_not_divide_is_refused() -> None:
    with pytest.raises(InvalidParameterError, match="multiple of rolls; got n=10, rolls=4"):
        VirtualSphere(CENTER, 0.25).uniform(10, rolls=4)


# VirtualSphere.random


@given(st.integers(0, 2**32 - 1), st.sampled_from([None, np.radians(5), np.radians(15), 3.0]))
def test_random_viewpoints_stay_in_the_cap_and_look_at_the_center(seed: int, sigma: float | None) -> None:
    sphere = VirtualSphere(CENTER, 0.25, (0.3, 0.1, 0.9))
    poses = sphere.random(50, seed, np.radians(30), sigma)
    assert tilts_of(poses, sphere).max() <= np.radians(30) + 1e-9
    np.testing.assert_allclose(poses.inv().apply(CENTER), np.tile((0, 0, 0.25), (50, 1)), atol=1e-12)


def test_the_same_seed_gives_the_same_viewpoints_and_another_seed_others() -> None:
    sphere = VirtualSphere(CENTER, 0.25)
    once, again, other = (sphere.random(5, seed).as_matrix() for seed in (7, 7, 8))
    np.testing.assert_array_equal(once, again)
    assert not np.allclose(once, other)


def test_random_tilts_are_normal_about_the_pole() -> None:
    sphere = VirtualSphere(CENTER, 0.25)
    poses = sphere.random(20000, 0, max_tilt=np.pi, sigma=0.2)  # so wide a cap cuts nothing
    outward = (poses.translation - CENTER) / 0.25
    angle = tilts_of(poses, sphere) / np.linalg.norm(outward[:, :2], axis=1)
    np.testing.assert_allclose((outward[:, :2] * angle[:, None]).std(axis=0), 0.2, rtol=0.03)


def test_uniform_random_viewpoints_fill_equal_areas_equally() -> None:
    poses = VirtualSphere(CENTER, 0.25).random(20000, 0, np.radians(60), sigma=None)
    height = np.histogram((poses.translation[:, 2] - CENTER[2]) / 0.25, bins=10, range=(0.5, 1))[0]
    np.testing.assert_allclose(height, 2000, rtol=0.1)


def test_random_refuses_what_makes_no_cap() -> None:
    with pytest.raises(InvalidParameterError, match="max_tilt=0"):
        VirtualSphere(CENTER, 0.25).random(5, 0, max_tilt=0)
    with pytest.raises(InvalidParameterError, match="sigma > 0 or None"):
        VirtualSphere(CENTER, 0.25).random(5, 0, sigma=0)


# VirtualSphere itself


def test_a_sphere_copies_its_arrays_and_freezes_them() -> None:
    center = np.array((0.0, 0.0, 0.0))
    sphere = VirtualSphere(center, 1.0, np.array((0, 0, 2.0)))
    center[0] = 5
    assert sphere.center[0] == 0
    np.testing.assert_array_equal(sphere.pole, Z)
    with pytest.raises(ValueError, match="read-only"):
        sphere.pole[0] = 1


def test_bad_spheres_are_refused() -> None:
    with pytest.raises(InvalidParameterError, match="radius is positive, in meters; got -1"):
        VirtualSphere(CENTER, -1)
    with pytest.raises(InvalidParameterError, match="the pole not zero"):
        VirtualSphere(CENTER, 1, np.zeros(3))
