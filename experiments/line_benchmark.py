"""How fast the 3-D line is, beside MoorDyn in the same run: simulated seconds per second of wall clock.

The system of H 5.7 with 100 segments in a current of 0.5 m/s, its upper end on a circle of 2 m with 1 m of
heave. Both codes march it in turns on one core, so that both meet the same machine; the figure is the
median of the turns. Accuracy is stated beside speed: the largest distance of the payload, after the first
20 s, from a march of a 0.0025 s step, over the radius. MoorDyn's step is bound by axial waves, ours by the
motion that is to be resolved. MoorDyn is called through its Python package, once per step of the motion; its
error is mostly what 240 s of its own relaxation leave.
"""

from __future__ import annotations

import importlib.util
import statistics
import time
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from experiments.cases.lumped_mass import thesis_cable, thesis_payload
from experiments.moordyn_line import COURANT, inner_step, moordyn_march
from heave_env.cable.lumped_mass import LineState, LumpedMassSolver
from heave_env.parameters import Cable, Current, Line
from heave_env.provenance import provenance

Array = np.ndarray

LENGTH, N_SEGMENTS, SECONDS, ROUNDS = 300.0, 100, 40.0, 3
STEPS = (0.1, 0.05, 0.025)
"""Time steps of ours that are measured [s]."""
FINE = 0.0025
"""Time step of the march that both are held to [s]."""
MOTION_DT = 0.05
"""How often MoorDyn is told where the upper end goes [s]."""
RADIUS, BELOW = 2.0, 20.0


@dataclass(frozen=True)
class LineSpeed:
    """One code at one time step."""

    name: str
    """The code and what is special of it."""
    dt: float
    """Its own time step [s]."""
    speed: float
    """Simulated seconds per second, median of the turns [-]."""
    error: float
    """Largest distance of the payload from the fine march, over the radius of the motion [-]."""


def _cable() -> Cable:
    """The thesis's cable with 0.2 ms of Kelvin damping: what MoorDyn's scheme bears at these segments."""
    cable = thesis_cable()
    return replace(cable, axial_damping=2e-4 * cable.axial_stiffness)


def _top(dt: float) -> Array:
    moment = dt * np.arange(round(SECONDS / dt) + 1)
    share = np.minimum(moment / 20.0, 1.0)
    size = share * share * (3.0 - 2.0 * share)
    around = 0.628 * moment
    x, y = RADIUS * size * np.cos(around), RADIUS * size * np.sin(around)
    return np.stack([x, y, size * np.sin(0.8 * moment) - BELOW], axis=1)


def _solver() -> LumpedMassSolver:
    return LumpedMassSolver(
        line=Line.uniform(_cable(), LENGTH),
        n_segments=N_SEGMENTS,
        payload=thesis_payload(),
        current=Current.uniform(0.5),
        body_drag="vector",
    )


def _ours(solver: LumpedMassSolver, start: LineState, dt: float) -> tuple[float, Array]:
    """Seconds of wall clock of one march, and the payload's path."""
    top = _top(dt)
    begin = time.perf_counter()
    record = solver.simulate(top, dt=dt, start=start)
    return time.perf_counter() - begin, record.payload_position


def _theirs(settling: float) -> tuple[float, Array]:
    record = moordyn_march(
        _cable(),
        thesis_payload(),
        _top(MOTION_DT),
        MOTION_DT,
        length=LENGTH,
        n_segments=N_SEGMENTS,
        current=Current.uniform(0.5),
        settling=settling,
    )
    return record.seconds, record.payload_position


def _error(path: Array, dt: float, fine: Array) -> float:
    """Largest distance between two paths at common instants from 20 s on, over the radius."""
    every = round(MOTION_DT / dt) if dt < MOTION_DT else 1
    step = max(dt, MOTION_DT)
    ours, reference = path[::every], fine[:: round(step / FINE)]
    late = round(20.0 / step)
    return float(np.linalg.norm(ours - reference, axis=1)[late:].max()) / RADIUS


def line_speeds(rounds: int = ROUNDS) -> list[LineSpeed]:
    """Measures both codes in turns; without MoorDyn only ours."""
    solver = _solver()
    start = solver.rest((0.0, 0.0, -BELOW))
    fine = _ours(solver, start, FINE)[1]
    beside = importlib.util.find_spec("moordyn") is not None
    ours: dict[float, list[float]] = {dt: [] for dt in STEPS}
    theirs: list[float] = []
    paths: dict[float, Array] = {}
    if beside:
        # Its own relaxation is slow: the accuracy is measured once from rest, the speed from where it begins.
        their_path = _theirs(240.0)[1]
    for _ in range(rounds):
        for dt in STEPS:
            seconds, paths[dt] = _ours(solver, start, dt)
            ours[dt].append(SECONDS / seconds)
        if beside:
            theirs.append(SECONDS / _theirs(0.0)[0])
    speeds = [
        LineSpeed("lumped mass, 3-D", dt, statistics.median(ours[dt]), _error(paths[dt], dt, fine))
        for dt in STEPS
    ]
    if beside:
        inner = inner_step(_cable(), LENGTH, N_SEGMENTS, MOTION_DT)
        name = f"MoorDyn, RK4, {COURANT:g} of a segment's travel time"
        error = _error(their_path, MOTION_DT, fine)
        speeds.append(LineSpeed(name, inner, statistics.median(theirs), error))
    return speeds


def line_table(speeds: list[LineSpeed]) -> list[str]:
    """The speeds as lines of text."""
    rows = [f"{'line of 100 segments':<48}{'time step [s]':>14}{'simulated s per s':>20}{'error':>10}"]
    rows += [f"{speed.name:<48}{speed.dt:>14.5f}{speed.speed:>20.0f}{speed.error:>10.2%}" for speed in speeds]
    return rows


def line_figures(speeds: list[LineSpeed], arguments: list[str] | None = None) -> dict[str, Any]:
    """The speeds with where they were measured, as plain values."""
    return {"lines": [asdict(speed) for speed in speeds], "provenance": provenance(arguments)}
