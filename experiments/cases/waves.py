"""Cases of natural modes: a unit on a hanging line, and a line between two supports."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from experiments.cases.case import Outcome, Quantity, case
from experiments.cases.statics import profile
from experiments.figures import COLOURS
from heave_env.cable.statics import FixedEnds, StaticShape, StaticsSolver, Towed
from heave_env.cable.waves import (
    IN_PLANE,
    OUT_OF_PLANE,
    Modes,
    WavesSolver,
    longitudinal_wave_speed,
    transverse_wave_speed,
    travel_times,
)
from heave_env.parameters import Cable, Current, Line, Payload, require_integer

Array = np.ndarray


def _quantities(shape: StaticShape, modes: Modes) -> list[Quantity]:
    cable = shape.line.sections[-1].cable
    longitudinal, transverse = travel_times(shape)
    speed = float(transverse_wave_speed(cable, shape.tension[-1]))
    quantities = [
        Quantity("longitudinal_wave_speed", longitudinal_wave_speed(cable), "m/s", "at the upper end"),
        Quantity("transverse_wave_speed", speed, "m/s", "at the upper end"),
        Quantity("longitudinal_travel_time", longitudinal, "s", "from end to end"),
        Quantity("transverse_travel_time", transverse, "s", "from end to end"),
        Quantity("upper_tension", float(shape.tension[-1]), "N", "at rest"),
        Quantity("slowest_omega", float(modes.omega[0]), "rad/s", "slowest mode"),
        Quantity("slowest_period", float(modes.period[0]), "s", "slowest mode"),
    ]
    for family in (IN_PLANE, OUT_OF_PLANE):
        one = modes.of(family)
        if len(one.omega):
            word = family.replace(" ", "_")
            quantities.append(Quantity(f"{word}_period", float(one.period[0]), "s", f"first mode {family}"))
    stretching = np.flatnonzero(modes.stretch_share > 0.5)
    if len(stretching):
        first = int(stretching[0])
        quantities.append(
            Quantity(
                "stretching_omega", float(modes.omega[first]), "rad/s", "first mode that stretches the line"
            )
        )
        quantities.append(
            Quantity(
                "stretching_period", float(modes.period[first]), "s", "first mode that stretches the line"
            )
        )
    quantities.append(
        Quantity("least_damping_ratio", float(modes.damping_ratio.min()), "-", "by the steady current's drag")
    )
    return quantities


def _table(modes: Modes) -> dict[str, Array]:
    codes = {IN_PLANE: 1.0, OUT_OF_PLANE: 2.0}
    return {
        "mode [-]": np.arange(1.0, len(modes.omega) + 1.0),
        "family (1 in plane, 2 out of plane, 0 spatial) [-]": np.array(
            [codes.get(one, 0.0) for one in modes.family]
        ),
        "omega [rad/s]": modes.omega,
        "period [s]": modes.period,
        "stretch share [-]": modes.stretch_share,
        "damping ratio [-]": modes.damping_ratio,
    }


def _shapes_table(modes: Modes) -> dict[str, Array]:
    columns = {"arc length [m]": modes.arc_length}
    for n, mode in enumerate(modes.displacement):
        for axis, name in enumerate("xyz"):
            columns[f"mode {n + 1} {name} [-]"] = mode[:, axis]
    return columns


def draw_modes(figure: Any, modes: Modes) -> None:
    """The first modes of each family: displacement along the line, by components in and across the plane."""
    families = list(dict.fromkeys(modes.family))
    panels = figure.subplots(1, len(families), sharey=True, squeeze=False)[0]
    for axes, family in zip(panels, families, strict=True):
        one = modes.of(family)
        for n in range(min(4, len(one.omega))):
            mode = one.displacement[n]
            # The component that moves most, so that the drawing has a sign.
            axis = int(np.argmax(np.abs(mode).max(axis=0)))
            label = f"{one.omega[n]:.3g} rad/s ({'xyz'[axis]})"
            axes.plot(mode[:, axis], one.arc_length, color=COLOURS[1 + n], label=label)
        axes.axvline(0.0, color=COLOURS[0], lw=0.7)
        axes.set_xlabel(f"displacement, {family} [-]")
        axes.legend(fontsize=7.5, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    panels[0].set_ylabel("unstretched distance from the lower end [m]")


def draw_frequencies(figure: Any, modes: Modes) -> None:
    """Natural frequencies in order, told apart by family and by whether they stretch the line."""
    axes = figure.subplots()
    number = np.arange(1, len(modes.omega) + 1)
    for k, family in enumerate(dict.fromkeys(modes.family)):
        own = np.array([one == family for one in modes.family])
        axes.plot(number[own], modes.omega[own], "so^"[k], color=COLOURS[1 + 2 * k], ms=5, label=family)
    stretching = modes.stretch_share > 0.5
    if stretching.any():
        axes.plot(
            number[stretching],
            modes.omega[stretching],
            "o",
            ms=11,
            mfc="none",
            color="#30353d",
            label="stretches the line",
        )
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.set_xlabel("mode [-]")
    axes.set_ylabel("natural frequency [rad/s]")
    axes.set_ylim(bottom=0.0)
    axes.legend(fontsize=8)


def _outcome(line: Line, ends: FixedEnds | Towed, current: Current, n_segments: int, n_modes: int) -> Outcome:
    shape = StaticsSolver(line=line, ends=ends, current=current, n_segments=n_segments).solve()
    modes = WavesSolver(shape=shape, n_modes=n_modes).solve()
    return Outcome(
        quantities=tuple(_quantities(shape, modes)),
        tables={"modes": _table(modes), "mode_shapes": _shapes_table(modes), "profile": profile(shape)},
        pictures={
            "mode_shapes": lambda figure: draw_modes(figure, modes),
            "frequencies": lambda figure: draw_frequencies(figure, modes),
        },
    )


@dataclass(frozen=True, kw_only=True)
class HangingModes:
    """Natural modes of a unit on a line below a vessel, in still water or about its shape in a current."""

    line: Line
    """The line."""
    payload: Payload
    """The unit at its lower end."""
    current: Current = field(default_factory=Current)
    """The water's velocity; it bends the line and damps its motion."""
    n_modes: int = 20
    """Modes in all [-]."""
    n_segments: int = 100
    """Elements of the line [-]."""

    def __post_init__(self) -> None:
        require_integer(self, "n_modes", minimum=1)
        require_integer(self, "n_segments", minimum=1)

    def outcome(self) -> Outcome:
        """Frequencies, periods and damping of the slowest modes, wave speeds and travel times."""
        return _outcome(self.line, Towed(payload=self.payload), self.current, self.n_segments, self.n_modes)


