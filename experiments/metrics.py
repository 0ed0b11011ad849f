"""Trajectory in, numbers out: one per sea and metric, and their summary over seas.

The first `WARM_UP` seconds of an episode are left out, the next `SCORED` seconds are scored: controllers
with a filter need the warm-up to settle, for the wave filter has a double zero at the origin. A control
step k is scored with the heave it ends at, x_{k+1}, as the reward is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from experiments.rollout import Trajectory
from heave_env.scenarios import Scenario

Array = np.ndarray

WARM_UP = 100.0
"""Time left out at the start of an episode [s]."""
SCORED = 300.0
"""Time that is scored after the warm-up [s]."""
JOULES_PER_KWH = 3.6e6
CONFIDENCE = 0.95
"""Level of every interval."""


@dataclass(frozen=True)
class Metric:
    """A column of numbers, one per sea."""

    unit: str
    """Unit, `-` for none."""
    meaning: str
    """What it is, in one line."""
    cable: bool = False
    """Whether only a plant with a cable has it."""
    landing: bool = False
    """Whether only an operation that is to land has it."""
    oracle: bool = False
    """Whether only a comparison with the oracle has it."""
    priced: bool = False
    """Whether only a task that puts a price on the winch's work has it."""


METRICS: dict[str, Metric] = {
    "payload_heave_std": Metric("m", "standard deviation of the payload's heave about its mean"),
    "payload_heave_rms": Metric("m", "root mean square of the payload's heave about still water"),
    "payload_heave_max": Metric("m", "largest magnitude of the payload's heave"),
    "sheave_heave_std": Metric("m", "standard deviation of boom-tip heave plus winch displacement"),
    "efficiency_boom_tip": Metric("-", "1 - std of payload heave / std of boom-tip heave"),
    "efficiency_locked_winch": Metric(
        "-", "1 - std of payload heave / std of payload heave in the same sea with the winch locked"
    ),
    "control_energy": Metric("m²", "mean square of the commanded winch displacement u0"),
    "command_std": Metric("m", "standard deviation of the commanded winch displacement"),
    "winch_work": Metric("J", "positive mechanical work of the winch: tension times speed", cable=True),
    "supply_energy": Metric("kWh", "energy drawn from the supply less what returns to it", cable=True),
    "winch_power_peak": Metric("W", "largest mean mechanical power of a control step", cable=True),
    "tension_peak": Metric("N", "largest tension anywhere along the cable", cable=True),
    "tension_p999": Metric("N", "tension anywhere along the cable that one step in 1000 exceeds", cable=True),
    "tension_min": Metric("N", "smallest tension anywhere along the cable", cable=True),
    "slack_fraction": Metric("-", "share of steps in which the tension fell to zero somewhere", cable=True),
    "touch_down_speed": Metric(
        "m/s", "downward speed of the payload as it landed, where it did", cable=True, landing=True
    ),
    "saturation_fraction": Metric("-", "share of steps in which a winch limit or the command range bit"),
    "safety_cost": Metric("-", "mean number of safety limits broken per step"),
    "cost": Metric("-", "J, the mean of q x² + r u0² + e |T v| / T_s and of what a failure costs"),
    "position_cost": Metric("-", "the part q x² of J"),
    "command_cost": Metric("-", "the part r u0² of J"),
    "energy_cost": Metric(
        "-", "the part e |T v| / T_s of J, where the winch's work has a price", priced=True
    ),
    "cost_over_oracle": Metric("-", "J over what the oracle costs in the same sea", oracle=True),
}
"""Metrics of a sea, in the order of the tables."""


def metric_names(scenario: Scenario) -> list[str]:
    """Metrics that a scenario has, in the order of the tables."""
    lands = scenario.task.landing_depth is not None
    return [
        name
        for name, metric in METRICS.items()
        if not (metric.cable and scenario.is_linear)
        and (lands or not metric.landing)
        and (scenario.task.energy_weight > 0.0 or not metric.priced)
        and not metric.oracle
    ]


