"""Real sensors: each error does what it says, and nothing else."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from heave_env.env import HeaveVectorEnv
from heave_env.scenarios import Scenario, load
from heave_env.sensors import Sensor, acoustic_depth, load_cell, motion_reference_unit, winch_encoder


def seeing(*sensors: Sensor, **sea) -> Scenario:
    """The 900 m cable, seen by the given sensors alone, their scales one (of a tension 1 MN)."""
    scenario = load("sea_state_5")
    chosen = tuple(
        dataclasses.replace(sensor, scale=1e6 if sensor.channel == "sheave_tension" else 1.0)
        for sensor in sensors
    )
    return dataclasses.replace(
        scenario, sensors=chosen, sea_state=dataclasses.replace(scenario.sea_state, **sea)
    )


def readings(scenario: Scenario, n_envs: int, n_steps: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Observed channels, (n_steps + 1, n_envs, n_sensors), and true channels, (n_steps + 1, n_envs)."""
    env = HeaveVectorEnv(scenario, n_envs)
    observation, info = env.reset(seed=3)
    n = len(scenario.sensors)
    seen, truth = [observation[:, :n]], [info]
    for _ in range(n_steps):
        observation, *_, info = env.step(np.zeros((n_envs, 1)))
        seen.append(observation[:, :n])
        truth.append(info)
    names = {sensor.channel for sensor in scenario.sensors}
    return np.array(seen, dtype=float), {name: np.array([row[name] for row in truth]) for name in names}


def test_scale_error_and_bias_stay_for_an_episode_and_have_their_deviations():
    seen, truth = readings(seeing(Sensor(channel="boom_tip_heave", scale_error=0.05, bias=0.02)), 500, 30)
    # Each row's readings are a straight line of the truth: its slope less one and its offset are the draws.
    heave, read = truth["boom_tip_heave"], seen[:, :, 0]
    fits = [np.polyfit(heave[:, row], read[:, row], 1, full=True) for row in range(500)]
    slope, offset = np.array([fit[0] for fit in fits]).T
    assert max(float(fit[1][0]) for fit in fits) < 1e-9
    # Deviations of 500 normal numbers are good to 1/sqrt(1000): four of those.
    assert np.std(slope - 1.0) == pytest.approx(0.05, rel=0.13)
    assert np.std(offset) == pytest.approx(0.02, rel=0.13)


def test_between_readings_the_last_one_stands():
    seen, truth = readings(seeing(Sensor(channel="payload_heave", interval=0.5)), 3, 40)
    expected = truth["payload_heave"][5 * (np.arange(41) // 5)]
    assert seen[:, :, 0] == pytest.approx(expected, abs=1e-6)


def test_a_lost_reading_leaves_the_last_one_as_often_as_said():
    seen, truth = readings(seeing(Sensor(channel="boom_tip_heave", dropout=0.2)), 100, 100)
    fresh = np.isclose(seen[:, :, 0], truth["boom_tip_heave"], atol=1e-6)[1:]
    # A share of 10 000 readings: within four standard errors of 0.004.
    assert 1.0 - fresh.mean() == pytest.approx(0.2, abs=0.016)
    stale = ~fresh
    assert np.array_equal(seen[1:, :, 0][stale], seen[:-1, :, 0][stale])


@pytest.mark.parametrize("omega", [0.2, 0.6])
def test_heave_filter_has_the_gain_and_phase_of_its_corner(omega):
    corner = 0.15
    scenario = seeing(
        Sensor(channel="boom_tip_heave", high_pass_omega=corner), kind="regular", peak_omega=omega
    )
    scenario = dataclasses.replace(scenario, vessel=None)
    seen, truth = readings(scenario, 2, 3000)
    time = 0.1 * np.arange(3001)
    late = time > 150.0
    waves = np.column_stack([np.cos(omega * time), np.sin(omega * time)])[late]

    def phasor(series: np.ndarray) -> complex:
        cosine, sine = np.linalg.lstsq(waves, series[late], rcond=None)[0]
        return complex(cosine, -sine)

    ratio = phasor(seen[:, 0, 0]) / phasor(truth["boom_tip_heave"][:, 0])
    s = 1j * omega
    exact = s**2 / (s**2 + 2.0 * 0.7 * corner * s + corner**2)
    # The trapezoidal rule bends the frequency by (omega dt)²/12 = 3e-4 at most.
    assert abs(ratio - exact) < 1e-3


def test_errors_that_are_nought_change_no_bit():
    plain = readings(seeing(Sensor(channel="payload_heave", noise_std=0.01)), 4, 20)[0]
    held = readings(seeing(Sensor(channel="payload_heave", noise_std=0.01, interval=0.1)), 4, 20)[0]
    assert np.array_equal(plain, held)


def test_presets_stand_in_a_scenario():
    sensors = (*motion_reference_unit(), acoustic_depth(), winch_encoder(), load_cell(200e3))
    seen, truth = readings(seeing(*sensors), 16, 1200)
    late = slice(700, None)
    errors = seen[late, :, 0] - truth["boom_tip_heave"][late]
    # Noise and scale are small beside the phase of the heave filter, 2 · 0.7 · 0.105/0.5 = 0.3 rad.
    assert 0.2 < errors.std() / truth["boom_tip_heave"][late].std() < 0.4
    tension = 1e6 * seen[late, :, -1] - truth["sheave_tension"][late]
    # Noise of 500 N and 0.5 % of 98.6 kN; sixteen scale errors are good to 18 %.
    assert math.sqrt(np.mean(tension**2)) == pytest.approx(math.hypot(500.0, 493.0), rel=0.4)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"dropout": 1.0}, "dropout must be a probability below 1"),
        ({"scale_error": -0.1}, "scale_error must be a number that is not negative"),
        ({"interval": 0.0}, "interval must be a positive number or null"),
    ],
)
def test_impossible_sensors_are_refused(changes, complaint):
    with pytest.raises(ValueError, match=complaint):
        Sensor(channel="payload_heave", **changes)


def test_a_reading_between_control_steps_is_refused():
    with pytest.raises(ValueError, match=r"Sensor.interval must be a whole number of control steps of 0.1 s"):
        seeing(Sensor(channel="payload_heave", interval=0.25))
