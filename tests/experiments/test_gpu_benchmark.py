"""The GPU's benchmark says what it measured, on what, and against which memory; not how fast it must be."""

import dataclasses
import json

import pytest

pytest.importorskip("warp")
pytest.importorskip("torch")

from experiments import gpu_benchmark
from experiments.cli import main
from heave_env.gpu.plant import GpuPlant
from heave_env.layout import N_CHANNELS
from heave_env.scenarios import load


def test_a_quick_benchmark_tells_device_and_share_of_the_roofline(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(gpu_benchmark, "BATCHES", {"cpu": (4,)})
    monkeypatch.setattr(gpu_benchmark, "ELEMENTS", (3,))
    path = tmp_path / "gpu.json"
    assert main(["bench", "--gpu", "cpu", "--quick", "--json", str(path)]) == 0
    printed = capsys.readouterr().out
    found = json.loads(path.read_text(encoding="utf-8"))
    assert "Device: no GPU: the processor" in printed
    assert found["is_gpu"] is False
    assert {item["figure"] for item in found["figures"]} == {
        "4 environments, 3 elements, float32",
        "4 environments, 3 elements, float64",
    }
    for item in found["figures"]:
        assert item["figure"] in printed
        share = item["value"] * item["bytes_per_step"] / found["copied_bytes_per_second"]
        assert item["of_roofline"] == pytest.approx(share)
        assert item["ratio"] == pytest.approx(item["value"] / item["yardstick_value"])


def test_a_device_that_is_not_there_is_refused(capsys):
    assert main(["bench", "--gpu", "tpu", "--quick"]) == 2
    assert "device must be one of" in capsys.readouterr().err


def test_the_least_traffic_counts_each_number_once():
    plain = load("sea_state_5")
    traffic = {}
    for n_elements in (20, 50):
        scenario = dataclasses.replace(plain, n_elements=n_elements)
        traffic[n_elements] = gpu_benchmark.least_traffic(
            GpuPlant(scenario, 1, device="cpu", dtype="float32")
        )
    # A node's displacement and velocity, in and out.
    assert traffic[50] - traffic[20] == 30 * 2 * 2 * 4
    nodes, filter_states, sensors, pending = 21, 8, 5, 2
    state = 2 * (2 * nodes + filter_states + N_CHANNELS)
    # Command and reward; samples out; those that the observation is made of in; the observation out.
    rest = 2 + sensors + (sensors + pending) + (sensors + pending)
    # Three counters, the rings' clock, the action; all in and out but the last.
    assert traffic[20] == 4 * (state + rest) + 2 * (3 * 8 + 4) + 4
