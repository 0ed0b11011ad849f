"""Imitation of a designed controller as a starting point: what a plan costs to make, a network costs little.

The agent's network is fitted to the teacher's commands by least squares, on what the agent itself sees where
the agent itself goes: round by round it drives the plant, the teacher, who has a filter of its own and is
told what was commanded, says what it would have done, and all that was gathered so far is fitted again. (A
network that has only seen the teacher's own way does not know what to do beside it.) What an action at the
end of what has an effect misses in the harmless direction does not count.

With `repeat_worst` a part of a lesson's seas are those in which the agent missed most when it was last there:
a few in a hundred decide whether it ever loses its loop.

With `take_over` the teacher acts in the agent's place wherever that misses it by much: an agent that cannot
hold its loop yet would show nothing but how it loses it.

A network with a memory is fitted to whole episodes, from their beginning on: what it should remember is told
by what it must say later. The gradient goes back `CHUNK` control steps.

Each round is kept on disk, so that an imitation goes on after the last whole one when it was killed.

Source: Ross, Gordon and Bagnell (2011), DAgger; Zhang and Cho (2017), SafeDAgger, for the taking over.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.numpy import load as load_tensors
from safetensors.numpy import save as save_tensors
from sb3_contrib import RecurrentPPO
from stable_baselines3.common.base_class import BaseAlgorithm

from agents import checkpoint
from agents.guide import Guide
from agents.guided_env import command_given, guided_within, surroundings
from agents.networks import actor_mean, actor_sequence
from agents.policy import sha256
from agents.teachers import School, Teacher
from heave_env.files import write_atomic
from heave_env.scenarios import Scenario

ROUND_STEPS = 900
"""Control steps of a round, each of which has seas of its own, at most an episode [-]."""
SETTLING = 100
"""Control steps from the start of an episode that a network without a memory does not learn from [-]: there
a filter that has seen little yet does otherwise than later with the same samples."""
LAST_EPOCHS = 5
"""Times as many epochs after the last round [-]."""
BATCH = 2048
AT_LIMIT = 1e-6
"""Actions this close to the least or the most that have an effect count as that [-]."""
LEARNING_RATE = 2e-3
FIRST_REPEAT = 3
"""Rounds before the first in which seas are repeated [-]: at first the agent misses everywhere."""
SEQUENCES = 32
"""Rows of a batch where a network with a memory is fitted [-]."""
CHUNK = 90
"""Control steps that its gradient goes back [-]."""
LARGEST_GRADIENT = 1.0
"""Norm at which its gradient is cut off [-]."""


@dataclass(frozen=True)
class Lesson:
    """What a round gave: of each control step and row."""

    seen: np.ndarray
    """What the agent saw, (n_steps, n_rows, n), float32."""
    wanted: np.ndarray
    """What the teacher wanted, as `_missed` takes it, (n_steps, n_rows, 4), float32."""
    counts: np.ndarray
    """Whether it is learned from, (n_steps, n_rows)."""

    @property
    def samples(self) -> tuple[np.ndarray, np.ndarray]:
        """What was seen and wanted where it counts, (n, ...)."""
        return self.seen[self.counts], self.wanted[self.counts]

    def packed(self) -> bytes:
        """The lesson as a safetensors file."""
        arrays = {"seen": self.seen, "wanted": self.wanted, "counts": self.counts}
        return save_tensors({name: np.ascontiguousarray(value) for name, value in arrays.items()})


@dataclass
class Course:
    """An imitation on its way: what was gathered, and with what the next round begins."""

    rng: np.random.Generator
    generator: torch.Generator
    lessons: list[Lesson] = field(default_factory=list)
    misses: dict[int, float] = field(default_factory=dict)
    """Mean square by which the agent missed in each sea when it was last there, by its seed [-]."""
    left: float = float("nan")
    """Share of the teacher's mean square action that the fit leaves, on what was not yet learned from."""
    taken: float = 0.0
    """Share of the last round's control steps in which the teacher acted [-]."""
    wall: float = 0.0
    """Seconds so far."""
    wall_before: float = 0.0
    """Of these, in sessions before this one."""

    @property
    def size(self) -> float:
        """Root mean square of the teacher's action in the first round [-]."""
        _, wanted = self.lessons[0].samples
        return float(np.sqrt(np.mean(wanted[:, 0] ** 2)))


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
    n_rounds: int,
    n_rows: int,
    n_epochs: int,
    take_over: float | None = None,
    repeat_worst: float = 0.0,
    keep: Path | None = None,
    progress: str | None = None,
) -> Course:
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
        n_rounds: Rounds; the teacher itself drives the first [-].
        n_rows: Seas driven side by side [-].
        n_epochs: Passes over everything gathered so far after each round, `LAST_EPOCHS` times as many after
            the last [-].
        take_over: How far the agent's action may be off, over the root mean square of the teacher's, before
            the teacher acts in its place [-]; None: however far.
        repeat_worst: Share of a round's seas that are those of earlier rounds in which the agent missed most
            [-].
        keep: Folder in which whole rounds are kept, and from which the imitation goes on; None: nowhere.
        progress: What the progress bar on stderr is called; None: there is none.

    Returns:
        What it came to.

    Raises:
        ValueError: If the operation failed in all seas of a round before anything was learned from, or a file
            of `keep` is damaged.
    """
    course = Course(
        np.random.default_rng([seed, first_sea]),
        torch.Generator().manual_seed(seed),
    )
    if keep is not None and checkpoint.has_state(keep):
        _go_on(course, model, keep)
    begin = time.monotonic() - course.wall
    bar: Any = None
    if progress is not None:
        from tqdm import tqdm

        bar = tqdm(
            total=2 * n_rounds,
            initial=2 * len(course.lessons),
            desc=progress,
            unit="half round",
            dynamic_ncols=True,
        )
    for turn in range(len(course.lessons), n_rounds):
        fresh = range(first_sea + turn * n_rows, first_sea + (turn + 1) * n_rows)
        seeds = [*_worst(course, round(repeat_worst * n_rows)), *fresh][:n_rows]
        teacher = school.teacher(seeds)
        _gather(course, model, scenario, teacher, guide, seeds, privileged, excitation, take_over)
        if bar is not None:
            if turn:
                bar.set_postfix(taken_over=f"{course.taken:.3f}", left=f"{course.left:.3g}", refresh=False)
            bar.update()
        _fit(model, course, n_epochs * (LAST_EPOCHS if turn == n_rounds - 1 else 1))
        course.wall = time.monotonic() - begin
        if keep is not None:
            _keep(course, model, keep)
        if bar is not None:
            bar.update()
    if bar is not None:
        bar.close()
    return course


def _worst(course: Course, n: int) -> list[int]:
    """The seas in which the agent missed most, at most n of them, once it is worth telling."""
    if len(course.lessons) < FIRST_REPEAT:
        return []
    return sorted(course.misses, key=lambda sea: (-course.misses[sea], sea))[:n]


# Driving -----------------------------------------------------------------------------------------


def _gather(
    course: Course,
    model: BaseAlgorithm,
    scenario: Scenario,
    teacher: Teacher,
    guide: Guide | None,
    seeds: Sequence[int],
    privileged: bool,
    excitation: float,
    take_over: float | None,
) -> None:
    """Drives a round, and adds its lesson; the first one is the teacher's own."""
    n_rows = len(seeds)
    batch, env = surroundings(scenario, n_rows, guide, privileged=privileged)
    n_raw = len(scenario.observation_names)
    reach = scenario.winch.command_range
    ends = np.full((n_rows, 1), reach)
    rests = 0.0 if guide is None else guide.rest
    n_steps = min(ROUND_STEPS, scenario.n_steps - 1)
    settling = 0 if isinstance(model, RecurrentPPO) else min(SETTLING, n_steps // 2)
    driven = bool(course.lessons)
    largest_miss = np.inf if take_over is None or not driven else take_over * course.size
    seen_so_far, wanted, counts, taken, missed = [], [], [], [], []
    batch.seed_rows(seeds)
    seen = np.asarray(env.reset())
    memory = np.zeros((n_rows, teacher.n_memory))
    own: Any = None
    running = np.ones(n_rows, dtype=bool)
    for step in range(n_steps):
        look = teacher.look(seen[:, :n_raw], memory)
        target = _action(env, look.command, reach)
        least, most = _action(env, -ends, reach), _action(env, ends, reach)
        rest = rests * (target == 0.0)
        told = np.hstack([target, target <= least + AT_LIMIT, target >= most - AT_LIMIT, rest])
        action = target
        if driven:
            action, own = _mean(model, seen, own)
            miss = _missed(torch.as_tensor(action[:, 0]), torch.as_tensor(told)).numpy()[:, None]
            over = np.abs(miss) > largest_miss
            action = np.where(over, target, action)
            taken.append(over[running].mean())
            missed.append(miss[:, 0])
        seen_so_far.append(np.asarray(seen, dtype=np.float32))
        wanted.append(told.astype(np.float32))
        counts.append(running & (step >= settling))
        noise = excitation * course.rng.standard_normal((n_rows, 1))
        env.step_async(np.clip(action + noise, -1.0, 1.0))
        command = command_given(env, reach)
        following, _, done, _ = env.step_wait()
        seen = np.asarray(following)
        memory = teacher.advance(memory, look, command)
        # A row whose operation failed is in a sea now that the teacher was not made for.
        running &= ~done
        if not running.any():
            break
    env.close()
    lesson = Lesson(np.stack(seen_so_far), np.stack(wanted), np.stack(counts))
    if not lesson.counts.any():
        raise ValueError(
            f"scenario {scenario.name!r}: in all {n_rows} seas of round {len(course.lessons) + 1} of the "
            f"imitation the operation failed within {settling * scenario.control_dt:g} s: choose another "
            "teacher, or give take_over"
        )
    if driven:
        size = float(np.mean(lesson.samples[1][:, 0].astype(float) ** 2))
        square = np.stack(missed) ** 2
        course.left = float(np.mean(square[lesson.counts])) / max(size, 1e-30)
        each = np.sum(square * lesson.counts, axis=0) / np.maximum(lesson.counts.sum(axis=0), 1)
        course.misses |= dict(zip(seeds, map(float, each), strict=True))
        course.taken = float(np.mean(taken[settling:]))
    course.lessons.append(lesson)


def _action(env: Any, command: np.ndarray, reach: float) -> np.ndarray:
    """The action that gives a command [m], or does the same to the drum, (n_rows, 1)."""
    guided = guided_within(env)
    return np.clip(command / reach, -1.0, 1.0) if guided is None else guided.action_for(command)


def _mean(model: BaseAlgorithm, seen: np.ndarray, memory: Any) -> tuple[np.ndarray, Any]:
    """The actor's own action (n_rows, 1), and its next memory."""
    x = torch.as_tensor(seen, dtype=torch.float32)
    with torch.no_grad():
        if isinstance(model, RecurrentPPO):
            means, memory = actor_sequence(model, x[None], memory)
            mean = means[0]
        else:
            mean = actor_mean(model, x)
    return np.clip(mean.numpy().astype(float), -1.0, 1.0), memory


# Fitting -----------------------------------------------------------------------------------------


def _missed(action: torch.Tensor, wanted: torch.Tensor) -> torch.Tensor:
    """How far actions (...) miss what is wanted, (..., 4): an action, whether it is the least, the most that
    has an effect, beyond which more is the same, and how far beside it the drum does the same: it rests."""
    off = action - wanted[..., 0]
    off = off - off.clamp(-wanted[..., 3], wanted[..., 3])
    off = torch.where(wanted[..., 1] > 0.5, off.clamp(min=0.0), off)
    return torch.where(wanted[..., 2] > 0.5, off.clamp(max=0.0), off)


def _fit(model: BaseAlgorithm, course: Course, n_epochs: int) -> None:
    parameters = [weight for weight in model.policy.parameters() if weight.requires_grad]
    optimiser = torch.optim.Adam(parameters, lr=LEARNING_RATE)
    if isinstance(model, RecurrentPPO):
        _fit_episodes(model, course.lessons, n_epochs, course.generator, optimiser)
    else:
        _fit_samples(model, course.lessons, n_epochs, course.generator, optimiser)


def _fit_samples(
    model: BaseAlgorithm,
    lessons: Sequence[Lesson],
    n_epochs: int,
    generator: torch.Generator,
    optimiser: torch.optim.Optimizer,
) -> None:
    """Fits a network without a memory to all samples, in any order."""
    seen, wanted = zip(*(lesson.samples for lesson in lessons), strict=True)
    x, y = torch.as_tensor(np.concatenate(seen)), torch.as_tensor(np.concatenate(wanted))
    size = float(y[:, 0].std()) + 1e-6
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


def _fit_episodes(
    model: RecurrentPPO,
    lessons: Sequence[Lesson],
    n_epochs: int,
    generator: torch.Generator,
    optimiser: torch.optim.Optimizer,
) -> None:
    """Fits a network with a memory to whole episodes, some side by side, a chunk at a time."""
    # A lesson in which every operation failed is shorter; what is missing does not count.
    n_steps = max(len(lesson.seen) for lesson in lessons)

    def whole(part: np.ndarray) -> np.ndarray:
        return np.pad(part, ((0, n_steps - len(part)), *((0, 0),) * (part.ndim - 1)))

    x, y, counts = (
        torch.as_tensor(np.concatenate([whole(part) for part in parts], axis=1))
        for parts in zip(*((lesson.seen, lesson.wanted, lesson.counts) for lesson in lessons), strict=True)
    )
    size = float(y[..., 0][counts].std()) + 1e-6
    n_batches = max(1, x.shape[1] // SEQUENCES)
    starts = range(0, n_steps, CHUNK)
    n_updates = n_epochs * n_batches * sum(bool(counts[start : start + CHUNK].any()) for start in starts)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, n_updates)
    parameters = [weight for group in optimiser.param_groups for weight in group["params"]]
    for _ in range(n_epochs):
        order = torch.randperm(x.shape[1], generator=generator)
        for rows in order.chunk(n_batches):
            memory: Any = None
            for start in starts:
                part = slice(start, start + CHUNK)
                mean, memory = actor_sequence(model, x[part, rows], memory)
                memory = tuple(value.detach() for value in memory)
                count = counts[part, rows]
                missed = _missed(mean[..., 0], y[part, rows])[count]
                if not len(missed):
                    continue
                optimiser.zero_grad()
                loss = torch.mean(missed**2) / size**2
                loss.backward()
                torch.nn.utils.clip_grad_norm_(parameters, LARGEST_GRADIENT)
                optimiser.step()
                schedule.step()


# Whole rounds on disk ----------------------------------------------------------------------------


def _lesson_file(folder: Path, turn: int) -> Path:
    return folder / f"lesson-{turn:02d}.safetensors"


def _keep(course: Course, model: BaseAlgorithm, folder: Path) -> None:
    """Writes the last lesson, and then what the next round begins with."""
    folder.mkdir(parents=True, exist_ok=True)
    turn = len(course.lessons) - 1
    packed = course.lessons[-1].packed()
    write_atomic(_lesson_file(folder, turn), packed)
    hashes = [] if turn == 0 else checkpoint.load_state(folder)[1]["lessons"]
    arrays = {f"policy/{name}": value.numpy() for name, value in model.policy.state_dict().items()}
    arrays["generator"] = course.generator.get_state().numpy()
    content = {
        "lessons": [*hashes, sha256(packed)],
        "rng": course.rng.bit_generator.state,
        "left": None if np.isnan(course.left) else course.left,
        "misses": [[sea, miss] for sea, miss in course.misses.items()],
        "taken": course.taken,
        "wall": course.wall,
    }
    checkpoint.save_state(folder, arrays, content, turn)


def _go_on(course: Course, model: BaseAlgorithm, folder: Path) -> None:
    """Takes up what `_keep` wrote."""
    arrays, content = checkpoint.load_state(folder)
    for turn, stated in enumerate(content["lessons"]):
        path = _lesson_file(folder, turn)
        try:
            packed = path.read_bytes()
            if sha256(packed) != stated:
                raise ValueError("its hash is another")
            course.lessons.append(Lesson(**load_tensors(packed)))
        except (OSError, ValueError, SafetensorError) as error:
            raise ValueError(
                f"lesson {str(path)!r} is missing, cut short or changed ({error}): delete the folder "
                f"{str(folder)!r}, and the imitation begins anew"
            ) from error
    weights = checkpoint.under(arrays, "policy/")
    model.policy.load_state_dict({name: torch.as_tensor(value) for name, value in weights.items()})
    course.generator.set_state(torch.as_tensor(arrays["generator"]))
    course.rng.bit_generator.state = content["rng"]
    course.left = float("nan") if content["left"] is None else float(content["left"])
    course.misses = {int(sea): float(miss) for sea, miss in content["misses"]}
    course.taken = float(content["taken"])
    course.wall = course.wall_before = float(content["wall"])
