"""Cases of lowering mechanics: hauling at constant speed, a plan over lengths and seas, slack and snaps.

Berteaux's cables and bodies stand here once, for his figures and the validation too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from experiments.cases.case import Outcome, Quantity, case
from experiments.figures import COLOURS
from heave_env.cable.closed_form import natural_omegas
from heave_env.cable.lowering import Lowering, LoweringRecord, PayoutLimits, PeakTensions
from heave_env.parameters import (
    GRAVITY,
    SEAWATER_DENSITY,
    Cable,
    Payload,
    SeaState,
    Vessel,
    require,
    require_integer,
    require_number,
)

Array = np.ndarray

FOOT = 0.3048
"""Foot [m]."""
POUND_MASS = 0.45359237
"""Pound [kg]."""
POUND = POUND_MASS * GRAVITY
"""Pound force [N]."""
SLUG = POUND / FOOT
"""Slug [kg]."""
WATER_RATIO = 2.0 * SLUG / FOOT**3 / SEAWATER_DENSITY
"""Berteaux's water, 2 slug/ft³, over ours [-]; his drag coefficients are raised by it."""

INK = "#30353d"
DASHED = (0, (4, 2))


def wire_rope(diameter_inches: float, pounds_per_foot: float) -> Cable:
    """Berteaux's wire rope by its diameter [in] and weight in water [lb/ft].

    Stiffness and strength are those of his 3/8 inch rope; no dry mass is printed: it is that which the
    weight in water alone would have.
    """
    return Cable(
        mass_per_length=pounds_per_foot * POUND_MASS / FOOT,
        axial_stiffness=1.8e6 * POUND,
        submerged_weight=pounds_per_foot * POUND / FOOT,
        diameter=diameter_inches * FOOT / 12.0,
        tangential_drag_coefficient=0.01 * WATER_RATIO,
        breaking_strength=14_800.0 * POUND,
    )


def sampler(drag_coefficient: float) -> Payload:
    """Berteaux's biological sampler, examples 9.2 to 9.4: a cone full of water, 6 ft wide and 5 ft high."""
    volume = math.pi * 3.0**2 * 5.0 / 3.0
    return Payload(
        mass=10.0 * SLUG,
        added_mass=(volume + 1.5 * volume) * 2.0 * SLUG,
        submerged_weight=200.0 * POUND,
        drag_area=drag_coefficient * math.pi * 3.0**2 * FOOT**2 * WATER_RATIO,
    )


def heavy_package() -> Payload:
    """Berteaux's heavy instrument package, example 9.5."""
    return Payload(
        mass=4200.0 * POUND_MASS,
        added_mass=12.0 * SLUG,
        submerged_weight=2000.0 * POUND,
        drag_area=3.14 * FOOT**2 * WATER_RATIO,
    )


def hydrographic_wire() -> Cable:
    """The wire of Berteaux's figures 9-2 and 9-3.

    Its 145 lb per 1000 ft is taken as the weight in water; the dry mass is that and the displaced water's,
    the stiffness (not printed) that of an armoured cable of this size.
    """
    displaced = 0.25 * math.pi * (0.303 / 12.0) ** 2 * 2.0 * SLUG
    return Cable(
        mass_per_length=(0.145 * POUND_MASS + displaced) / FOOT,
        axial_stiffness=3.5e6,
        submerged_weight=0.145 * POUND / FOOT,
        diameter=0.303 * FOOT / 12.0,
        tangential_drag_coefficient=0.01 * WATER_RATIO,
        breaking_strength=7400.0 * POUND,
    )


def hydrographic_package() -> Payload:
    """The instrument package of Berteaux's figures 9-2 and 9-3; of its 21 slug a third is taken as added
    mass.
    """
    return Payload(
        mass=14.0 * SLUG,
        added_mass=7.0 * SLUG,
        submerged_weight=350.0 * POUND,
        drag_area=9.72 * FOOT**2 * WATER_RATIO,
    )


def _legend_above(axes: Any, n_columns: int) -> None:
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=n_columns, fontsize=8, borderaxespad=0.0)


def _strength_lines(axes: Any, cable: Cable) -> None:
    """The working load and the yield load: 50 % and 75 % of the breaking strength."""
    if cable.breaking_strength is not None:
        for share, dash in ((0.5, (0, (5, 2))), (0.75, (0, (1.5, 1.5)))):
            load = share * cable.breaking_strength / 1e3
            axes.axhline(load, color=INK, lw=1.0, ls=dash, label=f"{share:.0%} of strength")


