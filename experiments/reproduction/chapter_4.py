"""Huang (1992), chapter 4: the figures of the planar cable. The published curves are lost; text is "
"compared."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

from experiments.cases.axial import cycle_amplitude
from experiments.cases.planar import (
    INK,
    PlanarOperation,
    PlanarSwept,
    example_five,
    example_four,
    example_three,
    sphere_sweep,
)
from experiments.figures import COLOURS
from experiments.reproduction.figure import Caption, reproduction
from heave_env.cable.closed_form import resonant_length
from heave_env.cable.planar import PlanarRecord

Array = np.ndarray

AMPLITUDES = (0.05, 0.10, 0.15)
"""Of the circling top in examples one [m]; print names the largest alone."""
SPEEDS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
"""Currents of example three [m/s]."""
WEAK = 0.1
"""The weak current of example five [m/s]."""

SPHERE = (
    "4.573 m of polyester rope ({rope}), wooden sphere of 0.2032 m and 4.722 kg; 6 elements, 160 steps per "
    "period, largest tension at the top over 6 periods after 24 of growth (14 in water)"
)
ROPES = {
    "3 mm": "3 mm, E 3.38e9 N/m², 8.067e-3 kg/m",
    "2 mm": "2 mm, E 2.445e9 N/m², 4.155e-3 kg/m",
}
IN_AIR = "Drag of the sphere in air (coefficient 0.5, 1.2 kg/m³), without which nothing settles"
IN_WATER = (
    "Fresh water; added mass half the displaced water's; drag coefficients 0.5 (sphere), 1.2 and 0.01 (rope "
    "across "
    "and along); Kelvin damping of 5 ms"
)
DEEP = (
    "Cable of {diameter}, E {modulus} N/m², 5.2 kg/m; unit of 1900 kg with 1600 kg of added mass, 15 kN in "
    "water; "
    "40 elements, steps of 0.05 s"
)
DEEP_DRAG = (
    "Drag is not printed: coefficients 1.2 across and 0.01 along the cable, 0.75 m² of the unit in both "
    "directions "
    "(by components), as in the thesis's chapter 5; cable's weight in sea water from its section"
)


# Examples one and two: tension against frequency ---------------------------------------------------


@cache
def swept(rope: str, water: bool, sway: float, heave: float, tension_only: bool = False) -> PlanarSwept:
    """A frequency sweep of the sphere, as coarse as a figure needs; finer about the swing in air."""
    sweep = sphere_sweep(
        rope=rope,
        water=water,
        sway=sway,
        heave=heave,
        tension_only=tension_only,
        n_elements=6,
        steps_per_period=160,
        n_settling=14 if water else 24,
        n_measured=6,
    )
    if water:
        return sweep.sweep(np.linspace(0.3, 4.0, 38))
    return sweep.sweep(
        np.concatenate([np.linspace(0.3, 1.1, 6), np.arange(1.2, 1.8, 0.04), np.linspace(1.8, 6.0, 15)])
    )


def draw_tension(axes: Any, sweep: PlanarSwept, label: str, colour: str, **style: Any) -> None:
    """Largest tension against frequency."""
    axes.plot(sweep.omega, sweep.tension_max, color=colour, label=label, **style)
    axes.set_xlabel("frequency of the top [rad/s]")
    axes.set_ylabel("largest tension [N]")


def mark_swing(axes: Any, omega: float) -> None:
    """Marks the pendulum's frequency."""
    axes.axvline(omega, color=INK, lw=0.8, ls=":")
    axes.annotate(
        "pendulum",
        (omega, 1.0),
        xycoords=("data", "axes fraction"),
        xytext=(3.0, -10.0),
        textcoords="offset points",
        fontsize=8.0,
        color=INK,
    )


@reproduction("H 4.2", "Example one: tension against frequency, top swaying 0.15 m in air")
def thesis_4_2(figure: Any) -> Caption:
    sweep = sphere_sweep(water=False, sway=0.15, heave=0.0)
    axes = figure.subplots()
    draw_tension(axes, swept("3 mm", False, 0.15, 0.0), "largest", COLOURS[3])
    axes.axhline(sweep.static_tension, color=INK, lw=0.8, ls="--", label="static")
    mark_swing(axes, sweep.swing_omega)
    axes.legend()
    return Caption(
        parameters=SPHERE.format(rope=ROPES["3 mm"]) + "; horizontal motion of 0.15 m",
        assumed=IN_AIR + ", and the range of frequencies",
        shows="Away from resonance sway hardly changes the tension, a second-order effect; at the pendulum's "
        "frequency the swing is large. There alone, says the text, theory and experiment part.",
    )


