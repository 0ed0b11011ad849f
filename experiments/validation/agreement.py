"""Solver against solver where their regimes meet; each has its own equations, grid and Newton."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from experiments.cases.lumped_mass import thesis_cable, thesis_payload
from experiments.cases.sagged_span import moustafa_cable
from experiments.figures import COLOURS
from experiments.validation.checks import Check, Finding, Picture, absolute, at_most, relative, validation
from heave_env.cable.lumped_mass import LineRecord, LumpedMassSolver
from heave_env.cable.planar import PlanarRecord, PlanarSolver
from heave_env.cable.sagged_span import SaggedSpanSolver
from heave_env.cable.statics import FixedEnds, StaticsSolver, Towed
from heave_env.cable.waves import WavesSolver
from heave_env.parameters import Attachment, Current, Line, Payload, Section

Array = np.ndarray

UMBILICAL, UNIT = thesis_cable(), thesis_payload()
"""Cable and unit of Huang (1992), 5.7."""
LENGTH = 300.0
STREAM = Current(depth=(0.0, 150.0, 300.0), speed=(0.8, 0.5, 0.2), direction=(0.0, 0.0, 0.0))
"""A stream that weakens with depth."""


def circles(time: Array, omega: float, radius: float) -> tuple[Array, Array]:
    """A top end that is led onto a circle within the first period: x and z."""
    grown = radius * np.minimum(1.0, time * omega / (2.0 * math.pi))
    return grown * np.sin(omega * time), grown * (1.0 - np.cos(omega * time))


@cache
def circled(omega: float, radius: float) -> tuple[Array, PlanarRecord, LineRecord]:
    """The same circular top motion in the stream, by the planar and by the lumped-mass solver."""
    period = 2.0 * math.pi / omega
    dt = period / 400
    time = dt * np.arange(8 * 400 + 1)
    x, z = circles(time, omega, radius)
    planar = PlanarSolver(cable=UMBILICAL, payload=UNIT, length=LENGTH, n_elements=60, current=STREAM)
    lumped = LumpedMassSolver(
        line=Line.uniform(UMBILICAL, LENGTH), n_segments=60, current=STREAM, payload=UNIT
    )
    top = np.column_stack([x, np.zeros_like(x), z])
    return time, planar.simulate(x, z, dt), lumped.simulate(top, dt=dt)


def _ranges(planar: PlanarRecord, lumped: LineRecord, late: slice) -> Iterator[Check]:
    position = lumped.payload_position[late]
    for name, ours, theirs in (
        ("payload sway, range [m]", planar.payload_x[late], position[:, 0]),
        ("payload heave, range [m]", planar.payload_z[late], position[:, 2]),
        ("top tension, range [N]", planar.top_tension[late], lumped.top_tension[late]),
    ):
        yield relative(name, np.ptp(ours), float(np.ptp(theirs)), 5e-4)
    yield relative(
        "top tension, mean [N]", planar.top_tension[late].mean(), lumped.top_tension[late].mean(), 1e-4
    )
    yield absolute("payload sway, mean [m]", planar.payload_x[late].mean(), position[:, 0].mean(), 1e-4)


@validation("agreement")
def planar_and_lumped_mass_in_circles() -> Iterator[Finding]:
    """The planar and the lumped-mass solver under the same circular top motion in a stream that weakens with
    depth, the unit of H 5.7 on 300 m: ranges over the last two periods within 0.05 %, ten times what the
    two treatments of mass on 60 elements leave."""
    time, planar, lumped = circled(0.628, 1.0)
    yield from _ranges(planar, lumped, slice(-801, None))
    out_of_plane = np.abs(lumped.positions[:, :, 1]).max()
    yield at_most("largest motion out of the plane [m]", out_of_plane, 1e-9)

    def draw(figure: Any) -> None:
        above, below = figure.subplots(2, 1, sharex=True)
        above.plot(time, planar.payload_x, color=COLOURS[1], label="planar")
        above.plot(time, lumped.payload_position[:, 0], "--", color=COLOURS[3], label="lumped mass")
        below.plot(time, planar.payload_z, color=COLOURS[1])
        below.plot(time, lumped.payload_position[:, 2], "--", color=COLOURS[3])
        above.set_ylabel("sway [m]")
        below.set_ylabel("z [m]")
        below.set_xlabel("time [s]")
        above.legend()

    yield Picture("The unit under a boom tip that goes in circles of 1 m, by two solvers.", draw)


@validation("agreement", slow=True)
def planar_and_lumped_mass_at_other_frequencies() -> Iterator[Finding]:
    """The same at 0.314 and 1.256 rad/s, the slowest and the fastest of H 5.7."""
    for omega in (0.314, 1.256):
        _, planar, lumped = circled(omega, 1.0)
        for found in _ranges(planar, lumped, slice(-801, None)):
            yield replace(found, quantity=f"{omega} rad/s: {found.quantity}")


@validation("agreement")
def planar_and_lumped_mass_paying_out() -> Iterator[Finding]:
    """Lowering at 1 m/s from 100 to 160 m in a uniform current with the top heaving, by the moving grid of
    the planar solver and by the growing chain of the lumped-mass solver: the unit within 2 mm at every
    instant of its 60 m; the tension's deviation within 2 %, since a new segment rings a little."""
    dt = 0.05
    time = dt * np.arange(1201)
    z = 0.5 * np.sin(0.7 * time) * np.minimum(1.0, time / 10.0)
    length = 100.0 + np.minimum(time, 60.0)
    current = Current.uniform(0.4)
    planar = PlanarSolver(cable=UMBILICAL, payload=UNIT, length=100.0, n_elements=50, current=current)
    lumped = LumpedMassSolver(
        line=Line.uniform(UMBILICAL, 100.0), n_segments=50, current=current, payload=UNIT
    )
    ours = planar.simulate(np.zeros_like(z), z, dt, length)
    top = np.column_stack([np.zeros_like(z), np.zeros_like(z), z])
    theirs = lumped.simulate(top, dt=dt, length=length)
    yield at_most(
        "payload heave, largest difference [m]",
        np.abs(ours.payload_z - theirs.payload_position[:, 2]).max(),
        2e-3,
    )
    yield at_most(
        "payload sway, largest difference [m]",
        np.abs(ours.payload_x - theirs.payload_position[:, 0]).max(),
        2e-3,
    )
    late = slice(200, None)
    yield relative(
        "top tension, standard deviation [N]",
        ours.top_tension[late].std(),
        theirs.top_tension[late].std(),
        0.02,
    )


