"""The thesis's state, action and reward, as Gymnasium wants an environment."""

import subprocess
import sys
import warnings
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import gvp_lib
from gvp_lib.errors import GvpError, InvalidParameterError, UnknownNameError
from gvp_lib.learning.environment import ENV_ID, PARTS, Outcome, ViewpointEnv, oracle_policy, random_policy, rollout
from gvp_lib.learning.recipe import Variation
from gvp_lib.motion.arm import Motion, StopReason
from gvp_lib.perception.images import shrunk
from gvp_lib.perception.segmentation import HsvThreshold
from gvp_lib.planning.plan import Action
from gvp_lib.simulation.objects import OBJECTS
from gvp_lib.simulation.sensors import Noise

STEP = np.radians(5)
WORST = STEP / np.sqrt(2)  # what four moves of a step leave at worst (errata 17)


def floating(**options):
    return ViewpointEnv(arm="floating", **options)


def made(**options):
    return gymnasium.make(ENV_ID, **{"arm": "floating"} | options)


@pytest.fixture
def env():
    env = floating()
    yield env
    env.close()


@pytest.mark.parametrize(
    "options", [{}, {"observe": PARTS, "frames": 3, "render_view": "camera"}], ids=["image", "all"]
)
def test_gymnasium_has_nothing_to_say_against_it(options):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(made(render_mode="rgb_array", **options).unwrapped)


def test_gymnasium_finds_it_by_its_module_without_torch():
    program = (
        "import gymnasium, sys, gvp_lib.learning.environment\n"
        f"print(gymnasium.make('gvp_lib.learning.environment:{ENV_ID}', arm='floating').spec, 'torch' in sys.modules)"
    )
    said = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert f"id='{ENV_ID}'" in said
    assert "max_episode_steps=50" in said
    assert said.endswith("False\n")
    assert gvp_lib.ViewpointEnv is ViewpointEnv


def test_gymnasium_cuts_it_off_after_so_many_steps():
    env = made(max_episode_steps=2)
    env.reset(seed=0)
    assert env.step(Action.UP)[2:4] == (False, False)
    *_, terminated, truncated, info = env.step(Action.DOWN)
    assert (terminated, truncated, info["outcome"]) == (False, True, "under way")


@pytest.mark.parametrize(
    ("options", "shape"),
    [
        ({}, (64, 64, 3)),
        ({"size": 32, "crop": 240}, (32, 32, 3)),
        ({"frames": 2}, (2, 64, 64, 3)),
        ({"crop": None, "size": None}, (480, 640, 3)),
        ({"crop": None}, (64, 85, 3)),
        ({"observe": "believed_pose"}, (9,)),
        ({"observe": ["true_pose"]}, (9,)),
        ({"observe": ("object_pose",)}, (9,)),
    ],
)
def test_one_part_of_the_state_is_a_box_that_holds_what_is_observed(options, shape):
    env = floating(**options)
    seen = [env.reset(seed=1)[0], *(env.step(action)[0] for action in (Action.LEFT, Action.UP, Action.NO_OP))]
    assert env.observation_space.shape == shape
    assert all(env.observation_space.contains(each) for each in seen)


def test_several_parts_are_a_dictionary_in_the_order_asked_for():
    env = floating(observe=("object_pose", "image"))
    observation, _ = env.reset(seed=1)
    assert list(observation) == ["object_pose", "image"]
    assert env.observation_space.contains(observation)
    assert env.observation_space.contains(env.step(Action.UP)[0])


def test_the_picture_is_what_a_data_set_would_show_of_what_the_camera_sees():
    env = floating(render_mode="rgb_array", render_view="camera")
    image, _ = env.reset(seed=1)
    np.testing.assert_array_equal(image, shrunk(env.render(), 128, 64))
    image, *_ = env.step(Action.UP)
    np.testing.assert_array_equal(image, shrunk(env.render(), 128, 64))


def test_the_last_pictures_come_oldest_first_and_the_first_stands_for_those_before_it():
    one, three = floating(), floating(frames=3)
    (a, _), (stack, _) = one.reset(seed=2), three.reset(seed=2)
    np.testing.assert_array_equal(stack, [a, a, a])
    b = one.step(Action.UP)[0]
    np.testing.assert_array_equal(three.step(Action.UP)[0], [a, a, b])
    c = one.step(Action.LEFT)[0]
    np.testing.assert_array_equal(three.step(Action.LEFT)[0], [a, b, c])
    np.testing.assert_array_equal(three.step(Action.NO_OP)[0], [a, b, c])  # it takes no picture
    assert not np.array_equal(a, b)


