"""Pictures of what was run: each an SVG, a PNG, its numbers as CSV, and where it comes from as JSON.

`heave pictures KIND` draws them (`docs/pictures.md`). The kinds are in the modules `pictures_...`; what they
share is here: the files of a picture, and what the folder of a comparison or league holds of a scenario.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from experiments import figures, runs
from experiments.compare import (
    default_reference,
    entry_of,
    finish,
    labels_of,
    parts_of,
    protocol_duration,
    run_contest,
)
from experiments.leaderboard import NOMINAL, Quantity, estimated
from experiments.league import Contestant
from experiments.metrics import METRICS
from experiments.results import Contest, Entry
from experiments.rollout import OUTCOMES, with_duration
from experiments.statistics import mean
from heave_env import scenarios
from heave_env.provenance import provenance
from heave_env.scenarios import Scenario, from_mapping

Array = np.ndarray

DPI = 120
"""Resolution of the PNG files [1/in]."""
N_COLOURS = 256
"""Colours of the PNG files [-]."""
FOLDER = "pictures"
"""Folder of its pictures in that of a comparison or league, where its page finds them."""


@dataclass(frozen=True, kw_only=True)
class Picture:
    """What is drawn, and the numbers that are seen in it."""

    kind: str
    """What it shows: fronts, storm, learning, profiles, video."""
    name: str
    """Its files' name, without ending."""
    caption: str
    """What is seen, in words."""
    draw: Callable[[Any], None]
    """Draws it on an empty figure of matplotlib."""
    size: tuple[float, float]
    """Width and height [in]."""
    columns: Sequence[str]
    """Headings of the numbers, with units."""
    rows: Sequence[Sequence[Any]]
    """The numbers."""
    about: dict[str, Any] = field(default_factory=dict)
    """What else the JSON file says."""


def write(picture: Picture, folder: str | Path, arguments: list[str] | None = None) -> list[Path]:
    """Writes the files of a picture, the PNG first.

    Args:
        picture: What to write.
        folder: Where.
        arguments: Command line of the provenance; None: the process's own.

    Raises:
        ValueError: If they cannot be written there.
    """
    place = Path(folder)
    image, _ = figures.png(picture.draw, picture.size, DPI, N_COLOURS)
    written = [
        runs.write_bytes(place / f"{picture.name}.png", image),
        runs.write_text(place / f"{picture.name}.svg", figures.svg(picture.draw, picture.size)),
        runs.write_text(place / f"{picture.name}.csv", runs.table_text(picture.columns, picture.rows)),
    ]
    about = (picture.name, picture.kind, picture.caption, picture.about)
    return [*written, write_about(*about, place, arguments)]


def write_about(
    name: str,
    kind: str,
    caption: str,
    about: dict[str, Any],
    folder: Path,
    arguments: list[str] | None,
) -> Path:
    """Writes what a picture shows and where it comes from."""
    told = {"kind": "picture", "picture": kind, "caption": caption, **about}
    return runs.write_json(folder / f"{name}.json", told | {"provenance": provenance(arguments)})


def stored(folder: str | Path) -> list[dict[str, Any]]:
    """The pictures that lie in the folder of a comparison or league: caption, scenario, SVG's text.

    Files that are broken, or that nobody drew a picture for, are passed over.
    """
    found = []
    for path in sorted((Path(folder) / FOLDER).glob("*.json")):
        drawn = path.with_suffix(".svg")
        try:
            told = runs.read_json(path)
            if told.get("kind") == "picture" and {"picture", "caption"} <= set(told) and drawn.is_file():
                text = drawn.read_text(encoding="utf-8")
                found.append({"name": path.stem, "svg": text, **told})
        except (ValueError, AttributeError, OSError):
            continue
    return found


# What was scored ---------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Scored:
    """Everybody's scores in one scenario or variant."""

    scenario: Scenario
    """The operation as it was met, with the duration of an episode."""
    basis: Scenario
    """The operation that controllers were made for."""
    variant: str
    """Name of the variant, `nominal` for none."""
    names: tuple[str, ...]
    """Everybody in the order that gives them colours: that of the run's own page."""
    reference: str
    """Whom costs are held against."""
    first_seed: int
    """Seed of the first sea."""
    warm_up: float
    """Time left out at the start of an episode [s]."""
    specs: dict[str, tuple[str, ...]]
    """What was asked for, by entry: one, or one for each training."""
    values: dict[str, dict[str, Array]]
    """By entry each metric, (n_trainings, n_seas); NaN where a sea has no score."""
    ends: dict[str, dict[str, Array]]
    """By entry, for each way to end early, which did, (n_trainings, n_seas) bool."""

    @property
    def n_seas(self) -> int:
        """Number of seas [-]."""
        return int(next(iter(self.values.values()))["cost"].shape[1])

    def first_seas(self, count: int) -> Scored:
        """The first so many seas alone.

        Raises:
            ValueError: If there are fewer.
        """
        if count > self.n_seas:
            raise ValueError(f"only {self.n_seas} seas of {self.scenario.name!r} were run, not {count}")
        cut = {
            part: {
                entry: {name: rows[:, :count] for name, rows in item.items()}
                for entry, item in getattr(self, part).items()
            }
            for part in ("values", "ends")
        }
        return dataclasses.replace(self, values=cut["values"], ends=cut["ends"])

    def failed(self, entry: str) -> int:
        """Seas that an entry lost or in which it diverged, over all its trainings."""
        return int(sum(self.ends[entry][end].sum() for end in ("diverged", "lost")))

    def number(self, entry: str, metric: str) -> Quantity | None:
        """Mean of a metric with its 95 % interval over seas and trainings; None where there is none."""
        rows = self.values[entry].get(metric)
        return None if rows is None else estimated(mean, [[rows]], METRICS[metric].unit)


