import cv2
import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_book.measured import circles
from gvp_lib.errors import CalibrationError, InvalidImageError, InvalidParameterError
from gvp_lib.geometry.board import Chessboard, CircleGrid
from gvp_lib.geometry.calibration import Calibration, board_pose, calibrate, calibrate_hand_eye
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


def test_the_same_pictures_give_the_same_lens_to_the_last_bit(pictures: list) -> None:
    threads = cv2.getNumThreads()
    cv2.setNumThreads(4)  # which add in the order in which they finish
    try:
        answers = [calibrate(pictures, CORNERS) for _ in range(15)]
        assert cv2.getNumThreads() == 4
    finally:
        cv2.setNumThreads(threads)
    found = [(c.intrinsics.matrix.tobytes(), c.distortion.tobytes(), c.focal_deviation.tobytes()) for c in answers]
    assert len(set(found)) == 1


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


FINE = CameraIntrinsics(2560, 1920, 4 * LENS.fx, 4 * LENS.fy, 4 * LENS.cx + 1.5, 4 * LENS.cy + 1.5)  # for the same lens
BOARDS = {
    "chessboard": Chessboard((8, 5), 0.03),
    "circles": CircleGrid((8, 5), 0.03),
    "staggered circles": CircleGrid((4, 9), 0.02, staggered=True),
    "charuco": cv2.aruco.CharucoBoard((9, 6), 0.03, 0.022, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)),
}
PIXEL = 0.0005  # m of a print


def printed(board) -> np.ndarray:
    """The board on paper, with its middle in the paper's."""
    if isinstance(board, Chessboard):
        n, square = board.corners, round(board.square / PIXEL)
        # White in the corner that OpenCV counts from, where the other end's is black.
        checks = 255 * (1 - np.indices((n[1] + 1, n[0] + 1)).sum(axis=0) % 2).astype(np.uint8)
        return np.pad(np.kron(checks, np.ones((square, square), np.uint8)), square, constant_values=255)
    if isinstance(board, CircleGrid):
        at = np.round(board._points() / PIXEL).astype(int) + 60
        paper = np.full(at.max(axis=0)[::-1] + 61, 255, np.uint8)
        for u, v in at.tolist():
            cv2.circle(paper, (u, v), round(0.3 * 0.03 / PIXEL), 0, -1, cv2.LINE_AA)
        return paper
    (w, h), square = board.getChessboardSize(), board.getSquareLength() / PIXEL
    return board.generateImage((round(w * square) + 60, round(h * square) + 60), None, 30)


def snap(paper: np.ndarray, camera_from_board: RigidTransform, rng: np.random.Generator) -> np.ndarray:
    """Picture through the lens: each pixel the mean of sixteen, blurred, with noise."""
    pose, middle = camera_from_board.as_matrix(), (np.array(paper.shape[::-1]) - 1) / 2
    to_board = np.array([[PIXEL, 0, -PIXEL * middle[0]], [0, PIXEL, -PIXEL * middle[1]], [0, 0, 1]])
    homography = FINE.matrix @ pose[:3, [0, 1, 3]] @ to_board
    flat = distorted(cv2.warpPerspective(paper, homography, (FINE.width, FINE.height), borderValue=150), FINE, K1)
    gray = cv2.GaussianBlur(cv2.resize(flat, (640, 480), interpolation=cv2.INTER_AREA) * 0.8 + 20, (0, 0), 0.7)
    return np.clip(np.rint(gray + rng.normal(0, 2, gray.shape)), 0, 255).astype(np.uint8)


def scattered(paper: np.ndarray, distance: float, rng: np.random.Generator, cut: float = 0.0) -> RigidTransform:
    """Board tilted by 25 to 50 degrees somewhere in the picture, with this share of its corners perhaps out of it."""
    half = PIXEL * np.array(paper.shape[::-1]) / 2
    outer = np.array([(x, y, 0) for x in (-half[0], half[0]) for y in (-half[1], half[1])]) * (1 - cut)
    size = np.array([LENS.width, LENS.height])
    while True:  # hundreds of times for a board that fills the picture, so by bare arrays
        azimuth, tilt, roll = rng.uniform(-np.pi, np.pi), np.radians(rng.uniform(25, 50)), rng.uniform(-0.3, 0.3)
        leaning = cv2.Rodrigues(tilt * np.array([np.cos(azimuth), np.sin(azimuth), 0]))[0]
        turn = leaning @ cv2.Rodrigues(np.array([0, 0, roll]))[0]
        middle = distance * np.append((rng.uniform(0, size) - LENS.principal_point) / (LENS.fx, LENS.fy), 1)
        rays = (outer @ turn.T + middle) @ LENS.matrix.T
        seen = rays[:, :2] / rays[:, 2:]
        if (seen > 3).all() and (seen < size - 4).all():
            return RigidTransform.from_components(middle, Rotation.from_matrix(turn))


