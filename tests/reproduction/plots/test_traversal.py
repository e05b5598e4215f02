"""Figures of the traversal: what they draw is what was measured."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_book.plots import traversal
from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.motion.arc import Arc, ArcEnd
from gvp_lib.motion.sighting import View
from gvp_lib.perception.moments import Blob
from gvp_lib.views.figures import COLORS

CENTER = np.array([0.5, 0.1, 0.02])


def arc(tilts_deg: list[float], ends: tuple[ArcEnd, ArcEnd] = (ArcEnd.ANGLE, ArcEnd.ANGLE)) -> Arc:
    """A meridian arc along y, its center the view nearest the top."""
    blob = Blob.from_mask(np.ones((4, 8), bool))
    assert blob is not None
    sphere, tilts = VirtualSphere(CENTER, 0.25), np.radians(tilts_deg)
    # The camera's y points away from the pole; beyond the pole, half a roll keeps it pointing on.
    poses = [sphere.viewpoint(abs(t), beyond, beyond) for t in tilts for beyond in (np.pi if t < 0 else 0.0,)]
    views = tuple(View(np.zeros(7), pose, blob) for pose in poses)
    center = int(np.abs(tilts).argmin())
    return Arc("y", views, center, ends, np.where(np.arange(len(tilts)) == center, np.nan, 0.24))


def test_an_arc_is_a_bar_from_end_to_end_and_its_ends_have_the_color_of_their_reason() -> None:
    figure = traversal.arc_extents({"some": [arc([-20, 0, 40], (ArcEnd.COLLISION, ArcEnd.JOINT_LIMIT)), arc([0, 10])]})
    (ax,) = figure.axes
    _, bar, low, high, *_ = ax.lines
    np.testing.assert_allclose(bar.get_xdata(), [-20, 40], atol=1e-6)
    assert (low.get_color(), high.get_color()) == (COLORS["vermilion"], COLORS["orange"])
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["joint limit", "collision", "angle"]
    assert ax.get_ylim()[0] > ax.get_ylim()[1]  # the first trial on top


def test_an_arc_of_an_object_that_was_lost_at_once_is_a_dot_at_zero() -> None:
    lost = Arc("y", (), -1, (ArcEnd.TARGET_LOST, ArcEnd.TARGET_LOST), np.empty(0))
    (ax,) = traversal.arc_extents({"lost": [lost]}).axes
    assert [list(line.get_xdata()) for line in ax.lines[1:]] == [[0, 0], [0], [0]]


def test_every_end_of_an_arc_has_a_color() -> None:
    for end in ArcEnd:
        traversal.arc_extents({"one": [arc([0, 10], (end, end))]})


def test_the_measured_range_stands_beside_the_true_one_in_millimeters() -> None:
    figure = traversal.measured_and_true_range({"a": arc([-10, 0, 10]), "b": arc([0, 5])}, {"a": CENTER, "b": CENTER})
    true, measured = figure.axes[0].lines
    np.testing.assert_allclose(true.get_xdata(), [-10, 0, 10], atol=1e-6)
    np.testing.assert_allclose(true.get_ydata(), 250)
    np.testing.assert_allclose(measured.get_ydata(), [240, np.nan, 240])
    assert [ax.get_title() for ax in figure.axes] == ["a", "b"]


def test_a_history_of_ranges_is_drawn_in_millimeters_over_its_steps() -> None:
    (ax,) = traversal.range_history({"held": [0.25, 0.251]}, 0.25, predicted=[0.25, 0.26]).axes
    radius, predicted, held = ax.lines
    assert list(radius.get_ydata()) == [250, 250]
    np.testing.assert_allclose(predicted.get_ydata(), [250, 260])
    np.testing.assert_allclose(held.get_xydata(), [[0, 250], [1, 251]])


@pytest.mark.parametrize("pole", [(0, 0, 1), (0.3, -0.5, 0.8)])
def test_a_viewpoint_lies_at_its_tilt_and_azimuth_and_its_line_along_the_cameras_x(pole: tuple[float, ...]) -> None:
    sphere = VirtualSphere(CENTER, 0.3, np.array(pole))
    tilt, azimuth = np.radians([5.0, 20.0]), np.radians([90.0, -30.0])
    (ax,) = traversal.viewpoint_map(sphere, {"two": sphere.viewpoint(tilt, azimuth)}).axes
    dots, (rolls,) = ax.lines[-1], ax.collections
    expected = np.degrees(tilt)[:, None] * np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    np.testing.assert_allclose(dots.get_xydata(), expected, atol=1e-6)
    for segment, a in zip(rolls.get_segments(), azimuth, strict=True):
        along = np.diff(segment, axis=0)[0]
        np.testing.assert_allclose(along / np.linalg.norm(along), [-np.sin(a), np.cos(a)], atol=1e-6)


def test_a_map_of_one_pose_and_of_many_rolls_can_be_drawn() -> None:
    sphere = VirtualSphere(CENTER, 0.3)
    one = RigidTransform.concatenate([sphere.viewpoint(0.1, 0.0)])
    assert len(traversal.viewpoint_map(sphere, {"one": one, "rolls": sphere.uniform(8, rolls=4)}).axes) == 2


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: traversal.arc_extents({"none": []}),
        lambda: traversal.measured_and_true_range({"a": arc([0, 5])}, {"b": CENTER}),
        lambda: traversal.range_history({}, 0.25),
        lambda: traversal.viewpoint_map(VirtualSphere(CENTER, 0.3), {}),
    ],
)
def test_what_cannot_be_drawn_is_refused(wrong: object) -> None:
    with pytest.raises(InvalidParameterError, match="give"):
        wrong()  # type: ignore[operator]


def test_an_arc_along_x_is_measured_along_x() -> None:
    along_y = arc([-20, 0, 40])
    quarter = RigidTransform.from_rotation(Rotation.from_rotvec([0, 0, np.pi / 2]))  # x lies where y lay
    views = tuple(replace(view, base_from_camera=view.base_from_camera * quarter) for view in along_y.views)
    (ax,) = traversal.arc_extents({"x": [replace(along_y, axis="x", views=views)]}).axes
    np.testing.assert_allclose(ax.lines[1].get_xdata(), [-20, 40], atol=1e-6)
