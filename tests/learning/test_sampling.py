"""Which viewpoints are visited: spread as the thesis's two sets are, and each once."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.learning.recipe import CollectionRecipe, redrawn, tour, viewpoints

CAP, SIGMA = np.radians(30), np.radians(15)


def recipe(**options):
    return CollectionRecipe(arm="floating", **options)


def truncated_rayleigh(tilt, sigma=SIGMA, cap=CAP):
    """Distribution of the length of a normal tilt in the plane, cut at the cap."""
    return -np.expm1(-((tilt / sigma) ** 2) / 2) / -np.expm1(-((cap / sigma) ** 2) / 2)


def turn(a, b):
    """Angle of the rotation between two viewpoints, or between the rows of two arrays of them, rad."""
    one, other = (VirtualSphere(np.zeros(3), 1.0).viewpoint(*np.transpose(x)).rotation for x in (a, b))
    return (one.inv() * other).magnitude()


def rows(a):
    """As a set in which each viewpoint counts once for each time that it is there."""
    return sorted(map(tuple, np.round(a, 9).tolist()))


# uniform


def test_a_uniform_set_is_evenly_spaced_in_area_over_the_cap():
    """Rings of equal area, and sectors of them, hold equally many points, as no random draw would."""
    tilt, azimuth, _ = viewpoints(recipe(rolls=1)).T
    assert tilt.max() <= CAP
    ring = np.floor(8 * (1 - np.cos(tilt)) / (1 - np.cos(CAP))).clip(0, 7)
    sector = np.floor(8 * (azimuth % (2 * np.pi)) / (2 * np.pi))
    counts = np.bincount((8 * ring + sector).astype(int), minlength=64)
    assert np.abs(counts - 64).max() <= 8
    np.testing.assert_array_equal(np.bincount(ring.astype(int)), np.full(8, 512))


def test_the_points_of_a_uniform_set_keep_their_distance():
    """No two nearer than half of what a square grid of as many would have."""
    points = VirtualSphere(np.zeros(3), 1.0).viewpoint(*viewpoints(recipe(n=1024, rolls=1, sort=False)).T).translation
    gaps = np.linalg.norm(points[:, None] - points[None], axis=2) + 9 * np.eye(1024)
    grid = np.sqrt(2 * np.pi * (1 - np.cos(CAP)) / 1024)
    assert 0.5 * grid < gaps.min(axis=1).min()
    assert gaps.min(axis=1).max() < 1.5 * grid


def test_each_point_of_a_uniform_set_has_evenly_spaced_rolls():
    drawn = viewpoints(recipe(n=256, rolls=16, sort=False)).reshape(16, 16, 3)
    np.testing.assert_allclose(np.ptp(drawn[..., 0], axis=1), 0, atol=1e-9)
    np.testing.assert_allclose(np.diff(np.sort(drawn[..., 2] % (2 * np.pi), axis=1)), 2 * np.pi / 16, atol=1e-9)


def test_a_uniform_set_is_the_same_for_every_seed_and_every_scene():
    first = viewpoints(recipe(n=64, seed=1, scenes=2), 0)
    np.testing.assert_array_equal(viewpoints(recipe(n=64, seed=2, scenes=2), 1), first)


# random


def test_a_random_set_is_a_normal_of_15_deg_cut_at_30():
    tilt, azimuth, roll = viewpoints(recipe(sampling="random", seed=3)).T
    assert tilt.max() <= CAP
    assert stats.kstest(tilt, truncated_rayleigh).pvalue > 0.01
    for angle in (azimuth, roll):
        assert stats.kstest(angle % (2 * np.pi), stats.uniform(0, 2 * np.pi).cdf).pvalue > 0.01
    assert stats.kstest(tilt, lambda t: truncated_rayleigh(t, sigma=1.1 * SIGMA)).pvalue < 0.01  # it can tell


def test_without_a_sigma_a_random_set_is_uniform_in_area():
    tilt = viewpoints(recipe(sampling="random", sigma=None))[:, 0]
    assert stats.kstest(tilt, lambda t: (1 - np.cos(t)) / (1 - np.cos(CAP))).pvalue > 0.01


def test_a_random_set_depends_on_its_seed_and_its_scene_alone():
    def drawn(seed, scene):
        return viewpoints(recipe(sampling="random", n=40, scenes=2, seed=seed), scene)

    np.testing.assert_array_equal(drawn(1, 0), drawn(1, 0))
    assert not np.allclose(drawn(1, 0), drawn(2, 0))
    assert not np.allclose(drawn(1, 0), drawn(1, 1))


@pytest.mark.parametrize("sampling", ["uniform", "random"])
def test_the_cap_may_be_another(sampling):
    tilt = viewpoints(recipe(sampling=sampling, n=512, max_tilt=np.radians(50)))[:, 0]
    assert np.radians(40) < tilt.max() <= np.radians(50)


# order


@pytest.mark.parametrize("sampling", ["uniform", "random"])
def test_sorting_changes_the_order_alone(sampling):
    plain, ordered = (viewpoints(recipe(sampling=sampling, n=512, sort=sort)) for sort in (False, True))
    assert rows(plain) == rows(ordered)
    assert not np.array_equal(plain, ordered)


def test_a_tour_turns_far_less_than_the_order_of_drawing():
    plain, ordered = (viewpoints(recipe(sampling="random", n=1024, sort=sort)) for sort in (False, True))
    assert turn(ordered[:-1], ordered[1:]).mean() < 0.2 * turn(plain[:-1], plain[1:]).mean()


coordinates = st.lists(
    st.tuples(st.floats(0, 1.5), st.floats(-np.pi, np.pi), st.floats(-np.pi, np.pi)), min_size=1, max_size=12
).map(np.array)


@given(coordinates)
def test_a_tour_visits_each_once_and_goes_on_to_the_nearest_that_is_left(given):
    order = tour(given)
    assert sorted(order.tolist()) == list(range(len(given)))
    here = np.zeros(3)
    for k in range(len(order)):
        left = order[k:]
        turns = turn(np.broadcast_to(here, (len(left), 3)), given[left])
        assert turns[0] <= turns.min() + 1e-6
        here = given[order[k]]


def test_a_tour_of_many_of_the_same_viewpoint_still_visits_each_once():
    assert sorted(tour(np.zeros((40, 3))).tolist()) == list(range(40))


def test_a_tour_of_none_is_empty():
    assert tour(np.zeros((0, 3))).tolist() == []


# replacement


def test_what_replaces_a_viewpoint_is_drawn_by_number_and_attempt_alone():
    asked = viewpoints(recipe(n=64))
    again = redrawn(recipe(n=64), 64, 1, asked)
    np.testing.assert_array_equal(redrawn(recipe(n=64), 64, 1, asked), again)
    for other in (
        redrawn(recipe(n=64), 64, 2, asked),
        redrawn(recipe(n=64), 0, 1, asked),
        redrawn(recipe(n=64, seed=1), 64, 1, asked),
    ):
        assert not np.allclose(other[:, 0], again[:, 0])


@pytest.mark.parametrize(
    ("sampling", "cdf"),
    [("random", truncated_rayleigh), ("uniform", lambda t: (1 - np.cos(t)) / (1 - np.cos(CAP)))],
)
def test_what_replaces_viewpoints_is_spread_as_they_are(sampling, cdf):
    of = recipe(sampling=sampling, n=2048)
    tilt = redrawn(of, 0, 1, viewpoints(of))[:, 0]
    assert tilt.max() <= CAP
    assert stats.kstest(tilt, cdf).pvalue > 0.01


def test_what_replaces_a_viewpoint_looks_straight_down_with_the_same_turn_of_the_hand():
    of = recipe(n=64)
    asked = viewpoints(of)
    drawn = redrawn(of, 0, 1, asked)
    asked[:, 0] = drawn[:, 0] = 0.0
    np.testing.assert_allclose(turn(asked, drawn), 0, atol=1e-6)
