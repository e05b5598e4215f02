"""From photographs of an object on a sheet to views, to a solid; and what becomes of photographs that are of no use."""

import json

import cv2
import numpy as np
import pytest

from gvp_book.experiments.photographs import photographed
from gvp_lib import ContourFit
from gvp_lib.cli import main
from gvp_lib.errors import InvalidImageError, InvalidParameterError
from gvp_lib.geometry import calibrate
from gvp_lib.photographs import Sheet, views_from_photographs
from gvp_lib.views import write_desk


@pytest.fixture(scope="module")
def photographs(files):
    return views_from_photographs(files)


def test_cameras_stood_where_they_did_and_the_lens_is_as_it_is(photographs, desk):
    assert len(photographs.views) == len(desk.pictures)
    assert not photographs.skipped
    for name, view in zip(photographs.files, photographs.views, strict=True):
        off = desk.cameras[int(name[0])].inv() * view.base_from_camera
        assert np.degrees(off.rotation.magnitude()) < 0.4
        assert np.linalg.norm(off.translation) < 0.003
    assert photographs.lens.intrinsics.fx == pytest.approx(desk.lens.fx, rel=0.01)


def test_masks_are_of_the_object_whatever_its_colors_and_shadow(photographs, desk):
    lens, bent = photographs.lens.intrinsics, photographs.lens.distortion
    size = photographs.intrinsics.width, photographs.intrinsics.height
    for name, view in zip(photographs.files, photographs.views, strict=True):
        straight = cv2.undistort(desk.masks[int(name[0])].astype(np.float32), lens.matrix, bent)
        true = cv2.resize(straight, size, interpolation=cv2.INTER_AREA) > 0.5
        mask = view.blob.mask(true.shape)
        assert (mask & true).sum() > 0.94 * (mask | true).sum()


def test_the_solid_is_the_package(photographs, desk):
    solid = ContourFit().estimate([photographs.arc], photographs.intrinsics).solid
    assert solid.explains
    axes = desk.sheet_from_package.rotation.as_matrix()
    assert np.degrees(np.arccos(np.abs(axes.T @ solid.normal).max())) < 1.5
    np.testing.assert_allclose(np.sort(solid.lengths), np.sort(desk.package.lengths), atol=0.0035)


def test_a_lens_and_a_segmenter_of_ones_own_serve_as_well(photographs, desk):
    lens = calibrate(desk.pictures, desk.sheet.board)
    green = views_from_photographs(
        desk.pictures[:4], desk.sheet, lambda rgb: (rgb[..., 1] > 1.25 * rgb[..., 0]) & (rgb[..., 1] > 30), lens
    )
    assert green.lens is lens
    assert len(green.views) == 4
    same = [green.views[0].base_from_camera.inv() * photographs.views[0].base_from_camera]
    assert np.linalg.norm(same[0].translation) < 0.003


def test_another_board_takes_a_segmenter(desk):
    board = cv2.aruco.GridBoard((5, 7), 0.03, 0.01, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_50))
    with pytest.raises(InvalidParameterError, match="give a segmenter"):
        views_from_photographs(desk.pictures, board)


def test_each_photograph_of_no_use_gets_its_own_word(nine, desk, files, tmp_path):
    given = {f"{k}.jpg": files / f"{k}.jpg" for k in range(6)}
    for name in ("a.heic", "b.mov", "c.dng", "d.jpg"):
        given[name] = tmp_path / name
        given[name].write_bytes(b"no picture")
    blank = np.full_like(desk.pictures[0], 128)
    turned = np.rot90(desk.pictures[6])
    soft = cv2.GaussianBlur(desk.pictures[7], (0, 0), 2.5)
    other = photographed("tea", seed=1, count=1, size=(1440, 1080), sheet=Sheet("letter")).pictures[0]
    pictures = {"blank": blank, "turned": turned, "soft": soft, "other": other, "moved": nine.pictures[8]}
    for name, picture in pictures.items():
        given[name] = tmp_path / f"{name}.png"
        cv2.imwrite(str(given[name]), cv2.cvtColor(np.ascontiguousarray(picture), cv2.COLOR_RGB2BGR))
    given["gone"] = tmp_path / "gone.jpg"
    told = views_from_photographs(list(given.values()))
    assert {*told.files} == {f"{k}.jpg" for k in range(6)}
    said = {
        "a.heic": "is HEIC", "b.mov": "is a video", "c.dng": "is raw", "d.jpg": "no picture that OpenCV reads",
        "blank.png": "shows no sheet", "turned.png": "turned or cut", "soft.png": "blurred",
        "other.png": "another sheet", "moved.png": "was moved", "gone.jpg": "is no file",
    }  # fmt: skip
    for name, words in said.items():
        assert words in told.skipped.get(name, ""), (name, told.skipped)
    assert [*told.skipped] == [name for name in (path.name for path in given.values()) if name in told.skipped]


