"""Command weights of a design, tuned on training seas where the plant is not the model.

A cable has waves of its own, quadratic drag and perhaps slack and changing length, a winch may have limits:
there a gain from the task's own weights, optimal on the linear model, may drive the plant into a limit cycle
(the thesis's 900 m cable has a second mode at 5.2 rad/s that the second-order model does not know). Beating
such a controller would prove nothing. The design's command weight is therefore raised from the task's own to
the one that costs least on training seas, and a filter's doubt of its model likewise.

On a linear scenario without limits nothing is tuned: the theory's own weights are best.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from baselines.identification import CALM_SEA
from baselines.linear_controller import LinearController
from baselines.model import nominal_sea
from heave_env.kernel import DIVERGED, LANDED, LOST
from heave_env.plant import Plant
from heave_env.scenarios import Scenario

TUNING_SEEDS = tuple(range(9_100_000, 9_100_008))
"""Seas that designs are tuned on: in the training range (below 1e7), apart from those of identification."""
WEIGHT_FACTORS = (100.0, 10.0, 1000.0, 1.0, 1e4)
"""Multiples of the task's command weight that are tried first [-], the likeliest first."""
MISMATCH_FACTORS = (1.0, 0.1, 10.0, 0.01, 100.0)
"""Multiples of a filter's doubt of its model that are tried with each [-]."""
CAUTION = 1.15
"""Of the choices within this factor of the least cost, the one with the largest weight is taken, then that
with the largest doubt [-]: the least may lie on the brink of a limit cycle that other seas set off."""
WARM_UP = 100.0
"""Seconds that do not count [s]; a quarter of a shorter episode."""
LONGEST = 250.0
"""Seconds simulated at most [s], unless cable is paid out all the while."""

Designer = Callable[..., LinearController]
_CACHE: dict[tuple[str, str, tuple[tuple[str, Any], ...]], dict[str, float]] = {}


def needs_tuning(scenario: Scenario) -> bool:
    """Whether the plant is more than the linear model."""
    return not scenario.is_linear or scenario.winch.is_limited


def tuning_scenario(scenario: Scenario) -> Scenario:
    """The operation in a sea to tune in: its own, or a random-phase one in place of a record or a calm."""
    duration = scenario.duration if scenario.pay_out.speed else min(scenario.duration, LONGEST)
    sea = scenario.sea_state
    if sea.kind in ("recorded", "calm"):
        sea = replace(nominal_sea(scenario) or CALM_SEA, kind="random_phase")
    n_steps = max(2, round(duration / scenario.control_dt))
    return replace(scenario, sea_state=sea, duration=n_steps * scenario.control_dt)


def training_cost(scenario: Scenario, controller: LinearController, *, limit: float = math.inf) -> float:
    """Average stage cost over the tuning seas after the warm-up [-].

    Infinite if any of them fails, or as soon as the average is sure to exceed `limit`.
    """
    n_envs, n_steps = len(TUNING_SEEDS), scenario.n_steps
    first = min(round(WARM_UP / scenario.control_dt), n_steps // 4)
    plant = Plant(scenario, n_envs, show_channels=False)
    plant.begin(np.ones(n_envs, dtype=bool), np.array(TUNING_SEEDS))
    memory, total = None, 0.0
    running = np.ones(n_envs, dtype=bool)
    for step in range(n_steps):
        action, memory = controller.predict(plant.observation, memory)
        plant.advance(action[:, 0].astype(float))
        if np.any(running & ((plant.outcome == DIVERGED) | (plant.outcome == LOST))):
            return math.inf
        if step >= first:
            total -= float(np.mean(np.where(running, plant.reward, 0.0)))
        # What has landed is done: what it would do next does not count.
        running &= plant.outcome != LANDED
        if total > limit * (n_steps - first):
            return math.inf
    return total / (n_steps - first)


def tuned(name: str, designer: Designer, scenario: Scenario, **options: Any) -> LinearController:
    """Designs a controller with the command weight (and doubt of the model) that costs least in training.

    Args:
        name: The design's name, under which its weights are remembered within the process.
        designer: Takes scenario, command_weight and, for `lqg`, mismatch.
        scenario: The operation.
        options: Passed on to the designer; a command_weight among them is used as it is.
    """
    if not needs_tuning(scenario) or "command_weight" in options:
        return designer(scenario, **options)
    key = (name, scenario.fingerprint, tuple(sorted(options.items())))
    if key not in _CACHE:
        _CACHE[key] = _search(name, designer, scenario, options)
    return designer(scenario, **{**options, **_CACHE[key]})


def _search(name: str, designer: Designer, scenario: Scenario, options: dict[str, Any]) -> dict[str, float]:
    operation = tuning_scenario(scenario)
    own = scenario.task.command_weight
    doubts = MISMATCH_FACTORS if name == "lqg" and "mismatch" not in options else (None,)
    costs: dict[tuple[float, float | None], float] = {}

    def attempt(factor: float, doubt: float | None) -> None:
        trial = _choice(factor * own, doubt)
        controller = designer(scenario, **{**options, **trial})
        limit = CAUTION * min(costs.values(), default=math.inf)
        costs[factor, doubt] = training_cost(operation, controller, limit=limit)

    for factor in WEIGHT_FACTORS:
        for doubt in doubts:
            attempt(factor, doubt)
    for power in (0.5, 0.25):
        middle, doubt = min(costs, key=lambda trial: costs[trial])
        for factor in (middle * 10.0**-power, middle * 10.0**power):
            if factor >= 1.0:
                attempt(factor, doubt)
    enough = CAUTION * min(costs.values())
    factor, doubt = max(
        (trial for trial in costs if costs[trial] <= enough), key=lambda t: (t[0], t[1] or 0.0)
    )
    return _choice(factor * own, doubt)


def _choice(command_weight: float, doubt: float | None) -> dict[str, float]:
    return {"command_weight": command_weight} | ({} if doubt is None else {"mismatch": doubt})
