"""The page of an operability: maps over wave height and period, drawn from what was found."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments import figures, page
from experiments.limits import Limit, Seas, judged, verdicts
from experiments.metrics import METRICS
from experiments.report import significant
from experiments.scatter import Cell
from heave_env.scenarios import Scenario

Array = np.ndarray


@dataclass(frozen=True)
class Shown:
    """How a metric is told."""

    title: str
    unit: str
    factor: float
    """From the metric's unit to this one."""


SHOWN = {
    "payload_heave_std": Shown("Residual motion: standard deviation of payload heave", "m", 1.0),
    "payload_heave_max": Shown("Residual motion: largest payload heave", "m", 1.0),
    "tension_peak": Shown("Peak tension along the cable", "kN", 1e-3),
    "tension_min": Shown("Least tension along the cable", "kN", 1e-3),
    "slack_fraction": Shown("Slack: steps without tension somewhere", "%", 1e2),
    "saturation_fraction": Shown("Saturation: steps in which a limit of the winch bit", "%", 1e2),
    "winch_power_peak": Shown("Peak power of the winch", "kW", 1e-3),
}
"""Metrics whose maps speak another unit than the files."""
MAPS = (
    "payload_heave_std",
    "payload_heave_max",
    "tension_peak",
    "slack_fraction",
    "saturation_fraction",
    "supply_energy",
)
"""Metrics that are always shown, where the plant has them."""
LINEAR_MAPS = ("payload_heave_std", "payload_heave_max", "saturation_fraction", "control_energy")
"""Those of a plant without a cable."""


def shown(metric: str, scored: float) -> Shown:
    """How a metric is told; work is given per hour.

    Args:
        metric: The metric.
        scored: Time that is scored [s].
    """
    if metric == "winch_work":
        return Shown("Winch energy: work of lifting, per hour", "kWh/h", 1e-3 / scored)
    if metric == "supply_energy":
        return Shown("Energy drawn from the supply, per hour", "kWh/h", 3600.0 / scored)
    item = METRICS[metric]
    return SHOWN.get(metric, Shown(item.meaning[:1].upper() + item.meaning[1:], item.unit, 1.0))


def limit_text(limit: Limit, scored: float) -> str:
    """A limit as people write it: `payload_heave_std ≤ 0.1 m`."""
    item = shown(limit.metric, scored)
    sign = "≥" if limit.at_least else "≤"
    unit = "" if item.unit == "-" else f" {item.unit}"
    return f"{limit.metric} {sign} {f'{item.factor * limit.bound:.6g}'.replace('-', '−')}{unit}"


def share_text(found: dict[str, Any]) -> str:
    """Percentage of seas, and between which it may lie, as far as the seas that were run can tell."""
    if found["low"] == found["high"]:
        return f"{found['operable']:.1f}"
    return f"{found['operable']:.1f} ({found['low']:.1f} to {found['high']:.1f})"


def too_few(told: dict[str, Any]) -> str:
    """What to say if there are too few seas to decide that a class is operable; else nothing."""
    if told["n_seeds"] >= told["seas_needed"]:
        return ""
    return (
        f"With {told['n_seeds']} seas per class none is surely operable by the {told['statistic']}; "
        f"that takes {told['seas_needed']} at least."
    )


def _on_grid(cells: Sequence[Cell], values: Array) -> Array:
    """Values of the classes by height and period, (n_heights, n_periods); NaN where there is no class."""
    heights = sorted({cell.significant_wave_height for cell in cells})
    periods = sorted({cell.peak_period for cell in cells})
    grid = np.full((len(heights), len(periods)), np.nan)
    for cell, value in zip(cells, values, strict=True):
        grid[heights.index(cell.significant_wave_height), periods.index(cell.peak_period)] = value
    return grid


