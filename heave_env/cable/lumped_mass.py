"""3-D line of point masses joined by elastic segments: free, held or driven ends, slack, varying length.

Node i has position r and velocity v, segment j joins nodes j and j + 1, t is its unit tangent, P = I - t tᵀ
projects on the plane normal to it, l is its unstretched length. Half of each segment's mass, weight, added
mass and drag belongs to either of its nodes:

    (m_i + body) dv_i/dt + Σ (1/2) l_j (m_N P_j + m_a t_j t_jᵀ) dv_i/dt
                    = T_i t_i - T_{i-1} t_{i-1} + weight + Σ (1/2) l_j f(U - v_i, t_j) + body's drag
    T = EA e + C_A De/Dt,  e = |r_{j+1} - r_j| / l_j - 1  (T = 0 where slack, if the cable is tension-only)

f is the drag of `hydrodynamics.line_drag`, with each node's own velocity and the tangents of its two
segments: the thesis averages the velocities of the two nodes of a segment, which leaves neighbours that move
against each other undamped. A body's drag falls apart into a horizontal and a vertical one, or as
`body_drag` says. The water's acceleration exerts no force (no Froude-Krylov term).

Source: Huang (1992), chapter 5, (5.1)-(5.6), in vectors: the angles of his matrices are misprinted.

Varying length: material enters and leaves at the sheave, so that only the uppermost segment grows or
shrinks. Every other node is a fixed material point, whose equation is the one above: L' may jump and L''
never appears. When the uppermost segment exceeds 1.5 of its nominal length it is split; below 0.4 it is
merged with its neighbour (not 0.5, or a winch about that length would split and merge all the time).
A split puts the new node on the straight line between its neighbours, moved to where weight, drag and
inertia balance the two tensions, with the velocity interpolated linearly; a merge gives the velocity that
keeps the momentum. Both keep material and momentum exactly.

The model stops holding where bending or torsion matters, at a seabed (there is none), and for waves
shorter than some four segments: the chain passes none above ω = 2 sqrt(T / (m l)) / l.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numba import njit

from heave_env.cable.constitutive import mean_tension
from heave_env.cable.convergence import ConvergenceError
from heave_env.compiled import source_fingerprint, stage
from heave_env.hydrodynamics import (
    between_knots,
    current_knots,
    line_drag,
    line_drag_slopes,
    quadratic_drag,
)
from heave_env.parameters import (
    Current,
    Line,
    Payload,
    require,
    require_integer,
    require_number,
)

Array = np.ndarray
Water = Callable[[Array, float], Array]

LOWER_ENDS = ("free", "fixed", "driven")
UPPER_ENDS = ("driven", "fixed", "free")
BODY_DRAGS = ("components", "axes", "vector")

SPLIT_ABOVE, MERGE_BELOW = 1.5, 0.4
MOST_PIECES = 256

# Columns of the segments' numbers, all per unstretched length but for the stiffness and damping.
_MASS, _WEIGHT, _EA, _CA, _NORMAL_MASS, _AXIAL_MASS, _NORMAL_DRAG, _AXIAL_DRAG, _TENSION_ONLY = range(9)
# Columns of the nodes' bodies.
_BODY_MASS, _BODY_RISE, _BODY_SWAY, _BODY_WEIGHT, _BODY_RISE_DRAG, _BODY_SWAY_DRAG = range(6)


class _Motion(NamedTuple):
    """What moves: nodes and, at the sheave, unstretched lengths; room for more than there are."""

    r: Array
    v: Array
    acceleration: Array
    length: Array


class _Chain(NamedTuple):
    """What the line is made of."""

    law: Array
    bodies: Array
    nominal: float
    tolerance: float
    body_drag: int


class _Flow(NamedTuple):
    """The current's table, and velocities that stand in its place if there are any."""

    depth: Array
    along_x: Array
    along_y: Array
    knots: Array
    factors: Array
    given: Array


class _Ends(NamedTuple):
    """What is imposed at each instant."""

    bottoms: Array
    tops: Array
    lengths: Array


class _Record(NamedTuple):
    """Where a march writes."""

    positions: Array
    velocities: Array
    tensions: Array
    ends: Array
    counts: Array


class _Work(NamedTuple):
    """Increments, residuals and the blocks of the Jacobian."""

    u: Array
    G: Array
    change: Array
    below: Array
    diagonal: Array
    above: Array
    water: Array
    tension: Array
    l_new: Array


@stage
def _workspace(n):
    """Arrays for n segments."""
    return _Work(
        np.zeros((n + 1, 3)),
        np.zeros((n + 1, 3)),
        np.zeros((n + 1, 3)),
        np.zeros((n + 1, 9)),
        np.zeros((n + 1, 9)),
        np.zeros((n + 1, 9)),
        np.zeros((n + 1, 3)),
        np.zeros(n),
        np.zeros(n),
    )


@stage
def _magnitude(force):
    """Length of a vector of three."""
    return math.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2)


@stage
def _move(first, last, u, change, size, nominal):
    """Adds a correction of that size; no node moves by more than a segment: what is slack knows no wall."""
    share = 1.0 if size <= nominal else nominal / size
    for i in range(first, last + 1):
        for k in range(3):
            u[i, k] += share * change[i, k]


@stage
def _add_block(blocks, i, c, ax, ay, az, bx, by, bz, e):
    """Adds c a bᵀ + e I to the i-th 3 x 3 block."""
    blocks[i, 0] += c * ax * bx + e
    blocks[i, 1] += c * ax * by
    blocks[i, 2] += c * ax * bz
    blocks[i, 3] += c * ay * bx
    blocks[i, 4] += c * ay * by + e
    blocks[i, 5] += c * ay * bz
    blocks[i, 6] += c * az * bx
    blocks[i, 7] += c * az * by
    blocks[i, 8] += c * az * bz + e


@stage
def _add_symmetric(blocks, i, c, xx, xy, xz, yy, yz, zz):
    """Adds c times a symmetric matrix to the i-th block."""
    blocks[i, 0] += c * xx
    blocks[i, 1] += c * xy
    blocks[i, 2] += c * xz
    blocks[i, 3] += c * xy
    blocks[i, 4] += c * yy
    blocks[i, 5] += c * yz
    blocks[i, 6] += c * xz
    blocks[i, 7] += c * yz
    blocks[i, 8] += c * zz


@stage
def _add_force(G, i, x, y, z):
    """Takes a force on node i off its residual."""
    G[i, 0] -= x
    G[i, 1] -= y
    G[i, 2] -= z


@stage
def _drag_of_half(G, diagonal, neighbour, i, sign, share, U, V, t, spread, normal, axial, per_dt):
    """Adds the drag of half a segment to node i, and its slopes by velocity and by tangent.

    The tangent turns by P (δ_above - δ_below) / spread; `neighbour` is the off-diagonal block of node i and
    `sign` +1 if the other node of the segment is the upper one.
    """
    ux, uy, uz = U[0] - V[0], U[1] - V[1], U[2] - V[2]
    tx, ty, tz = t
    fx, fy, fz = line_drag(ux, uy, uz, tx, ty, tz, normal, axial)
    _add_force(G, i, share * fx, share * fy, share * fz)
    xx, xy, xz, yy, yz, zz = line_drag_slopes(ux, uy, uz, tx, ty, tz, normal, axial)
    _add_symmetric(diagonal, i, share * per_dt, xx, xy, xz, yy, yz, zz)
    along = ux * tx + uy * ty + uz * tz
    nx, ny, nz = ux - along * tx, uy - along * ty, uz - along * tz
    across = math.sqrt(nx * nx + ny * ny + nz * nz)
    c = sign * share / spread
    dyadic = -normal * along / across if across > 0.0 else 0.0
    isotropic = (axial * abs(along) - normal * across) * along
    mixed = 2.0 * axial * abs(along) - normal * across
    # ∂f/∂t P = dyadic U_N U_Nᵀ + isotropic (I - t tᵀ) + mixed t U_Nᵀ
    _add_block(neighbour, i, -c * dyadic, nx, ny, nz, nx, ny, nz, -c * isotropic)
    _add_block(neighbour, i, c * isotropic, tx, ty, tz, tx, ty, tz, 0.0)
    _add_block(neighbour, i, -c * mixed, tx, ty, tz, nx, ny, nz, 0.0)
    _add_block(diagonal, i, c * dyadic, nx, ny, nz, nx, ny, nz, c * isotropic)
    _add_block(diagonal, i, -c * isotropic, tx, ty, tz, tx, ty, tz, 0.0)
    _add_block(diagonal, i, c * mixed, tx, ty, tz, nx, ny, nz, 0.0)


