"""Ropes that harden and relax in the planar, lumped-mass and static solvers: one law, and one energy."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from scipy.integrate import quad, solve_ivp

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
from experiments.validation.planar import CABLE, PAYLOAD, SHEARED, smooth_start
from heave_env.cable.axial import AxialRecord, AxialSolver
from heave_env.cable.constitutive import static_strain, stored_energy
from heave_env.cable.lumped_mass import LumpedMassSolver
from heave_env.cable.planar import PlanarSolver, PlanarState
from heave_env.cable.statics import FixedEnds, StaticsSolver, Towed
from heave_env.parameters import GRAVITY, Cable, Line, Payload
from heave_env.ropes import polyester_rope

Array = np.ndarray

HARDENING = replace(
    CABLE, axial_stiffness=4e6, quadratic_hardening=10.0, cubic_hardening=100.0, axial_damping=2e4
)
"""A soft rope whose tangent stiffness is 1.4 times EA under the payload's weight."""
ROPE = replace(HARDENING, relaxing_stiffness=3e6, relaxation_time=5.0)
"""The same with a Maxwell branch that relaxes within a wave's period."""
LENGTH = 300.0


def vertical(heave: Array) -> Array:
    """Positions of a top end that heaves only, (n_steps + 1, 3)."""
    return np.column_stack([0.0 * heave, 0.0 * heave, heave])


# Agreement -----------------------------------------------------------------------------------------


@validation("agreement")
def ropes_without_lateral_motion_are_axial() -> Iterator[Finding]:
    """Heave of a rope that nothing sways, by the axial, the planar and the lumped-mass solver.

    All three have one scheme there: what differs is rounding, 1e-9 of the motion, for a rope that hardens and
    relaxes and that slackens and snaps; the planar one while rope is paid out, with a jump of speed, too.
    """
    dt = 0.05
    time = dt * np.arange(1201)
    heave = 3.0 * np.sin(0.8 * time)
    paid = LENGTH + 0.9 * time + np.where(time > 30.0, -0.5 * (time - 30.0), 0.0)
    for tension_only in (False, True):
        rope = replace(ROPE, tension_only=tension_only)
        planar = PlanarSolver(cable=rope, payload=PAYLOAD, length=LENGTH, n_elements=20)
        axial = AxialSolver(cable=rope, payload=PAYLOAD, length=LENGTH, n_elements=20, n_iterations=12)
        kind = "tension-only" if tension_only else "pushing"
        for name, length in (("300 m", np.full(len(time), LENGTH)), ("pay-out", paid)):
            theirs = axial.simulate(heave, dt, length)
            ours = planar.simulate(0.0 * time, heave, dt, length)
            above = ours.payload_z + length + planar.static_stretch(length)
            span = np.ptp(theirs.payload_displacement)
            apart = np.abs(above - theirs.payload_displacement).max() / span
            yield at_most(f"planar, {kind}, {name}: payload, largest difference over range [-]", apart, 1e-9)
            pull = np.abs(ours.top_tension - theirs.sheave_tension).max() / theirs.sheave_tension.max()
            yield at_most(f"planar, {kind}, {name}: top tension, difference over peak [-]", pull, 1e-9)
            if length is paid:
                continue
            line = LumpedMassSolver(line=Line.uniform(rope, LENGTH), n_segments=20, payload=PAYLOAD)
            record = line.simulate(vertical(heave), dt=dt)
            above = record.payload_position[:, 2] + length + planar.static_stretch(length)
            apart = np.abs(above - theirs.payload_displacement).max() / span
            yield at_most(f"lumped mass, {kind}: payload, largest difference over range [-]", apart, 1e-9)


@cache
def _smoothly_heaved(n_elements: int) -> AxialRecord:
    """The axial solver's answer to a smooth heave of the rope at its length, 12 s at 0.01 s."""
    time = 0.01 * np.arange(1201)
    axial = AxialSolver(cable=ROPE, payload=PAYLOAD, length=LENGTH, n_elements=n_elements, n_iterations=8)
    return axial.simulate(2.0 * smooth_start(time, 6.0) * np.sin(0.8 * time), 0.01)


