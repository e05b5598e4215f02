"""Things that nobody designed a planner for: what is run of them, what rows add up to, and how one's own join."""

import numpy as np
import pytest

from gvp_book.experiments import objects
from gvp_book.experiments.objects import SEED, object_jobs, object_once, object_report, own_thing
from gvp_book.experiments.things import THINGS, encounters
from gvp_book.results import read_result
from gvp_lib import Noise, WorkCell
from gvp_lib.cli import main
from gvp_lib.evaluation.statistics import wilson_interval
from gvp_lib.perception import blobs_from_mask

BOX = np.array([(x, y, z) for x in (0, 90) for y in (0, 40) for z in (0, 30)])  # mm, away from its origin
FACES = "1 2 4 3, 5 7 8 6, 1 5 6 2, 3 4 8 7, 1 3 7 5, 2 6 8 4"
BALL = '<mujoco><worldbody><body><geom type="sphere" size="0.03"/></body></worldbody></mujoco>'


@pytest.fixture
def box(tmp_path):
    """A mesh in mm."""
    lines = [f"v {x} {y} {z}" for x, y, z in BOX] + [f"f {face}" for face in FACES.split(", ")]
    path = tmp_path / "box.obj"
    path.write_text("\n".join(lines))
    return path


def test_every_encounter_is_run_and_of_a_few_some_of_every_kind():
    jobs = object_jobs(SEED, 25)
    met = encounters()
    assert {key: {name: job[name] for name in met[key]} for key, job in jobs.items()} == met
    first = list(jobs.items())[: 4 * 2 * len(THINGS)]
    assert {(key.partition("/")[0], job["target"], job["placement"]) for key, job in first} == {
        (met, name, placement)
        for met in ("alone", "among")
        for name in THINGS
        for placement in ("flat", "tilted", "steep", "ramp")
    }
    assert object_jobs(SEED, 3).items() < jobs.items()
    for job in jobs.values():
        assert ({"thesis", "moments"} <= {*job["methods"]}) is (job["k"] < 4)
        assert {"ours", "look_down", "oracle"} <= {*job["methods"]}


def test_a_thing_is_grasped_alone_and_among_others_from_the_same_place():
    jobs = object_jobs(SEED, 1)
    alone, among = (object_once({**jobs[f"{met}/nut/0"], "methods": ["oracle"]}) for met in ("alone", "among"))
    assert alone.keys() == among.keys() == {"tilt", "oracle"}
    assert alone["tilt"] == among["tilt"]
    assert alone["oracle"]["shaken"]
    assert abs(alone["oracle"]["roll"]) < 1
    assert among["oracle"]["shaken"]
    assert abs(among["oracle"]["roll"]) > 30, "its neighbors leave room for the fingers only the other way round"
    report = object_report({"alone/nut/0": alone, "among/nut/0": among})
    held = {met: report["summary"][f"{met}/nut"]["oracle"]["shaken"]["successes"] for met in ("alone", "among")}
    assert held == {"alone": 1, "among": 1}
    assert report["things"] == {"nut": THINGS["nut"].title}


def grasp(held, tilt=1.0, **more):
    """A row as an episode has it, of a grasp that was shaken, with fields for a summary."""
    row = {"plan": "aligned", "outcome": "held", "error": 1.0, "roll": 0.5, "frames": 30, "seconds": 10.0, "views": 8,
           "pictures": 25, "deepest": 0.5, "fastest": 0.2, "success": held, **more}  # fmt: skip
    in_hand = {"tilt_in_hand": tilt, "turn_in_hand": 1.0, "shift_in_hand": 0.3, "shaken": True}
    return {**(in_hand if held else {"cause": "slipped"}), **row}


