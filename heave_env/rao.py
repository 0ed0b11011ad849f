"""Response amplitude operators: heave, roll and pitch of a vessel from a table, carried to the boom tip.

In a wave η = a cos ωt at the reference point the vessel heaves a |H| cos(ωt + arg H), and likewise in roll
and pitch; H is the complex response of exp(+iωt), so a positive phase leads the wave. Axes are x forward, y
to port, z up; rotations are right-handed: roll about x lifts the port side, pitch about y presses the bow
down. A point r = (x, y, z) of the vessel moves by ω × r, upwards by roll y - pitch x, whence

    boom-tip heave = heave - x pitch + y roll.

Responses are linear (of their real and imaginary parts) between the table's frequencies and headings. Long
waves carry the vessel along: at ω = 0 heave is one and roll and pitch nothing. Beyond the last frequency the
last response falls as ω⁻²; `heave_env.vessel` complains where that matters.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from heave_env.files import modified, read_columns
from heave_env.parameters import VesselTable, name_hint
from heave_env.spectra import Array

SHIPPED = Path(__file__).parent / "data" / "vessels"
"""Folder of the tables that travel with the package."""
MOTIONS = ("heave", "roll", "pitch")


@dataclass(frozen=True, eq=False)
class ResponseTable:
    """Complex responses of exp(+iωt) on a grid of headings and frequencies."""

    heading: Array
    """Where the waves travel to, from the bow towards port, increasing [rad], (n_headings,)."""
    omega: Array
    """Increasing, positive [rad/s], (n_omega,)."""
    heave: Array
    """Per metre of wave amplitude [-], (n_headings, n_omega)."""
    roll: Array
    """[rad/m], (n_headings, n_omega)."""
    pitch: Array
    """[rad/m], (n_headings, n_omega)."""
    path: str
    """Where it was read from."""

    def boom_tip(self, omega: Array, heading: float, x: float, y: float) -> Array:
        """Heave of a point per metre of wave amplitude, complex [-], of the shape of `omega`.

        Args:
            omega: Angular frequency [rad/s], any shape, not negative.
            heading: Where the waves travel to, from the bow towards port [rad].
            x: Forward of the reference point [m].
            y: To port of it [m].

        Raises:
            ValueError: If the heading lies outside the table.
        """
        first, last = float(self.heading[0]), float(self.heading[-1])
        if not first - 1e-6 <= heading <= last + 1e-6:
            raise ValueError(
                f"VesselTable.heading {heading:g} rad lies outside {first:g} to {last:g} rad, the headings "
                f"of {self.path!r}; of a vessel whose sides are alike negate heading and boom_tip_y"
            )
        # Complex numbers of one heading, linear between its neighbours.
        i = int(np.clip(np.searchsorted(self.heading, heading) - 1, 0, max(len(self.heading) - 2, 0)))
        j = min(i + 1, len(self.heading) - 1)
        gap = float(self.heading[j] - self.heading[i])
        part = min(max((heading - float(self.heading[i])) / gap, 0.0), 1.0) if gap else 0.0
        at_tip = self.heave - x * self.pitch + y * self.roll
        of_heading = (1.0 - part) * at_tip[i] + part * at_tip[j]
        omega = np.asarray(omega, dtype=float)
        end = float(self.omega[-1])
        inside = np.interp(omega, np.r_[0.0, self.omega], np.r_[1.0 + 0.0j, of_heading])
        return np.asarray(inside * np.minimum(1.0, end / np.maximum(omega, 1e-12)) ** 2)


def read_responses(path: str | Path) -> ResponseTable:
    """Reads a table of responses, strictly.

    A CSV with the columns `heading` [rad], `omega` [rad/s] and, for heave, roll and pitch, `..._amplitude`
    [m/m, rad/m] and `..._phase` [rad]; headings in blocks that increase, each with the same increasing
    frequencies. Lines that begin with # are comments.

    Raises:
        ValueError: If the file cannot be read, a column or value is missing or no number, an amplitude is
            negative, headings or frequencies do not increase, or a heading lacks some frequency.
    """
    names = tuple(f"{motion}_{part}" for motion in MOTIONS for part in ("amplitude", "phase"))
    columns, lines = read_columns(path, "vessel table", ("heading", "omega", *names))

    def complain(row: int, what: str) -> None:
        raise ValueError(f"vessel table {str(path)!r} line {lines[row]}: {what}")

    heading, omega = columns["heading"], columns["omega"]
    if len(heading) == 0:
        raise ValueError(f"vessel table {str(path)!r} holds no responses; give a row for each frequency")
    for motion in MOTIONS:
        negative = columns[f"{motion}_amplitude"] < 0.0
        if np.any(negative):
            complain(int(np.argmax(negative)), f"{motion}_amplitude is negative; turn its phase by π instead")
    if np.any(omega <= 0.0):
        complain(int(np.argmax(omega <= 0.0)), "omega must be positive; at zero the vessel follows the wave")
    starts = np.r_[0, np.nonzero(np.diff(heading))[0] + 1, len(heading)]
    sizes, grid = np.diff(starts), omega[: starts[1]]
    if np.any(np.diff(heading) < 0.0):
        complain(int(np.argmax(np.diff(heading) < 0.0)) + 1, "heading falls; sort the blocks by heading")
    if len(grid) < 2:
        complain(0, "a heading needs at least two frequencies")
    for start, size in zip(starts[:-1], sizes, strict=True):
        block = omega[start : start + size]
        if np.any(np.diff(block) <= 0.0):
            complain(
                int(start + np.argmax(np.diff(block) <= 0.0) + 1), "omega must increase within a heading"
            )
        if size != len(grid) or not np.array_equal(block, grid):
            complain(
                int(start),
                f"heading {heading[start]:g} has other frequencies than heading {heading[0]:g}; fill the gap",
            )
    responses = {
        motion: (columns[f"{motion}_amplitude"] * np.exp(1j * columns[f"{motion}_phase"])).reshape(
            len(sizes), len(grid)
        )
        for motion in MOTIONS
    }
    return ResponseTable(heading=heading[starts[:-1]], omega=grid, path=str(path), **responses)


def table_path(vessel: VesselTable) -> Path:
    """Where a vessel's table lies: the shipped one of that name, or the file.

    Raises:
        ValueError: If there is neither.
    """
    shipped = SHIPPED / f"{vessel.table}.csv"
    if vessel.table.isidentifier() and shipped.is_file():
        return shipped
    if not Path(vessel.table).is_file():
        known = sorted(path.stem for path in SHIPPED.glob("*.csv"))
        hint = name_hint(vessel.table, known, f"shipped: {', '.join(known)}")
        raise ValueError(f"VesselTable.table {vessel.table!r} is no file and no shipped table; {hint}")
    return Path(vessel.table)


@lru_cache(maxsize=16)
def _cached_responses(path: Path, stamp: int) -> ResponseTable:
    return read_responses(path)


def responses_of(vessel: VesselTable) -> ResponseTable:
    """The table that a vessel names, read anew when the file has changed."""
    path = table_path(vessel)
    return _cached_responses(path, modified(path))


def boom_tip_response(omega: Array, vessel: VesselTable) -> Array:
    """Boom-tip heave over elevation at iω from the vessel's table, complex [-]."""
    table = responses_of(vessel)
    heading = math.remainder(vessel.heading, 2.0 * math.pi)
    if heading < table.heading[0] - 1e-6:
        heading += 2.0 * math.pi
    return table.boom_tip(omega, heading, vessel.boom_tip_x, vessel.boom_tip_y)
