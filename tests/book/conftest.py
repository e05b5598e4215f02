"""The built book, once for all tests of it; and a browser."""

import os
import shutil
from pathlib import Path

import mujoco
import nbformat
import pytest
from browser import open_browser
from filelock import FileLock
from snippets import ROOT, run_python

from gvp_lib.simulation.workcell import WorkCell
from gvp_lib.views.lab import Lab
from gvp_lib.views.scene3d import Scene3D


@pytest.fixture(scope="session")
def a_chapter() -> nbformat.NotebookNode:
    """A stored notebook that uses what chapters use, its scene as a kernel would have left it."""
    ball = "<body><freejoint/><geom size='.1'/></body>"
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{ball}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    scene = Scene3D(model, data, title="a ball")
    with scene.record(fps=20) as recording:
        while data.time < 1:
            mujoco.mj_step(model, data)
            scene.capture_frame()
    shown = nbformat.v4.new_output("execute_result", recording._repr_mimebundle_(), execution_count=2)
    with WorkCell("ur5e", "cuboid_1x2", seed=1) as cell:
        laboratory = Lab(cell, title="A brick under a UR5e", height=700)._repr_mimebundle_()
    started = nbformat.v4.new_output("execute_result", laboratory, execution_count=3)
    exercise = (
        "# Chapter of a test\n\nBy {eq}`eq-pinhole` and {cite}`smith2020`:\n\n$$ a = b $$ (eq-of-a-test)\n\n"
        ":::{exercise}\n:label: ex-of-a-test\n\nWhy?\n:::"
    )
    solution = ":::{solution-start} ex-of-a-test\n:class: dropdown\n:::\n\nBecause of the moon."
    cells = [
        nbformat.v4.new_markdown_cell(exercise),
        nbformat.v4.new_markdown_cell(solution),
        nbformat.v4.new_code_cell("the_tide = 1", execution_count=1),
        nbformat.v4.new_markdown_cell(":::{solution-end}\n:::"),
        nbformat.v4.new_code_cell("recording", execution_count=2, outputs=[shown]),
        nbformat.v4.new_code_cell("Lab(cell)", execution_count=3, outputs=[started]),
        nbformat.v4.new_markdown_cell("And so on.\n\n" * 30),  # more than a screen holds
    ]
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    return nbformat.v4.new_notebook(cells=cells, metadata={"kernelspec": kernel, "language_info": {"name": "python"}})


def build_book(clone: Path, a_chapter: nbformat.NotebookNode) -> None:
    """Build ``clone/html``: the stored chapters, and one more."""
    shutil.copytree(ROOT / "book", clone / "book", ignore=shutil.ignore_patterns("_build", "notebooks", "generated"))
    shutil.copy(ROOT / "CHANGELOG.md", clone)
    shutil.copytree(ROOT / "notebooks", clone / "notebooks")
    nbformat.write(a_chapter, clone / "notebooks" / "98_of_a_test.ipynb")
    index, last = clone / "book" / "index.md", "<notebooks/08_beyond_the_thesis>\n"
    assert last in index.read_text("utf-8")
    index.write_text(index.read_text("utf-8").replace(last, f"{last}98  Of a test <notebooks/98_of_a_test>\n"), "utf-8")
    built = run_python("-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", "book", "html", folder=clone)
    assert (built.returncode, built.stderr) == (0, "")


@pytest.fixture(scope="session")
def html(a_chapter, tmp_path_factory) -> Path:
    """The built book. Of the processes that share a run, the first that wants it builds it, and the others wait."""
    base = tmp_path_factory.getbasetemp()
    run = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    clone, built = run / "clone", run / "clone" / "built"
    with FileLock(run / "clone.lock"):
        if not built.exists():
            shutil.rmtree(clone, ignore_errors=True)  # of a build that failed; the next fails, too, and says why
            build_book(clone, a_chapter)
            built.touch()
    return clone / "html"


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
