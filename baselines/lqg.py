"""The stochastic-optimal controller: Kalman filter and Riccati gain in series, delay and sea included.

The gain acts on the estimate of the payload, the winch, the commands under way and the sea's own states: it
knows what the boom tip is about to do. Where the whole state is observed exactly (`full_state` with a shaping
filter) it needs no filter and no memory.

On a linear scenario without limits it is optimal, and its predicted cost is what no causal controller with
the same sensors can beat (see `baselines.bound`). On a cable it is the optimum of the identified model.

Source: Huang (1992), 6.3.4, (6.28)-(6.31); Åström (1970), separation theorem.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

from baselines.estimator import Estimator
from baselines.estimator import estimator as limited_estimator
from baselines.kalman import KalmanFilter, continuous_filter, kalman_filter
from baselines.linear_controller import LinearController, controller, observation_units
from baselines.lqr import continuous_gain, design_weights, sampled_gain
from baselines.model import ContinuousModel, linear_model
from heave_env.scenarios import Scenario
from heave_env.sea import Array


@dataclass(frozen=True, eq=False)
class StochasticOptimal(LinearController):
    """Filter and gain in series; the memory is the prior estimate and the steps since the episode began.

    The matrices F, G, H, L, D are those of the stationary filter.
    """

    estimator: KalmanFilter | None = None

    @property
    def n_memory(self) -> int:
        """Numbers remembered from step to step [-]."""
        return len(self.F) + 1

    def respond(self, y: Array, memory: Array) -> tuple[Array, Array]:
        """Command in metres, (n_envs, 1), and the next memory, for measurements in SI units."""
        assert self.estimator is not None and self.gain is not None
        prior, step = memory[:, :-1], memory[:, -1]
        estimate = self.estimator.corrected(prior, y, step)
        command = self.clipped(-(estimate @ self.gain.T))
        return command, np.column_stack([self.estimator.advanced(estimate, command), step + 1.0])


@dataclass(frozen=True, eq=False)
class LimitedStochasticOptimal(LinearController):
    """Filter and gain in series beside a winch with limits, which the filter reckons with; the gain does not,
    and its command is clipped, and sent so that dead band and rounding matter least. The memory is the
    estimator's; the matrices are those without limits."""

    estimator: Estimator | None = None
    speed_weight: float = 0.0
    """Weight of the squared winch rate in the design [s²/m²]."""

    @property
    def n_memory(self) -> int:
        """Numbers remembered from step to step [-]."""
        assert self.estimator is not None
        return self.estimator.n_memory

    def respond(self, y: Array, memory: Array) -> tuple[Array, Array]:
        """Command in metres, (n_envs, 1), and the next memory, for measurements in SI units."""
        assert self.estimator is not None and self.gain is not None
        measured, tension = self.estimator.parted(y)
        estimate, rate = self.estimator.corrected(memory, measured)
        command = self.clipped(-(estimate @ self.gain.T))
        command = self.estimator.shaped(estimate, rate, command, tension)
        return command, self.estimator.advanced(memory, estimate, rate, command, tension)


