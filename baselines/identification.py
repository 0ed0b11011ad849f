"""Identification of the second-order model of cable and payload from a simulated response.

    linear      a x'' + b x' + x = x0            (6.2)
    nonlinear   a x'' + b x'|x'| + x = x0        (6.3)

The cable is simulated under the scenario's own sea with the winch locked; Gauss-Newton then fits a and b to
the payload's heave, with the sensitivities x_a and x_b from their own differential equations. This is how the
designed controllers get their model of a cable.

The fit holds for the length, the sea and the amplitudes it was made with: the linear b grows with amplitude,
since it stands for quadratic drag, and a pay-out is switched off. Above the first resonance of a long cable
the second-order model misses its waves.

Source: Huang (1992), 6.2.3; Kalaba and Spingarn (1982).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import expm

from baselines.model import nominal_sea
from heave_env.cable.constitutive import dynamic_modulus
from heave_env.parameters import LinearPayload, PayOut, SeaState
from heave_env.scenarios import Scenario
from heave_env.sea import Array
from heave_env.sensors import Sensor

IDENTIFICATION_SEEDS = tuple(range(9_000_000, 9_000_004))
"""Seas that a cable is identified in: in the training range (below 1e7), at its far end."""
IDENTIFICATION_DURATION = 300.0
"""Length of each simulated response [s]."""
CALM_SEA = SeaState(kind="random_phase", significant_wave_height=1.0, peak_omega=0.8)
"""Excitation for a scenario whose own sea is calm."""
LEAST_DAMPING_RATIO = 1e-3
"""A fitted damping is not allowed below this share of critical [-]."""

_CACHE: dict[tuple[str, bool], PayloadFit] = {}


@dataclass(frozen=True, kw_only=True)
class PayloadFit:
    """A second-order model fitted to a response."""

    inertia: float
    """a [s²]."""
    damping: float
    """b, in s of the linear model and s²/m of the nonlinear."""
    residual_std: float
    """Root mean square of measured minus fitted payload heave [m]."""
    response_std: float
    """Root mean square of the payload heave fitted to [m]."""
    n_iterations: int
    """Gauss-Newton steps taken [-]."""
    nonlinear: bool
    """Whether the damping is quadratic."""

    @property
    def explained(self) -> float:
        """Share of the response's variance that the model explains [-]."""
        return 1.0 - (self.residual_std / self.response_std) ** 2 if self.response_std > 0.0 else math.nan

    @property
    def payload(self) -> LinearPayload:
        """The linear payload of the fit."""
        return LinearPayload(inertia=self.inertia, damping=self.damping)


@dataclass(frozen=True)
class Response:
    """A simulated response at equal steps; arrays (n_steps + 1, n_envs)."""

    dt: float
    """Step [s]."""
    boom_tip_heave: Array
    """x0 [m]."""
    boom_tip_heave_rate: Array
    """x0' [m/s]."""
    payload_heave: Array
    """z [m]."""
    payload_heave_rate: Array
    """z' [m/s]; only its first row is used, as initial condition."""

    def input_derivatives(self) -> Array:
        """x0 and its first three derivatives at the start of each step, (n_steps, 4, n_envs).

        Of the cubic through heave and rate at both ends of the step (Hermite).
        """
        h, rate, dt = self.boom_tip_heave, self.boom_tip_heave_rate, self.dt
        slope = np.diff(h, axis=0) / dt
        second = 2.0 * (3.0 * slope - 2.0 * rate[:-1] - rate[1:]) / dt
        third = 6.0 * (rate[:-1] + rate[1:] - 2.0 * slope) / dt**2
        return np.stack([h[:-1], rate[:-1], second, third], axis=1)


