"""The winch drum: first-order lag behind a delayed command, within stroke, speed and acceleration.

u' = K (u0 - u), with the command u0 constant within a solver step. Source: Huang (1992), (6.1).
"""

from __future__ import annotations

import math

from heave_env.compiled import stage
from heave_env.layout import (
    ACCELERATION_LIMIT,
    SATURATED,
    SPEED_LIMIT,
    STROKE_LIMIT,
    WINCH_DECAY,
    WINCH_DISPLACEMENT,
    WINCH_OLD,
    WINCH_RATE,
    WINCH_RATE_CONSTANT,
    WINCH_RATE_START,
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
        fastest, stroke = S[SPEED_LIMIT, lane], S[STROKE_LIMIT, lane]
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
        stopped = abs(new) > stroke
        new = max(min(new, stroke), -stroke)
        S[WINCH_OLD, lane] = u
        S[WINCH_RATE_START, lane] = start_rate
        S[WINCH_DISPLACEMENT, lane] = new
        S[WINCH_RATE, lane] = zero if stopped else end_rate
        if saturated or stopped:
            S[SATURATED, lane] = one