def lqg(
    scenario: Scenario,
    *,
    command_weight: float | None = None,
    speed_weight: float = 0.0,
    mismatch: float = 1.0,
) -> LinearController:
    """Designs the stochastic-optimal controller for a scenario and its sensors.

    Args:
        scenario: The operation; its task weighs position against command.
        command_weight: r of the design [1/m²]; the task's own if not given.
        speed_weight: Weight of the squared winch rate in the design [s²/m²]: caution where limits bite.
        mismatch: How many times the residual of the identification the model of a cable is doubted by.

    Raises:
        ValueError: If the sea is calm, or nothing that the model expresses is measured.
    """
    q, r = design_weights(scenario, command_weight)
    if not (math.isfinite(speed_weight) and speed_weight >= 0.0):
        raise ValueError(f"speed_weight must be a number, not negative, got {speed_weight!r}")
    model = linear_model(scenario)
    gain, _ = sampled_gain(model.A, model.B, q, r, speed_weight=speed_weight / scenario.control_dt**2)
    index = model.energy_index(gain)
    if sees_everything(scenario):
        return controller(
            "lqg",
            scenario,
            model.states,
            D=gain,
            gain=gain,
            states=model.states,
            energy_index=index,
            truth=model,
            command_weight=r,
        )
    estimator = kalman_filter(scenario, mismatch=mismatch)
    A, B, C, M = model.A, model.B, estimator.model.C, estimator.gain
    # estimate = (I - M C) prior + M y, in the form of `LinearController` with the prior as its memory.
    rest = np.eye(model.n_states) - M @ C
    stationary = controller(
        "lqg",
        scenario,
        estimator.model.outputs,
        F=A @ rest,
        G=A @ M,
        H=B,
        L=gain @ rest,
        D=gain @ M,
        gain=gain,
        states=model.states,
        energy_index=index,
        truth=model,
        command_weight=r,
    )
    parts = {item.name: getattr(stationary, item.name) for item in fields(stationary)}
    if scenario.winch.is_limited:
        limited = limited_estimator(scenario, mismatch=mismatch)
        parts["measures"] = limited.measures
        parts["scale"], parts["offset"] = observation_units(scenario, limited.measures)
        return LimitedStochasticOptimal(**parts, estimator=limited, speed_weight=speed_weight)
    return StochasticOptimal(**parts, estimator=estimator)


def sees_everything(scenario: Scenario) -> bool:
    """Whether the observation holds the model's whole state without noise."""
    if not scenario.observed_filter_states or not scenario.is_linear:
        # A cable has more states than its model: a filter finds what the model misses.
        return False
    return set(linear_model(scenario).states) <= set(scenario.observation_names)


def predicted_cost(scenario: Scenario, estimator: KalmanFilter | None) -> float:
    """Average cost of the optimal controller by the trace formula, tr(S W) + tr(Kᵀ (Bᵀ S B + r) K Σ).

    The first term is what the sea costs even when it is known, the second what not knowing it adds; Σ is the
    covariance of the estimate's error.

    Args:
        scenario: The operation.
        estimator: The filter, or None when the state is observed exactly.
    """
    model = linear_model(scenario)
    r = scenario.task.command_weight
    K, S = sampled_gain(model.A, model.B, scenario.task.position_weight, r)
    cost = float(np.trace(S @ model.W))
    if estimator is not None:
        error = (K @ estimator.posterior_covariance @ K.T).item()
        cost += error * (r + (model.B.T @ S @ model.B).item())
    return cost


@dataclass(frozen=True)
class ContinuousPerformance:
    """Stationary figures of the thesis's continuous design."""

    payload_heave_std: float
    """[m]."""
    command_std: float
    """[m]."""
    energy_index: float
    """sqrt(Σ G²) in the thesis's coordinates [-]."""


def continuous_performance(
    model: ContinuousModel,
    position_weight: float,
    command_weight: float,
    *,
    outputs: Array | None = None,
    densities: Array | None = None,
) -> ContinuousPerformance:
    """The thesis's continuous stochastic-optimal design, on its own model.

    Args:
        model: (6.28).
        position_weight: q [1/m²].
        command_weight: r [1/m²].
        outputs: Measured outputs (n_outputs, n_states); None: the whole state is known.
        densities: Spectral density of each output's white noise [unit² s], (n_outputs,).
    """
    gain = continuous_gain(model.A, model.B1, position_weight, command_weight)
    if outputs is None or densities is None:
        P = model.covariance(gain)
        covariance, estimate = P, P
    else:
        # The error is uncorrelated with the estimate, which is driven by the innovation M C e + M noise.
        M, error = continuous_filter(model, outputs, densities)
        closed = model.A - model.B1 @ gain
        estimate = solve_continuous_lyapunov(closed, -M @ np.diag(densities) @ M.T)
        covariance = estimate + error
    return ContinuousPerformance(
        payload_heave_std=float(np.sqrt(covariance[0, 0])),
        command_std=float(np.sqrt((gain @ estimate @ gain.T).item())),
        energy_index=model.energy_index(gain),
    )
