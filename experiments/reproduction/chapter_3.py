"""Huang (1992), chapter 3: tension against frequency, lowering through resonance, a sudden stop."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from experiments.cases.axial import (
    Lowering,
    Suspension,
    Sweep,
    cycle_amplitude,
    example_five,
    thesis_polyester_2_mm,
    thesis_polyester_3_mm,
    thesis_sphere_in_air,
    thesis_sphere_in_water,
    thesis_sudden_stop,
)
from experiments.figures import COLOURS
from experiments.reproduction.figure import Caption, reproduction
from heave_env.cable.axial import AxialRecord
from heave_env.cable.closed_form import natural_omegas, resonant_length

Array = np.ndarray
DARK = "#30353d"


# Tension against frequency: examples one to four ---------------------------------------------------


def _as_the_thesis(case: Suspension) -> Suspension:
    """The same with a cable that carries compression."""
    return replace(case, cable=replace(case.cable, tension_only=False))


@cache
def _swept(case: Suspension) -> Sweep:
    return case.sweep()


def _draw_tension(figure: Any, case: Suspension) -> float | None:
    """Largest tension against frequency; returns the frequency at which the rope goes slack [Hz]."""
    axes = figure.subplots()
    taut_only, linear = _swept(case), _swept(_as_the_thesis(case))
    frequency = taut_only.omega / (2.0 * math.pi)
    axes.plot(frequency, linear.tension_max, color=COLOURS[3], label="rope that carries compression (thesis)")
    axes.plot(frequency, taut_only.tension_max, color=COLOURS[1], ls="--", label="rope that goes slack")
    axes.axhline(case.static_tension, color=DARK, lw=0.8, ls=":", label="static tension")
    slack = np.nonzero(taut_only.slack_fraction > 0.0)[0]
    onset = None
    if len(slack):
        onset = float(frequency[slack[0]])
        axes.axvspan(onset, frequency[-1], color=COLOURS[0], alpha=0.15, lw=0.0, label="slack in each cycle")
    axes.set_xlim(frequency[0], frequency[-1])
    axes.set_ylim(0.0, 1.15 * float(max(linear.tension_max.max(), taut_only.tension_max.max())))
    axes.set_xlabel("frequency of the top [Hz]")
    axes.set_ylabel("largest tension [N]")
    axes.legend(loc="upper left")
    return onset


def _rope(case: Suspension) -> str:
    cable, body = case.cable, case.payload
    damping = cable.axial_damping / cable.axial_stiffness
    water = (
        f", added mass {body.added_mass:g} kg, weight in water {body.submerged_weight:g} N"
        if body.added_mass
        else ", in air"
    )
    return (
        f"rope {1e3 * cable.diameter:g} mm, {case.length:g} m, EA {cable.axial_stiffness:.5g} N, "
        f"{cable.mass_per_length:g} kg/m, internal damping EA · {1e3 * damping:g} ms; sphere {body.mass:g} kg"
        f"{water}; top ± {1e3 * case.amplitude:g} mm; {case.n_elements} elements, "
        f"{case.steps_per_period} steps per period"
    )


@reproduction("H 3.3", "Example one: largest tension against frequency, 3 mm polyester rope in air")
def thesis_3_3(figure: Any) -> Caption:
    case = thesis_polyester_3_mm()
    onset = _draw_tension(figure, case)
    return Caption(
        parameters=_rope(case),
        assumed="Internal damping; the range of frequencies. The measured points are not in the text.",
        shows=(
            "The tension rises with the acceleration of the top, far below the natural frequency of "
            f"{_natural_frequency(case):.2f} Hz. From {onset:.2f} Hz the rope goes slack in each cycle; "
            "below, both ropes are one."
        ),
    )


@reproduction("H 3.4", "Example two: largest tension against frequency, 2 mm polyester rope in air")
def thesis_3_4(figure: Any) -> Caption:
    case = thesis_polyester_2_mm()
    onset = _draw_tension(figure, case)
    return Caption(
        parameters=_rope(case),
        assumed="Internal damping; the range of frequencies. The measured points are not in the text.",
        shows=(
            f"With twice the amplitude the rope goes slack from {onset:.2f} Hz, where the thesis reports "
            "snatching that its model cannot handle. From there the two ropes part: the one that goes slack "
            "flies free in part of each cycle and snaps taut, irregularly, so that its largest tension jumps "
            "from one frequency to the next."
        ),
    )


def _natural_frequency(case: Suspension) -> float:
    return float(natural_omegas(case.cable, case.payload, case.length, 1)[0]) / (2.0 * math.pi)


def _ratio(case: Suspension, swept: Sweep) -> Array:
    return (swept.tension_max - case.static_tension) / (case.stiffness * case.amplitude)


def _draw_ratio(
    figure: Any, curves: dict[str, Suspension], measured: float
) -> dict[str, tuple[float, float]]:
    """Tension ratio against frequency over the measured one [Hz]; returns each curve's peak."""
    axes = figure.subplots()
    peaks = {}
    for (label, case), colour in zip(curves.items(), (COLOURS[1], COLOURS[3], COLOURS[0]), strict=False):
        swept = _swept(case)
        share, ratio = swept.omega / (2.0 * math.pi * measured), _ratio(case, swept)
        axes.plot(share, ratio, color=colour, label=label)
        peaks[label] = (float(share[np.argmax(ratio)]), float(ratio.max()))
    natural = _natural_frequency(next(iter(curves.values())))
    axes.axvline(natural / measured, color=DARK, lw=0.9, ls=":", label=f"natural, {natural:.3f} Hz")
    axes.axvline(1.0, color=DARK, lw=0.9, ls="--", label=f"measured, {measured:g} Hz")
    axes.set_xlim(0.2, 1.45)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("frequency / measured natural frequency [-]")
    axes.set_ylabel("$(T_{max} - T_{static}) / (K x_0)$ [-]")
    axes.legend()
    return peaks


