"""The compiled chain of point masses behind `lumped_mass.LumpedMassSolver`: one march, one relaxation.

Everything is written per node and segment, in 3 x 3 blocks, for a line whose number of nodes may change
while it marches: arrays have room for the most there will be, and `n` says how many segments there are.
Equations and scheme are told in `lumped_mass`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from heave_env.cable.constitutive import branch_after, mean_tension, relaxed_tension, rope_tension
from heave_env.compiled import source_fingerprint, stage
from heave_env.hydrodynamics import between_knots, line_drag, line_drag_slopes, quadratic_drag

Array = np.ndarray

BODY_DRAGS = ("components", "axes", "vector")
"""How a body's drag takes the relative velocity; what each means is said in `LumpedMassSolver`."""
SPLIT_ABOVE, MERGE_BELOW = 1.5, 0.4
"""Lengths of the uppermost segment, over the nominal, at which it is split and merged [-]."""
MOST_PIECES = 256
"""Into how many parts a step is cut before it is given up [-]."""

# Columns of the segments' numbers, all per unstretched length but for the stiffness and damping.
MASS, WEIGHT, STIFFNESS, DAMPING, NORMAL_MASS, AXIAL_MASS, NORMAL_DRAG, AXIAL_DRAG, TENSION_ONLY = range(9)
# Of ropes beyond Hooke's law: coefficients of the stored energy, and the Maxwell branch.
QUADRATIC, CUBIC, RELAXING_STIFFNESS, RELAXATION_RATE = range(9, 13)
# Columns of the nodes' bodies.
BODY_MASS, BODY_RISE, BODY_SWAY, BODY_WEIGHT, BODY_RISE_DRAG, BODY_SWAY_DRAG = range(6)


class Motion(NamedTuple):
    """What moves: nodes, at the sheave unstretched lengths, and what the segments' Maxwell branches hold.

    There is room for more than there are.
    """

    r: Array
    v: Array
    acceleration: Array
    length: Array
    branch_strain: Array


class Chain(NamedTuple):
    """What the line is made of."""

    law: Array
    bodies: Array
    nominal: float
    tolerance: float
    body_drag: int
    hookean: bool


class Flow(NamedTuple):
    """The current's table, and velocities that stand in its place if there are any."""

    depth: Array
    along_x: Array
    along_y: Array
    knots: Array
    factors: Array
    given: Array


class Ends(NamedTuple):
    """What is imposed at each instant."""

    bottoms: Array
    tops: Array
    lengths: Array


class Record(NamedTuple):
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
    branch_middle: Array
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
def _pull(j, old, new, chain, branch_strain, work, dt, static):
    """Mean tension of segment j from strain `old` to `new`, and its derivative by `new` [N, N].

    At rest (`static`) the two are one and the Maxwell branch has relaxed. Else the branch's strain at
    mid-step is noted.
    """
    law = chain.law[j]
    EA, CA, slack = law[STIFFNESS], law[DAMPING], law[TENSION_ONLY] > 0.0
    per_dt = 0.0 if static else 1.0 / dt
    if chain.hookean:
        return mean_tension(old, new, EA, CA, per_dt, slack)
    share = 1.0 / (1.0 + 0.5 * dt * law[RELAXATION_RATE])
    held, EA1 = (0.0, 0.0) if static else (branch_strain[j], law[RELAXING_STIFFNESS])
    tension, slope, work.branch_middle[j] = rope_tension(
        old, new, held, EA, law[QUADRATIC], law[CUBIC], EA1, share, CA, per_dt, slack
    )
    return tension, slope


