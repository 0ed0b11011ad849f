"""Scenarios x controllers x seeds: the same unseen seas for everybody, scored and written down.

A comparison's folder is described in `docs/files.md`, its protocol in `docs/comparison.md`.
"""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments import runs
from experiments.metrics import (
    CONFIDENCE,
    METRICS,
    SCORED,
    WARM_UP,
    Summary,
    Window,
    paired_difference,
    scores,
    spectrum,
    summary,
    window,
)
from experiments.provenance import provenance
from experiments.rollout import FIRST_TEST_SEED, Trajectory, batches, rollout, with_duration
from heave_env.controller import Controller, NoControl
from heave_env.scenarios import Scenario, to_mapping

Array = np.ndarray

AGENT_PREFIX = "agent:"
RESULT_COLUMNS = ("scenario", "controller", "metric", "unit", "value", "low", "high", "n_seas")
"""Columns of `results.csv`."""
SPREAD_METRICS = ("payload_heave_std", "cost")
"""Metrics whose median, 95 % and maximum over seas have rows of their own."""
DIFFERENCE_METRICS = ("payload_heave_std", "cost")
"""Metrics whose paired difference from the reference controller is given."""
STORED_CHANNELS = ("boom_tip_heave", "payload_heave", "winch_displacement", "sheave_tension", "command")
"""Channels of the stored seas."""
N_STORED_SEAS = 3
"""Seas whose time series are stored [-]."""


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


@dataclass(frozen=True)
class Contest:
    """All controllers in one scenario."""

    scenario: Scenario
    part: Window
    outcomes: list[Outcome]


def controller_names() -> tuple[str, ...]:
    """Names of the designed controllers."""
    from baselines import CONTROLLERS

    return tuple(CONTROLLERS)


def check_specs(specs: Sequence[str]) -> tuple[str, ...]:
    """The controllers asked for, each a known name or `agent:RUN`, none twice.

    Raises:
        ValueError: If one is unknown, repeated, or there is none.
    """
    wanted = tuple(spec.strip() for spec in specs if spec.strip())
    if not wanted:
        raise ValueError(f"no controller was named; choose from {', '.join(controller_names())}, agent:RUN")
    for spec in wanted:
        if wanted.count(spec) > 1:
            raise ValueError(f"controller {spec!r} is named twice; name it once")
        if spec.startswith(AGENT_PREFIX):
            if not spec.removeprefix(AGENT_PREFIX):
                raise ValueError("agent: lacks the run folder; write agent:RUN, as agent:runs/demo/ppo")
            run = spec.removeprefix(AGENT_PREFIX)
            if not Path(run).exists():
                raise ValueError(f"there is no run {run!r}; train one with heave train")
        elif spec not in controller_names():
            close = difflib.get_close_matches(spec, controller_names(), n=1)
            known = ", ".join(controller_names())
            hint = f"did you mean {close[0]!r}?" if close else f"known: {known}, agent:RUN"
            raise ValueError(f"unknown controller {spec!r}; {hint}")
    return wanted


def labels_of(specs: Sequence[str]) -> dict[str, str]:
    """A short label per controller: `agent:` and the run's folder name, the whole path where that clashes."""

    def short(spec: str) -> str:
        if not spec.startswith(AGENT_PREFIX):
            return spec
        path = Path(spec.removeprefix(AGENT_PREFIX)).resolve()
        return AGENT_PREFIX + (path.parent.name if path.is_file() else path.name)

    shorts = [short(spec) for spec in specs]
    return {spec: name if shorts.count(name) == 1 else spec for spec, name in zip(specs, shorts, strict=True)}


def controller_of(spec: str, scenario: Scenario, *, allow_other_scenario: bool = False) -> Controller:
    """The designed controller of that name, or the policy of an `agent:RUN`, for a scenario.

    Raises:
        ValueError: If there is no such controller, or it does not fit the scenario.
    """
    (spec,) = check_specs([spec])
    if spec == "none":
        return NoControl()
    if spec.startswith(AGENT_PREFIX):
        from agents.policy import load_policy

        path = spec.removeprefix(AGENT_PREFIX)
        return load_policy(path, scenario, allow_other_scenario=allow_other_scenario)
    import baselines

    return baselines.design(spec, scenario)


