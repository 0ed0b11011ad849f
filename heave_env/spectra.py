"""Wave spectra: the parametric forms that engineers use, and measured ones.

All are one-sided in angular frequency, S(ω) [m² s] for ω > 0, and hold their significant wave height exactly:
Hs = 4 sqrt(∫ S dω). Where a form's published constant only approximates that (the factor of JONSWAP's peak
enhancement, Torsethaugen's G0 and A_γ) the exact one is computed by quadrature in its place.

A system of waves of height Hs and modal frequency ω_p has, with x = ω/ω_p,

    Bretschneider          (Hs²/16) (5/ω_p) x⁻⁵ exp(-1.25 x⁻⁴)
    Pierson and Moskowitz  the same with ω_p⁴ = 0.02592 (g/Hs)²: the fully developed sea, 4 α/1.25 = 0.02592
    JONSWAP                Bretschneider's times γ^r / I(γ),  r = exp(-(x - 1)²/(2 σ²)),  σ = 0.07 or 0.09
    Ochi and Hubble        (Hs²/4) ((4 λ + 1) ω_p⁴/4)^λ / Γ(λ) ω^-(4 λ + 1) exp(-(4 λ + 1)/4 x⁻⁴), two of them
    Torsethaugen           (Hs²/16) x⁻⁴ exp(-x⁻⁴) γ^r / (I ω_p), two of them, simplified form of 2004

They stop holding in shallow water and, but for the two-peaked ones, where swell meets wind sea.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from heave_env.files import modified, read_columns
from heave_env.parameters import FULLY_DEVELOPED, GRAVITY, SeaState

Array = np.ndarray

_LOWEST, _HIGHEST = 0.3, 10.0
"""Range of a system of waves over its modal frequency [-]: below it no form holds 1e-6 of the variance."""


# The forms ---------------------------------------------------------------------------------------


def bretschneider(omega: Array, significant_wave_height: float, peak_omega: float) -> Array:
    """Bretschneider's wave spectrum, one-sided.

    S(ω) = (1.25/4) Hs² ω_m⁴ / ω⁵ exp(-1.25 (ω_m/ω)⁴)

    Source: Bretschneider (1959); Huang (1992), (6.20), whose print has the powers reversed.

    Args:
        omega: Angular frequency [rad/s], any shape, not negative.
        significant_wave_height: Hs [m].
        peak_omega: Modal frequency ω_m [rad/s].

    Returns:
        Spectral density [m² s], same shape; zero at ω = 0.
    """
    ratio = peak_omega / np.maximum(np.asarray(omega, dtype=float), 1e-3 * peak_omega)
    density = 0.3125 * significant_wave_height**2 / peak_omega * ratio**5 * np.exp(-1.25 * ratio**4)
    return np.asarray(density)


def pierson_moskowitz(omega: Array, significant_wave_height: float) -> Array:
    """The fully developed wind sea of a significant wave height: Bretschneider's form at its own frequency.

    Source: Pierson and Moskowitz (1964).

    Args:
        omega: Angular frequency [rad/s], any shape, not negative.
        significant_wave_height: Hs [m].

    Returns:
        Spectral density [m² s], same shape.
    """
    peak_omega = fully_developed_omega(significant_wave_height)
    return bretschneider(omega, significant_wave_height, peak_omega)


def fully_developed_omega(significant_wave_height: float) -> float:
    """Modal frequency of Pierson and Moskowitz's sea, (4 α / 1.25)^¼ sqrt(g/Hs), α = 0.0081 [rad/s]."""
    return float(FULLY_DEVELOPED * math.sqrt(GRAVITY / significant_wave_height))


def jonswap(
    omega: Array, significant_wave_height: float, peak_omega: float, peak_enhancement: float
) -> Array:
    """JONSWAP spectrum of a growing wind sea, normalised so that its Hs is exact for every enhancement.

    Source: Hasselmann et al. (1973).

    Args:
        omega: Angular frequency [rad/s], any shape, not negative.
        significant_wave_height: Hs [m].
        peak_omega: Frequency of the peak [rad/s].
        peak_enhancement: γ [-]; 1 is Bretschneider's spectrum.

    Returns:
        Spectral density [m² s], same shape.
    """
    base = bretschneider(omega, significant_wave_height, peak_omega)
    share = _enhanced_share(peak_enhancement, 5)
    return np.asarray(base * _enhancement(np.asarray(omega) / peak_omega, peak_enhancement) / share)


