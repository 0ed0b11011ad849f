"""The 3-D line beside MoorDyn, an independent lumped-mass code, on the cable of the thesis's chapter 5.

Both have 20 segments and start hanging still; the payload has the same drag and added mass in all
directions, as MoorDyn's bodies have, and drag along the relative velocity. Kelvin damping of 4 ms, the most
that MoorDyn's explicit scheme bears at these segments, lets it come to rest. Amplitudes agree within 1 %.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from experiments import figures
from experiments.cases.lumped_mass import thesis_cable, thesis_payload
from experiments.moordyn_line import MoorDynRecord, moordyn_march
from experiments.validation.checks import Finding, Picture, absolute, relative, validation
from heave_env.cable.lumped_mass import LineRecord, LumpedMassSolver
from heave_env.parameters import Cable, Current, Line, Payload

Array = np.ndarray

LENGTH, N_SEGMENTS, DT = 300.0, 20, 0.01
BELOW = 20.0
"""The upper end is driven that far below the surface, which MoorDyn knows and we do not [m]."""


def soft_cable(**changes: Any) -> Cable:
    """The thesis's cable with 4 ms of Kelvin damping."""
    cable = thesis_cable()
    return replace(cable, axial_damping=0.004 * cable.axial_stiffness, **changes)


def gentle(time: Array) -> Array:
    """Grows from 0 to 1 over 20 s without a kink."""
    share = np.minimum(time / 20.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


def both(
    cable: Cable,
    payload: Payload,
    top: Array,
    *,
    length: Array | None = None,
    current: Current | None = None,
    settling: float = 300.0,
) -> tuple[MoorDynRecord, LineRecord]:
    """The same march by both codes."""
    theirs = moordyn_march(
        cable,
        payload,
        top,
        DT,
        length=LENGTH if length is None else length,
        n_segments=N_SEGMENTS,
        current=current,
        settling=settling,
    )
    solver = LumpedMassSolver(
        line=Line.uniform(cable, LENGTH),
        n_segments=N_SEGMENTS,
        payload=payload,
        current=current or Current(),
        body_drag="vector",
    )
    return theirs, solver.simulate(top, dt=DT, length=length)


def instants(seconds: float) -> Array:
    """Every instant of so many seconds."""
    return DT * np.arange(round(seconds / DT) + 1)


def at_instants(tension: Array) -> Array:
    """Means over steps as values at the instants between them; the ends are left out."""
    return 0.5 * (tension[1:-1] + tension[2:])


def amplitude(signal: Array) -> float:
    """Half of peak to peak over the last 60 s, of which the last instant is left out."""
    return 0.5 * float(np.ptp(signal[-round(60.0 / DT) - 1 : -1]))


def _drawn(theirs: MoorDynRecord, ours: LineRecord, axis: int, what: str) -> Picture:
    def draw(figure: Any) -> None:
        upper, lower = figure.subplots(2, 1, sharex=True)
        upper.plot(theirs.time, theirs.payload_position[:, axis], color=figures.COLOURS[0], lw=3.5)
        upper.plot(ours.time, ours.payload_position[:, axis], color=figures.COLOURS[1], lw=1.0)
        upper.set_ylabel(f"payload {'xyz'[axis]} [m]")
        lower.plot(theirs.time, 1e-3 * theirs.end_tension, color=figures.COLOURS[0], lw=3.5, label="MoorDyn")
        ours_kn = 1e-3 * at_instants(ours.segment_tensions[:, -1])
        lower.plot(ours.time[1:-1], ours_kn, color=figures.COLOURS[1], lw=1.0, label="lumped mass")
        lower.set_ylabel("tension, top segment [kN]")
        lower.set_xlabel("time [s]")
        lower.legend(loc="lower left", ncols=2)

    return Picture(what, draw)


@cache
def vertical(in_air: bool) -> tuple[MoorDynRecord, LineRecord]:
    """1 m at 0.8 rad/s, in heave."""
    time = instants(120.0)
    top = np.stack([0.0 * time, 0.0 * time, gentle(time) * np.sin(0.8 * time) - BELOW], axis=1)
    cable, payload = soft_cable(), thesis_payload()
    if in_air:
        cable, payload = cable.in_air(), payload.in_air()
    return both(cable, payload, top)


@validation("independent code", needs="moordyn")
def moordyn_hanging() -> Iterator[Finding]:
    """The line hanging still: what MoorDyn relaxes to in 300 s is our static equilibrium; both have it to
    a tenth of a millimetre and a newton, the rest of MoorDyn's relaxation."""
    theirs, ours = vertical(False)
    difference = ours.payload_position[0, 2] - theirs.payload_position[0, 2]
    yield absolute("height of the payload, difference [m]", difference, 0.0, 1e-4)
    yield absolute(
        "tension in the top segment, difference [N]",
        ours.segment_tensions[0, -1] - theirs.end_tension[0],
        0.0,
        1.0,
    )


@validation("independent code", needs="moordyn")
def moordyn_heave_in_air_and_water() -> Iterator[Finding]:
    """Heave of 1 m at 0.8 rad/s: amplitudes of payload, middle of the line and tension within 1 %."""
    for in_air, where in ((True, "air"), (False, "water")):
        theirs, ours = vertical(in_air)
        payload = amplitude(ours.payload_position[:, 2])
        yield relative(f"payload in {where} [m]", payload, amplitude(theirs.payload_position[:, 2]), 0.01)
        middle = amplitude(ours.positions[:, N_SEGMENTS // 2, 2])
        yield relative(f"middle in {where} [m]", middle, amplitude(theirs.middle_position[:, 2]), 0.01)
        tension = amplitude(at_instants(ours.segment_tensions[:, -1]))
        yield relative(f"tension in {where} [N]", tension, amplitude(theirs.end_tension[1:-1]), 0.01)
    yield _drawn(*vertical(False), 2, "Heave of 1 m at 0.8 rad/s in water, beside MoorDyn")


@validation("independent code", needs="moordyn")
def moordyn_sway_in_air() -> Iterator[Finding]:
    """Sway of 1 m at 0.8 rad/s in air, where nothing damps the pendulum: amplitudes within 1 %, and the
    paths within 1 cm after 120 s."""
    time = instants(120.0)
    top = np.stack([gentle(time) * np.sin(0.8 * time), 0.0 * time, 0.0 * time - BELOW], axis=1)
    theirs, ours = both(soft_cable().in_air(), thesis_payload().in_air(), top)
    payload = amplitude(ours.payload_position[:, 0])
    yield relative("payload sway [m]", payload, amplitude(theirs.payload_position[:, 0]), 0.01)
    middle = amplitude(ours.positions[:, N_SEGMENTS // 2, 0])
    yield relative("middle sway [m]", middle, amplitude(theirs.middle_position[:, 0]), 0.01)
    apart = float(np.abs(ours.payload_position - theirs.payload_position).max())
    yield absolute("largest distance of the payloads [m]", apart, 0.0, 0.01)


@validation("independent code", needs="moordyn")
def moordyn_circular_top() -> Iterator[Finding]:
    """The upper end on a circle of 2 m radius at 0.5 rad/s in still water: amplitudes of payload and
    middle of the line within 1 % in both directions."""
    time = instants(140.0)
    size = 2.0 * gentle(time)
    top = np.stack([size * np.cos(0.5 * time), size * np.sin(0.5 * time), 0.0 * time - BELOW], axis=1)
    theirs, ours = both(soft_cable(), thesis_payload(), top)
    for axis in (0, 1):
        payload = amplitude(ours.payload_position[:, axis])
        reference = amplitude(theirs.payload_position[:, axis])
        yield relative(f"payload {'xy'[axis]} [m]", payload, reference, 0.01)
        middle = amplitude(ours.positions[:, N_SEGMENTS // 2, axis])
        yield relative(f"middle {'xy'[axis]} [m]", middle, amplitude(theirs.middle_position[:, axis]), 0.01)
    yield _drawn(theirs, ours, 0, "The upper end on a circle of 2 m radius at 0.5 rad/s, beside MoorDyn")


@validation("independent code", needs="moordyn")
def moordyn_steady_current() -> Iterator[Finding]:
    """A current that turns and weakens with depth, 0.6 to 0.2 m/s, and sway, surge and heave of 1 m at
    0.314 rad/s: amplitudes within 1 %; offsets, after 400 s of MoorDyn's own time, within 0.1 %."""
    current = Current(depth=(0.0, 150.0, 350.0), speed=(0.6, 0.4, 0.2), direction=(0.0, 0.4, 1.0))
    time = instants(120.0)
    motion = gentle(time) * np.sin(0.314 * time)
    top = np.stack([motion, motion, motion - BELOW], axis=1)
    theirs, ours = both(soft_cable(), thesis_payload(), top, current=current, settling=400.0)
    for axis in range(3):
        name = "xyz"[axis]
        offset = float(ours.payload_position[0, axis] - top[0, axis])
        reference = float(theirs.payload_position[0, axis] - top[0, axis])
        yield relative(f"offset {name} at rest [m]", offset, reference, 0.001)
        payload = amplitude(ours.payload_position[:, axis])
        yield relative(f"amplitude {name} [m]", payload, amplitude(theirs.payload_position[:, axis]), 0.01)
    yield _drawn(theirs, ours, 0, "Sway, surge and heave of 1 m at 0.314 rad/s in a sheared current")


@validation("independent code", needs="moordyn")
def moordyn_pay_out() -> Iterator[Finding]:
    """Pay-out from 300 to 410 m at 1 m/s under heave of 1 m at 0.8 rad/s, drag of the payload only: MoorDyn
    rescales its segments, so that its nodes slide along the cable, and cable drag would not compare. The
    payload's heave about its mean path within 1 %; the paths within 1 cm of 110 m."""
    time = instants(120.0)
    rate = gentle(time)
    length = LENGTH + np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * DT)])
    top = np.stack([0.0 * time, 0.0 * time, gentle(time) * np.sin(0.8 * time) - BELOW], axis=1)
    cable = soft_cable(tangential_drag_coefficient=0.0, normal_drag_coefficient=0.0)
    theirs, ours = both(cable, thesis_payload(), top, length=length)
    about = [record.payload_position[:, 2] + length for record in (ours, theirs)]
    yield relative("payload about its path [m]", amplitude(about[0]), amplitude(about[1]), 0.01)
    apart = float(np.abs(about[0] - about[1]).max())
    yield absolute("largest distance of the payloads [m]", apart, 0.0, 0.01)
