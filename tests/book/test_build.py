"""The book, built as `make book` builds it: without a warning, without a network, and light."""

import gzip
import re
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from snippets import ROOT

# Attributes by which a page makes a browser load something; a link to click is not among them.
LOADING = {"script": "src", "img": "src", "iframe": "src", "link": "href", "source": "src", "video": "src"}
ONLY_NAMED = {"search", "next", "prev", "index", "canonical", "genindex"}


@cache
def loaded_by(page: Path) -> list[str]:
    found: list[str] = []

    class Loads(HTMLParser):
        def handle_starttag(self, tag, attrs):
            given = dict(attrs)
            value = given.get(LOADING.get(tag, ""))
            if value and not (tag == "link" and given.get("rel") in ONLY_NAMED):
                found.append(value)

    Loads().feed(page.read_text("utf-8"))
    return found


def of_a_test(html: Path) -> str:
    return (html / "notebooks" / "98_of_a_test.html").read_text("utf-8")


def test_whatever_a_page_loads_is_there_and_nothing_comes_from_a_network(html, pages, scenes):
    assert len(pages) > 5
    for page in pages + scenes:
        for address in loaded_by(page):
            parts = urlsplit(address)
            if parts.scheme != "data":
                assert not parts.scheme + parts.netloc, f"{page.relative_to(html)} loads {address}"
                assert (page.parent / unquote(parts.path)).exists(), f"{page.relative_to(html)} lacks {address}"
    for sheet in html.rglob("*.css"):
        assert not re.search(r"(?:url\(|@import)\s*[\"']?(?:https?:)?//", sheet.read_text("utf-8")), sheet


def test_each_scene_is_light_all_share_one_script_and_each_has_a_lazy_frame_over_its_picture(html, scenes):
    assert "98_of_a_test-1.html" in [scene.name for scene in scenes]
    assert len([*html.rglob("meshcat*.js")]) == 1
    for scene in scenes:
        assert len(gzip.compress(scene.read_bytes())) < 500_000, scene.name
        assert "../meshcat.min.js" in loaded_by(scene)
        assert scene.with_suffix(".png").exists()
        # By its attribute: the browser that Playwright drives is told to load every frame at once.
        chapter, _, number = scene.stem.rpartition("-")
        page = (html / "notebooks" / f"{chapter}.html").read_text("utf-8")
        frames = re.findall(r'<iframe src="([^"]+)" title="[^"]+" loading="lazy"', page)
        assert (html / "notebooks" / frames[int(number) - 1]).resolve() == scene.resolve()


def test_no_address_of_a_kernel_that_has_gone_is_stored_or_shown(html):
    assert "127.0.0.1" not in of_a_test(html)
    for path in (ROOT / "notebooks").glob("*.ipynb"):
        assert "gvp-live" not in path.read_text("utf-8"), path.name


def test_equations_are_typeset_by_the_book_itself_and_only_pages_with_formulas_load_what_sets_them(html, pages):
    assert "generated/mathjax/tex-chtml.js" in " ".join(loaded_by(html / "notebooks" / "98_of_a_test.html"))
    assert [*html.rglob("MathJax_Main-Regular.woff")]
    assert "Eq. 1" in of_a_test(html)
    for page in pages:
        has_formulas = bool(re.search(r'class="(?:[\w -]+ )?math\b', page.read_text("utf-8")))
        assert any("mathjax" in address for address in loaded_by(page)) == has_formulas, page.name


def test_the_book_weighs_little_and_its_first_page_comes_quickly(html):
    """All that its reader waits for, as it lies on the disk: a server that compresses sends a third of it."""
    assert (html / "searchindex.js").exists()
    assert sum(f.stat().st_size for f in html.rglob("*") if f.is_file()) < 60e6
    loaded = {(html / unquote(urlsplit(address).path)).resolve() for address in loaded_by(html / "index.html")}
    assert not [path for path in loaded if path.name == "searchindex.js"]
    files = {html / "index.html", *(path for path in loaded if path.is_file() and path.suffix != ".html")}
    files -= set((html / "_static" / "generated" / "scenes").iterdir())  # the limit is without its scene
    files |= set(html.rglob("fa-solid-900.woff2"))  # the icons' font, which a style sheet loads
    assert sum(path.stat().st_size for path in files) < 1e6, {path.name: path.stat().st_size for path in files}


def test_the_solutions_stand_in_a_page_and_its_search_and_no_chapter_invents_a_repository(html):
    """Unless a setting hides them, or names one: test_settings.py."""
    page = of_a_test(html)
    assert "Because of the moon" in page
    assert "the_tide" in page
    assert "moon" in (html / "searchindex.js").read_text("utf-8")
    assert "mybinder.org" not in page
    assert "colab.research.google.com" not in page
