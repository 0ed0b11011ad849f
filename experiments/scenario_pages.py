"""A page for each named scenario: what it is for, its numbers and their sources, controllers, a picture.

`heave scenarios page` writes them from the scenarios themselves, the notes below and runs in the first test
seas; the same command writes the same pages again.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from experiments import figures, runs
from experiments.compare import controller_of, run_contest
from experiments.metrics import scores, window
from experiments.report import significant
from experiments.results import Contest, Entry, Outcome
from experiments.rollout import FIRST_TEST_SEED, Trajectory, rollout, with_duration
from heave_env import document
from heave_env.cable.closed_form import natural_omegas, resonant_length
from heave_env.parameters import Draw
from heave_env.scenarios import Scenario, load, names, variants_of
from heave_env.spectra import elevation_spectrum
from heave_env.variants import VARIANTS, NoSuchVariantError
from heave_env.vessel import boom_tip_spectrum

Array = np.ndarray

CONTROLLERS = ("none", "feedforward_prediction", "lqg")
"""Controllers of every page; further ones stand where they differ from these (`controllers_of`)."""
ON_VARIANTS = "lqg"
"""Design that is shown in the picture and tried on the variants."""
LONGEST = 400.0
"""Seconds of an episode on a page [s]; the protocol's."""
SHOWN = 60.0
"""Seconds in a picture [s]."""


@dataclass(frozen=True)
class Note:
    """What a page says beside what the scenario says itself."""

    tier: str
    """Where it stands among the others."""
    purpose: str
    """What it is for."""
    sources: tuple[str, ...]
    """Where its numbers are from, and what is assumed."""


THESIS_SEA = (
    "sea: sea state 5, 10 ft and 0.785 rad/s (H 6.3.6), through the shaping filter (H 6.22) as printed",
    "vessel: 0.393 rad/s, damping 0.6, gain 0.5 (H 6.3.6)",
)
THESIS_PAYLOAD = "payload: a 0.8959 s², b 0.1658 s (H 6.3.6)"
THESIS_CABLE = (
    "cable: 900 m, diameter 47 mm, E 9.09e9 N/m², 7.2 kg/m, 54 N/m in water, C_t 0.025 (H 6.2.6)",
    "payload: 125 t, in which added mass is counted, 50 kN in water, C_d S 1 m² (H 6.2.6)",
)
THESIS_BOOM_TIP = (
    "boom tip: Pierson and Moskowitz's spectrum, 6 m, zero-crossing period 14 s, as sinusoids (H figure 6.10)"
)
SLACK = "damping of 5 ms and the slack law are ours: the thesis lets the cable carry compression"
WEAK_WINCH = "limits of 0.265 m/s and 0.25 m/s², delay and noise are ours, so that the limits bite"
UNKNOWN_RANGES = "ranges are ours: a quarter to a half either way, of the delay and the lag more"