@dataclass(frozen=True)
class Window:
    """The scored part of an episode, in control steps."""

    first: int
    """First scored step [-]."""
    count: int
    """Scored steps [-]."""
    control_dt: float
    """Control step [s]."""

    @property
    def warm_up(self) -> float:
        """Time left out [s]."""
        return round(self.first * self.control_dt, 9)

    @property
    def scored(self) -> float:
        """Time scored [s]."""
        return round(self.count * self.control_dt, 9)

    @property
    def is_shortened(self) -> bool:
        """Whether the episode was too short for the full protocol."""
        return self.warm_up < WARM_UP or self.scored < SCORED


def window(duration: float, control_dt: float, warm_up: float | None = None) -> Window:
    """The scored window of an episode: 300 s after 100 s of warm-up.

    In an episode shorter than 400 s the warm-up shrinks to a quarter of it, unless one is given.

    Args:
        duration: Length of the episode [s].
        control_dt: Control step [s].
        warm_up: Time left out at the start [s]; None: the protocol's.

    Raises:
        ValueError: If the warm-up is negative or leaves nothing to score.
    """
    n_steps = round(duration / control_dt)
    chosen = min(WARM_UP, 0.25 * duration) if warm_up is None else warm_up
    if not 0.0 <= chosen < duration:
        raise ValueError(
            f"warm-up must be at least 0 and below the episode's {duration:g} s, got {chosen!r}; "
            "give a shorter one"
        )
    first = min(math.floor(chosen / control_dt + 0.5), n_steps - 1)
    return Window(first, min(round(SCORED / control_dt), n_steps - first), control_dt)


def scores(trajectory: Trajectory, part: Window, locked: Trajectory | None = None) -> dict[str, Array]:
    """Each metric of each sea.

    Args:
        trajectory: What was recorded.
        part: The steps that count.
        locked: The same seas with the winch locked; without it the efficiency against it is NaN.

    Returns:
        Arrays (n_seas,) by metric; NaN where a sea ended before anything could be scored. Metrics of the
        tension are there only with a cable.

    Raises:
        ValueError: If `locked` holds other seas.
    """
    if locked is not None and locked.seeds != trajectory.seeds:
        raise ValueError("the locked winch must have run in the same seas; pair trajectories of equal seeds")
    steps = slice(part.first, part.first + part.count)
    ends = slice(part.first + 1, part.first + part.count + 1)
    valid = trajectory.valid[steps]
    heave = _masked(trajectory.states["payload_heave"][ends], valid)
    boom_tip = _masked(trajectory.states["boom_tip_heave"][ends], valid)
    sheave = boom_tip + _masked(trajectory.states["winch_displacement"][ends], valid)
    command = _masked(trajectory.steps["command"][steps], valid)
    payload_std = _std(heave)
    row = {
        "payload_heave_std": payload_std,
        "payload_heave_rms": np.sqrt(_mean(heave**2)),
        "payload_heave_max": _largest(np.abs(heave)),
        "sheave_heave_std": _std(sheave),
        "efficiency_boom_tip": removed(payload_std, _std(boom_tip)),
        "efficiency_locked_winch": np.full(trajectory.n_seas, np.nan),
        "control_energy": _mean(command**2),
        "command_std": _std(command),
    }
    if locked is not None:
        free = _masked(locked.states["payload_heave"][ends], locked.valid[steps])
        row["efficiency_locked_winch"] = removed(payload_std, _std(free))
    if trajectory.has_cable:
        power = _masked(trajectory.steps["winch_power"][steps], valid)
        supply = np.where(valid, trajectory.steps["supply_power"][steps], 0.0)
        work = np.where(valid, np.maximum(trajectory.steps["winch_power"][steps], 0.0), 0.0)
        row |= {
            "winch_work": np.where(valid.any(axis=0), work.sum(axis=0) * part.control_dt, np.nan),
            "supply_energy": np.where(
                valid.any(axis=0), supply.sum(axis=0) * part.control_dt / JOULES_PER_KWH, np.nan
            ),
            "winch_power_peak": np.maximum(_largest(power), 0.0),
            "tension_peak": _largest(_masked(trajectory.steps["tension_max"][steps], valid)),
            "tension_p999": _quantile(_masked(trajectory.steps["tension_max"][steps], valid), 0.999),
            "tension_min": -_largest(-_masked(trajectory.steps["tension_min"][steps], valid)),
            "slack_fraction": _mean(_masked(trajectory.steps["slack"][steps], valid)),
            "touch_down_speed": touch_down_speed(trajectory),
        }
    if "energy_cost" in trajectory.steps:
        row["energy_cost"] = _mean(_masked(trajectory.steps["energy_cost"][steps], valid))
    return row | {
        "saturation_fraction": _mean(_masked(trajectory.steps["saturated"][steps], valid)),
        "safety_cost": _mean(_masked(trajectory.steps["cost"][steps], valid)),
        "cost": mean_cost(trajectory, part),
        "position_cost": _mean(_masked(trajectory.steps["position_cost"][steps], valid)),
        "command_cost": _mean(_masked(trajectory.steps["command_cost"][steps], valid)),
    }


