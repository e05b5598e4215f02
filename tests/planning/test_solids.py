"""Silhouettes of simple solids: their moments against those of the same solid drawn finely."""

import cv2
import numpy as np
import pytest
from eye_in_hand import CAMERA
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gvp_lib.planning.solids import BOX, CYLINDER, silhouette_derivatives, silhouette_moments

pytestmark = pytest.mark.check

FINE = 16  # times finer than the camera's pixels
_BITS = 4  # of a fine pixel's fraction, for OpenCV
PLAIN, TOPPED = (0.064, 0.032, 0.020, 0.0, 0.0), (0.064, 0.032, 0.020, 0.004, 0.005)
FACING = np.diag([1.0, -1.0, -1.0])  # camera_from_solid of a camera right above, x to the right


def drawn(shape, rotation, translation, sizes):
    """The same moments of the solid's outline, drawn at ``FINE`` times the resolution."""
    corners = shape.vertices(np.array(sizes)) @ np.asarray(rotation).T + translation
    pixels = CAMERA.project(corners)
    low = np.floor(pixels.min(0)) - 1
    fine = np.rint(((pixels - low + 0.5) * FINE - 0.5) * 2**_BITS).astype(np.int32)
    size = np.ceil((pixels.max(0) - low + 2) * FINE).astype(int)
    image = np.zeros(size[::-1], np.uint8)
    outline = cv2.convexHull(fine)
    cv2.fillConvexPoly(image, outline, 2, cv2.LINE_8, _BITS)
    cv2.polylines(image, [outline], True, 1, 1, cv2.LINE_8, _BITS)  # of the outline's own pixels half is outside
    m = cv2.moments(image)
    u, v = ((np.array([m["m10"], m["m01"]]) / m["m00"]) + 0.5) / FINE - 0.5 + low
    second = np.array([m["mu20"], m["mu11"], m["mu02"]]) / m["m00"] / FINE**2
    return np.array([m["m00"] / 2 / FINE**2, u, v, *second])


def check_alike(found, wanted, within=0.003):
    """Area and inertia within a share, the centroid within the same share of the silhouette's extent."""
    extent = np.sqrt(wanted[3] + wanted[5])
    assert found[0] == pytest.approx(wanted[0], rel=within)
    np.testing.assert_allclose(found[1:3], wanted[1:3], atol=within * extent)
    np.testing.assert_allclose(found[3:], wanted[3:], atol=within * extent**2)


rotations = st.integers(0, 2**32 - 1).map(lambda seed: Rotation.random(rng=np.random.default_rng(seed)).as_matrix())
places = st.tuples(st.floats(-0.06, 0.06), st.floats(-0.04, 0.04), st.floats(0.2, 0.5)).map(np.array)
lengths = st.tuples(*[st.floats(0.015, 0.13)] * 3)
tops = st.sampled_from([(0.0, 0.0), (0.004, 0.005), (0.006, 0.001), (0.002, 0.02)])


@settings(max_examples=60)
@given(rotations, places, lengths, tops)
def test_the_moments_of_a_box_are_those_of_its_outline_drawn_finely(rotation, place, sides, top):
    sizes = np.array([*sides, *top])
    found = silhouette_moments(BOX, rotation, place, sizes, CAMERA)
    check_alike(found, drawn(BOX, rotation, place, sizes))


@settings(max_examples=60)
@given(rotations, places, st.floats(0.03, 0.08), st.floats(0.02, 0.16), tops)
def test_the_moments_of_a_can_are_those_of_its_outline_drawn_finely(rotation, place, diameter, height, top):
    sizes = np.array([diameter, diameter, height, *top])
    found = silhouette_moments(CYLINDER, rotation, place, sizes, CAMERA)
    check_alike(found, drawn(CYLINDER, rotation, place, sizes))