@cache
def towed_shape() -> Any:
    """Static shape of the same line in the stream."""
    line = Line.uniform(UMBILICAL, LENGTH)
    return StaticsSolver(line=line, ends=Towed(payload=UNIT), current=STREAM, n_segments=200).solve()


@validation("agreement")
def three_statics_in_a_stream() -> Iterator[Finding]:
    """The unit's place and the top tension in a stream that weakens with depth: semi-analytic segments
    against the rest of the planar and of the lumped-mass solver, 0.1 % of the offset and 0.001 % of depth
    and tension with 60 elements."""
    shape = towed_shape()
    offset, depth, tension = shape.position[0, 0], shape.position[0, 2], shape.tension[-1]
    planar = PlanarSolver(cable=UMBILICAL, payload=UNIT, length=LENGTH, n_elements=60, current=STREAM)
    lumped = LumpedMassSolver(
        line=Line.uniform(UMBILICAL, LENGTH), n_segments=60, current=STREAM, payload=UNIT
    )
    hung, settled = planar.rest(), lumped.rest()
    yield relative("planar: offset [m]", hung.position[0, 0], offset, 1e-3)
    yield relative("planar: depth of the unit [m]", hung.position[0, 1], depth, 1e-5)
    yield relative("planar: top tension [N]", planar.top_tension(hung), tension, 1e-5)
    yield relative("lumped mass: offset [m]", settled.positions[0, 0], offset, 1e-3)
    yield relative("lumped mass: depth of the unit [m]", settled.positions[0, 2], depth, 1e-5)
    yield relative("lumped mass: top tension [N]", lumped.top_tension(settled), tension, 1e-5)


