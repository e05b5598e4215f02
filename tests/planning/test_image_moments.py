"""The image-moment planner: where it ends, every way in which it can end, and what it asks of an arm."""

from dataclasses import replace

import numpy as np
import pytest
from eye_in_hand import CAMERA, Ball, Hindered, PinholeArm, white
from scipy.spatial.transform import RigidTransform, Rotation
from synthetic import Block, over_block

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arc import ArcEnd
from gvp_lib.motion.arm import EyeInHandArm, Motion, StopReason
from gvp_lib.motion.primitives import turn
from gvp_lib.planning.image_moments import ImageMomentPlanner, QuarticFit
from gvp_lib.planning.plan import Finding, Optimum, Plan, PlanOutcome
from gvp_lib.planning.silhouette import SilhouetteFit
from gvp_lib.planning.solids import CYLINDER

pytestmark = pytest.mark.check

ESTIMATORS = [QuarticFit(), SilhouetteFit()]
LYING = Rotation.from_rotvec([np.pi / 2, 0, 0])

both_estimators = pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda estimator: type(estimator).__name__)


def tilt_of(arm):
    """From the vertical, which is the block's normal, to the camera's line of sight, deg."""
    return np.degrees(np.arccos(-arm.camera_pose().rotation.as_matrix()[2, 2]))


def plan_with(estimator, arm, **options):
    return ImageMomentPlanner(white, estimator, **options).plan(arm)


def check_trace(plan: Plan, arm) -> None:
    """What holds of every plan, however it ended."""
    assert plan.outcome.arrived is (plan.outcome in (PlanOutcome.ALIGNED, PlanOutcome.ANY_ANGLE))
    assert len(plan.arcs) == len(plan.optima)
    assert plan.views == tuple(view for arc in plan.arcs for view in arc.views)
    if plan.view is not None:
        np.testing.assert_allclose(plan.view.joints, arm.joints, atol=1e-9)
        assert plan.joints is plan.view.joints


# Where it ends


@both_estimators
@pytest.mark.parametrize("order", ["minor first", "major first"])
def test_x_ends_on_the_minor_axis_and_y_on_the_major_one_in_either_order(estimator, order):
    arm = over_block()
    plan = plan_with(estimator, arm, order=order)
    assert plan.outcome is PlanOutcome.ALIGNED
    assert [arc.axis for arc in plan.arcs] == (["y", "x"] if order == "minor first" else ["x", "y"])
    x, y, _ = arm.camera_pose().rotation.as_matrix().T
    assert abs(y[1]) > np.cos(np.radians(12))
    assert np.degrees(np.arctan2(abs(y[0]), abs(y[1]))) < 2  # roll
    assert abs(x[0]) > np.cos(np.radians(12))
    assert tilt_of(arm) < (12 if estimator == QuarticFit() else 0.3)
    assert np.linalg.norm(arm.camera_pose().translation) == pytest.approx(0.25, rel=0.05)
    np.testing.assert_allclose(plan.view.blob.centroid, CAMERA.principal_point, atol=2)
    check_trace(plan, arm)


@pytest.mark.parametrize("azimuth", [0, 2, 5])
def test_our_estimator_ends_at_the_face_wherever_it_began(azimuth):
    arm = over_block(azimuth=azimuth, tilt=0.5)
    plan_with(SilhouetteFit(), arm, max_angle=np.radians(45))
    assert tilt_of(arm) < 0.5


def test_the_thesiss_estimator_takes_the_edge_for_the_face_where_the_arc_began_over_it():
    # Turning about its length, a bar of 32 x 20 mm shows most of itself from atan(20 / 32) = 32 deg, and less on either
    # side: the middle stationary point of an arc about 29 deg is the edge's. The plan is sure of it.
    arm = over_block(azimuth=0.0, tilt=0.5)
    plan = plan_with(QuarticFit(), arm)
    assert plan.outcome is PlanOutcome.ALIGNED
    assert len(plan.optima[1].detail.stationary) > 1
    assert tilt_of(arm) > 25


