"""Training: scenario and preset in, run folder out; goes on where it was interrupted.

Stable-Baselines3 does the learning. What the task needs beyond it comes through its own extension
points: policies with a linear skip (`agents.networks`), a reward wrapper (`agents.vec_env`) and one
callback, which acts only between rollouts: it evaluates, keeps the best policy, saves the state and
gives some rows a new sea. Nothing in it draws from the random streams that the algorithm uses.
"""

from __future__ import annotations

import csv
import dataclasses
import inspect
import io
import json
import logging
import math
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from sb3_contrib import TQC, RecurrentPPO
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnvWrapper

from agents import checkpoint, networks
from agents.guide import Guide, guide_from_card, make_guide
from agents.guided_env import GuidedVecEnv, PrivilegedVecEnv, surroundings
from agents.imitation import imitate
from agents.policy import TrainedPolicy, policy_card, save_policy
from agents.presets import Preset, load_preset
from agents.run_folder import (
    CurveFile,
    Run,
    interrupt_flag,
    sole_user,
    tensorboard,
)
from agents.teachers import school
from agents.tension_cost import TensionCost, require_cable
from agents.vec_env import HeaveVecEnv, ScaledReward
from heave_env import scenarios
from heave_env.controller import Controller, shown_to
from heave_env.env import HeaveVectorEnv
from heave_env.files import write_atomic
from heave_env.provenance import command_line
from heave_env.scenarios import Scenario

TRAINING_SEEDS = 10_000_000
"""Training seas have seeds below this."""
FIRST_VALIDATION_SEED = 10_000_000
"""Validation seas have seeds from here."""
FIRST_CARD_SEED = 10_100_000
"""The validation seas of a run's card have seeds from here: nothing was chosen in them."""
_LARGEST_WEIGHT = 1e9  # beyond it single precision is no longer worth the name
SAVE_SHARE = 0.05
"""Of the wall time that may go into saving the state [-]."""
_LOG = logging.getLogger(__name__)


class TrainingFailure(ValueError):
    """A training that cannot go on; its message says why and what to do."""


def train(
    scenario: str | Path | Scenario,
    *,
    algorithm: str = "ppo",
    seed: int = 0,
    total_steps: int | None = None,
    out: str | Path | None = None,
    preset: Mapping[str, Any] | str | Path | None = None,
    n_envs: int | None = None,
    progress: bool = True,
    torch_threads: int = 1,
    save_every: float = 20.0,
    arguments: list[str] | None = None,
) -> Path:
    """Trains an agent, or goes on with a training that was interrupted.

    On one thread the result depends on scenario, preset and seed alone, however often the training was
    interrupted.

    Args:
        scenario: Name, YAML file or scenario.
        algorithm: `ppo`, `recurrent_ppo`, `sac`, `td3` or `tqc`.
        seed: Of the weights, the exploration and the training seas.
        total_steps: Environment steps; the preset's if not given.
        out: Run folder; `runs/SCENARIO-ALGORITHM-SEED` if not given.
        preset: Settings on top of the preset, or a YAML file of them.
        n_envs: Environments in the batch; the preset's if not given.
        progress: Whether to draw a progress bar, and say what is skipped, on stderr.
        torch_threads: Threads of torch; only one is reproducible to the bit.
        save_every: Seconds between saves of the state to go on from.
        arguments: Of the `heave` command that this is, for the run's card; None: a call of this function.

    Returns:
        The run folder.

    Raises:
        ValueError: If an argument is impossible, or the folder holds another training or is in use.
        TrainingFailure: If weights or costs stop being finite.
        KeyboardInterrupt: When interrupted, after the state has been saved.
    """
    chosen = scenarios.load(scenario)
    settings = _settings(algorithm, chosen, preset, total_steps, n_envs)
    if settings.charge is not None:
        require_cable(chosen)
    seen = shown_to(settings, chosen)
    first_sea = first_training_sea(seed, settings)
    folder = Path(out) if out is not None else Path("runs") / f"{chosen.name}-{algorithm}-{seed}"
    identity = {
        "kind": "training",
        "algorithm": algorithm,
        "seed": seed,
        "first_sea": first_sea,
        "scenario_name": chosen.name,
        "fingerprint": seen.fingerprint,
        "scenario": scenarios.to_mapping(seen),
        "preset": json.loads(json.dumps(settings.to_mapping())),
    }
    call = (
        f"train({chosen.name!r}, algorithm={algorithm!r}, seed={seed}, total_steps={settings.total_steps}, "
    )
    call += f"preset={preset!r}, n_envs={settings.n_envs})"
    with sole_user(folder):
        run = Run.opened(folder, identity, call if arguments is None else command_line(arguments))
        if run.content["status"] == "finished":
            run.drop_state()
            if progress:
                print(f"{folder}: this training is finished already", file=sys.stderr)
            return folder
        threads = torch.get_num_threads()
        torch.set_num_threads(torch_threads)
        try:
            _Training(run, seen, settings, seed, first_sea, progress, save_every).go()
        finally:
            torch.set_num_threads(threads)
    return folder


