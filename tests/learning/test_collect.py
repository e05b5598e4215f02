"""A set is the same whoever collects it, survives whatever ends a run, and what cannot be done is said."""

import errno
import multiprocessing
import re
import shutil
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from other_runs import held_by_another_run
from viewpoint_sets import UR5E, collect, contents, pictures, small

from gvp_lib.errors import DatasetError, GvpError, InvalidParameterError, UnknownNameError, WorkerDiedError
from gvp_lib.jobs import write_file
from gvp_lib.learning import collect as collecting
from gvp_lib.learning.collect import Collector
from gvp_lib.learning.recipe import CollectionRecipe, scaled_object, tour, viewpoints
from gvp_lib.learning.shards import COLUMNS, decoded, read_card, read_columns
from gvp_lib.simulation.arms import arm_spec
from gvp_lib.simulation.objects import object_spec

SHARDS = [f"data/train-{k:05d}-of-00004.parquet" for k in range(4)]


@pytest.fixture
def done(plain, tmp_path):
    """A finished set of one's own."""
    return Path(shutil.copytree(plain, tmp_path / "done"))


@pytest.fixture
def half(tmp_path, monkeypatch):
    """A set of which the first two shards were collected, and the last two could not be."""
    real = collecting.collect_shard
    with monkeypatch.context() as patch:
        patch.setattr(collecting, "collect_shard", lambda job: real(job) if job["first"] < 8 else 1 // 0)
        with pytest.raises(DatasetError, match=r"2 shards could not be collected.*train-00002.*\n.*ZeroDivisionError"):
            collect(tmp_path / "half", small())
    return tmp_path / "half"


@pytest.mark.full
def test_any_number_of_workers_and_any_executor_give_the_same_bytes(plain, ur5e, tmp_path):
    assert collect(tmp_path / "workers", UR5E, workers=2).collected == UR5E.n
    assert contents(tmp_path / "workers") == contents(ur5e)
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as executor:
        collect(tmp_path / "executor", small(), executor=executor)
    assert contents(tmp_path / "executor") == contents(plain)


@pytest.mark.parametrize("left", [SHARDS[2], "data/.train-00002-of-00004.parquet.draft", ".card.json.draft"])
def test_a_run_killed_while_it_writes_leaves_nothing_behind_once_it_has_resumed(left, half, plain):
    (half / left).write_bytes(b"PAR1 torn")
    (half / ".collecting").touch()
    with pytest.raises(DatasetError, match=r"the set in .*half is not finished: it has 8 of 16 samples; .*gvp collect"):
        read_columns(half)
    assert collect(half, small()).collected == 8
    assert contents(half) == contents(plain)


def test_a_run_killed_before_its_first_shard_leaves_a_folder_to_begin_in(tmp_path):
    (tmp_path / ".card.json.draft").touch()
    assert collect(tmp_path, small(n=4)).collected == 4


def dying(*_, **__):
    yield from ()
    raise WorkerDiedError("a worker process died")


def full(path, data):
    if path.suffix == ".parquet":
        raise OSError(errno.ENOSPC, "No space left on device")
    write_file(path, data)


@pytest.mark.parametrize(
    ("name", "end", "message"),
    [
        ("finished_jobs", dying, r"died\. 8 of 16 samples .* kept in .*the same command goes on"),
        ("write_file", full, r"cannot write .*train-00002.*No space left.*is kept; make room"),
    ],
)
def test_a_dead_worker_or_a_full_disk_is_an_error_and_loses_nothing(name, end, message, half, plain, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(collecting, name, end)
        with pytest.raises(GvpError, match=message):
            collect(half, small())
    again = collect(half, small())
    assert (again.collected, again.damaged) == (8, ())  # what is not there was never noted
    assert contents(half) == contents(plain)


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


def test_a_set_of_another_recipe_or_of_other_versions_is_refused_and_left_alone(done, plain, monkeypatch):
    different = r"of another recipe: radius is 0\.5 .* and 0\.4 here; seed is 1 .* 2 here.*or delete this one"
    with pytest.raises(DatasetError, match=different):
        collect(done, small(seed=2, radius=0.4))
    monkeypatch.setattr("gvp_lib.__version__", "9.9.9")
    with pytest.raises(DatasetError, match=r"by other versions: gvp_lib is .* there and 9\.9\.9 here"):
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


def test_a_folder_in_use_or_that_is_none_is_refused(tmp_path):
    with held_by_another_run(tmp_path / ".collecting"):
        for folder, message in (
            (tmp_path, "in use by another run; wait for it, or give another path"),
            (tmp_path / ".collecting", r"cannot write .*: .*give a path that may be written"),
            (tmp_path / ".collecting" / "below", r"cannot write .*: .*give a path that may be written"),
        ):
            with pytest.raises(DatasetError, match=message):
                collect(folder, small())
    assert contents(tmp_path) == {".collecting": b""}


FAR = replace(arm_spec("ur5e"), name="far", workspace=((3.0, 3.1), (0.0, 0.1)))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"arm": FAR}, r"for sample 0 \(\{'unreachable': 60\}\)\. Is the object within reach.*others are kept"),
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


