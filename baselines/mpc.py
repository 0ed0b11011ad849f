"""Model-predictive control: the winch's limits are part of the plan, not what cuts it short.

At every control instant the Kalman estimate is carried to the instant at which the command now given arrives
at the winch. From there the drum's rate is planned over a horizon,

    minimise    sum q x_j^2 + r u0_j^2 + s v_j^2 + e |v_j|  +  s_Nᵀ S s_N
    subject to  |v_j| <= speed limit,  |v_j - v_{j-1}| <= acceleration limit dt,  |u_j| <= stroke limit,
                |u_j + v_j / K| <= command range,

x being the payload's heave on the coming motion of the boom tip as the sea's filter expects it, S the cost of
all that follows without limits (discrete Riccati equation). The first move alone is carried out: the command
is the one that makes the limited drum do it (`baselines.winch_model`); at the next instant all is planned
anew. Where no limit is met within the horizon the plan is the stochastic-optimal controller's, in closed form
and without a search.

The rate is planned at knots that lie the farther apart the farther ahead, and runs straight between them
(without an acceleration limit it keeps still between them): as few unknowns as knots, and a plan that keeps
within its limits everywhere. The search is DAQP's, a dual active-set method, exact and free of tuning; a plan
that must break the range or the stroke (a drum too fast to stop) is allowed what braking needs.

It is certainty-equivalent: it plans as if the estimate and the expected sea were true.

Source: Mayne et al. (2000); Arnström, Bemporad and Axehill (2022).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from typing import Any

import numpy as np
from scipy.linalg import expm, solve_discrete_are

from baselines.estimator import Estimator, estimator
from baselines.linear_controller import LinearController, without_matrices
from baselines.lqr import design_weights
from baselines.model import continuous_model, held_command, nominal_sea, payload_model, sea_filter
from baselines.winch_model import WinchModel, payload_forcing
from heave_env.plant import linear_step
from heave_env.scenarios import Scenario
from heave_env.sea import Array
from heave_env.spectra import modal_omega

HORIZON_PERIODS = 0.75
"""Length of the plan, in modal periods of the sea [-]."""
N_FINE = 4
"""Knots that lie a control step apart, at the plan's beginning [-]."""
GROWTH = 1.25
"""Ratio of a knot's distance to the one before [-], rounded up to control steps."""
LEAST_CURVATURE = 1e-6
"""Curvature of the absolute rates' own unknowns, over that of the rates [-]: the search wants a strictly
convex problem."""
UNLIMITED = 1e20
"""Bound that stands for none; DAQP takes anything above 1e30 for infinite, and below for a number."""
ROOM = 1e-9
"""What a braking drum is granted beside its braking [m], so that rounding leaves the search an answer."""
ENERGY_SHARE = 0.05
"""Price of motion that `mpc_l1` assumes where none is given: following the whole sea costs this share of what
leaving the winch locked costs [-]."""


@dataclass(frozen=True, eq=False)
class Plan:
    """The problem of one scenario, condensed to the rates at the knots; a state is
    [x, x', u, v, sea] when the command arrives."""

    knots: Array
    """Control steps from the arrival of the command to each knot, (n_knots,)."""
    hessian: Array
    """(n_knots, n_knots)."""
    slope: Array
    """Gradient per state, (n_knots, n_states)."""
    rows: Array
    """Constraints on the rates at the knots beside their own bounds, (n_rows, n_knots)."""
    limits: Array
    """Bounds of the constraints, both signs, (n_rows,)."""
    shift: Array
    """What the state itself puts into the constraints, (n_rows, n_states)."""
    fastest: float
    """Bound of the rates [m/s]."""
    braking: Array
    """How much slower the drum can be at each knot than on arrival [m/s], (n_knots,)."""
    prices: Array
    """Cost of the absolute rate at each knot, (n_knots,)."""
    ramps: bool
    """Whether rates run straight between the knots; else they keep still."""

    @property
    def n_knots(self) -> int:
        """Unknown rates [-]."""
        return len(self.knots)


