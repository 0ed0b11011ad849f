"""A designed controller beside an agent: its estimate is what the agent sees, its command what it corrects.

A guide is a controller with a Kalman filter. At every control instant it looks at the measurement, which
gives an estimate of the plant's state and the command that it would give itself; then it is told which
command was really given, and carries its estimate on with that. In the mode `residual` the agent's action, a
share `reach` of the command range, is added to the guide's command; in the mode `estimate` the agent's action
is the command; in the mode `rate` it is the drum's rate, a share `reach` of the fastest, at the end of the
control step in which the command arrives.

A rate forgives an agent's errors where a command does not: behind a lag of 1/s and an acceleration limit of
0.25 m/s^2 a command that is 2.5 cm off is a control step's whole acceleration. The guide of that mode is a
predictive controller, of which only the estimator, the state at the arrival of the command and the inverted
winch are used, and the closed form of its plan without limits; there is no search.
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
from baselines.mpc import PredictiveController
from baselines.tuning import needs_tuning, tuned_weights
from heave_env.scenarios import Scenario

LEAST_SHARE = 1e-4
"""Of the fastest rate, below which the drum counts as at rest [-]."""
MODES = ("residual", "estimate", "rate")
"""What an agent's action means beside a guide."""

Array = np.ndarray

_KNOWN: dict[tuple[str, str], Guide] = {}
"""Guides of this process by scenario and card: a design takes seconds, a training asks for its own often."""


@dataclass(frozen=True)
class Look:
    """What a guide makes of a measurement, row by row."""

    command: Array
    """The command that it would give itself [m], (n_rows, 1); in the mode `rate`, without limits."""
    features: Array
    """What the agent sees of its estimate, (n_rows, n_features), float32, in SI units."""
    estimate: Array
    """The whole estimate, (n_rows, n_states)."""
    rate: Array
    """The drum's rate beside a winch with limits [m/s], (n_rows,)."""
    arrival: Array | None = None
    """In the mode `rate`, the state when the command now given arrives, (n_rows, n_states of the plan)."""


