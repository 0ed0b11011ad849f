"""Cases of the sagged span: wires and hawsers between two supports that move.

Moustafa's tests stand here once, for his figures and the validation too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from experiments.cases.case import Outcome, Quantity, case
from experiments.figures import COLOURS
from heave_env.cable.sagged_span import SaggedSpanSolver, SpanRecord
from heave_env.parameters import (
    GRAVITY,
    SEAWATER_DENSITY,
    Cable,
    Current,
    require,
    require_integer,
    require_number,
)
from heave_env.scenarios import circular_section

Array = np.ndarray
DARK = "#30353d"


@dataclass(frozen=True, kw_only=True)
class DrivenSpan:
    """A cable between two supports, one or both of which move sinusoidally until the motion is steady."""

    cable: Cable
    """The cable; one that may go slack wants tension_only and some axial_damping."""
    length: float
    """Unstretched length [m]."""
    span: float
    """Horizontal distance of the supports [m]."""
    height: float = 0.0
    """Upper above lower support [m]."""
    frequency: float
    """Frequency of the motion [Hz]."""
    upper_amplitude: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Amplitude of the upper support along the span, across it and upwards [m]."""
    lower_amplitude: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Amplitude of the lower support along the span, across it and upwards [m]."""
    lower_phase: float = 0.0
    """By how much the lower support's motion leads the upper's [rad]."""
    periods: float = 12.0
    """How many periods to run [-]."""
    growing_periods: float = 3.0
    """Over how many of them the motion grows, for a sudden start would strike the cable [-]."""
    steady_periods: float = 5.0
    """How many of the last ones count for the extremes [-]."""
    steps_per_period: int = 200
    """Time steps in each [-]."""
    n_elements: int = 50
    """Elements of the cable, an even number [-]."""
    current: Current = field(default_factory=Current)
    """Current, x along the span; the cable begins from its shape in still water, so let the factor rise."""
    lower_depth: float = 0.0
    """Depth of the lower support, for the current's profile [m]."""
    strain: str = "engineering"
    """Law of strain: engineering, the cable's own, or moustafa, the quadratic one of the source."""

    def __post_init__(self) -> None:
        require_number(self, "frequency", positive=True)
        require_number(self, "lower_phase")
        for name in ("upper_amplitude", "lower_amplitude"):
            values = getattr(self, name)
            ok = len(values) == 3 and all(math.isfinite(value) for value in values)
            require(ok, self, name, "three finite numbers: along the span, across it, upwards")
        for name in ("periods", "growing_periods", "steady_periods"):
            require_number(self, name, positive=True)
        room = self.growing_periods + self.steady_periods
        require(self.periods >= room, self, "periods", f"at least the growing and steady ones, {room:g}")
        require_integer(self, "steps_per_period", minimum=20)

    @property
    def dt(self) -> float:
        """Time step [s]."""
        return 1.0 / (self.frequency * self.steps_per_period)

    @property
    def time(self) -> Array:
        """Instants of the run [s], (n_steps + 1,)."""
        return self.dt * np.arange(round(self.periods * self.steps_per_period) + 1)

    @property
    def steady(self) -> Array:
        """Which instants count for the extremes, (n_steps + 1,) bool."""
        return self.time > (self.periods - self.steady_periods) / self.frequency

    def solver(self) -> SaggedSpanSolver:
        """The span.

        Raises:
            ValueError: If no such cable can hang between such supports.
        """
        return SaggedSpanSolver(
            cable=self.cable,
            length=self.length,
            span=self.span,
            height=self.height,
            n_elements=self.n_elements,
            current=self.current,
            lower_depth=self.lower_depth,
            strain=self.strain,
        )

    def record(self, solver: SaggedSpanSolver, *, shape_every: int = 0) -> SpanRecord:
        """Runs it; the shapes are kept at every so many steps, if any."""
        time, omega = self.time, 2.0 * math.pi * self.frequency
        growth = np.sin(0.5 * np.pi * np.minimum(time * self.frequency / self.growing_periods, 1.0)) ** 2
        upper = np.outer(growth * np.sin(omega * time), self.upper_amplitude)
        lower = np.outer(growth * np.sin(omega * time + self.lower_phase), self.lower_amplitude)
        return solver.simulate(lower, upper, dt=self.dt, shape_every=shape_every)

    def extremes(self) -> tuple[float, float]:
        """Largest and least tension at the upper support in the steady state [N]."""
        tension = self.record(self.solver()).upper_tension[self.steady]
        return float(tension.max()), float(tension.min())

    def outcome(self) -> Outcome:
        """Runs it.

        Raises:
            ValueError: If the parameters are impossible together.
            ConvergenceError: If a step does not settle.
        """
        solver = self.solver()
        record = self.record(solver, shape_every=self.steps_per_period // 20)
        steady = self.steady
        static = solver.catenary.tension(np.array([0.0, self.length]))
        largest, least = float(record.tension_max[steady].max()), float(record.tension_min[steady].min())
        middle = record.midpoint_displacement[steady]
        omegas, _ = solver.modes(1)
        quantities = [
            Quantity("sag", solver.catenary.sag, "m", "below the chord, at rest"),
            Quantity("horizontal_force", solver.catenary.horizontal_force, "N", "at rest"),
            Quantity("static_upper_tension", float(static[1]), "N", "at the upper support"),
            Quantity("static_lower_tension", float(static[0]), "N", "at the lower support"),
            Quantity("natural_frequency", float(omegas[0]) / (2.0 * math.pi), "Hz", "lowest, small motion"),
            Quantity("largest_upper_tension", float(record.upper_tension[steady].max()), "N", "steady state"),
            Quantity("least_upper_tension", float(record.upper_tension[steady].min()), "N", "steady state"),
            Quantity("largest_tension", largest, "N", "anywhere along the cable"),
            Quantity("least_tension", least, "N", "anywhere along the cable"),
            Quantity("amplification", largest / float(static.max()), "-", "largest over static tension"),
            Quantity(
                "slack_time", float(np.mean(record.slack_fraction[steady] > 0.0)), "-", "with slack somewhere"
            ),
            Quantity("midpoint_range", float(np.ptp(middle[:, 2])), "m", "of the middle's height"),
        ]
        if self.cable.breaking_strength is not None:
            safety = self.cable.breaking_strength / largest
            quantities.append(
                Quantity("safety_factor", safety, "-", "breaking strength over largest tension")
            )
        return Outcome(
            quantities=tuple(quantities),
            tables={
                "time_series": {
                    "time [s]": record.time,
                    "lower_tension [N]": record.lower_tension,
                    "upper_tension [N]": record.upper_tension,
                    "slack_fraction [-]": record.slack_fraction,
                    "midpoint_x [m]": record.midpoint_displacement[:, 0],
                    "midpoint_y [m]": record.midpoint_displacement[:, 1],
                    "midpoint_z [m]": record.midpoint_displacement[:, 2],
                },
                "static_shape": {
                    "arc_length [m]": solver.arc_length,
                    "x [m]": solver.rest_position[:, 0],
                    "z [m]": solver.rest_position[:, 2],
                    "tension [N]": solver.catenary.tension(solver.arc_length),
                },
            },
            pictures={
                "tension": lambda figure: draw_tension(figure, record, float(static[1])),
                "middle": lambda figure: draw_middle(figure, record, steady),
                "shapes": lambda figure: draw_shapes(
                    figure, solver, record, self.steady_periods, self.frequency
                ),
            },
        )


def draw_tension(figure: Any, record: SpanRecord, static: float) -> None:
    """Tension at both supports over time."""
    axes = figure.subplots()
    axes.plot(record.time, record.upper_tension, color=COLOURS[3], label="upper support")
    axes.plot(record.time, record.lower_tension, color=COLOURS[2], ls="--", lw=1.0, label="lower support")
    axes.axhline(static, color=DARK, lw=0.8, ls=":", label="at rest, upper support")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("tension [N]")
    axes.set_xlim(0.0, record.time[-1])
    figure.legend(loc="outside upper center", ncols=3)


def draw_middle(figure: Any, record: SpanRecord, which: Array) -> None:
    """Height, vertical velocity and acceleration of the span's middle over the chosen instants."""
    rows = figure.subplots(3, sharex=True)
    time = record.time[which]
    for axes, values, label, colour in zip(
        rows,
        (record.midpoint_displacement, record.midpoint_velocity, record.midpoint_acceleration),
        ("height [m]", "velocity\n[m/s]", "acceleration\n[m/s²]"),
        (COLOURS[3], COLOURS[4], COLOURS[1]),
        strict=True,
    ):
        axes.plot(time, values[which, 2], color=colour)
        axes.set_ylabel(label)
        axes.set_xlim(time[0], time[-1])
    rows[-1].set_xlabel("time [s]")
    figure.align_ylabels()


def draw_shapes(
    figure: Any, solver: SaggedSpanSolver, record: SpanRecord, steady_periods: float, frequency: float
) -> None:
    """Shapes of the last period over the shape at rest, seen from the side."""
    axes = figure.subplots()
    last = record.shape_time > record.time[-1] - min(1.0, steady_periods) / frequency
    for k, shape in enumerate(record.shapes[last]):
        label = "in the last period" if k == 0 else None
        axes.plot(shape[:, 0], shape[:, 2], color=COLOURS[3], lw=0.7, alpha=0.7, label=label)
    axes.plot(
        solver.rest_position[:, 0], solver.rest_position[:, 2], color=DARK, ls="--", lw=1.4, label="at rest"
    )
    axes.set_xlabel("along the span [m]")
    axes.set_ylabel("height above the lower support [m]")
    axes.legend()


def moustafa_cable(modulus: float = 1e11) -> Cable:
    """The wire of Moustafa's tests in water, for a Young's modulus [Pa].

    Drag coefficients are assumed, and 1 ms of Kelvin damping for what goes slack; E is printed as 10E11.
    """
    section = circular_section(0.01)
    return Cable(
        mass_per_length=0.61,
        axial_stiffness=modulus * section,
        submerged_weight=(0.61 - SEAWATER_DENSITY * section) * GRAVITY,
        diameter=0.01,
        tangential_drag_coefficient=0.01,
        axial_damping=1e-3 * modulus * section,
        tension_only=True,
    )


@case("sagged_span")
def moustafa_span() -> DrivenSpan:
    """Moustafa's test span in water, 10.8 m with a sag of 8 %, one end moved horizontally by 0.05 m at
    0.75 Hz: mild, the tension swings evenly.
    """
    return DrivenSpan(
        cable=moustafa_cable(),
        length=10.9774,
        span=10.792,
        frequency=0.75,
        upper_amplitude=(0.05, 0.0, 0.0),
    )


@case("sagged_span")
def moustafa_span_severe() -> DrivenSpan:
    """The same span moved by 0.1 m at 1.2 Hz: it goes slack and snaps taut to five times its static
    tension."""
    return DrivenSpan(
        cable=moustafa_cable(),
        length=10.9774,
        span=10.792,
        frequency=1.2,
        upper_amplitude=(0.1, 0.0, 0.0),
    )


@case("sagged_span")
def mooring_hawser() -> DrivenSpan:
    """A 64 mm polyester hawser in air from a quay's bollard up to a ship that surges and heaves in a swell of
    10 s. Stiffness is 10 % stretch at the breaking strength.
    """
    strength = 780e3
    return DrivenSpan(
        cable=Cable(
            mass_per_length=3.0,
            axial_stiffness=10.0 * strength,
            submerged_weight=3.0 * GRAVITY,
            diameter=0.064,
            normal_drag_coefficient=0.0,
            normal_added_mass_coefficient=0.0,
            axial_damping=0.02 * 10.0 * strength,
            tension_only=True,
            breaking_strength=strength,
        ),
        length=30.5,
        span=30.0,
        height=4.0,
        frequency=0.1,
        upper_amplitude=(0.25, 0.0, 0.3),
        steps_per_period=1000,
    )


@case("sagged_span")
def towing_wire() -> DrivenSpan:
    """A 48 mm steel wire of 400 m between tug and tow at 2 m/s, both surging and heaving, the tow a quarter
    period behind; the water's flow rises over the first two minutes.
    """
    section = circular_section(0.048)
    stiffness = 0.6 * section * 1.1e11
    return DrivenSpan(
        cable=Cable(
            mass_per_length=9.6,
            axial_stiffness=stiffness,
            submerged_weight=(9.6 - SEAWATER_DENSITY * 0.6 * section) * GRAVITY,
            diameter=0.048,
            tangential_drag_coefficient=0.01,
            axial_damping=0.005 * stiffness,
            tension_only=True,
            breaking_strength=1.6e6,
        ),
        length=402.0,
        span=400.0,
        frequency=0.1,
        upper_amplitude=(0.6, 0.0, 1.0),
        lower_amplitude=(0.4, 0.0, 0.6),
        lower_phase=-0.5 * math.pi,
        periods=30.0,
        growing_periods=6.0,
        current=Current(speed=(2.0,), direction=(math.pi,), time=(0.0, 120.0), factor=(0.0, 1.0)),
    )