@dataclass(frozen=True, eq=False)
class PredictiveController(LinearController):
    """Filter, plan and inverted winch; the memory is the estimator's. The matrices are empty."""

    estimator: Estimator | None = None
    plan: Plan | None = None
    ahead: Array | None = None
    """Payload and sea when the command arrives, per unit of now, (n_carried, n_carried)."""
    arrival_forcing: Array | None = None
    """Path of the drum until then to payload heave and rate, (4 n_delayed, 2)."""
    speed_weight: float = 0.0
    """Weight of the squared rate in the plan, s [s²/m²]."""
    energy_weight: float = 0.0
    """Price of the absolute rate in the plan, e [s/m]."""

    @property
    def n_memory(self) -> int:
        """Numbers remembered from step to step [-]."""
        assert self.estimator is not None
        return self.estimator.n_memory

    def __getstate__(self) -> dict[str, Any]:
        """Everything but the search's own workspace, which is made anew."""
        return {key: value for key, value in self.__dict__.items() if key not in ("_search", "_inverse")}

    @cached_property
    def _search(self) -> Any:
        assert self.plan is not None
        return _Search(self.plan)

    @cached_property
    def _inverse(self) -> Array:
        assert self.plan is not None
        return -np.linalg.solve(self.plan.hessian, self.plan.slope)

    def respond(self, y: Array, memory: Array) -> tuple[Array, Array]:
        """Command in metres, (n_envs, 1), and the next memory, for measurements in SI units."""
        assert self.estimator is not None and self.plan is not None
        estimate, rate = self.estimator.corrected(memory, y)
        state = self._at_arrival(estimate, rate)
        first = self.planned(state)[:, 0]
        winch = self.estimator.winch
        if self.plan.ramps:
            command = winch.command_for_rate(state[:, 2], state[:, 3], first)
        else:
            command = winch.command_for_displacement(state[:, 2], state[:, 2] + winch.control_dt * first)
        command = command[:, None]
        return command, self.estimator.advanced(memory, estimate, rate, command)

    def _at_arrival(self, estimate: Array, rate: Array) -> Array:
        """State when the command now given arrives at the winch, (n_envs, n_states of the plan)."""
        assert self.estimator is not None and self.ahead is not None and self.arrival_forcing is not None
        winch = self.estimator.winch
        u, v, path = winch.path(
            estimate[:, 2],
            rate,
            self.estimator.commands(estimate, np.zeros(len(estimate))),
            first=0,
            count=winch.n_delayed,
        )
        sea = 3 + winch.n_pending
        n_sea = len(self.ahead) - 2
        carried = np.hstack([estimate[:, :2], estimate[:, sea : sea + n_sea]]) @ self.ahead.T
        payload = carried[:, :2] + path @ self.arrival_forcing
        return np.column_stack([payload, u, v, carried[:, 2:]])

    def planned(self, state: Array) -> Array:
        """Best rates at the knots from states at the arrival of the command [m/s], (n_envs, n_knots)."""
        assert self.plan is not None
        plan = self.plan
        if plan.prices.any():
            todo = np.ones(len(state), dtype=bool)
            rates = np.empty((len(state), plan.n_knots))
        else:
            rates = state @ self._inverse.T
            constrained = np.abs(rates @ plan.rows.T + state @ plan.shift.T) > plan.limits
            todo = constrained.any(axis=1) | (np.abs(rates) > plan.fastest).any(axis=1)
        if todo.any():
            rates[todo] = self._search.best(state[todo])
        return rates


