"""Designed controllers: regulators, the stochastic-optimal controller, their models and their bound."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from baselines.delay_lqr import delay_lqr
from baselines.linear_controller import LinearController
from baselines.lqg import lqg
from baselines.lqr import lqr
from baselines.tuning import tuned
from heave_env.controller import NoControl
from heave_env.scenarios import Scenario

__all__ = ["CONTROLLERS", "DESIGNERS", "LinearController", "NoControl", "delay_lqr", "design", "lqg", "lqr"]

DESIGNERS: dict[str, Callable[..., LinearController]] = {
    "lqr": lqr,
    "delay_lqr": delay_lqr,
    "lqg": lqg,
}
"""Functions that design a controller for a scenario from given weights, by the controller's name."""
CONTROLLERS = ("none", *DESIGNERS)
"""Names that `design` knows."""


def design(name: str, scenario: Scenario, **options: Any) -> Any:
    """Designs a controller by name, with the task's weights or, where the plant is no linear one, tuned.

    Args:
        name: One of `CONTROLLERS`.
        scenario: The operation it is for.
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
    return tuned(name, DESIGNERS[name], scenario, **options)