@stage
def _body_force(ux, uy, uz, sway, rise, kind):
    """Drag of a body in relative velocity u, and its slopes xx, xy, yy, zz, xz, yz.

    Kind 0: horizontal and vertical each on its own; 1: x, y and z each on its own, as in the thesis;
    2: along the whole relative velocity.
    """
    if kind == 1:
        fx, xx = quadratic_drag(sway, ux)
        fy, yy = quadratic_drag(sway, uy)
        fz, zz = quadratic_drag(rise, uz)
        return fx, fy, fz, xx, 0.0, yy, zz, 0.0, 0.0
    if kind == 0:
        flat = math.sqrt(ux * ux + uy * uy)
        dyadic = sway / flat if flat > 0.0 else 0.0
        fz, zz = quadratic_drag(rise, uz)
        xx, yy = sway * flat + dyadic * ux * ux, sway * flat + dyadic * uy * uy
        return sway * flat * ux, sway * flat * uy, fz, xx, dyadic * ux * uy, yy, zz, 0.0, 0.0
    speed = math.sqrt(ux * ux + uy * uy + uz * uz)
    per = 1.0 / speed if speed > 0.0 else 0.0
    xx = sway * (speed + per * ux * ux)
    yy = sway * (speed + per * uy * uy)
    zz = rise * (speed + per * uz * uz)
    # The true xz and zx differ by sway / rise; their mean serves Newton.
    mixed = 0.5 * (sway + rise) * per * uz
    force = (sway * speed * ux, sway * speed * uy, rise * speed * uz)
    return force[0], force[1], force[2], xx, sway * per * ux * uy, yy, zz, mixed * ux, mixed * uy


@stage
def _assemble(n, r, v, l_old, chain, work, dt, static):
    """Residual of every node's equation of motion for the increments u, and its Jacobian in 3 x 3 blocks.

    In motion, forces are means over the step (a discrete gradient of the elastic energy) and drag is that at
    mid-step. At rest (`static`) they are those at r + u, and nothing moves.
    """
    law, bodies, body_drag = chain.law, chain.bodies, chain.body_drag
    u, G, below, diagonal, above = work.u, work.G, work.below, work.diagonal, work.above
    water, tension, l_new = work.water, work.tension, work.l_new
    per_dt = 0.0 if static else 1.0 / dt
    # At rest the old end of the step moves with the new one: every slope by position doubles.
    fold = 2.0 if static else 1.0
    for i in range(n + 1):
        for k in range(3):
            G[i, k] = 0.0
        for k in range(9):
            below[i, k] = 0.0
            diagonal[i, k] = 0.0
            above[i, k] = 0.0
    for j in range(n):
        EA, CA = law[j, _EA], law[j, _CA]
        gx, gy, gz = u[j + 1, 0] - u[j, 0], u[j + 1, 1] - u[j, 1], u[j + 1, 2] - u[j, 2]
        ox, oy, oz = r[j + 1, 0] - r[j, 0], r[j + 1, 1] - r[j, 1], r[j + 1, 2] - r[j, 2]
        x, y, z = ox + gx, oy + gy, oz + gz
        if static:
            ox, oy, oz = x, y, z
        stretched_old = math.sqrt(ox * ox + oy * oy + oz * oz)
        stretched = math.sqrt(x * x + y * y + z * z)
        per_sum = 1.0 / max(stretched_old + stretched, 1e-300)
        old = stretched_old / l_old[j] - 1.0
        new = stretched / l_new[j] - 1.0
        T, slope = mean_tension(old, new, EA, CA, per_dt, law[j, _TENSION_ONLY] > 0.0)
        tension[j] = T
        # |Δ1|² - |Δ0|² = (Δ1 - Δ0)·(Δ1 + Δ0): along this mean direction, work is exactly the energy gained.
        dx, dy, dz = (ox + x) * per_sum, (oy + y) * per_sum, (oz + z) * per_sum
        _add_force(G, j, T * dx, T * dy, T * dz)
        _add_force(G, j + 1, -T * dx, -T * dy, -T * dz)
        per_stretched = 1.0 / max(stretched, 1e-300)
        nx, ny, nz = x * per_stretched, y * per_stretched, z * per_stretched
        direct = fold * T * per_sum
        dyadic = fold * slope / l_new[j] - direct
        _add_block(diagonal, j, dyadic, dx, dy, dz, nx, ny, nz, direct)
        _add_block(diagonal, j + 1, dyadic, dx, dy, dz, nx, ny, nz, direct)
        _add_block(above, j, -dyadic, dx, dy, dz, nx, ny, nz, -direct)
        _add_block(below, j + 1, -dyadic, dx, dy, dz, nx, ny, nz, -direct)

        mx, my, mz = ox + x, oy + y, oz + z
        spread = max(math.sqrt(mx * mx + my * my + mz * mz), 1e-300)
        tx, ty, tz = mx / spread, my / spread, mz / spread
        half = 0.25 * (l_old[j] + l_new[j])
        normal, axial = law[j, _NORMAL_DRAG], law[j, _AXIAL_DRAG]
        for side in range(2):
            i = j + side
            _add_force(G, i, 0.0, 0.0, -half * law[j, _WEIGHT])
            V = (per_dt * u[i, 0], per_dt * u[i, 1], per_dt * u[i, 2])
            if normal > 0.0 or axial > 0.0:
                U, t = (water[i, 0], water[i, 1], water[i, 2]), (tx, ty, tz)
                if side == 0:
                    _drag_of_half(
                        G, diagonal, above, i, 1.0, half, U, V, t, spread / fold, normal, axial, per_dt
                    )
                else:
                    _drag_of_half(
                        G, diagonal, below, i, -1.0, half, U, V, t, spread / fold, normal, axial, per_dt
                    )
            if not static:
                across = half * (law[j, _MASS] + law[j, _NORMAL_MASS])
                extra = half * (law[j, _AXIAL_MASS] - law[j, _NORMAL_MASS])
                beta = 2.0 * per_dt
                ax = beta * (V[0] - v[i, 0])
                ay = beta * (V[1] - v[i, 1])
                az = beta * (V[2] - v[i, 2])
                along = extra * (ax * tx + ay * ty + az * tz)
                _add_force(
                    G, i, -across * ax - along * tx, -across * ay - along * ty, -across * az - along * tz
                )
                curb = beta * per_dt
                _add_block(diagonal, i, curb * extra, tx, ty, tz, tx, ty, tz, curb * across)
    for i in range(n + 1):
        mass = bodies[i, _BODY_MASS]
        if mass > 0.0:
            V = (per_dt * u[i, 0], per_dt * u[i, 1], per_dt * u[i, 2])
            fx, fy, fz, xx, xy, yy, zz, xz, yz = _body_force(
                water[i, 0] - V[0],
                water[i, 1] - V[1],
                water[i, 2] - V[2],
                bodies[i, _BODY_SWAY_DRAG],
                bodies[i, _BODY_RISE_DRAG],
                body_drag,
            )
            _add_force(G, i, fx, fy, fz - bodies[i, _BODY_WEIGHT])
            _add_symmetric(diagonal, i, per_dt, xx, xy, xz, yy, yz, zz)
            if not static:
                beta = 2.0 * per_dt
                sway, rise = mass + bodies[i, _BODY_SWAY], mass + bodies[i, _BODY_RISE]
                _add_force(
                    G,
                    i,
                    -sway * beta * (V[0] - v[i, 0]),
                    -sway * beta * (V[1] - v[i, 1]),
                    -rise * beta * (V[2] - v[i, 2]),
                )
                curb = beta * per_dt
                _add_symmetric(diagonal, i, curb, sway, 0.0, 0.0, sway, 0.0, rise)


