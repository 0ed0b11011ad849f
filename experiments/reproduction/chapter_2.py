"""Huang (1992), chapter 2: shapes of lines at rest, in air, under a load and in a current."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from scipy.optimize import root

from experiments.cases.statics import tether
from experiments.figures import COLOURS
from experiments.reproduction.figure import Caption, reproduction
from heave_env.cable.statics import FixedEnds, StaticShape, StaticsSolver
from heave_env.parameters import GRAVITY, Attachment, Cable, Current, Line, Payload, Section

Array = np.ndarray
DARK = "#30353d"
SPEEDS = (0.0, 0.257, 0.514, 1.028)
"""Currents drawn, about the thesis's 0.514 m/s [m/s]."""


def _steel() -> Cable:
    """A steel wire of 20 mm in air."""
    section = 0.25 * math.pi * 0.02**2
    return Cable(
        mass_per_length=7850.0 * section,
        axial_stiffness=2.0e11 * section,
        submerged_weight=7850.0 * section * GRAVITY,
        diameter=0.02,
    ).in_air()


def _sampled(shape: StaticShape) -> Array:
    return shape.sample(np.linspace(0.0, shape.arc_length[-1], 400))[0]


def _catenary(H: float, V: float, w: float, EA: float, length: float, at: Array) -> tuple[Array, Array]:
    """Points of an elastic catenary at distances from its lower end; H and V pull at the upper one."""
    low = V - w * length
    x = H * at / EA + H / w * (np.arcsinh((low + w * at) / H) - math.asinh(low / H))
    z = at / EA * (low + 0.5 * w * at) + (np.hypot(H, low + w * at) - math.hypot(H, low)) / w
    return x, z


@reproduction("H 2.4", "Elastic steel catenary in air between supports at different heights")
def thesis_2_4(figure: Any) -> Caption:
    """The solver's shape and the exact elastic catenary."""
    cable, length, span, rise = _steel(), 120.0, 100.0, 30.0
    w, EA = cable.submerged_weight, cable.axial_stiffness
    ends = FixedEnds(lower=(0.0, 0.0, 0.0), upper=(span, 0.0, rise))
    shape = StaticsSolver(line=Line.uniform(cable, length), ends=ends, n_segments=40).solve()

    def miss(forces: Array) -> list[float]:
        x, z = _catenary(forces[0], forces[1], w, EA, length, np.array(length))
        return [float(x) - span, float(z) - rise]

    H, V = root(miss, np.array([0.5, 0.7]) * w * length, tol=1e-12).x
    x, z = _catenary(H, V, w, EA, length, np.linspace(0.0, length, 13))
    axes = figure.subplots()
    position = _sampled(shape)
    axes.plot(position[:, 0], position[:, 2], color=COLOURS[3], label="semi-analytic segments (40)")
    axes.plot(x, z, "o", ms=5, mfc="none", color=COLOURS[1], label="exact elastic catenary")
    axes.plot([0.0, span], [0.0, rise], "^", color=DARK, label="supports")
    axes.set_xlabel("horizontal distance [m]")
    axes.set_ylabel("height above the lower support [m]")
    axes.set_aspect("equal")
    axes.legend(fontsize=8)
    ours, _ = shape.sample(np.linspace(0.0, length, 13))
    gap = float(np.hypot(ours[:, 0] - x, ours[:, 2] - z).max())
    return Caption(
        parameters=f"Length {length:g} m, span {span:g} m, rise {rise:g} m, diameter 20 mm, E 2e11 N/m², "
        f"{w:.2f} N/m in air; upper tension {shape.tension[-1]:.1f} N, lower {shape.tension[0]:.1f} N.",
        shows=f"The two agree, as the text says: the largest distance between them is {gap:.0e} m.",
        assumed="All numbers: the text says only that the cable is of steel, in air, its supports not level.",
    )


@reproduction("H 2.5", "A hanging cable in air under a point load")
def thesis_2_5(figure: Any) -> Caption:
    """Shapes under loads at a third of the length."""
    cable, length = _steel(), 120.0
    weight = cable.submerged_weight * length
    ends = FixedEnds(lower=(0.0, 0.0, 0.0), upper=(100.0, 0.0, 0.0))
    axes = figure.subplots()
    tensions = []
    for k, share in enumerate((0.0, 0.25, 1.0, 4.0)):
        body = Payload(mass=max(1.0, share * weight / GRAVITY), submerged_weight=share * weight)
        line = Line(
            sections=(Section(cable=cable, length=length),),
            attachments=(Attachment(arc_length=length / 3.0, body=body),),
        )
        shape = StaticsSolver(line=line, ends=ends, n_segments=60).solve()
        position = _sampled(shape)
        label = "no load" if share == 0.0 else f"load {share * weight:.0f} N"
        axes.plot(position[:, 0], position[:, 2], color=COLOURS[k], label=label)
        place, _ = shape.sample(length / 3.0)
        if share > 0.0:
            axes.plot(place[0], place[2], "v", color=COLOURS[k], ms=6)
        tensions.append(f"{shape.tension.max():.0f}")
    axes.set_xlabel("horizontal distance [m]")
    axes.set_ylabel("height above the supports [m]")
    axes.set_aspect("equal")
    axes.legend(fontsize=8)
    return Caption(
        parameters=f"Length {length:g} m, level span 100 m, diameter 20 mm, E 2e11 N/m², weight of the cable "
        f"{weight:.0f} N; loads of 0, 1/4, 1 and 4 times that at a third of the length from the left; "
        f"greatest tensions {', '.join(tensions)} N.",
        shows="The load pulls the curve down where it hangs; a heavy one leaves two nearly straight parts.",
        assumed="All numbers: the text says only that a hanging cable in air is changed by a point load.",
    )


