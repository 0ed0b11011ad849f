"""The cost of who knows the coming sea and keeps to the winch's limits: a yardstick, no controller.

The whole episode is one quadratic programme, its unknowns payload, winch and rate at every control instant,
with the boom tip's true motion as the plant's seed makes it:

    minimise    sum q x_{k+1}^2 + r u0_k^2 + e |v_k|
    subject to  the payload's and the winch's equations of motion, and the limits of speed, acceleration,
                stroke and command range.

The drum's rate runs straight between control instants (without an acceleration limit, its lag is followed; a
second-order drive exactly), as in the plan of `baselines.mpc`. Dead band and rounding are left out: who had
to put up with them could only be dearer. Delay and sensors do not matter to who knows everything; the first
moves, which in the plant belong to commands already given, lie in the warm-up.

No controller that has to infer the sea can be cheaper on average; how far above it a controller stays is the
price of not knowing. Solved by Clarabel, an interior-point method.

Source: Goulart and Chen (2024).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy import sparse

from baselines.model import payload_model
from baselines.mpc import planning_model
from baselines.oracle import drawn_parameters
from baselines.winch_model import winch_model
from heave_env.plant import linear_step, simulate
from heave_env.scenarios import Scenario
from heave_env.sea import Array


def clairvoyant_cost(scenario: Scenario, seeds: Sequence[int], *, warm_up: float = 100.0) -> Array:
    """Least mean stage cost of each seed's episode after the warm-up, the sea being known, (n_seeds,) [-].

    Args:
        scenario: The operation, with a linear payload.
        seeds: Seeds of the seas.
        warm_up: Time that does not count [s].

    Raises:
        ValueError: If the scenario has a cable, or the warm-up leaves nothing.
        RuntimeError: If the programme is not solved.
    """
    if not scenario.is_linear:
        raise ValueError(
            f"scenario {scenario.name!r} has a cable, on which the clairvoyant optimum is no quadratic "
            "programme; choose one with a linear_payload"
        )
    first = round(warm_up / scenario.control_dt)
    if not 0 <= first < scenario.n_steps:
        raise ValueError(f"warm_up must leave something of {scenario.duration:g} s, got {warm_up!r}")
    record = simulate(scenario, seeds=list(seeds))
    # Who knows everything knows what the episode drew, too.
    own = [scenario.with_drawn(drawn) for drawn in drawn_parameters(scenario, seeds)]
    heave, rate = record["boom_tip_heave"], record["boom_tip_heave_rate"]
    costs = []
    for i, known in enumerate(own):
        forcing = linear_step(payload_model(known), scenario.control_dt)[1].T
        ends = np.column_stack([heave[:-1, i], rate[:-1, i], heave[1:, i], rate[1:, i]])
        start = np.array(
            [
                record[name][0, i]
                for name in ("payload_heave", "payload_heave_rate", "winch_displacement", "winch_rate")
            ]
        )
        costs.append(float(np.mean(_stage_costs(known, start, ends @ forcing)[first:])))
    return np.array(costs)


def _stage_costs(scenario: Scenario, start: Array, drive: Array) -> Array:
    """Stage cost of every control step, (n_steps,).

    Args:
        scenario: The operation.
        start: [x, x', u, v] when the episode begins.
        drive: What the boom tip adds to payload heave and rate over each step, (n_steps, 2).
    """
    import clarabel  # deferred: nothing else needs it

    winch = winch_model(scenario)
    A, B, c, d = planning_model(scenario, winch, straight=winch.ramps)
    A, B, c = A[:4, :4], B[:4], c[:4]
    n, eye, before = len(drive), sparse.eye(len(drive)), sparse.eye(len(drive), k=-1)
    # Unknowns [x, x', u, v] at the end of each step, the last of them being the step's input.
    state, rate = np.eye(4), np.eye(1, 4, 3)
    motion = sparse.kron(eye, (state - B @ rate)[:3]) - sparse.kron(before, A[:3])
    known = np.column_stack([drive, np.zeros(n)])
    known[0] += A[:3] @ start
    command = sparse.kron(eye, d * rate) + sparse.kron(before, c[None])
    first_command = np.zeros(n)
    first_command[0] = c @ start

    rows: list[sparse.spmatrix] = [command]
    shifts, limits = [first_command], [winch.command_range]
    if math.isfinite(winch.speed_limit):
        rows.append(sparse.kron(eye, rate))
        shifts.append(np.zeros(n))
        limits.append(winch.speed_limit)
    if not winch.accelerates_at_once:
        rows.append(sparse.kron(eye, rate) - sparse.kron(before, rate))
        shifts.append(np.concatenate([[-start[3]], np.zeros(n - 1)]))
        limits.append(winch.acceleration_limit * winch.control_dt)
    if math.isfinite(winch.stroke_limit):
        rows.append(sparse.kron(eye, np.eye(1, 4, 2)))
        shifts.append(np.zeros(n))
        limits.append(winch.stroke_limit)
    constraints = sparse.vstack([motion, *rows, *(-row for row in rows)]).tocsc()
    bounds = np.concatenate(
        [
            known.ravel(),
            *(limit - shift for limit, shift in zip(limits, shifts, strict=True)),
            *(limit + shift for limit, shift in zip(limits, shifts, strict=True)),
        ]
    )
    q, r, e = scenario.task.position_weight, scenario.task.command_weight, scenario.task.energy_weight
    hessian = 2.0 * (sparse.kron(eye, np.diag([q, 0.0, 0.0, 0.0])) + r * command.T @ command)
    slope = 2.0 * r * (command.T @ first_command)
    n_bounds = 2 * n * len(rows)
    if e > 0.0:
        # Unknowns t >= |v| beside the motion, at the price e.
        speed = sparse.kron(eye, rate)
        absolute = sparse.vstack([sparse.hstack([speed, -eye]), sparse.hstack([-speed, -eye])])
        nothing = sparse.csc_matrix((constraints.shape[0], n))
        constraints = sparse.vstack([sparse.hstack([constraints, nothing]), absolute]).tocsc()
        bounds = np.concatenate([bounds, np.zeros(2 * n)])
        hessian = sparse.block_diag([hessian, sparse.csc_matrix((n, n))])
        slope = np.concatenate([slope, np.full(n, e)])
        n_bounds += 2 * n
    cones = [clarabel.ZeroConeT(3 * n), clarabel.NonnegativeConeT(n_bounds)]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    solver = clarabel.DefaultSolver(sparse.triu(hessian).tocsc(), slope, constraints, bounds, cones, settings)
    found = solver.solve()
    if str(found.status) not in ("Solved", "AlmostSolved"):
        raise RuntimeError(
            f"the clairvoyant programme of scenario {scenario.name!r} was not solved ({found.status}); "
            "shorten the episode"
        )
    x = np.asarray(found.x)[: 4 * n]
    u0 = command @ x + first_command
    return np.asarray(q * x[::4] ** 2 + r * u0**2 + e * np.abs(x[3::4]))
