"""Designed controllers: regulators, feed-forward, optimal and predictive control; their models and bounds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from baselines.delay_lqr import delay_lqr
from baselines.feedforward import feedforward, feedforward_prediction
from baselines.gain_scheduled import gain_scheduled
from baselines.linear_controller import LinearController
from baselines.lqg import lqg
from baselines.lqr import lqr
from baselines.mpc import mpc, mpc_l1
from baselines.multi_model import multi_model, multi_model_mpc
from baselines.peaks import feedforward_peaks
from baselines.pid import pid
from baselines.tension_activated import tension_activated
from baselines.time_varying import time_varying_lq
from baselines.tuning import tuned
from heave_env.controller import NoControl
from heave_env.scenarios import Scenario

__all__ = [
    "CONTROLLERS",
    "DESIGNERS",
    "LinearController",
    "NoControl",
    "delay_lqr",
    "design",
    "feedforward",
    "feedforward_peaks",
    "feedforward_prediction",
    "gain_scheduled",
    "lqg",
    "lqr",
    "mpc",
    "mpc_l1",
    "multi_model",
    "multi_model_mpc",
    "pid",
    "tension_activated",
    "time_varying_lq",
]

DESIGNERS: dict[str, Callable[..., LinearController]] = {
    "pid": pid,
    "lqr": lqr,
    "delay_lqr": delay_lqr,
    "feedforward": feedforward,
    "feedforward_prediction": feedforward_prediction,
    "feedforward_peaks": feedforward_peaks,
    "lqg": lqg,
    "gain_scheduled": gain_scheduled,
    "time_varying_lq": time_varying_lq,
    "mpc": mpc,
    "mpc_l1": mpc_l1,
    "multi_model": multi_model,
    "multi_model_mpc": multi_model_mpc,
    "tension_activated": tension_activated,
}
"""Functions that design a controller for a scenario, by the controller's name."""
TUNED = (
    "tension_activated",
    "pid",
    "lqr",
    "delay_lqr",
    "lqg",
    "gain_scheduled",
    "time_varying_lq",
    "mpc",
    "mpc_l1",
    "multi_model",
    "multi_model_mpc",
)
"""Designs with weights (or a bandwidth) that are tuned where the plant is more than the linear model."""
CONTROLLERS = ("none", *DESIGNERS)
"""Names that `design` knows."""


def design(name: str, scenario: Scenario, **options: Any) -> Any:
    """Designs a controller by name, with the task's weights or, where the plant is no linear one, tuned.

    Args:
        name: One of `CONTROLLERS`.
        scenario: The operation it is for; of a variant, what it is nominally (`Scenario.design_basis`).
        options: What that design offers, such as `design="continuous"`, or a `command_weight` that is not to
            be tuned (see `baselines.tuning`).

    Returns:
        The controller, with SB3's `predict` signature.

    Raises:
        ValueError: If the name is unknown, or the scenario does not give what the design needs.
    """
    if name == "none":
        return NoControl()
    if name not in DESIGNERS:
        raise ValueError(f"unknown controller {name!r}; known: {', '.join(CONTROLLERS)}")
    scenario = scenario.design_basis
    if name not in TUNED:
        return DESIGNERS[name](scenario, **options)
    return tuned(name, DESIGNERS[name], scenario, **options)
