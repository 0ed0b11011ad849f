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
    absolute,
    align_stack,
    block_at,
    constant,
    fused,
    maximum,
    minimum,
    numbers_from,
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
    SHEAVE_NEW,
    SHEAVE_OLD,
    SHEAVE_TENSION,
    SLACK,
    SUPER,
    TENSION,
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
def _strains(S, W, here, work, first):
    """Old and new strain of the element below a node, and what it gains to mid-step."""
    below = here + N_NODE_FIELDS
    elongation = S[below + DISPLACEMENT] - S[here + DISPLACEMENT]
    gained = constant(S, 0.0)
    if not first:
        gained = (W[work + N_WORK_FIELDS + INCREMENT] - W[work + INCREMENT]) * W[PER_MID_SPACING]
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
        element = work + N_WORK_FIELDS * j
        old, new, gained = _strains(S, W, nodes + N_NODE_FIELDS * j, element, first)
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
        W[element + ELEMENT_STIFFNESS] = stiffness * per_spacing
        W[element + ELEMENT_TENSION] = tension - stiffness * gained


@seldom
def _relax(S, W, nodes, work, n_elements, tension_only):
    """Moves what the Maxwell branches hold on to the end of the step, before the nodes move."""
    align_stack()
    zero, share, branches = constant(S, 0.0), W[RELAXING_SHARE], nodes + N_NODE_FIELDS * (n_elements + 1)
    EA, quadratic, cubic, EA1 = S[CABLE_STIFFNESS], S[CABLE_QUADRATIC], S[CABLE_CUBIC], S[RELAXING_STIFFNESS]
    for j in range(n_elements):
        old, new, _ = _strains(S, W, nodes + N_NODE_FIELDS * j, work + N_WORK_FIELDS * j, False)
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


@stage
def _share_below(S, W, work, j, n_elements):
    """Share g of the length that lies below node j, and g², from the table that `fill_work` left."""
    table = numbers_from(W, work + N_WORK_FIELDS * (n_elements + 1))
    return constant(S, table[2 * j]), constant(S, table[2 * j + 1])


