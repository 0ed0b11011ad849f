"""Scenarios: to and from YAML without loss, and one sentence for every mistake."""

from __future__ import annotations

import dataclasses
import math
import typing

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from baselines import design
from heave_env.document import field_docs
from heave_env.env import HeaveEnv
from heave_env.kernel import RUNNING
from heave_env.parameters import Cable, Payload, SeaState, Winch
from heave_env.plant import Plant
from heave_env.scenarios import (
    Scenario,
    from_mapping,
    load,
    names,
    read,
    to_mapping,
    to_yaml,
    with_value,
    with_values,
)
from heave_env.vessel import boom_tip_lines


@pytest.mark.parametrize("name", names())
def test_yaml_comes_back_unchanged(tmp_path, name):
    scenario = load(name)
    path = tmp_path / "mine.yaml"
    path.write_text(to_yaml(scenario), encoding="utf-8")
    assert read(path) == scenario
    assert load(str(path)).fingerprint == scenario.fingerprint


@pytest.mark.parametrize("name", names())
def test_every_named_scenario_is_described_and_tagged(name):
    scenario = load(name)
    assert scenario.name == name and len(scenario.description) > 40 and scenario.tags
    assert name in names(scenario.tags[0])


@given(st.floats(1e-3, 1e6), st.floats(1e-9, 1e9))
def test_numbers_survive_yaml_to_the_last_bit(time_constant, command_weight):
    scenario = with_value(load("thesis_linear"), "winch.time_constant", time_constant)
    scenario = with_value(scenario, "task.command_weight", command_weight)
    assert from_mapping(yaml.safe_load(to_yaml(scenario))) == scenario


def test_fingerprint_sees_numbers_and_not_names():
    scenario = load("thesis_linear")
    assert dataclasses.replace(scenario, name="other", description="").fingerprint == scenario.fingerprint
    assert with_value(scenario, "winch.time_constant", 1.1).fingerprint != scenario.fingerprint


def test_every_yaml_key_is_explained():
    text = to_yaml(load("sea_state_5"))
    for key in ("mass_per_length", "time_constant", "significant_wave_height", "information_set"):
        line = text.splitlines().index(
            next(row for row in text.splitlines() if row.strip().startswith(key + ":"))
        )
        assert text.splitlines()[line - 1].strip().startswith("#")


@pytest.mark.parametrize("name", [name for name in names() if load(name).is_linear])
def test_command_range_is_ample_in_linear_scenarios(name):
    # At least 8 standard deviations of the optimal command: what holds the payload still moves the sheave
    # against the boom tip, u = -x0 and u0 = u + u'/K.
    from heave_env.vessel import boom_tip_lines

    scenario = load(name)
    omega, variance = boom_tip_lines(scenario.sea_state, scenario.vessel)
    lag = 1.0 + (omega * scenario.winch.time_constant) ** 2
    needed = math.sqrt(float(np.sum(variance * lag)))
    assert scenario.winch.command_range >= 8.0 * needed


@pytest.mark.parametrize(
    ("path", "value", "complaint"),
    [
        ("payload.mass", -1.0, r"Payload\.mass must be a positive number, got -1\.0"),
        ("cable.axial_stiffness", math.nan, r"Cable\.axial_stiffness must be a positive number, got nan"),
        ("winch.time_constnt", 1.0, "did you mean 'time_constant'"),
        ("winch.speed_limit", 0.0, r"Winch\.speed_limit must be a positive number or null"),
        ("winch.command_delay", 0.12, "whole number of steps of 0.05 s"),
        ("duration", 0.05, "whole number of steps of 0.1 s"),
        ("sea_state.kind", "stormy", r"SeaState\.kind must be one of shaping_filter"),
        ("sea_state.kind", "recorded", "recording must be the path of a motion file"),
        ("information_set", "oracle", "must be one of full_state, sensors, sensors_history"),
        ("sensors.payload_depth.delay", 0.1, "there is no 'payload_depth'"),
        ("sensors.payload_heave", 0.1, "names a whole entry; name one of its values"),
        ("sensors.payload_heave.delay", 0.13, "whole number of control steps"),
        ("linear_payload", {"inertia": 1.0, "damping": 0.1}, "given exactly when the other"),
        ("linear_payload.inertia", 1.0, "'linear_payload' is null in 'sea_state_5'"),
        ("length", 1.0, "longer than what recovery and the winch's reach"),
        ("history_lags", [3, 1], "increasing whole numbers"),
        ("n_elements", 2.5, "an integer of at least 1"),
        ("task.landing_depth", -3.0, "must be a positive number or null"),
        ("name", "my case", "letters, digits and underscores"),
    ],
)
def test_wrong_values_are_refused_in_a_sentence(path, value, complaint):
    with pytest.raises(ValueError, match=complaint) as caught:
        with_value(load("sea_state_5"), path, value)
    assert "\n" not in str(caught.value)


