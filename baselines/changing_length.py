"""The linear model of a payload on a cable whose length changes, and what pay-out itself does to the payload.

While cable goes out or comes in, the stiffness EA / L of the cable and the drag's slope change, and with them

    a(L) x'' + b(L, V) x' + x = x0 + u + d + δ

of `baselines.model`; its other states are what they were, in the same units, so that a controller may go from
one length to the next without a jump. V is the rate of pay-out.

* a and b are identified at a few lengths with the winch locked (`baselines.identification`), a / L and b / L
  interpolated between them: a / L is nearly a straight line, (M + m L / 3) / EA.
* Drag |v| v about a payload that sinks with V has a steeper slope, so b gains what the random motion of the
  identification about V adds to it (`drag_in_random_motion`): for the payload, and a third of the cable.
* d [m] is what drag and acceleration of the pay-out add to the payload's heave. It is read off the plant: its
  own motion in calm water with the winch locked, along the scenario's profile. δ is the doubt of d, a slow
  state that a filter finds: `OFFSET_DOUBT` of the largest d, forgotten over `OFFSET_TIME`.

Between control instants a and b are frozen in the middle of the step. Left out: the winch's displacement in
the profile (a few metres of length) and the cable's own waves.

Source: Huang (1992), (6.2) and 3.3.5; the drag's slope as in Berteaux, chapter 9.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from baselines.identification import PayloadFit, identified
from baselines.model import LinearModel, linear_model
from heave_env.cable.lowering import drag_in_random_motion
from heave_env.parameters import PayOut, SeaState
from heave_env.plant import simulate
from heave_env.scenarios import Scenario
from heave_env.sea import Array
from heave_env.spectra import modal_omega

IDENTIFIED_RATIO = 1.5
"""Longest over shortest of two neighbouring lengths that are identified [-]."""
NODE_RATIO = 1.05
"""The same of two lengths at which the model is made [-]."""
NODE_RATES = (0.0, 1.0 / 3.0, 1.0)
"""Pay-out rates at which it is, over the profile's own [-]."""
OFFSET_DOUBT = 0.1
"""Standard deviation of δ over the largest d [-]."""
OFFSET_TIME = 100.0
"""Time over which δ is forgotten [s]."""
OFFSET_STATE = "pay_out_offset"
"""Name of the state δ, the model's last."""


def changes_length(scenario: Scenario) -> bool:
    """Whether the operation pays cable out or hauls it in."""
    return not scenario.is_linear and scenario.pay_out.speed != 0.0


# The plan -----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Profile:
    """A scenario's pay-out at its control instants, and the payload's answer in calm water, winch locked."""

    length: Array
    """Unstretched length outboard [m], (n_steps + 1,)."""
    rate: Array
    """Mean rate of pay-out over each step [m/s], (n_steps,)."""
    heave: Array
    """Payload's heave [m] and its rate [m/s], (n_steps + 1, 2)."""

    @property
    def n_steps(self) -> int:
        """Control steps [-]."""
        return len(self.rate)

    @property
    def middle(self) -> Array:
        """Length in the middle of each step [m], (n_steps,)."""
        return np.asarray(0.5 * (self.length[1:] + self.length[:-1]))


def pay_out_profile(scenario: Scenario) -> Profile:
    """The pay-out of a scenario with a cable, run once on the plant in calm water."""
    calm = replace(
        scenario,
        sea_state=SeaState(kind="calm", significant_wave_height=1.0, peak_omega=1.0),
        vessel_table=None,
        start="hanging",
        task=replace(scenario.task, landing_depth=None),
        uncertainty=(),
    )
    channels = simulate(calm, seeds=[0])
    length = scenario.initial_length + channels["payout"][:, 0]
    motion = np.column_stack([channels["payload_heave"][:, 0], channels["payload_heave_rate"][:, 0]])
    return Profile(length, np.diff(length) / scenario.control_dt, motion)


