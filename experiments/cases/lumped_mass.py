"""Cases of the 3-D line: a payload that hangs, is towed round a loop or lowered in currents, and moorings.

The system of the thesis's chapter 5 stands here once, for its figures, the validation and the benchmark too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.cases.axial import paid_out
from experiments.cases.case import Outcome, Quantity, case
from experiments.figures import COLOURS
from heave_env.cable.lumped_mass import BODY_DRAGS, LineRecord, LineState, LumpedMassSolver
from heave_env.parameters import (
    GRAVITY,
    SEAWATER_DENSITY,
    Attachment,
    Cable,
    Current,
    Line,
    Payload,
    Section,
    require,
    require_integer,
    require_number,
)
from heave_env.scenarios import circular_section

Array = np.ndarray

SHAPES = 6
"""Shapes of the line that a picture shows [-]."""
STORED = 4000
"""About how many instants a march keeps at most [-]."""


def thesis_cable() -> Cable:
    """The cable of H 5.7; its weight in water is that of its section, as the thesis computes it."""
    section = circular_section(0.047)
    return Cable(
        mass_per_length=5.4,
        axial_stiffness=9e9 * section,
        submerged_weight=(5.4 - SEAWATER_DENSITY * section) * GRAVITY,
        diameter=0.047,
        tangential_drag_coefficient=0.01,
        normal_drag_coefficient=1.2,
    )


def thesis_payload() -> Payload:
    """The subsea unit of H 5.7: 3000 + 3000 kg, 0.354 m³, C_d 1.5 on 0.5 m² in every direction."""
    return Payload(
        mass=3000.0,
        added_mass=3000.0,
        submerged_weight=(3000.0 - SEAWATER_DENSITY * 0.354) * GRAVITY,
        drag_area=0.75,
    )


def loop_path(time: Array, speed: float, approach: float = 800.0, radius: float = 150.0) -> Array:
    """A towpoint that goes straight along x, once round a circle to the left, and straight on.

    Args:
        time: Instants [s], (n_times,).
        speed: Of the towpoint, constant [m/s].
        approach: Where the circle begins, by x [m].
        radius: Of the circle [m].

    Returns:
        Positions [m], (n_times, 3), z = 0.
    """
    gone = speed * time
    angle = np.clip((gone - approach) / radius, 0.0, 2.0 * math.pi)
    beyond = np.maximum(gone - approach - 2.0 * math.pi * radius, 0.0)
    x = np.minimum(gone, approach) + radius * np.sin(angle) + beyond
    return np.stack([x, radius * (1.0 - np.cos(angle)), 0.0 * time], axis=1)


def oscillation(
    time: Array, amplitude: tuple[float, ...], phase: tuple[float, ...], omega: float, growth: float
) -> Array:
    """A sin(ωt + φ) along x, y and z, grown over `growth` without a jump of speed, (n_times, 3)."""
    share = np.minimum(time / growth, 1.0) if growth > 0.0 else np.ones_like(time)
    grown = share * share * (3.0 - 2.0 * share)
    around = omega * time[:, None] + np.array(phase)
    return np.asarray(grown[:, None] * np.array(amplitude) * np.sin(around))


def _require_three(owner: object, *names: str) -> None:
    for name in names:
        value = getattr(owner, name)
        ok = len(value) == 3 and all(math.isfinite(number) for number in value)
        require(ok, owner, name, "three finite numbers, along x, y and z")


def _kept(n_steps: int) -> int:
    """Steps from one kept instant to the next."""
    return max(1, n_steps // STORED)


# A payload on a line -----------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class HangingLine:
    """A payload on a line below a vessel that oscillates, tows it on a straight or a loop, and pays out."""

    line: Line
    """The line, the lowest section first."""
    payload: Payload
    """The body at its lower end."""
    current: Current
    """The current."""
    duration: float
    """How long the run lasts [s]."""
    dt: float = 0.05
    """Time step [s]."""
    n_segments: int = 40
    """Segments of the line [-]."""
    body_drag: str = "components"
    """Drag of bodies: components (horizontal and vertical each on its own), axes (x, y and z each on its
    own) or vector (along the relative velocity)."""
    motion_amplitude: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Amplitudes of the upper end's oscillation along x, y and z [m]."""
    motion_phase: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Their phases φ in A sin(ωt + φ) [rad]."""
    motion_omega: float = 0.6
    """Angular frequency ω of the oscillation [rad/s]."""
    motion_growth: float = 0.0
    """How long it takes to grow from zero [s]."""
    tow_speed: float = 0.0
    """Speed of the vessel, first along x [m/s]."""
    loop_start: float = 800.0
    """Where, by x, it turns into a full circle to the left [m]; not looked at without speed or radius."""
    loop_radius: float = 0.0
    """Radius of that circle; zero: it goes straight on [m]."""
    pay_out_time: tuple[float, ...] = (0.0,)
    """Instants of the pay-out profile's knots, not decreasing; two equal ones are a jump [s]."""
    pay_out_speed: tuple[float, ...] = (0.0,)
    """Pay-out rate at each knot, positive outwards, negative for recovery, linear between [m/s]."""
    start_at_rest: bool = True
    """Whether it begins at rest in the current; false: unstrained and straight down, as in the thesis."""
    settling: float = 0.0
    """How long at the start counts for no quantity: transients [s]."""

    def __post_init__(self) -> None:
        for name in ("duration", "dt", "motion_omega"):
            require_number(self, name, positive=True)
        for name in ("motion_growth", "loop_radius", "settling", "tow_speed"):
            require_number(self, name, non_negative=True)
        require_number(self, "loop_start")
        require_integer(self, "n_segments", minimum=1)
        require(self.body_drag in BODY_DRAGS, self, "body_drag", f"one of {', '.join(BODY_DRAGS)}")
        require(self.dt <= self.duration, self, "dt", f"at most the duration, {self.duration:g} s")
        require(self.settling < self.duration, self, "settling", f"below the duration, {self.duration:g} s")
        _require_three(self, "motion_amplitude", "motion_phase")
        knots = len(self.pay_out_time)
        require(len(self.pay_out_speed) == knots, self, "pay_out_speed", f"{knots} numbers, one per knot")

    @property
    def solver(self) -> LumpedMassSolver:
        """The solver that it runs."""
        return LumpedMassSolver(
            line=self.line,
            n_segments=self.n_segments,
            payload=self.payload,
            current=self.current,
            body_drag=self.body_drag,
        )

    @property
    def time(self) -> Array:
        """Instants of the run [s], (n_steps + 1,)."""
        return self.dt * np.arange(round(self.duration / self.dt) + 1)

    def top(self) -> Array:
        """Positions of the upper end at every instant [m], (n_steps + 1, 3)."""
        time = self.time
        if self.loop_radius > 0.0:
            path = loop_path(time, self.tow_speed, self.loop_start, self.loop_radius)
        else:
            path = np.stack([self.tow_speed * time, 0.0 * time, 0.0 * time], axis=1)
        swing = oscillation(
            time, self.motion_amplitude, self.motion_phase, self.motion_omega, self.motion_growth
        )
        return path + swing

    def length(self) -> Array:
        """Unstretched length at every instant [m], (n_steps + 1,)."""
        return self.line.length + paid_out(self.time, self.pay_out_time, self.pay_out_speed)

    def start(self) -> LineState:
        """The state that it begins with."""
        solver, where = self.solver, self.top()[0]
        if self.start_at_rest:
            return solver.rest(where)
        arcs = solver.node_arc_lengths
        return solver.placed(where + np.stack([0.0 * arcs, 0.0 * arcs, arcs - self.line.length], axis=1))

    def record(self) -> LineRecord:
        """The march."""
        length = self.length()
        return self.solver.simulate(
            self.top(),
            dt=self.dt,
            length=length if np.ptp(length) > 0.0 else None,
            start=self.start(),
            every=_kept(len(length) - 1),
        )

    def outcome(self) -> Outcome:
        """Runs it."""
        record = self.record()
        top = self.top()[:: _kept(len(self.time) - 1)][: len(record.time)]
        counted = record.time >= self.settling
        where = record.payload_position[counted]
        away = np.linalg.norm((record.payload_position - top)[counted, :2], axis=1)
        # The line weighs what it weighs at each length.
        extra = (record.length - self.line.length) * self.line.sections[-1].cable.submerged_weight
        static = self.payload.submerged_weight + self.line.submerged_weight + extra
        tension, greatest = record.top_tension[counted], record.greatest_tension[counted]
        angle = np.arccos(np.clip(record.top_force[:, 2] / np.maximum(record.top_tension, 1e-9), -1.0, 1.0))
        quantities = [
            Quantity("final_length", float(record.length[-1]), "m", "unstretched length at the end"),
            Quantity("payload_x_mean", float(where[:, 0].mean()), "m", "mean of x"),
            Quantity("payload_y_mean", float(where[:, 1].mean()), "m", "mean of y"),
            Quantity("payload_depth_mean", float(-where[:, 2].mean()), "m", "mean depth below the surface"),
            Quantity("payload_depth_final", float(-where[-1, 2]), "m", "depth at the end"),
            Quantity("payload_excursion_x", 0.5 * float(np.ptp(where[:, 0])), "m", "half the range of x"),
            Quantity("payload_excursion_y", 0.5 * float(np.ptp(where[:, 1])), "m", "half the range of y"),
            Quantity("payload_excursion_z", 0.5 * float(np.ptp(where[:, 2])), "m", "half the range of z"),
            Quantity("offset_max", float(away.max()), "m", "largest horizontal distance from the upper end"),
            *_tensions(tension, greatest, record.least_tension[counted]),
            Quantity(
                "dynamic_factor",
                float((tension / static[counted]).max()),
                "-",
                "largest top tension over the weights at the same length",
            ),
            Quantity("top_angle_max", float(angle[counted].max()), "rad", "of the line from the vertical"),
        ]
        _add_safety(quantities, self.line, float(greatest.max()))
        return Outcome(
            quantities=tuple(quantities),
            tables={"history": _history(record, top), "final_shape": _shape(record.end)},
            pictures={
                "path": lambda figure: draw_path(figure, record, top),
                "shapes": lambda figure: draw_shapes(figure, record),
                "tension": lambda figure: draw_tension(figure, record, static),
            },
        )


