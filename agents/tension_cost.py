"""What a training charges for high tensions, beside the task's own cost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from heave_env.env import HeaveVectorEnv
from heave_env.parameters import require_number
from heave_env.scenarios import Scenario


@dataclass(frozen=True, kw_only=True)
class TensionCost:
    """A charge on the largest tension along the cable in each control step, w max(T / T_s - a, 0)².

    T_s is the tension of the line at rest. An agent is trained and chosen with it; the task's cost, by which
    everybody is compared, knows none.
    """

    weight: float
    """w [-]."""
    above: float
    """a, from where on tension is charged, in tensions at rest [-]."""

    def __post_init__(self) -> None:
        require_number(self, "weight", positive=True)
        require_number(self, "above", non_negative=True)

    def of(self, batch: HeaveVectorEnv) -> np.ndarray:
        """The charge for the step that each row of a batch has just made, (n_envs,)."""
        tension = batch.plant.channel("tension_max").astype(float)
        excess = np.maximum(tension / batch.scenario.static_tension - self.above, 0.0)
        charge: np.ndarray = self.weight * excess * excess
        return charge


def require_cable(scenario: Scenario) -> None:
    """A linear payload hangs on no cable whose tension could be charged.

    Raises:
        ValueError: If the scenario's payload is linear.
    """
    if scenario.is_linear:
        raise ValueError(
            f"tension_cost needs a cable, and the payload of {scenario.name!r} is linear: leave it at 0"
        )
