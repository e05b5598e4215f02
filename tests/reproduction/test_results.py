import os
import platform
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gvp_lib
from gvp_book.results import read_result, rounded, write_result
from gvp_lib import jobs
from gvp_lib.errors import InvalidParameterError, ResultError
from gvp_lib.evaluation.statistics import summarize

pytestmark = pytest.mark.check


def write(path: Path, content: Any = None, **more: Any) -> dict[str, Any]:
    said = {
        "name": "a try",
        "command": "gvp reproduce a-try",
        "seeds": range(3),
        "replayed": "its first episodes",
        **more,
    }
    write_result(path, content=content, **said)
    return read_result(path)


@pytest.fixture
def source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A library of two modules that stands in for ours."""
    root = tmp_path / "checkout" / "gvp_lib"
    for place in ("__init__.py", "evaluation/statistics.py", "geometry/camera.py"):
        (root / place).parent.mkdir(parents=True, exist_ok=True)
        (root / place).write_text("as_it_was = True")
    monkeypatch.setattr(jobs, "_SOURCE", root)
    return root


def test_a_result_says_what_made_it(tmp_path: Path) -> None:
    result = write(tmp_path / "new" / "a.json", {"error_deg": [1.5, 2]}, renderer="llvmpipe")
    assert result["name"] == "a try"
    assert result["command"] == "gvp reproduce a-try"
    assert result["seeds"] == [0, 1, 2]
    assert result["replayed"] == "its first episodes"
    assert result["content"] == {"error_deg": [1.5, 2]}
    assert set(result["versions"]) == {"python", "gvp_lib", "numpy", "scipy", "opencv", "mujoco", "mink"}
    assert result["versions"]["numpy"] == np.__version__
    assert result["hardware"]["cores"] == os.cpu_count()
    assert result["hardware"]["renderer"] == "llvmpipe"


@pytest.mark.parametrize("seeds", [7, np.int64(7), [7], (7,)])
def test_one_seed_is_a_list_of_one(seeds: Any, tmp_path: Path) -> None:
    write_result(tmp_path / "a.json", name="a", command="b", seeds=seeds, replayed="all", content=None)
    assert read_result(tmp_path / "a.json")["seeds"] == [7]


def test_the_same_result_is_the_same_bytes_without_host_or_path(tmp_path: Path) -> None:
    write(tmp_path / "a.json", [0.1])
    write(tmp_path / "b.json", [0.1])
    text = (tmp_path / "a.json").read_text()
    assert text == (tmp_path / "b.json").read_text()
    assert str(Path(gvp_lib.__file__).parent) not in text
    assert platform.node() not in text or len(platform.node()) < 4


def test_numbers_come_back_to_the_last_bit(tmp_path: Path) -> None:
    numbers = [0.1 + 0.2, 1e-320, 2**60 + 1]
    assert write(tmp_path / "a.json", numbers)["content"] == numbers


def test_summaries_and_arrays_may_stand_in_a_result(tmp_path: Path) -> None:
    content = {"summary": summarize([1.0]), "array": np.eye(2), "n": np.int64(3), "ok": np.True_, "x": (1, None)}
    stored = write(tmp_path / "a.json", content)["content"]
    assert stored["summary"]["interval"] == {"low": None, "high": None}  # one value has none
    assert stored["array"] == [[1, 0], [0, 1]]
    assert (stored["n"], stored["ok"], stored["x"]) == (3, True, [1, None])


def test_what_is_not_finite_is_null_so_that_every_reader_of_json_can_read_it(tmp_path: Path) -> None:
    assert write(tmp_path / "a.json", [float("nan"), np.inf])["content"] == [None, None]


@pytest.mark.parametrize(
    ("content", "said"), [({"a": [1, {2}]}, r"content\.a\[1\] is a set"), ({"a": {3: 1}}, r"content\.a has 3")]
)
def test_what_json_cannot_hold_is_refused_with_its_place(content: Any, said: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidParameterError, match=said):
        write(tmp_path / "a.json", content)
    assert list(tmp_path.iterdir()) == []


def test_a_write_that_fails_leaves_the_old_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path / "a.json", "old")

    def full(_: int) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="no space"):
        write(tmp_path / "a.json", "new")
    assert read_result(tmp_path / "a.json")["content"] == "old"
    assert [file.name for file in tmp_path.iterdir()] == ["a.json"]


# read_result


def test_a_result_that_is_not_there_names_those_that_are(tmp_path: Path) -> None:
    write(tmp_path / "grasps.json")
    with pytest.raises(ResultError, match=r"no result .* beside it: grasps\.json"):
        read_result(tmp_path / "grasp.json")


@pytest.mark.parametrize(
    ("text", "said"), [("{", "is not JSON"), ("[1]", "it has no name"), ('{"name": 1}', "it has no command, seeds")]
)
def test_what_is_no_result_is_refused(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(ResultError, match=said):
        read_result(tmp_path / "a.json")


# the commit


def test_the_commit_is_that_of_our_own_checkout(source: Path, tmp_path: Path) -> None:
    def git(*arguments: str) -> str:
        identity = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
        command = ["git", "-C", str(source.parent), *identity, *arguments]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

    git("init", "-q")
    git("add", ".")
    git("commit", "-qm", "first")
    head = git("rev-parse", "HEAD")
    assert write(tmp_path / "a.json")["commit"] == head
    (source.parent / "results.json").write_text("a result, not yet committed")
    assert write(tmp_path / "a.json")["commit"] == head
    (source / "geometry" / "camera.py").write_text("changed")
    assert write(tmp_path / "a.json")["commit"] == head + "+"


def test_the_commit_of_a_project_that_we_are_installed_in_is_not_ours(source: Path, tmp_path: Path) -> None:
    subprocess.run(["git", "init", "-q", str(tmp_path)], check=True)
    assert write(tmp_path / "a.json")["commit"] is None


# rounded


def test_floats_are_rounded_wherever_they_stand_and_nothing_else_is() -> None:
    data = {"a": [1.23456, (0.000123456,)], "n": 123456, "text": "1.23456", "ok": True, "none": None}
    assert rounded(data, 3) == {"a": [1.23, [0.000123]], "n": 123456, "text": "1.23456", "ok": True, "none": None}
    assert rounded(np.array([12345.6, np.nan]), 2) == [12000.0, None]


def test_a_number_of_no_digits_is_refused() -> None:
    with pytest.raises(InvalidParameterError, match="1 significant digit or more; got 0"):
        rounded(1.0, 0)