@dataclass(frozen=True, kw_only=True)
class InclinedModes:
    """Natural modes of a line between two supports."""

    line: Line
    """The line."""
    ends: FixedEnds
    """Where its ends are."""
    current: Current = field(default_factory=Current)
    """The water's velocity; it bends the line and damps its motion."""
    n_modes: int = 12
    """Modes in all [-]."""
    n_segments: int = 100
    """Elements of the line [-]."""

    def __post_init__(self) -> None:
        require_integer(self, "n_modes", minimum=1)
        require_integer(self, "n_segments", minimum=1)

    def outcome(self) -> Outcome:
        """Frequencies, periods and damping of the slowest modes, wave speeds and travel times."""
        return _outcome(self.line, self.ends, self.current, self.n_segments, self.n_modes)


@case("waves")
def hanging_modes() -> HangingModes:
    """The thesis's unit of 125 t (added mass included) on 900 m of cable: swing, string and axial modes."""
    cable = Cable(
        mass_per_length=7.2,
        axial_stiffness=9.09e9 * 0.25 * math.pi * 0.047**2,
        submerged_weight=54.0,
        diameter=0.047,
        tangential_drag_coefficient=0.025,
    )
    return HangingModes(
        line=Line.uniform(cable, 900.0),
        payload=Payload(mass=125_000.0, submerged_weight=50_000.0, drag_area=1.0),
    )


@case("waves")
def inclined_modes() -> InclinedModes:
    """300 m of a 47 mm cable from a vessel to a point 200 m deep and 210 m away, sagging in still water."""
    cable = Cable(
        mass_per_length=5.2,
        axial_stiffness=9.05e9 * 0.25 * math.pi * 0.047**2,
        submerged_weight=33.0,
        diameter=0.047,
        tangential_drag_coefficient=0.01,
    )
    return InclinedModes(
        line=Line.uniform(cable, 300.0),
        ends=FixedEnds(lower=(210.0, 0.0, -200.0), upper=(0.0, 0.0, 0.0)),
    )
