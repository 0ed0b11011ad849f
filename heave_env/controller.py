"""The protocol of everything that acts: designed controllers and trained agents alike."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

if TYPE_CHECKING:
    from heave_env.scenarios import Scenario


class Controller(Protocol):
    """Observation in, action out; Stable-Baselines3 models satisfy it as they are.

    `state` is the controller's memory: what one call returns, the caller hands to the next. Rows in
    which `episode_start` is true start afresh. Observations are `(n_envs, n_observations)`, or
    `(n_observations,)` from a single environment, in which case the action loses its first axis too.
    """

    def predict(
        self,
        observation: np.ndarray,
        state: Any | None = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any | None]:
        """Returns actions in [-1, 1], shape `(n_envs, 1)`, and the memory."""
        ...


def shown_to(controller: Any, scenario: Scenario, information_set: str | None = None) -> Scenario:
    """The scenario showing what a controller wants to see.

    Args:
        controller: What acts, or the settings that one is trained with; its attributes `information_set` and
            `history_lags` say what it sees, where it has them.
        scenario: The operation.
        information_set: What it is to see whatever it says; None: what it says, or else the scenario's.
    """
    wanted = {
        "information_set": information_set or getattr(controller, "information_set", None),
        "history_lags": getattr(controller, "history_lags", None),
    }
    given = {name: value for name, value in wanted.items() if value is not None}
    return dataclasses.replace(scenario, **given) if given else scenario  # type: ignore[arg-type]


class NoControl:
    """Commands zero: the winch is locked, but for the operation's own pay-out."""

    name = "none"
    measures: tuple[str, ...] = ()

    def predict(
        self,
        observation: np.ndarray,
        state: Any | None = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any | None]:
        """Returns zeros."""
        return np.zeros((*np.shape(observation)[:-1], 1), dtype=np.float32), None
