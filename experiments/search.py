"""A search for settings: Optuna proposes, trainings of a sweep answer, an SQLite file remembers.

What a trial is depends on the sampler's seed, its number and the trials that were finished before it; so a
search of one worker comes out the same however often it is interrupted.
"""

from __future__ import annotations

import json
import math
from collections import deque
from pathlib import Path
from typing import Any

from experiments.sweep_file import Cell, Range, Search, plain_preset, resolved, with_parameters
from heave_env import scenarios

STORAGE_FILE = "search.db"
"""What Optuna remembers, in the sweep's folder."""
_STUDY = "search"
_SETTINGS = "settings"  # of the search, kept in the study


class Study:
    """The trials of a search, and the trainings that each of them still lacks."""

    def __init__(self, search: Search, steps: int | None, out: Path) -> None:
        """Opens the study of a folder, or makes one.

        Args:
            search: What is searched.
            steps: Environment steps of the file.
            out: The sweep's folder.

        Raises:
            ValueError: If the folder holds another search.
        """
        import optuna

        optuna.logging.set_verbosity(optuna.logging.WARNING)
        self.search, self.ranges = search, search.ranges
        self.scenario = scenarios.load(search.scenario)
        self.steps = search.steps or steps
        base = resolved(self.scenario, search.algorithm, search.kind, search.overrides, self.steps)
        settings = {
            "scenario": self.scenario.name,
            "fingerprint": self.scenario.fingerprint,
            "algorithm": search.algorithm,
            "kind": search.kind,
            "seeds": list(search.seeds),
            "preset": plain_preset(base),
            "sampler_seed": search.sampler_seed,
            "parameters": json.loads(json.dumps(dict(search.parameters))),
        }
        path = out / STORAGE_FILE
        out.mkdir(parents=True, exist_ok=True)
        self.study = optuna.create_study(
            storage=f"sqlite:///{path.resolve()}",
            study_name=_STUDY,
            load_if_exists=True,
            direction="minimize",
        )
        held = self.study.user_attrs.get(_SETTINGS)
        if held is not None and held != settings:
            key = next(key for key in settings if held.get(key) != settings[key])
            raise ValueError(
                f"{str(path)!r} holds a search with another {key}; give another folder, "
                "or the settings that it began with (trials alone may grow)"
            )
        if held is None:
            self.study.set_user_attr(_SETTINGS, settings)
        self.distributions = {name: _distribution(span) for name, span in self.ranges.items()}
        self.pending: deque[Cell] = deque()
        self.costs: dict[int, dict[int, float]] = {}  # of trials under way, by seed
        self._take_up()

    def _take_up(self) -> None:
        """Goes on with the trials that were not finished."""
        import optuna

        for trial in self.study.get_trials(states=(optuna.trial.TrialState.RUNNING,)):
            if trial.params.keys() == self.distributions.keys():
                self._begin(trial.number, trial.params)
            else:  # cut off while it was being proposed
                self.study.tell(trial.number, state=optuna.trial.TrialState.FAIL)

    @property
    def n_begun(self) -> int:
        """Trials that were proposed whole [-]."""
        return len(self._whole())

    def _whole(self) -> list[Any]:
        trials = self.study.get_trials(deepcopy=False)
        return [trial for trial in trials if trial.params.keys() == self.distributions.keys()]

    def cell(self) -> Cell | None:
        """The next training, of a new trial if none is left of those begun; None if there is none."""
        if not self.pending and (number := self.n_begun) < self.search.trials:
            self.study.sampler = _sampler(self.search.sampler_seed, number)
            trial = self.study.ask(self.distributions)
            self._begin(trial.number, trial.params)
        return self.pending.popleft() if self.pending else None

    def cells(self) -> list[Cell]:
        """The trainings of every trial begun so far, by trial."""
        return [cell for trial in self._whole() for cell in self._cells(trial.number, trial.params)]

    def _begin(self, number: int, parameters: dict[str, Any]) -> None:
        self.costs[number] = {}
        self.pending.extend(self._cells(number, parameters))

    def _cells(self, number: int, parameters: dict[str, Any]) -> list[Cell]:
        chosen = {
            key: json.loads(value) if self.ranges[key].choices is not None else value
            for key, value in parameters.items()
        }
        overrides = with_parameters(self.search.overrides, chosen)
        preset = resolved(self.scenario, self.search.algorithm, self.search.kind, overrides, self.steps)
        return [
            Cell(
                scenario=self.scenario,
                algorithm=self.search.algorithm,
                kind=self.search.kind,
                seed=seed,
                overrides=overrides,
                preset=preset,
                folder=f"search/trial_{number:04d}-{seed}",
                trial=number,
            )
            for seed in self.search.seeds
        ]

    def tell(self, cell: Cell, cost: float) -> None:
        """Takes the best validation cost of a training; infinite if it stopped being finite."""
        assert cell.trial is not None
        costs = self.costs[cell.trial]
        costs[cell.seed] = cost
        if len(costs) == len(self.search.seeds):
            self.study.tell(cell.trial, math.fsum(costs.values()) / len(costs))
            del self.costs[cell.trial]

    @property
    def best(self) -> dict[str, Any] | None:
        """Number, value and settings of the best trial; None before the first with a finite cost."""
        done = [trial for trial in self._whole() if trial.value is not None and math.isfinite(trial.value)]
        if not done:
            return None
        best = min(done, key=lambda trial: trial.value)
        overrides = self._cells(best.number, best.params)[0].overrides
        return {"trial": best.number, "value": best.value, "overrides": overrides}


def _distribution(span: Range) -> Any:
    import optuna

    if span.choices is not None:  # as JSON: Optuna keeps words and numbers, and a choice may be a list
        return optuna.distributions.CategoricalDistribution([json.dumps(item) for item in span.choices])
    low, high = span.extremes
    kind = optuna.distributions.IntDistribution if span.integer else optuna.distributions.FloatDistribution
    return kind(low, high, log=span.log)


def _sampler(seed: int, number: int) -> Any:
    import numpy as np
    import optuna

    derived = int(np.random.SeedSequence([seed, number]).generate_state(1)[0])
    return optuna.samplers.TPESampler(seed=derived)
