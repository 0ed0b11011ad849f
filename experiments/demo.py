"""The main job from end to end: train an agent, compare it with the thesis's controllers, report."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from experiments import runs
from experiments.compare import AGENT_PREFIX, compare
from heave_env.scenarios import load

SCENARIO = "sea_state_5"
ALGORITHM = "ppo"
CONTROLLERS = ("none", "lqr", "delay_lqr", "lqg")
"""Designed controllers that the agent is compared with."""
N_SEEDS = 16
"""Unseen seas of the comparison [-]."""


def demo(
    out: str | Path,
    *,
    n_seeds: int = N_SEEDS,
    total_steps: int | None = None,
    seed: int = 0,
    duration: float | None = None,
    arguments: Sequence[str] | None = None,
    announce: Callable[[str], None] | None = None,
    progress: Callable[[str, str, int, int], None] | None = None,
) -> Path:
    """Trains an agent on a cable scenario, or takes up its training where it stopped, and compares it.

    Args:
        out: Folder: the comparison in it, the agent's run in its subfolder `ppo`.
        n_seeds: Unseen seas of the comparison.
        total_steps: Environment steps of the training; None: the preset's.
        seed: Seed of the training.
        duration: Length of the comparison's episodes [s]; None: the protocol's.
        arguments: Command line of the provenance; None: the process's own.
        announce: Called with a line about what comes next.
        progress: As in `experiments.compare.compare`.

    Returns:
        The comparison's folder.

    Raises:
        ValueError: If anything asked for is impossible.
    """
    from agents.train import train

    out = runs.check_folder(out, runs.COMPARISON)
    if n_seeds < 1:
        raise ValueError(f"seeds must be at least 1, got {n_seeds}")
    scenario = load(SCENARIO)
    say = announce or (lambda line: None)
    say(f"Training a {ALGORITHM.upper()} agent on {SCENARIO} into {out / ALGORITHM}")
    run = train(scenario, algorithm=ALGORITHM, seed=seed, total_steps=total_steps, out=out / ALGORITHM)
    say(f"Comparing it with {', '.join(CONTROLLERS)} in {n_seeds} seas that it has never seen")
    return compare(
        [scenario],
        [*CONTROLLERS, f"{AGENT_PREFIX}{run}"],
        n_seeds=n_seeds,
        out=out,
        duration=duration,
        arguments=None if arguments is None else list(arguments),
        progress=progress,
    )
