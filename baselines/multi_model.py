"""Adaptive control with many models: a bank of Kalman filters under Bayes' weights, then the likeliest model.

The members of the bank are the scenario with parameters from its own prior (`Scenario.uncertainty`): the
prior's middle, and points of a low-discrepancy sequence. Each runs its filter; with the innovation ν of
member i and its covariance S_i the log weight gains -(ln det S_i + νᵀ S_i⁻¹ ν) / 2 in each step.
`multi_model` gives the mean of the members' own optimal commands under these weights, `multi_model_mpc` the
plan of the member with the largest.

No member is right: the weights soon settle on one, and in eight dimensions even the best one, chosen in
hindsight, costs a quarter more than the truth. At some instants of the episode (`REFINEMENTS`) the whole
record is therefore filtered anew under parameters that Gauss and Newton's steps make likelier
(`baselines.likelihood`): first from the weightiest members, then from where the last refinement ended. From
the first one on the row has one model, the likeliest, with its filter where the record has brought it and a
controller designed for it; the bank rests. A cable's model wants an identification for every trial, so there
the bank has the last word.

Memory of a row: step, step of the last refinement, its parameters, that controller's memory, the log weights
and each member's memory, and the record.

Source: Magill (1965); Åström (1980); Sobol (1967) for the points, scrambled.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import Any, cast

import numpy as np

from baselines.estimator import Estimator
from baselines.kalman import START_STEPS, KalmanFilter, filter_on, kalman_filter
from baselines.likelihood import Estimate, at_shares, evaluate, filter_of, filter_record, improved
from baselines.linear_controller import LinearController, without_matrices
from baselines.lqg import lqg
from baselines.lqr import design_weights
from baselines.model import sea_filter
from baselines.mpc import PredictiveController, mpc
from heave_env.scenarios import Scenario
from heave_env.sea import Array

N_MEMBERS = 64
"""Models in the bank [-]."""
DOUBT = 0.005
"""What a member doubts of its winch in each step, over the boom tip's standard deviation [-]: the truth lies
between the members, and most of what that costs is the drum's path, which nothing measures."""
LEAST_LOG_WEIGHT = -60.0
"""Members are kept within reach: a weight does not fall below e to this, relative to the largest."""
REFINEMENTS = (15.0, 30.0, 60.0, 100.0, 200.0)
"""Times of an episode at which the parameters are found anew from its record [s]."""
N_STARTS = 2
"""Members that the first refinement starts from [-]."""
N_STEPS = 2
"""Gauss and Newton's steps from each start at the first refinement, and in a later one at most [-]."""
ENOUGH = 2.0
"""Standard deviations of the posterior within which a step has arrived [-]."""


def bank_shares(scenario: Scenario, n_members: int = N_MEMBERS) -> Array:
    """Shares of the prior of each member, the prior's middle first, (n_members, n_parameters)."""
    n_parameters = len(scenario.uncertainty)
    if not n_parameters:
        return np.zeros((1, 0))
    from scipy.stats import qmc

    # A power of two keeps the sequence's balance.
    whole = 2 ** math.ceil(math.log2(n_members))
    points = qmc.Sobol(n_parameters, scramble=True, seed=1).random(whole)[:n_members]
    points[0] = 0.5
    return np.asarray(points)


def bank_scenarios(scenario: Scenario, n_members: int = N_MEMBERS) -> list[Scenario]:
    """The scenario at the bank's points of its prior; none is uncertain itself."""
    return [at_shares(scenario, shares) for shares in bank_shares(scenario, n_members)]