def off(square: int, corners: tuple[int, int], seed: int) -> tuple[float, float]:
    """Error of the focal length in percent, and in stated deviations, with squares of so many pixels."""
    rng, board = np.random.default_rng(seed), Chessboard(corners, 0.03)
    paper, distance = printed(board), 0.03 * LENS.fx / square
    found = calibrate((snap(paper, scattered(paper, distance, rng), rng) for _ in range(20)), board)
    errors = np.array([found.intrinsics.fx - LENS.fx, found.intrinsics.fy - LENS.fy])
    return 100 * abs(errors / (LENS.fx, LENS.fy)).max(), abs(errors / found.focal_deviation).max()


SQUARES = {14: (9, 6), 23: (9, 6), 43: (9, 6), 60: (6, 3)}  # of so many pixels; corners that fit into a picture


@pytest.mark.parametrize("square", [14, pytest.param(43, marks=pytest.mark.full)])
def test_a_focal_length_is_right_and_so_is_its_deviation_however_small_the_squares(square: int) -> None:
    percent, deviations = off(square, SQUARES[square], seed=0)
    assert percent < 0.25
    assert deviations < 3


@pytest.mark.full
@pytest.mark.parametrize("square", SQUARES)
def test_a_focal_length_is_right_and_so_is_its_deviation_in_nine_of_ten_draws(square: int) -> None:
    draws = np.array([off(square, SQUARES[square], seed) for seed in range(10)])
    print(f"{square} px: {draws[:, 0].max():.3f} % and {draws[:, 1].max():.1f} deviations at most")
    assert ((draws < (0.25, 3)).all(axis=1)).sum() >= 9


def test_a_grid_of_corners_that_no_plane_shows_is_none() -> None:
    rng, board = np.random.default_rng(0), Chessboard((6, 3), 0.03)
    paper = printed(board)
    views = [(pose := scattered(paper, 0.03 * LENS.fx / 60, rng), snap(paper, pose, rng)) for _ in range(3)]
    assert (cv2.findChessboardCornersSB(views[2][1], (6, 3))[1][0] > 600).any()  # far from the board
    found = [board_pose(picture, board, LENS) for _, picture in views]
    assert found[2] is None
    for (pose, _), seen in zip(views[:2], found, strict=False):
        assert np.linalg.norm(seen.translation - pose.translation) < 0.005


@pytest.mark.parametrize(("name", "cut"), [(name, 0.0) for name in BOARDS] + [("charuco", 0.4)])
def test_each_kind_of_board_gives_the_lens_and_its_own_pose_in_a_picture_as_it_comes(name: str, cut: float) -> None:
    board, rng = BOARDS[name], np.random.default_rng(1)
    paper = printed(board)
    poses = [scattered(paper, 0.45, rng, cut) for _ in range(12)]
    pictures = [snap(paper, pose, rng) for pose in poses]
    lens = calibrate(pictures, board)
    assert len(lens.used) >= 9
    assert abs(lens.intrinsics.fx / LENS.fx - 1) < 0.0025
    for k in lens.used:
        error = poses[k].inv() * board_pose(pictures[k], board, lens)
        if name == "circles":  # which can be counted from either end
            error *= RigidTransform.from_rotation(Rotation.from_rotvec([0, 0, np.pi * (error.as_matrix()[0, 0] < 0)]))
        assert np.linalg.norm(error.translation) < 0.002
        assert error.rotation.magnitude() < np.radians(0.3)
    assert board_pose(BLANK, board, lens) is None