# Settings ----------------------------------------------------------------------------------------


def _settings(
    algorithm: str,
    scenario: Scenario,
    preset: Mapping[str, Any] | str | Path | None,
    total_steps: int | None,
    n_envs: int | None,
) -> Preset:
    settings = load_preset(algorithm, scenario, preset)
    given = {
        key: value for key, value in (("total_steps", total_steps), ("n_envs", n_envs)) if value is not None
    }
    return dataclasses.replace(settings, **given)  # type: ignore[arg-type]


def first_training_sea(seed: int, settings: Preset) -> int:
    """First of the training seas of a seed; no two seeds share a sea, in lessons or later.

    Raises:
        ValueError: If there are no seas for such a seed.
    """
    taught = 0 if settings.teacher is None else settings.lessons * settings.lesson_seas
    n_seas = max(settings.n_envs, taught, 1000)
    most = TRAINING_SEEDS // n_seas - 1
    if not isinstance(seed, int) or isinstance(seed, bool) or not 0 <= seed <= most:
        raise ValueError(f"seed must be a whole number from 0 to {most}, got {seed!r}")
    return seed * n_seas


@dataclass(frozen=True)
class Groundwork:
    """What a training starts from: how observations are whitened, and a linear policy on top."""

    transform: np.ndarray
    """Whitened components are this times an observation, (n_observations, n_observations)."""
    gain: np.ndarray
    """Action per whitened component, (n_observations,); zero without a warm start."""
    n_actor: int | None = None
    """Leading components that the actor sees [-]; None: all of them."""


def groundwork(scenario: Scenario, settings: Preset, first_sea: int) -> Groundwork:
    """Whitens an agent's observations as they are under the reference controller, and regresses its action.

    Samples of neighbouring instants are nearly equal, and what matters is in their small differences;
    principal components of unit variance put these on a par with the rest. The covariance is gathered
    with the excitation that exploration will bring: without it, directions that good control never shows
    would be blown up. Components beneath a thousandth of the largest deviation count as that.

    The warm start is the linear least-squares fit of the reference's action to the whitened components: what
    of a controller with memory can be had from a finite history, without its model.

    Args:
        scenario: As the agent sees it.
        settings: The preset.
        first_sea: Seed of the first of the seas, training seas.
    """
    controller = _reference(scenario, settings.reference)
    observations, _ = _excited(scenario, controller, settings.excitation, first_sea)
    variance, axes = np.linalg.eigh(observations.T @ observations / len(observations))
    floor = 1e-6 * max(float(variance[-1]), 1e-12)
    transform = (axes / np.sqrt(np.maximum(variance, floor))).T
    gain = np.zeros(len(transform))
    if settings.warm_start and controller is not None:
        observations, actions = _excited(scenario, controller, 0.2 * settings.excitation, first_sea)
        components = observations @ transform.T
        ridge = 1e-6 * len(components) * np.eye(len(transform))
        gain = np.linalg.solve(components.T @ components + ridge, components.T @ actions)
        started, idle = (
            _mean_cost(scenario, _LinearPolicy(matrix), first_sea)
            for matrix in (transform.T @ gain, np.zeros(len(gain)))
        )
        if not started < idle:
            _LOG.warning(
                "%s: a linear fit of %s to what the agent sees costs %.3g, doing nothing %.3g: it starts so",
                scenario.name,
                settings.reference,
                started,
                idle,
            )
            gain = np.zeros(len(gain))
    return Groundwork(transform, gain)