def run_contest(
    scenario: Scenario,
    entries: Sequence[Entry],
    seeds: Sequence[int],
    *,
    warm_up: float | None = None,
    dtype: str = "float64",
    progress: Callable[[str, int], None] | None = None,
) -> Contest:
    """Runs every controller in the same seas of a scenario and scores it.

    Args:
        scenario: The operation, with the duration that is wanted.
        entries: The controllers.
        seeds: One seed per sea.
        warm_up: Time left out at the start [s]; None: the protocol's.
        dtype: Precision of the plant.
        progress: Called with a label and a number of steps done since the last call.

    Returns:
        Scores and the first seas in full.
    """
    from baselines.bound import optimal_cost

    part = window(scenario.duration, scenario.control_dt, warm_up)
    collected: dict[str, list[tuple[Trajectory, dict[str, Array], Array, dict[str, Array]]]] = {}

    def run(entry: Entry, batch: tuple[int, ...]) -> Trajectory:
        def report(count: int) -> None:
            if progress is not None:
                progress(entry.label, count)

        return rollout(
            scenario,
            entry.controller,
            batch,
            dtype=dtype,
            information_set=entry.information_set,
            progress=report,
        )

    uncontrolled = Entry("locked winch", "none", NoControl(), scenario.information_set)
    for batch in batches(scenario, seeds):
        named = next((entry for entry in entries if entry.spec == "none"), uncontrolled)
        locked = run(named, batch)
        for entry in entries:
            trajectory = locked if entry is named else run(entry, batch)
            spectra = {}
            for channel in ("payload_heave", "boom_tip_heave"):
                omega, spectra[channel] = spectrum(trajectory, part, channel)
            room = max(0, N_STORED_SEAS - sum(item[0].n_seas for item in collected.get(entry.label, [])))
            row = scores(trajectory, part, locked) | {
                f"ended:{name}": rows for name, rows in trajectory.outcomes.items()
            }
            collected.setdefault(entry.label, []).append((trajectory.selected(room), row, omega, spectra))
    optima = {
        sees: optimal_cost(dataclasses.replace(scenario, information_set=sees))
        for sees in {entry.information_set for entry in entries}
    }
    outcomes = []
    for entry in entries:
        parts = collected[entry.label]
        rows = {name: np.concatenate([item[1][name] for item in parts]) for name in parts[0][1]}
        outcomes.append(
            Outcome(
                entry=entry,
                values={name: rows[name] for name in METRICS if name in rows},
                ends={name.removeprefix("ended:"): rows[name] for name in rows if name.startswith("ended:")},
                sample=_joined([item[0] for item in parts if item[0].n_seas]),
                omega=parts[0][2],
                # Batches are of equal size but for the last: weigh each by its seas.
                spectra={
                    channel: np.average(
                        [item[3][channel] for item in parts],
                        axis=0,
                        weights=[len(item[1]["cost"]) for item in parts],
                    )
                    for channel in parts[0][3]
                },
                optimal_cost=optima[entry.information_set],
            )
        )
    return Contest(scenario, part, outcomes)


def _joined(parts: list[Trajectory]) -> Trajectory:
    first = parts[0]
    if len(parts) == 1:
        return first
    return dataclasses.replace(
        first,
        seeds=tuple(seed for item in parts for seed in item.seeds),
        states={name: np.concatenate([item.states[name] for item in parts], axis=1) for name in first.states},
        steps={name: np.concatenate([item.steps[name] for item in parts], axis=1) for name in first.steps},
        n_valid=np.concatenate([item.n_valid for item in parts]),
        outcomes={name: np.concatenate([item.outcomes[name] for item in parts]) for name in first.outcomes},
    )


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
        for name, ended in outcome.ends.items():
            add(name, "seas", int(ended.sum()), None, n_seas)
        described = outcome.entry.described()
        for name in ("energy_index", "predicted_cost"):
            if name in described:
                add(name, "-", described[name], None, n_seas)
    return rows


def default_reference(labels: Sequence[str]) -> str:
    """The controller that differences are taken from unless one is named: `lqg`, or else the first."""
    return "lqg" if "lqg" in labels else labels[0]


