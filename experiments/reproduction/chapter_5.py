"""Huang (1992), chapter 5: the line in three dimensions, swayed in currents and towed round a loop."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from experiments.cases.lumped_mass import HangingLine, loop_turn, thesis_current
from experiments.figures import COLOURS
from experiments.reproduction.figure import Caption, reproduction
from heave_env.cable.lumped_mass import LineRecord
from heave_env.parameters import Current

Array = np.ndarray

SYSTEM = (
    "Cable 0.047 m, 300 m, E 9e9 N/m², 5.4 kg/m, C_N 1.2, C_τ 0.01; unit 3000 kg + 3000 kg, C_D 1.5 on "
    "0.5 m² and 0.354 m³"
)
ASSUMED = (
    "Sea water of 1025 kg/m³, g 9.80665 m/s², added mass of the cable that of a circular cylinder, no "
    "internal damping, the unit's drag axis by axis"
)


@cache
def _swayed(omega: float, n_segments: int, speed: float) -> LineRecord:
    """x = y = z = sin(omega t) at the top, a current along x, from unstrained on the z-axis."""
    case = replace(
        thesis_current(),
        current=Current.uniform(speed),
        motion_omega=omega,
        n_segments=n_segments,
        duration=240.0,
        dt=0.02 if n_segments < 80 else 0.05,
        settling=0.0,
    )
    return case.record()


def _last(record: LineRecord, axis: int, omega: float) -> tuple[float, float]:
    """Half the range and the middle of the unit's motion over the last two periods [m]."""
    late = record.time > record.time[-1] - 4.0 * math.pi / omega
    motion = record.payload_position[late, axis]
    return 0.5 * float(np.ptp(motion)), 0.5 * float(motion.max() + motion.min())


def _draw_convergence(figure: Any, omega: float, counts: tuple[int, ...]) -> None:
    across, down = figure.subplots(2, 1, sharex=True)
    for k, n in enumerate(counts):
        record = _swayed(omega, n, 0.0)
        style = {"color": COLOURS[1 + k], "lw": 2.4 - 0.5 * k, "label": f"{n} segments"}
        across.plot(record.time, record.payload_position[:, 0], **style)
        down.plot(record.time, record.payload_position[:, 2], **style)
    across.set_ylabel("unit x [m]")
    down.set_ylabel("unit z [m]")
    down.set_xlabel("time [s]")
    down.set_xlim(0.0, 100.0)
    figure.legend(*across.get_legend_handles_labels(), loc="outside upper center", ncols=len(counts))


def _convergence_caption(omega: float, counts: tuple[int, ...], said: str) -> Caption:
    finest = _swayed(omega, counts[-1], 0.0)
    errors = ", ".join(
        f"{n}: {abs(_last(_swayed(omega, n, 0.0), 0, omega)[0] / _last(finest, 0, omega)[0] - 1.0):.1%}"
        for n in counts[:-1]
    )
    return Caption(
        parameters=(
            f"{SYSTEM}; x = y = z = sin({omega:g} t) at the top, from unstrained on the z-axis; "
            f"{', '.join(map(str, counts))} segments, step 0.02 s; y is as x"
        ),
        assumed=ASSUMED + "; the numbers of segments that the figure compares",
        shows=(
            f"{said} Sway amplitude of the unit at the end, from that with {counts[-1]} segments, {errors}. "
            f"The unit sways {_last(finest, 0, omega)[0]:.3g} m, less than the top, at the top's period; "
            "the vertical vibration of the unstrained start dies out."
        ),
    )


@reproduction("H 5.4", "Convergence with the number of segments at 0.314 rad/s", size=(6.0, 4.4))
def thesis_5_4(figure: Any) -> Caption:
    counts = (5, 10, 20, 40)
    _draw_convergence(figure, 0.314, counts)
    return _convergence_caption(0.314, counts, "The thesis finds 20 segments more than adequate; so do we.")


@reproduction("H 5.5", "Convergence with the number of segments at 1.256 rad/s", size=(6.0, 4.4))
def thesis_5_5(figure: Any) -> Caption:
    counts = (5, 10, 20, 40)
    _draw_convergence(figure, 1.256, counts)
    return _convergence_caption(
        1.256,
        counts,
        "The thesis wants at least 40 here, with a scheme of first order; the error at a given number is "
        "larger than at 0.314 rad/s.",
    )


