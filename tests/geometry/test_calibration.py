from functools import cache

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import CalibrationError, InvalidImageError, InvalidParameterError
from gvp_lib.geometry.calibration import Calibration, calibrate, calibrate_hand_eye
from gvp_lib.geometry.camera import CameraIntrinsics

pytestmark = pytest.mark.check

LENS = CameraIntrinsics(640, 480, 529.0, 533.0, 316.0, 243.0)
DISTORTION = np.array([-0.12, 0.05, 0.001, -0.0008, 0.0])
CORNERS, SQUARE = (8, 5), 0.03  # inner corners; m
BLANK = np.full((480, 640, 3), 200, np.uint8)

# Rotation vector of the board, rad, and where its middle is in the camera frame, m.
VIEWS = [
    ((0.0, 0.0, 0.0), (0.00, 0.00, 0.38)),
    ((0.6, 0.0, 0.0), (0.02, 0.02, 0.38)),
    ((-0.6, 0.0, 0.1), (-0.03, 0.00, 0.38)),
    ((0.0, 0.6, 0.0), (0.03, -0.02, 0.38)),
    ((0.0, -0.6, 0.2), (-0.04, 0.04, 0.40)),
    ((0.4, 0.4, 0.0), (0.06, 0.04, 0.42)),
    ((-0.4, 0.3, 0.3), (-0.06, -0.04, 0.42)),
    ((0.3, -0.5, -0.2), (0.04, -0.04, 0.42)),
]


@cache
def rays() -> np.ndarray:
    """The ray that the lens takes to each pixel, shape (n, 3)."""
    u, v = np.meshgrid(np.arange(640.0), np.arange(480.0))
    pixels = np.stack([u, v], -1).reshape(-1, 2)
    flat = cv2.undistortPoints(pixels, LENS.matrix, DISTORTION).reshape(-1, 2)
    # OpenCV's inverse stops after five steps; two more on its own forward model finish it.
    for _ in range(2):
        at, _ = cv2.projectPoints(np.insert(flat, 2, 1, axis=1), np.zeros(3), np.zeros(3), LENS.matrix, DISTORTION)
        flat = flat - (at.reshape(-1, 2) - pixels) / (LENS.fx, LENS.fy)
    return np.insert(flat, 2, 1, axis=1)


def photograph(rotation: tuple[float, ...], middle: tuple[float, ...]) -> np.ndarray:
    """A picture of the board, ray by ray: no picture is warped, so nothing but the lens moves a corner."""
    r = Rotation.from_rotvec(rotation).as_matrix()
    origin = np.array(middle) - r @ np.append(np.subtract(CORNERS, 1) * SQUARE / 2, 0)
    depth = (r[:, 2] @ origin) / (rays() @ r[:, 2])
    at = ((rays() * depth[:, None] - origin) @ r)[:, :2] / SQUARE  # in squares, from the first inner corner
    # A wave that crosses zero at each edge, steep enough that an edge is about a pixel wide.
    wave = np.clip(40 * np.arcsin(np.sin(np.pi * at)) / np.pi, -1, 1).prod(axis=1)
    inside = (at >= -1).all(1) & (at <= CORNERS).all(1)
    gray = np.where(inside, 125 - 105 * wave, 230).round().astype(np.uint8).reshape(480, 640)
    return np.stack([gray] * 3, -1)


@pytest.fixture(scope="module")
def pictures() -> list[np.ndarray]:
    return [photograph(*view) for view in VIEWS]


@pytest.fixture(scope="module")
def calibration(pictures: list[np.ndarray]) -> Calibration:
    return calibrate([pictures[0], BLANK, *pictures[1:]], CORNERS, SQUARE)


def test_focal_length_comes_back_within_half_a_percent(calibration: Calibration) -> None:
    assert calibration.intrinsics.fx == pytest.approx(LENS.fx, rel=0.005)
    assert calibration.intrinsics.fy == pytest.approx(LENS.fy, rel=0.005)


def test_principal_point_comes_back_within_two_pixels(calibration: Calibration) -> None:
    np.testing.assert_allclose(calibration.intrinsics.principal_point, LENS.principal_point, atol=2)


def test_corners_are_explained_to_a_tenth_of_a_pixel(calibration: Calibration) -> None:
    assert calibration.rms_px < 0.1
    assert (calibration.focal_deviation < 0.01 * LENS.fx).all()


def test_a_picture_without_the_board_is_passed_over(calibration: Calibration) -> None:
    assert calibration.used == (0, 2, 3, 4, 5, 6, 7, 8)


def test_undistorted_pixels_are_those_of_the_pinhole(calibration: Calibration) -> None:
    points = np.array([[x, y, 1.0] for x in (-0.4, 0.0, 0.4) for y in (-0.3, 0.0, 0.3)])
    seen = cv2.projectPoints(points, np.zeros(3), np.zeros(3), LENS.matrix, DISTORTION)[0].reshape(-1, 2)
    bent = np.linalg.norm(seen - LENS.project(points), axis=1).max()
    mended = np.linalg.norm(calibration.undistort_pixels(seen) - LENS.project(points), axis=1).max()
    assert bent > 5
    assert mended < 2


