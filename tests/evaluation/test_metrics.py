from functools import cache

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib import OBJECTS, VirtualSphere, WorkCell
from gvp_lib.errors import InvalidParameterError
from gvp_lib.evaluation.metrics import (
    ViewpointError,
    face_corners,
    homography_error,
    homography_floor,
    viewpoint_error,
)

RADIUS = 0.25  # m, the thesis's
HERE = RigidTransform.identity()


@cache
def cell_of(target: str, placement: str = "flat") -> WorkCell:
    return WorkCell(arm="floating", target=target, placement=placement, seed=3)


def outward(cell: WorkCell) -> np.ndarray:
    return -cell.truth.world_from_camera.rotation.as_matrix()[:, 2]


def corners_in(cell: WorkCell) -> np.ndarray:
    return face_corners(cell.target_spec, cell.truth.world_from_object, cell.truth.normal.nearest(outward(cell)))


def look_from(cell: WorkCell, tilt_deg: float, azimuth: float = 0.3, roll: float = 0.2) -> None:
    sphere = VirtualSphere(cell.truth.world_from_object.translation, RADIUS, cell.truth.normal.direction)
    cell.place_camera(sphere.viewpoint(np.radians(tilt_deg), azimuth, roll))


def turned(pose: RigidTransform, about: tuple[float, float, float]) -> RigidTransform:
    return RigidTransform.from_components(pose.translation, pose.rotation * Rotation.from_rotvec(about))


# viewpoint_error


@pytest.mark.parametrize("target", ["cuboid_1x1", "cuboid_1x4", "cylinder"])
@pytest.mark.parametrize("placement", ["flat", "side", "tilted"])
def test_turning_by_the_error_ends_it(target: str, placement: str) -> None:
    cell = cell_of(target, placement)
    for azimuth in (0.0, 1.0, 4.0):
        look_from(cell, 25, azimuth, roll=azimuth)
        error = viewpoint_error(cell.truth)
        assert np.hypot(error.about_x, error.about_y) == pytest.approx(error.total)
        assert error.total == cell.truth.viewpoint_error()
        assert error.roll == cell.truth.roll_error()
        cell.place_camera(turned(cell.truth.world_from_camera, (error.about_x, error.about_y, 0)))
        assert cell.truth.viewpoint_error() == pytest.approx(0, abs=1e-7)
        rest = cell.truth.roll_error()
        cell.place_camera(turned(cell.truth.world_from_camera, (0, 0, rest)))
        assert cell.truth.roll_error() == pytest.approx(0, abs=1e-7)


def test_the_signs_are_those_of_the_turn_to_make() -> None:
    cell = cell_of("cuboid_1x2")
    look_from(cell, 0)
    aligned = cell.truth.world_from_camera
    for about in ((0.1, 0.0), (-0.1, 0.0), (0.0, 0.1), (0.0, -0.1)):
        cell.place_camera(turned(aligned, (-about[0], -about[1], 0)))
        error = viewpoint_error(cell.truth)
        assert (error.about_x, error.about_y) == pytest.approx(about)


def test_a_lying_can_may_be_seen_from_anywhere_across_its_axis() -> None:
    cell = cell_of("cylinder", "side")
    normal = cell.truth.normal
    assert normal.circle_axis is not None
    sphere = VirtualSphere(cell.truth.world_from_object.translation, RADIUS, normal.direction)
    around = Rotation.from_rotvec(0.5 * normal.circle_axis)
    pose = sphere.viewpoint(0.0, 0.0)
    cell.place_camera(RigidTransform.from_components(pose.translation, around * pose.rotation))
    assert viewpoint_error(cell.truth).total == pytest.approx(0, abs=1e-7)


# face_corners


def test_a_bricks_corners_are_those_of_the_plane_of_its_studs() -> None:
    corners = face_corners(OBJECTS["cuboid_1x2"], HERE, (0, 0, 1))
    assert {tuple(np.abs(c).round(6)) for c in corners} == {(0.0318, 0.0159, 0.01185)}
    assert (corners[:, 2] > 0).all()


@pytest.mark.parametrize("target", ["cuboid_1x1", "cuboid_1x2", "cylinder", "alligator", "tomato_soup_box"])
@pytest.mark.parametrize("placement", ["flat", "side", "tilted"])
def test_an_aligned_camera_sees_the_corners_clockwise_from_the_top_left(target: str, placement: str) -> None:
    cell = cell_of(target, placement)
    look_from(cell, 0)
    cell.place_camera(turned(cell.truth.world_from_camera, (0, 0, cell.truth.roll_error())))
    seen = cell.truth.world_from_camera.inv().apply(corners_in(cell))[:, :2]
    a, b = seen[1] - seen[0], seen[2] - seen[1]
    assert a[0] * b[1] - a[1] * b[0] > 0
    assert np.linalg.norm(b) >= np.linalg.norm(a) - 1e-9
    if cell.truth.normal.major_axis is None:  # any roll is right, so that no corner is the top left
        return
    # Half a turn later it is as well aligned; a square, a quarter.
    shifts = (0, 1, 2, 3) if cell.truth.normal.symmetry < 2 else (0, 2)
    expected = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    assert any((np.sign(np.roll(seen, k, axis=0)) == expected).all() for k in shifts)