class _Search:
    """DAQP's workspace for a plan, used again and again."""

    def __init__(self, plan: Plan) -> None:
        from daqp import Model

        n = plan.n_knots
        self.plan, self.model = plan, Model()
        self.priced = bool(plan.prices.any())
        hessian, rows, n_bounds = plan.hessian, plan.rows, n
        if self.priced:
            # Unknowns t >= |v| beside the rates: -t <= v <= t.
            least = LEAST_CURVATURE * float(np.diag(hessian).mean())
            hessian = np.block([[hessian, np.zeros((n, n))], [np.zeros((n, n)), least * np.eye(n)]])
            nothing = np.zeros((len(rows), n))
            eye = np.eye(n)
            rows = np.block([[rows, nothing], [eye, eye], [-eye, eye]])
            n_bounds = 2 * n
        self.n_bounds = n_bounds
        m = n_bounds + len(rows)
        self.sense = np.zeros(m, dtype=np.int32)
        self.upper, self.lower = np.full(m, UNLIMITED), np.full(m, -UNLIMITED)
        self.upper[:n], self.lower[:n] = min(plan.fastest, UNLIMITED), -min(plan.fastest, UNLIMITED)
        if self.priced:
            self.lower[n_bounds + len(plan.rows) :] = 0.0
        self.gradient = np.concatenate([np.zeros(n), plan.prices]) if self.priced else np.zeros(n)
        self.model.setup(
            np.ascontiguousarray(hessian), self.gradient, np.ascontiguousarray(rows), self.upper, self.lower,
            self.sense,
        )  # fmt: skip

    def best(self, state: Array) -> Array:
        """Best rates at the knots, row by row, (n_rows, n_knots)."""
        plan, n = self.plan, self.plan.n_knots
        slope = state @ plan.slope.T
        shift = state @ plan.shift.T
        # A drum that is too fast to stop within its range or stroke may go as far as braking takes it.
        speed = state[:, 3:4]
        slowed = np.sign(speed) * np.maximum(np.abs(speed) - plan.braking, 0.0)
        limits = np.maximum(plan.limits, np.abs(slowed @ plan.rows.T + shift) + ROOM)
        rates = np.empty((len(state), n))
        inner = slice(self.n_bounds, self.n_bounds + len(plan.rows))
        for row in range(len(state)):
            self.gradient[:n] = slope[row]
            self.upper[inner], self.lower[inner] = limits[row] - shift[row], -limits[row] - shift[row]
            self.model.update(f=self.gradient, bupper=self.upper, blower=self.lower, sense=self.sense)
            found, _, flag, _ = self.model.solve()
            # Braking keeps within every bound, so an answer exists; should rounding hide it, keep the rate.
            rates[row] = found[:n] if flag > 0 else np.clip(state[row, 3], -plan.fastest, plan.fastest)
        return rates


# Design ------------------------------------------------------------------------------------------


def knots_of(n_steps: int) -> Array:
    """Control steps to the knots of a plan of `n_steps`: some one by one, then ever farther apart."""
    knots = list(range(1, N_FINE + 1))
    gap = 1.0
    while knots[-1] < n_steps:
        gap *= GROWTH
        knots.append(knots[-1] + math.ceil(gap))
    return np.array(knots)


def planning_model(scenario: Scenario, winch: WinchModel) -> tuple[Array, Array, Array, float]:
    """[x, x', u, v, sea] over a control step whose input is the rate at its end, and the command it takes.

    Returns:
        A (n, n), B (n, 1), and c (n,) and d of the command u0 = c s + d v.
    """
    dt, K = winch.control_dt, winch.rate_constant
    carried = carried_sea(scenario, dt)
    n = len(carried) + 2
    A, B, c = np.zeros((n, n)), np.zeros((n, 1)), np.zeros(n)
    place = np.r_[0:2, 4:n]
    A[np.ix_(place, place)] = carried
    A[2, 2] = B[3] = c[2] = 1.0
    if winch.ramps:
        # The drum's path is a parabola, which the payload meets as the cubic through its ends.
        A[2, 3] = B[2] = c[3] = 0.5 * dt
        _, forcing = linear_step(payload_model(scenario), dt)
        A[:2, 2] = forcing[:, 0] + forcing[:, 2]
        A[:2, 3] = forcing[:, 1] + 0.5 * dt * forcing[:, 2]
        B[:2, 0] = 0.5 * dt * forcing[:, 2] + forcing[:, 3]
        return A, B, c, 0.5 * dt + 1.0 / K
    # The drum follows its lag; v is its mean rate.
    continuous = continuous_model(scenario)
    F, H = held_command(continuous.A[:3, :3], continuous.B1[:3], dt)
    d = dt / -math.expm1(-K * dt)
    A[:2, 2] = F[:2, 2] + H[:2, 0]
    B[:2, 0] = d * H[:2, 0]
    B[2] = dt
    return A, B, c, d