# Hauling and lowering at constant speed ------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class ConstantSpeed:
    """A payload hauled or lowered at constant speed in calm water."""

    cable: Cable
    """The cable."""
    payload: Payload
    """The body at its end; its drag area is that of the way it moves."""
    length: float
    """Unstretched length outboard [m]."""
    payout_rate: float
    """Positive in lowering, negative in hauling [m/s]."""
    acceleration_time: float
    """How long the winch takes to reach that rate [s]."""

    def __post_init__(self) -> None:
        require_number(self, "length", positive=True)
        require_number(self, "payout_rate")
        require_number(self, "acceleration_time", positive=True)

    def outcome(self) -> Outcome:
        """Tension, its parts, and the speeds and lengths at which the cable would go slack."""
        lowering = Lowering(cable=self.cable, payload=self.payload)
        static, moving = (float(lowering.tension(self.length, rate)) for rate in (0.0, self.payout_rate))
        inertia = float(lowering.inertia_force(-self.payout_rate / self.acceleration_time))
        quantities = [
            Quantity("static_tension", static, "N", "tension at the sheave at rest"),
            Quantity("moving_tension", moving, "N", "the same at the pay-out rate"),
            Quantity("drag_share", moving / static - 1.0, "-", "what drag adds to the static tension"),
            Quantity(
                "elongation", float(lowering.elongation(self.length)), "m", "stretch of the cable at rest"
            ),
            Quantity("terminal_velocity", float(lowering.terminal_velocity()), "m/s", "of the payload alone"),
            Quantity(
                "terminal_velocity_with_cable",
                float(lowering.terminal_velocity(self.length)),
                "m/s",
                "of payload and cable together",
            ),
            Quantity("virtual_mass", float(lowering.virtual_mass()), "kg", "payload with its added mass"),
            Quantity("inertia_force", inertia, "N", "mean force that brings the payload up to speed"),
        ]
        slack_length = lowering.slack_length(self.payout_rate)
        if math.isfinite(slack_length):
            quantities.append(Quantity("slack_length", slack_length, "m", "from which the cable goes slack"))
        if self.cable.breaking_strength is not None:
            factor = float(lowering.safety_factor(self.length, self.payout_rate))
            reach = lowering.greatest_length(2.0, self.payout_rate)
            quantities += [
                Quantity("safety_factor", factor, "-", "breaking strength over the greatest tension"),
                Quantity("greatest_length", reach, "m", "at which that factor is two"),
            ]
        profile = lowering.profile(self.length, self.payout_rate)
        at_rest = lowering.profile(self.length)

        def tension(figure: Any) -> None:
            axes = figure.subplots()
            axes.plot(at_rest.tension / 1e3, at_rest.arc_length, color=COLOURS[0], label="at rest")
            label = (
                f"{'lowering' if self.payout_rate > 0.0 else 'hauling'} at {abs(self.payout_rate):.2f} m/s"
            )
            axes.plot(profile.tension / 1e3, profile.arc_length, color=COLOURS[1], label=label)
            axes.set_xlabel("tension [kN]")
            axes.set_ylabel("above the payload [m]")
            axes.legend()

        table = {
            "arc length [m]": profile.arc_length,
            "tension at rest [N]": at_rest.tension,
            "tension [N]": profile.tension,
            "elongation [m]": profile.elongation,
        }
        return Outcome(tuple(quantities), {"profile": table}, {"tension": tension})


@case("lowering")
def biological_sampler() -> ConstantSpeed:
    """Berteaux's examples 9.2 and 9.4: a sampler hauled from 2000 m at 100 m/min, tension 2489 lb."""
    return ConstantSpeed(
        cable=wire_rope(0.375, 0.191),
        payload=sampler(1.0),
        length=2000.0,
        payout_rate=-100.0 / 60.0,
        acceleration_time=8.0,
    )


