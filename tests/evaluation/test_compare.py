"""Planners side by side, from the same starts."""

import numpy as np
import pytest

from gvp_lib.errors import InvalidParameterError
from gvp_lib.evaluation.baselines import LookDown, Oracle, Stay
from gvp_lib.evaluation.comparison import compare
from gvp_lib.evaluation.episodes import begin
from gvp_lib.motion.arm import Outcome
from gvp_lib.planning.plan import Plan
from gvp_lib.simulation.workcell import WorkCell


class Mine:
    """A planner in ten lines: it stays, and remembers where it began."""

    def __init__(self):
        self.began = []

    def plan(self, arm):
        self.began.append(arm.camera_pose().translation)
        return Plan(Outcome.ALIGNED, frames=3)


@pytest.fixture(scope="module")
def cell():
    with WorkCell("floating", "cuboid_1x2") as cell:
        yield cell


def test_each_planner_begins_where_the_others_do_and_start_k_is_that_of_the_tables(cell):
    first, second = Mine(), Mine()
    found = compare({"mine": first, "again": second}, cell, starts=[4, 7])
    np.testing.assert_array_equal(first.began, second.began)
    start = begin(cell, 7, seed=2020)
    np.testing.assert_allclose(first.began[1], cell.arm.camera_pose().translation)
    # It stayed, and so is as far off as it began, but for the pixels by which the object was off the center.
    assert found.errors_deg["mine"][1] == pytest.approx(np.degrees(cell.truth.viewpoint_error()))
    assert start.tilt > 0
    assert [each.frames for each in found.judgements["again"]] == [3, 3]


def test_a_comparison_says_who_is_better_and_prints_a_row_for_each(cell):
    down, stay = LookDown(cell.segmenter), Stay(cell.segmenter)
    found = compare({"stay": stay, "straight down": down, "oracle": Oracle(cell)}, cell, starts=4)
    assert found.errors_deg["oracle"].max() < 0.01
    better = found.difference("straight down", "stay")
    assert better.n == 4
    assert better.mean == pytest.approx(np.mean(found.errors_deg["straight down"] - found.errors_deg["stay"]))
    head, *rows = str(found).splitlines()
    assert "95 % interval" in head
    assert [row.split("  ")[0] for row in rows] == ["stay", "straight down", "oracle"]
    assert "4/4" in rows[0]
    assert repr(found).startswith("Comparison(4 starts, mean error in deg: stay ")


@pytest.mark.parametrize(
    ("planners", "starts", "said"),
    [
        ({}, 3, "by their names, at least one"),
        ({"mine": Mine()}, 0, "how many starts, .* and 0$"),
        ({"down": LookDown}, 3, r"method plan\(arm\), such as LookDown\(cell.segmenter\); 'down' is <class"),
        ({"policy": len}, 3, "'policy' is <built-in function len>"),
        ({"mine": Mine()}, [1, 1], r"each once; got .* and \[1, 1\]"),
        ({"mine": Mine()}, -1, "from 0, each once; got .* and -1"),
    ],
)
def test_what_cannot_plan_is_refused(planners, starts, said, cell):
    with pytest.raises(InvalidParameterError, match=said):
        compare(planners, cell, starts)
