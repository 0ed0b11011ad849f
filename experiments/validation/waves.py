"""Natural modes against rods, strings, chains, pendulums and Irvine and Caughey's sagged cable."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.special import jn_zeros

from experiments.figures import COLOURS
from experiments.validation.checks import (
    Finding,
    Picture,
    absolute,
    at_least,
    at_most,
    relative,
    validation,
)
from heave_env.cable.closed_form import natural_omegas
from heave_env.cable.statics import FixedEnds, StaticsSolver, Towed
from heave_env.cable.waves import (
    IN_PLANE,
    OUT_OF_PLANE,
    WavesSolver,
    hanging_line,
    inclined_line,
    longitudinal_wave_speed,
    transverse_wave_speed,
    travel_times,
)
from heave_env.parameters import GRAVITY, SEAWATER_DENSITY, Cable, Current, Line, Payload

Array = np.ndarray

THESIS_CABLE = Cable(
    mass_per_length=7.2,
    axial_stiffness=9.09e9 * 0.25 * math.pi * 0.047**2,
    submerged_weight=54.0,
    diameter=0.047,
)
"""The cable of Huang (1992), 6.2.6."""
THESIS_UNIT = Payload(mass=125_000.0, submerged_weight=50_000.0)
"""Its unit, added mass included."""


def string(*, mass: float = 1.0, stiffness: float = 1.0e7, weight: float = 0.0) -> Cable:
    """A cable without water around it."""
    return Cable(
        mass_per_length=mass,
        axial_stiffness=stiffness,
        submerged_weight=weight,
        diameter=0.02,
        normal_drag_coefficient=0.0,
        normal_added_mass_coefficient=0.0,
    )


@validation("closed form")
def rod_with_an_end_mass() -> Iterator[Finding]:
    """Longitudinal modes of the hanging 900 m cable of Huang 6.2.6, found among all modes by their stretch,
    against tan(ωL/c) = (m + m_a) c / (ω M), and the first two against print (0.3712 and 5.193 rad/s, to 0.1
    %: the modulus is printed to three digits). 100 elements: 1e-5."""
    shape = hanging_line(Line.uniform(THESIS_CABLE, 900.0), THESIS_UNIT)
    modes = WavesSolver(shape=shape, n_modes=80).solve()
    ours = modes.omega[modes.stretch_share > 0.5][:3]
    exact = natural_omegas(THESIS_CABLE, THESIS_UNIT, 900.0, 3)
    for n in range(2):
        yield relative(f"longitudinal mode {n + 1} [rad/s]", ours[n], exact[n], 1e-5)
    for n, printed in enumerate((0.3712, 5.193)):
        yield relative(f"longitudinal mode {n + 1} against print [rad/s]", ours[n], printed, 1e-3)


@validation("closed form")
def taut_string() -> Iterator[Finding]:
    """Modes of a weightless string, level, inclined and upright: n π/L sqrt(T / (m (1 + e))) across, in and
    out of the plane alike, L unstretched, and n π/L sqrt(EA/m) along. 40 elements leave (nπ/40)⁴/480: 6e-6
    at the third."""
    for name, lower in (
        ("level", (-100.2, 0.0, 0.0)),
        ("inclined", (-60.12, 0.0, -80.16)),
        ("upright", (0.0, 0.0, -100.2)),
    ):
        shape = inclined_line(Line.uniform(string(), 100.0), lower, (0.0, 0.0, 0.0), n_segments=40)
        T = float(shape.tension[0])
        modes = WavesSolver(shape=shape, n_modes=60).solve()
        across = modes.of(OUT_OF_PLANE).omega[:3]
        speed = math.sqrt(T / (1.0 + T / 1.0e7))
        for n in range(3):
            exact = (n + 1) * math.pi / 100.0 * speed
            yield relative(f"mode {n + 1} across, {name} [rad/s]", across[n], exact, 1e-5)
        inside = modes.of(IN_PLANE).omega[0]
        yield relative(f"mode 1 in the plane, {name} [rad/s]", inside, math.pi / 100.0 * speed, 1e-6)
        along = modes.omega[modes.stretch_share > 0.5][0]
        exact = math.pi / 100.0 * math.sqrt(1.0e7)
        yield relative(f"mode 1 along, {name} [rad/s]", along, exact, 1e-6)


def chain_omegas(n_segments: int) -> Array:
    """First modes of a free chain hanging in air, 100 m, all but inextensible [rad/s]."""
    chain = dataclasses.replace(string(stiffness=1.0e10, weight=GRAVITY))
    speck = Payload(mass=1e-7, submerged_weight=1e-6)
    shape = hanging_line(Line.uniform(chain, 100.0), speck, n_segments=n_segments)
    return WavesSolver(shape=shape, n_modes=8).solve().of(IN_PLANE).omega


@validation("closed form")
def hanging_chain() -> Iterator[Finding]:
    """A chain hanging free in air: ω = (j0n / 2) sqrt(g / L), j0n the zeros of the Bessel function J0. Its
    tension ends at zero, so linear elements are second order here (observed within 0.1); 200 of them leave
    0.03 % at the fourth mode."""
    exact = 0.5 * jn_zeros(0, 4) * math.sqrt(GRAVITY / 100.0)
    ours = chain_omegas(200)
    for n, tolerance in enumerate((1e-5, 1e-4, 3e-4, 5e-4)):
        yield relative(f"mode {n + 1} [rad/s]", ours[n], exact[n], tolerance)
    errors = [abs(chain_omegas(n)[0] / exact[0] - 1.0) for n in (20, 40)]
    yield absolute("observed order, mode 1 [-]", math.log2(errors[0] / errors[1]), 2.0, 0.1)
    yield Picture("Modes of a hanging chain: lines, 200 elements; dots, J0(j0n sqrt(s/L))", _draw_chain)


def _draw_chain(figure: Any) -> None:
    from scipy.special import j0

    chain = dataclasses.replace(string(stiffness=1.0e10, weight=GRAVITY))
    shape = hanging_line(
        Line.uniform(chain, 100.0), Payload(mass=1e-7, submerged_weight=1e-6), n_segments=200
    )
    modes = WavesSolver(shape=shape, n_modes=8).solve().of(IN_PLANE)
    axes = figure.subplots()
    points = np.linspace(0.0, 1.0, 26)
    for n, zero in enumerate(jn_zeros(0, 3)):
        sideways = modes.displacement[n][:, 0]
        sign = math.copysign(1.0, sideways[0])
        axes.plot(
            sign * sideways, modes.arc_length, color=COLOURS[1 + n], label=f"{modes.omega[n]:.3f} rad/s"
        )
        axes.plot(j0(zero * np.sqrt(points)), 100.0 * points, "o", ms=3, color=COLOURS[1 + n])
    axes.set_xlabel("displacement over that of the free end [-]")
    axes.set_ylabel("distance from the free end [m]")
    axes.legend(fontsize=8)


@validation("closed form")
def pendulum() -> Iterator[Finding]:
    """A heavy unit on a light line: sqrt(g/L) in air, sqrt(w2 / ((M + M_a) L)) in water, L stretched. The
    line's mass is 1e-7 of the unit's: 1e-6."""
    light = string(mass=1e-5)
    for name, unit in (
        ("in air", Payload(mass=5000.0, submerged_weight=5000.0 * GRAVITY)),
        ("in water", Payload(mass=5000.0, added_mass=4000.0, submerged_weight=30_000.0)),
    ):
        shape = hanging_line(Line.uniform(light, 50.0), unit, n_segments=20)
        omega = WavesSolver(shape=shape, n_modes=2).solve().omega
        stretched = 50.0 * (1.0 + unit.submerged_weight / 1.0e7)
        exact = math.sqrt(unit.submerged_weight / (unit.inertia * stretched))
        yield relative(f"swing {name}, one way [rad/s]", omega[0], exact, 1e-6)
        yield relative(f"swing {name}, the other way [rad/s]", omega[1], exact, 1e-6)


@validation("closed form")
def damping_of_a_swinging_unit() -> Iterator[Finding]:
    """A unit on a light dragless line in a current U hangs at the angle tan θ = D / w2. Its drag D = k U²
    damps a swing across the current with k U and one along it with 2 k U cos² θ: ratios over critical, exact
    but for the line's mass, 1e-5."""
    unit = Payload(mass=3000.0, submerged_weight=20_000.0, drag_area=8.0)
    ends = Towed(payload=unit)
    current = Current.uniform(1.5)
    shape = StaticsSolver(
        line=Line.uniform(string(mass=1e-4), 80.0), ends=ends, current=current, n_segments=20
    ).solve()
    modes = WavesSolver(shape=shape, n_modes=2).solve()
    k = 0.5 * SEAWATER_DENSITY * 8.0
    tension = math.hypot(k * 1.5**2, 20_000.0)
    omega = math.sqrt(tension / (3000.0 * 80.0 * (1.0 + tension / 1.0e7)))
    cosine = 20_000.0 / tension
    across = modes.damping_ratio[modes.family.index(OUT_OF_PLANE)]
    along = modes.damping_ratio[modes.family.index(IN_PLANE)]
    yield relative("swing across the current [rad/s]", modes.of(OUT_OF_PLANE).omega[0], omega, 1e-5)
    yield relative("damping ratio across the current [-]", across, k * 1.5 / (2.0 * 3000.0 * omega), 1e-5)
    along_exact = 2.0 * k * 1.5 * cosine**2 / (2.0 * 3000.0 * omega)
    yield relative("damping ratio along the current [-]", along, along_exact, 1e-5)


