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
from heave_env.lanes import block_of_lanes, row
from heave_env.layout import (
    CABLE_CUBIC,
    CABLE_DAMPING,
    CABLE_DRAG,
    CABLE_INERTIA,
    CABLE_QUADRATIC,
    CABLE_STIFFNESS,
    CABLE_WEIGHT,
    DISPLACEMENT,
    ELEMENT_STIFFNESS,
    ELEMENT_TENSION,
    INCREMENT,
    LENGTH,
    LENGTH_OLD,
    LENGTH_SPEED,
    LOAD,
    MID_LENGTH,
    N_FIXED,
    N_NODE_FIELDS,
    PAYLOAD_DRAG,
    PAYLOAD_INERTIA,
    PAYLOAD_TENSION,
    PAYLOAD_WEIGHT,
    RELAXATION_RATE,
    RELAXING_SHARE,
    RELAXING_STIFFNESS,
    SCRATCH,
    SHEAVE_NEW,
    SHEAVE_OLD,
    SHEAVE_TENSION,
    SLACK,
    SUPER,
    TENSION_MAX,
    TENSION_MIN,
    TRIAL_VELOCITY,
    VELOCITY,
)
from heave_env.parameters import Cable, Payload, require, require_integer, require_number

Array = np.ndarray

_CONVECTION = SCRATCH  # κ = L'/L at mid-step
_NODE_MASS = SCRATCH + 1
_NODE_DRAG = SCRATCH + 2
_NODE_WEIGHT = SCRATCH + 3
_PER_OLD_SPACING = SCRATCH + 4
_PER_MID_SPACING = SCRATCH + 5

_MOST_ITERATIONS = 40  # of a tension-only cable, before its step is halved
_MOST_PIECES = 1024  # that a step is halved into
_SETTLED = 1e-9  # change of a velocity within an iteration, relative to the fastest or to 1 m/s


@stage
def _constitutive_pass(S, at, n_elements, n_lanes, dt, tension_only, first):
    """Linearised law of each element about the trial state: T = tension + stiffness · (D_{j+1} - D_j).

    T is the mean over the step, D the displacement gained to mid-step. A linear cable's law stands here in
    increments, whose small numbers single precision keeps; a tension-only one's is `taut_tension`.
    """
    real = S.dtype.type
    beta, per_dt = real(2.0 / dt), real(1.0 / dt)
    zero, half, one, two = real(0.0), real(0.5), real(1.0), real(2.0)
    for j in range(n_elements):
        here = at[j]
        below = here + N_NODE_FIELDS
        for lane in range(n_lanes):
            EA, CA = row(S, CABLE_STIFFNESS)[lane], row(S, CABLE_DAMPING)[lane]
            per_spacing = row(S, _PER_MID_SPACING)[lane]
            elongation = row(S, below + DISPLACEMENT)[lane] - row(S, here + DISPLACEMENT)[lane]
            old = elongation * row(S, _PER_OLD_SPACING)[lane]
            # The old elongation on the cable's length at mid-step: the strain without any increment.
            base = elongation * per_spacing
            stiffness = EA + beta * CA
            tension = EA * base + beta * CA * (base - old)
            if tension_only:
                gained_to_middle = (
                    row(S, below + INCREMENT)[lane] - row(S, here + INCREMENT)[lane]
                ) * per_spacing
                gained_to_middle = zero if first else gained_to_middle
                new = two * (base + gained_to_middle) - old
                tension, slope = taut_tension(old, new, EA, CA, per_dt, zero, half, one)
                stiffness = two * slope
                tension -= stiffness * gained_to_middle
            row(S, here + ELEMENT_STIFFNESS)[lane] = stiffness * per_spacing
            row(S, here + ELEMENT_TENSION)[lane] = tension


