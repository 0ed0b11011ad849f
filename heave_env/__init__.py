"""heave_env: a laboratory for active heave compensation.

Importing the package registers every named scenario with Gymnasium, as `heave_env/NAME-vN`.
"""

from __future__ import annotations

import gymnasium as _gymnasium

from heave_env import scenarios as _scenarios
from heave_env.scenarios import Scenario, load

__version__ = "0.2.0"

__all__ = ["Scenario", "__version__", "load"]


def _register() -> None:
    for name in _scenarios.names():
        scenario = load(name)
        if scenario.environment_id in _gymnasium.registry:
            continue
        _gymnasium.register(
            id=scenario.environment_id,
            entry_point="heave_env.env:HeaveEnv",
            vector_entry_point="heave_env.env:HeaveVectorEnv",
            max_episode_steps=scenario.n_steps,
            # The environment looks to the order of its calls itself.
            order_enforce=False,
            kwargs={"scenario": name},
        )


_register()
