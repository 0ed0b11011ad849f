"""What is measured of the plant: channels, noise, scale and delay, and the sets of them.

An observation is a float32 vector: each measured channel minus its offset over its scale, clipped to
±`OBSERVATION_BOUND`, newest sample first within the history lags, followed by the pending commands
as fractions of the command range, the most recent first.
"""

from __future__ import annotations

from dataclasses import dataclass

from heave_env.parameters import require, require_number

OBSERVATION_BOUND = 50.0
"""Scaled observations are clipped here; far beyond any healthy value."""

CHANNELS: dict[str, str] = {
    "payload_heave": "m",
    "payload_heave_rate": "m/s",
    "boom_tip_heave": "m",
    "boom_tip_heave_rate": "m/s",
    "winch_displacement": "m",
    "winch_rate": "m/s",
    "sheave_tension": "N",
    "length": "m",
}
"""Channels that a sensor can read, with their units."""

INFORMATION_SETS = ("full_state", "sensors", "sensors_history")


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """One measured channel: (true value + noise) of `delay` seconds ago, scaled."""

    channel: str
    """Which of `CHANNELS` is read."""
    scale: float | None = None
    """Characteristic size that the observation is divided by [unit of the channel]; null: the
    scenario's own size for the channel."""
    offset: float = 0.0
    """Subtracted before scaling [unit of the channel]."""
    noise_std: float = 0.0
    """Standard deviation of the white noise of a sample [unit of the channel]."""
    noise_density: float = 0.0
    """Spectral density of the white noise [unit² s]; adds density / control_dt to a sample's variance."""
    delay: float = 0.0
    """Age of the value read [s]; a multiple of the control step."""

    def __post_init__(self) -> None:
        require(self.channel in CHANNELS, self, "channel", f"one of {', '.join(CHANNELS)}")
        require_number(self, "scale", positive=True, optional=True)
        require_number(self, "offset")
        require_number(self, "noise_std", non_negative=True)
        require_number(self, "noise_density", non_negative=True)
        require_number(self, "delay", non_negative=True)

    def sample_std(self, control_dt: float) -> float:
        """Standard deviation of one sample's noise [unit of the channel]."""
        return float((self.noise_std**2 + self.noise_density / control_dt) ** 0.5)
