"""Environment and controller in, `Trajectory` out: the only loop that steps an environment outside training.

The first axis of a channel is time, the second the sea. A sea whose episode ended early keeps its last
values, so that no array ever holds NaN; `n_valid` says how many of its steps count.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from heave_env.controller import Controller, shown_to
from heave_env.scenarios import Scenario, whole_number_of
from heave_env.sensors import CABLE_CHANNELS, CHANNELS

if TYPE_CHECKING:
    from heave_env.env import HeaveVectorEnv

Array = np.ndarray

FIRST_TEST_SEED = 20_000_000
"""Test seas have the seeds from here; training seas lie below 1e7, validation seas from 1e7."""

STATE_CHANNELS: dict[str, str] = {name: unit for name, unit in CHANNELS.items() if name not in CABLE_CHANNELS}
"""Channels of every plant at the control instants, with units: arrays `(n_steps + 1, n_seas)`."""
CABLE_STATE_CHANNELS: dict[str, str] = {
    "sheave_tension": CHANNELS["sheave_tension"],
    "payload_tension": "N",
    "length": CHANNELS["length"],
}
"""Channels at the control instants that only a plant with a cable has."""
STEP_CHANNELS: dict[str, str] = {
    "command": "m",
    "position_cost": "-",
    "command_cost": "-",
    "failure_cost": "-",
    "cost": "-",
    "saturated": "-",
}
"""Channels of every plant that belong to a control step: arrays `(n_steps, n_seas)`."""
CABLE_STEP_CHANNELS: dict[str, str] = {
    "slack": "-",
    "tension_min": "N",
    "tension_max": "N",
    "winch_power": "W",
    "supply_power": "W",
}
"""Channels of a control step that only a plant with a cable has."""
PRICED_STEP_CHANNELS: dict[str, str] = {"energy_cost": "-"}
"""Channels of a control step that only a task has that puts a price on the winch's work."""
OUTCOMES = ("diverged", "lost", "landed")
"""How an episode can end before its time."""

MEMORY_LIMIT = 256 * 2**20
"""Memory that the channels of one batch of seas may take [bytes]."""


@dataclass(frozen=True)
class Trajectory:
    """What one rollout recorded of a batch of seas."""

    seeds: tuple[int, ...]
    """Seed of each sea, (n_seas,)."""
    control_dt: float
    """Control step [s]."""
    states: dict[str, Array]
    """Channels at the control instants, (n_steps + 1, n_seas), float64, SI."""
    steps: dict[str, Array]
    """Channels of the control steps, (n_steps, n_seas), float64, SI."""
    n_valid: Array
    """Control steps of each sea before its end, (n_seas,); the step in which it diverged is not one."""
    outcomes: dict[str, Array] = field(default_factory=dict)
    """For each of `OUTCOMES`, which seas ended so, (n_seas,) bool."""
    decision_time: float = math.nan
    """Time of an action, per sea of the batch that the controller acted in, mean over the steps [s]."""

    @property
    def n_seas(self) -> int:
        """Number of seas [-]."""
        return len(self.seeds)

    @property
    def n_steps(self) -> int:
        """Control steps of a full episode [-]."""
        return len(self.steps["command"])

    @cached_property
    def time(self) -> Array:
        """Control instants [s], (n_steps + 1,)."""
        return np.round(np.arange(self.n_steps + 1) * self.control_dt, 9)

    @property
    def has_cable(self) -> bool:
        """Whether the plant has a cable, and so tensions."""
        return "sheave_tension" in self.states

    @cached_property
    def valid(self) -> Array:
        """Which control steps count, (n_steps, n_seas) bool."""
        return np.arange(self.n_steps)[:, None] < self.n_valid

    def selected(self, count: int) -> Trajectory:
        """The first `count` seas alone."""
        return Trajectory(
            seeds=self.seeds[:count],
            control_dt=self.control_dt,
            states={name: values[:, :count] for name, values in self.states.items()},
            steps={name: values[:, :count] for name, values in self.steps.items()},
            n_valid=self.n_valid[:count],
            outcomes={name: values[:count] for name, values in self.outcomes.items()},
            decision_time=self.decision_time,
        )


def with_duration(scenario: Scenario, duration: float | None) -> Scenario:
    """The scenario with episodes of another length [s]; unchanged if `duration` is None.

    Raises:
        ValueError: If the duration is no positive whole number of control steps.
    """
    if duration is None:
        return scenario
    if not duration > 0.0 or whole_number_of(duration, scenario.control_dt) is None:
        raise ValueError(
            f"duration must be a positive whole number of control steps of {scenario.control_dt:g} s, "
            f"got {duration!r}"
        )
    return dataclasses.replace(scenario, duration=float(duration))