def symmetric_phases(parameter: float, n_modes: int) -> Array:
    """ωL sqrt(m/H) of the symmetric in-plane modes of a sagged cable of parameter λ².

    tan(x/2) = x/2 - (4/λ²)(x/2)³: Irvine and Caughey (1974).
    """

    def miss(x: float) -> float:
        half = 0.5 * x
        return math.sin(half) - (half - 4.0 / parameter * half**3) * math.cos(half)

    grid = np.linspace(0.3, 7.0 * math.pi, 4000)
    values = np.array([miss(float(x)) for x in grid])
    at = np.flatnonzero(values[:-1] * values[1:] < 0.0)[:n_modes]
    return np.array([brentq(miss, grid[i], grid[i + 1], xtol=1e-13) for i in at])


def sagged_modes(sag: float, stiffness: float) -> tuple[Array, Array, float, float]:
    """In-plane and out-of-plane modes of a level span of 100 m and 1 kg/m in air, λ², and sqrt(H/m)/L."""
    span, w = 100.0, GRAVITY
    H = w * span / (8.0 * sag)
    cable = string(stiffness=stiffness, weight=w)

    def pull(length: float) -> float:
        line = Line.uniform(cable, length)
        shape = inclined_line(line, (-span, 0.0, 0.0), (0.0, 0.0, 0.0), n_segments=4)
        return float(shape.force[0, 0])

    guess = span * (1.0 + 8.0 / 3.0 * sag**2 - H / stiffness)
    length = brentq(lambda l: pull(l) - H, guess - 0.3, guess + 0.3, xtol=1e-12)
    shape = inclined_line(Line.uniform(cable, length), (-span, 0.0, 0.0), (0.0, 0.0, 0.0), n_segments=100)
    modes = WavesSolver(shape=shape, n_modes=12).solve()
    parameter = (w * span / H) ** 2 * span / (H * span * (1.0 + 8.0 * sag**2) / stiffness)
    return modes.of(IN_PLANE).omega, modes.of(OUT_OF_PLANE).omega, parameter, math.sqrt(H) / span


