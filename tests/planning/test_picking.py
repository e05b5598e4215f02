"""From a first look to an object in the hand: fallbacks in order, one call that plans and grasps, and what no solid
explains."""

import re
from dataclasses import replace

import numpy as np
import pytest
from eye_in_hand import PinholeArm, Plate, white
from hands import HAND, PlainGripper, above, fitted
from scipy.spatial.transform import RigidTransform
from synthetic import Block, over_block

from gvp_lib.errors import GvpError, InvalidParameterError
from gvp_lib.evaluation.episodes import begin
from gvp_lib.motion.arm import Motion, Outcome
from gvp_lib.perception.segmentation import HsvThreshold
from gvp_lib.planning.grasp import Grasp, GraspExecutor
from gvp_lib.planning.image_moments import ImageMomentPlanner
from gvp_lib.planning.learned import CnnPlanner
from gvp_lib.planning.picking import LookDown, PickUp, RobustPlanner, pick_up
from gvp_lib.planning.plan import Action, Optimum, Plan
from gvp_lib.planning.silhouette import SilhouetteFit
from gvp_lib.planning.spread import SpreadViews
from gvp_lib.simulation.objects import ObjectSpec
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.workcell import WorkCell
from gvp_lib.views.figures import COLORS

check = pytest.mark.check

# The fallbacks


class Watched(PinholeArm):
    """An arm that counts its pictures, and those that it had taken when it was sent back to where it began.

    It refuses to move its camera where ``bars(arm, target)`` says so.
    """

    bars = staticmethod(lambda arm, target: False)

    def __init__(self, *shapes, **where):
        super().__init__(*shapes, **where)
        self.began, self.frames, self.restarts = self.joints, 0, []

    def capture(self):
        self.frames += 1
        return super().capture()

    def move_joints(self, q):
        if np.array_equal(q, self.began):
            self.restarts.append(self.frames)
        return super().move_joints(q)

    def move_camera(self, camera_from_target):
        if self.bars(self, camera_from_target):
            return Motion(False, Outcome.JOINT_LIMIT)
        return super().move_camera(camera_from_target)


class Ending:
    """A planner that looks once, and ends as it was told."""

    def __init__(self, outcome):
        self.outcome = outcome

    def plan(self, arm):
        arm.capture()
        arm.move_camera(RigidTransform.from_translation([0.0, 0.0, 0.02]))
        return Plan(self.outcome, frames=1)


@check
@pytest.mark.parametrize(
    ("outcomes", "attempts"),
    [
        (("aligned", "stalled"), ()),
        (("unexplained", "stalled"), ()),
        (("collision", "any angle", "stalled"), ("collision",)),
        (("joint limit", "target lost", "stalled"), ("joint limit", "target lost")),
        (("target not found", "aligned"), ()),
    ],
)
def test_the_first_planner_that_arrives_ends_it_and_each_begins_where_the_arm_began(outcomes, attempts):
    arm = over_block(arm=Watched)
    plan = RobustPlanner(white, tuple(Ending(Outcome(outcome)) for outcome in outcomes)).plan(arm)
    assert (plan.outcome, plan.attempts) == (outcomes[len(attempts)], attempts)
    assert len(arm.restarts) == len(attempts)
    assert plan.frames == arm.frames == len(attempts) + 1
    assert ("after" in repr(plan)) is bool(attempts)


@check
def test_where_views_from_all_around_lead_nowhere_it_looks_straight_down_along_the_major_axis():
    arm = over_block(arm=Watched)
    arm.bars = lambda arm, target: arm.frames < 4 and target.rotation.magnitude() > 0.1  # it cannot go around
    plan = RobustPlanner(white).plan(arm)
    assert (plan.outcome, plan.attempts) == (Outcome.ALIGNED, (Outcome.TOO_FEW_VIEWS,))
    assert plan.frames == arm.frames
    _, y, z = arm.camera_pose().rotation.as_matrix().T
    assert z[2] < -np.cos(np.radians(1.5))
    assert abs(y[1]) > np.cos(np.radians(1))


