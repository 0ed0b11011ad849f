"""Linear model of the plant, on which every designed controller rests.

States, in this order and in SI units:

    payload_heave x [m], payload_heave_rate x' [m/s], winch_displacement u [m],
    pending_command_1..n  commands given but not fully arrived, most recent first [m],
    filter_state_0..      boom-tip filter, in states of unit stationary variance [-],
    winch_rate u' [m/s]   of a second-order drive alone,
    channel[-i]           past samples that delayed sensors still have to report.

    a x'' + b x' + x = x0 + u,   u' = K (u0(t - delay) - u),   x0 = C_f f,   f' = A_f f + B_f w

or, for a second-order drive, u'' + 2 ζ ω u' + ω² u = ω² u0(t - delay).

The command is held over a control step and everything is discretised exactly (matrix exponential; Van
Loan's covariance for the noise), a delay that is no whole number of control steps included: the winch
then sees two commands within a step, one after the other.

What the model leaves out: limits of the winch, slack, the cable's own waves, the nonlinearity of the drag
(it enters through the identified a and b) and the change of length under pay-out. Sheave tension, length
and the rate of a winch with a lag are not among its outputs: the first two are no linear function of these
states, the third adds nothing, since the modelled winch has no noise and its commands are known.

Source: Huang (1992), (6.6), (6.23), (6.26), (6.28), 6.5; Van Loan (1978).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import expm, solve_continuous_lyapunov

from heave_env.parameters import LinearPayload, SeaState, Winch, peak_omega_of_zero_crossing_period
from heave_env.scenarios import Scenario
from heave_env.sea import (
    NOISE_INTENSITY,
    Array,
    LinearFilter,
    discretised_noise,
    read_motion,
    wave_filter,
)
from heave_env.vessel import boom_tip_filter, heave_response

if TYPE_CHECKING:
    from baselines.identification import PayloadFit

REGULAR_DAMPING = 0.005
"""Damping ratio of the oscillator that stands in for a regular sea [-]: narrow beside any payload resonance,
yet it forgets a wrong phase within some 30 periods."""
MODELLED_CHANNELS = (
    "payload_heave",
    "payload_heave_rate",
    "boom_tip_heave",
    "boom_tip_heave_rate",
    "winch_displacement",
)
"""Channels that are linear functions of the model's state."""
NOISE_FLOOR = 1e-6
"""Least noise that a measured channel is credited with, over its scale [-]: what single precision leaves of
an observation, and what keeps the filter's equations regular where a sensor is exact."""

DOUBT_FLOOR = 0.01
"""The same on a cable [-]: its higher modes, which the model has not, are noise to the filter."""


# The sea as the controllers see it ---------------------------------------------------------------


def nominal_sea(scenario: Scenario) -> SeaState | None:
    """The shaping-filter or regular sea that stands for the scenario's own in a design; None when calm.

    A random-phase sea of Bretschneider's spectrum is modelled by the thesis's filter of the same Hs and modal
    frequency, which holds 94 % of its variance, unless the sea asks for a fitted one; any other spectrum, and
    a boom tip by a table, by the filter fitted to it. A recorded motion is modelled by the thesis's filter of
    four times its standard deviation and of its zero-crossing period: two statistics of the file, not its
    course.
    """
    sea = scenario.sea_state
    if sea.kind == "calm":
        return None
    if sea.kind == "recorded":
        assert sea.recording is not None
        std, rate_std = _recorded_size(sea.recording, _modified(sea.recording))
        if std == 0.0 or rate_std == 0.0:
            return None
        period = 2.0 * math.pi * std / rate_std
        return SeaState(
            significant_wave_height=4.0 * std, peak_omega=peak_omega_of_zero_crossing_period(period)
        )
    if sea.kind == "regular":
        return sea
    if not sea.is_bretschneider or scenario.vessel_table is not None:
        return replace(sea, kind="shaping_filter", filter="fitted")
    return replace(sea, kind="shaping_filter")


def _modified(path: str) -> int:
    """When a file was last written, so that a changed one is read anew; 0 if it is not there."""
    try:
        return Path(path).stat().st_mtime_ns
    except OSError:
        return 0


@lru_cache(maxsize=16)
def _recorded_size(path: str, modified: int) -> tuple[float, float]:
    """Standard deviations of a recorded boom tip's heave and rate [m, m/s]."""
    recording = read_motion(path)
    span = float(recording.time[-1] - recording.time[0])
    heave, rate, _ = recording.sampled(np.linspace(0.0, span, max(1000, 2 * len(recording.time))))
    return float(np.std(heave)), float(np.std(rate))


