"""Variants: the plant is another, what is observed, commanded and designed for stays."""

from __future__ import annotations

import dataclasses
import re

import gymnasium as gym
import numpy as np
import pytest
import yaml

import heave_env  # noqa: F401  (registers the scenarios)
from baselines import design
from heave_env.env import HeaveEnv, HeaveVectorEnv
from heave_env.parameters import Draw
from heave_env.plant import Plant, simulate
from heave_env.scenarios import (
    from_mapping,
    load,
    names,
    on_plant_of,
    read,
    to_yaml,
    variants_of,
    varied,
    with_value,
)
from heave_env.variants import VARIANTS, Nominal, NoSuchVariantError

SEEDS = [20_000_000, 20_000_001]


@pytest.mark.parametrize("name", names())
def test_layout_and_design_basis_are_the_scenario_s_own(name):
    scenario = load(name)
    found = variants_of(scenario)
    assert {"later", "deeper", "shallower"} <= set(found)
    for variant in found:
        met = load(f"{name}@{variant}")
        assert met.observation_names == scenario.observation_names
        assert met.observed_sensors == scenario.observed_sensors
        assert met.winch.command_range == scenario.winch.command_range
        assert met.fingerprint != scenario.fingerprint
        assert met.design_basis.fingerprint == scenario.fingerprint
        assert from_mapping(yaml.safe_load(to_yaml(met))) == met


def test_every_variant_is_told_and_used():
    used = {variant for name in names() for variant in variants_of(load(name))}
    assert used == set(VARIANTS)
    for change in VARIANTS.values():
        assert (change.__doc__ or "").strip().endswith(".")


def test_a_variant_s_yaml_comes_back_with_its_basis(tmp_path):
    met = load("unknown_linear@rougher@later")
    path = tmp_path / "mine.yaml"
    path.write_text(to_yaml(met), encoding="utf-8")
    again = read(path)
    assert again == met and again.fingerprint == met.fingerprint
    assert again.design_basis.fingerprint == load("unknown_linear").fingerprint
    plain = tmp_path / "plain.yaml"
    plain.write_text(to_yaml(load("unknown_linear")), encoding="utf-8")
    assert load(f"{plain}@rougher@later").fingerprint == met.fingerprint


def test_each_variant_changes_what_it_says():
    def of(name):
        return load(f"sea_state_5@{name}")

    sea = load("sea_state_5").sea_state
    assert of("rougher").sea_state.significant_wave_height == pytest.approx(1.4 * sea.significant_wave_height)
    assert of("calmer").sea_state.significant_wave_height == pytest.approx(sea.significant_wave_height / 1.4)
    assert of("longer_waves").sea_state.peak_omega == pytest.approx(sea.peak_omega / 1.25)
    assert of("shorter_waves").sea_state.peak_omega == pytest.approx(sea.peak_omega * 1.25)
    assert of("other_spectrum").sea_state.spectrum == "jonswap"
    assert of("higher_order").n_filter_states == load("sea_state_5").n_filter_states + 2
    assert of("recorded_like").sea_state.spectrum == "ochi_hubble"
    assert of("deeper").length == pytest.approx(1125.0) and of("shallower").length == pytest.approx(720.0)
    assert of("later").winch.command_delay == pytest.approx(0.4)
    landing = load("landing@deeper")
    assert landing.task.landing_depth - landing.length == pytest.approx(20.0)


def test_the_range_of_a_drawn_number_moves_along():
    def ranges(name):
        return {draw.parameter: (draw.low, draw.high) for draw in load(name).uncertainty}

    own, rough, late = (
        ranges("unknown_linear"),
        ranges("unknown_linear@rougher"),
        ranges("unknown_linear@later"),
    )
    height, delay = "sea_state.significant_wave_height", "winch.command_delay"
    assert rough[height] == pytest.approx(tuple(1.4 * end for end in own[height]))
    assert late[delay] == pytest.approx((0.2, 0.6))
    assert {key: value for key, value in late.items() if key != delay} == {
        key: value for key, value in own.items() if key != delay
    }


def test_a_variant_is_the_plant_that_its_numbers_make():
    # The same plant without a basis moves alike, to the bit: only scales and names of observations differ.
    for name in ("sea_state_5@rougher@deeper", "limits_linear@longer_waves"):
        met = load(name)
        bare = dataclasses.replace(met, nominal=())
        one, other = (simulate(item, seeds=SEEDS, duration=20.0) for item in (met, bare))
        assert all(np.array_equal(one[channel], other[channel]) for channel in one)
        assert bare.observed_sensors != met.observed_sensors


@pytest.mark.parametrize(("name", "n_shown"), [("thesis_linear", 0), ("limits_linear", 2)])
def test_a_longer_delay_is_felt_but_not_shown(name, n_shown):
    met = load(f"{name}@later")
    assert met.n_shown_pending == n_shown and met.n_held_pending == n_shown + 2
    plant = Plant(met, 1)
    plant.begin(np.array([True]), np.array([7]))
    # One command of 0.5, then rest: it is felt delay later, and shown while the basis thinks it is under way.
    felt, shown = [], []
    rest = Plant(met, 1)
    rest.begin(np.array([True]), np.array([7]))
    for step in range(8):
        plant.advance(np.array([0.5 if step == 0 else 0.0]))
        rest.advance(np.array([0.0]))
        felt.append(bool(plant.channel("winch_displacement") != rest.channel("winch_displacement")))
        shown.append([float(value) for value in plant.observation[0][len(met.observed_sensors) :]])
    assert felt.index(True) == met.n_held_pending
    assert [row.index(0.5) if 0.5 in row else None for row in shown] == [
        *range(n_shown),
        *[None] * (8 - n_shown),
    ]


