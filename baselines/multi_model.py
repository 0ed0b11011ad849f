"""Adaptive control by a bank of Kalman filters: each believes in other parameters, Bayes weighs them.

The members are the scenario with parameters from its own prior (`Scenario.uncertainty`): the scenario as it
is, and points of a low-discrepancy sequence. Each runs its filter; with the innovation ν of member i and its
covariance S_i the log weight gains -(ln det S_i + νᵀ S_i⁻¹ ν) / 2 in each step. The command is the mean of
the members' own optimal commands under these weights: the honest rival where parameters are unknown, since no
single model is right and the right one shows itself within minutes.

Memory of a row: the log weights, and each member's prior estimate and steps.

Source: Magill (1965); Sobol (1967) for the points, scrambled.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from baselines.estimator import Estimator, estimator
from baselines.kalman import KalmanFilter, filter_on, kalman_filter
from baselines.linear_controller import LinearController, without_matrices
from baselines.lqr import design_weights, sampled_gain
from baselines.model import linear_model, sea_filter
from heave_env.scenarios import Scenario
from heave_env.sea import Array

N_MEMBERS = 128
"""Models in the bank [-]."""
DOUBT = 0.005
"""What a member doubts of its winch in each step, over the boom tip's standard deviation [-]: the truth lies
between the members, and most of what that costs is the drum's path, which nothing measures."""
LEAST_LOG_WEIGHT = -60.0
"""Members are kept within reach: a weight does not fall below e to this, relative to the largest."""


def bank_scenarios(scenario: Scenario, n_members: int = N_MEMBERS) -> list[Scenario]:
    """The scenario as it is, and with parameters spread over its prior; none is uncertain itself."""
    draws = scenario.uncertainty
    variants = [scenario.with_drawn({})]
    points: Array = np.zeros((0, 0))
    if draws:
        from scipy.stats import qmc

        # A power of two keeps the sequence's balance; the first point is the scenario as it is.
        whole = 2 ** math.ceil(math.log2(n_members))
        points = qmc.Sobol(len(draws), scramble=True, seed=1).random(whole)[1:n_members]
    for point in points:
        values = {
            draw.parameter: draw.quantile(float(share)) for draw, share in zip(draws, point, strict=True)
        }
        variants.append(scenario.with_drawn(values))
    return variants


@dataclass(frozen=True, eq=False)
class Member:
    """One model of the bank with its filter and gain."""

    filter: KalmanFilter | Estimator
    gain: Array
    """Feedback gain on its states, (1, n_states)."""
    columns: Array
    """Places of its outputs among the bank's measurements, (n_outputs,)."""

    @property
    def kalman(self) -> KalmanFilter:
        """Its linear filter."""
        return self.filter.filter if isinstance(self.filter, Estimator) else self.filter

    @property
    def n_memory(self) -> int:
        """Numbers it remembers from step to step [-]."""
        return self.filter.n_memory if isinstance(self.filter, Estimator) else self.kalman.model.n_states + 1

    @cached_property
    def surprise(self) -> tuple[Array, float]:
        """Inverse covariance of the stationary innovation, and half the logarithm of its determinant."""
        model = self.kalman.model
        S = model.C @ self.kalman.prior_covariance @ model.C.T + model.V
        return np.linalg.inv(S), 0.5 * float(np.linalg.slogdet(S)[1])

    def log_likelihood(self, memory: Array, y: Array) -> Array:
        """Of a measurement, given the prior estimate, but for a constant; (n_rows,)."""
        n = self.kalman.model.n_states
        innovation = y - memory[:, :n] @ self.kalman.model.C.T
        inverse, half_log_determinant = self.surprise
        return -0.5 * np.einsum("ni,ij,nj->n", innovation, inverse, innovation) - half_log_determinant

    def respond(self, memory: Array, y: Array) -> tuple[Array, Array, Array]:
        """Estimate, its own command [m], (n_rows, 1), and the drum's rate (with limits only)."""
        if isinstance(self.filter, Estimator):
            estimate, rate = self.filter.corrected(memory, y)
        else:
            estimate, rate = self.filter.corrected(memory[:, :-1], y, memory[:, -1]), memory[:, -1]
        return estimate, -(estimate @ self.gain.T), rate

    def advanced(self, memory: Array, estimate: Array, rate: Array, command: Array) -> Array:
        """Next memory after the command that was given."""
        if isinstance(self.filter, Estimator):
            return self.filter.advanced(memory, estimate, rate, command)
        return np.column_stack([self.filter.advanced(estimate, command), memory[:, -1] + 1.0])


