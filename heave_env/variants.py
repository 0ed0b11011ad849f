"""Variants of a scenario: another sea, depth or delay than the one that controllers and agents know.

`load("sea_state_5@rougher")` is `sea_state_5` in a higher sea. Its plant has the new numbers; what is
observed and commanded keeps the names, sizes and scales of `sea_state_5`, and designs are made for
`sea_state_5` (`Scenario.design_basis`). So whatever was designed or trained there runs here unchanged, and
the mismatch is the point. Variants add up: `sea_state_5@rougher@later`. Seeds mean what they always mean.

A variant is a function from a scenario to the values that it replaces, by dotted path. A number that is drawn
moves with its range.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from heave_env.parameters import LARGEST_FILTER

if TYPE_CHECKING:
    from heave_env.scenarios import Scenario


@dataclass(frozen=True, kw_only=True)
class Nominal:
    """A value that controllers and observations take for granted, while the plant has another."""

    parameter: str
    """Dotted path of the value, as `sea_state.significant_wave_height` or `uncertainty.0.low`."""
    value: float | int | str | bool | None
    """What it is taken for, in the parameter's own unit."""


Change = Callable[["Scenario"], dict[str, Any]]

VARIANTS: dict[str, Change] = {}
"""Functions that give the replaced values of a scenario by path, by the variant's name."""

HEIGHT = 1.4
"""Factor of the wave height in a rougher sea; 1/1.4 in a calmer one [-]."""
FREQUENCY = 1.25
"""Factor of the frequency in shorter waves; 1/1.25 in longer ones [-]."""
DEPTH = 1.25
"""Factor of the depth where it is deeper; 1/1.25 where it is shallower [-]."""
LATER = 0.2
"""What is added to the command's delay [s]."""
MORE_STATES = 2
"""What the shaping filter's order is raised by [-]."""
RECORDED_COMPONENTS = 256
"""Sinusoids of the sea that resembles a record [-]."""


class NoSuchVariantError(ValueError):
    """The variant makes no sense of this scenario."""


def variant(change: Change) -> Change:
    """Registers a function as the variant of its own name, told by its docstring."""
    VARIANTS[change.__name__] = change
    return change


def _refused(scenario: Scenario, name: str, reason: str) -> NoSuchVariantError:
    return NoSuchVariantError(f"scenario {scenario.name!r} has no variant {name!r}: {reason}")


def _moved(
    scenario: Scenario, path: str, value: float, move: Callable[[float], float] | None = None
) -> dict[str, Any]:
    """The value moved, and both ends of its range where it is drawn."""
    move = move or (lambda number: number)
    changes = {path: move(value)}
    for i, draw in enumerate(scenario.uncertainty):
        if draw.parameter == path:
            changes |= {f"uncertainty.{i}.low": move(draw.low), f"uncertainty.{i}.high": move(draw.high)}
    return changes


def _times(scenario: Scenario, path: str, value: float, factor: float) -> dict[str, Any]:
    return _moved(scenario, path, value, lambda number: factor * number)


def _require_waves(scenario: Scenario, name: str, *, own_frequency: bool = False) -> None:
    sea = scenario.sea_state
    if sea.kind in ("recorded", "calm"):
        raise _refused(scenario, name, f"its sea is {sea.kind}")
    if own_frequency and sea.spectrum in ("pierson_moskowitz", "measured"):
        raise _refused(scenario, name, f"its spectrum, {sea.spectrum}, has a frequency of its own")


def _height(scenario: Scenario, name: str, factor: float) -> dict[str, Any]:
    _require_waves(scenario, name)
    sea = scenario.sea_state
    if sea.significant_wave_height == 0.0:
        raise _refused(scenario, name, "its spectrum has the height that was measured")
    changes = _times(scenario, "sea_state.significant_wave_height", sea.significant_wave_height, factor)
    if sea.second_wave_height:
        changes |= _times(scenario, "sea_state.second_wave_height", sea.second_wave_height, factor)
    return changes


@variant
def rougher(scenario: Scenario) -> dict[str, Any]:
    """Waves 1.4 times as high."""
    return _height(scenario, "rougher", HEIGHT)


@variant
def calmer(scenario: Scenario) -> dict[str, Any]:
    """Waves 1.4 times lower."""
    return _height(scenario, "calmer", 1.0 / HEIGHT)


def _frequency(scenario: Scenario, name: str, factor: float) -> dict[str, Any]:
    _require_waves(scenario, name, own_frequency=True)
    sea = scenario.sea_state
    changes = _times(scenario, "sea_state.peak_omega", sea.peak_omega, factor)
    if sea.second_wave_height:
        changes |= _times(scenario, "sea_state.second_peak_omega", sea.second_peak_omega, factor)
    return changes