@validation("order of convergence")
def lumped_mass_rope_converges_to_the_axial() -> Iterator[Finding]:
    """The vertical line against the axial solver on 320 elements: payload and sheave tension of a rope that
    hardens and relaxes come nearer as the square of a segment's length. 0.1 is what the coarsest grid leaves
    of the next order's terms."""
    time = 0.01 * np.arange(1201)
    heave = 2.0 * smooth_start(time, 6.0) * np.sin(0.8 * time)
    fine = _smoothly_heaved(320)
    stretch = AxialSolver(cable=ROPE, payload=PAYLOAD, length=LENGTH, n_elements=320).static_stretch(LENGTH)
    apart = []
    for n in (5, 10, 20):
        line = LumpedMassSolver(line=Line.uniform(ROPE, LENGTH), n_segments=n, payload=PAYLOAD)
        record = line.simulate(vertical(heave), dt=0.01)
        above = record.payload_position[:, 2] + LENGTH + stretch
        apart.append(
            (
                np.abs(above - fine.payload_displacement).max(),
                np.abs(record.payload_tension - fine.payload_tension).max(),
            )
        )
    for name, errors in zip(("payload", "payload's tension"), np.array(apart).T, strict=True):
        order = math.log2(errors[0] / errors[-1]) / 2.0
        yield absolute(f"order in space, {name} [-]", order, 2.0, 0.1)
    yield at_most("payload with 20 segments, largest error over 2 m of heave [-]", apart[-1][0] / 2.0, 1e-4)


@validation("agreement")
def rope_is_paid_out_at_the_sheave() -> Iterator[Finding]:
    """Pay-out of 110 m at 1 m/s under 1 m of heave: the lumped line, whose nodes are material points, beside
    the axial solver, whose grid stretches. Hardening alone: 3e-4 of the heave with 20 segments, and a quarter
    of that at most with 80. The axial and the planar solver leave out convection of what the Maxwell branches
    hold: an error of the tension below w1 L' τ EA1/EA (docs/physics.md), 0.2 kN of 60, and of the stretch
    that goes with it."""
    dt = 0.05
    time = dt * np.arange(2401)
    start = smooth_start(time, 10.0)
    heave = start * np.sin(0.8 * time)
    gained = np.concatenate([[0.0], np.cumsum(0.5 * (start[1:] + start[:-1]) * dt)])
    length = LENGTH + gained
    apart = {}
    for name, rope, n in (("hardens", HARDENING, 20), ("hardens", HARDENING, 80), ("relaxes", ROPE, 40)):
        axial = AxialSolver(cable=rope, payload=PAYLOAD, length=LENGTH, n_elements=n, n_iterations=8)
        line = LumpedMassSolver(line=Line.uniform(rope, LENGTH), n_segments=n, payload=PAYLOAD)
        theirs = axial.simulate(heave, dt, length)
        record = line.simulate(vertical(heave), dt=dt, length=length)
        above = record.payload_position[:, 2] + length + axial.static_stretch(length)
        apart[name, n] = float(np.abs(above - theirs.payload_displacement).max())
        if name == "relaxes":
            late = time > 20.0
            pull = np.abs(record.top_tension - theirs.sheave_tension)[late].max()
            bound = rope.submerged_weight * rope.relaxation_time * rope.relaxing_stiffness / 4e6
            yield at_most("rope that relaxes: sheave tension, largest difference [N]", float(pull), bound)
            yield at_most(
                "its payload, difference over the bound's own stretch [-]",
                apart[name, n] / (bound * length[-1] / rope.axial_stiffness),
                1.0,
            )
        yield at_least(f"rope that {name}, {n} segments: splits [-]", int(np.ptp(record.n_segments)), 7)
    yield at_most("rope that hardens: payload, difference with 20 segments [m]", apart["hardens", 20], 3e-4)
    yield at_most("with 80, over that [-]", apart["hardens", 80] / apart["hardens", 20], 0.25)


