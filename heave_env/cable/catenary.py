"""Elastic catenary between two supports in still water: exact.

    x = H s/EA + H ∫ ds/T,  z = ∫ V ds/EA + ∫ V ds/T,  V = V0 + w s,  T² = H² + V²

s is the unstretched arc length from the lower support at the origin, where the vertical force is V0, to the
upper one at (span, 0, height); w is the weight in water per unstretched length and may be negative. Written
in the mean of the end tensions, so that a weightless cable needs no case of its own:

    ∫ ds/T = 2 s artanh(y)/(y (T0 + T)),  y = w s/(T0 + T),      ∫ V ds/T = s (V0 + V)/(T0 + T)

It stops holding where the cable lies on the bottom and where the supports stand above one another.

Source: Irvine (1981), the elastic catenary.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from heave_env.cable.convergence import ConvergenceError
from heave_env.parameters import Cable

Array = np.ndarray

LARGEST_STRESS = 6e9
"""Stress at rest beyond which no cable is taken for possible [Pa]: the strongest fibres' strength."""
DEEPEST = 10.0
"""Largest half span over the catenary's parameter H/w for which a length is looked for [-]: a cable of a
thousand spans."""


@dataclass(frozen=True, kw_only=True)
class Catenary:
    """Elastic cable at rest between its supports."""

    cable: Cable
    length: float
    """Unstretched length, S [m]."""
    horizontal_force: float
    """H [N]."""
    lower_vertical_force: float
    """Vertical force at the lower end, V0: positive where the cable leaves it upwards [N]."""

    def force(self, s: Array) -> Array:
        """Force that the part above exerts on the part below, x, y and z [N], (..., 3)."""
        vertical = self.lower_vertical_force + self.cable.submerged_weight * np.asarray(s, dtype=float)
        return np.stack([np.full_like(vertical, self.horizontal_force), 0.0 * vertical, vertical], axis=-1)

    def tension(self, s: Array) -> Array:
        """Tension [N], the shape of `s`."""
        return np.asarray(np.linalg.norm(self.force(s), axis=-1))

    def position(self, s: Array) -> Array:
        """Position from the lower support [m], (..., 3)."""
        s = np.asarray(s, dtype=float)
        x, z = _catenary_end(self.cable, s, self.horizontal_force, self.lower_vertical_force)
        return np.stack([x, 0.0 * x, z], axis=-1)

    def tangent(self, s: Array) -> Array:
        """Derivative of position by unstretched arc length, as long as the stretch [-], (..., 3)."""
        stretch_per_force = 1.0 / self.tension(s) + 1.0 / self.cable.axial_stiffness
        return self.force(s) * stretch_per_force[..., None]

    @property
    def sag(self) -> float:
        """Largest vertical distance of the cable below its chord [m]; above it if the cable floats."""
        end = self.position(np.array(self.length))
        s = np.linspace(0.0, self.length, 2001)
        x, _, z = self.position(s).T
        below = end[2] * x / end[0] - z
        k = int(np.clip(np.argmax(np.abs(below)), 1, len(s) - 2))
        # The vertex of the parabola through the largest and its neighbours.
        left, middle, right = below[k - 1 : k + 2]
        bend = left - 2.0 * middle + right
        return float(middle - 0.125 * (right - left) ** 2 / bend) if bend != 0.0 else float(middle)


def _catenary_end(cable: Cable, s: Array, H: float, V0: float) -> tuple[Array, Array]:
    """x and z at arc length `s` [m], from the forces at the lower end."""
    EA, w = cable.axial_stiffness, cable.submerged_weight
    V = V0 + w * s
    tensions = np.hypot(H, V0) + np.hypot(H, V)
    y = w * s / tensions
    small = np.abs(y) < 1e-4
    safe = np.where(small, 0.5, y)
    ratio = np.where(small, 1.0 + y * y / 3.0 * (1.0 + 0.6 * y * y), np.arctanh(safe) / safe)
    return H * s * (1.0 / EA + 2.0 * ratio / tensions), s * (V0 + V) * (0.5 / EA + 1.0 / tensions)


