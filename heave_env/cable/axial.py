"""1-D cable of varying length with a payload: the environment's own cable.

Inside this module positive is DOWN for displacement, velocity and sheave heave; the kernel converts
at the door. s is the material coordinate measured up from the payload, L(t) the unstretched length
outboard, y = 1 - s/L in [0, 1] (0 sheave, 1 payload), X = L - s + U the position, W the absolute
velocity of the material:

    cable    (m + m_a) DW/Dt = ∂T/∂y / L + w1 - (π/2) ρ d C_t |W| W
    payload  (M_s + M_a) DW/Dt = w2 - T(1) - (1/2) ρ S C_d |W| W
    sheave   U(0) = R(t)
    tension  T = EA e + C_A De/Dt,  e = ∂U/∂y / L  (and T = 0 where that is not positive, if the cable
             is tension-only)

On the fixed grid D/Dt = ∂/∂t + (1 - y)(L'/L) ∂/∂y, which is zero at the payload. Both position and
velocity are carried, so L' may jump and L'' never appears: a step knows only how much cable went out.

Source: Huang (1992), chapter 3, in the material form: his (3.1)-(3.7) lack the convective terms.

The model stops holding where lateral motion matters (currents, a towed cable) and where the payload
meets the sheave. Convection is left out of the Kelvin term, where it is below 1 N.

Scheme: the implicit midpoint rule with a finite-volume grid in y (half a cell of cable goes with the
payload). Second order in time and space, unconditionally stable, without algorithmic damping; drag is
linearised by Newton about the last velocity. Each step is one tridiagonal solve per iteration. A
linear cable wants one iteration; a tension-only one several, and Kelvin damping of some milliseconds
(C_A = EA · 5 ms): without it the chain does not settle as the grid is refined. The environment's kernel
counts its iterations; `AxialSolver` watches those of a tension-only cable settle, and halves a step that
does not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numba import njit
from numba.extending import overload

from heave_env.cable.constitutive import (
    branch_after,
    rope_energy_coefficients,
    rope_tension,
    static_strain,
    strain_of,
    taut_tension,
)
from heave_env.cable.convergence import ConvergenceError
from heave_env.compiled import seldom, source_fingerprint, stage
from heave_env.lanes import (
    ALIGNMENT,
    absolute,
    align_stack,
    block_at,
    constant,
    fused,
    lane,
    lanes_of,
    maximum,
    minimum,
    n_lanes_of,
    numbers_from,
    pair,
    swapped,
    where,
)
from heave_env.layout import (
    CABLE_CUBIC,
    CABLE_DAMPING,
    CABLE_DRAG,
    CABLE_INERTIA,
    CABLE_QUADRATIC,
    CABLE_STIFFNESS,
    CABLE_WEIGHT,
    CONVECTION,
    DISPLACEMENT,
    ELEMENT_STIFFNESS,
    ELEMENT_TENSION,
    INCREMENT,
    LENGTH,
    LENGTH_OLD,
    LENGTH_SPEED,
    LOADED,
    N_FIXED,
    N_NODE_FIELDS,
    N_SCRATCH,
    N_WORK_FIELDS,
    NODE_DRAG,
    NODE_MASS,
    NODE_WEIGHT,
    PAYLOAD_DRAG,
    PAYLOAD_INERTIA,
    PAYLOAD_TENSION,
    PAYLOAD_WEIGHT,
    PER_MID_SPACING,
    PER_OLD_SPACING,
    RELAXATION_RATE,
    RELAXING_SHARE,
    RELAXING_STIFFNESS,
    SHARE,
    SHEAVE_NEW,
    SHEAVE_OLD,
    SHEAVE_TENSION,
    SLACK,
    TENSION_MAX,
    TENSION_MIN,
    TRIAL_VELOCITY,
    VELOCITY,
)
from heave_env.parameters import Cable, Payload, require, require_integer, require_number

Array = np.ndarray

_MOST_ITERATIONS = 40  # of a tension-only cable, before its step is halved
_MOST_PIECES = 1024  # that a step is halved into
_SETTLED = 1e-9  # change of a velocity within an iteration, relative to the fastest or to 1 m/s


@stage
def _begin_step(S, W, n_elements):
    """What the step's two lengths fix once for all iterations: convection, mass, drag, weight, spacings."""
    h, n, one = constant(S, 1.0 / n_elements), constant(S, float(n_elements)), constant(S, 1.0)
    old, new = W[LENGTH_OLD], S[LENGTH]
    middle = constant(S, 0.5) * (old + new)
    spacing, per_middle = h * middle, one / middle
    W[CONVECTION] = W[LENGTH_SPEED] * per_middle
    W[NODE_MASS] = S[CABLE_INERTIA] * spacing
    W[NODE_DRAG] = S[CABLE_DRAG] * spacing
    W[NODE_WEIGHT] = S[CABLE_WEIGHT] * spacing
    W[PER_OLD_SPACING] = n / old
    W[PER_MID_SPACING] = n * per_middle


@stage
def _strains(S, W, j, nodes, work, first):
    """Old and new strain of the element below node j, and what it gains to mid-step."""
    here, element = nodes + N_NODE_FIELDS * j, work + N_WORK_FIELDS * j
    elongation = S[here + N_NODE_FIELDS + DISPLACEMENT] - S[here + DISPLACEMENT]
    gained = constant(S, 0.0)
    if not first:
        gained = (W[element + N_WORK_FIELDS + INCREMENT] - W[element + INCREMENT]) * W[PER_MID_SPACING]
    old = elongation * W[PER_OLD_SPACING]
    # The old elongation on the cable's length at mid-step is the strain without any increment.
    return old, constant(S, 2.0) * (elongation * W[PER_MID_SPACING] + gained) - old, gained


@seldom
def _constitutive_pass(S, W, nodes, work, n_elements, dt, tension_only, hookean, first):
    """Linearised law of each element about the trial state: T = tension + stiffness · (D_{j+1} - D_j).

    T is the mean over the step, D the displacement gained to mid-step. For cables that are not linear; what
    the Maxwell branches of a rope hold stands in rows behind the nodes.
    """
    align_stack()
    per_dt, half_step = constant(S, 1.0 / dt), constant(S, 0.5 * dt)
    one, two = constant(S, 1.0), constant(S, 2.0)
    EA, CA, per_spacing = S[CABLE_STIFFNESS], S[CABLE_DAMPING], W[PER_MID_SPACING]
    share = one / (one + half_step * S[RELAXATION_RATE])
    W[RELAXING_SHARE] = share
    branches = nodes + N_NODE_FIELDS * (n_elements + 1)
    for j in range(n_elements):
        old, new, gained = _strains(S, W, j, nodes, work, first)
        if hookean:
            tension, slope = taut_tension(old, new, EA, CA, per_dt)
        else:
            tension, slope, _ = rope_tension(
                old,
                new,
                S[branches + j],
                EA,
                S[CABLE_QUADRATIC],
                S[CABLE_CUBIC],
                S[RELAXING_STIFFNESS],
                share,
                CA,
                per_dt,
                tension_only,
            )
        stiffness = two * slope
        element = work + N_WORK_FIELDS * j
        W[element + ELEMENT_STIFFNESS] = stiffness * per_spacing
        W[element + ELEMENT_TENSION] = tension - stiffness * gained


@seldom
def _relax(S, W, nodes, work, n_elements, tension_only):
    """Moves what the Maxwell branches hold on to the end of the step, before the nodes move."""
    align_stack()
    zero, share, branches = constant(S, 0.0), W[RELAXING_SHARE], nodes + N_NODE_FIELDS * (n_elements + 1)
    EA, quadratic, cubic, EA1 = S[CABLE_STIFFNESS], S[CABLE_QUADRATIC], S[CABLE_CUBIC], S[RELAXING_STIFFNESS]
    for j in range(n_elements):
        old, new, _ = _strains(S, W, j, nodes, work, False)
        held = S[branches + j]
        _, _, middle = rope_tension(
            old, new, held, EA, quadratic, cubic, EA1, share, zero, zero, tension_only
        )
        S[branches + j] = branch_after(old, new, held, middle, EA, quadratic, cubic, EA1, share, tension_only)


