"""The command line: what it prints, what it returns, and what it says of arguments that make no sense."""

import dataclasses
import socket
import sys
from pathlib import Path

import numpy as np
import pytest
from tiny_training import TINY
from viewpoint_sets import collect, small

from gvp_book import tables
from gvp_book.experiments import alignment
from gvp_book.results import read_result
from gvp_lib.cli import TRAIN_OPTIONS, main
from gvp_lib.errors import InvalidParameterError
from gvp_lib.learning.checkpoints import load_trained
from gvp_lib.learning.config import TrainConfig
from gvp_lib.learning.resnet import NETWORKS


@pytest.fixture
def one_case(monkeypatch):
    """Table 3.1 cut down to one case and what is quick; each job says what it is, so that workers need no patch."""
    monkeypatch.setattr(alignment, "CASES", (("cuboid_1x2", "flat"),))
    monkeypatch.setattr(alignment, "METHODS", ("stay", "oracle"))
    monkeypatch.setattr(alignment, "SWEEPS", {})


def reproduced(folder, capsys, *options):
    """The file that the one case is stored in."""
    assert main(["reproduce", "table-3.1", "--starts", "1", "--out", str(folder), "--quiet", *options]) == 0
    path = folder / "table-3.1.json"
    assert capsys.readouterr().out.strip() == str(path)
    return path


@pytest.mark.check
def test_reproduce_stores_a_table_and_prints_where(one_case, tmp_path, capsys):
    content = read_result(reproduced(tmp_path, capsys))["content"]
    assert content["summary"]["none/cuboid_1x2/flat"]["oracle"]["error"]["mean"] < 0.01
    assert 10 < content["summary"]["thesis/cuboid_1x2/flat"]["stay"]["error"]["mean"] < 45


@pytest.mark.full
def test_reproduce_stores_the_same_for_one_worker_or_two_or_a_dask_cluster(one_case, tmp_path, capsys):
    from distributed import LocalCluster

    here, two = (reproduced(tmp_path / n, capsys, "--workers", n) for n in ("1", "2"))
    assert here.read_bytes() == two.read_bytes()
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:
        there = reproduced(tmp_path / "there", capsys, "--dask", cluster.scheduler_address)
    assert read_result(here) == read_result(there)


def test_a_dask_cluster_that_does_not_answer_is_an_error_that_names_its_address(tmp_path, capsys):
    with socket.socket() as taken:  # and nobody listens
        taken.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        assert main(["reproduce", "table-3.1", "--out", str(tmp_path), "--quiet", "--dask", address]) == 2
    assert f"gvp reproduce: no Dask scheduler answers at '{address}'" in capsys.readouterr().err
    assert not any(tmp_path.iterdir())


def test_workers_here_and_a_cluster_exclude_each_other(tmp_path, capsys):
    command = ["reproduce", "table-3.1", "--out", str(tmp_path), "--workers", "2", "--dask", "tcp://host:8786"]
    with pytest.raises(SystemExit) as exit:
        main(command)
    assert exit.value.code == 2
    assert "argument --dask: not allowed with argument --workers" in capsys.readouterr().err
    with pytest.raises(InvalidParameterError, match="got both, workers=2 and dask='tcp://host:8786'"):
        tables.Settings(workers=2, dask="tcp://host:8786")


@pytest.mark.check
def test_an_unknown_table_is_an_error_that_names_the_known_ones(tmp_path, capsys):
    assert main(["reproduce", "table-3.9", "--out", str(tmp_path)]) == 2
    assert "gvp reproduce: there is no table or figure named 'table-3.9'" in (said := capsys.readouterr().err)
    assert "table-3.1" in said


