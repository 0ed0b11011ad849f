"""What no causal controller with the same information can beat.

For a linear scenario under a shaping-filter sea, without limits, the stochastic-optimal controller's cost is
the proven optimum: linear dynamics, Gaussian noise, quadratic cost (separation theorem). A history of
measurements adds nothing to it, since the Kalman filter has already used them all.

Source: Åström (1970).
"""

from __future__ import annotations

from baselines.kalman import kalman_filter
from baselines.lqg import lqg, predicted_cost, sees_everything
from heave_env.scenarios import Scenario

RANGE_MARGIN = 6.0
"""Standard deviations of the optimal command that the command range must hold, so that clipping does not
count [-]."""


def optimal_cost(scenario: Scenario) -> float | None:
    """Least average stage cost E[q x_{k+1}² + r u0_k²] that a causal controller can reach in a scenario.

    Returns:
        J by the trace formula [-], or None where it is not proven: a cable, a winch with limits, a sea that
        is no shaping filter, or a command range below `RANGE_MARGIN` standard deviations of the optimal
        command.
    """
    if not scenario.is_linear or scenario.winch.is_limited or scenario.sea_state.kind != "shaping_filter":
        return None
    best = lqg(scenario)
    assert best.performance is not None
    if scenario.winch.command_range < RANGE_MARGIN * best.performance.command_std:
        return None
    return predicted_cost(scenario, None if sees_everything(scenario) else kalman_filter(scenario))