def test_unknown_and_missing_keys_are_named():
    mapping = to_mapping(load("sea_state_5"))
    mapping["winch"]["gearbox"] = 3.0
    with pytest.raises(ValueError, match=r"unknown key 'winch\.gearbox'; known keys: time_constant"):
        from_mapping(mapping)
    del mapping["winch"]["gearbox"], mapping["cable"]["diameter"]
    with pytest.raises(ValueError, match=r"missing key 'cable\.diameter'"):
        from_mapping(mapping)


def test_recording_and_vessel_contradict_each_other():
    scenario = load("sea_state_5")
    with pytest.raises(ValueError, match="vessel must be null when sea_state.kind is recorded"):
        dataclasses.replace(scenario, sea_state=SeaState(kind="recorded", recording="motion.csv"))


@pytest.mark.parametrize(
    ("text", "complaint"),
    [("a: [", "is not valid YAML"), ("- 1\n", "must be a mapping"), ("", "must be a mapping")],
)
def test_files_that_are_no_scenario_are_refused(tmp_path, text, complaint):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match=complaint):
        load(path)


def test_missing_file_is_named():
    with pytest.raises(ValueError, match=r"cannot read scenario file 'nowhere\.yaml'"):
        load("nowhere.yaml")


def test_recording_is_looked_up_beside_the_yaml(tmp_path):
    scenario = dataclasses.replace(
        load("thesis_cable"), sea_state=SeaState(kind="recorded", recording="motion.csv")
    )
    path = tmp_path / "mine.yaml"
    path.write_text(to_yaml(scenario))
    assert read(path).sea_state.recording == str(tmp_path / "motion.csv")


@pytest.mark.parametrize("kind", [Cable, Payload, Winch, Scenario])
def test_every_field_has_a_docstring(kind):
    documented = field_docs(kind)
    # A part of a scenario is told by its class.
    hints = typing.get_type_hints(kind)
    undocumented = [
        item.name
        for item in dataclasses.fields(kind)
        if item.name not in documented
        and not any(map(dataclasses.is_dataclass, (hints[item.name], *typing.get_args(hints[item.name]))))
    ]
    assert undocumented == []


@pytest.mark.parametrize(
    ("name", "fingerprint"),
    [
        ("thesis_linear", "b16cd15eddd9ed58"),
        ("thesis_regulator", "88ccce944604310d"),
        ("thesis_regulator_delay", "05f50f1c3cddd43d"),
        ("thesis_cable", "a5a16c8c750298e8"),
        ("sea_state_5", "d60d9ec320de5583"),
        ("lowering", "0459e1dd2a81efbe"),
        ("snap", "b00fc761239b608a"),
        ("deep_resonance", "82a208320ded7218"),
    ],
)
def test_fingerprints_of_version_0_stand(name, fingerprint):
    # Policies are bound to them: a key that a scenario gains later says nothing while it is off.
    assert load(name).fingerprint == fingerprint


DRUM = {"winch.drum_radius": 1.0, "winch.drum_inertia": 1.0}
ROD = {"gas_volume": 4.0, "piston_area": 0.05, "stroke": 4.0}


def drawn(path: str, low: float, high: float) -> list[dict[str, object]]:
    return [{"parameter": path, "low": low, "high": high}]


HEIGHT = drawn("sea_state.significant_wave_height", 1.0, 2.0)


