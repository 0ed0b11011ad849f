"""What an episode draws: its distribution, its address, and that nothing but the drawn number changes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from heave_env.env import HeaveEnv, HeaveVectorEnv
from heave_env.parameters import Draw
from heave_env.plant import Plant, simulate
from heave_env.scenarios import Scenario, load, read, to_yaml, with_value


def uncertain(scenario: Scenario, **ranges: tuple[float, float]) -> Scenario:
    """The scenario with parameters, dots written as __, drawn uniformly from ranges."""
    draws = tuple(
        Draw(parameter=path.replace("__", "."), low=low, high=high) for path, (low, high) in ranges.items()
    )
    return dataclasses.replace(scenario, uncertainty=draws)


def everything(name: str) -> Scenario:
    return uncertain(
        load(name),
        sea_state__significant_wave_height=(2.0, 4.0),
        sea_state__peak_omega=(0.6, 1.0),
        vessel__natural_omega=(0.3, 0.5),
        winch__time_constant=(0.5, 2.0),
        winch__command_delay=(0.0, 0.4),
        sensors__payload_heave__noise_std=(0.001, 0.01),
    )


@pytest.mark.parametrize(
    ("draw", "quantiles"),
    [
        (Draw(parameter="x", low=2.0, high=4.0), (2.5, 3.0, 3.5)),
        (Draw(parameter="x", low=1.0, high=16.0, distribution="log_uniform"), (2.0, 4.0, 8.0)),
        # A standard normal within two standard deviations: its quartile is at -0.6391 of one.
        (Draw(parameter="x", low=0.0, high=4.0, distribution="normal"), (2.0 - 0.6391, 2.0, 2.0 + 0.6391)),
    ],
)
def test_quantiles_are_those_of_the_distribution(draw, quantiles):
    assert [draw.quantile(share) for share in (0.25, 0.5, 0.75)] == pytest.approx(quantiles, abs=1e-4)
    assert draw.low <= draw.quantile(1e-12) and draw.quantile(1.0 - 1e-12) <= draw.high


def test_draws_fill_their_range():
    plant = Plant(uncertain(load("thesis_linear"), linear_payload__inertia=(0.5, 1.5)), 400)
    plant.begin(np.ones(400, dtype=bool), np.arange(400))
    drawn = plant.drawn[:, 0]
    # Mean and deviation of 400 uniform numbers within 4 standard errors.
    assert drawn.mean() == pytest.approx(1.0, abs=4 * 0.289 / 20)
    assert drawn.std() == pytest.approx(0.2887, abs=0.03)
    assert drawn.min() > 0.5 and drawn.max() < 1.5


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("name", ["thesis_linear", "sea_state_5"])
def test_a_row_of_a_batch_is_the_single_environment(name, dtype):
    scenario = everything(name)
    batch, single = HeaveVectorEnv(scenario, 5, dtype=dtype), HeaveEnv(scenario, dtype=dtype)
    observations, _ = batch.reset(seed=70)
    observation, _ = single.reset(seed=73)
    rng = np.random.default_rng(0)
    for _ in range(40):
        assert np.array_equal(observations[3], observation)
        action = rng.uniform(-0.1, 0.1, (5, 1))
        observations, *_ = batch.step(action)
        observation, *_ = single.step(action[3])


@pytest.mark.parametrize("kind", ["shaping_filter", "random_phase"])
def test_a_range_without_width_is_the_scenario_with_that_number(kind):
    scenario = with_value(load("sea_state_5"), "sea_state.kind", kind)
    values = {
        "sea_state.significant_wave_height": 4.0,
        "vessel.gain": 0.6,
        "winch.time_constant": 0.7,
        "winch.command_delay": 0.3,
        "payload.mass": 90_000.0,
        "length": 700.0,
        "sensors.payload_heave.noise_std": 0.02,
    }
    draws = tuple(Draw(parameter=path, low=value, high=value) for path, value in values.items())
    known = scenario
    for path, value in values.items():
        known = with_value(known, path, value)
    commands = np.sin(0.5 * np.arange(200))
    ours = simulate(
        dataclasses.replace(scenario, uncertainty=draws), seeds=[3, 4], duration=20.0, commands=commands
    )
    theirs = simulate(known, seeds=[3, 4], duration=20.0, commands=commands)
    for channel in ("boom_tip_heave", "payload_heave", "winch_displacement", "sheave_tension"):
        assert np.array_equal(ours[channel], theirs[channel]), channel


def test_drawing_one_number_leaves_the_sea_alone():
    scenario = load("sea_state_5")
    plain = simulate(scenario, seeds=[3], duration=20.0)
    drawn = simulate(uncertain(scenario, payload__mass=(5e4, 6e4)), seeds=[3], duration=20.0)
    assert np.array_equal(plain["boom_tip_heave"], drawn["boom_tip_heave"])
    assert not np.array_equal(plain["payload_heave"], drawn["payload_heave"])


def test_each_episode_draws_anew_and_the_same_seed_draws_the_same():
    plant = Plant(everything("sea_state_5"), 3)
    every = np.ones(3, dtype=bool)
    plant.begin(every, np.array([5, 6, 7]))
    first = plant.drawn.copy()
    plant.begin(every)
    assert (plant.drawn != first).all()
    plant.begin(every, np.array([5, 6, 7]))
    assert np.array_equal(plant.drawn, first)


def test_full_state_shows_what_was_drawn():
    scenario = uncertain(
        load("thesis_linear"), linear_payload__inertia=(0.5, 1.5), winch__command_delay=(0.0, 0.4)
    )
    env = HeaveVectorEnv(scenario, 4, information_set="full_state")
    observations, _ = env.reset(seed=1)
    names = env.scenario.observation_names
    column = names.index("drawn_linear_payload.inertia")
    assert observations[:, column] == pytest.approx(2.0 * (env.plant.drawn[:, 0] - 1.0), abs=1e-6)
    assert names[-4:] == tuple(f"pending_command_{i}" for i in (1, 2, 3, 4))


def test_a_state_carries_what_was_drawn():
    scenario = everything("thesis_linear")
    one, other = HeaveVectorEnv(scenario, 3), HeaveVectorEnv(scenario, 3)
    one.reset(seed=1)
    other.reset(seed=50)
    other.set_state(one.get_state())
    assert np.array_equal(one.plant.drawn, other.plant.drawn)
    action = np.full((3, 1), 0.05)
    for _ in range(10):
        assert np.array_equal(one.step(action)[0], other.step(action)[0])


def test_uncertainty_survives_yaml_and_alters_the_fingerprint(tmp_path):
    scenario = everything("sea_state_5")
    path = tmp_path / "mine.yaml"
    path.write_text(to_yaml(scenario), encoding="utf-8")
    assert read(path) == scenario
    assert scenario.fingerprint != load("sea_state_5").fingerprint
    wider = with_value(scenario, "uncertainty.3.high", 3.0)
    assert wider.uncertainty[3].high == 3.0


@pytest.mark.parametrize(
    ("path", "low", "high", "complaint"),
    [
        ("payload.mass", -1.0, 1e4, "reaches -1.0: Payload.mass must be a positive number"),
        ("payload.weight", 1.0, 2.0, "there is no number 'payload.weight' to draw"),
        ("winch.speed_limit", 0.1, 0.2, "there is no number 'winch.speed_limit' to draw"),
        ("winch.command_range", 1.0, 2.0, "cannot draw 'winch.command_range'"),
        ("task.position_weight", 1.0, 2.0, "cannot draw 'task.position_weight'"),
        ("linear_payload.inertia", 1.0, 2.0, "there is no number 'linear_payload.inertia'"),
    ],
)
def test_impossible_draws_are_refused_in_a_sentence(path, low, high, complaint):
    with pytest.raises(ValueError, match=complaint):
        dataclasses.replace(load("sea_state_5"), uncertainty=(Draw(parameter=path, low=low, high=high),))


def test_a_range_upside_down_is_refused():
    with pytest.raises(ValueError, match=r"Draw.high must be no less than low \(2.0\), got 1.0"):
        Draw(parameter="length", low=2.0, high=1.0)
