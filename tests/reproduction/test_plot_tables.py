"""Tables of the stored results: what they show is what was stored."""

from pathlib import Path

import numpy as np
import pytest

from gvp_book.plots import grasping, learned
from gvp_book.plots.reach import reach_map, reach_table
from gvp_book.plots.tables import (
    Table,
    alignment_table,
    first_arc_effect,
    outlines_table,
    pooled_table,
    sweep_table,
)
from gvp_book.results import read_result
from gvp_lib.errors import InvalidParameterError, UnknownNameError

RESULTS = Path(__file__).parents[2] / "book" / "results"
ALIGNMENT, GRASPING, ENDS, OTHERS, HEADS, FOLLOWING, REACH, OUTLINES = (
    read_result(RESULTS / f"{name}.json")["content"]
    for name in (
        "table-3.1",
        "table-3.2",
        "table-3.3",
        "table-3.4",
        "direction-head",
        "moving-object",
        "reach",
        "outlines",
    )
)
FLAT = ALIGNMENT["summary"]["thesis/cuboid_1x2/flat"]
SWEEPS = ALIGNMENT["sweeps"]
STEPS, OWN = ([SWEEPS[case] for case in SWEEPS if case.startswith(name)] for name in ("step=10mm/", "own traversal/"))
SIDE = GRASPING["summary"]["thesis/cylinder/side"]
POOLED, WITHOUT = GRASPING["pooled"]["thesis"], GRASPING["pooled"]["none"]
BRICK, HEAD = ENDS["summary"]["clean/cuboid_1x2"], HEADS["summary"]
SLOW = FOLLOWING["summary"]["slides at 5 mm/s"]


def test_a_table_is_markdown_and_escaped_html():
    table = Table(["a<b", "n"], [["x", 1.25]])
    assert str(table).splitlines() == ["| a<b | n |", "|:--|--:|", "| x | 1.2 |"]
    assert "<th>a&lt;b</th>" in table._repr_html_()
    assert "<td>1.2 [1.0,&nbsp;1.4], 0.5</td>" in Table(["a"], [["1.2 [1.0, 1.4], 0.5"]])._repr_html_()
    with pytest.raises(InvalidParameterError, match="2 cells"):
        Table(["a", "b"], [["only one"]])


def mean(entries, method):
    return np.mean([entry[method]["error"]["mean"] for entry in entries])


def rate(successes, n):
    return {"successes": successes, "n": n, "rate": successes / n, "interval": {"low": 0.0, "high": 1.0}}


def failed(method):
    return method["error"]["n"] - method["arrived"]["n"]


def by_size(off):
    """Means of the thesis's planner on bricks, by whether its first arc was ``off`` by 5 deg or more, and how many."""
    cases = [row["quartic"] for case, row in ALIGNMENT["rows"].items() if case.startswith("none/cuboid")]
    pairs = [pair for row in cases for pair in zip(row["first_arc"], row["total"], strict=True) if pair[0] is not None]
    ends = [end for first, end in pairs if (abs(first) >= 5) is off]
    return [len(ends), np.mean(ends)]