@cache
def _in_current(length: float, speed: float, along: bool) -> StaticShape:
    """The tether from the surface to a point 0.5 of its length down and 0.7 of it away."""
    ends = FixedEnds(lower=(0.7 * length, 0.0, -0.5 * length), upper=(0.0, 0.0, 0.0))
    direction = math.pi if along else 0.5 * math.pi
    current = Current.uniform(speed, direction)
    return StaticsSolver(line=Line.uniform(tether(), length), ends=ends, current=current).solve()


def _draw_in_plane(figure: Any, length: float) -> Caption:
    shape_axes, tension_axes = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
    said = []
    for k, speed in enumerate(SPEEDS):
        shape = _in_current(length, speed, True)
        position = _sampled(shape)
        label = "still water" if speed == 0.0 else f"{speed:g} m/s"
        width = 2.2 if speed == 0.514 else 1.3
        shape_axes.plot(position[:, 0], position[:, 2], color=COLOURS[k], lw=width, label=label)
        at = np.linspace(0.0, length, 200)
        tension = np.linalg.norm(shape.sample(at)[1], axis=1)
        tension_axes.plot(at, tension, color=COLOURS[k], lw=width)
        said.append(f"{speed:g} m/s: {shape.tension[-1]:.0f} N above, {shape.tension[0]:.0f} N below")
    shape_axes.set_xlabel("horizontal distance from the upper end [m]")
    shape_axes.set_ylabel("z [m]")
    shape_axes.legend(fontsize=8)
    tension_axes.set_xlabel("from the lower end [m]")
    tension_axes.set_ylabel("tension [N]")
    return Caption(
        parameters=f"Length {length:g} m, diameter 0.032 m, E 2e11 N/m², 2.25 N/m in water; currents "
        f"{SPEEDS[1]:g}, {SPEEDS[2]:g} (the thesis's) and {SPEEDS[3]:g} m/s towards the upper end; "
        f"{'; '.join(said)}.",
        shows="The current plays a significant role, as the text says. The measured points, with which "
        "the thesis agrees well, are not in its text and are not drawn.",
        assumed=f"Both ends held, the lower one {0.5 * length:g} m deep and {0.7 * length:g} m away (print "
        "gives no place); drag coefficients 1.2 across and 0.01 along; the same current at all depths.",
    )


@reproduction("H 2.6", "A cable of 350 m in ocean currents", size=(7.4, 3.6))
def thesis_2_6(figure: Any) -> Caption:
    """Shapes and tensions of the 350 m cable."""
    return _draw_in_plane(figure, 350.0)


@reproduction("H 2.7", "A cable of 300 m in ocean currents", size=(7.4, 3.6))
def thesis_2_7(figure: Any) -> Caption:
    """Shapes and tensions of the 300 m cable."""
    return _draw_in_plane(figure, 300.0)


@reproduction("H 2.8", "A submerged cable in three dimensions", size=(7.4, 3.8))
def thesis_2_8(figure: Any) -> Caption:
    """Elevation and plan of the 350 m cable with the current across it."""
    elevation, plan = figure.subplots(1, 2)
    said = []
    for k, speed in enumerate(SPEEDS):
        shape = _in_current(350.0, speed, False)
        position = _sampled(shape)
        label = "still water" if speed == 0.0 else f"{speed:g} m/s"
        elevation.plot(position[:, 0], position[:, 2], color=COLOURS[k], label=label)
        plan.plot(position[:, 0], position[:, 1], color=COLOURS[k])
        said.append(f"{speed:g} m/s: {position[:, 1].max():.1f} m, {shape.tension[-1]:.0f} N")
    elevation.set_xlabel("x [m]")
    elevation.set_ylabel("z [m]")
    elevation.legend(fontsize=8)
    plan.annotate(
        "current",
        xy=(20.0, 79.0),
        xytext=(5.0, 58.0),
        fontsize=8,
        arrowprops={"arrowstyle": "->", "color": DARK},
    )
    plan.set_xlabel("x [m]")
    plan.set_ylabel("y [m]")
    return Caption(
        parameters="Length 350 m, diameter 0.032 m, E 2e11 N/m², 2.25 N/m in water; ends at (0, 0, 0) and "
        f"(245, 0, -175) m, the current along y; greatest offset and upper tension at {'; '.join(said)}.",
        shows="The current blows the line out of its plane and lifts it; the thesis has nothing measured.",
        assumed="The places of the ends, speeds and direction; drag coefficients 1.2 across and 0.01 along.",
    )