def fit_payload(
    response: Response,
    *,
    inertia: float,
    damping: float,
    nonlinear: bool = False,
    n_iterations: int = 40,
    tolerance: float = 1e-9,
) -> PayloadFit:
    """Fits a and b by Gauss-Newton, each step halved until the residual falls.

    Args:
        response: What to fit; several columns are fitted together.
        inertia: First guess of a [s²].
        damping: First guess of b.
        nonlinear: Whether b multiplies x'|x'|.
        n_iterations: Most steps taken.
        tolerance: Relative change of a and b at which the fit stands.

    Raises:
        ValueError: If the response holds no motion or no numbers.
    """
    z = response.payload_heave
    if not np.all(np.isfinite(z)) or not np.any(np.ptp(response.boom_tip_heave, axis=0) > 0.0):
        raise ValueError(
            "cannot identify the payload model: the simulated response has diverged or does not move; check "
            "the cable's parameters and the sea"
        )
    simulate = _nonlinear_response if nonlinear else _linear_response
    parameters = np.array([inertia, damping])
    x, x_a, x_b = simulate(response, *parameters)
    misfit = float(np.mean((z - x) ** 2))
    count = 0
    for _ in range(n_iterations):
        X = np.stack([x_a.ravel(), x_b.ravel()], axis=1)
        step = np.linalg.lstsq(X, (z - x).ravel(), rcond=None)[0]
        for _ in range(30):
            trial = parameters + step
            trial[0] = max(trial[0], 0.2 * parameters[0])
            trial[1] = max(trial[1], 2.0 * LEAST_DAMPING_RATIO * math.sqrt(trial[0]))
            # A step too far may blow the nonlinear model up: its misfit is then no number, and it is halved.
            with np.errstate(all="ignore"):
                x_try, a_try, b_try = simulate(response, *trial)
                misfit_try = float(np.mean((z - x_try) ** 2))
            if misfit_try <= misfit * (1.0 + 1e-12):
                break
            step = 0.5 * step
        else:
            break
        count += 1
        change = np.max(np.abs(trial - parameters) / trial)
        parameters, misfit, x, x_a, x_b = trial, misfit_try, x_try, a_try, b_try
        if change < tolerance:
            break
    return PayloadFit(
        inertia=float(parameters[0]),
        damping=float(parameters[1]),
        residual_std=math.sqrt(misfit),
        response_std=float(np.sqrt(np.mean(z**2))),
        n_iterations=count,
        nonlinear=nonlinear,
    )


def _linear_response(response: Response, a: float, b: float) -> tuple[Array, Array, Array]:
    """x, dx/da and dx/db of the linear model, exact for the interpolated input; (n_steps + 1, n_envs)."""
    # States x, x', x_a, x_a', x_b, x_b'; then x0 and its three derivatives.
    M = np.zeros((10, 10))
    M[0, 1] = M[2, 3] = M[4, 5] = 1.0
    M[1, [0, 1, 6]] = -1.0 / a, -b / a, 1.0 / a
    M[3, [0, 1, 6]] = 1.0 / a**2, b / a**2, -1.0 / a**2
    M[3, 2:4] = M[5, 4:6] = -1.0 / a, -b / a
    M[5, 1] = -1.0 / a
    M[6, 7] = M[7, 8] = M[8, 9] = 1.0
    exponential = expm(M * response.dt)
    F = exponential[:6, :6]
    drive = exponential[:6, 6:] @ response.input_derivatives()
    states = _initial_states(response)
    for k in range(len(drive)):
        states[k + 1] = F @ states[k] + drive[k]
    return states[:, 0], states[:, 2], states[:, 4]


def _nonlinear_response(response: Response, a: float, b: float) -> tuple[Array, Array, Array]:
    """Likewise of the nonlinear model, classical Runge-Kutta of order four at the response's step."""
    dt = response.dt
    drive = response.input_derivatives()
    instants = np.array([0.0, 0.5 * dt, dt])
    powers = np.stack([np.ones(3), instants, instants**2 / 2.0, instants**3 / 6.0])
    inputs = np.einsum("kpe,pi->kie", drive, powers)
    states = _initial_states(response)

    def derivative(s: Array, x0: Array) -> Array:
        x, v, x_a, v_a, x_b, v_b = s
        speed = np.abs(v)
        acceleration = (x0 - b * v * speed - x) / a
        by_a = -(acceleration + 2.0 * b * speed * v_a + x_a) / a
        by_b = -(v * speed + 2.0 * b * speed * v_b + x_b) / a
        return np.stack([v, acceleration, v_a, by_a, v_b, by_b])

    for k in range(len(inputs)):
        s = states[k]
        k1 = derivative(s, inputs[k, 0])
        k2 = derivative(s + 0.5 * dt * k1, inputs[k, 1])
        k3 = derivative(s + 0.5 * dt * k2, inputs[k, 1])
        k4 = derivative(s + dt * k3, inputs[k, 2])
        states[k + 1] = s + dt / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    return states[:, 0], states[:, 2], states[:, 4]


