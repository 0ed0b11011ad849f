"""What a comparison found: its scores in memory, and the files of its folder (`docs/files.md`)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from baselines.bound import CausalBound
from experiments import runs
from experiments.metrics import CONFIDENCE, METRICS, Summary, Window, paired_difference, summary
from experiments.rollout import Trajectory
from heave_env.controller import Controller
from heave_env.scenarios import Scenario, to_mapping

Array = np.ndarray

RESULT_COLUMNS = ("scenario", "controller", "metric", "unit", "value", "low", "high", "n_seas")
"""Columns of `results.csv`."""
SPREAD_METRICS = ("payload_heave_std", "cost", "cost_over_oracle")
"""Metrics whose median, 95 % and maximum over seas have rows of their own."""
DIFFERENCE_METRICS = ("payload_heave_std", "cost")
"""Metrics whose paired difference from the reference controller is given."""
CLAIRVOYANT = "clairvoyant"
"""What the rows of the yardstick that knows the coming sea say for a controller."""
STORED_CHANNELS = (
    "boom_tip_heave",
    "payload_heave",
    "winch_displacement",
    "winch_rate",
    "sheave_tension",
    "command",
)
"""Channels of the stored seas."""


@dataclass(frozen=True)
class Entry:
    """One controller in the comparison of one scenario."""

    label: str
    """Name in tables and files."""
    spec: str
    """What the user asked for."""
    controller: Controller
    """The controller itself."""
    information_set: str
    """What it sees."""

    def described(self) -> dict[str, Any]:
        """What the run file says of it."""
        found: dict[str, Any] = {
            "label": self.label,
            "spec": self.spec,
            "information_set": self.information_set,
            "measures": list(getattr(self.controller, "measures", ())),
        }
        for name in ("energy_index", "predicted_cost"):
            value = getattr(self.controller, name, None)
            if value is not None:
                found[name] = float(value)
        return found


@dataclass(frozen=True)
class Outcome:
    """What one controller did in all seas of one scenario."""

    entry: Entry
    values: dict[str, Array]
    """Each metric of each sea, (n_seas,)."""
    ends: dict[str, Array]
    """For each way to end early, which seas did, (n_seas,) bool."""
    sample: Trajectory
    """The first few seas in full."""
    omega: Array
    """Angular frequencies of the spectra [rad/s]."""
    spectra: dict[str, Array]
    """Spectral density of payload and boom-tip heave over all seas [m² s/rad]."""
    optimal_cost: float | None
    """The proven optimum of J with what this controller sees, where one is known."""
    decision_time: float = math.nan
    """Mean time of an action, per sea of the batch [s]."""
    batch: int = 0
    """Seas that the controller acted in at once [-]."""


@dataclass(frozen=True)
class Contest:
    """All controllers in one scenario."""

    scenario: Scenario
    part: Window
    outcomes: list[Outcome]
    bound: CausalBound | None = None
    """What no causal controller can beat, where it is known."""
    clairvoyant: Array | None = None
    """Least cost J of each sea for who knows it beforehand, (n_seas,), if it was asked for."""
    oracles: dict[str, Array] = field(default_factory=dict)
    """Cost J of each sea for who knows what it drew, by design, (n_seas,), if it was asked for; the last one
    is what `cost_over_oracle` is over."""

    @property
    def yardsticks(self) -> dict[str, Array]:
        """Costs J of those that are no rivals, by what their rows say for a controller."""
        known = {} if self.clairvoyant is None else {CLAIRVOYANT: self.clairvoyant}
        return known | self.oracles


@dataclass(frozen=True)
class Row:
    """One line of `results.csv`."""

    controller: str
    metric: str
    unit: str
    value: float
    low: float | None
    high: float | None
    n_seas: int


def outcome_arrays(outcome: Outcome) -> dict[str, Array]:
    """What is kept of an outcome: plain arrays by `part/name`, and the stored channels of the first seas."""
    sample = outcome.sample
    arrays = {
        "sample_seeds": np.array(sample.seeds, dtype=np.int64),
        "sample_n_valid": sample.n_valid,
        "omega": outcome.omega,
        "decision_time": np.array(outcome.decision_time),
        "batch": np.array(outcome.batch),
    }
    parts = {
        "values": outcome.values,
        "ends": outcome.ends,
        "spectra": outcome.spectra,
        "states": {name: row for name, row in sample.states.items() if name in STORED_CHANNELS},
        "steps": {name: row for name, row in sample.steps.items() if name in STORED_CHANNELS},
    }
    for part, rows in parts.items():
        narrow = part in ("states", "steps")
        arrays |= {f"{part}/{name}": row.astype(np.float32) if narrow else row for name, row in rows.items()}
    return arrays


def joined_arrays(parts: Sequence[dict[str, Array]]) -> dict[str, Array]:
    """What is kept of an outcome whose seas were run in several parts, without time series and spectra."""
    first = parts[0]
    if len(parts) == 1:
        return first
    counts = [len(part["values/cost"]) for part in parts]
    joined = {
        name: np.concatenate([part[name] for part in parts])
        for name in first
        if name.startswith(("values/", "ends/"))
    }
    times = [float(part["decision_time"]) for part in parts]
    return first | joined | {"decision_time": np.array(np.average(times, weights=counts))}


def outcome_of(arrays: dict[str, Array], entry: Entry, control_dt: float) -> Outcome:
    """The outcome that was kept of a controller; its proven optimum is left open.

    Args:
        arrays: What `outcome_arrays` made.
        entry: The controller.
        control_dt: Control step [s].
    """

    def part(name: str) -> dict[str, Array]:
        return {
            key.removeprefix(f"{name}/"): row for key, row in arrays.items() if key.startswith(f"{name}/")
        }

    return Outcome(
        entry=entry,
        values=part("values"),
        ends=part("ends"),
        sample=Trajectory(
            seeds=tuple(int(seed) for seed in arrays["sample_seeds"]),
            control_dt=control_dt,
            states=part("states"),
            steps=part("steps"),
            n_valid=arrays["sample_n_valid"],
        ),
        omega=arrays["omega"],
        spectra=part("spectra"),
        optimal_cost=None,
        decision_time=float(arrays["decision_time"]),
        batch=int(arrays["batch"]),
    )


def result_rows(contest: Contest, reference: str) -> list[Row]:
    """The tidy rows of a contest: every metric of every controller.

    Args:
        contest: All controllers in one scenario.
        reference: Label of the controller that differences are taken from.
    """
    rows: list[Row] = []
    against = next(item for item in contest.outcomes if item.entry.label == reference)
    for outcome in contest.outcomes:
        label = outcome.entry.label
        summaries = {name: summary(values) for name, values in outcome.values.items()}

        def add(
            metric: str, unit: str, value: float, interval: Summary | None, n: int, label: str = label
        ) -> None:
            low, high = (interval.low, interval.high) if interval is not None else (None, None)
            rows.append(Row(label, metric, unit, value, low, high, n))

        for name, found in summaries.items():
            add(name, METRICS[name].unit, found.mean, found, found.n_seas)
            if name in SPREAD_METRICS:
                for spread in ("median", "p95", "maximum"):
                    add(f"{name}_{spread}", METRICS[name].unit, getattr(found, spread), None, found.n_seas)
        if outcome.optimal_cost:
            ratio = summary(outcome.values["cost"] / outcome.optimal_cost)
            add("cost_ratio_to_optimum", "-", ratio.mean, ratio, ratio.n_seas)
        if outcome is not against:
            for name in DIFFERENCE_METRICS:
                found = paired_difference(outcome.values[name], against.values[name])
                add(f"{name}_difference", METRICS[name].unit, found.mean, found, found.n_seas)
        n_seas = len(outcome.values["cost"])
        for metric, value in bounds_of(contest.bound).items():
            add(f"{metric}_bound", METRICS[metric].unit, value, None, n_seas)
        if math.isfinite(outcome.decision_time):
            add("decision_time", "µs", 1e6 * outcome.decision_time, None, outcome.batch)
        for name, ended in outcome.ends.items():
            add(name, "seas", int(ended.sum()), None, n_seas)
        described = outcome.entry.described()
        for name in ("energy_index", "predicted_cost"):
            if name in described:
                add(name, "-", described[name], None, n_seas)
    for label, costs in contest.yardsticks.items():
        found = summary(costs)
        rows.append(Row(label, "cost", "-", found.mean, found.low, found.high, found.n_seas))
        for spread in ("median", "p95", "maximum"):
            rows.append(Row(label, f"cost_{spread}", "-", getattr(found, spread), None, None, found.n_seas))
    return rows


def bounds_of(bound: CausalBound | None) -> dict[str, float]:
    """The metrics that a causal controller cannot bring below a number, and that number."""
    if bound is None:
        return {}
    found = {"payload_heave_std": bound.payload_heave_std, "sheave_heave_std": bound.sheave_heave_std}
    return {metric: value for metric, value in found.items() if value is not None}


def write_contests(
    out: Path, contests: list[Contest], seeds: range, dtype: str, reference: str, made: dict[str, Any]
) -> None:
    """Writes every file of a comparison but its page.

    Args:
        out: The folder.
        contests: What happened in each scenario.
        seeds: Seeds of the seas.
        dtype: Precision of the plant.
        reference: Label of the controller that differences are taken from.
        made: The provenance.
    """
    rows = [
        (contest.scenario.name, *dataclasses.astuple(row))
        for contest in contests
        for row in result_rows(contest, reference)
    ]
    runs.write_arrays(out / runs.TRAJECTORIES_FILE, _arrays(contests))
    runs.write_text(out / runs.EPISODES_FILE, _episodes(contests, seeds))
    runs.write_text(out / runs.RESULTS_FILE, runs.table_text(RESULT_COLUMNS, rows))
    runs.write_json(out / runs.SUMMARY_FILE, _summary(contests, seeds, reference, made))
    runs.write_json(
        out / runs.RUN_FILE,
        {
            "kind": runs.COMPARISON,
            "scenarios": [
                {
                    "name": contest.scenario.name,
                    "fingerprint": contest.scenario.fingerprint,
                    "warm_up": contest.part.warm_up,
                    "scored": contest.part.scored,
                    "controllers": [outcome.entry.described() for outcome in contest.outcomes],
                    "scenario": to_mapping(contest.scenario),
                }
                for contest in contests
            ],
            "first_seed": seeds.start,
            "n_seeds": len(seeds),
            "dtype": dtype,
            "reference": reference,
            "interval": f"{100.0 * CONFIDENCE:.0f} % intervals of the mean over seas, Student t",
            "provenance": made,
        },
    )


def _arrays(contests: list[Contest]) -> dict[str, Array]:
    arrays: dict[str, Array] = {}
    for contest in contests:
        name = contest.scenario.name
        arrays[f"{name}/time"] = contest.outcomes[0].sample.time
        arrays[f"{name}/seed"] = np.array(contest.outcomes[0].sample.seeds)
        arrays[f"{name}/omega"] = contest.outcomes[0].omega
        for outcome in contest.outcomes:
            channels = outcome.sample.states | outcome.sample.steps
            for channel in STORED_CHANNELS:
                if channel in channels:
                    arrays[f"{name}/{outcome.entry.label}/{channel}"] = channels[channel].astype(np.float32)
            for channel, density in outcome.spectra.items():
                arrays[f"{name}/{outcome.entry.label}/{channel}_spectrum"] = density
    return arrays


def _episodes(contests: list[Contest], seeds: range) -> str:
    metrics = [name for name in METRICS if any(name in c.outcomes[0].values for c in contests)]
    ends = list(contests[0].outcomes[0].ends)
    headed = [f"{name} [{METRICS[name].unit}]" for name in metrics]
    columns = ["scenario", "controller", "seed", *headed, *ends]
    rows = []
    for contest in contests:
        for outcome in contest.outcomes:
            for i in range(len(outcome.values["cost"])):
                numbers = [outcome.values[name][i] if name in outcome.values else None for name in metrics]
                flags = [bool(outcome.ends[name][i]) for name in ends]
                label = outcome.entry.label
                rows.append((contest.scenario.name, label, seeds[i], *numbers, *flags))
    return runs.table_text(columns, rows)


def _summary(contests: list[Contest], seeds: range, reference: str, made: dict[str, Any]) -> dict[str, Any]:
    scenarios: dict[str, Any] = {}
    for contest in contests:
        rows = result_rows(contest, reference)
        controllers: dict[str, Any] = {}
        for outcome in contest.outcomes:
            label = outcome.entry.label
            spreads = {
                name: dataclasses.asdict(summary(values)) | {"unit": METRICS[name].unit}
                for name, values in outcome.values.items()
            }
            others = {
                row.metric: {
                    "mean": row.value,
                    "low": row.low,
                    "high": row.high,
                    "unit": row.unit,
                    "n_seas": row.n_seas,
                }
                for row in rows
                if row.controller == label
                and row.metric not in spreads
                and not row.metric.endswith(("_median", "_p95", "_maximum"))
            }
            controllers[label] = {
                "information_set": outcome.entry.information_set,
                "measures": outcome.entry.described()["measures"],
                "optimal_cost": outcome.optimal_cost,
                "metrics": spreads | others,
            }
        scenarios[contest.scenario.name] = {
            "fingerprint": contest.scenario.fingerprint,
            "command_delay": contest.scenario.winch.command_delay,
            "warm_up": contest.part.warm_up,
            "scored": contest.part.scored,
            "bound": None if contest.bound is None else dataclasses.asdict(contest.bound),
            "clairvoyant": None
            if contest.clairvoyant is None
            else dataclasses.asdict(summary(contest.clairvoyant)),
            "oracles": {
                label: dataclasses.asdict(summary(costs)) for label, costs in contest.oracles.items()
            },
            "controllers": controllers,
        }
    return {
        "scenarios": scenarios,
        "reference": reference,
        "first_seed": seeds.start,
        "n_seeds": len(seeds),
        "provenance": made,
    }