@pytest.mark.parametrize(
    ("choose", "said"),
    [
        (lambda files: files / "0.jpg", "a single view tells no solid"),
        (lambda files: [files / "0.jpg"], "got 1"),
        (lambda files: [files / "0.jpg"] * 200, "Ten to forty"),
        (lambda files: files / "nowhere", "a folder, or several files"),
        (lambda files: np.zeros((4, 4, 3), np.uint8), "in a list"),
        (lambda files: [np.zeros((9, 9), np.uint8)] * 3, "number 1 is no RGB picture"),
        (lambda files: [np.zeros((90, 90, 3), np.uint8)] * 5, "shows no sheet"),
    ],
)
def test_what_are_no_photographs_is_refused_in_words(choose, said, files):
    with pytest.raises(InvalidImageError, match=said):
        views_from_photographs(choose(files))


def test_an_empty_folder_is_refused(tmp_path):
    with pytest.raises(InvalidImageError, match="holds no photographs"):
        views_from_photographs(tmp_path)


def test_edges_far_less_steep_than_the_others_are_a_blurred_picture(desk):
    softer = [cv2.GaussianBlur(picture, (0, 0), 1.2) for picture in desk.pictures[:3]]
    assert len(views_from_photographs(softer).views) == 3  # alike, they serve
    sharp = [cv2.addWeighted(p, 2.0, cv2.GaussianBlur(p, (0, 0), 2.0), -1.0, 0) for p in desk.pictures[:6]]
    soft = cv2.GaussianBlur(desk.pictures[7], (0, 0), 2.0)
    told = views_from_photographs([*sharp, soft])
    assert "is blurred: its edges are" in told.skipped["number 6"]


def test_photographs_show_themselves_and_their_scene_is_a_page(photographs, desk, tmp_path):
    optimum = ContourFit().estimate([photographs.arc], photographs.intrinsics)
    page = write_desk(tmp_path / "new", photographs, optimum, desk.sheet)
    text = page.read_text("utf-8")
    assert "aligned" in text
    assert all((tmp_path / "new" / f"{k:02d}.jpg").is_file() for k in range(len(photographs.views)))
    told = json.loads((tmp_path / "new" / "desk.json").read_text("utf-8"))
    assert told["solid"]["lengths"] == pytest.approx(optimum.solid.lengths)
    assert len(told["views"]) == len(photographs.views)
    assert (tmp_path / "new" / "scene.html").stat().st_size > 100_000
    assert len(photographs.plot(solid=optimum.solid).axes) == 4


def test_the_commands_write_a_sheet_and_read_photographs(files, tmp_path, capsys):
    assert main(["sheet", str(tmp_path / "sheets"), "--paper", "a4"]) == 0
    assert {path.name for path in (tmp_path / "sheets").iterdir()} == {"sheet-a4.pdf", "sheet-a4.png"}
    assert main(["photos", str(files), "--out", str(tmp_path / "desk"), "--quiet"]) == 0
    told = capsys.readouterr().out
    assert "8 photographs: box" in told
    assert (tmp_path / "desk" / "index.html").is_file()
    assert main(["photos", str(tmp_path / "nowhere")]) == 2
    assert "a folder, or several files" in capsys.readouterr().err
