"""Lowering and recovering a payload on a vertical cable: loads, speeds and lengths to keep to.

Arc length s is unstretched and runs from the payload (s = 0) to the sheave (s = length); pay-out is positive
outwards, motion positive up. Paid out at a constant rate V the cable carries

    quasi-static   T(s) = w2 + w1 s - (D + c s) |V| V,   D = (1/2) ρ C_d S,   c = (π/2) ρ d C_t

and while the sheave moves with the sea, the velocity of the material being v(s, t) = -V + ∂u/∂t,

    rigid bar      T(s) = w2 + w1 s + (D + c s) |v| v + (M + m s) dv/dt
    elastic rod    m ∂²u/∂t² = EA ∂²u/∂s² - c (|v| v)',  M ∂²u/∂t² = T' - D (|v| v)' at s = 0,  T' = EA ∂u/∂s

with primes for what departs from the mean, drag linearised about V and the motion: in a regular sea by its
first harmonic, in a random sea in the mean square. In a regular sea the higher harmonics of the drag are put
back as forces on the linear rod. Both hold while the cable is taut everywhere. Where it is not, the payload
falls free and the cable snaps taut,

    taut    k (X1 - X2) - D |X2'| X2' = M X2'',   T = w2 + k (X1 - X2),   k = EA / L
    slack   -w2 - D |X2'| X2' = M X2''

which `Lowering.simulate` marches with the axial solver: one massless element is this very model, more of them
are the cable with its own mass.

Source: Berteaux, chapter 9, (9.1)-(9.9). His (9.7) lacks the dots over X2 and his V is positive in hauling.

Assumed: vertical cable, no current, the same drag area up and down (a body that differs gets one `Lowering`
for either way). It stops holding where the cable leans, where payload and sheave are near each other or the
surface, and, for the linearised sea response, where tension vanishes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from heave_env.cable.axial import AxialSolver
from heave_env.cable.closed_form import payload_response
from heave_env.cable.constitutive import require_hookean
from heave_env.cable.convergence import ConvergenceError
from heave_env.parameters import Cable, Payload, SeaState, Vessel, require_number
from heave_env.vessel import boom_tip_lines

Array = np.ndarray

_N_PHASES = 256
_N_HARMONICS = 15
_N_LINES = 400


@dataclass(frozen=True)
class TensionProfile:
    """Tension along a cable at one rate of pay-out; arrays of shape (n_points,)."""

    arc_length: Array
    """Unstretched distance from the payload [m]."""
    tension: Array
    """Tension [N]; negative where the straight cable would be pushed, that is, where it goes slack."""
    elongation: Array
    """Stretch of the cable between the payload and here [m]."""


@dataclass(frozen=True)
class SeaTension:
    """Tension while the sheave moves with the sea; arrays of shape (n_points,)."""

    arc_length: Array
    """Unstretched distance from the payload [m]."""
    mean: Array
    """Mean tension [N]."""
    amplitude: Array
    """Half the range in a regular sea; the significant amplitude, two standard deviations, in a random
    one [N]."""
    highest: Array
    """Greatest tension in a regular sea; in a random one the expected greatest of the exposure [N]."""
    lowest: Array
    """The same for the least; negative where the cable goes slack [N]."""
    payload_heave: float
    """Amplitude, or significant amplitude, of the payload's motion [m]."""

    @property
    def peak(self) -> float:
        """Greatest tension anywhere [N]."""
        return float(self.highest.max())

    @property
    def least(self) -> float:
        """Least tension anywhere [N]."""
        return float(self.lowest.min())

    @property
    def stays_taut(self) -> bool:
        """Whether the tension stays positive everywhere; if not, these numbers do not hold: simulate."""
        return self.least > 0.0


@dataclass(frozen=True)
class PeakTensions:
    """Peak tension against length and sea state."""

    length: Array
    """Unstretched lengths [m], (n_lengths,)."""
    peak: Array
    """Greatest tension anywhere in the cable [N], (n_sea_states, n_lengths)."""
    least: Array
    """Least tension anywhere in the cable [N], (n_sea_states, n_lengths); negative where it goes slack."""


