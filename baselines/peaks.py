"""Feed-forward of the boom tip's motion, forecast as a sum of sinusoids found by Fourier transform.

The predictor of the crane literature: it needs no model of sea and vessel, but learns what frequencies the
motion has from its own record.

1. The last dozen periods of measured heave are transformed (FFT, Hann window); the largest peaks of the
   amplitude spectrum give the frequencies of the modes.
2. Their amplitudes and phases are found by an observer, which turns each mode by its frequency and corrects
   all of them by what the next sample says of their sum; it runs through the newer half of the record, and
   from then on over every sample that comes. Its gain is the stationary Kalman gain of oscillators that are
   pushed about just enough to lose their coherence within some periods.
3. The forecast is the sum of the modes, turned on by the time ahead.

The search for peaks is repeated every half period. Before the first, the modes have frequencies spread around
that of the design's sea, and the observer alone finds their phases.

A finite set of sinusoids holds for a few periods at best; its forecast is worse than the Kalman filter's
wherever the sea's spectrum is known.

Source: Küchler et al. (2011).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from baselines.feedforward import require_boom_tip
from baselines.linear_controller import LinearController, without_matrices
from baselines.model import nominal_sea, sea_filter
from heave_env.scenarios import Scenario
from heave_env.sea import Array
from heave_env.spectra import modal_omega

PERIODS = 12.0
"""Length of the record, in modal periods [-]."""
SAMPLES_PER_PERIOD = 16
"""Samples of the record in a modal period [-]."""
SEARCHES_PER_PERIOD = 2
"""Searches for peaks in a modal period [-]."""
N_MODES = 6
"""Peaks that are followed [-]."""
BAND = (0.3, 3.0)
"""Frequencies among which peaks are looked for, over the modal frequency [-]."""
PADDING = 4
"""Length of the transform over that of the record [-]: finer frequencies."""
COHERENCE = 4.0
"""Time in which a mode's variance is renewed, in modal periods [-]."""
LEAST_NOISE = 1e-3
"""Noise of a sample, at least, over the motion's standard deviation [-]."""
N_DOUBLINGS = 12
"""Doublings of the Riccati equation's time [-]: 4096 control steps."""


