"""Between the native batch and an algorithm: a guide's estimate for the actor, the truth for the critic.

Both only add columns to the observation: first what the sensors give, then the guide's features, then the
truth. Who acts must not see the truth: `agents.networks` gives it to the critic alone.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from agents.guide import Guide, Look
from agents.tension_cost import TensionCost
from agents.vec_env import HeaveVecEnv
from heave_env.env import HeaveVectorEnv
from heave_env.plant import truth_names
from heave_env.scenarios import Scenario

Array = np.ndarray


def _widened(space: gym.Space[Any], n_more: int) -> gym.spaces.Box:
    assert isinstance(space, gym.spaces.Box)
    more = np.full(n_more, np.inf, dtype=np.float32)
    return gym.spaces.Box(
        np.concatenate([space.low, -more]), np.concatenate([space.high, more]), dtype=np.float32
    )


class GuidedVecEnv(VecEnvWrapper):
    """A guide beside each row: its features join the observation, its command takes the agent's action."""

    def __init__(self, venv: VecEnv, guide: Guide) -> None:
        """Wraps a vector environment whose observations are the scenario's own."""
        super().__init__(venv, observation_space=_widened(venv.observation_space, len(guide.feature_names)))
        self.guide = guide
        self._memory = np.zeros((venv.num_envs, guide.n_memory))
        self._look: Look | None = None
        self._command: Array = np.zeros((venv.num_envs, 1))

    @property
    def command(self) -> Array:
        """The command last given [m], (n_envs, 1)."""
        return self._command

    @property
    def own_action(self) -> Array:
        """The action with which the agent would do as the guide, (n_envs, 1)."""
        assert self._look is not None
        return self.guide.action(self._look, self._look.command)

    def action_for(self, command: Array) -> Array:
        """The action that gives a command (n_envs, 1) [m], or does the same to the drum, (n_envs, 1)."""
        assert self._look is not None
        return self.guide.action(self._look, command)

    def _seen(self, observation: Array) -> Array:
        self._look = self.guide.look(observation, self._memory)
        return np.hstack([observation, self._look.features])

    def reset(self) -> Any:
        """Begins an episode in every row."""
        observation = np.asarray(self.venv.reset())
        self._memory[:] = 0.0
        return self._seen(observation)

    def reset_rows(self, mask: Array) -> Array:
        """Begins an episode in the masked rows; all observations."""
        observation = self.venv.reset_rows(mask)  # type: ignore[attr-defined]
        self._memory[mask] = 0.0
        return self._seen(observation)

    def step_async(self, actions: Array) -> None:
        """Turns the agent's actions into commands, which the guide is told."""
        assert self._look is not None
        self._command = self.guide.command(self._look, np.asarray(actions, dtype=float))
        self.venv.step_async((self._command / self.guide.controller.command_range).astype(np.float32))

    def step_wait(self) -> VecEnvStepReturn:
        """Steps; the guide looks at what came of it."""
        assert self._look is not None
        observation, reward, done, infos = self.venv.step_wait()
        observation = np.asarray(observation)
        self._memory = self.guide.advance(self._memory, self._look, self._command)
        if done.any():
            rows = np.flatnonzero(done)
            last = np.array([infos[row]["terminal_observation"] for row in rows])
            looks = self.guide.look(last, self._memory[rows])
            for row, seen in zip(rows, np.hstack([last, looks.features]), strict=True):
                infos[row]["terminal_observation"] = seen
            self._memory[rows] = 0.0
        return self._seen(observation), reward, done, infos

    def get_state(self) -> dict[str, Array]:
        """What the guide remembers."""
        return {"memory": self._memory.copy()}

    def set_state(self, state: dict[str, Array], observation: Array) -> None:
        """Takes up what `get_state` gave, and looks at the observation that was the last."""
        self._memory = np.array(state["memory"])
        n = self.venv.observation_space.shape
        assert n is not None
        self._look = self.guide.look(observation[:, : n[0]], self._memory)


class PrivilegedVecEnv(VecEnvWrapper):
    """The plant's true state and parameters behind the observation, for a critic.

    Source: Pinto et al. (2018), "Asymmetric actor critic".
    """

    def __init__(self, venv: VecEnv, batch: HeaveVectorEnv) -> None:
        """Wraps the environments of a batch."""
        super().__init__(
            venv, observation_space=_widened(venv.observation_space, len(truth_names(batch.scenario)))
        )
        self.batch = batch
        self._truth = np.zeros((venv.num_envs, len(truth_names(batch.scenario))), dtype=np.float32)

    def _with_truth(self, observation: Array) -> Array:
        self._truth = self.batch.plant.truth()
        return np.hstack([observation, self._truth])

    def reset(self) -> Any:
        """Begins an episode in every row."""
        return self._with_truth(np.asarray(self.venv.reset()))

    def reset_rows(self, mask: Array) -> Array:
        """Begins an episode in the masked rows; all observations."""
        return self._with_truth(self.venv.reset_rows(mask))  # type: ignore[attr-defined]

    def look_again(self) -> None:
        """Reads the truth of a batch whose state was set."""
        self._truth = self.batch.plant.truth()

    def step_wait(self) -> VecEnvStepReturn:
        """Steps. The truth of a row's last instant is gone with its plant: the step before's stands in."""
        before = self._truth
        observation, reward, done, infos = self.venv.step_wait()
        for row in np.flatnonzero(done):
            infos[row]["terminal_observation"] = np.hstack([infos[row]["terminal_observation"], before[row]])
        return self._with_truth(np.asarray(observation)), reward, done, infos


def guided_within(env: VecEnv) -> GuidedVecEnv | None:
    """The wrapper with a guide among an environment's own, if there is one."""
    while isinstance(env, VecEnvWrapper):
        if isinstance(env, GuidedVecEnv):
            return env
        env = env.venv
    return None


def command_given(env: VecEnv, command_range: float) -> Array:
    """The command that the plant was last given through `step_async` [m], (n_envs, 1)."""
    guided = guided_within(env)
    if guided is not None:
        return guided.command
    batch = env.unwrapped
    assert isinstance(batch, HeaveVecEnv)
    return np.clip(batch.actions, -1.0, 1.0) * command_range


def surroundings(
    scenario: Scenario,
    n_envs: int,
    guide: Guide | None,
    *,
    privileged: bool,
    tension_cost: TensionCost | None = None,
) -> tuple[HeaveVecEnv, HeaveVecEnv | GuidedVecEnv | PrivilegedVecEnv]:
    """The native batch, and what an algorithm meets: the batch with a guide and the truth, as asked for."""
    batch = HeaveVecEnv(scenario, n_envs, info=False, autoreset_mode=AutoresetMode.SAME_STEP)
    batch.tension_cost = tension_cost
    outer: HeaveVecEnv | GuidedVecEnv | PrivilegedVecEnv = batch
    if guide is not None:
        outer = GuidedVecEnv(outer, guide)
    if privileged:
        outer = PrivilegedVecEnv(outer, batch.env)
    return batch, outer
