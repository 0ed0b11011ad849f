"""Cases of the axial cable: lowering, recovery and stops by any pay-out profile, and frequency sweeps.

The thesis's examples stand here once, for its figures and the validation too. Pay-out is outwards positive,
heave up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from experiments.cases.case import Outcome, Quantity, case
from experiments.figures import COLOURS
from heave_env.cable.axial import AxialRecord, AxialSolver
from heave_env.cable.closed_form import natural_omegas, payload_response, resonant_length
from heave_env.parameters import Cable, Payload, require, require_integer, require_number
from heave_env.scenarios import circular_section
from heave_env.sea import read_motion

Array = np.ndarray


# Lowering and recovery ---------------------------------------------------------------------------


def paid_out(instants: Array, knots: tuple[float, ...], speeds: tuple[float, ...]) -> Array:
    """Cable paid out since t = 0 by a speed linear between knots [m], the shape of `instants`.

    Beyond the knots the nearest speed holds; two knots at one instant are a jump. The integral is exact.

    Args:
        instants: Times, not negative [s].
        knots: Instants of the speed's knots, not decreasing [s].
        speeds: Pay-out rate at each knot, positive outwards [m/s].
    """
    last = max(float(np.max(instants)), knots[-1]) + 1.0
    t = np.array([min(-1.0, knots[0] - 1.0), *knots, last])
    v = np.array([speeds[0], *speeds, speeds[-1]])
    area = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))])

    def up_to(at: Array) -> Array:
        k = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
        share = (at - t[k]) / np.where(t[k + 1] > t[k], t[k + 1] - t[k], 1.0)
        return np.asarray(area[k] + (at - t[k]) * (v[k] + 0.5 * share * (v[k + 1] - v[k])))

    return up_to(np.asarray(instants, dtype=float)) - up_to(np.zeros(1))


def cycle_amplitude(signal: Array, n_per_cycle: int) -> tuple[Array, Array]:
    """Half range and middle of a signal over a sliding cycle, each the shape of `signal`."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    width = max(1, n_per_cycle)
    most, least = maximum_filter1d(signal, width), minimum_filter1d(signal, width)
    return 0.5 * (most - least), 0.5 * (most + least)


