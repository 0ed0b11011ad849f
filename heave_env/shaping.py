"""Shaping filters: white noise to motion, discretised exactly, and fitted to any spectrum.

A filter of order n = 2 m with the transfer function

    H(s) = g s² Π_j (s² + 2 ζ_j ω_j s + ω_j²) / Π_k (s² + 2 ζ_k ω_k s + ω_k²),

k up to m and j up to m - 2, driven by white noise of intensity π has the one-sided density |H(iω)|². It has
a double zero at the origin (no drift) and falls as ω⁻² (its density as ω⁻⁴), so that motion and rate have
finite variance and the rate no white noise in it, as the environment needs. Order 2 has no zeros, but the
same fall. The shape is fitted by least squares on the density, with a little weight on the rate's variance;
the gain makes the motion's variance exact.

Where it stops holding: a rational density does not vanish as exp(-1.25 (ω_m/ω)⁴) does at low frequency, nor
fall as ω⁻⁵. The second derivative of the motion has no finite variance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

Array = np.ndarray

NOISE_INTENSITY = math.pi
"""Intensity of the white noise that drives filters fitted to one-sided spectra [rad/s · unit]."""

RATE_WEIGHT = 0.1
"""Weight of the error in the rate's variance beside that of the density over its peak and bandwidth [-]."""


# Linear filters ----------------------------------------------------------------------------------


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

    @property
    def output_std(self) -> Array:
        """Stationary standard deviation of each output, (n_outputs,)."""
        return np.sqrt(np.diag(self.C @ self.covariance @ self.C.T))

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

    def unpredictable_std(self, horizon: float) -> Array:
        """What of each output cannot be known `horizon` ahead from the whole past of the noise.

        σ_min² = π ∫₀^h g(t)² dt with g the response to an impulse: the error of the best prediction.

        Source: Åström (1970), Kolmogorov and Wiener's predictor.

        Args:
            horizon: h, not negative [s].

        Returns:
            Standard deviations, (n_outputs,).

        Raises:
            ValueError: If the horizon is negative.
        """
        from scipy.linalg import expm

        if not horizon >= 0.0:
            raise ValueError(f"a horizon must not be negative, got {horizon!r} s")

        # By Gauss's quadrature on the response itself, which keeps its relative accuracy where Van Loan's
        # covariance of a chain of integrators drowns in rounding.
        fastest = float(np.max(np.abs(np.linalg.eigvals(self.A))))
        n_parts = max(1, math.ceil(horizon * fastest / 2.0))
        nodes, weights = np.polynomial.legendre.leggauss(16)
        part = horizon / n_parts
        start, total = self.B, np.zeros(len(self.C))
        at_nodes = [expm(self.A * (0.5 * part * (1.0 + node))) for node in nodes]
        over_part = expm(self.A * part)
        for _ in range(n_parts):
            for transition, weight in zip(at_nodes, weights, strict=True):
                total += 0.5 * part * weight * (self.C @ transition @ start)[:, 0] ** 2
            start = over_part @ start
        return np.sqrt(NOISE_INTENSITY * total)


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


# The fit -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SpectralErrors:
    """How far a filter is from a spectrum; each number is a ratio less one, but for the misfit."""

    variance: float
    """Of the motion [-]."""
    peak: float
    """Of the largest density [-]."""
    peak_omega: float
    """Of the frequency where it lies [-]."""
    rate: float
    """Of the rate's variance over the frequencies given, ∫ ω² |H|² dω [-]."""
    misfit: float
    """∫ | |H|² - S | dω over ∫ S dω [-]."""


def spectral_errors(given: LinearFilter, omega: Array, density: Array) -> SpectralErrors:
    """Compares a filter's first output with a one-sided density.

    Args:
        given: The filter.
        omega: Evenly spaced from near zero to the end of the tail [rad/s], (n_omega,).
        density: At each [unit² s], (n_omega,).
    """
    step = omega[1] - omega[0]
    achieved = np.abs(given.response(omega)[:, 0]) ** 2
    variance = float(np.sum(density) * step)
    return SpectralErrors(
        variance=float(given.output_std[0]) ** 2 / variance - 1.0,
        peak=float(achieved.max() / density.max()) - 1.0,
        peak_omega=float(omega[np.argmax(achieved)] / omega[np.argmax(density)]) - 1.0,
        rate=float(omega**2 @ achieved / (omega**2 @ density)) - 1.0,
        misfit=float(np.sum(np.abs(achieved - density)) * step / variance),
    )


