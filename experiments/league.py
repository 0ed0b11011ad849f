"""The league: every controller, agent and submission in the same unseen seas of scenarios and their variants.

It is run part by part, one controller in all seas of one scenario, each kept in the folder as it is finished
(`experiments.kept`); the leaderboard is written when all have run. The statistics are those of
`experiments.leaderboard`, the page that of `experiments.league_page`; `docs/league.md` describes all of it.
"""

from __future__ import annotations

import dataclasses
import glob
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments import runs
from experiments.compare import (
    AGENT_PREFIX,
    FILE_PREFIX,
    ZOO_PREFIX,
    Part,
    check_contest,
    check_specs,
    content_hash,
    controller_names,
    default_reference,
    entry_of,
    finish,
    is_agent,
    labels_of,
    parts_of,
    protocol_duration,
    run_contest,
    trainings_of,
)
from experiments.leaderboard import (
    NOMINAL,
    POOLED,
    Cell,
    Quantity,
    Result,
    best,
    failure_text,
    failures,
    pooled,
    profiles,
    quantities,
    ranked,
)
from experiments.league_page import SUMMARY_FILE, place_text, write_page
from experiments.metrics import CONFIDENCE, METRICS, window
from experiments.processes import shared_out, worker_count
from experiments.results import Contest, Entry, Outcome
from experiments.rollout import FIRST_TEST_SEED, with_duration
from experiments.statistics import N_RESAMPLES
from heave_env.provenance import provenance
from heave_env.scenarios import Scenario, to_mapping, variants_of, varied
from heave_env.variants import NoSuchVariantError

Array = np.ndarray

TABLE_FILE = "leaderboard.csv"
EVERY = "all"
"""Stands for every designed controller, and for every variant."""
COLUMNS = (
    "scenario",
    "variant",
    "entry",
    "training",
    "quantity",
    "unit",
    "value",
    "low",
    "high",
    "n_trainings",
    "n_seas",
)
"""Columns of the leaderboard's table."""
N_SLOWEST = 6
"""Of so many is told how long they took [-]."""
RESERVED = ("oracle", "oracle_mpc", "clairvoyant", "optimum", POOLED)
"""Names of yardsticks, which no contestant may have."""


@dataclass(frozen=True)
class Contestant:
    """One line of the leaderboard: a controller, or one agent with all its trainings."""

    name: str
    specs: tuple[str, ...]
    """What was asked for: one, or one for each training."""
    asked: bool = True
    """Whether it was named, and is not merely one of all."""
    home: str | None = None
    """The one scenario, with its variants, in which it takes part; None: all that it fits."""


def contestants(given: Sequence[str], *, zoo: bool = False) -> tuple[Contestant, ...]:
    """Who takes part.

    Args:
        given: `all`, NAME, agent:RUN, zoo:NAME, file:PATH.py, and NAME=agent:RUN1+agent:RUN2 or a pattern.
        zoo: Whether every agent of the zoo takes part in its scenario that is not named otherwise.

    Raises:
        ValueError: If one is unknown or named twice, a pattern matches nothing, or there is none.
    """
    wanted = [text.strip() for text in given if text.strip()]
    everyone = EVERY in wanted
    named, found = [], []
    for text in wanted:
        if text != EVERY:
            named.append(_named(text))
    designs = [name for name in controller_names() if all(name not in specs for _, specs in named)]
    shipped = _zoo([spec for _, specs in named for spec in specs]) if zoo else []
    every = check_specs(
        [
            *(spec for _, specs in named for spec in specs),
            *(designs if everyone else []),
            *(spec for item in shipped for spec in item.specs),
        ]
    )
    labels = labels_of(every)
    for name, specs in named:
        found.append(Contestant(name or labels[specs[0]], specs))
    if everyone:
        found += [Contestant(name, (name,), asked=False) for name in designs]
    found += shipped
    names = [item.name for item in found]
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"two contestants are called {name!r}; give one a name of its own, NAME=...")
        if name in RESERVED:
            raise ValueError(f"no contestant may be called {name!r}, as a yardstick is; give it another name")
    return tuple(found)


def _zoo(named: Sequence[str]) -> list[Contestant]:
    """The agents of the zoo, each in its scenario, but those of which a training is named."""
    from agents.zoo import names, read

    found = [read(name) for name in names()]
    return [
        Contestant(ZOO_PREFIX + agent.name, agent.specs(), asked=False, home=agent.card["scenario_name"])
        for agent in found
        if not set(agent.specs()) & set(named)
    ]