def ochi_hubble(omega: Array, systems: tuple[tuple[float, float, float], ...]) -> Array:
    """Ochi and Hubble's spectrum: a sum of wave systems of three parameters each (two make their six).

    Source: Ochi and Hubble (1976).

    Args:
        omega: Angular frequency [rad/s], any shape, not negative.
        systems: Significant wave height [m], modal frequency [rad/s] and shape λ [-] of each.

    Returns:
        Spectral density [m² s], same shape.
    """
    omega = np.asarray(omega, dtype=float)
    total = np.zeros_like(omega)
    for height, peak_omega, shape in systems:
        ratio = peak_omega / np.maximum(omega, 1e-3 * peak_omega)
        power = shape + 0.25
        scale = height**2 / (4.0 * peak_omega) * power**shape / math.gamma(shape)
        total += scale * ratio ** (4.0 * shape + 1.0) * np.exp(-power * ratio**4)
    return total


def torsethaugen(omega: Array, significant_wave_height: float, peak_omega: float) -> Array:
    """Torsethaugen's two-peaked spectrum of the open North Sea, simplified form, tails as ω⁻⁴.

    Height and peak frequency alone say how much is wind sea, how much swell, and where the second peak
    lies. The primary system is enhanced; both are normalised so that the Hs of the sum is exact.

    Source: Torsethaugen and Haver (2004).

    Args:
        omega: Angular frequency [rad/s], any shape, not negative.
        significant_wave_height: Hs [m].
        peak_omega: Frequency of the primary peak, 2π/T_p [rad/s].

    Returns:
        Spectral density [m² s], same shape.
    """
    omega = np.asarray(omega, dtype=float)
    total = np.zeros_like(omega)
    for height, peak, enhancement in torsethaugen_systems(significant_wave_height, peak_omega):
        if height == 0.0:
            continue
        x = np.maximum(omega / peak, 1e-3)
        enhanced = _enhancement(x, enhancement) / _enhanced_share(enhancement, 4)
        total += height**2 / (16.0 * peak) * _unit_form(x, 4) * enhanced
    return total