@dataclass(frozen=True)
class PayoutLimits:
    """Recommended limits of the pay-out rate against length and sea state."""

    length: Array
    """Unstretched lengths [m], (n_lengths,)."""
    rate: Array
    """Largest pay-out rate that keeps the margin everywhere along the cable [m/s], (n_sea_states, n_lengths);
    zero where not even a stopped winch keeps it, infinite where nothing drags."""


@dataclass(frozen=True)
class LoweringRecord:
    """What a march recorded; positive up, each of shape (n_steps + 1,)."""

    time: Array
    """Instants [s]."""
    sheave_heave: Array
    """Heave of the sheave [m]."""
    payload_heave: Array
    """Payload above where it would hang still below a sheave at heave zero, at the same length [m]."""
    payload_velocity: Array
    """Absolute velocity of the payload [m/s]."""
    payload_tension: Array
    """Tension at the payload [N]."""
    sheave_tension: Array
    """Tension at the sheave [N]; of a massless spring that at the payload and the cable's weight."""

    def after(self, time: float) -> LoweringRecord:
        """The part from an instant [s] on, to leave the transient behind."""
        kept = self.time >= time
        if not kept.any():
            raise ValueError(f"time must lie within the record of {self.time[-1]:g} s, got {time:g} s")
        fields = (getattr(self, name) for name in self.__dataclass_fields__)
        return LoweringRecord(*(values[kept] for values in fields))

    @property
    def peak_tension(self) -> float:
        """Greatest tension at the payload [N]."""
        return float(self.payload_tension.max())

    @property
    def slack_share(self) -> float:
        """Share of the time without tension at the payload [-]."""
        return float(np.mean(self.payload_tension <= 0.0))

    @property
    def n_snaps(self) -> int:
        """How often the cable comes taut again [-]."""
        slack = self.payload_tension <= 0.0
        return int(np.sum(slack[:-1] & ~slack[1:]))


def drag_in_regular_motion(velocity: float, amplitude: float) -> tuple[float, float]:
    """Mean of |v| v and its first harmonic over the amplitude, for v = velocity + amplitude cos φ.

    At rest in the mean the second is (8/3π) amplitude; where the velocity never turns, 2 |velocity|.

    Args:
        velocity: Mean velocity [m/s].
        amplitude: Amplitude of the oscillation, not negative [m/s].

    Returns:
        Mean [m²/s²] and equivalent linear coefficient [m/s].
    """
    if amplitude <= abs(velocity):
        return math.copysign(velocity**2 + 0.5 * amplitude**2, velocity), 2.0 * abs(velocity)
    r = velocity / amplitude
    turn = math.acos(-r)  # the velocity is positive for |φ| below this
    sine, cosine = math.sin(turn), -r
    mean = (r * r + 0.5) * (2.0 * turn - math.pi) + 4.0 * r * sine + sine * cosine
    first = 2.0 * (r * r * sine + r * (turn + sine * cosine) + sine - sine**3 / 3.0) - math.pi * r
    return mean / math.pi * amplitude**2, 2.0 * first / math.pi * amplitude


def drag_in_random_motion(velocity: float, std: float) -> tuple[float, float]:
    """Mean of |v| v and its slope in the mean square, for Gaussian v of this mean and standard deviation.

    E[|v| v] and 2 E[|v|]; at rest in the mean the second is sqrt(8/π) std.

    Args:
        velocity: Mean velocity [m/s].
        std: Standard deviation, not negative [m/s].

    Returns:
        Mean [m²/s²] and equivalent linear coefficient [m/s].
    """
    if std == 0.0:
        return abs(velocity) * velocity, 2.0 * abs(velocity)
    r = velocity / std
    odd = math.erf(r / math.sqrt(2.0))
    density = math.exp(-0.5 * r * r) / math.sqrt(2.0 * math.pi)
    mean = ((r * r + 1.0) * odd + 2.0 * r * density) * std**2
    return mean, 2.0 * (r * odd + 2.0 * density) * std


def expected_extreme(duration: Array | float, zero_crossing_period: Array | float) -> Array:
    """Expected greatest value of a Gaussian process over its standard deviation [-].

    g = sqrt(2 ln N) + 0.5772 / sqrt(2 ln N), N = duration / T_z (and at least e)

    Source: Davenport (1964).
    """
    n = np.maximum(np.asarray(duration) / zero_crossing_period, math.e)
    root = np.sqrt(2.0 * np.log(n))
    return np.asarray(root + np.euler_gamma / root)