def _named(text: str) -> tuple[str, tuple[str, ...]]:
    """Name (empty if none is given) and specs of one contestant."""
    name, equals, rest = text.partition("=")
    if not equals or ":" in name or "/" in name:
        name, rest = "", text
    elif not name.strip() or not rest.strip():
        raise ValueError(f"a named contestant is NAME=CONTROLLER, as mine=file:mine.py, got {text!r}")
    parts = [part.strip() for part in re.split(r"\+(?=\w+:)", rest.strip())]
    specs = [spec for part in parts for spec in _matching(part)]
    if len(parts) == 1 and parts[0].startswith(ZOO_PREFIX):
        name = name or parts[0]
    if len(specs) > 1:
        if not all(is_agent(spec) for spec in specs):
            raise ValueError(f"only trainings of an agent are joined to one contestant, got {text!r}")
        name = name or _pattern_name(parts, text)
    return name.strip(), tuple(specs)


def _matching(spec: str) -> list[str]:
    """The runs that an agent's pattern matches, or the trainings of one of the zoo, in order; or itself."""
    if spec.startswith(ZOO_PREFIX):
        return list(trainings_of(spec))
    path = spec.removeprefix(AGENT_PREFIX)
    if not spec.startswith(AGENT_PREFIX) or not re.search(r"[*?\[]", path) or Path(path).exists():
        return [spec]
    from agents.policy import POLICY_FILE

    found = [run for run in sorted(glob.glob(path)) if (Path(run) / POLICY_FILE).is_file()]
    if not found:
        raise ValueError(f"no trained run matches {path!r}; name folders that heave train has written")
    return [AGENT_PREFIX + run for run in found]


def _pattern_name(parts: Sequence[str], text: str) -> str:
    if len(parts) > 1:
        raise ValueError(f"several trainings want a name, as ppo={text}")
    return AGENT_PREFIX + Path(parts[0].removeprefix(AGENT_PREFIX)).name


# What is run -------------------------------------------------------------------------------------


def chosen_variants(scenarios: Sequence[Scenario], wanted: str) -> dict[str, list[Scenario]]:
    """Each scenario as it is and in its variants, by the scenario's name.

    Args:
        scenarios: The operations.
        wanted: `all`, `nominal` for none, or names of variants separated by commas.

    Raises:
        ValueError: If a variant is unknown, or makes no sense of any of the scenarios.
    """
    names = [name.strip() for name in wanted.split(",") if name.strip() and name.strip() != NOMINAL]
    found = {}
    refused: dict[str, list[NoSuchVariantError]] = {name: [] for name in names}
    for scenario in scenarios:
        row = found[scenario.name] = [scenario]
        for name in variants_of(scenario) if names == [EVERY] else names:
            try:
                row.append(varied(scenario, name))
            except NoSuchVariantError as error:
                refused[name].append(error)
    for name, errors in refused.items():
        if names.count(name) > 1:
            raise ValueError(f"variant {name!r} is named twice; name it once")
        if len(errors) == len(scenarios):
            raise errors[0]
    return found


@dataclass(frozen=True)
class Field:
    """Who takes part in one scenario and its variants, designed for it as it is."""

    places: list[Scenario]
    """The scenario and its variants, with the duration that is wanted."""
    entries: dict[str, list[Entry]]
    """By contestant, one for each training."""
    left_out: dict[str, str]
    """By contestant, why it does not act there."""


FAMILY = ("lqg", "gain_scheduled", "time_varying_lq", "mpc", "mpc_l1", "multi_model", "multi_model_mpc")
"""Designs whose weights are found from one another's: one process makes them all."""


@dataclass(frozen=True)
class Designs:
    """Controllers that one process designs or loads for a scenario."""

    scenario: Scenario
    labels: dict[str, str]
    """Label of each, by what was asked for."""
    allow_other_scenario: bool = False

    def made(self) -> dict[str, Entry | ValueError]:
        """Each controller, or why it does not fit."""
        found: dict[str, Entry | ValueError] = {}
        for spec, label in self.labels.items():
            try:
                found[spec] = entry_of(
                    label, spec, self.scenario, allow_other_scenario=self.allow_other_scenario
                )
            except ValueError as error:
                found[spec] = ValueError(str(error))
        return found


def _together(specs: Sequence[str]) -> list[list[str]]:
    """Specs in groups that are best designed by one process each; files are left out."""
    family = [spec for spec in specs if spec in FAMILY]
    others = [spec for spec in specs if spec not in FAMILY and not spec.startswith(FILE_PREFIX)]
    return [group for group in (family, others) if group]


