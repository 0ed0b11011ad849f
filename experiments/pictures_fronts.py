"""What is left of the motion against what it takes: the fronts of classical designs over their weights.

A design is swept along rays through its tuned weights: the command weight alone, the weight of the winch's
speed alone, the price of its work alone. The front is drawn through those of its choices than which none is
better in both respects. Everybody acts in the same seas, the fronts too, so that a point below a front did
what no weights of that design do there.
"""

from __future__ import annotations

import inspect
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import baselines
from baselines.tuning import needs_tuning, tuned_weights
from experiments import figures
from experiments.kept import kept_file, read_kept, write_kept
from experiments.leaderboard import Quantity, estimated
from experiments.metrics import METRICS
from experiments.pictures import Picture, Progress, Scored, play
from experiments.results import Entry
from experiments.statistics import mean
from heave_env.scenarios import Scenario

Array = np.ndarray

MEASURES = {
    "control_energy": ("control energy, mean u0²", 1.0, "m²"),
    "winch_work": ("work of the winch", 1e-6, "MJ"),
    "energy_cost": ("priced work of the winch, mean e |T v| / T_s", 1.0, "-"),
}
"""What motion is held against: words, factor to the shown unit, and that unit."""
STD = "payload_heave_std"
WEIGHTS = ("command_weight", "speed_weight", "energy_weight")
"""Weights of a design that are swept, each along a ray."""
COMMAND_FACTORS = (1e-2, 1e6)
"""Ends of the ray of the command weight, over the task's own [-]."""
SPEED_FACTORS = (1e-2, 1e4)
"""Ends of the ray of the speed weight, over the position weight [s²]."""
ENERGY_FACTORS = (1e-1, 1e2)
"""Ends of the ray of the price of work, over the tuned one [-]."""
N_WEIGHTS = 9
"""Weights along a ray unless asked otherwise, before it is refined [-]."""
N_REFINEMENTS = 2
"""How often weights are put between those whose motions differ by more than `STEP` [-]."""
STEP = 1.3
"""Ratio of the motions of neighbours on a ray above which another weight is put between them [-]."""


@dataclass(frozen=True)
class Choice:
    """One choice of a design's weights, and what came of it."""

    design: str
    weights: dict[str, float]
    tuned: bool
    """Whether these are the weights that the design has in every comparison."""
    numbers: dict[str, Quantity]
    """Mean and interval of each metric that is drawn."""
    failed: int
    """Seas in which it diverged or lost the payload [-]."""


def default_designs(scenario: Scenario) -> tuple[str, ...]:
    """Designs whose fronts say most: `lqg`, with limits `mpc` too, with a price of the work `mpc_l1` too.

    Without limits `mpc` is `lqg`.
    """
    names = ["lqg"]
    names += ["mpc"] if scenario.winch.is_limited else []
    return (*names, *(["mpc_l1"] if scenario.task.energy_weight > 0.0 else []))


def swept_weights(design: str) -> tuple[str, ...]:
    """Weights of a design that can be swept.

    Raises:
        ValueError: If there is no such design, or it has none.
    """
    sweepable = [name for name in baselines.DESIGNERS if _arguments(name)]
    if design not in sweepable:
        raise ValueError(f"{design!r} has no weights to sweep; choose from {', '.join(sweepable)}")
    return _arguments(design)


def _arguments(design: str) -> tuple[str, ...]:
    known = inspect.signature(baselines.DESIGNERS[design]).parameters
    return tuple(name for name in WEIGHTS if name in known)


def choices(design: str, scenario: Scenario, own: dict[str, float], n_weights: int) -> list[dict[str, float]]:
    """Weights along the rays of a design, its own first.

    Args:
        design: Name of the design.
        scenario: The operation that it is for.
        own: Its weights in every comparison.
        n_weights: Weights along a ray [-].
    """
    q, r = scenario.task.position_weight, scenario.task.command_weight
    grids = {
        "command_weight": r * np.geomspace(*COMMAND_FACTORS, n_weights),
        "speed_weight": q * np.geomspace(*SPEED_FACTORS, n_weights),
        "energy_weight": own.get("energy_weight", 1.0) * np.geomspace(*ENERGY_FACTORS, n_weights),
    }
    rays = [own | {name: float(f"{value:.6g}")} for name in swept_weights(design) for value in grids[name]]
    return distinct([dict(own), *rays])


