"""The stochastic-optimal controller with gains that follow the cable's length.

At the nodes of a grid of lengths and rates of pay-out (`baselines.changing_length`) stand the stationary
filter and gain of that model, as `lqg` has them at one length. Between nodes everything is interpolated
linearly: transition, filter gain, feedback gain. The states are physical and the same at every length, so
the estimate is carried on and the command has no jump (bumpless). What pay-out itself does to the payload is
known beforehand and fed forward; the rest of it, δ, is estimated.

The length is the one measured; without a sensor of it, the plan's less the winch's own displacement. The rate
is the plan's. Where no cable is paid out there is nothing to schedule, and the controller is `lqg`.

Each gain is the optimum of a length that stays: the schedule does not know that the length goes on changing
(`baselines.time_varying` does), which matters where it changes much within the seconds that the filter and
the loop remember.

Source: Åström and Wittenmark (1995), chapter 9, gain scheduling; Huang (1992), 6.3.4.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from baselines.changing_length import LengthModels, changes_length, length_models, mixed
from baselines.kalman import KalmanFilter, filter_on, filter_outputs
from baselines.linear_controller import LinearController, without_matrices
from baselines.lqg import lqg
from baselines.lqr import design_weights, sampled_gain
from baselines.model import MODELLED_CHANNELS, LinearModel, channel_row, linear_model, sea_filter
from baselines.winch_model import WinchModel, payload_forcing, winch_model
from heave_env.scenarios import Scenario
from heave_env.sea import Array


@dataclass(frozen=True, eq=False)
class DrumPath:
    """What a limited winch's own path does to the payload, beside a filter that does not know its limits."""

    winch: WinchModel
    forcing: Array
    """Path of the drum over a control step to payload heave and rate, (n_entries, 4 n_substeps, 2)."""
    boom_tip_rate: Array
    """Row that reads the boom tip's heave rate off the state, (n_states,)."""
    begins_compensated: bool
    """Whether the winch is on its way when an episode begins."""
    rate_place: int | None
    """Place of the winch's rate in the state, if the drive is of the second order."""


