"""The image-moment planner: where it ends, every way in which it can end, and what it asks of an arm."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from eye_in_hand import CAMERA, Ball, Hindered, PinholeArm, white
from scipy.spatial.transform import RigidTransform, Rotation
from synthetic import Block

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arc import ArcEnd
from gvp_lib.motion.arm import EyeInHandArm, Motion, StopReason
from gvp_lib.planning.image_moments import ImageMomentPlanner
from gvp_lib.planning.plan import Finding, Optimum, Plan, PlanOutcome
from gvp_lib.planning.quartic import QuarticFit
from gvp_lib.planning.silhouette import SilhouetteFit
from gvp_lib.planning.solids import CYLINDER

pytestmark = pytest.mark.check

REASONS = [StopReason.JOINT_LIMIT, StopReason.COLLISION, StopReason.UNREACHABLE]
ESTIMATORS = [QuarticFit(), SilhouetteFit()]
LYING = Rotation.from_rotvec([np.pi / 2, 0, 0])


def name(estimator):
    return type(estimator).__name__


def started(*shapes, arm=PinholeArm, radius=0.3, tilt=0.4, azimuth=2.0, **options):
    """A pinhole's arm as an episode may begin: 23 deg off the face's normal, 0.3 m away."""
    return arm(*(shapes or (Block(),)), radius=radius, tilt=tilt, azimuth=azimuth, **options)


def tilt_of(arm):
    """From the vertical, which is the block's normal, to the camera's line of sight, deg."""
    return np.degrees(np.arccos(-arm.camera_pose().rotation.as_matrix()[2, 2]))


def plan_with(estimator, arm, **options):
    return ImageMomentPlanner(white, estimator, **options).plan(arm)


@cache
def own_plan(estimator):
    """The plan of an arm as it began, made once."""
    return plan_with(estimator, started())


def check_trace(plan: Plan, arm) -> None:
    """What holds of every plan, however it ended."""
    assert len(plan.arcs) == len(plan.optima)
    assert plan.views == tuple(view for arc in plan.arcs for view in arc.views)
    if plan.view is not None:
        np.testing.assert_allclose(plan.view.joints, arm.joints, atol=1e-9)
        assert plan.joints is plan.view.joints


# Where it ends


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=name)
@pytest.mark.parametrize("order", ["minor first", "major first"])
def test_x_ends_on_the_minor_axis_and_y_on_the_major_one_in_either_order(estimator, order):
    arm = started()
    plan = plan_with(estimator, arm, order=order)
    assert plan.outcome is PlanOutcome.ALIGNED
    assert plan.outcome.arrived
    assert [arc.axis for arc in plan.arcs] == (["y", "x"] if order == "minor first" else ["x", "y"])
    x, y, _ = arm.camera_pose().rotation.as_matrix().T
    assert abs(y[1]) > np.cos(np.radians(12))
    assert np.degrees(np.arctan2(abs(y[0]), abs(y[1]))) < 2  # roll
    assert abs(x[0]) > np.cos(np.radians(12))
    assert tilt_of(arm) < (12 if estimator == QuarticFit() else 0.3)
    assert np.linalg.norm(arm.camera_pose().translation) == pytest.approx(0.25, rel=0.05)
    np.testing.assert_allclose(plan.view.blob.centroid, CAMERA.principal_point, atol=2)
    check_trace(plan, arm)


def test_our_estimator_ends_at_the_face_wherever_it_began():
    for azimuth in (0, 2, 5):
        arm = started(azimuth=azimuth, tilt=0.5)
        plan_with(SilhouetteFit(), arm, max_angle=np.radians(45))
        assert tilt_of(arm) < 0.5


def test_the_thesiss_estimator_takes_the_edge_for_the_face_where_the_arc_began_over_it():
    # Turning about its length, a bar of 32 x 20 mm shows most of itself from atan(20 / 32) = 32 deg, and less on either
    # side: the middle stationary point of an arc about 29 deg is the edge's. The plan is sure of it.
    arm = started(azimuth=0.0, tilt=0.5)
    plan = plan_with(QuarticFit(), arm)
    assert plan.outcome is PlanOutcome.ALIGNED
    assert len(plan.optima[1].detail.stationary) > 1
    assert tilt_of(arm) > 25


# Stopping when certain


def test_until_certain_says_enough_in_the_second_arc_where_it_is_certain():
    arm = started()
    plan = plan_with(SilhouetteFit(), arm, until=np.radians(1.5))
    assert plan.outcome is PlanOutcome.ALIGNED
    assert ArcEnd.ENOUGH in plan.arcs[1].ends
    assert np.abs(plan.arcs[0].angles).max() < np.radians(26)  # a short first arc
    assert plan.optima[-1].uncertainty < np.radians(1.5)
    assert len(plan.views) <= 0.5 * len(own_plan(SilhouetteFit()).views)
    assert tilt_of(arm) < 1


def test_where_doubt_remains_the_first_arc_is_traversed_again_in_full():
    plan = plan_with(SilhouetteFit(), started(), until=np.radians(0.01), max_angle=np.radians(45), step=0.04)
    assert [arc.axis for arc in plan.arcs] == ["y", "x", "y"]
    spans = [np.ptp(arc.angles) for arc in plan.arcs]
    assert spans[0] < 0.6 * spans[2]
    assert plan.outcome is PlanOutcome.ALIGNED


# How else it can end


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=name)
def test_an_object_out_of_view_at_the_start_is_not_found_and_nothing_moves(estimator):
    arm = Hindered(PinholeArm(Ball((5.0, 0.0, 0.0))))
    before = arm.joints
    plan = plan_with(estimator, arm)
    assert plan.outcome is PlanOutcome.TARGET_NOT_FOUND
    assert (plan.arcs, plan.optima, plan.view, plan.joints, plan.frames) == ((), (), None, None, 1)
    assert arm.motions == 0
    np.testing.assert_array_equal(arm.joints, before)


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=name)
@pytest.mark.parametrize(("frames", "arcs"), [(3, 0), (30, 1), (105, 2)], ids=["approach", "first arc", "second arc"])
def test_an_object_gone_for_good_ends_the_plan_as_lost_and_the_trace_is_kept(estimator, frames, arcs):
    arm = Hindered(started(), blind=lambda arm: arm.frames > frames)
    plan = plan_with(estimator, arm)
    assert plan.outcome is PlanOutcome.TARGET_LOST
    assert not plan.outcome.arrived
    assert plan.view is None
    assert len(plan.arcs) == arcs
    assert all(len(arc) > 5 for arc in plan.arcs)
    assert plan.frames == arm.frames
    check_trace(plan, arm)


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=name)
def test_an_object_lost_on_one_side_of_an_arc_is_aligned_with_all_the_same(estimator):
    # Hidden from beyond 35 deg on one side of the first arc, as behind a wall.
    def hidden(arm):
        looked = arm.camera_pose().rotation.as_matrix()[:, 2]
        return looked @ [0.0, 1.0, 0.0] > np.sin(np.radians(35))

    arm = Hindered(started(azimuth=1.5), blind=hidden)
    plan = plan_with(estimator, arm)
    assert plan.outcome is PlanOutcome.ALIGNED
    assert ArcEnd.TARGET_LOST in plan.arcs[0].ends
    assert ArcEnd.ANGLE in plan.arcs[0].ends
    assert tilt_of(arm) < (20 if estimator == QuarticFit() else 0.5)


@pytest.mark.parametrize(
    ("estimator", "frame"),
    [*((QuarticFit(), frame) for frame in (1, 20, 60)), (SilhouetteFit(), 20)],
    ids=lambda value: value if isinstance(value, int) else name(value),
)
def test_a_second_object_that_comes_into_view_changes_nothing(estimator, frame):
    class Visited(PinholeArm):
        """A ball of the same color comes and stays, 75 mm from the middle of the block."""

        frames = 0

        def capture(self):
            self.frames += 1
            if self.frames == frame:
                self.shapes = (*self.shapes, Ball((0.075, -0.02, 0.0), radius=0.012))
            return super().capture()

    arm = started(arm=Visited)
    plan = plan_with(estimator, arm)
    assert plan.outcome is PlanOutcome.ALIGNED
    shown = CAMERA.project(arm.camera_pose().inv().apply([0.0, 0.0, 0.01]))
    np.testing.assert_allclose(shown, CAMERA.principal_point, atol=12)
    areas = [view.blob.area for view in plan.views]
    assert max(areas) / min(areas) < 3
    # It may end an arc, where the two show as one, and so move a quartic.
    assert tilt_of(arm) < (20 if estimator == QuarticFit() else 0.7)


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=name)
def test_arcs_of_fewer_than_five_views_are_too_few_and_the_camera_stays(estimator):
    arm = started()
    plan = plan_with(estimator, arm, max_angle=np.radians(3), order="major first")
    found = [optimum.finding for optimum in plan.optima]
    assert [len(arc) for arc in plan.arcs] == [3, 3]
    # Our estimator takes both arcs together, which makes six views; the thesis's the last one alone.
    assert found == [Finding.TOO_FEW_VIEWS, Finding.TOO_FEW_VIEWS if estimator == QuarticFit() else Finding.OPTIMUM]
    assert plan.outcome is PlanOutcome.TOO_FEW_VIEWS
    assert not plan.outcome.arrived
    if estimator == QuarticFit():
        assert tilt_of(arm) == pytest.approx(np.degrees(0.4), abs=3)


def test_of_a_lying_can_any_angle_about_its_own_axis_is_right():
    can = Block((0.06, 0.06, 0.12), CYLINDER, LYING)
    plan = plan_with(QuarticFit(), started(can, radius=0.35), radius=0.3)
    assert plan.outcome is PlanOutcome.ANY_ANGLE
    assert plan.outcome.arrived
    assert [optimum.finding for optimum in plan.optima] == [Finding.OPTIMUM, Finding.FEATURELESS]
    assert plan.arcs[1].axis == "x"  # along x with y on its axis: about that axis
    np.testing.assert_array_equal(plan.optima[1].joints, plan.arcs[1].views[plan.arcs[1].center].joints)


def test_a_ratio_without_a_stationary_point_is_no_arrival():
    # One side alone of a steep view: there the ratio only falls.
    arm = Hindered(started(tilt=1.0, azimuth=0.0), blind=lambda arm: arm.camera_pose().translation[2] > 0.17)
    plan = plan_with(QuarticFit(), arm, order="major first", max_angle=np.radians(25))
    assert Finding.NO_STATIONARY_POINT in [optimum.finding for optimum in plan.optima]
    assert plan.outcome is PlanOutcome.NO_STATIONARY_POINT
    assert not plan.outcome.arrived


class Refusing(PinholeArm):
    """An arm one of whose members refuses to move from some call on."""

    def __init__(self, *shapes, member, after, reason, **where):
        self.member, self.left, self.reason = member, np.inf, reason
        super().__init__(*shapes, **where)
        self.left = after

    def refuses(self, member):
        if member != self.member:
            return False
        self.left -= 1
        return self.left < 0

    def move_camera(self, camera_from_target):
        stopped = self.refuses("move_camera")
        return Motion(False, self.reason) if stopped else super().move_camera(camera_from_target)

    def move_joints(self, q):
        return Motion(False, self.reason) if self.refuses("move_joints") else super().move_joints(q)

    def rotate_wrist(self, angle):
        return Motion(False, self.reason) if self.refuses("rotate_wrist") else super().rotate_wrist(angle)


@pytest.mark.parametrize("reason", REASONS)
@pytest.mark.parametrize(
    ("member", "after", "arcs"),
    [("move_camera", 0, 0), ("move_camera", 2, 0), ("rotate_wrist", 0, 0), ("move_joints", 0, 1)],
    ids=["the first step", "the advance", "the wrist", "the return of the first arc"],
)
def test_an_arm_that_refuses_ends_the_plan_with_the_reason_and_the_trace_so_far(reason, member, after, arcs):
    arm = started(arm=Refusing, member=member, after=after, reason=reason)
    plan = plan_with(QuarticFit(), arm)
    assert plan.outcome is PlanOutcome(reason.value)
    assert not plan.outcome.arrived
    assert len(plan.arcs) == arcs
    assert member == "move_joints" or plan.view is not None
    check_trace(plan, arm)


def test_an_estimator_that_goes_to_poses_needs_no_return_to_joints():
    arm = started(arm=Refusing, member="move_joints", after=0, reason=StopReason.COLLISION)
    assert plan_with(SilhouetteFit(), arm).outcome is PlanOutcome.ALIGNED


@pytest.mark.parametrize("reason", REASONS)
def test_an_arm_stopped_for_good_within_an_arc_has_too_few_views_and_the_arc_says_why(reason):
    arm = Hindered(started(), stops=dict.fromkeys(range(14, 400), reason))
    plan = plan_with(QuarticFit(), arm)
    assert plan.outcome is PlanOutcome.TOO_FEW_VIEWS
    assert plan.arcs[-1].ends == (ArcEnd(reason.value), ArcEnd(reason.value))
    assert len(plan.arcs[-1]) == 1
    check_trace(plan, arm)


class Capped(PinholeArm):
    """An arm that cannot look down within 8 deg of the vertical while it is closed: so not at a block's face."""

    def __init__(self, *shapes, reason, **where):
        self.reason, self.closed, self.refused = reason, True, 0
        super().__init__(*shapes, **where)

    def move_camera(self, camera_from_target):
        down = -(self.camera_pose() * camera_from_target).rotation.as_matrix()[2, 2]
        if self.closed and down > np.cos(np.radians(8)):
            self.refused += 1
            return Motion(False, self.reason)
        return super().move_camera(camera_from_target)