@validation("agreement")
def statics_are_where_the_dynamics_end() -> Iterator[Finding]:
    """A line that hangs straight is overtaken by a steady stream; after a long time it must lie where the
    statics say, within 0.5 %. The stream's factor rises over 30 s, and drag damps the swing."""
    rising = replace(STREAM, time=(0.0, 30.0), factor=(0.0, 1.0))
    shape = towed_shape()
    offset, tension = shape.position[0, 0], shape.tension[-1]
    dt, n_steps = 0.1, 12_000
    still = np.zeros(n_steps + 1)
    planar = PlanarSolver(cable=UMBILICAL, payload=UNIT, length=LENGTH, n_elements=30, current=rising)
    ours = planar.simulate(still, still, dt)
    yield absolute("planar: offset at the start [m]", ours.payload_x[0], 0.0, 1e-9)
    yield relative("planar: offset at the end [m]", ours.payload_x[-1], offset, 0.005)
    yield relative("planar: top tension at the end [N]", ours.top_tension[-1], tension, 0.005)
    lumped = LumpedMassSolver(
        line=Line.uniform(UMBILICAL, LENGTH), n_segments=30, current=rising, payload=UNIT, upper="fixed"
    )
    theirs = lumped.simulate(dt=dt, n_steps=n_steps, every=10)
    yield relative("lumped mass: offset at the end [m]", theirs.payload_position[-1, 0], offset, 0.005)
    yield relative("lumped mass: top tension at the end [N]", theirs.top_tension[-1], tension, 0.005)

    def draw(figure: Any) -> None:
        axes = figure.subplots()
        axes.plot(ours.time, ours.payload_x, color=COLOURS[1], label="planar")
        axes.plot(theirs.time, theirs.payload_position[:, 0], "--", color=COLOURS[3], label="lumped mass")
        axes.axhline(offset, color=COLOURS[0], linewidth=0.8, label="statics")
        axes.set_xlabel("time [s]")
        axes.set_ylabel("offset of the unit [m]")
        axes.legend()

    yield Picture(
        "A stream overtakes a hanging line: two dynamic solvers and where the statics put it.", draw
    )


@validation("agreement")
def composite_line_with_a_float() -> Iterator[Finding]:
    """A lazy wave: chain below, rope with a float above, both ends held, in a cross current. Statics and the
    rest of the lumped-mass solver: the float within 5 mm and the end tensions within 0.01 %, with 200 and
    250 segments."""
    chain = replace(
        UMBILICAL, mass_per_length=20.0, submerged_weight=170.0, axial_stiffness=5e7, diameter=0.06
    )
    line = Line(
        sections=(Section(cable=chain, length=100.0), Section(cable=UMBILICAL, length=150.0)),
        attachments=(
            Attachment(arc_length=150.0, body=Payload(mass=200.0, submerged_weight=-3000.0, drag_area=0.6)),
        ),
    )
    ends = FixedEnds(lower=(0.0, 0.0, -120.0), upper=(150.0, 0.0, 0.0))
    current = Current(depth=(0.0, 120.0), speed=(0.6, 0.3), direction=(1.5708, 1.5708))
    shape = StaticsSolver(line=line, ends=ends, current=current, n_segments=200).solve()
    lumped = LumpedMassSolver(line=line, n_segments=250, current=current, lower="fixed", upper="fixed")
    rest = lumped.rest(ends.upper, ends.lower)
    place, _ = shape.sample(150.0)
    node = int(np.argmin(np.abs(rest.arc_lengths - 150.0)))
    for axis, name in enumerate("xyz"):
        yield absolute(f"float: {name} [m]", rest.positions[node, axis], float(np.ravel(place)[axis]), 0.005)
    yield relative("upper tension [N]", lumped.top_tension(rest), shape.tension[-1], 1e-4)
    yield relative("lower tension [N]", float(np.linalg.norm(rest.bottom_force)), shape.tension[0], 1e-4)


