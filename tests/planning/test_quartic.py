"""The thesis's estimator on arcs of known ratios: which stationary point counts, and what it says without one."""

import numpy as np
import pytest
from eye_in_hand import CAMERA
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial
from synthetic import arc_of_ratios

from gvp_lib.errors import InvalidParameterError
from gvp_lib.planning.plan import Finding, Optimum, ViewpointEstimator
from gvp_lib.planning.quartic import QuarticFit
from gvp_lib.planning.silhouette import SilhouetteFit

pytestmark = pytest.mark.check

N = np.arange(21.0)


def ratios_with(*stationary, x=N, upward=1):
    """Ratios from 0.4 to 0.6, of a polynomial with these stationary points."""
    values = Polynomial.fromroots(stationary).integ()(x) * upward
    return 0.4 + 0.2 * (values - values.min()) / np.ptp(values)


def estimate(arc, **options):
    return QuarticFit(**options).estimate([arc], CAMERA)


def number(optimum):
    """Where on the arc, by the first joint, which is the view's number."""
    return optimum.joints[0]


@pytest.mark.parametrize("upward", [1, -1], ids=["valley", "hill"])
def test_a_single_stationary_point_is_the_optimum(upward):
    # Two of the derivative's three roots are complex: 10 +- 15 i.
    lone = (Polynomial([-7, 1]) * Polynomial([325, -20, 1])).integ()(N) * upward
    optimum = estimate(arc_of_ratios(0.3 + 0.3 * (lone - lone.min()) / np.ptp(lone)))
    assert optimum.finding is Finding.OPTIMUM
    np.testing.assert_allclose(optimum.detail.stationary, [7], atol=1e-6)
    assert number(optimum) == 7


@given(st.permutations([3.0, 8.0, 16.0]), st.sampled_from([1, -1]), st.integers(0, 20))
def test_of_three_stationary_points_the_middle_one_counts_wherever_the_center_is(points, upward, center):
    optimum = estimate(arc_of_ratios(ratios_with(*points, upward=upward), center=center))
    np.testing.assert_allclose(optimum.detail.stationary, [3, 8, 16], atol=1e-5)
    assert number(optimum) == 8


@pytest.mark.parametrize(
    ("points", "center", "errata_14"), [((-8, 4, 12), 10, 12), ((4, 12, 30), 6, 4)], ids=["left", "right"]
)
def test_the_middle_one_of_three_counts_even_where_an_outer_one_lies_beyond_the_samples(points, center, errata_14):
    # Errata 14's rule looks at those inside the samples alone: of these two it takes the one nearest the center. On the
    # Baxter arcs are short on one side, and that one is then the edge's and not the face's: ours is the better rule.
    optimum = estimate(arc_of_ratios(ratios_with(*points), center=center))
    inside = [x for x in points if 0 <= x <= 20]
    np.testing.assert_allclose(optimum.detail.stationary, inside, atol=1e-4)
    assert min(inside, key=lambda x: abs(x - center)) == errata_14
    assert optimum.finding is Finding.OPTIMUM
    assert number(optimum) == points[1] != errata_14


@pytest.mark.parametrize(("center", "chosen"), [(8, 5), (11, 14)])
def test_where_the_middle_one_lies_beyond_the_samples_the_one_inside_nearest_the_center_counts(center, chosen):
    # With a polynomial of order 3 there are two, and none is the middle one.
    optimum = estimate(arc_of_ratios(ratios_with(5, 14), center=center), order=3)
    assert number(optimum) == chosen
    # A quartic whose only stationary point inside is an outer one of its three.
    optimum = estimate(arc_of_ratios(ratios_with(15, 26, 40), center=center))
    np.testing.assert_allclose(optimum.detail.stationary, [15], atol=1e-3)
    assert number(optimum) == 15


def test_without_a_stationary_point_inside_the_camera_stays_at_the_center_and_says_so():
    optimum = estimate(arc_of_ratios(np.linspace(0.3, 0.6, 15) ** 1.5, center=4))
    assert optimum.finding is Finding.NO_STATIONARY_POINT
    assert len(optimum.detail.stationary) == 0
    assert number(optimum) == optimum.detail.chosen == 4


@pytest.mark.parametrize(
    ("views", "order", "enough"), [(4, 4, False), (5, 4, True), (6, 6, False), (7, 6, True), (4, 2, False)]
)
def test_fewer_than_five_views_or_than_coefficients_are_too_few(views, order, enough):
    x = np.arange(views)
    optimum = estimate(arc_of_ratios(0.5 + 0.1 * (x - 2.0) ** 2 / views**2, center=1), order=order)
    assert (optimum.finding is not Finding.TOO_FEW_VIEWS) is enough
    if not enough:
        assert number(optimum) == 1
        assert optimum.detail is None


def test_an_arc_of_one_view_alone_is_too_few_and_leads_to_that_view():
    optimum = estimate(arc_of_ratios([0.5]))
    assert optimum.finding is Finding.TOO_FEW_VIEWS
    assert number(optimum) == 0


def test_views_that_look_alike_are_featureless_and_any_angle_is_as_good():
    wave = 0.5 + 0.005 * np.cos(N)
    optimum = estimate(arc_of_ratios(wave, center=13))
    assert optimum.finding is Finding.FEATURELESS
    assert number(optimum) == 13
    assert optimum.detail is not None  # a figure still shows the fit
    assert estimate(arc_of_ratios(wave), least_range=0.005).finding is Finding.OPTIMUM
    assert estimate(arc_of_ratios(np.full(9, 0.5))).finding is Finding.FEATURELESS


