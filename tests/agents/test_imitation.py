"""Imitation: students with and without a memory, the taking over, rounds that survive a kill."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

import torch

from agents import imitation
from agents.guided_env import surroundings
from agents.policy import load_policy
from agents.presets import load_preset
from agents.teachers import school
from agents.train import Groundwork, build_model, first_training_sea, train, validation
from agents.vec_env import HeaveVecEnv, ScaledReward
from baselines import design
from baselines.oracle import oracle
from heave_env import scenarios
from tests.agents.test_training import PPO, RECURRENT

LINEAR = scenarios.load("thesis_linear")
LIMITS = scenarios.load("limits_linear")
UNKNOWN = scenarios.load("unknown_linear")
# Short rounds of few seas, and a network with a memory that imitates and nothing else.
FEW = {"lessons": 3, "lesson_seas": 32}
SMALL = {"ROUND_STEPS": 200, "BATCH": 64, "SEQUENCES": 8, "CHUNK": 50, "SETTLING": 20}
TAUGHT = {
    **RECURRENT,
    "total_steps": 0,
    "teacher": "lqg",
    **FEW,
    "take_over": 0.3,
    "excitation": 0.01,
    "information_set": "sensors_history",
    "history_lags": [0, 1, 2, 4],
    "options": {**RECURRENT["options"], "lstm_hidden_size": 16},
}


@pytest.fixture
def small(monkeypatch):
    for name, value in SMALL.items():
        monkeypatch.setattr(imitation, name, value)


def start_of(folder: Path) -> float:
    """Cost at step 0, that of the imitation."""
    with (folder / "evaluations.csv").open() as file:
        return float(next(csv.DictReader(file))["cost_mean"])


def taught(folder: Path, scenario=LIMITS, **changes) -> Path:
    preset = {**TAUGHT, **changes}
    return train(scenario, algorithm="recurrent_ppo", seed=1, out=folder, preset=preset, progress=False)


def test_a_miss_that_changes_nothing_does_not_count():
    action = torch.tensor([0.1, 0.5, -0.5, 0.4, 0.2, -0.6, -0.2])
    wanted = torch.tensor(
        [[0, 0, 0, 0.3], [0, 0, 0, 0.3], [0, 0, 0, 0.3], [0.3, 0, 1, 0], [0.3, 0, 1, 0], [-0.5, 1, 0, 0],
         [-0.5, 1, 0, 0]]
    )  # fmt: skip
    missed = imitation._missed(action, wanted)
    np.testing.assert_allclose(missed.numpy(), [0.0, 0.2, -0.2, 0.0, -0.1, 0.0, 0.3], atol=1e-6)


def test_a_teacher_is_imitated(tmp_path, small):
    """A small network that began as nothing does nearly as its teacher, and training goes on from there."""
    preset = dict(
        PPO,
        privileged_critic=True,
        guide="mpc",
        guide_mode="rate",
        guide_reach=1.0,
        teacher="mpc",
        warm_start=False,
        lessons=3,
    )
    folder = train(LINEAR, out=tmp_path / "run", preset=preset, progress=False)
    run = json.loads((folder / "run.json").read_text())
    assert run["imitation"]["teacher"]["controller"] == "mpc" and run["imitation"]["left"] < 0.01
    policy = load_policy(folder, LINEAR)
    best = validation(policy.guide.controller, policy.scenario, n_seas=8, duration=100.0)["cost_mean"]
    nothing = LINEAR.uncontrolled_cost
    assert start_of(folder) < best + 0.05 * (nothing - best)


def test_an_oracle_teaches_each_row_by_what_it_drew():
    """Told what it says itself, it is the oracle."""
    scenario = scenarios.with_value(scenarios.load("unknown_linear"), "duration", 60.0)
    seeds = range(40, 44)
    teacher = school("oracle", scenario).teacher(seeds)
    _, env = surroundings(scenario, 4, None, privileged=False)
    env.seed(seeds[0])
    seen, alone = np.asarray(env.reset()), oracle(scenario, seeds)
    memory, others = np.zeros((4, teacher.n_memory)), None
    for _ in range(50):
        look = teacher.look(seen, memory)
        action, others = alone.predict(seen, others)
        np.testing.assert_allclose(look.command[:, 0] / scenario.winch.command_range, action[:, 0], atol=1e-6)
        env.step_async(action)
        memory = teacher.advance(memory, look, look.command)
        seen = np.asarray(env.step_wait()[0])
    assert np.ptp(look.command) > 0.01


def test_a_memory_is_taught(tmp_path, small):
    """Nothing but sensors, whose noise hides the rest: without its memory the student would not do."""
    folder = taught(tmp_path / "run", lessons=4, lesson_epochs=8)
    run = json.loads((folder / "run.json").read_text())
    assert run["steps"] == 0 and run["status"] == "finished" and run["imitation"]["left"] < 0.3
    assert not (folder / "lessons").exists()
    policy = load_policy(folder, LIMITS)
    assert policy.n_memory == 32 and policy.guide is None
    best = validation(design("lqg", LIMITS), LIMITS, n_seas=8, duration=100.0)["cost_mean"]
    own = validation(policy, policy.scenario, n_seas=8, duration=100.0)["cost_mean"]
    print(f"student {own:.2f}, teacher {best:.2f}, nothing {LIMITS.uncontrolled_cost:.2f}")
    assert own < best + 0.25 * (LIMITS.uncontrolled_cost - best)


class _Killed(Exception):
    """Stands for the end of a process."""


def killed_in_round(monkeypatch, turn: int, what: str) -> None:
    """Ends an imitation within a round: while it drives, while it fits, or between its two files."""
    original, module = getattr(imitation, what), imitation
    calls = []

    def dying(*args, **kwargs):
        calls.append(None)
        if len(calls) == turn:
            raise _Killed
        return original(*args, **kwargs)

    monkeypatch.setattr(module, what, dying)


@pytest.mark.parametrize("student", ["memory", "none"])
def test_an_imitation_goes_on_after_its_last_round_to_the_same_bits(tmp_path, small, monkeypatch, student):
    few = {**FEW, "lesson_epochs": 1, "repeat_worst": 0.5, "lessons": 5}
    algorithm, preset = "recurrent_ppo", {**TAUGHT, **few}
    if student == "none":
        algorithm, preset = "ppo", {**PPO, **few, "teacher": "lqg", "total_steps": 0}

    def once(folder: Path) -> Path:
        return train(LINEAR, algorithm=algorithm, seed=2, out=folder, preset=preset, progress=False)

    whole = once(tmp_path / "whole")
    for turn, what in ((1, "_fit"), (5, "_gather"), (4, "_keep")):
        killed = tmp_path / f"{turn}{what}"
        with monkeypatch.context() as patched:
            killed_in_round(patched, turn, what)
            with pytest.raises(_Killed):
                once(killed)
        assert len(list((killed / "lessons").glob("lesson-*"))) == turn - 1
        with monkeypatch.context() as patched:
            gathered = []
            gather = imitation._gather
            patched.setattr(
                imitation,
                "_gather",
                lambda *args, seen=gathered, gather=gather: (seen.append(args[5]), gather(*args)),
            )
            once(killed)
        assert len(gathered) == 5 - (turn - 1)
        first = min(sea for sea in gathered[-1])
        assert first < 2000 + 4 * few["lesson_seas"]  # a sea of an earlier round is among those of the last
        for name in ("policy.safetensors", "policy.json"):
            assert (killed / name).read_bytes() == (whole / name).read_bytes()


def test_a_damaged_lesson_is_refused_in_a_sentence(tmp_path, small, monkeypatch):
    with monkeypatch.context() as patched:
        killed_in_round(patched, 3, "_gather")
        with pytest.raises(_Killed):
            taught(tmp_path / "run")
    path = tmp_path / "run" / "lessons" / "lesson-01.safetensors"
    path.write_bytes(path.read_bytes()[:-5])
    with pytest.raises(ValueError, match=r"lesson-01.*cut short or changed.*delete the folder"):
        taught(tmp_path / "run")


def test_the_teacher_takes_over_where_the_agent_misses_it(small, tmp_path):
    """With any miss too large the teacher alone drives; with none too large the first round alone."""
    for limit, share in ((1e-9, (0.99, 1.0)), (None, (0.0, 0.0))):
        folder = taught(tmp_path / str(limit), take_over=limit, lessons=2)
        taken = json.loads((folder / "run.json").read_text())["imitation"]["taken_over"]
        assert share[0] <= taken <= share[1]


def test_a_lesson_that_ended_early_leaves_the_others_whole(small):
    """What lies behind its end in another lesson is still learned from."""
    settings = load_preset("recurrent_ppo", LINEAR, RECURRENT)
    env = ScaledReward(HeaveVecEnv(LINEAR, settings.n_envs, info=False), gamma=0.98)
    n = len(LINEAR.observation_names)
    model = build_model(settings, env, Groundwork(np.eye(n), np.zeros(n)), seed=0)
    rng = np.random.default_rng(0)

    def lesson(n_steps: int, first: int) -> imitation.Lesson:
        shape = (n_steps, 8)
        seen, wanted = rng.normal(size=(*shape, n)), np.zeros((*shape, 4))
        wanted[..., 0] = rng.normal(0.0, 0.1, shape)
        counts = np.broadcast_to((np.arange(n_steps) >= first)[:, None], shape).copy()
        return imitation.Lesson(seen.astype(np.float32), wanted.astype(np.float32), counts)

    course = imitation.Course(rng, torch.Generator().manual_seed(0), [lesson(120, 60), lesson(20, 20)])
    before = model.policy.action_net.weight.detach().clone()
    imitation._fit(model, course, 1)
    assert not torch.equal(before, model.policy.action_net.weight)


def test_no_two_seeds_are_taught_in_one_sea():
    settings = load_preset("recurrent_ppo", UNKNOWN, "taught")
    taught = settings.lessons * settings.lesson_seas
    assert first_training_sea(1, settings) - first_training_sea(0, settings) >= taught > 1000
    assert first_training_sea(3, load_preset("ppo", LIMITS, "rate")) == 3000


def test_a_training_of_nothing_is_refused():
    with pytest.raises(ValueError, match="total_steps must be positive without a teacher"):
        load_preset("ppo", LINEAR, {"total_steps": 0})


def test_an_imitation_in_which_nothing_lasts_is_refused(tmp_path, small, monkeypatch):
    """Every sea fails before anything is learned from."""
    step_wait = HeaveVecEnv.step_wait

    def failing(self):
        seen, reward, done, infos = step_wait(self)
        for row in np.flatnonzero(~done):
            infos[row]["terminal_observation"] = seen[row]
        return seen, reward, np.ones_like(done), infos

    with monkeypatch.context() as patched:
        patched.setattr("agents.train.ScaledReward.step_wait", failing, raising=False)
        patched.setattr(HeaveVecEnv, "step_wait", failing)
        preset = {**PPO, **FEW, "teacher": "lqg", "total_steps": 0}
        with pytest.raises(ValueError, match="the operation failed within 2 s"):
            train(LIMITS, seed=1, out=tmp_path / "run", preset=preset, progress=False)


@pytest.mark.slow
def test_the_imitated_plan_costs_nearly_what_the_plan_costs(tmp_path):
    """On `limits_linear`, where the tuned predictive controller costs six tenths of the tuned lqg."""
    preset = {**load_preset("ppo", LIMITS, "rate").to_mapping(), "total_steps": 16_384}
    preset.pop("algorithm")
    folder = train(LIMITS, out=tmp_path / "run", preset=preset, progress=False)
    start = start_of(folder)
    policy = load_policy(folder, LIMITS)
    plan, lqg = (
        validation(controller, policy.scenario, n_seas=32, duration=200.0)["cost_mean"]
        for controller in (policy.guide.controller, design("lqg", policy.scenario))
    )
    print(f"imitation {start:.3f}, mpc {plan:.3f}, lqg {lqg:.3f}")
    assert start < 1.12 * plan and start < 0.72 * lqg


@pytest.mark.slow
def test_a_memory_finds_out_what_was_drawn(tmp_path):
    """Seeing sensors alone, where all is drawn anew in each sea, it does what no fixed controller can.

    Half the lessons of the preset; `tests/agents/test_zoo.py` has what all of them come to.
    """
    preset = {**load_preset("recurrent_ppo", UNKNOWN, "taught").to_mapping(), "lessons": 7}
    preset.pop("algorithm")
    folder = train(UNKNOWN, algorithm="recurrent_ppo", out=tmp_path / "run", preset=preset, progress=False)
    policy = load_policy(folder, UNKNOWN)
    n_seas, first = 64, 10_200_000
    found = {
        name: validation(one, seen, n_seas=n_seas, duration=200.0, first_sea=first)
        for name, one, seen in (
            ("agent", policy, policy.scenario),
            ("lqg", design("lqg", UNKNOWN), UNKNOWN),
            ("oracle", oracle(UNKNOWN, range(first, first + n_seas)), UNKNOWN),
        )
    }
    for name, costs in found.items():
        print(f"{name}: mean {costs['cost_mean']:.4g}, median {costs['cost_median']:.4g}")
    assert found["agent"]["cost_median"] < 2.0 * found["oracle"]["cost_median"]
    assert found["agent"]["cost_median"] < 0.25 * found["lqg"]["cost_median"]
