"""Trainings: every algorithm, interruption and resumption to the bit, and learning itself."""

from __future__ import annotations

import csv
import dataclasses
import json
import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

import torch
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecMonitor

from agents import checkpoint, networks
from agents.guided_env import surroundings
from agents.policy import load_policy, policy_card, save_policy
from agents.presets import load_preset
from agents.train import Groundwork, TrainingFailure, build_model, groundwork, train, validation
from agents.vec_env import HeaveVecEnv, ScaledReward
from baselines import design
from heave_env import scenarios
from heave_env.controller import NoControl

ROOT = Path(__file__).resolve().parents[2]
SCENARIO = scenarios.load("thesis_linear")
QUICK = {
    "information_set": "sensors",
    "reference": None,
    "warm_start": False,
    "n_envs": 4,
    "hidden": [8],
    "critic_hidden": [8],
    "burn_in": 1.0,
    "mean_life": 200,
    "evaluate_every": 256,
    "evaluation_seas": 2,
    "evaluation_duration": 4.0,
    "checkpoint_every": 512,
    "log_every": 256,
}
PPO = {**QUICK, "total_steps": 1536, "learning_rate": 1e-3, "options": {"n_steps": 32, "n_minibatches": 2}}
RECURRENT = {**PPO, "options": {**PPO["options"], "lstm_hidden_size": 4}}
OFF = {
    **QUICK,
    "total_steps": 768,
    "critic_first": 256,
    "options": {"batch_size": 16, "train_freq": 8, "gradient_steps": 2},
}
SMALL = {"ppo": PPO, "recurrent_ppo": RECURRENT, "sac": OFF, "td3": OFF, "tqc": OFF}


def trained(folder: Path, algorithm: str = "ppo", **changes) -> Path:
    preset = {**SMALL[algorithm], **changes}
    return train(
        SCENARIO, algorithm=algorithm, seed=1, out=folder, preset=preset, progress=False, save_every=0.0
    )


