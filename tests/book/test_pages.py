"""The generated pages: nothing of the library or the book is left out, and what they name exists."""

import json
import re

import pages
import pytest
from snippets import ROOT

CHAPTERS = sorted((ROOT / "notebooks").glob("*.ipynb"))


@pytest.fixture(scope="module")
def maps() -> tuple[str, str]:
    """The map of the thesis, and the table below it."""
    return "\n".join(pages.map_table()), "\n".join(pages.others_table())


def test_every_module_that_cites_the_thesis_is_on_the_map_with_a_test_and_every_other_below_it(maps):
    told, others = maps
    for path in (path for room in pages.ROOMS for path in room.glob("*.py") if path.stem != "__init__"):
        home = ROOT / "gvp_lib" if path.is_relative_to(ROOT / "gvp_lib") else ROOT / "book"
        place = f"`{path.relative_to(home).as_posix()}`"
        assert (place in told) != (place in others), place
    for place in ("perception/blobs.py", "motion/arc.py", "planning/image_moments.py", "learning/training.py"):
        assert f"`{place}`" in told
    for module in pages.read_modules():
        if module.sections and module.place.split("/")[0] in ("motion", "perception", "planning", "learning"):
            assert module.tests, module.place


def test_every_file_and_chapter_that_the_map_names_exists(maps):
    told = "".join(maps)
    for place in re.findall(r"`([\w/]+\.py)`", told):
        assert any((ROOT / folder / place).exists() for folder in ("gvp_lib", "book", "tests")), place
    linked = set(re.findall(r"notebooks/(\w+)\.ipynb", told))
    assert linked == {path.stem for path in CHAPTERS if path.stem[:2].isdigit()}


@pytest.mark.parametrize(("cited", "sections"), [
    ("A.3, Figs. 2.5 and 2.6; errata 21", ("A.3",)),
    ("2.3, Algorithm 3, Figs. 2.3 and 2.4; 3.1.2 and 3.1.6, Table 3.1, Fig. 3.2", ("2.3", "3.1.2", "3.1.6")),
    ("Abstract; chapter 4, the conclusion", ("Abstract", "4")),
])  # fmt: skip
def test_sections_are_read_without_figures_tables_and_errata(cited, sections):
    assert pages.sections_in(cited) == sections


def test_the_page_of_claims_has_a_verdict_and_a_rule_for_every_claim():
    judged = pages.judge_all(pages.Results(pages.RESULTS))
    told = "\n".join(pages.claims_page(judged))
    for each in judged:
        assert f"**{each.claim.says}**" in told
        assert all(f"`{command}`" in told for command in each.commands)
    assert told.count("[Holds if ") == sum(each.found is not None for each in judged)


def test_each_stored_result_says_what_of_it_the_tests_run_again():
    results = pages.Results(pages.RESULTS)
    told = "\n".join(pages.results_table(results))
    for name in results:
        assert results.result(name)["replayed"].startswith(
            ("its first episodes", "the first pictures of its networks'", "nothing: times are the machine's")
        )
        assert results.result(name)["replayed"] in told


def test_the_table_of_contents_has_each_chapter_by_its_number_and_title():
    index = (ROOT / "book" / "index.md").read_text("utf-8")
    told = re.findall(r"^(\d\d)  (.+) <notebooks/(\w+)>$", index, re.MULTILINE)
    heads = {}
    for path in CHAPTERS:
        if path.stem[:2].isdigit():
            head = "".join(json.loads(path.read_text("utf-8"))["cells"][0]["source"])
            heads[path.stem] = head.partition("\n")[0].removeprefix("# ")
    assert sorted(told) == [(stem[:2], title, stem) for stem, title in heads.items()]