@pytest.mark.parametrize(
    ("name", "values", "one", "other"),
    [
        # A linear payload has no cable, and so neither tension nor length.
        ("thesis_linear", {"length": 3.0}, "length", "linear_payload"),
        ("thesis_linear", {"pay_out.speed": 1.0, "pay_out.distance": 9.0}, "pay_out", "linear_payload"),
        ("thesis_linear", {"task.landing_depth": 99.0}, "landing_depth", "linear_payload"),
        ("thesis_linear", {"task.tension_limit": 1e5}, "tension_limit", "linear_payload"),
        ("thesis_linear", {"compensator": ROD}, "compensator", "linear_payload"),
        ("thesis_linear", {"winch.power_limit": 1e4}, "power_limit", "linear_payload"),
        ("thesis_linear", {"winch.torque_limit": 1e4, **DRUM}, "torque_limit", "linear_payload"),
        ("thesis_linear", {"winch.efficiency": 0.5}, "efficiency", "linear_payload"),
        ("thesis_linear", {"winch.regeneration": 0.5}, "regeneration", "linear_payload"),
        ("thesis_linear", {"sensors.0.channel": "sheave_tension"}, "sheave_tension", "linear_payload"),
        ("sea_state_5", {"linear_payload": {"inertia": 1.0, "damping": 1.0}}, "linear_payload", "cable"),
        # The winch.
        ("sea_state_5", {"winch.torque_limit": 1e6}, "drum_radius", "torque_limit"),
        ("sea_state_5", {"winch.drum_radius": 1.0}, "drum_radius", "torque_limit"),
        ("sea_state_5", {"winch.natural_omega": 2.0}, "time_constant", "natural_omega"),
        ("sea_state_5", {"winch.damping_ratio": 0.3}, "damping_ratio", "natural_omega"),
        ("sea_state_5", {"winch.dead_band": 2.0}, "dead_band", "command_range"),
        ("sea_state_5", {"winch.command_step": 4.1}, "command_step", "command_range"),
        ("sea_state_5", {"length": 1.5}, "length", "winch's reach"),
        # Cable, payload and what holds them.
        ("sea_state_5", {"cable.mass_per_length": 0.0}, "n_elements", "massless"),
        ("landing", {"cable.breaking_strength": 1e5}, "breaking_strength", "submerged_weight"),
        ("landing", {"task.tension_limit": 1e5}, "tension_limit", "submerged_weight"),
        ("hybrid", {"compensator.force": 1e3}, "compensator.force", "submerged_weight"),
        ("hybrid", {"compensator.stroke": 200.0}, "stroke", "gas_volume"),
        ("sea_state_5", {"sensors.0.channel": "compensator_rate"}, "compensator_rate", "compensator"),
        ("sea_state_5", {"pay_out.speed": 1.0}, "speed", "distance"),
        ("landing", {"task.landing_depth": 250.0}, "landing_depth", "length"),
        ("landing", {"task.landing_depth": 400.0}, "landing_depth", "pay_out.distance"),
        ("landing", {"pay_out.speed": -0.15}, "landing_depth", "pay_out.distance"),
        # Sea and vessel.
        ("sea_state_5", {"sea_state.recording": "x.csv"}, "recording", "kind"),
        (
            "sea_state_5",
            {"sea_state.kind": "recorded", "sea_state.recording": "x.csv"},
            "vessel",
            "sea_state.kind",
        ),
        (
            "lowering",
            {"sea_state.kind": "recorded", "sea_state.recording": "x.csv", "vessel": None},
            "pay_out",
            "sea_state.kind",
        ),
        ("sea_state_5", {"vessel_table": {}}, "vessel_table", "vessel"),
        ("thesis_linear", {"vessel": None, "vessel_table": {}}, "filter", "vessel_table"),
        ("sea_state_5", {"sea_state.spectrum": "jonswap"}, "filter", "spectrum"),
        ("sea_state_5", {"sea_state.filter_order": 8}, "filter_order", "filter"),
        ("sea_state_5", {"sea_state.peak_enhancement": 2.0}, "peak_enhancement", "spectrum"),
        ("snap", {"sea_state.spectrum": "jonswap"}, "spectrum", "kind"),
        # Sensors.
        ("lowering", {"sensors.length.high_pass_omega": 0.1}, "high_pass_omega", "channel"),
        ("deep_resonance", {"sensors.sheave_tension.high_pass_omega": 0.1}, "high_pass_omega", "channel"),
        ("sea_state_5", {"sensors.payload_heave.high_pass_omega": 40.0}, "high_pass_omega", "control_dt"),
        ("sea_state_5", {"sensors.payload_heave.interval": 0.05}, "interval", "control steps"),
        # What is drawn.
        (
            "sea_state_5",
            {
                "sea_state.kind": "recorded",
                "sea_state.recording": "x.csv",
                "vessel": None,
                "uncertainty": HEIGHT,
            },
            "significant_wave_height",
            "sea_state.kind is recorded",
        ),
        ("thesis_cable", {"uncertainty": drawn("vessel.gain", 0.1, 0.2)}, "vessel.gain", "vessel is null"),
        (
            "sea_state_5",
            {"uncertainty": drawn("compensator.damping", 0.1, 0.2)},
            "compensator.damping",
            "compensator is null",
        ),
        ("thesis_linear", {"uncertainty": drawn("length", 1.0, 2.0)}, "uncertainty", "'length'"),
        (
            "sea_state_5",
            {"uncertainty": drawn("winch.damping_ratio", 0.1, 0.2)},
            "damping_ratio",
            "natural_omega",
        ),
        (
            "sea_state_5",
            {"uncertainty": drawn("cable.normal_drag_coefficient", 0.1, 0.2)},
            "normal_drag_coefficient",
            "along the cable",
        ),
        (
            "sea_state_5",
            {"uncertainty": drawn("winch.command_delay", 0.0, 0.2) * 2},
            "winch.command_delay",
            "twice",
        ),
        (
            "sea_state_5",
            {
                "information_set": "full_state",
                "uncertainty": drawn("sensors.payload_heave.noise_std", 0.1, 0.2),
            },
            "sensors.payload_heave.noise_std",
            "information_set",
        ),
    ],
)
def test_what_contradicts_itself_is_refused_and_both_keys_named(name, values, one, other):
    with pytest.raises(ValueError, match=r"contradict|must|cannot|no number|twice") as caught:
        with_values(load(name), values)
    text = str(caught.value)
    assert one.lower() in text.lower() and other.lower() in text.lower() and "\n" not in text


