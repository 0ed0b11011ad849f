"""The sagged span against closed forms, linear theory, its own order, conservation and Moustafa's text."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from experiments.cases.sagged_span import moustafa_cable, moustafa_span
from experiments.validation.checks import (
    Finding,
    Picture,
    Unmatched,
    absolute,
    at_least,
    at_most,
    relative,
    validation,
)
from heave_env.cable.catenary import Catenary, hanging_span, length_of_force, length_of_sag
from heave_env.cable.sagged_span import SaggedSpanSolver
from heave_env.parameters import Cable, Current

Array = np.ndarray

DIAMETER, LENGTH, SPAN, MASS = 0.01, 10.9774, 10.7920, 0.61
"""Moustafa (2001), section 4: cable diameter [m], length [m], span [m], mass per length [kg/m]."""
PUBLISHED_FREQUENCY = 0.55
"""ω_f of the same table [Hz]."""


def _tested_span() -> SaggedSpanSolver:
    """The span of Moustafa's tests."""
    return SaggedSpanSolver(cable=moustafa_cable(), length=LENGTH, span=SPAN)


@cache
def extremes(
    amplitude: float,
    frequency: float,
    modulus: float = 1e11,
    length: float = LENGTH,
    strain: str = "engineering",
) -> tuple[float, float]:
    """Largest and least tension at the driven end in the steady state [N]."""
    return replace(
        moustafa_span(),
        cable=moustafa_cable(modulus),
        length=length,
        upper_amplitude=(amplitude, 0.0, 0.0),
        frequency=frequency,
        strain=strain,
        steps_per_period=max(200, math.ceil(200.0 / frequency)),
    ).extremes()


def _light_line(weight: float = 5.19, stiffness: float = 7.85e6) -> Cable:
    return Cable(mass_per_length=MASS, axial_stiffness=stiffness, submerged_weight=weight, diameter=DIAMETER)


def _end_by_integration(found: Catenary) -> Array:
    """Where the upper end comes to if statics is integrated from the lower end with the forces found [m]."""

    def slope(s: float, _: Array) -> Array:
        V = found.lower_vertical_force + found.cable.submerged_weight * s
        T = math.hypot(found.horizontal_force, V)
        stretch = (1.0 + T / found.cable.axial_stiffness) / T
        return np.array([found.horizontal_force * stretch, V * stretch])

    solution = solve_ivp(slope, (0.0, found.length), np.zeros(2), rtol=1e-12, atol=1e-12, method="DOP853")
    return np.asarray(solution.y[:, -1])


@validation("closed form")
def sagged_span_catenary() -> Iterator[Finding]:
    """Static shapes: integrating the equations of statics from the lower end meets the upper support, for a
    wire, a rope stretched by 5 %, a floating rope, a taut wire and a weightless one; 1e-8 of the length, the
    integration's own error being 1e-11. A stiff level span has the force of sinh(β)/β = S/L.
    """
    for name, cable, length, span, height in (
        ("Moustafa's wire", _light_line(), LENGTH, SPAN, 0.0),
        ("rope, stretched", _light_line(stiffness=2e3), 100.0, 100.0, 30.0),
        ("floating rope", _light_line(weight=-2.0), 130.0, 100.0, 40.0),
        ("taut wire", _light_line(), 111.8, 100.0, 50.0),
        ("weightless rope", _light_line(weight=0.0, stiffness=1e4), 100.0, 101.0, 0.0),
        ("deep and steep", _light_line(), 60.0, 10.0, 25.0),
    ):
        x, z = _end_by_integration(hanging_span(cable, length, span, height))
        yield relative(f"{name}: distance reached [m]", x, span, 1e-8)
        yield absolute(f"{name}: height reached [m]", z, height, 1e-8 * length)
    stiff = _light_line(stiffness=1e15)
    beta = brentq(lambda b: math.sinh(b) / b - LENGTH / SPAN, 1e-3, 5.0, xtol=1e-14)
    found = hanging_span(stiff, LENGTH, SPAN, 0.0)
    yield relative(
        "stiff level span: horizontal force [N]", found.horizontal_force, 5.19 * SPAN / (2.0 * beta), 1e-8
    )
    sag = SPAN * (math.cosh(beta) - 1.0) / (2.0 * beta)
    yield relative("stiff level span: sag [m]", found.sag, sag, 1e-8)
    yield relative("length found from the sag [m]", length_of_sag(stiff, SPAN, 0.0, sag), LENGTH, 1e-8)


