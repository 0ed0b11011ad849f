"""Moustafa (2001): tension of a span whose end is moved, and the motion of its middle."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from experiments.cases.sagged_span import DrivenSpan, draw_middle, moustafa_cable, moustafa_span
from experiments.figures import COLOURS
from experiments.reproduction.figure import Caption, reproduction
from heave_env.cable.catenary import hanging_span, length_of_force
from heave_env.cable.sagged_span import SpanRecord

Array = np.ndarray
DARK = "#30353d"
LENGTH, SPAN = 10.9774, 10.792
FREQUENCIES = tuple(np.round(np.arange(0.1, 1.2001, 0.05), 3).tolist())
"""Frequencies of the sweeps [Hz]."""
DATA = (
    "Wire of 10 mm, 10.9774 m long, over a level span of 10.792 m; 0.61 kg/m, E = 1e11 Pa; one end fixed, "
    "the other moved horizontally by u0 sin ωt"
)
GRID = "50 elements, 12 periods of 300 steps, of which the motion grows over three and the last five count"
ASSUMED = (
    "In water: 5.19 N/m, C_N 1.2, C_t 0.01, added mass of a cylinder across the wire, 1 ms of Kelvin "
    "damping; E is printed as 10E11"
)
UNKNOWN = "The measured and computed points of the source are not in its text and are not drawn."


def _case(amplitude: float, frequency: float, modulus: float = 1e11, length: float = LENGTH) -> DrivenSpan:
    return replace(
        moustafa_span(),
        cable=moustafa_cable(modulus),
        length=length,
        upper_amplitude=(amplitude, 0.0, 0.0),
        frequency=frequency,
        steps_per_period=300,
    )


@cache
def _sweep(
    amplitude: float, modulus: float = 1e11, length: float = LENGTH, every: int = 1
) -> tuple[Array, Array]:
    """Largest and least tension at the moved end at every so manyth of `FREQUENCIES` [N]."""
    rows = [_case(amplitude, frequency, modulus, length).extremes() for frequency in FREQUENCIES[::every]]
    return np.array(rows)[:, 0], np.array(rows)[:, 1]


def _static(length: float = LENGTH) -> float:
    return float(hanging_span(moustafa_cable(), length, SPAN, 0.0).tension(np.array(length)))


def _label(axes: Any) -> None:
    axes.set_xlabel("frequency of the moved end [Hz]")
    axes.set_ylabel("tension at the moved end [N]")
    axes.set_xlim(FREQUENCIES[0], FREQUENCIES[-1])


def _against_frequency(figure: Any, amplitude: float) -> Caption:
    most, least = _sweep(amplitude)
    axes = figure.subplots()
    axes.plot(FREQUENCIES, most, color=COLOURS[1], marker="o", markersize=3, label="largest")
    axes.plot(FREQUENCIES, least, color=COLOURS[3], marker="s", markersize=3, label="least")
    axes.plot(FREQUENCIES, 0.5 * (most + least), color=COLOURS[0], ls="--", lw=1.0, label="middle of both")
    axes.axhline(_static(), color=DARK, lw=0.8, ls=":", label="at rest")
    _label(axes)
    axes.set_ylim(bottom=0.0)
    axes.legend(loc="upper left")
    middle = 0.5 * (most + least) / _static() - 1.0
    even = [f for f, off in zip(FREQUENCIES, middle, strict=True) if abs(off) < 0.03]
    range_of_even = f"the middle of both stays within 3 % of rest up to {_unbroken(even):g} Hz"
    if not even or even[0] > FREQUENCIES[0]:
        range_of_even = "the middle of both is off the tension at rest by more than 3 % even at 0.1 Hz"
    return Caption(
        parameters=f"{DATA}; u0 = {amplitude:g} m, 0.1 to 1.2 Hz in steps of 0.05 Hz. {GRID}.",
        shows=f"At 1.2 Hz {most[-1]:.0f} N and {least[-1]:.1f} N about {_static():.1f} N at rest; "
        f"{range_of_even}. As in the text: even while mild, and where the least tension comes near zero the "
        f"largest rises steeply. {UNKNOWN}",
        assumed=f"{ASSUMED}.",
    )


def _unbroken(even: list[float]) -> float:
    """The last of the frequencies that follow one another from the first of the sweep."""
    count = sum(1 for a, b in zip(even, FREQUENCIES, strict=False) if a == b)
    return FREQUENCIES[max(count - 1, 0)]


@reproduction("M 2", "Largest and least tension against frequency, motion of 0.025 m")
def moustafa_2(figure: Any) -> Caption:
    return _against_frequency(figure, 0.025)


@reproduction("M 3", "Largest and least tension against frequency, motion of 0.05 m")
def moustafa_3(figure: Any) -> Caption:
    return _against_frequency(figure, 0.05)


@reproduction("M 4", "Largest and least tension against frequency, motion of 0.075 m")
def moustafa_4(figure: Any) -> Caption:
    return _against_frequency(figure, 0.075)


@reproduction("M 5", "Largest and least tension against frequency, motion of 0.1 m")
def moustafa_5(figure: Any) -> Caption:
    return _against_frequency(figure, 0.1)


@reproduction("M 6", "Effect of the initial tension on largest and least tension, motion of 0.075 m")
def moustafa_6(figure: Any) -> Caption:
    axes = figure.subplots()
    sags = []
    for colour, force in zip(COLOURS[1:], (70.0, 87.5, 105.0, 120.0), strict=False):
        length = length_of_force(moustafa_cable(), SPAN, 0.0, force)
        most, least = _sweep(0.075, length=length, every=2)
        sags.append(f"{hanging_span(moustafa_cable(), length, SPAN, 0.0).sag:.2f} m at {force:g} N")
        axes.semilogy(FREQUENCIES[::2], most, color=colour, label=f"{force:g} N")
        axes.semilogy(FREQUENCIES[::2], np.maximum(least, 1e-3), color=colour, ls="--")
    _label(axes)
    axes.set_ylim(5.0, 3000.0)
    axes.legend(title="horizontal force at rest\nfull: largest, dashed: least", loc="upper left", ncols=2)
    return Caption(
        parameters=f"{DATA}, u0 = 0.075 m; the length is that of the horizontal force at rest. {GRID}.",
        shows=f"Sag at rest {', '.join(sags)}. With more initial tension there is less sag to take the "
        "motion up and the wire answers by stretching, as the text says. Curves that leave the figure below "
        f"are slack. {UNKNOWN}",
        assumed=f"{ASSUMED}. The initial tensions are ours, and that the figure is drawn over frequency.",
    )


@reproduction("M 7", "Effect of Young's modulus on largest and least tension, motion of 0.075 m")
def moustafa_7(figure: Any) -> Caption:
    axes = figure.subplots()
    styles = ((1e9, COLOURS[4]), (1e10, COLOURS[2]), (1e11, COLOURS[1]), (1e12, COLOURS[3]))
    found = {}
    for modulus, colour in styles:
        found[modulus] = _sweep(0.075, modulus, every=2)
        dashes = (0, (5, 3)) if modulus == 1e12 else "-"
        for values, label in zip(found[modulus], (f"E = {modulus:.0e} Pa", None), strict=True):
            axes.plot(FREQUENCIES[::2], values, color=colour, ls=dashes, label=label)
    axes.axhline(_static(), color=DARK, lw=0.8, ls=":", label="at rest, E = 1e11 Pa")
    _label(axes)
    axes.set_ylim(bottom=0.0)
    axes.legend(loc="upper left")
    change = [float(np.max(np.abs(found[E][0] / found[1e11][0] - 1.0))) for E in (1e9, 1e10, 1e12)]
    return Caption(
        parameters=f"{DATA}, u0 = 0.075 m, but for E. {GRID}.",
        shows="Above each other the largest and the least tension. Against E = 1e11 Pa the largest tension "
        f"changes by at most {change[2]:.1%} for a tenfold modulus, {change[1]:.1%} for a tenth and "
        f"{change[0]:.0%} for a hundredth, whose sag at rest differs; at low frequency by little, for the "
        f"catenary takes the motion up, as the text says. {UNKNOWN}",
        assumed=f"{ASSUMED}. The other moduli are ours, and that the figure is drawn over frequency.",
    )


@cache
def _middle(amplitude: float, frequency: float) -> tuple[SpanRecord, Array]:
    case = replace(_case(amplitude, frequency), steps_per_period=600)
    return case.record(case.solver()), case.time > (case.periods - 4.0) / frequency


def _draw_middle(figure: Any, amplitude: float, frequency: float, says: str) -> Caption:
    record, which = _middle(amplitude, frequency)
    draw_middle(figure, record, which)
    z, v, a = (
        values[which, 2]
        for values in (record.midpoint_displacement, record.midpoint_velocity, record.midpoint_acceleration)
    )
    slack = float(np.mean(record.slack_fraction[which] > 0.0))
    return Caption(
        parameters=f"{DATA}, u0 = {amplitude:g} m at {frequency:g} Hz. 50 elements, 600 steps per period, "
        "the last four of twelve periods; upwards positive, from the place at rest.",
        shows=f"Height {z.min():.3f} to {z.max():.3f} m, velocity {v.min():.2f} to {v.max():.2f} m/s, "
        f"acceleration {a.min():.1f} to {a.max():.1f} m/s²; slack somewhere for {slack:.0%} of the time. "
        f"{says}",
        assumed=f"{ASSUMED}.",
    )


@reproduction("M 8", "Vertical motion of the middle, 0.05 m at 0.75 Hz", size=(6.0, 4.6))
def moustafa_8(figure: Any) -> Caption:
    return _draw_middle(
        figure, 0.05, 0.75, "As in the text: displacement almost sinusoidal, with small distortion."
    )


@reproduction("M 9", "Vertical motion of the middle, 0.075 m at 1 Hz", size=(6.0, 4.6))
def moustafa_9(figure: Any) -> Caption:
    return _draw_middle(
        figure,
        0.075,
        1.0,
        "As in the text: distorted, sharp troughs and flat crests of displacement, flat troughs and sharp "
        "crests of velocity, large accelerations where the wire is drawn taut.",
    )


@reproduction("M 10", "Vertical motion of the middle, 0.1 m at 1 Hz", size=(6.0, 4.6))
def moustafa_10(figure: Any) -> Caption:
    return _draw_middle(
        figure,
        0.1,
        1.0,
        "As in the text: all much larger and the distortion more pronounced; after each rise the wire falls "
        "under its own weight against drag until it is taut again. The sharp oscillations at the peaks of "
        "the acceleration, which the text lays to elastic waves, do not come out: here the wire stays just "
        "taut, with 9 N at the least.",
    )
