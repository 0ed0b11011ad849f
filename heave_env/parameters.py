"""Every physical parameter of an operation, as frozen dataclasses of SI numbers.

What is given is a field; what follows from it is a property. Wrong numbers raise `ValueError` when
the object is built, with the field, the value and the remedy in one sentence. The public sign
convention is heave positive up, pay-out positive outwards, tension positive in pull.
"""

from __future__ import annotations

import difflib
import itertools
import math
import statistics
from collections.abc import Iterable
from dataclasses import dataclass, replace

SEAWATER_DENSITY = 1025.0
"""Density of sea water [kg/m³] (UNESCO EOS-80 at 35 psu and 11 °C: 1026; engineering value)."""
GRAVITY = 9.80665
"""Standard gravity [m/s²] (CGPM 1901)."""

FULLY_DEVELOPED = (4.0 * 0.0081 / 1.25) ** 0.25
"""Modal frequency of a fully developed sea over sqrt(g/Hs) [-] (Pierson and Moskowitz 1964: α = 0.0081)."""

SEA_KINDS = ("shaping_filter", "random_phase", "regular", "recorded", "calm")
SPECTRA = ("bretschneider", "pierson_moskowitz", "jonswap", "ochi_hubble", "torsethaugen", "measured")
FILTERS = ("thesis", "fitted")
LARGEST_FILTER = 16
"""States of the largest shaping filter that is fitted [-]."""


def require(condition: bool, owner: object, field: str, expectation: str) -> None:
    """Raises `ValueError` naming the field, what it must be and what it is, unless `condition`."""
    if not condition:
        value = getattr(owner, field)
        raise ValueError(f"{type(owner).__name__}.{field} must be {expectation}, got {value!r}")


def require_number(
    owner: object,
    field: str,
    *,
    positive: bool = False,
    non_negative: bool = False,
    optional: bool = False,
) -> None:
    """Raises `ValueError` unless the field is a finite real number of the wanted sign."""
    value = getattr(owner, field)
    if optional and value is None:
        return
    if positive:
        expectation = "a positive number"
    elif non_negative:
        expectation = "a number that is not negative"
    else:
        expectation = "a finite number"
    if optional:
        expectation += " or null"
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    require(is_number and math.isfinite(value), owner, field, expectation)
    require(not positive or value > 0.0, owner, field, expectation)
    require(not non_negative or value >= 0.0, owner, field, expectation)


def require_integer(owner: object, field: str, *, minimum: int) -> None:
    """Raises `ValueError` unless the field is an integer of at least `minimum`."""
    value = getattr(owner, field)
    ok = isinstance(value, int) and not isinstance(value, bool) and value >= minimum
    require(ok, owner, field, f"an integer of at least {minimum}")


def name_hint(name: object, known: Iterable[str], otherwise: str) -> str:
    """What to say of an unknown name: the known one that it resembles, or else `otherwise`."""
    close = difflib.get_close_matches(str(name), list(known), n=1)
    return f"did you mean {close[0]!r}?" if close else otherwise