@dataclass(frozen=True, kw_only=True)
class Lowering:
    """A payload on an axial cable whose length follows a pay-out profile while the sheave heaves."""

    cable: Cable
    """The hoisting cable."""
    payload: Payload
    """The subsea unit."""
    length: float
    """Unstretched length outboard at the start [m]."""
    duration: float
    """How long the run lasts [s]."""
    dt: float = 0.05
    """Time step [s]."""
    n_elements: int = 20
    """Elements of the cable [-]."""
    heave_amplitude: float = 0.0
    """Amplitude of the sheave's sinusoidal heave [m]."""
    heave_omega: float = 1.0
    """Its angular frequency [rad/s]."""
    heave_ramp: float = 0.0
    """How long the amplitude takes to grow from zero [s]."""
    motion_file: str | None = None
    """CSV with columns time, heave and optionally payout, in place of the sinusoid; null: the sinusoid."""
    pay_out_time: tuple[float, ...] = (0.0,)
    """Instants of the pay-out profile's knots, not decreasing; two equal ones are a jump [s]."""
    pay_out_speed: tuple[float, ...] = (0.0,)
    """Pay-out rate at each knot, positive outwards, negative for recovery, linear between [m/s]."""

    def __post_init__(self) -> None:
        for field in ("length", "duration", "dt", "heave_omega"):
            require_number(self, field, positive=True)
        for field in ("heave_amplitude", "heave_ramp"):
            require_number(self, field, non_negative=True)
        require_integer(self, "n_elements", minimum=1)
        require(self.dt <= self.duration, self, "dt", f"at most the duration, {self.duration:g} s")
        for field in ("pay_out_time", "pay_out_speed"):
            values = getattr(self, field)
            require(len(values) > 0 and all(math.isfinite(v) for v in values), self, field, "finite numbers")
        knots = self.pay_out_time
        require(all(a <= b for a, b in pairwise(knots)), self, "pay_out_time", "in order")
        require(
            len(self.pay_out_speed) == len(knots),
            self,
            "pay_out_speed",
            f"{len(knots)} numbers, one per knot",
        )

    @property
    def time(self) -> Array:
        """Instants of the run [s], (n_steps + 1,)."""
        return self.dt * np.arange(round(self.duration / self.dt) + 1)

    def motion(self) -> tuple[Array, Array]:
        """Heave of the sheave and unstretched length at each instant [m], each (n_steps + 1,).

        Raises:
            ValueError: If the motion file cannot be used or the cable is hauled in wholly.
        """
        time = self.time
        lengths = self.length + paid_out(time, self.pay_out_time, self.pay_out_speed)
        if self.motion_file is not None:
            heave, _, payout = read_motion(self.motion_file).sampled(time)
            return heave, lengths + payout
        growth = np.minimum(time / self.heave_ramp, 1.0) if self.heave_ramp else 1.0
        return growth * self.heave_amplitude * np.sin(self.heave_omega * time), lengths

    @property
    def solver(self) -> AxialSolver:
        """The solver that it runs."""
        return AxialSolver(
            cable=self.cable, payload=self.payload, length=self.length, n_elements=self.n_elements
        )

    def record(self) -> AxialRecord:
        """The march."""
        heave, lengths = self.motion()
        return self.solver.simulate(heave, self.dt, lengths)

    def outcome(self) -> Outcome:
        """Runs it."""
        record = self.record()
        if self.motion_file is None:
            n_per_cycle = round(2.0 * math.pi / self.heave_omega / self.dt)
            cycle = f"a cycle of {2.0 * math.pi / self.heave_omega:.3g} s"
        else:
            n_per_cycle, cycle = round(20.0 / self.dt), "20 s"
        amplitude, middle = cycle_amplitude(record.payload_displacement, min(n_per_cycle, len(record.time)))
        peak = int(np.argmax(amplitude))
        static = self.payload.submerged_weight + self.cable.submerged_weight * record.length
        longest = int(np.argmax(static))
        periods = [
            2.0 * math.pi / float(natural_omegas(self.cable, self.payload, L, 1)[0])
            if self.cable.inertia_per_length > 0.0
            else 2.0 * math.pi * math.sqrt(self.payload.inertia * L / self.cable.axial_stiffness)
            for L in (float(record.length[0]), float(record.length[-1]))
        ]
        quantities = [
            Quantity("final_length", float(record.length[-1]), "m", "unstretched length at the end"),
            Quantity(
                "payload_amplitude_max", float(amplitude[peak]), "m", f"largest half range within {cycle}"
            ),
            Quantity("length_at_largest_amplitude", float(record.length[peak]), "m", "length at that moment"),
            Quantity(
                "payload_offset_extreme",
                float(middle[np.argmax(np.abs(middle))]),
                "m",
                "largest mean displacement from the static position, up: drag of lowering",
            ),
            Quantity("sheave_tension_max", float(record.sheave_tension.max()), "N", "at the sheave"),
            Quantity("sheave_tension_min", float(record.sheave_tension.min()), "N", "at the sheave"),
            Quantity("tension_max", float(record.tension_max.max()), "N", "anywhere on the cable"),
            Quantity("tension_min", float(record.tension_min.min()), "N", "anywhere on the cable"),
            Quantity("static_tension_max", float(static[longest]), "N", "weights at the greatest length"),
            Quantity(
                "dynamic_factor",
                float(np.max(record.sheave_tension / static)),
                "-",
                "largest sheave tension over the static one at the same length",
            ),
            Quantity(
                "slack_fraction", record.slack_fraction, "-", "share of steps slack or compressed somewhere"
            ),
            Quantity("natural_period_start", periods[0], "s", "first natural period at the first length"),
            Quantity("natural_period_end", periods[1], "s", "first natural period at the final length"),
        ]
        if self.motion_file is None:
            resonant = float(resonant_length(self.heave_omega, self.cable, self.payload))
            quantities.append(Quantity("resonant_length", resonant, "m", "where the closed form resonates"))
        if self.cable.breaking_strength is not None:
            safety = self.cable.breaking_strength / float(record.tension_max.max())
            quantities.append(
                Quantity("safety_factor", safety, "-", "breaking strength over largest tension")
            )
        columns = {
            "time [s]": record.time,
            "length [m]": record.length,
            "sheave_heave [m]": record.sheave_heave,
            "payload_displacement [m]": record.payload_displacement,
            "payload_velocity [m/s]": record.payload_velocity,
            "sheave_tension [N]": record.sheave_tension,
            "payload_tension [N]": record.payload_tension,
            "tension_min [N]": record.tension_min,
            "tension_max [N]": record.tension_max,
        }
        along = {
            "share_of_length_from_payload [-]": record.element_share,
            "tension_min [N]": record.element_tension_min,
            "tension_max [N]": record.element_tension_max,
        }
        return Outcome(
            quantities=tuple(quantities),
            tables={"history": columns, "along_the_cable": along},
            pictures={
                "motion": lambda figure: draw_motion(figure, record),
                "tension": lambda figure: draw_tension(figure, record, self.cable, self.payload),
                "along_the_cable": lambda figure: draw_envelope(figure, record),
            },
        )


