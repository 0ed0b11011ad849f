"""The compiled plant: sea, vessel, winch, cable, sensors and task advanced together.

Every face runs the two functions made here: `advance` (one control step of every row) and
`begin` (a new episode of the masked rows). Rows sit in lanes of blocks (see `layout` and `lanes`); each
stage computes with all lanes of one block at once, or with one, so a row meets the same operations in the
same order whatever the batch around it. In the stages S is the block's state, I its counters, W the scratch
block that all share. What a scenario does not use is a branch taken once per block and step.

Signs: the public state (channels) is heave positive up; the cable's nodes are positive down.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numba.extending import overload

from heave_env.cable.axial import (
    cable_move,
    cable_solve,
    element_stiffness,
    hang_still,
    hanging_strain,
    hanging_stretch,
    solved_sheave_tension,
)
from heave_env.compensator import rod_gap, stopped_rod
from heave_env.compiled import seldom, source_fingerprint, stage
from heave_env.lanes import (
    absolute,
    align_stack,
    any_of,
    block_at,
    constant,
    converted,
    counting,
    fused,
    integers_at,
    lane,
    lane_of,
    lanes_of,
    maximum,
    minimum,
    n_lanes_of,
    negated,
    numbers_from,
    store_across,
    unsigned_float,
    where,
    words_at,
)
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
    SHEAVE_NEW,
    SHEAVE_OLD,
    SHEAVE_RATE_NEW,
    SHEAVE_RATE_OLD,
    SHEAVE_TENSION,
    SHOWN,
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

# Integer configuration of a plant; behind the last of these follow, sensor by sensor, channel row and delay,
# and then the history lags. The first are addresses of the plant's own memory.
(
    ADDRESS_STATE,
    ADDRESS_COUNTERS,
    ADDRESS_TABLES,
    ADDRESS_NUMBERS,
    ADDRESS_OBSERVATION,
    ADDRESS_REWARD,
    ADDRESS_OUTCOME,
    ADDRESS_ACTIONS,
    ADDRESS_BEGINS,
    ADDRESS_CHANNELS,
    N_ENVS,
    N_ROWS,
    N_OBSERVED,
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
    AT_COLUMNS,
    AT_COMPONENTS,
    AT_SENSORS,
    AT_RECORDING,
    HAS_PAY_OUT,
    BEGINS_COMPENSATED,
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
    WORK_FILTER,
    WORK_NOISE,
    WORK_CABLE,
    KEEPS_TENSIONS,
    SHOWS_ALL,
    N_CONFIGURATION,
) = range(66)
# What a call is told of: its share of the blocks, a scratch block of its own, and the control steps that
# these blocks have made, which say where the rings stand.
SHARE_CONFIGURATION, SHARE_SCRATCH, SHARE_FIRST_BLOCK, SHARE_LAST_BLOCK, SHARE_POSITION = range(5)

CONTROL_DT = 0
"""Place of the control step [s] in `tables`, which begins with it."""

# Whole-number state of a row.
SEED, EPISODE, STEP = 0, 1, 2
N_COUNTERS = 3

# What became of a row in a step.
RUNNING, DIVERGED, LOST, LANDED = 0, 1, 2, 3

# Lanes that draw their normal numbers together.
_DRAWN_LANES = 16
WIDE = 4
"""States of the wave filter that a single environment computes together."""
# Indices of draws, beyond those of a step's noise and of a sea's beginning.
_DROPOUT, _ERRORS = 4096, 1 << 20


# The sea -----------------------------------------------------------------------------------------


@stage
def _four_normals(W, rows, words, n_wanted):
    """Leaves four standard normal numbers, or two if no more are wanted, of random words in as many rows."""
    a, b, c, d = words
    W[rows], W[rows + 1] = normal_pair(W, a, b)
    if n_wanted > 2:
        W[rows + 2], W[rows + 3] = normal_pair(W, c, d)


@stage
def _draw_side_by_side(W, I, rows, n_first, first_stream, n_second, second_stream, ahead):
    """`_draw_normals` of a single environment: its quads take the lanes."""
    n_quads, n_all = (n_first + 3) // 4, (n_first + 3) // 4 + (n_second + 3) // 4
    for begin in range(0, n_all, 4):
        number = counting(4)
        number = number + constant(number, begin)
        count = constant(number, n_quads)
        is_second = number >= count
        quad = where(is_second, number - count, number)
        stream = where(is_second, constant(number, second_stream), constant(number, first_stream))
        step = constant(number, I[STEP])
        step = where(is_second, step + constant(number, ahead), step)
        seed, episode = constant(number, I[SEED]), constant(number, I[EPISODE])
        a, b, c, d = philox(seed, episode, stream, step, quad)
        z0, z1 = normal_pair(W, a, b)
        z2, z3 = normal_pair(W, c, d)
        for i in range(min(4, n_all - begin)):
            at = rows + 4 * (begin + i)
            W[at], W[at + 1], W[at + 2], W[at + 3] = lane(z0, i), lane(z1, i), lane(z2, i), lane(z3, i)


@stage
def _words(I, number, n_quads, first_stream, second_stream, ahead):
    """Words of the quad `number`, counted on from the first stream to the second."""
    is_second = number >= n_quads
    stream = constant(I, second_stream if is_second else first_stream)
    step = I[STEP] + constant(I, ahead if is_second else 0)
    quad = constant(I, number - n_quads if is_second else number)
    return philox(I[SEED], I[EPISODE], stream, step, quad)


@stage
def _draw_lane_by_lane(W, I, rows, n_first, first_stream, n_second, second_stream, ahead):
    """`_draw_normals` of a batch, some lanes at a time, so that the words find room in the registers."""
    n_quads, n_all = (n_first + 3) // 4, (n_first + 3) // 4 + (n_second + 3) // 4
    n_last = n_second - 4 * (n_all - n_quads - 1) if n_second > 0 else 4
    for begin in range(0, n_lanes_of(I), _DRAWN_LANES):
        own, into = lanes_of(I, begin, _DRAWN_LANES), lanes_of(W, begin, _DRAWN_LANES)
        # Two at a time share the sequence of keys, and the one fills the other's waits.
        for number in range(0, n_all - 1, 2):
            words = _words(own, number, n_quads, first_stream, second_stream, ahead)
            others = _words(own, number + 1, n_quads, first_stream, second_stream, ahead)
            _four_normals(into, rows + 4 * number, words, 4)
            _four_normals(into, rows + 4 * number + 4, others, n_last if number + 2 == n_all else 4)
        if n_all % 2 == 1:
            words = _words(own, n_all - 1, n_quads, first_stream, second_stream, ahead)
            _four_normals(into, rows + 4 * n_all - 4, words, n_last)


def _draw_normals(W, I, rows, n_first, first_stream, n_second, second_stream, ahead):
    """Fills rows with so many standard normal numbers of this step and one stream, and then with so many of
    the step `ahead` and another. Four numbers make a quad, with an address of its own; each of the two begins
    with a new one."""


@overload(_draw_normals, jit_options={"error_model": "numpy", "forceinline": True})
def _draw_normals_of(W, I, rows, n_first, first_stream, n_second, second_stream, ahead):
    drawn = _draw_side_by_side if I.n_lanes == 1 else _draw_lane_by_lane

    def draw(W, I, rows, n_first, first_stream, n_second, second_stream, ahead):
        drawn(W, I, rows, n_first, first_stream, n_second, second_stream, ahead)

    return draw


@stage
def _filter_output(S, W, cfg, numbers):
    """Boom-tip heave and rate from the filter's states."""
    n, states = cfg[N_FILTER], cfg[ROW_FILTER]
    output, own = cfg[AT_FILTER] + 3 * n * n, cfg[ROW_SEA] + 3 * n * n
    heave = rate = constant(S, 0.0)
    for i in range(n):
        state = S[states + i]
        if cfg[SEA_VARIES] == 1:
            heave, rate = fused(S[own + i], state, heave), fused(S[own + n + i], state, rate)
        else:
            heave = fused(constant(S, numbers[output + i]), state, heave)
            rate = fused(constant(S, numbers[output + n + i]), state, rate)
    W[NEW_BOOM_TIP], W[NEW_BOOM_TIP_RATE] = heave, rate