@dataclass(frozen=True, eq=False)
class Member:
    """One model of the bank with its filter and its controller."""

    filter: KalmanFilter | Estimator
    controller: LinearController
    """Designed for this model."""
    measures: tuple[str, ...]
    """Entries of the observation that it reads."""
    columns: Array
    """Places of its outputs among the bank's measurements, (n_outputs,)."""

    @property
    def kalman(self) -> KalmanFilter:
        """Its linear filter."""
        return self.filter.filter if isinstance(self.filter, Estimator) else self.filter

    @property
    def n_memory(self) -> int:
        """Numbers it remembers from step to step [-]."""
        return self.filter.n_memory if isinstance(self.filter, Estimator) else self.kalman.model.n_states + 1

    @cached_property
    def surprise(self) -> tuple[Array, float]:
        """Inverse covariance of the stationary innovation, and half the logarithm of its determinant."""
        model = self.kalman.model
        S = model.C @ self.kalman.prior_covariance @ model.C.T + model.V
        return np.linalg.inv(S), 0.5 * float(np.linalg.slogdet(S)[1])

    def log_likelihood(self, memory: Array, y: Array) -> Array:
        """Of a measurement, given the prior estimate, but for a constant; (n_rows,)."""
        n = self.kalman.model.n_states
        innovation = y - memory[:, :n] @ self.kalman.model.C.T
        inverse, half_log_determinant = self.surprise
        return -0.5 * np.einsum("ni,ij,nj->n", innovation, inverse, innovation) - half_log_determinant

    def parted(self, y: Array) -> tuple[Array, Array | None]:
        """Its filter's measurements, and the tension [N] where its winch feels that."""
        seen = y[:, self.columns]
        return self.filter.parted(seen) if isinstance(self.filter, Estimator) else (seen, None)

    def corrected(self, memory: Array, seen: Array) -> tuple[Array, Array]:
        """Estimate, and the drum's rate (with limits only)."""
        if isinstance(self.filter, Estimator):
            return self.filter.corrected(memory, seen)
        return self.filter.corrected(memory[:, :-1], seen, memory[:, -1]), memory[:, -1]

    def advanced(
        self, memory: Array, estimate: Array, rate: Array, command: Array, tension: Array | None
    ) -> Array:
        """Next memory after the command that was given."""
        if isinstance(self.filter, Estimator):
            return self.filter.advanced(memory, estimate, rate, command, tension)
        return np.column_stack([self.filter.advanced(estimate, command), memory[:, -1] + 1.0])


