"""What an arm saw, written and read: folders of several kinds, bags of ROS 1 and 2, and what is none."""

from __future__ import annotations

import csv
import json
from typing import Any

import numpy as np
import pytest
from bags import bag_of
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib import ContourFit, WorkCell
from gvp_lib.errors import InvalidImageError, InvalidParameterError
from gvp_lib.geometry import CameraIntrinsics, VirtualSphere
from gvp_lib.perception import Whole
from gvp_lib.photographs import RecordedArm

HAND_FROM_CAMERA = RigidTransform.from_components(
    [0.02, -0.05, 0.07], Rotation.from_euler("xyz", [10, 20, 90], degrees=True)
)
N = 7


@pytest.fixture(scope="module")
def cell():
    with WorkCell(arm="floating", target="cuboid_1x2", seed=1) as cell:
        yield cell


@pytest.fixture(scope="module")
def recording(cell) -> RecordedArm:
    """Seven pictures from around a brick, as an arm would report the poses of its hand."""
    sphere = VirtualSphere(cell.truth.world_from_object.translation, 0.3)
    cameras = [sphere.viewpoint(0.15 + 0.1 * k, 2.4 * k) for k in range(N)]
    pictures = []
    for camera in cameras:
        cell.place_camera(camera)
        pictures.append(cell.arm.capture())
    hands = RigidTransform.concatenate(cameras) * HAND_FROM_CAMERA.inv()
    return RecordedArm(pictures, hands, cell.arm.intrinsics, HAND_FROM_CAMERA)


def poses_of(recording: RecordedArm) -> np.ndarray:
    return recording.cameras.as_matrix()


def test_every_estimator_takes_what_it_saw(recording, cell):
    seen = recording.views(Whole(cell.segmenter))
    assert len(seen.views) == N
    optimum = ContourFit().estimate([seen.arc], seen.intrinsics)
    assert optimum.solid.explains
    assert np.degrees(np.arccos(optimum.solid.normal @ cell.truth.normal.direction)) < 1


def test_a_written_folder_is_read_again(recording, tmp_path):
    read = RecordedArm.read(recording.write(tmp_path / "monday"))
    np.testing.assert_allclose(poses_of(read), poses_of(recording), atol=1e-12)
    assert read.intrinsics == recording.intrinsics
    assert (read.picture(3) == recording.picture(3)).all()
    with pytest.raises(InvalidParameterError, match="new or empty"):
        recording.write(tmp_path / "monday")


@pytest.mark.parametrize("form", ["vector", "matrix", "yaml", "json"])
def test_poses_in_other_forms_are_the_same(recording, tmp_path, form):
    folder = recording.write(tmp_path / "given")
    rows: list[dict[str, Any]] = []
    for k, pose in enumerate(recording.poses):
        matrix = pose.as_matrix()
        row: dict[str, Any] = {"picture": f"{k:03d}.png"}
        if form == "vector":
            row |= dict(
                zip(("x", "y", "z", "rx", "ry", "rz"), [*pose.translation, *pose.rotation.as_rotvec()], strict=True)
            )
        elif form == "matrix":
            row |= {f"m{i}{j}": matrix[i, j] for i in range(3) for j in range(4)}
        else:
            row["matrix"] = matrix.tolist()
        rows.append(row)
    (folder / "poses.csv").unlink()
    if form in ("vector", "matrix"):
        with (folder / "poses.csv").open("w", newline="") as file:
            table = csv.DictWriter(file, [*rows[0]])
            table.writeheader()
            table.writerows(rows)
    else:
        (folder / f"poses.{form}").write_text(json.dumps(rows))  # which is YAML, too
    np.testing.assert_allclose(poses_of(RecordedArm.read(folder)), poses_of(recording), atol=1e-9)


def test_ros_writes_a_lens_and_a_bent_one_is_straightened(recording, tmp_path):
    folder = recording.write(tmp_path / "given")
    lens = recording.intrinsics
    (folder / "lens.json").unlink()
    (folder / "lens.yaml").write_text(
        f"image_width: {lens.width}\nimage_height: {lens.height}\n"
        f"camera_matrix: {{rows: 3, cols: 3, data: [{lens.fx}, 0, {lens.cx}, 0, {lens.fy}, {lens.cy}, 0, 0, 1]}}\n"
        "distortion_coefficients: {rows: 1, cols: 5, data: [0.1, 0, 0, 0, 0]}\n"
    )
    read = RecordedArm.read(folder)
    assert read.intrinsics == lens
    assert (read.picture(0) == read.lens.undistort(recording.picture(0))).all()
    assert (read.picture(0) != recording.picture(0)).any()


