"""`heave operability`: in which seas of a scatter diagram work may go on, controller by controller.

Each controller acts in the same random seas of every class of the diagram. A class is operable if the chosen
statistic over its seas keeps every limit; the answer is the share of operable classes, weighed by their
occurrence.

What a controller did in a class is kept in the folder and not run again while scenario, controller, seeds and
the program's source stay the same, whatever the limits; an interrupted run goes on where it was.
"""

from __future__ import annotations

import dataclasses
import hashlib
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments import runs
from experiments.compare import ZOO_PREFIX, check_specs, content_hash, controller_of, is_agent, labels_of
from experiments.limits import LEFT_OUT, Limit, Seas, judged, limits_of, seas_needed, verdicts
from experiments.metrics import CONFIDENCE, METRICS, SCORED, WARM_UP, Window, metric_names, scores, window
from experiments.rollout import FIRST_TEST_SEED, batches, rollout, with_duration
from experiments.scatter import EXAMPLE, Cell, at_sea, check_sea, read_scatter, share
from experiments.validate import source_hash
from heave_env.controller import Controller
from heave_env.provenance import provenance
from heave_env.scenarios import Scenario, to_mapping

OPERABILITY = "operability"
"""`kind` in the `run.json` of an operability's folder."""
TABLE_FILE = "operability.csv"
SUMMARY_FILE = "operability.json"
PAGE_FILE = "operability.html"
CELLS = "cells"
"""Folder of what is kept of each controller and class."""
DESIGNS = ("fixed", "each")
"""For which sea a controller is designed: once for the scenario's own, or anew for each class."""
COLUMNS = (
    "controller",
    "significant_wave_height",
    "peak_period",
    "occurrence",
    "metric",
    "unit",
    "value",
    "low",
    "high",
    "worst",
    "n_seas",
    "failed",
    "limit",
    "kept",
    "operable",
)
"""Columns of the table."""

Found = dict[str, list[Seas]]
"""What each controller, by label, did in the seas of each class."""


# What is run -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Survey:
    """All that decides what the controllers do: everything that is asked for but the limits."""

    scenario: Scenario
    """The operation, in the sea that fixed controllers are designed for."""
    cells: Sequence[Cell]
    specs: tuple[str, ...]
    seeds: range
    design: str
    duration: float
    """Length of an episode [s]."""
    source: str
    """Hash of the program's source."""

    @property
    def part(self) -> Window:
        """The steps that are scored."""
        return window(self.duration, self.scenario.control_dt)

    @property
    def n_steps(self) -> int:
        """Control steps of all seas of a class [-]."""
        return len(self.seeds) * round(self.duration / self.scenario.control_dt)

    def identity(self, spec: str, cell: Cell) -> dict[str, Any]:
        """What must be the same for a kept result to be taken as it is."""
        found: dict[str, Any] = {
            "source": self.source,
            "scenario": self.scenario.fingerprint,
            "sea": at_sea(self.scenario, cell).fingerprint,
            "controller": spec,
            "design": self.design,
            "first_seed": self.seeds.start,
            "n_seeds": len(self.seeds),
            "duration": self.duration,
        }
        if is_agent(spec):  # its folder may hold another policy by now
            return found | {"design": None, "policy": content_hash(spec)}
        if content_hash(spec) is not None:  # nor a submission the same text
            found |= {"file": content_hash(spec)}
        return found if spec != "none" else found | {"design": None}

    def prepared(self, spec: str) -> Controller | None:
        """The controller that acts in every class, or None if each class has its own, which is tried once."""
        if spec == "none" or (self.design == "fixed" and not is_agent(spec)):
            designed = controller_of(spec, self.scenario)
            _refuse_filter_states(spec, getattr(designed, "measures", ()))
            return designed
        self.acting(spec, self.cells[0], None)
        return None

    def acting(self, spec: str, cell: Cell, fixed: Controller | None) -> tuple[Scenario, Controller]:
        """The operation in a class's sea, and the controller that acts there.

        Raises:
            ValueError: If the controller cannot be had for that sea.
        """
        there = at_sea(self.scenario, cell)
        if fixed is not None:
            # The observation keeps the scales of the sea that the controller was designed for.
            return dataclasses.replace(there, sensors=self.scenario.observed_sensors), fixed
        try:
            controller = controller_of(spec, there, allow_other_scenario=True)
        except ValueError as error:
            raise ValueError(f"in seas of {cell}: {error}") from error
        if is_agent(spec):
            trained: Scenario = controller.scenario  # type: ignore[attr-defined]
            _refuse_filter_states(spec, trained.observation_names)
        return there, controller

    def run(self, there: Scenario, controller: Controller, progress: Callable[[int], None]) -> Seas:
        """Lets a controller act in the seas of a class and scores them."""
        timed = with_duration(there, self.duration)
        rows, failed = [], []
        for batch in batches(timed, self.seeds):
            trajectory = rollout(timed, controller, batch, progress=progress)
            rows.append(scores(trajectory, self.part))
            failed.append(trajectory.outcomes["diverged"] | trajectory.outcomes["lost"])
        names = [name for name in metric_names(there) if name in rows[0] and name not in LEFT_OUT]
        values = {name: np.concatenate([row[name] for row in rows]) for name in names}
        return Seas(values, np.concatenate(failed))