def widened_groundwork(
    scenario: Scenario, settings: Preset, guide: Guide | None, first_sea: int
) -> Groundwork:
    """The same where a guide's features or the truth stand behind the observation.

    Each entry is first brought to unit deviation, for estimated states come in all units. The actor's are
    then turned into principal components; the truth, which the critic alone sees, is only scaled. Beside a
    guide the start is the guide itself: a residual of nothing, or the linear fit of its command.
    """
    n_rows, n_steps = 128, min(scenario.n_steps, 1500)
    _, env = surroundings(scenario, n_rows, guide, privileged=settings.privileged_critic)
    controller = None if guide is not None else _reference(scenario, settings.reference)
    n_raw = len(scenario.observation_names)
    n_actor = n_raw + (0 if guide is None else len(guide.feature_names))
    rng = np.random.default_rng(first_sea)
    env.seed(first_sea)
    seen = np.asarray(env.reset())
    memory: Any = None
    wander = np.zeros((n_rows, 1))
    observations, actions = [], []
    for step in range(n_steps):
        noise = settings.excitation * rng.standard_normal((n_rows, 1))
        if guide is not None:
            guided = env if isinstance(env, GuidedVecEnv) else env.venv  # type: ignore[union-attr]
            action = guided.own_action  # type: ignore[union-attr]
            # A residual is a share of its reach.
            noise /= guide.reach if guide.mode == "residual" else 1.0
            if guide.mode == "rate":
                noise = wander = 0.9 * wander + noise
        elif controller is not None:
            action, memory = controller.predict(seen[:, :n_raw], memory)
        else:
            action = np.zeros((n_rows, 1))
            wander = noise = 0.9 * wander + noise
        if step >= n_steps // 4 and step % 5 == 0:
            observations.append(seen.astype(np.float64))
            actions.append(np.array(action[:, 0], dtype=np.float64))
        env.step_async(np.clip(action + noise, -1.0, 1.0))
        seen = np.asarray(env.step_wait()[0])
    env.close()
    gathered, given = np.concatenate(observations), np.concatenate(actions)
    size = np.maximum(np.sqrt(np.mean(gathered**2, axis=0)), 1e-9)
    # A predictive controller's estimate holds all that the measurements tell; beside it they are noise.
    first = n_raw if guide is not None and guide.mode == "rate" and settings.guide_shown else 0
    seen_by_actor = slice(first, n_actor if settings.guide_shown else n_raw)
    scaled = gathered[:, seen_by_actor] / size[seen_by_actor]
    variance, axes = np.linalg.eigh(scaled.T @ scaled / len(scaled))
    floor = 1e-6 * float(variance[-1])
    transform = np.diag(1.0 / size)
    transform[:n_actor] = 0.0
    transform[seen_by_actor, seen_by_actor] = (axes / np.sqrt(np.maximum(variance, floor))).T
    transform[:n_actor] /= size
    gain: np.ndarray = np.zeros(n_actor)
    if settings.warm_start and (controller is not None or (guide is not None and guide.mode != "residual")):
        components = gathered[:, :n_actor] @ transform[:n_actor, :n_actor].T
        ridge = 1e-6 * len(components) * np.eye(n_actor)
        gain = np.linalg.solve(components.T @ components + ridge, components.T @ given)
    return Groundwork(transform, gain, n_actor)


@dataclass(frozen=True)
class _LinearPolicy:
    """Action as a linear map of the observation."""

    matrix: np.ndarray

    def predict(
        self,
        observation: np.ndarray,
        state: Any | None = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any | None]:
        return np.clip(observation @ self.matrix, -1.0, 1.0)[:, None], None


def _mean_cost(scenario: Scenario, controller: Controller, first_sea: int) -> float:
    """Mean stage cost on training seas, their first half left out [-]."""
    return validation(controller, scenario, n_seas=32, duration=150.0, first_sea=first_sea)["cost_mean"]


def _excited(
    scenario: Scenario, controller: Controller | None, excitation: float, first_sea: int
) -> tuple[np.ndarray, np.ndarray]:
    """Observations (n, n_observations) and the controller's actions (n,) while white noise disturbs these.

    Without a controller the noise is slow, and moves the winch.
    """
    n_rows, n_steps = 128, min(scenario.n_steps, 1500)
    env = HeaveVectorEnv(scenario, n_rows, info=False, max_episode_steps=n_steps + 1)
    rng = np.random.default_rng(first_sea)
    observation, _ = env.reset(seed=first_sea)
    memory: Any = None
    wander, action = np.zeros((n_rows, 1)), np.zeros((n_rows, 1))
    observations, actions = [], []
    for step in range(n_steps):
        noise = excitation * rng.standard_normal((n_rows, 1))
        if controller is None:
            wander = 0.9 * wander + noise
            noise = wander
        else:
            action, memory = controller.predict(observation, memory)
        if step >= n_steps // 4 and step % 5 == 0:
            observations.append(observation.astype(np.float64))
            actions.append(np.array(action[:, 0], dtype=np.float64))
        observation = env.step(np.clip(action + noise, -1.0, 1.0))[0]
    env.close()
    return np.concatenate(observations), np.concatenate(actions)


def _reference(scenario: Scenario, reference: str | None) -> Controller | None:
    if reference is None:
        return None
    from baselines import design

    try:
        controller: Controller = design(reference, scenario)
    except ValueError as error:
        _LOG.warning("no %s for %s (%s): whitening under random commands", reference, scenario.name, error)
        return None
    return controller