@reproduction("H 4.3", "Example one: tension against frequency, top swaying 0.15 m in water")
def thesis_4_3(figure: Any) -> Caption:
    sweep = sphere_sweep(water=True, sway=0.15, heave=0.0)
    axes = figure.subplots()
    draw_tension(axes, swept("3 mm", True, 0.15, 0.0), "largest", COLOURS[3])
    axes.axhline(sweep.static_tension, color=INK, lw=0.8, ls="--", label="static")
    mark_swing(axes, sweep.swing_omega)
    axes.legend()
    return Caption(
        parameters=SPHERE.format(rope=ROPES["3 mm"]) + "; horizontal motion of 0.15 m",
        assumed=IN_WATER,
        shows="Drag takes the pendulum's resonance away; the tension rises only where the rope, whipped "
        "through "
        "the water, is drawn aside. The sphere nearly floats: its weight in water is 3.2 N.",
    )


@reproduction("H 4.4", "Example one: tension against frequency, top circling in air")
def thesis_4_4(figure: Any) -> Caption:
    axes = figure.subplots()
    for amplitude, colour in zip(AMPLITUDES, COLOURS[2:5], strict=True):
        draw_tension(axes, swept("3 mm", False, amplitude, amplitude), f"{amplitude:.2f} m", colour)
    mark_swing(axes, sphere_sweep(water=False, sway=0.15, heave=0.15).swing_omega)
    axes.legend(title="radius")
    return Caption(
        parameters=SPHERE.format(rope=ROPES["3 mm"]) + "; circles of 0.05, 0.10 and 0.15 m",
        assumed=IN_AIR + "; the two smaller amplitudes and the range of frequencies",
        shows="The tension follows the heave, weight plus mass times Aω², with the pendulum's resonance on "
        "top; "
        "the cable stays taut. The text calls the agreement with the experiment extremely good here.",
    )


@reproduction("H 4.5", "Example one: tension against frequency, top circling in water")
def thesis_4_5(figure: Any) -> Caption:
    axes = figure.subplots()
    for amplitude, colour in zip(AMPLITUDES, COLOURS[2:5], strict=True):
        linear = swept("3 mm", True, amplitude, amplitude)
        slack = swept("3 mm", True, amplitude, amplitude, True)
        draw_tension(axes, slack, f"{amplitude:.2f} m", colour)
        pressed = linear.tension_min <= 0.0
        taut = np.where(pressed, np.nan, linear.tension_max)
        axes.plot(linear.omega, taut, color=colour, lw=3.5, alpha=0.35)
        if pressed.any():
            first = int(np.argmax(pressed))
            axes.plot(linear.omega[first], linear.tension_max[first], "o", color=colour, ms=5)
    axes.axvline(2.5, color=INK, lw=0.8, ls=":")
    axes.annotate(
        "text: negative\ntension, 0.15 m",
        (2.5, 0.36),
        xycoords=("data", "axes fraction"),
        xytext=(4.0, 0.0),
        textcoords="offset points",
        fontsize=8.0,
        color=INK,
        va="top",
    )
    axes.set_yscale("log")
    axes.legend(title="radius", loc="upper left")
    return Caption(
        parameters=SPHERE.format(rope=ROPES["3 mm"]) + "; circles of 0.05, 0.10 and 0.15 m",
        assumed=IN_WATER + "; the two smaller amplitudes and the range of frequencies",
        shows="Thin: a rope that goes slack. Broad: the thesis's linear rope while its tension stays "
        "positive; dots: "
        "the first frequency at which it does not. At 2.5 rad/s and 0.15 m it is negative, as the text "
        "says, and "
        "slack has raised the tension sharply, as its experiment did.",
    )


@reproduction("H 4.6", "Example two: tension against frequency, top circling 0.1 m in air and in water")
def thesis_4_6(figure: Any) -> Caption:
    axes = figure.subplots()
    draw_tension(axes, swept("2 mm", False, 0.1, 0.1), "in air", COLOURS[2])
    draw_tension(axes, swept("2 mm", True, 0.1, 0.1, True), "in water, slack allowed", COLOURS[3])
    linear = swept("2 mm", True, 0.1, 0.1)
    pressed = linear.tension_min <= 0.0
    axes.plot(
        linear.omega,
        np.where(pressed, np.nan, linear.tension_max),
        color=COLOURS[3],
        lw=3.5,
        alpha=0.35,
        label="in water, linear while taut",
    )
    first = int(np.argmax(pressed))
    axes.plot(linear.omega[first], linear.tension_max[first], "o", color=COLOURS[3], ms=5)
    axes.set_yscale("log")
    axes.legend()
    return Caption(
        parameters=SPHERE.format(rope=ROPES["2 mm"]) + "; a circle of 0.1 m",
        assumed=IN_AIR + ". " + IN_WATER + "; the range of frequencies",
        shows="In water the rope goes slack at high frequencies (dot: first negative tension of the linear "
        "rope), and "
        "the tension then rises sharply by snatching, as the text says of the experiment.",
    )


