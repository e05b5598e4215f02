"""What runs the notebooks: into copies, only what has changed, and stored only where a result has."""

import base64
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import execute
import nbformat
import numpy as np
import pytest
import store

ROOT = Path(__file__).parents[2]


@pytest.fixture
def book(tmp_path, monkeypatch):
    """A book of one's own: writes a chapter, runs what is not up to date, and tells how often a chapter's code ran."""
    for name in ("notebooks", "copies", "results"):
        (tmp_path / name).mkdir()
        monkeypatch.setattr(execute, name.upper(), tmp_path / name)
    monkeypatch.setattr(execute, "LOCK", tmp_path / "lock.txt")
    for name in execute.THREADS:  # so that what is set for the kernels is taken back
        monkeypatch.setenv(name, "1")
    (tmp_path / "lock.txt").write_text("numpy==2.0\n")
    (tmp_path / "results" / "table-9.json").write_text("{}")
    monkeypatch.setattr(execute, "hash_of_library", lambda: "as it was")

    class Book:
        folder = tmp_path

        def write(self, name, *sources, prose="# A chapter\n\n**Run time:** about 5 s, as measured."):
            cells = [nbformat.v4.new_code_cell(source, id=f"cell-{k}") for k, source in enumerate(sources)]
            notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_markdown_cell(prose, id="head"), *cells])
            path = tmp_path / "notebooks" / f"{name}.ipynb"
            nbformat.write(notebook, path)
            return path

        def run(self):
            return execute.run_all(execute.chapters(), 2)

        def copy(self, name):
            return nbformat.read(tmp_path / "copies" / f"{name}.ipynb", as_version=4)

        def runs(self):
            return (tmp_path / "runs.txt").read_text().count("ran")

    return Book()


COUNTED = "with open('../runs.txt', 'a') as file:\n    file.write('ran ')\nprint('table-9')"


@pytest.mark.check
def test_outputs_go_to_a_copy_and_what_is_up_to_date_is_not_run_again(book, capsys):
    path = book.write("00_a", COUNTED)
    before = path.read_bytes()
    assert book.run()
    assert "[ 1/1] 00_a" in capsys.readouterr().out
    assert path.read_bytes() == before
    assert book.copy("00_a").cells[1].outputs[0].text == "table-9\n"
    assert book.run()
    assert capsys.readouterr().out == "1 of 1 chapters are up to date\n"
    assert book.runs() == 1


def test_a_notebook_runs_again_where_its_code_the_library_its_results_or_the_lock_changed(book, monkeypatch):
    changes = [
        lambda: book.write("00_a", COUNTED, "more = 1"),
        lambda: monkeypatch.setattr(execute, "hash_of_library", lambda: "another"),
        lambda: (book.folder / "results" / "table-9.json").write_text('{"n": 1}'),
        lambda: (book.folder / "lock.txt").write_text("numpy==2.1\n"),
    ]
    book.write("00_a", COUNTED)
    assert book.run()
    for number, change in enumerate(changes, start=1):
        change()
        assert book.run()
        assert book.runs() == 1 + number
    (book.folder / "results" / "table-8.json").write_text("{}")  # which it does not name
    book.write("00_a", COUNTED, "more = 1", prose="# Other words")
    assert book.run()
    assert book.runs() == 1 + len(changes)
    assert book.copy("00_a").cells[0].source == "# Other words"


def test_a_notebook_that_fails_is_named_and_the_others_run(book, capsys):
    book.write("00_a", "1 / 0")
    book.write("01_b", COUNTED)
    assert not book.run()
    told = capsys.readouterr()
    assert re.search("00_a.ipynb failed.*ZeroDivisionError", told.err, re.DOTALL)
    assert "01_b" in told.out
    assert not (book.folder / "copies" / "00_a.ipynb").exists()
    assert book.runs() == 1


