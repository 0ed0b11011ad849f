"""The native batch as Stable-Baselines3 sees it."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecCheckNan, VecMonitor

from agents.tension_cost import TensionCost
from agents.vec_env import HeaveVecEnv, ScaledReward
from heave_env import scenarios
from heave_env.controller import NoControl
from heave_env.env import HeaveEnv, HeaveVectorEnv

LINEAR = scenarios.load("thesis_linear")
ZERO = np.zeros((3, 1), dtype=np.float32)


def test_rows_are_the_single_environments():
    batch = HeaveVecEnv(LINEAR, 3, max_episode_steps=20)
    batch.seed(7)
    observation = batch.reset()
    singles = [HeaveEnv(LINEAR) for _ in range(3)]
    for row, single in enumerate(singles):
        np.testing.assert_array_equal(single.reset(seed=7 + row)[0], observation[row])
    rng = np.random.default_rng(0)
    for _ in range(10):
        actions = rng.uniform(-0.2, 0.2, (3, 1)).astype(np.float32)
        observation, reward, done, infos = batch.step(actions)
        assert reward.dtype == np.float32 and done.dtype == np.bool_
        for row, single in enumerate(singles):
            expected, expected_reward, *_, info = single.step(actions[row])
            np.testing.assert_array_equal(expected, observation[row])
            assert np.float32(expected_reward) == reward[row]
            assert infos[row] == info


@pytest.mark.parametrize("info", [True, False])
def test_the_clock_hands_over_the_last_observation_and_says_it_was_the_clock(info):
    batch = HeaveVecEnv(LINEAR, 3, max_episode_steps=5, info=info)
    reference = HeaveVectorEnv(LINEAR, 3, max_episode_steps=100, info=info)
    batch.seed(1)
    batch.reset()
    reference.reset(seed=1)
    for _ in range(5):
        first, _, done, infos = batch.step(ZERO)
        last, *_ = reference.step(ZERO)
    assert done.all()
    for row in range(3):
        np.testing.assert_array_equal(infos[row]["terminal_observation"], last[row])
        assert infos[row]["TimeLimit.truncated"] is True
        assert ("payload_heave" in infos[row]) == info
        assert not np.array_equal(first[row], last[row])


def test_a_row_s_info_may_be_read_late():
    batch, reference = (HeaveVecEnv(LINEAR, 3, max_episode_steps=6) for _ in range(2))
    for env in (batch, reference):
        env.seed(1)
        env.reset()
    kept, read = [], []
    for _ in range(9):
        kept.append(batch.step(ZERO)[3])
        read.append([dict(info.items()) for info in reference.step(ZERO)[3]])
    for late, early in zip(kept, read, strict=True):
        for mine, other in zip(late, early, strict=True):
            np.testing.assert_equal(dict(mine), other)
            assert mine.get("episode") is None and "payload_heave" in mine


def test_infos_are_fresh_each_step():
    batch = HeaveVecEnv(LINEAR, 3, info=False)
    batch.reset()
    _, _, _, infos = batch.step(ZERO)
    infos[0]["mine"] = 1
    _, _, _, later = batch.step(ZERO)
    assert later == [{}, {}, {}]


def test_seeds_hold_for_one_reset():
    batch = HeaveVecEnv(LINEAR, 3)
    assert batch.seed(4) == [4, 5, 6]
    first = batch.reset()
    second = batch.reset()
    batch.seed(4)
    np.testing.assert_array_equal(batch.reset(), first)
    assert not np.array_equal(first, second)


def test_attributes_and_methods_reach_the_batch():
    batch = HeaveVecEnv(LINEAR, 3)
    assert batch.get_attr("scenario", [0, 2]) == [LINEAR, LINEAR]
    assert batch.has_attr("scenario") and not batch.has_attr("no_such_thing")
    batch.set_attr("remark", "calm")
    assert batch.env.remark == "calm"
    with pytest.raises(ValueError, match="rows share"):
        batch.set_attr("remark", "rough", indices=[1])
    batch.reset()
    assert len(batch.env_method("get_state", indices=[1])) == 1
    assert batch.env_is_wrapped(Monitor) == [False] * 3
    assert batch.get_images() == [None] * 3


def test_only_a_batch_in_same_step_is_taken():
    with pytest.raises(ValueError, match="SAME_STEP"):
        HeaveVecEnv(HeaveVectorEnv(LINEAR, 2))
    with pytest.raises(ValueError, match="has its own"):
        HeaveVecEnv(HeaveVectorEnv(LINEAR, 2, autoreset_mode=AutoresetMode.SAME_STEP), 3)


def test_monitor_and_nan_checks_wrap_it():
    channels = ("payload_heave", "command")
    env = VecMonitor(VecCheckNan(HeaveVecEnv(LINEAR, 3, max_episode_steps=8)), info_keywords=channels)
    env.reset()
    for _ in range(8):
        _, _, done, infos = env.step(ZERO)
    assert done.all()
    assert infos[0]["episode"]["l"] == 8 and infos[0]["episode"]["r"] < 0.0
    assert set(channels) <= set(infos[0]["episode"])


def test_a_user_s_own_training_loop_runs():
    model = PPO("MlpPolicy", HeaveVecEnv(LINEAR, 4, info=False), n_steps=16, batch_size=32, device="cpu")
    model.learn(128)
    assert model.num_timesteps == 128


def test_stable_baselines_evaluates_any_controller():
    env = VecMonitor(HeaveVecEnv(LINEAR, 4, max_episode_steps=30))
    env.seed(3)
    mean, _ = evaluate_policy(NoControl(), env, n_eval_episodes=4)  # type: ignore[arg-type]
    assert mean < 0.0


def test_high_tensions_are_charged_on_top_of_the_task():
    """Snapping wire beside its twin without the charge, through the end of an episode."""
    snap, charge = scenarios.load("snap"), TensionCost(weight=50.0, above=1.5)
    charged, free = (HeaveVecEnv(snap, 3, max_episode_steps=60) for _ in range(2))
    charged.tension_cost = charge
    for env in (charged, free):
        env.seed(0)
        env.reset()
    owed = []
    for step in range(75):
        reward, done, infos = charged.step(ZERO)[1:]
        plain = free.step(ZERO)[1]
        tension = np.array([info["tension_max"] for info in infos])
        expected = 50.0 * np.maximum(tension / snap.static_tension - 1.5, 0.0) ** 2
        assert done.all() == (step == 59)
        np.testing.assert_allclose(plain - reward, 0.0 if done.all() else expected, rtol=1e-5, atol=1e-4)
        owed.append(expected.max())
    assert max(owed) > 100.0 and min(owed) == 0.0


# The reward's scale ------------------------------------------------------------------------------


def scaled(n_envs: int = 3, **options) -> ScaledReward:
    env = ScaledReward(HeaveVecEnv(LINEAR, n_envs, info=False), gamma=0.9, **options)
    env.seed(0)
    env.reset()
    return env


def test_rewards_are_centred_and_scaled():
    env = scaled(horizon=100.0, bound=10.0)
    rewards = np.array([env.step(ZERO)[1] for _ in range(600)])
    assert abs(rewards[300:].mean()) < 0.2
    assert 0.02 < rewards[300:].std() < 1.0


def test_nothing_is_earned_while_burning_in():
    env = scaled(burn_in=5)
    early = [env.step(ZERO)[1] for _ in range(5)]
    assert not np.any(early)
    assert np.any([env.step(ZERO)[1] for _ in range(20)])
    env.forget(np.array([True, False, False]))
    rewards = env.step(ZERO)[1]
    assert rewards[0] == 0.0 and np.all(rewards[1:] != 0.0)


def test_a_wild_row_leaves_the_scale_alone_and_is_found():
    env, tame = (scaled(20, horizon=50.0, bound=0.5) for _ in range(2))
    for step in range(400):
        actions = np.zeros((20, 1), dtype=np.float32)
        actions[0] = 1.0 if step >= 200 else 0.0
        env.step(actions)
        tame.step(np.zeros((20, 1), dtype=np.float32))
        if step == 299:
            env.wild_rows(300)
    assert np.flatnonzero(env.wild_rows(100)).tolist() == [0]
    assert env.scale < 2.0 * tame.scale


def test_the_statistics_come_back():
    env, other = scaled(), scaled()
    for _ in range(30):
        env.step(ZERO)
    other.set_state(env.get_state())
    other.venv.env.set_state(env.venv.env.get_state())  # type: ignore[attr-defined]
    for _ in range(5):
        np.testing.assert_array_equal(env.step(ZERO)[1], other.step(ZERO)[1])
