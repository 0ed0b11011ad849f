"""Design of the operation by theory alone: winch parameter and the price of a delay.

`winch_curve` is the data of figure 6.25, `index_curve` that of figures 6.18 and 6.19.

Source: Huang (1992), 6.2.5-6.2.6 and 6.3.5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from baselines.delay_lqr import delay_lqr
from baselines.lqg import continuous_performance
from baselines.model import continuous_model
from heave_env.scenarios import Scenario
from heave_env.sea import Array

LOG_WEIGHTS = (-6.0, 9.0)
"""Powers of ten between which a position weight is looked for."""


@dataclass(frozen=True)
class WinchCurve:
    """Energy index against the winch's rate constant at a prescribed payload motion, figure 6.25."""

    rate_constant: Array
    """K [1/s], (n,)."""
    position_weight: Array
    """q that meets the prescription at each K, r being one [1/m²], (n,)."""
    energy_index: Array
    """sqrt(Σ G²) there [-], (n,)."""
    command_std: Array
    """Standard deviation of the command there [m], (n,)."""
    payload_heave_std: float
    """The prescription [m]."""


def weight_for(scenario: Scenario, payload_heave_std: float) -> float:
    """Position weight at which the continuous full-state design leaves a prescribed payload motion.

    Raises:
        ValueError: If the prescription is not between zero and the uncontrolled motion.
    """
    model = continuous_model(scenario)
    uncontrolled = math.sqrt(model.covariance()[0, 0])
    if not 0.0 < payload_heave_std < uncontrolled:
        raise ValueError(
            f"payload_heave_std must lie between 0 and the uncontrolled {uncontrolled:.4g} m, got "
            f"{payload_heave_std!r}"
        )

    def excess(power: float) -> float:
        return math.log(continuous_performance(model, 10.0**power, 1.0).payload_heave_std / payload_heave_std)

    low, high = LOG_WEIGHTS
    power = low
    # Upwards from below: far beyond the answer the Riccati equation is ill-conditioned.
    while excess(power) > 0.0:
        power += 1.0
        if power > high:
            raise ValueError(
                f"payload_heave_std of {payload_heave_std!r} m needs a position weight beyond 1e{high:g}; "
                "ask for a larger one"
            )
    return float(10.0 ** brentq(excess, power - 1.0, power, xtol=1e-10))


def winch_curve(scenario: Scenario, payload_heave_std: float, rate_constants: Array) -> WinchCurve:
    """Energy needed to hold the payload to a standard deviation, against the winch's quickness.

    Continuous stochastic-optimal design with the whole state known, as in the thesis; the command's delay is
    left out. A quick winch beyond a critical K saves nothing more, a slow one costs steeply.

    Args:
        scenario: The operation, with a sea.
        payload_heave_std: Prescribed standard deviation of the payload [m].
        rate_constants: K to try [1/s], (n,).
    """
    weights, indices, commands = [], [], []
    for K in rate_constants:
        winch = replace(scenario.winch, time_constant=1.0 / float(K))
        variant = replace(scenario, winch=winch)
        q = weight_for(variant, payload_heave_std)
        result = continuous_performance(continuous_model(variant), q, 1.0)
        weights.append(q)
        indices.append(result.energy_index)
        commands.append(result.command_std)
    return WinchCurve(
        np.asarray(rate_constants, dtype=float),
        np.array(weights),
        np.array(indices),
        np.array(commands),
        payload_heave_std,
    )


@dataclass(frozen=True)
class IndexCurve:
    """Displacement and velocity indices against the energy index, figures 6.18 and 6.19."""

    position_weight: Array
    """q of each design, r being the scenario's [1/m²], (n,)."""
    displacement: Array
    """J_d = E ∫ x² dt over the duration [m² s], (n,); infinite where the loop is unstable."""
    velocity: Array
    """J_v = E ∫ x'² dt [m²/s], (n,)."""
    energy: Array
    """J_c = Σ G² [-], (n,)."""
    command_std: Array
    """Standard deviation of the command [m], (n,)."""
    delay: float
    """Command delay [s]."""


def index_curve(
    scenario: Scenario,
    position_weights: Array,
    *,
    delay: float,
    duration: float = 100.0,
    design: str = "taylor",
) -> IndexCurve:
    """The thesis's indices of the delay regulator over a range of position weights.

    Expected values on the linear model in the steady state, for payload motion and winch measured exactly;
    a random-phase sea is stood for by its shaping filter.

    Args:
        scenario: The operation, with a sea.
        position_weights: q to try [1/m²], (n,).
        delay: Command delay [s], any that the scenario's solver step divides; 0 gives the plain regulator.
        duration: Upper limit of the indices' integrals [s].
        design: Of the delay regulator, `taylor` as in the thesis or `exact`.
    """
    winch = replace(scenario.winch, command_delay=float(delay))
    rows = []
    for q in position_weights:
        task = replace(scenario.task, position_weight=float(q))
        result = delay_lqr(replace(scenario, winch=winch, task=task), design=design)
        if result.performance is None or result.energy_index is None:
            raise ValueError(
                f"scenario {scenario.name!r} has a calm sea, in which every index is zero; give it a sea"
            )
        rows.append(
            (
                duration * result.performance.payload_heave_std**2,
                duration * result.performance.payload_heave_rate_std**2,
                result.energy_index**2,
                result.performance.command_std,
            )
        )
    displacement, velocity, energy, command = np.array(rows).T
    return IndexCurve(
        np.asarray(position_weights, dtype=float), displacement, velocity, energy, command, float(delay)
    )


def index_curves(
    scenario: Scenario, position_weights: Array, *, delay: float = 0.2, duration: float = 100.0
) -> tuple[IndexCurve, IndexCurve]:
    """Both curves of figures 6.18 and 6.19: without delay and with it."""
    without = index_curve(scenario, position_weights, delay=0.0, duration=duration)
    return without, index_curve(scenario, position_weights, delay=delay, duration=duration)