@dataclass(frozen=True, eq=False)
class ScheduledController(LinearController):
    """Filter and gain from tables; the memory is the prior estimate, the drum's rate and the steps.

    Entries of the tables are the nodes of a grid of lengths and rates (`schedule`), or an episode's steps.
    """

    transition: Array | None = None
    """(n_entries, n_states, n_states); without what the winch does, where it has limits."""
    command_input: Array | None = None
    """(n_entries, n_states, 1); likewise."""
    output: Array | None = None
    """(n_outputs, n_states)."""
    filter_gain: Array | None = None
    """(n_entries, n_states, n_outputs)."""
    feedback: Array | None = None
    """(n_entries, 1, n_states)."""
    known_input: Array | None = None
    """What the pay-out adds to the state in each step of the plan, (n_steps, n_states)."""
    known_command: Array | None = None
    """Command that answers to it [m]: of each step, or at each node per metre of d."""
    start_correction: Array | None = None
    """Filter gain of an episode's first steps less the stationary one, (n_start, n_states, n_outputs)."""
    pay_out_offset: Array | None = None
    """d of each step of the plan [m], (n_steps,)."""
    schedule: LengthModels | None = None
    """The grid; None where the entries are steps."""
    drum: DrumPath | None = None
    """The winch's path where it has limits."""
    speed_weight: float = 0.0
    """Weight of the squared winch rate in the design [s²/m²]."""

    @property
    def n_states(self) -> int:
        """Numbers of the estimate [-]."""
        assert self.output is not None
        return self.output.shape[1]

    @property
    def n_memory(self) -> int:
        """Numbers remembered from step to step [-]."""
        return self.n_states + 2

    def entries(self, y: Array, prior: Array, step: Array) -> tuple[Array, Array]:
        """Entries of the tables that hold for each row, and their weights, (n_rows, n)."""
        if self.schedule is None:
            return step[:, None], np.ones((len(step), 1))
        profile = self.schedule.profile
        measured = self.measures[-1] == "length"
        length = y[:, -1] if measured else profile.length[step] - prior[:, 2]
        return self.schedule.place(length, np.abs(profile.rate[step]))

    def respond(self, y: Array, memory: Array) -> tuple[Array, Array]:
        """Command in metres, (n_envs, 1), and the next memory, for measurements in SI units."""
        assert self.transition is not None and self.command_input is not None and self.output is not None
        assert self.filter_gain is not None and self.feedback is not None
        assert self.known_input is not None and self.known_command is not None
        n = self.n_states
        prior, rate, count = memory[:, :n], memory[:, n], memory[:, n + 1].astype(int)
        step = np.minimum(count, len(self.known_input) - 1)
        where = self.entries(y, prior, step)
        M = mixed(self.filter_gain, *where)
        if self.start_correction is not None:
            M = M + self.start_correction[np.minimum(count, len(self.start_correction) - 1)]
        innovation = y[:, : len(self.output)] - prior @ self.output.T
        estimate = prior + np.einsum("nsy,ny->ns", M, innovation)
        if self.drum is not None:
            rate = self._drum_rate(estimate, rate, count)
        fed = mixed(self.known_command, *where)
        if self.pay_out_offset is not None:
            fed = fed * self.pay_out_offset[step]
        gain = mixed(self.feedback, *where)
        command = self.clipped(-np.einsum("nis,ns->ni", gain, estimate) - fed[:, None])
        following = np.einsum("nij,nj->ni", mixed(self.transition, *where), estimate)
        following += mixed(self.command_input, *where)[:, :, 0] * command + self.known_input[step]
        if self.drum is not None:
            following, rate = self._on_the_drum(following, estimate, rate, command, where)
        return command, np.column_stack([following, rate, count + 1.0])

    def _drum_rate(self, estimate: Array, rate: Array, count: Array) -> Array:
        """The drum's rate at this instant [m/s], (n_rows,), which the estimate is told too."""
        drum = self.drum
        assert drum is not None
        if drum.begins_compensated:
            fastest = drum.winch.speed_limit
            moving = np.clip(-(estimate @ drum.boom_tip_rate), -fastest, fastest)
            rate = np.where(count == 0, moving, rate)
        if drum.rate_place is not None:
            estimate[:, drum.rate_place] = rate
        return rate

    def _on_the_drum(
        self,
        following: Array,
        estimate: Array,
        rate: Array,
        command: Array,
        where: tuple[Array, Array],
    ) -> tuple[Array, Array]:
        """The next prior and the drum's rate with the path that the winch takes within its limits."""
        drum = self.drum
        assert drum is not None
        commands = np.column_stack([command, estimate[:, 3 : 3 + drum.winch.n_pending]])
        u, rate, path = drum.winch.path(estimate[:, 2], rate, commands, first=0, count=drum.winch.n_substeps)
        following[:, :2] += np.einsum("np,npi->ni", path, mixed(drum.forcing, *where))
        following[:, 2] = u
        if drum.rate_place is not None:
            following[:, drum.rate_place] = rate
        return following, rate


def gain_scheduled(
    scenario: Scenario,
    *,
    command_weight: float | None = None,
    speed_weight: float = 0.0,
    mismatch: float = 1.0,
) -> LinearController:
    """Designs the controller whose gains follow the cable's length.

    Args:
        scenario: The operation; without pay-out the answer is `lqg`'s.
        command_weight: r of the design [1/m²]; the task's own if not given.
        speed_weight: Weight of the squared winch rate in the design [s²/m²]: caution where limits bite.
        mismatch: How many times the residual of the identification the models are doubted by.

    Raises:
        ValueError: If the sea is calm, or nothing that the model expresses is measured.
    """
    if not changes_length(scenario):
        same = lqg(scenario, command_weight=command_weight, speed_weight=speed_weight, mismatch=mismatch)
        return replace(same, name="gain_scheduled")
    q, r = design_weights(scenario, command_weight)
    speed = require_speed_weight(speed_weight) / scenario.control_dt**2
    outputs = require_outputs(scenario)
    grid = length_models(scenario)
    filters = [
        filter_on(scenario, replace(model, W=model.W + mismatch**2 * doubt).select(outputs))
        for model, doubt in zip(grid.models, grid.doubts, strict=True)
    ]
    models = [found.model for found in filters]
    gains = np.array([sampled_gain(model.A, model.B, q, r, speed_weight=speed)[0] for model in models])
    A = np.array([model.A for model in models])
    nodes, weights = grid.along_profile
    push = np.zeros((len(models), models[0].n_states))
    push[:, :2] = grid.push
    return scheduled_controller(
        "gain_scheduled",
        scenario,
        models[0],
        A=A,
        B=np.array([model.B for model in models]),
        M=np.array([found.gain for found in filters]),
        K=gains,
        known_input=mixed(push, nodes, weights) * grid.offset[:, None],
        known_command=gains[:, 0, -1],
        forcing=drum_forcing(scenario, grid) if scenario.winch.is_limited else None,
        start_correction=start_correction(filters[0]),
        offset=grid.offset,
        schedule=grid,
        command_weight=r,
        speed_weight=speed_weight,
    )


