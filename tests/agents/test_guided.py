"""Agents beside a designed controller: what they see and command, whole trainings, and the critic's truth."""

from __future__ import annotations

import json

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

import torch
from stable_baselines3.common.callbacks import BaseCallback

from agents import networks
from agents.guide import guide_from_card, make_guide
from agents.guided_env import GuidedVecEnv, surroundings
from agents.policy import load_policy, policy_card
from agents.presets import ALGORITHMS, kinds_of, load_preset
from agents.train import build_model, train, widened_groundwork
from agents.vec_env import ScaledReward
from baselines import design
from heave_env import scenarios
from heave_env.plant import truth_names
from tests.agents.test_training import PPO, SMALL, interrupt_at, same_results

LINEAR = scenarios.load("thesis_linear")
LIMITS = scenarios.load("limits_linear")
TUNED = {"command_weight": 1.8, "speed_weight": 178.0}
"""Near enough to what tuning finds for lqg on `limits_linear`."""


def card(mode: str = "residual", options: dict[str, float] | None = None) -> dict:
    return {"controller": "lqg", "options": options or {}, "mode": mode, "reach": 0.1}


@pytest.mark.parametrize(("scenario", "options"), [(LINEAR, {}), (LIMITS, TUNED)])
@pytest.mark.parametrize("mode", ["residual", "estimate"])
def test_doing_as_the_guide_does_is_the_guide(scenario, options, mode):
    """Beside a guide, its own action gives the very episode that the controller drives alone."""
    guide = guide_from_card(card(mode, options), scenario)
    _, env = surroundings(scenario, 3, guide, privileged=False)
    alone, own = surroundings(scenario, 3, None, privileged=False)
    controller = design("lqg", scenario, **options) if options else design("lqg", scenario)
    env.seed(5)
    own.seed(5)
    seen, observation = env.reset(), own.reset()
    memory = None
    n = len(scenario.observation_names)
    for _ in range(60):
        np.testing.assert_array_equal(seen[:, :n], observation)
        action, memory = controller.predict(observation, memory)
        assert isinstance(env, GuidedVecEnv)
        env.step_async(env.own_action)
        alone.step_async(action)
        seen, reward, _, _ = env.step_wait()
        observation, reward_alone, _, _ = alone.step_wait()
        np.testing.assert_array_equal(reward, reward_alone)


def test_the_guide_is_told_what_was_done():
    """Its estimate stays right when the agent commands otherwise; a guide left in the dark would be wrong."""
    guide = guide_from_card(card(), LINEAR)
    batch, env = surroundings(LINEAR, 8, guide, privileged=False)
    env.seed(1)
    seen = env.reset()
    rng = np.random.default_rng(0)
    wrong = []
    at = len(LINEAR.observation_names) + guide.feature_names.index("winch_displacement_estimate")
    for step in range(600):
        if step > 300:
            wrong.append(seen[:, at] - batch.env.plant.channel("winch_displacement"))
        env.step_async(rng.uniform(-1.0, 1.0, (8, 1)))
        seen = env.step_wait()[0]
    moved = batch.env.plant.channel("winch_displacement").std()
    assert np.std(wrong) < 0.05 * max(moved, 0.05)


def test_the_last_observation_of_an_episode_has_features_too():
    guide = guide_from_card(card(), LINEAR)
    _, env = surroundings(scenarios.with_value(LINEAR, "duration", 2.0), 2, guide, privileged=True)
    env.seed(1)
    first = env.reset()
    for step in range(1, 25):
        env.step_async(env.venv.own_action)  # type: ignore[union-attr]
        seen, _, done, infos = env.step_wait()
        assert done.all() == (step == 20)
        if done.any():
            last = infos[0]["terminal_observation"]
            assert last.shape == first[0].shape
            # A new sea began: the guide has forgotten the old one.
            fresh = guide.look(seen[:, : len(LINEAR.observation_names)], np.zeros((2, guide.n_memory)))
            n = len(LINEAR.observation_names)
            np.testing.assert_array_equal(seen[:, n : n + fresh.features.shape[1]], fresh.features)
            assert not np.array_equal(last[:n], seen[0, :n])


def test_the_truth_is_the_plants():
    scenario = scenarios.load("unknown_linear")
    batch, env = surroundings(scenario, 4, None, privileged=True)
    env.seed(2)
    env.reset()
    env.step_async(np.full((4, 1), 0.3))
    seen = env.step_wait()[0]
    truth = dict(zip(truth_names(scenario), seen[:, len(scenario.observation_names) :].T, strict=True))
    plant = batch.env.plant
    scale, offset = scenario.channel_scale("payload_heave")
    expected = (plant.channel("payload_heave") - offset) / scale
    np.testing.assert_allclose(truth["payload_heave"], expected, rtol=1e-6)
    low, high = 0.7 * 0.8959, 1.3 * 0.8959
    drawn = plant.drawn[:, 0]
    np.testing.assert_allclose(
        truth["linear_payload.inertia"], (drawn - low) / (high - low) * 2.0 - 1.0, atol=1e-5
    )