def _first_forces(cable: Cable, length: float, span: float, height: float) -> tuple[float, float]:
    """Forces of the inextensible catenary or, where the cable is nearly straight, of the flat elastic one."""
    EA, w = cable.axial_stiffness, cable.submerged_weight
    chord = math.hypot(span, height)
    excess = length / chord - 1.0
    if excess < 0.01:
        # Stretch and sag share the excess: excess = (w L cos)² / 24 T² - T / EA.
        sagging = (w * length * span / (chord * EA)) ** 2 / 24.0
        T = EA * float(np.max(np.roots([1.0, excess, 0.0, -sagging]).real))
        return T * span / chord, T * height / chord - 0.5 * w * length
    steepness = math.sqrt(3.0 * ((length**2 - height**2) / span**2 - 1.0))
    H = abs(w) * span / (2.0 * steepness)
    return H, 0.5 * (abs(w) * height / math.tanh(steepness) - w * length)


def hanging_span(cable: Cable, length: float, span: float, height: float) -> Catenary:
    """The catenary of a given length between supports `span` apart and `height` above one another.

    Newton on the two force components at the lower end, the step halved until the ends come nearer.

    Args:
        cable: The cable; `tension_only` makes no difference to what hangs.
        length: Unstretched length [m].
        span: Horizontal distance of the supports [m].
        height: Upper above lower support [m].

    Raises:
        ValueError: If no cable of this stiffness and length can hang there.
        ConvergenceError: If no forces are found that bring the end to the upper support.
    """
    chord, EA = math.hypot(span, height), cable.axial_stiffness
    if length >= chord and cable.submerged_weight == 0.0:
        raise ValueError(
            f"a weightless cable of {length:g} m has no shape of its own between supports {chord:g} m apart; "
            "give it a submerged_weight, or make it shorter than the distance"
        )
    taut = EA * max(0.0, chord / length - 1.0)
    limit, reason = _strength(cable)
    if taut > limit:
        raise ValueError(
            f"impossible geometry: a cable of {length:g} m cannot span {chord:g} m, for its stiffness EA = "
            f"{EA:g} N would take {taut:.3g} N to stretch it and {reason}; give a greater length or less "
            "stiffness"
        )
    found = _balanced(cable, length, span, height)
    most = float(found.tension(np.array([0.0, length])).max())
    if most > limit:
        raise ValueError(
            f"impossible geometry: a cable of {length:g} m hangs between its supports at {most:.4g} N, but "
            f"{reason}; give a greater length"
        )
    return found


def _balanced(cable: Cable, length: float, span: float, height: float) -> Catenary:
    """The catenary that ends at the supports, whether or not a cable would bear it."""
    H, V0 = _first_forces(cable, length, span, height)
    scale = math.hypot(span, height) + length

    def miss(forces: tuple[float, float]) -> Array:
        x, z = _catenary_end(cable, np.array(length), *forces)
        return np.array([x - span, z - height], dtype=float)

    error = miss((H, V0))
    for _ in range(200):
        if float(np.abs(error).max()) <= 4e-16 * scale:
            break
        step = np.linalg.solve(_compliance(cable, length, H, V0), error)
        share = 1.0 if step[0] < 0.9 * H else 0.9 * H / step[0]
        for _ in range(60):
            trial = (H - share * step[0], V0 - share * step[1])
            trial_error = miss(trial)
            if trial_error @ trial_error < error @ error:
                break
            share *= 0.5
        else:
            break
        H, V0, error = *trial, trial_error
    residual = float(np.abs(error).max())
    # Rounding of the forces, seen through the compliance, is all that may be left.
    if not residual <= 1e-9 * scale:
        raise ConvergenceError(
            f"no catenary of {length:g} m found between supports {span:g} m apart and {height:g} m above one "
            "another; its end misses the upper support by so many metres, and the likely cause is a span "
            "that is all but vertical: give a greater span",
            residual,
        )
    return Catenary(cable=cable, length=length, horizontal_force=H, lower_vertical_force=V0)


def _strength(cable: Cable) -> tuple[float, str]:
    """The largest tension that the cable can hang with [N], and why."""
    section = 0.25 * math.pi * cable.diameter**2
    fibres = LARGEST_STRESS * section
    if cable.breaking_strength is not None and cable.breaking_strength < fibres:
        return cable.breaking_strength, f"it breaks at {cable.breaking_strength:g} N"
    return fibres, f"no rope of {cable.diameter:g} m bears more than {fibres:.3g} N"