# A plan over lengths and seas ----------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class LoweringPlan:
    """What an operation may do: peak tension and pay-out limits against length and sea state."""

    cable: Cable
    """The cable, with its breaking strength."""
    payload: Payload
    """The body at its end."""
    vessel: Vessel | None = None
    """Boom tip behind the sea; null: it follows the elevation."""
    lengths: tuple[float, ...]
    """Unstretched lengths of the tables [m]."""
    sea_states: tuple[SeaState, ...]
    """Seas of the tables; a regular one gives amplitudes, any other expected extremes."""
    hauling_speed: float = 0.0
    """Speed of hauling during which the peak tensions are reckoned [m/s]."""
    exposure: float = 3600.0
    """How long a sea acts, for its extremes [s]."""
    margin: float = 0.2
    """Least tension, anywhere, over the payload's submerged weight that a pay-out rate must leave [-]."""
    safety_factor: float = 2.0
    """Breaking strength over the greatest tension that is to be kept [-]."""

    def __post_init__(self) -> None:
        ok = len(self.lengths) > 1 and all(
            a < b for a, b in zip(self.lengths, self.lengths[1:], strict=False)
        )
        require(ok and self.lengths[0] > 0.0, self, "lengths", "at least two positive numbers that increase")
        require(len(self.sea_states) > 0, self, "sea_states", "at least one sea")
        require_number(self, "hauling_speed", non_negative=True)
        require_number(self, "exposure", positive=True)
        require_number(self, "safety_factor", positive=True)
        require_number(self.cable, "breaking_strength", positive=True)

    def outcome(self) -> Outcome:
        """Tables by length, peak tensions and pay-out limits by length and sea."""
        lowering = Lowering(cable=self.cable, payload=self.payload)
        L = np.array(self.lengths)
        peaks = lowering.peak_tensions(
            L, self.sea_states, vessel=self.vessel, payout_rate=-self.hauling_speed, exposure=self.exposure
        )
        limits = lowering.payout_limits(
            L, self.sea_states, margin=self.margin, vessel=self.vessel, exposure=self.exposure
        )
        roughest = int(np.argmax([sea.significant_wave_height for sea in self.sea_states]))
        allowed = (self.cable.breaking_strength or 0.0) / self.safety_factor
        within = peaks.peak[roughest] <= allowed
        quantities = (
            Quantity(
                "greatest_length_at_rest",
                lowering.greatest_length(self.safety_factor),
                "m",
                "at which the static tension reaches the allowed",
            ),
            Quantity(
                "greatest_length_in_hauling",
                lowering.greatest_length(self.safety_factor, -self.hauling_speed),
                "m",
                "the same with the drag of hauling in calm water",
            ),
            Quantity(
                "greatest_length_in_the_roughest_sea",
                float(L[within].max()) if within.any() else 0.0,
                "m",
                "longest of the table whose peak tension is allowed",
            ),
            Quantity("terminal_velocity", float(lowering.terminal_velocity()), "m/s", "of the payload alone"),
            Quantity(
                "terminal_velocity_with_cable",
                float(lowering.terminal_velocity(L[-1])),
                "m/s",
                "of the payload with the longest cable",
            ),
            Quantity("peak_tension", float(peaks.peak.max()), "N", "greatest of the table"),
            Quantity("least_tension", float(peaks.least.min()), "N", "least of the table; negative: slack"),
            Quantity("payout_limit", float(limits.rate.min()), "m/s", "least of the table; zero: keep out"),
        )
        return Outcome(
            quantities,
            self._tables(lowering, L, peaks, limits),
            {
                "peak_tension": lambda figure: self._draw_peaks(figure, lowering, peaks),
                "payout_limits": lambda figure: self._draw_limits(figure, limits),
            },
        )

    def _names(self) -> list[str]:
        return [
            "calm"
            if sea.kind == "calm"
            else f"{'H' if sea.kind == 'regular' else 'Hs'} {sea.significant_wave_height:g} m, "
            f"{2.0 * math.pi / sea.peak_omega:.1f} s"
            for sea in self.sea_states
        ]

    def _tables(
        self, lowering: Lowering, L: Array, peaks: PeakTensions, limits: PayoutLimits
    ) -> dict[str, dict[str, Array]]:
        natural = [natural_omegas(self.cable, self.payload, float(length), 1)[0] for length in L]
        static = {
            "length [m]": L,
            "static tension [N]": lowering.tension(L),
            "tension in hauling [N]": lowering.tension(L, -self.hauling_speed),
            "elongation [m]": lowering.elongation(L),
            "safety factor at rest [-]": lowering.safety_factor(L),
            "natural period [s]": 2.0 * math.pi / np.array(natural),
            "terminal velocity with cable [m/s]": lowering.terminal_velocity(L),
        }
        tension, limit = {"length [m]": L}, {"length [m]": L}
        for name, peak, least, rate in zip(self._names(), peaks.peak, peaks.least, limits.rate, strict=True):
            tension |= {f"peak, {name} [N]": peak, f"least, {name} [N]": least}
            limit |= {f"pay-out limit, {name} [m/s]": rate}
        return {"by_length": static, "peak_tension": tension, "payout_limits": limit}

    def _draw_peaks(self, figure: Any, lowering: Lowering, peaks: PeakTensions) -> None:
        axes = figure.subplots()
        axes.plot(peaks.length, lowering.tension(peaks.length) / 1e3, color=COLOURS[0], label="at rest")
        for i, (name, peak, least) in enumerate(zip(self._names(), peaks.peak, peaks.least, strict=True)):
            colour, slack = COLOURS[1 + i % 8], least <= 0.0
            axes.plot(peaks.length, peak / 1e3, color=colour, marker="o", ms=3, label=name)
            axes.plot(peaks.length[slack], peak[slack] / 1e3, "x", color=colour, ms=8)
        _strength_lines(axes, self.cable)
        axes.set_xlabel("length of cable [m]   (× where it goes slack)")
        axes.set_ylabel("peak tension [kN]")
        axes.set_ylim(bottom=0.0)
        _legend_above(axes, 3)

    def _draw_limits(self, figure: Any, limits: PayoutLimits) -> None:
        axes = figure.subplots()
        for i, (name, rate) in enumerate(zip(self._names(), limits.rate, strict=True)):
            axes.plot(limits.length, rate, color=COLOURS[1 + i % 8], marker="o", ms=3, label=name)
        axes.set_xlabel("length of cable [m]")
        axes.set_ylabel("largest pay-out rate [m/s]")
        axes.set_ylim(bottom=0.0)
        _legend_above(axes, 3)