@validation("closed form")
def sagged_cable() -> Iterator[Finding]:
    """In-plane and out-of-plane modes of a level cable of sag 1/50 and 1/100 from stretchy to inextensible,
    across the point λ² = 4π² where the first symmetric and antisymmetric modes cross, against the linear
    theory of Irvine and Caughey (1974). The theory leaves out terms of the order of the slope squared, (4
    sag)² = 0.6 % at 1/50, and the strain H/EA: 1 % and 0.3 %."""
    for sag, stiffness, tolerance in (
        (0.02, 1.0e6, 0.01),
        (0.02, 1.0e7, 0.01),
        (0.01, 1.0e6, 0.01),
        (0.01, 1.0e8, 0.003),
    ):
        inside, across, parameter, unit = sagged_modes(sag, stiffness)
        theory = np.sort(np.concatenate([symmetric_phases(parameter, 3), 2.0 * math.pi * np.arange(1, 4)]))
        for n in range(3):
            name = f"in-plane mode {n + 1}, sag {sag:g}, λ² {parameter:.3g} [rad/s]"
            yield relative(name, inside[n], theory[n] * unit, tolerance)
        yield relative(f"out-of-plane mode 1, sag {sag:g} [rad/s]", across[0], math.pi * unit, tolerance)
    yield Picture(
        "In-plane modes of a level cable, sag 1/50: lines, Irvine and Caughey (1974); dots, 100 elements",
        _draw_sagged,
    )


