"""The linear model that the controllers are designed on is the plant's own, exactly discretised."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from baselines.model import (
    continuous_model,
    delayed_command,
    filter_state_sizes,
    linear_model,
    nominal_sea,
    regulator_matrices,
    sea_filter,
)
from heave_env.env import HeaveVectorEnv
from heave_env.parameters import LinearPayload, SeaState
from heave_env.scenarios import load, with_value
from heave_env.sensors import Sensor
from heave_env.vessel import heave_response

PAYLOAD = LinearPayload(inertia=0.8959, damping=0.1658)


def test_boom_tip_and_locked_payload_have_the_theory_s_standard_deviations():
    # Published: 0.255 m (Huang 1992, 6.3.6); the digits are recomputed from the same equations.
    model = continuous_model(load("thesis_linear"))
    waves = sea_filter(load("thesis_linear"))
    assert math.sqrt((waves.C @ waves.covariance @ waves.C.T)[0, 0]) == pytest.approx(0.1722, abs=5e-5)
    assert math.sqrt(model.covariance()[0, 0]) == pytest.approx(0.2551, abs=5e-5)


def test_the_spectrum_integrated_over_positive_frequencies_gives_the_lyapunov_variance():
    model = continuous_model(load("thesis_linear"))
    one_sided = quad(lambda w: abs(model.response(np.array([w]))[0]) ** 2, 0.0, 20.0, limit=400)[0]
    assert math.sqrt(one_sided) == pytest.approx(math.sqrt(model.covariance()[0, 0]), rel=1e-6)
    # (6.35) as printed runs over both signs of frequency: 0.361 m in place of 0.255 m.
    assert math.sqrt(2.0 * one_sided) == pytest.approx(0.361, abs=5e-4)


@pytest.mark.parametrize("delay", [0.0, 0.05, 0.1, 0.15, 0.2, 0.35])  # whole steps and halves of 0.1 s
def test_the_delay_chain_is_the_delayed_plant_whatever_the_fraction(delay):
    dt, n_steps = 0.1, 12
    n_pending = math.ceil(delay / dt - 1e-9)
    A, B, _ = regulator_matrices(PAYLOAD, 1.0)
    F, H, G, shift = delayed_command(A, B, dt, delay, n_pending)
    commands = np.random.default_rng(1).normal(size=n_steps)
    state, pending = np.zeros((3, 1)), np.zeros((n_pending, 1))
    for command in commands:
        state = F @ state + H @ pending + G * command
        pending = shift @ pending + np.eye(n_pending, 1) * command

    # The same by integrating the continuous plant between the instants where the winch's input jumps.
    truth = np.zeros(3)
    jumps = sorted({0.0, n_steps * dt, *(k * dt + delay for k in range(n_steps) if k * dt + delay < 1.2)})
    for start, end in pairwise(jumps):
        k = math.floor((0.5 * (start + end) - delay) / dt)
        u0 = commands[k] if k >= 0 else 0.0
        run = solve_ivp(lambda t, x, u0=u0: A @ x + B[:, 0] * u0, (start, end), truth, rtol=1e-11, atol=1e-13)
        truth = run.y[:, -1]
    assert state[:, 0] == pytest.approx(truth, abs=1e-9)


def test_the_model_names_its_states_and_carries_the_commands_under_way():
    model = linear_model(with_value(load("thesis_linear"), "winch.command_delay", 0.25))
    assert model.states[:6] == (
        "payload_heave",
        "payload_heave_rate",
        "winch_displacement",
        "pending_command_1",
        "pending_command_2",
        "pending_command_3",
    )
    assert model.n_states == 3 + 3 + 8
    assert model.B[3, 0] == 1.0
    assert model.A[4, 3] == model.A[5, 4] == 1.0
    # The youngest pending command has not reached the winch a step later: 0.25 s is more than two steps.
    assert model.A[2, 3] == 0.0
    assert model.A[2, 4] > 0.0


def test_a_delayed_sensor_reports_a_past_sample():
    scenario = load("thesis_linear")
    late = replace(
        scenario, sensors=(replace(scenario.sensors[0], delay=0.3), Sensor(channel="boom_tip_heave"))
    )
    model = linear_model(late)
    assert model.states[-3:] == ("payload_heave[-1]", "payload_heave[-2]", "payload_heave[-3]")
    s = np.random.default_rng(2).normal(size=model.n_states)
    seen = s[model.index("payload_heave")]
    for _ in range(3):
        s = model.A @ s
    assert (model.C @ s)[0] == pytest.approx(seen)


def test_thesis_coordinates_are_those_of_the_printed_matrices():
    # In the coordinates of (6.23) and (6.26) each chain's rate is the derivative of its displacement: A = 1.
    scenario = load("thesis_linear")
    waves, sizes = sea_filter(scenario), filter_state_sizes(scenario)
    A = waves.A / sizes * sizes[:, None]
    w0 = 0.9538 * 0.785
    assert [A[i, i + 1] for i in (0, 2, 4, 6)] == pytest.approx([1.0] * 4)
    assert A[3, 2] == pytest.approx(-(w0**2))
    assert A[3, 5] == pytest.approx(w0**2)
    assert (waves.B[:, 0] * sizes)[-1] == pytest.approx(1.0)
    assert (waves.C / sizes)[0, 0] == pytest.approx(0.5 * 0.393**2)


def test_a_regular_sea_is_a_narrow_oscillator_of_the_same_variance():
    scenario = load("snap")
    waves = sea_filter(scenario)
    amplitude = 0.5 * scenario.sea_state.significant_wave_height
    response = abs(complex(heave_response(np.array(scenario.sea_state.peak_omega), scenario.vessel)))
    variance = (waves.C @ waves.covariance @ waves.C.T)[0, 0]
    assert variance == pytest.approx(0.5 * (amplitude * response) ** 2)
    assert abs(np.linalg.eigvals(waves.A)) == pytest.approx([scenario.sea_state.peak_omega] * 2)


def test_a_recorded_motion_is_modelled_by_its_height_and_period(tmp_path):
    time = np.arange(0.0, 300.0, 0.2)
    heave = 0.5 * np.sin(0.7 * time) + 0.3 * np.sin(0.9 * time + 1.0)
    path = tmp_path / "motion.csv"
    rows = "\n".join(f"{t},{h}" for t, h in zip(time, heave, strict=True))
    path.write_text(f"time,heave\n{rows}\n")
    sea = SeaState(kind="recorded", recording=str(path))
    scenario = replace(load("thesis_linear"), sea_state=sea, vessel=None)
    nominal = nominal_sea(scenario)
    assert nominal.significant_wave_height == pytest.approx(4.0 * np.std(heave), rel=0.01)
    assert 0.4 < nominal.peak_omega < 0.8
    assert linear_model(scenario).n_states == 3 + 6


def test_a_calm_sea_cannot_be_modelled_and_the_sentence_says_what_to_do():
    calm = with_value(load("thesis_regulator"), "sea_state.kind", "calm")
    assert sea_filter(calm) is None
    with pytest.raises(ValueError, match=r"calm sea.*lqr"):
        linear_model(calm)


@pytest.mark.parametrize("start", ["hanging", "compensated"])
def test_start_covariance_is_that_of_the_environments_starts(start):
    scenario = with_value(with_value(load("thesis_linear"), "winch.command_delay", 0.2), "start", start)
    model = linear_model(scenario)
    env = HeaveVectorEnv(scenario, 4000)
    observation, info = env.reset(seed=0)
    pending = observation[:, scenario.observation_names.index("pending_command_1")]
    seen = {
        "payload_heave": info["payload_heave"],
        "winch_displacement": info["winch_displacement"],
        "pending_command_1": pending * scenario.winch.command_range,
    }
    for name, values in seen.items():
        i = model.states.index(name)
        # The standard error of a deviation of 4000 samples is 1.1 %.
        assert np.std(values) == pytest.approx(np.sqrt(model.start_covariance[i, i]), rel=0.04, abs=1e-9)
