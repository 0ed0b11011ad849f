"""Planar cable of varying length with a payload: heave and sway of the boom tip, in a current.

Axes: x along the current, z up from the mean surface. s is the unstretched arc length from the payload
(s = 0) to the sheave (s = L(t)), η = s/L, r(η, t) the position, W the absolute velocity of the material,
λ = |∂r/∂s| the stretch, t the unit tangent, U the water's velocity:

    cable    M DW/Dt = ∂/∂s (T t) - w1 ẑ + (1/2) ρ d C_N |u_N| u_N + (π/2) ρ d C_t |u_t| u_t,   u = U - W
             M = (m + m_a) t tᵀ + (m + m_n) (I - t tᵀ)
    payload  (M_s + M_a) DW/Dt = T t - w2 ẑ + drag, with its own added mass and drag area in x and in z
    sheave   r = R(t)
    tension  T = EA e + C_A De/Dt,  e = λ - 1  (and T = 0 where that is not positive, if tension-only); a rope
             that hardens and relaxes: see `constitutive`, each element with a Maxwell branch of its own

On the fixed grid W = ∂r/∂t - η (L'/L) ∂r/∂η and D/Dt = ∂/∂t - η (L'/L) ∂/∂η, which is ∂/∂t at the payload.
Position and velocity are both carried, so L' may jump and L'' never appears: a step knows the sheave's
position and the length at its two ends.

Source: Huang (1992), chapter 4, in the material form. His (4.13)-(4.18) lack the convective terms of
cable that enters at a moving end; the sign of the relative velocity in (4.1) is reversed; (4.12) prints p
for q; added mass here acts along and across the cable, there along the axes; drag acts on the unstretched
length, there on sqrt(1 + e) of it.

The model stops holding where the motion leaves the plane (only the x component of the current is felt),
where bending stiffness matters (a slack cable's kinks), where the water itself accelerates (a current that
changes within seconds), and where the payload meets the sheave. It knows neither surface nor bottom.
Convection of what the Maxwell branches of a rope hold is left out, as in the axial solver.

Scheme: the implicit midpoint rule, with a finite-volume grid in η (half a cell of cable goes with the
payload). An element pulls with its mean tension (a discrete gradient) along (d_old + d_new) / (|d_old| +
|d_new|), d the vector between its ends, so that its work is the change of its energy, exactly. Second order
in time and space, unconditionally stable, no algorithmic damping; in vertical motion it is the axial
solver's scheme to the last term. Each Newton iteration is one block-tridiagonal elimination with 2 x 2
blocks. A step that does not settle is taken in halves. A rope's tangent is that of its discrete gradient, the
branch's included.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numba import njit

from heave_env.cable.axial import hanging_elongation
from heave_env.cable.constitutive import (
    branch_after,
    mean_tension,
    relaxed_tension,
    rope_energy_coefficients,
    rope_tension,
    static_strain,
)
from heave_env.cable.convergence import ConvergenceError
from heave_env.compiled import source_fingerprint, stage
from heave_env.hydrodynamics import (
    between_knots,
    current_factor,
    current_knots,
    line_drag,
    line_drag_slopes,
    quadratic_drag,
)
from heave_env.parameters import (
    Cable,
    Current,
    Payload,
    require,
    require_integer,
    require_number,
)

Array = np.ndarray

PAYLOAD_DRAG = ("components", "vector")

_MAX_ITERATIONS = 30
_SETTLED = 1e-10  # largest last correction, in lengths of an element
_SMALLEST_PART = 1.0 / 1024.0  # of a step that is taken in parts
_COLUMNS = 9  # of a record's table


class _Numbers(NamedTuple):
    """A system as the compiled code takes it."""

    EA: float
    CA: float
    tension_only: bool
    hookean: bool
    quadratic: float
    cubic: float
    relaxing_stiffness: float
    relaxation_rate: float
    inertia_along: float
    inertia_across: float
    weight: float
    normal_drag: float
    tangential_drag: float
    payload_inertia_x: float
    payload_inertia_z: float
    payload_drag_x: float
    payload_drag_z: float
    payload_weight: float
    drag_by_vector: bool
    current_depth: Array
    current_x: Array
    current_time: Array
    current_factor: Array


class _Step(NamedTuple):
    """One step, or a static solve, as the compiled code takes it."""

    position: Array
    velocity: Array
    branch_strain: Array
    old_length: float
    new_length: float
    dt: float
    still: bool  # a static solve: no rates, the increment is the whole displacement
    current: float  # factor over time


class _Equations(NamedTuple):
    """Forces of the elements and linearised balances of the nodes: room to work in."""

    force: Array
    slope: Array
    strain: Array  # before and after the step
    branch_middle: Array
    lower: Array
    diagonal: Array
    upper: Array
    load: Array


@stage
def _water(z, numbers):
    """Speed of the current along x at height z before its factor over time, and its derivative by z."""
    knots, values = numbers.current_depth, numbers.current_x
    speed = between_knots(-z, knots, values)
    if len(knots) == 1:
        return speed, 0.0
    step = 1e-3
    above, below = between_knots(-z - step, knots, values), between_knots(-z + step, knots, values)
    return speed, (above - below) / (2.0 * step)


@stage
def _payload_drag(ux, uz, numbers):
    """Drag of the payload, x and z, and its derivatives xx, xz, zx, zz by the relative velocity."""
    cx, cz = numbers.payload_drag_x, numbers.payload_drag_z
    if numbers.drag_by_vector:
        speed = math.sqrt(ux * ux + uz * uz)
        per_speed = 1.0 / speed if speed > 0.0 else 0.0
        return (
            cx * speed * ux,
            cz * speed * uz,
            cx * (speed + ux * ux * per_speed),
            cx * ux * uz * per_speed,
            cz * ux * uz * per_speed,
            cz * (speed + uz * uz * per_speed),
        )
    fx, sxx = quadratic_drag(cx, ux)
    fz, szz = quadratic_drag(cz, uz)
    return fx, fz, sxx, 0.0, 0.0, szz


@stage
def _pull_elements(numbers, step, increment, equations, tension):
    """Forces of the elements over a step, (n, 2), and their derivatives by the increments' difference."""
    position, force, slope = step.position, equations.force, equations.slope
    old_length, new_length = step.old_length, step.new_length
    n = len(force)
    spacing = 0.5 * (old_length + new_length) / n
    share = 1.0 / (1.0 + 0.5 * step.dt * numbers.relaxation_rate)
    for j in range(n):
        ox, oz = position[j + 1, 0] - position[j, 0], position[j + 1, 1] - position[j, 1]
        gx, gz = increment[j + 1, 0] - increment[j, 0], increment[j + 1, 1] - increment[j, 1]
        if step.still:
            nx, nz = ox + gx, oz + gz
            size = math.sqrt(nx * nx + nz * nz)
            ux, uz = nx / size, nz / size
            T, by_strain = numbers.EA * (size / spacing - 1.0), numbers.EA
            if not numbers.hookean:
                strain = size / spacing - 1.0
                T, by_strain = relaxed_tension(strain, numbers.EA, numbers.quadratic, numbers.cubic)
            ex, ez, along, across = ux, uz, by_strain / spacing, T / size
        else:
            nx, nz = ox + 2.0 * gx, oz + 2.0 * gz
            old_size = math.sqrt(ox * ox + oz * oz)
            size = max(math.sqrt(nx * nx + nz * nz), 1e-12 * spacing)
            ux, uz = nx / size, nz / size
            both = old_size + size
            old = old_size * n / old_length - 1.0
            new = both / spacing - 2.0 - old
            if numbers.hookean:
                T, by_new = mean_tension(
                    old, new, numbers.EA, numbers.CA, 1.0 / step.dt, numbers.tension_only
                )
            else:
                equations.strain[j, 0], equations.strain[j, 1] = old, new
                T, by_new, equations.branch_middle[j] = rope_tension(
                    old,
                    new,
                    step.branch_strain[j],
                    numbers.EA,
                    numbers.quadratic,
                    numbers.cubic,
                    numbers.relaxing_stiffness,
                    share,
                    numbers.CA,
                    1.0 / step.dt,
                    numbers.tension_only,
                )
            ex, ez = (ox + nx) / both, (oz + nz) / both
            along, across = 2.0 * by_new / spacing, 2.0 * T / both
        tension[j] = T
        force[j, 0], force[j, 1] = T * ex, T * ez
        slope[j, 0, 0] = across + (along - across) * ex * ux
        slope[j, 0, 1] = (along - across) * ex * uz
        slope[j, 1, 0] = (along - across) * ez * ux
        slope[j, 1, 1] = across + (along - across) * ez * uz