def fields(
    scenarios: Sequence[Scenario],
    teams: Sequence[Contestant],
    *,
    variants: str,
    duration: float | None,
    warm_up: float | None,
    allow_other_scenario: bool = False,
    workers: int = 1,
    progress: Callable[[str, str, int, int], None] | None = None,
) -> dict[str, Field]:
    """Designs and loads everybody for every scenario, before anybody acts; arguments are those of `league`.

    Raises:
        ValueError: If one that was asked for by name fits no scenario, some trainings of an agent fit and
            others do not, or a submission is wrong.
    """
    chosen = chosen_variants(scenarios, variants)
    labels = labels_of([spec for team in teams for spec in team.specs])
    at_home = {
        scenario.name: [team for team in teams if team.home in (None, scenario.design_basis.name)]
        for scenario in scenarios
    }
    jobs = [
        Designs(scenario, {spec: labels[spec] for spec in specs}, allow_other_scenario)
        for scenario in scenarios
        for specs in _together([spec for team in at_home[scenario.name] for spec in team.specs])
    ]
    designed: dict[tuple[str, str], Entry | ValueError] = {}
    for job, answers in shared_out(Designs.made, jobs, workers):
        designed |= {(job.scenario.name, spec): answer for spec, answer in answers.items()}
        if progress is not None:
            progress(job.scenario.name, "designs", len(answers), len(labels))
    found, refusals = {}, {}
    for scenario in scenarios:
        entries, left_out = {}, {}
        for team in at_home[scenario.name]:
            made, refused = [], []
            for spec in team.specs:
                answer = designed.get((scenario.name, spec))
                if spec.startswith(FILE_PREFIX):  # its code lives in the process that has loaded it
                    answer = entry_of(labels[spec], spec, scenario)
                assert answer is not None
                if isinstance(answer, Entry):
                    made.append(answer)
                else:
                    refused.append(answer)
            if made and refused:
                raise ValueError(f"of contestant {team.name!r} not every training fits: {refused[0]}")
            if made:
                entries[team.name] = made
            else:
                left_out[team.name] = " ".join(str(refused[0]).split())
                refusals[team.name] = refused[0]
        usual = protocol_duration(scenario) if duration is None else duration
        places = [with_duration(place, usual) for place in chosen[scenario.name]]
        window(places[0].duration, places[0].control_dt, warm_up)
        found[scenario.name] = Field(places, entries, left_out)
    for team in teams:
        if team.asked and not any(team.name in field.entries for field in found.values()):
            raise refusals[team.name]
    return found


def cell_of(
    scenario: str, place: Scenario, entries_of: Mapping[str, Sequence[Entry]], contest: Contest
) -> Cell:
    """What happened in one scenario or variant, by contestant.

    Args:
        scenario: Name of the scenario, without the variant.
        place: The scenario, or its variant.
        entries_of: The entries of each contestant, one for each training.
        contest: What all of them did there.
    """
    by_label = {outcome.entry.label: outcome for outcome in contest.outcomes}
    results = {}
    for name, entries in entries_of.items():
        several = [by_label[entry.label] for entry in entries]
        first = several[0]
        results[name] = Result(
            trainings=tuple(_training(outcome) for outcome in several),
            values={metric: np.stack([item.values[metric] for item in several]) for metric in first.values},
            ends={end: np.stack([item.ends[end] for item in several]) for end in first.ends},
            information_set=first.entry.information_set,
            measures=tuple(first.entry.described()["measures"]),
            optimal_cost=first.optimal_cost,
            decision_time=float(np.mean([item.decision_time for item in several])),
            batch=first.batch,
        )
    return Cell(scenario, place.name.removeprefix(scenario).removeprefix("@") or NOMINAL, contest, results)


def alone(cell: Cell, field: Field, seeds: range, folder: Path, **asked: Any) -> Cell:
    """The cell of a scenario as it is with the time that everybody's decision takes in a single sea.

    In a batch a decision's fixed expense is shared by all seas; on a vessel there is one. It is measured when
    nothing else is running.
    """
    if cell.variant != NOMINAL:
        return cell
    first = [entries[0] for entries in field.entries.values()]
    times = {}
    for part in parts_of(field.places[0], first, seeds[:1], **asked):
        if part.entry is not None:
            single = dataclasses.replace(part, name=f"{part.name} alone")
            arrays = single.held(folder)
            if arrays is None:
                arrays = single.run()
                single.keep(folder, arrays)
            times[part.label] = float(arrays["decision_time"])
    results = {
        name: dataclasses.replace(result, decision_time_alone=times[field.entries[name][0].label])
        for name, result in cell.results.items()
    }
    return dataclasses.replace(cell, results=results)


