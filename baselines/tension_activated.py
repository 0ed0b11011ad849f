"""The constant-tension winch: pays out when the cable pulls too hard, hauls in when it pulls too little.

It measures nothing but the load cell at the sheave. With e = T - T_set beyond a dead band, e_d,

    v = -g (e_d + ∫ e_d dt / T_i),   w' = v - w / T_c,   u0 = (w_{k+1} - p w_k) / (1 - p),   p = exp(-K dt)

v is the winch's wanted speed, w its wanted displacement, which u0 makes the lag follow from control instant
to control instant; 1/T_i is zero unless an integral is asked for, and T_c centres the winch, for a small
error of the set-point would else run it to its end. T_set is the tension at the sheave in still water: weight
of payload and cable outboard, less what drag carries while the plan pays out (`Lowering.tension`).

**The rule for g.** With Z(iω) the tension over the sheave's motion of the elastic rod with its end mass (all
of its modes) and Δ the control step, the loop that the samples see is

    G(iω) = g Σ_n F(i (ω + 2πn/Δ)),   F(s) = Z (1 - exp(-sΔ)) / (sΔ) exp(-s delay) / (s + 1/T_c) I(s)

I = 1 + 1 / (T_i (s + 1/T_c)), n from -3 to 3, the delay that of command and load cell; a second-order drive
adds what inverting its lag leaves. g is the largest that keeps 1/|1 + G| below `SENSITIVITY` at every
frequency up to half of the sampling. Since G grows from nothing with g and comes nowhere near -1 on the way,
the loop is stable. On a spring alone, without delay, the rule is g EA Δ / L = 1, and g is never more. It is
found at a few lengths of the plan and interpolated. A rod without delay is passive and would bear any g:
delay and sampling limit it, at the cable's modes first, which are hardly damped in the small. The dead band
only lowers the gain, so it takes no margin.

Nor is g more than what asks for the winch's full speed (its limit, or K times the command range) when the
error is as large as the set-point, that is, when the cable is slack: beyond, the winch only knows full speed
either way, and works the load up. Where that is not enough, `bandwidth` is tuned.

It holds tension, not the payload: below its resonance a payload moves with the sheave and hardly pulls, so
that little is done; near and above it, holding the tension holds the payload, and takes the edge off snaps.

Source: Berteaux, chapter 9, (9.2) for the set-point; Åström and Wittenmark (1997) for the margin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from baselines.changing_length import changes_length, pay_out_profile
from baselines.linear_controller import LinearController, without_matrices
from baselines.lqr import measured_entries
from heave_env.cable.constitutive import dynamic_modulus
from heave_env.cable.lowering import ElasticRod, Lowering, drag_in_random_motion
from heave_env.parameters import Cable
from heave_env.scenarios import Scenario
from heave_env.sea import Array
from heave_env.spectra import modal_omega

SENSITIVITY = 2.0
"""Largest 1/|1 + G|: the Nyquist curve stays half a unit away from -1 [-]."""
CENTRING_TIME = 60.0
"""T_c [s]."""
NOISE_BAND = 3.0
"""Dead band over the standard deviation of the load cell's noise [-]."""
LEAST_BAND = 0.01
"""Dead band over the static tension, at least [-]."""
DRAG_MOTION = 0.1
"""Speed for which drag is linearised in the margin, over the boom tip's [-]: a compensated cable is damped
little."""
N_LENGTHS = 5
"""Lengths of a plan at which g is found [-]."""
N_OMEGAS = 3000
"""Frequencies at which the margin is looked at [-]."""
N_ALIASES = 3
"""Multiples of the sampling frequency, up and down, whose motion the samples show too [-]."""


