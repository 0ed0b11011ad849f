"""The winch as a controller reckons it: the plant's own lag within its limits, for a batch of rows.

    u' = K (u0(t - delay) - u),   |u'| <= speed limit,   |u''| <= acceleration limit,   |u| <= stroke limit

A designed controller knows its commands, so it knows where the drum is even while a limit bites, which a
linear model does not. And it can ask the other question: which command makes the drum do what is wanted of it
over a control step. Inverting the lag alone, u0 = u + u'/K, wastes a tenth of the acceleration and more, for
a held command lets the drum slow down between two solver steps.

The equations are those of the plant's winch, solver step by solver step, so that both stay together to
rounding. Source: Huang (1992), (6.1) and (6.12).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from baselines.model import payload_model
from heave_env.parameters import LinearPayload
from heave_env.plant import linear_step
from heave_env.scenarios import Scenario
from heave_env.sea import Array

N_CORRECTIONS = 3
"""Rounds in which a command is found for a wanted rate [-]; each wins a factor K dt, forty or so."""


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
    def ramps(self) -> bool:
        """Whether the rate cannot jump: there is an acceleration limit."""
        return math.isfinite(self.acceleration_limit)

    @property
    def is_limited(self) -> bool:
        """Whether there is any limit but the command's range."""
        return any(map(math.isfinite, (self.speed_limit, self.acceleration_limit, self.stroke_limit)))

    def step(self, u: Array, v: Array, u0: Array) -> tuple[Array, Array, Array]:
        """Displacement, its rate at the start and at the end of a solver step under a command, (n_rows,)."""
        K, dt = self.rate_constant, self.dt
        if not self.is_limited:
            gap = (u0 - u) * self.decay
            return u0 - gap, K * (u0 - u), K * gap
        fastest = self.speed_limit
        if self.ramps:
            most = self.acceleration_limit * dt
            wanted = np.clip(K * self.decay * (u0 - u), -fastest, fastest)
            start, end = v, v + np.clip(wanted - v, -most, most)
            new = u + 0.5 * dt * (start + end)
        else:
            way, direction = np.abs(u0 - u), np.sign(u0 - u)
            start = direction * np.minimum(K * way, fastest)
            if math.isfinite(fastest):
                # At full speed down to the gap from which the lag asks for less, then along the lag.
                full = np.clip((way - fastest / K) / fastest, 0.0, dt)
                left = (way - fastest * full) * np.exp(-K * np.where(full < dt, dt - full, 0.0))
            else:
                left = way * self.decay
            end = direction * np.minimum(K * left, fastest)
            new = u0 - direction * left
        kept = np.clip(new, -self.stroke_limit, self.stroke_limit)
        return kept, start, np.where(kept == new, end, 0.0)

    def path(
        self, u: Array, v: Array, commands: Array, *, first: int, count: int
    ) -> tuple[Array, Array, Array]:
        """The drum over some solver steps from a control instant.

        Args:
            u: Displacement at the instant [m], (n_rows,).
            v: Its rate [m/s], (n_rows,).
            commands: The command of this control step and those before, newest first [m],
                (n_rows, 1 + n_pending); the newest is not looked at while older ones are still acting.
            first: Solver steps between the instant and the first of these.
            count: Solver steps to take.

        Returns:
            Displacement and rate at the end, and the path as the payload meets it: displacement and rate at
            the start and the end of each solver step, (n_rows, 4 count).
        """
        path = np.empty((len(u), 4 * count))
        for i in range(count):
            acting = (first + i - self.n_delayed) // self.n_substeps
            new, start, end = self.step(u, v, commands[:, -acting])
            path[:, 4 * i], path[:, 4 * i + 1] = u, start
            path[:, 4 * i + 2], path[:, 4 * i + 3] = new, end
            u, v = new, end
        return u, v, path

    def command_for_rate(self, u: Array, v: Array, rate: Array) -> Array:
        """Command that, held over a control step, ends it at a rate, or as near to it as the limits let it.

        Args:
            u: Displacement when the command arrives [m], (n_rows,).
            v: Its rate then [m/s], (n_rows,).
            rate: Wanted at the end of the control step [m/s], (n_rows,).

        Returns:
            Commands within the range [m], (n_rows,).
        """
        per_rate = 1.0 / (self.rate_constant * self.decay)
        most = self.acceleration_limit * self.dt
        u0 = u + per_rate * rate
        for _ in range(N_CORRECTIONS):
            at, speed = u, v
            low, high = np.full(len(u), -np.inf), np.full(len(u), np.inf)
            for i in range(self.n_substeps):
                u0_now = at + per_rate * rate
                # What this solver step leaves to do must be within reach of those that follow.
                slack = per_rate * (self.n_substeps - 1 - i) * most
                low, high = np.maximum(low, u0_now - slack), np.minimum(high, u0_now + slack)
                at, _, speed = self.step(at, speed, u0)
            # The last step asks for the rate itself; where an earlier one asks for more, it is at its limit.
            u0 = np.where(low > u0_now, low, np.where(high < u0_now, high, u0_now))
        return np.asarray(np.clip(u0, -self.command_range, self.command_range))

    def command_for_displacement(self, u: Array, displacement: Array) -> Array:
        """Command that, held over a control step, moves a drum without acceleration limit to a displacement.

        Args:
            u: Displacement when the command arrives [m], (n_rows,).
            displacement: Wanted at the end of the control step [m], (n_rows,).

        Returns:
            Commands within the range [m], (n_rows,); full speed where the wanted is out of reach.
        """
        K, fastest, span = self.rate_constant, self.speed_limit, self.control_dt
        way, direction = np.abs(displacement - u), np.sign(displacement - u)
        gap = way / -math.expm1(-K * span)
        if math.isfinite(fastest):
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
