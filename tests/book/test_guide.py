"""Every page of the reuse guide does what it says, block by block, in an empty folder."""

from pathlib import Path

import pytest
from snippets import ROOT, alike, blocks, run_page

GUIDE = ROOT / "book" / "guide"
RECIPES = sorted({*GUIDE.glob("*.md")} - {GUIDE / "index.md"})
every_recipe = pytest.mark.parametrize("page", RECIPES, ids=lambda page: page.stem)


@pytest.mark.full
@every_recipe
def test_a_page_of_the_guide_runs_as_it_is_printed(page: Path, tmp_path: Path) -> None:
    run_page(page, tmp_path)


@every_recipe
def test_a_page_is_listed_asserts_something_and_what_is_not_run_says_so_and_parses(page: Path) -> None:
    assert f"{{doc}}`{page.stem}`" in (GUIDE / "index.md").read_text("utf-8")
    assert any("assert " in block.text for block in blocks(page) if block.language == "python")
    for block in blocks(page, shown=True):
        assert ":caption: Not run here" in block.text
        compile(block.code, str(page), "exec")


def test_a_page_whose_output_differs_fails(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    text = "```python\n# mine.py\nX = 2\n```\n```python\nfrom mine import X\nprint('x', X)\n```\n```text\nx 2\n```\n"
    page.write_text(text)
    run_page(page, tmp_path)
    page.write_text(text.replace("\nx 2\n", "\nx 20\n"))
    with pytest.raises(AssertionError, match=r"page\.md, line 10: line 6 printed"):
        run_page(page, tmp_path)


@pytest.mark.parametrize(
    ("printed", "expected", "same"),
    [
        ("aligned, 1.4 deg", "aligned, 1.3 deg", True),
        ("aligned, 1.9 deg", "aligned, 1.3 deg", False),
        ("lost, 1.3 deg", "aligned, 1.3 deg", False),
        ("1045 px", "1000 px", True),
        ("1 2", "1", False),
    ],
)
def test_numbers_may_differ_a_little_and_words_may_not(printed: str, expected: str, same: bool) -> None:
    assert alike(printed, expected) is same
