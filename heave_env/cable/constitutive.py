"""The law of the cable's material, the same for every solver.

T = EA e + C_A De/Dt, and no compression if the cable is tension-only. Over a time step the mean tension is
the change of the stored energy over the change of strain (a discrete gradient), so that going slack and
snapping taut neither makes nor loses energy, however stiff the elements; for a linear cable that is the
tension at mid-step.

A rope beyond Hooke's law (`Cable.is_hookean` false) hardens and relaxes:

    T = EA (e + k2 e² + k3 e³) + C_A De/Dt + EA1 a,   Da/Dt = De/Dt - a/τ

a being the strain of a Maxwell branch's spring. It stores EA (e²/2 + k2 e³/3 + k3 e⁴/4) + EA1 a²/2. The first
part being a polynomial, its change over the change of strain is one too, without cancellation: with x the
strain before and y after, EA ((x + y)/2 + k2 (x² + xy + y²)/3 + k3 (x + y)(x² + y²)/4). The branch is stepped
by the midpoint rule, whose loss over a step is EA1 a²/τ at mid-step and never negative. In a tension-only
rope each of the three acts on the taut part of the strain, and spring and branch together never push: what
the branch would push beyond the spring's pull it lets go of, which is a loss too. So a rope about a mean
tension answers both ways, and one that has crept is slack before it is back at its old length.

Source: Huang (1992), (3.1) and 3.4 (T = T(e, De/Dt)), with Kelvin damping; discrete gradient after Gonzalez
(1996); standard linear solid after Zener (1948).
"""

from __future__ import annotations

import numpy as np

from heave_env.compiled import stage
from heave_env.lanes import absolute, constant, maximum, minimum, where
from heave_env.parameters import Cable

Array = np.ndarray


@stage
def tension_of(strain, strain_rate, EA, CA, tension_only):
    """Tension at an instant, and its derivatives by strain and by strain rate [N, N, N·s]."""
    if tension_only and strain <= 0.0:
        return 0.0 * EA, 0.0 * EA, 0.0 * EA
    tension = EA * strain + CA * strain_rate
    if tension_only and tension <= 0.0:
        return 0.0 * EA, 0.0 * EA, 0.0 * EA
    return tension, EA, CA


@stage
def taut_tension(old, new, EA, CA, per_dt):
    """Mean tension of a tension-only element over a step from strain `old` to `new`, and d/d(new).

    Kelvin damping acts on the taut part of the strain, and what would still be compression is zero. Plain
    numbers or lanes.
    """
    zero, half, one = constant(old, 0.0), constant(old, 0.5), constant(old, 1.0)
    is_taut = new > zero
    taut_new, taut_old = maximum(new, zero), maximum(old, zero)
    crosses = is_taut ^ (old > zero)
    change = where(crosses, new - old, one)
    gained = half * (taut_new * taut_new - taut_old * taut_old) / change
    mean = where(crosses, gained, half * (taut_new + taut_old))
    slope = where(crosses, (taut_new - gained) / change, where(is_taut, half, zero))
    tension = EA * mean + CA * per_dt * (taut_new - taut_old)
    stiffness = EA * slope + where(is_taut, CA * per_dt, zero)
    pulls = tension > zero
    return where(pulls, tension, zero), where(pulls, stiffness, zero)


@stage
def mean_tension(old, new, EA, CA, per_dt, tension_only):
    """Mean tension over a step from strain `old` to `new`, and its derivative by `new` [N, N].

    `per_dt` is one over the time step. Energy EA (new² - old²)/2 is what the mean does, exactly.
    """
    if tension_only:
        return taut_tension(old, new, EA, CA, per_dt)
    return EA * 0.5 * (old + new) + CA * per_dt * (new - old), 0.5 * EA + CA * per_dt


@stage
def rope_tension(old, new, held, EA, quadratic, cubic, EA1, share, CA, per_dt, tension_only):
    """Mean tension of a rope beyond Hooke's law over a step, d/d(new), and the branch's strain at mid-step.

    `quadratic` and `cubic` are k2/3 and k3/4 (`rope_energy_coefficients`), `held` is the branch's strain
    before the step, `share` 1/(1 + dt/2τ). Plain numbers or lanes.
    """
    zero, half, one = constant(old, 0.0), constant(old, 0.5), constant(old, 1.0)
    x, y = old, new
    is_taut, crosses = zero == zero, zero != zero
    if tension_only:
        x, y = maximum(old, zero), maximum(new, zero)
        is_taut = new > zero
        crosses = is_taut ^ (old > zero)
    change = where(crosses, new - old, one)
    part = where(crosses, (y - x) / change, one)
    pulls = where(is_taut, one, zero)
    turns = where(crosses, (pulls - part) / change, zero)
    taut = where(crosses, part, pulls)
    mean = half * (x + y) + quadratic * (x * x + x * y + y * y) + cubic * (x + y) * (x * x + y * y)
    by_new = half + quadratic * (x + y + y) + cubic * (x * x + y * y + (x + y) * (y + y))
    slope = by_new * pulls * part + mean * turns
    middle = share * (held + half * (y - x))
    tension = EA * mean * part + CA * per_dt * (y - x) + EA1 * middle * taut
    stiffness = EA * slope + pulls * (CA * per_dt + half * EA1 * share * taut) + EA1 * middle * turns
    if tension_only:
        lets_go = EA * mean + EA1 * middle < zero
        middle = where(lets_go, -EA * mean / EA1, middle)
        tension = where(lets_go, CA * per_dt * (y - x), tension)
        stiffness = where(lets_go, pulls * CA * per_dt, stiffness)
        stiffness = where(tension > zero, stiffness, zero)
        tension = maximum(tension, zero)
    return tension, stiffness, middle


