"""PPO on the device learns, and what it saves is a policy like any other."""

import csv
import json
import os
import signal

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("warp")
pytest.importorskip("stable_baselines3")

from agents import checkpoint  # noqa: E402
from agents.on_device_ppo import (  # noqa: E402
    OnDevicePpo,
    RewardScale,
    Rollout,
    advantages,
    main,
    train_on_device,
)
from agents.policy import load_policy, save_policy  # noqa: E402
from agents.presets import load_preset  # noqa: E402
from agents.train import TrainingFailure, validation  # noqa: E402
from baselines import design  # noqa: E402
from heave_env.scenarios import load, with_value  # noqa: E402
from tests.agents.test_training import same_results  # noqa: E402

SMALL = {
    "n_envs": 16,
    "evaluation_seas": 2,
    "evaluation_duration": 5.0,
    "warm_start": False,
    "reference": None,
    "history_lags": [0, 1, 3],
    "options": {"n_steps": 8, "n_minibatches": 2},
}


def small(**changes):
    scenario = load("thesis_linear")
    settings = load_preset("ppo", scenario, {**SMALL, **changes})
    scenario = with_value(scenario, "information_set", "sensors_history")
    return with_value(scenario, "history_lags", [0, 1, 3]), settings


def test_a_saved_policy_acts_as_the_network_does(tmp_path):
    scenario, settings = small()
    training = OnDevicePpo(scenario, settings, device="cpu", seed=1)
    before = training.agent.output.weight.detach().clone()
    for _ in range(3):
        _, cut = training.learn()
        training.refresh(cut)
    assert training.steps == 3 * 16 * 8
    assert not torch.equal(before, training.agent.output.weight)
    save_policy(tmp_path / "policy.json", training.policy())
    policy = load_policy(tmp_path, scenario)
    observation = np.random.default_rng(0).standard_normal((64, policy.architecture.n_observations))
    given = torch.as_tensor(observation, dtype=torch.float32)
    with torch.no_grad():
        meant = torch.clamp(training.agent.mean(training.agent.features(given)), -1.0, 1.0)
    action, _ = policy.predict(observation)
    assert np.ptp(action) > 0.01
    assert np.allclose(action[:, 0], meant, rtol=0, atol=2e-6)


def test_a_run_leaves_its_policies_and_its_record(tmp_path, capsys):
    preset = tmp_path / "preset.yaml"
    preset.write_text(json.dumps({key: value for key, value in SMALL.items() if key != "n_envs"}))
    run = tmp_path / "run"
    command = ["thesis_linear", "--device", "cpu", "--steps", "256", "--envs", "16"]
    assert main([*command, "--preset", str(preset), "--out", str(run)]) == 0
    assert str(run) in capsys.readouterr().out
    content = json.loads((run / "run.json").read_text())
    assert (content["status"], content["steps"], content["device"]) == ("finished", 256, "cpu")
    with (run / "evaluations.csv").open() as file:
        costs = {int(row["step"]): float(row["cost_mean"]) for row in csv.DictReader(file)}
    assert list(costs) == [0, 256]
    best = load_policy(run)
    assert costs[best.card["training"]["steps"]] == min(costs.values())
    assert load_policy(run / "policy-final.json").card["training"]["steps"] == 256
    card = (run / "card.md").read_text()
    assert f"{content['result']['cost_mean']:.4g}" in card and "--envs 16" in card
    assert (run / "progress.csv").stat().st_size and list((run / "tensorboard").iterdir())
    assert not (run / "resume").exists()
    assert main([*command, "--preset", str(preset), "--out", str(run)]) == 0
    assert "finished already" in capsys.readouterr().err
    assert main([*command, "--preset", str(preset), "--out", str(run), "--seed", "1"]) == 2
    assert "holds another training: its seed is 0, not 1" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["hybrid", "--device", "cpu"], "Scenario.compensator must be null on a GPU"),
        (["thesis_linear", "--device", "tpu"], "device must be one of"),
        (["thesis_linear", "--device", "cpu", "--seed", "-1"], "seed must be a whole number from 0 to"),
    ],
)
def test_what_cannot_be_trained_is_refused_in_a_sentence(arguments, sentence, tmp_path, capsys):
    run = tmp_path / "run"
    assert main([*arguments, "--out", str(run)]) == 2
    assert sentence in capsys.readouterr().err
    assert not run.exists()


def test_the_task_goes_on_beyond_the_clock_and_ends_at_a_failure():
    rollout = Rollout.empty(3, 3, 1, torch.device("cpu"))
    rollout.value[:] = torch.tensor([[1.0, 1.0, 1.0], [2.0, 2.0, 2.0], [3.0, 3.0, 3.0]])
    rollout.truncated[1, 1] = rollout.terminated[1, 2] = True
    reward, gamma, share = torch.tensor([[0.5], [0.25], [1.0]]).expand(3, 3), 0.9, 0.8
    last, final = torch.full((3,), 4.0), torch.full((3,), 10.0)
    found = advantages(rollout, reward, last, final, gamma, share)
    end = 1.0 + gamma * 4.0 - 3.0
    middle = (0.25 + gamma * 3.0 - 2.0 + gamma * share * end, 0.25 + gamma * 10.0 - 2.0, 0.25 - 2.0)
    expected = [[0.5 + gamma * 2.0 - 1.0 + gamma * share * later for later in middle], middle, [end] * 3]
    assert torch.allclose(found, torch.tensor(expected))