@stage
def _eliminate(first, last, G, below, diagonal, above, change):
    """Solves the block-tridiagonal system for nodes `first` to `last`: change = -J⁻¹ G; the rest stays.

    Block elimination without pivoting across blocks, which inertia makes safe. Overwrites the blocks.
    """
    for i in range(first, last + 1):
        if i > first:
            for p in range(3):
                b0, b1, b2 = below[i, 3 * p], below[i, 3 * p + 1], below[i, 3 * p + 2]
                h = i - 1
                for q in range(3):
                    diagonal[i, 3 * p + q] -= b0 * above[h, q] + b1 * above[h, 3 + q] + b2 * above[h, 6 + q]
                G[i, p] += b0 * change[h, 0] + b1 * change[h, 1] + b2 * change[h, 2]
        a, b, c = diagonal[i, 0], diagonal[i, 1], diagonal[i, 2]
        d, e, f = diagonal[i, 3], diagonal[i, 4], diagonal[i, 5]
        g, h0, k = diagonal[i, 6], diagonal[i, 7], diagonal[i, 8]
        A, B, C = e * k - f * h0, f * g - d * k, d * h0 - e * g
        per = 1.0 / (a * A + b * B + c * C)
        i00, i01, i02 = A * per, (c * h0 - b * k) * per, (b * f - c * e) * per
        i10, i11, i12 = B * per, (a * k - c * g) * per, (c * d - a * f) * per
        i20, i21, i22 = C * per, (b * g - a * h0) * per, (a * e - b * d) * per
        x, y, z = G[i, 0], G[i, 1], G[i, 2]
        change[i, 0] = -(i00 * x + i01 * y + i02 * z)
        change[i, 1] = -(i10 * x + i11 * y + i12 * z)
        change[i, 2] = -(i20 * x + i21 * y + i22 * z)
        for q in range(3):
            x, y, z = above[i, q], above[i, 3 + q], above[i, 6 + q]
            above[i, q] = i00 * x + i01 * y + i02 * z
            above[i, 3 + q] = i10 * x + i11 * y + i12 * z
            above[i, 6 + q] = i20 * x + i21 * y + i22 * z
    for i in range(last - 1, first - 1, -1):
        x, y, z = change[i + 1, 0], change[i + 1, 1], change[i + 1, 2]
        for p in range(3):
            change[i, p] -= above[i, 3 * p] * x + above[i, 3 * p + 1] * y + above[i, 3 * p + 2] * z


@stage
def _largest(values, first, last):
    """Largest magnitude in rows `first` to `last`; NaN counts as infinite."""
    most = 0.0
    for i in range(first, last + 1):
        for k in range(3):
            size = abs(values[i, k])
            if not size < np.inf:
                return np.inf
            most = max(most, size)
    return most


@stage
def _end_force(upper, n, motion, chain, work, dt, static, held, out, fed):
    """Force in the cable at its lower or upper end, directed up along it [N], from the end segment.

    The end segment's tension stands at its middle; the half between there and the end adds its weight,
    drag and inertia. `fed` is the speed at which the material leaves the end.
    """
    r, _, acceleration, l_old = motion
    law, u, water, tension, l_new = chain.law, work.u, work.water, work.tension, work.l_new
    j = n - 1 if upper else 0
    end = n if upper else 0
    per_dt = 0.0 if static else 1.0 / dt
    # A held end's own acceleration is not known; that of its neighbour is, and is as accurate.
    source = (n - 1 if upper else 1) if held else end
    both_held_neighbour = n == 1 and held and not static
    m = np.empty(3)
    d = np.empty(3)
    stretched_old = 0.0
    stretched = 0.0
    for k in range(3):
        o = r[j + 1, k] - r[j, k]
        w = o + u[j + 1, k] - u[j, k]
        if static:
            o = w
        m[k] = o + w
        stretched_old += o * o
        stretched += w * w
    total = max(math.sqrt(stretched_old) + math.sqrt(stretched), 1e-300)
    spread = 0.0
    for k in range(3):
        d[k] = m[k] / total
        spread += m[k] * m[k]
    spread = max(math.sqrt(spread), 1e-300)
    tx, ty, tz = m[0] / spread, m[1] / spread, m[2] / spread
    half = 0.25 * (l_old[j] + l_new[j])
    vx, vy, vz = per_dt * u[end, 0] - fed * tx, per_dt * u[end, 1] - fed * ty, per_dt * u[end, 2] - fed * tz
    fx, fy, fz = line_drag(
        water[end, 0] - vx,
        water[end, 1] - vy,
        water[end, 2] - vz,
        tx,
        ty,
        tz,
        law[j, _NORMAL_DRAG],
        law[j, _AXIAL_DRAG],
    )
    ax, ay, az = acceleration[source, 0], acceleration[source, 1], acceleration[source, 2]
    if both_held_neighbour or static:
        ax, ay, az = 0.0, 0.0, 0.0
    along = (law[j, _AXIAL_MASS] - law[j, _NORMAL_MASS]) * (ax * tx + ay * ty + az * tz)
    inertia = law[j, _MASS] + law[j, _NORMAL_MASS]
    sign = 1.0 if upper else -1.0
    out[0] = tension[j] * d[0] + sign * half * (inertia * ax + along * tx - fx)
    out[1] = tension[j] * d[1] + sign * half * (inertia * ay + along * ty - fy)
    out[2] = tension[j] * d[2] + sign * half * (inertia * az + along * tz - fz + law[j, _WEIGHT])


@stage
def _fill_water(n, r, v, dt, factor, flow, water):
    """Current at the nodes' positions half a step ahead."""
    for i in range(n + 1):
        below_surface = -(r[i, 2] + 0.5 * dt * v[i, 2])
        water[i, 0] = factor * between_knots(below_surface, flow.depth, flow.along_x)
        water[i, 1] = factor * between_knots(below_surface, flow.depth, flow.along_y)
        water[i, 2] = 0.0