def _initial_states(response: Response) -> Array:
    states = np.zeros((len(response.payload_heave), 6, response.payload_heave.shape[1]))
    states[0, 0], states[0, 1] = response.payload_heave[0], response.payload_heave_rate[0]
    return states


def first_guess(scenario: Scenario) -> tuple[float, float]:
    """a and b of a spring with the payload and a third of the cable on it, damped at 2 % of critical."""
    cable, payload, length = scenario.cable, scenario.payload, scenario.initial_length
    assert cable is not None and payload is not None
    tension = payload.submerged_weight + 0.5 * cable.submerged_weight * length
    stiffness = float(dynamic_modulus(cable, 0.0, tension).real) / length
    inertia = (payload.inertia + cable.inertia_per_length * length / 3.0) / stiffness
    return inertia, 0.04 * math.sqrt(inertia)


def identification_scenario(scenario: Scenario) -> Scenario:
    """The cable at its initial length under its sea, taut and from rest: winch locked, no pay-out, no limits.

    A recorded motion is replaced by the sea that stands for it in a design, a calm one by `CALM_SEA`.
    """
    cable = scenario.cable
    if cable is not None:
        # Compensation is to keep the cable taut: its taut behaviour is what the controllers need. A hardening
        # rope's law need not make sense in compression, so that it may go slack here too.
        slackens = cable.tension_only and not cable.is_hookean
        cable = replace(cable, breaking_strength=None, tension_only=slackens)
    sea = scenario.sea_state
    if sea.kind in ("recorded", "calm"):
        sea = nominal_sea(scenario) or CALM_SEA
    return replace(
        scenario,
        name="identification",
        start="hanging",
        sea_state=sea,
        duration=IDENTIFICATION_DURATION,
        control_dt=0.1,
        n_substeps=max(1, math.ceil(0.1 / scenario.solver_dt - 1e-9)),
        winch=replace(
            scenario.winch,
            time_constant=1.0,
            command_range=0.01,
            command_delay=0.0,
            stroke_limit=None,
            speed_limit=None,
            acceleration_limit=None,
        ),
        cable=cable,
        pay_out=PayOut(),
        information_set="sensors",
        sensors=(Sensor(channel="payload_heave"),),
        task=replace(scenario.task, position_weight=1.0, command_weight=1.0, landing_depth=None),
    )


def identify(
    scenario: Scenario,
    *,
    nonlinear: bool = False,
    seeds: tuple[int, ...] = IDENTIFICATION_SEEDS,
    duration: float = IDENTIFICATION_DURATION,
) -> PayloadFit:
    """Simulates a scenario's cable with the winch locked and fits the second-order model to its payload.

    Args:
        scenario: An operation with a cable.
        nonlinear: Whether the damping is quadratic, (6.3), in place of linear, (6.2).
        seeds: Seas to simulate.
        duration: Length of each response [s].

    Raises:
        ValueError: If the scenario has no cable, or its response cannot be fitted.
    """
    from heave_env.plant import simulate

    if scenario.cable is None:
        raise ValueError(
            f"scenario {scenario.name!r} has a linear payload: its a and b are given, not identified; choose "
            "a scenario with a cable"
        )
    operation = identification_scenario(scenario)
    channels = simulate(operation, seeds=list(seeds), duration=duration)
    response = Response(
        operation.control_dt,
        channels["boom_tip_heave"],
        channels["boom_tip_heave_rate"],
        channels["payload_heave"],
        channels["payload_heave_rate"],
    )
    inertia, damping = first_guess(scenario)
    return fit_payload(response, inertia=inertia, damping=damping, nonlinear=nonlinear)


def identified(scenario: Scenario, *, nonlinear: bool = False) -> PayloadFit:
    """The same with the standard seeds and duration, remembered within the process."""
    key = (identification_scenario(scenario).fingerprint, nonlinear)
    if key not in _CACHE:
        _CACHE[key] = identify(scenario, nonlinear=nonlinear)
    return _CACHE[key]


def identified_payload(scenario: Scenario) -> LinearPayload:
    """The linear payload that stands for a scenario's cable in a design."""
    return identified(scenario).payload