def sea_filter(scenario: Scenario) -> LinearFilter | None:
    """White noise of intensity pi to boom-tip heave and its rate, in states of unit variance.

    The shaping filter behind the vessel; for a regular sea a lightly damped oscillator (`REGULAR_DAMPING`) at
    its frequency with the variance of the boom tip. None when the sea is calm.
    """
    sea = nominal_sea(scenario)
    if sea is None:
        return None
    if sea.kind != "regular":
        return boom_tip_filter(sea, scenario.boom_tip_vessel)
    omega = sea.peak_omega
    response = abs(complex(heave_response(np.array(omega), scenario.boom_tip_vessel)))
    amplitude = 0.5 * sea.significant_wave_height * response
    A = np.array([[0.0, 1.0], [-(omega**2), -2.0 * REGULAR_DAMPING * omega]])
    # Variance pi B² / (4 zeta omega³) of the oscillator's displacement is to be amplitude² / 2.
    intensity = amplitude * math.sqrt(2.0 * REGULAR_DAMPING * omega**3 / NOISE_INTENSITY)
    return LinearFilter(A, np.array([[0.0], [intensity]]), np.eye(2)).scaled()


def filter_state_sizes(scenario: Scenario) -> Array:
    """Standard deviations by which the filter states of unit variance multiply to those of the thesis.

    The thesis's states are those of (6.23) and (6.26), whose coordinates its energy index depends on.
    A regular sea has the oscillator's own heave and rate, a fitted filter, which the thesis does not know,
    its states of unit variance. Shape (n_filter_states,); empty when calm.
    """
    sea, scaled = nominal_sea(scenario), sea_filter(scenario)
    if sea is None or scaled is None:
        return np.zeros(0)
    if sea.kind == "regular":
        return np.asarray(np.diag(scaled.C))
    if sea.filter == "fitted":
        return np.ones(scaled.n_states)
    wave_sizes = np.sqrt(np.diag(wave_filter(sea).covariance))
    if scenario.vessel is None:
        return np.asarray(wave_sizes)
    output = scenario.vessel.gain * scenario.vessel.natural_omega**2
    return np.concatenate([np.diag(scaled.C[:, :2]) / output, wave_sizes])


# The payload as the controllers see it -----------------------------------------------------------


def payload_model(scenario: Scenario) -> LinearPayload:
    """The scenario's own linear payload, or that identified from its cable at the initial length."""
    if scenario.linear_payload is not None:
        return scenario.linear_payload
    from baselines.identification import identified_payload

    return identified_payload(scenario)


def regulator_matrices(payload: LinearPayload, rate_constant: float) -> tuple[Array, Array, Array]:
    """A, B and C of x' = A x + B u0 + C x0 for the states [x, x', u], (3, 3), (3, 1), (3, 1).

    Source: Huang (1992), (6.6).
    """
    a, b, K = payload.inertia, payload.damping, rate_constant
    A = np.array([[0.0, 1.0, 0.0], [-1.0 / a, -b / a, 1.0 / a], [0.0, 0.0, -K]])
    return A, np.array([[0.0], [0.0], [K]]), np.array([[0.0], [1.0 / a], [0.0]])


# Continuous time ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class ContinuousModel:
    """x' = A x + B1 u0 + B2 w, w white of intensity pi; no command delay.

    Source: Huang (1992), (6.28), with the filter's states scaled to unit variance.
    """

    A: Array
    """(n_states, n_states)."""
    B1: Array
    """Command input, (n_states, 1)."""
    B2: Array
    """Noise input, (n_states, 1)."""
    thesis_sizes: Array
    """One unit of each state in the thesis's coordinates, (n_states,)."""

    @property
    def noise(self) -> Array:
        """Intensity of the process noise, pi B2 B2ᵀ, (n_states, n_states)."""
        return np.asarray(NOISE_INTENSITY * self.B2 @ self.B2.T)

    def covariance(self, gain: Array | None = None) -> Array:
        """Stationary covariance of the state under u0 = -gain x (or no command), (n_states, n_states).

        Source: Huang (1992), (6.31).
        """
        A0 = self.A if gain is None else self.A - self.B1 @ gain
        P = solve_continuous_lyapunov(A0, -self.noise)
        return np.asarray(0.5 * (P + P.T))

    def response(self, omega: Array, gain: Array | None = None) -> Array:
        """Transfer function from noise to payload heave at iω, (n_omega,), complex; (6.33)."""
        A0 = self.A if gain is None else self.A - self.B1 @ gain
        s = 1j * np.asarray(omega, dtype=float)[:, None, None]
        return np.asarray(np.linalg.solve(s * np.eye(len(A0)) - A0, self.B2.astype(complex)[None])[:, 0, 0])

    def energy_index(self, gain: Array) -> float:
        """sqrt(Σ G²) of a gain on this model's states, in the thesis's coordinates [-]."""
        return float(np.linalg.norm(gain / self.thesis_sizes))