def draw_motion(figure: Any, record: AxialRecord) -> None:
    """Payload and sheave over time, and the length."""
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1.0))
    upper.plot(record.time, record.payload_displacement, color=COLOURS[3], lw=0.9, label="payload")
    upper.plot(record.time, record.sheave_heave, color=COLOURS[0], lw=0.7, label="sheave")
    upper.set_ylabel("heave from static [m]")
    upper.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    lower.plot(record.time, record.length, color=COLOURS[4])
    lower.set_ylabel("length [m]")
    lower.set_xlabel("time [s]")
    lower.set_xlim(0.0, float(record.time[-1]))


def draw_tension(figure: Any, record: AxialRecord, cable: Cable, payload: Payload) -> None:
    """Tensions at both ends over time, beside the static one."""
    axes = figure.subplots()
    static = payload.submerged_weight + cable.submerged_weight * record.length
    axes.plot(record.time, record.sheave_tension / 1e3, color=COLOURS[1], lw=0.8, label="sheave")
    axes.plot(record.time, record.payload_tension / 1e3, color=COLOURS[3], lw=0.8, label="payload")
    axes.plot(record.time, static / 1e3, color="#30353d", lw=1.0, ls="--", label="static, sheave")
    axes.set_xlim(0.0, float(record.time[-1]))
    axes.set_xlabel("time [s]")
    axes.set_ylabel("tension [kN]")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)


def draw_envelope(figure: Any, record: AxialRecord) -> None:
    """Least and most tension along the cable over the whole run."""
    axes = figure.subplots()
    axes.fill_betweenx(
        record.element_share,
        record.element_tension_min / 1e3,
        record.element_tension_max / 1e3,
        color=COLOURS[3],
        alpha=0.25,
        lw=0.0,
    )
    axes.plot(record.element_tension_max / 1e3, record.element_share, color=COLOURS[1], label="most")
    axes.plot(record.element_tension_min / 1e3, record.element_share, color=COLOURS[4], label="least")
    axes.axvline(0.0, color="#30353d", lw=0.8)
    axes.set_ylim(0.0, 1.0)
    axes.set_xlabel("tension over the whole run [kN]")
    axes.set_ylabel("share of the length, payload to sheave [-]")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)


# Frequency sweeps --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Sweep:
    """Settled extremes of a suspension against frequency, each of shape (n_omegas,)."""

    omega: Array
    """Angular frequencies of the top [rad/s]."""
    tension_max: Array
    """Largest tension on the cable [N]."""
    tension_min: Array
    """Least tension on the cable [N]."""
    payload_amplitude: Array
    """Half the payload's range [m]."""
    slack_fraction: Array
    """Share of the time slack somewhere [-]."""


