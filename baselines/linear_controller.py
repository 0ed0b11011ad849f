"""The form that every designed controller here takes, and what theory says of it in closed loop.

    u0_k = clip(-(L m_k + D y_k)),   m_{k+1} = F m_k + G y_k + H u0_k

with memory m, measurements y in SI units and u0 in metres; the memory is told the command as clipped, so
that saturation does not wind it up. A static gain has no memory; LQG's is its prior estimate.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from baselines.model import LinearModel, plant_is_model
from heave_env.scenarios import Scenario
from heave_env.sea import Array


@dataclass(frozen=True)
class Performance:
    """Stationary averages of a controller on the linear model, without limits or clipping."""

    cost: float
    """J = E[q x_{k+1}² + r u0_k²] [-]; infinite when the loop is unstable."""
    payload_heave_std: float
    """Standard deviation of the payload at the control instants [m]."""
    payload_heave_rate_std: float
    """Likewise of its rate [m/s]."""
    command_std: float
    """Standard deviation of the command u0 [m]."""
    spectral_radius: float
    """Largest modulus of the closed loop's eigenvalues [-]; one or more is unstable."""


@dataclass(frozen=True, eq=False)
class LinearController:
    """A linear controller with memory; satisfies `heave_env.controller.Controller`."""

    name: str
    measures: tuple[str, ...]
    """Observation entries that it uses, in the order of y."""
    observation_names: tuple[str, ...]
    """Every entry of the observation that it is given."""
    scale: Array
    """Size of one unit of each used entry [its unit], (n_y,)."""
    offset: Array
    """Value of a zero entry [its unit], (n_y,)."""
    command_range: float
    """Command that an action of one means [m]."""
    F: Array
    G: Array
    H: Array
    L: Array
    D: Array
    energy_index: float | None = None
    """sqrt(Σ G²) of the design's gain, in the thesis's coordinates [-]."""
    gain: Array | None = None
    """The design's feedback gain on its model's states, u0 = -gain s, (1, n_states)."""
    states: tuple[str, ...] = ()
    """Names of the states that `gain` acts on."""
    performance: Performance | None = None
    """What theory predicts on the scenario's linear model; None where the sea is calm."""
    command_weight: float | None = None
    """r that the gain was designed with [1/m²]: the task's own, or a larger one (`baselines.tuning`)."""

    model_is_plant: bool = True
    """Whether the linear model is the plant (`baselines.model.plant_is_model`)."""
    cost_is_quadratic: bool = True
    """Whether the task puts no price on the winch's work, |T v|."""

    @property
    def predicted_cost(self) -> float | None:
        """J by theory [-]; None where the model is not the plant, the sea is calm or work has a price."""
        if self.performance is None or not self.model_is_plant or not self.cost_is_quadratic:
            return None
        return self.performance.cost

    @property
    def predicted_payload_std(self) -> float | None:
        """Standard deviation of the payload by theory [m]; None likewise."""
        if self.performance is None or not self.model_is_plant:
            return None
        return self.performance.payload_heave_std

    @property
    def n_memory(self) -> int:
        """Numbers remembered from step to step [-]."""
        return len(self.F)

    @cached_property
    def columns(self) -> Array:
        """Places of the used entries in the observation, (n_y,)."""
        return np.array([self.observation_names.index(name) for name in self.measures], dtype=int)

    def predict(
        self,
        observation: Array,
        state: Any | None = None,
        episode_start: Array | None = None,
        deterministic: bool = True,
    ) -> tuple[Array, Any | None]:
        """Actions in [-1, 1] and the memory, in Stable-Baselines3's signature.

        Args:
            observation: (n_envs, n_observations), or (n_observations,) of a single environment.
            state: Memory as last returned, (n_envs, n_memory); None begins afresh.
            episode_start: Rows that begin afresh, (n_envs,).
            deterministic: Without effect.

        Returns:
            Actions (n_envs, 1) or (1,), float32, and the memory, None if the controller has none.

        Raises:
            ValueError: If the observation does not have the length of the scenario's.
        """
        observation = np.asarray(observation)
        if observation.shape[-1] != len(self.observation_names):
            raise ValueError(
                f"controller {self.name!r} expects observations of {len(self.observation_names)} entries, "
                f"got {observation.shape[-1]}; design it for the scenario that it drives"
            )
        y = np.atleast_2d(observation)[:, self.columns].astype(float) * self.scale + self.offset
        memory = np.zeros((len(y), self.n_memory)) if state is None else np.asarray(state, dtype=float)
        if episode_start is not None:
            memory = np.where(np.asarray(episode_start, dtype=bool).reshape(-1, 1), 0.0, memory)
        command, memory = self.respond(y, memory)
        action = (command / self.command_range).astype(np.float32)
        return (action[0] if observation.ndim == 1 else action), (memory if self.n_memory else None)

    def respond(self, y: Array, memory: Array) -> tuple[Array, Array]:
        """Command in metres, (n_envs, 1), and the next memory, for measurements in SI units."""
        command = self.clipped(-(memory @ self.L.T + y @ self.D.T))
        return command, memory @ self.F.T + y @ self.G.T + command @ self.H.T

    def clipped(self, command: Array) -> Array:
        """The command within the range that the winch is given [m]."""
        return np.clip(command, -self.command_range, self.command_range)


