"""The stochastic-optimal controller along a pay-out that is known beforehand: linear-quadratic, time-varying.

The plan gives the model of every control step, s_{k+1} = A_k s_k + B_k u0_k + f_k + w_k, y_k = C s_k + e_k.
Its optimum is the gain of the backward Riccati recursion and the filter of the forward one,

    H_k = R + B_kᵀ S_{k+1} B_k,              K_k = H_k⁻¹ B_kᵀ S_{k+1} A_k
    S_k = Q + A_kᵀ S_{k+1} (A_k - B_k K_k),  g_k = S_{k+1} f_k + p_{k+1}
    κ_k = H_k⁻¹ B_kᵀ g_k,                    p_k = (A_k - B_k K_k)ᵀ g_k
    u0_k = -K_k estimate_k - κ_k
    M_k = P_k Cᵀ (C P_k Cᵀ + V)⁻¹,           P_{k+1} = A_k (I - M_k C) P_k A_kᵀ + W_k

(P in Joseph's form; a weight on the winch's speed has cross terms). κ_k is the answer to what pay-out will do
to the payload, all of it still to come included. After the last step the operation is taken to go on as it
stands then: the recursion begins with the stationary cost matrix. Delay and delayed sensors are states, exact
at the control instants; a and b are those in the middle of each step.

It follows the plan's clock and measures no length: where the plan is not kept, `gain_scheduled` knows more.

Source: Åström (1970), chapter 8; Kwakernaak and Sivan (1972), chapter 6.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from baselines.changing_length import changes_length, length_models, mixed
from baselines.gain_scheduled import (
    ScheduledController,
    drum_forcing,
    require_outputs,
    require_speed_weight,
    scheduled_controller,
)
from baselines.kalman import filter_on
from baselines.linear_controller import LinearController
from baselines.lqg import lqg
from baselines.lqr import design_weights, sampled_gain, stage_weights
from heave_env.scenarios import Scenario
from heave_env.sea import Array


@dataclass(frozen=True, eq=False)
class TimeVaryingModel:
    """s_{k+1} = A_k s_k + B_k u0_k + f_k + w_k, y_k = C s_k + e_k, over a number of control steps."""

    A: Array
    """(n_steps, n_states, n_states)."""
    B: Array
    """(n_steps, n_states, 1)."""
    f: Array
    """Known input, (n_steps, n_states)."""
    W: Array
    """Covariance of the process noise, (n_steps, n_states, n_states)."""
    C: Array
    """(n_outputs, n_states)."""
    V: Array
    """Covariance of the measurement noise, (n_outputs, n_outputs)."""
    start_covariance: Array
    """Of the state at the first instant, whose mean is zero, (n_states, n_states)."""

    @property
    def n_steps(self) -> int:
        """Control steps [-]."""
        return len(self.A)


@dataclass(frozen=True, eq=False)
class TimeVaryingRegulator:
    """The backward recursion's answer; index k is the control step."""

    K: Array
    """Feedback gains, (n_steps, 1, n_states)."""
    known_command: Array
    """κ [m], (n_steps,)."""
    S: Array
    """Cost matrices, the first state's q at that instant included, (n_steps + 1, n_states, n_states)."""
    p: Array
    """Linear part of the cost to go, halved, (n_steps + 1, n_states)."""
    stiffness: Array
    """H, what a command's error costs, (n_steps,)."""


@dataclass(frozen=True, eq=False)
class TimeVaryingFilter:
    """The forward recursion's answer; index k is the control instant."""

    M: Array
    """Filter gains, (n_steps, n_states, n_outputs)."""
    prior: Array
    """Covariance of the error before the measurement, (n_steps + 1, n_states, n_states)."""
    posterior: Array
    """And after it, (n_steps, n_states, n_states)."""