# The algorithm -----------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class _Algorithm:
    """How an algorithm is built from a preset."""

    model: type[BaseAlgorithm]
    policy: type[Any]
    critic: str
    """What Stable-Baselines3 calls its critic's layers."""
    own: frozenset[str]
    """Options that are ours, or the policy's, not the algorithm's own arguments."""
    policy_options: frozenset[str] = frozenset()
    """Options that are handed to the policy."""


_SQUASHED = frozenset({"log_std_init"})
_CRITICS = frozenset({"n_critics", "quadratic_rank"})
_ALGORITHMS = {
    "ppo": _Algorithm(
        model=PPO,
        policy=networks.SkipActorCriticPolicy,
        critic="vf",
        own=frozenset({"n_minibatches"}),
        policy_options=frozenset({"log_std_init"}),
    ),
    "recurrent_ppo": _Algorithm(
        model=RecurrentPPO,
        policy=networks.RecurrentSkipPolicy,
        critic="vf",
        own=frozenset({"n_minibatches"}),
        policy_options=frozenset({"log_std_init", "lstm_hidden_size", "shared_lstm", "enable_critic_lstm"}),
    ),
    "sac": _Algorithm(
        model=SAC, policy=networks.SkipSacPolicy, critic="qf", own=_SQUASHED, policy_options=_CRITICS
    ),
    "td3": _Algorithm(
        model=TD3, policy=networks.SkipTd3Policy, critic="qf", own=frozenset(), policy_options=_CRITICS
    ),
    "tqc": _Algorithm(
        model=TQC,
        policy=networks.SkipTqcPolicy,
        critic="qf",
        own=_SQUASHED,
        policy_options=_CRITICS | {"n_quantiles"},
    ),
}
_NO_OPTIONS = {"self", "policy", "env", "learning_rate", "gamma", "seed", "device", "policy_kwargs"}


def option_names(algorithm: str) -> set[str]:
    """What a preset's `options` may hold: the algorithm's own arguments, but those that keys stand for."""
    built = _ALGORITHMS[algorithm]
    taken = set(inspect.signature(built.model.__init__).parameters) | built.own | built.policy_options
    return taken - _NO_OPTIONS - ({"batch_size"} if "n_minibatches" in built.own else set())


