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
import sys
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

from gvp_lib.views.page import SCENE_MIME

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "book"))
import chapters  # noqa: E402
from handout import hand_out  # noqa: E402
from skeleton import (  # noqa: E402
    SkeletonError,
    neighbors_line,
    reading_minutes,
    solution_cells,
    source,
    title,
    without_solutions,
)

NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
CHAPTERS = {path: json.loads(path.read_text("utf-8")) for path in NOTEBOOKS}
# An appendix, from 09 on, looks things up and has nothing to exercise; all else holds for it, too.
TAUGHT = [path for path in NOTEBOOKS if int(path.name[:2]) < 9]
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
    return [
        (cell, output["data"])
        for cell in code_cells(path)
        for output in cell["outputs"]
        if kind in output.get("data", {})
    ]


def unpacked(view):
    """What the player of a stored scene reads."""
    return json.loads(gzip.decompress(base64.b64decode(view[SCENE_MIME]["scene"])))


@every_chapter
def test_a_head_says_aim_thesis_what_is_seen_library_and_time(path):
    paragraphs = source(CHAPTERS[path]["cells"][0]).split("\n\n")
    assert [p[: len(start)] for p, start in zip(paragraphs, HEAD, strict=True)] == HEAD
    assert re.search(r"\n\*\*Run time:\*\* about \d+ s, as measured on \d+ \S+ cores\.$", paragraphs[-1])
    assert "{cite:p}`smith2020`" in paragraphs[3]
    files = re.findall(r"\[`([^`]+)`\]\(\.\./(gvp_lib/|book/)([^)]+)\)", paragraphs[5])
    assert len(files) >= 2
    for name, folder, file in files:
        assert name == file
        assert (ROOT / folder / file).is_file(), file


@every_chapter
def test_a_head_leads_to_the_neighbors_and_tells_the_reading_time(path):
    head = source(CHAPTERS[path]["cells"][0])
    titles = {each: title(notebook) for each, notebook in CHAPTERS.items()}
    mend = "; python book/store.py --heads writes it"
    assert neighbors_line(path, NOTEBOOKS, titles) in head.split("\n\n"), path.name + mend
    assert f"about {reading_minutes(CHAPTERS[path])} min," in head, path.name + mend


@taught_chapter
def test_parts_stand_in_one_order(path):
    assert len(re.findall(r"^# ", markdown(path), re.MULTILINE)) == 1
    headings = re.findall(r"^## (.+)$", markdown(path), re.MULTILINE)
    assert headings[-3:] == ["Key ideas", "Exercises", "What comes next"]
    assert len(headings) == len(set(headings)) >= 6
    assert source(CHAPTERS[path]["cells"][1]).startswith("## "), "prose that says why, before any code"


@taught_chapter
def test_key_ideas_are_a_list_and_the_end_leads_on(path):
    ideas = markdown(path).partition("## Key ideas")[2].partition("## Exercises")[0].strip()
    assert all(line.startswith("- ") for line in ideas.splitlines())
    assert len(ideas.splitlines()) >= 4
    assert len(markdown(path).partition("## What comes next")[2].split()) >= 8


@every_chapter
def test_cells_are_short(path):
    lines = [len(source(cell).splitlines()) for cell in code_cells(path)]
    assert max(lines) <= 30
    assert statistics.median(lines) <= 8


@every_chapter
def test_code_is_introduced_by_prose(path):
    run = 0
    for cell in CHAPTERS[path]["cells"]:
        run = run + 1 if cell["cell_type"] == "code" else 0
        assert run <= 6, f"seven code cells in a row, up to {source(cell)[:50]!r}"


@taught_chapter
def test_a_3d_scene_moves(path):
    views = [data for _, data in outputs(path, SCENE_MIME)]
    moving = [payload["animation"] for payload in map(unpacked, views) if "animation" in payload]
    assert any(len(each["times"]) > 20 and each["tracks"] for each in moving)
    assert all(len(view[SCENE_MIME]["title"].split()) >= 4 for view in views), "a title says what is to be seen"


@every_chapter
def test_every_chapter_has_a_recorded_scene_and_a_picture_where_no_script_runs(path):
    views = [data for _, data in outputs(path, SCENE_MIME)]
    assert any("animation" in unpacked(view) for view in views), "no scene of this chapter moves"
    for view in views:
        assert view["image/png"], "a code host shows a picture"
        assert "3D view" in "".join(view["text/plain"])


@every_chapter
def test_figures_have_captions_names_and_descriptions(path):
    for cell, data in outputs(path, "image/png"):
        if SCENE_MIME in data:
            continue
        told = cell["metadata"].get("mystnb", {})
        what = source(cell)[-80:]
        assert told.get("figure", {}).get("name", "").startswith("fig-"), what
        assert len(told["figure"].get("caption", "").split()) >= 4, what
        assert len(told.get("image", {}).get("alt", "").split()) >= 4, what


@every_chapter
def test_spelling_is_american(path):
    british = r"\b(towards|afterwards|per cent|grey|colour\w*|centre\w*"  # codespell:ignore
    british += r"|metres?|behaviour|neighbour\w*|learnt)\b"  # codespell:ignore
    captions = " ".join(json.dumps(cell["metadata"], ensure_ascii=False) for cell in code_cells(path))
    assert not re.findall(british, markdown(path) + captions)


