"""Learning curves: validation over steps and wall time, the middle and the range of several training seeds.

Everything is read from the run folders' `evaluations.csv`. The line is the interquartile mean over seeds, the
band their whole range. Rivals are horizontal lines: designed controllers on the same validation seas.
"""

from __future__ import annotations

import dataclasses
import glob
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments import figures, runs
from experiments.kept import kept_file, read_kept, write_kept
from experiments.pictures import Picture
from experiments.statistics import interquartile_mean
from heave_env.controller import shown_to
from heave_env.scenarios import Scenario, from_mapping, load, names

Array = np.ndarray

EVALUATIONS_FILE = "evaluations.csv"
QUANTITIES = {
    "cost_mean": ("validation cost J, mean over seas", "-"),
    "cost_median": ("validation cost J, median over seas", "-"),
    "cost_max": ("validation cost J, largest over seas", "-"),
    "payload_heave_std": ("std of payload heave in validation", "m"),
    "command_std": ("std of the command in validation", "m"),
}
"""What can be drawn over a training: words and unit."""
TRAININGS = ("training", "training on the device")
"""Kinds of run that have evaluations."""


@dataclass(frozen=True)
class Training:
    """What one run folder tells of its training."""

    folder: Path
    about: dict[str, Any]
    """The run file."""
    evaluations: dict[str, Array]
    """By column, (n_evaluations,)."""

    @property
    def seas(self) -> tuple[int, float]:
        """Number of validation seas [-] and length of their episodes [s]."""
        preset = self.about["preset"]
        return int(preset["evaluation_seas"]), float(preset["evaluation_duration"])

    @property
    def kind(self) -> str:
        """Algorithm, and what the agent is beside a designed controller."""
        preset = self.about["preset"]
        return (
            f"{self.about['algorithm']} {preset['guide_mode']}"
            if preset.get("guide")
            else self.about["algorithm"]
        )


def read_training(folder: Path) -> Training:
    """A training's run folder.

    Raises:
        ValueError: If it holds no training, or one without evaluations.
    """
    if not (folder / runs.RUN_FILE).is_file():
        raise ValueError(f"{str(folder)!r} holds no training; name a folder that heave train wrote")
    about = runs.read_json(folder / runs.RUN_FILE)
    if not isinstance(about, dict) or about.get("kind") not in TRAININGS:
        raise ValueError(f"{str(folder)!r} holds no training; name a folder that heave train wrote")
    rows = runs.read_table(folder / EVALUATIONS_FILE)
    try:
        read = {
            name: np.array([float(row[name]) for row in rows]) for name in (*QUANTITIES, "step", "wall_s")
        }
        training = Training(folder, about, read)
        _ = training.seas, training.kind
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(
            f"the training in {str(folder)!r} is incomplete ({error}); train it again"
        ) from error
    if not rows:
        raise ValueError(f"the training in {str(folder)!r} has no evaluation yet; wait for the first")
    return training


def trainings_of(given: Sequence[str]) -> dict[str, list[Training]]:
    """Trainings by name, from RUN folders, patterns, and NAME=RUN1+RUN2 or NAME=PATTERN.

    Runs without a name that were trained alike but for the seed are one curve.

    Raises:
        ValueError: If one is no training, a pattern matches none, or two were not validated alike.
    """
    found: dict[str, list[Training]] = {}
    alike: list[tuple[dict[str, Any], list[Training]]] = []
    for text in given:
        name, equals, rest = text.partition("=")
        if not equals or "/" in name:
            name, rest = "", text
        several = [
            read_training(folder)
            for part in rest.split("+")
            if part.strip()
            for folder in _matching(part.strip())
        ]
        if name.strip():
            found.setdefault(name.strip(), []).extend(several)
            continue
        for training in several:
            recipe = {key: training.about.get(key) for key in ("algorithm", "preset", "kind")}
            for known, group in alike:
                if known == recipe:
                    group.append(training)
                    break
            else:
                alike.append((recipe, [training]))
    for _, group in alike:
        kind, number = group[0].kind, 1
        while (name := kind if number == 1 else f"{kind} {number}") in found:
            number += 1
        found[name] = group
    if not found:
        raise ValueError("no run was named; name folders that heave train has written")
    _check_alike([training for group in found.values() for training in group])
    return found


def _matching(path: str) -> list[Path]:
    if not re.search(r"[*?\[]", path) or Path(path).exists():
        return [Path(path)]
    found = [Path(one) for one in sorted(glob.glob(path)) if (Path(one) / EVALUATIONS_FILE).is_file()]
    if not found:
        raise ValueError(f"no training matches {path!r}; name folders that heave train has written")
    return found


