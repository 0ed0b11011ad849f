"""The winch as a controller reckons it: the plant's own drum within its limits, for a batch of rows.

    u' = K (u0(t - delay) - u),   |u'| <= speed limit,   |u''| <= acceleration limit,   |u| <= stroke limit

or a second-order drive u'' + 2 ζ ω u' + ω² u = ω² u0(t - delay) within the same limits; either with limits of
power and torque, which depend on the tension at the sheave, with a dead band, and with rounded commands. The
tension is what the controller believes it to be: measured, or that of the cable hanging still.

A designed controller knows its commands, so it knows where the drum is even while a limit bites, which a
linear model does not. And it can ask the other question: which command makes the drum do what is wanted of it
over a control step. Inverting the lag alone, u0 = u + u'/K, wastes a tenth of the acceleration and more, for
a held command lets the drum slow down between two solver steps. Dead band and rounding can be inverted up to
a point (`shaped`): a drum that rests while |u0 - u| is no larger than its dead band is sent farther, so that
it comes to rest where it is wanted, and of the round commands the one is given whose end is nearest.

The equations are those of the plant's winch, solver step by solver step, so that both stay together to
rounding. Source: Huang (1992), (6.1), (6.12) and 6.5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numba import njit

from baselines.model import payload_model
from heave_env.parameters import LinearPayload, Winch
from heave_env.plant import drive_step, linear_step
from heave_env.scenarios import Scenario
from heave_env.sea import Array

N_CORRECTIONS = 3
"""Rounds in which a command is found for a wanted rate [-]; each wins a factor K dt, forty or so."""

Drum = tuple[float, float, float, float, float, float, bool, bool]
"""A lag within limits as the compiled functions take it: rate constant, decay, solver step, largest speed,
its largest change in a solver step, stroke, whether there are limits, and whether the rate cannot jump."""

LEAST_MOVE = 1.001
"""Dead bands that a command is sent away from the drum to move it at all [-]."""


@dataclass(frozen=True)
class WinchModel:
    """Drum of a scenario; displacement and rate are arrays (n_rows,)."""

    rate_constant: float
    """K [1/s]."""
    dt: float
    """Solver step [s]."""
    n_substeps: int
    """Solver steps in a control step [-]."""
    n_delayed: int
    """Solver steps between command and winch [-]."""
    speed_limit: float
    """[m/s]; infinite without one."""
    acceleration_limit: float
    """[m/s²]; infinite without one."""
    stroke_limit: float
    """[m]; infinite without one."""
    command_range: float
    """Largest |u0| [m]."""
    parameters: Winch
    """All numbers of the winch."""
    static_tension: float = 0.0
    """Sheave tension of the cable hanging still [N], where none is measured."""

    @cached_property
    def decay(self) -> float:
        """What is left of a gap after a solver step, exp(-K dt) [-]."""
        return math.exp(-self.rate_constant * self.dt)

    @property
    def control_dt(self) -> float:
        """Control step [s]."""
        return self.dt * self.n_substeps

    @property
    def n_pending(self) -> int:
        """Commands given but not fully arrived at a control instant [-]."""
        return -(-self.n_delayed // self.n_substeps)

    @property
    def accelerates_at_once(self) -> bool:
        """Whether nothing limits the acceleration."""
        return not math.isfinite(self.acceleration_limit) and self.parameters.torque_limit is None

    @property
    def ramps(self) -> bool:
        """Whether the rate cannot jump: the drive is of the second order, or its acceleration limited."""
        return self.parameters.is_second_order or not self.accelerates_at_once

    @property
    def is_limited(self) -> bool:
        """Whether there is any limit but the command's range, dead band and rounding included."""
        return self.parameters.is_limited

    @property
    def feels_tension(self) -> bool:
        """Whether what it can do depends on the tension."""
        return self.parameters.power_limit is not None or self.parameters.torque_limit is not None

    @property
    def is_uneven(self) -> bool:
        """Whether a dead band or rounding stands between command and drive."""
        return self.parameters.dead_band > 0.0 or self.parameters.command_step > 0.0

    @cached_property
    def is_plain(self) -> bool:
        """Whether it is a lag within limits of speed, acceleration and stroke, and no more."""
        return not (self.parameters.is_driven or self.parameters.is_second_order)

    @cached_property
    def _plain(self) -> Drum:
        """What the compiled functions take of such a winch."""
        return (
            self.rate_constant,
            self.decay,
            self.dt,
            self.speed_limit,
            self.acceleration_limit * self.dt,
            self.stroke_limit,
            self.is_limited,
            self.ramps,
        )

    @cached_property
    def even(self) -> WinchModel:
        """The same winch without dead band and rounding."""
        return replace(self, parameters=replace(self.parameters, dead_band=0.0, command_step=0.0))

    @cached_property
    def transition(self) -> Array:
        """Of a second-order drive's [u - u0, u'] over a solver step, (2, 2)."""
        return drive_step(self.parameters, self.dt)

    @cached_property
    def control_transition(self) -> Array:
        """The same over a control step."""
        return drive_step(self.parameters, self.control_dt)

    def capability(self, tension: Array | None = None) -> tuple[Array | float, Array | float, Array | float]:
        """Largest speed [m/s], largest and least acceleration [m/s²] at a tension.

        Args:
            tension: At the sheave [N], (n_rows,); that of the cable hanging still if not given.

        Returns:
            (n_rows,) each, or numbers where the tension does not matter.
        """
        winch = self.parameters
        T = self.static_tension if tension is None else tension
        fastest: Array | float = self.speed_limit
        most: Array | float = self.acceleration_limit
        least: Array | float = -self.acceleration_limit
        if winch.power_limit is not None:
            fastest = np.minimum(fastest, winch.power_limit / np.maximum(np.abs(T), 1e-9))
        if winch.torque_limit is not None:
            assert winch.drum_radius is not None and winch.drum_inertia is not None
            per_inertia, load = winch.drum_radius / winch.drum_inertia, np.asarray(T) * winch.drum_radius
            most = np.minimum(most, (winch.torque_limit - load) * per_inertia)
            least = np.maximum(least, (-winch.torque_limit - load) * per_inertia)
            least = np.minimum(least, most)
        return fastest, most, least

    def step(self, u: Array, v: Array, u0: Array, tension: Array | None = None) -> tuple[Array, Array, Array]:
        """Displacement, its rate at the start and at the end of a solver step under a command, (n_rows,).

        Args:
            u: Displacement [m], (n_rows,).
            v: Its rate [m/s], (n_rows,).
            u0: The command that acts [m], (n_rows,).
            tension: At the sheave [N], (n_rows,); that of the cable hanging still if not given.
        """
        if self.is_plain:
            n = len(u)
            return _plain_steps(_floats(u, n), _floats(v, n), _floats(u0, n), self._plain)
        return self._driven_step(u, v, u0, tension)

    def _driven_step(
        self, u: Array, v: Array, u0: Array, tension: Array | None
    ) -> tuple[Array, Array, Array]:
        """The same of a second-order drive, and of any with more than limits of stroke, speed and
        acceleration."""
        winch, K, dt = self.parameters, self.rate_constant, self.dt
        if winch.command_step > 0.0:
            u0 = winch.command_step * np.floor(u0 / winch.command_step + 0.5)
        if winch.dead_band > 0.0:
            u0 = np.where(np.abs(u0 - u) <= winch.dead_band, u, u0)
        error = u - u0
        if winch.is_second_order:
            R, start = self.transition, v
            free = u0 + R[0, 0] * error + R[0, 1] * v
            wanted = R[1, 0] * error + R[1, 1] * v
        else:
            gap = error * self.decay
            free, wanted = u0 + gap, -K * gap
            start = -K * error if self.accelerates_at_once else v
        fastest, most, least = self.capability(tension)
        if self.accelerates_at_once:
            start = np.clip(start, -fastest, fastest)
        end = np.clip(wanted, -fastest, fastest)
        if not self.accelerates_at_once:
            end = start + np.maximum(np.minimum((end - start) / dt, most), least) * dt
        trapezoid = u + 0.5 * dt * (start + end)
        if winch.is_second_order or self.accelerates_at_once:
            bitten = np.abs(end - wanted) > 1e-9 * (1.0 + np.abs(wanted))
            trapezoid = np.where(bitten, trapezoid, free)
        kept = np.clip(trapezoid, -self.stroke_limit, self.stroke_limit)
        return kept, start, np.where(kept == trapezoid, end, 0.0)

    def path(
        self,
        u: Array,
        v: Array,
        commands: Array,
        *,
        first: int,
        count: int,
        tension: Array | None = None,
    ) -> tuple[Array, Array, Array]:
        """The drum over some solver steps from a control instant.

        Args:
            u: Displacement at the instant [m], (n_rows,).
            v: Its rate [m/s], (n_rows,).
            commands: The command of this control step and those before, newest first [m],
                (n_rows, 1 + n_pending); the newest is not looked at while older ones are still acting.
            first: Solver steps between the instant and the first of these.
            count: Solver steps to take.
            tension: At the sheave all the while [N], (n_rows,); that of the cable hanging still if not given.

        Returns:
            Displacement and rate at the end, and the path as the payload meets it: displacement and rate at
            the start and the end of each solver step, (n_rows, 4 count).
        """
        if self.is_plain:
            n = len(u)
            steps = (first, count, self.n_delayed, self.n_substeps)
            return _plain_path(_floats(u, n), _floats(v, n), _floats(commands), self._plain, steps)
        path = np.empty((len(u), 4 * count))
        for i in range(count):
            acting = (first + i - self.n_delayed) // self.n_substeps
            new, start, end = self.step(u, v, commands[:, -acting], tension)
            path[:, 4 * i], path[:, 4 * i + 1] = u, start
            path[:, 4 * i + 2], path[:, 4 * i + 3] = new, end
            u, v = new, end
        return u, v, path

    def command_for_rate(self, u: Array, v: Array, rate: Array, tension: Array | None = None) -> Array:
        """Command that, held over a control step, ends it at a rate, or as near to it as the limits let it.

        Args:
            u: Displacement when the command arrives [m], (n_rows,).
            v: Its rate then [m/s], (n_rows,).
            rate: Wanted at the end of the control step [m/s], (n_rows,).
            tension: At the sheave [N], (n_rows,); that of the cable hanging still if not given.

        Returns:
            Commands within the range [m], (n_rows,), of a winch without dead band and rounding.
        """
        if self.is_uneven:
            return self.even.command_for_rate(u, v, rate, tension)
        if self.parameters.is_second_order:
            return self._drive_for_rate(u, v, rate, tension)
        if self.is_plain:
            n = len(u)
            given = (_floats(u, n), _floats(v, n), _floats(rate, n))
            return _plain_command(*given, self._plain, self.n_substeps, self.command_range)
        per_rate = 1.0 / (self.rate_constant * self.decay)
        _, up, down = self.capability(tension)
        most = np.where(rate > v, up, np.negative(down)) * self.dt
        u0 = u + per_rate * rate
        for _ in range(N_CORRECTIONS):
            at, speed = u, v
            low, high = np.full(len(u), -np.inf), np.full(len(u), np.inf)
            for i in range(self.n_substeps):
                u0_now = at + per_rate * rate
                # What this solver step leaves to do must be within reach of those that follow.
                slack = per_rate * (self.n_substeps - 1 - i) * most
                low, high = np.maximum(low, u0_now - slack), np.minimum(high, u0_now + slack)
                at, _, speed = self.step(at, speed, u0, tension)
            # The last step asks for the rate itself; where an earlier one asks for more, it is at its limit.
            u0 = np.where(low > u0_now, low, np.where(high < u0_now, high, u0_now))
        return np.asarray(np.clip(u0, -self.command_range, self.command_range))

    def _drive_for_rate(self, u: Array, v: Array, rate: Array, tension: Array | None) -> Array:
        """The same of a second-order drive: inverted as if free, and corrected by what its limits leave."""
        R = self.control_transition
        u0 = u + (R[1, 1] * v - rate) / R[1, 0]
        for _ in range(N_CORRECTIONS if self.is_limited else 0):
            at, speed = u, v
            for _ in range(self.n_substeps):
                at, _, speed = self.step(at, speed, u0, tension)
            u0 = u0 - (rate - speed) / R[1, 0]
        return np.asarray(np.clip(u0, -self.command_range, self.command_range))

    def shaped(self, u: Array, v: Array, command: Array, tension: Array | None = None) -> Array:
        """The command that does, through dead band and rounding, most nearly what another would do without.

        Args:
            u: Displacement when the command arrives [m], (n_rows,).
            v: Its rate then [m/s], (n_rows,).
            command: Meant for the winch without dead band and rounding, within its range [m], (n_rows,).
            tension: At the sheave [N], (n_rows,); that of the cable hanging still if not given.

        Returns:
            Commands within the range [m], (n_rows,), whole multiples of `command_step` if there is one; the
            same command if there is neither rounding nor dead band.
        """
        if not self.is_uneven:
            return command
        wanted, rate = self._held(u, v, command, self.even, tension)
        band, quantum = self.parameters.dead_band, self.parameters.command_step
        tried = [command]
        if band > 0.0:
            # Beside it: to rest; the least that moves it, with a margin for single precision; to where the
            # dead band begins beyond the wanted end; and what takes a lag there in so many solver steps, so
            # that it then rests.
            way = wanted - u
            tried += [u, u + np.sign(way) * LEAST_MOVE * band, wanted + np.sign(way) * band]
            if not self.parameters.is_second_order:
                tried += [u + way / (1.0 - self.decay**n) for n in range(1, self.n_substeps)]
        if quantum > 0.0:
            tried = [quantum * whole(one / quantum) for one in tried for whole in (np.floor, np.ceil)]
            within = quantum * math.floor(self.command_range / quantum)
            tried = [np.clip(one, -within, within) for one in tried]
        best = np.asarray(np.clip(tried[0], -self.command_range, self.command_range))
        least = np.full(len(u), np.inf)
        for one in tried:
            given = np.clip(one, -self.command_range, self.command_range)
            at, speed = self._held(u, v, given, self, tension)
            miss = np.abs(at - wanted)
            if self.ramps:
                miss = miss + self.control_dt * np.abs(speed - rate)
            best, least = np.where(miss < least, given, best), np.minimum(miss, least)
        return best

    def _held(
        self, u: Array, v: Array, command: Array, winch: WinchModel, tension: Array | None
    ) -> tuple[Array, Array]:
        """Displacement and rate of a winch that has held a command for a control step, (n_rows,) each."""
        for _ in range(self.n_substeps):
            u, _, v = winch.step(u, v, command, tension)
        return u, v

    def command_for_displacement(self, u: Array, displacement: Array, tension: Array | None = None) -> Array:
        """Command that, held over a control step, moves a drum without acceleration limit to a displacement.

        Args:
            u: Displacement when the command arrives [m], (n_rows,).
            displacement: Wanted at the end of the control step [m], (n_rows,).
            tension: At the sheave [N], (n_rows,); that of the cable hanging still if not given.

        Returns:
            Commands within the range [m], (n_rows,), of a winch without dead band and rounding; full speed
            where the wanted is out of reach.
        """
        K, span = self.rate_constant, self.control_dt
        fastest = self.capability(tension)[0]
        way, direction = np.abs(displacement - u), np.sign(displacement - u)
        gap = way / -math.expm1(-K * span)
        if np.all(np.isfinite(fastest)):
            # Faster than the limit at first: full speed for a time, and the lag for the rest of the step.
            # way = fastest t + (fastest / K) (1 - exp(-K (span - t))), whose t a few Newton steps find.
            t = np.zeros(len(u))
            for _ in range(N_CORRECTIONS):
                rest = np.exp(-K * (span - t))
                t = np.clip(
                    t + (way / fastest - t - (1.0 - rest) / K) / np.maximum(1.0 - rest, 1e-3), 0.0, span
                )
            gap = np.where(K * gap > fastest, fastest * t + fastest / K, gap)
        return np.asarray(np.clip(u + direction * gap, -self.command_range, self.command_range))