def test_undistorting_straightens_the_edge_of_the_board(calibration: Calibration, pictures: list[np.ndarray]) -> None:
    def bend(picture: np.ndarray) -> float:
        """How far the first row of corners lies from its best line, px."""
        _, at = cv2.findChessboardCornersSB(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), CORNERS)
        row = at.reshape(-1, 2)[: CORNERS[0]].astype(float)
        return float(np.linalg.svd(row - row.mean(0))[1][1])

    straight = calibration.undistort(pictures[0])
    assert straight.dtype == np.uint8
    assert bend(straight) < 0.3 * bend(pictures[0])


def test_too_few_pictures_with_the_board_say_how_many(pictures: list[np.ndarray]) -> None:
    with pytest.raises(CalibrationError, match=r"2 of 3 pictures showed a board of 8 x 5 inner corners; at least 3"):
        calibrate([pictures[0], BLANK, pictures[1]], CORNERS)


def test_no_pictures_at_all_is_said_too() -> None:
    with pytest.raises(CalibrationError, match="0 of 0 pictures"):
        calibrate([], CORNERS)


def test_pictures_all_from_straight_ahead_do_not_determine_the_lens() -> None:
    ahead = [photograph((0, 0, 0), (x, 0, z)) for x, z in ((0.0, 0.38), (0.02, 0.4), (-0.02, 0.42))]
    with pytest.raises(CalibrationError, match="tilted by 30 degrees"):
        calibrate(ahead, CORNERS)


def test_pictures_must_be_color_and_of_one_size(pictures: list[np.ndarray]) -> None:
    with pytest.raises(InvalidImageError, match=r"number 2 has shape \(240, 320, 3\), those before \(480, 640, 3\)"):
        calibrate([pictures[0], BLANK[::2, ::2]], CORNERS)
    with pytest.raises(InvalidImageError, match=r"number 1 is float64 \(480, 640, 3\)"):
        calibrate([pictures[0] / 255], CORNERS)


def test_a_board_of_squares_counted_as_none_is_refused() -> None:
    with pytest.raises(InvalidParameterError, match="inner corners"):
        calibrate([BLANK], (8, 2))


def test_undistorting_a_picture_of_another_size_is_refused(calibration: Calibration) -> None:
    with pytest.raises(InvalidImageError, match=r"\(480, 640, 3\); got \(10, 10, 3\)"):
        calibration.undistort(np.zeros((10, 10, 3), np.uint8))


# The camera in the hand


CAMERA = RigidTransform.from_components([0.03, -0.05, 0.08], Rotation.from_euler("xyz", [10, -20, 80], degrees=True))
BOARD = RigidTransform.from_components([0.5, 0.1, 0.0], Rotation.from_euler("x", 180, degrees=True))


def hands(turns: Rotation) -> RigidTransform:
    places = np.random.default_rng(0).normal(0, 0.1, (len(turns), 3)) + (0.4, 0, 0.4)
    return RigidTransform.from_components(places, turns)


def boards(base_from_hand: RigidTransform) -> RigidTransform:
    return (base_from_hand * CAMERA).inv() * BOARD


def tilted(n: int, seed: int = 1) -> Rotation:
    return Rotation.from_rotvec(np.random.default_rng(seed).normal(0, 0.4, (n, 3)))


@pytest.mark.parametrize("n", [3, 12])
def test_exact_poses_give_the_camera_and_the_board_back(n):
    seen = hands(tilted(n))
    found = calibrate_hand_eye(seen, boards(seen))
    for got, truth in ((found.hand_from_camera, CAMERA), (found.base_from_board, BOARD)):
        np.testing.assert_allclose(got.as_matrix(), truth.as_matrix(), atol=1e-8)
    assert found.shift_rms < 1e-8


def test_noise_of_the_board_shows_in_the_rest_and_hardly_in_the_camera():
    seen, rng = hands(tilted(15)), np.random.default_rng(2)
    noise = RigidTransform.from_components(
        rng.normal(0, 1e-3, (15, 3)), Rotation.from_rotvec(rng.normal(0, 2e-3, (15, 3)))
    )
    found = calibrate_hand_eye(seen, boards(seen) * noise)
    off = CAMERA.inv() * found.hand_from_camera
    assert np.linalg.norm(off.translation) < 2e-3
    assert off.rotation.magnitude() < np.radians(0.3)
    assert 0.5e-3 < found.shift_rms < 3e-3
    assert 1e-3 < found.turn_rms < 6e-3


def test_a_hand_that_only_rolls_is_refused_with_what_would_work():
    seen = hands(Rotation.from_rotvec(np.linspace(0, 2, 10)[:, None] * (0, 0, 1)))
    with pytest.raises(CalibrationError, match=r"about one axis only.*Tilt it by 20 degrees"):
        calibrate_hand_eye(seen, boards(seen))


def test_two_poses_or_counts_that_differ_are_refused():
    seen = hands(tilted(4))
    with pytest.raises(CalibrationError, match="3 pairs of poses are the least"):
        calibrate_hand_eye(seen[:2], boards(seen)[:2])
    with pytest.raises(InvalidParameterError, match=r"got 4 and 3\. RigidTransform.concatenate"):
        calibrate_hand_eye(seen, boards(seen)[:3])
