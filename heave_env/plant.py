"""The plant's face: a batch of environments with their seeds, advanced by the one kernel.

`Plant` owns the buffers, lays the scenario out in them and calls the compiled kernel; the Gymnasium
faces, `simulate` and the tests all stand on it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numba import types
from scipy.linalg import expm

from heave_env import kernel as k
from heave_env import layout as rows
from heave_env.cable.axial import fill_parameters, fill_work, n_cable_rows, n_work_rows
from heave_env.compiled import address_of, announce_compilation, entry_point
from heave_env.lanes import aligned_zeros
from heave_env.marching import LOOPS
from heave_env.parameters import LinearPayload, Winch
from heave_env.pool import Pool
from heave_env.rollouts import rollout
from heave_env.scenarios import Scenario
from heave_env.sea import read_motion, square_root
from heave_env.sensors import COMPENSATOR_CHANNELS, HIGH_PASS_DAMPING, Sensor
from heave_env.streams import PARAMETERS, uniform_number
from heave_env.vessel import boom_tip_components, boom_tip_filter
from heave_env.workers import Workers

Array = np.ndarray

_SEA_KINDS = {
    "calm": k.CALM,
    "shaping_filter": k.FILTERED,
    "random_phase": k.SINUSOIDS,
    "regular": k.SINUSOIDS,
    "recorded": k.RECORDED,
}
DTYPES = ("float64", "float32")
for (_dtype, _n_lanes), _kernel in k.KERNELS.items():
    _of = "one environment" if _n_lanes == 1 else "a batch"
    announce_compilation(_kernel, f"the plant's kernel for {_of} in {_dtype} (about 25 s)")


def cubic_coefficients(n_substeps: int, control_dt: float) -> Array:
    """Weights of heave and rate at both ends of a control step in the cubic through them.

    Returns:
        (n_substeps, 8): at the end of each substep the four weights of the value and the four of its
        rate, for [x0, v0, x1, v1].
    """
    s = np.arange(1, n_substeps + 1) / n_substeps
    T = control_dt
    value = np.stack([1 - 3 * s**2 + 2 * s**3, T * s * (1 - s) ** 2, s**2 * (3 - 2 * s), T * s**2 * (s - 1)])
    rate = np.stack([-6 * s * (1 - s) / T, (1 - s) * (1 - 3 * s), 6 * s * (1 - s) / T, s * (3 * s - 2)])
    weights = np.concatenate([value, rate]).T
    # The last substep ends at the control instant itself, to the last bit.
    weights[-1] = 0, 0, 1, 0, 0, 0, 0, 1
    return np.ascontiguousarray(weights)


def linear_step(payload: LinearPayload, dt: float) -> tuple[Array, Array]:
    """Exact step of a x'' + b x' + x = z(t) for a cubic z through its values and rates at both ends.

    Returns:
        Transition (2, 2) of [x, x'] and input (2, 4) of [z0, z0', z1, z1'].
    """
    a, b = payload.inertia, payload.damping
    chain = np.zeros((6, 6))
    chain[0, 1] = 1.0
    chain[1, :3] = -1.0 / a, -b / a, 1.0 / a
    chain[2, 3] = chain[3, 4] = chain[4, 5] = 1.0
    over_step = expm(chain * dt)[:2]
    # z, z', z'', z''' at the start of the step from its values and rates at both ends.
    derivatives = np.array(
        [
            [1.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0],
            [-6.0 / dt**2, -4.0 / dt, 6.0 / dt**2, -2.0 / dt],
            [12.0 / dt**3, 6.0 / dt**2, -12.0 / dt**3, 6.0 / dt**2],
        ]
    )
    return over_step[:, :2], over_step[:, 2:] @ derivatives


def drive_step(winch: Winch, dt: float) -> Array:
    """Exact step of a second-order drive: [u - u0, u'] at the end from the same at the start, (2, 2)."""
    assert winch.natural_omega is not None
    w, z = winch.natural_omega, winch.damping_ratio
    return np.asarray(expm(np.array([[0.0, 1.0], [-(w**2), -2.0 * z * w]]) * dt))


def sea_table(scenario: Scenario) -> Array:
    """Constants of a filtered sea (transition, roots of step and stationary covariance, outputs) or of
    sinusoids (bins' lower ends, widths, amplitudes), one after the other; empty for other seas."""
    kind = _SEA_KINDS[scenario.sea_state.kind]
    if kind == k.SINUSOIDS:
        components = boom_tip_components(scenario.sea_state, scenario.boom_tip_vessel)
        return np.concatenate([components.low, components.width, components.amplitude])
    if kind != k.FILTERED:
        return np.zeros(0)
    boom_tip = boom_tip_filter(scenario.sea_state, scenario.boom_tip_vessel)
    F, Q = boom_tip.discretised(scenario.control_dt)
    parts = (F, square_root(Q), square_root(boom_tip.covariance), boom_tip.C)
    return np.concatenate([np.ravel(part) for part in parts])


def filter_columns(sea: Array, n_filter: int) -> Array:
    """The columns of a filtered sea's transition and then of its step's root, each filled up with zeros so
    that a single environment can take `kernel.WIDE` states at a time."""
    matrices = sea[: 2 * n_filter**2].reshape(2, n_filter, n_filter)
    columns = np.zeros((2, n_filter, -(-n_filter // k.WIDE) * k.WIDE))
    columns[:, :, :n_filter] = matrices.transpose(0, 2, 1)
    return np.ravel(columns)


def sensor_table(scenario: Scenario, nominal: Scenario) -> Array:
    """Noise of a sample, offset and one over the scale of each observed sensor, (3 n_sensors,).

    Offset and scale are the nominal scenario's: an observation means the same in every episode.
    """
    pairs = zip(scenario.observed_sensors, nominal.observed_sensors, strict=True)
    return np.ravel(
        [
            (sensor.sample_std(scenario.control_dt), known.offset, 1.0 / known.scale)
            for sensor, known in pairs
            if known.scale is not None
        ]
    )


def sensor_errors(sensor: Sensor, control_dt: float) -> tuple[float, ...]:
    """Scale error, bias, control steps between readings, drop-out, and the heave filter's two numbers."""
    every = 1 if sensor.interval is None else round(sensor.interval / control_dt)
    corner = 0.0 if sensor.high_pass_omega is None else math.tan(0.5 * sensor.high_pass_omega * control_dt)
    return (sensor.scale_error, sensor.bias, every, sensor.dropout, corner, HIGH_PASS_DAMPING)


class Plant:
    """A batch of plants of one scenario, with their sensors and costs.

    After `begin` and every `advance` the arrays below hold the present instant; they are the plant's
    own and are rewritten by the next call, so copy what is to be kept, or have the observations handed out.
    """

    observation: Array
    """What the controller sees, scaled, (n_envs, n_observations), float32."""
    reward: Array
    """Minus the stage cost of the last step, (n_envs,)."""
    outcome: Array
    """What became of each row in the last step: 0 running, 1 diverged, 2 lost, 3 landed, (n_envs,)."""
    drawn: Array
    """What the present episode drew for each of `scenario.uncertainty`, (n_envs, n_draws)."""
    advance_one: Callable[[float], float]
    """Advances a batch of one by one control step under an action in [-1, 1]; returns the reward, or NaN if
    the row does not go on: `outcome_of_one` then tells what became of it."""

    def __init__(
        self,
        scenario: Scenario,
        n_envs: int,
        *,
        dtype: str = "float64",
        n_steps: int | None = None,
        n_threads: int = 1,
        keeps_tensions: bool = False,
    ) -> None:
        """Lays the scenario out in buffers.

        Args:
            scenario: The operation.
            n_envs: Environments in the batch.
            dtype: Precision of the physics, "float64" or "float32".
            n_steps: Control steps of an episode; the scenario's own if not given.
            n_threads: Threads that share the blocks of a large batch.
            keeps_tensions: Whether `element_tensions` is wanted.

        Raises:
            ValueError: If an argument is impossible, or a recording cannot be used.
        """
        if dtype not in DTYPES:
            raise ValueError(f"dtype must be one of {', '.join(DTYPES)}, got {dtype!r}")
        for name, value in (("num_envs", n_envs), ("n_threads", n_threads)):
            if not isinstance(value, (int, np.integer)) or value < 1:
                raise ValueError(f"{name} must be a positive whole number, got {value!r}")
        self.scenario = scenario
        self.n_envs = int(n_envs)
        self.dtype = dtype
        self.n_steps = scenario.n_steps if n_steps is None else n_steps
        self._keeps_tensions = keeps_tensions
        self.n_lanes = 1 if n_envs == 1 else k.BATCH_LANES[dtype]
        self.n_blocks = -(-self.n_envs // self.n_lanes)
        self._lay_out()
        # Lanes beyond the last environment run along, so these are as long as all blocks together.
        n_lanes = self.n_blocks * self.n_lanes
        self._reward = aligned_zeros((n_lanes,), np.float64)
        self._outcome = aligned_zeros((n_lanes,), np.int64)
        self._actions = aligned_zeros((n_lanes,), np.float64)
        self._begins = np.ones(n_lanes, dtype=np.int64)
        self.observation = np.zeros((self.n_envs, len(scenario.observation_names)), dtype=np.float32)
        self._is_handed_out = False
        self._hands_channels_out = False
        self.drawn = np.zeros((self.n_envs, len(scenario.uncertainty)))
        n_threads = min(int(n_threads), self.n_blocks)
        cuts = np.linspace(0, self.n_blocks, n_threads + 1).astype(int)
        self._cuts = [(int(a), int(b)) for a, b in pairwise(cuts)]
        n_scratch = int(self._cfg[k.WORK_CABLE])
        n_scratch += 0 if scenario.is_linear else n_work_rows(scenario.n_elements)
        self._scratch = aligned_zeros((n_threads, n_scratch, self.n_lanes), dtype)
        for scratch in self._scratch[:, self._cfg[k.WORK_CABLE] :] if not scenario.is_linear else ():
            fill_work(scratch)
        self._workers = Workers(n_threads) if n_threads > 1 else None
        self._bind(0)

    def _bind(self, position: int) -> None:
        """Tells the kernel where everything lies, and how many control steps the plant has made; a copy of
        the plant has memory of its own."""
        cfg = self._cfg
        self._observations = Pool(self.observation.shape, np.float32)
        self._channel_blocks = Pool((self.n_blocks, rows.N_CHANNELS, self.n_lanes), self.dtype)
        self._channel_block: Array | None = None
        cfg[k.ADDRESS_CHANNELS] = 0
        cfg[k.ADDRESS_STATE] = self._state.ctypes.data
        cfg[k.ADDRESS_COUNTERS] = self._counters.ctypes.data
        cfg[k.ADDRESS_TABLES] = self._tables.ctypes.data
        cfg[k.ADDRESS_NUMBERS] = self._numbers.ctypes.data
        cfg[k.ADDRESS_OBSERVATION] = self.observation.ctypes.data
        cfg[k.ADDRESS_REWARD] = self._reward.ctypes.data
        cfg[k.ADDRESS_OUTCOME] = self._outcome.ctypes.data
        cfg[k.ADDRESS_ACTIONS] = self._actions.ctypes.data
        cfg[k.ADDRESS_BEGINS] = self._begins.ctypes.data
        self.reward, self.outcome = self._reward[: self.n_envs], self._outcome[: self.n_envs]
        shown = self._state[:, : rows.N_CHANNELS]
        self._channel_rows = shown[0, :, 0] if self.n_lanes == 1 else shown
        self._shares = np.array(
            [
                (cfg.ctypes.data, scratch.ctypes.data, a, b, position)
                for scratch, (a, b) in zip(self._scratch, self._cuts, strict=True)
            ]
        )
        self._calls = [share.ctypes.data for share in self._shares]
        self._first_call = self._calls[0]
        # Of one number, Python reads these several times as fast as the arrays.
        self._reward_found: Any = self._reward.data
        self._outcome_found: Any = self._outcome.data
        self._advance, self._begin = self._advance_at_first, self._begin_at_first
        self.advance_one = partial(self._advance, self._first_call)
        self._advance_address = 0

    def _compile(self) -> None:
        """Puts the compiled functions in place of the two below, which stand for them until then."""
        advance, begin = k.KERNELS[self.dtype, self.n_lanes]
        self._begin = entry_point(begin, types.int64)
        self._advance = entry_point(advance, types.int64, types.float64)
        self.advance_one = partial(self._advance, self._first_call)
        self._advance_address = address_of(advance, types.int64, types.float64) if self._workers else 0

    def _advance_at_first(self, share: int, action: float) -> float:
        self._compile()
        return float(self._advance(share, action))

    def _begin_at_first(self, share: int) -> None:
        self._compile()
        self._begin(share)

    @property
    def _position(self) -> int:
        """Control steps that the batch has made."""
        return int(self._shares[0, k.SHARE_POSITION])

    def __getstate__(self) -> dict[str, Any]:
        """Everything but the compiled functions, views and addresses."""
        bound = {
            "reward",
            "outcome",
            "_channel_rows",
            "_advance",
            "_advance_address",
            "_begin",
            "_observations",
            "_channel_blocks",
            "_channel_block",
            "_shares",
            "_calls",
            "_first_call",
            "_reward_found",
            "_outcome_found",
            "advance_one",
        }
        kept = {name: value for name, value in self.__dict__.items() if name not in bound}
        return {**kept, "position": self._position}

    def __setstate__(self, state: dict[str, Any]) -> None:
        position = state.pop("position")
        self.__dict__.update(state)
        for name in ("_state", "_counters", "_reward", "_outcome", "_actions", "_scratch"):
            given = self.__dict__[name]
            self.__dict__[name] = aligned_zeros(given.shape, given.dtype)
            self.__dict__[name][...] = given
        self._bind(position)

    def _lay_out(self) -> None:
        scenario = self.scenario
        cfg = np.zeros(k.N_CONFIGURATION, dtype=np.int64)
        sensors, lags = scenario.observed_sensors, scenario.observed_lags
        ages = [round(sensor.delay / scenario.control_dt) for sensor in sensors]
        n_filter = scenario.n_filter_states
        kind, sea = _SEA_KINDS[scenario.sea_state.kind], sea_table(scenario)
        cfg[k.SEA_KIND] = kind
        cfg[k.N_FILTER] = n_filter
        cfg[k.N_COMPONENTS] = len(sea) // 3 if kind == k.SINUSOIDS else 0
        cfg[k.IS_LINEAR] = scenario.is_linear
        cfg[k.N_ELEMENTS] = scenario.n_elements
        cfg[k.N_SUBSTEPS] = scenario.n_substeps
        cfg[k.N_ITERATIONS] = scenario.n_iterations
        cfg[k.TENSION_ONLY] = scenario.cable is not None and scenario.cable.tension_only
        winch = scenario.winch
        cfg[k.WINCH_LIMITED] = winch.is_limited
        cfg[k.WINCH_DRIVEN] = winch.is_driven or winch.is_second_order
        cfg[k.SECOND_ORDER_WINCH] = winch.is_second_order
        cfg[k.ACCELERATION_LIMITED] = winch.acceleration_limit is not None or winch.torque_limit is not None
        cfg[k.DELAY_SUBSTEPS] = scenario.delay_substeps
        n_held = max(scenario.n_held_pending, scenario.n_shown_pending)
        cfg[k.N_PENDING] = n_held
        cfg[k.N_SHOWN_PENDING] = scenario.n_shown_pending
        cfg[k.SEA_VARIES] = bool(scenario.varies & {"sea_state", "vessel"}) and kind in (
            k.FILTERED,
            k.SINUSOIDS,
        )
        cfg[k.SENSORS_VARY] = "sensors" in scenario.varies
        cfg[k.DELAY_VARIES] = any(draw.parameter == "winch.command_delay" for draw in scenario.uncertainty)
        cfg[k.HOOKEAN] = scenario.is_hookean
        cfg[k.KEEPS_TENSIONS] = self._keeps_tensions
        cfg[k.CHARGES_ENERGY] = scenario.task.energy_weight > 0.0
        cfg[k.HAS_COMPENSATOR] = scenario.compensator is not None
        cfg[k.SENSORS_ERR] = not all(sensor.is_plain for sensor in sensors)
        cfg[k.N_DRAWS] = len(scenario.uncertainty)
        cfg[k.SHOWS_DRAWS] = scenario.information_set == "full_state"
        cfg[k.N_SENSORS] = len(sensors)
        cfg[k.N_LAGS] = len(lags)
        cfg[k.SENSOR_RING] = max(lags) + max(ages) + 1
        cfg[k.SHOWN_FILTER_STATES] = scenario.observed_filter_states
        cfg[k.N_STEPS] = self.n_steps
        cfg[k.HAS_PAY_OUT] = scenario.pay_out.speed != 0.0
        cfg[k.BEGINS_COMPENSATED] = scenario.start == "compensated"
        cfg[k.N_ENVS] = self.n_envs
        cfg[k.N_OBSERVED] = len(scenario.observation_names)
        row = rows.N_FIXED
        for key, count in (
            (k.ROW_FILTER, n_filter),
            (k.ROW_COMPONENTS, 2 * int(cfg[k.N_COMPONENTS])),
            (k.ROW_COMMANDS, n_held + 1),
            (k.ROW_SENSORS, int(cfg[k.SENSOR_RING]) * len(sensors)),
            (k.ROW_SEA, len(sea) if cfg[k.SEA_VARIES] else 0),
            (k.ROW_SENSOR_TABLE, 3 * len(sensors) if cfg[k.SENSORS_VARY] else 0),
            (k.ROW_DRAWS, len(scenario.uncertainty)),
            (k.ROW_SENSOR_STATE, 5 * len(sensors) if cfg[k.SENSORS_ERR] else 0),
            (k.ROW_NODES, self._n_cable_rows(keeps_tensions=self._keeps_tensions)),
        ):
            cfg[key] = row
            row += count
        cfg[k.N_ROWS] = row
        cfg[k.WORK_FILTER] = rows.N_SCRATCH
        cfg[k.WORK_NOISE] = cfg[k.WORK_FILTER] + -(-n_filter // k.WIDE) * k.WIDE
        n_quads = -(-n_filter // 4) + -(-len(sensors) // 4)
        cfg[k.WORK_CABLE] = cfg[k.WORK_NOISE] + 4 * n_quads
        tables: list[Array] = [np.array([scenario.control_dt])]

        def place(key: int, *parts: Any) -> None:
            cfg[key] = sum(len(table) for table in tables)
            tables.extend(np.ravel(np.asarray(part, dtype=float)) for part in parts)

        place(k.AT_HERMITE, cubic_coefficients(scenario.n_substeps, scenario.control_dt))
        if n_filter or kind == k.SINUSOIDS:
            place(k.AT_FILTER if n_filter else k.AT_COMPONENTS, sea)
        place(k.AT_COLUMNS, filter_columns(sea, n_filter))
        place(k.AT_SENSORS, sensor_table(scenario, scenario))
        place(k.AT_SENSOR_ERRORS, [sensor_errors(sensor, scenario.control_dt) for sensor in sensors])
        if kind == k.RECORDED:
            place(k.AT_RECORDING, self._recording())
        readings = [
            (rows.CHANNEL_NAMES.index(sensor.channel), age) for sensor, age in zip(sensors, ages, strict=True)
        ]
        self._cfg = np.concatenate([cfg, np.ravel(readings), lags]).astype(np.int64)
        self._tables = np.concatenate(tables)
        self._numbers = self._tables.astype(self.dtype)
        self._state = aligned_zeros((self.n_blocks, row, self.n_lanes), self.dtype)
        self._counters = aligned_zeros((self.n_blocks, k.N_COUNTERS, self.n_lanes), np.uint64)
        self._fill_parameters(self._state, scenario)
        task = scenario.task
        self._state[:, rows.FAILURE_RATE] = task.failure_factor * scenario.uncontrolled_cost
        # Far beyond what any stable plant does under full command.
        reach = 1.0 + scenario.winch.command_range + 10.0 * scenario.boom_tip_scale
        self._state[:, rows.DIVERGENCE_LIMIT] = 100.0 * reach

    def _n_cable_rows(self, *, keeps_tensions: bool) -> int:
        scenario = self.scenario
        if scenario.is_linear:
            return 0
        return n_cable_rows(scenario.n_elements, hookean=scenario.is_hookean, keeps_tensions=keeps_tensions)

    def _recording(self) -> Array:
        scenario = self.scenario
        assert scenario.sea_state.recording is not None
        recording = read_motion(scenario.sea_state.recording)
        instants = scenario.solver_dt * np.arange(self.n_steps * scenario.n_substeps + 1)
        heave, rate, payout = recording.sampled(instants)
        lengths = scenario.initial_length + payout
        if scenario.cable is not None and lengths.min() <= scenario.winch_reach:
            raise ValueError(
                f"motion file {recording.path!r} recovers the cable down to {lengths.min():g} m, within the "
                f"winch's reach of {scenario.winch_reach:g} m; start from a longer cable"
            )
        return np.column_stack([heave, rate, payout])

    def _fill_parameters(self, S: Array, scenario: Scenario) -> None:
        """Writes a scenario's numbers into some rows of the state, (n_blocks, n_rows, n_lanes)."""
        cfg = self._cfg
        winch, task, pay_out = scenario.winch, scenario.task, scenario.pay_out

        def limit(value: float | None) -> float:
            return math.inf if value is None else value

        S[:, rows.WINCH_RATE_CONSTANT] = winch.rate_constant
        S[:, rows.WINCH_DECAY] = math.exp(-winch.rate_constant * scenario.solver_dt)
        S[:, rows.STROKE_LIMIT] = limit(winch.stroke_limit)
        S[:, rows.SPEED_LIMIT] = limit(winch.speed_limit)
        S[:, rows.ACCELERATION_LIMIT] = limit(winch.acceleration_limit)
        if winch.is_second_order:
            for i, value in enumerate(np.ravel(drive_step(winch, scenario.solver_dt))):
                S[:, rows.WINCH_TRANSITION + i] = value
        S[:, rows.COMMAND_STEP] = winch.command_step
        S[:, rows.DEAD_BAND] = winch.dead_band
        S[:, rows.POWER_LIMIT] = limit(winch.power_limit)
        S[:, rows.TORQUE_LIMIT] = limit(winch.torque_limit)
        S[:, rows.DRUM_RADIUS] = 1.0 if winch.drum_radius is None else winch.drum_radius
        S[:, rows.DRUM_INERTIA] = 1.0 if winch.drum_inertia is None else winch.drum_inertia
        S[:, rows.SUPPLY_PER_WORK] = 1.0 / winch.efficiency
        S[:, rows.RETURNED_SHARE] = winch.regeneration
        S[:, rows.COMMAND_RANGE] = winch.command_range
        S[:, rows.POSITION_WEIGHT] = task.position_weight
        S[:, rows.COMMAND_WEIGHT] = task.command_weight
        per_force = 1.0 if scenario.is_linear else scenario.static_tension
        S[:, rows.ENERGY_WEIGHT] = task.energy_weight / (per_force * scenario.control_dt)
        S[:, rows.TENSION_LIMIT] = limit(task.tension_limit)
        S[:, rows.LANDING_DEPTH] = limit(task.landing_depth)
        S[:, rows.OWN_DELAY] = scenario.delay_substeps
        if cfg[k.SEA_VARIES]:
            own = sea_table(scenario)
            S[:, cfg[k.ROW_SEA] : cfg[k.ROW_SEA] + len(own)] = own[None, :, None]
        if cfg[k.SENSORS_VARY]:
            own = sensor_table(scenario, self.scenario)
            S[:, cfg[k.ROW_SENSOR_TABLE] : cfg[k.ROW_SENSOR_TABLE] + len(own)] = own[None, :, None]
        S[:, rows.BREAKING_STRENGTH] = limit(scenario.cable.breaking_strength if scenario.cable else None)
        S[:, rows.PAY_OUT_SPEED] = pay_out.speed
        S[:, rows.PAY_OUT_START] = pay_out.start
        S[:, rows.PAY_OUT_TIME] = pay_out.distance / abs(pay_out.speed) if pay_out.speed else 0.0
        S[:, rows.PAY_OUT_RAMP] = pay_out.ramp
        if scenario.linear_payload is not None:
            transition, forcing = linear_step(scenario.linear_payload, scenario.solver_dt)
            for i, value in enumerate(np.ravel(transition)):
                S[:, rows.LINEAR_TRANSITION + i] = value
            for i, value in enumerate(np.ravel(forcing)):
                S[:, rows.LINEAR_INPUT + i] = value
        else:
            assert scenario.cable is not None and scenario.payload is not None
            S[:, rows.INITIAL_LENGTH] = scenario.initial_length
            if scenario.compensator is not None:
                rod = scenario.compensator
                S[:, rows.GAS_FORCE] = scenario.static_tension if rod.force is None else rod.force
                S[:, rows.GAS_LENGTH] = rod.gas_length
                S[:, rows.GAS_EXPONENT] = rod.polytropic_exponent
                S[:, rows.COMPENSATOR_DAMPING] = rod.damping
                S[:, rows.COMPENSATOR_MASS] = rod.moving_mass
                S[:, rows.HALF_STROKE] = 0.5 * rod.stroke
            fill_parameters(S, scenario.cable, scenario.payload)

    def begin(self, mask: Array, seeds: Array | None = None) -> None:
        """Begins a new episode in the masked rows.

        Args:
            mask: Rows to begin anew, (n_envs,), bool.
            seeds: New seeds, (n_envs,), of which the masked are taken and their episodes counted from
                0; without them the rows go on to the next episode of their seeds.
        """
        place = np.nonzero(mask)[0]
        block, lane = place // self.n_lanes, place % self.n_lanes
        if seeds is None:
            self._counters[block, k.EPISODE, lane] += np.uint64(1)
        else:
            self._counters[block, k.SEED, lane] = np.asarray(seeds, dtype=np.uint64)[place]
            self._counters[block, k.EPISODE, lane] = 0
        if self.scenario.uncertainty:
            for row in place:
                self._draw(int(row))
        self._begins[: self.n_envs] = mask
        self._lay_begun_out()
        # Those beyond the last environment have a state now.
        self._begins[self.n_envs :] = 0

    def _lay_begun_out(self) -> None:
        """Begins the marked rows; if the observations are somebody else's by now, in memory of its own."""
        self._channel_block = None
        self._cfg[k.SHOWS_ALL] = self._is_handed_out
        self._take_back()
        self._begin(self._first_call)

    def _take_back(self) -> None:
        """Goes on in other memory if the observations were handed out."""
        if self._is_handed_out:
            self._is_handed_out = False
            self.observation, self._cfg[k.ADDRESS_OBSERVATION] = self._observations.take()

    def hand_out(self) -> Array:
        """The observations, which are the caller's from now on: the plant goes on in other memory."""
        if self.n_lanes == 1:
            return self.observation.copy()
        self._is_handed_out = True
        return self.observation

    def hand_channels_out(self) -> None:
        """Has every step from now on lay its channels out for `channel_block` as it makes them."""
        self._hands_channels_out = self.n_lanes > 1

    def _draw(self, row: int) -> None:
        """Draws the uncertain numbers of a row's new episode and lays its own plant out."""
        block, lane = divmod(row, self.n_lanes)
        seed, episode = self._counters[block, k.SEED, lane], self._counters[block, k.EPISODE, lane]
        draws = self.scenario.uncertainty
        values = [draw.quantile(uniform_number(seed, episode, PARAMETERS, i)) for i, draw in enumerate(draws)]
        paths = [draw.parameter for draw in draws]
        own = self._state[block : block + 1, :, lane : lane + 1]
        self._fill_parameters(own, self.scenario.with_drawn(dict(zip(paths, values, strict=True))))
        first = self._cfg[k.ROW_DRAWS]
        known = self.scenario.design_basis.uncertainty
        own[0, first : first + len(draws), 0] = [
            draw.scaled(value) for draw, value in zip(known, values, strict=True)
        ]
        self.drawn[row] = values

    def advance(self, actions: Array) -> None:
        """Advances every row by one control step under actions in [-1, 1], (n_envs,), float64."""
        if self.n_lanes == 1:
            self.advance_one(actions[0])
            return
        self._actions[: self.n_envs] = actions
        self._take_back()
        if self._hands_channels_out:
            self._channel_block, self._cfg[k.ADDRESS_CHANNELS] = self._channel_blocks.take()
        if self._workers is None:
            self._advance(self._first_call, 0.0)
        else:
            if self._advance_address == 0:
                self._compile()
            self._workers.run_compiled(self._advance, self._advance_address, self._calls)

    def outcome_of_one(self) -> tuple[float, int]:
        """Reward and outcome of a batch of one."""
        return self._reward_found[0], self._outcome_found[0]

    def advance_many(self, asked: tuple[Any, ...], n_steps: int) -> None:
        """Advances every row by `n_steps` control steps in one call of `marching`'s loop.

        Args:
            asked: What the loop takes behind what the plant gives.
            n_steps: Control steps, the first of what is asked.
        """
        self._take_back()
        self._channel_block = None
        self._cfg[k.ADDRESS_CHANNELS] = 0
        filled = (self._state, self.observation, self._actions, self.reward, self.outcome)
        loop = LOOPS[self.dtype, self.n_lanes]
        given = [(*filled, share, *asked) for share in self._shares]
        if self._workers is None:
            loop(*given[0])
        else:
            self._workers.run(loop, given)

    def steps(self) -> Array:
        """Control steps that each row has made in its episode, (n_envs,)."""
        return self._counters[:, k.STEP, :].ravel()[: self.n_envs].astype(np.int64)

    def channel_block(self) -> Array:
        """A copy of all channels at this instant, as they lie; `channel_rows` puts it in order."""
        return self._channel_rows.copy() if self._channel_block is None else self._channel_block

    def channel_rows(self, block: Array) -> Array:
        """The channels in a copy made by `channel_block`, (n_channels, n_envs), float64."""
        blocks = block.reshape(self.n_blocks, rows.N_CHANNELS, self.n_lanes)
        return blocks.transpose(1, 0, 2).reshape(rows.N_CHANNELS, -1)[:, : self.n_envs].astype(np.float64)

    @property
    def channels(self) -> Array:
        """A copy of the physical channels, ordered as `layout.CHANNEL_NAMES`, (n_envs, n_channels)."""
        return np.ascontiguousarray(self.channel_rows(self.channel_block()).T)

    def channel(self, name: str) -> Array:
        """A copy of one physical channel, (n_envs,)."""
        row = rows.CHANNEL_NAMES.index(name)
        return self._state[:, row, :].ravel()[: self.n_envs].astype(np.float64)

    def truth(self) -> Array:
        """What no sensor shows, scaled to order one, for critics: (n_envs, n) float32, see `truth_names`."""
        scenario, state = self.scenario, self._state
        columns = []
        for name in truth_names(scenario):
            if name in rows.CHANNEL_NAMES:
                scale, offset = scenario.channel_scale(name)
                columns.append((state[:, rows.CHANNEL_NAMES.index(name)].ravel() - offset) / scale)
        places = [int(self._cfg[k.ROW_FILTER]) + i for i in range(scenario.n_filter_states)]
        places += [int(self._cfg[k.ROW_DRAWS]) + i for i in range(len(scenario.uncertainty))]
        columns += [state[:, place].ravel() for place in places]
        return np.stack(columns, axis=1)[: self.n_envs].astype(np.float32)

    def element_tensions(self, row: int) -> Array | None:
        """Tension of each element of one row's cable, sheave to payload [N].

        None without a cable, and if the plant was not told to keep them.
        """
        if self.scenario.is_linear or not self._keeps_tensions:
            return None
        block, lane = divmod(row, self.n_lanes)
        first = int(self._cfg[k.ROW_NODES]) + self._n_cable_rows(keeps_tensions=False)
        return self._state[block, first : first + self.scenario.n_elements, lane].astype(np.float64)

    def get_state(self) -> dict[str, Array]:
        """Everything that the plant's future depends on, as plain arrays."""
        if self._is_handed_out:
            # Whoever has them may have written into them.
            self._begins[: self.n_envs] = 0
            self._lay_begun_out()
        return {
            "state": self._state.copy(),
            "counters": self._counters.copy(),
            "position": np.array(self._position),
            "observation": self.observation.copy(),
            "drawn": self.drawn.copy(),
        }

    def set_state(self, state: dict[str, Array]) -> None:
        """Goes back to what `get_state` gave.

        Raises:
            ValueError: If the state is of another scenario, batch or precision.
        """
        for name, mine in (("state", self._state), ("counters", self._counters)):
            given = state[name]
            if given.shape != mine.shape or given.dtype != mine.dtype:
                raise ValueError(
                    f"plant state {name!r} has shape {given.shape} and type {given.dtype}, this plant "
                    f"{mine.shape} and {mine.dtype}; restore it into the scenario, batch and dtype it came "
                    "from"
                )
            mine[...] = given
        self._shares[:, k.SHARE_POSITION] = int(state["position"])
        self._take_back()
        self._channel_block = None
        self.observation[...] = state["observation"]
        self.drawn[...] = state["drawn"]

    def close(self) -> None:
        """Lets go of the threads."""
        if self._workers is not None:
            self._workers.close()
            self._workers = None


def simulate(
    scenario: Scenario,
    *,
    seeds: list[int] | Array,
    duration: float | None = None,
    commands: Array | None = None,
) -> dict[str, Array]:
    """Runs the plant open loop.

    Args:
        scenario: The operation.
        seeds: One seed per run.
        duration: How long [s]; the scenario's own duration if not given.
        commands: Commanded winch displacement of each control step [m], (n_steps,) or
            (n_steps, n_envs); zero if not given.

    Returns:
        "time" [s], (n_steps + 1,), and the physical channels by name, (n_steps + 1, n_envs); a channel
        that the plant lacks (tensions and length of a linear payload) is left out.
    """
    n_steps = scenario.n_steps if duration is None else round(duration / scenario.control_dt)
    n_envs = len(seeds)
    plant = Plant(scenario, n_envs, n_steps=n_steps)
    plant.begin(np.ones(n_envs, dtype=bool), np.asarray(seeds))
    actions = np.zeros((n_steps, n_envs))
    if commands is not None:
        commands = np.asarray(commands, dtype=float)
        actions[:] = (commands if commands.ndim == 2 else commands[:, None]) / scenario.winch.command_range
    result = dict(rollout(plant, actions, channels=channel_names(scenario)).channels)
    result["time"] = scenario.control_dt * np.arange(n_steps + 1, dtype=np.float64)
    return result


_CABLE_CHANNELS = (
    "sheave_tension",
    "payload_tension",
    "length",
    "slack",
    "tension_min",
    "tension_max",
    "winch_power",
    "supply_power",
)


def truth_names(scenario: Scenario) -> list[str]:
    """Entries of `Plant.truth`: motion of payload, boom tip, winch; tension; the sea's states; the draws."""
    names = ["payload_heave", "payload_heave_rate", "boom_tip_heave", "boom_tip_heave_rate"]
    names += ["winch_displacement", "winch_rate"]
    if not scenario.is_linear:
        names.append("sheave_tension")
    names += [f"filter_state_{i}" for i in range(scenario.n_filter_states)]
    return names + [draw.parameter for draw in scenario.uncertainty]


def channel_names(scenario: Scenario) -> list[str]:
    """Physical channels that the scenario's plant has."""
    lacking = set(_CABLE_CHANNELS if scenario.is_linear else ())
    if scenario.compensator is None:
        lacking |= set(COMPENSATOR_CHANNELS)
    if scenario.task.energy_weight == 0.0:
        lacking.add("energy_cost")
    return [name for name in rows.CHANNEL_NAMES if name not in lacking]