def test_where_no_pose_can_be_reached_the_camera_ends_at_the_view_that_looks_most_alike():
    arm = started(arm=Capped, reason=StopReason.UNREACHABLE)
    plan = plan_with(SilhouetteFit(), arm)
    assert arm.refused >= 2 * 7  # after either arc all six poses, the first of them from two places
    assert plan.outcome is PlanOutcome.UNREACHABLE
    assert len(plan.arcs) == 2
    assert plan.optima[-1].finding is Finding.OPTIMUM
    wanted = -plan.optima[-1].detail.normal
    assert wanted[2] < -np.cos(np.radians(0.5))
    looked = [view.base_from_camera.rotation.as_matrix()[:, 2] @ wanted for view in plan.views]
    assert arm.camera_pose().rotation.as_matrix()[:, 2] @ wanted == pytest.approx(max(looked), abs=1e-9)
    check_trace(plan, arm)


class Pointing:
    """An estimator that would look from a pose, whatever was seen."""

    def __init__(self, pose, distance=np.nan):
        self.optimum = Optimum(Finding.OPTIMUM, poses=(pose,), distance=distance)

    def estimate(self, arcs, intrinsics):
        return self.optimum


@pytest.mark.parametrize(("radius", "turned"), [(0.25, True), (0.5, False)])
def test_of_two_views_the_nearer_to_a_pose_is_so_by_the_planners_own_radius(radius, turned):
    # One is 0.1 m from the pose, the other 0.3 rad: 0.075 m on a sphere of 0.25 m, and 0.15 m on one of 0.5 m.
    arm = started(arm=Refusing, member="move_camera", after=0, reason=StopReason.UNREACHABLE)
    pose = arm.camera_pose()
    first, *_ = own_plan(QuarticFit()).arcs
    away = pose * RigidTransform.from_translation([0.1, 0, 0])
    aside = pose * RigidTransform.from_rotation(Rotation.from_rotvec([0, 0, 0.3]))
    views = [
        replace(first.views[0], base_from_camera=p, joints=[*p.translation, *p.rotation.as_rotvec()])
        for p in (away, aside)
    ]
    went = []
    arm.move_joints = lambda q: went.append(q) or PinholeArm.move_joints(arm, q)
    planner = ImageMomentPlanner(white, Pointing(pose), radius=radius)
    assert planner.conclude(arm, [replace(first, views=tuple(views), center=0)]).outcome is PlanOutcome.UNREACHABLE
    np.testing.assert_array_equal(went[0], views[turned].joints)