def test_constant_ratios_have_no_stationary_point_and_break_nothing():
    optimum = estimate(arc_of_ratios(np.full(9, 0.5)), least_range=0.0)
    assert number(optimum) in range(9)


def test_without_interpolation_the_nearest_stored_joints_are_taken_and_with_it_those_between():
    arc = arc_of_ratios(ratios_with(-30, 7.3, 40))
    nearest, between = estimate(arc), estimate(arc, interpolate=True)
    assert number(nearest) == 7
    np.testing.assert_array_equal(nearest.joints, arc.views[7].joints)
    assert number(between) == pytest.approx(7.3, abs=1e-4)
    assert between.detail.index == pytest.approx(between.detail.chosen) == pytest.approx(7.3, abs=1e-4)


def test_by_the_angle_unequal_steps_do_no_harm():
    # Errata 15. Views crowd on one side, as where the arm can hardly step; the ratios are symmetric about 0.1 rad.
    angles = np.concatenate([np.linspace(-0.8, 0.0, 5)[:-1], np.linspace(0.0, 0.8, 17)])
    ratios = 0.4 + 0.3 * (angles - 0.1) ** 2 - 0.1 * (angles - 0.1) ** 4
    arc = arc_of_ratios(ratios, center=4, angles=angles)
    where = {x: estimate(arc, x=x, interpolate=True) for x in ("sample", "angle")}
    swept = {x: np.interp(number(optimum), np.arange(len(angles)), angles) for x, optimum in where.items()}
    assert where["angle"].detail.chosen == pytest.approx(0.1, abs=1e-4)
    assert swept["angle"] == pytest.approx(0.1, abs=1e-3)
    assert abs(swept["sample"] - 0.1) > np.radians(1)
    assert number(estimate(arc, x="angle")) == 6  # the view at 0.1 rad


def test_with_equal_steps_number_and_angle_agree():
    arc = arc_of_ratios(ratios_with(2, 9, 15))
    assert number(estimate(arc, x="angle")) == number(estimate(arc)) == 9


def test_the_last_arc_alone_counts():
    first, last = arc_of_ratios(ratios_with(3, 8, 16)), arc_of_ratios(ratios_with(4, 12, 17))
    assert number(QuarticFit().estimate([first, last], CAMERA)) == 12
    assert np.isnan(QuarticFit().estimate([last], CAMERA).uncertainty)


def test_the_same_arc_seen_the_other_way_around_gives_the_same_place():
    ratios = ratios_with(3, 8, 16) + 0.01 * np.random.default_rng(0).normal(size=len(N))
    there, back = estimate(arc_of_ratios(ratios)), estimate(arc_of_ratios(ratios[::-1]))
    assert number(back) == 20 - number(there)


@pytest.mark.parametrize("place", [0, 2.25, np.float64(3.5), 4])
def test_a_place_on_an_arc_is_that_of_a_view_or_lies_between_two(place):
    arc = arc_of_ratios([0.5] * 5)
    assert number(Optimum.between(arc, place)) == pytest.approx(float(place))
    if place in (0, 4):
        np.testing.assert_array_equal(Optimum.at(arc, np.int64(place)).joints, arc.views[place].joints)


@pytest.mark.parametrize("index", [-3, -1, 5, 9])
def test_a_view_that_the_arc_does_not_have_is_refused(index):
    text = rf"no place {index} on an arc whose views have the numbers 0 to 4.*Optimum\.at\(arc, arc\.center\)"
    for make in (Optimum.at, Optimum.between):
        with pytest.raises(InvalidParameterError, match=text):
            make(arc_of_ratios([0.5] * 5), index)


def test_an_arc_without_views_has_no_place_to_go_to():
    with pytest.raises(InvalidParameterError, match="no place 0 on an arc that has no views"):
        Optimum.at(arc_of_ratios([]), 0)
    with pytest.raises(InvalidParameterError, match="no place nan"):
        Optimum.between(arc_of_ratios([0.5] * 5), np.nan)


@pytest.mark.parametrize("angle", [0.3, np.float64(-0.1), 2.0])
def test_an_angle_is_not_the_number_of_a_view(angle):
    text = rf"takes the number of a view, a whole number; got {angle}\. Of an angle in rad the nearest view is int\("
    with pytest.raises(InvalidParameterError, match=text):
        Optimum.at(arc_of_ratios([0.5] * 5), angle)


def test_both_estimators_are_estimators_and_a_number_is_not():
    assert isinstance(QuarticFit(), ViewpointEstimator)
    assert isinstance(SilhouetteFit(), ViewpointEstimator)
    assert not isinstance(0.5, ViewpointEstimator)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"x": "time"}, 'the x axis is "sample", the thesis\'s, or "angle"; got \'time\''),
        ({"order": 1}, "order is 2 or more, the thesis's is 4"),
        ({"order": 3.5}, "got 3.5"),
        ({"least_range": -0.1}, "least_range not negative; got 4, -0.1"),
        ({"least_range": np.nan}, "least_range not negative; got 4, nan"),
    ],
)
def test_settings_that_make_no_sense_are_refused(options, text):
    with pytest.raises(InvalidParameterError, match=text):
        QuarticFit(**options)
