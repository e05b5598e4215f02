"""The episodes behind Table 3.2: what a method's grasp is told by, why one failed, and what they add up to."""

from dataclasses import replace

import numpy as np
import pytest
from hands import DOWN, HAND
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_book.experiments import grasp_judgement
from gvp_book.experiments.grasp_judgement import CAUSES, Cause
from gvp_book.experiments.grasping import CASES, METHODS, OPENINGS, grasp_cell, grasp_once
from gvp_book.experiments.grasping_report import THESIS, THESIS_TRIALS, grasping_report, tally
from gvp_book.tables import GROUPS, grasping_jobs, noise_fields
from gvp_lib.evaluation.statistics import wilson_interval
from gvp_lib.jobs import run_jobs
from gvp_lib.motion.arm import EyeInHandArm, Gripper
from gvp_lib.motion.sighting import View
from gvp_lib.planning.grasp import Grasp, GraspExecutor, GraspOutcome, RangeThreshold, Reading, SizedDepth
from gvp_lib.simulation.drives import DynamicDrive
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.truth import Truth
from gvp_lib.simulation.workcell import WorkCell

TOLD = {"plan", "error", "roll", "outcome", "success", "frames", "seconds", "deepest", "fastest"}
AT_CLOSING = {"depth", "aside", "along"}
IN_HAND = {"tilt_in_hand", "turn_in_hand", "shift_in_hand", "shaken"}


def job(target="cuboid_1x2", placement="flat", k=0, methods=("oracle",), noise=None):
    fields = {"target": target, "placement": placement, "noise": noise or {}, "seed": 3, "k": k}
    return {**fields, "methods": list(methods)}


@pytest.fixture(scope="module")
def row():
    """One noisy episode of the thesis's planner and ours."""
    return grasp_once(job(methods=["thesis", "ours"], noise=noise_fields(Noise.thesis())))


# An episode


def test_a_row_tells_of_each_method_what_the_report_needs(row):
    assert set(row) == {"tilt", "thesis", "ours"}
    assert 10 <= row["tilt"] <= 40
    for method in ("thesis", "ours"):
        told = row[method]
        assert set(told) >= TOLD
        assert set(told) - TOLD <= AT_CLOSING | IN_HAND | {"cause"}
        assert ("cause" in told) is not told["success"]
        assert set(told) >= IN_HAND or not told["success"]
        assert told.get("cause", CAUSES[0]) in CAUSES
    report = grasping_report({f"thesis/cuboid_1x2/flat/{k}": row for k in range(2)})
    assert report["pooled"]["thesis"]["ours"]["n"] == 2


def test_ours_aligns_better_from_the_views_that_the_thesiss_planner_took_and_holds(row):
    assert row["ours"]["error"] < 2 < row["thesis"]["error"]
    assert row["ours"]["success"]
    assert row["ours"]["shaken"]
    assert row["ours"]["tilt_in_hand"] < 3
    assert 10 < row["ours"]["depth"] < 24  # of 24 mm
    assert row["ours"]["deepest"] < 1.5


@pytest.mark.full
def test_the_same_job_gives_the_same_row_to_the_bit_in_this_process_or_in_two_others():
    jobs = {str(k): job(k=k, methods=["stay"], noise=noise_fields(Noise.thesis())) for k in range(2)}
    here = run_jobs(grasp_once, jobs, progress=False)
    there = run_jobs(grasp_once, jobs, workers=2, progress=False)
    assert not any(result.failed for result in [*here.values(), *there.values()]), here
    assert here == there
    assert grasp_once(jobs["0"]) == here["0"].value
    assert len({result.value["stay"]["seconds"] for result in here.values()}) == 2  # two different episodes


def test_an_episode_after_one_that_failed_is_what_it_would_have_been(monkeypatch):
    one = job(methods=["stay"])
    alone = grasp_once(one)

    def fail(executor, arm, gripper, view):
        raise ZeroDivisionError

    with monkeypatch.context() as patched:
        patched.setattr(GraspExecutor, "grasp", fail)
        with pytest.raises(ZeroDivisionError):
            grasp_once(one)
    assert grasp_once(one) == alone


def test_a_method_does_not_depend_on_which_others_are_asked_for():
    alone = grasp_once(job(methods=["oracle"]))
    beside = grasp_once(job(methods=["look_down", "oracle"]))
    assert alone["oracle"] == beside["oracle"]
    assert alone["tilt"] == beside["tilt"]


