"""PID on the payload's heave, its derivative measured, behind a lead that takes back most of the winch's lag.

    v = -(kp x + ki ∫x dt + kd x'),     u0 = (1 + s/K) / (1 + s/(N K)) v,     N = 10

The lead leaves the winch ten times as quick; what then stands between v and the payload is the second-order
model a x'' + b x' + x = x0 + v and some time T = delay + dt/2 + 1/(N K). A second-order drive has the lead
(1 + 2 ζ s/ω + s²/ω²) / (1 + s/W)², W = M ω, which leaves T = delay + dt/2 + 2/W. The gains place the three
poles of the model under this feedback:

    (s + α ω)(s² + 2 ζ ω s + ω²):   kd = a (2 ζ + α) ω - b,   kp = a ω² (1 + 2 ζ α) - 1,   ki = a α ω³

with ζ = 0.7, α = 0.1 (a slow integral), and ω T = 0.3, so that the time left costs the loop some 17 degrees
of phase; ω is not below the model's own frequency. Then all gains are lowered together until the sampled
loop, on the model with its exact delay, would bear twice of them. Integral and lead are told the command as
clipped, so that the range does not wind them up.

A feedback on the payload alone reacts to a motion that has already come about: it cannot foresee, and its
gain is what the delay allows.

Source: Åström and Wittenmark (1997), pole placement.
"""

from __future__ import annotations

import math

import numpy as np

from baselines.linear_controller import LinearController, controller
from baselines.lqr import PAYLOAD_MOTION, require_payload_motion, truth_model
from baselines.model import LinearModel, held_command, linear_model, payload_model
from heave_env.scenarios import Scenario
from heave_env.sea import Array

LEAD = 10.0
"""N, how many times quicker the lead makes the winch [-]."""
LEAD_OF_DRIVE = 2.0
"""M, likewise of a second-order drive [-]: what noise there is the lead multiplies by its square."""
PHASE = 0.3
"""ω T, phase that the time left may cost at the loop's frequency [rad]."""
DAMPING_RATIO = 0.7
"""ζ of the placed pair [-]."""
INTEGRAL = 0.1
"""α, the integral's pole over ω [-]."""
GAIN_MARGIN = 2.0
"""Multiple of its gains that the loop bears [-]."""
LOWERED = 0.8
"""Factor by which they are lowered at a time [-]."""


def pid(scenario: Scenario, *, bandwidth: float = 1.0) -> LinearController:
    """Designs the PID for a scenario by pole placement.

    Args:
        scenario: The operation. A cable is replaced by its identified second-order model.
        bandwidth: Share of the rule's ω; less of it where the plant has more than the model.

    Raises:
        ValueError: If payload heave or its rate is not measured, or the bandwidth is not positive.
    """
    require_payload_motion(scenario, "pid")
    if not (math.isfinite(bandwidth) and bandwidth > 0.0):
        raise ValueError(f"bandwidth must be a positive number, got {bandwidth!r}")
    gains = np.array(pole_placement(scenario, bandwidth))
    omega = loop_frequency(scenario, bandwidth)
    model = linear_model(scenario, sea=False).select(PAYLOAD_MOTION)
    while _spectral_radius(model, _matrices(scenario, GAIN_MARGIN * gains, omega)) >= 1.0:
        gains = LOWERED * gains
    D, F, G, H, L = _matrices(scenario, gains, omega)
    return controller("pid", scenario, PAYLOAD_MOTION, D=D, F=F, G=G, H=H, L=L, truth=truth_model(scenario))


