"""Performance profiles: in which share of all seas a ratio of costs is not exceeded, with its interval.

Each scenario counts alike, however many trainings an agent has there. Lower costs are better here, so the
share at or below a ratio is shown, where the source shows the share above a score.

Source: Agarwal et al. (2021), 4.2, run-score distributions, and the stratified bootstrap for their bands.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from experiments import figures
from experiments.leaderboard import PROFILE_ENDS, ratios
from experiments.pictures import Picture, Scored
from experiments.statistics import profile_band

Array = np.ndarray

N_THRESHOLDS = 121
"""Ratios at which a profile is drawn [-]."""
COLUMNS = ("entry", "ratio [-]", "share [-]", "low [-]", "high [-]", "n_scenarios", "n_seas", "n_trainings")
"""Columns of the table beside the picture."""


def paired_ratios(scored: Sequence[Scored], reference: str) -> dict[str, list[Array]]:
    """Cost over the reference's in the same sea, by entry that acted in every scenario, a part for each.

    Seas without a score, and those in which the reference costs nothing, are left out of all of a part.

    Raises:
        ValueError: If the reference did not act in one of them.
    """
    for item in scored:
        if reference not in item.values:
            raise ValueError(
                f"reference {reference!r} did not act in {item.scenario.name!r}; choose from "
                f"{', '.join(item.values)}"
            )
    names = [name for name in scored[0].values if all(name in item.values for item in scored)]
    found: dict[str, list[Array]] = {name: [] for name in names}
    for item in scored:
        own = {name: ratios(item.values[name]["cost"], item.values[reference]["cost"]) for name in names}
        whole = np.all([np.isfinite(rows).all(axis=0) for rows in own.values()], axis=0)
        if not whole.any():
            raise ValueError(f"no sea of {item.scenario.name!r} has a cost of everybody")
        for name, rows in own.items():
            found[name].append(rows[:, whole])
    return found


def thresholds_of(found: dict[str, list[Array]]) -> Array:
    """Ratios at which the profiles are drawn, from the least to nearly the largest, evenly in logarithm."""
    every = [rows.ravel() for parts in found.values() for rows in parts]
    low = min(float(rows.min()) for rows in every)
    high = max(float(np.quantile(rows, 0.99)) for rows in every)
    low, high = (float(np.clip(end, *PROFILE_ENDS)) for end in (low, high))
    return np.unique(np.append(np.geomspace(0.97 * min(low, 1.0), 1.03 * max(high, 1.0), N_THRESHOLDS), 1.0))


def profiles_picture(scored: Sequence[Scored], reference: str | None = None) -> Picture:
    """The picture of one or more scenarios.

    Args:
        scored: The scenarios and variants.
        reference: Whose cost the others' are over; None: that of the run.

    Raises:
        ValueError: If the reference did not act, or there is nobody beside it.
    """
    chosen = scored[0].reference if reference is None else reference
    found = paired_ratios(scored, chosen)
    if len(found) < 2:
        raise ValueError(f"nobody but {chosen!r} acted in every scenario; a profile wants at least two")
    thresholds = thresholds_of(found)
    bands = {name: profile_band(parts, thresholds) for name, parts in found.items() if name != chosen}
    names = [item.scenario.name for item in scored]
    n_seas = sum(parts.shape[1] for parts in found[chosen])
    rows: list[tuple[Any, ...]] = []
    for name, (share, low, high) in bands.items():
        trainings = max(len(part) for part in found[name])
        for i, threshold in enumerate(thresholds):
            rows.append((name, threshold, share[i], low[i], high[i], len(scored), n_seas, trainings))

    def draw(figure: Any) -> None:
        figures.draw_profiles(
            figure,
            thresholds,
            {name: band[0] for name, band in bands.items()},
            chosen,
            scored[0].names,
            bands={name: band[1:] for name, band in bands.items()},
        )

    told = names[0] if len(names) == 1 else f"{len(names)} scenarios and variants"
    return Picture(
        kind="profiles",
        name=f"profiles-{names[0]}" if len(names) == 1 else "profiles",
        caption=(
            f"{told}: in which share of {n_seas} seas (and trainings) the cost is at most so many times that "
            f"of {chosen} in the same sea. Bands: pointwise 95 % intervals, stratified bootstrap over seas "
            f"and trainings; each scenario counts alike{'' if len(names) == 1 else ': ' + ', '.join(names)}."
        ),
        draw=draw,
        size=(8.4, 4.1),
        columns=COLUMNS,
        rows=rows,
        about={"scenarios": names, "reference": chosen} | ({"scenario": names[0]} if len(names) == 1 else {}),
    )
