"""Designs that model the sea work with any filter: LQG on its own plant costs what theory says."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import baselines
from baselines.bound import optimal_cost
from baselines.kalman import kalman_filter
from baselines.model import filter_state_sizes, nominal_sea, sea_filter
from heave_env.parameters import VesselTable
from heave_env.plant import Plant
from heave_env.scenarios import Scenario, load
from heave_env.vessel import boom_tip_filter

CRANE = VesselTable(heading=math.radians(150.0), boom_tip_x=-30.0, boom_tip_y=14.0)


def operation(order: int = 6, vessel: VesselTable | None = None, **sea) -> Scenario:
    base = load("thesis_linear")
    return dataclasses.replace(
        base,
        sea_state=dataclasses.replace(base.sea_state, filter="fitted", filter_order=order, **sea),
        vessel=base.vessel if vessel is None else None,
        vessel_table=vessel,
        winch=dataclasses.replace(base.winch, command_range=40.0),
        duration=300.0,
    )


def costs(scenario: Scenario, controller, n_envs: int = 1024) -> np.ndarray:
    """Average stage cost of each sea after 100 s, (n_envs,)."""
    plant = Plant(scenario, n_envs)
    plant.begin(np.ones(n_envs, dtype=bool), 20_000_000 + np.arange(n_envs))
    memory, total = None, np.zeros(n_envs)
    first = round(100.0 / scenario.control_dt)
    for step in range(scenario.n_steps):
        action, memory = controller.predict(plant.observation, memory)
        plant.advance(action[:, 0].astype(float))
        total -= plant.reward if step >= first else 0.0
    return total / (scenario.n_steps - first)


CASES = {
    **{f"bretschneider_{order}": operation(order) for order in (4, 6, 8)},
    "jonswap_8": operation(8, spectrum="jonswap"),
    **{f"table_{order}": operation(order, CRANE, spectrum="jonswap") for order in (4, 6, 8)},
}


@pytest.mark.parametrize("name", CASES)
def test_lqg_costs_what_theory_says_whatever_the_filter(name):
    scenario = CASES[name]
    controller = baselines.design("lqg", scenario)
    found = costs(scenario, controller)
    error = found.std(ddof=1) / math.sqrt(len(found))
    print(f"{name}: {found.mean():.5f} +- {error:.5f}, theory {controller.predicted_cost:.5f}")
    assert found.mean() == pytest.approx(controller.predicted_cost, abs=4.0 * error)
    assert error / found.mean() < 0.05
    # Trace formula and Lyapunov equation are two ways to the same number.
    assert optimal_cost(scenario) == pytest.approx(controller.predicted_cost, rel=1e-5)


@pytest.mark.parametrize("order", [4, 8, 12])
def test_the_kalman_filter_s_own_error_is_stationary(order):
    estimator = kalman_filter(operation(order))
    A, C = estimator.model.A, estimator.model.C
    closed = A @ (np.eye(len(A)) - estimator.gain @ C)
    assert np.abs(np.linalg.eigvals(closed)).max() < 1.0
    assert np.linalg.eigvalsh(estimator.posterior_covariance).min() > -1e-12


def test_the_full_state_of_a_fitted_filter_is_seen():
    scenario = dataclasses.replace(operation(8), information_set="full_state")
    assert scenario.observed_filter_states == 10
    controller = baselines.design("lqg", scenario)
    assert controller.n_memory == 0
    found = costs(scenario, controller)
    error = found.std(ddof=1) / math.sqrt(len(found))
    assert found.mean() == pytest.approx(controller.predicted_cost, abs=4.0 * error)
    assert found.mean() < baselines.design("lqg", operation(8)).predicted_cost


@pytest.mark.parametrize("vessel", [None, CRANE])
def test_a_random_phase_sea_is_modelled_by_the_filter_fitted_to_it(vessel):
    scenario = operation(6, vessel, kind="random_phase", spectrum="jonswap")
    sea = nominal_sea(scenario)
    assert (sea.kind, sea.filter, sea.spectrum) == ("shaping_filter", "fitted", "jonswap")
    model = sea_filter(scenario)
    expected = boom_tip_filter(operation(6, vessel, spectrum="jonswap").sea_state, scenario.boom_tip_vessel)
    assert np.array_equal(model.A, expected.A)
    assert len(filter_state_sizes(scenario)) == model.n_states
    controller = baselines.design("lqg", scenario)
    none = scenario.task.position_weight * scenario.uncontrolled_payload_std**2
    assert costs(scenario, controller, 16).mean() < 0.02 * none


def test_by_default_a_random_phase_sea_keeps_the_thesis_filter():
    assert nominal_sea(load("thesis_regulator")).filter == "thesis"