@case("lowering")
def hydrographic_cast() -> LoweringPlan:
    """The package and wire of Berteaux's figures 9-2 and 9-3 in calm and in seas of 0.5 to 2 m."""
    seas = ((0.5, 1.4), (1.0, 1.1), (2.0, 0.9))
    return LoweringPlan(
        cable=hydrographic_wire(),
        payload=hydrographic_package(),
        vessel=Vessel(natural_omega=0.9, damping_ratio=0.4, gain=0.7),
        lengths=tuple(float(length) for length in (100, 250, 500, 1000, 1500, 2000, 3000, 4000, 5000)),
        sea_states=(
            SeaState(kind="calm"),
            *(SeaState(kind="random_phase", significant_wave_height=h, peak_omega=w) for h, w in seas),
        ),
        hauling_speed=1.0,
    )


@case("lowering")
def deep_lowering() -> LoweringPlan:
    """A 40 t manifold to 3000 m on 77 mm wire, from a vessel in seas of 1.5 to 3.5 m: tables of what it may
    do.
    """
    seas = ((1.5, 0.95), (2.5, 0.80), (3.5, 0.70))
    return LoweringPlan(
        cable=Cable(
            mass_per_length=25.0,
            axial_stiffness=2.9e8,
            submerged_weight=205.0,
            diameter=0.077,
            tangential_drag_coefficient=0.01,
            breaking_strength=5.0e6,
        ),
        payload=Payload(mass=4.0e4, added_mass=5.0e4, submerged_weight=3.4e5, drag_area=25.0),
        vessel=Vessel(natural_omega=0.8, damping_ratio=0.5, gain=0.6),
        lengths=tuple(float(length) for length in (100, 250, 500, 750, 1000, 1500, 2000, 2500, 3000)),
        sea_states=tuple(
            SeaState(kind="random_phase", significant_wave_height=h, peak_omega=w) for h, w in seas
        ),
        hauling_speed=0.5,
        safety_factor=3.0,
    )