def _check_alike(trainings: Sequence[Training]) -> None:
    """Refuses what was not validated in the same seas of the same plant: costs would not compare."""

    def met(training: Training) -> tuple[Any, ...]:
        scenario = dict(training.about["scenario"])
        for key in ("information_set", "history_lags", "name"):
            scenario.pop(key, None)
        return scenario, training.seas

    folders = [training.folder.resolve() for training in trainings]
    for i, training in enumerate(trainings):
        if folders.index(folders[i]) < i:
            raise ValueError(f"run {str(training.folder)!r} is named twice; name it once")
        if met(training) != met(trainings[0]):
            raise ValueError(
                f"{str(training.folder)!r} and {str(trainings[0].folder)!r} were validated in other "
                "scenarios or seas; draw them apart"
            )


@dataclass(frozen=True)
class Curve:
    """Several trainings alike over steps."""

    step: Array
    """Environment steps, (n,)."""
    wall: Array
    """Mean wall time over the seeds [s], (n,)."""
    middle: Array
    """Interquartile mean over the seeds, (n,)."""
    low: Array
    high: Array


def curve(trainings: Sequence[Training], quantity: str) -> Curve:
    """The middle and the range of several trainings at every step at which one was evaluated, up to where the
    first of them ends.

    Between its evaluations a training is taken to go straight.

    Args:
        trainings: Of several seeds.
        quantity: One of `QUANTITIES`.
    """
    last = min(float(item.evaluations["step"][-1]) for item in trainings)
    steps = np.unique(np.concatenate([item.evaluations["step"] for item in trainings]))
    steps = steps[steps <= last]
    own = [item.evaluations for item in trainings]
    values = np.array([np.interp(steps, rows["step"], rows[quantity]) for rows in own])
    wall = np.array([np.interp(steps, rows["step"], rows["wall_s"]) for rows in own])
    middle = np.array([interquartile_mean(values[:, i]) for i in range(len(steps))])
    return Curve(steps, wall.mean(axis=0), middle, values.min(axis=0), values.max(axis=0))


def validated_scenario(training: Training) -> Scenario:
    """The scenario of a training as designed controllers see it: what it names, where it is a named one."""
    scenario, name = from_mapping(training.about["scenario"]), str(training.about.get("scenario_name"))
    if name.partition("@")[0] in names():
        return dataclasses.replace(scenario, information_set=load(name).information_set)
    return scenario


def rivals_of(given: Sequence[str], training: Training, folder: Path) -> dict[str, dict[str, float]]:
    """What controllers reach in the validation seas of a training, each kept in the folder.

    Args:
        given: Names of designs, `agent:RUN` and the like.
        training: Whose scenario and seas.
        folder: Where what was found is kept.

    Raises:
        ValueError: If one does not fit the scenario.
    """
    from agents.train import validation
    from experiments.compare import check_specs, content_hash, entry_of, labels_of
    from experiments.validate import source_hash

    specs = check_specs(given)
    labels, (n_seas, duration) = labels_of(specs), training.seas
    scenario = validated_scenario(training)
    found = {}
    for spec in specs:
        path = kept_file(folder, scenario.name, f"validation of {labels[spec]}")
        identity = {
            "scenario": scenario.fingerprint,
            "spec": spec,
            "content": content_hash(spec),
            "seas": [n_seas, duration],
            "source": source_hash(("heave_env", "baselines", "agents")),
        }
        arrays = read_kept(path, identity)
        if arrays is None:
            entry = entry_of(labels[spec], spec, scenario)
            seen = shown_to(entry.controller, scenario, entry.information_set)
            told = validation(entry.controller, seen, n_seas=n_seas, duration=duration)
            arrays = {name: np.array(value) for name, value in told.items()}
            write_kept(path, identity, arrays)
        found[labels[spec]] = {name: float(value) for name, value in arrays.items()}
    return found


COLUMNS = ("kind", "name", "seed", "step", "wall_s [s]", "value", "low", "high", "n_seeds")
"""Columns of the table beside the picture: `kind` is `curve` (over seeds), `seed` or `rival`."""


