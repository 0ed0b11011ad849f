"""The passive compensator between boom tip and sheave: gas spring, damper, moving mass, stops.

The sheave stands at boom tip + c, with c the extension of the rod, positive up from mid-stroke:

    m c'' = F(c) - D c' - T,   F(c) = F0 (1 + c/g)^-κ,   |c| at most half the stroke

F0 is the force at mid-stroke (the static tension), g the length of the gas column there, volume over piston
area, T the tension at the sheave. Gas law: polytropic; friction of the seals is left out. Over a solver
step the midpoint rule, T being the cable's mean tension; cable and rod are solved together.
"""

from __future__ import annotations

from heave_env.compiled import stage
from heave_env.lanes import constant
from heave_env.layout import (
    COMPENSATOR_DAMPING,
    COMPENSATOR_MASS,
    COMPENSATOR_OLD,
    COMPENSATOR_RATE,
    GAS_EXPONENT,
    GAS_FORCE,
    GAS_LENGTH,
    HALF_STROKE,
)


@stage
def rod_gap(S, W, rod, tension, dt):
    """What is missing to the rod's momentum balance if it ends the step at `rod` under this tension [N].

    Of one lane.
    """
    half, one, two = constant(S, 0.5), constant(S, 1.0), constant(S, 2.0)
    per_dt = one / constant(S, dt)
    old, rate = W[COMPENSATOR_OLD], S[COMPENSATOR_RATE]
    middle_rate = (rod - old) * per_dt
    # Past the end of the gas column there is no force to compute; the stops come before it.
    column = max(one + half * (rod + old) / S[GAS_LENGTH], constant(S, 1e-3))
    force = S[GAS_FORCE] * column ** (-S[GAS_EXPONENT])
    inertia = S[COMPENSATOR_MASS] * two * (middle_rate - rate) * per_dt
    return inertia - force + S[COMPENSATOR_DAMPING] * middle_rate + tension


@stage
def stopped_rod(S, rod):
    """The rod's end of step within its stops."""
    stroke = S[HALF_STROKE]
    return max(min(rod, stroke), -stroke)
