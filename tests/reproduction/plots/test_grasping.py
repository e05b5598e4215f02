"""Views of grasps: what they draw is what was measured, and looking at an episode does not change it."""

import numpy as np
import pytest

from gvp_book.experiments.grasp_judgement import CAUSES
from gvp_book.experiments.grasping import grasp_once, grasping_jobs
from gvp_book.plots import grasping, grasping_tables
from gvp_lib.errors import InvalidParameterError
from gvp_lib.views.figures import COLORS


def told(successes: int, n: int, **more: object) -> dict[str, object]:
    rate = {"n": n, "successes": successes, "rate": successes / n, "interval": {"low": 0.25, "high": 0.75}}
    return {**rate, "shaken": rate, "error": {"median": 3.0}, "frames": 25.4, "causes": {}, **more}


DIFFERENCE = {"n": 4, "mean": 0.25, "interval": {"low": -0.1, "high": 0.5}}
IN_HAND = {field: {"n": 2, "median": 1.0, "p95": 4.0} for field in ("tilt_in_hand", "turn_in_hand", "shift_in_hand")}
CONTENT = {
    "thesis": {"cuboid_1x2": [told(10, 10), told(9, 10)]},
    "summary": {
        f"{group}/cuboid_1x2/{placement}": {"thesis": told(2, 4), "ours": told(3, 4)}
        for group in ("thesis", "none")
        for placement in ("flat", "raised", "tilted")
    },
    "pooled": {"thesis": {"thesis": told(2, 4, **IN_HAND), "ours": told(3, 4), "ours - thesis": DIFFERENCE}},
}


def test_a_case_stands_beside_the_placement_that_the_thesis_tried() -> None:
    rows = grasping_tables.grasping_table(CONTENT).rows
    assert [row[2].split()[0] for row in rows[:2]] == ["100", "90"]
    assert rows[2][2] == "", "the thesis leaned nothing"
    assert rows[0][3:] == ["50 [25, 75]", "75 [25, 75]", "4"]


def test_methods_and_differences_are_told_apart() -> None:
    assert [row[0] for row in grasping_tables.methods_table(CONTENT).rows] == ["thesis", "ours"]
    assert grasping_tables.differences_table(CONTENT).rows == [["ours - thesis", "4", "+25.0 [-10.0, +50.0]"]]


def test_what_a_result_lacks_is_left_out() -> None:
    assert grasping_tables.methods_table(CONTENT, "none").rows == []
    assert grasping_tables.differences_table(CONTENT, "none").rows == []
    assert grasping_tables.in_hand_table(CONTENT).rows == [["thesis", "2", "1.0, 4.0", "1.0, 4.0", "1.0, 4.0"]]


def test_rates_are_dots_on_their_intervals() -> None:
    (ax,) = grasping.rates({"one": {"a": (16, 20)}, "two": {"b": (0, 0)}}).axes
    span, dot = ax.lines[:2]
    np.testing.assert_allclose(span.get_xdata(), [58.4, 91.9], atol=0.1)
    np.testing.assert_allclose(dot.get_xdata(), 80)
    with pytest.raises(InvalidParameterError):
        grasping.rates({})


def test_causes_are_stacked_to_the_share_that_failed() -> None:
    tallies = {"a": told(6, 10, causes={"misaligned": 3, "slipped": 1}), "b": told(10, 10)}
    (ax,) = grasping.cause_bars(tallies).axes
    ends = [bar.get_x() + bar.get_width() for bar in ax.patches]
    assert max(ends) == pytest.approx(40)
    grasping.cause_bars({"all": told(0, 8, causes=dict.fromkeys(CAUSES, 1))})  # each has a color


def test_success_by_error_leaves_out_bins_of_a_few() -> None:
    (ax,) = grasping.success_by_error({"a": ([1] * 8 + [3] * 4, [1] * 6 + [0] * 6)}).axes
    assert [text.get_text() for text in ax.texts] == ["8", "n"]  # and the name of the row
    np.testing.assert_allclose(ax.lines[-1].get_ydata(), 75)


def test_a_rule_has_one_color_in_all_panels_and_may_never_close() -> None:
    readings = np.array([0.2, np.inf, 0.1])
    figure = grasping.readings_on_the_way_down({
        "a": {"readings": readings, "closes": {"10 cm": None, "ours": 2}},
        "b": {"readings": readings, "true": readings, "closes": {"10 cm": 1, "ours": 2}},
    })  # fmt: skip
    colors = [{text.get_text().strip(): text.get_color() for text in ax.texts} for ax in figure.axes]
    assert colors[0] == {"ours closes": COLORS["blue"]}
    assert colors[1] == {"10 cm closes": COLORS["vermilion"], "ours closes": COLORS["blue"]}


@pytest.mark.full
def test_looking_at_an_episode_does_not_change_it() -> None:
    job = grasping_jobs(2020, 200)["thesis/cuboid_1x1/flat/13"]
    seen = grasping.replay(job, width=120, height=100, ending=True)
    assert seen.told == grasp_once({**job, "methods": ["thesis"]})["thesis"]
    assert seen.closing.shape == (100, 120, 3)
    assert seen.ending is not None
    assert (seen.closing != seen.ending).any(), "the hand closed, and went up"