@stage
def _assemble(numbers, step, increment, equations):
    """Momentum balance of every node below the sheave, linearised about the trial increments.

    The unknowns D (n + 1, 2) are the displacements gained to mid-step; `load` is what is
    missing to balance [N].
    """
    position, velocity, current = step.position, step.velocity, step.current
    force, slope, _, _, lower, diagonal, upper, load = equations
    n = len(force)
    still, dt, old_length, new_length = step.still, step.dt, step.old_length, step.new_length
    middle = 0.5 * (old_length + new_length)
    beta = 0.0 if still else 2.0 / dt
    kappa = 0.0 if still else (new_length - old_length) / dt / middle
    along, across = numbers.inertia_along, numbers.inertia_across
    first, second = 0.5 * n, float(n) * n
    for i in range(n):
        low = i - 1 if i > 0 else 0
        cell = (1.0 if i > 0 else 0.5) * middle / n
        gk = i / n * kappa
        Dx, Dz = increment[i, 0], increment[i, 1]
        x, z = position[i, 0] + Dx, position[i, 1] + Dz
        x_low, z_low = position[low, 0] + increment[low, 0], position[low, 1] + increment[low, 1]
        x_up, z_up = position[i + 1, 0] + increment[i + 1, 0], position[i + 1, 1] + increment[i + 1, 1]
        # Tangent of the chord between the neighbours, and how its angle θ turns with them.
        cx, cz = x_up - x_low, z_up - z_low
        squared = max(cx * cx + cz * cz, 1e-30)
        size = math.sqrt(squared)
        tx, tz = cx / size, cz / size
        turn_x, turn_z = -cz / squared, cx / squared
        # Velocity and acceleration of the material at mid-step; the curvature is the compact one.
        Wx, Wz = beta * Dx - gk * first * cx, beta * Dz - gk * first * cz
        Wx_grad = first * (beta * (increment[i + 1, 0] - increment[low, 0]) - kappa * cx)
        Wz_grad = first * (beta * (increment[i + 1, 1] - increment[low, 1]) - kappa * cz)
        Wx_grad -= gk * second * (x_up - 2.0 * x + x_low)
        Wz_grad -= gk * second * (z_up - 2.0 * z + z_low)
        Ax = beta * (Wx - velocity[i, 0]) - gk * Wx_grad
        Az = beta * (Wz - velocity[i, 1]) - gk * Wz_grad
        a_middle = beta * beta - 2.0 * gk * gk * second
        a_low = gk * first * (2.0 * beta - kappa) + gk * gk * second
        a_up = -gk * first * (2.0 * beta - kappa) + gk * gk * second
        # Inertia M A; by θ it changes as the normal n = (-tz, tx) turns.
        A_along, A_across = Ax * tx + Az * tz, Az * tx - Ax * tz
        Mxx, Mzz = across + (along - across) * tx * tx, across + (along - across) * tz * tz
        Mxz = (along - across) * tx * tz
        # Drag; it turns with velocity and tangent together, hence its derivative by θ alone.
        water, shear = _water(z, numbers)
        ux, uz = current * water - Wx, -Wz
        normal, tangential = numbers.normal_drag, numbers.tangential_drag
        fx, _, fz = line_drag(ux, 0.0, uz, tx, 0.0, tz, normal, tangential)
        Sxx, _, Sxz, _, _, Szz = line_drag_slopes(ux, 0.0, uz, tx, 0.0, tz, normal, tangential)
        Rx = cell * ((along - across) * (A_across * tx - A_along * tz) + fz - Sxx * uz + Sxz * ux)
        Rz = cell * ((along - across) * (A_across * tz + A_along * tx) - fx - Sxz * uz + Szz * ux)

        load[i, 0] = force[i, 0] - cell * (Mxx * Ax + Mxz * Az - fx)
        load[i, 1] = force[i, 1] - cell * (Mxz * Ax + Mzz * Az - fz + numbers.weight)
        upper[i, 0, 0] = cell * (a_up * Mxx - gk * first * Sxx) + Rx * turn_x - slope[i, 0, 0]
        upper[i, 0, 1] = cell * (a_up * Mxz - gk * first * Sxz) + Rx * turn_z - slope[i, 0, 1]
        upper[i, 1, 0] = cell * (a_up * Mxz - gk * first * Sxz) + Rz * turn_x - slope[i, 1, 0]
        upper[i, 1, 1] = cell * (a_up * Mzz - gk * first * Szz) + Rz * turn_z - slope[i, 1, 1]
        shear *= current
        diagonal[i, 0, 0] = cell * (a_middle * Mxx + beta * Sxx) + slope[i, 0, 0]
        diagonal[i, 0, 1] = cell * (a_middle * Mxz + beta * Sxz - Sxx * shear) + slope[i, 0, 1]
        diagonal[i, 1, 0] = cell * (a_middle * Mxz + beta * Sxz) + slope[i, 1, 0]
        diagonal[i, 1, 1] = cell * (a_middle * Mzz + beta * Szz - Sxz * shear) + slope[i, 1, 1]
        if i > 0:
            load[i, 0] -= force[i - 1, 0]
            load[i, 1] -= force[i - 1, 1]
            lower[i, 0, 0] = cell * (a_low * Mxx + gk * first * Sxx) - Rx * turn_x - slope[i - 1, 0, 0]
            lower[i, 0, 1] = cell * (a_low * Mxz + gk * first * Sxz) - Rx * turn_z - slope[i - 1, 0, 1]
            lower[i, 1, 0] = cell * (a_low * Mxz + gk * first * Sxz) - Rz * turn_x - slope[i - 1, 1, 0]
            lower[i, 1, 1] = cell * (a_low * Mzz + gk * first * Szz) - Rz * turn_z - slope[i - 1, 1, 1]
            diagonal[i, 0, 0] += slope[i - 1, 0, 0]
            diagonal[i, 0, 1] += slope[i - 1, 0, 1]
            diagonal[i, 1, 0] += slope[i - 1, 1, 0]
            diagonal[i, 1, 1] += slope[i - 1, 1, 1]
        else:
            Px, Pz, Pxx, Pxz, Pzx, Pzz = _payload_drag(ux, uz, numbers)
            load[i, 0] += Px - numbers.payload_inertia_x * Ax
            load[i, 1] += Pz - numbers.payload_inertia_z * Az - numbers.payload_weight
            diagonal[i, 0, 0] += numbers.payload_inertia_x * a_middle + beta * Pxx - Rx * turn_x
            diagonal[i, 0, 1] += beta * Pxz - Pxx * shear - Rx * turn_z
            diagonal[i, 1, 0] += beta * Pzx - Rz * turn_x
            diagonal[i, 1, 1] += numbers.payload_inertia_z * a_middle + beta * Pzz - Pzx * shear - Rz * turn_z


