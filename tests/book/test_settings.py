"""What a reader may set for a build: the solutions hidden, and the address of a public repository."""

import shutil
import subprocess
from pathlib import Path

import nbformat
import pytest
from snippets import ROOT, run_python

pytestmark = pytest.mark.full


@pytest.fixture(scope="module")
def build(a_chapter, tmp_path_factory):
    """Build ``html``, a book of one chapter, so that it takes seconds."""
    folder = tmp_path_factory.mktemp("a_book")
    ignored = shutil.ignore_patterns("*.md", "_*", ".*", "generated", "notebooks")
    shutil.copytree(ROOT / "book", folder / "book", ignore=ignored)
    (folder / "book" / "_static").mkdir()
    (folder / "book" / "index.md").write_text("# A book\n\n```{toctree}\nnotebooks/00_a\n```\n")
    (folder / "notebooks").mkdir()
    nbformat.write(a_chapter, folder / "notebooks" / "00_a.ipynb")

    def built(**settings: str) -> tuple[subprocess.CompletedProcess[str], Path]:
        return run_python("-m", "sphinx", "-q", "-E", "book", "html", folder=folder, **settings), folder / "html"

    return built


def test_solutions_are_hidden_and_a_public_chapter_opens_in_colab_and_binder(build):
    """By default they are shown, and without an address there are no such buttons: test_build.py."""
    ran, html = build(GVP_SOLUTIONS="hide", GVP_REPOSITORY="https://github.com/somebody/gvp")
    assert ran.returncode == 0, ran.stderr
    page = (html / "notebooks" / "00_a.html").read_text("utf-8")
    assert "Why?" in page
    for hidden in ("Because of the moon", "the_tide"):
        assert hidden not in page
    assert "moon" not in (html / "searchindex.js").read_text("utf-8")
    assert "https://colab.research.google.com/github/somebody/gvp/blob/main/notebooks/00_a.ipynb" in page
    assert "https://mybinder.org/v2/gh/somebody/gvp/main?urlpath=lab/tree/notebooks/00_a.ipynb" in page


def test_a_misspelled_setting_stops_the_build(build):
    ran, _ = build(GVP_SOLUTIONS="hid")
    assert ran.returncode != 0
    assert '"show" or "hide"; got \'hid\'' in ran.stderr
