"""The thesis's state, action and reward, as Gymnasium wants an environment."""

import subprocess
import sys
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from gvp_lib.errors import GvpError, InvalidParameterError
from gvp_lib.learning.environment import ENV_ID, PARTS, ViewpointEnv
from gvp_lib.learning.recipe import Variation
from gvp_lib.motion.arm import Motion, Outcome
from gvp_lib.perception.images import crop_and_resize
from gvp_lib.planning.plan import Action
from gvp_lib.simulation.sensors import Noise

STEP = np.radians(5)
WORST = STEP / np.sqrt(2)  # what four moves of a step leave at worst (errata 17)


def floating(**options):
    return ViewpointEnv(arm="floating", **options)


def made(**options):
    return gymnasium.make(ENV_ID, **{"arm": "floating"} | options)


def episode(env, seed):
    """Viewpoint errors at the start and after each of the best actions, the rewards, and the last info."""
    info = env.reset(seed=seed)[1]
    errors, rewards, over = [info["viewpoint_error"]], [], False
    while not over:
        _, reward, terminated, truncated, info = env.step(info["best_action"])
        errors.append(info["viewpoint_error"])
        rewards.append(reward)
        over = terminated or truncated
    return np.array(errors), np.array(rewards), info


ALL = {
    "observe": PARTS,
    "crop": None,
    "render_view": "camera",
    "noise": Noise.thesis(),
    "variation": Variation(light=0.3, table=1),
}


@pytest.mark.parametrize("options", [{}, ALL], ids=["image", "all"])
def test_gymnasium_has_nothing_to_say_against_it(options):  # by seeds, too, which decide all that is observed
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(made(render_mode="rgb_array", **options).unwrapped)


def test_gymnasium_finds_it_by_its_module_without_torch():
    program = (
        "import gymnasium, sys\n"
        f"print(gymnasium.make('gvp_lib.learning.environment:{ENV_ID}', arm='floating').spec, 'torch' in sys.modules)"
    )
    said = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert "max_episode_steps=50" in said
    assert said.endswith("False\n")


