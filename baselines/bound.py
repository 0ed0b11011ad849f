"""What no causal controller can beat.

Two bounds. For a linear scenario under a shaping-filter sea, without limits, the stochastic-optimal
controller's cost is the proven optimum: linear dynamics, Gaussian noise, quadratic cost (separation theorem).
A history of measurements adds nothing to it, since the Kalman filter has already used them all.

And, whatever the weights, the limits and the sensors: a command chosen now is felt at a control instant at
the earliest h later, h being the delay and the time until the next such instant. What the sea's white noise
does to an output within h, nobody can answer,

    σ_min² = intensity ∫₀^h g(t)² dt,

with g the output's response to an impulse of that noise. It holds output by output: g to the boom tip bounds
the sheave (boom tip and winch displacement), g to the payload with the winch locked bounds the payload. The
higher the order of the sea's filter, the smoother the motion and the lower the bound, by orders of magnitude:
a sea of the thesis's filter can be foreseen absurdly well.

Source: Åström (1970).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from baselines.kalman import kalman_filter
from baselines.lqg import lqg, predicted_cost, sees_everything
from baselines.model import continuous_model, plant_is_model, sea_filter
from heave_env.scenarios import Scenario
from heave_env.sea import discretised_noise

RANGE_MARGIN = 6.0
"""Standard deviations of the optimal command that the command range must hold, so that clipping does not
count [-]."""


def optimal_cost(scenario: Scenario) -> float | None:
    """Least average stage cost E[q x_{k+1}² + r u0_k²] that a causal controller can reach in a scenario.

    Returns:
        J by the trace formula [-], or None where it is not proven: the plant is more than the linear model
        (a cable, limits, sensors that err otherwise than by noise, drawn parameters),
        the sea is no shaping filter, the winch's work has a price, or the command range is below
        `RANGE_MARGIN` standard deviations of the optimal command.
    """
    if not plant_is_model(scenario) or scenario.sea_state.kind != "shaping_filter":
        return None
    if scenario.task.energy_weight > 0.0:
        return None
    best = lqg(scenario)
    assert best.performance is not None
    if scenario.winch.command_range < RANGE_MARGIN * best.performance.command_std:
        return None
    return predicted_cost(scenario, None if sees_everything(scenario) else kalman_filter(scenario))


@dataclass(frozen=True)
class CausalBound:
    """Least standard deviations at the control instants that causal control leaves."""

    horizon: float
    """h, from the choice of a command to the first control instant that feels it [s]."""
    sheave_heave_std: float
    """Of boom tip plus winch displacement [m]."""
    payload_heave_std: float | None
    """Of the payload [m]; None on a cable, whose response is not linear."""


def causal_horizon(scenario: Scenario) -> float:
    """h: the delay, carried on to the next control instant after it [s].

    For a delay of whole control steps it is the delay and one step.
    """
    return round((scenario.delay_substeps // scenario.n_substeps + 1) * scenario.control_dt, 12)


def causal_bound(scenario: Scenario) -> CausalBound | None:
    """The bound of each output, or None where the sea is no white noise through a filter, or is drawn.

    A finite sum of sinusoids, a record or a calm can be foreseen for ever: there is no such bound.
    """
    waves = sea_filter(scenario)
    if waves is None or scenario.sea_state.kind != "shaping_filter" or scenario.uncertainty:
        return None
    h = causal_horizon(scenario)
    _, gathered = waves.discretised(h)
    sheave = math.sqrt(max((waves.C[0] @ gathered @ waves.C[0]).item(), 0.0))
    if not scenario.is_linear:
        return CausalBound(h, sheave, None)
    model = continuous_model(scenario)
    # Stretched to states of unit variance the exponential keeps its digits.
    size = np.sqrt(np.maximum(np.diag(model.covariance()), 1e-300))
    # The winch stands still.
    size[2] = 1.0
    if scenario.winch.is_second_order:
        size[-1] = 1.0
    _, gathered = discretised_noise(model.A * size / size[:, None], model.noise / size[:, None] / size, h)
    return CausalBound(h, sheave, float(size[0] * math.sqrt(max(gathered[0, 0], 0.0))))
