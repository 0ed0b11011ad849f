"""Cases of the towed cable: a light cable behind a ship, strumming, and deployment on the sea bottom."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from experiments.cases.case import Outcome, Quantity, case
from experiments.figures import COLOURS
from heave_env.cable.towing import Towing, cable_froude_number
from heave_env.parameters import Cable, require_number

INK = "#30353d"


@dataclass(frozen=True, kw_only=True)
class Towed:
    """A uniform cable towed straight, with or without cable running out."""

    cable: Cable
    """What is towed; its weight, diameter and both drag coefficients count."""
    length: float
    """Unstretched length outboard [m]."""
    speed: float
    """Speed of the tow through the water [m/s]."""
    payout_rate: float = 0.0
    """Rate at which cable goes out, positive outwards [m/s]."""
    strumming_augmentation: float = 0.0
    """Share by which strumming raises the tangential drag [-]; up to 0.5 was measured."""
    greatest_speed: float = 6.0
    """Up to which speed the table and the picture of speeds go [m/s]."""

    def __post_init__(self) -> None:
        self._tow(self.speed)
        require_number(self, "greatest_speed", positive=True)

    def _tow(self, speed: float) -> Towing:
        return Towing(
            cable=self.cable,
            length=self.length,
            speed=speed,
            payout_rate=self.payout_rate,
            strumming_augmentation=self.strumming_augmentation,
        )

    def outcome(self) -> Outcome:
        """Angle, place of the end, tension and its parts, critical pay-out; the same against speed."""
        tow = self._tow(self.speed)
        found = tow.solve()
        still = replace(tow, strumming_augmentation=0.0).solve()
        quantities = [
            Quantity("inclination", found.inclination, "rad", "angle of the cable below the horizontal"),
            Quantity("inclination_degrees", math.degrees(found.inclination), "deg", "the same in degrees"),
            Quantity("depth", found.depth, "m", "of the free end below the tow point"),
            Quantity("layback", found.layback, "m", "of the free end behind the tow point"),
            Quantity("top_tension", found.top_tension, "N", "tension at the tow point"),
            Quantity("weight_tension", found.weight_tension, "N", "its part from weight"),
            Quantity("drag_tension", found.drag_tension, "N", "its part from tangential drag"),
            Quantity("strumming_tension", found.top_tension - still.top_tension, "N", "what strumming adds"),
            Quantity("elongation", found.elongation, "m", "stretch of the whole cable"),
            Quantity("stays_taut", float(found.stays_taut), "-", "1 if the tension pulls, 0 if it buckles"),
        ]
        if self.cable.submerged_weight > 0.0:
            froude = float(cable_froude_number(self.cable, self.speed))
            quantities.append(Quantity("cable_froude_number", froude, "-", "water's inertia over the weight"))
        if math.isfinite(found.critical_payout_rate):
            rate = found.critical_payout_rate
            quantities.append(Quantity("critical_payout_rate", rate, "m/s", "at which the tension vanishes"))
            if self.speed > 0.0:
                ratio = rate / self.speed
                quantities.append(Quantity("critical_payout_ratio", ratio, "-", "the same over the speed"))
        if self.cable.breaking_strength is not None and found.top_tension > 0.0:
            factor = self.cable.breaking_strength / found.top_tension
            quantities.append(Quantity("safety_factor", factor, "-", "breaking strength over the tension"))
        profile = {
            "arc length [m]": found.arc_length,
            "x [m]": found.x,
            "z [m]": found.z,
            "tension [N]": found.tension,
        }
        speeds = self.greatest_speed * np.arange(1, 41) / 40.0
        swept = [self._tow(float(speed)).solve(n_points=2) for speed in speeds]
        by_speed = {
            "speed [m/s]": speeds,
            "inclination [rad]": np.array([one.inclination for one in swept]),
            "depth [m]": np.array([one.depth for one in swept]),
            "tension at the tow point [N]": np.array([one.top_tension for one in swept]),
            "its part from weight [N]": np.array([one.weight_tension for one in swept]),
            "critical pay-out rate [m/s]": np.array([one.critical_payout_rate for one in swept]),
        }

        def shape(figure: Any) -> None:
            axes = figure.subplots()
            axes.plot(found.x, found.z, color=COLOURS[3])
            axes.plot(0.0, 0.0, "o", color=INK, label="tow point")
            axes.set_xlabel("ahead of the tow point [m]")
            axes.set_ylabel("above it [m]")
            axes.legend(loc="upper left")

        def against_speed(figure: Any) -> None:
            upper, lower = figure.subplots(2, 1, sharex=True)
            upper.plot(speeds, by_speed["tension at the tow point [N]"], color=COLOURS[1], label="tension")
            upper.plot(speeds, by_speed["its part from weight [N]"], color=COLOURS[0], label="from weight")
            upper.plot(self.speed, found.top_tension, "o", color=INK, label="this tow")
            upper.set_ylabel("tension [N]")
            upper.legend(fontsize=8)
            critical = by_speed["critical pay-out rate [m/s]"]
            if np.isfinite(critical).all():
                lower.plot(speeds, critical, color=COLOURS[3], label="critical pay-out rate")
            lower.plot(speeds, speeds, color=INK, lw=0.9, ls=(0, (4, 2)), label="the tow's own speed")
            lower.plot(self.speed, self.payout_rate, "o", color=INK)
            lower.set_ylabel("pay-out rate [m/s]")
            lower.set_xlabel("speed of the tow [m/s]")
            lower.legend(fontsize=8)

        return Outcome(
            tuple(quantities),
            {"profile": profile, "by_speed": by_speed},
            {"shape": shape, "against_speed": against_speed},
        )


@case("towing")
def light_towed_cable() -> Towed:
    """500 m of a light 10 mm instrument cable towed at 3 m/s."""
    return Towed(
        cable=Cable(
            mass_per_length=0.14,
            axial_stiffness=1.5e6,
            submerged_weight=0.6,
            diameter=0.010,
            normal_drag_coefficient=1.4,
            tangential_drag_coefficient=0.012,
            breaking_strength=12_000.0,
        ),
        length=500.0,
        speed=3.0,
    )


@case("towing")
def strumming_tow() -> Towed:
    """The same cable strumming, with half as much tangential drag again, the most that was measured."""
    return replace(light_towed_cable(), strumming_augmentation=0.5)


@case("towing")
def bottom_deployment() -> Towed:
    """The same cable laid on the sea bottom at 3 m/s, paid out 5 % faster: does it keep its tension?"""
    return replace(light_towed_cable(), payout_rate=1.05 * 3.0)