def carried_sea(scenario: Scenario, span: float) -> Array:
    """Transition of payload and sea over a time, the winch at zero; states [x, x', sea]."""
    A = continuous_model(scenario).A
    place = np.r_[0:2, 3 : len(A)]
    return np.asarray(expm(A[np.ix_(place, place)] * span))


def plan(
    scenario: Scenario, winch: WinchModel, *, command_weight: float, speed_weight: float, energy_weight: float
) -> Plan:
    """Condenses the problem of a scenario."""
    A, B, c, d = planning_model(scenario, winch)
    q, n = scenario.task.position_weight, len(A)
    Q = command_weight * np.outer(c, c)
    Q[0, 0] += q
    R = np.array([[command_weight * d**2 + speed_weight]])
    S = solve_discrete_are(A, B, Q, R, s=command_weight * d * c[:, None])

    sea = nominal_sea(scenario)
    assert sea is not None
    knots = knots_of(math.ceil(HORIZON_PERIODS * 2.0 * math.pi / modal_omega(sea) / winch.control_dt))
    n_steps, n_knots = int(knots[-1]), len(knots)
    # Everything as rows on [state, rates at the knots].
    now = np.hstack([np.eye(n), np.zeros((n, n_knots))])
    rates = _rates(knots, winch.ramps, n)
    P = np.zeros((n + n_knots, n + n_knots))
    displacement = np.empty((n_steps, n + n_knots))
    command = np.empty_like(displacement)
    for step in range(n_steps):
        command[step] = c @ now + d * rates[step]
        P += command_weight * np.outer(command[step], command[step])
        P += speed_weight * np.outer(rates[step], rates[step]) + q * np.outer(now[0], now[0])
        now = A @ now + B @ rates[step : step + 1]
        displacement[step] = now[2]
    P += now.T @ S @ now

    rows, limits = [], []
    ends = knots - 1
    if winch.ramps:
        earlier = np.vstack([np.eye(1, n + n_knots, 3), rates[ends[:-1]]])
        rows.append(rates[ends] - earlier)
        limits.append(winch.acceleration_limit * winch.control_dt * np.diff(knots, prepend=0))
    if math.isfinite(winch.stroke_limit):
        # At every step: between far knots the drum could turn round beyond its stops.
        rows.append(displacement)
        limits.append(np.full(n_steps, winch.stroke_limit))
    rows.append(command[ends])
    limits.append(np.full(n_knots, winch.command_range))
    constraints = np.vstack(rows)
    return Plan(
        knots=knots,
        hessian=P[n:, n:],
        slope=P[n:, :n],
        rows=constraints[:, n:],
        limits=np.concatenate(limits),
        shift=constraints[:, :n],
        fastest=winch.speed_limit,
        braking=winch.acceleration_limit * winch.control_dt * knots,
        prices=0.5 * energy_weight * np.abs(rates[:, n:]).sum(axis=0),
        ramps=winch.ramps,
    )