def _compliance(cable: Cable, length: float, H: float, V0: float) -> Array:
    """Derivatives of the end's position by the forces at the lower end [m/N], (2, 2)."""
    EA, w = cable.axial_stiffness, cable.submerged_weight
    V1 = V0 + w * length
    T0, T1 = math.hypot(H, V0), math.hypot(H, V1)
    y = w * length / (T0 + T1)
    if abs(y) > 1e-3:
        of_z = (V1 / T1 - V0 / T0) / w  # ∫ H²/T³ ds
        of_x = 2.0 * math.atanh(y) / w - of_z  # ∫ V²/T³ ds
        mixed = (H / T1 - H / T0) / w  # -∫ H V/T³ ds
    else:
        V = 0.5 * (V0 + V1)
        of_x, of_z, mixed = np.array([V * V, H * H, -H * V]) * length / math.hypot(H, V) ** 3
    stretch = length / EA
    return np.array([[of_x + stretch, mixed], [mixed, of_z + stretch]])


def length_of_sag(cable: Cable, span: float, height: float, sag: float) -> float:
    """Unstretched length of the cable that hangs `sag` [m] below its chord.

    Raises:
        ValueError: If the cable is weightless, or the sag is no positive length that it can hang with.
    """
    chord = math.hypot(span, height)
    if not (sag > 0.0 and math.isfinite(sag)):
        raise ValueError(f"sag must be a positive number [m], got {sag!r}")
    if cable.submerged_weight == 0.0:
        raise ValueError("a weightless cable does not sag; give it a submerged_weight")

    def excess(power: float) -> float:
        length = length_of_force(cable, span, height, flat * 2.0**power)
        return sag - abs(_balanced(cable, length, span, height).sag)

    # The flat parabola's force and, where the cable hangs deep, more or less than that.
    flat = abs(cable.submerged_weight) * span * chord / (8.0 * sag)
    deepest = math.log2(0.5 * abs(cable.submerged_weight) * span / (DEEPEST * flat)) + 1e-9
    low = max(-0.1, deepest)
    while excess(low) > 0.0:
        if low == deepest:
            raise ValueError(f"sag must be below {sag - excess(low):.4g} m on this span, got {sag!r}")
        low = max(2.0 * low, deepest)
    high = low + 0.2
    while excess(high) < 0.0:
        low, high = high, high + 2.0 * (high - low)
    return length_of_force(cable, span, height, flat * 2.0 ** _root(excess, low, high))


def length_of_force(cable: Cable, span: float, height: float, horizontal_force: float) -> float:
    """Unstretched length of the cable that pulls horizontally at its supports with the given force [N].

    Raises:
        ValueError: If the force is no positive number.
    """
    if not (horizontal_force > 0.0 and math.isfinite(horizontal_force)):
        raise ValueError(f"horizontal_force must be a positive number [N], got {horizontal_force!r}")
    chord = math.hypot(span, height)
    w, EA = cable.submerged_weight, cable.axial_stiffness
    if 0.5 * abs(w) * span > DEEPEST * horizontal_force:
        raise ValueError(
            f"horizontal_force must be at least {0.5 * abs(w) * span / DEEPEST:.4g} N for a cable of "
            f"{w:g} N/m over {span:g} m, got {horizontal_force!r}"
        )
    if w == 0.0:
        return chord / (1.0 + horizontal_force * chord / (span * EA))
    # Of the inextensible catenary, exactly; the elastic one is shorter, by what it stretches.
    half = 0.5 * abs(w) * span / horizontal_force
    inextensible = math.hypot(height, span * math.sinh(half) / half)
    tension = horizontal_force * inextensible / span + abs(w) * inextensible
    shortest = chord / (1.0 + 1.01 * tension / EA)

    def excess(length: float) -> float:
        return horizontal_force - _balanced(cable, length, span, height).horizontal_force

    return _root(excess, shortest, inextensible * (1.0 + 1e-9))


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    return float(brentq(function, low, high, xtol=1e-14 * max(abs(low), abs(high)), rtol=1e-14))
