"""The sea of a scenario in numbers: its size, what filters make of it, and what they let one foresee."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import astuple, replace

import numpy as np

from heave_env.parameters import VesselTable
from heave_env.scenarios import Scenario
from heave_env.sea import elevation_fit, wave_filter
from heave_env.shaping import SpectralErrors, spectral_errors
from heave_env.spectra import elevation_spectrum, modal_omega, significant_wave_height, spectral_grid
from heave_env.vessel import boom_tip_filter, boom_tip_fit, fit_vessel, true_boom_tip_spectrum

ORDERS = (2, 4, 6, 8, 10)
"""States of the filters that are tried [-]."""
HORIZONS = (0.2, 0.5, 1.0, 3.0)
"""How far ahead the boom tip is to be known [s]."""

Row = tuple[str, SpectralErrors, float, tuple[float, ...]]


def sea_table(
    scenario: Scenario, orders: Sequence[int] = ORDERS, horizons: Sequence[float] = HORIZONS
) -> list[Row]:
    """What each shaping filter makes of the scenario's spectrum.

    The errors are those of the elevation, with a table of responses those of the boom tip, to which the
    filter is fitted.

    Args:
        scenario: The operation; how its sea is realised has no say.
        orders: States of the fitted filters.
        horizons: How far ahead [s].

    Returns:
        For each filter its name, errors, the boom tip's standard deviation [m] and the share of it that
        cannot be known each horizon ahead [-]; the thesis's filter among them where it models the spectrum.

    Raises:
        ValueError: If the sea has no spectrum.
    """
    sea, vessel = scenario.sea_state, scenario.boom_tip_vessel
    if sea.kind in ("regular", "recorded", "calm"):
        raise ValueError(
            f"scenario {scenario.name!r} has a sea of the kind {sea.kind}, which has no spectrum; choose "
            "shaping_filter or random_phase"
        )
    omega = spectral_grid(sea)
    density = elevation_spectrum(omega, sea)
    by_table = isinstance(vessel, VesselTable)
    rows = []
    if sea.is_bretschneider and not by_table:
        thesis = replace(sea, kind="shaping_filter", filter="thesis", filter_order=6)
        errors = spectral_errors(wave_filter(thesis), omega, density)
        rows.append(("thesis", errors, boom_tip_filter(thesis, vessel)))
    for order in orders:
        fitted = replace(sea, kind="shaping_filter", filter="fitted", filter_order=order)
        fit = boom_tip_fit(fitted, vessel) if by_table else elevation_fit(fitted)
        rows.append((f"order {order}", fit.errors, boom_tip_filter(fitted, vessel)))
    table = []
    for name, errors, motion in rows:
        std = float(motion.output_std[0])
        unknown = tuple(float(motion.unpredictable_std(h)[0]) / std for h in horizons)
        table.append((name, errors, std, unknown))
    return table


def sea_page(scenario: Scenario, orders: Sequence[int] = ORDERS, horizons: Sequence[float] = HORIZONS) -> str:
    """The sea's numbers and `sea_table` as text."""
    table = sea_table(scenario, orders, horizons)
    sea, vessel = scenario.sea_state, scenario.boom_tip_vessel
    omega = spectral_grid(sea)
    step = float(omega[1] - omega[0])
    boom_tip = math.sqrt(float(np.sum(true_boom_tip_spectrum(omega, sea, vessel))) * step)
    peak = modal_omega(sea)
    lines = [
        f"{sea.spectrum}: Hs {significant_wave_height(sea):.4g} m, modal frequency {peak:.4g} rad/s "
        f"(period {2.0 * math.pi / peak:.4g} s); realised as {sea.kind}",
        f"boom tip under the true spectrum: standard deviation {boom_tip:.4f} m",
    ]
    if isinstance(vessel, VesselTable):
        filter_of = fit_vessel(vessel, sea)
        lines.append(
            f"second-order vessel closest to the table: natural_omega {filter_of.natural_omega:.4g} rad/s, "
            f"damping_ratio {filter_of.damping_ratio:.3g}, gain {filter_of.gain:.3g}"
        )
    of = "boom tip" if isinstance(vessel, VesselTable) else "elevation"
    lines += [
        "",
        f"Errors of the {of} [%], standard deviation of the boom tip [m], and the share of it that nobody",
        "can know ahead, sigma_min/sigma [-], by horizon:",
        "",
    ]
    names = ("variance", "peak", "peak freq", "rate var", "misfit")
    header = [f"{'filter':<9}", *(f"{name:>9}" for name in names), f"{'std':>8}"]
    lines.append(" ".join([*header, *(f"{f'{h:g} s':>9}" for h in horizons)]))
    for name, errors, std, unknown in table:
        cells = [f"{100.0 * value:9.2f}" for value in astuple(errors)]
        shares = [f"{share:9.3g}" for share in unknown]
        lines.append(" ".join([f"{name:<9}", *cells, f"{std:8.4f}", *shares]))
    return "\n".join(lines)