def controller(
    name: str,
    scenario: Scenario,
    measures: tuple[str, ...],
    *,
    D: Array,
    F: Array | None = None,
    G: Array | None = None,
    H: Array | None = None,
    L: Array | None = None,
    gain: Array | None = None,
    states: tuple[str, ...] = (),
    energy_index: float | None = None,
    truth: LinearModel | None,
    command_weight: float | None = None,
) -> LinearController:
    """Puts a linear controller together for a scenario and adds what theory predicts of it.

    Args:
        name: How reports call it.
        scenario: The operation, whose observation it will read.
        measures: Entries of the observation that make y.
        D, F, G, H, L: Matrices of the controller; without memory D alone.
        gain: The design's feedback gain, (1, n_states), if it has one.
        states: Names of the states the gain acts on.
        energy_index: sqrt(Σ G²), likewise.
        truth: Linear model of the scenario to predict the performance on; None predicts nothing.
        command_weight: r of the design [1/m²], if it has one.
    """
    n_y = len(measures)
    F = np.zeros((0, 0)) if F is None else F
    G = np.zeros((0, n_y)) if G is None else G
    H = np.zeros((0, 1)) if H is None else H
    L = np.zeros((1, 0)) if L is None else L
    performance = None
    if truth is not None:
        performance = closed_loop(truth.select(measures), scenario, F=F, G=G, H=H, L=L, D=D)
    scale, offset = observation_units(scenario, measures)
    return LinearController(
        name=name,
        measures=measures,
        observation_names=scenario.observation_names,
        scale=scale,
        offset=offset,
        command_range=scenario.winch.command_range,
        F=F,
        G=G,
        H=H,
        L=L,
        D=D,
        energy_index=energy_index,
        gain=gain,
        states=states,
        performance=performance,
        command_weight=command_weight,
        model_is_plant=plant_is_model(scenario),
        cost_is_quadratic=scenario.task.energy_weight == 0.0,
    )


def without_matrices(name: str, scenario: Scenario, measures: tuple[str, ...]) -> dict[str, Any]:
    """What a controller needs that reads its measurements as these do and then goes its own way.

    Its matrices are empty, and it claims no optimum.
    """
    scale, offset = observation_units(scenario, measures)
    return {
        "name": name,
        "measures": measures,
        "observation_names": scenario.observation_names,
        "scale": scale,
        "offset": offset,
        "command_range": scenario.winch.command_range,
        "model_is_plant": False,
        **{matrix: np.zeros((0, 0)) for matrix in "FGHLD"},
    }


def observation_units(scenario: Scenario, entries: tuple[str, ...]) -> tuple[Array, Array]:
    """Scale and offset that take observation entries back to SI units, both (n_entries,)."""
    sensors = {sensor.channel: sensor for sensor in scenario.observed_sensors}
    scale, offset = [], []
    for entry in entries:
        if entry in sensors:
            scale.append(sensors[entry].scale)
            offset.append(sensors[entry].offset)
        else:
            pending = entry.startswith("pending_command")
            scale.append(scenario.winch.command_range if pending else 1.0)
            offset.append(0.0)
    return np.array(scale, dtype=float), np.array(offset, dtype=float)


def closed_loop(
    model: LinearModel, scenario: Scenario, *, F: Array, G: Array, H: Array, L: Array, D: Array
) -> Performance:
    """Stationary performance of a linear controller on a linear model whose outputs are its y.

    With z = [s, m], z_{k+1} = Φ z_k + noise, the covariance solves the discrete Lyapunov equation; x_{k+1}
    has the variance of x_k, so that J = q E[x²] + r E[u0²].
    """
    A, B, C = model.A, model.B, model.C
    transition = np.block([[A - B @ D @ C, -B @ L], [(G - H @ D) @ C, F - H @ L]])
    radius = float(np.max(np.abs(np.linalg.eigvals(transition))))
    if radius >= 1.0:
        return Performance(np.inf, np.inf, np.inf, np.inf, radius)
    error = np.vstack([-B @ D, G - H @ D])
    noise = error @ model.V @ error.T
    noise[: len(A), : len(A)] += model.W
    P = solve_discrete_lyapunov(transition, noise)
    command = np.hstack([-D @ C, -L])
    x, v = model.index("payload_heave"), model.index("payload_heave_rate")
    command_variance = (command @ P @ command.T + D @ model.V @ D.T).item()
    q, r = scenario.task.position_weight, scenario.task.command_weight
    return Performance(
        cost=float(q * P[x, x] + r * command_variance),
        payload_heave_std=float(np.sqrt(max(P[x, x], 0.0))),
        payload_heave_rate_std=float(np.sqrt(max(P[v, v], 0.0))),
        command_std=float(np.sqrt(max(command_variance, 0.0))),
        spectral_radius=radius,
    )
