"""Train a little, compare, report: the main job end to end, on the scenario whose optimum is known."""

from __future__ import annotations

import csv

import pytest

from agents.train import train
from baselines.bound import optimal_cost
from experiments.compare import compare
from heave_env.scenarios import load

N_SEAS = 64
T_3_SIGMA = 3.0 / 2.0
"""Three standard errors over the half-width of a 95 % interval of 64 seas (Student's t is 2.00)."""


@pytest.mark.training
def test_nobody_is_below_the_optimum_and_learning_beats_a_locked_winch(tmp_path):
    scenario = load("thesis_linear")
    run = train(
        scenario, algorithm="ppo", seed=0, total_steps=400_000, out=tmp_path / "agent", progress=False
    )
    folder = compare(
        [scenario], ["none", "lqr", "lqg", f"agent:{run}"], n_seeds=N_SEAS, out=tmp_path / "contest"
    )
    with (folder / "results.csv").open(newline="", encoding="utf-8") as file:
        cost = {row["controller"]: row for row in csv.DictReader(file) if row["metric"] == "cost"}
    assert {row["n_seas"] for row in cost.values()} == {str(N_SEAS)}
    optimum = optimal_cost(scenario)
    for name, row in cost.items():
        three_errors = T_3_SIGMA * 0.5 * (float(row["high"]) - float(row["low"]))
        assert float(row["value"]) > optimum - three_errors, f"{name} costs less than the proven optimum"
    assert float(cost["agent:agent"]["value"]) < 0.2 * float(cost["none"]["value"])
    assert float(cost["lqg"]["value"]) < 1.1 * optimum
    assert "agent:agent" in (folder / "report.html").read_text(encoding="utf-8")
