"""Every chapter on one skeleton (CONTRIBUTING.md): its head, its parts in order, its scenes, figures and exercises.

That the solutions run, and that each self-check accepts its solution and says why a wrong answer is wrong, is asserted
in the chapters' own cells, which `make test` executes under nbval. Here it is held that those cells are there.
"""

import ast
import base64
import builtins
import gzip
import json
import re
import statistics
import symtable
from pathlib import Path

import chapters
import nbformat
import pytest
from handout import hand_out
from skeleton import SkeletonError, neighbors_line, reading_minutes, solution_cells, source, title, without_solutions

from gvp_lib.views.page import SCENE_MIME

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
CHAPTERS = {path: json.loads(path.read_text("utf-8")) for path in NOTEBOOKS}
# The appendix, 09, looks things up and has nothing to exercise; all else holds for it, too.
TAUGHT = [path for path in NOTEBOOKS if path.name[:2] != "09"]
HEAD = ["# ", "← ", "**Aim.** ", "**Thesis.** ", "**You will have seen** ", "**Library.** ", "**Reading time:** about "]
EXERCISE = re.compile(r"^:::\{exercise\} ([^\n]+)\n:label: (ex-\S+)\n\n(.*?)^:::$", re.DOTALL | re.MULTILINE)
STARS = {"★☆☆": "Easy.", "★★☆": "Medium.", "★★★": "Hard."}

every_chapter = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
taught_chapter = pytest.mark.parametrize("path", TAUGHT, ids=lambda path: path.stem)


def markdown(path):
    """The chapter's prose, without fenced blocks, whose lines may look like headings."""
    cells = [source(cell) for cell in CHAPTERS[path]["cells"] if cell["cell_type"] == "markdown"]
    return re.sub(r"^```.*?^```$", "", "\n\n".join(cells), flags=re.DOTALL | re.MULTILINE)


def code_cells(path):
    return [cell for cell in CHAPTERS[path]["cells"] if cell["cell_type"] == "code"]


def outputs(path, kind):
    """The cells with an output of that kind, and its data."""
    given = [(cell, output.get("data", {})) for cell in code_cells(path) for output in cell["outputs"]]
    return [(cell, data) for cell, data in given if kind in data]


def exercises(path):
    """Name, label and text of each."""
    return EXERCISE.findall("\n\n".join(map(source, CHAPTERS[path]["cells"])))


# --- the skeleton -----------------------------------------------------------------------------------------------------


@every_chapter
def test_a_head_says_aim_thesis_what_is_seen_library_and_time_and_leads_to_the_neighbors(path):
    paragraphs = source(CHAPTERS[path]["cells"][0]).split("\n\n")
    assert [p[: len(start)] for p, start in zip(paragraphs, HEAD, strict=True)] == HEAD
    assert re.search(r"\n\*\*Run time:\*\* about \d+ s, as measured on \d+ \S+ cores\.$", paragraphs[-1])
    assert "{cite:p}`smith2020`" in paragraphs[3]
    files = re.findall(r"\[`([^`]+)`\]\(\.\./(gvp_lib/|book/)([^)]+)\)", paragraphs[5])
    assert len(files) >= 2
    for name, folder, file in files:
        assert name == file
        assert (ROOT / folder / file).is_file(), file
    mend = f"{path.name}; python book/store.py --heads writes it"
    titles = {each: title(notebook) for each, notebook in CHAPTERS.items()}
    assert neighbors_line(path, NOTEBOOKS, titles) in paragraphs, mend
    assert f"about {reading_minutes(CHAPTERS[path])} min," in paragraphs[-1], mend


@taught_chapter
def test_parts_stand_in_one_order_with_key_ideas_and_an_end_that_leads_on(path):
    text = markdown(path)
    assert len(re.findall(r"^# ", text, re.MULTILINE)) == 1
    headings = re.findall(r"^## (.+)$", text, re.MULTILINE)
    assert headings[-3:] == ["Key ideas", "Exercises", "What comes next"]
    assert len(headings) == len(set(headings)) >= 6
    assert source(CHAPTERS[path]["cells"][1]).startswith("## "), "prose that says why, before any code"
    ideas = text.partition("## Key ideas")[2].partition("## Exercises")[0].strip().splitlines()
    assert all(line.startswith("- ") for line in ideas)
    assert len(ideas) >= 4
    assert len(text.partition("## What comes next")[2].split()) >= 8


@every_chapter
def test_cells_are_short_introduced_by_prose_and_stored_from_a_run_without_errors(path):
    lines = [len(source(cell).splitlines()) for cell in code_cells(path)]
    assert max(lines) <= 30
    assert statistics.median(lines) <= 8
    kinds = "".join(cell["cell_type"][0] for cell in CHAPTERS[path]["cells"])
    assert "c" * 7 not in kinds, "seven code cells in a row"
    for cell in code_cells(path):
        assert cell["execution_count"], source(cell)[:50]
        assert not any(output["output_type"] == "error" for output in cell["outputs"])


@every_chapter
def test_a_3d_scene_moves_and_each_has_a_title_and_a_picture_where_no_script_runs(path):
    moving = []
    for _, view in outputs(path, SCENE_MIME):
        assert len(view[SCENE_MIME]["title"].split()) >= 4, "a title says what is to be seen"
        assert view["image/png"], "a code host shows a picture"
        assert "3D view" in "".join(view["text/plain"])
        moving.append(json.loads(gzip.decompress(base64.b64decode(view[SCENE_MIME]["scene"]))).get("animation"))
    assert any(each and len(each["times"]) > (20 if path in TAUGHT else 1) and each["tracks"] for each in moving)