@validation("agreement")
def ropes_end_in_their_statics() -> Iterator[Finding]:
    """From hanging straight, with Maxwell branches that hold 1 % of strain, in a sheared current that turns:
    after 600 s, 120 relaxation times, the planar and the lumped-mass solver are at their own rest (1e-5 of
    the offset), nothing is held any more, and both rests are the semi-analytic shape within 0.5 %, ten times
    what 60 elements leave."""
    n, turned = 60, replace(SHEARED, direction=(0.0, 0.5, 1.0))
    planar = PlanarSolver(cable=ROPE, payload=PAYLOAD, length=LENGTH, n_elements=n, current=SHEARED)
    for name, current in (("planar", SHEARED), ("lumped mass", turned)):
        ends = Towed(payload=PAYLOAD)
        shape = StaticsSolver(line=Line.uniform(ROPE, LENGTH), ends=ends, current=current).solve()
        line = LumpedMassSolver(
            line=Line.uniform(ROPE, LENGTH), n_segments=n, payload=PAYLOAD, current=current
        )
        if name == "planar":
            still = np.zeros(6001)
            begin = replace(planar.hanging(), branch_strain=np.full(n, 0.01))
            end = planar.simulate(still, still, 0.1, start=begin).final
            position, rest, held = end.position[0], planar.rest().position[0], end.branch_strain
            static, tension = shape.position[0][[0, 2]], planar.top_tension(planar.rest())
        else:
            hanging = replace(line, current=replace(current, speed=(0.0, 0.0, 0.0))).rest()
            begun = replace(line.placed(hanging.positions), branch_strains=np.full(n, 0.01))
            last = line.simulate((0.0, 0.0, 0.0), dt=0.1, n_steps=6000, start=begun).end
            position, rest, held = last.positions[0], line.rest().positions[0], last.branch_strains
            static, tension = shape.position[0], line.top_tension(line.rest())
        offset = float(np.linalg.norm(static[:-1]))
        away = float(np.abs(position - rest).max())
        yield at_most(f"{name}: distance from its own rest over the offset [-]", away / offset, 1e-5)
        yield at_most(f"{name}: largest strain that a branch holds [-]", float(np.abs(held).max()), 1e-8)
        apart = float(np.linalg.norm(rest - static))
        yield at_most(f"{name}: from the semi-analytic shape, over the offset [-]", apart / offset, 5e-3)
        yield relative(f"{name}: tension at the sheave at rest [N]", tension, float(shape.tension[-1]), 1e-4)


# Closed forms --------------------------------------------------------------------------------------


@validation("closed form")
def hardening_rope_hangs_at_its_integral() -> Iterator[Finding]:
    """Statics of a rope that hardens: its elongation below its own weight and a unit's is the integral of
    e(T), and one held by both ends in still water meets dr/ds = (1 + e(T)) t integrated from the force at its
    lower end. Three Gauss points in each of 50 segments leave 1e-10."""
    rope = replace(HARDENING, submerged_weight=200.0)
    unit = Payload(mass=3000.0, submerged_weight=25_000.0)
    line = Line.uniform(rope, 500.0)
    shape = StaticsSolver(line=line, ends=Towed(payload=unit), n_segments=50).solve()
    exact, _ = quad(lambda s: float(static_strain(rope, 25_000.0 + 200.0 * s)), 0.0, 500.0, epsrel=1e-12)
    yield relative("elongation hanging [m]", -shape.position[0, 2] - 500.0, exact, 1e-10)
    for upper in ((450.0, 0.0, 60.0), (505.0, 0.0, 150.0)):
        held = StaticsSolver(
            line=line, ends=FixedEnds(lower=(0.0, 0.0, 0.0), upper=upper), n_segments=50
        ).solve()
        across, lower = held.force[0, 0], held.force[0, 2]

        def slope(s: float, _: Array, across: float = across, lower: float = lower) -> Array:
            force = np.array([across, lower + 200.0 * s])
            T = float(np.linalg.norm(force))
            return np.asarray((1.0 + float(static_strain(rope, T))) / T * force)

        found = solve_ivp(slope, (0.0, 500.0), np.zeros(2), rtol=1e-11, atol=1e-10, max_step=5.0)
        apart = np.abs(found.y[:, -1] - [upper[0], upper[2]]).max() / 500.0
        said = f"{upper[0]:g} m across, {held.strain.max():.2%} of strain"
        yield at_most(f"upper end from the integral, {said}, over the length [-]", float(apart), 1e-9)