def test_the_cell_is_kept_for_jobs_of_one_case_and_is_without_dynamics_between_them():
    cell = grasp_cell(job())
    grasp_once(job())
    assert grasp_cell(job(k=1)) is cell
    assert not cell.dynamic


def test_the_fingers_are_mounted_for_the_object():
    assert set(OPENINGS) <= set(CASES)
    for case in (("cuboid_1x1", "side"), ("cuboid_1x1", "flat")):
        _, wide = grasp_cell(job(*case)).gripper.stroke
        assert wide == pytest.approx(OPENINGS.get(case, 0.072))


@pytest.mark.parametrize(
    ("target", "placement"),
    [
        ("cylinder", "side"),
        pytest.param("cuboid_1x1", "side", marks=pytest.mark.full),
        pytest.param("alligator", "raised", marks=pytest.mark.full),
    ],
)
def test_the_oracle_that_knows_holds_everything_without_noise(target, placement):
    told = grasp_once(job(target, placement))["oracle"]
    assert told["success"], told
    assert told["error"] < 0.01


@pytest.mark.parametrize(("case", "method"), [
    # Snaps flat: in whole steps 1.8 mm deep, and 3 between two readings.
    pytest.param("thesis/cuboid_1x1/side/148", "thesis", marks=pytest.mark.full),
    ("baselines/alligator/tilted/41", "oracle"),  # rattles: in whole steps up to 2.5, and at 1.4 m/s
])  # fmt: skip
def test_what_snaps_or_rattles_in_the_hand_stays_out_of_the_fingers(case, method, monkeypatch):
    again = []
    monkeypatch.setattr(
        DynamicDrive, "_step_again", lambda self, do=DynamicDrive._step_again: (again.append(self), do(self))
    )
    row = grasp_once({**grasping_jobs(2020, 200)[case], "methods": [method]})[method]
    assert row["success"]
    assert row["deepest"] < 1.0  # mm
    assert 0 < len(again) < 50


def test_a_calm_grasp_repeats_no_step(monkeypatch):
    monkeypatch.setattr(DynamicDrive, "_step_again", lambda self: pytest.fail("a step was done again"))
    calm = {**grasping_jobs(2020, 4)["thesis/cuboid_1x2/flat/3"], "methods": ["oracle"]}
    assert grasp_once(calm)["oracle"]["success"]


@pytest.fixture
def executed(monkeypatch):
    """Executors with the arm, the gripper and the view that each was given, none of which then does anything."""
    given = []

    def noted(executor, arm, gripper, view):
        given.append((executor, arm, gripper, view))
        return ended(GraspOutcome.TARGET_LOST, closed=False)

    monkeypatch.setattr(GraspExecutor, "grasp", noted)
    return given


def test_an_executor_is_given_arm_gripper_and_the_plans_view_and_no_truth(executed):
    grasp_once(job(methods=["stay", "look_down"]))
    assert len(executed) == 2
    for executor, arm, gripper, view in executed:
        assert isinstance(arm, EyeInHandArm)
        assert isinstance(gripper, Gripper)
        assert isinstance(view, View)
        assert not any(isinstance(value, Truth | WorkCell) for value in [*vars(arm).values(), *vars(executor).values()])


def test_the_thesiss_half_closes_by_its_threshold_and_ours_by_the_size(executed):
    grasp_once(job(methods=["thesis", "fit, threshold", "quartic, sized", "ours"]))
    used = [(type(executor.closing), executor.recenter) for executor, *_ in executed]
    plain, sized = (RangeThreshold, "turning"), (SizedDepth, "shifting")
    assert used == [plain, plain, sized, sized]


# Why it failed

CLOSED = RigidTransform.from_rotation(DOWN)
PLACED = RigidTransform.from_translation([0.6, -0.2, -0.19])


def ended(outcome, landed=False, closed=True):
    return Grasp(outcome, (Reading(CLOSED, 0.1, landed),), None, 0.03, landed, CLOSED if closed else None, 9)


def cause(grasp, depth=15.0, error=0.0, roll=0.0, aside=0.0, moved=(0, 0, 0), tipped=0.0, at_closing=(0.0, 0.0)):
    """Of a grasp, with lengths in mm and angles in deg; ``at_closing``: error and roll then."""
    witness = grasp_judgement._Witness(None, None)
    told = {"error": error, "roll": roll}
    if grasp.closed_at is not None:
        turn = Rotation.from_rotvec([np.radians(tipped), 0.0, 0.0])
        witness.target = PLACED * RigidTransform.from_components(np.array(moved) / 1000, turn)
        witness.camera = CLOSED
        witness.error, witness.roll = np.radians(at_closing)
        told |= {"depth": depth, "aside": aside, "along": 0.0}
    return grasp_judgement._cause(grasp, told, witness, PLACED)