@pytest.mark.parametrize("name", BOARDS)
@pytest.mark.parametrize("shape", [(1, 1), (5, 5), (1, 640), (640, 3), (48, 64)])
def test_a_picture_too_small_for_a_board_shows_none(name: str, shape: tuple[int, int]) -> None:
    picture, lens = np.zeros(shape, np.uint8), CameraIntrinsics(*shape[::-1], 530, 530, 0, 0)
    assert board_pose(picture, BOARDS[name], lens) is None


def test_a_file_is_read_as_the_sensor_took_it_and_a_picture_turned_by_its_tag_is_named(tmp_path, pictures) -> None:
    files = []
    for k, picture in enumerate(pictures):
        tag = Image.Exif()
        tag[0x0112] = (1, 3, 6)[k % 3]  # orientation: as taken, upside down, a quarter turn
        files.append(tmp_path / f"{k}.png")
        Image.fromarray(picture).save(files[-1], exif=tag)
    assert (cv2.imread(str(files[1]))[..., ::-1] == pictures[1][::-1, ::-1]).all()  # what happens otherwise
    unturned = calibrate(pictures, CORNERS)
    for found in (calibrate(files, CORNERS), calibrate(map(str, files), corners=CORNERS)):
        assert found.intrinsics.fx == pytest.approx(unturned.intrinsics.fx, rel=1e-6)
    with pytest.raises(InvalidImageError, match=r"number 3 is \(640, 480\).*EXIF.*cv2\.IMREAD_IGNORE_ORIENTATION"):
        calibrate([cv2.imread(str(file)) for file in files], CORNERS)


def through_a_fisheye(degrees: float, rng: np.random.Generator) -> np.ndarray:
    """The board about the middle of a picture that spans so many degrees from corner to corner, in even steps."""
    f, paper = 400 / np.radians(degrees / 2), printed(BOARDS["chessboard"])
    v, u = (np.indices((960, 1280)) + 0.5) / 2 - 0.5
    x, y = (u - 319.5) / f, (v - 239.5) / f
    angle = np.hypot(x, y)
    rays = np.stack([np.sinc(angle / np.pi) * x, np.sinc(angle / np.pi) * y, np.cos(angle)], axis=-1)
    turn = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3))
    aim = Rotation.from_rotvec([*rng.uniform(-0.2, 0.2, 2), 0])
    middle, normal = aim.apply([0, 0, 0.03 * f / 25]), (aim * turn).apply([0, 0, 1])
    depth = (middle @ normal) / (rays @ normal)
    board = (depth[..., None] * rays - middle) @ (aim * turn).as_matrix()[:, :2] / PIXEL
    at = np.where((depth > 0)[..., None], board + (np.array(paper.shape[::-1]) - 1) / 2, -9).astype(np.float32)
    picture = cv2.remap(paper, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=150)
    return cv2.resize(picture, (640, 480), interpolation=cv2.INTER_AREA)


@pytest.mark.parametrize("degrees", [180, *(pytest.param(d, marks=pytest.mark.full) for d in (120, 150))])
def test_a_fisheye_whose_edges_no_board_covered_is_refused_by_name(degrees: float) -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(CalibrationError, match=r"covered \d\d % of the image.* at the image's edges.* a fisheye"):
        calibrate((through_a_fisheye(degrees, rng) for _ in range(8)), CORNERS)


