"""Model-predictive control: the winch's limits are part of the plan, not what cuts it short.

At every control instant the Kalman estimate is carried to the instant at which the command now given arrives
at the winch. From there the drum's rate is planned over a horizon,

    minimise    sum q x_j^2 + r u0_j^2 + s v_j^2 + e |v_j|  +  s_Nᵀ S s_N
    subject to  |v_j| <= speed limit,  |v_j - v_{j-1}| <= acceleration limit dt,  |u_j| <= stroke limit,
                |u0_j| <= command range,    u0_j = u_j + v_j / K with a lag,

x being the payload's heave on the coming motion of the boom tip as the sea's filter expects it, S the cost of
all that follows without limits (discrete Riccati equation). The first move alone is carried out: the command
is the one that makes the limited drum do it (`baselines.winch_model`); at the next instant all is planned
anew. Where no limit is met within the horizon the plan is the stochastic-optimal controller's, in closed form
and without a search.

The rate is planned at knots that lie the farther apart the farther ahead, and runs straight between them
(with a lag and no acceleration limit it keeps still between them): as few unknowns as knots, and a plan that
keeps within its limits everywhere. A lag whose acceleration limit is far above what its rate wants to jump by
at a new command (`RARELY`) is planned as if it jumped: to have it run straight cost half a per cent and more
where the limit never bites. Of a second-order drive the rate at the end of a step stands for the command, of
which it is a linear function. Limits of power and torque bound speed and acceleration, at the tension that
the estimator reckons with; dead band and rounding are left to the inversion of the first move. The search is
DAQP's, a dual active-set method, exact and free of tuning; a plan that must break the range or the stroke (a
drum too fast to stop) is allowed what braking needs.

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
from scipy.linalg import expm, solve_discrete_are, solve_discrete_lyapunov

from baselines.estimator import Estimator, estimator
from baselines.kalman import KalmanFilter
from baselines.linear_controller import LinearController, without_matrices
from baselines.lqr import design_weights, sampled_gain
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
FULL = 0.999999
"""Share of the acceleration limit from which on a planned step counts as at the limit [-]."""
ROOM = 1e-9
"""What a braking drum is granted beside its braking [m], so that rounding leaves the search an answer."""
RARELY = 3.0
"""Standard deviations of the lag's jump at a new command that the acceleration limit lets it make in a
control step, from which on the plan follows the lag [-]."""
ENERGY_SHARE = 0.05
"""Price of motion that `mpc_l1` assumes where none is given: following the whole sea costs this share of what
leaving the winch locked costs [-]."""


Capability = tuple[Array | float, Array | float, Array | float]
"""Largest speed [m/s], largest and least acceleration [m/s²]."""


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
    spans: Array
    """Time that the rates have to change from knot to knot [s], (n_limited,): of the constraints that come
    first, on the acceleration; none without such a limit."""
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
        measured, tension = self.estimator.parted(y)
        estimate, rate = self.estimator.corrected(memory, measured)
        state = self.at_arrival(estimate, rate, tension)
        winch = self.estimator.winch
        capability = winch.capability(tension) if winch.feels_tension else None
        rates = self.planned(state, capability)
        first = rates[:, 0]
        # Before a stop the drum is told to the step how to brake.
        unbraked = capability is None and math.isinf(winch.stroke_limit)
        if self.plan.ramps and unbraked and not winch.parameters.is_second_order:
            first = self._end_of_full_acceleration(state[:, 3], rates)
        command = self.command_for_rate(state, first, tension)
        return command, self.estimator.advanced(memory, estimate, rate, command, tension)

    def command_for_rate(self, state: Array, rate: Array, tension: Array | None = None) -> Array:
        """Command with which the drum does as planned over the control step in which it arrives [m].

        Args:
            state: At the arrival of the command, (n_envs, n_states of the plan).
            rate: Of the drum at the end of that step, or over it where the plan keeps still between its knots
                [m/s], (n_envs,).
            tension: At the sheave [N], (n_envs,); that of the cable hanging still if not given.

        Returns:
            (n_envs, 1).
        """
        assert self.estimator is not None and self.plan is not None
        winch, u, v = self.estimator.winch, state[:, 2], state[:, 3]
        if self.plan.ramps:
            command = winch.command_for_rate(u, v, rate, tension)
        else:
            command = winch.command_for_displacement(u, u + winch.control_dt * rate, tension)
        return np.asarray(winch.shaped(u, v, command, tension))[:, None]

    def rate_for_command(self, state: Array, command: Array, tension: Array | None = None) -> Array:
        """What a command (n_envs, 1) makes of the drum's rate, as `command_for_rate` means it [m/s]."""
        assert self.estimator is not None and self.plan is not None
        winch, u = self.estimator.winch, state[:, 2]
        end, rate, _ = winch.path(
            u, state[:, 3], command, first=winch.n_delayed, count=winch.n_substeps, tension=tension
        )
        return rate if self.plan.ramps else (end - u) / winch.control_dt

    def _end_of_full_acceleration(self, v: Array, rates: Array) -> Array:
        """Rate at which the plan's acceleration leaves its limit, within the first knots [m/s], (n_envs,).

        A lag that is asked for this rate accelerates at its limit of itself. Were it asked for just what a
        step can give, the least error of command or model would take that from it.
        """
        assert self.plan is not None and self.estimator is not None
        winch = self.estimator.winch
        gained = np.diff(np.column_stack([v, rates[:, :N_FINE]]), axis=1)
        full = np.abs(gained) >= FULL * winch.acceleration_limit * winch.control_dt
        run = np.cumprod(full & (np.sign(gained) == np.sign(gained[:, :1])), axis=1).sum(axis=1)
        return np.asarray(rates[np.arange(len(rates)), np.maximum(run, 1) - 1])

    def at_arrival(self, estimate: Array, rate: Array, tension: Array | None) -> Array:
        """State when the command now given arrives at the winch, (n_envs, n_states of the plan)."""
        assert self.estimator is not None and self.ahead is not None and self.arrival_forcing is not None
        u, v, path = self.estimator.at_arrival(estimate, rate, tension)
        winch = self.estimator.winch
        sea = 3 + winch.n_pending
        n_sea = len(self.ahead) - 2
        carried = np.hstack([estimate[:, :2], estimate[:, sea : sea + n_sea]]) @ self.ahead.T
        payload = carried[:, :2] + path @ self.arrival_forcing
        return np.column_stack([payload, u, v, carried[:, 2:]])

    def unlimited(self, state: Array) -> Array:
        """Best rates at the knots if nothing were limited and work had no price [m/s], (n_envs, n_knots)."""
        return np.asarray(state @ self._inverse.T)

    def planned(self, state: Array, capability: Capability | None = None) -> Array:
        """Best rates at the knots from states at the arrival of the command [m/s], (n_envs, n_knots).

        Args:
            state: (n_envs, n_states of the plan).
            capability: Of a winch that feels the tension, its speed and accelerations at the present one
                (`WinchModel.capability`).
        """
        assert self.plan is not None
        plan = self.plan
        bounds = _Bounds(plan, state, capability)
        if plan.prices.any():
            todo = np.ones(len(state), dtype=bool)
            rates = np.empty((len(state), plan.n_knots))
        else:
            rates = self.unlimited(state)
            met = rates @ plan.rows.T + state @ plan.shift.T
            todo = ((met > bounds.upper) | (-met > bounds.lower)).any(axis=1)
            todo |= (np.abs(rates) > bounds.fastest).any(axis=1)
        if todo.any():
            rates[todo] = self._search.best(state[todo], bounds.of(todo))
        return rates


