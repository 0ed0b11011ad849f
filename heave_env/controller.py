"""The protocol of everything that acts: designed controllers and trained agents alike."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np


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