def _draw_sagged(figure: Any) -> None:
    axes = figure.subplots()
    parameters = np.logspace(-0.5, 3.5, 120)
    phases = np.array([symmetric_phases(float(one), 2) for one in parameters]) / math.pi
    for n in range(2):
        label = "symmetric" if n == 0 else None
        axes.plot(parameters, phases[:, n], color=COLOURS[3], label=label)
        label = "antisymmetric" if n == 0 else None
        axes.axhline(2.0 * (n + 1), color=COLOURS[2], ls="--", label=label)
    for k, stiffness in enumerate(np.logspace(5.2, 8.2, 10)):
        inside, _, parameter, unit = sagged_modes(0.02, float(stiffness))
        label = "100 elements" if k == 0 else None
        axes.plot(
            np.full(3, parameter), inside[:3] / unit / math.pi, "o", ms=4, color=COLOURS[1], label=label
        )
    axes.set_xscale("log")
    axes.set_xlabel("λ² [-]")
    axes.set_ylabel("ω L sqrt(m/H) / π [-]")
    axes.legend(fontsize=8)


@validation("closed form")
def wave_speeds() -> Iterator[Finding]:
    """Speeds sqrt(EA/(m + m_a)) and sqrt(T/((m + m_n)(1 + e))) (Huang 12.20, 12.23), read off the modes of a
    string in water as ω L/(n π): 1e-5 with 100 elements; and the time a transverse wave takes up a hanging
    cable, 2 sqrt(μ) (sqrt(T_top) - sqrt(T_bottom))/w with 1 + e as one (the strain is 1 %): 1 %."""
    cable = Cable(
        mass_per_length=2.0,
        axial_stiffness=1.0e7,
        submerged_weight=0.0,
        diameter=0.04,
        added_mass_per_length=0.5,
    )
    shape = inclined_line(Line.uniform(cable, 200.0), (-120.36, 0.0, -160.48), (0.0, 0.0, 0.0))
    modes = WavesSolver(shape=shape, n_modes=100).solve()
    displaced = 0.25 * math.pi * SEAWATER_DENSITY * 0.04**2
    T = float(shape.tension[0])
    transverse = math.sqrt(T / ((2.0 + displaced) * (1.0 + T / 1.0e7)))
    across = modes.of(OUT_OF_PLANE).omega[2] * 200.0 / (3.0 * math.pi)
    along = modes.omega[modes.stretch_share > 0.5][0] * 200.0 / math.pi
    yield relative("transverse speed from the third mode [m/s]", across, transverse, 1e-5)
    yield relative("longitudinal speed from the first mode [m/s]", along, math.sqrt(1.0e7 / 2.5), 1e-5)
    yield relative("transverse speed [m/s]", float(transverse_wave_speed(cable, T)), transverse, 1e-12)
    yield relative("longitudinal speed [m/s]", longitudinal_wave_speed(cable), math.sqrt(1.0e7 / 2.5), 1e-12)
    hanging = hanging_line(Line.uniform(THESIS_CABLE, 900.0), THESIS_UNIT)
    _, slow = travel_times(hanging)
    mu = 7.2 + 0.25 * math.pi * SEAWATER_DENSITY * 0.047**2
    exact = 2.0 * math.sqrt(mu) * (math.sqrt(98_600.0) - math.sqrt(50_000.0)) / 54.0
    yield relative("transverse travel time over 900 m [s]", slow, exact, 0.01)