@dataclass(frozen=True, kw_only=True)
class Suspension:
    """A body on a cable of constant length whose top moves sinusoidally, frequency by frequency."""

    cable: Cable
    """The cable."""
    payload: Payload
    """The body at its lower end."""
    length: float
    """Unstretched length [m]."""
    amplitude: float
    """Amplitude of the top [m]."""
    omega_low: float
    """Lowest angular frequency of the sweep [rad/s]."""
    omega_high: float
    """Highest [rad/s]."""
    n_omegas: int = 60
    """Frequencies between them [-]."""
    n_elements: int = 10
    """Elements of the cable [-]."""
    steps_per_period: int = 200
    """Time steps in a period of the top [-]."""
    n_settling: int = 60
    """Periods over which the amplitude grows and transients die [-]."""
    n_measured: int = 20
    """Periods over which the extremes are taken [-]."""

    def __post_init__(self) -> None:
        for field in ("length", "amplitude", "omega_low", "omega_high"):
            require_number(self, field, positive=True)
        require(
            self.omega_high >= self.omega_low, self, "omega_high", f"at least omega_low, {self.omega_low:g}"
        )
        for field, minimum in (
            ("n_omegas", 1),
            ("n_elements", 1),
            ("steps_per_period", 20),
            ("n_settling", 1),
            ("n_measured", 1),
        ):
            require_integer(self, field, minimum=minimum)

    def at(self, omega: float) -> AxialRecord:
        """The march at one frequency, settling and measured periods together."""
        n_periods = self.n_settling + self.n_measured
        cycles = np.arange(n_periods * self.steps_per_period + 1) / self.steps_per_period
        growth = np.sin(0.5 * math.pi * np.minimum(2.0 * cycles / self.n_settling, 1.0)) ** 2
        heave = self.amplitude * growth * np.sin(2.0 * math.pi * cycles)
        solver = AxialSolver(
            cable=self.cable, payload=self.payload, length=self.length, n_elements=self.n_elements
        )
        return solver.simulate(heave, 2.0 * math.pi / omega / self.steps_per_period)

    def sweep(self, omegas: Array | None = None) -> Sweep:
        """Settled extremes at each frequency, those of the case if none are given."""
        if omegas is None:
            omegas = np.linspace(self.omega_low, self.omega_high, self.n_omegas)
        rows = []
        for omega in omegas:
            record = self.at(float(omega))
            last = slice(-self.n_measured * self.steps_per_period, None)
            rows.append(
                (
                    record.tension_max[last].max(),
                    record.tension_min[last].min(),
                    0.5 * np.ptp(record.payload_displacement[last]),
                    np.mean(record.tension_min[last] <= 0.0),
                )
            )
        return Sweep(np.asarray(omegas, dtype=float), *np.array(rows).T)

    @property
    def static_tension(self) -> float:
        """Tension at the top at rest [N]."""
        return self.payload.submerged_weight + self.cable.submerged_weight * self.length

    @property
    def stiffness(self) -> float:
        """K = EA / L [N/m]."""
        return self.cable.axial_stiffness / self.length

    def linear_tension_max(self, omega: Array) -> Array:
        """Largest tension at the top by the closed form: no drag, no slack [N], the shape of `omega`.

        u(s) = H (cos ks - (M ω² / (E* k)) sin ks) from the payload up; E* times its slope at the sheave is
        the dynamic tension.
        """
        w = np.asarray(omega, dtype=float)
        modulus = self.cable.axial_stiffness + 1j * w * self.cable.axial_damping
        k = w * np.sqrt(self.cable.inertia_per_length / modulus)
        response = payload_response(w, self.cable, self.payload, self.length)
        mass_term = self.payload.inertia * w**2 / (modulus * k)
        slope = -response * k * (np.sin(k * self.length) + mass_term * np.cos(k * self.length))
        return np.asarray(self.static_tension + self.amplitude * np.abs(modulus * slope))

    def outcome(self) -> Outcome:
        """Runs it."""
        swept = self.sweep()
        peak = int(np.argmax(swept.tension_max))
        slack = np.nonzero(swept.slack_fraction > 0.0)[0]
        natural = float(natural_omegas(self.cable, self.payload, self.length, 1)[0])
        ratio = (swept.tension_max - self.static_tension) / (self.stiffness * self.amplitude)
        quantities = [
            Quantity("static_tension", self.static_tension, "N", "at the top, at rest"),
            Quantity("stiffness", self.stiffness, "N/m", "K = EA / L"),
            Quantity("natural_omega", natural, "rad/s", "first, without drag"),
            Quantity("tension_max", float(swept.tension_max[peak]), "N", "largest of the sweep"),
            Quantity("omega_at_tension_max", float(swept.omega[peak]), "rad/s", "where that is"),
            Quantity("tension_ratio_max", float(ratio[peak]), "-", "(T_max - T_static) / (K amplitude)"),
            Quantity("payload_amplitude_max", float(swept.payload_amplitude.max()), "m", "of the sweep"),
        ]
        if len(slack):
            onset = float(swept.omega[slack[0]])
            quantities.append(
                Quantity(
                    "slack_from_omega", onset, "rad/s", "lowest frequency at which tension vanishes somewhere"
                )
            )
        table = {
            "omega [rad/s]": swept.omega,
            "frequency [Hz]": swept.omega / (2.0 * math.pi),
            "tension_max [N]": swept.tension_max,
            "tension_min [N]": swept.tension_min,
            "tension_ratio [-]": ratio,
            "payload_amplitude [m]": swept.payload_amplitude,
            "slack_fraction [-]": swept.slack_fraction,
        }

        def draw(figure: Any) -> None:
            axes = figure.subplots()
            frequency = swept.omega / (2.0 * math.pi)
            axes.plot(frequency, swept.tension_max, color=COLOURS[1], label="largest")
            axes.plot(frequency, swept.tension_min, color=COLOURS[3], label="least")
            axes.axhline(self.static_tension, color="#30353d", lw=0.8, ls="--", label="static")
            axes.set_xlabel("frequency of the top [Hz]")
            axes.set_ylabel("tension on the cable [N]")
            axes.legend()

        return Outcome(quantities=tuple(quantities), tables={"sweep": table}, pictures={"tension": draw})


