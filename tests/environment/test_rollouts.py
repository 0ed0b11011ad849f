"""Many steps in one compiled call are the same steps, whoever acts."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from heave_env.kernel import LOST, RUNNING
from heave_env.layout import CHANNEL_NAMES
from heave_env.marching import bounded_tanh
from heave_env.plant import Plant
from heave_env.rollouts import Rollouts, TanhPolicy, n_parameters, rollout
from heave_env.scenarios import Scenario, load

SEEDS = 30
CABLE = dataclasses.replace(load("sea_state_5"), n_elements=6)
CHANNELS = ("payload_heave", "sheave_tension", "winch_displacement", "tension_min")


def begun(scenario: Scenario, n_envs: int, **options) -> Plant:
    plant = Plant(scenario, n_envs, **options)
    plant.begin(np.ones(n_envs, dtype=bool), np.arange(SEEDS, SEEDS + n_envs))
    return plant


def stepped(plant: Plant, act, n_steps: int) -> dict[str, np.ndarray]:
    """The same by single steps in Python: costs, and channels at every instant."""
    rewards, channels = [], [plant.channels.copy()]
    for step in range(n_steps):
        plant.advance(act(step))
        rewards.append(plant.reward.copy())
        channels.append(plant.channels.copy())
    record = np.array(channels)
    return {
        "stage_cost": -np.array(rewards),
        **{name: record[:, :, CHANNEL_NAMES.index(name)] for name in CHANNEL_NAMES},
    }


@pytest.mark.parametrize(
    ("n_envs", "options"),
    [(1, {}), (37, {}), (37, {"dtype": "float32"}), (150, {"n_threads": 2})],
    ids=["single", "batch", "float32", "threads"],
)
def test_an_open_loop_is_the_same_as_stepping_bit_for_bit(n_envs, options):
    n_steps, n_settling = 60, 20
    actions = np.random.default_rng(0).uniform(-1.1, 1.1, (n_steps, n_envs))
    plant, other = begun(CABLE, n_envs, **options), begun(CABLE, n_envs, **options)
    found = rollout(plant, actions, n_settling=n_settling, channels=CHANNELS)
    steps = stepped(other, lambda step: actions[step], n_steps)
    for name in CHANNELS:
        assert np.array_equal(found.channels[name], steps[name])
    counted = {name: values[1 + n_settling :] for name, values in steps.items()}
    costs = steps["stage_cost"][n_settling:]
    # A cost is a sum in the order of the steps, as is this one.
    assert np.array_equal(found.mean_cost, np.cumsum(costs, axis=0)[-1] / len(costs))
    assert found.position_cost == pytest.approx(counted["position_cost"].mean(axis=0), rel=1e-12)
    assert found.command_cost == pytest.approx(counted["command_cost"].mean(axis=0), rel=1e-12)
    assert found.safety_cost == pytest.approx(counted["cost"].mean(axis=0), rel=1e-12)
    assert np.array_equal(found.tension_min, counted["tension_min"].min(axis=0))
    assert np.array_equal(found.tension_max, counted["tension_max"].max(axis=0))
    assert np.array_equal(found.payload_heave_peak, np.abs(counted["payload_heave"]).max(axis=0))
    assert found.n_steps.tolist() == [n_steps] * n_envs and not found.diverged.any()
    # And the plants stand at the same place, ready to go on.
    mine, theirs = plant.get_state(), other.get_state()
    assert mine["position"] == theirs["position"]
    assert np.array_equal(plant.observation, other.observation)
    for each in (plant, other):
        each.advance(np.zeros(n_envs))
        each.close()
    assert np.array_equal(plant.observation, other.observation)


@pytest.mark.parametrize("hidden", [(), (5,), (7, 3)], ids=["linear", "one layer", "two layers"])
@pytest.mark.parametrize("n_policies", [1, 21])
def test_a_policy_acts_as_its_twin_in_python_does(hidden, n_policies):
    n_steps, n_envs = 80, 21
    plant, other = begun(CABLE, n_envs), begun(CABLE, n_envs)
    widths = (plant.observation.shape[1], *hidden, 1)
    drawn = np.random.default_rng(1).normal(0.0, 0.4, (n_policies, n_parameters(widths)))
    policy = TanhPolicy(drawn, widths)
    found = rollout(plant, policy, n_steps, channels=CHANNELS)
    steps = stepped(other, lambda step: policy.predict(other.observation)[0][:, 0].astype(float), n_steps)
    # Actions agree to a few roundings of float32; the plant, stable, does not blow that up.
    for name in ("payload_heave", "winch_displacement"):
        assert found.channels[name] == pytest.approx(steps[name], abs=1e-5)
    assert found.mean_cost == pytest.approx(steps["stage_cost"].mean(axis=0), rel=1e-4)
    assert found.tension_max == pytest.approx(steps["tension_max"][1:].max(axis=0), rel=1e-5)
    assert np.ptp(found.channels["winch_displacement"][-1]) > 0.1


def test_each_row_has_its_own_policy_whatever_the_batch():
    scenario = load("limits_linear")
    gains = np.random.default_rng(2).normal(0.0, 0.5, (40, len(scenario.observation_names)))
    whole = rollout(begun(scenario, 40), TanhPolicy.linear(gains), 50)
    plant = Plant(scenario, 3)
    plant.begin(np.ones(3, dtype=bool), np.array([SEEDS + 7, SEEDS + 38, SEEDS + 7]))
    some = rollout(plant, TanhPolicy.linear(gains[[7, 38, 0]]), 50)
    assert np.array_equal(some.mean_cost[:2], whole.mean_cost[[7, 38]])
    assert some.mean_cost[2] != some.mean_cost[0]
    assert np.isnan(some.tension_max).all()
    twice = TanhPolicy.linear(gains[:2], bias=[0.1, 0.2]).repeated(2)
    assert twice.parameters[:, 0] == pytest.approx([0.1, 0.1, 0.2, 0.2])


def test_a_row_that_is_lost_is_charged_once_and_counts_no_further():
    # The rope bears the hanging load and hardly more.
    weakest = 1.005 * CABLE.static_tension
    scenario = dataclasses.replace(
        CABLE, cable=dataclasses.replace(CABLE.cable, breaking_strength=weakest), duration=20.0
    )
    n_envs, n_steps = 20, 200
    actions = np.random.default_rng(3).uniform(-1.0, 1.0, (n_steps, n_envs))
    found = rollout(begun(scenario, n_envs), actions)
    plant = begun(scenario, n_envs)
    total, made, outcome = np.zeros(n_envs), np.zeros(n_envs, dtype=int), np.zeros(n_envs, dtype=int)
    for step in range(n_steps):
        plant.advance(actions[step])
        running = outcome == RUNNING
        total[running] -= plant.reward[running]
        made += running
        outcome[running] = plant.outcome[running]
    assert np.array_equal(found.outcome, outcome) and np.array_equal(found.n_steps, made)
    assert (outcome == LOST).any()
    assert found.mean_cost == pytest.approx(total / n_steps, rel=1e-12)
    assert np.array_equal(found.failure_cost > 0.0, outcome == LOST)
    late = rollout(begun(scenario, n_envs), actions, n_settling=n_steps - 1)
    assert np.array_equal(late.failure_cost > 0.0, outcome == LOST)


def test_tanh_is_tanh():
    x = np.linspace(-12.0, 12.0, 4001).astype(np.float32)
    found = np.array([bounded_tanh(value) for value in x])
    assert found == pytest.approx(np.tanh(x.astype(float)), rel=4e-7)


@pytest.mark.parametrize(
    ("acting", "options", "complaint"),
    [
        (np.zeros((5, 3)), {}, r"actions must have shape \(n_steps, 2\), got \(5, 3\)"),
        (np.zeros((5, 2)), {"n_steps": 4}, r"actions must have shape \(4, 2\)"),
        (np.full((5, 2), np.nan), {}, "finite numbers"),
        (np.zeros((5, 2)), {"channels": ["payload_heav"]}, "channels must be among"),
        (np.zeros((5, 2)), {"n_settling": 5}, "n_settling from 0 to below"),
        (TanhPolicy.linear(np.zeros(3)), {}, r"widths\[0\] must be 6"),
        (TanhPolicy.linear(np.zeros((4, 6))), {}, "one policy, or one for each of 2 rows, got 4"),
    ],
)
def test_bad_arguments_are_refused_in_a_sentence(acting, options, complaint):
    with pytest.raises(ValueError, match=complaint):
        rollout(begun(load("limits_linear"), 2), acting, **options)


def test_bad_policies_are_refused():
    with pytest.raises(ValueError, match="the last 1"):
        TanhPolicy(np.zeros((1, 8)), (3, 2))
    with pytest.raises(ValueError, match=r"shape \(n_policies, 4\)"):
        TanhPolicy(np.zeros((1, 5)), (3, 1))
    with pytest.raises(ValueError, match="finite"):
        TanhPolicy.linear([np.inf, 0.0])


def searched(
    scenario: Scenario, seeds: np.ndarray, rounds: int, n_policies: int = 64
) -> tuple[TanhPolicy, list[float]]:
    """A linear feedback by the cross-entropy method: draw, keep the best eighth, draw around them."""
    rng = np.random.default_rng(0)
    n = len(scenario.observation_names)
    mean, spread, costs = np.zeros(n), np.full(n, 0.5), []
    n_rows = n_policies * len(seeds)
    plant = Plant(scenario, n_rows, dtype="float32")
    for _ in range(rounds):
        gains = rng.normal(mean, spread, (n_policies, n))
        plant.begin(np.ones(n_rows, dtype=bool), np.tile(seeds, n_policies))
        found: Rollouts = rollout(plant, TanhPolicy.linear(gains).repeated(len(seeds)), n_settling=200)
        cost = found.mean_cost.reshape(n_policies, -1).mean(axis=1)
        best = gains[np.argsort(cost)[: n_policies // 8]]
        mean, spread = best.mean(axis=0), best.std(axis=0) + 0.01
        costs.append(float(np.sort(cost)[: n_policies // 8].mean()))
    return TanhPolicy.linear(mean), costs


@pytest.mark.slow
def test_a_search_finds_a_good_linear_feedback():
    scenario = dataclasses.replace(load("limits_linear"), duration=100.0)
    policy, costs = searched(scenario, np.arange(8), rounds=30)
    seas = 64
    plant = Plant(scenario, seas)
    cost = []
    for acting in (policy, TanhPolicy.linear(np.zeros(policy.widths[0]))):
        plant.begin(np.ones(seas, dtype=bool), 20_000_000 + np.arange(seas))
        cost.append(float(rollout(plant, acting, n_settling=200).mean_cost.mean()))
    print(f"\nmean cost on {seas} seas not searched on: {cost[0]:.2f}, without control {cost[1]:.2f}")
    assert costs[-1] < costs[0]
    assert cost[0] < 0.5 * cost[1]