@stage
def _eliminate(equations):
    """Solves the block-tridiagonal system in place (Thomas); the solution stands in `load`, (n, 2)."""
    lower, diagonal, upper, load = equations.lower, equations.diagonal, equations.upper, equations.load
    n = len(load)
    for i in range(n):
        a, b, c, d = diagonal[i, 0, 0], diagonal[i, 0, 1], diagonal[i, 1, 0], diagonal[i, 1, 1]
        p, q = load[i, 0], load[i, 1]
        if i > 0:
            k, l, m, o = lower[i, 0, 0], lower[i, 0, 1], lower[i, 1, 0], lower[i, 1, 1]
            above = upper[i - 1]
            a -= k * above[0, 0] + l * above[1, 0]
            b -= k * above[0, 1] + l * above[1, 1]
            c -= m * above[0, 0] + o * above[1, 0]
            d -= m * above[0, 1] + o * above[1, 1]
            p, q = p - k * load[i - 1, 0] - l * load[i - 1, 1], q - m * load[i - 1, 0] - o * load[i - 1, 1]
        per = 1.0 / (a * d - b * c)
        load[i, 0], load[i, 1] = per * (d * p - b * q), per * (a * q - c * p)
        for column in range(2):
            e, f = upper[i, 0, column], upper[i, 1, column]
            upper[i, 0, column], upper[i, 1, column] = per * (d * e - b * f), per * (a * f - c * e)
    for i in range(n - 2, -1, -1):
        p, q = load[i + 1, 0], load[i + 1, 1]
        load[i, 0] -= upper[i, 0, 0] * p + upper[i, 0, 1] * q
        load[i, 1] -= upper[i, 1, 0] * p + upper[i, 1, 1] * q


