"""Welch and Tulin (1993): angle, tension ratio and critical pay-out ratio of a towed cable."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from experiments.figures import COLOURS
from experiments.reproduction.figure import Caption, reproduction
from heave_env.cable.towing import critical_payout_ratio, inclination, tension_ratio

DARK = "#30353d"
DRAG_RATIO = 0.01


@reproduction("W 1", "Cable Froude number against inclination angle, constant normal drag coefficient")
def welch_tulin_1(figure: Any) -> Caption:
    """(1) over six decades of the Froude number."""
    axes = figure.subplots()
    froude = np.geomspace(1e-2, 1e4, 400)
    for coefficient, colour in ((1.0, COLOURS[2]), (1.2, COLOURS[3]), (2.0, COLOURS[1])):
        angle = np.degrees(inclination(froude, coefficient))
        axes.plot(angle, froude, color=colour, label=f"C_N = {coefficient:g}")
    axes.set_yscale("log")
    axes.set_xlim(0.0, 90.0)
    axes.set_xticks(range(0, 91, 15))
    axes.set_xlabel("inclination angle α [deg]")
    axes.set_ylabel("cable Froude number ρU²/(ρ̂gD) [-]")
    axes.legend()
    return Caption(
        parameters="C_N = 1.0, 1.2, 2.0 in (1).",
        shows="The faster the tow and the lighter the cable, the flatter it lies: 90° at rest, falling as "
        "the inverse "
        "root of the Froude number at speed.",
        assumed="C_N is not printed: 1.2 is a bare rope, 2 one that strums.",
    )


@reproduction("W 2", "Tension over the tangential weight against inclination angle and pay-out ratio")
def welch_tulin_2(figure: Any) -> Caption:
    """(4) for pay-out ratios below, at and above one."""
    axes = figure.subplots()
    degrees = np.linspace(1.0, 90.0, 700)
    angle = np.radians(degrees)
    ratios = (0.0, 0.5, 0.9, 1.0, 1.05, 1.2)
    for ratio, colour in zip(ratios, COLOURS[1:], strict=False):
        axes.plot(degrees, tension_ratio(angle, ratio, DRAG_RATIO), color=colour, label=f"β = {ratio:g}")
    axes.axhline(0.0, color=DARK, lw=0.9)
    axes.set_yscale("symlog", linthresh=1.0, linscale=0.7)
    axes.set_ylim(-1e3, 1e4)
    axes.set_xlim(0.0, 45.0)
    axes.set_yticks([-100, -1, 0, 1, 10, 100, 1000, 10000])
    axes.set_xlabel("inclination angle α [deg]")
    axes.set_ylabel("T / T_wt [-], logarithmic beyond ±1")
    axes.legend(ncols=2)
    return Caption(
        parameters=f"C_t/C_N = {DRAG_RATIO:g} in (4); pay-out ratios 0, 0.5, 0.9, 1, 1.05, 1.2.",
        shows="While β < cos α drag adds to the weight's tension; above it the cable overruns the water, "
        "and at small "
        "angles, that is at high Froude numbers, the tension turns negative: what the text says.",
        assumed="C_t/C_N and the pay-out ratios are not printed.",
    )


@reproduction("W 3", "Critical pay-out ratio against inclination angle")
def welch_tulin_3(figure: Any) -> Caption:
    """(5) for several ratios of drag coefficients, and with strumming."""
    axes = figure.subplots()
    degrees = np.linspace(0.0, 60.0, 600)
    angle = np.radians(degrees)
    for ratio, colour in ((0.005, COLOURS[2]), (0.01, COLOURS[3]), (0.02, COLOURS[1])):
        critical = critical_payout_ratio(angle, ratio)
        axes.plot(degrees, critical, color=colour, label=f"C_t/C_N = {ratio:g}")
    critical = critical_payout_ratio(angle, 1.5 * DRAG_RATIO)
    label = f"{DRAG_RATIO:g}, strumming adds 50 %"
    axes.plot(degrees, critical, color=COLOURS[3], ls=(0, (4, 2)), label=label)
    axes.plot(degrees, np.cos(angle), color=DARK, lw=0.9, ls=":", label="cos α: no slip along the cable")
    axes.axhline(1.0, color=DARK, lw=0.9)
    axes.annotate("β = 1: the least on the sea bottom", (58.0, 1.0), ha="right", va="bottom", fontsize=8)
    axes.set_xlim(0.0, 60.0)
    axes.set_ylim(0.0, 8.0)
    axes.set_xlabel("inclination angle α [deg]")
    axes.set_ylabel("critical pay-out ratio β* [-]")
    axes.legend(loc="upper left")
    at = [float(critical_payout_ratio(math.radians(5.0), DRAG_RATIO * gain)) for gain in (1.0, 1.5)]
    return Caption(
        parameters="C_t/C_N = 0.005, 0.01, 0.02 in (5), and 0.015 for strumming.",
        shows="At small angles the critical ratio comes down to one, and deployment on the bottom needs "
        "more than one. "
        f"At 5° it is {at[0]:.3f}, with strumming {at[1]:.3f}.",
        assumed="C_t/C_N is not printed; 50 % is the most that strumming added to C_t in the paper.",
    )
