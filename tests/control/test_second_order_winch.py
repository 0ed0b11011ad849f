"""Every design knows a second-order drive, and costs what theory says of it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from baselines import DESIGNERS, design
from baselines.clairvoyant import clairvoyant_cost
from baselines.lqg import lqg
from baselines.model import linear_model
from baselines.mpc import mpc
from heave_env.controller import NoControl
from heave_env.parameters import Winch
from heave_env.plant import Plant
from heave_env.scenarios import Scenario, load
from heave_env.sensors import Sensor

DRIVE = Winch(natural_omega=1.5, damping_ratio=0.5, command_range=4.0, command_delay=0.2)
LAG = Winch(time_constant=DRIVE.lag, command_range=4.0, command_delay=0.2)


def operation(**changes) -> Scenario:
    return dataclasses.replace(
        load("unknown_linear"), uncertainty=(), winch=dataclasses.replace(DRIVE, **changes)
    )


def mean_cost(scenario: Scenario, controller, n_seas: int, n_steps: int = 3000) -> tuple[float, float]:
    """Mean stage cost after 100 s, and its standard error over seas."""
    plant = Plant(scenario, n_seas)
    plant.begin(np.ones(n_seas, dtype=bool), 20_000_000 + np.arange(n_seas))
    memory, cost, first = None, np.zeros(n_seas), 1000
    for step in range(n_steps):
        action, memory = controller.predict(plant.observation, memory)
        plant.advance(action[:, 0].astype(float))
        cost -= plant.reward if step >= first else 0.0
    cost /= n_steps - first
    return float(cost.mean()), float(cost.std() / np.sqrt(n_seas))


def test_it_costs_what_theory_says_and_less_than_a_design_for_the_lag():
    scenario = operation()
    best = lqg(scenario)
    assert best.states[-1] == "winch_rate"
    cost, error = mean_cost(scenario, best, 128)
    by_lag = lqg(dataclasses.replace(scenario, winch=LAG))
    of_lag, _ = mean_cost(scenario, by_lag, 16)
    print(
        f"\nsecond-order design {cost:.4f} +- {error:.4f}, theory {best.performance.cost:.4f}; "
        f"by its lag {of_lag:.4g}"
    )
    assert cost == pytest.approx(best.performance.cost, abs=3.0 * error)
    assert cost < 0.5 * of_lag


LINEAR_DESIGNS = [
    # Without the delay that it does not know and would not be stable with.
    ("lqr", 0.0, {}, 0),
    ("lqr", 0.0, {}, 1),
    ("lqr", 0.0, {"design": "continuous", "command_weight": 10.0}, 2),
    ("delay_lqr", 0.2, {}, 0),
    ("delay_lqr", 0.15, {}, 1),
    ("delay_lqr", 0.2, {}, 2),
    ("delay_lqr", 0.2, {"design": "taylor"}, 0),
    ("delay_lqr", 0.2, {"design": "taylor", "command_weight": 100.0}, 1),
    ("delay_lqr", 0.2, {"design": "taylor", "command_weight": 100.0}, 2),
    ("feedforward", 0.2, {}, 0),
    ("feedforward_prediction", 0.2, {"aim": "middle"}, 0),
    ("feedforward_prediction", 0.2, {"aim": "end"}, 0),
    ("feedforward_prediction", 0.15, {"aim": "end"}, 0),
    ("pid", 0.2, {}, 0),
]
"""Design, delay [s], options, and what is measured of the winch: nothing, its displacement, its rate too."""


@pytest.mark.parametrize(("kind", "delay", "options", "n_seen"), LINEAR_DESIGNS)
def test_every_linear_design_costs_what_theory_says(kind, delay, options, n_seen):
    # A range that cuts nothing off: the zigzag of `end` is large.
    scenario = operation(command_delay=delay, command_range=20.0)
    winch = (Sensor(channel="winch_displacement", noise_std=1e-3), Sensor(channel="winch_rate"))[:n_seen]
    scenario = dataclasses.replace(scenario, sensors=(*scenario.sensors, *winch))
    controller = DESIGNERS[kind](scenario, **options)
    assert {sensor.channel for sensor in winch} <= set(controller.measures)
    cost, error = mean_cost(scenario, controller, 32)
    theory = controller.predicted_cost
    print(f"\n{kind} {options}, delay {delay} s: {cost:.4g} +- {error:.2g}, theory {theory:.4g}")
    assert cost == pytest.approx(theory, abs=3.0 * error)


@pytest.mark.parametrize("delay", [0.0, 0.15, 0.2])
def test_the_predictive_controller_is_the_stochastic_optimal_one(delay):
    scenario = operation(command_delay=delay)
    theirs, ours = (mean_cost(scenario, make(scenario), 16)[0] for make in (lqg, mpc))
    assert ours == pytest.approx(theirs, rel=2e-3)


def test_the_peaks_forecast_inverts_the_drive_as_well():
    # A noise-free swell of one frequency, half a second ahead: what is left is a small share of it.
    scenario = operation(command_delay=0.5)
    sea = dataclasses.replace(scenario.sea_state, kind="regular")
    boom_tip = tuple(Sensor(channel=channel) for channel in ("boom_tip_heave", "boom_tip_heave_rate"))
    scenario = dataclasses.replace(scenario, sea_state=sea, sensors=boom_tip)
    by_lag = dataclasses.replace(scenario, winch=dataclasses.replace(LAG, command_delay=0.5))
    costs = [mean_cost(scenario, DESIGNERS["feedforward_peaks"](known), 4)[0] for known in (scenario, by_lag)]
    locked = mean_cost(scenario, NoControl(), 4)[0]
    print(f"\npeaks {costs[0]:.4g}, by the lag {costs[1]:.4g}, winch locked {locked:.4g}")
    assert costs[0] < 0.01 * locked < costs[1]


def test_feed_forward_of_a_drive_chooses_an_aim_that_its_range_holds():
    wide, narrow = operation(), operation(command_range=2.0)
    for scenario, aim in ((wide, "end"), (narrow, "middle")):
        chosen = DESIGNERS["feedforward_prediction"](scenario)
        same = DESIGNERS["feedforward_prediction"](scenario, aim=aim)
        assert np.array_equal(chosen.gain, same.gain)


def test_nobody_is_cheaper_than_who_knows_the_sea():
    full = dataclasses.replace(operation(), information_set="full_state", duration=250.0)
    seeds = [20_000_000, 20_000_001]
    least = clairvoyant_cost(full, seeds)
    causal, _ = mean_cost(full, lqg(full), 2, n_steps=2500)
    assert np.all(least < causal * 1.2)
    assert least.mean() == pytest.approx(causal, rel=0.02)
    assert least.mean() < causal


@pytest.mark.slow
@pytest.mark.parametrize("acceleration_limit", [0.25, None])
def test_within_limits_tuned_predictive_control_is_the_cheaper(acceleration_limit):
    rough = load("limits_linear")
    drive = dataclasses.replace(DRIVE, speed_limit=0.265, acceleration_limit=acceleration_limit)
    scenario = dataclasses.replace(rough, winch=drive)
    costs = {kind: mean_cost(scenario, design(kind, scenario), 32)[0] for kind in ("lqg", "mpc")}
    least = clairvoyant_cost(scenario, range(20_000_000, 20_000_004)).mean()
    ratio = costs["mpc"] / costs["lqg"]
    print(f"\n{acceleration_limit} m/s2: {costs}, ratio {ratio:.3f}; clairvoyant, 4 seas {least:.3f}")
    assert costs["mpc"] < 0.83 * costs["lqg"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "limit", ["power", "power, tension measured", "torque", "dead band", "dead band of a drive"]
)
def test_tuned_predictive_control_copes_with_what_else_a_winch_has(limit):
    scenario = load("sea_state_5")
    changes = {
        "power": {"power_limit": 1.2e4},
        "torque": {"torque_limit": 1.1e5, "drum_radius": 1.0, "drum_inertia": 6e4},
        "dead band": {"dead_band": 0.2, "command_step": 0.05},
    }[limit.split(",")[0].removesuffix(" of a drive")]
    if limit.startswith("dead band"):
        scenario = dataclasses.replace(load("limits_linear"), duration=250.0)
        lag = (
            {}
            if "drive" not in limit
            else {"time_constant": None, "natural_omega": 1.5, "damping_ratio": 0.5}
        )
        changes = changes | lag | {"speed_limit": None, "acceleration_limit": None}
    if "measured" in limit:
        load_cell = Sensor(channel="sheave_tension", noise_std=500.0)
        scenario = dataclasses.replace(scenario, sensors=(*scenario.sensors, load_cell))
    scenario = dataclasses.replace(scenario, winch=dataclasses.replace(scenario.winch, **changes))
    found = {kind: design(kind, scenario) for kind in ("lqg", "mpc")}
    assert ("sheave_tension" in found["mpc"].measures) == ("measured" in limit)
    n_steps = scenario.n_steps
    costs = {kind: mean_cost(scenario, controller, 16, n_steps)[0] for kind, controller in found.items()}
    print(f"\n{limit}: {costs}, ratio {costs['mpc'] / costs['lqg']:.3f}")
    assert costs["mpc"] < 1.005 * costs["lqg"]
    if limit.startswith("dead band"):
        # Sent as they are, the same commands would come out otherwise.
        plain = dataclasses.replace(
            found["lqg"].estimator.winch, parameters=found["lqg"].estimator.winch.even.parameters
        )
        unshaped = dataclasses.replace(
            found["lqg"], estimator=dataclasses.replace(found["lqg"].estimator, winch=plain)
        )
        careless, _ = mean_cost(scenario, unshaped, 16, n_steps)
        print(f"neither reckoned with nor inverted: {careless:.4g}")
        assert costs["lqg"] < careless


def test_the_model_steps_the_drive_as_the_plant_does():
    scenario = operation(command_delay=0.0)
    model = linear_model(dataclasses.replace(scenario, start="hanging"))
    u, v = model.index("winch_displacement"), model.index("winch_rate")
    calm = dataclasses.replace(
        scenario, start="hanging", sea_state=dataclasses.replace(scenario.sea_state, kind="calm")
    )
    plant = Plant(calm, 1)
    plant.begin(np.ones(1, dtype=bool), np.zeros(1, dtype=int))
    state = np.zeros(model.n_states)
    for step in range(40):
        command = np.sin(0.3 * step)
        plant.advance(np.array([command / 4.0]))
        state = model.A @ state + model.B[:, 0] * command
        assert plant.channel("winch_displacement")[0] == pytest.approx(state[u], abs=1e-12)
        assert plant.channel("winch_rate")[0] == pytest.approx(state[v], abs=1e-12)
        assert plant.channel("payload_heave")[0] == pytest.approx(state[0], abs=1e-6)
