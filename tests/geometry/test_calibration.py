import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import CalibrationError, InvalidImageError, InvalidParameterError
from gvp_lib.geometry.calibration import Calibration, calibrate, calibrate_hand_eye
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.simulation.camera import distorted

pytestmark = pytest.mark.check

LENS, K1 = CameraIntrinsics(640, 480, 529.0, 533.0, 316.0, 243.0), -0.12
CORNERS, SQUARE = (8, 5), 40  # inner corners; px of a drawing of the board, whose middle is at (199.5, 139.5)
CHECKS = 255 * (np.indices((6, 9)).sum(axis=0) % 2).astype(np.uint8)
BOARD = np.pad(np.kron(CHECKS, np.ones((SQUARE, SQUARE), np.uint8)), SQUARE, constant_values=255)
BLANK = np.full((480, 640, 3), 200, np.uint8)


def photograph(board_from_camera: RigidTransform) -> np.ndarray:
    """A picture of the board, taken through the lens."""
    homography = LENS.matrix @ np.delete(board_from_camera.inv().as_matrix()[:3], 2, axis=1)
    gray = cv2.warpPerspective(BOARD, homography, (640, 480), borderValue=255)
    return distorted(np.stack([gray] * 3, -1), LENS, K1)


def around(radius: float) -> VirtualSphere:
    return VirtualSphere((199.5, 139.5, 0), radius * SQUARE, pole=(0, 0, -1))


@pytest.fixture(scope="module")
def pictures() -> list[np.ndarray]:
    return [photograph(view) for view in around(14).uniform(8, np.radians(35))]


@pytest.fixture(scope="module")
def calibration(pictures: list[np.ndarray]) -> Calibration:
    return calibrate([pictures[0], BLANK, *pictures[1:]], CORNERS)


def test_the_lens_comes_back_and_explains_the_corners_of_every_picture_with_a_board(calibration: Calibration) -> None:
    found = calibration.intrinsics
    np.testing.assert_allclose((found.fx, found.fy), (LENS.fx, LENS.fy), rtol=0.005)
    np.testing.assert_allclose(found.principal_point, LENS.principal_point, atol=2)
    assert calibration.rms_px < 0.1
    assert (calibration.focal_deviation < 0.01 * LENS.fx).all()
    assert calibration.used == (0, 2, 3, 4, 5, 6, 7, 8)


def test_undistorted_pixels_and_pictures_are_those_of_the_pinhole(calibration: Calibration, pictures: list) -> None:
    points = np.array([[x, y, 1.0] for x in (-0.4, 0.0, 0.4) for y in (-0.3, 0.0, 0.3)])
    seen = cv2.projectPoints(points, np.zeros(3), np.zeros(3), LENS.matrix, np.r_[K1, 0, 0, 0])[0].reshape(-1, 2)
    assert np.linalg.norm(seen - LENS.project(points), axis=1).max() > 5
    assert np.linalg.norm(calibration.undistort_pixels(seen) - LENS.project(points), axis=1).max() < 2
    bent, straight = (
        cv2.findChessboardCornersSB(picture[..., 0], CORNERS)[1].reshape(-1, 2)
        for picture in (pictures[0], calibration.undistort(pictures[0]))
    )
    np.testing.assert_allclose(straight, calibration.undistort_pixels(bent), atol=0.1)


PARALLEL = [photograph(around(radius).viewpoint(0, 0)) for radius in (12, 14, 16)]
ANOTHER_SIZE = r"number 2 is uint8 \(240, 640, 3\), those before \(480, 640, 3\)"


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (lambda p, _: calibrate([p[0], BLANK, p[1]], CORNERS), CalibrationError, "2 of 3 pictures .* at least 3"),
        (lambda p, _: calibrate([], CORNERS), CalibrationError, "0 of 0 pictures showed a board of 8 x 5 inner"),
        (lambda p, _: calibrate(PARALLEL, CORNERS), CalibrationError, "tilted by 30 degrees"),
        (lambda p, _: calibrate([p[0], BLANK[::2]], CORNERS), InvalidImageError, ANOTHER_SIZE),
        (lambda p, _: calibrate([p[0] / 255], CORNERS), InvalidImageError, r"number 1 is float64 \(480, 640, 3\)$"),
        (lambda p, _: calibrate(["a.png"], CORNERS), InvalidImageError, "number 1 is str"),
        (lambda p, _: calibrate([BLANK], (8, 2)), InvalidParameterError, "inner corners"),
        (lambda p, lens: lens.undistort(BLANK[:10, :10]), InvalidImageError, r"\(480, 640, 3\); got \(10, 10, 3\)"),
    ],
)
def test_pictures_that_determine_no_lens_are_refused(call, error, text: str, pictures, calibration) -> None:
    with pytest.raises(error, match=text):
        call(pictures, calibration)


CAMERA = RigidTransform.from_components([0.03, -0.05, 0.08], Rotation.from_euler("xyz", [10, -20, 80], degrees=True))
BASE_FROM_BOARD = RigidTransform.from_components([0.5, 0.1, 0.0], Rotation.from_euler("x", 180, degrees=True))


def poses(turns: Rotation) -> tuple[RigidTransform, RigidTransform]:
    """The hand's with these turns, and the board's as the camera then sees it."""
    places = np.random.default_rng(0).normal(0, 0.1, (len(turns), 3)) + (0.4, 0, 0.4)
    base_from_hand = RigidTransform.from_components(places, turns)
    return base_from_hand, (base_from_hand * CAMERA).inv() * BASE_FROM_BOARD


def tilted(n: int) -> Rotation:
    return Rotation.from_rotvec(np.random.default_rng(1).normal(0, 0.4, (n, 3)))


def test_three_exact_poses_give_the_camera_and_the_board_back() -> None:
    found = calibrate_hand_eye(*poses(tilted(3)))
    for got, truth in ((found.hand_from_camera, CAMERA), (found.base_from_board, BASE_FROM_BOARD)):
        np.testing.assert_allclose(got.as_matrix(), truth.as_matrix(), atol=1e-8)
    assert found.shift_rms < 1e-8


def test_noise_of_the_board_shows_in_the_rest_and_hardly_in_the_camera() -> None:
    (hands, boards), rng = poses(tilted(15)), np.random.default_rng(2)
    shifts, turns = rng.normal(0, 1e-3, (15, 3)), Rotation.from_rotvec(rng.normal(0, 2e-3, (15, 3)))
    found = calibrate_hand_eye(hands, boards * RigidTransform.from_components(shifts, turns))
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
    hands, boards = poses(turns)
    with pytest.raises(error, match=text):
        calibrate_hand_eye(hands[:seen], boards[:shown])