# A line between two points -----------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class MooringLine:
    """A line from an anchor to a vessel that oscillates: slack, taut or with floats; there is no seabed."""

    line: Line
    """The line, the section at the anchor first."""
    anchor: tuple[float, ...]
    """Position of the lower end [m]."""
    fairlead: tuple[float, ...]
    """Mean position of the upper end [m]."""
    current: Current
    """The current."""
    duration: float
    """How long the run lasts [s]."""
    dt: float = 0.02
    """Time step [s]."""
    n_segments: int = 60
    """Segments of the line [-]."""
    motion_amplitude: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Amplitudes of the upper end's oscillation along x, y and z [m]."""
    motion_phase: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Their phases φ in A sin(ωt + φ) [rad]."""
    motion_omega: float = 0.6
    """Angular frequency ω of the oscillation [rad/s]."""
    motion_growth: float = 20.0
    """How long it takes to grow from zero [s]."""
    settling: float = 0.0
    """How long at the start counts for no quantity: transients [s]."""

    def __post_init__(self) -> None:
        for name in ("duration", "dt", "motion_omega"):
            require_number(self, name, positive=True)
        for name in ("motion_growth", "settling"):
            require_number(self, name, non_negative=True)
        require_integer(self, "n_segments", minimum=1)
        require(self.dt <= self.duration, self, "dt", f"at most the duration, {self.duration:g} s")
        require(self.settling < self.duration, self, "settling", f"below the duration, {self.duration:g} s")
        _require_three(self, "anchor", "fairlead", "motion_amplitude", "motion_phase")

    @property
    def solver(self) -> LumpedMassSolver:
        """The solver that it runs."""
        return LumpedMassSolver(
            line=self.line, n_segments=self.n_segments, current=self.current, lower="fixed"
        )

    def record(self) -> tuple[LineState, LineRecord]:
        """The static shape, and the march from it."""
        solver = self.solver
        time = self.dt * np.arange(round(self.duration / self.dt) + 1)
        top = np.array(self.fairlead) + oscillation(
            time, self.motion_amplitude, self.motion_phase, self.motion_omega, self.motion_growth
        )
        anchor = np.array(self.anchor)
        still = solver.rest(top[0], anchor)
        return still, solver.simulate(top, bottom=anchor, dt=self.dt, start=still, every=_kept(len(time) - 1))

    def outcome(self) -> Outcome:
        """Runs it."""
        still, record = self.record()
        counted = record.time >= self.settling
        greatest, least = record.greatest_tension[counted], record.least_tension[counted]
        pretension = self.solver.top_tension(still)
        quantities = [
            Quantity("pretension", pretension, "N", "static tension at the fairlead"),
            Quantity(
                "pretension_horizontal", float(np.hypot(*still.top_force[:2])), "N", "its horizontal part"
            ),
            Quantity("anchor_uplift", float(still.bottom_force[2]), "N", "static upward force on the anchor"),
            *_tensions(record.top_tension[counted], greatest, least),
            Quantity(
                "dynamic_factor",
                float(record.top_tension[counted].max()) / pretension,
                "-",
                "largest top tension over the static one",
            ),
            Quantity(
                "anchor_tension_max", float(record.payload_tension[counted].max()), "N", "at the anchor"
            ),
            Quantity("slack_fraction", float(np.mean(least <= 0.0)), "-", "of the time with slack anywhere"),
            Quantity("lowest_point", float(record.positions[counted][:, :, 2].min()), "m", "lowest height"),
        ]
        _add_safety(quantities, self.line, float(greatest.max()))
        return Outcome(
            quantities=tuple(quantities),
            tables={"history": _history(record, record.positions[:, -1]), "final_shape": _shape(record.end)},
            pictures={
                "shapes": lambda figure: draw_shapes(figure, record),
                "tension": lambda figure: draw_tension(figure, record, np.full(len(record.time), pretension)),
            },
        )


# What both print and draw ------------------------------------------------------------------------


def _tensions(top: Array, greatest: Array, least: Array) -> list[Quantity]:
    return [
        Quantity("top_tension_mean", float(top.mean()), "N", "at the upper end"),
        Quantity("top_tension_max", float(top.max()), "N", "at the upper end"),
        Quantity("top_tension_min", float(top.min()), "N", "at the upper end"),
        Quantity("tension_max", float(greatest.max()), "N", "anywhere"),
        Quantity("tension_min", float(least.min()), "N", "anywhere; below zero is compression"),
    ]


def _add_safety(quantities: list[Quantity], line: Line, greatest: float) -> None:
    strengths = [section.cable.breaking_strength for section in line.sections]
    known = [strength for strength in strengths if strength is not None]
    if known:
        safety = min(known) / greatest
        quantities.append(Quantity("safety_factor", safety, "-", "least strength over largest tension"))


def _history(record: LineRecord, top: Array) -> dict[str, Array]:
    columns = {"time [s]": record.time, "length [m]": record.length}
    for k, axis in enumerate("xyz"):
        columns[f"top_{axis} [m]"] = top[:, k]
    for k, axis in enumerate("xyz"):
        columns[f"lower_end_{axis} [m]"] = record.payload_position[:, k]
    columns["top_tension [N]"] = record.top_tension
    columns["lower_tension [N]"] = record.payload_tension
    columns["tension_min [N]"] = record.least_tension
    columns["tension_max [N]"] = record.greatest_tension
    return columns


def _shape(state: LineState) -> dict[str, Array]:
    columns = {"arc_length [m]": state.arc_lengths}
    for k, axis in enumerate("xyz"):
        columns[f"{axis} [m]"] = state.positions[:, k]
    return columns


def draw_path(figure: Any, record: LineRecord, top: Array) -> None:
    """Paths of the payload and of the upper end from above, and the payload's depth."""
    plan, depth = figure.subplots(2, 1, height_ratios=(1.5, 1.0))
    plan.plot(top[:, 0], top[:, 1], color=COLOURS[0], label="upper end")
    x = record.payload_position
    plan.plot(x[:, 0], x[:, 1], color=COLOURS[1], lw=1.0, label="payload")
    plan.plot(x[-1, 0], x[-1, 1], "o", color=COLOURS[1], ms=4)
    plan.set_xlabel("x [m]")
    plan.set_ylabel("y [m]")
    plan.set_aspect("equal", adjustable="datalim")
    plan.legend(loc="best")
    depth.plot(record.time, x[:, 2], color=COLOURS[3])
    depth.set_xlabel("time [s]")
    depth.set_ylabel("payload z [m]")


