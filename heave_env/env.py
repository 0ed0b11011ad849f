"""The environment's faces: `HeaveVectorEnv`, and `HeaveEnv` as a batch of one.

Both translate between Gymnasium and `Plant`; neither holds physics. Row i of a batch seeded s is, bit
for bit, the single environment seeded s + i.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Container, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from heave_env import scenarios
from heave_env.kernel import DIVERGED, LANDED, LOST, RUNNING
from heave_env.layout import CHANNEL_NAMES
from heave_env.plant import Plant, channel_names
from heave_env.scenarios import Scenario
from heave_env.sensors import OBSERVATION_BOUND

if TYPE_CHECKING:
    from heave_env.render import FrameData, HumanWindow

Array = np.ndarray

RENDER_MODES = ["human", "rgb_array", "ansi"]
_FATES = (("diverged", DIVERGED), ("lost", LOST), ("landed", LANDED))
_TRACE_SECONDS = 60.0


def chosen_scenario(
    scenario: str | Path | Scenario, information_set: str | None, overrides: dict[str, Any] | None
) -> Scenario:
    """The scenario with an information set and values at dotted paths replaced.

    Raises:
        ValueError: If the scenario is unknown or a value impossible.
    """
    chosen = scenarios.load(scenario)
    if information_set is not None:
        chosen = scenarios.with_value(chosen, "information_set", information_set)
    return scenarios.with_values(chosen, overrides) if overrides else chosen


def observation_space(scenario: Scenario) -> gym.spaces.Box:
    """Bounds of one observation: scaled channels and filter states, then pending commands in [-1, 1]."""
    high = np.full(len(scenario.observation_names), OBSERVATION_BOUND, dtype=np.float32)
    if scenario.n_shown_pending:
        high[-scenario.n_shown_pending :] = 1.0
    return gym.spaces.Box(-high, high, dtype=np.float32)


def action_space() -> gym.spaces.Box:
    """One number in [-1, 1]: the commanded winch displacement over the command range, positive raising."""
    return gym.spaces.Box(-1.0, 1.0, shape=(1,), dtype=np.float32)


def checked_actions(actions: Any, shape: tuple[int, ...]) -> Array:
    """Actions as float64, checked.

    Raises:
        ValueError: If the shape is wrong or a number is missing.
    """
    array = np.asarray(actions, dtype=np.float64)
    if array.shape != shape:
        raise ValueError(f"action must have shape {shape}, got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"action must be finite numbers in [-1, 1], got {array[~np.isfinite(array)][0]}")
    return array


class StepInfo(dict[str, Any]):
    """The info of a step: a dictionary whose entries are made when first asked for.

    What they are made of was copied in the step itself, so an info may be kept, changed and pickled (it
    becomes a plain dictionary) like any other. Most are thrown away unread, and cost next to nothing.
    """

    __slots__ = ("_known", "_recipe")

    _known: Container[str]
    _recipe: tuple[Any, ...] | None

    @staticmethod
    def of(diverged: Any, known: Container[str], *recipe: Any) -> StepInfo:
        """An info whose entries are not yet made.

        Args:
            diverged: The entry of this name, there from the start: some code (json) asks a dictionary for
                nothing but its size, and must not find it empty.
            known: Names of all entries.
            *recipe: What makes the entries, and its arguments, this step's own.
        """
        # An `__init__` would take three times as long as all of this.
        info = StepInfo()
        info["diverged"] = diverged
        info._known, info._recipe = known, recipe
        return info

    def _fill(self) -> None:
        recipe, self._recipe = self._recipe, None
        if recipe is not None:
            made = recipe[0](*recipe[1:])
            made.update(self)
            dict.clear(self)
            dict.update(self, made)

    def __missing__(self, key: str) -> Any:
        if self._recipe is None or key not in self._known:
            raise KeyError(key)
        self._fill()
        return dict.__getitem__(self, key)

    def get(self, key: str, default: Any = None) -> Any:
        """The entry, or the default."""
        try:
            return self[key]
        except KeyError:
            return default

    def __contains__(self, key: object) -> bool:
        return dict.__contains__(self, key) or (self._recipe is not None and key in self._known)

    def __eq__(self, other: object) -> bool:
        self._fill()
        if isinstance(other, StepInfo):
            other._fill()
        return dict.__eq__(self, other)

    __hash__ = None

    def __ne__(self, other: object) -> bool:
        return not self == other

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, (dict(self),)


def _after_filling(name: str) -> Callable[..., Any]:
    method = getattr(dict, name)

    def call(self: StepInfo, *arguments: Any, **options: Any) -> Any:
        self._fill()
        return method(self, *arguments, **options)

    call.__name__, call.__doc__ = name, method.__doc__
    return call


for _name in (
    *("__iter__", "__len__", "__reversed__", "__repr__", "__delitem__", "__or__", "__ror__", "__ior__"),
    *("keys", "values", "items", "copy", "clear", "pop", "popitem", "setdefault", "update"),
):
    setattr(StepInfo, _name, _after_filling(_name))


class _Traces:
    """The last minute of one row, for pictures; kept only where a render mode is set."""

    def __init__(self, plant: Plant, row: int) -> None:
        self._plant, self._row = plant, row
        length = round(_TRACE_SECONDS / plant.scenario.control_dt)
        self._samples: deque[tuple[float, float, float]] = deque(maxlen=length)

    def restart(self) -> None:
        self._samples.clear()
        self.record()

    def record(self) -> None:
        plant, row = self._plant, self._row
        time = float(plant.steps()[row] * plant.scenario.control_dt)
        boom_tip, payload = (plant.channel(name)[row] for name in ("boom_tip_heave", "payload_heave"))
        self._samples.append((time, float(boom_tip), float(payload)))

    def frame_data(self) -> FrameData:
        from heave_env.render import FrameData

        plant, row = self._plant, self._row
        scenario = plant.scenario

        def value(name: str) -> float:
            return float(plant.channel(name)[row])

        samples = np.array(self._samples)
        return FrameData(
            time=float(samples[-1, 0]),
            boom_tip_heave=value("boom_tip_heave"),
            winch_displacement=value("winch_displacement"),
            payload_heave=value("payload_heave"),
            length=value("length"),
            node_tension=plant.element_tensions(row),
            static_tension=scenario.static_tension,
            trace_time=samples[:, 0],
            trace_boom_tip=samples[:, 1],
            trace_payload=samples[:, 2],
            scenario_name=scenario.name,
            command=value("command"),
            motion_range=4.0 * scenario.boom_tip_scale,
        )


def _check_render_mode(render_mode: str | None) -> None:
    if render_mode is not None and render_mode not in RENDER_MODES:
        raise ValueError(f"render_mode must be one of {', '.join(RENDER_MODES)} or None, got {render_mode!r}")


def _draw(traces: _Traces, render_mode: str | None) -> Any:
    from heave_env import render

    data = traces.frame_data()
    return render.ansi_frame(data) if render_mode == "ansi" else render.draw_frame(data)


class HeaveVectorEnv(gym.vector.VectorEnv):
    """A batch of heave-compensation environments advanced by one kernel.

    Observations are float32 (see `heave_env.sensors`), actions fractions of the command range,
    rewards minus the stage cost. Episodes are truncated by the clock and terminate only when a row
    diverged, lost its payload, or landed it where that is the task.
    """

    metadata: dict[str, Any] = {
        "render_modes": RENDER_MODES,
        "render_fps": 10,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        scenario: str | Path | Scenario = "sea_state_5",
        num_envs: int = 1,
        *,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        dtype: str = "float64",
        info: bool = True,
        information_set: str | None = None,
        overrides: dict[str, Any] | None = None,
        n_threads: int = 1,
    ) -> None:
        """Builds the batch.

        Args:
            scenario: Name, path of a YAML file, or the scenario itself.
            num_envs: Environments in the batch.
            max_episode_steps: Control steps of an episode; the scenario's own if not given.
            render_mode: "rgb_array", "human" (draws row 0), "ansi" or None.
            autoreset_mode: When finished rows begin anew; Gymnasium's modes.
            dtype: Precision of the physics, "float64" or "float32".
            info: Whether `info` carries the physical channels and cost terms.
            information_set: What is observed, in place of the scenario's choice.
            overrides: Scenario values to replace, by dotted path.
            n_threads: Threads that share the batch, each on a core of its own, where it looks for the next
                step for 0.3 ms before it sleeps; below about 500 environments one is best.

        Raises:
            ValueError: If an argument is impossible.
        """
        _check_render_mode(render_mode)
        self.scenario = chosen_scenario(scenario, information_set, overrides)
        if max_episode_steps is not None and max_episode_steps < 1:
            raise ValueError(f"max_episode_steps must be a positive whole number, got {max_episode_steps!r}")
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.plant = Plant(
            self.scenario,
            num_envs,
            dtype=dtype,
            n_steps=max_episode_steps,
            n_threads=n_threads,
            keeps_tensions=render_mode is not None,
        )
        if info:
            self.plant.hand_channels_out()
        self.num_envs = self.plant.n_envs
        self.render_mode = render_mode
        self.metadata = {
            **self.metadata,
            "render_fps": max(1, round(1.0 / self.scenario.control_dt)),
            "autoreset_mode": self.autoreset_mode,
        }
        self.single_observation_space = observation_space(self.scenario)
        self.single_action_space = action_space()
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._info = info
        self._columns = [(name, CHANNEL_NAMES.index(name)) for name in channel_names(self.scenario)]
        names = [name for name, _ in (*self._columns, *_FATES)]
        self._known = frozenset([*names, *("_" + name for name in names)])
        self._commands = np.zeros(self.num_envs)
        self._finished = np.zeros(self.num_envs, dtype=np.bool_)
        self._is_finished = False  # any row
        self._until_clock = 0  # steps in which no row can reach the end of its episode
        self._seeded = False
        self._begun = False
        drawn = {None: 0, "human": 1}.get(render_mode, self.num_envs)
        self._traces = [_Traces(self.plant, row) for row in range(drawn)]
        self._window: HumanWindow | None = None

    # Gymnasium's calls ---------------------------------------------------------------------------

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begins new episodes.

        Args:
            seed: An int s gives row i the seed s + i; a sequence gives each its own; None goes on to
                the next episode of the seeds in force (drawn by `np_random` when there are none).
            options: "reset_mask", a bool array (num_envs,), begins the masked rows only.
        """
        mask = np.ones(self.num_envs, dtype=np.bool_)
        if options is not None and "reset_mask" in options:
            mask = self._checked_mask(options["reset_mask"])
        if not self._begun and not mask.all():
            raise ValueError(
                "reset_mask must be all true in the first reset: the other rows have no episode yet"
            )
        seeds = self._seeds(seed)
        self.plant.begin(mask, seeds)
        self._begun = True
        self._note_finished(self._finished & ~mask)
        for row, traces in enumerate(self._traces):
            if mask[row]:
                traces.restart()
        self._show_human()
        return self.plant.hand_out(), self._infos(None)

    def step(self, actions: Any) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Advances every row by one control step.

        Args:
            actions: Fractions of the command range, (num_envs, 1).

        Raises:
            ValueError: If the actions have another shape or a number is missing.
        """
        self._take(actions)
        if not self._begun:
            raise gym.error.ResetNeeded("call reset() before step()")
        if self._is_finished and self.autoreset_mode == AutoresetMode.DISABLED:
            raise AssertionError(
                f"row {int(np.argmax(self._finished))} has finished its episode: reset it with options="
                "{'reset_mask': ...} before stepping on"
            )
        plant = self.plant
        plant.advance(self._commands)
        reward = plant.reward.copy()
        self._until_clock -= 1
        if self._is_finished or self._until_clock < 0 or np.count_nonzero(plant.outcome):
            return self._step_with_ends(reward)
        # The usual step: all rows go on.
        if self._traces:
            for traces in self._traces:
                traces.record()
            self._show_human()
        shape = self.num_envs
        terminated, truncated = np.zeros(shape, dtype=np.bool_), np.zeros(shape, dtype=np.bool_)
        return plant.hand_out(), reward, terminated, truncated, self._infos(None)

    def _step_with_ends(self, reward: Array) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """The rest of a step in which rows end, or begin anew."""
        plant, waiting = self.plant, self._finished
        terminated = plant.outcome != RUNNING
        truncated = (plant.steps() >= plant.n_steps) & ~terminated
        fate = plant.outcome.copy()
        if self._is_finished:
            # NEXT_STEP: rows that finished in the step before begin anew; their action did nothing.
            reward[waiting] = 0.0
            terminated &= ~waiting
            truncated &= ~waiting
            fate[waiting] = RUNNING
            plant.begin(waiting)
        restarted, finished = waiting, terminated | truncated
        final: dict[str, Any] = {}
        if self.autoreset_mode == AutoresetMode.SAME_STEP and finished.any():
            restarted, finished = finished, np.zeros(self.num_envs, dtype=np.bool_)
            final = self._final(restarted, fate)
            plant.begin(restarted)
            fate[restarted] = RUNNING
        self._note_finished(finished)
        for row, traces in enumerate(self._traces):
            if restarted[row]:
                traces.restart()
            else:
                traces.record()
        self._show_human()
        info = self._infos(fate)
        info.update(final)
        return plant.hand_out(), reward, terminated, truncated, info

    def render(self) -> Any:
        """A tuple of frames, one per row (strings for "ansi"); None for "human" and without a mode."""
        if self.render_mode is None or not self._begun:
            return None
        if self.render_mode == "human":
            return None
        return tuple(_draw(traces, self.render_mode) for traces in self._traces)

    def close_extras(self, **kwargs: Any) -> None:
        """Closes the window and the threads."""
        if self._window is not None:
            self._window.close()
            self._window = None
        self.plant.close()

    # Beyond Gymnasium ----------------------------------------------------------------------------

    def reset_rows(self, mask: Array) -> Array:
        """Begins the next episode of the masked rows at once, and returns all observations."""
        self.plant.begin(self._checked_mask(mask))
        self._note_finished(self._finished & ~mask)
        return self.plant.hand_out()

    def get_state(self) -> dict[str, Array]:
        """Everything that the batch's future depends on, as plain arrays."""
        return {
            **self.plant.get_state(),
            "finished": self._finished.copy(),
            "seeded": np.array(self._seeded),
        }

    def set_state(self, state: dict[str, Array]) -> None:
        """Goes back to what `get_state` gave.

        Raises:
            ValueError: If the state is of another scenario, batch or precision.
        """
        self.plant.set_state(state)
        self._note_finished(np.array(state["finished"], dtype=np.bool_))
        self._seeded = bool(state["seeded"])
        self._begun = True

    # Inner parts ---------------------------------------------------------------------------------

    def _checked_mask(self, mask: Any) -> Array:
        wanted = (self.num_envs,)
        if (
            not isinstance(mask, np.ndarray)
            or mask.dtype != np.bool_
            or mask.shape != wanted
            or not mask.any()
        ):
            raise ValueError(f"reset_mask must be a bool array of shape {wanted} with at least one true")
        return mask

    def _seeds(self, seed: int | Sequence[int | None] | None) -> Array | None:
        if seed is None and self._seeded:
            return None
        if seed is None:
            seed = int(self.np_random.integers(2**31))
        elif isinstance(seed, (int, np.integer)):
            self._np_random, self._np_random_seed = gym.utils.seeding.np_random(int(seed))
        if isinstance(seed, (int, np.integer)):
            seeds: list[Any] = [int(seed) + row for row in range(self.num_envs)]
        else:
            seeds = [int(self.np_random.integers(2**31)) if item is None else item for item in seed]
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed must be an int or {self.num_envs} ints, got {len(seeds)}")
        for item in seeds:
            if not isinstance(item, (int, np.integer)) or not 0 <= item < 2**64:
                raise ValueError(f"seed must be a whole number from 0 to 2**64 - 1, got {item!r}")
        self._seeded = True
        return np.array(seeds, dtype=np.uint64)

    def _take(self, actions: Any) -> None:
        """Keeps the actions as float64, (num_envs,), once they are known to be good."""
        taken = self._commands
        if type(actions) is np.ndarray and actions.dtype.kind == "f" and actions.shape == (self.num_envs, 1):
            taken[:] = actions[:, 0]
            # One number tells whether all are finite; squares that overflow are looked at below.
            if math.isfinite(taken.dot(taken)):
                return
        taken[:] = checked_actions(actions, (self.num_envs, 1))[:, 0]

    def _note_finished(self, finished: Array) -> None:
        """Keeps which rows have finished, and how long the clock ends no other row."""
        self._finished, self._is_finished = finished, bool(finished.any())
        self._until_clock = self.plant.n_steps - 1 - int(self.plant.steps().max())

    def _infos(self, fate: Array | None) -> dict[str, Any]:
        if not self._info:
            return {}
        diverged = np.zeros(self.num_envs) if fate is None else (fate == DIVERGED).astype(np.float64)
        return StepInfo.of(diverged, self._known, self._made_info, self.plant.channel_block(), fate)

    def _made_info(self, block: Array, fate: Array | None) -> dict[str, Any]:
        mask = np.ones(self.num_envs, dtype=np.bool_)
        values = self.plant.channel_rows(block)
        info: dict[str, Any] = {}
        for name, column in self._columns:
            info[name] = values[column]
            info["_" + name] = mask
        for name, code in _FATES:
            info[name] = np.zeros(self.num_envs) if fate is None else (fate == code).astype(np.float64)
            info["_" + name] = mask
        return info

    def _final(self, rows: Array, fate: Array) -> dict[str, Any]:
        observations = np.full(self.num_envs, None, dtype=object)
        for row in np.nonzero(rows)[0]:
            observations[row] = self.plant.observation[row].copy()
        last = {
            key: rows.copy() if key.startswith("_") else np.where(rows, value, 0.0)
            for key, value in self._infos(fate).items()
        }
        return {
            "final_obs": observations,
            "_final_obs": rows.copy(),
            "final_info": last,
            "_final_info": rows.copy(),
        }

    def _show_human(self) -> None:
        if self.render_mode == "human":
            self._window = _shown(self._window, self._traces[0], self.metadata["render_fps"])