def test_of_a_lying_can_any_angle_about_its_own_axis_is_right():
    can = Block((0.06, 0.06, 0.12), CYLINDER, LYING)
    plan = plan_with(QuarticFit(), over_block(can, radius=0.35), radius=0.3)
    assert plan.outcome is PlanOutcome.ANY_ANGLE
    assert [optimum.finding for optimum in plan.optima] == [Finding.OPTIMUM, Finding.FEATURELESS]
    assert plan.arcs[1].axis == "x"  # along x with y on its axis: about that axis
    np.testing.assert_array_equal(plan.optima[1].joints, plan.arcs[1].views[plan.arcs[1].center].joints)


def test_a_smaller_step_sees_more_and_a_longer_arc_too(plan_of):
    # 3.1.6. The time is that of the looks: an arm that does not stop for them would need no more.
    usual = plan_of(QuarticFit())
    finer, shorter = (plan_with(QuarticFit(), over_block(), **o) for o in ({"step": 0.01}, {"max_angle": 0.5}))
    assert len(finer.views) > 1.8 * len(usual.views)
    assert finer.frames > 1.6 * usual.frames
    assert len(shorter.views) < 0.6 * len(usual.views)


# Stopping when certain


def test_until_certain_says_enough_in_the_second_arc_where_it_is_certain(plan_of):
    arm = over_block()
    plan = plan_with(SilhouetteFit(), arm, until=np.radians(1.5))
    assert plan.outcome is PlanOutcome.ALIGNED
    assert ArcEnd.ENOUGH in plan.arcs[1].ends
    assert np.abs(plan.arcs[0].angles).max() < np.radians(26)  # a short first arc
    assert plan.optima[-1].uncertainty < np.radians(1.5)
    assert len(plan.views) <= 0.5 * len(plan_of(SilhouetteFit()).views)
    assert tilt_of(arm) < 1


def test_where_doubt_remains_the_first_arc_is_traversed_again_in_full():
    plan = plan_with(SilhouetteFit(), over_block(), until=np.radians(0.01), max_angle=np.radians(45), step=0.04)
    assert [arc.axis for arc in plan.arcs] == ["y", "x", "y"]
    spans = [np.ptp(arc.angles) for arc in plan.arcs]
    assert spans[0] < 0.6 * spans[2]
    assert plan.outcome is PlanOutcome.ALIGNED


# How else it can end


@both_estimators
def test_an_object_out_of_view_at_the_start_is_not_found_and_nothing_moves(estimator):
    arm = Hindered(PinholeArm(Ball((5.0, 0.0, 0.0))))
    plan = plan_with(estimator, arm)
    assert plan.outcome is PlanOutcome.TARGET_NOT_FOUND
    assert (plan.arcs, plan.optima, plan.view, plan.joints, plan.frames) == ((), (), None, None, 1)
    assert arm.motions == 0


@both_estimators
@pytest.mark.parametrize(("frames", "arcs"), [(3, 0), (30, 1), (105, 2)], ids=["approach", "first arc", "second arc"])
def test_an_object_gone_for_good_ends_the_plan_as_lost_and_the_trace_is_kept(estimator, frames, arcs):
    arm = Hindered(over_block(), blind=lambda arm: arm.frames > frames)
    plan = plan_with(estimator, arm)
    assert (plan.outcome, plan.view, plan.frames) == (PlanOutcome.TARGET_LOST, None, arm.frames)
    assert len(plan.arcs) == arcs
    assert all(len(arc) > 5 for arc in plan.arcs)
    check_trace(plan, arm)