@dataclass(frozen=True, kw_only=True)
class SeaState:
    """The sea, or the recorded motion that stands in for it.

    `spectrum` says what the sea is (see `heave_env.spectra`), `kind` how it is realised (see
    `heave_env.sea`).
    """

    kind: str = "shaping_filter"
    """`shaping_filter` (white noise through a rational filter), `random_phase` (sum of
    sinusoids), `regular` (one sinusoid of random phase), `recorded` (a motion file moves the boom
    tip) or `calm`."""
    significant_wave_height: float = 0.0
    """Hs [m]; of a regular sea the wave height, twice the amplitude; of a measured spectrum what it is scaled
    to, 0 for as measured."""
    peak_omega: float = 1.0
    """Modal frequency ω_m of the spectrum [rad/s], of a two-peaked one that of its primary system; of a
    regular sea its frequency. A Pierson-Moskowitz or measured spectrum has its own: leave 1.0."""
    n_components: int = 128
    """Sinusoids of a random-phase sea [-]."""
    recording: str | None = None
    """Path of the motion file of a recorded sea: CSV with columns time, heave and optionally payout."""
    spectrum: str = "bretschneider"
    """`bretschneider`, `pierson_moskowitz` (fully developed: its frequency follows from Hs), `jonswap`,
    `ochi_hubble` (two systems, six parameters), `torsethaugen` (two systems, of Hs and ω_m) or `measured`."""
    peak_enhancement: float = 3.3
    """γ of the JONSWAP spectrum [-]."""
    shape: float = 1.0
    """λ of the first system of an Ochi-Hubble sea [-]; 1 is Bretschneider's form, more is narrower."""
    second_wave_height: float = 0.0
    """Significant height of its second system [m], a part of the whole: Hs² = Hs_1² + Hs_2²."""
    second_peak_omega: float = 1.0
    """Modal frequency of its second system [rad/s]."""
    second_shape: float = 1.0
    """λ of its second system [-]."""
    spectrum_file: str | None = None
    """File of a measured spectrum: CSV with columns omega and density, or what `spectrum_reader` reads."""
    spectrum_reader: str | None = None
    """Reader of the package wavespectra for that file, such as swan, ww3 or ndbc_ascii; null: CSV."""
    spectrum_record: int = 0
    """Which of several spectra in that file [-]."""
    filter: str = "thesis"
    """Of a shaping-filter sea: `thesis` (six states, 94 % of Bretschneider's variance) or `fitted` (to the
    spectrum, by least squares)."""
    filter_order: int = 6
    """States of the filter [-]: even; the thesis's has 6."""

    def __post_init__(self) -> None:
        require(self.kind in SEA_KINDS, self, "kind", f"one of {', '.join(SEA_KINDS)}")
        require_number(self, "significant_wave_height", non_negative=True)
        require_number(self, "peak_omega", positive=True)
        require_integer(self, "n_components", minimum=1)
        if self.kind == "recorded":
            require(bool(self.recording), self, "recording", "the path of a motion file (kind is recorded)")
        elif self.recording is not None and self.kind != "calm":
            raise ValueError(
                f"SeaState.recording {self.recording!r} contradicts SeaState.kind {self.kind!r}, which "
                "reads no file; set recording to null or kind to recorded"
            )
        measured = self.spectrum == "measured"
        if self.kind in ("shaping_filter", "random_phase", "regular") and not measured:
            require_number(self, "significant_wave_height", positive=True)
        self._check_spectrum()
        self._check_filter()

    def _check_spectrum(self) -> None:
        require(self.spectrum in SPECTRA, self, "spectrum", f"one of {', '.join(SPECTRA)}")
        require_number(self, "second_wave_height", non_negative=True)
        require_number(self, "second_peak_omega", positive=True)
        for field in ("shape", "second_shape"):
            require_number(self, field)
            require(getattr(self, field) > 0.5, self, field, "more than 0.5, so that the rate has a variance")
        require_number(self, "peak_enhancement")
        require(self.peak_enhancement >= 1.0, self, "peak_enhancement", "at least 1")
        require_integer(self, "spectrum_record", minimum=0)
        for fields, spectrum in (
            (("peak_enhancement",), "jonswap"),
            (("shape", "second_wave_height", "second_peak_omega", "second_shape"), "ochi_hubble"),
            (("spectrum_file", "spectrum_reader", "spectrum_record"), "measured"),
        ):
            for field in fields if self.spectrum != spectrum else ():
                self._require_default(field, "spectrum", f"only {spectrum} has it")
        if self.spectrum in ("pierson_moskowitz", "measured"):
            self._require_default("peak_omega", "spectrum", "that spectrum has its own modal frequency")
        if self.spectrum == "measured":
            require(bool(self.spectrum_file), self, "spectrum_file", "a file (spectrum is measured)")
        if self.spectrum == "ochi_hubble" and self.kind in ("shaping_filter", "random_phase"):
            require(
                0.0 < self.second_wave_height < self.significant_wave_height,
                self,
                "second_wave_height",
                "between zero and significant_wave_height, of which it is a part",
            )
        if self.kind == "regular":
            self._require_default("spectrum", "kind", "a regular sea has no spectrum")

    def _check_filter(self) -> None:
        require(self.filter in FILTERS, self, "filter", f"one of {', '.join(FILTERS)}")
        require_integer(self, "filter_order", minimum=2)
        ok = self.filter_order % 2 == 0 and self.filter_order <= LARGEST_FILTER
        require(ok, self, "filter_order", f"even and at most {LARGEST_FILTER}")
        if self.filter == "thesis":
            self._require_default("filter_order", "filter", "the thesis's filter has 6 states")
            if self.kind == "shaping_filter" and not self.is_bretschneider:
                raise ValueError(
                    f"SeaState.filter 'thesis' contradicts SeaState.spectrum {self.spectrum!r}: it is a fit "
                    "to Bretschneider's spectrum; set filter to fitted"
                )

    def _require_default(self, field: str, other: str, reason: str) -> None:
        default = type(self).__dataclass_fields__[field].default
        if getattr(self, field) != default:
            raise ValueError(
                f"SeaState.{field} {getattr(self, field)!r} contradicts SeaState.{other} "
                f"{getattr(self, other)!r}: {reason}; leave {field} at {default!r}"
            )

    @property
    def is_bretschneider(self) -> bool:
        """Whether the spectrum is a member of Bretschneider's two-parameter family."""
        return self.spectrum in ("bretschneider", "pierson_moskowitz")

    @property
    def variance(self) -> float:
        """Variance of the elevation under the true spectrum, Hs²/16 [m²]; of a measured spectrum that gives
        no height see `heave_env.spectra.significant_wave_height`."""
        return self.significant_wave_height**2 / 16.0


