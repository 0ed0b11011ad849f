"""`HeaveTorchVectorEnv`: the batch on a GPU, torch tensors in and out.

What it returns are views of the plant's own arrays on the device, so nothing is copied and nothing waits.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from heave_env.env import action_space, chosen_scenario, observation_space
from heave_env.gpu.plant import GpuPlant
from heave_env.layout import CHANNEL_NAMES
from heave_env.plant import channel_names
from heave_env.scenarios import Scenario

if TYPE_CHECKING:
    import torch

STATE_BUFFERS = (
    *("counters", "clock", "channels", "filter", "components", "draws", "commands", "samples"),
    *("displacement", "velocity", "observation", "fixed", "sea", "readings"),
)
"""Arrays of the device that a batch's future depends on."""


class HeaveTorchVectorEnv(gym.vector.VectorEnv):
    """`HeaveVectorEnv` with tensors of one device: same seeds, same rows, same-step autoreset.

    Row i of a batch seeded s is the single environment seeded s + i, within rounding. Observations,
    rewards and flags are the batch's own tensors, **rewritten by the next step: clone what is to be kept**.
    Rows that finish begin their next episode within the step; `info["final_obs"]` then holds what they saw
    last, in the rows that `info["_final_obs"]` (terminated or truncated) says. On a CUDA device the step is
    one CUDA graph, unless the scenario draws parameters for each episode (`uncertainty`): those the
    processor draws, waiting for the device to know which rows finished.
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012

    def __init__(
        self,
        scenario: str | Path | Scenario = "sea_state_5",
        num_envs: int = 1,
        *,
        device: str = "cuda",
        max_episode_steps: int | None = None,
        dtype: str = "float32",
        info: bool = False,
        information_set: str | None = None,
        overrides: dict[str, Any] | None = None,
        cuda_graph: bool = True,
    ) -> None:
        """Builds the batch.

        Args:
            scenario: Name, path of a YAML file, or the scenario itself.
            num_envs: Environments in the batch.
            device: "cuda", "cuda:1" and so on, or "cpu".
            max_episode_steps: Control steps of an episode; the scenario's own if not given.
            dtype: Precision of the physics and of rewards, "float32" or "float64".
            info: Whether `info` carries the physical channels, and `final_info` those of finished rows.
            information_set: What is observed, in place of the scenario's choice.
            overrides: Scenario values to replace, by dotted path.
            cuda_graph: Whether a step on a CUDA device is recorded once and replayed.

        Raises:
            ValueError: If an argument is impossible, or the kernels do not know something in the scenario.
            ModuleNotFoundError: If NVIDIA Warp is not installed.
        """
        self.scenario = chosen_scenario(scenario, information_set, overrides)
        if max_episode_steps is not None and max_episode_steps < 1:
            raise ValueError(f"max_episode_steps must be a positive whole number, got {max_episode_steps!r}")
        self.plant = GpuPlant(
            self.scenario,
            num_envs,
            device=device,
            dtype=dtype,
            n_steps=max_episode_steps,
            keep_final_channels=info,
        )
        self.num_envs = self.plant.n_envs
        self.render_mode = None
        self.single_observation_space = observation_space(self.scenario)
        self.single_action_space = action_space()
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._seeded = self._begun = False
        self._stream: Any = None
        wp = self._warp = self.plant._warp
        self.device = wp.device_to_torch(self.plant.device)
        self._given = wp.zeros(self.num_envs, dtype=wp.float32, device=self.plant.device)
        self._bind(info)
        wp.synchronize_device(self.plant.device)
        self._graph = self.plant.captured(self._given) if cuda_graph else None

    def _bind(self, info: bool) -> None:
        """Makes tensors of the plant's arrays."""
        b, to_torch = self.plant.buffers, self._warp.to_torch
        self._actions = to_torch(self._given)
        self._observation = to_torch(b.observation).T
        self._reward, self._outcome = to_torch(b.reward), to_torch(b.outcome)
        self._terminated, self._truncated = to_torch(b.terminated), to_torch(b.truncated)
        finished = to_torch(b.finished)
        self._now: dict[str, Any] = {}
        final: dict[str, Any] = {"outcome": self._outcome}
        if info:
            columns = [(name, CHANNEL_NAMES.index(name)) for name in channel_names(self.scenario)]
            channels, last = to_torch(b.channels), to_torch(b.final_channels)
            self._now = {name: channels[column] for name, column in columns}
            final |= {name: last[column] for name, column in columns}
        self._after = {
            **self._now,
            "final_obs": to_torch(b.final_observation).T,
            "_final_obs": finished,
            "final_info": final,
            "_final_info": finished,
        }

    # Gymnasium's calls ---------------------------------------------------------------------------

    def reset(
        self, *, seed: int | Sequence[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[torch.Tensor, dict[str, Any]]:
        """Begins new episodes.

        Args:
            seed: An int s gives row i the seed s + i; a sequence gives each its own; None goes on to the
                next episode of the seeds in force (drawn by `np_random` when there are none).
            options: "reset_mask", a bool array or tensor (num_envs,), begins the masked rows only.
        """
        mask = np.ones(self.num_envs, dtype=np.bool_)
        if options is not None and "reset_mask" in options:
            mask = self._checked_mask(options["reset_mask"])
            if not self._begun and not mask.all():
                raise ValueError(
                    "reset_mask must be all true in the first reset: the other rows have no episode yet"
                )
        seeds = self._seeds(seed)
        with self._on_stream():
            self.plant.begin(mask, seeds)
        self._begun = True
        return self._observation, dict(self._now)

    def step(
        self, actions: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor, dict[str, Any]]:
        """Advances every row by one control step.

        Args:
            actions: Fractions of the command range, a tensor (num_envs, 1). They are not looked at on the
                way: a number that is none makes its row diverge.

        Returns:
            Observation (num_envs, n_observations), reward, terminated and truncated (num_envs,), and the
            info: `final_obs`, `final_info["outcome"]` (0 running, 1 diverged, 2 lost, 3 landed) and, where
            asked for, the physical channels.

        Raises:
            ValueError: If the actions have another shape.
        """
        if tuple(actions.shape) not in ((self.num_envs, 1), (self.num_envs,)):
            raise ValueError(f"action must have shape {(self.num_envs, 1)}, got {tuple(actions.shape)}")
        if not self._begun:
            raise gym.error.ResetNeeded("call reset() before step()")
        self._actions.copy_(actions.detach().reshape(-1))
        with self._on_stream():
            if self._graph is not None:
                self._warp.capture_launch(self._graph)
            else:
                self.plant.advance(self._given)
                self.plant.begin_finished()
        return self._observation, self._reward, self._terminated, self._truncated, dict(self._after)

    # Beyond Gymnasium ----------------------------------------------------------------------------

    def reset_rows(self, mask: Any) -> torch.Tensor:
        """Begins the next episode of the masked rows at once, and returns all observations.

        Args:
            mask: A bool array, or a tensor of the device, (num_envs,).
        """
        if isinstance(mask, np.ndarray):
            given: Any = self._checked_mask(mask)
        else:
            given = self._warp.from_torch(mask.contiguous())
        with self._on_stream():
            self.plant.begin(given)
        return self._observation

    @property
    def observation(self) -> torch.Tensor:
        """What every row sees now, (num_envs, n_observations): the batch's own tensor."""
        return self._observation

    def get_state(self) -> dict[str, np.ndarray]:
        """Everything that the batch's future depends on, as plain arrays; waits for the device."""
        with self._on_stream():
            state = {name: self.plant.numpy(name) for name in STATE_BUFFERS}
        return {**state, "seeded": np.array(self._seeded)}

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Goes back to what `get_state` gave.

        Raises:
            ValueError: If the state is of another scenario, batch or precision.
        """
        for name in STATE_BUFFERS:
            mine = getattr(self.plant.buffers, name)
            given, wanted = state[name], self._warp.dtype_to_numpy(mine.dtype)
            if given.shape != mine.shape or given.dtype != wanted:
                raise ValueError(
                    f"state {name!r} has shape {given.shape} and type {given.dtype}, this batch {mine.shape} "
                    f"and {np.dtype(wanted)}; restore it into the scenario, batch and dtype it came from"
                )
        with self._on_stream():
            for name in STATE_BUFFERS:
                getattr(self.plant.buffers, name).assign(state[name])
        self._seeded = bool(state["seeded"])
        self._begun = True

    # Inner parts ---------------------------------------------------------------------------------

    def _on_stream(self) -> AbstractContextManager[Any]:
        """Lets the plant work on the stream that torch is working on."""
        if not self.plant.device.is_cuda:
            return nullcontext()
        import torch

        current = torch.cuda.current_stream(self.device)
        if self._stream is None or self._stream.cuda_stream != current.cuda_stream:
            self._stream = self._warp.stream_from_torch(current)
        scope: AbstractContextManager[Any] = self._warp.ScopedStream(self._stream, sync_enter=False)
        return scope

    def _checked_mask(self, mask: Any) -> np.ndarray:
        array = mask if isinstance(mask, np.ndarray) else np.asarray(mask.cpu())
        if array.dtype != np.bool_ or array.shape != (self.num_envs,) or not array.any():
            raise ValueError(
                f"reset_mask must be a bool array of shape {(self.num_envs,)} with at least one true"
            )
        return array

    def _seeds(self, seed: int | Sequence[int] | None) -> np.ndarray | None:
        if seed is None and self._seeded:
            return None
        if seed is None:
            seed = int(self.np_random.integers(2**31))
        elif isinstance(seed, (int, np.integer)):
            self._np_random, self._np_random_seed = gym.utils.seeding.np_random(int(seed))
        if isinstance(seed, (int, np.integer)):
            seeds: list[Any] = [int(seed) + row for row in range(self.num_envs)]
        else:
            seeds = list(seed)
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed must be an int or {self.num_envs} ints, got {len(seeds)}")
        for item in seeds:
            if not isinstance(item, (int, np.integer)) or not 0 <= item < 2**64:
                raise ValueError(f"seed must be a whole number from 0 to 2**64 - 1, got {item!r}")
        self._seeded = True
        return np.array(seeds, dtype=np.uint64)
