"""The winch: exact lag, delay, and limits that bind where they should."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from heave_env.plant import simulate
from heave_env.scenarios import Scenario, load


def winch_alone(**changes) -> Scenario:
    """A calm sea, so that only the command moves anything."""
    scenario = load("thesis_linear")
    return dataclasses.replace(
        scenario,
        sea_state=dataclasses.replace(scenario.sea_state, kind="calm"),
        winch=dataclasses.replace(scenario.winch, **changes),
    )


def step_response(scenario: Scenario, height: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    record = simulate(scenario, seeds=[0], duration=10.0, commands=np.full(100, height))
    return record["time"], record["winch_displacement"][:, 0]


def test_step_response_is_the_first_order_lag():
    time, u = step_response(winch_alone(time_constant=0.7))
    assert u == pytest.approx(1.0 - np.exp(-time / 0.7), abs=1e-12)


@pytest.mark.parametrize("delay", [0.1, 0.2, 0.25, 0.5])
def test_delay_shifts_the_response_exactly(delay):
    time, u = step_response(winch_alone(command_delay=delay))
    assert u == pytest.approx(1.0 - np.exp(-np.maximum(time - delay, 0.0)), abs=1e-12)


def test_speed_limit_is_the_exact_ramp_and_then_the_lag():
    # The lag wants K (1 - u) and may have 0.3: a ramp until 1 - u = 0.3, at 7/3 s, then the lag.
    time, u = step_response(winch_alone(speed_limit=0.3))
    exact = np.where(time < 0.7 / 0.3, 0.3 * time, 1.0 - 0.3 * np.exp(-(time - 0.7 / 0.3)))
    assert u == pytest.approx(exact, abs=1e-12)


def test_limits_that_never_bind_change_nothing():
    free = step_response(winch_alone())[1]
    loose = step_response(winch_alone(speed_limit=5.0, stroke_limit=3.0))[1]
    assert loose == pytest.approx(free, abs=1e-12)


def test_acceleration_limit_holds_and_the_lag_is_reached_all_the_same():
    record = simulate(winch_alone(acceleration_limit=0.25), seeds=[0], duration=30.0, commands=np.ones(300))
    rate = record["winch_rate"][:, 0]
    assert np.abs(np.diff(rate)).max() <= 0.25 * 0.1 + 1e-12
    assert record["winch_displacement"][-1, 0] == pytest.approx(1.0, abs=1e-3)


def test_loose_acceleration_limit_tends_to_the_lag():
    # The speed still ramps within one solver step of 0.05 s, so the response lags by half of one.
    time, u = step_response(winch_alone(acceleration_limit=1e6))
    assert u == pytest.approx(1.0 - np.exp(-time), abs=0.03)


def test_stroke_limit_stops_the_drum_and_is_reported():
    record = simulate(winch_alone(stroke_limit=0.5), seeds=[0], duration=10.0, commands=np.ones(100))
    u, saturated = record["winch_displacement"][:, 0], record["saturated"][:, 0]
    assert u.max() == pytest.approx(0.5)
    assert saturated[-1] == 1.0 and saturated[3] == 0.0
    assert record["winch_rate"][-1, 0] == 0.0
    assert record["cost"][-1, 0] == 1.0


def test_linear_payload_follows_the_winch_exactly():
    # a x'' + b x' + x = 1 - exp(-t): the particular solution and the free one that starts from rest.
    scenario = winch_alone()
    record = simulate(scenario, seeds=[0], duration=10.0, commands=np.ones(100))
    a, b = scenario.linear_payload.inertia, scenario.linear_payload.damping
    p = 1.0 / (a - b + 1.0)
    roots = np.roots([a, b, 1.0])
    weights = np.linalg.solve(np.array([[1.0, 1.0], roots]), np.array([p - 1.0, -p]))
    exact = 1.0 - p * np.exp(-record["time"]) + np.real(np.exp(np.outer(record["time"], roots)) @ weights)
    # The cubic through the ends of each 0.05 s is good to (0.05)^4 / 384.
    assert record["payload_heave"][:, 0] == pytest.approx(exact, abs=1e-8)