def with_drive(model: ContinuousModel, winch: Winch) -> ContinuousModel:
    """The model with a second-order drive in place of the winch's lag; its rate is one more state, the last.

    u'' + 2 ζ ω u' + ω² u = ω² u0
    """
    assert winch.natural_omega is not None
    w, z = winch.natural_omega, winch.damping_ratio
    n = len(model.A)
    A, B1 = np.pad(model.A, (0, 1)), np.pad(model.B1, ((0, 1), (0, 0)))
    A[2], B1[2] = 0.0, 0.0
    A[2, n] = 1.0
    A[n, 2], A[n, n], B1[n] = -(w**2), -2.0 * z * w, w**2
    sizes = np.append(model.thesis_sizes, 1.0)
    return ContinuousModel(A, B1, np.pad(model.B2, ((0, 1), (0, 0))), sizes)


def continuous_model(
    scenario: Scenario, *, sea: bool = True, fit: PayloadFit | None = None
) -> ContinuousModel:
    """The thesis's model of the scenario without its delay: 11 states with a vessel, or 3 without a sea; one
    more, the last, for the rate of a second-order drive. The payload is that of `fit` if one is given."""
    payload = payload_model(scenario) if fit is None else fit.payload
    A, B, C = regulator_matrices(payload, scenario.winch.rate_constant)
    waves = sea_filter(scenario) if sea else None
    if waves is None:
        model = ContinuousModel(A, B, np.zeros((3, 1)), np.ones(3))
    else:
        n = 3 + waves.n_states
        full = np.zeros((n, n))
        full[:3, :3], full[:3, 3:], full[3:, 3:] = A, C @ waves.C[:1], waves.A
        model = ContinuousModel(
            full,
            np.vstack([B, np.zeros((waves.n_states, 1))]),
            np.vstack([np.zeros((3, 1)), waves.B]),
            np.concatenate([np.ones(3), filter_state_sizes(scenario)]),
        )
    return with_drive(model, scenario.winch) if scenario.winch.is_second_order else model


# Discrete time -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class LinearModel:
    """s_{k+1} = A s_k + B u0_k + w_k, y_k = C s_k + e_k: the scenario at its control instants."""

    A: Array
    """(n_states, n_states)."""
    B: Array
    """Command input, (n_states, 1); commands in metres."""
    C: Array
    """Outputs, (n_outputs, n_states)."""
    W: Array
    """Covariance of the process noise over a step, (n_states, n_states)."""
    V: Array
    """Covariance of the measurement noise, (n_outputs, n_outputs)."""
    states: tuple[str, ...]
    """Name of each state."""
    outputs: tuple[str, ...]
    """Name of each output, as in `Scenario.observation_names`."""
    thesis_sizes: Array
    """One unit of each state in the thesis's coordinates, (n_states,)."""
    start_covariance: Array
    """Covariance of the state when an episode begins, the sea stationary, (n_states, n_states): the payload
    hangs still below the boom tip and the winch is at zero, or it is at zero and the winch against the boom
    tip, as `Scenario.start` says."""

    @property
    def n_states(self) -> int:
        """Number of states [-]."""
        return len(self.A)

    def select(self, outputs: tuple[str, ...]) -> LinearModel:
        """The same model seen through some of its outputs, in the order given."""
        rows = [self.outputs.index(name) for name in outputs]
        return replace(self, C=self.C[rows], V=self.V[np.ix_(rows, rows)], outputs=outputs)

    def index(self, state: str) -> int:
        """Place of a state."""
        return self.states.index(state)

    def energy_index(self, gain: Array) -> float:
        """sqrt(Σ G²) of a gain on this model's states, in the thesis's coordinates [-]."""
        return float(np.linalg.norm(gain / self.thesis_sizes))


