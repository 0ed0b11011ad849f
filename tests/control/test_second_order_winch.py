"""The stochastic-optimal design knows a second-order drive, and costs what theory says."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from baselines.lqg import lqg
from baselines.model import linear_model
from heave_env.parameters import Winch
from heave_env.plant import Plant
from heave_env.scenarios import Scenario, load

DRIVE = Winch(natural_omega=1.5, damping_ratio=0.5, command_range=4.0, command_delay=0.2)


def operation(**changes) -> Scenario:
    return dataclasses.replace(
        load("unknown_linear"), uncertainty=(), winch=dataclasses.replace(DRIVE, **changes)
    )


def mean_cost(scenario: Scenario, controller, n_seas: int) -> tuple[float, float]:
    """Mean stage cost after 100 s, and its standard error over seas."""
    plant = Plant(scenario, n_seas)
    plant.begin(np.ones(n_seas, dtype=bool), 20_000_000 + np.arange(n_seas))
    memory, cost, n_steps, first = None, np.zeros(n_seas), 3000, 1000
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
    by_lag = lqg(
        dataclasses.replace(
            scenario, winch=Winch(time_constant=DRIVE.lag, command_range=4.0, command_delay=0.2)
        )
    )
    of_lag, _ = mean_cost(scenario, by_lag, 16)
    print(
        f"\nsecond-order design {cost:.4f} +- {error:.4f}, theory {best.performance.cost:.4f}; "
        f"by its lag {of_lag:.4g}"
    )
    assert cost == pytest.approx(best.performance.cost, abs=3.0 * error)
    assert cost < 0.5 * of_lag


def test_the_model_steps_the_drive_as_the_plant_does():
    scenario = operation(command_delay=0.0)
    model = linear_model(dataclasses.replace(scenario, start="hanging"), drive=True)
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
