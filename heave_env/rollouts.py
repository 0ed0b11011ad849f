"""Many control steps of a whole batch in one compiled call, open loop or under a policy of each row's own.

Nothing returns to Python between the steps, and a block of environments makes all its steps before the next
one begins, so that its state stays in the processor's cache. Sweeps, identification, evolution strategies and
searches over thousands of controllers want this; the numbers are those of stepping, to the last bit.

A policy is linear, or a small network with tanh between its layers. It sees the observation, float32, and
computes in float32; `TanhPolicy.predict` is its twin in NumPy, for use as a `Controller`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from heave_env.kernel import DIVERGED, LANDED, RUNNING
from heave_env.layout import CHANNEL_NAMES
from heave_env.marching import (
    FARTHEST,
    FATE,
    HIGHEST,
    LOWEST,
    N_TOTALS,
    STEPS_MADE,
    TOTAL_COMMAND,
    TOTAL_COST,
    TOTAL_ENERGY,
    TOTAL_FAILURE,
    TOTAL_POSITION,
    TOTAL_SAFETY,
)

if TYPE_CHECKING:
    from heave_env.plant import Plant

Array = np.ndarray


@dataclass(frozen=True)
class TanhPolicy:
    """A linear policy, or a small network with tanh between its layers; one, or one for each row of a batch.

    The action is the last layer's only output, which the plant clips to [-1, 1]. As a `Controller` it has no
    memory.
    """

    parameters: Array
    """(n_policies, n_parameters): layer by layer, output by output, the bias and then the weights."""
    widths: tuple[int, ...]
    """Entries of the observation, widths of the hidden layers, 1."""

    def __post_init__(self) -> None:
        widths = tuple(int(width) for width in self.widths)
        if len(widths) < 2 or min(widths) < 1 or widths[-1] != 1:
            raise ValueError(
                f"widths must be two or more positive whole numbers, the last 1, got {self.widths}"
            )
        parameters = np.array(self.parameters, dtype=np.float32)
        wanted = n_parameters(widths)
        if parameters.ndim != 2 or not len(parameters) or parameters.shape[1] != wanted:
            raise ValueError(
                f"parameters must have shape (n_policies, {wanted}) for widths {widths}, "
                f"got {parameters.shape}"
            )
        if not np.isfinite(parameters).all():
            raise ValueError("parameters must be finite numbers, got one that is not")
        object.__setattr__(self, "widths", widths)
        object.__setattr__(self, "parameters", parameters)

    @classmethod
    def linear(cls, gain: Any, bias: Any = 0.0) -> TanhPolicy:
        """action = gain · observation + bias.

        Args:
            gain: (n_observed,), or one per policy, (n_policies, n_observed).
            bias: A number, or one per policy, (n_policies,).
        """
        gains = np.atleast_2d(np.asarray(gain, dtype=np.float32))
        column = np.broadcast_to(np.asarray(bias, dtype=np.float32), len(gains))
        return cls(np.column_stack([column, gains]), (gains.shape[1], 1))

    def repeated(self, count: int) -> TanhPolicy:
        """Each policy `count` times in a row, one for each of as many seas."""
        return TanhPolicy(np.repeat(self.parameters, count, axis=0), self.widths)

    @cached_property
    def layers(self) -> list[tuple[Array, Array]]:
        """Of each layer the weights, (n_policies, n_out, n_in), and biases, (n_policies, n_out)."""
        found, at = [], 0
        for n_in, n_out in pairwise(self.widths):
            size = n_out * (n_in + 1)
            both = self.parameters[:, at : at + size].reshape(-1, n_out, n_in + 1)
            found.append((both[:, :, 1:], both[:, :, 0]))
            at += size
        return found

    def predict(
        self,
        observation: Array,
        state: None = None,
        episode_start: Array | None = None,
        deterministic: bool = True,
    ) -> tuple[Array, None]:
        """Actions, (n_envs, 1): the compiled loop's to the rounding of float32."""
        x = np.asarray(observation, dtype=np.float32)
        for i, (weights, biases) in enumerate(self.layers):
            x = np.einsum("roi,ri->ro", np.broadcast_to(weights, (len(x), *weights.shape[1:])), x) + biases
            x = np.tanh(x) if i < len(self.layers) - 1 else x
        return np.clip(x, -1.0, 1.0), None

    def _by_lanes(self, plant: Plant) -> Array:
        """The parameters as the compiled loop reads them, (n_blocks or 1, n_parameters, n_lanes)."""
        if self.widths[0] != plant.observation.shape[1]:
            raise ValueError(
                f"widths[0] must be {plant.observation.shape[1]}, as many as the observation has entries, "
                f"got {self.widths[0]}"
            )
        if len(self.parameters) not in (1, plant.n_envs):
            raise ValueError(
                f"parameters must hold one policy, or one for each of {plant.n_envs} rows, "
                f"got {len(self.parameters)}"
            )
        shared = len(self.parameters) == 1
        n_blocks = 1 if shared else plant.n_blocks
        rows = np.zeros((n_blocks * plant.n_lanes, self.parameters.shape[1]), dtype=np.float32)
        rows[: None if shared else plant.n_envs] = self.parameters
        return np.ascontiguousarray(rows.reshape(n_blocks, plant.n_lanes, -1).transpose(0, 2, 1))