class _Bounds:
    """Of the plan's constraints and rates, row by row; those of the constraints both positive."""

    def __init__(self, plan: Plan, state: Array, capability: Capability | None) -> None:
        n = len(state)
        self.upper = self.lower = np.broadcast_to(plan.limits, (n, len(plan.limits)))
        self.fastest: Array = np.full((n, 1), plan.fastest)
        self.braking: Array = np.broadcast_to(plan.braking, (n, plan.n_knots))
        if capability is None:
            return
        fastest, most, least = (np.broadcast_to(value, n)[:, None] for value in capability)
        self.fastest = np.asarray(fastest)
        n_limited = len(plan.spans)
        if n_limited:
            # A drum that the tension overpowers is planned as if it could just hold.
            self.upper, self.lower = self.upper.copy(), self.lower.copy()
            self.upper[:, :n_limited] = np.maximum(most, 0.0) * plan.spans
            self.lower[:, :n_limited] = np.maximum(-least, 0.0) * plan.spans
            self.braking = np.maximum(np.minimum(most, -least), 0.0) * np.cumsum(plan.spans)

    def of(self, rows: Array) -> _Bounds:
        """Those of some rows."""
        found = object.__new__(_Bounds)
        for name in ("upper", "lower", "fastest", "braking"):
            setattr(found, name, getattr(self, name)[rows])
        return found


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
        if self.priced:
            self.lower[n_bounds + len(plan.rows) :] = 0.0
        self.gradient = np.concatenate([np.zeros(n), plan.prices]) if self.priced else np.zeros(n)
        self.model.setup(
            np.ascontiguousarray(hessian), self.gradient, np.ascontiguousarray(rows), self.upper, self.lower,
            self.sense,
        )  # fmt: skip

    def best(self, state: Array, bounds: _Bounds) -> Array:
        """Best rates at the knots, row by row, (n_rows, n_knots)."""
        plan, n = self.plan, self.plan.n_knots
        slope = state @ plan.slope.T
        shift = state @ plan.shift.T
        # A drum that is too fast to stop within its range or stroke may go as far as braking takes it.
        speed = state[:, 3:4]
        slowed = np.sign(speed) * np.maximum(np.abs(speed) - bounds.braking, 0.0)
        needed = np.abs(slowed @ plan.rows.T + shift) + ROOM
        upper, lower = np.maximum(bounds.upper, needed) - shift, -np.maximum(bounds.lower, needed) - shift
        fastest = np.minimum(bounds.fastest, UNLIMITED)
        rates = np.empty((len(state), n))
        inner = slice(self.n_bounds, self.n_bounds + len(plan.rows))
        for row in range(len(state)):
            self.gradient[:n] = slope[row]
            self.upper[:n], self.lower[:n] = fastest[row], -fastest[row]
            self.upper[inner], self.lower[inner] = upper[row], lower[row]
            self.model.update(f=self.gradient, bupper=self.upper, blower=self.lower, sense=self.sense)
            found, _, flag, _ = self.model.solve()
            # Braking keeps within every bound, so an answer exists; should rounding hide it, keep the rate.
            rates[row] = found[:n] if flag > 0 else np.clip(state[row, 3], -fastest[row], fastest[row])
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