@variant
def longer_waves(scenario: Scenario) -> dict[str, Any]:
    """Periods 1.25 times as long, of the same height."""
    return _frequency(scenario, "longer_waves", 1.0 / FREQUENCY)


@variant
def shorter_waves(scenario: Scenario) -> dict[str, Any]:
    """Periods 1.25 times shorter, of the same height."""
    return _frequency(scenario, "shorter_waves", FREQUENCY)


def _sinusoids(scenario: Scenario, name: str) -> dict[str, Any]:
    """Where a sea of sinusoids begins: without a filter, and with nothing left of another spectrum."""
    _require_waves(scenario, name, own_frequency=True)
    sea = scenario.sea_state
    if sea.kind == "regular":
        raise _refused(scenario, name, "a regular sea has no spectrum")
    plain = {
        "kind": "random_phase",
        "filter": "thesis",
        "filter_order": 6,
        "peak_enhancement": 3.3,
        "shape": 1.0,
        "second_wave_height": 0.0,
        "second_peak_omega": 1.0,
        "second_shape": 1.0,
    }
    return {f"sea_state.{key}": value for key, value in plain.items()}


@variant
def other_spectrum(scenario: Scenario) -> dict[str, Any]:
    """JONSWAP's spectrum of the same height and peak (γ = 3.3), as a sum of sinusoids; Bretschneider's in its
    place where the scenario has JONSWAP's.
    """
    own = scenario.sea_state.spectrum
    changed = "bretschneider" if own == "jonswap" else "jonswap"
    return _sinusoids(scenario, "other_spectrum") | {"sea_state.spectrum": changed}


@variant
def higher_order(scenario: Scenario) -> dict[str, Any]:
    """White noise through a filter fitted to the same spectrum, with two states more."""
    sea = scenario.sea_state
    if sea.kind != "shaping_filter":
        raise _refused(scenario, "higher_order", f"its sea is {sea.kind}, which has no filter")
    order = sea.filter_order + MORE_STATES
    if order > LARGEST_FILTER:
        raise _refused(scenario, "higher_order", f"its filter has {sea.filter_order} states already")
    return {"sea_state.filter": "fitted", "sea_state.filter_order": order}


@variant
def recorded_like(scenario: Scenario) -> dict[str, Any]:
    """Swell under wind sea, as records of the open ocean show: Ochi and Hubble's spectrum as 256 sinusoids of
    random phase, 36 % of the energy at 0.65 of the frequency (λ = 3), the rest at 1.1 of it (λ = 1.2); the
    same height.
    """
    changes = _sinusoids(scenario, "recorded_like")
    sea = scenario.sea_state
    height, peak = sea.significant_wave_height, sea.peak_omega
    drawn = {draw.parameter for draw in scenario.uncertainty}
    changes |= {
        "sea_state.spectrum": "ochi_hubble",
        "sea_state.n_components": RECORDED_COMPONENTS,
        "sea_state.shape": 3.0,
        "sea_state.second_shape": 1.2,
        "sea_state.second_wave_height": 0.8 * height,
        "sea_state.second_peak_omega": 1.1 * peak,
        **_times(scenario, "sea_state.peak_omega", peak, 0.65),
    }
    if "sea_state.significant_wave_height" in drawn:
        # The wind sea's height is a part of the whole, whose range must not fall below it.
        lowest = min(
            draw.low for draw in scenario.uncertainty if draw.parameter == "sea_state.significant_wave_height"
        )
        changes["sea_state.second_wave_height"] = 0.8 * lowest
    return changes


def _depth(scenario: Scenario, name: str, factor: float) -> dict[str, Any]:
    payload = scenario.linear_payload
    if payload is not None:
        # A spring of that many times the length: a = M/k and b = c/k.
        return {
            **_times(scenario, "linear_payload.inertia", payload.inertia, factor),
            **_times(scenario, "linear_payload.damping", payload.damping, factor),
        }
    changes = _times(scenario, "length", scenario.initial_length, factor)
    if scenario.task.landing_depth is not None:
        added = changes["length"] - scenario.initial_length
        changes["task.landing_depth"] = scenario.task.landing_depth + added
    return changes


@variant
def deeper(scenario: Scenario) -> dict[str, Any]:
    """1.25 times as much cable outboard from the start; for a linear payload a spring as much longer."""
    return _depth(scenario, "deeper", DEPTH)


@variant
def shallower(scenario: Scenario) -> dict[str, Any]:
    """1.25 times less cable outboard from the start; for a linear payload a spring as much shorter."""
    return _depth(scenario, "shallower", 1.0 / DEPTH)


@variant
def later(scenario: Scenario) -> dict[str, Any]:
    """Commands that reach the winch 0.2 s later."""
    added = max(1, round(LATER / scenario.solver_dt)) * scenario.solver_dt
    delay = scenario.winch.command_delay
    return _moved(scenario, "winch.command_delay", delay, lambda number: number + added)
