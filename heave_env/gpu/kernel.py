"""The plant as two GPU kernels, one thread per environment: a twin of `heave_env.kernel`.

`kernels(form)` makes `advance` (one control step) and `begin` (a new episode of the masked rows) with
NVIDIA Warp, for CUDA cards and for the processor. Equations, order of events, random addresses and signs
are those of `heave_env.kernel` and `heave_env.cable.axial`, which explain them and to which
`tests/environment/test_gpu.py` holds this file.

Every array has the environment as its last axis, so that neighbouring threads touch neighbouring numbers.
Where all rows share a parameter its array is one column wide. What a scenario does not use is a constant
of `Form` and compiled out. A solver step passes over the cable twice for each iteration: downwards,
eliminating (two numbers stored for each node), and upwards, substituting; the last pass upwards also moves
the nodes and reads the tensions off. Nothing is kept in local arrays but the wave filter's few states.
"""

# Annotations of kernels are types made here, not names: no `from __future__ import annotations`.

import math
from dataclasses import astuple, dataclass
from functools import cache
from types import SimpleNamespace
from typing import Any

from heave_env.kernel import (
    CALM,
    DIVERGED,
    EPISODE,
    FILTERED,
    LANDED,
    LOST,
    RUNNING,
    SEED,
    SINUSOIDS,
    STEP,
)
from heave_env.layout import (
    ACCELERATION_LIMIT,
    BOOM_TIP_HEAVE,
    BOOM_TIP_HEAVE_RATE,
    BREAKING_STRENGTH,
    CABLE_DAMPING,
    CABLE_DRAG,
    CABLE_INERTIA,
    CABLE_STIFFNESS,
    CABLE_WEIGHT,
    COMMAND,
    COMMAND_COST,
    COMMAND_RANGE,
    COMMAND_STEP,
    COMMAND_WEIGHT,
    DEAD_BAND,
    DIVERGENCE_LIMIT,
    DRUM_INERTIA,
    DRUM_RADIUS,
    ENERGY_COST,
    ENERGY_WEIGHT,
    FAILURE_COST,
    FAILURE_RATE,
    INITIAL_LENGTH,
    LANDING_DEPTH,
    LENGTH,
    LINEAR_INPUT,
    LINEAR_TRANSITION,
    N_CHANNELS,
    OWN_DELAY,
    PAY_OUT_RAMP,
    PAY_OUT_SPEED,
    PAY_OUT_START,
    PAY_OUT_TIME,
    PAYLOAD_DRAG,
    PAYLOAD_HEAVE,
    PAYLOAD_HEAVE_RATE,
    PAYLOAD_INERTIA,
    PAYLOAD_TENSION,
    PAYLOAD_WEIGHT,
    PAYOUT,
    POSITION_COST,
    POSITION_WEIGHT,
    POWER_LIMIT,
    RETURNED_SHARE,
    SAFETY_COST,
    SATURATED,
    SHEAVE_TENSION,
    SLACK,
    SPEED_LIMIT,
    STROKE_LIMIT,
    SUPPLY_PER_WORK,
    SUPPLY_POWER,
    TENSION_LIMIT,
    TENSION_MAX,
    TENSION_MIN,
    TORQUE_LIMIT,
    WINCH_DECAY,
    WINCH_DISPLACEMENT,
    WINCH_POWER,
    WINCH_RATE,
    WINCH_RATE_CONSTANT,
    WINCH_TRANSITION,
)
from heave_env.sensors import OBSERVATION_BOUND
from heave_env.streams import INITIAL, SEA, SENSORS

BLOCK = 128
"""Threads of a block of the GPU [-]."""
FREE, LIMITED, DRIVEN = 0, 1, 2
"""Winch steps of `heave_env.winch`: free lag, lag within limits, any drive within every limit."""


@dataclass(frozen=True, kw_only=True)
class Form:
    """What is fixed when the kernels are compiled."""

    dtype: str
    """Precision of the physics, "float64" or "float32"."""
    sea: int
    """`CALM`, `FILTERED` or `SINUSOIDS` of `heave_env.kernel`."""
    n_filter: int
    """States of the wave and vessel filter [-]."""
    is_linear: bool
    """Whether the payload is the linear model, without a cable."""
    tension_only: bool
    """Whether the cable cannot push."""
    winch: int
    """`FREE`, `LIMITED` or `DRIVEN`."""
    second_order: bool
    """Whether the drive is of second order."""
    accelerates_at_once: bool
    """Whether nothing bounds the drum's acceleration."""
    pays_out: bool
    """Whether the operation pays cable out."""
    begins_compensated: bool
    """Whether an episode begins with the winch compensating."""
    delay_varies: bool
    """Whether each row has a command delay of its own."""
    charges_energy: bool
    """Whether the winch's work has a price."""


def warp() -> Any:
    """NVIDIA Warp, made ready.

    Raises:
        ModuleNotFoundError: If it is not installed, with what to do.
    """
    try:
        import warp as wp
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "the GPU plant needs NVIDIA Warp, which is not installed: pip install 'heave-env[gpu]'",
            name="warp-lang",
        ) from error
    wp.config.log_level = max(wp.config.log_level, wp.LOG_WARNING)  # what it compiles is not news
    wp.init()
    return wp