def label_of(weights: Mapping[str, float]) -> str:
    """Weights as text."""
    return ",".join(f"{name}={value:.6g}" for name, value in weights.items())


def distinct(asked: Iterable[dict[str, float]]) -> list[dict[str, float]]:
    """The first of those choices that have the same label."""
    found: dict[str, dict[str, float]] = {}
    for weights in asked:
        found.setdefault(label_of(weights), weights)
    return list(found.values())


def own_weights(design: str, basis: Scenario, folder: Path) -> dict[str, float]:
    """The weights that a design has in every comparison, tuned where it is; kept in the folder.

    Args:
        design: Name of the design.
        basis: The operation that it is for.
        folder: Where what was tuned is kept.
    """
    from experiments.validate import source_hash

    own = {"command_weight": basis.task.command_weight}
    if "speed_weight" in swept_weights(design):
        own["speed_weight"] = 0.0
    if "energy_weight" in swept_weights(design):
        from baselines.mpc import assumed_energy_weight

        own["energy_weight"] = basis.task.energy_weight or assumed_energy_weight(basis)
    if design not in baselines.TUNED or not needs_tuning(basis):
        return own
    path = kept_file(folder, basis.name, f"weights of {design}")
    identity = {
        "scenario": basis.fingerprint,
        "duration": basis.duration,
        "source": source_hash(("heave_env", "baselines")),
    }
    arrays = read_kept(path, identity)
    if arrays is None:
        found = tuned_weights(design, baselines.DESIGNERS[design], basis, {})
        arrays = {name: np.array(value) for name, value in found.items()}
        write_kept(path, identity, arrays)
    return own | {name: float(value) for name, value in arrays.items()}