def test_a_lying_cans_rectangle_is_its_length_by_its_diameter_through_its_middle() -> None:
    spec = OBJECTS["cylinder"]
    for angle in (0.0, 0.7, 2.0):  # from whichever side
        corners = face_corners(spec, HERE, (np.cos(angle), np.sin(angle), 0))
        np.testing.assert_allclose(corners.mean(0), spec.bounding_box().center, atol=1e-12)
        assert np.linalg.norm(corners[1] - corners[0]) == pytest.approx(0.060, abs=1e-4)
        assert np.linalg.norm(corners[2] - corners[1]) == pytest.approx(0.150, abs=1e-3)
        assert corners[:, :2] @ (np.cos(angle), np.sin(angle)) == pytest.approx(0, abs=1e-9)


def test_a_standing_cans_rectangle_is_the_square_about_its_top() -> None:
    corners = face_corners(OBJECTS["cylinder"], HERE, (0, 0, 1))
    assert np.ptp(corners, axis=0) == pytest.approx((0.060, 0.060, 0), abs=1e-4)
    assert corners[0, 2] == pytest.approx(0.075, abs=1e-3)


# homography_error


@pytest.mark.parametrize(
    ("target", "placement"), [("cuboid_1x2", "tilted"), ("cuboid_1x1", "side"), ("cylinder", "side")]
)
def test_without_noise_the_homography_tells_the_true_error(target: str, placement: str) -> None:
    cell = cell_of(target, placement)
    for tilt, azimuth in ((0, 0.0), (10, 0.5), (35, 4.0)):
        look_from(cell, tilt, azimuth)
        pose, intrinsics = cell.truth.world_from_camera, cell.arm.intrinsics
        found = homography_error(corners_in(cell), pose, intrinsics, rng=0, pixel_sd=0)
        true = viewpoint_error(cell.truth)
        assert (found.total, found.about_x, found.about_y) == pytest.approx(
            (true.total, true.about_x, true.about_y), abs=1e-5
        )
        assert np.cos(4 * found.roll) == pytest.approx(np.cos(4 * true.roll), abs=1e-5)


def test_the_seed_decides_the_noise() -> None:
    cell = cell_of("cuboid_1x2")
    look_from(cell, 10)
    errors = [
        homography_error(corners_in(cell), cell.truth.world_from_camera, cell.arm.intrinsics, rng=seed)
        for seed in (1, 1, 2)
    ]
    assert errors[0] == errors[1] != errors[2]


def test_an_object_behind_the_camera_has_no_homography() -> None:
    cell = cell_of("cuboid_1x2")
    look_from(cell, 0)
    away = turned(cell.truth.world_from_camera, (np.pi, 0, 0))
    error = homography_error(corners_in(cell), away, cell.arm.intrinsics, rng=0)
    assert isinstance(error, ViewpointError)
    assert np.isnan((error.total, error.about_x, error.about_y, error.roll)).all()


def test_corners_in_another_order_are_refused() -> None:
    corners = face_corners(OBJECTS["cuboid_1x2"], HERE, (0, 0, 1))
    with pytest.raises(InvalidParameterError, match="top left, top right, bottom right, bottom left"):
        homography_error(corners[[0, 2, 1, 3]], HERE, cell_of("cuboid_1x2").arm.intrinsics, rng=0)


# homography_floor


@pytest.mark.parametrize(
    ("target", "direction", "printed_deg"),
    [
        ("cuboid_1x1", (0, 0, 1), 15.1),
        pytest.param("cuboid_1x2", (0, 0, 1), 7.9, marks=pytest.mark.full),
        pytest.param("cuboid_1x4", (0, 0, 1), 3.9, marks=pytest.mark.full),
        ("cylinder", (1, 0, 0), 1.7),  # lying: length by diameter
    ],
)
def test_the_floor_is_that_of_errata_22(target: str, direction: tuple[int, int, int], printed_deg: float) -> None:
    # The mean, with the radius measured to the rectangle: the plane of the studs, the middle of the can.
    corners = face_corners(OBJECTS[target], HERE, direction)
    floor = homography_floor(corners, RADIUS, cell_of(target).arm.intrinsics)
    assert np.degrees(floor.mean) == pytest.approx(printed_deg, rel=0.15)
    assert floor.interval.high - floor.interval.low < 0.1 * floor.mean


@pytest.mark.parametrize(("sides", "least", "most"), [((1, 1), 11.5, 13.5), ((1, 4), 10, 11.5)])
def test_opencvs_other_decomposition_has_a_floor_that_hardly_depends_on_the_shape(
    sides: tuple[int, int], least: float, most: float
) -> None:
    x, y = np.array(sides) * 0.0318 / 2
    plane = np.array([(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0)])
    intrinsics = cell_of("cuboid_1x1").arm.intrinsics
    seen, rng, tilts = intrinsics.project(plane + (0, 0, RADIUS)), np.random.default_rng(0), []
    for _ in range(500):
        pixels = seen + rng.normal(0, 1, seen.shape)
        _, rotations, *_ = cv2.solvePnPGeneric(plane, pixels, intrinsics.matrix, None, flags=cv2.SOLVEPNP_IPPE)
        tilts.append(np.arccos(np.clip(cv2.Rodrigues(rotations[0])[0][2, 2], -1, 1)))
    assert least < np.degrees(np.mean(tilts)) < most


def test_the_floor_is_in_proportion_to_the_noise() -> None:
    corners = face_corners(OBJECTS["cuboid_1x4"], HERE, (0, 0, 1))
    intrinsics = cell_of("cuboid_1x4").arm.intrinsics
    one, half = (homography_floor(corners, RADIUS, intrinsics, 1, sd, draws=400).mean for sd in (1.0, 0.5))
    assert one / half == pytest.approx(2, rel=0.05)
    assert homography_floor(corners, RADIUS, intrinsics, pixel_sd=0, draws=2).mean == pytest.approx(0, abs=1e-5)
