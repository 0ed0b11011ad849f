"""Feed-forward of the boom tip's motion, industry's usual compensation: the payload is not looked at.

The winch is to move against the boom tip, u = -z. Its lag is inverted, u' + K u = K u0, so that

    u0 = -(z + z' / K),

and that of a second-order drive likewise, u0 = -(z + 2 ζ/ω z' + z''/ω²). `feedforward` takes z and z' as they
are measured, and z'' as the difference of the last two samples of z'; its command is late by its delay and by
half a control step, for which it is held, and leaves about (σ_z' / σ_z) (delay + dt / 2) of the motion.
`feedforward_prediction` takes all three as a Kalman filter on the fitted model of sea and vessel expects
them, either in the middle of the time for which the command will be held, delay + dt / 2 ahead; or it takes
the command that brings the winch to the boom tip's expected place at the end of that time, delay + dt ahead,
from where its own past commands will have put it.

The second leaves at the control instants what nobody can foresee (`baselines.bound`) and no more, but
multiplies what the sensors' noise does to the forecast by about 1 / (K dt); on a second-order drive it
commands a zigzag, for a held command moves its displacement by (ω dt)² / 2 only.

Source: Huang (1992), (6.1) and 6.5 for the winch; Triantafyllou, Bodson and Athans (1983) for the forecast.
"""

from __future__ import annotations

import math
from dataclasses import fields

import numpy as np
from scipy.linalg import expm

from baselines.kalman import boom_tip_kalman_filter, measured_channels
from baselines.linear_controller import LinearController, controller
from baselines.lqg import StochasticOptimal
from baselines.lqr import truth_model
from baselines.model import sea_filter
from baselines.winch_model import winch_model
from heave_env.plant import drive_step
from heave_env.scenarios import Scenario
from heave_env.sea import Array

BOOM_TIP_MOTION = ("boom_tip_heave", "boom_tip_heave_rate")
AIMS = ("middle", "end")
ROOM = 3.0
"""Standard deviations of the command that the range should hold [-]."""


def feedforward(scenario: Scenario) -> LinearController:
    """Designs the plain feed-forward of measured boom-tip heave and rate.

    Raises:
        ValueError: If the boom tip's heave or its rate is not measured.
    """
    require_boom_tip(scenario, "feedforward", BOOM_TIP_MOTION)
    winch = scenario.winch
    gain = np.array([[1.0, winch.lag]])
    truth = truth_model(scenario)
    if winch.natural_omega is None:
        return controller("feedforward", scenario, BOOM_TIP_MOTION, D=gain, truth=truth)
    # The rate of one step ago is remembered; at first it is zero, and what that asks of the drive takes it
    # from rest to the rate wanted.
    per_change = 1.0 / (winch.natural_omega**2 * scenario.control_dt)
    return controller(
        "feedforward",
        scenario,
        BOOM_TIP_MOTION,
        D=np.array([[1.0, winch.lag + per_change]]),
        F=np.zeros((1, 1)),
        G=np.array([[0.0, 1.0]]),
        H=np.zeros((1, 1)),
        L=np.array([[-per_change]]),
        truth=truth,
    )


