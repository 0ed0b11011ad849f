"""Waves on a line, and its natural modes about a static shape.

Small motion r1 about the shape r0, tangent t, tension T, strain e = T/EA (Huang 1992, (12.25)-(12.28), in
vectors):

    (m + m_a) ∂²r1/∂t² = ∂/∂s [ (EA t tᵀ + T/(1 + e) (I - t tᵀ)) ∂r1/∂s ] + F1

so that disturbances run along the line, in unstretched length per time, at

    longitudinal  sqrt(EA / (m + m_a))        transverse  sqrt(T / ((m + m_n) (1 + e)))

m_a being the added mass along and m_n that across the cable: (12.20) and (12.23) with one inertia for each
kind of wave. F1 is the change of drag; its part in the velocity is a damping, which is reported for each
mode as a share of the critical one (to first order: modes do not exchange energy through it). Its part in
the displacement, a turn of the line in the current, is left out: it is small beside the tension's except
where drag, not weight, sets the line's shape. Quadratic drag without a current has no linear part, so
modes in still water are undamped.

If the static shape lies in a plane, motion in it and across it are independent (Huang 1992, 12.4.5); across
it the line does not stretch. Modes hold for motion small beside the sag and for a line that stays taut.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.linalg import LinAlgError, eigh

from heave_env.cable.constitutive import require_hookean
from heave_env.cable.convergence import ConvergenceError
from heave_env.cable.statics import FixedEnds, OnSeabed, StaticShape, StaticsSolver, Towed
from heave_env.hydrodynamics import current_velocity, line_drag_slopes
from heave_env.parameters import Cable, Line, Payload, require, require_integer

Array = np.ndarray

IN_PLANE, OUT_OF_PLANE, SPATIAL = "in plane", "out of plane", "spatial"


def longitudinal_wave_speed(cable: Cable) -> float:
    """Speed of tension waves along the unstretched cable, sqrt(EA / (m + m_a)) [m/s].

    Source: Huang (1992), (12.23).
    """
    return cable.axial_wave_speed


def transverse_wave_speed(cable: Cable, tension: Array | float) -> Array:
    """Speed of waves of shape along the unstretched cable, sqrt(T / ((m + m_n) (1 + e))) [m/s].

    Source: Huang (1992), (12.20), with the added mass across the cable.

    Args:
        cable: The cable; it must have mass.
        tension: Tension [N], not negative, any shape.

    Returns:
        Speeds, the shape of `tension`.
    """
    inertia = cable.transverse_inertia_per_length
    if not inertia > 0.0:
        raise ValueError(
            f"transverse waves need a cable with mass_per_length, got {cable.mass_per_length} kg/m"
        )
    T = np.asarray(tension, dtype=float)
    if np.any(T < 0.0):
        raise ValueError(f"tension must not be negative, got {T.min():g} N")
    return np.asarray(np.sqrt(T / (inertia * (1.0 + T / cable.axial_stiffness))))


def travel_times(shape: StaticShape) -> tuple[float, float]:
    """How long a longitudinal and a transverse wave take from one end of a line to the other [s, s]."""
    longitudinal, transverse = 0.0, 0.0
    for index, length, tension in zip(
        shape.section, np.diff(shape.arc_length), _segment_tension(shape), strict=True
    ):
        cable = shape.line.sections[index].cable
        require_hookean(cable)
        longitudinal += length / longitudinal_wave_speed(cable)
        transverse += length / float(transverse_wave_speed(cable, tension))
    return longitudinal, transverse


def _segment_force(shape: StaticShape) -> Array:
    """Tension vector at the middle of each segment [N], (n_segments, 3)."""
    return shape.force[:-1] - 0.5 * np.diff(shape.arc_length)[:, None] * shape.load


def _segment_tension(shape: StaticShape) -> Array:
    return np.asarray(np.linalg.norm(_segment_force(shape), axis=1))


@dataclass(frozen=True, kw_only=True)
class Modes:
    """Natural modes of a line, slowest first."""

    omega: Array
    """Natural frequencies [rad/s], (n_modes,)."""
    displacement: Array = field(repr=False)
    """Mode shapes, the greatest displacement being one [-], (n_modes, n_nodes, 3)."""
    family: tuple[str, ...]
    """`in plane`, `out of plane`, or `spatial` of a shape that lies in no plane."""
    stretch_share: Array
    """Share of the potential energy that is in stretching [-], (n_modes,): 1 is a longitudinal mode."""
    damping_ratio: Array
    """Share of critical damping that the steady current's drag brings [-], (n_modes,)."""
    arc_length: Array = field(repr=False)
    """Unstretched distance of the nodes from the lower end [m], (n_nodes,)."""

    @property
    def period(self) -> Array:
        """Natural periods [s], (n_modes,)."""
        return np.asarray(2.0 * math.pi / self.omega)

    def of(self, family: str) -> Modes:
        """The modes of one family."""
        chosen = np.array([one == family for one in self.family], dtype=bool)
        return Modes(
            omega=self.omega[chosen],
            displacement=self.displacement[chosen],
            family=tuple(one for one in self.family if one == family),
            stretch_share=self.stretch_share[chosen],
            damping_ratio=self.damping_ratio[chosen],
            arc_length=self.arc_length,
        )