@dataclass(frozen=True, eq=False)
class TensionActivated(LinearController):
    """Constant-tension winch; the memory is w, the integral of the tension's error, and the steps."""

    loop_gain: Array | None = None
    """g in each step of the plan, the last one kept [m/(N s)], (n,)."""
    set_point: Array | None = None
    """T_set in each step of the plan, likewise [N], (n,)."""
    band: float = 0.0
    """Half of the dead band [N]."""
    integral_rate: float = 0.0
    """1 / T_i [1/s]."""
    control_dt: float = 0.1
    """[s]."""
    decay: float = 0.0
    """p, what is left of the winch's gap after a control step [-]."""
    speed_limit: float = math.inf
    """Largest wanted speed [m/s]."""
    reach: float = math.inf
    """Largest wanted displacement [m]."""

    @property
    def n_memory(self) -> int:
        """Numbers remembered from step to step [-]."""
        return 3

    def respond(self, y: Array, memory: Array) -> tuple[Array, Array]:
        """Command in metres, (n_envs, 1), and the next memory, for measurements in SI units."""
        assert self.loop_gain is not None and self.set_point is not None
        wanted, integral, count = memory.T
        step = np.minimum(count, len(self.set_point) - 1).astype(int)
        error = y[:, 0] - self.set_point[step]
        error = error - np.clip(error, -self.band, self.band)
        kept = math.exp(-self.control_dt / CENTRING_TIME)
        gain = self.loop_gain[step]
        speed = -gain * (error + self.integral_rate * integral)
        limited = np.clip(speed, -self.speed_limit, self.speed_limit)
        following = np.clip(kept * wanted + self.control_dt * limited, -self.reach, self.reach)
        command = self.clipped((following - self.decay * wanted) / (1.0 - self.decay))
        # The integral stands still where a limit bites.
        free = (limited == speed) & (np.abs(following) < self.reach)
        integral = np.where(free, kept * integral + self.control_dt * error, integral)
        return command[:, None], np.column_stack([following, integral, count + 1.0])


def tension_activated(
    scenario: Scenario,
    *,
    bandwidth: float = 1.0,
    band: float | None = None,
    integral_time: float | None = None,
) -> TensionActivated:
    """Designs the constant-tension winch for a scenario with a cable and a load cell.

    Args:
        scenario: The operation.
        bandwidth: Share of the rule's gain; less of it where the plant has more than the rod.
        band: Half of the dead band [N]; if not given, three standard deviations of the load cell's noise, and
            no less than 1 % of the static tension.
        integral_time: T_i [s]; proportional alone if not given.

    Raises:
        ValueError: If there is no cable, its tension is not measured, or an option is no such number.
    """
    require_tension(scenario)
    if not (math.isfinite(bandwidth) and bandwidth > 0.0):
        raise ValueError(f"bandwidth must be a positive number, got {bandwidth!r}")
    if band is not None and not (math.isfinite(band) and band >= 0.0):
        raise ValueError(f"band must be a number of newtons, not negative, got {band!r}")
    if integral_time is not None and not (math.isfinite(integral_time) and integral_time > 0.0):
        raise ValueError(f"integral_time must be a positive number of seconds, got {integral_time!r}")
    integral_rate = 0.0 if integral_time is None else 1.0 / integral_time
    if changes_length(scenario):
        profile = pay_out_profile(scenario)
        length, rate = profile.length[:-1], profile.rate
    else:
        length, rate = np.array([scenario.initial_length]), np.zeros(1)
    lengths = np.geomspace(length.min(), length.max(), N_LENGTHS if len(length) > 1 else 1)
    gains = np.array([rule_gain(scenario, float(at), integral_rate=integral_rate) for at in lengths])
    winch, set_point = scenario.winch, hanging_tension(scenario, length, rate)
    loop_gain = np.interp(np.log(length), np.log(lengths), gains)
    fastest = winch.rate_constant * winch.command_range
    if winch.speed_limit is not None:
        fastest = min(fastest, winch.speed_limit)
    loop_gain = np.minimum(loop_gain, fastest / set_point)
    return TensionActivated(
        **without_matrices("tension_activated", scenario, ("sheave_tension",)),
        loop_gain=bandwidth * loop_gain,
        set_point=set_point,
        band=default_band(scenario) if band is None else band,
        integral_rate=integral_rate,
        control_dt=scenario.control_dt,
        decay=math.exp(-winch.rate_constant * scenario.control_dt),
        speed_limit=fastest,
        reach=scenario.winch_reach,
    )


def require_tension(scenario: Scenario) -> None:
    """Raises `ValueError` unless there is a cable and its tension at the sheave is measured."""
    if scenario.is_linear:
        raise ValueError(
            f"controller 'tension_activated' needs sheave_tension measured, but scenario {scenario.name!r} "
            "has a linear payload and no cable; add a cable, or choose pid"
        )
    measured = measured_entries(scenario)
    if "sheave_tension" not in measured:
        raise ValueError(
            f"controller 'tension_activated' needs sheave_tension measured, which scenario {scenario.name!r} "
            f"does not (its newest measurements: {', '.join(measured)}); add that sensor"
        )


