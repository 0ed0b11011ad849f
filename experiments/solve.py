"""`heave cases` and `heave solve`: any solver on a named case or on the user's own, from a YAML file."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import experiments.cases
from experiments import figures, runs
from experiments.cases.case import REGISTRY, Case, Named, Outcome
from heave_env import document
from heave_env.parameters import name_hint
from heave_env.provenance import provenance

SOLUTION = "solution"
"""`kind` in the `run.json` of a solution's folder."""
QUANTITIES_FILE = "quantities.csv"
CASE_FILE = "case.yaml"


def named_cases() -> dict[str, Named]:
    """Every registered case by name, sorted by solver."""
    for module in pkgutil.iter_modules(experiments.cases.__path__):
        importlib.import_module(f"experiments.cases.{module.name}")
    return dict(sorted(REGISTRY.items(), key=lambda item: (item[1].solver, item[0])))


def named_case(name: str) -> Named:
    """The registered case of that name.

    Raises:
        ValueError: If there is none.
    """
    known = named_cases()
    if name not in known:
        hint = name_hint(name, known, "list them with heave cases list")
        raise ValueError(f"unknown case {name!r}; {hint}")
    return known[name]


def load(source: str, settings: Sequence[tuple[str, Any]] = ()) -> tuple[Named, Case]:
    """A case by name or from a YAML file, with the values at dotted paths replaced.

    The file's key `case` names the case it is a variant of; its other keys are that case's parameters.

    Raises:
        ValueError: If there is no such case or file, or a value is impossible.
    """
    if source.endswith((".yaml", ".yml")) or Path(source).is_file():
        mapping = document.read_mapping(source, "case")
        if not isinstance(mapping, dict) or not isinstance(mapping.get("case"), str):
            raise ValueError(
                f"{source!r} must be a mapping whose key 'case' names the case it is a variant of; start "
                "from heave cases show NAME"
            )
        values = dict(mapping)
        named = named_case(values.pop("case"))
        try:
            parameters = document.from_mapping(type(named.build()), values)
        except ValueError as error:
            raise ValueError(f"{source!r}: {error}") from error
    else:
        named = named_case(source)
        parameters = named.build()
    for path, value in settings:
        parameters = document.with_value(parameters, path, value)
    return named, parameters


def to_yaml(named: Named, parameters: Case) -> str:
    """The case as YAML; `load` takes it back unchanged."""
    heading = (
        f"heave_env case of the {named.solver} solver: {named.description}\nUnits are SI, angles in rad."
    )
    head, _, rest = document.to_yaml(parameters, heading).partition("rad.\n")
    return f"{head}rad.\ncase: {named.name}\n{rest}"


def solve(named: Named, parameters: Case, out: str | Path | None, arguments: list[str] | None) -> Outcome:
    """Runs a case; with `out` its parameters, numbers, tables and pictures go to that folder.

    Raises:
        ValueError: If the parameters are impossible or the folder is taken.
        ConvergenceError: If the solver finds no answer.
    """
    folder = None if out is None else runs.check_folder(out, SOLUTION)
    outcome = parameters.outcome()
    if folder is None:
        return outcome
    rows = [(item.name, item.value, item.unit, item.meaning) for item in outcome.quantities]
    runs.write_text(folder / CASE_FILE, to_yaml(named, parameters))
    runs.write_text(folder / QUANTITIES_FILE, runs.table_text(("quantity", "value", "unit", "meaning"), rows))
    for name, columns in outcome.tables.items():
        text = runs.table_text(list(columns), zip(*columns.values(), strict=True))
        runs.write_text(folder / f"{name}.csv", text)
    for name, draw in outcome.pictures.items():
        runs.write_text(folder / f"{name}.svg", figures.svg(draw))
    about = {"kind": SOLUTION, "case": named.name, "solver": named.solver}
    runs.write_json(folder / runs.RUN_FILE, about | {"provenance": provenance(arguments)})
    return outcome
