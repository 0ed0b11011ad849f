"""Cases of the static line: a submerged span, a tow, a mooring, the footprint of a thrust-limited unit."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from experiments.cases.case import Outcome, Quantity, case
from experiments.figures import COLOURS
from heave_env.cable.statics import (
    Ends,
    FixedEnds,
    Footprint,
    FootprintSolver,
    Moored,
    StaticShape,
    StaticsSolver,
    Towed,
)
from heave_env.parameters import (
    Attachment,
    Cable,
    Current,
    Line,
    Payload,
    Section,
    require_integer,
    require_number,
)

Array = np.ndarray
INK = "#30353d"


def shapes_in(
    line: Line, ends: Ends, current: Current, n_segments: int, shares: tuple[float, ...] = ()
) -> list[tuple[float, StaticShape]]:
    """The shape in the whole current, and before it those in given shares of it."""
    found = []
    for share in (*shares, 1.0):
        weaker = replace(current, speed=tuple(share * speed for speed in current.speed))
        if isinstance(ends, Towed):
            slower = replace(ends, velocity=(share * ends.velocity[0], share * ends.velocity[1]))
            solver = StaticsSolver(line=line, ends=slower, current=weaker, n_segments=n_segments)
        else:
            solver = StaticsSolver(line=line, ends=ends, current=weaker, n_segments=n_segments)
        found.append((share, solver.solve()))
    return found


def _quantities(shape: StaticShape) -> list[Quantity]:
    position, tension = shape.position, shape.tension
    fine, _ = shape.sample(np.linspace(0.0, shape.arc_length[-1], 4001))
    lengths = np.linalg.norm(np.diff(fine, axis=0), axis=1)
    steep = np.degrees(shape.inclination)
    quantities = [
        Quantity("upper_tension", float(tension[-1]), "N", "tension at the upper end"),
        Quantity("lower_tension", float(tension[0]), "N", "tension at the lower end"),
        Quantity("greatest_tension", float(tension.max()), "N", "largest tension along the line"),
        Quantity("least_tension", float(tension.min()), "N", "smallest tension along the line"),
        Quantity("upper_inclination", float(steep[-1]), "deg", "of the line above the horizontal, upper end"),
        Quantity("lower_inclination", float(steep[0]), "deg", "of the line above the horizontal, lower end"),
        Quantity("horizontal_span", float(np.hypot(*shape.span[:2])), "m", "between the ends, horizontally"),
        Quantity("vertical_span", float(shape.span[2]), "m", "upper end above the lower one"),
        Quantity("deepest_point", float(-fine[:, 2].min()), "m", "depth of the line's lowest point"),
        Quantity("upper_x", float(position[-1, 0]), "m", "place of the upper end along x"),
        Quantity("upper_y", float(position[-1, 1]), "m", "place of the upper end along y"),
        Quantity("lower_x", float(position[0, 0]), "m", "place of the lower end along x"),
        Quantity("lower_y", float(position[0, 1]), "m", "place of the lower end along y"),
        Quantity("lower_depth", float(-position[0, 2]), "m", "depth of the lower end"),
        Quantity("elongation", float(lengths.sum() - shape.arc_length[-1]), "m", "stretch of the whole line"),
        Quantity("greatest_strain", float(shape.strain.max()), "-", "largest strain along the line"),
    ]
    margins = [
        cable.breaking_strength / float(shape.tension[:-1][shape.section == i].max())
        for i, cable in enumerate(section.cable for section in shape.line.sections)
        if cable.breaking_strength is not None
    ]
    if margins:
        quantities.append(Quantity("safety_factor", min(margins), "-", "least strength over tension"))
    return quantities


def profile(shape: StaticShape) -> dict[str, Array]:
    """The shape as a table, node by node."""
    return {
        "arc length [m]": shape.arc_length,
        "x [m]": shape.position[:, 0],
        "y [m]": shape.position[:, 1],
        "z [m]": shape.position[:, 2],
        "tension [N]": shape.tension,
        "inclination [rad]": shape.inclination,
        "bearing [rad]": shape.bearing,
    }


def draw_shape(figure: Any, shapes: list[tuple[float, StaticShape]], words: list[str]) -> None:
    """Elevation and plan of some shapes of one line, side by side."""
    elevation, plan = figure.subplots(1, 2)
    for k, ((_, shape), word) in enumerate(zip(shapes, words, strict=True)):
        position, _ = shape.sample(np.linspace(0.0, shape.arc_length[-1], 400))
        colour = COLOURS[0] if k < len(shapes) - 1 and len(shapes) > 3 and k == 0 else COLOURS[1 + k]
        elevation.plot(position[:, 0], position[:, 2], color=colour, label=word)
        plan.plot(position[:, 0], position[:, 1], color=colour)
        for attachment in shape.line.attachments:
            at, _ = shape.sample(attachment.arc_length)
            marker = "^" if attachment.body.submerged_weight < 0.0 else "v"
            elevation.plot(at[0], at[2], marker, color=colour, ms=5)
            plan.plot(at[0], at[1], marker, color=colour, ms=5)
    elevation.set_xlabel("x [m]")
    elevation.set_ylabel("z [m]")
    plan.set_xlabel("x [m]")
    plan.set_ylabel("y [m]")
    plan.set_aspect("equal", adjustable="datalim")
    elevation.legend(fontsize=8)


def draw_tension(figure: Any, shapes: list[tuple[float, StaticShape]], words: list[str]) -> None:
    """Tension along some shapes of one line."""
    axes = figure.subplots()
    for k, ((_, shape), word) in enumerate(zip(shapes, words, strict=True)):
        at = np.linspace(0.0, shape.arc_length[-1], 400)
        _, force = shape.sample(at)
        tension = np.linalg.norm(force, axis=1)
        colour = COLOURS[0] if k < len(shapes) - 1 and len(shapes) > 3 and k == 0 else COLOURS[1 + k]
        axes.plot(at, tension, color=colour, label=word)
    axes.set_xlabel("unstretched distance from the lower end [m]")
    axes.set_ylabel("tension [N]")
    axes.legend(fontsize=8)


def _outcome(
    line: Line, ends: Ends, current: Current, n_segments: int, shares: tuple[float, ...], named: str
) -> Outcome:
    shapes = shapes_in(line, ends, current, n_segments, shares)
    words = [f"{share:.0%} of the {named}" if share else "still water" for share, _ in shapes]
    shape = shapes[-1][1]
    against = {
        f"share of the {named} [-]": np.array([share for share, _ in shapes]),
        "upper tension [N]": np.array([shape.tension[-1] for _, shape in shapes]),
        "lower tension [N]": np.array([shape.tension[0] for _, shape in shapes]),
        "lower x [m]": np.array([shape.position[0, 0] for _, shape in shapes]),
        "lower y [m]": np.array([shape.position[0, 1] for _, shape in shapes]),
        "lower z [m]": np.array([shape.position[0, 2] for _, shape in shapes]),
        "upper x [m]": np.array([shape.position[-1, 0] for _, shape in shapes]),
        "upper y [m]": np.array([shape.position[-1, 1] for _, shape in shapes]),
    }
    return Outcome(
        quantities=tuple(_quantities(shape)),
        tables={"profile": profile(shape), "against_current": against},
        pictures={
            "shape": lambda figure: draw_shape(figure, shapes, words),
            "tension": lambda figure: draw_tension(figure, shapes, words),
        },
    )


@dataclass(frozen=True, kw_only=True)
class SubmergedLine:
    """A line held at both ends, in a current."""

    line: Line
    """The line; bodies on it and several sections are allowed."""
    ends: FixedEnds
    """Where its ends are."""
    current: Current = field(default_factory=Current)
    """The water's velocity."""
    shares: tuple[float, ...] = (0.0, 0.5)
    """Shares of the current whose shapes are drawn beside it [-]."""
    n_segments: int = 100
    """Segments of the line [-]."""

    def __post_init__(self) -> None:
        StaticsSolver(line=self.line, ends=self.ends, current=self.current, n_segments=self.n_segments)

    def outcome(self) -> Outcome:
        """Tensions, angles, deepest point, stretch; profiles and the effect of the current."""
        return _outcome(self.line, self.ends, self.current, self.n_segments, self.shares, "current")