# The thesis's examples (H 3.3.1-3.3.5) -----------------------------------------------------------

_WOODEN_SPHERE = Payload(mass=4.722, submerged_weight=1.0).in_air()


def _rope_in_air(diameter: float, modulus: float, mass_per_length: float, relaxation: float) -> Cable:
    stiffness = modulus * circular_section(diameter)
    return Cable(
        mass_per_length=mass_per_length,
        axial_stiffness=stiffness,
        submerged_weight=0.0,
        diameter=diameter,
        axial_damping=relaxation * stiffness,
        tension_only=True,
    ).in_air()


@case("axial")
def thesis_polyester_3_mm() -> Suspension:
    """Huang's example one: a wooden sphere on 4.573 m of 3 mm polyester rope in air, the top moving 50 mm;
    the rope's internal damping is ours (2 ms).
    """
    return Suspension(
        cable=_rope_in_air(0.003, 3.38e9, 8.067e-3, 0.002),
        payload=_WOODEN_SPHERE,
        length=4.573,
        amplitude=0.05,
        omega_low=2.0,
        omega_high=14.0,
        n_omegas=121,
    )


@case("axial")
def thesis_polyester_2_mm() -> Suspension:
    """Huang's example two: the same sphere on 2 mm polyester rope, the top moving 100 mm; at the higher
    frequencies the rope goes slack and snatches. The rope's internal damping is ours (2 ms).
    """
    return Suspension(
        cable=_rope_in_air(0.002, 2.445e9, 4.155e-3, 0.002),
        payload=_WOODEN_SPHERE,
        length=4.573,
        amplitude=0.1,
        omega_low=2.0,
        omega_high=11.0,
        n_omegas=91,
    )


@case("axial")
def thesis_sphere_in_air() -> Suspension:
    """Huang's example three: an aluminium sphere on 22.25 m of nylon rope in air, through resonance; the top
    moves 25.4 mm. The rope's internal damping is ours (20 ms, 5 % of critical).
    """
    return Suspension(
        cable=_rope_in_air(0.00635, 2.67e8, 3.23e-2, 0.02),
        payload=Payload(mass=12.65, submerged_weight=1.0).in_air(),
        length=22.25,
        amplitude=0.0254,
        omega_low=1.0,
        omega_high=10.0,
        n_omegas=91,
    )