def read_scored(folder: str | Path) -> list[Scored]:
    """What the folder of a comparison or league holds, a part for each scenario and variant.

    Raises:
        ValueError: If it holds neither, or one that is broken.
    """
    folder = Path(folder)
    if not (folder / runs.RUN_FILE).is_file():
        raise ValueError(
            f"{str(folder)!r} holds no comparison and no league; name a folder that heave compare or heave "
            "league wrote"
        )
    run = runs.read_json(folder / runs.RUN_FILE)
    kind = run.get("kind") if isinstance(run, dict) else None
    if kind not in (runs.COMPARISON, runs.LEAGUE):
        raise ValueError(
            f"{str(folder)!r} holds no comparison and no league; name a folder that heave compare or heave "
            "league wrote"
        )
    rows = runs.read_table(folder / runs.EPISODES_FILE)
    try:
        return _of_comparison(run, rows) if kind == runs.COMPARISON else _of_league(folder, run, rows)
    except (KeyError, IndexError, TypeError) as error:
        raise ValueError(f"the run in {str(folder)!r} is incomplete ({error}); run it again") from error


def _of_comparison(run: dict[str, Any], rows: list[dict[str, str]]) -> list[Scored]:
    found = []
    for item in run["scenarios"]:
        scenario = from_mapping(item["scenario"])
        own = [row for row in rows if row["scenario"] == item["name"]]
        specs: dict[str, tuple[str, ...]] = {
            entry["label"]: (entry["spec"],) for entry in item["controllers"]
        }
        variant = item["name"].partition("@")[2]
        found.append(
            Scored(
                scenario=scenario,
                basis=as_named(scenario.design_basis),
                variant=variant or NOMINAL,
                names=tuple(specs),
                reference=run["reference"],
                first_seed=run["first_seed"],
                warm_up=item["warm_up"],
                specs=specs,
                **_columns(own, {label: [""] for label in specs}, "controller"),
            )
        )
    return found


def _of_league(folder: Path, run: dict[str, Any], rows: list[dict[str, str]]) -> list[Scored]:
    from experiments.league_page import SUMMARY_FILE

    summary = runs.read_json(folder / SUMMARY_FILE)
    places = {item["name"]: from_mapping(item) for item in run["scenarios"]}
    teams = {item["name"]: tuple(item["specs"]) for item in run["contestants"]}
    everybody = tuple(sorted({name for item in summary["standings"] for name in item["entries"]}))
    found = []
    for name in summary["scenarios"]:
        for variant in summary["scenarios"][name]["variants"]:
            own = [row for row in rows if (row["scenario"], row["variant"]) == (name, variant)]
            trainings: dict[str, list[str]] = {}
            for row in own:
                several = trainings.setdefault(row["entry"], [])
                if row["training"] not in several:
                    several.append(row["training"])
            found.append(
                Scored(
                    scenario=places[name if variant == NOMINAL else f"{name}@{variant}"],
                    basis=as_named(places[name]),
                    variant=variant,
                    names=everybody,
                    reference=run["reference"],
                    first_seed=run["first_seed"],
                    warm_up=summary["scenarios"][name]["warm_up"],
                    specs={entry: teams[entry] for entry in trainings},
                    **_columns(own, trainings, "entry"),
                )
            )
    return found


def as_named(scenario: Scenario) -> Scenario:
    """The named scenario that one is but for its duration, on which tuning depends; else itself."""
    if scenario.name in scenarios.names():
        named = scenarios.load(scenario.name)
        if dataclasses.replace(named, duration=scenario.duration).fingerprint == scenario.fingerprint:
            return named
    return scenario


def _columns(rows: list[dict[str, str]], trainings: dict[str, list[str]], who: str) -> dict[str, Any]:
    """Values and ends of everybody from the rows of a table of episodes."""
    values: dict[str, dict[str, Array]] = {}
    ends: dict[str, dict[str, Array]] = {}
    metrics = {column.partition(" [")[0]: column for column in rows[0] if " [" in column}
    for entry, names in trainings.items():
        several = [
            [row for row in rows if row[who] == entry and row.get("training", "") == name] for name in names
        ]
        values[entry] = {
            metric: np.array([[float(row[column] or "nan") for row in own] for own in several])
            for metric, column in metrics.items()
            if any(row[column] for own in several for row in own)
        }
        ends[entry] = {
            end: np.array([[row[end] == "1" for row in own] for own in several]) for end in OUTCOMES
        }
    return {"values": values, "ends": ends}