def planning_model(
    scenario: Scenario, winch: WinchModel, *, straight: bool
) -> tuple[Array, Array, Array, float]:
    """[x, x', u, v, sea] over a control step whose input is the rate at its end, and the command it takes.

    Args:
        scenario: The operation.
        winch: Its drum.
        straight: Whether the rate of a lag runs straight within the step; else it follows the lag, and the
            input is its mean. A second-order drive does neither.

    Returns:
        A (n, n), B (n, 1), and c (n,) and d of the command u0 = c s + d v.
    """
    dt, K = winch.control_dt, winch.rate_constant
    if winch.parameters.is_second_order:
        return _planning_model_of_drive(scenario, winch)
    carried = carried_sea(scenario, dt)
    n = len(carried) + 2
    A, B, c = np.zeros((n, n)), np.zeros((n, 1)), np.zeros(n)
    place = np.r_[0:2, 4:n]
    A[np.ix_(place, place)] = carried
    A[2, 2] = B[3] = c[2] = 1.0
    if straight:
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


def _planning_model_of_drive(scenario: Scenario, winch: WinchModel) -> tuple[Array, Array, Array, float]:
    """The same of a second-order drive, exact: v1 = R10 (u - u0) + R11 v, solved for the command."""
    continuous, R = continuous_model(scenario), winch.control_transition
    n = len(continuous.A)
    # The rate of the drive, the model's last state, stands behind the displacement here.
    order = np.r_[0:3, n - 1, 3 : n - 1]
    F, H = held_command(continuous.A, continuous.B1, winch.control_dt)
    F, H = F[np.ix_(order, order)], H[order]
    c, d = np.zeros(n), -1.0 / R[1, 0]
    c[2], c[3] = 1.0, R[1, 1] / R[1, 0]
    A, B = F + H @ c[None], d * H
    A[3], B[3] = 0.0, 1.0
    return A, B, c, d


