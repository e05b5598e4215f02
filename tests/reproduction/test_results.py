"""Stored results: they say what made them, come back to the bit, and refuse what they cannot hold."""

import os
import platform
import subprocess
from pathlib import Path

import numpy as np
import pytest

import gvp_lib
from gvp_book.results import read_result, rounded, write_result
from gvp_lib import jobs
from gvp_lib.errors import InvalidParameterError, ResultError
from gvp_lib.evaluation.statistics import summarize

pytestmark = pytest.mark.check


def write(path, content=None, seeds=range(3)):
    write_result(path, name="a try", command="gvp reproduce a-try", seeds=seeds, replayed="all of it", content=content)
    return read_result(path)


def test_a_result_says_what_made_it_and_is_the_same_bytes_without_host_or_path(tmp_path):
    result = write(tmp_path / "new" / "a.json", {"error_deg": [1.5, 2]})
    assert (result["name"], result["command"], result["replayed"]) == ("a try", "gvp reproduce a-try", "all of it")
    assert (result["seeds"], result["content"]) == ([0, 1, 2], {"error_deg": [1.5, 2]})
    assert set(result["versions"]) == {"python", "gvp_lib", "numpy", "scipy", "opencv", "mujoco", "mink"}
    assert result["versions"]["numpy"] == np.__version__
    assert result["hardware"]["cores"] == os.cpu_count()
    assert write(tmp_path / "a.json", seeds=np.int64(7))["seeds"] == [7]
    write(tmp_path / "a.json", {"error_deg": [1.5, 2]})
    text = (tmp_path / "a.json").read_text()
    assert text == (tmp_path / "new" / "a.json").read_text()
    assert str(Path(gvp_lib.__file__).parent) not in text
    assert platform.node() not in text or len(platform.node()) < 4


@pytest.mark.parametrize(("content", "stored"), [
    ([0.1 + 0.2, 1e-320, 2**60 + 1], [0.1 + 0.2, 1e-320, 2**60 + 1]),  # to the last bit
    ([float("nan"), np.inf], [None, None]),  # so that every reader of JSON can read it
    ({"array": np.eye(2), "n": np.int64(3), "ok": np.True_}, {"array": [[1, 0], [0, 1]], "n": 3, "ok": True}),
    ((1, None, "text"), [1, None, "text"]),
    (summarize([2.0]), {"n": 1, "mean": 2, "sd": None, "median": 2, "p95": 2, "interval": {"low": None, "high": None}}),
])  # fmt: skip
def test_numbers_arrays_and_summaries_come_back_as_json_has_them(content, stored, tmp_path):
    assert write(tmp_path / "a.json", content)["content"] == stored


@pytest.mark.parametrize(
    ("content", "text"), [({"a": [1, {2}]}, r"content\.a\[1\] is a set"), ({"a": {3: 1}}, r"content\.a has 3")]
)
def test_what_json_cannot_hold_is_refused_with_its_place(content, text, tmp_path):
    with pytest.raises(InvalidParameterError, match=text):
        write(tmp_path / "a.json", content)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("file", "text", "error"), [
    ("b.json", "{}", r"no result .* beside it: b\.json"),
    ("a.json", "{", "is not JSON"),
    ("a.json", "[1]", "it has no name"),
    ("a.json", '{"name": 1}', "it has no command, seeds"),
])  # fmt: skip
def test_what_is_not_there_or_no_result_is_refused(file, text, error, tmp_path):
    (tmp_path / file).write_text(text)
    with pytest.raises(ResultError, match=error):
        read_result(tmp_path / "a.json")


def test_the_commit_is_that_of_our_own_checkout_and_none_within_another_project(tmp_path, monkeypatch):
    def git(*arguments):
        identity = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
        command = ["git", "-C", str(source.parent), *identity, *arguments]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

    source = tmp_path / "checkout" / "gvp_lib"  # a library of one module that stands in for ours
    source.mkdir(parents=True)
    (source / "camera.py").write_text("as_it_was = True")
    monkeypatch.setattr(jobs, "_SOURCE", source)
    subprocess.run(["git", "init", "-q", str(tmp_path)], check=True)
    assert write(tmp_path / "a.json")["commit"] is None
    git("init", "-q")
    git("add", ".")
    git("commit", "-qm", "first")
    head = git("rev-parse", "HEAD")
    (source.parent / "results.json").write_text("a result, not yet committed")
    assert write(tmp_path / "a.json")["commit"] == head
    (source / "camera.py").write_text("changed")
    assert write(tmp_path / "a.json")["commit"] == head + "+"


def test_floats_are_rounded_wherever_they_stand_and_nothing_else_is():
    data = {"a": [1.23456, (0.000123456,)], "n": 123456, "text": "1.23456", "ok": True, "none": None}
    assert rounded(data, 3) == {"a": [1.23, [0.000123]], "n": 123456, "text": "1.23456", "ok": True, "none": None}
    assert rounded(np.array([12345.6, np.nan]), 2) == [12000.0, None]