def _pictures(
    cells: Sequence[Cell],
    found: dict[str, list[Seas]],
    limits: Sequence[Limit],
    quantile: float | None,
    scored: float,
) -> list[dict[str, str]]:
    heights = sorted({cell.significant_wave_height for cell in cells})
    periods = sorted({cell.peak_period for cell in cells})
    weights = np.array([cell.occurrence for cell in cells])
    share = _on_grid(cells, 100.0 * weights / weights.sum())
    states = {}
    for label, row in found.items():
        told = verdicts(row, limits, quantile)
        undecided = told.perhaps & ~told.surely
        states[label] = _on_grid(cells, np.where(undecided, 0.5, 0.0) + np.where(told.operable, 1.0, 0.0))
    drawn = [
        (
            "Where work may go on. In each class its share of all seas [%]; hatched where more seas could "
            "turn the verdict.",
            figures.operable_maps(heights, periods, share, states),
        )
    ]
    first = next(iter(found.values()))[0].values
    always = MAPS if "tension_peak" in first else LINEAR_MAPS
    bounds = {limit.metric: limit for limit in limits}
    for metric in (*always, *(name for name in bounds if name not in always)):
        item = shown(metric, scored)
        rows = {label: [judged(seas, metric, quantile).value for seas in row] for label, row in found.items()}
        limit = bounds.get(metric)
        broken = {
            label: _on_grid(cells, np.array([limit is not None and not limit.keeps(value) for value in row]))
            for label, row in rows.items()
        }
        grids = {label: _on_grid(cells, item.factor * np.array(row)) for label, row in rows.items()}
        # A class whose seas failed has no number, and is no gap of the diagram either.
        failed = {label: np.isinf(grid) for label, grid in grids.items()}
        text = figures.sea_maps(heights, periods, grids, item.title, item.unit, broken, failed)
        said = f"; limit {limit_text(limit, scored)}, hatched where broken" if limit else ""
        drawn.append((f"{item.title}{said}.", text))
    return [{"caption": caption, "source": page.embedded(svg)} for caption, svg in drawn]


def page_text(
    scenario: Scenario,
    told: dict[str, Any],
    cells: Sequence[Cell],
    found: dict[str, list[Seas]],
    limits: Sequence[Limit],
    quantile: float | None,
) -> str:
    """The page as HTML text.

    Args:
        scenario: The operation.
        told: The folder's summary.
        cells: The classes.
        found: What each controller, by label, did in each of them.
        limits: What must be kept.
        quantile: The statistic; None for the mean.
    """
    scored = float(told["scored"])
    colours = figures.colour_of(list(found))
    lines = []
    for label, item in told["controllers"].items():
        cells_of = [share_text(item), *(f"{item['limits'][limit.metric]:.1f}" for limit in limits)]
        cells_of += [str(item[name]) for name in ("n_operable", "n_undecided", "n_failed")]
        lines.append({"label": label, "colour": colours[label], "cells": cells_of})
    sea, winch = scenario.sea_state, scenario.winch
    designed = f"Hs {sea.significant_wave_height:g} m, Tp {significant(2.0 * math.pi / sea.peak_omega)} s"
    plant = "linear payload model" if scenario.is_linear else f"{scenario.initial_length:g} m of cable"
    facts = [
        ("spectrum", f"{sea.spectrum}, {sea.kind.replace('_', ' ')}"),
        ("designed for", designed if told["design"] == "fixed" else "each class of its own"),
        ("plant", plant),
        ("command delay", f"{winch.command_delay:g} s"),
        ("classes", str(len(cells))),
        ("seas per class", str(told["n_seeds"])),
        ("scored", f"{told['scored']:g} s after {told['warm_up']:g} s"),
    ]
    statistic = "the mean over its seas keeps"
    if quantile is not None:
        statistic = f"at least {100.0 * quantile:g} % of its seas keep"
    context = {
        "name": scenario.name,
        "description": scenario.description,
        "fingerprint": told["fingerprint"],
        "facts": facts,
        "limits": [limit_text(limit, scored) for limit in limits],
        "statistic": statistic,
        "is_mean": quantile is None,
        "too_few": too_few(told),
        "interval": told["interval"],
        "scatter": told["scatter"],
        "design": told["design"],
        "rows": lines,
        "pictures": _pictures(cells, found, limits, quantile, scored),
        "classes": [dataclasses.asdict(cell) for cell in cells],
        "made": told["provenance"],
        "first_seed": told["first_seed"],
        "last_seed": told["first_seed"] + told["n_seeds"] - 1,
    }
    return page.render("operability.html.j2", context)
