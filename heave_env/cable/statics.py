"""Static shape of a line in three dimensions: elastic, of several sections, with bodies, in a current.

F(s) is the tension vector, along the tangent t towards the upper end; q the load per unstretched length:

    balance      dF/ds + q = 0,   q = f(U, t) - w k     at a body  F_above - F_below + P = 0
    geometry     dr/ds = (1 + T/EA) t,   t = F/T,   T = |F|
    drag         f = (1/2) ρ d C_N |U_N| U_N + (π/2) ρ d C_t |U_t| U_t, on the unstretched length

Of a rope that hardens (`constitutive`) the strain e(T) stands for T/EA; at rest it has relaxed.

Under a constant load F is linear in s, and the chord of a segment of length l has a closed form. With a and
b its forces at the two ends, S = |a| + |b|, d = b - a, y = d²/S²:

    ∫ t ds / l = (a + b) g(y) / S + d (|b| - |a|) k(y) / S²,
    g = artanh(√y) / √y = 1 + y/3 + y²/5 + ...,   k = (1 - g) / y

It is the same integral as Huang's (2.31)-(2.33), whose (2.33) ends in the difference of the two square
roots (print makes it a quotient). His form fails for a vertical cable (no horizontal force) and for a
neutrally buoyant one (W = 0); here both are y = 1 and y = 0 of functions that stay whole. His point loads at
the ends of segments have become a load spread over each segment, which may point anywhere. The stretch of a
hardening rope, ∫ e(T) t ds, has none: it is taken at three Gauss points of each segment.

Tension is never negative: where a line would be pushed it folds. Bending and torsion are left out, and so
are the sea bed beneath a sagging line and the sea's surface above a floating one.

Source: Huang (1992), chapter 2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numba import njit
from scipy.optimize import brentq

from heave_env.cable.constitutive import (
    relaxed_tension,
    rope_energy_coefficients,
    static_strain,
    strain_of,
)
from heave_env.cable.convergence import ConvergenceError
from heave_env.compiled import source_fingerprint, stage
from heave_env.hydrodynamics import between_knots, current_factor, current_knots, line_drag, line_drag_slopes
from heave_env.parameters import (
    Cable,
    Current,
    Line,
    Payload,
    Section,
    require,
    require_integer,
    require_number,
)

Array = np.ndarray

GREATEST_STRESS = 5.0e9
"""Tension over the section of the drag diameter that no cable bears [Pa]; steel wire parts near 2e9."""
GREATEST_STRAIN = 0.5
"""Strain beyond which neither Hooke's law nor a rope's says anything [-]."""

_LOWER_ROWS = 3  # conditions at the lower end come first: they set the band's width
_BAND = 8  # entries left and right of the diagonal


@stage
def _chord_series(y):
    """g, k and their derivatives by y; near zero their series, else the closed form."""
    if y < 0.05:
        g, k, dg, dk = 0.0, 0.0, 0.0, 0.0
        power = 1.0
        for n in range(13):
            g += power / (2 * n + 1)
            k -= power / (2 * n + 3)
            dg += (n + 1) * power / (2 * n + 3)
            dk -= (n + 1) * power / (2 * n + 5)
            power *= y
        return g, k, dg, dk
    y = min(y, 1.0 - 1e-15)  # a fold: the tension passes through zero, and the logarithms cancel
    x = y**0.5
    g = np.arctanh(x) / x
    k = (1.0 - g) / y
    dg = (1.0 / (1.0 - y) - g) / (2.0 * y)
    return g, k, dg, -(dg + k) / y


@stage
def _chord(a, b, chord, by_a, by_b):
    """Mean tangent over a segment whose tension vector goes from `a` to `b`, and its derivatives by both."""
    of_a = (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]) ** 0.5
    of_b = (b[0] * b[0] + b[1] * b[1] + b[2] * b[2]) ** 0.5
    S, D = of_a + of_b + 1e-30, of_b - of_a
    square = (b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2
    y = square / (S * S)
    g, k, dg, dk = _chord_series(y)
    P, Q = g / S, D * k / (S * S)
    for i in range(3):
        chord[i] = P * (a[i] + b[i]) + Q * (b[i] - a[i])
    for j in range(3):
        ta, tb = a[j] / (of_a + 1e-30), b[j] / (of_b + 1e-30)
        for end in range(2):
            sign = 1.0 if end == 1 else -1.0
            dS = tb if end == 1 else ta
            dy = 2.0 * (sign * (b[j] - a[j]) / S - y * dS) / S
            dP = (dg * dy - P * dS) / S
            dQ = (k * sign * dS + D * dk * dy) / (S * S) - 2.0 * Q * dS / S
            for i in range(3):
                slope = (a[i] + b[i]) * dP + (b[i] - a[i]) * dQ
                if i == j:
                    slope += P + sign * Q
                if end == 1:
                    by_b[i, j] = slope
                else:
                    by_a[i, j] = slope


@stage
def _stretch(a, b, law, stretch, by_a, by_b):
    """Mean of strain times tangent over a segment whose tension vector goes from `a` to `b`, its derivatives.

    `law` (3,): EA and the coefficients of a hardening rope's energy, zero by Hooke's law.
    """
    EA, quadratic, cubic = law[0], law[1], law[2]
    hookean = quadratic == 0.0 and cubic == 0.0
    for i in range(3):
        stretch[i] = 0.5 * (a[i] + b[i]) / EA if hookean else 0.0
        for j in range(3):
            by_a[i, j] = 0.5 / EA if hookean and i == j else 0.0
            by_b[i, j] = by_a[i, j]
    if hookean:
        return
    for point in range(3):
        share = 0.5 + (point - 1) * math.sqrt(0.15)
        weight = 4.0 / 9.0 if point == 1 else 5.0 / 18.0
        x, y, z = a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2])
        force = (x, y, z)
        T = math.sqrt(x * x + y * y + z * z) + 1e-30
        strain = strain_of(T, EA, quadratic, cubic)
        _, slope = relaxed_tension(strain, EA, quadratic, cubic)
        soft, turning = strain / T, (1.0 / slope - strain / T) / (T * T)
        for i in range(3):
            stretch[i] += weight * soft * force[i]
            for j in range(3):
                by_force = weight * (turning * force[i] * force[j] + (soft if i == j else 0.0))
                by_a[i, j] += (1.0 - share) * by_force
                by_b[i, j] += share * by_force


@stage
def _water(z, factor, knots):
    """Horizontal velocity of the water at height z, relative to the line, and its slopes by z."""
    step = 1e-7
    depths, along_x, along_y = knots[0], knots[1], knots[2]
    x, y = between_knots(-z, depths, along_x), between_knots(-z, depths, along_y)
    x_slope = (between_knots(-z - step, depths, along_x) - between_knots(-z + step, depths, along_x)) / step
    y_slope = (between_knots(-z - step, depths, along_y) - between_knots(-z + step, depths, along_y)) / step
    return factor * x, factor * y, 0.5 * factor * x_slope, 0.5 * factor * y_slope


@stage
def _drag_turns(ux, uy, tx, ty, tz, normal_factor, tangential_factor, turns):
    """Derivatives of `line_drag` by the tangent, for turns of it across itself; fills `turns` (3, 3)."""
    along = ux * tx + uy * ty
    normal = (ux - along * tx, uy - along * ty, -along * tz)
    tangent = (tx, ty, tz)
    across = (normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2) ** 0.5
    dyadic = normal_factor * along / across if across > 0.0 else 0.0
    of_tangent = 2.0 * tangential_factor * abs(along) - normal_factor * across
    direct = tangential_factor * abs(along) * along - normal_factor * across * along
    for i in range(3):
        for j in range(3):
            turns[i, j] = (of_tangent * tangent[i] - dyadic * normal[i]) * normal[j]
        turns[i, i] += direct


@stage
def _segment_load(low, high, factor, weight, normal_factor, tangential_factor, knots, load, by_low, by_high):
    """Load per unstretched length of a segment between two nodes, and its derivatives by their positions.

    The current at mid-height, the tangent of the chord: second order in the segment's length.
    """
    ux, uy, x_slope, y_slope = _water(0.5 * (low[2] + high[2]), factor, knots)
    dx, dy, dz = high[0] - low[0], high[1] - low[1], high[2] - low[2]
    per_chord = 1.0 / ((dx * dx + dy * dy + dz * dz) ** 0.5 + 1e-30)
    t = (dx * per_chord, dy * per_chord, dz * per_chord)
    load[0], load[1], load[2] = line_drag(ux, uy, 0.0, t[0], t[1], t[2], normal_factor, tangential_factor)
    load[2] -= weight
    xx, xy, xz, yy, yz, _ = line_drag_slopes(ux, uy, 0.0, t[0], t[1], t[2], normal_factor, tangential_factor)
    _drag_turns(ux, uy, t[0], t[1], t[2], normal_factor, tangential_factor, by_high)
    by_velocity = ((xx, xy), (xy, yy), (xz, yz))
    for i in range(3):
        along = by_high[i, 0] * t[0] + by_high[i, 1] * t[1] + by_high[i, 2] * t[2]
        for j in range(3):
            turned = (by_high[i, j] - along * t[j]) * per_chord
            by_low[i, j], by_high[i, j] = -turned, turned
        deeper = 0.5 * (by_velocity[i][0] * x_slope + by_velocity[i][1] * y_slope)
        by_low[i, 2] += deeper
        by_high[i, 2] += deeper


@stage
def _body_load(z, factor, weight, drag_factor, knots, load, by_height):
    """Weight and drag of a body at height z, and their derivatives by z."""
    ux, uy, x_slope, y_slope = _water(z, factor, knots)
    speed = (ux * ux + uy * uy) ** 0.5
    change = (ux * x_slope + uy * y_slope) / speed if speed > 0.0 else 0.0
    load[0], load[1], load[2] = drag_factor * speed * ux, drag_factor * speed * uy, -weight
    by_height[0] = drag_factor * (speed * x_slope + change * ux)
    by_height[1] = drag_factor * (speed * y_slope + change * uy)
    by_height[2] = 0.0


@njit(error_model="numpy")
def _eliminate(band, right):
    """Solves a banded system in place, with row exchanges; row i holds columns i - 8 to i + 16."""
    n, b = len(right), _BAND
    for c in range(n):
        last = min(n - 1, c + b)
        pivot, best = c, abs(band[c, b])
        for i in range(c + 1, last + 1):
            if abs(band[i, c - i + b]) > best:
                pivot, best = i, abs(band[i, c - i + b])
        if not best > 0.0:
            return False
        end = min(n - 1, c + 2 * b)
        if pivot != c:
            for j in range(c, end + 1):
                kept = band[c, j - c + b]
                band[c, j - c + b] = band[pivot, j - pivot + b]
                band[pivot, j - pivot + b] = kept
            right[c], right[pivot] = right[pivot], right[c]
        for i in range(c + 1, last + 1):
            share = band[i, c - i + b] / band[c, b]
            if share != 0.0:
                for j in range(c + 1, end + 1):
                    band[i, j - i + b] -= share * band[c, j - c + b]
                right[i] -= share * right[c]
    for c in range(n - 1, -1, -1):
        for j in range(c + 1, min(n - 1, c + 2 * b) + 1):
            right[c] -= band[c, j - c + b] * right[j]
        right[c] /= band[c, b]
    return True


@njit(error_model="numpy")
def _balance(nodes, factor, segments, bodies, knots, ends, band, rest):
    """Residual of all equations at `nodes` (n + 1, 6: position, force above), and its derivatives.

    `segments` (n, 7): length, weight, normal and tangential drag factor, and the law of `_stretch`.
    `bodies` (n + 1, 2): weight, drag factor. `ends` (2, 6): whether each component of the position is held,
    and where or with which force. Returns the largest residual.
    """
    n = len(segments)
    chord, load, point, slope = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    below, stretch = np.empty(3), np.empty(3)
    by_a, by_b = np.empty((3, 3)), np.empty((3, 3))
    softer_a, softer_b = np.empty((3, 3)), np.empty((3, 3))
    by_low, by_high = np.empty((3, 3)), np.empty((3, 3))
    band[:] = 0.0
    _body_load(nodes[0, 2], factor, bodies[0, 0], bodies[0, 1], knots, point, slope)
    for i in range(3):
        if ends[0, i] > 0.0:
            rest[i] = nodes[0, i] - ends[0, 3 + i]
            band[i, _BAND] = 1.0
        else:
            rest[i] = nodes[0, 3 + i] + point[i] + ends[0, 3 + i]
            band[i, 3 + _BAND] = 1.0
            band[i, 2 - i + _BAND] += slope[i]
    for s in range(n):
        low, high = nodes[s], nodes[s + 1]
        length = segments[s, 0]
        _body_load(high[2], factor, bodies[s + 1, 0], bodies[s + 1, 1], knots, point, slope)
        weight, across, along = segments[s, 1], segments[s, 2], segments[s, 3]
        _segment_load(low, high, factor, weight, across, along, knots, load, by_low, by_high)
        for i in range(3):
            below[i] = high[3 + i] + point[i]
        _chord(low[3:], below, chord, by_a, by_b)
        _stretch(low[3:], below, segments[s, 4:], stretch, softer_a, softer_b)
        first = _LOWER_ROWS + 6 * s
        for i in range(3):
            r, f = first + i, first + 3 + i
            rest[r] = high[i] - low[i] - length * (chord[i] + stretch[i])
            rest[f] = below[i] - low[3 + i] + length * load[i]
            at_r, at_f = 6 * s - r + _BAND, 6 * s - f + _BAND  # where this segment's columns begin
            band[r, at_r + i] -= 1.0
            band[r, at_r + 6 + i] += 1.0
            band[f, at_f + 3 + i] -= 1.0
            band[f, at_f + 9 + i] += 1.0
            band[f, at_f + 8] += slope[i]
            for j in range(3):
                of_below = length * (by_b[i, j] + softer_b[i, j])
                band[r, at_r + 3 + j] -= length * (by_a[i, j] + softer_a[i, j])
                band[r, at_r + 9 + j] -= of_below
                band[r, at_r + 8] -= of_below * slope[j]
                band[f, at_f + j] += length * by_low[i, j]
                band[f, at_f + 6 + j] += length * by_high[i, j]
    for i in range(3):
        r = _LOWER_ROWS + 6 * n + i
        held = ends[1, i] > 0.0
        column = 6 * n + i + (0 if held else 3)
        rest[r] = nodes[n, i if held else 3 + i] - ends[1, 3 + i]
        band[r, column - r + _BAND] = 1.0
    worst = 0.0
    for r in range(len(rest)):
        worst = max(worst, abs(rest[r]))
        if rest[r] != rest[r]:
            return np.inf
    return worst


@njit(error_model="numpy")
def _hang(nodes, factor, segments, bodies, knots, ends):
    """Rewrites `nodes` as the shape under loads frozen at their present values; its residual.

    The chord is the gradient of a convex function of the lower end's force, so Newton with a line search
    on its slope finds the one answer from anywhere.
    """
    n = len(segments)
    chord, force, below, stretch = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    by_a, by_b = np.empty((3, 3)), np.empty((3, 3))
    softer_a, softer_b = np.empty((3, 3)), np.empty((3, 3))
    loads, points, unused = np.empty((n, 3)), np.empty((n + 1, 3)), np.empty(3)
    total = np.zeros(3)
    for s in range(n + 1):
        _body_load(nodes[s, 2], factor, bodies[s, 0], bodies[s, 1], knots, points[s], unused)
        if s > 0:
            total += points[s]
        if s < n:
            weight, across, along = segments[s, 1], segments[s, 2], segments[s, 3]
            low, high = nodes[s], nodes[s + 1]
            _segment_load(low, high, factor, weight, across, along, knots, loads[s], by_a, by_b)
            total += segments[s, 0] * loads[s]
    start, wanted, free = np.empty(3), np.zeros(3), np.zeros(3)
    for i in range(3):
        if ends[0, i] > 0.0 and ends[1, i] > 0.0:
            free[i], wanted[i] = 1.0, ends[1, 3 + i] - ends[0, 3 + i]
            start[i] = 0.5 * total[i] + wanted[i]
        elif ends[0, i] > 0.0:
            start[i] = ends[1, 3 + i] + total[i]
        else:
            start[i] = -(points[0, i] + ends[0, 3 + i])
    trial, step, reached, matrix = start.copy(), np.zeros(3), np.empty(3), np.zeros((3, 3))
    low_share, high_share, share, falling, worst = 0.0, -1.0, 1.0, 0.0, np.inf
    for _ in range(400):
        for i in range(3):
            trial[i] = start[i] + share * step[i]
        force[:], reached[:], matrix[:] = trial, 0.0, 0.0
        for s in range(n):
            length = segments[s, 0]
            hookean = segments[s, 5] == 0.0 and segments[s, 6] == 0.0
            for i in range(3):
                below[i] = force[i] - length * loads[s, i]
            _chord(force, below, chord, by_a, by_b)
            _stretch(force, below, segments[s, 4:], stretch, softer_a, softer_b)
            for i in range(3):
                reached[i] += length * (chord[i] + stretch[i])
                if hookean:
                    matrix[i, i] += length / segments[s, 4]
                for j in range(3):
                    matrix[i, j] += length * (by_a[i, j] + by_b[i, j])
                    if not hookean:
                        matrix[i, j] += length * (softer_a[i, j] + softer_b[i, j])
                force[i] = below[i] - points[s + 1, i]
        slope = 0.0
        for i in range(3):
            slope += step[i] * free[i] * (reached[i] - wanted[i])
        # Along the step the slope only rises: it must come near zero or stay below it.
        if slope > 0.5 * falling and share > 1e-12 and falling > 0.0:
            high_share = share
            share = 0.5 * (low_share + high_share)
            continue
        start[:] = trial
        worst = 0.0
        for i in range(3):
            if free[i] > 0.0:
                worst = max(worst, abs(reached[i] - wanted[i]))
        if worst < 1e-13:
            break
        for i in range(3):
            for j in range(3):
                if free[i] == 0.0 or free[j] == 0.0:
                    matrix[i, j] = 1.0 if i == j else 0.0
            step[i] = free[i] * (wanted[i] - reached[i])
        step[:] = np.linalg.solve(matrix, step)
        falling = 0.0
        for i in range(3):
            falling += step[i] * free[i] * (wanted[i] - reached[i])
        low_share, high_share, share = 0.0, -1.0, 1.0
    for i in range(3):
        nodes[0, i] = ends[0, 3 + i] if ends[0, i] > 0.0 else ends[1, 3 + i] - reached[i]
    nodes[0, 3:] = start
    for s in range(n):
        length = segments[s, 0]
        for i in range(3):
            below[i] = nodes[s, 3 + i] - length * loads[s, i]
        _chord(nodes[s, 3:], below, chord, by_a, by_b)
        _stretch(nodes[s, 3:], below, segments[s, 4:], stretch, softer_a, softer_b)
        for i in range(3):
            nodes[s + 1, i] = nodes[s, i] + length * (chord[i] + stretch[i])
            nodes[s + 1, 3 + i] = below[i] - points[s + 1, i]
    return worst


@njit(error_model="numpy")
def _settle(nodes, factor, segments, bodies, knots, ends, tolerance):
    """Newton with a line search on all equations; rewrites `nodes`. Returns residual and count.

    Past the tolerance it goes on for as long as full steps help, which is down to rounding.
    """
    n = len(segments)
    size = 6 * (n + 1)
    band, rest = np.empty((size, 3 * _BAND + 1)), np.empty(size)
    trial, other = np.empty_like(nodes), np.empty(size)
    worst = _balance(nodes, factor, segments, bodies, knots, ends, band, rest)
    count = 0
    while count < 60:
        polish = worst < tolerance
        size_of_rest = np.sum(rest * rest)
        if not _eliminate(band, rest) or not np.all(np.isfinite(rest)):
            break
        share, better = 1.0, False
        for _ in range(9):
            for s in range(n + 1):
                for i in range(6):
                    trial[s, i] = nodes[s, i] - share * rest[6 * s + i]
            found = _balance(trial, factor, segments, bodies, knots, ends, band, other)
            if np.isfinite(found) and np.sum(other * other) < (1.0 - 0.2 * share) * size_of_rest:
                better = True
                break
            if polish:
                break
            share *= 0.5
        count += 1
        if not better:
            break
        nodes[:], rest[:], worst = trial, other, found
    return worst, count


def _make_solver(fingerprint: int):
    """The entries from Python, which numba keeps: a kept function must not hold another in its closure."""

    @njit(cache=True, error_model="numpy")
    def find(nodes, started, segments, bodies, knots, ends, tolerance):
        """Finds the shape; rewrites `nodes`. Returns residual, Newton steps and the share of the current.

        From `nodes` if they are a guess; else from the shape under drag frozen a few times; else, from still
        water on, with the current raised step by step, as Huang (1992), 2.5, does.
        """
        if fingerprint == 0:
            return np.inf, 0, 0.0
        straight, count = nodes.copy(), 0
        if started:
            worst, count = _settle(nodes, 1.0, segments, bodies, knots, ends, tolerance)
            if worst < tolerance:
                return worst, count, 1.0
            _hang(straight, 0.0, segments, bodies, knots, ends)
        for rounds in (1, 5):
            nodes[:] = straight
            for _ in range(rounds):
                _hang(nodes, 1.0, segments, bodies, knots, ends)
            worst, more = _settle(nodes, 1.0, segments, bodies, knots, ends, tolerance)
            count += more
            if worst < tolerance:
                return worst, count, 1.0
        reached, step = 0.0, 0.25
        nodes[:] = straight
        _hang(nodes, 1e-3, segments, bodies, knots, ends)
        settled, before, reached_before = nodes.copy(), nodes.copy(), 0.0
        worst = np.inf
        while step > 1e-4 and count < 3000:
            factor = min(1.0, reached + step)
            nodes[:] = settled
            if reached_before > 0.0:
                nodes += (factor - reached) / (reached - reached_before) * (settled - before)
            worst, more = _settle(nodes, factor, segments, bodies, knots, ends, tolerance)
            count += more
            if worst < tolerance:
                before[:], settled[:] = settled, nodes
                reached_before, reached = reached, factor
                if reached == 1.0:
                    return worst, count, 1.0
                step *= 1.6
            else:
                step *= 0.5
        return worst, count, reached

    @njit(cache=True, error_model="numpy")
    def sample(at, arc_length, position, force, load, laws):
        """Position and tension vector at any arc lengths, exact within each segment; (n_points, 6)."""
        out = np.empty((len(at), 6))
        if fingerprint == 0:
            return out
        chord, by_a, by_b = np.empty(3), np.empty((3, 3)), np.empty((3, 3))
        stretch = np.empty(3)
        for p in range(len(at)):
            s = min(max(np.searchsorted(arc_length, at[p], side="right") - 1, 0), len(laws) - 1)
            part = at[p] - arc_length[s]
            here = force[s] - part * load[s]
            _chord(force[s], here, chord, by_a, by_b)
            _stretch(force[s], here, laws[s], stretch, by_a, by_b)
            out[p, :3] = position[s] + part * (chord + stretch)
            out[p, 3:] = here
        return out

    return find, sample


_find, _sample = _make_solver(source_fingerprint())


def _law(cable: Cable) -> tuple[float, float, float]:
    """The relaxed cable's law as `_stretch` takes it."""
    return cable.axial_stiffness, *rope_energy_coefficients(cable)