@stage
def _filter_rows(S, W, cfg, numbers):
    """`_filter_step`, state by state."""
    n, states, shared, own = cfg[N_FILTER], cfg[ROW_FILTER], cfg[AT_FILTER], cfg[ROW_SEA]
    fresh, noise = cfg[WORK_FILTER], cfg[WORK_NOISE]
    for i in range(n):
        state = constant(S, 0.0)
        if cfg[SEA_VARIES] == 1:
            for j in range(n):
                state = fused(S[own + i * n + j], S[states + j], state)
            for j in range(i + 1):
                state = fused(S[own + n * n + i * n + j], W[noise + j], state)
        else:
            for j in range(n):
                state = fused(constant(S, numbers[shared + i * n + j]), S[states + j], state)
            for j in range(i + 1):
                state = fused(constant(S, numbers[shared + n * n + i * n + j]), W[noise + j], state)
        W[fresh + i] = state
    for i in range(n):
        S[states + i] = W[fresh + i]


@stage
def _filter_columns(S, W, cfg, numbers):
    """`_filter_step` of a single environment: some states take the lanes, and the columns stand in turn."""
    n, states, fresh, noise = cfg[N_FILTER], cfg[ROW_FILTER], cfg[WORK_FILTER], cfg[WORK_NOISE]
    new, matrices = lanes_of(W, 0, WIDE), lanes_of(numbers, 0, WIDE)
    at, n_wide = cfg[AT_COLUMNS], -(-n // WIDE) * WIDE
    for first in range(0, n, WIDE):
        state = constant(matrices[at + first], 0.0)
        for j in range(n):
            state = fused(matrices[at + first + j * n_wide], constant(state, S[states + j]), state)
        for j in range(n):
            state = fused(matrices[at + first + (n + j) * n_wide], constant(state, W[noise + j]), state)
        new[fresh + first] = state
    for i in range(n):
        S[states + i] = W[fresh + i]


def _filter_step(S, W, cfg, numbers):
    """Wave and vessel filter over a control step, exact: x <- F x + S z."""


@overload(_filter_step, jit_options={"error_model": "numpy", "forceinline": True})
def _filter_step_of(S, W, cfg, numbers):
    def alone(S, W, cfg, numbers):
        if cfg[SEA_VARIES] == 1:
            _filter_rows(S, W, cfg, numbers)
        else:
            _filter_columns(S, W, cfg, numbers)
        _filter_output(S, W, cfg, numbers)

    def many(S, W, cfg, numbers):
        _filter_rows(S, W, cfg, numbers)
        _filter_output(S, W, cfg, numbers)

    return alone if S.n_lanes == 1 else many


@stage
def _begin_filter(S, W, I, cfg, numbers):
    """Draws one lane's filter state from the stationary distribution."""
    n, states, noise = cfg[N_FILTER], cfg[ROW_FILTER], cfg[WORK_NOISE]
    shared, own = cfg[AT_FILTER] + 2 * n * n, cfg[ROW_SEA] + 2 * n * n
    _draw_normals(W, I, noise, n, INITIAL, 0, INITIAL, 0)
    for i in range(n):
        state = constant(S, 0.0)
        for j in range(i + 1):
            at = i * n + j
            root = S[own + at] if cfg[SEA_VARIES] == 1 else constant(S, numbers[shared + at])
            state = fused(root, W[noise + j], state)
        S[states + i] = state
    _filter_output(S, W, cfg, numbers)


@stage
def _sum_sinusoids(S, W, I, cfg, tables, ahead):
    """Boom-tip heave and rate of one lane as a sum of sinusoids, `ahead` control steps from its own clock."""
    n, components = cfg[N_COMPONENTS], cfg[ROW_COMPONENTS]
    amplitudes, own = cfg[AT_COMPONENTS] + 2 * n, cfg[ROW_SEA] + 2 * n
    time = (np.float64(np.int64(I[STEP])) + ahead) * tables[CONTROL_DT]
    heave = rate = constant(S, 0.0)
    for i in range(n):
        amplitude = np.float64(S[own + i]) if cfg[SEA_VARIES] == 1 else tables[amplitudes + i]
        frequency = np.float64(S[components + 2 * i])
        cosine, sine = cosine_sine_of_turns(frequency * time + np.float64(S[components + 2 * i + 1]))
        heave += constant(S, amplitude * cosine)
        rate -= constant(S, amplitude * (2.0 * math.pi) * frequency * sine)
    W[NEW_BOOM_TIP], W[NEW_BOOM_TIP_RATE] = heave, rate


@stage
def _begin_sinusoids(S, I, cfg, tables):
    """Draws one lane's frequencies, each within its bin, and phases."""
    n, components = cfg[N_COMPONENTS], cfg[ROW_COMPONENTS]
    at, own, varies = cfg[AT_COMPONENTS], cfg[ROW_SEA], cfg[SEA_VARIES] == 1
    for i in range(n):
        stream, index = constant(I, INITIAL), constant(I, i)
        a, b, _, _ = philox(I[SEED], I[EPISODE], stream, constant(I, 0), index)
        low = np.float64(S[own + i]) if varies else tables[at + i]
        width = np.float64(S[own + n + i]) if varies else tables[at + n + i]
        omega = low + width * uniform(0.0, a)
        S[components + 2 * i] = constant(S, omega / (2.0 * math.pi))
        S[components + 2 * i + 1] = constant(S, uniform(0.0, b))


@stage
def _recorded_sample(I, cfg, substep):
    """Place in the tables of one lane's sample at the end of a solver step."""
    step = min(np.int64(I[STEP]), cfg[N_STEPS] - 1)
    return cfg[AT_RECORDING] + 3 * (step * cfg[N_SUBSTEPS] + substep + 1)


@stage
def _recorded_substep(S, W, I, cfg, tables, substep, dt):
    """One lane's sheave and pay-out at the end of a solver step, from the recording."""
    at = _recorded_sample(I, cfg, substep)
    W[SHEAVE_NEW], W[SHEAVE_RATE_NEW] = constant(S, tables[at]), constant(S, tables[at + 1])
    S[PAYOUT_RATE] = constant(S, (tables[at + 2] - tables[at - 1]) / dt)
    S[PAYOUT] = constant(S, tables[at + 2])


@stage
def _boom_tip_at_substep(S, W, cfg, numbers, substep):
    """Sheave heave and rate at the end of a solver step, positive up.

    Between control instants the boom tip is the cubic through its heave and rate at both.
    """
    at = cfg[AT_HERMITE] + 8 * substep
    x0, v0, x1, v1 = W[OLD_BOOM_TIP], W[OLD_BOOM_TIP_RATE], W[NEW_BOOM_TIP], W[NEW_BOOM_TIP_RATE]
    for row in (SHEAVE_NEW, SHEAVE_RATE_NEW):
        a, b = constant(S, numbers[at]), constant(S, numbers[at + 1])
        c, d = constant(S, numbers[at + 2]), constant(S, numbers[at + 3])
        W[row] = fused(a, x0, fused(b, v0, fused(c, x1, d * v1)))
        at += 4


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
def _pay_out_over_substep(S, I, tables, substep, dt):
    """Cable that one lane's operation pays out in a solver step, and in all."""
    speed = np.float64(S[PAY_OUT_SPEED])
    running, ramp = np.float64(S[PAY_OUT_TIME]), np.float64(S[PAY_OUT_RAMP])
    time = np.float64(np.int64(I[STEP])) * tables[CONTROL_DT] + substep * dt
    time -= np.float64(S[PAY_OUT_START])
    old, new = _time_at_speed(time, running, ramp), _time_at_speed(time + dt, running, ramp)
    S[PAYOUT_RATE] = constant(S, speed * (new - old) / dt)
    S[PAYOUT] = constant(S, speed * new)


@stage
def _cable_numbers(cfg):
    """Where the cable's rows begin in the state and in the scratch block, its elements and iterations."""
    return cfg[ROW_NODES], cfg[WORK_CABLE], cfg[N_ELEMENTS], cfg[N_ITERATIONS]


@stage
def _rod_gap_now(S, W, cfg, dt):
    """One lane's gap in the rod's balance at its trial end, under the tension that was solved for."""
    tension = solved_sheave_tension(
        S,
        W,
        cfg[ROW_NODES],
        cfg[WORK_CABLE],
        cfg[N_ELEMENTS],
        dt,
        cfg[TENSION_ONLY] == 1,
        cfg[HOOKEAN] == 1,
    )
    return rod_gap(S, W, S[COMPENSATOR_DISPLACEMENT], tension, dt)


@stage
def _first_rod_end(S, W, cfg, dt):
    """One lane's first guess of where the rod ends."""
    two, step = constant(S, 2.0), constant(S, dt)
    rod, gap = S[COMPENSATOR_DISPLACEMENT], _rod_gap_now(S, W, cfg, dt)
    W[FIRST_TRIAL], W[FIRST_GAP] = rod, gap
    # A first slope that errs to the stiff side: rod, gas and the cable's uppermost element.
    stiff = S[COMPENSATOR_DAMPING] / step + two * S[COMPENSATOR_MASS] / (step * step)
    stiff += S[GAS_FORCE] / S[GAS_LENGTH]
    tension_only, hookean = cfg[TENSION_ONLY] == 1, cfg[HOOKEAN] == 1
    stiff += element_stiffness(S, W, cfg[WORK_CABLE], dt, tension_only, hookean)
    S[COMPENSATOR_DISPLACEMENT] = rod - gap / max(stiff, constant(S, 1.0))


@stage
def _better_rod_end(S, W, cfg, dt, is_last):
    """One lane's next guess, by the secant through the last two."""
    rod, gap = S[COMPENSATOR_DISPLACEMENT], _rod_gap_now(S, W, cfg, dt)
    moved, lessened = rod - W[FIRST_TRIAL], gap - W[FIRST_GAP]
    W[FIRST_TRIAL], W[FIRST_GAP] = rod, gap
    better = rod - gap * moved / lessened if lessened != constant(S, 0.0) else rod
    S[COMPENSATOR_DISPLACEMENT] = stopped_rod(S, better) if is_last else better


@seldom
def _solve_with_rod(S, W, cfg, dt):
    """Cable and passive compensator over a solver step, solved together by the secant method.

    The cable's tension is all but linear in where the rod ends, so that three solves of the cable do: two
    to find the secant, one at its root; a cable that may be slack or hardens gets two more. On return the
    sheave's rows hold the rod's motion too.
    """
    align_stack()
    zero, two, step = constant(S, 0.0), constant(S, 2.0), constant(S, dt)
    old = S[COMPENSATOR_DISPLACEMENT]
    W[COMPENSATOR_OLD] = old
    W[BOOM_TIP_BELOW] = W[SHEAVE_NEW]
    W[SHEAVE_OLD] = W[SHEAVE_OLD] - old
    S[COMPENSATOR_DISPLACEMENT] = old + step * S[COMPENSATOR_RATE]
    tension_only, hookean = cfg[TENSION_ONLY] == 1, cfg[HOOKEAN] == 1
    n_guesses = 5 if tension_only or not hookean else 3
    for guess in range(n_guesses + 1):
        # With the sheave where the rod's trial end puts it, positive down.
        W[SHEAVE_NEW] = W[BOOM_TIP_BELOW] - S[COMPENSATOR_DISPLACEMENT]
        nodes, work, n_elements, n_iterations = _cable_numbers(cfg)
        cable_solve(S, W, nodes, work, n_elements, n_iterations, dt, tension_only, hookean, True)
        for number in range(n_lanes_of(S)):
            own, scratch = lane_of(S, number), lane_of(W, number)
            if guess == 0:
                _first_rod_end(own, scratch, cfg, dt)
            elif guess < n_guesses:
                _better_rod_end(own, scratch, cfg, dt, guess + 1 == n_guesses)
    rod = S[COMPENSATOR_DISPLACEMENT]
    at_stop = absolute(rod) >= S[HALF_STROKE]
    rate = two * (rod - old) / step - S[COMPENSATOR_RATE]
    # Without mass the midpoint's rates would ring about the mean, which means nothing then.
    rate = where(S[COMPENSATOR_MASS] > zero, rate, (rod - old) / step)
    S[COMPENSATOR_RATE] = where(at_stop, zero, rate)


@stage
def _linear_substep(S, W):
    """a x'' + b x' + x = x0 + u over a solver step, exact for the cubic through the ends of x0 + u."""
    m, g = LINEAR_TRANSITION, LINEAR_INPUT
    x, v, u = S[PAYLOAD_HEAVE], S[PAYLOAD_HEAVE_RATE], S[WINCH_DISPLACEMENT]
    z0, r0 = W[SHEAVE_OLD] + W[WINCH_OLD], W[SHEAVE_RATE_OLD] + W[WINCH_RATE_START]
    z1, r1 = W[SHEAVE_NEW] + u, W[SHEAVE_RATE_NEW] + S[WINCH_RATE]
    forced = fused(S[g], z0, fused(S[g + 1], r0, fused(S[g + 2], z1, S[g + 3] * r1)))
    forced_rate = fused(S[g + 4], z0, fused(S[g + 5], r0, fused(S[g + 6], z1, S[g + 7] * r1)))
    S[PAYLOAD_HEAVE] = fused(S[m], x, fused(S[m + 1], v, forced))
    S[PAYLOAD_HEAVE_RATE] = fused(S[m + 2], x, fused(S[m + 3], v, forced_rate))
    W[STEP_MOVED] = W[STEP_MOVED] + absolute(u - W[WINCH_OLD])


@seldom
def _show_rope(S, cfg):
    """`_show_cable` of one lane's rope beyond Hooke's law."""
    bottom = cfg[ROW_NODES] + N_NODE_FIELDS * cfg[N_ELEMENTS]
    reference = S[INITIAL_LENGTH] + S[PAYOUT]
    stretch = hanging_stretch(S, cfg[N_ELEMENTS], reference)
    tension = S[PAYLOAD_WEIGHT] + S[CABLE_WEIGHT] * reference
    lengthening = constant(S, 1.0) + hanging_strain(S, tension)
    S[PAYLOAD_HEAVE] = S[WINCH_DISPLACEMENT] + stretch - S[bottom + DISPLACEMENT]
    S[PAYLOAD_HEAVE_RATE] = S[PAYOUT_RATE] * lengthening - S[bottom + VELOCITY]


@stage
def _show_cable(S, cfg):
    """Payload heave about its still-water position below the reference length, and its rate."""
    if cfg[HOOKEAN] == 0:
        for number in range(n_lanes_of(S)):
            _show_rope(lane_of(S, number), cfg)
        return
    bottom = cfg[ROW_NODES] + N_NODE_FIELDS * cfg[N_ELEMENTS]
    reference = S[INITIAL_LENGTH] + S[PAYOUT]
    w1, w2, EA = S[CABLE_WEIGHT], S[PAYLOAD_WEIGHT], S[CABLE_STIFFNESS]
    stretch = reference * (w2 + constant(S, 0.5) * w1 * reference) / EA
    lengthening = constant(S, 1.0) + (w2 + w1 * reference) / EA
    S[PAYLOAD_HEAVE] = S[WINCH_DISPLACEMENT] + stretch - S[bottom + DISPLACEMENT]
    S[PAYLOAD_HEAVE_RATE] = S[PAYOUT_RATE] * lengthening - S[bottom + VELOCITY]


@stage
def _before(slot, age, ring):
    """The place in a ring that was written `age` steps before `slot`, both below its length."""
    return slot - age if slot >= age else slot - age + ring


@stage
def _late_command(S, W, cfg, slot, substep):
    """The command that acts on one lane's winch in a solver step, with its own delay."""
    given = (substep - np.int64(S[OWN_DELAY])) // cfg[N_SUBSTEPS]
    W[ACTING_COMMAND] = S[cfg[ROW_COMMANDS] + _before(slot, -given, cfg[N_PENDING] + 1)]


@stage
def _winch_substep(S, W, cfg, slot, substep, dt):
    """The drum over a solver step under the command that is due."""
    if cfg[DELAY_VARIES] == 1:
        for number in range(n_lanes_of(S)):
            _late_command(lane_of(S, number), lane_of(W, number), cfg, slot, substep)
        command = W[ACTING_COMMAND]
    else:
        given = (substep - cfg[DELAY_SUBSTEPS]) // cfg[N_SUBSTEPS]
        command = S[cfg[ROW_COMMANDS] + _before(slot, -given, cfg[N_PENDING] + 1)]
    if cfg[WINCH_DRIVEN] == 1:
        at_once = cfg[ACCELERATION_LIMITED] == 0
        driven_winch_step(S, W, command, dt, cfg[SECOND_ORDER_WINCH] == 1, at_once)
    elif cfg[WINCH_LIMITED] == 1:
        limited_winch_step(S, W, command, dt, cfg[ACCELERATION_LIMITED] == 0)
    else:
        free_winch_step(S, W, command)


@stage
def _substep(S, W, I, cfg, tables, numbers, slot, substep, dt):
    """Sea, winch and cable or linear payload over a solver step."""
    W[SHEAVE_OLD], W[SHEAVE_RATE_OLD] = W[SHEAVE_NEW], W[SHEAVE_RATE_NEW]
    if cfg[SEA_KIND] == RECORDED:
        for number in range(n_lanes_of(S)):
            one, scratch = lane_of(S, number), lane_of(W, number)
            _recorded_substep(one, scratch, lane_of(I, number), cfg, tables, substep, dt)
    else:
        _boom_tip_at_substep(S, W, cfg, numbers, substep)
        if cfg[HAS_PAY_OUT] == 1:
            for number in range(n_lanes_of(S)):
                _pay_out_over_substep(lane_of(S, number), lane_of(I, number), tables, substep, dt)
    _winch_substep(S, W, cfg, slot, substep, dt)
    if cfg[IS_LINEAR] == 1:
        _linear_substep(S, W)
        return
    # The finite-difference cable, with the winch's work on it.
    u = S[WINCH_DISPLACEMENT]
    hauled = u - W[WINCH_OLD]
    W[LENGTH_OLD] = S[LENGTH]
    W[LENGTH_SPEED] = S[PAYOUT_RATE] - hauled * constant(S, 1.0 / dt)
    S[LENGTH] = S[INITIAL_LENGTH] + S[PAYOUT] - u
    # The cable's own signs are positive down.
    heave, heave_rate = W[SHEAVE_NEW], W[SHEAVE_RATE_NEW]
    W[SHEAVE_OLD], W[SHEAVE_NEW] = -W[SHEAVE_OLD], -heave
    nodes, work, n_elements, n_iterations = _cable_numbers(cfg)
    tension_only, hookean, keeps = cfg[TENSION_ONLY] == 1, cfg[HOOKEAN] == 1, cfg[KEEPS_TENSIONS] == 1
    if cfg[HAS_COMPENSATOR] == 1:
        _solve_with_rod(S, W, cfg, dt)
    else:
        cable_solve(S, W, nodes, work, n_elements, n_iterations, dt, tension_only, hookean, False)
    cable_move(S, W, nodes, work, n_elements, dt, tension_only, hookean, keeps)
    work_done = S[SHEAVE_TENSION] * hauled
    share = where(work_done > constant(S, 0.0), S[SUPPLY_PER_WORK], S[RETURNED_SHARE])
    W[STEP_WORK] = W[STEP_WORK] + work_done
    W[STEP_MOVED] = W[STEP_MOVED] + absolute(work_done)
    W[STEP_SUPPLY] = fused(work_done, share, W[STEP_SUPPLY])
    W[SHEAVE_NEW], W[SHEAVE_RATE_NEW] = heave, heave_rate


# Sensors and task --------------------------------------------------------------------------------


@stage
def _distorted(S, cfg, tables, s, truth):
    """What a sensor makes of a true value before noise: high-pass, scale error, bias.

    The high-pass is the trapezoidal state-variable form, which keeps its accuracy when its corner is slow.
    """
    one, two = constant(S, 1.0), constant(S, 2.0)
    at, own = cfg[AT_SENSOR_ERRORS] + 6 * s, cfg[ROW_SENSOR_STATE] + 5 * s
    if tables[at + 4] > 0.0:
        g, damping = constant(S, tables[at + 4]), constant(S, tables[at + 5])
        first, second = S[own + 3], S[own + 4]
        high = (truth - (two * damping + g) * first - second) / (one + g * (two * damping + g))
        band = g * high + first
        S[own + 3] = g * high + band
        S[own + 4] = two * g * band + second
        truth = high
    return truth * (one + S[own]) + S[own + 1]


@stage
def _held(S, I, cfg, tables, s, place):
    """Leaves one lane's reading that stands: the new one, or the last where none is due or it was lost."""
    at, last = cfg[AT_SENSOR_ERRORS] + 6 * s, cfg[ROW_SENSOR_STATE] + 5 * s + 2
    step = np.int64(I[STEP])
    every, dropout = np.int64(tables[at + 2]), tables[at + 3]
    lost = step % every != 0
    if dropout > 0.0 and not lost and step > 0:
        stream, index = constant(I, SENSORS), constant(I, _DROPOUT + s)
        word, _, _, _ = philox(I[SEED], I[EPISODE], stream, I[STEP], index)
        lost = uniform(0.0, word) < dropout
    if lost:
        S[place] = S[last]
    else:
        S[last] = S[place]


@stage
def _begin_sensors(S, I, cfg, tables):
    """Draws one lane's scale errors and biases and empties its heave filters."""
    for s in range(cfg[N_SENSORS]):
        at, own = cfg[AT_SENSOR_ERRORS] + 6 * s, cfg[ROW_SENSOR_STATE] + 5 * s
        stream, index = constant(I, INITIAL), constant(I, _ERRORS + s)
        a, b, _, _ = philox(I[SEED], I[EPISODE], stream, constant(I, 0), index)
        z0, z1 = normal_pair(0.0, a, b)
        S[own] = constant(S, tables[at] * z0)
        S[own + 1] = constant(S, tables[at + 1] * z1)
        S[own + 3] = S[own + 4] = constant(S, 0.0)


@stage
def _measure(S, W, I, cfg, tables, numbers, slot, noise):
    """Writes this instant's samples, noisy, scaled and clipped, into their place in the sensor ring."""
    n, bound = cfg[N_SENSORS], constant(S, OBSERVATION_BOUND)
    for s in range(n):
        at, own, place = (
            cfg[AT_SENSORS] + 3 * s,
            cfg[ROW_SENSOR_TABLE] + 3 * s,
            cfg[ROW_SENSORS] + slot * n + s,
        )
        if cfg[SENSORS_VARY] == 1:
            std, offset, per_scale = S[own], S[own + 1], S[own + 2]
        else:
            std, offset = constant(S, numbers[at]), constant(S, numbers[at + 1])
            per_scale = constant(S, numbers[at + 2])
        truth = S[cfg[N_CONFIGURATION + 2 * s]]
        if cfg[SENSORS_ERR] == 1:
            truth = _distorted(S, cfg, tables, s, truth)
        value = (fused(std, W[noise + s], truth) - offset) * per_scale
        S[place] = minimum(maximum(value, -bound), bound)
        if cfg[SENSORS_ERR] == 1:
            for number in range(n_lanes_of(S)):
                _held(lane_of(S, number), lane_of(I, number), cfg, tables, s, place)


@stage
def _show_four(W, cfg, observation, first, n_rows):
    """Copies the four values that wait into columns of the observations, from `first` on."""
    if n_rows == n_lanes_of(W):
        a, b = W[SHOWN + first % 4], W[SHOWN + (first + 1) % 4]
        c, d = W[SHOWN + (first + 2) % 4], W[SHOWN + (first + 3) % 4]
        a, b = converted(observation, a), converted(observation, b)
        c, d = converted(observation, c), converted(observation, d)
        store_across(observation, first, cfg[N_OBSERVED], a, b, c, d)
    else:
        for column in range(first, first + 4):
            _show_one(W, cfg, observation, column, n_rows)


@stage
def _show_one(W, cfg, observation, column, n_rows):
    for number in range(n_rows):
        value = lane_of(W, number)[SHOWN + column % 4]
        observation[number * cfg[N_OBSERVED] + column] = converted(observation, value)


def _show_value(W, cfg, observation, column, n_rows, value):
    """Puts a value into its column of the observations, or keeps it until there are four."""


@overload(_show_value, jit_options={"error_model": "numpy", "forceinline": True})
def _show_value_of(W, cfg, observation, column, n_rows, value):
    def show(W, cfg, observation, column, n_rows, value):
        observation[column] = converted(observation, value)

    def keep(W, cfg, observation, column, n_rows, value):
        W[SHOWN + column % 4] = value
        n_observed = cfg[N_OBSERVED]
        if column % 4 == 3:
            _show_four(W, cfg, observation, column - 3, n_rows)
        elif column + 1 == n_observed:
            # The last four once more, with what is left over among them.
            if n_observed >= 4:
                _show_four(W, cfg, observation, n_observed - 4, n_rows)
            else:
                for last in range(n_observed):
                    _show_one(W, cfg, observation, last, n_rows)

    return show if W.n_lanes == 1 else keep


@stage
def _observe(S, W, cfg, slot, command_slot, observation, n_rows):
    """Lays out the observation: lag by lag the sensors, then filter states, then pending commands."""
    n, ring, commands = cfg[N_SENSORS], cfg[SENSOR_RING], cfg[N_PENDING] + 1
    column = 0
    for i in range(cfg[N_LAGS]):
        lag = cfg[N_CONFIGURATION + 2 * n + i]
        for s in range(n):
            past = _before(slot, lag + cfg[N_CONFIGURATION + 2 * s + 1], ring)
            _show_value(W, cfg, observation, column, n_rows, S[cfg[ROW_SENSORS] + past * n + s])
            column += 1
    for i in range(cfg[SHOWN_FILTER_STATES]):
        _show_value(W, cfg, observation, column, n_rows, S[cfg[ROW_FILTER] + i])
        column += 1
    for i in range(cfg[SHOWS_DRAWS] * cfg[N_DRAWS]):
        _show_value(W, cfg, observation, column, n_rows, S[cfg[ROW_DRAWS] + i])
        column += 1
    for i in range(cfg[N_SHOWN_PENDING]):
        given = S[cfg[ROW_COMMANDS] + _before(command_slot, i, commands)]
        _show_value(W, cfg, observation, column, n_rows, given / S[COMMAND_RANGE])
        column += 1


@stage
def _charge(S, W, I, cfg, reward, outcome):
    """Stage cost, safety cost and what became of each row; a diverged row shows zeros, never NaN."""
    zero, one = constant(S, 0.0), constant(S, 1.0)
    x, u0, limit = S[PAYLOAD_HEAVE], S[COMMAND], S[DIVERGENCE_LIMIT]
    # Not (a < b) rather than a >= b: a NaN must count as diverged.
    diverged = negated((absolute(x) < limit) & (absolute(S[PAYLOAD_HEAVE_RATE]) < limit))
    lost = landed = zero != zero
    unsafe = where(absolute(S[WINCH_DISPLACEMENT]) >= S[STROKE_LIMIT], one, zero)
    if cfg[IS_LINEAR] == 0:
        bottom = cfg[ROW_NODES] + N_NODE_FIELDS * cfg[N_ELEMENTS]
        highest = S[TENSION_MAX]
        lost = negated(diverged | (highest < S[BREAKING_STRENGTH]))
        landed = S[LENGTH] + S[bottom + DISPLACEMENT] >= S[LANDING_DEPTH]
        landed = landed & negated(diverged | lost)
    if any_of(diverged):
        for channel in range(N_CHANNELS):
            value = S[channel]
            S[channel] = where(diverged & negated(absolute(value) < constant(S, 1e30)), zero, value)
        # The failure is charged below; a displacement without meaning is not.
        x = where(diverged, zero, x)
        S[PAYLOAD_HEAVE] = x
        S[PAYLOAD_HEAVE_RATE] = where(diverged, zero, S[PAYLOAD_HEAVE_RATE])
    if cfg[IS_LINEAR] == 0:
        unsafe = unsafe + S[SLACK] + where(S[TENSION_MAX] > S[TENSION_LIMIT], one, zero)
    made = unsigned_float(S, I[STEP] + constant(I, 1))
    remaining = maximum(constant(S, cfg[N_STEPS]) - made, zero)
    position_cost, command_cost = S[POSITION_WEIGHT] * x * x, S[COMMAND_WEIGHT] * u0 * u0
    failure_cost = where(diverged | lost, S[FAILURE_RATE] * remaining, zero)
    S[POSITION_COST], S[COMMAND_COST] = position_cost, command_cost
    S[FAILURE_COST], S[SAFETY_COST] = failure_cost, unsafe
    total = position_cost + command_cost + failure_cost
    if cfg[CHARGES_ENERGY] == 1:
        energy_cost = S[ENERGY_WEIGHT] * where(diverged, zero, W[STEP_MOVED])
        S[ENERGY_COST] = energy_cost
        total = total + energy_cost
    reward[0] = converted(reward, -total)
    fate = where(diverged, constant(I, DIVERGED), constant(I, RUNNING))
    outcome[0] = where(lost, constant(I, LOST), where(landed, constant(I, LANDED), fate))


# The two faces of the kernel ---------------------------------------------------------------------


def _make(single: int, n_lanes: int, plain: int, fingerprint: int):
    """The kernel for blocks of `n_lanes` environments, in single or double precision."""
    itemsize = 4 if single else 8

    # A single environment's step is over before another thread could use the time.
    @njit(cache=True, nogil=n_lanes > 1, error_model="numpy")
    def advance(share, action):
        """Advances every row of some blocks by one control step, under the actions that the plant holds.

        Args:
            share: Address of five integers: configuration, scratch block, first block, the block to stop
                before, and the control steps made, which this call counts on.
            action: Of a single environment, [-]; a batch looks at those that the plant holds.

        Returns:
            Of a single environment the reward, NaN if it does not go on; of a batch 0.
        """
        if fingerprint == 0:
            return 0.0
        align_stack()
        told = integers_at(share)
        position = told[SHARE_POSITION]
        told[SHARE_POSITION] = position + 1
        cfg = integers_at(told[SHARE_CONFIGURATION])
        if n_lanes == 1:
            block_at(cfg[ADDRESS_ACTIONS], 0, 1, 0)[0] = action
        tables = block_at(cfg[ADDRESS_TABLES], 0, 1, 0)
        numbers = block_at(cfg[ADDRESS_NUMBERS], single, 1, 0)
        W = block_at(told[SHARE_SCRATCH], single, n_lanes, plain)
        n_substeps, n_sensors = cfg[N_SUBSTEPS], cfg[N_SENSORS]
        control_dt = tables[CONTROL_DT]
        command_slot = position % (cfg[N_PENDING] + 1)
        slot = (position + 1) % cfg[SENSOR_RING]
        n_sea = cfg[N_FILTER] if cfg[SEA_KIND] == FILTERED else 0
        zero, one = constant(W, 0.0), constant(W, 1.0)
        for block in range(told[SHARE_FIRST_BLOCK], told[SHARE_LAST_BLOCK]):
            S = block_at(
                cfg[ADDRESS_STATE] + block * cfg[N_ROWS] * (n_lanes * itemsize), single, n_lanes, plain
            )
            I = words_at(cfg[ADDRESS_COUNTERS] + block * (N_COUNTERS * n_lanes * 8), n_lanes, plain)
            first_row = block * n_lanes
            n_rows = min(n_lanes, cfg[N_ENVS] - first_row)
            actions = block_at(cfg[ADDRESS_ACTIONS] + first_row * 8, 0, n_lanes, plain)
            share_of_range = converted(S, actions[0])
            command = maximum(minimum(share_of_range, one), -one) * S[COMMAND_RANGE]
            S[SATURATED] = where(absolute(share_of_range) >= one, one, zero)
            S[COMMAND] = command
            S[cfg[ROW_COMMANDS] + command_slot] = command
            heave, heave_rate = S[BOOM_TIP_HEAVE], S[BOOM_TIP_HEAVE_RATE]
            W[OLD_BOOM_TIP], W[OLD_BOOM_TIP_RATE] = heave, heave_rate
            W[NEW_BOOM_TIP], W[NEW_BOOM_TIP_RATE] = zero, zero
            W[SHEAVE_NEW], W[SHEAVE_RATE_NEW] = heave, heave_rate
            S[TENSION_MIN], S[TENSION_MAX] = constant(S, np.inf), constant(S, -np.inf)
            W[STEP_WORK], W[STEP_SUPPLY], W[STEP_MOVED] = zero, zero, zero
            noise = cfg[WORK_NOISE]
            _draw_normals(W, I, noise, n_sea, SEA, n_sensors, SENSORS, 1)
            if cfg[SEA_KIND] == FILTERED:
                _filter_step(S, W, cfg, numbers)
            elif cfg[SEA_KIND] == SINUSOIDS:
                for number in range(n_lanes):
                    own, scratched = lane_of(S, number), lane_of(W, number)
                    _sum_sinusoids(own, scratched, lane_of(I, number), cfg, tables, 1.0)
            for substep in range(n_substeps):
                _substep(S, W, I, cfg, tables, numbers, command_slot, substep, control_dt / n_substeps)
            S[BOOM_TIP_HEAVE], S[BOOM_TIP_HEAVE_RATE] = W[SHEAVE_NEW], W[SHEAVE_RATE_NEW]
            per_step = constant(S, 1.0 / control_dt)
            S[WINCH_POWER], S[SUPPLY_POWER] = W[STEP_WORK] * per_step, W[STEP_SUPPLY] * per_step
            if cfg[IS_LINEAR] == 0:
                _show_cable(S, cfg)
            reward = block_at(cfg[ADDRESS_REWARD] + first_row * 8, 0, n_lanes, plain)
            outcome = words_at(cfg[ADDRESS_OUTCOME] + first_row * 8, n_lanes, plain)
            _charge(S, W, I, cfg, reward, outcome)
            I[STEP] = I[STEP] + constant(I, 1)
            _measure(S, W, I, cfg, tables, numbers, slot, noise + (n_sea + 3) // 4 * 4)
            observation = block_at(cfg[ADDRESS_OBSERVATION] + first_row * cfg[N_OBSERVED] * 4, 1, 1, 0)
            _observe(S, W, cfg, slot, command_slot, observation, n_rows)
            if cfg[ADDRESS_CHANNELS] != 0:
                # While they are in the nearest cache.
                size = N_CHANNELS * n_lanes
                kept = block_at(cfg[ADDRESS_CHANNELS] + block * size * itemsize, single, 1, 0)
                shown = numbers_from(S, 0)
                for i in range(size):
                    kept[i] = shown[i]
        if n_lanes > 1:
            return 0.0
        goes_on = integers_at(cfg[ADDRESS_OUTCOME])[0] == RUNNING
        return block_at(cfg[ADDRESS_REWARD], 0, 1, 0)[0] if goes_on else np.nan

    @njit(cache=True, nogil=n_lanes > 1, error_model="numpy")
    def begin(share):
        """Begins a new episode in the rows that the plant marked: the sea stationary, cable and payload
        hanging still, the winch at rest or in the middle of compensating.

        The share is one of `advance`, but all blocks are looked at, and `SHOWS_ALL` has the
        observations of the other rows laid out anew. The seeds and episodes must stand in the counters. There
        is a mark for each lane of each block: lanes beyond the last environment run along and need a state
        too.
        """
        if fingerprint == 0:
            return
        align_stack()
        told = integers_at(share)
        cfg, position = integers_at(told[SHARE_CONFIGURATION]), told[SHARE_POSITION]
        tables = block_at(cfg[ADDRESS_TABLES], 0, 1, 0)
        numbers = block_at(cfg[ADDRESS_NUMBERS], single, 1, 0)
        W = lane_of(block_at(told[SHARE_SCRATCH], single, n_lanes, plain), 0)
        begins = integers_at(cfg[ADDRESS_BEGINS])
        command_slot = (position + cfg[N_PENDING]) % (cfg[N_PENDING] + 1)
        slot = position % cfg[SENSOR_RING]
        for row in range(-(-cfg[N_ENVS] // n_lanes) * n_lanes):
            if begins[row] == 0:
                continue
            block, number = row // n_lanes, row % n_lanes
            address = cfg[ADDRESS_STATE] + block * cfg[N_ROWS] * (n_lanes * itemsize)
            S = lane_of(block_at(address, single, n_lanes, plain), number)
            address = cfg[ADDRESS_COUNTERS] + block * (N_COUNTERS * n_lanes * 8)
            I = lane_of(words_at(address, n_lanes, plain), number)
            zero = constant(S, 0.0)
            I[STEP] = constant(I, 0)
            for channel in range(N_CHANNELS):
                S[channel] = zero
            W[NEW_BOOM_TIP], W[NEW_BOOM_TIP_RATE] = zero, zero
            if cfg[SEA_KIND] == FILTERED:
                _begin_filter(S, W, I, cfg, numbers)
            elif cfg[SEA_KIND] == SINUSOIDS:
                _begin_sinusoids(S, I, cfg, tables)
                _sum_sinusoids(S, W, I, cfg, tables, 0.0)
            elif cfg[SEA_KIND] == RECORDED:
                W[NEW_BOOM_TIP] = constant(S, tables[cfg[AT_RECORDING]])
                W[NEW_BOOM_TIP_RATE] = constant(S, tables[cfg[AT_RECORDING] + 1])
            S[BOOM_TIP_HEAVE] = W[NEW_BOOM_TIP]
            S[BOOM_TIP_HEAVE_RATE] = W[NEW_BOOM_TIP_RATE]
            S[PAYOUT_RATE] = zero
            command = zero
            if cfg[BEGINS_COMPENSATED] == 1:
                reach = min(S[STROKE_LIMIT], S[COMMAND_RANGE])
                fastest, most = S[SPEED_LIMIT], S[COMMAND_RANGE]
                S[WINCH_DISPLACEMENT] = max(min(-S[BOOM_TIP_HEAVE], reach), -reach)
                S[WINCH_RATE] = max(min(-S[BOOM_TIP_HEAVE_RATE], fastest), -fastest)
                # The command that gives the lag this rate, as if it had been given all along.
                wanted = S[WINCH_DISPLACEMENT] + S[WINCH_RATE] / S[WINCH_RATE_CONSTANT]
                command = max(min(wanted, most), -most)
            if cfg[IS_LINEAR] == 1:
                S[PAYLOAD_HEAVE] = S[BOOM_TIP_HEAVE] + S[WINCH_DISPLACEMENT]
            else:
                S[LENGTH] = S[INITIAL_LENGTH] - S[WINCH_DISPLACEMENT]
                hookean, keeps = cfg[HOOKEAN] == 1, cfg[KEEPS_TENSIONS] == 1
                hang_still(S, cfg[ROW_NODES], cfg[N_ELEMENTS], -S[BOOM_TIP_HEAVE], hookean, keeps)
                _show_cable(S, cfg)
                S[SHEAVE_TENSION] = S[PAYLOAD_WEIGHT] + S[CABLE_WEIGHT] * S[LENGTH]
                S[PAYLOAD_TENSION] = S[PAYLOAD_WEIGHT]
                S[TENSION_MIN] = S[PAYLOAD_TENSION]
                S[TENSION_MAX] = S[SHEAVE_TENSION]
            for i in range(cfg[N_PENDING] + 1):
                S[cfg[ROW_COMMANDS] + i] = command
            if cfg[SENSORS_ERR] == 1:
                _begin_sensors(S, I, cfg, tables)
            # Before the episode the sensors are taken to have read what they read now.
            n = cfg[N_SENSORS]
            _draw_normals(W, I, cfg[WORK_NOISE], 0, SENSORS, n, SENSORS, 0)
            _measure(S, W, I, cfg, tables, numbers, slot, cfg[WORK_NOISE])
            for past in range(cfg[SENSOR_RING]):
                for s in range(n):
                    S[cfg[ROW_SENSORS] + past * n + s] = S[cfg[ROW_SENSORS] + slot * n + s]
        for row in range(cfg[N_ENVS]):
            if begins[row] == 0 and cfg[SHOWS_ALL] == 0:
                continue
            address = cfg[ADDRESS_STATE] + row // n_lanes * cfg[N_ROWS] * (n_lanes * itemsize)
            S = lane_of(block_at(address, single, n_lanes, plain), row % n_lanes)
            observation = block_at(cfg[ADDRESS_OBSERVATION] + row * cfg[N_OBSERVED] * 4, 1, 1, 0)
            _observe(S, W, cfg, slot, command_slot, observation, 1)

    return advance, begin


BATCH_LANES = {"float64": 16, "float32": 32}
"""Environments per block of a batch, by precision."""
KERNELS = {
    (dtype, n_lanes): _make(int(dtype == "float32"), n_lanes, 0, source_fingerprint())
    for dtype, most in BATCH_LANES.items()
    for n_lanes in (1, most)
}
"""`advance` and `begin` by precision and lanes per block: one for single environments, many for batches."""
