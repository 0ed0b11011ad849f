"""The regulator with the command's delay among its states.

Two models of the delay: the exact chain, in which a delay of n control steps is n more states (the commands
under way, which the observation holds), a fraction of a step included; and the thesis's second-order Taylor
model, whose two states the controller integrates from its own commands. A second-order drive has its rate as
a further state of either.

Source: Huang (1992), 6.2.5, (6.11)-(6.15), 6.5; the chain: Åström and Wittenmark (1997), 3.2.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from baselines.linear_controller import LinearController, controller
from baselines.lqr import (
    PAYLOAD_MOTION,
    continuous_gain,
    design_weights,
    lqr,
    measured_entries,
    require_payload_motion,
    sampled_gain,
    truth_model,
    winch_states,
)
from baselines.model import (
    ContinuousModel,
    continuous_model,
    held_command,
    linear_model,
    regulator_matrices,
)
from heave_env.parameters import LinearPayload
from heave_env.scenarios import Scenario
from heave_env.sea import Array

DESIGNS = ("exact", "taylor")


def taylor_matrices(payload: LinearPayload, rate_constant: float, delay: float) -> tuple[Array, Array]:
    """A and B for the states [x, x', u, u0(t - delay), its rate], (5, 5) and (5, 1).

    Source: Huang (1992), (6.14).

    Args:
        payload: Second-order model of cable and payload.
        rate_constant: K of the winch [1/s].
        delay: Command delay, positive [s].
    """
    A3, B3, _ = regulator_matrices(payload, rate_constant)
    return _with_taylor_delay(A3, B3, delay)


def _with_taylor_delay(A: Array, B: Array, delay: float) -> tuple[Array, Array]:
    """A and B with the delayed command and its rate as two more states, the last ones."""
    n = len(A)
    delayed = np.pad(A, (0, 2))
    delayed[:n, n] = B[:, 0]
    delayed[n, n + 1] = 1.0
    delayed[n + 1, n:] = -2.0 / delay**2, -2.0 / delay
    command = np.zeros((n + 2, 1))
    command[n + 1] = 2.0 / delay**2
    return delayed, command


def delay_lqr(
    scenario: Scenario, *, design: str = "exact", command_weight: float | None = None
) -> LinearController:
    """Designs the regulator that accounts for the command's delay; without a delay it is the plain one.

    Args:
        scenario: The operation; its task weighs position against command.
        design: `exact`, the discrete chain, or `taylor`, the thesis's (6.14).
        command_weight: r of the design [1/m²]; the task's own if not given.

    Returns:
        The controller, with its performance on the model with the exact delay, whatever its design.

    Raises:
        ValueError: If payload heave or its rate is not measured, or the design is unknown.
    """
    if design not in DESIGNS:
        raise ValueError(f"design of delay_lqr must be one of {', '.join(DESIGNS)}, got {design!r}")
    require_payload_motion(scenario, "delay_lqr")
    if scenario.n_pending == 0:
        plain = lqr(
            scenario,
            design="sampled" if design == "exact" else "continuous",
            command_weight=command_weight,
        )
        return replace(plain, name="delay_lqr")
    q, r = design_weights(scenario, command_weight)
    return _exact(scenario, q, r) if design == "exact" else _taylor(scenario, q, r)


def _exact(scenario: Scenario, q: float, r: float) -> LinearController:
    model = linear_model(scenario, sea=False)
    n = 2 + len(winch_states(scenario)) + scenario.n_pending
    A, B = model.A[:n, :n], model.B[:n]
    gain, _ = sampled_gain(A, B, q, r)
    states = model.states[:n]
    measured = measured_entries(scenario)
    made = partial(
        controller,
        "delay_lqr",
        scenario,
        gain=gain,
        states=states,
        energy_index=float(np.linalg.norm(gain)),
        truth=truth_model(scenario),
        command_weight=r,
    )
    winch = winch_states(scenario)
    if set(winch) <= set(measured):
        return made(states, D=gain)
    # The winch's own rows of the model are driven by themselves, pending and new commands alone.
    modelled = [states.index(name) for name in winch]
    used = tuple(name for name in states if name not in winch or name in measured)
    seen = [states.index(name) for name in used]
    driving = [name.startswith("pending_command") for name in used]
    return made(
        used,
        D=gain[:, seen],
        F=A[np.ix_(modelled, modelled)],
        G=A[np.ix_(modelled, seen)] * driving,
        H=B[modelled],
        L=gain[:, modelled] * [name not in measured for name in winch],
    )


def _taylor(scenario: Scenario, q: float, r: float) -> LinearController:
    plain: ContinuousModel = continuous_model(scenario, sea=False)
    A, B = _with_taylor_delay(plain.A, plain.B1, scenario.winch.command_delay)
    gain = continuous_gain(A, B, q, r)
    states = (*PAYLOAD_MOTION, *winch_states(scenario), "delayed_command", "delayed_command_rate")
    measured = measured_entries(scenario)
    used = tuple(name for name in states if name in measured)
    # What is not measured (the delayed command and its rate, perhaps the winch) is integrated here.
    seen = [states.index(name) for name in used]
    winch_measured = set(winch_states(scenario)) <= set(measured)
    first = len(plain.A) if winch_measured else 2
    F, H = held_command(A[first:, first:], B[first:], scenario.control_dt)
    return controller(
        "delay_lqr",
        scenario,
        used,
        D=gain[:, seen],
        F=F,
        G=np.zeros((len(A) - first, len(used))),
        H=H,
        L=gain[:, first:] * [name not in measured for name in states[first:]],
        gain=gain,
        states=states,
        energy_index=float(np.linalg.norm(gain)),
        truth=truth_model(scenario),
        command_weight=r,
    )