def test_several_values_need_only_make_sense_together():
    drive = {"winch.natural_omega": 1.5, "winch.time_constant": None, "winch.damping_ratio": 0.5}
    assert with_values(load("sea_state_5"), drive).winch.is_second_order
    env = HeaveEnv("sea_state_5", overrides=drive)
    assert env.scenario.winch.damping_ratio == 0.5


TIERS = ("limits_cable", "unknown_cable", "limits_unknown_cable", "energy_cable", "recovery", "rov_umbilical")


@pytest.mark.parametrize("name", TIERS)
def test_the_cable_s_tiers_run_with_a_locked_winch_and_with_lqg(name):
    # Fixed weights in place of tuning, which would take its time: neither a limit cycle nor a failure.
    scenario = dataclasses.replace(load(name), duration=40.0)
    factor, mismatch = (1000.0, 0.1) if name == "recovery" else (100.0, 1.0)
    weights = {"command_weight": factor * scenario.task.command_weight, "mismatch": mismatch}
    if scenario.winch.speed_limit is not None:
        weights["speed_weight"] = 0.3 * scenario.task.position_weight
    controller = design("lqg", scenario, **weights)
    seeds = np.arange(20_000_000, 20_000_004, dtype=np.uint64)
    spreads = []
    for acting in (False, True):
        plant = Plant(scenario, len(seeds))
        plant.begin(np.ones(len(seeds), dtype=bool), seeds)
        memory, heave = None, []
        for _ in range(scenario.n_steps):
            action, memory = controller.predict(plant.observation, memory)
            plant.advance(action[:, 0].astype(float) if acting else np.zeros(len(seeds)))
            assert np.all(plant.outcome == RUNNING)
            heave.append(plant.channel("payload_heave"))
        # Until the recovery begins to haul, whose drag moves the payload too.
        spreads.append(float(np.std(heave[100:300])))
    assert spreads[1] < 0.6 * spreads[0]


def test_limits_bite_on_the_cable_as_they_do_on_the_linear_payload():
    # The boom tip's own speed, of which the weak winch has less than two standard deviations.
    for name in ("limits_linear", "limits_cable"):
        scenario = load(name)
        omega, variance = boom_tip_lines(scenario.sea_state, scenario.boom_tip_vessel)
        speed = math.sqrt(float(omega**2 @ variance))
        assert 1.0 < scenario.winch.speed_limit / speed < 2.5
