"""What is wanted of the plant: stage cost, safety limits, failure and success."""

from __future__ import annotations

from dataclasses import dataclass

from heave_env.parameters import require_number


@dataclass(frozen=True, kw_only=True)
class Task:
    """Keep the payload still with little command.

    reward_k = -(q x_{k+1}² + r u0_k² + e |T v|_k / T_s), with x the payload's heave, u0 the commanded winch
    displacement and |T v| the mean over the control step of the winch's power whatever its sign, over the
    tension T_s of the line at rest, so that J, the mean of minus the reward, is the controllers' own cost. A
    linear payload's tension counts as constant: |v| is left.

    Source: Huang (1992), (6.8) and (6.29), sampled.
    """

    position_weight: float
    """q [1/m²]."""
    command_weight: float
    """r [1/m²]."""
    tension_limit: float | None = None
    """Sheave tension above which a step counts as unsafe [N]; null: no limit."""
    landing_depth: float | None = None
    """Depth of the payload below still water at which it has landed and the episode ends [m]; null:
    landing is not the task."""
    energy_weight: float = 0.0
    """e, the price of the winch's work [s/m]; zero: the work is free."""
    failure_factor: float = 10.0
    """A failure costs this many times the uncontrolled stage cost for each remaining step [-]."""

    def __post_init__(self) -> None:
        require_number(self, "position_weight", positive=True)
        require_number(self, "command_weight", positive=True)
        require_number(self, "tension_limit", positive=True, optional=True)
        require_number(self, "landing_depth", positive=True, optional=True)
        require_number(self, "energy_weight", non_negative=True)
        require_number(self, "failure_factor", non_negative=True)
