"""The stored results say what made them, and the golden episodes are theirs; `make full` runs those again."""

import json
from pathlib import Path

import golden
import pytest
from scipy.stats import binomtest

from gvp_book.results import read_result
from gvp_book.tables import TABLES
from gvp_lib import __version__

RESULTS = Path(__file__).parents[2] / "book" / "results"
AWAITED = {"objects"}
"""Results of which a full run is not stored yet: `gvp reproduce NAME`."""
AWAITED_GOLDEN = (
    "ours", "placing", "beside", "mixed",
    "among/soap/0", "alone/soap/1", "alone/mug/0", "among/mug/0", "among/soap/1", "alone/mug/1", "among/soap/2",
    "alone/mug/2", "among/mug/2",
)  # fmt: skip
"""Groups of Table 3.2, and starts of `objects` that are grasped in another way now, whose golden episodes are not yet
written: `tests/golden.py write table-3.2 objects`."""
ROWS = [name for name in golden.NAMES if name not in ("networks", "moving-object", "outlines", "photographs", *AWAITED)]


def content(name):
    return read_result(RESULTS / f"{name}.json")["content"]


def test_every_table_is_stored_with_its_command_and_provenance():
    assert {path.stem for path in RESULTS.glob("*.json")} - {"benchmarks"} == TABLES.keys() - AWAITED
    for name in TABLES.keys() - AWAITED:
        result = read_result(RESULTS / f"{name}.json")
        assert result["command"].startswith(f"gvp reproduce {name} ")
        assert result["seeds"]
        assert result["versions"]["mujoco"]
        assert result["versions"]["gvp_lib"] in ("0.1.0", __version__)  # what version 0.1 wrote opens


def test_every_result_with_episodes_has_three_golden_starts_of_every_case():
    assert {*golden.NAMES, "figure-3.3", "figure-3.4"} == {*TABLES, "networks"}
    for name in golden.NAMES:
        starts = 1 if name == "networks" else golden.STARTS
        jobs = golden.replays(name).first(starts)
        jobs = {key for key in jobs if not key.startswith(AWAITED_GOLDEN)}
        assert golden.read(name)[1].keys() == jobs, name


@pytest.mark.parametrize("name", ROWS)
def test_the_golden_episodes_are_those_of_the_stored_result(name):
    """What was stored by another machine, or before another version of a package, may differ where an answer leaps."""
    stored = content(name)["rows"]
    off = []
    for key, row in golden.read(name)[1].items():
        case, _, k = key.rpartition("/")
        group = case.partition("/")[0]
        merged = {"ours": "thesis", "baselines": "thesis", "mixed": "thesis", "beside": "placing"}  # rows of Table 3.2
        case = case.replace(f"{group}/", f"{merged.get(group, group)}/")
        if case not in stored:
            assert group in {key.partition("/")[0] for key in golden.replays(name).jobs}, "a sweep has no rows"
            continue
        tilt = row["start"]["tilt"] if "start" in row else row["tilt"]
        assert tilt == pytest.approx(stored[case]["tilt"][int(k)], abs=0.11), key
        for method in row.keys() & stored[case].keys() - {"tilt", "azimuth", "stands", "comes"}:
            columns = stored[case][method]
            errors = columns.get("total", columns.get("error", []))
            if int(k) < len(errors) and errors[int(k)] is not None:
                off.append(abs(row[method].get("total", row[method].get("error")) - errors[int(k)]))
    # Of reach all is compared above, and no network of the augmentation comes with the library.
    assert len(off) > 5 or name in ("reach", "augmentation")
    assert sum(error <= 0.5 for error in off) >= 0.9 * len(off), off


def test_the_golden_episodes_of_outlines_are_the_stored_ones():
    stored = content("outlines")["rows"]
    for key, row in golden.read("outlines")[1].items():
        case, _, k = key.rpartition("/")
        assert row["total"] == pytest.approx(stored[case][int(k)], abs=0.5), key


def test_the_golden_episodes_of_photographs_are_the_stored_ones():
    stored = content("photographs")["rows"]
    for key, row in golden.read("photographs")[1].items():
        if key.startswith("sheet/"):
            assert row["error"] == pytest.approx(stored[key]["error"], abs=0.3), key
        else:
            assert row["iou"] == pytest.approx(stored[key]["iou"], abs=0.03), key


def test_the_moving_objects_golden_episodes_are_within_the_stored_spread():
    stored = content("moving-object")["summary"]
    for key, row in golden.read("moving-object")[1].items():
        for method, found in row.items():
            error = stored[key.rpartition("/")[0]][method]["error"]
            assert found["error"] == pytest.approx(error["mean"], abs=4 * max(error["sd"], 0.2)), (key, method)


def test_a_row_that_differs_in_its_last_bit_is_found():
    row = {"start": {"tilt": 20.0}, "ours": {"error": [1.0, None], "success": True}}
    assert golden.differing(row, row) == []
    moved = {**row, "start": {"tilt": 20.000000000000004}}
    assert golden.differing(row, moved) == ["start.tilt was 20.0 and is 20.000000000000004"]
    assert len(golden.differing(row, {"start": {"tilt": 20.0}})) == 1


def test_on_another_platform_some_cases_are_compared_within_tolerances():
    row = {
        "start": {"tilt": 20.0},
        **{m: {"total": e} for m, e in (("quartic", 9.0), ("ours", 0.3), ("look_down", 1.0))},
    }
    was, found = ({**row, "silhouette": {"total": error}} for error in (0.5, 1.2))
    found["quartic"] = {"total": 11.0}
    off = ["silhouette.total was 0.5 and is 1.2"]
    assert golden.far_off("table-3.1", "thesis/cuboid_1x2/flat/0", was, found) == off
    assert golden.far_off("table-3.1", "thesis/cylinder/flat/0", was, found) == []  # a can's quartic leaps
    for name, cases in golden.NEAR.items():
        rows = golden.read(name)[1]
        assert not any(golden.far_off(name, f"{case}/0", rows[f"{case}/0"], rows[f"{case}/0"]) for case in cases)


