"""The regulator with the command's delay among its states.

Two models of the delay: the exact chain, in which a delay of n control steps is n more states (the commands
under way, which the observation holds), a fraction of a step included; and the thesis's second-order Taylor
model, whose two states the controller integrates from its own commands.

Source: Huang (1992), 6.2.5, (6.11)-(6.15); the chain: Åström and Wittenmark (1997), 3.2.
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
)
from baselines.model import held_command, linear_model, payload_model, regulator_matrices
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
    A3, _, _ = regulator_matrices(payload, rate_constant)
    A = np.zeros((5, 5))
    A[:3, :3] = A3
    A[2, 3] = rate_constant
    A[3, 4] = 1.0
    A[4, 3:] = -2.0 / delay**2, -2.0 / delay
    B = np.zeros((5, 1))
    B[4, 0] = 2.0 / delay**2
    return A, B


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
    n = 3 + scenario.n_pending
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
    if "winch_displacement" in measured:
        return made(states, D=gain)
    # The winch's displacement is row 2 of the model, driven by pending and new commands alone.
    return made(
        (*PAYLOAD_MOTION, *states[3:]),
        D=np.delete(gain, 2, axis=1),
        F=A[2:3, 2:3],
        G=np.hstack([np.zeros((1, 2)), A[2:3, 3:]]),
        H=B[2:3],
        L=gain[:, 2:3],
    )


def _taylor(scenario: Scenario, q: float, r: float) -> LinearController:
    A, B = taylor_matrices(
        payload_model(scenario), scenario.winch.rate_constant, scenario.winch.command_delay
    )
    gain = continuous_gain(A, B, q, r)
    measured = measured_entries(scenario)
    winch_measured = "winch_displacement" in measured
    used = (*PAYLOAD_MOTION, "winch_displacement") if winch_measured else PAYLOAD_MOTION
    # What is not measured (the delayed command and its rate, perhaps the winch) is integrated here.
    first = len(used)
    F, H = held_command(A[first:, first:], B[first:], scenario.control_dt)
    return controller(
        "delay_lqr",
        scenario,
        used,
        D=gain[:, :first],
        F=F,
        G=np.zeros((5 - first, first)),
        H=H,
        L=gain[:, first:],
        gain=gain,
        states=(*PAYLOAD_MOTION, "winch_displacement", "delayed_command", "delayed_command_rate"),
        energy_index=float(np.linalg.norm(gain)),
        truth=truth_model(scenario),
        command_weight=r,
    )