def _straight_tension(sections: tuple[Section, ...], elongation: float, first: float) -> float:
    """Tension under which sections of hardening rope, one after the other, are so much longer [N]."""

    def excess(tension: float) -> float:
        stretched = sum(section.length * float(static_strain(section.cable, tension)) for section in sections)
        return stretched - elongation

    high = first
    while excess(high) < 0.0:
        high *= 2.0
    return float(brentq(excess, 0.0, high))


def _require_vector(owner: object, field_name: str, size: int) -> None:
    value = getattr(owner, field_name)
    ok = isinstance(value, tuple) and len(value) == size
    ok = ok and all(isinstance(v, (int, float)) and math.isfinite(v) for v in value)
    require(ok, owner, field_name, f"{size} finite numbers")


_HELD = (True, True, True)


@dataclass(frozen=True, kw_only=True)
class FixedEnds:
    """Both ends held: a submerged line between two structures. Source: Huang (1992), (2.6)-(2.7)."""

    lower: tuple[float, float, float]
    """Where the lower end is (s = 0) [m]."""
    upper: tuple[float, float, float]
    """Where the upper end is (s = length) [m]."""

    def __post_init__(self) -> None:
        _require_vector(self, "lower", 3)
        _require_vector(self, "upper", 3)

    @property
    def conditions(self) -> tuple[tuple[bool, ...], tuple[float, ...], tuple[bool, ...], tuple[float, ...]]:
        """Per end: which components of its position are held, and where, or else with which force [N]."""
        return _HELD, self.lower, _HELD, self.upper