@pytest.mark.parametrize("outcome", [GraspOutcome.TARGET_LOST, GraspOutcome.TARGET_NOT_FOUND, GraspOutcome.TOO_WIDE])
def test_what_was_not_seen_to_the_end_was_lost(outcome):
    assert cause(ended(outcome, closed=False), error=40.0) == Cause.TARGET_LOST


@pytest.mark.parametrize("outcome", [GraspOutcome.UNREACHABLE, GraspOutcome.JOINT_LIMIT, GraspOutcome.STALLED])
def test_an_arm_that_did_not_get_there_did_not_reach_it(outcome):
    assert cause(ended(outcome, closed=False), error=40.0) == Cause.UNREACHABLE


@pytest.mark.parametrize("outcome", [GraspOutcome.UNREACHABLE, GraspOutcome.JOINT_LIMIT, GraspOutcome.STALLED])
def test_an_arm_that_closed_and_could_not_lift_is_judged_by_what_it_had_closed_on(outcome):
    assert cause(ended(outcome)) == Cause.SLIPPED
    assert cause(ended(outcome), error=40.0) == Cause.MISALIGNED


@pytest.mark.parametrize("outcome", [GraspOutcome.EMPTY, GraspOutcome.SLIPPED, GraspOutcome.HELD])
def test_fingertips_less_than_five_millimeters_below_the_surface_closed_too_early(outcome):
    assert cause(ended(outcome), depth=4.9, error=40.0) == Cause.TOO_EARLY
    assert cause(ended(outcome), depth=-130.0) == Cause.TOO_EARLY
    assert cause(ended(outcome), depth=5.1) != Cause.TOO_EARLY
    assert cause(ended(outcome, landed=True), depth=4.9) != Cause.TOO_EARLY  # deeper it could not go


@pytest.mark.parametrize(
    "off",
    [
        {"error": 21.0},
        {"at_closing": (21.0, 0.0)},
        {"roll": -21.0},
        {"at_closing": (0.0, -21.0)},
        {"aside": 10.1},
        {"aside": -10.1},
    ],
)
def test_a_hand_that_stood_askew_or_aside_was_misaligned(off):
    assert cause(ended(GraspOutcome.EMPTY), **off) == Cause.MISALIGNED
    by_less = {name: tuple(0.9 * np.array(v)) if isinstance(v, tuple) else 0.9 * v for name, v in off.items()}
    assert cause(ended(GraspOutcome.EMPTY), **by_less) == Cause.SLIPPED


def test_a_rule_that_did_not_say_to_close_never_closed_unless_the_hand_stood_askew():
    never = ended(GraspOutcome.NEVER_CLOSED, landed=True, closed=False)
    assert cause(never) == Cause.NEVER_CLOSED
    assert cause(never, error=30.0) == Cause.MISALIGNED


@pytest.mark.parametrize("moved", [{"moved": (10.5, 0, 0)}, {"moved": (0, 0, 11)}, {"tipped": 10.5}])
def test_an_object_that_was_no_longer_where_it_had_been_put_was_pushed_away(moved):
    assert cause(ended(GraspOutcome.EMPTY, landed=True), **moved) == Cause.PUSHED_AWAY


@pytest.mark.parametrize(
    "grasp",
    [
        ended(GraspOutcome.CONTACT),
        ended(GraspOutcome.COLLISION),
        ended(GraspOutcome.COLLISION, closed=False),
        ended(GraspOutcome.EMPTY, landed=True),
    ],
    ids=lambda grasp: f"{grasp.outcome.value}{', landed' * grasp.landed}",
)
def test_where_the_hand_met_something_it_was_a_collision(grasp):
    assert cause(grasp) == Cause.COLLISION


@pytest.mark.parametrize("outcome", [GraspOutcome.SLIPPED, GraspOutcome.HELD, GraspOutcome.EMPTY, GraspOutcome.JAMMED])
def test_a_grasp_with_nothing_else_wrong_slipped(outcome):
    assert cause(ended(outcome)) == Cause.SLIPPED


def test_there_are_eight_causes():
    assert len(set(CAUSES)) == 8
    assert {Cause.TARGET_LOST, Cause.NEVER_CLOSED, Cause.SLIPPED} <= set(CAUSES)


