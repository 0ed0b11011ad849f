"""The boom tip: sea elevation through the vessel's second-order filter, or the elevation itself."""

from __future__ import annotations

import math

import numpy as np

from heave_env.parameters import SeaState, Vessel
from heave_env.sea import Array, Components, LinearFilter, bretschneider, read_motion, wave_filter


def heave_response(omega: Array, vessel: Vessel | None) -> Array:
    """Boom-tip heave over elevation at iω, K ω_v² / (ω_v² - ω² + 2 i ξ ω_v ω); one without a vessel.

    Source: Huang (1992), (6.25).

    Args:
        omega: Angular frequency [rad/s], any shape.
        vessel: The filter, or None when the boom tip follows the elevation.

    Returns:
        Complex response [-], same shape.
    """
    omega = np.asarray(omega, dtype=float)
    if vessel is None:
        return np.ones(omega.shape, dtype=complex)
    wv = vessel.natural_omega
    response = vessel.gain * wv**2 / (wv**2 - omega**2 + 2j * vessel.damping_ratio * wv * omega)
    return np.asarray(response)


def boom_tip_filter(sea_state: SeaState, vessel: Vessel | None) -> LinearFilter:
    """White noise to boom-tip heave and heave rate, in states of unit stationary variance.

    Vessel states first (if there is a vessel), then the six of the wave filter.

    Source: Huang (1992), (6.23), (6.26) and the lower right of (6.28).
    """
    sea = wave_filter(sea_state)
    if vessel is None:
        return sea.scaled()
    wv = vessel.natural_omega
    A = np.zeros((8, 8))
    A[0, 1] = 1.0
    A[1, :2] = -(wv**2), -2.0 * vessel.damping_ratio * wv
    A[1, 2:] = sea.C[0]
    A[2:, 2:] = sea.A
    B = np.vstack([np.zeros((2, 1)), sea.B])
    C = np.zeros((2, 8))
    C[0, 0] = C[1, 1] = vessel.gain * wv**2
    return LinearFilter(A, B, C).scaled()


def boom_tip_spectrum(omega: Array, sea_state: SeaState, vessel: Vessel | None) -> Array:
    """One-sided spectral density of the boom tip's heave as the environment realises it [m² s].

    A shaping-filter sea has the filter's spectrum, a random-phase sea the true one. A regular, recorded
    or calm sea has no density and gives zeros.
    """
    omega = np.asarray(omega, dtype=float)
    if sea_state.kind == "shaping_filter":
        return np.asarray(np.abs(boom_tip_filter(sea_state, vessel).response(omega)[:, 0]) ** 2)
    if sea_state.kind == "random_phase":
        elevation = bretschneider(omega, sea_state.significant_wave_height, sea_state.peak_omega)
        return np.asarray(elevation * np.abs(heave_response(omega, vessel)) ** 2)
    return np.zeros_like(omega)


def boom_tip_components(sea_state: SeaState, vessel: Vessel | None) -> Components:
    """Bins and amplitudes of a random-phase or regular boom tip.

    Bins hold equal shares of the spectrum's variance, so that few of them give its shape well. Of the
    Bretschneider spectrum, the share below ω is exp(-1.25 (ω_m/ω)⁴).
    """
    if sea_state.kind == "regular":
        omega = np.array([sea_state.peak_omega])
        amplitude = 0.5 * sea_state.significant_wave_height * np.abs(heave_response(omega, vessel))
        return Components(omega, np.zeros(1), amplitude)
    n = sea_state.n_components
    # The outermost half per mille of the variance on either side is left to the outermost bins.
    shares = np.linspace(0.0, 1.0, n + 1)
    shares[0], shares[-1] = 0.0005, 0.9995
    edges = sea_state.peak_omega * (1.25 / -np.log(shares)) ** 0.25
    middle = 0.5 * (edges[:-1] + edges[1:])
    elevation = math.sqrt(2.0 * sea_state.variance / n)
    return Components(edges[:-1], np.diff(edges), elevation * np.abs(heave_response(middle, vessel)))


def boom_tip_lines(sea_state: SeaState, vessel: Vessel | None) -> tuple[Array, Array]:
    """The boom tip's heave as lines: frequencies [rad/s] and the variance at each [m²].

    Of a spectral sea fine slices of the spectrum, of a regular one its single line, of a recording its
    periodogram; empty for a calm sea.
    """
    if sea_state.kind == "calm":
        return np.zeros(0), np.zeros(0)
    if sea_state.kind == "regular":
        components = boom_tip_components(sea_state, vessel)
        return components.low, 0.5 * components.amplitude**2
    if sea_state.kind == "recorded":
        assert sea_state.recording is not None
        recording = read_motion(sea_state.recording)
        n = 4096
        instants = np.linspace(0.0, recording.time[-1] - recording.time[0], n)
        heave = recording.sampled(instants)[0]
        transform = np.fft.rfft(heave - heave.mean())[1:-1]
        return 2.0 * math.pi * np.fft.rfftfreq(n, instants[1])[1:-1], 2.0 * np.abs(transform / n) ** 2
    omega = sea_state.peak_omega * np.linspace(0.01, 6.0, 3000)
    return omega, boom_tip_spectrum(omega, sea_state, vessel) * (omega[1] - omega[0])
