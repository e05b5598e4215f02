"""The image-moment planner: its estimator on arcs of known ratios, every way to end, and what it asks of an arm."""

from dataclasses import replace

import numpy as np
import pytest
from eye_in_hand import CAMERA, Hindered, PinholeArm, white
from numpy.polynomial import Polynomial
from scipy.spatial.transform import RigidTransform, Rotation
from synthetic import Block, arc_of_ratios, over_block

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arm import EyeInHandArm, Motion, Outcome
from gvp_lib.motion.primitives import turn
from gvp_lib.planning.image_moments import ImageMomentPlanner, QuarticFit
from gvp_lib.planning.plan import Optimum
from gvp_lib.planning.silhouette import SilhouetteFit
from gvp_lib.planning.solids import CYLINDER

pytestmark = pytest.mark.check

ESTIMATORS = [QuarticFit(), SilhouetteFit()]

both_estimators = pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda estimator: type(estimator).__name__)


def tilt_of(arm):
    """From the vertical, which is the block's normal, to the camera's line of sight, deg."""
    return np.degrees(np.arccos(-arm.camera_pose().rotation.as_matrix()[2, 2]))


def plan_with(estimator, arm, **options):
    """A plan, and what holds of every plan, however it ended."""
    plan = ImageMomentPlanner(white, estimator, **options).plan(arm)
    assert len(plan.arcs) == len(plan.optima)
    assert plan.views == tuple(view for arc in plan.arcs for view in arc.views)
    if plan.view is not None:
        np.testing.assert_allclose(plan.view.joints, arm.joints, atol=1e-9)
        assert plan.joints is plan.view.joints
    return plan


class Refusing(PinholeArm):
    """An arm that refuses the calls of one member where ``when(arm, argument)`` says so."""

    def __init__(self, *shapes, when, member="move_camera", reason=Outcome.UNREACHABLE, **where):
        super().__init__(*shapes, **where)
        moves, self.asked, self.refused = getattr(self, member), 0, 0

        def asked(argument):
            self.asked += 1
            if when(self, argument):
                self.refused += 1
                return Motion(False, reason)
            return moves(argument)

        setattr(self, member, asked)


def refusing(after, **options):
    """An arm that refuses so many calls later."""
    return over_block(arm=Refusing, when=lambda arm, _: arm.asked > after, **options)


def blinded(when, **where):
    return lambda: Hindered(over_block(**where), blind=when)


# The quartic


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
    assert optimum.outcome is Outcome.ALIGNED
    inside = [x for x in points if not np.imag(x) and 0 <= x <= 20]
    np.testing.assert_allclose(optimum.quartic.stationary, inside, atol=1e-3)
    assert number(optimum) == chosen


def test_a_stationary_point_is_no_inflection_point_of_which_a_quartic_has_only_two():
    # Erratum 14 of the thesis's words; neither of the two is the optimum.
    quartic = estimate(arc_of_ratios(ratios_with(4, 9, 16))).quartic
    np.testing.assert_allclose(np.sort(quartic.polynomial.deriv(2).roots().real), [6.18, 13.15], atol=0.02)


def test_without_a_stationary_point_inside_the_camera_stays_at_the_center_and_says_so():
    optimum = estimate(arc_of_ratios(np.linspace(0.3, 0.6, 15) ** 1.5, center=4))
    assert optimum.outcome is Outcome.NO_STATIONARY_POINT
    assert len(optimum.quartic.stationary) == 0
    assert number(optimum) == optimum.quartic.chosen == 4