# Slack and snaps -----------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class SnapLoads:
    """A payload on a cable whose sheave moves up and down so hard that it may go slack."""

    cable: Cable
    """The cable."""
    payload: Payload
    """The body at its end."""
    length: float
    """Unstretched length [m]."""
    sheave_amplitude: float
    """Amplitude of the sheave's heave [m]."""
    period: float
    """Its period [s]."""
    n_elements: int = 1
    """1: the cable is a massless spring; more: a rod with its mass, which wants axial damping [-]."""
    cable_mass_share: float = 0.0
    """Share of the cable's mass that a massless spring adds to the payload [-]."""
    n_periods: int = 40
    """Periods that are marched; the first five eighths are left out as transient [-]."""
    steps_per_period: int = 1000
    """Time steps to a period [-]."""

    def __post_init__(self) -> None:
        require_number(self, "sheave_amplitude", non_negative=True)
        require_number(self, "period", positive=True)
        require_integer(self, "n_periods", minimum=8)
        require_integer(self, "steps_per_period", minimum=20)

    def record(self) -> LoweringRecord:
        """The march, all of it."""
        dt = self.period / self.steps_per_period
        phase = 2.0 * math.pi / self.steps_per_period * np.arange(self.n_periods * self.steps_per_period + 1)
        return Lowering(cable=self.cable, payload=self.payload).simulate(
            self.length,
            self.sheave_amplitude * np.sin(phase),
            dt,
            n_elements=self.n_elements,
            cable_mass_share=self.cable_mass_share,
        )

    def outcome(self) -> Outcome:
        """Extremes after the transient, and what the closed forms say beside them."""
        lowering = Lowering(cable=self.cable, payload=self.payload)
        record = self.record()
        steady = record.after(0.625 * record.time[-1])
        at_sheave = float(steady.sheave_tension.max())
        periods = (steady.time[-1] - steady.time[0]) / self.period
        stiffness = lowering.spring_constant(self.length)
        natural = 2.0 * math.pi * math.sqrt(self.payload.inertia / stiffness)
        static = self.payload.submerged_weight
        quantities = [
            Quantity("static_tension", static, "N", "tension at the payload at rest"),
            Quantity("peak_tension", steady.peak_tension, "N", "greatest tension at the payload"),
            Quantity("peak_over_static", steady.peak_tension / static, "-", "the same over that at rest"),
            Quantity(
                "peak_sheave_tension", float(steady.sheave_tension.max()), "N", "greatest at the sheave"
            ),
            Quantity("payload_highest", float(steady.payload_heave.max()), "m", "above its place at rest"),
            Quantity("payload_lowest", float(steady.payload_heave.min()), "m", "below it, if negative"),
            Quantity("slack_share", steady.slack_share, "-", "share of the time without tension"),
            Quantity("snaps_per_period", steady.n_snaps / periods, "-", "how often it comes taut"),
            Quantity("spring_constant", stiffness, "N/m", "stiffness of the cable"),
            Quantity("natural_period", natural, "s", "of the payload on the massless cable"),
        ]
        if self.cable.breaking_strength is not None:
            strength = self.cable.breaking_strength
            at_rest = float(lowering.safety_factor(self.length))
            quantities += [
                Quantity("safety_factor_at_rest", at_rest, "-", "strength over the static tension"),
                Quantity("safety_factor", strength / at_sheave, "-", "strength over the peak at the sheave"),
            ]
        last = record.after(record.time[-1] - 4.0 * self.period)

        def motion(figure: Any) -> None:
            upper, lower = figure.subplots(2, 1, sharex=True)
            upper.plot(last.time, last.sheave_heave, color=COLOURS[0], label="sheave")
            upper.plot(last.time, last.payload_heave, color=COLOURS[1], label="payload")
            lower.plot(last.time, last.payload_tension / 1e3, color=COLOURS[3], label="at the payload")
            lower.axhline(static / 1e3, color=INK, lw=0.9, ls=DASHED, label="at rest")
            upper.set_ylabel("heave [m]")
            lower.set_ylabel("tension [kN]")
            lower.set_xlabel("time [s]")
            for axes in (upper, lower):
                _legend_above(axes, 2)

        table = {
            "time [s]": last.time,
            "sheave heave [m]": last.sheave_heave,
            "payload heave [m]": last.payload_heave,
            "payload velocity [m/s]": last.payload_velocity,
            "tension at the payload [N]": last.payload_tension,
            "tension at the sheave [N]": last.sheave_tension,
        }
        return Outcome(tuple(quantities), {"last_periods": table}, {"motion": motion})


@case("lowering")
def instrument_package() -> SnapLoads:
    """Berteaux's example 9.5: 3000 ft of wire, the sheave 7 ft up and down every 4 s: it snaps."""
    return SnapLoads(
        cable=wire_rope(0.375, 0.191),
        payload=heavy_package(),
        length=3000.0 * FOOT,
        sheave_amplitude=7.0 * FOOT,
        period=4.0,
    )


@case("lowering")
def instrument_package_with_cable_mass() -> SnapLoads:
    """The same with the cable as a rod of 20 elements, its mass and 5 ms of Kelvin damping: it pulls
    harder.
    """
    massless = instrument_package()
    damping = 0.005 * massless.cable.axial_stiffness
    return replace(massless, cable=replace(massless.cable, axial_damping=damping), n_elements=20)