@both_estimators
def test_an_object_lost_on_one_side_of_an_arc_is_aligned_with_all_the_same(estimator):
    # Hidden from beyond 35 deg on one side of the first arc, as behind a wall.
    def hidden(arm):
        return arm.camera_pose().rotation.as_matrix()[1, 2] > np.sin(np.radians(35))

    arm = Hindered(over_block(azimuth=1.5), blind=hidden)
    plan = plan_with(estimator, arm)
    assert plan.outcome is PlanOutcome.ALIGNED
    assert {ArcEnd.TARGET_LOST, ArcEnd.ANGLE} == set(plan.arcs[0].ends)
    assert tilt_of(arm) < (20 if estimator == QuarticFit() else 0.5)


@pytest.mark.parametrize(
    ("estimator", "frame"), [*((QuarticFit(), frame) for frame in (1, 20, 60)), (SilhouetteFit(), 20)]
)
def test_a_second_object_that_comes_into_view_changes_nothing(estimator, frame):
    def visited(arm):  # a ball of the same color comes and stays, 75 mm from the middle of the block
        if arm.frames == frame:
            arm.arm.shapes = (*arm.arm.shapes, Ball((0.075, -0.02, 0.0), radius=0.012))
        return False

    arm = Hindered(over_block(), blind=visited)
    plan = plan_with(estimator, arm)
    assert plan.outcome is PlanOutcome.ALIGNED
    shown = CAMERA.project(arm.camera_pose().inv().apply([0.0, 0.0, 0.01]))
    np.testing.assert_allclose(shown, CAMERA.principal_point, atol=12)
    areas = [view.blob.area for view in plan.views]
    assert max(areas) / min(areas) < 3
    # It may end an arc, where the two show as one, and so move a quartic.
    assert tilt_of(arm) < (20 if estimator == QuarticFit() else 0.7)


@both_estimators
def test_arcs_of_fewer_than_five_views_are_too_few_and_the_camera_stays(estimator):
    arm = over_block()
    plan = plan_with(estimator, arm, max_angle=np.radians(3), order="major first")
    found = [optimum.finding for optimum in plan.optima]
    assert [len(arc) for arc in plan.arcs] == [3, 3]
    # Our estimator takes both arcs together, which makes six views; the thesis's the last one alone.
    assert found == [Finding.TOO_FEW_VIEWS, Finding.TOO_FEW_VIEWS if estimator == QuarticFit() else Finding.OPTIMUM]
    assert plan.outcome is PlanOutcome.TOO_FEW_VIEWS
    if estimator == QuarticFit():
        assert tilt_of(arm) == pytest.approx(np.degrees(0.4), abs=3)
    check_trace(plan, arm)


def test_a_ratio_without_a_stationary_point_is_no_arrival():
    # One side alone of a steep view: there the ratio only falls.
    arm = Hindered(over_block(tilt=1.0, azimuth=0.0), blind=lambda arm: arm.camera_pose().translation[2] > 0.17)
    plan = plan_with(QuarticFit(), arm, order="major first", max_angle=np.radians(25))
    assert Finding.NO_STATIONARY_POINT in [optimum.finding for optimum in plan.optima]
    assert plan.outcome is PlanOutcome.NO_STATIONARY_POINT
    check_trace(plan, arm)


class Refusing(PinholeArm):
    """An arm one of whose members refuses to move from some call on."""

    def __init__(self, *shapes, member, after=0, reason=StopReason.COLLISION, **where):
        super().__init__(*shapes, **where)
        moves, self.left = getattr(self, member), after

        def refused(argument):
            self.left -= 1
            return Motion(False, reason) if self.left < 0 else moves(argument)

        setattr(self, member, refused)


@pytest.mark.parametrize(
    ("member", "after", "reason", "arcs"),
    [
        ("move_camera", 0, StopReason.JOINT_LIMIT, 0),
        ("move_camera", 2, StopReason.UNREACHABLE, 0),
        ("move_camera", 2, StopReason.CONTACT, 0),
        ("rotate_wrist", 0, StopReason.COLLISION, 0),
        ("move_joints", 0, StopReason.STALLED, 1),
    ],
    ids=["the first step", "the advance", "the advance, touching", "the wrist", "the return of the first arc"],
)
def test_an_arm_that_refuses_ends_the_plan_with_the_reason_and_the_trace_so_far(member, after, reason, arcs):
    arm = over_block(arm=Refusing, member=member, after=after, reason=reason)
    plan = plan_with(QuarticFit(), arm)
    assert plan.outcome is PlanOutcome(reason.value)
    assert len(plan.arcs) == arcs
    assert member == "move_joints" or plan.view is not None
    check_trace(plan, arm)