def removed(remaining: Array, whole: Array) -> Array:
    """Share of each sea's standard deviation that is gone, (n_seas,) [-]; NaN where there was none."""
    return 1.0 - _ratio(remaining, whole)


def touch_down_speed(trajectory: Trajectory) -> Array:
    """Downward speed of the payload at the end of the step in which it landed.

    Payload heave is counted from where the payload would hang still, which sinks as the operation pays out:
    the speed is the pay-out's, length plus winch displacement over the step, less the rate of heave. Left
    out is what the paid-out cable stretches, a strain times the pay-out rate.

    Returns:
        (n_seas,) [m/s]; NaN where the payload did not land.
    """
    landed = np.asarray(
        trajectory.outcomes.get("landed", np.zeros(trajectory.n_seas, dtype=bool)), dtype=bool
    )
    sea, last = np.arange(trajectory.n_seas), np.maximum(trajectory.n_valid, 1)
    still = trajectory.states["length"] + trajectory.states["winch_displacement"]
    paid_out = (still[last, sea] - still[last - 1, sea]) / trajectory.control_dt
    return np.where(landed, paid_out - trajectory.states["payload_heave_rate"][last, sea], np.nan)


def mean_cost(trajectory: Trajectory, part: Window) -> Array:
    """J of each sea: the mean stage cost over the scored steps, failures included.

    What a failure was charged is spread evenly over the steps that it forfeited, so that the scored steps
    bear their share of it, and no controller gains by failing before the scoring begins. A sea that
    ended well before its time (a landing) is averaged over the steps it had.

    Returns:
        (n_seas,) [-]; NaN where a landing left nothing to score.
    """
    stage = trajectory.steps["position_cost"] + trajectory.steps["command_cost"]
    if "energy_cost" in trajectory.steps:
        stage = stage + trajectory.steps["energy_cost"]
    charge = trajectory.steps["failure_cost"].sum(axis=0)
    failed = charge > 0.0
    forfeited = np.maximum(trajectory.n_steps - trajectory.n_valid, 1)
    stage = np.where(trajectory.valid, stage, np.where(failed, charge / forfeited, 0.0))
    # A sea that fails in its very last step forfeits none: that step bears the charge.
    full = failed & (trajectory.n_valid == trajectory.n_steps)
    stage[-1] += np.where(full, charge, 0.0)
    steps = slice(part.first, part.first + part.count)
    counted = np.where(failed, part.count, trajectory.valid[steps].sum(axis=0))
    total = np.where(trajectory.valid[steps] | failed, stage[steps], 0.0).sum(axis=0)
    return np.asarray(np.divide(total, counted, out=np.full(len(total), np.nan), where=counted > 0))


