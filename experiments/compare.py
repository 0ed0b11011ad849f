"""Scenarios x controllers x seeds: the same unseen seas for everybody, scored and written down.

A comparison's folder is described in `docs/files.md`, its protocol in `docs/comparison.md`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from experiments import runs
from experiments.metrics import (
    SCORED,
    WARM_UP,
    mean_cost,
    metric_names,
    scores,
    spectrum,
    window,
)
from experiments.results import Contest, Entry, Outcome, write_contests
from experiments.rollout import FIRST_TEST_SEED, Trajectory, batches, rollout, with_duration
from heave_env.controller import Controller, NoControl
from heave_env.parameters import name_hint
from heave_env.provenance import provenance
from heave_env.scenarios import Scenario

Array = np.ndarray

AGENT_PREFIX = "agent:"
N_STORED_SEAS = 3
"""Seas whose time series are stored [-]."""


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
            known = controller_names()
            hint = name_hint(spec, known, f"known: {', '.join(known)}, agent:RUN")
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
    clairvoyant: bool = False,
    oracle: bool = False,
    progress: Callable[[str, int], None] | None = None,
) -> Contest:
    """Runs every controller in the same seas of a scenario and scores it.

    Args:
        scenario: The operation, with the duration that is wanted.
        entries: The controllers.
        seeds: One seed per sea.
        warm_up: Time left out at the start [s]; None: the protocol's.
        dtype: Precision of the plant.
        clairvoyant: Whether the cost of who knows the sea beforehand is worked out, seconds for each sea.
        oracle: Whether those run too who know what each episode draws.
        progress: Called with a label and a number of steps done since the last call.

    Returns:
        Scores and the first seas in full.
    """
    from baselines.bound import causal_bound, optimal_cost
    from baselines.oracle import oracle as make_oracle

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
    oracles: dict[str, Array] = {}
    for label in oracle_labels(scenario) if oracle else ():
        costs = []
        for batch in batches(scenario, seeds):

            def designed(count: int, label: str = label) -> None:
                if progress is not None:
                    progress(f"{label} designs", count * scenario.n_steps)

            made = make_oracle(scenario, batch, design=label, progress=designed)
            trajectory = run(Entry(label, label, made, scenario.information_set), batch)
            costs.append(mean_cost(trajectory, part))
        oracles[label] = np.concatenate(costs)
    outcomes = []
    for entry in entries:
        parts = collected[entry.label]
        rows = {name: np.concatenate([item[1][name] for item in parts]) for name in parts[0][1]}
        values = {name: rows[name] for name in metric_names(scenario) if name in rows}
        if oracles:
            values["cost_over_oracle"] = rows["cost"] / list(oracles.values())[-1]
        outcomes.append(
            Outcome(
                entry=entry,
                values=values,
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
                # The first batch is the largest.
                decision_time=parts[0][0].decision_time,
                batch=len(parts[0][1]["cost"]),
            )
        )
    known = None
    if clairvoyant:
        from baselines.clairvoyant import clairvoyant_cost

        known = clairvoyant_cost(scenario, seeds, warm_up=part.warm_up)
    return Contest(scenario, part, outcomes, causal_bound(scenario), known, oracles)


def oracle_labels(scenario: Scenario) -> tuple[str, ...]:
    """The oracles of a scenario: with `lqg`, and where the winch has limits also with `mpc`."""
    return ("oracle", "oracle_mpc") if scenario.winch.is_limited else ("oracle",)


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
    clairvoyant: bool = False,
    oracle: bool = False,
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
        clairvoyant: Whether the yardstick that knows each sea beforehand is worked out, seconds for each sea.
        oracle: Whether the yardstick that knows what each episode draws runs too.
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

    for scenario in scenarios if clairvoyant else ():
        if not scenario.is_linear:
            raise ValueError(
                f"the clairvoyant yardstick takes a linear payload, scenario {scenario.name!r} has "
                "a cable; leave --clairvoyant out"
            )
    for scenario in scenarios if oracle else ():
        if not scenario.uncertainty:
            raise ValueError(
                f"the oracle yardstick takes a scenario whose episodes draw parameters, and "
                f"{scenario.name!r} has no uncertainty; leave --oracle out"
            )
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

        contests.append(
            run_contest(
                scenario,
                entries,
                seeds,
                warm_up=warm_up,
                dtype=dtype,
                clairvoyant=clairvoyant,
                oracle=oracle,
                progress=report,
            )
        )
    write_contests(out, contests, seeds, dtype, chosen, provenance(arguments))
    from experiments.report import write_report

    write_report(out)
    return out


def _episode(scenario: Scenario) -> float:
    """The protocol's length of an episode [s], or the scenario's own if that is shorter."""
    protocol = round((WARM_UP + SCORED) / scenario.control_dt) * scenario.control_dt
    return min(scenario.duration, protocol)