@stage
def _linear_law(S, W, dt):
    """Stiffness k and damping d of every element of a linear cable, per elongation.

    With e the elongation before the step and D the displacement gained to mid-step, the element's mean
    tension is k (e + D_{j+1} - D_j) - d e.
    """
    damping = constant(S, 2.0 / dt) * S[CABLE_DAMPING]
    return (S[CABLE_STIFFNESS] + damping) * W[PER_MID_SPACING], damping * W[PER_OLD_SPACING]


def _both(like, block, a, b):
    """Two rows of a block, or numbers of a table, in the two lanes of a pair; of a batch, the first alone.

    A single environment computes the two ends of its cable side by side, a batch one after the other.
    """


@overload(_both, jit_options={"error_model": "numpy", "forceinline": True})
def _both_of(like, block, a, b):
    if like.n_lanes == 1:
        return lambda like, block, a, b: pair(block[a], block[b])
    if block.n_lanes == 1:
        return lambda like, block, a, b: constant(like, block[a])
    return lambda like, block, a, b: block[a]


def _leave(block, a, b, values):
    """Writes what `_both` reads."""


@overload(_leave, jit_options={"error_model": "numpy", "forceinline": True})
def _leave_of(block, a, b, values):
    def one(block, a, b, values):
        block[a] = values

    def two(block, a, b, values):
        block[a] = lane(values, 0)
        block[b] = lane(values, 1)

    return two if block.n_lanes == 1 else one


@stage
def _balance(numbers, g, g_squared, w, velocity, e_before, e_next, law, is_linear):
    """Momentum balance of a node in the increments D: what multiplies D before and behind it (with the sign
    reversed), the diagonal, and the load; all divided by what is about the diagonal of a linear cable.

    W̄ = β D + V + gκ Ū_y at mid-step, and DW/Dt = β (W̄ - W) + gκ ∂W̄/∂y with the compact Ū_yy; `w` is the
    velocity that drag is linearised about. Increments, not displacements: the forces that balance at rest
    then cancel before they are multiplied by M/dt², which is what makes single precision good enough.

    The cable is gone through downwards. Upwards all is the same with the signs of g, of the elongations
    `e_before` and `e_next` and of the pull in `law` reversed.
    """
    (
        inertia,
        momentum,
        steady,
        drag,
        carried_drag,
        damping_drag,
        of_mass,
        of_drag,
        carried,
        curving,
        k,
        k_pulling,
    ) = numbers
    speed = absolute(w)
    gradient = g * fused(of_drag, speed, of_mass)
    bend = e_next - e_before
    if is_linear:
        stiff = fused(-g_squared, curving, k)
        back, onward = stiff + gradient, stiff - gradient
        load = fused(fused(-g_squared, curving, k_pulling), bend, steady)
        diagonal = fused(constant(w, 2.0), stiff, inertia)
    else:
        k_before, k_next, pull = law
        curvature = g_squared * curving
        k_before, k_next = k_before - curvature, k_next - curvature
        back, onward = k_before + gradient, k_next - gradient
        load = fused(-curvature, bend, steady) + pull
        diagonal = inertia + (k_before + k_next)
    # Drag linearised about w: its slope times the velocity, less what that counts too much.
    diagonal = fused(damping_drag, speed, diagonal)
    load = fused(speed, fused(drag, w, carried_drag), fused(momentum, velocity, load))
    load = fused(fused(g, carried, -gradient), e_before + e_next, load)
    return back, onward, diagonal, load


@stage
def _eliminate(chain, back, onward, diagonal, load):
    """One node more of a chain that is eliminated from an end of the cable.

    With (det, passed, charge) of a chain the increment of its last node is (charge + passed · that of the
    node beyond) / det. Nothing waits for a division: all three may grow, and be divided by whatever they are.
    """
    det, passed, charge = chain
    new_det = fused(diagonal, det, -(back * passed))
    return new_det, onward * det, fused(back, charge, load * det)


@stage
def _divided(W, work, a, b, chain, per_det):
    """Leaves the share and the load of a chain's last node, and returns the chain divided by its `det`."""
    _, passed, charge = chain
    share, loaded = passed * per_det, charge * per_det
    own, other = work + N_WORK_FIELDS * a, work + N_WORK_FIELDS * b
    _leave(W, own + SHARE, other + SHARE, share)
    _leave(W, own + LOADED, other + LOADED, loaded)
    return constant(share, 1.0), share, loaded


