"""The experiments of the learned planner: starts, methods, networks by recipe, and what is stored."""

from dataclasses import replace

import numpy as np
import pytest
from tiny_training import TINY

from gvp_book import tables
from gvp_book.experiments import learned, networks
from gvp_book.experiments.learned import PATHS, RADIUS, begin, cell_of, learned_jobs, spec_of
from gvp_book.experiments.networks import NETWORKS, SETS, Recipe
from gvp_book.results import Settings, read_result
from gvp_book.tables import reproduce
from gvp_lib.errors import GvpError, InvalidParameterError
from gvp_lib.learning.config import TrainConfig
from gvp_lib.learning.policy import device_name, find_device
from gvp_lib.learning.recipe import CollectionRecipe
from gvp_lib.learning.resnet import ARCHITECTURES

CLEAN = {"noise": {}, "variation": {}, "target": "cuboid_1x2", "seed": 3}
ROUGH = {**CLEAN, "variation": {"light": 0.4}}


@pytest.fixture
def tiny(monkeypatch):
    """One small set and one small network under the names of all of them."""
    monkeypatch.setitem(ARCHITECTURES, "tiny", TINY)
    recipe = CollectionRecipe(arm="floating", n=96, sampling="random", shard=96, seed=5)
    config = TrainConfig(network="tiny", size=32, shift=2, epochs=1, step=float(np.radians(20)))
    small = {
        name: Recipe(own.sets[:1], replace(config, target=own.config.target, seed=own.config.seed))
        for name, own in NETWORKS.items()
    }
    monkeypatch.setattr(networks, "SETS", dict.fromkeys(SETS, recipe))
    monkeypatch.setattr(networks, "NETWORKS", small)
    monkeypatch.setattr(learned, "OTHERS", ("cuboid_1x1 in blue",))
    monkeypatch.setattr(learned, "WATCHED", 0.5)
    few = {path: PATHS[path] for path in ("still", "rocks by 10 deg in 2.5 s")}
    monkeypatch.setattr(learned, "PATHS", few)
    return small


def run(name, folder, starts=1, **options):
    return read_result(reproduce(name, Settings(starts, folder=folder, progress=False, **options)))


# An episode


def test_a_start_lies_in_the_cap_whatever_was_before_and_light_changes_its_look_alone():
    tilts, pictures = [], []
    for job, before in ((ROUGH, ()), (ROUGH, (4, 2)), (CLEAN, ())):
        varied = cell_of({**job, "k": 0})
        for k in (*before, 1):
            start = begin(varied, {**job, "k": k})
            truth = varied.cell.truth
            away = truth.world_from_camera.translation - truth.world_from_object.translation
            assert np.linalg.norm(away) == pytest.approx(RADIUS, abs=2e-3)
            assert 0 <= start.tilt <= np.radians(30)
        tilts.append(start.tilt)
        pictures.append(varied.cell.arm.capture())
    assert tilts == [tilts[0]] * 3
    np.testing.assert_array_equal(*pictures[:2])
    assert not np.array_equal(*pictures[1:])


def test_a_brick_in_blue_has_its_shape_and_the_1x2s_color():
    blue, own = spec_of("cuboid_1x3 in blue"), spec_of("cuboid_1x3")
    assert blue.normals == own.normals
    assert blue.segmenter == spec_of("cuboid_1x2").segmenter
    assert str(blue.mjcf).count("stud_") == str(own.mjcf).count("stud_") == 12


# Which networks


def test_every_network_that_a_table_asks_for_is_known():
    for name in ("table-3.3", "table-3.4", "direction-head", "augmentation"):
        jobs = learned_jobs(name, seed=1, starts=3, large=True)
        methods = [method for job in jobs.values() for method in job["methods"].values()]
        assert {name for method in methods for name in np.atleast_1d(method.get("network", []))} <= set(NETWORKS)
        assert {key.rpartition("/")[2] for key in jobs} == {"0", "1", "2"}
    assert all(set(recipe.sets) <= set(SETS) for recipe in NETWORKS.values())


@pytest.mark.parametrize(("name", "cases"), [("table-3.3", 2), ("table-3.4", 5), ("augmentation", 0)])
def test_resnet_50_is_in_the_thesiss_tables_where_it_is_asked_for(name, cases):
    small, large = (learned_jobs(name, seed=1, starts=1, large=large) for large in (False, True))
    more = [set(large[key]["methods"]) - set(small[key]["methods"]) for key in small]
    for end, count in (("ResNet-50", cases), ("ResNet-50, 128 px", min(cases, 2))):
        assert sum({f"random, {end}", f"uniform, {end}"} <= new for new in more) == count
    assert all(large[key]["methods"].items() >= small[key]["methods"].items() for key in small)


