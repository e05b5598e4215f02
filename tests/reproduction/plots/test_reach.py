"""The table and the maps of what an arm reaches, from the stored result itself."""

from pathlib import Path

import pytest

from gvp_book.plots.reach import reach_map, reach_table
from gvp_book.results import read_result
from gvp_lib.errors import UnknownNameError

CONTENT = read_result(Path(__file__).parents[3] / "book" / "results" / "reach.json")["content"]


def test_the_table_has_a_row_for_each_arm_and_place_and_the_shares_of_the_summary():
    table = reach_table(CONTENT, cap=60)
    assert len(table.rows) == 8
    first = CONTENT["summary"]["ur5e/fixed/in the workspace/60"]
    assert table.rows[0][2].startswith(f"{100 * first['stands']['share']:.0f} [")
    with pytest.raises(UnknownNameError, match="30, 60"):
        reach_table(CONTENT, cap=45)


def test_the_map_has_a_column_for_each_place_and_every_viewpoint_in_it():
    figure = reach_map(CONTENT, "baxter")
    assert len(figure.axes) == 8
    n = CONTENT["summary"]["baxter/fixed/in the workspace/60"]["n"]
    for ax in figure.axes:
        assert sum(len(points.get_offsets()) for points in ax.collections) == 2 * n
    with pytest.raises(UnknownNameError, match="baxter, ur5e"):
        reach_map(CONTENT, "panda")
