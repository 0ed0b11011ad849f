"""The benchmark runs and says what it measured beside what; how fast is no test's business."""

from __future__ import annotations

import json
import time

import numpy as np
import pytest

from experiments import benchmark, machine
from experiments.cli import main
from heave_env.scenarios import load


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(benchmark, "BATCHES", (16,))
    monkeypatch.setattr(benchmark, "PPO_ENVS", 16)
    growth = {"elements": (5, 9), "environments": (1, 16), "solver steps": (1, 2)}
    monkeypatch.setattr(benchmark, "GROWTH", growth)


@pytest.mark.usefixtures("small")
def test_a_quick_benchmark_writes_every_figure(tmp_path, capsys):
    path = tmp_path / "bench.json"
    assert main(["bench", "--quick", "--json", str(path)]) == 0
    printed = capsys.readouterr().out
    found = json.loads(path.read_text(encoding="utf-8"))
    assert found["scenario"] == {"name": "sea_state_5", "fingerprint": load("sea_state_5").fingerprint}
    assert {"versions", "commit", "processor", "date", "command"} <= set(found["provenance"])
    assert len(found["figures"]) >= 8
    for item in found["figures"]:
        assert item["value"] > 0.0
        assert item["yardstick_value"] > 0.0
        assert item["figure"] in printed
        if item["unit"] != "share":
            assert item["ratio"] == pytest.approx(item["value"] / item["yardstick_value"])
        else:
            assert 0.0 < item["value"] < 1.0
    roofs = found["machine"]
    assert roofs["float64_flops"] > 0.0 and roofs["copied_bytes"] > 0.0
    assert roofs["share_of_flops"] == pytest.approx(roofs["kernel_flops"] / roofs["float32_flops"])
    assert 0.0 < found["start"]["import_seconds"] < found["start"]["first_step_seconds"]
    grown = {(item["against"], item["value"], item["face"]) for item in found["growth"]}
    assert len(grown) == len(found["growth"]) == 4 + 2 + 4
    assert all(item["nanoseconds"] > 0.0 for item in found["growth"])
    assert found["training"]["whole_steps"] >= 32_768 and found["training"]["best_cost"] > 0.0
    # The documentation's tables say the same, cell by cell as wide as their heads.
    lines = benchmark.markdown(found)
    for i, line in enumerate(lines):
        if line.startswith("|---"):
            assert line.count("---") == lines[i - 1].count("|") - 1 == lines[i + 1].count("|") - 1
    assert all(any(item["figure"] in line for line in lines) for item in found["figures"])


def test_steps_that_only_reset_a_row_are_not_counted():
    class Batch:
        """Half of the rows finish in every step."""

        num_envs = 4

        class action_space:
            @staticmethod
            def seed(value):
                pass

            @staticmethod
            def sample():
                return 0

        def __init__(self):
            self.steps = 0

        def reset(self, seed=None):
            return None, {}

        def step(self, action):
            self.steps += 1
            done = np.array([True, True, False, False])
            return None, None, done, np.zeros(4, dtype=bool), {}

    env = Batch()
    stepper = benchmark.batch(env)
    before = env.steps
    begin = time.perf_counter()
    speed = stepper(0.01)
    spent = time.perf_counter() - begin
    assert speed * spent == pytest.approx(2 * (env.steps - before), rel=0.5)


def test_chains_of_multiply_adds_are_counted_and_computed():
    for precision, lanes in (("float32", 4), ("float64", 2)):
        run = machine.chained(lanes, 3, precision)
        # Three chains from 1/2, 3/2 and 5/2, x <- x / 2 + 1 / 2 ... each tends to its fixed point, 1.
        assert run(0.5, 0) == 4.5
        assert run(0.5, 1) == pytest.approx(0.5 * 4.5 + 3 * 0.5)
        assert run(0.5, 60) == pytest.approx(3.0)