def test_poses_are_the_truth_and_what_the_arm_believes():
    env = ViewpointEnv(arm="ur5e", observe=("believed_pose", "true_pose", "object_pose"), noise=Noise.thesis())
    poses, info = env.reset(seed=4)
    camera, thing = env._cell.truth.world_from_camera, env._cell.truth.world_from_object
    for pose, told in ((camera, poses["true_pose"]), (thing, poses["object_pose"])):
        np.testing.assert_allclose(told[:3], pose.translation, atol=1e-6)
        np.testing.assert_allclose(told[3:].reshape(2, 3), pose.rotation.as_matrix().T[:2], atol=1e-6)
    apart = np.linalg.norm(poses["believed_pose"][:3] - poses["true_pose"][:3])
    assert 1e-4 < apart < 0.03
    distance = np.linalg.norm(poses["true_pose"][:3] - poses["object_pose"][:3])
    assert distance == pytest.approx(0.5, abs=0.02)
    assert env.step(info["best_action"])[4]["outcome"] == "under way"


def test_the_same_seed_is_the_same_episode_and_another_moves_the_object_and_turns_it():
    env = floating(observe=("image", "object_pose"), noise=Noise.thesis(), variation=Variation(light=0.3, table=1.0))

    def episode(seed):
        seen, _ = env.reset(seed=seed)
        return [seen, *(env.step(action)[0] for action in (Action.UP, Action.RIGHT))]

    first, other, again = episode(5), episode(6), episode(5)
    for one, two in zip(first, again, strict=True):
        for part in one:
            np.testing.assert_array_equal(one[part], two[part])
    moved, turned = first[0]["object_pose"] - other[0]["object_pose"], first[0]["object_pose"][3:6]
    assert np.linalg.norm(moved[:2]) > 0.005
    assert turned @ other[0]["object_pose"][3:6] < 0.999
    following = env.reset()[0]["object_pose"]
    assert not np.allclose(following, first[0]["object_pose"])


def test_a_picture_of_the_episode_does_not_change_it():
    plain, watched = floating(noise=Noise.thesis()), floating(noise=Noise.thesis(), render_mode="rgb_array")
    plain.reset(seed=3)
    watched.reset(seed=3)
    assert watched.render().shape == (480, 640, 3)
    np.testing.assert_array_equal(plain.step(Action.UP)[0], watched.step(Action.UP)[0])
    assert plain.render() is None


def test_starts_are_uniform_in_area_over_the_cap_and_centered():
    env = floating(observe="object_pose", max_tilt=np.radians(20))
    rises = []
    for _ in range(60):
        _, info = env.reset(seed=None if rises else 0)
        rises.append((1 - np.cos(info["viewpoint_error"])) / (1 - np.cos(np.radians(20))))
        u, v = env._cell.arm.intrinsics.project(
            (env._cell.truth.world_from_camera.inv() * env._cell.truth.world_from_object).translation
        )
        assert np.hypot(u - 319.5, v - 239.5) < 12  # the silhouette's centroid is not the center's projection
    assert np.mean(rises) == pytest.approx(0.5, abs=0.12)
    assert max(rises) > 0.9


def test_the_reward_is_minus_the_error_that_the_label_foretells(env):
    _, info = env.reset(seed=7)
    for _ in range(3):
        before = info["viewpoint_error"]
        _, reward, _, _, info = env.step(info["best_action"])
        assert reward == -info["viewpoint_error"]
        assert before - info["viewpoint_error"] == pytest.approx(STEP, abs=STEP / 2)


def test_progress_adds_up_to_the_error_that_is_gone_while_errors_pay_for_stopping_at_once():
    by_error, by_progress = (rollout(made(reward=kind), oracle_policy, seed=8) for kind in ("error", "progress"))
    start, end = by_error.errors[[0, -1]]
    assert start > 3 * STEP
    assert by_progress.returned() == pytest.approx(start - end)
    assert by_error.returned() < -start  # what NO_OP would have had as the first action
    assert by_error.returned(discount=0) > -start


