"""The towed cable against its own force balance, its limits, and a cable that is free to curve."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

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
from heave_env.cable.lowering import Lowering
from heave_env.cable.towing import (
    Towing,
    cable_froude_number,
    critical_payout_ratio,
    froude_number,
    inclination,
    tension_ratio,
)
from heave_env.hydrodynamics import cable_drag
from heave_env.parameters import Cable, Payload

Array = np.ndarray

ROUNDING = 1e-12


def light_cable() -> Cable:
    """A light instrument cable of 10 mm."""
    return Cable(
        mass_per_length=0.14,
        axial_stiffness=1.5e6,
        submerged_weight=0.6,
        diameter=0.010,
        normal_drag_coefficient=1.4,
        tangential_drag_coefficient=0.012,
    )


def force_per_length(tow: Towing) -> Array:
    """Weight and drag on the straight cable as a vector in x, y, z [N/m], strumming left out.

    The material moves ahead with the vessel and, paid out, down along the cable.
    """
    angle = tow.inclination
    up_along = np.array([math.cos(angle), 0.0, math.sin(angle)])
    material = np.array([tow.speed, 0.0, 0.0]) - tow.payout_rate * up_along
    return np.array([0.0, 0.0, -tow.cable.submerged_weight]) + cable_drag(tow.cable, -material, up_along)


@validation("closed form")
def tow_angle_and_its_limits() -> Iterator[Finding]:
    """(1) and its inverse are each other, and keep the limits: hanging at rest, along the flow at speed;
    rounding.

    At small angles α² = π / (2 C_N F_c) (1 - α²/2 + ...), at large ones cos α = 2 C_N F_c / π.
    """
    for angle in (1e-4, 0.02, 0.3, 1.0, 1.5):
        back = float(inclination(froude_number(angle, 1.3), 1.3))
        yield relative(f"angle {angle:g} rad, there and back [rad]", back, angle, ROUNDING)
    small = float(inclination(1e10, 1.2))
    yield relative("angle at F_c = 1e10 [rad]", small, math.sqrt(0.5 * math.pi / 1.2e10), 1e-9)
    yield relative(
        "cosine at F_c = 1e-4 [-]", math.cos(float(inclination(1e-4, 1.2))), 2.4e-4 / math.pi, 1e-7
    )
    yield absolute("angle at rest [rad]", float(inclination(0.0, 1.2)), 0.5 * math.pi, 0.0)
    yield absolute("angle without weight [rad]", float(inclination(math.inf, 1.2)), 0.0, 0.0)


@validation("closed form")
def straight_tow_balances_its_forces() -> Iterator[Finding]:
    """Weight and the drag of the shared hydrodynamics, as vectors, point along the cable and sum to its
    tension.

    Normal force zero and tangential the tension per length, both to rounding, from slow to fast, hauling,
    paying out and overrunning the water.
    """
    for speed, rate in ((0.2, 0.0), (1.0, 0.5), (3.0, -1.0), (3.0, 2.0), (6.0, 7.0)):
        tow = Towing(cable=light_cable(), length=800.0, speed=speed, payout_rate=rate)
        force, angle = force_per_length(tow), tow.inclination
        along = np.array([math.cos(angle), 0.0, math.sin(angle)])
        across = np.array([-math.sin(angle), 0.0, math.cos(angle)])
        size = float(np.linalg.norm(force))
        at = f"{speed:g} m/s, paid out at {rate:g} m/s"
        yield absolute(f"force across over force, {at} [-]", float(force @ across) / size, 0.0, 1e-10)
        found = tow.solve()
        yield relative(
            f"tension at the tow point, {at} [N]", found.top_tension, -800.0 * float(force @ along), 1e-10
        )


@validation("closed form")
def tension_ratio_is_the_integrated_tension() -> Iterator[Finding]:
    """(4) against the tension over the tangential weight at several points along the cable: the same
    everywhere.

    And (1)'s Froude number against the balance across that defines it; rounding.
    """
    for speed, rate in ((0.5, 0.3), (2.0, 0.0), (4.0, 4.5)):
        tow = Towing(
            cable=light_cable(), length=500.0, speed=speed, payout_rate=rate, strumming_augmentation=0.3
        )
        found = tow.solve(n_points=6)
        by_formula = float(tension_ratio(found.inclination, rate / speed, tow.drag_ratio))
        for point in (1, 3, 5):
            weight = tow.cable.submerged_weight * math.sin(found.inclination) * found.arc_length[point]
            quantity = f"ratio {found.arc_length[point]:g} m from the end, {speed:g} m/s [-]"
            yield relative(quantity, found.tension[point] / weight, by_formula, 1e-10)
        drag = tow.cable.normal_drag_per_length * speed**2 * math.sin(found.inclination) ** 2
        balance = 0.5 * math.pi / tow.cable.normal_drag_coefficient * drag / tow.cable.submerged_weight
        froude = float(cable_froude_number(tow.cable, speed)) * math.sin(found.inclination) ** 2
        yield relative(f"Froude number times sin², {speed:g} m/s [-]", froude, balance, 1e-10)


@validation("closed form")
def critical_payout_by_root_finding() -> Iterator[Finding]:
    """(5) against the pay-out rate at which the tension, summed from weight and drag vectors, changes sign.

    The root is found to 1e-12 of the speed: 1e-10. In the limits: without tangential drag no rate is
    critical; at rest the rate is the cable's terminal velocity, which the mechanics of lowering know as
    that of an endless cable (a payload of 1 N on 10000 km: 1e-7); along the flow the ratio is one.
    """
    from scipy.optimize import brentq

    cable = light_cable()

    def pull(rate: float, speed: float) -> float:
        tow = Towing(cable=cable, length=1.0, speed=speed, payout_rate=rate)
        angle = tow.inclination
        return -float(force_per_length(tow) @ np.array([math.cos(angle), 0.0, math.sin(angle)]))

    for speed in (0.5, 1.5, 4.0):
        root = float(brentq(pull, 0.0, 10.0 * speed + 10.0, args=(speed,), xtol=1e-12, rtol=1e-14))
        tow = Towing(cable=cable, length=100.0, speed=speed)
        ratio = float(critical_payout_ratio(tow.inclination, tow.drag_ratio))
        yield relative(f"critical ratio, {speed:g} m/s [-]", ratio, root / speed, 1e-10)
        yield relative(f"critical rate, {speed:g} m/s [m/s]", tow.critical_payout_rate, root, 1e-10)
    hanging = Towing(cable=cable, length=100.0, speed=0.0).critical_payout_rate
    endless = Lowering(cable=cable, payload=Payload(mass=1.0, submerged_weight=1.0))
    yield relative("critical rate at rest [m/s]", hanging, float(endless.terminal_velocity(1e7)), 1e-6)
    yield relative("critical ratio along the flow [-]", float(critical_payout_ratio(0.0, 0.01)), 1.0, 0.0)
    dragless = replace(cable, tangential_drag_coefficient=0.0)
    rate = Towing(cable=dragless, length=100.0, speed=2.0).critical_payout_rate
    yield at_least("critical rate without tangential drag [m/s]", min(rate, 1e300), 1e300)


def _curved(cable: Cable, speed: float, length: float, end_tension: float, end_angle: float) -> Array:
    """Arc length, tension, angle and position of a cable free to curve, from its lower end up, (5, n)."""
    from scipy.integrate import solve_ivp

    across, along = cable.normal_drag_per_length * speed**2, cable.tangential_drag_per_length * speed**2

    def slope(_: float, state: Array) -> list[float]:
        tension, angle = state[0], state[1]
        sine, cosine = math.sin(angle), math.cos(angle)
        bend = (cable.submerged_weight * cosine - across * sine * abs(sine)) / tension
        return [cable.submerged_weight * sine + along * cosine * abs(cosine), bend, cosine, sine]

    found = solve_ivp(
        slope,
        (0.0, length),
        [end_tension, end_angle, 0.0, 0.0],
        method="LSODA",
        rtol=1e-10,
        atol=1e-12,
        t_eval=np.linspace(0.0, length, 401),
    )
    return np.vstack([found.t, found.y])


def _draw_curved(figure: Any) -> None:
    axes = figure.subplots()
    cable, length = light_cable(), 500.0
    for load, colour in ((0.5, COLOURS[4]), (20.0, COLOURS[2]), (200.0, COLOURS[1])):
        curve = _curved(cable, 1.5, length, load, 1.3)
        axes.plot(
            curve[3] - curve[3, -1], curve[4] - curve[4, -1], color=colour, label=f"{load:g} N at the end"
        )
    tow = Towing(cable=cable, length=length, speed=1.5).solve()
    axes.plot(tow.x, tow.z, color="#30353d", ls=(0, (4, 2)), label="straight")
    axes.set_xlabel("behind the tow point [m]")
    axes.set_ylabel("depth below it [m]")
    axes.legend()


@validation("agreement")
def curved_cable_becomes_the_straight_one() -> Iterator[Finding]:
    """A cable free to curve, with a load at its end that pulls another way, turns into the critical angle.

    T dφ/ds = w cos φ - (1/2) ρ d C_N U² sin² φ, integrated upwards from 0.5 N at 1.3 rad: beyond many
    lengths T / w the angle is (1)'s, to 1e-6, and the tension per length (4)'s.
    """
    cable = light_cable()
    for speed in (1.0, 3.0):
        tow = Towing(cable=cable, length=500.0, speed=speed).solve()
        curve = _curved(cable, speed, 500.0, 0.5, 1.3)
        yield relative(f"angle at the tow point, {speed:g} m/s [rad]", curve[2, -1], tow.inclination, 1e-6)
        gained = (curve[1, -1] - curve[1, 200]) / 250.0
        yield relative(f"tension per length, {speed:g} m/s [N/m]", gained, tow.top_tension / 500.0, 1e-6)
    off = (
        float(_curved(cable, 1.0, 500.0, 200.0, 1.3)[2, 80])
        - Towing(cable=cable, length=1.0, speed=1.0).inclination
    )
    yield at_least("angle still off 100 m above 200 N, 1 m/s [rad]", off, 0.05)
    yield Picture("Cables with a load at the end approach the straight one, 1.5 m/s", _draw_curved)


@validation("published")
def towing_trends_of_the_text() -> Iterator[Finding]:
    """What the paper says in words: speed raises the hydrodynamic tension, pay-out lowers it; below β = cos
    α both parts of the tension pull; negative tensions want β > cos α and come at small angles; at
    sea-bottom deployment β > 1, so fast ships pass the critical ratio; strumming of 50 % raises T_H by as
    much (exact) and lowers β*.
    """
    cable = light_cable()

    def tow(speed: float, rate: float = 0.0, strumming: float = 0.0) -> Towing:
        return Towing(
            cable=cable, length=500.0, speed=speed, payout_rate=rate, strumming_augmentation=strumming
        )

    drags = [tow(speed).solve().drag_tension for speed in (0.5, 1.0, 2.0, 4.0, 8.0)]
    yield at_least("least rise of T_H with speed [N]", float(np.diff(drags).min()), 1.0)
    drags = [tow(3.0, rate).solve().drag_tension for rate in (-1.0, 0.0, 1.0, 2.0, 3.0, 4.0)]
    yield at_most("least fall of T_H with pay-out [N]", float(np.diff(drags).max()), -1.0)
    for speed in (1.0, 3.0, 8.0):
        line = tow(speed)
        cosine = math.cos(line.inclination)
        beta = line.critical_payout_rate / speed
        yield at_least(f"critical ratio less cos α, {speed:g} m/s [-]", beta - cosine, 1e-3)
        below = tow(speed, cosine * speed).solve()
        yield relative(
            f"tension at β = cos α over weight, {speed:g} m/s [-]",
            below.top_tension,
            below.weight_tension,
            1e-12,
        )
        yield at_least("just below critical [N]", tow(speed, 0.999 * beta * speed).solve().top_tension, 1e-6)
        yield at_most("just above critical [N]", tow(speed, 1.001 * beta * speed).solve().top_tension, -1e-6)
        gain = tow(speed, 0.0, 0.5).solve().drag_tension / line.solve().drag_tension
        yield relative(f"gain of T_H by 50 % of strumming, {speed:g} m/s [-]", gain, 1.5, 1e-12)
        strumming = tow(speed, 0.0, 0.5).critical_payout_rate / speed
        yield at_most(
            f"critical ratio with strumming less without, {speed:g} m/s [-]", strumming - beta, -1e-3
        )
    fast, slow = tow(8.0), tow(1.0)
    ratios = [one.critical_payout_rate / one.speed for one in (slow, fast)]
    yield at_most("critical ratio at 8 m/s less at 1 m/s [-]", ratios[1] - ratios[0], -0.1)
    yield at_least(
        "bottom deployment (β = 1.1): tension at 1 m/s [N]", tow(1.0, 1.1).solve().top_tension, 1.0
    )
    yield at_most(
        "bottom deployment (β = 1.1): tension at 8 m/s [N]", tow(8.0, 8.8).solve().top_tension, -1.0
    )