@stage
def _rope_strains(S, here, lane, first):
    """Old and new strain of the element below a node, the mid-step's gain and its base, as in
    `_constitutive_pass`."""
    real = S.dtype.type
    zero, two = real(0.0), real(2.0)
    below = here + N_NODE_FIELDS
    per_spacing = row(S, _PER_MID_SPACING)[lane]
    elongation = row(S, below + DISPLACEMENT)[lane] - row(S, here + DISPLACEMENT)[lane]
    gained = (row(S, below + INCREMENT)[lane] - row(S, here + INCREMENT)[lane]) * per_spacing
    gained = zero if first else gained
    old = elongation * row(S, _PER_OLD_SPACING)[lane]
    return old, two * (elongation * per_spacing + gained) - old, gained


@seldom
def _rope_pass(S, at, n_elements, n_lanes, dt, tension_only, first):
    """`_constitutive_pass` of a rope beyond Hooke's law.

    What its Maxwell branches hold stands in rows of its own, at `at[n_elements + 1 + j]`.
    """
    real = S.dtype.type
    per_dt, half_step = real(1.0 / dt), real(0.5 * dt)
    zero, half, one, two = real(0.0), real(0.5), real(1.0), real(2.0)
    for lane in range(n_lanes):
        row(S, RELAXING_SHARE)[lane] = one / (one + half_step * row(S, RELAXATION_RATE)[lane])
    for j in range(n_elements):
        here, held = at[j], at[n_elements + 1 + j]
        for lane in range(n_lanes):
            old, new, gained = _rope_strains(S, here, lane, first)
            tension, slope, _ = rope_tension(
                old,
                new,
                row(S, held)[lane],
                row(S, CABLE_STIFFNESS)[lane],
                row(S, CABLE_QUADRATIC)[lane],
                row(S, CABLE_CUBIC)[lane],
                row(S, RELAXING_STIFFNESS)[lane],
                row(S, RELAXING_SHARE)[lane],
                row(S, CABLE_DAMPING)[lane],
                per_dt,
                tension_only,
                zero,
                half,
                one,
            )
            stiffness = two * slope
            row(S, here + ELEMENT_STIFFNESS)[lane] = stiffness * row(S, _PER_MID_SPACING)[lane]
            row(S, here + ELEMENT_TENSION)[lane] = tension - stiffness * gained


@seldom
def _relax(S, at, n_elements, n_lanes, tension_only):
    """Moves what the Maxwell branches hold on to the end of the step, before the nodes move."""
    real = S.dtype.type
    zero, half, one = real(0.0), real(0.5), real(1.0)
    for j in range(n_elements):
        here, held = at[j], at[n_elements + 1 + j]
        for lane in range(n_lanes):
            old, new, _ = _rope_strains(S, here, lane, False)
            before, EA1 = row(S, held)[lane], row(S, RELAXING_STIFFNESS)[lane]
            EA, quadratic, cubic = (
                row(S, CABLE_STIFFNESS)[lane],
                row(S, CABLE_QUADRATIC)[lane],
                row(S, CABLE_CUBIC)[lane],
            )
            share = row(S, RELAXING_SHARE)[lane]
            _, _, middle = rope_tension(
                old, new, before, EA, quadratic, cubic, EA1, share, zero, zero, tension_only, zero, half, one
            )
            row(S, held)[lane] = branch_after(
                old, new, before, middle, EA, quadratic, cubic, EA1, share, tension_only, zero, half
            )