def test_an_arm_at_its_limits_begins_again_with_each_turn_of_the_wrist_that_it_was_given():
    class Narrow(PinholeArm):
        """Cannot move sideways until its wrist has turned by a quarter."""

        free = False

        def move_camera(self, camera_from_target):
            self.free |= camera_from_target.rotation.magnitude() > 1.5
            if np.any(camera_from_target.translation) and not self.free:
                return Motion(False, StopReason.JOINT_LIMIT)
            return super().move_camera(camera_from_target)

    for turns, outcome in (((), PlanOutcome.JOINT_LIMIT), ((0.3, np.pi / 2), PlanOutcome.ALIGNED)):
        plan = plan_with(SilhouetteFit(), over_block(arm=Narrow), turns=turns, max_angle=0.5)
        assert plan.outcome is outcome


def test_an_estimator_that_goes_to_poses_needs_no_return_to_joints():
    arm = over_block(arm=Refusing, member="move_joints")
    assert plan_with(SilhouetteFit(), arm).outcome is PlanOutcome.ALIGNED


def test_an_arm_stopped_for_good_within_an_arc_has_too_few_views_and_the_arc_says_why():
    arm = Hindered(over_block(), stops=dict.fromkeys(range(14, 400), StopReason.JOINT_LIMIT))
    plan = plan_with(QuarticFit(), arm)
    assert plan.outcome is PlanOutcome.TOO_FEW_VIEWS
    assert plan.arcs[-1].ends == (ArcEnd.JOINT_LIMIT, ArcEnd.JOINT_LIMIT)
    assert len(plan.arcs[-1]) == 1
    check_trace(plan, arm)


def test_an_arm_that_moves_without_centering_the_object_is_not_centered():
    class Lame(PinholeArm):
        def move_camera(self, camera_from_target):
            return super().move_camera(RigidTransform.from_translation(camera_from_target.translation))

    arm = over_block(arm=Lame)
    arm.stand_at(arm.camera_pose() * turn([0.1, 0.1, 0.0]))
    assert plan_with(QuarticFit(), arm).outcome is PlanOutcome.NOT_CENTERED


@pytest.mark.parametrize("rows", [slice(None), slice(0, 360), slice(200, 300)], ids=["all", "most", "a band"])
def test_a_mask_that_fills_the_picture_ends_the_plan_at_once_and_is_called_too_large(rows):
    def table(rgb):
        mask = np.zeros(rgb.shape[:2], bool)
        mask[rows] = True
        return mask

    plan = ImageMomentPlanner(table).plan(over_block())
    assert (plan.outcome, plan.arcs) == (PlanOutcome.TOO_LARGE, ())
    assert plan.frames < 30


@both_estimators
def test_a_plan_whose_views_are_all_clipped_is_not_called_aligned(estimator, plan_of):
    planner, arcs = ImageMomentPlanner(white, estimator), plan_of(estimator).arcs
    clipped = [replace(arc, views=tuple(replace(view, clipped=True) for view in arc.views)) for arc in arcs]
    assert planner.conclude(over_block(), clipped).outcome is PlanOutcome.TOO_LARGE


# Poses


class Capped(PinholeArm):
    """An arm that cannot look down within 8 deg of the vertical while it is closed: so not at a block's face."""

    closed, refused = True, 0

    def move_camera(self, camera_from_target):
        down = -(self.camera_pose() * camera_from_target).rotation.as_matrix()[2, 2]
        if self.closed and down > np.cos(np.radians(8)):
            self.refused += 1
            return Motion(False, StopReason.UNREACHABLE)
        return super().move_camera(camera_from_target)


