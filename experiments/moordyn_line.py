"""The same line in MoorDyn, an independent lumped-mass code, driven through its Python package.

MoorDyn (version 2, with its Runge-Kutta scheme of order 4) is a test dependency; only this module
imports it, when asked for. What one must know of it:

- a step moves a driven end from where it is told at a constant velocity, so that it is told position and
  chord of every step; each change of that velocity sends an axial wave of m c Δv up and down the line, so
  that tensions are compared at a small step;
- the tension that it gives at an end is that of the end segment's middle;
- a changed length rescales all segments alike, so that its nodes are no material points: drag along the
  cable is then wrong, and pay-out is compared without it;
- the rate of change of the length stays until it is told another, and the call that tells it takes a
  reference to None that it does not own: without amends the process aborts at its end;
- drag of a body goes along the relative velocity, and its added mass is the same in all directions;
- it writes to the process's own output, which is silenced here.

Its explicit scheme is stable for steps below some 0.6 of a segment over the speed of axial waves.
"""

from __future__ import annotations

import ctypes
import math
import os
import tempfile
import time as clock
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from heave_env.parameters import GRAVITY, SEAWATER_DENSITY, Cable, Current, Payload

Array = np.ndarray

COURANT = 0.6
"""MoorDyn's step over the time that an axial wave takes through a segment [-]."""
DEPTH = 4000.0
"""Depth of a seabed that nothing reaches [m]."""


@dataclass(frozen=True)
class MoorDynRecord:
    """What MoorDyn says at every instant, the first included."""

    time: Array
    """Instants [s], (n_steps + 1,)."""
    payload_position: Array
    """Lower end [m], (n_steps + 1, 3)."""
    end_tension: Array
    """Tension in the middle of the uppermost segment [N], (n_steps + 1,)."""
    middle_position: Array
    """Node halfway along the line [m], (n_steps + 1, 3)."""
    inner_dt: float
    """Its own time step [s]."""
    seconds: float
    """What the march itself took [s of wall clock]."""


@contextmanager
def _silent() -> Iterator[None]:
    """Sends what a library writes to the process's output into nothing."""
    kept = os.dup(1), os.dup(2)
    with open(os.devnull, "w") as nowhere:
        try:
            os.dup2(nowhere.fileno(), 1)
            os.dup2(nowhere.fileno(), 2)
            yield
        finally:
            for number, copy in zip((1, 2), kept, strict=True):
                os.dup2(copy, number)
                os.close(copy)


def inner_step(cable: Cable, length: float, n_segments: int, dt: float, courant: float = COURANT) -> float:
    """MoorDyn's own step: the largest part of `dt` that the Courant number allows [s]."""
    wave_speed = math.sqrt(cable.axial_stiffness / cable.mass_per_length)
    return dt / math.ceil(dt / (courant * length / n_segments / wave_speed))


def _deck(
    cable: Cable, payload: Payload, length: float, n_segments: int, top: Array, inner: float, current: bool
) -> str:
    """The input file: a free body hanging on one line from a driven point."""
    volume = (payload.mass * GRAVITY - payload.submerged_weight) / (SEAWATER_DENSITY * GRAVITY)
    in_air = volume < 1e-9 * payload.mass
    added_mass = 0.0 if in_air else payload.added_mass / (SEAWATER_DENSITY * volume)
    hanging = payload.submerged_weight + 0.5 * cable.submerged_weight * length
    low = top - [0.0, 0.0, length * (1.0 + hanging / cable.axial_stiffness)]
    # MoorDyn has one density: the diameter that displaces and the one that drags are the same there.
    section = 0.25 * math.pi * cable.diameter**2
    weight = (cable.mass_per_length - (0.0 if in_air else SEAWATER_DENSITY * section)) * GRAVITY
    if not math.isclose(weight, cable.submerged_weight, rel_tol=1e-6):
        raise ValueError(f"the cable's weight must be that of its section, {weight:g} N/m, for MoorDyn")
    if payload.lateral_added_mass is not None or payload.lateral_drag_area is not None:
        raise ValueError("the payload's added mass and drag must be alike in all directions for MoorDyn")
    law = f"{cable.diameter!r} {cable.mass_per_length!r} {cable.axial_stiffness!r} {cable.axial_damping!r} 0"
    water = f"{cable.normal_drag_coefficient!r} {cable.normal_added_mass_coefficient!r}"
    water += f" {cable.tangential_drag_coefficient!r} {cable.added_mass_per_length!r}"
    body = f"{payload.mass!r} {0.0 if in_air else volume!r} {payload.drag_area!r} {added_mass!r}"
    rows = [
        "A line and a body",
        "--- LINE TYPES ---",
        "Name Diam Mass EA BA EI Cd Ca CdAx CaAx",
        "(-) (m) (kg/m) (N) (N-s) (N-m2) (-) (-) (-) (-)",
        f"rope {law} {water}",
        "--- POINTS ---",
        "ID Type X Y Z Mass Volume CdA Ca",
        "(#) (-) (m) (m) (m) (kg) (m3) (m2) (-)",
        "1 Free " + " ".join(repr(float(x)) for x in low) + f" {body}",
        "2 Coupled " + " ".join(repr(float(x)) for x in top) + " 0 0 0 0",
        "--- LINES ---",
        "ID LineType AttachA AttachB UnstrLen NumSegs Outputs",
        "(#) (-) (#) (#) (m) (-) (-)",
        f"1 rope 1 2 {length!r} {n_segments} -",
        "--- OPTIONS ---",
        "0 writeLog",
        f"{GRAVITY!r} g",
        f"{0.0 if in_air else SEAWATER_DENSITY!r} WtrDnsty",
        f"{DEPTH!r} WtrDpth",
        f"{inner!r} dtM",
        "RK4 tScheme",
        "1.0 dtIC",
        "1e-6 threshIC",
        "60 TmaxIC",
        "1 CdScaleIC",
        "1 ICgenDynamic",
        "1 disableOutput",
        "1 disableOutTime",
        f"{int(current)} Currents",
        "--- end ---",
        "",
    ]
    return "\n".join(rows)


