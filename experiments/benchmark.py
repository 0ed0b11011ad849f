"""How fast it is, beside yardsticks that everybody knows, measured in the same run on one core.

Each figure and its yardstick are measured in turns, so that both meet the same machine; a figure is the
median of its repeats. CartPole steps a toy of four states, the environments here a cable of 20 or 50
elements. Only steps that advance an episode are counted: the extra step with which NEXT_STEP resets a row
is not.
"""

from __future__ import annotations

import dataclasses
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from heave_env.provenance import provenance
from heave_env.scenarios import Scenario, load

SCENARIO = "sea_state_5"
ELEMENTS = (20, 50)
"""Elements of the cable that are measured [-]."""
BATCHES = (256, 4096)
"""Environments of the native batches that are measured [-]."""
PPO_ENVS = 256
"""Environments of the training that is measured [-]."""
ROUNDS = 5
"""Repeats of each measurement [-]."""
ROUND_SECONDS = 0.6
"""Length of a repeat [s]."""

Stepper = Callable[[float], float]
"""Steps an environment for about so many seconds and returns the steps per second."""


@dataclass(frozen=True)
class Case:
    """A figure to measure, and what it is measured beside."""

    name: str
    """What it is."""
    yardstick: str
    """What it is compared with."""
    build: Callable[[], Stepper]
    """Builds the environment, warmed up."""
    build_yardstick: Callable[[], Stepper]
    """Builds the yardstick."""


def _warmed_up(env: Any, n_actions: int) -> list[Any]:
    """Actions drawn beforehand, a few of which have been tried; the environment stands at its start."""
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(n_actions)]
    env.reset(seed=0)
    for action in actions[:3]:
        env.step(action)
    env.reset(seed=0)
    return actions


def single(env: Any) -> Stepper:
    """Steps one environment with actions drawn beforehand."""
    actions = _warmed_up(env, 512)

    def run(seconds: float) -> float:
        count, begin = 0, time.perf_counter()
        while True:
            for action in actions:
                _, _, terminated, truncated, _ = env.step(action)
                if terminated or truncated:
                    env.reset()
            count += len(actions)
            spent = time.perf_counter() - begin
            if spent >= seconds:
                return count / spent

    return run


def batch(env: Any) -> Stepper:
    """Steps a native batch with actions drawn beforehand; resets are not counted as steps."""
    actions = _warmed_up(env, 16)

    def run(seconds: float) -> float:
        count, begin = 0, time.perf_counter()
        while True:
            for action in actions:
                _, _, terminated, truncated, _ = env.step(action)
                count += env.num_envs - int(np.count_nonzero(terminated | truncated))
            spent = time.perf_counter() - begin
            if spent >= seconds:
                return count / spent

    return run


def _wrapped(environment_id: str, **options: Any) -> Stepper:
    import gymnasium as gym

    return single(gym.make(environment_id, **options))


def _bare(scenario: Scenario) -> Stepper:
    from heave_env.env import HeaveEnv

    return single(HeaveEnv(scenario, info=False))


def _bare_cartpole() -> Stepper:
    from gymnasium.envs.classic_control.cartpole import CartPoleEnv

    return single(CartPoleEnv())


def _native(environment_id: str, num_envs: int, **options: Any) -> Stepper:
    import gymnasium as gym

    # CartPole would be a loop over single environments unless its own batch is asked for.
    return batch(
        gym.make_vec(environment_id, num_envs=num_envs, vectorization_mode="vector_entry_point", **options)
    )


def cases() -> list[Case]:
    """Every figure, in the order of the table."""
    import gymnasium as gym

    import heave_env  # registers the scenarios

    gym.register_envs(heave_env)
    base = load(SCENARIO)
    variants = {n: dataclasses.replace(base, n_elements=n) for n in ELEMENTS}
    found = []
    for n, scenario in variants.items():
        found += [
            Case(
                f"single env, gym.make, full info, {n} elements",
                "CartPole-v1, gym.make",
                partial(_wrapped, base.environment_id, scenario=scenario),
                partial(_wrapped, "CartPole-v1"),
            ),
            Case(
                f"single env, unwrapped, no info, {n} elements",
                "CartPole-v1, unwrapped",
                partial(_bare, scenario),
                _bare_cartpole,
            ),
        ]
    for num_envs in BATCHES:
        for dtype in ("float64", "float32"):
            for n, scenario in variants.items():
                options = {"scenario": scenario, "dtype": dtype, "n_threads": 1}
                found.append(
                    Case(
                        f"batch of {num_envs}, {dtype}, full info, {n} elements",
                        f"CartPoleVectorEnv, {num_envs}",
                        partial(_native, base.environment_id, num_envs, **options),
                        partial(_native, "CartPole-v1", num_envs),
                    )
                )
    return found


