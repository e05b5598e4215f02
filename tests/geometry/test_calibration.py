import re
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
    pixels = np.stack(np.meshgrid(np.arange(640.0), np.arange(480.0)), -1).reshape(-1, 2)
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


def test_the_lens_comes_back_and_explains_the_corners_of_every_picture_with_a_board(calibration: Calibration) -> None:
    found = calibration.intrinsics
    np.testing.assert_allclose((found.fx, found.fy), (LENS.fx, LENS.fy), rtol=0.005)
    np.testing.assert_allclose(found.principal_point, LENS.principal_point, atol=2)
    assert calibration.rms_px < 0.1
    assert (calibration.focal_deviation < 0.01 * LENS.fx).all()
    assert calibration.used == (0, 2, 3, 4, 5, 6, 7, 8)
    assert re.fullmatch(
        r"Calibration\(640 x 480 px, fx 5\d\d\.\d \(sd .*, rms 0\.0\d+ px, 8 pictures\)", repr(calibration)
    )


def test_undistorted_pixels_and_pictures_are_those_of_the_pinhole(calibration: Calibration, pictures: list) -> None:
    points = np.array([[x, y, 1.0] for x in (-0.4, 0.0, 0.4) for y in (-0.3, 0.0, 0.3)])
    seen = cv2.projectPoints(points, np.zeros(3), np.zeros(3), LENS.matrix, DISTORTION)[0].reshape(-1, 2)
    assert np.linalg.norm(seen - LENS.project(points), axis=1).max() > 5
    assert np.linalg.norm(calibration.undistort_pixels(seen) - LENS.project(points), axis=1).max() < 2
    bent, straight = (
        cv2.findChessboardCornersSB(picture[..., 0], CORNERS)[1].reshape(-1, 2)
        for picture in (pictures[0], calibration.undistort(pictures[0]))
    )
    np.testing.assert_allclose(straight, calibration.undistort_pixels(bent), atol=0.1)


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (lambda p, _: calibrate([p[0], BLANK, p[1]], CORNERS), CalibrationError, "2 of 3 pictures .* at least 3"),
        (lambda p, _: calibrate([], CORNERS), CalibrationError, "0 of 0 pictures showed a board of 8 x 5 inner"),
        (
            lambda p, _: calibrate([photograph((0, 0, 0), (x, 0, 0.4 + x)) for x in (0.0, 0.02, -0.02)], CORNERS),
            CalibrationError,
            "tilted by 30 degrees",
        ),
        (
            lambda p, _: calibrate([p[0], BLANK[::2, ::2]], CORNERS),
            InvalidImageError,
            r"number 2 is uint8 \(240, 320, 3\), those before \(480, 640, 3\)",
        ),
        (lambda p, _: calibrate([p[0] / 255], CORNERS), InvalidImageError, r"number 1 is float64 \(480, 640, 3\)$"),
        (lambda p, _: calibrate(["a.png"], CORNERS), InvalidImageError, "number 1 is str"),
        (lambda p, _: calibrate([BLANK], (8, 2)), InvalidParameterError, "inner corners"),
        (lambda p, lens: lens.undistort(BLANK[:10, :10]), InvalidImageError, r"\(480, 640, 3\); got \(10, 10, 3\)"),
    ],
)
def test_pictures_that_determine_no_lens_are_refused(call, error, text: str, pictures, calibration) -> None:
    with pytest.raises(error, match=text):
        call(pictures, calibration)


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


def test_three_exact_poses_give_the_camera_and_the_board_back() -> None:
    seen = hands(tilted(3))
    found = calibrate_hand_eye(seen, boards(seen))
    for got, truth in ((found.hand_from_camera, CAMERA), (found.base_from_board, BOARD)):
        np.testing.assert_allclose(got.as_matrix(), truth.as_matrix(), atol=1e-8)
    assert found.shift_rms < 1e-8
    assert repr(found).startswith("HandEye(camera at (30.0, -50.0, 80.0) mm in the hand, rotated by ")


def test_noise_of_the_board_shows_in_the_rest_and_hardly_in_the_camera() -> None:
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


ROLLED = Rotation.from_rotvec(np.linspace(0, 2, 10)[:, None] * (0, 0, 1))


@pytest.mark.parametrize(
    ("turns", "seen", "shown", "error", "text"),
    [
        (ROLLED, 10, 10, CalibrationError, r"about one axis only.*Tilt it by 20 degrees"),
        (tilted(4), 2, 2, CalibrationError, "3 pairs of poses are the least"),
        (tilted(4), 4, 3, InvalidParameterError, r"got 4 and 3\. RigidTransform.concatenate"),
    ],
)
def test_poses_that_determine_no_camera_are_refused_with_what_would_work(turns, seen, shown, error, text: str) -> None:
    poses = hands(turns)
    with pytest.raises(error, match=text):
        calibrate_hand_eye(poses[:seen], boards(poses)[:shown])