def test_the_actor_does_not_see_the_truth():
    settings = load_preset("ppo", LIMITS, {**PPO, "guide": "lqg", "privileged_critic": True})
    guide = guide_from_card(card(options=TUNED), LIMITS)
    _, outer = surroundings(LIMITS, settings.n_envs, guide, privileged=True)
    env = ScaledReward(outer, gamma=0.98)
    ground = widened_groundwork(LIMITS, settings, guide, 0)
    model = build_model(settings, env, ground, seed=0)
    networks.set_linear_policy(model, np.linspace(-0.3, 0.3, len(ground.gain)))
    env.seed(0)
    seen = np.asarray(env.reset())
    other = seen.copy()
    n = ground.n_actor
    assert n is not None and n < seen.shape[1]
    other[:, n:] += 1.0
    action, changed = (model.predict(rows, deterministic=True)[0] for rows in (seen, other))
    np.testing.assert_array_equal(action, changed)
    with torch.no_grad():
        values = [model.policy.predict_values(torch.as_tensor(rows)).numpy() for rows in (seen, other)]
    assert np.abs(values[0] - values[1]).max() > 1e-4
    # The saved policy is the actor alone.
    policy = networks.exported(model, policy_card(LIMITS, algorithm="ppo", guide=guide.card))
    np.testing.assert_allclose(policy.act(seen[:, :n]), action, atol=1e-5)


def guided(**changes):
    return {**PPO, "guide": "lqg", "privileged_critic": True, **changes}


@pytest.mark.parametrize("mode", ["residual", "estimate"])
def test_a_guided_training_ends_in_a_policy_that_acts_alone(tmp_path, mode):
    preset = guided(guide_mode=mode, warm_start=mode == "estimate", logarithmic_reward=True)
    folder = train(LINEAR, out=tmp_path / "run", preset=preset, progress=False)
    run = json.loads((folder / "run.json").read_text())
    assert run["guide"]["controller"] == "lqg" and run["guide"]["mode"] == mode
    policy = load_policy(folder, LINEAR)
    assert policy.guide is not None
    _, env = surroundings(policy.scenario, 3, policy.guide, privileged=False)
    _, raw = surroundings(policy.scenario, 3, None, privileged=False)
    env.seed(9)
    raw.seed(9)
    seen, observation = np.asarray(env.reset()), np.asarray(raw.reset())
    memory = None
    for _ in range(40):
        action, memory = policy.predict(observation, memory)
        env.step_async(policy.act(seen))
        raw.step_async(action)
        seen, observation = np.asarray(env.step_wait()[0]), np.asarray(raw.step_wait()[0])
        np.testing.assert_allclose(seen[:, : observation.shape[1]], observation, atol=1e-5)
    # One environment, and rows that begin anew.
    single, after = policy.predict(observation[0], None)
    assert single.shape == (1,) and after.shape == (1, policy.guide.n_memory)
    begun, _ = policy.predict(observation, memory, episode_start=np.ones(3, dtype=bool))
    np.testing.assert_allclose(begun[0], single, atol=1e-6)


def test_a_resumed_guided_training_ends_with_the_same_bits(tmp_path, monkeypatch):
    def trained(folder):
        return train(LINEAR, seed=1, out=folder, preset=guided(), progress=False, save_every=0.0)

    whole = trained(tmp_path / "whole")
    interrupt_at(monkeypatch, SMALL["ppo"]["total_steps"] // 2)
    with pytest.raises(KeyboardInterrupt):
        trained(tmp_path / "parts")
    same_results(trained(tmp_path / "parts"), whole)


def test_a_guide_is_tuned_once_and_its_weights_are_kept():
    guide = make_guide("lqg", LINEAR, mode="residual", reach=0.2)
    again = guide_from_card(json.loads(json.dumps(guide.card)), LINEAR)
    np.testing.assert_array_equal(guide.controller.gain, again.controller.gain)
    assert again.reach == 0.2


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"guide": "nobody"}, "guide must be a designed controller"),
        ({"guide": "pid"}, "has no Kalman filter"),
        ({"guide_mode": "beside"}, "guide_mode must be one of residual, estimate, rate"),
        ({"guide_mode": "rate"}, "guide 'lqg' in .* guide_mode 'rate' needs a predictive"),
        ({"teacher": "nobody"}, "guide must be a designed controller"),
        ({"guide_reach": 0.0}, "guide_reach must be"),
    ],
)
def test_an_impossible_guide_is_refused(tmp_path, changes, words):
    with pytest.raises(ValueError, match=words):
        train(LINEAR, out=tmp_path / "run", preset={**guided(), **changes}, progress=False)