NOTES: dict[str, Note] = {
    "thesis_linear": Note(
        "linear",
        "The gate: plant, sea and noise are those of the theory, and the optimum is known. Nobody "
        "can be below it; "
        "an agent that learns what can be learnt comes to it.",
        (*THESIS_SEA, THESIS_PAYLOAD, "noise of density 1e-6 and q = 554 (H 6.3.6); lag 1 s (H 6.3.6)"),
    ),
    "delay_linear": Note(
        "linear",
        "The gate with a delay and the sensors of the other contests: the optimum is known, and an agent "
        "that sees the sensors alone must find the state behind them.",
        (*THESIS_SEA, THESIS_PAYLOAD, "delay, noise and weights are ours"),
    ),
    "limits_linear": Note(
        "limits",
        "The contest where a winch is too weak: certainty equivalence fails, and planning or learning pays.",
        ("sea: the thesis's at 6 m", *THESIS_SEA[1:], THESIS_PAYLOAD, WEAK_WINCH),
    ),
    "energy_linear": Note(
        "energy",
        "The contest where the winch's work has a price: how much of the motion is worth removing.",
        (*THESIS_SEA, THESIS_PAYLOAD, "delay, noise, weights and price are ours"),
    ),
    "unknown_linear": Note(
        "unknown",
        "The contest of adaptation: who finds out what plant it has beats who was told the mean.",
        (*THESIS_SEA, THESIS_PAYLOAD, UNKNOWN_RANGES, "delay and noise are ours"),
    ),
    "limits_unknown_linear": Note(
        "limits and unknown",
        "Both at once: the contest in which the designed controllers have most to lose.",
        ("sea: the thesis's at 6 m", *THESIS_SEA[1:], THESIS_PAYLOAD, WEAK_WINCH, UNKNOWN_RANGES),
    ),
    "thesis_regulator": Note(
        "thesis",
        "The thesis's regulator on the model that it identified, without delay.",
        (THESIS_BOOM_TIP, "payload: the printed a 7.339769 s² and b 0.1906759 s (H 6.2.6)", "lag 1 s"),
    ),
    "thesis_regulator_delay": Note(
        "thesis",
        "What 0.2 s of delay does to that regulator.",
        (
            THESIS_BOOM_TIP,
            "payload: the printed a 7.339769 s² and b 0.1906759 s (H 6.2.6)",
            "lag 1 s, delay 0.2 s",
        ),
    ),
    "thesis_cable": Note(
        "thesis",
        "The thesis's regulators on the cable itself, whose tension may be negative as in the thesis.",
        (THESIS_BOOM_TIP, *THESIS_CABLE, "lag 1 s; exact sensors"),
    ),
    "sea_state_5": Note(
        "linear, on the cable",
        "The linear contest on the real cable: the same sea, delay, noise and weights, and a "
        "payload in resonance. The "
        "demonstration's scenario.",
        (
            *THESIS_SEA,
            *THESIS_CABLE,
            "delay 0.2 s; sensors of 5 mm (payload), 10 mm (boom tip), 1 mm (winch): ours",
        ),
    ),
    "limits_cable": Note(
        "limits, on the cable",
        "The weak winch on the real cable: what it leaves, the cable amplifies.",
        ("sea: the thesis's at 5 m", *THESIS_SEA[1:], *THESIS_CABLE, SLACK, WEAK_WINCH),
    ),
    "energy_cable": Note(
        "energy, on the cable",
        "The priced work on the real cable, where force is the tension.",
        (*THESIS_SEA, *THESIS_CABLE, "delay, noise, weights and price are ours, as in `energy_linear`"),
    ),
    "unknown_cable": Note(
        "unknown, on the cable",
        "Adaptation on the real cable, whose length and payload nobody measured.",
        (*THESIS_SEA, *THESIS_CABLE, SLACK, UNKNOWN_RANGES, "delay and noise are ours"),
    ),
    "limits_unknown_cable": Note(
        "limits and unknown, on the cable",
        "Both at once on the real cable, which amplifies what is left.",
        ("sea: the thesis's at 5 m", *THESIS_SEA[1:], *THESIS_CABLE, SLACK, WEAK_WINCH, UNKNOWN_RANGES),
    ),
    "hybrid": Note(
        "operations",
        "Passive compensator and winch in series, the combination that the thesis names as the "
        "future: how much energy "
        "of the winch does it save?",
        (
            *THESIS_SEA,
            *THESIS_CABLE,
            "compensator: 4 m³ of gas over 0.05 m², stroke 4 m, damping 2 kN s/m, ours",
            "drive: efficiency 0.7, regeneration 0.3, ours",
        ),
    ),
    "lowering": Note(
        "operations",
        "Pay-out with compensation on top: the response changes as the cable lengthens.",
        (
            "cable: 47 mm, E 9.05e9 N/m², 7.2 kg/m; payload 5 t and 8 t of added mass; 2 m/s (H 3.3.5)",
            "weights, drag, sea and sensors are ours, for the thesis does not print them",
            "vessel: H 6.3.6",
        ),
    ),
    "recovery": Note(
        "operations",
        "The mirror of `lowering`: hauling in with compensation on top, through resonance.",
        (
            "cable and payload: those of `lowering` (H 3.3.5); 1 m/s is one of the thesis's speeds",
            "sea: Hs 2 m, 6.5 s, Bretschneider's spectrum through a fitted filter of eight states; ours",
            "vessel: 1 rad/s, damping 0.5, gain 0.6: a small vessel; ours",
        ),
    ),
    "landing": Note(
        "operations",
        "Set-down on the bed: the speed at touch-down is the figure of merit.",
        ("rope: EN 12385-4 (2002), Feyrer (2015), by `heave_env.ropes`", "all else is ours; vessel: H 6.3.6"),
    ),
    "rov_umbilical": Note(
        "operations",
        "A vehicle's garage on its umbilical, seen by sensors as they are sold: they decide, not the delay. "
        "The heave filter of the motion reference unit leads by 0.24 s at these waves, which no design knows "
        "of; that is why `@later` is easier here.",
        (
            "umbilical: 300 m, 47 mm, E 9e9 N/m², 5.4 kg/m, C_N 1.2, C_t 0.01 (H 5.7)",
            "unit: 3 t and 3 t of added mass, C_d 1.5 on 0.5 m², 0.354 m³ displaced (H 5.7); its "
            "weight and that of "
            "the umbilical in water follow from mass and volume",
            "vessel: the shipped `construction_vessel` table, waves 30° off the bow (docs/sea.md)",
            "sensors: `heave_env.sensors`, by data sheets; sea, winch and place of the boom tip are ours",
        ),
    ),
    "snap": Note(
        "hazards",
        "Slack and snap: the wire goes slack in every wave unless the winch takes most of it.",
        (
            "Berteaux, example 9.5: 3000 ft of 3/8 in wire, EA 1.8e6 lbf, 0.191 lb/ft immersed, "
            "4200 lb in air, added "
            "mass 12 slug, 3.14 ft², top 7 ft every 4 s, strength 14 800 lbf",
            "winch and sensors are ours",
        ),
    ),
    "deep_resonance": Note(
        "hazards",
        "Deep water where the cable's own period lies in the wave band.",
        ("cable: section of H 6.2.6 at 2000 m", "payload, sea, vessel, winch and sensors are ours"),
    ),
}
"""Notes by scenario, in the order of the index."""


