"""Ropes by kind, diameter and breaking strength, from published coefficients.

    lifting = steel_wire_rope(0.036)
    soft = nylon_rope(0.080, breaking_strength=1.3e6)

Steel wire rope is all but Hookean. Fibre ropes harden, and are stiffer in waves than under a slowly changing
load. For them the library of MoorPy (Hall et al. 2021) gives, per breaking strength B, the stiffness in slow
loading Ks and that of small fast motion about a mean tension T, dT/de = α B + β T. The line in T says that
the tension of fast loading is an exponential of the strain, T = (α B/β)(exp(β e) - 1). The cubic that shares
its slope at no load, and its value and slope where it carries `HARDENING_LOAD` of the strength, is the
hardening law: with X = ln(1 + β HARDENING_LOAD/α) and E = exp(X) - 1,

    T = α B (e + k2 e² + k3 e³),   k2 = β (3 (E - X) - X E)/X²,   k3 = β² (X E - 2 (E - X))/X³

From its stiffness α B the Maxwell branch takes EA1, so that the relaxed rope, slowly loaded to `SLOW_LOAD` of
its strength, has stretched by SLOW_LOAD/Ks; what remains is EA.

Assumed, for want of a source that gives it: the two reference loads, the relaxation time, damping, and the
thesis's coefficient of tangential drag. Stops holding above about half the strength, for new ropes (which bed
in), and where the mean load changes slowly by much: creep and the shift of the unstretched length are left
out.

Source: Hall et al. (2021), the library of line properties; EN 12385-4 (2002) for the wire rope's mass and
strength; Feyrer (2015) for its modulus.
"""

from __future__ import annotations

import math

from heave_env.parameters import GRAVITY, SEAWATER_DENSITY, Cable

SLOW_LOAD = 0.2
"""Load over breaking strength up to which a fibre rope's slow stiffness is met, assumed [-]."""
HARDENING_LOAD = 0.3
"""Load over breaking strength at which its cubic law meets the exponential one, assumed [-]."""
KELVIN_TIME = 0.005
"""Axial damping over stiffness of the wire rope, assumed as in the named scenarios [s]."""
TANGENTIAL_DRAG = 0.025
"""Tangential drag coefficient, that of the thesis's cable [-]."""
LOSS_FACTOR = {"polyester": 0.05, "nylon": 0.10}
"""Loss factor of fibre ropes at `LOSS_OMEGA`, met by Kelvin damping, assumed [-]."""
LOSS_OMEGA = 0.8
"""Frequency at which the loss factor is met [rad/s]."""
RELAXATION_TIME = 100.0
"""Relaxation time of fibre ropes: far above a wave's period, far below that of a tide; assumed [s]."""


def steel_wire_rope(diameter: float, breaking_strength: float | None = None) -> Cable:
    """A 6x36 wire rope with a wire core, bare, grade 1960: Hookean, tension-only.

    Mass 4090 d² [kg/m]; strength 0.356 · 1960e6 d² [N]; EA = 100e9 · 0.46 d² [N].

    Source: EN 12385-4 (2002), factors of mass, metallic area and strength of the 6x36 class with wire core;
    Feyrer (2015), rope modulus about 100 GPa.

    Args:
        diameter: Nominal diameter [m].
        breaking_strength: Minimum breaking force [N]; that of the grade if not given.

    Raises:
        ValueError: If a number is not positive.
    """
    strength = 0.356 * 1960e6 * diameter**2 if breaking_strength is None else breaking_strength
    mass, stiffness = 4090.0 * diameter**2, 100e9 * 0.46 * diameter**2
    return Cable(
        mass_per_length=mass,
        axial_stiffness=stiffness,
        submerged_weight=_weight_in_water(mass, 7850.0),
        diameter=diameter,
        tangential_drag_coefficient=TANGENTIAL_DRAG,
        axial_damping=KELVIN_TIME * stiffness,
        tension_only=True,
        breaking_strength=strength,
    )


def polyester_rope(diameter: float, breaking_strength: float | None = None) -> Cable:
    """A polyester mooring or lifting rope: hardening, with a Maxwell branch, tension-only.

    Mass 679 d² [kg/m], strength 308e6 d² [N], Ks = 14, α = 11.6, β = 40.

    Source: Hall et al. (2021).

    Args:
        diameter: Nominal diameter [m].
        breaking_strength: Minimum breaking load [N]; the published one of that diameter if not given.

    Raises:
        ValueError: If a number is not positive.
    """
    strength = 308e6 * diameter**2 if breaking_strength is None else breaking_strength
    return _fibre_rope("polyester", diameter, strength, 679.0, 1380.0, slow=14.0, fast=11.6, growth=40.0)


def nylon_rope(diameter: float, breaking_strength: float | None = None) -> Cable:
    """A nylon rope: soft and hardening, tension-only; its published stiffnesses leave no Maxwell branch.

    Mass 585 d² [kg/m], strength 207e6 d² + 230e6 d³ [N], Ks = 5, α = 2.08, β = 39.

    Source: Hall et al. (2021).

    Args:
        diameter: Nominal diameter [m].
        breaking_strength: Minimum breaking load [N]; the published one of that diameter if not given.

    Raises:
        ValueError: If a number is not positive.
    """
    strength = (207e6 + 230e6 * diameter) * diameter**2 if breaking_strength is None else breaking_strength
    return _fibre_rope("nylon", diameter, strength, 585.0, 1140.0, slow=5.0, fast=2.08, growth=39.0)


def _fibre_rope(
    kind: str,
    diameter: float,
    strength: float,
    mass_per_square: float,
    density: float,
    *,
    slow: float,
    fast: float,
    growth: float,
) -> Cable:
    """The rope whose stiffnesses over its strength are `slow` and `fast + growth · T/B`."""
    X = math.log1p(growth * HARDENING_LOAD / fast)
    E = math.expm1(X)
    k2 = growth * (3.0 * (E - X) - X * E) / X**2
    k3 = growth**2 * (X * E - 2.0 * (E - X)) / X**3
    e = SLOW_LOAD / slow
    branch = max(fast * (1.0 + k2 * e + k3 * e**2) - slow, 0.0)
    relaxed = fast - branch
    mass = mass_per_square * diameter**2
    return Cable(
        mass_per_length=mass,
        axial_stiffness=relaxed * strength,
        submerged_weight=_weight_in_water(mass, density),
        diameter=diameter,
        tangential_drag_coefficient=TANGENTIAL_DRAG,
        axial_damping=LOSS_FACTOR[kind] * slow * strength / LOSS_OMEGA,
        tension_only=True,
        breaking_strength=strength,
        quadratic_hardening=k2 * fast / relaxed,
        cubic_hardening=k3 * fast / relaxed,
        relaxing_stiffness=branch * strength,
        relaxation_time=RELAXATION_TIME,
    )


def _weight_in_water(mass_per_length: float, density: float) -> float:
    """Weight in sea water per length of a rope whose material has a density in kg/m³ [N/m]."""
    return mass_per_length * GRAVITY * (1.0 - SEAWATER_DENSITY / density)
