"""A league's page and Markdown tables, from the leaderboard that its folder holds; nothing is simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments import figures, page, runs
from experiments.leaderboard import NOMINAL, POOLED, failure_text
from experiments.report import DASH, ended_early, significant

PAGE_FILE = "leaderboard.html"
MARKDOWN_FILE = "leaderboard.md"
SUMMARY_FILE = "leaderboard.json"

Cell = dict[str, str]
"""What stands in a cell of a table: `text`, `interval` below it, and the `quantity` it is."""
Column = tuple[str, str, str, float, bool]
"""Heading, explanation, quantity, factor to the shown unit, and whether the interval is shown."""

NEAR_BOUND = 100.0
"""The causal bound is shown where anybody's payload comes within this factor of it: a smooth sea can be
foreseen so well that it says nothing [-]."""
SPREAD_TEXT = (("median", "median"), ("p95", "95 %"), ("maximum", "maximum"))
YARDSTICK_TEXT = {
    "optimum": "the proven optimum with what the contestant sees",
    "oracle": "lqg that knows what each episode drew",
    "oracle_mpc": "mpc that knows what each episode drew",
    "clairvoyant": "the least J of who knows the sea beforehand",
}


def place_text(told: Mapping[str, Any]) -> str:
    """A scenario with its variant, or what stands for several, as text."""
    scenario = "all scenarios" if told["scenario"] == POOLED else told["scenario"]
    return scenario + {NOMINAL: "", POOLED: ", all variants"}.get(told["variant"], f"@{told['variant']}")


def cost_columns(told: dict[str, Any], reference: str) -> list[Column]:
    """Columns of what everybody costs, those that exist."""
    found = {key for entry in told["entries"].values() for key in entry["quantities"]}
    ratio = f"cost_ratio_to_{reference}"
    columns: list[Column] = [
        (f"J / {reference}", f"mean J over the mean J of {reference}, same seas", ratio, 1.0, True),
        ("median", f"of J over that of {reference} in the same sea", "cost_ratio_median", 1.0, False),
        ("95 %", "of these ratios lie below", "cost_ratio_p95", 1.0, False),
        ("maximum", "of these ratios", "cost_ratio_maximum", 1.0, False),
        (
            "middle mean",
            "of the middle half of the ratios",
            "cost_ratio_interquartile_mean",
            1.0,
            True,
        ),
        (
            f"beats {reference} [%]",
            f"probability that its J is below that of {reference} in a sea of chance",
            "probability_of_improvement",
            1e2,
            True,
        ),
    ]
    columns.append((f"J − {reference}", "mean of the differences, sea by sea", "cost_difference", 1.0, True))
    yardsticks = sorted(key for key in found if key.startswith("cost_ratio_to_") and key != ratio)
    for key in yardsticks:
        name = key.removeprefix("cost_ratio_to_")
        said = YARDSTICK_TEXT.get(name, f"the mean J of {name}, same seas")
        columns.append((f"J / {name}", f"mean J over {said}", key, 1.0, True))
    if "cost" in found:
        columns.append(("J", "mean of q x² + r u0², and of what failures cost", "cost", 1.0, True))
    return [column for column in columns if column[2] in found]


def load_columns(told: dict[str, Any], reference: str) -> list[Column]:
    """Columns of motion and load, those that exist."""
    found = {key for entry in told["entries"].values() for key in entry["quantities"]}
    over_bound = "payload_heave_std_ratio_to_bound"
    nearest = [
        entry["quantities"].get(over_bound, {"value": None})["value"] for entry in told["entries"].values()
    ]
    if not any(value is not None and value < NEAR_BOUND for value in nearest):
        found.discard(over_bound)
    columns: list[Column] = [("payload std [mm]", "of heave, mean", "payload_heave_std", 1e3, True)]
    columns += [
        (text, "payload std [mm]", f"payload_heave_std_{key}", 1e3, False) for key, text in SPREAD_TEXT
    ]
    columns += [
        (
            f"payload std − {reference} [mm]",
            "mean of the differences, sea by sea",
            "payload_heave_std_difference",
            1e3,
            True,
        ),
        (
            "std / bound",
            "payload std over what no causal controller can beat",
            "payload_heave_std_ratio_to_bound",
            1.0,
            True,
        ),
        ("control energy [m²]", "mean square of the command u0", "control_energy", 1.0, True),
        ("95 %", "control energy [m²]", "control_energy_p95", 1.0, False),
        ("winch work [MJ]", "positive mechanical work in the scored time", "winch_work", 1e-6, True),
        ("95 %", "winch work [MJ]", "winch_work_p95", 1e-6, False),
        ("peak tension [kN]", "anywhere along the cable, mean", "tension_peak", 1e-3, True),
        ("95 %", "peak tension [kN]", "tension_peak_p95", 1e-3, False),
        ("maximum", "peak tension [kN]", "tension_peak_maximum", 1e-3, False),
        ("99.9 % tension [kN]", "that one step in 1000 exceeds, mean", "tension_p999", 1e-3, True),
        ("maximum", "99.9 % tension [kN]", "tension_p999_maximum", 1e-3, False),
        ("µs per decision", "mean time of an action, per sea of the batch", "decision_time", 1.0, False),
        ("alone", "µs per decision in a single sea", "decision_time_alone", 1.0, False),
    ]
    return [column for column in columns if column[2] in found]


def cell(found: dict[str, Any], column: Column) -> Cell:
    """What stands in a cell."""
    _, _, quantity, factor, shows_interval = column
    number = found.get(quantity)
    if number is None or number["value"] is None:
        return {"text": DASH, "interval": "", "quantity": quantity}
    interval = ""
    ends = (number["low"], number["high"])
    if shows_interval and None not in ends and ends[0] != ends[1]:
        for digits in (3, 4, 5):  # as few as tell the ends from each other and from 1
            low, high = (significant(factor * end, digits) for end in ends)
            interval = f"{low} to {high}"
            if low != high and significant(1.0, digits) not in (low, high):
                break
    return {"text": significant(factor * number["value"], 4), "interval": interval, "quantity": quantity}


def _table(
    told: dict[str, Any], title: str, columns: list[Column], colours: dict[str, str]
) -> dict[str, Any]:
    rows = []
    for name, entry in told["entries"].items():
        ended = ended_early(
            {
                key: {"mean": number["value"]}
                for key, number in entry["quantities"].items()
                if key in ("diverged", "lost", "landed")
            }
        )
        n_trainings = len(entry["trainings"])
        sees = entry["information_set"].replace("_", " ")
        rows.append(
            {
                "label": name,
                "colour": colours[name],
                "below": f"{sees} · {n_trainings} trainings" if n_trainings > 1 else sees,
                "measures": ", ".join(entry["measures"]),
                "best": name == told["best"],
                "cells": [cell(entry["quantities"], column) for column in columns],
                "ended": ended,
            }
        )
    return {"title": title, "columns": [(column[0], column[1]) for column in columns], "rows": rows}


def _every_training(told: dict[str, Any], columns: list[Column], colours: dict[str, str]) -> dict[str, Any]:
    """A table with a row for each training of the agents that have several."""
    rows = []
    for name, entry in told["entries"].items():
        for part in entry["by_training"]:
            counts = {
                key: {"mean": part["quantities"][key]["value"]}
                for key in ("diverged", "lost", "landed")
                if key in part["quantities"]
            }
            rows.append(
                {
                    "label": part["training"],
                    "colour": colours[name],
                    "below": name,
                    "measures": "",
                    "best": False,
                    "cells": [cell(part["quantities"], column) for column in columns],
                    "ended": ended_early(counts),
                }
            )
    return {
        "title": "Every training by itself",
        "columns": [(column[0], column[1]) for column in columns],
        "rows": rows,
    }


def _picture(
    told: dict[str, Any], reference: str, caption: str, names: Sequence[str]
) -> dict[str, str] | None:
    found = told["profiles"]
    if len(found["shares"]) < 2:
        return None
    shares = {name: np.array(row) for name, row in found["shares"].items()}
    text = figures.performance_profiles(np.array(found["thresholds"]), shares, reference, names)
    return {"caption": caption, "source": page.embedded(text)}


def _across(standings: list[dict[str, Any]], name: str, reference: str, colours: dict[str, str]) -> Any:
    """One table of the ratio in every variant of a scenario; None if it has none."""
    own = [item for item in standings if item["scenario"] == name]
    if len(own) < 2:
        return None
    own.sort(key=lambda item: item["variant"] == POOLED)  # what is over all of them comes last
    column: Column = ("", "", f"cost_ratio_to_{reference}", 1.0, True)
    rows = []
    for label in own[0]["entries"]:
        cells = []
        for item in own:
            entry = item["entries"].get(label, {"quantities": {}})
            made = cell(entry["quantities"], column)
            ended = ended_early(
                {
                    key: {"mean": number["value"]}
                    for key, number in entry["quantities"].items()
                    if key in ("diverged", "lost")
                }
            )
            cells.append(made | {"best": item["best"] == label, "ended": "" if ended == DASH else ended})
        rows.append({"label": label, "colour": colours[label], "cells": cells})
    heads = [
        ("all variants" if item["variant"] == POOLED else item["variant"].replace("_", " ")) for item in own
    ]
    return {"heads": heads, "rows": rows}


def _section(told: dict[str, Any], reference: str, colours: dict[str, str], title: str) -> dict[str, Any]:
    """Tables and picture of one scenario, variant, or of several together."""
    columns = cost_columns(told, reference)
    tables = [_table(told, "What it costs", columns, colours)]
    loads = load_columns(told, reference)
    if loads:
        tables.append(_table(told, "Motion, load and time", loads, colours))
    trainings = _every_training(told, columns, colours)
    if trainings["rows"]:
        tables.append(trainings)
    return {
        "title": title,
        "tables": tables,
        "picture": _picture(
            told, reference, f"{title}: in which share of the seas a ratio is not exceeded.", list(colours)
        ),
    }


def _motion(told: dict[str, Any], title: str, names: Sequence[str]) -> list[dict[str, str]]:
    """Everybody's motion against what it took, where no picture with fronts lies in the folder."""
    from experiments.pictures_fronts import league_picture

    drawn = league_picture(title, {name: item["quantities"] for name, item in told["entries"].items()}, names)
    return [] if drawn is None else [{"caption": drawn[1], "source": page.embedded(drawn[0])}]