def _wide(case: Suspension, **changes: Any) -> Suspension:
    return replace(case, **{"omega_low": 1.0, "omega_high": 10.2, "n_omegas": 93, **changes})


_NYLON = (
    "Internal damping of 20 ms (5 % of critical), which sets the peak in air. The measured natural frequency "
    "is not that of K and M: the static modulus is not the dynamic one."
)


@reproduction("H 3.5", "Example three: tension ratio through resonance, nylon rope in air")
def thesis_3_5(figure: Any) -> Caption:
    case = _wide(thesis_sphere_in_air())
    peaks = _draw_ratio(figure, {"$x_0$ = 25.4 mm, in air": case}, measured=1.1)
    place, height = peaks["$x_0$ = 25.4 mm, in air"]
    return Caption(
        parameters=_rope(case) + f"; K = EA/L = {case.stiffness:.1f} N/m",
        assumed=_NYLON,
        shows=(
            f"A sharp peak of {height:.1f} at {1.1 * place:.3f} Hz, {place:.2f} of the measured 1.1 Hz; the "
            "rope stays taut and linear throughout."
        ),
    )


def _in_water(amplitude: float) -> Suspension:
    return _wide(thesis_sphere_in_water(), amplitude=amplitude)


_DRAG = " Drag of the sphere, C_d 0.5, and of the rope, C_t 0.01; weight of the rope in water, 0.03 N/m."


@reproduction("H 3.6", "Example four: tension ratio through resonance, nylon rope in water, 25.4 mm")
def thesis_3_6(figure: Any) -> Caption:
    case = _in_water(0.0254)
    curves = {
        "$x_0$ = 25.4 mm, in water": case,
        "in air, on the same scale": _wide(thesis_sphere_in_air()),
    }
    peaks = _draw_ratio(figure, curves, measured=0.72)
    (place, height), (_, dry) = peaks.values()
    return Caption(
        parameters=_rope(case),
        assumed=_NYLON + _DRAG,
        shows=(
            f"Water lowers the peak from {dry:.1f} to {height:.1f} and moves it to {0.72 * place:.3f} Hz, as "
            "the thesis says; 0.72 Hz was measured."
        ),
    )


