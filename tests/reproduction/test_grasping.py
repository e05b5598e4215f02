"""Table 3.2: what each method's grasp is given, why one failed, what is run, and what rows add up to."""

from contextlib import nullcontext
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from hands import DOWN, HAND
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_book.experiments import grasping
from gvp_book.experiments.grasping import (
    METHODS,
    THESIS,
    Cause,
    JudgedGrasp,
    grasp_cell,
    grasp_once,
    grasping_jobs,
    grasping_report,
    placeable,
    tally,
)
from gvp_lib.evaluation.statistics import wilson_interval
from gvp_lib.motion.arm import EyeInHandArm, Gripper, Outcome
from gvp_lib.planning.closing import RangeThreshold, Reading
from gvp_lib.planning.grasp import Grasp, GraspExecutor
from gvp_lib.planning.plan import Plan
from gvp_lib.simulation.truth import Truth
from gvp_lib.simulation.workcell import WorkCell


def job(target="cuboid_1x2", placement="flat", k=0, methods=("oracle",), noise=None):
    fields = {"target": target, "placement": placement, "noise": noise or {}, "seed": 3, "k": k}
    return {**fields, "methods": list(methods)}


# An episode


def test_an_episode_after_one_that_failed_or_beside_another_method_is_what_it_would_have_been(monkeypatch):
    alone = grasp_once(job(methods=["oracle"]))
    with monkeypatch.context() as patched:
        patched.setattr(GraspExecutor, "grasp", lambda *given: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            grasp_once(job(methods=["stay"]))
    cell = grasp_cell(job())
    beside = grasp_once(job(methods=["look_down", "oracle"]))
    assert {name: beside[name] for name in alone} == alone
    assert grasp_cell(job(k=1)) is cell  # kept for jobs of one case, without dynamics between them
    assert not cell.dynamic


def test_the_fingers_are_mounted_for_the_object():
    for placement, opening in (("side", 0.056), ("flat", 0.072)):
        assert grasp_cell(job("cuboid_1x1", placement)).gripper.stroke[1] == pytest.approx(opening)


@pytest.mark.parametrize(("key", "method", "repeats"), [
    # Snaps flat: in whole steps 1.8 mm deep, and 3 between two readings.
    pytest.param("ours/cuboid_1x1/side/148", "thesis", range(1, 50), marks=pytest.mark.full),
    ("ours/alligator/tilted/41", "oracle", range(1, 50)),  # rattles: in whole steps up to 2.5, and at 1.4 m/s
    ("thesis/cuboid_1x2/flat/3", "oracle", [0]),  # calm
])  # fmt: skip
def test_what_snaps_or_rattles_in_the_hand_stays_out_of_the_fingers(key, method, repeats, monkeypatch):
    again, step = [], mujoco.mj_step
    monkeypatch.setattr(mujoco, "mj_step", lambda *given: (again.extend(given[2:]), step(*given)))  # parts of a step
    grasp = grasp_once({**grasping_jobs(2020, 200)[key], "methods": [method]})[method]
    assert grasp["success"]
    assert grasp["deepest"] < 1.0  # mm
    assert len(again) in repeats


def test_an_executor_is_given_arm_gripper_and_plan_and_no_truth_and_closes_as_its_half_does(monkeypatch):
    given = []

    def grasp(*arguments):
        given.append(arguments)
        return ended(Outcome.TARGET_LOST, closed=False)

    monkeypatch.setattr(GraspExecutor, "grasp", grasp)
    grasp_once(job(methods=METHODS[:6]))
    for executor, arm, gripper, plan in given:
        assert (isinstance(arm, EyeInHandArm), isinstance(gripper, Gripper), isinstance(plan, Plan)) == (True,) * 3
        assert not any(isinstance(value, Truth | WorkCell) for value in [*vars(arm).values(), *vars(executor).values()])
    used = [(type(executor.closing), executor.recenter) for executor, *_ in given]
    plain, sized = (RangeThreshold, "turning"), (type(None), "shifting")  # None: by the plan
    assert used == [plain, plain, sized, sized, sized, sized]  # thesis; fit, threshold; quartic, sized; moments; ours


# Why it failed

PLACED = RigidTransform.from_translation([0.6, -0.2, -0.19])
UP = np.array([0.0, 0.0, 1.0])


def ended(outcome, landed=False, closed=True):
    camera = RigidTransform.from_rotation(DOWN)
    return Grasp(outcome, (Reading(camera, 0.1, landed),), None, 0.03, landed, camera if closed else None, 9)


def cause(outcome, landed=False, closed=True, depth=15.0, error=0.0, roll=0.0, aside=0.0, moved=(0, 0, 0), tipped=0.0,
          at_closing=(0.0, 0.0)):  # fmt: skip
    """Cause of a grasp of a ball in a cell of made-up truth, with lengths in mm and angles in deg; ``at_closing``:
    error and roll then."""
    truth = SimpleNamespace(world_from_object=PLACED, normal=SimpleNamespace(nearest=lambda direction: UP))
    truth.viewpoint_error, truth.roll_error = (lambda: np.radians(error)), (lambda: np.radians(roll))

    def grasp(arm, gripper, view):
        truth.viewpoint_error, truth.roll_error = (lambda angle=angle: np.radians(angle) for angle in at_closing)
        turn = Rotation.from_rotvec([np.radians(tipped), 0.0, 0.0])
        truth.world_from_object = PLACED * RigidTransform.from_components(np.array(moved) / 1000, turn)
        above = truth.world_from_object.translation + (0.02 + HAND.tips - depth / 1000) * UP
        offset = RigidTransform.from_translation([-aside / 1000, 0.0, 0.0])
        truth.world_from_camera = RigidTransform.from_components(above, DOWN) * offset
        if closed:
            gripper.close()
        return ended(outcome, landed, closed)

    ball = SimpleNamespace(bounding_box=lambda: SimpleNamespace(half_extents=np.full(3, 0.02)))
    gripper = SimpleNamespace(hand=HAND, close=lambda: None)
    cell = SimpleNamespace(truth=truth, target_spec=ball, gripper=gripper, arm=None, time=0.0)
    judged = JudgedGrasp(cell, SimpleNamespace(grasp=grasp))
    judged.grasp(None, gripper, Plan(Outcome.ALIGNED))
    return judged.row["cause"]


@pytest.mark.parametrize(("expected", "outcomes", "more"), [
    (Cause.TARGET_LOST, "TARGET_LOST TARGET_NOT_FOUND TOO_WIDE", {"closed": False, "error": 40.0}),
    (Cause.UNREACHABLE, "UNREACHABLE JOINT_LIMIT STALLED", {"closed": False, "error": 40.0}),
    # An arm that closed and could not lift is judged by what it had closed on.
    (Cause.SLIPPED, "UNREACHABLE JOINT_LIMIT STALLED", {}),
    (Cause.MISALIGNED, "UNREACHABLE JOINT_LIMIT STALLED", {"error": 40.0}),
    # Fingertips less than 5 mm below the surface closed too early, unless deeper they could not go.
    (Cause.TOO_EARLY, "EMPTY SLIPPED HELD", {"depth": 4.9, "error": 40.0}),
    (Cause.SLIPPED, "EMPTY SLIPPED HELD", {"depth": 5.1}),
    (Cause.COLLISION, "EMPTY SLIPPED HELD", {"depth": 4.9, "landed": True}),
    # A hand that stood askew or aside, before the descent or as it closed.
    (Cause.MISALIGNED, "EMPTY", {"error": 21.0}),
    (Cause.MISALIGNED, "EMPTY", {"roll": -21.0}),
    (Cause.MISALIGNED, "EMPTY", {"at_closing": (21.0, 0.0)}),
    (Cause.MISALIGNED, "EMPTY", {"at_closing": (0.0, -21.0)}),
    (Cause.MISALIGNED, "EMPTY", {"aside": -10.1}),
    (Cause.SLIPPED, "EMPTY", {"error": 19.0, "roll": -19.0, "aside": 9.0, "at_closing": (19.0, -19.0)}),
    # A rule that did not say to close, unless the hand stood askew.
    (Cause.NEVER_CLOSED, "NEVER_CLOSED", {"landed": True, "closed": False}),
    (Cause.MISALIGNED, "NEVER_CLOSED", {"landed": True, "closed": False, "error": 30.0}),
    # An object that was no longer where it had been put.
    (Cause.PUSHED_AWAY, "EMPTY", {"landed": True, "moved": (0, 0, 11)}),
    (Cause.PUSHED_AWAY, "EMPTY", {"landed": True, "tipped": 10.5}),
    (Cause.COLLISION, "CONTACT COLLISION", {}),
    (Cause.COLLISION, "COLLISION", {"closed": False}),
    (Cause.SLIPPED, "SLIPPED HELD EMPTY JAMMED", {}),
])  # fmt: skip
def test_a_failure_has_the_first_cause_that_holds(expected, outcomes, more, monkeypatch):
    nothing = SimpleNamespace(deepest=0.0, fastest=0.0)
    monkeypatch.setattr(grasping, "record_contacts", lambda cell: nullcontext(nothing))
    assert {cause(Outcome[name], **more) for name in outcomes.split()} == {expected}


# What is run


def test_a_longer_run_has_the_episodes_of_a_shorter_one():
    for starts in (1, 5, 8, 50):
        assert grasping_jobs(0, starts).items() < grasping_jobs(0, 100).items()


# What rows add up to


def grasp(success, shaken=True, cause=Cause.SLIPPED, **more):
    common = {"plan": "aligned", "outcome": "held", "error": 1.0, "roll": 0.5, "frames": 30, "seconds": 10.0}
    common |= {"deepest": 0.5, "fastest": 0.2, "success": success, **more}
    if not success:
        return {**common, "cause": cause}
    return {"shaken": shaken, "tilt_in_hand": 2.0, "turn_in_hand": 1.0, "shift_in_hand": -0.3, **common}


def rows(group="thesis", case="cuboid_1x2/flat", **methods):
    """Rows of a case, from a text of 0 and 1 for each method."""
    n = len(next(iter(methods.values())))
    return {
        f"{group}/{case}/{k}": {"tilt": 20.0, **{name: grasp(text[k] == "1") for name, text in methods.items()}}
        for k in range(n)
    }


def test_table_3_2_is_as_printed():
    assert list(THESIS.values()) == [(8, 8), (10, 9), (9, 9), (9, 10), (9, 8)]
    report = grasping_report(rows(thesis="1", ours="1"))
    assert [cell["successes"] for cell in report["thesis"]["cuboid_1x2"]] == [10, 9]
    assert report["thesis"]["cuboid_1x1"][0]["interval"] == wilson_interval(8, 10)
    assert (report["thesis_pooled"]["successes"], report["thesis_pooled"]["n"]) == (89, 100)


def test_what_ran_from_the_same_starts_is_merged_and_compared_in_the_order_of_the_starts():
    given = rows("ours", ours="1101") | rows(thesis="1000") | rows("baselines", oracle="11", look_down="01")
    given |= rows("mixed", **{"fit, threshold": "0"}) | rows("none", thesis="11", ours="11")
    given |= rows(case="cylinder/tilted", thesis="00", ours="10")
    given["thesis/cuboid_1x2/flat/1"]["thesis"]["depth"] = 12.34
    given["ours/cuboid_1x2/flat/1"]["ours"] |= {"deepest": 1.6, "fastest": 0.9}
    report = grasping_report(given)
    backwards = grasping_report(dict(reversed(given.items())))
    assert (backwards["summary"], backwards["rows"]) == (report["summary"], report["rows"])
    assert set(report["summary"]) == {f"{group}/cuboid_1x2/flat" for group in ("thesis", "none")} | {
        "thesis/cylinder/tilted"
    }
    summary = report["summary"]["thesis/cuboid_1x2/flat"]
    for method, n, successes in (("thesis", 4, 1), ("ours", 4, 3), ("oracle", 2, 2), ("fit, threshold", 1, 0)):
        assert [summary[method][name] for name in ("successes", "n", "rate")] == [successes, n, successes / n]
        assert summary[method]["interval"] == wilson_interval(successes, n)
    # Positive where the first is better.
    differences = {"ours - thesis": (4, 0.5), "fit, threshold - thesis": (1, -1), "oracle - ours": (2, 0)}
    for name, expected in {**differences, "look_down - ours": (2, -0.5)}.items():
        assert (summary[name].n, summary[name].mean) == expected
    assert "quartic, sized - thesis" not in summary
    kept = report["rows"]["thesis/cuboid_1x2/flat"]["oracle"]
    assert (kept["success"], kept["placeable"], kept["causes"]) == ("11", "11", {})  # of the first starts alone
    kept = report["rows"]["thesis/cuboid_1x2/flat"]["thesis"]
    assert (kept["success"], set(kept["causes"])) == ("1000", {"1", "2", "3"})
    assert kept["depth"] == [None, 12.3, None, None]  # what did not close has none
    pooled = [report[pool]["thesis"]["ours"] for pool in ("pooled", "pooled_thesis_placements")]  # with what leans
    assert [(each["successes"], each["n"]) for each in pooled] == [(4, 6), (3, 4)]
    contacts = report["contacts"]["thesis"]["ours"]
    assert (contacts["deepest"], contacts["beyond_1.5mm"], contacts["fastest"], contacts["n"]) == (1.6, 1, 0.9, 6)


def test_where_a_hand_from_above_holds_askew_all_objects_stand_together():
    given = rows("ours", case="cuboid_1x2/tilted", ours="11") | rows("baselines", case="cuboid_1x2/tilted", stay="0")
    given |= rows("placing", case="tomato_soup_box/tilted", ours="10", look_down="11")
    given |= rows("beside", case="cylinder/ramp", stay="1") | rows("none", case="cuboid_1x2/tilted", ours="0")
    report = grasping_report(given)
    counts = {
        place: {name: (each["successes"], each["n"]) for name, each in methods.items() if name in METHODS}
        for place, methods in report["placing"].items()
    }
    assert counts == {"tilted": {"ours": (3, 4), "look_down": (2, 2), "stay": (0, 1)}, "ramp": {"stay": (1, 1)}}
    assert report["pooled"]["placing"]["ours"]["n"] == 4
    assert report["pooled"]["thesis"]["ours"]["n"] == 2  # Table 3.2's own cases alone
    assert report["placing"]["tilted"]["look_down - ours"].mean == 0.5


@pytest.mark.parametrize(("more", "expected"), [
    ({}, True),
    ({"tilt_in_hand": 5.1}, False),
    ({"turn_in_hand": 5.1}, False),
    ({"shift_in_hand": -5.1}, False),
    ({"tilt_in_hand": 5.0, "turn_in_hand": 5.0, "shift_in_hand": -5.0}, True),
    ({"shaken": False}, False),
])  # fmt: skip
def test_what_is_askew_in_the_hand_or_was_shaken_loose_is_not_placeable(more, expected):
    assert placeable(grasp(True, **more)) is expected
    assert not placeable(grasp(False))


def test_a_tally_counts_causes_arrivals_and_what_survived_the_shake():
    lost, early = grasp(False, cause=Cause.TARGET_LOST, plan="collision"), grasp(False, cause=Cause.TOO_EARLY)
    summary = tally([grasp(True), grasp(True, shaken=False), lost, early, early])
    assert summary["causes"] == {Cause.TARGET_LOST: 1, Cause.TOO_EARLY: 2}
    assert (summary["shaken"]["successes"], summary["shaken"]["n"], summary["arrived"]) == (1, 5, 4)
    assert summary["placeable"]["successes"] == 1
    assert summary["plans"] == {"aligned": 4, "collision": 1}
    assert (summary["tilt_in_hand"].n, summary["tilt_in_hand"].mean) == (2, 2.0)
    assert summary["shift_in_hand"].mean == pytest.approx(0.3)  # a distance, to either side
    assert (summary["seconds"], summary["frames"]) == (10.0, 30.0)
