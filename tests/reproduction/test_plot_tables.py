"""Tables of the stored results: what they show is what was stored."""

from pathlib import Path

import pytest

from gvp_book.experiments.learned import episodes_report, following_report
from gvp_book.plots import grasping, learned
from gvp_book.plots.reach import reach_map, reach_table
from gvp_book.plots.tables import Table, alignment_table, first_arc_effect, pooled_table, sweep_table
from gvp_book.results import read_result, rounded
from gvp_lib.errors import InvalidParameterError, UnknownNameError


def test_a_table_is_markdown_and_escaped_html():
    table = Table(["a<b", "n"], [["x", 1.25]])
    assert str(table).splitlines() == ["| a<b | n |", "|:--|--:|", "| x | 1.2 |"]
    assert "<th>a&lt;b</th>" in table._repr_html_()
    assert "<td>1.2 [1.0,&nbsp;1.4], 0.5</td>" in Table(["a"], [["1.2 [1.0, 1.4], 0.5"]])._repr_html_()
    with pytest.raises(InvalidParameterError, match="2 cells"):
        Table(["a", "b"], [["only one"]])


# Alignment


def aligned(mean, n=4, views=30.0, **outcomes):
    error = {"n": n, "mean": mean, "median": mean / 2, "p95": 2 * mean, "interval": {"low": mean - 1, "high": mean + 1}}
    return {"error": error, "arrived": {**error, "mean": mean / 4}, "views": views, "outcomes": outcomes}


ALIGNMENT = {
    "thesis": {"cuboid_1x2": {"mean": 12.4, "sd": 4.2}},
    "summary": {
        f"{group}/cuboid_1x2/{placement}": {
            "quartic": aligned(10.0, **{"aligned": 1, "any angle": 1, "collision": 2}),
            "silhouette": aligned(2.0, aligned=4),
        }
        for group in ("thesis", "none")
        for placement in ("flat", "tilted")
    },
    "pooled": {"thesis": {"quartic": aligned(8.0), "quartic - silhouette": {"mean": 6.0}}},
    "sweeps": {
        f"{name}/flat": {method: aligned(mean) for method, mean in now.items()}
        | {"unchanged": {method: aligned(mean) for method, mean in before.items()}}
        for name, now, before in (
            ("step/cuboid_1x1", {"quartic": 9.0, "silhouette": 1.0}, {"quartic": 7.0}),
            ("step/cuboid_1x2", {"quartic": 5.0, "silhouette": 3.0}, {"quartic": 3.0}),
            ("own/cuboid_1x2", {"full": 0.5}, {"silhouette": 0.6}),
            ("focal length +-5%/cuboid_1x2", {"quartic": 1.0, "silhouette": 1.0}, {}),
        )
    },
    "rows": {
        "none/cuboid_1x2/flat": {"quartic": {"first_arc": [1.0, -2.0, -9.0, None], "total": [2.0, 4.0, 20.0, 99.0]}},
        "none/cylinder/flat": {"quartic": {"first_arc": [1.0], "total": [70.0]}},
        "thesis/cuboid_1x2/flat": {"quartic": {"first_arc": [1.0], "total": [70.0]}},
    },
}


def test_a_case_shows_mean_interval_and_median_and_counts_what_failed():
    flat, tilted = alignment_table(ALIGNMENT).rows
    assert flat == ["cuboid_1x2, flat", "12.4", "10.0 [9.0, 11.0], 5.0", "2", "2.0 [1.0, 3.0], 1.0", "0", "4"]
    assert tilted[1] == "", "the thesis tilted nothing"
    assert pooled_table(ALIGNMENT).rows == [["quartic", "4", "8.00", "2.00", "4.00", "16.0", "30"]]  # no differences


def test_a_sweep_is_averaged_over_its_objects_and_may_lack_an_estimator():
    step, own, focal = sweep_table(ALIGNMENT).rows
    # Two intervals of plus and minus 1, each of half the mean: plus and minus the root of a half.
    assert step == ["step", "8", "5.0 [4.3, 5.7]", "7.0 [6.3, 7.7]", "", "2.0 [1.3, 2.7]", "30"]
    assert own == ["own", "4", "", "", "0.6 [-0.4, 1.6]", "0.5 [-0.5, 1.5]", "30"]
    assert focal[0] == "focal length ±5 %"


def test_the_first_arc_is_counted_by_the_size_of_its_error_on_bricks_alone():
    good, bad = first_arc_effect(ALIGNMENT).rows
    assert good[:2] == ["within 5 deg", "2"]
    assert good[2].startswith("3.0 [2.0, ")
    assert bad == ["off by 5 deg or more", "1", "20.0 [nan, nan]"], "one plan tells nothing of its scatter"


# Grasping


def tally(successes, **more):
    rate = {"n": 4, "successes": successes, "rate": successes / 4, "interval": {"low": 0.25, "high": 0.75}}
    return {**rate, "shaken": rate, "error": {"median": 3.0}, "frames": 25.4, "causes": {}, **more}