def chosen(scored: Sequence[Scored], wanted: str | None, *, variants: bool = False) -> list[Scored]:
    """Those of the scenarios that are asked for by name, or all as they are (with their variants).

    Raises:
        ValueError: If one was not run.
    """
    if wanted is None:
        return [item for item in scored if variants or "@" not in item.scenario.name] or list(scored[:1])
    known = {item.scenario.name: item for item in scored}
    names = [name.strip() for name in wanted.split(",") if name.strip()]
    for name in names:
        if name not in known:
            raise ValueError(f"scenario {name!r} was not run there; choose from {', '.join(known)}")
    return [known[name] for name in names]


# What is run for a picture -----------------------------------------------------------------------


Progress = Callable[[str, str, int, int], None]
"""Called with scenario, label, steps done since the last call and steps in all."""


def play(
    scenario: Scenario,
    entries: Sequence[Entry],
    seeds: range,
    folder: Path,
    *,
    n_stored: int = 0,
    warm_up: float | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> Contest:
    """Lets some act in the same seas; each one's part is kept in the folder, and taken from there again.

    Args:
        scenario: The operation, with the duration that is wanted.
        entries: Who acts.
        seeds: Seeds of the seas.
        folder: Where each one's part is kept.
        n_stored: Seas whose time series are kept.
        warm_up: Time left out at the start [s]; None: the protocol's.
        workers: Processes that run side by side.
        progress: Called with scenario, label, steps done since the last call and steps in all.
    """
    total = scenario.n_steps * len(seeds)

    def report(label: str, count: int) -> None:
        if progress is not None:
            progress(scenario.name, label, count, total)

    parts = parts_of(scenario, entries, seeds, warm_up=warm_up, n_stored=n_stored)
    finish(parts, folder, workers, lambda part: report(part.label, part.n_steps))
    report_once = report if workers <= 1 else None  # what is there already has been told
    return run_contest(
        scenario,
        entries,
        seeds,
        warm_up=warm_up,
        n_stored=n_stored,
        folder=folder,
        progress=report_once,
    )


def entries_of(
    scenario: Scenario, teams: Sequence[Contestant], *, allow_other_scenario: bool = False
) -> dict[str, list[Entry]]:
    """Everybody designed or loaded for a scenario, one for each training.

    Raises:
        ValueError: If one does not fit the scenario.
    """
    labels = labels_of([spec for team in teams for spec in team.specs])
    return {
        team.name: [
            entry_of(labels[spec], spec, scenario, allow_other_scenario=allow_other_scenario)
            for spec in team.specs
        ]
        for team in teams
    }


def score(
    scenario: Scenario,
    teams: Sequence[Contestant],
    seeds: range,
    folder: Path,
    *,
    duration: float | None = None,
    allow_other_scenario: bool = False,
    workers: int = 1,
    progress: Progress | None = None,
) -> Scored:
    """Runs everybody in the same seas of a scenario.

    Args:
        scenario: The operation.
        teams: Who acts.
        seeds: Seeds of the seas.
        folder: Where each one's part is kept.
        duration: Length of an episode [s]; None: the protocol's.
        allow_other_scenario: Whether an agent may act in a scenario it was not trained for.
        workers: Processes that run side by side.
        progress: Called with scenario, label, steps done since the last call and steps in all.

    Raises:
        ValueError: If one does not fit the scenario, or the duration is impossible.
    """
    by_team = entries_of(scenario, teams, allow_other_scenario=allow_other_scenario)
    met = with_duration(scenario, protocol_duration(scenario) if duration is None else duration)
    entries = [entry for several in by_team.values() for entry in several]
    contest = play(met, entries, seeds, folder, workers=workers, progress=progress)
    outcomes = {outcome.entry.label: outcome for outcome in contest.outcomes}
    several = {name: [outcomes[entry.label] for entry in own] for name, own in by_team.items()}
    _, _, variant = scenario.name.partition("@")
    return Scored(
        scenario=met,
        basis=scenario.design_basis,
        variant=variant or NOMINAL,
        names=tuple(by_team),
        reference=default_reference(list(by_team)),
        first_seed=seeds.start,
        warm_up=contest.part.warm_up,
        specs={team.name: team.specs for team in teams},
        values={
            name: {metric: np.stack([item.values[metric] for item in own]) for metric in own[0].values}
            for name, own in several.items()
        },
        ends={
            name: {end: np.stack([item.ends[end] for item in own]) for end in own[0].ends}
            for name, own in several.items()
        },
    )
