"""The compiled plant: sea, vessel, winch, cable, sensors and task advanced together.

Every face runs the two functions made here: `advance` (one control step of every row) and
`begin` (a new episode of the masked rows). Rows sit in lanes of blocks (see `layout`); each stage is a
loop over the lanes of one block, so a row meets the same operations in the same order whatever the
batch around it. What a scenario does not use is a branch taken once per block and step.

Signs: the public state (channels) is heave positive up; the cable's nodes are positive down.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from heave_env.cable.axial import (
    cable_move,
    cable_solve,
    cable_step,
    cable_tensions,
    hang_still,
    hanging_strain,
    hanging_stretch,
    solved_sheave_tension,
)
from heave_env.compensator import rod_gap, stopped_rod
from heave_env.compiled import source_fingerprint, stage
from heave_env.lanes import block_of_lanes
from heave_env.layout import (
    ACTING_COMMAND,
    BOOM_TIP_BELOW,
    BOOM_TIP_HEAVE,
    BOOM_TIP_HEAVE_RATE,
    BREAKING_STRENGTH,
    CABLE_STIFFNESS,
    CABLE_WEIGHT,
    COMMAND,
    COMMAND_COST,
    COMMAND_RANGE,
    COMMAND_WEIGHT,
    COMPENSATOR_DAMPING,
    COMPENSATOR_DISPLACEMENT,
    COMPENSATOR_MASS,
    COMPENSATOR_OLD,
    COMPENSATOR_RATE,
    DISPLACEMENT,
    DIVERGENCE_LIMIT,
    ELEMENT_STIFFNESS,
    ENERGY_COST,
    ENERGY_WEIGHT,
    FAILURE_COST,
    FAILURE_RATE,
    FIRST_GAP,
    FIRST_TRIAL,
    GAS_FORCE,
    GAS_LENGTH,
    HALF_STROKE,
    INITIAL_LENGTH,
    LANDING_DEPTH,
    LENGTH,
    LENGTH_OLD,
    LENGTH_SPEED,
    LINEAR_INPUT,
    LINEAR_TRANSITION,
    N_CHANNELS,
    N_NODE_FIELDS,
    NEW_BOOM_TIP,
    NEW_BOOM_TIP_RATE,
    OLD_BOOM_TIP,
    OLD_BOOM_TIP_RATE,
    OWN_DELAY,
    PAY_OUT_RAMP,
    PAY_OUT_SPEED,
    PAY_OUT_START,
    PAY_OUT_TIME,
    PAYLOAD_HEAVE,
    PAYLOAD_HEAVE_RATE,
    PAYLOAD_TENSION,
    PAYLOAD_WEIGHT,
    PAYOUT,
    PAYOUT_RATE,
    POSITION_COST,
    POSITION_WEIGHT,
    RETURNED_SHARE,
    SAFETY_COST,
    SATURATED,
    SCRATCH,
    SHEAVE_NEW,
    SHEAVE_OLD,
    SHEAVE_RATE_NEW,
    SHEAVE_RATE_OLD,
    SHEAVE_TENSION,
    SLACK,
    SPEED_LIMIT,
    STEP_MOVED,
    STEP_SUPPLY,
    STEP_WORK,
    STROKE_LIMIT,
    SUPPLY_PER_WORK,
    SUPPLY_POWER,
    TENSION_LIMIT,
    TENSION_MAX,
    TENSION_MIN,
    VELOCITY,
    WINCH_DISPLACEMENT,
    WINCH_OLD,
    WINCH_POWER,
    WINCH_RATE,
    WINCH_RATE_CONSTANT,
    WINCH_RATE_START,
)
from heave_env.sensors import OBSERVATION_BOUND
from heave_env.streams import (
    INITIAL,
    SEA,
    SENSORS,
    cosine_sine_of_turns,
    normal_pair,
    philox,
    uniform,
)
from heave_env.winch import driven_winch_step, free_winch_step, limited_winch_step

# What an episode draws stands in the row itself; what all rows share, in `tables`.

# Kinds of sea, as the kernel knows them.
CALM, FILTERED, SINUSOIDS, RECORDED = 0, 1, 2, 3

# Integer configuration of a plant.
(
    SEA_KIND,
    N_FILTER,
    N_COMPONENTS,
    IS_LINEAR,
    N_ELEMENTS,
    N_SUBSTEPS,
    N_ITERATIONS,
    TENSION_ONLY,
    WINCH_LIMITED,
    WINCH_DRIVEN,
    SECOND_ORDER_WINCH,
    ACCELERATION_LIMITED,
    DELAY_SUBSTEPS,
    N_PENDING,
    N_SENSORS,
    N_LAGS,
    SENSOR_RING,
    SHOWN_FILTER_STATES,
    N_STEPS,
    ROW_FILTER,
    ROW_COMPONENTS,
    ROW_COMMANDS,
    ROW_SENSORS,
    ROW_NODES,
    AT_HERMITE,
    AT_FILTER,
    AT_COMPONENTS,
    AT_SENSORS,
    AT_RECORDING,
    HAS_PAY_OUT,
    BEGINS_COMPENSATED,
    AT_NODE_ROWS,
    SEA_VARIES,
    SENSORS_VARY,
    DELAY_VARIES,
    N_DRAWS,
    ROW_SEA,
    ROW_SENSOR_TABLE,
    ROW_DRAWS,
    SHOWS_DRAWS,
    SENSORS_ERR,
    ROW_SENSOR_STATE,
    AT_SENSOR_ERRORS,
    HAS_COMPENSATOR,
    HOOKEAN,
    CHARGES_ENERGY,
    N_SHOWN_PENDING,
    N_CONFIGURATION,
) = range(48)
# Behind these follow, sensor by sensor, channel row and delay, and then the history lags.

# Whole-number state of a row.
SEED, EPISODE, STEP = 0, 1, 2
N_COUNTERS = 3

# What became of a row in a step.
RUNNING, DIVERGED, LOST, LANDED = 0, 1, 2, 3

_ZERO = np.uint64(0)
_ONE = np.uint64(1)
_SEA, _SENSORS, _INITIAL = np.uint64(SEA), np.uint64(SENSORS), np.uint64(INITIAL)
_NOISE = SCRATCH + 6  # four rows
# Indices of draws, beyond those of a step's noise and of a sea's beginning.
_DROPOUT, _ERRORS = 4096, 1 << 20


# The sea -----------------------------------------------------------------------------------------


@stage
def _draw_four_normals(S, I, row, stream, quad, first_lane, last_lane):
    """Fills four rows from `row` with the standard normal numbers `quad` of this step and stream."""
    real = S.dtype.type
    for lane in range(first_lane, last_lane):
        a, b, c, d = philox(I[SEED, lane], I[EPISODE, lane], stream, I[STEP, lane], np.uint64(quad))
        z0, z1 = normal_pair(a, b)
        z2, z3 = normal_pair(c, d)
        S[row, lane], S[row + 1, lane] = real(z0), real(z1)
        S[row + 2, lane], S[row + 3, lane] = real(z2), real(z3)


@stage
def _filter_output(S, cfg, tables, first_lane, last_lane):
    """Boom-tip heave and rate from the filter's states."""
    real = S.dtype.type
    n, rows = cfg[N_FILTER], cfg[ROW_FILTER]
    output = cfg[AT_FILTER] + 3 * n * n
    for lane in range(first_lane, last_lane):
        S[NEW_BOOM_TIP, lane] = real(0.0)
        S[NEW_BOOM_TIP_RATE, lane] = real(0.0)
    if cfg[SEA_VARIES] == 1:
        own = cfg[ROW_SEA] + 3 * n * n
        for i in range(n):
            for lane in range(first_lane, last_lane):
                S[NEW_BOOM_TIP, lane] += S[own + i, lane] * S[rows + i, lane]
                S[NEW_BOOM_TIP_RATE, lane] += S[own + n + i, lane] * S[rows + i, lane]
        return
    for i in range(n):
        heave, rate = real(tables[output + i]), real(tables[output + n + i])
        for lane in range(first_lane, last_lane):
            S[NEW_BOOM_TIP, lane] += heave * S[rows + i, lane]
            S[NEW_BOOM_TIP_RATE, lane] += rate * S[rows + i, lane]