def peak_omega_of_zero_crossing_period(zero_crossing_period: float) -> float:
    """Modal frequency of the Bretschneider spectrum whose mean zero-crossing period is given.

    T_z = 2π sqrt(m0/m2) and, for S = A ω⁻⁵ exp(-B ω⁻⁴) with B = 1.25 ω_m⁴, m0/m2 = 1/sqrt(π B).

    Args:
        zero_crossing_period: Mean zero up-crossing period T_z [s].

    Returns:
        ω_m [rad/s].
    """
    zero_crossing_omega = 2.0 * math.pi / zero_crossing_period
    return (zero_crossing_omega**4 / (1.25 * math.pi)) ** 0.25


@dataclass(frozen=True, kw_only=True)
class Vessel:
    """Boom tip behind the sea: a second-order filter, x0'' + 2 ξ ω x0' + ω² x0 = K ω² η.

    Source: Huang (1992), (6.25).
    """

    natural_omega: float
    """ω_v [rad/s]."""
    damping_ratio: float
    """ξ_v [-]."""
    gain: float
    """Boom-tip heave per metre of slow elevation, K_v [-]."""

    def __post_init__(self) -> None:
        require_number(self, "natural_omega", positive=True)
        require_number(self, "damping_ratio", positive=True)
        require_number(self, "gain", positive=True)


@dataclass(frozen=True, kw_only=True)
class VesselTable:
    """Boom tip behind the sea by response amplitude operators (RAOs): heave, roll and pitch from a table.

    Axes x forward, y to port, z up from the table's reference point; rotations are right-handed, so roll is
    positive with port up and pitch with bow down, and the boom tip heaves by heave - x pitch + y roll.
    """

    table: str = "construction_vessel"
    """CSV file of the table (see docs/sea.md), or the name of a shipped one."""
    heading: float = math.pi
    """Where the waves travel to, from the bow towards port [rad]: 0 following, π/2 from starboard, π head."""
    boom_tip_x: float = 0.0
    """Boom tip forward of the reference point [m]."""
    boom_tip_y: float = 0.0
    """Boom tip to port of it [m]."""

    def __post_init__(self) -> None:
        require(isinstance(self.table, str) and bool(self.table), self, "table", "a file or a name")
        for field in ("heading", "boom_tip_x", "boom_tip_y"):
            require_number(self, field)


