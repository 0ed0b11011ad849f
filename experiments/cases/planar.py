"""Cases of the planar cable: operations in a current, and frequency sweeps of a swinging body.

The examples of the thesis's chapter 4 stand here once, for its figures and the validation too. x points
along the current, z up from the mean surface; pay-out is outwards positive.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from experiments.cases.axial import (
    cycle_amplitude,
    paid_out,
    thesis_polyester_2_mm,
    thesis_polyester_3_mm,
)
from experiments.cases.case import Outcome, Quantity, case
from experiments.figures import COLOURS
from heave_env.cable.planar import PAYLOAD_DRAG, PlanarRecord, PlanarSolver, PlanarState
from heave_env.parameters import (
    GRAVITY,
    SEAWATER_DENSITY,
    Cable,
    Current,
    Payload,
    require,
    require_integer,
    require_number,
)
from heave_env.scenarios import circular_section

Array = np.ndarray

FRESH_WATER_DENSITY = 1000.0
"""Density of the tank's water [kg/m³]."""
AIR_DENSITY = 1.2
"""Density of air [kg/m³]."""

INK = "#30353d"


# Operations --------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class PlanarOperation:
    """A payload on a cable below a boom tip that heaves and sways, in a current, while length changes."""

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
    n_elements: int = 40
    """Elements of the cable [-]."""
    current: Current
    """The current; its x component is felt."""
    payload_drag: str = "components"
    """How the payload's drag takes the relative velocity: components or vector."""
    heave_amplitude: float = 0.0
    """Amplitude A of the boom tip's heave, z = A sin ωt; negative begins downwards [m]."""
    sway_amplitude: float = 0.0
    """Amplitude B of its sway, x = B (sin(ωt + φ) - sin φ) [m]."""
    sway_phase: float = 0.0
    """Phase φ of the sway ahead of the heave; ±π/2 with equal amplitudes is a circle [rad]."""
    omega: float = 1.0
    """Angular frequency ω of both [rad/s]."""
    growth: float = 0.0
    """How long both amplitudes take to grow from zero [s]."""
    pay_out_time: tuple[float, ...] = (0.0,)
    """Instants of the pay-out profile's knots, not decreasing; two equal ones are a jump [s]."""
    pay_out_speed: tuple[float, ...] = (0.0,)
    """Pay-out rate at each knot, positive outwards, negative for recovery, linear between [m/s]."""
    start_at_rest: bool = True
    """Whether it begins at rest in the current; false: hanging straight down, as in still water."""
    settling: float = 0.0
    """How long at the start counts for no quantity: transients [s]."""

    def __post_init__(self) -> None:
        for field in ("length", "duration", "dt", "omega"):
            require_number(self, field, positive=True)
        for field in ("heave_amplitude", "sway_amplitude", "sway_phase"):
            require_number(self, field)
        for field in ("growth", "settling"):
            require_number(self, field, non_negative=True)
        require_integer(self, "n_elements", minimum=1)
        require(self.payload_drag in PAYLOAD_DRAG, self, "payload_drag", f"one of {', '.join(PAYLOAD_DRAG)}")
        require(self.dt <= self.duration, self, "dt", f"at most the duration, {self.duration:g} s")
        require(self.settling < self.duration, self, "settling", f"below the duration, {self.duration:g} s")
        knots, speeds = self.pay_out_time, self.pay_out_speed
        require(len(knots) > 0 and all(map(math.isfinite, knots)), self, "pay_out_time", "finite numbers")
        require(all(map(math.isfinite, speeds)), self, "pay_out_speed", "finite numbers")
        require(all(a <= b for a, b in itertools.pairwise(knots)), self, "pay_out_time", "in order")
        require(len(speeds) == len(knots), self, "pay_out_speed", f"{len(knots)} numbers, one per knot")

    @property
    def time(self) -> Array:
        """Instants of the run [s], (n_steps + 1,)."""
        return self.dt * np.arange(round(self.duration / self.dt) + 1)

    @property
    def solver(self) -> PlanarSolver:
        """The solver that it runs."""
        return PlanarSolver(
            cable=self.cable,
            payload=self.payload,
            length=self.length,
            n_elements=self.n_elements,
            current=self.current,
            payload_drag=self.payload_drag,
        )

    def motion(self) -> tuple[Array, Array, Array]:
        """Boom tip x and z, and unstretched length, at each instant [m], each (n_steps + 1,)."""
        time = self.time
        grown = np.minimum(time / self.growth, 1.0) if self.growth else 1.0
        sway = np.sin(self.omega * time + self.sway_phase) - math.sin(self.sway_phase)
        heave = np.sin(self.omega * time)
        lengths = self.length + paid_out(time, self.pay_out_time, self.pay_out_speed)
        return grown * self.sway_amplitude * sway, grown * self.heave_amplitude * heave, lengths

    def record(self, *, shapes_every: int | None = None) -> PlanarRecord:
        """The march."""
        x, z, lengths = self.motion()
        start: PlanarState | None = None
        if not self.start_at_rest:
            start = self.solver.hanging((float(x[0]), float(z[0])), float(lengths[0]))
        return self.solver.simulate(x, z, self.dt, lengths, start=start, shapes_every=shapes_every)

    def dynamic_heave(self, record: PlanarRecord) -> Array:
        """Payload above where it would hang still and straight at the length of the same instant [m]."""
        return np.asarray(record.payload_z + record.length + self.solver.static_stretch(record.length))

    def outcome(self) -> Outcome:
        """Runs it."""
        n_steps = len(self.time) - 1
        record = self.record(shapes_every=max(1, n_steps // 6))
        n_per_cycle = min(round(2.0 * math.pi / self.omega / self.dt), n_steps)
        counted = record.time >= self.settling
        heave = self.dynamic_heave(record)
        heave_amplitude, heave_middle = cycle_amplitude(heave, n_per_cycle)
        sway_amplitude, sway_middle = cycle_amplitude(record.payload_x, n_per_cycle)
        static = self.payload.submerged_weight + self.cable.submerged_weight * record.length
        loudest = int(np.argmax(np.where(counted, heave_amplitude, -1.0)))
        last_cycle = max(0, n_steps - n_per_cycle // 2 - 1)  # its middle: the last whole one
        cycle = f"a cycle of {2.0 * math.pi / self.omega:.3g} s"
        tension = record.top_tension[counted]
        quantities = [
            Quantity("final_length", float(record.length[-1]), "m", "unstretched length at the end"),
            Quantity("payload_depth_final", float(-record.payload_z[-1]), "m", "below the mean surface"),
            Quantity(
                "payload_offset_final", float(sway_middle[last_cycle]), "m", "middle of x in the last cycle"
            ),
            Quantity(
                "payload_offset_max",
                float(np.max(np.abs(record.payload_x[counted]))),
                "m",
                "largest distance from x = 0",
            ),
            Quantity(
                "payload_sway_amplitude",
                float(np.max(sway_amplitude[counted])),
                "m",
                f"largest half range of x within {cycle}",
            ),
            Quantity(
                "payload_heave_amplitude",
                float(heave_amplitude[loudest]),
                "m",
                f"largest half range of the heave within {cycle}",
            ),
            Quantity("length_at_largest_heave", float(record.length[loudest]), "m", "where that is"),
            Quantity(
                "payload_rise_final",
                float(heave_middle[last_cycle]),
                "m",
                "mean height above hanging still and straight, last cycle: drag of lowering and current",
            ),
            Quantity("top_tension_max", float(tension.max()), "N", "at the boom tip"),
            Quantity("top_tension_min", float(tension.min()), "N", "at the boom tip"),
            Quantity("tension_min", float(record.least_tension[counted].min()), "N", "anywhere"),
            Quantity(
                "dynamic_factor",
                float(np.max((record.top_tension / static)[counted])),
                "-",
                "largest top tension over the weights at the same length",
            ),
            Quantity(
                "top_angle_max",
                float(np.max(np.abs(record.top_angle[counted]))),
                "rad",
                "of the cable at the boom tip from the vertical",
            ),
            Quantity("slack_fraction", float(np.mean(record.slack[counted])), "-", "slack anywhere"),
        ]
        if self.cable.breaking_strength is not None:
            safety = self.cable.breaking_strength / float(record.largest_tension.max())
            quantities.append(
                Quantity("safety_factor", safety, "-", "breaking strength over largest tension")
            )
        x, z, _ = self.motion()
        last = record.final
        return Outcome(
            quantities=tuple(quantities),
            tables={
                "history": {
                    "time [s]": record.time,
                    "length [m]": record.length,
                    "top_x [m]": x,
                    "top_z [m]": z,
                    "payload_x [m]": record.payload_x,
                    "payload_z [m]": record.payload_z,
                    "payload_heave [m]": heave,
                    "payload_velocity_x [m/s]": record.payload_velocity_x,
                    "payload_velocity_z [m/s]": record.payload_velocity_z,
                    "top_tension [N]": record.top_tension,
                    "top_angle [rad]": record.top_angle,
                    "payload_tension [N]": record.payload_tension,
                    "tension_min [N]": record.least_tension,
                    "tension_max [N]": record.largest_tension,
                },
                "final_shape": {
                    "arc_length_from_payload [m]": last.length * np.linspace(0.0, 1.0, self.n_elements + 1),
                    "x [m]": last.position[:, 0],
                    "z [m]": last.position[:, 1],
                },
            },
            pictures={
                "motion": lambda figure: draw_motion(figure, record, heave),
                "tension": lambda figure: draw_tension(figure, record, static),
                "shapes": lambda figure: draw_shapes(figure, record),
            },
        )


def draw_motion(figure: Any, record: PlanarRecord, heave: Array) -> None:
    """Heave and sway of the payload over time, and the length."""
    axes = figure.subplots(3, 1, sharex=True, height_ratios=(1.6, 1.6, 1.0))
    axes[0].plot(record.time, heave, color=COLOURS[3], lw=0.9)
    axes[0].set_ylabel("payload heave\nfrom static [m]")
    axes[1].plot(record.time, record.payload_x, color=COLOURS[1], lw=0.9)
    axes[1].set_ylabel("payload x [m]")
    axes[2].plot(record.time, record.length, color=COLOURS[4])
    axes[2].set_ylabel("length [m]")
    axes[2].set_xlabel("time [s]")
    axes[2].set_xlim(float(record.time[0]), float(record.time[-1]))


def draw_tension(figure: Any, record: PlanarRecord, static: Array) -> None:
    """Tension at the boom tip and the least along the cable, beside the weights."""
    axes = figure.subplots()
    axes.plot(record.time, record.top_tension / 1e3, color=COLOURS[1], lw=0.8, label="boom tip")
    axes.plot(record.time, record.least_tension / 1e3, color=COLOURS[3], lw=0.8, label="least on the cable")
    axes.plot(record.time, static / 1e3, color=INK, lw=1.0, ls="--", label="weights")
    axes.set_xlim(float(record.time[0]), float(record.time[-1]))
    axes.set_xlabel("time [s]")
    axes.set_ylabel("tension [kN]")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)


def draw_shapes(figure: Any, record: PlanarRecord) -> None:
    """Shapes of the cable at some instants; the two scales differ."""
    axes = figure.subplots()
    for k, (time, shape) in enumerate(zip(record.shape_time, record.shapes, strict=True)):
        colour = COLOURS[1 + k % (len(COLOURS) - 1)]
        axes.plot(shape[:, 0], shape[:, 1], color=colour, label=f"{time:.0f} s")
        axes.plot(shape[0, 0], shape[0, 1], "o", color=colour, ms=4)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("z [m]")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


# Frequency sweeps --------------------------------------------------------------------------------


@dataclass(frozen=True)
class PlanarSwept:
    """Settled extremes of a swinging body against frequency, each of shape (n_omegas,)."""

    omega: Array
    """Angular frequencies of the top [rad/s]."""
    tension_max: Array
    """Largest tension at the top [N]."""
    tension_min: Array
    """Least tension anywhere on the cable [N]."""
    sway_amplitude: Array
    """Half the range of the body's x [m]."""
    heave_amplitude: Array
    """Half the range of its z [m]."""


@dataclass(frozen=True, kw_only=True)
class PlanarSweep:
    """A body on a cable of constant length whose top moves along a line or an ellipse, by frequency."""

    cable: Cable
    """The cable."""
    payload: Payload
    """The body at its lower end."""
    length: float
    """Unstretched length [m]."""
    current: Current
    """The current; its x component is felt."""
    sway_amplitude: float
    """Amplitude B of the top, x = B sin ωt [m]."""
    heave_amplitude: float
    """Amplitude A of the top, z = A cos ωt; equal amplitudes are a circle [m]."""
    omega_low: float
    """Lowest angular frequency of the sweep [rad/s]."""
    omega_high: float
    """Highest [rad/s]."""
    n_omegas: int = 40
    """Frequencies between them [-]."""
    n_elements: int = 8
    """Elements of the cable [-]."""
    steps_per_period: int = 300
    """Time steps in a period of the top [-]."""
    n_settling: int = 25
    """Periods over which the amplitude grows and transients die [-]."""
    n_measured: int = 10
    """Periods over which the extremes are taken [-]."""

    def __post_init__(self) -> None:
        for field in ("length", "omega_low", "omega_high"):
            require_number(self, field, positive=True)
        for field in ("sway_amplitude", "heave_amplitude"):
            require_number(self, field, non_negative=True)
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

    def at(self, omega: float) -> PlanarRecord:
        """The march at one frequency, settling and measured periods together."""
        n_periods = self.n_settling + self.n_measured
        cycles = np.arange(n_periods * self.steps_per_period + 1) / self.steps_per_period
        grown = np.sin(0.5 * math.pi * np.minimum(2.0 * cycles / self.n_settling, 1.0)) ** 2
        angle = 2.0 * math.pi * cycles
        solver = PlanarSolver(
            cable=self.cable,
            payload=self.payload,
            length=self.length,
            n_elements=self.n_elements,
            current=self.current,
        )
        return solver.simulate(
            self.sway_amplitude * grown * np.sin(angle),
            self.heave_amplitude * grown * np.cos(angle),
            2.0 * math.pi / omega / self.steps_per_period,
        )

    def measured(self, omega: float) -> tuple[PlanarRecord, slice]:
        """The march at one frequency, and where its extremes are taken."""
        return self.at(omega), slice(-self.n_measured * self.steps_per_period, None)

    def sweep(self, omegas: Array | None = None) -> PlanarSwept:
        """Settled extremes at each frequency, those of the case if none are given."""
        if omegas is None:
            omegas = np.linspace(self.omega_low, self.omega_high, self.n_omegas)
        rows = []
        for omega in omegas:
            record, last = self.measured(float(omega))
            rows.append(
                (
                    record.top_tension[last].max(),
                    record.least_tension[last].min(),
                    0.5 * np.ptp(record.payload_x[last]),
                    0.5 * np.ptp(record.payload_z[last]),
                )
            )
        return PlanarSwept(np.asarray(omegas, dtype=float), *np.array(rows).T)

    @property
    def static_tension(self) -> float:
        """Tension at the top at rest in still water [N]."""
        return self.payload.submerged_weight + self.cable.submerged_weight * self.length

    @property
    def swing_omega(self) -> float:
        """Natural frequency of the body as a point on a rigid massless cable [rad/s]."""
        return math.sqrt(self.payload.submerged_weight / (self.payload.lateral_inertia * self.length))

    def outcome(self) -> Outcome:
        """Runs it."""
        swept = self.sweep()
        peak, widest = int(np.argmax(swept.tension_max)), int(np.argmax(swept.sway_amplitude))
        slack = np.nonzero(swept.tension_min <= 0.0)[0]
        quantities = (
            Quantity("static_tension", self.static_tension, "N", "at the top, at rest in still water"),
            Quantity("swing_omega", self.swing_omega, "rad/s", "of the body on a rigid massless cable"),
            Quantity("tension_max", float(swept.tension_max[peak]), "N", "largest at the top"),
            Quantity("omega_at_tension_max", float(swept.omega[peak]), "rad/s", "where that is"),
            Quantity("sway_amplitude_max", float(swept.sway_amplitude[widest]), "m", "of the body"),
            Quantity("omega_at_sway_max", float(swept.omega[widest]), "rad/s", "where that is"),
            Quantity(
                "slack_from_omega",
                float(swept.omega[slack[0]]) if len(slack) else math.inf,
                "rad/s",
                "lowest frequency at which tension vanishes somewhere; inf: none",
            ),
        )
        table = {
            "omega [rad/s]": swept.omega,
            "tension_max [N]": swept.tension_max,
            "tension_min [N]": swept.tension_min,
            "sway_amplitude [m]": swept.sway_amplitude,
            "heave_amplitude [m]": swept.heave_amplitude,
        }

        def draw(figure: Any) -> None:
            axes = figure.subplots()
            axes.plot(swept.omega, swept.tension_max, color=COLOURS[1], label="largest, at the top")
            axes.plot(swept.omega, swept.tension_min, color=COLOURS[3], label="least, anywhere")
            axes.axhline(self.static_tension, color=INK, lw=0.8, ls="--", label="static")
            axes.set_xlabel("frequency of the top [rad/s]")
            axes.set_ylabel("tension [N]")
            axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)

        return Outcome(quantities=quantities, tables={"sweep": table}, pictures={"tension": draw})


# The thesis's examples ---------------------------------------------------------------------------


def deep_cable(diameter: float, modulus: float) -> Cable:
    """Cable of examples three to five: 5.2 kg/m, its buoyancy that of its section in sea water.

    Drag coefficients are not printed; 1.2 across and 0.01 along are those of the thesis's chapter 5.
    """
    section = circular_section(diameter)
    return Cable(
        mass_per_length=5.2,
        axial_stiffness=modulus * section,
        submerged_weight=GRAVITY * (5.2 - SEAWATER_DENSITY * section),
        diameter=diameter,
        normal_drag_coefficient=1.2,
        tangential_drag_coefficient=0.01,
    )


def deep_payload() -> Payload:
    """Unit of examples three to five; its drag area, 1.5 times 0.5 m², is that of chapter 5."""
    return Payload(mass=1900.0, added_mass=1600.0, submerged_weight=15_000.0, drag_area=0.75)


def example_three(speed: float, **changes: Any) -> PlanarOperation:
    """H 4.5.3: 300 m of cable in a uniform current [m/s], its top on a circle of 1 m at 1 rad/s."""
    operation = PlanarOperation(
        cable=deep_cable(0.02, 4.0e9),
        payload=deep_payload(),
        length=300.0,
        duration=500.0,
        current=Current.uniform(speed),
        heave_amplitude=-1.0,
        sway_amplitude=1.0,
        sway_phase=-0.5 * math.pi,
        growth=60.0,
        settling=400.0,
    )
    return replace(operation, **changes)


def example_four(speed: float, **changes: Any) -> PlanarOperation:
    """H 4.5.4: lowering from 200 m at a speed [m/s] while the top sways 5 m, at 0.2 rad/s."""
    operation = PlanarOperation(
        cable=deep_cable(0.047, 9.05e9),
        payload=deep_payload(),
        length=200.0,
        duration=600.0 / speed,
        current=Current.uniform(0.0),
        sway_amplitude=5.0,
        omega=0.2,
        pay_out_speed=(speed,),
        start_at_rest=False,
    )
    return replace(operation, **changes)


def example_five(speed: float, current: float = 0.0, **changes: Any) -> PlanarOperation:
    """H 4.5.5: lowering from 200 to 500 m at a speed [m/s], the top on P = sin t, Q = 1 - cos t."""
    operation = PlanarOperation(
        cable=deep_cable(0.02, 4.0e9),
        payload=deep_payload(),
        length=200.0,
        duration=300.0 / speed,
        current=Current.uniform(current),
        heave_amplitude=-1.0,
        sway_amplitude=1.0,
        sway_phase=-0.5 * math.pi,
        pay_out_speed=(speed,),
        start_at_rest=False,
    )
    return replace(operation, **changes)


def sphere_sweep(
    *,
    rope: str = "3 mm",
    water: bool,
    sway: float,
    heave: float,
    tension_only: bool = False,
    **changes: Any,
) -> PlanarSweep:
    """H 4.5.1 and 4.5.2: the wooden sphere on 4.573 m of polyester rope, in air or in the tank's water.

    Not printed and assumed: fresh water; added mass half the displaced water's; drag coefficients 0.5 of the
    sphere, 1.2 and 0.01 of the rope; air of 1.2 kg/m³ acts on the sphere alone; Kelvin damping of 5 ms.
    """
    suspension = thesis_polyester_3_mm() if rope == "3 mm" else thesis_polyester_2_mm()
    diameter, mass, stiffness = 0.2032, suspension.payload.mass, suspension.cable.axial_stiffness
    displaced = FRESH_WATER_DENSITY * math.pi * diameter**3 / 6.0
    drag_area = 0.5 * circular_section(diameter)
    cable = Cable(
        mass_per_length=suspension.cable.mass_per_length,
        axial_stiffness=stiffness,
        axial_damping=0.005 * stiffness,
        submerged_weight=GRAVITY
        * (
            suspension.cable.mass_per_length
            - FRESH_WATER_DENSITY * circular_section(suspension.cable.diameter)
        ),
        diameter=suspension.cable.diameter,
        tangential_drag_coefficient=0.01,
        tension_only=tension_only,
    )
    if water:
        payload = Payload(
            mass=mass,
            submerged_weight=GRAVITY * (mass - displaced),
            added_mass=0.5 * displaced,
            drag_area=drag_area * FRESH_WATER_DENSITY / SEAWATER_DENSITY,
        )
    else:
        cable = cable.in_air()
        payload = replace(
            Payload(mass=mass, submerged_weight=1.0).in_air(),
            drag_area=drag_area * AIR_DENSITY / SEAWATER_DENSITY,
        )
    sweep = PlanarSweep(
        cable=cable,
        payload=payload,
        length=suspension.length,
        current=Current(),
        sway_amplitude=sway,
        heave_amplitude=heave,
        omega_low=0.3,
        omega_high=4.0 if water else 6.0,
    )
    return replace(sweep, **changes)


@case("planar")
def thesis_circular_top() -> PlanarOperation:
    """Huang (1992) 4.5.3: 300 m of cable in a current of 0.5 m/s, its top on a circle of 1 m at 1 rad/s."""
    return example_three(0.5)


@case("planar")
def thesis_sway_while_lowering() -> PlanarOperation:
    """Huang (1992) 4.5.4: lowering from 200 m at 1 m/s while the boom tip sways 5 m at 0.2 rad/s."""
    return example_four(1.0)


@case("planar")
def thesis_planar_resonance() -> PlanarOperation:
    """Huang (1992) 4.5.5: lowering from 200 m at 1 m/s through resonance, the boom tip on a circle."""
    return example_five(1.0)


@case("planar")
def thesis_circling_sphere() -> PlanarSweep:
    """Huang (1992) 4.5.1: a sphere in water below a top on a circle of 0.15 m, by frequency, until slack."""
    return sphere_sweep(water=True, sway=0.15, heave=0.15, tension_only=True)


@case("planar")
def lowering_in_current() -> PlanarOperation:
    """A manifold lowered from 100 to 700 m in a sheared current, the boom tip heaving and swaying."""
    stiffness = 6.0e7
    return PlanarOperation(
        cable=Cable(
            mass_per_length=11.0,
            axial_stiffness=stiffness,
            axial_damping=0.005 * stiffness,
            submerged_weight=90.0,
            diameter=0.052,
            tangential_drag_coefficient=0.01,
            tension_only=True,
            breaking_strength=2.2e6,
        ),
        payload=Payload(
            mass=20_000.0,
            added_mass=18_000.0,
            submerged_weight=170_000.0,
            drag_area=25.0,
            lateral_added_mass=8_000.0,
            lateral_drag_area=12.0,
        ),
        length=100.0,
        duration=700.0,
        current=Current(
            depth=(0.0, 50.0, 200.0, 600.0),
            speed=(0.9, 0.7, 0.4, 0.15),
            direction=(0.0, 0.0, 0.0, 0.0),
        ),
        heave_amplitude=0.8,
        sway_amplitude=0.5,
        sway_phase=0.5 * math.pi,
        omega=0.7,
        growth=30.0,
        pay_out_time=(30.0, 40.0, 630.0, 640.0),
        pay_out_speed=(0.0, 1.0, 1.0, 0.0),
    )
