"""Figures of a training: what they draw is what was measured."""

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.patches import Rectangle

from gvp_book.plots import training
from gvp_book.plots.datasets import ACTION_COLORS
from gvp_lib.errors import InvalidParameterError
from gvp_lib.planning.plan import Action

PICTURE = np.full((16, 16, 3), 200, np.uint8)
LINES = [
    {"epoch": k + 1, "loss": 1.0 / (k + 1), "accuracy": 0.2 + 0.1 * k, "validation_loss": 0.9 / (k + 1),
     "validation_accuracy": 0.3 + 0.1 * k}
    for k in range(3)
]  # fmt: skip
CURVE = {"n": 2, "accuracy": {"mean": [0.5, 0.8], "sd": [0.1, 0.02], "all": [[0.4, 0.78], [0.6, 0.82]]}}


def test_the_square_that_is_cropped_lies_in_the_middle() -> None:
    whole, *steps = training.preprocessing(np.zeros((48, 64, 3), np.uint8), 16, {"a": PICTURE, "b": PICTURE}).axes
    (square,) = (patch for patch in whole.patches if isinstance(patch, Rectangle))
    assert (square.get_x(), square.get_y(), square.get_width()) == (23.5, 15.5, 16)
    assert [ax.get_title() for ax in steps] == ["a", "b"]


def test_rates_are_drawn_from_the_first_epoch_on_a_logarithmic_scale() -> None:
    (ax,) = training.learning_rates({"steps": [1e-3, 1e-3, 1e-4]}).axes
    assert ax.get_yscale() == "log"
    np.testing.assert_allclose(ax.lines[0].get_xydata(), [[1, 1e-3], [2, 1e-3], [3, 1e-4]])


def test_a_training_is_drawn_beside_its_validation_and_what_it_is_to_beat() -> None:
    left, right = training.history(LINES, {"always UP": 0.25}).axes
    drawn = {line.get_label(): line.get_ydata() for line in right.lines}
    np.testing.assert_allclose(drawn["training"], [20, 30, 40])
    np.testing.assert_allclose(drawn["validation"], [30, 40, 50])
    assert any(np.allclose(line.get_ydata(), 25) for line in right.lines)
    np.testing.assert_allclose(left.lines[0].get_ydata(), [1, 1 / 2, 1 / 3])


def test_several_trainings_are_a_mean_a_band_and_a_line_each() -> None:
    one, other = training.trainings({"one": {"sgd": CURVE}, "other": {"adamw": CURVE, "sgd": CURVE}}).axes
    np.testing.assert_allclose(one.lines[-1].get_xydata(), [[1, 50], [2, 80]])
    assert len(one.lines) == 3
    (band,) = one.collections
    assert band.get_paths()[0].get_extents().ymax == pytest.approx(82)
    labels = [text.get_text() for text in other.get_legend().get_texts()]
    assert labels == ["adamw, n = 2", "sgd, n = 2"]
    assert one.lines[-1].get_color() == other.lines[-1].get_color()  # the same name, the same color


def test_a_row_of_the_confusion_is_a_label() -> None:
    counts = np.zeros((5, 5), int)
    counts[Action.UP, Action.LEFT] = 3
    (ax,) = training.confusion(counts).axes
    (text,) = ax.texts
    assert text.get_text() == "3"
    assert text.get_position() == (Action.LEFT, Action.UP)
    assert ax.images[0].get_array()[Action.UP, Action.LEFT] == 1


def test_an_answer_has_its_action_s_color_and_a_wrong_one_a_ring() -> None:
    tilts = [[0, -10], [10, 0], [0, 1]]
    (ax,) = training.answers(tilts, [Action.UP, Action.UP, Action.NO_OP], [True, False, True]).axes
    dots = {(line.get_marker(), len(line.get_xdata()), to_hex(line.get_color()), line.get_markeredgewidth() > 0):
            line.get_xydata().tolist() for line in ax.lines if line.get_marker() == "o"}  # fmt: skip
    blue = ACTION_COLORS[Action.UP]
    assert dots["o", 1, blue, False] == [[0, -10]]
    assert dots["o", 1, blue, True] == [[10, 0]]
    assert ax.get_ylim()[0] > ax.get_ylim()[1]  # v down


def test_errors_are_counted_by_margin_and_their_costs_added_up() -> None:
    left, right = training.mistakes([0.1, 0.2, 3, 4], [0.1, 0, 0, 3], [0, 1, 2, 5]).axes
    assert [bar.get_height() for bar in left.patches] == [50, 0, 50]
    assert [text.get_text() for text in left.texts] == ["of 2", "of 0", "of 2"]
    np.testing.assert_allclose(right.lines[0].get_xydata(), [[0, 0], [0.1, 1], [3, 2]])


def test_a_map_lies_over_its_picture() -> None:
    axes = training.attention([PICTURE, PICTURE], [np.eye(3), np.ones((3, 3))], ["a", "b"]).axes
    assert [len(ax.images) for ax in axes] == [1, 1, 2, 2]
    shown = axes[2].images[1]
    np.testing.assert_array_equal(shown.get_array(), np.eye(3))
    assert shown.get_extent() == axes[2].images[0].get_extent()


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: training.preprocessing(PICTURE, 17, {"a": PICTURE}),
        lambda: training.learning_rates({}),
        lambda: training.history([]),
        lambda: training.trainings({"none": {}}),
        lambda: training.confusion(np.zeros((5, 4), int)),
        lambda: training.confusion(np.zeros((5, 5))),
        lambda: training.answers([[0, 0]], [0, 1], [True, True]),
        lambda: training.mistakes([0.1], [0.1, 0.2], [0, 1]),
        lambda: training.mistakes([0.1], [0.1], [1, 0]),
        lambda: training.attention([PICTURE], []),
    ],
)
def test_what_cannot_be_drawn_is_refused(wrong: object) -> None:
    with pytest.raises(InvalidParameterError, match="give"):
        wrong()  # type: ignore[operator]
