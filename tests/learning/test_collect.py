"""A set is the same whoever collects it, survives whatever ends a run, and what cannot be done is said."""

import errno
import io
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from other_runs import held_by_another_run
from viewpoint_sets import UR5E, collect, contents, pictures, small, table

from gvp_lib.errors import DatasetError, JournalError, WorkerDiedError
from gvp_lib.jobs import JobResult, Journal, dask_cluster, write_file
from gvp_lib.learning import collect as collecting
from gvp_lib.learning.collect import Collector
from gvp_lib.learning.recipe import CollectionRecipe, viewpoints
from gvp_lib.learning.shards import read_columns
from gvp_lib.simulation.arms import arm_spec

TESTS = Path(__file__).parent.parent
SHARDS = [f"data/train-{k:05d}-of-00004.parquet" for k in range(4)]
JOURNAL = ".collection.journal"


@pytest.fixture(autouse=True)
def importable(monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers of a cluster find the library, and draw with one thread each."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(TESTS.parent), os.environ.get("PYTHONPATH", "")]))
    monkeypatch.setenv("LP_NUM_THREADS", "1")


@pytest.fixture
def done(plain: Path, tmp_path: Path) -> Path:
    """A finished set of one's own."""
    return Path(shutil.copytree(plain, tmp_path / "done"))


@pytest.fixture
def half(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A set whose run ended at its third shard."""
    folder = tmp_path / "half"
    with full_after(monkeypatch, 2), pytest.raises(DatasetError):
        collect(folder, small())
    return folder


class full_after:
    """A disk that is full once so many shards are written, torn in the middle of the next."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, shards: int) -> None:
        self.left, self.monkeypatch = shards, monkeypatch.context()

    def __enter__(self) -> None:
        def opened(path: Path, mode: str) -> Any:
            file = open(path, mode)  # noqa: SIM115 - whoever asks closes it
            if "train-" in Path(path).name and "w" in mode:
                self.left -= 1
                if self.left < 0:
                    return Full(file)
            return file

        self.monkeypatch.__enter__().setattr("gvp_lib.jobs.open", opened, raising=False)

    def __exit__(self, *exception: object) -> None:
        self.monkeypatch.__exit__(None, None, None)


class Full(io.RawIOBase):
    """A file that takes half of what is written into it."""

    def __init__(self, file: Any) -> None:
        self.file = file

    def write(self, data: Any) -> int:
        self.file.write(data[: len(data) // 2])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def close(self) -> None:
        self.file.close()
        super().close()


# the same whoever collects it


def test_a_set_has_shards_a_card_and_a_page_and_nothing_else(plain: Path) -> None:
    assert sorted(contents(plain)) == sorted(["README.md", "card.json", *SHARDS])


@pytest.mark.full
@pytest.mark.parametrize("workers", [2, 3])
def test_any_number_of_workers_gives_the_same_bytes(workers: int, plain: Path, tmp_path: Path) -> None:
    assert collect(tmp_path / "set", small(), workers=workers).collected == 16
    assert contents(tmp_path / "set") == contents(plain)


@pytest.mark.full
def test_a_dask_cluster_gives_the_same_bytes(plain: Path, tmp_path: Path) -> None:
    from distributed import LocalCluster

    with (
        LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0") as two,
        dask_cluster(two.scheduler_address) as executor,
    ):
        collect(tmp_path / "set", small(), executor=executor)
    assert contents(tmp_path / "set") == contents(plain)


@pytest.mark.parametrize("options", [{"seed": 2}, {"sampling": "random"}, {"step": 0.2}, {"sort": False}])
def test_another_recipe_gives_another_set(options: dict[str, Any], plain: Path, tmp_path: Path) -> None:
    collect(tmp_path / "set", small(**options))
    assert contents(tmp_path / "set")[SHARDS[0]] != contents(plain)[SHARDS[0]]


@pytest.mark.full
def test_a_set_on_the_arm_is_the_same_by_one_worker_and_by_two(ur5e: Path, tmp_path: Path) -> None:
    collect(tmp_path / "set", UR5E, workers=2)
    assert contents(tmp_path / "set") == contents(ur5e)


# whatever ends a run

PROGRAM = """
import sys
from viewpoint_sets import UR5E, collect, small
if __name__ == "__main__":
    collect(sys.argv[1], small(n=64), workers=int(sys.argv[2]))
"""


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """What `PROGRAM` leaves if it is left alone."""
    return contents(collect(tmp_path_factory.mktemp("whole") / "set", small(n=64)).folder)


def start(folder: Path, tmp_path: Path, workers: int) -> subprocess.Popen[bytes]:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    paths = os.pathsep.join([str(TESTS), str(TESTS.parent)])
    command = [sys.executable, str(program), str(folder), str(workers)]
    return subprocess.Popen(command, env={**os.environ, "PYTHONPATH": paths}, stderr=subprocess.PIPE)


def noted(folder: Path) -> list[str]:
    """Shards that the journal knows of."""
    lines = (folder / JOURNAL).read_bytes().split(b"\n")[1:-1] if (folder / JOURNAL).exists() else []
    return [json.loads(line)["key"] for line in lines]


@pytest.mark.full
@pytest.mark.parametrize("workers", [1, 2])
def test_a_run_killed_at_random_moments_goes_on_and_ends_in_the_same_bytes(
    workers: int, whole: dict[str, bytes], tmp_path: Path
) -> None:
    folder, moments, known = tmp_path / "set", random.Random(workers), []
    for kill in range(3 if workers == 1 else 2):
        process = start(folder, tmp_path, workers)
        deadline = time.monotonic() + 60
        while len(noted(folder)) <= max(kill, len(known)) and process.poll() is None:
            assert time.monotonic() < deadline
            time.sleep(0.002)
        time.sleep(moments.uniform(0, 0.1))
        process.send_signal(signal.SIGKILL)
        _, said = process.communicate()
        assert process.returncode == -signal.SIGKILL, f"it ended before it was killed: {said.decode()}"
        seen = noted(folder)
        assert seen[: len(known)] == known
        for name in seen:  # what is noted is whole
            assert (folder / name).read_bytes() == whole[name]
        assert len(set(seen)) == len(seen)
        known = seen
    assert 0 < len(known) < 16
    again = collect(folder, small(n=64))
    assert again.collected == 64 - 4 * len(known)
    assert again.damaged == ()
    assert contents(folder) == whole


def test_a_run_killed_while_it_writes_leaves_nothing_behind_once_it_has_gone_on(
    half: Path, plain: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Killed(BaseException):
        pass

    def killed(*_: Any) -> None:
        raise Killed

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", killed)
        with pytest.raises(Killed):
            write_file(half / SHARDS[2], b"PAR1 torn")
    assert len(contents(half)) == 4  # two shards, the journal, and a draft
    collect(half, small())
    assert contents(half) == contents(plain)


@pytest.mark.parametrize("cut", [1, 20, 200])
def test_a_torn_end_of_the_journal_costs_its_shard_alone(cut: int, half: Path, plain: Path) -> None:
    journal = half / JOURNAL
    journal.write_bytes(journal.read_bytes()[:-cut])
    assert collect(half, small()).collected == 12
    assert contents(half) == contents(plain)


def test_a_journal_torn_in_its_first_line_is_begun_anew(half: Path, plain: Path) -> None:
    (half / JOURNAL).write_bytes((half / JOURNAL).read_bytes()[:9])
    assert collect(half, small()).collected == 16
    assert contents(half) == contents(plain)


def test_a_run_killed_between_card_and_journal_is_finished(plain: Path, half: Path) -> None:
    """Its journal is still there beside the card."""
    for name, data in contents(plain).items():
        (half / name).write_bytes(data)
    assert collect(half, small()).collected == 0
    assert contents(half) == contents(plain)


def test_collecting_a_finished_set_again_collects_and_changes_nothing(done: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in (done / "data").iterdir()}
    again = collect(done, small())
    assert (again.collected, again.damaged) == (0, ())
    assert {path: path.stat().st_mtime_ns for path in (done / "data").iterdir()} == before


def test_no_sample_is_lost_doubled_or_torn(plain: Path, ur5e: Path) -> None:
    for folder, n in ((plain, 16), (ur5e, 64)):
        assert table(folder)["index"].to_pylist() == list(range(n))
        seen = pictures(folder)
        assert {picture.shape for picture in seen} == {(128, 128, 3)}
        assert len({picture.tobytes() for picture in seen}) == n


# damage


def flip_a_byte(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-7])


DAMAGE = {"flipped": flip_a_byte, "truncated": truncate, "deleted": Path.unlink}


@pytest.mark.parametrize("kind", DAMAGE)
def test_a_damaged_shard_is_found_named_and_collected_again(kind: str, done: Path, plain: Path) -> None:
    DAMAGE[kind](done / SHARDS[2])
    with pytest.raises(DatasetError, match=rf"1 of 4 shards in .* missing or damaged.*{SHARDS[2]}; `gvp collect`"):
        read_columns(done)
    again = collect(done, small())
    assert again.damaged == (SHARDS[2],)
    assert again.collected == 4
    assert contents(done) == contents(plain)


@pytest.mark.parametrize("kind", DAMAGE)
def test_damage_in_an_unfinished_set_is_found_too(kind: str, half: Path, plain: Path) -> None:
    DAMAGE[kind](half / SHARDS[1])
    again = collect(half, small())
    assert again.damaged == (SHARDS[1],)
    assert again.collected == 12
    assert contents(half) == contents(plain)


def test_an_unfinished_set_is_not_read(half: Path) -> None:
    with pytest.raises(DatasetError, match=r"card\.json is not there: .*not finished.*gvp collect"):
        read_columns(half)


# what a folder may hold


@pytest.mark.parametrize("state", ["done", "half"])
def test_a_set_of_another_recipe_is_refused_and_left_alone(state: str, request: pytest.FixtureRequest) -> None:
    folder: Path = request.getfixturevalue(state)
    before = contents(folder)
    kind = "a set" if state == "done" else "an unfinished set"
    with pytest.raises(
        DatasetError, match=rf"holds {kind} of another recipe: radius is 0\.5 .* and 0\.4 here; seed is 1 .* 2 here"
    ) as caught:
        collect(folder, small(seed=2, radius=0.4))
    assert "Give another folder, or delete this one" in str(caught.value)
    assert contents(folder) == before


@pytest.mark.parametrize("state", ["done", "half"])
def test_a_set_of_other_versions_is_refused_and_left_alone(
    state: str, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder: Path = request.getfixturevalue(state)
    before, now = contents(folder), collecting._versions()
    monkeypatch.setattr(collecting, "_versions", lambda: {**now, "mujoco": "9.9.9"})
    with pytest.raises(DatasetError, match=rf"by other versions: mujoco is {now['mujoco']} there and 9\.9\.9 here"):
        collect(folder, small())
    assert contents(folder) == before


def test_a_folder_of_something_else_is_refused_and_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(DatasetError, match=r"is no set of viewpoints, and not empty: it holds thesis\.tex\. Give ano"):
        collect(tmp_path, small())
    assert contents(tmp_path) == {"thesis.tex": b"mine"}


@pytest.mark.parametrize("text", ["{}", "[1]", "no JSON", '{"recipe": {}, "shards": {}, "counts": {}}'])
def test_a_card_of_something_else_is_refused_and_left_alone(text: str, tmp_path: Path) -> None:
    (tmp_path / "card.json").write_text(text)
    with pytest.raises(DatasetError, match=r"is no card of a set of viewpoints"):
        collect(tmp_path, small())
    assert contents(tmp_path) == {"card.json": text.encode()}


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    for where in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(DatasetError, match=r"cannot use .* as a folder: .*give another"):
            collect(where, small())
    assert (tmp_path / "file").read_text() == "mine"


def test_a_folder_that_may_not_be_written_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def barred(path: Path, mode: str) -> Any:  # permission bits do not bind every user
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr("gvp_lib.jobs.open", barred, raising=False)
    with pytest.raises(DatasetError, match=r"cannot write .*: Permission denied.* give a folder that may be written"):
        collect(tmp_path, small())
    assert not any(tmp_path.iterdir())


def test_two_runs_do_not_collect_into_one_folder(tmp_path: Path) -> None:
    with (
        held_by_another_run(tmp_path / "set" / JOURNAL),
        pytest.raises(JournalError, match="in use by another run"),
    ):
        collect(tmp_path / "set", small())


# a disk that cannot be written


def test_a_disk_that_is_full_is_an_error_and_loses_nothing(plain: Path, tmp_path: Path, monkeypatch: Any) -> None:
    folder, expected = tmp_path / "set", contents(plain)
    with (
        full_after(monkeypatch, 2),
        pytest.raises(DatasetError, match=r"cannot write .*train-00002.*No space left.*is kept; make room.*goes on"),
    ):
        collect(folder, small())
    kept = contents(folder)
    assert {name: data for name, data in kept.items() if name != JOURNAL} == {
        name: expected[name] for name in SHARDS[:2]
    }
    assert collect(folder, small()).collected == 8
    assert contents(folder) == expected


@pytest.mark.parametrize("lines", [0, 2])
def test_a_disk_that_is_full_for_the_journal_is_the_same_error(
    lines: int, plain: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written, write = 0, Journal._write

    def full(self: Journal, data: bytes) -> None:
        nonlocal written
        if written == lines:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written += 1
        write(self, data)

    with monkeypatch.context() as patch:
        patch.setattr(Journal, "_write", full)
        with pytest.raises(DatasetError, match=r"cannot write .*: No space left on device.*is kept; make room"):
            collect(tmp_path / "set", small())
    assert collect(tmp_path / "set", small()).collected == 16 - 4 * max(0, lines - 1)
    assert contents(tmp_path / "set") == contents(plain)


def test_a_journal_that_cannot_be_opened_is_the_same_error(tmp_path: Path) -> None:
    (tmp_path / "set" / JOURNAL).mkdir(parents=True)
    with pytest.raises(DatasetError, match=r"cannot .*\.collection\.journal"):
        collect(tmp_path / "set", small())


def test_a_worker_that_dies_is_an_error_that_says_what_is_kept(
    plain: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def dying(function: Any, jobs: Any, **options: Any) -> Iterator[tuple[str, JobResult]]:
        for name in list(jobs)[:2]:
            yield name, JobResult(function(jobs[name]))
        raise WorkerDiedError("a worker process died")

    with monkeypatch.context() as patch:
        patch.setattr(collecting, "finished_jobs", dying)
        with pytest.raises(WorkerDiedError, match=r"died\. 8 of 16 samples .* kept in .*the same command goes on"):
            collect(tmp_path / "set", small(), workers=2)
    assert collect(tmp_path / "set", small()).collected == 8
    assert contents(tmp_path / "set") == contents(plain)


# an arm with more joints than it needs


def test_an_arm_on_a_base_collects_with_the_arm_and_hardly_drives() -> None:
    """Driving costs it more than moving its arm; as if all joints cost the same, it drove into the table."""
    recipe = CollectionRecipe(arm=arm_spec("ur5e").on_base(), sampling="random", n=4, seed=1)
    collector, driven = Collector(recipe), []
    with collector.cell.watch(lambda: driven.append(collector.cell.arm.joints[:2])):
        rows = collector.collect(0, viewpoints(recipe))
    collector.close()
    assert len(rows) == 4
    assert np.abs(driven).max() < 0.1


# what cannot be collected


def test_an_object_out_of_reach_is_an_error_that_says_what_failed_and_keeps_nothing_false(tmp_path: Path) -> None:
    far = replace(arm_spec("ur5e"), name="far", workspace=((3.0, 3.1), (0.0, 0.1)))
    with pytest.raises(DatasetError) as caught:
        collect(tmp_path / "set", small(arm=far, n=4))
    said = str(caught.value)
    assert f"1 shards could not be collected, the first of them {SHARDS[0].replace('00004', '00001')}" in said
    assert "viewpoints could be taken up for sample 0 ({'unreachable': 60})" in said
    assert "Is the object within reach" in said
    assert "The others are kept" in said


def test_a_crop_larger_than_the_picture_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="a crop of 481 px is larger than the picture, which is 640 x 480"):
        collect(tmp_path / "set", small(crop=481, n=4))


def test_one_shard_that_fails_keeps_the_others(tmp_path: Path, plain: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = collecting.collect_shard

    def failing(job: Any) -> Any:
        if job["first"] == 8:
            raise RuntimeError("the lamp fell over")
        return real(job)

    with monkeypatch.context() as patch:
        patch.setattr(collecting, "collect_shard", failing)
        with pytest.raises(DatasetError, match=r"1 shards could not be collected.*train-00002.*\n.*the lamp fell over"):
            collect(tmp_path / "set", small())
    assert collect(tmp_path / "set", small()).collected == 4
    assert contents(tmp_path / "set") == contents(plain)


# what is shown and told


def test_a_bar_counts_pictures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    collecting.collect_dataset(tmp_path / "bricks", small())
    bar = capsys.readouterr().err
    assert "bricks: 100%" in bar
    assert "16/16" in bar
    assert "image" in bar


def test_a_card_says_what_how_and_how_much(plain: Path) -> None:
    card = json.loads((plain / "card.json").read_text())
    assert card["recipe"] == json.loads(json.dumps(small().to_dict()))
    assert card["license"] == "cc0-1.0"
    assert {"gvp_lib", "numpy", "mujoco", "pyarrow"} <= set(card["versions"])
    assert card["actions"] == ["UP", "LEFT", "DOWN", "RIGHT", "NO_OP"]
    assert list(card["shards"]) == SHARDS
    assert "cuboid_1x2" in card["title"]


@pytest.mark.parametrize("name", ["plain", "ur5e"])
def test_the_card_s_counts_agree_with_the_table(name: str, request: pytest.FixtureRequest) -> None:
    folder: Path = request.getfixturevalue(name)
    counts, rows = json.loads((folder / "card.json").read_text())["counts"], table(folder).to_pandas()
    assert counts["samples"] == len(rows)
    assert counts["frames"] == rows["frames"].sum()
    assert counts["replaced"] == (rows["attempts"] > 1).sum()
    assert counts["overflow"] == rows["overflow"].sum()
    assert sum(counts["refused"].values()) == (rows["attempts"] - 1).sum()
    assert counts["arm_seconds"] == pytest.approx(rows["seconds"].sum(), abs=0.01)
    assert list(counts["actions"].values()) == np.bincount(rows["action"], minlength=5).tolist()
