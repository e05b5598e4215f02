"""Table 3.1: how episodes begin, what each method does, that no policy reads the truth, and what rows add up to."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from gvp_book.experiments import alignment
from gvp_book.experiments.alignment import METHODS, align_once, describe
from gvp_lib.errors import GvpError
from gvp_lib.evaluation import episodes
from gvp_lib.evaluation.baselines import LookDown, Oracle, Stay
from gvp_lib.evaluation.episodes import canonical_views, cell_of, draw_start, judge, run_episode
from gvp_lib.evaluation.metrics import viewpoint_error
from gvp_lib.motion.arm import Outcome
from gvp_lib.planning.image_moments import ImageMomentPlanner
from gvp_lib.planning.plan import Plan
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.truth import Truth
from gvp_lib.simulation.workcell import WorkCell

QUICK = {"step": 0.04, "max_angle": 0.5}


def job(target="cuboid_1x4", placement="flat", k=0, methods=METHODS, noise=None, **more):
    fields = {"target": target, "placement": placement, "noise": noise or {}, "seed": 3, "k": k}
    return {**fields, "methods": list(methods), "planner": QUICK, **more}


@pytest.fixture(scope="module")
def baxter():
    with WorkCell("baxter", "cuboid_1x2") as cell:
        yield cell


def start_of(cell, seed=0, **options):
    cell.reset(seed)
    return draw_start(cell, np.random.default_rng(seed), **options)


# A start


def test_starts_are_drawn_within_their_ranges_and_are_where_they_say(baxter):
    starts = []
    for seed in range(12):
        try:
            start = start_of(baxter, seed)
        except GvpError:
            continue  # here the Baxter does not reach the object from above
        starts.append(start)
        truth, camera = baxter.truth, start.world_from_camera
        np.testing.assert_allclose(truth.world_from_camera.as_matrix(), camera.as_matrix(), atol=1e-3)
        away = camera.translation - truth.world_from_object.translation
        assert np.linalg.norm(away) == pytest.approx(start.distance, abs=1e-6)
        assert np.arccos(away @ truth.normal.direction / start.distance) == pytest.approx(start.tilt, abs=1e-6)
        shown = baxter.arm.intrinsics.project(camera.inv().apply(truth.world_from_object.translation))
        np.testing.assert_allclose(shown, start.pixel, atol=1e-3)
    assert len(starts) >= 8
    tilts = np.degrees([start.tilt for start in starts])
    assert 10 <= tilts.min() < 20 < 30 < tilts.max() <= 40
    distances = [start.distance for start in starts]
    assert 0.25 <= min(distances) < 0.28 < 0.32 < max(distances) <= 0.35
    assert 20 < max(np.linalg.norm(s.pixel - baxter.arm.intrinsics.principal_point) for s in starts) <= 100
    assert 1 < max(start.tries for start in starts) <= 200  # not all can be reached
    assert 3 <= np.degrees(start_of(baxter, 1, tilt=(3.0, 5.0)).tilt) <= 5


def test_where_no_canonical_view_is_within_reach_there_is_no_start(baxter, monkeypatch):
    far = RigidTransform.from_translation([5.0, 0.0, 5.0])
    monkeypatch.setattr(episodes, "canonical_views", lambda cell, radius: [far])
    with pytest.raises(GvpError, match="the arm cannot reach a canonical view of the object where it stands"):
        start_of(baxter)
    # Such a place is drawn anew, but not forever.
    with pytest.raises(GvpError, match="no place within reach for 'cuboid_1x4' 'flat', start 0"):
        align_once(job())


def test_starts_are_the_same_for_every_method_and_every_noise():
    # What a start is drawn from; the draws that the arm's own error puts out of reach may differ.
    noisy = {"pixel_sd": 0.01, "exposure": 0.1}
    conditions = (({}, ["stay"]), ({}, ["oracle", "stay"]), (noisy, ["oracle"]))
    starts = [align_once(job(noise=noise, methods=methods))["start"] for noise, methods in conditions]
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
            assert max(error.total, abs(error.roll)) < 1e-6
            away = view.translation - cell.truth.world_from_object.translation
            assert np.linalg.norm(away) == pytest.approx(episodes.RADIUS)


# A judgement, and the baselines


def test_the_judge_says_the_true_error_in_degrees_and_the_simulated_time(baxter):
    start_of(baxter)
    before = viewpoint_error(baxter.truth)

    def wait(arm):
        baxter.data.time += 1.5
        return Plan(Outcome.ANY_ANGLE, frames=7)

    plan, judged = run_episode(baxter, SimpleNamespace(plan=wait))
    assert judged == judge(baxter, plan, 1.5)
    assert judged.total == pytest.approx(np.degrees(before.total))
    assert judged.total == pytest.approx(np.hypot(judged.about_x, judged.about_y))
    assert (judged.outcome, judged.frames, judged.views) == ("any angle", 7, 0)


@pytest.mark.parametrize(("placement", "error"), [("flat", (0, 1)), ("tilted", (10, 32))])
def test_to_look_down_is_right_for_what_stands_level_and_wrong_for_what_leans(placement, error):
    cell = cell_of(job("cuboid_1x2", placement))
    start_of(cell)
    assert LookDown(cell.segmenter).plan(cell.arm).outcome is Outcome.ALIGNED
    camera = cell.truth.world_from_camera
    assert -camera.rotation.as_matrix()[2, 2] > np.cos(np.radians(0.2))
    assert error[0] <= np.degrees(cell.truth.viewpoint_error()) <= error[1]
    if placement == "flat":
        assert abs(np.degrees(cell.truth.roll_error())) < 2
        away = camera.translation - cell.truth.world_from_object.translation
        assert np.linalg.norm(away) == pytest.approx(0.25, rel=0.08)


@pytest.mark.parametrize(("noise", "most"), [(Noise.none(), 0.01), (Noise(joint_offset_sd=np.radians(0.25)), 3)])
def test_to_know_leaves_the_arms_own_error_and_no_other(noise, most):
    with WorkCell("baxter", "cuboid_1x2", noise=noise) as cell:
        start_of(cell, 1)
        assert Oracle(cell).plan(cell.arm).outcome is Outcome.ALIGNED
        error = np.degrees(cell.truth.viewpoint_error())
        assert error < most
        assert bool(error > 0.02) is (noise != Noise.none())
        assert abs(np.degrees(cell.truth.roll_error())) < most


def test_a_baseline_that_sees_nothing_says_so():
    with WorkCell("floating", "cuboid_1x2") as cell:
        away = cell.truth.world_from_camera * RigidTransform.from_translation([2.0, 0.0, 0.0])
        for baseline in (Stay(cell.segmenter), LookDown(cell.segmenter)):
            cell.place_camera(away)
            plan = baseline.plan(cell.arm)
            assert (plan.outcome, plan.view) == (Outcome.TARGET_LOST, None)


# No truth for a policy


class Peeked(Exception):
    pass


@pytest.mark.parametrize("name", ["silhouette", pytest.param("ours", marks=pytest.mark.full), "stay", "look_down"])
def test_no_policy_but_the_oracle_reads_the_truth(name, monkeypatch):
    acting = []

    def read(own, truth):
        if acting:
            raise Peeked
        return own(truth)

    def watched(act):
        def run(*arguments, **options):
            acting.append(act)
            try:
                return act(*arguments, **options)
            finally:
                acting.pop()

        return run

    for member in ("world_from_object", "world_from_camera", "normal"):
        monkeypatch.setattr(Truth, member, property(partial(read, vars(Truth)[member].fget)))
    monkeypatch.setattr(ImageMomentPlanner, "conclude", watched(ImageMomentPlanner.conclude))
    for planner in (ImageMomentPlanner, Stay, LookDown, Oracle):
        monkeypatch.setattr(planner, "plan", watched(planner.plan))
    assert name in align_once(job(methods=["quartic", name] if name == "silhouette" else [name]))
    if name == "stay":
        with pytest.raises(Peeked):  # the guard bites
            align_once(job(methods=["oracle"]))


def test_an_alligator_has_no_corners_and_no_true_sizes():
    found = align_once(job("alligator", methods=["quartic", "silhouette"]))
    assert found["quartic"]["homography"] is None
    assert "size_error_mm" not in found["silhouette"]


# What rows add up to


def judged(total, **more):
    fields = {"outcome": "aligned", "total": total, "about_x": total, "about_y": 0.0, "roll": 1.0}
    return {**fields, "frames": 100, "views": 40, "seconds": 30.0, **more}


def rows(group, **methods):
    """Rows of one case, from the errors of each method, of which some may have fewer."""
    return {
        f"{group}/a/flat/{k}": {"start": {"tilt": 20.0}}
        | {name: judged(errors[k]) for name, errors in methods.items() if k < len(errors)}
        for k in range(len(methods["quartic"]))
    }


def test_a_description_counts_outcomes_and_averages_sizes_where_there_are_any():
    summary = describe([judged(2.0), judged(4.0, roll=-3.0, outcome="collision"), judged(6.0, about_x=-6.0)])
    assert summary["outcomes"] == {"aligned": 2, "collision": 1}
    assert (summary["error"].mean, summary["arrived"].n, summary["about_x"], summary["frames"]) == (4, 2, 4, 100)
    assert summary["roll"] == pytest.approx(5 / 3)
    assert "size_error_mm" not in summary
    some = describe([judged(1.0, homography=value) for value in (7.0, None, np.nan)] + [judged(1.0, roll=np.nan)])
    assert (some["homography"].n, some["homography"].mean, some["roll"]) == (1, 7, 1)  # a roll may be undefined


def test_methods_are_compared_on_episodes_that_both_have_and_sweeps_with_the_same_starts_unchanged(monkeypatch):
    monkeypatch.setattr(alignment, "_floors", dict)  # which depend on no episode, and take seconds
    given = rows("thesis", quartic=[9.0, 5.0, 50.0], silhouette=[1.0, 1.0], ours=[2.0])
    content = alignment.report(given | rows("step=40mm", quartic=[10.0] * 2))
    ((case, summary),) = content["summary"].items()
    assert case == "thesis/a/flat"
    assert (summary["quartic - silhouette"].mean, summary["silhouette - ours"].mean) == (6, -1)
    assert (summary["quartic"]["error"].n, summary["silhouette"]["error"].n) == (3, 2)
    ((case, sweep),) = content["sweeps"].items()
    assert case == "step=40mm/a/flat"
    assert sweep["quartic"]["error"].mean == 10
    assert (sweep["unchanged"]["quartic"]["error"].n, sweep["unchanged"]["quartic"]["error"].mean) == (2, 7)