@check
@pytest.mark.parametrize("until", [1, 2])
def test_an_arm_at_its_limits_before_it_has_seen_anything_turns_its_wrist_by_a_quarter_and_then_the_other_way(until):
    class Limited(Watched):
        quarters = ()

        def bars(self, arm, target):
            turn = target.rotation.as_rotvec()
            if np.linalg.norm(turn) > 1.5 and not target.translation.any():
                self.quarters += (turn[2],)
                np.testing.assert_allclose(self.joints, self.began, atol=1e-9)
            return len(self.quarters) < until

    arm = over_block(arm=Limited)
    assert ImageMomentPlanner(white).plan(arm).outcome is Outcome.JOINT_LIMIT  # the thesis's gives up
    for planner in (SpreadViews(white), ImageMomentPlanner(white, step=0.04, wrist_retries=(np.pi / 2, -np.pi / 2))):
        arm = over_block(arm=Limited)
        plan = planner.plan(arm)
        assert plan.outcome is not Outcome.JOINT_LIMIT
        assert len(plan.views) >= 5
        np.testing.assert_allclose(arm.quarters, [np.pi / 2, -np.pi / 2][:until])
        assert plan.frames == arm.frames


@check
@pytest.mark.parametrize(
    ("mask", "outcome", "attempts"),
    [(False, Outcome.TARGET_NOT_FOUND, ()), (True, Outcome.TOO_LARGE, (Outcome.TOO_LARGE,))],
)
def test_a_mask_of_nothing_ends_a_plan_at_once_and_one_of_all_in_no_way_that_arrives(mask, outcome, attempts):
    plan = RobustPlanner(lambda rgb: np.full(rgb.shape[:2], mask)).plan(over_block())
    assert (plan.outcome, plan.attempts) == (outcome, attempts)
    assert np.isnan(plan.uncertainty)


# One call


class Given:
    """A planner and an executor of somebody's own, which do nothing and note what they were given."""

    def __init__(self, plan, grasp):
        self.answers, self.saw = (plan, grasp), []

    def plan(self, arm):
        self.saw.append(arm)
        return self.answers[0]

    def grasp(self, arm, gripper, plan=None):
        self.saw += [arm, gripper, plan]
        return self.answers[1]


def ended(outcome):
    return Grasp(outcome, (), None, 0.03, False, None, 20)


class Other:
    """A planner and an executor of other signatures."""

    def plan(self):
        raise AssertionError

    def grasp(self, arm):
        raise AssertionError


KNOWN = Plan(Outcome.ALIGNED, optima=(Optimum(Outcome.ALIGNED, uncertainty=np.radians(0.61)),), frames=80)
DOWN = Plan(Outcome.ALIGNED, frames=90, attempts=(Outcome.UNREACHABLE, Outcome.TARGET_LOST))


@check
@pytest.mark.parametrize(
    ("plan", "grasp", "said"),
    [
        (KNOWN, Outcome.HELD, "picked up: view within 0.61 deg (1 sd), 100 pictures, "),
        (KNOWN, Outcome.EMPTY, "not picked up (closed on nothing): view within 0.61 deg (1 sd), 100 pictures, "),
        (replace(KNOWN, outcome=Outcome.JOINT_LIMIT), Outcome.SLIPPED, "not picked up (slipped): view joint limit, "),
        (Plan(Outcome.UNEXPLAINED), Outcome.HELD, "picked up: view unexplained, 20 pictures, "),
        (DOWN, Outcome.HELD, "picked up: view aligned, 110 pictures, "),
    ],
)
def test_anybodys_planner_and_executor_are_called_in_turn_and_the_result_is_true_where_something_is_held(
    plan, grasp, said
):
    arm = over_block()
    gripper, parts = PlainGripper(arm), Given(plan, ended(grasp))
    result = pick_up(arm, gripper, white, planner=parts, executor=parts)
    assert parts.saw == [arm, arm, gripper, plan]
    assert (result.plan, result.grasp, result.outcome) == (plan, parts.answers[1], grasp)
    assert bool(result) is (grasp is Outcome.HELD)
    assert str(result).startswith(said)
    assert str(result).endswith(" s")
    assert "\n" not in str(result)
    assert repr(result) == f"PickUp({result})"


class InTurn(Given):
    """A planner and an executor whose grasps end one after the other, with the fingers shut and the hand elsewhere."""

    def grasp(self, arm, gripper, plan=None):
        arm.move_camera(RigidTransform.from_translation([0.02, 0, 0.05]))
        gripper.close()
        return ended(self.answers[1].pop(0))


