"""The winch drum behind a delayed command: a lag or a second-order drive, within its limits.

u' = K (u0 - u), or u'' + 2 ζ ω u' + ω² u = ω² u0, with the command u0 constant within a solver step.
Source: Huang (1992), (6.1) and 6.5.
"""

from __future__ import annotations

import math

import numpy as np

from heave_env.compiled import stage
from heave_env.layout import (
    ACCELERATION_LIMIT,
    COMMAND_STEP,
    DEAD_BAND,
    DRUM_INERTIA,
    DRUM_RADIUS,
    POWER_LIMIT,
    SATURATED,
    SHEAVE_TENSION,
    SPEED_LIMIT,
    STROKE_LIMIT,
    TORQUE_LIMIT,
    WINCH_DECAY,
    WINCH_DISPLACEMENT,
    WINCH_OLD,
    WINCH_RATE,
    WINCH_RATE_CONSTANT,
    WINCH_RATE_START,
    WINCH_TRANSITION,
)


@stage
def free_winch_step(S, command_row, n_lanes):
    """Exact lag without limits. Leaves the one-sided rates at both ends of the step."""
    for lane in range(n_lanes):
        K, u, u0 = S[WINCH_RATE_CONSTANT, lane], S[WINCH_DISPLACEMENT, lane], S[command_row, lane]
        gap = (u0 - u) * S[WINCH_DECAY, lane]
        S[WINCH_OLD, lane] = u
        S[WINCH_RATE_START, lane] = K * (u0 - u)
        S[WINCH_DISPLACEMENT, lane] = u0 - gap
        S[WINCH_RATE, lane] = K * gap


@stage
def _end_of_step(S, lane, new, start_rate, end_rate, saturated):
    """Leaves the drum where it came to, stopped dead at the end of its stroke, and the rates at both ends."""
    real = S.dtype.type
    stroke = S[STROKE_LIMIT, lane]
    stopped = abs(new) > stroke
    S[WINCH_OLD, lane] = S[WINCH_DISPLACEMENT, lane]
    S[WINCH_RATE_START, lane] = start_rate
    S[WINCH_DISPLACEMENT, lane] = max(min(new, stroke), -stroke)
    S[WINCH_RATE, lane] = real(0.0) if stopped else end_rate
    if saturated or stopped:
        S[SATURATED, lane] = real(1.0)


@stage
def limited_winch_step(S, command_row, n_lanes, dt, accelerates_at_once):
    """The lag within its limits; absent limits are infinite.

    Without an acceleration limit the step is exact: at the speed limit while the lag wants more, then
    the lag. With one, the speed moves towards what the lag wants at the step's end as fast as it may,
    and the displacement is the trapezoid below it. The stroke stops the drum dead.
    """
    real = S.dtype.type
    zero, one, half = real(0.0), real(1.0), real(0.5)
    for lane in range(n_lanes):
        K, u, u0 = S[WINCH_RATE_CONSTANT, lane], S[WINCH_DISPLACEMENT, lane], S[command_row, lane]
        fastest = S[SPEED_LIMIT, lane]
        decay = S[WINCH_DECAY, lane]
        wanted = K * (u0 - u)
        saturated = abs(wanted) > fastest
        if accelerates_at_once:
            gap = abs(u0 - u)
            direction = one if u0 > u else -one
            ramp = fastest * real(dt)
            linear_gap = gap - fastest / K
            start = min(abs(wanted), fastest)
            if linear_gap <= zero:
                gap = gap * decay
            elif linear_gap >= ramp:
                gap = gap - ramp
            else:
                gap = fastest / K * real(math.exp(-K * (real(dt) - linear_gap / fastest)))
            end_rate = direction * min(K * gap, fastest)
            start_rate = direction * start
            new = u0 - direction * gap
        else:
            start_rate = S[WINCH_RATE, lane]
            wanted = max(min(wanted * decay, fastest), -fastest)
            most = S[ACCELERATION_LIMIT, lane] * real(dt)
            change = wanted - start_rate
            saturated = saturated or abs(change) > most
            end_rate = start_rate + max(min(change, most), -most)
            new = u + half * real(dt) * (start_rate + end_rate)
        _end_of_step(S, lane, new, start_rate, end_rate, saturated)


@stage
def driven_winch_step(S, command_row, n_lanes, dt, is_second_order, accelerates_at_once):
    """Lag or second-order drive within every limit; absent limits are infinite.

    Where nothing bites the step is exact. Else the speed moves towards what the drive wants at the step's
    end as far as speed, power, acceleration and torque let it, and the displacement is the trapezoid below
    it. With radius r and inertia J of the drum, the torque T r + J u''/r bounds the acceleration by
    (±torque - T r) r / J. The tension T is that of the solver step before.
    """
    real = S.dtype.type
    zero, one, half, tiny = real(0.0), real(1.0), real(0.5), real(1e-9)
    per_dt = one / real(dt)
    for lane in range(n_lanes):
        u, u0 = S[WINCH_DISPLACEMENT, lane], S[command_row, lane]
        quantum, fastest = S[COMMAND_STEP, lane], S[SPEED_LIMIT, lane]
        if quantum > zero:
            u0 = quantum * real(np.floor(u0 / quantum + half))
        if abs(u0 - u) <= S[DEAD_BAND, lane]:
            u0 = u
        error = u - u0
        if is_second_order:
            start_rate = S[WINCH_RATE, lane]
            m = WINCH_TRANSITION
            free = u0 + S[m, lane] * error + S[m + 1, lane] * start_rate
            wanted = S[m + 2, lane] * error + S[m + 3, lane] * start_rate
        else:
            K = S[WINCH_RATE_CONSTANT, lane]
            gap = error * S[WINCH_DECAY, lane]
            free, wanted = u0 + gap, -K * gap
            start_rate = -K * error if accelerates_at_once else S[WINCH_RATE, lane]
        tension = S[SHEAVE_TENSION, lane]
        fastest = min(fastest, S[POWER_LIMIT, lane] / max(abs(tension), tiny))
        radius = S[DRUM_RADIUS, lane]
        per_inertia = radius / S[DRUM_INERTIA, lane]
        most = min(S[ACCELERATION_LIMIT, lane], (S[TORQUE_LIMIT, lane] - tension * radius) * per_inertia)
        least = max(-S[ACCELERATION_LIMIT, lane], (-S[TORQUE_LIMIT, lane] - tension * radius) * per_inertia)
        least = min(least, most)
        if accelerates_at_once:
            start_rate = max(min(start_rate, fastest), -fastest)
        end_rate = max(min(wanted, fastest), -fastest)
        acceleration = max(min((end_rate - start_rate) * per_dt, most), least)
        end_rate = start_rate + acceleration * real(dt)
        bitten = abs(end_rate - wanted) > tiny * (one + abs(wanted))
        lagging = not (is_second_order or accelerates_at_once)
        new = u + half * real(dt) * (start_rate + end_rate) if bitten or lagging else free
        _end_of_step(S, lane, new, start_rate, end_rate, bitten)