# Example three: steady dynamics in a current -------------------------------------------------------


@cache
def in_currents() -> dict[str, Array]:
    """Settled means and amplitudes of example three against the current, each (n_speeds,)."""
    rows = []
    for speed in SPEEDS:
        operation = example_three(speed, n_elements=30, duration=400.0, settling=340.0)
        record = operation.record()
        settled = record.time >= operation.settling
        x, z = record.payload_x[settled], record.payload_z[settled]
        rows.append((x.mean(), z.mean(), 0.5 * np.ptp(x), 0.5 * np.ptp(z)))
    return dict(zip(("x", "z", "sway", "heave"), np.array(rows).T, strict=True))


EXAMPLE_THREE = DEEP.format(diameter="0.02 m", modulus="4e9").replace("40 elements", "30 elements") + (
    "; 300 m in a uniform current; the last 60 of 400 s"
)
EXAMPLE_THREE_ASSUMED = DEEP_DRAG + "; the top moves on a circle of 1 m at 1 rad/s, as in example five"


@reproduction("H 4.7", "Example three: mean position of the unit against the current")
def thesis_4_7(figure: Any) -> Caption:
    found = in_currents()
    left, right = figure.subplots(1, 2)
    left.plot(SPEEDS, found["x"], "o-", ms=3.5, color=COLOURS[1])
    left.set_ylabel("mean horizontal position [m]")
    right.plot(SPEEDS, found["z"], "o-", ms=3.5, color=COLOURS[3])
    right.set_ylabel("mean vertical position z [m]")
    for axes in (left, right):
        axes.set_xlabel("current [m/s]")
    return Caption(
        parameters=EXAMPLE_THREE,
        assumed=EXAMPLE_THREE_ASSUMED,
        shows="The unit moves away from the vertical with the current, and rises, as the text says. Without "
        "current it "
        "stands a little off the circle's centre, x = 1 m: tension and slope of a circling cable vary in "
        "step, and "
        "their product has a mean that pushes aside.",
    )


def draw_amplitude(figure: Any, name: str, label: str, colour: str) -> None:
    axes = figure.subplots()
    axes.plot(SPEEDS, in_currents()[name], "o-", ms=3.5, color=colour)
    axes.margins(y=0.15)
    axes.set_xlabel("current [m/s]")
    axes.set_ylabel(label)


@reproduction("H 4.8", "Example three: amplitude of the unit's vertical motion against the current")
def thesis_4_8(figure: Any) -> Caption:
    draw_amplitude(figure, "heave", "vertical amplitude [m]", COLOURS[3])
    return Caption(
        parameters=EXAMPLE_THREE,
        assumed=EXAMPLE_THREE_ASSUMED,
        shows="A metre of heave at the top is amplified to some 3.5 m, for 300 m lies near resonance at "
        "1 rad/s; up to 1 m/s the current changes that by one per cent. The scale does not begin at zero.",
    )


@reproduction("H 4.9", "Example three: amplitude of the unit's horizontal motion against the current")
def thesis_4_9(figure: Any) -> Caption:
    draw_amplitude(figure, "sway", "horizontal amplitude [m]", COLOURS[1])
    return Caption(
        parameters=EXAMPLE_THREE,
        assumed=EXAMPLE_THREE_ASSUMED,
        shows="The top's sway of a metre dies out on the way down; the unit moves by centimetres. In a "
        "stronger current "
        "the deflected cable turns part of the heave into sway, and the amplitude grows again.",
    )


# Example four: sway while lowering -----------------------------------------------------------------


def draw_sway(figure: Any, speed: float) -> float:
    """The unit's sway against length; returns its largest [m]."""
    record = example_four(speed).record()
    largest = int(np.argmax(np.abs(record.payload_x)))
    axes = figure.subplots()
    axes.plot(record.length, record.payload_x, color=COLOURS[3])
    axes.plot(record.length[largest], record.payload_x[largest], "o", color=COLOURS[1], ms=4)
    axes.annotate(
        f"{record.payload_x[largest]:.2f} m",
        (record.length[largest], record.payload_x[largest]),
        xytext=(6.0, 0.0),
        textcoords="offset points",
    )
    axes.set_xlim(200.0, 800.0)
    axes.set_ylim(-4.0, 4.0)
    axes.set_xlabel("length of the cable [m]")
    axes.set_ylabel("sway of the unit [m]")
    return float(np.abs(record.payload_x[largest]))


