"""The law of the cable's material, the same for every solver.

T = EA e + C_A De/Dt, and no compression if the cable is tension-only. Over a time step the mean tension is
the change of the stored energy over the change of strain (a discrete gradient), so that going slack and
snapping taut neither makes nor loses energy, however stiff the elements; for a linear cable that is the
tension at mid-step.

Source: Huang (1992), (3.1), with Kelvin damping; discrete gradient after Gonzalez (1996).
"""

from __future__ import annotations

from heave_env.compiled import stage


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
def taut_tension(old, new, EA, CA, per_dt, zero, half, one):
    """Mean tension of a tension-only element over a step from strain `old` to `new`, and d/d(new).

    Kelvin damping acts on the taut part of the strain, and what would still be compression is zero. Written
    without branches, so that it runs over lanes; the constants come in the lanes' precision.
    """
    taut_new, taut_old = max(new, zero), max(old, zero)
    crosses = (new > zero) != (old > zero)
    change = new - old if crosses else one
    gained = half * (taut_new * taut_new - taut_old * taut_old) / change
    mean = gained if crosses else half * (taut_new + taut_old)
    slope = (taut_new - gained) / change if crosses else (half if new > zero else zero)
    tension = EA * mean + CA * per_dt * (taut_new - taut_old)
    stiffness = EA * slope + (CA * per_dt if new > zero else zero)
    stiffness = stiffness if tension > zero else zero
    tension = tension if tension > zero else zero
    return tension, stiffness


@stage
def mean_tension(old, new, EA, CA, per_dt, tension_only):
    """Mean tension over a step from strain `old` to `new`, and its derivative by `new` [N, N].

    `per_dt` is one over the time step. Energy EA (new² - old²)/2 is what the mean does, exactly.
    """
    if tension_only:
        return taut_tension(old, new, EA, CA, per_dt, 0.0, 0.5, 1.0)
    return EA * 0.5 * (old + new) + CA * per_dt * (new - old), 0.5 * EA + CA * per_dt
