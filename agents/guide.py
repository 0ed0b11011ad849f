"""A designed controller beside an agent: its estimate is what the agent sees, its command what it corrects.

A guide is a controller with a Kalman filter. At every control instant it looks at the measurement, which
gives an estimate of the plant's state and the command that it would give itself; then it is told which
command was really given, and carries its estimate on with that. In the mode `residual` the agent's action, a
share `reach` of the command range, is added to the guide's command; in the mode `estimate` the agent's action
is the command.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from baselines import DESIGNERS, design
from baselines.estimator import Estimator
from baselines.kalman import KalmanFilter
from baselines.linear_controller import LinearController
from baselines.tuning import needs_tuning, tuned_weights
from heave_env.scenarios import Scenario

MODES = ("residual", "estimate")
"""What an agent's action means beside a guide."""

Array = np.ndarray

_KNOWN: dict[tuple[str, str], Guide] = {}
"""Guides of this process by scenario and card: a design takes seconds, a training asks for its own often."""


@dataclass(frozen=True)
class Look:
    """What a guide makes of a measurement, row by row."""

    command: Array
    """The command that it would give itself [m], (n_rows, 1)."""
    features: Array
    """What the agent sees of its estimate, (n_rows, n_features), float32, in SI units."""
    estimate: Array
    """The whole estimate, (n_rows, n_states)."""
    rate: Array
    """The drum's rate beside a winch with limits [m/s], (n_rows,)."""


@dataclass(frozen=True, eq=False)
class Guide:
    """A designed controller that looks, and is told what was done."""

    controller: LinearController
    filter: KalmanFilter | Estimator
    mode: str
    """One of `MODES`."""
    reach: float
    """Share of the command range that an action of one adds to the guide's command [-]."""
    card: Mapping[str, Any]
    """What `guide_from_card` makes the same guide of."""

    @property
    def kalman(self) -> KalmanFilter:
        """Its linear filter."""
        return self.filter.filter if isinstance(self.filter, Estimator) else self.filter

    @property
    def n_memory(self) -> int:
        """Numbers that it remembers from step to step [-]."""
        return self.controller.n_memory

    @property
    def feature_names(self) -> tuple[str, ...]:
        """What the agent sees of the guide: estimated states, the drum's rate, the guide's own command."""
        rate = ("winch_rate_estimate",) if isinstance(self.filter, Estimator) else ()
        states = (f"{name}_estimate" for name in self.kalman.model.states)
        return (*states, *rate, "guide_command")

    def look(self, observation: Array, memory: Array) -> Look:
        """Estimate and own command.

        Args:
            observation: As the scenario's sensors give it, (n_rows, n_observations).
            memory: (n_rows, n_memory); zeros where an episode begins.
        """
        guide = self.controller
        y = observation[:, guide.columns].astype(float) * guide.scale + guide.offset
        if isinstance(self.filter, Estimator):
            estimate, rate = self.filter.corrected(memory, y)
            extra = rate[:, None]
        else:
            estimate = self.filter.corrected(memory[:, :-1], y, memory[:, -1])
            rate, extra = memory[:, -1], np.empty((len(y), 0))
        command = guide.respond(y, memory)[0]
        features = np.hstack([estimate, extra, command]).astype(np.float32)
        return Look(command, features, estimate, rate)

    def command(self, look: Look, action: Array) -> Array:
        """The command that is given [m], (n_rows, 1), for actions (n_rows, 1)."""
        most = self.controller.command_range
        if self.mode == "residual":
            return np.asarray(np.clip(look.command + self.reach * most * action, -most, most))
        return np.asarray(np.clip(action, -1.0, 1.0) * most)

    def advance(self, memory: Array, look: Look, command: Array) -> Array:
        """Next memory after the command that was given [m], (n_rows, 1)."""
        if isinstance(self.filter, Estimator):
            return self.filter.advanced(memory, look.estimate, look.rate, command)
        return np.column_stack([self.filter.advanced(look.estimate, command), memory[:, -1] + 1.0])


def make_guide(name: str, scenario: Scenario, *, mode: str, reach: float) -> Guide:
    """Designs (and, where that is due, tunes) a controller as a guide in a scenario.

    Raises:
        ValueError: If the name or the mode is unknown, or the controller has no estimate to show.
    """
    if name not in DESIGNERS:
        raise ValueError(f"guide must be a designed controller, one of {', '.join(DESIGNERS)}, got {name!r}")
    basis = scenario.design_basis
    options = tuned_weights(name, DESIGNERS[name], basis, {}) if needs_tuning(basis) else {}
    return guide_from_card(
        {"controller": name, "options": dict(options), "mode": mode, "reach": reach}, scenario
    )


def guide_from_card(card: Mapping[str, Any], scenario: Scenario) -> Guide:
    """The guide that a saved policy names, designed again with the same weights.

    Raises:
        ValueError: Likewise.
    """
    key = (scenario.fingerprint, json.dumps(card, sort_keys=True))
    if key not in _KNOWN:
        _KNOWN[key] = _guide(card, scenario)
    return _KNOWN[key]


def _guide(card: Mapping[str, Any], scenario: Scenario) -> Guide:
    name, mode = str(card["controller"]), str(card["mode"])
    if mode not in MODES:
        raise ValueError(f"guide's mode must be one of {', '.join(MODES)}, got {mode!r}")
    options = dict(card["options"])
    # A weight of its own tells a design that it is not to be tuned again.
    controller = DESIGNERS[name](scenario.design_basis, **options) if options else design(name, scenario)
    found = getattr(controller, "estimator", None)
    if not isinstance(found, (KalmanFilter, Estimator)):
        raise ValueError(
            f"guide {name!r} has no Kalman filter whose estimate an agent could see in scenario "
            f"{scenario.name!r}: choose lqg or mpc"
        )
    return Guide(controller, found, mode, float(card["reach"]), dict(card))