def test_ours_keeps_its_promises_of_table_3_1():
    """Means and regions over all starts, whether or not the plan arrived; each object and noise apart, n >= 200."""
    stored = content("table-3.1")
    bricks_and_can = {case: s for case, s in stored["summary"].items() if "alligator" not in case}
    pooled = stored["pooled"]["thesis"]["ours"]
    assert pooled["error"]["mean"] <= 0.8
    assert pooled["error"]["p95"] <= 2
    assert pooled["views"] <= 8
    assert pooled["frames"] <= 25
    assert max(s["ours"]["error"]["mean"] for s in bricks_and_can.values()) <= 1.2
    unexplained = sum(s["ours"]["outcomes"].get("unexplained", 0) for s in bricks_and_can.values())
    assert unexplained <= 0.02 * sum(s["ours"]["error"]["n"] for s in bricks_and_can.values())
    for noise in ("thesis", "none"):
        assert 0.85 <= stored["pooled"][noise]["ours"]["in_90"]["rate"] <= 0.95
        for target in ("cuboid_1x1", "cuboid_1x2", "cuboid_1x4", "cylinder"):
            each = [s["ours"]["in_90"] for case, s in bricks_and_can.items() if case.startswith(f"{noise}/{target}/")]
            n = sum(one["n"] for one in each)
            assert n >= 200
            # Over a perfect arm a can is known to a twentieth of a degree, and the fit does not dare to claim that.
            most = 1.0 if (noise, target) == ("none", "cylinder") else 0.97
            assert 0.80 <= sum(one["n"] * one["rate"] for one in each) / n <= most


def test_ours_fails_no_more_often_than_that_of_version_0_1_from_the_same_starts():
    """By McNemar's test, exact: of the starts from which one of the two failed, so many are no accident."""
    held = json.loads((Path(__file__).parent / "held-in-0.1.json").read_text())
    rows = content("table-3.2")["rows"]
    both = [pair for case, was in held.items() for pair in zip(was, rows[case]["ours"]["success"], strict=True)]
    worse, better = both.count(("1", "0")), both.count(("0", "1"))
    assert worse + better == 0 or binomtest(worse, worse + better, alternative="greater").pvalue > 0.05


def test_what_leans_or_lies_on_a_ramp_can_be_placed_and_what_leans_steeply_is_held():
    """Bricks, can and carton; a hand that comes straight down holds many of them, and can place next to none."""
    stored = content("table-3.2")
    for placement in ("tilted", "ramp"):
        methods = stored["placing"][placement]
        assert methods["ours"]["n"] >= 240
        assert methods["ours"]["placeable"]["rate"] >= 0.95
        assert methods["look_down"]["placeable"]["rate"] < 0.05
    assert stored["placing"]["steep"]["ours"]["shaken"]["rate"] >= 0.90
    steep = [row for case, row in stored["rows"].items() if case.startswith("placing/") and case.endswith("/steep")]
    pairs = [pair for row in steep for pair in zip(row["ours"]["success"], row["look_down"]["success"], strict=True)]
    assert len(pairs) >= 240
    assert pairs.count(("1", "0")) >= pairs.count(("0", "1"))


def test_no_grasp_of_table_3_2_sinks_in_or_flies():
    stored = content("table-3.2")["contacts"]
    contacts = {(group, method): each for group, methods in stored.items() for method, each in methods.items()}
    assert sum(each["n"] for each in contacts.values()) >= 10_900  # as many as the experiment has, methods counted
    # A hand that knows nothing of a slope comes down on what lies there, and presses it against that as hard as it can.
    blind = [contacts.pop(("placing", method)) for method in ("look_down", "stay", "random")]
    assert max(each["deepest"] for each in contacts.values()) <= 1.5  # mm
    assert max(each["fastest"] for each in contacts.values()) <= 1.5  # m/s
    assert sum(each["beyond_1.5mm"] for each in blind) <= 0.001 * sum(each["n"] for each in blind)
    assert max(each["deepest"] for each in blind) <= 2.0
    assert max(each["fastest"] for each in blind) <= 2.0


def test_packages_in_photographs_are_measured_or_said_to_be_unexplained():
    """Six packages of several colors on the sheet, by the public call alone; and without a sheet by a segmenter."""
    stored = content("photographs")
    everything = stored["sheet"]["all"]
    assert everything["n"] >= 60
    assert everything["error"]["median"] <= 1
    assert everything["sizes"]["median"] <= 2
    assert everything["error"]["worst"] <= 3
    assert everything["explains"] >= 0.8
    assert everything["iou"]["median"] >= 0.95
    means = {name: [each["mean"] for each in packages.values()] for name, packages in stored["bare"].items()}
    assert max(sum(each) / len(each) for each in means.values()) >= 0.95


@pytest.mark.parametrize("name", ["figure-3.3", "figure-3.4"])
def test_each_curve_is_of_twenty_epochs_and_its_mean_is_that_of_its_trainings(name):
    for curve in content(name)["curves"].values():
        for score in (curve["accuracy"], curve["loss"]):
            assert (len(score["all"]), len(score["all"][0])) == (curve["n"], 20)
            means = [sum(column) / len(column) for column in zip(*score["all"], strict=True)]
            assert means == pytest.approx(score["mean"], rel=1e-3)