def time_varying_regulator(
    model: TimeVaryingModel, position_weight: float, command_weight: float, *, speed_weight: float = 0.0
) -> TimeVaryingRegulator:
    """Gains that minimise the expected sum of q x_{k+1}² + r u0_k² and of what comes after the last step.

    Args:
        model: The model along the plan; x is its first state, the winch's displacement its third.
        position_weight: q [1/m²].
        command_weight: r [1/m²].
        speed_weight: Weight of the winch's squared displacement over a step [1/m²].
    """
    n_steps, n = model.n_steps, model.A.shape[1]
    K, known = np.empty((n_steps, 1, n)), np.empty(n_steps)
    S, p = np.empty((n_steps + 1, n, n)), np.zeros((n_steps + 1, n))
    stiffness = np.empty(n_steps)
    options = {"speed_weight": speed_weight}
    _, S[-1] = sampled_gain(model.A[-1], model.B[-1], position_weight, command_weight, **options)
    for k in range(n_steps - 1, -1, -1):
        A, B, f = model.A[k], model.B[k], model.f[k]
        Q, R, cross = stage_weights(A, B, position_weight, command_weight, **options)
        towards = B.T @ S[k + 1]
        stiffness[k] = (R + towards @ B).item()
        K[k] = (towards @ A + cross.T) / stiffness[k]
        pull = S[k + 1] @ f + p[k + 1]
        known[k] = (B.T @ pull).item() / stiffness[k]
        now = Q + A.T @ S[k + 1] @ A - stiffness[k] * K[k].T @ K[k]
        S[k] = 0.5 * (now + now.T)
        p[k] = (A - B @ K[k]).T @ pull
    return TimeVaryingRegulator(K, known, S, p, stiffness)


def time_varying_filter(model: TimeVaryingModel) -> TimeVaryingFilter:
    """Filter that is optimal at every instant, from the first on."""
    n_steps, n = model.n_steps, model.A.shape[1]
    C, V, eye = model.C, model.V, np.eye(n)
    M = np.empty((n_steps, n, len(C)))
    prior, posterior = np.empty((n_steps + 1, n, n)), np.empty((n_steps, n, n))
    prior[0] = model.start_covariance
    for k in range(n_steps):
        P = prior[k]
        M[k] = np.linalg.solve(C @ P @ C.T + V, C @ P).T
        rest = eye - M[k] @ C
        posterior[k] = rest @ P @ rest.T + M[k] @ V @ M[k].T
        prior[k + 1] = model.A[k] @ posterior[k] @ model.A[k].T + model.W[k]
    return TimeVaryingFilter(M, prior, posterior)


def expected_cost(
    model: TimeVaryingModel,
    regulator: TimeVaryingRegulator,
    found: TimeVaryingFilter,
    position_weight: float,
) -> float:
    """Expected cost of the whole plan by the trace formula along time, the end's s_Nᵀ (S_N - Q) s_N included.

    tr((S_0 - Q) P_0) + Σ_k tr(S_{k+1} W_k) + H_k (K_k Σ_k K_kᵀ - κ_k²) + f_kᵀ (S_{k+1} f_k + 2 p_{k+1})

    Σ is the covariance of the estimate's error after the measurement. Without a speed weight.
    """
    S, p, f = regulator.S, regulator.p[1:], model.f
    of_start = S[0].copy()
    of_start[0, 0] -= position_weight
    cost = np.trace(of_start @ model.start_covariance)
    cost += np.einsum("kij,kji->", S[1:], model.W)
    errors = np.einsum("kri,kij,krj->k", regulator.K, found.posterior, regulator.K)
    cost += np.sum(regulator.stiffness * (errors - regulator.known_command**2))
    cost += np.einsum("ki,kij,kj->", f, S[1:], f) + 2.0 * np.sum(p * f)
    return float(cost)


