"""The sheet of paper that tells where a camera stood."""

import io

import cv2
import numpy as np
import pypdf
import pytest

from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry import CameraIntrinsics, board_pose
from gvp_lib.geometry.board import locate
from gvp_lib.photographs import Sheet


@pytest.mark.parametrize("paper", ["a4", "letter"])
def test_its_own_picture_shows_its_corners_where_they_are_meant(paper):
    sheet = Sheet(paper)
    image = sheet.image(dpi=254)  # ten pixels to a millimeter
    points, pixels = locate(image, sheet.board)
    middle = 0.5 * (np.array(image.shape[::-1]) - 1)
    assert len(points) > 50
    np.testing.assert_allclose(pixels - middle, 1e4 * points[:, :2], atol=0.6)  # px, 0.06 mm


def test_no_marker_is_on_both_papers_and_letter_paper_is_no_a4():
    a4, letter = Sheet("a4"), Sheet("letter")
    assert not {*np.ravel(a4.board.getIds())} & {*np.ravel(letter.board.getIds())}
    assert locate(letter.image(150), a4.board) is None


def test_the_pdf_is_one_page_of_the_paper_filled_by_the_picture(tmp_path):
    page = pypdf.PdfReader(io.BytesIO(Sheet("a4").save(tmp_path / "new" / "sheet.pdf").read_bytes())).pages[0]
    assert [float(side) * 25.4 / 72 for side in page.mediabox[2:]] == pytest.approx([210, 297], abs=0.01)
    drawn = np.array(page.images[0].image.convert("L"))
    np.testing.assert_array_equal(drawn > 127, Sheet("a4").image(600) > 127)


def test_the_png_is_the_picture(tmp_path):
    stored = cv2.imread(str(Sheet("letter").save(tmp_path / "sheet.png")), cv2.IMREAD_GRAYSCALE)
    np.testing.assert_array_equal(stored, Sheet("letter").image(600))


def test_the_bar_is_a_tenth_of_a_meter_long():
    image = Sheet("a4").image(dpi=254)
    rows = (image[2835:2880] == 0).sum(axis=1)  # in the margin below the squares
    assert rows.max() == pytest.approx(1000, abs=2)


def test_a_sheet_that_was_printed_smaller_places_the_camera_nearer():
    lens = CameraIntrinsics(1240, 1754, 1500, 1500, 619.5, 876.5)
    image = Sheet("a4").image(150)
    far, near = (board_pose(image, Sheet("a4", bar=bar).board, lens).translation[2] for bar in (0.1, 0.097))
    assert near == pytest.approx(0.97 * far, rel=1e-3)
    assert "97.0 %" in repr(Sheet("a4", bar=0.097))


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda folder: Sheet("a5"), "'a4', 'letter'"),
        (lambda folder: Sheet("a4", bar=97), "in meters"),
        (lambda folder: Sheet("a4").image(dpi=3), "from 60 to 2400"),
        (lambda folder: Sheet("a4").save(folder / "sheet.jpg"), ".pdf or .png"),
        (lambda folder: Sheet("a4").save(folder / "file" / "sheet.pdf"), "cannot be written"),
    ],
)
def test_what_makes_no_sheet_is_refused_in_words(make, said, tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InvalidParameterError, match=said):
        make(tmp_path)