@dataclass(frozen=True, kw_only=True)
class WavesSolver:
    """Natural modes of a line about a static shape: linear elements between the shape's nodes.

    A symmetric generalised eigenproblem, second order in the element's length. Mass is half consistent and
    half lumped, whose leading errors cancel: along a uniform stretch that is fourth order. The upper end is
    held; the lower one is held too, but for a unit that hangs free (`Towed`) or stands on the bed (its
    height held). An added mass points across the line, that of a unit is split into heave and sway.
    """

    shape: StaticShape
    """The static shape, whose nodes are used."""
    n_modes: int = 6
    """Modes in all, the slowest ones."""

    def __post_init__(self) -> None:
        require_integer(self, "n_modes", minimum=1)
        for section in self.shape.line.sections:
            require_hookean(section.cable)
            if not section.cable.mass_per_length > 0.0:
                raise ValueError(
                    f"natural modes need mass_per_length above zero, got {section.cable.mass_per_length} kg/m"
                )
        tension = _segment_tension(self.shape)
        if not tension.min() > 1e-9 * tension.max():
            raise ValueError(
                "natural modes need a taut line, got no tension at "
                f"{self.shape.arc_length[int(np.argmin(tension))]:g} m from its lower end; tighten the line"
            )
        n = int(self._free.sum())
        require(
            self.n_modes <= n, self, "n_modes", f"at most the {n} degrees of freedom of the shape's nodes"
        )

    @cached_property
    def _free(self) -> Array:
        """Which components of which nodes may move, (n_nodes, 3)."""
        free = np.ones((len(self.shape.arc_length), 3), dtype=bool)
        free[-1] = False
        free[0] = ~np.array(self.shape.ends.conditions[0])
        return free

    @cached_property
    def _payload(self) -> Payload | None:
        ends = self.shape.ends
        return ends.payload if isinstance(ends, Towed | OnSeabed) else None

    @cached_property
    def _matrices(self) -> tuple[Array, Array, Array, Array]:
        """Mass, stiffness, its stretching part, and damping over all components, (3 n, 3 n) each."""
        shape = self.shape
        n = len(shape.arc_length)
        force, lengths = _segment_force(shape), np.diff(shape.arc_length)
        mass, stiffness, stretching, damping = (np.zeros((3 * n, 3 * n)) for _ in range(4))
        middle = 0.5 * (shape.position[:-1] + shape.position[1:])
        water = current_velocity(shape.current, -middle[:, 2])
        velocity = shape.ends.velocity if isinstance(shape.ends, Towed) else (0.0, 0.0)
        water[:, :2] -= velocity
        for s, (length, index) in enumerate(zip(lengths, shape.section, strict=True)):
            cable = shape.line.sections[index].cable
            T = float(np.linalg.norm(force[s]))
            t = force[s] / T
            along, across = np.outer(t, t), np.eye(3) - np.outer(t, t)
            EA, strain = cable.axial_stiffness, T / cable.axial_stiffness
            m = length * (cable.inertia_per_length * along + cable.transverse_inertia_per_length * across)
            taut = EA * along / length
            geometric = T / (1.0 + strain) * across / length
            factors = (cable.normal_drag_per_length, cable.tangential_drag_per_length)
            xx, xy, xz, yy, yz, zz = line_drag_slopes(*water[s], *t, *factors)
            slopes = 0.5 * length * np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            here, there = slice(3 * s, 3 * s + 3), slice(3 * s + 3, 3 * s + 6)
            for a, b in ((here, here), (there, there)):
                mass[a, b] += 5.0 / 12.0 * m
                stiffness[a, b] += taut + geometric
                stretching[a, b] += taut
                damping[a, b] += slopes
            for a, b in ((here, there), (there, here)):
                mass[a, b] += m / 12.0
                stiffness[a, b] -= taut + geometric
                stretching[a, b] -= taut
        bodies = [
            (int(np.argmin(np.abs(shape.arc_length - a.arc_length))), a.body) for a in shape.line.attachments
        ]
        if self._payload is not None:
            bodies.append((0, self._payload))
        for node, body in bodies:
            at = slice(3 * node, 3 * node + 3)
            mass[at, at] += np.diag([body.lateral_inertia, body.lateral_inertia, body.inertia])
            ux, uy = current_velocity(shape.current, -shape.position[node, 2])[:2] - np.array(velocity)
            speed = math.hypot(ux, uy)
            if speed > 0.0:
                x, y = ux / speed, uy / speed
                turned = np.array([[1.0 + x * x, x * y, 0.0], [x * y, 1.0 + y * y, 0.0], [0.0, 0.0, 0.0]])
                damping[at, at] += body.lateral_drag_factor * speed * turned
        return mass, stiffness, stretching, damping

    @cached_property
    def _planes(self) -> list[tuple[str, Array]]:
        """Families of motion that do not feel each other, with an orthonormal basis of each, (3, n)."""
        position = self.shape.position
        _, sizes, axes = np.linalg.svd(position - position.mean(axis=0), full_matrices=False)
        if sizes[2] > 1e-9 * sizes[0]:
            return [(SPATIAL, np.eye(3))]
        normal = axes[2]
        if sizes[1] <= 1e-9 * sizes[0]:  # straight: the plane is upright, or that of x if the line is too
            along = axes[0]
            upright = np.array([0.0, 0.0, 1.0]) if abs(along[2]) < 1.0 - 1e-9 else np.array([1.0, 0.0, 0.0])
            normal = np.cross(along, upright)
            normal /= np.linalg.norm(normal)
        # Where heave differs from sway, or its height is held, motion splits only about an upright plane.
        bodies = [attachment.body for attachment in self.shape.line.attachments]
        split = any(body.inertia != body.lateral_inertia for body in bodies)
        if self._payload is not None:
            split |= self._payload.inertia != self._payload.lateral_inertia
        split |= isinstance(self.shape.ends, OnSeabed)
        if split and abs(normal[2]) > 1e-9:
            return [(SPATIAL, np.eye(3))]
        first = np.array([-normal[1], normal[0], 0.0])
        first = first / np.linalg.norm(first) if np.linalg.norm(first) > 1e-9 else np.array([1.0, 0.0, 0.0])
        return [
            (IN_PLANE, np.stack([first, np.cross(normal, first)], axis=1)),
            (OUT_OF_PLANE, normal[:, None]),
        ]

    def solve(self) -> Modes:
        """Finds the slowest modes.

        Raises:
            ConvergenceError: If the stiffness is not positive, as of a line that is all but slack.
        """
        mass, stiffness, stretching, damping = self._matrices
        n = len(self.shape.arc_length)
        found: list[tuple[float, str, Array]] = []
        for family, basis in self._planes:
            full = np.kron(np.eye(n), basis)[:, ~self._held_columns(basis)]
            K, M = full.T @ stiffness @ full, full.T @ mass @ full
            size = len(K)
            if size == 0:
                continue
            count = min(self.n_modes, size)
            try:
                # The inverse problem: its largest roots are the slow modes, which so keep their digits.
                softness, vectors = eigh(M, K, subset_by_index=[size - count, size - 1])
            except LinAlgError as error:
                least = float(np.linalg.eigvalsh(K)[0])
                raise ConvergenceError(
                    "the line has no stiffness in some direction: it is slack or nearly so; tighten it", least
                ) from error
            for value, vector in zip(softness, vectors.T, strict=True):
                found.append((1.0 / math.sqrt(value), family, full @ vector))
        found = sorted(found, key=lambda mode: mode[0])[: self.n_modes]
        vectors = np.array([vector for _, _, vector in found])
        omega = np.array([frequency for frequency, _, _ in found])
        energy = np.einsum("ki,ij,kj->k", vectors, stiffness, vectors)
        stretched = np.einsum("ki,ij,kj->k", vectors, stretching, vectors)
        inertia = np.einsum("ki,ij,kj->k", vectors, mass, vectors)
        damped = np.einsum("ki,ij,kj->k", vectors, damping, vectors)
        displacement = vectors.reshape(len(found), n, 3)
        for mode in displacement:
            greatest = mode.reshape(-1)[int(np.argmax(np.abs(mode)))]
            mode /= math.copysign(float(np.linalg.norm(mode, axis=1).max()), greatest)
        return Modes(
            omega=omega,
            displacement=displacement,
            family=tuple(family for _, family, _ in found),
            stretch_share=stretched / energy,
            damping_ratio=damped / (2.0 * omega * inertia),
            arc_length=self.shape.arc_length,
        )

    def _held_columns(self, basis: Array) -> Array:
        """Which motions along a basis are held, node by node: those with a part in a held component."""
        held = (~self._free).astype(float) @ np.abs(basis) > 1e-9
        return np.asarray(held.ravel())


def hanging_line(
    line: Line,
    payload: Payload,
    *,
    n_segments: int = 100,
) -> StaticShape:
    """The shape of a line that hangs upright in still water with a unit at its lower end."""
    return StaticsSolver(line=line, ends=Towed(payload=payload), n_segments=n_segments).solve()


def inclined_line(
    line: Line,
    lower: tuple[float, float, float],
    upper: tuple[float, float, float],
    *,
    n_segments: int = 100,
) -> StaticShape:
    """The shape of a line between two supports in still water."""
    return StaticsSolver(line=line, ends=FixedEnds(lower=lower, upper=upper), n_segments=n_segments).solve()
