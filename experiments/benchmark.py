"""How fast it is, beside yardsticks that everybody knows, measured in the same run on one core.

Each figure and its yardstick are measured in turns, so that both meet the same machine; a figure is the
median of its repeats. CartPole steps a toy of four states, the environments here a cable of 20 or 50
elements. Only steps that advance an episode are counted: the extra step with which NEXT_STEP resets a row
is not. How the cost grows with elements, environments and solver steps is measured in turns too, and the
kernel beside the roofs of `machine`.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.machine import measured_peaks
from heave_env.parameters import GRAVITY, SEAWATER_DENSITY
from heave_env.provenance import provenance
from heave_env.scenarios import Scenario, load

SCENARIO = "sea_state_5"
ELEMENTS = (20, 50)
"""Elements of the cable that are measured [-]."""
BATCHES = (256, 4096)
"""Environments of the native batches that are measured [-]."""
SHARED_BATCHES = (256, 1024, 4096)
"""Environments of the batches that two threads share [-]."""
PPO_ENVS = 256
"""Environments of the training that is measured [-]."""
ROUNDS = 5
"""Repeats of each measurement [-]."""
ROUND_SECONDS = 0.3
"""Length of a repeat [s]."""
GROWTH = {
    "elements": (5, 10, 20, 50, 100, 200),
    "environments": (1, 4, 16, 64, 256, 1024, 4096, 16384),
    "solver steps": (1, 2, 4, 8),
}
"""What the cost of a step is measured against [-]."""
FLOPS_PER_NODE = 59
"""Operations of a node of the linear cable in a solver step, as `heave_env.cable.axial` writes them:
assembly 29, elimination 11, substitution 2, motion and tension 17. Additions, multiplications, divisions,
minima and maxima count one, a multiply-add two. Sea, winch, sensors and task are not counted."""
ROLLED_STEPS = 50
"""Control steps of a rollout in one call [-]."""
RETURN_SHARE = 0.1
"""The training's target: this share of the cost without control [-]."""

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


def _usable(package: str) -> bool:
    """Whether a yardstick's package can be imported; one that lacks parts of its own cannot."""
    if importlib.util.find_spec(package) is None:
        return False
    try:
        importlib.import_module(package)
    except Exception:  # whatever a package without its files raises
        return False
    return True


def _envpool_cartpole(num_envs: int) -> Stepper:
    import envpool  # type: ignore[import-not-found]

    env = envpool.make("CartPole-v1", env_type="gymnasium", num_envs=num_envs, num_threads=1)
    actions = list(np.random.default_rng(0).integers(0, 2, (16, num_envs)).astype(np.int32))
    env.reset()

    def run(seconds: float) -> float:
        count, begin = 0, time.perf_counter()
        while True:
            for action in actions:
                _, _, terminated, truncated, _ = env.step(action)
                count += num_envs - int(np.count_nonzero(terminated | truncated))
            spent = time.perf_counter() - begin
            if spent >= seconds:
                return count / spent

    return run


def _moordyn(scenario: Scenario) -> Stepper:
    """MoorDyn's line of as many segments under a sheave that heaves; its control steps per second."""
    from experiments.moordyn_line import moordyn_march

    assert scenario.cable is not None and scenario.payload is not None
    dt, payload = scenario.control_dt, scenario.payload
    # MoorDyn wants the weight to be that of the section; it differs by 2 %, and the speed not at all.
    section = 0.25 * np.pi * scenario.cable.diameter**2
    weight = (scenario.cable.mass_per_length - SEAWATER_DENSITY * section) * GRAVITY
    cable = dataclasses.replace(scenario.cable, submerged_weight=float(weight))

    def run(seconds: float) -> float:
        n_steps = 400 if seconds > 0.1 else 2
        top = np.zeros((n_steps + 1, 3))
        top[:, 2] = np.sin(0.6 * dt * np.arange(n_steps + 1)) - 20.0
        length, n_segments = scenario.initial_length, scenario.n_elements
        march = moordyn_march(cable, payload, top, dt, length=length, n_segments=n_segments, settling=0.0)
        return n_steps / march.seconds

    return run