def test_the_depth_is_that_of_the_tips_below_what_the_camera_looks_at():
    cell = grasp_cell(job("cylinder", "side"))
    cell.reset(0)
    down = RigidTransform.from_components(cell.truth.world_from_object.translation + (0, 0, 0.03 + 0.060), DOWN)
    witness = grasp_judgement._Witness(cell, cell.gripper, camera=down, target=cell.truth.world_from_object)
    told = grasp_judgement._at_closing(cell, witness)
    assert told["depth"] == pytest.approx(1000 * (HAND.tips - 0.060), abs=0.5)
    assert (told["aside"], told["along"]) == pytest.approx((0, 0), abs=1e-6)
    witness.camera = down * RigidTransform.from_translation([0.004, 0.0, 0.0])
    assert grasp_judgement._at_closing(cell, witness)["aside"] == pytest.approx(-4)
    assert grasp_judgement._at_closing(cell, replace(witness, camera=None)) == {}


# What is run


def test_the_cases_are_the_thesiss_two_placements_of_each_object_and_a_tilted_one():
    assert len(set(CASES)) == len(CASES) == 15
    for target in THESIS:
        placements = [placement for name, placement in CASES if name == target]
        assert len(placements) == 3
        assert placements[-1] == "tilted"


def test_every_episode_of_every_group_is_run_once():
    jobs = grasping_jobs(seed=4, starts=16)
    counts = {"thesis": 16, "baselines": 4, "none": 4, "mixed": 2}
    assert set(jobs) == {
        f"{group}/{target}/{placement}/{k}"
        for group, n in counts.items()
        for target, placement in CASES
        for k in range(n)
    }
    for key, one in jobs.items():
        group, target, placement, k = key.split("/")
        assert (one["target"], one["placement"], one["seed"], one["k"]) == (target, placement, 4, int(k))
        assert one["methods"] == GROUPS[group]
        assert Noise(**one["noise"]) == (Noise.none() if group == "none" else Noise.thesis())
    assert {method for methods in GROUPS.values() for method in methods} == set(METHODS)


@pytest.mark.parametrize("starts", [1, 5, 8, 50])
def test_a_longer_run_has_all_the_episodes_of_a_shorter_one(starts):
    short, long = grasping_jobs(0, starts), grasping_jobs(0, 100)
    assert short.items() <= long.items()
    assert len(short) < len(long)


def test_another_seed_draws_other_starts():
    assert all(one["seed"] == 9 for one in grasping_jobs(9, 2).values())


# What they add up to


def told(success, shaken=True, cause=Cause.SLIPPED, **more):
    common = {"plan": "aligned", "outcome": "held", "error": 1.0, "roll": 0.5, "frames": 30, "seconds": 10.0}
    common |= {"deepest": 0.5, "fastest": 0.2, "success": success, **more}
    if not success:
        return {**common, "cause": cause}
    return {**common, "shaken": shaken, "tilt_in_hand": 2.0, "turn_in_hand": 1.0, "shift_in_hand": -0.3}


def rows(group="thesis", case="cuboid_1x2/flat", **methods):
    """Rows of a case, from a text of 0 and 1 for each method."""
    n = len(next(iter(methods.values())))
    return {
        f"{group}/{case}/{k}": {"tilt": 20.0, **{name: told(text[k] == "1") for name, text in methods.items()}}
        for k in range(n)
    }


