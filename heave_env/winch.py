"""The winch drum behind a delayed command: a lag or a second-order drive, within its limits.

u' = K (u0 - u), or u'' + 2 ζ ω u' + ω² u = ω² u0, with the command u0 constant within a solver step.
Source: Huang (1992), (6.1) and 6.5.
"""

from __future__ import annotations

import math

from heave_env.compiled import stage
from heave_env.lanes import (
    absolute,
    any_of,
    constant,
    floor,
    fused,
    lane_of,
    maximum,
    minimum,
    n_lanes_of,
    negated,
    where,
)
from heave_env.layout import (
    ACCELERATION_LIMIT,
    COMMAND_STEP,
    DEAD_BAND,
    DRUM_INERTIA,
    DRUM_RADIUS,
    LINEAR_GAP,
    POWER_LIMIT,
    SATURATED,
    SHEAVE_TENSION,
    SPEED_LIMIT,
    STROKE_LIMIT,
    TORQUE_LIMIT,
    WINCH_DECAY,
    WINCH_DISPLACEMENT,
    WINCH_GAP,
    WINCH_OLD,
    WINCH_RATE,
    WINCH_RATE_CONSTANT,
    WINCH_RATE_START,
    WINCH_TRANSITION,
)


@stage
def free_winch_step(S, W, command):
    """Exact lag without limits. Leaves the one-sided rates at both ends of the step."""
    K, u = S[WINCH_RATE_CONSTANT], S[WINCH_DISPLACEMENT]
    error = command - u
    gap = error * S[WINCH_DECAY]
    W[WINCH_OLD] = u
    W[WINCH_RATE_START] = K * error
    S[WINCH_DISPLACEMENT] = command - gap
    S[WINCH_RATE] = K * gap


@stage
def _end_of_step(S, W, new, start_rate, end_rate, saturated):
    """Leaves the drum where it came to, stopped dead at the end of its stroke, and the rates at both ends."""
    stroke = S[STROKE_LIMIT]
    stopped = absolute(new) > stroke
    W[WINCH_OLD] = S[WINCH_DISPLACEMENT]
    W[WINCH_RATE_START] = start_rate
    S[WINCH_DISPLACEMENT] = maximum(minimum(new, stroke), -stroke)
    S[WINCH_RATE] = where(stopped, constant(S, 0.0), end_rate)
    S[SATURATED] = where(saturated | stopped, constant(S, 1.0), S[SATURATED])


@stage
def _gap_behind_a_ramp(S, W, dt):
    """Gap left where the drum goes at the speed limit first and lags then; of one lane."""
    K, fastest = S[WINCH_RATE_CONSTANT], S[SPEED_LIMIT]
    step, linear_gap = constant(S, dt), W[LINEAR_GAP]
    if linear_gap > constant(S, 0.0) and linear_gap < fastest * step:
        lagging = step - linear_gap / fastest
        W[WINCH_GAP] = fastest / K * constant(S, math.exp(-K * lagging))


@stage
def limited_winch_step(S, W, command, dt, accelerates_at_once):
    """The lag within its limits; absent limits are infinite.

    Without an acceleration limit the step is exact: at the speed limit while the lag wants more, then
    the lag. With one, the speed moves towards what the lag wants at the step's end as fast as it may,
    and the displacement is the trapezoid below it. The stroke stops the drum dead.
    """
    zero, one, half, step = constant(S, 0.0), constant(S, 1.0), constant(S, 0.5), constant(S, dt)
    K, u, fastest, decay = S[WINCH_RATE_CONSTANT], S[WINCH_DISPLACEMENT], S[SPEED_LIMIT], S[WINCH_DECAY]
    wanted = K * (command - u)
    saturated = absolute(wanted) > fastest
    if accelerates_at_once:
        gap = absolute(command - u)
        direction = where(command > u, one, -one)
        ramp = fastest * step
        linear_gap = gap - fastest / K
        start = minimum(absolute(wanted), fastest)
        lags, keeps_on = linear_gap <= zero, linear_gap >= ramp
        W[WINCH_GAP] = where(lags, gap * decay, gap - ramp)
        if any_of(negated(lags | keeps_on)):
            W[LINEAR_GAP] = linear_gap
            for lane in range(n_lanes_of(S)):
                _gap_behind_a_ramp(lane_of(S, lane), lane_of(W, lane), dt)
        gap = W[WINCH_GAP]
        start_rate = direction * start
        end_rate = direction * minimum(K * gap, fastest)
        new = command - direction * gap
    else:
        start_rate = S[WINCH_RATE]
        wanted = maximum(minimum(wanted * decay, fastest), -fastest)
        most = S[ACCELERATION_LIMIT] * step
        change = wanted - start_rate
        saturated = saturated | (absolute(change) > most)
        end_rate = start_rate + maximum(minimum(change, most), -most)
        new = u + half * step * (start_rate + end_rate)
    _end_of_step(S, W, new, start_rate, end_rate, saturated)


@stage
def driven_winch_step(S, W, command, dt, is_second_order, accelerates_at_once):
    """Lag or second-order drive within every limit; absent limits are infinite.

    Where nothing bites the step is exact. Else the speed moves towards what the drive wants at the step's
    end as far as speed, power, acceleration and torque let it, and the displacement is the trapezoid below
    it. With radius r and inertia J of the drum, the torque T r + J u''/r bounds the acceleration by
    (±torque - T r) r / J. The tension T is that of the solver step before.
    """
    zero, one, half, tiny = constant(S, 0.0), constant(S, 1.0), constant(S, 0.5), constant(S, 1e-9)
    step = constant(S, dt)
    per_dt = one / step
    u, quantum, fastest = S[WINCH_DISPLACEMENT], S[COMMAND_STEP], S[SPEED_LIMIT]
    u0 = where(quantum > zero, quantum * floor(command / quantum + half), command)
    u0 = where(absolute(u0 - u) <= S[DEAD_BAND], u, u0)
    error = u - u0
    if is_second_order:
        m, start_rate = WINCH_TRANSITION, S[WINCH_RATE]
        free = fused(S[m], error, fused(S[m + 1], start_rate, u0))
        wanted = fused(S[m + 2], error, S[m + 3] * start_rate)
    else:
        K, gap = S[WINCH_RATE_CONSTANT], error * S[WINCH_DECAY]
        free, wanted = u0 + gap, -K * gap
        start_rate = -K * error if accelerates_at_once else S[WINCH_RATE]
    tension = S[SHEAVE_TENSION]
    fastest = minimum(fastest, S[POWER_LIMIT] / maximum(absolute(tension), tiny))
    radius, acceleration_limit, torque_limit = S[DRUM_RADIUS], S[ACCELERATION_LIMIT], S[TORQUE_LIMIT]
    per_inertia = radius / S[DRUM_INERTIA]
    most = minimum(acceleration_limit, (torque_limit - tension * radius) * per_inertia)
    least = maximum(-acceleration_limit, (-torque_limit - tension * radius) * per_inertia)
    least = minimum(least, most)
    if accelerates_at_once:
        start_rate = maximum(minimum(start_rate, fastest), -fastest)
    end_rate = maximum(minimum(wanted, fastest), -fastest)
    acceleration = maximum(minimum((end_rate - start_rate) * per_dt, most), least)
    end_rate = start_rate + acceleration * step
    bitten = absolute(end_rate - wanted) > tiny * (one + absolute(wanted))
    trapezoid = u + half * step * (start_rate + end_rate)
    new = where(bitten, trapezoid, free)
    if not (is_second_order or accelerates_at_once):
        new = trapezoid
    _end_of_step(S, W, new, start_rate, end_rate, bitten)