def held_command(A: Array, B: Array, dt: float) -> tuple[Array, Array]:
    """Exact discretisation of x' = A x + B u with u held over the step, by one matrix exponential."""
    n, m = B.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = A, B
    exponential = expm(block * dt)
    return exponential[:n, :n], exponential[:n, n:]


def delayed_command(
    A: Array, B: Array, dt: float, delay: float, n_pending: int
) -> tuple[Array, Array, Array, Array]:
    """Exact discretisation of x' = A x + B u0(t - delay) with u0 held over each step.

    Args:
        A: Dynamics, (n, n).
        B: Command input, (n, 1).
        dt: Step [s].
        delay: Any delay, not negative [s].
        n_pending: Past commands that have not fully arrived at a control instant, ceil(delay / dt).

    Returns:
        F (n, n); H (n, n_pending), the part of the pending commands, most recent first; G (n, 1), that of the
        command now given; and the chain's shift (n_pending, n_pending), whose first row is zero.
    """
    n = len(A)
    F, whole = held_command(A, B, dt)
    H, G = np.zeros((n, n_pending)), np.zeros((n, 1))
    # Until `early` into the step the winch sees the command of n_pending steps ago, then the next.
    early = delay - (n_pending - 1) * dt if n_pending else 0.0
    if n_pending == 0:
        G = whole
    elif math.isclose(early, dt, rel_tol=1e-9):
        H[:, n_pending - 1 :] = whole
    else:
        _, late_part = held_command(A, B, dt - early)
        H[:, n_pending - 1 :] = whole - late_part
        if n_pending == 1:
            G = late_part
        else:
            H[:, n_pending - 2 : n_pending - 1] = late_part
    return F, H, G, np.eye(n_pending, k=-1)


def linear_model(
    scenario: Scenario,
    *,
    sea: bool = True,
    delay: bool = True,
    mismatch: float = 1.0,
    fit: PayloadFit | None = None,
) -> LinearModel:
    """The scenario's model at its control instants.

    Args:
        scenario: The operation. A cable is replaced by its identified second-order model.
        sea: Whether the boom tip's filter is part of the state; without it there is no process noise.
        delay: Whether the command's delay is.
        mismatch: How many times the residual of the identification the model of a cable is doubted by.
        fit: Model that stands for the cable, of another length perhaps; if not given, that identified at the
            initial length.

    Returns:
        The model with every channel of the observation that it can express, pending commands included.

    Raises:
        ValueError: If a sea is asked for and the scenario's is calm.
    """
    continuous = continuous_model(scenario, sea=sea, fit=fit)
    n = len(continuous.A)
    of_drive = 1 if scenario.winch.is_second_order else 0
    waves = sea_filter(scenario) if sea else None
    if sea and waves is None:
        raise ValueError(
            f"scenario {scenario.name!r} has a calm sea, of which there is nothing to model; choose a "
            "controller without a sea model (lqr, delay_lqr) or another sea_state.kind"
        )
    dt = scenario.control_dt
    n_pending = scenario.n_pending if delay else 0
    tau = scenario.winch.command_delay if delay else 0.0
    F, H, G, shift = delayed_command(continuous.A, continuous.B1, dt, tau, n_pending)
    _, Q = discretised_noise(continuous.A, continuous.noise, dt)
    Q = Q + mismatch**2 * _mismatch(scenario, continuous, dt, fit)

    # Pending commands stand behind the winch, whose future they are.
    order = np.r_[0:3, n : n + n_pending, 3:n]
    A = np.block([[F, H], [np.zeros((n_pending, n)), shift]])[np.ix_(order, order)]
    B = np.vstack([G, np.eye(n_pending, 1)])[order]
    W = np.zeros_like(A)
    W[:n, :n] = Q
    W = W[np.ix_(order, order)]
    states = (
        "payload_heave",
        "payload_heave_rate",
        "winch_displacement",
        *(f"pending_command_{i + 1}" for i in range(n_pending)),
        *(f"filter_state_{i}" for i in range(n - 3 - of_drive)),
        *(("winch_rate",) if of_drive else ()),
    )
    sizes = np.concatenate([np.ones(3 + n_pending), continuous.thesis_sizes[3:]])
    start = np.zeros_like(A)
    if waves is not None:
        still = np.zeros((len(A), waves.n_states))
        first = 3 + n_pending
        still[first : first + waves.n_states] = np.eye(waves.n_states)
        if scenario.start == "compensated":
            # The winch is where the boom tip is not, and the commands under way have kept it moving there.
            still[2] = -waves.C[0]
            still[3 : 3 + n_pending] = -(waves.C[0] + waves.C[1] * scenario.winch.lag)
            if of_drive:
                still[-1] = -waves.C[1]
        else:
            # Hanging still: the payload stands where the boom tip is.
            still[0] = waves.C[0]
        start = still @ waves.covariance @ still.T
    model = LinearModel(A, B, np.zeros((0, len(A))), W, np.zeros((0, 0)), states, (), sizes, start)
    return _with_outputs(scenario, model, waves)