@check
@pytest.mark.parametrize(
    ("outcomes", "attempts", "took"),
    [
        ([Outcome.EMPTY, Outcome.SLIPPED, Outcome.HELD], 3, 3),
        ([Outcome.EMPTY, Outcome.HELD], 5, 2),
        ([Outcome.HELD], 5, 1),
        ([Outcome.NEVER_CLOSED, Outcome.TOO_WIDE], 2, 2),
    ],
)
def test_a_hand_that_holds_nothing_opens_goes_up_and_back_and_plans_anew(outcomes, attempts, took):
    arm = over_block(arm=Watched)
    start, gripper, began = arm.joints.copy(), PlainGripper(arm), []

    class Planner(Given):
        def plan(self, arm):
            began.append((arm.joints.copy(), gripper.told[-1:]))
            return self.answers[0]

    result = pick_up(
        arm, gripper, white, planner=Planner(KNOWN, None), executor=InTurn(KNOWN, [*outcomes]), attempts=attempts
    )
    assert (result.outcome, result.attempts) == (outcomes[took - 1], tuple(outcomes[: took - 1]))
    assert len(began) == took
    for joints, told in began:
        np.testing.assert_allclose(joints, start, atol=1e-9)
        assert told in ([], ["open"])
    assert (f" at attempt {took}: " in str(result)) is (took > 1)


@check
def test_after_a_grip_that_held_nothing_the_default_planner_comes_with_another():
    arm, given = over_block(), []

    class Noting(InTurn):
        def grasp(self, arm, gripper, plan=None):
            given.append(plan)
            down = RigidTransform.from_translation([0.0, 0.0, plan.optima[-1].distance - HAND.tips])
            return replace(super().grasp(arm, gripper, plan), closed_at=plan.view.base_from_camera * down)

    executor = Noting(KNOWN, [Outcome.EMPTY, Outcome.HELD])
    assert pick_up(arm, PlainGripper(arm), white, executor=executor, attempts=2)
    first, second = given
    assert not first.grips
    closing = first.view.base_from_camera.rotation.as_matrix()[:, 0]
    assert abs(closing @ second.grips[0].closing) < np.cos(np.radians(20))


@check
def test_where_there_is_no_way_back_the_last_attempt_stands():
    class Stuck(Watched):
        def move_joints(self, q):
            return Motion(False, Outcome.STALLED)

    arm = over_block(arm=Stuck)
    result = pick_up(
        arm,
        PlainGripper(arm),
        white,
        planner=Given(KNOWN, None),
        executor=InTurn(KNOWN, [Outcome.EMPTY, Outcome.HELD]),
        attempts=2,
    )
    assert (result.outcome, result.attempts) == (Outcome.EMPTY, ())


@check
@pytest.mark.parametrize("stops", [1, 4])
def test_a_hand_that_presses_on_something_has_let_go_of_it_before_it_goes_back(stops):
    class Pressing(Watched):
        def move_joints(self, q):
            self.left = getattr(self, "left", stops) - 1
            return Motion(False, Outcome.CONTACT) if self.left >= 0 else super().move_joints(q)

        def move_camera(self, camera_from_target):
            self.up = getattr(self, "up", stops) - 1
            return Motion(False, Outcome.CONTACT) if self.up >= 0 else super().move_camera(camera_from_target)

    arm, began = over_block(arm=Pressing), []
    height = arm.camera_pose().translation[2]

    class Planner(Given):
        def plan(self, arm):
            began.append(arm.camera_pose().translation[2] - height)
            return self.answers[0]

    executor = InTurn(KNOWN, [Outcome.EMPTY, Outcome.HELD])
    result = pick_up(arm, PlainGripper(arm), white, planner=Planner(KNOWN, None), executor=executor, attempts=2)
    assert (result.outcome, result.attempts) == (Outcome.HELD, (Outcome.EMPTY,))
    assert arm.up < 0  # it went up before it went back
    np.testing.assert_allclose(began, [0.0, 0.0], atol=1e-9)