@stage
def _split(n, motion, chain, water, fed):
    """Splits the uppermost segment of n; there is room for one more. Keeps material and momentum."""
    r, v, acceleration, length = motion
    law, nominal = chain.law, chain.nominal
    top, low = n, n - 1
    whole = length[n - 1]
    lower, upper = nominal, whole - nominal
    share = lower / whole
    for k in range(9):
        law[n, k] = law[n - 1, k]
    dx, dy, dz = r[top, 0] - r[low, 0], r[top, 1] - r[low, 1], r[top, 2] - r[low, 2]
    stretched = max(math.sqrt(dx * dx + dy * dy + dz * dz), 1e-300)
    t = (dx / stretched, dy / stretched, dz / stretched)
    EA = law[n - 1, _EA]
    T = EA * (stretched / whole - 1.0)
    mass = 0.5 * whole
    vx = v[low, 0] + share * (v[top, 0] - fed * t[0] - v[low, 0])
    vy = v[low, 1] + share * (v[top, 1] - fed * t[1] - v[low, 1])
    vz = v[low, 2] + share * (v[top, 2] - fed * t[2] - v[low, 2])
    fx, fy, fz = line_drag(
        water[low, 0] - vx,
        water[low, 1] - vy,
        water[low, 2] - vz,
        t[0],
        t[1],
        t[2],
        law[n, _NORMAL_DRAG],
        law[n, _AXIAL_DRAG],
    )
    inertia = law[n, _MASS]
    q = (
        mass * (fx - inertia * acceleration[low, 0]),
        mass * (fy - inertia * acceleration[low, 1]),
        mass * (fz - inertia * acceleration[low, 2] - law[n, _WEIGHT]),
    )
    along = q[0] * t[0] + q[1] * t[1] + q[2] * t[2]
    springs = 1.0 / lower + 1.0 / upper
    of_axial = 1.0 / (EA * springs)
    # A segment that is hardly taut says little of where across itself the new node belongs.
    of_normal = 1.0 / (T * springs) if T > 1e-4 * EA else 0.0
    for k in range(3):
        acceleration[top + 1, k] = acceleration[top, k]
        acceleration[top, k] = acceleration[low, k]
        r[top + 1, k] = r[top, k]
        v[top + 1, k] = v[top, k]
        across = q[k] - along * t[k]
        r[top, k] = r[low, k] + share * (r[top + 1, k] - r[low, k]) + of_axial * along * t[k]
        r[top, k] += min(max(of_normal * across, -0.05 * lower), 0.05 * lower)
    v[top, 0], v[top, 1], v[top, 2] = vx, vy, vz
    length[n - 1], length[n] = lower, upper


@stage
def _merge(n, motion, fed):
    """Merges the two uppermost segments of n > 2, which are of one cable. Keeps material and momentum."""
    r, v, acceleration, length = motion
    top, mid, low = n, n - 1, n - 2
    under, lower, upper = length[n - 3], length[n - 2], length[n - 1]
    dx, dy, dz = r[top, 0] - r[mid, 0], r[top, 1] - r[mid, 1], r[top, 2] - r[mid, 2]
    stretched = max(math.sqrt(dx * dx + dy * dy + dz * dz), 1e-300)
    t = (dx / stretched, dy / stretched, dz / stretched)
    for k in range(3):
        leaving = v[top, k] - fed * t[k]
        momentum = (under + lower) * v[low, k] + (lower + upper) * v[mid, k] - lower * leaving
        v[low, k] = momentum / (under + lower + upper)
        r[mid, k], v[mid, k], acceleration[mid, k] = r[top, k], v[top, k], acceleration[top, k]
    length[n - 2] = lower + upper


# At the top of the module, for numba's cache of a function that has another one in its closure never hits.
@njit(error_model="numpy")
def _advance(n, first, last, motion, chain, work, dt, limit):
    """One step: Newton on the increments `work.u`. Returns the residual left [N], zero if it settled."""
    r, v, acceleration, length = motion
    u, G, change = work.u, work.G, work.change
    for i in range(first, last + 1):
        for k in range(3):
            u[i, k] = dt * (v[i, k] + 0.5 * dt * acceleration[i, k])
    settled = False
    residual = np.inf
    for _ in range(limit):
        _assemble(n, r, v, length, chain, work, dt, False)
        residual = _largest(G, first, last)
        _eliminate(first, last, G, work.below, work.diagonal, work.above, change)
        size = _largest(change, first, last)
        if not size < np.inf:
            break
        _move(first, last, u, change, size, chain.nominal)
        if size <= chain.tolerance * chain.nominal:
            settled = True
            break
    if not settled:
        return max(residual, 1e-300)
    # The tensions assembled last are those before the last correction.
    for j in range(n):
        old, new = 0.0, 0.0
        for k in range(3):
            o = r[j + 1, k] - r[j, k]
            old += o * o
            new += (o + u[j + 1, k] - u[j, k]) ** 2
        strains = math.sqrt(old) / length[j] - 1.0, math.sqrt(new) / work.l_new[j] - 1.0
        EA, CA = chain.law[j, _EA], chain.law[j, _CA]
        slack = chain.law[j, _TENSION_ONLY] > 0.0
        work.tension[j], _ = mean_tension(strains[0], strains[1], EA, CA, 1.0 / dt, slack)
    for i in range(first, last + 1):
        for k in range(3):
            acceleration[i, k] = 2.0 / dt * (u[i, k] / dt - v[i, k])
    return 0.0


def _make_march(fingerprint: int):
    @njit(cache=True, error_model="numpy")
    def march(n, lower_held, upper_held, motion, chain, ends, flow, time, dt, every, record):
        """Drives the line through given motions of its ends and lengths; fills the record.

        Returns the segments at the end, the step that failed (-1: none) and its residual.
        """
        if fingerprint == 0:
            return n, 0, np.inf
        r, v, acceleration, length = motion
        room = len(length)
        work = _workspace(room)
        u, water, tension, l_new = work.u, work.water, work.tension, work.l_new
        r_kept, v_kept, a_kept = np.empty_like(r), np.empty_like(v), np.empty_like(acceleration)
        bottom_force, top_force = np.zeros(3), np.zeros(3)
        least, most = np.inf, -np.inf
        first = 1 if lower_held else 0
        for step in range(1, len(ends.lengths)):
            l_start = length[n - 1]
            gained = ends.lengths[step] - ends.lengths[step - 1]
            fed = gained / dt
            last = n - 1 if upper_held else n
            r_kept[:], v_kept[:], a_kept[:] = r, v, acceleration
            residual = np.inf
            pieces = 1
            while pieces <= MOST_PIECES:
                h = dt / pieces
                for piece in range(pieces):
                    begin = time + (step - 1) * dt + piece * h
                    if len(flow.given) > 0:
                        water[: n + 1] = flow.given[: n + 1]
                    else:
                        factor = between_knots(begin + 0.5 * h, flow.knots, flow.factors)
                        _fill_water(n, r, v, h, factor, flow, water)
                    l_new[:n] = length[:n]
                    l_new[n - 1] = l_start + gained * (piece + 1) / pieces
                    for k in range(3):
                        if lower_held:
                            u[0, k] = (ends.bottoms[step, k] - ends.bottoms[step - 1, k]) / pieces
                        if upper_held:
                            u[n, k] = (ends.tops[step, k] - ends.tops[step - 1, k]) / pieces
                    limit = 20 if pieces < MOST_PIECES else 60
                    residual = _advance(n, first, last, motion, chain, work, h, limit)
                    if residual > 0.0:
                        break
                    _end_force(False, n, motion, chain, work, h, False, lower_held, bottom_force, 0.0)
                    _end_force(True, n, motion, chain, work, h, False, upper_held, top_force, fed)
                    for i in range(n + 1):
                        free = first <= i <= last
                        for k in range(3):
                            mean = u[i, k] / h
                            r[i, k] += u[i, k]
                            v[i, k] = 2.0 * mean - v[i, k] if free else mean
                    length[n - 1] = l_new[n - 1]
                    for j in range(n):
                        least, most = min(least, tension[j]), max(most, tension[j])
                    most = max(most, _magnitude(bottom_force), _magnitude(top_force))
                if residual == 0.0:
                    break
                r[:], v[:], acceleration[:] = r_kept, v_kept, a_kept
                length[n - 1] = l_start
                pieces *= 2
            if residual > 0.0:
                return n, step, residual
            for k in range(3):
                # Sums of increments drift by rounding; the ends stand where they are told to.
                if lower_held:
                    r[0, k] = ends.bottoms[step, k]
                if upper_held:
                    r[n, k] = ends.tops[step, k]
            while length[n - 1] > SPLIT_ABOVE * chain.nominal and n < room:
                _split(n, motion, chain, water, fed)
                tension[n] = tension[n - 1]
                water[n + 1] = water[n]
                n += 1
            while length[n - 1] < MERGE_BELOW * chain.nominal and n > 2:
                _merge(n, motion, fed)
                n -= 1
            if step % every == 0:
                k = step // every - 1
                record.counts[k] = n
                for i in range(room + 1):
                    record.positions[k, i] = r[min(i, n)]
                    record.velocities[k, i] = v[min(i, n)]
                for i in range(room):
                    record.tensions[k, i] = tension[min(i, n - 1)]
                record.ends[k, 0:3], record.ends[k, 3:6] = bottom_force, top_force
                record.ends[k, 6], record.ends[k, 7] = least, most
                least, most = np.inf, -np.inf
        return n, -1, 0.0

    @njit(cache=True, error_model="numpy")
    def settle(
        n, lower_held, upper_held, motion, chain, flow, factor, scale, bottom_force, top_force, tension
    ):
        """Static equilibrium from the given shape: implicit steps down the forces, ever longer; then Newton.

        Each step solves G(r + u) + stiffness u = 0. Returns the largest force left over [N].
        """
        if fingerprint == 0:
            return np.inf
        r, still, _, length = motion
        work = _workspace(n)
        work.l_new[:] = length
        u, G, change, diagonal, water = work.u, work.G, work.change, work.diagonal, work.water
        first, last = 1 if lower_held else 0, n - 1 if upper_held else n
        stiffness = 10.0 * scale / chain.nominal
        least_stiffness, most_stiffness = 1e-9 * stiffness, 1e11 * stiffness
        for _ in range(600):
            _fill_water(n, r, still, 0.0, factor, flow, water)
            u[:] = 0.0
            settled = False
            for _ in range(12):
                _assemble(n, r, still, length, chain, work, 1.0, True)
                for i in range(first, last + 1):
                    for k in range(3):
                        G[i, k] += stiffness * u[i, k]
                        diagonal[i, 4 * k] += stiffness
                _eliminate(first, last, G, work.below, diagonal, work.above, change)
                size = _largest(change, first, last)
                if not size < np.inf:
                    break
                _move(first, last, u, change, size, chain.nominal)
                if size <= 1e-9 * chain.nominal:
                    settled = True
                    break
            if settled:
                moved = _largest(u, first, last)
                r += u
                if stiffness <= least_stiffness and moved <= 1e-7 * chain.nominal:
                    break
                stiffness = max(0.2 * stiffness, least_stiffness)
            else:
                stiffness *= 4.0
                if not stiffness < most_stiffness:
                    break
        _fill_water(n, r, still, 0.0, factor, flow, water)
        u[:] = 0.0
        _assemble(n, r, still, length, chain, work, 1.0, True)
        residual = _largest(G, first, last)
        tension[:] = work.tension
        _end_force(False, n, motion, chain, work, 1.0, True, lower_held, bottom_force, 0.0)
        _end_force(True, n, motion, chain, work, 1.0, True, upper_held, top_force, 0.0)
        return residual

    return march, settle