@stage
def relaxed_tension(strain, EA, quadratic, cubic):
    """Tension of a relaxed rope at a strain, and its derivative [N, N]; Hooke's law where it is pushed.

    No rope at rest is: there, a search finds the slope that leads it back.
    """
    if strain <= 0.0:
        return EA * strain, EA
    k2, k3 = 3.0 * quadratic, 4.0 * cubic
    tension = EA * strain * (1.0 + strain * (k2 + strain * k3))
    return tension, EA * (1.0 + strain * (2.0 * k2 + 3.0 * strain * k3))


@stage
def branch_after(old, new, held, middle, EA, quadratic, cubic, EA1, share, tension_only):
    """Strain of the Maxwell branch after a step from strain `old` to `new`, from that before and at mid-step.

    Of a tension-only rope it pushes no more than the spring pulls; where it let go at mid-step, it pushes
    just so much. Either way its energy is at most what the midpoint rule would leave. Plain numbers or lanes.
    """
    after = middle + (middle - held)
    if tension_only:
        zero, one, half = constant(old, 0.0), constant(old, 1.0), constant(old, 0.5)
        x, y = maximum(old, zero), maximum(new, zero)
        spring = EA * y * (one + y * (constant(old, 3.0) * quadratic + y * constant(old, 4.0) * cubic))
        bears = where(zero < EA1, spring / EA1, zero)
        lets_go = middle > share * (held + half * (y - x))
        after = where(lets_go, -minimum(bears, absolute(after)), maximum(after, -bears))
    return after


@stage
def strain_of(tension, EA, quadratic, cubic):
    """Strain at which a relaxed rope carries a tension, by Newton's method kept within a bracket."""
    wanted, k2, k3 = tension / EA, 3.0 * quadratic, 4.0 * cubic
    least = 1.0
    if k3 > 0.0 and (k2 < 0.0 or wanted < 0.0):
        least = 1.0 - k2 * k2 / (3.0 * k3)
    strain = wanted / least
    low, high = min(strain, 0.0), max(strain, 0.0)
    for _ in range(200):
        excess = strain * (1.0 + strain * (k2 + strain * k3)) - wanted
        low, high = (low, strain) if excess > 0.0 else (strain, high)
        better = strain - excess / (1.0 + strain * (2.0 * k2 + 3.0 * strain * k3))
        better = better if low <= better <= high else 0.5 * (low + high)
        settled = abs(better - strain) <= 4e-16 * abs(better)
        strain = better
        if settled:
            break
    return strain


def rope_energy_coefficients(cable: Cable) -> tuple[float, float]:
    """k2/3 and k3/4: coefficients of the cubic and quartic terms of the stored energy over EA [-]."""
    return cable.quadratic_hardening / 3.0, cable.cubic_hardening / 4.0


def static_tension(cable: Cable, strain: Array | float) -> Array:
    """Tension of the relaxed cable at a strain, EA (e + k2 e² + k3 e³) [N], same shape."""
    e = np.asarray(strain, dtype=float)
    e = np.maximum(e, 0.0) if cable.tension_only else e
    return cable.axial_stiffness * e * (1.0 + e * (cable.quadratic_hardening + e * cable.cubic_hardening))


def static_strain(cable: Cable, tension: Array | float) -> Array:
    """Strain at which the relaxed cable carries a tension [-], same shape."""
    T = np.asarray(tension, dtype=float)
    third, quarter = rope_energy_coefficients(cable)
    solved = [strain_of.py_func(float(t), cable.axial_stiffness, third, quarter) for t in T.ravel()]
    return np.reshape(np.array(solved), T.shape)


def stored_energy(cable: Cable, strain: Array | float) -> Array:
    """Energy that the relaxed cable stores per unstretched length at a strain [J/m], same shape."""
    e = np.asarray(strain, dtype=float)
    e = np.maximum(e, 0.0) if cable.tension_only else e
    third, quarter = rope_energy_coefficients(cable)
    return cable.axial_stiffness * e**2 * (0.5 + e * (third + e * quarter))


def dynamic_modulus(cable: Cable, omega: Array | float, tension: float) -> Array:
    """Complex stiffness of small motion about a tension, dT/de + i ω C_A + EA1 i ω τ / (1 + i ω τ) [N].

    Args:
        cable: The cable.
        omega: Angular frequency [rad/s], any shape.
        tension: Tension that the motion is about [N]; a Hookean cable does not look at it.
    """
    w = np.asarray(omega, dtype=float)
    modulus = cable.axial_stiffness + 1j * w * cable.axial_damping
    if not cable.is_hookean:
        e, turn = float(static_strain(cable, tension)), 1j * w * cable.relaxation_time
        harder = e * (2.0 * cable.quadratic_hardening + 3.0 * e * cable.cubic_hardening)
        modulus = modulus + cable.axial_stiffness * harder + cable.relaxing_stiffness * turn / (1.0 + turn)
    return np.asarray(modulus)


def require_hookean(cable: Cable) -> None:
    """Refuses a rope beyond Hooke's law on behalf of a solver that does not know of it.

    Raises:
        ValueError: If the cable hardens or relaxes, naming the field.
    """
    for field in ("quadratic_hardening", "cubic_hardening", "relaxing_stiffness"):
        value = getattr(cable, field)
        if value != 0.0:
            raise ValueError(
                f"Cable.{field} must be 0 here, got {value!r}: only the environment and the axial, planar, "
                "lumped-mass and static solvers know ropes beyond Hooke's law; put a tangent stiffness into "
                "axial_stiffness"
            )
