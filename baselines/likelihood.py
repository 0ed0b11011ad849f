"""How likely a record of measurements and commands is under a scenario's parameters, and where it is most so.

The record is filtered from the episode's first instant on (`baselines.kalman`; beside a winch with limits,
`baselines.estimator`), in one compiled pass: with the innovation ν_kj of channel j at step k, given all that
came before it, and its variance s_kj,

    -ln p(record | θ) = Σ (ν_kj² / s_kj + ln s_kj) / 2 + constant.

θ are the drawn parameters of `Scenario.uncertainty`, each as its share of the prior, within (0, 1). Gauss and
Newton's step takes the derivatives of the normalised innovations by differences. A command delay is whole
solver steps: the step is rounded in it, and the others' follow.

Source: Åström (1980).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numba import njit

from baselines.estimator import Estimator, estimator
from baselines.kalman import KalmanFilter, kalman_filter
from heave_env.compiled import source_fingerprint
from heave_env.lanes import block_at
from heave_env.layout import (
    ACCELERATION_LIMIT,
    N_FIXED,
    N_SCRATCH,
    SPEED_LIMIT,
    STROKE_LIMIT,
    WINCH_DECAY,
    WINCH_DISPLACEMENT,
    WINCH_OLD,
    WINCH_RATE,
    WINCH_RATE_CONSTANT,
    WINCH_RATE_START,
)
from heave_env.scenarios import Scenario
from heave_env.sea import Array
from heave_env.winch import limited_winch_step

DIFFERENCE = 0.01
"""Share of the prior over which derivatives are taken [-]."""
EDGE = 1e-3
"""Shares keep this far from the prior's ends [-]."""
PRIOR_PRECISION = 12.0
"""Inverse variance of a share, uniform in (0, 1): what the record does not tell stays in the middle [-]."""
VALLEY = 10.0
"""A neighbouring delay is gone into if its first trial is no more than this above the best [-]."""
DAMPINGS = (0.0, 1.0, 30.0)
"""Added to the curvature, times its diagonal, until a step lowers the objective [-]."""