@dataclass(frozen=True, eq=False)
class MultiModel(LinearController):
    """A bank of filters and gains under Bayes' weights."""

    members: tuple[Member, ...] = ()
    speed_weight: float = 0.0
    """Weight of the squared winch rate in every member's design [s²/m²]."""

    @cached_property
    def places(self) -> Array:
        """Where each member's memory begins, behind the log weights, and the end; (n_members + 1,)."""
        sizes = [member.n_memory for member in self.members]
        return len(self.members) + np.concatenate([[0], np.cumsum(sizes)]).astype(int)

    @property
    def n_memory(self) -> int:
        """Numbers remembered from step to step [-]."""
        return int(self.places[-1])

    def weights(self, memory: Array) -> Array:
        """Probability of each member, (n_rows, n_members), of a memory that `predict` returned."""
        log_weight = memory[:, : len(self.members)]
        share = np.exp(log_weight - log_weight.max(axis=1, keepdims=True))
        return np.asarray(share / share.sum(axis=1, keepdims=True))

    def respond(self, y: Array, memory: Array) -> tuple[Array, Array]:
        """Command in metres, (n_envs, 1), and the next memory, for measurements in SI units."""
        n = len(self.members)
        log_weight = memory[:, :n].copy()
        parts = [memory[:, a:b] for a, b in zip(self.places[:-1], self.places[1:], strict=True)]
        answers = []
        for i, (member, part) in enumerate(zip(self.members, parts, strict=True)):
            seen = y[:, member.columns]
            log_weight[:, i] += member.log_likelihood(part, seen)
            answers.append(member.respond(part, seen))
        log_weight -= log_weight.max(axis=1, keepdims=True)
        log_weight = np.maximum(log_weight, LEAST_LOG_WEIGHT)
        share = np.exp(log_weight)
        share /= share.sum(axis=1, keepdims=True)
        own = np.column_stack([command for _, command, _ in answers])
        command = self.clipped(np.sum(share * own, axis=1, keepdims=True))
        following = [
            member.advanced(part, estimate, rate, command)
            for member, part, (estimate, _, rate) in zip(self.members, parts, answers, strict=True)
        ]
        return command, np.column_stack([log_weight, *following])


def boom_tip_std(scenario: Scenario) -> float:
    """Standard deviation of the boom tip by its filter [m]."""
    waves = sea_filter(scenario)
    assert waves is not None
    return float(np.sqrt((waves.C[:1] @ waves.covariance @ waves.C[:1].T).item()))


def _doubting(scenario: Scenario, mismatch: float) -> KalmanFilter:
    """A filter that does not trust its own winch to the last."""
    model = kalman_filter(scenario, mismatch=mismatch).model
    W = model.W.copy()
    W[2, 2] += (DOUBT * boom_tip_std(scenario)) ** 2
    return filter_on(scenario, replace(model, W=W))


def multi_model(
    scenario: Scenario,
    *,
    command_weight: float | None = None,
    speed_weight: float = 0.0,
    mismatch: float = 1.0,
    n_members: int = N_MEMBERS,
) -> MultiModel:
    """Designs the bank for a scenario's sensors and its prior of the parameters.

    Args:
        scenario: The operation; without `uncertainty` the bank is the stochastic-optimal controller alone.
        command_weight: r of the designs [1/m²]; the task's own if not given.
        speed_weight: Weight of the squared winch rate in the designs [s²/m²].
        mismatch: How many times the residual of the identification the model of a cable is doubted by.
        n_members: Models in the bank [-].

    Raises:
        ValueError: If the sea is calm, or nothing that the model expresses is measured.
    """
    q, r = design_weights(scenario, command_weight)
    entries, members = _bank(scenario, q, r, speed_weight, mismatch, n_members)
    return MultiModel(
        **without_matrices("multi_model", scenario, entries),
        command_weight=r,
        members=members,
        speed_weight=speed_weight,
    )


@cache
def _bank(
    scenario: Scenario, q: float, r: float, speed_weight: float, mismatch: float, n_members: int
) -> tuple[tuple[str, ...], tuple[Member, ...]]:
    """What the bank measures, and its members."""
    members: list[Member] = []
    entries: tuple[str, ...] = ()
    for variant in bank_scenarios(scenario, n_members):
        model = linear_model(variant)
        gain, _ = sampled_gain(model.A, model.B, q, r, speed_weight=speed_weight / scenario.control_dt**2)
        found: KalmanFilter | Estimator
        if scenario.winch.is_limited:
            found = estimator(variant, mismatch=mismatch)
            outputs = found.filter.model.outputs
        else:
            found = _doubting(variant, mismatch) if scenario.uncertainty else kalman_filter(variant)
            outputs = found.model.outputs
        entries = entries or outputs
        columns = np.array([entries.index(name) for name in outputs], dtype=int)
        members.append(Member(found, gain, columns))
    return entries, tuple(members)