def require_speed_weight(speed_weight: float) -> float:
    """The weight of the winch's speed, checked.

    Raises:
        ValueError: If it is no number, or negative.
    """
    if not (np.isfinite(speed_weight) and speed_weight >= 0.0):
        raise ValueError(f"speed_weight must be a number, not negative, got {speed_weight!r}")
    return speed_weight


def require_outputs(scenario: Scenario) -> tuple[str, ...]:
    """Entries of the observation that a filter corrects by.

    Raises:
        ValueError: If there are none, or the sea is calm.
    """
    outputs = filter_outputs(scenario)
    if not outputs:
        raise ValueError(
            f"scenario {scenario.name!r} measures nothing that a linear filter can use; add a sensor of "
            f"{', '.join(MODELLED_CHANNELS)}"
        )
    if sea_filter(scenario) is None:
        linear_model(scenario)  # which says so
    return outputs


def start_correction(found: KalmanFilter) -> Array:
    """What the filter's gain has to begin with beyond the stationary one, down to zero."""
    return np.concatenate([found.start_gains - found.gain, np.zeros((1, *found.gain.shape))])


def drum_forcing(scenario: Scenario, grid: LengthModels) -> Array:
    """What the drum's path over a step does to the payload at each node, (n_nodes, 4 n_substeps, 2)."""
    return np.array([payload_forcing(scenario, scenario.n_substeps, fit.payload) for fit in grid.fits])


def scheduled_controller(
    name: str,
    scenario: Scenario,
    model: LinearModel,
    *,
    A: Array,
    B: Array,
    M: Array,
    K: Array,
    known_input: Array,
    known_command: Array,
    forcing: Array | None,
    start_correction: Array | None = None,
    offset: Array | None = None,
    schedule: LengthModels | None = None,
    command_weight: float,
    speed_weight: float,
) -> ScheduledController:
    """Puts a controller of tables together; one of `model`'s states, seen through the filter's outputs."""
    measures = model.outputs
    if schedule is not None and "length" in scenario.observation_names:
        measures = (*measures, "length")
    drum = None
    if forcing is not None:
        row = channel_row("boom_tip_heave_rate", list(model.states), sea_filter(scenario))
        assert row is not None
        winch = winch_model(scenario)
        at = model.index("winch_rate") if "winch_rate" in model.states else None
        drum = DrumPath(winch, forcing, row, scenario.start == "compensated", at)
        # The path of the drum stands for what winch and commands do to the payload.
        A, B = A.copy(), B.copy()
        A[:, :3, 2 : 3 + winch.n_pending] = 0.0
        B[:, :3] = 0.0
        if at is not None:
            A[:, :, at] = A[:, at] = B[:, at] = 0.0
    return ScheduledController(
        **without_matrices(name, scenario, measures),
        command_weight=command_weight,
        states=model.states,
        gain=K[0],
        transition=A,
        command_input=B,
        output=model.C,
        filter_gain=M,
        feedback=K,
        known_input=known_input,
        known_command=known_command,
        start_correction=start_correction,
        pay_out_offset=offset,
        schedule=schedule,
        drum=drum,
        speed_weight=speed_weight,
    )