@pytest.mark.parametrize("name", ["soup-random-0", "1x2-uniform-0"])
def test_the_thesiss_own_networks_are_trained_as_it_says(name):
    own, sharp = (NETWORKS[name.replace("-0", f"-resnet50-{end}")] for end in ("64px", "0"))
    config = NETWORKS[name].config
    assert own.sets == sharp.sets == NETWORKS[name].sets
    assert own.config == replace(config, network="resnet50")
    assert sharp.config == replace(own.config, size=128, shift=16)
    schedule = config.epochs, config.batch, config.learning_rate, config.gamma, config.decay_every, config.share
    assert schedule == (20, 32, 1e-3, 0.1, 5, 0.7)
    assert (config.size, config.shift, config.dihedral, config.colors) == (64, 8, False, False)
    assert SETS[NETWORKS[name].sets[0]].n == 4096


# What is stored


def test_the_moving_object_is_run_and_stored(tiny, tmp_path):
    result = run("moving-object", tmp_path)
    assert result["command"] == "gvp reproduce moving-object --starts 1 --seed 2020"
    summary = result["content"]["summary"]
    assert summary.keys() == learned.PATHS.keys()
    assert summary["still"]["tilt"]["error"]["mean"] < 5
    assert not list(tmp_path.glob(".*.journal"))


@pytest.mark.full
def test_a_table_collects_trains_runs_and_stores(tiny, tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "gpu_at_hand", lambda: True)
    result = run("table-3.4", tmp_path, resnet50=True)
    assert result["command"] == "gvp reproduce table-3.4 --starts 1 --seed 2020 --resnet50"
    methods = result["content"]["summary"]["clean/cuboid_1x1 in blue"]
    ours = {"random", "uniform", "stay", "chance", "oracle", "ours", "uniform - random"}
    assert ours | {"random, ResNet-50", "random, ResNet-50, 128 px"} <= methods.keys()
    assert methods["oracle"]["error"]["n"] == 1
    about = result["content"]["networks"]["1x2-random-0"]
    assert len(about["sha256"]) == 64
    assert (about["network"], about["size"], about["device"]) == ("tiny", 32, device_name(find_device("auto")))


def test_resnet_50_is_refused_where_there_is_no_gpu_or_no_place_for_it(tmp_path):
    with pytest.raises(InvalidParameterError, match=r"is for figure-3\.3, .*table-3\.1 is the same without"):
        run("table-3.1", tmp_path, resnet50=True)
    if not networks.gpu_at_hand():
        with pytest.raises(InvalidParameterError, match="Without --resnet50 the small networks"):
            run("table-3.3", tmp_path, resnet50=True)


@pytest.mark.full
def test_a_figure_holds_mean_and_spread_of_its_trainings(tiny, tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "gpu_at_hand", lambda: True)
    for name in ("figure-3.3", "figure-3.4"):
        curves = run(name, tmp_path, starts=2, resnet50=True)["content"]["curves"]
        assert {curve["n"] for curve in curves.values()} == {2}
        curve = curves["random adamw"]
        assert np.mean(curve["accuracy"]["all"], axis=0) == pytest.approx(curve["accuracy"]["mean"], abs=1e-3)
        assert (curve["network"], curve["device"]) == ("tiny", device_name(find_device("auto")))
    assert "ResNet-50, 128 px" in curves
    assert len(list((tmp_path / ".work" / "networks").iterdir())) == 8  # both figures are of the same trainings


@pytest.mark.full
def test_a_training_that_fails_says_which_and_keeps_the_others(tiny, tmp_path, monkeypatch):
    diverging = replace(tiny["1x2-uniform-0"].config, learning_rate=100.0, optimizer="sgd", epochs=3)
    monkeypatch.setitem(tiny, "1x2-uniform-0", Recipe(("1x2-uniform",), diverging))
    with pytest.raises(GvpError, match="network '1x2-uniform-0' could not be trained"):
        run("table-3.4", tmp_path)
    assert (tmp_path / ".work" / "networks" / "1x2-random-0" / "weights.safetensors").is_file()
