"""Silhouettes of simple solids: their moments against those of the same solid drawn finely; a fitted solid's size."""

import cv2
import numpy as np
import pytest
from eye_in_hand import CAMERA
from hands import fitted
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.planning.solids import BOX, CYLINDER, silhouette_moments

pytestmark = pytest.mark.check

FINE = 16  # times finer than the camera's pixels
_BITS = 4  # of a fine pixel's fraction, for OpenCV
FACING = np.diag([1.0, -1.0, -1.0])  # camera_from_solid of a camera right above, x to the right

both_shapes = pytest.mark.parametrize("shape", [BOX, CYLINDER], ids=lambda shape: shape.name)
rotations = st.integers(0, 2**32 - 1).map(lambda seed: Rotation.random(rng=np.random.default_rng(seed)).as_matrix())
places = st.tuples(st.floats(-0.06, 0.06), st.floats(-0.04, 0.04), st.floats(0.2, 0.5)).map(np.array)
lengths = st.tuples(*[st.floats(0.02, 0.13)] * 3)
tops = st.sampled_from([(0.0, 0.0), (0.004, 0.0), (0.004, 0.005), (0.006, 0.001), (0.002, 0.02)])


def moments(shape, rotation, place, sizes):
    return silhouette_moments(shape, rotation, np.asarray(place), np.asarray(sizes, float), CAMERA)[0]


def drawn(shape, rotation, place, sizes):
    """The same moments of the solid's outline, drawn at ``FINE`` times the resolution."""
    pixels = CAMERA.project(shape.vertices(np.array(sizes)) @ np.asarray(rotation).T + place)
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


@both_shapes
@settings(max_examples=60)
@given(rotation=rotations, place=places, sides=lengths, top=tops)
def test_the_moments_are_those_of_the_outline_drawn_finely(shape, rotation, place, sides, top):
    solid = (shape, rotation, place, [sides[0], sides[0 if shape.round else 1], sides[2], *top])
    found, wanted = moments(*solid), drawn(*solid)
    extent = np.sqrt(wanted[3] + wanted[5])
    assert found[0] == pytest.approx(wanted[0], rel=0.003)
    np.testing.assert_allclose(found[1:3], wanted[1:3], atol=0.003 * extent)
    np.testing.assert_allclose(found[3:], wanted[3:], atol=0.003 * extent**2)


@both_shapes
@settings(max_examples=60)
@given(rotation=rotations, place=places, sides=lengths, top=tops)
def test_the_derivatives_are_the_slopes_of_the_moments(shape, rotation, place, sides, top):
    sizes = np.array([*sides, *top])
    _, derivatives = silhouette_moments(shape, rotation, place, sizes, CAMERA)

    def nudged(step):
        """Moments of the solid turned about the lens, shifted and grown by a step, shape (11,)."""
        turn = Rotation.from_rotvec(step[:3]).as_matrix()
        return moments(shape, turn @ rotation, turn @ place + step[3:6], sizes + step[6:])

    count = 11 if top[1] else 9  # without a top there is no slope to its sizes
    wanted = np.stack([(nudged(s) - nudged(-s)) / 2e-6 for s in 1e-6 * np.eye(11)[:count]], axis=-1)
    within = 1e-5 * np.abs(wanted).max(axis=-1, keepdims=True)
    assert (np.abs(derivatives[:, :count] - wanted) < within).all()


def test_a_plate_seen_face_on_is_a_rectangle_and_a_can_along_its_axis_a_disc():
    z = 0.4
    w, h = CAMERA.fx * np.array([0.08, 0.03]) / z
    plate = moments(BOX, FACING, [0.0, 0.0, z], [0.08, 0.03, 1e-9, 0, 0])
    np.testing.assert_allclose(plate, [w * h, *CAMERA.principal_point, w**2 / 12, 0, h**2 / 12], atol=1e-4)
    radius = CAMERA.fx * 0.03 / z  # of a polygon with the circle's area
    disc = moments(CYLINDER, FACING, [0.0, 0.0, z], [0.06, 0.06, 1e-9, 0, 0])
    wanted = [np.pi * radius**2, *CAMERA.principal_point, radius**2 / 4, 0, radius**2 / 4]
    np.testing.assert_allclose(disc, wanted, rtol=0.001, atol=1e-6)
    assert disc[0] == pytest.approx(wanted[0], rel=1e-6)