@dataclass(frozen=True, eq=False)
class MultiModel(LinearController):
    """A bank of filters and gains under Bayes' weights, whose likeliest model is refined; see the module."""

    members: tuple[Member, ...] = ()
    shares: Array = field(default_factory=lambda: np.zeros((1, 0)))
    """Of the prior, of each member, (n_members, n_parameters)."""
    scenario: Scenario | None = None
    """The operation with its prior."""
    designer: Callable[..., LinearController] = lqg
    """What designs a controller for a model: `lqg` or `mpc`."""
    weights_of_design: tuple[tuple[str, float], ...] = ()
    """What the designer is told beside the model."""
    refinements: tuple[int, ...] = ()
    """Control steps at which the parameters are found anew."""

    @property
    def is_predictive(self) -> bool:
        """Whether each model has a plan, not a gain."""
        return isinstance(self.members[0].controller, PredictiveController)

    @cached_property
    def places(self) -> dict[str, slice]:
        """Where the parts of the memory are."""
        sizes = {
            "step": 1,
            "handed": 1,
            "shares": self.shares.shape[1],
            "own": self._longest_own if self.refinements else 0,
            "log_weights": len(self.members),
            "bank": int(self.ends[-1]),
            "record": self.n_recorded * (len(self.measures) + 1),
        }
        found, start = {}, 0
        for name, size in sizes.items():
            found[name] = slice(start, start + size)
            start += size
        return found

    @property
    def n_recorded(self) -> int:
        """Control steps of an episode that are kept [-]."""
        return self.refinements[-1] if self.refinements else 0

    @cached_property
    def ends(self) -> Array:
        """Where each member's memory begins among the bank's, and the end; (n_members + 1,)."""
        return np.concatenate([[0], np.cumsum([member.n_memory for member in self.members])]).astype(int)

    @cached_property
    def _longest_own(self) -> int:
        # Only the delay alters the number of states.
        assert self.scenario is not None
        ends = [np.full(self.shares.shape[1], end) for end in (0.5, 1.0)]
        for i, draw in enumerate(self.scenario.uncertainty):
            if draw.parameter != "winch.command_delay":
                ends[1][i] = 0.5
        filters = [filter_of(at_shares(self.scenario, end)) for end in ends]
        linear = [found.filter if isinstance(found, Estimator) else found for found in filters]
        return max(found.model.n_states for found in linear) + 2

    @property
    def n_memory(self) -> int:
        """Numbers remembered from step to step [-]."""
        return self.places["record"].stop

    def weights(self, memory: Array) -> Array:
        """Probability of each member, (n_rows, n_members), of a memory that `predict` returned; after the
        first refinement as it was then."""
        return _normalised(memory[:, self.places["log_weights"]])

    def parameters(self, memory: Array) -> list[dict[str, float]]:
        """The likeliest parameters of each row by name: those refined, or the weightiest member's."""
        assert self.scenario is not None
        refined, shares = memory[:, self.places["handed"]][:, 0] > 0.0, memory[:, self.places["shares"]]
        likeliest = self.shares[np.argmax(memory[:, self.places["log_weights"]], axis=1)]
        chosen = np.where(refined[:, None], shares, likeliest)
        draws = self.scenario.uncertainty
        return [
            {draw.parameter: draw.quantile(float(share)) for draw, share in zip(draws, row, strict=True)}
            for row in chosen
        ]

    def __getstate__(self) -> dict[str, Any]:
        """Everything but the controllers designed on the way, which are designed anew."""
        return {key: value for key, value in self.__dict__.items() if key != "_designed"}

    @cached_property
    def _designed(self) -> OrderedDict[tuple[bytes, int], LinearController]:
        return OrderedDict()

    # In every step -------------------------------------------------------------------------------

    def respond(self, y: Array, memory: Array) -> tuple[Array, Array]:
        """Command in metres, (n_envs, 1), and the next memory, for measurements in SI units."""
        at = self.places
        following = memory.copy()
        step = memory[:, 0].astype(int)
        if self.refinements:
            for row in np.flatnonzero(np.isin(step, self.refinements)):
                self._refine(following[row], int(step[row]))
        handed = following[:, at["handed"]][:, 0].astype(int)
        command = np.empty((len(y), 1))
        banked = np.flatnonzero(handed == 0)
        if len(banked):
            command[banked], log_weights, parts = self._of_bank(y[banked], following[banked])
            following[banked, at["log_weights"]] = log_weights
            following[banked, at["bank"]] = parts
        for row in np.flatnonzero(handed):
            own = self._controller(following[row, at["shares"]], int(handed[row]), len(y))
            part = following[row : row + 1, at["own"]]
            command[row], part[:, : own.n_memory] = own.respond(y[row : row + 1], part[:, : own.n_memory])
        if self.n_recorded:
            record = following[:, at["record"]].reshape(len(y), self.n_recorded, -1)
            rows = np.flatnonzero(step < self.n_recorded)
            record[rows, step[rows]] = np.hstack([y[rows], command[rows]])
        following[:, 0] += 1.0
        return command, following

    def _of_bank(self, y: Array, memory: Array) -> tuple[Array, Array, Array]:
        """Command, log weights and members' next memories."""
        at = self.places
        log_weight = memory[:, at["log_weights"]].copy()
        bank = memory[:, at["bank"]]
        parts = [bank[:, a:b] for a, b in zip(self.ends[:-1], self.ends[1:], strict=True)]
        answers = []
        for i, (member, part) in enumerate(zip(self.members, parts, strict=True)):
            seen, tension = member.parted(y)
            log_weight[:, i] += member.log_likelihood(part, seen)
            answers.append((*member.corrected(part, seen), tension))
        log_weight -= log_weight.max(axis=1, keepdims=True)
        log_weight = np.maximum(log_weight, LEAST_LOG_WEIGHT)
        if self.is_predictive:
            command = np.empty((len(y), 1))
            for row, best in enumerate(np.argmax(log_weight, axis=1)):
                member = self.members[best]
                alone = slice(row, row + 1)
                command[row], _ = member.controller.respond(y[alone][:, member.columns], parts[best][alone])
        else:
            own = [
                -(estimate @ cast(Array, member.controller.gain).T)
                for member, (estimate, _, _) in zip(self.members, answers, strict=True)
            ]
            mean = np.sum(_normalised(log_weight) * np.hstack(own), axis=1, keepdims=True)
            command = self.clipped(mean)
        following = [
            member.advanced(part, estimate, rate, command, tension)
            for member, part, (estimate, rate, tension) in zip(self.members, parts, answers, strict=True)
        ]
        return command, log_weight, np.hstack(following)

    # At a refinement -----------------------------------------------------------------------------

    def _refine(self, memory: Array, step: int) -> None:
        """Finds the parameters of a row anew from its record, in place, and hands over to them."""
        assert self.scenario is not None
        at = self.places
        record = memory[at["record"]].reshape(self.n_recorded, -1)[:step]
        y, commands = record[:, :-1], record[:, -1]
        if memory[at["handed"]][0] == 0.0:
            likeliest = np.argsort(-memory[at["log_weights"]], kind="stable")[:N_STARTS]
            starts, arrives = self.shares[likeliest], 0.0
        else:
            starts, arrives = memory[at["shares"]][None], ENOUGH
        found: list[Estimate] = []
        for shares in starts:
            estimate = evaluate(self.scenario, shares.copy(), y, commands)
            for _ in range(N_STEPS):
                estimate, length = improved(self.scenario, estimate, y, commands)
                if length <= arrives:
                    break
            found.append(estimate)
        best = min(found, key=lambda estimate: estimate.objective)
        prior, rate = best.filtered.prior, best.filtered.rate
        # Its controller begins here as in an episode of its own.
        limited = isinstance(self.members[0].filter, Estimator)
        own = np.concatenate([prior, [rate] if limited else [], [0.0]])
        memory[at["own"]] = 0.0
        memory[at["own"]][: len(own)] = own
        memory[at["handed"]], memory[at["shares"]] = step, best.shares

    def _controller(self, shares: Array, step: int, n_rows: int) -> LinearController:
        """The controller for parameters found at a step; its filter goes on with the covariance of then."""
        key = (shares.tobytes(), step)
        if key not in self._designed:
            assert self.scenario is not None
            variant = at_shares(self.scenario, shares)
            controller = self.designer(variant, **dict(self.weights_of_design))
            later = [other for other in self.refinements if other > step]
            self._designed[key] = _going_on(controller, step, (later[0] - step) if later else START_STEPS)
            while len(self._designed) > 2 * max(n_rows, 8):
                self._designed.popitem(last=False)
        self._designed.move_to_end(key)
        return self._designed[key]