def _refuse_filter_states(spec: str, entries: Sequence[str]) -> None:
    if any(entry.startswith("filter_state") for entry in entries):
        raise ValueError(
            f"controller {spec!r} reads the states of the sea's filter, which mean something else in every "
            "sea; give --set information_set=sensors, or --design each if it is a designed one"
        )


def _kept_file(folder: Path, spec: str, cell: Cell) -> Path:
    name = spec
    if spec.startswith(ZOO_PREFIX):
        name = re.sub(r"[^\w.-]+", "_", spec)
    elif ":" in spec:
        kind, _, given = spec.partition(":")
        path = Path(given).resolve()
        known_by = hashlib.sha256(str(path).encode()).hexdigest()[:8]
        name = f"{kind}-" + re.sub(r"[^\w.-]+", "_", path.name) + "-" + known_by
    return folder / CELLS / name / f"hs_{cell.significant_wave_height}_tp_{cell.peak_period}.json"


def _kept(path: Path, identity: dict[str, Any]) -> Seas | None:
    """What the folder holds of a class, if it was made in the same way."""
    if not path.exists():
        return None
    try:
        stored = runs.read_json(path)
        if stored["identity"] != identity:
            return None
        values = {name: np.array(row, dtype=float) for name, row in stored["values"].items()}
        return Seas(values, np.array(stored["failed"], dtype=bool))
    except (ValueError, KeyError, TypeError, AttributeError):
        return None  # cut short or altered by someone: it is run again


def surveyed(
    folder: Path,
    asked: Survey,
    made: dict[str, Any],
    progress: Callable[[str, int, int], None] | None = None,
) -> Found:
    """Runs every controller in every class that the folder does not hold yet, and keeps it there.

    Args:
        folder: Where finished classes are kept.
        asked: What is to be run.
        made: The folder's run file.
        progress: Called with a controller, steps done since the last call and steps in all.

    Returns:
        What each controller did, in the order of the classes.

    Raises:
        ValueError: If a controller does not fit the scenario.
    """
    labels, held = labels_of(asked.specs), {}
    for spec in asked.specs:
        held[spec] = [
            _kept(_kept_file(folder, spec, cell), asked.identity(spec, cell)) for cell in asked.cells
        ]
    # All are designed and loaded before any acts, so that an impossible one is told at once.
    fixed = {spec: asked.prepared(spec) for spec in asked.specs if None in held[spec]}
    runs.write_json(folder / runs.RUN_FILE, made)
    found: Found = {}
    for spec in asked.specs:

        def report(count: int, label: str = labels[spec]) -> None:
            if progress is not None:
                progress(label, count, asked.n_steps * len(asked.cells))

        row = found[labels[spec]] = []
        for cell, seas in zip(asked.cells, held[spec], strict=True):
            if seas is None:
                seas = asked.run(*asked.acting(spec, cell, fixed[spec]), report)
                content = {
                    "identity": asked.identity(spec, cell),
                    "values": seas.values,
                    "failed": seas.failed,
                }
                runs.write_json(_kept_file(folder, spec, cell), content)
            else:
                report(asked.n_steps)
            row.append(seas)
    return found


# What is made of it ------------------------------------------------------------------------------


def _rows(
    cells: Sequence[Cell], found: Found, limits: Sequence[Limit], quantile: float | None
) -> list[tuple[Any, ...]]:
    """The lines of the table: one for each controller, class and metric."""
    bounds = {limit.metric: limit for limit in limits}
    lines = []
    for label, row in found.items():
        told = verdicts(row, limits, quantile)
        for i, (cell, seas) in enumerate(zip(cells, row, strict=True)):
            for metric in seas.values:
                item, limit = judged(seas, metric, quantile), bounds.get(metric)
                lines.append(
                    (
                        label,
                        *dataclasses.astuple(cell),
                        metric,
                        METRICS[metric].unit,
                        item.value,
                        item.low,
                        item.high,
                        item.worst,
                        item.n_seas,
                        int(seas.failed.sum()),
                        None if limit is None else limit.bound,
                        None if limit is None else bool(told.kept[metric][i]),
                        bool(told.operable[i]),
                    )
                )
    return lines