def rows(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("algorithm", ["ppo", "sac", "td3", "tqc", "recurrent_ppo"])
def test_every_algorithm_trains_into_a_complete_folder(tmp_path, algorithm):
    folder = trained(tmp_path / "run", algorithm)
    run = json.loads((folder / "run.json").read_text())
    assert run["status"] == "finished" and run["steps"] >= SMALL[algorithm]["total_steps"]
    assert run["algorithm"] == algorithm and run["seed"] == 1
    assert scenarios.from_mapping(run["scenario"]).fingerprint == run["fingerprint"] == SCENARIO.fingerprint
    assert "numpy" in run["versions"]
    evaluations = rows(folder / "evaluations.csv")
    assert evaluations[0]["step"] == "0" and int(evaluations[-1]["step"]) == run["steps"]
    best = min(float(row["cost_mean"]) for row in evaluations)
    assert run["best"]["cost_mean"] == pytest.approx(best)
    curve = rows(folder / "progress.csv")
    assert [float(row["time/total_timesteps"]) for row in curve] == sorted(
        {float(row["time/total_timesteps"]) for row in curve}
    )
    assert list((folder / "tensorboard").glob("events.out.tfevents.*"))
    assert (folder / "checkpoints" / "policy-final.json").exists()
    assert not (folder / "resume").exists()
    card = (folder / "card.md").read_text()
    assert run["result"]["first_sea"] > 10_000_000 and f"{run['result']['cost_mean']:.4g}" in card
    for fact in (f"train('{SCENARIO.name}', algorithm='{algorithm}', seed=1", run["commit"], run["finished"]):
        assert fact in card
    policy = load_policy(folder, SCENARIO)
    assert policy.card["training"]["validation_cost"] == pytest.approx(best)
    load_policy(folder / "checkpoints" / "policy-final.json", SCENARIO)


@pytest.mark.parametrize("algorithm", ["ppo", "sac", "td3", "tqc", "recurrent_ppo"])
def test_plain_numpy_acts_as_stable_baselines_does(algorithm):
    settings = load_preset(algorithm, SCENARIO, {"n_envs": 2})
    env = ScaledReward(HeaveVecEnv(SCENARIO, 2, info=False), gamma=0.98)
    n = len(SCENARIO.observation_names)
    rng = np.random.default_rng(0)
    ground = Groundwork(rng.normal(0.0, 1.0, (n, n)), rng.normal(0.0, 0.3, n))
    model = build_model(settings, env, ground, seed=3)
    policy = networks.exported(model, policy_card(SCENARIO, algorithm=algorithm))
    observations = rng.normal(0.0, 3.0, (500, n)).astype(np.float32)
    expected, _ = model.predict(observations, deterministic=True)
    action, _ = policy.predict(observations)
    assert np.abs(action - expected).max() < 1e-5
    assert 0.1 < np.abs(action).mean() < 1.0


def test_plain_numpy_remembers_as_stable_baselines_does(tmp_path):
    settings = load_preset("recurrent_ppo", SCENARIO, {"n_envs": 2, "options": {"lstm_hidden_size": 12}})
    env = ScaledReward(HeaveVecEnv(SCENARIO, 2, info=False), gamma=0.98)
    n = len(SCENARIO.observation_names)
    rng = np.random.default_rng(0)
    ground = Groundwork(rng.normal(0.0, 1.0, (n, n)), rng.normal(0.0, 0.1, n))
    model = build_model(settings, env, ground, seed=3)
    with torch.no_grad():
        model.policy.get_submodule("action_net").weight.normal_(0.0, 0.2)
    save_policy(
        tmp_path / "policy.json",
        networks.exported(model, policy_card(SCENARIO, algorithm="recurrent_ppo")),
    )
    policy = load_policy(tmp_path, SCENARIO)
    assert policy.n_memory == 24
    theirs, ours = None, None
    alone = []
    for step in range(60):
        observation = rng.normal(0.0, 3.0, (7, n)).astype(np.float32)
        start = rng.random(7) < 0.1 if step else np.ones(7, dtype=bool)
        expected, theirs = model.predict(observation, theirs, start, deterministic=True)
        action, ours = policy.predict(observation, ours, start)
        assert np.abs(action - expected).max() < 1e-5
        alone.append(policy.predict(observation)[0] - action)
    assert np.abs(alone).max() > 0.05  # what it remembers matters


def test_beside_a_guide_an_agent_with_a_memory_acts_alone_as_it_was_trained(tmp_path):
    policy = load_policy(trained(tmp_path / "run", "recurrent_ppo", guide="lqg", guide_mode="residual"))
    assert policy.guide is not None and policy.n_memory == policy.guide.n_memory + 8
    (_, beside), (_, alone) = (
        surroundings(policy.scenario, 3, guide, privileged=False) for guide in (policy.guide, None)
    )
    beside.seed(9)
    alone.seed(9)
    seen, observation = np.asarray(beside.reset()), np.asarray(alone.reset())
    own, memory = np.zeros((3, 8)), None
    for _ in range(40):
        given, own = policy.respond(seen, own)
        action, memory = policy.predict(observation, memory)
        beside.step_async(given)
        alone.step_async(action)
        seen, observation = np.asarray(beside.step_wait()[0]), np.asarray(alone.step_wait()[0])
        np.testing.assert_allclose(seen[:, : observation.shape[1]], observation, atol=1e-5)
    np.testing.assert_allclose(memory[:, -8:], own, atol=1e-4)


def test_a_trained_policy_is_evaluated_by_stable_baselines(tmp_path):
    policy = load_policy(trained(tmp_path / "run"))
    env = VecMonitor(HeaveVecEnv(SCENARIO, 2, max_episode_steps=20))
    mean, _ = evaluate_policy(policy, env, n_eval_episodes=2)  # type: ignore[arg-type]
    assert np.isfinite(mean)


# Interruption ------------------------------------------------------------------------------------


def interrupt_at(monkeypatch: pytest.MonkeyPatch, step: int) -> None:
    """Raises Ctrl-C's signal once, when a state is first saved at or after a step."""
    save = checkpoint.save_state

    def saving(folder, arrays, content, at):
        save(folder, arrays, content, at)
        if at >= step:
            monkeypatch.setattr(checkpoint, "save_state", save)
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(checkpoint, "save_state", saving)
    monkeypatch.setattr("agents.train.SAVE_SHARE", 1e9)  # save at every turn, whatever it takes


def same_results(one: Path, other: Path, final: str = "checkpoints/policy-final") -> None:
    for name in ("policy.safetensors", "policy.json", f"{final}.safetensors"):
        assert (one / name).read_bytes() == (other / name).read_bytes(), name
    for name in ("evaluations.csv", "progress.csv"):
        ours, theirs = rows(one / name), rows(other / name)
        for row in (*ours, *theirs):
            for clock in ("wall_s", "time/wall_s"):
                row.pop(clock, None)
        assert ours == theirs, name


@pytest.mark.parametrize("algorithm", ["ppo", "sac", "td3", "tqc", "recurrent_ppo"])
def test_a_resumed_training_ends_with_the_same_bits(tmp_path, monkeypatch, algorithm):
    whole = trained(tmp_path / "whole", algorithm)
    interrupt_at(monkeypatch, SMALL[algorithm]["total_steps"] // 2)
    with pytest.raises(KeyboardInterrupt, match="goes on from there"):
        trained(tmp_path / "parts", algorithm)
    run = json.loads((tmp_path / "parts" / "run.json").read_text())
    assert run["status"] == "interrupted"
    assert 0 < run["steps"] < SMALL[algorithm]["total_steps"]
    np.random.seed(12345)  # noqa: NPY002  (a new process would not have these streams' state either)
    same_results(trained(tmp_path / "parts", algorithm), whole)


def in_a_process(folder: Path, algorithm: str, preset: dict) -> subprocess.Popen:
    """A training in a process of its own, which saves its state as often as it can."""
    program = (
        "import json, sys\n"
        "from agents.train import train\n"
        f"train({SCENARIO.name!r}, algorithm={algorithm!r}, seed=1, out=sys.argv[1],"
        " preset=json.loads(sys.argv[2]), progress=False, save_every=0.0)\n"
    )
    command = [sys.executable, "-c", program, str(folder), json.dumps(preset)]
    return subprocess.Popen(command, cwd=ROOT, env={**os.environ, "OMP_NUM_THREADS": "1"})


def killed_after(folder: Path, process: subprocess.Popen, watched: str, delay: float) -> bool:
    """Whether it was still at work when it was killed, some time after a file of its run was next written."""
    path = folder / watched
    before = path.stat().st_mtime_ns if path.exists() else 0
    begin = time.monotonic()
    while process.poll() is None and time.monotonic() - begin < 120.0:
        if path.exists() and path.stat().st_mtime_ns != before:
            time.sleep(delay)
            process.kill()
            break
        time.sleep(0.002)
    return process.wait() == -signal.SIGKILL


def test_a_killed_training_ends_with_the_same_bits(tmp_path):
    preset, folder = {**PPO, "total_steps": 4096}, tmp_path / "killed"
    assert killed_after(folder, in_a_process(folder, "ppo", preset), "resume/state.json", 0.0)
    whole = train(SCENARIO, seed=1, out=tmp_path / "whole", preset=preset, progress=False)
    same_results(train(SCENARIO, seed=1, out=folder, preset=preset, progress=False), whole)


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["ppo", "recurrent_ppo", "sac"])
def test_a_training_may_be_killed_at_any_moment(tmp_path, algorithm):
    """From before its first file on: whatever the moment, the same command ends with the same bits."""
    steps = {"ppo": 60_000, "recurrent_ppo": 30_000, "sac": 12_000}[algorithm]
    preset = {**SMALL[algorithm], "total_steps": steps, "evaluate_every": 4096, "checkpoint_every": 8192}
    folder, rng = tmp_path / "killed", np.random.default_rng()
    moments = [("run.json", 0.0), *(("run.json", rng.uniform(0.0, 3.0)) for _ in range(5))]
    killed = [
        killed_after(folder, in_a_process(folder, algorithm, preset), watched, delay)
        for watched, delay in moments
    ]
    print(f"{algorithm}: killed {sum(killed)} times, {[round(delay, 3) for _, delay in moments]} s into it")
    assert sum(killed) > 1
    assert in_a_process(folder, algorithm, preset).wait() == 0
    whole = train(SCENARIO, algorithm=algorithm, seed=1, out=tmp_path / "w", preset=preset, progress=False)
    same_results(folder, whole)


def interrupted(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    interrupt_at(monkeypatch, 256)
    with pytest.raises(KeyboardInterrupt):
        trained(folder)
    return folder


def test_the_state_holds_no_pickle(tmp_path, monkeypatch):
    def refused(function):
        def call(*args, **kwargs):
            # numba keeps compiled code in pickles of its own, beside its sources
            if not sys._getframe(1).f_globals["__name__"].startswith("numba"):
                raise AssertionError("pickle was used")
            return function(*args, **kwargs)

        return call

    for name in ("dump", "dumps", "load", "loads"):
        monkeypatch.setattr(pickle, name, refused(getattr(pickle, name)))
    for name in ("save", "load"):
        monkeypatch.setattr(torch, name, refused(getattr(torch, name)))
    folder = interrupted(tmp_path / "run", monkeypatch)
    suffixes = {
        path.suffix for path in folder.rglob("*") if path.is_file() and "tensorboard" not in path.parts
    }
    assert suffixes <= {".json", ".csv", ".safetensors", ""}
    trained(folder)


@pytest.mark.parametrize("damage", ["cut", "changed", "missing", "edited"])
def test_a_damaged_state_is_refused(tmp_path, monkeypatch, damage):
    folder = interrupted(tmp_path / "run", monkeypatch)
    state = folder / "resume" / "state.json"
    [arrays] = (folder / "resume").glob("arrays-*.safetensors")
    content = arrays.read_bytes()
    if damage == "cut":
        arrays.write_bytes(content[: len(content) // 2])
    elif damage == "changed":
        arrays.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    elif damage == "missing":
        arrays.unlink()
    else:
        state.write_text(state.read_text().replace('"wall"', '"wool"'))
    with pytest.raises(ValueError, match="cut short or changed"):
        trained(folder)


def test_a_finished_training_is_left_alone(tmp_path, capsys):
    folder = trained(tmp_path / "run")
    before = {
        path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file() and path.name != ".lock"
    }
    assert train(SCENARIO, seed=1, out=folder, preset=PPO) == folder
    assert "finished already" in capsys.readouterr().err
    assert before == {path: path.stat().st_mtime_ns for path in before}


def test_another_training_s_folder_is_refused(tmp_path):
    folder = trained(tmp_path / "run")
    with pytest.raises(ValueError, match=r"preset\.total_steps is 1536, not 2048"):
        trained(folder, total_steps=2048)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("Dear ...")
    with pytest.raises(ValueError, match=r"letter\.txt"):
        trained(tmp_path / "mine")


def test_two_trainings_do_not_share_a_folder(tmp_path):
    fcntl = pytest.importorskip("fcntl")
    (tmp_path / "run").mkdir()
    with (tmp_path / "run" / ".lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        with pytest.raises(ValueError, match="another process"):
            trained(tmp_path / "run")


@pytest.mark.parametrize(
    ("algorithm", "learning_rate"),
    [("ppo", 1e3), ("ppo", 1e9), ("ppo", 1e30), ("recurrent_ppo", 1e5), ("sac", 1e9), ("tqc", 1e12)],
)
def test_a_training_that_blows_up_stops_and_says_so(tmp_path, algorithm, learning_rate):
    with pytest.raises(TrainingFailure, match="learning_rate") as caught:
        trained(tmp_path / "run", algorithm, learning_rate=learning_rate)
    assert "\n" not in str(caught.value)
    run = json.loads((tmp_path / "run" / "run.json").read_text())
    assert run["status"] == "failed"
    load_policy(tmp_path / "run")


# Presets -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("algorithm", ["ppo", "sac", "td3", "tqc", "recurrent_ppo"])
@pytest.mark.parametrize("name", scenarios.names())
def test_every_scenario_has_a_preset(algorithm, name):
    assert load_preset(algorithm, scenarios.load(name)).total_steps > 0


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"learning_rat": 1.0}, "did you mean 'learning_rate'"),
        ({"learning_rate": -1.0}, "positive"),
        ({"hidden": []}, "positive whole numbers"),
        ({"information_set": "everything"}, "one of full_state"),
        ({"options": 3}, "mapping"),
        ({"n_envs": 0}, "at least 1"),
        ({"tension_cost": -1.0}, "tension_cost must be"),
        ({"tension_cost": 10.0}, "needs a cable, and the payload of 'thesis_linear' is linear"),
    ],
)
def test_bad_settings_are_refused(tmp_path, overrides, message):
    with pytest.raises(ValueError, match=message):
        train(SCENARIO, out=tmp_path / "run", preset=overrides, progress=False)
    assert not (tmp_path / "run").exists()


def test_bad_arguments_are_refused(tmp_path):
    with pytest.raises(ValueError, match="one of ppo"):
        train(SCENARIO, algorithm="dqn", out=tmp_path / "run")
    with pytest.raises(ValueError, match="seed must be"):
        train(SCENARIO, seed=-1, out=tmp_path / "run")
    with pytest.raises(ValueError, match="do not fit ppo"):
        trained(tmp_path / "run", options={"n_step": 3})
    trained(tmp_path / "run")  # the mistake left no run behind


# Learning ----------------------------------------------------------------------------------------


def seen(name: str, **changes):
    scenario = dataclasses.replace(scenarios.load(name), information_set="sensors_history")
    return scenario, load_preset("ppo", scenario, {"reference": "lqg", "warm_start": True, **changes})


def test_a_warm_start_holds_what_history_tells_of_a_controller_with_memory():
    scenario, settings = seen("thesis_regulator", n_envs=2, options={"n_minibatches": 1})
    ground = groundwork(scenario, settings, first_sea=0)
    env = ScaledReward(HeaveVecEnv(scenario, 2, info=False), gamma=0.98)
    start = networks.exported(
        build_model(settings, env, ground, seed=0), policy_card(scenario, algorithm="ppo")
    )
    scored = {"n_seas": 16, "duration": 100.0}
    cost, best = (
        validation(controller, scenario, **scored)["cost_mean"]
        for controller in (start, design("lqg", scenario))
    )
    assert cost < 1.1 * best


def test_a_warm_start_that_would_do_harm_is_left_out(caplog):
    # Payload sensors alone, and noisy: the reference leans on commands that the agent does not see.
    scenario, settings = seen("thesis_linear")
    ground = groundwork(scenario, settings, first_sea=0)
    assert not np.any(ground.gain)
    assert "doing nothing" in caplog.text


def test_whitened_observations_are_white():
    scenario, settings = seen("thesis_regulator", warm_start=False, excitation=0.1)
    ground = groundwork(scenario, settings, first_sea=0)
    n = len(scenario.observation_names)
    assert ground.transform.shape == (n, n)
    # Components are orthogonal, and of unit variance down to the floor.
    metric = ground.transform @ ground.transform.T
    assert np.abs(metric - np.diag(np.diag(metric))).max() < 1e-8 * np.abs(metric).max()


@pytest.mark.training
def test_a_short_training_from_nothing_beats_a_locked_winch(tmp_path):
    preset = {
        "information_set": "sensors",
        "warm_start": False,
        "reference": None,
        "feature_bound": 15.0,
        "learning_rate": 1e-3,
        "total_steps": 600_000,
        "n_envs": 64,
        "evaluate_every": 200_000,
        "options": {"log_std_init": -1.0},
    }
    folder = train(SCENARIO, seed=0, out=tmp_path / "run", preset=preset, progress=False)
    scored = {"n_seas": 32, "duration": 200.0}
    agent = validation(load_policy(folder), SCENARIO, **scored)
    locked = validation(NoControl(), SCENARIO, **scored)
    assert agent["cost_mean"] < 0.3 * locked["cost_mean"]
    assert agent["failed"] == 0.0