@dataclass(frozen=True, kw_only=True)
class TowedUnit:
    """A unit on a line behind or below a vessel that is under way, in a current or both."""

    line: Line
    """The line."""
    ends: Towed
    """Where the vessel is and goes, and the unit with its thrust."""
    current: Current = field(default_factory=Current)
    """The water's velocity."""
    shares: tuple[float, ...] = (0.0, 0.5)
    """Shares of speed and current whose shapes are drawn beside [-]."""
    n_segments: int = 100
    """Segments of the line [-]."""

    def __post_init__(self) -> None:
        require_integer(self, "n_segments", minimum=1)

    def outcome(self) -> Outcome:
        """Where the unit is, tensions and angles; profiles and the effect of the speed."""
        return _outcome(self.line, self.ends, self.current, self.n_segments, self.shares, "speed")


@dataclass(frozen=True, kw_only=True)
class MooredBody:
    """A body at the surface on one line to an anchor, under a known pull."""

    line: Line
    """The line, the anchor's end first."""
    ends: Moored
    """The anchor, the upper end's height and the pull on it."""
    current: Current = field(default_factory=Current)
    """The water's velocity."""
    shares: tuple[float, ...] = (0.0, 0.5)
    """Shares of the current whose shapes are drawn beside it [-]."""
    n_segments: int = 100
    """Segments of the line [-]."""

    def __post_init__(self) -> None:
        StaticsSolver(line=self.line, ends=self.ends, current=self.current, n_segments=self.n_segments)

    def outcome(self) -> Outcome:
        """Where the body is, tensions at body and anchor; profiles and the effect of the current."""
        return _outcome(self.line, self.ends, self.current, self.n_segments, self.shares, "current")


