from dataclasses import astuple
from functools import cache

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib import OBJECTS, VirtualSphere, WorkCell
from gvp_lib.errors import InvalidParameterError
from gvp_lib.evaluation.metrics import face_corners, homography_error, homography_floor, viewpoint_error
from gvp_lib.geometry.camera import CameraIntrinsics

RADIUS = 0.25  # m, the thesis's
HERE = RigidTransform.identity()
LENS = CameraIntrinsics.from_fov(np.radians(45), 640, 480)
SQUARE = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])  # top left, then clockwise
every_placement = pytest.mark.parametrize("placement", ["flat", "side", "tilted"])


@cache
def cell_of(target: str, placement: str = "flat") -> WorkCell:
    return WorkCell(arm="floating", target=target, placement=placement, seed=3)


def corners_in(cell: WorkCell) -> np.ndarray:
    outward = -cell.truth.world_from_camera.rotation.as_matrix()[:, 2]
    return face_corners(cell.target_spec, cell.truth.world_from_object, cell.truth.normal.nearest(outward))


def look_from(cell: WorkCell, tilt_deg: float, azimuth: float = 0.3, roll: float = 0.2) -> RigidTransform:
    sphere = VirtualSphere(cell.truth.world_from_object.translation, RADIUS, cell.truth.normal.direction)
    cell.place_camera(sphere.viewpoint(np.radians(tilt_deg), azimuth, roll))
    return cell.truth.world_from_camera


def turn(cell: WorkCell, *about: float) -> None:
    pose = cell.truth.world_from_camera
    cell.place_camera(RigidTransform.from_components(pose.translation, pose.rotation * Rotation.from_rotvec(about)))


@pytest.mark.parametrize("target", ["cuboid_1x4", "cylinder"])
@every_placement
def test_turning_by_the_error_ends_it(target: str, placement: str) -> None:
    cell = cell_of(target, placement)
    for azimuth in (0.0, 1.0, 4.0):
        look_from(cell, 25, azimuth, roll=azimuth)
        error = viewpoint_error(cell.truth)
        assert np.hypot(error.about_x, error.about_y) == pytest.approx(error.total)
        assert (error.total, error.roll) == (cell.truth.viewpoint_error(), cell.truth.roll_error())
        turn(cell, error.about_x, error.about_y, 0)
        assert cell.truth.viewpoint_error() == pytest.approx(0, abs=1e-7)
        turn(cell, 0, 0, cell.truth.roll_error())
        assert cell.truth.roll_error() == pytest.approx(0, abs=1e-7)


def test_a_lying_can_may_be_seen_from_anywhere_across_its_axis() -> None:
    cell = cell_of("cylinder", "side")
    axis = cell.truth.normal.circle_axis
    assert axis is not None
    pose = look_from(cell, 0, 0, 0)
    around = Rotation.from_rotvec(0.5 * axis)
    cell.place_camera(RigidTransform.from_components(pose.translation, around * pose.rotation))
    assert viewpoint_error(cell.truth).total == pytest.approx(0, abs=1e-7)


@pytest.mark.parametrize("target", ["cuboid_1x1", "cuboid_1x2", "cylinder"])
@every_placement
def test_an_aligned_camera_sees_the_corners_clockwise_from_the_top_left(target: str, placement: str) -> None:
    cell = cell_of(target, placement)
    look_from(cell, 0)
    turn(cell, 0, 0, cell.truth.roll_error())
    seen = cell.truth.world_from_camera.inv().apply(corners_in(cell))[:, :2]
    a, b = seen[1] - seen[0], seen[2] - seen[1]
    assert a[0] * b[1] - a[1] * b[0] > 0
    assert np.linalg.norm(b) >= np.linalg.norm(a) - 1e-9, "y along the longer side"
    if cell.truth.normal.major_axis is None:  # any roll is right, so that no corner is the top left
        return
    # Half a turn later it is as well aligned; a square, a quarter.
    shifts = (0, 1, 2, 3) if cell.truth.normal.symmetry < 2 else (0, 2)
    assert any((np.sign(np.roll(seen, k, axis=0)) == SQUARE).all() for k in shifts)


FACE = face_corners(OBJECTS["cuboid_1x4"], HERE, (0, 0, 1))
LYING = np.array([(np.cos(angle), np.sin(angle), 0) for angle in (0.0, 0.7, 2.0)])  # from whichever side