def test_a_pose_is_centered_from_by_the_distance_that_its_estimator_tells():
    # 5 mm aside at 0.1 m; by the planner's radius every correction would be three times too long.
    arm = started()
    pose = RigidTransform.from_components([0.005, 0.0, 0.11], Rotation.from_rotvec([np.pi, 0, 0]))
    planner = ImageMomentPlanner(white, Pointing(pose, 0.1), radius=0.3)
    assert planner.conclude(arm, own_plan(QuarticFit()).arcs).outcome is PlanOutcome.ALIGNED
    assert ImageMomentPlanner(white, SilhouetteFit(radius=0.12)).plan(started()).optima[-1].distance == 0.12


def test_a_pose_out_of_reach_after_the_first_arc_ends_nothing():
    arm = started(arm=Capped, reason=StopReason.UNREACHABLE)

    class Opening:
        """Our estimator, who finds the way free after the second arc."""

        def estimate(self, arcs, intrinsics):
            arm.closed = len(arcs) < 2
            return SilhouetteFit().estimate(arcs, intrinsics)

    plan = plan_with(Opening(), arm)
    assert arm.refused >= 7
    assert plan.outcome is PlanOutcome.ALIGNED
    assert tilt_of(arm) < 0.5


def test_an_arm_that_moves_without_centering_the_object_is_not_centered():
    class Lame(PinholeArm):
        def move_camera(self, camera_from_target):
            return super().move_camera(RigidTransform.from_translation(camera_from_target.translation))

    arm = started(arm=Lame)
    arm.stand_at(arm.camera_pose() * RigidTransform.from_rotation(Rotation.from_rotvec([0.1, 0.1, 0.0])))
    assert plan_with(QuarticFit(), arm).outcome is PlanOutcome.NOT_CENTERED