def test_only_ppo_has_a_privileged_critic():
    with pytest.raises(ValueError, match="privileged_critic must be false for every algorithm but ppo"):
        load_preset("sac", LINEAR, {"privileged_critic": True})


@pytest.mark.parametrize(("algorithm", "kind"), [(one, kind) for one in ALGORITHMS for kind in kinds_of(one)])
def test_the_presets_by_kind_are_complete(algorithm, kind):
    settings = load_preset(algorithm, LIMITS, kind)
    guides = {"rate": "mpc", "taught": None}
    assert settings.guide == guides.get(kind, "lqg")
    assert settings.guide is None or settings.guide_mode == kind
    assert settings.teacher == ("mpc" if kind in guides else None)
    assert settings.privileged_critic == (algorithm == "ppo")


def test_who_knows_teaches_where_something_is_unknown():
    for name, teacher in (("unknown_linear", "oracle"), ("limits_unknown_cable", "oracle_mpc")):
        settings = load_preset("recurrent_ppo", scenarios.load(name), "taught")
        assert settings.teacher == teacher and settings.repeat_worst > 0.0


def test_a_preset_of_another_algorithm_is_refused_in_a_sentence():
    with pytest.raises(ValueError, match="'taught' is not one of ppo's: choose the algorithm recurrent_ppo"):
        load_preset("ppo", LIMITS, "taught")


# The drum's rate as action -----------------------------------------------------------------------

PLANNED = {"command_weight": 1.0, "speed_weight": 30.0, "mismatch": 1.0}
"""What tuning finds for mpc on `limits_linear`."""


def planner(mode, options=PLANNED):
    return {"controller": "mpc", "options": options, "mode": mode, "reach": 1.0}


@pytest.mark.parametrize(("scenario", "options"), [(LINEAR, {}), (LIMITS, PLANNED)])
def test_the_rate_that_a_plan_asks_for_is_the_plan(scenario, options):
    """Told the rates that the predictive controller's commands mean, the drum does as under these."""
    guide, teacher = (guide_from_card(planner(mode, options), scenario) for mode in ("rate", "estimate"))
    _, env = surroundings(scenario, 4, guide, privileged=False)
    _, own = surroundings(scenario, 4, None, privileged=False)
    assert isinstance(env, GuidedVecEnv)
    env.seed(5)
    own.seed(5)
    seen, observation = np.asarray(env.reset()), own.reset()
    memory, others = np.zeros((4, teacher.n_memory)), None
    n = len(scenario.observation_names)
    heave = []
    for _ in range(150):
        look = teacher.look(seen[:, :n], memory)
        env.step_async(env.action_for(look.command))
        action, others = teacher.controller.predict(observation, others)
        own.step_async(action)
        seen, observation = np.asarray(env.step_wait()[0]), own.step_wait()[0]
        memory = teacher.advance(memory, look, env.command)
        heave.append([env.venv.env.plant.channel("payload_heave"), own.env.plant.channel("payload_heave")])  # type: ignore[attr-defined]
    told, alone = np.array(heave).swapaxes(0, 1)
    # At its acceleration limit a plan asks for more than a step can give, the rate for just that.
    assert np.std(told - alone) < 0.02 * np.std(alone)


def test_without_limits_the_guides_own_rate_is_the_optimum():
    guide = guide_from_card(planner("rate", {}), LINEAR)
    _, env = surroundings(LINEAR, 4, guide, privileged=False)
    _, own = surroundings(LINEAR, 4, None, privileged=False)
    controller = design("mpc", LINEAR)
    assert isinstance(env, GuidedVecEnv)
    env.seed(7)
    own.seed(7)
    observation, memory = own.reset(), None
    env.reset()
    for _ in range(60):
        env.step_async(env.own_action)
        action, memory = controller.predict(observation, memory)
        own.step_async(action)
        seen, observation = np.asarray(env.step_wait()[0]), own.step_wait()[0]
        np.testing.assert_allclose(seen[:, : observation.shape[1]], observation, atol=1e-4)