@pytest.mark.full
def test_an_interrupted_call_keeps_what_ran_and_ends_its_kernels(book):
    ran = book.write("00_a", COUNTED)
    pid = book.folder / "kernel.txt"
    book.write("01_b", f"import os, time; open({str(pid)!r}, 'w').write(str(os.getpid())); time.sleep(600)")
    program = (
        "import signal, sys, execute; from pathlib import Path\n"
        # A shell that runs the tests in the background has them, and what they start, ignore interrupts.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        f"folder = Path({str(book.folder)!r})\n"
        "execute.NOTEBOOKS, execute.COPIES = folder / 'notebooks', folder / 'copies'\n"
        "execute.RESULTS, execute.LOCK = folder / 'results', folder / 'lock.txt'\n"
        "execute.hash_of_library = lambda: 'as it was'\n"
        "sys.argv = ['execute.py', '--workers', '2']\n"
        "sys.exit(execute.main())"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT / "book"), str(ROOT)])}
    running = subprocess.Popen([sys.executable, "-c", program], env=environment, start_new_session=True)
    wait_for(lambda: (book.folder / "copies" / "00_a.ipynb").exists() and pid.exists() and pid.read_text())
    os.killpg(running.pid, signal.SIGINT)
    assert running.wait(60) == 130
    wait_for(lambda: not Path(f"/proc/{pid.read_text()}").exists())
    assert execute.is_current(ran)


def wait_for(condition, seconds=120):
    limit = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < limit
        time.sleep(0.1)


# --- storing ----------------------------------------------------------------------------------------------------------


def stream(text):
    return nbformat.v4.new_output("stream", name="stdout", text=text)


def shown(picture, **more):
    png = base64.b64encode(cv2.imencode(".png", picture)[1]).decode()
    return nbformat.v4.new_output("display_data", {"image/png": png, "text/plain": "<Figure>", **more})


def scene(size):
    return shown(SQUARE, **{store.SCENE_MIME: {"scene": "x" * size, "title": "a"}})


SQUARE = np.zeros((200, 300, 3), np.uint8)
SQUARE[50:100, 60:90] = 255


@pytest.mark.parametrize(("stored", "new", "same"), [
    (stream("error 1.2345 deg"), stream("error 1.2346 deg"), True),
    (stream("error 1.23 deg"), stream("error 1.43 deg"), False),
    (stream("aligned"), stream("target lost"), False),
    (stream("-0.001"), stream("0.001"), False),
    (shown(SQUARE), shown(np.roll(SQUARE, 1, axis=1)), True),  # an edge that has moved by a pixel
    (shown(SQUARE), shown(np.roll(SQUARE, 40, axis=1)), False),
    (shown(SQUARE), shown(SQUARE[:, :200]), False),
    (scene(9000), scene(9000), True),
    (scene(9000), scene(4000), False),  # with less in it, although its still is the same
], ids=range(9))  # fmt: skip
def test_outputs_say_the_same_where_they_differ_in_last_digits_or_by_a_pixel(stored, new, same):
    assert store.say_the_same([stored], [new]) == same
    assert not store.say_the_same([stored], [])


def test_storing_changes_only_outputs_that_say_something_else_and_a_run_time_that_is_clearly_another(book):
    path = book.write("00_a", "print(1.00001)", "print('new')")
    assert book.run()
    stored = nbformat.read(path, as_version=4)
    stored.cells[1].outputs, stored.cells[2].outputs = [stream("1.00002\n")], [stream("old\n")]
    nbformat.write(stored, path)
    store.store([path])
    found = nbformat.read(path, as_version=4)
    assert [cell.outputs[0].text for cell in found.cells[1:]] == ["1.00002\n", "new\n"]
    assert "**Run time:** about 5 s, as measured." in found.cells[0].source
    assert "gvp" not in found.metadata
    store.tell_run_time(found, 31.0)
    assert "**Run time:** about 30 s, as measured on" in found.cells[0].source
