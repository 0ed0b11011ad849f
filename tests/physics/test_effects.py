"""Each effect of the plant, switched on alone: it changes what it should and leaves every other bit alone.

What it changes by how much is held where the effect is; here two runs with the same seeds and commands are
laid beside each other, channel by channel.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from heave_env.kernel import LANDED
from heave_env.layout import CHANNEL_NAMES
from heave_env.parameters import Cable, SeaState, Winch
from heave_env.plant import Plant
from heave_env.scenarios import Scenario, load, with_value, with_values
from heave_env.sensors import Sensor
from heave_env.task import Task

BOOM_TIP = {"boom_tip_heave", "boom_tip_heave_rate"}
CABLE = {
    "payload_heave",
    "payload_heave_rate",
    "sheave_tension",
    "payload_tension",
    "tension_min",
    "tension_max",
    "position_cost",
    "winch_power",
    "supply_power",
}
"""All that hangs below the sheave, with the work that its tension does at the winch."""
WINCH = {"winch_displacement", "winch_rate", "length"} | CABLE
ROD = {"compensator_displacement", "compensator_rate"}
N_STEPS = 150


def base() -> Scenario:
    """A payload on 900 m of cable, every channel measured in its own unit, the winch at rest at first."""
    scenario = load("sea_state_5")
    channels = [sensor.channel for sensor in scenario.sensors] + ["sheave_tension", "length"]
    scenario = with_values(scenario, {"start": "hanging", "winch.command_delay": 0.0})
    scales = {"sheave_tension": 1e5, "length": 1e2}  # an observation is clipped at 50
    sensors = tuple(
        Sensor(channel=channel, scale=scales.get(channel, 1.0), noise_std=0.01) for channel in channels
    )
    return dataclasses.replace(scenario, sensors=sensors)


@dataclasses.dataclass(frozen=True)
class Effect:
    """One switch, or a group that makes sense together only."""

    name: str
    on: dict[str, Any]
    changes: set[str]
    """Channels that must differ; every other must have the same bits."""
    off: dict[str, Any] = dataclasses.field(default_factory=dict)
    """What the two runs share, where the effect needs more than the base has."""


def drawn(parameter: str, low: float, high: float) -> dict[str, Any]:
    """A number that each episode draws."""
    return {"uncertainty": [{"parameter": parameter, "low": low, "high": high}]}


FITTED = {"sea_state.filter": "fitted", "sea_state.filter_order": 6}
RANDOM = {"sea_state.kind": "random_phase"}
DRUM = {"winch.torque_limit": 1.02e5, "winch.drum_radius": 1.0, "winch.drum_inertia": 2e4}
TAUT = {"cable.axial_damping": 8e4, "n_iterations": 6}
ROD_ON = {"gas_volume": 2.0, "piston_area": 0.05, "stroke": 6.0, "damping": 2e4}
EFFECTS = (
    Effect("spectrum, filter", {"sea_state.spectrum": "jonswap"}, BOOM_TIP | CABLE, off=FITTED),
    Effect("spectrum, sinusoids", {"sea_state.spectrum": "torsethaugen"}, BOOM_TIP | CABLE, off=RANDOM),
    Effect(
        "two peaks",
        {"sea_state.spectrum": "ochi_hubble", "sea_state.second_wave_height": 1.0},
        BOOM_TIP | CABLE,
        off=RANDOM,
    ),
    Effect(
        "peak enhancement",
        {"sea_state.peak_enhancement": 6.0},
        BOOM_TIP | CABLE,
        off=FITTED | {"sea_state.spectrum": "jonswap"},
    ),
    Effect("fitted filter", {"sea_state.filter": "fitted"}, BOOM_TIP | CABLE),
    Effect("filter's order", {"sea_state.filter_order": 8}, BOOM_TIP | CABLE, off=FITTED),
    Effect("vessel", {"vessel": None}, BOOM_TIP | CABLE, off={"sea_state.significant_wave_height": 0.6}),
    Effect(
        "vessel's table",
        {"vessel_table": {"heading": 2.6, "boom_tip_y": 14.0}},
        BOOM_TIP | CABLE,
        off=FITTED | {"vessel": None},
    ),
    Effect("second-order drive", {"winch.time_constant": None, "winch.natural_omega": 2.0}, WINCH),
    Effect("speed limit", {"winch.speed_limit": 0.15}, WINCH | {"saturated"}),
    Effect("acceleration limit", {"winch.acceleration_limit": 0.1}, WINCH | {"saturated"}),
    Effect("stroke limit", {"winch.stroke_limit": 0.2}, WINCH | {"saturated", "cost"}),
    Effect("power limit", {"winch.power_limit": 1e4}, WINCH | {"saturated"}),
    Effect("torque limit", DRUM, WINCH | {"saturated"}),
    Effect("dead band", {"winch.dead_band": 0.05}, WINCH),
    Effect("quantised command", {"winch.command_step": 0.05}, WINCH),
    Effect("delay", {"winch.command_delay": 0.2}, WINCH),
    Effect("efficiency", {"winch.efficiency": 0.7}, {"supply_power"}),
    Effect("regeneration", {"winch.regeneration": 0.5}, {"supply_power"}),
    Effect("compensator", {"compensator": ROD_ON}, CABLE | ROD),
    Effect(
        "pay-out",
        {"pay_out": {"speed": 0.3, "start": 3.0, "distance": 20.0, "ramp": 4.0}},
        {"payout", "length"} | CABLE,
    ),
    Effect(
        "hardening, quadratic",
        {"cable.quadratic_hardening": 20.0},
        CABLE,
        off=TAUT | {"cable.tension_only": True},
    ),
    Effect("hardening, cubic", {"cable.cubic_hardening": 5e3}, CABLE, off=TAUT),
    Effect("relaxation", {"cable.relaxing_stiffness": 1e7}, CABLE),
    Effect("relaxation time", {"cable.relaxation_time": 20.0}, CABLE, off={"cable.relaxing_stiffness": 1e7}),
    Effect("added mass along", {"cable.added_mass_per_length": 1.0}, CABLE),
    Effect("kelvin damping", {"cable.axial_damping": 8e4}, CABLE),
    Effect("tension limit", {"task.tension_limit": 1e5}, {"cost"}),
    Effect("price of energy", {"task.energy_weight": 1.0}, {"energy_cost"}),
    Effect("uncertain cable", drawn("cable.axial_stiffness", 1.2e7, 1.9e7), CABLE),
    Effect("uncertain winch", drawn("winch.time_constant", 0.5, 0.9), WINCH),
    Effect(
        "uncertain delay", drawn("winch.command_delay", 0.1, 0.4), WINCH, off={"winch.command_delay": 0.1}
    ),
    Effect("uncertain sea", drawn("sea_state.significant_wave_height", 2.0, 2.9), BOOM_TIP | CABLE),
)


@dataclasses.dataclass(frozen=True)
class Played:
    """Two episodes under smooth commands that bite every limit above; the first axis is time."""

    channels: dict[str, np.ndarray]
    sensors: dict[str, np.ndarray]
    reward: np.ndarray
    outcome: np.ndarray


def play(scenario: Scenario, n_steps: int = N_STEPS) -> Played:
    plant = Plant(dataclasses.replace(scenario, duration=n_steps * scenario.control_dt), 2)
    plant.begin(np.ones(2, dtype=bool), np.array([7, 8]))
    time = scenario.control_dt * np.arange(n_steps)
    commands = 0.4 * np.sin(0.9 * time) + 0.2 * np.sin(2.3 * time)
    channels, observations = [plant.channels.copy()], [plant.observation.copy()]
    rewards, outcomes = [], []
    for command in commands / scenario.winch.command_range:
        plant.advance(np.full(2, command))
        channels.append(plant.channels.copy())
        observations.append(plant.observation.copy())
        rewards.append(plant.reward.copy())
        outcomes.append(plant.outcome.copy())
    shown = np.array(observations)
    entries = {sensor.channel: shown[:, :, i] for i, sensor in enumerate(scenario.observed_sensors)}
    table = np.array(channels)
    named = {name: table[:, :, i] for i, name in enumerate(CHANNEL_NAMES)}
    return Played(named, entries, np.array(rewards), np.array(outcomes))


def differing(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> set[str]:
    return {name for name in one if not np.array_equal(one[name], other[name])}


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_an_effect_changes_what_it_should_and_nothing_else(effect):
    off = with_values(base(), effect.off)
    without, with_it = play(off), play(with_values(off, effect.on))
    assert differing(without.channels, with_it.channels) == effect.changes
    # Sensors see the change of what they measure, with the same noise, and of nothing else.
    measured = effect.changes & set(without.sensors)
    assert differing(without.sensors, with_it.sensors) == measured
    # The reward is what the costs say.
    charged = bool(effect.changes & {"position_cost", "command_cost", "failure_cost", "energy_cost"})
    assert np.array_equal(without.reward, with_it.reward) == (not charged)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("noise_std", 0.02),
        ("noise_density", 1e-4),
        ("delay", 0.3),
        ("scale_error", 0.05),
        ("bias", 0.05),
        ("interval", 0.5),
        ("dropout", 0.3),
        ("high_pass_omega", 0.1),
        ("scale", 2.0),
        ("offset", 0.3),
    ],
)
@pytest.mark.parametrize("channel", ["payload_heave", "boom_tip_heave_rate"])
def test_a_sensor_s_error_changes_its_own_reading_and_nothing_else(channel, field, value):
    scenario = base()
    without = play(scenario)
    with_it = play(with_value(scenario, f"sensors.{channel}.{field}", value))
    assert differing(without.channels, with_it.channels) == set()
    assert differing(without.sensors, with_it.sensors) == {channel}
    assert np.array_equal(without.reward, with_it.reward)


def test_what_controllers_believe_leaves_the_plant_alone():
    scenario = base()
    belief = {"nominal": [{"parameter": "cable.axial_stiffness", "value": 1.2e7}]}
    without, with_it = play(scenario), play(with_values(scenario, belief))
    assert (
        differing(without.channels, with_it.channels) == differing(without.sensors, with_it.sensors) == set()
    )


def test_a_cable_that_may_go_slack_moves_as_one_that_pushes_for_as_long_as_it_is_taut():
    pushing = with_values(
        load("snap"), {"start": "hanging", "cable.tension_only": False, "cable.breaking_strength": None}
    )
    slack = with_value(pushing, "cable.tension_only", True)
    without, with_it = play(pushing), play(slack)
    assert differing(without.channels, with_it.channels) == CABLE | {"slack", "cost"}
    assert without.channels["tension_min"].min() < 0.0 <= with_it.channels["tension_min"].min()
    for row in range(2):
        pressed = np.nonzero(without.channels["tension_min"][:, row] <= 0.0)[0]
        first = int(pressed[0]) if len(pressed) else N_STEPS
        assert first > 1
        for name in ("payload_heave", "sheave_tension"):
            ours, theirs = with_it.channels[name][:first, row], without.channels[name][:first, row]
            assert ours == pytest.approx(theirs, rel=1e-6, abs=1e-6)


def test_a_cable_that_may_part_is_the_same_cable_until_it_does():
    whole = with_values(load("snap"), {"start": "hanging", "cable.breaking_strength": None})
    strength = 0.7 * float(play(whole).channels["tension_max"].max())
    without, with_it = play(whole), play(with_value(whole, "cable.breaking_strength", strength))
    lost = np.argmax(with_it.outcome != 0, axis=0)
    assert np.all(with_it.outcome.max(axis=0) > 0) and np.all(without.outcome == 0)
    for row in range(2):
        until = slice(0, int(lost[row]) + 1)
        for name in CHANNEL_NAMES:
            assert np.array_equal(without.channels[name][until, row], with_it.channels[name][until, row])


def test_a_bed_ends_the_episode_and_changes_nothing_before():
    scenario = with_values(
        load("landing"), {"start": "hanging", "pay_out": {"speed": 1.0, "start": 1.0, "distance": 40.0}}
    )
    free = with_value(scenario, "task.landing_depth", None)
    without, with_it = play(free, 300), play(scenario, 300)
    landed = np.argmax(with_it.outcome == LANDED, axis=0)
    assert np.all(landed > 100) and np.all(without.outcome == 0)
    for row in range(2):
        until = slice(0, int(landed[row]) + 1)
        for name in CHANNEL_NAMES:
            assert np.array_equal(without.channels[name][until, row], with_it.channels[name][until, row])
        assert np.array_equal(without.reward[: landed[row], row], with_it.reward[: landed[row], row])


BASIC = {
    Winch: {"damping_ratio", "command_range"},
    SeaState: {
        "kind", "significant_wave_height", "peak_omega", "n_components", "recording", "shape",
        "second_peak_omega", "second_shape", "spectrum_file", "spectrum_reader", "spectrum_record",
    },
    Cable: {
        "mass_per_length", "axial_stiffness", "submerged_weight", "diameter", "tangential_drag_coefficient",
        "normal_drag_coefficient", "normal_added_mass_coefficient", "tension_only", "breaking_strength",
    },
    Task: {"position_weight", "command_weight", "landing_depth", "failure_factor"},
}  # fmt: skip
"""Fields that are no switch: there is always a value of them; or that a test of their own here switches."""


@pytest.mark.parametrize(
    ("kind", "key"), [(Winch, "winch"), (SeaState, "sea_state"), (Cable, "cable"), (Task, "task")]
)
def test_no_switch_is_left_out(kind, key):
    switched = {path.split(".")[1] for effect in EFFECTS for path in effect.on if path.startswith(f"{key}.")}
    assert {field.name for field in dataclasses.fields(kind)} == switched | BASIC[kind]