@reproduction("H 3.7", "Example four: tension ratio through resonance, nylon rope in water, 50.8 mm")
def thesis_3_7(figure: Any) -> Caption:
    case = _in_water(0.0508)
    curves = {"$x_0$ = 50.8 mm, in water": case, "$x_0$ = 25.4 mm, in water": _in_water(0.0254)}
    peaks = _draw_ratio(figure, curves, measured=0.72)
    (_, double), (_, single) = peaks.values()
    return Caption(
        parameters=_rope(case),
        assumed=_NYLON + _DRAG,
        shows=(
            f"Doubling the amplitude lowers the ratio's peak from {single:.1f} to {double:.1f}: quadratic "
            "drag, as the thesis observes."
        ),
    )


# Lowering through resonance: example five ----------------------------------------------------------

SPEEDS = (0.5, 1.0, 2.0, 3.0)
OMEGAS = (0.4189, 0.628, 0.838, 1.26)


@cache
def _passage(speed: float, omega: float) -> tuple[Lowering, AxialRecord]:
    """Lowering from 50 m to one and a half resonant lengths."""
    base = example_five(duration=1.0)
    resonant = float(resonant_length(omega, base.cable, base.payload))
    case = example_five(
        heave_omega=omega,
        pay_out_time=(0.0, 10.0),
        pay_out_speed=(0.0, speed),
        duration=(1.5 * resonant - 50.0) / speed,
    )
    return case, case.record()


def _peak(case: Lowering, record: AxialRecord) -> tuple[int, Array, Array]:
    """Where the motion within a cycle is largest after the start's transient, and half range and middle."""
    cycle = round(2.0 * math.pi / case.heave_omega / case.dt)
    amplitude, middle = cycle_amplitude(record.payload_displacement, cycle)
    return int(np.argmax(amplitude * (record.time > 30.0))), amplitude, middle


def _draw_passage(figure: Any, speed: float, omega: float) -> Caption:
    case, record = _passage(speed, omega)
    peak, amplitude, middle = _peak(case, record)
    resonant = float(resonant_length(omega, case.cable, case.payload))
    start = 0.5 * case.pay_out_time[-1]  # the ramp's distance is that of full speed from its middle on
    whole, near = figure.subplots(2, 1, height_ratios=(1.25, 1.0))
    gap = 1.15 * max(float(amplitude.max()), -float(record.payload_displacement.min())) + 1.5
    for axes in (whole, near):
        axes.plot(record.time, record.payload_displacement, color=COLOURS[3], lw=0.5, label="subsea unit")
        axes.plot(record.time, record.sheave_heave - gap, color=COLOURS[0], lw=0.5, label="vessel, set lower")
        axes.set_ylabel("heave [m]")
    whole.plot(record.time, middle, color=COLOURS[1], lw=1.2, label="middle of the cycle: drag")
    whole.axvline(
        (resonant - case.length) / speed + start,
        color=DARK,
        lw=1.0,
        ls="--",
        label=f"resonant length {resonant:.0f} m",
    )
    whole.set_xlim(0.0, float(record.time[-1]))
    handles, labels = whole.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4, fontsize=7.5)
    for line in figure.legends[0].get_lines():
        line.set_linewidth(1.6)
    lengths = whole.secondary_xaxis(
        "top",
        functions=(
            lambda t: case.length + speed * (t - start),
            lambda length: (length - case.length) / speed + start,
        ),
    )
    lengths.set_xlabel("length [m]")
    whole.set_xlabel("(a) time [s]")
    lengths.tick_params(labelsize=8)
    half = 5.0 * 2.0 * math.pi / omega
    middle_time = min(max(float(record.time[peak]), half), float(record.time[-1]) - half)
    near.set_xlim(middle_time - half, middle_time + half)
    for line in near.get_lines():
        line.set_linewidth(1.3)
    near.set_xlabel("(b) ten cycles about the largest motion, time [s]")
    shortest = float(record.tension_min.min())
    slack = f" The least tension is {shortest / 1e3:.0f} kN"
    if shortest < 0.0:
        slack += (
            f": over {100.0 * record.slack_fraction:.2g} % of the time the cable would be slack somewhere, "
            "which the thesis's model does not know"
        )
    cycle = round(2.0 * math.pi / omega / case.dt)
    lifted = float(middle[-4 * cycle : -cycle].mean())
    stretch = float(case.solver.static_stretch(float(record.length[-1])))
    return Caption(
        parameters=(
            f"v = {speed:g} m/s, ω = {omega:g} rad/s; L0 50 m, EA {case.cable.axial_stiffness:.5g} N "
            "(E 9.05e9 N/m², d 0.047 m), 7.2 kg/m; unit 5000 + 8000 kg; 20 elements, 0.05 s"
        ),
        assumed=(
            "Heave ± 1 m; weights 35 kN and 54 N/m; C_d S 1 m², C_t 0.0025; full speed after 10 s; until one "
            "and a half resonant lengths."
        ),
        shows=(
            f"The largest motion is ± {amplitude[peak]:.2f} m at {record.length[peak]:.0f} m; the resonant "
            f"length at rest is {resonant:.0f} m. At the end drag compresses the cable by {lifted:.2f} m, of "
            f"a static elongation of {stretch:.1f} m.{slack}."
        ),
    )