EXAMPLE_FOUR = DEEP.format(diameter="0.047 m", modulus="9.05e9") + (
    "; lowering from 200 to 800 m at {speed:g} m/s while the top sways 5 m at 0.2 rad/s, from hanging still"
)
EXAMPLE_FOUR_ASSUMED = DEEP_DRAG + "; the sway's frequency and the lowering speed"


@reproduction("H 4.10", "Example four: sway of the unit while lowered at 1 m/s")
def thesis_4_10(figure: Any) -> Caption:
    largest = draw_sway(figure, 1.0)
    return Caption(
        parameters=EXAMPLE_FOUR.format(speed=1.0),
        assumed=EXAMPLE_FOUR_ASSUMED,
        shows=f"At most {largest:.2f} m. The longer the cable, the smaller the sway, as the text says.",
    )


@reproduction("H 4.11", "Example four: sway of the unit while lowered at 3 m/s")
def thesis_4_11(figure: Any) -> Caption:
    largest = draw_sway(figure, 3.0)
    return Caption(
        parameters=EXAMPLE_FOUR.format(speed=3.0),
        assumed=EXAMPLE_FOUR_ASSUMED,
        shows=f"At most {largest:.2f} m, less than at 1 m/s: faster lowering leaves less time to build up "
        "sway while "
        "the cable is short, as the text says.",
    )


# Example five: through resonance -------------------------------------------------------------------


@cache
def lowered(speed: float, current: float = 0.0) -> tuple[PlanarOperation, PlanarRecord, Array]:
    """Example five at a speed in a current [m/s], and the dynamic part of the heave [m]."""
    operation = example_five(speed, current)
    record = operation.record()
    return operation, record, operation.dynamic_heave(record)


EXAMPLE_FIVE = DEEP.format(diameter="0.02 m", modulus="4e9") + (
    "; lowering from 200 to 500 m at {speed:g} m/s from hanging still, the top on P = sin t, Q = 1 - cos t "
    "(m, s)"
)