def _training(outcome: Outcome) -> str:
    entry = outcome.entry
    if entry.spec.startswith(ZOO_PREFIX):
        return "seed " + entry.spec.rpartition("/")[2]
    return entry.label.removeprefix(AGENT_PREFIX) if entry.spec.startswith(AGENT_PREFIX) else ""


# What is made of it ------------------------------------------------------------------------------


def standings(cells: Sequence[Cell], reference: str) -> list[dict[str, Any]]:
    """Every number of every cell, and of what is pooled over several: first over all scenarios, then by
    scenario as it is, in each variant, and over its variants."""
    told = []
    for cell in cells:
        found = {name: quantities(cell, name, reference) for name in cell.results}
        alone = {
            name: [
                quantities(cell, name, reference, result.training(i)) for i in range(len(result.trainings))
            ]
            for name, result in cell.results.items()
            if len(result.trainings) > 1
        }
        told.append(_told(cell.scenario, cell.variant, [cell], found, reference, alone))
    names = list(dict.fromkeys(cell.scenario for cell in cells))
    groups = {
        (name, POOLED): [cell for cell in cells if cell.scenario == name and cell.variant != NOMINAL]
        for name in names
    }
    if len(names) > 1:
        groups[POOLED, NOMINAL] = [cell for cell in cells if cell.variant == NOMINAL]
        groups[POOLED, POOLED] = [cell for cell in cells if cell.variant != NOMINAL]
    for (scenario, variant), several in groups.items():
        if len(several) > 1:
            told.append(_told(scenario, variant, several, pooled(several, reference), reference, {}))
    return told


def _told(
    scenario: str,
    variant: str,
    cells: Sequence[Cell],
    found: dict[str, dict[str, Quantity]],
    reference: str,
    alone: dict[str, list[dict[str, Quantity]]],
) -> dict[str, Any]:
    order = ranked(found, reference)
    entries = {}
    for name in order:
        result = cells[0].results[name]
        entries[name] = {
            "information_set": result.information_set,
            "measures": list(result.measures),
            "trainings": list(result.trainings),
            "quantities": {key: dataclasses.asdict(item) for key, item in found[name].items()},
            "by_training": [
                {"training": training}
                | {"quantities": {key: dataclasses.asdict(item) for key, item in row.items()}}
                for training, row in zip(result.trainings, alone.get(name, []), strict=False)
            ],
        }
    return {
        "scenario": scenario,
        "variant": variant,
        "n_cells": len(cells),
        "best": best(cells, order),
        "entries": entries,
        "profiles": profiles(cells, order, reference),
    }


def _rows(told: Sequence[dict[str, Any]]) -> list[tuple[Any, ...]]:
    """Lines of the leaderboard's table."""
    rows = []
    for item in told:
        for name, entry in item["entries"].items():
            parts = [("", entry["quantities"])]
            parts += [(part["training"], part["quantities"]) for part in entry["by_training"]]
            for training, found in parts:
                for quantity, number in found.items():
                    cells = [number[key] for key in ("unit", "value", "low", "high", "n_trainings", "n_seas")]
                    rows.append((item["scenario"], item["variant"], name, training, quantity, *cells))
    return rows


def _episodes(cells: Sequence[Cell], seeds: range) -> str:
    """Every sea of everybody, as a table."""
    results = [result for cell in cells for result in cell.results.values()]
    metrics = [name for name in METRICS if any(name in result.values for result in results)]
    ends = list(results[0].ends)
    headed = [f"{name} [{METRICS[name].unit}]" for name in metrics]
    rows = []
    for cell in cells:
        for name, result in cell.results.items():
            for i, training in enumerate(result.trainings):
                for k, seed in enumerate(seeds):
                    numbers = [
                        result.values[metric][i, k] if metric in result.values else None for metric in metrics
                    ]
                    flags = [bool(result.ends[end][i, k]) for end in ends]
                    rows.append((cell.scenario, cell.variant, name, training, seed, *numbers, *flags))
    columns = ["scenario", "variant", "entry", "training", "sea", *headed, *ends]
    return runs.table_text(columns, rows)


