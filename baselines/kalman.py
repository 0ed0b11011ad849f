"""The Kalman filter on what the sensors really give.

In the current-estimator form: the measurement of an instant corrects the prior estimate of the same instant,

    estimate = prior + M (y - C prior),   next prior = A estimate + B u0,   M = P Cᵀ (C P Cᵀ + V)⁻¹,

with P the prior's covariance from the discrete Riccati equation. Pending commands are known, not estimated:
they are no outputs of the filter and have no covariance.

The sea's slow states take minutes to settle in a stationary filter. It therefore begins with the gains that
are optimal from the first instant of an episode, whose distribution is known (the sea stationary, the payload
where the scenario starts it), and goes over to the stationary gain.

Source: Kalman (1960); Franklin, Powell and Workman (1998), current estimator; Huang (1992), 6.3.4.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import solve_continuous_are, solve_discrete_are

from baselines.model import MODELLED_CHANNELS, ContinuousModel, LinearModel, linear_model, noise_floor
from heave_env.scenarios import Scenario
from heave_env.sea import Array

START_STEPS = 4000
"""Steps of an episode after which a starting gain is held unless a filter says otherwise [-]."""
START_TOLERANCE = 1e-3
"""Relative difference from the stationary gain at which the start is over [-]."""


@dataclass(frozen=True, eq=False)
class KalmanFilter:
    """Filter of a scenario; estimates are rows (n_envs, n_states) in the model's SI units."""

    model: LinearModel
    """The model, seen through the outputs that the filter uses."""
    n_start: int = START_STEPS
    """Steps after which a starting gain is held, settled or not [-]."""

    @cached_property
    def prior_covariance(self) -> Array:
        """Stationary, of the estimate's error before the measurement, (n_states, n_states)."""
        return filter_covariance(self.model.A, self.model.C, self.model.W, self.model.V)

    @cached_property
    def gain(self) -> Array:
        """Stationary M, (n_states, n_outputs)."""
        C, P = self.model.C, self.prior_covariance
        return np.asarray(np.linalg.solve(C @ P @ C.T + self.model.V, C @ P).T)

    @cached_property
    def start_gains(self) -> Array:
        """M of the first steps of an episode, (n_start, n_states, n_outputs); the last one stays in use."""
        return starting_gains(self.model, self.gain, n_start=self.n_start)

    @cached_property
    def posterior_covariance(self) -> Array:
        """Of the estimate's error after the measurement (Joseph's form), (n_states, n_states)."""
        rest = np.eye(self.model.n_states) - self.gain @ self.model.C
        return np.asarray(rest @ self.prior_covariance @ rest.T + self.gain @ self.model.V @ self.gain.T)

    def corrected(self, prior: Array, measurement: Array, step: Array) -> Array:
        """Estimate after a measurement.

        Args:
            prior: Estimate before it, (n_envs, n_states).
            measurement: In SI units, (n_envs, n_outputs).
            step: Steps since each row's episode began, (n_envs,).
        """
        innovation = measurement - prior @ self.model.C.T
        stage = np.minimum(step, len(self.start_gains) - 1).astype(int)
        if stage.min() == stage.max():
            return np.asarray(prior + innovation @ self.start_gains[stage[0]].T)
        return np.asarray(prior + np.einsum("nsy,ny->ns", self.start_gains[stage], innovation))

    def advanced(self, estimate: Array, command: Array) -> Array:
        """Next prior after a command in metres, (n_envs, 1)."""
        return np.asarray(estimate @ self.model.A.T + command @ self.model.B.T)


def filter_covariance(A: Array, C: Array, W: Array, V: Array) -> Array:
    """Stationary covariance of the prior's error, A P Aᵀ - A P Cᵀ (C P Cᵀ + V)⁻¹ C P Aᵀ + W = P.

    SciPy's solver on the dual problem; where it finds no answer (states spread over too many orders of
    magnitude), structure-preserving doubling.

    Raises:
        ValueError: If no stationary filter exists.
    """
    size = np.sqrt(np.diag(V))
    C, V = C / size[:, None], V / size[:, None] / size
    try:
        P = np.asarray(solve_discrete_are(A.T, C.T, W, V))
    except (np.linalg.LinAlgError, ValueError):
        P = doubled_riccati(A, C, W, V)
    return 0.5 * (P + P.T)


def doubled_riccati(A: Array, C: Array, W: Array, V: Array, *, n_doublings: int = 60) -> Array:
    """The same by structure-preserving doubling: iteration k reaches the covariance after 2^k steps.

    Source: Anderson (1978); Chu et al. (2004).

    Raises:
        ValueError: If it does not converge.
    """
    # Dual regulator: transition Aᵀ, weight W, and input matrix Cᵀ with weight V.
    transition, G, H = A.T.copy(), C.T @ np.linalg.solve(V, C), W.copy()
    eye = np.eye(len(A))
    for _ in range(n_doublings):
        inverse = np.linalg.solve(eye + G @ H, np.hstack([transition, G]))
        forward, mixed = inverse[:, : len(A)], inverse[:, len(A) :]
        H_next = H + transition.T @ H @ forward
        G = G + transition @ mixed @ transition.T
        transition = transition @ forward
        change = float(np.max(np.abs(H_next - H)))
        H = 0.5 * (H_next + H_next.T)
        if not np.isfinite(change):
            break
        if change <= 1e-14 * float(np.max(np.abs(H))):
            return np.asarray(H)
    raise ValueError(
        "no stationary Kalman filter exists for this scenario's sensors; add a sensor, or noise to one"
    )