# One scenario ------------------------------------------------------------------------------------


def controllers_of(scenario: Scenario) -> tuple[str, ...]:
    """Controllers of a page: also `mpc` where limits bite, `multi_model` where a linear plant is unknown.

    On an unknown cable `multi_model` identifies 128 cables, which takes minutes.
    """
    further = ["mpc"] if scenario.winch.speed_limit is not None else []
    further += ["multi_model"] if scenario.uncertainty and scenario.is_linear else []
    return (*CONTROLLERS, *further)


def contest_of(
    scenario: Scenario, controllers: Sequence[str], seeds: Sequence[int]
) -> tuple[Contest, list[str]]:
    """The contest of those controllers that can be designed, and a sentence for each that cannot."""
    entries, refused = [], []
    for spec in controllers:
        try:
            made = controller_of(spec, scenario)
        except ValueError as error:
            refused.append(f"`{spec}`: {error}.")
            continue
        entries.append(Entry(spec, spec, made, scenario.information_set))
    return run_contest(scenario, entries, seeds), refused


def write_page(
    name: str,
    out: str | Path,
    *,
    n_seeds: int,
    controllers: Sequence[str] | None = None,
    duration: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> Path:
    """Runs the controllers and writes `NAME.md` and `NAME.png`.

    Args:
        name: A named scenario.
        out: Folder of the pages.
        n_seeds: Test seas that everybody runs in.
        controllers: Names of designs; None: `controllers_of`.
        duration: Length of an episode [s]; None: the scenario's, the protocol's 400 s at most.
        progress: Called with what comes next.

    Returns:
        The page.

    Raises:
        ValueError: If the scenario is unknown or has no note.
    """
    scenario = load(name)
    if name not in NOTES:
        raise ValueError(f"there is no note on scenario {name!r}; pages are of {', '.join(NOTES)}")
    if n_seeds < 1:
        raise ValueError(f"seeds must be at least 1, got {n_seeds}")
    timed = with_duration(scenario, min(scenario.duration, LONGEST) if duration is None else duration)
    seeds = range(FIRST_TEST_SEED, FIRST_TEST_SEED + n_seeds)
    tell = progress or (lambda what: None)
    tell("controllers")
    contest, refused = contest_of(timed, controllers or controllers_of(scenario), seeds)
    chosen = _chosen(contest)
    met = []
    for variant in variants_of(scenario):
        tell(f"variant {variant}")
        met.append((variant, *_on_variant(timed, variant, chosen, seeds)))
    folder = Path(out)
    picture, _ = figures.png(lambda figure: _draw(figure, contest, chosen), (7.4, 8.0), 88)
    runs.write_bytes(folder / f"{name}.png", picture)
    text = "\n".join(_page(scenario, contest, refused, chosen, met, n_seeds)) + "\n"
    return runs.write_text(folder / f"{name}.md", text)


def _chosen(contest: Contest) -> Outcome:
    """What the picture shows and the variants try: `lqg`, or else the controller of least median cost."""
    for outcome in contest.outcomes:
        if outcome.entry.spec == ON_VARIANTS:
            return outcome
    return min(contest.outcomes, key=lambda outcome: float(np.median(outcome.values["cost"])))


def _on_variant(
    scenario: Scenario, variant: str, chosen: Outcome, seeds: Sequence[int]
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Scores of the locked winch, and of a controller designed for the scenario, on a variant of it."""
    met = with_duration(load(f"{scenario.name}@{variant}"), scenario.duration)
    part = window(met.duration, met.control_dt, None)
    locked = rollout(met, controller_of("none", met), list(seeds))
    acted = rollout(met, chosen.entry.controller, list(seeds))
    return scores(locked, part, locked), scores(acted, part, locked)


# The text ----------------------------------------------------------------------------------------


def _page(
    scenario: Scenario,
    contest: Contest,
    refused: Sequence[str],
    chosen: Outcome,
    met: Sequence[tuple[str, dict[str, Array], dict[str, Array]]],
    n_seeds: int,
) -> Iterator[str]:
    note, name = NOTES[scenario.name], scenario.name
    seen = contest.scenario
    yield f"# {name}"
    yield ""
    yield f"Tier: {note.tier}. Tags: {', '.join(scenario.tags)}. Fingerprint `{scenario.fingerprint}`."
    yield ""
    yield scenario.description
    yield ""
    yield f"**What it is for.** {note.purpose}"
    yield ""
    yield f"![A minute of {name}, with and without control, and its spectra]({name}.png)"
    yield ""
    yield (
        f"The first test sea: locked winch in grey, `{chosen.entry.label}` in colour; below, the spectra of "
        "waves and boom tip with the payload's own frequency."
    )
    crossing = _crossing(scenario)
    if crossing:
        yield ""
        yield crossing
    yield ""
    yield "## Numbers"
    yield ""
    yield "| key | value | meaning |"
    yield "|---|---|---|"
    yield from _number_rows(scenario)
    yield ""
    yield "Sources:"
    yield ""
    yield from (f"- {source}" for source in note.sources)
    if scenario.uncertainty:
        yield ""
        yield "Drawn anew in each episode:"
        yield ""
        yield "| key | from | to | distribution |"
        yield "|---|---|---|---|"
        yield from (_draw_row(draw) for draw in scenario.uncertainty)
    yield ""
    yield "## What is observed"
    yield ""
    yield f"Information set `{scenario.information_set}`, {len(scenario.observation_names)} entries:"
    yield ""
    yield "| channel | noise of a sample | age | further errors |"
    yield "|---|---|---|---|"
    for sensor in scenario.observed_sensors:
        noise = f"{significant(sensor.sample_std(scenario.control_dt))} {_unit(sensor.channel)}"
        yield f"| `{sensor.channel}` | {noise} | {sensor.delay:g} s | {_errors(sensor)} |"
    if scenario.n_shown_pending:
        yield ""
        yield f"and the {scenario.n_shown_pending} newest commands that may still be under way."
    yield ""
    yield "## Controllers"
    yield ""
    protocol = f"{seen.duration:g} s, {contest.part.warm_up:g} s of warm-up"
    yield f"{n_seeds} test seas of {protocol}; over seas. Cost J; payload heave, standard deviation in mm."
    yield ""
    heads = "mean | median | 95 % | maximum"
    yield f"| controller | J {heads} | payload {heads} | diverged, lost |"
    yield "|---|---|---|---|---|---|---|---|---|---|"
    for outcome in contest.outcomes:
        yield _score_row(f"`{outcome.entry.label}`", outcome.values, outcome.ends)
    for sentence in refused:
        yield ""
        yield f"Not designed: {sentence}"
    if scenario.task.landing_depth is not None:
        speeds = [
            f"`{outcome.entry.label}` {significant(float(np.nanmean(outcome.values['touch_down_speed'])))}"
            for outcome in contest.outcomes
        ]
        yield ""
        yield f"Touch-down speed, mean over seas [m/s]: {', '.join(speeds)}."
    labels = ",".join(outcome.entry.label for outcome in contest.outcomes)
    yield ""
    yield "## Variants"
    yield ""
    yield (
        f"`{chosen.entry.label}` as designed for `{name}`, on a plant that is another, in the same "
        f"{n_seeds} seas. The locked winch shows how much harder the operation has become."
    )
    yield ""
    yield "| variant | locked winch: J median | J median | J maximum | payload std median [mm] | failed |"
    yield "|---|---|---|---|---|---|"
    for variant, locked, acted in met:
        cost = acted["cost"]
        failed = int(np.sum(~np.isfinite(acted["payload_heave_std"])))
        yield (
            f"| `@{variant}` | {significant(float(np.median(locked['cost'])))} | "
            f"{significant(float(np.median(cost)))} | {significant(float(np.max(cost)))} | "
            f"{significant(1e3 * float(np.nanmedian(acted['payload_heave_std'])))} | {failed} |"
        )
    yield ""
    yield "## Commands"
    yield ""
    yield "```sh"
    yield f"heave scenarios show {name} > mine.yaml"
    yield f"heave compare {name} --controllers {labels} --seeds {n_seeds} --out runs/{name}"
    yield f"heave train {name} --out runs/{name}-agent"
    yield f"heave compare {name}@{met[0][0]} --controllers none,lqg,agent:runs/{name}-agent --out runs/other"
    usual = controllers_of(scenario) == tuple(labels.split(",")) or refused
    asked = "" if usual else f" --controllers {labels}"
    yield f"heave scenarios page {name} --seeds {n_seeds}{asked}  # this page"
    yield "```"


def _crossing(scenario: Scenario) -> str | None:
    """Where the payload's natural frequency meets the peak of the boom tip's motion, if cable is paid out."""
    if scenario.cable is None or scenario.payload is None or scenario.pay_out.speed == 0.0:
        return None
    peak = peak_of(scenario)
    first, last, plan = scenario.initial_length, last_length(scenario), scenario.pay_out
    own = natural_frequencies(scenario)
    text = (
        f"On the way from {first:g} m to {last:.4g} m the payload's natural frequency goes from "
        f"{own[0]:.3g} to {own[1]:.3g} rad/s; the boom tip moves most at {peak:.3g} rad/s"
    )
    meets = float(resonant_length(np.array([peak]), scenario.cable, scenario.payload)[0])
    if min(first, last) < meets < max(first, last):
        when = plan.start + 0.5 * plan.ramp + abs(meets - first) / abs(plan.speed)
        return f"{text}, which it meets at {meets:.4g} m, {when:.0f} s into the episode."
    return f"{text}, which it would meet at {meets:.4g} m."


def peak_of(scenario: Scenario) -> float:
    """Frequency at which the boom tip moves most [rad/s]."""
    if scenario.sea_state.kind == "regular":
        return scenario.sea_state.peak_omega
    omega = np.linspace(0.05, 4.0, 4000)
    density = boom_tip_spectrum(omega, scenario.sea_state, scenario.boom_tip_vessel)
    return float(omega[np.argmax(density)])


_LEFT_OUT = ("name", "description", "tags", "version", "sensors", "uncertainty", "nominal", "history_lags")


def _number_rows(scenario: Scenario) -> Iterator[str]:
    """A row for each value that is not its class's default."""
    for item in dataclasses.fields(scenario):
        value = getattr(scenario, item.name)
        if item.name in _LEFT_OUT or value is None:
            continue
        if dataclasses.is_dataclass(value):
            docs = document.field_docs(cast(type, type(value)))
            for inner in dataclasses.fields(value):
                part = getattr(value, inner.name)
                if part != inner.default:
                    yield _number_row(f"{item.name}.{inner.name}", part, docs.get(inner.name, ""))
        elif value != item.default or item.name in ("control_dt", "duration"):
            yield _number_row(item.name, value, document.field_docs(Scenario).get(item.name, ""))


def _number_row(key: str, value: Any, doc: str) -> str:
    shown = f"{value:.6g}" if isinstance(value, float) else str(value)
    meaning = doc.split(";")[0].rstrip(".").replace("|", "\\|")
    return f"| `{key}` | {shown} | {meaning} |"


def _draw_row(draw: Draw) -> str:
    return (
        f"| `{draw.parameter}` | {draw.low:.4g} | {draw.high:.4g} | {draw.distribution.replace('_', ' ')} |"
    )


def _unit(channel: str) -> str:
    from heave_env.sensors import CHANNELS

    return CHANNELS[channel]


def _errors(sensor: Any) -> str:
    told = []
    if sensor.interval is not None:
        told.append(f"every {sensor.interval:g} s")
    if sensor.dropout:
        told.append(f"{100.0 * sensor.dropout:g} % lost")
    if sensor.scale_error:
        told.append(f"scale error {100.0 * sensor.scale_error:g} %")
    if sensor.bias:
        told.append(f"bias {sensor.bias:g}")
    if sensor.high_pass_omega is not None:
        told.append(f"high-pass {sensor.high_pass_omega:.3g} rad/s")
    return ", ".join(told) or "none"


def _score_row(label: str, values: dict[str, Array], ends: dict[str, Array]) -> str:
    cells = []
    for metric, factor in (("cost", 1.0), ("payload_heave_std", 1e3)):
        found = factor * values[metric][np.isfinite(values[metric])]
        if len(found) == 0:
            cells += ["none"] * 4
            continue
        numbers = (np.mean(found), np.median(found), np.quantile(found, 0.95), np.max(found))
        cells += [significant(float(number)) for number in numbers]
    failed = f"{int(np.sum(ends['diverged']))}, {int(np.sum(ends['lost']))}"
    return f"| {label} | {' | '.join(cells)} | {failed} |"


# The picture -------------------------------------------------------------------------------------


def _window_shown(scenario: Scenario, locked: Trajectory) -> tuple[float, float]:
    """The minute that is drawn: after the warm-up, where the frequency crosses, or before the landing."""
    last = float(locked.time[int(locked.n_valid[0])])
    start = min(100.0, max(0.0, last - SHOWN))
    if scenario.pay_out.speed != 0.0:
        running = min(scenario.pay_out.distance / abs(scenario.pay_out.speed), last - scenario.pay_out.start)
        start = max(0.0, min(scenario.pay_out.start + 0.5 * running - 0.5 * SHOWN, last - SHOWN))
    return start, min(start + SHOWN, last)


def _draw(figure: Any, contest: Contest, chosen: Outcome) -> None:
    scenario = contest.scenario
    runs_drawn = [outcome for outcome in contest.outcomes if outcome.entry.spec == "none"]
    locked = (runs_drawn or [chosen])[0].sample
    acted = chosen.sample
    begin, end = _window_shown(scenario, locked)
    shown = (locked.time >= begin) & (locked.time <= end)
    time = locked.time[shown]
    colour = figures.COLOURS[3]
    axes = figure.subplots(5 if locked.has_cable else 4, 1)
    for axis in axes[1:-1]:
        axis.sharex(axes[0])
    for axis in axes[:-2]:
        axis.tick_params(labelbottom=False)

    def states(trajectory: Trajectory, channel: str) -> Array:
        return np.where(
            np.arange(len(trajectory.time)) <= trajectory.n_valid[0], trajectory.states[channel][:, 0], np.nan
        )[shown]

    axes[0].plot(time, states(locked, "boom_tip_heave"), color="#30353d", lw=1.0, label="boom tip")
    axes[0].plot(
        time, states(locked, "payload_heave"), color=figures.COLOURS[0], lw=1.8, label="payload, locked"
    )
    axes[0].set(ylabel="heave [m]", title="The sea, and the payload with the winch locked")
    controlled = states(acted, "payload_heave")
    size = float(np.nanmax(np.abs(controlled))) if np.any(np.isfinite(controlled)) else 1.0
    factor, unit = (1e3, "mm") if size < 0.5 else (1.0, "m")
    axes[1].plot(time, factor * controlled, color=colour, label=f"payload, {chosen.entry.label}")
    axes[1].set(ylabel=f"payload [{unit}]", title=f"The payload under {chosen.entry.label}")
    command = np.append(acted.steps["command"][:, 0], np.nan)[shown]
    axes[2].step(time, command, color="#9fc3dd", lw=1.0, where="post", label="command")
    axes[2].plot(time, states(acted, "winch_displacement"), color=colour, label="winch")
    axes[2].set(ylabel="winch [m]", title="Command and winch")
    if locked.has_cable:
        for trajectory, tint, width, label in (
            (locked, figures.COLOURS[0], 1.8, "locked"),
            (acted, colour, 1.2, chosen.entry.label),
        ):
            axes[3].plot(time, 1e-3 * states(trajectory, "sheave_tension"), color=tint, lw=width, label=label)
        axes[3].set(ylabel="tension [kN]", title="Tension at the sheave")
    axes[-2].set(xlabel="time [s]")
    axes[0].set_xlim(begin, max(end, begin + 1.0))
    _draw_spectra(axes[-1], scenario)
    for axis in axes:
        if axis.get_legend_handles_labels()[0]:
            axis.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=4, fontsize=8, borderaxespad=0.1)


def _draw_spectra(axis: Any, scenario: Scenario) -> None:
    sea = scenario.sea_state
    if sea.kind == "regular":
        amplitude = 0.5 * sea.significant_wave_height
        axis.vlines(sea.peak_omega, 0.0, amplitude, color=figures.COLOURS[6], lw=3.0, label="wave")
        axis.set_ylabel("amplitude [m]")
    else:
        omega = np.linspace(0.02, 2.5, 1000)
        wave = elevation_spectrum(omega, sea)
        tip = boom_tip_spectrum(omega, sea, scenario.boom_tip_vessel)
        ratio = float(np.max(wave) / max(np.max(tip), 1e-12))
        times = 10.0 ** max(0, math.floor(math.log10(ratio) + 0.5)) if ratio > 3.0 else 1.0
        axis.fill_between(omega, wave, color="#d7ecef")
        axis.plot(omega, wave, color=figures.COLOURS[6], label="waves")
        label = "boom tip" if times == 1.0 else f"boom tip, times {times:g}"
        axis.plot(omega, times * tip, color="#30353d", label=label)
        axis.set_ylabel("density [m² s]")
    axis.set_ylim(bottom=0.0)
    axis.set_xlim(0.0, 2.5)
    for i, own in enumerate(natural_frequencies(scenario)):
        if own < 2.5:
            axis.axvline(
                own,
                color=figures.COLOURS[1],
                ls=("--", ":")[i],
                lw=1.8,
                label=("payload's own", "at the end")[i],
            )
    axis.set(xlabel="angular frequency [rad/s]", title="Spectra")


def last_length(scenario: Scenario) -> float:
    """Length outboard when the plan or the episode ends, whichever is first [m]."""
    plan = scenario.pay_out
    covered = min(plan.distance, abs(plan.speed) * (scenario.duration - plan.start - 0.5 * plan.ramp))
    return scenario.initial_length + math.copysign(covered, plan.speed)


def natural_frequencies(scenario: Scenario) -> list[float]:
    """The payload's own at the start and, where cable is paid out, at its last length [rad/s]."""
    if scenario.linear_payload is not None:
        return [scenario.linear_payload.natural_omega]
    assert scenario.cable is not None and scenario.payload is not None
    lengths = [scenario.initial_length]
    if scenario.pay_out.speed != 0.0:
        lengths.append(last_length(scenario))
    return [float(natural_omegas(scenario.cable, scenario.payload, length, 1)[0]) for length in lengths]


# All of them -------------------------------------------------------------------------------------


def _has(change: Callable[[Scenario], dict[str, Any]], scenario: Scenario) -> bool:
    """Whether a variant makes sense of a named scenario, without building it."""
    try:
        change(scenario)
    except NoSuchVariantError:
        return False
    return True


def variant_rows() -> list[tuple[str, str, str]]:
    """Each variant, what it is, and the scenarios that have it not."""
    named = [load(name) for name in names()]
    rows = []
    for variant, change in VARIANTS.items():
        lacking = [scenario.name for scenario in named if not _has(change, scenario)]
        rows.append((f"@{variant}", " ".join((change.__doc__ or "").split()), ", ".join(lacking) or "none"))
    return rows