def torsethaugen_systems(
    significant_wave_height: float, peak_omega: float
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Height [m], peak frequency [rad/s] and enhancement [-] of the primary and the secondary system."""
    Hs, Tp = significant_wave_height, 2.0 * math.pi / peak_omega
    fully_developed = 6.6 * Hs ** (1.0 / 3.0)
    if fully_developed >= Tp:  # wind sea dominates
        distance = min(1.0, (fully_developed - Tp) / (fully_developed - 2.0 * math.sqrt(Hs)))
        share = 0.7 + 0.3 * math.exp(-((2.0 * distance) ** 2))
        enhancement = 35.0 * (2.0 * math.pi * share * Hs / (GRAVITY * Tp**2)) ** 0.857
        second_height = math.sqrt(1.0 - share**2) * Hs
        second_period = fully_developed + 2.0
    else:  # swell dominates
        distance = min(1.0, (Tp - fully_developed) / (25.0 - fully_developed))
        share = 0.6 + 0.4 * math.exp(-((distance / 0.3) ** 2))
        steepness = 2.0 * math.pi * Hs / (GRAVITY * fully_developed**2)
        enhancement = 35.0 * steepness**0.857 * (1.0 + 6.0 * distance)
        second_height = math.sqrt(1.0 - share**2) * Hs
        second_period = 6.6 * second_height ** (1.0 / 3.0) if second_height else fully_developed
    primary = (share * Hs, peak_omega, max(1.0, enhancement))
    return primary, (second_height, 2.0 * math.pi / second_period, 1.0)


def _unit_form(x: Array, power: int) -> Array:
    """x⁻ᵖ exp(-(p/4) x⁻⁴) of unit area over x > 0; the power p is 4 or 5, its maximum at x = 1."""
    # With y = (p/4) x⁻⁴ the area is a gamma function, which for p = 5 is 1/5.
    rest = 0.25 * (power - 1)
    area = 0.25 * math.gamma(rest) * (0.25 * power) ** -rest
    return np.asarray(x**-power * np.exp(-0.25 * power * x**-4.0) / area)


def _enhancement(x: Array, gamma: float) -> Array:
    """JONSWAP's γ^r at frequencies over that of the peak [-]."""
    width = np.where(x <= 1.0, 0.07, 0.09)
    return np.asarray(gamma ** np.exp(-0.5 * ((x - 1.0) / width) ** 2))


@lru_cache(maxsize=64)
def _enhanced_share(gamma: float, power: int) -> float:
    """I(γ): area of the unit form times γ^r, by Gauss's quadrature on either side of the peak."""
    nodes, weights = np.polynomial.legendre.leggauss(200)
    extra = 0.0
    for low, high in ((0.4, 1.0), (1.0, 2.0)):
        x = 0.5 * (low + high) + 0.5 * (high - low) * nodes
        extra += 0.5 * (high - low) * float(weights @ (_unit_form(x, power) * (_enhancement(x, gamma) - 1.0)))
    return 1.0 + extra


# Measured spectra --------------------------------------------------------------------------------


_HIGHEST_SEA = 40.0  # significant height beyond which a file holds something else [m]


@dataclass(frozen=True, eq=False)
class MeasuredSpectrum:
    """A measured spectrum, linear between its samples and zero beyond them."""

    omega: Array
    """Increasing, not negative [rad/s], (n_samples,)."""
    density: Array
    """One-sided, not negative [m² s], (n_samples,)."""
    path: str
    """Where it was read from."""

    @property
    def variance(self) -> float:
        """Area beneath it [m²]."""
        return float(np.trapezoid(self.density, self.omega))

    def __call__(self, omega: Array) -> Array:
        """Density at other frequencies [m² s]."""
        return np.interp(omega, self.omega, self.density, left=0.0, right=0.0)


def read_spectrum(path: str | Path, reader: str | None = None, record: int = 0) -> MeasuredSpectrum:
    """Reads a measured spectrum.

    Args:
        path: CSV with the columns `omega` [rad/s] and `density` [m² s], or any file that the optional
            package wavespectra reads.
        reader: None for CSV, else the name of wavespectra's reader without `read_`, such as `swan`, `ww3`,
            `ndbc_ascii`, `triaxys` or `netcdf`. Directional spectra are integrated over direction.
        record: Which of several spectra (times, then sites) [-].

    Raises:
        ValueError: If the file, the reader or the record does not give a spectrum.
    """
    if reader is not None:
        return _through_wavespectra(Path(path), reader, record)
    arrays, lines = read_columns(path, "spectrum file", ("omega", "density"))
    omega, density = arrays["omega"], arrays["density"]
    if len(omega) < 3:
        raise ValueError(f"spectrum file {str(path)!r} has {len(omega)} samples; give at least 3")
    for bad, what in (
        (np.r_[omega[0] < 0.0, np.diff(omega) <= 0.0], "omega must increase from zero or more"),
        (density < 0.0, "density must not be negative"),
    ):
        if np.any(bad):
            raise ValueError(f"spectrum file {str(path)!r} line {lines[int(np.argmax(bad))]}: {what}")
    return _checked(MeasuredSpectrum(omega, density, str(path)))


def _through_wavespectra(path: Path, reader: str, record: int) -> MeasuredSpectrum:
    try:
        import wavespectra
    except ModuleNotFoundError as error:
        raise ValueError(
            f"SeaState.spectrum_reader {reader!r} needs the package wavespectra, which is not installed: "
            'pip install "heave-env[spectra]", or give a CSV of omega and density and spectrum_reader null'
        ) from error
    read: Callable[..., Any] | None = getattr(wavespectra, f"read_{reader}", None)
    if read is None:
        known = sorted(name[5:] for name in dir(wavespectra) if name.startswith("read_"))
        raise ValueError(
            f"SeaState.spectrum_reader {reader!r} is no reader of wavespectra; known: {', '.join(known)}"
        )
    try:
        density = read(str(path))["efth"].astype(float)
        if "dir" in density.dims:
            density = density.spec.oned()
        others = [name for name in density.dims if name != "freq"]
        flat = np.asarray(density.transpose(*others, "freq").values)
    except Exception as error:  # whatever its many readers raise
        raise ValueError(f"wavespectra's reader {reader!r} cannot read {str(path)!r}: {error}") from error
    flat = flat.reshape(-1, flat.shape[-1])
    if not 0 <= record < len(flat):
        raise ValueError(
            f"SeaState.spectrum_record must be below {len(flat)}, the spectra in {str(path)!r}, got {record}"
        )
    omega = 2.0 * math.pi * np.asarray(density["freq"].values, dtype=float)
    return _checked(MeasuredSpectrum(omega, flat[record] / (2.0 * math.pi), str(path)))


def _checked(spectrum: MeasuredSpectrum) -> MeasuredSpectrum:
    ok = np.all(np.isfinite(spectrum.density)) and np.all(np.diff(spectrum.omega) > 0.0)
    if not ok or np.any(spectrum.density < 0.0) or spectrum.variance <= 0.0:
        raise ValueError(
            f"spectrum file {spectrum.path!r} must hold finite densities, not negative and not all zero, at "
            "increasing frequencies"
        )
    height = 4.0 * math.sqrt(spectrum.variance)
    if height > _HIGHEST_SEA:
        raise ValueError(
            f"spectrum file {spectrum.path!r} holds a sea of {height:.3g} m: take a record that is not "
            "marked as missing (buoys write 999), and density in m² s of omega in rad/s"
        )
    return spectrum


@lru_cache(maxsize=16)
def _cached_spectrum(path: str, reader: str | None, record: int, stamp: int) -> MeasuredSpectrum:
    return read_spectrum(path, reader, record)


def measured_spectrum(sea_state: SeaState) -> MeasuredSpectrum:
    """The file's spectrum that a measured sea names, read anew when the file has changed."""
    path = sea_state.spectrum_file
    assert path is not None
    return _cached_spectrum(path, sea_state.spectrum_reader, sea_state.spectrum_record, modified(path))


# The spectrum of a sea ---------------------------------------------------------------------------


def elevation_spectrum(omega: Array, sea_state: SeaState) -> Array:
    """The true one-sided density of a sea's elevation, whatever realises it [m² s].

    Args:
        omega: Angular frequency [rad/s], any shape, not negative.
        sea_state: The sea; its `spectrum` says which form.
    """
    Hs, kind = sea_state.significant_wave_height, sea_state.spectrum
    if kind == "pierson_moskowitz":
        return pierson_moskowitz(omega, Hs)
    if kind == "jonswap":
        return jonswap(omega, Hs, sea_state.peak_omega, sea_state.peak_enhancement)
    if kind == "ochi_hubble":
        return ochi_hubble(omega, ochi_hubble_systems(sea_state))
    if kind == "torsethaugen":
        return torsethaugen(omega, Hs, sea_state.peak_omega)
    if kind == "measured":
        spectrum = measured_spectrum(sea_state)
        factor = significant_wave_height(sea_state) ** 2 / (16.0 * spectrum.variance)
        return np.asarray(factor * spectrum(omega))
    return bretschneider(omega, Hs, sea_state.peak_omega)


def ochi_hubble_systems(sea_state: SeaState) -> tuple[tuple[float, float, float], ...]:
    """Height [m], modal frequency [rad/s] and shape [-] of both systems of an Ochi-Hubble sea."""
    second = sea_state.second_wave_height
    first = math.sqrt(sea_state.significant_wave_height**2 - second**2)
    return (
        (first, sea_state.peak_omega, sea_state.shape),
        (second, sea_state.second_peak_omega, sea_state.second_shape),
    )


def significant_wave_height(sea_state: SeaState) -> float:
    """Hs of the sea [m]: its own or, of a measured sea that gives none, the file's."""
    if sea_state.spectrum == "measured" and sea_state.significant_wave_height == 0.0:
        return 4.0 * math.sqrt(measured_spectrum(sea_state).variance)
    return sea_state.significant_wave_height


def modal_omega(sea_state: SeaState) -> float:
    """Frequency of the (primary) peak [rad/s]."""
    if sea_state.spectrum == "pierson_moskowitz":
        return fully_developed_omega(sea_state.significant_wave_height)
    if sea_state.spectrum == "measured":
        spectrum = measured_spectrum(sea_state)
        return float(spectrum.omega[np.argmax(spectrum.density)])
    return sea_state.peak_omega


def spectral_grid(sea_state: SeaState, n: int = 6000) -> Array:
    """Evenly spaced frequencies from near zero to beyond the spectrum's tail [rad/s], (n,)."""
    if sea_state.spectrum == "measured":
        top = 1.2 * float(measured_spectrum(sea_state).omega[-1])
    else:
        peaks = [modal_omega(sea_state)]
        if sea_state.spectrum == "ochi_hubble":
            peaks.append(sea_state.second_peak_omega)
        if sea_state.spectrum == "torsethaugen":
            systems = torsethaugen_systems(sea_state.significant_wave_height, peaks[0])
            peaks = [peak for _, peak, _ in systems]
        top = _HIGHEST * max(peaks)
    return np.linspace(top / n, top, n)