def _masked(values: Array, valid: Array) -> Array:
    return np.where(valid, values, np.nan)


def _count(values: Array) -> Array:
    return np.isfinite(values).sum(axis=0)


def _mean(values: Array) -> Array:
    count = _count(values)
    total = np.nansum(values, axis=0)
    return np.asarray(np.divide(total, count, out=np.full(len(count), np.nan), where=count > 0))


def _std(values: Array) -> Array:
    return np.asarray(np.sqrt(_mean((values - _mean(values)) ** 2)))


def _largest(values: Array) -> Array:
    largest = np.fmax.reduce(values, axis=0)
    return np.asarray(largest)


def _quantile(values: Array, share: float) -> Array:
    found = np.full(values.shape[1], np.nan)
    scored = np.isfinite(values).any(axis=0)
    found[scored] = np.nanquantile(values[:, scored], share, axis=0)
    return found


def _ratio(part: Array, whole: Array) -> Array:
    return np.asarray(np.divide(part, whole, out=np.full(len(part), np.nan), where=whole > 0.0))


@dataclass(frozen=True)
class Summary:
    """A metric over seas: its mean with a 95 % interval, and what the mean hides."""

    mean: float
    """Mean over the seas."""
    low: float
    """Lower end of the 95 % interval of the mean (Student t); NaN with one sea."""
    high: float
    """Upper end of it."""
    median: float
    """Median over the seas."""
    p95: float
    """95th percentile over the seas."""
    maximum: float
    """Largest over the seas."""
    n_seas: int
    """Seas that could be scored [-]."""


def summary(values: Array) -> Summary:
    """Mean, Student-t interval, median, 95 % and maximum over seas; NaN marks a sea without a score."""
    values = np.asarray(values, dtype=float)
    values = values[np.isfinite(values)]
    n = len(values)
    if n == 0:
        return Summary(*(math.nan,) * 6, n_seas=0)
    mean, half = float(values.mean()), math.nan
    if n > 1:
        from scipy.stats import t

        half = float(t.ppf(0.5 + 0.5 * CONFIDENCE, n - 1) * values.std(ddof=1) / math.sqrt(n))
    return Summary(
        mean=mean,
        low=mean - half,
        high=mean + half,
        median=float(np.median(values)),
        p95=float(np.quantile(values, 0.95)),
        maximum=float(values.max()),
        n_seas=n,
    )


def paired_difference(values: Array, reference: Array) -> Summary:
    """Summary of the differences, sea by sea, from a reference controller in the same seas."""
    return summary(np.asarray(values, dtype=float) - np.asarray(reference, dtype=float))


def spectrum(trajectory: Trajectory, part: Window, channel: str) -> tuple[Array, Array]:
    """Spectral density of a channel, averaged over the seas that lasted (Welch, Hann, half overlap).

    Args:
        trajectory: What was recorded.
        part: The steps that count.
        channel: A state channel.

    Returns:
        Angular frequency [rad/s] and one-sided density [unit² s/rad], (n_frequencies,): the variance is
        the integral over it. The density is NaN when no sea lasted.
    """
    from scipy.signal import welch

    ends = slice(part.first + 1, part.first + part.count + 1)
    series = trajectory.states[channel][ends, trajectory.n_valid >= part.first + part.count]
    segment = min(part.count, max(8, round(100.0 / part.control_dt)))
    if series.shape[1] == 0:
        frequency = np.fft.rfftfreq(segment, part.control_dt)
        return 2.0 * np.pi * frequency, np.full(len(frequency), np.nan)
    frequency, density = welch(
        series - series.mean(axis=0), fs=1.0 / part.control_dt, nperseg=segment, detrend=False, axis=0
    )
    return 2.0 * np.pi * frequency, density.mean(axis=1) / (2.0 * np.pi)
