"""PPO on the device: thousands of environments of the GPU's plant, learning in plain torch beside them.

    python -m agents.on_device_ppo sea_state_5 --device cuda --steps 200000000 --out runs/device

Neither observations nor rewards leave the device. The recipe and the settings are those of `agents.train`
(`agents/presets/ppo.yaml`): whitened observations, a linear skip, a warm start, centred and scaled rewards,
a continuing task. The policy that is saved is one that `agents.policy.load_policy` and `heave compare` read.
An interrupted training goes on in the same folder; on the processor device, one thread, with the same bits.

Source: Schulman et al. (2017), PPO; Schulman et al. (2016), generalised advantages.
"""

from __future__ import annotations

import argparse
import copy
import csv
import dataclasses
import io
import json
import math
import shlex
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.logger import Logger
from torch import Tensor, nn

from agents import checkpoint
from agents.policy import Architecture, TrainedPolicy, policy_card, save_policy
from agents.presets import Preset, load_preset
from agents.run_folder import CurveFile, Run, interrupt_flag, sole_user, tensorboard
from agents.train import (
    SAVE_SHARE,
    Groundwork,
    TrainingFailure,
    card_seas,
    first_training_sea,
    groundwork,
    validation,
)
from heave_env import scenarios
from heave_env.files import write_atomic
from heave_env.gpu.torch_env import HeaveTorchVectorEnv
from heave_env.scenarios import Scenario

ENVS = {"cuda": 4096, "cpu": 256}
"""Environments by kind of device, where neither caller nor preset says."""
_OUTLIER = 20.0  # times the median, as in `agents.vec_env`
_EVALUATIONS = 20  # at most, however fast the device is
_ACTIVATIONS: dict[str, type[nn.Module]] = {"tanh": nn.Tanh, "relu": nn.ReLU}


def _layers(widths: Sequence[int], activation: str) -> nn.Sequential:
    """Linear layers of such widths, an activation behind each."""
    parts: list[nn.Module] = []
    for before, after in pairwise(widths):
        parts += [nn.Linear(before, after), _ACTIVATIONS[activation]()]
    return nn.Sequential(*parts)


class ActorCritic(nn.Module):
    """Actor and critic on whitened observations; the actor's mean sees them beside its last layer."""

    def __init__(self, ground: Groundwork, settings: Preset) -> None:
        """Builds the networks.

        Args:
            ground: Whitening matrix and the linear policy to start from.
            settings: Widths, activation, bound of the features, initial deviation.
        """
        super().__init__()
        n = len(ground.transform)
        self.bound, self.settings = settings.feature_bound, settings
        self.transform: Tensor
        # Laid out alike whether it was worked out or read back: products round by how their factors lie.
        transform = torch.tensor(ground.transform, dtype=torch.float32).contiguous()
        self.register_buffer("transform", transform)
        self.hidden = _layers([n, *settings.hidden], settings.activation)
        self.output = nn.Linear(settings.hidden[-1] + n, 1)
        self.critic = _layers([n, *settings.critic_hidden], settings.activation)
        self.value_output = nn.Linear(settings.critic_hidden[-1], 1)
        self.log_std = nn.Parameter(torch.tensor(float(settings.options["log_std_init"])))
        with torch.no_grad():  # begins as the linear policy, or by doing nothing
            self.output.weight *= 0.01
            self.output.bias.zero_()
            self.output.weight[0, -n:] = torch.as_tensor(ground.gain, dtype=torch.float32)

    def features(self, observation: Tensor) -> Tensor:
        """Whitened observations, (n, n_observations)."""
        return torch.clamp(observation @ self.transform.T, -self.bound, self.bound)

    def mean(self, features: Tensor) -> Tensor:
        """Mean of the action, (n,)."""
        mean: Tensor = self.output(torch.cat([self.hidden(features), features], dim=-1))
        return mean[:, 0]

    def value(self, features: Tensor) -> Tensor:
        """Value of the state, (n,)."""
        value: Tensor = self.value_output(self.critic(features))
        return value[:, 0]

    def log_probability(self, mean: Tensor, action: Tensor) -> Tensor:
        """Logarithm of the density of an action, (n,)."""
        z = (action - mean) * torch.exp(-self.log_std)
        return -0.5 * z * z - self.log_std - 0.5 * math.log(2.0 * math.pi)

    def exported(self, card: Mapping[str, Any]) -> TrainedPolicy:
        """The deterministic actor for plain NumPy."""
        tensors = {"features.weight": self.transform, "output.weight": self.output.weight}
        tensors["output.bias"] = self.output.bias
        for i, layer in enumerate(one for one in self.hidden if isinstance(one, nn.Linear)):
            tensors |= {f"hidden.{i}.weight": layer.weight, f"hidden.{i}.bias": layer.bias}
        architecture = Architecture(
            n_observations=len(self.transform),
            feature_bound=self.bound,
            hidden=self.settings.hidden,
            activation=self.settings.activation,
            output="clip",
        )
        weights = {name: tensor.detach().cpu().numpy().copy() for name, tensor in tensors.items()}
        return TrainedPolicy(architecture, weights, card)