@settings(max_examples=20)
@given(rotations, places)
def test_a_can_of_24_corners_is_as_good_as_a_round_one(rotation, place):
    # Drawn with ten times as many corners, which no eye can tell from a circle.
    angle = np.linspace(0, 2 * np.pi, 240, endpoint=False)
    round_ring = type(CYLINDER)("cylinder", 0.5 * np.stack([np.cos(angle), np.sin(angle)], axis=1), True)
    sizes = np.array([0.06, 0.06, 0.09, 0.0, 0.0])
    found = silhouette_moments(CYLINDER, rotation, place, sizes, CAMERA)
    check_alike(found, drawn(round_ring, rotation, place, sizes), within=0.01)


def nudged(shape, rotation, translation, sizes, step):
    """Moments of a solid that is turned about the lens, shifted and grown by a step, shape (11,)."""
    turn = Rotation.from_rotvec(step[:3]).as_matrix()
    return silhouette_moments(shape, turn @ rotation, turn @ translation + step[3:6], sizes + step[6:], CAMERA)


@pytest.mark.parametrize("shape", [BOX, CYLINDER], ids=lambda shape: shape.name)
@settings(max_examples=60)
@given(rotation=rotations, place=places, sides=lengths, top=tops)
def test_the_derivatives_are_the_slopes_of_the_moments(shape, rotation, place, sides, top):
    pose, sizes = (rotation, place), np.array([*sides, *top])
    moments, derivatives = silhouette_derivatives(shape, *pose, sizes, CAMERA)
    np.testing.assert_array_equal(moments, silhouette_moments(shape, *pose, sizes, CAMERA))
    count = 11 if top[1] else 9  # without a top there is no slope to its sizes
    steps = 1e-6 * np.eye(11)[:count]
    slopes = [(nudged(shape, *pose, sizes, s) - nudged(shape, *pose, sizes, -s)) / 2e-6 for s in steps]
    wanted = np.stack(slopes, axis=-1)
    within = 1e-5 * np.abs(wanted).max(axis=-1, keepdims=True)
    assert (np.abs(derivatives[:, :count] - wanted) < within).all()


@pytest.mark.parametrize("shape", [BOX, CYLINDER], ids=lambda shape: shape.name)
def test_a_top_changes_what_is_seen_and_one_of_no_size_does_not(shape):
    pose = Rotation.from_euler("xyz", [2.6, 0.3, 0.5]).as_matrix(), np.array([0.01, 0.0, 0.3])
    plain, flat, topped = (
        silhouette_moments(shape, *pose, np.array([0.05, 0.05, 0.03, *top]), CAMERA)
        for top in ((0, 0), (0.004, 0), (0.004, 0.006))
    )
    np.testing.assert_allclose(flat, plain, rtol=1e-9)
    assert topped[0] > 1.005 * plain[0]


def test_a_plate_seen_face_on_has_the_moments_of_a_rectangle():
    a, b, z, f = 0.08, 0.03, 0.4, CAMERA.fx
    found = silhouette_moments(BOX, FACING, np.array([0.0, 0.0, z]), np.array([a, b, 1e-9, 0, 0]), CAMERA)
    w, h = f * a / z, f * b / z
    np.testing.assert_allclose(found, [w * h, *CAMERA.principal_point, w**2 / 12, 0, h**2 / 12], atol=1e-4)


def test_a_can_seen_along_its_axis_is_a_disc():
    found = silhouette_moments(CYLINDER, FACING, np.array([0.0, 0.0, 0.4]), np.array([0.06, 0.06, 1e-9, 0, 0]), CAMERA)
    radius = CAMERA.fx * 0.03 / 0.4
    np.testing.assert_allclose(found[0], np.pi * radius**2, rtol=1e-6)  # its polygon has the circle's area
    np.testing.assert_allclose(found[1:3], CAMERA.principal_point, atol=1e-9)
    np.testing.assert_allclose(found[[3, 5]], radius**2 / 4, rtol=0.001)
    assert abs(found[4]) < 1e-9 * radius**2