def _matrices(scenario: Scenario, gains: Array, omega: float) -> tuple[Array, Array, Array, Array, Array]:
    """D, F, G, H and L for gains kp, ki and kd, with the integral's pole at α ω."""
    kp, ki, kd = gains
    if scenario.winch.is_second_order:
        return _matrices_of_drive(scenario, gains, omega)
    dt, fast = scenario.control_dt, LEAD * scenario.winch.rate_constant
    # Memory: the integral of x, and v as the quickened winch follows it: u0 = N v - (N - 1) follower.
    decay = math.exp(-fast * dt)
    D = LEAD * np.array([[kp, kd]])
    L = np.array([[LEAD * ki, LEAD - 1.0]])
    F, G, H = np.eye(2), np.array([[dt, 0.0], [0.0, 0.0]]), np.zeros((2, 1))
    # The v that belongs to the command as clipped: v = (u0 + (N - 1) follower) / N.
    F[1, 1] = decay + (1.0 - decay) * (LEAD - 1.0) / LEAD
    H[1, 0] = (1.0 - decay) / LEAD
    # What the range cut off is taken from the integral, at the integral's own pole.
    back = INTEGRAL * omega * dt / (LEAD * ki)
    F[0] -= back * L[0]
    G[0] -= back * D[0]
    H[0, 0] = -back
    return D, F, G, H, L


def _matrices_of_drive(
    scenario: Scenario, gains: Array, omega: float
) -> tuple[Array, Array, Array, Array, Array]:
    """The same before a second-order drive."""
    kp, ki, kd = gains
    dt, own, damping = scenario.control_dt, scenario.winch.natural_omega, scenario.winch.damping_ratio
    assert own is not None
    W = LEAD_OF_DRIVE * own
    # Memory: the integral of x; y and y' of y'' + 2 W y' + W² y = W² v, which the drive follows under
    # u0 = y + 2 ζ/ω y' + y''/ω² = M² v + (1 - M²) y + rate_share y'.
    squared, rate_share = LEAD_OF_DRIVE**2, 2.0 * (damping - LEAD_OF_DRIVE) / own
    step, given = held_command(np.array([[0.0, 1.0], [-(W**2), -2.0 * W]]), np.array([[0.0], [W**2]]), dt)
    D = squared * np.array([[kp, kd]])
    L = np.array([[squared * ki, squared - 1.0, -rate_share]])
    F, G, H = np.zeros((3, 3)), np.array([[dt, 0.0], [0.0, 0.0], [0.0, 0.0]]), np.zeros((3, 1))
    # The v that belongs to the command as clipped.
    F[0, 0] = 1.0
    F[1:, 1:] = step + given @ [[squared - 1.0, -rate_share]] / squared
    H[1:] = given / squared
    back = INTEGRAL * omega * dt / (squared * ki)
    F[0] -= back * L[0]
    G[0] -= back * D[0]
    H[0, 0] = -back
    return D, F, G, H, L


def _spectral_radius(model: LinearModel, matrices: tuple[Array, ...]) -> float:
    """Largest modulus of the eigenvalues of model and controller in a loop [-]."""
    A, B, C = model.A, model.B, model.C
    D, F, G, H, L = matrices
    loop = np.block([[A - B @ D @ C, -B @ L], [(G - H @ D) @ C, F - H @ L]])
    return float(np.max(np.abs(np.linalg.eigvals(loop))))


def remaining_time(scenario: Scenario) -> float:
    """T, what still lies between v and the payload [s]."""
    winch = scenario.winch
    rest = winch.lag / LEAD
    if winch.natural_omega is not None:
        rest = 2.0 / (LEAD_OF_DRIVE * winch.natural_omega)
    return winch.command_delay + 0.5 * scenario.control_dt + rest


def loop_frequency(scenario: Scenario, bandwidth: float = 1.0) -> float:
    """ω of the rule, times the share of it that is used [rad/s]."""
    own = 1.0 / math.sqrt(payload_model(scenario).inertia)
    return bandwidth * max(PHASE / remaining_time(scenario), own)


def pole_placement(scenario: Scenario, bandwidth: float = 1.0) -> tuple[float, float, float]:
    """kp [-], ki [1/s] and kd [s] of the rule."""
    payload = payload_model(scenario)
    a, b = payload.inertia, payload.damping
    omega = loop_frequency(scenario, bandwidth)
    kp = a * omega**2 * (1.0 + 2.0 * DAMPING_RATIO * INTEGRAL) - 1.0
    kd = a * (2.0 * DAMPING_RATIO + INTEGRAL) * omega - b
    return max(kp, 0.0), a * INTEGRAL * omega**3, max(kd, 0.0)