class RewardScale:
    """Rewards of a rollout less their running mean, over the running deviation of their discounted sum.

    The statistics are those of `agents.vec_env.ScaledReward`, taken once for each rollout: they forget,
    and count outliers only up to a multiple of the median.
    """

    def __init__(self, settings: Preset, n_envs: int, device: torch.device) -> None:
        self.settings = settings
        self.mean, self.variance = torch.zeros(2, device=device)
        self.returns, self.weight = torch.zeros(n_envs, device=device), 0.0

    def scaled(self, reward: Tensor, counted: Tensor, ended: Tensor) -> tuple[Tensor, Tensor]:
        """Scales the rewards of a rollout.

        Args:
            reward: As the environments gave them, (n_steps, n_envs).
            counted: Whether the row was past its burn-in; others earn nothing.
            ended: Whether the row's episode ended with the step.

        Returns:
            Scaled rewards, and how often each row's was cut off, (n_envs,).
        """
        settings, n = self.settings, counted.sum().clamp(min=1)
        kept_share = (1.0 - 1.0 / settings.reward_horizon) ** len(reward)
        self.weight = 1.0 - (1.0 - self.weight) * kept_share
        share = (1.0 - kept_share) / self.weight
        usual = torch.maximum(reward, -_OUTLIER * _median(reward.abs(), counted))
        self.mean = self.mean + share * (((usual * counted).sum() / n) - self.mean)
        scale = torch.sqrt(self.variance)
        limit = torch.where(scale > 0.0, settings.reward_bound * scale, torch.inf)
        centred = (reward - self.mean) * counted
        kept = torch.clamp(centred, -limit, limit)
        squares = torch.empty_like(reward)
        for step in range(len(reward)):
            self.returns = settings.gamma * self.returns + kept[step]
            squares[step] = self.returns * self.returns
            self.returns = self.returns * ~ended[step]
        usual = torch.minimum(squares, _OUTLIER * _median(squares, counted))
        self.variance = self.variance + share * ((usual * counted).sum() / n - self.variance)
        scaled = kept / torch.sqrt(self.variance + 1e-12)
        return torch.clamp(scaled, -settings.reward_bound, settings.reward_bound), (kept > centred).sum(0)


def _median(values: Tensor, counted: Tensor) -> Tensor:
    """Median of what counts; infinite where nothing does."""
    found = torch.nanmedian(torch.where(counted, values, torch.nan))
    return torch.nan_to_num(found, nan=torch.inf)


@dataclass
class Rollout:
    """What a rollout keeps for its update, the first axes (n_steps, n_envs)."""

    observation: Tensor
    action: Tensor
    log_probability: Tensor
    value: Tensor
    reward: Tensor
    terminated: Tensor
    truncated: Tensor
    counted: Tensor

    @classmethod
    def empty(cls, n_steps: int, n_envs: int, n_observations: int, device: torch.device) -> Rollout:
        """Room for a rollout."""
        numbers = [torch.zeros(n_steps, n_envs, device=device) for _ in range(4)]
        flags = [torch.zeros(n_steps, n_envs, dtype=torch.bool, device=device) for _ in range(3)]
        return cls(torch.zeros(n_steps, n_envs, n_observations, device=device), *numbers, *flags)


