"""Designed controllers: regulators, the stochastic-optimal controller, their models and their bound."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from baselines.delay_lqr import delay_lqr
from baselines.linear_controller import LinearController
from baselines.lqg import lqg
from baselines.lqr import lqr
from heave_env.controller import NoControl
from heave_env.scenarios import Scenario

__all__ = ["CONTROLLERS", "DESIGNERS", "LinearController", "NoControl", "delay_lqr", "design", "lqg", "lqr"]

DESIGNERS: dict[str, Callable[..., Any]] = {
    "none": lambda scenario: NoControl(),
    "lqr": lqr,
    "delay_lqr": delay_lqr,
    "lqg": lqg,
}
"""Functions that design a controller for a scenario, by the controller's name."""
CONTROLLERS = tuple(DESIGNERS)
"""Names that `design` knows."""


def design(name: str, scenario: Scenario, **options: Any) -> Any:
    """Designs a controller by name.

    Args:
        name: One of `CONTROLLERS`.
        scenario: The operation it is for.
        options: What that design offers, such as `design="continuous"`.

    Returns:
        The controller, with SB3's `predict` signature.

    Raises:
        ValueError: If the name is unknown, or the scenario does not give what the design needs.
    """
    if name not in DESIGNERS:
        raise ValueError(f"unknown controller {name!r}; known: {', '.join(CONTROLLERS)}")
    return DESIGNERS[name](scenario, **options)
