import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import CalibrationError, InvalidParameterError
from gvp_lib.geometry.hand_eye import calibrate_hand_eye

pytestmark = pytest.mark.check

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