@dataclass(frozen=True, kw_only=True)
class Winch:
    """Winch behind a pure delay: a first-order lag u' = K (u0(t - delay) - u), or a second-order drive
    u'' + 2 ζ ω u' + ω² u = ω² u0(t - delay), within limits.

    Source: Huang (1992), (6.1) and (6.12); the second order is what his 6.5 asks for.
    """

    time_constant: float | None = None
    """Lag 1/K of a first-order winch [s]; null for a second-order drive."""
    natural_omega: float | None = None
    """ω of a second-order drive [rad/s]; null for a first-order winch."""
    damping_ratio: float = 0.7
    """ζ of a second-order drive [-]."""
    command_range: float
    """Largest commanded displacement |u0| [m]: what an action of one means."""
    command_delay: float = 0.0
    """Pure delay from command to winch [s]; a multiple of the solver's step."""
    command_step: float = 0.0
    """Commands are rounded to whole multiples of this [m]; 0 switches it off."""
    dead_band: float = 0.0
    """The drive rests while |u0 - u| is no larger [m]; 0 switches it off."""
    stroke_limit: float | None = None
    """Largest displacement |u| [m]; null switches the limit off."""
    speed_limit: float | None = None
    """Largest speed |u'| [m/s]; null switches the limit off."""
    acceleration_limit: float | None = None
    """Largest acceleration |u''| [m/s²]; null switches the limit off."""
    power_limit: float | None = None
    """Largest mechanical power, |tension times speed| [W]: the more tension, the less speed; null switches
    the limit off."""
    torque_limit: float | None = None
    """Largest torque of the drive at the drum [N·m]: it carries the tension and accelerates the drum, so the
    more tension, the less it can speed up; beyond it the winch is pulled out. Null switches it off."""
    drum_radius: float | None = None
    """Radius at which the cable leaves the drum [m]; needed by torque_limit."""
    drum_inertia: float | None = None
    """Moment of inertia of drum, gear and motor, as felt at the drum [kg·m²]; needed by torque_limit."""
    efficiency: float = 1.0
    """Mechanical work on the cable over energy drawn from the supply, while hauling [-]."""
    regeneration: float = 0.0
    """Share of the work done by the cable on the winch that returns to the supply, while paying out [-]."""

    def __post_init__(self) -> None:
        require_number(self, "time_constant", positive=True, optional=True)
        require_number(self, "natural_omega", positive=True, optional=True)
        require(
            (self.time_constant is None) != (self.natural_omega is None),
            self,
            "time_constant",
            "given exactly when natural_omega is null: a lag of the first order or a drive of the second",
        )
        require_number(self, "damping_ratio", positive=True)
        require_number(self, "command_range", positive=True)
        require_number(self, "command_delay", non_negative=True)
        require_number(self, "command_step", non_negative=True)
        require_number(self, "dead_band", non_negative=True)
        for limit in ("stroke_limit", "speed_limit", "acceleration_limit", "power_limit", "torque_limit"):
            require_number(self, limit, positive=True, optional=True)
        for size in ("drum_radius", "drum_inertia"):
            require_number(self, size, positive=True, optional=True)
            needed = self.torque_limit is not None
            require(
                (getattr(self, size) is not None) == needed, self, size, "given exactly with torque_limit"
            )
        for share in ("efficiency", "regeneration"):
            require_number(self, share, non_negative=True)
            require(getattr(self, share) <= 1.0, self, share, "a share, at most 1")
        require_number(self, "efficiency", positive=True)
        self._check_contradictions()

    def _check_contradictions(self) -> None:
        reach = f"Winch.command_range {self.command_range:g}"
        if self.dead_band >= self.command_range:
            raise ValueError(
                f"Winch.dead_band {self.dead_band:g} contradicts {reach}: the drive would hardly ever move; "
                "lower dead_band below command_range"
            )
        if self.command_step > 2.0 * self.command_range:
            raise ValueError(
                f"Winch.command_step {self.command_step:g} contradicts {reach}: every command would be "
                "rounded to zero; lower command_step to twice command_range or less"
            )
        own = type(self).__dataclass_fields__["damping_ratio"].default
        if self.natural_omega is None and self.damping_ratio != own:
            raise ValueError(
                f"Winch.damping_ratio {self.damping_ratio:g} contradicts Winch.natural_omega, which is "
                f"null: a first-order winch has no damping ratio; leave damping_ratio at {own}"
            )

    @property
    def is_second_order(self) -> bool:
        """Whether the drive is of the second order."""
        return self.natural_omega is not None

    @property
    def lag(self) -> float:
        """What it trails a slow command by: the time constant, or 2 ζ / ω of a second-order drive [s]."""
        if self.natural_omega is not None:
            return 2.0 * self.damping_ratio / self.natural_omega
        assert self.time_constant is not None
        return self.time_constant

    @property
    def rate_constant(self) -> float:
        """K = 1 / lag [1/s]."""
        return 1.0 / self.lag

    @property
    def is_limited(self) -> bool:
        """Whether any limit, dead band or rounding keeps it from being linear."""
        limits = (self.stroke_limit, self.speed_limit, self.acceleration_limit)
        return any(limit is not None for limit in limits) or self.is_driven

    @property
    def is_driven(self) -> bool:
        """Whether it is more than a lag within limits of stroke, speed and acceleration."""
        limits = (self.power_limit, self.torque_limit)
        return any(limit is not None for limit in limits) or self.command_step > 0.0 or self.dead_band > 0.0