def expected_stage_costs(
    model: TimeVaryingModel,
    regulator: TimeVaryingRegulator,
    found: TimeVaryingFilter,
    position_weight: float,
    command_weight: float,
) -> Array:
    """Expected q x_{k+1}² + r u0_k² of each step, from the moments of estimate and error, (n_steps,)."""
    n = model.A.shape[1]
    mean, spread = np.zeros(n), np.zeros((n, n))
    costs = np.empty(model.n_steps)
    for k in range(model.n_steps):
        # What a measurement teaches goes from the error's covariance to the estimate's.
        spread = spread + found.prior[k] - found.posterior[k]
        K, A, B = regulator.K[k], model.A[k], model.B[k]
        command = -(K @ mean).item() - regulator.known_command[k]
        costs[k] = command_weight * (command**2 + (K @ spread @ K.T).item())
        closed = A - B @ K
        mean = A @ mean + B[:, 0] * command + model.f[k]
        spread = closed @ spread @ closed.T
        costs[k] += position_weight * (mean[0] ** 2 + spread[0, 0] + found.prior[k + 1][0, 0])
    return costs


@dataclass(frozen=True, eq=False)
class TimeVaryingOptimal(ScheduledController):
    """The optimum along the plan; entries of its tables are the steps of an episode."""

    expected_stage_costs: Array | None = None
    """Cost of each step by theory, without limits, with the task's weights [-], (n_steps,)."""


def plan_model(scenario: Scenario, *, mismatch: float = 1.0) -> TimeVaryingModel:
    """The model of a scenario with pay-out along its plan.

    Args:
        scenario: The operation.
        mismatch: How many times the residual of the identification the models are doubted by.
    """
    grid = length_models(scenario)
    nodes, weights = grid.along_profile
    push = mixed(grid.push, nodes, weights)
    first = filter_on(scenario, grid.models[0].select(require_outputs(scenario))).model
    f = np.zeros((len(push), first.n_states))
    f[:, :2] = push * grid.offset[:, None]
    A = mixed(grid.A, nodes, weights)
    return TimeVaryingModel(
        A=A,
        B=mixed(grid.B, nodes, weights),
        f=f,
        W=mixed(grid.W + mismatch**2 * grid.doubts, nodes, weights),
        C=first.C,
        V=first.V,
        start_covariance=first.start_covariance,
    )


def time_varying_lq(
    scenario: Scenario,
    *,
    command_weight: float | None = None,
    speed_weight: float = 0.0,
    mismatch: float = 1.0,
) -> LinearController:
    """Designs the optimum along the scenario's pay-out.

    Args:
        scenario: The operation; without pay-out the answer is `lqg`'s.
        command_weight: r of the design [1/m²]; the task's own if not given.
        speed_weight: Weight of the squared winch rate in the design [s²/m²]: caution where limits bite.
        mismatch: How many times the residual of the identification the models are doubted by.

    Raises:
        ValueError: If the sea is calm, or nothing that the model expresses is measured.
    """
    if not changes_length(scenario):
        same = lqg(scenario, command_weight=command_weight, speed_weight=speed_weight, mismatch=mismatch)
        return replace(same, name="time_varying_lq")
    q, r = design_weights(scenario, command_weight)
    speed = require_speed_weight(speed_weight) / scenario.control_dt**2
    grid = length_models(scenario)
    model = plan_model(scenario, mismatch=mismatch)
    regulator = time_varying_regulator(model, q, r, speed_weight=speed)
    found = time_varying_filter(model)
    nodes, weights = grid.along_profile
    limited = scenario.winch.is_limited
    made = scheduled_controller(
        "time_varying_lq",
        scenario,
        grid.models[0].select(require_outputs(scenario)),
        A=model.A,
        B=model.B,
        M=found.M,
        K=regulator.K,
        known_input=model.f,
        known_command=regulator.known_command,
        forcing=mixed(drum_forcing(scenario, grid), nodes, weights) if limited else None,
        command_weight=r,
        speed_weight=speed_weight,
    )
    task = scenario.task
    costs = expected_stage_costs(model, regulator, found, task.position_weight, task.command_weight)
    parts = {name: getattr(made, name) for name in ScheduledController.__dataclass_fields__}
    return TimeVaryingOptimal(**parts, expected_stage_costs=costs)