def _normalised(log_weights: Array) -> Array:
    share = np.exp(log_weights - log_weights.max(axis=1, keepdims=True))
    return np.asarray(share / share.sum(axis=1, keepdims=True))


def _going_on(controller: LinearController, step: int, n_start: int) -> LinearController:
    """The controller with its filter as it is some steps into an episode."""
    found: KalmanFilter | Estimator = cast(Any, controller).estimator
    linear = found.filter if isinstance(found, Estimator) else found
    # The covariance does not depend on what was measured.
    nothing = np.zeros((step, len(linear.model.outputs)))
    covariance = filter_record(found, nothing, np.zeros(step)).covariance
    linear = replace(linear, model=replace(linear.model, start_covariance=covariance), n_start=n_start)
    if isinstance(found, Estimator):
        return replace(
            cast(Any, controller), estimator=replace(found, filter=linear, begins_compensated=False)
        )
    return replace(cast(Any, controller), estimator=linear)


# Design ------------------------------------------------------------------------------------------


def boom_tip_std(scenario: Scenario) -> float:
    """Standard deviation of the boom tip by its filter [m]."""
    waves = sea_filter(scenario)
    assert waves is not None
    return float(np.sqrt((waves.C[:1] @ waves.covariance @ waves.C[:1].T).item()))


def _doubting(scenario: Scenario, kalman: KalmanFilter) -> KalmanFilter:
    """A filter that does not trust its own winch to the last."""
    W = kalman.model.W.copy()
    W[2, 2] += (DOUBT * boom_tip_std(scenario)) ** 2
    return filter_on(scenario, replace(kalman.model, W=W))