def league(
    scenarios: Sequence[Scenario],
    controllers: Sequence[str],
    *,
    n_seeds: int,
    out: str | Path,
    variants: str = EVERY,
    duration: float | None = None,
    warm_up: float | None = None,
    dtype: str = "float64",
    reference: str | None = None,
    zoo: bool = False,
    allow_other_scenario: bool = False,
    clairvoyant: bool = False,
    oracle: bool = False,
    workers: int | None = 1,
    arguments: list[str] | None = None,
    progress: Callable[[str, str, int, int], None] | None = None,
) -> Path:
    """Runs everybody in the first test seas of the scenarios and their variants; writes the leaderboard.

    Args:
        scenarios: The operations, of distinct names.
        controllers: Who takes part, as `contestants` reads it.
        n_seeds: Number of test seas.
        out: The folder; it resumes what it holds.
        variants: `all`, `nominal` for none, or names separated by commas.
        duration: Length of the episodes [s]; None: the scenario's, but no more than the protocol needs.
        warm_up: Time left out at the start [s]; None: the protocol's.
        dtype: Precision of the plant.
        reference: Contestant that everybody is held against; None: `default_reference`.
        zoo: Whether the agents of the zoo take part, each in its scenario and its variants.
        allow_other_scenario: Whether an agent may act in a scenario it was not trained for.
        clairvoyant: Whether the yardstick that knows each sea beforehand is worked out, where it can be.
        oracle: Whether the yardstick that knows what each episode draws runs, where anything is drawn.
        workers: Processes that design and act side by side; None: one for each processor.
        arguments: Command line of the provenance; None: the process's own.
        progress: Called with scenario, label, steps done since the last call and steps in all.

    Returns:
        The folder.

    Raises:
        ValueError: If anything asked for is impossible.
    """
    folder = runs.check_folder(out, runs.LEAGUE)
    teams = contestants(controllers, zoo=zoo)
    check_contest(scenarios, n_seeds)
    called = [team.name for team in teams]
    chosen = default_reference(called) if reference is None else reference
    if chosen not in called:
        raise ValueError(f"reference {chosen!r} is not among the contestants {', '.join(called)}")
    if clairvoyant and not any(scenario.is_linear for scenario in scenarios):
        raise ValueError("the clairvoyant yardstick takes a linear payload; leave --clairvoyant out")
    if oracle and not any(scenario.uncertainty for scenario in scenarios):
        raise ValueError("the oracle yardstick takes a scenario with uncertainty; leave --oracle out")
    seeds = range(FIRST_TEST_SEED, FIRST_TEST_SEED + n_seeds)
    field_of = fields(
        scenarios,
        teams,
        variants=variants,
        duration=duration,
        warm_up=warm_up,
        allow_other_scenario=allow_other_scenario,
        workers=worker_count(workers),
        progress=progress,
    )
    for name, field in field_of.items():
        if chosen not in field.entries:
            raise ValueError(
                f"reference {chosen!r} does not act in scenario {name!r} ({field.left_out[chosen]}); name "
                "another with --reference"
            )

    def report(place: Scenario, label: str, count: int) -> None:
        if progress is not None:
            progress(place.name, label, count, place.n_steps * n_seeds)

    def asked_of(place: Scenario) -> dict[str, Any]:
        return {
            "warm_up": warm_up,
            "dtype": dtype,
            "clairvoyant": clairvoyant and place.is_linear,
            "oracle": oracle and bool(place.uncertainty),
            "n_stored": 0,
        }

    def everybody(field: Field) -> list[Entry]:
        return [entry for entries in field.entries.values() for entry in entries]

    beforehand = [
        part
        for field in field_of.values()
        for place in field.places
        for part in parts_of(place, everybody(field), seeds, **asked_of(place))
    ]
    finish(
        beforehand,
        folder,
        worker_count(workers),
        lambda part: report(part.scenario, part.label, part.n_steps),
    )
    cells = []
    for name, field in field_of.items():
        for place in field.places:
            contest = run_contest(
                place,
                everybody(field),
                seeds,
                **asked_of(place),
                folder=folder,
                progress=partial(report, place) if worker_count(workers) == 1 else None,
            )
            cells.append(cell_of(name, place, field.entries, contest))
    cells = [
        alone(cell, field_of[cell.scenario], seeds, folder, **asked_of(cell.contest.scenario))
        for cell in cells
    ]
    told = standings(cells, chosen)
    common: dict[str, Any] = {
        "reference": chosen,
        "first_seed": seeds.start,
        "n_seeds": n_seeds,
        "dtype": dtype,
        "provenance": provenance(arguments),
    }
    summary = common | {
        "failures": failures(cells),
        "work": work_of(beforehand, folder),
        "interval": f"{100.0 * CONFIDENCE:.0f} % intervals over seas and trainings, percentile bootstrap of "
        f"{N_RESAMPLES} resamples",
        "scenarios": {
            scenario.name: _about(scenario, field_of[scenario.name], cells) for scenario in scenarios
        },
        "standings": told,
    }
    made = common | {
        "kind": runs.LEAGUE,
        "contestants": [
            {"name": team.name, "specs": team.specs, "content": [content_hash(spec) for spec in team.specs]}
            for team in teams
        ],
        "scenarios": [to_mapping(place) for field in field_of.values() for place in field.places],
    }
    runs.write_text(folder / runs.EPISODES_FILE, _episodes(cells, seeds))
    runs.write_text(folder / TABLE_FILE, runs.table_text(COLUMNS, _rows(told)))
    runs.write_json(folder / SUMMARY_FILE, summary)
    runs.write_json(folder / runs.RUN_FILE, made)
    write_page(folder)
    return folder