@validation("order of convergence")
def modes_order() -> Iterator[Finding]:
    """Halving the elements: fourth order on a uniform taut string (the errors of lumped and consistent mass
    cancel), second on a sagged inclined cable; each within 0.15."""

    def first_of_string(n: int) -> float:
        shape = inclined_line(Line.uniform(string(), 100.0), (-100.2, 0, 0), (0.0, 0.0, 0.0), n_segments=n)
        return float(WavesSolver(shape=shape, n_modes=4).solve().of(OUT_OF_PLANE).omega[1])

    shape = inclined_line(Line.uniform(string(), 100.0), (-100.2, 0.0, 0.0), (0.0, 0.0, 0.0), n_segments=4)
    T = float(shape.tension[0])
    exact = 2.0 * math.pi / 100.0 * math.sqrt(T / (1.0 + T / 1.0e7))
    errors = [abs(first_of_string(n) - exact) for n in (10, 20)]
    yield absolute("order on a taut string [-]", math.log2(errors[0] / errors[1]), 4.0, 0.15)

    def first_of_sagged(n: int) -> float:
        cable = string(stiffness=1.0e6, weight=20.0)
        ends = FixedEnds(lower=(-200.0, 0.0, -150.0), upper=(0.0, 0.0, 0.0))
        shape = StaticsSolver(line=Line.uniform(cable, 270.0), ends=ends, n_segments=n).solve()
        return float(WavesSolver(shape=shape, n_modes=4).solve().of(IN_PLANE).omega[0])

    results = [first_of_sagged(n) for n in (20, 40, 80)]
    changes = np.abs(np.diff(results))
    yield absolute("order on a sagged cable [-]", math.log2(changes[0] / changes[1]), 2.0, 0.15)


@validation("invariant")
def modes_of_a_turned_line() -> Iterator[Finding]:
    """A current turned about the vertical turns the modes and changes no frequency (1e-8: rounding of a
    stiff system); a line in a current that turns with depth lies in no plane, and its modes belong to
    neither family. Drag damps every mode."""
    unit = Payload(mass=1000.0, submerged_weight=3000.0, drag_area=1.0)
    cable = dataclasses.replace(THESIS_CABLE, tangential_drag_coefficient=0.01)

    def omegas(turn: float, shear: float) -> Any:
        current = Current(depth=(0.0, 300.0), speed=(0.6, 0.2), direction=(turn, turn + shear))
        shape = StaticsSolver(
            line=Line.uniform(cable, 300.0), ends=Towed(payload=unit), current=current, n_segments=40
        ).solve()
        return WavesSolver(shape=shape, n_modes=6).solve()

    reference = omegas(0.0, 0.0)
    turned = omegas(1.1, 0.0)
    yield at_most(
        "greatest change of a frequency [-]",
        float(np.abs(turned.omega / reference.omega - 1.0).max()),
        1e-8,
    )
    spatial = omegas(0.0, 1.5)
    yield at_most(
        "modes of a twisted line that lie in a plane [-]", sum(one != "spatial" for one in spatial.family), 0
    )
    yield at_least("least damping ratio [-]", float(spatial.damping_ratio.min()), 1e-3)
