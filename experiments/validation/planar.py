"""The planar cable against closed forms, the axial cable, its own order and the thesis's chapter 4."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import j0, j1, jv, y0, y1, yv

from experiments.cases.axial import cycle_amplitude
from experiments.cases.planar import (
    PlanarOperation,
    example_five,
    example_four,
    example_three,
    sphere_sweep,
)
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
from heave_env.cable.axial import AxialSolver
from heave_env.cable.closed_form import resonant_length
from heave_env.cable.planar import PlanarRecord, PlanarSolver, PlanarState
from heave_env.hydrodynamics import cable_drag, current_velocity
from heave_env.parameters import GRAVITY, Cable, Current, Payload

Array = np.ndarray

INK = "#30353d"

# A cable and a payload on which everything shows: heavy, soft, draggy.
CABLE = Cable(
    mass_per_length=7.2,
    axial_stiffness=1.6e7,
    submerged_weight=54.0,
    diameter=0.047,
    tangential_drag_coefficient=0.025,
)
PAYLOAD = Payload(
    mass=9_000.0,
    added_mass=5_000.0,
    submerged_weight=50_000.0,
    drag_area=6.0,
    lateral_added_mass=3_000.0,
    lateral_drag_area=4.0,
)
SHEARED = Current(depth=(0.0, 100.0, 300.0), speed=(1.2, 0.6, 0.2), direction=(0.0, 0.0, 0.0))


def smooth_start(time: Array, duration: float) -> Array:
    """From 0 to 1 over `duration` [s] without a kink, the shape of `time`."""
    share = np.clip(time / duration, 0.0, 1.0)
    return np.asarray(share**3 * (10.0 - 15.0 * share + 6.0 * share**2))


def zero_crossing_omega(signal: Array, time: Array) -> float:
    """Mean angular frequency between the first and the last zero crossing of a signal [rad/s]."""
    before = np.nonzero(signal[:-1] * signal[1:] < 0.0)[0]
    share = signal[before] / (signal[before] - signal[before + 1])
    crossings = time[before] + share * (time[before + 1] - time[before])
    return float(math.pi * (len(crossings) - 1) / (crossings[-1] - crossings[0]))


def laid_along(state: PlanarState, sway: Array) -> PlanarState:
    """The state with its nodes moved aside by `sway` [m], (n_nodes,), each element as long as before."""
    spacing = np.diff(state.position[:, 1])
    rise = np.sqrt(spacing**2 - np.diff(sway) ** 2)
    below_top = np.concatenate([np.cumsum(rise[::-1])[::-1], [0.0]])
    return replace(state, position=np.column_stack([sway, state.position[-1, 1] - below_top]))


# Agreement -----------------------------------------------------------------------------------------


@validation("agreement")
def planar_without_lateral_motion_is_axial() -> Iterator[Finding]:
    """Heave and pay-out of a planar cable that nothing sways, beside the axial solver iterated to the end.

    Both discretise the same equations in the same way, so what differs is rounding: 1e-9 of the motion and of
    the tension. Four marches: constant length and pay-out with a jump of speed, linear and tension-only.
    """
    dt = 0.05
    time = dt * np.arange(2001)
    heave = 3.0 * np.sin(0.8 * time)
    paid = 300.0 + 0.9 * time + np.where(time > 50.0, -0.5 * (time - 50.0), 0.0)
    for tension_only in (False, True):
        cable = replace(CABLE, tension_only=tension_only, axial_damping=0.005 * CABLE.axial_stiffness)
        planar = PlanarSolver(cable=cable, payload=PAYLOAD, length=300.0, n_elements=20)
        axial = AxialSolver(cable=cable, payload=PAYLOAD, length=300.0, n_elements=20, n_iterations=12)
        for name, length in (("300 m", np.full(len(time), 300.0)), ("pay-out", paid)):
            ours = planar.simulate(0.0 * time, heave, dt, length)
            theirs = axial.simulate(heave, dt, length)
            displacement = ours.payload_z + length + planar.static_stretch(length)
            label = f"{name}, {'tension-only' if tension_only else 'linear'}"
            motion = np.abs(displacement - theirs.payload_displacement).max()
            span = np.ptp(theirs.payload_displacement)
            yield at_most(f"payload, largest difference over range, {label} [-]", motion / span, 1e-9)
            tension = np.abs(ours.top_tension - theirs.sheave_tension).max() / theirs.sheave_tension.max()
            yield at_most(f"top tension, largest difference over peak, {label} [-]", tension, 1e-9)


@validation("agreement")
def planar_settles_to_its_own_rest() -> Iterator[Finding]:
    """Released straight in a sheared current, the cable ends in the static shape that `rest` finds.

    After 1500 s of drag what is left of the transient is far below 1e-5 of the offset.
    """
    solver = PlanarSolver(cable=CABLE, payload=PAYLOAD, length=300.0, n_elements=30, current=SHEARED)
    still = 0.0 * np.arange(30_001)
    record = solver.simulate(still, still, 0.05, start=solver.hanging())
    rest = solver.rest()
    yield relative("payload offset [m]", record.payload_x[-1], rest.position[0, 0], 1e-5)
    yield relative("payload depth [m]", record.payload_z[-1], rest.position[0, 1], 1e-6)
    yield relative("top tension [N]", record.top_tension[-1], solver.top_tension(rest), 1e-5)
    shape = np.abs(record.final.position - rest.position).max()
    yield absolute("shape, largest difference [m]", shape, 0.0, 1e-4)


def integrated_rest(cable: Cable, payload: Payload, length: float, current: Current) -> tuple[Array, Array]:
    """Payload position (2,) and force on the sheave (2,) by integrating the static equations upwards.

    dH/ds = w ẑ - drag, dr/ds = (1 + |H|/EA) H/|H| from the payload, whose depth is found so that the sheave
    is at z = 0.
    """

    def upwards(depth: float) -> Array:
        water = current_velocity(current, depth)
        drag = payload.lateral_drag_factor * abs(water[0]) * water[0]

        def slope(_: float, state: Array) -> Array:
            force = math.hypot(state[0], state[1])
            tangent = np.array([state[0], 0.0, state[1]]) / force
            pushed = cable_drag(cable, current_velocity(current, -state[3]), tangent)
            stretch = 1.0 + force / cable.axial_stiffness
            return np.array(
                [
                    -pushed[0],
                    cable.submerged_weight - pushed[2],
                    stretch * tangent[0],
                    stretch * tangent[2],
                ]
            )

        start = np.array([-drag, payload.submerged_weight, 0.0, -depth])
        found = solve_ivp(slope, (0.0, length), start, rtol=1e-10, atol=1e-9)
        return np.asarray(found.y[:, -1])

    depth = brentq(lambda d: upwards(d)[3], 0.3 * length, 1.2 * length, xtol=1e-9)
    end = upwards(depth)
    return np.array([-end[2], -depth]), end[:2]


@validation("agreement")
def planar_rest_is_the_integrated_shape() -> Iterator[Finding]:
    """Static shape in a sheared current beside an integration of the static equations along the cable.

    The current falls linearly with depth, for knots of the profile would scatter the order. The grid's
    error is of second order; 40 elements are within 1e-3.
    """
    cable, payload = replace(CABLE, submerged_weight=20.0), replace(PAYLOAD, submerged_weight=8_000.0)
    current = Current(depth=(0.0, 400.0), speed=(1.2, -0.3), direction=(0.0, 0.0))
    position, force = integrated_rest(cable, payload, 300.0, current)
    offsets = []
    for n, tolerance in ((20, 4e-3), (40, 1e-3), (80, 3e-4)):
        solver = PlanarSolver(cable=cable, payload=payload, length=300.0, n_elements=n, current=current)
        rest = solver.rest()
        offsets.append(float(rest.position[0, 0]))
        yield relative(f"payload offset, {n} elements [m]", rest.position[0, 0], position[0], tolerance)
        yield relative(f"payload depth, {n} elements [m]", -rest.position[0, 1], -position[1], tolerance)
        yield relative(
            f"top tension, {n} elements [N]", solver.top_tension(rest), np.hypot(*force), tolerance
        )
    errors = np.abs(np.array(offsets) - position[0])
    yield absolute("order of the offset [-]", float(np.log2(errors[0] / errors[2]) / 2.0), 2.0, 0.1)


@validation("agreement")
def payload_drag_by_components_and_by_vector() -> Iterator[Finding]:
    """The two forms of the payload's drag agree at rest in a current, and part when the payload heaves.

    At rest the water moves along x alone: rounding. On a circle of 1 m at 1 rad/s in 0.5 m/s (example three)
    the vector form lets heave add to the sway's drag: the mean offset grows by more than 20 %.
    """
    offsets = {}
    for form in ("components", "vector"):
        operation = example_three(0.5, payload_drag=form)
        record = operation.record()
        settled = record.time >= operation.settling
        offsets[form] = (operation.solver.rest().position[0, 0], record.payload_x[settled].mean())
    yield relative("offset at rest, vector [m]", offsets["vector"][0], offsets["components"][0], 1e-9)
    ratio = offsets["vector"][1] / offsets["components"][1]
    yield at_least("mean offset, vector over components [-]", ratio, 1.2)


# Closed forms --------------------------------------------------------------------------------------


@validation("closed form")
def planar_straight_in_current() -> Iterator[Finding]:
    """A weightless cable without drag below which a payload is dragged lies straight: exact but for rounding.

    tan of its angle is drag over weight, and it stretches by |force| / EA.
    """
    cable = replace(CABLE, submerged_weight=0.0, normal_drag_coefficient=0.0, tangential_drag_coefficient=0.0)
    solver = PlanarSolver(
        cable=cable, payload=PAYLOAD, length=300.0, n_elements=7, current=Current.uniform(2.0)
    )
    rest = solver.rest()
    drag, weight = PAYLOAD.lateral_drag_factor * 4.0, PAYLOAD.submerged_weight
    pull = math.hypot(drag, weight)
    reach = 300.0 * (1.0 + pull / cable.axial_stiffness)
    yield relative("payload offset [m]", rest.position[0, 0], reach * drag / pull, 1e-9)
    yield relative("payload depth [m]", -rest.position[0, 1], reach * weight / pull, 1e-9)
    yield relative("top tension [N]", solver.top_tension(rest), pull, 1e-9)
    record = solver.simulate(np.zeros(2), np.zeros(2), 0.1)
    yield relative("angle at the top [rad]", record.top_angle[0], math.atan2(drag, weight), 1e-9)


@validation("closed form")
def planar_straight_at_the_critical_angle() -> Iterator[Finding]:
    """A cable with weight and drag hangs straight where both balance across it, if its payload agrees.

    w cos φ = c_N U² sin² φ with φ from the horizontal; the payload's drag area is chosen so that it pulls at
    the same angle. Every element lies in that line: rounding.
    """
    speed = 1.5
    cable = replace(CABLE, submerged_weight=40.0)
    ratio = cable.normal_drag_per_length * speed**2 / cable.submerged_weight
    cosine = (-1.0 + math.sqrt(1.0 + 4.0 * ratio**2)) / (2.0 * ratio)
    angle = math.acos(cosine)
    needed = PAYLOAD.submerged_weight / math.tan(angle)
    area = PAYLOAD.drag_area * needed / (PAYLOAD.drag_factor * speed**2)
    payload = replace(PAYLOAD, lateral_drag_area=area)
    solver = PlanarSolver(cable=cable, payload=payload, length=200.0, current=Current.uniform(speed))
    rest = solver.rest()
    lies = np.arctan2(np.diff(rest.position[:, 1]), -np.diff(rest.position[:, 0]))
    yield absolute("angle, largest deviation [rad]", np.abs(lies - angle).max(), 0.0, 1e-9)


def pendulum_determinant(omega: float, mass: float, mass_per_length: float, length: float) -> float:
    """Zero at the natural frequencies of a point mass on an inextensible heavy cable.

    q = A J0(x) + B Y0(x), x = 2 ω sqrt((s + M/m)/g); q(L) = 0, and M ω² q + T q' = 0 at the mass.
    """
    low, high = (2.0 * omega * math.sqrt((s + mass / mass_per_length) / GRAVITY) for s in (0.0, length))
    slope = omega / math.sqrt(mass / mass_per_length * GRAVITY)  # dx/ds at the mass
    at_mass = omega**2 / GRAVITY
    first = at_mass * j0(low) - slope * j1(low)
    second = at_mass * y0(low) - slope * y1(low)
    return float(first * y0(high) - second * j0(high))


def pendulum_modes(mass: float, mass_per_length: float, length: float, n: int) -> list[tuple[float, Any]]:
    """First natural frequencies [rad/s] and shapes (functions of s) of a mass on a heavy cable."""

    def balance(omega: float) -> float:
        return pendulum_determinant(omega, mass, mass_per_length, length)

    grid = np.linspace(0.05, 60.0, 12_000) * math.sqrt(GRAVITY / length)
    values = np.array([balance(w) for w in grid])
    modes = []
    for k in np.nonzero(values[:-1] * values[1:] < 0.0)[0][:n]:
        omega = brentq(balance, grid[k], grid[k + 1], xtol=1e-14)

        def shape(s: Array, omega: float = omega) -> Array:
            x = 2.0 * omega * np.sqrt((s + mass / mass_per_length) / GRAVITY)
            top = 2.0 * omega * math.sqrt((length + mass / mass_per_length) / GRAVITY)
            q = j0(x) * y0(top) - y0(x) * j0(top)
            return np.asarray(q / np.abs(q).max())

        modes.append((float(omega), shape))
    return modes


@validation("closed form")
def planar_pendulum_with_cable_mass() -> Iterator[Finding]:
    """Small swings of a body on a heavy cable in air beside the Bessel modes; sqrt(g/L) of a light cable.

    The cable is practically inextensible (strain 1e-5), the swing 1e-4 of the length. 40 elements and 800
    steps per period leave 1e-4 in the first mode and 1e-3 in the second: what the grid makes of a tension
    that falls to a quarter (the light body) or of a wave a third as long (the heavy one).
    """
    length = 50.0
    for mass, n_modes in ((4_000.0, 2), (100.0, 2)):
        cable = replace(CABLE, axial_stiffness=5.0e9).in_air()
        payload = Payload(mass=mass, submerged_weight=1.0).in_air()
        solver = PlanarSolver(cable=cable, payload=payload, length=length)
        exact = pendulum_modes(mass, cable.mass_per_length, length, n_modes)
        for k, ((omega, shape), tolerance) in enumerate(zip(exact, (1e-4, 1e-3), strict=True)):
            state = laid_along(solver.hanging(), 0.005 * shape(np.linspace(0.0, length, 41)))
            node = int(np.argmax(np.abs(state.position[:, 0])))
            period = 2.0 * math.pi / omega
            still = np.zeros(6 * 800 + 1)
            record = solver.simulate(still, still, period / 800.0, start=state, shapes_every=1)
            ours = zero_crossing_omega(record.shapes[:, node, 0], record.shape_time)
            yield relative(f"mode {k + 1}, {mass:g} kg on 360 kg of cable [rad/s]", ours, omega, tolerance)
    light = replace(CABLE, mass_per_length=0.0, axial_stiffness=5.0e9).in_air()
    solver = PlanarSolver(cable=light, payload=payload, length=length, n_elements=4)
    state = laid_along(solver.hanging(), 0.005 * np.linspace(1.0, 0.0, 5))
    omega = math.sqrt(GRAVITY / length)
    still = np.zeros(6 * 800 + 1)
    record = solver.simulate(still, still, 2.0 * math.pi / omega / 800.0, start=state)
    yield relative("massless cable [rad/s]", zero_crossing_omega(record.payload_x, record.time), omega, 2e-5)


@validation("closed form")
def planar_taut_string() -> Iterator[Finding]:
    """Standing transverse waves of a stretched string, with the grid's and the step's own dispersion.

    w = (2/l) sqrt(T/(μ λ)) sin(kl/2) of the chain, tan(ω Δt/2) = w Δt/2 of the midpoint rule, exact at small
    amplitude (1e-6); the continuum's nπ/L sqrt(T/(μ λ)) is within 0.3 %, the grid's error. λ = 1.1: the wave
    speed is H (12.23)'s sqrt(T/(μ(1+ε))), in unstretched length. μ holds the added mass across the cable.
    """
    length, n, tension = 100.0, 40, 1.0e4
    cable = Cable(
        mass_per_length=2.0,
        axial_stiffness=1.0e5,
        submerged_weight=0.0,
        diameter=0.05,
        normal_drag_coefficient=0.0,
    )
    anchor = Payload(mass=1.0e12, submerged_weight=tension)
    solver = PlanarSolver(cable=cable, payload=anchor, length=length, n_elements=n)
    speed = math.sqrt(tension / (cable.transverse_inertia_per_length * 1.1))
    for mode in (1, 2, 3):
        k, spacing = mode * math.pi / length, length / n
        chain = 2.0 / spacing * speed * math.sin(0.5 * k * spacing)
        dt = 2.0 * math.pi / chain / 100.0
        stepped = 2.0 / dt * math.atan(0.5 * chain * dt)
        state = solver.hanging()
        state.position[:, 0] = 1e-4 * np.sin(k * np.linspace(0.0, length, n + 1))
        still = np.zeros(601)
        record = solver.simulate(still, still, dt, start=state, shapes_every=1)
        node = int(np.argmax(np.abs(state.position[:, 0])))
        ours = zero_crossing_omega(record.shapes[:, node, 0], record.shape_time)
        yield relative(f"mode {mode}, of chain and step [rad/s]", ours, stepped, 2e-6)
        yield relative(f"mode {mode}, of the continuum [rad/s]", ours, k * speed, 3e-3)


@validation("closed form")
def planar_transverse_wave_dies_out() -> Iterator[Finding]:
    """Decay and delay of transverse motion down a cable whose drag is linear, after H (4.8)-(4.10).

    In a steady current U small swings along it meet the drag 2 c_N U per speed, exactly linear in the
    limit. With the tension uniform and the wave dead before it reaches the end, q = exp(i ω t - i k s), k²
    = (ω² μ - i ω c) / T (the root's sign, lost in print, is the one that decays). 1 % (of phase: 0.01 rad)
    allows for the deflection by the current, which lets sway stretch the cable, and for the end's
    reflection.
    """
    speed, omega, tension, length, n = 0.1, 1.0, 5.0e4, 600.0, 150
    cable = Cable(
        mass_per_length=5.2,
        axial_stiffness=2.0e7,
        submerged_weight=0.0,
        diameter=0.02,
        normal_drag_coefficient=6.0,
    )
    payload = Payload(mass=1.0e6, submerged_weight=tension)
    solver = PlanarSolver(
        cable=cable, payload=payload, length=length, n_elements=n, current=Current.uniform(speed)
    )
    dt = 2.0 * math.pi / omega / 100.0
    time = dt * np.arange(3001)
    top = 5e-4 * smooth_start(time, 30.0) * np.sin(omega * time)
    record = solver.simulate(top, 0.0 * time, dt, shapes_every=1)
    settled = time >= 25 * 100 * dt
    basis = np.exp(-1j * omega * time[settled])
    aside = record.shapes[settled, :, 0] - solver.rest().position[:, 0]
    amplitude = (aside * basis[:, None]).mean(axis=0)
    mass, damping = cable.transverse_inertia_per_length, 2.0 * cable.normal_drag_per_length * speed
    stretch = 1.0 + tension / cable.axial_stiffness
    k = np.sqrt((omega**2 * mass - 1j * omega * damping) * stretch / tension)
    for below in (40.0, 100.0, 160.0):
        node = n - round(below / length * n)
        exact = np.exp(-1j * k * below)
        ratio = amplitude[node] / amplitude[-1]
        yield relative(
            f"amplitude {below:g} m below the top over the top's [-]", abs(ratio), abs(exact), 0.01
        )
        phase = float(np.angle(ratio / exact))
        yield absolute(f"phase {below:g} m below the top, ours less exact [rad]", phase, 0.0, 0.01)

    def draw(figure: Any) -> None:
        axes = figure.subplots()
        below = np.linspace(length, 0.0, n + 1)
        axes.semilogy(below, np.abs(amplitude / amplitude[-1]), color=COLOURS[3], label="solver")
        axes.semilogy(below, np.exp(k.imag * below), color=INK, ls="--", label="closed form")
        axes.set_xlabel("distance below the top [m]")
        axes.set_ylabel("sway over the top's [-]")
        axes.legend()

    yield Picture("Transverse motion dies out down the cable", draw)


@validation("closed form")
def swing_while_paying_out() -> Iterator[Finding]:
    """A body in air on a light cable paid out from 20 to 80 m at 0.5 m/s: L θ'' + 2 L' θ' + g θ = 0.

    Exact: θ = L^(-1/2) Z1(2 sqrt(g L) / v). The convective terms decide: without them the swing would grow at
    the rate v/L. Steps of 0.01 s leave a phase error of some 1e-4.
    """
    speed, first, last, dt = 0.5, 20.0, 80.0, 0.01
    light = replace(CABLE, mass_per_length=0.0, axial_stiffness=1.0e9).in_air()
    payload = Payload(mass=1_000.0, submerged_weight=1.0).in_air()
    solver = PlanarSolver(cable=light, payload=payload, length=first, n_elements=4)
    angle = 0.002
    state = laid_along(solver.hanging(), np.sin(angle) * first * np.linspace(1.0, 0.0, 5))
    state = replace(state, velocity=np.tile(speed * np.array([np.sin(angle), -np.cos(angle)]), (5, 1)))
    time = dt * np.arange(round((last - first) / speed / dt) + 1)
    length = first + speed * time
    record = solver.simulate(0.0 * time, 0.0 * time, dt, length, start=state)
    b = 2.0 * math.sqrt(GRAVITY) / speed
    start, at = b * math.sqrt(first), b * np.sqrt(length)
    wronskian = j1(start) * yv(2, start) - y1(start) * jv(2, start)
    shape = (j1(at) * yv(2, start) - y1(at) * jv(2, start)) / wronskian
    exact = angle * first * np.sqrt(length / first) * shape
    error = np.abs(record.payload_x - exact).max() / np.abs(exact).max()
    yield absolute("sway, largest error over largest sway [-]", error, 0.0, 1e-3)
    early, late = np.abs(record.payload_x[time < 9.0]).max(), np.abs(record.payload_x[time > 100.0]).max()
    yield at_most("growth of the sway amplitude [-]", late / early, 1.45)  # adiabatic 4^(1/4) = 1.414

    def draw(figure: Any) -> None:
        axes = figure.subplots()
        axes.plot(time, 1e3 * record.payload_x, color=COLOURS[3], label="solver")
        axes.plot(time, 1e3 * exact, color=INK, ls="--", lw=1.0, label="closed form")
        axes.set_xlabel("time [s]")
        axes.set_ylabel("sway [mm]")
        axes.legend()

    yield Picture("A body swings while its cable is paid out from 20 to 80 m", draw)


# Orders ------------------------------------------------------------------------------------------


def after_a_push(n_elements: int, dt: float, length: Callable[[Array], Array], cable: Cable = CABLE) -> Array:
    """Payload position after 12 s of sway and heave with changing length in a current, (2,)."""
    solver = PlanarSolver(cable=cable, payload=PAYLOAD, length=60.0, n_elements=n_elements, current=SHEARED)
    time = dt * np.arange(round(12.0 / dt) + 1)
    start = smooth_start(time, 6.0)
    record = solver.simulate(2.0 * start * np.sin(0.8 * time), start * np.sin(0.7 * time), dt, length(time))
    return np.array([record.payload_x[-1], record.payload_z[-1]])


def observed_orders(results: list[Array]) -> Array:
    """Mean order of each component over successive halvings of the step."""
    changes = np.abs(np.diff(results, axis=0))
    return np.asarray(np.log2(changes[0] / changes[-1]) / (len(changes) - 1))


def smoothly_paid_out(time: Array) -> Array:
    """From 60 to 72 m in 12 s, without a kink [m]."""
    return np.asarray(60.0 + 12.0 * smooth_start(time, 12.0))


def paid_out_in_kinks(time: Array) -> Array:
    """Length whose rate jumps every 1.5 s [m]."""
    knots = 60.0 + np.array([0.0, 0.5, 0.2, 1.4, 1.5, 0.3, 0.9, 2.0, 1.0])
    return np.asarray(np.interp(time, 1.5 * np.arange(9.0), knots))


@validation("order of convergence")
def planar_second_order_in_time() -> Iterator[Finding]:
    """Sway and heave during pay-out in a current: the error falls as the square of the time step.

    0.1 is what the halvings leave of the next order's terms. It holds where the pay-out rate jumps every
    1.5 s too, if 5 ms of Kelvin damping keep the jumps from ringing the grid's own modes; without, halvings
    scatter.
    """
    results = [after_a_push(8, dt, smoothly_paid_out) for dt in (0.025, 0.0125, 0.00625, 0.003125)]
    for axis, order in zip("xz", observed_orders(results), strict=True):
        yield absolute(f"order in time, payload {axis} [-]", order, 2.0, 0.1)
    damped = replace(CABLE, axial_damping=0.005 * CABLE.axial_stiffness)
    results = [after_a_push(8, dt, paid_out_in_kinks, damped) for dt in (0.05, 0.025, 0.0125, 0.00625)]
    for axis, order in zip("xz", observed_orders(results), strict=True):
        yield absolute(f"order in time with jumps of the pay-out rate, payload {axis} [-]", order, 2.0, 0.1)


@validation("order of convergence")
def planar_second_order_in_space() -> Iterator[Finding]:
    """The same motion on finer and finer grids: the error falls as the square of an element's length."""
    results = [after_a_push(n, 0.01, smoothly_paid_out) for n in (5, 10, 20, 40, 80)]
    for axis, order in zip("xz", observed_orders(results), strict=True):
        yield absolute(f"order in space, payload {axis} [-]", order, 2.0, 0.1)


# Invariants --------------------------------------------------------------------------------------


def energies(solver: PlanarSolver, states: Array, velocities: Array) -> Array:
    """Kinetic, elastic and potential energy of given nodes in air [J], (n,); the top's own is left out."""
    cable, payload, n = solver.cable, solver.payload, solver.n_elements
    spacing = solver.length / n
    mass = np.full(n + 1, cable.mass_per_length * spacing)
    mass[0], mass[-1] = 0.5 * mass[0] + payload.mass, 0.0
    size = np.hypot(*np.moveaxis(np.diff(states, axis=1), -1, 0))
    strain = size / spacing - 1.0
    if cable.tension_only:
        strain = np.maximum(strain, 0.0)
    kinetic = 0.5 * (mass[:, None] * velocities**2).sum(axis=(1, 2))
    elastic = 0.5 * cable.axial_stiffness * spacing * (strain**2).sum(axis=1)
    return np.asarray(kinetic + elastic + GRAVITY * (mass * states[..., 1]).sum(axis=1))


@validation("invariant")
def planar_energy_is_kept() -> Iterator[Finding]:
    """A cable and body let go at 60 degrees in air keep their energy, whether it stays taut or goes slack.

    The scheme's work is exactly the change of its energy, so only Newton's last correction and rounding are
    left: 1e-9 of the energy in motion over 2000 steps.
    """
    payload = Payload(mass=300.0, submerged_weight=1.0).in_air()
    for tension_only, toss in ((False, 0.0), (True, 9.0)):
        cable = replace(CABLE, axial_stiffness=1.0e5, tension_only=tension_only).in_air()
        solver = PlanarSolver(cable=cable, payload=payload, length=20.0, n_elements=12)
        hanging = solver.hanging()
        below = hanging.position[:, 1]
        turned = np.column_stack([-below * math.sin(math.pi / 3.0), below * math.cos(math.pi / 3.0)])
        velocity = np.outer(np.linspace(1.0, 0.0, 13), [-0.5 * toss, toss])
        state = replace(hanging, position=turned, velocity=velocity)
        positions, velocities, least = [state.position], [state.velocity], 0.0
        for _ in range(2000):
            state = solver.step(state, (0.0, 0.0, 20.0), 0.01)
            positions.append(state.position)
            velocities.append(state.velocity)
            least = min(least, float(state.tension.min()))
        energy = energies(solver, np.array(positions), np.array(velocities))
        moving = 0.5 * payload.mass * np.max(np.array(velocities)[:, 0] ** 2)
        label = "slack at times" if tension_only else "taut"
        yield at_most(f"energy, largest change over kinetic, {label} [-]", np.ptp(energy) / moving, 1e-9)
        if tension_only:
            length = np.hypot(*np.moveaxis(np.diff(np.array(positions), axis=1), -1, 0)).min()
            yield at_most("shortest element over its own length: it was slack [-]", length * 12 / 20.0, 0.999)
            yield at_least("least tension [N]", least, 0.0)


@validation("invariant")
def planar_mesh_independence() -> Iterator[Finding]:
    """Example three in 0.5 m/s and example five at 1 m/s with 20, 40 and 80 elements.

    40 elements are within 0.1 % of 80 in offset and amplitudes, 20 within 0.5 %.
    """

    def numbers(n_elements: int) -> Array:
        current = example_three(0.5, n_elements=n_elements)
        circling = current.record()
        settled = circling.time >= current.settling
        lowering = example_five(1.0, n_elements=n_elements)
        heave = lowering.dynamic_heave(lowering.record())
        return np.array(
            [
                circling.payload_x[settled].mean(),
                0.5 * np.ptp(circling.payload_z[settled]),
                circling.top_tension[settled].max(),
                heave.max(),
            ]
        )

    finest = numbers(80)
    names = (
        "mean offset, example three [m]",
        "heave amplitude, example three [m]",
        "top tension, example three [N]",
        "largest heave, example five [m]",
    )
    for n, tolerance in ((20, 5e-3), (40, 1e-3)):
        for name, ours, reference in zip(names, numbers(n), finest, strict=True):
            yield relative(f"{name}, {n} elements", ours, reference, tolerance)


# Published ---------------------------------------------------------------------------------------


@validation("published")
def transverse_motion_is_second_order_in_tension() -> Iterator[Finding]:
    """H 4.3: without stationary deflection sway changes the tension at second order, with it at first.

    The range of the top tension when the sway is doubled: fourfold below a straight cable in air, twofold
    where a current of 1 m/s holds the cable deflected. 5 % is left for the orders above.
    """
    omega = 0.9
    dt = 2.0 * math.pi / omega / 150.0
    time = dt * np.arange(40 * 150 + 1)
    sway = smooth_start(time, 20 * 150 * dt) * np.sin(omega * time)
    settled = time >= 30 * 150 * dt

    def range_of_tension(solver: PlanarSolver, amplitude: float) -> float:
        record = solver.simulate(amplitude * sway, 0.0 * time, dt)
        return float(np.ptp(record.top_tension[settled]))

    air = PlanarSolver(
        cable=replace(CABLE.in_air(), axial_damping=0.02 * CABLE.axial_stiffness),
        payload=PAYLOAD.in_air(),
        length=100.0,
        n_elements=20,
    )
    ratio = range_of_tension(air, 0.4) / range_of_tension(air, 0.2)
    yield relative("range of the tension at twice the sway, straight [-]", ratio, 4.0, 0.05)
    deflected = PlanarSolver(
        cable=CABLE, payload=PAYLOAD, length=100.0, n_elements=20, current=Current.uniform(1.0)
    )
    ratio = range_of_tension(deflected, 0.04) / range_of_tension(deflected, 0.02)
    yield relative("range of the tension at twice the sway, deflected [-]", ratio, 2.0, 0.05)


@validation("published")
def thesis_planar_example_one() -> Iterator[Finding]:
    """H 4.5.1: a sphere on 3 mm rope below a circling or swaying top, in air and in water.

    Text: at 2.5 rad/s and 0.15 m in water the theory predicts negative tension while the largest stays
    positive; the experiment's tension jumps up there, as ours does with a cable that goes slack; in air no
    slack is told of. Resonance lies at the pendulum's frequency, 5 % lower by the swing's own size. The
    curves are lost.
    """
    water = sphere_sweep(water=True, sway=0.15, heave=0.15)
    record, last = water.measured(2.5)
    yield at_most("least tension at 2.5 rad/s in water [N]", record.least_tension[last].min(), -1e-9)
    yield at_least("largest tension there [N]", record.top_tension[last].max(), water.static_tension)
    record, last = water.measured(1.5)
    yield at_least("least tension at 1.5 rad/s in water [N]", record.least_tension[last].min(), 0.0)
    slack = sphere_sweep(water=True, sway=0.15, heave=0.15, tension_only=True)
    low, high = slack.sweep(np.array([1.5, 2.5])).tension_max
    yield at_least("tension-only: largest at 2.5 over that at 1.5 rad/s [-]", high / low, 5.0)
    air = sphere_sweep(water=False, sway=0.15, heave=0.15)
    yield at_least(
        "least tension up to 5 rad/s in air [N]", air.sweep(np.array([2.5, 5.0])).tension_min.min(), 0.0
    )
    line = sphere_sweep(water=False, sway=0.15, heave=0.0)
    omegas = np.linspace(1.2, 1.7, 26)
    swept = line.sweep(omegas)
    resonant = float(omegas[np.argmax(swept.tension_max)])
    yield relative(
        "frequency of the largest tension, swaying in air [rad/s]", resonant, line.swing_omega, 0.05
    )


@validation("published")
def thesis_planar_example_two() -> Iterator[Finding]:
    """H 4.5.2: the same sphere on 2 mm rope, circling 0.1 m: slack at high frequencies in water, not in air.

    The tension then rises sharply, as the text says of the experiment.
    """
    water = sphere_sweep(rope="2 mm", water=True, sway=0.1, heave=0.1)
    swept = water.sweep(np.array([1.5, 4.0]))
    yield at_least("least tension at 1.5 rad/s in water [N]", swept.tension_min[0], 0.0)
    yield at_most("least tension at 4 rad/s in water [N]", swept.tension_min[1], -1e-9)
    slack = sphere_sweep(rope="2 mm", water=True, sway=0.1, heave=0.1, tension_only=True)
    low, high = slack.sweep(np.array([1.5, 4.0])).tension_max
    yield at_least("tension-only: largest at 4 over that at 1.5 rad/s [-]", high / low, 5.0)
    air = sphere_sweep(rope="2 mm", water=False, sway=0.1, heave=0.1)
    yield at_least(
        "least tension up to 5 rad/s in air [N]", air.sweep(np.array([2.5, 5.0])).tension_min.min(), 0.0
    )


@validation("published")
def thesis_planar_example_three() -> Iterator[Finding]:
    """H 4.5.3: mean position of a circling unit against the current.

    Text: the horizontal distance grows with the current, and the mean vertical position changes too (ours
    rises). The figures' values, the drag and the top's motion are not printed; no number is left to compare.
    """
    offsets, depths = [], []
    for speed in (0.0, 0.25, 0.5, 0.75, 1.0):
        operation = example_three(speed, n_elements=20)
        record = operation.record()
        settled = record.time >= operation.settling
        offsets.append(record.payload_x[settled].mean())
        depths.append(-record.payload_z[settled].mean())
    yield at_least("smallest growth of the mean offset per 0.25 m/s [m]", float(np.diff(offsets).min()), 0.1)
    yield at_least("smallest rise of the mean position per 0.25 m/s [m]", float(-np.diff(depths).max()), 0.0)
    yield at_least("rise of the mean position from 0 to 1 m/s [m]", depths[0] - depths[-1], 0.5)


@validation("published")
def thesis_planar_example_four() -> Iterator[Finding]:
    """H 4.5.4: sway of a unit while lowered: the longer the cable and the faster the lowering, the less.

    The top's frequency and the speeds are not printed; ours are 0.2 rad/s, 1 and 3 m/s. Amplitudes are half
    ranges over a cycle, largest within windows of 150 m.
    """
    largest = {}
    for speed in (1.0, 3.0):
        operation = example_four(speed)
        record = operation.record()
        amplitude, _ = cycle_amplitude(
            record.payload_x, round(2.0 * math.pi / operation.omega / operation.dt)
        )
        windows = [
            float(amplitude[(record.length >= a) & (record.length <= a + 150.0)].max())
            for a in (200.0, 350.0, 500.0, 650.0)
        ]
        largest[speed] = windows[0]
        for a, before, after in zip((350, 500, 650), windows, windows[1:], strict=False):
            label = f"sway from {a} m over that of the 150 m before, {speed:g} m/s [-]"
            yield at_most(label, after / before, 1.0)
    yield at_most("largest sway at 3 m/s over that at 1 m/s [-]", largest[3.0] / largest[1.0], 1.0)


@cache
def lowered(speed: float, current: float) -> tuple[PlanarOperation, PlanarRecord]:
    """Example five at a speed in a current [m/s]."""
    operation = example_five(speed, current)
    return operation, operation.record()


@validation("published")
def thesis_planar_example_five() -> Iterator[Finding]:
    """H 4.5.5: lowering through resonance on a circling top, at 0.5, 1, 2 and 3 m/s, and in a weak current.

    Text: the faster, the smaller the motion (half range within a cycle), and the more drag presses the cable
    (mean rise at 500 m); a weak current (0.1 m/s assumed) acts mainly on the sway, and the unit deviates more
    and more as the cable lengthens. Resonance of the slow run lies within 10 % of the undamped closed form's
    length: quadratic drag moves the peak to shorter cables.
    """
    peaks, rises, resonant = [], [], []
    for speed in (0.5, 1.0, 2.0, 3.0):
        operation, record = lowered(speed, 0.0)
        per_cycle = round(2.0 * math.pi / operation.dt)
        amplitude, middle = cycle_amplitude(operation.dynamic_heave(record), per_cycle)
        whole = slice(per_cycle, -per_cycle)
        peaks.append(float(amplitude[whole].max()))
        resonant.append(float(record.length[whole][np.argmax(amplitude[whole])]))
        rises.append(float(middle[whole][-1]))
    for k, faster in enumerate((1.0, 2.0, 3.0)):
        slower = (0.5, 1.0, 2.0)[k]
        yield at_most(f"largest heave, {faster:g} over {slower:g} m/s [-]", peaks[k + 1] / peaks[k], 1.0)
        yield at_least(f"rise by drag, {faster:g} over {slower:g} m/s [-]", rises[k + 1] / rises[k], 1.0)
    slow, _ = lowered(0.5, 0.0)
    exact = float(resonant_length(1.0, slow.cable, slow.payload))
    yield relative("length at resonance, 0.5 m/s [m]", resonant[0], exact, 0.1)
    (operation, without), (_, with_current) = lowered(1.0, 0.0), lowered(1.0, 0.1)
    heave = operation.dynamic_heave(without)
    change = np.abs(with_current.payload_z - without.payload_z).max() / np.abs(heave).max()
    yield at_most("change of heave by the current over its largest [-]", change, 0.01)
    drift = with_current.payload_x - without.payload_x
    deviations = [float(drift[np.searchsorted(without.length, L)]) for L in (250.0, 350.0, 450.0)]
    yield at_least("drift by the current at 350 over 250 m [-]", deviations[1] / deviations[0], 1.0)
    yield at_least("drift by the current at 450 over 350 m [-]", deviations[2] / deviations[1], 1.0)