@dataclass(frozen=True, kw_only=True)
class Towed:
    """Upper end on a vessel, lower end with a unit that hangs free. Source: Huang (1992), (2.8)-(2.11)."""

    payload: Payload
    """The unit at the lower end; its drag is that of its lateral drag area."""
    upper: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where the upper end is [m]."""
    velocity: tuple[float, float] = (0.0, 0.0)
    """Velocity of the vessel, and of all that it tows, over ground [m/s]."""
    thrust: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Force of the unit's own thrusters [N]."""

    def __post_init__(self) -> None:
        _require_vector(self, "upper", 3)
        _require_vector(self, "velocity", 2)
        _require_vector(self, "thrust", 3)

    @property
    def conditions(self) -> tuple[tuple[bool, ...], tuple[float, ...], tuple[bool, ...], tuple[float, ...]]:
        """Per end: which components of its position are held, and where, or else with which force [N]."""
        return (False, False, False), self.thrust, _HELD, self.upper


@dataclass(frozen=True, kw_only=True)
class Moored:
    """Lower end anchored, upper end at a known height under a known pull.

    Source: Huang (1992), (2.12)-(2.15).
    """

    anchor: tuple[float, float, float]
    """Where the lower end is [m]."""
    upper_height: float
    """Height z of the upper end [m]."""
    pull: tuple[float, float]
    """Horizontal force that the moored body exerts on the line, along x and y [N]."""

    def __post_init__(self) -> None:
        _require_vector(self, "anchor", 3)
        _require_vector(self, "pull", 2)
        require_number(self, "upper_height")

    @property
    def conditions(self) -> tuple[tuple[bool, ...], tuple[float, ...], tuple[bool, ...], tuple[float, ...]]:
        """Per end: which components of its position are held, and where, or else with which force [N]."""
        return _HELD, self.anchor, (False, False, True), (*self.pull, self.upper_height)


