"""The benchmark runs and says what it measured beside what; how fast is no test's business."""

from __future__ import annotations

import json
import time

import numpy as np
import pytest

from experiments import benchmark
from experiments.cli import main
from heave_env.scenarios import load


def test_a_quick_benchmark_writes_every_figure(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(benchmark, "BATCHES", (16,))
    monkeypatch.setattr(benchmark, "PPO_ENVS", 16)
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