# Another estimator


def test_another_estimator_concludes_from_the_same_views_without_another_arc():
    arm, plan = started(), own_plan(QuarticFit())
    arm.move_joints(plan.joints)
    rough = tilt_of(arm)
    concluded = ImageMomentPlanner(white, SilhouetteFit()).conclude(arm, plan.arcs)
    assert concluded.arcs == plan.arcs
    assert len(concluded.optima) == 1
    assert concluded.frames < 8 < plan.frames
    assert concluded.outcome is PlanOutcome.ALIGNED
    assert tilt_of(arm) < 0.3 < rough
    np.testing.assert_array_equal(concluded.view.joints, arm.joints)


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=name)
def test_the_same_estimator_concludes_as_its_own_plan_did(estimator):
    arm, plan = started(), own_plan(estimator)
    arm.move_joints(plan.views[3].joints)
    concluded = ImageMomentPlanner(white, estimator).conclude(arm, plan.arcs)
    assert concluded.outcome is plan.outcome
    apart = plan.view.base_from_camera.inv() * arm.camera_pose()
    assert np.linalg.norm(apart.translation) < 0.003
    assert apart.rotation.magnitude() < np.radians(1)


def test_nothing_is_concluded_from_no_views():
    plan = own_plan(QuarticFit())
    empty = replace(plan.arcs[0], views=(), center=-1)
    for arcs in ([], [empty], [*plan.arcs, empty]):
        with pytest.raises(InvalidParameterError, match="give the arcs of a plan, at least one, and each with views"):
            ImageMomentPlanner(white).conclude(started(), arcs)


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
    arm = started(Block((0.04, 0.08, 0.001)))
    plan = plan_with(Broadest(), arm)
    assert plan.outcome is PlanOutcome.ALIGNED
    assert tilt_of(arm) < 5