@pytest.mark.parametrize(
    ("views", "order", "enough"), [(1, 4, False), (4, 2, False), (5, 4, True), (6, 6, False), (7, 6, True)]
)
def test_fewer_than_five_views_or_than_coefficients_are_too_few_and_lead_to_the_center(views, order, enough):
    ratios = 0.5 + 0.1 * (np.arange(views) - 2.0) ** 2 / views**2
    optimum = estimate(arc_of_ratios(ratios, center=views // 3), order=order)
    assert (optimum.outcome is not Outcome.TOO_FEW_VIEWS) is enough
    assert enough or (number(optimum), optimum.quartic) == (views // 3, None)


def test_views_that_look_alike_are_featureless_and_any_angle_is_as_good():
    wave = 0.5 + 0.005 * np.cos(N)
    optimum = estimate(arc_of_ratios(wave, center=13))
    assert optimum.outcome is Outcome.ANY_ANGLE
    assert number(optimum) == 13
    assert optimum.quartic is not None  # a figure still shows the fit
    assert estimate(arc_of_ratios(wave), least_range=0.005).outcome is Outcome.ALIGNED


def test_without_interpolation_the_nearest_stored_joints_are_taken_and_with_it_those_between():
    # Erratum 14. Half a step of 20 mm at 0.25 m is 2.3 deg at most.
    arc = arc_of_ratios(ratios_with(-30, 7.3, 40))
    nearest, between = estimate(arc), estimate(arc, interpolate=True)
    np.testing.assert_array_equal(nearest.joints, arc.views[7].joints)
    assert number(between) == pytest.approx(7.3, abs=1e-4)


def test_by_the_angle_unequal_steps_do_no_harm():
    # Errata 15. Views crowd on one side, as where the arm can hardly step; the ratios are symmetric about 0.1 rad.
    angles = np.concatenate([np.linspace(-0.8, 0.0, 5)[:-1], np.linspace(0.0, 0.8, 17)])
    ratios = 0.4 + 0.3 * (angles - 0.1) ** 2 - 0.1 * (angles - 0.1) ** 4
    arc = arc_of_ratios(ratios, center=4, angles=angles)
    places = [number(estimate(arc, x=x, interpolate=True)) for x in ("angle", "sample")]
    by_angle, by_sample = np.interp(places, np.arange(len(angles)), angles)
    assert by_angle == pytest.approx(0.1, abs=1e-3)
    assert abs(by_sample - 0.1) > np.radians(1)
    assert number(estimate(arc, x="angle")) == 6  # the view at 0.1 rad


# Where it ends


@both_estimators
@pytest.mark.parametrize("order", ["minor first", "major first"])
def test_x_ends_on_the_minor_axis_and_y_on_the_major_one_in_either_order(estimator, order):
    arm = over_block()
    plan = plan_with(estimator, arm, order=order)
    assert plan.outcome is Outcome.ALIGNED
    assert plan.outcome.arrived
    assert [arc.axis for arc in plan.arcs] == (["y", "x"] if order == "minor first" else ["x", "y"])
    x, y, _ = arm.camera_pose().rotation.as_matrix().T
    assert abs(y[1]) > np.cos(np.radians(12))
    assert np.degrees(np.arctan2(abs(y[0]), abs(y[1]))) < 2  # roll
    assert abs(x[0]) > np.cos(np.radians(12))
    assert tilt_of(arm) < (12 if estimator == QuarticFit() else 0.3)
    assert np.linalg.norm(arm.camera_pose().translation) == pytest.approx(0.25, rel=0.05)
    np.testing.assert_allclose(plan.view.blob.centroid, CAMERA.principal_point, atol=2)


def test_the_thesiss_estimator_takes_the_edge_for_the_face_where_the_arc_began_over_it():
    # Turning about its length, a bar of 32 x 20 mm shows most of itself from atan(20 / 32) = 32 deg, and less on either
    # side: the middle stationary point of an arc about 29 deg is the edge's. The plan is sure of it.
    arm = over_block(azimuth=0.0, tilt=0.5)
    plan = plan_with(QuarticFit(), arm)
    assert plan.outcome is Outcome.ALIGNED
    assert len(plan.optima[1].quartic.stationary) > 1
    assert tilt_of(arm) > 25


def test_a_smaller_step_sees_more_and_a_longer_arc_too(plan_of):
    usual = len(plan_of(QuarticFit()).views)  # 3.1.6
    assert len(plan_with(QuarticFit(), over_block(), step=0.01).views) > 1.8 * usual
    assert len(plan_with(QuarticFit(), over_block(), max_angle=0.5).views) < 0.6 * usual


def test_until_certain_says_enough_in_the_second_arc_where_it_is_certain(plan_of):
    arm = over_block()
    plan = plan_with(SilhouetteFit(), arm, until=np.radians(1.5))
    assert plan.outcome is Outcome.ALIGNED
    assert Outcome.ENOUGH in plan.arcs[1].ends
    assert np.abs(plan.arcs[0].angles).max() < np.radians(26)  # a short first arc
    assert plan.optima[-1].uncertainty < np.radians(1.5)
    assert len(plan.views) <= 0.5 * len(plan_of(SilhouetteFit()).views)
    assert tilt_of(arm) < 1


def test_where_doubt_remains_the_first_arc_is_traversed_again_in_full():
    plan = plan_with(SilhouetteFit(), over_block(), until=np.radians(0.01), max_angle=np.radians(45), step=0.04)
    assert [arc.axis for arc in plan.arcs] == ["y", "x", "y"]
    spans = [np.ptp(arc.angles) for arc in plan.arcs]
    assert spans[0] < 0.6 * spans[2]
    assert plan.outcome is Outcome.ALIGNED


# How else it can end


def lame():
    """An arm that moves, and never turns."""
    arm = over_block()
    arm.stand_at(arm.camera_pose() * turn([0.1, 0.1, 0.0]))
    arm.move_camera = lambda target: PinholeArm.move_camera(arm, RigidTransform.from_translation(target.translation))
    return arm


CAN = Block((0.06, 0.06, 0.12), CYLINDER, Rotation.from_rotvec([np.pi / 2, 0, 0]))  # lies on its side
ENDINGS = {
    # How it ends: an arm, the planner's options, the outcome, how many arcs there are, and the last one's finding.
    "nothing in view": (blinded(lambda arm: True), {}, Outcome.TARGET_NOT_FOUND, 0, None),
    "gone in the approach": (blinded(lambda arm: arm.frames > 3), {}, Outcome.TARGET_LOST, 0, None),
    "gone before the first arc": (blinded(lambda arm: arm.frames > 7), {}, Outcome.TARGET_LOST, 0, None),
    "gone in the first arc": (blinded(lambda arm: arm.frames > 30), {}, Outcome.TARGET_LOST, 1, Outcome.ALIGNED),
    "gone in the second": (blinded(lambda arm: arm.frames > 105), {}, Outcome.TARGET_LOST, 2, Outcome.ALIGNED),
    "the first step refused": (
        lambda: refusing(0, reason=Outcome.JOINT_LIMIT), {}, Outcome.JOINT_LIMIT, 0, None
    ),
    "the advance": (lambda: refusing(2, reason=Outcome.CONTACT), {}, Outcome.CONTACT, 0, None),
    "the wrist": (
        lambda: refusing(0, member="rotate_wrist", reason=Outcome.COLLISION), {}, Outcome.COLLISION, 0, None
    ),
    "the return of the first arc": (
        lambda: refusing(0, member="move_joints", reason=Outcome.STALLED),
        {}, Outcome.STALLED, 1, Outcome.ALIGNED,
    ),
    "never centered": (lame, {}, Outcome.NOT_CENTERED, 1, None),
    # One side alone of a steep view: there the ratio only falls.
    "no stationary point": (
        blinded(lambda arm: arm.camera_pose().translation[2] > 0.17, tilt=1.0, azimuth=0.0),
        {"order": "major first", "max_angle": np.radians(25)},
        Outcome.NO_STATIONARY_POINT, 2, Outcome.NO_STATIONARY_POINT,
    ),
    # About its own axis, which is along x with y on it, any angle is right.
    "a lying can": (
        lambda: over_block(CAN, radius=0.35), {"radius": 0.3}, Outcome.ANY_ANGLE, 2, Outcome.ANY_ANGLE
    ),
    "stopped within an arc": (
        lambda: Hindered(over_block(), stops=dict.fromkeys(range(14, 400), Outcome.JOINT_LIMIT)),
        {}, Outcome.TOO_FEW_VIEWS, 2, Outcome.TOO_FEW_VIEWS,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ENDINGS)
def test_a_plan_ends_with_its_outcome_and_the_trace_so_far(name):
    make, options, outcome, arcs, finding = ENDINGS[name]
    arm = make()
    plan = plan_with(QuarticFit(), arm, **options)
    assert (plan.outcome, len(plan.arcs)) == (outcome, arcs)
    assert finding is None or finding in [optimum.outcome for optimum in plan.optima]
    assert plan.outcome.arrived is (name == "a lying can")
    assert plan.frames == getattr(arm, "frames", plan.frames)
    if outcome in (Outcome.TARGET_NOT_FOUND, Outcome.TARGET_LOST):
        assert (plan.view, plan.joints) == (None, None)
    if outcome is Outcome.TARGET_NOT_FOUND:
        assert (plan.frames, arm.motions) == (1, 0)
    if name == "stopped within an arc":
        assert plan.arcs[-1].ends == (Outcome.JOINT_LIMIT, Outcome.JOINT_LIMIT)


def test_our_estimator_takes_both_arcs_together_and_goes_to_poses_without_returning_to_joints():
    short = plan_with(SilhouetteFit(), over_block(), max_angle=np.radians(3), order="major first")
    assert [len(arc) for arc in short.arcs] == [3, 3]
    assert [optimum.outcome for optimum in short.optima] == [Outcome.TOO_FEW_VIEWS, Outcome.ALIGNED]
    assert short.outcome is Outcome.TOO_FEW_VIEWS
    assert plan_with(SilhouetteFit(), refusing(0, member="move_joints")).outcome is Outcome.ALIGNED


@pytest.mark.parametrize("rows", [(0, 480), (200, 300)], ids=["all", "a band"])
def test_a_mask_that_fills_the_picture_ends_the_plan_at_once_and_is_called_too_large(rows):
    def table(rgb):
        v, _ = np.indices(rgb.shape[:2])
        return (rows[0] <= v) & (v < rows[1])

    plan = ImageMomentPlanner(table).plan(over_block())
    assert (plan.outcome, plan.arcs) == (Outcome.TOO_LARGE, ())
    assert plan.frames < 30


def test_a_plan_whose_views_are_all_clipped_is_too_large_too(plan_of):
    arcs = plan_of(QuarticFit()).arcs
    clipped = [replace(arc, views=tuple(replace(view, clipped=True) for view in arc.views)) for arc in arcs]
    for estimator in ESTIMATORS:
        assert ImageMomentPlanner(white, estimator).conclude(over_block(), clipped).outcome is Outcome.TOO_LARGE


# Poses


def capped(arm, target):
    """Looking down within 8 deg of the vertical, and so at a block's face."""
    return -(arm.camera_pose() * target).rotation.as_matrix()[2, 2] > np.cos(np.radians(8))


def test_where_no_pose_can_be_reached_the_camera_ends_at_the_view_that_looks_most_alike():
    arm = over_block(arm=Refusing, when=capped)
    plan = plan_with(SilhouetteFit(), arm)
    assert arm.refused >= 2 * 7  # after either arc all six poses, the first of them from two places
    assert (plan.outcome, len(plan.arcs)) == (Outcome.UNREACHABLE, 2)
    assert plan.optima[-1].outcome is Outcome.ALIGNED
    wanted = -plan.solid.normal
    assert wanted[2] < -np.cos(np.radians(0.5))
    best = max(view.line_of_sight @ wanted for view in plan.views)
    assert arm.camera_pose().rotation.as_matrix()[:, 2] @ wanted == pytest.approx(best, abs=1e-9)


def test_a_pose_out_of_reach_after_the_first_arc_ends_nothing():
    arcs_so_far = []

    class Noting(SilhouetteFit):
        def estimate(self, arcs, intrinsics):
            arcs_so_far[:] = arcs
            return super().estimate(arcs, intrinsics)

    arm = over_block(arm=Refusing, when=lambda arm, target: len(arcs_so_far) < 2 and capped(arm, target))
    assert plan_with(Noting(), arm).outcome is Outcome.ALIGNED
    assert arm.refused >= 7
    assert tilt_of(arm) < 0.5


class Answering:
    """An estimator that answers the same, whatever was seen."""

    def __init__(self, answer):
        self.answer = answer

    def estimate(self, arcs, intrinsics):
        return self.answer


@pytest.mark.parametrize(("radius", "turned"), [(0.25, True), (0.5, False)])
def test_of_two_views_the_nearer_to_a_pose_is_so_by_the_planners_own_radius(radius, turned, plan_of):
    # One is 0.1 m from the pose, the other 0.3 rad: 0.075 m on a sphere of 0.25 m, and 0.15 m on one of 0.5 m.
    arm = refusing(0)
    pose = arm.camera_pose()
    first = plan_of(QuarticFit()).arcs[0]
    views = [
        replace(first.views[0], base_from_camera=p, joints=[*p.translation, *p.rotation.as_rotvec()])
        for p in (pose * RigidTransform.from_translation([0.1, 0, 0]), pose * turn([0, 0, 0.3]))
    ]
    went = []
    arm.move_joints = lambda q: went.append(q) or PinholeArm.move_joints(arm, q)
    planner = ImageMomentPlanner(white, Answering(Optimum(Outcome.ALIGNED, poses=(pose,))), radius=radius)
    assert planner.conclude(arm, [replace(first, views=tuple(views), center=0)]).outcome is Outcome.UNREACHABLE
    np.testing.assert_array_equal(went[0], views[turned].joints)


def test_a_pose_is_centered_from_by_the_distance_that_its_estimator_tells(plan_of):
    # 5 mm aside at 0.1 m; by the planner's radius every correction would be three times too long.
    pose = RigidTransform.from_components([0.005, 0.0, 0.11], Rotation.from_rotvec([np.pi, 0, 0]))
    near = Optimum(Outcome.ALIGNED, poses=(pose,), distance=0.1)
    planner = ImageMomentPlanner(white, Answering(near), radius=0.3)
    assert planner.conclude(over_block(), plan_of(QuarticFit()).arcs).outcome is Outcome.ALIGNED


# What it asks of an arm and of an estimator


@both_estimators
def test_an_estimator_concludes_from_arcs_that_another_or_itself_has_traversed(estimator, plan_of):
    arm, plan = over_block(), plan_of(QuarticFit())
    arm.move_joints(plan.views[3].joints)
    concluded = ImageMomentPlanner(white, estimator).conclude(arm, plan.arcs)
    assert (concluded.outcome, concluded.arcs, len(concluded.optima)) == (Outcome.ALIGNED, plan.arcs, 1)
    assert concluded.frames < 8 < plan.frames
    np.testing.assert_array_equal(concluded.view.joints, arm.joints)
    apart = plan_of(estimator).view.base_from_camera.inv() * arm.camera_pose()  # from where its own plan ended
    assert np.linalg.norm(apart.translation) < 0.003
    assert apart.rotation.magnitude() < np.radians(1)


def test_it_sees_an_arm_only_through_the_protocol_and_counts_every_picture(plan_of):
    # `Hindered` has the protocol's members and nothing else, so there is no other way to the arm behind it.
    arm = Hindered(over_block())
    assert isinstance(arm, EyeInHandArm)
    plan, usual = plan_with(QuarticFit(), arm, keep_images=True), plan_of(QuarticFit())
    np.testing.assert_array_equal(plan.joints, usual.joints)
    assert plan.frames == arm.frames > len(plan.views)
    assert all(view.rgb.shape == (480, 640, 3) for view in plan.views)
    assert all(view.rgb is None for view in usual.views)  # unless asked for


@pytest.mark.parametrize(
    ("said", "text"),
    [
        (3, r"Answering\.estimate returned 3; .* Optimum\.at\(arcs\[-1\], index\) makes one"),
        (Optimum(Outcome.ALIGNED, joints=np.zeros(3)), r"Answering\.estimate returned 3 joint angles; this arm has 6"),
        (Optimum(Outcome.ALIGNED), r"neither joints nor poses.*Optimum\.at\(arcs\[-1\], arcs\[-1\]\.center"),
    ],
)
def test_an_estimator_that_returns_no_optimum_and_arcs_without_views_are_refused(said, text, plan_of):
    planner, arcs, arm = ImageMomentPlanner(white, Answering(said)), plan_of(QuarticFit()).arcs, Hindered(over_block())
    with pytest.raises(InvalidParameterError, match=text):
        planner.conclude(arm, arcs)
    for none in ([], [*arcs, replace(arcs[0], views=(), center=-1)], None, plan_of(QuarticFit())):
        with pytest.raises(InvalidParameterError, match="give the arcs of a plan, at least one, and each with views"):
            planner.conclude(arm, none)
    assert arm.frames == arm.motions == 0
