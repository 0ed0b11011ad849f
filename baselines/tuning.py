"""Command weights of a design, tuned on training seas where the plant is not the model.

A cable has waves of its own, quadratic drag and perhaps slack and changing length, a winch may have limits:
there a gain from the task's own weights, optimal on the linear model, may drive the plant into a limit cycle
(the thesis's 900 m cable has a second mode at 5.2 rad/s that the second-order model does not know). Beating
such a controller would prove nothing. The design's command weight is therefore raised from the task's own to
the one that costs least on training seas, and a filter's doubt of its model likewise. Where the winch has
limits, `lqg` and `mpc` also get a weight on the winch's speed: it keeps a design that knows no limits from
asking for what they do not allow, and one that knows them from trusting its forecast to the last.

`mpc` takes the doubt of its filter from `lqg` (both have the same filter), and without limits all of its
weights, since it is then the same controller; `mpc_l1` takes all of its weights from `mpc`. `pid` has no
weights: its bandwidth is lowered likewise.

On a linear scenario without limits nothing is tuned: the theory's own weights are best.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from baselines.changing_length import changes_length
from baselines.identification import CALM_SEA
from baselines.linear_controller import LinearController
from baselines.lqg import lqg
from baselines.model import nominal_sea
from baselines.mpc import mpc, mpc_l1
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
"""On a cable, of the choices within this factor of the least cost the one with the largest weight is taken,
then that with the largest doubt [-]: the least may lie on the brink of a limit cycle that other seas set off.
A winch with limits has its weight on the speed against that, and the least is taken."""
SPEED_FACTORS = (0.0, 0.1, 0.3, 1.0, 3.0)
"""Weights of the winch's speed that are tried where it has limits or its work a price, times the position
weight [s²]."""
ENERGY_FACTORS = (1.0, 1.5, 2.0)
"""Multiples of the task's price of work that are tried for `mpc_l1` [-]: its estimate of the coming sea moves
about, and what it would cost to follow that is more than the plan says."""
WEIGHTS_WITH_SPEED = (1.0, 10.0, 100.0)
"""Multiples of the command weight that are tried with each [-]."""
PREDICTIVE_WEIGHTS = ((1.0, 0.3), (1.0, 0.1), (1.0, 1.0), (10.0, 0.3), (1.0, 0.0))
"""Multiples of the command weight [-] and of the position weight [s²] that are tried for `mpc`."""
ESTIMATING = ("lqg", "gain_scheduled", "time_varying_lq")
"""Designs with a filter, whose doubt of its model is tuned too, and a weight of the speed."""
BANDWIDTHS = (1.0, 0.7, 0.5, 0.35, 0.25, 0.18)
"""Shares of the rule's bandwidth (or gain) that are tried for `pid` and `tension_activated` [-]."""
LARGER_BANDWIDTHS = (1.4, 2.0)
"""Those that are tried for `pid` besides [-]: its rule is cautious where a cable's inertia is large."""
WARM_UP = 100.0
"""Seconds that do not count [s]; a quarter of a shorter episode."""
LONGEST = 250.0
"""Seconds simulated at most [s], unless cable is paid out all the while."""

Designer = Callable[..., LinearController]
Choice = tuple[float, float, float]
"""Factor of the command weight [-], factor of the speed weight [s²], doubt of the model [-]."""
_CACHE: dict[tuple[str, str, tuple[tuple[str, Any], ...]], dict[str, float]] = {}


def needs_tuning(scenario: Scenario) -> bool:
    """Whether the plant is more than the linear model, or the cost more than quadratic."""
    return (
        not scenario.is_linear
        or scenario.winch.is_limited
        or bool(scenario.uncertainty)
        or scenario.task.energy_weight > 0.0
    )


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
    plant = Plant(scenario, n_envs)
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
    """Designs a controller with the weights (and doubt of the model) that cost least in training.

    Args:
        name: The design's name, under which its weights are remembered within the process.
        designer: Takes scenario and command_weight; `lqg` and `mpc` also speed_weight and mismatch; `pid` a
            share of its bandwidth instead.
        scenario: The operation.
        options: Passed on to the designer; a weight among them is used as it is, and nothing is tuned.
    """
    if not needs_tuning(scenario) or {"command_weight", "bandwidth"} & set(options):
        return designer(scenario, **options)
    return designer(scenario, **{**tuned_weights(name, designer, scenario, options), **options})


def tuned_weights(
    name: str, designer: Designer, scenario: Scenario, options: dict[str, Any]
) -> dict[str, float]:
    """The options that cost least in training, found once per process."""
    key = (name, scenario.fingerprint, tuple(sorted(options.items())))
    if key not in _CACHE:
        if name in ("mpc", "mpc_l1"):
            _CACHE[key] = _predictive_weights(name, scenario)
        elif name in ("gain_scheduled", "time_varying_lq") and not changes_length(scenario):
            # Where the length stays, both are lqg.
            _CACHE[key] = tuned_weights("lqg", lqg, scenario, {})
        elif name == "multi_model":
            # Each member is what lqg is where its parameters are known.
            _CACHE[key] = tuned_weights("lqg", lqg, scenario.with_drawn({}), {}) if _alone(scenario) else {}
        elif name == "multi_model_mpc":
            _CACHE[key] = tuned_weights("mpc", mpc, scenario.with_drawn({}), {}) if _alone(scenario) else {}
        elif name in ("pid", "tension_activated"):
            _CACHE[key] = _bandwidth(name, designer, scenario, options)
        else:
            _CACHE[key] = _search(name, designer, scenario, options)
    return _CACHE[key]