# What it asks of an arm


def only_the_protocol(arm):
    """The members of the protocol, and no other way to the arm behind them."""

    class Bare:
        @property
        def intrinsics(self):
            return arm.intrinsics

        @property
        def joints(self):
            return arm.joints

        def capture(self):
            return arm.capture()

        def camera_pose(self):
            return arm.camera_pose()

        def move_camera(self, camera_from_target):
            return arm.move_camera(camera_from_target)

        def move_joints(self, q):
            return arm.move_joints(q)

        def rotate_wrist(self, angle):
            return arm.rotate_wrist(angle)

    return Bare()


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=name)
def test_it_sees_an_arm_only_through_the_protocol(estimator):
    poses = []
    for wrap in (only_the_protocol, lambda arm: arm):
        arm = started()
        plan = plan_with(estimator, wrap(arm), max_angle=0.5)
        assert plan.outcome is PlanOutcome.ALIGNED
        poses.append(arm.camera_pose().as_matrix())
    public = {member for member in dir(only_the_protocol(None).__class__) if not member.startswith("_")}
    assert public == {member for member in dir(EyeInHandArm) if not member.startswith("_")}
    np.testing.assert_array_equal(*poses)


def test_every_picture_is_counted_and_kept_only_if_asked_for():
    arm = Hindered(started())
    plan = plan_with(QuarticFit(), arm, keep_images=True)
    assert plan.frames == arm.frames > len(plan.views)
    assert all(view.rgb is not None and view.rgb.shape == (480, 640, 3) for view in plan.views)
    assert all(view.rgb is None for view in own_plan(QuarticFit()).views)