def test_an_action_near_nothing_leaves_the_drum_at_rest():
    """And beyond, actions and rates are each other's inverse."""
    scenario = scenarios.load("energy_linear")
    guide = guide_from_card(planner("rate", {}) | {"reach": 0.4, "rest": 0.3}, scenario)
    _, env = surroundings(scenario, 5, guide, privileged=False)
    assert isinstance(env, GuidedVecEnv)
    env.seed(4)
    observation = np.asarray(env.reset())[:, : len(scenario.observation_names)]
    look = guide.look(observation, np.zeros((5, guide.n_memory)))
    action = np.array([[-0.9], [-0.35], [0.29], [0.31], [0.8]])
    command = guide.command(look, action)
    rate = guide.predictive.rate_for_command(look.arrival, command)
    np.testing.assert_allclose(
        rate / guide.fastest, [-0.6 / 0.7, -0.05 / 0.7, 0.0, 0.01 / 0.7, 0.5 / 0.7], atol=1e-6
    )
    expected = np.where(np.abs(action) > 0.3, action, 0.0)
    np.testing.assert_allclose(guide.action(look, command), expected, atol=1e-6)


def test_an_agent_may_be_kept_from_seeing_its_guide():
    settings = load_preset(
        "ppo", LIMITS, {**PPO, "guide": "mpc", "guide_mode": "rate", "guide_reach": 1.0, "guide_shown": False}
    )
    guide = guide_from_card(planner("rate"), LIMITS)
    ground = widened_groundwork(LIMITS, settings, guide, 0)
    n = len(LIMITS.observation_names)
    assert np.abs(ground.transform[:n, :n]).max() > 0.0
    assert ground.n_actor == n + len(guide.feature_names)
    np.testing.assert_array_equal(ground.transform[n:, : ground.n_actor], 0.0)
    np.testing.assert_array_equal(ground.transform[:n, n:], 0.0)


def test_a_rate_survives_what_ruins_a_command():
    """The same share of the range as noise costs more on the command of the weak winch than on its rate."""
    costs = {}
    for mode in ("estimate", "rate"):
        guide, teacher = (guide_from_card(planner(one), LIMITS) for one in (mode, "estimate"))
        batch, env = surroundings(LIMITS, 8, guide, privileged=False)
        assert isinstance(env, GuidedVecEnv)
        rng = np.random.default_rng(0)
        env.seed(3)
        seen = np.asarray(env.reset())
        memory, cost = np.zeros((8, teacher.n_memory)), []
        n = len(LIMITS.observation_names)
        for step in range(600):
            look = teacher.look(seen[:, :n], memory)
            env.step_async(np.clip(env.action_for(look.command) + 0.02 * rng.standard_normal((8, 1)), -1, 1))
            seen, reward, _, _ = env.step_wait()
            seen = np.asarray(seen)
            memory = teacher.advance(memory, look, env.command)
            if step >= 200:
                cost.append(-reward)
        costs[mode] = float(np.mean(cost))
        del batch
    print(f"2 % of noise on the command {costs['estimate']:.2f}, on the rate {costs['rate']:.2f}")
    assert costs["rate"] < 0.8 * costs["estimate"]


class _Until(BaseCallback):
    """Ends a training once it goes on after a step."""

    def __init__(self, step: int) -> None:
        super().__init__()
        self.step = step

    def _on_step(self) -> bool:
        return self.num_timesteps <= self.step


def test_the_actor_stands_still_while_the_critic_learns(tmp_path):
    changes = {"total_steps": SMALL["ppo"]["total_steps"], "critic_first": SMALL["ppo"]["total_steps"] // 2}
    settings = load_preset("ppo", LINEAR, {**guided(), **changes})
    guide = guide_from_card(card(), LINEAR)
    _, outer = surroundings(LINEAR, settings.n_envs, guide, privileged=True)
    env = ScaledReward(outer, gamma=0.98)
    model = build_model(settings, env, widened_groundwork(LINEAR, settings, guide, 0), seed=0)
    env.seed(0)

    def weights():
        return {name: value.detach().clone() for name, value in model.policy.named_parameters()}

    rollout = settings.n_envs * settings.options["n_steps"]
    before = weights()
    networks.hold_actor(model, True)
    # The rate falls to nothing at the end of what is announced.
    model.learn(4 * rollout, _Until(rollout))
    held = weights()
    networks.hold_actor(model, False)
    model.learn(4 * rollout, _Until(rollout))
    moved = weights()
    actors = [name for name in before if "policy_net" in name or "action_net" in name or name == "log_std"]
    critics = [name for name in before if "value_net" in name]
    assert len(actors) >= 5 and len(critics) >= 4
    assert all(torch.equal(before[name], held[name]) for name in actors)
    assert not any(torch.equal(held[name], moved[name]) for name in actors)
    assert not any(torch.equal(before[name], held[name]) for name in critics)