VECTORS = """
from functools import partial
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv
from gvp_lib import GvpError, ViewpointEnv

make = [partial(ViewpointEnv, arm="floating")]
images, _ = SyncVectorEnv(make).reset(seed=1)
for context in ("fork", "spawn"):
    env = AsyncVectorEnv(make, context=context)
    env.reset_async(seed=1)
    try: print((env.reset_wait(timeout=60)[0] == images).all())
    except GvpError as error: print(type(error).__name__, error)
    env.close(terminate=True)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="a fork is not the way of macOS")
def test_several_in_processes_of_their_own_show_the_same_by_spawn_and_a_fork_after_drawing_is_refused():
    ran = subprocess.run([sys.executable, "-c", VECTORS], capture_output=True, text=True, check=True)
    forked, spawned = ran.stdout.splitlines()
    assert forked.startswith("GvpError this process was forked from one that had drawn")
    assert 'AsyncVectorEnv(..., context="spawn")' in forked
    assert spawned == "True"


def test_the_picture_is_what_a_data_set_would_show_of_what_the_camera_sees_and_to_render_changes_nothing():
    options = {"noise": Noise.thesis(), "render_view": "camera"}
    plain, env = floating(**options), floating(render_mode="rgb_array", **options)
    with pytest.raises(GvpError, match="taken no picture yet"):
        env.render()
    np.testing.assert_array_equal(env.reset(seed=1)[0], plain.reset(seed=1)[0])
    assert env.render().shape == (480, 640, 3)
    image, *_ = env.step(Action.UP)
    np.testing.assert_array_equal(image, plain.step(Action.UP)[0])
    np.testing.assert_array_equal(image, crop_and_resize(env.render(), 128, 64))
    assert plain.render() is None


def test_several_parts_are_a_dictionary_in_the_order_asked_for_and_poses_the_truth_or_the_arm_s_belief():
    parts = ("object_pose", "believed_pose", "true_pose")
    env = ViewpointEnv(arm="ur5e", observe=parts, noise=Noise.thesis())
    poses, _ = env.reset(seed=4)
    assert tuple(poses) == parts
    assert env.observation_space.contains(poses)
    truth = env._cell.truth
    for pose, part in ((truth.world_from_camera, "true_pose"), (truth.world_from_object, "object_pose")):
        np.testing.assert_allclose(poses[part][:3], pose.translation, atol=1e-6)
        np.testing.assert_allclose(poses[part][3:].reshape(2, 3), pose.rotation.as_matrix().T[:2], atol=1e-6)
    assert 1e-4 < np.linalg.norm(poses["believed_pose"][:3] - poses["true_pose"][:3]) < 0.03
    assert np.linalg.norm(poses["true_pose"][:3] - poses["object_pose"][:3]) == pytest.approx(0.5, abs=0.02)


def test_starts_are_uniform_in_area_over_the_cap_and_centered_and_the_object_is_moved_and_turned():
    env = floating(observe="object_pose", max_tilt=np.radians(20))
    rises, poses = [], []
    for _ in range(60):
        pose, info = env.reset(seed=None if rises else 0)
        poses.append(pose)
        rises.append((1 - np.cos(info["viewpoint_error"])) / (1 - np.cos(np.radians(20))))
        truth = env._cell.truth
        camera_from_object = truth.world_from_camera.inv() * truth.world_from_object
        u, v = env._cell.arm.intrinsics.project(camera_from_object.translation)
        assert np.hypot(u - 319.5, v - 239.5) < 12  # the silhouette's centroid is not the center's projection
    assert np.mean(rises) == pytest.approx(0.5, abs=0.12)
    assert max(rises) > 0.9
    assert (np.std(poses, axis=0)[[0, 1, 3, 4]] > [0.005, 0.005, 0.1, 0.1]).all()


def test_a_start_out_of_reach_is_drawn_again(monkeypatch):
    env = ViewpointEnv(arm="ur5e", max_tilt=np.radians(80))
    tried, place = [], env._cell.place_camera
    monkeypatch.setattr(env._cell, "place_camera", lambda pose: (tried.append(pose), place(pose)))
    for seed in range(3):
        env.reset(seed=seed)
    assert len(tried) > 3


def test_objects_of_other_sizes_and_places_on_other_blocks_are_drawn_too():
    env = floating(observe="object_pose", placement="tilted", variation=Variation(size=0.2))
    widths = set()
    for seed in range(3):
        env.reset(seed=seed)
        widths.add(env._cell.model.geom_size[env._cell.model.geom_bodyid == env._cell.target_body].max())
    assert len(widths) == 3


def test_where_no_start_will_do_the_error_says_what_might_and_no_episode_is_under_way(monkeypatch):
    env = floating()
    env.reset(seed=7)
    blind = property(lambda cell: lambda rgb: np.zeros(rgb.shape[:2], bool))
    monkeypatch.setattr(type(env._cell), "segmenter", blind)
    with pytest.raises(GvpError, match=r"taken up by the arm 'floating'.*up to 30 deg.*Does the segmenter find"):
        env.reset()
    with pytest.raises(GvpError, match=r"no episode is under way; call reset\(\)"):
        env.step(Action.UP)


def test_a_reward_is_minus_the_error_or_its_progress_and_the_label_foretells_it():
    errors, costs, _ = episode(made(), 8)
    again, gains, _ = episode(made(reward="progress"), 8)
    np.testing.assert_array_equal(errors, again)
    np.testing.assert_array_equal(costs, -errors[1:])
    np.testing.assert_array_equal(gains, -np.diff(errors))
    np.testing.assert_allclose(gains[:3], STEP, atol=STEP / 2)


@pytest.mark.parametrize(("rew_thresh", "success"), [(np.radians(5), False), (np.radians(40), True)])
def test_no_op_ends_it_and_is_a_success_within_the_threshold(rew_thresh, success):
    env = floating(rew_thresh=rew_thresh)
    error = env.reset(seed=7)[1]["viewpoint_error"]
    _, *ended, info = env.step(Action.NO_OP)
    assert ended == [-error, True, False]
    assert (info["outcome"], info["success"]) == ("aligned", success)


@pytest.mark.parametrize(
    ("reward", "method", "result", "outcome"),
    [
        ("error", "move_camera", Motion(False, Outcome.JOINT_LIMIT), "joint limit"),
        ("progress", "capture", np.zeros((480, 640, 3), np.uint8), "target lost"),
    ],
)
def test_a_step_that_fails_or_loses_the_object_ends_it_and_counts_as_the_worst_error(
    reward, method, result, outcome, monkeypatch
):
    env = floating(reward=reward)
    _, info = env.reset(seed=7)
    monkeypatch.setattr(env._cell.arm, method, lambda *_: result)
    _, paid, terminated, _, after = env.step(Action.UP)
    assert (terminated, after["outcome"], after["success"]) == (True, outcome, False)
    assert paid == pytest.approx(-np.pi + (info["viewpoint_error"] if reward == "progress" else 0))


@pytest.mark.parametrize(("options", "seeds"), [({}, 5), ({"arm": "ur5e", "noise": Noise.thesis()}, 2)])
def test_the_oracle_ends_within_what_four_moves_leave(options, seeds):
    for seed in range(seeds):
        errors, _, info = episode(made(**options), seed)
        assert (info["outcome"], info["success"]) == ("aligned", True)
        assert errors[-1] < WORST + np.radians(0.5)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"observe": ("image", "imge")}, r"no part of an observation named 'imge'.*Did you mean 'image'"),
        ({"observe": ()}, r"one or more different parts of image.*got \(\)"),
        ({"size": 7.5}, "size is a whole number of px, or None for no resizing; got 7.5"),
        ({"size": 7}, "size is from 8 to 4096 px; got 7"),
        ({"crop": 481}, "a crop of 481 px is larger than the picture, which is 640 x 480"),
        ({"rew_thresh": 5}, r"rew_thresh is from 0 to 3.142 rad.*np.radians.* got 5"),
        ({"render_mode": "human"}, "no render mode named 'human'.*Known: rgb_array"),
    ],
)
def test_what_makes_no_environment_is_refused_with_what_would(options, said):
    with pytest.raises(GvpError, match=said):
        ViewpointEnv(**{"arm": "floating"} | options)


def test_misuse_of_an_environment_is_refused():
    env = floating()
    with pytest.raises(InvalidParameterError, match=r"reset takes no options.*got \{'tilt': 0.1\}"):
        env.reset(options={"tilt": 0.1})
    with pytest.raises(InvalidParameterError, match=r"0 \(UP\), .* 4 \(NO_OP\); got 5"):
        env.step(5)
    env.close()
    env.close()  # which nothing forbids