def batches(scenario: Scenario, seeds: Sequence[int]) -> Iterator[tuple[int, ...]]:
    """The seeds in order, in batches whose channels fit into `MEMORY_LIMIT`."""
    n_channels = len(STATE_CHANNELS) + len(STEP_CHANNELS)
    n_channels += 0 if scenario.is_linear else len(CABLE_STATE_CHANNELS) + len(CABLE_STEP_CHANNELS)
    n_channels += len(PRICED_STEP_CHANNELS)
    size = max(1, MEMORY_LIMIT // (8 * n_channels * (scenario.n_steps + 1)))
    for start in range(0, len(seeds), size):
        yield tuple(seeds[start : start + size])


def rollout(
    scenario: Scenario,
    controller: Controller,
    seeds: Sequence[int],
    *,
    duration: float | None = None,
    dtype: str = "float64",
    information_set: str | None = None,
    progress: Callable[[int], None] | None = None,
) -> Trajectory:
    """Lets a controller act on one episode of each seed's sea.

    Args:
        scenario: The operation.
        controller: Anything with the `Controller` protocol, Stable-Baselines3 models included.
        seeds: One seed per sea, at least one.
        duration: Length of the episodes [s]; None: the scenario's.
        dtype: Precision of the plant, `float64` or `float32`.
        information_set: What the controller sees; None: what it says itself, or else the scenario's; see
            `heave_env.controller.shown_to`.
        progress: Called after each control step with the number of seas stepped.

    Returns:
        The recorded channels.

    Raises:
        ValueError: If there is no seed, or an argument is impossible.
    """
    from heave_env.env import HeaveVectorEnv

    if len(seeds) == 0:
        raise ValueError("a rollout needs at least one seed, got none")
    shown = shown_to(controller, with_duration(scenario, duration), information_set)
    env = HeaveVectorEnv(shown, num_envs=len(seeds), dtype=dtype)
    try:
        return _recorded(env, controller, [int(seed) for seed in seeds], progress)
    finally:
        env.close()


def _recorded(
    env: HeaveVectorEnv, controller: Controller, seeds: list[int], progress: Callable[[int], None] | None
) -> Trajectory:
    scenario: Scenario = env.scenario
    n_steps, n_seas = scenario.n_steps, len(seeds)
    state_names = [*STATE_CHANNELS, *({} if scenario.is_linear else CABLE_STATE_CHANNELS)]
    step_names = [*STEP_CHANNELS, *({} if scenario.is_linear else CABLE_STEP_CHANNELS)]
    if scenario.task.energy_weight > 0.0:
        step_names += PRICED_STEP_CHANNELS
    states = {name: np.empty((n_steps + 1, n_seas)) for name in state_names}
    steps = {name: np.zeros((n_steps, n_seas)) for name in step_names}
    outcomes = {name: np.zeros(n_seas, dtype=bool) for name in OUTCOMES}
    n_valid = np.zeros(n_seas, dtype=np.int64)
    alive = np.ones(n_seas, dtype=bool)
    episode_start = np.ones(n_seas, dtype=bool)
    memory = None
    thinking, n_decisions = 0.0, 0

    observation, info = env.reset(seed=seeds)
    for name, values in states.items():
        values[0] = info[name]
    for k in range(n_steps):
        began = time.perf_counter()
        action, memory = controller.predict(
            observation, state=memory, episode_start=episode_start, deterministic=True
        )
        if k > 0:  # the first may have something to prepare
            thinking, n_decisions = thinking + time.perf_counter() - began, n_decisions + n_seas
        observation, _, terminated, truncated, info = env.step(action)
        ended = {name: alive & (np.asarray(info.get(name, 0.0)) > 0.0) for name in OUTCOMES}
        counts = alive & ~ended["diverged"]
        n_valid += counts
        for name, values in states.items():
            values[k + 1] = np.where(counts, info[name], values[k])
        for name, values in steps.items():
            # What a failure costs, and the command that led to it, stand even in a step that diverged.
            kept = alive if name in ("failure_cost", "command") else counts
            values[k] = np.where(kept, info[name], 0.0)
        for name, rows in ended.items():
            outcomes[name] |= rows
        # The row that ended is reset in the next step, which ignores its action.
        episode_start = np.asarray(terminated | truncated)
        alive &= ~terminated
        if progress is not None:
            progress(n_seas)
        if not alive.any():
            for values in states.values():
                values[k + 2 :] = values[k + 1]
            if progress is not None:
                progress(n_seas * (n_steps - k - 1))
            break
    return Trajectory(
        seeds=tuple(seeds),
        control_dt=scenario.control_dt,
        states=states,
        steps=steps,
        n_valid=n_valid,
        outcomes=outcomes,
        decision_time=thinking / n_decisions if n_decisions else math.nan,
    )