def _alone(scenario: Scenario) -> bool:
    """Whether one model of a scenario is more than the linear one."""
    return needs_tuning(scenario.with_drawn({}))


def _search(name: str, designer: Designer, scenario: Scenario, options: dict[str, Any]) -> dict[str, float]:
    operation = tuning_scenario(scenario)
    q, r = scenario.task.position_weight, scenario.task.command_weight
    estimates = name in ESTIMATING
    doubts = (
        MISMATCH_FACTORS if estimates and not scenario.is_linear and "mismatch" not in options else (1.0,)
    )
    caution = 1.0 if scenario.is_linear or scenario.winch.is_limited else CAUTION
    costs: dict[Choice, float] = {}

    def weights(choice: Choice) -> dict[str, float]:
        chosen = {"command_weight": choice[0] * r}
        if not estimates:
            return chosen
        return chosen | {"speed_weight": choice[1] * q, "mismatch": choice[2]}

    def attempt(*choice: float) -> None:
        trial = (choice[0], choice[1], choice[2])
        controller = designer(scenario, **{**weights(trial), **options})
        limit = caution * min(costs.values(), default=math.inf)
        costs[trial] = training_cost(operation, controller, limit=limit)

    def best() -> Choice:
        return min(costs, key=lambda trial: costs[trial])

    for factor in WEIGHT_FACTORS:
        for doubt in doubts:
            attempt(factor, 0.0, doubt)
    if (
        estimates
        and (scenario.winch.is_limited or scenario.task.energy_weight > 0.0)
        and "speed_weight" not in options
    ):
        doubt = best()[2]
        for speed in SPEED_FACTORS[1:]:
            for factor in WEIGHTS_WITH_SPEED:
                attempt(factor, speed, doubt)
        for power in (0.5, 0.25):
            factor, speed, doubt = best()
            for neighbour in (speed * 10.0**-power, speed * 10.0**power):
                attempt(factor, neighbour, doubt)
    for power in (0.5, 0.25):
        middle, speed, doubt = best()
        for factor in (middle * 10.0**-power, middle * 10.0**power):
            if factor >= 1.0:
                attempt(factor, speed, doubt)
    enough = caution * min(costs.values())
    return weights(max(trial for trial in costs if costs[trial] <= enough))


def _predictive_weights(name: str, scenario: Scenario) -> dict[str, float]:
    priced = scenario.task.energy_weight > 0.0
    if name == "mpc_l1":
        return _priced_weights(scenario) if priced else tuned_weights("mpc", mpc, scenario, {})
    of_filter = tuned_weights("lqg", lqg, scenario, {})
    if not scenario.winch.is_limited:
        return of_filter
    operation = tuning_scenario(scenario)
    q, r = scenario.task.position_weight, scenario.task.command_weight
    least, chosen = math.inf, dict(of_filter)

    def helps(**changes: float) -> bool:
        nonlocal least, chosen
        trial = chosen | changes
        cost = training_cost(operation, mpc(scenario, **trial), limit=least)
        if cost >= least:
            return False
        least, chosen = cost, trial
        return True

    # At last with the weights of `lqg`, than which it should never be worse.
    own = (of_filter["command_weight"] / r, of_filter["speed_weight"] / q)
    for factor, speed in (*PREDICTIVE_WEIGHTS, own):
        helps(command_weight=factor * r, speed_weight=speed * q)
    gridded = chosen["command_weight"]
    while helps(command_weight=10.0 * chosen["command_weight"]):
        pass
    if chosen["command_weight"] > gridded:
        middle = chosen["command_weight"]
        if not helps(command_weight=10.0**0.5 * middle):
            helps(command_weight=10.0**-0.5 * middle)
    return chosen


def _priced_weights(scenario: Scenario) -> dict[str, float]:
    """Weights of `mpc_l1` where the winch's work has a price."""
    operation = tuning_scenario(scenario)
    q, r, e = scenario.task.position_weight, scenario.task.command_weight, scenario.task.energy_weight
    doubt = tuned_weights("lqg", lqg, scenario, {})["mismatch"]
    least, chosen = math.inf, {"energy_weight": e}
    for factor in ENERGY_FACTORS:
        for command, speed in ((1.0, 0.0), (10.0, 0.0), (1.0, 0.1)):
            trial = {"command_weight": command * r, "speed_weight": speed * q, "mismatch": doubt}
            trial["energy_weight"] = factor * e
            cost = training_cost(operation, mpc_l1(scenario, **trial), limit=least)
            if cost < least:
                least, chosen = cost, trial
    return chosen


def _bandwidth(
    name: str, designer: Designer, scenario: Scenario, options: dict[str, Any]
) -> dict[str, float]:
    operation = tuning_scenario(scenario)
    least, chosen = math.inf, BANDWIDTHS[-1]
    for share in BANDWIDTHS:
        cost = training_cost(operation, designer(scenario, bandwidth=share, **options), limit=least)
        if cost < least:
            least, chosen = cost, share
    # More than the rule's only where that has been the best, and where it is worth the caution.
    for share in LARGER_BANDWIDTHS if name == "pid" and chosen == BANDWIDTHS[0] else ():
        cost = training_cost(operation, designer(scenario, bandwidth=share, **options), limit=least)
        if cost < least / CAUTION:
            least, chosen = cost, share
    return {"bandwidth": chosen}
