"""Single sagged span between two supports, fixed or moving, in displacements from its static catenary.

s is the unstretched arc length from the lower support (s = 0, at the origin) to the upper one (s = S, at
(span, 0, height)); r0(s) is the elastic catenary in still water, u(s, t) what the cable has moved from it,
r = r0 + u, g = ∂r/∂s:

    (m + m_a t tᵀ + C_M ρ π d²/4 (I - t tᵀ)) u_tt = ∂/∂s (N g - N0 g0) + f_drag + f,   N0 g0 at rest
    tension law   N = T(|g| - 1) / |g|,  the cable's own law, or
                  N = N0 + EA ε,  ε = g0·u_s + |u_s|²/2, the quadratic strain of Moustafa's (2)
    supports      u(0) and u(S) given

Source: Moustafa (2001), (2) and (5)-(8), with what print lost put right: in (8a) the last term is H ∂u/∂x
where v is printed; (8c) lacks the brackets that close its braces; (7) projects loads by the horizontal
∂(x + u)/∂s, ours are per unstretched length, like mass and drag everywhere in the project. His s is the arc
length of the static shape, which differs from ours by the static strain. Drag and added mass across the
cable, which his equations leave to the load F, stand as in Huang (1992), (2.46)-(2.47) and chapter 5.

The two laws differ by the square of the strain: nothing for a wire, some per cent for a stretchy rope, for
which the cable's own law is right. The catenary is that of still water; a current begins from there. Bending
and torsion are left out, so a slack element folds freely; a cable that lies on the bottom, or meets itself,
is beyond the model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numba import njit
from scipy.linalg import eigh

from heave_env.cable.catenary import Catenary, hanging_span
from heave_env.cable.constitutive import mean_tension, require_hookean
from heave_env.cable.convergence import ConvergenceError
from heave_env.compiled import source_fingerprint, stage
from heave_env.hydrodynamics import (
    between_knots,
    current_factor,
    current_knots,
    line_drag,
    line_drag_slopes,
)
from heave_env.parameters import Cable, Current, require, require_integer, require_number

Array = np.ndarray

STRAINS = ("engineering", "moustafa")
"""Laws of strain that `SaggedSpanSolver.strain` knows."""
_MOST_ITERATIONS = 30
_MOST_HALVINGS = 10

# What a march records of each step.
_LOWER, _UPPER, _LEAST, _MOST, _SLACK = 0, 1, 2, 3, 4
_MIDDLE, _MIDDLE_VELOCITY, _MIDDLE_ACCELERATION = 5, 8, 11
_N_RECORDED = 14


@stage
def _element_force(before, after, static_force, static_stretch, EA, CA, per_dt, tension_only, quadratic):
    """Mean force of an element over a step, N ḡ, and what its tangent matrix takes.

    `before` and `after` are g = ∂r/∂s at both ends of the step. The force is a discrete gradient of the
    element's energy: N ḡ·(g1 - g0) is the gain of energy, for either law of strain. Returns N, ḡ as three
    numbers, and ∂N/∂g1 as three numbers.
    """
    ax, ay, az = before
    bx, by, bz = after
    old_square, new_square = ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz
    gx, gy, gz = 0.5 * (ax + bx), 0.5 * (ay + by), 0.5 * (az + bz)
    if quadratic:
        initial = static_force / EA
        square = static_stretch * static_stretch
        old, new = initial + 0.5 * (old_square - square), initial + 0.5 * (new_square - square)
        mean, slope = mean_tension(old, new, EA, CA, per_dt, tension_only)
        return mean, gx, gy, gz, slope * bx, slope * by, slope * bz
    old_stretch, new_stretch = old_square**0.5, new_square**0.5
    mean, slope = mean_tension(old_stretch - 1.0, new_stretch - 1.0, EA, CA, per_dt, tension_only)
    # An element folded to nothing carries no tension; the floor keeps the division from saying otherwise.
    stretch = max(0.5 * (old_stretch + new_stretch), 1e-6)
    N = mean / stretch
    along = (slope - 0.5 * N) / (stretch * max(new_stretch, 1e-6))
    return N, gx, gy, gz, along * bx, along * by, along * bz


@stage
def _invert(m, out):
    """Inverse of a 3 x 3 matrix."""
    a, b, c = m[0, 0], m[0, 1], m[0, 2]
    d, e, f = m[1, 0], m[1, 1], m[1, 2]
    g, h, i = m[2, 0], m[2, 1], m[2, 2]
    A, B, C = e * i - f * h, f * g - d * i, d * h - e * g
    per = 1.0 / (a * A + b * B + c * C)
    out[0, 0], out[1, 0], out[2, 0] = A * per, B * per, C * per
    out[0, 1], out[1, 1], out[2, 1] = (c * h - b * i) * per, (a * i - c * g) * per, (b * g - a * h) * per
    out[0, 2], out[1, 2], out[2, 2] = (b * f - c * e) * per, (c * d - a * f) * per, (a * e - b * d) * per


@stage
def _gradient(static, displacement, j, per_spacing):
    """Gradient of the position along element j: that at rest and what the displacement adds."""
    return (
        static[j, 0] + (displacement[j + 1, 0] - displacement[j, 0]) * per_spacing,
        static[j, 1] + (displacement[j + 1, 1] - displacement[j, 1]) * per_spacing,
        static[j, 2] + (displacement[j + 1, 2] - displacement[j, 2]) * per_spacing,
    )


@stage
def _span_step(u, v, new, static, numbers, water, load, dt, work, tension):
    """Finds the displacements at the end of a step, `new`, whose end rows are given.

    Returns how many iterations it took, or minus that many if they did not settle, and the last correction
    [m]. `tension` gets the mean tension of each element over the step.
    """
    gradient, force, stretch = static
    spacing, EA, CA, mass, added, of_normal, of_tangent, tension_only, quadratic = numbers
    knots, along_x, along_y, factor, depth = water
    slope, mean, along, upper, right, block, inverse = work
    n = len(u) - 1
    per_dt, per_spacing = 1.0 / dt, 1.0 / spacing
    for i in range(1, n):
        for c in range(3):
            new[i, c] = u[i, c] + dt * v[i, c]
    correction = 0.0
    for iteration in range(_MOST_ITERATIONS):
        for j in range(n):
            before = _gradient(gradient, u, j, per_spacing)
            after = _gradient(gradient, new, j, per_spacing)
            N, gx, gy, gz, nx, ny, nz = _element_force(
                before, after, force[j, 3], stretch[j], EA, CA, per_dt, tension_only, quadratic
            )
            tension[j] = N
            mean[j, 0], mean[j, 1], mean[j, 2] = gx, gy, gz
            along[j, 0], along[j, 1], along[j, 2] = nx, ny, nz
        for c in range(3):
            right[0, c] = 0.0
            for d in range(3):
                upper[0, c, d] = 0.0
        for i in range(1, n):
            tx, ty, tz = (
                mean[i - 1, 0] + mean[i, 0],
                mean[i - 1, 1] + mean[i, 1],
                mean[i - 1, 2] + mean[i, 2],
            )
            size = (tx * tx + ty * ty + tz * tz) ** 0.5
            per_size = 1.0 / size if size > 1e-12 else 0.0
            t = (tx * per_size, ty * per_size, tz * per_size)
            speed = (
                (new[i, 0] - u[i, 0]) * per_dt,
                (new[i, 1] - u[i, 1]) * per_dt,
                (new[i, 2] - u[i, 2]) * per_dt,
            )
            below = depth[i] - 0.5 * (u[i, 2] + new[i, 2])
            water_x = factor * between_knots(below, knots, along_x) - speed[0]
            water_y = factor * between_knots(below, knots, along_y) - speed[1]
            args = (water_x, water_y, -speed[2], t[0], t[1], t[2], of_normal, of_tangent)
            drag = line_drag(*args)
            xx, xy, xz, yy, yz, zz = line_drag_slopes(*args)
            slope[0, 0], slope[0, 1], slope[0, 2] = xx, xy, xz
            slope[1, 0], slope[1, 1], slope[1, 2] = xy, yy, yz
            slope[2, 0], slope[2, 1], slope[2, 2] = xz, yz, zz
            gained = (
                2.0 * (speed[0] - v[i, 0]) * per_dt,
                2.0 * (speed[1] - v[i, 1]) * per_dt,
                2.0 * (speed[2] - v[i, 2]) * per_dt,
            )
            gained_along = gained[0] * t[0] + gained[1] * t[1] + gained[2] * t[2]
            for c in range(3):
                pull = (tension[i] * mean[i, c] - force[i, c]) - (
                    tension[i - 1] * mean[i - 1, c] - force[i - 1, c]
                )
                inertia = (mass + added) * gained[c] - added * gained_along * t[c]
                right[i, c] = pull + spacing * (drag[c] + load[c] - inertia)
                for d in range(3):
                    same = 1.0 if c == d else 0.0
                    of_inertia = 2.0 * per_dt * per_dt * ((mass + added) * same - added * t[c] * t[d])
                    block[c, d] = (
                        spacing * (of_inertia + per_dt * slope[c, d])
                        + per_spacing * (mean[i, c] * along[i, d] + mean[i - 1, c] * along[i - 1, d])
                        + 0.5 * per_spacing * (tension[i] + tension[i - 1]) * same
                    )
            # Eliminate the block of the node below: its coupling is minus the element's tangent matrix.
            for c in range(3):
                for e in range(3):
                    same = 1.0 if c == e else 0.0
                    coupling = -per_spacing * (mean[i - 1, c] * along[i - 1, e] + 0.5 * tension[i - 1] * same)
                    right[i, c] -= coupling * right[i - 1, e]
                    for d in range(3):
                        block[c, d] -= coupling * upper[i - 1, e, d]
            _invert(block, inverse)
            r0, r1, r2 = right[i, 0], right[i, 1], right[i, 2]
            for c in range(3):
                right[i, c] = inverse[c, 0] * r0 + inverse[c, 1] * r1 + inverse[c, 2] * r2
                across = inverse[c, 0] * mean[i, 0] + inverse[c, 1] * mean[i, 1] + inverse[c, 2] * mean[i, 2]
                for d in range(3):
                    upper[i, c, d] = -per_spacing * (across * along[i, d] + 0.5 * tension[i] * inverse[c, d])
        correction = 0.0
        right[n, 0], right[n, 1], right[n, 2] = 0.0, 0.0, 0.0
        for i in range(n - 1, 0, -1):
            for c in range(3):
                value = right[i, c]
                for d in range(3):
                    value -= upper[i, c, d] * right[i + 1, d]
                right[i, c] = value
            for c in range(3):
                new[i, c] += right[i, c]
                size = abs(right[i, c])
                # Written so that a number that is none does not pass for a small one.
                correction = correction if size <= correction else size
        if correction <= 1e-10 * spacing:
            break
        if not correction < 1e6 * spacing:
            return -(iteration + 1), correction
    settled = correction <= 1e-10 * spacing
    for j in range(n):
        before = _gradient(gradient, u, j, per_spacing)
        after = _gradient(gradient, new, j, per_spacing)
        N, gx, gy, gz, _, _, _ = _element_force(
            before, after, force[j, 3], stretch[j], EA, CA, per_dt, tension_only, quadratic
        )
        tension[j] = N * (gx * gx + gy * gy + gz * gz) ** 0.5
    return (iteration + 1 if settled else -(iteration + 1)), correction


@stage
def _end_tensions(tension, static_tension, static_ends, tension_only):
    """Tensions at both ends: the change from rest, extrapolated from the two elements nearest."""
    n = len(tension)
    lower = static_ends[0] + 1.5 * (tension[0] - static_tension[0]) - 0.5 * (tension[1] - static_tension[1])
    upper = (
        static_ends[1]
        + 1.5 * (tension[n - 1] - static_tension[n - 1])
        - 0.5 * (tension[n - 2] - static_tension[n - 2])
    )
    if tension_only:
        lower = max(lower, 0.0) if tension[0] > 0.0 else 0.0
        upper = max(upper, 0.0) if tension[n - 1] > 0.0 else 0.0
    return lower, upper


def _make_march(fingerprint: int):
    @njit(cache=True, error_model="numpy")
    def march(u, v, tension, static, numbers, current, factor, motion, load, dt, every, out, shapes):
        """Drives a span through given motions of its supports.

        `u`, `v` and `tension` are read and rewritten. `out` gets a row per instant, `shapes` the
        displacements at every so many instants. Returns the step at which it failed, or -1, and the last
        correction [m].
        """
        if fingerprint == 0:
            return -1, 0.0
        n = len(u) - 1
        middle = n // 2
        tension_only = numbers[7]
        lower, upper = motion
        knots, along_x, along_y, depth = current
        gradient, force, stretch, static_ends = static
        bodies = (gradient, force, stretch)
        work = (
            np.empty((3, 3)),
            np.empty((n, 3)),
            np.empty((n, 3)),
            np.empty((n + 1, 3, 3)),
            np.empty((n + 1, 3)),
            np.empty((3, 3)),
            np.empty((3, 3)),
        )
        new, trial, speed, mean = np.empty((n + 1, 3)), u.copy(), v.copy(), tension.copy()
        for k in range(len(out)):
            for c in range(3):
                out[k, _MIDDLE_ACCELERATION + c] = 0.0
            if k > 0:
                n_parts = 1
                while True:
                    # The whole step, or so many equal parts of it with the supports moving evenly.
                    trial[:], speed[:], tension[:] = u, v, 0.0
                    settled, correction = True, 0.0
                    part = dt / n_parts
                    for p in range(n_parts):
                        share = (p + 1.0) / n_parts
                        for c in range(3):
                            new[0, c] = lower[k - 1, c] + share * (lower[k, c] - lower[k - 1, c])
                            new[n, c] = upper[k - 1, c] + share * (upper[k, c] - upper[k - 1, c])
                        water = (knots, along_x, along_y, factor[k - 1], depth)
                        count, correction = _span_step(
                            trial, speed, new, bodies, numbers, water, load[k - 1], part, work, mean
                        )
                        if count < 0:
                            settled = False
                            break
                        for i in range(n + 1):
                            for c in range(3):
                                rate = (new[i, c] - trial[i, c]) / part
                                speed[i, c] = rate if i == 0 or i == n else 2.0 * rate - speed[i, c]
                                trial[i, c] = new[i, c]
                        for j in range(n):
                            tension[j] += mean[j] / n_parts
                    if settled:
                        break
                    n_parts *= 2
                    if n_parts > 2**_MOST_HALVINGS:
                        return k, correction
                for c in range(3):
                    out[k, _MIDDLE_ACCELERATION + c] = (speed[middle, c] - v[middle, c]) / dt
                u[:], v[:] = trial, speed
            out[k, _LOWER], out[k, _UPPER] = _end_tensions(tension, force[:, 4], static_ends, tension_only)
            least, most, n_slack = min(out[k, 0], out[k, 1]), max(out[k, 0], out[k, 1]), 0
            for j in range(n):
                least, most = min(least, tension[j]), max(most, tension[j])
                n_slack += 1 if tension[j] <= 0.0 else 0
            out[k, _LEAST], out[k, _MOST], out[k, _SLACK] = least, most, n_slack / n
            for c in range(3):
                out[k, _MIDDLE + c] = u[middle, c]
                out[k, _MIDDLE_VELOCITY + c] = v[middle, c]
            if every > 0 and k % every == 0:
                shapes[k // every] = u
        return -1, 0.0

    return march


_march = _make_march(source_fingerprint())


@dataclass(frozen=True, eq=False)
class SpanState:
    """A span at an instant: a value that copies and compares."""

    displacement: Array = field(repr=False)
    """Displacement of each node from the catenary [m], (n_elements + 1, 3)."""
    velocity: Array = field(repr=False)
    """Velocity of each node [m/s], (n_elements + 1, 3); of the supports, the mean over the last step."""
    tension: Array = field(repr=False)
    """Tension of each element, the mean over the last step [N], (n_elements,)."""
    time: float = 0.0
    """The instant, for a current that varies [s]."""

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, SpanState):
            return NotImplemented
        pairs = (
            (getattr(self, name), getattr(other, name)) for name in ("displacement", "velocity", "tension")
        )
        return self.time == other.time and all(np.array_equal(a, b) for a, b in pairs)

    __hash__ = None  # type: ignore[assignment]


@dataclass(frozen=True)
class SpanRecord:
    """What a march of a span recorded; the first axis is time, (n_steps + 1, ...).

    Tensions are means over the step that ends at their instant.
    """

    time: Array
    """Instants [s]."""
    lower_tension: Array
    """Tension at the lower support [N]."""
    upper_tension: Array
    """Tension at the upper support [N]."""
    tension_min: Array
    """Smallest tension along the span [N]."""
    tension_max: Array
    """Largest tension along the span [N]."""
    slack_fraction: Array
    """Share of the length without tension [-]."""
    midpoint_displacement: Array
    """Displacement of the middle node from rest [m], (n_steps + 1, 3)."""
    midpoint_velocity: Array
    """Its velocity [m/s], (n_steps + 1, 3)."""
    midpoint_acceleration: Array
    """Its acceleration, the mean over the step [m/s²], (n_steps + 1, 3)."""
    shape_time: Array
    """Instants at which the shape was kept [s], (n_shapes,)."""
    shapes: Array = field(repr=False)
    """Positions of the nodes there [m], (n_shapes, n_elements + 1, 3)."""
    state: SpanState
    """The last instant, to go on from."""


@dataclass(frozen=True, kw_only=True)
class SaggedSpanSolver:
    """A sagged span on a grid of equal unstretched elements, its supports fixed or driven.

    Implicit midpoint rule with a discrete-gradient tension: second order in time and space, unconditionally
    stable, and without drag or Kelvin damping it keeps energy to the accuracy of Newton's iteration, slack
    and snap included, as long as no mass is added across the cable. Each iteration is one block-tridiagonal
    elimination of 3 x 3 blocks. A step that does not settle is halved, up to ten times. Static shape, static
    tension and weight are those of the exact catenary, so that rest is rest on any grid.

    A cable with `tension_only` wants Kelvin damping (C_A = EA times some milliseconds): undamped, the axial
    waves of a snap, which no practical step resolves, ring on the grid for ever.
    """

    cable: Cable
    length: float
    """Unstretched length, S [m]."""
    span: float
    """Horizontal distance of the supports [m]."""
    height: float = 0.0
    """Upper above lower support [m]."""
    n_elements: int = 50
    """An even number, so that a node stands in the middle [-]."""
    lower_depth: float = 0.0
    """Depth of the lower support, for the current's profile [m]."""
    current: Current | None = None
    """Current, x along the span from the lower support; null: still water. The static shape does not feel
    it: let its factor rise from zero."""
    strain: str = "engineering"
    """`engineering`, the cable's own law, or `moustafa`, the quadratic strain of the source."""

    def __post_init__(self) -> None:
        require_number(self, "length", positive=True)
        require_number(self, "span", positive=True)
        require_number(self, "height", non_negative=True)
        require_number(self, "lower_depth")
        require_integer(self, "n_elements", minimum=4)
        require(self.n_elements % 2 == 0, self, "n_elements", "even, so that a node stands in the middle")
        require(self.strain in STRAINS, self, "strain", f"one of {', '.join(STRAINS)}")
        require_hookean(self.cable)
        require_number(self.cable, "mass_per_length", positive=True)
        assert self.catenary.horizontal_force > 0.0

    @cached_property
    def catenary(self) -> Catenary:
        """The static shape in still water."""
        return hanging_span(self.cable, self.length, self.span, self.height)

    @cached_property
    def arc_length(self) -> Array:
        """Unstretched arc length of the nodes from the lower support [m], (n_elements + 1,)."""
        return np.linspace(0.0, self.length, self.n_elements + 1)

    @cached_property
    def rest_position(self) -> Array:
        """Positions of the nodes at rest from the lower support [m], (n_elements + 1, 3)."""
        nodes = self.catenary.position(self.arc_length)
        nodes[0], nodes[-1] = 0.0, (self.span, 0.0, self.height)
        return nodes

    @property
    def spacing(self) -> float:
        """Unstretched length of an element [m]."""
        return self.length / self.n_elements

    @property
    def _inertias(self) -> tuple[float, float]:
        """Inertia per length in every direction, and what comes to it across the cable [kg/m]."""
        along = self.cable.inertia_per_length
        return along, self.cable.transverse_inertia_per_length - along

    @cached_property
    def _static(self) -> tuple[Array, Array, Array, Array]:
        """∂r0/∂s, force with N0 and tension, stretch at the elements' middles; tensions at the ends."""
        middles = 0.5 * (self.arc_length[:-1] + self.arc_length[1:])
        tension = self.catenary.tension(middles)
        stretch = 1.0 + tension / self.cable.axial_stiffness
        force = np.column_stack([self.catenary.force(middles), tension / stretch, tension])
        ends = self.catenary.tension(np.array([0.0, self.length]))
        return self.catenary.tangent(middles), force, stretch, ends

    def rest(self) -> SpanState:
        """Hanging still in still water between supports where they belong."""
        zero = np.zeros((self.n_elements + 1, 3))
        return SpanState(zero, zero.copy(), self._static[1][:, 4].copy())

    def step(self, state: SpanState, top: Array, dt: float, *, lower: Array | None = None) -> SpanState:
        """Advances by `dt` [s].

        Args:
            state: The instant to go on from.
            top: Displacement of the upper support from its place at the end of the step [m], (3,).
            dt: Time step [s].
            lower: Displacement of the lower support there [m], (3,); it stays where it is if not given.

        Raises:
            ConvergenceError: If the step does not settle even when halved.
        """
        at_rest = state.displacement[0] if lower is None else lower
        ends = [
            np.stack([before, np.asarray(after, dtype=float)])
            for before, after in ((state.displacement[0], at_rest), (state.displacement[-1], top))
        ]
        return self.simulate(*ends, dt=dt, state=state).state

    def top_tension(self, state: SpanState) -> float:
        """Tension at the upper support, the mean over the last step [N]."""
        static, tensions = self._static, state.tension
        return float(_end_tensions(tensions, static[1][:, 4], static[3], self.cable.tension_only)[1])

    def payload_motion(self, state: SpanState) -> tuple[Array, Array]:
        """Displacement from rest [m] and velocity [m/s] of the span's middle, (3,); it has no payload."""
        middle = self.n_elements // 2
        return state.displacement[middle].copy(), state.velocity[middle].copy()

    def position(self, state: SpanState) -> Array:
        """Positions of the nodes from the lower support's place [m], (n_elements + 1, 3)."""
        return self.rest_position + state.displacement

    def simulate(
        self,
        lower: Array | None = None,
        upper: Array | None = None,
        *,
        dt: float,
        state: SpanState | None = None,
        load: Array | None = None,
        shape_every: int = 0,
    ) -> SpanRecord:
        """Marches through given motions of the supports.

        Args:
            lower: Displacement of the lower support at each instant [m], (n_steps + 1, 3), or
                (n_steps + 1,) if it moves horizontally along the span; fixed if not given.
            upper: The same of the upper support; one of the two must be given, zeros if need be.
            dt: Time step [s].
            state: Where to begin, rest if not given; the motions must begin where its supports are.
            load: Further load per unstretched length at each instant [N/m], (n_steps + 1, 3), the same
                along the span.
            shape_every: Keep the shape at every so many steps; 0 keeps none.

        Returns:
            The record, at every instant from the start.

        Raises:
            ValueError: If the motions do not fit each other or the state.
            ConvergenceError: If a step does not settle even when halved.
        """
        if not (dt > 0.0 and math.isfinite(dt)):
            raise ValueError(f"dt must be a positive number [s], got {dt!r}")
        start = self.rest() if state is None else state
        motion = self._motions(start, lower, upper)
        n_steps = len(motion[0]) - 1
        loads = np.zeros((n_steps + 1, 3)) if load is None else _rows("load", load, n_steps + 1)
        u, v, tension = start.displacement.copy(), start.velocity.copy(), start.tension.copy()
        if u.shape != (self.n_elements + 1, 3):
            raise ValueError(
                f"state must be of a span of {self.n_elements} elements, got one of {len(u) - 1}; begin from "
                "rest() of this solver"
            )
        current = Current() if self.current is None else self.current
        time = start.time + dt * np.arange(n_steps + 1)
        cable = self.cable
        numbers = (
            self.spacing,
            cable.axial_stiffness,
            cable.axial_damping,
            *self._inertias,
            cable.normal_drag_per_length,
            cable.tangential_drag_per_length,
            cable.tension_only,
            self.strain == "moustafa",
        )
        out = np.empty((n_steps + 1, _N_RECORDED))
        shapes = np.empty((n_steps // shape_every + 1 if shape_every > 0 else 0, len(u), 3))
        failed, correction = _march(
            u,
            v,
            tension,
            self._static,
            numbers,
            (*current_knots(current), self.lower_depth - self.rest_position[:, 2]),
            current_factor(current, time[:-1] + 0.5 * dt),
            motion,
            0.5 * (loads[:-1] + loads[1:]),
            dt,
            shape_every,
            out,
            shapes,
        )
        if failed >= 0:
            raise ConvergenceError(
                f"the step to t = {time[failed]:.6g} s of the sagged span does not settle, even in "
                f"{2**_MOST_HALVINGS} parts; the last correction was so many metres. The likely cause is a "
                "snap of a cable without axial_damping, or a support that jumps: damp or smooth it",
                correction,
            )
        return SpanRecord(
            time=time,
            lower_tension=out[:, _LOWER],
            upper_tension=out[:, _UPPER],
            tension_min=out[:, _LEAST],
            tension_max=out[:, _MOST],
            slack_fraction=out[:, _SLACK],
            midpoint_displacement=out[:, _MIDDLE : _MIDDLE + 3],
            midpoint_velocity=out[:, _MIDDLE_VELOCITY : _MIDDLE_VELOCITY + 3],
            midpoint_acceleration=out[:, _MIDDLE_ACCELERATION : _MIDDLE_ACCELERATION + 3],
            shape_time=time[::shape_every] if shape_every > 0 else time[:0],
            shapes=shapes + self.rest_position,
            state=SpanState(u, v, tension, float(time[-1])),
        )

    def _motions(self, state: SpanState, lower: Array | None, upper: Array | None) -> tuple[Array, Array]:
        given = [motion for motion in (lower, upper) if motion is not None]
        if not given:
            raise ValueError("the motion of at least one support must be given; zeros leave it fixed")
        n_rows = len(np.atleast_1d(given[0]))
        ends = []
        for name, motion, at in (
            ("lower", lower, state.displacement[0]),
            ("upper", upper, state.displacement[-1]),
        ):
            rows = np.tile(at, (n_rows, 1)) if motion is None else _rows(name, motion, n_rows)
            if float(np.abs(rows[0] - at).max()) > 1e-9 * self.length:
                raise ValueError(
                    f"{name} must begin where the state's support is, at {at.tolist()} m, got "
                    f"{rows[0].tolist()}"
                )
            ends.append(rows)
        return ends[0], ends[1]

    def energy(self, state: SpanState) -> float:
        """Kinetic energy of the nodes between the supports plus stored energy of cable and weight [J].

        Added mass counts with its motion across the cable. Of the stored energy, zero is an unstretched
        cable at the heights of rest.
        """
        gradient, force, stretch, _ = self._static
        u, v, cable = state.displacement, state.velocity, self.cable
        g = gradient + np.diff(u, axis=0) / self.spacing
        if self.strain == "moustafa":
            square = np.sum(g * g, axis=1)
            strain = force[:, 3] / cable.axial_stiffness + 0.5 * (square - stretch**2)
        else:
            strain = np.linalg.norm(g, axis=1) - 1.0
        taut = np.maximum(strain, 0.0) if cable.tension_only else strain
        t = g[:-1] + g[1:]
        t /= np.maximum(np.linalg.norm(t, axis=1, keepdims=True), 1e-12)
        inner = v[1:-1]
        across = np.sum(inner**2, axis=1) - np.sum(inner * t, axis=1) ** 2
        mass, added = self._inertias
        kinetic = mass * np.sum(inner**2) + added * across.sum()
        stored = 0.5 * cable.axial_stiffness * np.sum(taut**2) + cable.submerged_weight * np.sum(u[1:-1, 2])
        return float(self.spacing * (0.5 * kinetic + stored))

    @cached_property
    def _linear(self) -> tuple[Array, Array, Array]:
        """Stiffness of the inner nodes, their mass, and the tangent matrices of the elements over l."""
        gradient, force, stretch, _ = self._static
        n, cable, eye = self.n_elements, self.cable, np.eye(3)
        t = gradient / stretch[:, None]
        N, EA = force[:, 3], cable.axial_stiffness
        axial = EA * stretch**2 if self.strain == "moustafa" else EA - N
        elements = N[:, None, None] * eye + axial[:, None, None] * t[:, :, None] * t[:, None, :]
        elements = elements / self.spacing
        K, M = np.zeros((n - 1, 3, n - 1, 3)), np.zeros((n - 1, 3, n - 1, 3))
        along = t[:-1] + t[1:]
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        mass, added = self._inertias
        for i in range(n - 1):
            K[i, :, i] = elements[i] + elements[i + 1]
            M[i, :, i] = self.spacing * ((mass + added) * eye - added * np.outer(along[i], along[i]))
            if i > 0:
                K[i, :, i - 1] = K[i - 1, :, i] = -elements[i]
        size = 3 * (n - 1)
        return K.reshape(size, size), M.reshape(size, size), elements

    def modes(self, n_modes: int) -> tuple[Array, Array]:
        """Natural frequencies and mode shapes of small motions about rest, without damping.

        Returns:
            ω [rad/s], (n_modes,), rising; shapes of unit largest displacement [-],
            (n_modes, n_elements + 1, 3), modes along y (out of the plane) among them.
        """
        K, M, _ = self._linear
        if not 1 <= n_modes <= len(K):
            raise ValueError(f"n_modes must be from 1 to {len(K)} on this grid, got {n_modes!r}")
        squares, vectors = eigh(K, M, subset_by_index=(0, n_modes - 1))
        shapes = np.zeros((n_modes, self.n_elements + 1, 3))
        shapes[:, 1:-1] = vectors.T.reshape(n_modes, -1, 3)
        shapes /= np.abs(shapes).max(axis=(1, 2), keepdims=True)
        return np.sqrt(np.maximum(squares, 0.0)), shapes

    def linear_tension(self, omega: float, upper: Array) -> complex:
        """Amplitude of the upper support's tension under a small harmonic motion of it, without damping [N].

        Args:
            omega: Angular frequency [rad/s].
            upper: Amplitude of the upper support's motion [m], (3,).
        """
        K, M, elements = self._linear
        moved = np.asarray(upper, dtype=float)
        pull = np.zeros(len(K))
        pull[-3:] = elements[-1] @ moved
        u = np.linalg.solve(K - omega**2 * M, pull).reshape(-1, 3)
        gradient, _, stretch, _ = self._static
        t = gradient / stretch[:, None]
        EA = self.cable.axial_stiffness
        last = EA * t[-1] @ (moved - u[-1]) / self.spacing
        before = EA * t[-2] @ (u[-1] - u[-2]) / self.spacing
        return complex(1.5 * last - 0.5 * before)


def _rows(name: str, values: Array, n_rows: int) -> Array:
    """A motion or a load as three components, (n_rows, 3)."""
    rows = np.asarray(values, dtype=float)
    if rows.ndim == 1:
        rows = np.stack([rows, 0.0 * rows, 0.0 * rows], axis=-1)
    if rows.shape != (n_rows, 3):
        raise ValueError(f"{name} must have the shape ({n_rows}, 3) or ({n_rows},), got {np.shape(values)}")
    if not np.all(np.isfinite(rows)):
        raise ValueError(f"{name} must hold finite numbers; look for NaN or infinity in it")
    return np.ascontiguousarray(rows)