def _draw_current(figure: Any, omega: float, beside: LineRecord, name: str) -> None:
    axes = figure.subplots(3, 1, sharex=True)
    for k, (record, label) in enumerate(
        ((beside, name), (_swayed(omega, 40, 0.5), f"0.5 m/s, {omega:g} rad/s"))
    ):
        for axis in range(3):
            axes[axis].plot(
                record.time, record.payload_position[:, axis], color=COLOURS[3 * k], lw=1.2, label=label
            )
    for axis in range(3):
        axes[axis].set_ylabel(f"unit {'xyz'[axis]} [m]")
    axes[2].set_xlabel("time [s]")
    axes[2].set_xlim(0.0, 150.0)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)


@reproduction("H 5.6", "Effect of a current of 0.5 m/s, top at 0.314 rad/s", size=(6.0, 5.0))
def thesis_5_6(figure: Any) -> Caption:
    calm, swept = _swayed(0.314, 40, 0.0), _swayed(0.314, 40, 0.5)
    _draw_current(figure, 0.314, calm, "still water, 0.314 rad/s")
    sway, offset = _last(swept, 0, 0.314)
    raised = _last(swept, 2, 0.314)[1] - _last(calm, 2, 0.314)[1]
    return Caption(
        parameters=(
            f"{SYSTEM}; x = y = z = sin(0.314 t) at the top; uniform current of 0.5 m/s along x; "
            "40 segments, step 0.02 s"
        ),
        assumed=ASSUMED + "; the still water beside it is of figure 5.4",
        shows=(
            f"As the thesis says: the unit moves to {offset:.3g} m downstream, its sway falls from "
            f"{_last(calm, 0, 0.314)[0]:.2g} to {sway:.2g} m, its mean height rises by {raised:.2g} m, "
            "and its heave hardly changes "
            f"({_last(calm, 2, 0.314)[0]:.3g} and {_last(swept, 2, 0.314)[0]:.3g} m)."
        ),
    )


@reproduction("H 5.7", "Effect of the frequency: 0.628 rad/s in the same current", size=(6.0, 5.0))
def thesis_5_7(figure: Any) -> Caption:
    slow, fast = _swayed(0.314, 40, 0.5), _swayed(0.628, 40, 0.5)
    _draw_current(figure, 0.628, slow, "0.5 m/s, 0.314 rad/s")
    return Caption(
        parameters=(
            f"{SYSTEM}; x = y = z = sin(0.628 t) at the top; uniform current of 0.5 m/s along x; "
            "40 segments, step 0.02 s"
        ),
        assumed=ASSUMED + "; the slower motion beside it is of figure 5.6",
        shows=(
            f"As the thesis says: the unit sways less, {_last(fast, 0, 0.628)[0]:.2g} m for "
            f"{_last(slow, 0, 0.314)[0]:.2g} m, about nearly the same mean, "
            f"{_last(fast, 0, 0.628)[1]:.3g} m for {_last(slow, 0, 0.314)[1]:.3g} m."
        ),
    )


# The loop turn -------------------------------------------------------------------------------------


@cache
def _looped(speed: float, in_air: bool) -> tuple[LineRecord, Array, HangingLine]:
    case = replace(
        loop_turn(),
        tow_speed=speed,
        duration=(800.0 + 300.0 * math.pi) / speed + 600.0 / speed,
        n_segments=40,
    )
    if in_air:
        section = case.line.sections[0]
        line = replace(case.line, sections=(replace(section, cable=section.cable.in_air()),))
        case = replace(case, line=line, payload=case.payload.in_air())
    record = case.record()
    every = round((record.time[1] - record.time[0]) / case.dt)
    return record, case.top()[::every][: len(record.time)], case


