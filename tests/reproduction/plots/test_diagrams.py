"""Diagrams: what they draw is what the numbers say."""

import numpy as np
import pytest
from matplotlib.patches import Ellipse, Polygon

from gvp_book.plots import diagrams
from gvp_lib.errors import InvalidParameterError
from gvp_lib.perception.moments import Blob
from gvp_lib.views import figures


def rectangle(angle: float = 0.0) -> np.ndarray:
    v, u = np.mgrid[-60:61, -80:81]
    along, across = u * np.cos(angle) + v * np.sin(angle), v * np.cos(angle) - u * np.sin(angle)
    return (abs(along) <= 40) & (abs(across) <= 15)


def blob(angle: float = 0.0) -> Blob:
    made = Blob.from_mask(rectangle(angle))
    assert made is not None
    return made


def test_the_hue_circle_counts_red_on_both_sides_of_zero() -> None:
    pixels = np.array([[200, 20, 21]] * 5 + [[200, 21, 20]] * 5, np.uint8)
    ax = diagrams.hue_circle(pixels, (342, 18)).axes[0]
    drawn = [bar.get_x() for bar in ax.patches[120:240] if bar.get_height() > 0]
    assert sorted(x > np.pi for x in drawn) == [False, True]
    assert ax.texts[-1].get_text() == "342° to 18°"


def test_the_ellipse_with_the_same_moments_has_the_blobs_axes_and_a_square_gets_a_circle_alone() -> None:
    square = np.zeros((90, 90), bool)
    square[20:70, 20:70] = True
    oblong, plain = diagrams.same_moments([rectangle(0.4), square], ["oblong", "square"]).axes
    ellipse = next(patch for patch in oblong.patches if isinstance(patch, Ellipse))
    assert ellipse.width == blob(0.4).axis_major_length
    assert np.radians(ellipse.angle) == pytest.approx(0.4, abs=0.01)
    corners = next(patch for patch in oblong.patches if isinstance(patch, Polygon)).get_xy()
    assert np.linalg.norm(corners[1] - corners[2]) == pytest.approx(81, abs=1)
    assert [type(patch) for patch in plain.patches] == [Ellipse]


def test_the_roll_diagram_breaks_its_line_where_the_orientation_wraps() -> None:
    roll = np.radians(np.arange(0, 171, 10))
    left, right = diagrams.roll_response(roll, [blob(1.0 - x) for x in roll]).axes
    line, dots = left.lines
    drawn = ~np.isnan(line.get_ydata())
    assert drawn.sum() == len(roll) < len(drawn)
    assert np.asarray(line.get_ydata())[drawn] == pytest.approx(np.asarray(dots.get_ydata()), abs=1.0)
    assert [text.get_text() for text in right.texts] == ["major axis", "minor axis"]


def test_a_gallery_has_a_column_for_each_image_and_does_not_grow_with_long_axes() -> None:
    image, mask = np.zeros((121, 161, 3), np.uint8), np.ones((121, 161), bool)
    axes = figures.gallery([image] * 3, [mask] * 3, [Blob.from_mask(mask), None, blob()], ["a", "b", "c"]).axes
    assert len(axes) == 6
    assert axes[0].get_xlim() == (-0.5, 160.5)
    assert [text.get_text() for text in axes[1].texts] == ["no blob"]
    assert len(figures.gallery([image], [mask], [None], masks_shown=False).axes) == 1


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: figures.gallery([np.zeros((4, 4, 3), np.uint8)], [], []),
        lambda: diagrams.same_moments([np.zeros((4, 4), bool)]),
        lambda: diagrams.roll_response([0.0, 0.1], [blob()]),
    ],
)
def test_what_does_not_belong_together_is_refused(wrong: object) -> None:
    with pytest.raises(InvalidParameterError, match="give"):
        wrong()  # type: ignore[operator]
