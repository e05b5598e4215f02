"""The experiments of the learned planner: starts, methods, networks by recipe, and what is stored."""

from dataclasses import replace

import numpy as np
import pytest
from tiny_training import TINY

from gvp_book import tables
from gvp_book.experiments import following, learned, learned_tables, networks, preparation
from gvp_book.experiments.following import PATHS, SETTLED, follow_once
from gvp_book.experiments.learned import RADIUS, begin, cell_of, spec_of, step_over_once
from gvp_book.experiments.learned_tables import following_jobs, learned_jobs
from gvp_book.experiments.networks import NETWORKS, SETS, Recipe
from gvp_book.results import read_result
from gvp_book.running import Settings
from gvp_book.tables import TABLES, reproduce
from gvp_lib.errors import GvpError, InvalidParameterError
from gvp_lib.learning.config import TrainConfig
from gvp_lib.learning.policy import device_name, find_device
from gvp_lib.learning.recipe import CollectionRecipe
from gvp_lib.learning.resnet import NETWORKS as ARCHITECTURES
from gvp_lib.perception.segmentation import Saliency
from gvp_lib.planning.learned import CnnPlanner
from gvp_lib.simulation.moving import Rocking

CLEAN = {"noise": {}, "variation": {}, "target": "cuboid_1x2", "seed": 3}
ROUGH = {**CLEAN, "variation": {"light": 0.4}}


@pytest.fixture
def tiny(monkeypatch):
    """One small set and one small network under the names of all of them."""
    monkeypatch.setitem(ARCHITECTURES, "tiny", TINY)
    recipe = CollectionRecipe(arm="floating", n=96, sampling="random", shard=96, seed=5)
    config = TrainConfig(network="tiny", size=32, shift=2, epochs=1, step=float(np.radians(20)))
    monkeypatch.setattr(preparation, "SETS", dict.fromkeys(SETS, recipe))
    small = {
        name: Recipe(told.sets[:1], replace(config, target=told.config.target, seed=told.config.seed))
        for name, told in NETWORKS.items()
    }
    for module in (networks, preparation):
        monkeypatch.setattr(module, "NETWORKS", small)
    monkeypatch.setattr(learned_tables, "OTHERS", ("cuboid_1x1 in blue",))
    monkeypatch.setattr(following, "WATCHED", 0.5)
    few = {path: PATHS[path] for path in ("still", "rocks by 10 deg in 2.5 s")}
    monkeypatch.setattr(learned_tables, "PATHS", few)
    return small


def test_a_start_is_on_the_sphere_within_the_cap():
    varied = cell_of({**CLEAN, "k": 0})
    for k in range(5):
        start = begin(varied, {**CLEAN, "k": k})
        away = varied.cell.truth.world_from_camera.translation - varied.cell.truth.world_from_object.translation
        assert np.linalg.norm(away) == pytest.approx(RADIUS, abs=2e-3)
        assert 0 <= start.tilt <= np.radians(30)


def test_a_start_and_its_look_do_not_depend_on_what_was_before():
    pictures = []
    for before in ((), (4, 2)):
        varied = cell_of({**ROUGH, "k": 0})
        for k in (*before, 1):
            begin(varied, {**ROUGH, "k": k})
        pictures.append(varied.cell.arm.capture())
    np.testing.assert_array_equal(*pictures)


def test_light_that_varies_changes_the_look_and_not_the_place():
    seen = {}
    for name, job in (("clean", CLEAN), ("rough", ROUGH)):
        varied = cell_of({**job, "k": 1})
        start = begin(varied, {**job, "k": 1})
        seen[name] = start.tilt, varied.cell.arm.capture()
    assert seen["clean"][0] == seen["rough"][0]
    assert not np.array_equal(seen["clean"][1], seen["rough"][1])


def test_the_oracle_ends_within_the_floor_and_chance_does_not():
    rows = [step_over_once({**CLEAN, "k": k, "methods": {"oracle": {}, "stay": {}, "chance": {}}}) for k in range(3)]
    assert max(row["oracle"]["total"] for row in rows) < 0.8 * 5
    assert {row["oracle"]["outcome"] for row in rows} == {"aligned"}
    assert all(row["stay"]["total"] == pytest.approx(row["start"]["tilt"], abs=0.5) for row in rows)
    assert np.mean([row["chance"]["total"] for row in rows]) > 2 * np.mean([row["oracle"]["total"] for row in rows])


