"""One storm in every controller's hands: boom tip, payload, command, drum and tension over time.

The series come from a comparison's folder where it stored that sea; else everybody acts in it again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments import figures, runs
from experiments.league import Contestant
from experiments.pictures import Picture, Progress, Scored, entries_of, play, score
from experiments.results import STORED_CHANNELS
from experiments.rollout import STATE_CHANNELS, STEP_CHANNELS
from heave_env.sensors import CHANNELS

Array = np.ndarray

ROUGHEST = "roughest"
"""Stands for the sea in which the boom tip moves most."""
LENGTH = 60.0
"""Length of what is drawn unless asked otherwise [s]."""
UNITS = CHANNELS | STATE_CHANNELS | STEP_CHANNELS
"""Units of the channels."""

Series = dict[str, dict[str, Array]]
"""By controller and channel, the series of one sea [SI]."""


def roughest(scored: Scored) -> int:
    """Seed of the sea in which the boom tip's standard deviation is largest.

    It is told by how much of it anybody removed: 1 - std of payload / std of boom tip.

    Raises:
        ValueError: If nobody was scored in any sea.
    """
    for values in scored.values.values():
        if {"payload_heave_std", "efficiency_boom_tip"} <= set(values):
            left = 1.0 - values["efficiency_boom_tip"][0]
            std = np.divide(
                values["payload_heave_std"][0], left, out=np.full(len(left), np.nan), where=left > 0.0
            )
            if np.isfinite(std).any():
                return scored.first_seed + int(np.nanargmax(std))
    raise ValueError("no sea was scored there; name its seed with --seed")


def stored_series(folder: Path, scored: Scored, labels: Sequence[str], seed: int) -> Series | None:
    """The series that a comparison's folder stored of a sea; None if it did not.

    Args:
        folder: The comparison's.
        scored: The scenario.
        labels: The controllers.
        seed: Seed of the sea.
    """
    if not (folder / runs.TRAJECTORIES_FILE).is_file():
        return None
    arrays, name = runs.read_arrays(folder / runs.TRAJECTORIES_FILE), scored.scenario.name
    seeds = arrays.get(f"{name}/seed", np.empty(0)).tolist()
    if seed not in seeds:
        return None
    place = seeds.index(seed)
    found: Series = {}
    for label in labels:
        own = {
            channel: arrays[f"{name}/{label}/{channel}"][:, place].astype(float)
            for channel in STORED_CHANNELS
            if f"{name}/{label}/{channel}" in arrays
        }
        if "payload_heave" not in own:
            return None
        if "winch_rate" not in own:  # of a folder from before it was stored: the mean over each step
            moved = np.diff(own["winch_displacement"], prepend=own["winch_displacement"][:1])
            own["winch_rate"] = moved / scored.scenario.control_dt
        found[label] = own
    return found


def played_series(
    scored: Scored, teams: Sequence[Contestant], seed: int, folder: Path, progress: Progress | None = None
) -> Series:
    """The series of a sea in which everybody acts anew, an agent by the first of its trainings.

    Args:
        scored: The scenario.
        teams: The controllers.
        seed: Seed of the sea.
        folder: Where each one's part is kept.
        progress: Called with scenario, label, steps done since the last call and steps in all.
    """
    firsts = [Contestant(team.name, team.specs[:1]) for team in teams]
    by_team = entries_of(scored.basis, firsts)
    entries = [entries[0] for entries in by_team.values()]
    contest = play(
        scored.scenario, entries, range(seed, seed + 1), folder, n_stored=1, warm_up=0.0, progress=progress
    )
    by_label = {outcome.entry.label: outcome.sample for outcome in contest.outcomes}
    found: Series = {}
    for name, (entry, *_) in by_team.items():
        sample = by_label[entry.label]
        channels = sample.states | sample.steps
        found[name] = {
            channel: channels[channel][:, 0].astype(np.float32).astype(float)
            for channel in STORED_CHANNELS
            if channel in channels
        }
    return found


def window_of(
    series: Series, dt: float, warm_up: float, start: float | None, length: float
) -> tuple[float, float]:
    """What is drawn: from `start`, or about the boom tip's largest heave after the warm-up [s].

    Raises:
        ValueError: If the start lies beyond the end of the episode.
    """
    heave = next(iter(series.values()))["boom_tip_heave"]
    end = dt * (len(heave) - 1)
    if start is None:
        first = round(warm_up / dt)
        at = dt * (first + int(np.argmax(np.abs(heave[first:]))))
        start = float(np.floor(max(0.0, min(at - 0.5 * length, end - length))))
    if start >= end:
        raise ValueError(f"--start must lie before the end of the episode at {end:g} s, got {start:g} s")
    return start, min(start + length, end)


def storm_picture(
    scored: Scored, series: Series, seed: int, *, start: float | None = None, length: float = LENGTH
) -> Picture:
    """The picture of one sea.

    Args:
        scored: The scenario.
        series: What everybody did in it.
        seed: Seed of the sea.
        start: Where the drawn part begins [s]; None: about the largest heave of the boom tip.
        length: How long it is [s].

    Raises:
        ValueError: If the start lies beyond the end of the episode.
    """
    scenario = scored.scenario
    dt = scenario.control_dt
    begin, end = window_of(series, dt, scored.warm_up, start, length)
    time = np.round(dt * np.arange(len(next(iter(series.values()))["payload_heave"])), 9)
    shown = np.flatnonzero((time >= begin - 1e-9) & (time <= end + 1e-9))
    used = [channel for channel in STORED_CHANNELS if any(channel in own for own in series.values())]
    rows = []
    for label, own in series.items():
        for i in shown:
            numbers = [own[name][i] if name in own and i < len(own[name]) else None for name in used]
            rows.append((label, time[i], *numbers))
    limit = scenario.winch.speed_limit
    several = [name for name, specs in scored.specs.items() if name in series and len(specs) > 1]
    firsts = f" Of {', '.join(several)} the first training acts." if several else ""

    def draw(figure: Any) -> None:
        figures.draw_series(
            figure,
            time,
            series,
            start=begin,
            end=end,
            delay=scenario.winch.command_delay,
            names=scored.names,
            rate_limit=math.inf if limit is None else float(limit),
        )

    return Picture(
        kind="storm",
        name=f"storm-{scenario.name}-{seed}",
        caption=(
            f"{scenario.name}, sea {seed}, {begin:g} s to {end:g} s: what each controller made of it.{firsts}"
        ),
        draw=draw,
        size=figures.series_size(figures.series_panels(series)),
        columns=("controller", "time [s]", *(f"{channel} [{UNITS[channel]}]" for channel in used)),
        rows=rows,
        about={"scenario": scenario.name, "seed": seed, "start": begin, "end": end},
    )


def series_of(
    scored: Scored,
    wanted: Sequence[str] | None,
    seed: int,
    *,
    source: Path | None,
    folder: Path,
    progress: Progress | None = None,
) -> Series:
    """What everybody did in a sea, from the folder of a comparison or run anew.

    Args:
        scored: The scenario.
        wanted: The controllers, all if None.
        seed: Seed of the sea.
        source: The comparison's folder, if there is one.
        folder: Where what is run is kept.
        progress: Called with scenario, label, steps done since the last call and steps in all.

    Raises:
        ValueError: If one that is wanted is not there.
    """
    labels = list(scored.specs) if wanted is None else list(wanted)
    for label in labels:
        if label not in scored.specs:
            raise ValueError(f"{label!r} did not act there; choose from {', '.join(scored.specs)}")
    found = None if source is None else stored_series(source, scored, labels, seed)
    if found is not None:
        return found
    teams = [Contestant(label, scored.specs[label]) for label in labels]
    return played_series(scored, teams, seed, folder, progress)


def roughest_of(scored: Scored, n_seas: int, folder: Path, progress: Progress | None = None) -> int:
    """Seed of the roughest of the first seas, in which the locked winch is run for it."""
    seeds = range(scored.first_seed, scored.first_seed + n_seas)
    locked = score(scored.scenario, [Contestant("none", ("none",))], seeds, folder, progress=progress)
    return roughest(locked)