@njit(error_model="numpy")
def _newton(numbers, step, increment, tension):
    """Newton on the increments, which hold the first trial and the sheave's own; fills `tension`.

    Once settled in motion, the Maxwell branches of a rope are taken to the end of the step. Returns whether
    it settled, and the largest force that was missing before the last correction.
    """
    n, missing = len(tension), np.inf
    equations = _Equations(
        force=np.empty((n, 2)),
        slope=np.empty((n, 2, 2)),
        strain=np.empty((n, 2)),
        branch_middle=np.empty(n),
        lower=np.empty((n, 2, 2)),
        diagonal=np.empty((n, 2, 2)),
        upper=np.empty((n, 2, 2)),
        load=np.empty((n, 2)),
    )
    correction = equations.load
    for _ in range(_MAX_ITERATIONS):
        _pull_elements(numbers, step, increment, equations, tension)
        _assemble(numbers, step, increment, equations)
        missing = np.abs(correction).max()
        _eliminate(equations)
        largest = np.abs(correction).max()
        if not np.isfinite(largest):
            return False, missing
        # A static shape far away is approached in strides that leave the elements their direction.
        far = step.still and largest > 0.5 * step.new_length
        increment[:n] += (0.5 * step.new_length / largest if far else 1.0) * correction
        if largest <= _SETTLED * step.new_length / n:
            _pull_elements(numbers, step, increment, equations, tension)
            if not (numbers.hookean or step.still):
                for j in range(n):
                    step.branch_strain[j] = branch_after(
                        equations.strain[j, 0],
                        equations.strain[j, 1],
                        step.branch_strain[j],
                        equations.branch_middle[j],
                        numbers.EA,
                        numbers.quadratic,
                        numbers.cubic,
                        numbers.relaxing_stiffness,
                        1.0 / (1.0 + 0.5 * step.dt * numbers.relaxation_rate),
                        numbers.tension_only,
                    )
            return True, missing
    return False, missing


