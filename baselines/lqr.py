"""The thesis's regulator: a Riccati gain on payload heave, its rate and the winch's displacement.

It knows neither the sea nor the command's delay. Where the winch's displacement is not measured, the
controller models it from its own commands. A second-order drive has its rate as a further state, measured
(`winch_rate`) or modelled likewise.

Source: Huang (1992), 6.2.4, (6.6)-(6.10), 6.5.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from scipy.linalg import solve_continuous_are, solve_discrete_are

from baselines.linear_controller import LinearController, controller
from baselines.model import LinearModel, continuous_model, linear_model, sea_filter
from heave_env.plant import drive_step
from heave_env.scenarios import Scenario
from heave_env.sea import Array

DESIGNS = ("sampled", "continuous")
PAYLOAD_MOTION = ("payload_heave", "payload_heave_rate")


def continuous_gain(A: Array, B: Array, position_weight: float, command_weight: float) -> Array:
    """Gain K of u0 = -K x that minimises ∫ (q x² + r u0²) dt, x being the first state, (1, n).

    Source: Huang (1992), (6.10), with the sign of the feedback taken out.
    """
    Q = np.zeros_like(A)
    Q[0, 0] = position_weight
    M = solve_continuous_are(A, B, Q, np.array([[command_weight]]))
    return np.asarray(B.T @ M / command_weight)


def sampled_gain(
    A: Array, B: Array, position_weight: float, command_weight: float, *, speed_weight: float = 0.0
) -> tuple[Array, Array]:
    """Gain K of u0_k = -K s_k that minimises E[q x² + r u0²], x being the first state, and the cost matrix.

    Args:
        A: Transition, (n, n).
        B: Command input, (n, 1).
        position_weight: q [1/m²].
        command_weight: r [1/m²].
        speed_weight: Added to the cost, times the squared displacement over a step of the winch, which is the
            third state [1/m²]: what a speed limit may not allow is then not asked for.

    Returns:
        K (1, n) and S (n, n), the solution of the discrete Riccati equation.
    """
    Q, R, cross = stage_weights(A, B, position_weight, command_weight, speed_weight=speed_weight)
    S = solve_discrete_are(A, B, Q, R, s=cross if speed_weight else None)
    towards = B.T @ S @ A + cross.T if speed_weight else B.T @ S @ A
    K = np.linalg.solve(R + B.T @ S @ B, towards)
    return np.asarray(K), np.asarray(S)


def stage_weights(
    A: Array, B: Array, position_weight: float, command_weight: float, *, speed_weight: float = 0.0
) -> tuple[Array, Array, Array]:
    """Q (n, n), R (1, 1) and c (n, 1) of `sampled_gain`'s stage cost, sᵀ Q s + R u0² + 2 sᵀ c u0."""
    Q = np.zeros_like(A)
    Q[0, 0] = position_weight
    R, cross = np.array([[command_weight]]), np.zeros_like(B)
    if speed_weight:
        moved, given = A[2] - np.eye(len(A))[2], B[2]
        Q += speed_weight * np.outer(moved, moved)
        R = R + speed_weight * np.outer(given, given)
        cross = speed_weight * np.outer(moved, given)
    return Q, R, cross


def lqr(
    scenario: Scenario, *, design: str = "sampled", command_weight: float | None = None
) -> LinearController:
    """Designs the regulator for a scenario.

    Args:
        scenario: The operation; its task weighs position against command.
        design: `sampled`, exact for commands held over a control step, or `continuous`, the thesis's (6.10).
        command_weight: r of the design [1/m²]; the task's own if not given.

    Returns:
        The controller. Its `performance` is that with the true delay, which it ignores, and with the sensors'
        noise.

    Raises:
        ValueError: If payload heave or its rate is not measured, or the design is unknown.
    """
    if design not in DESIGNS:
        raise ValueError(f"design of lqr must be one of {', '.join(DESIGNS)}, got {design!r}")
    require_payload_motion(scenario, "lqr")
    q, r = design_weights(scenario, command_weight)
    if design == "continuous":
        thesis = continuous_model(scenario, sea=False)
        gain = continuous_gain(thesis.A, thesis.B1, q, r)
    else:
        n = 2 + len(winch_states(scenario))
        model = linear_model(scenario, sea=False, delay=False)
        gain, _ = sampled_gain(model.A[:n, :n], model.B[:n], q, r)
    states = (*PAYLOAD_MOTION, *winch_states(scenario))
    measured = measured_entries(scenario)
    made = partial(
        controller,
        "lqr",
        scenario,
        gain=gain,
        states=states,
        energy_index=float(np.linalg.norm(gain)),
        truth=truth_model(scenario),
        command_weight=r,
    )
    if set(states) <= set(measured):
        return made(states, D=gain)
    if scenario.winch.is_second_order:
        R = drive_step(scenario.winch, scenario.control_dt)
        used = tuple(name for name in states if name in measured)
        seen = [states.index(name) for name in used]
        # The drive's two states from the controller's own commands; the gain takes what is measured first.
        gain_modelled = gain[:, 2:] * [name not in measured for name in states[2:]]
        return made(
            used,
            D=gain[:, seen],
            F=R,
            G=np.zeros((2, len(used))),
            H=(np.eye(2) - R)[:, :1],
            L=gain_modelled,
        )
    # u_{k+1} = p u_k + (1 - p) u0_k, from the controller's own commands.
    p = math.exp(-scenario.winch.rate_constant * scenario.control_dt)
    return made(
        PAYLOAD_MOTION,
        D=gain[:, :2],
        F=np.array([[p]]),
        G=np.zeros((1, 2)),
        H=np.array([[1.0 - p]]),
        L=gain[:, 2:],
    )


def winch_states(scenario: Scenario) -> tuple[str, ...]:
    """States of the winch in the regulators: its displacement and, of a second-order drive, its rate."""
    return ("winch_displacement", "winch_rate") if scenario.winch.is_second_order else ("winch_displacement",)


def design_weights(scenario: Scenario, command_weight: float | None) -> tuple[float, float]:
    """q and r of a design: the task's own, but for a command weight that is given.

    Raises:
        ValueError: If the weight given is not positive.
    """
    r = scenario.task.command_weight if command_weight is None else float(command_weight)
    if not (math.isfinite(r) and r > 0.0):
        raise ValueError(f"command_weight must be a positive number, got {command_weight!r}")
    return scenario.task.position_weight, r


def measured_entries(scenario: Scenario) -> tuple[str, ...]:
    """Channels whose newest sample stands in the observation under its plain name."""
    return tuple(name for name in scenario.observation_names if "[" not in name)


def require_payload_motion(scenario: Scenario, name: str) -> None:
    """Raises `ValueError` unless the payload's heave and rate are measured."""
    measured = measured_entries(scenario)
    for channel in PAYLOAD_MOTION:
        if channel not in measured:
            raise ValueError(
                f"controller {name!r} needs {channel} measured, which scenario {scenario.name!r} does not "
                f"(its newest measurements: {', '.join(measured)}); add that sensor or choose lqg"
            )


def truth_model(scenario: Scenario) -> LinearModel | None:
    """The linear model with sea and delay that performance is predicted on; None when the sea is calm."""
    return None if sea_filter(scenario) is None else linear_model(scenario)
