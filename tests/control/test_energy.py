"""A price on the winch's work: what it charges, what it leaves alone, and who saves by it."""

from __future__ import annotations

import numpy as np
import pytest

from baselines import design
from baselines.bound import optimal_cost
from baselines.clairvoyant import clairvoyant_cost
from experiments.metrics import mean_cost, window
from experiments.rollout import rollout
from heave_env.plant import Plant, channel_names, simulate
from heave_env.scenarios import Scenario, load, with_value

SEEDS = list(range(20_000_000, 20_000_004))


def _costs(scenario: Scenario, name: str) -> np.ndarray:
    """Mean stage cost of 16 seas after the warm-up."""
    found = rollout(scenario, design(name, scenario), range(SEEDS[0], SEEDS[0] + 16))
    return mean_cost(found, window(scenario.duration, scenario.control_dt))


def _runs(scenario: Scenario, weight: float) -> tuple[Scenario, dict[str, np.ndarray]]:
    """An episode of a winch that moves to and fro under a task with that price."""
    priced = with_value(scenario, "task.energy_weight", weight)
    command = 0.4 * np.sin(1.3 * priced.control_dt * np.arange(600))
    return priced, simulate(priced, seeds=SEEDS, duration=60.0, commands=command)


@pytest.mark.parametrize("name", ["thesis_linear", "limits_linear", "sea_state_5", "snap", "hybrid"])
def test_the_price_charges_the_winch_and_changes_nothing_else(name: str) -> None:
    scenario = load(name)
    _, free = _runs(scenario, 0.0)
    _, charged = _runs(scenario, 3.0)
    assert "energy_cost" not in free
    assert charged.pop("energy_cost")[1:].max() > 0.0
    assert free.keys() == charged.keys()
    for channel, values in free.items():
        np.testing.assert_array_equal(values, charged[channel], err_msg=channel)


def test_a_linear_payload_is_charged_for_the_way_of_the_drum() -> None:
    # A delay of one and a half steps: the command changes within the step.
    scenario, run = _runs(with_value(load("thesis_linear"), "winch.command_delay", 0.15), 3.0)
    moved = 3.0 * np.abs(np.diff(run["winch_displacement"], axis=0)) / scenario.control_dt
    charged = run["energy_cost"][1:]
    turns = run["winch_rate"][1:] * run["winch_rate"][:-1] <= 0.0
    np.testing.assert_allclose(charged[~turns], moved[~turns], rtol=1e-9, atol=1e-12)
    assert turns.any()
    # Where the drum turns round within the step, both ways count.
    assert (charged[turns] >= moved[turns] * (1.0 - 1e-9)).all()
    assert (charged[turns] > moved[turns] * (1.0 + 1e-3)).any()


def test_a_cable_is_charged_for_force_times_speed() -> None:
    scenario, run = _runs(load("sea_state_5"), 3.0)
    work = 3.0 * np.abs(run["winch_power"][1:]) / scenario.static_tension
    charged = run["energy_cost"][1:]
    turns = run["winch_rate"][1:] * run["winch_rate"][:-1] <= 0.0
    np.testing.assert_allclose(charged[~turns], work[~turns], rtol=1e-9, atol=1e-12)
    assert (charged[turns] >= work[turns] * (1.0 - 1e-9)).all()


def test_the_reward_holds_the_price() -> None:
    scenario, run = _runs(load("energy_linear"), 40.0)
    assert "energy_cost" in channel_names(scenario)
    parts = run["position_cost"] + run["command_cost"] + run["failure_cost"] + run["energy_cost"]
    plant = Plant(scenario, len(SEEDS))
    plant.begin(np.ones(len(SEEDS), dtype=bool), np.array(SEEDS))
    for step in range(20):
        command = 0.4 * np.sin(1.3 * scenario.control_dt * step)
        plant.advance(np.full(len(SEEDS), command / scenario.winch.command_range))
        np.testing.assert_allclose(-plant.reward, parts[step + 1], rtol=1e-12)


def test_no_price_leaves_the_fingerprint_and_no_optimum_is_claimed_with_one() -> None:
    scenario = load("thesis_linear")
    assert with_value(scenario, "task.energy_weight", 0.0).fingerprint == scenario.fingerprint
    priced = with_value(scenario, "task.energy_weight", 1.0)
    assert priced.fingerprint != scenario.fingerprint
    assert optimal_cost(scenario) is not None
    assert optimal_cost(priced) is None


def test_a_negative_price_is_refused() -> None:
    with pytest.raises(ValueError, match="energy_weight"):
        with_value(load("energy_linear"), "task.energy_weight", -1.0)


def test_predictive_control_plans_with_the_tasks_price() -> None:
    pytest.importorskip("daqp")
    controller = design("mpc_l1", load("energy_linear"), command_weight=0.01)
    assert controller.energy_weight == 40.0
    assert controller.predicted_cost is None


@pytest.mark.slow
def test_who_plans_with_the_price_pays_less() -> None:
    """Tuned: mpc_l1 below lqg, and both above who knows the sea. Prints the mean costs."""
    pytest.importorskip("daqp")
    scenario = load("energy_linear")
    found = {name: _costs(scenario, name) for name in ("none", "lqg", "mpc_l1")}
    few = SEEDS[:2]
    known = clairvoyant_cost(scenario, few)
    for name, values in found.items():
        print(f"{name}: {values.mean():.4g} ± {1.96 * values.std(ddof=1) / np.sqrt(len(values)):.2g}")
    ratio = found["mpc_l1"].mean() / found["lqg"].mean()
    print(f"mpc_l1 over lqg: {ratio:.3f}; clairvoyant over mpc_l1 in {len(few)} seas: "
          f"{known.mean() / found['mpc_l1'][: len(few)].mean():.3f}")  # fmt: skip
    assert ratio < 0.92
    assert found["lqg"].mean() < 0.5 * found["none"].mean()
    assert (known < found["mpc_l1"][: len(few)]).all()