def test_smaller_steps_end_nearer():
    ends = {}
    for step in (2.5, 10):
        methods = {"oracle, steps": {"planner": {"step": float(np.radians(step))}}}
        ends[step] = np.mean([step_over_once({**CLEAN, "k": k, "methods": methods})["oracle, steps"]["total"]
                              for k in range(4)])  # fmt: skip
    assert ends[2.5] < ends[10]


def test_a_brick_in_blue_has_its_shape_and_the_1x2s_color():
    blue, own = spec_of("cuboid_1x3 in blue"), spec_of("cuboid_1x3")
    assert blue.normals == own.normals
    assert blue.segmenter == spec_of("cuboid_1x2").segmenter
    assert str(blue.mjcf).count("stud_") == str(own.mjcf).count("stud_") == 12


def test_every_network_that_a_table_asks_for_is_known():
    for name in ("table-3.3", "table-3.4", "direction-head", "augmentation"):
        jobs = learned_jobs(name, seed=1, starts=3, large=True)
        assert set(learned_tables._networks(jobs)) <= set(NETWORKS)
        assert {key.rpartition("/")[2] for key in jobs} == {"0", "1", "2"}
    assert set(learned_tables._networks(following_jobs(1, 1))) <= set(NETWORKS)
    assert all(set(recipe.sets) <= set(SETS) for recipe in NETWORKS.values())


def test_resnet_50_is_in_the_thesiss_tables_where_it_is_asked_for():
    sets = {"random", "uniform"}
    with_it = {"table-3.3": (2, 2), "table-3.4": (5, 2), "direction-head": (0, 0), "augmentation": (0, 0)}
    for name, (cases, sharp) in with_it.items():
        small, large = (learned_jobs(name, seed=1, starts=1, large=large) for large in (False, True))
        more = [set(large[key]["methods"]) - set(small[key]["methods"]) for key in small]
        assert sum({f"{each}, ResNet-50" for each in sets} <= new for new in more) == cases
        assert sum({f"{each}, ResNet-50, 128 px" for each in sets} <= new for new in more) == sharp
        assert all(large[key]["methods"].items() >= small[key]["methods"].items() for key in small)
    jobs = learned_jobs("table-3.3", seed=1, starts=1, large=True)
    every = jobs["clean/cuboid_1x2/0"]["methods"]["ten trainings, ResNet-50, 128 px"]["network"]
    assert len({NETWORKS[each].config.seed for each in every}) == 10
    assert {NETWORKS[each].config.network for each in every} == {"resnet50"}
    for sigma in (10, 7, 5):
        close = NETWORKS[jobs["clean/cuboid_1x2/0"]["methods"][f"sigma {sigma} deg, ResNet-50"]["network"]]
        assert close.config == NETWORKS["1x2-random-resnet50-64px"].config
        assert SETS[close.sets[0]] == replace(SETS["1x2-random"], sigma=np.radians(sigma))


def test_the_thesiss_own_networks_are_trained_as_it_says():
    for name in ("1x2-random-0", "soup-random-0", "1x2-uniform-0"):
        own, sharp = (NETWORKS[name.replace("-0", f"-resnet50-{end}")] for end in ("64px", "0"))
        config = NETWORKS[name].config
        assert own.sets == sharp.sets == NETWORKS[name].sets
        assert own.config == replace(config, network="resnet50")
        assert sharp.config == replace(own.config, size=128, shift=16)
        told = config.epochs, config.batch, config.learning_rate, config.gamma, config.decay_every, config.share
        assert told == (20, 32, 1e-3, 0.1, 5, 0.7)
        assert (config.size, config.shift, config.turns, config.colors) == (64, 8, False, False)
        assert SETS[NETWORKS[name].sets[0]].n == 4096


@pytest.mark.parametrize("name", [pytest.param("table-3.4", marks=pytest.mark.full), "moving-object"])
def test_a_table_collects_trains_runs_and_stores(tiny, tmp_path, name):
    settings = Settings(1, folder=tmp_path, progress=False)
    result = read_result(reproduce(name, settings))
    assert result["command"] == f"gvp reproduce {name} --starts 1 --seed 2020"
    if name == "table-3.4":
        summary = result["content"]["summary"]["clean/cuboid_1x1 in blue"]
        assert {"random", "uniform", "stay", "chance", "oracle", "ours", "uniform - random"} <= summary.keys()
        assert summary["oracle"]["error"]["n"] == 1
        told = result["content"]["networks"]["1x2-random-0"]
        assert len(told["sha256"]) == 64
        assert (told["network"], told["size"], told["device"]) == ("tiny", 32, device_name(find_device("auto")))
    else:
        assert result["content"]["summary"].keys() == learned_tables.PATHS.keys()
        assert result["content"]["summary"]["still"]["tilt"]["error"]["mean"] < 5
    assert [file.name for file in tmp_path.iterdir() if file.name.endswith(".journal")] == []


