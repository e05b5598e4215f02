"""The book, built as `make book` builds it: without a warning, without a network, and light."""

import gzip
import json
import os
import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import mujoco
import nbformat
import pytest

from gvp_lib.views.scene3d import Scene3D

ROOT = Path(__file__).parents[2]
# Attributes by which a page makes a browser load something; a link to click is not among them.
LOADING = {"script": "src", "img": "src", "iframe": "src", "link": "href", "source": "src", "video": "src"}


def a_chapter_with_a_scene() -> nbformat.NotebookNode:
    """A stored notebook that uses what chapters use, its scene as a kernel would have left it."""
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='.1'/></worldbody></mujoco>")
    bundle = Scene3D(model, title="a ball").show()._repr_mimebundle_()
    cell = nbformat.v4.new_code_cell("scene.show()", execution_count=1)
    cell.outputs = [nbformat.v4.new_output("execute_result", bundle, execution_count=1)]
    text = (
        "# Chapter of a test\n\nBy {eq}`eq-pinhole` and {cite}`smith2020`:\n\n$$ a = b $$ (eq-of-a-test)\n\n"
        "```{exercise}\n:label: ex-of-a-test\nWhy?\n```\n\n```{solution} ex-of-a-test\n:class: dropdown\nSo.\n```\n"
    )
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_markdown_cell(text), cell])
    notebook.metadata["kernelspec"] = {"display_name": "Python 3", "language": "python", "name": "python3"}
    notebook.metadata["language_info"] = {"name": "python"}
    return notebook


@pytest.fixture(scope="module")
def html(tmp_path_factory) -> Path:
    """The built book: the stored chapters, and one more."""
    place = tmp_path_factory.mktemp("clone")
    shutil.copytree(ROOT / "book", place / "book", ignore=shutil.ignore_patterns("_build", "notebooks", "generated"))
    shutil.copy(ROOT / "CHANGELOG.md", place)
    (place / "notebooks").mkdir()
    for chapter in (ROOT / "notebooks").glob("*.ipynb"):
        shutil.copy(chapter, place / "notebooks")
    nbformat.write(a_chapter_with_a_scene(), place / "notebooks" / "98_of_a_test.ipynb")
    out = place / "html"
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", str(place / "book"), str(out)]
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    built = subprocess.run(
        command, capture_output=True, text=True, check=False, cwd=place, env=os.environ | {"PYTHONPATH": path}
    )
    assert built.returncode == 0, built.stderr
    assert built.stderr == ""
    return out


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


def test_whatever_a_page_loads_is_there_and_nothing_comes_from_a_network(html):
    pages = sorted({*html.rglob("*.html")} - {*(html / "_static").glob("*.html")})  # there: templates of the theme
    assert len(pages) > 5
    for page in pages:
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


def test_each_scene_is_light_and_all_share_one_script(html):
    scenes = sorted((html / "_static" / "generated" / "scenes").glob("*.html"))
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