@dataclass(frozen=True, kw_only=True)
class Compensator:
    """Passive compensator between boom tip and sheave: a gas spring and a damper in series with the cable."""

    gas_volume: float
    """Volume of the gas at mid-stroke, accumulators included [m³]."""
    piston_area: float
    """Area of the piston [m²]; volume over area is the length of the gas column."""
    stroke: float
    """From stop to stop [m]."""
    damping: float = 0.0
    """Force per speed of the rod [N·s/m]."""
    moving_mass: float = 0.0
    """Mass of rod and sheave [kg]; its weight is carried by the gas."""
    polytropic_exponent: float = 1.3
    """κ of p V^κ = constant [-]: 1 for slow, 1.4 for fast changes of nitrogen."""
    force: float | None = None
    """Force at mid-stroke [N]; null: the static tension at the sheave, which holds the rod there."""

    def __post_init__(self) -> None:
        for field in ("gas_volume", "piston_area", "stroke", "polytropic_exponent"):
            require_number(self, field, positive=True)
        require_number(self, "damping", non_negative=True)
        require_number(self, "moving_mass", non_negative=True)
        require_number(self, "force", positive=True, optional=True)
        shortest = f"below twice the gas column of {self.gas_length:g} m (gas_volume over piston_area)"
        require(self.stroke < 2.0 * self.gas_length, self, "stroke", shortest)

    @property
    def gas_length(self) -> float:
        """Length of the gas column at mid-stroke, volume over area [m]."""
        return self.gas_volume / self.piston_area

    @property
    def pressure_ratio(self) -> float:
        """Greatest over least gas pressure within the stroke [-]."""
        half = 0.5 * self.stroke / self.gas_length
        return ((1.0 + half) / (1.0 - half)) ** self.polytropic_exponent

    def stiffness(self, force: float) -> float:
        """Slope of the gas spring at mid-stroke, κ F / g [N/m]."""
        return self.polytropic_exponent * force / self.gas_length