@stage
def _forward_pass(S, at, n_elements, n_lanes, dt, first):
    """Assembles the momentum balance of each node in the increments D and eliminates downwards.

    Increments, not displacements: the forces that balance at rest then cancel before they are
    multiplied by M/dt², which is what makes single precision good enough.
    """
    real = S.dtype.type
    h = 1.0 / n_elements
    beta = real(2.0 / dt)
    half, one, two = real(0.5), real(1.0), real(2.0)
    first_difference, second_difference = real(0.5 / h), real(1.0 / (h * h))
    trial = VELOCITY if first else TRIAL_VELOCITY
    for lane in range(n_lanes):
        row(S, at[0] + SUPER)[lane] = real(0.0)
        row(S, at[0] + LOAD)[lane] = half * (row(S, SHEAVE_NEW)[lane] - row(S, SHEAVE_OLD)[lane])
    for j in range(1, n_elements):
        here = at[j]
        above, below = here - N_NODE_FIELDS, here + N_NODE_FIELDS
        g = real(1.0 - j * h)
        for lane in range(n_lanes):
            V, gk = row(S, LENGTH_SPEED)[lane], g * row(S, _CONVECTION)[lane]
            mu, w = row(S, _NODE_MASS)[lane], row(S, here + trial)[lane]
            speed = abs(w)
            drag_slope = two * row(S, _NODE_DRAG)[lane] * speed
            # W̄ = β D + V + gκ Ū_y, and DW/Dt = β (W̄ - W) + gκ ∂W̄/∂y with the compact Ū_yy.
            of_gradient = gk * (mu * (two * beta - row(S, _CONVECTION)[lane]) + drag_slope)
            of_curvature = mu * gk * gk
            gradient, curvature = first_difference * of_gradient, second_difference * of_curvature
            k_above, k_below = row(S, above + ELEMENT_STIFFNESS)[lane], row(S, here + ELEMENT_STIFFNESS)[lane]
            lower = -k_above - gradient + curvature
            upper = -k_below + gradient + curvature
            diagonal = beta * (mu * beta + drag_slope) + (k_above + k_below) - two * curvature
            U_above, U, U_below = (
                row(S, above + DISPLACEMENT)[lane],
                row(S, here + DISPLACEMENT)[lane],
                row(S, below + DISPLACEMENT)[lane],
            )
            slope = first_difference * (U_below - U_above)
            bend = second_difference * ((U_below - U) - (U - U_above))
            load = (
                mu * beta * (row(S, here + VELOCITY)[lane] - V)
                - drag_slope * V
                - (of_gradient - mu * beta * gk) * slope
                - of_curvature * bend
                + row(S, _NODE_WEIGHT)[lane]
                + row(S, _NODE_DRAG)[lane] * speed * w
                + (row(S, here + ELEMENT_TENSION)[lane] - row(S, above + ELEMENT_TENSION)[lane])
            )
            pivot = one / (diagonal - lower * row(S, above + SUPER)[lane])
            row(S, here + SUPER)[lane] = upper * pivot
            row(S, here + LOAD)[lane] = (load - lower * row(S, above + LOAD)[lane]) * pivot
    here = at[n_elements]
    above = here - N_NODE_FIELDS
    for lane in range(n_lanes):
        V = row(S, LENGTH_SPEED)[lane]
        mass = row(S, PAYLOAD_INERTIA)[lane] + half * row(S, _NODE_MASS)[lane]
        drag = row(S, PAYLOAD_DRAG)[lane] + half * row(S, _NODE_DRAG)[lane]
        w = row(S, here + trial)[lane]
        drag_slope = two * drag * abs(w)
        k_above = row(S, above + ELEMENT_STIFFNESS)[lane]
        load = (
            mass * beta * (row(S, here + VELOCITY)[lane] - V)
            - drag_slope * V
            + drag * abs(w) * w
            + (
                row(S, PAYLOAD_WEIGHT)[lane]
                + half * row(S, _NODE_WEIGHT)[lane]
                - row(S, above + ELEMENT_TENSION)[lane]
            )
        )
        diagonal = beta * (mass * beta + drag_slope) + k_above
        row(S, here + LOAD)[lane] = (load + k_above * row(S, above + LOAD)[lane]) / (
            diagonal + k_above * row(S, above + SUPER)[lane]
        )