def test_where_no_pose_can_be_reached_the_camera_ends_at_the_view_that_looks_most_alike():
    arm = over_block(arm=Capped)
    plan = plan_with(SilhouetteFit(), arm)
    assert arm.refused >= 2 * 7  # after either arc all six poses, the first of them from two places
    assert plan.outcome is PlanOutcome.UNREACHABLE
    assert len(plan.arcs) == 2
    assert plan.optima[-1].finding is Finding.OPTIMUM
    wanted = -plan.solid.normal
    assert wanted[2] < -np.cos(np.radians(0.5))
    best = max(view.line_of_sight @ wanted for view in plan.views)
    assert arm.camera_pose().rotation.as_matrix()[:, 2] @ wanted == pytest.approx(best, abs=1e-9)
    check_trace(plan, arm)


class Answering:
    """An estimator that answers the same, whatever was seen."""

    def __init__(self, answer):
        self.answer = answer

    def estimate(self, arcs, intrinsics):
        return self.answer


@pytest.mark.parametrize(("radius", "turned"), [(0.25, True), (0.5, False)])
def test_of_two_views_the_nearer_to_a_pose_is_so_by_the_planners_own_radius(radius, turned, plan_of):
    # One is 0.1 m from the pose, the other 0.3 rad: 0.075 m on a sphere of 0.25 m, and 0.15 m on one of 0.5 m.
    arm = over_block(arm=Refusing, member="move_camera", reason=StopReason.UNREACHABLE)
    pose = arm.camera_pose()
    first = plan_of(QuarticFit()).arcs[0]
    views = [
        replace(first.views[0], base_from_camera=p, joints=[*p.translation, *p.rotation.as_rotvec()])
        for p in (pose * RigidTransform.from_translation([0.1, 0, 0]), pose * turn([0, 0, 0.3]))
    ]
    went = []
    arm.move_joints = lambda q: went.append(q) or PinholeArm.move_joints(arm, q)
    planner = ImageMomentPlanner(white, Answering(Optimum(Finding.OPTIMUM, poses=(pose,))), radius=radius)
    assert planner.conclude(arm, [replace(first, views=tuple(views), center=0)]).outcome is PlanOutcome.UNREACHABLE
    np.testing.assert_array_equal(went[0], views[turned].joints)


def test_a_pose_is_centered_from_by_the_distance_that_its_estimator_tells(plan_of):
    # 5 mm aside at 0.1 m; by the planner's radius every correction would be three times too long.
    pose = RigidTransform.from_components([0.005, 0.0, 0.11], Rotation.from_rotvec([np.pi, 0, 0]))
    near = Optimum(Finding.OPTIMUM, poses=(pose,), distance=0.1)
    planner = ImageMomentPlanner(white, Answering(near), radius=0.3)
    assert planner.conclude(over_block(), plan_of(QuarticFit()).arcs).outcome is PlanOutcome.ALIGNED


def test_a_pose_out_of_reach_after_the_first_arc_ends_nothing():
    arm = over_block(arm=Capped)

    class Opening:
        """Our estimator, who finds the way free after the second arc."""

        def estimate(self, arcs, intrinsics):
            arm.closed = len(arcs) < 2
            return SilhouetteFit().estimate(arcs, intrinsics)

    plan = plan_with(Opening(), arm)
    assert arm.refused >= 7
    assert plan.outcome is PlanOutcome.ALIGNED
    assert tilt_of(arm) < 0.5


# Another estimator