def compare(
    scenarios: Sequence[Scenario],
    controllers: Sequence[str],
    *,
    n_seeds: int,
    out: str | Path,
    duration: float | None = None,
    warm_up: float | None = None,
    dtype: str = "float64",
    reference: str | None = None,
    allow_other_scenario: bool = False,
    arguments: list[str] | None = None,
    progress: Callable[[str, str, int, int], None] | None = None,
) -> Path:
    """Compares controllers in the first test seas of each scenario and writes the folder.

    Nothing is written before everything has run.

    Args:
        scenarios: The operations, of distinct names.
        controllers: Names of designs, and `agent:RUN` for trained agents.
        n_seeds: Number of test seas.
        out: Folder for the files; a former comparison there is replaced.
        duration: Length of the episodes [s]; None: the scenario's, but no more than the protocol needs.
        warm_up: Time left out at the start [s]; None: the protocol's.
        dtype: Precision of the plant.
        reference: Controller that paired differences are taken from; None: `default_reference`.
        allow_other_scenario: Whether an agent may act in a scenario it was not trained for.
        arguments: Command line of the provenance; None: the process's own.
        progress: Called with scenario, label, steps done since the last call and steps in all.

    Returns:
        The folder.

    Raises:
        ValueError: If anything asked for is impossible.
    """
    out = runs.check_folder(out, runs.COMPARISON)
    specs = check_specs(controllers)
    if n_seeds < 1:
        raise ValueError(f"seeds must be at least 1, got {n_seeds}")
    names = [scenario.name for scenario in scenarios]
    if not names:
        raise ValueError("no scenario was named; list them with heave scenarios list")
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"scenario {name!r} is named twice; give each a name of its own")
    labels = labels_of(specs)
    chosen = default_reference(list(labels.values()))
    if reference is not None:
        chosen = labels.get(reference, reference)
    if chosen not in labels.values():
        raise ValueError(f"reference {reference!r} is not among the controllers {', '.join(labels.values())}")
    seeds = range(FIRST_TEST_SEED, FIRST_TEST_SEED + n_seeds)

    prepared = []
    for scenario in scenarios:
        entries = []
        for spec in specs:
            controller = controller_of(spec, scenario, allow_other_scenario=allow_other_scenario)
            sees = getattr(controller, "information_set", None) or scenario.information_set
            entries.append(Entry(labels[spec], spec, controller, sees))
        timed = with_duration(scenario, _episode(scenario) if duration is None else duration)
        window(timed.duration, timed.control_dt, warm_up)
        prepared.append((timed, entries))

    contests = []
    for scenario, entries in prepared:
        total = scenario.n_steps * n_seeds

        def report(label: str, count: int, name: str = scenario.name, total: int = total) -> None:
            if progress is not None:
                progress(name, label, count, total)

        contests.append(run_contest(scenario, entries, seeds, warm_up=warm_up, dtype=dtype, progress=report))
    _write(out, contests, seeds, dtype, chosen, provenance(arguments))
    from experiments.report import write_report

    write_report(out)
    return out


def _episode(scenario: Scenario) -> float:
    """The protocol's length of an episode [s], or the scenario's own if that is shorter."""
    protocol = round((WARM_UP + SCORED) / scenario.control_dt) * scenario.control_dt
    return min(scenario.duration, protocol)


def _write(
    out: Path, contests: list[Contest], seeds: range, dtype: str, reference: str, made: dict[str, Any]
) -> None:
    rows = [
        (contest.scenario.name, *dataclasses.astuple(row))
        for contest in contests
        for row in result_rows(contest, reference)
    ]
    runs.write_arrays(out / runs.TRAJECTORIES_FILE, _arrays(contests))
    runs.write_text(out / runs.EPISODES_FILE, _episodes(contests))
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


def _episodes(contests: list[Contest]) -> str:
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
                rows.append((contest.scenario.name, label, FIRST_TEST_SEED + i, *numbers, *flags))
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
            "controllers": controllers,
        }
    return {
        "scenarios": scenarios,
        "reference": reference,
        "first_seed": seeds.start,
        "n_seeds": len(seeds),
        "provenance": made,
    }