@stage
def _backward_pass(S, at, n_elements, n_lanes, dt):
    """Substitutes upwards for the increments to mid-step and the velocities that go with them."""
    real = S.dtype.type
    h = 1.0 / n_elements
    beta = real(2.0 / dt)
    first_difference = real(0.5 / h)
    bottom = at[n_elements]
    for lane in range(n_lanes):
        increment = row(S, bottom + LOAD)[lane]
        row(S, bottom + INCREMENT)[lane] = increment
        row(S, bottom + TRIAL_VELOCITY)[lane] = beta * increment + row(S, LENGTH_SPEED)[lane]
    for j in range(n_elements - 1, -1, -1):
        here = at[j]
        for lane in range(n_lanes):
            below = row(S, here + N_NODE_FIELDS + INCREMENT)[lane]
            row(S, here + INCREMENT)[lane] = row(S, here + LOAD)[lane] - row(S, here + SUPER)[lane] * below
    for j in range(1, n_elements):
        here = at[j]
        above, below = here - N_NODE_FIELDS, here + N_NODE_FIELDS
        g = real(1.0 - j * h)
        for lane in range(n_lanes):
            old_difference = row(S, below + DISPLACEMENT)[lane] - row(S, above + DISPLACEMENT)[lane]
            gained_difference = row(S, below + INCREMENT)[lane] - row(S, above + INCREMENT)[lane]
            slope = first_difference * (old_difference + gained_difference)
            row(S, here + TRIAL_VELOCITY)[lane] = (
                beta * row(S, here + INCREMENT)[lane]
                + row(S, LENGTH_SPEED)[lane]
                + g * row(S, _CONVECTION)[lane] * slope
            )


@stage
def _begin_step(S, n_elements, n_lanes):
    """What the step's two lengths fix once for all iterations: convection, mass, drag, weight, spacings."""
    real = S.dtype.type
    h = real(1.0 / n_elements)
    half, one = real(0.5), real(1.0)
    for lane in range(n_lanes):
        middle = half * (row(S, LENGTH_OLD)[lane] + row(S, LENGTH)[lane])
        V = row(S, LENGTH_SPEED)[lane]
        row(S, MID_LENGTH)[lane] = middle
        row(S, _CONVECTION)[lane] = V / middle
        row(S, _NODE_MASS)[lane] = row(S, CABLE_INERTIA)[lane] * middle * h
        row(S, _NODE_DRAG)[lane] = row(S, CABLE_DRAG)[lane] * middle * h
        row(S, _NODE_WEIGHT)[lane] = row(S, CABLE_WEIGHT)[lane] * middle * h
        row(S, _PER_OLD_SPACING)[lane] = one / (h * row(S, LENGTH_OLD)[lane])
        row(S, _PER_MID_SPACING)[lane] = one / (h * middle)


@stage
def cable_move(S, at, n_elements, n_lanes, tension_only, hookean):
    """Moves the nodes on by twice their increments to mid-step."""
    real = S.dtype.type
    if not hookean:
        _relax(S, at, n_elements, n_lanes, tension_only)
    two = real(2.0)
    for lane in range(n_lanes):
        row(S, at[0] + DISPLACEMENT)[lane] = row(S, SHEAVE_NEW)[lane]
    for j in range(1, n_elements + 1):
        here = at[j]
        for lane in range(n_lanes):
            row(S, here + DISPLACEMENT)[lane] += two * row(S, here + INCREMENT)[lane]
            row(S, here + VELOCITY)[lane] = (
                two * row(S, here + TRIAL_VELOCITY)[lane] - row(S, here + VELOCITY)[lane]
            )


@stage
def cable_solve(S, at, n_elements, n_iterations, n_lanes, dt, tension_only, hookean):
    """Finds what every node gains in one solver step and leaves it in `INCREMENT`; nothing has moved yet."""
    _begin_step(S, n_elements, n_lanes)
    for iteration in range(n_iterations):
        if hookean:
            _constitutive_pass(S, at, n_elements, n_lanes, dt, tension_only, iteration == 0)
        else:
            _rope_pass(S, at, n_elements, n_lanes, dt, tension_only, iteration == 0)
        _forward_pass(S, at, n_elements, n_lanes, dt, iteration == 0)
        _backward_pass(S, at, n_elements, n_lanes, dt)