def test_resnet_50_is_refused_where_there_is_no_gpu_or_no_place_for_it(tmp_path):
    settings = Settings(1, folder=tmp_path, progress=False, resnet50=True)
    with pytest.raises(InvalidParameterError, match=r"is for figure-3\.3, .*table-3\.1 is the same without"):
        reproduce("table-3.1", settings)
    if not networks.gpu_at_hand():
        with pytest.raises(InvalidParameterError, match="Without --resnet50 the small networks"):
            reproduce("table-3.3", settings)


@pytest.mark.full
def test_resnet_50_has_its_curve_and_its_rows(tiny, tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "gpu_at_hand", lambda: True)
    settings = Settings(1, folder=tmp_path, progress=False, resnet50=True)
    curves = read_result(reproduce("figure-3.4", settings))["content"]["curves"]
    assert curves["ResNet-50, 128 px"]["n"] == 1
    result = read_result(reproduce("table-3.4", settings))
    assert result["command"].endswith(" --resnet50")
    summary = result["content"]["summary"]
    assert {"random, ResNet-50", "random, ResNet-50, 128 px"} <= summary["clean/cuboid_1x1 in blue"].keys()


def test_an_object_can_be_found_without_its_color(monkeypatch):
    used = []

    class Planner(CnnPlanner):
        def plan(self, arm):
            used.append(type(self.segmenter))
            return super().plan(arm)

    monkeypatch.setattr(learned, "CnnPlanner", Planner)
    shipped = {"weights": "tilt-1x2", "planner": {"survey": 0}}
    step_over_once({**CLEAN, "k": 0, "methods": {"by color": shipped, "salient": {**shipped, "salient": True}}})
    assert used == [type(spec_of("cuboid_1x2").segmenter), Saliency]


@pytest.mark.full
def test_a_figure_holds_mean_and_spread_of_its_trainings(tiny, tmp_path):
    settings = Settings(2, folder=tmp_path, progress=False)
    for name in ("figure-3.3", "figure-3.4"):
        content = read_result(reproduce(name, settings))["content"]
        curve = content["curves"]["random adamw"]
        assert curve["n"] == 2
        assert np.mean(curve["accuracy"]["all"], axis=0) == pytest.approx(curve["accuracy"]["mean"], abs=1e-3)
        assert (curve["network"], curve["device"]) == ("tiny", device_name(find_device("auto")))
    assert len(list((tmp_path / ".work" / "networks").iterdir())) == 6  # both figures are of the same trainings


@pytest.mark.full
def test_a_training_that_fails_says_which_and_keeps_the_others(tiny, tmp_path, monkeypatch):
    monkeypatch.setitem(tiny, "1x2-uniform-0", Recipe(("1x2-uniform",), replace(
        tiny["1x2-uniform-0"].config, learning_rate=100.0, optimizer="sgd", epochs=3)))  # fmt: skip
    with pytest.raises(GvpError, match="network '1x2-uniform-0' could not be trained"):
        reproduce("table-3.4", Settings(1, folder=tmp_path, progress=False))
    assert (tmp_path / ".work" / "networks" / "1x2-random-0" / "weights.safetensors").is_file()


def test_a_follower_keeps_to_an_object_that_slides():
    methods = {"tilt": {"weights": "tilt-1x2", "planner": {"survey": 0}}}
    row = follow_once({**CLEAN, "k": 0, "path": "slides at 5 mm/s", "methods": methods})
    assert row["tilt"]["error"] < 4
    assert not row["tilt"]["lost"]


def test_a_follower_is_watched_for_a_whole_swing_after_it_has_settled(monkeypatch):
    seen = []

    class Seen(Rocking):
        def __call__(self, seconds):
            seen.append(seconds)
            return super().__call__(seconds)

    monkeypatch.setitem(PATHS, "rocks", Seen(np.radians(5), 3.0))
    methods = {"actions": {"weights": "actions-1x2"}}
    told = follow_once({**CLEAN, "k": 0, "path": "rocks", "methods": methods})["actions"]
    before = SETTLED * told["seconds"]
    assert max(seen) == pytest.approx(before + 3.0, abs=0.5)
    assert 0 < told["error"] < 15


def test_all_names_can_be_reproduced():
    assert {"figure-3.3", "figure-3.4", "table-3.3", "table-3.4"} <= set(TABLES)