@cache
def structures(dtype: str, sea: int) -> SimpleNamespace:
    """The two structures that kernels take: `Buffers`, arrays, and `Numbers`, what all rows share."""
    wp = warp()
    real = getattr(wp, dtype)
    # Sinusoids' frequencies and phases are worked out in double precision.
    real_of_sea = wp.float64 if sea == SINUSOIDS else real

    @wp.struct
    class Buffers:
        """Arrays of a batch, the environment their last axis."""

        fixed: wp.array2d(dtype=real)  # parameters at their rows of `layout`, (N_FIXED, 1 or n_envs)
        sea: wp.array2d(dtype=real_of_sea)  # as `plant.sea_table`, (n, 1 or n_envs)
        readings: wp.array2d(dtype=real)  # as `plant.sensor_table`, (3 n_sensors, 1 or n_envs)
        cubic: wp.array(dtype=real)  # as `plant.cubic_coefficients`, (8 n_substeps,)
        measured: wp.array(dtype=wp.int32)  # channel of each sensor
        ages: wp.array(dtype=wp.int32)  # control steps between a sample and its reading, of each sensor
        lags: wp.array(dtype=wp.int32)  # history lags [control steps]
        counters: wp.array2d(dtype=wp.uint64)  # seed, episode, step
        clock: wp.array(dtype=wp.int32)  # where the rings stand
        channels: wp.array2d(dtype=real)
        filter: wp.array2d(dtype=real)  # states of the wave and vessel filter
        components: wp.array2d(dtype=real)  # frequency [Hz] and phase [turns] of each sinusoid in turn
        draws: wp.array2d(dtype=real)  # what the episode drew, -1 to 1
        commands: wp.array2d(dtype=real)  # ring of commands
        samples: wp.array2d(dtype=real)  # ring of scaled samples
        displacement: wp.array2d(dtype=real)  # of each node, positive down
        velocity: wp.array2d(dtype=real)
        upper: wp.array2d(dtype=real)  # scratch: what elimination leaves above the diagonal
        load: wp.array2d(dtype=real)  # scratch: and on the right
        increment: wp.array2d(dtype=real)  # scratch: what the last iteration found
        observation: wp.array2d(dtype=wp.float32)
        reward: wp.array(dtype=real)
        outcome: wp.array(dtype=wp.int32)
        terminated: wp.array(dtype=wp.bool)
        truncated: wp.array(dtype=wp.bool)
        finished: wp.array(dtype=wp.bool)
        final_observation: wp.array2d(dtype=wp.float32)  # of the rows that finished in the last step
        final_channels: wp.array2d(dtype=real)

    @wp.struct
    class Numbers:
        """Numbers that all rows share."""

        control_dt: wp.float64
        dt: wp.float64  # of the solver
        n_substeps: int
        n_iterations: int
        n_elements: int
        n_components: int
        n_steps: int
        n_sensors: int
        n_lags: int
        n_samples: int  # length of the sensor ring
        n_commands: int  # and of the command ring
        n_positions: int  # after which both rings stand alike again
        delay: int  # [solver steps]
        n_shown_filter: int
        n_shown_pending: int
        n_shown_draws: int
        keeps_final_channels: int

    return SimpleNamespace(Buffers=Buffers, Numbers=Numbers)