def _rolled(scenario: Scenario, num_envs: int, hidden: tuple[int, ...] | None) -> Stepper:
    """Many steps in one call: open loop, or (given the widths of hidden layers) a policy for each row."""
    from heave_env.plant import Plant
    from heave_env.rollouts import TanhPolicy, n_parameters, rollout

    plant = Plant(scenario, num_envs, dtype="float32")
    rng = np.random.default_rng(0)
    acting: Any = rng.uniform(-0.1, 0.1, (ROLLED_STEPS, num_envs))
    if hidden is not None:
        widths = (plant.observation.shape[1], *hidden, 1)
        acting = TanhPolicy(rng.normal(0.0, 0.01, (num_envs, n_parameters(widths))), widths)
    every, seeds = np.ones(num_envs, dtype=bool), np.arange(num_envs)

    def run(seconds: float) -> float:
        count, spent = 0, 0.0
        while spent < seconds:
            plant.begin(every, seeds)
            begin = time.perf_counter()
            made = rollout(plant, acting, ROLLED_STEPS).n_steps
            spent += time.perf_counter() - begin
            count += int(made.sum())
        return count / spent

    run(1e-9)
    return run


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
    many, longest = BATCHES[-1], variants[ELEMENTS[-1]]
    name = f"{ELEMENTS[-1]} elements"
    own = {"scenario": longest, "dtype": "float32"}
    if _usable("envpool"):
        found += [
            Case(
                f"batch of {num_envs}, float32, full info, {name}",
                f"EnvPool's CartPole, {num_envs}, one thread",
                partial(_native, base.environment_id, num_envs, **own),
                partial(_envpool_cartpole, num_envs),
            )
            for num_envs in BATCHES
        ]
    if (os.cpu_count() or 1) > 1:
        found += [
            Case(
                f"batch of {num_envs}, float32, full info, {name}, 2 threads",
                "the same on one thread",
                partial(_native, base.environment_id, num_envs, n_threads=2, **own),
                partial(_native, base.environment_id, num_envs, n_threads=1, **own),
            )
            for num_envs in SHARED_BATCHES
        ]
    found += [
        Case(
            f"{ROLLED_STEPS} steps in one call, {many} envs, float32, {name}, {who}",
            f"batch of {many} stepped, full info",
            partial(_rolled, longest, many, hidden),
            partial(_native, base.environment_id, many, **own),
        )
        for who, hidden in (
            ("open loop", None),
            ("own linear policies", ()),
            ("own policies of 16 tanh", (16,)),
        )
    ]
    if importlib.util.find_spec("moordyn") is not None:
        found.append(
            Case(
                f"single env, unwrapped, no info, {name}",
                f"MoorDyn, line of {ELEMENTS[-1]} segments",
                partial(_bare, longest),
                partial(_moordyn, longest),
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


def _kernel(scenario: Scenario, num_envs: int, seconds: float) -> float:
    """Steps per second of the plant alone, in single precision on one thread, without the face.

    From the median call, which meets no other process: the roofs are measured in as short bursts.
    """
    from heave_env.plant import Plant

    plant = Plant(scenario, num_envs, dtype="float32")
    plant.begin(np.ones(num_envs, dtype=bool), np.arange(num_envs))
    actions = np.zeros(num_envs)
    spent: list[float] = []
    plant.advance(actions)
    end = time.perf_counter() + seconds
    while not spent or time.perf_counter() < end:
        begin = time.perf_counter()
        plant.advance(actions)
        spent.append(time.perf_counter() - begin)
    return num_envs / statistics.median(spent)


def growth(*, rounds: int, seconds: float) -> list[dict[str, Any]]:
    """Time of an environment's step against elements, environments and solver steps [ns]; medians.

    Each list is measured in turns, with `batch` rows and alone, as the public faces step without info.
    """
    from heave_env.env import HeaveVectorEnv

    base = dataclasses.replace(load(SCENARIO), n_elements=ELEMENTS[-1])
    many = BATCHES[-1]

    def stepper(scenario: Scenario, num_envs: int) -> Stepper:
        return batch(HeaveVectorEnv(scenario, num_envs, dtype="float32", info=False))

    found = []
    for name, values in GROWTH.items():
        steppers: list[tuple[int, str, Stepper]] = []
        for value in values:
            if name == "environments":
                steppers.append((value, "batch, float32", stepper(base, value)))
                continue
            changed: dict[str, Any] = {"n_elements" if name == "elements" else "n_substeps": value}
            scenario = dataclasses.replace(base, **changed)
            steppers.append((value, f"batch of {many}, float32", stepper(scenario, many)))
            steppers.append((value, "single, float64", _bare(scenario)))
        spent: list[list[float]] = [[] for _ in steppers]
        for _ in range(rounds):
            for times, (_, _, run) in zip(spent, steppers, strict=True):
                times.append(1e9 / run(seconds))
        found += [
            {"against": name, "value": value, "face": face, "nanoseconds": statistics.median(times)}
            for times, (value, face, _) in zip(spent, steppers, strict=True)
        ]
    return found


def roofs(*, rounds: int, seconds: float, quick: bool) -> dict[str, float]:
    """The kernel's share of what the core can do, one thread, single precision, the largest batch.

    Bytes are the least that must move: the batch's state read and written once per control step.
    """
    from heave_env.plant import Plant

    scenario = dataclasses.replace(load(SCENARIO), n_elements=ELEMENTS[-1])
    many = BATCHES[-1]
    peaks = measured_peaks(quick=quick)
    speed = _kernel(scenario, many, rounds * seconds)
    flops = speed * scenario.n_elements * scenario.n_substeps * FLOPS_PER_NODE
    plant = Plant(scenario, many, dtype="float32")
    state = plant.get_state()["state"].nbytes / many
    return {
        **peaks.to_mapping(),
        "kernel_steps": speed,
        "kernel_flops": flops,
        "share_of_flops": flops / peaks.float32_flops,
        "state_bytes": state,
        "share_of_copying": 2.0 * state * speed / peaks.copied_bytes,
    }


_START = """
import time
begin = time.perf_counter()
import heave_env
imported = time.perf_counter()
import gymnasium
env = gymnasium.make(heave_env.load({name!r}).environment_id)
env.reset(seed=0)
env.step(env.action_space.sample())
print(imported - begin, time.perf_counter() - begin)
"""


def start_times(*, rounds: int) -> dict[str, float]:
    """Seconds to import the package, and to the end of the first step, in a fresh process; medians.

    What the kernel's compilation left on disk is there: the other figures come first.
    """
    found = []
    for _ in range(rounds):
        done = subprocess.run(
            [sys.executable, "-c", _START.format(name=SCENARIO)], capture_output=True, text=True, check=True
        )
        found.append([float(word) for word in done.stdout.split()])
    imported, stepped = (statistics.median(times) for times in zip(*found, strict=True))
    return {"import_seconds": imported, "first_step_seconds": stepped}


def time_to_return(*, total_steps: int = 1_500_000, scenario: str = "thesis_linear") -> dict[str, Any]:
    """Seconds until PPO's preset costs no more than `RETURN_SHARE` of no control, on its validation seas.

    The evaluations' own time is in it. The preset of this scenario starts by doing nothing: all is learnt.
    """
    import csv

    from agents.train import train

    with tempfile.TemporaryDirectory() as folder:
        preset = {"evaluate_every": 65_536, "checkpoint_every": total_steps}
        run = train(
            scenario, out=Path(folder) / "run", total_steps=total_steps, preset=preset, progress=False
        )
        with (run / "evaluations.csv").open(encoding="utf-8", newline="") as file:
            rows = [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]
    without = load(scenario).uncontrolled_cost
    reached = next((row for row in rows if row["cost_mean"] <= RETURN_SHARE * without), None)
    return {
        "figure": f"PPO's preset in {scenario}: a cost of {RETURN_SHARE:.0%} of no control",
        "cost_without_control": without,
        "seconds": None if reached is None else reached["wall_s"],
        "steps": None if reached is None else reached["step"],
        "best_cost": min(row["cost_mean"] for row in rows),
        "whole_seconds": rows[-1]["wall_s"],
        "whole_steps": rows[-1]["step"],
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
    every = cases()
    for i, case in enumerate(every):
        say(f"[{i + 1}/{len(every)}] {case.name}, beside {case.yardstick}")
        figures.append(measured(case, rounds=rounds, seconds=seconds))
    say("the kernel beside the roofs of this core")
    machine = roofs(rounds=rounds, seconds=seconds, quick=quick)
    start = start_times(rounds=min(rounds, 3))
    say("how the cost grows")
    grown = growth(rounds=min(rounds, 3), seconds=min(seconds, 0.15))
    notes, training = [], None
    try:
        say("the share of the environment in PPO")
        figures += training_share(rollouts=1 if quick else 4, rounds=1 if quick else 3)
        say("the time to a given return")
        training = time_to_return(total_steps=32_768 if quick else 1_500_000)
    except ModuleNotFoundError as error:
        notes.append(f"no training was measured: the package {error.name!r} is not installed")
    for package, name in (("envpool", "EnvPool"), ("moordyn", "MoorDyn")):
        if not _usable(package):
            notes.append(f"{name} is not installed, or not whole: its yardstick was left out")
    return {
        "kind": "benchmark",
        "scenario": {"name": SCENARIO, "fingerprint": load(SCENARIO).fingerprint},
        "cores": 1,
        "quick": quick,
        "figures": figures,
        "machine": machine,
        "start": start,
        "growth": grown,
        "training": training,
        "notes": notes,
        "provenance": provenance(None if arguments is None else list(arguments)),
    }


def _rate(value: float) -> str:
    """Three digits that count."""
    digits = 2 - int(np.floor(np.log10(value)))
    return f"{round(value, digits):,.{max(digits, 0)}f}"


def _figure_rows(found: dict[str, Any]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for item in found["figures"]:
        share = item["unit"] == "share"
        value = f"{100.0 * item['value']:.1f} %" if share else _rate(item["value"] / 1e3)
        ratio = "" if share else _rate(item["ratio"])
        rows.append((item["figure"], value, item["yardstick"], _rate(item["yardstick_value"] / 1e3), ratio))
    return rows


def _growth_rows(found: dict[str, Any], against: str) -> list[tuple[str, ...]]:
    """One row per face: its name, and the time at each value."""
    times: dict[str, list[str]] = {}
    for item in found["growth"]:
        if item["against"] == against:
            times.setdefault(item["face"], []).append(f"{item['nanoseconds']:,.0f}")
    return [(face, *values) for face, values in times.items()]


def _machine_lines(found: dict[str, Any]) -> list[str]:
    machine = found["machine"]
    giga = {name: value / 1e9 for name, value in machine.items()}
    return [
        f"One core does {giga['float32_flops']:.0f} GFLOP/s in float32 and {giga['float64_flops']:.0f} in "
        f"float64, and copies {giga['copied_bytes']:.1f} GB/s.",
        f"The kernel ({BATCHES[-1]} environments, {ELEMENTS[-1]} elements, float32) makes "
        f"{1e3 * giga['kernel_steps']:.2f} million steps/s: {giga['kernel_flops']:.1f} GFLOP/s at "
        f"{FLOPS_PER_NODE} operations per node and solver step, {machine['share_of_flops']:.0%} of that; its "
        f"{machine['state_bytes']:.0f} bytes of state per environment, read and written once, are "
        f"{machine['share_of_copying'] * giga['copied_bytes']:.1f} GB/s, {machine['share_of_copying']:.0%} "
        "of the copying: more than all of it where the batch fits into the cache.",
        f"A fresh process, the kernel on disk: import {found['start']['import_seconds']:.2f} s, first step "
        f"{found['start']['first_step_seconds']:.2f} s after its beginning.",
    ]


def _training_lines(found: dict[str, Any]) -> list[str]:
    training = found["training"]
    if training is None:
        return []
    reached = (
        f"not in {training['whole_steps']:,.0f} steps"
        if training["seconds"] is None
        else f"after {training['seconds']:.0f} s, {training['steps']:,.0f} steps"
    )
    return [f"{training['figure']}: {reached}; best cost {training['best_cost']:.3g}."]


def _origin_lines(found: dict[str, Any]) -> list[str]:
    made = found["provenance"]
    packages = ", ".join(f"{name} {version}" for name, version in made["versions"].items())
    return [
        *found["notes"],
        f"{made['date']}, {made['processor']}, one core unless said; commit {made['commit']}; {packages}",
    ]


_HEADINGS = ("figure", "10³ steps/s", "yardstick", "10³ steps/s", "ratio")


def tables(found: dict[str, Any]) -> list[str]:
    """The figures as lines of text."""
    lines = []
    for name, value, yardstick, beside, ratio in (_HEADINGS, *_figure_rows(found)):
        lines.append(f"{name:<72}{value:>12}  {yardstick:<34}{beside:>12}{ratio:>8}")
    for against in GROWTH:
        values = sorted({item["value"] for item in found["growth"] if item["against"] == against})
        lines += ["", f"{'nanoseconds per step; ' + against:<40}" + "".join(f"{v:>9}" for v in values)]
        for face, *times in _growth_rows(found, against):
            lines.append(f"{face:<40}" + "".join(f"{time:>9}" for time in times))
    return [*lines, "", *_machine_lines(found), *_training_lines(found), *_origin_lines(found)]


def markdown(found: dict[str, Any]) -> list[str]:
    """The figures as the tables of docs/benchmark.md."""

    def table(rows: Sequence[Sequence[str]]) -> list[str]:
        head, *body = ["| " + " | ".join(row) + " |" for row in rows]
        return [head, "|" + "---|" * len(rows[0]), *body, ""]

    lines = table([_HEADINGS, *_figure_rows(found)])
    for against in GROWTH:
        values = sorted({item["value"] for item in found["growth"] if item["against"] == against})
        head = (f"nanoseconds per step; {against}", *(str(value) for value in values))
        lines += table([head, *_growth_rows(found, against)])
    paragraphs = [*_machine_lines(found), *_training_lines(found), *_origin_lines(found)]
    return [*lines, *(line for paragraph in paragraphs for line in (paragraph, ""))][:-1]