def _mismatch(scenario: Scenario, model: ContinuousModel, dt: float, fit: PayloadFit | None) -> Array:
    """Process noise that owns up to what the model leaves out of a cable, as covariance over a step.

    White acceleration of the payload, of the size of the residual that identification left.
    """
    if scenario.is_linear:
        return np.zeros_like(model.A)
    if fit is None:
        from baselines.identification import identified

        fit = identified(scenario)
    # A white force of intensity N moves the second-order model by N / (2 b), its variance.
    intensity = 2.0 * max(fit.damping, 1e-3) * fit.residual_std**2
    noise = np.zeros_like(model.A)
    noise[1, 1] = intensity / fit.inertia**2
    return discretised_noise(model.A, noise, dt)[1]


def _with_outputs(scenario: Scenario, model: LinearModel, waves: LinearFilter | None) -> LinearModel:
    """Adds the outputs of the observation, and the past samples that delayed sensors report."""
    A, B, W, start = model.A, model.B, model.W, model.start_covariance
    states = list(model.states)
    rows: dict[str, Array] = {}
    variances: dict[str, float] = {}
    for sensor in scenario.observed_sensors:
        row = channel_row(sensor.channel, states, waves)
        if row is None:
            continue
        now = row
        for i in range(round(sensor.delay / scenario.control_dt)):
            # The next past sample is what this row reads now; before the episode it read what it reads now.
            n = len(A)
            A = np.block([[A, np.zeros((n, 1))], [row[None], np.zeros((1, 1))]])
            B = np.vstack([B, [[0.0]]])
            W = np.pad(W, (0, 1))
            grow = np.vstack([np.eye(n), np.pad(now, (0, n - len(now)))])
            start = grow @ start @ grow.T
            states.append(f"{sensor.channel}[-{i + 1}]")
            row = np.eye(n + 1)[n]
        rows[sensor.channel] = row
        assert sensor.scale is not None
        variances[sensor.channel] = (
            sensor.sample_std(scenario.control_dt) ** 2 + (noise_floor(scenario) * sensor.scale) ** 2
        )
    for name in scenario.observation_names:
        if name in states and name not in rows:
            rows[name] = np.eye(len(A))[states.index(name)]
            variances[name] = 0.0
    n = len(A)
    C = np.array([np.pad(row, (0, n - len(row))) for row in rows.values()]).reshape(len(rows), n)
    V = np.diag([variances[name] for name in rows])
    sizes = np.pad(model.thesis_sizes, (0, n - model.n_states), constant_values=1.0)
    return LinearModel(A, B, C, W, V, tuple(states), tuple(rows), sizes, start)


def plant_is_model(scenario: Scenario) -> bool:
    """Whether the linear model is the plant: a linear payload, a winch without limits, sensors whose only
    errors are white noise and delay, and parameters that are what they are said to be."""
    return (
        scenario.is_linear
        and not scenario.winch.is_limited
        and not scenario.uncertainty
        and all(sensor.is_plain for sensor in scenario.observed_sensors)
    )


def noise_floor(scenario: Scenario) -> float:
    """Least noise of a channel over its scale [-]."""
    return NOISE_FLOOR if scenario.is_linear else DOUBT_FLOOR


def channel_row(channel: str, states: list[str], waves: LinearFilter | None) -> Array | None:
    """The row that reads a channel off the state, or None for a channel the model does not express."""
    row = np.zeros(len(states))
    if channel in states:
        row[states.index(channel)] = 1.0
        return row
    if channel in ("boom_tip_heave", "boom_tip_heave_rate") and waves is not None:
        first = states.index("filter_state_0")
        row[first : first + waves.n_states] = waves.C[0 if channel == "boom_tip_heave" else 1]
        return row
    return None