def exercises(path):
    return EXERCISE.findall("\n\n".join(map(source, CHAPTERS[path]["cells"])))


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
def test_each_exercise_has_a_hint_a_check_a_cell_for_the_answer_and_a_solution(path):
    cells = CHAPTERS[path]["cells"]
    ids = [cell["id"] for cell in cells]
    solutions = solution_cells(cells)
    assert [label for _, label, _ in exercises(path)] == list(solutions)
    for label, gates in solutions.items():
        posed, answer = ids.index(label), ids.index(f"{label}-answer")
        assert ":::{hint}\n:class: dropdown\n\n" in source(cells[posed])
        checks = cells[posed + 1 : answer]
        assert checks
        assert all(check["metadata"]["tags"] == ["hide-input"] for check in checks)
        assert answer == gates.start - 1
        assert ":class: dropdown" in source(cells[gates.start])
        assert source(cells[gates.stop - 1]).endswith(":::{solution-end}\n:::")


@taught_chapter
def test_each_check_accepts_its_solution_and_says_why_other_answers_are_wrong(path):
    cells = CHAPTERS[path]["cells"]
    ids = [cell["id"] for cell in cells]
    for label, gates in solution_cells(cells).items():
        solved, wrong = (source(cells[ids.index(f"{label}-{which}")]) for which in ("solved", "wrong"))
        assert {ids.index(f"{label}-solved"), ids.index(f"{label}-wrong")} <= set(gates)
        accepted = [node for node in ast.walk(ast.parse(solved)) if isinstance(node, ast.Assert)]
        assert any('"Right' in ast.unparse(node).replace("'", '"') for node in accepted), label
        rejected = [node.test for node in ast.walk(ast.parse(wrong)) if isinstance(node, ast.Assert)]
        reasons = {ast.unparse(test.left) for test in rejected if isinstance(test, ast.Compare)}
        assert len(reasons) >= 2, f"{label}: at least two wrong answers, each with a reason of its own"


@every_chapter
def test_every_stored_output_is_of_a_run_without_errors(path):
    for cell in code_cells(path):
        assert cell["execution_count"], source(cell)[:50]
        assert not any(output["output_type"] == "error" for output in cell["outputs"])


def test_links_of_a_clone_become_links_of_the_book(monkeypatch, tmp_path):
    monkeypatch.setattr(chapters, "BOOK", tmp_path)
    (tmp_path / "api").mkdir()
    (tmp_path / "api" / "motion.md").touch()
    text = "[A](../book/a.md), [`motion/arc.py`](../gvp_lib/motion/arc.py), [`views/page.py`](../gvp_lib/views/page.py)"
    assert chapters.as_in_the_book(text) == "[A](../a.md), [`motion/arc.py`](../api/motion.md), `views/page.py`"
    assert chapters.as_in_the_book("[`gvp_book/tables.py`](../book/gvp_book/tables.py)") == "`gvp_book/tables.py`"


# --- without solutions -----------------------------------------------------------------------------------------------
def names(cells, context):
    """Names that cells bind (ast.Store) or use (ast.Load)."""
    found = set()
    for cell in cells:
        tree = ast.parse(re.sub(r"^\s*[%!].*$", "", source(cell), flags=re.MULTILINE))
        for node in ast.walk(tree):
            if isinstance(node, ast.Name) and isinstance(node.ctx, context):
                found.add(node.id)
            if context is ast.Store and isinstance(node, ast.FunctionDef | ast.ClassDef):
                found.add(node.name)
            if context is ast.Store and isinstance(node, ast.alias):
                found.add((node.asname or node.name).partition(".")[0])
    return found


@taught_chapter
def test_a_chapter_needs_none_of_its_solutions(path):
    cells = CHAPTERS[path]["cells"]
    kept = [cell for cell in without_solutions(CHAPTERS[path])["cells"] if cell["cell_type"] == "code"]
    hidden = [cells[k] for gates in solution_cells(cells).values() for k in gates if cells[k]["cell_type"] == "code"]
    lost = names(hidden, ast.Store) - names(kept, ast.Store) - set(dir(builtins))
    assert not lost & names(kept, ast.Load)


def test_a_handout_has_the_exercises_and_no_solution(tmp_path):
    written = hand_out(tmp_path / "handout")
    assert [path.name for path in written] == [path.name for path in NOTEBOOKS]
    for chapter, copy in zip(NOTEBOOKS, written, strict=True):
        text = copy.read_text("utf-8")
        assert "{solution" not in text
        assert text.count(":::{exercise}") == len(exercises(chapter))
        nbformat.validate(nbformat.reads(text, as_version=4))


def test_a_handout_does_not_overwrite_the_chapters():
    with pytest.raises(SystemExit, match="name another folder"):
        hand_out(ROOT / "notebooks")


@pytest.mark.full
def test_a_handout_runs(tmp_path):
    tour = hand_out(tmp_path)[0]
    NotebookClient(nbformat.read(tour, as_version=4), timeout=600, kernel_name="python3").execute()


def test_a_solution_outside_its_gates_is_not_handed_out():
    left = {"cells": [{"cell_type": "markdown", "source": "```{solution} ex-a\nSo.\n```"}]}
    with pytest.raises(SkeletonError, match=r"put it between :::\{solution-start\}"):
        without_solutions(left)
    open_end = {"cells": [{"cell_type": "markdown", "source": ":::{solution-start} ex-a\n:::"}]}
    with pytest.raises(SkeletonError, match=r"ex-a has no :::\{solution-end\}"):
        without_solutions(open_end)