@dataclass(frozen=True)
class ElasticRod:
    """Cable and payload as a linear rod: what its ends' motion and forces do at given frequencies."""

    omega: Array
    cable: Cable
    payload: Payload
    length: float
    payload_damping: float
    cable_damping: float

    @property
    def payload_over_sheave(self) -> Array:
        """Payload's motion over the sheave's, (n_omega,)."""
        return payload_response(
            self.omega,
            self.cable,
            self.payload,
            self.length,
            payload_damping=self.payload_damping,
            cable_damping=self.cable_damping,
        )

    def _wave_number(self) -> tuple[Array, Array]:
        w = self.omega
        line = self.cable.inertia_per_length * w**2 - 1j * w * self.cable_damping
        return line, np.sqrt(line / (self.cable.axial_stiffness + 1j * w * self.cable.axial_damping))

    def tension_over_sheave(self, arc_length: Array) -> Array:
        """Tension over the sheave's motion, (n_points, n_omega) [N/m].

        T(s) = -U0 (E* k sin ks + (M ω² - i ω b) cos ks), U0 the payload's motion.
        """
        w, s = self.omega, np.asarray(arc_length)[:, None]
        line, k = self._wave_number()
        end = self.payload.inertia * w**2 - 1j * w * self.payload_damping
        of_line = line * s * np.sinc(k * s / math.pi)
        return np.asarray(-self.payload_over_sheave * (of_line + end * np.cos(k * s)))

    def tension_over_payload_force(self, arc_length: Array) -> Array:
        """Tension over a force that pulls the payload down, sheave held, (n_points, n_omega) [-]."""
        _, k = self._wave_number()
        return np.asarray(
            self.payload_over_sheave * np.cos(k * (self.length - np.asarray(arc_length)[:, None]))
        )


