"""The likelihood of a record: the compiled pass is the controllers' own filter, and it finds what is true."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from baselines.estimator import Estimator
from baselines.kalman import KalmanFilter
from baselines.likelihood import (
    EDGE,
    Slopes,
    _bounded,
    at_shares,
    evaluate,
    filter_of,
    filter_record,
    improved,
)
from baselines.lqg import lqg
from heave_env.parameters import Draw
from heave_env.plant import Plant
from heave_env.scenarios import Scenario, load

TEST_SEA = 20_000_000


def with_delay(name: str, delay: float) -> Scenario:
    scenario = load(name).with_drawn({})
    return dataclasses.replace(scenario, winch=dataclasses.replace(scenario.winch, command_delay=delay))


def noise(n_steps: int, n_outputs: int, size: float) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(7)
    return size * rng.standard_normal((n_steps, n_outputs)), size * rng.standard_normal(n_steps)


@pytest.mark.parametrize("delay", [0.0, 0.2, 0.25])  # none, whole control steps, a half more [s]
def test_the_pass_is_the_kalman_filter(delay):
    found = filter_of(with_delay("unknown_linear", delay))
    assert isinstance(found, KalmanFilter)
    y, commands = noise(60, len(found.model.outputs), 0.1)
    passed = filter_record(found, y, commands)
    prior, P, surprise = np.zeros((1, found.model.n_states)), found.model.start_covariance, 0.0
    A, C, W, V = found.model.A, found.model.C, found.model.W, found.model.V
    for k in range(60):
        S = C @ P @ C.T + V
        innovation = y[k] - C @ prior[0]
        surprise += 0.5 * (innovation @ np.linalg.solve(S, innovation) + np.linalg.slogdet(S)[1])
        prior = found.advanced(found.corrected(prior, y[k : k + 1], np.array([k])), commands[k : k + 1, None])
        P = A @ (P - P @ C.T @ np.linalg.solve(S, C @ P)) @ A.T + W
    assert passed.prior == pytest.approx(prior[0], rel=1e-7, abs=1e-10)
    assert passed.covariance == pytest.approx(P, rel=1e-6, abs=1e-12)
    assert passed.surprise == pytest.approx(surprise, rel=1e-9)


@pytest.mark.parametrize("delay", [0.0, 0.2, 0.25])
@pytest.mark.parametrize("ramps", [True, False])
def test_beside_limits_the_pass_is_the_estimator(delay, ramps):
    scenario = with_delay("limits_unknown_linear", delay)
    if not ramps:
        free = dataclasses.replace(scenario.winch, acceleration_limit=None)
        scenario = dataclasses.replace(scenario, winch=free)
    found = filter_of(scenario)
    assert isinstance(found, Estimator)
    # Commands of half a metre are far beyond what the winch can do in a step.
    y, commands = noise(60, len(found.filter.model.outputs), 0.5)
    passed = filter_record(found, y, commands)
    memory = np.zeros((1, found.n_memory))
    for k in range(60):
        estimate, rate = found.corrected(memory, y[k : k + 1])
        memory = found.advanced(memory, estimate, rate, commands[k : k + 1, None])
    assert passed.prior == pytest.approx(memory[0, :-2], rel=1e-7, abs=1e-10)
    assert passed.rate == pytest.approx(memory[0, -2], rel=1e-7, abs=1e-10)


def recorded(scenario: Scenario, n_steps: int) -> tuple[np.ndarray, np.ndarray]:
    """One episode in the hands of the controller for the scenario as it is."""
    controller = lqg(scenario.with_drawn({}))
    plant = Plant(scenario, 1)
    plant.begin(np.ones(1, dtype=bool), np.array([TEST_SEA]))
    memory, y, commands = None, [], []
    scale = np.array([sensor.scale for sensor in scenario.observed_sensors])
    for _ in range(n_steps):
        y.append(plant.observation[0, : len(scale)] * scale)
        action, memory = controller.predict(plant.observation[:, : len(controller.observation_names)], memory)
        plant.advance(action[:, 0].astype(float))
        commands.append(action[0, 0] * scenario.winch.command_range)
    return np.array(y), np.array(commands)


def test_gauss_and_newton_find_what_the_plant_drew():
    # The plant draws what lies within a hair; the prior is wide.
    wide = (
        Draw(parameter="linear_payload.inertia", low=0.6, high=1.2),
        Draw(parameter="winch.command_delay", low=0.0, high=0.4),
        Draw(parameter="winch.time_constant", low=0.6, high=1.6),
    )
    true = {"linear_payload.inertia": 1.05, "winch.command_delay": 0.3, "winch.time_constant": 1.3}
    plant = dataclasses.replace(
        load("unknown_linear"),
        uncertainty=tuple(
            dataclasses.replace(draw, low=true[draw.parameter], high=true[draw.parameter]) for draw in wide
        ),
    )
    y, commands = recorded(plant, 300)
    scenario = dataclasses.replace(plant, uncertainty=wide)
    estimate = evaluate(scenario, np.full(3, 0.5), y, commands)
    for _ in range(4):
        before = estimate.objective
        estimate, _ = improved(scenario, estimate, y, commands)
        assert estimate.objective <= before
    found = at_shares(scenario, estimate.shares)
    assert found.winch.command_delay == pytest.approx(0.3)
    # Thirty seconds of 5 mm noise tell the lag to a few per cent, the inertia to a tenth.
    assert found.winch.time_constant == pytest.approx(1.3, rel=0.03)
    assert found.linear_payload.inertia == pytest.approx(1.05, rel=0.1)


def test_a_step_keeps_within_the_prior():
    # The minimum lies at (1.4, 0.5 + 0.3 (1.4 - 0.5)); held at the edge, the second coordinate follows.
    curvature = np.array([[1.0, 0.0], [-0.3, 1.0]])
    curvature = curvature.T @ curvature
    at = np.array([0.5, 0.5])
    quadratic = Slopes(-curvature @ np.array([0.9, 0.27]), curvature)
    target = _bounded(at, quadratic)
    assert target == pytest.approx([1.0 - EDGE, 0.5 + 0.3 * (1.0 - EDGE - 0.5)])