def advantages(
    rollout: Rollout, reward: Tensor, last_value: Tensor, final_value: Tensor, gamma: float, gae_lambda: float
) -> Tensor:
    """Generalised advantages, (n_steps, n_envs).

    Args:
        rollout: Values and ends.
        reward: Scaled rewards, (n_steps, n_envs).
        last_value: Value of the state after the rollout, (n_envs,).
        final_value: Value of the state in which a row met its time limit, (n_envs,): the task goes on
            beyond it.
        gamma: Discount per control step [-].
        gae_lambda: Share of the next step's advantage [-].
    """
    result = torch.empty_like(reward)
    advantage = torch.zeros_like(last_value)
    following = last_value
    for step in reversed(range(len(reward))):
        terminated, truncated = rollout.terminated[step], rollout.truncated[step]
        following = torch.where(truncated, final_value, following) * ~terminated
        error = reward[step] + gamma * following - rollout.value[step]
        advantage = error + gamma * gae_lambda * advantage * ~(terminated | truncated)
        result[step] = advantage
        following = rollout.value[step]
    return result


class OnDevicePpo:
    """A training: environments, networks and what lies between two rollouts."""

    def __init__(
        self,
        scenario: Scenario,
        settings: Preset,
        *,
        device: str,
        seed: int,
        ground: Groundwork | None = None,
    ) -> None:
        """Lays everything out on the device.

        Args:
            scenario: As the agent sees it.
            settings: The preset.
            device: "cuda" or "cpu".
            seed: Of weights, exploration and training seas.
            ground: Whitening and first policy; worked out if not given.
        """
        self.scenario, self.settings, self.seed = scenario, settings, seed
        first_sea = first_training_sea(seed, settings)
        self.env = HeaveTorchVectorEnv(scenario, settings.n_envs, device=device)
        self.device = torch.device(self.env.device)
        self.generator = torch.Generator(self.device).manual_seed(seed)
        torch.manual_seed(seed)
        if ground is None:
            ground = groundwork(scenario, settings, first_sea)
        self.agent = ActorCritic(ground, settings).to(self.device)
        self.optimiser = torch.optim.Adam(self.agent.parameters(), lr=settings.learning_rate, eps=1e-5)
        self.rewards = RewardScale(settings, settings.n_envs, self.device)
        n_steps = int(settings.options["n_steps"])
        n_observations = len(scenario.observation_names)
        self.rollout = Rollout.empty(n_steps, settings.n_envs, n_observations, self.device)
        self.burn_in = round(settings.burn_in / scenario.control_dt)
        self.age = torch.zeros(settings.n_envs, dtype=torch.int64, device=self.device)
        self.observation, _ = self.env.reset(seed=first_sea)
        self.steps = 0

    @torch.no_grad()
    def settle(self) -> None:
        """Lets the starting policy act until the start from rest has died out; its steps do not count."""
        for _ in range(self.burn_in):
            action = torch.clamp(self.agent.mean(self.agent.features(self.observation)), -1.0, 1.0)
            self.observation, _, terminated, truncated, _ = self.env.step(action[:, None])
            self.age = (self.age + 1) * ~(terminated | truncated)

    @torch.no_grad()
    def gather(self) -> Tensor:
        """Fills the rollout; returns the value of the state in which each row last met its time limit."""
        agent, kept = self.agent, self.rollout
        for step in range(len(kept.reward)):
            kept.observation[step] = self.observation
            features = agent.features(self.observation)
            mean = agent.mean(features)
            noise = torch.randn(mean.shape, device=self.device, generator=self.generator)
            action = mean + torch.exp(agent.log_std) * noise
            kept.action[step], kept.value[step] = action, agent.value(features)
            kept.log_probability[step] = agent.log_probability(mean, action)
            kept.counted[step] = self.age >= self.burn_in
            told = self.env.step(torch.clamp(action, -1.0, 1.0)[:, None])
            self.observation, kept.reward[step], kept.terminated[step], kept.truncated[step], info = told
            self.age = (self.age + 1) * ~info["_final_obs"]
        self.steps += kept.reward.numel()
        return agent.value(agent.features(info["final_obs"]))

    def learn(self) -> tuple[Tensor, Tensor]:
        """One rollout and its update.

        Returns:
            Mean stage cost past the burn-in, and how often each row's reward was cut off, (n_envs,).
        """
        settings, options, kept = self.settings, self.settings.options, self.rollout
        final_value = self.gather()
        with torch.no_grad():
            ended = kept.terminated | kept.truncated
            reward, cut = self.rewards.scaled(kept.reward, kept.counted, ended)
            last_value = self.agent.value(self.agent.features(self.observation))
            gain = advantages(
                kept, reward, last_value, final_value, settings.gamma, float(options["gae_lambda"])
            )
            target = gain + kept.value
            counted = kept.counted.sum()
            cost = -(kept.reward * kept.counted).sum() / counted.clamp(min=1)
        flat = {
            "observation": kept.observation.flatten(0, 1),
            "action": kept.action.flatten(),
            "before": kept.log_probability.flatten(),
            "advantage": gain.flatten(),
            "target": target.flatten(),
        }
        size = max(2, len(flat["action"]) // int(options["n_minibatches"]))
        for _ in range(int(options["n_epochs"])):
            order = torch.randperm(len(flat["action"]), device=self.device, generator=self.generator)
            distance = torch.zeros((), device=self.device)
            for part in order.split(size):
                distance = torch.maximum(distance, self._update(**{key: flat[key][part] for key in flat}))
            if float(distance) > 1.5 * float(options.get("target_kl", math.inf)):
                break
        return cost, cut

    def _update(
        self, observation: Tensor, action: Tensor, before: Tensor, advantage: Tensor, target: Tensor
    ) -> Tensor:
        """A gradient step on a minibatch; returns how far the policy has moved (Kullback-Leibler)."""
        agent, options = self.agent, self.settings.options
        clip = float(options["clip_range"])
        features = agent.features(observation)
        change = agent.log_probability(agent.mean(features), action) - before
        ratio = torch.exp(change)
        advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
        gained = torch.minimum(ratio * advantage, torch.clamp(ratio, 1.0 - clip, 1.0 + clip) * advantage)
        loss = 0.5 * torch.mean((agent.value(features) - target) ** 2) - gained.mean()
        loss = loss - float(options.get("ent_coef", 0.0)) * agent.log_std
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
        self.optimiser.step()
        return torch.mean(ratio.detach() - 1.0 - change.detach())

    @torch.no_grad()
    def refresh(self, cut: Tensor) -> None:
        """Gives some rows a new sea between rollouts: a few by chance, and those that have run wild."""
        n_steps = len(self.rollout.reward)
        chance = torch.rand(len(cut), device=self.device, generator=self.generator)
        mask = (chance < n_steps / self.settings.mean_life) | (cut > 0.5 * n_steps)
        self.observation = self.env.reset_rows(mask)
        self.age, self.rewards.returns = self.age * ~mask, self.rewards.returns * ~mask

    def set_progress(self, share: float) -> None:
        """Anneals the learning rate, linearly in the share of the training that is done."""
        first, last = self.settings.learning_rate, self.settings.final_learning_rate
        for group in self.optimiser.param_groups:
            group["lr"] = last + (first - last) * max(1.0 - share, 0.0)

    def policy(self, **facts: Any) -> TrainedPolicy:
        """The present policy."""
        told = {"seed": self.seed, "steps": self.steps, "device": str(self.device), **facts}
        return self.agent.exported(policy_card(self.scenario, algorithm="ppo", training=told))

    def get_state(self) -> checkpoint.Arrays:
        """Everything that the training's future depends on, but for its settings."""
        arrays = {f"env/{name}": np.asarray(value) for name, value in self.env.get_state().items()}
        arrays |= {f"agent/{name}": _array(value) for name, value in self.agent.state_dict().items()}
        for index, slots in self.optimiser.state_dict()["state"].items():
            arrays |= {f"optimiser/{index}/{slot}": _array(value) for slot, value in slots.items()}
        rewards = self.rewards
        arrays |= {
            f"rewards/{name}": _array(getattr(rewards, name)) for name in ("mean", "variance", "returns")
        }
        arrays["rewards/weight"] = np.array(rewards.weight)
        arrays |= {"age": _array(self.age), "steps": np.array(self.steps)}
        return arrays | {"random": _array(self.generator.get_state())}

    def set_state(self, arrays: checkpoint.Arrays) -> None:
        """Takes up what `get_state` gave a training of the same settings."""
        self.env.set_state(checkpoint.under(arrays, "env/"))
        self.observation = self.env.observation
        state = checkpoint.under(arrays, "agent/")
        self.agent.load_state_dict({name: torch.as_tensor(value) for name, value in state.items()})
        slots: dict[int, dict[str, Tensor]] = {}
        for name, value in checkpoint.under(arrays, "optimiser/").items():
            index, slot = name.split("/")
            slots.setdefault(int(index), {})[slot] = torch.as_tensor(value)
        groups = self.optimiser.state_dict()["param_groups"]
        self.optimiser.load_state_dict({"state": slots, "param_groups": groups})
        for name in ("mean", "variance", "returns"):
            setattr(self.rewards, name, torch.tensor(arrays[f"rewards/{name}"], device=self.device))
        self.rewards.weight = float(arrays["rewards/weight"])
        self.age, self.steps = torch.tensor(arrays["age"], device=self.device), int(arrays["steps"])
        self.generator.set_state(torch.tensor(arrays["random"]))


def _array(value: Tensor) -> np.ndarray:
    return value.detach().cpu().numpy().copy()


def train_on_device(
    scenario: str | Path | Scenario,
    *,
    device: str = "cuda",
    seed: int = 0,
    total_steps: int | None = None,
    out: str | Path | None = None,
    preset: Mapping[str, Any] | str | Path | None = None,
    n_envs: int | None = None,
    progress: bool = True,
    save_every: float = 20.0,
    command: str | None = None,
) -> Path:
    """Trains an agent on the device, or goes on with a training that was interrupted.

    Args:
        scenario: Name, YAML file or scenario.
        device: "cuda", "cuda:1" and so on, or "cpu".
        seed: Of the weights, the exploration and the training seas.
        total_steps: Environment steps; if not given, as many updates as the preset makes.
        out: Run folder; `runs/SCENARIO-device-SEED` if not given.
        preset: Settings on top of the preset of PPO, or a YAML file of them.
        n_envs: Environments; 4096 on a GPU and 256 on the processor if not given.
        progress: Whether to draw a progress bar, and say what is skipped, on stderr.
        save_every: Seconds between saves of the state to go on from.
        command: Which command this is, for the run's card; None: a call of this function.

    Returns:
        The run folder, as `agents.train.train` leaves it: the policy that is best on validation seas, curves,
        evaluations, card.

    Raises:
        ValueError: If an argument is impossible, the kernels do not know something in the scenario, or the
            folder holds another training or is in use.
        TrainingFailure: If the weights stop being finite.
        KeyboardInterrupt: When interrupted, after the state has been saved.
    """
    chosen = scenarios.load(scenario)
    settings = _settings(chosen, preset, device, total_steps, n_envs)
    seen = dataclasses.replace(
        chosen,
        information_set=settings.information_set or chosen.information_set,
        history_lags=settings.history_lags or chosen.history_lags,
    )
    folder = Path(out) if out is not None else Path("runs") / f"{chosen.name}-device-{seed}"
    identity = {
        "kind": "training on the device",
        "device": device,
        "algorithm": "ppo",
        "seed": seed,
        "scenario_name": seen.name,
        "fingerprint": seen.fingerprint,
        "scenario": scenarios.to_mapping(seen),
        "preset": json.loads(json.dumps(settings.to_mapping())),
    }
    call = f"train_on_device({chosen.name!r}, device={device!r}, seed={seed}, preset={preset!r}, "
    call += f"total_steps={settings.total_steps}, n_envs={settings.n_envs})"
    new = not folder.exists()
    try:
        with sole_user(folder):
            run = Run.opened(folder, identity, call if command is None else command)
            if run.content["status"] == "finished":
                run.drop_state()
                if progress:
                    print(f"{folder}: this training is finished already", file=sys.stderr)
                return folder
            state = run.state_folder
            saved = checkpoint.load_state(state) if checkpoint.has_state(state) else None
            ground = None
            if saved is not None:  # the weights that are about to be restored hold it
                n = len(seen.observation_names)
                ground = Groundwork(np.eye(n), np.zeros(n))
            training = OnDevicePpo(seen, settings, device=device, seed=seed, ground=ground)
            _Record(run, training, progress, save_every).go(saved)
    except BaseException:
        if new and {path.name for path in folder.glob("*")} <= {".lock"}:  # settings that do not work
            (folder / ".lock").unlink(missing_ok=True)
            folder.rmdir()
        raise
    return folder


def _settings(
    scenario: Scenario,
    preset: Mapping[str, Any] | str | Path | None,
    device: str,
    total_steps: int | None,
    n_envs: int | None,
) -> Preset:
    settings = load_preset("ppo", scenario, preset)
    for key in ("guide", "teacher", "privileged_critic", "logarithmic_reward", "tension_cost"):
        if getattr(settings, key):
            raise ValueError(
                f"preset key {key!r} is not for a training on the device: leave it out, or use heave train"
            )
    n = ENVS["cuda" if device.startswith("cuda") else "cpu"] if n_envs is None else n_envs
    if total_steps is None:
        total_steps = settings.total_steps * n // settings.n_envs
    return dataclasses.replace(settings, n_envs=n, total_steps=total_steps)


class _Interrupted(Exception):
    """Raised between updates once the state has been saved."""


class _Record:
    """The training's loop, and what it leaves in its folder."""

    def __init__(self, run: Run, training: OnDevicePpo, progress: bool, save_every: float) -> None:
        self.run, self.folder, self.training, self.progress = run, run.folder, training, progress
        self.evaluations: list[dict[str, float]] = []
        self.best: TrainedPolicy | None = None
        self.curve = CurveFile(run.folder / "progress.csv")
        self.wall, self.due = 0.0, 0
        self.began = self.saved_at = time.monotonic()
        self.save_every = self.pause = save_every

    def go(self, saved: tuple[checkpoint.Arrays, dict[str, Any]] | None) -> None:
        """Trains to the end, from the beginning or from a saved state."""
        training, settings = self.training, self.training.settings
        every = max(settings.evaluate_every, settings.total_steps // _EVALUATIONS)
        if saved is not None:
            self._restore(*saved)
        self.run.update(status="running")  # before any other file: a killed run is known for one
        logger = Logger(str(self.folder), [self.curve, tensorboard(self.folder)])
        try:
            if saved is None:
                training.settle()
                self._evaluate()
                self.due = every
            with interrupt_flag() as flag, self._bar() as bar:
                while training.steps < settings.total_steps:
                    training.set_progress(training.steps / settings.total_steps)
                    before = training.steps
                    cost, cut = training.learn()
                    training.refresh(cut)
                    if training.steps >= self.due:
                        self.due += every
                        self._evaluate()
                    validated = self.evaluations[-1]["cost_mean"]
                    every_so_often = training.steps // settings.log_every != before // settings.log_every
                    if every_so_often or training.steps >= settings.total_steps:
                        logger.record("time/total_timesteps", training.steps)
                        logger.record("time/wall_s", self._wall())
                        logger.record("rollout/cost_mean", float(cost))
                        logger.record("validation/cost_mean", validated)
                        logger.dump(training.steps)
                    bar.update(training.steps - before)
                    shown = {"cost": f"{float(cost):.3g}", "validation": f"{validated:.3g}"}
                    bar.set_postfix(shown, refresh=False)
                    self._save_if_due(flag.is_set())
            self._finish()
        except _Interrupted:
            self.run.update(status="interrupted", steps=training.steps)
            raise KeyboardInterrupt(
                f"interrupted at step {training.steps}; the same command goes on from there"
            ) from None
        except TrainingFailure as failure:
            self.run.update(status="failed", steps=training.steps, reason=str(failure))
            raise
        finally:
            logger.close()

    def _bar(self) -> Any:
        from tqdm import tqdm

        training = self.training
        return tqdm(
            total=training.settings.total_steps,
            initial=training.steps,
            unit="step",
            unit_scale=True,
            desc=f"ppo on {training.scenario.name}, {training.device}",
            dynamic_ncols=True,
            disable=not self.progress,
        )

    def _wall(self) -> float:
        return self.wall + time.monotonic() - self.began

    def _evaluate(self) -> None:
        training, settings = self.training, self.training.settings
        weights = [float(value.detach().abs().max()) for value in training.agent.parameters()]
        if not all(math.isfinite(weight) for weight in weights):
            raise TrainingFailure(
                f"the training stopped being finite at step {training.steps}; the best policy so far is kept "
                f"in {str(self.folder)!r}: train with a lower learning_rate"
            )
        row: dict[str, float] = {"step": training.steps, "wall_s": round(self._wall(), 3)}
        policy = training.policy()
        row |= validation(
            policy, training.scenario, n_seas=settings.evaluation_seas, duration=settings.evaluation_duration
        )
        best = min((old["cost_mean"] for old in self.evaluations), default=math.inf)
        self.evaluations.append(row)
        text = io.StringIO()
        writer = csv.DictWriter(text, list(row), lineterminator="\n")
        writer.writeheader()
        writer.writerows(self.evaluations)
        write_atomic(self.folder / "evaluations.csv", text.getvalue().encode())
        if self.best is None or row["cost_mean"] < best:
            told = copy.deepcopy(policy.card)
            told["training"] |= {"validation_cost": row["cost_mean"], "validation_cost_max": row["cost_max"]}
            self.best = TrainedPolicy(policy.architecture, policy.weights, told)
            save_policy(self.folder / "policy.json", self.best)

    def _finish(self) -> None:
        training = self.training
        if self.evaluations[-1]["step"] != training.steps:
            self._evaluate()
        save_policy(self.folder / "policy-final.json", training.policy())
        assert self.best is not None
        self.run.finish(
            steps=training.steps,
            wall_s=round(self._wall(), 1),
            evaluations=self.evaluations,
            result=card_seas(self.best, training.scenario, training.settings),
        )

    # The state to go on from ---------------------------------------------------------------------

    def _save_if_due(self, stop: bool) -> None:
        begin = time.monotonic()
        if not (stop or begin - self.saved_at >= self.pause):
            return
        training = self.training
        assert self.best is not None
        arrays = training.get_state()
        arrays |= {f"best/{name}": value for name, value in self.best.weights.items()}
        content = {
            "best_card": self.best.card,
            "evaluations": self.evaluations,
            "curve": self.curve.rows,
            "wall": self._wall(),
            "due": self.due,
        }
        checkpoint.save_state(self.run.state_folder, arrays, content, training.steps)
        self.run.update(steps=training.steps, wall_s=round(self._wall(), 1))
        self.saved_at = time.monotonic()
        self.pause = max(self.save_every, (self.saved_at - begin) / SAVE_SHARE)
        if stop:
            raise _Interrupted

    def _restore(self, arrays: checkpoint.Arrays, content: Mapping[str, Any]) -> None:
        training = self.training
        training.set_state(arrays)
        self.evaluations, self.curve.rows = list(content["evaluations"]), list(content["curve"])
        self.wall, self.due = float(content["wall"]), int(content["due"])
        layers = training.policy().architecture
        self.best = TrainedPolicy(layers, checkpoint.under(arrays, "best/"), content["best_card"])
        # The files may be of a moment after the state was saved, or half of a pair.
        save_policy(self.folder / "policy.json", self.best)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m agents.on_device_ppo", description=train_on_device.__doc__
    )
    parser.add_argument("scenario", help="name of a scenario, or a YAML file")
    parser.add_argument("--device", default="cuda", help="cuda, cuda:1, ... or cpu (default: %(default)s)")
    parser.add_argument(
        "--steps",
        type=int,
        metavar="N",
        help="environment steps (default: as many updates as the preset makes)",
    )
    parser.add_argument("--envs", type=int, metavar="N", help="environments (default: by device)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--preset", metavar="FILE", help="YAML file of settings on top of the preset")
    parser.add_argument("--out", metavar="FOLDER", help="run folder")
    given = list(sys.argv[1:] if arguments is None else arguments)
    options = parser.parse_args(given)
    try:
        folder = train_on_device(
            options.scenario,
            device=options.device,
            seed=options.seed,
            total_steps=options.steps,
            out=options.out,
            preset=options.preset,
            n_envs=options.envs,
            command=shlex.join(["python", "-m", "agents.on_device_ppo", *given]),
        )
    except (ValueError, ModuleNotFoundError) as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as interruption:
        print(f"{parser.prog}: {interruption or 'interrupted'}", file=sys.stderr)
        return 130
    print(f"trained policy: {folder}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
