"""Imitation of a designed controller as a starting point: what a plan costs to make, a network costs little.

The agent's network is fitted to the teacher's commands by least squares, on what the agent itself sees where
the agent itself goes: round by round it drives the plant, the teacher, who has a filter of its own and is
told what was commanded, says what it would have done, and all that was gathered so far is fitted again. (A
network that has only seen the teacher's own way does not know what to do beside it.) What an action at the
end of what has an effect misses in the harmless direction does not count.

Source: Ross, Gordon and Bagnell (2011), DAgger.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm

from agents.guide import Guide, Look, beside, make_guide
from agents.guided_env import command_given, guided_within, surroundings
from agents.networks import actor_mean
from baselines.oracle import DESIGNS as ORACLES
from baselines.oracle import oracle
from heave_env.scenarios import Scenario

N_ROWS = 120
"""Seas driven side by side [-]."""
N_ROUNDS = 8
"""Rounds; the teacher itself drives the first [-]."""
ROUND_STEPS = 900
"""Control steps of a round, each of which has seas of its own, at most an episode [-]."""
SETTLING = 100
"""Control steps from the start of an episode that are not learned from [-]."""
N_EPOCHS = 5
"""Passes over everything gathered so far, after each round [-]."""
LAST_EPOCHS = 25
"""Likewise after the last round [-]."""
BATCH = 2048
AT_LIMIT = 1e-6
"""Actions this close to the least or the most that have an effect count as that [-]."""
LEARNING_RATE = 2e-3


class Teacher(Protocol):
    """Who says what it would have done, and is told what was done."""

    @property
    def n_memory(self) -> int:
        """Numbers remembered from step to step [-]."""

    def look(self, observation: np.ndarray, memory: np.ndarray) -> Any:
        """What it makes of measurements (n_rows, n_observations); its own `command` is (n_rows, 1) [m]."""

    def advance(self, memory: np.ndarray, look: Any, command: np.ndarray) -> np.ndarray:
        """Next memory after the command that was given (n_rows, 1) [m]."""


@dataclass(frozen=True)
class _Looks:
    """What a teacher for each row makes of its row."""

    command: np.ndarray
    each: list[Look]


@dataclass(frozen=True)
class Oracle:
    """A teacher for each row, who knows what its sea's episode drew: it shows what an agent should come to,
    who must find out from what it sees.

    Source: Chen et al. (2020).
    """

    teachers: Sequence[Guide]

    @property
    def n_memory(self) -> int:
        """The most that any of them remembers [-]."""
        return max(teacher.n_memory for teacher in self.teachers)

    def look(self, observation: np.ndarray, memory: np.ndarray) -> _Looks:
        """Row by row."""
        looks = [
            teacher.look(observation[row : row + 1], memory[row : row + 1, : teacher.n_memory])
            for row, teacher in enumerate(self.teachers)
        ]
        return _Looks(np.vstack([look.command for look in looks]), looks)

    def advance(self, memory: np.ndarray, look: _Looks, command: np.ndarray) -> np.ndarray:
        """Row by row."""
        following = np.zeros_like(memory)
        for row, (teacher, own) in enumerate(zip(self.teachers, look.each, strict=True)):
            n = teacher.n_memory
            following[row, :n] = teacher.advance(memory[row : row + 1, :n], own, command[row : row + 1])[0]
        return following


@dataclass(frozen=True)
class School:
    """Where teachers come from."""

    card: Mapping[str, Any]
    """Who teaches, and with what weights."""
    teacher: Callable[[Sequence[int]], Teacher]
    """The teacher for the seas of these seeds."""


def school(name: str, scenario: Scenario) -> School:
    """Designs (and, where that is due, tunes) a teacher: a designed controller with a filter, or an oracle.

    Raises:
        ValueError: If the name is unknown, or the controller has no filter that could be told what was done.
    """
    if name not in ORACLES:
        guide = make_guide(name, scenario, mode="estimate", reach=1.0)
        return School(guide.card, lambda seeds: guide)

    def teacher(seeds: Sequence[int]) -> Teacher:
        found = oracle(scenario, seeds, design=name)
        # Sensors have the scales of the scenario that the agent is in, not of one that knows the draw.
        own = [
            dataclasses.replace(controller, scale=found.scale, offset=found.offset)
            for controller in found.controllers
        ]
        return Oracle([beside(own[i], mode="estimate", reach=1.0) for i in found.chosen])

    return School({"controller": name}, teacher)


def imitate(
    model: BaseAlgorithm,
    scenario: Scenario,
    school: School,
    guide: Guide | None,
    *,
    privileged: bool,
    excitation: float,
    first_sea: int,
    seed: int,
) -> float:
    """Fits the actor of a model to a teacher's commands.

    Args:
        model: The algorithm, its actor as it starts.
        scenario: As the agent sees it.
        school: Where those come from who are imitated.
        guide: The designed controller beside the agent, if there is one.
        privileged: Whether the truth stands behind the observation, for the critic.
        excitation: Deviation of the white noise on the action while data are gathered [-].
        first_sea: Seed of the first of the seas, training seas.
        seed: Of the order in which data are shown.

    Returns:
        The share of the teacher's mean square action that the fit leaves, on the data of the last round
        before they were learned from [-].
    """
    _, env = surroundings(scenario, N_ROWS, guide, privileged=privileged)
    n_raw = len(scenario.observation_names)
    rng = np.random.default_rng([seed, first_sea])
    generator = torch.Generator().manual_seed(seed)
    reach = scenario.winch.command_range
    ends = np.full((N_ROWS, 1), reach)
    rests = 0.0 if guide is None else guide.rest
    n_steps = min(ROUND_STEPS, scenario.n_steps - 1)
    observations: list[np.ndarray] = []
    targets: list[np.ndarray] = []
    left = float("nan")
    for turn in range(N_ROUNDS):
        fresh: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
        first = first_sea + turn * N_ROWS
        teacher = school.teacher(range(first, first + N_ROWS))
        env.seed(first)
        seen = np.asarray(env.reset())
        memory = np.zeros((N_ROWS, teacher.n_memory))
        running = np.ones(N_ROWS, dtype=bool)
        for step in range(n_steps):
            look = teacher.look(seen[:, :n_raw], memory)
            target = _action(env, look.command, reach)
            if step >= min(SETTLING, n_steps // 2):
                least, most = _action(env, -ends, reach), _action(env, ends, reach)
                rest = rests * (target == 0.0)
                told = np.hstack([target, target <= least + AT_LIMIT, target >= most - AT_LIMIT, rest])
                fresh[0].append(seen[running])
                fresh[1].append(told[running])
            action = target if turn == 0 else _mean(model, seen)
            noise = excitation * rng.standard_normal((N_ROWS, 1))
            env.step_async(np.clip(action + noise, -1.0, 1.0))
            command = command_given(env, reach)
            following, _, done, _ = env.step_wait()
            seen = np.asarray(following)
            memory = teacher.advance(memory, look, command)
            # A row whose operation failed is in a sea now that the teacher was not made for.
            running &= ~done
            if not running.any():
                break
        gathered, wanted = np.concatenate(fresh[0]), np.concatenate(fresh[1])
        if turn == N_ROUNDS - 1:
            missed = _missed(torch.as_tensor(_mean(model, gathered)[:, 0]), torch.as_tensor(wanted))
            left = float(torch.mean(missed**2)) / max(float(np.mean(wanted[:, 0] ** 2)), 1e-30)
        observations.append(gathered)
        targets.append(wanted)
        epochs = LAST_EPOCHS if turn == N_ROUNDS - 1 else N_EPOCHS
        _fit(model, np.concatenate(observations), np.concatenate(targets), epochs, generator)
    env.close()
    return left


def _action(env: Any, command: np.ndarray, reach: float) -> np.ndarray:
    """The action that gives a command [m], or does the same to the drum, (n_rows, 1)."""
    guided = guided_within(env)
    return np.clip(command / reach, -1.0, 1.0) if guided is None else guided.action_for(command)


def _mean(model: BaseAlgorithm, seen: np.ndarray) -> np.ndarray:
    with torch.no_grad():
        mean = actor_mean(model, torch.as_tensor(seen, dtype=torch.float32))
    return np.clip(mean.numpy().astype(float), -1.0, 1.0)


def _missed(action: torch.Tensor, wanted: torch.Tensor) -> torch.Tensor:
    """How far actions (n,) miss what is wanted, (n, 4): an action, whether it is the least, the most that has
    an effect, beyond which more is the same, and how far beside it the drum does the same: it rests."""
    off = action - wanted[:, 0]
    off = off - off.clamp(-wanted[:, 3], wanted[:, 3])
    off = torch.where(wanted[:, 1] > 0.5, off.clamp(min=0.0), off)
    return torch.where(wanted[:, 2] > 0.5, off.clamp(max=0.0), off)


def _fit(
    model: BaseAlgorithm, seen: np.ndarray, targets: np.ndarray, n_epochs: int, generator: torch.Generator
) -> None:
    x = torch.as_tensor(seen, dtype=torch.float32)
    y = torch.as_tensor(targets, dtype=torch.float32)
    size = float(y[:, 0].std()) + 1e-6
    parameters = [weight for weight in model.policy.parameters() if weight.requires_grad]
    optimiser = torch.optim.Adam(parameters, lr=LEARNING_RATE)
    n_batches = max(1, len(x) // BATCH)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, n_epochs * n_batches)
    for _ in range(n_epochs):
        order = torch.randperm(len(x), generator=generator)
        for rows in order.chunk(n_batches):
            optimiser.zero_grad()
            loss = torch.mean(_missed(actor_mean(model, x[rows])[:, 0], y[rows]) ** 2) / size**2
            loss.backward()
            optimiser.step()
            schedule.step()
