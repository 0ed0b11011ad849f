"""Berteaux, chapter 9: peak tension against length in calm water and in a sea, and the snapping package."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from experiments.cases.lowering import (
    FOOT,
    POUND,
    hydrographic_package,
    hydrographic_wire,
    instrument_package,
)
from experiments.figures import COLOURS
from experiments.reproduction.figure import Caption, reproduction
from heave_env.cable.lowering import Lowering, LoweringRecord
from heave_env.parameters import SeaState

Array = np.ndarray
DARK = "#30353d"

HAULING = {"A": 100.0, "B": 75.0, "C": 50.0, "D": 0.0}
"""Hauling speeds of figures 9-2 and 9-3 [m/min]."""
LENGTHS = np.linspace(50.0, 7000.0, 140)
WIRE = (
    "wire 0.303 in (7.70 mm), 145 lb per 1000 ft in water (2.12 N/m), C_t 0.01, strength 7400 lb (32.9 kN); "
    "package 350 lb in water (1557 N), drag constant 9.72 ft² (0.903 m²), virtual mass 21 slug (306 kg); "
    "water "
    "2 slug/ft³; hauling at A 100, B 75, C 50, D 0 m/min"
)
OMEGA = 2.0 * math.pi / 8.0
HEAVE = 3.0 * FOOT
ROLL, ARM = math.radians(15.0), 22.0 * FOOT


def _lowering() -> Lowering:
    return Lowering(cable=hydrographic_wire(), payload=hydrographic_package())


def _draw_loads(axes: Any) -> None:
    strength = hydrographic_wire().breaking_strength or 0.0
    for share, dash in ((0.5, (0, (5, 2))), (0.75, (0, (1.5, 1.5)))):
        axes.axhline(share * strength / 1e3, color=DARK, lw=1.0, ls=dash)
        axes.text(100.0, share * strength / 1e3 + 0.3, f"{share:.0%} of strength", fontsize=8, color=DARK)
    axes.set_xlim(0.0, LENGTHS[-1])
    axes.set_xticks(range(0, 7000, 1000))
    axes.set_ylim(0.0, 30.0)
    axes.set_xlabel("length of cable paid out [m]")
    axes.set_ylabel("peak tension at the sheave [kN]")


@reproduction("B 9-2", "Peak tension at the head sheave against length of cable paid out, sea state 0")
def berteaux_9_2(figure: Any) -> Caption:
    """(9.2) at four hauling speeds."""
    axes, lowering = figure.subplots(), _lowering()
    reach = []
    for (letter, rate), colour in zip(HAULING.items(), COLOURS[1:], strict=False):
        tension = lowering.tension(LENGTHS, -rate / 60.0) / 1e3
        axes.plot(LENGTHS, tension, color=colour, label=f"{letter}: {rate:g} m/min")
        reach.append(f"{letter} {lowering.greatest_length(2.0, -rate / 60.0):.0f}")
    _draw_loads(axes)
    axes.legend(loc="lower right", title="hauled in at")
    return Caption(
        parameters=f"{WIRE}; calm water.",
        shows="Tension rises with length and with hauling speed; half the strength is reached at "
        f"{', '.join(reach)} m of cable.",
        assumed="The wire's 145 lb per 1000 ft is its weight in water.",
    )


def _draw_sea(axes: Any, lowering: Lowering, amplitude: float) -> list[str]:
    """Peak tensions by (9.5); returns the hauling speeds at which it would have the payload's end slack."""
    sea = SeaState(kind="regular", significant_wave_height=2.0 * amplitude, peak_omega=OMEGA)
    slack = []
    for (letter, rate), colour in zip(HAULING.items(), COLOURS[1:], strict=False):
        tension = lowering.rigid_peak_tension(LENGTHS, amplitude, OMEGA, -rate / 60.0) / 1e3
        # On a metre of cable the payload follows the sheave as a rigid bar does.
        taut = lowering.in_sea(1.0, sea, payout_rate=-rate / 60.0).stays_taut
        label = f"{letter}: {rate:g} m/min" + ("" if taut else ", slack")
        axes.plot(LENGTHS, tension, color=colour, ls="-" if taut else (0, (6, 2)), label=label)
        if not taut:
            slack.append(letter)
    _draw_loads(axes)
    axes.legend(loc="lower right", fontsize=8)
    return slack