@pytest.mark.parametrize(
    ("break_it", "message"),
    [
        (lambda folder: (folder / "poses.csv").unlink(), "poses.csv, .yaml or .json"),
        (lambda folder: (folder / "lens.json").unlink(), "lens.json or lens.yaml"),
        (lambda folder: (folder / "lens.json").write_text("{"), "no JSON file"),
        (lambda folder: (folder / "lens.json").write_text('{"width": 3}'), "width, height, fx"),
        (lambda folder: (folder / "002.png").unlink(), "row 3 .* names a picture"),
        (lambda folder: (folder / "poses.csv").write_text("picture,x,y,z\n000.png,1,2,3\n"), "row 1 .* quaternion"),
        (
            lambda folder: (folder / "poses.csv").write_text("picture,x,y,z,rx,ry,rz\n000.png,1,2,3,a,5,6\n"),
            "row 1 .* no pose",
        ),
        (lambda folder: (folder / "hand_eye.json").write_text("[1, 2]"), "hand_eye.json has no pose"),
    ],
)
def test_a_folder_that_is_none_is_named(recording, tmp_path, break_it, message):
    folder = recording.write(tmp_path / "given")
    break_it(folder)
    with pytest.raises(InvalidParameterError, match=message):
        RecordedArm.read(folder)


def test_pictures_of_another_size_or_without_the_object_are_named(recording):
    small = CameraIntrinsics(320, 240, 300, 300, 160, 120)
    with pytest.raises(InvalidImageError, match="640 x 480 px; the lens"):
        RecordedArm(recording.pictures, recording.poses, small).picture(0)
    with pytest.raises(InvalidImageError, match=r"shows the object whole\n  000.png shows no object"):
        recording.views(lambda rgb: np.zeros(rgb.shape[:2], bool))
    with pytest.raises(InvalidParameterError, match="a pose for each"):
        RecordedArm(recording.pictures[:2], recording.poses, recording.intrinsics)


@pytest.mark.parametrize(("ros", "encoding"), [(1, "rgb8"), (2, "bgr8")])
def test_a_bag_of_ros_is_read_without_ros(recording, tmp_path, ros, encoding):
    bag = tmp_path / ("one.bag" if ros == 1 else "two")
    bag_of(bag, recording.pictures, recording.poses, recording.intrinsics, ros=ros, encoding=encoding)
    read = RecordedArm.from_bag(bag, "/image", pose="/pose", hand_from_camera=HAND_FROM_CAMERA)
    assert len(read) == N
    np.testing.assert_allclose(poses_of(read), poses_of(recording), atol=1e-6)
    assert read.intrinsics == recording.intrinsics
    assert (read.picture(2) == recording.picture(2)).all()
    few = RecordedArm.from_bag(bag, "/image", pose="/pose", most=3)
    assert few.names == ("0.040 s", "0.340 s", "0.640 s")
    moved = RecordedArm.from_bag(
        bag, "/image", joints="/joints", forward=lambda q: RigidTransform.from_translation(q[:3]), lens=read.lens
    )
    np.testing.assert_allclose(moved.cameras.translation[:, 0], 0.1 * np.arange(N), atol=1e-9)
    with pytest.raises(InvalidParameterError, match="no topic /wrist; it has /camera_info, /image, /joints"):
        RecordedArm.from_bag(bag, "/image", pose="/wrist")
    with pytest.raises(InvalidParameterError, match="pose or a transform"):
        RecordedArm.from_bag(bag, "/image", pose="/joints")


def test_what_is_no_bag_is_named(tmp_path):
    (tmp_path / "no.bag").write_bytes(b"nothing")
    with pytest.raises(InvalidParameterError, match="ROS 1 or a folder of ROS 2"):
        RecordedArm.from_bag(tmp_path / "no.bag", "/image", pose="/pose")
    with pytest.raises(InvalidParameterError, match="pose='/a', joints='/b'"):
        RecordedArm.from_bag(tmp_path / "no.bag", "/image", pose="/a", joints="/b")