@pytest.mark.parametrize("name", ["starts", "workers"])
def test_fewer_than_one_start_or_worker_is_an_error(name, tmp_path, capsys):
    assert main(["reproduce", "table-3.1", f"--{name}", "0", "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err == f"gvp reproduce: --{name} is 1 or more; got 0\n"
    assert not any(tmp_path.iterdir())


@pytest.mark.check
def test_claims_prints_the_readmes_few(capsys):
    assert main(["claims", "--summary", "--results", str(Path(__file__).parents[1] / "book" / "results")]) == 0
    assert capsys.readouterr().out.startswith("| ")


@pytest.mark.check
def test_without_a_command_the_usage_is_shown(capsys):
    with pytest.raises(SystemExit) as exit:
        main([])
    assert exit.value.code == 2
    assert "usage: gvp" in capsys.readouterr().err


@pytest.mark.check
def test_collect_collects_a_set_and_collects_nothing_the_second_time(tmp_path, capsys):
    command = ["collect", str(tmp_path / "set"), "--arm", "floating", "--n", "8", "--rolls", "4", "--quiet"]
    assert main(command) == 0
    assert "8 viewpoints, 8 of them collected now" in capsys.readouterr().out
    assert main(command) == 0
    assert "8 viewpoints, 0 of them collected now" in capsys.readouterr().out
    assert main([*command, "--seed", "1"]) == 2
    assert "gvp collect: " in (said := capsys.readouterr().err)
    assert "of another recipe: seed is 0 there and 1 here" in said


ERASER = """
from gvp_lib import HsvThreshold, ObjectSpec

XML = '<mujoco><worldbody><body><geom type="box" size=".03 .01 .01" rgba=".1 .5 .9 1"/></body></worldbody></mujoco>'
ERASER = ObjectSpec("eraser", XML, HsvThreshold(hue=(195, 220), saturation=(0.4, 1), value=(0.1, 1)))
"""


def test_collect_takes_an_object_of_ones_own_from_a_file_and_says_what_a_file_has(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(sys, "path", [*sys.path])
    (tmp_path / "my_eraser.py").write_text(ERASER)
    (tmp_path / "json.py").write_text(ERASER)
    few = ["--arm", "floating", "--n", "8", "--rolls", "4", "--quiet"]
    collect = ["collect", str(tmp_path / "set"), *few, "--target"]
    assert main([*collect, f"{tmp_path}/my_eraser.py:ERASER"]) == 0
    assert "8 viewpoints, 8 of them collected now" in capsys.readouterr().out
    for target, said in (
        ("my_eraser.py:PENCIL", "has no ObjectSpec named 'PENCIL'; it has: ERASER"),
        ("nowhere.py:ERASER", "there is no file"),
        ("json.py:ERASER", "has the name of another module, json"),
    ):
        assert main([*collect, f"{tmp_path}/{target}"]) == 2
        assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "said"),
    [(["--workers", "0"], "--workers is 1 or more; got 0"), (["--n", "7"], "n=7"), (["--target", "x"], "no object")],
)
def test_collect_refuses_what_makes_no_sense(options, said, tmp_path, capsys):
    assert main(["collect", str(tmp_path / "set"), *options]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "set").exists()


@pytest.mark.check
def test_train_trains_exports_and_says_in_its_files_what_was_asked_for(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(NETWORKS, "tiny", TINY)
    monkeypatch.chdir(tmp_path)
    collect(tmp_path / "set", small(n=64, shard=16))
    asked = "--network tiny --size 32 --shift 2 --step 20.0 --epochs 1"
    command = ["train", str(tmp_path / "set"), "--out", "run", *asked.split(), "--quiet", "--device", "cpu"]
    assert main([*command, "--export", "small.safetensors", "--precision", "int8"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("1 of 1 epochs run now; after epoch 1, validation accuracy ")
    assert "weights in run/weights.safetensors and small.safetensors; " in said
    whole, small_one = load_trained("run/weights.safetensors"), load_trained("small.safetensors")
    assert whole.about["command"] == f"gvp train set {asked}"
    assert small_one.about["command"] == f"gvp train set {asked} --export NAME --precision int8"
    assert small_one.about["precision"] == "int8"
    assert whole.about["config"]["step"] == pytest.approx(np.radians(20))
    assert main(command) == 0
    assert "0 of 1 epochs run now" in capsys.readouterr().out


def test_train_that_diverges_ends_with_an_error_that_says_so(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(NETWORKS, "tiny", TINY)
    collect(tmp_path / "set", small(n=64, shard=16))
    asked = "--network tiny --size 32 --shift 2 --step 20.0 --learning-rate 100 --quiet --device cpu"
    assert main(["train", str(tmp_path / "set"), "--out", str(tmp_path / "run"), *asked.split()]) != 0
    said = capsys.readouterr()
    assert "in epoch 1 the training loss " in said.err
    assert "A smaller learning rate than 100 may do, say 10" in said.err
    assert said.out == ""
    assert not (tmp_path / "run" / "weights.safetensors").exists()


@pytest.mark.check
def test_train_has_an_option_for_each_field_and_its_help_names_the_default():
    defaults = {field.name: field.default for field in dataclasses.fields(TrainConfig)}
    assert list(TRAIN_OPTIONS) == list(defaults)
    for name, default in defaults.items():
        if default is not None and default is not False:
            assert f"(default: {default})" in TRAIN_OPTIONS[name][2], name


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--network", "resnet51"], "Did you mean 'resnet50'"),
        (["--epochs", "0"], "epochs is a whole number from 1"),
        (["--step", "100"], "step is in radians"),
        (["--precision", "int8"], "--precision is of the file that --export names"),
        (["--export", "w.safetensors", "--precision", "int4"], "no precision named 'int4'"),
        (["--threads", "0"], "threads is a whole number, 1 or more"),
        (["--export", "w.pth"], "ends in .safetensors; got 'w.pth'"),
        ([], "not finished"),
    ],
)
def test_train_refuses_what_makes_no_sense(options, said, tmp_path, capsys):
    assert main(["train", str(tmp_path), "--out", str(tmp_path / "run"), *options]) == 2
    assert said in capsys.readouterr().err
    assert not any(tmp_path.iterdir())
