"""The episodes behind Table 3.1: how they begin, what each method does, and that no policy is told the truth."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from gvp_book.experiments.alignment import CASES, METHODS, align_once
from gvp_lib.errors import GvpError
from gvp_lib.evaluation import baselines, episodes
from gvp_lib.evaluation.episodes import canonical_views, cell_of, draw_start, judge, run_episode
from gvp_lib.evaluation.metrics import viewpoint_error
from gvp_lib.jobs import run_jobs
from gvp_lib.planning.image_moments import ImageMomentPlanner
from gvp_lib.planning.plan import Plan, PlanOutcome
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.truth import Truth
from gvp_lib.simulation.workcell import WorkCell

QUICK = {"step": 0.04, "max_angle": 0.5}


def job(target="cuboid_1x4", placement="flat", k=0, methods=METHODS, noise=None, **more):
    fields = {"target": target, "placement": placement, "noise": noise or {}, "seed": 3, "k": k}
    return {**fields, "methods": list(methods), "planner": QUICK, **more}


@pytest.fixture(scope="module")
def baxter():
    made = WorkCell("baxter", "cuboid_1x2")
    yield made
    made.close()


@pytest.fixture(scope="module")
def row():
    return align_once(job())


# A start


def test_starts_are_drawn_within_their_ranges_and_are_where_they_say(baxter):
    starts = []
    for seed in range(12):
        baxter.reset(seed)
        try:
            start = draw_start(baxter, np.random.default_rng(seed))
        except GvpError:
            continue  # here the Baxter does not reach the object from above
        starts.append(start)
        truth, camera = baxter.truth, start.world_from_camera
        np.testing.assert_allclose(truth.world_from_camera.as_matrix(), camera.as_matrix(), atol=1e-3)
        away = camera.translation - truth.world_from_object.translation
        assert np.linalg.norm(away) == pytest.approx(start.distance, abs=1e-6)
        tilt = np.arccos(away @ truth.normal.direction / start.distance)
        assert tilt == pytest.approx(start.tilt, abs=1e-6)
        shown = baxter.arm.intrinsics.project(camera.inv().apply(truth.world_from_object.translation))
        np.testing.assert_allclose(shown, start.pixel, atol=1e-3)
    assert len(starts) >= 8
    tilts = np.degrees([start.tilt for start in starts])
    assert 10 <= tilts.min() < 20 < 30 < tilts.max() <= 40
    distances = [start.distance for start in starts]
    assert 0.25 <= min(distances) < 0.28 < 0.32 < max(distances) <= 0.35
    off = [np.linalg.norm(start.pixel - baxter.arm.intrinsics.principal_point) for start in starts]
    assert 20 < max(off) <= 100
    assert all(1 <= start.tries <= 200 for start in starts)
    assert any(start.tries > 1 for start in starts)  # not all can be reached


def test_the_tilts_of_a_start_are_an_option(baxter):
    baxter.reset(0)
    start = draw_start(baxter, np.random.default_rng(0), tilt=(3.0, 5.0))
    assert 3 <= np.degrees(start.tilt) <= 5


def test_the_same_generator_draws_the_same_start(baxter):
    drawn = []
    for _ in range(2):
        baxter.reset(1)
        drawn.append(draw_start(baxter, np.random.default_rng(5)).world_from_camera.as_matrix())
    np.testing.assert_array_equal(*drawn)


def test_where_no_canonical_view_is_within_reach_there_is_no_start(baxter, monkeypatch):
    far = RigidTransform.from_translation([5.0, 0.0, 5.0])
    monkeypatch.setattr(episodes, "canonical_views", lambda cell, radius: [far])
    with pytest.raises(GvpError, match="the arm cannot reach a canonical view of the object where it stands"):
        draw_start(baxter, np.random.default_rng(0))


def test_starts_are_the_same_for_every_method_and_every_noise():
    # What a start is drawn from; the draws that the arm's own error puts out of reach may differ.
    starts = []
    for noise, methods in (({}, ["stay"]), ({}, ["oracle", "stay"]), ({"pixel_sd": 0.01, "exposure": 0.1}, ["oracle"])):
        starts.append(align_once(job(noise=noise, methods=methods))["start"])
    assert all(start == starts[0] for start in starts)


@pytest.mark.parametrize(
    ("target", "placement", "views"),
    [("cuboid_1x1", "flat", 4), ("cuboid_1x2", "flat", 2), ("cylinder", "flat", 8), ("cylinder", "side", 2)],
)
def test_every_canonical_view_is_without_error_and_the_nearest_roll_comes_first(target, placement, views):
    with WorkCell("floating", target, placement) as cell:
        found = canonical_views(cell)
        here = cell.truth.world_from_camera.rotation
        turns = [(here.inv() * view.rotation).magnitude() for view in found]
        assert turns == sorted(turns)
        assert len(found) == views
        for view in found:
            cell.place_camera(view)
            error = viewpoint_error(cell.truth)
            assert error.total < 1e-6
            assert abs(error.roll) < 1e-6
            away = view.translation - cell.truth.world_from_object.translation
            assert np.linalg.norm(away) == pytest.approx(episodes.RADIUS)


# A judgement


def test_the_judge_tells_the_true_error_in_degrees_and_the_simulated_time(baxter):
    baxter.reset(0)
    draw_start(baxter, np.random.default_rng(0))
    before = viewpoint_error(baxter.truth)

    def wait(cell):
        cell.data.time += 1.5
        return Plan(PlanOutcome.ANY_ANGLE, (), (), None, 7)

    plan, judged = run_episode(baxter, wait)
    assert judged == judge(baxter, plan, judged.seconds)
    assert judged.total == pytest.approx(np.degrees(before.total))
    assert judged.total == pytest.approx(np.hypot(judged.about_x, judged.about_y))
    assert (judged.outcome, judged.frames, judged.views) == ("any angle", 7, 0)
    assert judged.seconds == pytest.approx(1.5)
    assert set(judged.to_dict()) == {"outcome", "total", "about_x", "about_y", "roll", "frames", "views", "seconds"}


# The baselines


def start_of(cell, seed=0):
    cell.reset(seed)
    return draw_start(cell, np.random.default_rng(seed))


def test_to_stay_centers_the_object_and_leaves_the_camera_where_it_is(baxter):
    start = start_of(baxter)
    plan = baselines.stay(baxter)
    assert plan.outcome is PlanOutcome.ALIGNED
    np.testing.assert_allclose(
        baxter.truth.world_from_camera.translation, start.world_from_camera.translation, atol=1e-4
    )
    np.testing.assert_allclose(plan.view.blob.centroid, baxter.arm.intrinsics.principal_point, atol=2)
    assert np.degrees(baxter.truth.viewpoint_error()) == pytest.approx(np.degrees(start.tilt), abs=2)


@pytest.mark.parametrize(("placement", "error"), [("flat", (0, 1)), ("tilted", (10, 32))])
def test_to_look_down_is_right_for_what_stands_level_and_wrong_for_what_leans(placement, error):
    cell = cell_of(job("cuboid_1x2", placement))
    start_of(cell)
    plan = baselines.look_down(cell)
    assert plan.outcome is PlanOutcome.ALIGNED
    axis = cell.truth.world_from_camera.rotation.as_matrix()[:, 2]
    assert -axis[2] > np.cos(np.radians(0.2))
    assert error[0] <= np.degrees(cell.truth.viewpoint_error()) <= error[1]
    if placement == "flat":
        assert abs(np.degrees(cell.truth.roll_error())) < 2
        away = cell.truth.world_from_camera.translation - cell.truth.world_from_object.translation
        assert np.linalg.norm(away) == pytest.approx(0.25, rel=0.08)


@pytest.mark.parametrize(("noise", "most"), [(Noise.none(), 0.01), (Noise(joint_offset_sd=np.radians(0.25)), 3)])
def test_to_know_leaves_the_arms_own_error_and_no_other(noise, most):
    with WorkCell("baxter", "cuboid_1x2", noise=noise) as cell:
        start_of(cell, 1)
        plan = baselines.oracle(cell)
        assert plan.outcome is PlanOutcome.ALIGNED
        error = np.degrees(cell.truth.viewpoint_error())
        assert error < most
        assert bool(error > 0.02) is (noise != Noise.none())
        assert abs(np.degrees(cell.truth.roll_error())) < most


def test_a_baseline_that_sees_nothing_says_so():
    with WorkCell("floating", "cuboid_1x2") as cell:
        away = cell.truth.world_from_camera * RigidTransform.from_translation([2.0, 0.0, 0.0])
        for policy in (baselines.stay, baselines.look_down):
            cell.place_camera(away)
            plan = policy(cell)
            assert plan.outcome is PlanOutcome.TARGET_LOST
            assert plan.view is None


# No truth for a policy


class Peeked(Exception):
    pass


@pytest.mark.parametrize("name", ["silhouette", pytest.param("early", marks=pytest.mark.full), "stay", "look_down"])
def test_no_policy_but_the_oracle_reads_the_truth(name, monkeypatch):
    guarded = []

    def guard(own):
        def read(self):
            if guarded:
                raise Peeked
            return own.fget(self)

        return property(read)

    for member in ("world_from_object", "world_from_camera", "normal"):
        monkeypatch.setattr(Truth, member, guard(vars(Truth)[member]))

    def watched(act):
        def acting(*arguments, **options):
            guarded.append(True)
            try:
                return act(*arguments, **options)
            finally:
                guarded.pop()

        return acting

    for method in ("plan", "conclude"):
        monkeypatch.setattr(ImageMomentPlanner, method, watched(getattr(ImageMomentPlanner, method)))
    for baseline in ("stay", "look_down", "oracle"):
        monkeypatch.setattr(baselines, baseline, watched(getattr(baselines, baseline)))
    methods = {"silhouette": ["quartic", "silhouette"]}.get(name, [name])
    assert name in align_once(job(methods=methods))
    if name == "stay":
        with pytest.raises(Peeked):  # the guard bites
            align_once(job(methods=["oracle"]))


def test_a_planners_policy_is_given_the_arm_and_nothing_else_of_the_cell(monkeypatch):
    given = []
    plan = ImageMomentPlanner.plan
    monkeypatch.setattr(ImageMomentPlanner, "plan", lambda self, *a: (given.append((self, a)), plan(self, *a))[1])
    align_once(job(methods=["quartic"]))
    ((planner, (arm,)),) = given
    cell = cell_of(job())
    assert arm is cell.arm
    assert planner.segmenter is cell.target_spec.segmenter
    assert not any(isinstance(value, Truth | WorkCell) for value in [*vars(arm).values(), *vars(planner).values()])


# A row


def test_a_row_holds_a_judgement_for_each_method(row):
    assert set(row) == {"start", *METHODS}
    for method in METHODS:
        assert {"outcome", "total", "roll", "frames", "views", "seconds"} <= set(row[method])
    assert row["silhouette"]["total"] < row["stay"]["total"]
    assert row["oracle"]["total"] < 0.01
    assert 10 < row["start"]["tilt"] < 40
    assert row["silhouette"]["kind"] == row["early"]["kind"] == "box"
    assert row["silhouette"]["size_error_mm"] < 3
    assert row["quartic"]["homography"] > 0
    assert row["quartic"]["views"] > row["silhouette"]["views"] * 0.99
    assert abs(row["quartic"]["first_arc"]) < 45


def test_the_silhouette_concludes_from_the_very_views_of_the_thesiss_planner(row):
    assert row["silhouette"]["views"] == row["quartic"]["views"]
    assert row["silhouette"]["frames"] < row["quartic"]["frames"] / 3


def test_the_same_job_gives_the_same_row_to_the_bit(row):
    assert align_once(job()) == row


@pytest.mark.full
def test_the_same_jobs_give_the_same_rows_to_the_bit_in_two_other_processes():
    noise = {"joint_offset_sd": 0.004, "repeatability_sd": 0.0003, "pixel_sd": 0.008}
    jobs = {str(k): job(k=k, methods=["quartic", "silhouette", "stay"], noise=noise) for k in range(2)}
    here = run_jobs(align_once, jobs, progress=False)
    there = run_jobs(align_once, jobs, workers=2, progress=False)
    assert not any(result.failed for result in [*here.values(), *there.values()]), here
    assert here == there


def test_an_alligator_has_no_corners_and_no_true_sizes():
    found = align_once(job("alligator", methods=["quartic", "silhouette"]))
    assert found["quartic"]["homography"] is None
    assert "size_error_mm" not in found["silhouette"]


def test_the_cases_are_the_thesiss_and_a_tilted_one_of_each_object():
    assert {target for target, _ in CASES} == {"cuboid_1x1", "cuboid_1x2", "cuboid_1x4", "cylinder", "alligator"}
    assert all((target, place) in CASES for target, _ in CASES for place in ("flat", "raised", "tilted"))
    assert len(set(CASES)) == len(CASES) == 17


def test_a_place_that_cannot_be_reached_is_drawn_anew_and_twenty_of_them_are_an_error(monkeypatch):
    def refuse(cell, rng):
        raise GvpError("no start")

    monkeypatch.setattr(episodes, "draw_start", refuse)
    with pytest.raises(GvpError, match="no place within reach for 'cuboid_1x4' 'flat', start 0"):
        align_once(job())
