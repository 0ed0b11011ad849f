"""Many models: alone it is LQG, the bank finds out which model is right, the record what none of them is."""

from __future__ import annotations

import dataclasses
import pickle
import time

import numpy as np
import pytest

from baselines import design
from baselines.lqg import lqg
from baselines.multi_model import MultiModel, bank_scenarios, multi_model, multi_model_mpc
from baselines.oracle import oracle
from heave_env.parameters import Draw
from heave_env.plant import Plant
from heave_env.scenarios import Scenario, load

TEST_SEA = 20_000_000


def uncertain(*draws: Draw, name: str = "unknown_linear") -> Scenario:
    return dataclasses.replace(load(name), uncertainty=draws)


INERTIA = Draw(parameter="linear_payload.inertia", low=0.5, high=1.4)
LAG = Draw(parameter="winch.time_constant", low=0.5, high=2.0)


def settled_at(scenario: Scenario, values: dict[str, float]) -> Scenario:
    """The same with draws of no width: every episode has these numbers."""
    draws = tuple(
        dataclasses.replace(draw, low=values[draw.parameter], high=values[draw.parameter])
        for draw in scenario.uncertainty
    )
    return dataclasses.replace(scenario, uncertainty=draws)


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
    bank = multi_model(scenario, n_members=8, refinements=())
    right = bank_scenarios(scenario, 8)[5]
    plant = settled_at(
        scenario,
        {
            "linear_payload.inertia": right.linear_payload.inertia,
            "winch.time_constant": right.winch.time_constant,
        },
    )
    memory = driven(plant, bank, [TEST_SEA + i for i in range(4)], 900)[2]
    weights = bank.weights(memory)
    assert weights.sum(axis=1) == pytest.approx(1.0)
    # Members doubt their winch, so that a neighbour is not ruled out at once.
    assert np.all(weights.argmax(axis=1) == 5)
    assert weights[:, 5].min() > 0.9


@pytest.mark.parametrize("name", ["unknown_linear", "limits_unknown_linear"])
def test_the_record_tells_what_no_member_knows(name):
    scenario = uncertain(INERTIA, LAG, name=name)
    values = {"linear_payload.inertia": 1.23, "winch.time_constant": 0.77}
    controller = multi_model(scenario, n_members=4, refinements=(10.0, 30.0), command_weight=1.0)
    memory = driven(settled_at(scenario, values), controller, [TEST_SEA], 301)[2]
    (found,) = controller.parameters(memory)
    # Half a minute of noisy samples; the nearest of the four members is a quarter off.
    assert found["winch.time_constant"] == pytest.approx(0.77, rel=0.05)
    assert found["linear_payload.inertia"] == pytest.approx(1.23, rel=0.12)


def test_it_begins_with_no_opinion():
    bank = multi_model(uncertain(INERTIA), n_members=8)
    assert bank.weights(np.zeros((2, bank.n_memory))) == pytest.approx(1.0 / 8.0)


def test_points_of_the_bank_are_balanced():
    inertias = [variant.linear_payload.inertia for variant in bank_scenarios(uncertain(INERTIA), 64)]
    # The first is the prior's middle; each quarter of the range has a quarter of the others.
    counts = np.histogram(inertias[1:], bins=4, range=(0.5, 1.4))[0]
    assert inertias[0] == pytest.approx(0.95)
    assert counts.min() >= 15 and counts.max() <= 16


SHORT = {"n_members": 4, "refinements": (1.0, 2.0)}