def test_another_estimator_concludes_from_the_same_views_without_another_arc(plan_of):
    arm, plan = over_block(), plan_of(QuarticFit())
    arm.move_joints(plan.joints)
    rough = tilt_of(arm)
    concluded = ImageMomentPlanner(white, SilhouetteFit()).conclude(arm, plan.arcs)
    assert (concluded.outcome, concluded.arcs, len(concluded.optima)) == (PlanOutcome.ALIGNED, plan.arcs, 1)
    assert concluded.frames < 8 < plan.frames
    assert tilt_of(arm) < 0.3 < rough
    np.testing.assert_array_equal(concluded.view.joints, arm.joints)


@both_estimators
def test_the_same_estimator_concludes_as_its_own_plan_did(estimator, plan_of):
    arm, plan = over_block(), plan_of(estimator)
    arm.move_joints(plan.views[3].joints)
    concluded = ImageMomentPlanner(white, estimator).conclude(arm, plan.arcs)
    assert concluded.outcome is plan.outcome
    apart = plan.view.base_from_camera.inv() * arm.camera_pose()
    assert np.linalg.norm(apart.translation) < 0.003
    assert apart.rotation.magnitude() < np.radians(1)


class Broadest:
    """An estimator in ten lines: look from where the object shows the largest area."""

    def estimate(self, arcs, intrinsics):
        arc = arcs[-1]
        if len(arc) < 5:
            return Optimum.at(arc, arc.center, Finding.TOO_FEW_VIEWS)
        areas = [view.blob.area for view in arc.views]
        return Optimum.at(arc, int(np.argmax(areas)))


def test_a_third_estimator_plugs_in():
    # A flat plate shows most of itself face on.
    arm = over_block(Block((0.04, 0.08, 0.001)))
    plan = plan_with(Broadest(), arm)
    assert plan.outcome is PlanOutcome.ALIGNED
    assert tilt_of(arm) < 5


# What it asks of an arm


@both_estimators
def test_it_sees_an_arm_only_through_the_protocol_and_counts_every_picture(estimator, plan_of):
    # `Hindered` has the protocol's members and nothing else, so there is no other way to the arm behind it.
    arm = Hindered(over_block())
    assert isinstance(arm, EyeInHandArm)
    plan = plan_with(estimator, arm, keep_images=True)
    np.testing.assert_array_equal(plan.joints, plan_of(estimator).joints)
    assert plan.frames == arm.frames > len(plan.views)
    assert all(view.rgb.shape == (480, 640, 3) for view in plan.views)
    assert all(view.rgb is None for view in plan_of(estimator).views)  # unless asked for


# Misuse


def test_what_can_be_refused_is_refused_before_anything_moves(plan_of):
    arm, arcs = Hindered(over_block()), plan_of(QuarticFit()).arcs
    empty = replace(arcs[0], views=(), center=-1)
    with pytest.raises(InvalidParameterError, match="a segmenter is called with an RGB image"):
        ImageMomentPlanner("red").plan(arm)
    with pytest.raises(InvalidParameterError, match=r"an EyeInHandArm, such as cell\.arm; got a object"):
        ImageMomentPlanner(white).plan(object())
    for none in ([], [empty], [*arcs, empty]):
        with pytest.raises(InvalidParameterError, match="give the arcs of a plan, at least one, and each with views"):
            ImageMomentPlanner(white).conclude(arm, none)
    assert arm.frames == arm.motions == 0


@pytest.mark.parametrize(
    ("said", "text"),
    [
        (3, r"Answering\.estimate returned 3; .* Optimum\.at\(arcs\[-1\], index\) makes one"),
        (None, "returned None"),
        (Optimum(Finding.OPTIMUM), r"neither joints nor poses.*Optimum\.at\(arcs\[-1\], arcs\[-1\]\.center"),
    ],
)
def test_an_estimator_that_returns_no_optimum_is_told_what_makes_one(said, text, plan_of):
    planner = ImageMomentPlanner(white, Answering(said), max_angle=0.1)
    with pytest.raises(InvalidParameterError, match=text):
        planner.plan(over_block())
    with pytest.raises(InvalidParameterError, match=text):
        planner.conclude(over_block(), plan_of(QuarticFit()).arcs)