def page_text(summary: dict[str, Any], pictures: Sequence[dict[str, Any]] = ()) -> str:
    """The page as HTML text.

    Args:
        summary: What `leaderboard.json` holds.
        pictures: What `heave pictures` has drawn of it (`experiments.pictures.stored`).
    """
    reference, standings = summary["reference"], summary["standings"]
    colours = figures.colour_of(sorted({name for item in standings for name in item["entries"]}))
    overall = []
    for item in standings:
        if item["scenario"] == POOLED:
            what = "scenarios as they are" if item["variant"] == NOMINAL else "variants of all scenarios"
            overall.append(_section(item, reference, colours, f"{item['n_cells']} {what}"))
    views = []
    places = {
        name: [item for item in pictures if str(item.get("scenario", "")).partition("@")[0] == name]
        for name in summary["scenarios"]
    }
    for name, about in summary["scenarios"].items():
        drawn = [{"caption": item["caption"], "source": page.embedded(item["svg"])} for item in places[name]]
        own = [item for item in standings if item["scenario"] == name]
        (nominal,) = (item for item in own if item["variant"] == NOMINAL)
        variants = []
        for item in own:
            if item["variant"] == NOMINAL:
                continue
            is_all = item["variant"] == POOLED
            title = f"all {item['n_cells']} variants" if is_all else item["variant"].replace("_", " ")
            section = _section(item, reference, colours, title)
            if not is_all:
                section["told"] = about["variants"][item["variant"]]["description"]
                section["picture"] = None
            variants.append(section)
        facts = [
            ("plant", about["plant"]),
            ("command delay", f"{about['command_delay']:g} s"),
            ("scored", f"{about['scored']:g} s after {about['warm_up']:g} s"),
        ]
        yardsticks = about["variants"][NOMINAL]["yardsticks"]
        facts += [(f"J of {label}", significant(value)) for label, value in yardsticks.items()]
        bound = about["variants"][NOMINAL]["bound"]
        if bound and bound["payload_heave_std"]:
            facts.append(("causal bound", f"payload std {significant(1e3 * bound['payload_heave_std'])} mm"))
        views.append(
            {
                "name": name,
                "description": about["description"],
                "facts": facts,
                "left_out": about["left_out"],
                "fingerprint": about["variants"][NOMINAL]["fingerprint"],
                "nominal": _section(nominal, reference, colours, name),
                "across": _across(standings, name, reference, colours),
                "variants": variants,
                "pictures": drawn
                if any(item["picture"] == "fronts" for item in places[name])
                else _motion(nominal, name, list(colours)) + drawn,
            }
        )
    known = [item["name"] for several in places.values() for item in several]
    return page.render(
        "league.html.j2",
        {
            "views": views,
            "overall": overall,
            "pictures": [
                {"caption": item["caption"], "source": page.embedded(item["svg"])}
                for item in pictures
                if item["name"] not in known
            ],
            "reference": reference,
            "n_seeds": summary["n_seeds"],
            "first_seed": summary["first_seed"],
            "last_seed": summary["first_seed"] + summary["n_seeds"] - 1,
            "dtype": summary["dtype"],
            "interval": summary["interval"],
            "failures": [failure_text(item) for item in summary["failures"]],
            "made": summary["provenance"],
        },
    )


