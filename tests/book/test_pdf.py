"""The book as a PDF: every chapter, typeset, a still for each scene, and a contents page that tells the truth."""

import re
from functools import lru_cache
from unicodedata import normalize

import pytest
from pdf import build_one_page, print_book
from pypdf import PdfReader
from reader import PATIENCE, RAW_TEX

pytestmark = pytest.mark.full


@pytest.fixture(scope="module")
def one_page(html, tmp_path_factory):
    return build_one_page(tmp_path_factory.mktemp("pdf"), html.parent / "book", html / ".doctrees")


@pytest.fixture(scope="module")
def reader(browser, one_page, tmp_path_factory):
    target = tmp_path_factory.mktemp("printed") / "book.pdf"
    print_book(one_page, target, browser)
    return PdfReader(target)


@pytest.fixture(scope="module")
def text(reader):
    """The text of a page, by its number from 1, ligatures taken apart. Reading one takes a tenth of a second."""
    return lru_cache(None)(lambda number: " ".join(normalize("NFKC", reader.pages[number - 1].extract_text()).split()))


def chapter_page(text, title: str) -> int:
    """Where the contents say that a chapter begins."""
    contents = next(page for number in range(1, 10) if (page := text(number)).startswith("Contents"))
    number = re.search(rf"{title} ?(\d+)", contents)
    assert number, title
    return int(number[1])


def test_the_pdf_has_every_chapter_where_its_contents_say_with_words_that_can_be_found_and_no_empty_page(reader, text):
    for title in ("How to read this book", "A first tour", "From pixels to a blob", "Closing the loop", "Bibliography"):
        assert title in text(chapter_page(text, title))[:60]
    assert "Your own arm" in text(chapter_page(text, "Your own arm")), "a page within the guide"
    first = chapter_page(text, "From pixels to a blob")
    assert any("centroid" in text(number) for number in range(first, first + 20))
    assert all(len(text(number)) >= 20 for number in range(1, 30))
    assert len(reader.pages) > 50


def test_nothing_is_cut_off_at_the_edge_of_the_paper_and_no_formula_is_left_raw(browser, one_page):
    between_margins = {"width": 643, "height": 900}  # px: 170 mm
    cut_off = """() => [...document.querySelectorAll("table, pre, figure, mjx-container")].filter((e) =>
      e.getBoundingClientRect().right > 644 || e.scrollWidth > e.parentElement.clientWidth + 1
    ).map((e) => e.outerHTML.slice(0, 200))"""
    with browser.new_page(offline=True, viewport=between_margins) as page:
        page.set_default_timeout(PATIENCE)
        page.emulate_media(media="print")
        page.goto(one_page.as_uri())
        page.evaluate("MathJax.startup.promise.then(() => 0)")
        assert page.evaluate("document.querySelectorAll('table').length") > 50
        assert page.evaluate(cut_off) == []
        assert page.evaluate(RAW_TEX.replace('"main"', '"body"')) == []


def test_every_scene_is_a_picture_and_no_frame_is_left(one_page, scenes):
    page = one_page.read_text("utf-8")
    assert "<iframe" not in page
    stills = re.findall(r'<figure class="gvp-still"><img src="([^"]+)"', page)
    assert len(stills) == len(scenes) + 1  # the first page's
    assert all((one_page.parent / still).stat().st_size > 1000 for still in stills)