@stage
def cable_step(S, at, n_elements, n_iterations, n_lanes, dt, tension_only, hookean):
    """Advances cable and payload by one solver step.

    Reads the sheave's displacement and the length at both ends of the step (`SHEAVE_OLD`, `SHEAVE_NEW`,
    `LENGTH_OLD`, `LENGTH`); rewrites the nodes. `at` holds the row at which each node begins: were it
    computed, the compiler would test the rows of all nodes at once for overlap, which rows that lie
    between each other fail, and run the scalar loops.
    """
    cable_solve(S, at, n_elements, n_iterations, n_lanes, dt, tension_only, hookean)
    cable_move(S, at, n_elements, n_lanes, tension_only, hookean)


@stage
def solved_sheave_tension(S, at, n_elements, lane, tension_only):
    """Tension at the sheave over the step that `cable_solve` found, linear through the nearest elements."""
    real = S.dtype.type
    here, beyond = at[0], at[min(1, n_elements - 1)]
    nearest = row(S, here + N_NODE_FIELDS + INCREMENT)[lane] - row(S, here + INCREMENT)[lane]
    second = row(S, beyond + N_NODE_FIELDS + INCREMENT)[lane] - row(S, beyond + INCREMENT)[lane]
    nearest = row(S, here + ELEMENT_TENSION)[lane] + row(S, here + ELEMENT_STIFFNESS)[lane] * nearest
    second = row(S, beyond + ELEMENT_TENSION)[lane] + row(S, beyond + ELEMENT_STIFFNESS)[lane] * second
    tension = real(1.5) * nearest - real(0.5) * second
    return max(tension, real(0.0)) if tension_only else tension


@stage
def _settled_step(S, at, n_elements, n_iterations, dt, tension_only, hookean, trial):
    """`cable_step` of a single lane; one that is not linear iterates on until its velocities settle.

    Returns the last change of a velocity within an iteration [m/s], relative where that is above 1 m/s: zero
    for a linear cable, whose iterations are counted, not watched.
    """
    _begin_step(S, n_elements, 1)
    change = 0.0
    for j in range(n_elements + 1):
        trial[j] = S[at[j] + VELOCITY, 0]
    watched = tension_only or not hookean
    for iteration in range(max(n_iterations, _MOST_ITERATIONS) if watched else n_iterations):
        if hookean:
            _constitutive_pass(S, at, n_elements, 1, dt, tension_only, iteration == 0)
        else:
            _rope_pass(S, at, n_elements, 1, dt, tension_only, iteration == 0)
        _forward_pass(S, at, n_elements, 1, dt, iteration == 0)
        _backward_pass(S, at, n_elements, 1, dt)
        if watched:
            change, fastest = 0.0, 1.0
            for j in range(1, n_elements + 1):
                velocity = S[at[j] + TRIAL_VELOCITY, 0]
                change = max(change, abs(velocity - trial[j]))
                fastest = max(fastest, abs(velocity))
                trial[j] = velocity
            change /= fastest
            if iteration + 1 >= n_iterations and change <= _SETTLED:
                break
    cable_move(S, at, n_elements, 1, tension_only, hookean)
    return change