_march, _settle = _make_march(source_fingerprint())


@dataclass(frozen=True, eq=False)
class LineState:
    """The line at an instant: a value that copies and compares. Node 0 is the lower end."""

    time: float
    """The instant [s]."""
    positions: Array
    """Nodes [m], (n_nodes, 3): x, y horizontal, z up from the mean surface."""
    velocities: Array
    """Velocities of the nodes [m/s], (n_nodes, 3)."""
    accelerations: Array
    """Mean accelerations over the last step [m/s²], (n_nodes, 3)."""
    segment_lengths: Array
    """Unstretched lengths [m], (n_segments,)."""
    tensions: Array
    """Tension at the middle of each segment, mean over the last step [N], (n_segments,)."""
    bottom_force: Array
    """Force in the cable at its lower end, directed up along it, mean over the last step [N], (3,)."""
    top_force: Array
    """Force in the cable at its upper end, directed up along it, mean over the last step [N], (3,)."""

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, LineState):
            return NotImplemented
        names = list(self.__dataclass_fields__)
        return all(np.array_equal(getattr(self, name), getattr(other, name)) for name in names)

    @property
    def length(self) -> float:
        """Unstretched length of the line [m]."""
        return float(np.sum(self.segment_lengths))

    @property
    def arc_lengths(self) -> Array:
        """Unstretched distance of each node from the lower end [m], (n_nodes,)."""
        return np.concatenate([[0.0], np.cumsum(self.segment_lengths)])


@dataclass(frozen=True)
class LineRecord:
    """What a march recorded; the first axis is time, beginning with the instant that it started from.

    While length changes the number of nodes does: nodes not paid out stand at the sheave, segments not paid
    out carry the uppermost tension.
    """

    time: Array
    """Instants [s], (n_times,)."""
    positions: Array
    """Nodes [m], (n_times, n_nodes, 3)."""
    velocities: Array
    """Velocities of the nodes [m/s], (n_times, n_nodes, 3)."""
    segment_tensions: Array
    """Tension at the middle of each segment, mean over the step [N], (n_times, n_segments)."""
    bottom_force: Array
    """Force in the cable at its lower end, directed up along it [N], (n_times, 3)."""
    top_force: Array
    """Force in the cable at its upper end, directed up along it [N], (n_times, 3)."""
    least_tension: Array
    """Smallest tension of any segment since the last recorded instant [N], (n_times,)."""
    greatest_tension: Array
    """Largest tension anywhere since the last recorded instant [N], (n_times,)."""
    n_segments: Array
    """Segments paid out [-], (n_times,)."""
    length: Array
    """Unstretched length [m], (n_times,)."""
    end: LineState
    """The state at the last step."""

    @property
    def payload_position(self) -> Array:
        """Lower end [m], (n_times, 3)."""
        return self.positions[:, 0]

    @property
    def payload_velocity(self) -> Array:
        """Velocity of the lower end [m/s], (n_times, 3)."""
        return self.velocities[:, 0]

    @property
    def top_tension(self) -> Array:
        """Tension at the upper end [N], (n_times,)."""
        return np.linalg.norm(self.top_force, axis=1)

    @property
    def payload_tension(self) -> Array:
        """Tension at the lower end [N], (n_times,)."""
        return np.linalg.norm(self.bottom_force, axis=1)


