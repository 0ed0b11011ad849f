"""Scatter diagrams: how often which seas occur, and a scenario in each of them.

A diagram's class is a significant wave height and a peak period; it gives a scenario's spectrum these two and
leaves the rest of the operation alone.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import heave_env
from heave_env.files import read_columns
from heave_env.scenarios import Scenario

SHIPPED = Path(heave_env.__file__).parent / "data" / "scatter"
"""Folder of the diagrams that travel with the package."""
EXAMPLE = "synthetic_scatter.csv"
"""One of them: computed, not measured."""
TWO_NUMBER_SPECTRA = ("bretschneider", "jonswap", "torsethaugen")
"""Spectra that a wave height and a peak period describe, the rest of them staying as it is."""


@dataclass(frozen=True)
class Cell:
    """One class of a scatter diagram."""

    significant_wave_height: float
    """Hs [m]."""
    peak_period: float
    """Tp [s]."""
    occurrence: float
    """How often it occurs, in any unit that all classes share."""

    def __str__(self) -> str:
        return f"Hs {self.significant_wave_height:g} m, Tp {self.peak_period:g} s"


def read_scatter(path: str | Path) -> list[Cell]:
    """Reads a scatter diagram: CSV with significant_wave_height [m], peak_period [s] and occurrence.

    Occurrences need not sum to one; a class of none is left out. A bare name that is no file here is that of
    a diagram that travels with the package. Lines that begin with # are comments.

    Raises:
        ValueError: If the file cannot be read, a number is missing, not finite or negative, a class stands
            there twice, or no sea ever occurs.
    """
    if not Path(path).exists() and Path(path).name == str(path) and (SHIPPED / path).exists():
        path = SHIPPED / path
    names = ("significant_wave_height", "peak_period", "occurrence")
    columns, lines = read_columns(path, "scatter diagram", names)
    cells: dict[tuple[float, float], Cell] = {}
    for line, *numbers in zip(lines, *(columns[name].tolist() for name in names), strict=True):
        cell = Cell(*numbers)
        where = f"scatter diagram {str(path)!r} line {line}"
        for name, positive in zip(names, (True, True, False), strict=True):
            value = getattr(cell, name)
            if value < 0.0 or (positive and value == 0.0):
                asked = "positive" if positive else "zero or more"
                raise ValueError(f"{where}: {name} must be {asked}, got {value:g}")
        key = (cell.significant_wave_height, cell.peak_period)
        if key in cells:
            raise ValueError(f"{where}: {cell} stands there twice; add up the occurrences in one row")
        cells[key] = cell
    occurring = [cell for cell in cells.values() if cell.occurrence > 0.0]
    if not occurring:
        raise ValueError(
            f"scatter diagram {str(path)!r} holds no sea that occurs; give a row with a positive occurrence"
        )
    return occurring


def check_sea(scenario: Scenario) -> None:
    """Makes sure that the scenario's sea can be any class of a scatter diagram.

    Raises:
        ValueError: If it has no spectrum, or one that two numbers do not describe, or draws them itself.
    """
    sea = scenario.sea_state
    if sea.kind not in ("shaping_filter", "random_phase"):
        raise ValueError(
            f"scenario {scenario.name!r} has a {sea.kind.replace('_', ' ')} sea, which has no spectrum to "
            "give another height and period; set sea_state.kind to shaping_filter or random_phase"
        )
    if sea.spectrum not in TWO_NUMBER_SPECTRA:
        raise ValueError(
            f"scenario {scenario.name!r} has the spectrum {sea.spectrum}, which wave height and peak period "
            f"do not describe; set sea_state.spectrum to one of {', '.join(TWO_NUMBER_SPECTRA)}"
        )
    for draw in scenario.uncertainty:
        if draw.parameter in ("sea_state.significant_wave_height", "sea_state.peak_omega"):
            raise ValueError(
                f"scenario {scenario.name!r} draws {draw.parameter}, which the scatter diagram gives; leave "
                "that draw out of its uncertainty"
            )


def at_sea(scenario: Scenario, cell: Cell) -> Scenario:
    """The scenario in the sea of a class: its spectrum with the class's Hs and ω_m = 2π/Tp."""
    sea = dataclasses.replace(
        scenario.sea_state,
        significant_wave_height=cell.significant_wave_height,
        peak_omega=2.0 * math.pi / cell.peak_period,
    )
    return dataclasses.replace(scenario, sea_state=sea)


def share(cells: Sequence[Cell], which: Sequence[bool] | np.ndarray) -> float:
    """Occurrence of some classes in that of all [%]."""
    weights = np.array([cell.occurrence for cell in cells])
    return float(100.0 * np.sum(weights[np.asarray(which, dtype=bool)]) / np.sum(weights))