@stage
def _node(S, W, numbers, j, nodes, work, n_elements, e_above, e_below, is_linear, first):
    """Momentum balance of node j in the increments D: what multiplies D above and below (with the sign
    reversed), the diagonal, and the load.

    W̄ = β D + V + gκ Ū_y at mid-step, and DW/Dt = β (W̄ - W) + gκ ∂W̄/∂y with the compact Ū_yy. Increments,
    not displacements: the forces that balance at rest then cancel before they are multiplied by M/dt², which
    is what makes single precision good enough.
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
    g, g_squared = _share_below(S, W, work, j, n_elements)
    here, element = nodes + N_NODE_FIELDS * j, work + N_WORK_FIELDS * j
    w = S[here + VELOCITY] if first else W[element + TRIAL_VELOCITY]
    speed = absolute(w)
    gradient = g * fused(of_drag, speed, of_mass)
    bend = e_below - e_above
    if is_linear:
        stiff = fused(-g_squared, curving, k)
        above, below = stiff + gradient, stiff - gradient
        load = fused(fused(-g_squared, curving, k_pulling), bend, steady)
        diagonal = fused(constant(S, 2.0), stiff, inertia)
    else:
        curvature = g_squared * curving
        k_above = W[element - N_WORK_FIELDS + ELEMENT_STIFFNESS] - curvature
        k_below = W[element + ELEMENT_STIFFNESS] - curvature
        above, below = k_above + gradient, k_below - gradient
        pull = W[element + ELEMENT_TENSION] - W[element - N_WORK_FIELDS + ELEMENT_TENSION]
        load = fused(-curvature, bend, steady) + pull
        diagonal = inertia + (k_above + k_below)
    # Drag linearised about w: its slope times the velocity, less what that counts too much.
    diagonal = fused(damping_drag, speed, diagonal)
    load = fused(speed, fused(drag, w, carried_drag), fused(momentum, S[here + VELOCITY], load))
    load = fused(fused(g, carried, -gradient), e_above + e_below, load)
    return above, below, diagonal, load


@stage
def _eliminate(W, element, back, onward, diagonal, load, share, loaded):
    """Expresses a node's increment by the next one's, D = load + share · D_next; leaves and returns both.

    `share` and `loaded` are those of the node before, which `back` couples to.
    """
    pivot = constant(diagonal, 1.0) / fused(-back, share, diagonal)
    own_share, own_load = onward * pivot, fused(back, loaded, load) * pivot
    W[element + SUPER] = own_share
    W[element + INCREMENT] = own_load
    return own_share, own_load


@stage
def _forward_pass(S, W, nodes, work, n_elements, dt, is_linear, first):
    """Assembles the momentum balances and eliminates from both ends to the middle, whose increment it finds.

    From both ends (twisted): the divisions, each of which waits for the one before, then make two chains
    half as long.
    """
    h = 1.0 / n_elements
    beta, V, kappa = constant(S, 2.0 / dt), W[LENGTH_SPEED], W[CONVECTION]
    zero, half, two = constant(S, 0.0), constant(S, 0.5), constant(S, 2.0)
    mass, drag, weight = W[NODE_MASS], W[NODE_DRAG], W[NODE_WEIGHT]
    k, damping = _linear_law(S, W, dt)
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
    W[work + INCREMENT] = top
    bottom, last = nodes + N_NODE_FIELDS * n_elements, work + N_WORK_FIELDS * n_elements
    U_below = S[bottom - N_NODE_FIELDS + DISPLACEMENT]
    e_below = S[bottom + DISPLACEMENT] - U_below
    w = S[bottom + VELOCITY] if first else W[last + TRIAL_VELOCITY]
    payload_momentum = beta * fused(half, mass, S[PAYLOAD_INERTIA])
    drag_slope = two * fused(half, drag, S[PAYLOAD_DRAG]) * absolute(w)
    load = fused(half, weight, S[PAYLOAD_WEIGHT])
    if is_linear:
        k_last = k
        load = fused(damping - k, e_below, load)
    else:
        k_last = W[last - N_WORK_FIELDS + ELEMENT_STIFFNESS]
        load = load - W[last - N_WORK_FIELDS + ELEMENT_TENSION]
    load = fused(payload_momentum, S[bottom + VELOCITY] - V, load)
    load = fused(drag_slope, fused(half, w, -V), load)
    diagonal = fused(beta, payload_momentum + drag_slope, k_last)
    if n_elements == 1:
        W[last + INCREMENT] = fused(k_last, top, load) / diagonal
        return
    share_below, load_below = _eliminate(W, last, zero, k_last, diagonal, load, zero, zero)
    share_above, load_above = zero, top
    U_above = S[nodes + N_NODE_FIELDS + DISPLACEMENT]
    e_above = U_above - S[nodes + DISPLACEMENT]
    middle = (n_elements + 1) // 2
    for i in range(1, middle):
        U = U_above
        U_above = S[nodes + N_NODE_FIELDS * (i + 1) + DISPLACEMENT]
        e = U_above - U
        above, below, diagonal, load = _node(
            S, W, numbers, i, nodes, work, n_elements, e_above, e, is_linear, first
        )
        share_above, load_above = _eliminate(
            W, work + N_WORK_FIELDS * i, above, below, diagonal, load, share_above, load_above
        )
        e_above = e
        j = n_elements - i
        if j > middle:
            U = U_below
            U_below = S[nodes + N_NODE_FIELDS * (j - 1) + DISPLACEMENT]
            e = U - U_below
            above, below, diagonal, load = _node(
                S, W, numbers, j, nodes, work, n_elements, e, e_below, is_linear, first
            )
            share_below, load_below = _eliminate(
                W, work + N_WORK_FIELDS * j, below, above, diagonal, load, share_below, load_below
            )
            e_below = e
    above, below, diagonal, load = _node(
        S, W, numbers, middle, nodes, work, n_elements, e_above, e_below, is_linear, first
    )
    load = fused(below, load_below, fused(above, load_above, load))
    diagonal = fused(-below, share_below, fused(-above, share_above, diagonal))
    W[work + N_WORK_FIELDS * middle + INCREMENT] = load / diagonal


@stage
def _backward_pass(W, work, n_elements):
    """Substitutes from the middle outwards for the increments to mid-step."""
    middle = (n_elements + 1) // 2
    below = above = W[work + N_WORK_FIELDS * middle + INCREMENT]
    for i in range(1, n_elements - middle + 1):
        element = work + N_WORK_FIELDS * (middle + i)
        below = fused(W[element + SUPER], below, W[element + INCREMENT])
        W[element + INCREMENT] = below
        if i < middle:
            element = work + N_WORK_FIELDS * (middle - i)
            above = fused(W[element + SUPER], above, W[element + INCREMENT])
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
def _trial_velocities(S, W, nodes, work, n_elements, dt):
    """The velocities at mid-step that go with the increments, for the next iteration."""
    half, numbers = constant(S, 0.5), _velocity_numbers(S, W, n_elements, dt)
    for j in range(1, n_elements):
        here, element = nodes + N_NODE_FIELDS * j, work + N_WORK_FIELDS * j
        gained = W[element + N_WORK_FIELDS + INCREMENT] - W[element - N_WORK_FIELDS + INCREMENT]
        old = S[here + N_NODE_FIELDS + DISPLACEMENT] - S[here - N_NODE_FIELDS + DISPLACEMENT]
        g, _ = _share_below(S, W, work, j, n_elements)
        W[element + TRIAL_VELOCITY] = half * _middle_velocity(
            numbers, g, W[element + INCREMENT], old + gained
        )
    last = work + N_WORK_FIELDS * n_elements
    zero = constant(S, 0.0)
    W[last + TRIAL_VELOCITY] = half * _middle_velocity(numbers, zero, W[last + INCREMENT], zero)


@stage
def _element_tension(S, W, nodes, work, j, law, tension_only, is_linear):
    """Mean tension of the element below node j over the step that `cable_solve` found."""
    here, element = nodes + N_NODE_FIELDS * j, work + N_WORK_FIELDS * j
    gained = W[element + N_WORK_FIELDS + INCREMENT] - W[element + INCREMENT]
    if is_linear:
        k, damping = law
        elongation = S[here + N_NODE_FIELDS + DISPLACEMENT] - S[here + DISPLACEMENT]
        tension = fused(k, elongation + gained, -(damping * elongation))
    else:
        tension = fused(W[element + ELEMENT_STIFFNESS], gained, W[element + ELEMENT_TENSION])
        if tension_only:
            tension = maximum(tension, constant(S, 0.0))
    return tension


@stage
def _end_tension(S, nearest, second, tension_only):
    """Tension at an end of the cable, extrapolated linearly from the middles of the two nearest elements."""
    tension = constant(S, 1.5) * nearest - constant(S, 0.5) * second
    return maximum(tension, constant(S, 0.0)) if tension_only else tension


@stage
def solved_sheave_tension(S, W, nodes, work, n_elements, dt, tension_only, hookean):
    """Tension at the sheave over the step that `cable_solve` found."""
    law, is_linear = _linear_law(S, W, dt), hookean and not tension_only
    nearest = _element_tension(S, W, nodes, work, 0, law, tension_only, is_linear)
    second = _element_tension(S, W, nodes, work, min(1, n_elements - 1), law, tension_only, is_linear)
    return _end_tension(S, nearest, second, tension_only)


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
def cable_move(S, W, nodes, work, n_elements, dt, tension_only, hookean, keeps_tensions):
    """Moves the nodes on by twice their increments to mid-step and reads the tensions off.

    These are means over the solver step, the very tensions that moved the nodes. Element by element they are
    left in the nodes only if that is asked for: a batch would carry them through its memory for nothing.
    """
    if not hookean:
        _relax(S, W, nodes, work, n_elements, tension_only)
    is_linear, numbers = hookean and not tension_only, _velocity_numbers(S, W, n_elements, dt)
    zero, two, k = constant(S, 0.0), constant(S, 2.0), constant(S, 1.0)
    last, second = n_elements - 1, min(1, n_elements - 1)
    law = _linear_law(S, W, dt)
    of_first = _element_tension(S, W, nodes, work, 0, law, tension_only, is_linear)
    of_second = _element_tension(S, W, nodes, work, second, law, tension_only, is_linear)
    of_last = _element_tension(S, W, nodes, work, last, law, tension_only, is_linear)
    of_last_but_one = _element_tension(S, W, nodes, work, last - second, law, tension_only, is_linear)
    top = _end_tension(S, of_first, of_second, tension_only)
    end = _end_tension(S, of_last, of_last_but_one, tension_only)
    # The extremes of a linear cable are looked for in its elongations, tension over stiffness.
    damped = zero
    if is_linear:
        k = law[0]
        damped = law[1] / k
    least, most = constant(S, np.inf), constant(S, -np.inf)
    U, increment, stretched = S[nodes + DISPLACEMENT], W[work + INCREMENT], zero
    S[nodes + DISPLACEMENT] = W[SHEAVE_NEW]
    for j in range(n_elements):
        here, element = nodes + N_NODE_FIELDS * j, work + N_WORK_FIELDS * j
        U_below = S[here + N_NODE_FIELDS + DISPLACEMENT]
        increment_below = W[element + N_WORK_FIELDS + INCREMENT]
        elongation, gained = U_below - U, increment_below - increment
        middle = elongation + gained
        if j > 0:
            g, _ = _share_below(S, W, work, j, n_elements)
            velocity = _middle_velocity(numbers, g, increment, stretched + middle)
            S[here + VELOCITY] = velocity - S[here + VELOCITY]
            S[here + DISPLACEMENT] = fused(two, increment, U)
        if is_linear:
            tension = fused(-damped, elongation, middle)
        else:
            tension = fused(W[element + ELEMENT_STIFFNESS], gained, W[element + ELEMENT_TENSION])
            if tension_only:
                tension = maximum(tension, zero)
        if keeps_tensions:
            S[here + TENSION] = k * tension
        least, most = minimum(tension, least), maximum(tension, most)
        U, increment, stretched = U_below, increment_below, middle
    bottom = nodes + N_NODE_FIELDS * n_elements
    S[bottom + VELOCITY] = _middle_velocity(numbers, zero, increment, zero) - S[bottom + VELOCITY]
    S[bottom + DISPLACEMENT] = fused(two, increment, U)
    least, most = minimum(k * least, S[TENSION_MIN]), maximum(k * most, S[TENSION_MAX])
    _show_tensions(S, top, end, least, most)


@stage
def _iterate(S, W, nodes, work, n_elements, dt, tension_only, hookean, first):
    """One iteration for what every node gains to mid-step."""
    is_linear = hookean and not tension_only
    if not is_linear:
        _constitutive_pass(S, W, nodes, work, n_elements, dt, tension_only, hookean, first)
    _forward_pass(S, W, nodes, work, n_elements, dt, is_linear, first)
    _backward_pass(W, work, n_elements)


@seldom
def cable_solve(S, W, nodes, work, n_elements, n_iterations, dt, tension_only, hookean):
    """Finds what every node gains in one solver step and leaves it in `INCREMENT`; nothing has moved yet.

    Reads the sheave's displacement and the length at both ends of the step (`SHEAVE_OLD`, `SHEAVE_NEW`,
    `LENGTH_OLD`, `LENGTH`). The nodes stand from row `nodes` of S on; the rows of W from `work` on, with the
    table of `fill_work`, help.
    """
    align_stack()
    _begin_step(S, W, n_elements)
    for iteration in range(n_iterations):
        _iterate(S, W, nodes, work, n_elements, dt, tension_only, hookean, iteration == 0)
        if iteration + 1 < n_iterations:
            _trial_velocities(S, W, nodes, work, n_elements, dt)


@stage
def _settled_step(S, W, nodes, work, n_elements, n_iterations, dt, tension_only, hookean, trial):
    """Advances one lane by a solver step; a cable that is not linear iterates until its velocities settle.

    Returns the last change of a velocity within an iteration [m/s], relative where that is above 1 m/s: zero
    for a linear cable, whose iterations are counted, not watched.
    """
    _begin_step(S, W, n_elements)
    change = 0.0
    for j in range(n_elements + 1):
        trial[j] = S[nodes + N_NODE_FIELDS * j + VELOCITY]
    watched = tension_only or not hookean
    for iteration in range(max(n_iterations, _MOST_ITERATIONS) if watched else n_iterations):
        _iterate(S, W, nodes, work, n_elements, dt, tension_only, hookean, iteration == 0)
        _trial_velocities(S, W, nodes, work, n_elements, dt)
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
    cable_move(S, W, nodes, work, n_elements, dt, tension_only, hookean, True)
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
def hang_still(S, nodes, n_elements, sheave, hookean):
    """Puts one lane at rest in static equilibrium below a sheave displaced by `sheave`, positive down."""
    h, half, zero = constant(S, 1.0 / n_elements), constant(S, 0.5), constant(S, 0.0)
    L, EA = S[LENGTH], S[CABLE_STIFFNESS]
    displacement = sheave
    for j in range(n_elements + 1):
        here = nodes + N_NODE_FIELDS * j
        S[here + DISPLACEMENT] = displacement
        S[here + VELOCITY] = zero
        from_payload = constant(S, n_elements - j) - half
        tension = S[PAYLOAD_WEIGHT] + S[CABLE_WEIGHT] * L * h * from_payload
        S[here + TENSION] = tension
        if hookean:
            displacement += tension * L * h / EA
        else:
            displacement += hanging_strain(S, tension) * L * h
    if not hookean:
        behind = nodes + N_NODE_FIELDS * (n_elements + 1)
        for j in range(n_elements):
            S[behind + j] = zero


def n_cable_rows(n_elements: int, *, hookean: bool) -> int:
    """Rows that nodes (and the Maxwell branches of a rope beyond Hooke's law) take in a state buffer [-]."""
    return N_NODE_FIELDS * (n_elements + 1) + (0 if hookean else n_elements)


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
        bottom = nodes + N_NODE_FIELDS * n_elements
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
                    tension = S[nodes + N_NODE_FIELDS * j + TENSION]
                    least, most = min(least, tension), max(most, tension)
                last, second = n_elements - 1, min(1, n_elements - 1)
                of_first, of_second = S[nodes + TENSION], S[nodes + N_NODE_FIELDS * second + TENSION]
                of_last = S[nodes + N_NODE_FIELDS * last + TENSION]
                of_last_but_one = S[nodes + N_NODE_FIELDS * (last - second) + TENSION]
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
                tension = S[nodes + N_NODE_FIELDS * j + TENSION]
                envelope[0, j] = min(envelope[0, j], tension)
                envelope[1, j] = max(envelope[1, j], tension)
            if not np.isfinite(out[k, 1]):
                return k, np.inf
        return -1, 0.0

    @njit(cache=True, error_model="numpy")
    def hang(state, n_elements, sheave, hookean):
        """Hangs the cable still below the sheave."""
        if fingerprint != 0:
            hang_still(block_at(state.ctypes.data, 0, 1, 0), N_FIXED, n_elements, sheave, hookean)

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
        S = np.zeros((N_FIXED + n_cable_rows(self.n_elements, hookean=self.cable.is_hookean), 1))
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
        nodes = S[N_FIXED : self._bottom + N_NODE_FIELDS, 0]
        nodes = nodes.reshape(self.n_elements + 1, N_NODE_FIELDS)[::-1]
        arc_length = state.length * np.arange(self.n_elements + 1) / self.n_elements
        of_elements = nodes[1:, TENSION]
        inner = 0.5 * (of_elements[1:] + of_elements[:-1])
        velocity = -nodes[:, VELOCITY]
        if self.n_elements > 1:  # the sheave's node has no equation of motion: extrapolate
            velocity[-1] = 2.0 * velocity[-2] - velocity[-3]
        return AxialProfile(
            arc_length=arc_length,
            height=-(state.length - arc_length + nodes[:, DISPLACEMENT]),
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