@dataclass(frozen=True, kw_only=True)
class Cable:
    """Hoisting cable, uniform along its length; lengths are unstretched."""

    mass_per_length: float
    """Dry mass per length, m [kg/m]."""
    axial_stiffness: float
    """Tension per strain, EA [N]."""
    submerged_weight: float
    """Weight in water per length, w1 [N/m]; negative of a line that floats."""
    diameter: float
    """Drag diameter, d [m]."""
    tangential_drag_coefficient: float = 0.0
    """C_t of Huang's tangential drag (π/2) ρ d C_t |W| W per length [-]."""
    normal_drag_coefficient: float = 1.2
    """C_N of the drag across the cable, (1/2) ρ d C_N |U_N| U_N per length [-]; 1.2 is a bare rope. The
    environment's cable, which moves along itself alone, does not look at it."""
    added_mass_per_length: float = 0.0
    """Added mass in axial motion per length, m_a [kg/m]."""
    normal_added_mass_coefficient: float = 1.0
    """Added mass across the cable over the mass of displaced water [-]; 1 is a circular cylinder. The
    environment's cable does not look at it."""
    axial_damping: float = 0.0
    """Kelvin damping: tension per strain rate, C_A [N·s]."""
    tension_only: bool = False
    """Whether the cable goes slack (T = 0) in place of carrying compression."""
    breaking_strength: float | None = None
    """Tension at which the cable parts and the payload is lost [N]; null: never."""
    quadratic_hardening: float = 0.0
    """k2 of the rope's law T = EA (e + k2 e² + k3 e³) [-]; 0 is Hooke's. Of this and what follows the
    environment and the axial, planar, lumped-mass and static solvers know; others refuse it."""
    cubic_hardening: float = 0.0
    """k3 of the rope's law [-]."""
    relaxing_stiffness: float = 0.0
    """EA1 [N]: what a Maxwell branch beside the spring adds to the stiffness of fast motion; 0: none."""
    relaxation_time: float = 1.0
    """τ in which the tension of that branch relaxes [s]."""

    def __post_init__(self) -> None:
        require_number(self, "mass_per_length", non_negative=True)
        require_number(self, "axial_stiffness", positive=True)
        require_number(self, "submerged_weight")
        require_number(self, "diameter", positive=True)
        require_number(self, "tangential_drag_coefficient", non_negative=True)
        require_number(self, "normal_drag_coefficient", non_negative=True)
        require_number(self, "added_mass_per_length", non_negative=True)
        require_number(self, "normal_added_mass_coefficient", non_negative=True)
        require_number(self, "axial_damping", non_negative=True)
        require_number(self, "breaking_strength", positive=True, optional=True)
        require(isinstance(self.tension_only, bool), self, "tension_only", "true or false")
        require_number(self, "quadratic_hardening")
        require_number(self, "cubic_hardening", non_negative=True)
        require_number(self, "relaxing_stiffness", non_negative=True)
        require_number(self, "relaxation_time", positive=True)
        k2, k3 = self.quadratic_hardening, self.cubic_hardening
        stiffens = k2 == 0.0 or (self.tension_only and k2 > 0.0) or k2**2 < 3.0 * k3
        require(
            stiffens,
            self,
            "quadratic_hardening",
            f"below sqrt(3 cubic_hardening) = {math.sqrt(3.0 * k3):g} in magnitude (above zero any of a "
            "tension_only cable), so that tension grows with strain",
        )

    @property
    def is_hookean(self) -> bool:
        """Whether tension is proportional to strain (and strain rate): neither hardening nor relaxing."""
        return self.quadratic_hardening == self.cubic_hardening == self.relaxing_stiffness == 0.0

    @property
    def inertia_per_length(self) -> float:
        """Dry plus added mass per length, m + m_a [kg/m]."""
        return self.mass_per_length + self.added_mass_per_length

    @property
    def axial_wave_speed(self) -> float:
        """Speed of axial waves, c = sqrt(EA / (m + m_a)) [m/s]; infinite for a massless cable."""
        inertia = self.inertia_per_length
        return math.sqrt(self.axial_stiffness / inertia) if inertia > 0.0 else math.inf

    @property
    def tangential_drag_per_length(self) -> float:
        """Drag along the cable over speed squared, (π/2) ρ d C_t [kg/m²]. Source: Huang (1992), (2.47)."""
        return 0.5 * math.pi * SEAWATER_DENSITY * self.diameter * self.tangential_drag_coefficient

    @property
    def normal_drag_per_length(self) -> float:
        """Drag across the cable over speed squared, (1/2) ρ d C_N [kg/m²]. Source: Huang (1992), (2.46)."""
        return 0.5 * SEAWATER_DENSITY * self.diameter * self.normal_drag_coefficient

    @property
    def normal_added_mass_per_length(self) -> float:
        """Added mass across the cable, C_M ρ π d² / 4 [kg/m]."""
        displaced = 0.25 * math.pi * SEAWATER_DENSITY * self.diameter**2
        return self.normal_added_mass_coefficient * displaced

    @property
    def transverse_inertia_per_length(self) -> float:
        """Mass plus added mass across the cable [kg/m]."""
        return self.mass_per_length + self.normal_added_mass_per_length

    def in_air(self) -> Cable:
        """The same cable in air: its whole weight, no drag, no added mass."""
        return replace(
            self,
            submerged_weight=self.mass_per_length * GRAVITY,
            tangential_drag_coefficient=0.0,
            normal_drag_coefficient=0.0,
            added_mass_per_length=0.0,
            normal_added_mass_coefficient=0.0,
        )