def _rates(knots: Array, ramps: bool, n_states: int) -> Array:
    """Rate of each control step from the state and the rates at the knots, (n_steps, n_states + n_knots)."""
    steps = np.arange(1, knots[-1] + 1)
    found = np.zeros((len(steps), n_states + len(knots)))
    if not ramps:
        found[np.arange(len(steps)), n_states + np.searchsorted(knots, steps)] = 1.0
        return found
    known = np.concatenate([[0], knots])
    for i in range(len(known)):
        hat = np.interp(steps, known, np.eye(len(known))[i])
        found[:, 3 if i == 0 else n_states + i - 1] = hat
    return found


def mpc(
    scenario: Scenario,
    *,
    command_weight: float | None = None,
    speed_weight: float = 0.0,
    mismatch: float = 1.0,
) -> PredictiveController:
    """Designs the predictive controller with the task's quadratic cost.

    Args:
        scenario: The operation; its task weighs position against command.
        command_weight: r of the plan [1/m²]; the task's own if not given.
        speed_weight: s of the plan [s²/m²], caution towards what the speed limit may not allow.
        mismatch: How many times the residual of the identification the filter doubts the model of a cable by.

    Raises:
        ValueError: If the sea is calm, or nothing that the model expresses is measured.
    """
    return _designed("mpc", scenario, command_weight, speed_weight, 0.0, mismatch)


def mpc_l1(
    scenario: Scenario,
    *,
    command_weight: float | None = None,
    speed_weight: float = 0.0,
    energy_weight: float | None = None,
    mismatch: float = 1.0,
) -> PredictiveController:
    """Designs the predictive controller that also pays for the winch's work, |force x speed|.

    The force is nearly the payload's weight, whatever the plan, so that the work is a price on |speed|.

    Args:
        scenario: The operation.
        command_weight: r of the plan [1/m²]; the task's own if not given.
        speed_weight: s of the plan [s²/m²].
        energy_weight: Stage cost per winch speed, e [s/m]; if not given, following the whole sea costs
            `ENERGY_SHARE` of what leaving the winch locked costs.
        mismatch: As in `mpc`.

    Raises:
        ValueError: If the sea is calm, a weight is negative, or nothing that the model expresses is measured.
    """
    price = assumed_energy_weight(scenario) if energy_weight is None else energy_weight
    return _designed("mpc_l1", scenario, command_weight, speed_weight, price, mismatch)


def assumed_energy_weight(scenario: Scenario) -> float:
    """The task's own price of speed; without one, that at which following the sea costs `ENERGY_SHARE` of the
    uncontrolled cost [s/m]."""
    if scenario.task.energy_weight > 0.0:
        return scenario.task.energy_weight
    waves = sea_filter(scenario)
    if waves is None:
        return 0.0
    rate_std = math.sqrt((waves.C[1] @ waves.covariance @ waves.C[1]).item())
    return ENERGY_SHARE * scenario.uncontrolled_cost / (math.sqrt(2.0 / math.pi) * rate_std)


def _designed(
    name: str,
    scenario: Scenario,
    command_weight: float | None,
    speed_weight: float,
    energy_weight: float,
    mismatch: float,
) -> PredictiveController:
    if find_spec("daqp") is None:
        raise ValueError(f"controller {name!r} needs the package daqp; install heave-env[control]")
    _, r = design_weights(scenario, command_weight)
    for label, value in (("speed_weight", speed_weight), ("energy_weight", energy_weight)):
        if not (math.isfinite(value) and value >= 0.0):
            raise ValueError(f"{label} must be a number, not negative, got {value!r}")
    found = estimator(scenario, mismatch=mismatch)
    measures = found.filter.model.outputs
    return PredictiveController(
        **without_matrices(name, scenario, measures),
        command_weight=r,
        estimator=found,
        plan=plan(
            scenario,
            found.winch,
            command_weight=r,
            speed_weight=speed_weight,
            energy_weight=energy_weight,
        ),
        ahead=carried_sea(scenario, scenario.winch.command_delay),
        arrival_forcing=payload_forcing(scenario, found.winch.n_delayed),
        speed_weight=speed_weight,
        energy_weight=energy_weight,
    )