@dataclass(frozen=True, eq=False)
class Guide:
    """A designed controller that looks, and is told what was done."""

    controller: LinearController
    filter: KalmanFilter | Estimator
    mode: str
    """One of `MODES`."""
    reach: float
    """Share of the command range that an action of one adds to the guide's command, or of the fastest rate
    that it means [-]."""
    card: Mapping[str, Any]
    """What `guide_from_card` makes the same guide of."""
    rest: float = 0.0
    """Actions within ± this leave the drum at rest in the mode `rate` [-]: where its work has a price, it is
    often best not to move."""

    @property
    def kalman(self) -> KalmanFilter:
        """Its linear filter."""
        return self.filter.filter if isinstance(self.filter, Estimator) else self.filter

    @property
    def predictive(self) -> PredictiveController:
        """The predictive controller of the mode `rate`."""
        assert isinstance(self.controller, PredictiveController)
        return self.controller

    @property
    def _estimator(self) -> Estimator:
        assert isinstance(self.filter, Estimator)
        return self.filter

    @property
    def fastest(self) -> float:
        """Rate that an action of one means in the mode `rate` [m/s]."""
        winch = self._estimator.winch
        return self.reach * min(winch.speed_limit, winch.rate_constant * winch.command_range)

    @property
    def n_memory(self) -> int:
        """Numbers that it remembers from step to step [-]."""
        return self.controller.n_memory

    @property
    def feature_names(self) -> tuple[str, ...]:
        """What the agent sees of the guide: estimated states, the drum's rate, the guide's own command."""
        if self.mode == "rate":
            sea = self.kalman.model.states[3 + self._estimator.winch.n_pending :]
            plant = ("payload_heave", "payload_heave_rate", "winch_displacement", "winch_rate")
            plan = self.predictive.plan
            assert plan is not None
            n_sea = plan.slope.shape[1] - 4
            coming = (f"{name}_at_arrival" for name in (*plant, *sea[:n_sea]))
            return (*coming, "guide_rate")
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
        if self.mode == "rate":
            return self._look_ahead(observation, memory)
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

    def _look_ahead(self, observation: Array, memory: Array) -> Look:
        guide = self.predictive
        y = observation[:, guide.columns].astype(float) * guide.scale + guide.offset
        measured, tension = self._estimator.parted(y)
        estimate, rate = self._estimator.corrected(memory, measured)
        state = guide.at_arrival(estimate, rate, tension)
        free = guide.unlimited(state)[:, 0]
        features = np.column_stack([state, free]).astype(np.float32)
        return Look(guide.command_for_rate(state, free), features, estimate, rate, state)

    def command(self, look: Look, action: Array) -> Array:
        """The command that is given [m], (n_rows, 1), for actions (n_rows, 1)."""
        most = self.controller.command_range
        if self.mode == "rate":
            assert look.arrival is not None
            share = np.clip(action[:, 0], -1.0, 1.0)
            share = np.sign(share) * np.maximum(np.abs(share) - self.rest, 0.0) / (1.0 - self.rest)
            rate = share * self.fastest
            return self.predictive.command_for_rate(look.arrival, rate)
        if self.mode == "residual":
            return np.asarray(np.clip(look.command + self.reach * most * action, -most, most))
        return np.asarray(np.clip(action, -1.0, 1.0) * most)

    def action(self, look: Look, command: Array) -> Array:
        """The action that gives a command (n_rows, 1) [m], or does the same to the drum, (n_rows, 1)."""
        most = self.controller.command_range
        if self.mode == "rate":
            assert look.arrival is not None
            share = self.predictive.rate_for_command(look.arrival, command)[:, None] / self.fastest
            moves = np.abs(share) > LEAST_SHARE
            action = np.where(moves, share * (1.0 - self.rest) + np.sign(share) * self.rest, 0.0)
        elif self.mode == "residual":
            action = (command - look.command) / (self.reach * most)
        else:
            action = command / most
        return np.clip(action, -1.0, 1.0)

    def advance(self, memory: Array, look: Look, command: Array) -> Array:
        """Next memory after the command that was given [m], (n_rows, 1)."""
        if isinstance(self.filter, Estimator):
            return self.filter.advanced(memory, look.estimate, look.rate, command)
        return np.column_stack([self.filter.advanced(look.estimate, command), memory[:, -1] + 1.0])


def make_guide(name: str, scenario: Scenario, *, mode: str, reach: float, rest: float = 0.0) -> Guide:
    """Designs (and, where that is due, tunes) a controller as a guide in a scenario.

    Raises:
        ValueError: If the name or the mode is unknown, or the controller has no estimate to show.
    """
    if name not in DESIGNERS:
        raise ValueError(f"guide must be a designed controller, one of {', '.join(DESIGNERS)}, got {name!r}")
    basis = scenario.design_basis
    options = tuned_weights(name, DESIGNERS[name], basis, {}) if needs_tuning(basis) else {}
    card = {"controller": name, "options": dict(options), "mode": mode, "reach": reach}
    return guide_from_card(card | ({"rest": rest} if rest else {}), scenario)


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
    try:
        rest = float(card.get("rest", 0.0))
        return beside(controller, mode=mode, reach=float(card["reach"]), rest=rest, card=dict(card))
    except ValueError as error:
        raise ValueError(f"guide {name!r} in scenario {scenario.name!r}: {error}") from error


def beside(
    controller: LinearController,
    *,
    mode: str,
    reach: float,
    rest: float = 0.0,
    card: Mapping[str, Any] | None = None,
) -> Guide:
    """A designed controller as a guide.

    Raises:
        ValueError: If it has no estimate to show, or the mode wants another one.
    """
    found = getattr(controller, "estimator", None)
    if mode == "rate" and not isinstance(controller, PredictiveController):
        raise ValueError("guide_mode 'rate' needs a predictive controller: choose mpc")
    if not isinstance(found, (KalmanFilter, Estimator)):
        raise ValueError("it has no Kalman filter whose estimate an agent could see: choose lqg or mpc")
    return Guide(controller, found, mode, reach, card or {}, rest)