@reproduction(
    "B 9-3", "Peak tension at the head sheave against length of cable paid out, sea state 3", size=(9.0, 4.0)
)
def berteaux_9_3(figure: Any) -> Caption:
    """(9.5) at four hauling speeds, with the heave alone and with the roll at an assumed arm."""
    left, right = figure.subplots(1, 2, sharey=True)
    lowering, with_roll = _lowering(), HEAVE + ARM * math.sin(ROLL)
    _draw_sea(left, lowering, HEAVE)
    slack = _draw_sea(right, lowering, with_roll)
    left.set_title(f"heave alone, {HEAVE:.2f} m", fontsize=9)
    right.set_title(f"heave and roll, {with_roll:.2f} m", fontsize=9)
    right.set_ylabel("")
    peak = float(lowering.rigid_peak_tension(5000.0, HEAVE, OMEGA, -100.0 / 60.0)) / 1e3
    calm = float(lowering.tension(5000.0, -100.0 / 60.0)) / 1e3
    return Caption(
        parameters=f"{WIRE}; heave amplitude 3 ft (0.914 m), period 8 s, roll 15°; cable and package "
        f"follow the "
        "sheave as a rigid bar, (9.5), the greatest tension of the period.",
        shows=f"The sea lifts every curve: at 5000 m and 100 m/min from {calm:.1f} to {peak:.1f} kN by "
        f"heave alone. "
        f"With the assumed roll the sheave falls faster than the package can at "
        f"{' and '.join(slack) or 'no speed'}: "
        "there the wire goes slack and (9.5) no longer holds (dashed).",
        assumed="Arm of the roll and its phase: the sheave stands 22 ft (6.71 m, about half the ship's "
        "beam) off the "
        "roll axis and roll adds to heave in phase. Dry mass of the wire: its weight in water and the "
        "water it "
        "displaces. Hauling acts at every instant; the text adds it at the instant of the peak without "
        "hauling.",
    )


@cache
def _package(cable_mass_share: float) -> LoweringRecord:
    record = replace(instrument_package(), cable_mass_share=cable_mass_share).record()
    return record.after(record.time[-1] - 12.0)


@reproduction("B 9-5", "Cable lower end displacement and tension under a snapping cable", size=(6.4, 5.0))
def berteaux_9_5(figure: Any) -> Caption:
    """Example 9.5, the data as printed and with three quarters of the cable's mass."""
    upper, lower = figure.subplots(2, 1, sharex=True)
    printed = _package(0.0)
    start = printed.time[0]
    upper.plot(printed.time - start, printed.sheave_heave / FOOT, color=COLOURS[0], label="upper end")
    for share, colour, label in (
        (0.0, COLOURS[3], "lower end, as printed"),
        (0.75, COLOURS[1], "lower end, 3/4 of cable mass"),
    ):
        record = _package(share)
        upper.plot(record.time - start, record.payload_heave / FOOT, color=colour, label=label)
        lower.plot(record.time - start, record.payload_tension / POUND, color=colour)
    for axes, published, unit in ((upper, -3.5, "ft"), (upper, 14.8, "ft"), (lower, 8100.0, "lb")):
        axes.axhline(published, color=DARK, lw=0.9, ls=(0, (3, 2)))
        axes.annotate(
            f"printed {published:g} {unit}",
            (12.05, published),
            annotation_clip=False,
            fontsize=8,
            va="center",
            color=DARK,
        )
    lower.axhline(2000.0, color=DARK, lw=0.8, ls=":")
    lower.annotate(
        "static 2000 lb", (12.05, 2000.0), annotation_clip=False, fontsize=8, va="center", color=DARK
    )
    upper.set_xlim(0.0, 12.0)
    upper.set_ylabel("displacement [ft]")
    lower.set_ylabel("tension [lb]")
    lower.set_xlabel("time after the transient [s]")
    upper.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, fontsize=8, borderaxespad=0.0)
    with_mass = _package(0.75)
    return Caption(
        parameters="3000 ft (914 m) of 3/8 in wire, EA 1.8e6 lb (8.01 MN); package 4200 lb in air, 2000 lb "
        "in water, "
        "added mass 12 slug (175 kg), 3.14 ft² (0.292 m²), C_d 1; upper end 7 ft (2.13 m) sin(2πt/4 s); "
        "water "
        "2 slug/ft³; massless spring, midpoint rule, 4 ms.",
        shows=f"The data as printed give {printed.payload_heave.min() / FOOT:.1f} to "
        f"{printed.payload_heave.max() / FOOT:.1f} ft and {printed.peak_tension / POUND:.0f} lb; with "
        f"three quarters of "
        f"the cable's mass on the payload {with_mass.payload_heave.min() / FOOT:.1f} to "
        f"{with_mass.payload_heave.max() / FOOT:.1f} ft and {with_mass.peak_tension / POUND:.0f} lb: the "
        "published extremes within 0.1 ft and 0.2 %.",
        assumed="Time as the abscissa. The cable's mass is not printed: that of its 573 lb of weight in "
        "water.",
    )
