"""Figures of a set of viewpoints: what they draw is what is in the set."""

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.patches import Circle, FancyArrowPatch

from gvp_book.plots import datasets
from gvp_book.plots.datasets import ACTION_COLORS
from gvp_lib.errors import InvalidParameterError
from gvp_lib.planning.plan import Action

PICTURE = np.full((16, 16, 3), 200, np.uint8)


@pytest.mark.parametrize("action", [action for action in Action if action is not Action.NO_OP])
def test_an_arrow_points_where_the_camera_should_go(action: Action) -> None:
    (ax,) = datasets.mosaic([PICTURE], [action]).axes
    (arrow,) = (patch for patch in ax.patches if isinstance(patch, FancyArrowPatch))
    start, end = (np.array(point) for point in arrow._posA_posB)
    np.testing.assert_allclose((end - start) / np.linalg.norm(end - start), action.direction, atol=1e-9)
    assert to_hex(arrow.get_edgecolor()) == ACTION_COLORS[action]
    assert ax.get_ylim()[0] > ax.get_ylim()[1]  # v down


def test_staying_is_a_ring_and_a_picture_without_a_label_has_no_mark() -> None:
    (ax,) = datasets.mosaic([PICTURE], [Action.NO_OP]).axes
    assert len(ax.patches) == 2
    assert all(isinstance(patch, Circle) for patch in ax.patches)
    assert not datasets.mosaic([PICTURE]).axes[0].patches


def test_pictures_fill_a_mosaic_row_by_row() -> None:
    shades = [np.full((4, 4, 3), shade, np.uint8) for shade in range(5)]
    (ax,) = datasets.mosaic(shades, columns=2).axes
    corners = [(round(image.get_extent()[0]), round(image.get_extent()[3])) for image in ax.images]
    assert corners == [(0, 0), (1, 0), (0, 1), (1, 1), (0, 2)]
    assert [int(image.get_array()[0, 0, 0]) for image in ax.images] == [0, 1, 2, 3, 4]


def test_the_smallest_error_is_the_bold_one() -> None:
    (ax,) = datasets.labeled_view(PICTURE, [22.0, 18.5, 17.25, 24.0, 20.0]).axes
    bold = [text.get_text() for text in ax.texts if text.get_weight() == "bold"]
    assert bold == ["DOWN\n17.25°"]
    assert len(ax.texts) == len(Action)


def test_a_map_is_seen_from_above_and_what_lies_outside_is_left_out() -> None:
    grid = np.full((5, 5), -1)
    grid[0, 1:4], grid[4, 1:4], grid[2, 2] = Action.LEFT, Action.RIGHT, Action.NO_OP
    (ax,) = datasets.label_maps({"one": grid}).axes
    shown = ax.images[0].get_array()
    assert shown.mask.sum() == 25 - 7
    where = {text.get_text(): text.get_position() for text in ax.texts if text.get_text() in Action.__members__}
    assert where == {"LEFT": (0, -30), "RIGHT": (0, 30)}
    assert ax.images[0].origin == "lower"


def test_a_label_that_wins_all_around_is_named_off_the_middle() -> None:
    (ax,) = datasets.label_maps({"level": np.zeros((5, 5), int)}).axes
    (name,) = (text for text in ax.texts if text.get_text() == "UP")
    assert np.hypot(*name.get_position()) > 10


def test_shares_are_drawn_in_per_cent_beside_their_cost() -> None:
    left, right = datasets.agreement([1, 2], {"some": [0.9, 0.8]}, {"some": [0.1, 0.4]}).axes
    np.testing.assert_allclose(left.lines[0].get_xydata(), [[1, 90], [2, 80]])
    np.testing.assert_allclose(right.lines[0].get_xydata(), [[1, 0.1], [2, 0.4]])


def test_offsets_are_drawn_with_v_down_and_the_square_is_what_shifts_cover() -> None:
    (ax,) = datasets.off_center({"arm": {"centroid": [[1.0, 2.0]]}}, shift=16).axes
    (dots,) = (line for line in ax.lines if line.get_label() == "centroid")
    np.testing.assert_allclose(dots.get_xydata(), [[1, 2]])
    assert ax.get_ylim()[0] > ax.get_ylim()[1]
    (square,) = ax.patches
    assert (square.get_x(), square.get_width()) == (-16, 32)


def test_a_replaced_viewpoint_is_joined_to_what_took_its_place() -> None:
    asked, taken = np.radians([[10, 0, 5], [30, 90, 5]]), np.radians([[10, 0, 5], [20, 180, 70]])
    (ax,) = datasets.replacements(asked, taken, [False, True]).axes
    drawn = {line.get_label(): line.get_xydata() for line in ax.lines}
    np.testing.assert_allclose(drawn["taken up as asked"], [[10, 0]], atol=1e-9)
    np.testing.assert_allclose(drawn["out of reach"], [[0, 30]], atol=1e-9)
    np.testing.assert_allclose(drawn["taken up instead"], [[-20, 0]], atol=1e-9)
    joined = [line.get_xydata() for line in ax.lines if line.get_marker() == "None" and len(line.get_xdata()) == 2]
    np.testing.assert_allclose(joined, [[[0, 30], [-20, 0]]], atol=1e-9)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: datasets.mosaic([]),
        lambda: datasets.mosaic([PICTURE], [0, 1]),
        lambda: datasets.labeled_view(PICTURE, [1.0, 2.0]),
        lambda: datasets.label_maps({}),
        lambda: datasets.agreement([1], {"a": [1]}, {"b": [1]}),
        lambda: datasets.off_center({"none": {}}),
        lambda: datasets.replacements([[0, 0]], [[0, 0]], [True, False]),
    ],
)
def test_what_cannot_be_drawn_is_refused(wrong: object) -> None:
    with pytest.raises(InvalidParameterError, match="give"):
        wrong()  # type: ignore[operator]
