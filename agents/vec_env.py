"""The native batch as a Stable-Baselines3 `VecEnv`, and the reward's running scale."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from agents.tension_cost import TensionCost
from heave_env.env import HeaveVectorEnv, StepInfo
from heave_env.scenarios import Scenario


class HeaveVecEnv(VecEnv):
    """`HeaveVectorEnv` in SAME_STEP, as Stable-Baselines3 wants it.

    A finished row's `terminal_observation` and `TimeLimit.truncated` are in its info; rows that did not
    finish get an empty dictionary each, plus the environment's channels if its `info` is on. The rows
    live in one object: `get_attr`, `set_attr` and `env_method` reach that object and answer for each row.
    """

    def __init__(
        self, env: HeaveVectorEnv | Scenario | str | Path, num_envs: int | None = None, **options: Any
    ) -> None:
        """Wraps a batch, or builds one.

        Args:
            env: A batch in SAME_STEP, or the scenario to build one from (name, YAML file or object).
            num_envs: Rows of the batch to build; 1 if not given.
            **options: Further options of the `HeaveVectorEnv` to build.

        Raises:
            ValueError: If a given batch is not in SAME_STEP, or is given together with options.
        """
        if isinstance(env, (Scenario, str, Path)):
            options.setdefault("autoreset_mode", AutoresetMode.SAME_STEP)
            env = HeaveVectorEnv(env, 1 if num_envs is None else num_envs, **options)
        elif num_envs is not None or options:
            raise ValueError(
                "num_envs and options belong to a batch that HeaveVecEnv builds from a scenario; the batch "
                "given has its own"
            )
        mode = env.metadata.get("autoreset_mode")
        if mode != AutoresetMode.SAME_STEP:
            raise ValueError(
                f"Stable-Baselines3 wants autoreset_mode SAME_STEP, this batch has {mode}: build it with "
                "autoreset_mode=AutoresetMode.SAME_STEP"
            )
        self.env = env
        self.tension_cost: TensionCost | None = None
        """What is charged for high tensions on top of the task's cost."""
        self._actions: np.ndarray | None = None
        self._names: frozenset[str] = frozenset()
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def seed_rows(self, seeds: Sequence[int]) -> None:
        """Gives each row the sea of its own seed at the next reset.

        Raises:
            ValueError: If there is not one for each row.
        """
        if len(seeds) != self.num_envs:
            raise ValueError(f"{self.num_envs} rows want as many seeds, got {len(seeds)}")
        self._seeds = [int(seed) for seed in seeds]

    def reset(self) -> np.ndarray:
        """Begins an episode in every row and returns the observations."""
        seeds = None if self._seeds[0] is None else [int(seed) for seed in self._seeds if seed is not None]
        observation, info = self.env.reset(seed=seeds, options=self._options[0] or None)
        self._names = frozenset(key for key in info if not key.startswith("_"))
        self.reset_infos = self._info_rows(info)
        self._reset_seeds()
        self._reset_options()
        return observation

    def step_async(self, actions: np.ndarray) -> None:
        """Keeps the actions for `step_wait`."""
        self._actions = actions

    @property
    def actions(self) -> np.ndarray:
        """The actions last given, (n_envs, 1)."""
        assert self._actions is not None
        return np.asarray(self._actions, dtype=float).reshape(self.num_envs, 1)

    def step_wait(self) -> VecEnvStepReturn:
        """Steps the batch; rewards are float32, as Stable-Baselines3's buffers are."""
        observation, reward, terminated, truncated, info = self.env.step(self._actions)
        done = terminated | truncated
        if self.tension_cost is not None:  # a row that is done shows its next episode's rest
            reward = reward - np.where(done, 0.0, self.tension_cost.of(self.env))
        infos = self._info_rows(info)
        if np.count_nonzero(done):
            final = info.get("final_info", {})
            for row in np.flatnonzero(done):
                infos[row] = _info_row(final, int(row))
                infos[row]["terminal_observation"] = np.array(info["final_obs"][row])
                infos[row]["TimeLimit.truncated"] = bool(truncated[row] and not terminated[row])
        return observation, reward.astype(np.float32), done, infos

    def reset_rows(self, mask: np.ndarray) -> np.ndarray:
        """Begins the next episode of the masked rows at once, and returns all observations."""
        return self.env.reset_rows(mask)

    def close(self) -> None:
        """Closes the batch."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """The batch's attribute, once per row asked for."""
        value = getattr(self.env, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Sets the batch's attribute, which all rows share.

        Raises:
            ValueError: If only some of the rows are asked for.
        """
        if set(self._get_indices(indices)) != set(range(self.num_envs)):
            raise ValueError(f"the rows share {attr_name!r}: set it for all of them, with indices=None")
        setattr(self.env, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Calls the batch's method once; its result is repeated for each row asked for."""
        result = getattr(self.env, method_name)(*method_args, **method_kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(
        self, wrapper_class: type[gymnasium.Wrapper], indices: VecEnvIndices = None
    ) -> list[bool]:
        """No row is wrapped: there are no single environments inside."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[np.ndarray | None]:
        """One frame per row, or None where the batch renders none."""
        frames = self.env.render()
        if not isinstance(frames, (tuple, list)):
            return [None] * self.num_envs
        return list(frames)

    def _info_rows(self, info: dict[str, Any]) -> list[dict[str, Any]]:
        """A fresh dictionary per row; Stable-Baselines3 writes into them."""
        names = self._names
        if not names:
            return [{} for _ in range(self.num_envs)]
        diverged = info["diverged"].tolist()
        return [StepInfo.of(value, names, _info_row, info, row) for row, value in enumerate(diverged)]


def _info_row(info: dict[str, Any], row: int) -> dict[str, Any]:
    """One row of a dictionary of arrays, as plain numbers; absent entries are left out."""
    return {
        key: values[row].item() if isinstance(values, np.ndarray) and values.dtype != object else values[row]
        for key, values in info.items()
        if not key.startswith("_") and info.get(f"_{key}", _ALL)[row]
    }


class _All:
    def __getitem__(self, row: int) -> bool:
        return True


_ALL = _All()


_KNEE = 0.1  # of the mean cost: where the logarithm begins to be one
_OUTLIER = 20.0  # times the median; a squared Gaussian is beyond once in 400 draws


def _middle(values: np.ndarray) -> float:
    """The median, the upper of the two for an even number; several times faster than `np.median`."""
    half = len(values) // 2
    return float(np.partition(values, half)[half])


class ScaledReward(VecEnvWrapper):
    """Rewards less their running mean, over the running deviation of their discounted sum.

    A continuing task wants centred rewards, or the critic spends itself on a constant. Both
    statistics forget exponentially, since costs fall by orders of magnitude as an agent learns, and
    count outliers only up to a multiple of the median over the rows.

    Source: Naik et al. (2024), "Reward centering", for the mean; the scale is that of
    Stable-Baselines3's `VecNormalize`, forgetting added.
    """

    def __init__(
        self,
        venv: VecEnv,
        *,
        gamma: float,
        horizon: float = 500.0,
        bound: float = 2.0,
        burn_in: int = 0,
        logarithmic: bool = False,
    ) -> None:
        """Wraps a vector environment.

        Args:
            venv: The environments.
            gamma: Discount of the sum whose deviation is the scale [-].
            horizon: Steps of the batch over which the statistics forget [-].
            bound: Scaled rewards are cut off at ± this [-].
            burn_in: Steps after the beginning of an episode that earn nothing: how fast the start from
                rest dies out says little about the operation, and costs a thousand times more.
            logarithmic: Whether the logarithm of the stage cost is what is learned from, c to
                log(1 + c / (0.1 of its running mean)): where parameters are unknown a few rough episodes
                would rule the mean.
        """
        super().__init__(venv)
        self.gamma, self.horizon, self.bound, self.burn_in = gamma, horizon, bound, burn_in
        self.logarithmic = logarithmic
        self._returns, self._clipped = np.zeros(venv.num_envs), np.zeros(venv.num_envs)
        self._age = np.zeros(venv.num_envs, dtype=np.int64)
        self._mean, self._variance, self._weight = 0.0, 0.0, 0.0
        self._usual_cost = 0.0
        self._gathered_cost, self._gathered = 0.0, 0

    def reset(self) -> Any:
        """Begins an episode in every row; the statistics stay."""
        self.forget(np.ones(self.num_envs, dtype=bool))
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """Steps, then scales the rewards."""
        observation, reward, done, infos = self.venv.step_wait()
        raw = np.asarray(reward, dtype=np.float64)
        counted = self._age >= self.burn_in
        if counted.all():
            scaled = self._scaled(raw, slice(None))
        else:
            scaled = np.zeros(self.num_envs)
            rows = np.flatnonzero(counted)
            if len(rows):
                scaled[rows] = self._scaled(raw[rows], rows)
        self._age += 1
        if done.any():
            self.forget(done)
        return observation, scaled.astype(np.float32), done, infos

    def _scaled(self, raw: np.ndarray, rows: np.ndarray | slice) -> np.ndarray:
        n = len(raw)
        self._gathered_cost -= float(raw.sum()) / n
        self._gathered += 1
        # Debiased exponential averages: exact from the first step on.
        self._weight += (1.0 - self._weight) / self.horizon
        share = 1.0 / (self.horizon * self._weight)
        if self.logarithmic:
            cost = np.maximum(-raw, 0.0)
            usual_cost = float(np.minimum(cost, _OUTLIER * _middle(cost)).sum()) / n
            self._usual_cost += share * (usual_cost - self._usual_cost)
            raw = -np.log1p(cost / (_KNEE * self._usual_cost + 1e-300))
        # A row that has run wild must neither set the scale for the others nor rule the critic.
        usual = np.maximum(raw, -_OUTLIER * _middle(np.abs(raw)))
        self._mean += share * (float(usual.sum()) / n - self._mean)
        centred = raw - self._mean
        limit = self.bound * self.scale if self._variance > 0.0 else np.inf
        kept = np.minimum(np.maximum(centred, -limit), limit)
        self._clipped[rows] += kept > centred
        returns = self.gamma * self._returns[rows] + kept
        self._returns[rows] = returns
        squares = returns * returns
        usual = np.minimum(squares, _OUTLIER * _middle(squares))
        self._variance += share * (float(usual.sum()) / n - self._variance)
        kept /= (self._variance + 1e-12) ** 0.5
        return np.minimum(np.maximum(kept, -self.bound), self.bound)

    def gathered_cost(self) -> float:
        """Mean stage cost since this was last asked, burn-in left out [-]."""
        cost = self._gathered_cost / max(self._gathered, 1)
        self._gathered_cost, self._gathered = 0.0, 0
        return cost

    @property
    def mean_cost(self) -> float:
        """Running mean of what is learned from, the stage cost or its logarithm, outliers cut off [-]."""
        return -self._mean

    @property
    def scale(self) -> float:
        """What rewards are divided by [-]."""
        return float(self._variance**0.5)

    def forget(self, rows: np.ndarray) -> None:
        """Begins some rows anew, (n,) bool: they were given another episode."""
        self._returns[rows] = 0.0
        self._age[rows] = 0

    def wild_rows(self, n_steps: int) -> np.ndarray:
        """Rows whose reward was cut off in over half of the `n_steps` since last asked, (n,) bool."""
        wild = self._clipped > 0.5 * n_steps
        self._clipped[:] = 0.0
        return wild

    def get_state(self) -> dict[str, np.ndarray]:
        """Everything that the statistics remember."""
        numbers = (
            self._mean,
            self._variance,
            self._weight,
            self._gathered_cost,
            float(self._gathered),
            self._usual_cost,
        )
        return {
            "returns": self._returns.copy(),
            "clipped": self._clipped.copy(),
            "age": self._age.copy(),
            "statistics": np.array(numbers),
        }

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Takes up what `get_state` gave."""
        self._returns = np.array(state["returns"])
        self._clipped = np.array(state["clipped"])
        self._age = np.array(state["age"])
        numbers = [float(value) for value in state["statistics"]]
        self._mean, self._variance, self._weight, self._gathered_cost = numbers[:4]
        self._gathered, self._usual_cost = int(numbers[4]), numbers[5]
