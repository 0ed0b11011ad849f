"""What a league's scores say: every number of the leaderboard, with its interval over seas and trainings.

A number is a mean over all seas and trainings, a share of them, or a ratio of two means; its interval is a
percentile bootstrap that draws both anew (`experiments.statistics`). Ratios are paired: numerator and
denominator are of the same seas.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.metrics import METRICS
from experiments.results import Contest
from experiments.statistics import (
    Statistic,
    bootstrap,
    improvement,
    mean,
    mean_difference,
    mean_ratio,
    middle_mean,
    performance_profile,
)

Array = np.ndarray

NOMINAL = "nominal"
"""What the rows of a scenario as it is say for a variant."""
POOLED = "*"
"""What rows say for a scenario or variant that are over several of them."""
YARDSTICKS = ("lqg", "mpc", "mpc_l1", "multi_model", "multi_model_mpc")
"""Designs that every cost is also given over, where they take part."""
OPTIMUM = "optimum"
"""What the proven optimum is called among the yardsticks."""
SPREADS = ("median", "p95", "maximum")
"""What stands beside every mean."""
DIFFERENCES = ("cost", "payload_heave_std")
"""Metrics whose mean difference from the reference, sea by sea, is given."""
FAILURES = ("diverged", "lost")
"""Ways to end early that are none to wish for."""
LEAST_SEAS = 10
"""Seas below which nobody is called the best: a bootstrap of fewer promises too much [-]."""
PROFILE_ENDS = (0.01, 100.0)
"""Ratios beyond which a performance profile is cut off [-]."""
N_THRESHOLDS = 201
"""Points of a performance profile [-]."""


@dataclass(frozen=True)
class Result:
    """What one contestant did in one scenario or variant."""

    trainings: tuple[str, ...]
    """A name for each training; of a designed controller one, that is empty."""
    values: dict[str, Array]
    """Each metric, (n_trainings, n_seas); NaN where a sea has no score."""
    ends: dict[str, Array]
    """For each way to end early, which did, (n_trainings, n_seas) bool."""
    information_set: str
    """What it sees."""
    measures: tuple[str, ...]
    """What it measures."""
    optimal_cost: float | None
    """The proven optimum of J with what it sees, where one is known."""
    decision_time: float
    """Mean time of an action, per sea of the batch [s]."""
    batch: int
    """Seas that it acted in at once [-]."""
    decision_time_alone: float = math.nan
    """Mean time of an action of its first training in a single sea [s]."""

    @property
    def cost(self) -> Array:
        """J, (n_trainings, n_seas)."""
        return self.values["cost"]

    def training(self, i: int) -> Result:
        """One training alone."""
        return Result(
            (self.trainings[i],),
            {name: rows[i : i + 1] for name, rows in self.values.items()},
            {name: rows[i : i + 1] for name, rows in self.ends.items()},
            self.information_set,
            self.measures,
            self.optimal_cost,
            self.decision_time,
            self.batch,
            self.decision_time_alone,
        )


@dataclass(frozen=True)
class Cell:
    """One scenario, as it is or in one variant."""

    scenario: str
    """Name of the scenario, without the variant."""
    variant: str
    contest: Contest
    results: dict[str, Result]
    """By contestant."""


@dataclass(frozen=True)
class Quantity:
    """A number of the leaderboard."""

    value: float
    unit: str = "-"
    low: float | None = None
    high: float | None = None
    n_trainings: int = 1
    n_seas: int = 0


def yardsticks(cell: Cell, result: Result, reference: str) -> dict[str, Array]:
    """Costs that a contestant's are given over, by name, each (n_trainings, n_seas)."""
    found = {name: item.cost for name, item in cell.results.items() if name in (*YARDSTICKS, reference)}
    n_seas = result.cost.shape[1]
    if result.optimal_cost:
        found[OPTIMUM] = np.full((1, n_seas), result.optimal_cost)
    return found | {name: costs[None] for name, costs in cell.contest.yardsticks.items()}