@pytest.mark.parametrize(("table", "row", "values"), [
    (alignment_table(ALIGNMENT), "cuboid_1x2, flat",
     [12.4, FLAT["quartic"]["error"]["mean"], failed(FLAT["quartic"]), FLAT["silhouette"]["error"]["mean"],
      failed(FLAT["silhouette"]), FLAT["ours"]["error"]["mean"], failed(FLAT["ours"]), 100]),
    (alignment_table(ALIGNMENT), "cuboid_1x2, tilted", [None]),  # the thesis tilted nothing
    (pooled_table(ALIGNMENT), "quartic",
     [1400, *(ALIGNMENT["pooled"]["thesis"]["quartic"][name]["mean"] for name in ("error", "arrived"))]),
    # A variation is averaged over its objects, beside the same starts without it; and may lack an estimator.
    (sweep_table(ALIGNMENT), "step of 10 mm",
     [48, mean([step["unchanged"] for step in STEPS], "quartic"), mean(STEPS, "quartic"),
      mean([step["unchanged"] for step in STEPS], "silhouette"), mean(STEPS, "silhouette")]),
    (sweep_table(ALIGNMENT), "the fit leads the arm",
     [48, mean([own["unchanged"] for own in OWN], "quartic"), None,
      mean([own["unchanged"] for own in OWN], "silhouette"), mean(OWN, "full")]),
    (outlines_table(OUTLINES), "walled",
     [96, *(OUTLINES["summary"]["walled"]["error"][name] for name in ("mean", "median", "p95")),
      OUTLINES["summary"]["walled"]["outcomes"]["aligned"]]),
    (first_arc_effect(ALIGNMENT), "within 5 deg", by_size(False)),
    (first_arc_effect(ALIGNMENT), "off by 5 deg or more", by_size(True)),
    (grasping.methods_table(GRASPING), "ours",
     [POOLED["ours"]["n"], 100 * POOLED["ours"]["rate"], 100 * POOLED["ours"]["shaken"]["rate"],
      100 * POOLED["ours"].get("placeable", {"rate": np.nan})["rate"],  # which version 0.1 did not store
      POOLED["ours"]["error"]["median"]]),
    (grasping.methods_table(GRASPING, "none"), "thesis", [WITHOUT["thesis"]["n"], 100 * WITHOUT["thesis"]["rate"]]),
    (grasping.differences_table(GRASPING), "ours - thesis",
     [POOLED["ours - thesis"]["n"], 100 * POOLED["ours - thesis"]["mean"]]),
    (grasping.in_hand_table(GRASPING), "thesis",
     [POOLED["thesis"]["tilt_in_hand"]["n"], POOLED["thesis"]["tilt_in_hand"]["median"]]),
    (learned.ends_table(ENDS, ["random", "varied"]), "cuboid_1x2", [4.5, BRICK["random"]["error"]["mean"], None, 200]),
    (learned.ends_table(HEADS, ["all"]), "cylinder", [HEAD["clean/cylinder"]["all"]["error"]["mean"], 200]),
    (learned.methods_table(ENDS, "cuboid_1x2"), "random",
     [BRICK["random"]["error"]["mean"], BRICK["random"]["error"]["p95"], BRICK["random"]["change"]["mean"],
      BRICK["random"]["steps"]["mean"], round(100 * BRICK["random"]["outcomes"]["aligned"] / 200)]),
    (learned.means_over_objects(HEADS, ["all", "nothing"]), "all",
     [mean([found for case, found in HEAD.items() if case.startswith("clean/")], "all")]),
    (learned.means_over_objects(HEADS, ["all", "nothing"]), "nothing", [None, None]),
    (learned.following_table(FOLLOWING), "slides at 5 mm/s",
     [SLOW["actions"]["error"]["mean"], SLOW["tilt"]["error"]["mean"]]),
])  # fmt: skip
def test_a_row_shows_what_was_stored(table, row, values):
    cells = next(cells for first, *cells in table.rows if first == row)
    shown = [float(cell.replace(",", " ").split()[0]) if cell else np.nan for cell in cells[: len(values)]]
    assert shown == pytest.approx([np.nan if value is None else value for value in values], abs=0.0501, nan_ok=True)


def test_a_case_stands_beside_the_placement_that_the_thesis_tried():
    rows = {tuple(row[:2]): row for row in grasping.grasping_table(GRASPING).rows}
    printed = [rows["cuboid_1x2", placement][2].partition(" ")[0] for placement in ("flat", "raised", "tilted")]
    assert printed == ["100", "90", ""], "the thesis leaned nothing"
    for cell, method in zip(rows["cylinder", "side"][3:5], ("thesis", "ours"), strict=True):
        digits = 0 if SIDE[method]["n"] < 100 else 1
        assert cell.startswith(f"{100 * SIDE[method]['rate']:.{digits}f} [")


def test_how_much_can_be_placed_stands_beside_how_much_is_held():
    each = {"n": 4, **rate(4, 4), "shaken": rate(3, 4), "placeable": rate(1, 4)}
    (row,) = grasping.placing_table({"placing": {"ramp": {"ours": each, "look_down - ours": {"n": 4}}}}).rows
    assert row[:3] == ["ramp", "ours", "4"]
    assert [cell.partition(" ")[0] for cell in row[3:]] == ["75", "25"]
    assert grasping.placing_table({"pooled": {}}).rows == []  # version 0.1 placed nothing so
    told = {"starts": 5, "ours": {**each, "pictures": 24.6, "views": 7.25}}  # no oracle ran
    (row,) = grasping.objects_table({"pooled": {"alone": told}}).rows
    assert [cell.partition(" ")[0] for cell in row] == ["alone", "ours", "4", "75", "", "", "25", "25", "7.2"]
    (axes,) = grasping.objects_held({"summary": {"alone/mug": told, "among/mug": {}}}).axes
    assert [line.get_xydata().tolist() for line in axes.get_lines()[1:2]] == [[[75.0, 0.0]]]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["mug"]


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
    (lambda: learned.ends_table(ENDS, ["random"], "rough"), "clean"),
    (lambda: learned.methods_table(ENDS, "alligator"), "tomato_soup_box"),
])  # fmt: skip
def test_what_a_result_does_not_have_is_refused_with_what_it_has(ask, known):
    with pytest.raises(UnknownNameError, match=known):
        ask()