@njit(error_model="numpy")
def _advance(numbers, position, velocity, branch_strain, top, old_length, new_length, time, dt, tension):
    """One step in place, to the sheave at `top` (2,); nothing changes if it does not settle."""
    n = len(tension)
    beta = 2.0 / dt
    kappa = (new_length - old_length) / dt / (0.5 * (old_length + new_length))
    increment = np.empty((n + 1, 2))
    for axis in range(2):
        for i in range(n):
            low = i - 1 if i > 0 else 0
            gradient = 0.5 * n * (position[i + 1, axis] - position[low, axis])
            increment[i, axis] = (velocity[i, axis] + i / n * kappa * gradient) / beta
        increment[n, axis] = 0.5 * (top[axis] - position[n, axis])
    current = between_knots(time + 0.5 * dt, numbers.current_time, numbers.current_factor)
    step = _Step(position, velocity, branch_strain, old_length, new_length, dt, False, current)
    settled, missing = _newton(numbers, step, increment, tension)
    if not settled:
        return False, missing
    for axis in range(2):
        at_low = position[0, axis] + increment[0, axis]
        for i in range(n + 1):
            at = position[i, axis] + increment[i, axis]
            mean = beta * increment[i, axis]
            if i < n:
                at_up = position[i + 1, axis] + increment[i + 1, axis]
                mean -= i / n * kappa * 0.5 * n * (at_up - at_low)
                velocity[i, axis] = 2.0 * mean - velocity[i, axis]
            else:
                velocity[i, axis] = mean - kappa * n * (at - at_low)
            at_low = at
    for axis in range(2):
        for i in range(n):
            position[i, axis] += 2.0 * increment[i, axis]
        position[n, axis] = top[axis]
    return True, missing


@njit(error_model="numpy")
def _note_row(position, velocity, tension, tension_only, row):
    """Fills one row of a record's table."""
    n = len(tension)
    second, last_but_one = min(1, n - 1), max(0, n - 2)
    end = 1.5 * tension[0] - 0.5 * tension[second]
    top = 1.5 * tension[n - 1] - 0.5 * tension[last_but_one]
    if tension_only:
        end, top = max(end, 0.0), max(top, 0.0)
    angles = np.empty(2)
    for k in range(2):
        j = n - 1 if k == 0 else last_but_one
        dx, dz = position[j + 1, 0] - position[j, 0], position[j + 1, 1] - position[j, 1]
        angles[k] = math.atan2(-dx, dz)
    row[0], row[1] = position[0, 0], position[0, 1]
    row[2], row[3] = velocity[0, 0], velocity[0, 1]
    row[4], row[5] = top, 1.5 * angles[0] - 0.5 * angles[1]
    row[6] = end
    row[7], row[8] = min(tension.min(), min(end, top)), max(tension.max(), max(end, top))


def _make_compiled(fingerprint: int):
    """The entries from Python, which numba keeps: a kept function must not hold another in its closure."""

    @njit(cache=True, error_model="numpy")
    def settle(numbers, step, increment, tension):
        """Newton on the increments, from Python."""
        if fingerprint == 0:
            return False, np.inf
        return _newton(numbers, step, increment, tension)

    @njit(cache=True, error_model="numpy")
    def note(position, velocity, tension, tension_only, row):
        """Fills one row of a record's table, from Python."""
        if fingerprint != 0:
            _note_row(position, velocity, tension, tension_only, row)

    @njit(cache=True, error_model="numpy")
    def march(
        numbers, position, velocity, branch_strain, tension, sheave, length, time, dt, out, every, shapes
    ):
        """Drives the cable through sheave positions (n_steps + 1, 2) and lengths; works in place.

        Returns the step that did not settle even in its smallest parts, or -1, and what was missing.
        """
        if fingerprint == 0:
            return 0, np.inf
        part_tension, mean, top = np.empty_like(tension), np.empty_like(tension), np.empty(2)
        _note_row(position, velocity, tension, numbers.tension_only, out[0])
        if every > 0:
            shapes[0] = position
        for k in range(1, len(sheave)):
            done, part = 0.0, 1.0
            mean[:] = 0.0
            while done < 1.0:
                goal = min(1.0, done + part)
                for axis in range(2):
                    top[axis] = sheave[k - 1, axis] + goal * (sheave[k, axis] - sheave[k - 1, axis])
                start_length = length[k - 1] + done * (length[k] - length[k - 1])
                goal_length = length[k - 1] + goal * (length[k] - length[k - 1])
                size = (goal - done) * dt
                instant = time + (k - 1 + done) * dt
                settled, missing = _advance(
                    numbers,
                    position,
                    velocity,
                    branch_strain,
                    top,
                    start_length,
                    goal_length,
                    instant,
                    size,
                    part_tension,
                )
                if settled:
                    mean += (goal - done) * part_tension
                    done, part = goal, min(1.0, 2.0 * part)
                else:
                    part *= 0.5
                    if part < _SMALLEST_PART:
                        return k, missing
            position[len(tension)] = sheave[k]
            tension[:] = mean
            _note_row(position, velocity, tension, numbers.tension_only, out[k])
            if every > 0 and k % every == 0:
                shapes[k // every] = position
        return -1, 0.0

    return settle, note, march


_settle, _note, _march = _make_compiled(source_fingerprint())


@dataclass(frozen=True, eq=False)
class PlanarState:
    """Cable and payload at an instant: a value that copies and compares."""

    position: Array = field(repr=False)
    """Nodes from the payload up to the sheave, x and z [m], (n_elements + 1, 2)."""
    velocity: Array = field(repr=False)
    """Absolute velocity of the material there [m/s], (n_elements + 1, 2); at the sheave its mean over the
    last step."""
    tension: Array = field(repr=False)
    """Tension of each element, mean over the last step [N], (n_elements,)."""
    length: float
    """Unstretched length outboard [m]."""
    time: float = 0.0
    """The instant, by which the current's factor is chosen [s]."""
    branch_strain: Array = field(default_factory=lambda: np.empty(0), repr=False)
    """Strain that the Maxwell branch of each element holds [-], (n_elements,); empty: none holds any."""

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, PlanarState):
            return NotImplemented
        arrays = ("position", "velocity", "tension", "branch_strain")
        same = all(np.array_equal(getattr(self, name), getattr(other, name)) for name in arrays)
        return same and self.length == other.length and self.time == other.time

    __hash__ = None  # type: ignore[assignment]

    def copy(self) -> PlanarState:
        """The same instant with arrays of its own."""
        return replace(
            self,
            position=self.position.copy(),
            velocity=self.velocity.copy(),
            tension=self.tension.copy(),
            branch_strain=self.branch_strain.copy(),
        )


