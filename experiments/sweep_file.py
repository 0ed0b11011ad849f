"""What a sweep is asked to do: a YAML file of trainings and of a search, strictly checked."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from agents.presets import ALGORITHMS, Preset, kinds_of, load_preset
from heave_env import scenarios
from heave_env.document import from_mapping, read_mapping
from heave_env.parameters import name_hint, require, require_integer
from heave_env.scenarios import Scenario

SENSORS = "sensors"
"""The kind of agent that has no guide: the algorithm's preset as it is."""
OPTION = "options."
"""What the name of a searched option of Stable-Baselines3's algorithm begins with."""


@dataclass(frozen=True, kw_only=True)
class Entry:
    """Trainings: every scenario with every algorithm, kind and seed."""

    scenarios: tuple[str, ...]
    """Names or YAML files."""
    algorithms: tuple[str, ...] = ("ppo",)
    """Some of `agents.presets.ALGORITHMS`."""
    kinds: tuple[str, ...] = (SENSORS,)
    """Presets: `sensors`, `residual`, `estimate`."""
    seeds: tuple[int, ...] = (0,)
    """Of the trainings."""
    steps: int | None = None
    """Environment steps of each training [-]; null: the file's, or else the preset's."""
    overrides: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """Preset keys on top of the preset; `options` are merged key by key."""

    def __post_init__(self) -> None:
        for field in ("scenarios", "algorithms", "kinds", "seeds"):
            require(len(getattr(self, field)) > 0, self, field, "a list with at least one entry")
        _check_common(self)


@dataclass(frozen=True, kw_only=True)
class Range:
    """What a searched setting may be: between two numbers, or one of some choices."""

    low: float | None = None
    """Least value."""
    high: float | None = None
    """Largest value."""
    log: bool = False
    """Whether the logarithm is searched."""
    integer: bool = False
    """Whether only whole numbers count."""
    choices: tuple[Any, ...] | None = None
    """The values, instead of `low` and `high`."""

    def __post_init__(self) -> None:
        bounded = self.low is not None and self.high is not None
        if self.choices is not None:
            require(self.low is None and self.high is None, self, "choices", "given without low and high")
            require(len(self.choices) > 0, self, "choices", "a list with at least one value")
            require(not self.log and not self.integer, self, "choices", "given without log and integer")
            return
        require(bounded, self, "low", "given together with high, or choices instead of both")
        assert self.low is not None and self.high is not None
        require(self.low < self.high, self, "low", f"below high = {self.high}")
        require(not self.log or self.low > 0.0, self, "low", "positive where log is true")
        whole = float(self.low).is_integer() and float(self.high).is_integer()
        require(not self.integer or whole, self, "integer", "false where low or high is no whole number")

    @property
    def extremes(self) -> tuple[Any, ...]:
        """The values to try whether a preset bears them: every choice, or both ends."""
        if self.choices is not None:
            return self.choices
        assert self.low is not None and self.high is not None
        return (int(self.low), int(self.high)) if self.integer else (self.low, self.high)


@dataclass(frozen=True, kw_only=True)
class Search:
    """A search for the settings of least validation cost in one scenario."""

    scenario: str
    """Name or YAML file."""
    algorithm: str = "ppo"
    """One of `agents.presets.ALGORITHMS`."""
    kind: str = SENSORS
    """Preset: `sensors`, `residual` or `estimate`."""
    seeds: tuple[int, ...] = (0,)
    """Each trial is trained with each of them; the mean of their best validation costs is its value."""
    steps: int | None = None
    """Environment steps of each training [-]; null: the file's, or else the preset's."""
    overrides: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """Preset keys that all trials share, on top of the preset."""
    trials: int
    """Settings to try [-]."""
    sampler_seed: int = 0
    """Of Optuna's sampler."""
    parameters: Mapping[str, Any]
    """What is searched: a preset key, or `options.NAME`, to its `Range`."""

    def __post_init__(self) -> None:
        require_integer(self, "trials", minimum=1)
        require_integer(self, "sampler_seed", minimum=0)
        require(len(self.seeds) > 0, self, "seeds", "a list with at least one entry")
        parameters = self.parameters
        require(isinstance(parameters, Mapping) and len(parameters) > 0, self, "parameters", "a mapping")
        _check_common(self)

    @property
    def ranges(self) -> dict[str, Range]:
        """The ranges by name.

        Raises:
            ValueError: If one is impossible.
        """
        found = {}
        for key, value in self.parameters.items():
            where = f"search.parameters.{key}"
            try:
                found[key] = from_mapping(Range, value, where)
            except ValueError as error:
                raise ValueError(str(error).replace("Range.", f"{where}.")) from error
        return found


