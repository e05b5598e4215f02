"""The chapters' figures: what they draw is what they were given."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_hex
from matplotlib.patches import Circle, Ellipse, FancyArrowPatch, Polygon, Rectangle
from numpy.testing import assert_allclose
from scipy.spatial.transform import RigidTransform

from gvp_book.experiments.grasping import Cause, grasp_once, grasping_jobs
from gvp_book.plots import datasets, diagrams, grasping, learned, training, traversal, viewpoints
from gvp_book.plots.datasets import ACTION_COLORS
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.motion.arc import Arc
from gvp_lib.motion.arm import STOPS, Outcome
from gvp_lib.motion.sighting import View
from gvp_lib.perception.blobs import Blob
from gvp_lib.planning.plan import Action
from gvp_lib.planning.solids import FittedSolid
from gvp_lib.views import figures
from gvp_lib.views.figures import COLORS

PICTURE = np.full((16, 16, 3), 200, np.uint8)
CENTER = np.array([0.5, 0.1, 0.02])
CAMERA = CameraIntrinsics(640, 480, 530, 530, 319.5, 239.5)


def lines(ax, **where):
    """Points of the lines that have these properties, such as ``label="a"``."""
    return [
        np.asarray(line.get_xydata())
        for line in ax.lines
        if all(getattr(line, f"get_{name}")() == value for name, value in where.items())
    ]


def patches(ax, kind):
    return [patch for patch in ax.patches if isinstance(patch, kind)]


def texts(within):
    return [text.get_text() for text in within.texts]


# Perception


def rectangle(angle=0.0):
    v, u = np.mgrid[-60:61, -80:81]
    along, across = u * np.cos(angle) + v * np.sin(angle), v * np.cos(angle) - u * np.sin(angle)
    return (abs(along) <= 40) & (abs(across) <= 15)


def blob(angle=0.0):
    return Blob.from_mask(rectangle(angle))


def test_the_hue_circle_counts_red_on_both_sides_of_zero():
    pixels = np.array([[200, 20, 21]] * 5 + [[200, 21, 20]] * 5, np.uint8)
    ax = diagrams.hue_circle(pixels, (342, 18)).axes[0]
    drawn = [bar.get_x() for bar in ax.patches[120:240] if bar.get_height() > 0]
    assert sorted(x > np.pi for x in drawn) == [False, True]
    assert texts(ax)[-1] == "342° to 18°"


def test_the_ellipse_with_the_same_moments_has_the_blobs_axes_and_a_square_gets_a_circle_alone():
    square = np.zeros((90, 90), bool)
    square[20:70, 20:70] = True
    oblong, plain = diagrams.same_moments([rectangle(0.4), square], ["oblong", "square"]).axes
    (ellipse,), (outline,) = patches(oblong, Ellipse), patches(oblong, Polygon)
    assert ellipse.width == blob(0.4).axis_major_length
    assert np.radians(ellipse.angle) == pytest.approx(0.4, abs=0.01)
    assert np.linalg.norm(np.diff(outline.get_xy()[1:3], axis=0)) == pytest.approx(81, abs=1)
    assert [type(patch) for patch in plain.patches] == [Ellipse]


def test_a_gallery_does_not_grow_with_long_axes_and_says_where_there_is_no_blob():
    image, mask = np.zeros((121, 161, 3), np.uint8), np.ones((121, 161), bool)
    axes = figures.gallery([image] * 2, [mask] * 2, [Blob.from_mask(mask), None], ["a", "b"]).axes
    assert axes[0].get_xlim() == (-0.5, 160.5)
    assert texts(axes[1]) == ["no blob"]
    assert len(figures.gallery([image], [mask], [None], masks_shown=False).axes) == 1


# Servoing, and the traversal


def test_depth_errors_show_each_trial_in_percent_at_its_step():
    (ax,) = traversal.depth_errors([0.01, 0.02], {"a": [[0.01, -0.01], [0.02]], "b": [[0.0], [0.0]]}).axes
    dots = [line for line in lines(ax, marker="o") if len(line)]
    assert [list(line[:, 1]) for line in dots] == [[1, -1], [2], [0], [0]]
    assert [round(float(np.mean(line[:, 0]))) for line in dots] == [0, 1, 0, 1]
    assert [label.get_text() for label in ax.get_xticklabels()] == ["10", "20"]


def arc(tilts_deg, ends=(Outcome.MAX_ANGLE, Outcome.MAX_ANGLE)):
    """A meridian arc along y, its center the view nearest the top."""
    sphere, tilts = VirtualSphere(CENTER, 0.25), np.radians(tilts_deg)
    # The camera's y points away from the pole; beyond the pole, half a roll keeps it pointing on.
    poses = [sphere.viewpoint(abs(t), beyond, beyond) for t in tilts for beyond in (np.pi if t < 0 else 0.0,)]
    views = tuple(View(np.zeros(7), pose, blob()) for pose in poses)
    center = int(np.abs(tilts).argmin())
    return Arc("y", views, center, ends, np.where(np.arange(len(tilts)) == center, np.nan, 0.24))


def test_an_arc_is_a_bar_from_end_to_end_and_its_ends_have_the_color_of_their_reason():
    figure = traversal.arc_extents(
        {"some": [arc([-20, 0, 40], (Outcome.COLLISION, Outcome.JOINT_LIMIT)), arc([0, 10])]}
    )
    (ax,) = figure.axes
    _, bar, low, high, *_ = ax.lines
    assert_allclose(bar.get_xdata(), [-20, 40], atol=1e-6)
    assert (low.get_color(), high.get_color()) == (COLORS["vermilion"], COLORS["orange"])
    assert texts(figure.legends[0]) == ["joint limit", "collision", "max angle"]
    lost = Arc("y", (), -1, (Outcome.TARGET_LOST, Outcome.TARGET_LOST), np.empty(0))
    assert_allclose(lines(traversal.arc_extents({"lost": [lost]}).axes[0])[1], [[0, 0], [0, 0]])
    for end in (*STOPS, Outcome.MAX_ANGLE, Outcome.ENOUGH, Outcome.TARGET_LOST, Outcome.NOT_CENTERED):
        traversal.arc_extents({"one": [arc([0, 10], (end, end))]})  # each has a color


def test_a_viewpoint_lies_at_its_tilt_and_azimuth_and_its_line_along_the_cameras_x():
    sphere = VirtualSphere(CENTER, 0.3, np.array([0.3, -0.5, 0.8]))
    tilt, azimuth = np.radians([5.0, 20.0]), np.radians([90.0, -30.0])
    one, many = sphere.viewpoint(tilt, azimuth), sphere.uniform(8, rolls=4)
    ax, _ = traversal.viewpoint_map(sphere, {"two": one, "rolls": many}).axes
    expected = np.degrees(tilt) * np.array([np.cos(azimuth), np.sin(azimuth)])
    assert_allclose(lines(ax)[-1], expected.T, atol=1e-6)
    (rolls,) = ax.collections
    for segment, a in zip(rolls.get_segments(), azimuth, strict=True):
        along = np.diff(segment, axis=0)[0]
        assert_allclose(along / np.linalg.norm(along), [-np.sin(a), np.cos(a)], atol=1e-6)


# The image-moment planner


@pytest.mark.parametrize("kind", ["box", "cylinder"])
def test_an_outline_lies_about_the_solid_in_the_picture(kind):
    pose, sizes = RigidTransform.from_translation([0, 0, 0.25]), np.array([0.06, 0.06, 0.02])
    solid = FittedSolid(kind, pose, sizes, (0.004, 0.005), np.array([0, 0, -1.0]), 0.01, 0.1, np.zeros((1, 6)))
    view = View(np.zeros(6), RigidTransform.identity(), blob())
    drawn = np.vstack(lines(viewpoints.outlines([np.zeros((480, 640, 3), np.uint8)], [view], solid, CAMERA).axes[0]))
    assert_allclose(drawn.mean(axis=0), CAMERA.principal_point, atol=3)
    assert_allclose(0.5 * np.ptp(drawn, axis=0), 530 * 0.03 / 0.2375, rtol=0.05)  # 60 mm wide, the near face at 0.2375


# Grasping


@pytest.mark.full
def test_looking_at_an_episode_does_not_change_it():
    job = grasping_jobs(2020, 200)["thesis/cuboid_1x1/flat/13"]
    seen = grasping.replay(job, width=120, height=100, ending=True)
    assert seen.told == grasp_once({**job, "methods": ["thesis"]})["thesis"]
    assert seen.closing.shape == (100, 120, 3)
    assert (seen.closing != seen.ending).any(), "the hand closed, and went up"


# Data sets


def test_pictures_fill_a_mosaic_row_by_row_with_an_arrow_where_the_camera_should_go_or_a_ring():
    pictures = [np.full((4, 4, 3), action, np.uint8) for action in Action]
    actions = pd.Series(list(Action), index=range(5, 0, -1))  # as of a table's column, whose index is its own
    (ax,) = datasets.mosaic(pictures, actions, columns=2).axes
    corners = [(round(image.get_extent()[0]), round(image.get_extent()[3])) for image in ax.images]
    assert corners == [(0, 0), (1, 0), (0, 1), (1, 1), (0, 2)]
    assert [int(image.get_array()[0, 0, 0]) for image in ax.images] == list(Action)
    moves = [action for action in Action if action is not Action.NO_OP]
    for action, arrow in zip(moves, patches(ax, FancyArrowPatch), strict=True):
        along = np.diff(arrow._posA_posB, axis=0)[0]
        assert_allclose(along / np.linalg.norm(along), action.direction, atol=1e-9)
        assert to_hex(arrow.get_edgecolor()) == ACTION_COLORS[action]
    assert len(patches(ax, Circle)) == 2  # a ring over its halo
    assert not datasets.mosaic([PICTURE]).axes[0].patches


def test_a_map_is_seen_from_above_and_what_lies_outside_is_left_out():
    grid = np.full((5, 5), -1)
    grid[0, 1:4], grid[4, 1:4], grid[2, 2] = Action.LEFT, Action.RIGHT, Action.NO_OP
    sides, level = datasets.label_maps({"sides": grid, "level": np.zeros((5, 5), int)}).axes
    assert sides.images[0].get_array().mask.sum() == 25 - 7
    assert sides.images[0].origin == "lower"
    where = {text.get_text(): text.get_position() for text in [*sides.texts, *level.texts]}
    assert (where["LEFT"], where["RIGHT"]) == ((0, -30), (0, 30))
    assert np.hypot(*where["UP"]) > 10  # it wins all around, and is named off the middle


# Training and the learned planner


def test_several_trainings_are_a_mean_a_band_and_a_line_each():
    curve = {"n": 2, "accuracy": {"mean": [0.5, 0.8], "sd": [0.1, 0.02], "all": [[0.4, 0.78], [0.6, 0.82]]}}
    one, other = training.trainings({"one": {"sgd": curve}, "other": {"adamw": curve, "sgd": curve}}).axes
    assert_allclose(lines(one)[-1], [[1, 50], [2, 80]])
    assert len(one.lines) == 3
    assert one.collections[0].get_paths()[0].get_extents().ymax == pytest.approx(82)
    assert texts(other.get_legend()) == ["adamw, n = 2", "sgd, n = 2"]
    assert one.lines[-1].get_color() == other.lines[-1].get_color()  # the same name, the same color


def test_a_row_of_the_confusion_is_a_label():
    counts = np.zeros((5, 5), int)
    counts[Action.UP, Action.LEFT] = 3
    (ax,) = training.confusion(counts).axes
    (text,) = ax.texts
    assert (text.get_text(), text.get_position()) == ("3", (Action.LEFT, Action.UP))
    assert ax.images[0].get_array()[Action.UP, Action.LEFT] == 1


# Lines and dots

WAY = [[-80.0, 60.0], [3.0, -4.0], [0.0, 0.0]]
ASKED, TAKEN = np.radians([[10, 0, 5], [30, 90, 5]]), np.radians([[10, 0, 5], [20, 180, 70]])
MISTAKES = [0.1, 0.2, 3, 4], [0.1, 0, 0, 3], [0, 1, 2, 5]
ANSWERS = [[0, -10], [10, 0], [0, 1]], [Action.UP, Action.UP, Action.NO_OP], [True, False, True]
INK = {"markeredgewidth": 2.0}  # over a halo
RINGED = {"color": ACTION_COLORS[Action.UP], "markeredgewidth": 1.3}


@pytest.mark.parametrize(("figure", "drawn"), [
    # The centroid's way, and the larger of its offsets at each look; zero too has a place on its axis.
    (lambda: traversal.convergence({"a": WAY}), [(0, "a", WAY), (1, "a", [[1, 80], [2, 4], [3, 0.05]])]),
    (lambda: traversal.centroid_and_center([PICTURE], [(8, 5)], [(9, 6)], ["can"]),
     [(0, {**INK, "marker": "o"}, [[8, 5]]), (0, {**INK, "marker": "x"}, [[9, 6]])]),
    (lambda: viewpoints.ratio_fits([arc([-10, 0])], [None]),
     [(0, "what was seen", list(enumerate(arc([-10, 0]).ratios)))]),
    # Ranges in millimeters.
    (lambda: traversal.range_history({"held": [0.25]}, 0.25, [0.25, 0.26]),
     [(0, "held", [[0, 250]]), (0, "predicted", [[0, 250], [1, 260]])]),
    (lambda: traversal.measured_and_true_range({"a": arc([-10, 0, 10])}, {"a": CENTER}),
     [(0, "true, to the center", [[-10, 250], [0, 250], [10, 250]]),
      (0, "measured", [[-10, 240], [0, np.nan], [10, 240]])]),
    # The mean of the errors, and what is said elsewhere.
    (lambda: viewpoints.error_strips({"a": {"ours": [0.5, 2.5]}}, reference={"a": 9.0}, label="b"),
     [(0, {"marker": "|"}, [[1.5, 0]]), (0, "b", [[9, 0]])]),
    (lambda: viewpoints.certainty([8, 12], [3, 1], [4, 0.5]),
     [(0, "true error", [[8, 3], [12, 1]]), (0, "stated standard deviation", [[8, 4], [12, 0.5]])]),
    # Rates in per cent; where nothing was tried, none. A bin of fewer than five is left out.
    (lambda: grasping.rates({"one": {"a": (16, 20)}}), [(0, {"linestyle": "None"}, [[80, 0]])]),
    (lambda: grasping.rates({"one": {"a": (0, 0)}}), [(0, {"linestyle": "None"}, [[0, 0]])]),
    (lambda: grasping.success_by_error({"a": ([1] * 8 + [3] * 4, [1] * 6 + [0] * 6)}), [(0, "a", [[1, 75]])]),
    (lambda: training.mistakes(*MISTAKES), [(1, {}, [[0, 0], [0.1, 1], [3, 2]])]),
    # Shares in per cent, beside their cost.
    (lambda: datasets.agreement([1, 2], {"a": [0.9, 0.8]}, {"a": [0.1, 0.4]}),
     [(0, "a", [[1, 90], [2, 80]]), (1, {}, [[1, 0.1], [2, 0.4]])]),
    # A viewpoint that was replaced is joined to what took its place.
    (lambda: datasets.replacements(ASKED, TAKEN, [False, True]),
     [(0, "taken up as asked", [[10, 0]]), (0, "out of reach", [[0, 30]]), (0, "taken up instead", [[-20, 0]]),
      (0, {"linewidth": 0.7}, [[0, 30], [-20, 0]])]),
    (lambda: training.learning_rates({"a": [1e-3, 1e-4]}), [(0, {}, [[1, 1e-3], [2, 1e-4]])]),
    # An answer in its action's color, a wrong one with a ring.
    (lambda: training.answers(*ANSWERS), [(0, {**RINGED, "markeredgewidth": 0}, [[0, -10]]), (0, RINGED, [[10, 0]])]),
    (lambda: learned.floor(np.zeros((3, 2)), 5.0, {"a": ([2.5, 5], [1, 2])}), [(1, "a", [[2.5, 1], [5, 2]])]),
    (lambda: learned.following({"a": ([0, 1], [2, 3]), "b": ([0, 1], [1, 0])}), [(0, "b", [[0, 1], [1, 0]])]),
    (lambda: learned.said_and_true({"a": {"b": ([0, 10], [0, 9], [1, 1])}}), [(0, {"marker": "o"}, [[0, 0], [10, 9]])]),
])  # fmt: skip
def test_what_was_measured_is_drawn(figure, drawn):
    axes = figure().axes
    for panel, where, points in drawn:
        where = {"label": where} if isinstance(where, str) else where
        assert_allclose(lines(axes[panel], **where), [points], atol=1e-6)


@pytest.mark.parametrize("figure", [
    lambda: traversal.convergence({"a": WAY}),
    lambda: traversal.centroid_and_center([PICTURE], [(8, 5)], [(9, 6)], ["can"]),
    lambda: traversal.arc_extents({"a": [arc([0, 10])]}),  # the first trial on top
    lambda: datasets.mosaic([PICTURE]),
    lambda: datasets.off_center({"arm": {"centroid": [[1.0, 2.0]]}}),
    lambda: training.answers(*ANSWERS),
])  # fmt: skip
def test_v_points_down(figure):
    bottom, top = figure().axes[0].get_ylim()
    assert bottom > top


@pytest.mark.parametrize(("figure", "left", "width"), [
    (lambda: training.preprocessing(np.zeros((48, 64, 3), np.uint8), 16, {"a": PICTURE}), 23.5, 16),  # what is cropped
    (lambda: datasets.off_center({"arm": {"a": [[1.0, 2.0]]}}, shift=16), -16, 32),  # what random shifts cover
    (lambda: learned.floor(np.zeros((3, 2)), 5.0, {"a": ([2.5], [1])}), -2.5, 5),  # one step
])  # fmt: skip
def test_a_square_is_as_wide_as_what_it_stands_for(figure, left, width):
    (square,) = patches(figure().axes[0], Rectangle)
    assert (square.get_x(), square.get_width(), square.get_height()) == (left, width, width)


def test_bars_carry_their_values_and_the_smallest_error_is_bold():
    (bars,) = viewpoints.grouped_bars(["a", "b"], {"x": [1.25, float("nan")], "y": [2.0, 3.0]}).axes
    assert texts(bars) == ["1.2", "", "2.0", "3.0"]  # NaN leaves one out
    (view,) = datasets.labeled_view(PICTURE, [22.0, 18.5, 17.25, 24.0, 20.0]).axes
    assert [text.get_text() for text in view.texts if text.get_weight() == "bold"] == ["DOWN\n17.25°"]
    shares, _ = training.mistakes(*MISTAKES).axes
    assert [bar.get_height() for bar in patches(shares, Rectangle)] == [50, 0, 50]
    assert texts(shares) == ["of 2", "of 0", "of 2"]
    (causes,) = grasping.cause_bars({"a": {"n": 10, "causes": dict.fromkeys(Cause, 1)}}).axes  # each has a color
    assert max(bar.get_x() + bar.get_width() for bar in patches(causes, Rectangle)) == pytest.approx(80)
