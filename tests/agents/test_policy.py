"""Saved policies: what they compute, and what loading refuses."""

from __future__ import annotations

import dataclasses
import json
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("safetensors")

from agents.policy import Architecture, TrainedPolicy, load_policy, policy_card, save_policy, seen_by
from heave_env import scenarios
from heave_env.env import HeaveVectorEnv

SCENARIO = scenarios.load("sea_state_5")
N = len(SCENARIO.observation_names)


def small_policy(output: str = "clip", seed: int = 0) -> TrainedPolicy:
    architecture = Architecture(
        n_observations=N, feature_bound=5.0, hidden=(8, 6), activation="tanh", output=output
    )
    rng = np.random.default_rng(seed)
    weights = {
        name: rng.normal(0.0, 0.3, shape).astype(np.float32) for name, shape in architecture.shapes.items()
    }
    return TrainedPolicy(architecture, weights, policy_card(SCENARIO, algorithm="ppo"))


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    save_policy(tmp_path / "policy.json", small_policy())
    return tmp_path


def observations(n: int = 40) -> np.ndarray:
    return np.random.default_rng(1).normal(0.0, 1.0, (n, N)).astype(np.float32)


def test_a_policy_comes_back_as_it_was(saved):
    expected, memory = small_policy().predict(observations())
    for path in (saved, saved / "policy.json", saved / "policy.safetensors"):
        loaded = load_policy(path, SCENARIO)
        action, memory = loaded.predict(observations())
        np.testing.assert_array_equal(action, expected)
        assert memory is None and action.shape == (40, 1) and action.dtype == np.float32
    assert loaded.name == "ppo"
    assert loaded.information_set == "sensors"
    assert loaded.measures == tuple(sensor.channel for sensor in SCENARIO.sensors)


def test_actions_keep_to_their_range_and_one_observation_gives_one_action(saved):
    policy = load_policy(saved)
    action, _ = policy.predict(100.0 * observations())
    assert np.abs(action).max() == 1.0
    single, _ = policy.predict(observations()[0])
    assert single.shape == (1,)
    assert single == pytest.approx(policy.predict(observations()[:1])[0][0], abs=1e-6)


def test_saving_leaves_no_temporary_files(saved):
    assert sorted(path.name for path in saved.iterdir()) == ["policy.json", "policy.safetensors"]


def refusal(path: Path, scenario=None) -> str:
    with pytest.raises(ValueError) as caught:
        load_policy(path, scenario)
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_missing_files_are_named(saved):
    assert "no trained policy" in refusal(saved / "nowhere")
    (saved / "policy.safetensors").unlink()
    assert "lacks its weights file" in refusal(saved)


@pytest.mark.parametrize("name", ["policy.json", "policy.safetensors"])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.99])
def test_files_cut_short_are_refused(saved, name, share):
    content = (saved / name).read_bytes()
    (saved / name).write_bytes(content[: int(share * len(content))])
    assert "cut short" in refusal(saved)


def test_a_changed_weight_is_refused(saved):
    content = bytearray((saved / "policy.safetensors").read_bytes())
    content[-1] ^= 1
    (saved / "policy.safetensors").write_bytes(bytes(content))
    assert "hash" in refusal(saved)


@pytest.mark.parametrize("key", ["algorithm", "scenario", "architecture", "observation_names"])
def test_a_changed_description_is_refused(saved, key):
    content = json.loads((saved / "policy.json").read_text())
    if key == "scenario":
        content[key]["control_dt"] = 0.2
    elif key == "architecture":
        content[key]["feature_bound"] = 6.0
    else:
        content[key] = content[key][::-1]
    (saved / "policy.json").write_text(json.dumps(content))
    assert "changed" in refusal(saved)