@dataclass(frozen=True, kw_only=True)
class Payload:
    """The subsea unit at the cable's lower end."""

    mass: float
    """Mass in air, M_s [kg]."""
    submerged_weight: float
    """Weight in water, w2 [N]; negative of a float."""
    added_mass: float = 0.0
    """Added mass in heave, M_a [kg]."""
    drag_area: float = 0.0
    """Drag coefficient times projected area in heave, C_d S [m²]."""
    lateral_added_mass: float | None = None
    """Added mass in sway and surge [kg]; null: as in heave. The environment does not look at it."""
    lateral_drag_area: float | None = None
    """Drag coefficient times projected area in sway and surge [m²]; null: as in heave. The environment does
    not look at it."""

    def __post_init__(self) -> None:
        require_number(self, "mass", positive=True)
        require_number(self, "submerged_weight")
        require_number(self, "added_mass", non_negative=True)
        require_number(self, "drag_area", non_negative=True)
        require_number(self, "lateral_added_mass", non_negative=True, optional=True)
        require_number(self, "lateral_drag_area", non_negative=True, optional=True)

    @property
    def inertia(self) -> float:
        """Mass plus added mass [kg]."""
        return self.mass + self.added_mass

    @property
    def drag_factor(self) -> float:
        """Drag over speed squared, (1/2) ρ C_d S [kg/m]. Source: Morison et al. (1950), drag term."""
        return 0.5 * SEAWATER_DENSITY * self.drag_area

    @property
    def lateral_inertia(self) -> float:
        """Mass plus added mass in sway and surge [kg]."""
        return self.inertia if self.lateral_added_mass is None else self.mass + self.lateral_added_mass

    @property
    def lateral_drag_factor(self) -> float:
        """Drag over speed squared in sway and surge, (1/2) ρ C_d S [kg/m]."""
        area = self.drag_area if self.lateral_drag_area is None else self.lateral_drag_area
        return 0.5 * SEAWATER_DENSITY * area

    def in_air(self) -> Payload:
        """The same body in air: its whole weight, no drag, no added mass."""
        return Payload(mass=self.mass, submerged_weight=self.mass * GRAVITY)


@dataclass(frozen=True, kw_only=True)
class Section:
    """A uniform part of a line."""

    cable: Cable
    """What it is made of."""
    length: float
    """Unstretched length [m]."""

    def __post_init__(self) -> None:
        require_number(self, "length", positive=True)


@dataclass(frozen=True, kw_only=True)
class Attachment:
    """A float, clump weight or instrument fixed to a line."""

    arc_length: float
    """Unstretched distance from the line's lower end [m]."""
    body: Payload
    """The body."""

    def __post_init__(self) -> None:
        require_number(self, "arc_length", non_negative=True)


@dataclass(frozen=True, kw_only=True)
class Line:
    """A line of uniform sections with bodies on it; arc length runs unstretched from its lower end up."""

    sections: tuple[Section, ...]
    """The sections, the lowest first."""
    attachments: tuple[Attachment, ...] = ()
    """Bodies along the line; one at its lower end is the payload's business."""

    def __post_init__(self) -> None:
        require(len(self.sections) > 0, self, "sections", "at least one section")
        for attachment in self.attachments:
            if attachment.arc_length > self.length:
                raise ValueError(
                    f"Attachment.arc_length must lie on the line of {self.length:g} m, got "
                    f"{attachment.arc_length!r}"
                )

    @staticmethod
    def uniform(cable: Cable, length: float) -> Line:
        """A line of one section, `length` in m."""
        return Line(sections=(Section(cable=cable, length=length),))

    @property
    def length(self) -> float:
        """Unstretched length [m]."""
        return sum(section.length for section in self.sections)

    @property
    def submerged_weight(self) -> float:
        """Weight in water of sections and attachments [N]."""
        of_sections = sum(section.cable.submerged_weight * section.length for section in self.sections)
        return of_sections + sum(attachment.body.submerged_weight for attachment in self.attachments)