def test_what_is_held_is_counted_beside_what_the_oracle_holds():
    oracle, ours = "1101", "1010"
    rows = {
        f"alone/mug/{k}": {"tilt": 20.0, "ours": grasp(ours[k] == "1", views=5 + k), "oracle": grasp(oracle[k] == "1")}
        for k in range(4)
    }
    rows["alone/mug/4"] = {"not begun": "no place within reach"}
    rows["alone/mug/5"] = {"tilt": 20.0, "ours": grasp(True, plan="unexplained"), "look_down": grasp(True, tilt=20.0)}
    rows["alone/soap/5"] = {"tilt": 20.0, "ours": grasp(True, shaken=False), "look_down": grasp(False)}
    report = object_report(dict(reversed(rows.items())))
    mug = report["summary"]["alone/mug"]
    assert (mug["starts"], mug["begun"]) == (6, 5)
    assert report["not begun"] == {"alone/mug/4": "no place within reach"}
    assert [mug["ours"]["shaken"][name] for name in ("successes", "n")] == [3, 5]
    assert mug["ours"]["shaken"]["interval"] == wilson_interval(3, 5)
    assert [mug["ours"]["where the oracle holds"][name] for name in ("successes", "n")] == [1, 3]
    assert mug["ours"]["plans"] == {"aligned": 4, "unexplained": 1}
    assert mug["ours"]["outcomes"] == {"held": 5}
    assert mug["ours"]["views"] == np.mean([5, 6, 7, 8, 8])
    assert (mug["look_down"]["shaken"]["successes"], mug["look_down"]["placeable"]["successes"]) == (1, 0)
    assert report["placements"]["alone/tilted"]["ours"]["n"] == 3  # starts 1 and 5
    alone = report["pooled"]["alone"]
    assert (alone["ours"]["successes"], alone["ours"]["shaken"]["successes"], alone["ours"]["n"]) == (4, 3, 6)
    assert (alone["ours - look_down, held"].mean, alone["ours - look_down, placeable"].mean) == (0.0, 0.5)
    assert report["pooled"]["alone, not convex"]["ours"]["n"] == 5  # the soap is
    kept = report["rows"]["alone/mug"]
    assert kept["tilt"] == [20.0, 20.0, 20.0, 20.0, None, 20.0]
    assert [kept[name]["success"] for name in ("ours", "oracle", "look_down")] == ["1010-1", "1101", "-----1"]


def test_what_finds_no_rest_is_no_failure_of_the_program(tmp_path):
    path = tmp_path / "ball.xml"
    path.write_text(BALL)
    job = {**object_jobs(SEED, 1)["alone/soap/0"], "target": "ball", "placement": "ramp", "own": {"path": str(path)}}
    assert "does not come to rest 'ramp'" in object_once(job)["not begun"]


# Your own


def test_a_mesh_of_ones_own_is_centered_painted_and_found(box):
    spec = own_thing(str(box), scale=1e-3)
    sides = 2e3 * spec.centered().bounding_box().half_extents
    assert sides == pytest.approx([90, 40, 30])
    with WorkCell("floating", spec, "tilted", noise=Noise.thesis(), others=[THINGS["mug"]], touching=True) as cell:
        mask = cell.segmenter(cell.arm.capture())
    assert blobs_from_mask(mask)[0].area > 0.99 * mask.sum() > 1000


def test_one_s_own_is_run_as_ours_are_and_stored_by_its_name(box, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(objects, "METHODS", ("look_down",))
    out = tmp_path / "results"
    options = ["--object", str(box), "--scale", "0.001", "--starts", "1", "--out", str(out), "--quiet"]
    assert main(["reproduce", "objects", *options]) == 0
    assert capsys.readouterr().out.strip() == str(out / "objects-box.json")
    result = read_result(out / "objects-box.json")
    assert result["command"] == f"gvp reproduce objects --object box.obj --scale 0.001 --starts 1 --seed {SEED}"
    assert result["replayed"].startswith("nothing of it by itself")
    assert result["content"]["things"]["box"]["scale"] == 0.001
    assert {case: each["look_down"]["n"] for case, each in result["content"]["summary"].items()} == {
        "alone/box": 1, "among/box": 1
    }  # fmt: skip


@pytest.mark.parametrize(("more", "said"), [
    ("table-3.1 --object box.obj", "join the experiment 'objects'; table-3.1 has none"),
    ("objects --object box.obj --object box.obj --scale 0.001", "'box' is taken"),
    ("objects --object none.xml", "there is no file"),
    ("objects --object box.obj", "measures"),  # 90 m
    ("objects --object box.obj --scale 0", "--scale is"),
])  # fmt: skip
def test_what_cannot_join_is_refused_before_anything_is_run(more, said, box, capsys, monkeypatch):
    monkeypatch.chdir(box.parent)
    assert main(["reproduce", *more.split(), "--starts", "1"]) == 2
    assert said in capsys.readouterr().err
    assert [path.name for path in box.parent.iterdir()] == ["box.obj"]