@settings(max_examples=20)
@given(rotations, st.floats(0.2, 0.5))
def test_a_small_cube_shows_nearly_alike_from_everywhere_as_a_ball_would(rotation, distance):
    # A cube's silhouette is between one face and sqrt(3) faces, whichever way it is turned, and its centroid is put.
    side = 0.002
    found = silhouette_moments(BOX, rotation, np.array([0, 0, distance]), np.array([side, side, side, 0, 0]), CAMERA)
    faces = found[0] / (CAMERA.fx * side / distance) ** 2
    assert 0.97 < faces < 1.03 * np.sqrt(3)
    np.testing.assert_allclose(found[1:3], CAMERA.principal_point, atol=0.05)
    assert found[3] * found[5] - found[4] ** 2 > 0


def test_a_solid_twice_as_far_and_twice_as_large_looks_the_same():
    rotation, place = Rotation.from_euler("xyz", [2.5, 0.4, 1.0]).as_matrix(), np.array([0.02, -0.01, 0.25])
    for shape in (BOX, CYLINDER):
        once = silhouette_moments(shape, rotation, place, np.array(TOPPED), CAMERA)
        twice = silhouette_moments(shape, rotation, 2 * place, 2 * np.array(TOPPED), CAMERA)
        np.testing.assert_allclose(twice, once, rtol=1e-9)


def test_a_half_turn_about_any_axis_of_a_box_changes_nothing():
    place = np.array([0.02, -0.01, 0.25])
    rotation = Rotation.from_euler("xyz", [2.5, 0.4, 1.0]).as_matrix()
    once = silhouette_moments(BOX, rotation, place, np.array(PLAIN), CAMERA)
    for turn in np.pi * np.eye(3):
        turned = rotation @ Rotation.from_rotvec(turn).as_matrix()
        np.testing.assert_allclose(silhouette_moments(BOX, turned, place, np.array(PLAIN), CAMERA), once, rtol=1e-9)


@pytest.mark.parametrize("shape", [BOX, CYLINDER], ids=lambda shape: shape.name)
@pytest.mark.parametrize("z", [-0.3, 0.0, 0.02], ids=["behind", "about the lens", "partly behind"])
def test_a_solid_that_is_not_in_front_of_the_camera_has_no_moments(shape, z):
    found = silhouette_moments(shape, np.eye(3), np.array([0.0, 0.0, z]), np.array([0.06, 0.06, 0.06, 0, 0]), CAMERA)
    assert found.shape == (6,)
    assert np.isnan(found).all()


def test_many_silhouettes_at_once_are_as_many_one_by_one():
    rng = np.random.default_rng(0)
    rotation = Rotation.random(6, rng=rng).as_matrix().reshape(2, 3, 3, 3)
    place = np.array([0.0, 0.0, 0.3]) + rng.uniform(-0.03, 0.03, (2, 3, 3))
    place[1, 2, 2] = -0.3  # one of them behind the camera
    sizes = rng.uniform(0.02, 0.06, (2, 1, 5)) * (1, 1, 1, 0.1, 0.1)
    together = silhouette_moments(CYLINDER, rotation, place, sizes, CAMERA)
    assert together.shape == (2, 3, 6)
    assert np.isnan(together).all(axis=-1).tolist() == [[False, False, False], [False, False, True]]
    for i, j in np.ndindex(2, 3):
        alone = silhouette_moments(CYLINDER, rotation[i, j], place[i, j], sizes[i, 0], CAMERA)
        np.testing.assert_allclose(together[i, j], alone, rtol=1e-12)


def test_the_coarse_can_has_half_the_corners_and_about_the_same_silhouette():
    assert len(CYLINDER.coarse.ring) == len(CYLINDER.ring) / 2
    assert BOX.coarse is BOX
    pose = Rotation.from_euler("xyz", [2.5, 0.4, 1.0]).as_matrix(), np.array([0.0, 0.0, 0.3])
    fine, coarse = (
        silhouette_moments(s, *pose, np.array([0.06, 0.06, 0.1, 0, 0]), CAMERA) for s in (CYLINDER, CYLINDER.coarse)
    )
    check_alike(coarse, fine, within=0.03)