# The payload at any length ------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class CableFits:
    """Second-order models of one cable and payload by length."""

    scenario: Scenario
    lengths: Array
    """Lengths that were identified, increasing [m], (n,)."""
    fits: tuple[PayloadFit, ...]
    """Their models, winch and pay-out at rest."""

    def at(self, length: float, rate: float = 0.0) -> PayloadFit:
        """The model at a length [m] and a rate of pay-out [m/s]; beyond the lengths, that of the nearest."""
        length = float(np.clip(length, self.lengths[0], self.lengths[-1]))

        def between(values: list[float]) -> float:
            return float(np.interp(length, self.lengths, values))

        pairs = list(zip(self.fits, self.lengths, strict=True))
        a = length * between([fit.inertia / at for fit, at in pairs])
        b = length * between([fit.damping / at for fit, at in pairs])
        response = between([fit.response_std for fit in self.fits])
        return replace(
            self.fits[0],
            inertia=a,
            damping=b + a * self._steeper_drag(length, rate, response),
            residual_std=between([fit.residual_std for fit in self.fits]),
            response_std=response,
        )

    def _steeper_drag(self, length: float, rate: float, response_std: float) -> float:
        """What a rate of pay-out adds to the slope of the drag, per moving mass [1/s]."""
        cable, payload = self.scenario.cable, self.scenario.payload
        assert cable is not None and payload is not None
        std = response_std * modal_omega(self.scenario.sea_state)
        steeper = drag_in_random_motion(rate, std)[1] - drag_in_random_motion(0.0, std)[1]
        drag = payload.drag_factor + cable.tangential_drag_per_length * length / 3.0
        return steeper * drag / (payload.inertia + cable.inertia_per_length * length / 3.0)


def cable_fits(scenario: Scenario, shortest: float, longest: float) -> CableFits:
    """Identifies a scenario's cable at lengths from the shortest to the longest [m], about 0.3 s each."""
    count = 1 + math.ceil(math.log(longest / shortest) / math.log(IDENTIFIED_RATIO) - 1e-9)
    lengths = np.geomspace(shortest, longest, count) if count > 1 else np.array([shortest])
    task = replace(scenario.task, landing_depth=None)
    return CableFits(
        scenario,
        lengths,
        tuple(
            identified(replace(scenario, length=float(length), pay_out=PayOut(), task=task))
            for length in lengths
        ),
    )


# Models by length and rate ------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class LengthModels:
    """Linear models at the nodes of a grid of lengths and rates of pay-out, node by node, rate innermost."""

    profile: Profile
    cable: CableFits
    lengths: Array
    """[m], (n_lengths,)."""
    rates: Array
    """Magnitudes [m/s], (n_rates,)."""
    fits: tuple[PayloadFit, ...]
    """Payload of each node."""
    models: tuple[LinearModel, ...]
    """Model of each node, without what the fit has left; δ is its last state."""
    doubts: Array
    """Process noise that what the fit has left stands for, (n_nodes, n_states, n_states)."""

    @cached_property
    def A(self) -> Array:
        """Transitions, (n_nodes, n_states, n_states)."""
        return np.array([model.A for model in self.models])

    @cached_property
    def B(self) -> Array:
        """Command inputs, (n_nodes, n_states, 1)."""
        return np.array([model.B for model in self.models])

    @cached_property
    def W(self) -> Array:
        """Process noise without doubt, (n_nodes, n_states, n_states)."""
        return np.array([model.W for model in self.models])

    def place(self, length: Array, rate: Array) -> tuple[Array, Array]:
        """Nodes about lengths [m] and magnitudes of the rate [m/s], and their weights, both (n_rows, 4)."""
        i, along = _between(np.log(self.lengths), np.log(np.maximum(length, self.lengths[0])))
        j, across = _between(self.rates, np.asarray(rate, dtype=float))
        n_rates, last, further = len(self.rates), len(self.lengths) - 1, len(self.rates) - 1
        i_next, j_next = np.minimum(i + 1, last), np.minimum(j + 1, further)
        nodes = np.stack([i * n_rates + j, i * n_rates + j_next, i_next * n_rates + j], axis=1)
        nodes = np.column_stack([nodes, i_next * n_rates + j_next])
        weights = np.stack([(1 - along) * (1 - across), (1 - along) * across, along * (1 - across)], axis=1)
        return nodes, np.column_stack([weights, along * across])

    @cached_property
    def along_profile(self) -> tuple[Array, Array]:
        """Nodes and weights of each step of the profile, (n_steps, 4)."""
        return self.place(self.profile.middle, np.abs(self.profile.rate))

    @cached_property
    def push(self) -> Array:
        """What one metre of d does to payload heave and rate over a step, at each node, (n_nodes, 2)."""
        return np.array([unit_push(A) for A in self.A])

    @cached_property
    def offset(self) -> Array:
        """d of each step [m], (n_steps,): with it the model moves in calm water as the plant does."""
        nodes, weights = self.along_profile
        A, push = mixed(self.A[:, :2, :2], nodes, weights), mixed(self.push, nodes, weights)
        left = self.profile.heave[1:] - np.einsum("kij,kj->ki", A, self.profile.heave[:-1])
        return np.asarray(np.sum(push * left, axis=1) / np.sum(push**2, axis=1))


