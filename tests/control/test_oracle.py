"""The oracle knows what each episode drew: it is lqg where nothing is drawn, and lqg for each draw."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from baselines.clairvoyant import clairvoyant_cost
from baselines.lqg import lqg
from baselines.oracle import drawn_parameters, oracle
from experiments.rollout import rollout
from heave_env.scenarios import load

SEEDS = [20_000_000, 20_000_001, 20_000_002]


@pytest.mark.parametrize("name", ["thesis_linear", "unknown_linear"])
def test_where_nothing_is_drawn_it_is_lqg(name):
    scenario = dataclasses.replace(load(name), uncertainty=())
    ours = rollout(scenario, oracle(scenario, SEEDS), SEEDS, duration=20.0)
    theirs = rollout(scenario, lqg(scenario), SEEDS, duration=20.0)
    for channel in ("command", "position_cost", "command_cost"):
        assert np.array_equal(ours.steps[channel], theirs.steps[channel])


def test_each_row_has_the_controller_of_its_draw():
    scenario = load("unknown_linear")
    together = rollout(scenario, oracle(scenario, SEEDS), SEEDS, duration=20.0)
    for row, (seed, values) in enumerate(zip(SEEDS, drawn_parameters(scenario, SEEDS), strict=True)):
        known = scenario.with_drawn(values)
        alone = rollout(known, lqg(known), [seed], duration=20.0)
        # Observations are scaled by other sizes, and rounded to single precision.
        assert together.steps["command"][:, row] == pytest.approx(alone.steps["command"][:, 0], abs=1e-4)


def test_who_knows_the_sea_knows_what_was_drawn():
    pytest.importorskip("clarabel")
    scenario = dataclasses.replace(load("unknown_linear"), duration=20.0)
    together = clairvoyant_cost(scenario, SEEDS[:2], warm_up=5.0)
    for seed, values, cost in zip(SEEDS, drawn_parameters(scenario, SEEDS[:2]), together, strict=False):
        alone = clairvoyant_cost(scenario.with_drawn(values), [seed], warm_up=5.0)
        assert cost == pytest.approx(alone[0], rel=1e-4)
    assert together[0] != pytest.approx(together[1], rel=0.05)


def test_progress_counts_the_seeds():
    counts: list[int] = []
    oracle(load("unknown_linear"), SEEDS, progress=counts.append)
    assert counts == [1, 1, 1]


def test_bad_input_is_refused():
    scenario = load("unknown_linear")
    with pytest.raises(ValueError, match="oracle, oracle_mpc"):
        oracle(scenario, SEEDS, design="pid")
    with pytest.raises(ValueError, match="got none"):
        oracle(scenario, [])
    with pytest.raises(ValueError, match="made for 3 seeds, got 1"):
        oracle(scenario, SEEDS).predict(np.zeros((1, len(scenario.observation_names))))