@dataclass(frozen=True, eq=False)
class PeakPredictor(LinearController):
    """Feed-forward of the modes' forecast. Memory of a row: the record; frequency, cosine, sine and the gains
    on these two of each mode; the steps since the episode began. The matrices are empty."""

    control_dt: float = 0.1
    """Control step [s]."""
    stride: int = 1
    """Control steps between samples of the record [-]."""
    n_samples: int = 0
    """Samples of the record [-]."""
    stride_of_search: int = 1
    """Control steps between searches for peaks, a multiple of `stride` [-]."""
    peak_omega: float = 0.0
    """Modal frequency of the design's sea [rad/s]."""
    ahead: float = 0.0
    """Time from the sample to the middle of the time that its command is held [s]."""
    time_constant: float = 0.0
    """The winch's lag [s]."""
    squared_period: float = 0.0
    """1/ω² of a second-order drive, zero of a lag [s²]."""
    noise_std: float = 0.0
    """Noise of a sample [m]."""
    heave_std: float = 0.0
    """Standard deviation that the boom tip's heave is expected to have [m]."""

    @property
    def n_memory(self) -> int:
        """Numbers remembered from step to step [-]."""
        return self.n_samples + 5 * N_MODES + 1

    def respond(self, y: Array, memory: Array) -> tuple[Array, Array]:
        """Command in metres, (n_envs, 1), and the next memory, for measurements in SI units."""
        memory = memory.copy()
        record, modes, step = np.split(memory, [self.n_samples, -1], axis=1)
        omega, cosine, sine, gain, cross_gain = np.split(modes, 5, axis=1)
        now, heave = step[:, 0].astype(int), y[:, 0]

        fresh = now == 0
        if fresh.any():
            omega[fresh], gain[fresh], cross_gain[fresh] = self.first_guess
        sampled = now % self.stride == 0
        place = now // self.stride
        record[sampled, place[sampled] % self.n_samples] = heave[sampled]
        searching = (now % self.stride_of_search == 0) & (place >= self.n_samples - 1)
        surprise = (heave - cosine.sum(axis=1))[:, None]
        cosine += gain * surprise
        sine += cross_gain * surprise
        if searching.any():
            found = self._modes_of(record[searching], place[searching])
            omega[searching], cosine[searching], sine[searching], *gains = found
            gain[searching], cross_gain[searching] = gains

        angle = omega * self.ahead
        c, s = np.cos(angle), np.sin(angle)
        ahead, slope = cosine * c - sine * s, -omega * (cosine * s + sine * c)
        wanted = ahead + self.time_constant * slope
        if self.squared_period:
            wanted -= self.squared_period * omega**2 * ahead
        command = self.clipped(-wanted.sum(axis=1, keepdims=True))

        angle = omega * self.control_dt
        c, s = np.cos(angle), np.sin(angle)
        turned = (omega, cosine * c - sine * s, cosine * s + sine * c, gain, cross_gain)
        return command, np.hstack([record, *turned, step + 1.0])

    @cached_property
    def first_guess(self) -> tuple[Array, Array, Array]:
        """Frequencies and gains until enough is recorded, each (N_MODES,)."""
        omega = self.peak_omega * np.linspace(0.5, 1.9, N_MODES)
        power = np.full((1, N_MODES), self.heave_std**2 / N_MODES)
        gain, cross_gain = self._gains(omega[None], power, self.control_dt)
        return omega, gain[0], cross_gain[0]

    def _gains(self, omega: Array, power: Array, dt: float) -> tuple[Array, Array]:
        """Stationary Kalman gains on cosine and sine of modes of given variances, sampled every `dt` seconds,
        (n_rows, N_MODES) each."""
        n, m = omega.shape
        angle = omega * dt
        A = np.zeros((n, 2 * m, 2 * m))
        i = np.arange(m)
        A[:, i, i] = A[:, m + i, m + i] = np.cos(angle)
        A[:, i, m + i], A[:, m + i, i] = -np.sin(angle), np.sin(angle)
        renewed = 4.0 * dt * self.peak_omega / (2.0 * math.pi * COHERENCE)
        total = power.sum(axis=1)
        noise = np.maximum(self.noise_std**2, LEAST_NOISE**2 * total) + 1e-12
        H = np.zeros_like(A)
        j = np.arange(2 * m)
        # Pushes change an oscillator's rate alone, which is its sine.
        H[:, j, j] = renewed * np.hstack([0.0 * power, power]) + 1e-9 * total[:, None] + 1e-15
        C = np.concatenate([np.ones(m), np.zeros(m)])
        # Doubling, as `baselines.kalman.doubled_riccati`, for all rows at once.
        transition, G = A.transpose(0, 2, 1), np.outer(C, C) / noise[:, None, None]
        eye = np.eye(2 * m)
        for _ in range(N_DOUBLINGS):
            inverse = np.linalg.solve(eye + G @ H, np.concatenate([transition, G], axis=2))
            forward, mixed = inverse[:, :, : 2 * m], inverse[:, :, 2 * m :]
            back = transition.transpose(0, 2, 1)
            H, G = H + back @ H @ forward, G + transition @ mixed @ back
            transition = transition @ forward
        towards = H @ C
        gain = towards / (towards @ C + noise)[:, None]
        return gain[:, :m], gain[:, m:]

    def _modes_of(self, record: Array, place: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Frequencies, cosines, sines and gains of the modes in records, each (n_rows, N_MODES)."""
        n, dt = self.n_samples, self.stride * self.control_dt
        # Oldest sample first.
        order = (place[:, None] + 1 + np.arange(n)) % n
        record = np.take_along_axis(record, order, axis=1)
        amplitude = np.abs(np.fft.rfft(record * np.hanning(n), PADDING * n, axis=1))
        omega = 2.0 * math.pi * np.fft.rfftfreq(PADDING * n, dt)
        middle = amplitude[:, 1:-1]
        is_peak = (middle >= amplitude[:, :-2]) & (middle > amplitude[:, 2:])
        is_peak &= (omega[1:-1] > BAND[0] * self.peak_omega) & (omega[1:-1] < BAND[1] * self.peak_omega)
        height = np.where(is_peak, middle, 0.0)
        chosen = np.argsort(-height, axis=1, kind="stable")[:, :N_MODES]
        frequency = omega[1:-1][chosen]

        tall = np.take_along_axis(height, chosen, axis=1)
        power = tall**2 / np.maximum((tall**2).sum(axis=1), 1e-300)[:, None] * record.var(axis=1)[:, None]
        gain, cross_gain = self._gains(frequency, power, dt)
        c, s = np.cos(frequency * dt), np.sin(frequency * dt)
        cosine, sine = np.zeros_like(frequency), np.zeros_like(frequency)
        for i in range(n // 2, n):
            cosine, sine = cosine * c - sine * s, cosine * s + sine * c
            surprise = (record[:, i] - cosine.sum(axis=1))[:, None]
            cosine, sine = cosine + gain * surprise, sine + cross_gain * surprise
        return frequency, cosine, sine, *self._gains(frequency, power, self.control_dt)


def feedforward_peaks(scenario: Scenario) -> PeakPredictor:
    """Designs the feed-forward with the peaks' forecast.

    Raises:
        ValueError: If the sea is calm, or the boom tip's heave is not measured.
    """
    require_boom_tip(scenario, "feedforward_peaks", ("boom_tip_heave",))
    sea = nominal_sea(scenario)
    if sea is None:
        raise ValueError(
            f"scenario {scenario.name!r} has a calm sea, in which there is nothing to forecast; choose a "
            "controller without a sea (lqr, delay_lqr) or another sea_state.kind"
        )
    waves, drive = sea_filter(scenario), scenario.winch.natural_omega
    assert waves is not None
    dt, period = scenario.control_dt, 2.0 * math.pi / modal_omega(sea)
    stride = max(1, round(period / SAMPLES_PER_PERIOD / dt))
    searches = max(1, round(period / SEARCHES_PER_PERIOD / (stride * dt)))
    measures = ("boom_tip_heave",)
    sensor = next(item for item in scenario.observed_sensors if item.channel == "boom_tip_heave")
    return PeakPredictor(
        **without_matrices("feedforward_peaks", scenario, measures),
        control_dt=dt,
        stride=stride,
        n_samples=math.ceil(PERIODS * period / (stride * dt)),
        stride_of_search=searches * stride,
        peak_omega=modal_omega(sea),
        ahead=sensor.delay + scenario.winch.command_delay + 0.5 * dt,
        time_constant=scenario.winch.lag,
        squared_period=0.0 if drive is None else drive**-2,
        noise_std=sensor.sample_std(dt),
        heave_std=math.sqrt((waves.C[0] @ waves.covariance @ waves.C[0]).item()),
    )