def mixed(table: Array, nodes: Array, weights: Array) -> Array:
    """Rows of a table (n_nodes, ...) mixed by weights, (n_rows, ...)."""
    return np.asarray(np.einsum("nj,nj...->n...", weights, table[nodes]))


def _between(knots: Array, values: Array) -> tuple[Array, Array]:
    """Knot before each value and how far it is to the next, 0 to 1; one knot, or beyond: the nearest."""
    i = np.clip(np.searchsorted(knots, values, side="right") - 1, 0, max(len(knots) - 2, 0))
    if len(knots) == 1:
        return i, np.zeros(len(values))
    return i, np.clip((values - knots[i]) / (knots[i + 1] - knots[i]), 0.0, 1.0)


def unit_push(A: Array) -> Array:
    """What a unit force over stiffness, held over a step, adds to payload heave and rate, (2,).

    One metre of it has its rest at one metre: [1, 0] - A [1, 0].
    """
    return np.array([1.0, 0.0]) - A[:2, 0]


def with_offset(model: LinearModel, std: float, dt: float) -> LinearModel:
    """The model with one more state, the last: a slow unknown offset δ of the payload.

    Args:
        model: The model without it.
        std: Standard deviation of δ [m].
        dt: Control step [s].
    """
    n, kept = model.n_states, math.exp(-dt / OFFSET_TIME)
    A, W = np.pad(model.A, (0, 1)), np.pad(model.W, (0, 1))
    A[:2, n], A[n, n], W[n, n] = unit_push(model.A), kept, std**2 * (1.0 - kept**2)
    start = np.pad(model.start_covariance, (0, 1))
    start[n, n] = std**2
    return replace(
        model,
        A=A,
        B=np.pad(model.B, ((0, 1), (0, 0))),
        C=np.pad(model.C, ((0, 0), (0, 1))),
        W=W,
        states=(*model.states, OFFSET_STATE),
        thesis_sizes=np.append(model.thesis_sizes, 1.0),
        start_covariance=start,
    )


@lru_cache(maxsize=8)
def length_models(scenario: Scenario) -> LengthModels:
    """The models of a scenario with pay-out, remembered within the process.

    Raises:
        ValueError: If the sea is calm.
    """
    profile = pay_out_profile(scenario)
    shortest, longest = float(profile.length.min()), float(profile.length.max())
    cable = cable_fits(scenario, shortest, longest)
    count = 1 + math.ceil(math.log(longest / shortest) / math.log(NODE_RATIO) - 1e-9)
    lengths = np.geomspace(shortest, longest, count)
    rates = np.max(np.abs(profile.rate)) * np.array(NODE_RATES)
    fits = tuple(cable.at(float(length), float(rate)) for length in lengths for rate in rates)
    # In calm water the payload settles at d: its largest is that of the largest heave.
    std = OFFSET_DOUBT * float(np.max(np.abs(profile.heave[:, 0])))
    plain = [linear_model(scenario, mismatch=0.0, fit=fit) for fit in fits]
    models = tuple(with_offset(model, std, scenario.control_dt) for model in plain)
    doubted = (linear_model(scenario, mismatch=1.0, fit=fit).W for fit in fits)
    doubts = [np.pad(W - model.W, (0, 1)) for W, model in zip(doubted, plain, strict=True)]
    return LengthModels(profile, cable, lengths, rates, fits, models, np.array(doubts))
