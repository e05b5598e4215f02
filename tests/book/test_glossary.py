"""The glossary: every term stands on the page that its entry names, and every name of the library in its room."""

import json
import re

import pytest
from public_names import names_of
from snippets import ROOT

import gvp_lib

BODY = (ROOT / "book" / "glossary.md").read_text("utf-8").partition("```{glossary}\n")[2].partition("\n```")[0]
ENTRIES = {entry.partition("\n")[0]: entry.partition("\n")[2] for entry in BODY.split("\n\n")}


def test_terms_are_in_alphabetical_order_and_no_line_of_an_entry_reads_as_the_item_of_a_list():
    assert len(ENTRIES) > 50
    assert list(ENTRIES) == sorted(ENTRIES, key=str.lower)
    assert re.findall(r"^ +(?:\d+[.)]|[-*+]) .*", BODY, re.MULTILINE) == []  # "Algorithm", and on the next line "1."


@pytest.mark.parametrize("term", ENTRIES)
def test_the_page_that_an_entry_names_has_its_term(term):
    (page,) = re.findall(r"\(\[[^\]]+\]\(([^)]+)\)\.\)$", ENTRIES[term])
    text = (ROOT / ("" if page.startswith("notebooks/") else "book") / page).read_text("utf-8")
    if page.endswith(".ipynb"):  # without its exercises
        cells = (cell for cell in json.loads(text)["cells"] if not cell["id"].startswith("ex-"))
        text = "\n".join("".join(cell["source"]) for cell in cells)
    words = re.split(r", | and ", term)  # "yaw, pitch"; "major and minor axis"
    pattern = "|".join(re.escape(word).replace(r"\ ", r"[\s_-]?") for word in words)
    assert re.search(pattern, text, re.IGNORECASE), f"{page} has nothing of {term!r}"


@pytest.mark.parametrize("name", sorted({*re.findall(r"`gvp_lib\.(\w+\.\w+)", BODY)}))
def test_a_name_of_the_library_is_one_that_its_room_or_class_offers(name):
    owner, _, public = name.partition(".")
    if owner in gvp_lib.__all__:  # a class at the top, and its method
        assert hasattr(getattr(gvp_lib, owner), public)
    else:
        assert public in names_of(owner)