def carried_sea(scenario: Scenario, span: float) -> Array:
    """Transition of payload and sea over a time, the winch at zero; states [x, x', sea]."""
    A = continuous_model(scenario).A
    place = np.r_[0:2, 3 : len(A) - (1 if scenario.winch.is_second_order else 0)]
    return np.asarray(expm(A[np.ix_(place, place)] * span))


def rate_jump_std(
    scenario: Scenario, filter: KalmanFilter, *, command_weight: float, speed_weight: float
) -> float:
    """Standard deviation of what the rate of a lag without limits jumps by at a new command [m/s].

    K times the change of the stochastic-optimal command from one step to the next, by the covariance of the
    estimate under it.
    """
    model, q = filter.model, scenario.task.position_weight
    per_step = speed_weight / scenario.control_dt**2
    gain, _ = sampled_gain(model.A, model.B, q, command_weight, speed_weight=per_step)
    innovation = model.C @ filter.prior_covariance @ model.C.T + model.V
    learnt = filter.gain @ innovation @ filter.gain.T
    closed = model.A - model.B @ gain
    estimate = solve_discrete_lyapunov(closed, learnt)
    change = gain @ (closed - np.eye(len(closed)))
    variance = (change @ estimate @ change.T + gain @ learnt @ gain.T).item()
    return float(scenario.winch.rate_constant * math.sqrt(variance))


def plan(
    scenario: Scenario,
    winch: WinchModel,
    *,
    command_weight: float,
    speed_weight: float,
    energy_weight: float,
    straight: bool,
) -> Plan:
    """Condenses the problem of a scenario, the rate of a lag running straight within a step or not."""
    A, B, c, d = planning_model(scenario, winch, straight=straight)
    ramps = straight or winch.parameters.is_second_order
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
    rates = _rates(knots, ramps, n)
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
    fastest, most, least = (float(value) for value in winch.capability())
    spans = np.zeros(0)
    if not winch.accelerates_at_once:
        earlier = np.vstack([np.eye(1, n + n_knots, 3), rates[ends[:-1]]])
        spans = winch.control_dt * np.diff(knots, prepend=0)
        rows.append(rates[ends] - earlier)
        limits.append(min(most, -least) * winch.control_dt * np.diff(knots, prepend=0))
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
        fastest=fastest,
        braking=min(most, -least) * winch.control_dt * knots,
        spans=spans,
        prices=0.5 * energy_weight * np.abs(rates[:, n:]).sum(axis=0),
        ramps=ramps,
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
    winch = found.winch
    straight = winch.ramps and not scenario.winch.is_second_order
    if straight:
        _, most, least = winch.capability()
        jump = rate_jump_std(scenario, found.filter, command_weight=r, speed_weight=speed_weight)
        straight = bool(min(most, -least) * winch.control_dt < RARELY * jump)
    return PredictiveController(
        **without_matrices(name, scenario, found.measures),
        command_weight=r,
        estimator=found,
        plan=plan(
            scenario,
            winch,
            command_weight=r,
            speed_weight=speed_weight,
            energy_weight=energy_weight,
            straight=straight,
        ),
        ahead=carried_sea(scenario, scenario.winch.command_delay),
        arrival_forcing=payload_forcing(scenario, winch.n_delayed),
        speed_weight=speed_weight,
        energy_weight=energy_weight,
    )