@check
def test_by_default_the_plan_is_the_robust_planners_and_its_solid_says_how_deep_to_close():
    # A bar of 32 x 64 x 60 mm, whose top is level with what the hand's sensor sees.
    block = Block((0.032, 0.064, 0.060), center=(0.0, 0.0, -0.030))
    arm = over_block(block)
    result = pick_up(arm, PlainGripper(arm), white)
    alone = over_block(block)
    RobustPlanner(white).plan(alone)
    np.testing.assert_allclose(result.plan.view.joints, alone.joints, atol=1e-9)
    assert result
    deep = HAND.tips - result.grasp.closed_at.translation[2]
    assert deep == pytest.approx(0.65 * 0.060, abs=0.003)


@check
@pytest.mark.parametrize(
    ("height", "residual", "depth"), [(0.020, 0.05, 0.013), (0.100, 0.05, 0.040), (0.100, 0.5, 0.020), (None, 0, 0.020)]
)
def test_the_default_executor_closes_by_the_plans_solid_and_without_one_as_for_an_unknown_height(
    height, residual, depth
):
    arm = above(Plate(sides=(0.020, 0.032)))
    plan = None
    if height is not None:
        solid = fitted((0.032, 0.020, height), center=(0, 0, -height / 2), residual=residual)
        plan = Plan(Outcome.ALIGNED, optima=(Optimum(Outcome.ALIGNED, solid=solid),))
    done = GraspExecutor(white).grasp(arm, PlainGripper(arm), plan)
    assert done.outcome is Outcome.HELD
    assert HAND.tips - done.closed_at.translation[2] == pytest.approx(depth, abs=0.0006)


@pytest.mark.parametrize("seed", [1, 2, 3, *(pytest.param(k, marks=pytest.mark.full) for k in (4, 5, 6, 8, 9, 10, 11))])
def test_the_brick_of_the_readme_is_picked_up_with_other_seeds_too(seed):
    noise = Noise.thesis()
    with WorkCell("baxter", "cuboid_1x2", "tilted", noise=noise, seed=seed, dynamic=True) as cell:
        before = cell.truth.world_from_object.translation[2]
        result = pick_up(cell.arm, cell.gripper, cell.segmenter)
        assert result, str(result)
        assert cell.truth.world_from_object.translation[2] - before > 0.05
    assert result.plan.outcome is Outcome.ALIGNED
    assert result.plan.uncertainty < np.radians(3)


# What no solid explains

BASE = Block((0.090, 0.050, 0.030), center=(0.0, 0.0, -0.030))  # m
UPRIGHT = Block((0.030, 0.050, 0.060), center=(-0.030, 0.0, 0.015))
PART = ObjectSpec(
    "l_part",
    '<mujoco><worldbody><body name="part">'
    + "".join(
        f'<geom type="box" size="{a / 2} {b / 2} {c / 2}" pos="{x} {y} {z}" rgba="0.8 0.1 0.1 1"/>'
        for (a, b, c), (x, y, z) in ((block.sizes, block.center) for block in (BASE, UPRIGHT))
    )
    + "</body></worldbody></mujoco>",
    HsvThreshold(hue=(345, 15), saturation=(0.4, 1), value=(0.15, 1)),
)
"""An L, of two boxes in one body."""


def check_unexplained(plan, known):
    assert plan.outcome is Outcome.UNEXPLAINED
    assert plan.outcome.arrived
    assert np.isfinite([plan.uncertainty, *(optimum.uncertainty for optimum in plan.optima)]).all() == known
    assert not plan.solid.explains
    assert repr(plan).startswith("Plan(unexplained, ")
    assert ("sd " in repr(plan)) is known
    assert "px left" in repr(plan)
    said = "picked up: view unexplained, within " if known else "picked up: view unexplained, 1"
    assert str(PickUp(plan, ended(Outcome.HELD), 1.0)).startswith(said)
    title = plan.plot()._suptitle
    assert re.search(r"unexplained.*\n.*far off", title.get_text())
    assert title.get_color() == COLORS["vermilion"]


@check
def test_of_a_solid_that_explains_nothing_no_deviation_is_claimed_but_of_a_hull():
    check_unexplained(RobustPlanner(white).plan(over_block(BASE, UPRIGHT)), known=True)
    moments = ImageMomentPlanner(white, SilhouetteFit(), step=0.04)
    check_unexplained(moments.plan(over_block(BASE, UPRIGHT)), known=False)