@dataclass(frozen=True, kw_only=True)
class Lowering:
    """Mechanics of one payload on one kind of cable; lengths and rates are the functions' arguments.

    Quasi-static answers are closed forms and take arrays of lengths. The response to the sea is that of the
    elastic rod with an end mass, exact but for the linearised drag. `simulate` is the axial solver: implicit
    midpoint with the discrete-gradient tension, second order while taut.
    """

    cable: Cable
    """The cable; what drags along it counts, its normal drag does not."""
    payload: Payload
    """The body at its lower end, heavier than water."""

    def __post_init__(self) -> None:
        require_hookean(self.cable)
        require_number(self.payload, "submerged_weight", positive=True)

    # ---- static and quasi-static ----

    def tension(self, arc_length: Array | float, payout_rate: float = 0.0) -> Array:
        """Tension at a point, w2 + w1 s - (D + c s) |V| V; that at the sheave for s = length.

        Source: Berteaux, (9.2), with V positive in lowering.

        Args:
            arc_length: Unstretched distance from the payload [m], any shape.
            payout_rate: V, positive outwards, negative in hauling [m/s].

        Returns:
            Tension [N], same shape; negative where the cable goes slack.
        """
        s = _lengths("arc_length", arc_length)
        speed_squared = abs(_finite("payout_rate", payout_rate)) * payout_rate
        weight = self.payload.submerged_weight + self.cable.submerged_weight * s
        return np.asarray(weight - self._drag_factor(s) * speed_squared)

    def profile(self, length: float, payout_rate: float = 0.0, n_points: int = 101) -> TensionProfile:
        """Tension and stretch along a cable of `length` [m]; `payout_rate` [m/s] as in `tension`."""
        s = _points(length, n_points)
        return TensionProfile(s, self.tension(s, payout_rate), self.elongation(s, payout_rate))

    def elongation(self, length: Array | float, payout_rate: float = 0.0) -> Array:
        """Stretch of the lowest `length` of the cable, mean tension times L / EA [m], same shape."""
        L = _lengths("length", length)
        return np.asarray(L * self.tension(0.5 * L, payout_rate) / self.cable.axial_stiffness)

    def safety_factor(self, length: Array | float, payout_rate: float = 0.0) -> Array:
        """Breaking strength over the greatest tension of the cable [-], shape of `length`.

        Raises:
            ValueError: If the cable has no breaking strength.
        """
        greatest = np.maximum(self.tension(length, payout_rate), self.tension(0.0, payout_rate))
        with np.errstate(divide="ignore"):
            return np.asarray(self._strength() / np.maximum(greatest, 0.0))

    def greatest_length(self, safety_factor: float = 2.0, payout_rate: float = 0.0) -> float:
        """Length at which the tension at the sheave is the breaking strength over `safety_factor` [m].

        Zero if the payload alone is too heavy; infinite if length does not add to the tension.

        Raises:
            ValueError: If the cable has no breaking strength, or the factor is not above zero.
        """
        spare = self._strength() / _positive("safety_factor", safety_factor) - float(
            self.tension(0.0, payout_rate)
        )
        if spare <= 0.0:
            return 0.0
        per_length = float(self.tension(1.0, payout_rate) - self.tension(0.0, payout_rate))
        return spare / per_length if per_length > 0.0 else math.inf

    def terminal_velocity(self, length: Array | float = 0.0) -> Array:
        """Speed at which drag balances the weight of payload and cable together [m/s], shape of `length`.

        V = sqrt((w2 + w1 L) / (D + c L)); of the payload alone at length zero. Infinite without drag, zero
        where the cable's buoyancy outweighs the payload.

        Source: Berteaux, (9.3).
        """
        L = _lengths("length", length)
        weight = np.maximum(self.payload.submerged_weight + self.cable.submerged_weight * L, 0.0)
        with np.errstate(divide="ignore"):
            return np.asarray(np.sqrt(weight / self._drag_factor(L)))

    def slack_length(self, payout_rate: float) -> float:
        """Length at which a cable paid out at this rate goes slack, from T(s) = 0 [m].

        Zero if the payload itself falls no faster: the cable then overrides it at any length. Infinite if no
        length goes slack.

        Source: Berteaux, (9.2) with T(s) = 0.
        """
        at_payload = float(self.tension(0.0, payout_rate))
        per_length = float(self.tension(1.0, payout_rate)) - at_payload
        if at_payload <= 0.0:
            return 0.0
        return -at_payload / per_length if per_length < 0.0 else math.inf

    # ---- inertia ----

    def virtual_mass(self, length: Array | float = 0.0) -> Array:
        """Mass and added mass of the payload and of `length` of cable [kg], shape of `length`.

        Source: Berteaux, section 3.4.
        """
        return np.asarray(self.payload.inertia + self.cable.inertia_per_length * _lengths("length", length))

    def inertia_force(self, acceleration: float, length: Array | float = 0.0) -> Array:
        """Force that accelerates payload and cable upwards as one, m_v a [N]; `acceleration` in m/s²."""
        return np.asarray(self.virtual_mass(length) * _finite("acceleration", acceleration))

    def rigid_peak_tension(
        self, length: Array | float, amplitude: float, omega: float, payout_rate: float = 0.0
    ) -> Array:
        """Peak tension at the sheave if cable and payload follow it as a rigid bar [N], shape of `length`.

        The greatest of T(s, t) over a period of the sheave's motion a sin ωt, hauling included at every
        instant (the source adds it at the instant of the greatest tension without hauling).

        Source: Berteaux, (9.5).

        Args:
            length: Unstretched length [m], any shape.
            amplitude: Amplitude of the sheave's heave [m].
            omega: Its frequency [rad/s].
            payout_rate: Positive outwards, negative in hauling [m/s].
        """
        L = _lengths("length", length)[..., None]
        phase = np.linspace(0.0, 2.0 * math.pi, 1440, endpoint=False)
        speed = amplitude * omega * np.cos(phase) - payout_rate
        acceleration = -amplitude * omega**2 * np.sin(phase)
        dynamic = self._drag_factor(L) * np.abs(speed) * speed + self.virtual_mass(L) * acceleration
        return np.asarray(self.tension(L[..., 0]) + dynamic.max(axis=-1))

    # ---- in a sea ----

    def in_sea(
        self,
        length: float,
        sea_state: SeaState,
        *,
        vessel: Vessel | None = None,
        payout_rate: float = 0.0,
        exposure: float = 3600.0,
        n_points: int = 21,
    ) -> SeaTension:
        """Tension along an elastic cable while the sheave moves with the sea.

        Args:
            length: Unstretched length [m].
            sea_state: The sea; a regular one gives amplitudes, any other significant and extreme values.
            vessel: Boom tip behind the sea; without one the sheave follows the elevation.
            payout_rate: Positive outwards, negative in hauling [m/s].
            exposure: How long a random sea acts, for its extremes [s].
            n_points: Points along the cable.

        Raises:
            ValueError: If length or exposure is not positive.
            ConvergenceError: If the rod resonates and nothing damps it.
        """
        s = _points(length, n_points)
        _positive("exposure", exposure)
        _finite("payout_rate", payout_rate)
        omega, variance = sheave_lines(sea_state, vessel)
        return self._in_sea(s, omega, variance, sea_state.kind == "regular", payout_rate, exposure)

    def peak_tensions(
        self,
        lengths: Sequence[float] | Array,
        sea_states: Sequence[SeaState],
        *,
        vessel: Vessel | None = None,
        payout_rate: float = 0.0,
        exposure: float = 3600.0,
    ) -> PeakTensions:
        """Peak tension against length and sea state; arguments as of `in_sea`."""
        L = _lengths("lengths", lengths)
        _positive("exposure", exposure)
        _finite("payout_rate", payout_rate)
        found = []
        for sea in sea_states:
            lines = (*sheave_lines(sea, vessel), sea.kind == "regular", payout_rate, exposure)
            found.append([self._in_sea(_points(float(length), 21), *lines) for length in L])
        peak = np.array([[tension.peak for tension in row] for row in found])
        return PeakTensions(L, peak, np.array([[tension.least for tension in row] for row in found]))

    def payout_limits(
        self,
        lengths: Sequence[float] | Array,
        sea_states: Sequence[SeaState],
        *,
        margin: float = 0.2,
        vessel: Vessel | None = None,
        exposure: float = 3600.0,
    ) -> PayoutLimits:
        """Largest pay-out rates that keep the cable taut with a margin, against length and sea state.

        At each rate up to the limit the least tension anywhere is at least `margin` times the payload's
        submerged weight.

        Source: the recommendation of Berteaux, section 4.2.2.

        Args:
            lengths: Unstretched lengths [m], (n_lengths,).
            sea_states: The seas, (n_sea_states,).
            margin: Least tension over the payload's submerged weight, in [0, 1) [-].
            vessel: Boom tip behind the sea; without one the sheave follows the elevation.
            exposure: How long a random sea acts, for its extremes [s].
        """
        if not 0.0 <= margin < 1.0:
            raise ValueError(f"margin must be at least 0 and below 1, got {margin!r}")
        _positive("exposure", exposure)
        L = _lengths("lengths", lengths)
        rate = np.empty((len(sea_states), len(L)))
        for i, sea in enumerate(sea_states):
            lines = (*sheave_lines(sea, vessel), sea.kind == "regular")
            for j, length in enumerate(L):
                rate[i, j] = self._payout_limit(_positive("lengths", float(length)), lines, margin, exposure)
        return PayoutLimits(L, rate)

    # ---- slack and snap ----

    def spring_constant(self, length: float) -> float:
        """Stiffness of the cable, k = EA / L [N/m]. Source: Berteaux, (9.6)."""
        return self.cable.axial_stiffness / _positive("length", length)

    def free_fall_speed(self, distance: Array | float) -> Array:
        """Speed of the payload after falling from rest on a slack cable [m/s], shape of `distance`.

        v² = (w2 / D) (1 - exp(-2 D h / M)), and 2 w2 h / M without drag; the solution of (9.9).

        Source: Berteaux, (9.9).
        """
        h = _lengths("distance", distance)
        D, M, w2 = self.payload.drag_factor, self.payload.inertia, self.payload.submerged_weight
        if D == 0.0:
            return np.asarray(np.sqrt(2.0 * w2 * h / M))
        return np.asarray(np.sqrt(-w2 / D * np.expm1(-2.0 * D * h / M)))

    def snap_tension(self, length: float, impact_speed: Array | float) -> Array:
        """Peak tension when a cable comes taut while payload and sheave part at `impact_speed` [N].

        T = w2 + sqrt(w2² + k M v²): all energy of the impact goes into the massless spring; drag during the
        snap only lowers it.

        Args:
            length: Unstretched length [m].
            impact_speed: Speed at which the ends part when the cable comes taut [m/s], any shape.

        Returns:
            Tension [N], shape of `impact_speed`.
        """
        v, w2 = np.asarray(impact_speed, dtype=float), self.payload.submerged_weight
        stiffness = self.spring_constant(length)
        return np.asarray(w2 + np.sqrt(w2**2 + stiffness * self.payload.inertia * v**2))

    def simulate(
        self,
        length: Array | float,
        sheave_heave: Array,
        dt: float,
        *,
        n_elements: int = 1,
        cable_mass_share: float = 0.0,
    ) -> LoweringRecord:
        """Marches payload and cable from rest through a motion of the sheave, slack and snaps included.

        Source: Berteaux, (9.6)-(9.9), integrated by the midpoint rule in place of Euler's.

        Args:
            length: Unstretched length [m], constant or at each instant, (n_steps + 1,).
            sheave_heave: Heave of the sheave at each instant, positive up [m], (n_steps + 1,).
            dt: Time step [s]; a hundredth of a period, or of the time a snap takes.
            n_elements: 1 takes the cable as a massless spring, more as a rod with its mass, weight and drag,
                which wants Kelvin damping (`Cable.axial_damping`).
            cable_mass_share: Share of the cable's mass that a massless spring adds to the payload, in [0, 1]
                [-]: 0 is the source's model, 1/3 a slow spring's.

        Raises:
            ValueError: If an argument is impossible.
            ConvergenceError: If a step's equations were not met: take a smaller `dt`.
        """
        heave = np.asarray(sheave_heave, dtype=float)
        lengths = np.broadcast_to(_lengths("length", length), heave.shape)
        if heave.ndim != 1 or len(heave) < 2 or not np.isfinite(heave).all():
            raise ValueError("sheave_heave must be one series of at least two finite numbers")
        _positive("dt", dt)
        if not (lengths > 0.0).all():
            raise ValueError(f"length must stay positive, got {float(lengths.min()):g} m")
        if not 0.0 <= cable_mass_share <= 1.0:
            raise ValueError(f"cable_mass_share must lie in [0, 1], got {cable_mass_share!r}")
        if n_elements > 1 and self.cable.axial_damping <= 0.0:
            raise ValueError(
                "Cable.axial_damping must be positive for a cable of several elements that may go slack, got "
                f"{self.cable.axial_damping!r}: EA times some milliseconds"
            )
        solver = self._spring(cable_mass_share, float(lengths[0])) if n_elements == 1 else None
        if solver is None:
            cable = replace(self.cable, tension_only=True)
            solver = AxialSolver(
                cable=cable,
                payload=self.payload,
                length=float(lengths[0]),
                n_elements=n_elements,
                n_iterations=12,
            )
        found = solver.simulate(heave, dt, np.array(lengths))
        _check(solver, found.payload_velocity, found.payload_tension, dt)
        hanging = self.cable.submerged_weight * lengths if n_elements == 1 else 0.0
        return LoweringRecord(
            time=found.time,
            sheave_heave=heave.copy(),
            payload_heave=found.payload_displacement,
            payload_velocity=found.payload_velocity,
            payload_tension=found.payload_tension,
            sheave_tension=np.asarray(found.sheave_tension + hanging),
        )

    # ---- inside ----

    def _drag_factor(self, length: Array) -> Array:
        return self.payload.drag_factor + self.cable.tangential_drag_per_length * length

    def _strength(self) -> float:
        strength = self.cable.breaking_strength
        if strength is None:
            raise ValueError("Cable.breaking_strength must be given for a factor of safety, got null")
        return strength

    def _spring(self, cable_mass_share: float, length: float) -> AxialSolver:
        added = cable_mass_share * self.cable.mass_per_length * length
        return AxialSolver(
            cable=Cable(
                mass_per_length=0.0,
                axial_stiffness=self.cable.axial_stiffness,
                submerged_weight=0.0,
                diameter=self.cable.diameter,
                tension_only=True,
            ),
            payload=replace(self.payload, mass=self.payload.mass + added),
            length=length,
            n_elements=1,
            n_iterations=12,
        )

    def _payout_limit(
        self, length: float, lines: tuple[Array, Array, bool], margin: float, exposure: float
    ) -> float:
        s = np.linspace(0.0, length, 11)
        least = margin * self.payload.submerged_weight

        def spare(rate: float) -> float:
            return self._in_sea(s, *lines, rate, exposure).least - least

        # In calm water the tension runs straight from end to end, and no sea lets more go out.
        ends = np.array([0.0, length])
        with np.errstate(divide="ignore"):
            speed_squared = np.maximum(self.tension(ends) - least, 0.0) / self._drag_factor(ends)
        in_calm = math.sqrt(float(speed_squared.min()))
        if in_calm == 0.0 or spare(0.0) < 0.0:
            return 0.0
        if math.isinf(in_calm) or not np.any(lines[1] > 0.0):
            return in_calm
        low = 0.0
        for high in np.linspace(0.0, in_calm, 7)[1:]:
            if spare(float(high)) < 0.0:
                return float(brentq(spare, low, float(high), xtol=1e-6 * in_calm))
            low = float(high)
        return in_calm

    def _settled(
        self, length: float, omega: Array, variance: Array, regular: bool, payout_rate: float
    ) -> tuple[ElasticRod, float, float]:
        """The rod with the damping that its own motion causes, and the mean drags of payload and cable."""
        top = math.sqrt(float(np.sum(variance * omega**2)))

        def drag(std: float) -> tuple[float, float]:
            if regular:
                return drag_in_regular_motion(-payout_rate, math.sqrt(2.0) * std)
            return drag_in_random_motion(-payout_rate, std)

        def rod(std: float) -> ElasticRod:
            b = self.payload.drag_factor * drag(std)[1]
            c = self.cable.tangential_drag_per_length * drag(0.5 * (std + top))[1]
            return ElasticRod(omega, self.cable, self.payload, length, b, c)

        def excess(std: float) -> float:
            response = rod(std).payload_over_sheave
            return math.sqrt(float(np.sum(variance * np.abs(omega * response) ** 2))) - std

        # More motion, more damping, less motion: one root.
        low, high = 1e-9 * top, 2.0 * top
        for _ in range(40):
            if excess(high) < 0.0:
                break
            high *= 2.0
        else:
            raise ConvergenceError(
                "the cable resonates with the sea and nothing damps it: give it drag", excess(high)
            )
        std = low if excess(low) <= 0.0 else float(brentq(excess, low, high, xtol=1e-10 * top, rtol=1e-10))
        return rod(std), drag(std)[0], drag(0.5 * (std + top))[0]

    def _in_sea(
        self,
        s: Array,
        omega: Array,
        variance: Array,
        regular: bool,
        payout_rate: float,
        exposure: float,
    ) -> SeaTension:
        if not np.any(variance > 0.0):
            calm = self.tension(s, payout_rate)
            return SeaTension(s, calm, np.zeros_like(s), calm.copy(), calm.copy(), 0.0)
        rod, payload_drag, cable_drag = self._settled(float(s[-1]), omega, variance, regular, payout_rate)
        D, c = self.payload.drag_factor, self.cable.tangential_drag_per_length
        mean = self.tension(s) + D * payload_drag + c * s * cable_drag
        heave = math.sqrt(float(np.sum(variance * np.abs(rod.payload_over_sheave) ** 2)))
        if regular:
            departure = self._over_a_period(rod, s, math.sqrt(2.0 * float(variance[0])), payout_rate)
            above, below = departure.max(axis=1), departure.min(axis=1)
            amplitude, heave = 0.5 * (above - below), math.sqrt(2.0) * heave
        else:
            power = variance * np.abs(rod.tension_over_sheave(s)) ** 2
            m0, m2 = power.sum(axis=1), (power * omega**2).sum(axis=1)
            std = np.sqrt(m0)
            with np.errstate(invalid="ignore"):
                period = np.where(m0 > 0.0, 2.0 * math.pi * np.sqrt(m0 / m2), exposure)
            above = expected_extreme(exposure, period) * std
            below, amplitude, heave = -above, 2.0 * std, 2.0 * heave
        return SeaTension(s, mean, amplitude, mean + above, mean + below, heave)

    def _over_a_period(self, rod: ElasticRod, s: Array, amplitude: float, payout_rate: float) -> Array:
        """Departure of the tension from its mean over a period of a regular sea, (n_points, n_phases) [N].

        The linear response, and the harmonics of the drag beyond the first as forces on the linear rod: the
        payload's at the payload, the cable's shared out between its ends.
        """
        omega, response = float(rod.omega[0]), complex(rod.payload_over_sheave[0])
        phase = 2.0 * math.pi * np.arange(_N_PHASES) / _N_PHASES
        turning = np.exp(1j * phase)
        departure = np.real(amplitude * rod.tension_over_sheave(s) * turning)

        def harmonics(motion: complex) -> Array:
            speed = np.real(1j * omega * amplitude * motion * turning) - payout_rate
            return np.asarray(2.0 / _N_PHASES * np.fft.rfft(np.abs(speed) * speed)[2 : _N_HARMONICS + 1])

        order = np.arange(2, _N_HARMONICS + 1)
        higher = replace(rod, omega=order * omega)
        c, L = self.cable.tangential_drag_per_length, rod.length
        of_cable = c * harmonics(0.5 * (1.0 + response))
        at_payload = self.payload.drag_factor * harmonics(response) + 0.5 * L * of_cable
        force = at_payload * higher.tension_over_payload_force(s) + (s[:, None] - 0.5 * L) * of_cable
        return np.asarray(departure + np.real(force @ np.exp(1j * order[:, None] * phase)))