def build_model(settings: Preset, env: ScaledReward, ground: Groundwork, seed: int) -> BaseAlgorithm:
    """The preset's algorithm on an environment, with its whitened observation and linear skip.

    Raises:
        ValueError: If the preset's options are not ones that the algorithm takes.
    """
    begin, end = settings.learning_rate, settings.final_learning_rate

    def learning_rate(remaining: float) -> float:
        return end + (begin - end) * max(remaining, 0.0)

    built, options = _ALGORITHMS[settings.algorithm], dict(settings.options)
    policy: dict[str, Any] = {
        "net_arch": {"pi": list(settings.hidden), built.critic: list(settings.critic_hidden)},
        "activation_fn": networks.ACTIVATIONS[settings.activation],
        "features_extractor_class": networks.WhitenedFeatures,
        "features_extractor_kwargs": {"transform": ground.transform, "bound": settings.feature_bound},
    }
    policy |= {name: options.pop(name) for name in sorted(built.policy_options & set(options))}
    common: dict[str, Any] = {
        "learning_rate": learning_rate,
        "gamma": settings.gamma,
        "seed": seed,
        "device": "cpu",
        "policy_kwargs": policy,
    }
    try:
        if settings.algorithm == "ppo":
            policy["n_actor"] = ground.n_actor
        if "n_minibatches" in built.own:
            minibatches = int(options.pop("n_minibatches"))
            options["batch_size"] = max(2, settings.n_envs * int(options["n_steps"]) // minibatches)
        log_std = float(options.pop("log_std_init")) if "log_std_init" in built.own else None
        if "action_noise" in options:
            noise = float(options.pop("action_noise"))
            options["action_noise"] = NormalActionNoise(np.zeros(1), np.full(1, noise))
        build: Any = built.model
        model: BaseAlgorithm = build(built.policy, env, **common, **options)
        if log_std is not None:
            networks.set_exploration(model, log_std)
    except (TypeError, KeyError) as error:
        raise ValueError(f"the preset's options do not fit {settings.algorithm}: {error}") from error
    networks.set_linear_policy(model, ground.gain)
    return model


# The training ------------------------------------------------------------------------------------


class _Interrupted(Exception):
    """Raised between rollouts once the state has been saved."""


class _Training:
    """One training from start or resumption to its end."""

    def __init__(
        self,
        run: Run,
        scenario: Scenario,
        settings: Preset,
        seed: int,
        first_sea: int,
        progress: bool,
        save_every: float,
    ) -> None:
        self.run, self.scenario, self.settings = run, scenario, settings
        self.seed, self.first_sea, self.progress, self.save_every = seed, first_sea, progress, save_every

    def go(self) -> None:
        run, settings = self.run, self.settings
        begin, earlier = time.monotonic(), 0.0
        saved = checkpoint.load_state(run.state_folder) if checkpoint.has_state(run.state_folder) else None
        guide = self._guide()
        batch, outer = surroundings(
            self.scenario,
            settings.n_envs,
            guide,
            privileged=settings.privileged_critic,
            tension_cost=settings.charge,
        )
        env = ScaledReward(
            outer,
            gamma=settings.gamma,
            horizon=settings.reward_horizon,
            bound=settings.reward_bound,
            burn_in=round(settings.burn_in / self.scenario.control_dt),
            logarithmic=settings.logarithmic_reward,
        )
        widened = guide is not None or settings.privileged_critic
        if saved is not None:  # the weights that are about to be restored hold it
            n = int(np.prod(outer.observation_space.shape or ()))
            n_actor = len(self.scenario.observation_names)
            n_actor += 0 if guide is None else len(guide.feature_names)
            ground = Groundwork(np.eye(n), np.zeros(n_actor), n_actor if widened else None)
        elif widened:
            ground = widened_groundwork(self.scenario, settings, guide, self.first_sea)
        else:
            ground = groundwork(self.scenario, settings, self.first_sea)
        model = build_model(settings, env, ground, self.seed)
        env.seed(self.first_sea)
        if saved is None and settings.teacher is not None:
            teachers = school(settings.teacher, self.scenario)
            run.update(status="running")  # before any other file: a killed run is known for one
            course = imitate(
                model,
                self.scenario,
                teachers,
                guide,
                privileged=settings.privileged_critic,
                excitation=0.2 * settings.excitation,
                first_sea=self.first_sea,
                seed=self.seed,
                n_rounds=settings.lessons,
                n_rows=settings.lesson_seas,
                n_epochs=settings.lesson_epochs,
                take_over=settings.take_over,
                repeat_worst=settings.repeat_worst,
                keep=run.lessons_folder,
                progress=f"{settings.teacher} teaches {self.scenario.name}" if self.progress else None,
            )
            earlier = course.wall_before
            run.content["imitation"] = {
                "teacher": dict(teachers.card),
                "left": None if math.isnan(course.left) else course.left,
                "taken_over": course.taken,
                "wall_s": round(course.wall, 1),
            }
        supervisor = _Supervisor(self, model, batch, env, guide)
        # Design, whitening and imitation are part of what a training takes.
        supervisor.began = begin - earlier
        if saved is not None:
            supervisor.restore(*saved)
        run.update(status="running")
        model.set_logger(Logger(str(run.folder), [supervisor.curve, tensorboard(run.folder)]))
        try:
            with interrupt_flag() as flag:
                supervisor.interrupted = flag
                model.learn(
                    settings.total_steps - model.num_timesteps,
                    supervisor,
                    log_interval=None,  # type: ignore[arg-type]
                    reset_num_timesteps=saved is None,
                )
                supervisor.finish()
        except _Interrupted:
            run.update(status="interrupted", steps=model.num_timesteps)
            raise KeyboardInterrupt(
                f"interrupted at step {model.num_timesteps}; the same command goes on from there"
            ) from None
        except (ArithmeticError, RuntimeError, ValueError) as error:
            # Infinite weights show first in whatever they are put into.
            failure = error if isinstance(error, TrainingFailure) else supervisor.failure()
            if failure is None:
                raise
            run.update(status="failed", steps=model.num_timesteps, reason=str(failure))
            raise failure from (None if failure is error else error)
        finally:
            supervisor.close()
            model.logger.close()
            env.close()

    def _guide(self) -> Guide | None:
        """The designed controller beside the agent: the preset's, or the one that this run began with."""
        settings = self.settings
        if settings.guide is None:
            return None
        if "guide" not in self.run.content:
            guide = make_guide(
                settings.guide,
                self.scenario,
                mode=settings.guide_mode,
                reach=settings.guide_reach,
                rest=settings.guide_rest,
            )
            self.run.content["guide"] = dict(guide.card)
        return guide_from_card(self.run.content["guide"], self.scenario)


class _Supervisor(BaseCallback):
    """Everything that happens between rollouts: log, evaluate, keep, save, and give rows a new sea."""

    REFRESH_STEPS = 64

    def __init__(
        self,
        training: _Training,
        model: BaseAlgorithm,
        batch: HeaveVecEnv,
        env: ScaledReward,
        guide: Guide | None,
    ) -> None:
        super().__init__()
        self.model = model
        self.guide = guide
        self.training, self.batch, self.env = training, batch, env
        self.folder, self.settings = training.run.folder, training.settings
        self.curve = CurveFile(self.folder / "progress.csv")
        self.evaluations: list[dict[str, float]] = []
        self.best: TrainedPolicy | None = None
        self.last = {"log": 0, "evaluation": 0, "checkpoint": 0, "refresh": 0}
        self.n_epochs = getattr(model, "n_epochs", 1)
        self.wall = 0.0  # seconds of the sessions before this one
        self.began = self.saved_at = time.monotonic()
        self.pause = training.save_every
        self.interrupted = threading.Event()
        self.bar: Any = None

    # Stable-Baselines3's calls ---------------------------------------------------------------

    def _on_training_start(self) -> None:
        if self.model.num_timesteps == 0:
            self._settle()
            self._evaluate(0)
        if self.training.progress:
            from tqdm import tqdm

            self.bar = tqdm(
                total=self.settings.total_steps,
                initial=self.model.num_timesteps,
                unit="step",
                unit_scale=True,
                desc=f"{self.settings.algorithm} on {self.training.scenario.name}",
                dynamic_ncols=True,
            )

    def _on_rollout_start(self) -> None:
        step = self.model.num_timesteps
        if step == 0 or step - self.last["refresh"] >= self.REFRESH_STEPS * self.settings.n_envs:
            self._check_finite()
            self._record(step)
            self._save_if_due(step)
            self._refresh(step)
            self._hold_actor(step)
        elif self.interrupted.is_set():
            self._save_if_due(step)

    def _on_step(self) -> bool:
        return True

    # What it does ----------------------------------------------------------------------------

    def failure(self) -> TrainingFailure | None:
        """What to say if weights or costs are no longer finite, or as good as not."""
        policy: Any = self.model.policy
        largest = max(
            float(parameter.detach().abs().nan_to_num(torch.inf).max()) for parameter in policy.parameters()
        )
        log_std = getattr(policy, "log_std", None)  # of PPO a weight of its own; elsewhere a bounded layer
        spread = 1.0 if log_std is None else float(torch.exp(log_std.detach()).min())
        if largest < _LARGEST_WEIGHT and spread > 0.0 and math.isfinite(self.env.mean_cost):
            return None
        return TrainingFailure(
            f"the training stopped being finite at step {self.model.num_timesteps}; the best policy so far "
            f"is kept in {str(self.folder)!r}: train with a lower learning_rate"
        )

    def _check_finite(self) -> None:
        failure = self.failure()
        if failure is not None:
            raise failure

    def _settle(self) -> None:
        """Lets the starting policy act until the start from rest has died out."""
        observation = self.model._last_obs
        assert isinstance(observation, np.ndarray)
        policy = self._policy(0)
        n = policy.architecture.n_observations
        memory = np.zeros((len(observation), 2 * policy.architecture.memory))
        for _ in range(self.env.burn_in):
            action, memory = policy.respond(observation[:, :n], memory)
            observation = np.asarray(self.env.step(action)[0])
        self.model._last_obs = observation

    def _due(self, what: str, step: int, every: int) -> bool:
        if step // every == self.last[what] // every:
            return False
        self.last[what] = step
        return True

    def _record(self, step: int) -> None:
        settings = self.settings
        if self._due("log", step, settings.log_every):
            self._log(step)
        if self._due("evaluation", step, settings.evaluate_every):
            self._evaluate(step)
        if self._due("checkpoint", step, settings.checkpoint_every):
            path = self.folder / "checkpoints" / f"policy-{step:09d}.json"
            path.parent.mkdir(exist_ok=True)
            save_policy(path, self._policy(step))

    def _log(self, step: int) -> None:
        cost, wall = self.env.gathered_cost(), self._wall()
        logger = self.model.logger
        logger.record("time/total_timesteps", step)
        logger.record("time/wall_s", wall)
        logger.record("rollout/cost_mean", cost)
        logger.record("rollout/reward_scale", self.env.scale)
        if self.evaluations:
            logger.record("validation/cost_mean", self.evaluations[-1]["cost_mean"])
            logger.record("validation/payload_heave_std", self.evaluations[-1]["payload_heave_std"])
        logger.dump(step)
        if self.bar is not None:
            shown = {"cost": f"{cost:.3g}"}
            if self.evaluations:
                shown["validation"] = f"{self.evaluations[-1]['cost_mean']:.3g}"
                shown["best"] = f"{min(row['cost_mean'] for row in self.evaluations):.3g}"
            self.bar.set_postfix(shown, refresh=False)
            self.bar.update(step - self.bar.n)

    def _policy(self, step: int, **facts: Any) -> TrainedPolicy:
        training = self.training
        card = policy_card(
            training.scenario,
            algorithm=self.settings.algorithm,
            training={"seed": training.seed, "steps": step, **facts},
            **({} if self.guide is None else {"guide": dict(self.guide.card)}),
        )
        return networks.exported(self.model, card)

    def _evaluate(self, step: int) -> None:
        row: dict[str, float] = {"step": step, "wall_s": round(self._wall(), 3)}
        row |= validation(
            self._policy(step),
            self.training.scenario,
            n_seas=self.settings.evaluation_seas,
            duration=self.settings.evaluation_duration,
            tension_cost=self.settings.charge,
        )
        best = min((old["cost_mean"] for old in self.evaluations), default=math.inf)
        self.evaluations.append(row)
        self._write_evaluations()
        if self.best is None or row["cost_mean"] < best:
            self.best = self._policy(
                step, validation_cost=row["cost_mean"], validation_cost_max=row["cost_max"]
            )
            save_policy(self.folder / "policy.json", self.best)

    def _write_evaluations(self) -> None:
        text = io.StringIO()
        writer = csv.DictWriter(text, list(self.evaluations[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(self.evaluations)
        write_atomic(self.folder / "evaluations.csv", text.getvalue().encode())

    def _hold_actor(self, step: int) -> None:
        """Lets the critic learn alone at first."""
        held = step < self.settings.critic_first
        networks.hold_actor(self.model, held)
        if isinstance(self.model, PPO):
            self.model.n_epochs = self.n_epochs * (self.settings.critic_epochs if held else 1)

    def _refresh(self, step: int) -> None:
        elapsed = (step - self.last["refresh"]) // self.settings.n_envs
        self.last["refresh"] = step
        if step == 0:
            return
        # A stream of its own, keyed by seed and step: nothing to remember, nothing drawn from others.
        rng = np.random.default_rng([self.training.seed, step])
        mask = rng.random(self.settings.n_envs) < elapsed / self.settings.mean_life
        mask |= self.env.wild_rows(elapsed)
        if mask.any():
            self.model._last_obs = self.env.venv.reset_rows(mask)  # type: ignore[attr-defined]
            self.model._last_episode_starts = np.asarray(self.model._last_episode_starts) | mask
            self.env.forget(mask)
            if isinstance(self.model, OffPolicyAlgorithm):  # no return of several steps goes on from there
                buffer: Any = self.model.replay_buffer
                buffer.dones[buffer.pos - 1, mask] = buffer.timeouts[buffer.pos - 1, mask] = 1.0

    def finish(self) -> None:
        """The last evaluation, and the run's end."""
        step = self.model.num_timesteps
        self._check_finite()
        self._log(step)
        if self.evaluations[-1]["step"] != step:
            self._evaluate(step)
        path = self.folder / "checkpoints" / "policy-final.json"
        path.parent.mkdir(exist_ok=True)
        save_policy(path, self._policy(step))
        assert self.best is not None
        self.training.run.finish(
            steps=step,
            wall_s=round(self._wall(), 1),
            evaluations=self.evaluations,
            result=card_seas(self.best, self.training.scenario, self.settings),
        )

    def close(self) -> None:
        """Ends the bar."""
        if self.bar is not None:
            self.bar.close()

    def _wall(self) -> float:
        return self.wall + time.monotonic() - self.began

    # The state to go on from -----------------------------------------------------------------

    def _wrappers(self) -> Iterator[VecEnvWrapper]:
        """The wrappers between the reward and the batch, outermost first."""
        wrapper = self.env.venv
        while isinstance(wrapper, VecEnvWrapper):
            yield wrapper
            wrapper = wrapper.venv

    def _save_if_due(self, step: int) -> None:
        begin = time.monotonic()
        stop = self.interrupted.is_set()
        if step == 0 or not (stop or begin - self.saved_at >= self.pause):
            return
        arrays, content = checkpoint.model_state(self.model)
        arrays |= {f"env/{name}": np.asarray(value) for name, value in self.batch.env.get_state().items()}
        arrays |= {f"reward/{name}": value for name, value in self.env.get_state().items()}
        for wrapper in self._wrappers():
            if isinstance(wrapper, GuidedVecEnv):
                arrays |= {f"guide/{name}": value for name, value in wrapper.get_state().items()}
        if self.best is not None:
            arrays |= {f"best/{name}": value for name, value in self.best.weights.items()}
            content["best_card"] = self.best.card
        content |= {
            "evaluations": self.evaluations,
            "last": dict(self.last),
            "wall": self._wall(),
            "curve": self.curve.rows,
        }
        checkpoint.save_state(self.training.run.state_folder, arrays, content, step)
        self.training.run.update(steps=step, wall_s=round(self._wall(), 1))
        self.saved_at = time.monotonic()
        self.pause = max(self.training.save_every, (self.saved_at - begin) / SAVE_SHARE)
        if stop:
            raise _Interrupted

    def restore(self, arrays: checkpoint.Arrays, content: Mapping[str, Any]) -> None:
        """Takes up the state that a session before this one saved."""
        checkpoint.restore_model(self.model, arrays, content)
        self.batch.env.set_state(checkpoint.under(arrays, "env/"))
        self.env.set_state(checkpoint.under(arrays, "reward/"))
        for wrapper in self._wrappers():
            if isinstance(wrapper, GuidedVecEnv):
                assert isinstance(self.model._last_obs, np.ndarray)
                wrapper.set_state(checkpoint.under(arrays, "guide/"), self.model._last_obs)
            elif isinstance(wrapper, PrivilegedVecEnv):
                wrapper.look_again()
        self.evaluations = list(content["evaluations"])
        self.last = dict(content["last"])
        self._hold_actor(self.last["refresh"])
        self.wall = float(content["wall"])
        self.curve.rows = list(content["curve"])
        if "best_card" in content:
            layers = networks.exported(self.model, content["best_card"]).architecture
            self.best = TrainedPolicy(layers, checkpoint.under(arrays, "best/"), content["best_card"])
            # The files may be of a moment after the state was saved, or half of a pair.
            save_policy(self.folder / "policy.json", self.best)


def validation(
    controller: Controller,
    scenario: Scenario,
    *,
    n_seas: int,
    duration: float,
    first_sea: int = FIRST_VALIDATION_SEED,
    tension_cost: TensionCost | None = None,
) -> dict[str, float]:
    """How a controller does on validation seas, the first half of each episode left out.

    Args:
        controller: What acts.
        scenario: With the information set that the controller sees.
        n_seas: Validation seas.
        duration: Length of the episodes, at most the scenario's own [s].
        first_sea: Seed of the first sea.
        tension_cost: What is charged for high tensions beside the task's cost.

    Returns:
        Mean, median and largest stage cost over the seas with that charge [-], standard deviations of payload
        heave and command [m], and the seas in which the operation failed [-].
    """
    n_steps = max(2, min(scenario.n_steps, round(duration / scenario.control_dt)))
    env = HeaveVectorEnv(scenario, n_seas, max_episode_steps=n_steps, autoreset_mode=AutoresetMode.DISABLED)
    observation, _ = env.reset(seed=first_sea)
    memory: Any = None
    running = np.ones(n_seas, dtype=bool)
    cost, heave, command = np.zeros(n_seas), np.zeros(n_seas), np.zeros(n_seas)
    failed, scored = np.zeros(n_seas, dtype=bool), np.zeros(n_seas)
    for step in range(n_steps):
        action, memory = controller.predict(observation, memory)
        observation, reward, terminated, _, info = env.step(action)
        count = running & (terminated | (step >= n_steps // 2))
        cost[count] -= reward[count]
        if tension_cost is not None:
            cost[count] += tension_cost.of(env)[count]
        heave[count] += info["payload_heave"][count] ** 2
        command[count] += info["command"][count] ** 2
        scored[count] += 1
        failed |= running & terminated
        running &= ~terminated
        if step + 1 < n_steps and terminated.any():
            observation, _ = env.reset(options={"reset_mask": terminated})
        if not running.any():
            break
    env.close()
    scored = np.maximum(scored, 1)
    return {
        "cost_mean": float(np.mean(cost / scored)),
        "cost_median": float(np.median(cost / scored)),
        "cost_max": float(np.max(cost / scored)),
        "payload_heave_std": float(np.sqrt(np.mean(heave / scored))),
        "command_std": float(np.sqrt(np.mean(command / scored))),
        "failed": float(failed.sum()),
    }


def card_seas(policy: TrainedPolicy, scenario: Scenario, settings: Preset) -> dict[str, float]:
    """How the policy that a training kept does on validation seas that chose nothing, for the run's card."""
    duration = min(settings.evaluation_duration, scenario.duration)
    n_seas, first_sea = settings.evaluation_seas, FIRST_CARD_SEED
    found = validation(
        policy,
        scenario,
        n_seas=n_seas,
        duration=duration,
        first_sea=first_sea,
        tension_cost=settings.charge,
    )
    return {"n_seas": n_seas, "first_sea": first_sea, "duration": duration, **found}
