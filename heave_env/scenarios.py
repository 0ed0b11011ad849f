"""Named operations: parameters, solver, sensors, task and clock; to and from YAML.

A scenario is data. `load("thesis_cable")` gives a named one, `read("mine.yaml")` a user's own, and
`dataclasses.replace` or `with_value` one that differs, `load("thesis_cable@rougher")` a variant, on which
what was designed or trained for `thesis_cable` acts unchanged. Numbers of an operation are written here
and nowhere else.
"""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import numpy as np

from heave_env import document
from heave_env.parameters import (
    GRAVITY,
    SEAWATER_DENSITY,
    Cable,
    Compensator,
    Draw,
    LinearPayload,
    Payload,
    PayOut,
    SeaState,
    Vessel,
    VesselTable,
    Winch,
    name_hint,
    peak_omega_of_zero_crossing_period,
    require,
    require_integer,
    require_number,
)
from heave_env.rao import table_path
from heave_env.ropes import steel_wire_rope
from heave_env.sensors import (
    CABLE_CHANNELS,
    CHANNELS,
    COMPENSATOR_CHANNELS,
    INFORMATION_SETS,
    SENSOR_ERRORS,
    Sensor,
    acoustic_depth,
    load_cell,
    motion_reference_unit,
    winch_encoder,
)
from heave_env.spectra import modal_omega
from heave_env.task import Task
from heave_env.variants import VARIANTS, Nominal, NoSuchVariantError
from heave_env.vessel import boom_tip_lines, boom_tip_size

STARTS = ("hanging", "compensated")
DRAWN_PARTS = (
    "sea_state",
    "vessel",
    "winch",
    "compensator",
    "cable",
    "payload",
    "linear_payload",
    "pay_out",
    "length",
    "sensors",
)
"""Parts of a scenario whose numbers may be uncertain."""
NOT_DRAWN = (
    "n_components",
    "command_range",
    "delay",
    "scale",
    "offset",
    *SENSOR_ERRORS,
)
"""Numbers of theirs that may not: they say how much there is, or what actions and observations mean."""
NOMINAL_PARTS = (
    *DRAWN_PARTS,
    "vessel_table",
    "uncertainty",
    "task",
    "n_elements",
    "n_substeps",
    "n_iterations",
)
"""Parts of a scenario of which the plant may be another than controllers know."""
LAYOUT = ("command_range", "channel", "scale", "offset", "parameter")
"""Values of theirs that say what actions and observations mean."""
DEFAULT_HISTORY_LAGS = (0, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48)
"""Control steps back whose measurements `sensors_history` holds."""