def measured(case: Case, *, rounds: int, seconds: float) -> dict[str, Any]:
    """Measures a figure and its yardstick in turns; medians [steps/s]."""
    run, run_yardstick = case.build(), case.build_yardstick()
    own, other = [], []
    for _ in range(rounds):
        own.append(run(seconds))
        other.append(run_yardstick(seconds))
    value, beside = statistics.median(own), statistics.median(other)
    return {
        "figure": case.name,
        "unit": "env steps/s",
        "value": value,
        "yardstick": case.yardstick,
        "yardstick_value": beside,
        "ratio": value / beside,
        "repeats": own,
        "yardstick_repeats": other,
    }


def training_share(*, rollouts: int, rounds: int) -> list[dict[str, Any]]:
    """Share of wall time that the environment, and its adapter with it, take in PPO.

    256 environments x 64 steps, 4 minibatches x 4 epochs, a 64x64 network, on one torch thread.

    Args:
        rollouts: Rollouts per repeat, each followed by its update.
        rounds: Repeats; the figure is their median.
    """
    import torch
    from stable_baselines3 import PPO

    from agents.vec_env import HeaveVecEnv

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    shares: dict[str, list[float]] = {"environment": [], "environment and adapter": []}
    speed = []
    try:
        vec_env = HeaveVecEnv(load(SCENARIO), PPO_ENVS, info=False)
        spent = {"environment": 0.0, "environment and adapter": 0.0}
        _timed(vec_env.env, "step", spent, "environment")
        _timed(vec_env, "step_wait", spent, "environment and adapter")
        model = PPO(
            "MlpPolicy", vec_env, n_steps=64, batch_size=PPO_ENVS * 16, n_epochs=4, device="cpu", seed=0
        )
        steps = PPO_ENVS * 64
        model.learn(steps)  # warms up
        for _ in range(rounds):
            for name in spent:
                spent[name] = 0.0
            begin = time.perf_counter()
            model.learn(rollouts * steps, reset_num_timesteps=False)
            total = time.perf_counter() - begin
            speed.append(rollouts * steps / total)
            for name, share in shares.items():
                share.append(spent[name] / total)
        vec_env.close()
    finally:
        torch.set_num_threads(threads)
    return [
        {
            "figure": f"wall time of {name} in PPO, {PPO_ENVS} envs, {load(SCENARIO).n_elements} elements",
            "unit": "share",
            "value": statistics.median(share),
            "yardstick": "whole training, env steps/s",
            "yardstick_value": statistics.median(speed),
            "ratio": statistics.median(share),
            "repeats": share,
            "yardstick_repeats": speed,
        }
        for name, share in shares.items()
    ]


def _timed(owner: Any, method: str, spent: dict[str, float], name: str) -> None:
    original = getattr(owner, method)

    def timed(*args: Any, **kwargs: Any) -> Any:
        begin = time.perf_counter()
        try:
            return original(*args, **kwargs)
        finally:
            spent[name] += time.perf_counter() - begin

    setattr(owner, method, timed)


def measure(
    *,
    quick: bool = False,
    arguments: Sequence[str] | None = None,
    announce: Callable[[str], None] | None = None,
) -> dict[str, Any]:
    """Measures everything.

    Args:
        quick: Whether short measurements will do, to see that all runs.
        arguments: Command line of the provenance; None: the process's own.
        announce: Called with the name of each figure before it is measured.

    Returns:
        Every figure with its yardstick and ratio, and where it was measured.
    """
    say = announce or (lambda line: None)
    rounds, seconds = (1, 0.02) if quick else (ROUNDS, ROUND_SECONDS)
    figures = []
    for case in cases():
        say(f"measuring {case.name}")
        figures.append(measured(case, rounds=rounds, seconds=seconds))
    notes = []
    say("measuring the share of the environment in PPO")
    try:
        figures += training_share(rollouts=1 if quick else 4, rounds=1 if quick else 3)
    except ModuleNotFoundError as error:
        notes.append(f"no training was measured: the package {error.name!r} is not installed")
    return {
        "kind": "benchmark",
        "scenario": {"name": SCENARIO, "fingerprint": load(SCENARIO).fingerprint},
        "cores": 1,
        "quick": quick,
        "figures": figures,
        "notes": notes,
        "provenance": provenance(None if arguments is None else list(arguments)),
    }


def tables(found: dict[str, Any]) -> list[str]:
    """The figures as lines of text."""
    lines = [f"{'figure':<62}{'value':>14}  {'yardstick':<30}{'value':>14}{'ratio':>8}"]
    for item in found["figures"]:
        share = item["unit"] == "share"
        value = f"{100.0 * item['value']:.1f} %" if share else f"{item['value']:,.0f}"
        ratio = "" if share else f"{item['ratio']:.2f}"
        lines.append(
            f"{item['figure']:<62}{value:>14}  {item['yardstick']:<30}"
            f"{item['yardstick_value']:>14,.0f}{ratio:>8}"
        )
    made = found["provenance"]
    packages = ", ".join(f"{name} {version}" for name, version in made["versions"].items())
    lines += [
        *found["notes"],
        f"{made['date']}, {made['processor']}, one core; commit {made['commit']}",
        packages,
    ]
    return lines