def n_parameters(widths: Sequence[int]) -> int:
    """Parameters of a `TanhPolicy` with layers of these widths [-]."""
    return sum(n_out * (n_in + 1) for n_in, n_out in pairwise(widths))


@dataclass(frozen=True, kw_only=True)
class Rollouts:
    """What came of each row of a batch."""

    mean_cost: Array
    """Mean stage cost of the steps that count, (n_envs,). After a failure, which is charged for what was to
    come, of all that were asked for; else of those made until the row ended."""
    position_cost: Array
    """Mean of the payload's part of it, (n_envs,)."""
    command_cost: Array
    """Mean of the command's part, (n_envs,)."""
    energy_cost: Array
    """Mean of the winch's work's part, (n_envs,)."""
    failure_cost: Array
    """Mean of what failure was charged, (n_envs,)."""
    safety_cost: Array
    """Mean safety cost, (n_envs,)."""
    tension_min: Array
    """Lowest tension along the cable [N], (n_envs,); NaN without a cable."""
    tension_max: Array
    """Highest tension along the cable [N], (n_envs,); NaN without a cable."""
    payload_heave_peak: Array
    """Largest distance of the payload from where it should be [m], (n_envs,)."""
    n_steps: Array
    """Control steps until the row ended, or all that were asked for, (n_envs,)."""
    outcome: Array
    """0 running, 1 diverged, 2 lost, 3 landed, (n_envs,)."""
    channels: dict[str, Array] = field(default_factory=dict)
    """The channels asked for, by name, (n_steps + 1, n_envs); they go on after a row has ended."""

    @property
    def diverged(self) -> Array:
        """Which rows diverged, (n_envs,), bool."""
        return self.outcome == DIVERGED


def rollout(
    plant: Plant,
    acting: Array | TanhPolicy,
    n_steps: int | None = None,
    *,
    n_settling: int = 0,
    channels: Sequence[str] = (),
) -> Rollouts:
    """Advances a plant by many control steps in one compiled call.

    The plant goes on from where it stands: call `Plant.begin` before. A row that diverged, was lost or landed
    is begun anew by the next `begin` and by nothing else; what it does until then counts for nothing.

    Args:
        plant: The batch.
        acting: Fractions of the command range, (n_steps, n_envs), or a policy.
        n_steps: Control steps under a policy; the plant's episode if not given.
        n_settling: Control steps at the beginning that count for nothing but a failure.
        channels: Names of the physical channels to record.

    Raises:
        ValueError: If an argument is impossible.
    """
    linear = plant.scenario.is_linear
    for name in channels:
        if name not in CHANNEL_NAMES:
            raise ValueError(f"channels must be among {', '.join(CHANNEL_NAMES)}, got {name!r}")
    if isinstance(acting, TanhPolicy):
        n_steps = plant.n_steps if n_steps is None else n_steps
        given, widths, parameters = np.zeros((0, plant.n_envs)), acting.widths, acting._by_lanes(plant)
    else:
        given = np.ascontiguousarray(acting, dtype=np.float64)
        if given.ndim != 2 or given.shape[1] != plant.n_envs or len(given) != (n_steps or len(given)):
            wanted = "n_steps" if n_steps is None else n_steps
            raise ValueError(f"actions must have shape ({wanted}, {plant.n_envs}), got {given.shape}")
        if not np.isfinite(given).all():
            raise ValueError("actions must be finite numbers in [-1, 1], got one that is not")
        n_steps, widths, parameters = len(given), (1, 1), np.zeros((1, 2, plant.n_lanes), dtype=np.float32)
    if n_steps < 1 or not 0 <= n_settling < n_steps:
        raise ValueError(
            f"n_steps must be positive and n_settling from 0 to below it, got {n_steps} and {n_settling}"
        )
    columns = np.array([CHANNEL_NAMES.index(name) for name in channels], dtype=np.int64)
    record = np.empty((len(columns), n_steps + 1, plant.n_envs))
    if len(columns):
        record[:, 0] = plant.channel_rows(plant.channel_block())[columns]
    totals = np.zeros((N_TOTALS, plant.n_envs))
    asked = (
        n_steps, n_settling, given, np.array(widths), parameters, not linear, columns, record, totals
    )  # fmt: skip
    plant.advance_many(asked, n_steps)
    outcome, made = totals[FATE].astype(np.int64), totals[STEPS_MADE].astype(np.int64)
    until = np.where((outcome == RUNNING) | (outcome == LANDED), made, n_steps)
    means = totals[TOTAL_COST : TOTAL_SAFETY + 1] / np.maximum(until - n_settling, 1)
    return Rollouts(
        mean_cost=means[TOTAL_COST],
        position_cost=means[TOTAL_POSITION],
        command_cost=means[TOTAL_COMMAND],
        energy_cost=means[TOTAL_ENERGY],
        failure_cost=means[TOTAL_FAILURE],
        safety_cost=means[TOTAL_SAFETY],
        tension_min=np.full(plant.n_envs, np.nan) if linear else totals[LOWEST],
        tension_max=np.full(plant.n_envs, np.nan) if linear else totals[HIGHEST],
        payload_heave_peak=totals[FARTHEST],
        n_steps=made,
        outcome=outcome,
        channels=dict(zip(channels, record, strict=True)),
    )
