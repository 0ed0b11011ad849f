"""The winch: exact lag, delay, and limits that bind where they should."""

from __future__ import annotations

import dataclasses
import math

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


def drive_response(time: np.ndarray, omega: float, damping: float) -> np.ndarray:
    """Unit step response of u'' + 2 ζ ω u' + ω² u = ω² u0 for ζ < 1."""
    damped = omega * math.sqrt(1.0 - damping**2)
    ringing = np.cos(damped * time) + damping * omega / damped * np.sin(damped * time)
    return 1.0 - np.exp(-damping * omega * time) * ringing


@pytest.mark.parametrize("delay", [0.0, 0.2])
def test_second_order_drive_is_exact(delay):
    scenario = winch_alone(time_constant=None, natural_omega=2.0, damping_ratio=0.6, command_delay=delay)
    time, u = step_response(scenario)
    assert u == pytest.approx(drive_response(np.maximum(time - delay, 0.0), 2.0, 0.6), abs=1e-12)


def test_second_order_drive_keeps_its_limits():
    scenario = winch_alone(
        time_constant=None, natural_omega=3.0, speed_limit=0.4, acceleration_limit=0.5, stroke_limit=0.9
    )
    record = simulate(scenario, seeds=[0], duration=10.0, commands=np.ones(100))
    rate = record["winch_rate"][:, 0]
    assert rate.max() == pytest.approx(0.4)
    # The stroke stops the drum dead: the only jump of the speed.
    moving = record["winch_displacement"][:, 0] < 0.9
    assert np.abs(np.diff(rate[moving])).max() <= 0.5 * 0.1 + 1e-12
    assert record["winch_displacement"].max() == pytest.approx(0.9)


def test_effects_that_never_bite_change_nothing():
    free = step_response(winch_alone())[1]
    driven = step_response(winch_alone(command_step=1e-9))[1]
    assert driven == pytest.approx(free, abs=1e-8)


def test_commands_are_rounded_to_steps():
    # 0.26 is nearest to two steps of 0.1, so the drum settles at 0.3 and not at 0.26.
    _, u = step_response(winch_alone(command_step=0.1), height=0.26)
    assert u[-1] == pytest.approx(0.3, abs=1e-4)


def test_within_the_dead_band_the_drive_rests():
    _, u = step_response(winch_alone(dead_band=0.05))
    # The lag comes to within 0.05 of the command, a solver step further at most, and stays.
    assert 0.95 <= u[-1] < 0.953
    assert u[-1] == u[-20]


def hanging(**changes) -> Scenario:
    """The 900 m cable in a calm sea: its tension is the weight of 98.6 kN."""
    scenario = load("sea_state_5")
    return dataclasses.replace(
        scenario,
        sea_state=dataclasses.replace(scenario.sea_state, kind="calm"),
        winch=dataclasses.replace(scenario.winch, command_delay=0.0, **changes),
    )


def test_power_limit_divides_by_the_tension():
    record = simulate(hanging(power_limit=20e3), seeds=[0], duration=10.0, commands=np.full(100, 1.5))
    power = np.abs(record["sheave_tension"] * record["winch_rate"])
    # The tension of the step before sets the limit; it changes little within a step of 0.05 s.
    assert power.max() == pytest.approx(20e3, rel=0.05)
    assert record["saturated"][2, 0] == 1.0
    unlimited = simulate(hanging(), seeds=[0], duration=10.0, commands=np.full(100, 1.5))
    assert np.abs(unlimited["sheave_tension"] * unlimited["winch_rate"]).max() > 60e3


def test_torque_beyond_the_tension_accelerates_and_below_it_the_winch_is_pulled_out():
    drum = {"drum_radius": 0.5, "drum_inertia": 4000.0}
    strong = simulate(hanging(torque_limit=60e3, **drum), seeds=[0], duration=5.0, commands=np.ones(50))
    # (60 kN·m - 98.6 kN · 0.5 m) · 0.5 m / 4000 kg·m² at most, while the tension is that of rest.
    first = strong["winch_rate"][1, 0] / 0.1
    assert first == pytest.approx((60e3 - 98.6e3 * 0.5) * 0.5 / 4000.0, rel=0.05)
    weak = simulate(hanging(torque_limit=40e3, **drum), seeds=[0], duration=2.0, commands=np.ones(20))
    assert weak["winch_displacement"][-1, 0] < -0.1


def test_energy_drawn_is_work_over_efficiency_less_what_returns():
    up_and_down = np.repeat([1.0, -1.0], 100)
    ideal = simulate(hanging(regeneration=1.0), seeds=[0], duration=20.0, commands=up_and_down)
    real = simulate(hanging(efficiency=0.8, regeneration=0.5), seeds=[0], duration=20.0, commands=up_and_down)
    assert ideal["supply_power"] == pytest.approx(ideal["winch_power"])
    work = real["winch_power"][1:]
    # Within a control step the power keeps its sign here, but for the two steps in which it turns.
    expected = np.where(work > 0.0, work / 0.8, 0.5 * work)
    assert np.sum(real["supply_power"][1:]) == pytest.approx(np.sum(expected), rel=0.02)
    assert real["payload_heave"] == pytest.approx(ideal["payload_heave"], abs=0.0)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"natural_omega": 2.0}, "time_constant must be given exactly when natural_omega is null"),
        ({"time_constant": None}, "time_constant must be given exactly when natural_omega is null"),
        ({"torque_limit": 1e4}, "drum_radius must be given exactly with torque_limit"),
        ({"efficiency": 1.2}, "efficiency must be a share, at most 1"),
        ({"efficiency": 0.0}, "efficiency must be a positive number"),
        ({"power_limit": 1e4}, "power_limit must be null with a linear_payload"),
    ],
)
def test_winches_that_make_no_sense_are_refused(changes, complaint):
    with pytest.raises(ValueError, match=complaint):
        winch_alone(**changes)