PERIODS = (10.0, 100.0, 628.3)


@cache
def _worked(period: float) -> tuple[Array, Array, Array]:
    """Elongation and tension over the last of several periods of 50 m of polyester rope between two ends in
    air, about a mean stretch of 2 %: by the lumped-mass and by the planar solver."""
    rope = replace(polyester_rope(0.06), axial_damping=0.0).in_air()
    length, amplitude, steps = 50.0, 0.1, 800
    dt = period / steps
    n_periods = 1 + math.ceil(10.0 * rope.relaxation_time / period)
    time = dt * np.arange(n_periods * steps + 1)
    moved = amplitude * smooth_start(time, period) * np.sin(2.0 * math.pi / period * time)
    last = slice(-steps - 1, None)
    line = LumpedMassSolver(line=Line.uniform(rope, length), n_segments=4, lower="fixed")
    top = vertical(1.02 * length + moved)
    theirs = line.simulate(top, dt=dt, bottom=(0.0, 0.0, 0.0))
    # An anchor that no rope lifts: its own weight has stretched the rope before the sheave moves.
    anchor = Payload(mass=1e15, submerged_weight=2e5)
    planar = PlanarSolver(cable=rope, payload=anchor, length=length, n_elements=4)
    ours = planar.simulate(0.0 * time, moved, dt)
    return moved[last], theirs.segment_tensions[last].mean(axis=1), ours.top_tension[last]


@validation("closed form")
def polyester_rope_loses_what_its_branch_predicts() -> Iterator[Finding]:
    """Tension over elongation of a polyester rope in slow cycles of 0.2 % of strain is a loop, whose area is
    that of its relaxing branch, π EA1 ωτ/(1 + ω²τ²) e² per length and cycle: hardening makes none. Periods of
    10 s, 100 s and 2πτ, where it is largest; 800 steps a cycle leave 1e-5, the rope's waves 1e-4."""
    rope, length, strain = polyester_rope(0.06), 50.0, 0.1 / 50.0
    for period in PERIODS:
        turn = 2.0 * math.pi / period * rope.relaxation_time
        exact = math.pi * rope.relaxing_stiffness * turn / (1.0 + turn**2) * strain**2 * length
        moved, theirs, ours = _worked(period)
        for name, tension in (("lumped mass", theirs), ("planar", ours)):
            area = float(np.sum(tension[1:] * np.diff(moved)))
            yield relative(f"{name}, {period:g} s: work lost in a cycle [J]", area, exact, 1e-3)

    def draw(figure: Any) -> None:
        axes = figure.subplots()
        for period, colour in zip(PERIODS, COLOURS[1:], strict=False):
            moved, theirs, _ = _worked(period)
            slack = theirs - np.polyval(np.polyfit(moved, theirs, 2), moved)
            axes.plot(100.0 * moved / 50.0, 1e-3 * slack, color=colour, label=f"{period:.0f} s")
        axes.set_xlabel("strain about the mean [%]")
        axes.set_ylabel("tension less its parabola [kN]")
        axes.legend(title="period")

    yield Picture("Loops of a polyester rope: the relaxing branch is all that they enclose.", draw)


# Invariants ----------------------------------------------------------------------------------------


def _held(rope: Cable, branch_strain: Array, spacing: float) -> float:
    """Energy in the Maxwell branches [J]."""
    return float(0.5 * rope.relaxing_stiffness * spacing * np.sum(branch_strain**2))


def _planar_energy(solver: PlanarSolver, state: PlanarState) -> float:
    """Kinetic, elastic and potential energy in air [J], the top's own left out."""
    rope, n = solver.cable, solver.n_elements
    spacing = solver.length / n
    mass = np.full(n + 1, rope.mass_per_length * spacing)
    mass[0], mass[-1] = 0.5 * mass[0] + solver.payload.mass, 0.0
    strain = np.hypot(*np.diff(state.position, axis=0).T) / spacing - 1.0
    energy = 0.5 * float(np.sum(mass[:, None] * state.velocity**2))
    energy += GRAVITY * float(mass @ state.position[:, 1])
    return (
        energy
        + spacing * float(np.sum(stored_energy(rope, strain)))
        + _held(rope, state.branch_strain, spacing)
    )