def _instants(record: LineRecord) -> Array:
    return np.unique(np.linspace(0, len(record.time) - 1, SHAPES).astype(int))


def draw_shapes(figure: Any, record: LineRecord) -> None:
    """The line at some instants, seen along y and along x; scales across and down differ."""
    by_x, by_y = figure.subplots(1, 2, sharey=True)
    for k, instant in enumerate(_instants(record)):
        colour = COLOURS[1 + k % (len(COLOURS) - 1)]
        r = record.positions[instant]
        by_x.plot(r[:, 0], r[:, 2], color=colour, label=f"{record.time[instant]:.0f} s")
        by_y.plot(r[:, 1], r[:, 2], color=colour)
        by_x.plot(r[0, 0], r[0, 2], "o", color=colour, ms=4)
        by_y.plot(r[0, 1], r[0, 2], "o", color=colour, ms=4)
    by_x.set_xlabel("x [m]")
    by_y.set_xlabel("y [m]")
    by_x.set_ylabel("z [m]")
    figure.legend(loc="outside upper center", ncols=SHAPES)


def draw_tension(figure: Any, record: LineRecord, static: Array) -> None:
    """Tension at the upper end, the least along the line, and the static one."""
    axes = figure.subplots()
    axes.plot(record.time, 1e-3 * record.top_tension, color=COLOURS[1], lw=0.8, label="upper end")
    axes.plot(record.time, 1e-3 * record.least_tension, color=COLOURS[3], lw=0.8, label="least on the line")
    axes.plot(record.time, 1e-3 * static, color="#30353d", lw=1.0, ls="--", label="static")
    axes.set_xlim(float(record.time[0]), float(record.time[-1]))
    axes.set_xlabel("time [s]")
    axes.set_ylabel("tension [kN]")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)


