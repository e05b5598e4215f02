"""Every page in a browser, as its readers have it: wide and on a phone, light and dark, and without a network."""

import shutil

import pytest
from reader import PHONE, WIDE, Reader, Watched

pytestmark = pytest.mark.full


def test_nothing_is_wrong_on_any_page(browser, html, pages):
    with Watched(browser, viewport=WIDE, reduced_motion="reduce", color_scheme="light") as watched:
        reader = Reader(watched)
        found = {str(page.relative_to(html)): reader.visit(page) for page in pages}
        watched.wrong = []  # each page's own is among what was found
    assert {page: faults for page, faults in found.items() if faults} == {}
    assert len(found) > 10
    assert reader.formulas > 100


UNDRAWN = """() => [...document.querySelectorAll(".fa-solid, .fas")].filter((icon) => {
  const { content, fontFamily } = getComputedStyle(icon, "::before");
  return !fontFamily.startsWith('"Font Awesome') || ["none", "normal"].includes(content);
}).map((icon) => icon.className)"""


@pytest.mark.parametrize("size", [WIDE, PHONE], ids=["wide", "phone"])
def test_icons_of_menu_search_and_theme_are_drawn(browser, html, size):
    with Watched(browser, viewport=size) as watched:
        watched.open(html / "conventions.html")
        for name in ("fa-bars", "fa-circle-half-stroke", "fa-magnifying-glass"):  # the theme's script shows some late
            watched.page.locator(f".{name}:visible").first.wait_for()
        watched.page.wait_for_function("document.fonts.check('900 16px \"Font Awesome 7 Free\"', '\uf002')")
        assert watched.page.evaluate(UNDRAWN) == []


def test_a_search_finds_a_chapter(browser, html):
    with Watched(browser, viewport=WIDE) as watched:
        watched.open(html / "index.html")
        watched.page.keyboard.press("Control+k")
        watched.page.keyboard.type("centroid")
        watched.page.keyboard.press("Enter")
        # Results come one after the other, the best first: the glossary and the reference know the word, too.
        watched.page.locator("#search-results ul.search a[href*='01_hsv_and_moments']").first.wait_for()


def test_the_book_works_from_a_stick_whatever_its_folder_is_called(browser, html, tmp_path):
    stick = tmp_path / "USB stick, 8 GB (ä)" / "my book"
    shutil.copytree(html, stick)
    with Watched(browser, viewport=WIDE) as watched:
        watched.open(stick / "index.html")
        watched.page.locator(".bd-sidebar-primary a[href$='98_of_a_test.html']").click()
        watched.page.wait_for_url("**/98_of_a_test.html")
        scene = watched.page.frame_locator(".gvp-scene iframe")
        scene.locator("canvas").wait_for()
        assert watched.page.locator("mjx-container").count() == watched.page.locator(".math").count() > 0