# A lag within limits of speed, acceleration and stroke, compiled ---------------------------------------
#
# A designed controller takes a dozen of these steps for each decision, and a controller that does so for one
# row at a time spends most of its time in them.


def _floats(values: Array | float, n: int | None = None) -> Array:
    """Values as the compiled functions take them, for `n` rows."""
    found = np.ascontiguousarray(values, dtype=float)
    return found if n is None or found.shape == (n,) else np.full(n, found)


@njit(cache=True, error_model="numpy")
def _within(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


@njit(cache=True, error_model="numpy")
def _plain_step(u: float, v: float, u0: float, drum: Drum) -> tuple[float, float, float]:
    """Displacement, its rate at the start and at the end of a solver step."""
    K, decay, dt, fastest, most, stroke, limited, ramps = drum
    if not limited:
        gap = (u0 - u) * decay
        return u0 - gap, K * (u0 - u), K * gap
    if ramps:
        wanted = _within(K * decay * (u0 - u), fastest)
        start, end = v, v + _within(wanted - v, most)
        new = u + 0.5 * dt * (start + end)
    else:
        way, direction = abs(u0 - u), np.sign(u0 - u)
        start = direction * min(K * way, fastest)
        if fastest < np.inf:
            # At full speed down to the gap from which the lag asks for less, then along the lag.
            full = min(max((way - fastest / K) / fastest, 0.0), dt)
            left = (way - fastest * full) * np.exp(-K * (dt - full))
        else:
            left = way * decay
        end = direction * min(K * left, fastest)
        new = u0 - direction * left
    kept = _within(new, stroke)
    return kept, start, end if kept == new else 0.0


@njit(cache=True, error_model="numpy")
def _plain_steps(u: Array, v: Array, u0: Array, drum: Drum) -> tuple[Array, Array, Array]:
    """The same row by row, (n_rows,) each."""
    new, start, end = np.empty_like(u), np.empty_like(u), np.empty_like(u)
    for row in range(len(u)):
        new[row], start[row], end[row] = _plain_step(u[row], v[row], u0[row], drum)
    return new, start, end


@njit(cache=True, error_model="numpy")
def _plain_path(
    u: Array, v: Array, commands: Array, drum: Drum, steps: tuple[int, int, int, int]
) -> tuple[Array, Array, Array]:
    """`WinchModel.path`; `steps` holds first, count, n_delayed and n_substeps."""
    first, count, n_delayed, n_substeps = steps
    path = np.empty((len(u), 4 * count))
    at, speed = u.copy(), v.copy()
    for row in range(len(u)):
        for i in range(count):
            acting = (first + i - n_delayed) // n_substeps
            new, start, end = _plain_step(at[row], speed[row], commands[row, -acting], drum)
            path[row, 4 * i], path[row, 4 * i + 1] = at[row], start
            path[row, 4 * i + 2], path[row, 4 * i + 3] = new, end
            at[row], speed[row] = new, end
    return at, speed, path


@njit(cache=True, error_model="numpy")
def _plain_command(
    u: Array, v: Array, rate: Array, drum: Drum, n_substeps: int, command_range: float
) -> Array:
    """`WinchModel.command_for_rate`."""
    K, decay, most = drum[0], drum[1], drum[4]
    per_rate = 1.0 / (K * decay)
    command = np.empty_like(u)
    for row in range(len(u)):
        u0 = u[row] + per_rate * rate[row]
        for _ in range(N_CORRECTIONS):
            at, speed = u[row], v[row]
            low, high, u0_now = -np.inf, np.inf, u0
            for i in range(n_substeps):
                u0_now = at + per_rate * rate[row]
                slack = per_rate * (n_substeps - 1 - i) * most
                low, high = max(low, u0_now - slack), min(high, u0_now + slack)
                at, _, speed = _plain_step(at, speed, u0, drum)
            u0 = low if low > u0_now else (high if high < u0_now else u0_now)
        command[row] = _within(u0, command_range)
    return command


def winch_model(scenario: Scenario) -> WinchModel:
    """The drum of a scenario."""
    winch = scenario.winch

    def limit(value: float | None) -> float:
        return math.inf if value is None else value

    return WinchModel(
        rate_constant=winch.rate_constant,
        dt=scenario.solver_dt,
        n_substeps=scenario.n_substeps,
        n_delayed=scenario.delay_substeps,
        speed_limit=limit(winch.speed_limit),
        acceleration_limit=limit(winch.acceleration_limit),
        stroke_limit=limit(winch.stroke_limit),
        command_range=winch.command_range,
        parameters=winch,
        static_tension=scenario.static_tension,
    )


def payload_forcing(scenario: Scenario, count: int, payload: LinearPayload | None = None) -> Array:
    """What a path of the drum over `count` solver steps adds to payload heave and rate, (4 count, 2).

    Of the scenario's own payload model unless another is given.
    """
    transition, forcing = linear_step(payload or payload_model(scenario), scenario.solver_dt)
    parts: list[Array] = []
    for _ in range(count):
        parts = [transition @ part for part in parts] + [forcing]
    return np.vstack([part.T for part in parts]) if parts else np.zeros((0, 2))