def sweep(
    design: str,
    scenario: Scenario,
    basis: Scenario,
    seeds: range,
    folder: Path,
    *,
    n_weights: int = N_WEIGHTS,
    warm_up: float | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> list[Choice]:
    """Lets a design act under each choice of its weights; what is done is kept in the folder.

    Args:
        design: Name of the design.
        scenario: The operation as it is met, with the duration that is wanted.
        basis: The operation that the design is for.
        seeds: Seeds of the seas.
        folder: Where each choice's part is kept.
        n_weights: Weights along a ray [-].
        warm_up: Time left out at the start [s]; None: the protocol's.
        workers: Processes that run side by side.
        progress: Called with scenario, label, steps done since the last call and steps in all.

    Raises:
        ValueError: If the design does not fit the scenario.
    """
    own = own_weights(design, basis, folder)
    asked = choices(design, basis, own, n_weights)
    found: list[Choice] = []
    for _ in range(1 + N_REFINEMENTS):
        found = _played(design, scenario, basis, asked, own, seeds, folder, warm_up, workers, progress)
        between = refined(found)
        if not between:
            break
        asked = distinct([*asked, *between])
    return found


def refined(found: Sequence[Choice]) -> list[dict[str, float]]:
    """Weights halfway between neighbours on a ray whose motions differ by more than `STEP`."""
    own, between = found[0].weights, []
    for name in own:
        others = {key: value for key, value in own.items() if key != name}
        ray = [item for item in found if others.items() <= item.weights.items() and item.weights[name] > 0.0]
        ray = [item for item in ray if not item.failed and STD in item.numbers]
        ray.sort(key=lambda item: item.weights[name])
        for one, two in itertools.pairwise(ray):
            ratio = one.numbers[STD].value / two.numbers[STD].value
            if max(ratio, 1.0 / ratio) > STEP:
                middle = math.sqrt(one.weights[name] * two.weights[name])
                between.append(own | {name: float(f"{middle:.6g}")})
    return between


def _played(
    design: str,
    scenario: Scenario,
    basis: Scenario,
    asked: Sequence[dict[str, float]],
    own: dict[str, float],
    seeds: range,
    folder: Path,
    warm_up: float | None,
    workers: int,
    progress: Progress | None,
) -> list[Choice]:
    entries = []
    for weights in asked:
        told = label_of(weights)
        made = baselines.design(design, basis, **weights)
        sees = getattr(made, "information_set", None) or scenario.information_set
        entries.append(Entry(f"{design} {told}", f"{design},{told}", made, sees))
    contest = play(scenario, entries, seeds, folder, warm_up=warm_up, workers=workers, progress=progress)
    found = []
    for weights, outcome in zip(asked, contest.outcomes, strict=True):
        numbers = {}
        for metric in (STD, *MEASURES):
            if metric in outcome.values:
                number = estimated(mean, [[outcome.values[metric][None]]], METRICS[metric].unit)
                if number is not None:
                    numbers[metric] = number
        failed = int(outcome.ends["diverged"].sum() + outcome.ends["lost"].sum())
        found.append(Choice(design, weights, weights == own, numbers, failed))
    return found


def front(found: Sequence[Choice], measure: str) -> list[Choice]:
    """Those choices than which no other has both less motion and a smaller measure, by that measure.

    A choice under which a sea failed is not among them.
    """
    sound = [item for item in found if not item.failed and STD in item.numbers and measure in item.numbers]
    kept: list[Choice] = []
    for item in sorted(sound, key=lambda one: (one.numbers[measure].value, one.numbers[STD].value)):
        if not kept or item.numbers[STD].value < kept[-1].numbers[STD].value:
            kept.append(item)
    return kept


COLUMNS = (
    "kind",
    "who",
    *WEIGHTS,
    "tuned",
    "n_trainings",
    "n_seas",
    "failed",
    *(
        f"{metric}{end} [{METRICS[metric].unit}]"
        for metric in (STD, *MEASURES)
        for end in ("", "_low", "_high")
    ),
    *(f"on front of {measure}" for measure in MEASURES),
)
"""Columns of the table beside the picture: `kind` is `swept` (weights of a design), `entry`, or `training`
(one of an entry that has several)."""


def fronts_picture(scored: Scored, swept: dict[str, list[Choice]]) -> Picture:
    """The picture of a scenario.

    Args:
        scored: Everybody's scores, who become points.
        swept: By design, its choices, whose front is drawn.
    """
    entries = {
        entry: {metric: scored.number(entry, metric) for metric in (STD, *MEASURES)}
        for entry in scored.values
    }
    single = {entry: _every_training(scored, entry) for entry in entries}
    names = [*scored.names, *(design for design in swept if design not in scored.names)]
    measures = [
        measure for measure in MEASURES if any(numbers[measure] is not None for numbers in entries.values())
    ]
    rows: list[tuple[Any, ...]] = []
    for design, found in swept.items():
        on = {measure: front(found, measure) for measure in MEASURES}
        for item in found:
            weights = [item.weights.get(name) for name in WEIGHTS]
            seas = (1, scored.n_seas, item.failed)
            marks = [item in on[measure] if measure in measures else None for measure in MEASURES]
            rows.append(("swept", design, *weights, item.tuned, *seas, *_numbers(item.numbers), *marks))
    for entry, numbers in entries.items():
        seas = (len(scored.values[entry]["cost"]), scored.n_seas, scored.failed(entry))
        rows.append(("entry", entry, *(None for _ in WEIGHTS), None, *seas, *_numbers(numbers), *(None,) * 3))
        for alone in single[entry]:
            whole = (*(None for _ in WEIGHTS), None, 1, scored.n_seas, None)
            rows.append(("training", entry, *whole, *_numbers(alone), *(None,) * 3))
    title = f"{scored.scenario.name}: motion left against what it takes"
    failed = {entry: scored.failed(entry) for entry in entries}

    def draw(figure: Any) -> None:
        draw_fronts(figure, title, entries, failed, swept, measures, names, single)

    several = "; small circles, or arrows at the frame: single trainings" if any(single.values()) else ""
    designs = " and ".join(swept)
    return Picture(
        kind="fronts",
        name=f"fronts-{scored.scenario.name}",
        caption=(
            f"{scored.scenario.name}: standard deviation of payload heave against "
            f"{' and '.join(MEASURES[measure][0] for measure in measures)}. Lines: {designs} over their "
            f"weights (small dots: every choice tried; ring: the tuned one){several}. Bars and bands: 95 % "
            f"intervals of the mean over {scored.n_seas} seas and trainings; all share the seas "
            f"{scored.first_seed} to {scored.first_seed + scored.n_seas - 1}, so that differences are surer "
            "than the bars say."
        ),
        draw=draw,
        size=size_of(measures),
        columns=COLUMNS,
        rows=rows,
        about={"scenario": scored.scenario.name, "first_seed": scored.first_seed, "n_seeds": scored.n_seas},
    )


def _every_training(scored: Scored, entry: str) -> list[dict[str, Quantity]]:
    """Each training's means by metric, of an entry that has several."""
    values = scored.values[entry]
    if len(values["cost"]) < 2:
        return []
    found: list[dict[str, Quantity]] = [{} for _ in values["cost"]]
    for metric in (STD, *MEASURES):
        for row, numbers in zip(values.get(metric, ()), found, strict=False):
            number = estimated(mean, [[row[None]]], METRICS[metric].unit)
            if number is not None:
                numbers[metric] = number
    return found


def _numbers(numbers: dict[str, Any]) -> list[float | None]:
    found: list[float | None] = []
    for metric in (STD, *MEASURES):
        number = numbers.get(metric)
        found += [None] * 3 if number is None else [number.value, number.low, number.high]
    return found


def league_picture(
    title: str, entries: dict[str, dict[str, Any]], names: Sequence[str]
) -> tuple[str, str] | None:
    """What the page of a league shows of a scenario: everybody as a point, and no front.

    Args:
        title: Name of the scenario.
        entries: By contestant, its quantities as the leaderboard's file has them.
        names: Everybody, in the order that gives them colours.

    Returns:
        The SVG's text and what it shows, or None where there are no points.
    """
    metrics = (STD, *MEASURES)
    numbers = {
        name: {metric: Quantity(**found[metric]) if metric in found else None for metric in metrics}
        for name, found in entries.items()
    }
    failed = {
        name: int(sum(found[end]["value"] for end in ("diverged", "lost") if end in found))
        for name, found in entries.items()
    }
    measures = [
        measure for measure in MEASURES if sum(found[measure] is not None for found in numbers.values()) > 1
    ]
    if not measures or not any(found[STD] is not None for found in numbers.values()):
        return None
    shown = f"{title}: motion left against what it takes"
    svg = figures.svg(
        lambda figure: draw_fronts(figure, shown, numbers, failed, {}, measures, names), size_of(measures)
    )
    words = " and ".join(MEASURES[measure][0] for measure in measures)
    return svg, (
        f"{title}: standard deviation of payload heave against {words}, with 95 % intervals. All share the "
        "seas, so that differences are surer than the bars say."
    )


def size_of(measures: Sequence[str]) -> tuple[float, float]:
    """Size of a picture with a panel for each measure [in]."""
    return 4.9 * len(measures) + (1.2 if len(measures) == 1 else 0.0), 4.5


def draw_fronts(
    figure: Any,
    title: str,
    entries: dict[str, dict[str, Any]],
    failures: dict[str, int],
    swept: dict[str, list[Choice]],
    measures: Sequence[str],
    names: Sequence[str],
    single: dict[str, list[dict[str, Quantity]]] | None = None,
) -> None:
    """Draws everybody as a point with its intervals, and the fronts of designs.

    Args:
        figure: What to draw on.
        title: What stands above.
        entries: By contestant and metric its number, None where there is none.
        failures: By contestant the seas that failed.
        swept: By design, its choices.
        measures: What motion is held against, a panel for each.
        names: Everybody, in the order that gives them colours.
        single: By contestant the numbers of each of its trainings, if it has several.
    """
    entries = {entry: _at_rest(numbers) for entry, numbers in entries.items()}
    axes = figure.subplots(1, len(measures), squeeze=False, sharey=True)[0]
    stds = [numbers[STD].value for numbers in entries.values() if numbers[STD] is not None]
    for found in swept.values():
        stds += [item.numbers[STD].value for item in front(found, measures[0])]
    scale, unit = figures.metres(float(np.exp(np.mean(np.log(stds)))) if stds else 1.0)
    panels = [_Panel(axis, measure, scale, names) for axis, measure in zip(axes, measures, strict=True)]
    for panel in panels:
        for design, found in swept.items():
            panel.draw_front(design, found)
        for entry, numbers in entries.items():
            failed = failures[entry]
            panel.draw_entry(entry, f"{entry} ({failed} failed)" if failed else entry, numbers)
            panel.draw_trainings(entry, (single or {}).get(entry, []))
        words, factor, shown = MEASURES[panel.measure]
        _scale(
            panel.axis, "x", *(factor * end for end in _ends(entries, swept, panel.measure, panel.measure))
        )
        panel.axis.set_xlabel(f"{words} [{shown}]" if shown != "-" else words)
    _scale(axes[0], "y", *(scale * end for end in _ends(entries, swept, measures[0], STD)))
    axes[0].set_ylabel(f"std of payload heave [{unit}]")
    axes[0].set_title(title)
    for panel in panels:
        panel.write_names()


class _Panel:
    """Motion against one measure."""

    def __init__(self, axis: Any, measure: str, scale: float, names: Sequence[str]) -> None:
        self.axis, self.measure, self.scale = axis, measure, scale
        self.factor = MEASURES[measure][1]
        self.colours, self.dashes = figures.colour_of(names), figures.dashes_of(names)
        self.points: list[tuple[str, float, float, str]] = []
        self.still: list[tuple[str, float, str]] = []
        self.curves: list[Array] = []
        self.beyond: list[tuple[float, float, str]] = []

    def place(self, numbers: dict[str, Any]) -> tuple[float, float]:
        """Where the numbers stand."""
        return self.factor * numbers[self.measure].value, self.scale * numbers[STD].value

    def draw_front(self, design: str, found: Sequence[Choice]) -> None:
        """A design's choices, its front, and its own weights."""
        colour, on = self.colours[design], front(found, self.measure)
        seen = [item for item in found if not item.failed and {STD, self.measure} <= set(item.numbers)]
        spots = np.array([self.place(item.numbers) for item in seen]).reshape(-1, 2)
        self.axis.plot(*spots.T, ls="", marker=".", ms=4, color=colour, alpha=0.45, label=f"{design} swept")
        if not on:
            return
        x, y = np.array([self.place(item.numbers) for item in on]).T
        low, high = ([self.scale * _end(item.numbers[STD], end) for item in on] for end in ("low", "high"))
        self.axis.fill_between(x, low, high, color=colour, alpha=0.13, lw=0)
        self.axis.plot(x, y, color=colour, ls=self.dashes[design], lw=1.8, label=f"{design} front")
        self.curves.append(np.column_stack([x, y]))
        middle = len(on) // 2
        self.points.append((f"{design}, all weights", float(x[middle]), float(y[middle]), colour))
        for item in seen:
            if item.tuned:
                self.axis.plot(*self.place(item.numbers), marker="o", ms=9, mfc="none", mec=colour, mew=1.4)

    def draw_entry(self, entry: str, name: str, numbers: dict[str, Any]) -> None:
        """A contestant with its intervals; one that takes nothing is a line across."""
        across, up, colour = numbers[self.measure], numbers[STD], self.colours[entry]
        if across is None or up is None:
            return
        x, y = self.place(numbers)
        if across.value <= 0.0:
            self.still.append((name, y, colour))
            self.axis.axhline(y, color=colour, lw=1.4, ls=(0, (4, 2)), label=entry)
            return
        wide, tall = _bar(across, self.factor), _bar(up, self.scale)
        style = {"elinewidth": 1.0, "mec": "#ffffff", "mew": 0.8, "color": colour, "zorder": 4}
        self.axis.errorbar(x, y, xerr=wide, yerr=tall, fmt="o", ms=6.5, label=entry, **style)
        self.points.append((name, x, y, colour))
        self.curves.append(np.array([[x - wide[0][0], y], [x + wide[1][0], y]]))
        self.curves.append(np.array([[x, y - tall[0][0]], [x, y + tall[1][0]]]))

    def draw_trainings(self, entry: str, single: Sequence[dict[str, Quantity]]) -> None:
        """Each training of a contestant as a small circle."""
        spots = [self.place(numbers) for numbers in single if {STD, self.measure} <= set(numbers)]
        if spots:
            style = {"ls": "", "marker": "o", "ms": 3.5, "mfc": "#ffffff", "mec": self.colours[entry]}
            self.axis.plot(*np.array(spots).T, mew=1.0, zorder=3, label=f"{entry} trainings", **style)
            self.curves += [np.array([spot]) for spot in spots]
            self.beyond += [(*spot, self.colours[entry]) for spot in spots]

    def write_names(self) -> None:
        """The names, once the scales stand, and at the frame the trainings that lie to the left of it."""
        left, right = self.axis.get_xlim()
        for x, y, colour in self.beyond:
            if x < left:
                self.axis.plot(left, y, marker="<", ms=6, color=colour, clip_on=False, zorder=5)
        left += 1e-3 * abs(left)
        named = [(name, left, height, colour) for name, height, colour in self.still]
        lines = [np.array([[left, height], [right, height]]) for _, height, _ in self.still]
        figures.name_points(self.axis, [*self.points, *named], [*self.curves, *lines])


def _end(number: Quantity, end: str) -> float:
    value = getattr(number, end) if end else number.value
    return number.value if value is None else float(value)


def _bar(number: Quantity, factor: float) -> list[list[float]]:
    """Lengths of an error bar down and up."""
    return [
        [factor * (number.value - _end(number, "low"))],
        [factor * (_end(number, "high") - number.value)],
    ]


def _at_rest(numbers: dict[str, Any]) -> dict[str, Any]:
    """The numbers of an entry; of one that commands nothing, without the work that its start left it."""
    energy = numbers["control_energy"]
    if energy is None or energy.value > 0.0:
        return numbers
    nothing = {measure: energy for measure in MEASURES if numbers[measure] is not None}
    return numbers | nothing


def _ends(
    entries: dict[str, dict[str, Any]], swept: dict[str, list[Choice]], measure: str, metric: str
) -> tuple[float, float]:
    """What an axis has to show: every entry, and the fronts from where they begin to fall."""
    found: list[float] = []
    for numbers in entries.values():
        if numbers[measure] is not None and numbers[metric] is not None:
            # An interval that reaches to nothing is cut at the frame.
            number = numbers[metric]
            found += [number.value, max(_end(number, "low"), 0.25 * number.value)]
            found.append(min(_end(number, "high"), 4.0 * number.value))
    for tried in swept.values():
        on = front(tried, measure)
        falling = [item for item in on if item.numbers[STD].value < 0.95 * on[0].numbers[STD].value]
        found += [item.numbers[metric].value for item in falling]
    return min((value for value in found if value > 0.0), default=0.0), max(found, default=1.0)


def _scale(axis: Any, which: str, low: float, high: float) -> None:
    """Logarithmic where the values span more than a few times, with room for names."""
    if low > 0.0 and high > 4.0 * low:
        getattr(axis, f"set_{which}scale")("log")
        room = (high / low) ** 0.08
        getattr(axis, f"set_{which}lim")(low / room, high * room**1.6)
        figures.plain_ticks(axis, which)
    else:
        getattr(axis, f"set_{which}lim")(0.0, 1.12 * high)