@cache
def _compiled(fingerprint: int) -> Any:
    """The pass over a record; `fingerprint` is that of the plant's stages, of which it calls one."""

    @njit(cache=True, error_model="numpy")
    def _filter_record(
        A: Array,
        C: Array,
        W: Array,
        v: Array,
        P: Array,
        mean_A: Array,
        mean_B: Array,
        drum: Array,
        forcing: Array,
        row: Array,
        n_delayed: int,
        dt: float,
        ramps: bool,
        moving: bool,
        y: Array,
        u0: Array,
    ) -> Any:
        assert fingerprint != 0
        n, n_outputs, n_steps = len(A), len(C), len(y)
        n_substeps = len(forcing) // 4
        x, rate = np.zeros(n), 0.0
        P = P.copy()
        AP = np.empty((n, n))
        z, logs = np.empty((n_steps, n_outputs)), np.empty((n_steps, n_outputs))
        gain, following = np.empty(n), np.empty(n)
        limited = n_substeps > 0
        # The winch's stage works on the rows of a single environment, and on scratch rows.
        rows, scratch_rows = np.zeros(N_FIXED), np.zeros(N_SCRATCH)
        S, scratch = block_at(rows.ctypes.data, 0, 1, 0), block_at(scratch_rows.ctypes.data, 0, 1, 0)
        S[WINCH_RATE_CONSTANT], S[WINCH_DECAY] = drum[0], drum[1]
        S[SPEED_LIMIT], S[ACCELERATION_LIMIT], S[STROKE_LIMIT] = drum[2], drum[3], drum[4]
        for k in range(n_steps):
            # The noises of the channels are independent: one after the other corrects by the same.
            for j in range(n_outputs):
                innovation, variance = y[k, j], v[j]
                for a in range(n):
                    total = 0.0
                    for b in range(n):
                        total += P[a, b] * C[j, b]
                    gain[a] = total
                    innovation -= C[j, a] * x[a]
                    variance += C[j, a] * total
                z[k, j], logs[k, j] = innovation / np.sqrt(variance), np.log(variance)
                for a in range(n):
                    x[a] += gain[a] * innovation / variance
                    for b in range(n):
                        P[a, b] -= gain[a] * gain[b] / variance
            if limited and k == 0 and moving:
                for a in range(n):
                    rate -= row[a] * x[a]
                rate = max(min(rate, drum[2]), -drum[2])
            for a in range(n):
                total = mean_B[a] * u0[k]
                for b in range(n):
                    total += mean_A[a, b] * x[b]
                following[a] = total
            if limited:
                S[WINCH_DISPLACEMENT], S[WINCH_RATE] = x[2], rate
                for i in range(n_substeps):
                    age = -((i - n_delayed) // n_substeps)
                    command = u0[k] if age <= 0 else x[2 + age]
                    limited_winch_step(S, scratch, command, dt, not ramps)
                    for a in range(2):
                        following[a] += (
                            forcing[4 * i, a] * scratch[WINCH_OLD]
                            + forcing[4 * i + 1, a] * scratch[WINCH_RATE_START]
                            + forcing[4 * i + 2, a] * S[WINCH_DISPLACEMENT]
                            + forcing[4 * i + 3, a] * S[WINCH_RATE]
                        )
                following[2], rate = S[WINCH_DISPLACEMENT], S[WINCH_RATE]
            x[:] = following
            for a in range(n):
                for b in range(n):
                    total = 0.0
                    for c in range(n):
                        total += A[a, c] * P[c, b]
                    AP[a, b] = total
            for a in range(n):
                for b in range(a + 1):
                    total = W[a, b]
                    for c in range(n):
                        total += AP[a, c] * A[b, c]
                    P[a, b] = P[b, a] = total
        # The blocks know their memory by address alone: it must live until here.
        rows[0] = scratch_rows[0] = 0.0
        return z, logs, x, rate, P

    return _filter_record


@dataclass(frozen=True)
class Filtered:
    """A record as a scenario's filter goes through it."""

    innovations: Array
    """Divided by their standard deviations, channel by channel, (n_steps, n_outputs)."""
    log_variances: Array
    """Logarithms of their variances, (n_steps, n_outputs)."""
    prior: Array
    """Estimate of the state after the last command, (n_states,)."""
    rate: float
    """The drum's rate then [m/s]; zero where the winch has no limits."""
    covariance: Array
    """Of the estimate's error then, (n_states, n_states)."""

    @property
    def surprise(self) -> float:
        """Negative logarithm of the likelihood, but for a constant."""
        return 0.5 * float(np.sum(self.innovations**2) + np.sum(self.log_variances))


def filter_of(scenario: Scenario) -> KalmanFilter | Estimator:
    """The filter that `lqg` and `mpc` have for a scenario."""
    if scenario.winch.is_limited:
        return estimator(scenario)
    return kalman_filter(scenario)


def filter_record(filter: KalmanFilter | Estimator, y: Array, commands: Array) -> Filtered:
    """Takes a record through a filter, which begins as it does in an episode.

    The gains are optimal at every instant; a controller's own become stationary in the end, to
    `baselines.kalman.START_TOLERANCE`.

    Args:
        filter: On the linear model, or beside a winch with limits.
        y: Measurements in the order of the filter's outputs [SI], (n_steps, n_outputs).
        commands: Given after each of them [m], (n_steps,).
    """
    linear = filter.filter if isinstance(filter, Estimator) else filter
    model = linear.model
    drum, forcing, row = np.full(5, np.inf), np.zeros((0, 2)), np.zeros(model.n_states)
    mean_A, mean_B, dt, n_delayed, ramps, moving = model.A, model.B, 0.0, 0, False, False
    if isinstance(filter, Estimator):
        winch = filter.winch
        limits = (winch.speed_limit, winch.acceleration_limit, winch.stroke_limit)
        drum = np.array([winch.rate_constant, winch.decay, *limits])
        mean_A, mean_B = filter.matrices
        forcing, row, dt = filter.forcing, filter.boom_tip_rate, winch.dt
        n_delayed, ramps = winch.n_delayed, winch.ramps
        moving = filter.begins_compensated
    run = _compiled(source_fingerprint())
    arrays = [model.A, model.C, model.W, np.diag(model.V), model.start_covariance, mean_A, mean_B[:, 0]]
    z, logs, prior, rate, covariance = run(
        *(np.ascontiguousarray(array, dtype=float) for array in (*arrays, drum, forcing, row)),
        n_delayed,
        dt,
        ramps,
        moving,
        np.ascontiguousarray(y, dtype=float),
        np.ascontiguousarray(commands, dtype=float),
    )
    return Filtered(z, logs, prior, float(rate), covariance)


# The parameters under which a record is likeliest -------------------------------------------------


def at_shares(scenario: Scenario, shares: Array) -> Scenario:
    """The scenario whose drawn parameters have these shares of their prior, (n_parameters,)."""
    return scenario.with_drawn(
        {
            draw.parameter: draw.quantile(float(share))
            for draw, share in zip(scenario.uncertainty, shares, strict=True)
        }
    )


def delay_share(scenario: Scenario) -> tuple[int, float] | None:
    """Place of the command delay among the drawn parameters and the share of a solver step, if drawn."""
    for i, draw in enumerate(scenario.uncertainty):
        if draw.parameter == "winch.command_delay" and draw.high > draw.low:
            return i, scenario.solver_dt / (draw.high - draw.low)
    return None


@dataclass(frozen=True)
class Estimate:
    """Parameters of a scenario, and what a record says of them."""

    shares: Array
    """Of the prior, (n_parameters,)."""
    filtered: Filtered
    """The record under them."""

    @property
    def objective(self) -> float:
        """Negative logarithm of the posterior, but for a constant."""
        found = self.filtered.surprise + 0.5 * PRIOR_PRECISION * float(np.sum((self.shares - 0.5) ** 2))
        return found if np.isfinite(found) else np.inf


def evaluate(scenario: Scenario, shares: Array, y: Array, commands: Array) -> Estimate:
    """Takes the record through the filter of these parameters."""
    return Estimate(shares, filter_record(filter_of(at_shares(scenario, shares)), y, commands))


@dataclass(frozen=True)
class Slopes:
    """The objective's quadratic about an estimate."""

    gradient: Array
    """(n_parameters,)."""
    curvature: Array
    """Gauss and Newton's, (n_parameters, n_parameters)."""

    def increase(self, step: Array) -> float:
        """What a step adds to the objective."""
        return float(self.gradient @ step + 0.5 * step @ self.curvature @ step)


def slopes(scenario: Scenario, at: Estimate, y: Array, commands: Array) -> Slopes:
    """Derivatives by differences: one pass over the record for each parameter."""
    shares, z, logs = at.shares, at.filtered.innovations, at.filtered.log_variances
    delay = delay_share(scenario)
    of_z, of_logs = np.empty((len(shares), z.size)), np.empty((len(shares), z.size))
    for i in range(len(shares)):
        size = delay[1] if delay is not None and i == delay[0] else DIFFERENCE
        moved = shares.copy()
        moved[i] += size if moved[i] + size < 1.0 - EDGE else -size
        other = evaluate(scenario, moved, y, commands).filtered
        of_z[i] = ((other.innovations - z) / (moved[i] - shares[i])).ravel()
        of_logs[i] = ((other.log_variances - logs) / (moved[i] - shares[i])).ravel()
    gradient = of_z @ z.ravel() + 0.5 * of_logs.sum(axis=1) + PRIOR_PRECISION * (shares - 0.5)
    # A quarter, not half: the normalised innovations' own slopes hold the other quarter.
    curvature = of_z @ of_z.T + 0.25 * of_logs @ of_logs.T + PRIOR_PRECISION * np.eye(len(shares))
    return Slopes(gradient, curvature)


def improved(scenario: Scenario, at: Estimate, y: Array, commands: Array) -> tuple[Estimate, float]:
    """Goes one step of Gauss and Newton towards the parameters under which the record is most probable.

    A delay of whole solver steps is a valley for each; where a neighbouring one may lie as low, it is gone
    down into for a step of its own.

    Args:
        scenario: The operation with its prior.
        at: Where the step begins, for the same record.
        y: Measurements [SI], (n_steps, n_outputs).
        commands: [m], (n_steps,).

    Returns:
        A better estimate, or the same if none was found, and the length of the step in standard deviations.
    """
    quadratic, delay = slopes(scenario, at, y, commands), delay_share(scenario)
    best = _stepped(scenario, at, quadratic, None, y, commands)
    if delay is not None:
        place, size = delay
        for neighbour in (best.shares[place] - size, best.shares[place] + size):
            if not 0.0 <= neighbour <= 1.0:
                continue
            held = {place: neighbour}
            target = _bounded(at.shares, quadratic, held)
            expected = at.objective + quadratic.increase(target - at.shares)
            if expected > best.objective + 5.0 * VALLEY:
                continue
            trial = evaluate(scenario, target, y, commands)
            if trial.objective < best.objective + VALLEY:
                around = slopes(scenario, trial, y, commands)
                trial = _stepped(scenario, trial, around, held, y, commands)
                best = min(best, trial, key=lambda estimate: estimate.objective)
    step = best.shares - at.shares
    return best, float(np.sqrt(step @ quadratic.curvature @ step))


def _stepped(
    scenario: Scenario,
    at: Estimate,
    quadratic: Slopes,
    held: dict[int, float] | None,
    y: Array,
    commands: Array,
) -> Estimate:
    """Newton's step, shortened until it lowers the objective; the same estimate if it does not."""
    for damping in DAMPINGS:
        diagonal = np.diag(np.diag(quadratic.curvature))
        damped = Slopes(quadratic.gradient, quadratic.curvature + damping * diagonal)
        targets = [_bounded(at.shares, damped, held)]
        delay = delay_share(scenario) if held is None else None
        if delay is not None:
            place, size = delay
            wanted = (targets[0][place] - at.shares[place]) / size
            values = {at.shares[place] + round_(wanted) * size for round_ in (np.floor, np.ceil)}
            targets = [_bounded(at.shares, damped, {place: min(max(value, 0.0), 1.0)}) for value in values]
        trials = [evaluate(scenario, target, y, commands) for target in targets]
        best = min(trials, key=lambda estimate: estimate.objective)
        if best.objective < at.objective:
            return best
    return at


def _bounded(shares: Array, quadratic: Slopes, fixed: dict[int, float] | None = None) -> Array:
    """Minimum of a quadratic within the prior's ends: who leaves them is held there and the others follow."""
    gradient, curvature = quadratic.gradient, quadratic.curvature
    held = dict(fixed or {})
    while True:
        target = shares.copy()
        for i, value in held.items():
            target[i] = value
        loose = [i for i in range(len(shares)) if i not in held]
        if loose:
            pull = gradient + curvature @ (target - shares)
            target[loose] -= np.linalg.solve(curvature[np.ix_(loose, loose)], pull[loose])
        out = [i for i in loose if not EDGE <= target[i] <= 1.0 - EDGE]
        if not out:
            return target
        for i in out:
            held[i] = float(np.clip(target[i], EDGE, 1.0 - EDGE))