def estimated(statistic: Statistic, strata: Sequence[Sequence[Array]], unit: str = "-") -> Quantity | None:
    """A statistic with its interval, over the seas in which everybody has a score; None if there are none."""
    kept = []
    for stratum in strata:
        scored = np.all([np.isfinite(scores).all(axis=0) for scores in stratum], axis=0)
        if not scored.any():
            return None
        kept.append([scores[:, scored] for scores in stratum])
    n_seas, n_trainings = sum(stratum[0].shape[1] for stratum in kept), len(kept[0][0])
    with np.errstate(divide="ignore", invalid="ignore"):
        found = bootstrap(statistic, kept)
    if not math.isfinite(found.value):
        return None
    if n_seas == len(kept):  # one sea says nothing of others
        return Quantity(found.value, unit, None, None, n_trainings, n_seas)
    return Quantity(found.value, unit, found.low, found.high, n_trainings, n_seas)


def ratios(ours: Array, theirs: Array) -> Array:
    """J over that of another in the same sea (the mean of its trainings), (n_trainings, n_seas).

    NaN where the other's is zero or has no score.
    """
    least = theirs.mean(axis=0)
    return np.divide(ours, least, out=np.full(ours.shape, np.nan), where=least > 0.0)


def quantities(cell: Cell, name: str, reference: str, result: Result | None = None) -> dict[str, Quantity]:
    """Every number of a contestant in a cell.

    Args:
        cell: The scenario or variant.
        name: The contestant.
        reference: The contestant that it is held against.
        result: What it did; None: with all its trainings.
    """
    whole, result = result is None, result or cell.results[name]
    found: dict[str, Quantity | None] = {}
    for yardstick, theirs in yardsticks(cell, result, reference).items():
        same = whole and yardstick == name
        found[f"cost_ratio_to_{yardstick}"] = (
            Quantity(1.0, n_trainings=len(result.trainings), n_seas=result.cost.shape[1])
            if same
            else estimated(mean_ratio, [[result.cost, theirs]])
        )
    against = cell.results[reference].cost
    paired = ratios(result.cost, against)
    found["cost_ratio_interquartile_mean"] = estimated(middle_mean, [[paired]])
    found |= _spread("cost_ratio", paired, "-")
    if name != reference:
        found["probability_of_improvement"] = estimated(improvement, [[result.cost, against]])
        for metric in DIFFERENCES:
            pair = [result.values[metric], cell.results[reference].values[metric]]
            found[f"{metric}_difference"] = estimated(mean_difference, [pair], METRICS[metric].unit)
    for metric, rows in result.values.items():
        if metric not in METRICS or metric == "cost_over_oracle":
            continue
        found[metric] = estimated(mean, [[rows]], METRICS[metric].unit)
        found |= _spread(metric, rows, METRICS[metric].unit)
    bound = cell.contest.bound
    if bound is not None and bound.payload_heave_std:
        std = result.values["payload_heave_std"] / bound.payload_heave_std
        found["payload_heave_std_ratio_to_bound"] = estimated(mean, [[std]])
    n_trainings, n_seas = result.cost.shape
    for end, rows in result.ends.items():
        found[end] = Quantity(int(rows.sum()), "seas", None, None, n_trainings, n_seas)
    if math.isfinite(result.decision_time):
        found["decision_time"] = Quantity(
            1e6 * result.decision_time, "µs", None, None, n_trainings, result.batch
        )
    if math.isfinite(result.decision_time_alone):
        found["decision_time_alone"] = Quantity(1e6 * result.decision_time_alone, "µs", None, None, 1, 1)
    return {key: item for key, item in found.items() if item is not None}


def failures(cells: Sequence[Cell]) -> list[dict[str, Any]]:
    """Who diverged or was lost, place by place and training by training: how many of how many seas."""
    found = []
    for cell in cells:
        for name, result in cell.results.items():
            for i, training in enumerate(result.trainings):
                counts = {end: int(result.ends[end][i].sum()) for end in FAILURES}
                if any(counts.values()):
                    place = {"scenario": cell.scenario, "variant": cell.variant, "entry": name}
                    n_seas = result.cost.shape[1]
                    found.append(place | {"training": training} | counts | {"n_seas": n_seas})
    return found


def failure_text(item: Mapping[str, Any]) -> str:
    """A line of `failures` in words: `mpc diverged in 3 of 256 seas of limits_linear@rougher`."""
    place = item["scenario"] if item["variant"] == NOMINAL else f"{item['scenario']}@{item['variant']}"
    who = f"{item['entry']} ({item['training']})" if item["training"] else item["entry"]
    done = {"diverged": "diverged in {}", "lost": "lost the payload in {}"}
    said = [words.format(item[end]) for end, words in done.items() if item[end]]
    return f"{who} {' and '.join(said)} of {item['n_seas']} seas of {place}"