@validation("agreement")
def small_motion_is_the_linearised_system() -> Iterator[Finding]:
    """A sagging line is given a millimetre of one of its modes and let go in still, dragless water: after a
    whole number of the mode's periods by the linearised system it must be back, for the lowest mode out of
    plane and the lowest in plane; two grids of 100 segments and 200 steps a period leave 0.1 %."""
    bare = replace(UMBILICAL, normal_drag_coefficient=0.0, tangential_drag_coefficient=0.0)
    line = Line.uniform(bare, 120.0)
    ends = FixedEnds(lower=(0.0, 0.0, -20.0), upper=(110.0, 0.0, 0.0))
    shape = StaticsSolver(line=line, ends=ends, n_segments=100).solve()
    modes = WavesSolver(shape=shape).solve()
    lumped = LumpedMassSolver(line=line, n_segments=100, lower="fixed", upper="fixed")
    rest = lumped.rest(ends.upper, ends.lower)
    for family in ("out of plane", "in plane"):
        lowest = modes.of(family)
        omega, form = float(lowest.omega[0]), lowest.displacement[0]
        start = lumped.placed(rest.positions + 1e-3 * form)
        period = 2.0 * math.pi / omega
        dt = period / 200
        record = lumped.simulate(dt=dt, n_steps=1000, start=start)
        moved = record.positions - rest.positions
        projection = np.einsum("tij,ij->t", moved, form) / np.sum(form**2)
        time = record.time - record.time[0]
        crossings = _upward_crossings(time, projection)
        measured = 2.0 * math.pi / float(np.mean(np.diff(crossings)))
        yield relative(f"{family}: frequency [rad/s]", measured, omega, 1e-3)
        yield absolute(
            f"{family}: after five periods, share of the start [-]", projection[-1] / 1e-3, 1.0, 1e-3
        )


def _upward_crossings(time: Array, series: Array) -> Array:
    below = (series[:-1] < 0.0) & (series[1:] >= 0.0)
    at = np.nonzero(below)[0]
    share = -series[at] / (series[at + 1] - series[at])
    return np.asarray(time[at] + share * (time[at + 1] - time[at]))


@validation("agreement")
def sagged_span_and_lumped_mass() -> Iterator[Finding]:
    """Moustafa's span, one end shaken along it by 5 cm at 0.3 Hz and 7.5 cm at 0.9 Hz, taut, and by 10 cm at
    1.2 Hz, through slack and snap: the sagged-span and the lumped-mass solver. Tension extremes within 0.5 %
    while taut; a snap has the grid's own waves in it, so 1 % there."""
    cable = moustafa_cable()
    for amplitude, frequency, tolerance in ((0.05, 0.3, 0.005), (0.075, 0.9, 0.005), (0.1, 1.2, 0.01)):
        omega = 2.0 * math.pi * frequency
        dt = 1.0 / (800.0 * frequency)
        time = dt * np.arange(6 * 800 + 1)
        shake = amplitude * np.sin(omega * time) * np.minimum(1.0, frequency * time)
        span = SaggedSpanSolver(cable=cable, length=10.9774, span=10.792, n_elements=40)
        ours = span.simulate(upper=shake, dt=dt)
        lumped = LumpedMassSolver(
            line=Line.uniform(cable, 10.9774), n_segments=40, lower="fixed", upper="driven"
        )
        top = np.column_stack([10.792 + shake, np.zeros_like(shake), np.zeros_like(shake)])
        theirs = lumped.simulate(top, dt=dt, bottom=(0.0, 0.0, 0.0))
        late = slice(-1601, None)
        said = f"{100 * amplitude:g} cm at {frequency:g} Hz"
        yield relative(
            f"{said}: largest tension [N]",
            ours.tension_max[late].max(),
            float(theirs.greatest_tension[late].max()),
            tolerance,
        )
        static = float(ours.tension_max[0])
        yield absolute(
            f"{said}: least tension over the static one [-]",
            ours.tension_min[late].min() / static,
            float(theirs.least_tension[late].min()) / static,
            0.01,
        )