@dataclass(frozen=True, kw_only=True)
class OnSeabed:
    """Upper end on a vessel, lower end with a unit that crawls over a level bed under its own thrust.

    The bed carries what the unit's weight leaves; it has no friction.
    """

    payload: Payload
    """The unit at the lower end."""
    height: float
    """Height z of the bed [m]."""
    thrust: tuple[float, float] = (0.0, 0.0)
    """Horizontal force of the unit's thrusters [N]."""
    upper: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where the upper end is [m]."""

    def __post_init__(self) -> None:
        _require_vector(self, "thrust", 2)
        _require_vector(self, "upper", 3)
        require_number(self, "height")
        require_number(self.payload, "submerged_weight", non_negative=True)

    @property
    def conditions(self) -> tuple[tuple[bool, ...], tuple[float, ...], tuple[bool, ...], tuple[float, ...]]:
        """Per end: which components of its position are held, and where, or else with which force [N]."""
        return (False, False, True), (*self.thrust, self.height), _HELD, self.upper


Ends = FixedEnds | Towed | Moored | OnSeabed


@dataclass(frozen=True, kw_only=True)
class StaticShape:
    """A line at rest: nodes from the lower end up, and what the line carries there."""

    line: Line
    """The line."""
    ends: Ends
    """How its ends are held."""
    current: Current
    """What it lies in."""
    arc_length: Array = field(repr=False)
    """Unstretched distance of the nodes from the lower end [m], (n_nodes,)."""
    position: Array = field(repr=False)
    """Where the nodes are [m], (n_nodes, 3)."""
    force: Array = field(repr=False)
    """Tension vector just above each node, towards the upper end [N], (n_nodes, 3)."""
    load: Array = field(repr=False)
    """Weight in water and drag per unstretched length of each segment [N/m], (n_nodes - 1, 3)."""
    section: Array = field(repr=False)
    """Which section of the line each segment belongs to, (n_nodes - 1,)."""
    residual: float
    """Largest residual of the equations: of lengths over the line's, of forces over the greatest load [-]."""
    n_iterations: int
    """Newton steps taken."""

    @property
    def tension(self) -> Array:
        """Tension just above each node [N], (n_nodes,)."""
        return np.asarray(np.linalg.norm(self.force, axis=1))

    @property
    def tangent(self) -> Array:
        """Unit tangent just above each node, towards the upper end [-], (n_nodes, 3); zero at no tension."""
        tension = self.tension[:, None]
        return np.asarray(self.force / np.where(tension > 0.0, tension, 1.0))

    @property
    def inclination(self) -> Array:
        """Angle of the tangent above the horizontal [rad], (n_nodes,)."""
        horizontal = np.hypot(self.force[:, 0], self.force[:, 1])
        return np.asarray(np.arctan2(self.force[:, 2], horizontal))

    @property
    def bearing(self) -> Array:
        """Horizontal direction of the tangent, from x towards y [rad], (n_nodes,)."""
        return np.asarray(np.arctan2(self.force[:, 1], self.force[:, 0]))

    @cached_property
    def segment_stiffness(self) -> Array:
        """EA of each segment [N], (n_nodes - 1,)."""
        return np.array([self.line.sections[i].cable.axial_stiffness for i in self.section])

    @property
    def greatest_tension(self) -> Array:
        """Largest tension of each segment [N], (n_nodes - 1,)."""
        below = self.force[:-1] - np.diff(self.arc_length)[:, None] * self.load
        return np.asarray(np.maximum(np.linalg.norm(below, axis=1), self.tension[:-1]))

    @property
    def strain(self) -> Array:
        """Largest strain of each segment [-], (n_nodes - 1,)."""
        strain = self.greatest_tension / self.segment_stiffness
        for index, section in enumerate(self.line.sections):
            if not section.cable.is_hookean:
                its = self.section == index
                strain[its] = static_strain(section.cable, self.greatest_tension[its])
        return np.asarray(strain)

    @property
    def upper_force(self) -> Array:
        """Force of the line on what holds its upper end [N], (3,)."""
        return np.asarray(-self.force[-1])

    @property
    def lower_force(self) -> Array:
        """Force of the line on what holds its lower end, the unit there included [N], (3,)."""
        return np.asarray(self.force[0])

    @property
    def span(self) -> Array:
        """From the lower end to the upper one [m], (3,)."""
        return np.asarray(self.position[-1] - self.position[0])

    def sample(self, arc_length: Array | float) -> tuple[Array, Array]:
        """Position [m] and tension vector [N] at any points, exact within each segment.

        Source: Huang (1992), (2.24) and (2.37)-(2.39).

        Args:
            arc_length: Unstretched distance from the lower end [m], any shape.

        Returns:
            Two arrays with a last axis of length 3.

        Raises:
            ValueError: If a point lies off the line.
        """
        at = np.asarray(arc_length, dtype=float)
        if np.any(at < 0.0) or np.any(at > self.arc_length[-1] * (1.0 + 1e-12)):
            raise ValueError(
                f"arc_length must lie between 0 and {self.arc_length[-1]:g} m, got {arc_length!r}"
            )
        laws = np.array([_law(self.line.sections[i].cable) for i in self.section])
        out = _sample(at.ravel(), self.arc_length, self.position, self.force, self.load, laws)
        return out[:, :3].reshape(*at.shape, 3), out[:, 3:].reshape(*at.shape, 3)