@dataclass(frozen=True)
class PlanarRecord:
    """What a march recorded; each array of shape (n_steps + 1,) unless said otherwise.

    Tensions are means over the step that ends at the instant, the very tensions that moved the nodes;
    those at the ends of the cable are extrapolated linearly from the two nearest elements.
    """

    time: Array
    """Instants [s]."""
    length: Array
    """Unstretched length outboard [m]."""
    payload_x: Array
    """Position of the payload along the current [m]."""
    payload_z: Array
    """Position of the payload, up from the mean surface [m]."""
    payload_velocity_x: Array
    """Absolute velocity of the payload [m/s]."""
    payload_velocity_z: Array
    """Absolute velocity of the payload, up [m/s]."""
    top_tension: Array
    """Tension at the sheave [N]."""
    top_angle: Array
    """Angle of the cable at the sheave from the vertical, positive if it leads towards +x below [rad]."""
    payload_tension: Array
    """Tension at the payload [N]."""
    least_tension: Array
    """Smallest tension along the cable [N]; negative where a cable that is not tension-only is pressed."""
    largest_tension: Array
    """Largest tension along the cable [N]."""
    shape_time: Array
    """Instants at which shapes were kept [s], (n_shapes,)."""
    shapes: Array
    """Nodes from the payload to the sheave, x and z, at those instants [m], (n_shapes, n_elements + 1, 2)."""
    final: PlanarState
    """The last instant, to go on from."""

    @property
    def slack(self) -> Array:
        """Whether the cable was slack anywhere."""
        return np.asarray(self.least_tension <= 0.0)

    @property
    def top_force(self) -> tuple[Array, Array]:
        """What the cable pulls the sheave with, x and z [N]."""
        return self.top_tension * np.sin(self.top_angle), -self.top_tension * np.cos(self.top_angle)