@pytest.mark.parametrize(
    ("target", "directions", "size", "height"),
    [
        ("cuboid_1x2", [(0, 0, 1)], (0.0318, 0.0636), 0.01185),  # the plane of the studs' tops
        ("cylinder", [(0, 0, 1)], (0.060, 0.060), 0.075),  # the square about the top
        ("cylinder", LYING, (0.060, 0.150), 0.0),  # length by diameter, through the middle
    ],
    ids=["brick", "standing can", "lying can"],
)
def test_a_face_has_its_size_and_height(target, directions, size, height) -> None:
    for direction in directions:
        corners = face_corners(OBJECTS[target], HERE, direction)
        sides = np.linalg.norm(corners[1] - corners[0]), np.linalg.norm(corners[2] - corners[1])
        assert sides == pytest.approx(size, abs=1e-3)
        assert corners @ direction == pytest.approx(height, abs=1e-3)
        assert np.delete(corners.mean(0), 2) == pytest.approx((0, 0), abs=1e-9)


@pytest.mark.parametrize(("target", "placement"), [("cuboid_1x2", "tilted"), ("cylinder", "side")])
def test_without_noise_the_homography_tells_the_true_error(target: str, placement: str) -> None:
    cell = cell_of(target, placement)
    for tilt, azimuth in ((0, 0.0), (10, 0.5), (35, 4.0)):
        pose = look_from(cell, tilt, azimuth)
        found, true = homography_error(corners_in(cell), pose, LENS, 0, pixel_sd=0), viewpoint_error(cell.truth)
        assert astuple(found)[:3] == pytest.approx(astuple(true)[:3], abs=1e-5)
        assert np.cos(4 * found.roll) == pytest.approx(np.cos(4 * true.roll), abs=1e-5)


def test_an_object_behind_the_camera_has_no_homography() -> None:
    away = RigidTransform.from_translation([0, 0, 0.3])
    assert np.isnan(astuple(homography_error(FACE, away, LENS, rng=0))).all()


@pytest.mark.parametrize(
    ("misuse", "said"),
    [
        (lambda: homography_error(FACE[[0, 2, 1, 3]], HERE, LENS, 0), "top left, top right, bottom right, bottom left"),
        (lambda: homography_error(FACE[:3], HERE, LENS, 0), r"shape \(4, 3\), m; got"),
        (lambda: homography_error(FACE, HERE, LENS, 0, pixel_sd=-1), "0 or more; got -1"),
        (lambda: homography_floor(FACE, 0, LENS), "radius=0, draws=1000"),
    ],
)
def test_misuse_is_answered_with_what_would_work(misuse, said) -> None:
    with pytest.raises(InvalidParameterError, match=said):
        misuse()


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
    floor = homography_floor(face_corners(OBJECTS[target], HERE, direction), RADIUS, cell_of(target).arm.intrinsics)
    assert np.degrees(floor.mean) == pytest.approx(printed_deg, rel=0.15)
    assert floor.interval.high - floor.interval.low < 0.1 * floor.mean


def test_the_floor_is_in_proportion_to_the_noise_which_the_seed_decides() -> None:
    floors = [homography_floor(FACE, RADIUS, LENS, *noise, draws=400).mean for noise in ((1, 1.0), (1, 1.0), (1, 0.5))]
    assert floors[0] == floors[1] == pytest.approx(2 * floors[2], rel=0.05)


@pytest.mark.parametrize(("sides", "least", "most"), [((1, 1), 11.5, 13.5), ((1, 4), 10, 11.5)])
def test_opencvs_other_decomposition_has_a_floor_that_hardly_depends_on_the_shape(sides, least, most) -> None:
    plane = np.pad(SQUARE * sides * 0.0318 / 2, ((0, 0), (0, 1)))  # (4, 3), m
    lens = cell_of("cuboid_1x1").arm.intrinsics
    seen, rng, tilts = lens.project(plane + (0, 0, RADIUS)), np.random.default_rng(0), []
    for _ in range(500):
        pixels = seen + rng.normal(0, 1, seen.shape)
        _, rotations, *_ = cv2.solvePnPGeneric(plane, pixels, lens.matrix, None, flags=cv2.SOLVEPNP_IPPE)
        tilts.append(np.arccos(np.clip(cv2.Rodrigues(rotations[0])[0][2, 2], -1, 1)))
    assert least < np.degrees(np.mean(tilts)) < most