def work_of(parts: Sequence[Part], folder: Path) -> dict[str, Any]:
    """What the parts of a league took: hours of one processor, and seconds per sea by label."""
    took: dict[str, list[tuple[float, int]]] = {}
    for part in parts:
        arrays = part.held(folder)
        if arrays is not None and "wall" in arrays:
            took.setdefault(part.label, []).append((float(arrays["wall"]), len(part.seeds)))
    return {
        "hours": sum(seconds for rows in took.values() for seconds, _ in rows) / 3600.0,
        "seconds_per_sea": {
            label: sum(seconds for seconds, _ in rows) / sum(count for _, count in rows)
            for label, rows in took.items()
        },
    }


def _about(scenario: Scenario, field: Field, cells: Sequence[Cell]) -> dict[str, Any]:
    """What the page tells of a scenario beside the standings."""
    own = {cell.variant: cell for cell in cells if cell.scenario == scenario.name}
    part = own[NOMINAL].contest.part
    return {
        "description": scenario.description,
        "plant": "linear payload" if scenario.is_linear else f"{scenario.initial_length:g} m cable",
        "command_delay": scenario.winch.command_delay,
        "warm_up": part.warm_up,
        "scored": part.scored,
        "left_out": field.left_out,
        "variants": {
            variant: {
                "fingerprint": cell.contest.scenario.fingerprint,
                "description": cell.contest.scenario.description.rpartition(": ")[2]
                if variant != NOMINAL
                else "",
                "bound": None if cell.contest.bound is None else dataclasses.asdict(cell.contest.bound),
                "yardsticks": {name: float(costs.mean()) for name, costs in cell.contest.yardsticks.items()},
            }
            for variant, cell in own.items()
        },
    }


def printed(summary: dict[str, Any]) -> list[str]:
    """The main numbers as lines of text: everybody's ratio to the reference, place by place."""
    reference = summary["reference"]
    lines = []
    for item in summary["standings"]:
        lines.append(f"{place_text(item)}: J / {reference}, lowest first")
        for name, entry in item["entries"].items():
            number = entry["quantities"].get(f"cost_ratio_to_{reference}")
            if number is None:
                continue
            interval = ""
            if number["low"] is not None:
                interval = f" ({number['low']:.3f} to {number['high']:.3f})"
            middle = entry["quantities"].get("cost_ratio_median", {"value": float("nan")})["value"]
            ends = {end: entry["quantities"][end] for end in ("diverged", "lost")}
            failed = [f"{found['value']} {end}" for end, found in ends.items() if found["value"]]
            badge = ", best" if name == item["best"] else ""
            n_seas = ends["lost"]["n_seas"] * ends["lost"]["n_trainings"]
            told = f", {' and '.join(failed)} of {n_seas} seas" if failed else ""
            lines.append(f"  {name}: {number['value']:.3f}{interval}, median {middle:.3f}{told}{badge}")
    for name, about in summary["scenarios"].items():
        lines += [f"{name}: without {who}: {why}" for who, why in about["left_out"].items()]
    work = summary["work"]
    slowest = sorted(work["seconds_per_sea"].items(), key=lambda item: -item[1])[:N_SLOWEST]
    each = ", ".join(f"{label} {seconds:.2g}" for label, seconds in slowest)
    lines.append(f"work: {work['hours']:.2g} hours of one processor; slowest, in seconds per sea: {each}")
    lines += [failure_text(item) for item in summary["failures"]] or ["nobody diverged or lost the payload"]
    return lines