@stage
def _next(S, W, table, numbers, scale, sign, a, b, away, nodes, work, U, e, chain, is_linear, first):
    """One node more of a chain at node a, or of a pair's two chains; `away` is where the chain goes, 1 down.

    Returns the displacement of the node beyond, the elongation of the element between (the chain's way), and
    the chain.
    """
    U_next = _both(
        S,
        S,
        nodes + N_NODE_FIELDS * (a + away) + DISPLACEMENT,
        nodes + N_NODE_FIELDS * (b - away) + DISPLACEMENT,
    )
    e_next = U_next - U
    g = sign * _both(S, table, 2 * a, 2 * b)
    g_squared = _both(S, table, 2 * a + 1, 2 * b + 1)
    velocity = _both(S, S, nodes + N_NODE_FIELDS * a + VELOCITY, nodes + N_NODE_FIELDS * b + VELOCITY)
    w, law = velocity, (scale, scale, scale)
    own, other = work + N_WORK_FIELDS * a, work + N_WORK_FIELDS * b
    if not first:
        w = _both(S, W, own + TRIAL_VELOCITY, other + TRIAL_VELOCITY)
    if not is_linear:
        # The elements before and behind: of node a, those above and below if it is gone through downwards.
        up, down = N_WORK_FIELDS * ((1 + away) // 2), N_WORK_FIELDS * ((1 - away) // 2)
        k_before = _both(S, W, own - up + ELEMENT_STIFFNESS, other - down + ELEMENT_STIFFNESS)
        k_next = _both(S, W, own - down + ELEMENT_STIFFNESS, other - up + ELEMENT_STIFFNESS)
        pull = _both(S, W, own - down + ELEMENT_TENSION, other - up + ELEMENT_TENSION)
        pull = pull - _both(S, W, own - up + ELEMENT_TENSION, other - down + ELEMENT_TENSION)
        law = scale * k_before, scale * k_next, scale * (sign * pull)
    back, onward, diagonal, load = _balance(numbers, g, g_squared, w, velocity, e, e_next, law, is_linear)
    return U_next, e_next, _eliminate(chain, back, onward, diagonal, load)


@stage
def _in_pairs(like, numbers):
    """Twelve numbers, each in both lanes of a pair."""
    a, b, c, d, e, f, g, h, i, j, k, m = numbers
    first = constant(like, a), constant(like, b), constant(like, c), constant(like, d)
    second = constant(like, e), constant(like, f), constant(like, g), constant(like, h)
    third = constant(like, i), constant(like, j), constant(like, k), constant(like, m)
    return first + second + third


def _eliminate_pairs(
    S, W, table, numbers, scale, nodes, work, n_elements, upper, lower, U, e, is_linear, first
):
    """Eliminates from both ends as long as both chains have a node left before the middle.

    `U` and `e` are of the two chains: where the next node stands, and the elongation before it (each chain's
    way). The chains are divided every eight nodes, but at each if the cable is not linear: an element's
    stiffness may then be nothing beside that of the next. Returns both chains and the two elongations.
    """


@overload(_eliminate_pairs, jit_options={"error_model": "numpy", "forceinline": True})
def _eliminate_pairs_of(
    S, W, table, numbers, scale, nodes, work, n_elements, upper, lower, U, e, is_linear, first
):
    def beside(S, W, table, numbers, scale, nodes, work, n_elements, upper, lower, U, e, is_linear, first):
        n_pairs, pattern = n_elements - (n_elements + 1) // 2, 7 if is_linear else 0
        U, e, sign = pair(U[0], U[1]), pair(e[0], e[1]), pair(constant(S, 1.0), constant(S, -1.0))
        numbers, scale, one = _in_pairs(U, numbers), constant(U, scale), constant(U, 1.0)
        chain = pair(upper[0], lower[0]), pair(upper[1], lower[1]), pair(upper[2], lower[2])
        for i in range(1, n_pairs):
            j = n_elements - i
            U, e, chain = _next(
                S, W, table, numbers, scale, sign, i, j, 1, nodes, work, U, e, chain, is_linear, first
            )
            other = swapped(chain[0])
            short = _divided(W, work, i, j, chain, one / (chain[0] * other) * other)
            if i & pattern == 0:
                chain = short
        det, passed, charge = chain
        upper, lower = (
            (lane(det, 0), lane(passed, 0), lane(charge, 0)),
            (
                lane(det, 1),
                lane(passed, 1),
                lane(charge, 1),
            ),
        )
        return upper, lower, (lane(U, 0), lane(U, 1)), (lane(e, 0), lane(e, 1))

    def in_turn(S, W, table, numbers, scale, nodes, work, n_elements, upper, lower, U, e, is_linear, first):
        n_pairs, pattern = n_elements - (n_elements + 1) // 2, 7 if is_linear else 0
        one, minus_one = constant(S, 1.0), constant(S, -1.0)
        U_above, U_below, e_above, e_below = U[0], U[1], e[0], e[1]
        for i in range(1, n_pairs):
            j = n_elements - i
            U_above, e_above, upper = _next(
                S, W, table, numbers, scale, one, i, i, 1, nodes, work, U_above, e_above, upper, is_linear,
                first,
            )  # fmt: skip
            U_below, e_below, lower = _next(
                S, W, table, numbers, scale, minus_one, j, j, -1, nodes, work, U_below, e_below, lower,
                is_linear, first,
            )  # fmt: skip
            per_both = one / (upper[0] * lower[0])
            short_upper = _divided(W, work, i, i, upper, per_both * lower[0])
            short_lower = _divided(W, work, j, j, lower, per_both * upper[0])
            if i & pattern == 0:
                upper, lower = short_upper, short_lower
        return upper, lower, (U_above, U_below), (e_above, e_below)

    return beside if S.n_lanes == 1 else in_turn


@stage
def _forward_pass(S, W, table, nodes, work, n_elements, dt, is_linear, first):
    """Assembles the momentum balances and eliminates from both ends to the middle, whose increment it finds.

    Two chains side by side (twisted elimination), each half as long, share their divisions.
    """
    h, middle = 1.0 / n_elements, (n_elements + 1) // 2
    beta, V, kappa = constant(S, 2.0 / dt), W[LENGTH_SPEED], W[CONVECTION]
    zero, half, one, two = constant(S, 0.0), constant(S, 0.5), constant(S, 1.0), constant(S, 2.0)
    k, damping = _linear_law(S, W, dt)
    scale = one / fused(W[NODE_MASS], beta * beta, two * k)
    mass, drag, weight = scale * W[NODE_MASS], scale * W[NODE_DRAG], scale * W[NODE_WEIGHT]
    k, damping = scale * k, scale * damping
    momentum, difference = mass * beta, kappa * constant(S, 0.5 / h)
    numbers = (
        momentum * beta,
        momentum,
        weight - momentum * V,
        drag,
        -(two * drag * V),
        two * drag * beta,
        difference * mass * (two * beta - kappa),
        difference * (two * drag),
        difference * momentum,
        constant(S, 1.0 / (h * h)) * mass * kappa * kappa,
        k,
        k - damping,
    )
    # The sheave's increment is given; the payload has no node below.
    top = half * (W[SHEAVE_NEW] - W[SHEAVE_OLD])
    W[work + SHARE], W[work + LOADED] = zero, top
    bottom, last = nodes + N_NODE_FIELDS * n_elements, work + N_WORK_FIELDS * n_elements
    U_below, velocity = S[bottom - N_NODE_FIELDS + DISPLACEMENT], S[bottom + VELOCITY]
    # Upwards, as the lower chain goes: minus the elongation.
    e_below = U_below - S[bottom + DISPLACEMENT]
    w = velocity if first else W[last + TRIAL_VELOCITY]
    payload_momentum = beta * fused(half, mass, scale * S[PAYLOAD_INERTIA])
    drag_slope = two * fused(half, drag, scale * S[PAYLOAD_DRAG]) * absolute(w)
    load = fused(half, weight, scale * S[PAYLOAD_WEIGHT])
    if is_linear:
        k_last = k
        load = fused(k - damping, e_below, load)
    else:
        k_last = scale * W[last - N_WORK_FIELDS + ELEMENT_STIFFNESS]
        load = load - scale * W[last - N_WORK_FIELDS + ELEMENT_TENSION]
    load = fused(payload_momentum, velocity - V, load)
    load = fused(drag_slope, fused(half, w, -V), load)
    diagonal = fused(beta, payload_momentum + drag_slope, k_last)
    at_middle = work + N_WORK_FIELDS * middle + INCREMENT
    if n_elements == 1:
        W[at_middle] = fused(k_last, top, load) / diagonal
        return
    upper, lower = (one, zero, top), (diagonal, k_last, load)
    per_det = one / diagonal
    W[last + SHARE], W[last + LOADED] = k_last * per_det, load * per_det
    U_above = S[nodes + N_NODE_FIELDS + DISPLACEMENT]
    e_above = U_above - S[nodes + DISPLACEMENT]
    upper, lower, U, e = _eliminate_pairs(
        S,
        W,
        table,
        numbers,
        scale,
        nodes,
        work,
        n_elements,
        upper,
        lower,
        (U_above, U_below),
        (e_above, e_below),
        is_linear,
        first,
    )
    U_above, e_above = U[0], e[0]
    # The middle, and before it what is left of the upper chain if the elements are odd in number.
    n_left = 2 * middle - n_elements
    for j in range(middle - n_left, middle + 1):
        here, element = nodes + N_NODE_FIELDS * j, work + N_WORK_FIELDS * j
        g, g_squared = constant(S, table[2 * j]), constant(S, table[2 * j + 1])
        velocity = S[here + VELOCITY]
        w, law = velocity, (scale, scale, scale)
        if not first:
            w = W[element + TRIAL_VELOCITY]
        if not is_linear:
            pull = W[element + ELEMENT_TENSION] - W[element - N_WORK_FIELDS + ELEMENT_TENSION]
            k_above = scale * W[element - N_WORK_FIELDS + ELEMENT_STIFFNESS]
            law = k_above, scale * W[element + ELEMENT_STIFFNESS], scale * pull
        e_next = S[here + N_NODE_FIELDS + DISPLACEMENT] - S[here + DISPLACEMENT]
        above, below, diagonal, load = _balance(
            numbers, g, g_squared, w, velocity, e_above, e_next, law, is_linear
        )
        if j < middle:
            upper = _eliminate(upper, above, below, diagonal, load)
            per_det, passed, charge = one / upper[0], upper[1], upper[2]
            upper = one, passed * per_det, charge * per_det
            W[element + SHARE], W[element + LOADED] = upper[1], upper[2]
            e_above = e_next
        else:
            above, below, both = above * lower[0], below * upper[0], upper[0] * lower[0]
            load = fused(below, lower[2], fused(above, upper[2], load * both))
            diagonal = fused(-below, lower[1], fused(-above, upper[1], diagonal * both))
            W[at_middle] = load / diagonal


@stage
def _backward_pass(W, work, n_elements):
    """Substitutes from the middle outwards for the increments to mid-step, and leaves them all."""
    middle = (n_elements + 1) // 2
    below = above = W[work + N_WORK_FIELDS * middle + INCREMENT]
    for j in range(middle + 1, n_elements + 1):
        element = work + N_WORK_FIELDS * j
        below = fused(W[element + SHARE], below, W[element + LOADED])
        W[element + INCREMENT] = below
    for j in range(middle - 1, -1, -1):
        element = work + N_WORK_FIELDS * j
        above = fused(W[element + SHARE], above, W[element + LOADED])
        W[element + INCREMENT] = above


@stage
def _middle_velocity(numbers, g, increment, elongations):
    """Twice the velocity at mid-step; `elongations` is that of both elements beside the node, at mid-step."""
    twice_beta, twice_V, twice_difference = numbers
    return fused(twice_beta, increment, fused(g * twice_difference, elongations, twice_V))


@stage
def _velocity_numbers(S, W, n_elements, dt):
    V = W[LENGTH_SPEED]
    return constant(S, 4.0 / dt), V + V, W[CONVECTION] * constant(S, float(n_elements))


@stage
def _trial_velocities(S, W, table, nodes, work, n_elements, dt):
    """The velocities at mid-step that go with the increments, for the next iteration."""
    half, numbers = constant(S, 0.5), _velocity_numbers(S, W, n_elements, dt)
    for j in range(1, n_elements):
        here, element = nodes + N_NODE_FIELDS * j, work + N_WORK_FIELDS * j
        gained = W[element + N_WORK_FIELDS + INCREMENT] - W[element - N_WORK_FIELDS + INCREMENT]
        old = S[here + N_NODE_FIELDS + DISPLACEMENT] - S[here - N_NODE_FIELDS + DISPLACEMENT]
        g = constant(S, table[2 * j])
        W[element + TRIAL_VELOCITY] = half * _middle_velocity(
            numbers, g, W[element + INCREMENT], old + gained
        )
    last, zero = work + N_WORK_FIELDS * n_elements, constant(S, 0.0)
    W[last + TRIAL_VELOCITY] = half * _middle_velocity(numbers, zero, W[last + INCREMENT], zero)


@stage
def _element_tension(W, element, elongation, middle, gained, damped, tension_only, is_linear):
    """Mean tension over the step of the element at a row of W, over its stiffness if the cable is linear.

    Of its elongations before the step and at mid-step, and of what it gains; `damped` is damping over
    stiffness.
    """
    if is_linear:
        return fused(-damped, elongation, middle)
    tension = fused(W[element + ELEMENT_STIFFNESS], gained, W[element + ELEMENT_TENSION])
    return maximum(tension, constant(W, 0.0)) if tension_only else tension


@stage
def _unit_and_damping(S, W, dt, is_linear):
    """What `_element_tension` is in units of, and its `damped`."""
    unit, damped = constant(S, 1.0), constant(S, 0.0)
    if is_linear:
        unit, damping = _linear_law(S, W, dt)
        damped = damping / unit
    return unit, damped


@stage
def _end_tension(S, nearest, second, tension_only):
    """Tension at an end of the cable, extrapolated linearly from the middles of the two nearest elements."""
    tension = constant(S, 1.5) * nearest - constant(S, 0.5) * second
    return maximum(tension, constant(S, 0.0)) if tension_only else tension


@stage
def solved_sheave_tension(S, W, nodes, work, n_elements, dt, tension_only, hookean):
    """Tension at the sheave over the step that `cable_solve` found."""
    is_linear = hookean and not tension_only
    unit, damped = _unit_and_damping(S, W, dt, is_linear)
    nearest = second = constant(S, 0.0)
    for j in range(min(1, n_elements - 1), -1, -1):
        here, element = nodes + N_NODE_FIELDS * j, work + N_WORK_FIELDS * j
        elongation = S[here + N_NODE_FIELDS + DISPLACEMENT] - S[here + DISPLACEMENT]
        gained = W[element + N_WORK_FIELDS + INCREMENT] - W[element + INCREMENT]
        second = nearest
        nearest = _element_tension(
            W, element, elongation, elongation + gained, gained, damped, tension_only, is_linear
        )
    if n_elements == 1:
        second = nearest
    return _end_tension(S, unit * nearest, unit * second, tension_only)


@stage
def element_stiffness(S, W, work, dt, tension_only, hookean):
    """Stiffness of the element at the sheave as `cable_solve` saw it last [N/m]."""
    k, _ = _linear_law(S, W, dt)
    return k if hookean and not tension_only else W[work + ELEMENT_STIFFNESS]


@stage
def _show_tensions(S, top, end, least, most):
    """Tensions at the two ends, and the extremes along the cable so far."""
    zero = constant(S, 0.0)
    S[SHEAVE_TENSION], S[PAYLOAD_TENSION] = top, end
    least, most = minimum(least, minimum(top, end)), maximum(most, maximum(top, end))
    S[TENSION_MIN], S[TENSION_MAX] = least, most
    S[SLACK] = where(least <= zero, constant(S, 1.0), zero)


@stage
def tension_rows(nodes, n_elements, hookean):
    """The row of the first element's tension, where they are kept."""
    return nodes + N_NODE_FIELDS * (n_elements + 1) + (0 if hookean else n_elements)


@stage
def _one_on(
    S, W, table, numbers, sign, a, b, away, nodes, work, moving, found, damped, unit, kept, tension_only,
    is_linear, keeps_tensions,
):  # fmt: skip
    """The element between node a and the next one away from the middle (`away`: 1 down, -1 up), after which
    node a has moved on by twice its increment to mid-step; of a pair also node b's, the other way.

    `moving` is the node's displacement and increment and the mid-step elongation of the element behind (its
    own way: `sign` is 1 down), `found` the last tension and the extremes until now. Returns both of the next
    node, and the tension that was the last.
    """
    U, D, e = moving
    tension, least, most = found
    own, other = work + N_WORK_FIELDS * (a + away), work + N_WORK_FIELDS * (b - away)
    U_next = _both(
        S,
        S,
        nodes + N_NODE_FIELDS * (a + away) + DISPLACEMENT,
        nodes + N_NODE_FIELDS * (b - away) + DISPLACEMENT,
    )
    D_next = fused(_both(S, W, own + SHARE, other + SHARE), D, _both(S, W, own + LOADED, other + LOADED))
    elongation, gained = U_next - U, D_next - D
    stretched = elongation + gained
    if is_linear:
        new = sign * fused(-damped, elongation, stretched)
    else:
        # Of an element's two nodes the upper one has its tension and stiffness.
        own -= N_WORK_FIELDS * ((1 + away) // 2)
        other -= N_WORK_FIELDS * ((1 - away) // 2)
        stiffness = _both(S, W, own + ELEMENT_STIFFNESS, other + ELEMENT_STIFFNESS)
        new = fused(stiffness, sign * gained, _both(S, W, own + ELEMENT_TENSION, other + ELEMENT_TENSION))
        if tension_only:
            new = maximum(new, constant(new, 0.0))
    here, there = nodes + N_NODE_FIELDS * a, nodes + N_NODE_FIELDS * b
    g, old = sign * _both(S, table, 2 * a, 2 * b), _both(S, S, here + VELOCITY, there + VELOCITY)
    _leave(S, here + VELOCITY, there + VELOCITY, _middle_velocity(numbers, g, D, e + stretched) - old)
    _leave(S, here + DISPLACEMENT, there + DISPLACEMENT, fused(constant(D, 2.0), D, U))
    if keeps_tensions:
        _leave(S, kept + a - (1 - away) // 2, kept + b - (1 + away) // 2, unit * new)
    return (U_next, D_next, stretched), (new, minimum(new, least), maximum(new, most)), tension


def _move_pairs(
    S, W, table, numbers, nodes, work, n_elements, upper, lower, of_upper, of_lower, damped, unit, kept,
    tension_only, is_linear, keeps_tensions,
):  # fmt: skip
    """Goes on from both sides of the middle as long as both have a node, and moves the nodes.

    `upper` and `lower` are displacement and increment of the next node and the elongation before it (each
    side's way), `of_upper` and `of_lower` the last tension and the extremes. Returns all of them, and the two
    tensions before the last.
    """


@overload(_move_pairs, jit_options={"error_model": "numpy", "forceinline": True})
def _move_pairs_of(
    S, W, table, numbers, nodes, work, n_elements, upper, lower, of_upper, of_lower, damped, unit, kept,
    tension_only, is_linear, keeps_tensions,
):  # fmt: skip
    def beside(
        S, W, table, numbers, nodes, work, n_elements, upper, lower, of_upper, of_lower, damped, unit, kept,
        tension_only, is_linear, keeps_tensions,
    ):  # fmt: skip
        middle = (n_elements + 1) // 2
        sign = pair(constant(S, -1.0), constant(S, 1.0))
        moving = pair(upper[0], lower[0]), pair(upper[1], lower[1]), pair(upper[2], lower[2])
        found = (
            pair(of_upper[0], of_lower[0]),
            pair(of_upper[1], of_lower[1]),
            pair(of_upper[2], of_lower[2]),
        )
        numbers = constant(sign, numbers[0]), constant(sign, numbers[1]), constant(sign, numbers[2])
        damped, unit = constant(sign, damped), constant(sign, unit)
        before = swapped(found[0])
        for i in range(1, n_elements - middle):
            moving, found, before = _one_on(
                S, W, table, numbers, sign, middle - i, middle + i, -1, nodes, work, moving, found, damped,
                unit, kept, tension_only, is_linear, keeps_tensions,
            )  # fmt: skip
        U, D, e = moving
        tension, least, most = found
        upper, lower = (lane(U, 0), lane(D, 0), lane(e, 0)), (lane(U, 1), lane(D, 1), lane(e, 1))
        of_upper = lane(tension, 0), lane(least, 0), lane(most, 0)
        of_lower = lane(tension, 1), lane(least, 1), lane(most, 1)
        return upper, lower, of_upper, of_lower, lane(before, 0), lane(before, 1)

    def in_turn(
        S, W, table, numbers, nodes, work, n_elements, upper, lower, of_upper, of_lower, damped, unit, kept,
        tension_only, is_linear, keeps_tensions,
    ):  # fmt: skip
        middle, one, minus_one = (n_elements + 1) // 2, constant(S, 1.0), constant(S, -1.0)
        before_upper, before_lower = of_lower[0], of_upper[0]
        for i in range(1, n_elements - middle):
            upper, of_upper, before_upper = _one_on(
                S, W, table, numbers, minus_one, middle - i, middle - i, -1, nodes, work, upper, of_upper,
                damped, unit, kept, tension_only, is_linear, keeps_tensions,
            )  # fmt: skip
            lower, of_lower, before_lower = _one_on(
                S, W, table, numbers, one, middle + i, middle + i, 1, nodes, work, lower, of_lower,
                damped, unit, kept, tension_only, is_linear, keeps_tensions,
            )  # fmt: skip
        return upper, lower, of_upper, of_lower, before_upper, before_lower

    return beside if S.n_lanes == 1 else in_turn


@stage
def _move_alone(S, table, numbers, j, nodes, U, D, elongations):
    """Moves one node between sheave and payload on by twice its increment to mid-step."""
    here, g = nodes + N_NODE_FIELDS * j, constant(S, table[2 * j])
    S[here + VELOCITY] = _middle_velocity(numbers, g, D, elongations) - S[here + VELOCITY]
    S[here + DISPLACEMENT] = fused(constant(S, 2.0), D, U)


@stage
def _first_on(S, W, away, j, nodes, work, U, D, damped, tension_only, is_linear):
    """`_one_on` of one node alone, which stays: displacement, increment and elongation, and the tension."""
    here = work + N_WORK_FIELDS * (j + away)
    U_next = S[nodes + N_NODE_FIELDS * (j + away) + DISPLACEMENT]
    D_next = fused(W[here + SHARE], D, W[here + LOADED])
    elongation, gained, sign = U_next - U, D_next - D, constant(S, away)
    stretched = elongation + gained
    tension = _element_tension(
        W,
        here - N_WORK_FIELDS * ((1 + away) // 2),
        sign * elongation,
        sign * stretched,
        sign * gained,
        damped,
        tension_only,
        is_linear,
    )
    return (U_next, D_next, stretched), tension


@stage
def _move(S, W, table, nodes, work, n_elements, dt, tension_only, hookean, is_linear, keeps_tensions):
    """`cable_move` of some lanes: substitutes from the middle outwards and moves what is done with."""
    if not hookean:
        _relax(S, W, nodes, work, n_elements, tension_only)
    numbers = _velocity_numbers(S, W, n_elements, dt)
    middle, kept = (n_elements + 1) // 2, tension_rows(nodes, n_elements, hookean)
    unit, damped = _unit_and_damping(S, W, dt, is_linear)
    # In elongations, if the cable is linear, the tensions are compared.
    U = S[nodes + N_NODE_FIELDS * middle + DISPLACEMENT]
    D = W[work + N_WORK_FIELDS * middle + INCREMENT]
    upper, tension = _first_on(S, W, -1, middle, nodes, work, U, D, damped, tension_only, is_linear)
    lower, of_upper = (U, D, U), (tension, tension, tension)
    of_lower, before_upper, before_lower = of_upper, tension, tension
    if keeps_tensions:
        S[kept + middle - 1] = unit * tension
    if n_elements > 1:
        lower, tension = _first_on(S, W, 1, middle, nodes, work, U, D, damped, tension_only, is_linear)
        of_lower = tension, tension, tension
        if keeps_tensions:
            S[kept + middle] = unit * tension
        _move_alone(S, table, numbers, middle, nodes, U, D, lower[2] - upper[2])
        upper, lower, of_upper, of_lower, before_upper, before_lower = _move_pairs(
            S, W, table, numbers, nodes, work, n_elements, upper, lower, of_upper, of_lower, damped, unit,
            kept, tension_only, is_linear, keeps_tensions,
        )  # fmt: skip
        if 2 * middle > n_elements:
            U, D, e = upper
            before_upper, least, most = of_upper
            upper, tension = _first_on(S, W, -1, 1, nodes, work, U, D, damped, tension_only, is_linear)
            of_upper = tension, minimum(tension, least), maximum(tension, most)
            _move_alone(S, table, numbers, 1, nodes, U, D, -(e + upper[2]))
            if keeps_tensions:
                S[kept] = unit * tension
    S[nodes + DISPLACEMENT] = W[SHEAVE_NEW]
    U, D, _ = lower
    zero, bottom = constant(S, 0.0), nodes + N_NODE_FIELDS * n_elements
    S[bottom + VELOCITY] = _middle_velocity(numbers, zero, D, zero) - S[bottom + VELOCITY]
    S[bottom + DISPLACEMENT] = fused(constant(S, 2.0), D, U)
    top = _end_tension(S, unit * of_upper[0], unit * before_upper, tension_only)
    end = _end_tension(S, unit * of_lower[0], unit * before_lower, tension_only)
    least, most = minimum(of_upper[1], of_lower[1]), maximum(of_upper[2], of_lower[2])
    least, most = minimum(unit * least, S[TENSION_MIN]), maximum(unit * most, S[TENSION_MAX])
    _show_tensions(S, top, end, least, most)


@seldom
def _solve(S, W, table, nodes, work, n_elements, n_iterations, dt, tension_only, hookean, leaves_increments):
    """`cable_solve` of some lanes."""
    align_stack()
    _begin_step(S, W, n_elements)
    for iteration in range(n_iterations):
        first = iteration == 0
        if tension_only or not hookean:
            _constitutive_pass(S, W, nodes, work, n_elements, dt, tension_only, hookean, first)
        _forward_pass(S, W, table, nodes, work, n_elements, dt, hookean and not tension_only, first)
        if iteration + 1 < n_iterations or leaves_increments:
            _backward_pass(W, work, n_elements)
        if iteration + 1 < n_iterations:
            _trial_velocities(S, W, table, nodes, work, n_elements, dt)


@seldom
def _solve_linear(S, W, table, nodes, work, n_elements, dt):
    """`_solve` of the usual case, compiled without questions: a linear cable, one iteration."""
    align_stack()
    _begin_step(S, W, n_elements)
    _forward_pass(S, W, table, nodes, work, n_elements, dt, True, True)


@seldom
def _move_linear(S, W, table, nodes, work, n_elements, dt):
    """`_move` of the usual case: a linear cable, tensions not kept."""
    align_stack()
    _move(S, W, table, nodes, work, n_elements, dt, False, True, True, False)


@seldom
def _move_any(S, W, table, nodes, work, n_elements, dt, tension_only, hookean, keeps_tensions):
    """`_move` of every other case."""
    align_stack()
    linear = hookean and not tension_only
    _move(S, W, table, nodes, work, n_elements, dt, tension_only, hookean, linear, keeps_tensions)


@stage
def _table(W, work, n_elements):
    """Share g of the length that lies below each node, and g²: what `fill_work` left."""
    return numbers_from(W, work + N_WORK_FIELDS * (n_elements + 1))


def _at_once(S):
    """Lanes computed together, so that what all nodes share finds room in the registers; a constant."""


@overload(_at_once, jit_options={"error_model": "numpy", "forceinline": True})
def _at_once_of(S):
    width = min(S.n_lanes, ALIGNMENT // (S.dtype.bitwidth // 8))
    return lambda S: width


def _part(S, begin):
    """The lanes of a block from `begin` on that are computed together."""


@overload(_part, jit_options={"error_model": "numpy", "forceinline": True})
def _part_of(S, begin):
    width = min(S.n_lanes, ALIGNMENT // (S.dtype.bitwidth // 8))
    if width == S.n_lanes:
        return lambda S, begin: S
    return lambda S, begin: lanes_of(S, begin, width)


@stage
def cable_solve(S, W, nodes, work, n_elements, n_iterations, dt, tension_only, hookean, leaves_increments):
    """Finds what every node gains in one solver step; nothing has moved yet.

    Reads the sheave's displacement and the length at both ends of the step (`SHEAVE_OLD`, `SHEAVE_NEW`,
    `LENGTH_OLD`, `LENGTH`). The nodes stand from row `nodes` of S on; the rows of W from `work` on, with the
    table of `fill_work`, help. What the nodes gain is left in `INCREMENT` only if that is asked for, or the
    cable is a rope beyond Hooke's law: `cable_move` finds it on its way.
    """
    table, leaves = _table(W, work, n_elements), leaves_increments or not hookean
    is_usual = hookean and not tension_only and n_iterations == 1 and not leaves
    for begin in range(0, n_lanes_of(S), _at_once(S)):
        own, scratch = _part(S, begin), _part(W, begin)
        if is_usual:
            _solve_linear(own, scratch, table, nodes, work, n_elements, dt)
        else:
            _solve(
                own, scratch, table, nodes, work, n_elements, n_iterations, dt, tension_only, hookean, leaves
            )


@stage
def cable_move(S, W, nodes, work, n_elements, dt, tension_only, hookean, keeps_tensions):
    """Moves the nodes on by twice their increments to mid-step and reads the tensions off.

    These are means over the solver step, the very tensions that moved the nodes. Element by element they are
    left behind the nodes only if that is asked for: a batch would carry them through its memory for nothing.
    """
    table = _table(W, work, n_elements)
    is_usual = hookean and not tension_only and not keeps_tensions
    for begin in range(0, n_lanes_of(S), _at_once(S)):
        own, scratch = _part(S, begin), _part(W, begin)
        if is_usual:
            _move_linear(own, scratch, table, nodes, work, n_elements, dt)
        else:
            _move_any(own, scratch, table, nodes, work, n_elements, dt, tension_only, hookean, keeps_tensions)


@stage
def _settled_step(S, W, nodes, work, n_elements, n_iterations, dt, tension_only, hookean, trial):
    """Advances one lane by a solver step; a cable that is not linear iterates until its velocities settle.

    Returns the last change of a velocity within an iteration [m/s], relative where that is above 1 m/s: zero
    for a linear cable, whose iterations are counted, not watched.
    """
    _begin_step(S, W, n_elements)
    change, table = 0.0, _table(W, work, n_elements)
    for j in range(n_elements + 1):
        trial[j] = S[nodes + N_NODE_FIELDS * j + VELOCITY]
    watched = tension_only or not hookean
    for iteration in range(max(n_iterations, _MOST_ITERATIONS) if watched else n_iterations):
        first = iteration == 0
        if tension_only or not hookean:
            _constitutive_pass(S, W, nodes, work, n_elements, dt, tension_only, hookean, first)
        _forward_pass(S, W, table, nodes, work, n_elements, dt, hookean and not tension_only, first)
        _backward_pass(W, work, n_elements)
        _trial_velocities(S, W, table, nodes, work, n_elements, dt)
        if watched:
            change, fastest = 0.0, 1.0
            for j in range(1, n_elements + 1):
                velocity = W[work + N_WORK_FIELDS * j + TRIAL_VELOCITY]
                change = max(change, abs(velocity - trial[j]))
                fastest = max(fastest, abs(velocity))
                trial[j] = velocity
            change /= fastest
            if iteration + 1 >= n_iterations and change <= _SETTLED:
                break
    is_linear = hookean and not tension_only
    _move(S, W, table, nodes, work, n_elements, dt, tension_only, hookean, is_linear, True)
    return change


@seldom
def hanging_strain(S, tension):
    """Strain of a relaxed rope beyond Hooke's law under a tension; of one lane."""
    EA, quadratic, cubic = S[CABLE_STIFFNESS], S[CABLE_QUADRATIC], S[CABLE_CUBIC]
    return constant(
        S, strain_of(np.float64(tension), np.float64(EA), np.float64(quadratic), np.float64(cubic))
    )


@seldom
def hanging_stretch(S, n_elements, length):
    """Stretch of a rope beyond Hooke's law that hangs still, element by element as `hang_still` has it."""
    h, half = constant(S, 1.0 / n_elements), constant(S, 0.5)
    stretch = constant(S, 0.0)
    for j in range(n_elements):
        below = constant(S, n_elements - j) - half
        tension = S[PAYLOAD_WEIGHT] + S[CABLE_WEIGHT] * length * h * below
        stretch += hanging_strain(S, tension) * length * h
    return stretch


@stage
def hang_still(S, nodes, n_elements, sheave, hookean, keeps_tensions):
    """Puts one lane at rest in static equilibrium below a sheave displaced by `sheave`, positive down."""
    h, half, zero = constant(S, 1.0 / n_elements), constant(S, 0.5), constant(S, 0.0)
    L, EA = S[LENGTH], S[CABLE_STIFFNESS]
    displacement, kept = sheave, tension_rows(nodes, n_elements, hookean)
    for j in range(n_elements + 1):
        S[nodes + N_NODE_FIELDS * j + DISPLACEMENT] = displacement
        S[nodes + N_NODE_FIELDS * j + VELOCITY] = zero
        from_payload = constant(S, n_elements - j) - half
        tension = S[PAYLOAD_WEIGHT] + S[CABLE_WEIGHT] * L * h * from_payload
        if keeps_tensions and j < n_elements:
            S[kept + j] = tension
        if hookean:
            displacement += tension * L * h / EA
        else:
            displacement += hanging_strain(S, tension) * L * h
    if not hookean:
        behind = nodes + N_NODE_FIELDS * (n_elements + 1)
        for j in range(n_elements):
            S[behind + j] = zero


def n_cable_rows(n_elements: int, *, hookean: bool, keeps_tensions: bool) -> int:
    """Rows that nodes, the Maxwell branches of a rope beyond Hooke's law and tensions that are kept take in a
    state buffer [-]."""
    return N_NODE_FIELDS * (n_elements + 1) + n_elements * (int(not hookean) + int(keeps_tensions))


def n_work_rows(n_elements: int) -> int:
    """Rows that the cable's solution takes in a scratch block [-], the last of which hold a table."""
    return (N_WORK_FIELDS + 2) * (n_elements + 1)


def fill_work(work: Array) -> None:
    """Writes what the number of elements alone decides into the solution's rows, (n_work_rows, n_lanes)."""
    n_nodes = len(work) // (N_WORK_FIELDS + 2)
    below = 1.0 - np.arange(n_nodes) / max(n_nodes - 1, 1)
    table = np.ravel(np.column_stack([below, below**2]))
    work[N_WORK_FIELDS * n_nodes :].reshape(-1)[: len(table)] = table


def hanging_elongation(
    cable: Cable, payload: Payload, length: Array | float, n_elements: int
) -> Array | float:
    """Elongation of a rope beyond Hooke's law that hangs still and relaxed, element by element [m].

    Args:
        cable: The rope.
        payload: What hangs on it.
        length: Unstretched length [m], any shape.
        n_elements: Elements that the rope is cut into [-].
    """
    L = np.asarray(length, dtype=float)
    share = (np.arange(n_elements) + 0.5) / n_elements
    tension = payload.submerged_weight + cable.submerged_weight * L[..., None] * share
    stretch = L * np.mean(static_strain(cable, tension), axis=-1)
    return float(stretch) if np.ndim(length) == 0 else stretch


def fill_parameters(S: Array, cable: Cable, payload: Payload) -> None:
    """Writes the cable's and the payload's numbers into the rows of a state buffer, all lanes alike."""
    S[..., CABLE_STIFFNESS, :] = cable.axial_stiffness
    S[..., CABLE_DAMPING, :] = cable.axial_damping
    S[..., CABLE_INERTIA, :] = cable.inertia_per_length
    S[..., CABLE_WEIGHT, :] = cable.submerged_weight
    S[..., CABLE_DRAG, :] = cable.tangential_drag_per_length
    S[..., CABLE_QUADRATIC, :], S[..., CABLE_CUBIC, :] = rope_energy_coefficients(cable)
    S[..., RELAXING_STIFFNESS, :] = cable.relaxing_stiffness
    S[..., RELAXATION_RATE, :] = 1.0 / cable.relaxation_time
    S[..., PAYLOAD_INERTIA, :] = payload.inertia
    S[..., PAYLOAD_WEIGHT, :] = payload.submerged_weight
    S[..., PAYLOAD_DRAG, :] = payload.drag_factor


def _make_march(fingerprint: int):
    @njit(cache=True, error_model="numpy")
    def march(
        state, scratch, n_elements, n_iterations, dt, tension_only, hookean, sheave, length, out, envelope
    ):  # fmt: skip
        """Drives one cable through given sheave displacements and lengths.

        Fills `out` (n_steps + 1, 6) and the least and most tension of each element, `envelope` (2,
        n_elements). Returns the first instant that was not reached (-1: none) and what was left there.
        """
        if fingerprint == 0:
            return -1, 0.0
        S, W = block_at(state.ctypes.data, 0, 1, 0), block_at(scratch.ctypes.data, 0, 1, 0)
        nodes, work = N_FIXED, N_SCRATCH
        bottom, kept = nodes + N_NODE_FIELDS * n_elements, tension_rows(nodes, n_elements, hookean)
        trial = np.empty(n_elements + 1)
        before = np.empty(state.shape)
        for k in range(len(sheave)):
            S[TENSION_MIN], S[TENSION_MAX] = np.inf, -np.inf
            if k > 0:
                before[:] = state
                pieces = 1
                while True:
                    change = 0.0
                    for piece in range(pieces):
                        a, b = piece / pieces, (piece + 1) / pieces
                        W[SHEAVE_OLD] = (1.0 - a) * sheave[k - 1] + a * sheave[k]
                        W[SHEAVE_NEW] = (1.0 - b) * sheave[k - 1] + b * sheave[k]
                        W[LENGTH_OLD] = (1.0 - a) * length[k - 1] + a * length[k]
                        S[LENGTH] = (1.0 - b) * length[k - 1] + b * length[k]
                        W[LENGTH_SPEED] = (length[k] - length[k - 1]) / dt
                        change = _settled_step(
                            S,
                            W,
                            nodes,
                            work,
                            n_elements,
                            n_iterations,
                            dt / pieces,
                            tension_only,
                            hookean,
                            trial,
                        )
                        if not change <= _SETTLED:
                            break
                    if change <= _SETTLED:
                        break
                    pieces *= 2
                    if pieces > _MOST_PIECES:
                        return k, change
                    state[:] = before
            else:
                least, most = np.inf, -np.inf
                for j in range(n_elements):
                    tension = S[kept + j]
                    least, most = min(least, tension), max(most, tension)
                last, second = n_elements - 1, min(1, n_elements - 1)
                of_first, of_second = S[kept], S[kept + second]
                of_last, of_last_but_one = S[kept + last], S[kept + last - second]
                top = _end_tension(S, of_first, of_second, tension_only)
                end = _end_tension(S, of_last, of_last_but_one, tension_only)
                _show_tensions(S, top, end, least, most)
            out[k, 0] = S[bottom + DISPLACEMENT]
            out[k, 1] = S[bottom + VELOCITY]
            out[k, 2] = S[SHEAVE_TENSION]
            out[k, 3] = S[PAYLOAD_TENSION]
            out[k, 4] = S[TENSION_MIN]
            out[k, 5] = S[TENSION_MAX]
            for j in range(n_elements):
                tension = S[kept + j]
                envelope[0, j] = min(envelope[0, j], tension)
                envelope[1, j] = max(envelope[1, j], tension)
            if not np.isfinite(out[k, 1]):
                return k, np.inf
        return -1, 0.0

    @njit(cache=True, error_model="numpy")
    def hang(state, n_elements, sheave, hookean):
        """Hangs the cable still below the sheave."""
        if fingerprint != 0:
            hang_still(block_at(state.ctypes.data, 0, 1, 0), N_FIXED, n_elements, sheave, hookean, True)

    return march, hang


_march, _hang = _make_march(source_fingerprint())


@dataclass(frozen=True)
class AxialState:
    """Cable and payload at an instant, positive down: a value that copies and compares."""

    buffer: Array = field(repr=False)
    """The solver's rows, (n_rows, 1)."""
    sheave: float
    """Displacement of the sheave, positive down [m]."""
    length: float
    """Unstretched length outboard [m]."""

    def __eq__(self, other: object) -> bool:
        """Whether both hold the same numbers."""
        if not isinstance(other, AxialState):
            return NotImplemented
        same_ends = (self.sheave, self.length) == (other.sheave, other.length)
        return same_ends and np.array_equal(self.buffer, other.buffer)


@dataclass(frozen=True)
class AxialProfile:
    """The cable at an instant, node by node from the payload up, each of shape (n_elements + 1,)."""

    arc_length: Array
    """Unstretched length from the payload [m]."""
    height: Array
    """Position above the sheave's mean position, positive up [m]."""
    velocity: Array
    """Absolute velocity of the material, positive up [m/s]; at the sheave that of the cable running off."""
    tension: Array
    """Tension, mean over the last step [N]."""


@dataclass(frozen=True)
class AxialRecord:
    """What a march of the axial solver recorded; positive up, each of shape (n_steps + 1,) unless said
    otherwise. Tensions are means over the step that ends at the instant."""

    time: Array
    """Instants [s]."""
    sheave_heave: Array
    """Heave of the sheave as given [m]."""
    length: Array
    """Unstretched length outboard as given [m]."""
    payload_displacement: Array
    """Payload above its static position at the length of the same instant [m]."""
    payload_velocity: Array
    """Absolute velocity of the payload [m/s]."""
    sheave_tension: Array
    """Tension at the sheave [N]."""
    payload_tension: Array
    """Tension at the payload [N]."""
    tension_min: Array
    """Least tension along the cable [N]."""
    tension_max: Array
    """Most tension along the cable [N]."""
    element_tension_min: Array
    """Least tension of each element in the whole march, from the payload up [N], (n_elements,)."""
    element_tension_max: Array
    """Most tension of each element in the whole march, from the payload up [N], (n_elements,)."""
    final: AxialState
    """The state at the last instant, from which another march can go on."""

    @property
    def slack_fraction(self) -> float:
        """Share of the steps in which the tension vanishes (or is compression) somewhere on the cable [-]."""
        return float(np.mean(self.tension_min[1:] <= 0.0)) if len(self.time) > 1 else 0.0

    @property
    def element_share(self) -> Array:
        """Where the elements' middles lie: share of the length, from the payload up [-], (n_elements,)."""
        n_elements = len(self.element_tension_min)
        return (np.arange(n_elements) + 0.5) / n_elements


@dataclass(frozen=True, kw_only=True)
class AxialSolver:
    """The environment's cable as a solver of its own: any sheave motion, any length over time.

    Implicit midpoint in time, finite volumes in space, second order in both. A tension-only cable iterates
    until its velocities settle to 1e-9; where 40 iterations do not do it the step is halved, and again.
    """

    cable: Cable
    payload: Payload
    length: float
    """Unstretched length at the start [m]."""
    n_elements: int = 20
    n_iterations: int = 2
    """Newton iterations per step [-]; the least number of them if the cable is tension-only."""

    def __post_init__(self) -> None:
        require_number(self, "length", positive=True)
        require_integer(self, "n_elements", minimum=1)
        require_integer(self, "n_iterations", minimum=1)
        require_number(self.payload, "submerged_weight", positive=True)
        require_number(self.cable, "submerged_weight", non_negative=True)
        massless = self.cable.inertia_per_length == 0.0
        require(not massless or self.n_elements == 1, self, "n_elements", "1 for a massless cable (a spring)")

    @cached_property
    def _bottom(self) -> int:
        return N_FIXED + N_NODE_FIELDS * self.n_elements

    def rest(self, sheave_heave: float = 0.0, length: float | None = None) -> AxialState:
        """Hanging still below a sheave at `sheave_heave` [m, positive up]."""
        n_rows = n_cable_rows(self.n_elements, hookean=self.cable.is_hookean, keeps_tensions=True)
        S = np.zeros((N_FIXED + n_rows, 1))
        fill_parameters(S, self.cable, self.payload)
        L = self.length if length is None else length
        S[LENGTH] = L
        _hang(S, self.n_elements, -sheave_heave, self.cable.is_hookean)
        return AxialState(S, -sheave_heave, L)

    def step(self, state: AxialState, top: tuple[float, float], dt: float) -> AxialState:
        """Advances by `dt` [s].

        Args:
            state: The instant to go on from.
            top: Sheave heave [m, positive up] and unstretched length [m] at the end of the step.
            dt: Time step [s].

        Raises:
            ValueError: If a number is not finite, or the length or `dt` not positive.
            ConvergenceError: If a tension-only cable does not settle, however small the step.
        """
        sheave, length = _checked(np.array([-state.sheave, top[0]]), np.array([state.length, top[1]]), dt)
        S = state.buffer.copy()
        self._run(S, -sheave, length, dt)
        return AxialState(S, -float(top[0]), float(top[1]))

    def top_tension(self, state: AxialState) -> float:
        """Tension at the sheave [N]."""
        return float(self._tensions(state.buffer.copy(), state)[0, 2])

    def payload_motion(self, state: AxialState) -> tuple[float, float]:
        """Payload above its static position at the present length [m], and its velocity [m/s], up."""
        displacement, velocity = state.buffer[self._bottom + DISPLACEMENT : self._bottom + VELOCITY + 1, 0]
        return float(self.static_stretch(state.length) - displacement), float(-velocity)

    def profile(self, state: AxialState) -> AxialProfile:
        """Position, velocity and tension along the cable.

        Element tensions are carried to the nodes by their mean, to the two ends linearly.
        """
        S = state.buffer.copy()
        ends = self._tensions(S, state)[0]
        n = self.n_elements
        fields = S[N_FIXED : N_FIXED + N_NODE_FIELDS * (n + 1), 0].reshape(n + 1, N_NODE_FIELDS)[::-1]
        arc_length = state.length * np.arange(n + 1) / n
        kept = N_FIXED + n_cable_rows(n, hookean=self.cable.is_hookean, keeps_tensions=False)
        of_elements = S[kept : kept + n, 0][::-1]
        inner = 0.5 * (of_elements[1:] + of_elements[:-1])
        velocity = -fields[:, VELOCITY]
        if n > 1:  # the sheave's node has no equation of motion: extrapolate
            velocity[-1] = 2.0 * velocity[-2] - velocity[-3]
        return AxialProfile(
            arc_length=arc_length,
            height=-(state.length - arc_length + fields[:, DISPLACEMENT]),
            velocity=velocity,
            tension=np.concatenate([[ends[3]], inner, [ends[2]]]),
        )

    def static_stretch(self, length: Array | float) -> Array | float:
        """Elongation hanging still, L (w2 + w1 L / 2) / EA by Hooke's law [m]."""
        if not self.cable.is_hookean:
            return hanging_elongation(self.cable, self.payload, length, self.n_elements)
        weight = self.payload.submerged_weight + 0.5 * self.cable.submerged_weight * length
        return length * weight / self.cable.axial_stiffness

    def simulate(
        self,
        sheave_heave: Array,
        dt: float,
        length: Array | None = None,
        *,
        start: AxialState | None = None,
    ) -> AxialRecord:
        """Marches through a given motion, from static equilibrium unless told otherwise.

        Args:
            sheave_heave: Heave of the sheave at each instant, positive up [m], (n_steps + 1,).
            dt: Time step [s].
            length: Unstretched length at each instant [m], (n_steps + 1,); constant if not given.
            start: Where to begin, in place of rest: a state of this solver, whose sheave and length the
                first instants must be.

        Returns:
            The record, at every instant from the start.

        Raises:
            ValueError: If the arrays do not fit each other or hold impossible numbers.
            ConvergenceError: If a tension-only cable does not settle, however small the step.
        """
        heave = np.asarray(sheave_heave, dtype=float)
        if length is None:
            length = np.full(heave.shape, self.length if start is None else start.length)
        heave, lengths = _checked(heave, np.asarray(length, dtype=float), dt)
        if start is None:
            S = self.rest(float(heave[0]), float(lengths[0])).buffer
        else:
            if not np.allclose([-start.sheave, start.length], [heave[0], lengths[0]], rtol=1e-9, atol=1e-9):
                raise ValueError(
                    f"start has the sheave at {-start.sheave:g} m and a length of {start.length:g} m, but "
                    f"the motion begins at {heave[0]:g} m and {lengths[0]:g} m: let it begin there"
                )
            S = start.buffer.copy()
        envelope = np.array([[np.inf], [-np.inf]]) * np.ones(self.n_elements)
        out = self._run(S, -heave, lengths, dt, envelope)
        return AxialRecord(
            time=dt * np.arange(len(heave)),
            sheave_heave=heave.copy(),
            length=lengths.copy(),
            payload_displacement=self.static_stretch(lengths) - out[:, 0],
            payload_velocity=-out[:, 1],
            sheave_tension=out[:, 2],
            payload_tension=out[:, 3],
            tension_min=out[:, 4],
            tension_max=out[:, 5],
            element_tension_min=envelope[0, ::-1].copy(),
            element_tension_max=envelope[1, ::-1].copy(),
            final=AxialState(S, -float(heave[-1]), float(lengths[-1])),
        )

    def _tensions(self, S: Array, state: AxialState) -> Array:
        # A march of no step, which only reads the tensions off.
        return self._run(S, np.array([state.sheave]), np.array([state.length]), 1.0)

    def _run(self, S: Array, sheave: Array, length: Array, dt: float, envelope: Array | None = None) -> Array:
        S[LENGTH] = length[0]
        out = np.empty((len(sheave), 6))
        scratch = np.empty((N_SCRATCH + n_work_rows(self.n_elements), 1))
        fill_work(scratch[N_SCRATCH:])
        failed, residual = _march(
            S,
            scratch,
            self.n_elements,
            self.n_iterations,
            dt,
            self.cable.tension_only,
            self.cable.is_hookean,
            sheave,
            length,
            out,
            np.empty((2, self.n_elements)) if envelope is None else envelope,
        )
        if failed >= 0:
            raise ConvergenceError(
                f"the cable's velocities do not settle {failed * dt:g} s into the march, even where dt was "
                "halved ten times; give a tension-only cable axial_damping of some milliseconds times its "
                "axial_stiffness, or check the motion for jumps",
                float(residual) if math.isfinite(residual) else math.inf,
            )
        return out


def _checked(sheave_heave: Array, length: Array, dt: float) -> tuple[Array, Array]:
    """The two arrays of a march, if they are possible.

    Raises:
        ValueError: If they are not, with the reason.
    """
    if not (math.isfinite(dt) and dt > 0.0):
        raise ValueError(f"dt must be a positive number of seconds, got {dt!r}")
    if sheave_heave.ndim != 1 or len(sheave_heave) == 0:
        raise ValueError(
            f"sheave_heave must be one row of instants, (n_steps + 1,), got the shape {sheave_heave.shape}"
        )
    if length.shape != sheave_heave.shape:
        raise ValueError(
            f"length must have an instant for each of sheave_heave's {len(sheave_heave)}, got the shape "
            f"{length.shape}"
        )
    if not np.all(np.isfinite(sheave_heave)):
        raise ValueError("sheave_heave must be finite at every instant: fill the gaps")
    if not (np.all(np.isfinite(length)) and np.all(length > 0.0)):
        raise ValueError(
            f"length must be positive at every instant, got {float(np.min(length)):g} m: recover less or "
            "start from more"
        )
    return sheave_heave, length