def test_rewards_are_centred_and_scaled_but_for_the_burn_in():
    _, settings = small(reward_horizon=50.0, gamma=0.5, reward_bound=4.0)
    scale = RewardScale(settings, 256, torch.device("cpu"))
    generator = torch.Generator().manual_seed(0)
    counted = torch.ones(64, 256, dtype=torch.bool)
    counted[:, :100] = False
    for _ in range(8):
        reward = -300.0 + 7.0 * torch.randn(64, 256, generator=generator)
        scaled, cut = scale.scaled(reward, counted, torch.zeros_like(counted))
    assert float(scale.mean) == pytest.approx(-300.0, abs=0.5)
    assert not scaled[:, :100].any()
    kept = scaled[:, 100:]
    # Over the deviation of their discounted sum: sqrt(1 - gamma²) of their own.
    assert float(kept.mean()) == pytest.approx(0.0, abs=0.05)
    assert float(kept.std()) == pytest.approx((1.0 - 0.5**2) ** 0.5, rel=0.05)
    assert not cut.any()


def test_a_folder_that_holds_something_is_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(ValueError, match="holds files but no run"):
        train_on_device("thesis_linear", device="cpu", out=tmp_path)


def whole_training(folder, **changes):
    preset = {**SMALL, "evaluate_every": 256, "log_every": 128, **changes}
    return train_on_device(
        "thesis_linear",
        device="cpu",
        seed=1,
        total_steps=1024,
        out=folder,
        preset=preset,
        n_envs=16,
        progress=False,
        save_every=0.0,
    )


def interrupt_at(monkeypatch, step):
    """Ctrl-C's signal once a state of that step has been saved; the state is saved after every update."""
    monkeypatch.setattr("agents.on_device_ppo.SAVE_SHARE", 1e9)
    save = checkpoint.save_state

    def saving(folder, arrays, content, at):
        save(folder, arrays, content, at)
        if at >= step:
            monkeypatch.setattr(checkpoint, "save_state", save)
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(checkpoint, "save_state", saving)


def test_a_resumed_training_ends_with_the_same_bits(tmp_path, monkeypatch):
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        whole = whole_training(tmp_path / "whole")
        interrupt_at(monkeypatch, 512)
        with pytest.raises(KeyboardInterrupt, match="goes on from there"):
            whole_training(tmp_path / "parts")
        content = json.loads((tmp_path / "parts" / "run.json").read_text())
        assert content["status"] == "interrupted" and 0 < content["steps"] < 1024
        torch.manual_seed(12345)  # a new process would not have this stream's state either
        same_results(whole_training(tmp_path / "parts"), whole, final="policy-final")
    finally:
        torch.set_num_threads(threads)


def test_a_damaged_state_is_refused(tmp_path, monkeypatch):
    interrupt_at(monkeypatch, 256)
    with pytest.raises(KeyboardInterrupt):
        whole_training(tmp_path / "run")
    [arrays] = (tmp_path / "run" / "resume").glob("arrays-*.safetensors")
    arrays.write_bytes(arrays.read_bytes()[:-100])
    with pytest.raises(ValueError, match="cut short or changed"):
        whole_training(tmp_path / "run")


def test_weights_that_stop_being_finite_end_it_in_a_sentence(tmp_path):
    with pytest.raises(TrainingFailure, match="train with a lower learning_rate"):
        whole_training(tmp_path / "run", learning_rate=1e9)
    assert json.loads((tmp_path / "run" / "run.json").read_text())["status"] == "failed"
    assert load_policy(tmp_path / "run").card["training"]["steps"] == 0


def test_a_guide_is_refused_on_the_device(tmp_path):
    with pytest.raises(ValueError, match="preset key 'guide' is not for a training on the device"):
        whole_training(tmp_path / "run", guide="lqg")
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
@pytest.mark.training
def test_it_learns_to_hold_the_payload_still(tmp_path):
    run = train_on_device("thesis_linear", device="cpu", total_steps=600_000, out=tmp_path, progress=False)
    policy = load_policy(run)
    numbers = {"n_seas": 32, "duration": 200.0, "first_sea": 20_000_000}
    trained = validation(policy, policy.scenario, **numbers)["cost_mean"]
    idle = validation(design("none", policy.scenario), policy.scenario, **numbers)["cost_mean"]
    print(f"cost {trained:.3g} after training, {idle:.3g} without a controller")
    assert trained < 0.02 * idle
