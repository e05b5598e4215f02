"""Figures and tables of the learned planner: what they show is what was given, or stored."""

import dataclasses
import json
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.patches import Circle, Rectangle

from gvp_book.experiments.learned_tables import episodes_report, following_report
from gvp_book.plots import learned, learned_tables
from gvp_book.plots.datasets import ACTION_COLORS
from gvp_lib.errors import InvalidParameterError, UnknownNameError
from gvp_lib.planning.learned import Action
from gvp_lib.views.figures import BookFigure

PICTURE = np.full((16, 16, 3), 200, np.uint8)


def stored(name: str = "table-3.3") -> dict[str, Any]:
    """A report of two starts on each of two objects."""
    end = {"outcome": "aligned", "frames": 3, "seconds": 1.0, "steps": 4}
    rows = {
        f"clean/{target}/{k}": {
            "start": {"tilt": 20.0 + k, "tries": 1},
            "random": {**end, "total": error + k},
            "stay": {**end, "total": 20.0 + k, "outcome": ["out of steps", "target lost"][k]},
        }
        for target, error in (("cuboid_1x2", 2.0), ("cylinder", 6.0))
        for k in range(2)
    }
    return plain(episodes_report(name, rows, {}))


def plain(content: dict[str, Any]) -> dict[str, Any]:
    """A report as it is read back from its file."""
    return json.loads(json.dumps(content, default=dataclasses.asdict))


def test_a_strip_marks_every_answer_in_its_color() -> None:
    figure = learned.strip([PICTURE] * 2, [Action.LEFT, Action.NO_OP], ["5°", "1°"], ["LEFT", "NO_OP"])
    first, last = figure.axes
    assert [ax.get_title() for ax in figure.axes] == ["5°", "1°"]
    assert first.xaxis.label.get_color() == ACTION_COLORS[Action.LEFT]
    assert not first.patches
    (ring,) = last.patches
    assert isinstance(ring, Circle)


@pytest.mark.parametrize("given", [([], []), ([PICTURE], []), ([PICTURE], [Action.UP], ["a", "b"])])
def test_a_strip_has_one_answer_for_each_picture(given: Any) -> None:
    with pytest.raises(InvalidParameterError, match="for each an answer"):
        learned.strip(*given)


def test_the_floor_is_a_square_of_one_step() -> None:
    figure = learned.floor(np.zeros((3, 2)), 5.0, {"network": ([2.5, 5], [1.0, 2.0])})
    left, right = figure.axes
    (square,) = (patch for patch in left.patches if isinstance(patch, Rectangle))
    assert (square.get_width(), square.get_x()) == (5.0, -2.5)
    assert np.asarray(right.lines[-1].get_ydata()).tolist() == [1.0, 2.0]
    with pytest.raises(InvalidParameterError, match="shape"):
        learned.floor(np.zeros(3), 5.0, {})


def test_a_field_widens_for_a_path_that_leaves_the_cap() -> None:
    field = ([[10.0, 0.0], [0.0, 0.0]], [Action.UP, Action.NO_OP], [[-5.0, 0.0], [0.0, 0.0]])
    near, far = learned.fields({"near": field, "far": field}, {"far": [[[10, 0], [80, 0]]]}).axes
    assert near.get_xlim() == (-33.0, 33.0)
    assert far.get_xlim()[1] == pytest.approx(1.08 * 80)
    (ring,) = (each for each in near.collections if np.shape(each.get_offsets()) == (1, 2))
    assert to_hex(np.asarray(ring.get_edgecolor())[0]) == ACTION_COLORS[Action.NO_OP]
    with pytest.raises(InvalidParameterError, match="paths that belong"):
        learned.fields({"near": field}, {"nowhere": []})


def test_curves_and_looks_are_drawn_as_given() -> None:
    (ax,) = learned.following({"stays": ([0, 1], [2, 3]), "follows": ([0, 1], [1, 0])}).axes
    assert [np.asarray(line.get_ydata()).tolist() for line in ax.lines] == [[2, 3], [1, 0]]
    one = ([0.0, 10.0], [0.0, 9.0], [1.0, 1.0])
    figure = learned.said_and_true({"lamp": {"a network": one}})
    assert isinstance(figure, BookFigure)
    assert figure.axes[0].get_title() == "lamp"
    for draw in (learned.following, learned.said_and_true):
        with pytest.raises(InvalidParameterError, match="at least one"):
            draw({})


def test_ends_stand_beside_what_the_thesis_printed() -> None:
    table = learned_tables.ends_table(stored(), ["random", "ours"])
    assert table.columns == ["object", "thesis, n = 50", "random", "ours", "n"]
    assert table.rows[0] == ["cuboid_1x2", "4.5\xa0±\xa02.7", "2.5\xa0±\xa00.7 [2.0,\xa03.0]", "", "2"]
    assert table.rows[1][1] == ""
    assert learned_tables.ends_table(stored("direction-head"), ["random"]).columns == ["object", "random", "n"]
    with pytest.raises(UnknownNameError, match="clean"):
        learned_tables.ends_table(stored(), ["random"], "rough")


def test_methods_tell_how_their_plans_ended() -> None:
    table = learned_tables.methods_table(stored(), "cuboid_1x2")
    assert [row[0] for row in table.rows] == ["random", "stay"]  # neither the start nor a difference
    assert table.rows[0][3:] == ["-18.0", "4.0", "100", "0", "0", "2"]
    assert table.rows[1][5:8] == ["0", "50", "50"]
    assert len(learned_tables.methods_table(stored(), "cylinder", methods=["stay"]).rows) == 1
    with pytest.raises(UnknownNameError, match="cylinder"):
        learned_tables.methods_table(stored(), "alligator")


def test_objects_count_alike_in_a_mean_over_them() -> None:
    table = learned_tables.means_over_objects(stored(), ["random", "ours"], ["clean"])
    assert table.rows == [["random", "4.50"], ["ours", ""]]


def test_a_followed_path_shows_every_method_and_what_was_lost() -> None:
    rows = {f"rocks/{k}": {"tilt": {"error": 1.0 + k, "lost": k == 1, "seconds": 0.3}} for k in range(2)}
    table = learned_tables.following_table(plain(following_report(rows)))
    assert table.columns == ["the object", "tilt [deg]", "lost", "n"]
    assert table.rows == [["rocks", "1.5 [1.0,\xa02.0]", "1", "2"]]