def test_no_op_ends_it_and_is_a_success_within_the_threshold(env):
    _, info = env.reset(seed=7)
    far = env.step(Action.NO_OP)
    assert far[1:4] == (-info["viewpoint_error"], True, False)
    assert (far[4]["outcome"], far[4]["success"]) == ("stopped", False)
    with pytest.raises(GvpError, match=r"no episode is under way; call reset\(\)"):
        env.step(Action.UP)
    generous = floating(rew_thresh=np.radians(40))
    generous.reset(seed=7)
    assert generous.step(Action.NO_OP)[4]["success"] is True


@pytest.mark.parametrize(("kind", "least"), [("error", -np.pi), ("progress", -np.pi)])
def test_a_step_that_fails_ends_it_and_counts_as_the_worst_error(monkeypatch, kind, least):
    env = floating(reward=kind)
    _, info = env.reset(seed=7)
    stuck = Motion(False, StopReason.JOINT_LIMIT)
    monkeypatch.setattr(env._cell.arm, "move_camera", lambda _: stuck)
    _, reward, terminated, _, after = env.step(Action.UP)
    assert (terminated, after["outcome"], after["success"]) == (True, Outcome.JOINT_LIMIT, False)
    assert reward == pytest.approx(least + (info["viewpoint_error"] if kind == "progress" else 0))
    assert after["viewpoint_error"] == info["viewpoint_error"]


def test_an_object_out_of_sight_is_lost(monkeypatch, env):
    env.reset(seed=7)
    monkeypatch.setattr(env._cell.arm, "capture", lambda: np.zeros((480, 640, 3), np.uint8))
    *_, terminated, _, info = env.step(Action.UP)
    assert (terminated, info["outcome"]) == (True, "target lost")


def test_every_reason_for_which_a_motion_stops_is_an_outcome():
    assert all(Outcome(reason.value).failed for reason in StopReason if reason is not StopReason.REACHED)


def test_a_start_out_of_reach_is_drawn_again(monkeypatch):
    env = ViewpointEnv(arm="ur5e", max_tilt=np.radians(80))
    tried, place = [], env._cell.place_camera
    monkeypatch.setattr(env._cell, "place_camera", lambda pose: (tried.append(pose), place(pose)))
    for seed in range(3):
        assert env.reset(seed=seed)[1]["outcome"] == "under way"
    assert len(tried) > 3


def test_where_no_start_will_do_the_error_says_what_might(monkeypatch):
    env = floating(max_tilt=np.radians(20))
    monkeypatch.setattr(env, "_took_up", lambda _: Outcome.TARGET_LOST)
    with pytest.raises(GvpError, match=r"could be taken up by the arm 'floating'.*up to 20 deg.*smaller radius"):
        env.reset()


def test_after_a_reset_that_failed_no_episode_is_under_way(monkeypatch, env):
    env.reset(seed=7)
    blind = property(lambda cell: lambda rgb: np.zeros(rgb.shape[:2], bool))
    monkeypatch.setattr(type(env._cell), "segmenter", blind)
    with pytest.raises(GvpError, match="Does the segmenter find the object"):
        env.reset()
    with pytest.raises(GvpError, match=r"no episode is under way; call reset\(\)"):
        env.step(Action.UP)
    monkeypatch.undo()
    assert env.reset(seed=7)[1]["outcome"] == "under way"


@pytest.mark.full
def test_an_object_of_another_color_than_its_segmenter_s_is_not_found_at_reset():
    unseen = replace(OBJECTS["cuboid_1x2"], segmenter=HsvThreshold(hue=(80, 140)))  # greens; the brick is blue
    env = floating(target=unseen)
    with pytest.raises(GvpError, match="Does the segmenter find the object"):
        env.reset(seed=7)
    env.close()


def test_the_oracle_ends_within_what_four_moves_leave_and_beats_chance():
    for kind in ("error", "progress"):
        env, chance = made(reward=kind), random_policy(0)
        known = [rollout(env, oracle_policy, seed) for seed in range(5)]
        drawn = [rollout(env, chance, seed) for seed in range(5)]
        assert all(episode.outcome == "stopped" and episode.success for episode in known)
        assert max(episode.errors[-1] for episode in known) < WORST + np.radians(0.5)
        assert np.mean([e.errors[-1] for e in known]) < 0.3 * np.mean([e.errors[-1] for e in drawn])
        assert np.mean([e.returned() for e in known]) > np.mean([e.returned() for e in drawn]) + np.radians(10)