@both_shapes
def test_a_solid_that_is_not_in_front_of_the_camera_has_no_moments_and_many_at_once_are_as_one_by_one(shape):
    rotation, sizes = Rotation.random(5, rng=np.random.default_rng(0)).as_matrix(), [0.06, 0.05, 0.04, 0.004, 0.005]
    places = [[0.01, -0.02, z] for z in (-0.3, 0.0, 0.02, 0.3, 0.4)]  # behind, about the lens, partly behind
    together = moments(shape, rotation, places, sizes)
    assert np.isnan(together).all(axis=-1).tolist() == [True] * 3 + [False] * 2
    alone = [moments(shape, *each, sizes) for each in zip(rotation, places, strict=True)]
    np.testing.assert_allclose(together, alone, rtol=1e-12)


# The height and surface of a fitted solid


@pytest.mark.parametrize(
    ("kind", "sizes", "normal", "height"),
    [
        # A box's is that of the face looked at, with the studs where they stand on it.
        ("box", (0.064, 0.032, 0.019), (0, 0, -1), 0.023),
        ("box", (0.064, 0.032, 0.019), (1, 0, 0), 0.064),
        ("box", (0.064, 0.032, 0.019), (0, -1, 0), 0.032),
        # A standing can's is its length, a lying one's its diameter, from whichever side.
        ("cylinder", (0.060, 0.060, 0.146), (0, 0, 1), 0.150),
        *(("cylinder", (0.060, 0.060, 0.146), (np.cos(a), np.sin(a), 0), 0.060) for a in (0, np.pi / 4)),
    ],
)
def test_a_fitted_solids_height_is_its_extent_along_the_normal_and_its_surface_is_half_of_that_from_its_center(
    kind, sizes, normal, height
):
    turn = Rotation.from_rotvec([0.4, -0.9, 0.3])
    solid = fitted(sizes, top=(0.004, 0.004), normal=normal, center=(0.3, -0.1, 0.2), turn=turn, kind=kind)
    assert solid.height == pytest.approx(height)
    facing, _ = Rotation.align_vectors([-solid.normal], [[0.0, 0.0, 1.0]])
    surface = solid.base_from_solid.translation + height / 2 * solid.normal
    camera = RigidTransform.from_components(surface + 0.25 * solid.normal, facing)
    for step, ahead in (((0.05, -0.02, 0.0), 0.25), ((0.0, 0.0, 0.1), 0.15)):  # across the lens nothing changes
        assert solid.surface_from(camera * RigidTransform.from_translation(step)) == pytest.approx(ahead)


@pytest.mark.parametrize(
    ("kind", "sizes", "turn", "depth", "span"),
    [
        # A brick, the top of which narrows to 24 mm: wider the deeper the fingers go, up to its body.
        ("box", (0.032, 0.064, 0.019), (0, 0, 0), 0.001, 0.026),
        ("box", (0.032, 0.064, 0.019), (0, 0, 0), 0.016, 0.032),
        ("box", (0.032, 0.064, 0.019), (0, 0, np.pi / 2), 0.016, 0.064),
        # Turned a little, it is wider by what a finger's breadth sees of its sides; leaned, by its height.
        ("box", (0.032, 0.064, 0.019), (0, 0, 0.2), 0.016, 0.032 / np.cos(0.2) + 0.016 * np.tan(0.2)),
        ("box", (0.032, 0.064, 0.019), (0, 0.3, 0), 0.100, 0.032 * np.cos(0.3) + 0.019 * np.sin(0.3)),
        # A lying can: its chord, then its diameter.
        ("cylinder", (0.060, 0.060, 0.146), (np.pi / 2, 0, 0), 0.010, 2 * np.sqrt(0.030**2 - 0.020**2)),
        ("cylinder", (0.060, 0.060, 0.146), (np.pi / 2, 0, 0), 0.040, 0.060),
        ("box", (0.032, 0.064, 0.019), (0, 0, 0), -0.010, 0.0),  # they are not there yet
    ],
)
def test_fingers_must_span_what_they_pass_on_the_way_to_their_depth(kind, sizes, turn, depth, span):
    top = (0.004, 0.004) if kind == "box" and not turn[1] else (0.0, 0.0)
    solid = fitted(sizes, top=top, center=(0.5, 0.1, 0.2), turn=Rotation.from_rotvec(turn), kind=kind)
    high = solid.corners[:, 2].max()
    camera = RigidTransform.from_components((0.5, 0.1, high + 0.2), Rotation.from_rotvec([np.pi, 0, 0]))
    assert solid.span(camera, 0.2 + depth, breadth=0.016) == pytest.approx(span, abs=0.0008)  # a can has 24 sides
