"""The boom tip: sea elevation through the vessel's filter or its responses, or the elevation itself."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from heave_env.files import modified
from heave_env.parameters import SeaState, Vessel, VesselTable
from heave_env.rao import boom_tip_response, responses_of, table_path
from heave_env.sea import Array, Components, LinearFilter, elevation_fit, read_motion, wave_filter
from heave_env.shaping import ShapingFit, fit_shaping_filter, orthonormal
from heave_env.spectra import elevation_spectrum, modal_omega, significant_wave_height, spectral_grid

BEYOND_TABLE = 0.01
"""Share of the boom tip's variance that may lie beyond a table's last frequency [-]."""


def heave_response(omega: Array, vessel: Vessel | VesselTable | None) -> Array:
    """Boom-tip heave over elevation at iω: K ω_v² / (ω_v² - ω² + 2 i ξ ω_v ω), the table's, or one.

    Source: Huang (1992), (6.25).

    Args:
        omega: Angular frequency [rad/s], any shape.
        vessel: The filter or the table, or None when the boom tip follows the elevation.

    Returns:
        Complex response [-], same shape.
    """
    omega = np.asarray(omega, dtype=float)
    if vessel is None:
        return np.ones(omega.shape, dtype=complex)
    if isinstance(vessel, VesselTable):
        return boom_tip_response(omega, vessel)
    wv = vessel.natural_omega
    response = vessel.gain * wv**2 / (wv**2 - omega**2 + 2j * vessel.damping_ratio * wv * omega)
    return np.asarray(response)


def boom_tip_filter(sea_state: SeaState, vessel: Vessel | VesselTable | None) -> LinearFilter:
    """White noise to boom-tip heave and heave rate, in states of unit stationary variance.

    With a vessel's filter its two states first, then those of the wave filter; with a table the filter fitted
    to the boom tip's own spectrum.

    Source: Huang (1992), (6.23), (6.26) and the lower right of (6.28).
    """
    if isinstance(vessel, VesselTable):
        return boom_tip_fit(sea_state, vessel).filter
    sea = wave_filter(sea_state)
    if vessel is None:
        return sea.scaled()
    n = 2 + sea.n_states
    wv = vessel.natural_omega
    A = np.zeros((n, n))
    A[0, 1] = 1.0
    A[1, :2] = -(wv**2), -2.0 * vessel.damping_ratio * wv
    A[1, 2:] = sea.C[0]
    A[2:, 2:] = sea.A
    B = np.vstack([np.zeros((2, 1)), sea.B])
    C = np.zeros((2, n))
    C[0, 0] = C[1, 1] = vessel.gain * wv**2
    whole = LinearFilter(A, B, C)
    return whole.scaled() if sea_state.filter == "thesis" else orthonormal(whole)


def boom_tip_fit(
    sea_state: SeaState, vessel: Vessel | VesselTable | None, order: int | None = None
) -> ShapingFit:
    """The filter fitted to the boom tip's true spectrum, S |RAO|²; remembered.

    Args:
        sea_state: The sea.
        vessel: What the boom tip follows; None fits the elevation.
        order: States; the sea's own `filter_order` if not given.

    Raises:
        ValueError: If a file cannot be read or the table ends before the boom tip's motion does.
    """
    if vessel is None:
        return elevation_fit(sea_state, order)
    stamp = modified(table_path(vessel)) if isinstance(vessel, VesselTable) else 0
    wanted = sea_state.filter_order if order is None else order
    return _cached_fit(sea_state, vessel, wanted, (stamp, modified(sea_state.spectrum_file or "")))


@lru_cache(maxsize=64)
def _cached_fit(
    sea_state: SeaState, vessel: Vessel | VesselTable, order: int, stamp: tuple[int, int]
) -> ShapingFit:
    omega = spectral_grid(sea_state)
    return fit_shaping_filter(omega, true_boom_tip_spectrum(omega, sea_state, vessel), order)


def true_boom_tip_spectrum(omega: Array, sea_state: SeaState, vessel: Vessel | VesselTable | None) -> Array:
    """One-sided density of the boom tip's heave under the sea's true spectrum, S |RAO|² [m² s].

    Raises:
        ValueError: If a table ends before the boom tip's motion does.
    """
    if isinstance(vessel, VesselTable):
        _check_range(sea_state, vessel)
    elevation = elevation_spectrum(omega, sea_state)
    return np.asarray(elevation * np.abs(heave_response(omega, vessel)) ** 2)


def _check_range(sea_state: SeaState, vessel: VesselTable) -> None:
    table = responses_of(vessel)
    omega = spectral_grid(sea_state)
    density = elevation_spectrum(omega, sea_state) * np.abs(boom_tip_response(omega, vessel)) ** 2
    beyond = float(np.sum(density[omega > table.omega[-1]]) / np.sum(density))
    if beyond > BEYOND_TABLE:
        raise ValueError(
            f"VesselTable.table {table.path!r} ends at {table.omega[-1]:g} rad/s, beyond which "
            f"{100.0 * beyond:.3g} % of the boom tip's motion lies in this sea_state; extend the table"
        )


def boom_tip_spectrum(omega: Array, sea_state: SeaState, vessel: Vessel | VesselTable | None) -> Array:
    """One-sided spectral density of the boom tip's heave as the environment realises it [m² s].

    A shaping-filter sea has the filter's spectrum, a random-phase sea the true one. A regular, recorded
    or calm sea has no density and gives zeros.
    """
    omega = np.asarray(omega, dtype=float)
    if sea_state.kind == "shaping_filter":
        return np.asarray(np.abs(boom_tip_filter(sea_state, vessel).response(omega)[:, 0]) ** 2)
    if sea_state.kind == "random_phase":
        return true_boom_tip_spectrum(omega, sea_state, vessel)
    return np.zeros_like(omega)


def boom_tip_components(sea_state: SeaState, vessel: Vessel | VesselTable | None) -> Components:
    """Bins and amplitudes of a random-phase or regular boom tip.

    Bins hold equal shares of the variance, so that few of them give the spectrum's shape well: for
    Bretschneider's spectrum of the elevation's (the share below ω is exp(-1.25 (ω_m/ω)⁴)), else and with a
    table of the boom tip's own, by quadrature; then all amplitudes are alike and the variance is exact.
    """
    if sea_state.kind == "regular":
        omega = np.array([sea_state.peak_omega])
        if isinstance(vessel, VesselTable):
            _check_line(float(omega[0]), vessel)
        amplitude = 0.5 * sea_state.significant_wave_height * np.abs(heave_response(omega, vessel))
        return Components(omega, np.zeros(1), amplitude)
    n = sea_state.n_components
    # The outermost half per mille of the variance on either side is left to the outermost bins.
    shares = np.linspace(0.0, 1.0, n + 1)
    shares[0], shares[-1] = 0.0005, 0.9995
    if isinstance(vessel, VesselTable) or not sea_state.is_bretschneider:
        grid = spectral_grid(sea_state, 20_000)
        density = true_boom_tip_spectrum(grid, sea_state, vessel)
        below = np.r_[0.0, np.cumsum(density)] * (grid[1] - grid[0])
        # A density of zero has no share to invert: strictly increasing, by less than counts.
        rising = below / below[-1] + np.linspace(0.0, 1e-12, len(below))
        edges = np.interp(shares, rising, np.r_[0.0, grid])
        amplitude = np.full(n, math.sqrt(2.0 * float(below[-1]) / n))
        return Components(edges[:-1], np.diff(edges), amplitude)
    edges = modal_omega(sea_state) * (1.25 / -np.log(shares)) ** 0.25
    middle = 0.5 * (edges[:-1] + edges[1:])
    elevation = math.sqrt(2.0 * sea_state.variance / n)
    return Components(edges[:-1], np.diff(edges), elevation * np.abs(heave_response(middle, vessel)))


def _check_line(omega: float, vessel: VesselTable) -> None:
    table = responses_of(vessel)
    if omega > table.omega[-1]:
        raise ValueError(
            f"SeaState.peak_omega {omega:g} rad/s of a regular sea lies beyond {table.omega[-1]:g} rad/s, "
            f"where VesselTable.table {table.path!r} ends; extend the table"
        )


def boom_tip_lines(sea_state: SeaState, vessel: Vessel | VesselTable | None) -> tuple[Array, Array]:
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
    if sea_state.is_bretschneider:
        omega = modal_omega(sea_state) * np.linspace(0.01, 6.0, 3000)
    else:
        omega = spectral_grid(sea_state)
    return omega, boom_tip_spectrum(omega, sea_state, vessel) * (omega[1] - omega[0])


def boom_tip_size(sea_state: SeaState, vessel: Vessel | VesselTable | None) -> float:
    """Characteristic heave of the boom tip, about one standard deviation [m]; 0 in a calm sea.

    Of a vessel's filter its gain times that of the elevation, so that the size is a plain number.
    """
    if isinstance(vessel, VesselTable):
        _, variance = boom_tip_lines(sea_state, vessel)
        return math.sqrt(float(np.sum(variance)))
    gain = vessel.gain if vessel is not None else 1.0
    return 0.25 * significant_wave_height(sea_state) * gain


def fit_vessel(vessel: VesselTable, sea_state: SeaState | None = None) -> Vessel:
    """The thesis's second-order filter that comes closest to a table of responses.

    Least squares on the modulus of the response over the table's frequencies, each with the weight that the
    sea's spectrum has there, all alike without a sea; with a sea the gain gives the boom tip its variance.
    The phase between elevation and boom tip has no say: nobody measures the elevation. A filter of second
    order cannot follow the notches of a long hull.

    Source: Huang (1992), 6.3.2.

    Args:
        vessel: Table, heading and boom tip.
        sea_state: What weighs the frequencies, or None.

    Returns:
        Natural frequency within [0.1, 5] rad/s, damping ratio within [0.02, 2], and gain.
    """
    from scipy.optimize import least_squares

    table = responses_of(vessel)
    omega = np.linspace(float(table.omega[0]), float(table.omega[-1]), 400)
    wanted = np.abs(boom_tip_response(omega, vessel))
    density = np.ones_like(omega) if sea_state is None else elevation_spectrum(omega, sea_state)
    weight = np.sqrt(density / float(np.sum(density)))

    def candidate(logarithms: Array) -> tuple[Vessel, Array]:
        natural_omega, damping_ratio = (float(value) for value in np.exp(logarithms))
        unit = Vessel(natural_omega=natural_omega, damping_ratio=damping_ratio, gain=1.0)
        modulus = np.abs(heave_response(omega, unit))
        gain = float(np.sum(density * modulus * wanted) / np.sum(density * modulus**2))
        if sea_state is not None:
            gain = math.sqrt(float(np.sum(density * wanted**2) / np.sum(density * modulus**2)))
        return replace(unit, gain=gain), weight * (gain * modulus - wanted)

    bounds = (np.log([0.1, 0.02]), np.log([5.0, 2.0]))
    tries = [
        least_squares(lambda p: candidate(p)[1], np.log([natural_omega, damping_ratio]), bounds=bounds)
        for natural_omega in (0.4, 0.7, 1.1)
        for damping_ratio in (0.1, 0.6)
    ]
    return candidate(min(tries, key=lambda found: float(found.cost)).x)[0]
