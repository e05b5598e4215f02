"""A set is the same whoever collects it, survives whatever ends a run, and what cannot be done is said."""

import errno
import multiprocessing
import os
import shutil
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from other_runs import held_by_another_run
from viewpoint_sets import UR5E, collect, contents, pictures, small

from gvp_lib.errors import DatasetError, WorkerDiedError
from gvp_lib.jobs import JobResult, write_file
from gvp_lib.learning import collect as collecting
from gvp_lib.learning.collect import Collector
from gvp_lib.learning.recipe import CollectionRecipe, viewpoints
from gvp_lib.learning.shards import read_card, read_columns
from gvp_lib.simulation.arms import arm_spec

SHARDS = [f"data/train-{k:05d}-of-00004.parquet" for k in range(4)]


@pytest.fixture
def done(plain, tmp_path):
    """A finished set of one's own."""
    return Path(shutil.copytree(plain, tmp_path / "done"))


@pytest.fixture
def half(tmp_path, monkeypatch):
    """A set whose run ended after its second shard, by a worker that died."""

    def dying(function, jobs, **options):
        for name in list(jobs)[:2]:
            yield name, JobResult(function(jobs[name]))
        raise WorkerDiedError("a worker process died")

    with monkeypatch.context() as patch:
        patch.setattr(collecting, "finished_jobs", dying)
        with pytest.raises(WorkerDiedError, match=r"died\. 8 of 16 samples .* kept in .*the same command goes on"):
            collect(tmp_path / "half", small(), workers=2)
    return tmp_path / "half"


# the same whoever collects it


def test_no_sample_is_lost_doubled_or_torn(plain, ur5e):
    for folder, n in ((plain, 16), (ur5e, 64)):
        assert read_columns(folder)["index"].to_pylist() == list(range(n))
        seen = pictures(folder)
        assert {picture.shape for picture in seen} == {(128, 128, 3)}
        assert len({picture.tobytes() for picture in seen}) == n


@pytest.mark.full
def test_any_number_of_workers_and_any_executor_give_the_same_bytes(plain, ur5e, tmp_path):
    assert collect(tmp_path / "workers", UR5E, workers=2).collected == UR5E.n
    assert contents(tmp_path / "workers") == contents(ur5e)
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as executor:
        collect(tmp_path / "executor", small(), executor=executor)
    assert contents(tmp_path / "executor") == contents(plain)


@pytest.mark.parametrize("options", [{"seed": 2}, {"step": 0.2}])
def test_another_recipe_gives_another_set(options, plain, tmp_path):
    collect(tmp_path / "set", small(**options))
    assert contents(tmp_path / "set")[SHARDS[0]] != contents(plain)[SHARDS[0]]


# whatever ends a run


@pytest.mark.parametrize("left", [SHARDS[2], "data/.train-00002-of-00004.parquet.draft", ".card.json.draft"])
def test_a_run_killed_while_it_writes_leaves_nothing_behind_once_it_has_gone_on(left, half, plain):
    (half / left).write_bytes(b"PAR1 torn")
    (half / ".collecting").touch()
    assert collect(half, small()).collected == 8
    assert contents(half) == contents(plain)


def test_a_run_killed_before_its_first_shard_leaves_a_folder_to_begin_in(tmp_path):
    for name in (".collecting", ".card.json.draft"):
        (tmp_path / name).touch()
    assert collect(tmp_path, small(n=4)).collected == 4


def test_collecting_a_finished_set_again_collects_and_changes_nothing(done, plain):
    before = {path: path.stat().st_mtime_ns for path in (done / "data").iterdir()}
    again = collect(done, small())
    assert (again.collected, again.damaged) == (0, ())
    assert {path: path.stat().st_mtime_ns for path in (done / "data").iterdir()} == before
    assert contents(done) == contents(plain)


def test_an_unfinished_set_is_not_read(half):
    with pytest.raises(DatasetError, match=r"the set in .*half is not finished: it has 8 of 16 samples; .*gvp collect"):
        read_columns(half)


def flip_a_byte(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize(("state", "left", "harm"), [("done", 0, flip_a_byte), ("half", 8, Path.unlink)])
def test_a_damaged_shard_is_found_named_and_collected_again(state, left, harm, plain, request):
    folder = request.getfixturevalue(state)
    harm(folder / SHARDS[1])
    if state == "done":
        with pytest.raises(DatasetError, match=rf"1 of 4 shards in .* missing or damaged.*{SHARDS[1]}; `gvp collect`"):
            read_columns(folder)
    again = collect(folder, small())
    assert (again.damaged, again.collected) == ((SHARDS[1],), left + 4)
    assert contents(folder) == contents(plain)


# what a folder may hold


def test_a_set_of_another_recipe_or_of_other_versions_is_refused_and_left_alone(done, plain, monkeypatch):
    different = r"of another recipe: radius is 0\.5 .* and 0\.4 here; seed is 1 .* 2 here.*or delete this one"
    with pytest.raises(DatasetError, match=different):
        collect(done, small(seed=2, radius=0.4))
    now = collecting._versions()
    monkeypatch.setattr(collecting, "_versions", lambda: {**now, "mujoco": "9.9.9"})
    with pytest.raises(DatasetError, match=rf"by other versions: mujoco is {now['mujoco']} there and 9\.9\.9 here"):
        collect(done, small())
    assert contents(done) == contents(plain)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("thesis.tex", "mine", r"no set of viewpoints, .*: it holds thesis\.tex and no card\.json\. Give another"),
        (SHARDS[0], "old", r"an earlier version left unfinished: it holds data and no card"),
        ("card.json", "[1]", "is no card of a set of viewpoints"),
        ("card.json", "no JSON", "is no card of a set of viewpoints"),
        ("card.json", '{"recipe": {}, "counts": {}}', "is no card of a set of viewpoints"),
    ],
)
def test_a_folder_of_something_else_is_refused_and_left_alone(name, text, message, tmp_path):
    write_file(tmp_path / name, text.encode())
    with pytest.raises(DatasetError, match=message):
        collect(tmp_path, small())
    assert contents(tmp_path) == {name: text.encode()}