def test_a_set_has_shards_a_page_and_a_card_that_says_what_and_how(plain):
    assert sorted(contents(plain)) == sorted(["README.md", "card.json", *SHARDS])
    card = read_card(plain)
    assert card["recipe"] == small().to_dict()
    assert card["license"] == "cc0-1.0"
    assert {"gvp_lib", "numpy", "mujoco", "pyarrow"} <= set(card["versions"])
    assert card["actions"] == ["UP", "LEFT", "DOWN", "RIGHT", "NO_OP"]
    assert list(card["shards"]) == SHARDS
    assert "cuboid_1x2" in card["title"]


def test_the_card_s_counts_agree_with_the_table_of_which_no_row_is_lost_or_doubled(ur5e):
    counts, rows, seen = read_card(ur5e)["counts"], read_columns(ur5e).to_pandas(), pictures(ur5e)
    assert rows["index"].tolist() == list(range(counts["samples"]))
    assert len({picture.tobytes() for picture in seen}) == len(rows)
    assert {picture.shape for picture in seen} == {(128, 128, 3)}
    assert counts["frames"] == rows["frames"].sum()
    assert counts["replaced"] == (rows["attempts"] > 1).sum() > 0
    assert counts["overflow"] == rows["overflow"].sum()
    assert sum(counts["refused"].values()) == (rows["attempts"] - 1).sum()
    assert counts["arm_seconds"] == pytest.approx(rows["seconds"].sum(), abs=0.01)
    assert list(counts["actions"].values()) == np.bincount(rows["action"], minlength=5).tolist()


def test_hugging_face_opens_it_with_pictures_decoded_and_actions_named(ur5e, tmp_path, monkeypatch):
    monkeypatch.setenv("HF_DATASETS_OFFLINE", "1")
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    from datasets import load_dataset

    # Every kind of feature is one that its versions 2 to 5 know; "List" came with 4.
    metadata = pq.read_schema(next((ur5e / "data").iterdir())).metadata[b"huggingface"].decode()
    assert set(re.findall(r'"_type": "(\w+)"', metadata)) == {"Value", "Image", "ClassLabel", "Sequence"}
    data = load_dataset(str(ur5e), cache_dir=str(tmp_path))["train"]
    assert data.features["action"].names == ["UP", "LEFT", "DOWN", "RIGHT", "NO_OP"]
    assert list(data.features) == list(COLUMNS)
    for row, picture in zip(data, pictures(ur5e), strict=True):
        np.testing.assert_array_equal(np.asarray(row["image"]), picture)


def test_pandas_opens_it(ur5e):
    rows = pd.read_parquet(ur5e / "data")
    assert list(rows.columns) == list(COLUMNS)
    assert (rows["action"].dtype, rows["angle"].dtype, rows["overflow"].dtype) == (np.int64, np.float32, bool)
    assert {len(pose) for pose in rows["world_from_camera"]} == {7}


def test_samples_on_the_arm_take_at_most_three_frames_and_are_aligned_and_centered(ur5e):
    rows = read_columns(ur5e).to_pandas()
    assert rows["frames"].max() <= 3
    assert rows["angle"].to_numpy() == pytest.approx(rows["tilt"].to_numpy(), abs=np.radians(3))
    assert np.linalg.norm(np.stack(rows["blob_centroid"]) - (319.5, 239.5), axis=1).max() < 3


def test_columns_are_named_in_any_sequence_and_one_that_is_none_is_refused(ur5e):
    assert read_columns(ur5e, ("angle", "action")).column_names == ["angle", "action"]
    with pytest.raises(UnknownNameError, match=r"no column named 'angles'.*Did you mean 'angle'"):
        read_columns(ur5e, ["angles"])


def test_a_picture_is_decoded_from_a_cell_however_it_was_read(plain):
    cell = read_columns(plain, ["image"])["image"][0]
    for form in (cell, cell["bytes"], cell.as_py()["bytes"]):
        np.testing.assert_array_equal(decoded(form), decoded(cell.as_py()))


@pytest.mark.parametrize(
    ("cell", "given"),
    [(b"none", "4 bytes"), (b"", "0 bytes"), ({"path": "x.png"}, "a dict"), (None, "a NoneType"), ("x.png", "a str")],
)
def test_what_is_no_picture_is_refused(cell, given):
    with pytest.raises(DatasetError, match=f"^{given} are no PNG picture; give a cell of the column 'image'"):
        decoded(cell)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: collect(7, small()), "a folder, given by its path; got a int: 7"),
        (lambda: Collector(small(scenes=2), scene=2), "this recipe has scenes from 0 to 1; got 2"),
        (lambda: viewpoints(small(), -1), "this recipe has scenes from 0 to 0; got -1"),
        (lambda: tour(np.zeros(3)), r"shape \(n, 3\), rad; got the shape \(3,\)"),
        (lambda: Collector(small()).collect(0, np.zeros(3)), r"shape \(n, 3\), rad; got the shape \(3,\)"),
        *(
            (lambda f=f: scaled_object(object_spec("cuboid_1x2"), f), f"finite; got {f}")
            for f in (0, -1.0, np.nan, np.inf)
        ),
    ],
)
def test_what_cannot_be_collected_is_refused(call, message):
    with pytest.raises(InvalidParameterError, match=message):
        call()