def test_the_oracle_does_so_on_an_arm_with_the_thesis_s_noise():
    env = made(arm="ur5e", noise=Noise.thesis())
    for seed in range(2):
        episode = rollout(env, oracle_policy, seed)
        assert episode.outcome == "stopped"
        assert episode.errors[-1] < WORST + np.radians(0.5)
        assert len(episode.errors) == len(episode.actions) + 1 == len(episode.rewards) + 1


def test_objects_of_other_sizes_and_places_on_other_blocks_are_drawn_too():
    env = floating(observe="object_pose", placement="tilted", variation=Variation(size=0.2))
    widths = []
    for seed in range(3):
        env.reset(seed=seed)
        geoms = env._cell.model.geom_bodyid == env._cell.target_body
        widths.append(env._cell.model.geom_size[geoms].max())
    assert len(set(widths)) == 3


def test_two_at_a_time_are_two_different_episodes_and_the_same_as_one_by_one():
    envs = gymnasium.make_vec(ENV_ID, num_envs=2, vectorization_mode="sync", arm="floating")
    images, infos = envs.reset(seed=[1, 2])
    assert images.shape == (2, 64, 64, 3)
    assert not np.array_equal(images[0], images[1])
    single = made()
    for k, seed in enumerate((1, 2)):
        np.testing.assert_array_equal(images[k], single.reset(seed=seed)[0])
    _, rewards, ended, _, after = envs.step(infos["best_action"])
    np.testing.assert_array_equal(rewards, -after["viewpoint_error"])
    assert not ended.any()
    _, _, ended, _, after = envs.step(np.array([Action.NO_OP, Action.UP]))
    assert ended.tolist() == [True, False]
    assert after["outcome"].tolist() == ["stopped", "under way"]
    envs.close()


@pytest.mark.parametrize(
    ("options", "error", "said"),
    [
        (
            {"observe": ("image", "imge")},
            UnknownNameError,
            r"no part of an observation named 'imge'.*Did you mean 'image'",
        ),
        ({"observe": ()}, InvalidParameterError, r"one or more different parts, of image.*got \[\]"),
        ({"observe": ("image", "image")}, InvalidParameterError, "different parts"),
        ({"frames": 0}, InvalidParameterError, "frames is a whole number, 1 or more; got 0"),
        ({"size": 7.5}, InvalidParameterError, "size is a whole number, 8 or more; got 7.5"),
        ({"crop": 481}, InvalidParameterError, "a crop of 481 px is larger than the picture, which is 640 x 480"),
        ({"step": 5}, InvalidParameterError, r"step is in radians.*got 5.*np.radians"),
        ({"rew_thresh": 5}, InvalidParameterError, r"rew_thresh is in radians.*got 5.*np.radians"),
        ({"off_center": -1}, InvalidParameterError, "off_center is in px, from 0 to 200.*got -1"),
        ({"radius": 0}, InvalidParameterError, "radius is from 0.05 to 2.0; got 0"),
        ({"arm": "ur5"}, UnknownNameError, "no arm named 'ur5'"),
        ({"reward": "errors"}, UnknownNameError, "no reward named 'errors'.*Known: error, progress"),
        ({"render_mode": "human"}, UnknownNameError, "no render mode named 'human'.*Known: rgb_array"),
        ({"render_view": "hand"}, UnknownNameError, "Known: camera, overview"),
    ],
)
def test_what_makes_no_environment_is_refused_with_what_would(options, error, said):
    with pytest.raises(error, match=said):
        ViewpointEnv(**{"arm": "floating"} | options)


def test_misuse_of_an_environment_is_refused(env):
    with pytest.raises(GvpError, match=r"call reset\(\)"):
        env.step(Action.UP)
    with pytest.raises(InvalidParameterError, match=r"reset takes no options; got \{'tilt': 0.1\}"):
        env.reset(options={"tilt": 0.1})
    env.reset(seed=0)
    with pytest.raises(InvalidParameterError, match=r"0 \(UP\), .* 4 \(NO_OP\); got 5"):
        env.step(5)
    with pytest.raises(GvpError, match="taken no picture yet"):
        floating(render_mode="rgb_array", render_view="camera").render()
    env.close()
    env.close()
