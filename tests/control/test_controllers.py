"""Every designed controller keeps the controllers' contract on every named scenario."""

import copy
import pickle
import re
from dataclasses import replace

import numpy as np
import pytest

from baselines import DESIGNERS, design
from heave_env.scenarios import load, names, with_value
from heave_env.sensors import Sensor

SCENARIOS = names()
WEIGHTED = ("lqr", "delay_lqr", "lqg", "gain_scheduled", "time_varying_lq", "mpc", "mpc_l1")
CABLE_ONLY = ("tension_activated",)
"""Designs that a linear payload has nothing to measure for."""
LINEAR_KINDS = [kind for kind in DESIGNERS if kind not in CABLE_ONLY]
BOOM_TIP = (Sensor(channel="boom_tip_heave"), Sensor(channel="boom_tip_heave_rate"))
THESIS = replace(load("thesis_linear"), sensors=(*load("thesis_linear").sensors, *BOOM_TIP))
"""The thesis's linear world, its boom tip measured too: every controller can act in it."""
DELAYED = with_value(THESIS, "winch.command_delay", 0.2)


def made(kind, scenario):
    """A design with weights of its own (tuning is tested apart), or None if a sensor is missing."""
    options = {"command_weight": 100.0 * scenario.task.command_weight} if kind in WEIGHTED else {}
    options |= {"bandwidth": 0.5} if kind in ("pid", "tension_activated") else {}
    options |= {"n_members": 4} if kind.startswith("multi_model") else {}
    try:
        return DESIGNERS[kind](scenario, **options)
    except ValueError as error:
        # The sentence names what is missing and what to do.
        assert re.search("needs .* measured|does not measure the boom tip", str(error)), error
        assert "add" in str(error)
        return None


def controllers(name):
    """The designs that a scenario has the sensors for."""
    found = [made(kind, load(name)) for kind in DESIGNERS]
    return [controller for controller in found if controller is not None]


def observations(scenario, n_envs, seed=0):
    return (
        np.random.default_rng(seed).normal(size=(n_envs, len(scenario.observation_names))).astype(np.float32)
    )


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_batch_is_its_rows_and_actions_stay_in_range(name):
    scenario = load(name)
    for controller in controllers(name):
        batch, memory = observations(scenario, 4), None
        alone = [None] * 4
        for step in range(3):
            action, memory = controller.predict(batch, memory)
            assert action.shape == (4, 1)
            assert action.dtype == np.float32
            assert np.all(np.abs(action) <= 1.0)
            for i in range(4):
                single, alone[i] = controller.predict(batch[i], alone[i])
                assert single.shape == (1,)
                # Matrix products of one row and of four may round differently.
                assert single == pytest.approx(action[i], abs=1e-5), (controller.name, step)


@pytest.mark.parametrize("kind", LINEAR_KINDS)
@pytest.mark.parametrize("name", ["thesis", "delayed", "limits"])
def test_rows_that_begin_forget_and_the_others_do_not(name, kind):
    scenario = {"thesis": THESIS, "delayed": DELAYED, "limits": load("limits_linear")}[name]
    controller = made(kind, scenario)
    first, second = observations(scenario, 3, seed=1), observations(scenario, 3, seed=2)
    _, memory = controller.predict(0.01 * first)
    kept = copy.deepcopy(memory)
    going_on, _ = controller.predict(0.01 * second, memory, np.zeros(3, dtype=bool))
    mixed, _ = controller.predict(0.01 * second, memory, np.array([False, True, False]))
    fresh, _ = controller.predict(0.01 * second)
    assert mixed[[0, 2]] == pytest.approx(going_on[[0, 2]], abs=1e-6)
    assert mixed[1] == pytest.approx(fresh[1], abs=1e-6)
    if memory is not None:
        # Nobody writes into the memory that was handed over.
        assert np.array_equal(memory, kept)
        assert not np.allclose(going_on, fresh)


@pytest.mark.parametrize("kind", ["none", *LINEAR_KINDS])
def test_controllers_pickle_name_themselves_and_say_what_they_measure(kind):
    scenario = THESIS
    controller = design(kind, scenario)
    assert controller.name == kind
    assert set(controller.measures) <= set(scenario.observation_names)
    revived = pickle.loads(pickle.dumps(controller))
    batch = observations(scenario, 2)
    assert np.array_equal(revived.predict(batch)[0], controller.predict(batch)[0])
    # Once more, after the first use has filled whatever is made when needed.
    assert np.array_equal(pickle.loads(pickle.dumps(controller)).predict(batch)[0], revived.predict(batch)[0])


