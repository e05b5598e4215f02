"""Views from all around: how few, how far apart, which next, what ends them, and what stands in the way."""

import numpy as np
import pytest
from eye_in_hand import PinholeArm, white
from synthetic import over_block

from gvp_lib import ContourFit, EyeInHandArm, Noise, QuarticFit, SilhouetteFit, SpreadViews, WorkCell
from gvp_lib.errors import InvalidParameterError
from gvp_lib.evaluation import begin
from gvp_lib.motion import Motion, Outcome

check = pytest.mark.check


def directions(plan):
    """Lines of sight, and the least angle between any two, deg."""
    sight = np.array([view.line_of_sight for view in plan.views])
    between = np.degrees(np.arccos(np.clip(sight @ sight.T, -1, 1)))
    return sight, between[np.triu_indices(len(sight), 1)].min()


@pytest.mark.parametrize("following", ["spread", "covariance"])
@pytest.mark.parametrize(
    ("target", "placement", "others"),
    [
        ("cuboid_1x2", "tilted", ()),
        ("cuboid_1x1", "walled", ()),
        ("cylinder", "side", ()),
        ("cuboid_1x2", "flat", ("cuboid_1x3", "cuboid_1x1", "cuboid_1x4")),
    ],
)
def test_a_handful_of_views_tells_the_normal(target, placement, others, following):
    with WorkCell("baxter", target, placement, noise=Noise.thesis(), others=others, touching=True) as cell:
        for k in range(2):
            begin(cell, k, seed=5)
            plan = SpreadViews(cell.segmenter, following=following).plan(cell.arm)
            assert plan.outcome is Outcome.ALIGNED
            assert 5 <= len(plan.views) <= 8
            assert plan.frames <= 25
            assert np.degrees(cell.truth.viewpoint_error()) < 1.5
            assert np.degrees(plan.uncertainty) < 1.5
            assert directions(plan)[1] > 10


@check
def test_it_goes_on_until_it_is_certain_but_never_below_the_fewest_nor_above_the_most():
    for until, most, views in ((np.pi, 10, 6), (1e-6, 8, 8)):
        plan = SpreadViews(white, until=until, fewest=6, most=most).plan(over_block())
        assert (plan.outcome, len(plan.views)) == (Outcome.ALIGNED, views)
    sight, apart = directions(plan)
    assert apart > 20
    assert np.degrees(np.arccos(sight[1:] @ sight[0])).max() < 66  # of a cap of 60, from a center that is about known


@check
def test_what_a_further_view_would_tell_is_foreseen_about_as_it_turns_out():
    arm, fit = over_block(), ContourFit()
    views = SpreadViews(white, fit, until=1e-6, most=9).plan(arm).views
    solid = fit.fit(views[:5], arm.intrinsics)
    foreseen = fit.foreseen(solid, views[:5], arm.intrinsics, [view.base_from_camera for view in views[5:]])
    found = [fit.fit([*views[:5], view], arm.intrinsics, views[0]).uncertainty for view in views[5:]]
    assert foreseen.shape == (4,)
    assert (foreseen < solid.uncertainty).all()
    np.testing.assert_allclose(foreseen, found, rtol=0.35)


class Members:
    """An arm with what the protocol names, and nothing else."""

    def __init__(self, arm):
        self._arm = arm

    def __getattr__(self, name):
        if name in {*vars(EyeInHandArm)} and not name.startswith("_"):
            return getattr(self._arm, name)
        raise AttributeError(name)


@pytest.mark.parametrize("placement", ["flat", "walled"])
def test_it_needs_no_more_of_an_arm_than_the_protocol(placement):
    with WorkCell("baxter", "cuboid_1x2", placement, noise=Noise.thesis(), seed=3) as cell:
        plan = SpreadViews(cell.segmenter).plan(Members(cell.arm))
        assert plan.outcome is Outcome.ALIGNED
        assert np.degrees(cell.truth.viewpoint_error()) < 1.5


class Narrow(PinholeArm):
    """An arm that cannot look from beyond some angle off its first line of sight; it stops there."""

    most = np.radians(35)

    def move_camera(self, camera_from_target):
        goal = self.camera_pose() * camera_from_target
        if not hasattr(self, "first"):
            self.first = self.camera_pose().rotation.as_matrix()[:, 2]
        if self.first @ goal.rotation.as_matrix()[:, 2] < np.cos(self.most):
            return Motion(False, Outcome.JOINT_LIMIT)
        return super().move_camera(camera_from_target)


@check
def test_where_the_arm_cannot_go_it_looks_from_elsewhere_and_says_so_where_that_is_not_enough():
    plan = SpreadViews(white).plan(over_block(arm=Narrow))
    assert plan.outcome in (Outcome.ALIGNED, Outcome.JOINT_LIMIT)
    assert len(plan.views) >= 5
    sight, _ = directions(plan)
    assert (sight @ sight[0] > np.cos(np.radians(36))).all()
    # As near to the wanted view as the arm goes.
    plan = SpreadViews(white).plan(over_block(arm=Narrow, tilt=0.9))
    assert plan.outcome is Outcome.JOINT_LIMIT
    visited, ends = (
        np.degrees(np.arccos(-sights @ plan.solid.normal)) for sights in (directions(plan)[0], plan.view.line_of_sight)
    )
    assert 1 < ends < visited.min() - 0.5
    still = type("Still", (Narrow,), {"most": np.radians(12)})
    plan = SpreadViews(white).plan(over_block(arm=still))
    assert plan.outcome is Outcome.TOO_FEW_VIEWS
    assert 0 < len(plan.views) < 5


@check
def test_any_estimator_serves_but_one_that_reads_an_arc():
    plan = SpreadViews(white, SilhouetteFit(), fewest=8, until=0.1).plan(over_block())
    assert (plan.outcome, plan.solid.kind) == (Outcome.ALIGNED, "box")
    assert "8 views up to" in repr(plan.arcs[0])
    with pytest.raises(InvalidParameterError, match="a quartic goes through the ratios along an arc"):
        SpreadViews(white, QuarticFit()).plan(over_block())


@check
@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"fewest": 4}, "fewest is a whole number, 5 or more"),
        ({"fewest": 8, "most": 7}, "most is a whole number, not below the fewest"),
        ({"spread": 60}, "spread is in radians"),
        ({"following": "random"}, 'following is "spread", or .*"covariance"'),
        ({"following": "covariance", "estimator": SilhouetteFit()}, "a method foreseen"),
        ({"until": 0.0}, "until is positive"),
    ],
)
def test_settings_that_cannot_be_are_refused(options, said):
    with pytest.raises(InvalidParameterError, match=said):
        SpreadViews(white, **options)