@pytest.mark.parametrize(
    ("name", "make"), [("unknown_linear", multi_model), ("limits_unknown_linear", multi_model_mpc)]
)
def test_memory_goes_in_and_comes_out(name, make):
    scenario = uncertain(INERTIA, LAG, name=name)
    seeds = [TEST_SEA, TEST_SEA + 1]
    controller: MultiModel = make(scenario, **SHORT)
    _, together, memory = driven(scenario, controller, seeds, 30)
    # A row alone does what it does in a batch, and another time the same.
    assert np.array_equal(driven(scenario, controller, seeds, 30)[1], together)
    alone = driven(scenario, controller, seeds[1:], 30)[1]
    assert alone[:, 0] == pytest.approx(together[:, 1], abs=1e-6)
    # A copy that has designed nothing yet goes on from the memory; what went in is left as it was.
    observation = np.full((2, len(scenario.observation_names)), 0.1)
    copy, kept = pickle.loads(pickle.dumps(controller)), memory.copy()
    action, following = controller.predict(observation, memory)
    again, same = copy.predict(observation, memory)
    assert np.array_equal(action, again) and np.array_equal(following, same)
    assert np.array_equal(memory, kept)
    # A row that begins afresh knows nothing of the episode before.
    fresh, _ = controller.predict(observation, memory, np.array([True, False]))
    first, _ = controller.predict(observation[:1])
    assert fresh[0, 0] == pytest.approx(first[0, 0], abs=1e-6) and fresh[1, 0] == action[1, 0]


def test_without_limits_the_plan_of_the_likeliest_is_its_gain():
    scenario = uncertain(INERTIA, LAG)
    planned = driven(scenario, multi_model_mpc(scenario, **SHORT), [TEST_SEA], 60)[1]
    gained = driven(scenario, multi_model(scenario, **SHORT), [TEST_SEA], 60)[1]
    # From the first refinement both have one model, though from commands that were not the same before.
    assert planned[40:] == pytest.approx(gained[40:], abs=0.02)


def test_a_plant_that_is_not_linear_keeps_its_bank():
    scenario = dataclasses.replace(
        load("sea_state_5"), uncertainty=(Draw(parameter="winch.time_constant", low=0.8, high=1.25),)
    )
    controller = multi_model(scenario, n_members=2, command_weight=100.0)
    assert controller.refinements == () and len(controller.members) == 2


def test_who_sees_the_whole_state_has_a_bank_too():
    scenario = dataclasses.replace(uncertain(INERTIA, LAG), information_set="full_state")
    controller = multi_model(scenario, n_members=2)
    assert "filter_state_0" in controller.measures and controller.refinements == ()
    action, _ = controller.predict(np.full((2, len(scenario.observation_names)), 0.1))
    assert np.all(np.isfinite(action)) and action[0, 0] != 0.0


def test_bad_input_is_refused():
    scenario = load("unknown_linear")
    with pytest.raises(ValueError, match="n_members must be a whole number"):
        multi_model(scenario, n_members=0)
    with pytest.raises(ValueError, match="refinements must be increasing"):
        multi_model(scenario, refinements=(20.0, 10.0))
    with pytest.raises(ValueError, match="command_weight must be a positive number"):
        multi_model_mpc(scenario, command_weight=-1.0)