@stage
def _filter_step(S, I, cfg, tables, n_lanes):
    """Wave and vessel filter over a control step, exact: x <- F x + S z."""
    real = S.dtype.type
    n, rows, at = cfg[N_FILTER], cfg[ROW_FILTER], cfg[AT_FILTER]
    fresh = rows + n
    noise = fresh + n
    for quad in range((n + 3) // 4):
        _draw_four_normals(S, I, noise + 4 * quad, _SEA, quad, 0, n_lanes)
    for i in range(n):
        for lane in range(n_lanes):
            S[fresh + i, lane] = real(0.0)
        if cfg[SEA_VARIES] == 1:
            own = cfg[ROW_SEA] + i * n
            for j in range(n):
                for lane in range(n_lanes):
                    S[fresh + i, lane] += S[own + j, lane] * S[rows + j, lane]
            for j in range(i + 1):
                for lane in range(n_lanes):
                    S[fresh + i, lane] += S[own + n * n + j, lane] * S[noise + j, lane]
        else:
            for j in range(n):
                coefficient = real(tables[at + i * n + j])
                for lane in range(n_lanes):
                    S[fresh + i, lane] += coefficient * S[rows + j, lane]
            for j in range(i + 1):
                coefficient = real(tables[at + n * n + i * n + j])
                for lane in range(n_lanes):
                    S[fresh + i, lane] += coefficient * S[noise + j, lane]
    for i in range(n):
        for lane in range(n_lanes):
            S[rows + i, lane] = S[fresh + i, lane]
    _filter_output(S, cfg, tables, 0, n_lanes)


@stage
def _begin_filter(S, I, cfg, tables, lane):
    """Draws one lane's filter state from the stationary distribution."""
    real = S.dtype.type
    n, rows = cfg[N_FILTER], cfg[ROW_FILTER]
    factor = cfg[AT_FILTER] + 2 * n * n
    noise = rows + 2 * n
    for quad in range((n + 3) // 4):
        _draw_four_normals(S, I, noise + 4 * quad, _INITIAL, quad, lane, lane + 1)
    for i in range(n):
        value = real(0.0)
        for j in range(i + 1):
            at = i * n + j
            shared = real(tables[factor + at]) if cfg[SEA_VARIES] == 0 else real(0.0)
            own = S[cfg[ROW_SEA] + 2 * n * n + at, lane] if cfg[SEA_VARIES] == 1 else real(0.0)
            value += (shared + own) * S[noise + j, lane]
        S[rows + i, lane] = value
    _filter_output(S, cfg, tables, lane, lane + 1)


@stage
def _sum_sinusoids(S, I, cfg, tables, control_dt, ahead, first_lane, last_lane):
    """Boom-tip heave and rate as a sum of sinusoids, `ahead` control steps from the row's own clock."""
    real = S.dtype.type
    n, rows = cfg[N_COMPONENTS], cfg[ROW_COMPONENTS]
    amplitudes = cfg[AT_COMPONENTS] + 2 * n
    two_pi = 2.0 * math.pi
    for lane in range(first_lane, last_lane):
        S[NEW_BOOM_TIP, lane] = real(0.0)
        S[NEW_BOOM_TIP_RATE, lane] = real(0.0)
    varies = cfg[SEA_VARIES] == 1
    for i in range(n):
        shared = 0.0 if varies else tables[amplitudes + i]
        for lane in range(first_lane, last_lane):
            amplitude = np.float64(S[cfg[ROW_SEA] + 2 * n + i, lane]) if varies else shared
            time = (np.float64(np.int64(I[STEP, lane])) + ahead) * control_dt
            frequency = np.float64(S[rows + 2 * i, lane])
            cosine, sine = cosine_sine_of_turns(frequency * time + np.float64(S[rows + 2 * i + 1, lane]))
            S[NEW_BOOM_TIP, lane] += real(amplitude * cosine)
            S[NEW_BOOM_TIP_RATE, lane] -= real(amplitude * two_pi * frequency * sine)


@stage
def _begin_sinusoids(S, I, cfg, tables, lane):
    """Draws one lane's frequencies, each within its bin, and phases."""
    real = S.dtype.type
    n, rows, at, own = cfg[N_COMPONENTS], cfg[ROW_COMPONENTS], cfg[AT_COMPONENTS], cfg[ROW_SEA]
    varies = cfg[SEA_VARIES] == 1
    for i in range(n):
        a, b, _, _ = philox(I[SEED, lane], I[EPISODE, lane], _INITIAL, _ZERO, np.uint64(i))
        low = np.float64(S[own + i, lane]) if varies else tables[at + i]
        width = np.float64(S[own + n + i, lane]) if varies else tables[at + n + i]
        omega = low + width * uniform(a)
        S[rows + 2 * i, lane] = real(omega / (2.0 * math.pi))
        S[rows + 2 * i + 1, lane] = real(uniform(b))


@stage
def _boom_tip_at_substep(S, I, cfg, tables, substep, n_lanes):
    """Sheave heave and rate at the end of a solver step, positive up, and the recording's pay-out.

    Between control instants the boom tip is the cubic through its heave and rate at both.
    """
    real = S.dtype.type
    if cfg[SEA_KIND] == RECORDED:
        for lane in range(n_lanes):
            sample = min(np.int64(I[STEP, lane]), cfg[N_STEPS] - 1) * cfg[N_SUBSTEPS] + substep + 1
            at = cfg[AT_RECORDING] + 3 * sample
            S[SHEAVE_NEW, lane] = real(tables[at])
            S[SHEAVE_RATE_NEW, lane] = real(tables[at + 1])
    else:
        at = cfg[AT_HERMITE] + 8 * substep
        a, b, c, d = real(tables[at]), real(tables[at + 1]), real(tables[at + 2]), real(tables[at + 3])
        e, f, g, h = real(tables[at + 4]), real(tables[at + 5]), real(tables[at + 6]), real(tables[at + 7])
        for lane in range(n_lanes):
            x0, v0 = S[OLD_BOOM_TIP, lane], S[OLD_BOOM_TIP_RATE, lane]
            x1, v1 = S[NEW_BOOM_TIP, lane], S[NEW_BOOM_TIP_RATE, lane]
            S[SHEAVE_NEW, lane] = a * x0 + b * v0 + c * x1 + d * v1
            S[SHEAVE_RATE_NEW, lane] = e * x0 + f * v0 + g * x1 + h * v1


# The plant ---------------------------------------------------------------------------------------


@stage
def _time_at_speed(time, running, ramp):
    """Distance over speed of a pay-out from time 0, `running` s long, its speed averaged over `ramp`."""
    now = min(max(time, 0.0), running)
    if ramp > 0.0:
        # The integral of the unramped profile, over the window of the ramp.
        past = min(max(time - ramp, 0.0), running)
        whole = 0.5 * now * now + running * max(time - running, 0.0)
        whole -= 0.5 * past * past + running * max(time - ramp - running, 0.0)
        now = whole / ramp
    return now


@stage
def _pay_out_over_substep(S, I, cfg, tables, substep, control_dt, n_lanes):
    """Cable that the operation pays out in a solver step, and in all."""
    real = S.dtype.type
    dt = control_dt / cfg[N_SUBSTEPS]
    if cfg[SEA_KIND] == RECORDED:
        for lane in range(n_lanes):
            sample = min(np.int64(I[STEP, lane]), cfg[N_STEPS] - 1) * cfg[N_SUBSTEPS] + substep + 1
            at = cfg[AT_RECORDING] + 3 * sample + 2
            S[PAYOUT_RATE, lane] = real((tables[at] - tables[at - 3]) / dt)
            S[PAYOUT, lane] = real(tables[at])
    elif cfg[HAS_PAY_OUT] == 1:
        for lane in range(n_lanes):
            speed = np.float64(S[PAY_OUT_SPEED, lane])
            running, ramp = np.float64(S[PAY_OUT_TIME, lane]), np.float64(S[PAY_OUT_RAMP, lane])
            time = np.float64(np.int64(I[STEP, lane])) * control_dt + substep * dt
            time -= np.float64(S[PAY_OUT_START, lane])
            old, new = _time_at_speed(time, running, ramp), _time_at_speed(time + dt, running, ramp)
            S[PAYOUT_RATE, lane] = real(speed * (new - old) / dt)
            S[PAYOUT, lane] = real(speed * new)


@stage
def _rod_trial(S, cfg, at, dt, n_lanes):
    """Solves the cable with the sheave where the rods' trial ends put it, positive down."""
    for lane in range(n_lanes):
        S[SHEAVE_NEW, lane] = S[BOOM_TIP_BELOW, lane] - S[COMPENSATOR_DISPLACEMENT, lane]
    tension_only, hookean = cfg[TENSION_ONLY] == 1, cfg[HOOKEAN] == 1
    cable_solve(S, at, cfg[N_ELEMENTS], cfg[N_ITERATIONS], n_lanes, dt, tension_only, hookean)


@stage
def _solve_with_rod(S, cfg, at, dt, n_lanes):
    """Cable and passive compensator over a solver step, solved together by the secant method.

    The cable's tension is all but linear in where the rod ends, so that three solves of the cable do: two
    to find the secant, one at its root; a cable that may be slack or hardens gets two more. On return the
    sheave's rows hold the rod's motion too.
    """
    real = S.dtype.type
    zero, two = real(0.0), real(2.0)
    n, tension_only = cfg[N_ELEMENTS], cfg[TENSION_ONLY] == 1
    step = real(dt)
    for lane in range(n_lanes):
        old = S[COMPENSATOR_DISPLACEMENT, lane]
        S[COMPENSATOR_OLD, lane] = old
        S[BOOM_TIP_BELOW, lane] = S[SHEAVE_NEW, lane]
        S[SHEAVE_OLD, lane] -= old
        S[COMPENSATOR_DISPLACEMENT, lane] = old + step * S[COMPENSATOR_RATE, lane]
    _rod_trial(S, cfg, at, dt, n_lanes)
    for lane in range(n_lanes):
        rod = S[COMPENSATOR_DISPLACEMENT, lane]
        gap = rod_gap(S, lane, rod, solved_sheave_tension(S, at, n, lane, tension_only), dt)
        S[FIRST_TRIAL, lane], S[FIRST_GAP, lane] = rod, gap
        # A first slope that errs to the stiff side: rod, gas and the cable's uppermost element.
        stiff = S[COMPENSATOR_DAMPING, lane] / step + two * S[COMPENSATOR_MASS, lane] / (step * step)
        stiff += S[GAS_FORCE, lane] / S[GAS_LENGTH, lane] + S[at[0] + ELEMENT_STIFFNESS, lane]
        S[COMPENSATOR_DISPLACEMENT, lane] = rod - gap / max(stiff, real(1.0))
    n_trials = 4 if tension_only or cfg[HOOKEAN] == 0 else 2
    for trial in range(n_trials):
        _rod_trial(S, cfg, at, dt, n_lanes)
        for lane in range(n_lanes):
            rod = S[COMPENSATOR_DISPLACEMENT, lane]
            gap = rod_gap(S, lane, rod, solved_sheave_tension(S, at, n, lane, tension_only), dt)
            moved, lessened = rod - S[FIRST_TRIAL, lane], gap - S[FIRST_GAP, lane]
            S[FIRST_TRIAL, lane], S[FIRST_GAP, lane] = rod, gap
            better = rod - gap * moved / lessened if lessened != zero else rod
            if trial + 1 < n_trials:
                S[COMPENSATOR_DISPLACEMENT, lane] = better
            else:
                S[COMPENSATOR_DISPLACEMENT, lane] = stopped_rod(S, lane, better)
    _rod_trial(S, cfg, at, dt, n_lanes)
    for lane in range(n_lanes):
        rod, old = S[COMPENSATOR_DISPLACEMENT, lane], S[COMPENSATOR_OLD, lane]
        at_stop = abs(rod) >= S[HALF_STROKE, lane]
        rate = two * (rod - old) / step - S[COMPENSATOR_RATE, lane]
        # Without mass the midpoint's rates would ring about the mean, which means nothing then.
        rate = rate if S[COMPENSATOR_MASS, lane] > zero else (rod - old) / step
        S[COMPENSATOR_RATE, lane] = zero if at_stop else rate


@stage
def _cable_substep(S, cfg, dt, n_lanes):
    """The finite-difference cable over a solver step, with the winch's work on it."""
    real = S.dtype.type
    per_dt = real(1.0 / dt)
    n, at = cfg[N_ELEMENTS], cfg[cfg[AT_NODE_ROWS] :]
    tension_only, hookean = cfg[TENSION_ONLY] == 1, cfg[HOOKEAN] == 1
    for lane in range(n_lanes):
        hauled = S[WINCH_DISPLACEMENT, lane] - S[WINCH_OLD, lane]
        S[LENGTH_OLD, lane] = S[LENGTH, lane]
        S[LENGTH_SPEED, lane] = S[PAYOUT_RATE, lane] - hauled * per_dt
        S[LENGTH, lane] = S[INITIAL_LENGTH, lane] + S[PAYOUT, lane] - S[WINCH_DISPLACEMENT, lane]
        # The cable's own signs are positive down.
        S[SHEAVE_OLD, lane] = -S[SHEAVE_OLD, lane]
        S[SHEAVE_NEW, lane] = -S[SHEAVE_NEW, lane]
    if cfg[HAS_COMPENSATOR] == 1:
        _solve_with_rod(S, cfg, at, dt, n_lanes)
        cable_move(S, at, n, n_lanes, tension_only, hookean)
    else:
        cable_step(S, at, n, cfg[N_ITERATIONS], n_lanes, dt, tension_only, hookean)
    cable_tensions(S, at, n, n_lanes, tension_only)
    for lane in range(n_lanes):
        hauled = S[WINCH_DISPLACEMENT, lane] - S[WINCH_OLD, lane]
        work = S[SHEAVE_TENSION, lane] * hauled
        share = S[SUPPLY_PER_WORK, lane] if work > real(0.0) else S[RETURNED_SHARE, lane]
        S[STEP_WORK, lane] += work
        S[STEP_MOVED, lane] += abs(work)
        S[STEP_SUPPLY, lane] += work * share
        if cfg[HAS_COMPENSATOR] == 1:
            S[SHEAVE_NEW, lane] = S[BOOM_TIP_BELOW, lane]
        S[SHEAVE_OLD, lane] = -S[SHEAVE_OLD, lane]
        S[SHEAVE_NEW, lane] = -S[SHEAVE_NEW, lane]


@stage
def _linear_substep(S, n_lanes):
    """a x'' + b x' + x = x0 + u over a solver step, exact for the cubic through the ends of x0 + u."""
    m, g = LINEAR_TRANSITION, LINEAR_INPUT
    for lane in range(n_lanes):
        x, v = S[PAYLOAD_HEAVE, lane], S[PAYLOAD_HEAVE_RATE, lane]
        z0 = S[SHEAVE_OLD, lane] + S[WINCH_OLD, lane]
        r0 = S[SHEAVE_RATE_OLD, lane] + S[WINCH_RATE_START, lane]
        z1 = S[SHEAVE_NEW, lane] + S[WINCH_DISPLACEMENT, lane]
        r1 = S[SHEAVE_RATE_NEW, lane] + S[WINCH_RATE, lane]
        forced = S[g, lane] * z0 + S[g + 1, lane] * r0 + S[g + 2, lane] * z1 + S[g + 3, lane] * r1
        forced_rate = S[g + 4, lane] * z0 + S[g + 5, lane] * r0 + S[g + 6, lane] * z1 + S[g + 7, lane] * r1
        S[PAYLOAD_HEAVE, lane] = S[m, lane] * x + S[m + 1, lane] * v + forced
        S[PAYLOAD_HEAVE_RATE, lane] = S[m + 2, lane] * x + S[m + 3, lane] * v + forced_rate
        S[STEP_MOVED, lane] += abs(S[WINCH_DISPLACEMENT, lane] - S[WINCH_OLD, lane])


@stage
def _show_cable(S, cfg, first_lane, last_lane):
    """Payload heave about its still-water position below the reference length, and its rate."""
    real = S.dtype.type
    half, one = real(0.5), real(1.0)
    bottom = cfg[ROW_NODES] + N_NODE_FIELDS * cfg[N_ELEMENTS]
    for lane in range(first_lane, last_lane):
        reference = S[INITIAL_LENGTH, lane] + S[PAYOUT, lane]
        w1, w2, EA = S[CABLE_WEIGHT, lane], S[PAYLOAD_WEIGHT, lane], S[CABLE_STIFFNESS, lane]
        stretch = reference * (w2 + half * w1 * reference) / EA
        lengthening = one + (w2 + w1 * reference) / EA
        if cfg[HOOKEAN] == 0:
            stretch = hanging_stretch(S, lane, cfg[N_ELEMENTS], reference)
            lengthening = one + hanging_strain(S, lane, w2 + w1 * reference)
        S[PAYLOAD_HEAVE, lane] = S[WINCH_DISPLACEMENT, lane] + stretch - S[bottom + DISPLACEMENT, lane]
        S[PAYLOAD_HEAVE_RATE, lane] = S[PAYOUT_RATE, lane] * lengthening - S[bottom + VELOCITY, lane]


@stage
def _late_commands(S, cfg, position, substep, n_substeps, commands, n_lanes):
    """The command that acts on each row's winch in a solver step, each with its own delay."""
    for lane in range(n_lanes):
        given = (substep - np.int64(S[OWN_DELAY, lane])) // n_substeps
        S[ACTING_COMMAND, lane] = S[cfg[ROW_COMMANDS] + (position + given) % commands, lane]


# Sensors and task --------------------------------------------------------------------------------


@stage
def _distorted(S, cfg, tables, s, lane, truth):
    """What a sensor makes of a true value before noise: high-pass, scale error, bias.

    The high-pass is the trapezoidal state-variable form, which keeps its accuracy when its corner is slow.
    """
    real = S.dtype.type
    two = real(2.0)
    at, own = cfg[AT_SENSOR_ERRORS] + 6 * s, cfg[ROW_SENSOR_STATE] + 5 * s
    g = real(tables[at + 4])
    if g > real(0.0):
        damping = real(tables[at + 5])
        first, second = S[own + 3, lane], S[own + 4, lane]
        high = (truth - (two * damping + g) * first - second) / (real(1.0) + g * (two * damping + g))
        band = g * high + first
        S[own + 3, lane] = g * high + band
        S[own + 4, lane] = two * g * band + second
        truth = high
    return truth * (real(1.0) + S[own, lane]) + S[own + 1, lane]


@stage
def _held(S, I, cfg, tables, s, lane, value):
    """The reading that stands: the new one, or the last where none is due or it was lost."""
    at, own = cfg[AT_SENSOR_ERRORS] + 6 * s, cfg[ROW_SENSOR_STATE] + 5 * s
    step = np.int64(I[STEP, lane])
    every, dropout = np.int64(tables[at + 2]), tables[at + 3]
    lost = step % every != 0
    if dropout > 0.0 and not lost and step > 0:
        word, _, _, _ = philox(
            I[SEED, lane], I[EPISODE, lane], _SENSORS, I[STEP, lane], np.uint64(_DROPOUT + s)
        )
        lost = uniform(word) < dropout
    if not lost:
        S[own + 2, lane] = value
    return S[own + 2, lane]


@stage
def _begin_sensors(S, I, cfg, tables, lane):
    """Draws one lane's scale errors and biases and empties its heave filters."""
    real = S.dtype.type
    for s in range(cfg[N_SENSORS]):
        at, own = cfg[AT_SENSOR_ERRORS] + 6 * s, cfg[ROW_SENSOR_STATE] + 5 * s
        a, b, _, _ = philox(I[SEED, lane], I[EPISODE, lane], _INITIAL, _ZERO, np.uint64(_ERRORS + s))
        z0, z1 = normal_pair(a, b)
        S[own, lane] = real(tables[at] * z0)
        S[own + 1, lane] = real(tables[at + 1] * z1)
        S[own + 3, lane] = S[own + 4, lane] = real(0.0)


@stage
def _measure(S, I, cfg, tables, position, first_lane, last_lane):
    """Writes this instant's samples, noisy, scaled and clipped, into their place in the sensor ring."""
    real = S.dtype.type
    n = cfg[N_SENSORS]
    bound = real(OBSERVATION_BOUND)
    place = cfg[ROW_SENSORS] + (position % cfg[SENSOR_RING]) * n
    for quad in range((n + 3) // 4):
        _draw_four_normals(S, I, _NOISE, _SENSORS, quad, first_lane, last_lane)
        for s in range(4 * quad, min(4 * quad + 4, n)):
            at = cfg[AT_SENSORS] + 3 * s
            noise, offset, per_scale = real(tables[at]), real(tables[at + 1]), real(tables[at + 2])
            channel = cfg[N_CONFIGURATION + 2 * s]
            own = cfg[ROW_SENSOR_TABLE] + 3 * s
            for lane in range(first_lane, last_lane):
                if cfg[SENSORS_VARY] == 1:
                    noise, offset, per_scale = S[own, lane], S[own + 1, lane], S[own + 2, lane]
                truth = S[channel, lane]
                if cfg[SENSORS_ERR] == 1:
                    truth = _distorted(S, cfg, tables, s, lane, truth)
                value = (truth + noise * S[_NOISE + s - 4 * quad, lane] - offset) * per_scale
                value = value if value > -bound else -bound
                value = value if value < bound else bound
                if cfg[SENSORS_ERR] == 1:
                    value = _held(S, I, cfg, tables, s, lane, value)
                S[place + s, lane] = value


@stage
def _observe(S, cfg, position, block, n_envs, observation, first_lane, last_lane):
    """Lays out the observation: lag by lag the sensors, then filter states, then pending commands."""
    n, n_lags, ring = cfg[N_SENSORS], cfg[N_LAGS], cfg[SENSOR_RING]
    n_lanes = S.shape[1]
    for lane in range(first_lane, last_lane):
        row = block * n_lanes + lane
        if row >= n_envs:
            continue
        column = 0
        for i in range(n_lags):
            lag = cfg[N_CONFIGURATION + 2 * n + i]
            for s in range(n):
                age = lag + cfg[N_CONFIGURATION + 2 * s + 1]
                place = cfg[ROW_SENSORS] + ((position - age) % ring) * n + s
                observation[row, column] = S[place, lane]
                column += 1
        for i in range(cfg[SHOWN_FILTER_STATES]):
            observation[row, column] = S[cfg[ROW_FILTER] + i, lane]
            column += 1
        for i in range(cfg[SHOWS_DRAWS] * cfg[N_DRAWS]):
            observation[row, column] = S[cfg[ROW_DRAWS] + i, lane]
            column += 1
        commands = cfg[N_PENDING] + 1
        for i in range(cfg[N_SHOWN_PENDING]):
            place = cfg[ROW_COMMANDS] + (position - 1 - i) % commands
            observation[row, column] = S[place, lane] / S[COMMAND_RANGE, lane]
            column += 1


@stage
def _charge(S, I, cfg, block, n_envs, reward, outcome, n_lanes):
    """Stage cost, safety cost and what became of each row; a diverged row shows zeros, never NaN."""
    real = S.dtype.type
    zero, one = real(0.0), real(1.0)
    cable = cfg[IS_LINEAR] == 0
    bottom = cfg[ROW_NODES] + N_NODE_FIELDS * cfg[N_ELEMENTS]
    for lane in range(n_lanes):
        x, v, u0 = S[PAYLOAD_HEAVE, lane], S[PAYLOAD_HEAVE_RATE, lane], S[COMMAND, lane]
        limit = S[DIVERGENCE_LIMIT, lane]
        fate = RUNNING
        # Not (a < b) rather than a >= b: a NaN must count as diverged.
        if not (abs(x) < limit) or not (abs(v) < limit):
            fate = DIVERGED
        elif cable and not (S[TENSION_MAX, lane] < S[BREAKING_STRENGTH, lane]):
            fate = LOST
        elif cable and S[LENGTH, lane] + S[bottom + DISPLACEMENT, lane] >= S[LANDING_DEPTH, lane]:
            fate = LANDED
        if fate == DIVERGED:
            for channel in range(N_CHANNELS):
                if not (abs(S[channel, lane]) < real(1e30)):
                    S[channel, lane] = zero
            # The failure is charged below; a displacement without meaning is not.
            S[PAYLOAD_HEAVE, lane] = S[PAYLOAD_HEAVE_RATE, lane] = x = zero
        unsafe = S[SLACK, lane] if cable else zero
        unsafe += one if (cable and S[TENSION_MAX, lane] > S[TENSION_LIMIT, lane]) else zero
        unsafe += one if abs(S[WINCH_DISPLACEMENT, lane]) >= S[STROKE_LIMIT, lane] else zero
        remaining = real(max(cfg[N_STEPS] - np.int64(I[STEP, lane]) - 1, 0))
        failed = fate in (DIVERGED, LOST)
        S[POSITION_COST, lane] = S[POSITION_WEIGHT, lane] * x * x
        S[COMMAND_COST, lane] = S[COMMAND_WEIGHT, lane] * u0 * u0
        S[FAILURE_COST, lane] = S[FAILURE_RATE, lane] * remaining if failed else zero
        if cfg[CHARGES_ENERGY] == 1:
            moved = zero if fate == DIVERGED else S[STEP_MOVED, lane]
            S[ENERGY_COST, lane] = S[ENERGY_WEIGHT, lane] * moved
        S[SAFETY_COST, lane] = unsafe
        row = block * n_lanes + lane
        if row < n_envs:
            total = S[POSITION_COST, lane] + S[COMMAND_COST, lane] + S[FAILURE_COST, lane]
            if cfg[CHARGES_ENERGY] == 1:
                total += S[ENERGY_COST, lane]
            reward[row] = -np.float64(total)
            outcome[row] = fate


@stage
def _show(S, block, n_envs, channels, first_lane, last_lane):
    """Copies the channels out, environment by environment."""
    n_lanes = S.shape[1]
    for lane in range(first_lane, last_lane):
        row = block * n_lanes + lane
        if row < n_envs:
            for channel in range(N_CHANNELS):
                channels[row, channel] = S[channel, lane]


# The two faces of the kernel ---------------------------------------------------------------------


def _make(n_lanes: int, fingerprint: int):
    """The kernel for blocks of `n_lanes` environments."""

    @njit(cache=True, nogil=True, error_model="numpy")
    def advance(
        state, counters, cfg, tables, control_dt, position, actions, observation, reward, outcome, channels,
        first_block, last_block,
    ):  # fmt: skip
        """Advances every row of the blocks by one control step, under the given actions.

        Args:
            state: Real state, (n_blocks, n_rows, n_lanes).
            counters: Seed, episode and step of the rows, (n_blocks, 3, n_lanes), uint64.
            cfg: Integer configuration.
            tables: Constants of sea and sensors, float64.
            control_dt: Control step [s].
            position: Control steps that the batch has made: where the rings stand.
            actions: Fractions of the command range, (n_envs,).
            observation: Filled, (n_envs, n_observations), float32.
            reward: Filled, (n_envs,).
            outcome: Filled with RUNNING, DIVERGED, LOST or LANDED, (n_envs,).
            channels: Filled, (n_envs, N_CHANNELS), unless it has no rows.
            first_block: First block to advance.
            last_block: The block to stop before.
        """
        if fingerprint == 0:
            return
        real = state.dtype.type
        zero, one = real(0.0), real(1.0)
        n_envs = len(actions)
        n_substeps = cfg[N_SUBSTEPS]
        dt = control_dt / n_substeps
        commands = cfg[N_PENDING] + 1
        # One lane is a constant to the compiler; sixteen are a number of the run, or else it would unroll
        # the small loops over lanes before it makes vector operations of them.
        lanes = 1 if n_lanes == 1 else state.shape[2]
        for block in range(first_block, last_block):
            S, I = block_of_lanes(state[block], n_lanes), counters[block]
            newest = cfg[ROW_COMMANDS] + position % commands
            for lane in range(n_lanes):
                row = block * n_lanes + lane
                action = real(actions[row]) if row < n_envs else zero
                clipped = min(max(action, -one), one)
                S[SATURATED, lane] = one if abs(action) >= one else zero
                S[COMMAND, lane] = clipped * S[COMMAND_RANGE, lane]
                S[newest, lane] = S[COMMAND, lane]
                S[OLD_BOOM_TIP, lane] = S[BOOM_TIP_HEAVE, lane]
                S[OLD_BOOM_TIP_RATE, lane] = S[BOOM_TIP_HEAVE_RATE, lane]
                S[SHEAVE_NEW, lane] = S[BOOM_TIP_HEAVE, lane]
                S[SHEAVE_RATE_NEW, lane] = S[BOOM_TIP_HEAVE_RATE, lane]
                S[TENSION_MIN, lane], S[TENSION_MAX, lane] = real(np.inf), real(-np.inf)
                S[STEP_WORK, lane] = zero
                S[STEP_SUPPLY, lane] = zero
                S[STEP_MOVED, lane] = zero
            if cfg[SEA_KIND] == FILTERED:
                _filter_step(S, I, cfg, tables, n_lanes)
            elif cfg[SEA_KIND] == SINUSOIDS:
                _sum_sinusoids(S, I, cfg, tables, control_dt, 1.0, 0, n_lanes)
            for substep in range(n_substeps):
                for lane in range(n_lanes):
                    S[SHEAVE_OLD, lane] = S[SHEAVE_NEW, lane]
                    S[SHEAVE_RATE_OLD, lane] = S[SHEAVE_RATE_NEW, lane]
                _boom_tip_at_substep(S, I, cfg, tables, substep, n_lanes)
                _pay_out_over_substep(S, I, cfg, tables, substep, control_dt, n_lanes)
                given = (substep - cfg[DELAY_SUBSTEPS]) // n_substeps
                acting = cfg[ROW_COMMANDS] + (position + given) % commands
                if cfg[DELAY_VARIES] == 1:
                    acting = ACTING_COMMAND
                    _late_commands(S, cfg, position, substep, n_substeps, commands, n_lanes)
                if cfg[WINCH_DRIVEN] == 1:
                    at_once = cfg[ACCELERATION_LIMITED] == 0
                    driven_winch_step(S, acting, n_lanes, dt, cfg[SECOND_ORDER_WINCH] == 1, at_once)
                elif cfg[WINCH_LIMITED] == 1:
                    limited_winch_step(S, acting, n_lanes, dt, cfg[ACCELERATION_LIMITED] == 0)
                else:
                    free_winch_step(S, acting, n_lanes)
                if cfg[IS_LINEAR] == 1:
                    _linear_substep(S, n_lanes)
                else:
                    _cable_substep(S, cfg, dt, lanes)
            per_step = real(1.0 / control_dt)
            for lane in range(n_lanes):
                S[BOOM_TIP_HEAVE, lane] = S[SHEAVE_NEW, lane]
                S[BOOM_TIP_HEAVE_RATE, lane] = S[SHEAVE_RATE_NEW, lane]
                S[WINCH_POWER, lane] = S[STEP_WORK, lane] * per_step
                S[SUPPLY_POWER, lane] = S[STEP_SUPPLY, lane] * per_step
            if cfg[IS_LINEAR] == 0:
                _show_cable(S, cfg, 0, n_lanes)
            _charge(S, I, cfg, block, n_envs, reward, outcome, n_lanes)
            for lane in range(n_lanes):
                I[STEP, lane] += _ONE
            _measure(S, I, cfg, tables, position + 1, 0, n_lanes)
            _observe(S, cfg, position + 1, block, n_envs, observation, 0, n_lanes)
            if len(channels) > 0:
                _show(S, block, n_envs, channels, 0, n_lanes)

    @njit(cache=True, nogil=True, error_model="numpy")
    def begin(state, counters, cfg, tables, control_dt, position, mask, observation, channels):
        """Begins a new episode in the masked rows: the sea stationary, cable and payload hanging still,
        the winch at rest or in the middle of compensating.

        The seeds and episodes must stand in `counters`; `position` is where the rings stand now.
        """
        if fingerprint == 0:
            return
        real = state.dtype.type
        zero = real(0.0)
        n_envs = len(mask)
        # Lanes beyond the last environment run along, so they need a state too.
        for row in range(state.shape[0] * n_lanes):
            if row < n_envs and not mask[row]:
                continue
            block, lane = row // n_lanes, row % n_lanes
            S, I = block_of_lanes(state[block], n_lanes), counters[block]
            I[STEP, lane] = _ZERO
            for channel in range(N_CHANNELS):
                S[channel, lane] = zero
            S[NEW_BOOM_TIP, lane] = zero
            S[NEW_BOOM_TIP_RATE, lane] = zero
            if cfg[SEA_KIND] == FILTERED:
                _begin_filter(S, I, cfg, tables, lane)
            elif cfg[SEA_KIND] == SINUSOIDS:
                _begin_sinusoids(S, I, cfg, tables, lane)
                _sum_sinusoids(S, I, cfg, tables, control_dt, 0.0, lane, lane + 1)
            elif cfg[SEA_KIND] == RECORDED:
                S[NEW_BOOM_TIP, lane] = real(tables[cfg[AT_RECORDING]])
                S[NEW_BOOM_TIP_RATE, lane] = real(tables[cfg[AT_RECORDING] + 1])
            S[BOOM_TIP_HEAVE, lane] = S[NEW_BOOM_TIP, lane]
            S[BOOM_TIP_HEAVE_RATE, lane] = S[NEW_BOOM_TIP_RATE, lane]
            S[PAYOUT_RATE, lane] = zero
            command = zero
            if cfg[BEGINS_COMPENSATED] == 1:
                reach = min(S[STROKE_LIMIT, lane], S[COMMAND_RANGE, lane])
                fastest, most = S[SPEED_LIMIT, lane], S[COMMAND_RANGE, lane]
                S[WINCH_DISPLACEMENT, lane] = max(min(-S[BOOM_TIP_HEAVE, lane], reach), -reach)
                S[WINCH_RATE, lane] = max(min(-S[BOOM_TIP_HEAVE_RATE, lane], fastest), -fastest)
                # The command that gives the lag this rate, as if it had been given all along.
                wanted = S[WINCH_DISPLACEMENT, lane] + S[WINCH_RATE, lane] / S[WINCH_RATE_CONSTANT, lane]
                command = max(min(wanted, most), -most)
            if cfg[IS_LINEAR] == 1:
                S[PAYLOAD_HEAVE, lane] = S[BOOM_TIP_HEAVE, lane] + S[WINCH_DISPLACEMENT, lane]
            else:
                S[LENGTH, lane] = S[INITIAL_LENGTH, lane] - S[WINCH_DISPLACEMENT, lane]
                hookean = cfg[HOOKEAN] == 1
                hang_still(S, lane, cfg[ROW_NODES], cfg[N_ELEMENTS], -S[BOOM_TIP_HEAVE, lane], hookean)
                _show_cable(S, cfg, lane, lane + 1)
                S[SHEAVE_TENSION, lane] = S[PAYLOAD_WEIGHT, lane] + S[CABLE_WEIGHT, lane] * S[LENGTH, lane]
                S[PAYLOAD_TENSION, lane] = S[PAYLOAD_WEIGHT, lane]
                S[TENSION_MIN, lane] = S[PAYLOAD_TENSION, lane]
                S[TENSION_MAX, lane] = S[SHEAVE_TENSION, lane]
            for i in range(cfg[N_PENDING] + 1):
                S[cfg[ROW_COMMANDS] + i, lane] = command
            if cfg[SENSORS_ERR] == 1:
                _begin_sensors(S, I, cfg, tables, lane)
            # Before the episode the sensors are taken to have read what they read now.
            _measure(S, I, cfg, tables, position, lane, lane + 1)
            n = cfg[N_SENSORS]
            now = cfg[ROW_SENSORS] + (position % cfg[SENSOR_RING]) * n
            for past in range(cfg[SENSOR_RING]):
                for s in range(n):
                    S[cfg[ROW_SENSORS] + past * n + s, lane] = S[now + s, lane]
            _observe(S, cfg, position, block, n_envs, observation, lane, lane + 1)
            if len(channels) > 0:
                _show(S, block, n_envs, channels, lane, lane + 1)

    return advance, begin


KERNELS = {n_lanes: _make(n_lanes, source_fingerprint()) for n_lanes in (1, 16)}
"""`advance` and `begin` by lanes per block: one for single environments, sixteen for batches."""