IN_HAND = {name: {"n": 2, "median": 1.0, "p95": 4.0} for name in ("tilt_in_hand", "turn_in_hand", "shift_in_hand")}
DIFFERENCE = {"n": 4, "mean": 0.25, "interval": {"low": -0.1, "high": 0.5}}
GRASPING = {
    "thesis": {"cuboid_1x2": [tally(4), tally(3)]},
    "summary": {
        f"{group}/cuboid_1x2/{placement}": {"thesis": tally(2), "ours": tally(3)}
        for group in ("thesis", "none")
        for placement in ("flat", "raised", "tilted")
    },
    "pooled": {"thesis": {"thesis": tally(2, **IN_HAND), "ours": tally(3), "ours - thesis": DIFFERENCE}},
}


def test_a_case_stands_beside_the_placement_that_the_thesis_tried():
    rows = grasping.grasping_table(GRASPING).rows
    assert [row[2].partition(" ")[0] for row in rows] == ["100", "75", ""], "the thesis leaned nothing"
    assert rows[0][3:] == ["50 [25, 75]", "75 [25, 75]", "4"]


def test_methods_and_differences_are_kept_apart_and_what_a_result_lacks_is_left_out():
    assert [row[0] for row in grasping.methods_table(GRASPING).rows] == ["thesis", "ours"]
    assert grasping.differences_table(GRASPING).rows == [["ours - thesis", "4", "+25.0 [-10.0, +50.0]"]]
    assert grasping.in_hand_table(GRASPING).rows == [["thesis", "2", "1.0, 4.0", "1.0, 4.0", "1.0, 4.0"]]
    assert grasping.methods_table(GRASPING, "none").rows == []


# The learned planner


def stored(name="table-3.3"):
    """A report of two starts on each of two objects."""
    end = {"outcome": "aligned", "frames": 3, "seconds": 1.0, "steps": 4}
    rows = {
        f"clean/{target}/{k}": {
            "start": {"tilt": 20.0 + k},
            "random": {**end, "total": error + k},
            "stay": {**end, "total": 20.0 + k, "outcome": ["out of steps", "target lost"][k]},
        }
        for target, error in (("cuboid_1x2", 2.0), ("cylinder", 6.0))
        for k in range(2)
    }
    return rounded(episodes_report(name, rows, {}), 4)  # as it is stored


def test_ends_stand_beside_what_the_thesis_printed():
    table = learned.ends_table(stored(), ["random", "ours"])
    assert table.columns == ["object", "thesis, n = 50", "random", "ours", "n"]
    assert table.rows[0] == ["cuboid_1x2", "4.5\xa0±\xa02.7", "2.5\xa0±\xa00.7 [2.0,\xa03.0]", "", "2"]
    assert table.rows[1][1] == ""
    assert learned.ends_table(stored("direction-head"), ["random"]).columns == ["object", "random", "n"]
    assert learned.means_over_objects(stored(), ["random", "ours"]).rows == [["random", "4.50"], ["ours", ""]]


def test_methods_say_how_their_plans_ended():
    random, stay = learned.methods_table(stored(), "cuboid_1x2").rows  # neither the start nor a difference
    assert [random[0], *random[3:]] == ["random", "-18.0", "4.0", "100", "0", "0", "2"]
    assert stay[5:8] == ["0", "50", "50"]


def test_a_followed_path_shows_every_method_and_what_was_lost():
    rows = {f"rocks/{k}": {"tilt": {"error": 1.0 + k, "lost": k == 1, "seconds": 0.3}} for k in range(2)}
    table = learned.following_table(rounded(following_report(rows), 4))
    assert table.columns == ["the object", "tilt [deg]", "lost", "n"]
    assert table.rows == [["rocks", "1.5 [1.0,\xa02.0]", "1", "2"]]


# Reach

REACH = read_result(Path(__file__).parents[2] / "book" / "results" / "reach.json")["content"]


def test_reach_has_a_row_for_each_arm_and_place_and_a_map_of_every_viewpoint():
    rows, maps = reach_table(REACH, cap=60).rows, reach_map(REACH, "baxter").axes
    first = REACH["summary"]["ur5e/fixed/in the workspace/60"]
    assert rows[0][2].startswith(f"{100 * first['stands']['share']:.0f} [")
    assert len(rows) == len(maps) == 8
    for ax in maps:
        assert sum(len(points.get_offsets()) for points in ax.collections) == 2 * first["n"]


@pytest.mark.parametrize(("ask", "known"), [
    (lambda: reach_table(REACH, cap=45), "30, 60"),
    (lambda: reach_map(REACH, "panda"), "baxter, ur5e"),
    (lambda: learned.ends_table(stored(), ["random"], "rough"), "clean"),
    (lambda: learned.methods_table(stored(), "alligator"), "cylinder"),
])  # fmt: skip
def test_what_a_result_does_not_have_is_refused_with_what_it_has(ask, known):
    with pytest.raises(UnknownNameError, match=known):
        ask()