def draw_vertical(figure: Any, speed: float) -> Caption:
    """The dynamic part of the heave: what static stretch and pay-out leave."""
    operation, record, heave = lowered(speed)
    per_cycle = round(2.0 * math.pi / operation.dt)
    amplitude, middle = cycle_amplitude(heave, per_cycle)
    whole = slice(per_cycle // 2 + 1, -per_cycle // 2 - 1)
    resonance = float(resonant_length(1.0, operation.cable, operation.payload))
    axes = figure.subplots()
    axes.plot(record.length, heave, color=COLOURS[3], lw=0.8, label="unit")
    axes.plot(record.length[whole], middle[whole], color=COLOURS[1], lw=1.3, label="middle of a cycle")
    axes.axvline(resonance, color=INK, lw=0.8, ls=":", label="resonance, undamped")
    axes.set_xlim(200.0, 500.0)
    axes.set_ylim(-5.2, 4.5)
    axes.set_xlabel("length of the cable [m]")
    axes.set_ylabel("heave of the unit [m]")
    axes.legend(loc="lower right", ncols=3, fontsize=8.0)
    peak = whole.start + int(np.argmax(amplitude[whole]))
    return Caption(
        parameters=EXAMPLE_FIVE.format(speed=speed),
        assumed=DEEP_DRAG + "; the four lowering speeds, taken from the thesis's chapter 3",
        shows=f"Largest half range within a cycle {amplitude[peak]:.2f} m, at {record.length[peak]:.0f} m; "
        "drag of "
        f"lowering raises the middle to {middle[whole][-1]:.2f} m at the end. Over the four speeds the "
        "motion falls "
        "and the rise grows, as the text says. Up is positive.",
    )


def draw_horizontal(figure: Any, speed: float) -> Caption:
    """The sway of top and unit."""
    operation, record, _ = lowered(speed)
    axes = figure.subplots()
    axes.plot(record.length, operation.motion()[0], color=COLOURS[0], lw=0.6, label="boom tip")
    axes.plot(record.length, record.payload_x, color=COLOURS[1], lw=1.1, label="unit")
    axes.axhline(1.0, color=INK, lw=0.8, ls=":", label="middle of the boom tip's circle")
    axes.set_xlim(200.0, 500.0)
    axes.set_ylim(-0.3, 2.9)
    axes.set_xlabel("length of the cable [m]")
    axes.set_ylabel("sway [m]")
    axes.legend(loc="upper right", ncols=3, fontsize=8.0)
    late = record.payload_x[record.length > 450.0]
    return Caption(
        parameters=EXAMPLE_FIVE.format(speed=speed),
        assumed=DEEP_DRAG + "; the four lowering speeds, taken from the thesis's chapter 3",
        shows="The unit swings slowly past the middle of the circle and settles beyond it near resonance, "
        "where tension and "
        "slope vary in step and push it aside. It feels next to nothing of the sway at 1 rad/s: "
        f"{50.0 * np.ptp(late):.1f} cm, half its range beyond 450 m.",
    )


@reproduction("H 4.12", "Example five: vertical motion, lowering at 0.5 m/s")
def thesis_4_12(figure: Any) -> Caption:
    return draw_vertical(figure, 0.5)


@reproduction("H 4.13", "Example five: horizontal motion, lowering at 0.5 m/s")
def thesis_4_13(figure: Any) -> Caption:
    return draw_horizontal(figure, 0.5)


@reproduction("H 4.14", "Example five: vertical motion, lowering at 1 m/s")
def thesis_4_14(figure: Any) -> Caption:
    return draw_vertical(figure, 1.0)


@reproduction("H 4.15", "Example five: horizontal motion, lowering at 1 m/s")
def thesis_4_15(figure: Any) -> Caption:
    return draw_horizontal(figure, 1.0)


@reproduction("H 4.16", "Example five: vertical motion, lowering at 2 m/s")
def thesis_4_16(figure: Any) -> Caption:
    return draw_vertical(figure, 2.0)


@reproduction("H 4.17", "Example five: horizontal motion, lowering at 2 m/s")
def thesis_4_17(figure: Any) -> Caption:
    return draw_horizontal(figure, 2.0)


@reproduction("H 4.18", "Example five: vertical motion, lowering at 3 m/s")
def thesis_4_18(figure: Any) -> Caption:
    return draw_vertical(figure, 3.0)


@reproduction("H 4.19", "Example five: horizontal motion, lowering at 3 m/s")
def thesis_4_19(figure: Any) -> Caption:
    return draw_horizontal(figure, 3.0)


EXAMPLE_CURRENT_ASSUMED = (
    DEEP_DRAG
    + f"; a uniform current of {WEAK:g} m/s and lowering at 1 m/s; the start, hanging straight, is printed"
)


@reproduction("H 4.20", "Example five in a weak current: vertical motion")
def thesis_4_20(figure: Any) -> Caption:
    _, record, heave = lowered(1.0)
    _, _, in_current = lowered(1.0, WEAK)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2.0, 1.0))
    upper.plot(record.length, heave, color=COLOURS[0], lw=2.2, label="still water")
    upper.plot(record.length, in_current, color=COLOURS[3], lw=0.8, label=f"current {WEAK:g} m/s")
    upper.set_ylabel("heave of the unit [m]")
    upper.set_ylim(-4.5, 5.5)
    upper.legend(loc="upper right", ncols=2)
    lower.plot(record.length, 1e3 * (in_current - heave), color=COLOURS[1], lw=0.8)
    lower.set_ylabel("difference [mm]")
    lower.set_xlabel("length of the cable [m]")
    lower.set_xlim(200.0, 500.0)
    change = np.abs(in_current - heave).max()
    return Caption(
        parameters=EXAMPLE_FIVE.format(speed=1.0),
        assumed=EXAMPLE_CURRENT_ASSUMED,
        shows=f"The current hardly touches the heave: {1e3 * change:.0f} mm at most, as the text says.",
    )


@reproduction("H 4.21", "Example five in a weak current: horizontal motion")
def thesis_4_21(figure: Any) -> Caption:
    _, record, _ = lowered(1.0)
    _, with_current, _ = lowered(1.0, WEAK)
    axes = figure.subplots()
    axes.plot(record.length, record.payload_x, color=COLOURS[0], label="still water")
    axes.plot(record.length, with_current.payload_x, color=COLOURS[1], label=f"current {WEAK:g} m/s")
    axes.axhline(1.0, color=INK, lw=0.8, ls=":", label="middle of the boom tip's circle")
    axes.set_xlim(200.0, 500.0)
    axes.set_ylim(bottom=-0.3)
    axes.set_xlabel("length of the cable [m]")
    axes.set_ylabel("sway of the unit [m]")
    axes.legend(loc="lower right")
    return Caption(
        parameters=EXAMPLE_FIVE.format(speed=1.0),
        assumed=EXAMPLE_CURRENT_ASSUMED,
        shows="The current acts on the sway: the unit deviates from the vertical through the top's mean "
        "position, more "
        "and more as the cable lengthens, as the text says.",
    )