IN_MARKDOWN = {
    "cost_ratio_median": "median of these ratios",
    "payload_heave_std": "payload std [mm]",
    "control_energy": "control energy [m²]",
    "winch_work": "winch work [MJ]",
    "tension_p999": "99.9 % tension [kN]",
    "decision_time": "µs per decision",
    "decision_time_alone": "µs in a single sea",
}
"""What stands in a Markdown table beside the ratios of mean costs, and its heading there."""


def markdown_text(summary: dict[str, Any]) -> str:
    """The leaderboard's main columns as Markdown: a table for each scenario and variant.

    Args:
        summary: What `leaderboard.json` holds.
    """
    reference = summary["reference"]
    lines = []
    for told in summary["standings"]:
        lines += [f"**{place_text(told)}**", ""]
        columns = [
            column
            for column in cost_columns(told, reference) + load_columns(told, reference)
            if column[2].startswith("cost_ratio_to_") or column[2] in IN_MARKDOWN
        ]
        heads = ["", *(IN_MARKDOWN.get(column[2], column[0]) for column in columns), "ended early"]
        lines += [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
        for row in _table(told, "", columns, dict.fromkeys(told["entries"], ""))["rows"]:
            name = f"`{row['label']}`" + (", best" if row["best"] else "")
            texts = [
                made["text"] + (f" ({made['interval']})" if made["interval"] else "") for made in row["cells"]
            ]
            lines.append(f"| {' | '.join([name, *texts, row['ended']])} |")
        lines.append("")
    first, last = summary["first_seed"], summary["first_seed"] + summary["n_seeds"] - 1
    made = summary["provenance"]
    lines.append(f"Seas {first} to {last}; {summary['interval']}; {made['date']}, commit {made['commit']}.")
    return "\n".join(lines) + "\n"


def write_page(folder: str | Path) -> Path:
    """Draws the page and the Markdown tables anew from what the folder holds; returns the page's path.

    Raises:
        ValueError: If the folder holds no leaderboard, or one that is broken.
    """
    from experiments.pictures import stored

    summary = runs.read_json(Path(folder) / SUMMARY_FILE)
    try:
        text, tables = page_text(summary, stored(folder)), markdown_text(summary)
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise ValueError(
            f"the leaderboard in {str(folder)!r} is incomplete ({error}); run heave league again"
        ) from error
    runs.write_text(Path(folder) / MARKDOWN_FILE, tables)
    return runs.write_text(Path(folder) / PAGE_FILE, text)