def filter_outputs(scenario: Scenario) -> tuple[str, ...]:
    """Entries of the observation that a filter corrects by: newest samples that the model expresses."""
    return tuple(
        name
        for name in scenario.observation_names
        if name in MODELLED_CHANNELS or name.startswith("filter_state")
    )


def starting_gains(model: LinearModel, gain: Array, *, n_start: int = START_STEPS) -> Array:
    """Gains from an episode's first instant until they have become the stationary one.

    Args:
        model: The model, seen through the filter's outputs.
        gain: The stationary gain, (n_states, n_outputs).
        n_start: Gains that are wanted at most [-].

    Returns:
        (n_start, n_states, n_outputs), or fewer.
    """
    A, C, W, V = model.A, model.C, model.W, model.V
    P = model.start_covariance
    size = np.sqrt(np.diag(V))
    gains: list[Array] = []
    while len(gains) < n_start:
        M = np.linalg.solve(C @ P @ C.T + V, C @ P).T
        gains.append(M)
        if np.linalg.norm((M - gain) * size) <= START_TOLERANCE * np.linalg.norm(gain * size):
            break
        rest = np.eye(len(A)) - M @ C
        P = A @ (rest @ P @ rest.T + M @ V @ M.T) @ A.T + W
    return np.array(gains)


def kalman_filter(scenario: Scenario, *, mismatch: float = 1.0) -> KalmanFilter:
    """Designs the filter for a scenario's sensors.

    Args:
        scenario: The operation.
        mismatch: How many times the residual of the identification the model of a cable is doubted by.

    Raises:
        ValueError: If the sea is calm or nothing that the model expresses is measured.
    """
    outputs = filter_outputs(scenario)
    if not outputs:
        raise ValueError(
            f"scenario {scenario.name!r} measures nothing that a linear filter can use; add a sensor of "
            f"{', '.join(MODELLED_CHANNELS)}"
        )
    return filter_on(scenario, linear_model(scenario, mismatch=mismatch).select(outputs))


def boom_tip_kalman_filter(scenario: Scenario) -> KalmanFilter:
    """Designs the filter that knows nothing but the sea, the vessel, and what is measured of the boom tip.

    Its model has the winch and the commands under way beside the boom tip, and no payload.

    Raises:
        ValueError: If the sea is calm, or the boom tip is not measured.
    """
    outputs = tuple(
        name for name in filter_outputs(scenario) if name.startswith(("boom_tip", "filter_state"))
    )
    if not outputs:
        raise ValueError(
            f"scenario {scenario.name!r} does not measure the boom tip (its newest measurements: "
            f"{', '.join(measured_channels(scenario))}); add a sensor of boom_tip_heave"
        )
    whole = linear_model(scenario).select(outputs)
    kept = [i for i, name in enumerate(whole.states) if not name.startswith("payload_heave")]
    square = np.ix_(kept, kept)
    model = replace(
        whole,
        A=whole.A[square],
        B=whole.B[kept],
        C=whole.C[:, kept],
        W=whole.W[square],
        states=tuple(whole.states[i] for i in kept),
        thesis_sizes=whole.thesis_sizes[kept],
        start_covariance=whole.start_covariance[square],
    )
    return filter_on(scenario, model)


def measured_channels(scenario: Scenario) -> tuple[str, ...]:
    """Entries of the observation that are newest samples of channels."""
    return tuple(sensor.channel for sensor in scenario.observed_sensors)


def filter_on(scenario: Scenario, model: LinearModel) -> KalmanFilter:
    """The filter on a model of the scenario, seen through the outputs to be used."""
    if scenario.observed_filter_states:
        # Filter states have no sensor: they are seen exactly, but for the floor.
        model = replace(model, V=np.diag(np.maximum(np.diag(model.V), noise_floor(scenario) ** 2)))
    return KalmanFilter(model)


def continuous_filter(model: ContinuousModel, C: Array, densities: Array) -> tuple[Array, Array]:
    """Kalman-Bucy filter of the thesis's continuous model.

    Args:
        model: The model with its sea.
        C: Measured outputs, (n_outputs, n_states).
        densities: Spectral density of each output's white noise [unit² s], (n_outputs,).

    Returns:
        Gain (n_states, n_outputs) and covariance of the estimate's error (n_states, n_states).
    """
    V = np.diag(densities)
    P = solve_continuous_are(model.A.T, C.T, model.noise, V)
    return np.asarray(P @ C.T @ np.linalg.inv(V)), np.asarray(P)
