"""What a reader may set for a build: the solutions hidden, and the address of a public repository."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest
from snippets import ROOT

pytestmark = pytest.mark.full


def build(folder: Path, **settings: str) -> subprocess.CompletedProcess[str]:
    """Build ``folder/html``, a book of one chapter, so that it takes seconds."""
    ignored = shutil.ignore_patterns("*.md", "_*", ".*", "generated", "notebooks")
    shutil.copytree(ROOT / "book", folder / "book", ignore=ignored)
    (folder / "book" / "_static").mkdir()
    (folder / "book" / "index.md").write_text("# A book\n\n```{toctree}\nnotebooks/00_a\n```\n")
    (folder / "notebooks").mkdir()
    cells = [
        nbformat.v4.new_markdown_cell("# A\n\n:::{exercise} B\n:label: ex-b\n\nWhy?\n:::"),
        nbformat.v4.new_markdown_cell(":::{solution-start} ex-b\n:class: dropdown\n:::\n\nBecause of the moon."),
        nbformat.v4.new_code_cell("the_tide = 1"),
        nbformat.v4.new_markdown_cell(":::{solution-end}\n:::"),
    ]
    nbformat.write(nbformat.v4.new_notebook(cells=cells), folder / "notebooks" / "00_a.ipynb")
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    command = [sys.executable, "-m", "sphinx", "-q", "-b", "html", folder / "book", folder / "html"]
    environment = os.environ | settings | {"PYTHONPATH": path}
    return subprocess.run(command, capture_output=True, text=True, env=environment)


@pytest.fixture(scope="module")
def for_a_class(tmp_path_factory) -> Path:
    """The pages of a book whose repository is public, and whose solutions are hidden."""
    folder = tmp_path_factory.mktemp("for_a_class")
    built = build(folder, GVP_SOLUTIONS="hide", GVP_REPOSITORY="https://github.com/somebody/gvp")
    assert built.returncode == 0, built.stderr
    return folder / "html"


def test_one_setting_hides_the_solutions_of_the_pages(for_a_class):
    """By default they are shown: test_build.py."""
    page = (for_a_class / "notebooks" / "00_a.html").read_text("utf-8")
    assert "Why?" in page
    assert "Because of the moon" not in page
    assert "the_tide" not in page
    assert "moon" not in (for_a_class / "searchindex.js").read_text("utf-8")


def test_a_misspelled_setting_stops_the_build(tmp_path):
    built = build(tmp_path, GVP_SOLUTIONS="hid")
    assert built.returncode != 0
    assert '"show" or "hide"; got \'hid\'' in built.stderr


def test_where_the_repository_is_public_a_chapter_opens_in_colab_and_binder(for_a_class):
    """Without an address there are no such buttons: test_build.py."""
    page = (for_a_class / "notebooks" / "00_a.html").read_text("utf-8")
    assert "https://colab.research.google.com/github/somebody/gvp/blob/main/notebooks/00_a.ipynb" in page
    assert "https://mybinder.org/v2/gh/somebody/gvp/main?urlpath=lab/tree/notebooks/00_a.ipynb" in page
