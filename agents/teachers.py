"""Who is imitated: a designed controller with a filter, or an oracle who knows what each episode drew.

A teacher looks at what the sensors give and says what it would command; then it is told which command was
really given, so that its filter stays right while another one drives.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from agents.guide import Guide, Look, beside, make_guide
from baselines.oracle import DESIGNS as ORACLES
from baselines.oracle import oracle
from heave_env.scenarios import Scenario


class Teacher(Protocol):
    """Who says what it would have done, and is told what was done."""

    @property
    def n_memory(self) -> int:
        """Numbers remembered from step to step [-]."""

    def look(self, observation: np.ndarray, memory: np.ndarray) -> Any:
        """What it makes of measurements (n_rows, n_observations); its own `command` is (n_rows, 1) [m]."""

    def advance(self, memory: np.ndarray, look: Any, command: np.ndarray) -> np.ndarray:
        """Next memory after the command that was given (n_rows, 1) [m]."""


@dataclass(frozen=True)
class _Looks:
    """What a teacher for each row makes of its row."""

    command: np.ndarray
    each: list[Look]


@dataclass(frozen=True)
class Oracle:
    """A teacher for each row, who knows what its sea's episode drew: it shows what an agent should come to,
    who must find out from what it sees.

    Source: Chen et al. (2020).
    """

    teachers: Sequence[Guide]

    @property
    def n_memory(self) -> int:
        """The most that any of them remembers [-]."""
        return max(teacher.n_memory for teacher in self.teachers)

    def look(self, observation: np.ndarray, memory: np.ndarray) -> _Looks:
        """Row by row."""
        looks = [
            teacher.look(observation[row : row + 1], memory[row : row + 1, : teacher.n_memory])
            for row, teacher in enumerate(self.teachers)
        ]
        return _Looks(np.vstack([look.command for look in looks]), looks)

    def advance(self, memory: np.ndarray, look: _Looks, command: np.ndarray) -> np.ndarray:
        """Row by row."""
        following = np.zeros_like(memory)
        for row, (teacher, own) in enumerate(zip(self.teachers, look.each, strict=True)):
            n = teacher.n_memory
            following[row, :n] = teacher.advance(memory[row : row + 1, :n], own, command[row : row + 1])[0]
        return following


@dataclass(frozen=True)
class School:
    """Where teachers come from."""

    card: Mapping[str, Any]
    """Who teaches, and with what weights."""
    teacher: Callable[[Sequence[int]], Teacher]
    """The teacher for the seas of these seeds."""


def school(name: str, scenario: Scenario) -> School:
    """Designs (and, where that is due, tunes) a teacher: a designed controller with a filter, or an oracle.

    Raises:
        ValueError: If the name is unknown, or the controller has no filter that could be told what was done.
    """
    if name not in ORACLES:
        guide = make_guide(name, scenario, mode="estimate", reach=1.0)
        return School(guide.card, lambda seeds: guide)

    def teacher(seeds: Sequence[int]) -> Teacher:
        found = oracle(scenario, seeds, design=name)
        # Sensors have the scales of the scenario that the agent is in, not of one that knows the draw.
        own = [
            dataclasses.replace(controller, scale=found.scale, offset=found.offset)
            for controller in found.controllers
        ]
        return Oracle([beside(own[i], mode="estimate", reach=1.0) for i in found.chosen])

    return School({"controller": name}, teacher)