def _draw_loop(figure: Any, speed: float, in_air: bool) -> tuple[LineRecord, Array]:
    record, top, case = _looped(speed, in_air)
    plan, height = figure.subplots(2, 1, height_ratios=(2.0, 1.0))
    x = record.payload_position
    plan.plot(top[:, 0], top[:, 1], color=COLOURS[0], label="towpoint")
    plan.plot(x[:, 0], x[:, 1], color=COLOURS[1], lw=1.2, label="unit")
    turn = (case.loop_start + 2.0 * math.pi * case.loop_radius) / speed
    for k, moment in enumerate((0.0, 0.25, 0.5, 0.75, 1.0)):
        at = case.loop_start / speed + moment * (turn - case.loop_start / speed)
        r = record.positions[int(np.argmin(np.abs(record.time - at)))]
        label = "line, every quarter of the turn" if k == 0 else None
        plan.plot(r[:, 0], r[:, 1], color=COLOURS[3], lw=0.8, label=label)
        plan.plot(r[0, 0], r[0, 1], "o", color=COLOURS[3], ms=3)
    plan.set_aspect("equal")
    plan.set_xlim(420.0, 1240.0)
    plan.set_ylim(-40.0, 340.0)
    plan.set_xlabel("x [m]")
    plan.set_ylabel("y [m]")
    figure.legend(*plan.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    height.plot(record.time, x[:, 2], color=COLOURS[1], lw=0.9)
    height.axvspan(case.loop_start / speed, turn, color=COLOURS[0], alpha=0.15, lw=0.0)
    height.set_xlim(0.0, float(record.time[-1]))
    height.set_xlabel("time [s]; shaded: the turn")
    height.set_ylabel("unit z [m]")
    return record, top


def _loop_parameters(speed: float) -> str:
    return (
        f"{SYSTEM}; towpoint at {speed:g} m/s for 800 m along x, once round a circle of 150 m radius, "
        "straight on; from unstrained on the z-axis; 40 segments, step 0.05 s"
    )


def _loop_words(record: LineRecord, top: Array, speed: float) -> str:
    turning = (record.time > 800.0 / speed) & (record.time < (800.0 + 300.0 * math.pi) / speed)
    behind = np.linalg.norm((record.payload_position - top)[:, :2], axis=1)
    before = record.time < 800.0 / speed
    radius = np.linalg.norm(record.payload_position[turning, :2] - [800.0, 150.0], axis=1)
    return (
        f"the unit follows {behind[before][-1]:.0f} m behind and "
        f"{-record.payload_position[before][-1, 2]:.0f} m deep, cuts the turn to within "
        f"{radius.min():.0f} m of its centre and sinks to "
        f"{-record.payload_position[turning, 2].min():.0f} m in it"
    )


@reproduction("H 5.8", "Loop turn at 4 m/s", size=(6.0, 5.6))
def thesis_5_8(figure: Any) -> Caption:
    record, top = _draw_loop(figure, 4.0, False)
    return Caption(
        parameters=_loop_parameters(4.0),
        assumed=ASSUMED + "; how far it goes on beyond the circle",
        shows=f"At 4 m/s {_loop_words(record, top, 4.0)}. The upper picture is a plan.",
    )


@reproduction("H 5.9", "Loop turn at 2 m/s", size=(6.0, 5.6))
def thesis_5_9(figure: Any) -> Caption:
    record, top = _draw_loop(figure, 2.0, False)
    return Caption(
        parameters=_loop_parameters(2.0),
        assumed=ASSUMED + "; how far it goes on beyond the circle",
        shows=(
            f"At 2 m/s {_loop_words(record, top, 2.0)}. The effect of the speed, which the thesis calls "
            "evident, is that the slower tow hangs steeper and turns wider."
        ),
    )


@reproduction("H 5.10", "Loop turn at 4 m/s in air", size=(6.0, 5.6))
def thesis_5_10(figure: Any) -> Caption:
    record, top = _draw_loop(figure, 4.0, True)
    turned = record.time > 200.0
    swing = float(np.abs(record.payload_position[turned, 1] - top[turned, 1]).max())
    behind = np.linalg.norm((record.payload_position - top)[:, :2], axis=1)
    # What is faster than a swing: off the mean over 8 s.
    n = round(8.0 / float(record.time[1]))
    height = record.payload_position[:, 2]
    fast = (height - np.convolve(height, np.ones(n) / n, mode="same"))[n:-n]
    minute = round(60.0 / float(record.time[1]))
    first, last = (0.5 * float(np.ptp(part)) for part in (fast[:minute], fast[-minute:]))
    return Caption(
        parameters=_loop_parameters(4.0) + "; no drag, no buoyancy, no added mass",
        assumed="g 9.80665 m/s², no internal damping, how far it goes on beyond the circle",
        shows=(
            f"As the thesis says: the unit swings across once it enters the circle, up to {swing:.1f} m, and "
            f"the vertical vibration of the start persists, {first:.2f} m in the first minute and "
            f"{last:.2f} m in the last. The sudden start to 4 m/s also makes it swing up to "
            f"{behind.max():.0f} m along the path, and that swing keeps its direction through the turn."
        ),
    )