@validation("closed form")
def sagged_span_rests() -> Iterator[Finding]:
    """A span left alone stays where it hangs, with the closed form's tensions, on a coarse grid too; what
    moves is rounding, of 1e7 N of stiffness over 1e-16 of strain.
    """
    for n_elements in (4, 50):
        solver = replace(_tested_span(), n_elements=n_elements, height=3.0, length=12.0)
        record = solver.simulate(upper=np.zeros(401), dt=0.01)
        ends = solver.catenary.tension(np.array([0.0, 12.0]))
        yield absolute(
            f"{n_elements} elements: largest motion [m]", np.abs(record.state.displacement).max(), 0.0, 1e-10
        )
        yield relative(f"{n_elements} elements: lower tension [N]", record.lower_tension[-1], ends[0], 1e-9)
        yield relative(f"{n_elements} elements: upper tension [N]", record.upper_tension[-1], ends[1], 1e-9)


@validation("closed form")
def sagged_span_slow_pull() -> Iterator[Finding]:
    """Supports moved slowly, far and in both directions: tension and middle are those of the catenary
    between the new places. 0.1 % of tension for 60 s of motion and 50 elements: the grid's own error there,
    and what still swings.
    """
    solver = replace(_tested_span(), height=2.0, length=12.0)
    dt = 0.02
    time = dt * np.arange(4001)
    share = np.sin(0.5 * np.pi * np.minimum(time / 60.0, 1.0)) ** 2
    lower, upper = np.outer(share, [-0.4, 0.0, 0.5]), np.outer(share, [0.35, 0.0, -2.0])
    record = solver.simulate(lower, upper, dt=dt)
    # The former lower support is now the higher one, by half a metre: the shape is mirrored.
    there = hanging_span(solver.cable, 12.0, SPAN + 0.75, 0.5)
    tensions = there.tension(np.array([0.0, 12.0]))
    yield relative("tension at the upper end [N]", record.upper_tension[-1], float(tensions[0]), 1e-3)
    yield relative("tension at the lower end [N]", record.lower_tension[-1], float(tensions[1]), 1e-3)
    middle = there.position(np.array(6.0))
    reached = solver.position(record.state)[solver.n_elements // 2]
    yield absolute("middle, along the span [m]", reached[0], SPAN + 0.35 - middle[0], 5e-3)
    yield absolute("middle, height [m]", reached[2], middle[2], 5e-3)


def irvine_tension(omega: Array, cable: Cable, span: float, horizontal_force: float) -> Array:
    """Tension amplitude per metre of horizontal motion of one support, shallow parabola, no damping [N/m].

    h = 1 / (Le/EA - (q/(H ω))² / m (L - (2/k) tan(kL/2))),  k = ω sqrt(m/H)

    Source: Irvine (1981), linear theory of the parabolic cable, with a moving support.
    """
    q, m, H, L = cable.submerged_weight, cable.transverse_inertia_per_length, horizontal_force, span
    k = omega * math.sqrt(m / H)
    virtual = L * (1.0 + (q * L / H) ** 2 / 8.0)
    compliance = virtual / cable.axial_stiffness - (q / (H * omega)) ** 2 / m * (
        L - 2.0 / k * np.tan(0.5 * k * L)
    )
    return np.asarray(1.0 / compliance)


def irvine_symmetric_mode(parameter: float) -> float:
    """First symmetric in-plane frequency over that of the taut string's first, from Irvine's λ² [-]."""

    def balance(x: float) -> float:
        return math.sin(x) - (x - 4.0 / parameter * x**3) * math.cos(x)

    # x is half of ω L sqrt(m/H): between the first symmetric mode of the string and the third.
    return brentq(balance, 0.5 * math.pi + 1e-6, 1.5 * math.pi - 1e-9) / (0.5 * math.pi)


@validation("closed form")
def sagged_span_linear_modes() -> Iterator[Finding]:
    """Natural frequencies of a shallow span, sag 1/50, in air, below and above Irvine's crossover λ² = 4π²:
    swinging out of plane, antisymmetric and first symmetric mode. Irvine's theory leaves out the square of
    the slope, 16 (sag/span)² = 0.6 %, so 1 %.
    """
    span, sag = 100.0, 2.0
    for label, stiffness in (("soft", 2.0e4), ("crossover", 1.3e5), ("stiff", 1.0e7)):
        cable = _light_line(stiffness=stiffness).in_air()
        length = length_of_sag(cable, span, 0.0, sag)
        solver = SaggedSpanSolver(cable=cable, length=length, span=span, n_elements=100)
        H, mass = solver.catenary.horizontal_force, MASS * length / span
        string = math.pi / span * math.sqrt(H / mass)
        ratio = cable.submerged_weight * length / H
        parameter = ratio**2 * span / (H * span * (1.0 + ratio**2 / 8.0) / stiffness)
        omegas, shapes = solver.modes(8)
        weights = np.abs(shapes).sum(axis=1)
        out_of_plane = omegas[weights[:, 1] > weights[:, 2]]
        vertical = [k for k in range(8) if weights[k, 2] > weights[k, 1]]
        tilt = np.abs(shapes[:, :, 2].sum(axis=1)) / np.maximum(weights[:, 2], 1e-12)
        antisymmetric = omegas[[k for k in vertical if tilt[k] < 0.01]][0]
        symmetric = omegas[[k for k in vertical if tilt[k] >= 0.01]][0]
        yield relative(f"{label}: out of plane, first [rad/s]", out_of_plane[0], string, 0.01)
        yield relative(f"{label}: antisymmetric, first [rad/s]", antisymmetric, 2.0 * string, 0.01)
        expected = string * irvine_symmetric_mode(parameter)
        yield relative(f"{label}: symmetric, first [rad/s]", symmetric, expected, 0.01)


def _driven_amplitude(solver: SaggedSpanSolver, amplitude: float, omega: float) -> float:
    """Amplitude of the upper tension at the frequency of a small motion, signed by phase, per metre [N/m]."""
    period = 2.0 * math.pi / omega
    dt = period / 200.0
    time = dt * np.arange(30 * 200 + 1)
    growth = np.sin(0.5 * np.pi * np.minimum(time / (12.0 * period), 1.0)) ** 2
    tension = solver.simulate(upper=amplitude * growth * np.sin(omega * time), dt=dt).upper_tension
    # The tension is the mean of its step: half a step earlier, as sin ωt is there.
    steady = time > 20.0 * period
    phase = omega * (time[steady] - 0.5 * dt)
    basis = np.stack([np.sin(phase), np.cos(phase), np.ones_like(phase)], axis=-1)
    return float(np.linalg.lstsq(basis, tension[steady], rcond=None)[0][0] / amplitude)


@validation("closed form")
def sagged_span_small_motion() -> Iterator[Finding]:
    """Tension under 1 mm of horizontal motion of the upper support, undamped, against the solver's own
    linearisation (0.2 %: the tension's second order, the step and what is left of the start) and against
    Irvine's closed form of a parabola of sag 1/100 (1 %, for what it leaves out of slope and curvature).
    """
    span = 100.0
    cable = _light_line(stiffness=1e6).in_air()
    length = length_of_sag(cable, span, 0.0, 1.0)
    solver = SaggedSpanSolver(cable=cable, length=length, span=span, n_elements=60)
    H = solver.catenary.horizontal_force
    for omega in (0.6, 1.3, 2.3):
        ours = _driven_amplitude(solver, 1e-3, omega)
        linear = solver.linear_tension(omega, np.array([1.0, 0.0, 0.0])).real
        theory = float(irvine_tension(np.array(omega), cable, span, H))
        yield relative(f"{omega} rad/s, against the linearisation [N/m]", ours, linear, 2e-3)
        yield relative(f"{omega} rad/s, against Irvine [N/m]", ours, theory, 0.01)

    def draw(figure: Any) -> None:
        axes = figure.subplots()
        omegas = np.linspace(0.1, 5.0, 500)
        theory = np.abs(irvine_tension(omegas, cable, span, H))
        axes.semilogy(omegas, theory, label="Irvine's shallow parabola")
        few = np.linspace(0.1, 5.0, 60)
        linear = [abs(solver.linear_tension(w, np.array([1.0, 0.0, 0.0]))) for w in few]
        axes.semilogy(few, linear, "o", markersize=3, label="solver, linearised")
        axes.set_xlabel("frequency of the support [rad/s]")
        axes.set_ylabel("tension amplitude per metre [N/m]")
        axes.legend()

    yield Picture("Tension under small horizontal motion of a support, span 100 m, sag 1 m, undamped", draw)


@validation("order of convergence")
def sagged_span_orders() -> Iterator[Finding]:
    """Error of middle and tension falls with the square of step and spacing: a smooth pull on a soft span
    with drag and added mass; differences of successive halvings, 0.15 about 2 (0.25 for the tension) for what
    is not asymptotic yet.
    """
    cable = replace(
        _light_line(stiffness=2e4),
        tangential_drag_coefficient=0.01,
        axial_damping=200.0,
        submerged_weight=5.19,
    )

    def ends(dt: float, n_elements: int) -> tuple[float, float]:
        solver = SaggedSpanSolver(cable=cable, length=LENGTH, span=SPAN, height=2.0, n_elements=n_elements)
        n_steps = round(2.0 / dt)
        time = dt * np.arange(n_steps + 2)
        pull = np.outer(np.sin(0.4 * np.pi * time) ** 4, [0.3, 0.2, 0.1])
        record = solver.simulate(upper=pull, dt=dt)
        # A mean over the step stands for its middle: two of them give the tension at the instant between.
        tension = float(np.mean(record.upper_tension[n_steps:]))
        return float(record.midpoint_displacement[n_steps, 2]), tension

    for name, rows in (
        ("time", [ends(dt, 10) for dt in (0.04, 0.02, 0.01, 0.005)]),
        ("space", [ends(0.01, n) for n in (10, 20, 40, 80)]),
    ):
        changes = np.abs(np.diff(np.array(rows), axis=0))
        orders = np.log2(changes[0] / changes[-1]) / (len(changes) - 1)
        yield absolute(f"order in {name}, middle [-]", orders[0], 2.0, 0.15)
        yield absolute(f"order in {name}, tension [-]", orders[1], 2.0, 0.25)


@validation("order of convergence")
def sagged_span_slack_settles() -> Iterator[Finding]:
    """Moustafa's wire driven slack, 0.1 m at 1.2 Hz, where a smooth order is not to be had: the peak moves by
    less than 1.5 % from 50 to 100 elements, 0.5 % with steps of a quarter and 0.5 % with Kelvin damping of
    0.1 or 5 ms in place of 1 ms. Without damping it does not settle: the peak at fine steps is far higher.
    """
    case = replace(moustafa_span(), upper_amplitude=(0.1, 0.0, 0.0), frequency=1.2)
    stiffness = case.cable.axial_stiffness

    def damped(delay: float) -> Cable:
        return replace(case.cable, axial_damping=delay * stiffness)

    peak = case.extremes()[0]
    for label, variant, tolerance in (
        ("100 elements", replace(case, n_elements=100), 0.015),
        ("steps of a quarter", replace(case, steps_per_period=4 * case.steps_per_period), 0.005),
        ("0.1 ms of damping", replace(case, cable=damped(1e-4)), 0.005),
        ("5 ms of damping", replace(case, cable=damped(5e-3)), 0.005),
    ):
        yield relative(f"peak with {label} [N]", variant.extremes()[0], peak, tolerance)
    undamped = replace(case, cable=damped(0.0), steps_per_period=2000)
    yield at_least(
        "peak without damping, fine steps, over the damped one [-]", undamped.extremes()[0] / peak, 1.5
    )


@validation("invariant")
def sagged_span_energy() -> Iterator[Finding]:
    """After a hard pull the supports stand still and nothing damps: energy stays, linear, slack and under
    both laws of strain; 1e-9 of what the pull brought is what Newton may leave. With drag it only falls.
    """
    free = replace(
        _light_line(stiffness=7.85e3), normal_drag_coefficient=0.0, normal_added_mass_coefficient=0.0
    )
    time = 0.01 * np.arange(101)
    pull = np.outer(0.3 * np.sin(np.pi * time) ** 2, [-1.0, 1.0, 1.0])
    for tension_only in (False, True):
        for strain in ("engineering", "moustafa"):
            cable = replace(free, tension_only=tension_only)
            solver = SaggedSpanSolver(cable=cable, length=LENGTH, span=SPAN, strain=strain)
            begin = solver.simulate(upper=pull, dt=0.01).state
            record = solver.simulate(upper=np.zeros(1001), dt=0.01, state=begin)
            brought = solver.energy(begin) - solver.energy(solver.rest())
            drift = (solver.energy(record.state) - solver.energy(begin)) / brought
            kind = "tension-only" if tension_only else "linear"
            yield absolute(f"{kind}, {strain} strain: drift of energy [-]", drift, 0.0, 1e-9)
            if tension_only:
                yield at_most(f"{kind}, {strain} strain: least tension [N]", -record.tension_min.min(), 0.0)
                yield at_least(f"{kind}, {strain} strain: slack seen [-]", record.slack_fraction.max(), 0.01)
    damped = replace(_tested_span(), n_elements=20)
    state = damped.simulate(upper=pull, dt=0.01).state
    energies = [damped.energy(state)]
    for _ in range(100):
        state = damped.step(state, np.zeros(3), 0.02)
        energies.append(damped.energy(state))
    yield at_most("largest gain of energy with drag [J]", float(np.diff(energies).max()), 1e-9)


@validation("closed form")
def sagged_span_in_cross_current() -> Iterator[Finding]:
    """A shallow span in a uniform current across it swings into the plane of weight and drag: tangent of the
    angle drag over weight, horizontal force larger by their resultant. Sag 1/50: slopes of 8 % cost 1 %.
    """
    speed, span = 0.8, 100.0
    cable = replace(_light_line(stiffness=7.85e6), axial_damping=1e4)
    drag = cable.normal_drag_per_length * speed**2
    current = Current(speed=(speed,), direction=(0.5 * math.pi,), time=(0.0, 20.0), factor=(0.0, 1.0))
    length = length_of_sag(cable, span, 0.0, 2.0)
    solver = SaggedSpanSolver(cable=cable, length=length, span=span, current=current)
    record = solver.simulate(upper=np.zeros(2401), dt=0.05)
    middle = solver.position(record.state)[solver.n_elements // 2]
    yield relative("tangent of the swing [-]", -middle[1] / middle[2], drag / cable.submerged_weight, 0.01)
    resultant = math.hypot(drag, cable.submerged_weight)
    heavier = hanging_span(replace(cable, submerged_weight=resultant), length, span, 0.0)
    exact = float(heavier.tension(np.array(0.0)))
    yield relative("tension at a support [N]", record.upper_tension[-1], exact, 0.01)


@validation("published")
def moustafa_natural_frequency() -> Iterator[Finding]:
    """The printed 0.55 Hz is the first frequency of the taut string with the weight in water and the dry
    mass: from the printed length and span, 1 % for their rounding and the two digits printed.
    """
    wet = _tested_span()
    H = wet.catenary.horizontal_force
    string = math.sqrt(H / MASS) / (2.0 * SPAN)
    yield relative("taut string, weight in water, dry mass [Hz]", string, PUBLISHED_FREQUENCY, 0.01)
    dry_mass = replace(wet, cable=replace(wet.cable, normal_added_mass_coefficient=0.0))
    swinging = float(dry_mass.modes(1)[0][0] / (2.0 * math.pi))
    yield relative("swinging mode of the span, dry mass [Hz]", swinging, PUBLISHED_FREQUENCY, 0.02)
    air = replace(wet, cable=wet.cable.in_air())
    in_air = math.sqrt(air.catenary.horizontal_force / MASS) / (2.0 * SPAN)
    yield Unmatched(
        "taut string in air [Hz]", in_air, PUBLISHED_FREQUENCY, "the tests were made in water: weight is wet"
    )
    yield Unmatched(
        "swinging mode in water with the mass of the water that moves along [Hz]",
        float(wet.modes(1)[0][0] / (2.0 * math.pi)),
        PUBLISHED_FREQUENCY,
        "the source's equations have no added mass",
    )
    yield relative("sag over span, from length and span [-]", wet.catenary.sag / SPAN, 0.0812, 0.01)


@validation("published")
def moustafa_mild_and_severe() -> Iterator[Finding]:
    """What the text says of its figures 2-5: while mild, extremes lie evenly about the static tension (the
    middle of both within 1 % of it); where the least tension comes to zero, the largest grows significantly.
    """
    static = float(_tested_span().catenary.tension(np.array(LENGTH)))
    for frequency in (0.1, 0.3, 0.5, 0.75):
        most, least = extremes(0.025, frequency)
        yield absolute(
            f"0.025 m, {frequency} Hz: middle of extremes over static, less one [-]",
            0.5 * (most + least) / static - 1.0,
            0.0,
            0.01,
        )
    most, least = extremes(0.1, 1.2)
    yield absolute("0.1 m, 1.2 Hz: least tension [N]", least, 0.0, 1e-9)
    yield at_least("0.1 m, 1.2 Hz: middle of extremes over static [-]", 0.5 * (most + least) / static, 2.0)
    growth = [(extremes(u0, 1.0)[0] - static) / u0 for u0 in (0.025, 0.05, 0.075, 0.1)]
    for u0, before, after in zip((0.05, 0.075, 0.1), growth[:-1], growth[1:], strict=True):
        yield at_least(
            f"1 Hz: rise of the peak per metre at {u0} m, over the one before [-]", after / before, 1.15
        )
    for frequency, next_frequency in ((0.5, 0.75), (0.75, 1.0), (1.0, 1.2)):
        yield at_least(
            f"0.1 m: peak at {next_frequency} Hz over that at {frequency} Hz [-]",
            extremes(0.1, next_frequency)[0] / extremes(0.1, frequency)[0],
            1.2,
        )


@validation("published")
def moustafa_modulus_and_tension() -> Iterator[Finding]:
    """Figures 6 and 7: tenfold Young's modulus hardly matters (1 % of the extremes); a tenth of it matters
    more where the excitation is fast, for slow motion is taken up by the catenary; with more initial tension
    the sag falls and the cable answers by stretching: the same motion brings more tension.
    """
    for u0, frequency in ((0.025, 0.5), (0.05, 0.75), (0.075, 0.75), (0.075, 1.0)):
        ours, tenfold = extremes(u0, frequency), extremes(u0, frequency, 1e12)
        yield relative(f"{u0} m, {frequency} Hz: largest with E = 1e12 Pa [N]", tenfold[0], ours[0], 0.01)
        yield relative(f"{u0} m, {frequency} Hz: least with E = 1e12 Pa [N]", tenfold[1], ours[1], 0.01)
    effect = [abs(extremes(0.075, f, 1e10)[0] / extremes(0.075, f)[0] - 1.0) for f in (0.1, 1.0)]
    yield at_least(
        "0.075 m: effect of E = 1e10 Pa at 1 Hz over that at 0.1 Hz [-]", effect[1] / effect[0], 2.0
    )
    cable, range_before = moustafa_cable(), 0.0
    sag_before = math.inf
    for force in (70.0, 87.0, 105.0, 125.0):
        length = length_of_force(cable, SPAN, 0.0, force)
        sag = hanging_span(cable, length, SPAN, 0.0).sag
        most, least = extremes(0.075, 0.5, length=length)
        yield at_most(f"initial tension {force:g} N: sag, beside the one before [m]", sag, sag_before)
        yield at_least(
            f"initial tension {force:g} N: range, beside the one before [N]", most - least, range_before
        )
        range_before, sag_before = most - least, sag


@validation("agreement")
def moustafa_strain() -> Iterator[Finding]:
    """The source's quadratic strain and the cable's own law give the same wire the same extremes: they
    differ by half the strain, 1e-5 here. For a rope pulled to 10 % of strain they may not: T = EA e against
    N (1 + e) with N quadratic.
    """
    for u0, frequency in ((0.05, 0.75), (0.1, 1.0)):
        ours, quadratic = extremes(u0, frequency), extremes(u0, frequency, strain="moustafa")
        yield relative(f"{u0} m, {frequency} Hz: largest [N]", quadratic[0], ours[0], 1e-5)
        yield relative(f"{u0} m, {frequency} Hz: least [N]", quadratic[1], ours[1], 1e-5)
    rope = _light_line(weight=0.0, stiffness=1e4)
    pull = np.sin(0.5 * np.pi * np.minimum(np.arange(2001) / 1500.0, 1.0)) ** 2 * 5.0
    found = {}
    for strain in ("engineering", "moustafa"):
        cable = replace(rope, axial_damping=2e3)
        solver = SaggedSpanSolver(cable=cable, length=100.0, span=105.0, n_elements=10, strain=strain)
        found[strain] = float(solver.simulate(upper=pull, dt=0.02).upper_tension[-1])
    yield relative("rope at 10 % strain, engineering [N]", found["engineering"], 1000.0, 1e-4)
    N = 500.0 / 1.05 + 1e4 * 0.5 * (1.10**2 - 1.05**2)
    yield relative("rope at 10 % strain, quadratic [N]", found["moustafa"], N * 1.10, 1e-4)
