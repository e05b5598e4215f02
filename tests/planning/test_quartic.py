"""The thesis's estimator on arcs of known ratios: which stationary point counts, and what it says without one."""

import numpy as np
import pytest
from eye_in_hand import CAMERA
from numpy.polynomial import Polynomial
from synthetic import arc_of_ratios

from gvp_lib.planning.image_moments import QuarticFit
from gvp_lib.planning.plan import Finding

pytestmark = pytest.mark.check

N = np.arange(21.0)


def ratios_with(*stationary, upward=1):
    """Ratios from 0.4 to 0.6, of a polynomial with these stationary points."""
    values = upward * Polynomial(np.real(Polynomial.fromroots(stationary).coef)).integ()(N)
    return 0.4 + 0.2 * (values - values.min()) / np.ptp(values)


def estimate(arc, **options):
    return QuarticFit(**options).estimate([arc], CAMERA)


def number(optimum):
    """Where on the arc, by the first joint, which is the view's number."""
    return optimum.joints[0]


@pytest.mark.parametrize("upward", [1, -1], ids=["valley", "hill"])
@pytest.mark.parametrize(
    ("points", "center", "order", "chosen"),
    [
        ((7, 10 + 15j, 10 - 15j), 10, 4, 7),  # a single one
        *(((3, 8, 16), center, 4, 8) for center in (0, 14, 20)),  # of three the middle one, wherever the center is
        # Even where an outer one lies beyond the samples. Errata 14's rule looks at those inside alone, and would take
        # the one nearest the center: here 12, and 4. On the Baxter arcs are short on one side, and that one is then
        # the edge's and not the face's: ours is the better rule.
        ((-8, 4, 12), 10, 4, 4),
        ((4, 12, 30), 6, 4, 12),
        # Where there is no middle one, or it lies beyond the samples, the one inside that is nearest the center.
        ((5, 14), 11, 3, 14),
        ((15, 26, 40), 10, 4, 15),
    ],
)
def test_the_middle_stationary_point_counts_and_else_the_one_inside_nearest_the_center(
    points, center, order, chosen, upward
):
    optimum = estimate(arc_of_ratios(ratios_with(*points, upward=upward), center), order=order)
    assert optimum.finding is Finding.OPTIMUM
    inside = [x for x in points if not np.imag(x) and 0 <= x <= 20]
    np.testing.assert_allclose(optimum.detail.stationary, inside, atol=1e-3)
    assert number(optimum) == chosen


def test_a_stationary_point_is_no_inflection_point_of_which_a_quartic_has_only_two():
    # Erratum 14 of the thesis's words; neither of the two is the optimum.
    quartic = estimate(arc_of_ratios(ratios_with(4, 9, 16))).detail
    np.testing.assert_allclose(np.sort(quartic.polynomial.deriv(2).roots().real), [6.18, 13.15], atol=0.02)


def test_without_a_stationary_point_inside_the_camera_stays_at_the_center_and_says_so():
    optimum = estimate(arc_of_ratios(np.linspace(0.3, 0.6, 15) ** 1.5, center=4))
    assert optimum.finding is Finding.NO_STATIONARY_POINT
    assert len(optimum.detail.stationary) == 0
    assert number(optimum) == optimum.detail.chosen == 4


@pytest.mark.parametrize(
    ("views", "order", "enough"), [(1, 4, False), (4, 2, False), (5, 4, True), (6, 6, False), (7, 6, True)]
)
def test_fewer_than_five_views_or_than_coefficients_are_too_few_and_lead_to_the_center(views, order, enough):
    ratios = 0.5 + 0.1 * (np.arange(views) - 2.0) ** 2 / views**2
    optimum = estimate(arc_of_ratios(ratios, center=views // 3), order=order)
    assert (optimum.finding is not Finding.TOO_FEW_VIEWS) is enough
    assert enough or (number(optimum), optimum.detail) == (views // 3, None)


def test_views_that_look_alike_are_featureless_and_any_angle_is_as_good():
    wave = 0.5 + 0.005 * np.cos(N)
    optimum = estimate(arc_of_ratios(wave, center=13))
    assert optimum.finding is Finding.FEATURELESS
    assert number(optimum) == 13
    assert optimum.detail is not None  # a figure still shows the fit
    assert estimate(arc_of_ratios(wave), least_range=0.005).finding is Finding.OPTIMUM


def test_without_interpolation_the_nearest_stored_joints_are_taken_and_with_it_those_between():
    # Erratum 14. Half a step of 20 mm at 0.25 m is 2.3 deg at most.
    arc = arc_of_ratios(ratios_with(-30, 7.3, 40))
    nearest, between = estimate(arc), estimate(arc, interpolate=True)
    np.testing.assert_array_equal(nearest.joints, arc.views[7].joints)
    assert number(between) == pytest.approx(7.3, abs=1e-4)
    assert between.detail.index == pytest.approx(between.detail.chosen) == pytest.approx(7.3, abs=1e-4)


def test_by_the_angle_unequal_steps_do_no_harm_and_equal_ones_are_the_samples():
    # Errata 15. Views crowd on one side, as where the arm can hardly step; the ratios are symmetric about 0.1 rad.
    angles = np.concatenate([np.linspace(-0.8, 0.0, 5)[:-1], np.linspace(0.0, 0.8, 17)])
    ratios = 0.4 + 0.3 * (angles - 0.1) ** 2 - 0.1 * (angles - 0.1) ** 4
    arc = arc_of_ratios(ratios, center=4, angles=angles)
    places = [number(estimate(arc, x=x, interpolate=True)) for x in ("angle", "sample")]
    by_angle, by_sample = np.interp(places, np.arange(len(angles)), angles)
    assert by_angle == pytest.approx(0.1, abs=1e-3)
    assert abs(by_sample - 0.1) > np.radians(1)
    assert number(estimate(arc, x="angle")) == 6  # the view at 0.1 rad
    even = arc_of_ratios(ratios_with(2, 9, 15))
    assert number(estimate(even, x="angle")) == number(estimate(even)) == 9


def test_the_last_arc_alone_counts_seen_from_either_end_and_tells_no_uncertainty():
    ratios = ratios_with(4, 12, 17) + 0.01 * np.random.default_rng(0).normal(size=len(N))
    first, last, back = (arc_of_ratios(r) for r in (ratios_with(3, 8, 16), ratios, ratios[::-1]))
    optimum = QuarticFit().estimate([first, last], CAMERA)
    assert number(optimum) == number(estimate(last)) == 20 - number(estimate(back))
    assert np.isnan(optimum.uncertainty)
