"""The glossary: every term stands on the page that its entry names."""

import json
import re
from pathlib import Path

import pytest

BOOK = Path(__file__).parents[2] / "book"
BODY = (BOOK / "glossary.md").read_text("utf-8").partition("```{glossary}\n")[2].partition("\n```")[0]
ENTRIES = {entry.partition("\n")[0]: entry.partition("\n")[2] for entry in BODY.split("\n\n")}


def text_of(page: str) -> str:
    """Of a page of the book, without the exercises of a chapter."""
    path = (BOOK.parent if page.startswith("notebooks/") else BOOK) / page
    if path.suffix != ".ipynb":
        return path.read_text("utf-8")
    cells = json.loads(path.read_text("utf-8"))["cells"]
    return "\n".join("".join(cell["source"]) for cell in cells if not cell["id"].startswith("ex-"))


def test_terms_are_in_alphabetical_order():
    assert len(ENTRIES) > 50
    assert list(ENTRIES) == sorted(ENTRIES, key=str.lower)


def test_no_line_of_an_entry_reads_as_the_item_of_a_list():
    assert re.findall(r"^ +(?:\d+[.)]|[-*+]) .*", BODY, re.MULTILINE) == []  # "Algorithm", and on the next line "1."


@pytest.mark.parametrize("term", ENTRIES)
def test_the_page_that_an_entry_names_has_its_term(term):
    (page,) = re.findall(r"\(\[[^\]]+\]\(([^)]+)\)\.\)$", ENTRIES[term])
    words = re.split(r", | and ", term)  # "yaw, pitch"; "major and minor axis"
    pattern = "|".join(re.escape(word).replace(r"\ ", r"[\s_-]?") for word in words)
    assert re.search(pattern, text_of(page), re.IGNORECASE), f"{page} has nothing of {term!r}"
