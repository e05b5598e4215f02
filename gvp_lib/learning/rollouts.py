"""Policies that frame every other, one that knows nothing and one that knows all, and episodes of any."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from gvp_lib.planning.learned import Action

__all__ = ["Policy", "Rollout", "oracle_policy", "random_policy", "rollout"]

Policy = Callable[[Any, dict[str, Any]], int]
"""From an observation and an info to a number of :class:`Action`. What is to be deployed looks at the first alone."""


def oracle_policy(observation: Any, info: dict[str, Any]) -> int:
    """The label of the viewpoint: the action with the largest reward (thesis 2.4.2), by the truth."""
    return int(info["best_action"])


def random_policy(rng: np.random.Generator | int) -> Policy:
    """Each of the five actions as likely as any other; ``rng`` is a generator, or a seed."""
    generator = np.random.default_rng(rng)

    def policy(observation: Any, info: dict[str, Any]) -> int:
        return int(generator.integers(len(Action)))

    return policy


@dataclass(frozen=True, eq=False)
class Rollout:
    """One episode.

    Attributes
    ----------
    actions, rewards
        Shape (n,), rewards in rad.
    errors
        Viewpoint error at the start and after each action, shape (n + 1,), rad.
    outcome
        Why it ended; ``"under way"`` where it was truncated.
    success
        Whether it was stopped within the environment's threshold.
    """

    actions: NDArray[np.int64]
    rewards: NDArray[np.float64]
    errors: NDArray[np.float64]
    outcome: str
    success: bool

    def returned(self, discount: float = 1.0) -> float:
        """Sum of the rewards, each discounted once for every action before it, rad."""
        return float(self.rewards @ discount ** np.arange(len(self.rewards)))


def rollout(env: gymnasium.Env[Any, Any], policy: Policy, seed: int | None = None) -> Rollout:
    """Let a policy act for one episode.

    Parameters
    ----------
    env
        A :class:`ViewpointEnv`; from :func:`gymnasium.make`, so that an episode ends that nobody stops.
    policy
        What to do.
    seed
        Of the episode; None: the next one.

    Examples
    --------
    >>> from gvp_lib.learning.environment import ENV_ID
    >>> env = gymnasium.make(ENV_ID, arm="floating")
    >>> episode = rollout(env, oracle_policy, seed=3)
    >>> episode.outcome, episode.success, len(episode.errors) - len(episode.actions)
    ('stopped', True, 1)
    >>> env.close()
    """
    observation, info = env.reset(seed=seed)
    actions: list[int] = []
    rewards: list[float] = []
    errors = [info["viewpoint_error"]]
    over = False
    while not over:
        actions.append(policy(observation, info))
        observation, reward, terminated, truncated, info = env.step(actions[-1])
        rewards.append(float(reward))
        errors.append(info["viewpoint_error"])
        over = terminated or truncated
    return Rollout(np.array(actions), np.array(rewards), np.array(errors), str(info["outcome"]), info["success"])