def test_what_is_no_folder_or_may_not_be_written_is_refused(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("mine")
    for where in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(DatasetError, match=r"cannot write .*file.*: .*give a path that may be written"):
            collect(where, small())
    assert contents(tmp_path) == {"file": b"mine"}

    def barred(path, mode):  # permission bits do not bind every user
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr("gvp_lib.jobs.open", barred, raising=False)
    with pytest.raises(DatasetError, match=r"cannot write .*: Permission denied\..* give a path that may be written"):
        collect(tmp_path, small())


def test_two_runs_do_not_collect_into_one_folder(tmp_path):
    with (
        held_by_another_run(tmp_path / "set" / ".collecting"),
        pytest.raises(DatasetError, match="in use by another run; wait for it, or give another path"),
    ):
        collect(tmp_path / "set", small())


# what cannot be collected


def test_a_disk_that_is_full_is_an_error_and_loses_nothing(half, plain, monkeypatch):
    def full(path, data):
        if path.name == Path(SHARDS[3]).name:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write_file(path, data)

    with monkeypatch.context() as patch:
        patch.setattr(collecting, "write_file", full)
        with pytest.raises(DatasetError, match=r"cannot write .*train-00003.*No space left.*is kept; make room"):
            collect(half, small())
    assert contents(half).keys() == {*SHARDS[:3], "card.json", "README.md"}
    again = collect(half, small())
    assert (again.collected, again.damaged) == (4, ())  # what is not there was never noted
    assert contents(half) == contents(plain)


def test_one_shard_that_fails_keeps_the_others(tmp_path, plain, monkeypatch):
    real = collecting.collect_shard

    def failing(job):
        if job["first"] == 8:
            raise RuntimeError("the lamp fell over")
        return real(job)

    with monkeypatch.context() as patch:
        patch.setattr(collecting, "collect_shard", failing)
        with pytest.raises(DatasetError, match=r"1 shards could not be collected.*train-00002.*\n.*the lamp fell over"):
            collect(tmp_path / "set", small())
    assert collect(tmp_path / "set", small()).collected == 4
    assert contents(tmp_path / "set") == contents(plain)


FAR = replace(arm_spec("ur5e"), name="far", workspace=((3.0, 3.1), (0.0, 0.1)))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"arm": FAR},
            r"up for sample 0 \(\{'unreachable': 60\}\)\. Is the object within reach.*others are kept",
        ),
        ({"crop": 481}, "a crop of 481 px is larger than the picture, which is 640 x 480"),
    ],
)
def test_what_can_never_be_collected_is_an_error_that_says_why(options, message, tmp_path):
    with pytest.raises(DatasetError, match=rf"(?s){message}"):
        collect(tmp_path / "set", small(n=4, **options))


def test_an_arm_on_a_base_collects_with_the_arm_and_hardly_drives():
    """Driving costs it more than moving its arm; as if all joints cost the same, it drove into the table."""
    recipe = CollectionRecipe(arm=arm_spec("ur5e").on_base(), sampling="random", n=4, seed=1)
    collector, driven = Collector(recipe), []
    with collector.cell.watch(lambda: driven.append(collector.cell.arm.joints[:2])):
        rows = collector.collect(0, viewpoints(recipe))
    collector.close()
    assert len(rows) == 4
    assert np.abs(driven).max() < 0.1


# what is shown and recorded


def test_a_bar_counts_pictures(tmp_path, capsys):
    collecting.collect_dataset(tmp_path / "bricks", small())
    bar = capsys.readouterr().err
    assert all(text in bar for text in ("bricks: 100%", "16/16", "image"))


def test_a_set_has_shards_a_page_and_a_card_that_says_what_and_how(plain):
    assert sorted(contents(plain)) == sorted(["README.md", "card.json", *SHARDS])
    card = read_card(plain)
    assert card["recipe"] == small().to_dict()
    assert card["license"] == "cc0-1.0"
    assert {"gvp_lib", "numpy", "mujoco", "pyarrow"} <= set(card["versions"])
    assert card["actions"] == ["UP", "LEFT", "DOWN", "RIGHT", "NO_OP"]
    assert list(card["shards"]) == SHARDS
    assert "cuboid_1x2" in card["title"]


def test_the_card_s_counts_agree_with_the_table(ur5e):
    counts, rows = read_card(ur5e)["counts"], read_columns(ur5e).to_pandas()
    assert counts["samples"] == len(rows)
    assert counts["frames"] == rows["frames"].sum()
    assert counts["replaced"] == (rows["attempts"] > 1).sum() > 0
    assert counts["overflow"] == rows["overflow"].sum()
    assert sum(counts["refused"].values()) == (rows["attempts"] - 1).sum()
    assert counts["arm_seconds"] == pytest.approx(rows["seconds"].sum(), abs=0.01)
    assert list(counts["actions"].values()) == np.bincount(rows["action"], minlength=5).tolist()
