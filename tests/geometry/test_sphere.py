import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry import VirtualSphere, look_at

pytestmark = pytest.mark.check

Z = np.array((0.0, 0.0, 1.0))
CENTER = np.array((0.5, -0.2, 0.1))
SPHERE = VirtualSphere(CENTER, 0.25)

coordinates = st.floats(-2, 2)
points = st.tuples(coordinates, coordinates, coordinates).map(np.array)
near_vertical = st.sampled_from([(0, 0, 1), (0, 0, -1), (1e-13, 0, 1), (1e-13, 0, -1), (1e-9, 1e-9, -1)])
poles = points.filter(lambda p: np.linalg.norm(p) > 1e-3) | near_vertical
tilts, azimuths = st.floats(0, np.pi), st.floats(-np.pi, np.pi)


def axes(pose: RigidTransform) -> np.ndarray:
    """The camera's axes in the world, as columns; shape (..., 3, 3)."""
    return pose.rotation.as_matrix()


def outward(poses: RigidTransform, sphere: VirtualSphere = SPHERE) -> np.ndarray:
    """Unit vectors from the center to the cameras, shape (..., 3)."""
    return (poses.translation - sphere.center) / sphere.radius


def tilts_of(poses: RigidTransform, sphere: VirtualSphere = SPHERE) -> np.ndarray:
    out = outward(poses, sphere)
    return np.arctan2(np.linalg.norm(np.cross(out, sphere.pole), axis=-1), out @ sphere.pole)


@given(points, points)
@example(Z, np.zeros(3))  # straight down, any roll will do
def test_a_camera_looks_at_its_target_with_x_level_and_up_upward(eye: np.ndarray, target: np.ndarray) -> None:
    assume(np.linalg.norm(target - eye) > 1e-3)
    pose = look_at(eye, target)
    assert axes(pose)[2, 0] == pytest.approx(0)
    assert axes(pose)[2, 1] < 1e-9
    np.testing.assert_allclose(pose.inv().apply(target), (0, 0, np.linalg.norm(target - eye)), atol=1e-9)
    np.testing.assert_allclose(pose.translation, eye)


@given(poles, tilts, azimuths, azimuths)
def test_every_viewpoint_looks_at_the_center_at_its_tilt_and_without_roll_the_pole_is_up(pole, tilt, azimuth, roll):
    sphere = VirtualSphere(CENTER, 0.25, pole)
    pose = sphere.viewpoint(tilt, azimuth, roll)
    np.testing.assert_allclose(pose.inv().apply(CENTER), (0, 0, 0.25), atol=1e-12)
    assert np.linalg.det(axes(pose)) == pytest.approx(1)
    assert tilts_of(pose, sphere) == pytest.approx(tilt, abs=1e-8)
    level = axes(sphere.viewpoint(tilt, azimuth))
    assert level[:, 0] @ sphere.pole == pytest.approx(0, abs=1e-12)
    assert level[:, 1] @ sphere.pole <= 1e-12


@given(azimuths, st.floats(0.1, 1.0))
def test_a_roll_turns_the_image_and_nothing_else(roll: float, tilt: float) -> None:
    still, rolled = SPHERE.viewpoint(tilt, 0.7), SPHERE.viewpoint(tilt, 0.7, roll)
    turn = (still.inv() * rolled).rotation.as_rotvec()
    np.testing.assert_allclose(np.sin(turn), np.sin((0, 0, roll)), atol=1e-9)
    np.testing.assert_allclose(still.translation, rolled.translation)


def test_the_pole_is_the_end_of_every_meridian_without_a_jump_and_many_viewpoints_broadcast() -> None:
    poses = SPHERE.viewpoint([[0.0], [1e-9]], np.linspace(-3, 3, 7))
    assert poses.shape == (2, 7)
    assert ((poses[0].inv() * poses[1]).rotation.magnitude() < 1e-8).all()


@pytest.mark.parametrize(
    ("poses", "within"),
    [(SPHERE.uniform(4000, np.radians(60)), 0.003), (SPHERE.random(20000, 0, np.radians(60), sigma=None), 0.1)],
)
def test_uniform_viewpoints_cover_equal_areas_equally(poses: RigidTransform, within: float) -> None:
    count = np.histogram(outward(poses)[:, 2], bins=10, range=(0.5, 1))[0]  # Archimedes: equal heights, equal areas
    np.testing.assert_allclose(count, len(poses) / 10, rtol=within)


def test_uniform_neighbors_are_nowhere_much_closer_than_the_area_allows() -> None:
    out = outward(SPHERE.uniform(500))
    cosine = out @ out.T
    np.fill_diagonal(cosine, -1)
    spacing = np.sqrt(2 * np.pi * (1 - np.cos(np.radians(30))) / 500)
    assert np.arccos(cosine.max()) > 0.6 * spacing


def test_uniform_repeats_each_point_at_evenly_spaced_rolls() -> None:
    first = SPHERE.uniform(12, rolls=4)[:4]
    np.testing.assert_allclose(np.ptp(first.translation, axis=0), 0, atol=1e-15)
    turns = (first[0].inv() * first[1:]).rotation.magnitude()
    np.testing.assert_allclose(turns, (np.pi / 2, np.pi, np.pi / 2))


@given(st.integers(0, 2**32 - 1), st.sampled_from([None, np.radians(5), np.radians(15), 3.0]))
def test_random_viewpoints_stay_in_the_cap(seed: int, sigma: float | None) -> None:
    sphere = VirtualSphere(CENTER, 0.25, (0.3, 0.1, 0.9))
    assert tilts_of(sphere.random(50, seed, np.radians(30), sigma), sphere).max() <= np.radians(30) + 1e-9


def test_random_tilts_are_normal_about_the_pole() -> None:
    poses = SPHERE.random(20000, 0, max_tilt=np.pi, sigma=0.2)  # so wide a cap cuts nothing
    out = outward(poses)[:, :2]
    tilt = out * (tilts_of(poses) / np.linalg.norm(out, axis=1))[:, None]
    np.testing.assert_allclose(tilt.std(axis=0), 0.2, rtol=0.03)


def test_a_sphere_copies_its_arrays_and_freezes_them() -> None:
    center = np.zeros(3)
    sphere = VirtualSphere(center, 1.0, np.array((0, 0, 2.0)))
    center[0] = 5
    assert sphere.center[0] == 0
    np.testing.assert_array_equal(sphere.pole, Z)
    with pytest.raises(ValueError, match="read-only"):
        sphere.pole[0] = 1


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: VirtualSphere(CENTER, -1), "a positive radius in meters; got .* and -1"),
        (lambda: VirtualSphere(CENTER, 1, np.zeros(3)), "the pole not zero"),
        (lambda: look_at((1, 2, 3), (1, 2, 3)), "same point"),
        (lambda: SPHERE.viewpoint(30, 0), r"a tilt is in radians.*got 30.*np\.radians"),
        (lambda: SPHERE.uniform(10, rolls=4), "multiple of rolls; got n=10, rolls=4"),
        (lambda: SPHERE.random(5, 0, max_tilt=0), "max_tilt=0"),
        (lambda: SPHERE.random(5, 0, sigma=0), "sigma > 0 or None"),
    ],
)
def test_what_makes_no_sphere_or_viewpoint_is_refused(call, text: str) -> None:
    with pytest.raises(InvalidParameterError, match=text):
        call()