@dataclass(frozen=True, kw_only=True)
class ThrusterFootprint:
    """How far a unit on the sea bed gets from below its vessel, at every bearing."""

    line: Line
    """The line, paid out as far as it goes."""
    payload: Payload
    """The unit; its weight in water holds it down."""
    depth: float
    """Depth of the bed [m]."""
    thrust: float
    """Greatest horizontal thrust [N]."""
    current: Current = field(default_factory=Current)
    """The water's velocity."""
    shortest_length: float | None = None
    """Least length that the vessel may pay out [m]; null: all of the line is always out."""
    n_bearings: int = 36
    """Bearings, evenly around [-]."""
    n_segments: int = 40
    """Segments of the line [-]."""

    def __post_init__(self) -> None:
        require_number(self, "thrust", positive=True)
        self._solver(self.current)

    def _solver(self, current: Current) -> FootprintSolver:
        return FootprintSolver(
            line=self.line,
            payload=self.payload,
            depth=self.depth,
            thrust=self.thrust,
            current=current,
            shortest_length=self.shortest_length,
            n_bearings=self.n_bearings,
            n_segments=self.n_segments,
        )

    def outcome(self) -> Outcome:
        """Least and greatest reach, area, tension at the vessel and pull on the unit, bearing by bearing."""
        found = self._solver(self.current).solve()
        still = self._solver(Current()).solve()
        reached = np.isfinite(found.reach)
        if not reached.any():
            raise ValueError(
                f"the unit reaches no bearing with {self.thrust:g} N; raise thrust or its weight, or lower "
                "the current"
            )
        turn = 2.0 * math.pi / len(found.reach)
        closed = found.reach * np.roll(found.reach, -1)
        area = 0.5 * math.sin(turn) * float(np.nansum(closed))
        farthest = int(np.nanargmax(found.reach))
        nearest = int(np.nanargmin(found.reach))
        quantities = (
            Quantity(
                "greatest_reach", float(found.reach[farthest]), "m", "horizontal, from below the vessel"
            ),
            Quantity(
                "greatest_reach_bearing", math.degrees(found.bearing[farthest]), "deg", "from x towards y"
            ),
            Quantity("least_reach", float(found.reach[nearest]), "m", "of the bearings that are reached"),
            Quantity("least_reach_bearing", math.degrees(found.bearing[nearest]), "deg", "from x towards y"),
            Quantity("bearings_reached", float(reached.mean()), "-", "share of all bearings"),
            Quantity("area", area, "m²", "within the boundary, as seen from below the vessel"),
            Quantity("greatest_top_tension", float(np.nanmax(found.top_tension)), "N", "at the vessel"),
            Quantity("greatest_lift", float(np.nanmax(found.lift)), "N", "vertical pull on the unit"),
            Quantity("least_clearance", float(np.nanmin(found.clearance)), "m", "of the line over the bed"),
        )
        table = {
            "bearing [rad]": found.bearing,
            "reach [m]": found.reach,
            "thrust direction [rad]": found.thrust_direction,
            "top tension [N]": found.top_tension,
            "lift [N]": found.lift,
            "clearance [m]": found.clearance,
            "length [m]": found.length,
        }
        return Outcome(
            quantities=quantities,
            tables={"boundary": table},
            pictures={"footprint": lambda figure: draw_footprint(figure, found, still)},
        )