@case("axial")
def thesis_sphere_in_water() -> Suspension:
    """Huang's example four: the same sphere in water, 2.3 kg of added mass, 83.68 N. Its drag (C_d 0.5 on the
    projected area), the rope's (C_t 0.01), weight in water and internal damping (20 ms) are ours.
    """
    stiffness = 2.67e8 * circular_section(0.00635)
    return Suspension(
        cable=Cable(
            mass_per_length=3.23e-2,
            axial_stiffness=stiffness,
            submerged_weight=0.03,
            diameter=0.00635,
            tangential_drag_coefficient=0.01,
            axial_damping=0.02 * stiffness,
            tension_only=True,
        ),
        payload=Payload(
            mass=12.65,
            added_mass=2.3,
            submerged_weight=83.68,
            drag_area=0.5 * circular_section(0.2032),
        ),
        length=22.25,
        amplitude=0.0254,
        omega_low=1.0,
        omega_high=10.0,
        n_omegas=91,
    )


def example_five(**changes: Any) -> Lowering:
    """The cable and unit of Huang's example five with the weights, drag and amplitude that we assume.

    C_d S and the cable's weight are those of his 6.2.6, C_t that of a smooth wire, the heave is 1 m.
    """
    stiffness = 9.05e9 * circular_section(0.047)
    settings: dict[str, Any] = {
        "cable": Cable(
            mass_per_length=7.2,
            axial_stiffness=stiffness,
            submerged_weight=54.0,
            diameter=0.047,
            tangential_drag_coefficient=0.0025,
        ),
        "payload": Payload(mass=5000.0, added_mass=8000.0, submerged_weight=35_000.0, drag_area=1.0),
        "length": 50.0,
        "heave_amplitude": 1.0,
        "heave_omega": 1.26,
    }
    return Lowering(**{**settings, **changes})


@case("axial")
def thesis_lowering() -> Lowering:
    """Huang's example five: 5 t lowered from 50 m at 1 m/s through resonance with a swell of 1.26 rad/s.
    Weights, drag and the 1 m of heave are ours, for the thesis does not print them.
    """
    return example_five(duration=1000.0, pay_out_speed=(1.0,))


@case("axial")
def thesis_sudden_stop() -> Lowering:
    """Huang's figure 3.24: lowering at 2 m/s suddenly stops after 300 s, at 650 m. Depth, frequency and all
    that example five does not print are ours.
    """
    return example_five(
        duration=450.0,
        heave_omega=0.838,
        heave_amplitude=0.5,
        pay_out_time=(0.0, 300.0, 300.0),
        pay_out_speed=(2.0, 2.0, 0.0),
    )


@case("axial")
def recovery_with_reversal() -> Lowering:
    """Recovery from 1200 m: hauled in at 1.5 m/s with ramps, halted, paid out again for a minute, hauled in;
    a tension-only cable with 5 ms of internal damping in a swell of 0.838 rad/s.
    """
    base = example_five(duration=1.0).cable
    cable = Cable(
        mass_per_length=base.mass_per_length,
        axial_stiffness=base.axial_stiffness,
        submerged_weight=base.submerged_weight,
        diameter=base.diameter,
        tangential_drag_coefficient=base.tangential_drag_coefficient,
        axial_damping=0.005 * base.axial_stiffness,
        tension_only=True,
        breaking_strength=1.1e6,
    )
    return example_five(
        cable=cable,
        length=1200.0,
        duration=900.0,
        heave_amplitude=0.8,
        heave_omega=0.838,
        heave_ramp=30.0,
        pay_out_time=(0.0, 20.0, 300.0, 320.0, 360.0, 380.0, 420.0, 440.0, 460.0, 850.0, 870.0),
        pay_out_speed=(0.0, -1.5, -1.5, 0.0, 0.0, 1.0, 1.0, 0.0, -1.5, -1.5, 0.0),
    )
