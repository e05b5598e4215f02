"""What estimators and policies answer: places on an arc, actions and tilts; and which settings are refused."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from eye_in_hand import white
from hands import fitted
from hypothesis import given
from hypothesis import strategies as st
from synthetic import arc_of_ratios, over_block

from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.motion.arm import Outcome
from gvp_lib.motion.sighting import Eye
from gvp_lib.perception.segmentation import HsvThreshold
from gvp_lib.planning.closing import RangeThreshold, SizedDepth
from gvp_lib.planning.grasp import GraspExecutor
from gvp_lib.planning.grips import Grip
from gvp_lib.planning.image_moments import ImageMomentPlanner, QuarticFit
from gvp_lib.planning.learned import CnnPlanner
from gvp_lib.planning.picking import LookDown, RobustPlanner
from gvp_lib.planning.plan import Action, Optimum, Plan, Tilt, axes_after
from gvp_lib.planning.silhouette import SilhouetteFit
from gvp_lib.planning.solids import BOX

pytestmark = pytest.mark.check

ARC = arc_of_ratios([0.5] * 5)  # the first joint of each view is its number
CENTER = np.array([0.5, -0.2, 0.1])
SIGMA = np.radians(2)

actions, radii = st.sampled_from(list(Action)), st.floats(0.05, 2.0)
viewpoints = st.tuples(st.floats(0, 3), st.floats(-np.pi, np.pi), st.floats(-np.pi, np.pi))


# Places on an arc


@pytest.mark.parametrize("place", [0, 2.25, np.float64(3.5), np.int64(4)])
def test_a_place_on_an_arc_is_that_of_a_view_or_lies_between_two(place):
    assert Optimum.between(ARC, place).joints[0] == pytest.approx(float(place))
    if place in (0, 4):
        np.testing.assert_array_equal(Optimum.at(ARC, int(place)).joints, ARC.views[int(place)].joints)


@pytest.mark.parametrize(
    ("make", "arc", "place", "text"),
    [
        *((Optimum.at, ARC, index, rf"no place {index} on an arc of 5 views, numbered 0 to 4") for index in (-1, 5)),
        (Optimum.between, ARC, 4.5, r"no place 4.5 on .*: Optimum\.at\(arc, arc\.center\)"),
        (Optimum.at, arc_of_ratios([]), 0, "no place 0 on an arc of 0 views$"),
        *((Optimum.at, arcs, 0, "an Optimum is a place on one arc, such as arcs") for arcs in ([ARC], None)),
        (Optimum.between, ARC, "2", "no place 2 on"),
        (Optimum.at, ARC, 0.3, r"takes the number of a view, a whole number; got 0\.3\. For an angle in rad .* int\("),
    ],
)
def test_a_place_that_an_arc_does_not_have_is_refused(make, arc, place, text):
    with pytest.raises(InvalidParameterError, match=text):
        make(arc, place)


# Actions


def test_the_actions_are_numbered_as_in_the_thesis_and_their_directions_are_the_images_where_v_points_down():
    expected = {"UP": (0, -1), "LEFT": (-1, 0), "DOWN": (0, 1), "RIGHT": (1, 0), "NO_OP": (0, 0)}
    assert [(action.name, action.direction) for action in Action] == list(expected.items())
    assert [int(action) for action in Action] == list(range(5))


@given(actions, st.floats(0, np.pi), radii, viewpoints)
def test_a_step_sets_out_in_its_direction_by_its_angle_about_the_center_which_stays_in_the_middle(
    action, angle, radius, viewpoint
):
    before = VirtualSphere(CENTER, radius).viewpoint(*viewpoint)
    after = before * action.step(angle, radius)
    np.testing.assert_allclose(after.inv().apply(CENTER), [0, 0, radius], atol=1e-9)
    a, b = before.translation - CENTER, after.translation - CENTER
    swept = np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)
    assert swept == pytest.approx(0 if action is Action.NO_OP else angle, abs=1e-7)
    np.testing.assert_allclose(action.step(1e-6, radius).translation / radius / 1e-6, [*action.direction, 0], atol=1e-5)


@given(actions, st.floats(0, np.pi / 2), radii)
def test_the_axes_after_each_action_are_those_of_its_step(action, angle, radius):
    axis = action.step(angle, radius).rotation.apply([0, 0, 1])
    np.testing.assert_allclose(axes_after(angle)[action], axis, atol=1e-12)


# Tilts


@pytest.mark.parametrize("given", [(np.nan, 0, 1), (np.pi + 1e-6, 0, 1), (3, 3, 1), (0, 0, 0), (0, 0, np.nan)])
def test_an_impossible_tilt_is_refused(given):
    with pytest.raises(InvalidParameterError, match=r"in rad, at most pi together.*got u="):
        Tilt(*given)


@pytest.mark.parametrize("given", [(-0.1, 0.5), (5.0, 0.5), (np.nan, 0.5), (0.1, 0.0), (0.1, np.nan), ("5", 0.5)])
def test_an_impossible_step_is_refused(given):
    with pytest.raises(InvalidParameterError, match="angle in rad, at most pi.*got {}, {}".format(*given)):
        Action.UP.step(*given)


@pytest.mark.parametrize("angle", [5.0, -0.1, np.nan, "5"])
def test_axes_after_an_impossible_step_are_refused(angle):
    with pytest.raises(InvalidParameterError, match=f"in radians, from 0 to pi; got {angle!r}"):
        axes_after(angle)


@pytest.mark.parametrize("normal", [0.0, (0, 1), (0, 0, 0), (0, np.nan, 1), [[0, 0, 1]]])
def test_a_tilt_toward_what_is_no_direction_is_refused(normal):
    with pytest.raises(InvalidParameterError, match=r"a normal is a finite vector of shape \(3,\), not of zeros; got"):
        Tilt.toward(normal, SIGMA)


@pytest.mark.parametrize("sizes", [0.1, [0.06, 0.03, 0.02]])
def test_a_shape_of_other_than_five_sizes_is_refused(sizes):
    with pytest.raises(InvalidParameterError, match="five sizes"):
        BOX.vertices(np.array(sizes))


def test_a_tilt_of_half_a_turn_is_one_in_every_direction():
    directions = np.linspace(-3, 3, 601)
    tilts = [Tilt(np.pi * np.cos(direction), np.pi * np.sin(direction), SIGMA) for direction in directions]
    assert max(np.hypot(tilt.u, tilt.v) for tilt in tilts) > np.pi  # by rounding
    assert max(tilt.angle for tilt in tilts) == np.pi


# Settings that make no sense


class OfOneArc:
    """An estimator of another signature."""

    def estimate(self, arc):
        return Optimum.at(arc, 0)


image_moments = partial(ImageMomentPlanner, white)
cnn = partial(CnnPlanner, white, policy=lambda rgb: Action.NO_OP)
executor = partial(GraspExecutor, white)


@pytest.mark.parametrize(
    ("make", "name", "values", "expected"),
    [
        *(
            (make, name, [0.0, -0.1, np.inf, np.nan, "0.25", np.ones(2)], f"positive and finite, {unit}")
            for make, unit, names in (
                (RangeThreshold, "in m", "distance"),
                (SizedDepth, "in m", "reach unknown_depth solid_sd sensor_sd gate"),
                (SizedDepth, "of the height", "share"),
                (executor, "in m", "distance limit"),
                (image_moments, "in m", "radius step"),
                (image_moments, "in rad, or None", "until"),
                (SilhouetteFit, "in m", "radius translation_sd"),
                (SilhouetteFit, "in px", "moment_sd explained"),
                (SilhouetteFit, "in rad", "rotation_sd"),
                (cnn, "in m", "radius"),
                *((make, "in px", "threshold") for make in (executor, image_moments, cnn)),
            )
            for name in names.split()
        ),
        (executor, "closing", [0.10], "a rule with a method remaining(readings, hand), as RangeThreshold() and"),
        (executor, "recenter", ["sliding"], '"turning", "shifting" or None'),
        (executor, "step", [0.0, 0.011, np.nan], "positive and at most 0.01 m"),
        *(
            (
                make,
                "segmenter",
                ["red", HsvThreshold, lambda: None],
                "called with an RGB image and returns a mask, such",
            )
            for make in (ImageMomentPlanner, RobustPlanner, LookDown)
        ),
        (
            image_moments,
            "estimator",
            [0.5, QuarticFit, OfOneArc(), lambda arcs, intrinsics: Optimum.at(arcs[-1], 0)],
            "an object with a method estimate(arcs, intrinsics), as",
        ),
        (image_moments, "order", ["minor", ["minor first"]], '"minor first" or "major first"'),
        (image_moments, "wrist_retries", [None, ("left",), (np.nan,)], "turns of the wrist, in rad"),
        (image_moments, "max_angle", [60, -0.1, np.inf, "60"], "in radians, positive and at most pi (for degrees: np"),
        (QuarticFit, "x", ["time"], '"sample", the thesis\'s, or "angle"'),
        (QuarticFit, "order", [1, 3.5, "4", None], "a whole number, 2 or more; the thesis's is 4"),
        (QuarticFit, "least_range", [-0.1, np.nan], "0 or more"),
        (SilhouetteFit, "lean", [-0.1, 10.0, None], "in radians, at most pi/4 (for degrees: np.radians)"),
        (SilhouetteFit, "shapes", [(), ("box", "ball"), None, "box"], 'of "box" and "cylinder", at least one'),
        *((cnn, name, [0.0, 14.0], "in radians, in (0, pi/2]") for name in ("step", "survey_tilt", "max_move")),
        (cnn, "policy", ["tilt-1x2", lambda: Action.UP], "called with an RGB image and returns an Action or a Tilt"),
        (cnn, "off_center", [1.0, np.inf], "at least the threshold, in px"),
        (cnn, "max_steps", [0, 2.5, True], "a whole number, at least 1"),
        (cnn, "survey", [2, -1, 6.5], "a whole number, at least 3, or 0 for none"),
        (cnn, "until", [2.0, -0.1], "a standard deviation in radians, 0 for never"),
    ],
)
def test_settings_that_make_no_sense_are_refused_by_name_with_what_would_do(make, name, values, expected):
    for value in values:
        with pytest.raises(InvalidParameterError) as refused:
            make(**{name: value})
        assert f".{name} is {expected}" in str(refused.value)
        assert str(refused.value).endswith(f"; got {value!r}")


# What a plan says of itself


@pytest.mark.parametrize("off", [0.0, 0.3])
def test_a_plan_tells_by_how_much_the_camera_leans_from_what_was_wanted(off):
    arm = over_block(tilt=off)
    view = Eye(arm, white).look()
    plan = Plan(Outcome.ALIGNED, optima=(Optimum(Outcome.ALIGNED, solid=fitted((0.03, 0.06, 0.02))),), view=view)
    assert plan.lean == pytest.approx(off, abs=1e-6)
    assert ("leans 17 deg" in repr(plan)) is bool(off)
    assert np.isnan(Plan(Outcome.ALIGNED, view=view).lean)
    grip = Grip(np.zeros(3), -view.line_of_sight, np.eye(3)[0], 0.03, 0.02, 1.0)
    gripped = Plan(Outcome.UNEXPLAINED, optima=(replace(plan.optima[0], grips=(grip,)),), view=view)
    assert gripped.lean == pytest.approx(0.0, abs=1e-6)