@dataclass(frozen=True, kw_only=True)
class Current:
    """Horizontal current: a profile over depth, times a factor over time, both linear between knots.

    Between knots the velocity's components are interpolated, beyond the first and last the nearest holds.
    Axes: x and y horizontal, z up from the mean surface, depth = -z.
    """

    depth: tuple[float, ...] = (0.0,)
    """Depths of the profile's knots below the mean surface, increasing [m]."""
    speed: tuple[float, ...] = (0.0,)
    """Speed at each knot [m/s]."""
    direction: tuple[float, ...] = (0.0,)
    """Where it flows to at each knot, from x towards y [rad]."""
    time: tuple[float, ...] = (0.0,)
    """Instants of the factor's knots, increasing [s]."""
    factor: tuple[float, ...] = (1.0,)
    """What multiplies the speed at each instant [-]."""

    def __post_init__(self) -> None:
        for field in ("depth", "speed", "direction", "time", "factor"):
            values = getattr(self, field)
            ok = isinstance(values, tuple) and len(values) > 0
            ok = ok and all(isinstance(v, (int, float)) and math.isfinite(v) for v in values)
            require(ok, self, field, "finite numbers, at least one")
        for field in ("depth", "time"):
            values = getattr(self, field)
            increasing = all(a < b for a, b in itertools.pairwise(values))
            require(increasing, self, field, "numbers that increase")
        for field, knots in (("speed", self.depth), ("direction", self.depth), ("factor", self.time)):
            wanted = f"{len(knots)} numbers, one at each knot"
            require(len(getattr(self, field)) == len(knots), self, field, wanted)

    @staticmethod
    def uniform(speed: float, direction: float = 0.0) -> Current:
        """The same current everywhere and always; m/s and rad."""
        return Current(speed=(speed,), direction=(direction,))


@dataclass(frozen=True, kw_only=True)
class LinearPayload:
    """Cable and payload as the thesis's second-order model, a x'' + b x' + x = x0 + u.

    Source: Huang (1992), (6.4).
    """

    inertia: float
    """a [s²]."""
    damping: float
    """b [s]."""

    def __post_init__(self) -> None:
        require_number(self, "inertia", positive=True)
        require_number(self, "damping", positive=True)

    @property
    def natural_omega(self) -> float:
        """Undamped natural frequency, 1/sqrt(a) [rad/s]."""
        return self.inertia**-0.5


@dataclass(frozen=True, kw_only=True)
class PayOut:
    """Cable paid out by the operation at constant speed, apart from any compensation."""

    speed: float = 0.0
    """Pay-out rate while it runs, positive outwards, negative for recovery [m/s]."""
    start: float = 0.0
    """When it begins [s]."""
    distance: float = 0.0
    """Cable paid out in all, a magnitude [m]."""
    ramp: float = 0.0
    """How long the winch takes to reach the speed, and to stop [s]."""

    def __post_init__(self) -> None:
        require_number(self, "speed")
        require_number(self, "ramp", non_negative=True)
        require_number(self, "start", non_negative=True)
        require_number(self, "distance", non_negative=True)
        require(
            (self.speed == 0.0) == (self.distance == 0.0),
            self,
            "speed",
            "zero exactly when distance is zero",
        )


DISTRIBUTIONS = ("uniform", "log_uniform", "normal")


@dataclass(frozen=True, kw_only=True)
class Draw:
    """A number of the scenario that is drawn anew for each episode; controllers know the scenario's own."""

    parameter: str
    """Dotted path of the number, as `winch.time_constant` or `sea_state.significant_wave_height`."""
    distribution: str = "uniform"
    """`uniform`, `log_uniform`, or `normal`: about the middle, a quarter of the range as its standard
    deviation, within the range."""
    low: float
    """Smallest value, in the parameter's own unit."""
    high: float
    """Largest value, in the parameter's own unit."""

    def __post_init__(self) -> None:
        known = f"one of {', '.join(DISTRIBUTIONS)}"
        require(self.distribution in DISTRIBUTIONS, self, "distribution", known)
        require_number(self, "low", positive=self.distribution == "log_uniform")
        require_number(self, "high")
        require(self.high >= self.low, self, "high", f"no less than low ({self.low!r})")

    def quantile(self, share: float) -> float:
        """The value below which a share of the distribution lies, `share` within (0, 1)."""
        if self.distribution == "log_uniform":
            return self.low * (self.high / self.low) ** share
        if self.distribution == "normal":
            # Two standard deviations on either side: the part of the bell that lies within.
            bell = statistics.NormalDist(0.5, 0.25)
            outside = bell.cdf(0.0)
            share = bell.inv_cdf(outside + share * (1.0 - 2.0 * outside))
        return self.low + share * (self.high - self.low)

    def scaled(self, value: float) -> float:
        """The value as -1 at the lower and +1 at the upper end of its range."""
        width = self.high - self.low
        return 2.0 * (value - self.low) / width - 1.0 if width > 0.0 else 0.0