def test_another_policy_s_weights_are_refused(saved, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    save_policy(other / "policy.json", small_policy(seed=5))
    (saved / "policy.safetensors").write_bytes((other / "policy.safetensors").read_bytes())
    assert "hash" in refusal(saved)


def test_weights_outside_the_folder_are_refused(saved):
    content = json.loads((saved / "policy.json").read_text())
    content["weights"] = "../policy.safetensors"
    (saved / "policy.json").write_text(json.dumps(content))
    assert "beside it" in refusal(saved)


def test_other_files_are_refused(saved):
    (saved / "policy.json").write_bytes(pickle.dumps({"format": "heave_env policy 1"}))
    refusal(saved)
    (saved / "policy.json").write_text("[]")
    assert "is not a policy" in refusal(saved)


def test_another_scenario_is_refused_unless_allowed(saved):
    rougher = scenarios.with_value(SCENARIO, "sea_state.significant_wave_height", 4.0)
    assert "was trained in scenario 'sea_state_5'" in refusal(saved, rougher)
    assert load_policy(saved, rougher, allow_other_scenario=True).information_set == "sensors"
    with pytest.raises(ValueError, match="cannot act"):
        load_policy(saved, scenarios.load("thesis_linear"), allow_other_scenario=True)


def test_the_information_set_of_the_caller_does_not_matter(saved):
    full = dataclasses.replace(SCENARIO, information_set="full_state")
    policy = load_policy(saved, full)
    assert seen_by(policy, full).information_set == "sensors"


def test_the_length_of_an_episode_and_a_new_name_do_not_matter(saved):
    longer = dataclasses.replace(SCENARIO, duration=800.0, name="mine")
    assert load_policy(saved, longer).predict(observations())[0].shape == (40, 1)


def test_in_another_scenario_a_policy_reads_and_commands_the_same_si_values(saved):
    policy = load_policy(saved)
    other = scenarios.with_value(SCENARIO, "sea_state.significant_wave_height", 4.0)
    other = scenarios.with_value(other, "winch.command_range", 3.0)
    adapted = policy.acting_in(other)
    here = 0.2 * observations()
    scale_here = np.array([sensor.scale for sensor in SCENARIO.observed_sensors] + [2.0] * SCENARIO.n_pending)
    scale_there = np.array([sensor.scale for sensor in other.observed_sensors] + [3.0] * SCENARIO.n_pending)
    there = here * scale_here / scale_there
    command = 2.0 * policy.predict(here)[0]
    assert 3.0 * adapted.predict(there)[0] == pytest.approx(command, abs=1e-4)


def with_memory(scenario=SCENARIO, **facts) -> TrainedPolicy:
    n = len(scenario.observation_names)
    architecture = Architecture(
        n_observations=n, feature_bound=5.0, hidden=(8,), activation="tanh", output="clip", memory=5
    )
    rng = np.random.default_rng(0)
    weights = {
        name: rng.normal(0.0, 0.3, shape).astype(np.float32) for name, shape in architecture.shapes.items()
    }
    return TrainedPolicy(architecture, weights, policy_card(scenario, algorithm="recurrent_ppo", **facts))


def test_a_policy_with_a_memory_hands_it_out_and_takes_it_back(tmp_path):
    save_policy(tmp_path / "policy.json", with_memory())
    policy = load_policy(tmp_path, SCENARIO)
    first, later = observations(6), observations(12)[6:]
    _, memory = policy.predict(first)
    assert memory.shape == (6, policy.n_memory) and policy.n_memory == 10
    action, _ = policy.predict(later, memory)
    assert np.abs(action - policy.predict(later)[0]).max() > 1e-3
    # One environment is a batch of one; rows that begin afresh have forgotten.
    single, own = policy.predict(first[2])
    assert single.shape == (1,) and own.shape == (1, 10)
    np.testing.assert_allclose(policy.predict(later[2], own)[0], action[2], atol=1e-6)
    start = np.array([True, False, False, True, False, False])
    mixed, _ = policy.predict(later, memory, start)
    np.testing.assert_allclose(mixed[start], policy.predict(later)[0][start], atol=1e-6)
    np.testing.assert_array_equal(mixed[~start], action[~start])


def test_the_file_of_a_policy_without_a_memory_does_not_speak_of_one(saved):
    assert "memory" not in json.loads((saved / "policy.json").read_text())["architecture"]
    with pytest.raises(ValueError, match="memory must be a whole number"):
        dataclasses.replace(small_policy().architecture, memory=-1)


def test_the_wrong_number_of_observations_is_explained(saved):
    with pytest.raises(ValueError, match="information_set='sensors'"):
        load_policy(saved).predict(np.zeros((3, N + 1)))


def test_it_drives_the_environment(saved):
    policy = load_policy(saved, SCENARIO)
    env = HeaveVectorEnv(SCENARIO, 2, information_set=policy.information_set)
    observation, _ = env.reset(seed=0)
    for _ in range(5):
        observation, reward, *_ = env.step(policy.predict(observation)[0])
    assert np.all(np.isfinite(reward))


def test_neither_torch_nor_pickle_is_used(saved):
    program = (
        "import pickle, sys\n"
        "def refuse(*args, **kwargs): raise SystemExit('unpickled')\n"
        "pickle.load = pickle.loads = pickle.Unpickler = refuse\n"
        "import numpy as np\n"
        "from agents.policy import load_policy\n"
        f"policy = load_policy({str(saved)!r})\n"
        f"policy.predict(np.zeros((1, {N})))\n"
        "assert 'torch' not in sys.modules and 'stable_baselines3' not in sys.modules\n"
    )
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=root, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_a_policy_acts_on_variants_of_its_scenario_as_it_is(saved):
    met = scenarios.load("sea_state_5@rougher@later")
    policy = load_policy(saved, met)
    np.testing.assert_array_equal(
        policy.predict(observations())[0], small_policy().predict(observations())[0]
    )
    # What is known has changed, not only the plant: another scenario.
    slower = scenarios.with_value(met, "winch.time_constant", 2.0)
    assert "was trained in scenario 'sea_state_5'" in refusal(saved, slower)


def test_a_policy_of_a_variant_belongs_there(tmp_path):
    met = scenarios.load("sea_state_5@rougher")
    bare = small_policy()
    save_policy(
        tmp_path / "policy.json",
        TrainedPolicy(bare.architecture, bare.weights, policy_card(met, algorithm="ppo")),
    )
    assert load_policy(tmp_path, met).scenario == met
    assert "was trained in scenario 'sea_state_5@rougher'" in refusal(tmp_path, SCENARIO)


def test_comparison_of_a_variant_takes_the_scenario_s_policy_and_designs(saved, tmp_path):
    from experiments.compare import compare

    names = ("sea_state_5", "sea_state_5@rougher")
    chosen = [scenarios.load(name) for name in names]
    out = compare(chosen, ["none", f"agent:{saved}"], n_seeds=2, out=tmp_path / "runs", duration=20.0)
    table = (out / "results.csv").read_text(encoding="utf-8")
    assert all(f"\n{name},none,cost" in table for name in names)
    assert (out / "report.html").stat().st_size > 10_000