@dataclass(frozen=True, eq=False)
class ShapingFit:
    """A fitted filter and how far it is from its spectrum."""

    order: int
    """States [-]."""
    poles: tuple[tuple[float, float], ...]
    """Frequency [rad/s] and damping ratio [-] of each pair."""
    zeros: tuple[tuple[float, float], ...]
    """Likewise, but for the double zero at the origin."""
    filter: LinearFilter
    """White noise to motion and its rate, in uncorrelated states of unit stationary variance."""
    errors: SpectralErrors
    """Of the filter; that of the variance is rounding, for the gain makes it exact."""


def fit_shaping_filter(omega: Array, density: Array, order: int) -> ShapingFit:
    """Fits a filter of even order to a one-sided spectral density by least squares.

    Deterministic: Levenberg-Marquardt with the exact Jacobian from a few fixed starts, whose poles lie at
    quantiles of the spectrum. Some tenths of a second for order 8.

    Args:
        omega: Evenly spaced from near zero to the end of the tail [rad/s], (n_omega,).
        density: At each, not negative [unit² s], (n_omega,).
        order: Even, at least 2.

    Raises:
        ValueError: If the order is odd or the spectrum has no variance.
    """
    if order < 2 or order % 2:
        raise ValueError(f"the order of a shaping filter must be even and at least 2, got {order!r}")
    step = omega[1] - omega[0]
    cumulative = np.cumsum(density) * step
    variance = float(cumulative[-1])
    if not variance > 0.0:
        raise ValueError("a spectrum without variance has no shaping filter; give a sea with waves")
    shares = cumulative / variance
    unit = float(omega[np.argmax(density)])
    grid, target = _resampled(omega / unit, density / float(density.max()), shares)
    shape = _least_squares(grid, target, _starts(omega / unit, shares, order // 2))
    k, m = order // 2, max(order // 2 - 2, 0)
    poles = [(unit * math.exp(a), math.exp(b)) for a, b in zip(shape[:k], shape[k : 2 * k], strict=True)]
    zeros = [
        (unit * math.exp(a), math.exp(b))
        for a, b in zip(shape[2 * k : 2 * k + m], shape[2 * k + m :], strict=True)
    ]
    poles, zeros = sorted(poles), sorted(zeros)
    cascade = _cascade(poles, zeros)
    gain = math.sqrt(variance) / float(cascade.output_std[0])
    fitted = orthonormal(LinearFilter(cascade.A, cascade.B, gain * cascade.C))
    return ShapingFit(order, tuple(poles), tuple(zeros), fitted, spectral_errors(fitted, omega, density))


def _resampled(omega: Array, density: Array, shares: Array, n: int = 300) -> tuple[Array, Array]:
    """Fewer frequencies, dense where the variance is, and the weighted target: rows of the fit."""
    mixed = 0.6 * shares + 0.4 * np.linspace(0.0, 1.0, len(omega)) ** 0.5
    picked = np.interp(np.linspace(mixed[0], mixed[-1], n), mixed, omega)
    return picked, np.interp(picked, omega, density)


def _starts(omega: Array, shares: Array, n_pairs: int) -> list[Array]:
    """First guesses: poles at quantiles, zeros either side of them; logarithms."""
    quantiles = (np.arange(n_pairs) + 0.5) / n_pairs
    poles = np.interp(quantiles, shares, omega)
    n_zeros = max(n_pairs - 2, 0)
    guesses = []
    for damping in (0.12, 0.35):
        for centre in (0.3, 2.0):
            zeros = centre * float(poles[0 if centre < 1.0 else -1]) * np.geomspace(0.8, 1.6, max(n_zeros, 1))
            guesses.append(
                np.log(
                    np.concatenate([poles, np.full(n_pairs, damping), zeros[:n_zeros], np.full(n_zeros, 0.5)])
                )
            )
    return guesses


def _least_squares(omega: Array, target: Array, starts: list[Array]) -> Array:
    """The best of the starts, followed to the end."""
    from scipy.optimize import least_squares

    # Trapezoidal weights of an uneven grid.
    gaps = np.diff(omega)
    width = 0.5 * (np.r_[gaps[0], gaps] + np.r_[gaps, gaps[-1]])
    rows, area = np.sqrt(width), float(width @ target)
    n_pairs = (len(starts[0]) + 4) // 4 if len(starts[0]) > 2 else 1
    sign = np.r_[-np.ones(n_pairs), np.ones(max(n_pairs - 2, 0))]
    place = np.r_[np.arange(n_pairs), 2 * n_pairs + np.arange(max(n_pairs - 2, 0))]
    damping = place + np.r_[np.full(n_pairs, n_pairs), np.full(max(n_pairs - 2, 0), max(n_pairs - 2, 0))]
    square = omega[:, None] ** 2
    by_rate = RATE_WEIGHT * width * omega**2 / float((width * omega**2) @ target)
    origin = 4.0 * np.log(omega) if n_pairs > 1 else np.zeros(len(omega))

    def residuals(shape: Array) -> tuple[Array, Array]:
        a, four = np.exp(2.0 * shape[place]), 4.0 * np.exp(2.0 * shape[damping])
        factors = (a - square) ** 2 + four * a * square
        logarithm = origin + np.log(factors) @ sign
        density = np.exp(logarithm - logarithm.max())
        density *= area / float(width @ density)
        slope = np.empty((len(omega), len(shape)))
        slope[:, place] = sign * (4.0 * a * (a - square) + 2.0 * four * a * square) / factors
        slope[:, damping] = sign * 2.0 * four * a * square / factors
        # The gain that keeps the variance moves with the shape.
        slope -= (width * density) @ slope / area
        of_rate = by_rate * density
        excess = float(np.sum(of_rate)) - RATE_WEIGHT
        return np.r_[rows * (density - target), excess], np.vstack(
            [(rows * density)[:, None] * slope, of_rate @ slope]
        )

    memory: dict[bytes, tuple[Array, Array]] = {}

    def both(shape: Array) -> tuple[Array, Array]:
        key = shape.tobytes()
        if key not in memory:
            memory.clear()
            memory[key] = residuals(shape)
        return memory[key]

    def improved(shape: Array, n_evaluations: int) -> tuple[float, Array]:
        limit = np.full(len(shape), 7.0)
        found = least_squares(
            lambda p: both(p)[0],
            np.clip(shape, -6.9, 2.9),
            jac=lambda p: both(p)[1],
            bounds=(-limit, 3.0 + 0.0 * limit),
            x_scale="jac",
            max_nfev=n_evaluations,
        )
        return float(found.cost), found.x

    tried = sorted((improved(start, 60) for start in starts), key=lambda pair: pair[0])
    return improved(tried[0][1], 300)[1]


def _cascade(poles: list[tuple[float, float]], zeros: list[tuple[float, float]]) -> LinearFilter:
    """Sections of second order in series: first poles alone, then s² over poles, then zeros over poles.

    Outputs are the motion and its rate. The noise reaches neither directly.
    """
    n = 2 * len(poles)
    numerators = [None, (0.0, 0.0), *((2.0 * zeta * w, w * w) for w, zeta in zeros)]
    A, B = np.zeros((n, n)), np.zeros((n, 1))
    B[1, 0] = 1.0
    carried = np.zeros(n)  # what the sections so far give, as a row on the state
    for i, (w, zeta) in enumerate(poles):
        damping, stiffness = 2.0 * zeta * w, w * w
        a, b = 2 * i, 2 * i + 1
        A[a, b], A[b, a], A[b, b] = 1.0, -stiffness, -damping
        A[b] += carried
        numerator = numerators[i]
        if numerator is None:
            carried[a] = 1.0
        else:
            carried = carried.copy()
            carried[a], carried[b] = numerator[1] - stiffness, numerator[0] - damping
    C = np.vstack([carried, carried @ A])
    return LinearFilter(A, B, C)


def orthonormal(given: LinearFilter) -> LinearFilter:
    """The same filter in states that are uncorrelated and of unit stationary variance.

    Nothing cancels in such coordinates: the outputs' rows are as long as their standard deviations.
    """
    from scipy.linalg import solve_triangular

    scaled = given.scaled()
    factor = square_root(scaled.covariance)
    A = solve_triangular(factor, scaled.A @ factor, lower=True)
    B = solve_triangular(factor, scaled.B, lower=True)
    return LinearFilter(A, B, scaled.C @ factor)