@cache
def kernels(form: Form) -> SimpleNamespace:
    """`advance` and `begin` of a form, compiled when first launched on a device."""
    wp = warp()
    real = getattr(wp, form.dtype)
    kinds = structures(form.dtype, form.sea)
    Buffers, Numbers = kinds.Buffers, kinds.Numbers
    # One module for both kernels: reading the compiler's headers is a good part of its work.
    spelled = "_".join(str(value) for value in astuple(form))
    module = wp.get_module(f"heave_env_{spelled}")
    # In single precision at most 128 registers a thread, so that a multiprocessor holds 512 rows at once, and
    # the 132 of an H200 the whole of a batch of 65,536.
    occupancy = (BLOCK, 4 if form.dtype == "float32" else 2)
    double, whole, word, long_word = wp.float64, wp.int32, wp.uint32, wp.uint64

    IS_FILTERED, IS_SUM = form.sea == FILTERED, form.sea == SINUSOIDS
    IS_CALM = form.sea == CALM
    N_FILTER = max(form.n_filter, 1)
    States = wp.types.vector(length=N_FILTER, dtype=real)
    Noise = wp.types.vector(length=4 * -(-N_FILTER // 4), dtype=real)
    Four = wp.types.vector(length=4, dtype=real)
    N_QUADS = -(-N_FILTER // 4)
    IS_LINEAR, HAS_CABLE, TENSION_ONLY = form.is_linear, not form.is_linear, form.tension_only
    IS_FREE, IS_LIMITED, IS_DRIVEN = (form.winch == kind for kind in (FREE, LIMITED, DRIVEN))
    SECOND_ORDER, AT_ONCE = form.second_order, form.accelerates_at_once
    LAGGING = not (form.second_order or form.accelerates_at_once)
    PAYS_OUT, COMPENSATED = form.pays_out, form.begins_compensated
    DELAY_VARIES, CHARGES_ENERGY = form.delay_varies, form.charges_energy

    zero, half, one, two = real(0.0), real(0.5), real(1.0), real(2.0)
    one_and_half, tiny, huge = real(1.5), real(1e-9), real(1e30)
    bound = real(OBSERVATION_BOUND)
    infinity = real(math.inf)
    nought, midway, turn = double(0.0), double(0.5), double(2.0 * math.pi)
    minus_two, per_word = double(-2.0), double(2.0**-32)
    unity, four_per_turn, quarter_turn = double(1.0), double(4.0), double(0.25)
    c2, c4, c6, c8, c10, c12, c14, c16 = (double((-1.0) ** i / math.factorial(2 * i)) for i in range(1, 9))
    s3, s5, s7, s9, s11, s13, s15 = (double((-1.0) ** i / math.factorial(2 * i + 1)) for i in range(1, 8))
    low_word, half_word = long_word(0xFFFFFFFF), long_word(32)
    factor_0, factor_1 = long_word(0xD2511F53), long_word(0xCD9E8D57)
    weyl_0, weyl_1 = word(0x9E3779B9), word(0xBB67AE85)
    sea_stream, sensor_stream, initial_stream = (word(stream << 24) for stream in (SEA, SENSORS, INITIAL))
    first_step, next_step = long_word(0), long_word(1)

    # Chance --------------------------------------------------------------------------------------

    @wp.struct
    class Words:
        a: word
        b: word
        c: word
        d: word

    @wp.func
    def philox(seed: long_word, episode: long_word, address: word, step: long_word):
        k0 = word(seed & low_word)
        k1 = word(seed >> half_word)
        c0 = word(step & low_word)
        c1 = word(episode & low_word)
        c2 = address
        c3 = word(step >> half_word)
        for _ in range(10):
            p0 = factor_0 * long_word(c0)
            p1 = factor_1 * long_word(c2)
            c0 = word(p1 >> half_word) ^ c1 ^ k0
            c1 = word(p1 & low_word)
            c2 = word(p0 >> half_word) ^ c3 ^ k1
            c3 = word(p0 & low_word)
            k0 = k0 + weyl_0
            k1 = k1 + weyl_1
        words = Words()
        words.a = c0
        words.b = c1
        words.c = c2
        words.d = c3
        return words

    @wp.func
    def uniform(number: word):
        return (double(number) + midway) * per_word

    @wp.func
    def radius_of(number: word):
        return wp.sqrt(minus_two * wp.log(uniform(number)))

    @wp.func
    def cosine_sine(turns: double):
        """cos and sin of 2π `turns`, from 0 to 1, by the series of `heave_env.streams`: the library's have a
        branch for huge angles, which would cost every thread registers and a stack."""
        quarter = wp.floor(four_per_turn * turns + midway)
        x = (turns - quarter_turn * quarter) * turn
        q = x * x
        c = unity + q * (c2 + q * (c4 + q * (c6 + q * (c8 + q * (c10 + q * (c12 + q * (c14 + q * c16)))))))
        s = x * (unity + q * (s3 + q * (s5 + q * (s7 + q * (s9 + q * (s11 + q * (s13 + q * s15)))))))
        which = int(quarter) & 3
        cosine = c
        sine = s
        if which == 1 or which == 3:
            cosine = s
            sine = c
        if which == 1 or which == 2:
            cosine = -cosine
        if which >= 2:
            sine = -sine
        return cosine, sine

    @wp.func
    def four_normals(seed: long_word, episode: long_word, address: word, step: long_word):
        w = philox(seed, episode, address, step)
        first = radius_of(w.a)
        second = radius_of(w.c)
        cosine, sine = cosine_sine(uniform(w.b))
        other_cosine, other_sine = cosine_sine(uniform(w.d))
        return Four(
            real(first * cosine),
            real(first * sine),
            real(second * other_cosine),
            real(second * other_sine),
        )

    # The sea -------------------------------------------------------------------------------------

    @wp.func
    def filter_noise(b: Buffers, e: int, stream: word, step: long_word):
        z = Noise()
        for quad in range(N_QUADS):
            four = four_normals(b.counters[SEED, e], b.counters[EPISODE, e], stream | word(quad), step)
            z[4 * quad] = four[0]
            z[4 * quad + 1] = four[1]
            z[4 * quad + 2] = four[2]
            z[4 * quad + 3] = four[3]
        return z

    @wp.func
    def filter_output(b: Buffers, x: States, p: int):
        at = 3 * N_FILTER * N_FILTER
        heave = real(0.0)
        rate = real(0.0)
        for i in range(N_FILTER):
            heave += real(b.sea[at + i, p]) * x[i]
            rate += real(b.sea[at + N_FILTER + i, p]) * x[i]
        return heave, rate

    @wp.func
    def filter_step(b: Buffers, e: int, p: int):
        x = States()
        for i in range(N_FILTER):
            x[i] = b.filter[i, e]
        z = filter_noise(b, e, sea_stream, b.counters[STEP, e])
        fresh = States()
        for i in range(N_FILTER):
            value = real(0.0)
            for j in range(N_FILTER):
                value += real(b.sea[i * N_FILTER + j, p]) * x[j]
            for j in range(N_FILTER):  # the root is triangular: beyond the diagonal stand zeros
                value += real(b.sea[N_FILTER * N_FILTER + i * N_FILTER + j, p]) * z[j]
            fresh[i] = value
        for i in range(N_FILTER):
            b.filter[i, e] = fresh[i]
        heave, rate = filter_output(b, fresh, p)
        return heave, rate

    @wp.func
    def begin_filter(b: Buffers, e: int, p: int):
        z = filter_noise(b, e, initial_stream, first_step)
        x = States()
        for i in range(N_FILTER):
            value = real(0.0)
            for j in range(N_FILTER):
                value += real(b.sea[2 * N_FILTER * N_FILTER + i * N_FILTER + j, p]) * z[j]
            x[i] = value
            b.filter[i, e] = value
        heave, rate = filter_output(b, x, p)
        return heave, rate

    @wp.func
    def sum_sinusoids(b: Buffers, c: Numbers, e: int, p: int, steps: double):
        heave = real(0.0)
        rate = real(0.0)
        time = steps * c.control_dt
        for i in range(c.n_components):
            amplitude = double(b.sea[2 * c.n_components + i, p])
            frequency = double(b.components[2 * i, e])
            turns = frequency * time + double(b.components[2 * i + 1, e])
            cosine, sine = cosine_sine(turns - wp.floor(turns))
            heave += real(amplitude * cosine)
            rate -= real(amplitude * turn * frequency * sine)
        return heave, rate

    @wp.func
    def begin_sinusoids(b: Buffers, c: Numbers, e: int, p: int):
        for i in range(c.n_components):
            address = initial_stream | word(i)
            w = philox(b.counters[SEED, e], b.counters[EPISODE, e], address, first_step)
            width = double(b.sea[c.n_components + i, p])
            omega = double(b.sea[i, p]) + width * uniform(w.a)
            b.components[2 * i, e] = real(omega / turn)
            b.components[2 * i + 1, e] = real(uniform(w.b))

    # The operation and the winch -----------------------------------------------------------------

    @wp.func
    def time_at_speed(time: double, running: double, ramp: double):
        now = wp.min(wp.max(time, nought), running)
        if ramp > nought:
            past = wp.min(wp.max(time - ramp, nought), running)
            area = midway * now * now + running * wp.max(time - running, nought)
            area -= midway * past * past + running * wp.max(time - ramp - running, nought)
            now = area / ramp
        return now

    @wp.func
    def paid_out(b: Buffers, c: Numbers, e: int, p: int, substep: int):
        """Rate over a solver step and what is out at its end."""
        speed = double(b.fixed[PAY_OUT_SPEED, p])
        running = double(b.fixed[PAY_OUT_TIME, p])
        ramp = double(b.fixed[PAY_OUT_RAMP, p])
        time = double(b.counters[STEP, e]) * c.control_dt + double(substep) * c.dt
        time -= double(b.fixed[PAY_OUT_START, p])
        old = time_at_speed(time, running, ramp)
        new = time_at_speed(time + c.dt, running, ramp)
        return real(speed * (new - old) / c.dt), real(speed * new)

    @wp.struct
    class Winch:
        """The drum over a solver step."""

        old: real
        displacement: real
        rate_start: real
        rate: real
        saturated: real

    @wp.func
    def stopped(
        b: Buffers, p: int, drum: Winch, new: real, start_rate: real, end_rate: real, saturated: bool
    ):
        stroke = b.fixed[STROKE_LIMIT, p]
        drum.old = drum.displacement
        drum.rate_start = start_rate
        drum.displacement = wp.max(wp.min(new, stroke), -stroke)
        drum.rate = end_rate
        if wp.abs(new) > stroke:
            drum.rate = zero
            drum.saturated = one
        if saturated:
            drum.saturated = one
        return drum

    @wp.func
    def free_winch(b: Buffers, p: int, drum: Winch, u0: real):
        K = b.fixed[WINCH_RATE_CONSTANT, p]
        error = u0 - drum.displacement
        gap = error * b.fixed[WINCH_DECAY, p]
        drum.old = drum.displacement
        drum.rate_start = K * error
        drum.displacement = u0 - gap
        drum.rate = K * gap
        return drum

    @wp.func
    def limited_winch(b: Buffers, p: int, drum: Winch, u0: real, dt: real):
        K = b.fixed[WINCH_RATE_CONSTANT, p]
        decay = b.fixed[WINCH_DECAY, p]
        fastest = b.fixed[SPEED_LIMIT, p]
        u = drum.displacement
        wanted = K * (u0 - u)
        saturated = wp.abs(wanted) > fastest
        start_rate = drum.rate
        end_rate = drum.rate
        new = u
        if AT_ONCE:
            gap = wp.abs(u0 - u)
            direction = wp.where(u0 > u, one, -one)
            ramp = fastest * dt
            linear_gap = gap - fastest / K
            if linear_gap <= zero:
                gap = gap * decay
            elif linear_gap >= ramp:
                gap = gap - ramp
            else:
                gap = fastest / K * wp.exp(-K * (dt - linear_gap / fastest))
            start_rate = direction * wp.min(wp.abs(wanted), fastest)
            end_rate = direction * wp.min(K * gap, fastest)
            new = u0 - direction * gap
        else:
            wanted = wp.max(wp.min(wanted * decay, fastest), -fastest)
            most = b.fixed[ACCELERATION_LIMIT, p] * dt
            change = wanted - start_rate
            saturated = saturated or wp.abs(change) > most
            end_rate = start_rate + wp.max(wp.min(change, most), -most)
            new = u + half * dt * (start_rate + end_rate)
        return stopped(b, p, drum, new, start_rate, end_rate, saturated)

    @wp.func
    def driven_winch(b: Buffers, p: int, drum: Winch, command: real, tension: real, dt: real):
        u = drum.displacement
        u0 = command
        quantum = b.fixed[COMMAND_STEP, p]
        fastest = b.fixed[SPEED_LIMIT, p]
        if quantum > zero:
            u0 = quantum * wp.floor(u0 / quantum + half)
        if wp.abs(u0 - u) <= b.fixed[DEAD_BAND, p]:
            u0 = u
        error = u - u0
        start_rate = drum.rate
        free = u0
        wanted = drum.rate
        if SECOND_ORDER:
            m = WINCH_TRANSITION
            free = u0 + b.fixed[m, p] * error + b.fixed[m + 1, p] * start_rate
            wanted = b.fixed[m + 2, p] * error + b.fixed[m + 3, p] * start_rate
        else:
            K = b.fixed[WINCH_RATE_CONSTANT, p]
            gap = error * b.fixed[WINCH_DECAY, p]
            free = u0 + gap
            wanted = -K * gap
            if AT_ONCE:
                start_rate = -K * error
        fastest = wp.min(fastest, b.fixed[POWER_LIMIT, p] / wp.max(wp.abs(tension), tiny))
        radius = b.fixed[DRUM_RADIUS, p]
        torque = b.fixed[TORQUE_LIMIT, p]
        per_inertia = radius / b.fixed[DRUM_INERTIA, p]
        steepest = b.fixed[ACCELERATION_LIMIT, p]
        most = wp.min(steepest, (torque - tension * radius) * per_inertia)
        least = wp.max(-steepest, (-torque - tension * radius) * per_inertia)
        least = wp.min(least, most)
        if AT_ONCE:
            start_rate = wp.max(wp.min(start_rate, fastest), -fastest)
        end_rate = wp.max(wp.min(wanted, fastest), -fastest)
        acceleration = wp.max(wp.min((end_rate - start_rate) / dt, most), least)
        end_rate = start_rate + acceleration * dt
        bitten = wp.abs(end_rate - wanted) > tiny * (one + wp.abs(wanted))
        new = free
        if bitten or LAGGING:
            new = u + half * dt * (start_rate + end_rate)
        return stopped(b, p, drum, new, start_rate, end_rate, bitten)

    # The cable -----------------------------------------------------------------------------------

    @wp.struct
    class Step:
        """What a solver step fixes for all nodes, and what it tells of tensions. Positive down."""

        speed: real  # L'
        convection: real  # L'/L at mid-step
        mass: real
        drag: real
        weight: real
        per_old: real  # one over the spacing of nodes
        per_mid: real
        stiffness: real
        damping: real
        beta: real  # 2 / dt
        per_dt: real
        first_difference: real
        second_difference: real
        sheave_gain: real  # to mid-step
        sheave_new: real

    @wp.struct
    class Tensions:
        top: real
        end: real
        least: real
        most: real

    @wp.func
    def law(s: Step, elongation: real, gained: real):
        """Of an element, mean tension and stiffness per elongation: T = tension + stiffness · gain."""
        old = elongation * s.per_old
        base = elongation * s.per_mid
        stiffness = s.stiffness + s.beta * s.damping
        tension = s.stiffness * base + s.beta * s.damping * (base - old)
        if TENSION_ONLY:
            to_middle = gained * s.per_mid
            new = two * (base + to_middle) - old
            taut_new = wp.max(new, zero)
            taut_old = wp.max(old, zero)
            crosses = (new > zero) != (old > zero)
            change = wp.where(crosses, new - old, one)
            stored = half * (taut_new * taut_new - taut_old * taut_old) / change
            mean = wp.where(crosses, stored, half * (taut_new + taut_old))
            slope = wp.where(new > zero, half, zero)
            slope = wp.where(crosses, (taut_new - stored) / change, slope)
            tension = s.stiffness * mean + s.damping * s.per_dt * (taut_new - taut_old)
            slope = s.stiffness * slope + wp.where(new > zero, s.damping * s.per_dt, zero)
            slope = wp.where(tension > zero, slope, zero)
            tension = wp.where(tension > zero, tension, zero)
            stiffness = two * slope
            tension = tension - stiffness * to_middle
        return tension, stiffness * s.per_mid

    @wp.func
    def trial_velocity(s: Step, g: real, gained: real, slope: real):
        return s.beta * gained + s.speed + g * s.convection * (s.first_difference * slope)

    @wp.func
    def eliminate(b: Buffers, n: int, e: int, p: int, s: Step, first: bool):
        """Passes down; returns the payload's gain to mid-step."""
        U_above = b.displacement[0, e]
        U = b.displacement[1, e]
        D_above = real(0.0)
        D = real(0.0)
        if not first:
            D_above = s.sheave_gain
            D = b.increment[1, e]
        tension_above, k_above = law(s, U - U_above, D - D_above)
        upper_above = real(0.0)
        load_above = s.sheave_gain + real(0.0)
        for j in range(1, n):
            U_below = b.displacement[j + 1, e]
            D_below = real(0.0)
            if not first:
                D_below = b.increment[j + 1, e]
            tension_below, k_below = law(s, U_below - U, D_below - D)
            g = real(n - j) / real(n)
            W = b.velocity[j, e]
            w = W
            if not first:
                w = trial_velocity(s, g, D, (U_below - U_above) + (D_below - D_above))
            gk = g * s.convection
            speed = wp.abs(w)
            drag_slope = two * s.drag * speed
            of_gradient = gk * (s.mass * (two * s.beta - s.convection) + drag_slope)
            of_curvature = s.mass * gk * gk
            gradient = s.first_difference * of_gradient
            curvature = s.second_difference * of_curvature
            lower = -k_above - gradient + curvature
            upper = -k_below + gradient + curvature
            diagonal = s.beta * (s.mass * s.beta + drag_slope) + (k_above + k_below) - two * curvature
            slope = s.first_difference * (U_below - U_above)
            bend = s.second_difference * ((U_below - U) - (U - U_above))
            load = (
                s.mass * s.beta * (W - s.speed)
                - drag_slope * s.speed
                - (of_gradient - s.mass * s.beta * gk) * slope
                - of_curvature * bend
                + s.weight
                + s.drag * speed * w
                + (tension_below - tension_above)
            )
            pivot = one / (diagonal - lower * upper_above)
            upper_above = upper * pivot
            load_above = (load - lower * load_above) * pivot
            b.upper[j, e] = upper_above
            b.load[j, e] = load_above
            U_above = U
            U = U_below
            D_above = D
            D = D_below
            tension_above = tension_below
            k_above = k_below
        mass = b.fixed[PAYLOAD_INERTIA, p] + half * s.mass
        drag = b.fixed[PAYLOAD_DRAG, p] + half * s.drag
        W = b.velocity[n, e]
        w = W
        if not first:
            w = s.beta * D + s.speed
        drag_slope = two * drag * wp.abs(w)
        load = (
            mass * s.beta * (W - s.speed)
            - drag_slope * s.speed
            + drag * wp.abs(w) * w
            + (b.fixed[PAYLOAD_WEIGHT, p] + half * s.weight - tension_above)
        )
        diagonal = s.beta * (mass * s.beta + drag_slope) + k_above
        return (load + k_above * load_above) / (diagonal + k_above * upper_above)

    @wp.func
    def substitute(b: Buffers, n: int, e: int, lowest: real):
        """Passes up between iterations, leaving every node's gain to mid-step."""
        D = lowest + real(0.0)
        b.increment[n, e] = D
        for i in range(1, n):
            j = n - i
            D = b.load[j, e] - b.upper[j, e] * D
            b.increment[j, e] = D

    @wp.func
    def move(b: Buffers, n: int, e: int, s: Step, lowest: real, first: bool, tensions: Tensions):
        """Passes up for the last time: moves the nodes on and reads the tensions off."""
        D_below = lowest + real(0.0)
        U_below = b.displacement[n, e]
        W = b.velocity[n, e]
        b.displacement[n, e] = U_below + two * D_below
        b.velocity[n, e] = two * (s.beta * D_below + s.speed) - W
        D_far = real(0.0)  # two nodes below
        U_far = real(0.0)
        before_below = real(0.0)  # what the iteration before had found
        if not first:
            before_below = b.increment[n, e]
        least = tensions.least
        most = tensions.most
        here = real(0.0)
        below = real(0.0)
        end = real(0.0)
        for i in range(1, n + 1):
            j = n - i
            U = b.displacement[j, e]
            D = s.sheave_gain + real(0.0)
            before = s.sheave_gain + real(0.0)
            if j > 0:
                D = b.load[j, e] - b.upper[j, e] * D_below
                if not first:
                    before = b.increment[j, e]
            if first:
                before = real(0.0)
            tension, stiffness = law(s, U_below - U, before_below - before)
            tension = tension + stiffness * (D_below - D)
            if TENSION_ONLY:
                tension = wp.where(tension > zero, tension, zero)
            least = wp.where(tension < least, tension, least)
            most = wp.where(tension > most, tension, most)
            below = here
            here = tension
            if i == 1:
                below = tension
            if i == 2:
                end = one_and_half * below - half * tension
            if i > 1:  # the node below has both its neighbours now
                g = real(i - 1) / real(n)
                w = trial_velocity(s, g, D_below, (U_far - U) + (D_far - D))
                W = b.velocity[j + 1, e]
                b.displacement[j + 1, e] = U_below + two * D_below
                b.velocity[j + 1, e] = two * w - W
            D_far = D_below
            U_far = U_below
            D_below = D
            U_below = U
            before_below = before
        b.displacement[0, e] = s.sheave_new
        if n == 1:
            end = here
        top = one_and_half * here - half * below
        if TENSION_ONLY:
            top = wp.max(top, zero)
            end = wp.max(end, zero)
        tensions.top = top
        tensions.end = end
        tensions.least = wp.min(least, wp.min(top, end))
        tensions.most = wp.max(most, wp.max(top, end))
        return tensions

    @wp.func
    def cable_step(
        b: Buffers, c: Numbers, e: int, p: int, z_old: real, z_new: real, L_old: real, L_new: real, V: real,
        tensions: Tensions,
    ):  # fmt: skip
        """Advances cable and payload by one solver step; sheave positive down."""
        n = c.n_elements
        h = real(1.0) / real(n)
        middle = half * (L_old + L_new)
        s = Step()
        s.speed = V
        s.convection = V / middle
        s.mass = b.fixed[CABLE_INERTIA, p] * middle * h
        s.drag = b.fixed[CABLE_DRAG, p] * middle * h
        s.weight = b.fixed[CABLE_WEIGHT, p] * middle * h
        s.per_old = one / (h * L_old)
        s.per_mid = one / (h * middle)
        s.stiffness = b.fixed[CABLE_STIFFNESS, p]
        s.damping = b.fixed[CABLE_DAMPING, p]
        s.beta = real(double(2.0) / c.dt)
        s.per_dt = real(double(1.0) / c.dt)
        s.first_difference = half * real(n)
        s.second_difference = real(n) * real(n)
        s.sheave_gain = half * (z_new - z_old)
        s.sheave_new = z_new
        lowest = eliminate(b, n, e, p, s, True)
        for _ in range(1, c.n_iterations):
            substitute(b, n, e, lowest)
            lowest = eliminate(b, n, e, p, s, False)
        return move(b, n, e, s, lowest, c.n_iterations == 1, tensions)

    @wp.func
    def hang_still(b: Buffers, c: Numbers, e: int, p: int, sheave: real, L: real):
        n = c.n_elements
        spacing = L / real(n)
        displacement = sheave + real(0.0)
        for j in range(n + 1):
            b.displacement[j, e] = displacement
            b.velocity[j, e] = zero
            tension = b.fixed[PAYLOAD_WEIGHT, p] + b.fixed[CABLE_WEIGHT, p] * spacing * (real(n - j) - half)
            displacement += tension * spacing / b.fixed[CABLE_STIFFNESS, p]

    @wp.func
    def payload_motion(b: Buffers, c: Numbers, e: int, p: int, u: real, payout: real, payout_rate: real):
        """Payload heave about its still-water position, and its rate."""
        reference = b.fixed[INITIAL_LENGTH, p] + payout
        w1 = b.fixed[CABLE_WEIGHT, p]
        w2 = b.fixed[PAYLOAD_WEIGHT, p]
        EA = b.fixed[CABLE_STIFFNESS, p]
        stretch = reference * (w2 + half * w1 * reference) / EA
        lengthening = one + (w2 + w1 * reference) / EA
        heave = u + stretch - b.displacement[c.n_elements, e]
        return heave, payout_rate * lengthening - b.velocity[c.n_elements, e]

    # Sensors -------------------------------------------------------------------------------------

    @wp.func
    def measure(b: Buffers, c: Numbers, e: int, p: int, position: int):
        place = (position % c.n_samples) * c.n_sensors
        z = Four()
        for s in range(c.n_sensors):
            if s % 4 == 0:
                address = sensor_stream | word(s / 4)
                z = four_normals(b.counters[SEED, e], b.counters[EPISODE, e], address, b.counters[STEP, e])
            noise = z[0]
            if s % 4 == 1:
                noise = z[1]
            elif s % 4 == 2:
                noise = z[2]
            elif s % 4 == 3:
                noise = z[3]
            truth = b.channels[b.measured[s], e]
            value = truth + b.readings[3 * s, p] * noise - b.readings[3 * s + 1, p]
            value = value * b.readings[3 * s + 2, p]
            # So written that no number at all becomes the bound.
            value = wp.where(value > -bound, value, -bound)
            value = wp.where(value < bound, value, bound)
            b.samples[place + s, e] = value

    @wp.func
    def observe(b: Buffers, c: Numbers, e: int, p: int, position: int):
        column = int(0)  # a variable, not a constant  # noqa: RUF046, UP018
        for i in range(c.n_lags):
            for s in range(c.n_sensors):
                age = b.lags[i] + b.ages[s]
                place = ((position + c.n_samples - age) % c.n_samples) * c.n_sensors + s
                b.observation[column, e] = wp.float32(b.samples[place, e])
                column += 1
        for i in range(c.n_shown_filter):
            b.observation[column, e] = wp.float32(b.filter[i, e])
            column += 1
        for i in range(c.n_shown_draws):
            b.observation[column, e] = wp.float32(b.draws[i, e])
            column += 1
        for i in range(c.n_shown_pending):
            place = (position + c.n_commands - 1 - i) % c.n_commands
            b.observation[column, e] = wp.float32(b.commands[place, e] / b.fixed[COMMAND_RANGE, p])
            column += 1

    # The two faces -------------------------------------------------------------------------------

    @wp.kernel(module=module, enable_backward=False, launch_bounds=occupancy)
    def advance(b: Buffers, c: Numbers, actions: wp.array(dtype=wp.float32)):
        """Advances a row by one control step; rows that finish leave their last observation behind."""
        e = wp.tid()
        p = wp.min(e, b.fixed.shape[1] - 1)
        dt = real(c.dt)
        position = b.clock[e]
        action = real(actions[e])
        clipped = action  # no number at all passes, and counts as diverged
        if action > one:
            clipped = one
        if action < -one:
            clipped = -one
        u0 = clipped * b.fixed[COMMAND_RANGE, p]
        b.commands[position % c.n_commands, e] = u0
        x0 = b.channels[BOOM_TIP_HEAVE, e]
        v0 = b.channels[BOOM_TIP_HEAVE_RATE, e]
        x1 = real(0.0)
        v1 = real(0.0)
        if IS_FILTERED:
            x1, v1 = filter_step(b, e, p)
        if IS_SUM:
            x1, v1 = sum_sinusoids(b, c, e, p, double(b.counters[STEP, e]) + double(1.0))
        if IS_CALM:
            x1 = x0
            v1 = v0
        drum = Winch()
        drum.displacement = b.channels[WINCH_DISPLACEMENT, e]
        drum.rate = b.channels[WINCH_RATE, e]
        drum.saturated = zero
        if wp.abs(action) >= one:
            drum.saturated = one
        x = b.channels[PAYLOAD_HEAVE, e]
        v = b.channels[PAYLOAD_HEAVE_RATE, e]
        L = b.channels[LENGTH, e]
        payout = b.channels[PAYOUT, e]
        payout_rate = real(0.0)
        tensions = Tensions()
        tensions.top = b.channels[SHEAVE_TENSION, e]
        tensions.end = b.channels[PAYLOAD_TENSION, e]
        tensions.least = infinity
        tensions.most = -infinity
        work = real(0.0)
        supply = real(0.0)
        moved = real(0.0)
        z_new = x0
        r_new = v0
        for substep in range(c.n_substeps):
            z_old = z_new
            r_old = r_new
            at = 8 * substep
            z_new = b.cubic[at] * x0 + b.cubic[at + 1] * v0 + b.cubic[at + 2] * x1 + b.cubic[at + 3] * v1
            r_new = b.cubic[at + 4] * x0 + b.cubic[at + 5] * v0 + b.cubic[at + 6] * x1 + b.cubic[at + 7] * v1
            if PAYS_OUT:
                payout_rate, payout = paid_out(b, c, e, p, substep)
            delay = c.delay
            if DELAY_VARIES:
                delay = whole(b.fixed[OWN_DELAY, p])
            steps_ago = whole(0)
            if delay > substep:
                steps_ago = (delay - substep + c.n_substeps - 1) / c.n_substeps
            acting = b.commands[(position + c.n_commands - steps_ago) % c.n_commands, e]
            if IS_FREE:
                drum = free_winch(b, p, drum, acting)
            if IS_LIMITED:
                drum = limited_winch(b, p, drum, acting, dt)
            if IS_DRIVEN:
                drum = driven_winch(b, p, drum, acting, tensions.top, dt)
            if IS_LINEAR:
                m = LINEAR_TRANSITION
                g = LINEAR_INPUT
                z0 = z_old + drum.old
                r0 = r_old + drum.rate_start
                z1 = z_new + drum.displacement
                r1 = r_new + drum.rate
                forced = b.fixed[g, p] * z0 + b.fixed[g + 1, p] * r0
                forced += b.fixed[g + 2, p] * z1 + b.fixed[g + 3, p] * r1
                forced_rate = b.fixed[g + 4, p] * z0 + b.fixed[g + 5, p] * r0
                forced_rate += b.fixed[g + 6, p] * z1 + b.fixed[g + 7, p] * r1
                new = b.fixed[m, p] * x + b.fixed[m + 1, p] * v + forced
                v = b.fixed[m + 2, p] * x + b.fixed[m + 3, p] * v + forced_rate
                x = new
                moved += wp.abs(drum.displacement - drum.old)
            if HAS_CABLE:
                hauled = drum.displacement - drum.old
                L_old = L
                L = b.fixed[INITIAL_LENGTH, p] + payout - drum.displacement
                V = payout_rate - hauled / dt
                tensions = cable_step(b, c, e, p, -z_old, -z_new, L_old, L, V, tensions)
                energy = tensions.top * hauled
                work += energy
                moved += wp.abs(energy)
                share = wp.where(energy > zero, b.fixed[SUPPLY_PER_WORK, p], b.fixed[RETURNED_SHARE, p])
                supply += energy * share
        slack = real(0.0)
        if HAS_CABLE:
            x, v = payload_motion(b, c, e, p, drum.displacement, payout, payout_rate)
            if tensions.least <= zero:
                slack = one
        per_step = real(double(1.0) / c.control_dt)
        b.channels[BOOM_TIP_HEAVE, e] = z_new
        b.channels[BOOM_TIP_HEAVE_RATE, e] = r_new
        b.channels[WINCH_DISPLACEMENT, e] = drum.displacement
        b.channels[WINCH_RATE, e] = drum.rate
        b.channels[SHEAVE_TENSION, e] = tensions.top
        b.channels[PAYLOAD_TENSION, e] = tensions.end
        b.channels[LENGTH, e] = L
        b.channels[PAYOUT, e] = payout
        b.channels[COMMAND, e] = u0
        b.channels[SATURATED, e] = drum.saturated
        b.channels[SLACK, e] = slack
        b.channels[TENSION_MIN, e] = tensions.least
        b.channels[TENSION_MAX, e] = tensions.most
        b.channels[WINCH_POWER, e] = work * per_step
        b.channels[SUPPLY_POWER, e] = supply * per_step

        limit = b.fixed[DIVERGENCE_LIMIT, p]
        fate = int(RUNNING)
        # Not (a < b) rather than a >= b: what is no number must count as diverged.
        if not (wp.abs(x) < limit and wp.abs(v) < limit):
            fate = DIVERGED
        elif HAS_CABLE:
            if not (tensions.most < b.fixed[BREAKING_STRENGTH, p]):
                fate = LOST
            elif L + b.displacement[c.n_elements, e] >= b.fixed[LANDING_DEPTH, p]:
                fate = LANDED
        if fate == DIVERGED:
            for channel in range(N_CHANNELS):
                if not (wp.abs(b.channels[channel, e]) < huge):
                    b.channels[channel, e] = zero
            x = zero
            v = zero
            u0 = b.channels[COMMAND, e]
        unsafe = real(0.0)
        if HAS_CABLE:
            unsafe += b.channels[SLACK, e]
            if b.channels[TENSION_MAX, e] > b.fixed[TENSION_LIMIT, p]:
                unsafe += one
        if wp.abs(b.channels[WINCH_DISPLACEMENT, e]) >= b.fixed[STROKE_LIMIT, p]:
            unsafe += one
        step = b.counters[STEP, e]
        remaining = real(wp.max(c.n_steps - int(step) - 1, 0))
        position_cost = b.fixed[POSITION_WEIGHT, p] * x * x
        command_cost = b.fixed[COMMAND_WEIGHT, p] * u0 * u0
        failure_cost = real(0.0)
        if fate == DIVERGED or fate == LOST:  # noqa: SIM109
            failure_cost = b.fixed[FAILURE_RATE, p] * remaining
        b.channels[PAYLOAD_HEAVE, e] = x
        b.channels[PAYLOAD_HEAVE_RATE, e] = v
        b.channels[POSITION_COST, e] = position_cost
        b.channels[COMMAND_COST, e] = command_cost
        b.channels[FAILURE_COST, e] = failure_cost
        b.channels[SAFETY_COST, e] = unsafe
        total = position_cost + command_cost + failure_cost
        if CHARGES_ENERGY:
            energy_cost = b.fixed[ENERGY_WEIGHT, p] * moved
            if fate == DIVERGED:
                energy_cost = zero
            b.channels[ENERGY_COST, e] = energy_cost
            total += energy_cost
        b.reward[e] = -total

        b.counters[STEP, e] = step + next_step
        position = (position + 1) % c.n_positions
        b.clock[e] = position
        measure(b, c, e, p, position)
        observe(b, c, e, p, position)
        terminated = fate != RUNNING
        truncated = int(step) + 1 >= c.n_steps and not terminated
        b.outcome[e] = fate
        b.terminated[e] = terminated
        b.truncated[e] = truncated
        finished = terminated or truncated
        b.finished[e] = finished
        if finished:
            for i in range(b.observation.shape[0]):
                b.final_observation[i, e] = b.observation[i, e]
            if c.keeps_final_channels == 1:
                for channel in range(N_CHANNELS):
                    b.final_channels[channel, e] = b.channels[channel, e]

    @wp.kernel(module=module, enable_backward=False, launch_bounds=occupancy)
    def begin(b: Buffers, c: Numbers, mask: wp.array(dtype=wp.bool), episodes: int):
        """Begins an episode in a masked row: `episodes` further on (0: the one in its counters)."""
        e = wp.tid()
        if not mask[e]:
            return
        p = wp.min(e, b.fixed.shape[1] - 1)
        position = b.clock[e]
        b.counters[EPISODE, e] = b.counters[EPISODE, e] + long_word(episodes)
        b.counters[STEP, e] = first_step
        x0 = real(0.0)
        v0 = real(0.0)
        if IS_FILTERED:
            x0, v0 = begin_filter(b, e, p)
        if IS_SUM:
            begin_sinusoids(b, c, e, p)
            x0, v0 = sum_sinusoids(b, c, e, p, nought)
        u = real(0.0)
        rate = real(0.0)
        command = real(0.0)
        if COMPENSATED:
            most = b.fixed[COMMAND_RANGE, p]
            fastest = b.fixed[SPEED_LIMIT, p]
            reach = wp.min(b.fixed[STROKE_LIMIT, p], most)
            u = wp.max(wp.min(-x0, reach), -reach)
            rate = wp.max(wp.min(-v0, fastest), -fastest)
            command = wp.max(wp.min(u + rate / b.fixed[WINCH_RATE_CONSTANT, p], most), -most)
        for channel in range(N_CHANNELS):
            b.channels[channel, e] = zero
        x = x0 + u
        v = real(0.0)
        if HAS_CABLE:
            L = b.fixed[INITIAL_LENGTH, p] - u
            hang_still(b, c, e, p, -x0, L)
            x, v = payload_motion(b, c, e, p, u, zero, zero)
            end = b.fixed[PAYLOAD_WEIGHT, p]
            top = end + b.fixed[CABLE_WEIGHT, p] * L
            b.channels[LENGTH, e] = L
            b.channels[SHEAVE_TENSION, e] = top
            b.channels[PAYLOAD_TENSION, e] = end
            b.channels[TENSION_MIN, e] = end
            b.channels[TENSION_MAX, e] = top
        b.channels[BOOM_TIP_HEAVE, e] = x0
        b.channels[BOOM_TIP_HEAVE_RATE, e] = v0
        b.channels[WINCH_DISPLACEMENT, e] = u
        b.channels[WINCH_RATE, e] = rate
        b.channels[PAYLOAD_HEAVE, e] = x
        b.channels[PAYLOAD_HEAVE_RATE, e] = v
        for i in range(c.n_commands):
            b.commands[i, e] = command
        # Before the episode the sensors are taken to have read what they read now.
        measure(b, c, e, p, position)
        now = (position % c.n_samples) * c.n_sensors
        for past in range(c.n_samples):
            for s in range(c.n_sensors):
                b.samples[past * c.n_sensors + s, e] = b.samples[now + s, e]
        observe(b, c, e, p, position)

    return SimpleNamespace(advance=advance, begin=begin, Buffers=Buffers, Numbers=Numbers)
