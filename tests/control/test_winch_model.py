"""The winch that controllers reckon with is the plant's, and it can be asked what command does what."""

import numpy as np
import pytest

from baselines.winch_model import winch_model
from heave_env.plant import simulate
from heave_env.scenarios import load, with_value

LIMITS = with_value(load("limits_linear"), "start", "hanging")


def with_(scenario, **values):
    for path, value in values.items():
        scenario = with_value(scenario, path.replace("__", "."), value)
    return scenario


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"winch__acceleration_limit": None},
        {"winch__acceleration_limit": None, "winch__speed_limit": None},
        {"winch__stroke_limit": 0.3},
        {"winch__command_delay": 0.15},
        {"winch__command_delay": 0.0, "n_substeps": 5},
    ],
)
def test_it_follows_the_plant_to_rounding(changes):
    scenario = with_(LIMITS, **changes)
    n_steps, n_rows = 300, 8
    steps = np.random.default_rng(0).normal(size=(n_steps, n_rows))
    given = np.clip(0.15 * np.cumsum(steps, axis=0), -2.0, 2.0)
    record = simulate(scenario, seeds=range(n_rows), duration=30.0, commands=given)
    winch = winch_model(scenario)
    u, v, commands = np.zeros(n_rows), np.zeros(n_rows), np.zeros((n_rows, 1 + winch.n_pending))
    for step in range(n_steps):
        commands = np.column_stack([given[step], commands[:, :-1]])
        u, v, path = winch.path(u, v, commands, first=0, count=winch.n_substeps)
        assert u == pytest.approx(record["winch_displacement"][step + 1], abs=1e-12)
        assert v == pytest.approx(record["winch_rate"][step + 1], abs=1e-12)
        assert np.array_equal(path[:, -2], u)


def carried_out(winch, u, v, command):
    for _ in range(winch.n_substeps):
        u, _, v = winch.step(u, v, command)
    return u, v


def test_a_rate_within_reach_is_reached_and_one_beyond_as_nearly_as_can_be():
    winch = winch_model(LIMITS)
    rng = np.random.default_rng(1)
    n = 5000
    u, v = rng.normal(0.0, 0.3, n), rng.uniform(-0.265, 0.265, n)
    wanted = np.clip(v + rng.uniform(-0.04, 0.04, n), -0.265, 0.265)
    _, rate = carried_out(winch, u, v, winch.command_for_rate(u, v, wanted))
    # 0.25 m/s² over a tenth of a second; half a per cent of it is what three corrections leave.
    assert rate == pytest.approx(np.clip(wanted, v - 0.025, v + 0.025), abs=1.2e-4)
    # The lag alone, inverted, loses a good part of the acceleration where the drum is fast.
    naive = np.clip(u + wanted / winch.rate_constant, -4.0, 4.0)
    _, rate = carried_out(winch, u, v, naive)
    assert np.abs(rate - np.clip(wanted, v - 0.025, v + 0.025)).max() > 5e-3


@pytest.mark.parametrize("speed_limit", [0.265, None])
def test_a_displacement_within_reach_is_reached(speed_limit):
    winch = winch_model(with_(LIMITS, winch__acceleration_limit=None, winch__speed_limit=speed_limit))
    rng = np.random.default_rng(2)
    u, step = rng.normal(0.0, 0.3, 2000), rng.uniform(-0.03, 0.03, 2000)
    reached, _ = carried_out(winch, u, np.zeros(2000), winch.command_for_displacement(u, u + step))
    reachable = np.clip(step, -winch.speed_limit * 0.1, winch.speed_limit * 0.1)
    assert reached - u == pytest.approx(reachable, abs=3e-5)


def test_no_command_leaves_the_range():
    winch = winch_model(LIMITS)
    far = np.array([3.9, -3.9])
    fast = np.array([0.26, -0.26])
    assert np.abs(winch.command_for_rate(far, fast, fast)).max() <= 4.0
    assert np.abs(winch.command_for_displacement(far, 2.0 * far)).max() <= 4.0