def linear_cable(scenario: Scenario, length: float) -> Cable:
    """The scenario's cable, or for a rope beyond Hooke's law a Hookean one of its modulus under the load."""
    cable, payload = scenario.cable, scenario.payload
    assert cable is not None and payload is not None
    if cable.is_hookean:
        return cable
    tension = payload.submerged_weight + 0.5 * cable.submerged_weight * length
    modulus = float(dynamic_modulus(cable, modal_omega(scenario.sea_state), tension).real)
    return replace(
        cable,
        axial_stiffness=modulus,
        quadratic_hardening=0.0,
        cubic_hardening=0.0,
        relaxing_stiffness=0.0,
    )


def hanging_tension(scenario: Scenario, length: Array, rate: Array) -> Array:
    """T_set at lengths [m] and rates of pay-out [m/s], same shape [N]."""
    assert scenario.payload is not None
    lowering = Lowering(cable=linear_cable(scenario, scenario.initial_length), payload=scenario.payload)
    still, at_one = lowering.tension(length), lowering.tension(length, 1.0)
    return np.asarray(still + (at_one - still) * np.abs(rate) * rate)


def default_band(scenario: Scenario) -> float:
    """Half of the dead band: the load cell's noise, or `LEAST_BAND` of the static tension if more [N]."""
    sensor = next(item for item in scenario.observed_sensors if item.channel == "sheave_tension")
    return max(NOISE_BAND * sensor.sample_std(scenario.control_dt), LEAST_BAND * scenario.static_tension)


def loop_over_gain(scenario: Scenario, length: float, omega: Array, *, integral_rate: float = 0.0) -> Array:
    """G / g of the module's rule, (n_omega,), complex [N s/m].

    Args:
        scenario: The operation.
        length: Unstretched length [m].
        omega: Up to half of the sampling frequency [rad/s], positive, (n_omega,).
        integral_rate: 1 / T_i [1/s].
    """
    sampling = 2.0 * math.pi / scenario.control_dt
    loop = np.zeros(len(omega), dtype=complex)
    for n in range(-N_ALIASES, N_ALIASES + 1):
        at = omega + n * sampling
        part = _unsampled(scenario, length, np.abs(at), integral_rate)
        loop += np.where(at > 0.0, part, part.conj())
    return loop


def _unsampled(scenario: Scenario, length: float, omega: Array, integral_rate: float) -> Array:
    """F of the module's rule at iω, (n_omega,)."""
    cable, payload, winch = linear_cable(scenario, length), scenario.payload, scenario.winch
    assert payload is not None
    moving = DRAG_MOTION * scenario.boom_tip_scale * modal_omega(scenario.sea_state)
    slope = drag_in_random_motion(0.0, moving)[1]
    drag = payload.drag_factor * slope, cable.tangential_drag_per_length * slope
    Z = ElasticRod(omega, cable, payload, length, *drag).tension_over_sheave(np.array([length]))[0]
    sensor = next(item for item in scenario.observed_sensors if item.channel == "sheave_tension")
    late = winch.command_delay + sensor.delay + 0.5 * scenario.control_dt
    s = 1j * omega + 1.0 / CENTRING_TIME
    held = np.sinc(omega * scenario.control_dt / (2.0 * math.pi)) * np.exp(-1j * omega * late)
    loop = Z * (1.0 + integral_rate / s) * held / s
    if winch.natural_omega is not None:
        ratio = 1j * omega / winch.natural_omega
        loop *= (1.0 + 1j * omega * winch.lag) / (1.0 + 2.0 * winch.damping_ratio * ratio + ratio**2)
    return np.asarray(loop)


def rule_gain(scenario: Scenario, length: float, *, integral_rate: float = 0.0) -> float:
    """g of the rule at a length [m] [m/(N s)].

    |1 + g G₁|² >= 1/S² is a quadratic in g at each frequency: where the curve enters the circle about -1 as g
    grows is its lesser root, and g the least of them; but no more than the cable bears as a mere spring,
    L / (EA Δ), should no frequency limit it.
    """
    omega = np.geomspace(1e-2, math.pi / scenario.control_dt, N_OMEGAS)
    G = loop_over_gain(scenario, length, omega, integral_rate=integral_rate)
    square, half = np.abs(G) ** 2, G.real
    discriminant = half**2 - square * (1.0 - SENSITIVITY**-2)
    entering = (half < 0.0) & (discriminant >= 0.0)
    roots = (-half[entering] - np.sqrt(discriminant[entering])) / square[entering]
    spring = length / (linear_cable(scenario, length).axial_stiffness * scenario.control_dt)
    return float(np.min(roots, initial=spring))