def whole_number_of(interval: float, step: float) -> int | None:
    """How many `step`s make `interval`, or None if it is no whole number of them."""
    count = round(interval / step)
    return count if math.isclose(count * step, interval, rel_tol=1e-9, abs_tol=1e-12) else None


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """One operation: sea, vessel, winch, cable and payload (or their linear model), sensors and task."""

    name: str
    """The name of the scenario, in lower case with underscores."""
    description: str = ""
    """What it is for, in a sentence or two."""
    tags: tuple[str, ...] = ()
    """Groups that the scenario belongs to."""
    version: int = 0
    """Rises when a change alters results."""
    control_dt: float = 0.1
    """Control step [s]: one action per step."""
    duration: float = 400.0
    """Length of an episode [s]; a whole number of control steps."""
    n_substeps: int = 2
    """Solver steps per control step [-]."""
    n_elements: int = 20
    """Elements of the cable [-]."""
    n_iterations: int = 1
    """Newton iterations of each solver step [-]; slack wants 6."""
    start: str = "hanging"
    """Where an episode begins, the payload at rest: `hanging` from the boom tip as it is, the winch at
    zero, or `compensated`, the winch holding the payload at its still-water position."""
    length: float | None = None
    """Unstretched cable outboard at the start, sheave to payload [m]; null for a linear payload."""
    sea_state: SeaState
    vessel: Vessel | None = None
    vessel_table: VesselTable | None = None
    """The vessel by a table of responses, in place of `vessel`: what heave, roll and pitch make of the boom
    tip; null for none."""
    winch: Winch
    compensator: Compensator | None = None
    cable: Cable | None = None
    payload: Payload | None = None
    linear_payload: LinearPayload | None = None
    pay_out: PayOut = field(default_factory=PayOut)
    information_set: str = "sensors"
    """What the controller sees: `full_state` (true channels and wave-filter states), `sensors` (the
    latest measurements) or `sensors_history` (measurements at the history lags)."""
    history_lags: tuple[int, ...] = DEFAULT_HISTORY_LAGS
    """Ages of the measurements in `sensors_history`, in control steps, increasing from 0."""
    sensors: tuple[Sensor, ...]
    """Measured channels, in the order of the observation."""
    task: Task
    uncertainty: tuple[Draw, ...] = ()
    """Numbers that each episode draws for its plant; controllers are designed from those above."""
    nominal: tuple[Nominal, ...] = ()
    """Values that controllers and the observation's scales take for granted in place of those above, which
    are the plant's; empty: they know the plant's."""

    def __post_init__(self) -> None:
        self._check_clock()
        self._check_plant()
        self._check_sensors()
        self._check_uncertainty()
        self._check_nominal()

    def _check_clock(self) -> None:
        require(
            isinstance(self.name, str) and all(part.isidentifier() for part in self.name.split("@")),
            self,
            "name",
            "letters, digits and underscores, not beginning with a digit",
        )
        require_integer(self, "version", minimum=0)
        require_number(self, "control_dt", positive=True)
        require_number(self, "duration", positive=True)
        require_integer(self, "n_substeps", minimum=1)
        require_integer(self, "n_elements", minimum=1)
        require_integer(self, "n_iterations", minimum=1)
        require(self.start in STARTS, self, "start", f"one of {', '.join(STARTS)}")
        for part, step, step_name in (
            ("duration", self.control_dt, "control_dt"),
            ("winch.command_delay", self.solver_dt, "the solver's step, control_dt / n_substeps"),
        ):
            value = self.winch.command_delay if "." in part else self.duration
            if whole_number_of(value, step) is None:
                raise ValueError(
                    f"Scenario.{part} must be a whole number of steps of {step:g} s ({step_name}), "
                    f"got {value!r}"
                )

    def _check_plant(self) -> None:
        require(
            (self.cable is None) != (self.linear_payload is None),
            self,
            "cable" if self.cable is None else "linear_payload",
            "given exactly when the other of cable and linear_payload is null",
        )
        if self.cable is None:
            for part in ("payload", "length"):
                require(getattr(self, part) is None, self, part, "null with a linear_payload")
            require(self.pay_out.speed == 0.0, self, "pay_out", "at rest with a linear_payload")
            require(self.task.landing_depth is None, self.task, "landing_depth", "null with a linear_payload")
            require(self.task.tension_limit is None, self.task, "tension_limit", "null with a linear_payload")
            require(
                self.compensator is None,
                self,
                "compensator",
                "null with a linear_payload, which has no tension",
            )
            for key in ("power_limit", "torque_limit", "efficiency", "regeneration"):
                own = Winch.__dataclass_fields__[key].default
                without = f"{'null' if own is None else own} with a linear_payload, which has no tension"
                require(getattr(self.winch, key) == own, self.winch, key, without)
        else:
            require(self.payload is not None, self, "payload", "given with a cable")
            require_number(self.payload, "submerged_weight", positive=True)
            require_number(self.cable, "submerged_weight", non_negative=True)
            require(self.length is not None, self, "length", "a positive number with a cable")
            require_number(self, "length", positive=True)
            shortest = self.initial_length + min(
                0.0, math.copysign(self.pay_out.distance, self.pay_out.speed)
            )
            require(
                shortest > self.winch_reach,
                self,
                "length",
                f"longer than what recovery and the winch's reach ({self.winch_reach:g} m) can haul in",
            )
            massless = self.cable.inertia_per_length == 0.0
            require(
                not massless or self.n_elements == 1,
                self,
                "n_elements",
                "1 for a massless cable (a spring)",
            )
            self._check_tensions()
            self._check_landing()
        self._check_vessel()

    def _check_tensions(self) -> None:
        assert self.cable is not None
        hanging, strength = self.static_tension, self.cable.breaking_strength
        if strength is not None and strength <= hanging:
            raise ValueError(
                f"Cable.breaking_strength {strength:g} N contradicts Payload.submerged_weight and length, "
                f"whose still load is {hanging:g} N; give a stronger cable or a lighter payload"
            )
        allowed = self.task.tension_limit
        if allowed is not None and allowed <= hanging:
            raise ValueError(
                f"Task.tension_limit {allowed:g} N contradicts Payload.submerged_weight and length, whose "
                f"still load is {hanging:g} N; raise the limit above it"
            )
        rod = self.compensator
        if rod is not None and rod.force is not None:
            half = 0.5 * rod.stroke / rod.gas_length
            least, most = (rod.force * (1.0 + end) ** -rod.polytropic_exponent for end in (half, -half))
            if not least < hanging < most:
                raise ValueError(
                    f"Compensator.force {rod.force:g} N contradicts Payload.submerged_weight and length: "
                    f"under the still load of {hanging:g} N the rod lies on its stop, for its stroke spans "
                    f"{least:g} to {most:g} N; leave force at null"
                )

    def _check_landing(self) -> None:
        bed = self.task.landing_depth
        if bed is None:
            return
        if bed <= self.initial_length:
            raise ValueError(
                f"Task.landing_depth {bed:g} m contradicts length {self.initial_length:g} m: the payload "
                "would begin below the bed; shorten the cable"
            )
        deepest = self.initial_length + max(0.0, math.copysign(self.pay_out.distance, self.pay_out.speed))
        reached = deepest + self.static_stretch(deepest) + self.winch_reach
        if self.sea_state.kind != "recorded" and reached < bed:
            raise ValueError(
                f"Task.landing_depth {bed:g} m contradicts pay_out.distance and length, which bring the "
                f"payload no deeper than {reached:g} m; pay out more"
            )

    def _check_vessel(self) -> None:
        sea = self.sea_state
        for part in ("vessel", "vessel_table") if sea.kind == "recorded" else ():
            if getattr(self, part) is not None:
                raise ValueError(
                    f"Scenario.{part} must be null when sea_state.kind is recorded: the recording moves the "
                    "boom tip itself"
                )
        if sea.kind == "recorded" and self.pay_out.speed != 0.0:
            raise ValueError(
                f"Scenario.pay_out at {self.pay_out.speed:g} m/s contradicts sea_state.kind recorded: what "
                "is paid out is the recording's column payout; set pay_out.speed and pay_out.distance to 0"
            )
        if self.vessel_table is None:
            return
        if self.vessel is not None:
            raise ValueError(
                "Scenario.vessel_table contradicts Scenario.vessel: both carry the sea to the boom tip; set "
                "one of them to null"
            )
        if sea.kind == "shaping_filter" and sea.filter == "thesis":
            raise ValueError(
                "SeaState.filter 'thesis' contradicts Scenario.vessel_table, whose boom tip has a spectrum "
                "of its own; set sea_state.filter to fitted or sea_state.kind to random_phase"
            )

    def _check_sensors(self) -> None:
        require(
            self.information_set in INFORMATION_SETS,
            self,
            "information_set",
            f"one of {', '.join(INFORMATION_SETS)}",
        )
        require(len(self.sensors) > 0, self, "sensors", "a list of at least one sensor")
        channels = [sensor.channel for sensor in self.sensors]
        require(len(set(channels)) == len(channels), self, "sensors", "a list without repeated channels")
        for sensor in self.sensors:
            if whole_number_of(sensor.delay, self.control_dt) is None:
                raise ValueError(
                    f"Sensor.delay must be a whole number of control steps of {self.control_dt:g} s, "
                    f"got {sensor.delay!r}"
                )
            if sensor.interval is not None and whole_number_of(sensor.interval, self.control_dt) is None:
                raise ValueError(
                    f"Sensor.interval must be a whole number of control steps of {self.control_dt:g} s, "
                    f"got {sensor.interval!r}"
                )
            corner = sensor.high_pass_omega
            if corner is not None and corner * self.control_dt >= math.pi:
                raise ValueError(
                    f"Sensor.high_pass_omega {corner:g} rad/s contradicts control_dt {self.control_dt:g} s, "
                    f"which shows nothing above {math.pi / self.control_dt:g} rad/s; lower it"
                )
            if self.compensator is None and sensor.channel in COMPENSATOR_CHANNELS:
                raise ValueError(
                    f"Sensor.channel {sensor.channel!r} contradicts compensator, which is null: give one, or "
                    "leave the sensor out"
                )
            if self.cable is None and sensor.channel in CABLE_CHANNELS:
                raise ValueError(
                    f"Sensor.channel {sensor.channel!r} contradicts linear_payload: that plant has no cable"
                )
        lags = self.history_lags
        require(
            len(lags) > 0
            and all(isinstance(lag, int) and lag >= 0 for lag in lags)
            and all(a < b for a, b in pairwise(lags)),
            self,
            "history_lags",
            "increasing whole numbers of control steps, not negative",
        )

    def _check_uncertainty(self) -> None:
        paths = [draw.parameter for draw in self.uncertainty]
        for draw in self.uncertainty:
            path = draw.parameter
            part = path.split(".")[0]
            if paths.count(path) > 1:
                raise ValueError(f"Scenario.uncertainty draws {path!r} twice; draw it once")
            if part not in DRAWN_PARTS or path.rsplit(".", 1)[-1] in NOT_DRAWN:
                raise ValueError(
                    f"Scenario.uncertainty cannot draw {path!r}; it may draw numbers of "
                    f"{', '.join(DRAWN_PARTS)}, but no {', no '.join(NOT_DRAWN)}"
                )
            if self.sea_state.kind == "recorded" and part in ("sea_state", "vessel"):
                raise ValueError(
                    f"Scenario.uncertainty cannot draw {path!r}, since sea_state.kind is recorded: the "
                    "recording is what it is"
                )
            if path.rsplit(".", 1)[-1] in _ACROSS.get(part, ()):
                raise ValueError(
                    f"Scenario.uncertainty cannot draw {path!r}, which motion along the cable does not feel"
                )
            if part == "compensator" and self.compensator is None:
                raise ValueError(f"Scenario.uncertainty cannot draw {path!r}, since compensator is null")
            if part == "vessel" and self.vessel is None:
                raise ValueError(f"Scenario.uncertainty cannot draw {path!r}, since vessel is null")
            if part == "sensors" and self.information_set == "full_state":
                raise ValueError(
                    f"Scenario.uncertainty cannot draw {path!r} with information_set full_state, which has "
                    "no sensors"
                )
            for end in (draw.low, draw.high):
                try:
                    self.with_drawn({path: end})
                except ValueError as error:
                    raise ValueError(f"Scenario.uncertainty of {path!r} reaches {end!r}: {error}") from error

    def _check_nominal(self) -> None:
        for item in self.nominal:
            part, last = item.parameter.split(".")[0], item.parameter.rsplit(".", 1)[-1]
            if part not in NOMINAL_PARTS or last in LAYOUT:
                raise ValueError(
                    f"Scenario.nominal cannot replace {item.parameter!r}; it may replace values of "
                    f"{', '.join(NOMINAL_PARTS)}, but no {', no '.join(LAYOUT)}"
                )
            if self.information_set == "full_state" and part in ("sea_state", "vessel", "vessel_table"):
                raise ValueError(
                    f"Scenario.nominal of {item.parameter!r} contradicts information_set full_state, which "
                    "shows the states of the wave filter that controllers know; choose sensors or "
                    "sensors_history"
                )
        if self.nominal:
            try:
                basis = self.design_basis
            except ValueError as error:
                raise ValueError(f"Scenario.nominal does not make a scenario: {error}") from error
            assert basis.observation_names == self.observation_names

    @cached_property
    def design_basis(self) -> Scenario:
        """What controllers are designed for and observations scaled by: the nominal values put back."""
        if not self.nominal:
            return self
        plain = dataclasses.replace(self, nominal=())
        return with_values(plain, {item.parameter: item.value for item in self.nominal})

    def with_drawn(self, values: dict[str, float]) -> Scenario:
        """The scenario of one episode: the given numbers in place of its own, and none uncertain.

        A command delay is rounded to whole solver steps.
        """
        mapping = to_mapping(self)
        mapping["uncertainty"] = mapping["nominal"] = []
        for path, value in values.items():
            if path == "winch.command_delay":
                value = round(value / self.solver_dt) * self.solver_dt
            document.put(mapping, path, value)
        return from_mapping(mapping)

    @property
    def varies(self) -> frozenset[str]:
        """Parts of the scenario of which an episode draws a number."""
        return frozenset(draw.parameter.split(".")[0] for draw in self.uncertainty)

    # The clock -----------------------------------------------------------------------------------

    @property
    def n_steps(self) -> int:
        """Control steps of an episode [-]."""
        return round(self.duration / self.control_dt)

    @property
    def solver_dt(self) -> float:
        """Time step of the solver [s]."""
        return self.control_dt / self.n_substeps

    @property
    def delay_substeps(self) -> int:
        """Command delay in solver steps [-]."""
        return round(self.winch.command_delay / self.solver_dt)

    @property
    def n_pending(self) -> int:
        """Commands given but not yet fully arrived at the winch at a control instant [-]."""
        return -(-self.delay_substeps // self.n_substeps)

    @property
    def n_shown_pending(self) -> int:
        """Pending commands that the observation holds: those of the longest delay that is known of [-]."""
        return self.design_basis.n_held_pending

    @property
    def n_held_pending(self) -> int:
        """Pending commands of the longest delay that may be drawn [-]."""
        longest = max(
            [self.winch.command_delay]
            + [draw.high for draw in self.uncertainty if draw.parameter == "winch.command_delay"]
        )
        return -(-round(longest / self.solver_dt) // self.n_substeps)

    # The plant -----------------------------------------------------------------------------------

    @property
    def boom_tip_vessel(self) -> Vessel | VesselTable | None:
        """What carries the sea to the boom tip: the vessel's filter, its table, or neither."""
        return self.vessel if self.vessel_table is None else self.vessel_table

    @property
    def is_linear(self) -> bool:
        """Whether the plant is the linear payload model."""
        return self.linear_payload is not None

    @property
    def is_hookean(self) -> bool:
        """Whether the cable follows Hooke's law in every episode, or there is none."""
        drawn = {draw.parameter for draw in self.uncertainty}
        return (self.cable is None or self.cable.is_hookean) and not drawn & _BEYOND_HOOKE

    @property
    def initial_length(self) -> float:
        """Unstretched length outboard at the start [m]; zero for a linear payload."""
        return float(self.length) if self.length is not None else 0.0

    @property
    def winch_reach(self) -> float:
        """Largest winch displacement that a command can bring about [m]."""
        stroke = self.winch.stroke_limit
        return self.winch.command_range if stroke is None else min(stroke, self.winch.command_range)

    def static_stretch(self, length: float) -> float:
        """Elongation of the cable hanging in still water, L (w2 + w1 L / 2) / EA by Hooke's law [m]."""
        if self.cable is None or self.payload is None:
            return 0.0
        if not self.cable.is_hookean:
            from heave_env.cable.axial import hanging_elongation

            return float(hanging_elongation(self.cable, self.payload, length, self.n_elements))
        weight = self.payload.submerged_weight + 0.5 * self.cable.submerged_weight * length
        return length * weight / self.cable.axial_stiffness

    @property
    def static_tension(self) -> float:
        """Sheave tension hanging in still water at the initial length [N]; zero if linear."""
        if self.cable is None or self.payload is None:
            return 0.0
        return self.payload.submerged_weight + self.cable.submerged_weight * self.initial_length

    @cached_property
    def uncontrolled_payload_std(self) -> float:
        """Standard deviation of the payload's heave with the winch locked, by linear theory [m].

        From the boom tip's spectrum and the closed-form response at the initial length, drag
        linearised for the motion that comes out of it. An estimate where the cable goes slack.
        """
        from heave_env.cable.closed_form import linearised_payload_std

        omega, variance = boom_tip_lines(self.sea_state, self.boom_tip_vessel)
        if self.linear_payload is not None:
            a, b = self.linear_payload.inertia, self.linear_payload.damping
            response = 1.0 / (1.0 - a * omega**2 + 1j * b * omega)
            return math.sqrt(float(np.sum(variance * np.abs(response) ** 2)))
        assert self.cable is not None and self.payload is not None
        return linearised_payload_std(omega, variance, self.cable, self.payload, self.initial_length)

    @property
    def uncontrolled_cost(self) -> float:
        """Mean stage cost with the winch locked, by linear theory; in a calm sea that of full command [-]."""
        if self.sea_state.kind == "calm":
            return self.task.command_weight * self.winch.command_range**2
        return self.task.position_weight * self.uncontrolled_payload_std**2

    # What is seen --------------------------------------------------------------------------------

    @property
    def boom_tip_scale(self) -> float:
        """Characteristic boom-tip heave, about one standard deviation [m]."""
        return boom_tip_size(self.sea_state, self.boom_tip_vessel) or 1.0

    def channel_scale(self, channel: str) -> tuple[float, float]:
        """Scale and offset by which an observed channel is made of order one [unit of the channel]."""
        if self.nominal:
            return self.design_basis.channel_scale(channel)
        for sensor in self.sensors:
            if sensor.channel == channel and sensor.scale is not None:
                return sensor.scale, sensor.offset
        if channel == "sheave_tension":
            return 0.1 * self.static_tension, self.static_tension
        if channel in COMPENSATOR_CHANNELS and self.compensator is not None:
            rate = modal_omega(self.sea_state) if channel.endswith("rate") else 1.0
            return 0.5 * self.compensator.stroke * rate, 0.0
        if channel == "length":
            return max(self.initial_length, 1.0), self.initial_length
        rate = modal_omega(self.sea_state) if channel.endswith("rate") else 1.0
        offset = next((sensor.offset for sensor in self.sensors if sensor.channel == channel), 0.0)
        return self.boom_tip_scale * rate, offset

    @property
    def n_filter_states(self) -> int:
        """States of the wave (and vessel) filter that a shaping-filter sea has [-]."""
        if self.sea_state.kind != "shaping_filter":
            return 0
        return self.sea_state.filter_order + (0 if self.vessel is None else 2)

    @cached_property
    def observed_sensors(self) -> tuple[Sensor, ...]:
        """The sensors that the information set reads, with their scales filled in."""
        if self.information_set == "full_state":
            channels = [
                channel
                for channel in CHANNELS
                if not (self.is_linear and channel in CABLE_CHANNELS)
                and not (channel in COMPENSATOR_CHANNELS and self.compensator is None)
                and not (channel == "length" and self.pay_out.speed == 0.0)
            ]
            bare = [Sensor(channel=channel) for channel in channels]
        else:
            bare = list(self.sensors)
        filled = []
        for sensor in bare:
            scale, offset = self.channel_scale(sensor.channel)
            filled.append(dataclasses.replace(sensor, scale=scale, offset=offset))
        return tuple(filled)

    @property
    def observed_lags(self) -> tuple[int, ...]:
        """Ages of the samples in the observation, in control steps."""
        return self.history_lags if self.information_set == "sensors_history" else (0,)

    @property
    def observed_filter_states(self) -> int:
        """Wave-filter states at the observation's end but for the pending commands [-]."""
        return self.n_filter_states if self.information_set == "full_state" else 0

    @property
    def observed_draws(self) -> tuple[str, ...]:
        """Drawn parameters in the observation, each -1 to 1 over its range: all of them in full_state."""
        if self.information_set != "full_state":
            return ()
        return tuple(draw.parameter for draw in self.uncertainty)

    @cached_property
    def observation_names(self) -> tuple[str, ...]:
        """One name per entry of the observation: lag by lag the channels, filter states, draws, commands."""
        names = [
            sensor.channel if lag == 0 else f"{sensor.channel}[-{lag}]"
            for lag in self.observed_lags
            for sensor in self.observed_sensors
        ]
        names += [f"filter_state_{i}" for i in range(self.observed_filter_states)]
        names += [f"drawn_{path}" for path in self.observed_draws]
        names += [f"pending_command_{i + 1}" for i in range(self.n_shown_pending)]
        return tuple(names)

    # Identity ------------------------------------------------------------------------------------

    @cached_property
    def fingerprint(self) -> str:
        """Hash of everything that alters results: not of name, description and tags."""
        content = to_mapping(self)
        for label in ("name", "description", "tags"):
            content.pop(label)
        for part, keys in _ACROSS.items():
            for key in keys if content[part] is not None else ():
                content[part].pop(key)
        if self.vessel_table is None:
            content.pop("vessel_table")
        else:
            content["vessel_table"]["table"] = _digest(table_path(self.vessel_table))
        if self.sea_state.spectrum_file is not None:
            content["sea_state"]["spectrum_file"] = _digest(Path(self.sea_state.spectrum_file))
        # What came later says nothing while it is off, so that older results keep their fingerprint.
        for part, (kind, added) in _LATER.items():
            place = content[part] if part else content
            defaults = {item.name: item.default for item in dataclasses.fields(kind)}
            for key in added if place is not None else ():
                if place[key] == defaults[key] or place[key] == []:
                    place.pop(key)
        plain = {item.name: item.default for item in dataclasses.fields(Sensor)}
        for sensor in content["sensors"]:
            for key in SENSOR_ERRORS:
                if sensor[key] == plain[key]:
                    sensor.pop(key)
        canonical = json.dumps(content, sort_keys=True)
        return hashlib.sha256(canonical.encode()).hexdigest()[:16]

    @property
    def environment_id(self) -> str:
        """The id that Gymnasium knows a named scenario by."""
        return f"heave_env/{self.name}-v{self.version}"


_ACROSS = {
    "cable": ("normal_drag_coefficient", "normal_added_mass_coefficient"),
    "payload": ("lateral_added_mass", "lateral_drag_area"),
}
"""What only motion across the cable asks for, which this plant does not have."""
_BEYOND_HOOKE = {"cable.quadratic_hardening", "cable.cubic_hardening", "cable.relaxing_stiffness"}
"""Numbers that take a rope beyond Hooke's law when they are not zero."""
_LATER: dict[str, tuple[type, tuple[str, ...]]] = {
    "": (Scenario, ("uncertainty", "compensator", "nominal")),
    "cable": (
        Cable,
        ("quadratic_hardening", "cubic_hardening", "relaxing_stiffness", "relaxation_time"),
    ),
    "sea_state": (
        SeaState,
        (
            "spectrum",
            "peak_enhancement",
            "shape",
            "second_wave_height",
            "second_peak_omega",
            "second_shape",
            "spectrum_file",
            "spectrum_reader",
            "spectrum_record",
            "filter",
            "filter_order",
        ),
    ),
    "winch": (
        Winch,
        (
            "natural_omega",
            "damping_ratio",
            "command_step",
            "dead_band",
            "power_limit",
            "torque_limit",
            "drum_radius",
            "drum_inertia",
            "efficiency",
            "regeneration",
        ),
    ),
    "task": (Task, ("energy_weight",)),
}
"""Keys by part, with the class that knows their defaults, that scenarios have gained since version 0.1."""


def _digest(path: Path) -> str:
    """Hash of a file's content, on which results depend, not on where it lies; its path if unreadable."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return str(path)


# To and from mappings and YAML -------------------------------------------------------------------


def to_mapping(scenario: Scenario) -> dict[str, Any]:
    """The scenario as nested plain dictionaries, lists, strings and numbers."""
    return document.to_mapping(scenario)


def from_mapping(mapping: Any) -> Scenario:
    """The scenario of a nested mapping, strictly: no unknown key, no missing one.

    Raises:
        ValueError: If a key is unknown or missing, or a value is impossible.
    """
    return cast(Scenario, document.from_mapping(Scenario, mapping))


def with_value(scenario: Scenario, path: str, value: Any) -> Scenario:
    """A copy with the value at a dotted path replaced, such as `winch.time_constant`.

    `sensors` entries are reached by channel: `sensors.payload_heave.noise_std`.

    Raises:
        ValueError: If the path leads nowhere or the value is impossible.
    """
    return cast(Scenario, document.with_value(scenario, path, value))


def with_values(scenario: Scenario, values: dict[str, Any]) -> Scenario:
    """A copy with the values at several dotted paths replaced at once: only the whole must make sense.

    Raises:
        ValueError: If a path leads nowhere or a value is impossible.
    """
    return cast(Scenario, document.with_values(scenario, values))


def to_yaml(scenario: Scenario) -> str:
    """The scenario as YAML, each key explained by a comment; `read` takes it back unchanged."""
    units = "Units are SI; heave is positive up, pay-out outwards."
    return document.to_yaml(scenario, f"heave_env scenario {scenario.name}. {units}")


_FILES = (("sea_state", "recording"), ("sea_state", "spectrum_file"), ("vessel_table", "table"))


def read(path: str | Path) -> Scenario:
    """Reads a scenario from a YAML file.

    Relative files (`sea_state.recording`, `sea_state.spectrum_file`, `vessel_table.table` unless it names a
    shipped one) are looked up beside the YAML file.

    Raises:
        ValueError: If the file cannot be read, is no YAML, or holds no valid scenario.
    """
    path = Path(path)
    mapping = document.read_mapping(path, "scenario")
    try:
        for part, key in _FILES:
            owner = mapping.get(part) if isinstance(mapping, dict) else None
            named = owner.get(key) if isinstance(owner, dict) else None
            # A table's bare name is that of a shipped one.
            shipped = part == "vessel_table" and isinstance(named, str) and named.isidentifier()
            if isinstance(owner, dict) and isinstance(named, str) and not shipped:
                owner[key] = str((path.parent / named).resolve())
        return from_mapping(mapping)
    except ValueError as error:
        raise ValueError(f"{str(path)!r}: {error}") from error


# The registry ------------------------------------------------------------------------------------

REGISTRY: dict[str, Callable[[], Scenario]] = {}
"""Functions that build the named scenarios, by name."""


def scenario(*tags: str) -> Callable[[Callable[[], Scenario]], Callable[[], Scenario]]:
    """Registers a function as the scenario of its own name, described by its docstring."""

    def register(build: Callable[[], Scenario]) -> Callable[[], Scenario]:
        name = build.__name__

        def named() -> Scenario:
            description = " ".join((inspect.getdoc(build) or "").split())
            return dataclasses.replace(build(), name=name, description=description, tags=tags)

        REGISTRY[name] = named
        return build

    return register


def names(tag: str | None = None) -> list[str]:
    """Names of the registered scenarios, or of those that carry a tag."""
    return [name for name, build in REGISTRY.items() if tag is None or tag in build().tags]


def load(name: str | Path | Scenario) -> Scenario:
    """A scenario by name, by the path of a YAML file, or as it is.

    Either may be followed by @ and a variant (`heave_env.variants`), or several: `sea_state_5@rougher@later`.

    Raises:
        ValueError: If there is neither such a name nor such a file, or no such variant.
    """
    if isinstance(name, Scenario):
        return name
    text = str(name)
    if "@" in text and not Path(text).is_file():
        text, *marks = text.split("@")
        chosen = load(text)
        for mark in marks:
            chosen = varied(chosen, mark)
        return chosen
    if text in REGISTRY:
        return REGISTRY[text]()
    if text.endswith((".yaml", ".yml")) or Path(text).is_file():
        return read(text)
    hint = name_hint(text, REGISTRY, f"known: {', '.join(REGISTRY)}, or a .yaml file")
    raise ValueError(f"unknown scenario {text!r}; {hint}")


# Variants ----------------------------------------------------------------------------------------


def nominal(scenario: Scenario) -> Scenario:
    """What controllers are designed for: `scenario.design_basis`."""
    return scenario.design_basis


def on_plant_of(basis: Scenario, plant: Scenario) -> Scenario:
    """The plant of one scenario, observed and commanded as in another, which designs are made for.

    Args:
        basis: What controllers and agents know.
        plant: What they meet: other values of the same parts.

    Raises:
        ValueError: If the two differ in more than values of the plant.
    """
    known, met = (to_mapping(dataclasses.replace(item, nominal=())) for item in (basis, plant))
    for label in ("name", "description", "tags", "version"):
        known.pop(label), met.pop(label)
    found = document.differences(known, met)
    return dataclasses.replace(
        plant, nominal=tuple(Nominal(parameter=path, value=value) for path, value in found.items())
    )


def varied(scenario: Scenario, variant: str) -> Scenario:
    """A variant of a scenario: its plant is another, and all else as before.

    Raises:
        ValueError: If there is no such variant, or it makes no sense of the scenario.
    """
    if variant not in VARIANTS:
        raise ValueError(f"unknown variant {variant!r}; {name_hint(variant, VARIANTS, f'known: {_KNOWN}')}")
    basis, change = scenario.design_basis, VARIANTS[variant]
    told = " ".join((inspect.getdoc(change) or "").split())
    bare = dataclasses.replace(
        scenario,
        name=f"{scenario.name}@{variant}",
        description=f"{scenario.description} Variant {variant}: {told}",
        nominal=(),
    )
    changes = change(scenario)
    try:
        plant = with_values(bare, changes)
    except ValueError as error:
        raise NoSuchVariantError(f"scenario {scenario.name!r} has no variant {variant!r}: {error}") from error
    return on_plant_of(basis, plant)


_KNOWN = ", ".join(VARIANTS)


def variants_of(scenario: Scenario) -> list[str]:
    """Names of the variants that make sense of a scenario."""
    found = []
    for name in VARIANTS:
        try:
            varied(scenario, name)
        except NoSuchVariantError:
            continue
        found.append(name)
    return found


# Named operations --------------------------------------------------------------------------------


def _thesis_vessel() -> Vessel:
    return Vessel(natural_omega=0.393, damping_ratio=0.6, gain=0.5)


def _thesis_sea() -> SeaState:
    # 10 ft and 0.785 rad/s: sea state 5, wind about 20 knots (Huang 1992, 6.3.6).
    return SeaState(significant_wave_height=3.048, peak_omega=0.785)


def _thesis_boom_tip() -> SeaState:
    # Figure 6.10: a boom tip that follows a Pierson-Moskowitz spectrum itself.
    return SeaState(
        kind="random_phase",
        significant_wave_height=6.0,
        peak_omega=peak_omega_of_zero_crossing_period(14.0),
    )


def circular_section(diameter: float) -> float:
    """Area of a full circular section, π d² / 4 [m²]."""
    return 0.25 * math.pi * diameter**2


def _thesis_cable_and_payload() -> dict[str, Any]:
    # Huang (1992), 6.2.6. The unit's 125 t is its effective mass: added mass is in it.
    return {
        "length": 900.0,
        "cable": Cable(
            mass_per_length=7.2,
            axial_stiffness=9.09e9 * circular_section(0.047),
            submerged_weight=54.0,
            diameter=0.047,
            tangential_drag_coefficient=0.025,
        ),
        "payload": Payload(mass=125_000.0, submerged_weight=50_000.0, drag_area=1.0),
    }


def _payload_sensors(*, noise_std: float = 0.0, noise_density: float = 0.0) -> tuple[Sensor, ...]:
    return tuple(
        Sensor(channel=channel, noise_std=noise_std, noise_density=noise_density)
        for channel in ("payload_heave", "payload_heave_rate")
    )


def _exact_thesis_sensors() -> tuple[Sensor, ...]:
    # Chapter 6.2 feeds back the payload's motion and the winch's displacement, measured exactly.
    return (*_payload_sensors(), Sensor(channel="winch_displacement"))


def _survey_sensors(*, payload: float = 0.005, boom_tip: float = 0.01) -> tuple[Sensor, ...]:
    # Payload by acoustic and pressure sensors fused; boom tip by a motion reference unit; the drum's encoder.
    return (
        *_payload_sensors(noise_std=payload),
        Sensor(channel="boom_tip_heave", noise_std=boom_tip),
        Sensor(channel="boom_tip_heave_rate", noise_std=boom_tip),
        Sensor(channel="winch_displacement", noise_std=0.001),
    )


@scenario("thesis", "linear", "optimum_known")
def thesis_linear() -> Scenario:
    """The thesis's stochastic-control example (H 6.3.6): a linear payload under a Bretschneider sea, its
    position and velocity measured with white noise of density 1e-6; the optimum is known.
    """
    return Scenario(
        name="unnamed",
        sea_state=_thesis_sea(),
        vessel=_thesis_vessel(),
        winch=Winch(time_constant=1.0, command_range=2.0),
        linear_payload=LinearPayload(inertia=0.8959, damping=0.1658),
        sensors=_payload_sensors(noise_density=1e-6),
        task=Task(position_weight=554.0, command_weight=1.0),
    )


@scenario("linear", "limits", "delay")
def limits_linear() -> Scenario:
    """The linear payload in a rough sea (Hs 6 m) that asks more of the winch than its 0.265 m/s and
    0.25 m/s2 give, with 0.2 s of delay and noisy sensors on payload and boom tip.
    """
    payload, boom_tip = {"noise_std": 0.01}, {"noise_std": 0.03}
    return Scenario(
        name="unnamed",
        start="compensated",
        sea_state=dataclasses.replace(_thesis_sea(), significant_wave_height=6.0),
        vessel=_thesis_vessel(),
        winch=Winch(
            time_constant=1.0,
            command_range=4.0,
            command_delay=0.2,
            speed_limit=0.265,
            acceleration_limit=0.25,
        ),
        linear_payload=LinearPayload(inertia=0.8959, damping=0.1658),
        sensors=(
            Sensor(channel="payload_heave", **payload),
            Sensor(channel="payload_heave_rate", **payload),
            Sensor(channel="boom_tip_heave", **boom_tip),
            Sensor(channel="boom_tip_heave_rate", **boom_tip),
        ),
        task=Task(position_weight=100.0, command_weight=0.1),
    )


@scenario("linear", "energy", "delay")
def energy_linear() -> Scenario:
    """The linear payload where the winch's work has a price, whatever its sign: to follow the whole sea takes
    two thirds of what leaving the winch locked costs. With 0.2 s of delay and noisy sensors.
    """
    return Scenario(
        name="unnamed",
        start="compensated",
        sea_state=_thesis_sea(),
        vessel=_thesis_vessel(),
        winch=Winch(time_constant=1.0, command_range=2.0, command_delay=0.2),
        linear_payload=LinearPayload(inertia=0.8959, damping=0.1658),
        sensors=(
            *_payload_sensors(noise_std=0.01),
            Sensor(channel="boom_tip_heave", noise_std=0.02),
            Sensor(channel="boom_tip_heave_rate", noise_std=0.02),
        ),
        task=Task(position_weight=100.0, command_weight=0.01, energy_weight=40.0),
    )


def _spread(path: str, middle: float, share: float) -> Draw:
    return Draw(parameter=path, low=(1.0 - share) * middle, high=(1.0 + share) * middle)


def _unknown_linear(sea: SeaState, payload: LinearPayload) -> tuple[Draw, ...]:
    """What nobody knows for sure: cable and payload, winch, delay, sea and vessel."""
    vessel = _thesis_vessel()
    return (
        _spread("linear_payload.inertia", payload.inertia, 0.3),
        _spread("linear_payload.damping", payload.damping, 0.5),
        # K between 0.5 and 1.5 per second.
        Draw(parameter="winch.time_constant", low=1.0 / 1.5, high=2.0, distribution="log_uniform"),
        Draw(parameter="winch.command_delay", low=0.0, high=0.4),
        _spread("sea_state.significant_wave_height", sea.significant_wave_height, 0.3),
        _spread("sea_state.peak_omega", sea.peak_omega, 0.3),
        _spread("vessel.natural_omega", vessel.natural_omega, 0.25),
        Draw(parameter="vessel.damping_ratio", low=0.4, high=0.8),
    )


@scenario("linear", "delay")
def delay_linear() -> Scenario:
    """The linear payload with 0.2 s of delay and noisy sensors on payload and boom tip, all of it known: the
    least that any controller can reach is known too.
    """
    return Scenario(
        name="unnamed",
        start="compensated",
        sea_state=_thesis_sea(),
        vessel=_thesis_vessel(),
        winch=Winch(time_constant=1.0, command_range=4.0, command_delay=0.2),
        linear_payload=LinearPayload(inertia=0.8959, damping=0.1658),
        sensors=(
            *_payload_sensors(noise_std=0.005),
            Sensor(channel="boom_tip_heave", noise_std=0.01),
            Sensor(channel="boom_tip_heave_rate", noise_std=0.01),
        ),
        task=Task(position_weight=1e4, command_weight=1.0),
    )


@scenario("linear", "delay", "unknown")
def unknown_linear() -> Scenario:
    """The linear payload with the delay and the sensors of `delay_linear`, where nobody knows for sure the
    payload, the winch, the delay, the sea or the vessel: each episode draws them.
    """
    known = delay_linear()
    assert known.linear_payload is not None
    return dataclasses.replace(known, uncertainty=_unknown_linear(known.sea_state, known.linear_payload))


@scenario("linear", "limits", "delay", "unknown")
def limits_unknown_linear() -> Scenario:
    """The rough sea and the weak winch of `limits_linear`, with everything unknown that is in
    `unknown_linear`.
    """
    known = limits_linear()
    assert known.linear_payload is not None
    return dataclasses.replace(known, uncertainty=_unknown_linear(known.sea_state, known.linear_payload))


@scenario("thesis", "linear")
def thesis_regulator() -> Scenario:
    """The thesis's regulator (H 6.2.4-6.2.6): the linear payload with the printed a and b under an
    irregular boom tip of 6 m significant height and 14 s zero-crossing period, without delay.
    """
    return Scenario(
        name="unnamed",
        start="compensated",
        sea_state=_thesis_boom_tip(),
        winch=Winch(time_constant=1.0, command_range=16.0),
        linear_payload=LinearPayload(inertia=7.339769, damping=0.1906759),
        sensors=_exact_thesis_sensors(),
        task=Task(position_weight=1e4, command_weight=1.0),
    )


@scenario("thesis", "linear", "delay")
def thesis_regulator_delay() -> Scenario:
    """The thesis's regulator (H 6.2.5-6.2.6) with 0.2 s of delay between command and winch."""
    return dataclasses.replace(
        thesis_regulator(),
        winch=Winch(time_constant=1.0, command_range=16.0, command_delay=0.2),
        task=Task(position_weight=1e5, command_weight=1.0),
    )


@scenario("thesis", "cable")
def thesis_cable() -> Scenario:
    """The thesis's 900 m cable with its 125 t unit (H 6.2.6) under the irregular boom tip of figure 6.10;
    the cable carries compression, as in the thesis, so its tension may be negative.
    """
    return Scenario(
        name="unnamed",
        start="compensated",
        sea_state=_thesis_boom_tip(),
        winch=Winch(time_constant=1.0, command_range=16.0),
        sensors=_exact_thesis_sensors(),
        task=Task(position_weight=1e4, command_weight=1.0),
        **_thesis_cable_and_payload(),
    )


@scenario("cable", "delay", "demo")
def sea_state_5() -> Scenario:
    """The thesis's 900 m cable under its sea state 5 and vessel (H 6.3.6), with 0.2 s of command delay
    and noisy sensors on payload, boom tip and winch.
    """
    return Scenario(
        name="unnamed",
        start="compensated",
        sea_state=_thesis_sea(),
        vessel=_thesis_vessel(),
        winch=Winch(time_constant=1.0, command_range=2.0, command_delay=0.2),
        sensors=_survey_sensors(),
        task=Task(position_weight=1e4, command_weight=1.0),
        **_thesis_cable_and_payload(),
    )


@scenario("cable", "delay", "compensator")
def hybrid() -> Scenario:
    """`sea_state_5` with a passive compensator in series with the winch: gas spring and damper carry the load
    and take most of the motion, the winch what is left. The drive's energy counts.
    """
    active = sea_state_5()
    return dataclasses.replace(
        active,
        winch=dataclasses.replace(active.winch, efficiency=0.7, regeneration=0.3),
        # 80 m of gas column in accumulators, a pressure ratio of 1.07 over 4 m of stroke.
        compensator=Compensator(gas_volume=4.0, piston_area=0.05, stroke=4.0, damping=2e3),
    )


@scenario("thesis", "cable", "pay_out", "slack")
def lowering() -> Scenario:
    """Deployment from 50 m at 2 m/s (H 3.3.5): the lengthening cable changes the payload's response on the
    way down. Weights, drag and sea are ours, for the thesis does not print them.
    """
    return Scenario(
        name="unnamed",
        start="compensated",
        n_substeps=5,
        n_iterations=6,
        sea_state=SeaState(significant_wave_height=2.5, peak_omega=0.838),
        vessel=_thesis_vessel(),
        winch=Winch(time_constant=1.0, command_range=2.0),
        length=50.0,
        cable=Cable(
            mass_per_length=7.2,
            axial_stiffness=9.05e9 * circular_section(0.047),
            submerged_weight=54.0,
            diameter=0.047,
            tangential_drag_coefficient=0.025,
            axial_damping=0.005 * 9.05e9 * circular_section(0.047),
            tension_only=True,
        ),
        payload=Payload(mass=5_000.0, added_mass=8_000.0, submerged_weight=35_000.0, drag_area=4.0),
        pay_out=PayOut(speed=2.0, start=20.0, distance=700.0, ramp=10.0),
        sensors=(*_survey_sensors(), Sensor(channel="length")),
        task=Task(position_weight=1e4, command_weight=1.0),
    )


@scenario("cable", "slack")
def snap() -> Scenario:
    """Berteaux's example 9.5: an instrument package on 3000 ft of 3/8 inch wire, the sheave moving 7 ft up
    and down every 4 s; the wire goes slack and snaps taut.
    """
    foot, pound_mass, pound_force, slug = 0.3048, 0.45359237, 4.4482216152605, 14.59390294
    axial_stiffness = 1.8e6 * pound_force
    return Scenario(
        name="unnamed",
        n_substeps=5,
        n_iterations=6,
        sea_state=SeaState(
            kind="regular", significant_wave_height=2.0 * 7.0 * foot, peak_omega=2.0 * math.pi / 4.0
        ),
        winch=Winch(time_constant=0.5, command_range=4.0, speed_limit=2.0),
        length=3000.0 * foot,
        cable=Cable(
            # Immersed 0.191 lb/ft (printed); dry mass of solid steel of that immersed weight.
            mass_per_length=0.191 * 7850.0 / (7850.0 - 1025.0) * pound_mass / foot,
            axial_stiffness=axial_stiffness,
            submerged_weight=0.191 * pound_force / foot,
            diameter=0.375 * foot / 12.0,
            tangential_drag_coefficient=0.01,
            axial_damping=0.005 * axial_stiffness,
            tension_only=True,
            breaking_strength=14_800.0 * pound_force,
        ),
        payload=Payload(
            mass=4200.0 * pound_mass,
            added_mass=12.0 * slug,
            submerged_weight=2000.0 * pound_force,
            drag_area=3.14 * foot**2,
        ),
        sensors=(*_survey_sensors(), Sensor(channel="sheave_tension", noise_std=100.0)),
        task=Task(position_weight=100.0, command_weight=1.0, tension_limit=0.5 * 14_800.0 * pound_force),
    )


@scenario("cable", "resonance")
def deep_resonance() -> Scenario:
    """A 12 t package at 2000 m whose cable resonates at 11 s, inside the wave band."""
    return Scenario(
        name="unnamed",
        start="compensated",
        n_iterations=6,
        sea_state=SeaState(significant_wave_height=2.0, peak_omega=0.6),
        vessel=Vessel(natural_omega=0.8, damping_ratio=0.5, gain=0.6),
        winch=Winch(time_constant=1.0, command_range=5.0, command_delay=0.2),
        length=2000.0,
        cable=Cable(
            mass_per_length=7.2,
            axial_stiffness=9.09e9 * circular_section(0.047),
            submerged_weight=54.0,
            diameter=0.047,
            tangential_drag_coefficient=0.025,
            axial_damping=0.005 * 9.09e9 * circular_section(0.047),
            tension_only=True,
        ),
        payload=Payload(mass=12_000.0, added_mass=8_000.0, submerged_weight=100_000.0, drag_area=8.0),
        sensors=(*_survey_sensors(), Sensor(channel="sheave_tension", noise_std=500.0)),
        task=Task(position_weight=1e3, command_weight=1.0),
    )


@scenario("cable", "pay_out", "landing", "delay")
def landing() -> Scenario:
    """A 20 t manifold set down on the bed at 300 m: the last 20 m are paid out at 0.15 m/s while the winch
    compensates, and the episode ends at touch-down, whose speed is the figure of merit. Ours throughout.
    """
    rope = steel_wire_rope(0.036)
    return Scenario(
        name="unnamed",
        start="compensated",
        n_iterations=6,
        sea_state=SeaState(significant_wave_height=2.5, peak_omega=0.7),
        vessel=_thesis_vessel(),
        winch=Winch(time_constant=0.5, command_range=3.0, command_delay=0.2, speed_limit=1.5),
        length=280.0,
        cable=rope,
        payload=Payload(mass=20_000.0, added_mass=18_000.0, submerged_weight=165_000.0, drag_area=30.0),
        pay_out=PayOut(speed=0.15, start=120.0, distance=40.0, ramp=10.0),
        sensors=(
            *_survey_sensors(),
            Sensor(channel="length"),
            Sensor(channel="sheave_tension", noise_std=500.0),
        ),
        task=Task(position_weight=1e4, command_weight=1.0, tension_limit=0.4 * 904e3, landing_depth=300.0),
    )


def _taut_only(parts: dict[str, Any]) -> dict[str, Any]:
    """The thesis's cable as one that goes slack instead of carrying compression; damping as in `lowering`."""
    cable = parts["cable"]
    return {
        **parts,
        "cable": dataclasses.replace(cable, tension_only=True, axial_damping=0.005 * cable.axial_stiffness),
        "n_iterations": 6,
    }


def _survey_sensors_in_a_rough_sea() -> tuple[Sensor, ...]:
    # The noise of `limits_linear`.
    return _survey_sensors(payload=0.01, boom_tip=0.03)


@scenario("cable", "limits", "delay")
def limits_cable() -> Scenario:
    """The thesis's 900 m cable, which may go slack, in a rough sea (Hs 5 m) on the weak winch of
    `limits_linear`: it gives 0.265 m/s and 0.25 m/s2, 0.2 s late.
    """
    rough = limits_linear()
    return Scenario(
        name="unnamed",
        start="compensated",
        # A metre less than there: what the limits leave moves the unit on this cable several times as far.
        sea_state=dataclasses.replace(rough.sea_state, significant_wave_height=5.0),
        vessel=_thesis_vessel(),
        winch=rough.winch,
        sensors=_survey_sensors_in_a_rough_sea(),
        task=Task(position_weight=100.0, command_weight=0.1),
        **_taut_only(_thesis_cable_and_payload()),
    )


def _unknown_cable(sea: SeaState) -> tuple[Draw, ...]:
    """What nobody knows for sure: length and payload (30 % of a), drag, winch, delay, sea and vessel."""
    parts, vessel = _thesis_cable_and_payload(), _thesis_vessel()
    return (
        _spread("length", parts["length"], 0.15),
        _spread("payload.mass", parts["payload"].mass, 0.15),
        _spread("payload.drag_area", parts["payload"].drag_area, 0.5),
        Draw(parameter="winch.time_constant", low=1.0 / 1.5, high=2.0, distribution="log_uniform"),
        Draw(parameter="winch.command_delay", low=0.0, high=0.4),
        _spread("sea_state.significant_wave_height", sea.significant_wave_height, 0.3),
        _spread("sea_state.peak_omega", sea.peak_omega, 0.3),
        _spread("vessel.natural_omega", vessel.natural_omega, 0.25),
        Draw(parameter="vessel.damping_ratio", low=0.4, high=0.8),
    )


@scenario("cable", "delay", "unknown")
def unknown_cable() -> Scenario:
    """The thesis's 900 m cable in its sea state 5, where nobody knows for sure the length, the payload, its
    drag, the winch, the delay, the sea or the vessel: each episode draws them.
    """
    return Scenario(
        name="unnamed",
        start="compensated",
        sea_state=_thesis_sea(),
        vessel=_thesis_vessel(),
        winch=Winch(time_constant=1.0, command_range=4.0, command_delay=0.2),
        sensors=_survey_sensors(),
        task=Task(position_weight=1e4, command_weight=1.0),
        uncertainty=_unknown_cable(_thesis_sea()),
        **_taut_only(_thesis_cable_and_payload()),
    )


@scenario("cable", "limits", "delay", "unknown")
def limits_unknown_cable() -> Scenario:
    """The rough sea and the weak winch of `limits_cable`, with everything unknown that is in
    `unknown_cable`.
    """
    known = limits_cable()
    return dataclasses.replace(known, uncertainty=_unknown_cable(known.sea_state))


@scenario("cable", "energy", "delay")
def energy_cable() -> Scenario:
    """The thesis's 900 m cable in its sea state 5, where the winch's work has a price, whatever its sign, as
    in `energy_linear`. With 0.2 s of delay and noisy sensors.
    """
    priced = energy_linear()
    return dataclasses.replace(
        sea_state_5(),
        sensors=(
            *_payload_sensors(noise_std=0.01),
            Sensor(channel="boom_tip_heave", noise_std=0.02),
            Sensor(channel="boom_tip_heave_rate", noise_std=0.02),
            Sensor(channel="winch_displacement", noise_std=0.001),
        ),
        task=priced.task,
    )


@scenario("cable", "pay_out", "resonance", "slack", "delay")
def recovery() -> Scenario:
    """The thesis's unit of 3.3.5 hauled up from 1350 m at 1 m/s while the winch compensates: after 200 s, at
    1180 m, its natural frequency rises through the peak of the boom tip's motion. Sea and vessel are ours.
    """
    return dataclasses.replace(
        lowering(),
        sea_state=SeaState(
            significant_wave_height=2.0, peak_omega=2.0 * math.pi / 6.5, filter="fitted", filter_order=8
        ),
        # A small vessel that follows all but the shortest of these waves.
        vessel=Vessel(natural_omega=1.0, damping_ratio=0.5, gain=0.6),
        winch=Winch(time_constant=0.5, command_range=3.0, command_delay=0.2),
        length=1350.0,
        # Longer than an episode: the drag's steady pull lasts to its end.
        pay_out=PayOut(speed=-1.0, start=30.0, distance=500.0, ramp=10.0),
    )


@scenario("cable", "umbilical", "delay", "slack")
def rov_umbilical() -> Scenario:
    """A vehicle's garage held still at 300 m by its umbilical (section, mass, drag and unit of H 5.7) under a
    construction vessel, seen by a motion reference unit, acoustics, encoder and load cell.
    """
    stiffness = 9e9 * circular_section(0.047)
    return Scenario(
        name="unnamed",
        start="compensated",
        n_iterations=6,
        sea_state=SeaState(
            significant_wave_height=2.5,
            peak_omega=2.0 * math.pi / 8.0,
            spectrum="jonswap",
            filter="fitted",
            filter_order=8,
        ),
        # Waves 30° off the bow; A-frame over the side, a quarter of the length abaft.
        vessel_table=VesselTable(heading=math.radians(150.0), boom_tip_x=-25.0, boom_tip_y=12.0),
        winch=Winch(
            time_constant=0.3,
            command_range=4.0,
            command_delay=0.2,
            speed_limit=2.0,
            acceleration_limit=2.0,
        ),
        length=300.0,
        cable=Cable(
            mass_per_length=5.4,
            axial_stiffness=stiffness,
            # Of the printed mass and section; the weight itself is not printed.
            submerged_weight=(5.4 - SEAWATER_DENSITY * circular_section(0.047)) * GRAVITY,
            diameter=0.047,
            normal_drag_coefficient=1.2,
            tangential_drag_coefficient=0.01,
            axial_damping=0.005 * stiffness,
            tension_only=True,
        ),
        payload=Payload(
            mass=3000.0,
            added_mass=3000.0,
            # 0.354 m3 displaced; C_d 1.5 on 0.5 m2.
            submerged_weight=(3000.0 - SEAWATER_DENSITY * 0.354) * GRAVITY,
            drag_area=1.5 * 0.5,
        ),
        sensors=(
            *motion_reference_unit(),
            acoustic_depth(),
            winch_encoder(),
            load_cell(100e3),
        ),
        task=Task(position_weight=1e3, command_weight=1.0),
    )