@dataclass(frozen=True, kw_only=True)
class PlanarSolver:
    """A cable of varying length with a payload, moving in the vertical plane of the current.

    Implicit midpoint in time, finite volumes in space, second order in both; Newton to rounding on each
    step, with a block-tridiagonal direct solve.
    """

    cable: Cable
    payload: Payload
    length: float
    """Unstretched length at the start [m]."""
    n_elements: int = 40
    current: Current = field(default_factory=Current)
    """Its x component is felt, by depth below the mean surface, times its factor over time."""
    payload_drag: str = "components"
    """`components`: drag in x and z each by its own component of the relative velocity, as in the source;
    `vector`: each component times the whole relative speed."""

    def __post_init__(self) -> None:
        require_number(self, "length", positive=True)
        require_integer(self, "n_elements", minimum=1)
        require_number(self.payload, "submerged_weight", positive=True)
        require(self.payload_drag in PAYLOAD_DRAG, self, "payload_drag", f"one of {', '.join(PAYLOAD_DRAG)}")
        self._require_taut(self.length)

    def _require_taut(self, longest: float) -> None:
        if self.payload.submerged_weight + self.cable.submerged_weight * longest <= 0.0:
            raise ValueError(
                f"the payload's weight of {self.payload.submerged_weight:g} N must exceed the buoyancy of "
                f"{longest:g} m of a cable of {self.cable.submerged_weight:g} N/m, or it does not hang"
            )

    @cached_property
    def _numbers(self) -> _Numbers:
        cable, payload = self.cable, self.payload
        depth, along_x, _ = current_knots(self.current)
        quadratic, cubic = rope_energy_coefficients(cable)
        return _Numbers(
            EA=float(cable.axial_stiffness),
            CA=float(cable.axial_damping),
            tension_only=cable.tension_only,
            hookean=cable.is_hookean,
            quadratic=float(quadratic),
            cubic=float(cubic),
            relaxing_stiffness=float(cable.relaxing_stiffness),
            relaxation_rate=1.0 / float(cable.relaxation_time),
            inertia_along=float(cable.inertia_per_length),
            inertia_across=float(cable.transverse_inertia_per_length),
            weight=float(cable.submerged_weight),
            normal_drag=float(cable.normal_drag_per_length),
            tangential_drag=float(cable.tangential_drag_per_length),
            payload_inertia_x=float(payload.lateral_inertia),
            payload_inertia_z=float(payload.inertia),
            payload_drag_x=float(payload.lateral_drag_factor),
            payload_drag_z=float(payload.drag_factor),
            payload_weight=float(payload.submerged_weight),
            drag_by_vector=self.payload_drag == "vector",
            current_depth=depth,
            current_x=along_x,
            current_time=np.array(self.current.time, dtype=float),
            current_factor=np.array(self.current.factor, dtype=float),
        )

    def hanging(
        self, top: tuple[float, float] = (0.0, 0.0), length: float | None = None, *, time: float = 0.0
    ) -> PlanarState:
        """Hanging straight down, as at rest in still water: where the thesis's examples begin.

        Args:
            top: Sheave, x and z [m].
            length: Unstretched length [m]; that of the solver if not given.
            time: The instant [s].
        """
        n, L = self.n_elements, self._checked_length(length)
        spacing = L / n
        weight = self.payload.submerged_weight + self.cable.submerged_weight * spacing * (np.arange(n) + 0.5)
        above = np.concatenate([[0.0], np.cumsum((spacing * (1.0 + self._strain(weight)))[::-1])])
        position = np.column_stack([np.full(n + 1, float(top[0])), float(top[1]) - above[::-1]])
        return PlanarState(position, np.zeros((n + 1, 2)), weight, L, float(time))

    def _strain(self, tension: Array) -> Array:
        """Strain of the cable at rest under a tension [-]."""
        if self.cable.is_hookean:
            return tension / self.cable.axial_stiffness
        return static_strain(self.cable, tension)

    def rest(
        self, top: tuple[float, float] = (0.0, 0.0), length: float | None = None, *, time: float = 0.0
    ) -> PlanarState:
        """Static equilibrium in the current of the instant `time`, which is raised step by step if it must.

        Args:
            top: Sheave, x and z [m].
            length: Unstretched length [m]; that of the solver if not given.
            time: The instant at which the current's factor is taken [s].

        Raises:
            ConvergenceError: If no equilibrium is found, as where the current blows the cable out.
        """
        state = self.hanging(top, length, time=time)
        factor = float(current_factor(self.current, time))
        if factor == 0.0 or not self._numbers.current_x.any():
            return state
        reached, stride, missing = 0.0, 1.0, np.inf
        relaxed = np.zeros(self.n_elements)
        while reached < 1.0:
            goal = min(1.0, reached + stride)
            position, tension = state.position.copy(), state.tension.copy()
            increment, still = np.zeros_like(position), np.zeros_like(position)
            step = _Step(position, still, relaxed, state.length, state.length, 1.0, True, goal * factor)
            settled, missing = _settle(self._numbers, step, increment, tension)
            if settled and tension.min() > 0.0:
                state = replace(state, position=position + increment, tension=tension)
                reached, stride = goal, 2.0 * stride
            else:
                stride *= 0.5
                if stride < 1e-4:
                    raise ConvergenceError(
                        f"no static shape was found beyond {reached:.2g} of the current [N]: it blows the "
                        "cable out; lower the current, or give more weight or more elements",
                        missing,
                    )
        stretch = 1.0 + float(self._strain(state.tension.max()))
        if stretch > 2.0:
            raise ConvergenceError(
                f"the current stretches the cable to {stretch:.3g} times its length: it blows the cable out; "
                "lower the current, or give a stiffer cable",
                missing,
            )
        return state

    def step(self, state: PlanarState, top: tuple[float, float, float], dt: float) -> PlanarState:
        """Advances by `dt` [s].

        Args:
            state: The instant to go on from.
            top: Sheave x and z [m], and unstretched length [m], at the end of the step.
            dt: Time step [s].

        Raises:
            ConvergenceError: If the step does not settle, even in its smallest parts.
        """
        new = self._begun(state)
        sheave = np.array([state.position[-1], top[:2]], dtype=float)
        self._run(new, sheave, np.array([state.length, self._checked_length(top[2])]), dt)
        return replace(new, length=float(top[2]), time=state.time + dt)

    def top_tension(self, state: PlanarState) -> float:
        """Tension at the sheave [N]."""
        row = np.empty(_COLUMNS)
        _note(state.position, state.velocity, state.tension, self.cable.tension_only, row)
        return float(row[4])

    def payload_motion(self, state: PlanarState) -> tuple[Array, Array]:
        """Position [m] and velocity [m/s] of the payload, x and z, each (2,)."""
        return state.position[0].copy(), state.velocity[0].copy()

    def static_stretch(self, length: Array | float) -> Array | float:
        """Elongation hanging still and straight, L (w2 + w1 L / 2) / EA by Hooke's law [m]."""
        if not self.cable.is_hookean:
            return hanging_elongation(self.cable, self.payload, length, self.n_elements)
        weight = self.payload.submerged_weight + 0.5 * self.cable.submerged_weight * length
        return length * weight / self.cable.axial_stiffness

    def simulate(
        self,
        top_x: Array,
        top_z: Array,
        dt: float,
        length: Array | None = None,
        *,
        start: PlanarState | None = None,
        shapes_every: int | None = None,
    ) -> PlanarRecord:
        """Marches through a given motion of the sheave.

        Args:
            top_x: Sheave along the current at each instant [m], (n_steps + 1,).
            top_z: Sheave up from the mean surface at each instant [m], (n_steps + 1,).
            dt: Time step [s].
            length: Unstretched length at each instant [m], (n_steps + 1,); constant if not given.
            start: Where to begin; `rest` below the first sheave position if not given.
            shapes_every: Every how many steps to keep the cable's shape; never if not given.

        Raises:
            ConvergenceError: If a step does not settle, even in its smallest parts.
        """
        sheave = self._checked_motion(top_x, top_z)
        if length is None:
            lengths = np.full(len(sheave), self.length if start is None else start.length)
        else:
            lengths = np.asarray(length, dtype=float)
        self._check_lengths(lengths, len(sheave))
        first = (float(sheave[0, 0]), float(sheave[0, 1]))
        state = self._begun(self.rest(first, float(lengths[0])) if start is None else start)
        if state.position.shape != (self.n_elements + 1, 2) or state.length != lengths[0]:
            raise ValueError(
                f"start must have {self.n_elements} elements and the motion's first length of "
                f"{lengths[0]:g} m, got {len(state.position) - 1} elements and {state.length:g} m"
            )
        every = 0 if shapes_every is None else shapes_every
        out, shapes = self._run(state, sheave, lengths, dt, every)
        time = state.time + dt * np.arange(len(sheave))
        return PlanarRecord(
            time=time,
            length=lengths,
            payload_x=out[:, 0],
            payload_z=out[:, 1],
            payload_velocity_x=out[:, 2],
            payload_velocity_z=out[:, 3],
            top_tension=out[:, 4],
            top_angle=out[:, 5],
            payload_tension=out[:, 6],
            least_tension=out[:, 7],
            largest_tension=out[:, 8],
            shape_time=time[:: every or len(time)][: len(shapes)],
            shapes=shapes,
            final=replace(state, length=float(lengths[-1]), time=float(time[-1])),
        )

    def _begun(self, state: PlanarState) -> PlanarState:
        """A copy to march on, with room for what the Maxwell branches of a rope hold."""
        new = state.copy()
        if len(new.branch_strain) > 0 or self.cable.is_hookean:
            return new
        return replace(new, branch_strain=np.zeros(self.n_elements))

    def _checked_length(self, length: float | None) -> float:
        L = self.length if length is None else float(length)
        if not (math.isfinite(L) and L > 0.0):
            raise ValueError(f"length must be a positive number, got {length!r}")
        self._require_taut(L)
        return L

    def _check_lengths(self, lengths: Array, n_instants: int) -> None:
        if lengths.shape != (n_instants,):
            raise ValueError(
                f"length must have one number for each of the {n_instants} instants, got {lengths.shape}"
            )
        if not (np.all(np.isfinite(lengths)) and lengths.min() > 0.0):
            raise ValueError(f"length must be positive throughout, got {lengths.min():g} m at the least")
        self._require_taut(float(lengths.max()))

    @staticmethod
    def _checked_motion(top_x: Array, top_z: Array) -> Array:
        x, z = np.asarray(top_x, dtype=float), np.asarray(top_z, dtype=float)
        if x.ndim != 1 or x.shape != z.shape or len(x) == 0:
            raise ValueError(
                f"top_x and top_z must be equally long series of one axis, got {x.shape} and {z.shape}"
            )
        if not (np.all(np.isfinite(x)) and np.all(np.isfinite(z))):
            raise ValueError("top_x and top_z must be finite, got a number that is not")
        return np.column_stack([x, z])

    def _run(
        self, state: PlanarState, sheave: Array, length: Array, dt: float, every: int = 0
    ) -> tuple[Array, Array]:
        if not (math.isfinite(dt) and dt > 0.0):
            raise ValueError(f"dt must be a positive number, got {dt!r}")
        out = np.empty((len(sheave), _COLUMNS))
        n_shapes = (len(sheave) - 1) // every + 1 if every > 0 else 0
        shapes = np.empty((n_shapes, self.n_elements + 1, 2))
        failed, missing = _march(
            self._numbers,
            state.position,
            state.velocity,
            state.branch_strain,
            state.tension,
            sheave,
            length,
            state.time,
            dt,
            out,
            every,
            shapes,
        )
        if failed >= 0:
            raise ConvergenceError(
                f"the step to {state.time + failed * dt:g} s did not settle, even in parts of "
                f"{_SMALLEST_PART * dt:g} s [N]: a cable that goes slack without damping is the usual cause; "
                "give axial_damping of some milliseconds times axial_stiffness, or a smaller dt",
                missing,
            )
        return out, shapes