def test_observations_keep_their_units():
    # The same heave reads as the same number, however rough the sea.
    met, scenario = load("sea_state_5@rougher"), load("sea_state_5")
    env = HeaveVectorEnv(met, num_envs=2)
    observation, info = env.reset(seed=SEEDS)
    scale = scenario.observed_sensors[2].scale
    assert scenario.observed_sensors[2].channel == "boom_tip_heave"
    noise = observation[:, 2] * scale - info["boom_tip_heave"]
    assert np.all(np.abs(noise) < 5.0 * scenario.observed_sensors[2].noise_std)


def test_designs_are_made_for_the_basis():
    own, other = design("lqg", load("thesis_linear")), design("lqg", load("thesis_linear@later@deeper"))
    assert np.array_equal(own.F, other.F) and np.array_equal(own.L, other.L)
    assert own.predicted_cost == other.predicted_cost


def test_every_face_understands_a_variant():
    env = gym.make("heave_env/sea_state_5-v0", scenario="sea_state_5@shallower")
    assert env.unwrapped.scenario.length == pytest.approx(720.0)
    batch = gym.make_vec("heave_env/sea_state_5-v0", num_envs=2, scenario="sea_state_5@later")
    assert batch.scenario.winch.command_delay == pytest.approx(0.4)
    assert HeaveEnv("sea_state_5@rougher").observation_space == HeaveEnv("sea_state_5").observation_space


@pytest.mark.parametrize(
    "name",
    [
        "limits_linear@other_spectrum",
        "unknown_linear@recorded_like",
        "sea_state_5@higher_order",
        "snap@later",
    ],
)
def test_variants_run(name):
    record = simulate(load(name), seeds=SEEDS, duration=30.0)
    assert np.all(np.isfinite(record["payload_heave"])) and np.std(record["payload_heave"]) > 0.0


def test_a_setting_reaches_the_plant_and_where_it_is_not_varied_the_basis():
    met = with_value(load("sea_state_5@rougher"), "winch.time_constant", 0.5)
    assert met.winch.time_constant == met.design_basis.winch.time_constant == 0.5
    met = with_value(met, "sea_state.significant_wave_height", 6.0)
    assert met.design_basis.sea_state.significant_wave_height == 3.048


def test_a_plant_of_one_s_own_under_a_known_basis():
    basis = load("sea_state_5")
    plant = with_value(with_value(basis, "payload.mass", 150_000.0), "sensors.payload_heave.noise_std", 0.02)
    met = on_plant_of(basis, plant)
    assert [item.parameter for item in met.nominal] == ["payload.mass", "sensors.0.noise_std"]
    assert met.observed_sensors[0].noise_std == 0.02
    assert met.observed_sensors[0].scale == basis.observed_sensors[0].scale
    assert met.design_basis == basis


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (lambda: load("sea_state_5@roughr"), "unknown variant 'roughr'; did you mean 'rougher'"),
        (lambda: load("sea_state5@rougher"), "unknown scenario 'sea_state5'; did you mean 'sea_state_5'"),
        (lambda: load("snap@other_spectrum"), "'snap' has no variant 'other_spectrum': a regular sea"),
        (lambda: load("thesis_cable@higher_order"), "no variant 'higher_order': its sea is random_phase"),
        (
            lambda: HeaveEnv("sea_state_5@rougher", information_set="full_state"),
            "contradicts information_set full_state",
        ),
        (
            lambda: dataclasses.replace(
                load("sea_state_5"), nominal=(Nominal(parameter="winch.command_range", value=3.0),)
            ),
            "nominal cannot replace 'winch.command_range'",
        ),
        (
            lambda: dataclasses.replace(
                load("sea_state_5"), nominal=(Nominal(parameter="length", value=-1.0),)
            ),
            "nominal does not make a scenario: Scenario.length must be a positive number",
        ),
        (
            lambda: on_plant_of(load("sea_state_5"), load("thesis_linear")),
            "'vessel|'cable|'length|'payload|'sensors",
        ),
    ],
)
def test_what_makes_no_sense_is_refused_in_a_sentence(make, complaint):
    with pytest.raises(ValueError, match=complaint) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_a_variant_out_of_reach_says_so():
    deep = with_value(load("sea_state_5"), "length", 2.4)
    with pytest.raises(NoSuchVariantError, match=re.escape("longer than what recovery")):
        varied(deep, "shallower")
    assert "shallower" not in variants_of(deep)


def test_a_drawn_variant_draws_from_its_own_ranges():
    known = dataclasses.replace(
        load("thesis_linear"),
        uncertainty=(Draw(parameter="sea_state.significant_wave_height", low=2.0, high=4.0),),
    )
    plants = [Plant(item, 1) for item in (known, varied(known, "rougher"))]
    for plant in plants:
        plant.begin(np.array([True]), np.array([3]))
    assert plants[1].drawn[0, 0] == pytest.approx(1.4 * plants[0].drawn[0, 0])
