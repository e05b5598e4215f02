"""The command line: what it prints, what it returns, and what it says of arguments that make no sense."""

import dataclasses
import re
import subprocess
import sys
import tomllib
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

import pytest
from snippets import ROOT
from tiny_training import TINY
from viewpoint_sets import collect, small

import gvp_lib
from gvp_book import tables
from gvp_book.experiments import alignment
from gvp_book.results import read_result
from gvp_lib import TrainConfig, cli
from gvp_lib.cli import COLLECT_OPTIONS, TRAIN_OPTIONS, main
from gvp_lib.errors import InvalidParameterError
from gvp_lib.learning.checkpoints import load_trained
from gvp_lib.learning.recipe import CollectionRecipe
from gvp_lib.learning.resnet import ARCHITECTURES


def refused(command, said, capsys):
    """The command returns 2 and says this; nothing else is printed."""
    assert main(command) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith(f"gvp {command[0]}: ")
    assert said in printed.err


@pytest.mark.check
def test_the_version_is_printed_and_the_same_wherever_it_stands() -> None:
    output = subprocess.run([sys.executable, "-m", "gvp_lib", "--version"], capture_output=True, text=True, check=True)
    assert output.stdout == f"gvp_lib {gvp_lib.__version__}\n"
    assert tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"] == gvp_lib.__version__
    assert f"\nversion: {gvp_lib.__version__}\n" in (ROOT / "CITATION.cff").read_text()