PARALLEL = [photograph(around(radius).viewpoint(0, 0)) for radius in (12, 14, 16)]
ANOTHER_SIZE = r"number 2 is \(240, 640\), those before \(480, 640\)$"
A_LENS = "lens is a Calibration or a CameraIntrinsics; got a NoneType"


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (lambda p, _: calibrate([p[0], BLANK, p[1]], CORNERS), CalibrationError, "2 of 3 pictures .* at least 3"),
        (lambda p, _: calibrate([], CORNERS), CalibrationError, "0 of 0 pictures showed a board of 8 x 5 inner"),
        (lambda p, _: calibrate(PARALLEL, CORNERS), CalibrationError, "tilted by 30 degrees"),
        (lambda p, _: calibrate([p[0], BLANK[::2]], CORNERS), InvalidImageError, ANOTHER_SIZE),
        (lambda p, _: calibrate([p[0] / 255], CORNERS), InvalidImageError, r"number 1 is float64 \(480, 640, 3\)$"),
        (lambda p, _: calibrate(["a.png"], CORNERS), InvalidImageError, "number 1 is 'a.png', which is no file"),
        (lambda p, _: calibrate("a.png", CORNERS), InvalidImageError, "several, or their files, in a list; got str"),
        (lambda p, _: calibrate(None, CORNERS), InvalidImageError, "in a list; got NoneType"),
        (lambda p, _: calibrate(p[0], CORNERS), InvalidImageError, "in a list; got ndarray"),
        (lambda p, _: calibrate([None], CORNERS), InvalidImageError, "number 1 is NoneType"),
        (lambda p, _: calibrate([BLANK], (8, 2)), InvalidParameterError, "inner corners"),
        (lambda p, _: calibrate([BLANK], (10**30, 5)), InvalidParameterError, r"\(3, 3\) to \(100, 100\)"),
        (lambda p, _: calibrate([BLANK], (8.5, 5)), InvalidParameterError, r"inner corners .*got \(8\.5, 5\)"),
        (lambda p, _: calibrate([BLANK], CORNERS, np.inf), InvalidParameterError, "positive, in meters.* inf"),
        (lambda p, _: calibrate([BLANK], CORNERS, "1"), InvalidParameterError, "positive, in meters.* '1'"),
        (lambda p, _: calibrate([BLANK]), InvalidParameterError, r"a board is \(9, 6\).*CharucoBoard; got NoneType"),
        (lambda p, lens: board_pose(p[0], CORNERS, lens), InvalidParameterError, r"Chessboard\(\(8, 5\), square="),
        (lambda p, lens: board_pose(p[0], Chessboard(CORNERS), None), InvalidParameterError, A_LENS),
        (lambda p, lens: board_pose(BLANK[::2], Chessboard(CORNERS), lens), InvalidImageError, r"got \(240, 640\)"),
        (lambda p, lens: lens.undistort(BLANK.astype(int)), InvalidImageError, "takes uint8 pictures .* of int64"),
        (lambda p, lens: lens.undistort_pixels(np.zeros((4, 3))), InvalidParameterError, r"\(4, 3\)"),
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


def upside_down(camera_from_board: RigidTransform, *turned: int) -> list[RigidTransform]:
    half_turn = RigidTransform.from_rotation(Rotation.from_rotvec([0, 0, np.pi]))
    return [pose * half_turn if k in turned else pose for k, pose in enumerate(camera_from_board)]


@pytest.mark.parametrize("turned", [(4,), (0, 3, 7), (1, 2, 5, 8, 11)])
def test_boards_counted_from_the_other_end_are_named_and_change_nothing(turned: tuple[int, ...]) -> None:
    (hands, boards), rng = poses(tilted(12)), np.random.default_rng(2)
    boards *= RigidTransform.from_components(
        rng.normal(0, 1e-3, (12, 3)), Rotation.from_rotvec(rng.normal(0, 2e-3, (12, 3)))
    )
    rest = [k for k in range(12) if k not in turned]
    found = calibrate_hand_eye(hands, upside_down(boards, *turned))
    without = calibrate_hand_eye(hands[rest], boards[rest])
    assert found.outliers == turned
    assert (found.turns[list(turned)] > 3).all()
    assert (found.turns[rest] < 0.02).all()
    assert (found.shift_rms, found.turn_rms) == (without.shift_rms, without.turn_rms)
    np.testing.assert_array_equal(found.hand_from_camera.as_matrix(), without.hand_from_camera.as_matrix())
    assert f"left out: {turned[0]} (" in repr(found)


@pytest.mark.parametrize("seed", range(20))
def test_ordinary_noise_leaves_no_picture_out(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 30))
    hands, boards = poses(Rotation.from_rotvec(rng.normal(0, 0.4, (n, 3))))
    turns = Rotation.from_rotvec(rng.normal(0, 0.01, (n, 3)))
    noise = RigidTransform.from_components(rng.normal(0, 5e-3, (n, 3)), turns)
    assert calibrate_hand_eye(hands * noise, boards).outliers == ()


@pytest.fixture(scope="module")
def real() -> tuple[RigidTransform, RigidTransform]:
    """A real arm's poses, and those of a grid of circles, from its middle, in its camera's pictures."""
    hands, grid, centers, lens = circles()
    seen = [cv2.solvePnP(grid, each, lens.matrix, None)[1:] for each in centers]
    boards = [RigidTransform.from_components(t.ravel(), Rotation.from_rotvec(r.ravel())) for r, t in seen]
    return hands, RigidTransform.concatenate(boards)