# The cases ---------------------------------------------------------------------------------------


@case("lumped_mass")
def thesis_current() -> HangingLine:
    """H 5.7.2: surge, sway and heave of 1 m at 0.314 rad/s in a current of 0.5 m/s, from unstrained."""
    return HangingLine(
        line=Line.uniform(thesis_cable(), 300.0),
        payload=thesis_payload(),
        current=Current.uniform(0.5),
        duration=200.0,
        body_drag="axes",
        motion_amplitude=(1.0, 1.0, 1.0),
        motion_omega=0.314,
        start_at_rest=False,
        settling=100.0,
    )


@case("lumped_mass")
def loop_turn() -> HangingLine:
    """H 5.7.4: towed at 4 m/s for 800 m, once round a circle of 150 m radius, and straight on."""
    return HangingLine(
        line=Line.uniform(thesis_cable(), 300.0),
        payload=thesis_payload(),
        current=Current(),
        duration=600.0,
        n_segments=20,
        body_drag="axes",
        tow_speed=4.0,
        loop_radius=150.0,
        start_at_rest=False,
        settling=100.0,
    )


@case("lumped_mass")
def lowering_in_three_dimensions() -> HangingLine:
    """A 30 t template lowered from 100 to 500 m in a current that turns with depth, vessel in swell."""
    return HangingLine(
        line=Line.uniform(
            Cable(
                mass_per_length=12.0,
                axial_stiffness=1.6e8,
                submerged_weight=100.0,
                diameter=0.056,
                tangential_drag_coefficient=0.01,
                axial_damping=8e5,
                tension_only=True,
                breaking_strength=2.5e6,
            ),
            100.0,
        ),
        payload=Payload(
            mass=30_000.0,
            submerged_weight=255_000.0,
            added_mass=45_000.0,
            drag_area=40.0,
            lateral_added_mass=12_000.0,
            lateral_drag_area=15.0,
        ),
        current=Current(
            depth=(0.0, 100.0, 300.0, 600.0), speed=(0.9, 0.7, 0.4, 0.2), direction=(0.0, 0.2, 0.9, 1.6)
        ),
        duration=560.0,
        n_segments=20,
        motion_amplitude=(0.8, 0.5, 1.2),
        motion_phase=(0.5 * math.pi, 0.0, 0.0),
        motion_omega=2.0 * math.pi / 10.0,
        motion_growth=30.0,
        pay_out_time=(60.0, 80.0, 460.0, 480.0),
        pay_out_speed=(0.0, 1.0, 1.0, 0.0),
        settling=40.0,
    )