@stage
def cable_tensions(S, at, n_elements, n_lanes, tension_only):
    """Tensions at the sheave and the payload, and the extremes along the cable since they were cleared.

    They are means over the last solver step, the very tensions that moved the nodes. Element tensions
    stand at the middles of the elements; the ends are extrapolated linearly from the two nearest. Each
    element's tension is left in its `LOAD` field.
    """
    real = S.dtype.type
    zero, one, one_and_half, half = real(0.0), real(1.0), real(1.5), real(0.5)
    for j in range(n_elements):
        here = at[j]
        below = here + N_NODE_FIELDS
        for lane in range(n_lanes):
            gained = row(S, below + INCREMENT)[lane] - row(S, here + INCREMENT)[lane]
            tension = row(S, here + ELEMENT_TENSION)[lane] + row(S, here + ELEMENT_STIFFNESS)[lane] * gained
            tension = tension if (tension > zero or not tension_only) else zero
            least, most = row(S, TENSION_MIN)[lane], row(S, TENSION_MAX)[lane]
            row(S, here + LOAD)[lane] = tension
            row(S, TENSION_MIN)[lane] = tension if tension < least else least
            row(S, TENSION_MAX)[lane] = tension if tension > most else most
    last = at[n_elements - 1]
    second = at[0] + (N_NODE_FIELDS if n_elements > 1 else 0)
    last_but_one = last - (N_NODE_FIELDS if n_elements > 1 else 0)
    for lane in range(n_lanes):
        top = one_and_half * row(S, at[0] + LOAD)[lane] - half * row(S, second + LOAD)[lane]
        end = one_and_half * row(S, last + LOAD)[lane] - half * row(S, last_but_one + LOAD)[lane]
        if tension_only:
            top, end = max(top, zero), max(end, zero)
        row(S, SHEAVE_TENSION)[lane] = top
        row(S, PAYLOAD_TENSION)[lane] = end
        row(S, TENSION_MIN)[lane] = min(row(S, TENSION_MIN)[lane], min(top, end))
        row(S, TENSION_MAX)[lane] = max(row(S, TENSION_MAX)[lane], max(top, end))
        row(S, SLACK)[lane] = one if row(S, TENSION_MIN)[lane] <= zero else zero


@seldom
def hanging_strain(S, lane, tension):
    """Strain of a relaxed rope beyond Hooke's law under a tension."""
    EA, quadratic, cubic = S[CABLE_STIFFNESS, lane], S[CABLE_QUADRATIC, lane], S[CABLE_CUBIC, lane]
    real = S.dtype.type
    return real(strain_of(np.float64(tension), np.float64(EA), np.float64(quadratic), np.float64(cubic)))


@seldom
def hanging_stretch(S, lane, n_elements, length):
    """Stretch of a rope beyond Hooke's law that hangs still, element by element as `hang_still` has it."""
    real = S.dtype.type
    h, half = real(1.0 / n_elements), real(0.5)
    stretch = real(0.0)
    for j in range(n_elements):
        tension = S[PAYLOAD_WEIGHT, lane] + S[CABLE_WEIGHT, lane] * length * h * (real(n_elements - j) - half)
        stretch += hanging_strain(S, lane, tension) * length * h
    return stretch


@stage
def hang_still(S, lane, nodes, n_elements, sheave, hookean):
    """Puts one lane at rest in static equilibrium below a sheave displaced by `sheave`, positive down."""
    real = S.dtype.type
    h = real(1.0 / n_elements)
    half = real(0.5)
    L, EA = S[LENGTH, lane], S[CABLE_STIFFNESS, lane]
    displacement = sheave
    for j in range(n_elements + 1):
        here = nodes + N_NODE_FIELDS * j
        S[here + DISPLACEMENT, lane] = displacement
        S[here + VELOCITY, lane] = real(0.0)
        from_payload = real(n_elements - j) - half
        tension = S[PAYLOAD_WEIGHT, lane] + S[CABLE_WEIGHT, lane] * L * h * from_payload
        S[here + INCREMENT, lane] = real(0.0)
        S[here + TRIAL_VELOCITY, lane] = real(0.0)
        S[here + ELEMENT_STIFFNESS, lane] = EA / (L * h)
        S[here + ELEMENT_TENSION, lane] = tension
        if hookean:
            displacement += tension * L * h / EA
        else:
            displacement += hanging_strain(S, lane, tension) * L * h
    if not hookean:
        behind = nodes + N_NODE_FIELDS * (n_elements + 1)
        for j in range(n_elements):
            S[behind + j, lane] = real(0.0)