@dataclass(frozen=True, kw_only=True)
class StaticsSolver:
    """Elastic catenaries joined end to end; Newton on all of them at once.

    Exact for any number of segments without drag; with drag, which is held constant over a segment at its
    chord and mid-height, second order in the segment's length. Each Newton step is one banded solve.
    """

    line: Line
    """The line."""
    ends: Ends
    """How its ends are held."""
    current: Current = field(default_factory=Current)
    """The water's velocity, as it is at `time`."""
    time: float = 0.0
    """The instant at which the current's factor is taken [s]."""
    n_segments: int = 100
    """Segments in all; each stretch between section ends and bodies has at least one."""
    tolerance: float = 1e-9
    """Largest residual that counts as an answer, of lengths over the line's, of forces over the greatest
    load [-]. The iteration goes on to rounding; only lines that fold along the current stop before."""

    def __post_init__(self) -> None:
        require_number(self, "time")
        require_integer(self, "n_segments", minimum=1)
        require_number(self, "tolerance", positive=True)
        if isinstance(self.ends, FixedEnds):
            self._require_reach(math.dist(self.ends.lower, self.ends.upper))
        elif isinstance(self.ends, Moored):
            self._require_reach(abs(self.ends.upper_height - self.ends.anchor[2]))
        elif isinstance(self.ends, OnSeabed):
            self._require_reach(abs(self.ends.upper[2] - self.ends.height))
        self._require_load()

    def _require_reach(self, distance: float) -> None:
        """Raises `ValueError` where the ends are farther apart than any such line can be stretched."""
        sections, length = self.line.sections, self.line.length
        if distance <= length:
            return
        softness = sum(section.length / section.cable.axial_stiffness for section in sections)
        taut = (distance - length) / softness
        if not all(section.cable.is_hookean for section in sections):
            taut = _straight_tension(sections, distance - length, taut)
        for section in sections:
            area = 0.25 * math.pi * section.cable.diameter**2
            strain = float(static_strain(section.cable, taut))
            if taut / area > GREATEST_STRESS or strain > GREATEST_STRAIN:
                raise ValueError(
                    f"a line of {length:g} m cannot reach over {distance:g} m: stretched straight it would "
                    f"carry {taut:.3g} N, a strain of {strain:.3g}; bring the ends together or lengthen it"
                )

    def _require_load(self) -> None:
        """Raises `ValueError` for a slack line on which nothing acts: it has no shape of its own."""
        segments, bodies, knots, _ = self._numbers
        weight = np.abs(segments[:, 1]).max() + np.abs(bodies[:, 0]).max()
        moving = np.abs(knots[1:]).max() > 0.0
        drag = moving and segments[:, 2:4].max() + bodies[:, 1].max() > 0.0
        _, _, _, at_upper = self.ends.conditions
        pulled = bool(np.any(self._end_forces))
        taut = isinstance(self.ends, FixedEnds) and math.dist(self.ends.lower, at_upper) > self.line.length
        if not (weight > 0.0 or drag or pulled or taut):
            raise ValueError(
                "a slack line without weight in still water has no shape of its own; give submerged_weight, "
                "a current or a pull"
            )

    @cached_property
    def arc_length(self) -> Array:
        """Unstretched distance of the nodes from the lower end [m], (n_nodes,).

        Section ends and bodies lie on nodes; between them segments are equal.
        """
        ends = np.cumsum([0.0] + [section.length for section in self.line.sections])
        bodies = [attachment.arc_length for attachment in self.line.attachments]
        breaks = np.unique(np.concatenate([ends, bodies]))
        breaks = breaks[np.concatenate([[True], np.diff(breaks) > 1e-9 * self.line.length])]
        shares = np.maximum(1, np.round(self.n_segments * np.diff(breaks) / self.line.length)).astype(int)
        parts = [
            np.linspace(low, high, n + 1)[:-1]
            for low, high, n in zip(breaks[:-1], breaks[1:], shares, strict=True)
        ]
        return np.concatenate([*parts, [self.line.length]])

    @cached_property
    def section(self) -> Array:
        """Which section of the line each segment belongs to, (n_nodes - 1,)."""
        ends = np.cumsum([section.length for section in self.line.sections])
        middle = 0.5 * (self.arc_length[:-1] + self.arc_length[1:])
        return np.minimum(np.searchsorted(ends, middle), len(ends) - 1)

    @cached_property
    def _numbers(self) -> tuple[Array, Array, Array, Array]:
        """What the compiled solver reads, in SI: segments, bodies, current and ends."""
        segments = np.empty((len(self.section), 7))
        segments[:, 0] = np.diff(self.arc_length)
        for row, index in zip(segments, self.section, strict=True):
            cable = self.line.sections[index].cable
            row[1] = cable.submerged_weight
            row[2:4] = cable.normal_drag_per_length, cable.tangential_drag_per_length
            row[4:] = _law(cable)
        bodies = np.zeros((len(self.arc_length), 2))
        for attachment in self.line.attachments:
            node = int(np.argmin(np.abs(self.arc_length - attachment.arc_length)))
            bodies[node] += (attachment.body.submerged_weight, attachment.body.lateral_drag_factor)
        if isinstance(self.ends, Towed | OnSeabed):
            bodies[0] += (self.ends.payload.submerged_weight, self.ends.payload.lateral_drag_factor)
        depth, along_x, along_y = current_knots(self.current)
        velocity = self.ends.velocity if isinstance(self.ends, Towed) else (0.0, 0.0)
        factor = float(current_factor(self.current, self.time))
        knots = np.stack([depth, factor * along_x - velocity[0], factor * along_y - velocity[1]])
        lower_held, lower, upper_held, upper = self.ends.conditions
        ends = np.array([[*lower_held, *lower], [*upper_held, *upper]], dtype=float)
        return segments, bodies, knots, ends

    @cached_property
    def _units(self) -> tuple[float, float]:
        """Length and force that make the equations of order one: the line's, and the greatest load."""
        segments, bodies, knots, _ = self._numbers
        length = float(segments[:, 0].sum())
        speed = float(np.hypot(knots[1], knots[2]).max())
        drag = float((segments[:, 0] * segments[:, 2:4].max(axis=1)).sum() + bodies[:, 1].sum()) * speed**2
        weight = float((segments[:, 0] * np.abs(segments[:, 1])).sum() + np.abs(bodies[:, 0]).sum())
        force = drag + weight + float(np.abs(self._end_forces).sum())
        if isinstance(self.ends, FixedEnds):
            strain = math.dist(self.ends.lower, self.ends.upper) / length - 1.0
            force += max(0.0, strain) * float(segments[:, 4].min())
        return length, force

    @cached_property
    def _end_forces(self) -> Array:
        held_lower, lower, held_upper, upper = self.ends.conditions
        forces = [f for held, f in zip(held_lower + held_upper, lower + upper, strict=True) if not held]
        return np.array(forces or [0.0])

    def solve(self, guess: StaticShape | None = None) -> StaticShape:
        """Finds the shape.

        Args:
            guess: A shape on the same nodes to start from, such as that of a neighbouring current; from
                still water if not given.

        Raises:
            ConvergenceError: If the equations are not met; it names the share of the current that was.
            ValueError: If the guess has other nodes, the water lifts the line out of the sea, or the line
                carries more than any cable bears.
        """
        L, F = self._units
        segments, bodies, knots, ends = (a.copy() for a in self._numbers)
        segments *= np.array([1.0 / L, L / F, L / F, L / F, 1.0 / F, 1.0, 1.0])
        bodies /= F
        knots[0] /= L
        for end in ends:
            end[3:] /= np.where(end[:3] > 0.0, L, F)
        nodes = self._straight(ends) if guess is None else self._from(guess, L, F)
        residual, count, reached = _find(
            nodes, guess is not None, segments, bodies, knots, ends, self.tolerance
        )
        if not residual < self.tolerance:
            raise ConvergenceError(
                f"no static shape was found beyond {reached:.0%} of the current: the line goes slack, folds "
                f"or is blown out; lower the current, lengthen or shorten the line, or take other n_segments",
                residual,
            )
        shape = self._shape(nodes, residual, count, L, F)
        self._require_sane(shape)
        return shape

    def _straight(self, ends: Array) -> Array:
        """Nodes of a straight line to start from, in the solver's units: between the ends, else upright."""
        nodes = np.zeros((len(self.arc_length), 6))
        share = self.arc_length / self.arc_length[-1]
        both = (ends[0, :3] > 0.0) & (ends[1, :3] > 0.0)
        for i in range(3):
            if both[i]:
                nodes[:, i] = ends[0, 3 + i] + share * (ends[1, 3 + i] - ends[0, 3 + i])
            elif ends[0, i] > 0.0:
                nodes[:, i] = ends[0, 3 + i]
            else:
                nodes[:, i] = ends[1, 3 + i]
        if not both[2]:
            nodes[:, 2] += share - 1.0 if ends[1, 2] > 0.0 else share
        return nodes

    def _from(self, guess: StaticShape, L: float, F: float) -> Array:
        if len(guess.arc_length) != len(self.arc_length):
            raise ValueError(
                f"guess must have the solver's {len(self.arc_length)} nodes, got {len(guess.arc_length)}"
            )
        return np.concatenate([guess.position / L, guess.force / F], axis=1)

    def _shape(self, nodes: Array, residual: float, count: int, L: float, F: float) -> StaticShape:
        segments, bodies, knots, _ = self._numbers
        position, force = L * nodes[:, :3], F * nodes[:, 3:]
        x, y = (np.interp(-position[:, 2], knots[0], along) for along in knots[1:])
        drag = bodies[:, 1] * np.hypot(x, y)
        point = np.stack([drag * x, drag * y, -bodies[:, 0]], axis=1)
        load = (force[:-1] - force[1:] - point[1:]) / segments[:, :1]
        return StaticShape(
            line=self.line,
            ends=self.ends,
            current=self.current,
            arc_length=self.arc_length,
            position=position,
            force=force,
            load=load,
            section=self.section,
            residual=residual,
            n_iterations=count,
        )

    def _require_sane(self, shape: StaticShape) -> None:
        """Raises `ValueError` for an answer of the equations that no line in the sea can have."""
        segments, bodies, knots, ends = self._numbers
        held = [end[5] for end in ends if end[2] > 0.0]
        surface = max(0.0, *held) + 1e-6 * self.line.length
        highest = float(shape.position[:, 2].max())
        in_current = np.abs(knots[1:]).max() > 0.0 and segments[:, 2:4].max() + bodies[:, 1].max() > 0.0
        if in_current and highest > surface:
            raise ValueError(
                f"the water lifts the line to {highest - surface:.3g} m above the surface; lower the current "
                "or the speed, or make line and unit heavier"
            )
        diameters = np.array([self.line.sections[i].cable.diameter for i in self.section])
        stress = shape.greatest_tension / (0.25 * math.pi * diameters**2)
        if stress.max() > GREATEST_STRESS or shape.strain.max() > GREATEST_STRAIN:
            raise ValueError(
                f"the line would be stretched by {shape.strain.max():.3g} at {shape.tension.max():.3g} N, "
                "more than any cable bears; lower the current, bring the ends together or lengthen the line"
            )