def draw_footprint(figure: Any, found: Footprint, still: Footprint) -> None:
    """The boundary seen from above, in the current and in still water."""
    axes = figure.subplots()
    for one, colour, word in ((still, COLOURS[0], "still water"), (found, COLOURS[1], "in the current")):
        x, y = one.reach * np.cos(one.bearing), one.reach * np.sin(one.bearing)
        axes.plot(np.append(x, x[0]), np.append(y, y[0]), color=colour, label=word)
    down = found.clearance < -1e-3
    if down.any():
        x, y = found.reach * np.cos(found.bearing), found.reach * np.sin(found.bearing)
        axes.plot(x[down], y[down], "o", ms=4, color=COLOURS[2], label="line would lie on the bed")
    axes.plot(0.0, 0.0, "^", color=INK, label="below the vessel")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_aspect("equal")
    axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0))


def tether() -> Cable:
    """The tether of Huang (1992), 2.6: 0.032 m, 2e11 N/m², 2.25 N/m in water.

    Not printed there: drag coefficients (1.2 across, 0.01 along) and mass (1.05 kg/m: displaced water and
    weight).
    """
    return Cable(
        mass_per_length=1.05,
        axial_stiffness=2.0e11 * 0.25 * math.pi * 0.032**2,
        submerged_weight=2.25,
        diameter=0.032,
        normal_drag_coefficient=1.2,
        tangential_drag_coefficient=0.01,
    )


@case("statics")
def thesis_submerged() -> SubmergedLine:
    """350 m of the thesis's tether between a point 150 m deep and the surface, 0.514 m/s across it."""
    return SubmergedLine(
        line=Line.uniform(tether(), 350.0),
        ends=FixedEnds(lower=(250.0, 0.0, -150.0), upper=(0.0, 0.0, 0.0)),
        current=Current.uniform(0.514, 0.5 * math.pi),
    )


@case("statics")
def thesis_towed() -> TowedUnit:
    """A unit of 3 kN in water on 300 m of the thesis's tether behind a ship at 1 m/s, in a current from abeam
    that fades with depth."""
    return TowedUnit(
        line=Line.uniform(tether(), 300.0),
        ends=Towed(
            payload=Payload(mass=1500.0, submerged_weight=3000.0, added_mass=800.0, drag_area=1.0),
            velocity=(1.0, 0.0),
        ),
        current=Current(
            depth=(0.0, 100.0, 300.0),
            speed=(0.514, 0.257, 0.1),
            direction=(0.5 * math.pi, 0.5 * math.pi, 0.5 * math.pi),
        ),
    )


@case("statics")
def thesis_moored() -> MooredBody:
    """A buoy pulled with 25 kN on chain, buoyant rope and wire with a float, in 200 m of moving water."""
    chain = Cable(
        mass_per_length=40.0,
        axial_stiffness=2.0e8,
        submerged_weight=340.0,
        diameter=0.09,
        normal_drag_coefficient=1.2,
        tangential_drag_coefficient=0.05,
        breaking_strength=9.0e5,
    )
    rope = Cable(
        mass_per_length=1.6,
        axial_stiffness=4.0e6,
        submerged_weight=-1.0,
        diameter=0.05,
        tangential_drag_coefficient=0.01,
        breaking_strength=4.0e5,
    )
    wire = Cable(
        mass_per_length=4.0,
        axial_stiffness=6.0e7,
        submerged_weight=33.0,
        diameter=0.032,
        tangential_drag_coefficient=0.01,
        breaking_strength=6.5e5,
    )
    return MooredBody(
        line=Line(
            sections=(
                Section(cable=chain, length=50.0),
                Section(cable=rope, length=180.0),
                Section(cable=wire, length=120.0),
            ),
            attachments=(
                Attachment(
                    arc_length=230.0, body=Payload(mass=150.0, submerged_weight=-4000.0, drag_area=1.5)
                ),
            ),
        ),
        ends=Moored(anchor=(0.0, 0.0, -200.0), upper_height=0.0, pull=(25_000.0, 0.0)),
        current=Current(depth=(0.0, 200.0), speed=(0.8, 0.2), direction=(0.25 * math.pi, 0.5 * math.pi)),
    )


@case("statics")
def thrust_footprint() -> ThrusterFootprint:
    """Where a tethered unit with 500 N of thrust gets on a bed 200 m deep, with up to 350 m of tether in
    0.257 m/s."""
    return ThrusterFootprint(
        line=Line.uniform(tether(), 350.0),
        payload=Payload(mass=1000.0, submerged_weight=800.0, added_mass=600.0, drag_area=1.0),
        depth=200.0,
        thrust=500.0,
        current=Current.uniform(0.257),
        shortest_length=210.0,
    )
