"""The Kalman filter beside a winch that keeps to its limits.

The linear filter believes that the winch follows its lag; while a limit bites it would take what the winch
does not do for motion of the sea. Here the drum is reckoned with its limits from the commands given
(`baselines.winch_model`), and the payload's prior is driven by the path that the drum really takes. Without
limits both filters are the same to rounding.

Limits of power and torque depend on the sheave's tension. A power limit is reckoned with the newest sample
where the scenario has such a sensor, else with the tension of the cable hanging still; a torque limit with
the latter, for a drum that accelerates changes the tension within the step, and who planned with the sample
was the dearer for it.

Memory of a row: the prior estimate, the drum's rate, and the control steps since the episode began.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from baselines.kalman import KalmanFilter, kalman_filter
from baselines.model import channel_row, sea_filter
from baselines.winch_model import WinchModel, payload_forcing, winch_model
from heave_env.scenarios import Scenario
from heave_env.sea import Array


@dataclass(frozen=True, eq=False)
class Estimator:
    """Estimates of a scenario's whole state, its winch within its limits."""

    filter: KalmanFilter
    """Filter on the linear model."""
    winch: WinchModel
    forcing: Array
    """Path of the drum over a control step to payload heave and rate, (4 n_substeps, 2)."""
    begins_compensated: bool
    """Whether the winch is on its way when an episode begins."""
    boom_tip_rate: Array
    """Row that reads the boom tip's heave rate off the state, (n_states,)."""
    reads_tension: bool = False
    """Whether the sheave's tension is measured, and what the winch's limits are reckoned with."""

    @property
    def n_memory(self) -> int:
        """Numbers remembered from step to step [-]."""
        return self.filter.model.n_states + 2

    @cached_property
    def matrices(self) -> tuple[Array, Array]:
        """Transition and command input without what the winch's path stands for."""
        A, B = self.filter.model.A.copy(), self.filter.model.B.copy()
        A[:3, 2 : 3 + self.winch.n_pending] = 0.0
        B[:3] = 0.0
        if self._rate_place is not None:
            A[:, self._rate_place] = A[self._rate_place] = B[self._rate_place] = 0.0
        return A, B

    @cached_property
    def _rate_place(self) -> int | None:
        """Place of the winch's rate in the state, if the drive is of the second order."""
        states = self.filter.model.states
        return states.index("winch_rate") if "winch_rate" in states else None

    @property
    def measures(self) -> tuple[str, ...]:
        """Entries of the observation that it reads: the filter's, and perhaps the tension."""
        return (*self.filter.model.outputs, *(("sheave_tension",) if self.reads_tension else ()))

    def parted(self, y: Array) -> tuple[Array, Array | None]:
        """The filter's measurements (n_rows, n_outputs), and the tension [N] (n_rows,) or None."""
        return (y[:, :-1], y[:, -1]) if self.reads_tension else (y, None)

    def corrected(self, memory: Array, measurement: Array) -> tuple[Array, Array]:
        """Estimate of the state and the drum's rate after a measurement.

        Args:
            memory: (n_rows, n_memory).
            measurement: In SI units, (n_rows, n_outputs).

        Returns:
            Estimate (n_rows, n_states) and rate [m/s] (n_rows,).
        """
        prior, rate, step = memory[:, :-2], memory[:, -2], memory[:, -1]
        estimate = self.filter.corrected(prior, measurement, step)
        if self.begins_compensated and (step == 0.0).any():
            fastest = self.winch.speed_limit
            moving = np.clip(-(estimate @ self.boom_tip_rate), -fastest, fastest)
            rate = np.where(step == 0.0, moving, rate)
        if self._rate_place is not None:
            estimate[:, self._rate_place] = rate
        return estimate, rate

    def commands(self, estimate: Array, command: Array) -> Array:
        """The command now given and those under way, newest first [m], (n_rows, 1 + n_pending)."""
        return np.column_stack([command, estimate[:, 3 : 3 + self.winch.n_pending]])

    def at_arrival(
        self, estimate: Array, rate: Array, tension: Array | None = None
    ) -> tuple[Array, Array, Array]:
        """Displacement and rate of the drum when the command now given arrives, and its path until then."""
        commands = self.commands(estimate, np.zeros(len(estimate)))
        count = self.winch.n_delayed
        return self.winch.path(estimate[:, 2], rate, commands, first=0, count=count, tension=tension)

    def shaped(self, estimate: Array, rate: Array, command: Array, tension: Array | None = None) -> Array:
        """A command (n_rows, 1) as it is to be sent through dead band and rounding, if there are any."""
        if not self.winch.is_uneven:
            return command
        u, v, _ = self.at_arrival(estimate, rate, tension)
        return self.winch.shaped(u, v, command[:, 0], tension)[:, None]

    def advanced(
        self, memory: Array, estimate: Array, rate: Array, command: Array, tension: Array | None = None
    ) -> Array:
        """Next memory after a command [m], (n_rows, 1), at a tension [N], (n_rows,)."""
        A, B = self.matrices
        u, v, path = self.winch.path(
            estimate[:, 2],
            rate,
            self.commands(estimate, command),
            first=0,
            count=self.winch.n_substeps,
            tension=tension,
        )
        prior = estimate @ A.T + command @ B.T
        prior[:, :2] += path @ self.forcing
        prior[:, 2] = u
        if self._rate_place is not None:
            prior[:, self._rate_place] = v
        return np.column_stack([prior, v, memory[:, -1] + 1.0])


def estimator(scenario: Scenario, *, mismatch: float = 1.0) -> Estimator:
    """Designs the estimator for a scenario's sensors.

    Args:
        scenario: The operation.
        mismatch: How many times the residual of the identification the model of a cable is doubted by.

    Raises:
        ValueError: If the sea is calm or nothing that the model expresses is measured.
    """
    found = kalman_filter(scenario, mismatch=mismatch)
    row = channel_row("boom_tip_heave_rate", list(found.model.states), sea_filter(scenario))
    assert row is not None
    winch = winch_model(scenario)
    return Estimator(
        filter=found,
        winch=winch,
        forcing=payload_forcing(scenario, scenario.n_substeps),
        begins_compensated=scenario.start == "compensated",
        boom_tip_rate=row,
        reads_tension=scenario.winch.power_limit is not None
        and scenario.winch.torque_limit is None
        and "sheave_tension" in scenario.observation_names,
    )