def test_a_smaller_step_sees_more_and_a_longer_arc_too():
    usual = len(own_plan(QuarticFit()).views)
    finer, shorter = (len(plan_with(QuarticFit(), started(), **o).views) for o in ({"step": 0.01}, {"max_angle": 0.5}))
    assert finer > 1.8 * usual
    assert shorter < 0.6 * usual


# Misuse


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (
            {"estimator": 0.5},
            r"an estimator has a method estimate\(arcs, intrinsics\), as QuarticFit\(\) and .*got 0\.5",
        ),
        ({"order": "minor"}, 'order is "minor first" or "major first"; got \'minor\''),
        ({"radius": 0.0}, r"ImageMomentPlanner\.radius is positive and finite; got 0\.0"),
        ({"step": -0.02}, r"ImageMomentPlanner\.step is positive and finite; got -0\.02"),
        ({"threshold": np.nan}, r"ImageMomentPlanner\.threshold is positive and finite; got nan"),
        ({"until": 0.0}, r"ImageMomentPlanner\.until is positive and finite; got 0\.0"),
        ({"max_angle": np.inf}, r"ImageMomentPlanner\.max_angle is positive and finite; got inf"),
        ({"max_angle": 60}, r"max_angle is in radians, at most pi; got 60\. For degrees: np\.radians"),
    ],
)
def test_settings_that_make_no_sense_are_refused(options, text):
    with pytest.raises(InvalidParameterError, match=text):
        ImageMomentPlanner(white, **options)


def test_a_segmenter_that_is_none_is_refused_before_anything_moves():
    arm = Hindered(started())
    with pytest.raises(InvalidParameterError, match="a segmenter is called with an RGB image"):
        ImageMomentPlanner("red").plan(arm)
    assert arm.frames == arm.motions == 0


def test_what_is_no_arm_and_a_class_in_place_of_an_estimator_are_told_apart():
    with pytest.raises(InvalidParameterError, match=r"an EyeInHandArm, such as cell\.arm; got a object"):
        ImageMomentPlanner(white).plan(object())
    with pytest.raises(InvalidParameterError, match="an estimator has a method"):
        ImageMomentPlanner(white, QuarticFit)


# What no plan can be made of


@pytest.mark.parametrize("rows", [slice(None), slice(0, 360), slice(200, 300)], ids=["all", "most", "a band"])
def test_a_mask_that_fills_the_picture_ends_the_plan_at_once_and_is_called_too_large(rows):
    def table(rgb):
        mask = np.zeros(rgb.shape[:2], bool)
        mask[rows] = True
        return mask

    arm = started()
    plan = ImageMomentPlanner(table).plan(arm)
    assert plan.outcome is PlanOutcome.TOO_LARGE
    assert not plan.outcome.arrived
    assert plan.arcs == ()
    assert plan.frames < 30


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=name)
def test_a_plan_whose_views_are_all_clipped_is_not_called_aligned(estimator):
    arm, planner, arcs = started(), ImageMomentPlanner(white, estimator), own_plan(estimator).arcs
    clipped = [replace(arc, views=tuple(replace(view, clipped=True) for view in arc.views)) for arc in arcs]
    assert planner.conclude(arm, arcs).outcome is PlanOutcome.ALIGNED
    assert planner.conclude(arm, clipped).outcome is PlanOutcome.TOO_LARGE


@pytest.mark.parametrize(
    ("said", "text"),
    [
        (3, r"Answers\.estimate returned 3; .* Optimum\.at\(arcs\[-1\], index\) makes one"),
        (None, "returned None"),
        (Optimum(Finding.OPTIMUM), r"neither joints nor poses.*Optimum\.at\(arcs\[-1\], arcs\[-1\]\.center"),
    ],
)
def test_an_estimator_that_returns_no_optimum_is_told_what_makes_one(said, text):
    class Answers:
        def estimate(self, arcs, intrinsics):
            return said

    arm = started()
    with pytest.raises(InvalidParameterError, match=text):
        ImageMomentPlanner(white, Answers(), max_angle=0.1).plan(arm)
    arcs = ImageMomentPlanner(white, max_angle=0.1).plan(started()).arcs
    with pytest.raises(InvalidParameterError, match=text):
        ImageMomentPlanner(white, Answers()).conclude(arm, arcs)