@stage
def _assemble(n, r, v, l_old, branch_strain, chain, work, dt, static):
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
        T, slope = _pull(j, old, new, chain, branch_strain, work, dt, static)
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
        normal, axial = law[j, NORMAL_DRAG], law[j, AXIAL_DRAG]
        for side in range(2):
            i = j + side
            _add_force(G, i, 0.0, 0.0, -half * law[j, WEIGHT])
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
                across = half * (law[j, MASS] + law[j, NORMAL_MASS])
                extra = half * (law[j, AXIAL_MASS] - law[j, NORMAL_MASS])
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
        mass = bodies[i, BODY_MASS]
        if mass > 0.0:
            V = (per_dt * u[i, 0], per_dt * u[i, 1], per_dt * u[i, 2])
            fx, fy, fz, xx, xy, yy, zz, xz, yz = _body_force(
                water[i, 0] - V[0],
                water[i, 1] - V[1],
                water[i, 2] - V[2],
                bodies[i, BODY_SWAY_DRAG],
                bodies[i, BODY_RISE_DRAG],
                body_drag,
            )
            _add_force(G, i, fx, fy, fz - bodies[i, BODY_WEIGHT])
            _add_symmetric(diagonal, i, per_dt, xx, xy, xz, yy, yz, zz)
            if not static:
                beta = 2.0 * per_dt
                sway, rise = mass + bodies[i, BODY_SWAY], mass + bodies[i, BODY_RISE]
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
    r, _, acceleration, l_old, _ = motion
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
        law[j, NORMAL_DRAG],
        law[j, AXIAL_DRAG],
    )
    ax, ay, az = acceleration[source, 0], acceleration[source, 1], acceleration[source, 2]
    if both_held_neighbour or static:
        ax, ay, az = 0.0, 0.0, 0.0
    along = (law[j, AXIAL_MASS] - law[j, NORMAL_MASS]) * (ax * tx + ay * ty + az * tz)
    inertia = law[j, MASS] + law[j, NORMAL_MASS]
    sign = 1.0 if upper else -1.0
    out[0] = tension[j] * d[0] + sign * half * (inertia * ax + along * tx - fx)
    out[1] = tension[j] * d[1] + sign * half * (inertia * ay + along * ty - fy)
    out[2] = tension[j] * d[2] + sign * half * (inertia * az + along * tz - fz + law[j, WEIGHT])


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
    r, v, acceleration, length, branch_strain = motion
    law, nominal = chain.law, chain.nominal
    top, low = n, n - 1
    whole = length[n - 1]
    lower, upper = nominal, whole - nominal
    share = lower / whole
    for k in range(law.shape[1]):
        law[n, k] = law[n - 1, k]
    # Material is material: both parts hold what the whole did.
    branch_strain[n] = branch_strain[n - 1]
    dx, dy, dz = r[top, 0] - r[low, 0], r[top, 1] - r[low, 1], r[top, 2] - r[low, 2]
    stretched = max(math.sqrt(dx * dx + dy * dy + dz * dz), 1e-300)
    t = (dx / stretched, dy / stretched, dz / stretched)
    EA = law[n - 1, STIFFNESS]
    T = EA * (stretched / whole - 1.0)
    if not chain.hookean:
        T, EA = relaxed_tension(stretched / whole - 1.0, EA, law[n, QUADRATIC], law[n, CUBIC])
        T += law[n, RELAXING_STIFFNESS] * branch_strain[n]
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
        law[n, NORMAL_DRAG],
        law[n, AXIAL_DRAG],
    )
    inertia = law[n, MASS]
    q = (
        mass * (fx - inertia * acceleration[low, 0]),
        mass * (fy - inertia * acceleration[low, 1]),
        mass * (fz - inertia * acceleration[low, 2] - law[n, WEIGHT]),
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
    r, v, acceleration, length, branch_strain = motion
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
    mean = (lower * branch_strain[n - 2] + upper * branch_strain[n - 1]) / (lower + upper)
    length[n - 2], branch_strain[n - 2] = lower + upper, mean


# At the top of the module, for numba's cache of a function that has another one in its closure never hits.
@njit(error_model="numpy")
def _advance(n, first, last, motion, chain, work, dt, limit):
    """One step: Newton on the increments `work.u`. Returns the residual left [N], zero if it settled."""
    r, v, acceleration, length, branch_strain = motion
    u, G, change = work.u, work.G, work.change
    for i in range(first, last + 1):
        for k in range(3):
            u[i, k] = dt * (v[i, k] + 0.5 * dt * acceleration[i, k])
    settled = False
    residual = np.inf
    for _ in range(limit):
        _assemble(n, r, v, length, branch_strain, chain, work, dt, False)
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
        work.tension[j], _ = _pull(j, strains[0], strains[1], chain, branch_strain, work, dt, False)
        if not chain.hookean:
            law = chain.law[j]
            branch_strain[j] = branch_after(
                strains[0],
                strains[1],
                branch_strain[j],
                work.branch_middle[j],
                law[STIFFNESS],
                law[QUADRATIC],
                law[CUBIC],
                law[RELAXING_STIFFNESS],
                1.0 / (1.0 + 0.5 * dt * law[RELAXATION_RATE]),
                law[TENSION_ONLY] > 0.0,
            )
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
        r, v, acceleration, length, branch_strain = motion
        room = len(length)
        work = _workspace(room)
        u, water, tension, l_new = work.u, work.water, work.tension, work.l_new
        r_kept, v_kept, a_kept = np.empty_like(r), np.empty_like(v), np.empty_like(acceleration)
        branch_kept = np.empty_like(branch_strain)
        bottom_force, top_force = np.zeros(3), np.zeros(3)
        least, most = np.inf, -np.inf
        first = 1 if lower_held else 0
        for step in range(1, len(ends.lengths)):
            l_start = length[n - 1]
            gained = ends.lengths[step] - ends.lengths[step - 1]
            fed = gained / dt
            last = n - 1 if upper_held else n
            r_kept[:], v_kept[:], a_kept[:] = r, v, acceleration
            branch_kept[:] = branch_strain
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
                branch_strain[:] = branch_kept
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
        r, still, _, length, relaxed = motion
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
                _assemble(n, r, still, length, relaxed, chain, work, 1.0, True)
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
        _assemble(n, r, still, length, relaxed, chain, work, 1.0, True)
        residual = _largest(G, first, last)
        tension[:] = work.tension
        _end_force(False, n, motion, chain, work, 1.0, True, lower_held, bottom_force, 0.0)
        _end_force(True, n, motion, chain, work, 1.0, True, upper_held, top_force, 0.0)
        return residual

    return march, settle


march, settle = _make_march(source_fingerprint())