def sheave_lines(sea_state: SeaState, vessel: Vessel | None) -> tuple[Array, Array]:
    """The sheave's heave as at most 400 lines: frequencies [rad/s] and the variance at each [m²].

    Neighbours in the fine slices of a spectrum are put together at their centre of variance; a regular sea
    has one line, a calm none.
    """
    omega, variance = boom_tip_lines(sea_state, vessel)
    kept = variance > 1e-15 * variance.max(initial=0.0)
    omega, variance = omega[kept], variance[kept]
    if len(omega) <= _N_LINES:
        return omega, variance
    starts = np.linspace(0, len(omega), _N_LINES, endpoint=False).astype(int)
    together = np.add.reduceat(variance, starts)
    return np.add.reduceat(variance * omega, starts) / together, together


def _finite(name: str, value: float) -> float:
    if not math.isfinite(value):
        raise ValueError(f"{name} must be a finite number, got {value!r}")
    return value


def _positive(name: str, value: float) -> float:
    if not (math.isfinite(value) and value > 0.0):
        raise ValueError(f"{name} must be a positive number, got {value!r}")
    return value


def _points(length: float, n_points: int) -> Array:
    if n_points < 2:
        raise ValueError(f"n_points must be at least 2, got {n_points!r}")
    return np.linspace(0.0, _positive("length", length), n_points)


def _lengths(name: str, values: Array | Sequence[float] | float) -> Array:
    lengths = np.asarray(values, dtype=float)
    if not (np.isfinite(lengths).all() and (lengths >= 0.0).all()):
        raise ValueError(f"{name} must be finite and not negative, got {float(lengths.min())!r} m")
    return lengths


def _check(solver: AxialSolver, velocity: Array, tension: Array, dt: float) -> None:
    """Raises `ConvergenceError` unless the march is finite and a spring's momentum balances in each step."""
    if not (np.isfinite(velocity).all() and np.isfinite(tension).all()):
        raise ConvergenceError(f"the march left the finite numbers: take dt below {dt:g} s", math.inf)
    if solver.n_elements > 1:
        return
    body = solver.payload
    middle = 0.5 * (velocity[1:] + velocity[:-1])
    force = tension[1:] - body.submerged_weight - body.drag_factor * np.abs(middle) * middle
    residual = float(np.abs(body.inertia * np.diff(velocity) / dt - force).max())
    if residual > 1e-6 * max(float(tension.max()), body.submerged_weight):
        raise ConvergenceError(
            f"a snap is not resolved by steps of {dt:g} s, force left over in N: take a smaller dt", residual
        )
