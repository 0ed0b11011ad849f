"""One agent in the test seas of its scenario: what `heave evaluate` prints.

Protocol and metrics are those of `heave compare`, intervals over seas and trainings those of `heave league`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from experiments.compare import (
    AGENT_PREFIX,
    FILE_PREFIX,
    ZOO_PREFIX,
    check_contest,
    controller_names,
    controller_of,
    entry_of,
    labels_of,
    protocol_duration,
    run_contest,
    trainings_of,
)
from experiments.leaderboard import Cell, Quantity, quantities
from experiments.league import cell_of
from experiments.results import Entry
from experiments.rollout import FIRST_TEST_SEED, with_duration
from heave_env import scenarios
from heave_env.parameters import name_hint
from heave_env.scenarios import Scenario

SHOWN = (
    "cost",
    "cost_over_oracle",
    "payload_heave_std",
    "payload_heave_max",
    "control_energy",
    "saturation_fraction",
    "winch_work",
    "supply_energy",
    "tension_peak",
    "tension_p999",
    "tension_min",
    "slack_fraction",
    "touch_down_speed",
)
"""Metrics that are shown, in this order, where a scenario has them."""
WHOLE = "agent"
"""What the contestant is called in its cell."""


@dataclass(frozen=True)
class Evaluation:
    """What an agent did in the seas of a scenario."""

    spec: str
    seeds: range
    cell: Cell

    @property
    def trainings(self) -> tuple[str, ...]:
        """A name for each training; of a designed controller one, that is empty."""
        return self.cell.results[WHOLE].trainings

    def quantities(self, training: int | None = None) -> dict[str, Quantity]:
        """Every number by its name, as `experiments.leaderboard` has them; of all trainings, or of one."""
        result = self.cell.results[WHOLE]
        chosen = None if training is None else result.training(training)
        return quantities(self.cell, WHOLE, WHOLE, chosen)


def spec_of(text: str) -> str:
    """What is to be evaluated: a design, `zoo:NAME`, `file:PATH.py`, `agent:RUN` or a run's folder alone.

    Raises:
        ValueError: If it is none of these.
    """
    known = controller_names()
    if text.startswith((AGENT_PREFIX, ZOO_PREFIX, FILE_PREFIX)) or text in known:
        return text
    if Path(text).exists():
        return AGENT_PREFIX + text
    hint = name_hint(text, known, "give zoo:NAME, a run folder that heave train has written, or a design")
    raise ValueError(f"there is no agent {text!r}; {hint}")


def home_of(spec: str) -> Scenario:
    """The scenario that an agent was trained in, by its name where it is one as registered.

    Raises:
        ValueError: If it was trained in none, or cannot be loaded.
    """
    if not spec.startswith((AGENT_PREFIX, ZOO_PREFIX)):
        raise ValueError(f"{spec!r} has no scenario of its own; name one with --scenario")
    if spec.startswith(ZOO_PREFIX):
        from agents.zoo import load_agent

        policy = load_agent(spec)
    else:
        from agents.policy import load_policy

        policy = load_policy(spec.removeprefix(AGENT_PREFIX))
    name = policy.scenario.name
    if name in scenarios.names():
        registered = scenarios.load(name)
        try:
            controller_of(spec, registered)
        except ValueError:
            return policy.scenario  # changed with --set, or since
        return registered
    return policy.scenario


def evaluate(
    text: str,
    *,
    scenario: Scenario | None = None,
    n_seeds: int,
    first_seed: int = FIRST_TEST_SEED,
    duration: float | None = None,
    warm_up: float | None = None,
    dtype: str = "float64",
    allow_other_scenario: bool = False,
    progress: Callable[[str, str, int, int], None] | None = None,
) -> Evaluation:
    """Lets an agent act in the first test seas of its scenario and scores it.

    Args:
        text: As `spec_of` reads it.
        scenario: Where it is to act, a variant say; None: the scenario that it was trained in.
        n_seeds: Number of seas.
        first_seed: Seed of the first of them.
        duration: Length of the episodes [s]; None: the scenario's, but no more than the protocol needs.
        warm_up: Time left out at the start [s]; None: the protocol's.
        dtype: Precision of the plant.
        allow_other_scenario: Whether an agent may act in a scenario it was not trained for.
        progress: Called with scenario, label, steps done since the last call and steps in all.

    Raises:
        ValueError: If anything asked for is impossible.
    """
    spec = spec_of(text)
    place = home_of(spec) if scenario is None else scenario
    check_contest([place], n_seeds)
    specs = trainings_of(spec)
    labels = labels_of(specs)
    entries = [
        entry_of(labels[part], part, place, allow_other_scenario=allow_other_scenario) for part in specs
    ]
    seeds = range(first_seed, first_seed + n_seeds)
    timed = with_duration(place, protocol_duration(place) if duration is None else duration)
    cell = contested(timed, {WHOLE: entries}, seeds, warm_up=warm_up, dtype=dtype, progress=progress)
    return Evaluation(spec, seeds, cell)


def contested(
    place: Scenario,
    entries_of: dict[str, list[Entry]],
    seeds: Sequence[int],
    *,
    warm_up: float | None = None,
    dtype: str = "float64",
    oracle: bool = False,
    folder: Path | None = None,
    progress: Callable[[str, str, int, int], None] | None = None,
) -> Cell:
    """What contestants do in the same seas of one scenario, of the duration that is wanted.

    Args:
        place: The scenario.
        entries_of: The entries of each contestant, one for each training.
        seeds: One seed per sea.
        warm_up: Time left out at the start [s]; None: the protocol's.
        dtype: Precision of the plant.
        oracle: Whether those run too who know what each episode draws.
        folder: Where each part is kept as it is finished, and taken from; None: nowhere.
        progress: Called with scenario, label, steps done since the last call and steps in all.
    """

    def report(label: str, count: int) -> None:
        if progress is not None:
            progress(place.name, label, count, place.n_steps * len(seeds))

    contest = run_contest(
        place,
        [entry for entries in entries_of.values() for entry in entries],
        seeds,
        warm_up=warm_up,
        dtype=dtype,
        oracle=oracle,
        n_stored=0,
        folder=folder,
        progress=report,
    )
    return cell_of(place.name.partition("@")[0], place, entries_of, contest)