@every_chapter
def test_figures_have_captions_names_and_descriptions(path):
    for cell, data in outputs(path, "image/png"):
        if SCENE_MIME not in data:
            told, what = cell["metadata"].get("mystnb", {}), source(cell)[-80:]
            assert told.get("figure", {}).get("name", "").startswith("fig-"), what
            assert len(told["figure"].get("caption", "").split()) >= 4, what
            assert len(told.get("image", {}).get("alt", "").split()) >= 4, what


@every_chapter
def test_spelling_is_american_also_where_codespell_minds_no_difference(path):
    words = markdown(path) + "".join(json.dumps(cell["metadata"], ensure_ascii=False) for cell in code_cells(path))
    assert not re.findall(r"\b(towards|afterwards|per cent|learnt)\b", words)  # codespell:ignore


# --- exercises --------------------------------------------------------------------------------------------------------


@taught_chapter
def test_three_exercises_or_more_from_easy_to_hard(path):
    marks = []
    for name, label, text in exercises(path):
        stars = re.match(r'<span aria-hidden="true">(★.+?)</span> \*(\w+\.)\* ', text)
        assert stars, f"{label} ({name}) has no stars"
        assert STARS[stars[1]] == stars[2], "a screen reader reads the word"
        marks.append(stars[1].count("★"))
    assert len(marks) >= 3
    assert marks == sorted(marks)
    assert {1, 3} <= set(marks)


@taught_chapter
def test_each_exercise_has_a_hint_a_cell_for_the_answer_a_solution_and_a_check_that_says_why_others_are_wrong(path):
    cells = CHAPTERS[path]["cells"]
    ids = [cell["id"] for cell in cells]
    solutions = solution_cells(cells)
    assert [label for _, label, _ in exercises(path)] == list(solutions)
    for label, gates in solutions.items():
        posed, answer, solved, wrong = (ids.index(label + which) for which in ("", "-answer", "-solved", "-wrong"))
        assert ":::{hint}\n:class: dropdown\n\n" in source(cells[posed])
        checks = cells[posed + 1 : answer]
        assert checks
        assert all(check["metadata"]["tags"] == ["hide-input"] for check in checks)
        assert answer == gates.start - 1
        assert ":class: dropdown" in source(cells[gates.start])
        assert source(cells[gates.stop - 1]).endswith(":::{solution-end}\n:::")
        assert {solved, wrong} <= set(gates)
        accepted, rejected = (
            [node.test for node in ast.walk(ast.parse(source(cells[k]))) if isinstance(node, ast.Assert)]
            for k in (solved, wrong)
        )
        assert any(re.search("['\"]Right", ast.unparse(test)) for test in accepted), label
        reasons = {ast.unparse(test.left) for test in rejected if isinstance(test, ast.Compare)}
        assert len(reasons) >= 2, f"{label}: at least two wrong answers, each with a reason of its own"


def names(cells, chosen):
    """Names in cells and in their functions, by what the cells do with them."""
    code = "\n".join(re.sub(r"^\s*[%!].*$", "", source(cell), flags=re.MULTILINE) for cell in cells)
    tables = [symtable.symtable(code, "cells", "exec")]
    for table in tables:
        tables += table.get_children()
    return {symbol.get_name() for table in tables for symbol in table.get_symbols() if chosen(symbol)}


@taught_chapter
def test_a_chapter_needs_none_of_its_solutions(path):
    cells = CHAPTERS[path]["cells"]
    kept = [cell for cell in without_solutions(CHAPTERS[path])["cells"] if cell["cell_type"] == "code"]
    hidden = [cells[k] for gates in solution_cells(cells).values() for k in gates if cells[k]["cell_type"] == "code"]
    bound, used = symtable.Symbol.is_assigned, symtable.Symbol.is_referenced
    lost = names(hidden, bound) - names(kept, bound) - set(dir(builtins))
    assert not lost & names(kept, used)


def test_a_handout_has_the_exercises_and_no_solution_and_does_not_overwrite_the_chapters(tmp_path):
    written = hand_out(tmp_path / "handout")
    assert [path.name for path in written] == [path.name for path in NOTEBOOKS]
    for chapter, copy in zip(NOTEBOOKS, written, strict=True):
        text = copy.read_text("utf-8")
        assert "{solution" not in text
        assert text.count(":::{exercise}") == len(exercises(chapter))
        nbformat.validate(nbformat.reads(text, as_version=4))
    with pytest.raises(SystemExit, match="name another folder"):
        hand_out(ROOT / "notebooks")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("```{solution} ex-a\nSo.\n```", r"put it between :::\{solution-start\}"),
        (":::{solution-start} ex-a\n:::", r"ex-a has no :::\{solution-end\}"),
    ],
)
def test_a_solution_outside_its_gates_is_not_handed_out(text, said):
    with pytest.raises(SkeletonError, match=said):
        without_solutions({"cells": [{"cell_type": "markdown", "source": text}]})


def test_links_of_a_clone_become_links_of_the_book(monkeypatch, tmp_path):
    monkeypatch.setattr(chapters, "BOOK", tmp_path)
    (tmp_path / "api").mkdir()
    (tmp_path / "api" / "motion.md").touch()
    text = "[A](../book/a.md), [`motion/arc.py`](../gvp_lib/motion/arc.py), [`views/page.py`](../gvp_lib/views/page.py)"
    assert chapters.as_in_the_book(text) == "[A](../a.md), [`motion/arc.py`](../api/motion.md), `views/page.py`"
    assert chapters.as_in_the_book("[`gvp_book/tables.py`](../book/gvp_book/tables.py)") == "`gvp_book/tables.py`"