@dataclass(frozen=True, kw_only=True)
class LumpedMassSolver:
    """A line in three dimensions: point masses joined by elastic segments.

    Implicit midpoint in time with the tension's discrete gradient, Newton with a block-tridiagonal Jacobian;
    second order in time and space, unconditionally stable, without algorithmic damping: in air, between ends
    that stand still, energy is kept to rounding, through slack and snap too. A step whose Newton does not
    settle is halved, down to 1/256 of itself.

    A slack line wants a tension-only cable with Kelvin damping of some milliseconds (C_A = EA · 5 ms).
    """

    line: Line
    """Sections and attached bodies; each body goes to the nearest node."""
    n_segments: int = 40
    """Segments over the line, shared out among its sections by length, at least one each [-]."""
    current: Current = field(default_factory=Current)
    """The current."""
    water: Water | None = None
    """Velocity of the water in place of `current`: a function of positions [m], (n_nodes, 3), and time [s]
    that returns (n_nodes, 3) [m/s]; called once per step, so the march is no longer one compiled loop."""
    lower: str = "free"
    """Lower end: `free` (with the payload, if any), `fixed` where it is, or `driven` by a given motion."""
    upper: str = "driven"
    """Upper end: `driven` by a given motion, `fixed`, or `free`."""
    payload: Payload | None = None
    """Body at a free lower end."""
    body_drag: str = "components"
    """Drag of bodies: `components` (horizontal and vertical each on its own), `axes` (x, y and z each on its
    own, as in the thesis; it depends on the axes) or `vector` (along the relative velocity)."""
    tolerance: float = 1e-9
    """Newton stops when its correction is below this fraction of a segment [-]; the error is far below."""

    def __post_init__(self) -> None:
        require_integer(self, "n_segments", minimum=1)
        require_number(self, "tolerance", positive=True)
        require(self.lower in LOWER_ENDS, self, "lower", f"one of {', '.join(LOWER_ENDS)}")
        require(self.upper in UPPER_ENDS, self, "upper", f"one of {', '.join(UPPER_ENDS)}")
        require(self.body_drag in BODY_DRAGS, self, "body_drag", f"one of {', '.join(BODY_DRAGS)}")
        if self.lower != "free":
            require(self.payload is None, self, "payload", "null unless the lower end is free")
        if (
            self.payload is None
            and self.lower == "free"
            and self.line.sections[0].cable.mass_per_length == 0.0
        ):
            require(False, self, "payload", "given, since a free end of a massless cable has no inertia")

    @cached_property
    def _counts(self) -> list[int]:
        total = self.line.length
        return [max(1, round(self.n_segments * section.length / total)) for section in self.line.sections]

    @cached_property
    def _rest_lengths(self) -> Array:
        shares = zip(self.line.sections, self._counts, strict=True)
        return np.concatenate([np.full(count, section.length / count) for section, count in shares])

    @cached_property
    def nominal_length(self) -> float:
        """Unstretched length of a segment of the uppermost section [m]."""
        return float(self._rest_lengths[-1])

    @cached_property
    def _law(self) -> Array:
        rows = []
        for section, count in zip(self.line.sections, self._counts, strict=True):
            cable = section.cable
            row = [
                cable.mass_per_length,
                cable.submerged_weight,
                cable.axial_stiffness,
                cable.axial_damping,
                cable.normal_added_mass_per_length,
                cable.added_mass_per_length,
                cable.normal_drag_per_length,
                cable.tangential_drag_per_length,
                float(cable.tension_only),
            ]
            rows += [row] * count
        return np.array(rows)

    @cached_property
    def _bodies(self) -> Array:
        arcs = np.concatenate([[0.0], np.cumsum(self._rest_lengths)])
        bodies = np.zeros((len(arcs), 6))
        placed = [(attachment.arc_length, attachment.body) for attachment in self.line.attachments]
        if self.payload is not None:
            placed.append((0.0, self.payload))
        for arc, body in placed:
            lateral = body.lateral_inertia - body.mass
            numbers = [body.mass, body.added_mass, lateral, body.submerged_weight]
            numbers += [body.drag_factor, body.lateral_drag_factor]
            bodies[int(np.argmin(np.abs(arcs - arc)))] += numbers
        return bodies

    @cached_property
    def _least_length(self) -> float:
        """How short the line may become: what is below the uppermost section and its bodies, and a little."""
        lower_sections = self.line.length - self.line.sections[-1].length
        bodies = [attachment.arc_length for attachment in self.line.attachments]
        return max([lower_sections, *bodies]) + 2.0 * self.nominal_length

    def _held(self) -> tuple[bool, bool]:
        return self.lower != "free", self.upper != "free"

    def rest(
        self,
        top: Array | tuple[float, float, float] | None = (0.0, 0.0, 0.0),
        bottom: Array | tuple[float, float, float] | None = None,
        *,
        time: float = 0.0,
    ) -> LineState:
        """Static equilibrium in the current as it is at `time`.

        Args:
            top: Position of a held upper end [m], (3,); not looked at if it is free.
            bottom: Position of a held lower end [m], (3,); not looked at if it is free.
            time: The instant [s].

        Raises:
            ValueError: If no end is held, a held end has no position, or the ends are too far apart.
            ConvergenceError: If no equilibrium is found; the residual is the largest force left over [N].
        """
        lower_held, upper_held = self._held()
        if not (lower_held or upper_held):
            raise ValueError("rest() needs a held end: set upper or lower to 'fixed' or 'driven'")
        high = _point("top", top) if upper_held else None
        low = _point("bottom", bottom) if lower_held else None
        r = self._first_shape(high, low)
        if self.water is None:
            flow = self._flow()
            return self._settled(r, flow, float(between_knots(time, flow.knots, flow.factors)), time)
        # The relaxation knows a profile over depth only: one through the nodes stands in for the water.
        moved = math.inf
        for _ in range(60):
            given = np.asarray(self.water(r, time), dtype=float)
            order = np.argsort(-r[:, 2], kind="stable")
            depth = -r[order, 2]
            keep = np.concatenate([[True], np.diff(depth) > 1e-9])
            knots = (depth[keep], given[order, 0][keep], given[order, 1][keep])
            state = self._settled(r.copy(), self._flow(knots), 1.0, time)
            moved, r = float(np.max(np.abs(state.positions - r))), state.positions
            if moved < 1e-6 * self.nominal_length:
                return state
        raise ConvergenceError(
            "the static shape in the given water did not settle; if its velocity is not horizontal or varies "
            "along the horizontal, march to the steady state instead; last movement in m",
            moved,
        )

    def _flow(self, knots: tuple[Array, Array, Array] | None = None, given: Array | None = None) -> _Flow:
        table = current_knots(self.current) if knots is None else knots
        times, factors = np.array(self.current.time, float), np.array(self.current.factor, float)
        return _Flow(*table, times, factors, np.zeros((0, 3)) if given is None else given)

    def _chain(self, n: int, nominal: float) -> _Chain:
        """Numbers of n segments and n + 1 nodes: what is beyond the first is of the uppermost section."""
        law, bodies = self._law, self._bodies
        if n > len(law):
            law = np.vstack([law, np.repeat(law[-1:], n - len(law), axis=0)])
            bodies = np.vstack([bodies, np.zeros((n + 1 - len(bodies), bodies.shape[1]))])
        kind = BODY_DRAGS.index(self.body_drag)
        return _Chain(law[:n].copy(), bodies[: n + 1].copy(), nominal, self.tolerance, kind)

    def _settled(self, r: Array, flow: _Flow, factor: float, time: float) -> LineState:
        """Static equilibrium from a first shape."""
        lengths = self._rest_lengths.copy()
        n = len(lengths)
        chain = self._chain(n, float(np.mean(lengths)))
        law, bodies = chain.law, chain.bodies
        fastest = float(np.max(np.hypot(flow.along_x, flow.along_y))) * abs(factor)
        drag = float(np.sum(lengths * (law[:, _NORMAL_DRAG] + law[:, _AXIAL_DRAG])))
        drag += float(np.sum(bodies[:, _BODY_RISE_DRAG] + bodies[:, _BODY_SWAY_DRAG]))
        weights = np.sum(np.abs(lengths * law[:, _WEIGHT])) + np.sum(np.abs(bodies[:, _BODY_WEIGHT]))
        # A weightless line between ends has no other force than its own.
        scale = max(float(weights) + drag * fastest**2, 1e-6 * float(np.min(law[:, _EA])))
        bottom_force, top_force, tension = np.zeros(3), np.zeros(3), np.zeros(n)
        motion = _Motion(r, np.zeros_like(r), np.zeros_like(r), lengths)
        residual = _settle(
            n, *self._held(), motion, chain, flow, factor, scale, bottom_force, top_force, tension
        )
        # Rounding of positions alone leaves EA · 1e-16 · |r| / l.
        rounding = float(np.max(law[:, _EA] / lengths)) * float(np.max(np.abs(r))) * 1e-14
        if not residual <= 1e-6 * scale + rounding:
            raise ConvergenceError(
                "no static equilibrium of the line was found; a net weight of nearly zero or a current that "
                "varies sharply over a segment is the likely cause: raise n_segments, or march from a given "
                f"shape with placed(); force left over in N, of {scale:.3g} N acting",
                residual,
            )
        return LineState(time, r, motion.v, motion.acceleration, lengths, tension, bottom_force, top_force)

    def placed(self, positions: Array, velocities: Array | None = None, *, time: float = 0.0) -> LineState:
        """A state of given nodes, to march from; tensions are those of its strains.

        Args:
            positions: Nodes, the lower end first [m], (n_nodes, 3), see `node_arc_lengths`.
            velocities: Their velocities [m/s], same shape; zero if not given.
            time: The instant [s].
        """
        r = np.array(positions, dtype=float)
        v = np.zeros_like(r) if velocities is None else np.array(velocities, dtype=float)
        n = len(self._rest_lengths)
        for name, values in (("positions", r), ("velocities", v)):
            if values.shape != (n + 1, 3) or not np.all(np.isfinite(values)):
                raise ValueError(f"{name} must be finite numbers of shape ({n + 1}, 3), got {values.shape}")
        across = np.diff(r, axis=0)
        stretched = np.maximum(np.linalg.norm(across, axis=1), 1e-300)
        tension = self._law[:, _EA] * (stretched / self._rest_lengths - 1.0)
        tension = np.where(self._law[:, _TENSION_ONLY] > 0.0, np.maximum(tension, 0.0), tension)
        pull = (tension / stretched)[:, None] * across
        return LineState(time, r, v, np.zeros_like(r), self._rest_lengths.copy(), tension, pull[0], pull[-1])

    @property
    def node_arc_lengths(self) -> Array:
        """Unstretched distance of the nodes from the lower end at the start [m], (n_nodes,)."""
        return np.concatenate([[0.0], np.cumsum(self._rest_lengths)])

    def _first_shape(self, top: Array | None, bottom: Array | None) -> Array:
        """A guess of the static shape: taut, hanging straight, or a parabola of the right length."""
        lengths, total = self._rest_lengths, self.line.length
        arcs = np.concatenate([[0.0], np.cumsum(lengths)])
        weight = float(np.sum(lengths * self._law[:, _WEIGHT]) + np.sum(self._bodies[:, _BODY_WEIGHT]))
        down = np.array([0.0, 0.0, -1.0 if weight >= 0.0 else 1.0])
        if top is None or bottom is None:
            if top is not None:
                return top + (total - arcs)[:, None] * down
            assert bottom is not None
            # Standing on its lower end: a line that floats goes up, one that sinks hangs from it.
            return bottom + arcs[:, None] * down
        chord = top - bottom
        span = float(np.linalg.norm(chord))
        if span > 1.5 * total:
            raise ValueError(
                f"the ends are {span:g} m apart, more than the line of {total:g} m stretches: give a longer "
                "line or nearer ends"
            )
        along = arcs / total
        straight = bottom + along[:, None] * chord
        if span >= total:
            return straight
        side = down - chord * float(down @ chord) / max(span**2, 1e-300)
        if np.linalg.norm(side) < 1e-3:
            side = np.array([1.0, 0.0, 0.0])
        side /= np.linalg.norm(side)
        bulge = 4.0 * along * (1.0 - along)
        low, high = 0.0, total
        for _ in range(60):
            sag = 0.5 * (low + high)
            pieces = np.diff(straight + sag * bulge[:, None] * side, axis=0)
            low, high = (sag, high) if np.linalg.norm(pieces, axis=1).sum() < total else (low, sag)
        return straight + sag * bulge[:, None] * side

    def step(
        self,
        state: LineState,
        top: Array | tuple[float, float, float] | None,
        dt: float,
        *,
        bottom: Array | tuple[float, float, float] | None = None,
        length: float | None = None,
    ) -> LineState:
        """Advances by `dt` [s].

        Args:
            state: The instant to go on from.
            top: Position of a driven upper end at the end of the step [m], (3,).
            dt: Time step [s].
            bottom: Position of a driven lower end at the end of the step [m], (3,).
            length: Unstretched length at the end of the step [m]; as it is if not given.
        """
        tops = None if top is None else np.array([state.positions[-1], _point("top", top)])
        bottoms = None if bottom is None else np.array([state.positions[0], _point("bottom", bottom)])
        lengths = None if length is None else np.array([state.length, length])
        record = self.simulate(tops, dt=dt, n_steps=1, bottom=bottoms, length=lengths, start=state)
        return record.end

    def top_tension(self, state: LineState) -> float:
        """Tension at the upper end, mean over the last step [N]."""
        return float(np.linalg.norm(state.top_force))

    def payload_motion(self, state: LineState) -> tuple[Array, Array]:
        """Position [m] and velocity [m/s] of the lower end, each (3,)."""
        return state.positions[0].copy(), state.velocities[0].copy()

    def energy(self, state: LineState) -> float:
        """Kinetic (with added mass), elastic and potential energy [J]; potential is zero at z = 0."""
        lengths = state.segment_lengths
        chain = self._chain(len(lengths), self.nominal_length)
        law, bodies = chain.law, chain.bodies
        across = np.diff(state.positions, axis=0)
        stretched = np.linalg.norm(across, axis=1)
        strain = stretched / lengths - 1.0
        strain = np.where(law[:, _TENSION_ONLY] > 0.0, np.maximum(strain, 0.0), strain)
        energy = float(np.sum(0.5 * law[:, _EA] * strain**2 * lengths))
        tangent = across / stretched[:, None]
        for end in (slice(None, -1), slice(1, None)):
            v = state.velocities[end]
            along = np.sum(v * tangent, axis=1)
            square = np.sum(v**2, axis=1)
            inertia = (law[:, _MASS] + law[:, _NORMAL_MASS]) * square
            inertia += (law[:, _AXIAL_MASS] - law[:, _NORMAL_MASS]) * along**2
            height = state.positions[end][:, 2]
            energy += float(np.sum(0.5 * lengths * (0.5 * inertia + law[:, _WEIGHT] * height)))
        flat = np.sum(state.velocities[:, :2] ** 2, axis=1)
        sway, rise = (
            bodies[:, _BODY_MASS] + bodies[:, _BODY_SWAY],
            bodies[:, _BODY_MASS] + bodies[:, _BODY_RISE],
        )
        energy += float(np.sum(0.5 * (sway * flat + rise * state.velocities[:, 2] ** 2)))
        return energy + float(np.sum(bodies[:, _BODY_WEIGHT] * state.positions[:, 2]))

    def simulate(
        self,
        top: Array | tuple[float, float, float] | None = None,
        *,
        dt: float,
        n_steps: int | None = None,
        bottom: Array | tuple[float, float, float] | None = None,
        length: Array | None = None,
        start: LineState | None = None,
        every: int = 1,
    ) -> LineRecord:
        """Marches through given motions of the ends.

        Args:
            top: Positions of the upper end at each instant [m], (n_steps + 1, 3); (3,) if it stands still.
            dt: Time step [s].
            n_steps: Steps [-]; needed if neither `top`, `bottom` nor `length` tells.
            bottom: Positions of the lower end, likewise.
            length: Unstretched length at each instant [m], (n_steps + 1,); constant if not given.
            start: The state to begin with; `rest` at the first positions if not given.
            every: Steps from one recorded instant to the next [-].

        Returns:
            The record, from the start on.

        Raises:
            ValueError: If arguments contradict each other or the solver.
            ConvergenceError: If Newton does not settle even at a 256th of the step.
        """
        if not (math.isfinite(dt) and dt > 0.0):
            raise ValueError(f"dt must be a positive number of seconds, got {dt!r}")
        if every < 1:
            raise ValueError(f"every must be at least 1, got {every!r}")
        given = {"top": top, "bottom": bottom, "length": length}
        tracks = {
            name: np.asarray(values, dtype=float) for name, values in given.items() if values is not None
        }
        for name, track in tracks.items():
            if not np.all(np.isfinite(track)):
                raise ValueError(f"{name} must hold finite numbers; it holds a NaN or an infinity")
            if name != "length" and (track.shape[-1:] != (3,) or track.ndim not in (1, 2)):
                raise ValueError(f"{name} must have the shape (n_steps + 1, 3) or (3,), got {track.shape}")
        counts = {len(track) - 1 for name, track in tracks.items() if name == "length" or track.ndim == 2}
        if n_steps is not None:
            counts.add(n_steps)
        if len(counts) != 1 or min(counts) < 1:
            raise ValueError(f"top, bottom, length and n_steps must agree on a number of steps, got {counts}")
        n_steps = counts.pop()
        if start is None:
            state = self.rest(
                tracks["top"].reshape(-1, 3)[0] if "top" in tracks else (0.0, 0.0, 0.0),
                tracks["bottom"].reshape(-1, 3)[0] if "bottom" in tracks else None,
            )
        else:
            state = start
        tops = self._track("top", self.upper, tracks.get("top"), state.positions[-1], n_steps)
        bottoms = self._track("bottom", self.lower, tracks.get("bottom"), state.positions[0], n_steps)
        lengths = self._lengths(tracks.get("length"), state.length, n_steps)
        return self._run(state, tops, bottoms, lengths, dt, every)

    def _track(self, name: str, end: str, track: Array | None, where: Array, n_steps: int) -> Array:
        """Positions of an end at every instant, (n_steps + 1, 3)."""
        if track is None or end == "free":
            return np.broadcast_to(where, (n_steps + 1, 3)).copy()
        positions = np.broadcast_to(track, (n_steps + 1, 3)).copy()
        still = end == "fixed" and not np.allclose(positions, positions[0])
        if still:
            raise ValueError(f"{name} moves, but that end is fixed: make it driven")
        away = float(np.linalg.norm(positions[0] - where))
        if away > 1e-6 * self.line.length:
            raise ValueError(f"{name} begins {away:g} m from where the start state has that end: begin there")
        return positions

    def _lengths(self, length: Array | None, now: float, n_steps: int) -> Array:
        if length is None:
            return np.full(n_steps + 1, now)
        if self.upper == "free":
            raise ValueError("length changes at the sheave: the upper end must be driven or fixed for it")
        if abs(float(length[0]) - now) > 1e-6 * now:
            raise ValueError(
                f"length must begin with the start state's {now:g} m, got {float(length[0]):g} m"
            )
        if float(np.min(length)) < self._least_length:
            raise ValueError(
                f"length must not fall below {self._least_length:g} m, where lower sections, bodies or the "
                f"last two segments would be taken in, got {float(np.min(length)):g} m"
            )
        return length

    def _run(
        self, state: LineState, tops: Array, bottoms: Array, lengths: Array, dt: float, every: int
    ) -> LineRecord:
        n, n_steps = len(state.segment_lengths), len(lengths) - 1
        spare = max(0.0, float(np.max(lengths)) - state.length)
        room = n + math.ceil(spare / self.nominal_length) + (2 if np.ptp(lengths) > 0.0 else 0)
        nodes = (state.positions, state.velocities, state.accelerations)
        r, v, a = (_padded(values, room + 1) for values in nodes)
        motion = _Motion(r, v, a, _padded(state.segment_lengths, room))
        chain = self._chain(room, self.nominal_length)
        ends = _Ends(bottoms, tops, lengths)
        n_kept = n_steps // every
        record, last = _empty_record(n_kept, room), _empty_record(1, room)

        def march(n: int, begin: int, stop: int, flow: _Flow, every: int, out: _Record) -> int:
            part = _Ends(*(values[begin : stop + 1] for values in ends))
            start = state.time + begin * dt
            n, failed, residual = _march(n, *self._held(), motion, chain, part, flow, start, dt, every, out)
            if failed < 0:
                return n
            raise ConvergenceError(
                f"the step to {start + failed * dt:g} s did not settle even at a 256th of {dt:g} s; a jump "
                "of an end's motion or a slack cable without Kelvin damping is the likely cause: smooth the "
                "motion, or set axial_damping to some milliseconds of axial_stiffness; force left over in N",
                residual,
            )

        if self.water is None:
            whole = n_kept * every
            if whole > 0:
                n = march(n, 0, whole, self._flow(), every, record)
                last = _Record(*(values[-1:] for values in record))
            if whole < n_steps:
                last = _empty_record(1, room)
                n = march(n, whole, n_steps, self._flow(), n_steps - whole, last)
        else:
            for k in range(n_steps):
                ahead = (r + 0.5 * dt * v)[: n + 1]
                given = np.asarray(self.water(ahead, state.time + (k + 0.5) * dt), dtype=float)
                if given.shape != (n + 1, 3) or not np.all(np.isfinite(given)):
                    raise ValueError(f"water must return finite velocities ({n + 1}, 3), got {given.shape}")
                n = march(n, k, k + 1, self._flow(given=_padded(given, room + 1)), 1, last)
                if (k + 1) % every == 0:
                    for kept, one in zip(record, last, strict=True):
                        kept[(k + 1) // every - 1] = one[0]
        end = LineState(
            time=state.time + n_steps * dt,
            positions=r[: n + 1].copy(),
            velocities=v[: n + 1].copy(),
            accelerations=a[: n + 1].copy(),
            segment_lengths=motion.length[:n].copy(),
            tensions=last.tensions[0, :n].copy(),
            bottom_force=last.ends[0, 0:3].copy(),
            top_force=last.ends[0, 3:6].copy(),
        )
        forces = [float(np.linalg.norm(force)) for force in (state.top_force, state.bottom_force)]
        extremes = float(np.min(state.tensions)), max(float(np.max(state.tensions)), *forces)
        return LineRecord(
            time=state.time + dt * every * np.arange(n_kept + 1),
            positions=np.concatenate([_padded(state.positions, room + 1)[None], record.positions]),
            velocities=np.concatenate([_padded(state.velocities, room + 1)[None], record.velocities]),
            segment_tensions=np.concatenate([_padded(state.tensions, room)[None], record.tensions]),
            bottom_force=np.vstack([state.bottom_force, record.ends[:, 0:3]]),
            top_force=np.vstack([state.top_force, record.ends[:, 3:6]]),
            least_tension=np.concatenate([[extremes[0]], record.ends[:, 6]]),
            greatest_tension=np.concatenate([[extremes[1]], record.ends[:, 7]]),
            n_segments=np.concatenate([[len(state.tensions)], record.counts]),
            length=lengths[: n_kept * every + 1 : every].copy(),
            end=end,
        )


def _padded(values: Array, rows: int) -> Array:
    """A copy with that many rows, the last repeated."""
    extra = np.repeat(values[-1:], rows - len(values), axis=0)
    return np.concatenate([values, extra]).astype(float)


def _empty_record(n_times: int, room: int) -> _Record:
    nodes = (n_times, room + 1, 3)
    return _Record(
        positions=np.zeros(nodes),
        velocities=np.zeros(nodes),
        tensions=np.zeros((n_times, room)),
        ends=np.zeros((n_times, 8)),
        counts=np.zeros(n_times, dtype=np.int64),
    )


def _point(name: str, where: Array | tuple[float, float, float] | None) -> Array:
    """A position as an array, (3,)."""
    point = np.array((np.nan,) * 3 if where is None else where, dtype=float)
    if point.shape != (3,) or not np.all(np.isfinite(point)):
        raise ValueError(f"{name} must be a position of three finite numbers in m, got {where!r}")
    return point
