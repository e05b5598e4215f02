"""The book as a PDF: every chapter, typeset, a still for each scene, and a contents page that tells the truth."""

import re
from unicodedata import normalize

import pytest
from pdf import build_one_page, print_book
from pypdf import PdfReader


@pytest.fixture(scope="module")
def one_page(html, tmp_path_factory):
    return build_one_page(tmp_path_factory.mktemp("pdf"), html.parent / "book", html / ".doctrees")


@pytest.fixture(scope="module")
def reader(browser, one_page, tmp_path_factory):
    target = tmp_path_factory.mktemp("printed") / "book.pdf"
    print_book(one_page, target, browser)
    return PdfReader(target)


@pytest.fixture(scope="module")
def texts(reader):
    """Of each page, its ligatures taken apart."""
    return [" ".join(normalize("NFKC", page.extract_text()).split()) for page in reader.pages]


def test_the_pdf_has_every_chapter_where_its_contents_say(texts):
    assert len(texts) > 50
    contents = next(text for text in texts if text.startswith("Contents"))
    for title in ("A first tour", "From pixels to a blob", "Closing the loop", "Bibliography"):
        number = re.search(rf"{title} ?(\d+)", contents)
        assert number, title
        assert title in texts[int(number[1]) - 1][:60]
    number = re.search(r"Your own arm ?(\d+)", contents)
    assert number, "a page within the guide"
    assert "Your own arm" in texts[int(number[1]) - 1]


def test_a_word_is_found_and_no_formula_is_left_raw(texts):
    text = "\n".join(texts)
    assert "centroid" in text
    assert not re.search(r"\\(begin|frac|mathbf|operatorname)\{", re.sub(r"r?\"[^\"]*\"", "", text))


def test_every_scene_is_a_picture_and_no_frame_is_left(one_page, scenes):
    page = one_page.read_text("utf-8")
    assert "<iframe" not in page
    stills = re.findall(r'<figure class="gvp-still"><img src="([^"]+)"', page)
    assert len(stills) == len(scenes) + 1  # the first page's
    assert all((one_page.parent / still).stat().st_size > 1000 for still in stills)
