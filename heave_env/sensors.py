"""What is measured of the plant: channels, noise, scale and delay, and the sets of them.

An observation is a float32 vector: each measured channel minus its offset over its scale, clipped to
±`OBSERVATION_BOUND`, newest sample first within the history lags, followed by the pending commands
as fractions of the command range, the most recent first.
"""

from __future__ import annotations

import math
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
    "compensator_displacement": "m",
    "compensator_rate": "m/s",
}
"""Channels that a sensor can read, with their units."""
CABLE_CHANNELS = ("sheave_tension", "length", "compensator_displacement", "compensator_rate")
"""Those that only a plant with a cable has."""
COMPENSATOR_CHANNELS = ("compensator_displacement", "compensator_rate")
"""Those that only a plant with a passive compensator has."""

INFORMATION_SETS = ("full_state", "sensors", "sensors_history")

SENSOR_ERRORS = ("scale_error", "bias", "interval", "dropout", "high_pass_omega")
"""Fields of a sensor that make it worse than noise and delay do; zero or null, they are off."""


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """One measured channel: (true value + noise) of `delay` seconds ago, scaled.

    In order: high-pass, scale error and bias, noise, what interval and drop-outs hold back, delay.
    """

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
    scale_error: float = 0.0
    """Standard deviation of the share by which it reads too much, drawn for each episode [-]."""
    bias: float = 0.0
    """Standard deviation of its constant error, drawn for each episode [unit of the channel]."""
    interval: float | None = None
    """Time between readings, each held until the next [s]; a multiple of the control step; null: every
    control step."""
    dropout: float = 0.0
    """Probability that a reading is lost and the last one stays [-]."""
    high_pass_omega: float | None = None
    """Corner of a second-order high-pass, damping 0.7, as motion reference units have, which find heave by
    integrating twice [rad/s]; null: none."""

    def __post_init__(self) -> None:
        require(self.channel in CHANNELS, self, "channel", f"one of {', '.join(CHANNELS)}")
        require_number(self, "scale", positive=True, optional=True)
        require_number(self, "offset")
        require_number(self, "noise_std", non_negative=True)
        require_number(self, "noise_density", non_negative=True)
        require_number(self, "delay", non_negative=True)
        require_number(self, "scale_error", non_negative=True)
        require_number(self, "bias", non_negative=True)
        require_number(self, "interval", positive=True, optional=True)
        require_number(self, "dropout", non_negative=True)
        require(self.dropout < 1.0, self, "dropout", "a probability below 1")
        require_number(self, "high_pass_omega", positive=True, optional=True)
        if self.high_pass_omega is not None and self.channel in ("sheave_tension", "length"):
            raise ValueError(
                f"Sensor.high_pass_omega contradicts Sensor.channel {self.channel!r}, whose mean it would "
                "take away; leave high_pass_omega at null"
            )

    @property
    def is_plain(self) -> bool:
        """Whether noise, scale and delay are all that stands between truth and reading."""
        return not any(getattr(self, name) for name in SENSOR_ERRORS)

    def sample_std(self, control_dt: float) -> float:
        """Standard deviation of one sample's noise [unit of the channel]."""
        return float((self.noise_std**2 + self.noise_density / control_dt) ** 0.5)


HIGH_PASS_DAMPING = 0.7
"""Damping ratio of a heave filter [-]."""


def motion_reference_unit(delay: float = 0.1) -> tuple[Sensor, ...]:
    """Boom-tip heave and its rate as a good motion reference unit gives them.

    Data sheets say 5 cm or 5 %, whichever is more; taken as two standard deviations, half of it as noise,
    half as scale error of the whole episode. Its heave filter has a period of 60 s. It reads at 100 Hz or
    more, so at every control step.
    """
    high_pass = 2.0 * math.pi / 60.0
    return tuple(
        Sensor(channel=channel, noise_std=0.0125, scale_error=0.0125, high_pass_omega=high_pass, delay=delay)
        for channel in ("boom_tip_heave", "boom_tip_heave_rate")
    )


def acoustic_depth() -> Sensor:
    """Payload heave by acoustics or pressure: one reading a second, a second old, one in twenty lost."""
    return Sensor(channel="payload_heave", noise_std=0.02, interval=1.0, delay=1.0, dropout=0.05)


def winch_encoder() -> Sensor:
    """Winch displacement counted at the drum, good to a millimetre."""
    return Sensor(channel="winch_displacement", noise_std=0.001)


def load_cell(full_scale: float) -> Sensor:
    """Sheave tension from a load pin: noise of 0.25 % of full scale [N], scale error of 0.5 %."""
    return Sensor(channel="sheave_tension", noise_std=0.0025 * full_scale, scale_error=0.005)
