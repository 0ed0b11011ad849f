"""A uniform cable towed straight behind a vessel, with or without cable running out.

A cable without a load at its end, towed steadily at the speed U through still water, lies straight. At the
angle α below the horizontal its weight across balances the drag across, and what acts along it makes the
tension, from nothing at the free end (s = 0) to its greatest at the tow point (s = length):

    across   w cos α = (1/2) ρ d C_N U² sin² α
    along    dT/ds = w sin α + (π/2) ρ d C_t |U cos α - U_p| (U cos α - U_p)

where w is the submerged weight per length and U_p the pay-out rate. The first depends on the cable Froude
number alone,

    F_c = ρ U² / (ρ^ g d) = π ρ U² d / (4 w) = (π/2) cos α / (C_N sin² α)

with ρ^ g π d² / 4 = w. Strumming raises the tangential drag: `strumming_augmentation` is its share, up to one
half in the source's towing tank.

Source: Welch and Tulin (1993), (1)-(5).

Limits: at rest the cable hangs (α = 90°) and the critical pay-out rate is its terminal velocity; a neutrally
buoyant cable lies along the flow (α = 0), where the ratios of tension to weight lose their meaning but the
tension does not. A cable that floats has no such angle: it trails on the surface, and is refused.

Assumed: steady, no current but the tow's own, no bending stiffness, drag across by the component of velocity
across alone. The straight line stops holding within some lengths T / w of a load at the free end, and where
the tension is negative: there the cable buckles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from heave_env.cable.constitutive import require_hookean
from heave_env.parameters import SEAWATER_DENSITY, Cable, require, require_number

Array = np.ndarray


def cable_froude_number(cable: Cable, speed: Array | float) -> Array:
    """Cable Froude number, F_c = π ρ U² d / (4 w) [-], shape of `speed`; infinite without weight.

    Source: Welch and Tulin (1993), introduction.

    Args:
        cable: The cable; its weight must not be negative.
        speed: Speed of the tow, U [m/s], any shape.
    """
    _require_sinking(cable)
    inertia = 0.25 * math.pi * SEAWATER_DENSITY * cable.diameter * np.asarray(speed, dtype=float) ** 2
    if cable.submerged_weight == 0.0:
        return np.where(inertia > 0.0, math.inf, 0.0)
    return np.asarray(inertia / cable.submerged_weight)


def inclination(froude_number: Array | float, normal_drag_coefficient: float) -> Array:
    """Angle of the cable below the horizontal, α [rad], shape of `froude_number`.

    tan² α = r (r + sqrt(r² + 4)) / 2 with r = π / (2 C_N F_c).

    Source: Welch and Tulin (1993), (1), solved for the angle.

    Args:
        froude_number: F_c, not negative; infinite for a cable without weight [-].
        normal_drag_coefficient: C_N [-].
    """
    drag = normal_drag_coefficient * np.asarray(froude_number, dtype=float)
    if not (drag >= 0.0).all():
        raise ValueError(
            f"froude_number and normal_drag_coefficient must not be negative, got {froude_number!r} and "
            f"{normal_drag_coefficient!r}"
        )
    with np.errstate(divide="ignore", over="ignore"):
        r = 0.5 * math.pi / drag
    return np.asarray(np.arctan(np.sqrt(0.5 * r) * np.sqrt(r + np.hypot(r, 2.0))))


def froude_number(inclination: Array | float, normal_drag_coefficient: float) -> Array:
    """Cable Froude number at which the cable lies at an angle, (π/2) cos α / (C_N sin² α) [-].

    Source: Welch and Tulin (1993), (1).

    Args:
        inclination: Angle below the horizontal, α in [0, π/2] [rad], any shape.
        normal_drag_coefficient: C_N, positive [-].
    """
    angle = _angles(inclination)
    if not normal_drag_coefficient > 0.0:
        raise ValueError(f"normal_drag_coefficient must be positive, got {normal_drag_coefficient!r}")
    with np.errstate(divide="ignore"):
        return np.asarray(0.5 * math.pi * np.cos(angle) / (normal_drag_coefficient * np.sin(angle) ** 2))


def tension_ratio(inclination: Array | float, payout_ratio: Array | float, drag_ratio: float) -> Array:
    """Tension over the tangential component of the cable's weight [-], the same all along the cable.

    T / T_wt = 1 + π (C_t / C_N) cos α / sin³ α |cos α - β| (cos α - β)

    Source: Welch and Tulin (1993), (4).

    Args:
        inclination: Angle below the horizontal, α in (0, π/2] [rad].
        payout_ratio: Pay-out rate over the speed of the tow, β [-]; broadcasts with `inclination`.
        drag_ratio: C_t / C_N, strumming included [-].
    """
    angle = _angles(inclination)
    if not (angle > 0.0).all():
        raise ValueError("inclination must be positive: a cable along the flow has no weight to compare with")
    cosine = np.cos(angle)
    slip = cosine - np.asarray(payout_ratio, dtype=float)
    return np.asarray(1.0 + math.pi * drag_ratio * cosine / np.sin(angle) ** 3 * np.abs(slip) * slip)


def critical_payout_ratio(inclination: Array | float, drag_ratio: float) -> Array:
    """Pay-out ratio β* at which the tension vanishes all along the cable [-], shape of `inclination`.

    β* = cos α + sqrt(sin³ α / (π (C_t / C_N) cos α)); infinite without tangential drag.

    Source: Welch and Tulin (1993), (5).

    Args:
        inclination: Angle below the horizontal, α in [0, π/2] [rad].
        drag_ratio: C_t / C_N, strumming included [-].
    """
    angle = _angles(inclination)
    if not drag_ratio >= 0.0:
        raise ValueError(f"drag_ratio must not be negative, got {drag_ratio!r}")
    cosine, sine = np.cos(angle), np.sin(angle)
    with np.errstate(divide="ignore", invalid="ignore"):
        beyond = np.sqrt(sine**3 / (math.pi * drag_ratio * cosine))
    return np.asarray(cosine + np.where(sine == 0.0, 0.0, beyond))


@dataclass(frozen=True)
class Tow:
    """A towed cable at rest in the vessel's frame; arrays of shape (n_points,), from the free end up.

    x points ahead from the tow point, z up: the tow point is the origin.
    """

    arc_length: Array
    """Unstretched distance from the free end [m]."""
    x: Array
    """Position ahead of the tow point, so negative [m]."""
    z: Array
    """Height over the tow point, so negative [m]."""
    tension: Array
    """Tension [N]; negative where the straight cable would be pushed."""
    inclination: float
    """Angle below the horizontal, α [rad]."""
    weight_tension: float
    """Part of the tension at the tow point that the weight makes [N]."""
    drag_tension: float
    """Part of it that tangential drag makes [N]; negative where the cable overruns the water."""
    critical_payout_rate: float
    """Pay-out rate at which the tension vanishes [m/s]; infinite without tangential drag."""

    @property
    def top_tension(self) -> float:
        """Tension at the tow point [N]."""
        return float(self.tension[-1])

    @property
    def depth(self) -> float:
        """Depth of the free end below the tow point [m]."""
        return float(-self.z[0])

    @property
    def layback(self) -> float:
        """Horizontal distance of the free end behind the tow point [m]."""
        return float(-self.x[0])

    @property
    def elongation(self) -> float:
        """Stretch of the whole cable [m]."""
        return math.hypot(self.depth, self.layback) - float(self.arc_length[-1])

    @property
    def stays_taut(self) -> bool:
        """Whether the tension is positive; where it is not, the cable buckles and does not lie straight."""
        return self.weight_tension + self.drag_tension > 0.0


@dataclass(frozen=True, kw_only=True)
class Towing:
    """A uniform cable towed at constant speed, its lower end free. Closed forms: exact, and no iteration."""

    cable: Cable
    """The cable; its weight, its diameter and both drag coefficients count."""
    length: float
    """Unstretched length outboard [m]."""
    speed: float
    """Speed of the tow through the water, U [m/s]."""
    payout_rate: float = 0.0
    """Rate at which cable goes out, U_p, positive outwards [m/s]."""
    strumming_augmentation: float = 0.0
    """Share by which strumming raises the tangential drag coefficient [-]; up to 0.5 was measured."""

    def __post_init__(self) -> None:
        require_number(self, "length", positive=True)
        require_number(self, "speed", non_negative=True)
        require_number(self, "payout_rate")
        require_number(self, "strumming_augmentation", non_negative=True)
        require_hookean(self.cable)
        _require_sinking(self.cable)
        if self.cable.submerged_weight == 0.0:
            require(
                self.speed > 0.0, self, "speed", "positive for a cable without weight, which has no angle"
            )
            require_number(self.cable, "normal_drag_coefficient", positive=True)

    @property
    def tangential_drag_per_length(self) -> float:
        """Drag along the cable over speed squared, strumming included [kg/m²]."""
        return self.cable.tangential_drag_per_length * (1.0 + self.strumming_augmentation)

    @property
    def drag_ratio(self) -> float:
        """C_t / C_N, strumming included [-]; infinite without normal drag."""
        across = self.cable.normal_drag_coefficient
        along = self.cable.tangential_drag_coefficient * (1.0 + self.strumming_augmentation)
        return along / across if across > 0.0 else math.inf

    @property
    def inclination(self) -> float:
        """Angle below the horizontal, α [rad]. Source: Welch and Tulin (1993), (1)."""
        froude, across = cable_froude_number(self.cable, self.speed), self.cable.normal_drag_coefficient
        return float(inclination(froude, across)) if across > 0.0 else 0.5 * math.pi

    @property
    def critical_payout_rate(self) -> float:
        """Pay-out rate at which the tension vanishes, β* U, whole at rest too [m/s].

        U_p = U cos α + sqrt(w sin α / c), c the tangential drag per length; infinite without it.

        Source: Welch and Tulin (1993), (5).
        """
        c, angle = self.tangential_drag_per_length, self.inclination
        along = self.cable.submerged_weight * math.sin(angle)
        return self.speed * math.cos(angle) + (math.sqrt(along / c) if c > 0.0 else math.inf)

    def solve(self, n_points: int = 101) -> Tow:
        """Where the cable lies and what it bears, at `n_points` evenly along it."""
        if n_points < 2:
            raise ValueError(f"n_points must be at least 2, got {n_points!r}")
        s = np.linspace(0.0, self.length, n_points)
        angle = self.inclination
        slip = self.speed * math.cos(angle) - self.payout_rate
        weight = self.cable.submerged_weight * math.sin(angle)
        drag = self.tangential_drag_per_length * abs(slip) * slip
        stretched = s + 0.5 * (weight + drag) * s**2 / self.cable.axial_stiffness
        from_top = stretched[-1] - stretched
        return Tow(
            arc_length=s,
            x=-from_top * math.cos(angle),
            z=-from_top * math.sin(angle),
            tension=(weight + drag) * s,
            inclination=angle,
            weight_tension=weight * self.length,
            drag_tension=drag * self.length,
            critical_payout_rate=self.critical_payout_rate,
        )


def _require_sinking(cable: Cable) -> None:
    if cable.submerged_weight < 0.0:
        raise ValueError(
            "Cable.submerged_weight must not be negative for a straight tow, got "
            f"{cable.submerged_weight!r} N/m: a cable that floats trails on the surface"
        )


def _angles(inclination: Array | float) -> Array:
    angle = np.asarray(inclination, dtype=float)
    if not ((angle >= 0.0) & (angle <= 0.5 * math.pi)).all():
        raise ValueError(f"inclination must lie between 0 and pi/2 rad, got {inclination!r}")
    return angle
