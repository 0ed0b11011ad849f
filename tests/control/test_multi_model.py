"""The bank of Kalman filters: alone it is LQG, it finds out which model is right, and that pays."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from baselines import design
from baselines.lqg import lqg
from baselines.multi_model import bank_scenarios, multi_model
from heave_env.parameters import Draw
from heave_env.plant import Plant
from heave_env.scenarios import Scenario, load

TEST_SEA = 20_000_000


def uncertain(*draws: Draw) -> Scenario:
    return dataclasses.replace(load("unknown_linear"), uncertainty=draws)


INERTIA = Draw(parameter="linear_payload.inertia", low=0.5, high=1.4)
LAG = Draw(parameter="winch.time_constant", low=0.5, high=2.0)


def driven(scenario: Scenario, controller, seeds: list[int], n_steps: int, first: int = 0):
    """Mean stage cost of each row from step `first` on, the commands given, and the last memory."""
    plant = Plant(scenario, len(seeds))
    plant.begin(np.ones(len(seeds), dtype=bool), np.array(seeds))
    memory, cost, actions = None, np.zeros(len(seeds)), []
    for step in range(n_steps):
        action, memory = controller.predict(plant.observation, memory)
        plant.advance(action[:, 0].astype(float))
        actions.append(action[:, 0])
        cost -= plant.reward if step >= first else 0.0
    return cost / (n_steps - first), np.array(actions), memory


@pytest.mark.parametrize("name", ["thesis_linear", "unknown_linear"])
def test_a_bank_of_one_is_lqg(name):
    scenario = dataclasses.replace(load(name), uncertainty=())
    seeds = [TEST_SEA, TEST_SEA + 1]
    ours = driven(scenario, multi_model(scenario), seeds, 300)[1]
    theirs = driven(scenario, lqg(scenario), seeds, 300)[1]
    assert np.array_equal(ours, theirs)


def test_the_model_that_is_right_gets_the_weight():
    scenario = uncertain(INERTIA, LAG)
    bank = multi_model(scenario, n_members=8)
    # The plant is the sixth member: draws without width put it there.
    right = bank_scenarios(scenario, 8)[5]
    values = (right.linear_payload.inertia, right.winch.time_constant)
    plant = uncertain(
        *(
            dataclasses.replace(draw, low=value, high=value)
            for draw, value in zip((INERTIA, LAG), values, strict=True)
        )
    )
    memory = driven(plant, bank, [TEST_SEA + i for i in range(4)], 600)[2]
    weights = bank.weights(memory)
    assert weights.sum(axis=1) == pytest.approx(1.0)
    assert weights[:, 5].min() > 0.99


def test_it_begins_with_no_opinion():
    bank = multi_model(uncertain(INERTIA), n_members=8)
    assert bank.weights(np.zeros((2, bank.n_memory))) == pytest.approx(1.0 / 8.0)


def test_points_of_the_bank_are_balanced():
    inertias = [variant.linear_payload.inertia for variant in bank_scenarios(uncertain(INERTIA), 64)]
    # The first is the scenario itself; each quarter of the range has a quarter of the others.
    counts = np.histogram(inertias[1:], bins=4, range=(0.5, 1.4))[0]
    assert inertias[0] == 0.8959
    assert counts.min() >= 15 and counts.max() <= 16


@pytest.mark.slow
def test_it_pays_where_parameters_are_unknown():
    # The oracle is LQG designed for what each episode drew. `pytest -s` prints the ratios.
    scenario = load("unknown_linear")
    seeds = [TEST_SEA + i for i in range(32)]
    ours, _, _ = driven(scenario, design("multi_model", scenario), seeds, 4000, 1000)
    fixed, _, _ = driven(scenario, design("lqg", scenario), seeds, 4000, 1000)
    plant = Plant(scenario, len(seeds))
    plant.begin(np.ones(len(seeds), dtype=bool), np.array(seeds))
    names = [draw.parameter for draw in scenario.uncertainty]
    oracle = np.empty(len(seeds))
    for i, (seed, drawn) in enumerate(zip(seeds, plant.drawn, strict=True)):
        known = scenario.with_drawn(dict(zip(names, drawn, strict=True)))
        oracle[i] = driven(known, lqg(known), [seed], 4000, 1000)[0][0]
    ratios = ours / oracle
    print(
        f"\nmulti_model {ours.mean():.4f}, fixed lqg {fixed.mean():.4f}, oracle {oracle.mean():.4f}; "
        f"multi_model over oracle: mean {ours.mean() / oracle.mean():.3f}, median {np.median(ratios):.3f}, "
        f"largest {ratios.max():.3f}"
    )
    assert ours.mean() < 0.5 * fixed.mean()
    # Of 128 models none is the right one in eight dimensions: 1.18 of the oracle in the mean.
    assert ours.mean() < 1.3 * oracle.mean()