@check
def test_a_traversal_until_certain_never_stops_early_on_it():
    planner = ImageMomentPlanner(white, SilhouetteFit(), until=np.pi, step=0.04)
    plan = planner.plan(over_block(BASE, UPRIGHT))
    assert [arc.axis for arc in plan.arcs] == ["y", "x", "y"]  # the first again, in full
    assert Outcome.ENOUGH not in {end for arc in plan.arcs for end in arc.ends}
    assert plan.outcome is Outcome.UNEXPLAINED
    explained = planner.plan(over_block())
    assert Outcome.ENOUGH in explained.arcs[-1].ends
    assert explained.outcome is Outcome.ALIGNED


@pytest.mark.parametrize(("arm", "noise", "k"), [("floating", Noise(), 0), ("baxter", Noise.thesis(), 1)])
def test_an_l_shaped_part_is_unexplained(arm, noise, k):
    with WorkCell(arm, PART, noise=noise) as cell:
        begin(cell, k)
        check_unexplained(RobustPlanner(cell.segmenter).plan(cell.arm), known=True)


@pytest.mark.parametrize("target", ["cuboid_1x1", "cylinder"])
def test_while_bricks_and_cans_stay_aligned(target):
    with WorkCell("floating", target) as cell:
        begin(cell, 0)
        plan = RobustPlanner(cell.segmenter).plan(cell.arm)
    assert (plan.outcome, plan.attempts) == (Outcome.ALIGNED, ())
    assert plan.solid.explains
    assert plan.uncertainty < np.radians(1)


@check
@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"gripper": None}, "a gripper has all that Gripper has, as cell.gripper does; got None"),
        (
            {"planner": RobustPlanner},
            r"a planner .* as RobustPlanner\(cell.segmenter\) does; got <.*: it is a class",
        ),
        ({"planner": white}, "a planner .*: it has no plan"),
        ({"planner": Other()}, r"a planner .*: its plan cannot be called as plan\(arm\)"),
        ({"executor": white}, "an executor has all that Executor has"),
        ({"executor": Other()}, r"an executor .*: its grasp cannot be called as grasp\(arm, gripper, plan\)"),
        ({"segmenter": "red"}, "segmenter is called with an RGB image and returns a mask"),
        ({"attempts": 0}, "attempts says how often to try, 1 or more; got 0"),
    ],
)
def test_a_part_that_lacks_a_method_is_refused_before_anything_moves(options, said):
    arm = over_block(arm=Watched)
    given = {"gripper": PlainGripper(arm), "segmenter": white, **options}
    with pytest.raises(InvalidParameterError, match=said):
        pick_up(arm, **given)
    assert arm.frames == 0


@check
@pytest.mark.parametrize(
    ("plan", "grasp", "said"),
    [
        (None, None, r"Given\.plan returned None, where a Plan is meant"),
        (KNOWN, True, r"Given\.grasp returned True, where a Grasp is meant"),
    ],
)
def test_what_is_no_plan_or_no_grasp_is_refused(plan, grasp, said):
    arm, parts = over_block(), Given(plan, grasp)
    with pytest.raises(InvalidParameterError, match=said):
        pick_up(arm, PlainGripper(arm), white, planner=parts, executor=parts)


@check
@pytest.mark.parametrize(
    "plan",
    [
        ImageMomentPlanner(white).plan,
        RobustPlanner(white).plan,
        LookDown(white).plan,
        lambda arm: next(CnnPlanner(white, lambda rgb: Action.NO_OP).steps(arm)),
    ],
)
def test_an_arm_that_lacks_a_method_or_takes_other_arguments_is_refused(plan):
    class Half(PinholeArm):
        def move_camera(self, x, y, z):
            raise AssertionError

    for arm, trouble in (
        (white, "it has no intrinsics"),
        (Half(), r"cannot be called as move_camera\(camera_from_targ"),
    ):
        with pytest.raises(InvalidParameterError, match=f"an arm has all that EyeInHandArm has, .*{trouble}"):
            plan(arm)


@check
def test_a_segmenter_that_returns_no_mask_is_refused():
    with pytest.raises(GvpError, match="mask"):
        RobustPlanner(lambda rgb: None).plan(over_block())
