"""`Plant` on a device: the same rows in arrays of the device, advanced by the kernels of `gpu.kernel`.

The scenario is laid out by `heave_env.plant.Plant`, of which a single row is kept as the source of all
parameters and draws; states go over from one to the other unchanged.
"""

from __future__ import annotations

from math import lcm
from typing import Any

import numpy as np

from heave_env import kernel as k
from heave_env import layout as rows
from heave_env.gpu import kernel as device_kernel
from heave_env.gpu.kernel import DRIVEN, FREE, LIMITED, Form
from heave_env.plant import Plant, cubic_coefficients, sea_table, sensor_table
from heave_env.scenarios import Scenario

Array = np.ndarray


def refuse_unsupported(scenario: Scenario) -> None:
    """Refuses a scenario that the kernels do not know.

    Raises:
        ValueError: Naming the key, and where it can run.
    """
    plain = all(sensor.is_plain for sensor in scenario.observed_sensors)
    odd = (
        ("compensator", scenario.compensator is not None, "null"),
        ("cable", not scenario.is_hookean, "a cable that follows Hooke's law (hardening and relaxing 0)"),
        ("sea_state.kind", scenario.sea_state.kind == "recorded", "no recording"),
        ("sensors", not plain, "sensors with noise, scale and delay alone"),
    )
    for key, refused, wanted in odd:
        if refused:
            raise ValueError(
                f"Scenario.{key} must be {wanted} on a GPU, unlike that of scenario {scenario.name!r}; "
                "run it with HeaveVectorEnv"
            )


def form_of(scenario: Scenario, dtype: str) -> Form:
    """What of a scenario is fixed when its kernels are compiled.

    Raises:
        ValueError: If the kernels do not know something in it.
    """
    refuse_unsupported(scenario)
    winch = scenario.winch
    kinds = {"calm": k.CALM, "shaping_filter": k.FILTERED}
    driven = winch.is_driven or winch.is_second_order
    return Form(
        dtype=dtype,
        sea=kinds.get(scenario.sea_state.kind, k.SINUSOIDS),
        n_filter=scenario.n_filter_states,
        is_linear=scenario.is_linear,
        tension_only=scenario.cable is not None and scenario.cable.tension_only,
        winch=DRIVEN if driven else LIMITED if winch.is_limited else FREE,
        second_order=winch.is_second_order,
        accelerates_at_once=winch.acceleration_limit is None and winch.torque_limit is None,
        pays_out=scenario.pay_out.speed != 0.0,
        begins_compensated=scenario.start == "compensated",
        delay_varies=any(draw.parameter == "winch.command_delay" for draw in scenario.uncertainty),
        charges_energy=scenario.task.energy_weight > 0.0,
    )