def _percentages(
    cells: Sequence[Cell], found: Found, limits: Sequence[Limit], quantile: float | None
) -> dict[str, Any]:
    """By controller: seas in which work may go on [%], and how many classes are how."""
    told = {}
    for label, row in found.items():
        item = verdicts(row, limits, quantile)
        told[label] = {
            "operable": share(cells, item.operable),
            "low": share(cells, item.surely),
            "high": share(cells, item.perhaps),
            "limits": {metric: share(cells, kept) for metric, kept in item.kept.items()},
            "n_operable": int(item.operable.sum()),
            "n_undecided": int((item.perhaps & ~item.surely).sum()),
            "n_failed": int(sum(seas.failed.sum() for seas in row)),
        }
    return told


def operability(
    scenario: Scenario,
    controllers: Sequence[str],
    *,
    limits: str,
    n_seeds: int,
    out: str | Path,
    scatter: str | Path = EXAMPLE,
    quantile: float | None = None,
    design: str = "fixed",
    duration: float | None = None,
    arguments: list[str] | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Path:
    """Runs the controllers in every class of a scatter diagram and writes table, percentages and page.

    Args:
        scenario: The operation; its own sea is the one that fixed controllers are designed for.
        controllers: Names of designs, and `agent:RUN` or `zoo:NAME` for agents, which act as they are.
        limits: `METRIC=VALUE,...`.
        n_seeds: Seas of each class: the first so many test seas.
        out: The folder.
        scatter: The scatter diagram's file.
        quantile: Share of the seas that must keep a limit; None: their mean must.
        design: One of `DESIGNS`.
        duration: Length of the episodes [s]; None: the protocol's, or the scenario's if that is shorter.
        arguments: Command line of the provenance; None: the process's own.
        progress: Called with a controller's label, steps done since the last call and steps in all.

    Returns:
        The folder.

    Raises:
        ValueError: If anything asked for is impossible.
    """
    folder = runs.check_folder(out, OPERABILITY)
    specs = check_specs(controllers)
    chosen = limits_of(limits, scenario)
    cells = read_scatter(scatter)
    check_sea(scenario)
    if n_seeds < 1:
        raise ValueError(f"seeds must be at least 1, got {n_seeds}")
    if quantile is not None and not 0.0 < quantile < 1.0:
        raise ValueError(f"quantile must lie between 0 and 1, got {quantile!r}")
    if design not in DESIGNS:
        raise ValueError(f"design must be one of {', '.join(DESIGNS)}, got {design!r}")
    dt = scenario.control_dt
    usual = min(scenario.duration, round((WARM_UP + SCORED) / dt) * dt)
    length = with_duration(scenario, usual if duration is None else duration).duration
    seeds = range(FIRST_TEST_SEED, FIRST_TEST_SEED + n_seeds)
    asked = Survey(scenario, cells, specs, seeds, design, length, source_hash())

    common = {
        "design": design,
        "first_seed": seeds.start,
        "n_seeds": n_seeds,
        "warm_up": asked.part.warm_up,
        "scored": asked.part.scored,
        "provenance": provenance(arguments),
    }
    made = {
        "kind": OPERABILITY,
        "scenario": to_mapping(scenario),
        "fingerprint": scenario.fingerprint,
        "controllers": {label: spec for spec, label in labels_of(specs).items()},
        "scatter": [dataclasses.asdict(cell) for cell in cells],
        "source": asked.source,
    }
    found = surveyed(folder, asked, made | common, progress)
    told = {
        "scenario": scenario.name,
        "fingerprint": scenario.fingerprint,
        "scatter": str(scatter),
        "n_cells": len(cells),
        "limits": {limit.metric: limit.bound for limit in chosen},
        "statistic": "mean" if quantile is None else f"quantile {quantile:g}",
        "seas_needed": seas_needed(quantile),
        "interval": f"{100.0 * CONFIDENCE:.0f} %, {'Student t' if quantile is None else 'order statistics'}",
        "controllers": _percentages(cells, found, chosen, quantile),
    } | common
    from experiments.operability_page import page_text

    text = page_text(scenario, told, cells, found, chosen, quantile)
    runs.write_text(folder / TABLE_FILE, runs.table_text(COLUMNS, _rows(cells, found, chosen, quantile)))
    runs.write_json(folder / SUMMARY_FILE, told)
    runs.write_text(folder / PAGE_FILE, text)
    return folder