def _register(number: int, speed: float, omega: float) -> Callable[[Any], Caption]:
    def draw(figure: Any) -> Caption:
        return _draw_passage(figure, speed, omega)

    draw.__name__ = f"thesis_3_{number}"
    title = f"Example five: lowering at {speed:g} m/s, vessel at {omega:g} rad/s"
    return reproduction(f"H 3.{number}", title, size=(6.4, 4.8))(draw)


for _i, _speed in enumerate(SPEEDS):
    for _j, _omega in enumerate(OMEGAS):
        _register(8 + 4 * _i + _j, _speed, _omega)


@reproduction("H 3.24", "Deployment suddenly suspended: motion of the subsea unit")
def thesis_3_24(figure: Any) -> Caption:
    case = thesis_sudden_stop()
    record = case.record()
    stop = case.pay_out_time[-1]
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2.0, 1.0))
    upper.plot(record.time, record.payload_displacement, color=COLOURS[3], label="subsea unit")
    upper.plot(
        record.time, record.sheave_heave - 3.5, color=COLOURS[0], lw=1.0, label="vessel, set 3.5 m lower"
    )
    upper.set_ylabel("heave [m]")
    lower.plot(record.time, record.sheave_tension / 1e3, color=COLOURS[1], lw=1.0)
    lower.set_ylabel("tension at\nsheave [kN]")
    for axes in (upper, lower):
        axes.axvline(stop, color=DARK, lw=1.0, ls="--", label="pay-out stops")
    upper.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)
    lower.set_xlabel("time [s]")
    lower.set_xlim(stop - 50.0, float(record.time[-1]))
    after = record.time > stop
    swing = float(record.payload_displacement[after].min())
    natural = float(natural_omegas(case.cable, case.payload, 650.0, 1)[0])
    steady = record.time > float(record.time[-1]) - 30.0
    settled = 0.5 * float(np.ptp(record.payload_displacement[steady]))
    return Caption(
        parameters=(
            f"v = 2 m/s from 50 m, stopped at once after {stop:g} s at 650 m; ω {case.heave_omega:g} rad/s; "
            f"EA {case.cable.axial_stiffness:.5g} N, 7.2 kg/m; unit 5000 + 8000 kg; 20 elements, 0.05 s"
        ),
        assumed=(
            "Speed, depth and frequency of the stop; heave ± 0.5 m; weights 35 kN and 54 N/m; C_d S 1 m², "
            "C_t 0.0025."
        ),
        shows=(
            f"The unit runs {-swing:.2f} m beyond its static position, swings at the natural period of "
            f"{2.0 * math.pi / natural:.1f} s and settles towards a steady motion, ± {settled:.2f} m over "
            "the last 30 s: the transient of large amplitude and the steady motion of the text."
        ),
    )