def _shown(window: HumanWindow | None, traces: _Traces, fps: int) -> HumanWindow:
    from heave_env import render

    if window is None:
        window = render.HumanWindow(fps=fps)
    window.show(render.draw_frame(traces.frame_data()))
    return window


class HeaveEnv(gym.Env):
    """One heave-compensation environment: a batch of one."""

    metadata: dict[str, Any] = {"render_modes": RENDER_MODES, "render_fps": 10}

    def __init__(
        self,
        scenario: str | Path | Scenario = "sea_state_5",
        *,
        render_mode: str | None = None,
        dtype: str = "float64",
        info: bool = True,
        information_set: str | None = None,
        overrides: dict[str, Any] | None = None,
    ) -> None:
        """Builds the environment; the arguments are those of `HeaveVectorEnv`.

        Raises:
            ValueError: If an argument is impossible.
        """
        _check_render_mode(render_mode)
        self.scenario = chosen_scenario(scenario, information_set, overrides)
        self.plant = Plant(self.scenario, 1, dtype=dtype, keeps_tensions=render_mode is not None)
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": max(1, round(1.0 / self.scenario.control_dt))}
        self.observation_space = observation_space(self.scenario)
        self.action_space = action_space()
        self._info = info
        self._columns = [(name, CHANNEL_NAMES.index(name)) for name in channel_names(self.scenario)]
        self._known = frozenset(name for name, _ in (*self._columns, *_FATES))
        self._every = np.ones(1, dtype=np.bool_)
        self._steps = 0
        self._seeded = False
        self._finished = True
        self._n_steps = self.plant.n_steps
        self._copy_observation = self.plant.observation[0].copy
        self._traces = _Traces(self.plant, 0) if render_mode is not None else None
        self._window: HumanWindow | None = None

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Of a copy: it shows what its own plant observes."""
        self.__dict__.update(state)
        self._copy_observation = self.plant.observation[0].copy

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begins an episode: of a new seed, or the next of the seed in force."""
        super().reset(seed=seed)
        if seed is None and not self._seeded:
            seed = int(self.np_random.integers(2**31))
        seeds = None if seed is None else np.array([seed], dtype=np.uint64)
        self.plant.begin(self._every, seeds)
        self._seeded = True
        self._steps = 0
        self._finished = False
        if self._traces is not None:
            self._traces.restart()
            self._show_human()
        return self._copy_observation(), self._infos(RUNNING)

    def step(self, action: Any) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Advances by one control step under an action of shape (1,).

        Raises:
            ValueError: If the action has another shape or is no number.
        """
        if self._finished:
            raise gym.error.ResetNeeded("the episode has not begun, or is over: call reset() before step()")
        # The usual action takes the short way: checking one number with array functions costs microseconds.
        try:
            (value,) = action.tolist()
            is_finite = math.isfinite(value)
        except (AttributeError, TypeError, ValueError):
            value, is_finite = checked_actions(action, (1,)).item(), True
        if not is_finite:
            raise ValueError(f"action must be finite numbers in [-1, 1], got {value}")
        reward = self.plant.advance_one(value)
        self._steps = steps = self._steps + 1
        if reward != reward or steps >= self._n_steps or self._traces is not None:
            return self._step_with_end()
        # The usual step: the episode goes on.
        return self._copy_observation(), reward, False, False, self._infos(RUNNING) if self._info else {}

    def _step_with_end(self) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """The rest of a step that may be an episode's last, or is drawn."""
        reward, fate = self.plant.outcome_of_one()
        terminated = fate != RUNNING
        truncated = self._steps >= self._n_steps and not terminated
        if terminated or truncated:
            self._finished = True
        if self._traces is not None:
            self._traces.record()
            self._show_human()
        return self._copy_observation(), reward, terminated, truncated, self._infos(fate)

    def render(self) -> Any:
        """A frame (uint8, (480, 640, 3)), a string for "ansi", or None for "human"."""
        if self._traces is None:
            return None
        if self._steps == 0 and self._finished:
            raise gym.error.ResetNeeded("call reset() before render()")
        return None if self.render_mode == "human" else _draw(self._traces, self.render_mode)

    def close(self) -> None:
        """Closes the window."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def _infos(self, fate: int) -> dict[str, Any]:
        if not self._info:
            return {}
        diverged = 1.0 if fate == DIVERGED else 0.0
        return StepInfo.of(diverged, self._known, self._made_info, self.plant.channel_block(), fate)

    def _made_info(self, block: Array, fate: int) -> dict[str, Any]:
        values = block.tolist()
        info = {name: values[column] for name, column in self._columns}
        for name, code in _FATES:
            info[name] = 1.0 if fate == code else 0.0
        return info

    def _show_human(self) -> None:
        if self.render_mode == "human" and self._traces is not None:
            self._window = _shown(self._window, self._traces, self.metadata["render_fps"])