def multi_model(
    scenario: Scenario,
    *,
    command_weight: float | None = None,
    speed_weight: float = 0.0,
    mismatch: float = 1.0,
    n_members: int = N_MEMBERS,
    refinements: tuple[float, ...] = REFINEMENTS,
) -> MultiModel:
    """Designs the bank of filters and gains for a scenario's sensors and its prior of the parameters.

    Args:
        scenario: The operation; without `uncertainty` the bank is the stochastic-optimal controller alone.
        command_weight: r of the designs [1/m²]; the task's own if not given.
        speed_weight: Weight of the squared winch rate in the designs [s²/m²].
        mismatch: How many times the residual of the identification the model of a cable is doubted by.
        n_members: Models in the bank [-].
        refinements: Times at which the parameters are found anew [s]; none leaves it all to the bank.

    Raises:
        ValueError: If the sea is calm, nothing that the model expresses is measured, or an option is
            impossible.
    """
    return _multi_model(
        "multi_model", lqg, scenario, command_weight, speed_weight, mismatch, n_members, refinements
    )


def multi_model_mpc(
    scenario: Scenario,
    *,
    command_weight: float | None = None,
    speed_weight: float = 0.0,
    mismatch: float = 1.0,
    n_members: int = N_MEMBERS,
    refinements: tuple[float, ...] = REFINEMENTS,
) -> MultiModel:
    """Designs the bank of filters and plans within the winch's limits; arguments as `multi_model`."""
    return _multi_model(
        "multi_model_mpc", mpc, scenario, command_weight, speed_weight, mismatch, n_members, refinements
    )


def _multi_model(
    name: str,
    designer: Callable[..., LinearController],
    scenario: Scenario,
    command_weight: float | None,
    speed_weight: float,
    mismatch: float,
    n_members: int,
    refinements: tuple[float, ...],
) -> MultiModel:
    _, r = design_weights(scenario, command_weight)
    if not (isinstance(n_members, int) and n_members >= 1):
        raise ValueError(f"n_members must be a whole number from 1, got {n_members!r}")
    if not all(earlier < later for earlier, later in zip((0.0, *refinements), refinements, strict=False)):
        raise ValueError(f"refinements must be increasing times above 0 s, got {refinements!r}")
    steps: tuple[int, ...] = ()
    if is_refinable(scenario):
        steps = tuple(dict.fromkeys(max(1, round(time / scenario.control_dt)) for time in refinements))
    options = (("command_weight", r), ("speed_weight", float(speed_weight)), ("mismatch", float(mismatch)))
    n_start = steps[0] + 1 if steps else START_STEPS
    members = _bank(designer, scenario, options, n_members, n_start)
    measures = members[0].measures
    return MultiModel(
        **without_matrices(name, scenario, measures),
        command_weight=r,
        members=members,
        shares=bank_shares(scenario, n_members),
        scenario=scenario,
        designer=designer,
        weights_of_design=options,
        refinements=steps,
    )


def is_refinable(scenario: Scenario) -> bool:
    """Whether something is unknown that a record can be filtered anew for: with a linear payload, behind a
    winch without limits or a lag with limits of speed, acceleration and stroke, seen through sensors."""
    winch = scenario.winch
    simple = not winch.is_limited or not (winch.is_driven or winch.is_second_order)
    sensed = scenario.observed_filter_states == 0
    return bool(scenario.uncertainty) and scenario.is_linear and simple and sensed


@cache
def _bank(
    designer: Callable[..., LinearController],
    scenario: Scenario,
    options: tuple[tuple[str, float], ...],
    n_members: int,
    n_start: int,
) -> tuple[Member, ...]:
    """The members; the first one's outputs are what the bank measures."""
    members: list[Member] = []
    for variant in bank_scenarios(scenario, n_members):
        controller = designer(variant, **dict(options))
        # Who sees the whole state has a gain without a filter.
        found = getattr(controller, "estimator", None) or kalman_filter(variant)
        if isinstance(found, Estimator):
            found = replace(found, filter=replace(found.filter, n_start=n_start))
        else:
            if scenario.uncertainty:
                found = _doubting(variant, found)
            found = replace(found, n_start=n_start)
        if hasattr(controller, "estimator"):
            controller = replace(cast(Any, controller), estimator=found)
        outputs = found.measures if isinstance(found, Estimator) else found.model.outputs
        entries = members[0].measures if members else outputs
        columns = np.array([entries.index(name) for name in outputs], dtype=int)
        members.append(Member(found, controller, outputs, columns))
    return tuple(members)