def learning_picture(
    trainings: dict[str, list[Training]],
    quantity: str = "cost_mean",
    rivals: dict[str, dict[str, float]] | None = None,
) -> Picture:
    """The picture of several agents' trainings.

    Args:
        trainings: By name, those of several seeds.
        quantity: One of `QUANTITIES`.
        rivals: By name, what a controller reached in the same seas.
    """
    rivals = rivals or {}
    curves = {name: curve(group, quantity) for name, group in trainings.items()}
    rows: list[tuple[Any, ...]] = []
    for name, group in trainings.items():
        drawn = curves[name]
        for i, step in enumerate(drawn.step):
            ends = (drawn.middle[i], drawn.low[i], drawn.high[i])
            rows.append(("curve", name, None, step, drawn.wall[i], *ends, len(group)))
        for item in group:
            own = item.evaluations
            for i, step in enumerate(own["step"]):
                seed = item.about.get("seed")
                rows.append(("seed", name, seed, step, own["wall_s"][i], own[quantity][i], None, None, 1))
    rows += [
        ("rival", name, None, None, None, told[quantity], None, None, None) for name, told in rivals.items()
    ]
    first = next(iter(trainings.values()))[0]
    words, unit = QUANTITIES[quantity]
    scenario = str(first.about["scenario_name"])
    counts = {name: len(group) for name, group in trainings.items()}

    def draw(figure: Any) -> None:
        _draw(
            figure,
            curves,
            counts,
            {name: told[quantity] for name, told in rivals.items()},
            scenario,
            words,
            unit,
        )

    n_seas, duration = first.seas
    seeds = ", ".join(f"{name} {count}" for name, count in counts.items())
    return Picture(
        kind="learning",
        name=f"learning-{scenario}" if quantity == "cost_mean" else f"learning-{scenario}-{quantity}",
        caption=(
            f"{scenario}: {words} over training, in {n_seas} validation seas of {duration:g} s, the second "
            f"half scored. Line: interquartile mean over training seeds ({seeds}); band: their whole range; "
            "wall time: mean over the seeds."
            + (f" Dashed: {', '.join(rivals)} in the same seas." if rivals else "")
        ),
        draw=draw,
        size=(8.6, 3.9),
        columns=COLUMNS,
        rows=rows,
        about={"scenario": scenario, "quantity": quantity},
    )


def _draw(
    figure: Any,
    curves: dict[str, Curve],
    counts: dict[str, int],
    rivals: dict[str, float],
    scenario: str,
    words: str,
    unit: str,
) -> None:
    everybody = [*curves, *(name for name in rivals if name not in curves)]
    colours, dashes = figures.colour_of(everybody), figures.dashes_of(list(curves))
    axes = figure.subplots(1, 2, sharey=True)
    scale, shown = (
        (1.0, "") if unit == "-" else figures.metres(min(float(item.middle[-1]) for item in curves.values()))
    )
    longest = max(float(item.wall[-1]) for item in curves.values())
    most = max(float(item.step[-1]) for item in curves.values())
    per_step, of_steps = (
        (1e-6, "million environment steps") if most >= 5e5 else (1e-3, "thousand environment steps")
    )
    per_second, of_time = (1.0 / 60.0, "min") if longest >= 180.0 else (1.0, "s")
    every: list[float] = [scale * value for value in rivals.values()]
    for axis, which, factor in ((axes[0], "step", per_step), (axes[1], "wall", per_second)):
        for name, item in curves.items():
            x = factor * getattr(item, which)
            axis.fill_between(x, scale * item.low, scale * item.high, color=colours[name], alpha=0.16, lw=0)
            axis.plot(x, scale * item.middle, color=colours[name], ls=dashes[name], lw=1.8, label=name)
            every += [*(scale * item.low), *(scale * item.high)]
        for name, value in rivals.items():
            axis.axhline(scale * value, color=colours[name], lw=1.3, ls=(0, (5, 2)), label=name)
        axis.set_xlim(left=0.0)
        axis.margins(x=0.0)
    low, high = min(every), max(every)
    if low > 0.0 and high > 1.5 * low:
        axes[0].set_yscale("log")
        room = (high / low) ** 0.06
        axes[0].set_ylim(low / room, high * room)
        figures.plain_ticks(axes[0], "y")
    axes[0].set_ylabel(f"{words} [{shown}]" if shown else words)
    axes[0].set_xlabel(of_steps)
    axes[1].set_xlabel(f"wall time [{of_time}]")
    axes[0].set_title(f"{scenario}: learning")
    ends = [
        (
            f"{name} ({counts[name]} seed{'s' if counts[name] > 1 else ''})",
            scale * float(item.middle[-1]),
            colours[name],
        )
        for name, item in curves.items()
    ]
    ends += [(name, scale * value, colours[name]) for name, value in rivals.items()]
    figures.name_ends(axes[1], ends)