def against_the_oracle(
    name: str, designs: tuple[str, ...], yardstick: str, n_seas: int
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Cost of each design, and of an oracle, in each sea; prints their ratios."""
    scenario = load(name)
    seeds = [TEST_SEA + i for i in range(n_seas)]
    least = driven(scenario, oracle(scenario, seeds, design=yardstick), seeds, 4000, 1000)[0]
    costs = {}
    print(f"\n{name}, {n_seas} seas: {yardstick} {least.mean():.4f}")
    for each in designs:
        made = oracle(scenario, seeds) if each == "oracle" else design(each, scenario)
        costs[each] = driven(scenario, made, seeds, 4000, 1000)[0]
        ratio = costs[each] / least
        error = np.std(costs[each] - least, ddof=1) / np.sqrt(n_seas) / least.mean()
        print(
            f"{each} {costs[each].mean():.4f}, over {yardstick}: {costs[each].mean() / least.mean():.4f} ± "
            f"{error:.4f}; by sea: mean {ratio.mean():.4f}, median {np.median(ratio):.4f}, "
            f"95 % {np.quantile(ratio, 0.95):.4f}, largest {ratio.max():.4f}"
        )
    return {each: (cost, least) for each, cost in costs.items()}


def excess(cost: np.ndarray, least: np.ndarray) -> tuple[float, float]:
    """Mean cost over the oracle's, less one, and three standard errors of the paired difference."""
    difference = cost - least
    error = np.std(difference, ddof=1) / np.sqrt(len(cost))
    return difference.mean() / least.mean(), 3.0 * error / least.mean()


@pytest.mark.slow
def test_it_is_all_but_the_oracle_where_parameters_are_unknown():
    # The oracle is LQG designed for what each episode drew. `pytest -s` prints the ratios.
    costs = against_the_oracle("unknown_linear", ("multi_model", "lqg"), "oracle", 48)
    beyond, margin = excess(*costs["multi_model"])
    assert beyond + margin < 0.05
    assert costs["multi_model"][0].mean() < 0.5 * costs["lqg"][0].mean()


@pytest.mark.slow
def test_with_limits_the_plan_is_all_but_the_oracles():
    designs = ("multi_model_mpc", "multi_model", "oracle")
    costs = against_the_oracle("limits_unknown_linear", designs, "oracle_mpc", 24)
    beyond, margin = excess(*costs["multi_model_mpc"])
    assert beyond + margin < 0.1
    # What knows the limits beats what is cut short by them, even where that knows the parameters.
    planned, least = costs["multi_model_mpc"]
    for gained in ("multi_model", "oracle"):
        difference = costs[gained][0] - planned
        assert difference.mean() > 3.0 * np.std(difference, ddof=1) / np.sqrt(len(difference))
    assert least.mean() <= planned.mean()


@pytest.mark.slow
def test_a_row_is_refined_at_the_named_instants_alone():
    # What one row's decisions take is printed with `pytest -s`: it is this machine's, and no claim.
    scenario = load("unknown_linear")
    controller = multi_model(scenario)
    plant = Plant(scenario, 1)
    plant.begin(np.ones(1, dtype=bool), np.array([TEST_SEA]))
    memory, times, costly = None, [], []
    for step in range(controller.refinements[-1] + 100):
        began = time.perf_counter()
        action, following = controller.predict(plant.observation, memory)
        times.append(time.perf_counter() - began)
        if (
            memory is not None
            and following[0, controller.places["handed"]] > memory[0, controller.places["handed"]]
        ):
            costly.append(step)
        memory = following
        plant.advance(action[:, 0].astype(float))
    assert tuple(costly) == controller.refinements
    first = controller.refinements[0]
    others = np.delete(times, costly)
    print(
        f"\none row: bank {1e6 * np.mean(others[1:first]):.0f} µs, then "
        f"{1e6 * np.median(others[first:]):.0f} µs; refinements {np.round(np.array(times)[costly], 2)} s"
    )


@pytest.mark.slow
def test_no_member_is_as_good_as_what_the_record_tells():
    # The bank alone, and the best of its members for each sea in hindsight; `pytest -s` prints both.
    scenario = load("unknown_linear")
    seeds = [TEST_SEA + i for i in range(16)]
    least = driven(scenario, oracle(scenario, seeds), seeds, 4000, 1000)[0]
    bank = multi_model(scenario, refinements=())
    cost, _, memory = driven(scenario, bank, seeds, 4000, 1000)
    best = np.full(len(seeds), np.inf)
    for i, member in enumerate(bank.members):
        alone = dataclasses.replace(bank, members=(member,), shares=bank.shares[i : i + 1])
        best = np.fmin(best, driven(scenario, alone, seeds, 4000, 1000)[0])
    print(
        f"\nover the oracle: bank of {len(bank.members)} {cost.mean() / least.mean():.3f}, its best member "
        f"in hindsight {best.mean() / least.mean():.3f}; largest weight at the end at least "
        f"{bank.weights(memory).max(axis=1).min():.3f}"
    )
    assert best.mean() > 1.05 * least.mean()