@dataclass(frozen=True, kw_only=True)
class Footprint:
    """Outer boundary of what a unit on the sea bed reaches, as seen from below its vessel."""

    bearing: Array
    """Directions from below the vessel, from x towards y [rad], (n_bearings,)."""
    reach: Array
    """Farthest horizontal distance [m], (n_bearings,); NaN where the boundary has no point."""
    position: Array
    """Where the unit is then [m], (n_bearings, 3)."""
    thrust_direction: Array
    """Where its thrust then points [rad], (n_bearings,)."""
    top_tension: Array
    """Tension at the vessel then [N], (n_bearings,)."""
    lift: Array
    """Vertical pull of the line on the unit then [N], (n_bearings,): above its weight it lifts off."""
    clearance: Array
    """Height of the line's lowest point above the bed [m], (n_bearings,); negative where the line would lie
    on the bed and the model stops holding."""
    length: Array
    """Unstretched length paid out then [m], (n_bearings,)."""


@dataclass(frozen=True, kw_only=True)
class FootprintSolver:
    """How far a thrust-limited unit on the sea bed gets from its vessel, at every bearing.

    At full thrust, whatever its direction, the unit stands on the boundary of what it can reach at that
    length; at each bearing the direction of the thrust is found that leads there (the farthest, if several
    do). If the vessel may keep cable in, the best length is found too, among those whose line neither lifts
    the unit nor lies on the bed; at one given length both are only reported.

    Source: Huang (1992), (2.16)-(2.17).
    """

    line: Line
    """The line, paid out as far as it goes."""
    payload: Payload
    """The unit."""
    depth: float
    """Depth of the level bed below the upper end [m]."""
    thrust: float
    """Greatest horizontal thrust [N]."""
    current: Current = field(default_factory=Current)
    """The water's velocity; depth counts from the upper end, which is at z = 0."""
    shortest_length: float | None = None
    """Least unstretched length that the vessel may pay out [m]; null: the line's own."""
    n_bearings: int = 36
    """Bearings, evenly around."""
    n_segments: int = 40
    """Segments of the line."""

    def __post_init__(self) -> None:
        require_number(self, "depth", positive=True)
        require_number(self, "thrust", positive=True)
        require_number(self, "shortest_length", positive=True, optional=True)
        require_integer(self, "n_bearings", minimum=3)
        require_integer(self, "n_segments", minimum=1)
        shortest = self.shortest_length
        reaches = shortest is None or (self.depth < shortest <= self.line.length)
        require(reaches, self, "shortest_length", f"from the depth to the line's {self.line.length:g} m")
        require(self.depth < self.line.length, self, "depth", f"less than the line's {self.line.length:g} m")

    def boundary(self, length: float | None = None) -> tuple[Array, list[StaticShape]]:
        """Shapes under full thrust in evenly spaced directions, at one length.

        Args:
            length: Unstretched length [m]; the line's if not given.

        Returns:
            Directions of the thrust [rad], (n_directions,), and the shapes.
        """
        directions = 2.0 * math.pi * np.arange(2 * self.n_bearings) / (2 * self.n_bearings)
        line = self._paid_out(self.line.length if length is None else length)
        shapes: list[StaticShape] = []
        for direction in directions:
            shapes.append(self._shape(line, direction, shapes[-1] if shapes else None))
        return directions, shapes

    def solve(self) -> Footprint:
        """Finds the boundary.

        Raises:
            ConvergenceError: If a shape on the way is not found.
        """
        lengths = [self.line.length]
        if self.shortest_length is not None:
            lengths = list(np.linspace(self.shortest_length, self.line.length, 9))
        bearings = 2.0 * math.pi * np.arange(self.n_bearings) / self.n_bearings
        best = [self._farthest(bearings, length) for length in lengths]
        free = len(lengths) > 1
        reaches = np.array(
            [
                [np.nan if s is None or (free and not self._stands(s)) else _reach(s) for s in row]
                for row in best
            ]
        )
        rows: list[StaticShape | None] = []
        for column, bearing in enumerate(bearings):
            if np.all(np.isnan(reaches[:, column])):
                rows.append(None)
                continue
            at = int(np.nanargmax(reaches[:, column]))
            shape = best[at][column]
            assert shape is not None
            if 0 < at < len(lengths) - 1:
                shape = self._between(bearing, lengths[at - 1], lengths[at + 1], shape)
            rows.append(shape)
        return self._footprint(bearings, rows)

    def _paid_out(self, length: float) -> Line:
        """The line's lower `length`; what is kept in is taken from its upper end."""
        sections, below = [], 0.0
        for section in self.line.sections:
            part = min(section.length, length - below)
            if part > 1e-9 * length:
                sections.append(type(section)(cable=section.cable, length=part))
            below += section.length
        out = tuple(a for a in self.line.attachments if a.arc_length <= length)
        return Line(sections=tuple(sections), attachments=out)

    def _shape(self, line: Line, direction: float, guess: StaticShape | None) -> StaticShape:
        ends = OnSeabed(
            payload=self.payload,
            height=-self.depth,
            thrust=(self.thrust * math.cos(direction), self.thrust * math.sin(direction)),
        )
        solver = StaticsSolver(line=line, ends=ends, current=self.current, n_segments=self.n_segments)
        fits = guess is not None and len(guess.arc_length) == len(solver.arc_length)
        return solver.solve(guess if fits else None)

    def _farthest(self, bearings: Array, length: float) -> list[StaticShape | None]:
        """At each bearing the farthest shape of this length, or None."""
        line = self._paid_out(length)
        directions, shapes = self.boundary(length)
        places = np.array([shape.position[0, :2] for shape in shapes])
        found: list[StaticShape | None] = []
        for bearing in bearings:
            across = places @ np.array([-math.sin(bearing), math.cos(bearing)])
            along = places @ np.array([math.cos(bearing), math.sin(bearing)])
            following = np.roll(across, -1)
            crossings = np.flatnonzero((across * following <= 0.0) & (across != following))
            farthest: StaticShape | None = None
            for at in crossings:
                if max(along[at], np.roll(along, -1)[at]) <= 0.0:
                    continue
                low, gap = directions[at], directions[1]
                shape = self._at_bearing(line, bearing, low, low + gap, shapes[at])
                if farthest is None or _reach(shape) > _reach(farthest):
                    farthest = shape
            found.append(farthest)
        return found

    def _at_bearing(
        self, line: Line, bearing: float, low: float, high: float, guess: StaticShape
    ) -> StaticShape:
        """The shape on this bearing between two directions of the thrust that enclose it."""
        shape = guess

        def across(direction: float) -> float:
            nonlocal shape
            shape = self._shape(line, direction, shape)
            x, y = shape.position[0, :2]
            return float(y * math.cos(bearing) - x * math.sin(bearing))

        of_low, of_high = across(low), across(high)
        for _ in range(30):
            if of_low == of_high:
                break
            direction = low - of_low * (high - low) / (of_high - of_low)
            here = across(direction)
            if abs(here) < 1e-9 * self.line.length:
                break
            # Illinois: the end that stays loses half its value, so that the other comes nearer.
            if here * of_high < 0.0:
                low, of_low = high, of_high
            else:
                of_low *= 0.5
            high, of_high = direction, here
        return shape

    def _near(self, bearing: float, length: float, shape: StaticShape) -> StaticShape | None:
        """The shape on a bearing at another length, its thrust turned little from that of `shape`."""
        line = self._paid_out(length)
        assert isinstance(shape.ends, OnSeabed)
        middle, width = math.atan2(shape.ends.thrust[1], shape.ends.thrust[0]), 0.02
        away = np.array([-math.sin(bearing), math.cos(bearing)])
        while width < 0.7:
            low, high = (self._shape(line, middle + turn, shape) for turn in (-width, width))
            if float(low.position[0, :2] @ away) * float(high.position[0, :2] @ away) <= 0.0:
                return self._at_bearing(line, bearing, middle - width, middle + width, low)
            width *= 3.0
        return None

    def _stands(self, shape: StaticShape) -> bool:
        """Whether the unit stays on the bed and the line off it."""
        clearance = shape.position[:, 2].min() + self.depth
        lifted = shape.force[0, 2] > self.payload.submerged_weight
        return bool(clearance > -1e-6 * self.line.length and not lifted)

    def _between(self, bearing: float, low: float, high: float, shape: StaticShape) -> StaticShape:
        """The farthest shape on a bearing over lengths between two, by golden section."""
        golden = 0.5 * (math.sqrt(5.0) - 1.0)
        best = shape

        def reach(length: float) -> float:
            nonlocal best
            found = self._near(bearing, length, best)
            if found is None or not self._stands(found):
                return -math.inf
            best = found if _reach(found) > _reach(best) else best
            return _reach(found)

        inner, outer = high - golden * (high - low), low + golden * (high - low)
        of_inner, of_outer = reach(inner), reach(outer)
        for _ in range(8):
            if of_inner < of_outer:
                low, inner, of_inner = inner, outer, of_outer
                outer = low + golden * (high - low)
                of_outer = reach(outer)
            else:
                high, outer, of_outer = outer, inner, of_inner
                inner = high - golden * (high - low)
                of_inner = reach(inner)
        return best

    def _footprint(self, bearings: Array, shapes: list[StaticShape | None]) -> Footprint:
        n = len(bearings)
        position, numbers = np.full((n, 3), np.nan), np.full((6, n), np.nan)
        for i, shape in enumerate(shapes):
            if shape is None:
                continue
            position[i] = shape.position[0]
            assert isinstance(shape.ends, OnSeabed)
            numbers[:, i] = (
                _reach(shape),
                math.atan2(shape.ends.thrust[1], shape.ends.thrust[0]),
                shape.tension[-1],
                shape.force[0, 2],
                shape.position[:, 2].min() + self.depth,
                shape.arc_length[-1],
            )
        return Footprint(
            bearing=bearings,
            reach=numbers[0],
            position=position,
            thrust_direction=numbers[1],
            top_tension=numbers[2],
            lift=numbers[3],
            clearance=numbers[4],
            length=numbers[5],
        )


def _reach(shape: StaticShape) -> float:
    return float(math.hypot(shape.position[0, 0], shape.position[0, 1]))
