"""One self-contained page from a comparison's folder; reads what is stored and simulates nothing."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from experiments import figures, page, runs

Array = np.ndarray

DASH = "–"
"""Stands for a number that does not exist."""


RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
NOTHING = 1e-12
"""Smaller numbers are what a decaying lag leaves of zero; nothing on the page is so small in its unit."""


def significant(value: float | None, digits: int = 3) -> str:
    """A number to so many significant digits, without needless exponents."""
    if value is None or not math.isfinite(value):
        return DASH
    if abs(value) < NOTHING:
        return "0"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if exponent < -3 or exponent > 6:
        mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
        return f"{mantissa}·10".replace("-", "−") + str(int(power)).translate(RAISED)
    decimals = digits - 1 - exponent
    if decimals < 0:
        return _grouped(value, decimals)
    return f"{value:.{decimals}f}".replace("-", "−")


def _grouped(value: float, decimals: int) -> str:
    """A large number rounded to tens, hundreds, ..., its thousands set apart."""
    return f"{round(value, decimals):,.0f}".replace("-", "−").replace(",", "\N{NARROW NO-BREAK SPACE}")


def with_interval(found: dict[str, Any] | None, factor: float = 1.0) -> str:
    """Mean ± half the interval, the mean shown to the digits that the interval leaves meaningful."""
    if not found or found.get("mean") is None:
        return DASH
    mean, low, high = found["mean"], found.get("low"), found.get("high")
    if low is None or high is None:
        return significant(factor * mean)
    half = abs(0.5 * factor * (high - low))
    if half < NOTHING:
        return significant(factor * mean)
    if factor * abs(mean) >= 1e6 or half < 1e-5:
        return f"{significant(factor * mean)} ± {significant(half, 2)}"
    decimals = 1 - math.floor(math.log10(half))
    if decimals < 0:
        return f"{_grouped(factor * mean, decimals)} ± {_grouped(half, decimals)}"
    if mean != 0.0:  # five significant digits say enough
        decimals = min(decimals, max(0, 4 - math.floor(math.log10(factor * abs(mean)))))
    bound = f"{half:.{decimals}f}"
    if float(bound) == 0.0:
        bound = f"<{10.0**-decimals:.{decimals}f}"
    return f"{factor * mean:.{decimals}f} ± {bound}".replace("-", "−")


def load(folder: str | Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """The run file and the summary of a comparison's folder.

    Raises:
        ValueError: If the folder holds no comparison.
    """
    folder = Path(folder)
    if not (folder / runs.RUN_FILE).is_file():
        raise ValueError(
            f"{str(folder)!r} holds no comparison: it has no {runs.RUN_FILE}; make one with heave compare"
        )
    run = runs.read_json(folder / runs.RUN_FILE)
    if not isinstance(run, dict) or run.get("kind") != runs.COMPARISON:
        raise ValueError(f"{str(folder)!r} holds no comparison; name the folder that heave compare wrote")
    return run, runs.read_json(folder / runs.SUMMARY_FILE)


def ended_early(metrics: dict[str, Any]) -> str:
    """How many seas ended before their time, and how: `2 diverged`; a dash if none did."""
    counts = {name: int(metrics[name]["mean"]) for name in ("diverged", "lost", "landed") if name in metrics}
    return ", ".join(f"{count} {name}" for name, count in counts.items() if count) or DASH


Column = tuple[str, str]
"""Heading and explanation."""


def motion_table(controllers: dict[str, Any]) -> tuple[list[Column], list[list[str]]]:
    """What is left of the motion: headings and one row of texts per controller."""
    columns = [
        ("std of payload heave [mm]", "mean over seas ± 95 % interval"),
        ("median", "over seas"),
        ("95 %", "of the seas lie below"),
        ("maximum", "over seas"),
        ("largest heave [mm]", "largest magnitude in a sea, mean over seas"),
        ("std of sheave heave [mm]", "boom tip plus winch displacement, mean over seas ± 95 % interval"),
        ("removed of boom tip [%]", "1 - std of payload / std of boom tip"),
        (
            "removed of locked winch [%]",
            "1 - std of payload / std of payload with the winch locked, same seas",
        ),
        ("ended early", "seas that diverged, were lost or landed"),
    ]
    rows = []
    for found in controllers.values():
        metrics = found["metrics"]
        heave = metrics["payload_heave_std"]
        rows.append(
            [
                with_interval(heave, 1e3),
                *(significant(_scaled(heave[key], 1e3)) for key in ("median", "p95", "maximum")),
                with_interval(metrics["payload_heave_max"], 1e3),
                with_interval(metrics.get("sheave_heave_std"), 1e3),
                with_interval(metrics["efficiency_boom_tip"], 1e2),
                with_interval(metrics["efficiency_locked_winch"], 1e2),
                ended_early(metrics),
            ]
        )
    return columns, rows


def cost_table(controllers: dict[str, Any], reference: str) -> tuple[list[Column], list[list[str]]]:
    """What the motion cost: headings and one row of texts per controller."""
    columns = [
        ("cost J", "mean of q x² + r u0², mean over seas ± 95 % interval"),
        ("median", "over seas"),
        ("95 %", "of the seas lie below"),
        ("maximum", "over seas"),
        ("J / optimum", "ratio to the proven optimum, where one is known"),
        (f"J − {reference}", "mean of the paired differences, sea by sea"),
        ("J predicted", "by the controller's own design, where it predicts one"),
        ("control energy [m²]", "mean square of the command u0"),
        ("energy index", "sqrt(sum G²) of a gain G (thesis)"),
        ("saturated [%]", "steps in which a winch limit or the command range bit"),
        ("µs per decision", "mean time of an action, per sea of the batch that the controller acted in"),
    ]
    rows = []
    for found in controllers.values():
        metrics = found["metrics"]
        cost = metrics["cost"]
        rows.append(
            [
                with_interval(cost),
                *(significant(cost[key]) for key in ("median", "p95", "maximum")),
                with_interval(metrics.get("cost_ratio_to_optimum")),
                with_interval(metrics.get("cost_difference")),
                significant(metrics.get("predicted_cost", {}).get("mean")),
                with_interval(metrics["control_energy"]),
                significant(metrics.get("energy_index", {}).get("mean")),
                significant(_scaled(metrics["saturation_fraction"]["mean"], 1e2)),
                significant(metrics.get("decision_time", {}).get("mean")),
            ]
        )
    return columns, rows


def oracle_table(controllers: dict[str, Any]) -> tuple[list[Column], list[list[str]]] | None:
    """What not knowing the parameters costs: headings and one row of texts per controller; None without an
    oracle."""
    if not all("cost_over_oracle" in found["metrics"] for found in controllers.values()):
        return None
    columns = [
        ("J / J of the oracle", "ratio in the same sea, mean over seas ± 95 % interval"),
        ("median", "over seas"),
        ("95 %", "of the seas lie below"),
        ("maximum", "over seas"),
    ]
    rows = []
    for found in controllers.values():
        ratio = found["metrics"]["cost_over_oracle"]
        rows.append(
            [with_interval(ratio), *(significant(ratio[key]) for key in ("median", "p95", "maximum"))]
        )
    return columns, rows


def cable_table(controllers: dict[str, Any]) -> tuple[list[Column], list[list[str]]] | None:
    """What winch and cable bore: headings and one row of texts per controller; None without a cable."""
    if not all("tension_peak" in found["metrics"] for found in controllers.values()):
        return None
    columns = [
        ("winch work [MJ]", "positive mechanical work in the scored time"),
        ("supply [kWh]", "energy drawn from the supply less what returns to it, in the scored time"),
        ("peak power [kW]", "largest mean power of a control step, mean over seas"),
        ("peak tension [kN]", "anywhere along the cable, mean over seas"),
        ("maximum", "peak tension over all seas [kN]"),
        ("least tension [kN]", "anywhere along the cable, mean over seas"),
        ("slack [%]", "steps in which the tension fell to zero somewhere"),
        ("unsafe", "mean number of safety limits broken per step"),
    ]
    lands = any("touch_down_speed" in found["metrics"] for found in controllers.values())
    if lands:
        columns.append(
            ("touch-down [m/s]", "speed of the payload as it lands, mean over the seas that landed")
        )
    rows = []
    for found in controllers.values():
        metrics = found["metrics"]
        rows.append(
            [
                with_interval(metrics["winch_work"], 1e-6),
                with_interval(metrics.get("supply_energy")),
                with_interval(metrics["winch_power_peak"], 1e-3),
                with_interval(metrics["tension_peak"], 1e-3),
                significant(_scaled(metrics["tension_peak"]["maximum"], 1e-3)),
                with_interval(metrics["tension_min"], 1e-3),
                significant(_scaled(metrics["slack_fraction"]["mean"], 1e2)),
                significant(metrics["safety_cost"]["mean"]),
                *([with_interval(metrics.get("touch_down_speed"))] if lands else []),
            ]
        )
    return columns, rows


def _scaled(value: float | None, factor: float) -> float | None:
    return None if value is None else factor * value


def scenario_figures(
    name: str,
    labels: list[str],
    arrays: dict[str, Array],
    episodes: list[dict[str, str]],
    *,
    start: float,
    delay: float,
) -> list[dict[str, str]]:
    """The figures of one scenario as embedded images, with what they show in words.

    Args:
        name: Name of the scenario.
        labels: The controllers.
        arrays: Arrays of the folder's trajectories.
        episodes: Rows of the folder's episodes.
        start: End of the warm-up [s].
        delay: Command delay [s].
    """
    first_sea = {
        label: {
            key.rsplit("/", 1)[1]: values[:, 0].astype(float)
            for key, values in arrays.items()
            if key.startswith(f"{name}/{label}/") and not key.endswith("_spectrum")
        }
        for label in labels
    }
    seed = int(arrays[f"{name}/seed"][0])
    columns = {"payload_heave_std": "payload_heave_std [m]", "control_energy": "control_energy [m²]"}
    values: dict[str, dict[str, Array]] = {}
    for metric, column in columns.items():
        values[metric] = {
            label: np.array(
                [
                    float(row[column]) if row[column] else math.nan
                    for row in episodes
                    if row["scenario"] == name and row["controller"] == label
                ]
            )
            for label in labels
        }
    heave_std, energy = values["payload_heave_std"], values["control_energy"]
    drawn = [
        (
            f"{name}: one sea (seed {seed}) in every controller's hands.",
            "wide",
            figures.time_series(arrays[f"{name}/time"], first_sea, start=start, delay=delay),
        ),
        (
            f"{name}: payload standard deviation against control energy, both logarithmic.",
            "half",
            figures.motion_against_energy(heave_std, energy),
        ),
        (
            f"{name}: spectral density of payload heave by controller, and of the boom tip.",
            "half",
            figures.spectra(
                arrays[f"{name}/omega"],
                arrays.get(f"{name}/{labels[0]}/boom_tip_heave_spectrum"),
                {label: arrays[f"{name}/{label}/payload_heave_spectrum"] for label in labels},
            ),
        ),
        (
            f"{name}: payload standard deviation in every sea, by controller.",
            "wide",
            figures.distribution(heave_std),
        ),
    ]
    return [
        {"caption": caption, "width": width, "source": page.embedded(svg)} for caption, width, svg in drawn
    ]


def _scenario_view(
    entry: dict[str, Any], found: dict[str, Any], reference: str, arrays: dict[str, Array], episodes: Any
) -> dict[str, Any]:
    controllers = found["controllers"]
    labels = list(controllers)
    colours = figures.colour_of(labels)
    delay = float(found["command_delay"])
    tables = []
    for title, table in (
        ("What is left of the motion", motion_table(controllers)),
        ("What it costs", cost_table(controllers, reference)),
        ("What not knowing the parameters costs", oracle_table(controllers)),
        ("What winch and cable bear", cable_table(controllers)),
    ):
        if table is None:
            continue
        columns, rows = table
        lines = [
            {
                "label": label,
                "colour": colours[label],
                "sees": controllers[label]["information_set"].replace("_", " "),
                "measures": ", ".join(controllers[label]["measures"]),
                "cells": cells,
            }
            for label, cells in zip(labels, rows, strict=True)
        ]
        tables.append({"title": title, "columns": columns, "rows": lines})
    scenario = entry["scenario"]
    return {
        "name": entry["name"],
        "description": scenario.get("description", ""),
        "facts": _facts(scenario, found),
        "tables": tables,
        "figures": scenario_figures(
            entry["name"], labels, arrays, episodes, start=float(found["warm_up"]), delay=delay
        ),
        "delay": f"{delay:g}",
        "fingerprint": entry["fingerprint"],
    }


def _facts(scenario: dict[str, Any], found: dict[str, Any]) -> list[tuple[str, str]]:
    sea, winch, task = scenario["sea_state"], scenario["winch"], scenario["task"]
    facts = [("sea", sea["kind"].replace("_", " "))]
    spectrum = sea.get("spectrum", "bretschneider")
    if spectrum != "bretschneider":
        facts.append(("spectrum", spectrum.replace("_", " ")))
    if sea["significant_wave_height"]:
        facts.append(("Hs", f"{sea['significant_wave_height']:g} m"))
        if spectrum not in ("pierson_moskowitz", "measured"):  # which have a frequency of their own
            facts.append(("peak", f"{sea['peak_omega']:.3g} rad/s"))
    if scenario.get("length"):
        facts.append(("cable", f"{scenario['length']:g} m"))
    else:
        facts.append(("plant", "linear payload model"))
    facts.append(("winch lag", f"{winch['time_constant']:g} s"))
    facts.append(("command delay", f"{winch['command_delay']:g} s"))
    facts.append(("weights", f"q {task['position_weight']:g}, r {task['command_weight']:g}"))
    facts.append(("scored", f"{found['scored']:g} s after {found['warm_up']:g} s"))
    optima = {item["optimal_cost"] for item in found["controllers"].values()} - {None}
    if len(optima) == 1:  # with several, each controller's ratio is to its own
        facts.append(("proven optimum J", significant(optima.pop())))
    bound = found.get("bound")
    if bound:
        for part in ("payload", "sheave"):
            value = bound[f"{part}_heave_std"]
            if value is not None:
                facts.append((f"causal bound, {part} std", f"{significant(_scaled(value, 1e3))} mm"))
        facts.append(("foresight needed", f"{bound['horizon']:g} s"))
    if found.get("clairvoyant"):
        facts.append(("clairvoyant J", with_interval(found["clairvoyant"])))
    for label, cost in found.get("oracles", {}).items():
        facts.append((f"yardstick {label}, J", with_interval(cost)))
    batches = {
        int(item["metrics"]["decision_time"]["n_seas"])
        for item in found["controllers"].values()
        if "decision_time" in item["metrics"]
    }
    if len(batches) == 1:
        facts.append(("decisions timed in batches of", f"{batches.pop()}"))
    return facts


def render(folder: str | Path) -> str:
    """The page of a comparison's folder as HTML text.

    Raises:
        ValueError: If the folder holds no comparison, or one that is broken.
    """
    folder = Path(folder)
    run, found = load(folder)
    arrays = runs.read_arrays(folder / runs.TRAJECTORIES_FILE)
    episodes = runs.read_table(folder / runs.EPISODES_FILE)
    try:
        views = [
            _scenario_view(entry, found["scenarios"][entry["name"]], found["reference"], arrays, episodes)
            for entry in run["scenarios"]
        ]
        made = run["provenance"]
        context = {
            "scenarios": views,
            "controllers": list(found["scenarios"][run["scenarios"][0]["name"]]["controllers"]),
            "reference": found["reference"],
            "interval": run["interval"],
            "n_seeds": run["n_seeds"],
            "first_seed": run["first_seed"],
            "last_seed": run["first_seed"] + run["n_seeds"] - 1,
            "dtype": run["dtype"],
            "made": made,
        }
    except (KeyError, IndexError, TypeError) as error:
        raise ValueError(
            f"the comparison in {str(folder)!r} is incomplete ({error}); run heave compare again"
        ) from error
    return page.render("report.html.j2", context)


def write_report(folder: str | Path) -> Path:
    """Draws the page of a comparison or league anew from what its folder holds; returns its path."""
    made = Path(folder) / runs.RUN_FILE
    if made.is_file() and dict(runs.read_json(made)).get("kind") == runs.LEAGUE:
        from experiments.league_page import write_page

        return write_page(folder)
    return runs.write_text(Path(folder) / runs.REPORT_FILE, render(folder))