def _wire() -> Cable:
    return Cable(
        mass_per_length=20.0,
        axial_stiffness=2.0e8,
        submerged_weight=165.0,
        diameter=0.07,
        tangential_drag_coefficient=0.02,
        axial_damping=1.0e6,
        tension_only=True,
        breaking_strength=4.0e6,
    )


@case("lumped_mass")
def slack_mooring() -> MooringLine:
    """A slack wire between anchor and vessel in 150 m of water whose surge snaps it taut."""
    return MooringLine(
        line=Line.uniform(_wire(), 324.0),
        anchor=(0.0, 0.0, -150.0),
        fairlead=(285.0, 0.0, -5.0),
        current=Current(depth=(0.0, 150.0), speed=(0.8, 0.3), direction=(1.2, 1.2)),
        duration=120.0,
        motion_amplitude=(5.0, 0.0, 2.0),
        motion_phase=(0.0, 0.0, 1.0),
        motion_omega=2.0 * math.pi / 9.0,
        settling=30.0,
    )


@case("lumped_mass")
def lazy_wave() -> MooringLine:
    """Wire and buoyant rope with a float and a clump weight, from anchor to vessel, in a current."""
    rope = Cable(
        mass_per_length=9.0,
        axial_stiffness=3.0e7,
        submerged_weight=-25.0,
        diameter=0.12,
        tangential_drag_coefficient=0.02,
        axial_damping=3.0e5,
        tension_only=True,
        breaking_strength=2.0e6,
    )
    float_ = Payload(mass=800.0, submerged_weight=-14_000.0, added_mass=1000.0, drag_area=2.0)
    clump = Payload(mass=1500.0, submerged_weight=12_800.0, added_mass=400.0, drag_area=0.8)
    return MooringLine(
        line=Line(
            sections=(Section(cable=_wire(), length=80.0), Section(cable=rope, length=160.0)),
            attachments=(
                Attachment(arc_length=80.0, body=float_),
                Attachment(arc_length=180.0, body=clump),
            ),
        ),
        anchor=(0.0, 0.0, -120.0),
        fairlead=(150.0, 0.0, -5.0),
        current=Current.uniform(0.6, direction=1.0),
        duration=120.0,
        motion_amplitude=(2.0, 1.0, 1.5),
        motion_phase=(0.0, 1.0, 0.5 * math.pi),
        motion_omega=2.0 * math.pi / 11.0,
        settling=40.0,
    )