def _check_common(asked: Entry | Search) -> None:
    if asked.steps is not None:
        require_integer(asked, "steps", minimum=1)
    require(isinstance(asked.overrides, Mapping), asked, "overrides", "a mapping of preset keys to values")
    for key in ("total_steps",):
        if key in asked.overrides:
            raise ValueError(f"overrides.{key} must not be given; give steps beside overrides instead")


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """A file of trainings."""

    steps: int | None = None
    """Environment steps of each training that says nothing else [-]; null: the preset's."""
    runs: tuple[Entry, ...] = ()
    """Trainings to run."""
    search: Search | None = None
    """A search to run after them."""

    def __post_init__(self) -> None:
        if self.steps is not None:
            require_integer(self, "steps", minimum=1)
        if not self.runs and self.search is None:
            raise ValueError("a sweep must have runs or a search; give one of the two keys")


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One training of a sweep."""

    scenario: Scenario
    algorithm: str
    kind: str
    seed: int
    overrides: dict[str, Any]
    """What was asked for on top of the preset, its steps left out."""
    preset: Preset
    """All settings."""
    folder: str
    """Run folder, below the sweep's."""
    trial: int | None = None
    """Number of the search's trial that it belongs to."""

    @property
    def settings(self) -> dict[str, Any]:
        """The preset as JSON values."""
        return plain_preset(self.preset)


def read_sweep(path: str | Path) -> Sweep:
    """Reads a sweep file.

    Raises:
        ValueError: If it cannot be read, or a key or value is impossible.
    """
    content = _with_numbers(read_mapping(path, "sweep"))
    try:
        return from_mapping(Sweep, content)
    except ValueError as error:
        raise ValueError(f"{str(path)!r}: {error}") from error


_EXPONENT = re.compile(r"[+-]?\d+(\.\d*)?[eE][+-]?\d+")


def _with_numbers(content: Any) -> Any:
    """The content with 1e-4 as a number: YAML 1.1 takes it for a word, for want of a point."""
    if isinstance(content, dict):
        return {key: _with_numbers(value) for key, value in content.items()}
    if isinstance(content, list):
        return [_with_numbers(value) for value in content]
    if isinstance(content, str) and _EXPONENT.fullmatch(content):
        number = float(content)
        return int(number) if number.is_integer() else number
    return content


def cells_of(sweep: Sweep) -> list[Cell]:
    """The trainings of the file's runs, in its order, each once.

    Raises:
        ValueError: If a scenario, algorithm, kind, seed or override is impossible.
    """
    found: dict[str, Cell] = {}
    for i, entry in enumerate(sweep.runs):
        try:
            for cell in _cells(entry, sweep.steps):
                found.setdefault(cell.folder, cell)
        except ValueError as error:
            raise ValueError(f"runs[{i}]: {error}") from error
    return list(found.values())


def _cells(entry: Entry, steps: int | None) -> Iterator[Cell]:
    for name in entry.scenarios:
        scenario = scenarios.load(name)
        for algorithm in entry.algorithms:
            for kind in entry.kinds:
                preset = resolved(scenario, algorithm, kind, entry.overrides, entry.steps or steps)
                for seed in entry.seeds:
                    check_seed(seed, preset)
                    yield Cell(
                        scenario=scenario,
                        algorithm=algorithm,
                        kind=kind,
                        seed=seed,
                        overrides=dict(entry.overrides),
                        preset=preset,
                        folder=f"cells/{_name(scenario, algorithm, kind, seed, preset)}",
                    )


def _name(scenario: Scenario, algorithm: str, kind: str, seed: int, preset: Preset) -> str:
    """A folder of its own for all that decides a result."""
    identity = [scenario.name, scenario.fingerprint, algorithm, seed, plain_preset(preset)]
    known_by = hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()[:8]
    return f"{re.sub(r'[^A-Za-z0-9_@.-]+', '_', scenario.name)}-{algorithm}-{kind}-{seed}-{known_by}"


