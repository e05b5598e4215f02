"""Figures of the image-moment planner, and the table."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_book.plots.tables import Table
from gvp_book.plots.viewpoints import certainty, error_strips, grouped_bars, outlines, ratio_fits
from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arc import Arc, ArcEnd
from gvp_lib.motion.sighting import View
from gvp_lib.perception.moments import Blob
from gvp_lib.planning.image_moments import QuarticFit
from gvp_lib.planning.solids import FittedSolid

CAMERA = CameraIntrinsics(640, 480, 530, 530, 319.5, 239.5)


def arc_of(ratios) -> Arc:
    """An arc whose views have these ratios, four degrees apart."""
    views = []
    for k, ratio in enumerate(ratios):
        blob = Blob(1000, np.array([320.0, 240.0]), 100 * ratio**2, 0.0, 100.0, (300, 220, 340, 260))
        turn = Rotation.from_rotvec([np.radians(4) * k, 0, 0])
        views.append(View(np.zeros(6), RigidTransform.from_rotation(turn), blob))
    return Arc("y", tuple(views), len(views) // 2, (ArcEnd.ANGLE, ArcEnd.ANGLE), np.full(len(views), np.nan))


def solid(kind: str) -> FittedSolid:
    pose = RigidTransform.from_translation([0, 0, 0.25])
    return FittedSolid(kind, pose, np.array([0.06, 0.06, 0.02]), (0.004, 0.005), np.array([0, 0, -1.0]), 0.01, 0.1,
                       np.zeros((1, 6)))  # fmt: skip


def test_a_panel_shows_every_sample_the_polynomial_and_the_choice():
    arc = arc_of(0.5 + 0.01 * np.linspace(-1, 1, 11) ** 2)
    fit = QuarticFit().fit(arc)
    (ax,) = ratio_fits([arc], [fit], ["a bowl"], best=[5.0]).axes
    lines = [line.get_xydata() for line in ax.lines]
    assert any(len(xy) == 11 and np.allclose(xy[:, 1], arc.ratios) for xy in lines)
    assert any(len(xy) == 1 and xy[0, 0] == pytest.approx(fit.chosen) for xy in lines)
    assert ax.get_title() == "a bowl"


def test_three_panels_stand_two_in_a_row_and_a_legend_in_the_place_left():
    arc = arc_of(0.5 + 0.01 * np.linspace(-1, 1, 11) ** 2)
    figure = ratio_fits([arc] * 3, [QuarticFit().fit(arc)] * 3, best=[5.0] * 3)
    *panels, free = figure.axes
    first, second, third = (panel.get_subplotspec().get_geometry()[:2] for panel in panels)
    assert first == second == third == (2, 2)
    told = [text.get_text() for text in free.get_legend().get_texts()]
    assert told == ["nearest to aligned", "what was seen", "the polynomial", "its level spots", "the one it chooses"]


def test_panels_and_quartics_must_match():
    with pytest.raises(InvalidParameterError, match="1 arcs, 0 quartics"):
        ratio_fits([arc_of([0.5] * 6)], [])


@pytest.mark.parametrize("kind", ["box", "cylinder"])
def test_an_outline_lies_about_the_solid_in_the_picture(kind):
    view = View(np.zeros(6), RigidTransform.identity(), arc_of([0.5]).views[0].blob)
    figure = outlines([np.zeros((480, 640, 3), np.uint8)], [view], solid(kind), CAMERA)
    drawn = np.vstack([line.get_xydata() for line in figure.axes[0].lines])
    center, half = drawn.mean(axis=0), 0.5 * np.ptp(drawn, axis=0)
    np.testing.assert_allclose(center, CAMERA.principal_point, atol=3)
    np.testing.assert_allclose(half, 530 * 0.03 / 0.2375, rtol=0.05)  # 60 mm wide; its near face at 0.2375 m


def test_strips_show_every_error_and_the_mean():
    errors = [0.5, 1.0, 3.0]
    (ax,) = error_strips({"brick": {"ours": errors}}, reference={"brick": 9.0}, label="theirs").axes
    dots = next(line for line in ax.lines if len(line.get_xdata()) == 3)
    assert dots.get_xdata().tolist() == errors
    assert any(np.allclose(line.get_xdata(), 1.5) for line in ax.lines)
    assert any(np.allclose(line.get_xdata(), 9.0) for line in ax.lines)


def test_bars_carry_their_values_and_nan_leaves_one_out():
    figure = grouped_bars(["a", "b"], {"x": [1.25, float("nan")], "y": [2.0, 3.0]})
    texts = [text.get_text() for text in figure.axes[0].texts]
    assert texts == ["1.2", "", "2.0", "3.0"]
    with pytest.raises(InvalidParameterError, match="2 labels"):
        grouped_bars(["a", "b"], {"x": [1.0]})


def test_certainty_draws_both_curves():
    (ax,) = certainty([8, 12], [3.0, 1.0], [4.0, 0.5]).axes
    assert {line.get_label() for line in ax.lines} == {"true error", "stated standard deviation"}


def test_a_table_is_markdown_and_escaped_html():
    table = Table(["a<b", "n"], [["x", 1.25]])
    assert str(table).splitlines() == ["| a<b | n |", "|:--|--:|", "| x | 1.2 |"]
    assert "<th>a&lt;b</th>" in table._repr_html_()
    assert "<td>1.2 [1.0,&nbsp;1.4], 0.5</td>" in Table(["a"], [["1.2 [1.0, 1.4], 0.5"]])._repr_html_()
    with pytest.raises(InvalidParameterError, match="2 cells"):
        Table(["a", "b"], [["only one"]])