@pytest.mark.check
def test_the_usage_lists_the_commands_of_other_packages_too(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    listed = re.findall(r"^    (\w+)(?: |$)", capsys.readouterr().out, re.MULTILINE)
    assert listed == ["doctor", "collect", "train", "sheet", "photos", "claims", "reproduce"]


@pytest.mark.check
def test_a_broken_command_of_another_package_is_named_and_the_others_work(monkeypatch, capsys):
    points = [EntryPoint("absent", "nowhere:add", "gvp.commands"), *entry_points(group="gvp.commands")]
    monkeypatch.setattr(cli, "entry_points", lambda group: points)
    assert main(["doctor", "python"]) == 0
    printed = capsys.readouterr()
    assert "gvp: no command 'absent': nowhere:add cannot be loaded: ModuleNotFoundError" in printed.err
    assert printed.out.startswith("[OK]   python")


@pytest.mark.check
@pytest.mark.parametrize(("recipe", "options"), [(TrainConfig, TRAIN_OPTIONS), (CollectionRecipe, COLLECT_OPTIONS)])
def test_an_option_s_help_names_the_default_of_its_recipe_s_field(recipe, options):
    defaults = {field.name: field.default for field in dataclasses.fields(recipe)}
    assert recipe is CollectionRecipe or list(options) == list(defaults)
    for name, (kind, _, text) in options.items():
        if kind is not bool and name not in ("max_tilt", "step") and defaults[name] is not None:
            assert f"(default: {defaults[name]})" in text, name


@pytest.fixture
def one_case(monkeypatch):
    """Table 3.1 cut down to one case and what is quick; each job says what it is, so that workers need no patch."""
    monkeypatch.setattr(alignment, "CASES", (("cuboid_1x2", "flat"),))
    monkeypatch.setattr(alignment, "METHODS", ("stay", "oracle"))
    monkeypatch.setattr(alignment, "SWEEPS", {})


def reproduced(folder, capsys, *options):
    """The file that the one case is stored in."""
    assert main(["reproduce", "table-3.1", "--starts", "1", "--out", str(folder), "--quiet", *options]) == 0
    assert capsys.readouterr().out.strip() == str(folder / "table-3.1.json")
    return folder / "table-3.1.json"


@pytest.mark.check
def test_reproduce_stores_a_table_and_prints_where(one_case, tmp_path, capsys):
    summary = read_result(reproduced(tmp_path, capsys))["content"]["summary"]
    assert summary["none/cuboid_1x2/flat"]["oracle"]["error"]["mean"] < 0.01
    assert 10 < summary["thesis/cuboid_1x2/flat"]["stay"]["error"]["mean"] < 45


@pytest.mark.full
def test_reproduce_stores_the_same_for_one_worker_or_two_or_a_dask_cluster(one_case, tmp_path, capsys):
    from distributed import LocalCluster

    here, two = (reproduced(tmp_path / n, capsys, "--workers", n) for n in ("1", "2"))
    assert here.read_bytes() == two.read_bytes()
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:
        there = reproduced(tmp_path / "there", capsys, "--dask", cluster.scheduler_address)
    assert read_result(here) == read_result(there)


def test_workers_here_and_a_cluster_exclude_each_other(capsys):
    with pytest.raises(SystemExit):
        main(["reproduce", "table-3.1", "--workers", "2", "--dask", "tcp://host:8786"])
    assert "argument --dask: not allowed with argument --workers" in capsys.readouterr().err
    with pytest.raises(InvalidParameterError, match="got both, workers=2 and dask='tcp://host:8786'"):
        tables.Settings(workers=2, dask="tcp://host:8786")


@pytest.mark.check
def test_claims_prints_the_readmes_few(capsys):
    assert main(["claims", "--summary", "--results", str(ROOT / "book" / "results")]) == 0
    assert capsys.readouterr().out.startswith("| ")


FEW = ["--arm", "floating", "--n", "8", "--rolls", "4", "--quiet"]


@pytest.mark.check
def test_collect_collects_a_set_and_collects_nothing_the_second_time(tmp_path, capsys):
    command = ["collect", str(tmp_path / "set"), *FEW]
    for now in (8, 0):
        assert main([*command, "--step", "6", "--vary-light", "0.1"]) == 0
        assert f"8 viewpoints, {now} of them collected now" in capsys.readouterr().out
    refused([*command, "--vary-light", "0.1"], "of another recipe: step is 0.10471", capsys)


ERASER = """
from gvp_lib import HsvThreshold, ObjectSpec

XML = '<mujoco><worldbody><body><geom type="box" size=".03 .01 .01" rgba=".1 .5 .9 1"/></body></worldbody></mujoco>'
ERASER = ObjectSpec("eraser", XML, HsvThreshold(hue=(195, 220), saturation=(0.4, 1), value=(0.1, 1)))
"""


def test_collect_takes_an_object_of_ones_own_from_a_file_and_says_what_a_file_has(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(sys, "path", [*sys.path])
    for name in ("my_eraser.py", "json.py"):
        (tmp_path / name).write_text(ERASER)
    command = ["collect", str(tmp_path / "set"), *FEW, "--target"]
    assert main([*command, f"{tmp_path}/my_eraser.py:ERASER"]) == 0
    assert "8 viewpoints, 8 of them collected now" in capsys.readouterr().out
    for target, said in (
        ("my_eraser.py:PENCIL", "has no ObjectSpec named 'PENCIL'; it has: ERASER"),
        ("nowhere.py:ERASER", "there is no file"),
        ("json.py:ERASER", "has the name of another module, json"),
    ):
        refused([*command, f"{tmp_path}/{target}"], said, capsys)


@pytest.mark.check
def test_train_trains_exports_and_says_in_its_files_what_was_asked_for(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(ARCHITECTURES, "tiny", TINY)
    monkeypatch.chdir(tmp_path)
    collect(tmp_path / "set", small(n=64, shard=16))
    asked = "--network tiny --size 32 --shift 2 --step 20.0 --epochs 1"
    command = ["train", str(tmp_path / "set"), *asked.split(), "--quiet", "--device", "cpu", "--out"]
    assert main([*command, "run", "--export", "small.safetensors", "--precision", "int8"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("1 of 1 epochs run now; after epoch 1, validation accuracy ")
    assert f"weights in {tmp_path}/run/weights.safetensors and small.safetensors; " in said
    whole, exported = load_trained("run/weights.safetensors").metadata, load_trained("small.safetensors").metadata
    assert whole["command"] == f"gvp train set {asked}"
    assert exported["command"] == f"gvp train set {asked} --export NAME --precision int8"
    assert exported["precision"] == "int8"
    assert whole["config"]["step"] == pytest.approx(0.349, abs=1e-3)  # rad
    assert main([*command, "run"]) == 0
    assert "0 of 1 epochs run now" in capsys.readouterr().out
    refused([*command, "other", "--learning-rate", "100"], "A smaller learning rate than 100 may do, say 10", capsys)
    assert not Path("other/weights.safetensors").exists()


NOBODY = "tcp://127.0.0.1:1"


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("reproduce table-3.9 --out .", "there is no table or figure named 'table-3.9'"),
        ("reproduce table-3.1 --out . --starts 0", "--starts is 1 or more; got 0"),
        ("reproduce table-3.1 --out . --workers 0", "--workers is 1 or more; got 0"),
        (f"reproduce table-3.1 --out . --quiet --dask {NOBODY}", f"no Dask scheduler answers at '{NOBODY}'"),
        ("collect out --workers 0", "--workers is 1 or more; got 0"),
        ("collect out --target x", "no object named 'x'"),
        ("train . --out out --network resnet51", "Did you mean 'resnet50'"),
        ("train . --out out --step 100", "step is a number from 1e-06 to 1.5708 rad"),
        ("train . --out out --precision int8", "--precision applies to the file that --export names"),
        ("train . --out out --threads 0", "threads is a whole number from 1"),
        ("train . --out out --export w.pth", "ends in .safetensors; got 'w.pth'"),
        ("train . --out out", "not finished"),
    ],
)
def test_what_makes_no_sense_is_refused_before_anything_is_written(command, said, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    refused(command.split(), said, capsys)
    assert not any(tmp_path.iterdir())
