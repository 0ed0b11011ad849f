"""What a rollout records is what the environment did."""

from __future__ import annotations

import numpy as np
import pytest

from baselines import design
from experiments.rollout import CABLE_STATE_CHANNELS, STATE_CHANNELS, batches, rollout
from heave_env.controller import NoControl
from heave_env.scenarios import load, with_value

SEEDS = (20_000_000, 20_000_001, 20_000_002)


class Constant:
    """Commands a fraction of the range, and notes what it was shown."""

    def __init__(self, action: float, information_set: str | None = None) -> None:
        self.action, self.width, self.starts = action, 0, []
        self.information_set = information_set

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        self.width = observation.shape[1]
        self.starts.append(episode_start.copy())
        return np.full((len(observation), 1), self.action, dtype=np.float32), state


@pytest.mark.parametrize("name", ["thesis_linear", "sea_state_5"])
def test_costs_are_those_of_the_recorded_motion(name):
    scenario = load(name)
    run = rollout(scenario, design("lqr", scenario), SEEDS, duration=5.0)
    q, r = scenario.task.position_weight, scenario.task.command_weight
    assert run.steps["position_cost"] == pytest.approx(q * run.states["payload_heave"][1:] ** 2, rel=1e-12)
    assert run.steps["command_cost"] == pytest.approx(r * run.steps["command"] ** 2, rel=1e-12)


@pytest.mark.parametrize("name", ["thesis_linear", "sea_state_5"])
def test_channels_are_complete_and_finite(name):
    scenario = load(name)
    run = rollout(scenario, NoControl(), SEEDS, duration=3.0)
    wanted = set(STATE_CHANNELS) | (set() if scenario.is_linear else set(CABLE_STATE_CHANNELS))
    assert set(run.states) == wanted
    assert all(values.shape == (31, 3) for values in run.states.values())
    assert all(values.shape == (30, 3) for values in run.steps.values())
    assert all(np.isfinite(values).all() for values in (run.states | run.steps).values())
    assert run.time[0] == 0.0
    assert run.time[-1] == 3.0
    assert (run.n_valid == 30).all()


def test_a_sea_does_not_feel_its_neighbours():
    scenario = load("sea_state_5")
    together = rollout(scenario, NoControl(), SEEDS, duration=3.0)
    alone = rollout(scenario, NoControl(), SEEDS[1:2], duration=3.0)
    for name, values in alone.states.items():
        assert np.array_equal(values[:, 0], together.states[name][:, 1])


def test_the_sea_is_the_same_for_every_controller():
    scenario = load("sea_state_5")
    calm, busy = (rollout(scenario, c, SEEDS, duration=5.0) for c in (NoControl(), Constant(0.5)))
    assert np.array_equal(calm.states["boom_tip_heave"], busy.states["boom_tip_heave"])
    assert not np.array_equal(calm.states["payload_heave"], busy.states["payload_heave"])


def test_only_the_first_step_begins_an_episode():
    controller = Constant(0.1)
    rollout(load("thesis_linear"), controller, SEEDS, duration=2.0)
    assert controller.starts[0].all()
    assert not np.any(controller.starts[1:])


def test_a_controller_sees_the_information_set_it_asks_for():
    scenario = load("sea_state_5")
    plain, wide = Constant(0.0), Constant(0.0, "sensors_history")
    for controller in (plain, wide):
        rollout(scenario, controller, SEEDS[:1], duration=1.0)
    assert plain.width == len(scenario.observation_names)
    history = with_value(scenario, "information_set", "sensors_history")
    assert wide.width == len(history.observation_names)


def test_a_command_at_the_range_counts_as_saturated():
    scenario = load("thesis_linear")
    assert rollout(scenario, Constant(1.0), SEEDS, duration=1.0).steps["saturated"].all()
    assert not rollout(scenario, Constant(0.5), SEEDS, duration=1.0).steps["saturated"].any()


def test_a_lost_payload_ends_its_sea_alone_and_leaves_no_gap():
    scenario = with_value(load("snap"), "cable.breaking_strength", 26_000.0)
    run = rollout(scenario, NoControl(), SEEDS, duration=30.0)
    assert run.outcomes["lost"].any()
    for sea in np.flatnonzero(run.outcomes["lost"]):
        last = run.n_valid[sea]
        assert 0 < last < run.n_steps
        assert run.steps["failure_cost"][last - 1, sea] > 0.0
        assert run.steps["failure_cost"][:, sea].sum() == run.steps["failure_cost"][last - 1, sea]
        held = run.states["payload_heave"][last:, sea]
        assert (held == held[0]).all()
    assert all(np.isfinite(values).all() for values in (run.states | run.steps).values())


def test_batches_keep_every_seed_in_order():
    scenario = load("sea_state_5")
    seeds = range(1000)
    parts = list(batches(scenario, seeds))
    assert len(parts) > 1
    assert [seed for part in parts for seed in part] == list(seeds)


def test_impossible_arguments_are_refused():
    scenario = load("thesis_linear")
    with pytest.raises(ValueError, match="at least one seed"):
        rollout(scenario, NoControl(), [])
    with pytest.raises(ValueError, match="whole number of control steps"):
        rollout(scenario, NoControl(), SEEDS, duration=1.23)