def plain_preset(preset: Preset) -> dict[str, Any]:
    """A preset as its run folder holds it."""
    plain: dict[str, Any] = json.loads(json.dumps(preset.to_mapping()))
    return plain


def check_seed(seed: int, preset: Preset) -> None:
    """Refuses a seed that has no training seas.

    Raises:
        ValueError: If the seed is impossible.
    """
    from agents.train import first_training_sea

    first_training_sea(seed, preset)


def resolved(
    scenario: Scenario, algorithm: str, kind: str, overrides: Mapping[str, Any], steps: int | None
) -> Preset:
    """The preset of a kind of agent with a user's own settings on top.

    Args:
        scenario: The scenario to train in.
        algorithm: Learning algorithm.
        kind: Kind of agent.
        overrides: Preset keys to values; `options` are merged key by key.
        steps: Environment steps; None: the preset's.

    Raises:
        ValueError: If one of them is unknown or impossible.
    """
    from agents.train import option_names

    if algorithm not in ALGORITHMS:
        raise ValueError(f"algorithm must be one of {', '.join(ALGORITHMS)}, got {algorithm!r}")
    kinds = [SENSORS, *kinds_of(algorithm)]
    if kind not in kinds:
        raise ValueError(f"kind of {algorithm} must be one of {', '.join(kinds)}, got {kind!r}")
    settings = load_preset(algorithm, scenario, None if kind == SENSORS else kind).to_mapping()
    del settings["algorithm"]
    options = overrides.get("options", {})
    if not isinstance(options, Mapping):
        raise ValueError(f"overrides.options must be a mapping of options to values, got {options!r}")
    known = option_names(algorithm) | set(settings["options"])
    for name in options:
        if name not in known:
            hint = name_hint(name, known, f"known: {', '.join(sorted(known))}")
            raise ValueError(f"unknown option {name!r} of {algorithm}; {hint}")
    settings = {**settings, **overrides, "options": {**settings["options"], **options}}
    if steps is not None:
        settings["total_steps"] = steps
    try:
        return load_preset(algorithm, scenario, settings)
    except TypeError as error:  # a value that is compared before its type is looked at
        raise ValueError(f"overrides {dict(overrides)!r} hold a value of a wrong type: {error}") from error


def with_parameters(overrides: Mapping[str, Any], parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Overrides with searched settings in their places."""
    keys = {key: value for key, value in parameters.items() if not key.startswith(OPTION)}
    options = {key.removeprefix(OPTION): value for key, value in parameters.items() if key.startswith(OPTION)}
    merged = {**overrides, **keys}
    return {**merged, "options": {**overrides.get("options", {}), **options}} if options else merged


def check_search(search: Search, steps: int | None) -> None:
    """Refuses a search whose file cannot be carried out.

    Args:
        search: The search.
        steps: Environment steps of the file.

    Raises:
        ValueError: If a setting, a range or one of its ends is impossible.
    """
    scenario = scenarios.load(search.scenario)
    steps = search.steps or steps
    try:
        base = resolved(scenario, search.algorithm, search.kind, search.overrides, steps)
    except ValueError as error:
        raise ValueError(f"search: {error}") from error
    for seed in search.seeds:
        check_seed(seed, base)
    plain = plain_preset(base)
    for key, span in search.ranges.items():
        where = f"search.parameters.{key}"
        if key in ("options", "total_steps", "algorithm"):
            raise ValueError(f"{where} cannot be searched; name another preset key, or options.NAME")
        now = plain["options"].get(key.removeprefix(OPTION)) if key.startswith(OPTION) else plain.get(key)
        whole = isinstance(now, int) and not isinstance(now, bool)
        if whole and span.choices is None and not span.integer:
            raise ValueError(f"{where} stands for a whole number; give integer: true")
        for value in span.extremes:
            overrides = with_parameters(search.overrides, {key: value})
            try:
                preset = resolved(scenario, search.algorithm, search.kind, overrides, steps)
            except ValueError as error:
                raise ValueError(f"{where}: {value!r} is impossible: {error}") from error
            for seed in search.seeds:
                check_seed(seed, preset)
