"""The book, built as `make book` builds it: without a warning, without a network, and light."""

import gzip
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

ROOT = Path(__file__).parents[2]
# Attributes by which a page makes a browser load something; a link to click is not among them.
LOADING = {"script": "src", "img": "src", "iframe": "src", "link": "href", "source": "src", "video": "src"}


def loaded_by(page: Path) -> list[str]:
    found: list[str] = []

    class Loads(HTMLParser):
        def handle_starttag(self, tag, attrs):
            given = dict(attrs)
            if tag == "link" and given.get("rel") in {"search", "next", "prev", "index", "canonical", "genindex"}:
                return
            if value := given.get(LOADING.get(tag, "")):
                found.append(value)

    Loads().feed(page.read_text("utf-8"))
    return found


def test_whatever_a_page_loads_is_there_and_nothing_comes_from_a_network(html, pages, scenes):
    assert len(pages) > 5
    for page in pages + scenes:
        for address in loaded_by(page):
            parts = urlsplit(address)
            if parts.scheme == "data":
                continue
            assert not parts.scheme, f"{page.relative_to(html)} loads {address}"
            assert not parts.netloc, f"{page.relative_to(html)} loads {address}"
            assert (page.parent / unquote(parts.path)).exists(), f"{page.relative_to(html)} lacks {address}"


def test_style_sheets_load_nothing_from_a_network(html):
    for sheet in html.rglob("*.css"):
        assert not re.search(r"(?:url\(|@import)\s*[\"']?(?:https?:)?//", sheet.read_text("utf-8")), sheet


def test_each_scene_is_light_and_all_share_one_script(html, scenes):
    assert "98_of_a_test-1.html" in [scene.name for scene in scenes]
    for scene in scenes:
        assert len(gzip.compress(scene.read_bytes())) < 500_000, scene.name
        assert "../meshcat.min.js" in loaded_by(scene)
    assert len([*html.rglob("meshcat*.js")]) == 1


def test_a_stored_scene_shows_as_a_lazy_frame_over_its_picture(html):
    page = (html / "notebooks" / "98_of_a_test.html").read_text("utf-8")
    frame = re.search(r'<iframe src="([^"]+)" title="a ball" loading="lazy"', page)
    assert frame, "no frame for the scene"
    assert (html / "notebooks" / frame[1]).with_suffix(".png").exists()
    assert "127.0.0.1" not in page, "the live server's address is of no use in a book"


def test_equations_are_typeset_by_the_book_itself(html):
    page = html / "notebooks" / "98_of_a_test.html"
    assert any("generated/mathjax/tex-chtml.js" in address for address in loaded_by(page))
    assert [*html.rglob("MathJax_Main-Regular.woff")]
    assert "Eq. 1" in page.read_text("utf-8")


def test_there_is_a_search_index_and_the_book_weighs_little(html):
    assert (html / "searchindex.js").exists()
    assert sum(f.stat().st_size for f in html.rglob("*") if f.is_file()) < 60e6


def test_stored_notebooks_hold_no_address_of_a_kernel_that_has_gone():
    for path in (ROOT / "notebooks").glob("*.ipynb"):
        outputs = [o for c in json.loads(path.read_text("utf-8"))["cells"] for o in c.get("outputs", ())]
        assert not any("gvp-live" in "".join(o.get("data", {}).get("text/html", "")) for o in outputs), path.name


def test_the_first_page_comes_quickly(html):
    """All that its reader waits for, as it lies on the disk: a server that compresses sends a third of it."""
    loaded = {(html / unquote(urlsplit(address).path)).resolve() for address in loaded_by(html / "index.html")}
    assert not [path for path in loaded if path.name == "searchindex.js"]
    files = {html / "index.html", *(path for path in loaded if path.is_file() and path.suffix != ".html")}
    files -= set((html / "_static" / "generated" / "scenes").iterdir())  # the limit is without its scene
    files |= set(html.rglob("fa-solid-900.woff2"))  # the icons' font, which a style sheet loads
    assert sum(path.stat().st_size for path in files) < 1e6, {path.name: path.stat().st_size for path in files}


def test_only_pages_with_formulas_load_what_sets_them(html, pages):
    for page in pages:
        has_formulas = bool(re.search(r'class="(?:[\w -]+ )?math\b', page.read_text("utf-8")))
        assert any("mathjax" in address for address in loaded_by(page)) == has_formulas, page.name


def test_no_chapter_invents_a_repository_to_be_opened_from(html):
    """Where there is one, a setting names it: test_settings.py."""
    page = (html / "notebooks" / "00_tour.html").read_text("utf-8")
    assert "mybinder.org" not in page
    assert "colab.research.google.com" not in page


def test_the_solutions_stand_in_a_page_and_its_search(html):
    """Unless a setting hides them: test_settings.py."""
    page = (html / "notebooks" / "98_of_a_test.html").read_text("utf-8")
    assert "Because of the moon" in page
    assert "the_tide" in page
    assert "moon" in (html / "searchindex.js").read_text("utf-8")


def test_every_scene_has_a_lazy_frame_in_its_chapter(html, scenes):
    """By its attribute: the browser that Playwright drives is told to load every frame at once."""
    for scene in scenes:
        chapter, _, number = scene.stem.rpartition("-")
        frames = re.findall(
            r'<iframe src="([^"]+)" title="[^"]+" loading="lazy"',
            (html / "notebooks" / f"{chapter}.html").read_text("utf-8"),
        )
        assert (html / "notebooks" / frames[int(number) - 1]).resolve() == scene.resolve()