def test_table_3_2_is_as_printed():
    percent = {name: tuple(100 * n // THESIS_TRIALS for n in counts) for name, counts in THESIS.items()}
    assert percent == {
        "cuboid_1x1": (80, 80),
        "cuboid_1x2": (100, 90),
        "cuboid_1x4": (90, 90),
        "cylinder": (90, 100),
        "alligator": (90, 80),
    }
    report = grasping_report(rows(thesis="1", ours="1"))
    assert [cell["successes"] for cell in report["thesis"]["cuboid_1x2"]] == [10, 9]
    assert report["thesis"]["cuboid_1x1"][0]["interval"] == wilson_interval(8, 10)
    assert (report["thesis_pooled"]["successes"], report["thesis_pooled"]["n"]) == (89, 100)


def test_successes_are_counted_with_wilsons_interval():
    summary = grasping_report(rows(thesis="1100", ours="1101"))["summary"]["thesis/cuboid_1x2/flat"]
    for method, successes in (("thesis", 2), ("ours", 3)):
        assert (summary[method]["successes"], summary[method]["n"]) == (successes, 4)
        assert summary[method]["rate"] == successes / 4
        assert summary[method]["interval"] == wilson_interval(successes, 4)


def test_a_difference_is_of_the_same_starts_and_positive_where_ours_is_better():
    summary = grasping_report(rows(thesis="1000", ours="1101"))["summary"]["thesis/cuboid_1x2/flat"]
    assert summary["ours - thesis"].mean == 0.5
    assert summary["ours - thesis"].n == 4
    worse = grasping_report(rows(thesis="11", ours="01"))["pooled"]["thesis"]
    assert worse["ours - thesis"].mean == -0.5


def test_what_ran_from_the_same_starts_is_merged_and_compared_on_those_that_both_have():
    given = rows(thesis="0000", ours="0110") | rows("baselines", oracle="11", look_down="01")
    given |= rows("mixed", **{"fit, threshold": "1"}) | rows("none", thesis="11", ours="11")
    report = grasping_report(given)
    assert set(report["summary"]) == {"thesis/cuboid_1x2/flat", "none/cuboid_1x2/flat"}
    summary = report["summary"]["thesis/cuboid_1x2/flat"]
    assert [summary[name]["n"] for name in ("thesis", "ours", "oracle", "fit, threshold")] == [4, 4, 2, 1]
    assert (summary["oracle - ours"].n, summary["oracle - ours"].mean) == (2, 0.5)
    assert (summary["look_down - ours"].n, summary["look_down - ours"].mean) == (2, 0.0)
    assert summary["fit, threshold - thesis"].mean == 1
    assert "quartic, sized - thesis" not in summary
    assert report["summary"]["none/cuboid_1x2/flat"]["thesis"]["successes"] == 2


def test_rows_come_in_the_order_of_their_starts_however_the_episodes_ended():
    given = rows(thesis="0101101011", ours="1111111111")
    shuffled = dict(reversed(given.items()))
    for order in (given, shuffled):
        kept = grasping_report(order)["rows"]["thesis/cuboid_1x2/flat"]
        assert kept["thesis"]["success"] == "0101101011"
        assert set(kept["thesis"]["causes"]) == {"0", "2", "5", "7"}
    assert grasping_report(shuffled) == grasping_report(given)


def test_the_pool_is_over_all_cases_and_once_more_without_those_that_lean():
    given = rows(thesis="11", ours="11") | rows(case="cylinder/tilted", thesis="00", ours="10")
    report = grasping_report(given)
    assert (report["pooled"]["thesis"]["ours"]["successes"], report["pooled"]["thesis"]["ours"]["n"]) == (3, 4)
    assert report["pooled_thesis_placements"]["thesis"]["ours"]["n"] == 2


def test_a_tally_counts_causes_arrivals_and_what_survived_the_shake():
    lost, early = told(False, cause=Cause.TARGET_LOST, plan="collision"), told(False, cause=Cause.TOO_EARLY)
    summary = tally([told(True), told(True, shaken=False), lost, early, early])
    assert summary["causes"] == {Cause.TARGET_LOST: 1, Cause.TOO_EARLY: 2}
    assert sum(summary["causes"].values()) == summary["n"] - summary["successes"]
    assert (summary["shaken"]["successes"], summary["shaken"]["n"]) == (1, 5)
    assert summary["arrived"] == 4
    assert (summary["tilt_in_hand"].n, summary["tilt_in_hand"].mean) == (2, 2.0)
    assert summary["shift_in_hand"].mean == pytest.approx(0.3)  # a distance, to either side
    assert (summary["seconds"], summary["frames"]) == (10.0, 30.0)


def test_contacts_tell_how_many_sank_in_too_deep():
    given = rows(ours="111")
    given["thesis/cuboid_1x2/flat/1"]["ours"] |= {"deepest": 1.6, "fastest": 0.9}
    found = grasping_report(given)["contacts"]["thesis"]["ours"]
    assert (found["deepest"], found["beyond_1.5mm"], found["fastest"], found["n"]) == (1.6, 1, 0.9, 3)


def test_what_did_not_close_has_no_depth_in_the_columns():
    given = rows(thesis="01", ours="11")
    given["thesis/cuboid_1x2/flat/1"]["thesis"]["depth"] = 12.34
    kept = grasping_report(given)["rows"]["thesis/cuboid_1x2/flat"]
    assert kept["thesis"]["depth"] == [None, 12.3]
    assert kept["tilt"] == [20.0, 20.0]