def n_cable_rows(n_elements: int, *, hookean: bool) -> int:
    """Rows that nodes (and the Maxwell branches of a rope beyond Hooke's law) take in a state buffer [-]."""
    return N_NODE_FIELDS * (n_elements + 1) + (0 if hookean else n_elements)


def node_rows(first: int, n_elements: int, *, hookean: bool) -> Array:
    """Rows at which the nodes stand in a state buffer, from row `first` on, (n_elements + 1,).

    Those of a rope beyond Hooke's law are followed by the rows of its Maxwell branches, (n_elements,).
    """
    nodes = first + N_NODE_FIELDS * np.arange(n_elements + 1, dtype=np.int64)
    behind = first + N_NODE_FIELDS * (n_elements + 1) + np.arange(n_elements, dtype=np.int64)
    return nodes if hookean else np.concatenate([nodes, behind])


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
    def march(state, at, n_elements, n_iterations, dt, tension_only, hookean, sheave, length, out, envelope):
        """Drives one cable through given sheave displacements and lengths.

        Fills `out` (n_steps + 1, 6) and the least and most tension of each element, `envelope` (2,
        n_elements). Returns the first instant that was not reached (-1: none) and what was left there.
        """
        if fingerprint == 0:
            return -1, 0.0
        S = block_of_lanes(state, 1)
        bottom = at[n_elements]
        trial = np.empty(n_elements + 1)
        before = np.empty(state.shape)
        for k in range(len(sheave)):
            S[TENSION_MIN, 0], S[TENSION_MAX, 0] = np.inf, -np.inf
            if k > 0:
                before[:] = state
                pieces = 1
                while True:
                    change = 0.0
                    for piece in range(pieces):
                        a, b = piece / pieces, (piece + 1) / pieces
                        S[SHEAVE_OLD, 0] = (1.0 - a) * sheave[k - 1] + a * sheave[k]
                        S[SHEAVE_NEW, 0] = (1.0 - b) * sheave[k - 1] + b * sheave[k]
                        S[LENGTH_OLD, 0] = (1.0 - a) * length[k - 1] + a * length[k]
                        S[LENGTH, 0] = (1.0 - b) * length[k - 1] + b * length[k]
                        S[LENGTH_SPEED, 0] = (length[k] - length[k - 1]) / dt
                        change = _settled_step(
                            S, at, n_elements, n_iterations, dt / pieces, tension_only, hookean, trial
                        )
                        if not change <= _SETTLED:
                            break
                        cable_tensions(S, at, n_elements, 1, tension_only)
                    if change <= _SETTLED:
                        break
                    pieces *= 2
                    if pieces > _MOST_PIECES:
                        return k, change
                    state[:] = before
            else:
                cable_tensions(S, at, n_elements, 1, tension_only)
            out[k, 0] = S[bottom + DISPLACEMENT, 0]
            out[k, 1] = S[bottom + VELOCITY, 0]
            out[k, 2] = S[SHEAVE_TENSION, 0]
            out[k, 3] = S[PAYLOAD_TENSION, 0]
            out[k, 4] = S[TENSION_MIN, 0]
            out[k, 5] = S[TENSION_MAX, 0]
            for j in range(n_elements):
                tension = S[at[j] + LOAD, 0]
                envelope[0, j] = min(envelope[0, j], tension)
                envelope[1, j] = max(envelope[1, j], tension)
            if not np.isfinite(out[k, 1]):
                return k, np.inf
        return -1, 0.0

    @njit(cache=True, error_model="numpy")
    def hang(S, n_elements, sheave, hookean):
        """Hangs the cable still below the sheave."""
        if fingerprint != 0:
            hang_still(S, 0, N_FIXED, n_elements, sheave, hookean)

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
        of_elements = nodes[1:, LOAD]
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
        failed, residual = _march(
            S,
            node_rows(N_FIXED, self.n_elements, hookean=self.cable.is_hookean),
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
