"""Figures of centering and of depth from motion: what they draw is what was measured."""

import numpy as np
import pytest

from gvp_book.plots import servoing
from gvp_lib.errors import InvalidParameterError


def test_the_convergence_shows_the_way_and_the_larger_offset_at_each_look() -> None:
    way = np.array([[-80.0, 60.0], [3.0, -4.0], [0.5, 0.1]])
    left, right = servoing.convergence({"a": way, "b": way[:1]}, threshold=2.0).axes
    np.testing.assert_array_equal(left.lines[-2].get_xydata(), way)
    np.testing.assert_array_equal(right.lines[0].get_xydata(), [[1, 80], [2, 4], [3, 0.5]])
    assert left.yaxis_inverted()  # v points down
    assert [text.get_text() for text in right.get_legend().get_texts()] == ["a", "b"]
    assert right.patches[0].get_y() + right.patches[0].get_height() == 2.0


def test_an_offset_of_zero_is_drawn_on_the_logarithmic_axis_too() -> None:
    _, right = servoing.convergence({"there": [[0.0, 0.0]]}).axes
    (y,) = right.lines[0].get_ydata()
    assert right.get_ylim()[0] < y


def test_depth_errors_show_each_trial_in_percent_at_its_step() -> None:
    (ax,) = servoing.depth_errors([0.01, 0.02], {"a": [[0.01, -0.01], [0.02]], "b": [[0.0], [0.0]]}).axes
    dots = [line for line in ax.lines if line.get_marker() == "o" and len(line.get_xdata())]
    assert [list(line.get_ydata()) for line in dots] == [[1, -1], [2], [0], [0]]
    assert [round(float(np.mean(line.get_xdata()))) for line in dots] == [0, 1, 0, 1]
    assert [label.get_text() for label in ax.get_xticklabels()] == ["10", "20"]


def test_centroid_and_center_are_marked_apart_and_the_picture_is_cropped_about_them() -> None:
    image = np.zeros((480, 640, 3), np.uint8)
    (ax,) = servoing.centroid_and_center([image], [(300, 200)], [(320, 240)], ["can"], half=50).axes
    marks = {line.get_marker(): tuple(line.get_xydata()[0]) for line in ax.lines}
    assert marks == {"o": (300, 200), "x": (320, 240)}
    assert ax.get_xlim() == (260, 360)
    assert ax.get_ylim() == (270, 170)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: servoing.convergence({}),
        lambda: servoing.convergence({"flat": [1.0, 2.0]}),
        lambda: servoing.convergence({"none": np.empty((0, 2))}),
        lambda: servoing.depth_errors([0.01], {"a": [[0.1], [0.2]]}),
        lambda: servoing.centroid_and_center([np.zeros((4, 4, 3), np.uint8)], [(1, 1)], [], ["a"]),
    ],
)
def test_what_does_not_belong_together_is_refused(wrong: object) -> None:
    with pytest.raises(InvalidParameterError, match="give"):
        wrong()  # type: ignore[operator]