def test_a_real_arm_leaves_six_millimeters_and_a_flipped_board_is_named(real) -> None:
    hands, boards = real
    found = calibrate_hand_eye(hands, boards)
    assert found.outliers == ()
    assert found.shift_rms < 6.5e-3
    assert found.shift_rms == pytest.approx(np.sqrt((found.shifts**2).mean()))
    for k in (0, 2, 13):  # an ordinary one, and the two that agree least
        rest = np.arange(15) != k
        flipped = calibrate_hand_eye(hands, upside_down(boards, k))
        without = calibrate_hand_eye(hands[rest], boards[rest])
        assert flipped.outliers == (k,)
        assert flipped.shift_rms == without.shift_rms


def test_both_poses_inverted_leave_nothing_and_give_the_board_as_the_text_says() -> None:
    hands, boards = poses(tilted(12))
    found = calibrate_hand_eye(hands.inv(), boards.inv())
    assert found.shift_rms < 1e-8
    np.testing.assert_allclose(found.hand_from_camera.as_matrix(), BASE_FROM_BOARD.as_matrix(), atol=1e-8)
    assert calibrate_hand_eye(hands.inv(), boards).shift_rms > 0.05


FORMS = {
    "list": list,
    "list of matrices": lambda t: list(t.as_matrix()),
    "nested lists": lambda t: t.as_matrix().tolist(),
    "array": lambda t: t.as_matrix(),
    "OpenCV's": lambda t: (t.rotation.as_matrix(), t.translation[..., None]),
    "OpenCV's lists": lambda t: ([*t.rotation.as_rotvec()[..., None]], [*t.translation[..., None]]),
    "pairs": lambda t: [(pose.rotation.as_matrix(), pose.translation) for pose in t],
    "generator": lambda t: (pose for pose in t),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("n", [3, 4, 9])
def test_poses_may_come_in_any_form_that_means_one_thing(form: str, n: int) -> None:
    hands, boards = poses(tilted(n))
    expected = calibrate_hand_eye(hands, boards).hand_from_camera.as_matrix()
    found = calibrate_hand_eye(FORMS[form](hands), FORMS[form](boards)).hand_from_camera.as_matrix()
    np.testing.assert_allclose(found, expected, atol=1e-8)


POSES = poses(tilted(4))[0].as_matrix()


@pytest.mark.parametrize(
    "given",
    [
        None, 7, "poses", [], [None] * 4, {"a": 1}, POSES[0], list(POSES[0]), RigidTransform.identity(), POSES[:, :3],
        2 * POSES, POSES * np.diag([1, 1, -1, 1]), POSES * np.nan, POSES + 0j, POSES.swapaxes(1, 2), 1e300 * POSES,
        (Rotation.identity(4).as_quat(), np.zeros((4, 3))), (POSES[:, :3, :3], np.zeros((3, 3))),
        RigidTransform.from_translation(np.full((4, 3), np.nan)), [RigidTransform.identity(), POSES[0], None],
    ],
    ids=lambda given: type(given).__name__,
)  # fmt: skip
def test_what_is_no_poses_is_refused_with_the_forms_that_are(given) -> None:
    with pytest.raises(InvalidParameterError, match=r"base_from_hand takes several poses: .*all finite"):
        calibrate_hand_eye(given, RigidTransform.from_matrix(POSES))


ROLLED = Rotation.from_rotvec(np.linspace(0, 2, 10)[:, None] * (0, 0, 1))


@pytest.mark.parametrize(
    ("turns", "seen", "shown", "error", "text"),
    [
        (ROLLED, 10, 10, CalibrationError, r"about one axis only.*Tilt it by 20 degrees"),
        (tilted(4), 2, 2, CalibrationError, "3 pairs of poses are the least"),
        (tilted(4), 4, 3, InvalidParameterError, "as many poses .* got 4 and 3"),
    ],
)
def test_poses_that_determine_no_camera_are_refused_with_what_would_work(turns, seen, shown, error, text: str) -> None:
    hands, boards = poses(turns)
    with pytest.raises(error, match=text):
        calibrate_hand_eye(hands[:seen], boards[:shown])