def _let_go(rope: Cable, reach: float) -> Iterator[tuple[str, float, Array, Array]]:
    """A rope of 20 m and a body let go 1.2 rad from the vertical in air, by both solvers.

    Yields the solver, what the branches lost by EA1 a²/τ at mid-step [J], energies at 801 instants [J], and
    the least tension of each step [N].
    """
    length, n, dt = 20.0, 12, 0.01
    body = Payload(mass=300.0, submerged_weight=1.0).in_air()
    rate = rope.relaxing_stiffness / rope.relaxation_time * length / n * dt
    begin = reach * length * np.linspace(1.0, 0.0, n + 1)[:, None] * [math.sin(1.2), -math.cos(1.2)]
    planar = PlanarSolver(cable=rope, payload=body, length=length, n_elements=n)
    state = replace(planar.hanging(), position=begin, velocity=0.0 * begin, branch_strain=np.zeros(n))
    lost, energy, least = 0.0, [_planar_energy(planar, state)], []
    for _ in range(800):
        after = planar.step(state, (0.0, 0.0, length), dt)
        lost += rate * float(np.sum((0.5 * (after.branch_strain + state.branch_strain)) ** 2))
        state = after
        energy.append(_planar_energy(planar, state))
        least.append(float(state.tension.min()))
    yield "planar", lost, np.array(energy), np.array(least)
    line = LumpedMassSolver(line=Line.uniform(rope, length), n_segments=n, payload=body, upper="fixed")
    now = line.placed(np.column_stack([begin[:, 0], 0.0 * begin[:, 0], begin[:, 1]]))
    now = replace(now, branch_strains=np.zeros(n))
    lost, energy, least = 0.0, [line.energy(now)], []
    for _ in range(800):
        then = line.simulate(dt=dt, n_steps=1, start=now).end
        held = then.branch_strains if len(then.branch_strains) > 0 else np.zeros(n)
        lost += rate * float(np.sum((0.5 * (held + now.branch_strains)) ** 2)) if rate > 0.0 else 0.0
        now = then
        energy.append(line.energy(now))
        least.append(float(now.tensions.min()))
    yield "lumped mass", lost, np.array(energy), np.array(least)


@validation("invariant")
def ropes_lose_only_what_their_branch_takes() -> Iterator[Finding]:
    """A rope and a body let go near the horizontal in air, taut and through slack and snap. Without a Maxwell
    branch nothing of its energy is lost; with one EA1 a²/τ at mid-step, as long as the rope stays taut: the
    scheme says so exactly, and 1e-9 of the energy in motion is left to Newton and rounding. A branch that
    would push more than its spring pulls lets go, which loses more: then the energy only falls."""
    moving = 300.0 * GRAVITY * 20.0
    for kind, stiffness in (("hardens", 0.0), ("relaxes", 1e5)):
        for tension_only in (False, True):
            rope = replace(ROPE, axial_damping=0.0, axial_stiffness=1e5, tension_only=tension_only)
            rope = replace(rope, relaxing_stiffness=stiffness).in_air()
            for solver, lost, energy, least in _let_go(rope, 0.9 if tension_only else 1.0):
                said = f"{solver}, {kind}, {'through slack' if tension_only else 'taut'}"
                if kind == "relaxes" and tension_only:
                    rise = float(np.diff(energy).max()) / moving
                    yield at_most(f"{said}: largest rise of energy in a step [-]", rise, 1e-9)
                    yield at_least(f"{said}: share that is lost [-]", (energy[0] - energy[-1]) / moving, 1e-2)
                else:
                    left = (energy[-1] + lost - energy[0]) / moving
                    yield absolute(f"{said}: left over of the balance [-]", left, 0.0, 1e-9)
                if kind == "relaxes" and not tension_only:
                    yield at_least(f"{said}: share that the branches took [-]", lost / moving, 1e-2)
                if tension_only:
                    yield absolute(f"{said}: least tension [N]", float(least.min()), 0.0, 0.0)