class GpuPlant:
    """A batch of plants of one scenario on a device of NVIDIA Warp.

    After `begin` and every `advance` the arrays of `buffers` hold the present instant, the environment
    their last axis; see `gpu.kernel.structures` for their names. Nothing waits for the device but what
    returns NumPy arrays, and `begin_finished` of a scenario with `uncertainty`.
    """

    def __init__(
        self,
        scenario: Scenario,
        n_envs: int,
        *,
        device: str = "cuda",
        dtype: str = "float32",
        n_steps: int | None = None,
        keep_final_channels: bool = False,
    ) -> None:
        """Lays the scenario out on the device.

        Args:
            scenario: The operation.
            n_envs: Environments in the batch.
            device: "cuda", "cuda:1" and so on, or "cpu".
            dtype: Precision of the physics, "float32" or "float64".
            n_steps: Control steps of an episode; the scenario's own if not given.
            keep_final_channels: Whether rows that finish leave their last channels behind.

        Raises:
            ValueError: If an argument is impossible, or the kernels do not know something in the scenario.
            ModuleNotFoundError: If NVIDIA Warp is not installed.
        """
        self.host = Plant(scenario, 1, dtype=dtype, n_steps=n_steps)
        """A single row on the processor, which knows every parameter and draws new ones."""
        if not isinstance(n_envs, (int, np.integer)) or n_envs < 1:
            raise ValueError(f"num_envs must be a positive whole number, got {n_envs!r}")
        self.form = form_of(scenario, dtype)
        self.scenario, self.n_envs, self.dtype = scenario, int(n_envs), dtype
        self.n_steps = self.host.n_steps
        wp = self._warp = device_kernel.warp()
        known = {str(one) for one in wp.get_devices()} | ({"cuda"} if wp.is_cuda_available() else set())
        if str(device) not in known:
            raise ValueError(f"device must be one of {', '.join(sorted(known))} here, got {device!r}")
        self.device = wp.get_device(str(device))
        self._kernels = device_kernel.kernels(self.form)
        self._lay_out(keep_final_channels)
        self._graph: Any = None

    def _lay_out(self, keep_final_channels: bool) -> None:
        scenario, n, cfg = self.scenario, self.n_envs, self.host._cfg
        wp, real, numbers = self._warp, np.dtype(self.dtype), self._kernels.Numbers()
        lags, sensors = scenario.observed_lags, scenario.observed_sensors
        ages = [round(sensor.delay / scenario.control_dt) for sensor in sensors]
        numbers.control_dt = scenario.control_dt
        numbers.dt = scenario.solver_dt
        numbers.n_substeps = scenario.n_substeps
        numbers.n_iterations = scenario.n_iterations
        numbers.n_elements = scenario.n_elements
        numbers.n_components = int(cfg[k.N_COMPONENTS])
        numbers.n_steps = self.n_steps
        numbers.n_sensors = len(sensors)
        numbers.n_lags = len(lags)
        numbers.n_samples = max(lags) + max(ages) + 1
        numbers.n_commands = int(cfg[k.N_PENDING]) + 1
        numbers.n_shown_pending = scenario.n_shown_pending
        numbers.n_positions = lcm(numbers.n_samples, numbers.n_commands)
        numbers.delay = scenario.delay_substeps
        numbers.n_shown_filter = scenario.observed_filter_states
        numbers.n_shown_draws = len(scenario.observed_draws)
        numbers.keeps_final_channels = int(keep_final_channels)
        self.numbers = numbers
        self._varies = bool(scenario.uncertainty)
        column = self._host_column()
        width = n if self._varies else 1
        sea_type = np.float64 if self.form.sea == k.SINUSOIDS else real
        n_nodes = 0 if scenario.is_linear else scenario.n_elements + 1
        n_increments = n_nodes if scenario.n_iterations > 1 else 0
        n_observations = len(scenario.observation_names)
        n_final = rows.N_CHANNELS if keep_final_channels else 0
        sea = sea_table(scenario)
        readings = sensor_table(scenario, scenario)
        buffers = self._kernels.Buffers()
        b: dict[str, Any] = {
            "fixed": np.repeat(column[: rows.N_FIXED, None], width, axis=1).astype(real),
            "sea": np.repeat(sea[:, None], width, axis=1).astype(sea_type),
            "readings": np.repeat(readings[:, None], width, axis=1).astype(real),
            "cubic": cubic_coefficients(scenario.n_substeps, scenario.control_dt).ravel().astype(real),
            "measured": np.array([rows.CHANNEL_NAMES.index(s.channel) for s in sensors], dtype=np.int32),
            "ages": np.array(ages, dtype=np.int32),
            "lags": np.array(lags, dtype=np.int32),
            "counters": np.zeros((k.N_COUNTERS, n), dtype=np.uint64),
            "clock": np.zeros(n, dtype=np.int32),
            "outcome": np.zeros(n, dtype=np.int32),
            "observation": np.zeros((n_observations, n), dtype=np.float32),
            "final_observation": np.zeros((n_observations, n), dtype=np.float32),
            "reward": np.zeros(n, dtype=real),
        }
        for name, count in (
            ("channels", rows.N_CHANNELS),
            ("filter", scenario.n_filter_states),
            ("components", 2 * numbers.n_components),
            ("draws", len(scenario.uncertainty)),
            ("commands", numbers.n_commands),
            ("samples", numbers.n_samples * numbers.n_sensors),
            ("displacement", n_nodes),
            ("velocity", n_nodes),
            ("upper", n_nodes),
            ("load", n_nodes),
            ("increment", n_increments),
            ("final_channels", n_final),
        ):
            b[name] = np.zeros((count, n), dtype=real)
        for name in ("terminated", "truncated", "finished"):
            b[name] = np.zeros(n, dtype=np.bool_)
        for name, value in b.items():
            setattr(buffers, name, wp.array(value, device=self.device))
        self.buffers = buffers
        self._mask = wp.zeros(n, dtype=wp.bool, device=self.device)
        self._state_rows = [
            ("filter", int(cfg[k.ROW_FILTER])),
            ("components", int(cfg[k.ROW_COMPONENTS])),
            ("commands", int(cfg[k.ROW_COMMANDS])),
            ("samples", int(cfg[k.ROW_SENSORS])),
            ("draws", int(cfg[k.ROW_DRAWS])),
        ]
        nodes = int(cfg[k.ROW_NODES]) + rows.N_NODE_FIELDS * np.arange(n_nodes)
        self._node_rows = (("displacement", nodes + rows.DISPLACEMENT), ("velocity", nodes + rows.VELOCITY))

    # Episodes and steps --------------------------------------------------------------------------

    def begin(self, mask: Any, seeds: Array | None = None) -> None:
        """Begins a new episode in the masked rows.

        Args:
            mask: Rows to begin anew, (n_envs,), bool: a NumPy array or an array of the device.
            seeds: New seeds, (n_envs,), of which the masked are taken and their episodes counted from 0;
                without them the rows go on to the next episode of their seeds.
        """
        if isinstance(mask, np.ndarray):
            self._mask.assign(mask)
            mask = self._mask
        if seeds is not None:
            chosen = mask.numpy()
            counters = self.buffers.counters.numpy().copy()
            counters[k.SEED, chosen] = np.asarray(seeds, dtype=np.uint64)[chosen]
            counters[k.EPISODE, chosen] = 0
            self.buffers.counters.assign(counters)
        episodes = 1 if seeds is None else 0
        if self._varies:
            self._draw(mask.numpy(), episodes)
        self._launch(self._kernels.begin, mask, episodes)

    def advance(self, actions: Any) -> None:
        """Advances every row by one control step under actions in [-1, 1], a float32 array (n_envs,) of the
        device. A number that is none makes its row diverge."""
        self._launch(self._kernels.advance, actions)

    def _launch(self, kernel: Any, *arguments: Any) -> None:
        self._warp.launch(
            kernel,
            self.n_envs,
            [self.buffers, self.numbers, *arguments],
            device=self.device,
            block_dim=device_kernel.BLOCK,
        )

    def begin_finished(self) -> None:
        """Begins the next episode of the rows that finished in the last step, without waiting for the device
        unless they draw parameters of their own."""
        if not self._varies or self.buffers.finished.numpy().any():
            self.begin(self.buffers.finished)

    def captured(self, actions: Any) -> Any:
        """A step under an array of actions, and the rows begun anew, as a CUDA graph to be launched; None
        where there is no CUDA, and where rows draw parameters, which is the host's affair."""
        if not self.device.is_cuda or self._varies:
            return None
        wp = self._warp
        # Both kernels are in one module, which must be there before a graph is recorded.
        wp.load_module(self._kernels.advance.module, device=self.device, block_dim=device_kernel.BLOCK)
        with wp.ScopedCapture(device=self.device) as capture:
            self.advance(actions)
            self.begin_finished()
        return capture.graph

    # Draws of an episode -------------------------------------------------------------------------

    def _host_column(self) -> Array:
        """The rows of the host's only environment, (n_rows,)."""
        return np.asarray(self.host.get_state()["state"][0, :, 0])

    def _own(self, column: Array, key: int, count: int) -> Array:
        first = int(self.host._cfg[key])
        return column[first : first + count]

    def _draw(self, mask: Array, episodes: int) -> None:
        """Lets the host draw the masked rows' parameters and lays them out on the device."""
        b, cfg, scenario = self.buffers, self.host._cfg, self.scenario
        counters = b.counters.numpy()
        fixed, readings, draws, sea = (
            array.numpy().copy() for array in (b.fixed, b.readings, b.draws, b.sea)
        )
        for row in np.nonzero(mask)[0]:
            state = self.host.get_state()
            state["counters"][0, k.SEED, 0] = counters[k.SEED, row]
            episode = int(counters[k.EPISODE, row]) + episodes
            state["counters"][0, k.EPISODE, 0] = np.uint64((episode - 1) % 2**64)
            self.host.set_state(state)
            self.host.begin(np.ones(1, dtype=bool))
            column = self._host_column()
            fixed[:, row] = column[: rows.N_FIXED]
            draws[:, row] = self._own(column, k.ROW_DRAWS, len(scenario.uncertainty))
            if cfg[k.SEA_VARIES]:
                sea[:, row] = self._own(column, k.ROW_SEA, len(sea))
            if cfg[k.SENSORS_VARY]:
                readings[:, row] = self._own(column, k.ROW_SENSOR_TABLE, len(readings))
        for array, values in ((b.fixed, fixed), (b.readings, readings), (b.draws, draws), (b.sea, sea)):
            array.assign(values)

    # To and from NumPy ---------------------------------------------------------------------------

    def numpy(self, name: str) -> Array:
        """A copy of one of the buffers; waits for the device."""
        return np.array(getattr(self.buffers, name).numpy())

    def channel(self, name: str) -> Array:
        """A copy of one physical channel, (n_envs,); waits for the device."""
        return self.numpy("channels")[rows.CHANNEL_NAMES.index(name)].astype(np.float64)

    def steps(self) -> Array:
        """Control steps that each row has made in its episode, (n_envs,)."""
        return self.numpy("counters")[k.STEP].astype(np.int64)

    def take_from(self, plant: Plant) -> None:
        """Takes over the state of a plant on the processor, of the same scenario, batch and precision.

        Raises:
            ValueError: If the other is of another scenario, batch or precision.
        """
        self._check_kin(plant)
        state = plant.get_state()
        table = _by_rows(state["state"])[:, : self.n_envs]
        b = self.buffers
        b.channels.assign(np.ascontiguousarray(table[: rows.N_CHANNELS]))
        b.counters.assign(np.ascontiguousarray(_by_rows(state["counters"])[:, : self.n_envs]))
        b.clock.fill_(int(state["position"]) % self.numbers.n_positions)
        b.observation.assign(np.ascontiguousarray(state["observation"].T))
        for name, first in self._state_rows:
            array = getattr(b, name)
            if array.size:
                array.assign(np.ascontiguousarray(table[first : first + array.shape[0]]))
        for name, where in self._node_rows:
            if len(where):
                getattr(b, name).assign(np.ascontiguousarray(table[where]))
        if self._varies:
            cfg = self.host._cfg
            b.fixed.assign(np.ascontiguousarray(table[: rows.N_FIXED]))
            for name, key, varies in (
                ("sea", k.ROW_SEA, k.SEA_VARIES),
                ("readings", k.ROW_SENSOR_TABLE, k.SENSORS_VARY),
            ):
                array, first = getattr(b, name), int(cfg[key])
                if cfg[varies]:
                    part = table[first : first + array.shape[0]]
                    array.assign(np.ascontiguousarray(part.astype(array.numpy().dtype)))

    def give_to(self, plant: Plant) -> None:
        """Puts this state into a plant on the processor, of the same scenario, batch and precision.

        What the processor's kernel only leaves for pictures (the elements' tensions) is not put there.

        Raises:
            ValueError: If the other is of another scenario, batch or precision.
        """
        self._check_kin(plant)
        state = plant.get_state()
        table = _by_rows(state["state"])
        n = self.n_envs
        parts = [("channels", np.arange(rows.N_CHANNELS))]
        for name, first in self._state_rows:
            parts.append((name, np.arange(first, first + getattr(self.buffers, name).shape[0])))
        if self._varies:
            cfg = self.host._cfg
            parts.append(("fixed", np.arange(rows.N_CHANNELS, rows.N_FIXED)))
            for name, key, varies in (
                ("sea", k.ROW_SEA, k.SEA_VARIES),
                ("readings", k.ROW_SENSOR_TABLE, k.SENSORS_VARY),
            ):
                if cfg[varies]:
                    parts.append((name, int(cfg[key]) + np.arange(getattr(self.buffers, name).shape[0])))
        for name, where in (*parts, *self._node_rows):
            values = self.numpy(name)
            table[where, :n] = values[where] if name == "fixed" else values
        counters = _by_rows(state["counters"])
        counters[:, :n] = self.numpy("counters")
        state["state"] = _by_blocks(table, state["state"])
        state["counters"] = _by_blocks(counters, state["counters"])
        state["position"] = np.array(int(self.numpy("clock")[0]))
        state["observation"] = np.ascontiguousarray(self.numpy("observation").T)
        plant.set_state(state)

    def _check_kin(self, plant: Plant) -> None:
        mine = (self.scenario.fingerprint, self.n_envs, self.dtype)
        theirs = (plant.scenario.fingerprint, plant.n_envs, plant.dtype)
        for what, one, other in zip(("scenario", "batch", "dtype"), mine, theirs, strict=True):
            if one != other:
                raise ValueError(
                    f"the plant's {what} is {other!r}, this one's {one!r}: build both from the same arguments"
                )


def _by_rows(blocks: Array) -> Array:
    """(n_blocks, n_rows, n_lanes) as (n_rows, n_blocks · n_lanes)."""
    return np.ascontiguousarray(blocks.transpose(1, 0, 2).reshape(blocks.shape[1], -1))


def _by_blocks(table: Array, like: Array) -> Array:
    """The inverse of `_by_rows`, in the shape of `like`."""
    n_blocks, n_rows, n_lanes = like.shape
    return np.ascontiguousarray(table.reshape(n_rows, n_blocks, n_lanes).transpose(1, 0, 2))