def _spread(name: str, rows: Array, unit: str) -> dict[str, Quantity | None]:
    finite = rows[np.isfinite(rows)]
    if not len(finite):
        return {}
    values = (float(np.median(finite)), float(np.quantile(finite, 0.95)), float(finite.max()))
    n_seas = int(np.isfinite(rows).any(axis=0).sum())
    return {
        f"{name}_{spread}": Quantity(value, unit, None, None, len(rows), n_seas)
        for spread, value in zip(SPREADS, values, strict=True)
    }


def pooled(cells: Sequence[Cell], reference: str) -> dict[str, dict[str, Quantity]]:
    """What holds over several scenarios or variants, each counting alike, by contestant that ran in all."""
    names = [name for name in cells[0].results if all(name in cell.results for cell in cells)]
    found = {}
    for name in names:
        pairs = [[cell.results[name].cost, cell.results[reference].cost] for cell in cells]
        ours = [[ratios(*pair)] for pair in pairs]
        row = {
            f"cost_ratio_to_{reference}": Quantity(1.0)
            if name == reference
            else estimated(mean_ratio, pairs),
            "cost_ratio_interquartile_mean": estimated(middle_mean, ours),
        }
        if name != reference:
            row["probability_of_improvement"] = estimated(improvement, pairs)
        row |= _spread("cost_ratio", np.hstack([item[0] for item in ours]), "-")
        for end in cells[0].results[name].ends:
            rows = [cell.results[name].ends[end] for cell in cells]
            count = int(sum(item.sum() for item in rows))
            row[end] = Quantity(count, "seas", None, None, len(rows[0]), sum(item.shape[1] for item in rows))
        found[name] = {key: item for key, item in row.items() if item is not None}
    return found


def ranked(found: Mapping[str, Mapping[str, Quantity]], reference: str) -> list[str]:
    """Contestants by the ratio of their mean cost to the reference's, the lowest first."""

    def key(name: str) -> float:
        item = found[name].get(f"cost_ratio_to_{reference}")
        return math.inf if item is None else item.value

    return sorted(found, key=key)


def best(cells: Sequence[Cell], order: Sequence[str]) -> str | None:
    """The first of the ranked contestants if it is surely below every other one, else None.

    Surely means that the 95 % interval of the ratio of its mean cost to the other's lies below 1, over at
    least `LEAST_SEAS` seas.
    """
    if len(order) < 2 or any(cell.results[order[0]].cost.shape[1] < LEAST_SEAS for cell in cells):
        return None
    for other in order[1:]:
        item = estimated(
            mean_ratio, [[cell.results[order[0]].cost, cell.results[other].cost] for cell in cells]
        )
        if item is None or item.high is None or not item.high < 1.0:
            return None
    return order[0]


def profiles(cells: Sequence[Cell], names: Sequence[str], reference: str) -> dict[str, Any]:
    """Performance profiles: for each threshold, the share of seas and trainings whose ratio is at most it.

    Several cells are joined, sea by sea. Ratios beyond `PROFILE_ENDS` are left out of the thresholds.
    """
    scores = {}
    for name in names:
        pairs = [(cell.results[name].cost, cell.results[reference].cost) for cell in cells]
        joined = np.hstack([ratios(*pair).ravel() for pair in pairs])
        joined = joined[np.isfinite(joined)]
        if len(joined):
            scores[name] = joined
    if not scores:
        return {"thresholds": [], "shares": {}}
    low = min(float(item.min()) for item in scores.values())
    high = max(float(np.quantile(item, 0.99)) for item in scores.values())
    low, high = (float(np.clip(end, *PROFILE_ENDS)) for end in (low, high))
    thresholds = np.geomspace(0.97 * min(low, 1.0), 1.03 * max(high, 1.0), N_THRESHOLDS)
    return {
        "thresholds": np.round(thresholds, 8),
        "shares": {name: np.round(performance_profile(item, thresholds), 5) for name, item in scores.items()},
    }
