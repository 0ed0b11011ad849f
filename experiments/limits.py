"""Limits on metrics, and whether the seas of a class keep them.

The statistic that is held against a limit is the mean over the seas, or a quantile. Its 95 % interval says
whether more seas could turn the verdict: Student's t for the mean; for a quantile the order statistics, which
hold for any distribution and are infinite where the seas are too few for them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from experiments.metrics import CONFIDENCE, METRICS, summary
from heave_env.parameters import name_hint
from heave_env.scenarios import Scenario

Array = np.ndarray

LEFT_OUT = ("efficiency_locked_winch",)
"""Metrics that need a second run with the winch locked, and have no limit here."""
AT_LEAST = ("efficiency_boom_tip", "tension_min")
"""Metrics of which more is better: their limit is the least that is allowed."""


@dataclass(frozen=True)
class Limit:
    """The most of a metric under which work goes on, or the least where more is better."""

    metric: str
    bound: float
    """In the metric's unit."""

    @property
    def at_least(self) -> bool:
        """Whether the bound is a least."""
        return self.metric in AT_LEAST

    def keeps(self, value: float) -> bool:
        """Whether a value lies within the limit; one that does not exist does not."""
        return value >= self.bound if self.at_least else value <= self.bound

    def __str__(self) -> str:
        unit = METRICS[self.metric].unit
        said = f"{self.metric} {'≥' if self.at_least else '≤'} {self.bound:g}"
        return said if unit == "-" else f"{said} {unit}"


@dataclass(frozen=True)
class Seas:
    """What one controller did in the seas of one class."""

    values: dict[str, Array]
    """Each metric of each sea, (n_seas,); NaN where there is no score."""
    failed: Array
    """Seas that diverged or in which the payload was lost, (n_seas,) bool."""


@dataclass(frozen=True)
class Judged:
    """A statistic over the seas of a class, with its 95 % interval; infinite where seas are too few."""

    value: float
    low: float
    high: float
    worst: float
    """The worst of the seas that could be scored."""
    n_seas: int
    """Seas that count [-]."""

    def kept(self, limit: Limit) -> bool:
        """Whether the statistic keeps the limit."""
        return limit.keeps(self.value)

    def kept_surely(self, limit: Limit) -> bool:
        """Whether the whole interval does."""
        return limit.keeps(self.low) and limit.keeps(self.high)

    def kept_perhaps(self, limit: Limit) -> bool:
        """Whether some of it does."""
        return limit.keeps(self.low) or limit.keeps(self.high)


def limits_of(text: str, scenario: Scenario) -> tuple[Limit, ...]:
    """The limits in `METRIC=VALUE,...`, checked against what the scenario has.

    Raises:
        ValueError: If there is none, or one names no metric, a metric twice or no number.
    """
    known = [name for name, item in METRICS.items() if not (item.cable and scenario.is_linear)]
    known = [name for name in known if name not in LEFT_OUT]
    limits: dict[str, Limit] = {}
    for item in filter(str.strip, text.split(",")):
        metric, equals, number = (part.strip() for part in item.partition("="))
        if not equals:
            raise ValueError(f"--limits wants METRIC=VALUE, as payload_heave_std=0.1, got {item.strip()!r}")
        if metric not in known:
            hint = name_hint(metric, known, "it may be one of the following")
            if metric in METRICS and metric not in LEFT_OUT:
                hint = f"scenario {scenario.name!r} has no cable"
            raise ValueError(f"no limit can be set to {metric!r}: {hint}; metrics: {', '.join(known)}")
        if metric in limits:
            raise ValueError(f"the limit of {metric} is given twice; give it once")
        try:
            bound = float(number)
        except ValueError:
            bound = math.nan
        if not math.isfinite(bound) or (bound < 0.0 and metric not in AT_LEAST):
            raise ValueError(f"the limit of {metric} must be a number that can be kept, got {number!r}")
        limits[metric] = Limit(metric, bound)
    if not limits:
        raise ValueError("no limit was given; say for instance --limits payload_heave_std=0.1")
    return tuple(limits.values())


def judged(seas: Seas, metric: str, quantile: float | None = None) -> Judged:
    """The statistic of a metric over the seas of a class.

    A sea in which the payload was lost or the simulation diverged keeps no limit: it counts as infinitely
    bad. A sea without a score (it landed before the scoring began) does not count.

    Args:
        seas: What happened.
        metric: The metric.
        quantile: None for the mean (interval: Student's t); otherwise the value that at least this share
            of the seas keeps (interval: order statistics, whatever the distribution).
    """
    # Turned over where more is better, so that larger is worse.
    sign = -1.0 if metric in AT_LEAST else 1.0
    values = np.where(seas.failed, np.inf, sign * seas.values[metric])
    values = np.sort(values[~np.isnan(values)])
    scored = sign * seas.values[metric][np.isfinite(seas.values[metric])]
    n, worst = len(values), sign * float(scored.max()) if len(scored) else math.nan
    if n == 0:
        return Judged(math.nan, math.nan, math.nan, worst, 0)
    if quantile is not None:
        value, low, high = _quantile(values, quantile)
    elif np.isinf(values[-1]):
        value = low = high = math.inf
    else:
        item = summary(values)
        value = item.mean
        low, high = (item.low, item.high) if n > 1 else (-math.inf, math.inf)
    low, high = sorted((sign * low, sign * high))
    return Judged(sign * value, low, high, worst, n)


def seas_needed(quantile: float | None) -> int:
    """Least number of seas whose interval is finite, so that a limit can surely be kept."""
    if quantile is None:
        return 2
    n = 1
    while not _quantile(np.zeros(n), quantile)[2] < np.inf:
        n += 1
    return n


def _quantile(values: Array, share: float) -> tuple[float, float, float]:
    """The value that at least `share` of the sorted values do not exceed, with its 95 % interval."""
    from scipy.stats import binom

    n, tail = len(values), 0.5 * (1.0 - CONFIDENCE)
    padded = np.concatenate([[-np.inf], values, [np.inf]])
    ranks = (
        math.ceil(share * n - 1e-9),
        int(binom.ppf(tail, n, share)),
        int(binom.ppf(1.0 - tail, n, share)) + 1,
    )
    value, low, high = (float(padded[min(max(rank, 0), n + 1)]) for rank in ranks)
    return value, low, high


@dataclass(frozen=True)
class Verdicts:
    """Of one controller, which classes are operable, (n_cells,) bool each."""

    operable: Array
    """Every limit is kept by the statistic."""
    surely: Array
    """Every limit is kept by its whole interval."""
    perhaps: Array
    """No limit is broken by its whole interval."""
    kept: dict[str, Array]
    """By metric, whether its limit alone is kept."""


def verdicts(row: Sequence[Seas], limits: Sequence[Limit], quantile: float | None = None) -> Verdicts:
    """Judges every class of one controller."""
    kept, surely, perhaps = {}, [], []
    for limit in limits:
        statistics = [judged(seas, limit.metric, quantile) for seas in row]
        kept[limit.metric] = np.array([item.kept(limit) for item in statistics])
        surely.append([item.kept_surely(limit) for item in statistics])
        perhaps.append([item.kept_perhaps(limit) for item in statistics])
    return Verdicts(
        operable=np.all(list(kept.values()), axis=0),
        surely=np.all(surely, axis=0),
        perhaps=np.all(perhaps, axis=0),
        kept=kept,
    )
