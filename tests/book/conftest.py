"""The built book, once for all tests of it; a browser; and what the browser saw on every page."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import mujoco
import nbformat
import pytest
from browser import open_browser
from reader import Visit, visit

from gvp_lib.views.scene3d import Scene3D

ROOT = Path(__file__).parents[2]


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


@pytest.fixture(scope="session")
def html(tmp_path_factory) -> Path:
    """The built book: the stored chapters, and one more."""
    place = tmp_path_factory.mktemp("clone")
    shutil.copytree(ROOT / "book", place / "book", ignore=shutil.ignore_patterns("_build", "notebooks", "generated"))
    shutil.copy(ROOT / "CHANGELOG.md", place)
    (place / "notebooks").mkdir()
    for chapter in (ROOT / "notebooks").glob("*.ipynb"):
        shutil.copy(chapter, place / "notebooks")
    nbformat.write(a_chapter_with_a_scene(), place / "notebooks" / "98_of_a_test.ipynb")
    index = place / "book" / "index.md"
    last = "<notebooks/08_beyond_the_thesis>\n"
    assert last in index.read_text("utf-8")
    index.write_text(index.read_text("utf-8").replace(last, f"{last}98  Of a test <notebooks/98_of_a_test>\n"), "utf-8")
    out = place / "html"
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", str(place / "book"), str(out)]
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    built = subprocess.run(
        command, capture_output=True, text=True, check=False, cwd=place, env=os.environ | {"PYTHONPATH": path}
    )
    assert built.returncode == 0, built.stderr
    assert built.stderr == ""
    return out


@pytest.fixture(scope="session")
def pages(html) -> list[Path]:
    """Every page of the book; a scene's own page is not among them, nor are the theme's templates."""
    return sorted({*html.rglob("*.html")} - {*(html / "_static").rglob("*.html")})


@pytest.fixture(scope="session")
def scenes(html) -> list[Path]:
    """The page of every 3D scene."""
    return sorted((html / "_static" / "generated" / "scenes").glob("*.html"))


@pytest.fixture(scope="module")  # while Playwright runs, no other test can run an event loop
def browser():
    """A headless Chromium. Where there is none, the error says how to get one: a page that nobody looked at is not
    tested."""
    with open_browser() as opened:
        yield opened


@pytest.fixture(scope="module")
def visits(browser, html, pages) -> dict[str, Visit]:
    """By page: what the browser found there."""
    return {str(page.relative_to(html)): visit(browser, page) for page in pages}