def feedforward_prediction(scenario: Scenario, *, aim: str | None = None) -> LinearController:
    """Designs the feed-forward of the boom tip's motion as the Kalman filter expects it.

    Args:
        scenario: The operation, with a sea to be fitted.
        aim: `middle`, lag inverted for the middle of the time the command is held; `end`, the winch brought
            to its place at the end of that time, which supposes that no limit keeps it from there; if not
            given, `end` for a winch without limits, unless `ROOM` standard deviations of the command that
            theory expects of it on a second-order drive are more than the range.

    Raises:
        ValueError: If the sea is calm, the boom tip is not measured, or the aim is unknown.
    """
    if aim is None and scenario.winch.is_second_order and not scenario.winch.is_limited:
        ambitious = feedforward_prediction(scenario, aim="end")
        assert ambitious.performance is not None
        if ROOM * ambitious.performance.command_std <= scenario.winch.command_range:
            return ambitious
        aim = "middle"
    if aim is None:
        aim = "middle" if scenario.winch.is_limited else "end"
    if aim not in AIMS:
        raise ValueError(f"aim of feedforward_prediction must be one of {', '.join(AIMS)}, got {aim!r}")
    estimator = boom_tip_kalman_filter(scenario)
    model, waves = estimator.model, sea_filter(scenario)
    assert waves is not None
    K, dt, delay = scenario.winch.rate_constant, scenario.control_dt, scenario.winch.command_delay
    gain = np.zeros((1, model.n_states))
    sea = slice(model.index("filter_state_0"), model.index("filter_state_0") + waves.n_states)
    if aim == "middle":
        wanted = waves.C[0] + waves.C[1] / K
        if scenario.winch.natural_omega is not None:
            wanted = wanted + waves.C[1] @ waves.A / scenario.winch.natural_omega**2
        gain[0, sea] = wanted @ expm(waves.A * (delay + 0.5 * dt))
    elif scenario.winch.is_second_order:
        # At the end of the step u1 = (1 - R00) u0 + R00 u + R01 u'.
        R = drive_step(scenario.winch, dt)
        share = 1.0 - R[0, 0]
        gain[0, sea] = waves.C[0] @ expm(waves.A * (delay + dt)) / share
        places = [*range(1 + scenario.n_pending), model.index("winch_rate")]
        gain[0, places] = R[0] @ _drive_arrival(scenario) / share
    else:
        decay = math.exp(-K * dt)
        gain[0, sea] = waves.C[0] @ expm(waves.A * (delay + dt)) / (1.0 - decay)
        gain[0, : 1 + scenario.n_pending] = decay / (1.0 - decay) * _arrival(scenario)
    A, B, C, M = model.A, model.B, model.C, estimator.gain
    rest = np.eye(model.n_states) - M @ C
    stationary = controller(
        "feedforward_prediction",
        scenario,
        model.outputs,
        F=A @ rest,
        G=A @ M,
        H=B,
        L=gain @ rest,
        D=gain @ M,
        gain=gain,
        states=model.states,
        truth=truth_model(scenario),
    )
    parts = {item.name: getattr(stationary, item.name) for item in fields(stationary)}
    return StochasticOptimal(**parts, estimator=estimator)


def _arrival(scenario: Scenario) -> Array:
    """Winch displacement when a command arrives, per unit of displacement and of the commands under way."""
    winch = winch_model(scenario)
    cases = np.eye(1 + winch.n_pending)
    commands = np.column_stack([np.zeros(len(cases)), cases[:, 1:]])
    u, _, _ = winch.path(cases[:, 0], np.zeros(len(cases)), commands, first=0, count=winch.n_delayed)
    return u


def _drive_arrival(scenario: Scenario) -> Array:
    """Displacement and rate of a second-order drive when a command arrives, per unit of displacement, of the
    commands under way and of rate, (2, 2 + n_pending)."""
    n = 1 + scenario.n_pending
    arrival, left = np.eye(2, n + 1), scenario.winch.command_delay
    arrival[1] = np.eye(n + 1)[n]
    for i in range(scenario.n_pending, 0, -1):
        # The oldest command acts for what is left of its step, the others for a step each.
        span = left - (i - 1) * scenario.control_dt
        R = drive_step(scenario.winch, span)
        arrival = R @ arrival
        arrival[:, i] += np.eye(2)[:, 0] - R[:, 0]
        left -= span
    return arrival


def require_boom_tip(scenario: Scenario, name: str, channels: tuple[str, ...]) -> None:
    """Raises `ValueError` unless those channels of the boom tip are measured."""
    measured = measured_channels(scenario)
    for channel in channels:
        if channel not in measured:
            raise ValueError(
                f"controller {name!r} needs {channel} measured, which scenario {scenario.name!r} does not "
                f"(its newest measurements: {', '.join(measured)}); add that sensor or choose lqg"
            )
