"""The sea: spectrum, shaping filter, random-phase components and recorded motions.

All spectra are one-sided in angular frequency: the variance is the integral over ω > 0. The shaping
filter of Triantafyllou et al. (1983), fitted to that one-sided spectrum, is therefore driven by white
noise of intensity π (autocorrelation π δ), so that a transfer function H gives the variance
∫_0^∞ |H(iω)|² dω. The fit holds 94 % of the variance of the true spectrum.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from heave_env.parameters import SeaState

NOISE_INTENSITY = math.pi
"""Intensity of the white noise that drives filters fitted to one-sided spectra [rad/s · unit]."""

Array = np.ndarray


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


@dataclass(frozen=True)
class LinearFilter:
    """White noise of intensity π in, outputs out: x' = A x + B w, y = C x."""

    A: Array
    """Dynamics, (n_states, n_states)."""
    B: Array
    """Noise input, (n_states, 1)."""
    C: Array
    """Outputs, (n_outputs, n_states)."""

    @property
    def n_states(self) -> int:
        """Number of states [-]."""
        return len(self.A)

    @cached_property
    def covariance(self) -> Array:
        """Stationary covariance of the state: A P + P Aᵀ + π B Bᵀ = 0, (n_states, n_states)."""
        from scipy.linalg import solve_continuous_lyapunov

        P = solve_continuous_lyapunov(self.A, -NOISE_INTENSITY * self.B @ self.B.T)
        return np.asarray(0.5 * (P + P.T))

    def scaled(self) -> LinearFilter:
        """The same filter with states of unit stationary variance."""
        size = np.sqrt(np.diag(self.covariance))
        return LinearFilter(self.A * size / size[:, None], self.B / size[:, None], self.C * size)

    def discretised(self, dt: float) -> tuple[Array, Array]:
        """Exact transition over a step and covariance of the noise gathered in it.

        Source: Van Loan (1978).

        Args:
            dt: Step [s].

        Returns:
            F and Q with x_{k+1} = F x_k + v_k, cov(v) = Q; both (n_states, n_states).
        """
        return discretised_noise(self.A, NOISE_INTENSITY * self.B @ self.B.T, dt)

    def response(self, omega: Array) -> Array:
        """Transfer function from noise to outputs at iω, (n_omega, n_outputs), complex."""
        s = 1j * np.asarray(omega, dtype=float)[:, None, None]
        states = np.linalg.solve(s * np.eye(self.n_states) - self.A, self.B.astype(complex)[None])
        return np.asarray((self.C @ states)[..., 0])


def discretised_noise(A: Array, noise: Array, dt: float) -> tuple[Array, Array]:
    """Exact discretisation of x' = A x + w, w white of intensity `noise`.

    Source: Van Loan (1978), "Computing integrals involving the matrix exponential".

    Args:
        A: Dynamics, (n, n).
        noise: Intensity of the white noise, (n, n).
        dt: Step [s].

    Returns:
        Transition and noise covariance over the step, both (n, n).
    """
    from scipy.linalg import expm

    n = len(A)
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:], block[n:, n:] = -A, noise, A.T
    exponential = expm(block * dt)
    F = exponential[n:, n:].T
    Q = F @ exponential[:n, n:]
    return F, 0.5 * (Q + Q.T)


def square_root(covariance: Array) -> Array:
    """Lower-triangular factor S of a covariance, S Sᵀ = covariance, however ill-scaled its states.

    The states are brought to unit variance before the Cholesky factorisation, since a chain of
    integrators spans many orders of magnitude within a step.
    """
    size = np.sqrt(np.diag(covariance))
    safe = np.where(size > 0.0, size, 1.0)
    correlation = covariance / safe / safe[:, None]
    ridge = np.diag(np.where(size > 0.0, 1e-13, 1.0))
    return np.asarray(np.linalg.cholesky(correlation + ridge) * size[:, None])


def wave_filter(sea_state: SeaState) -> LinearFilter:
    """Six-state filter whose output is the elevation and its rate.

    H(s) = sqrt(S0) (s/ω0)² / [1 + 1.414 s/ω0 + (s/ω0)²]³, S0 = (1.25/(4 ω_m)) Hs² 1.8861,
    ω0 = 0.9538 ω_m.

    Source: Triantafyllou et al. (1983); Huang (1992), (6.21)-(6.23).
    """
    w0 = 0.9538 * sea_state.peak_omega
    S0 = 1.25 / (4.0 * sea_state.peak_omega) * sea_state.significant_wave_height**2 * 1.8861
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
    path = Path(path)
    try:
        with path.open(newline="", encoding="utf-8") as file:
            numbered = [
                (i, line) for i, line in enumerate(file, 1) if line.strip() and not line.startswith("#")
            ]
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise ValueError(f"cannot read motion file {str(path)!r}: {reason}") from error
    reader = csv.reader([line for _, line in numbered])
    header = [cell.strip() for cell in next(reader, [])]
    for column in ("time", "heave"):
        if column not in header:
            raise ValueError(
                f"motion file {str(path)!r} lacks the column {column!r} in its header {header!r}: name the "
                "columns time, heave and optionally payout"
            )
    wanted = [column for column in ("time", "heave", "payout") if column in header]
    values: dict[str, list[float]] = {column: [] for column in wanted}
    for (number, _), row in zip(numbered[1:], reader, strict=True):
        for column in wanted:
            place = header.index(column)
            text = row[place].strip() if place < len(row) else ""
            try:
                value = float(text)
            except ValueError:
                value = math.nan
            if not math.isfinite(value):
                raise ValueError(
                    f"motion file {str(path)!r} line {number}: {column} is {text!r}, which is no number; "
                    "fill the gap"
                )
            values[column].append(value)
    arrays = {column: np.array(items) for column, items in values.items()}
    if len(arrays["time"]) < 4:
        raise ValueError(f"motion file {str(path)!r} has {len(arrays['time'])} samples; give at least 4")
    steps = np.diff(arrays["time"])
    if not np.all(steps > 0.0):
        worst = int(np.argmax(steps <= 0.0)) + 1
        raise ValueError(
            f"motion file {str(path)!r} line {numbered[worst + 1][0]}: time {arrays['time'][worst]:g} s does "
            f"not come after {arrays['time'][worst - 1]:g} s; sort the times and drop repeated ones"
        )
    return MotionRecording(arrays["time"], arrays["heave"], arrays.get("payout"), str(path))