def _profile(current: Current) -> str:
    depth, speed = np.array(current.depth), np.array(current.speed)
    along_x, along_y = speed * np.cos(current.direction), speed * np.sin(current.direction)
    if len(depth) == 1:
        depth, along_x, along_y = np.array([0.0, DEPTH]), along_x.repeat(2), along_y.repeat(2)
    rows = [f"{-d} {x} {y} 0" for d, x, y in zip(depth[::-1], along_x[::-1], along_y[::-1], strict=True)]
    return "\n".join(["--- steady currents ---", "velocity over height", "(m) (m/s) (m/s) (m/s)", *rows, ""])


def moordyn_march(
    cable: Cable,
    payload: Payload,
    top: Array,
    dt: float,
    *,
    length: Array | float,
    n_segments: int,
    current: Current | None = None,
    settling: float = 200.0,
    courant: float = COURANT,
) -> MoorDynRecord:
    """Hangs a payload on a line in MoorDyn, lets it come to rest and drives its upper end.

    Args:
        cable: The line; its weight must be that of its section in sea water, or its whole weight in air.
        payload: The body at the lower end, alike in all directions.
        top: Positions of the upper end [m], (n_steps + 1, 3), well below the surface, z = 0.
        dt: From one instant to the next [s].
        length: Unstretched length [m], or (n_steps + 1,).
        n_segments: Segments [-].
        current: A steady current.
        settling: How long it hangs still before the first instant [s].
        courant: Its own step over a segment's travel time.
    """
    import moordyn

    lengths = np.broadcast_to(np.asarray(length, dtype=float), (len(top),))
    inner = inner_step(cable, float(lengths.min()), n_segments, dt, courant)
    positions, middle, tension = np.empty((len(top), 3)), np.empty((len(top), 3)), np.empty(len(top))
    with tempfile.TemporaryDirectory() as folder, _silent():
        deck = Path(folder) / "line.txt"
        deck.write_text(
            _deck(cable, payload, float(lengths[0]), n_segments, top[0], inner, current is not None)
        )
        if current is not None:
            (Path(folder) / "current_profile.txt").write_text(_profile(current))
        system = moordyn.Create(str(deck))
        try:
            moordyn.Init(system, list(top[0]), [0.0, 0.0, 0.0])
            line = moordyn.GetLine(system, 1)
            n_settling = round(settling / dt)
            for k in range(n_settling):
                moordyn.Step(system, list(top[0]), [0.0, 0.0, 0.0], k * dt, dt)
            begin, told = clock.perf_counter(), 0.0
            for k in range(len(top)):
                positions[k] = moordyn.GetLineNodePos(line, 0)
                middle[k] = moordyn.GetLineNodePos(line, n_segments // 2)
                tension[k] = moordyn.GetLineFairTen(line)
                if k + 1 < len(top):
                    rate = (lengths[k + 1] - lengths[k]) / dt
                    if rate != told:
                        moordyn.SetLineUnstretchedLengthVel(line, float(rate))
                        ctypes.pythonapi.Py_IncRef(ctypes.py_object(None))
                        told = rate
                    velocity = list((top[k + 1] - top[k]) / dt)
                    moordyn.Step(system, list(top[k]), velocity, (n_settling + k) * dt, dt)
            seconds = clock.perf_counter() - begin
        finally:
            moordyn.Close(system)
    return MoorDynRecord(dt * np.arange(len(top)), positions, tension, middle, inner, seconds)