def test_the_regulator_reads_si_units_through_scale_and_offset():
    scenario = load("thesis_regulator")
    sensors = tuple(
        replace(sensor, scale=scale, offset=offset)
        for sensor, scale, offset in zip(scenario.sensors, (2.0, 0.5, 4.0), (0.1, -0.2, 0.3), strict=True)
    )
    scenario = replace(scenario, sensors=sensors)
    controller = design("lqr", scenario)
    state = np.array([0.02, -0.01, 0.03])
    scaled = (state - [0.1, -0.2, 0.3]) / [2.0, 0.5, 4.0]
    action, _ = controller.predict(scaled.astype(np.float32))
    assert action[0] == pytest.approx(-(controller.gain @ state).item() / 16.0, rel=1e-4)


def test_saturation_clips_the_command_and_the_memory_knows_it():
    scenario = load("thesis_linear")
    controller = design("lqr", scenario)
    far = np.full((1, 2), 40.0, dtype=np.float32)
    action, memory = controller.predict(far)
    assert action == -1.0
    # The modelled winch follows the clipped command: 2 m (1 - exp(-0.1)).
    assert memory[0, 0] == pytest.approx(-2.0 * (1.0 - np.exp(-0.1)))


def test_an_observation_of_another_scenario_is_refused_with_a_sentence():
    controller = design("lqr", load("thesis_linear"))
    with pytest.raises(ValueError, match="expects observations of 2 entries, got 5"):
        controller.predict(np.zeros((3, 5), dtype=np.float32))


def test_unknown_names_and_impossible_weights_are_refused_with_a_sentence():
    scenario = load("thesis_linear")
    with pytest.raises(
        ValueError, match="unknown controller 'lqi'; known: none, pid, lqr, delay_lqr, feedforward, "
    ):
        design("lqi", scenario)
    for weight in (0.0, -1.0, np.nan):
        for kind in WEIGHTED:
            with pytest.raises(ValueError, match="command_weight must be a positive number"):
                design(kind, scenario, command_weight=weight)
        with pytest.raises(ValueError, match="bandwidth must be a positive number"):
            design("pid", scenario, bandwidth=weight)
    for kind in ("lqg", "mpc", "mpc_l1"):
        with pytest.raises(ValueError, match="speed_weight must be a number, not negative"):
            design(kind, scenario, command_weight=1.0, speed_weight=-1.0)
    with pytest.raises(ValueError, match="energy_weight must be a number, not negative"):
        design("mpc_l1", scenario, command_weight=1.0, energy_weight=-1.0)
    with pytest.raises(ValueError, match="aim of feedforward_prediction must be one of middle, end"):
        design("feedforward_prediction", THESIS, aim="start")


@pytest.mark.parametrize("kind", LINEAR_KINDS)
@pytest.mark.parametrize("information_set", ["full_state", "sensors", "sensors_history"])
def test_every_information_set_can_be_driven(kind, information_set):
    scenario = with_value(THESIS, "information_set", information_set)
    scenario = with_value(scenario, "winch.command_delay", 0.25)
    action, _ = design(kind, scenario).predict(observations(scenario, 2))
    assert np.all(np.isfinite(action))


@pytest.mark.parametrize("kind", ["feedforward_prediction", "feedforward_peaks", "lqg", "mpc", "mpc_l1"])
def test_who_models_the_sea_refuses_a_calm_with_a_sentence(kind):
    with pytest.raises(ValueError, match="calm sea"):
        design(kind, with_value(THESIS, "sea_state.kind", "calm"))


def test_who_lacks_a_sensor_says_which():
    blind = load("thesis_linear")
    for kind, channel in (
        ("feedforward", "boom_tip_heave"),
        ("feedforward_peaks", "boom_tip_heave"),
        ("feedforward_prediction", "boom_tip_heave"),
    ):
        with pytest.raises(ValueError, match=f"{channel}.*|sensor of {channel}"):
            design(kind, blind)
    deaf = replace(THESIS, sensors=BOOM_TIP)
    with pytest.raises(ValueError, match="'pid' needs payload_heave measured"):
        design("pid", deaf)
