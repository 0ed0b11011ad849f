"""Exact answers that the solvers are held to."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq

from heave_env.cable.constitutive import dynamic_modulus
from heave_env.parameters import Cable, Payload

Array = np.ndarray


def payload_response(
    omega: Array,
    cable: Cable,
    payload: Payload,
    length: float,
    *,
    payload_damping: float = 0.0,
    cable_damping: float = 0.0,
) -> Array:
    """Payload heave over sheave heave of a linear rod with an end mass, at iω.

    H = 1 / (cos kL - (M ω² - i ω b) sin(kL) / (E* k)),  k² = ((m + m_a) ω² - i ω c) / E*,
    E* = EA + i ω C_A (`dynamic_modulus` of a rope beyond Hooke's law, at its mean static tension)

    Source: solution of the wave equation with an end mass (as in Huang 1992, ch. 12), drag linear.

    Args:
        omega: Angular frequency [rad/s], positive, any shape.
        cable: The cable; its quadratic drag is not looked at.
        payload: The payload; its quadratic drag is not looked at.
        length: Unstretched length [m].
        payload_damping: Linear damping of the payload, b [N·s/m].
        cable_damping: Linear damping of the cable per length, c [N·s/m²].

    Returns:
        Complex response [-], same shape.
    """
    w = np.asarray(omega, dtype=float)
    tension = payload.submerged_weight + 0.5 * cable.submerged_weight * length
    modulus = dynamic_modulus(cable, w, tension)
    k = np.sqrt((cable.inertia_per_length * w**2 - 1j * w * cable_damping) / modulus)
    end = payload.inertia * w**2 - 1j * w * payload_damping
    # sin(kL)/k, whole for a massless cable too.
    sine_over_k = length * np.sinc(k * length / math.pi)
    return np.asarray(1.0 / (np.cos(k * length) - end * sine_over_k / modulus))


def natural_omegas(cable: Cable, payload: Payload, length: float, n_modes: int) -> Array:
    """First undamped natural frequencies of a rod with an end mass [rad/s], (n_modes,).

    (m + m_a) c / (ω M) = tan(ω L / c): one root in each interval of length π of the phase.
    """
    ratio = cable.inertia_per_length * length / payload.inertia
    roots = []
    for n in range(n_modes):
        low, high = n * math.pi + 1e-9, (n + 0.5) * math.pi - 1e-9
        roots.append(brentq(lambda phase: phase * math.tan(phase) - ratio, low, high, xtol=1e-14))
    return np.array(roots) * cable.axial_wave_speed / length


def resonant_length(omega: Array | float, cable: Cable, payload: Payload) -> Array:
    """Shortest length at which a rod with an end mass resonates with the sheave's frequency [m].

    tan(ω L / c) = (m + m_a) c / (ω M). Neglecting the cable's mass gives EA / (ω² M), which is too long.

    Source: Huang (1992), 3.3.5, item 5, whose estimate is the one without the cable's mass.

    Args:
        omega: Angular frequency [rad/s], positive, any shape.
        cable: The cable; a massless one gives the estimate itself.
        payload: The payload.
    """
    w = np.asarray(omega, dtype=float)
    if cable.inertia_per_length == 0.0:
        return np.asarray(cable.axial_stiffness / (w**2 * payload.inertia))
    c = cable.axial_wave_speed
    return np.asarray(c / w * np.arctan(cable.inertia_per_length * c / (w * payload.inertia)))


def linearised_payload_std(
    omega: Array, variance: Array, cable: Cable, payload: Payload, length: float
) -> float:
    """Standard deviation of the payload under a sheave motion given as lines of variance [m].

    Quadratic drag c |v| v becomes sqrt(8/π) c σ_v v, exact in the mean square for Gaussian motion; σ_v
    is found by iteration. Cable drag is taken at the mean of the speeds of its two ends.

    Args:
        omega: Frequencies of the lines [rad/s], (n,).
        variance: Variance of the sheave's heave at each [m²], (n,).
        cable: The cable.
        payload: The payload.
        length: Unstretched length [m].
    """
    if len(omega) == 0:
        return 0.0
    factor = math.sqrt(8.0 / math.pi)
    top_speed = math.sqrt(float(np.sum(variance * omega**2)))
    speed = top_speed
    response = np.ones(len(omega), dtype=complex)
    for _ in range(60):
        response = payload_response(
            omega,
            cable,
            payload,
            length,
            payload_damping=factor * payload.drag_factor * speed,
            cable_damping=factor * cable.tangential_drag_per_length * 0.5 * (speed + top_speed),
        )
        new = math.sqrt(float(np.sum(variance * np.abs(omega * response) ** 2)))
        # Halfway steps: near resonance the full step overshoots.
        speed = math.sqrt(speed * new)
    return math.sqrt(float(np.sum(variance * np.abs(response) ** 2)))
