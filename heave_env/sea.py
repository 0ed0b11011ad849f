"""The sea: its shaping filter, random-phase components and recorded motions.

All spectra (`heave_env.spectra`) are one-sided in angular frequency: the variance is the integral over ω > 0.
The shaping filter of Triantafyllou et al. (1983), fitted to that one-sided spectrum, is therefore driven by
white noise of intensity π (autocorrelation π δ), so that a transfer function H gives the variance
∫_0^∞ |H(iω)|² dω. That fit holds 94 % of the variance of the true spectrum; those of `heave_env.shaping` hold
all of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from heave_env.files import modified, read_columns
from heave_env.parameters import SeaState
from heave_env.shaping import (
    NOISE_INTENSITY,
    LinearFilter,
    ShapingFit,
    discretised_noise,
    fit_shaping_filter,
    square_root,
)
from heave_env.spectra import (
    Array,
    bretschneider,
    elevation_spectrum,
    modal_omega,
    significant_wave_height,
    spectral_grid,
)

__all__ = [
    "NOISE_INTENSITY",
    "Array",
    "Components",
    "LinearFilter",
    "MotionRecording",
    "bretschneider",
    "discretised_noise",
    "elevation_fit",
    "read_motion",
    "square_root",
    "wave_filter",
]


def wave_filter(sea_state: SeaState) -> LinearFilter:
    """Filter whose outputs are the elevation and its rate: the thesis's six states, or a fitted one.

    The thesis's: H(s) = sqrt(S0) (s/ω0)² / [1 + 1.414 s/ω0 + (s/ω0)²]³, S0 = (1.25/(4 ω_m)) Hs² 1.8861,
    ω0 = 0.9538 ω_m.

    Source: Triantafyllou et al. (1983); Huang (1992), (6.21)-(6.23).
    """
    if sea_state.filter == "fitted":
        return elevation_fit(sea_state).filter
    peak_omega = modal_omega(sea_state)
    w0 = 0.9538 * peak_omega
    S0 = 1.25 / (4.0 * peak_omega) * sea_state.significant_wave_height**2 * 1.8861
    A = np.zeros((6, 6))
    for i in (0, 2, 4):
        A[i, i + 1] = 1.0
        A[i + 1, i : i + 2] = -(w0**2), -1.414 * w0
    # Each stage is fed: the first by the second's rate, the second by the third's rate: two zeros at s = 0.
    A[1, 3] = A[3, 5] = w0**2
    B = np.zeros((6, 1))
    B[5, 0] = 1.0
    C = np.zeros((2, 6))
    C[0, 0] = C[1, 1] = math.sqrt(S0)
    # (6.23) prints B = 1 and these feeds, which make H(s) w0^4 s^2/(...)^3 = (s/w0)^2/[...]^3 exactly.
    return LinearFilter(A, B, C)


def elevation_fit(sea_state: SeaState, order: int | None = None) -> ShapingFit:
    """The filter fitted to a sea's true spectrum, whatever realises it; remembered.

    Args:
        sea_state: The sea.
        order: States; its own `filter_order` if not given.

    Raises:
        ValueError: If a measured spectrum cannot be read.
    """
    wanted = sea_state.filter_order if order is None else order
    # What has no say in the spectrum is left out of the key.
    bare = replace(sea_state, kind="calm", n_components=1, recording=None, filter="thesis", filter_order=6)
    return _cached_fit(bare, wanted, modified(sea_state.spectrum_file or ""))


@lru_cache(maxsize=64)
def _cached_fit(sea_state: SeaState, order: int, stamp: int) -> ShapingFit:
    omega = spectral_grid(sea_state)
    density = elevation_spectrum(omega, sea_state)
    # The little that the frequencies leave out is shared among them: Hs is exact.
    step = omega[1] - omega[0]
    whole = significant_wave_height(sea_state) ** 2 / 16.0
    return fit_shaping_filter(omega, density * (whole / (float(np.sum(density)) * step)), order)


@dataclass(frozen=True)
class Components:
    """Bins of a spectrum for random-phase synthesis; each realisation draws a frequency within every
    bin and a phase, so that no realisation repeats itself."""

    low: Array
    """Lower edges of the bins [rad/s], (n_components,)."""
    width: Array
    """Widths of the bins [rad/s], (n_components,)."""
    amplitude: Array
    """Amplitudes of the boom tip, sqrt(2 S dω) |H| at the bin's centre [m], (n_components,)."""


@dataclass(frozen=True)
class MotionRecording:
    """A recorded boom-tip motion, cubic spline between its samples."""

    time: Array
    """Sample times [s], increasing."""
    heave: Array
    """Boom-tip heave, positive up [m]."""
    payout: Array | None
    """Cable paid out since the start [m], or None."""
    path: str
    """Where it was read from."""

    def sampled(self, instants: Array) -> tuple[Array, Array, Array]:
        """Heave, heave rate and pay-out at instants since the first sample [m, m/s, m].

        Raises:
            ValueError: If an instant lies beyond the last sample.
        """
        from scipy.interpolate import CubicSpline

        available = float(self.time[-1] - self.time[0])
        if instants[-1] > available + 1e-9:
            raise ValueError(
                f"motion file {self.path!r} lasts {available:g} s, the run {float(instants[-1]):g} s: give a "
                "shorter duration or a longer file"
            )
        at = np.minimum(self.time[0] + np.asarray(instants), self.time[-1])
        spline = CubicSpline(self.time, self.heave)
        payout = np.zeros(len(at))
        if self.payout is not None:
            paid_out = CubicSpline(self.time, self.payout)(at)
            payout = paid_out - paid_out[0]
        return spline(at), spline(at, 1), payout


def read_motion(path: str | Path) -> MotionRecording:
    """Reads a motion file: CSV with columns `time` [s], `heave` [m] and optionally `payout` [m].

    Lines that begin with # are comments. Any sampling will do.

    Raises:
        ValueError: If the file cannot be read, a column is missing, a value is missing or not a
            number, or the times do not increase.
    """
    arrays, lines = read_columns(path, "motion file", ("time", "heave"), ("payout",))
    if len(arrays["time"]) < 4:
        raise ValueError(f"motion file {str(path)!r} has {len(arrays['time'])} samples; give at least 4")
    steps = np.diff(arrays["time"])
    if not np.all(steps > 0.0):
        worst = int(np.argmax(steps <= 0.0)) + 1
        raise ValueError(
            f"motion file {str(path)!r} line {lines[worst]}: time {arrays['time'][worst]:g} s does "
            f"not come after {arrays['time'][worst - 1]:g} s; sort the times and drop repeated ones"
        )
    return MotionRecording(arrays["time"], arrays["heave"], arrays.get("payout"), str(path))
